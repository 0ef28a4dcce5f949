//! Results are the same bit for bit for any number of threads, for either executor and when run
//! again; with the portable instruction set they are the same on every machine.

use crate::common::*;
use glam::{DVec2, DVec3};
use sinew::engine::connectivity::ElementKind;
use sinew::engine::lanes::InstructionSet;
use sinew::engine::law::LawBuffers;
use sinew::engine::load::Pressure;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, cup_hexahedra, quad_grid, triangle_grid};
use sinew::engine::schedule::Executor;
use sinew::engine::workers::Workers;
use sinew::models::axes::description::{AxesDescription, AxisAngle, AxisFamily};
use sinew::models::axes::field::helicoidal;
use sinew::models::axes::muscle::MuscleSettings;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::body::{Evaluation, VolumeRule};
use sinew::models::frame::law::TetrahedronLaw;
use sinew::models::laws::pooled::TENSILE;
use sinew::models::laws::svk::FusedStVK;
use sinew::models::resection::Region;
use sinew::prelude::*;
use sinew::solvers::settings::Preconditioner;
use std::path::Path;

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
    let centre = DVec3::new(0.3, 0.05, 0.05);
    let turn = Motion::Rotate { centre, axis: DVec3::X, angle: 1.0 };
    drive(&mut simulation, body, mesh, "x1", turn, Curve::ramp(0.0, 0.02));
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
        (Evaluation::Fused, Precision::F64) => spans::<f64>(&simulation, FusedStVK::NAME),
        (Evaluation::Fused, Precision::F32) => spans::<f32>(&simulation, FusedStVK::NAME),
        (Evaluation::Pooled, Precision::F64) => spans::<f64>(&simulation, TENSILE.info.name),
        (Evaluation::Pooled, Precision::F32) => spans::<f32>(&simulation, TENSILE.info.name),
    };
    assert!(spans >= 4, "{spans} ranges: the body is too small for this test");
    let u = simulation.displacements(body);
    assert!(u.iter().all(|u| u.is_finite()) && max_length(&u) > 1e-3);
    simulation.state_hash()
}

