//! Biquadratic fibres: a transversely isotropic St Venant-Kirchhoff body, as pooled springs and as fibres beside the fused
//! law. Axes of all forms together are in `axes`, which removes, changes and compares them.

use crate::common::*;
use glam::{DMat3, DQuat, DVec2, DVec3};
use sinew::engine::connectivity::ElementKind;
use sinew::engine::law::{DisabledLaws, ElasticEnergy, TangentKind};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{
    box_hexahedra, box_tets, jitter_interior, quad_grid, triangle_grid,
};
use sinew::engine::schedule::Executor;
use sinew::models::axes::description::{AxesDescription, AxisFamily, FibreForm};
use sinew::models::axes::muscle::MuscleSettings;
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::MembraneDescription;
use sinew::models::element::membrane::plane_stress;
use sinew::models::resection::Region;
use sinew::prelude::*;

const FIBRE: f64 = 4e4;
const SIZE: DVec3 = DVec3::new(0.06, 0.04, 0.05);

fn material() -> YoungPoisson {
    soft(1e4, 0.3)
}

/// Fibres of one direction.
fn along(direction: DVec3, modulus: f64) -> AxesDescription<'static> {
    let directions = [direction];
    let family = AxisFamily {
        form: FibreForm::Biquadratic,
        ..AxisFamily::new("fibres", &directions, modulus)
    };
    AxesDescription { families: vec![family], ..AxesDescription::default() }.into_owned()
}

fn body<'a>(mesh: &'a Mesh, evaluation: Evaluation, direction: DVec3) -> BodyDescription<'a> {
    BodyDescription {
        model: Model::StVK,
        evaluation,
        axes: Some(along(direction, FIBRE)),
        ..BodyDescription::new("body", mesh, material())
    }
}

fn direction() -> DVec3 {
    DVec3::new(0.3, -0.5, 0.8).normalize()
}

fn meshes() -> Vec<(&'static str, Mesh, Evaluation)> {
    let regular = box_tets(SIZE, [3, 2, 2]).unwrap();
    let jittered = jitter_interior(&box_tets(SIZE, [4, 3, 3]).unwrap(), 0.25, 5).unwrap();
    vec![
        ("regular, pooled", regular.clone(), Evaluation::Pooled),
        ("regular, fused", regular.clone(), Evaluation::Fused),
        ("jittered, pooled", jittered.clone(), Evaluation::Pooled),
        ("jittered, fused", jittered, Evaluation::Fused),
        ("ten nodes", regular.with_second_order(), Evaluation::Fused),
        ("hexahedra", box_hexahedra(SIZE, [3, 2, 2]).unwrap(), Evaluation::Fused),
    ]
}

/// Energy density of the closed form at a deformation gradient.
fn density(f: DMat3, direction: DVec3) -> f64 {
    let e = 0.5 * (f.transpose() * f - DMat3::IDENTITY);
    let lame = material().lame().unwrap();
    let trace = e.x_axis.x + e.y_axis.y + e.z_axis.z;
    let square: f64 = (0..3).map(|j| e.col(j).length_squared()).sum();
    let strain = direction.dot(e * direction);
    0.5 * lame.lambda * trace * trace + lame.mu * square + 0.5 * FIBRE * strain * strain
}

