//! Soft bodies of [Sinew](sinew) as components, assets and messages of a Bevy app.
//!
//! [`SinewBevyPlugins`] adds the engine and what is here. A body is a [`SinewBody`] on an entity with a `Transform`:
//! it is built as soon as its mesh is loaded. [`SinewHold`], [`SinewPull`] and tools that [follow](FollowTransform)
//! their entity act on it, [`SinewBodyState`] and messages tell how it is, [`SinewMeshSync`] draws it.
//!
//! ```
//! use bevy_app::{App, FixedUpdate, TaskPoolPlugin};
//! use bevy_asset::{AssetApp, AssetPlugin, Assets};
//! use bevy_ecs::prelude::*;
//! use bevy_mesh::{Mesh, Mesh3d};
//! use bevy_time::{TimePlugin, TimeUpdateStrategy};
//! use bevy_transform::TransformPlugin;
//! use bevy_transform::components::Transform;
//! use sinew::engine::mesh::generate::box_tets;
//! use sinew::prelude::{DVec3, preset};
//! use sinew_bevy::*;
//!
//! #[derive(Component)]
//! struct Hand;
//!
//! // a system of the app moves the hand by its `Transform`, as it moves anything
//! fn lift(mut hands: Query<&mut Transform, With<Hand>>) {
//!     for mut hand in &mut hands {
//!         hand.translation.z += 0.0005;
//!     }
//! }
//!
//! let mut app = App::new();
//! // `DefaultPlugins` in an app with a window
//! app.add_plugins((TaskPoolPlugin::default(), TimePlugin, TransformPlugin, AssetPlugin::default()));
//! app.add_plugins(SinewBevyPlugins::default());
//! app.add_systems(FixedUpdate, lift);
//! app.insert_resource(TimeUpdateStrategy::FixedTimesteps(1));
//!
//! let mesh = SoftMesh::new(box_tets(DVec3::new(0.1, 0.1, 0.05), [4, 4, 2])?)?;
//! let mesh = app.world_mut().resource_mut::<Assets<SoftMesh>>().add(mesh);
//! let body = app.world_mut().spawn((
//!     SinewBody::new(mesh, preset("liver")?.material),
//!     Transform::from_xyz(0.0, 0.0, 1.0),
//!     SinewMeshSync::default(),
//! ));
//! let body = body.id();
//! app.world_mut().spawn((SinewHold::new("z0"), ChildOf(body)));
//! app.world_mut().spawn((SinewPull::new(vec![40], 50.0, 0.1), Hand, ChildOf(body)));
//! for _ in 0..20 {
//!     app.update();
//! }
//! let state = app.world().get::<SinewBodyState>(body).unwrap();
//! assert!(state.step >= 19 && state.inverted == 0);
//! let drawn = app.world().get::<Mesh3d>(body).unwrap();
//! assert_eq!(app.world().resource::<Assets<Mesh>>().get(&drawn.0).unwrap().count_vertices(), 75);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod asset;
mod body;
mod carried;
mod draw;
mod input;
mod pick;
mod time;
mod warn;

pub use asset::{MESH_EXTENSIONS, SoftMesh, SoftMeshError, SoftMeshLoader};
pub use body::{
    BodyBuilt, BodyDespawned, BodyFailed, BuildError, Recovered, RecoveryBegan, Resected,
    ResectionFailed, SinewBody, SinewBodyError, SinewBodyIndex, SinewBodyState, SinewSurface,
};
pub use carried::SinewCarriedMesh;
pub use draw::{
    GizmoKind, GizmoLine, MeshSystems, SinewGizmoLines, SinewGizmos, SinewInterpolation,
    SinewMeshSync, sync_meshes,
};
pub use input::{
    FollowTransform, InputError, InputFailed, Moved, Patch, SinewHaptic, SinewHapticDevice,
    SinewHold, SinewInputError, SinewPull,
};
pub use pick::{SinewDrag, SinewHit, SinewMouse, SinewRayCast};
pub use sinew::engine::schedule::SimulationSystems;
pub use sinew::plugin::{SinewPlugins, StepFailed, StepOutcome};
pub use time::SinewTimestep;
pub use warn::SinewWarning;

use bevy_app::{App, Plugin, PluginGroup, PluginGroupBuilder};
use bevy_ecs::intern::Interned;
use bevy_ecs::message::signal_message_update_system;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;

/// The engine ([`SinewPlugins`]) with bodies, inputs and drawing. Add it after `AssetPlugin`, so after
/// `DefaultPlugins`.
#[derive(Default)]
pub struct SinewBevyPlugins {
    /// Precision, threads and schedule of the engine.
    pub engine: SinewPlugins,
}

impl SinewBevyPlugins {
    /// Steps in another schedule than `FixedPostUpdate`. Outside of the fixed schedules the length of a step is
    /// [`StepClock::dt`](sinew::prelude::StepClock::dt).
    #[must_use]
    pub fn in_schedule(mut self, schedule: impl ScheduleLabel) -> Self {
        self.engine = self.engine.in_schedule(schedule);
        self
    }
}

impl PluginGroup for SinewBevyPlugins {
    fn build(self) -> PluginGroupBuilder {
        let schedule = self.engine.schedule;
        PluginGroupBuilder::start::<Self>()
            .add_group(self.engine)
            .add(BodyPlugin { schedule })
            .add(DrawPlugin)
    }
}

/// Where this crate does its part between the [`SimulationSystems`] of the app.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum BodySystems {
    /// In [`SimulationSystems::First`]: bodies are built, and the length of the step is read.
    Build,
    /// Between [`SimulationSystems::Prepare`] and [`SimulationSystems::Step`]: holds, pulls and tools go where
    /// their entities are.
    Input,
    /// Between [`SimulationSystems::Step`] and [`SimulationSystems::Writeback`]: [`SinewBodyState`], surfaces and
    /// messages.
    State,
}

/// Bodies, what acts on them, and what they tell.
pub struct BodyPlugin {
    /// Schedule of the engine.
    pub schedule: Interned<dyn ScheduleLabel>,
}

impl Plugin for BodyPlugin {
    fn build(&self, app: &mut App) {
        let schedule = self.schedule;
        asset::build(app);
        app.configure_sets(
            schedule,
            (
                BodySystems::Build.in_set(SimulationSystems::First),
                BodySystems::Input
                    .after(SimulationSystems::Prepare)
                    .before(SimulationSystems::Step),
                BodySystems::State
                    .after(SimulationSystems::Step)
                    .before(SimulationSystems::Writeback)
                    // the one system of Bevy's in the fixed schedules
                    .ambiguous_with(signal_message_update_system),
            ),
        );
        time::build(app, schedule);
        body::build(app, schedule);
        warn::build(app, schedule);
        input::build(app, schedule);
        draw::build_steps(app, schedule);
    }
}

/// Meshes and lines of bodies, in `PostUpdate`.
pub struct DrawPlugin;

impl Plugin for DrawPlugin {
    fn build(&self, app: &mut App) {
        draw::build(app);
    }
}
