//! Bodies of tetrahedra, hexahedra, triangles and quadrilaterals, mixed and alone: steps, removals, new
//! materials, springs, recovery.

use crate::common::{
    Shortcuts, assert_as_fresh, assert_fresh, blow, disturb, guide, hold_end, options, pick,
    random_field, recovers, refused, region, sheet,
};
use glam::DVec3;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, jitter_interior, quad_grid};
use sinew::identify::cells::Cells;
use sinew::identify::mesh::fit_elements;
use sinew::identify::{ElementMethod, LinearMaterial, Section};
use sinew::models::axes::description::{AxesDescription, AxisAngle, AxisFamily};
use sinew::models::axes::muscle::MuscleSettings;
use sinew::models::body::lumped::{HexahedronSprings, SpringRule, UniformSprings};
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::body::{Integration, MassRule};
use sinew::models::resection::{Region, RemovalReport};
use sinew::prelude::*;

const SOFT: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.35, density: 1000.0 };

fn alone(body: &BodyDescription) -> (Simulation, BodyHandle) {
    crate::common::alone(options(Precision::F64, 1), body)
}

/// A bar along x whose first half consists of hexahedra and whose second of tetrahedra, its skin at the top
/// of quadrilaterals and triangles.
struct Mixed {
    mesh: Mesh,
    triangles: Vec<[u32; 3]>,
    quads: Vec<[u32; 4]>,
}

fn mixed(cells: [usize; 3]) -> Mixed {
    let size = DVec3::new(0.2, 0.05, 0.05);
    let whole = jitter_interior(&box_hexahedra(size, cells).unwrap(), 0.15, 7).unwrap();
    let middle = |h: &[u32; 8]| h.iter().map(|&v| whole.points[v as usize].x).sum::<f64>() / 8.0;
    let (left, right): (Vec<_>, Vec<_>) =
        whole.hexahedra.iter().partition(|h| middle(h) < 0.5 * size.x);
    let cut = Mesh { points: whole.points.clone(), hexahedra: right, ..Mesh::default() };
    let cut = cut.split_into_simplices();
    let mesh = Mesh {
        points: whole.points.clone(),
        hexahedra: left,
        tetrahedra: cut.tetrahedra,
        ..Mesh::default()
    };
    let top = |cell: &[u32]| cell.iter().all(|&v| whole.points[v as usize].z > size.z - 1e-9);
    let surface = mesh.surface();
    let triangles = surface.triangles.into_iter().filter(|t| top(t)).collect();
    let quads = surface.quads.into_iter().filter(|q| top(q)).collect();
    Mixed { mesh, triangles, quads }
}

impl Mixed {
    /// With fibres along the bar, active in tetrahedra and hexahedra.
    fn with_muscle(&self) -> BodyDescription<'_> {
        let settings = MuscleSettings { peak_stress: 2e3, ..MuscleSettings::default() };
        let family =
            AxisFamily { muscle: Some(settings), ..AxisFamily::new("muscle", &[DVec3::X], 1e3) };
        let stiff = AxisFamily::new("fibres", &[DVec3::Y], 5e3);
        let angles = vec![AxisAngle { families: [0, 1], modulus: 2e3 }];
        let axes = AxesDescription { families: vec![family, stiff], angles, volume_modulus: 4e3 };
        BodyDescription { axes: Some(axes), ..BodyDescription::new("bar", &self.mesh, SOFT) }
    }

    fn description(&self) -> BodyDescription<'_> {
        let skin = MembraneDescription::new(&self.triangles, 1e-3, SOFT);
        let skin = MembraneDescription { quads: &self.quads, ..skin };
        BodyDescription { membrane: Some(skin), ..BodyDescription::new("bar", &self.mesh, SOFT) }
    }
}

/// Both ways to integrate hexahedra.
const INTEGRATIONS: [Integration; 2] = [Integration::Full, Integration::Reduced];

/// Removes a tenth of the elements of a kind.
fn remove_some(
    simulation: &mut Simulation,
    body: BodyHandle,
    kind: ElementKind,
    seed: u64,
) -> RemovalReport {
    let left = simulation.remaining(body, kind);
    let count = left.len().div_ceil(10);
    simulation.remove(body, region(kind, pick(left, count, seed)))
}