/// Under a uniform strain the energy is that of the closed form, on any mesh and in any evaluation; inner vertices feel no
/// force. Turning body and fibres and counting vertices from the other end changes nothing, nor do other units.
#[test]
fn a_uniform_strain_is_exact_on_any_mesh() {
    let a = direction();
    let f = DMat3::from_cols(
        DVec3::new(1.2, 0.1, -0.05),
        DVec3::new(0.07, 0.8, 0.2),
        DVec3::new(-0.1, 0.03, 1.1),
    );
    let expected = density(f, a) * SIZE.x * SIZE.y * SIZE.z;
    let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1);
    for (name, mesh, evaluation) in meshes() {
        let energy = |mesh: &Mesh, direction: DVec3, map: &dyn Fn(DVec3) -> DVec3| {
            let body = body(mesh, evaluation, direction);
            let (mut simulation, handle) = alone(options(Precision::F64, 1), &body);
            let u: Vec<DVec3> = mesh.points.iter().map(|x| map(*x) - *x).collect();
            simulation.displace(handle, &u);
            let energy = simulation.evaluate();
            let forces = simulation.elastic_forces(handle);
            let inside = |x: &DVec3| {
                let (low, high) = mesh.bounds().unwrap();
                (*x - low).min_element() > 1e-9 && (high - *x).min_element() > 1e-9
            };
            let most = max_length(&forces);
            // the sides of a turned box are not those of its bounds
            let inside = |x: &DVec3| direction == a && inside(x);
            for (force, _) in forces.iter().zip(&mesh.points).filter(|(_, x)| inside(x)) {
                assert!(force.length() < 1e-10 * most, "{name}: {force} of {most}");
            }
            energy
        };
        let found = energy(&mesh, a, &|x| f * x);
        assert!((found / expected - 1.0).abs() < 1e-12, "{name}: {found} {expected}");
        // renumbered and turned
        let n = mesh.points.len() as u32;
        let other = |v: u32| n - 1 - v;
        let mut changed = mesh.clone();
        changed.points = mesh.points.iter().rev().map(|x| turn * *x).collect();
        changed.tetrahedra.iter_mut().flatten().for_each(|v| *v = other(*v));
        changed.middles.iter_mut().flatten().for_each(|v| *v = other(*v));
        changed.hexahedra.iter_mut().flatten().for_each(|v| *v = other(*v));
        if mesh.hexahedra.is_empty() {
            let found = energy(&changed, turn * a, &|x| turn * (f * (turn.inverse() * x)));
            assert!((found / expected - 1.0).abs() < 1e-12, "{name}, turned: {found} {expected}");
        }
        // millimetres: moduli in N/mm^2 would be 1e-6 of these, so that energies are 1e9 times as large
        let mut small = mesh.clone();
        small.points.iter_mut().for_each(|x| *x *= 1e3);
        let found = energy(&small, a, &|x| f * x);
        assert!((found / (1e9 * expected) - 1.0).abs() < 1e-12, "{name}, mm: {found} {expected}");
    }
}

/// Young's modulus (Pa) in a direction at an angle (rad) to the fibres: `1/E = s11 sin^4 + s33 cos^4 + (2 s13 + 1/mu)
/// sin^2 cos^2` with the compliances of the isotropic stiffness to which the modulus of the fibres is added along them.
fn young_between(angle: f64) -> f64 {
    let lame = material().lame().unwrap();
    let (a, b) = (lame.lambda + 2.0 * lame.mu, lame.lambda);
    let c33 = a + FIBRE;
    let determinant = c33 * (a + b) - 2.0 * b * b;
    let (s33, s13) = ((a + b) / determinant, -b / determinant);
    let s11 = 0.5 * (c33 / determinant + 1.0 / (a - b));
    let (sin, cos) = (angle.sin().powi(2), angle.cos().powi(2));
    1.0 / (s11 * sin * sin + s33 * cos * cos + (2.0 * s13 + 1.0 / lame.mu) * sin * cos)
}

