//! Snapshots: what follows from one has the same bits as what would have followed without, whatever acts on the bodies
//! and however steps are made; and bytes that are no snapshot are told.

use crate::common::rich_axes::rich;
use crate::common::*;
use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;
use sinew::engine::lanes::InstructionSet;
use sinew::engine::load::{Load, Pressure};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, quad_grid, triangle_grid};
use sinew::engine::order::Order;
use sinew::models::axes::description::{AxesDescription, AxisAngle, AxisFamily, FibreForm};
use sinew::models::axes::muscle::MuscleSettings;
use sinew::models::body::present::MassPolicy;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::body::{Evaluation, VolumeRule};
use sinew::models::material::field::MaterialField;
use sinew::models::resection::{Region, Removal, RemovalRequest};
use sinew::prelude::*;
use sinew::replay::Replay;
use sinew::snapshot::{Snapshot, SnapshotError};
use sinew::solvers::settings::{LinearPrecision, Preconditioner};
use sinew::touch::tool::{Hinge, Part, PathPoint, Points, ToolError, ToolMotion};
use std::sync::{Arc, Mutex};

/// A scene: how it is built, and what a program does to it before step `k`, counted from 0.
pub(crate) struct Scene<'a> {
    pub(crate) build: &'a dyn Fn(SimulationOptions) -> Simulation,
    pub(crate) act: &'a dyn Fn(&mut Simulation, u64),
}

/// What must be the same after a step: the state, and all that is told of it.
fn mark(simulation: &mut Simulation) -> (u64, String) {
    let told = (simulation.report(), simulation.volume_report(), simulation.area_report());
    let told = format!("{told:?} {:?}", simulation.activation_work());
    (simulation.state_hash(), told)
}

/// Runs on until step `end`; the marks after every step.
fn go(scene: &Scene, simulation: &mut Simulation, end: u64) -> Vec<(u64, String)> {
    let mut marks = Vec::new();
    while simulation.world().resource::<StepClock>().step < end {
        let step = simulation.world().resource::<StepClock>().step;
        (scene.act)(simulation, step);
        simulation.step().unwrap_or_else(|error| panic!("step {step}: {error}"));
        marks.push(mark(simulation));
    }
    marks
}

fn same(found: &[(u64, String)], expected: &[(u64, String)], what: &str) {
    let from = expected.len() - found.len();
    for (i, (found, expected)) in found.iter().zip(&expected[from..]).enumerate() {
        assert_eq!(found, expected, "{what}, step {}", from + i + 1);
    }
}

/// Steps after which snapshots are taken, and the last step.
const TAKEN: [u64; 4] = [1, 17, 50, 99];
const END: u64 = 150;

pub(crate) fn exact(name: &str, options: SimulationOptions, scene: &Scene) {
    let mut undisturbed = (scene.build)(options);
    let expected = go(scene, &mut undisturbed, END);
    let first = &expected[0].0;
    assert!(expected.iter().any(|(hash, _)| hash != first), "{name}: nothing moves");
    let mut simulation = (scene.build)(options);
    let mut snapshots = Vec::new();
    for at in TAKEN {
        same(&go(scene, &mut simulation, at), &expected[..at as usize], "with snapshots");
        snapshots.push((at, simulation.snapshot().unwrap()));
    }
    same(&go(scene, &mut simulation, END), &expected, "with snapshots");
    // back in the same simulation, twice to the first one
    for (at, snapshot) in snapshots.iter().rev().chain(&snapshots[..1]) {
        simulation.restore(snapshot).unwrap();
        let (_, told) = &expected[*at as usize - 1];
        assert_eq!(mark(&mut simulation).1, *told, "{name}: told after {at}");
        let what = format!("{name}: back to {at}");
        same(&go(scene, &mut simulation, END), &expected, &what);
    }
    // into new ones, as bytes
    for (at, snapshot) in &snapshots {
        let bytes = snapshot.to_bytes();
        let read = Snapshot::from_bytes(&bytes).unwrap();
        assert_eq!(read.header(), snapshot.header());
        // the last one with another number of threads
        let threads = if *at == TAKEN[3] { 3 - options.threads } else { options.threads };
        let mut new = (scene.build)(SimulationOptions { threads, ..options });
        new.restore(&read).unwrap();
        let what = format!("{name}: anew from {at}");
        same(&go(scene, &mut new, END), &expected, &what);
    }
    repeats(name, options, scene, &expected);
}

/// A file in memory.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl std::io::Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Whatever a program does to the scene can be done again from a log.
fn repeats(name: &str, options: SimulationOptions, scene: &Scene, expected: &[(u64, String)]) {
    let log = Shared::default();
    let mut simulation = (scene.build)(options);
    simulation.record(Box::new(log.clone()), 9, name).unwrap();
    same(&go(scene, &mut simulation, END), expected, "with a log");
    simulation.stop_recording().unwrap();
    let bytes = log.0.lock().unwrap().clone();
    let replay = Replay::new(bytes.as_slice()).unwrap();
    let repeated =
        replay.run(&mut (scene.build)(options)).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_eq!((repeated.steps, repeated.hashes, repeated.whole), (END, END / 9 + 1, true));
    assert_eq!(repeated.hash, expected[END as usize - 1].0, "{name}: repeated");
}

fn threads(threads: usize) -> SimulationOptions {
    SimulationOptions { threads, ..Default::default() }
}

fn nothing(_: &mut Simulation, _: u64) {}

fn beam_mesh() -> Mesh {
    jittered_box([0.3, 0.1, 0.1], [5, 2, 2])
}

