//! Every law on the device against the same law on the processor in `f64`, in several states: forces,
//! energy, products with the three tangents.

use crate::common::compare::{compare_on, posed};
use crate::common::{
    STATES, beam, bricks, device, displacements, displacements_of, half_bricks, of,
};
use glam::DVec3;
use sinew::engine::law::TangentKind;
use sinew::engine::mesh::Mesh;
use sinew::engine::ratios::measure_volume_ratios;
use sinew::engine::report::VolumeReport;
use sinew::models::body::Evaluation;
use sinew::prelude::*;
use sinew_gpu::GpuOptions;

fn pooled(mesh: &Mesh, model: Model) -> BodyDescription<'_> {
    BodyDescription { evaluation: Evaluation::Pooled, ..of(mesh, model) }
}

const CELLS: [usize; 3] = [8, 4, 3];

fn tetrahedra() -> Mesh {
    beam([10, 4, 5])
}

fn hexahedra() -> Mesh {
    bricks(CELLS)
}

fn mixed() -> Mesh {
    half_bricks(CELLS)
}

/// Tests of bodies: for each its mesh, how the law is evaluated, the law and its name in the log.
macro_rules! parity {
    ($($name:ident: $($mesh:ident $evaluation:ident $model:ident $law:literal),+;)+) => {$(
        #[test]
        fn $name() {
            $(compare_on(&$mesh(), |mesh| $evaluation(mesh, Model::$model), $law);)+
        }
    )+};
}

// hexahedra have no pooled form: theirs is the fused one
parity! {
    fused_stvk: tetrahedra of StVK "svk";
    fused_stvk_with_compression: tetrahedra of CompressibleStVK "svk_comp";
    svk_of_textbooks: tetrahedra of StVKFem "svk_fem";
    quadratic_springs: tetrahedra of QuadraticSprings "tqs";
    mass_spring: tetrahedra of MassSpring "mass_spring";
    linear: tetrahedra of Linear "linear";
    warped_stiffness: tetrahedra of WarpedStiffness "corotational_warped";
    corotational: tetrahedra of Corotational "corotational";
    neo_hookean: tetrahedra of NeoHookean "neo_hookean";
    svk_volume: tetrahedra of StVKVolume "svk_volume", hexahedra of StVKVolume "hexahedra svk_volume";
    pooled_springs: tetrahedra pooled StVK "pooled svk";
    pooled_springs_with_compression: tetrahedra pooled CompressibleStVK "pooled svk_comp";
    hexahedra_stvk: hexahedra of StVK "hexahedra svk", hexahedra of StVKFem "hexahedra svk_fem";
    hexahedra_stvk_with_compression: hexahedra of CompressibleStVK "hexahedra svk_comp";
    hexahedra_linear: hexahedra of Linear "hexahedra linear";
    hexahedra_corotational: hexahedra of Corotational "hexahedra corotational";
    hexahedra_neo_hookean: hexahedra of NeoHookean "hexahedra neo_hookean";
    hexahedra_beside_tetrahedra: mixed of CompressibleStVK "mixed svk_comp", mixed pooled CompressibleStVK "mixed pooled";
    springs_on_edges_of_hexahedra: hexahedra of MassSpring "hexahedra mass_spring";
}

/// Every law has a twin but those named here, with their reason.
#[test]
fn every_row_of_the_table_has_a_twin() {
    // formed from the tensions of edges by the twins of the springs; of membranes what is refused by name
    let without = [
        "spring forces",
        "bending of membranes",
        "glue of wounds",
        "biquadratic fibres of membranes",
        "projected tangent of biquadratic fibres of membranes",
    ];
    // curved elements, hexahedra evaluated once, and volumes that are kept by means
    let more = ["ten-node", "reduced integration", "mean volume", "volume by clusters"];
    for row in sinew::models::laws::LAWS {
        let (name, twins) =
            (row.info.name, sinew_gpu::laws::all().filter(|law| law.row == *row).count());
        let without = without.contains(&name) || more.iter().any(|words| name.contains(words));
        assert_eq!(twins, usize::from(!without), "{name}");
    }
}