/// A bar pulled along x by a small traction on both ends, its sides free: the compliance along the fibres, across them and
/// between is that of the closed form, the same on every mesh.
#[test]
fn a_bar_has_the_compliance_of_the_closed_form() {
    let stress = 1e-6 * material().young_modulus;
    for (name, mesh, evaluation) in meshes() {
        for degrees in [0.0_f64, 45.0, 90.0] {
            let angle = degrees.to_radians();
            let body = body(&mesh, evaluation, DVec3::new(angle.cos(), angle.sin(), 0.0));
            let (mut simulation, handle) = alone(options(Precision::F64, 1), &body);
            simulation.set_gravity(DVec3::ZERO);
            // rigid motions only
            for (side, axes) in [(DVec3::ZERO, 7), (DVec3::X * SIZE.x, 6), (DVec3::Y * SIZE.y, 4)] {
                let corner = vertices(&mesh.points, |x| x.distance(side) < 1e-9);
                let rows = simulation.rows(handle, "corner", &corner).unwrap();
                let mut constraint = Constraint::hold("corner", rows);
                constraint.axes = sinew::engine::vertex::FixedAxes(axes);
                simulation.add_constraint(constraint);
            }
            // a follower pressure, which a small strain cannot tell from a traction
            for end in ["x0", "x1"] {
                let own = group(&mesh, end);
                let surface = mesh.surface();
                let (mut triangles, mut quads) = (surface.triangles.clone(), surface.quads.clone());
                triangles.retain(|face| face.iter().all(|v| own.contains(v)));
                quads.retain(|face| face.iter().all(|v| own.contains(v)));
                press_on(&mut simulation, handle, (&triangles, &quads), -stress);
            }
            simulation.set_solver(solver!(
                Integrator::QuasiStatic,
                newton_tolerance = 1e-11,
                linear_tolerance = 1e-11
            ));
            simulation.step().unwrap();
            assert!(!simulation.report().unconverged, "{name}");
            let u = simulation.displacements(handle);
            let expected = stress / young_between(angle);
            for (x, u) in mesh.points.iter().zip(&u).filter(|(x, _)| (x.x - SIZE.x).abs() < 1e-9) {
                // the end turns by the shear that the fibres cause: along x it moves alike in z
                let at_y0 = x.y < 1e-9;
                let found = u.x / SIZE.x;
                assert!(
                    !at_y0 || (found / expected - 1.0).abs() < 1e-5,
                    "{name}, {degrees}: {found} {expected}"
                );
            }
            let held: DVec3 = simulation.elastic_forces(handle).into_iter().sum();
            assert!(held.length() < 1e-6 * stress * SIZE.y * SIZE.z, "{name}: {held}");
        }
    }
}

/// Pooled and fused bodies have the same energy, forces and exact tangent, and the same stand-ins for it.
#[test]
fn pooled_springs_are_the_fibres() {
    let mesh = jittered_box(SIZE.into(), [4, 3, 3]);
    let x = random_field(mesh.points.len(), 4);
    let respond = |evaluation, size: f64, kind| {
        let (mut simulation, handle) =
            alone(options(Precision::F64, 1), &body(&mesh, evaluation, direction()));
        disturb(&mut simulation, handle, size, 9);
        let energy = simulation.evaluate();
        let forces = simulation.elastic_forces(handle);
        (energy, forces, tangent_product(&mut simulation, handle, kind, &x))
    };
    for size in [1e-6, 3e-3] {
        for kind in [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected] {
            let fused = respond(Evaluation::Fused, size, kind);
            let pooled = respond(Evaluation::Pooled, size, kind);
            assert!((fused.0 - pooled.0).abs() < 1e-12 * fused.0, "{size} {kind:?}");
            assert!(max_distance(&fused.1, &pooled.1) < 1e-12 * max_length(&fused.1), "{size}");
            let off = max_distance(&fused.2, &pooled.2) / max_length(&fused.2);
            assert!(off < 1e-12, "{size} {kind:?}: {off:e}");
        }
    }
}

/// Fibres cost a pooled body no law that has forces: all their energy is in the springs. Beside the fused law they are one
/// that can be switched off, which leaves the material alone, bit for bit.
#[test]
fn laws_of_fibres() {
    let mesh = jittered_box(SIZE.into(), [3, 2, 2]);
    let run = |evaluation, fibres: bool, disabled: bool| {
        let mut own = body(&mesh, evaluation, direction());
        if !fibres {
            own.axes = None;
        }
        let (mut simulation, handle) = alone(options(Precision::F64, 1), &own);
        if disabled {
            simulation.world_mut().insert_resource(DisabledLaws(vec!["biquadratic fibres"]));
        }
        disturb(&mut simulation, handle, 1e-3, 9);
        let energy = simulation.evaluate();
        let by_law = simulation.world().resource::<ElasticEnergy>().by_law.clone();
        let own = by_law.iter().find(|(name, _)| name.contains("biquadratic fibres"));
        (energy, own.copied(), simulation.elastic_forces(handle))
    };
    let plain = run(Evaluation::Fused, false, false);
    let with = run(Evaluation::Fused, true, false);
    let off = run(Evaluation::Fused, true, true);
    assert_eq!(plain.1, None);
    assert!((with.0 - plain.0 - with.1.unwrap().1).abs() < 1e-12 * with.0);
    assert_eq!((off.0, off.1, off.2), (plain.0, None, plain.2));
    let pooled = run(Evaluation::Pooled, true, false);
    assert_eq!(pooled.1, Some(("projected tangent of biquadratic fibres", 0.0)));
    assert!((pooled.0 - with.0).abs() < 1e-12 * with.0);
}

