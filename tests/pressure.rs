//! Follower pressure and membranes through whole steps: forces are derivatives of the potential, energy
//! is booked, spheres and discs inflate as they should, solids share the mechanism.

use crate::common::*;
use sinew::engine::law::{ElasticEnergy, TangentKind};
use sinew::engine::load::{Pressure, SweptVolumes};
use sinew::engine::mesh::generate::{box_tets, disc_triangles, sphere_triangles, triangle_grid};
use sinew::engine::step::StepError;
use sinew::engine::vertex::FixedAxes;
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::MembraneDescription;
use sinew::models::element::membrane::plane_stress;
use sinew::prelude::*;
use sinew::simulation::SimulationError;

/// A body that is all membrane, without gravity.
fn weightless(mesh: &Mesh, thickness: f64, material: YoungPoisson) -> (Simulation, BodyHandle) {
    let membrane = MembraneDescription::new(&mesh.triangles, thickness, material);
    let options = SimulationOptions::default();
    let (mut simulation, body) = alone(options, &sheet(&mesh.points, membrane));
    simulation.set_gravity(DVec3::ZERO);
    (simulation, body)
}

/// Energy, load part, forces and `K v` at displacements `u`.
fn evaluate(
    simulation: &mut Simulation,
    body: BodyHandle,
    u: &[DVec3],
    v: &[DVec3],
) -> (f64, f64, Vec<DVec3>, Vec<DVec3>) {
    simulation.displace(body, u);
    let product = tangent_product(simulation, body, TangentKind::Exact, v);
    simulation.evaluate();
    let energy = simulation.world().resource::<ElasticEnergy>().clone();
    (energy.total, energy.load, simulation.elastic_forces(body), product)
}

#[test]
fn pressure_on_a_closed_surface_is_conservative() {
    let mesh = sphere_triangles(0.1, 3).unwrap();
    let n = mesh.points.len();
    let (mut s, body) = weightless(&mesh, 1e-3, soft(1e4, 0.3));
    // soft walls: the pressure dominates what is compared
    blow(&mut s, body, &mesh.triangles, 3e3, Curve::Constant);
    let u: Vec<DVec3> = random_field(n, 1).iter().map(|x| 0.01 * *x).collect();
    let v = random_field(n, 2);
    let h = 1e-6;
    let at = |t: f64| -> Vec<DVec3> { u.iter().zip(&v).map(|(u, v)| *u + t * *v).collect() };
    let (_, load, force, kv) = evaluate(&mut s, body, &u, &v);
    assert!(load != 0.0);
    let (ahead, _, f1, _) = evaluate(&mut s, body, &at(h), &v);
    let (behind, _, f0, _) = evaluate(&mut s, body, &at(-h), &v);
    let slope = (ahead - behind) / (2.0 * h);
    let work: f64 = force.iter().zip(&v).map(|(f, v)| f.dot(*v)).sum();
    assert!((slope + work).abs() < 1e-7 * work.abs(), "{slope} {work}");
    let change: Vec<DVec3> = f0.iter().zip(&f1).map(|(a, b)| (*a - *b) / (2.0 * h)).collect();
    assert!(max_distance(&change, &kv) < 1e-6 * max_length(&kv));
    // no net force, and the swept volume is the change of the enclosed one
    let net: DVec3 = force.iter().sum();
    assert!(net.length() < 1e-12 * max_length(&force) * n as f64);
    let volume = |u: &[DVec3]| -> f64 {
        let x = |i: u32| mesh.points[i as usize] + u[i as usize];
        mesh.triangles.iter().map(|&[a, b, c]| x(a).dot(x(b).cross(x(c))) / 6.0).sum()
    };
    evaluate(&mut s, body, &u, &v);
    let swept = s.world().resource::<SweptVolumes>().0[0][1];
    let change = volume(&u) - volume(&vec![DVec3::ZERO; n]);
    assert!((swept - change).abs() < 1e-12 * change.abs(), "{swept} {change}");
}

