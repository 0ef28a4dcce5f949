//! The ECS side: schedules without ambiguities, scenes that pay only for what they use, one table
//! per kind of element, and typed errors where somebody breaks that.

use crate::common::*;
use bevy_ecs::prelude::*;
use bevy_ecs::query::ArchetypeFilter;
use bevy_ecs::schedule::{ScheduleBuildError, ScheduleBuildWarning, ScheduleLabel};
use glam::DVec3;
use sinew::engine::element::{EdgeVertices, TetrahedronEdges, TetrahedronVertices};
use sinew::engine::law::{ElasticEnergy, LawBuffers};
use sinew::engine::load::apply_constraints;
use sinew::engine::matrix::Tangent;
use sinew::engine::mesh::Mesh;
use sinew::engine::schedule::{
    ActiveLaws, Executor, ForceSchedule, ForceSystems, StepSchedule, StepSystems,
};
use sinew::engine::step::{StepError, install_engine, run_step};
use sinew::engine::vertex::{Displacement, ElasticForce, RestPosition};
use sinew::models::body::Evaluation;
use sinew::models::laws::LAWS;
use sinew::models::laws::pooled::TriangleVertices;
use sinew::prelude::*;

#[path = "common/bodies.rs"]
pub mod bodies;
use bodies::Meshes;

type Kind = (Model, Evaluation);
const FUSED: Kind = (Model::CompressibleStVK, Evaluation::Fused);
const POOLED: Kind = (Model::CompressibleStVK, Evaluation::Pooled);
const POOLED_STVK: Kind = (Model::StVK, Evaluation::Pooled);

fn small() -> Mesh {
    jittered_box([0.2, 0.1, 0.1], [3, 2, 2])
}

/// One body per kind, side by side.
fn scene(kinds: &[Kind], executor: Executor) -> Simulation {
    let options = SimulationOptions { executor, ..Default::default() };
    let mut simulation = Simulation::new(options).unwrap();
    for (i, &(model, evaluation)) in kinds.iter().enumerate() {
        let mesh = small();
        let points: Vec<DVec3> = mesh.points.iter().map(|x| *x + DVec3::Y * i as f64).collect();
        simulation
            .add_body(&BodyDescription {
                model,
                evaluation,
                ..BodyDescription::from_parts(
                    &format!("body {i}"),
                    &points,
                    &mesh.tetrahedra,
                    soft(1e4, 0.4),
                )
            })
            .unwrap();
    }
    simulation
}

fn build(world: &mut World, label: impl ScheduleLabel) -> Result<(), ScheduleBuildError> {
    world.schedule_scope(label, |world, schedule| schedule.initialize(world).map(|_| ()))
}

fn systems(simulation: &mut Simulation, label: impl ScheduleLabel + Clone) -> usize {
    let world = simulation.world_mut();
    build(world, label.clone()).unwrap();
    world.resource::<Schedules>().get(label).unwrap().systems_len()
}

fn laws(simulation: &Simulation) -> Vec<&'static str> {
    simulation.world().get_resource::<ActiveLaws>().map(|l| l.0.clone()).unwrap_or_default()
}

fn is_ambiguity(result: Result<(), ScheduleBuildError>) -> bool {
    let expected =
        |e: &_| matches!(e, ScheduleBuildError::Elevated(ScheduleBuildWarning::Ambiguity(_)));
    result.as_ref().is_err_and(expected)
}

#[test]
fn no_scene_has_an_ambiguity() {
    let scenes: [&[Kind]; 7] = [
        &[],
        &[FUSED],
        &[POOLED],
        &[POOLED_STVK],
        &[FUSED, FUSED],
        &[POOLED_STVK, POOLED],
        &[POOLED, FUSED, POOLED_STVK, FUSED],
    ];
    for kinds in scenes {
        for executor in [Executor::SingleThreaded, Executor::MultiThreaded] {
            let mut simulation = scene(kinds, executor);
            build(simulation.world_mut(), StepSchedule).unwrap_or_else(|e| panic!("{kinds:?} {e}"));
            build(simulation.world_mut(), ForceSchedule)
                .unwrap_or_else(|e| panic!("{kinds:?} {e}"));
            simulation.step().unwrap();
        }
    }
}

