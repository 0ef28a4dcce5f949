//! From a mesh in the user's order to the order in which the engine stores it, and the edges,
//! triangles and incidences that follow from its elements. Plain data; rows are local to a body.
//!
//! Vertices are put in reverse Cuthill-McKee order and elements are sorted by their lowest row, so
//! that a range of elements touches a short span of vertices: that keeps gathers in cache and makes
//! the private arrays of [`crate::law`] small.

use crate::element::{TETRAHEDRON_EDGES, TETRAHEDRON_FACES};
use crate::element_kind::ElementKind;
use crate::isoparametric::{
    HEXAHEDRON_FACES, HEXAHEDRON_PAIRS, QUAD_PAIRS, TETRAHEDRON10_FACES, TETRAHEDRON10_PAIRS,
};
use crate::row::{IndexVec, LocalRow, MeshVertex};
use std::ops::Deref;

/// Row that stands for "not part of the body".
pub const UNUSED: u32 = u32::MAX;

/// Elements of a body: vertex indices, valid and distinct in every element.
#[derive(Clone, Copy, Debug, Default)]
pub struct ElementLists<'a> {
    /// Tetrahedra.
    pub tetrahedra: &'a [[u32; 4]],
    /// Ten-node tetrahedra; a body has tetrahedra of one order only.
    pub tetrahedra10: &'a [[u32; 10]],
    /// Hexahedra.
    pub hexahedra: &'a [[u32; 8]],
    /// Membrane triangles.
    pub membrane: &'a [[u32; 3]],
    /// Membrane quadrilaterals.
    pub quads: &'a [[u32; 4]],
}

impl ElementLists<'_> {
    /// Every pair of vertices that share an element, pairs of several elements several times.
    fn pairs(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let sheets = self.membrane.iter().flat_map(|&[a, b, c]| [[b, c], [a, c], [a, b]]);
        let quads = self.quads.iter().flat_map(|q| QUAD_PAIRS.map(|[a, b]| [q[a], q[b]]));
        let tetrahedra =
            self.tetrahedra.iter().flat_map(|t| TETRAHEDRON_EDGES.map(|[a, b]| [t[a], t[b]]));
        let hexahedra =
            self.hexahedra.iter().flat_map(|h| HEXAHEDRON_PAIRS.map(|[a, b]| [h[a], h[b]]));
        let tens = self.tetrahedra10.iter();
        let tens = tens.flat_map(|t| TETRAHEDRON10_PAIRS.map(|[a, b]| [t[a], t[b]]));
        sheets.chain(quads).chain(tetrahedra).chain(tens).chain(hexahedra)
    }
}

/// Vertices and elements of a body in engine order.
#[derive(Clone, Debug, Default)]
pub struct BodyElements {
    /// Vertex of the user's mesh in every row.
    pub vertex_order: IndexVec<LocalRow, MeshVertex>,
    /// Row of every vertex of the user's mesh that some element uses.
    pub row_of_vertex: IndexVec<MeshVertex, Option<LocalRow>>,
    /// Vertex rows of the tetrahedra. Local vertices are renumbered, orientation kept, so that the
    /// lowest row comes first and the next lowest second.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Vertex rows of the ten-node tetrahedra, in the user's local order. They are tetrahedra as far as
    /// [`ElementKind`] goes, and a body has one of the two lists only.
    pub tetrahedra10: Vec<[u32; 10]>,
    /// Tetrahedron row -> index in the user's mesh, of either order.
    pub tetrahedron_order: Vec<u32>,
    /// Vertex rows of the membrane triangles, ascending. They are no faces by themselves: an edge or a
    /// face that a membrane shares with a tetrahedron is there once.
    pub membrane: Vec<[u32; 3]>,
    /// Membrane triangle row -> index in the user's list.
    pub membrane_order: Vec<u32>,
    /// Vertex rows of the hexahedra, in the user's local order.
    pub hexahedra: Vec<[u32; 8]>,
    /// Hexahedron row -> index in the user's mesh.
    pub hexahedron_order: Vec<u32>,
    /// Vertex rows of the membrane quadrilaterals, in the user's local order.
    pub quads: Vec<[u32; 4]>,
    /// Quadrilateral row -> index in the user's list.
    pub quad_order: Vec<u32>,
}