/// The faces of ten-node tetrahedra are curved: forces, energy and tangent belong together there as well, and the volume swept
/// is that of the curved surface.
#[test]
fn pressure_on_curved_faces_is_conservative() {
    let mesh = jittered_box([1.0, 1.0, 1.0], [2, 2, 2]).with_second_order();
    let n = mesh.points.len();
    let build = || {
        let (mut s, body) = fused(&mesh, soft(1e2, 0.3));
        s.set_gravity(DVec3::ZERO);
        blow(&mut s, body, &mesh.surface_triangles(), 3e3, Curve::Constant);
        (s, body)
    };
    let (mut s, body) = build();
    let u: Vec<DVec3> = random_field(n, 1).iter().map(|x| 0.03 * *x).collect();
    let v = random_field(n, 2);
    let at = |t: f64| -> Vec<DVec3> { u.iter().zip(&v).map(|(u, v)| *u + t * *v).collect() };
    let h = 1e-5;
    let (_, load, force, kv) = evaluate(&mut s, body, &u, &v);
    assert!(load != 0.0);
    let (ahead, _, f1, _) = evaluate(&mut s, body, &at(h), &v);
    let (behind, _, f0, _) = evaluate(&mut s, body, &at(-h), &v);
    let slope = (ahead - behind) / (2.0 * h);
    let work: f64 = force.iter().zip(&v).map(|(f, v)| f.dot(*v)).sum();
    assert!((slope + work).abs() < 1e-7 * work.abs(), "{slope} {work}");
    let change: Vec<DVec3> = f0.iter().zip(&f1).map(|(a, b)| (*a - *b) / (2.0 * h)).collect();
    assert!(
        max_distance(&change, &kv) < 1e-7 * max_length(&kv),
        "{}",
        max_distance(&change, &kv) / max_length(&kv)
    );
    let net: DVec3 = force.iter().sum();
    assert!(net.length() < 1e-12 * max_length(&force) * n as f64);
    // each coordinate runs to the square of itself: a box again, and shape functions of second degree follow it
    let bend =
        |x: &DVec3| DVec3::new(0.4, -0.3, 0.2) * *x * *x + DVec3::new(x.y * x.z, 0.0, 0.0) * 0.5;
    let bent: Vec<DVec3> = mesh.points.iter().map(bend).collect();
    evaluate(&mut s, body, &bent, &v);
    let swept = s.world().resource::<SweptVolumes>().0[0][1];
    assert!((swept - (1.4 * 0.7 * 1.2 - 1.0)).abs() < 1e-12, "{swept}");
    // a face may be named by its corners, or by some of its four triangles
    let by_corners: Vec<[u32; 3]> = {
        let linear = Mesh { middles: Vec::new(), ..mesh.clone() };
        linear.surface_triangles()
    };
    let (mut s, body) = fused(&mesh, soft(1e2, 0.3));
    s.set_gravity(DVec3::ZERO);
    blow(&mut s, body, &by_corners, 3e3, Curve::Constant);
    let (_, corners_load, corners_force, _) = evaluate(&mut s, body, &u, &v);
    assert!((corners_load - load).abs() < 1e-12 * load.abs());
    assert!(max_distance(&corners_force, &force) < 1e-12 * max_length(&force));
    let (mut s, body) = fused(&mesh, soft(1e2, 0.3));
    s.set_gravity(DVec3::ZERO);
    let (some, others): (Vec<_>, Vec<_>) =
        mesh.surface_triangles().into_iter().enumerate().partition(|(i, _)| i % 3 == 0);
    for part in [some, others] {
        let part: Vec<_> = part.into_iter().map(|(_, t)| t).collect();
        blow(&mut s, body, &part, 3e3, Curve::Constant);
    }
    let (_, parts_load, parts_force, parts_kv) = evaluate(&mut s, body, &u, &v);
    assert!((parts_load - load).abs() < 1e-12 * load.abs());
    assert!(max_distance(&parts_force, &force) < 1e-12 * max_length(&force));
    assert!(max_distance(&parts_kv, &kv) < 1e-12 * max_length(&kv));
}

/// Holds the vertices on the coordinate axes so that a sphere cannot move rigidly but can grow.
fn hold_axes(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh) {
    for k in 0..3 {
        let axis = DVec3::AXES[k];
        let on: Vec<u32> = (0..mesh.points.len() as u32)
            .filter(|&v| mesh.points[v as usize].cross(axis).length() < 1e-9)
            .collect();
        assert_eq!(on.len(), 2);
        let rows = simulation.rows(body, "axis", &on).unwrap();
        let mut hold = Constraint::hold("axis", rows);
        hold.axes = FixedAxes(7 & !(1 << k));
        simulation.add_constraint(hold);
    }
}

fn quasi_static() -> SolverSettings {
    solver!(
        Integrator::QuasiStatic,
        linear_tolerance = 1e-6,
        newton_tolerance = 1e-9,
        max_newton_iterations = 100
    )
}

#[test]
fn a_sphere_inflates_to_the_stretch_of_the_exact_solution() {
    let radius = 0.1;
    let mesh = sphere_triangles(radius, 8).unwrap();
    assert_eq!(mesh.triangles.len(), 1280);
    let (young, nu, thickness) = (1e5, 0.3, 1e-3);
    let moduli = plane_stress(young * thickness, nu);
    for (stretch, limit) in [(1.2, 1e-3), (2.0, 3e-3), (4.0, 5e-3)] {
        // the paper's mu2 is twice the shear modulus
        let pressure = (2.0 * moduli.lambda + 2.0 * moduli.mu) * (stretch * stretch - 1.0)
            / (radius * stretch);
        let (mut s, body) = weightless(&mesh, thickness, soft(young, nu));
        hold_axes(&mut s, body, &mesh);
        blow(&mut s, body, &mesh.triangles, pressure, Curve::ramp(0.0, 1.0));
        s.set_solver(quasi_static());
        let steps = 8;
        s.set_dt(1.0 / f64::from(steps));
        for _ in 0..steps {
            s.step().unwrap();
            assert!(!s.report().unconverged);
        }
        let u = s.displacements(body);
        let mean = u.iter().zip(&mesh.points).map(|(u, x)| (*u + *x).length()).sum::<f64>()
            / mesh.points.len() as f64;
        let error = mean / (stretch * radius) - 1.0;
        assert!(error.abs() < limit, "stretch {stretch}: radius off by {error:e}");
        assert!(s.area_report().smallest_ratio > 0.9 * stretch * stretch);
    }
}