#[test]
fn mixed_bars_hang_like_bars_of_one_kind() {
    let tip = |mesh: &Mesh| {
        let (mut simulation, body) = alone(&BodyDescription::new("bar", mesh, SOFT));
        hold_end(&mut simulation, body, &mesh.points);
        simulation.set_gravity(DVec3::new(0.0, 0.0, -1.0));
        simulation.set_dt(1.0);
        simulation.settle();
        assert_eq!(simulation.volume_report().inverted, 0);
        simulation.displacements(body).iter().map(|u| u.z).fold(0.0, f64::min)
    };
    // tetrahedra in the free half are stiffer, by an error of the second order in the size of the cells
    let missing = [[8, 2, 2], [16, 4, 4]].map(|cells| {
        let bricks = box_hexahedra(DVec3::new(0.2, 0.05, 0.05), cells).unwrap();
        1.0 - tip(&mixed(cells).mesh) / tip(&bricks)
    });
    assert!(missing[1] > 0.0 && missing[1] < 0.5 * missing[0], "{missing:?}");
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let bar = mixed([16, 4, 4]);
    let run = |precision, integration, threads| {
        let options = options(precision, threads);
        let description = BodyDescription { integration, ..bar.description() };
        let (mut simulation, body) = crate::common::alone(options, &description);
        hold_end(&mut simulation, body, &bar.mesh.points);
        simulation.set_gravity(DVec3::new(0.0, 0.0, -9.81));
        simulation.set_dt(0.01);
        for step in 0..10 {
            if step == 4 {
                let region = Region::Sphere { centre: DVec3::new(0.1, 0.0, 0.05), radius: 0.03 };
                let report = simulation.remove(body, region);
                let kinds =
                    [&report.tetrahedra, &report.hexahedra, &report.triangles, &report.quads];
                assert!(kinds.iter().all(|list| !list.is_empty()), "{report:?}");
            }
            simulation.step().unwrap();
        }
        simulation.state_hash()
    };
    for precision in [Precision::F64, Precision::F32] {
        for integration in INTEGRATIONS {
            assert_eq!(run(precision, integration, 1), run(precision, integration, 2));
        }
    }
}

#[test]
fn what_is_left_equals_a_fresh_build() {
    let bar = mixed([6, 2, 2]);
    let [full, reduced] = INTEGRATIONS;
    for (model, integration, sheet) in [
        (Model::CompressibleStVK, full, MembraneModel::Biquadratic),
        (Model::CompressibleStVK, reduced, MembraneModel::Biquadratic),
        (Model::Linear, full, MembraneModel::Linear),
        (Model::Linear, reduced, MembraneModel::Linear),
        (Model::Corotational, full, MembraneModel::Corotational),
        (Model::NeoHookean, reduced, MembraneModel::CompressibleBiquadratic),
        (Model::NeoHookean, full, MembraneModel::CompressibleBiquadratic),
        (Model::MassSpring, full, MembraneModel::MassSpring),
    ] {
        let description = bar.description();
        let membrane = description.membrane.map(|m| MembraneDescription { model: sheet, ..m });
        let description = BodyDescription { model, integration, membrane, ..description };
        let (mut simulation, body) = alone(&description);
        simulation.prepare_removals(body).unwrap();
        disturb(&mut simulation, body, 1e-3, 3);
        let mut compacted = 0;
        let energy = simulation.evaluate();
        let mut gone = 0.0;
        for round in 0..8 {
            for kind in ElementKind::ALL {
                let report = remove_some(&mut simulation, body, kind, round);
                compacted += u32::from(report.compacted);
                gone += report.elastic_energy;
            }
            let what = format!("{} {integration:?} round {round}", model.name());
            assert_fresh(&mut simulation, body, 1e-12, &what);
        }
        assert!(compacted > 0);
        let left = simulation.evaluate();
        let lost = (left + gone - energy).abs();
        assert!(lost < 1e-10 * energy, "{} {integration:?}: {lost:e}", model.name());
    }
}

#[test]
fn axes_leave_with_their_elements() {
    let bar = mixed([6, 2, 2]);
    for model in [Model::CompressibleStVK, Model::Axes] {
        let mut description = BodyDescription { model, ..bar.with_muscle() };
        let axes = description.axes.as_mut().unwrap();
        axes.families.iter_mut().for_each(|family| family.viscosity = 30.0);
        let (mut simulation, body) = alone(&description);
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_dt(1e-3);
        simulation.set_activation(body, "muscle", 0.7).unwrap();
        simulation.step().unwrap();
        disturb(&mut simulation, body, 1e-3, 13);
        let energy = simulation.evaluate();
        let mut gone = 0.0;
        for round in 0..6 {
            for kind in [ElementKind::Tetrahedron, ElementKind::Hexahedron] {
                gone += remove_some(&mut simulation, body, kind, round).elastic_energy;
            }
            let what = format!("{} round {round}", model.name());
            assert_fresh(&mut simulation, body, 1e-12, &what);
        }
        let left = simulation.evaluate();
        assert!((left + gone - energy).abs() < 1e-10 * energy, "{}", model.name());
    }
}