/// A world of these bodies that has made one step, with the laws in the order in which they were evaluated.
fn steps_once(bodies: &[&BodyDescription], what: &str) -> Vec<&'static str> {
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    for (i, &body) in bodies.iter().enumerate() {
        let name = &format!("body {i}");
        simulation.add_body(&BodyDescription { name, ..body.clone() }).unwrap();
    }
    let faces = |(i, body): (usize, &&BodyDescription)| {
        let quads = body.membrane.iter().flat_map(|m| m.quads.iter().map(|q| [q[0], q[1], q[2]]));
        let membrane = body.membrane.iter().flat_map(|m| m.triangles.iter().copied()).chain(quads);
        let solid = body.tetrahedra.iter().map(|t| [t[0], t[2], t[1]]);
        let bricks = body.hexahedra.iter().map(|h| [h[0], h[2], h[1]]);
        let face: Vec<_> = membrane.chain(solid).chain(bricks).take(1).collect();
        (BodyHandle(i), face)
    };
    for (body, face) in bodies.iter().enumerate().map(faces) {
        blow(&mut simulation, body, &face, 1.0, Curve::Constant);
    }
    let world = simulation.world_mut();
    build(world, ForceSchedule).unwrap_or_else(|e| panic!("{what}: {e}"));
    build(world, StepSchedule).unwrap_or_else(|e| panic!("{what}: {e}"));
    simulation.set_dt(1e-3);
    simulation.step().unwrap_or_else(|e| panic!("{what}: {e}"));
    let told = &simulation.world().resource::<ElasticEnergy>().by_law;
    told.iter().map(|(name, _)| *name).collect()
}

fn described(body: &BodyDescription) -> String {
    let membrane = body.membrane.map(|m| (m.model, m.evaluation, m.quads.is_empty()));
    let kind = (body.middles.is_empty(), body.hexahedra.is_empty());
    format!("{:?} {:?} {:?} {kind:?} {membrane:?}", body.model, body.evaluation, body.volume)
}

/// Any two rows of the table of laws, and any three kinds of element, fit into one world; energies are told in the order of
/// the table, whatever the order in which bodies came.
#[test]
fn any_two_laws_and_any_three_kinds_of_element_go_together() {
    let meshes = Meshes::new([1, 1, 1]);
    let bodies = meshes.bodies();
    let place = |name: &&str| LAWS.iter().position(|row| row.info.name == *name).unwrap();
    let check = |bodies: &[&BodyDescription]| {
        let what: Vec<_> = bodies.iter().map(|body| described(body)).collect();
        let told = steps_once(bodies, &what.join(", "));
        assert!(told.iter().map(place).is_sorted(), "{what:?}: {told:?}");
    };
    for (i, first) in bodies.iter().enumerate() {
        for second in &bodies[i..] {
            check(&[second, first]);
        }
    }
    // one law and one rule of each kind; then all that there is
    let kind = |body: &BodyDescription| {
        let membrane = body.membrane.map(|m| m.quads.is_empty());
        (membrane, body.middles.is_empty(), body.hexahedra.is_empty(), body.volume)
    };
    let mut kinds: Vec<&BodyDescription> = Vec::new();
    for body in &bodies {
        if !kinds.iter().any(|known| kind(known) == kind(body)) {
            kinds.push(body);
        }
    }
    assert_eq!(kinds.len(), 8, "three solids by elements and by means, two membranes");
    for (i, first) in kinds.iter().enumerate() {
        for (j, second) in kinds.iter().enumerate().skip(i + 1) {
            for third in &kinds[j + 1..] {
                check(&[third, first, second]);
            }
        }
    }
    check(&bodies.iter().collect::<Vec<_>>());
}

fn wind(mut vertices: Query<&mut Displacement<f64>>) {
    for mut u in &mut vertices {
        u.0[0] += 1e-6;
    }
}

fn own_force(mut vertices: Query<&mut ElasticForce<f64>>) {
    for mut f in &mut vertices {
        f.0[0] += 1.0;
    }
}