#[test]
fn pressure_work_is_booked_apart_and_energy_is_kept() {
    let mesh = disc_triangles(0.1, 6).unwrap();
    let settings = |integrator| SolverSettings { integrator, ..Default::default() };
    let mut ends = Vec::new();
    for (integrator, dt, steps) in [
        (Integrator::StormerVerlet, 2e-3, 50),
        (Integrator::Newton, 5e-4, 200),
        (Integrator::Newton, 2.5e-4, 400),
    ] {
        let (mut s, body) = weightless(&mesh, 1e-3, soft(1e5, 0.3));
        clamp(&mut s, body, &mesh, "rim");
        blow(&mut s, body, &mesh.triangles, 100.0, Curve::ramp(0.0, 0.05));
        s.set_solver(settings(integrator));
        s.set_dt(dt);
        let (mut work, mut least) = (0.0, f64::INFINITY);
        for _ in 0..steps {
            s.step().unwrap();
            let report = s.report();
            work += report.load_work;
            let lost = work - report.elastic_energy - report.kinetic_energy;
            least = least.min(lost);
        }
        let report = s.report();
        // the potential of the pressure, which is negative, is not in it
        assert!(report.elastic_energy > 0.0);
        let energy = report.elastic_energy + report.kinetic_energy;
        if integrator == Integrator::StormerVerlet {
            assert!((work - energy).abs() < 1e-3 * work, "{work} {energy}");
        } else {
            // implicit Euler dissipates, and may not gain
            assert!(least > -1e-9 * work, "{least} of {work}");
        }
        let direct = s.evaluate();
        assert!((direct - s.report().elastic_energy).abs() < 1e-9 * direct);
        ends.push(s.displacements(body)[0].z);
    }
    // implicit Euler is of the first order: its limit is the undamped motion
    let limit = 2.0 * ends[2] - ends[1];
    assert!(ends[0] > 0.01 && (limit / ends[0] - 1.0).abs() < 0.05, "{ends:?}");
}

#[test]
fn pressure_all_round_a_solid_has_the_closed_form() {
    let mesh = box_tets(DVec3::ONE, [2, 2, 2]).unwrap();
    let (young, nu, pressure) = (1e4, 0.3, 2e3);
    for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
        let material = soft(young, nu);
        let options = SimulationOptions::default();
        let (mut s, body) = simulate(options, &mesh, material, Model::StVK, evaluation);
        s.set_gravity(DVec3::ZERO);
        for (k, side) in ["x0", "y0", "z0"].into_iter().enumerate() {
            guide(&mut s, body, &mesh, side, 1 << k);
        }
        // into the body
        let inward: Vec<[u32; 3]> =
            mesh.surface_triangles().into_iter().map(|[a, b, c]| [a, c, b]).collect();
        blow(&mut s, body, &inward, pressure, Curve::Constant);
        s.set_solver(quasi_static());
        s.step().unwrap();
        assert!(!s.report().unconverged);
        // all stretches the same: (3 lambda + 2 mu)(s^2 - 1)/2 = -p s
        let c = young / (1.0 - 2.0 * nu) / 2.0;
        let stretch = (-pressure + (pressure * pressure + 4.0 * c * c).sqrt()) / (2.0 * c);
        let expected: Vec<DVec3> = mesh.points.iter().map(|p| (stretch - 1.0) * *p).collect();
        let u = s.displacements(body);
        assert!(max_distance(&u, &expected) < 1e-7, "{}", max_distance(&u, &expected));
        let wrong = s.face_rows(body, "nowhere", &[[0, 13, 26]]);
        assert!(matches!(wrong, Err(SimulationError::Face { triangle: 0, .. })), "{wrong:?}");
    }
}

#[test]
fn pressures_come_and_go_and_bad_ones_are_refused() {
    let mesh = triangle_grid(glam::DVec2::ONE, [3, 3]).unwrap();
    let (mut s, body) = weightless(&mesh, 1e-3, soft(1e4, 0.3));
    let air = blow(&mut s, body, &mesh.triangles, 10.0, Curve::Constant);
    let push = |s: &mut Simulation| {
        s.set_dt(1e-4);
        s.set_state(body, &vec![DVec3::ZERO; 16], &vec![DVec3::ZERO; 16]).unwrap();
        s.step().unwrap();
        s.velocities(body)[5].z
    };
    let first = push(&mut s);
    assert!(first > 0.0);
    s.world_mut().get_mut::<Pressure>(air).unwrap().pressure = 20.0;
    assert!((push(&mut s) / first - 2.0).abs() < 1e-3);
    s.world_mut().get_mut::<Pressure>(air).unwrap().pressure = f64::NAN;
    let error = s.step().unwrap_err();
    assert!(matches!(error, StepError::InvalidConstraint { .. }), "{error}");
    s.world_mut().despawn(air);
    assert_eq!(push(&mut s), 0.0);
}