impl BodyElements {
    /// Orders a mesh of `vertex_count` vertices with valid, distinct indices.
    pub fn new(vertex_count: usize, elements: &ElementLists) -> Self {
        let vertex_order = reverse_cuthill_mckee(vertex_count, elements);
        let mut row_of_vertex = IndexVec::from(vec![None; vertex_count]);
        for (row, &vertex) in (0..).map(LocalRow).zip(&vertex_order) {
            row_of_vertex[vertex] = Some(row);
        }
        let (mut tetrahedron_order, tetrahedra) = ordered(elements.tetrahedra, &row_of_vertex);
        let (order, tetrahedra10) = ordered(elements.tetrahedra10, &row_of_vertex);
        tetrahedron_order.extend(order);
        let (membrane_order, membrane) = ordered(elements.membrane, &row_of_vertex);
        let (hexahedron_order, hexahedra) = ordered(elements.hexahedra, &row_of_vertex);
        let (quad_order, quads) = ordered(elements.quads, &row_of_vertex);
        Self {
            vertex_order,
            row_of_vertex,
            tetrahedra: tetrahedra.into_iter().map(lowest_first).collect(),
            tetrahedra10,
            tetrahedron_order,
            membrane: membrane.into_iter().map(|[a, b, c]| sorted3(a, b, c)).collect(),
            membrane_order,
            hexahedra,
            hexahedron_order,
            quads,
            quad_order,
        }
    }

    /// The elements by vertex rows.
    pub fn elements(&self) -> ElementLists<'_> {
        ElementLists {
            tetrahedra: &self.tetrahedra,
            tetrahedra10: &self.tetrahedra10,
            hexahedra: &self.hexahedra,
            membrane: &self.membrane,
            quads: &self.quads,
        }
    }

    /// Element row -> index in the user's mesh or list.
    pub fn order(&self, kind: ElementKind) -> &[u32] {
        match kind {
            ElementKind::Tetrahedron => &self.tetrahedron_order,
            ElementKind::Triangle => &self.membrane_order,
            ElementKind::Hexahedron => &self.hexahedron_order,
            ElementKind::Quad => &self.quad_order,
        }
    }

    /// Index in the user's mesh or list -> element row.
    pub fn rows_of(&self, kind: ElementKind) -> Vec<u32> {
        let order = self.order(kind);
        let mut rows = vec![0; order.len()];
        (0..).zip(order).for_each(|(row, &index)| rows[index as usize] = row);
        rows
    }

    /// Vertex rows of an element.
    #[inline]
    pub fn nodes(&self, kind: ElementKind, element: u32) -> &[u32] {
        let i = element as usize;
        match kind {
            ElementKind::Tetrahedron if !self.tetrahedra10.is_empty() => &self.tetrahedra10[i],
            ElementKind::Tetrahedron => &self.tetrahedra[i],
            ElementKind::Triangle => &self.membrane[i],
            ElementKind::Hexahedron => &self.hexahedra[i],
            ElementKind::Quad => &self.quads[i],
        }
    }
}

/// A body's mesh in engine order, with the edges and faces of its elements.
#[derive(Clone, Debug, Default)]
pub struct BodyLayout {
    /// Vertices and elements.
    pub ordered: BodyElements,
    /// Edges, triangles and faces.
    pub cells: Cells,
}

impl Deref for BodyLayout {
    type Target = BodyElements;
    fn deref(&self) -> &BodyElements {
        &self.ordered
    }
}

impl BodyLayout {
    /// Orders a mesh of `vertex_count` vertices without membranes; `tetrahedra` must hold valid, distinct
    /// indices (which [`crate::mesh`]'s check guarantees).
    pub fn new(vertex_count: usize, tetrahedra: &[[u32; 4]]) -> Self {
        Self::with_membrane(vertex_count, tetrahedra, &[])
    }