fn own_tangent(mut tangent: ResMut<Tangent<f64>>) {
    tangent.clamped += 1;
}

#[test]
fn a_conflicting_user_system_is_refused() {
    let add = |system: fn(&mut Schedules)| {
        let mut simulation = scene(&[FUSED], Executor::SingleThreaded);
        system(&mut simulation.world_mut().resource_mut::<Schedules>());
        simulation
    };
    // it writes what the systems of the same stage read, without an order
    let mut simulation = add(|s| {
        s.entry(StepSchedule).add_systems(wind.in_set(StepSystems::Prepare));
    });
    assert!(is_ambiguity(build(simulation.world_mut(), StepSchedule)));
    let mut simulation = add(|s| {
        s.entry(StepSchedule).add_systems(wind);
    });
    assert!(is_ambiguity(build(simulation.world_mut(), StepSchedule)));
    for set in [ForceSystems::Gather, ForceSystems::Evaluate] {
        let mut simulation = scene(&[FUSED], Executor::SingleThreaded);
        let gather = set == ForceSystems::Gather;
        simulation
            .world_mut()
            .resource_mut::<Schedules>()
            .entry(ForceSchedule)
            .add_systems((own_force.in_set(set.clone()), own_tangent.in_set(set)));
        // the laws do not touch the totals: only the gather does
        let result = build(simulation.world_mut(), ForceSchedule);
        assert_eq!(is_ambiguity(result), gather);
    }
    // with an order it is welcome, and does what it says
    let mut simulation = add(|s| {
        s.entry(StepSchedule)
            .add_systems(wind.in_set(StepSystems::Prepare).before(apply_constraints::<f64>));
    });
    build(simulation.world_mut(), StepSchedule).unwrap();
    simulation.set_gravity(DVec3::ZERO);
    simulation.step().unwrap();
    let u = simulation.displacements(BodyHandle(0));
    // a rigid shift before the step: neither force nor velocity follows
    assert!(u.iter().all(|u| u.distance(DVec3::X * 1e-6) < 1e-18), "{u:?}");
}

/// The frame of the force schedule is one system, which adds the laws up.
const FRAME: usize = 1;
/// Evaluation of one law.
const LAW: usize = 1;

#[test]
fn a_scene_pays_only_for_what_it_uses() {
    let executor = Executor::SingleThreaded;
    let empty = &mut scene(&[], executor);
    assert!(laws(empty).is_empty());
    assert_eq!(systems(empty, ForceSchedule), FRAME);
    let step_systems = systems(empty, StepSchedule);

    let fused = &mut scene(&[FUSED], executor);
    assert_eq!(laws(fused), ["fused St Venant-Kirchhoff"]);
    assert_eq!(systems(fused, ForceSchedule), FRAME + LAW);
    assert!(fused.world().resource::<LawBuffers<f64>>().id("tensile springs").is_none());
    assert_eq!(count::<EdgeVertices, ()>(fused), 0);
    assert_eq!(count::<TriangleVertices, ()>(fused), 0);
    assert_eq!(count::<TetrahedronVertices, ()>(fused), small().tetrahedra.len());

    let springs = [
        "edge changes",
        "tensile springs",
        "angular springs",
        "volumetric springs",
        "spring forces",
        "projected tangent of springs",
    ];
    // edge changes and collected tensions come as two systems without a buffer
    let spring_systems = FRAME + 2 + 5 * LAW;
    let stvk = &mut scene(&[POOLED_STVK], executor);
    assert_eq!(laws(stvk), springs);
    assert_eq!(systems(stvk, ForceSchedule), spring_systems);

    let pooled = &mut scene(&[POOLED], executor);
    assert_eq!(laws(pooled)[..6], springs);
    assert_eq!(laws(pooled)[6..], ["compression term"]);
    assert_eq!(systems(pooled, ForceSchedule), spring_systems + LAW);

    // more bodies of the same kinds add entities, not systems
    let many = &mut scene(&[POOLED, FUSED, POOLED, FUSED, POOLED_STVK], executor);
    assert_eq!(systems(many, ForceSchedule), spring_systems + 2 * LAW);
    // and a step has the same systems whatever the scene
    // but for the one that carries out removals once there are elements, and the one that looks after models that soften in
    // compression
    assert_eq!(systems(many, StepSchedule), step_systems + 2);
}

