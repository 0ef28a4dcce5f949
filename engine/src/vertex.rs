//! Vertex components: one entity per vertex of every body, all in one table, in reverse
//! Cuthill-McKee order body by body. Elements refer to vertices by *row* of that table, never by
//! `Entity`, so the component set of a vertex must not change after its body was spawned
//! ([`crate::step`] checks this before every step).
//!
//! The state is the displacement from rest, not the position: squared-length changes formed from
//! displacements keep full relative accuracy at any strain and any distance from the origin, which
//! is what makes `f32` usable.
//!
//! # For hosts
//!
//! Draw [`Position`]. The columns of the number type are read and written as vectors, by `get`, `set` and
//! `+=`; the padded arrays inside are what kernels read. A system that pushes vertices, in
//! [`StepSystems::Prepare`](crate::schedule::StepSystems::Prepare) after the loads:
//!
//! ```
//! use bevy_ecs::prelude::*;
//! use glam::DVec3;
//! use sinew_engine::load::apply_loads;
//! use sinew_engine::schedule::{Executor, StepSchedule, StepSystems};
//! use sinew_engine::step::install_engine;
//! use sinew_engine::vertex::{ExternalForce, Velocity};
//!
//! /// Air that rests: a force (N) against the velocity.
//! fn drag(mut vertices: Query<(&Velocity<f64>, &mut ExternalForce<f64>)>) {
//!     for (velocity, mut force) in &mut vertices {
//!         *force += -0.01 * velocity.get();
//!     }
//! }
//!
//! let mut world = World::new();
//! install_engine::<f64>(&mut world, Executor::default());
//! let after_loads = drag.in_set(StepSystems::Prepare).after(apply_loads::<f64>);
//! world.resource_mut::<Schedules>().entry(StepSchedule).add_systems(after_loads);
//!
//! let weight = ExternalForce::<f64>::new(DVec3::new(0.0, 0.0, -9.81));
//! let vertex = world.spawn((Velocity::<f64>::new(DVec3::X), weight)).id();
//! world.run_system_cached(drag)?;
//! let force = world.get::<ExternalForce<f64>>(vertex).unwrap().get();
//! assert_eq!((force.x, force.z), (-0.01, -9.81));
//! # Ok::<(), BevyError>(())
//! ```

#![allow(
    clippy::multiple_bound_locations,
    reason = "the derive macros of bytemuck repeat the bound on S"
)]

use crate::scalar::Scalar;
use bevy_ecs::prelude::{Component, Resource, World};
use bytemuck::{Pod, TransparentWrapper, Zeroable};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::ops::AddAssign;

macro_rules! rows {
    ($($(#[$doc:meta])* $name:ident),+ $(,)?) => {$(
        $(#[$doc])*
        #[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper, Pod, Zeroable)]
        #[component(clone_behavior = Ignore)]
        #[repr(transparent)]
        pub struct $name<S: Scalar>(pub [S; 4]);

        impl<S: Scalar> $name<S> {
            /// Of a vector, in the unit of the column.
            #[inline(always)]
            pub fn new(vector: DVec3) -> Self {
                Self([S::from_f64(vector.x), S::from_f64(vector.y), S::from_f64(vector.z), S::ZERO])
            }

            /// As a vector, in the unit of the column.
            #[inline(always)]
            pub fn get(&self) -> DVec3 {
                DVec3::new(self.0[0].to_f64(), self.0[1].to_f64(), self.0[2].to_f64())
            }

            /// Sets it to a vector, in the unit of the column.
            #[inline(always)]
            pub fn set(&mut self, vector: DVec3) {
                *self = Self::new(vector);
            }
        }

        impl<S: Scalar> From<DVec3> for $name<S> {
            fn from(vector: DVec3) -> Self {
                Self::new(vector)
            }
        }

        impl<S: Scalar> AddAssign<DVec3> for $name<S> {
            #[inline(always)]
            fn add_assign(&mut self, vector: DVec3) {
                for (k, x) in vector.to_array().into_iter().enumerate() {
                    self.0[k] += S::from_f64(x);
                }
            }
        }
    )+};
}

rows! {
    /// Displacement from the rest position (m); the fourth number is padding and stays zero.
    Displacement,
    /// Velocity (m/s).
    Velocity,
    /// Elastic force -dW/dx of all laws (N) at the displacement last evaluated.
    ElasticForce,
    /// Force from outside (N), gravity included; written in Prepare.
    ExternalForce,
    /// Displacement (m) that fixed axes have at the end of the step.
    PrescribedDisplacement,
}

/// Rest position (m).
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct RestPosition(pub DVec3);

/// Deformed position (m), written at the end of every step for readers outside.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct Position(pub DVec3);

/// Lumped mass (kg).
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper, Pod, Zeroable)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct Mass<S: Scalar>(pub S);

/// By how much (kg) the weight of a vertex is that of another mass than its [`Mass`]: gravity pulls at the sum of both. Over a
/// body it sums up to 0, and it is 0 everywhere but in ten-node tetrahedra, whose shape functions give the corners a negative
/// part of the weight and no mass can be negative.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper, Pod, Zeroable)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct WeightShift<S: Scalar>(pub S);

/// Axes along which a vertex is held at its [`PrescribedDisplacement`]: bits 0, 1, 2 for x, y, z.
/// Held unknowns are eliminated from the linear system exactly.
#[derive(
    Component,
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    TransparentWrapper,
    Pod,
    Zeroable,
    Serialize,
    Deserialize,
)]
#[repr(transparent)]
pub struct FixedAxes(pub u8);

impl FixedAxes {
    /// Free in all directions.
    pub const NONE: Self = Self(0);
    /// Held in all directions.
    pub const ALL: Self = Self(7);

    /// Whether `axis` (0, 1, 2) is held.
    #[inline(always)]
    pub fn holds(self, axis: usize) -> bool {
        self.0 >> axis & 1 == 1
    }
}

/// Body that a vertex or element belongs to: index into [`crate::topology::Topology::bodies`].
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct BodyId(pub u32);

/// Cuts since an integrator last looked, for who remembers how vertices moved. Integrators and their memory take them away, and so does
/// whoever takes edits back.
#[derive(Resource, Clone, Debug, Default)]
pub struct RecentCuts<S>(pub Vec<RecentCut<S>>);

impl<S: Scalar> RecentCuts<S> {
    /// Takes those of a world out of it.
    pub fn take(world: &mut World) -> Vec<RecentCut<S>> {
        let own = world.get_resource_mut::<Self>();
        own.map_or_else(Vec::new, |mut own| std::mem::take(&mut own.0))
    }
}

/// What a cut did to the vertices of a body.
#[derive(Clone, Debug, Default)]
pub struct RecentCut<S> {
    /// Number of the body.
    pub body: usize,
    /// Rows that came to life, each with the row in whose place it is.
    pub copies: Vec<[u32; 2]>,
    /// Rows whose masses (kg) it shared out anew: before it and after.
    pub masses: Vec<(u32, [S; 2])>,
}