    /// Orders a mesh of tetrahedra and membrane triangles with valid, distinct indices. Both share
    /// vertices and edges where they share indices.
    pub fn with_membrane(
        vertex_count: usize,
        tetrahedra: &[[u32; 4]],
        membrane: &[[u32; 3]],
    ) -> Self {
        Self::of(vertex_count, &ElementLists { tetrahedra, membrane, ..ElementLists::default() })
    }

    /// Orders a mesh of any elements; all share vertices and edges where they share indices.
    pub fn of(vertex_count: usize, elements: &ElementLists) -> Self {
        let ordered = BodyElements::new(vertex_count, elements);
        let cells = Cells::new(ordered.vertex_order.len(), &ordered.elements());
        Self { ordered, cells }
    }
}

/// Elements sorted by their vertex rows: the order, and the rows in the order of local vertices.
fn ordered<const N: usize>(
    elements: &[[u32; N]],
    row_of_vertex: &IndexVec<MeshVertex, Option<LocalRow>>,
) -> (Vec<u32>, Vec<[u32; N]>) {
    let row = |v| row_of_vertex[MeshVertex(v)].map_or(UNUSED, |row| row.0);
    let rows = |e: u32| elements[e as usize].map(row);
    let mut order: Vec<u32> = (0..elements.len() as u32).collect();
    order.sort_by_cached_key(|&e| {
        let mut key = rows(e);
        key.sort_unstable();
        (key, e)
    });
    let sorted = order.iter().map(|&e| rows(e)).collect();
    (order, sorted)
}

/// Edges, triangles and quadrilateral faces of the elements of a body.
#[derive(Clone, Debug, Default)]
pub struct Cells {
    /// Vertex rows of the edges, lower first, sorted: all pairs of vertices that share an element,
    /// diagonals of quadrilaterals and hexahedra included.
    pub edges: Vec<[u32; 2]>,
    /// Edge rows of the tetrahedra in local edge order.
    pub tetrahedron_edges: Vec<[u32; 6]>,
    /// Edge rows of the ten-node tetrahedra in the order of [`TETRAHEDRON10_PAIRS`].
    pub tetrahedron10_edges: Vec<[u32; 45]>,
    /// Triangle rows of the ten-node tetrahedra in the order of [`TETRAHEDRON10_FACES`].
    pub tetrahedron10_triangles: Vec<[u32; 16]>,
    /// Vertex rows of the triangles, ascending, sorted.
    pub triangles: Vec<[u32; 3]>,
    /// Edge rows of the triangles, edge `i` opposite vertex `i`.
    pub triangle_edges: Vec<[u32; 3]>,
    /// Triangle rows of the tetrahedra; face `i` lies opposite vertex `i`.
    pub tetrahedron_triangles: Vec<[u32; 4]>,
    /// Edge rows of the membrane triangles, edge `i` opposite vertex `i`.
    pub membrane_edges: Vec<[u32; 3]>,
    /// Row of every membrane triangle in `triangles`.
    pub membrane_triangles: Vec<u32>,
    /// Edge rows of the hexahedra in the order of [`HEXAHEDRON_PAIRS`].
    pub hexahedron_edges: Vec<[u32; 28]>,
    /// Edge rows of the membrane quadrilaterals in the order of [`QUAD_PAIRS`].
    pub quad_edges: Vec<[u32; 6]>,
    /// Vertex rows of the faces of hexahedra, ascending, sorted.
    pub faces: Vec<[u32; 4]>,
    /// Face rows of the hexahedra in the order of [`HEXAHEDRON_FACES`].
    pub hexahedron_faces: Vec<[u32; 6]>,
}