#[test]
fn hexahedra_contract_like_tetrahedra() {
    let contract = |mesh: &Mesh, integration| {
        let bar = Mixed { mesh: mesh.clone(), triangles: Vec::new(), quads: Vec::new() };
        let description = BodyDescription { integration, ..bar.with_muscle() };
        let (mut simulation, body) = alone(&description);
        hold_end(&mut simulation, body, &mesh.points);
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_activation(body, "muscle", 1.0).unwrap();
        simulation.set_dt(1.0);
        simulation.settle();
        simulation.displacements(body).iter().map(|u| u.x).fold(0.0, f64::min)
    };
    let bricks = box_hexahedra(DVec3::new(0.2, 0.05, 0.05), [16, 4, 4]).unwrap();
    let b = contract(&bricks.split_into_simplices(), Integration::Full);
    for integration in INTEGRATIONS {
        let a = contract(&bricks, integration);
        assert!(a < -0.01 && (a / b - 1.0).abs() < 0.03, "{integration:?}: {a} {b}");
    }
}

#[test]
fn a_new_material_equals_a_new_body() {
    let bar = mixed([6, 2, 2]);
    let stiff = YoungPoisson { young_modulus: 3e4, poisson_ratio: 0.2, density: 1200.0 };
    let [full, reduced] = INTEGRATIONS;
    for (model, integration) in [
        (Model::CompressibleStVK, full),
        (Model::CompressibleStVK, reduced),
        (Model::Linear, full),
        (Model::Linear, reduced),
        (Model::MassSpring, full),
    ] {
        let run = |first: YoungPoisson, second: Option<YoungPoisson>| {
            let description = BodyDescription { material: first, model, ..bar.description() };
            let description = BodyDescription { integration, ..description };
            let (mut simulation, body) = alone(&description);
            disturb(&mut simulation, body, 1e-3, 5);
            if let Some(second) = second {
                simulation.set_material(body, second).unwrap();
            }
            let energy = simulation.evaluate();
            (energy, simulation.elastic_forces(body), simulation.masses(body))
        };
        let name = model.name();
        assert_eq!(run(stiff, None), run(SOFT, Some(stiff)), "{name} {integration:?}");
    }
}

#[test]
fn springs_are_those_identified() {
    let points = mixed([4, 2, 2]);
    let material = LinearMaterial::new(SOFT.young_modulus, SOFT.poisson_ratio).unwrap();
    for method in [ElementMethod::Frobenius, ElementMethod::Block, ElementMethod::Nonnegative] {
        let cells = Cells {
            tetrahedra: &points.mesh.tetrahedra,
            hexahedra: &points.mesh.hexahedra,
            ..Cells::default()
        };
        let at: Vec<[f64; 3]> = points.mesh.points.iter().map(|p| p.to_array()).collect();
        let fitted = fit_elements(&at, &cells, &[material], &Section::default(), method).unwrap();
        let description = BodyDescription {
            model: Model::MassSpring,
            springs: Some(method.into()),
            ..BodyDescription::new("bar", &points.mesh, SOFT)
        };
        let (mut simulation, body) = alone(&description);
        disturb(&mut simulation, body, 1e-3, 6);
        let u = simulation.displacements(body);
        let mut energy = 0.0;
        for (&[a, b], &k) in fitted.edges.iter().zip(&fitted.constants) {
            let (a, b) = (a as usize, b as usize);
            let rest = points.mesh.points[a] - points.mesh.points[b];
            let stretch = (rest + u[a] - u[b]).length() - rest.length();
            energy += 0.5 * k * stretch * stretch;
        }
        let own = simulation.evaluate();
        assert!((own - energy).abs() < 1e-12 * energy.abs(), "{method}: {own} {energy}");
    }
}

#[test]
fn a_method_that_does_not_fit_is_refused_by_name() {
    let bar = mixed([4, 2, 2]);
    let description = BodyDescription {
        model: Model::MassSpring,
        springs: Some(ElementMethod::Baudet.into()),
        ..BodyDescription::new("bar", &bar.mesh, SOFT)
    };
    let error = refused(&description);
    assert!(error.contains("tetrahedron 0") && error.contains("baudet"), "{error}");
}

