//! Bodies: from assets, what stops them, their state and their end.

use crate::common::*;
use bevy_app::{App, FixedPostUpdate};
use bevy_asset::io::memory::Dir;
use bevy_asset::{AssetServer, Assets, Handle};
use bevy_ecs::prelude::*;
use bevy_math::{Quat, Vec3};
use bevy_time::{Fixed, Time, TimeUpdateStrategy, Virtual};
use bevy_transform::components::Transform;
use sinew::engine::mesh::{FindingCode, Mesh};
use sinew::engine::report::StepReport;
use sinew::engine::schedule::SimulationSystems;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::{Displacement, RestPosition};
use sinew::models::body::BodyError;
use sinew::models::cutting::held::material_point;
use sinew::models::cutting::tear::check_tear;
use sinew::models::resection::{Region, Removal, RemovalRequest};
use sinew::prelude::*;
use sinew::snapshot::{restore_snapshot, take_snapshot};
use sinew::touch::thread::ThreadReport;
use sinew::touch::tool::{ToolMotion, ToolReport};
use sinew_bevy::*;
use std::path::Path;
use std::time::Duration;

const TETRAHEDRON: &str = "# vtk DataFile Version 3.0\none\nASCII\nDATASET UNSTRUCTURED_GRID\n\
    POINTS 4 double\n0 0 0\n10 0 0\n0 10 0\n0 0 10\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n";