fn spans<S: sinew::engine::scalar::Scalar>(s: &Simulation, law: &str) -> usize {
    s.world().resource::<LawBuffers<S>>().get(law).unwrap().spans.len()
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
    linearised_tr_bdf2_fused_f64: LinearisedTrBdf2 Fused F64, 2;
    linearised_tr_bdf2_fused_f32: LinearisedTrBdf2 Fused F32, 2;
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

/// Hashes of small runs with the portable instruction set, by name and number type.
#[derive(Default)]
struct Hashes(String);

impl Hashes {
    /// A few steps of a body that hangs by the end at x = 0, its end at x = `length` swaying: in both number
    /// types. `prepare` gets the simulation before its first step.
    fn record(
        &mut self,
        name: &str,
        length: f64,
        body: &BodyDescription,
        settings: &SolverSettings,
        prepare: impl Fn(&mut Simulation, BodyHandle),
    ) {
        self.0 += name;
        for precision in [Precision::F64, Precision::F32] {
            let mut simulation = Simulation::new(SimulationOptions {
                precision,
                threads: 2,
                instruction_set: Some(InstructionSet::Portable),
                ..Default::default()
            })
            .unwrap();
            let handle = simulation.add_body(body).unwrap();
            let rows = |side: f64| {
                let near = |x: &DVec3| (x.x - side).abs() < 1e-9;
                let side: Vec<u32> =
                    (0..).zip(body.points).filter(|(_, x)| near(x)).map(|(v, _)| v).collect();
                simulation.rows(handle, "side", &side).unwrap()
            };
            let (held, moved) = (rows(0.0), rows(length));
            simulation.add_constraint(Constraint::hold("held", held));
            let axis = DVec3::new(1.0, 0.2, 0.0);
            let turn = Motion::Rotate { centre: DVec3::X * length, axis, angle: 0.2 };
            let sway = Curve::Sine { frequency: 3.0, phase: 0.1 };
            simulation.add_constraint(Constraint::moving("moved", moved, turn, sway));
            simulation.set_gravity(DVec3::new(0.0, 1.0, -9.81));
            let explicit = settings.integrator.is_explicit();
            simulation.set_dt(if explicit { 1e-3 } else { 0.01 });
            simulation.set_solver(settings.clone());
            prepare(&mut simulation, handle);
            for _ in 0..3 {
                simulation.step().unwrap_or_else(|error| panic!("{name}: {error}"));
            }
            let u = simulation.displacements(handle);
            assert!(u.iter().all(|u| u.is_finite()) && max_length(&u) > 1e-5, "{name}");
            self.0 += &format!(" {:016x}", simulation.state_hash());
        }
        self.0 += "\n";
    }

    /// Every law of every kind of element.
    fn laws(&mut self) {
        let size = DVec3::new(0.3, 0.1, 0.1);
        let tetrahedra = jittered_box(size.into(), [5, 2, 2]);
        let hexahedra = box_hexahedra(size, [5, 2, 2]).unwrap();
        let bodies = [("tetrahedra", &tetrahedra), ("hexahedra", &hexahedra)];
        let settings = SolverSettings::default();
        for (kind, mesh) in bodies {
            let new = || BodyDescription::new("body", mesh, soft(1e4, 0.35));
            for model in Model::ALL {
                // constants of springs in hexahedra come from a fit, whose products of matrices follow the machine
                if kind == "hexahedra" && (!model.serves_hexahedra() || model == Model::MassSpring)
                {
                    continue;
                }
                for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
                    let hexahedra = kind == "hexahedra" && evaluation == Evaluation::Pooled;
                    if !model.supports(evaluation) || hexahedra {
                        continue;
                    }
                    let name = format!("{kind}-{}-{evaluation:?}", model.name());
                    let body = BodyDescription { model, evaluation, ..new() };
                    self.record(&name, size.x, &body, &settings, |_, _| ());
                }
                if model.keeps_mean_volume() {
                    let volume = VolumeRule::Clusters;
                    let new = BodyDescription::new("body", mesh, soft(1e4, 0.4999));
                    let body = BodyDescription { model, volume, ..new };
                    let name = format!("{kind}-{}-clusters", model.name());
                    self.record(&name, size.x, &body, &settings, |_, _| ());
                }
            }
            let muscle = Some(MuscleSettings { peak_stress: 2e3, ..Default::default() });
            let axes = AxesDescription {
                families: vec![
                    AxisFamily { muscle, ..AxisFamily::new("muscle", &[DVec3::X], 1e3) },
                    AxisFamily { viscosity: 20.0, ..AxisFamily::new("fibres", &[DVec3::Y], 5e3) },
                ],
                angles: vec![AxisAngle { families: [0, 1], modulus: 2e3 }],
                volume_modulus: 4e3,
            };
            let body = BodyDescription { axes: Some(axes), ..new() };
            self.record(&format!("{kind}-axes"), size.x, &body, &settings, |_, _| ());
        }
        let size = DVec2::new(0.3, 0.1);
        let triangles = triangle_grid(size, [6, 2]).unwrap();
        let quads = quad_grid(size, [6, 2]).unwrap();
        for (kind, mesh) in [("triangles", &triangles), ("quads", &quads)] {
            for model in MembraneModel::ALL {
                let springs = matches!(model, MembraneModel::MassSpring | MembraneModel::Quadratic);
                for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
                    let of_quads = kind == "quads" && (springs || evaluation == Evaluation::Pooled);
                    if !model.supports(evaluation) || of_quads {
                        continue;
                    }
                    let material = soft(1e5, 0.3);
                    let sheet = MembraneDescription {
                        quads: &mesh.quads,
                        model,
                        evaluation,
                        ..MembraneDescription::new(&mesh.triangles, 2e-3, material)
                    };
                    let body = BodyDescription {
                        membrane: Some(sheet),
                        ..BodyDescription::from_parts("sheet", &mesh.points, &[], material)
                    };
                    let name = format!("{kind}-{}-{evaluation:?}", model.name());
                    self.record(&name, size.x, &body, &settings, |simulation, body| {
                        let faces = simulation.face_rows(body, "air", &mesh.triangles).unwrap();
                        let curve = Curve::ramp(0.0, 0.02);
                        let air = Pressure { name: "air".into(), faces, pressure: 20.0, curve };
                        simulation.add_pressure(air);
                    });
                }
            }
        }
    }

    /// Every integrator, preconditioner and way through a step.
    fn steps(&mut self) {
        let mesh = jittered_box([0.3, 0.1, 0.1], [5, 2, 2]);
        let body = BodyDescription::new("body", &mesh, soft(1e4, 0.35));
        for integrator in [
            Integrator::Safe,
            Integrator::Newton,
            Integrator::Bdf2,
            Integrator::TrBdf2,
            Integrator::LinearisedTrBdf2,
            Integrator::ImplicitMidpoint,
            Integrator::QuasiStatic,
            Integrator::SymplecticEuler,
            Integrator::StormerVerlet,
        ] {
            let settings = SolverSettings { integrator, mass_damping: 0.5, ..Default::default() };
            self.record(integrator.name(), 0.3, &body, &settings, |_, _| ());
        }
        for preconditioner in [Preconditioner::BlockJacobi, Preconditioner::Multigrid] {
            let settings =
                SolverSettings { preconditioner, stiffness_damping: 1e-3, ..Default::default() };
            self.record(preconditioner.name(), 0.3, &body, &settings, |_, _| ());
        }
        let settings = SolverSettings::default();
        self.record("recovery", 0.3, &body, &settings, |simulation, body| {
            let flat: Vec<DVec3> =
                mesh.points.iter().map(|x| DVec3::new(0.0, 0.0, -1.1 * x.z)).collect();
            simulation.displace(body, &flat);
        });
        self.record("removal", 0.3, &body, &settings, |simulation, body| {
            let u: Vec<DVec3> = mesh.points.iter().map(|x| DVec3::X * x.x * x.x).collect();
            simulation.displace(body, &u);
            simulation.remove(body, Region::Strain { above: 0.55 });
            let left = simulation.remaining(body, ElementKind::Tetrahedron).len();
            assert!(left > 0 && left < mesh.tetrahedra.len(), "{left}");
        });
        // shape and fibres made of sines
        let cup = cup_hexahedra([0.02, 0.05], 0.01, 4, 3, 2).unwrap();
        let fibres = helicoidal(&cup, DVec3::ZERO, DVec3::Z, 0.6).unwrap();
        let families = vec![AxisFamily::new("fibres", &fibres.directions, 5e3)];
        let axes = AxesDescription { families, ..Default::default() };
        let body = BodyDescription {
            axes: Some(axes),
            ..BodyDescription::new("cup", &cup, soft(1e4, 0.35))
        };
        self.record("cup", 0.03, &body, &settings, |_, _| ());
    }
}

/// What the portable instruction set promises: these hashes, on every machine. `SINEW_GOLDEN=write` records them
/// again.
#[test]
fn portable_results_are_the_same_on_every_machine() {
    let mut found = Hashes::default();
    found.laws();
    found.steps();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/portable.txt");
    if std::env::var("SINEW_GOLDEN").as_deref() == Ok("write") {
        std::fs::write(&file, &found.0).unwrap();
    }
    let recorded = std::fs::read_to_string(&file).unwrap();
    let differ: Vec<&str> =
        found.0.lines().filter(|l| !recorded.lines().any(|r| r == *l)).collect();
    assert!(differ.is_empty(), "not as recorded (name, f64, f32):\n{}", differ.join("\n"));
    assert_eq!(found.0.lines().count(), recorded.lines().count(), "a recorded run is missing");
}

/// The environment chooses the instruction set of simulations that name none.
#[test]
fn the_environment_chooses_the_instruction_set() {
    let simulation = Simulation::new(SimulationOptions::default()).unwrap();
    let used = simulation.world().resource::<Workers>().instruction_set();
    let named = std::env::var(InstructionSet::VARIABLE).ok();
    assert_eq!(used, named.map_or(InstructionSet::best(), |name| name.parse().unwrap()));
}
