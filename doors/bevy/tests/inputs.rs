//! Holds, pulls and tools that are where their entities are, and what stops them.

use crate::common::*;
use bevy_app::{FixedUpdate, Update};
use bevy_ecs::prelude::*;
use bevy_math::{Dir3, Quat, Vec3};
use bevy_shape::Ray3d;
use bevy_transform::components::Transform;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::Position;
use sinew::haptics::HapticOptions;
use sinew::prelude::*;
use sinew::touch::pull::PullReport;
use sinew::touch::tool::ToolReport;
use sinew_bevy::*;
use std::time::Duration;

/// Position (m) of a vertex of the only body.
fn vertex(app: &mut bevy_app::App, vertex: u32) -> DVec3 {
    let row = app.world().resource::<Topology>().bodies[0].row(vertex).unwrap();
    let world = app.world_mut();
    world.query::<&Position>().iter(world).nth(row.index()).unwrap().0
}

#[test]
fn held_vertices_follow_their_entity_rigidly() {
    let mut app = app();
    let body = held(&mut app, Transform::from_xyz(0.0, 0.0, 1.0));
    let top = mesh_group("z1");
    let centre = Vec3::new(0.05, 0.04, 0.04);
    let jaw = SinewHold::new(top.clone());
    let jaw = app.world_mut().spawn((jaw, Transform::from_translation(centre), ChildOf(body))).id();
    (0..3).for_each(|_| app.update());
    let moved = Transform::from_translation(centre + Vec3::new(0.0, 0.002, 0.003))
        .with_rotation(Quat::from_rotation_z(0.2));
    *app.world_mut().get_mut::<Transform>(jaw).unwrap() = moved;
    app.update();
    for &v in &top {
        let arm = mesh().points[v as usize] - centre.as_dvec3();
        let expected = moved.transform_point(arm.as_vec3()).as_dvec3() + DVec3::Z;
        let found = vertex(&mut app, v);
        assert!(found.distance(expected) < 1e-7, "{found} {expected}");
    }
    // let go, it falls back
    app.world_mut().entity_mut(jaw).remove::<SinewHold>();
    assert!(app.world().get::<Constraint>(jaw).is_none());
    let rest = mesh().points[top[0] as usize] + DVec3::Z;
    let stretched = vertex(&mut app, top[0]).distance(rest);
    (0..3).for_each(|_| app.update());
    assert!(vertex(&mut app, top[0]).distance(rest) < 0.9 * stretched);
}

#[test]
fn inputs_that_cannot_act_are_told_once() {
    let mut app = app();
    let body = held(&mut app, Transform::default());
    let mut spawn = |input: SinewHold| app.world_mut().spawn((input, Name::new("jaw"))).id();
    let lost = spawn(SinewHold::new(vec![0]));
    let far = spawn(SinewHold::new(vec![0, 4_000]));
    app.world_mut().entity_mut(far).insert(ChildOf(body));
    let wrong = app.world_mut().spawn((SinewHold::new("nose"), ChildOf(body))).id();
    let weak = app.world_mut().spawn((SinewPull::new(vec![0], -1.0, 0.0), ChildOf(body))).id();
    let shape = Shape::Sphere { radius: 0.01 };
    let tool = Tool::new("probe", shape, DVec3::ZERO);
    let nowhere = Transform::from_xyz(0.0, f32::NAN, 0.0);
    let probe = app.world_mut().spawn((tool, FollowTransform::default(), nowhere)).id();
    let mut told = Vec::new();
    for _ in 0..4 {
        app.update();
        told.extend(messages::<InputFailed>(&mut app));
    }
    assert_eq!(app.world().resource::<StepOutcome>().0, None);
    let text = |entity| {
        let told: Vec<_> = told.iter().filter(|t| t.entity == entity).collect();
        assert_eq!(told.len(), 1, "{told:?}");
        assert_eq!(app.world().get::<SinewInputError>(entity).unwrap().0, told[0].error);
        told[0].error.to_string()
    };
    assert!(text(lost).contains("`jaw` is a child of no `SinewBody`"), "{}", text(lost));
    assert!(text(far).contains("vertex 4000 of body"), "{}", text(far));
    assert!(text(wrong).contains("has no group `nose`"), "{}", text(wrong));
    assert!(text(weak).contains("its stiffness is -1 N/m"), "{}", text(weak));
    assert!(text(probe).contains("not finite"), "{}", text(probe));
    // corrected
    app.world_mut().get_mut::<SinewHold>(far).unwrap().vertices = vec![0].into();
    app.world_mut().get_mut::<SinewPull>(weak).unwrap().stiffness = 10.0;
    app.world_mut().entity_mut(probe).insert(Transform::from_xyz(0.0, 0.0, 0.3));
    (0..2).for_each(|_| app.update());
    for entity in [far, weak, probe] {
        assert!(app.world().get::<SinewInputError>(entity).is_none());
    }
    assert!(
        app.world().get::<Constraint>(far).is_some() && app.world().get::<Pull>(weak).is_some()
    );
    // and lost while it acts
    app.world_mut().get_mut::<Transform>(weak).unwrap().translation.x = f32::INFINITY;
    let told: usize = (0..3)
        .map(|_| {
            app.update();
            messages::<InputFailed>(&mut app).len()
        })
        .sum();
    assert_eq!(told, 1);
    assert_eq!(app.world().resource::<StepOutcome>().0, None);
}

