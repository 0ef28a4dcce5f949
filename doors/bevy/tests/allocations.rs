//! Drawing a body allocates nothing once its mesh is there.

#[path = "common.rs"]
#[allow(dead_code, reason = "shared with the other test binary")]
mod common;

use allocation_counter::measure;
use bevy_asset::Assets;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::{ScheduleConfigs, SingleThreadedExecutor};
use bevy_ecs::system::ScheduleSystem;
use bevy_mesh::{Mesh, Mesh3d};
use bevy_transform::components::Transform;
use common::*;
use sinew::engine::vertex::Position;
use sinew_bevy::*;

fn shake(mut positions: Query<&mut Position>) {
    positions.iter_mut().for_each(|mut p| p.0.x += 0.001);
}

#[test]
fn a_mesh_is_updated_without_an_allocation() {
    let mut app = app();
    let body = held(&mut app, Transform::from_xyz(0.0, 0.0, 1.0));
    app.world_mut()
        .entity_mut(body)
        .insert((SinewMeshSync::default(), SinewInterpolation::default()));
    let flat = held(&mut app, Transform::default());
    app.world_mut()
        .entity_mut(flat)
        .insert(SinewMeshSync { smooth_normals: false, ..Default::default() });
    (0..5).for_each(|_| app.update());

    // on this thread, whose allocations are counted
    let single = |systems: ScheduleConfigs<ScheduleSystem>| {
        let mut schedule = Schedule::default();
        schedule.set_executor(SingleThreadedExecutor::new());
        schedule.add_systems(systems);
        schedule
    };
    let mut sync = single(sync_meshes.into_configs());
    let mut nothing = single((|| {}).into_configs());
    (0..3).for_each(|_| nothing.run(app.world_mut()));
    let of_a_run = measure(|| nothing.run(app.world_mut())).count_total;
    let written = |world: &World, body: Entity| {
        let mesh = world.get::<Mesh3d>(body).unwrap();
        world.resource::<Assets<Mesh>>().get(&mesh.0).unwrap().clone()
    };
    for frame in 0..13 {
        app.update();
        let world = app.world_mut();
        let before = written(world, flat);
        world.run_system_cached(shake).unwrap();
        for entity in [body, flat] {
            world.get_mut::<SinewBodyState>(entity).unwrap().set_changed();
        }
        let counted = measure(|| sync.run(world)).count_total;
        assert!(frame < 3 || counted == of_a_run, "{counted} of {of_a_run} in frame {frame}");
        assert!(written(world, flat) != before, "it was written");
    }
    // the counter counts
    let world = app.world_mut();
    world.get_mut::<SinewMeshSync>(body).unwrap().smooth_normals = false;
    assert!(measure(|| sync.run(world)).count_total > of_a_run);
    assert!(written(world, body).indices().is_none());
}