/// Holds the end at x = 0, sways the one at x = 0.3 and pulls on it.
fn sway(simulation: &mut Simulation, body: BodyHandle, points: &[DVec3]) {
    hold_end(simulation, body, points);
    let end = vertices(points, |x| x.x > 0.3 - 1e-9);
    let rows = simulation.rows(body, "end", &end).unwrap();
    let axis = DVec3::new(1.0, 0.2, 0.0);
    let turn = Motion::Rotate { centre: DVec3::X * 0.3, axis, angle: 0.4 };
    let curve = Curve::Sine { frequency: 3.0, phase: 0.1 };
    let until = 0.35;
    let turn = Constraint { until, ..Constraint::moving("sway", rows.clone(), turn, curve) };
    simulation.add_constraint(turn);
    let forces = rows.iter().map(|&row| (row, DVec3::Z * 0.05)).collect();
    let curve = Curve::Sine { frequency: 5.0, phase: 0.0 };
    simulation.add_load(Load { name: "pull".into(), forces, curve });
}

fn beam(
    options: SimulationOptions,
    settings: &SolverSettings,
    body: &BodyDescription,
) -> Simulation {
    let (mut simulation, handle) = alone(options, body);
    sway(&mut simulation, handle, body.points);
    let explicit = settings.integrator.is_explicit();
    simulation.set_dt(if explicit { 2e-3 } else { 0.01 });
    simulation.set_solver(settings.clone());
    simulation
}

/// A beam with all as by default.
fn plain_beam(options: SimulationOptions) -> Simulation {
    let mesh = beam_mesh();
    let body = BodyDescription::new("beam", &mesh, soft(1e4, 0.35));
    beam(options, &SolverSettings::default(), &body)
}

/// The portable instruction set, on one thread.
fn portable_set() -> SimulationOptions {
    SimulationOptions { instruction_set: Some(InstructionSet::Portable), ..threads(1) }
}

/// A beam by an integrator, fused and pooled, in both number types.
fn by_integrator(integrator: Integrator) {
    let mesh = beam_mesh();
    for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
        for precision in [Precision::F64, Precision::F32] {
            let settings = solver!(integrator, mass_damping = 0.5, max_newton_iterations = 20);
            let body = BodyDescription {
                evaluation,
                ..BodyDescription::new("beam", &mesh, soft(1e4, 0.35))
            };
            let build = |options| beam(options, &settings, &body);
            let name = format!("{} {evaluation:?} {precision:?}", integrator.name());
            let scene = Scene { build: &build, act: &nothing };
            let all = SimulationOptions { precision, ..threads(1) };
            exact(&name, all, &scene);
        }
    }
}