#[test]
fn volume_ratios_of_all_elements() {
    let (tets, hexes, mixed) = (tetrahedra(), hexahedra(), mixed());
    let cases = [
        of(&tets, Model::CompressibleStVK),
        pooled(&tets, Model::CompressibleStVK),
        pooled(&tets, Model::StVK),
        of(&hexes, Model::Corotational),
        pooled(&mixed, Model::CompressibleStVK),
        // nothing but springs: the processor measures
        of(&tets, Model::MassSpring),
    ];
    for description in cases {
        let Some(mut backend) = device(&GpuOptions::default()) else { return };
        let mut inverted = 0;
        for state in &STATES {
            let u = displacements_of(description.points, state);
            let (mut double, ..) = posed(&description, &u, Precision::F64);
            let world = double.world_mut();
            world.run_system_cached(measure_volume_ratios::<f64>).unwrap();
            let cpu = world.resource::<VolumeReport>().clone();
            let [gpu] = backend.volumes::<f64>(world).unwrap()[..] else { panic!("one body") };
            if description.model == Model::MassSpring {
                assert_eq!((gpu.elements, gpu.inverted), (0, 0));
                assert_eq!(gpu.smallest, f64::INFINITY);
                continue;
            }
            assert_eq!([gpu.elements, gpu.inverted], [cpu.elements_by_body[0], cpu.inverted]);
            let error = (gpu.smallest - cpu.smallest_ratio).abs();
            assert!(error < 1e-5, "{}: {error:.1e} of {}", state.0, cpu.smallest_ratio);
            inverted = inverted.max(gpu.inverted);
        }
        assert!(description.model == Model::MassSpring || inverted > 20, "{inverted}");
    }
}

#[test]
fn worlds_are_not_taken_for_each_other() {
    let Some(mut backend) = device(&GpuOptions::default()) else { return };
    let mesh = beam([4, 2, 2]);
    let u = displacements(&mesh, &STATES[0]);
    for model in [Model::StVK, Model::Linear] {
        let (mut simulation, energy, _) = posed(&of(&mesh, model), &u, Precision::F64);
        let found = backend.evaluate::<f64>(simulation.world_mut()).unwrap().energies[0];
        assert!((found - energy).abs() < 1e-5 * energy, "{model:?}: {found} of {energy}");
    }
}

#[test]
fn repeats_bit_for_bit_and_does_not_depend_on_how_buffers_are_cut() {
    let mesh = tetrahedra();
    // of 1200 tetrahedra 6 chunks, and 8 parts of the matrix
    repeats(&mesh, &of(&mesh, Model::CompressibleStVK), 128 << 10);
    repeats(&mesh, &pooled(&mesh, Model::CompressibleStVK), 128 << 10);
    let mesh = mixed();
    repeats(&mesh, &of(&mesh, Model::CompressibleStVK), 64 << 10);
    // 50 hexahedra, then 46
    let mesh = hexahedra();
    repeats(&mesh, &of(&mesh, Model::CompressibleStVK), 64 << 10);
}

fn repeats(mesh: &Mesh, description: &BodyDescription<'_>, limit: u64) {
    let Some(mut whole) = device(&GpuOptions::default()) else { return };
    let limit = Some(limit);
    let mut cut = device(&GpuOptions { binding_limit: limit, ..GpuOptions::default() }).unwrap();
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    let body = simulation.add_body(description).unwrap();
    let u = displacements(mesh, &STATES[3]);
    simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()]).unwrap();
    let world = simulation.world_mut();
    let first = whole.evaluate::<f64>(world).unwrap();
    assert!(first == whole.evaluate::<f64>(world).unwrap());
    let parts = cut.evaluate::<f64>(world).unwrap();
    // chunks follow each other in the order of the elements, so even the rounding is the same
    assert!(first.forces == parts.forces);
    assert!((first.energies[0] - parts.energies[0]).abs() < 1e-6 * first.energies[0]);
    let direction = vec![[1.0, -2.0, 0.5, 0.0]; first.forces.len()];
    for kind in [TangentKind::Exact, TangentKind::Projected] {
        let a = whole.multiply::<f64>(world, kind, &direction).unwrap();
        assert!(a == whole.multiply::<f64>(world, kind, &direction).unwrap(), "{kind:?}");
        let b = cut.multiply::<f64>(world, kind, &direction).unwrap();
        assert!(a == b, "{kind:?}");
    }
}
