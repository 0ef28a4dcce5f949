//! Units do not matter: the same scene in metres, centimetres and millimetres, and geometrically
//! similar bodies from a micrometre to a kilometre, give the same displacements over length.

use crate::common::*;
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew::models::body::Evaluation;
use sinew::prelude::*;

/// Units of length and time as multiples of metre and second in which the scene is stated, the mass
/// staying in kg, or (similar bodies) the density in kg/m^3.
#[derive(Clone, Copy, Debug)]
struct Units {
    length: f64,
    time: f64,
    young_modulus: f64,
    density: f64,
}

impl Units {
    const SI: Self = Self { length: 1.0, time: 1.0, young_modulus: 1.0, density: 1.0 };

    /// Numbers become `s` times as large for lengths: `s` = 1000 is millimetres.
    fn of_length(s: f64) -> Self {
        Self { length: s, time: 1.0, young_modulus: 1.0 / s, density: 1.0 / (s * s * s) }
    }

    /// The same material in a body `s` times as large: waves need `s` times as long.
    fn similar(s: f64) -> Self {
        Self { length: s, time: s, young_modulus: 1.0, density: 1.0 }
    }
}

struct Outcome {
    /// Displacements over length.
    field: Vec<DVec3>,
    /// Newton iterations, backtracks, caps, projections, failures, substeps: the decisions.
    decisions: Vec<[u32; 6]>,
    cg_iterations: Vec<u32>,
}

const SIZE: [f64; 3] = [0.2, 0.05, 0.05];

/// A beam that sags from one end while the other end's edge is pushed down and let go.
fn run(mesh: &Mesh, integrator: Integrator, precision: Precision, units: Units) -> Outcome {
    let Units { length, time, young_modulus, density } = units;
    let points: Vec<DVec3> = mesh.points.iter().map(|x| *x * length).collect();
    let material = YoungPoisson {
        young_modulus: 2e4 * young_modulus,
        poisson_ratio: 0.4,
        density: 1000.0 * density,
    };
    let options = SimulationOptions { precision, ..Default::default() };
    let (mut simulation, body) = simulation(
        options,
        &points,
        &mesh.tetrahedra,
        material,
        Model::CompressibleStVK,
        Evaluation::Fused,
    );
    clamp(&mut simulation, body, mesh, "x0");
    let tip = simulation.rows(body, "x1", &group(mesh, "x1")).unwrap();
    let push = Motion::Translate(DVec3::new(0.0, 0.01, -0.03) * length);
    let curve = Curve::ramp(0.0, 0.04 * time);
    let mut tip = Constraint::moving("x1", tip, push, curve);
    // between two steps, so that rounding of the time cannot decide
    tip.until = 0.065 * time;
    simulation.add_constraint(tip);
    let acceleration = length / (time * time);
    simulation.set_gravity(DVec3::new(0.0, 1.0, -9.81) * acceleration);
    let explicit = matches!(integrator, Integrator::SymplecticEuler | Integrator::StormerVerlet);
    simulation.set_dt(0.01 * time);
    simulation.set_solver(solver!(
        integrator,
        mass_damping = 2.0 / time,
        stiffness_damping = if explicit { 0.0 } else { 1e-3 * time }
    ));
    let (mut decisions, mut cg_iterations) = (Vec::new(), Vec::new());
    for _ in 0..10 {
        simulation.step().unwrap();
        let r = simulation.report();
        decisions.push([
            r.newton_iterations,
            r.backtracks,
            r.energy_caps,
            r.projections,
            r.line_search_failures,
            r.substeps,
        ]);
        cg_iterations.push(r.cg_iterations);
    }
    let field = simulation.displacements(body).iter().map(|u| *u / length).collect();
    Outcome { field, decisions, cg_iterations }
}

fn compare(integrator: Integrator, precision: Precision, units: Units, tolerance: f64) {
    let mesh = jittered_box(SIZE, [8, 3, 3]);
    let expected = run(&mesh, integrator, precision, Units::SI);
    let found = run(&mesh, integrator, precision, units);
    assert_eq!(found.decisions, expected.decisions, "{integrator:?} {precision:?} {units:?}");
    // the last systems of Newton's method have a right-hand side of rounding errors alone
    if tolerance == 0.0 || integrator == Integrator::Safe {
        assert_eq!(found.cg_iterations, expected.cg_iterations, "{integrator:?} {units:?}");
    }
    let largest = max_length(&expected.field);
    assert!(largest > 0.005, "{integrator:?}: hardly moved, {largest} m");
    let error = max_distance(&found.field, &expected.field) / SIZE[0];
    assert!(error <= tolerance, "{integrator:?} {precision:?} {units:?}: {error:e} of body size");
}

const ALL: [Integrator; 5] = [
    Integrator::Safe,
    Integrator::Newton,
    Integrator::QuasiStatic,
    Integrator::SymplecticEuler,
    Integrator::StormerVerlet,
];

/// Powers of ten round: ten steps and some hundred CG iterations amplify 1e-16 to less than 1e-12.
#[test]
fn centimetres_and_millimetres() {
    for integrator in ALL {
        for s in [100.0, 1000.0] {
            compare(integrator, Precision::F64, Units::of_length(s), 1e-12);
        }
    }
}

/// Powers of two do not round at all, so that not a bit may change: nothing in the engine may
/// compare a quantity that has units with a plain number.
#[test]
fn powers_of_two_change_no_bit() {
    for integrator in ALL {
        for precision in [Precision::F64, Precision::F32] {
            for s in [1024.0, 1.0 / 1024.0] {
                compare(integrator, precision, Units::of_length(s), 0.0);
                compare(integrator, precision, Units::similar(s), 0.0);
            }
        }
    }
}

#[test]
fn bodies_of_a_micrometre_and_of_a_kilometre() {
    for integrator in ALL {
        for s in [1e-6 / 0.2, 1e3 / 0.2] {
            compare(integrator, Precision::F64, Units::similar(s), 1e-12);
        }
    }
}