/// Another modulus on the way makes the pooled springs of the body that would have been built with it.
#[test]
fn a_new_modulus_of_pooled_fibres() {
    let mesh = jittered_box(SIZE.into(), [3, 2, 2]);
    for precision in [Precision::F64, Precision::F32] {
        let run = |modulus, change: &[f64], cut: bool| {
            let own = body(&mesh, Evaluation::Pooled, direction());
            let own = BodyDescription { axes: Some(along(direction(), modulus)), ..own };
            let (mut simulation, handle) = alone(options(precision, 1), &own);
            if cut {
                simulation.remove(handle, Region::Tetrahedra((0..9).collect()));
            }
            disturb(&mut simulation, handle, 1e-3, 9);
            for &modulus in change {
                simulation.set_axis_modulus(handle, "fibres", modulus).unwrap();
            }
            if cut {
                assert_as_fresh(&mut simulation, handle, "changed after a cut");
            }
            (simulation.evaluate(), simulation.elastic_forces(handle))
        };
        for cut in [false, true] {
            let (built, changed) = (run(1e3, &[], cut), run(FIBRE, &[0.0, 1e3], cut));
            // a removal sums over moduli that are stored in the precision of the world
            if precision == Precision::F64 || !cut {
                assert_eq!(built, changed, "{precision:?} {cut}");
            }
            assert_ne!(built, run(FIBRE, &[], cut), "{precision:?} {cut}");
        }
    }
}

/// The same bits for any number of threads and either executor.
#[test]
fn steps_do_not_depend_on_threads() {
    // more than one range of elements
    let mesh = jittered_box([0.2, 0.1, 0.1], [14, 7, 7]);
    for precision in [Precision::F64, Precision::F32] {
        for evaluation in [Evaluation::Pooled, Evaluation::Fused] {
            let run = |threads, executor| {
                let options = SimulationOptions { executor, ..options(precision, threads) };
                let (mut simulation, handle) =
                    alone(options, &body(&mesh, evaluation, direction()));
                hold_end(&mut simulation, handle, &mesh.points);
                simulation.set_dt(0.02);
                simulation.steps(2);
                simulation.state_hash()
            };
            let expected = run(1, Executor::SingleThreaded);
            assert_eq!(run(3, Executor::SingleThreaded), expected, "{precision:?} {evaluation:?}");
            assert_eq!(run(2, Executor::MultiThreaded), expected, "{precision:?} {evaluation:?}");
        }
    }
}

