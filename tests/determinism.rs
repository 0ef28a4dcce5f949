//! Results are the same bit for bit for any number of threads, for either executor and when run
//! again.

use crate::common::*;
use glam::DVec3;
use sinew::engine::law::LawBuffer;
use sinew::engine::mesh::Mesh;
use sinew::engine::schedule::Executor;
use sinew::models::fused::FusedStVK;
use sinew::models::pooled::Tensile;
use sinew::prelude::*;

#[derive(Clone, Copy, Debug)]
struct Setting {
    integrator: Integrator,
    evaluation: Evaluation,
    precision: Precision,
    steps: usize,
}

/// A beam held at one end, turned at the other, sagging: every part of a step takes part.
fn hash(mesh: &Mesh, setting: Setting, threads: usize, executor: Executor) -> u64 {
    let options =
        SimulationOptions { precision: setting.precision, threads, executor, ..Default::default() };
    let model = Model::CompressibleStVK;
    let (mut simulation, body) = simulate(options, mesh, soft(1e4, 0.4), model, setting.evaluation);
    clamp(&mut simulation, body, mesh, "x0");
    let rows = simulation.rows(body, "x1", &group(mesh, "x1")).unwrap();
    let centre = DVec3::new(0.3, 0.05, 0.05);
    let turn = Motion::Rotate { centre, axis: DVec3::X, angle: 1.0 };
    simulation.add_constraint(Constraint::moving("x1", rows, turn, Curve::ramp(0.0, 0.02)));
    let implicit = setting.integrator != Integrator::StormerVerlet;
    simulation.set_dt(if implicit { 0.01 } else { 2e-3 });
    simulation.set_solver(SolverSettings {
        integrator: setting.integrator,
        mass_damping: 0.5,
        stiffness_damping: if implicit { 1e-3 } else { 0.0 },
        // two iterations show as much as ten
        max_newton_iterations: 2,
        ..Default::default()
    });
    for _ in 0..setting.steps {
        simulation.step().unwrap();
    }
    let spans = match (setting.evaluation, setting.precision) {
        (Evaluation::Fused, Precision::F64) => spans::<FusedStVK, f64>(&simulation),
        (Evaluation::Fused, Precision::F32) => spans::<FusedStVK, f32>(&simulation),
        (Evaluation::Pooled, Precision::F64) => spans::<Tensile, f64>(&simulation),
        (Evaluation::Pooled, Precision::F32) => spans::<Tensile, f32>(&simulation),
    };
    assert!(spans >= 4, "{spans} ranges: the body is too small for this test");
    let u = simulation.displacements(body);
    assert!(u.iter().all(|u| u.is_finite()) && max_length(&u) > 1e-3);
    simulation.state_hash()
}

fn spans<L: sinew::engine::law::Law, S: sinew::engine::scalar::Scalar>(s: &Simulation) -> usize {
    s.world().resource::<LawBuffer<L, S>>().spans.len()
}

/// 15 552 tetrahedra: seven ranges per law, and laws, assembly and products worth several threads.
fn medium() -> Mesh {
    jittered_box([0.3, 0.1, 0.1], [18, 12, 12])
}

fn same_for_all(mesh: &Mesh, setting: Setting, threads: &[usize]) {
    let expected = hash(mesh, setting, 1, Executor::SingleThreaded);
    assert_eq!(
        hash(mesh, setting, 1, Executor::SingleThreaded),
        expected,
        "{setting:?}: second run"
    );
    for &threads in threads {
        for executor in [Executor::SingleThreaded, Executor::MultiThreaded] {
            let found = hash(mesh, setting, threads, executor);
            assert_eq!(found, expected, "{setting:?}: {threads} threads, {executor:?}");
        }
    }
}

macro_rules! combinations {
    ($($name:ident: $integrator:ident $evaluation:ident $precision:ident, $steps:literal;)+) => {$(
        #[test]
        fn $name() {
            let setting = Setting {
                integrator: Integrator::$integrator,
                evaluation: Evaluation::$evaluation,
                precision: Precision::$precision,
                steps: $steps,
            };
            same_for_all(&medium(), setting, &[1, 2, 3, 8]);
        }
    )+};
}

combinations! {
    safe_fused_f64: Safe Fused F64, 2;
    safe_fused_f32: Safe Fused F32, 2;
    safe_pooled_f64: Safe Pooled F64, 2;
    safe_pooled_f32: Safe Pooled F32, 2;
    newton_fused_f64: Newton Fused F64, 1;
    newton_fused_f32: Newton Fused F32, 1;
    newton_pooled_f64: Newton Pooled F64, 1;
    newton_pooled_f32: Newton Pooled F32, 1;
    linearised_bdf2_fused_f64: LinearisedBdf2 Fused F64, 3;
    linearised_bdf2_fused_f32: LinearisedBdf2 Fused F32, 3;
    linearised_bdf2_pooled_f64: LinearisedBdf2 Pooled F64, 3;
    bdf2_fused_f64: Bdf2 Fused F64, 2;
    bdf2_fused_f32: Bdf2 Fused F32, 2;
    tr_bdf2_fused_f64: TrBdf2 Fused F64, 1;
    tr_bdf2_fused_f32: TrBdf2 Fused F32, 1;
    midpoint_fused_f64: ImplicitMidpoint Fused F64, 1;
    midpoint_fused_f32: ImplicitMidpoint Fused F32, 1;
    verlet_fused_f64: StormerVerlet Fused F64, 2;
    verlet_fused_f32: StormerVerlet Fused F32, 2;
    verlet_pooled_f64: StormerVerlet Pooled F64, 2;
    verlet_pooled_f32: StormerVerlet Pooled F32, 2;
}

/// 22 815 vertices: enough for the scalar products of the linear solver to run side by side too.
#[test]
fn large_body() {
    let mesh = jittered_box([0.3, 0.1, 0.1], [134, 12, 12]);
    assert!(mesh.points.len() > 20_480);
    let setting = Setting {
        integrator: Integrator::Safe,
        evaluation: Evaluation::Fused,
        precision: Precision::F64,
        steps: 1,
    };
    let expected = hash(&mesh, setting, 1, Executor::SingleThreaded);
    for threads in [2, 3] {
        let found = hash(&mesh, setting, threads, Executor::SingleThreaded);
        assert_eq!(found, expected, "{threads} threads");
    }
}