#[test]
fn inputs_wait_for_their_body() {
    let mut app = app();
    let mesh = app.world().resource::<bevy_asset::Assets<SoftMesh>>().reserve_handle();
    let body = app.world_mut().spawn(SinewBody::new(mesh.clone(), material())).id();
    let hold = app.world_mut().spawn((SinewHold::new(mesh_group("z0")), ChildOf(body))).id();
    (0..3).for_each(|_| app.update());
    assert!(messages::<InputFailed>(&mut app).is_empty());
    assert!(app.world().get::<Constraint>(hold).is_none());
    let asset = SoftMesh::new(crate::common::mesh()).unwrap();
    app.world_mut().resource_mut::<bevy_asset::Assets<SoftMesh>>().insert(&mesh, asset).unwrap();
    app.update();
    assert!(app.world().get::<SinewBodyIndex>(body).is_some());
    assert!(app.world().get::<Constraint>(hold).is_some(), "in the step that built the body");
}

/// Largest way (m) of a tool in a step, while its entity makes a way of 4 mm a frame of four steps.
fn largest_way(moved: Moved) -> f64 {
    #[derive(Resource)]
    struct Last(DVec3, f64);
    let mut app = app_of(Duration::from_millis(20), Duration::from_millis(5));
    held(&mut app, Transform::default());
    let tool = Tool::new("probe", Shape::Sphere { radius: 0.01 }, DVec3::ZERO);
    let follow = FollowTransform { moved, ..Default::default() };
    let start = Transform::from_xyz(0.0, 0.0, 0.5);
    let tool = app.world_mut().spawn((tool, follow, start)).id();
    // it appears where its entity was at the end of the first frame
    app.insert_resource(Last(DVec3::new(0.004, 0.0, 0.5), 0.0));
    app.add_systems(Update, |mut tools: Query<&mut Transform, With<Tool>>| {
        tools.iter_mut().for_each(|mut t| t.translation.x += 0.004);
    });
    app.add_systems(FixedUpdate, |tools: Query<&ToolReport>, mut last: ResMut<Last>| {
        for report in tools.iter().filter(|r| r.position != DVec3::ZERO) {
            last.1 = last.1.max(report.position.distance(last.0));
            last.0 = report.position;
        }
    });
    (0..10).for_each(|_| app.update());
    // where the entity was at the start of the frame
    let report = app.world().get::<ToolReport>(tool).unwrap();
    assert!((report.position.x - 0.004 * 9.0).abs() < 1e-8, "{}", report.position);
    app.world().resource::<Last>().1
}