impl Cells {
    /// Of elements given by their vertex rows, below `vertex_count`; those of membrane triangles
    /// ascending.
    pub fn new(vertex_count: usize, elements: &ElementLists) -> Self {
        let ElementLists { tetrahedra, tetrahedra10, hexahedra, membrane, quads } = *elements;
        let mut edges: Vec<[u32; 2]> = elements.pairs().map(|[a, b]| sorted2(a, b)).collect();
        edges.sort_unstable();
        edges.dedup();
        let mut triangles: Vec<[u32; 3]> = tetrahedra
            .iter()
            .flat_map(|t| TETRAHEDRON_FACES.map(|[a, b, c]| sorted3(t[a], t[b], t[c])))
            .chain(
                tetrahedra10
                    .iter()
                    .flat_map(|t| TETRAHEDRON10_FACES.map(|[a, b, c]| sorted3(t[a], t[b], t[c]))),
            )
            .chain(membrane.iter().copied())
            .collect();
        triangles.sort_unstable();
        triangles.dedup();
        let face_rows = |h: &[u32; 8]| {
            HEXAHEDRON_FACES.map(|face| {
                let mut rows = face.map(|v| h[v]);
                rows.sort_unstable();
                rows
            })
        };
        let mut faces: Vec<[u32; 4]> = hexahedra.iter().flat_map(face_rows).collect();
        faces.sort_unstable();
        faces.dedup();

        let edge_start = starts(vertex_count, edges.iter().map(|e| e[0]));
        let triangle_start = starts(vertex_count, triangles.iter().map(|t| t[0]));
        let edge_row = |a: u32, b: u32| {
            let key = sorted2(a, b);
            let (from, to) = (edge_start[key[0] as usize], edge_start[key[0] as usize + 1]);
            from + edges[from as usize..to as usize].binary_search(&key).unwrap_or(0) as u32
        };
        let triangle_row = |a: u32, b: u32, c: u32| {
            let key = sorted3(a, b, c);
            let (from, to) = (triangle_start[key[0] as usize], triangle_start[key[0] as usize + 1]);
            from + triangles[from as usize..to as usize].binary_search(&key).unwrap_or(0) as u32
        };
        let opposite =
            |t: &[u32; 3]| [edge_row(t[1], t[2]), edge_row(t[2], t[0]), edge_row(t[0], t[1])];
        let face_row = |face: [u32; 4]| faces.binary_search(&face).unwrap_or(0) as u32;
        Self {
            tetrahedron_edges: tetrahedra
                .iter()
                .map(|t| TETRAHEDRON_EDGES.map(|[a, b]| edge_row(t[a], t[b])))
                .collect(),
            tetrahedron10_edges: tetrahedra10
                .iter()
                .map(|t| TETRAHEDRON10_PAIRS.map(|[a, b]| edge_row(t[a], t[b])))
                .collect(),
            tetrahedron10_triangles: tetrahedra10
                .iter()
                .map(|t| TETRAHEDRON10_FACES.map(|[a, b, c]| triangle_row(t[a], t[b], t[c])))
                .collect(),
            triangle_edges: triangles.iter().map(opposite).collect(),
            tetrahedron_triangles: tetrahedra
                .iter()
                .map(|t| TETRAHEDRON_FACES.map(|[a, b, c]| triangle_row(t[a], t[b], t[c])))
                .collect(),
            membrane_edges: membrane.iter().map(opposite).collect(),
            membrane_triangles: membrane.iter().map(|&[a, b, c]| triangle_row(a, b, c)).collect(),
            hexahedron_edges: hexahedra
                .iter()
                .map(|h| HEXAHEDRON_PAIRS.map(|[a, b]| edge_row(h[a], h[b])))
                .collect(),
            quad_edges: quads
                .iter()
                .map(|q| QUAD_PAIRS.map(|[a, b]| edge_row(q[a], q[b])))
                .collect(),
            hexahedron_faces: hexahedra.iter().map(|h| face_rows(h).map(face_row)).collect(),
            edges,
            triangles,
            faces,
        }
    }

    /// Edges of an element, in the order of its local pairs.
    #[inline]
    pub fn edges_of(&self, kind: ElementKind, element: u32) -> &[u32] {
        let i = element as usize;
        match kind {
            ElementKind::Tetrahedron if !self.tetrahedron10_edges.is_empty() => {
                &self.tetrahedron10_edges[i]
            }
            ElementKind::Tetrahedron => &self.tetrahedron_edges[i],
            ElementKind::Triangle => &self.membrane_edges[i],
            ElementKind::Hexahedron => &self.hexahedron_edges[i],
            ElementKind::Quad => &self.quad_edges[i],
        }
    }

