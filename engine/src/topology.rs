//! What the bodies of a world share: their row ranges and the edge graph, on which every tangent
//! lives (all springs of a tetrahedron couple its own vertices).

use crate::element::{
    AxisVertices, EdgeVertices, MembraneVertices, TetrahedronVertices, TriangleEdges,
};
use crate::isoparametric::{
    AxisHexahedronVertices, AxisTetrahedron10Vertices, HexahedronVertices, QuadVertices,
    Tetrahedron10Vertices,
};
use crate::layout::{BodyElements, starts};
use crate::row::{LocalRow, MeshVertex, VertexRow};
use crate::sets::DisjointSets;
use crate::vertex::RestPosition;
use bevy_ecs::archetype::ArchetypeId;
use bevy_ecs::prelude::{Resource, World};
use std::ops::{Deref, Range};

/// A body of a world: its index into [`Topology::bodies`]. Only good for the world that gave it out; methods panic on the
/// handle of another one that has more bodies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BodyHandle(pub usize);

/// Rows of one body.
#[derive(Clone, Debug)]
pub struct BodyRows {
    /// Name that the user gave.
    pub name: String,
    /// Rows of the vertex table.
    pub vertices: Range<u32>,
    /// Indices into [`Topology::edges`].
    pub blocks: Range<u32>,
    /// Vertices and elements; rows are relative to `vertices.start`.
    pub ordered: BodyElements,
    /// Longest side of the rest bounding box (m).
    pub size: f64,
    /// Connected piece of each vertex row (relative to `vertices.start`), counted from 0; filled by
    /// [`Topology::push`]. [`UNUSED`](crate::layout::UNUSED) for a vertex without an element, which
    /// removing elements may leave.
    pub piece: Vec<u32>,
    /// Counts up when the body falls into other pieces.
    pub splits: u64,
    /// Counts up when elements are removed or the material changes: surface and stiffness are others.
    pub changes: u64,
}

impl Deref for BodyRows {
    type Target = BodyElements;
    fn deref(&self) -> &BodyElements {
        &self.ordered
    }
}

impl BodyRows {
    /// Rows of a body that is longest `size` (m), for [`Topology::push`], which fills the ranges in.
    pub fn new(name: String, ordered: BodyElements, size: f64) -> Self {
        let (vertices, blocks) = (0..0, 0..0);
        Self { name, vertices, blocks, ordered, size, piece: Vec::new(), splits: 0, changes: 0 }
    }

    /// Notes the connected piece of each vertex row. A row that comes to a piece, as those of cuts do, is no split.
    pub fn set_pieces(&mut self, piece: Vec<u32>) {
        let mut both = self.piece.iter().zip(&piece);
        let splits = both.any(|(was, now)| *was != crate::layout::UNUSED && was != now);
        self.splits += u64::from(splits);
        self.piece = piece;
    }

    /// Whether it has no element any more.
    pub fn is_empty(&self) -> bool {
        self.piece.iter().all(|&piece| piece == crate::layout::UNUSED)
    }

    /// Number of connected pieces.
    pub fn piece_count(&self) -> usize {
        let pieces = self.piece.iter().filter(|&&p| p != crate::layout::UNUSED);
        pieces.max().map_or(0, |&p| p as usize + 1)
    }

    /// Number of vertices of the user's mesh, those without an element included. It is good for one
    /// [`Topology::revision`].
    pub fn mesh_vertices(&self) -> usize {
        self.row_of_vertex.len()
    }

    /// Row of a vertex of the user's mesh, `None` when no element uses it.
    pub fn row(&self, vertex: impl Into<MeshVertex>) -> Option<VertexRow> {
        let local = *self.row_of_vertex.get(vertex.into())?;
        local.map(|local| self.in_table(local))
    }

    /// Rows of vertices of the user's mesh; `None` when one is in no element.
    pub fn rows(&self, vertices: &[impl Into<MeshVertex> + Copy]) -> Option<Vec<VertexRow>> {
        vertices.iter().map(|&vertex| self.row(vertex)).collect()
    }

    /// Row in the table of all bodies.
    pub fn in_table(&self, row: LocalRow) -> VertexRow {
        VertexRow(self.vertices.start + row.0)
    }

    /// Row of this body, counted from its first; `None` when the row is another body's.
    pub fn local(&self, row: VertexRow) -> Option<LocalRow> {
        self.vertices.contains(&row.0).then(|| LocalRow(row.0 - self.vertices.start))
    }

    /// Vertex of the user's mesh that has a row of this body, or that a ghost there is of.
    ///
    /// # Panics
    /// When the row is another body's.
    pub fn vertex(&self, row: VertexRow) -> MeshVertex {
        self.vertex_of(LocalRow(row.0 - self.vertices.start))
    }

    /// Vertices of the user's mesh with their rows, in the order of rows; ghosts are none of them.
    pub fn vertices_and_rows(&self) -> impl Iterator<Item = (MeshVertex, VertexRow)> + Clone {
        self.vertex_order.iter().copied().zip(self.vertices.clone().map(VertexRow))
    }
}