#[test]
fn what_moves_once_a_frame_is_spread_over_its_steps() {
    let (at_once, spread) = (largest_way(Moved::EveryStep), largest_way(Moved::EveryFrame));
    assert!((at_once - 0.004).abs() < 1e-8, "{at_once}");
    assert!((spread - 0.001).abs() < 1e-8, "{spread}");
}

#[test]
fn a_mouse_grabs_what_it_points_at() {
    #[derive(Resource, Default)]
    struct Found(Vec<Option<SinewHit>>, Option<Entity>);
    let mut app = app();
    app.init_resource::<Found>();
    let body = held(&mut app, Transform::from_xyz(0.0, 0.0, 1.0));
    let down = |x: f32| Ray3d::new(Vec3::new(x, 0.03, 2.0), Dir3::NEG_Z);
    app.add_systems(
        Update,
        move |mut mouse: SinewMouse,
              cast: SinewRayCast,
              mut found: ResMut<Found>,
              clock: Res<StepClock>| {
            match clock.step {
                0 => found.0.push(cast.cast(down(0.05))),
                1 => {
                    found.0 = vec![cast.cast(down(0.05)), cast.cast(down(0.5))];
                    assert!(mouse.grab(down(0.5), Vec3::NEG_Z, 50.0, 0.1).is_none());
                    found.1 = mouse.grab(down(0.05), Vec3::NEG_Z, 50.0, 0.1).map(|g| g.0);
                }
                2..30 => {
                    // away from the plane nothing happens
                    let up = Ray3d::new(Vec3::new(0.0, 0.0, 2.0), Dir3::Z);
                    let pull = found.1.unwrap();
                    assert!(mouse.drag(pull, up).is_none());
                    assert!(mouse.drag(Entity::PLACEHOLDER, up).is_none());
                    assert!(mouse.drag(pull, down(0.06)).is_some());
                }
                30 => mouse.release(found.1.unwrap()),
                _ => {}
            }
        },
    );
    (0..25).for_each(|_| app.update());
    let found = app.world().resource::<Found>();
    let (hit, pull) = (found.0[0].unwrap(), found.1.unwrap());
    assert_eq!((hit.entity, found.0[1]), (body, None));
    let at = |v: u32| mesh().points[v as usize] + DVec3::Z;
    let point: DVec3 = hit.vertices.iter().zip(hit.weights).map(|(v, w)| at(*v) * w).sum();
    assert!(point.distance(hit.position) < 1e-3, "sags by less than a millimetre in a step");
    assert!((hit.position.z - 1.04).abs() < 1e-3);
    assert!(hit.vertices.contains(&hit.vertex()));
    let report = *app.world().get::<PullReport>(pull).unwrap();
    assert!(report.force.x < -0.05 && report.distance < 0.01, "{report:?}");
    assert!(app.world().get::<SinewBodyState>(body).unwrap().contact_force.x > 0.05);
    (0..20).for_each(|_| app.update());
    assert!(app.world().get_entity(pull).is_err(), "let go");
    assert_eq!(app.world().get::<SinewBodyState>(body).unwrap().contact_force, DVec3::ZERO);
}

