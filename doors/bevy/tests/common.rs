//! An app without a window, and a body in it.

use bevy_app::{App, TaskPoolPlugin};
use bevy_asset::io::memory::{Dir, MemoryAssetReader};
use bevy_asset::io::{AssetSourceBuilder, AssetSourceId};
use bevy_asset::{AssetApp, AssetPlugin, Assets, Handle};
use bevy_ecs::prelude::*;
use bevy_time::{Fixed, Time, TimePlugin, TimeUpdateStrategy};
use bevy_transform::TransformPlugin;
use bevy_transform::components::Transform;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::prelude::*;
use sinew_bevy::*;
use std::time::Duration;

pub const STEP: Duration = Duration::from_millis(10);

/// What Bevy itself adds, with asset files in memory.
pub fn bare(files: Dir) -> App {
    let mut app = App::new();
    let reader = move || Box::new(MemoryAssetReader { root: files.clone() }) as _;
    app.register_asset_source(AssetSourceId::Default, AssetSourceBuilder::new(reader));
    app.add_plugins((TaskPoolPlugin::default(), TimePlugin, TransformPlugin));
    app.add_plugins(AssetPlugin::default());
    app
}

/// An app whose frames and steps take as long as told.
pub fn app_of(frame: Duration, step: Duration) -> App {
    let mut app = bare(Dir::default());
    app.add_plugins(SinewBevyPlugins { engine: engine() });
    app.insert_resource(Time::<Fixed>::from_duration(step));
    app.insert_resource(TimeUpdateStrategy::ManualDuration(frame));
    app
}

/// An app with a step a frame, but for the first frame, which takes no time.
pub fn app() -> App {
    app_of(STEP, STEP)
}

/// One thread: tests run side by side.
pub fn engine() -> SinewPlugins {
    SinewPlugins { threads: 1.into(), ..Default::default() }
}

pub fn mesh() -> Mesh {
    let mesh = box_tets(DVec3::new(0.1, 0.08, 0.04), [5, 4, 2]).unwrap();
    jitter_interior(&mesh, 0.2, 7).unwrap()
}

pub fn material() -> YoungPoisson {
    YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.4, density: 1000.0 }
}

pub fn asset(app: &mut App) -> Handle<SoftMesh> {
    let mesh = SoftMesh::new(mesh()).unwrap();
    app.world_mut().resource_mut::<Assets<SoftMesh>>().add(mesh)
}

/// A body held at its bottom.
pub fn held(app: &mut App, transform: Transform) -> Entity {
    let mesh = asset(app);
    let body = app.world_mut().spawn((SinewBody::new(mesh, material()), transform)).id();
    app.world_mut().spawn((SinewHold::new("z0"), ChildOf(body)));
    body
}

pub fn mesh_group(name: &str) -> Vec<u32> {
    mesh().group(name).unwrap().vertices.clone()
}

/// The same as [`held`], without Bevy.
pub fn twin() -> (Simulation, BodyHandle) {
    let options = SimulationOptions { threads: 1, ..Default::default() };
    let mut simulation = Simulation::new(options).unwrap();
    let mesh = mesh();
    let body = simulation.add_body(&BodyDescription::new("twin", &mesh, material())).unwrap();
    let floor = simulation.group_rows(body, &mesh, "z0").unwrap();
    simulation.add_constraint(Constraint::hold("floor", floor));
    simulation.set_dt(STEP.as_secs_f64());
    (simulation, body)
}

pub fn hash(app: &mut App) -> u64 {
    sinew::simulation::state_hash(app.world_mut())
}

pub fn steps_done(app: &App) -> u64 {
    app.world().resource::<StepClock>().step
}

/// Messages of a type since the last call, if called every frame.
pub fn messages<M: Message + Clone>(app: &mut App) -> Vec<M> {
    app.world_mut().resource_mut::<Messages<M>>().drain().collect()
}
