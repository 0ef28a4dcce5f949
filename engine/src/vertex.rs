//! Vertex components: one entity per vertex of every body, all in one table, in reverse
//! Cuthill-McKee order body by body. Elements refer to vertices by *row* of that table, never by
//! `Entity`, so the component set of a vertex must not change after its body was spawned
//! ([`crate::step`] checks this before every step).
//!
//! The state is the displacement from rest, not the position: squared-length changes formed from
//! displacements keep full relative accuracy at any strain and any distance from the origin, which
//! is what makes `f32` usable.

#![allow(
    clippy::multiple_bound_locations,
    reason = "the derive macros of bytemuck repeat the bound on S"
)]

use crate::scalar::Scalar;
use bevy_ecs::prelude::Component;
use bytemuck::{Pod, TransparentWrapper, Zeroable};
use glam::DVec3;

macro_rules! rows {
    ($($(#[$doc:meta])* $name:ident),+ $(,)?) => {$(
        $(#[$doc])*
        #[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper, Pod, Zeroable)]
        #[repr(transparent)]
        pub struct $name<S: Scalar>(pub [S; 4]);
    )+};
}

rows! {
    /// Displacement from the rest position (m); the fourth entry is padding and stays zero.
    Displacement,
    /// Velocity (m/s); the fourth entry is padding.
    Velocity,
    /// Elastic force -dW/dx of all laws (N) at the displacement last evaluated; fourth entry padding.
    ElasticForce,
    /// Force from outside (N), gravity included; written in Prepare; fourth entry padding.
    ExternalForce,
    /// Displacement (m) that fixed axes have at the end of the step; fourth entry padding.
    PrescribedDisplacement,
}

/// Rest position (m).
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct RestPosition(pub DVec3);

/// Deformed position (m), written at the end of every step for readers outside.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct Position(pub DVec3);

/// Lumped mass (kg).
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper, Pod, Zeroable)]
#[repr(transparent)]
pub struct Mass<S: Scalar>(pub S);

/// Axes along which a vertex is held at its [`PrescribedDisplacement`]: bits 0, 1, 2 for x, y, z.
/// Held unknowns are eliminated from the linear system exactly.
#[derive(
    Component, Clone, Copy, Debug, Default, PartialEq, Eq, TransparentWrapper, Pod, Zeroable,
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

/// Index of the vertex in the mesh that the user gave.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct VertexIndex(pub u32);

/// Body that a vertex or element belongs to: index into [`crate::topology::Topology::bodies`].
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct BodyId(pub u32);