    /// Triangles on the surface of a tetrahedron of either order.
    #[inline]
    pub fn triangles_of(&self, tetrahedron: u32) -> &[u32] {
        let i = tetrahedron as usize;
        match self.tetrahedron10_triangles.is_empty() {
            true => &self.tetrahedron_triangles[i],
            false => &self.tetrahedron10_triangles[i],
        }
    }
}

/// An even permutation that puts the lowest entry first and the next lowest second. Then only the
/// edge of the last two local vertices may run against the order of rows.
fn lowest_first(mut t: [u32; 4]) -> [u32; 4] {
    let lowest = (0..4).min_by_key(|&i| t[i]).unwrap_or(0);
    if lowest != 0 {
        // two exchanges
        t.swap(0, lowest);
        let (a, b) = if lowest == 1 {
            (2, 3)
        } else if lowest == 2 {
            (1, 3)
        } else {
            (1, 2)
        };
        t.swap(a, b);
    }
    let second = (1..4).min_by_key(|&i| t[i]).unwrap_or(1);
    match second {
        2 => [t[0], t[2], t[3], t[1]],
        3 => [t[0], t[3], t[1], t[2]],
        _ => t,
    }
}

fn sorted2(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

fn sorted3(a: u32, b: u32, c: u32) -> [u32; 3] {
    let mut t = [a, b, c];
    t.sort_unstable();
    t
}

/// Compressed-row starts for sorted `keys` in `0..n`.
pub fn starts(n: usize, keys: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut start = vec![0u32; n + 1];
    for k in keys {
        start[k as usize + 1] += 1;
    }
    for i in 0..n {
        start[i + 1] += start[i];
    }
    start
}

/// Reverse Cuthill-McKee order of the vertices that some element uses. Each component starts
/// from a vertex far from everything (two breadth-first sweeps), which keeps the bandwidth low.
fn reverse_cuthill_mckee(n: usize, elements: &ElementLists) -> IndexVec<LocalRow, MeshVertex> {
    // adjacency in compressed rows, duplicates removed
    let mut pairs: Vec<[u32; 2]> = elements.pairs().flat_map(|[a, b]| [[a, b], [b, a]]).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let start = starts(n, pairs.iter().map(|p| p[0]));
    let neighbours = |v: u32| &pairs[start[v as usize] as usize..start[v as usize + 1] as usize];
    let degree = |v: u32| start[v as usize + 1] - start[v as usize];

    let mut placed = vec![false; n];
    let mut order = Vec::with_capacity(n);
    let mut mark = vec![0u32; n];
    let mut sweep = 0;
    let mut next_ring: Vec<u32> = Vec::new();
    for seed in 0..n as u32 {
        if placed[seed as usize] || degree(seed) == 0 {
            continue;
        }
        let mut root = seed;
        for _ in 0..2 {
            sweep += 1;
            mark[root as usize] = sweep;
            let mut queue = vec![root];
            let (mut ring, mut head) = (0, 0);
            while head < queue.len() {
                ring = head;
                let end = queue.len();
                while head < end {
                    for p in neighbours(queue[head]) {
                        if mark[p[1] as usize] != sweep {
                            mark[p[1] as usize] = sweep;
                            queue.push(p[1]);
                        }
                    }
                    head += 1;
                }
            }
            // least-degree vertex of the last ring
            root = queue[ring..].iter().copied().min_by_key(|&v| (degree(v), v)).unwrap_or(root);
        }
        placed[root as usize] = true;
        let mut head = order.len();
        order.push(root);
        while head < order.len() {
            next_ring.clear();
            for p in neighbours(order[head]) {
                if !placed[p[1] as usize] {
                    placed[p[1] as usize] = true;
                    next_ring.push(p[1]);
                }
            }
            next_ring.sort_by_key(|&v| (degree(v), v));
            order.extend_from_slice(&next_ring);
            head += 1;
        }
    }
    order.into_iter().rev().map(MeshVertex).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_tetrahedra_share_a_face() {
        let layout = BodyLayout::new(6, &[[0, 1, 2, 3], [1, 2, 3, 5]]);
        assert_eq!(layout.vertex_order.len(), 5);
        assert_eq!(layout.row_of_vertex[MeshVertex(4)], None);
        assert_eq!(layout.cells.edges.len(), 9);
        assert_eq!(layout.cells.triangles.len(), 7);
        for (t, edges) in layout.tetrahedra.iter().zip(&layout.cells.tetrahedron_edges) {
            for (local, &e) in edges.iter().enumerate() {
                let [a, b] = TETRAHEDRON_EDGES[local];
                assert_eq!(layout.cells.edges[e as usize], sorted2(t[a], t[b]));
            }
        }
        for (t, faces) in layout.tetrahedra.iter().zip(&layout.cells.tetrahedron_triangles) {
            for (local, &f) in faces.iter().enumerate() {
                let [a, b, c] = TETRAHEDRON_FACES[local];
                assert_eq!(layout.cells.triangles[f as usize], sorted3(t[a], t[b], t[c]));
            }
        }
        for t in &layout.tetrahedra {
            assert!(t[0] < t[1] && t[1] < t[2].min(t[3]));
        }
        for (t, edges) in layout.cells.triangles.iter().zip(&layout.cells.triangle_edges) {
            assert_eq!(layout.cells.edges[edges[0] as usize], sorted2(t[1], t[2]));
            assert_eq!(layout.cells.edges[edges[1] as usize], sorted2(t[2], t[0]));
        }
    }

    #[test]
    fn a_membrane_shares_the_edges_of_the_solid() {
        // a triangle on a face of the tetrahedron, and one that hangs on an edge of it
        let layout = BodyLayout::with_membrane(6, &[[0, 1, 2, 3]], &[[5, 2, 1], [2, 1, 0]]);
        assert_eq!(layout.vertex_order.len(), 5);
        assert_eq!((layout.cells.edges.len(), layout.cells.triangles.len()), (8, 5));
        for (i, t) in layout.membrane.iter().enumerate() {
            assert!(t[0] < t[1] && t[1] < t[2]);
            assert_eq!(layout.cells.triangles[layout.cells.membrane_triangles[i] as usize], *t);
            let edges = layout.cells.membrane_edges[i];
            assert_eq!(layout.cells.edges[edges[0] as usize], [t[1], t[2]]);
            assert_eq!(layout.cells.edges[edges[1] as usize], [t[0], t[2]]);
        }
        let mut order = layout.membrane_order.clone();
        order.sort_unstable();
        assert_eq!(order, [0, 1]);
        let alone = BodyLayout::with_membrane(3, &[], &[[2, 0, 1]]);
        assert_eq!(
            (alone.cells.edges.len(), alone.cells.triangles.len(), alone.tetrahedra.len()),
            (3, 1, 0)
        );
    }

    #[test]
    fn renumbering_keeps_the_orientation() {
        let parity = |t: [u32; 4]| {
            let pairs = (0..4).flat_map(|i| (0..i).map(move |j| (j, i)));
            pairs.filter(|&(j, i)| t[j] > t[i]).count() % 2
        };
        for code in 0..256u32 {
            let t = [code & 3, code >> 2 & 3, code >> 4 & 3, code >> 6];
            if (0..4).all(|v| t.contains(&v)) {
                let new = lowest_first(t);
                assert_eq!(parity(new), parity(t), "{t:?}");
                assert_eq!(new[..2], [0, 1]);
            }
        }
    }

    #[test]
    fn ordering_keeps_every_used_vertex_once_and_lowers_the_bandwidth() {
        // a 1 x 1 x 20 row of cells whose vertices are numbered at random
        let cells = 20u32;
        let shuffled = |i: u32| (i * 37) % (4 * (cells + 1) + 1);
        let mut tets = Vec::new();
        for c in 0..cells {
            let v = |k: u32| shuffled(4 * c + k);
            tets.push([v(0), v(1), v(2), v(4)]);
            tets.push([v(1), v(2), v(4), v(5)]);
        }
        let layout = BodyLayout::new(200, &tets);
        let mut seen: Vec<_> = layout.vertex_order.iter().collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), layout.vertex_order.len());
        let width = layout.cells.edges.iter().map(|e| e[1] - e[0]).max().unwrap();
        assert!(width <= 8, "bandwidth {width}");
    }
}