#[test]
fn springs_of_a_plate_and_negative_constants_stay_bounded() {
    // long rectangles get negative constants
    let mesh = quad_grid(glam::DVec2::new(0.2, 0.02), [5, 5]).unwrap();
    let plate = MembraneDescription {
        quads: &mesh.quads,
        model: MembraneModel::MassSpring,
        springs: Some(ElementMethod::Frobenius.into()),
        ..MembraneDescription::new(&[], 1e-3, SOFT)
    };
    let (mut simulation, body) = alone(&sheet(&mesh.points, plate));
    hold_end(&mut simulation, body, &mesh.points);
    simulation.set_gravity(DVec3::new(1.0, 0.0, 0.0));
    simulation.set_dt(0.01);
    // rest is no minimum with such springs, so the plate moves away from it; what is stored never passes what the
    // load gave
    let mut work = 0.0;
    for _ in 0..50 {
        simulation.step().unwrap();
        let report = simulation.report();
        work += report.load_work;
        let stored = report.elastic_energy + report.kinetic_energy;
        let size = report.elastic_energy.abs() + report.kinetic_energy;
        assert!(stored <= work + 1e-9 * size, "{stored} of {work}");
    }
    let u = simulation.displacements(body);
    assert!(simulation.report().elastic_energy < 0.0 && u.iter().all(|u| u.is_finite()));
}

#[test]
fn crushed_hexahedra_recover() {
    let mesh = box_hexahedra(DVec3::splat(0.1), [4, 4, 4]).unwrap();
    for (start, integration) in
        ["flat", "mirrored", "point"].into_iter().flat_map(|s| INTEGRATIONS.map(|i| (s, i)))
    {
        let away = |p: DVec3| match start {
            "flat" => p.z * DVec3::Z,
            "mirrored" => 2.0 * p.z * DVec3::Z,
            _ => p,
        };
        let noise = random_field(mesh.points.len(), 2);
        let u: Vec<DVec3> =
            mesh.points.iter().zip(&noise).map(|(p, n)| 1e-6 * *n - away(*p)).collect();
        let cube = BodyDescription { integration, ..BodyDescription::new("cube", &mesh, SOFT) };
        recovers(&cube, &u, &format!("{start} {integration:?}"));
    }
}

#[test]
fn a_balloon_pressure_pushes_hexahedra() {
    let mesh = box_hexahedra(DVec3::splat(0.1), [3, 3, 3]).unwrap();
    let (mut simulation, body) = alone(&BodyDescription::new("cube", &mesh, SOFT));
    // cut along both diagonals, each triangle with half the pressure: every corner gets a quarter
    let both = |[a, b, c, d]: [u32; 4]| [[a, c, b], [a, d, c], [b, d, c], [a, d, b]];
    let inward: Vec<[u32; 3]> = mesh.surface_quads().into_iter().flat_map(both).collect();
    for (group, axes) in [("x0", 1), ("y0", 2), ("z0", 4)] {
        guide(&mut simulation, body, &mesh, group, axes);
    }
    blow(&mut simulation, body, &inward, 250.0, Curve::Constant);
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(1.0);
    simulation.settle();
    let ratios = simulation.volume_ratios(body);
    assert_eq!(ratios.len(), 27);
    let mean = ratios.iter().sum::<f64>() / 27.0;
    let volume = simulation.volume(body);
    assert!((volume / 1e-3 - mean).abs() < 1e-9, "{volume} {mean}");
    // small-strain compression p (1 - 2 nu)/E along every axis
    let expected = 1.0 - 3.0 * 500.0 * (1.0 - 2.0 * SOFT.poisson_ratio) / SOFT.young_modulus;
    assert!(ratios.iter().all(|j| (j - expected).abs() < 2e-3), "{ratios:?} {expected}");
    assert!(ratios.iter().all(|j| (j - ratios[0]).abs() < 1e-6), "{ratios:?}");
    // faces whose hexahedra are gone lose their pressure
    let region = Region::Hexahedra(vec![0]);
    let report = simulation.remove(body, region);
    assert_eq!(report.pressure_faces, 12);
}

