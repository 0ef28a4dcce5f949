//! What the bodies of a world share: their row ranges and the edge graph, on which every tangent
//! lives (all springs of a tetrahedron couple its own vertices).

use crate::element::{
    AxisVertices, EdgeVertices, MembraneVertices, TetrahedronVertices, TriangleEdges,
};
use crate::element_kind::ElementKind;
use crate::isoparametric::{AxisHexahedronVertices, HexahedronVertices, QuadVertices};
use crate::layout::{BodyLayout, ElementLists, starts};
use crate::vertex::RestPosition;
use bevy_ecs::archetype::ArchetypeId;
use bevy_ecs::prelude::{Resource, World};
use std::ops::Range;

/// Rows of one body.
#[derive(Clone, Debug)]
pub struct BodyRows {
    /// Name that the user gave.
    pub name: String,
    /// Rows of the vertex table.
    pub vertices: Range<u32>,
    /// Indices into [`Topology::edges`].
    pub blocks: Range<u32>,
    /// Vertex row (relative to `vertices.start`) -> index in the user's mesh.
    pub vertex_order: Vec<u32>,
    /// Index in the user's mesh -> row relative to `vertices.start`, or [`crate::layout::UNUSED`].
    pub row_of_vertex: Vec<u32>,
    /// Tetrahedra in engine order: vertex rows relative to `vertices.start`.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Tetrahedron in engine order -> index in the user's mesh.
    pub tetrahedron_order: Vec<u32>,
    /// Membrane triangles in engine order: vertex rows relative to `vertices.start`, ascending.
    pub membrane: Vec<[u32; 3]>,
    /// Membrane triangle in engine order -> index in the user's list.
    pub membrane_order: Vec<u32>,
    /// Hexahedra in engine order: vertex rows relative to `vertices.start`, in the user's local order.
    pub hexahedra: Vec<[u32; 8]>,
    /// Hexahedron in engine order -> index in the user's mesh.
    pub hexahedron_order: Vec<u32>,
    /// Membrane quadrilaterals in engine order, likewise.
    pub quads: Vec<[u32; 4]>,
    /// Membrane quadrilateral in engine order -> index in the user's list.
    pub quad_order: Vec<u32>,
    /// Longest side of the rest bounding box (m).
    pub size: f64,
    /// Connected piece of each vertex row (relative to `vertices.start`), counted from 0; filled by
    /// [`Topology::push`]. [`UNUSED`](crate::layout::UNUSED) for a vertex without an element, which
    /// removing elements may leave.
    pub piece: Vec<u32>,
    /// Counts up when the body falls into other pieces.
    pub splits: u64,
}

impl BodyRows {
    /// Rows of a body of a layout that is longest `size` (m), for [`Topology::push`], which fills the
    /// ranges in.
    pub fn new(name: String, layout: &BodyLayout, size: f64) -> Self {
        Self {
            name,
            vertices: 0..0,
            blocks: 0..0,
            vertex_order: layout.vertex_order.clone(),
            row_of_vertex: layout.row_of_vertex.clone(),
            tetrahedra: layout.tetrahedra.clone(),
            tetrahedron_order: layout.tetrahedron_order.clone(),
            membrane: layout.membrane.clone(),
            membrane_order: layout.membrane_order.clone(),
            hexahedra: layout.hexahedra.clone(),
            hexahedron_order: layout.hexahedron_order.clone(),
            quads: layout.quads.clone(),
            quad_order: layout.quad_order.clone(),
            size,
            piece: Vec::new(),
            splits: 0,
        }
    }

    /// Element in engine order -> index in the user's mesh or list.
    pub fn order(&self, kind: ElementKind) -> &[u32] {
        match kind {
            ElementKind::Tetrahedron => &self.tetrahedron_order,
            ElementKind::Triangle => &self.membrane_order,
            ElementKind::Hexahedron => &self.hexahedron_order,
            ElementKind::Quad => &self.quad_order,
        }
    }