fn count<C: Component, F: ArchetypeFilter + 'static>(simulation: &mut Simulation) -> usize {
    let world = simulation.world_mut();
    world.query_filtered::<&C, F>().iter(world).count()
}

/// Lengths of the slices in which the component is handed out.
fn slices<C: Component, F: ArchetypeFilter + 'static>(simulation: &mut Simulation) -> Vec<usize> {
    let world = simulation.world_mut();
    let mut query = world.query_filtered::<&C, F>();
    query.contiguous_iter(world).unwrap().map(<[C]>::len).collect()
}

#[test]
fn one_table_per_kind_of_element() {
    let mut simulation = scene(&[FUSED, POOLED, FUSED, POOLED_STVK], Executor::SingleThreaded);
    // what users spawn between bodies does not matter
    simulation.world_mut().spawn_batch((0..100).map(MeshVertex));
    simulation.add_constraint(Constraint::hold("nothing", Vec::new()));
    let s = &mut simulation;
    let tetrahedra = small().tetrahedra.len();
    let vertices = small().points.len();
    assert_eq!(slices::<Displacement<f64>, ()>(s), [4 * vertices]);
    assert_eq!(slices::<TetrahedronVertices, Without<TetrahedronEdges>>(s), [2 * tetrahedra]);
    assert_eq!(slices::<TetrahedronVertices, With<TetrahedronEdges>>(s), [2 * tetrahedra]);
    assert_eq!(slices::<EdgeVertices, ()>(s).len(), 1);
    assert_eq!(slices::<TriangleVertices, ()>(s).len(), 1);
    // rows are the order in which the topology counts
    let rows = s.topology().bodies[2].clone();
    let points = small().points;
    let world = s.world_mut();
    let mut query = world.query::<&RestPosition>();
    let rest = query.contiguous_iter(world).unwrap().next().unwrap();
    for (vertex, row) in rows.vertices_and_rows() {
        let expected = points[vertex.index()] + DVec3::Y * 2.0;
        assert_eq!(rest[row.index()].0, expected);
    }
    simulation.step().unwrap();
}

#[derive(Component)]
struct Label;

fn entity_of_row(simulation: &mut Simulation, row: usize) -> Entity {
    let world = simulation.world_mut();
    world.query_filtered::<Entity, With<Displacement<f64>>>().iter(world).nth(row).unwrap()
}

#[test]
fn a_changed_layout_is_an_error_not_a_panic() {
    for executor in [Executor::SingleThreaded, Executor::MultiThreaded] {
        for row in [0, 7, 35] {
            let mut simulation = scene(&[FUSED], executor);
            simulation.step().unwrap();
            let n = simulation.topology().vertex_count();
            let entity = entity_of_row(&mut simulation, row);
            simulation.world_mut().despawn(entity);
            for _ in 0..2 {
                let error = simulation.step().unwrap_err();
                let expected = StepError::LayoutChanged { expected: n, found: n - 1 };
                assert_eq!(error, expected);
                assert!(error.to_string().contains("on entities of your own"));
            }

            let mut simulation = scene(&[POOLED], executor);
            let entity = entity_of_row(&mut simulation, row);
            simulation.world_mut().entity_mut(entity).insert(Label);
            for _ in 0..2 {
                let error = simulation.step().unwrap_err();
                assert!(
                    matches!(error, StepError::LayoutChanged { expected, .. } if expected == n)
                );
            }
            // taking the component off again restores the table but not the order
            simulation.world_mut().entity_mut(entity).remove::<Label>();
            let last = n - 1;
            if row != last {
                let error = simulation.step().unwrap_err();
                assert!(matches!(error, StepError::LayoutChanged { .. }), "{error}");
            }
        }
    }
}