/// The pull of a fibre has its maximum at a stretch of 0.577, as that of the material without term of compression; a
/// fibre that measures stretch pulls on. What is pressed further than that is told.
#[test]
fn fibres_soften_in_compression_and_that_is_told() {
    let mesh = box_tets(DVec3::splat(0.1), [1, 1, 1]).unwrap();
    let run = |form, stretch: f64| {
        let mut axes = along(DVec3::X, FIBRE);
        axes.families[0].form = form;
        let own = BodyDescription::new("body", &mesh, soft(1e4, 0.0));
        let own = BodyDescription { model: Model::NeoHookean, axes: Some(axes), ..own };
        let (mut simulation, handle) = alone(options(Precision::F64, 1), &own);
        simulation.set_gravity(DVec3::ZERO);
        clamp(&mut simulation, handle, &mesh, "x0");
        let motion = Motion::Translate(DVec3::X * 0.1 * (stretch - 1.0));
        drive(&mut simulation, handle, &mesh, "x1", motion, Curve::Constant);
        simulation.integrate_by(Integrator::QuasiStatic);
        simulation.step().unwrap();
        simulation.evaluate();
        let by_law = &simulation.world().resource::<ElasticEnergy>().by_law;
        let energy = by_law.iter().find(|(name, _)| name.contains("fibres")).unwrap().1;
        (energy, simulation.compressed_elements())
    };
    for stretch in [0.9, 0.65, 1.5] {
        let volume = 1e-3;
        let (energy, told) = run(FibreForm::Biquadratic, stretch);
        let strain = 0.5 * (stretch * stretch - 1.0);
        let expected = volume * 0.5 * FIBRE * strain * strain;
        assert!((energy / expected - 1.0).abs() < 1e-9, "{stretch}: {energy} {expected}");
        assert_eq!(told, if stretch < 0.7 { 6 } else { 0 }, "{stretch}");
        let (energy, told) = run(FibreForm::Stretch, stretch);
        let expected = volume * 0.5 * FIBRE * (stretch - 1.0).powi(2);
        assert!((energy / expected - 1.0).abs() < 1e-9, "{stretch}: {energy} {expected}");
        assert_eq!(told, 0, "{stretch}");
    }
}

/// What biquadratic fibres are not is said by name.
#[test]
fn active_biquadratic_fibres_are_refused() {
    let mesh = box_tets(SIZE, [1, 1, 1]).unwrap();
    let mut axes = along(direction(), FIBRE);
    axes.families[0].muscle = Some(MuscleSettings::default());
    let own = BodyDescription { axes: Some(axes), ..body(&mesh, Evaluation::Fused, DVec3::X) };
    let error = refused(&own);
    assert!(error.contains("`fibres`") && error.contains("take the form \"stretch\""), "{error}");
}

/// A jittered sheet in space, turned so that no axis is special.
fn sheet_mesh() -> Mesh {
    let mut mesh = triangle_grid(DVec2::new(0.06, 0.04), [6, 4]).unwrap();
    let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7);
    for (x, noise) in mesh.points.iter_mut().zip(random_field(200, 3)) {
        let inside = x.x > 1e-9 && x.x < 0.06 - 1e-9 && x.y > 1e-9 && x.y < 0.04 - 1e-9;
        let moved = if inside { *x + 2e-3 * DVec3::new(noise.x, noise.y, 0.0) } else { *x };
        *x = turn * moved;
    }
    mesh
}

