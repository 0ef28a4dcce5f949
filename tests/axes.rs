//! Bodies with axes: beside and instead of a material, in every way of evaluation; mesh independence,
//! conservation, active fibres, removal, recovery.

use crate::common::rich_axes::rich;
use crate::common::*;
use glam::DVec3;
use proptest::prelude::*;
use sinew::engine::law::{ElasticEnergy, RecoveringBodies};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, jitter_interior};
use sinew::engine::vertex::FixedAxes;
use sinew::models::axes::description::{AxesDescription, AxisFamily};
use sinew::models::axes::muscle::MuscleSettings;
use sinew::models::body::Evaluation;
use sinew::models::resection::Region;
use sinew::prelude::*;
use sinew::simulation::SimulationError;

fn build(
    mesh: &Mesh,
    (model, evaluation): (Model, Evaluation),
    axes: Option<AxesDescription>,
    options: SimulationOptions,
) -> (Simulation, BodyHandle) {
    let material = soft(5e3, 0.4);
    let description =
        BodyDescription { model, evaluation, axes, ..BodyDescription::new("body", mesh, material) };
    let (mut simulation, body) = alone(options, &description);
    simulation.set_gravity(DVec3::ZERO);
    (simulation, body)
}

const FUSED: (Model, Evaluation) = (Model::CompressibleStVK, Evaluation::Fused);
const POOLED: (Model, Evaluation) = (Model::CompressibleStVK, Evaluation::Pooled);
const ALONE: (Model, Evaluation) = (Model::Axes, Evaluation::Fused);

/// Energy and forces at random displacements.
fn at_random(
    mesh: &Mesh,
    kind: (Model, Evaluation),
    axes: Option<AxesDescription>,
    precision: Precision,
) -> (f64, Vec<DVec3>) {
    let active = axes.is_some();
    let (mut simulation, body) = build(mesh, kind, axes, options(precision, 1));
    if active {
        activate(&mut simulation, body);
    }
    disturb(&mut simulation, body, 3e-3, 9);
    let energy = simulation.evaluate();
    (energy, simulation.elastic_forces(body))
}

fn activate(simulation: &mut Simulation, body: BodyHandle) {
    simulation.set_activation(body, "c", 0.7).unwrap();
    simulation.set_activation(body, "d", 0.2).unwrap();
    // activations act from the next step on
    simulation.set_dt(1e-9);
    simulation.step().unwrap();
}

#[test]
fn axes_add_to_any_material() {
    let linear = jittered_box([0.06, 0.04, 0.04], [3, 2, 2]);
    for mesh in [&linear, &linear.with_second_order()] {
        let axes = rich(mesh);
        let (energy, force) = at_random(mesh, ALONE, Some(axes.clone()), Precision::F64);
        assert!(energy > 0.0);
        for kind in [FUSED, POOLED, (Model::Corotational, Evaluation::Fused)] {
            if kind == POOLED && mesh.is_second_order() {
                continue;
            }
            let base = at_random(mesh, kind, None, Precision::F64);
            let both = at_random(mesh, kind, Some(axes.clone()), Precision::F64);
            assert!((both.0 - base.0 - energy).abs() < 1e-12 * both.0, "{kind:?}");
            let sum: Vec<_> = base.1.iter().zip(&force).map(|(a, b)| *a + *b).collect();
            assert!(max_distance(&sum, &both.1) < 1e-12 * max_length(&sum), "{kind:?}");
        }
        let narrow = at_random(mesh, ALONE, Some(axes), Precision::F32);
        assert!(max_distance(&narrow.1, &force) < 2e-5 * max_length(&force));
    }
}