    /// Its elements by vertex rows relative to `vertices.start`.
    pub fn elements(&self) -> ElementLists<'_> {
        ElementLists {
            tetrahedra: &self.tetrahedra,
            hexahedra: &self.hexahedra,
            membrane: &self.membrane,
            quads: &self.quads,
        }
    }

    /// Number of connected pieces.
    pub fn piece_count(&self) -> usize {
        let pieces = self.piece.iter().filter(|&&p| p != crate::layout::UNUSED);
        pieces.max().map_or(0, |&p| p as usize + 1)
    }

    /// Vertex-table row of a vertex of the user's mesh, `None` when no element uses it.
    pub fn row(&self, vertex: u32) -> Option<u32> {
        let local = *self.row_of_vertex.get(vertex as usize)?;
        (local != crate::layout::UNUSED).then(|| self.vertices.start + local)
    }

    /// Rows of vertices of the user's mesh; `None` when one is in no element.
    pub fn rows(&self, vertices: &[u32]) -> Option<Vec<u32>> {
        vertices.iter().map(|&vertex| self.row(vertex)).collect()
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
        let n = body.vertex_order.len();
        body.piece = pieces(n, edges.iter().copied());
        body.vertices = v0..v0 + n as u32;
        body.blocks = e0..e0 + edges.len() as u32;
        let local = starts(n, edges.iter().map(|e| e[0]));
        self.edge_start.extend(local[1..].iter().map(|s| s + e0));
        self.edges.extend(edges.iter().map(|e| [e[0] + v0, e[1] + v0]));
        self.bodies.push(body);
        self.revision += 1;
    }

    /// Whether some element uses an edge.
    pub fn uses_edge(&self, edge: usize) -> bool {
        !self.unused_edges.get(edge).copied().unwrap_or(false)
    }

    /// Index of the edge between two vertex rows, `None` when the edge graph has none.
    pub fn find_edge(&self, a: u32, b: u32) -> Option<usize> {
        let key = [a.min(b), a.max(b)];
        let of = self.edge_start[key[0] as usize] as usize
            ..self.edge_start[key[0] as usize + 1] as usize;
        Some(of.start + self.edges[of].binary_search(&key).ok()?)
    }

    /// Body of a given name.
    pub fn body(&self, name: &str) -> Option<&BodyRows> {
        self.bodies.iter().find(|b| b.name == name)
    }
}

/// Representative of the set of `i` in a union-find forest.
pub(crate) fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        parent[i as usize] = parent[parent[i as usize] as usize];
        i = parent[i as usize];
    }
    i
}

/// Number of the connected piece of every vertex, by union-find along the edges.
pub(crate) fn pieces(n: usize, edges: impl IntoIterator<Item = [u32; 2]>) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..n as u32).collect();
    for [a, b] in edges {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        // the lower number stays root, so that pieces are numbered in row order
        parent[a.max(b) as usize] = a.min(b);
    }
    let mut number = vec![u32::MAX; n];
    let mut count = 0;
    (0..n as u32)
        .map(|i| {
            let r = root(&mut parent, i) as usize;
            if number[r] == u32::MAX {
                number[r] = count;
                count += 1;
            }
            number[r]
        })
        .collect()
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
            world.component_id::<QuadVertices>(),
            world.component_id::<AxisHexahedronVertices>(),
            world.component_id::<AxisVertices>(),
        ];
        let is_element =
            |a: &&bevy_ecs::archetype::Archetype| kinds.iter().flatten().any(|&k| a.contains(k));
        let archetypes = world.archetypes().iter().filter(is_element);
        Self(archetypes.map(|a| (a.id(), a.len() as usize)).collect())
    }

    /// Number of entities.
    pub fn entities(&self) -> usize {
        self.0.iter().map(|(_, count)| count).sum()
    }
}
