//! What a removal did, and why it cannot be carried out.

use serde::Serialize;
use sinew_engine::connectivity::{ElementKind, Touched};
use sinew_engine::row::{LocalRow, MeshVertex};
use sinew_engine::topology::BodyRows;
use std::time::Duration;

use crate::body::matter::Chosen;
use crate::body::present::BodyResection;

/// What a removal did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RemovalReport {
    /// Tetrahedra removed, by their indices in the user's mesh, ascending.
    pub tetrahedra: Vec<u32>,
    /// Membrane triangles removed, by their indices in the user's list, ascending.
    pub triangles: Vec<u32>,
    /// Hexahedra removed, by their indices in the user's mesh, ascending.
    pub hexahedra: Vec<u32>,
    /// Membrane quadrilaterals removed, by their indices in the user's list, ascending.
    pub quads: Vec<u32>,
    /// Tetrahedra left in the body.
    pub remaining: usize,
    /// Membrane triangles left in the body.
    pub remaining_triangles: usize,
    /// Hexahedra left in the body.
    pub remaining_hexahedra: usize,
    /// Membrane quadrilaterals left in the body.
    pub remaining_quads: usize,
    /// Mesh edges that no element uses any more.
    pub edges: usize,
    /// Mesh faces that no element uses any more.
    pub faces: usize,
    /// Faces that follower pressures and tractions lost with them.
    pub pressure_faces: usize,
    /// Vertices that lost their last element, by their indices in the user's mesh, ascending.
    pub orphans: Vec<MeshVertex>,
    /// Connected pieces of the body now; vertices without elements are none.
    pub pieces: usize,
    /// Volume of the removed solid elements (m^3, at rest).
    pub volume: f64,
    /// Mass removed (kg); 0 when masses are kept.
    pub mass: f64,
    /// Elastic energy (J) that left with the elements.
    pub elastic_energy: f64,
    /// Kinetic energy (J) that left with the mass.
    pub kinetic_energy: f64,
    /// Whether tables and edge graph were compacted.
    pub compacted: bool,
    /// Host time taken.
    pub time: Duration,
}

impl RemovalReport {
    /// Fills in what was removed from a body and what is left of it.
    pub(super) fn fill(
        &mut self,
        own: &BodyResection,
        rows: &BodyRows,
        chosen: &Chosen,
        touched: &Touched,
    ) {
        let sorted = |of: &[u32], order: &[u32]| {
            let mut user: Vec<u32> = of.iter().map(|&i| order[i as usize]).collect();
            user.sort_unstable();
            user
        };
        let removed = ElementKind::ALL.map(|kind| sorted(&chosen[kind], &rows.order[kind]));
        [self.tetrahedra, self.triangles, self.hexahedra, self.quads] = removed;
        let left = ElementKind::ALL.map(|kind| own.connectivity.remaining(kind));
        [
            self.remaining,
            self.remaining_triangles,
            self.remaining_hexahedra,
            self.remaining_quads,
        ] = left;
        let is_of_mesh = |row: &&u32| (**row as usize) < rows.vertex_order.len();
        let orphans = touched.orphans.iter().filter(is_of_mesh);
        self.orphans = orphans.map(|&row| rows.vertex_of(LocalRow(row))).collect();
        self.orphans.sort_unstable();
        self.pieces = own.pieces;
        self.edges = touched.unused_edges.len();
        self.faces = touched.unused_triangles.len() + touched.unused_faces;
    }
}

/// A removal that cannot be carried out; nothing has changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RemovalError {
    /// There is no such body.
    #[error("there is no body {index}: the world has {count}")]
    Body {
        /// Index asked for.
        index: usize,
        /// Number of bodies.
        count: usize,
    },
    /// There is no such element.
    #[error("body `{body}` has no {kind} {index}: indices must be below {count}")]
    Element {
        /// Name of the body.
        body: String,
        /// [`ElementKind::name`].
        kind: &'static str,
        /// Index asked for.
        index: u32,
        /// Number of those in the user's mesh.
        count: usize,
    },
    /// It is gone already, or named twice.
    #[error(
        "{kind} {index} of body `{body}` was removed before or is named twice; ask which ones are left"
    )]
    Removed {
        /// Name of the body.
        body: String,
        /// [`ElementKind::name`].
        kind: &'static str,
        /// Index asked for.
        index: u32,
    },
    /// A number of the region cannot be used.
    #[error("region of the removal: {quantity} is {value}, it must be {range}")]
    Region {
        /// Which number.
        quantity: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        range: &'static str,
    },
    /// The tables of the bodies were changed from outside.
    #[error(
        "nothing can be removed from body `{body}`: a component was added to or removed from a vertex \
         or element entity (or one was despawned), so the order of rows is lost; keep such data on \
         entities of your own"
    )]
    LayoutChanged {
        /// Name of the body.
        body: String,
    },
}