/// Under an affine motion ten-node tetrahedra move as linear ones: energies are the same, and what dampers take.
#[test]
fn ten_nodes_have_the_energy_of_linear_tetrahedra() {
    let linear = jittered_box([0.06, 0.04, 0.04], [3, 2, 2]);
    let of = |mesh: &Mesh| {
        let axes = viscous(rich(mesh));
        let (mut simulation, body) = build(mesh, ALONE, Some(axes), options(Precision::F64, 1));
        activate(&mut simulation, body);
        let stretch =
            |x: &DVec3| DVec3::new(0.2 * x.x + 0.1 * x.y, -0.1 * x.y + 0.05 * x.z, 0.15 * x.z);
        let u: Vec<DVec3> = mesh.points.iter().map(stretch).collect();
        let v: Vec<DVec3> = u.iter().map(|u| *u * 3.0).collect();
        simulation.set_state(body, &u, &v).unwrap();
        let energy = simulation.evaluate();
        // too short for forces to change the velocities
        simulation.integrate_by(Integrator::Safe);
        simulation.set_dt(1e-12);
        simulation.step().unwrap();
        (energy, simulation.report().damping_dissipation)
    };
    let (one, ten) = (of(&linear), of(&linear.with_second_order()));
    assert!(one.0 > 0.0 && (one.0 - ten.0).abs() < 1e-12 * one.0, "{one:?} {ten:?}");
    assert!(one.1 > 0.0 && (one.1 - ten.1).abs() < 1e-6 * one.1, "{one:?} {ten:?}");
}

/// In orthogonal directions, with the moduli of an isotropic material, axes alone are that material.
#[test]
fn isotropic_axes_stand_in_for_the_material() {
    let mesh = jittered_box([0.06, 0.04, 0.04], [3, 2, 2]);
    let small = |kind, axes| {
        let (mut simulation, body) = build(&mesh, kind, axes, options(Precision::F64, 1));
        disturb(&mut simulation, body, 1e-9, 9);
        simulation.evaluate();
        simulation.elastic_forces(body)
    };
    let lame = soft(5e3, 0.4).lame().unwrap();
    let linear = small((Model::Linear, Evaluation::Fused), None);
    let axes = small(ALONE, Some(AxesDescription::isotropic(lame)));
    // strains of 1e-7 differ in the second order
    assert!(max_distance(&linear, &axes) < 1e-6 * max_length(&linear));
}