/// Membranes too: the energy of a uniform strain is that of the closed form, pooled and fused bodies are the same to
/// rounding, another modulus makes the body that has it, and removed triangles take their fibres with them.
#[test]
fn fibres_of_membranes() {
    const THICKNESS: f64 = 1e-3;
    let mesh = sheet_mesh();
    let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7);
    let a = DVec3::new(0.8, 0.6, 0.0);
    // a part across the plane does not count
    let given = [turn * (a + DVec3::Z)];
    let family = |modulus| {
        let family = AxisFamily::new("fibres", &given, modulus);
        [AxisFamily { form: FibreForm::Biquadratic, ..family }]
    };
    let x = random_field(mesh.points.len(), 4);
    let start = |evaluation, fibres: &[AxisFamily]| {
        let own = MembraneDescription::new(&mesh.triangles, THICKNESS, material());
        let own = MembraneDescription { evaluation, fibres, ..own };
        let (mut simulation, handle) = alone(options(Precision::F64, 1), &sheet(&mesh.points, own));
        simulation.set_gravity(DVec3::ZERO);
        (simulation, handle)
    };
    let moduli = plane_stress(material().young_modulus * THICKNESS, material().poisson_ratio);
    let f = |x: DVec3| DVec3::new(x.x * 1.1 + 0.05 * x.y, 0.95 * x.y, 0.2 * x.x - 0.1 * x.y);
    let e = {
        let (p, q) = (f(DVec3::X), f(DVec3::Y));
        [0.5 * (p.dot(p) - 1.0), 0.5 * (q.dot(q) - 1.0), 0.5 * p.dot(q)]
    };
    let along = e[0] * a.x * a.x + e[1] * a.y * a.y + 2.0 * e[2] * a.x * a.y;
    let trace = e[0] + e[1];
    let squares = e[0] * e[0] + e[1] * e[1] + 2.0 * e[2] * e[2];
    let density = 0.5 * moduli.lambda * trace * trace
        + moduli.mu * squares
        + 0.5 * FIBRE * THICKNESS * along * along;
    let expected = density * 0.06 * 0.04;
    let mut found = Vec::new();
    for evaluation in [Evaluation::Pooled, Evaluation::Fused] {
        let (mut simulation, handle) = start(evaluation, &family(FIBRE));
        let u: Vec<DVec3> =
            mesh.points.iter().map(|x| turn * f(turn.inverse() * *x) - *x).collect();
        simulation.displace(handle, &u);
        let energy = simulation.evaluate();
        assert!((energy / expected - 1.0).abs() < 1e-12, "{evaluation:?}: {energy} {expected}");
        disturb(&mut simulation, handle, 3e-3, 9);
        let products = [TangentKind::Exact, TangentKind::GaussNewton]
            .map(|kind| tangent_product(&mut simulation, handle, kind, &x));
        found.push((simulation.evaluate(), simulation.elastic_forces(handle), products));
        // another modulus
        let (mut other, own) = start(evaluation, &family(1e3));
        disturb(&mut other, own, 3e-3, 9);
        other.set_axis_modulus(own, "fibres", FIBRE).unwrap();
        assert_eq!(other.evaluate(), simulation.evaluate(), "{evaluation:?}");
        assert_eq!(other.elastic_forces(own), simulation.elastic_forces(handle));
        // removal
        let before = simulation.evaluate();
        let report = simulation.remove(handle, region(ElementKind::Triangle, (3..11).collect()));
        let after = simulation.evaluate();
        assert!((before - after - report.elastic_energy).abs() < 1e-11 * before, "{evaluation:?}");
        assert_as_fresh(&mut simulation, handle, "membrane with fibres");
        simulation.set_axis_modulus(handle, "fibres", 2e4).unwrap();
        assert_as_fresh(&mut simulation, handle, "membrane with changed fibres");
    }
    let [pooled, fused] = &found[..] else { unreachable!() };
    assert!((pooled.0 / fused.0 - 1.0).abs() < 1e-12);
    assert!(max_distance(&pooled.1, &fused.1) < 1e-12 * max_length(&fused.1));
    for (a, b) in pooled.2.iter().zip(&fused.2) {
        assert!(max_distance(a, b) < 1e-12 * max_length(b));
    }
}

#[test]
fn bad_fibres_of_membranes_are_refused() {
    let mesh = sheet_mesh();
    let quads = quad_grid(DVec2::splat(0.1), [2, 2]).unwrap();
    let normal = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7) * DVec3::Z;
    let of = |mesh: &Mesh, change: &dyn Fn(&mut AxisFamily)| {
        let mut family = along(DVec3::X, FIBRE).families.remove(0);
        change(&mut family);
        let fibres = [family];
        let own = MembraneDescription::new(&mesh.triangles, 1e-3, material());
        let own = MembraneDescription { quads: &mesh.quads, fibres: &fibres, ..own };
        refused(&sheet(&mesh.points, own))
    };
    assert!(of(&quads, &|_| {}).contains("cut the quadrilaterals"));
    let error = of(&mesh, &|own| own.directions = vec![normal].into());
    assert!(error.contains("square to triangle"), "{error}");
    assert!(of(&mesh, &|own| own.form = FibreForm::Stretch).contains("form \"biquadratic\""));
    assert!(of(&mesh, &|own| own.viscosity = 1.0).contains("viscous"));
    assert!(of(&mesh, &|own| own.modulus = -1.0).contains("-1 Pa"));
}