/// Waits for the loader, which works on threads of its own.
fn until(app: &mut bevy_app::App, done: impl Fn(&bevy_app::App) -> bool) {
    for _ in 0..2000 {
        app.update();
        if done(app) {
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("nothing came");
}

#[test]
fn bodies_come_from_files_and_their_errors_are_told() {
    let files = Dir::default();
    files.insert_asset_text(Path::new("one.vtk"), TETRAHEDRON);
    files.insert_asset_text(Path::new("bad.vtk"), &TETRAHEDRON.replace("10 0 0", "10 zero 0"));
    let mut app = bare(files);
    app.add_plugins(SinewBevyPlugins { engine: engine() });
    app.insert_resource(TimeUpdateStrategy::FixedTimesteps(1));
    let load = |app: &mut bevy_app::App, file: &'static str| {
        let mesh: Handle<SoftMesh> = app.world().resource::<AssetServer>().load(file);
        // in millimetres
        let place = Transform::from_xyz(0.5, 0.0, 0.0).with_scale(Vec3::splat(1e-3));
        app.world_mut().spawn((SinewBody::new(mesh, material()), place, Name::new(file))).id()
    };
    let good = load(&mut app, "one.vtk");
    let bad = load(&mut app, "bad.vtk");
    let missing = load(&mut app, "none.vtk");
    until(&mut app, |app| {
        let has = |entity| app.world().get::<SinewBodyError>(entity).is_some();
        app.world().get::<SinewBodyIndex>(good).is_some() && has(bad) && has(missing)
    });
    let world = app.world_mut();
    let mut rest: Vec<_> = world.query::<&RestPosition>().iter(world).map(|r| r.0).collect();
    rest.sort_by(|a, b| b.x.total_cmp(&a.x));
    assert!(rest[0].distance(DVec3::new(0.51, 0.0, 0.0)) < 1e-9, "{rest:?}");
    let text = |entity| world.get::<SinewBodyError>(entity).unwrap().0.to_string();
    assert!(text(bad).contains("bad.vtk, line 7: found `zero`"), "{}", text(bad));
    assert!(text(missing).starts_with("body `none.vtk`: "), "{}", text(missing));
    assert!(text(missing).contains("none.vtk"), "{}", text(missing));
    assert_eq!(world.resource::<Topology>().bodies[0].name, "one.vtk");
}

#[test]
fn meshes_are_checked() {
    let error = SoftMesh::new(Mesh::default()).unwrap_err();
    let SoftMeshError::Check(error) = error else { panic!("{error}") };
    assert!(error.report.errors().any(|finding| finding.code == FindingCode::NoCells));
    let error = SoftMesh::new(mesh()).unwrap().group("nose").unwrap_err();
    assert!(error.to_string().contains("has no group `nose`; it has `x0`"), "{error}");
    let mut turned = mesh();
    turned.tetrahedra[3].swap(0, 1);
    let turned = SoftMesh::new(turned).unwrap();
    assert!(turned.mesh().signed_volume(turned.mesh().tetrahedra[3]).unwrap() > 0.0);
}

#[test]
fn what_cannot_be_built_is_told_once_and_tried_again() {
    let mut app = app();
    let mesh = asset(&mut app);
    let soft = YoungPoisson { young_modulus: -1.0, ..material() };
    let mut spawn = |body: SinewBody, place| app.world_mut().spawn((body, place)).id();
    let wrong = spawn(SinewBody::new(mesh.clone(), soft), Transform::default());
    let flat = Transform::from_scale(Vec3::new(1.0, 1.0, 0.0));
    let flat = spawn(SinewBody::new(mesh.clone(), material()), flat);
    let mirrored = Transform::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    let mirrored = spawn(SinewBody::new(mesh.clone(), material()), mirrored);
    let nowhere = spawn(SinewBody::new(mesh, material()), Transform::from_xyz(f32::NAN, 0.0, 0.0));
    let mut told = Vec::new();
    for _ in 0..5 {
        app.update();
        told.extend(messages::<BodyFailed>(&mut app));
    }
    assert_eq!(told.iter().map(|t| t.entity).collect::<Vec<_>>(), [wrong, flat, mirrored, nowhere]);
    assert!(matches!(told[0].error, BuildError::Body(BodyError::Material { .. })));
    for told in &told[1..] {
        assert!(matches!(told.error, BuildError::Transform { .. }), "{}", told.error);
    }
    assert_eq!(app.world().resource::<Topology>().bodies.len(), 0);
    app.world_mut().get_mut::<SinewBody>(wrong).unwrap().material = material();
    app.world_mut().entity_mut(flat).insert(Transform::default()).remove::<SinewBodyError>();
    app.update();
    let built: Vec<_> = messages::<BodyBuilt>(&mut app).iter().map(|b| b.entity).collect();
    assert_eq!((built.len(), messages::<BodyFailed>(&mut app).len()), (2, 0));
    for entity in [wrong, flat] {
        assert!(built.contains(&entity) && app.world().get::<SinewBodyError>(entity).is_none());
    }
}

#[test]
fn the_transform_says_where_a_body_rests() {
    let place = Transform {
        translation: Vec3::new(0.3, -0.2, 0.1),
        rotation: Quat::from_rotation_y(0.7),
        scale: Vec3::new(2.0, 1.0, 0.5),
    };
    let parent = Transform::from_xyz(0.0, 1.0, 0.0).with_rotation(Quat::from_rotation_x(-0.4));
    let mut app = app();
    let table = app.world_mut().spawn(parent).id();
    let body = held(&mut app, place);
    app.world_mut().entity_mut(body).insert(ChildOf(table));
    app.update();
    app.update();
    let topology = app.world().resource::<Topology>().bodies[0].clone();
    let world = app.world_mut();
    let rest: Vec<_> = world.query::<&RestPosition>().iter(world).map(|r| r.0).collect();
    for (row, vertex) in rest.iter().zip(&topology.vertex_order) {
        let point = mesh().points[vertex.index()].as_vec3();
        let expected = parent.transform_point(place.transform_point(point)).as_dvec3();
        assert!(row.distance(expected) < 1e-6, "{row} {expected}");
    }
}

#[test]
fn state_is_told_with_change_detection() {
    #[derive(Resource, Default)]
    struct Changes(usize);
    let mut app = app();
    app.init_resource::<Changes>();
    let count = |changed: Query<(), Changed<SinewBodyState>>, mut changes: ResMut<Changes>| {
        changes.0 += changed.iter().count();
    };
    app.add_systems(bevy_app::PostUpdate, count);
    // two bodies: energies are told for each
    let body = held(&mut app, Transform::default());
    held(&mut app, Transform::from_xyz(0.0, 1.0, 0.0));
    for _ in 0..11 {
        app.update();
    }
    // new with the step of frame 2, since the first frame takes no time
    let changes = std::mem::take(&mut app.world_mut().resource_mut::<Changes>().0);
    assert_eq!(changes, 2 * 10);
    let world = app.world_mut();
    let states: Vec<_> = world.query::<&SinewBodyState>().iter(world).cloned().collect();
    let sum = |of: fn(&SinewBodyState) -> f64| states.iter().map(of).sum::<f64>();
    let report = world.resource::<StepReport>();
    let near = |a: f64, b: f64| (a - b).abs() < 1e-9 * b && b > 0.0;
    assert!(near(sum(|s| s.kinetic_energy), report.kinetic_energy), "{states:?} {report:?}");
    assert!(near(sum(|s| s.elastic_energy), report.elastic_energy), "{states:?} {report:?}");
    let state = world.get::<SinewBodyState>(body).unwrap();
    assert_eq!((state.step, state.inverted, state.recovering), (10, 0, false));
    assert!(state.smallest_ratio > 0.9 && state.smallest_ratio < 1.0);
    // no step, no change
    app.world_mut().resource_mut::<Time<Virtual>>().pause();
    (0..3).for_each(|_| app.update());
    app.world_mut().resource_mut::<Time<Virtual>>().unpause();
    app.world_mut().resource_mut::<StepClock>().dt = -1.0;
    let failures = (0..3).map(|_| {
        app.update();
        messages::<StepFailed>(&mut app).len()
    });
    assert_eq!(failures.sum::<usize>(), 1);
    assert!(app.world().resource::<StepOutcome>().0.is_some());
    assert_eq!(app.world().resource::<Changes>().0, 0);
}

#[test]
fn a_new_material_acts_as_in_a_simulation() {
    let mut app = app();
    let body = held(&mut app, Transform::default());
    (0..11).for_each(|_| app.update());
    let stiff = YoungPoisson { young_modulus: 9e3, density: 1500.0, ..material() };
    app.world_mut().get_mut::<SinewBody>(body).unwrap().material = stiff;
    (0..10).for_each(|_| app.update());
    let (mut simulation, twin) = twin();
    (0..10).for_each(|_| simulation.step().unwrap());
    simulation.set_material(twin, stiff).unwrap();
    (0..10).for_each(|_| simulation.step().unwrap());
    assert_eq!(hash(&mut app), simulation.state_hash());
    let before = hash(&mut app);
    app.world_mut().get_mut::<SinewBody>(body).unwrap().material.poisson_ratio = 0.6;
    app.world_mut().resource_mut::<Time<Fixed>>().set_timestep(STEP);
    app.update();
    let told = messages::<BodyFailed>(&mut app);
    assert!(
        matches!(told[..], [BodyFailed { error: BuildError::Material { .. }, .. }]),
        "{told:?}"
    );
    assert_ne!(hash(&mut app), before, "the body goes on with the material that it had");
}

#[test]
fn cuts_are_told_and_change_the_surface() {
    let mut app = app();
    let body = held(&mut app, Transform::default());
    (0..3).for_each(|_| app.update());
    let surface = app.world().get::<SinewSurface>(body).unwrap().clone();
    let index = app.world().get::<SinewBodyIndex>(body).unwrap().0;
    let corner = Region::Sphere { centre: DVec3::new(0.1, 0.08, 0.04), radius: 0.03 };
    app.world_mut().spawn(RemovalRequest::new(index, Removal::new(corner)));
    let twice = Region::Tetrahedra(vec![9_999]);
    app.update();
    let cut = messages::<Resected>(&mut app);
    assert_eq!((cut.len(), cut[0].entity), (1, body));
    let removed = cut[0].report.tetrahedra.len();
    assert!(removed > 3 && cut[0].report.remaining == mesh().tetrahedra.len() - removed);
    let cut_surface = app.world().get::<SinewSurface>(body).unwrap();
    assert_eq!(cut_surface.revision, surface.revision + 1);
    assert_ne!(cut_surface.triangles, surface.triangles);
    app.world_mut().spawn(RemovalRequest::new(index, Removal::new(twice)));
    app.update();
    let failed = messages::<ResectionFailed>(&mut app);
    assert!(failed[0].error.to_string().contains("has no tetrahedron 9999"), "{failed:?}");
    app.update();
    assert!(messages::<Resected>(&mut app).is_empty());
    assert_eq!(app.world().get::<SinewSurface>(body).unwrap().revision, surface.revision + 1);
}

#[test]
fn blades_needles_threads_and_tears_are_components() {
    let mut app = app();
    let body = held(&mut app, Transform::default());
    app.world_mut().get_mut::<SinewBody>(body).unwrap().spare = 400;
    (0..3).for_each(|_| app.update());
    let index = app.world().get::<SinewBodyIndex>(body).unwrap().0;
    let ends = [DVec3::Z * 0.05, DVec3::Z * 0.015];
    let edge = Edge { ends, into: DVec3::Y, ..Edge::new(1.0, 50.0) };
    let knife = Tool::blade("knife", edge, DVec3::new(0.051, -0.005, 0.0));
    let needle = Needle { into: DVec3::NEG_Z, ..Needle::new(0.1, 1e-3, 20.0, 1.0) };
    let pin = Tool::needle("pin", needle, DVec3::new(0.083, 0.042, 0.045));
    let own = |mut tool: Tool, way: DVec3, app: &mut App| {
        let curve = Curve::Points(vec![[0.02, 0.0], [0.5, 1.0]]);
        tool.motion = ToolMotion::Translate(way, curve);
        app.world_mut().spawn(tool).id()
    };
    let knife = own(knife, DVec3::Y * 0.1, &mut app);
    let pin = own(pin, DVec3::Z * -0.03, &mut app);
    (0..60).for_each(|_| app.update());
    let [cut, felt] = [knife, pin].map(|tool| app.world().get::<ToolReport>(tool).unwrap());
    assert!(cut.separated > 0 && cut.cut_area > 1e-4, "{cut:?}");
    assert!(felt.punctures == 1 && felt.inserted > 0.015, "{felt:?}");
    assert!(app.world().get::<SinewSurface>(body).unwrap().wound.contains(&true));
    app.world_mut().despawn(knife);
    // a stitch through both lips, and a body that tears
    let mut points = Vec::new();
    for x in [0.03, 0.07] {
        let at = DVec3::new(x, 0.04, 0.03);
        let (element, vertices, weights) =
            material_point::<f64>(app.world_mut(), index, at).unwrap();
        points.push(Hold::Tissue { body: index, element, vertices, weights });
    }
    let stitch = Thread { length: Some(0.03), ..Thread::new("stitch", points, 20.0) };
    let stitch = app.world_mut().spawn(stitch).id();
    app.update();
    let report = app.world().get::<ThreadReport>(stitch).unwrap();
    assert!(report.largest() > 0.0 && report.spans[0] < 0.041, "{report:?}");
    let (toughness, radius, max_speed) = (None, None, None);
    let tear = Tear { body: index, strength: 10.0, toughness, radius, max_speed };
    let tear = check_tear(app.world_mut(), &tear).unwrap();
    let tear = app.world_mut().spawn(tear).id();
    (0..3).for_each(|_| app.update());
    assert!(app.world().get::<TearReport>(tear).unwrap().separated > 0);
    assert!(messages::<StepFailed>(&mut app).is_empty());
}

#[test]
fn a_snapshot_of_the_world_takes_back_steps_and_cuts() {
    let mut app = app();
    let body = held(&mut app, Transform::default());
    (0..5).for_each(|_| app.update());
    let index = app.world().get::<SinewBodyIndex>(body).unwrap().0;
    let surface = app.world().get::<SinewSurface>(body).unwrap().triangles.clone();
    let (start, begun) = (take_snapshot(app.world_mut()).unwrap(), steps_done(&app));
    let cut = |app: &mut bevy_app::App| {
        let corner = Region::Sphere { centre: DVec3::new(0.1, 0.08, 0.04), radius: 0.03 };
        app.world_mut().spawn(RemovalRequest::new(index, Removal::new(corner)));
        (0..20).for_each(|_| app.update());
        (hash(app), app.world().get::<SinewSurface>(body).unwrap().triangles.clone())
    };
    let after = cut(&mut app);
    assert_ne!(after.1, surface);
    restore_snapshot(app.world_mut(), &start).unwrap();
    assert_eq!(steps_done(&app), begun);
    // the surface is whole again with the next step
    app.update();
    assert_eq!(app.world().get::<SinewSurface>(body).unwrap().triangles, surface);
    restore_snapshot(app.world_mut(), &start).unwrap();
    assert_eq!(cut(&mut app), after);
}

#[test]
fn a_crushed_body_tells_that_it_recovers() {
    let mut app = app();
    let crush = |mut rows: Query<(&mut Displacement<f64>, &RestPosition)>,
                 clock: Res<StepClock>| {
        if clock.step == 3 {
            for (i, (mut u, rest)) in rows.iter_mut().enumerate() {
                let away = 0.03 * ((i * 7919 % 13) as f64 / 13.0 - 0.5);
                u.set(DVec3::new(away, -away, -1.8 * (rest.0.z - 0.01)));
            }
        }
    };
    app.add_systems(FixedPostUpdate, crush.in_set(SimulationSystems::Prepare));
    let mesh = asset(&mut app);
    let body = app.world_mut().spawn(SinewBody::new(mesh, material())).id();
    app.insert_resource(sinew::engine::step::Gravity(DVec3::ZERO));
    app.insert_resource(SolverSettings { mass_damping: 3.5, ..Default::default() });
    let (mut began, mut ended) = (Vec::new(), Vec::new());
    for frame in 0..400 {
        app.update();
        began.extend(messages::<RecoveryBegan>(&mut app).iter().map(|m| (frame, m.entity)));
        ended.extend(messages::<Recovered>(&mut app).iter().map(|m| (frame, m.entity)));
    }
    let state = app.world().get::<SinewBodyState>(body).unwrap();
    assert_eq!((state.inverted, state.recovering), (0, false));
    assert_eq!((began.len(), ended.len()), (1, 1), "{began:?} {ended:?}");
    assert!(began[0].0 == 4 && began[0].1 == body && ended[0].0 > began[0].0);
}

#[test]
fn a_despawned_body_is_emptied_and_told() {
    let mut app = app();
    let stays = held(&mut app, Transform::default());
    let goes = held(&mut app, Transform::from_xyz(0.0, 0.5, 0.0));
    app.world_mut().entity_mut(goes).insert(Name::new("organ"));
    (0..5).for_each(|_| app.update());
    let other: Vec<f64> = state_of(&mut app, stays);
    app.world_mut().despawn(goes);
    app.update();
    let gone = messages::<BodyDespawned>(&mut app);
    assert_eq!((gone.len(), gone[0].entity, gone[0].vertices), (1, goes, mesh().points.len()));
    assert!(gone[0].to_string().starts_with("body `organ`"), "{}", gone[0]);
    assert!(gone[0].to_string().contains("its elements are removed"), "{}", gone[0]);
    for _ in 0..20 {
        app.update();
        assert_eq!(app.world().resource::<StepOutcome>().0, None);
    }
    assert!(messages::<BodyDespawned>(&mut app).is_empty());
    assert_eq!(steps_done(&app), 25);
    // the other goes on as if nothing had been
    assert_ne!(state_of(&mut app, stays), other);
    let (mut simulation, stayed) = twin();
    let mut far = mesh();
    far.points.iter_mut().for_each(|p| p.y += 0.5);
    let other = simulation.add_body(&BodyDescription::new("far", &far, material())).unwrap();
    let floor = simulation.group_rows(other, &far, "z0").unwrap();
    let floor = simulation.add_constraint(Constraint::hold("floor", floor));
    (0..4).for_each(|_| simulation.step().unwrap());
    simulation.world_mut().despawn(floor);
    let all = Region::Tetrahedra((0..far.tetrahedra.len() as u32).collect());
    simulation.remove_elements(other, &Removal::new(all)).unwrap();
    (0..21).for_each(|_| simulation.step().unwrap());
    let alone: Vec<f64> =
        simulation.displacements(stayed).iter().flat_map(|u| u.to_array()).collect();
    assert_eq!(state_of(&mut app, stays), alone);
    // nothing of it is left to hit, and a new body may come
    let rest = app.world().resource::<Topology>().bodies[1].vertices.clone();
    assert_eq!(gone[0].index, 1);
    let world = app.world_mut();
    let masses = world.query::<&sinew::engine::vertex::Mass<f64>>();
    let mut masses = masses;
    let masses: Vec<f64> = masses.iter(world).map(|m| m.0).collect();
    assert!(masses[rest.start as usize..rest.end as usize].iter().all(|&m| m == 0.0));
    held(&mut app, Transform::from_xyz(0.0, 0.5, 0.0));
    (0..5).for_each(|_| app.update());
    assert_eq!(app.world().resource::<StepOutcome>().0, None);
    assert_eq!(app.world().resource::<Topology>().bodies.len(), 3);
    // all of it at once
    let world = app.world_mut();
    let all: Vec<_> = world.query_filtered::<Entity, With<SinewBody>>().iter(world).collect();
    assert!(all.into_iter().all(|body| app.world_mut().despawn(body)));
    app.update();
    assert_eq!(messages::<BodyDespawned>(&mut app).len(), 2);
    (0..5).for_each(|_| app.update());
    assert_eq!(app.world().resource::<StepOutcome>().0, None);
    assert_eq!(app.world().resource::<Assets<SoftMesh>>().len(), 0);
}

/// Displacements of a body in the user's order.
fn state_of(app: &mut bevy_app::App, body: Entity) -> Vec<f64> {
    let index = app.world().get::<SinewBodyIndex>(body).unwrap().0;
    let rows = app.world().resource::<Topology>().bodies[index].clone();
    let world = app.world_mut();
    let u: Vec<DVec3> = world.query::<&Displacement<f64>>().iter(world).map(|u| u.get()).collect();
    let mut result = vec![DVec3::ZERO; rows.mesh_vertices()];
    for (vertex, row) in rows.vertices_and_rows() {
        result[vertex.index()] = u[row.index()];
    }
    result.iter().flat_map(|u| u.to_array()).collect()
}

/// A mesh in millimetres is told when it is built, a tool inside of it when the step is made; each once.
#[test]
fn what_looks_unintended_is_told_once() {
    let mut app = app();
    let asset = asset(&mut app);
    let large = Transform::from_scale(Vec3::splat(1e3));
    app.world_mut().spawn((SinewBody::new(asset, material()), large, Name::new("organ")));
    let inside = Tool::new("ball", Shape::Sphere { radius: 20.0 }, DVec3::new(50.0, 40.0, 45.0));
    app.world_mut().spawn(inside);
    let mut told = Vec::new();
    for _ in 0..4 {
        app.update();
        let new = messages::<SinewWarning>(&mut app);
        told.extend(new.into_iter().map(|w| (w.0.code, w.0.subject)));
    }
    for expected in [("mesh.implausible-size", "body `organ`"), ("run.contact.drawn-in", "tools")] {
        let count = told.iter().filter(|own| (&*own.0, &*own.1) == expected).count();
        assert_eq!(count, 1, "{expected:?} in {told:?}");
    }
}
