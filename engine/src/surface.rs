//! What contact needs to know of the surface of a body: its faces, and how stiff it is there. Whoever builds bodies
//! says how to find that out; nothing is computed before somebody asks.

use bevy_ecs::prelude::{Resource, World};

/// The surface of what is left of a body. Rows are relative to the first vertex row of the body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodySurface {
    /// Outside triangles of the solid, outward.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles of membranes; quadrilaterals are cut along a diagonal.
    pub sheets: Vec<[u32; 3]>,
    /// Young's modulus (Pa) round every vertex: mean of its solid elements; in a membrane the modulus times the
    /// thickness over the mean edge, which resists pressure alike.
    pub young_modulus: Vec<f64>,
}

/// Finds the surface of a body, by its index in [`Topology::bodies`](crate::topology::Topology::bodies).
#[derive(Resource, Clone, Copy, Debug)]
pub struct SurfaceReader(pub fn(&mut World, usize) -> BodySurface);