/// Elements may not change table or disappear either.
#[test]
fn changed_elements_are_an_error_not_a_panic() {
    fn first<C: Component>(simulation: &mut Simulation) -> Entity {
        let world = simulation.world_mut();
        world.query_filtered::<Entity, With<C>>().iter(world).next().unwrap()
    }
    type Find = fn(&mut Simulation) -> Entity;
    let cases: [(Kind, Find); 4] = [
        (FUSED, first::<TetrahedronVertices>),
        (POOLED, first::<TetrahedronVertices>),
        (POOLED, first::<EdgeVertices>),
        (POOLED, first::<TriangleVertices>),
    ];
    for (kind, find) in cases {
        for despawn in [true, false] {
            let mut simulation = scene(&[kind], Executor::SingleThreaded);
            let entity = find(&mut simulation);
            if despawn {
                simulation.world_mut().despawn(entity);
            } else {
                simulation.world_mut().entity_mut(entity).insert(Label);
            }
            let error = simulation.step().unwrap_err();
            assert!(matches!(error, StepError::LayoutChanged { .. }), "{error}");
        }
    }
}

#[test]
fn what_is_missing_or_wrong_is_named() {
    let mut world = World::new();
    install_engine::<f64>(&mut world, Executor::SingleThreaded);
    let error = run_step(&mut world).unwrap_err();
    assert_eq!(error, StepError::NoIntegrator);
    assert!(error.to_string().contains("add one of the solver plugins"));

    // an empty world steps through time
    let mut simulation = scene(&[], Executor::SingleThreaded);
    simulation.set_dt(0.5);
    simulation.step().unwrap();
    assert_eq!(simulation.time(), 0.5);

    let mut simulation = scene(&[FUSED], Executor::SingleThreaded);
    for dt in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        simulation.set_dt(dt);
        assert!(matches!(simulation.step(), Err(StepError::InvalidStep { .. })), "{dt}");
    }
    simulation.set_dt(0.01);
    simulation.set_gravity(DVec3::new(0.0, f64::NAN, 0.0));
    assert!(matches!(simulation.step(), Err(StepError::InvalidGravity { .. })));
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_solver(SolverSettings { linear_tolerance: 2.0, ..Default::default() });
    assert!(matches!(simulation.step(), Err(StepError::InvalidSetting(_))));
    assert_eq!(simulation.time(), 0.0, "time passes only with a step");
    simulation.set_solver(SolverSettings::default());
    simulation.step().unwrap();
    assert_eq!(simulation.time(), 0.01);
}

/// Systems of one stage really run at the same time under the executor that promises it: two of them wait for each
/// other, which they can only where neither has to end before the other begins.
#[test]
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn independent_systems_run_at_the_same_time() {
    use std::sync::mpsc::{Receiver, Sender, channel};
    use std::sync::{Arc, Mutex};
    use std::time::Duration;
    if std::thread::available_parallelism().map_or(1, usize::from) < 2 {
        eprintln!("skipped: one core only");
        return;
    }
    let met = |executor| {
        let mut simulation = scene(&[FUSED, POOLED], executor);
        let counted = Arc::new(Mutex::new(0));
        let (to_second, from_first) = channel();
        let (to_first, from_second) = channel();
        let wait = |send: Sender<()>, receive: Receiver<()>, counted: Arc<Mutex<u32>>| {
            let (send, receive) = (Mutex::new(send), Mutex::new(receive));
            move || {
                let _ = send.lock().unwrap().send(());
                let patience = Duration::from_millis(200);
                let met = receive.lock().unwrap().recv_timeout(patience).is_ok();
                *counted.lock().unwrap() += u32::from(met);
            }
        };
        let first = wait(to_second, from_second, Arc::clone(&counted));
        let second = wait(to_first, from_first, Arc::clone(&counted));
        let mut schedules = simulation.world_mut().resource_mut::<Schedules>();
        schedules.entry(ForceSchedule).add_systems((
            first.in_set(ForceSystems::Evaluate),
            second.in_set(ForceSystems::Evaluate),
        ));
        simulation.evaluate();
        *counted.lock().unwrap()
    };
    assert_eq!(met(Executor::MultiThreaded), 2);
    // one after another, only the later one finds that the other was there
    assert_eq!(met(Executor::SingleThreaded), 1);
}