#[test]
fn uniform_springs_are_one_for_every_pair() {
    const CONSTANT: f64 = 7.0;
    let cube = |hexahedron| {
        let mesh = box_hexahedra(DVec3::splat(0.1), [5, 5, 5]).unwrap();
        let springs = Some(SpringRule::Uniform(UniformSprings { constant: CONSTANT, hexahedron }));
        let description = BodyDescription {
            model: Model::MassSpring,
            springs,
            masses: MassRule::Equal,
            ..BodyDescription::new("cube", &mesh, SOFT)
        };
        let (mut simulation, body) = alone(&description);
        disturb(&mut simulation, body, 2e-3, 4);
        let u = simulation.displacements(body);
        (simulation, body, mesh, u)
    };
    // pairs at which vertices of a regular grid are joined, as steps of the grid
    let count = |diagonals_of_faces: bool, mesh: &Mesh, u: &[DVec3]| {
        let (mut count, mut energy) = (0, 0.0);
        for a in 0..mesh.points.len() {
            for b in 0..a {
                let rest = mesh.points[a] - mesh.points[b];
                let steps = (rest / 0.02).abs().round();
                let apart = steps.element_sum() as u32;
                if steps.max_element() > 1.0 || (apart == 2 && !diagonals_of_faces) {
                    continue;
                }
                count += 1;
                let stretch = (rest + u[a] - u[b]).length() - rest.length();
                energy += 0.5 * CONSTANT * stretch * stretch;
            }
        }
        (count, energy)
    };
    for (hexahedron, springs) in
        [(HexahedronSprings::EdgesAndDiagonals, 1040), (HexahedronSprings::All, 1940)]
    {
        let (mut simulation, body, mesh, u) = cube(hexahedron);
        let (pairs, energy) = count(springs == 1940, &mesh, &u);
        assert_eq!(pairs, springs);
        let own = simulation.evaluate();
        assert!((own - energy).abs() < 1e-12 * energy, "{springs}: {own} beside {energy}");
        let masses = simulation.masses(body);
        let each = SOFT.density * 1e-3 / 216.0;
        assert!(masses.iter().all(|m| (m - each).abs() < 1e-12 * each));
        // springs go with the last element that has them, and masses with the last of a vertex
        for removed in [vec![0, 1, 7], vec![30, 31, 62], vec![2, 3, 100]] {
            let before = simulation.evaluate();
            let report = simulation.remove(body, Region::Hexahedra(removed));
            let after = simulation.evaluate();
            let gone = report.elastic_energy;
            assert!(gone > 0.0 && (before - after - gone).abs() < 1e-12 * before, "{gone}");
            assert_as_fresh(&mut simulation, body, "springs");
        }
    }
    let springs = Some(SpringRule::Uniform(UniformSprings {
        constant: f64::NAN,
        hexahedron: HexahedronSprings::All,
    }));
    let mesh = box_hexahedra(DVec3::splat(0.1), [1, 1, 1]).unwrap();
    let description = BodyDescription { springs, ..BodyDescription::new("cube", &mesh, SOFT) };
    let error = refused(&description);
    assert!(error.contains("NaN N/m"), "{error}");
}

#[test]
fn uniform_springs_of_triangles_quadrilaterals_and_tetrahedra() {
    let bar = mixed([4, 2, 2]);
    let uniform = |constant| {
        let hexahedron = HexahedronSprings::All;
        Some(SpringRule::Uniform(UniformSprings { constant, hexahedron }))
    };
    let sheet = MembraneDescription {
        quads: &bar.quads,
        model: MembraneModel::MassSpring,
        springs: uniform(3.0),
        ..MembraneDescription::new(&bar.triangles, 1e-3, SOFT)
    };
    let description = BodyDescription {
        model: Model::MassSpring,
        springs: uniform(5.0),
        membrane: Some(sheet),
        ..BodyDescription::new("bar", &bar.mesh, SOFT)
    };
    let (mut simulation, body) = alone(&description);
    disturb(&mut simulation, body, 1e-3, 6);
    let u = simulation.displacements(body);
    let pairs = |elements: &mut dyn Iterator<Item = &[u32]>| {
        let mut pairs: Vec<[u32; 2]> = Vec::new();
        for nodes in elements {
            for (i, &a) in nodes.iter().enumerate() {
                pairs.extend(nodes[..i].iter().map(|&b| [a.min(b), a.max(b)]));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    };
    let tetrahedra = bar.mesh.tetrahedra.iter().map(|t| &t[..]);
    let solid = pairs(&mut tetrahedra.chain(bar.mesh.hexahedra.iter().map(|h| &h[..])));
    let triangles = bar.triangles.iter().map(|t| &t[..]);
    let skin = pairs(&mut triangles.chain(bar.quads.iter().map(|q| &q[..])));
    let mut energy = 0.0;
    for (constant, pairs) in [(5.0, solid), (3.0, skin)] {
        for [a, b] in pairs.into_iter().map(|pair| pair.map(|v| v as usize)) {
            let rest = bar.mesh.points[a] - bar.mesh.points[b];
            let stretch = (rest + u[a] - u[b]).length() - rest.length();
            energy += 0.5 * constant * stretch * stretch;
        }
    }
    let own = simulation.evaluate();
    assert!((own - energy).abs() < 1e-12 * energy, "{own} beside {energy}");
}