/// Tests of some kind, one for each integrator.
macro_rules! integrators {
    ($run:ident: $($(#[$slow:meta])? $name:ident: $integrator:ident;)+) => {$(
        #[test]
        $(#[$slow])?
        fn $name() {
            $run(Integrator::$integrator);
        }
    )+};
}

integrators! { by_integrator:
    auto: Auto;
    safe: Safe;
    #[ignore = "slow"]
    newton: Newton;
    bdf2: Bdf2;
    linearised_bdf2: LinearisedBdf2;
    #[ignore = "slow"]
    tr_bdf2: TrBdf2;
    linearised_tr_bdf2: LinearisedTrBdf2;
    #[ignore = "slow"]
    midpoint: ImplicitMidpoint;
    #[ignore = "slow"]
    quasi_static: QuasiStatic;
    symplectic_euler: SymplecticEuler;
    stormer_verlet: StormerVerlet;
}

/// Kept values of every preconditioner, in both number types, go with the state.
#[test]
fn preconditioners() {
    let mesh = beam_mesh();
    let body = BodyDescription::new("beam", &mesh, soft(1e4, 0.35));
    let mut kinds = vec![
        Preconditioner::BlockJacobi,
        Preconditioner::IncompleteCholesky,
        Preconditioner::Multigrid,
    ];
    kinds.extend(cfg!(feature = "direct").then_some(Preconditioner::Direct));
    for preconditioner in kinds {
        for linear_precision in [LinearPrecision::Mixed, LinearPrecision::Full] {
            let settings = solver!(
                Integrator::Auto,
                preconditioner,
                linear_precision,
                stiffness_damping = 1e-3
            );
            let build = |options| beam(options, &settings, &body);
            let name = format!("{} {linear_precision:?}", preconditioner.name());
            exact(&name, threads(1), &Scene { build: &build, act: &nothing });
        }
    }
}

#[test]
#[ignore = "slow"]
fn all_models_of_solids() {
    let size = DVec3::new(0.3, 0.1, 0.1);
    let hexahedra = box_hexahedra(size, [4, 2, 2]).unwrap();
    for mesh in [&beam_mesh(), &hexahedra] {
        for model in Model::ALL {
            let hexahedra = !mesh.hexahedra.is_empty();
            if hexahedra && (!model.serves_hexahedra() || model == Model::MassSpring) {
                continue;
            }
            for (volume, nu) in [(VolumeRule::Elements, 0.35), (VolumeRule::Clusters, 0.4999)] {
                if volume == VolumeRule::Clusters && !model.keeps_mean_volume() {
                    continue;
                }
                let new = BodyDescription::new("beam", mesh, soft(1e4, nu));
                let body = BodyDescription { model, volume, ..new };
                let settings = SolverSettings::default();
                let build = |options| beam(options, &settings, &body);
                exact(model.name(), threads(1), &Scene { build: &build, act: &nothing });
            }
        }
    }
}

/// Membranes under pressure, which another program's hand lets off.
#[test]
fn membranes_and_pressures() {
    let size = DVec2::new(0.3, 0.1);
    let (triangles, quads) =
        (triangle_grid(size, [6, 2]).unwrap(), quad_grid(size, [6, 2]).unwrap());
    for integrator in [Integrator::Auto, Integrator::StormerVerlet] {
        for mesh in [&triangles, &quads] {
            let material = soft(1e5, 0.3);
            let membrane = MembraneDescription {
                quads: &mesh.quads,
                model: MembraneModel::Corotational,
                ..MembraneDescription::new(&mesh.triangles, 2e-3, material)
            };
            let body = sheet(&mesh.points, membrane);
            let settings = solver!(integrator, mass_damping = 1.0);
            let build = |options| {
                let mut simulation = beam(options, &settings, &body);
                let curve = Curve::ramp(0.0, 0.2);
                blow(&mut simulation, BodyHandle(0), &mesh.triangles, 20.0, curve);
                simulation
            };
            let act = |simulation: &mut Simulation, step| {
                if step == 40 {
                    let world = simulation.world_mut();
                    for mut air in world.query::<&mut Pressure>().iter_mut(world) {
                        air.pressure = 5.0;
                    }
                }
            };
            exact(integrator.name(), threads(1), &Scene { build: &build, act: &act });
        }
    }
}

/// Fibres, muscles by curve and by hand, dampers, and another modulus on the way.
#[test]
fn axes_and_muscles() {
    let mesh = beam_mesh();
    let by_curve = MuscleSettings {
        peak_stress: 2e3,
        curve: Some(Curve::Sine { frequency: 4.0, phase: 0.4 }),
        ..Default::default()
    };
    let by_hand = MuscleSettings { peak_stress: 1e3, ..Default::default() };
    let axes = AxesDescription {
        families: vec![
            AxisFamily { muscle: Some(by_curve), ..AxisFamily::new("curve", &[DVec3::X], 1e3) },
            AxisFamily { muscle: Some(by_hand), ..AxisFamily::new("hand", &[DVec3::Z], 1e3) },
            AxisFamily { viscosity: 20.0, ..AxisFamily::new("fibres", &[DVec3::Y], 5e3) },
            AxisFamily {
                form: FibreForm::Biquadratic,
                ..AxisFamily::new("strain", &[DVec3::NEG_Z], 8e3)
            },
        ],
        angles: vec![AxisAngle { families: [0, 2], modulus: 2e3 }],
        volume_modulus: 4e3,
    };
    for (integrator, evaluation) in [
        (Integrator::Auto, Evaluation::Fused),
        (Integrator::Auto, Evaluation::Pooled),
        (Integrator::StormerVerlet, Evaluation::Fused),
    ] {
        let body = BodyDescription {
            axes: Some(axes.clone()),
            evaluation,
            ..BodyDescription::new("beam", &mesh, soft(1e4, 0.35))
        };
        let settings = solver!(integrator);
        let build = |options| beam(options, &settings, &body);
        let act = |simulation: &mut Simulation, step: u64| {
            let activation = (step as f64 * 0.11).fract();
            simulation.set_activation(BodyHandle(0), "hand", activation).unwrap();
            if step == 25 {
                simulation.set_axis_modulus(BodyHandle(0), "fibres", 2e3).unwrap();
                simulation.set_axis_modulus(BodyHandle(0), "strain", 4e3).unwrap();
            }
        };
        exact(integrator.name(), threads(1), &Scene { build: &build, act: &act });
    }
}

/// Removals in a schedule and by hand, one of which compacts the tables, with other materials between.
#[test]
#[ignore = "slow"]
fn removals_and_materials() {
    let mesh = jittered_box([0.3, 0.1, 0.1], [8, 3, 3]);
    let hexahedra = box_hexahedra(DVec3::new(0.3, 0.1, 0.1), [8, 3, 3]).unwrap();
    for (mesh, evaluation, integrator) in [
        (&mesh, Evaluation::Fused, Integrator::Auto),
        (&mesh, Evaluation::Pooled, Integrator::Safe),
        (&mesh, Evaluation::Fused, Integrator::StormerVerlet),
        (&hexahedra, Evaluation::Fused, Integrator::Auto),
    ] {
        let body =
            BodyDescription { evaluation, ..BodyDescription::new("beam", mesh, soft(1e4, 0.35)) };
        let settings = solver!(integrator, preconditioner = Preconditioner::Multigrid);
        let build = |options| beam(options, &settings, &body);
        let act = |simulation: &mut Simulation, step| {
            let body = BodyHandle(0);
            let ball = |x: f64, radius| {
                let centre = DVec3::new(x, 0.09, 0.09);
                Removal::new(Region::Sphere { centre, radius })
            };
            match step {
                10 => drop(simulation.remove_elements(body, &ball(0.1, 0.03)).unwrap()),
                18 => {
                    let keep = Removal { mass: MassPolicy::Keep, ..ball(0.15, 0.04) };
                    simulation.world_mut().spawn(RemovalRequest::new(0, keep));
                }
                24 => drop(simulation.set_material(body, soft(8e3, 0.3)).unwrap()),
                28 => {
                    let report = simulation.remove_elements(body, &ball(0.2, 0.11)).unwrap();
                    assert!(report.compacted, "{report:?}");
                }
                35 => {
                    let young: Vec<f64> = (0..mesh.tetrahedra.len() + mesh.hexahedra.len())
                        .map(|i| 6e3 + i as f64)
                        .collect();
                    let field =
                        MaterialField { young_modulus: Some(&young), ..soft(8e3, 0.3).into() };
                    simulation.set_material(body, field).unwrap();
                }
                45 => drop(simulation.remove_elements(body, &ball(0.05, 0.05)).unwrap()),
                _ => {}
            }
        };
        exact(integrator.name(), threads(1), &Scene { build: &build, act: &act });
    }
}

/// Elements of a membrane go, and the pressure on them with them.
/// Cuts between steps, one across another, and a removal of what they left.
#[test]
fn cuts() {
    let mesh = beam_mesh();
    let beam = BodyDescription::new("beam", &mesh, soft(2e5, 0.4));
    let beam = BodyDescription { spare: 400, ..beam };
    let (volume, model) = (VolumeRule::Clusters, Model::NeoHookean);
    let material = soft(2e5, 0.49);
    let axes = Some(rich(&mesh));
    let rich = BodyDescription { volume, model, material, axes, ..beam.clone() };
    let skin = mesh.surface_triangles();
    let membrane = Some(MembraneDescription::new(&skin, 1e-3, soft(1e6, 0.3)));
    let skinned = BodyDescription { membrane, ..beam.clone() };
    for (name, beam) in
        [("cuts", beam), ("cuts of clusters and axes", rich), ("cuts of skin", skinned)]
    {
        cuts_of(name, &mesh, &beam);
    }
}

/// The same of elements with Gauss points, what is left of which has points of its own.
#[test]
fn cuts_of_elements_with_gauss_points() {
    let bricks = box_hexahedra(DVec3::new(0.3, 0.1, 0.1), [5, 2, 2]).unwrap();
    let ten = box_tets(DVec3::new(0.3, 0.1, 0.1), [3, 1, 1]).unwrap().with_second_order();
    for (name, mesh) in [("cuts of hexahedra", &bricks), ("cuts of ten nodes", &ten)] {
        let beam = BodyDescription::new("beam", mesh, soft(2e5, 0.4));
        let beam = BodyDescription { spare: 800, ..beam };
        cuts_of(name, mesh, &beam);
        let rich = BodyDescription { axes: Some(rich(mesh)), ..beam };
        cuts_of(&format!("{name} with axes"), mesh, &rich);
    }
}

fn cuts_of(name: &str, mesh: &Mesh, beam: &BodyDescription) {
    let build = |options| {
        let mut simulation = Simulation::new(options).unwrap();
        let body = simulation.add_body(beam).unwrap();
        // rows after those of the body that is cut
        let other = mesh.transformed(1.0, DQuat::IDENTITY, DVec3::Y * 0.3);
        let other = simulation.add_body(&BodyDescription::new("other", &other, soft(2e5, 0.3)));
        clamp(&mut simulation, body, mesh, "x0");
        clamp(&mut simulation, other.unwrap(), mesh, "x0");
        if beam.axes.is_some() {
            simulation.set_activation(body, "c", 0.6).unwrap();
            simulation.set_activation(body, "d", 0.3).unwrap();
        }
        if mesh.hexahedra.is_empty() && mesh.middles.is_empty() {
            let mut side = mesh.surface_triangles();
            side.retain(|t| t.iter().all(|&v| mesh.points[v as usize].y < 1e-9));
            blow(&mut simulation, body, &side, 500.0, Curve::Constant);
        }
        simulation
    };
    let act = |simulation: &mut Simulation, step: u64| {
        let body = BodyHandle(0);
        let edge =
            |x: f64, y: f64, down: f64| [DVec3::new(x, y, 0.3), DVec3::new(x + 0.01, y, down)];
        let strip = match step {
            9 => [edge(0.14, -0.1, 0.05), edge(0.15, 0.3, 0.05)],
            40 => [edge(0.1, -0.1, -0.3), edge(0.25, 0.3, -0.3)],
            60 => {
                let region = Region::Sphere { centre: DVec3::new(0.1, 0.05, 0.05), radius: 0.04 };
                simulation.remove_elements(body, &Removal::new(region)).unwrap();
                return;
            }
            _ => return,
        };
        assert!(!simulation.cut(body, &strip).unwrap().copies.is_empty());
    };
    exact(name, threads(2), &Scene { build: &build, act: &act });
}

#[test]
fn removals_under_pressure() {
    let mesh = triangle_grid(DVec2::new(0.3, 0.1), [9, 3]).unwrap();
    let membrane = MembraneDescription::new(&mesh.triangles, 2e-3, soft(1e5, 0.3));
    let body = sheet(&mesh.points, membrane);
    let settings = solver!(Integrator::Auto, mass_damping = 1.0);
    let build = |options| {
        let mut simulation = beam(options, &settings, &body);
        blow(&mut simulation, BodyHandle(0), &mesh.triangles, 20.0, Curve::Constant);
        simulation
    };
    let act = |simulation: &mut Simulation, step: u64| {
        if step == 20 || step == 35 {
            let first = step as u32 - 10;
            let list = Region::Triangles((first..first + 10).collect());
            simulation.remove(BodyHandle(0), list);
        }
    };
    exact("sheet", threads(1), &Scene { build: &build, act: &act });
}

/// A body flattened and mirrored, in the middle of its recovery.
#[test]
fn recovery() {
    let mesh = beam_mesh();
    let flat: Vec<DVec3> = mesh.points.iter().map(|x| DVec3::new(0.0, 0.0, -1.1 * x.z)).collect();
    for integrator in [Integrator::Auto, Integrator::Safe] {
        let settings = solver!(integrator, mass_damping = 2.0);
        let body = BodyDescription::new("beam", &mesh, soft(1e4, 0.35));
        let build = |options| {
            let (mut simulation, body) = alone(options, &body);
            simulation.set_solver(settings.clone());
            simulation.displace(body, &flat);
            simulation
        };
        let act = |simulation: &mut Simulation, step| {
            assert!(step != 1 || simulation.report().recovering == 1);
        };
        exact(integrator.name(), threads(1), &Scene { build: &build, act: &act });
    }
}

const SLAB: DVec3 = DVec3::new(0.06, 0.06, 0.03);

fn slab(options: SimulationOptions, integrator: Integrator) -> Simulation {
    let mesh = box_tets(SLAB, [4, 4, 2]).unwrap();
    let (mut simulation, body) =
        alone(options, &BodyDescription::new("slab", &mesh, soft(1e4, 0.4)));
    clamp(&mut simulation, body, &mesh, "z0");
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_solver(solver!(integrator, mass_damping = 10.0, max_newton_iterations = 20));
    simulation.set_dt(if integrator.is_explicit() { 2e-3 } else { 0.01 });
    simulation
}

/// A ball that dips in and drags, by all ways of making steps.
fn drag(integrator: Integrator) {
    let build = |options| {
        let mut simulation = slab(options, integrator);
        let at = |x: f64, z: f64| ToolPose::from(DVec3::new(x, 0.031, z));
        let end = if integrator.is_explicit() { 0.12 } else { 0.6 };
        let path = [(0.0, at(0.02, 0.041)), (0.3, at(0.02, 0.036)), (1.0, at(0.04, 0.036))]
            .map(|(time, pose)| PathPoint { time: time * end, pose });
        let ball = Tool::new("ball", Shape::Sphere { radius: 0.01 }, path[0].pose.position);
        let motion = ToolMotion::Path(path.to_vec());
        let mut ball = ball.with_friction(0.3);
        ball.motion = motion;
        simulation.add_tool(ball).unwrap();
        simulation
    };
    let act = |simulation: &mut Simulation, step| {
        assert!(step < 30 || simulation.report().contact.points > 0, "nothing touches");
    };
    exact(integrator.name(), threads(1), &Scene { build: &build, act: &act });
    if integrator == Integrator::Auto {
        let single = SimulationOptions { precision: Precision::F32, ..threads(1) };
        exact("f32", single, &Scene { build: &build, act: &act });
    }
}

integrators! { drag:
    drag_auto: Auto;
    drag_safe: Safe;
    drag_newton: Newton;
    drag_bdf2: Bdf2;
    #[ignore = "slow"]
    drag_tr_bdf2: TrBdf2;
    drag_linearised_tr_bdf2: LinearisedTrBdf2;
    drag_midpoint: ImplicitMidpoint;
    drag_stormer_verlet: StormerVerlet;
}

/// A tool without penetration.
#[test]
#[ignore = "slow"]
fn exact_contact() {
    let build = |options| {
        let mut simulation = slab(options, Integrator::Newton);
        let above = DVec3::new(0.03, 0.03, 0.042);
        let mut ball = Tool::new("ball", Shape::Sphere { radius: 0.01 }, above).exactly();
        let way = Curve::ramp(0.0, 0.5);
        ball.motion = ToolMotion::Translate(DVec3::Z * -0.005, way);
        simulation.add_tool(ball).unwrap();
        simulation
    };
    exact("exact", threads(1), &Scene { build: &build, act: &nothing });
}

/// Jaws that close and grip, a tool that comes and goes, a fast one, a pull, and a hold that follows a hand.
#[test]
fn hands_and_tools() {
    let build = |options| {
        let mut simulation = slab(options, Integrator::Auto);
        let jaw = |side: f64| {
            let half = DVec3::new(0.004, 0.02, 0.02);
            let at = DVec3::new(0.0, side * 0.012, 0.0);
            let shape = Shape::Box { half, rounding: 0.003 };
            Part { at, jaw: 0.5 * side, ..Part::from(shape) }
        };
        let start = ToolPose { opening: 0.3, ..DVec3::new(-0.004, 0.03, 0.02).into() };
        let mut jaws = Tool::of_parts("jaws", vec![jaw(1.0), jaw(-1.0)], start);
        jaws.hinge = Hinge { point: DVec3::new(-0.02, 0.0, 0.0), axis: DVec3::Z };
        (jaws.grip, jaws.points, jaws.error_bar) = (true, Points::Faces(2), true);
        simulation.add_tool(jaws).unwrap();
        let mut fast =
            Tool::new("fast", Shape::Sphere { radius: 0.006 }, DVec3::new(0.045, 0.045, 0.1));
        fast.motion = ToolMotion::Translate(DVec3::Z * -0.066, Curve::ramp(0.25, 0.29));
        simulation.add_tool(fast).unwrap();
        let pick = simulation.pick(DVec3::new(0.045, 0.012, 0.5), DVec3::NEG_Z).unwrap();
        let pull = Pull::new("hand", pick.rows.to_vec(), 100.0, 0.5);
        simulation.add_pull(pull.with_weights(pick.weights.to_vec()));
        let corner = simulation.pick(DVec3::new(0.059, 0.059, 0.5), DVec3::NEG_Z).unwrap();
        simulation.add_constraint(Constraint::hold("grasped", corner.rows.to_vec()));
        simulation
    };
    let act = |simulation: &mut Simulation, step: u64| {
        let share = |from: f64, to: f64| ((step as f64 - from) / (to - from)).clamp(0.0, 1.0);
        let close = share(0.0, 15.0);
        let world = simulation.world_mut();
        for mut tool in world.query::<&mut Tool>().iter_mut(world) {
            if tool.name == "jaws" {
                let lift = DVec3::new(-0.004, 0.03, 0.02 + 0.004 * share(15.0, 40.0));
                let rotation = DQuat::from_rotation_x(0.2 * share(15.0, 40.0));
                tool.set_target(ToolPose {
                    position: lift,
                    rotation,
                    opening: 0.3 * (1.0 - close),
                })
                .unwrap();
            }
        }
        for mut pull in world.query::<&mut Pull>().iter_mut(world) {
            pull.target = (DVec3::new(0.002, 0.0, 0.006) * share(5.0, 30.0)).into();
        }
        for mut hold in world.query::<&mut Constraint>().iter_mut(world) {
            if hold.name == "grasped" {
                let pose = Pose {
                    translation: DVec3::Z * 0.003 * share(8.0, 50.0),
                    rotation: DQuat::from_rotation_z(0.3 * share(8.0, 50.0)),
                    centre: DVec3::new(0.059, 0.059, 0.03),
                };
                hold.set_target(pose).unwrap();
            }
        }
        if step == 22 {
            let at = DVec3::new(0.012, 0.048, 0.036);
            let new = Tool::new("new", Shape::Capsule { half_length: 0.01, radius: 0.01 }, at);
            simulation.add_tool(new.with_friction(0.5)).unwrap();
        }
        if step == 44 {
            let world = simulation.world_mut();
            let mut tools = world.query::<(bevy_ecs::entity::Entity, &Tool)>();
            let new = tools.iter(world).find(|(_, tool)| tool.name == "new").unwrap().0;
            assert!(simulation.remove_contact(new));
        }
    };
    exact("hands", threads(1), &Scene { build: &build, act: &act });
}

/// Two bodies with friction that fall on each other and on a table, and cut while they touch.
#[test]
fn contact_of_bodies() {
    let build = |options| two_blocks(options).0;
    let act = |simulation: &mut Simulation, step| {
        if step == 33 {
            let centre = DVec3::new(0.003, 0.002, 0.0401);
            let corner = Region::Sphere { centre, radius: 0.015 };
            let report = simulation.remove(BodyHandle(1), corner);
            assert!(!report.tetrahedra.is_empty());
        }
    };
    exact("bodies", threads(1), &Scene { build: &build, act: &act });
}

/// Other settings, integrators, gravity and step lengths on the way, and a state set by hand.
#[test]
fn whatever_changes() {
    let act = |simulation: &mut Simulation, step| match step {
        12 => simulation.set_dt(0.007),
        15 => simulation.integrate_by(Integrator::StormerVerlet),
        18 => simulation.set_dt(0.002),
        25 => simulation.integrate_by(Integrator::Newton),
        31 => simulation.set_gravity(DVec3::X),
        40 => simulation.integrate_by(Integrator::Auto),
        52 => disturb(simulation, BodyHandle(0), 1e-3, 5),
        _ => {}
    };
    exact("changes", threads(1), &Scene { build: &plain_beam, act: &act });
}

/// With the portable instruction set, as with every other.
#[test]
fn portable() {
    exact("portable", portable_set(), &Scene { build: &plain_beam, act: &nothing });
}

/// Goes back over steps, also those that failed, and does them again.
#[test]
fn rollback() {
    let mut simulation = plain_beam(threads(1));
    simulation.keep_history(8).unwrap();
    simulation.steps(12);
    let hash = simulation.state_hash();
    let failed = simulation.rollback(9).unwrap_err();
    assert_eq!(
        failed.to_string(),
        "9 steps back were asked for and 8 are kept: call `keep_history` with more"
    );
    simulation.set_gravity(DVec3::NAN);
    simulation.step().unwrap_err();
    simulation.rollback(5).unwrap();
    assert_eq!(simulation.world().resource::<StepClock>().step, 7);
    simulation.steps(5);
    assert_eq!(simulation.state_hash(), hash);
    simulation.rollback(8).unwrap();
    simulation.steps(8);
    assert_eq!(simulation.state_hash(), hash);
}

/// Constraints and tools that are gone come back; others go; those that stay keep their entities.
#[test]
fn entities_come_back() {
    let mut simulation = slab(threads(1), Integrator::Auto);
    let above = DVec3::new(0.03, 0.03, 0.039);
    let tool = |name: &str| Tool::new(name, Shape::Sphere { radius: 0.01 }, above);
    let stays = simulation.add_tool(tool("ball")).unwrap();
    let goes = simulation.add_tool(tool("goes")).unwrap();
    simulation.steps(3);
    let order = *simulation.world().get::<Order>(goes).unwrap();
    let snapshot = simulation.snapshot().unwrap();
    assert!(simulation.remove_contact(goes));
    let later = simulation.add_tool(tool("later")).unwrap();
    simulation.steps(3);
    let restored = simulation.restore(&snapshot).unwrap();
    assert_eq!(restored.spawned.len(), 1);
    let (of, entity) = restored.spawned[0];
    assert_eq!(
        (of, simulation.world().get::<Tool>(entity).unwrap().name.as_str()),
        (order, "goes")
    );
    assert!(simulation.world().get::<Tool>(stays).is_some());
    assert!(simulation.world().get_entity(later).is_err());
    assert!(simulation.tool_report(entity).unwrap().force.z > 0.0);
    // whoever holds the old handle goes on with it, also after the tool went and came once more
    assert_eq!((simulation.current(goes), simulation.current(stays)), (entity, stays));
    assert_eq!(simulation.tool_report(goes), simulation.tool_report(entity));
    simulation.move_tool(goes, above).unwrap();
    assert!(simulation.remove_contact(goes) && !simulation.remove_contact(goes));
    assert_eq!(simulation.move_tool(goes, above), Err(ToolError::NoTool(goes)));
    simulation.restore(&snapshot).unwrap();
    simulation.set_grip(goes, true).unwrap();
    simulation.set_grip(entity, false).unwrap();
    let now = simulation.find::<Tool>("goes").unwrap();
    assert!(now != goes && now != entity && simulation.current(entity) == now);
    assert_eq!(simulation.find::<Tool>("later"), None);
    assert_eq!(simulation.find_body("block"), None);
    assert_eq!(simulation.find_body("slab"), Some(BodyHandle(0)));
}

/// Everything that does not fit is told, by what it is, and changes nothing.
#[test]
fn what_does_not_fit_is_told() {
    let mesh = beam_mesh();
    let new = |young, precision| {
        let material = soft(young, 0.35);
        let (mut simulation, _) =
            alone(options(precision, 1), &BodyDescription::new("beam", &mesh, material));
        simulation.steps(2);
        simulation
    };
    let mut simulation = new(1e4, Precision::F64);
    let hash = simulation.state_hash();
    let mut told = |snapshot: &Snapshot| {
        let error = simulation.restore(snapshot).unwrap_err();
        assert_eq!(simulation.state_hash(), hash);
        error
    };
    assert_eq!(told(&new(2e4, Precision::F64).snapshot().unwrap()), SnapshotError::Scene);
    assert!(matches!(
        told(&new(1e4, Precision::F32).snapshot().unwrap()),
        SnapshotError::Precision { .. }
    ));
    let best = InstructionSet::best();
    if best != InstructionSet::Portable && simulation_set(&simulation) != InstructionSet::Portable {
        let own = BodyDescription::new("beam", &mesh, soft(1e4, 0.35));
        let (mut other, _) = alone(portable_set(), &own);
        let error = simulation.restore(&other.snapshot().unwrap()).unwrap_err();
        assert!(error.to_string().contains("instruction_set = \"portable\""), "{error}");
    }
    let mut cut = new(1e4, Precision::F64);
    let plain = cut.snapshot().unwrap();
    let first = |n| Removal::new(Region::Tetrahedra((0..n).collect()));
    cut.remove_elements(BodyHandle(0), &first(3)).unwrap();
    let mut otherwise = new(1e4, Precision::F64);
    otherwise.remove_elements(BodyHandle(0), &first(4)).unwrap();
    let error = otherwise.restore(&cut.snapshot().unwrap()).unwrap_err();
    assert!(error.to_string().contains("built anew"), "{error}");
    let read = Snapshot::from_bytes(&plain.to_bytes()).unwrap();
    assert!(matches!(cut.restore(&read).unwrap_err(), SnapshotError::Edits(_)));
    // while the one in memory knows what the body was
    cut.restore(&plain).unwrap();
    assert_eq!(cut.remaining_tetrahedra(BodyHandle(0)).len(), mesh.tetrahedra.len());

    let bytes = plain.to_bytes();
    let read = |bytes: &[u8]| Snapshot::from_bytes(bytes).unwrap_err();
    assert_eq!(read(b"no snapshot at all"), SnapshotError::NoSnapshot);
    assert!(matches!(read(&bytes[..bytes.len() - 1]), SnapshotError::Damaged { .. }));
    let mut newer = bytes.clone();
    newer[8] = 200;
    let text = read(&newer).to_string();
    assert!(
        text.contains("format 200") && text.contains("use the version that wrote it"),
        "{text}"
    );
}

/// A snapshot of earlier is read and goes on: what is stored has not changed without a new number of the format.
/// `SINEW_GOLDEN=write` stores it again.
#[test]
fn stored_snapshots_are_read() {
    let mesh = box_tets(DVec3::new(0.06, 0.06, 0.02), [1, 1, 1]).unwrap();
    let build = || alone(portable_set(), &BodyDescription::new("block", &mesh, soft(1e4, 0.35))).0;
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/stored.sinew-snap");
    if std::env::var("SINEW_GOLDEN").as_deref() == Ok("write") {
        let mut simulation = build();
        let ball = Shape::Sphere { radius: 0.01 };
        let ball = Tool::new("ball", ball, DVec3::new(0.03, 0.03, 0.029)).with_friction(0.3);
        simulation.add_tool(ball).unwrap();
        simulation.add_constraint(Constraint::hold("foot", [0, 1, 2].map(VertexRow).to_vec()));
        simulation.steps(3);
        simulation.remove(BodyHandle(0), Region::Tetrahedra(vec![1]));
        simulation.steps(2);
        std::fs::write(path, simulation.snapshot().unwrap().to_bytes()).unwrap();
    }
    let stored = Snapshot::from_bytes(&std::fs::read(path).unwrap())
        .expect("what is stored has changed: raise FORMAT, and store this snapshot again");
    let mut simulation = build();
    let restored = simulation.restore(&stored).unwrap();
    assert_eq!(restored.spawned.len(), 2);
    assert_eq!(simulation.remaining_tetrahedra(BodyHandle(0)).len(), mesh.tetrahedra.len() - 1);
    simulation.steps(1);
    assert_eq!(simulation.world().resource::<StepClock>().step, stored.header().step + 1);
}

fn simulation_set(simulation: &Simulation) -> InstructionSet {
    simulation.world().resource::<sinew::engine::workers::Workers>().instruction_set()
}

/// The sum at the end of a snapshot, so that damage gets past it.
fn sign(bytes: &mut [u8]) {
    let end = bytes.len() - 8;
    let sum = sinew::snapshot::checksum(&bytes[..end]);
    bytes[end..].copy_from_slice(&sum.to_le_bytes());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    /// Damaged bytes, even where the checksum fits, are an error or a state that steps can be made from, or refused by
    /// them; never a panic.
    #[test]
    fn damage_never_panics(places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4), cut in any::<prop::sample::Index>(), cuts in 0..4) {
        let mut simulation = slab(threads(1), Integrator::Auto);
        let ball = Tool::new("ball", Shape::Sphere { radius: 0.01 }, DVec3::new(0.03, 0.03, 0.038));
        simulation.add_tool(ball.with_friction(0.3)).unwrap();
        simulation.steps(3);
        let first = Removal::new(Region::Tetrahedra(vec![0, 1]));
        simulation.remove_elements(BodyHandle(0), &first).unwrap();
        simulation.steps(1);
        let mut bytes = simulation.snapshot().unwrap().to_bytes();
        for (place, byte) in places {
            let at = place.index(bytes.len() - 20) + 12;
            bytes[at] ^= byte;
        }
        if cuts == 0 {
            let at = cut.index(bytes.len() - 20) + 12;
            bytes.drain(at..bytes.len() - 8);
        }
        sign(&mut bytes);
        if let Ok(snapshot) = Snapshot::from_bytes(&bytes) {
            let hash = simulation.state_hash();
            match simulation.restore(&snapshot) {
                Ok(_) => drop((simulation.step(), simulation.step())),
                Err(_) => prop_assert_eq!(simulation.state_hash(), hash),
            }
        }
    }

    /// Any bytes at all.
    #[test]
    fn noise_never_panics(noise in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut bytes = b"SinewSnp\x01\0\0\0".to_vec();
        bytes.extend(noise);
        bytes.extend([0; 8]);
        sign(&mut bytes);
        prop_assert!(Snapshot::from_bytes(&bytes).is_err());
    }

    /// A random sequence of steps, snapshots, restores, removals and materials: what follows a restore is what
    /// followed the snapshot.
    #[test]
    fn random_sequences(what in prop::collection::vec((0..6_u32, any::<u16>()), 4..20)) {
        let mut simulation = plain_beam(threads(1));
        let handle = BodyHandle(0);
        let act = |simulation: &mut Simulation, (kind, number): (u32, u16)| match kind {
            0 => drop(simulation.set_material(handle, soft(5e3 + f64::from(number), 0.3)).unwrap()),
            1 => {
                let left = simulation.remaining_tetrahedra(handle);
                let list = pick(left.clone(), (left.len() / 8).min(6), number.into());
                let list = Removal::new(Region::Tetrahedra(list));
                simulation.remove_elements(handle, &list).unwrap();
            }
            _ => simulation.steps(1 + usize::from(number % 3)),
        };
        let mut kept: Vec<(Snapshot, Vec<(u32, u16)>)> = Vec::new();
        for (kind, number) in what {
            match kind {
                2 => kept.push((simulation.snapshot().unwrap(), Vec::new())),
                3 if !kept.is_empty() => {
                    let (snapshot, since) = &kept[usize::from(number) % kept.len()];
                    let hash = simulation.state_hash();
                    simulation.restore(snapshot).unwrap();
                    since.iter().for_each(|what| act(&mut simulation, *what));
                    prop_assert_eq!(simulation.state_hash(), hash);
                    let mut new = plain_beam(threads(1));
                    new.restore(&Snapshot::from_bytes(&snapshot.to_bytes()).unwrap()).unwrap();
                    since.iter().for_each(|what| act(&mut new, *what));
                    prop_assert_eq!(new.state_hash(), hash);
                }
                _ => {
                    act(&mut simulation, (kind, number));
                    kept.iter_mut().for_each(|(_, since)| since.push((kind, number)));
                }
            }
        }
    }
}

/// Right after a compaction nothing of the last step holds but what solves search along.
#[test]
fn a_snapshot_after_a_compaction_goes_on() {
    let handle = BodyHandle(0);
    let mut simulation = plain_beam(threads(1));
    simulation.steps(1);
    let mut compactions = 0;
    while compactions == 0 {
        let left = simulation.remaining_tetrahedra(handle);
        let list = Removal::new(Region::Tetrahedra(pick(left, 6, 0)));
        let report = simulation.remove_elements(handle, &list).unwrap();
        compactions += usize::from(report.compacted);
    }
    let snapshot = simulation.snapshot().unwrap();
    let follow = |simulation: &mut Simulation| {
        [(); 4].map(|()| {
            simulation.steps(1);
            (simulation.state_hash(), simulation.report().cg_iterations)
        })
    };
    let followed = follow(&mut simulation);
    simulation.restore(&snapshot).unwrap();
    assert_eq!(follow(&mut simulation), followed);
    let mut new = plain_beam(threads(1));
    new.restore(&Snapshot::from_bytes(&snapshot.to_bytes()).unwrap()).unwrap();
    assert_eq!(follow(&mut new), followed);
}