/// The same with dampers along all families.
fn viscous(mut axes: AxesDescription<'static>) -> AxesDescription<'static> {
    for (i, family) in axes.families.iter_mut().enumerate() {
        family.viscosity = 50.0 * (i + 1) as f64;
    }
    axes
}

#[test]
fn threads_change_nothing() {
    let mesh = jittered_box([0.3, 0.1, 0.1], [18, 7, 7]);
    let axes = viscous(rich(&mesh));
    let run = |threads| {
        let (mut simulation, body) =
            build(&mesh, FUSED, Some(axes.clone()), options(Precision::F64, threads));
        clamp(&mut simulation, body, &mesh, "x0");
        simulation.set_gravity(DVec3::new(0.0, 0.0, -9.81));
        simulation.set_activation(body, "c", 0.5).unwrap();
        simulation.set_dt(0.01);
        simulation.steps(3);
        simulation.state_hash()
    };
    assert_eq!(run(1), run(2));
}

/// A bar with fibres along it creeps under a pull as a spring beside a damper: strain
/// `sigma/E (1 - exp(-t E/eta))` with the moduli of material and fibres in E. In tetrahedra and hexahedra.
#[test]
fn dampers_creep() {
    let size = DVec3::new(0.06, 0.02, 0.02);
    let [young, fibres, viscosity, stress] = [1e3, 3e3, 800.0, 4.0];
    let meshes =
        [jittered_box(size.to_array(), [6, 2, 2]), box_hexahedra(size, [6, 2, 2]).unwrap()];
    for mesh in &meshes {
        let family = AxisFamily { viscosity, ..AxisFamily::new("fibres", &[DVec3::X], fibres) };
        let axes = AxesDescription { families: vec![family], ..AxesDescription::default() };
        // next to no inertia
        let material = YoungPoisson { density: 1e-3, ..soft(young, 0.0) };
        let description = BodyDescription {
            model: Model::Linear,
            axes: Some(axes),
            ..BodyDescription::new("bar", mesh, material)
        };
        let (mut simulation, body) = alone(options(Precision::F64, 1), &description);
        let young = young + fibres;
        simulation.set_gravity(DVec3::ZERO);
        for (side, axis) in [("x0", 1), ("y0", 2), ("z0", 4)] {
            guide(&mut simulation, body, mesh, side, axis);
        }
        // nodal forces of a constant traction
        let end = group(mesh, "x1");
        let mut forces = Vec::new();
        let surface = mesh.surface();
        let triangles = surface.triangles.iter().map(|t| &t[..]);
        for face in triangles.chain(surface.quads.iter().map(|q| &q[..])) {
            if face.iter().all(|v| end.contains(v)) {
                let x = |i: usize| mesh.points[face[i] as usize];
                let corner = (x(1) - x(0)).cross(x(2) - x(0)).length();
                let area = if face.len() == 3 { 0.5 * corner } else { corner };
                let force = DVec3::X * stress * area / face.len() as f64;
                let rows = simulation.rows(body, "pull", face).unwrap();
                forces.extend(rows.into_iter().map(|row| (row, force)));
            }
        }
        let total: DVec3 = forces.iter().map(|f| f.1).sum();
        assert!((total.x / (stress * 4e-4) - 1.0).abs() < 1e-12);
        simulation.add_load(Load { name: "pull".into(), forces, curve: Curve::Constant });
        simulation.set_solver(solver!(
            Integrator::TrBdf2,
            newton_tolerance = 1e-10,
            linear_tolerance = 1e-10
        ));
        simulation.set_dt(0.01);
        let (mut dissipated, mut expected) = (0.0, 0.0);
        for step in 1..=40 {
            simulation.step().unwrap();
            dissipated += simulation.report().damping_dissipation;
            let t = 0.01 * f64::from(step);
            let decay = (-t * young / viscosity).exp();
            let strain = stress / young * (1.0 - decay);
            // booked at the velocity at the end of the step
            expected += 0.01 * 2.4e-5 * (stress * decay).powi(2) / viscosity;
            let u = simulation.displacements(body);
            for (u, x) in u.iter().zip(&mesh.points) {
                let exact = strain * x.x;
                // strains of a thousandth, and the second order of the step
                assert!((u.x - exact).abs() < 3e-3 * strain * size.x, "{t}: {} {exact}", u.x);
            }
        }
        assert!((dissipated / expected - 1.0).abs() < 0.01, "{dissipated} {expected}");
    }
}

/// A free trembling body with dampers keeps its momentum, and loses energy as booked.
#[test]
fn dampers_take_energy_and_no_momentum() {
    let mesh = jittered_box([0.06, 0.04, 0.04], [3, 2, 2]);
    let run = |axes: AxesDescription, integrator| {
        let (mut simulation, body) = build(&mesh, FUSED, Some(axes), options(Precision::F64, 1));
        simulation.integrate_by(integrator);
        let n = mesh.points.len();
        let u: Vec<_> = random_field(n, 9).iter().map(|r| *r * 5e-4).collect();
        simulation.set_state(body, &u, &vec![DVec3::X; n]).unwrap();
        simulation.set_dt(1e-3);
        let mass = simulation.masses(body);
        let all: f64 = mass.iter().sum();
        let mut damped = 0.0;
        for _ in 0..20 {
            simulation.step().unwrap();
            let report = simulation.report();
            damped += report.damping_dissipation;
            if integrator == Integrator::Safe {
                // the rest is that of implicit Euler
                assert!(report.damping_dissipation <= report.dissipation);
            }
            let v = simulation.velocities(body);
            let p: DVec3 = v.iter().zip(&mass).map(|(v, m)| *v * *m).sum();
            assert!((p / all).distance(DVec3::X) < 1e-12, "{integrator:?}");
        }
        let report = simulation.report();
        (damped, report.kinetic_energy - 0.5 * all + report.elastic_energy)
    };
    let implicit = [Integrator::Safe, Integrator::Auto, Integrator::Bdf2, Integrator::TrBdf2];
    let explicit = [Integrator::SymplecticEuler, Integrator::StormerVerlet];
    for integrator in implicit.into_iter().chain(explicit) {
        let plain = rich(&mesh);
        let (none, left) = run(plain.clone(), integrator);
        let (taken, less) = run(viscous(plain), integrator);
        assert_eq!(none, 0.0);
        assert!(taken > 0.0 && less < 0.7 * left, "{integrator:?}: {taken} {less} {left}");
    }
}

/// A free body of every kind of axis beside and without a material, spinning and trembling.
#[test]
fn free_bodies_keep_their_momenta() {
    let mesh = jittered_box([0.06, 0.04, 0.04], [3, 2, 2]);
    for kind in [FUSED, ALONE] {
        let (mut simulation, body) =
            build(&mesh, kind, Some(rich(&mesh)), options(Precision::F64, 1));
        activate(&mut simulation, body);
        simulation.integrate_by(Integrator::StormerVerlet);
        simulation.set_dt(1e-3);
        let n = mesh.points.len();
        let u: Vec<_> = random_field(n, 9).iter().map(|r| *r * 1e-3).collect();
        let v: Vec<_> = mesh.points.iter().map(|x| DVec3::Z.cross(*x) * 5.0 + DVec3::X).collect();
        simulation.set_state(body, &u, &v).unwrap();
        let mass = simulation.masses(body);
        let mut momenta = || {
            let (u, v) = (simulation.displacements(body), simulation.velocities(body));
            let p: DVec3 = v.iter().zip(&mass).map(|(v, m)| *v * *m).sum();
            let l: DVec3 = (0..n).map(|i| (mesh.points[i] + u[i]).cross(v[i]) * mass[i]).sum();
            simulation.step().unwrap();
            (p, l)
        };
        let start = momenta();
        for _ in 0..100 {
            let now = momenta();
            assert!(now.0.distance(start.0) < 1e-10 * start.0.length(), "{kind:?}");
            assert!(now.1.distance(start.1) < 1e-10 * start.1.length(), "{kind:?}");
        }
    }
}

/// Tip of a clamped bar of 5 kPa with fibres at an angle under its weight, at growing loads.
fn tip_curve(mesh: &Mesh, angle: f64, modulus: f64, poisson_ratio: f64) -> Vec<DVec3> {
    let direction = [DVec3::new(angle.cos(), angle.sin(), 0.0)];
    let axes = AxesDescription {
        families: vec![AxisFamily::new("fibres", &direction, modulus)],
        ..AxesDescription::default()
    };
    let description = BodyDescription {
        axes: Some(axes),
        ..BodyDescription::new("body", mesh, soft(5e3, poisson_ratio))
    };
    let (mut simulation, body) = alone(options(Precision::F64, 1), &description);
    clamp(&mut simulation, body, mesh, "x0");
    simulation.integrate_by(Integrator::QuasiStatic);
    let tip = group(mesh, "x1");
    [2.0, 4.0, 6.0]
        .map(|g| {
            simulation.set_gravity(DVec3::new(g, 0.0, -g));
            simulation.step().unwrap();
            assert!(!simulation.report().unconverged);
            let u = simulation.displacements(body);
            tip.iter().map(|&v| u[v as usize]).sum::<DVec3>() / tip.len() as f64
        })
        .to_vec()
}

/// Fibres of forty times the modulus on three random meshes of tetrahedra; fibres of five times on finer ones
/// and one of hexahedra, whose errors in bending are others.
#[test]
#[ignore = "slow"]
fn anisotropy_does_not_depend_on_the_mesh() {
    let size = DVec3::new(0.08, 0.04, 0.04);
    for (cells, modulus, poisson_ratio) in [([16, 8, 8], 2e5, 0.4), ([24, 12, 12], 2.5e4, 0.3)] {
        let regular = box_tets(size, cells).unwrap();
        let mut meshes: Vec<Mesh> =
            (1..=3).map(|seed| jitter_interior(&regular, 0.25, seed).unwrap()).collect();
        if cells[0] == 24 {
            meshes.push(box_hexahedra(size, cells).unwrap());
        }
        for degrees in [0.0_f64, 45.0, 90.0] {
            let curve = |mesh| tip_curve(mesh, degrees.to_radians(), modulus, poisson_ratio);
            let curves: Vec<_> = meshes.iter().map(curve).collect();
            let size = curves[0].iter().map(|x| x.length()).fold(0.0, f64::max);
            assert!(size > 1e-3, "{size}");
            for curve in &curves[1..] {
                for (a, b) in curve.iter().zip(&curves[0]) {
                    assert!(a.distance(*b) < 0.03 * size, "{modulus}, {degrees}: {a} {b}");
                }
            }
            // fibres along y pull a bar that is drawn along x and bent along z nowhere else
            let aside = curves[0].iter().map(|x| x.y.abs()).fold(0.0, f64::max);
            assert_eq!(aside > 0.05 * size, degrees == 45.0, "{degrees}: {aside} of {size}");
        }
    }
}

fn bar_with_muscle(muscle: MuscleSettings) -> (Mesh, AxesDescription<'static>) {
    let mesh = jittered_box([0.1, 0.02, 0.02], [10, 2, 2]);
    let axes = AxesDescription {
        families: vec![AxisFamily {
            muscle: Some(muscle),
            ..AxisFamily::new("muscle", &[DVec3::X], 0.0)
        }],
        ..AxesDescription::default()
    };
    let axes = axes.into_owned();
    (mesh, axes)
}

/// A muscle held at both ends pulls with its stress times its cross-section.
#[test]
fn isometric_force() {
    let peak = 2e3;
    let muscle = MuscleSettings { peak_stress: peak, ..MuscleSettings::default() };
    let (linear, axes) = bar_with_muscle(muscle);
    for mesh in [&linear, &linear.with_second_order()] {
        let (mut simulation, body) =
            build(mesh, FUSED, Some(axes.clone()), options(Precision::F64, 1));
        clamp(&mut simulation, body, mesh, "x0");
        let held = clamp(&mut simulation, body, mesh, "x1");
        simulation.integrate_by(Integrator::QuasiStatic);
        for activation in [0.25, 1.0, 0.5, 0.0] {
            simulation.set_activation(body, "muscle", activation).unwrap();
            simulation.step().unwrap();
            simulation.evaluate();
            let force = simulation.reaction(held).unwrap().x;
            let expected = peak * activation * 0.02 * 0.02;
            assert!((force - expected).abs() <= 0.02 * expected + 1e-8, "{activation}: {force}");
        }
    }
}

/// Contraction along a curve of time: the bar shortens, and what it gains came in as work of activation.
#[test]
fn contraction_is_paid_for() {
    let curve = Some(Curve::ramp(0.0, 0.05));
    let muscle = MuscleSettings { peak_stress: 300.0, curve, ..MuscleSettings::default() };
    let (mesh, axes) = bar_with_muscle(muscle);
    let (mut simulation, body) = build(&mesh, FUSED, Some(axes), options(Precision::F64, 1));
    let error = simulation.set_activation(body, "muscle", 0.5).unwrap_err();
    assert!(error.to_string().contains("curve"), "{error}");
    clamp(&mut simulation, body, &mesh, "x0");
    simulation.integrate_by(Integrator::StormerVerlet);
    simulation.set_dt(1e-3);
    simulation.steps(100);
    let report = simulation.report();
    let energy = report.kinetic_energy + report.elastic_energy;
    let work = simulation.activation_work().total;
    // the steps of activation are taken at the state before them
    assert!((energy - work).abs() < 0.02 * energy.abs().max(work.abs()), "{energy} {work}");
    let u = simulation.displacements(body);
    let tip = group(&mesh, "x1");
    assert!(tip.iter().all(|&v| u[v as usize].x < -2e-3));
}

/// `Lambda` keeps the volume of a drawn bar of Poisson's ratio 0.
#[test]
fn volume_is_kept() {
    let mesh = jittered_box([0.1, 0.02, 0.02], [10, 2, 2]);
    let stretched = |lambda: f64| {
        let axes = AxesDescription { volume_modulus: lambda, ..AxesDescription::default() };
        let axes = (lambda > 0.0).then_some(axes);
        let description =
            BodyDescription { axes, ..BodyDescription::new("bar", &mesh, soft(5e3, 0.0)) };
        let (mut simulation, body) = alone(options(Precision::F64, 1), &description);
        simulation.set_gravity(DVec3::ZERO);
        simulation.integrate_by(Integrator::QuasiStatic);
        clamp(&mut simulation, body, &mesh, "x0");
        let motion = Motion::Translate(DVec3::new(0.01, 0.0, 0.0));
        drive(&mut simulation, body, &mesh, "x1", motion, Curve::Constant);
        simulation.step().unwrap();
        simulation.volume(body) / 4e-5 - 1.0
    };
    let (without, with) = (stretched(0.0), stretched(5e4));
    assert!(without > 0.09 && with.abs() < 0.2 * without, "{without} {with}");
}

#[test]
fn recovery_silences_axes_beside_a_material() {
    let mesh = jittered_box([0.06, 0.04, 0.04], [3, 2, 2]);
    let (mut simulation, body) = build(&mesh, FUSED, Some(rich(&mesh)), options(Precision::F64, 1));
    disturb(&mut simulation, body, 3e-3, 9);
    simulation.world_mut().insert_resource(RecoveringBodies(vec![true]));
    simulation.evaluate();
    let energy = simulation.world().resource::<ElasticEnergy>();
    let axes: f64 =
        energy.by_law.iter().filter(|l| ["axes", "fibres"].contains(&l.0)).map(|l| l.1).sum();
    assert_eq!(axes, 0.0, "{:?}", energy.by_law);
    assert!(max_length(&simulation.elastic_forces(body)) > 0.0);
}

/// Another modulus makes the body that would have been built with it, to the last bit.
#[test]
fn a_new_modulus_makes_the_body_that_has_it() {
    let size = DVec3::new(0.06, 0.04, 0.04);
    let linear = jittered_box(size.to_array(), [3, 2, 2]);
    let second_order = linear.with_second_order();
    let meshes = [linear, box_hexahedra(size, [3, 2, 2]).unwrap()];
    let pooled = [(&meshes[0], POOLED)];
    for (mesh, kind) in meshes.iter().chain([&second_order]).map(|mesh| (mesh, FUSED)).chain(pooled)
    {
        let axes = rich(mesh);
        let shape = |axes: AxesDescription, change: &[(&str, f64)]| {
            let (mut simulation, body) = build(mesh, kind, Some(axes), options(Precision::F64, 1));
            activate(&mut simulation, body);
            disturb(&mut simulation, body, 2e-3, 9);
            let before = simulation.evaluate();
            let mut work = 0.0;
            for &(family, modulus) in change {
                work += simulation.set_axis_modulus(body, family, modulus).unwrap();
            }
            let energy = simulation.evaluate();
            assert!((before + work - energy).abs() < 1e-12 * energy);
            (energy, simulation.elastic_forces(body))
        };
        let mut other = axes.clone();
        for (family, modulus) in other.families.iter_mut().zip([500.0, 0.0, 7e3, 2e3, 9e3]) {
            family.modulus = modulus;
        }
        let whole = shape(other, &[]);
        // by way of 0, which must not stick
        let change = [
            ("a", 0.0),
            ("a", 500.0),
            ("b", 0.0),
            ("c", 7e3),
            ("d", 0.0),
            ("d", 2e3),
            ("e", 0.0),
            ("e", 9e3),
        ];
        assert_eq!(shape(axes.clone(), &change), whole);
        assert_ne!(shape(axes, &[]), whole);
    }
    let mesh = &meshes[0];
    let (mut simulation, body) = build(mesh, FUSED, Some(rich(mesh)), options(Precision::F64, 1));
    let error = |e: SimulationError| e.to_string();
    let found = simulation.set_axis_modulus(body, "x", 1.0).map_err(error).unwrap_err();
    assert!(found.contains("no family of axes `x`") && found.contains("\"d\""), "{found}");
    let found = simulation.set_axis_modulus(body, "a", -1.0).map_err(error).unwrap_err();
    assert!(found.contains("-1 Pa"), "{found}");
}

#[test]
fn bad_axes_are_refused() {
    let mesh = jittered_box([0.06, 0.04, 0.04], [3, 2, 2]);
    let try_axes = |model, axes| {
        let own = BodyDescription::new("body", &mesh, soft(5e3, 0.4));
        refused(&BodyDescription { model, axes, ..own })
    };
    let with = |family: AxisFamily| {
        let axes = AxesDescription { families: vec![family], ..AxesDescription::default() };
        try_axes(Model::StVK, Some(axes.into_owned()))
    };
    assert!(try_axes(Model::Axes, None).contains("needs a description"));
    assert!(try_axes(Model::StVK, Some(AxesDescription::default())).contains("no axis"));
    assert!(with(AxisFamily::new("f", &[DVec3::ZERO], 1.0)).contains("no direction"));
    assert!(with(AxisFamily::new("f", &[DVec3::NAN], 1.0)).contains("no direction"));
    assert!(with(AxisFamily::new("f", &[DVec3::X, DVec3::Y], 1.0)).contains("2 directions for 72"));
    assert!(with(AxisFamily::new("f", &[DVec3::X], -1.0)).contains("-1 Pa"));
    let family = AxisFamily { viscosity: f64::NAN, ..AxisFamily::new("f", &[DVec3::X], 1.0) };
    assert!(with(family).contains("NaN Pa s"));
    let muscle = Some(MuscleSettings { width: 0.0, ..MuscleSettings::default() });
    let family = AxisFamily { muscle, ..AxisFamily::new("f", &[DVec3::X], 1.0) };
    assert!(with(family).contains("`width` is 0"));
}

/// A tetrahedron whose one free unknown is pulled by an axis along x with a damper: a linear oscillator. Its
/// displacement over that at the start, after a time in steps of `dt`, both in units of the time of a radian without
/// damping; and the substeps and refinements of the last step.
fn oscillator(integrator: Integrator, ratio: f64, dt: f64, time: f64) -> (f64, [u32; 2]) {
    const LENGTH: f64 = 0.05;
    const MODULUS: f64 = 1e4;
    let points = [DVec3::ZERO, DVec3::X * LENGTH, DVec3::Y * LENGTH, DVec3::Z * LENGTH];
    let mesh = Mesh { points: points.to_vec(), tetrahedra: vec![[0, 1, 2, 3]], ..Mesh::default() };
    // the axis follows vertices 0 and 1 alone: a chord parallel to x through the barycentre
    let density = 1000.0;
    let omega = (MODULUS / (LENGTH * LENGTH) / (density / 4.0)).sqrt();
    let viscosity = 2.0 * ratio * omega * (density / 4.0) * LENGTH * LENGTH;
    let family = AxisFamily { viscosity, ..AxisFamily::new("x", &[DVec3::X], MODULUS) };
    let axes = AxesDescription { families: vec![family], ..AxesDescription::default() };
    let options = SimulationOptions { precision: Precision::F64, ..Default::default() };
    let (mut simulation, body) = build(&mesh, ALONE, Some(axes.into_owned()), options);
    simulation.integrate_by(integrator);
    for (name, vertices, held) in [("rest", vec![0, 2, 3], 7), ("along x", vec![1], 6)] {
        let rows = simulation.rows(body, name, &vertices).unwrap();
        let mut constraint = Constraint::hold(name, rows);
        constraint.axes = FixedAxes(held);
        simulation.add_constraint(constraint);
    }
    let start = 1e-7 * LENGTH;
    let moved = [DVec3::ZERO, DVec3::X * start, DVec3::ZERO, DVec3::ZERO];
    simulation.set_state(body, &moved, &[DVec3::ZERO; 4]).unwrap();
    simulation.set_dt(dt / omega);
    for _ in 0..(time / dt).round() as usize {
        simulation.step().unwrap();
    }
    let report = simulation.report();
    let counts = [report.substeps, report.refinements];
    (simulation.displacements(body)[1].x / start, counts)
}

/// Displacement of an oscillator of frequency 1 that is let go at 1, after a time.
fn damped(ratio: f64, time: f64) -> f64 {
    let root = (1.0 - ratio * ratio).abs().sqrt();
    let (cos, sin) = match ratio < 1.0 {
        true => ((root * time).cos(), (root * time).sin()),
        false => ((root * time).cosh(), (root * time).sinh()),
    };
    (-ratio * time).exp() * (cos + ratio / root * sin)
}

#[test]
fn explicit_dampers_follow_a_damped_oscillator() {
    for integrator in [Integrator::StormerVerlet, Integrator::SymplecticEuler] {
        for ratio in [0.05, 0.5, 3.0] {
            let error = |dt: f64| {
                let found = oscillator(integrator, ratio, dt, 3.0).0;
                (found - damped(ratio, 3.0)).abs()
            };
            let errors = [0.02, 0.01, 0.005].map(error);
            let rate = errors[1] / errors[2];
            // the velocity that is known lags behind, so that both are of first order at least
            assert!(errors[2] < 0.01 && rate > 1.7, "{integrator:?} {ratio}: {errors:?}");
        }
    }
}

#[test]
fn explicit_dampers_give_the_same_bits_on_any_number_of_threads() {
    // more than one range of elements
    let mesh = jittered_box([0.2, 0.1, 0.1], [14, 7, 7]);
    let lame = soft(5e3, 0.4).lame().unwrap();
    for precision in [Precision::F64, Precision::F32] {
        let run = |threads| {
            let mut axes = AxesDescription::isotropic(lame);
            axes.families.iter_mut().for_each(|family| family.viscosity = 20.0);
            let (mut simulation, body) =
                build(&mesh, ALONE, Some(axes), options(precision, threads));
            simulation.integrate_by(Integrator::StormerVerlet);
            disturb(&mut simulation, body, 1e-4, 3);
            simulation.set_dt(1e-3);
            simulation.steps(3);
            (simulation.displacements(body), simulation.velocities(body))
        };
        assert_eq!(run(1), run(3), "{precision:?}");
    }
}

/// Long steps are cut by what the damper asks for, far below what the spring does, and follow the closed form.
#[test]
fn explicit_steps_are_cut_for_strong_dampers() {
    let ratio = 20.0;
    let limit = 4.0 / (2.0 * ratio + f64::hypot(2.0 * ratio, 2.0));
    for integrator in [Integrator::StormerVerlet, Integrator::SymplecticEuler] {
        let (x, [substeps, refinements]) = oscillator(integrator, ratio, 1.0, 10.0);
        // the bound counts held neighbours, too, which makes it twice as large here
        let needed = 1.0 / (0.9 * limit);
        assert!((needed..2.1 * needed).contains(&f64::from(substeps)), "{substeps} {needed}");
        assert_eq!(refinements, 0);
        assert!((x - damped(ratio, 10.0)).abs() < 0.01, "{integrator:?}: {x}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    /// After removals, axes are those of a body built from what is left.
    #[test]
    fn removals_leave_a_fresh_body(
        seed in 0..1000_u64,
        count in 1..50_usize,
        kind in 0..5_usize,
    ) {
        let mut mesh = jittered_box([0.06, 0.04, 0.04], [3, 2, 2]);
        if kind >= 3 {
            mesh = mesh.with_second_order();
        }
        let kind = [FUSED, POOLED, ALONE, FUSED, ALONE][kind];
        let axes = viscous(rich(&mesh));
        let (mut simulation, body) = build(&mesh, kind, Some(axes), options(Precision::F64, 1));
        activate(&mut simulation, body);
        disturb(&mut simulation, body, 2e-3, seed);
        for round in 0..3 {
            let left = simulation.remaining_tetrahedra(body);
            let chosen: Vec<u32> = left
                .iter()
                .copied()
                .filter(|t| (u64::from(*t) * 7919 + seed * 31 + round) % 60 < count as u64)
                .collect();
            if chosen.is_empty() || chosen.len() == left.len() {
                break;
            }
            let before = simulation.evaluate();
            let report = simulation.remove(body, Region::Tetrahedra(chosen));
            let after = simulation.evaluate();
            let removed = report.elastic_energy;
            // muscles that shorten have given energy away: all three may be below zero
            let size = before.abs() + after.abs() + removed.abs();
            prop_assert!(
                (before - after - removed).abs() < 1e-11 * size,
                "{before} {after} {removed}"
            );
            let difference = simulation.verify_against_fresh(body).unwrap();
            prop_assert!(difference.largest() < 1e-12, "{kind:?} {difference:?}");
        }
    }
}