/// Bodies and edge graph of a world.
#[derive(Resource, Clone, Debug)]
pub struct Topology {
    /// Bodies in the order in which they were spawned.
    pub bodies: Vec<BodyRows>,
    /// Vertex rows of the edge graph, lower first, sorted: block `i` of a tangent couples `edges[i]`.
    pub edges: Vec<[u32; 2]>,
    /// First edge of each lower vertex (compressed rows, one entry more than vertices).
    pub edge_start: Vec<u32>,
    /// Edges that no element uses any more, as far as it is long: blocks of zeros.
    pub unused_edges: Vec<bool>,
    /// Counts up whenever rows change; caches built on rows compare it.
    pub revision: u64,
}

impl Default for Topology {
    fn default() -> Self {
        Self {
            bodies: Vec::new(),
            edges: Vec::new(),
            edge_start: vec![0],
            unused_edges: Vec::new(),
            revision: 0,
        }
    }
}

impl Topology {
    /// Number of vertices of all bodies.
    pub fn vertex_count(&self) -> usize {
        self.edge_start.len() - 1
    }

    /// Block that couples two vertex rows, `None` when no element joins them.
    pub fn block(&self, a: u32, b: u32) -> Option<u32> {
        let (low, high) = (a.min(b), a.max(b));
        let from = *self.edge_start.get(low as usize)?;
        let to = *self.edge_start.get(low as usize + 1)?;
        let own = self.edges.get(from as usize..to as usize)?;
        Some(from + own.binary_search(&[low, high]).ok()? as u32)
    }

    /// Appends a body whose vertices and edges follow all others; `edges` in local rows.
    pub fn push(&mut self, mut body: BodyRows, edges: &[[u32; 2]]) {
        let (v0, e0) = (self.vertex_count() as u32, self.edges.len() as u32);
        let n = body.row_count();
        body.piece = pieces(n, edges.iter().copied());
        let used = n - body.spare;
        body.piece[used..].fill(crate::layout::UNUSED);
        body.vertices = v0..v0 + n as u32;
        body.blocks = e0..e0 + edges.len() as u32;
        let local = starts(n, edges.iter().map(|e| e[0]));
        self.edge_start.extend(local[1..].iter().map(|s| s + e0));
        self.edges.extend(edges.iter().map(|e| [e[0] + v0, e[1] + v0]));
        self.bodies.push(body);
        self.revision += 1;
    }

    /// Whether some element uses an edge.
    #[inline]
    pub fn uses_edge(&self, edge: usize) -> bool {
        !self.unused_edges.get(edge).copied().unwrap_or(false)
    }

    /// The edges of a body that some element uses, as vertex rows.
    pub fn used_edges(&self, body: usize) -> impl Iterator<Item = [u32; 2]> {
        let blocks = self.bodies[body].blocks.clone();
        let used = blocks.map(|edge| edge as usize).filter(|&edge| self.uses_edge(edge));
        used.map(|edge| self.edges[edge])
    }

    /// Index of the body of a given name. One without elements has lost its name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.bodies.iter().position(|body| body.name == name && !body.is_empty())
    }

    /// Body of a given name.
    pub fn body(&self, name: &str) -> Option<&BodyRows> {
        self.find(name).map(|index| &self.bodies[index])
    }
}

/// Number of the connected piece of every vertex.
pub(crate) fn pieces(n: usize, edges: impl IntoIterator<Item = [u32; 2]>) -> Vec<u32> {
    let mut sets = DisjointSets::new(n);
    for [a, b] in edges {
        sets.join(a, b);
    }
    sets.count()
}

/// Archetypes of vertices and elements, with their entities, as the bodies were spawned. An entity
/// that leaves its archetype changes the order of rows even if it comes back; since archetypes stay
/// once they exist, the one it went to gives it away.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq)]
pub struct ElementTables(Vec<(ArchetypeId, usize)>);

impl ElementTables {
    /// What the world holds now.
    pub fn of(world: &World) -> Self {
        let kinds = [
            world.component_id::<RestPosition>(),
            world.component_id::<EdgeVertices>(),
            world.component_id::<TriangleEdges>(),
            world.component_id::<TetrahedronVertices>(),
            world.component_id::<MembraneVertices>(),
            world.component_id::<HexahedronVertices>(),
            world.component_id::<Tetrahedron10Vertices>(),
            world.component_id::<QuadVertices>(),
            world.component_id::<AxisHexahedronVertices>(),
            world.component_id::<AxisTetrahedron10Vertices>(),
            world.component_id::<AxisVertices>(),
        ];
        // a world has many archetypes, one for each of its resources among them
        let (archetypes, index) = (world.archetypes(), world.archetypes().component_index());
        let with = kinds.iter().flatten().filter_map(|kind| index.get(kind));
        let mut with: Vec<ArchetypeId> = with.flat_map(|with| with.keys().copied()).collect();
        with.sort_unstable();
        with.dedup();
        Self(with.into_iter().map(|id| (id, archetypes[id].len() as usize)).collect())
    }

    /// The archetypes.
    pub(crate) fn archetypes(&self) -> impl Iterator<Item = ArchetypeId> + use<> {
        let ids: Vec<ArchetypeId> = self.0.iter().map(|(id, _)| *id).collect();
        ids.into_iter()
    }

    /// Number of entities.
    pub fn entities(&self) -> usize {
        self.0.iter().map(|(_, count)| count).sum()
    }
}