/// Bit for bit, and until it is taken away.
#[test]
fn haptic_devices_hold_tools_as_without_bevy() {
    let mut app = app();
    held(&mut app, Transform::default());
    let top = mesh().points.iter().map(|x| x.z).fold(0.0, f64::max);
    let ball =
        || Tool::new("ball", Shape::Sphere { radius: 0.02 }, DVec3::new(0.05, 0.05, top + 0.021));
    let hand = app.world_mut().spawn((ball(), SinewHaptic::of_tool())).id();
    let both = app
        .world_mut()
        .spawn((ball(), SinewHaptic::of_tool(), FollowTransform::default(), Name::new("both")))
        .id();
    let (mut simulation, _) = twin();
    let tool = simulation.add_tool(ball()).unwrap();
    let other = simulation.add_tool(ball()).unwrap();
    (0..2).for_each(|_| app.update());
    let error = app.world().get::<SinewInputError>(both).unwrap().0.to_string();
    assert!(error.contains("a `FollowTransform` and a haptic device move it"), "{error}");
    app.world_mut().despawn(both);
    assert!(simulation.remove_contact(other));
    let (mut tissue, mut twin) = simulation.haptic_handle(HapticOptions::of_tool(tool)).unwrap();
    let mut found = tissue.step(&mut simulation).unwrap();
    let mut device = app.world_mut().get_mut::<SinewHapticDevice>(hand).unwrap().take().unwrap();
    let velocity = DVec3::new(0.005, 0.0, -0.03);
    let mut last = device.exchange(DVec3::ZERO, velocity, 1e-3);
    assert_eq!(last, twin.exchange(DVec3::ZERO, velocity, 1e-3));
    for tick in 1..200 {
        let x = f64::from(tick) * 1e-3 * velocity;
        last = device.exchange(x, velocity, 1e-3);
        assert_eq!(last, twin.exchange(x, velocity, 1e-3), "{tick}");
        if tick % 10 == 0 {
            app.update();
            found = tissue.step(&mut simulation).unwrap();
        }
    }
    assert_eq!(app.world().get::<SinewHapticDevice>(hand).unwrap().report(), Some(&found));
    assert!(last.force.z > 0.1 && found.push.z > 0.9, "{last:?}");
    app.world_mut().entity_mut(hand).remove::<SinewHaptic>();
    let tool = app.world().get::<Tool>(hand).unwrap();
    assert!(tool.spring.is_none() && tool.target().0.is_some());
    assert!(app.world().get::<SinewHapticDevice>(hand).is_none());
}

/// Bit for bit, and until it is taken away.
#[test]
fn haptic_devices_feel_what_they_feel_without_bevy() {
    let mut app = app();
    let body = held(&mut app, Transform::default());
    let top = mesh_group("z1");
    let hand = app.world_mut().spawn((SinewHaptic::new(top.clone()), ChildOf(body))).id();
    let mut weak = SinewHaptic::new(vec![0]);
    weak.options.limit = -1.0;
    let weak = app.world_mut().spawn((weak, Name::new("pen"), ChildOf(body))).id();
    let (mut simulation, twin) = twin();
    let options = HapticOptions::new(twin, top);
    let (mut tissue, mut other) = simulation.haptic_handle(options).unwrap();
    // the first frame takes no time
    (0..2).for_each(|_| app.update());
    let mut found = tissue.step(&mut simulation).unwrap();
    let mut own = app.world_mut().get_mut::<SinewHapticDevice>(hand).unwrap();
    let mut device = own.take().unwrap();
    assert!(own.take().is_none(), "a device has one owner");
    let velocity = DVec3::new(0.02, 0.0, 0.05);
    let mut last = device.exchange(DVec3::ZERO, velocity, 1e-3);
    assert_eq!(last, other.exchange(DVec3::ZERO, velocity, 1e-3));
    for tick in 1..300 {
        let x = f64::from(tick) * 1e-3 * velocity;
        last = device.exchange(x, velocity, 1e-3);
        assert_eq!(last, other.exchange(x, velocity, 1e-3));
        if tick % 10 == 0 {
            app.update();
            found = tissue.step(&mut simulation).unwrap();
        }
    }
    assert_eq!(app.world().get::<SinewHapticDevice>(hand).unwrap().report(), Some(&found));
    assert_eq!(hash(&mut app), simulation.state_hash());
    assert!(last.force.z < -0.1 && !last.flags.stale, "{last:?}");
    // taken away, it lets go
    app.world_mut().entity_mut(hand).remove::<SinewHaptic>();
    assert!(app.world().get::<Pull>(hand).is_none());
    for _ in 0..200 {
        last = device.exchange(300e-3 * velocity, DVec3::ZERO, 1e-3);
    }
    assert!(last.force == DVec3::ZERO && last.flags.stale, "{last:?}");
    let error = app.world().get::<SinewInputError>(weak).unwrap().0.to_string();
    assert!(error.contains("`pen`: limit is -1 N"), "{error}");
}
