//! From a mesh in the user's order to the order in which the engine stores it, and the edges,
//! triangles and incidences that follow from its elements. Plain data; rows are local to a body.
//!
//! Vertices are put in reverse Cuthill-McKee order and elements are sorted by their lowest row, so
//! that a range of elements touches a short span of vertices: that keeps gathers in cache and makes
//! the private arrays of [`crate::law`] small. Within short pieces neighbours are then put far apart
//! ([`spread`]).

use crate::element::TRIANGLE_EDGES;
use crate::element_kind::{ByKind, ElementKind, PerElement, local_triangles, pairs};
use crate::isoparametric::HEXAHEDRON_FACES;
use crate::row::{IndexVec, LocalRow, MeshVertex};
use std::ops::Deref;

/// Row that stands for "not part of the body".
pub const UNUSED: u32 = u32::MAX;

/// Every pair of vertices that share an element, pairs of several elements several times.
fn all_pairs(nodes: &ByKind<PerElement>) -> impl Iterator<Item = [u32; 2]> {
    let of = move |kind| nodes[kind].at(pairs(kind, nodes[kind].width()));
    ElementKind::ALL.into_iter().flat_map(of)
}

/// Vertices and elements of a body in engine order.
#[derive(Clone, Debug, Default)]
pub struct BodyElements {
    /// Vertex of the user's mesh in every row.
    pub vertex_order: IndexVec<LocalRow, MeshVertex>,
    /// Row of every vertex of the user's mesh that some element uses.
    pub row_of_vertex: IndexVec<MeshVertex, Option<LocalRow>>,
    /// Vertex rows of the elements. Local vertices are in the user's order but in tetrahedra of four vertices, where
    /// the lowest row comes first and the next lowest second, orientation kept, and in membrane triangles, where rows
    /// ascend. Membrane triangles are no faces by themselves: an edge or a face that one shares with a tetrahedron is
    /// there once.
    pub nodes: ByKind<PerElement>,
    /// Index in the user's mesh or list of every element row.
    pub order: ByKind<Vec<u32>>,
    /// Rows after those of the mesh's vertices, for cuts: first the ghosts of [`Copies::ghosts`], then what is left.
    pub spare: usize,
    /// What cuts made of the elements.
    pub copies: Copies,
}

/// Volumes (m^3) of the vertices of an element, from which they have their masses and weights; 0 after the last one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lumps {
    /// For masses.
    pub mass: [f64; 10],
    /// For weights.
    pub weight: [f64; 10],
}

/// Parts of the area of a whole triangle at its corners.
pub const WHOLE_TRIANGLE: [f64; 3] = [1.0 / 3.0; 3];

/// What cuts made of the elements of a body; empty while it is whole. An element whose material falls apart becomes several
/// of the same shape, each with its share of the volume.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Copies {
    /// Row of the vertex of the mesh that every ghost is of. Ghosts move copies where these come apart; they belong to no
    /// vertex of the mesh, and nothing holds or loads them.
    pub ghosts: Vec<u32>,
    /// Element of the mesh, by its index there, that every copy is of; copies are numbered after all elements of the mesh.
    pub sources: Vec<u32>,
    /// Elements that can be parted: those of one kind.
    pub kind: ElementKind,
    /// Parts of the volume of every row of these that its material has at its corners: a quarter each where it is whole. Of
    /// hexahedra a quarter of their share.
    pub portions: Vec<[f64; 4]>,
    /// What the vertices of every row have, where elements are not linear tetrahedra; nothing where one is whole.
    pub lumps: Vec<Lumps>,
    /// Membrane triangle, by its index in the user's list, that every copy of one is of; numbered in the same way.
    pub sheet_sources: Vec<u32>,
    /// Parts of the area of every membrane triangle that are at its corners: a third each where it is whole.
    pub sheet_portions: Vec<[f64; 3]>,
}

impl BodyElements {
    /// Orders a mesh of `vertex_count` vertices, whose elements have valid, distinct ones.
    pub fn new(vertex_count: usize, elements: &ByKind<PerElement>) -> Self {
        let vertex_order = reverse_cuthill_mckee(vertex_count, elements);
        let mut row_of_vertex = IndexVec::from(vec![None; vertex_count]);
        for (row, &vertex) in (0..).map(LocalRow).zip(&vertex_order) {
            row_of_vertex[vertex] = Some(row);
        }
        let (mut nodes, mut order) = (ByKind::default(), ByKind::default());
        for kind in ElementKind::ALL {
            (order[kind], nodes[kind]) = match elements[kind].width() {
                3 => ordered::<3>(&elements[kind], &row_of_vertex, sorted),
                4 if kind == ElementKind::Tetrahedron => {
                    ordered(&elements[kind], &row_of_vertex, lowest_first)
                }
                4 => ordered::<4>(&elements[kind], &row_of_vertex, |quad| quad),
                8 => ordered::<8>(&elements[kind], &row_of_vertex, |hexahedron| hexahedron),
                _ => ordered::<10>(&elements[kind], &row_of_vertex, |tetrahedron| tetrahedron),
            };
        }
        Self { vertex_order, row_of_vertex, nodes, order, spare: 0, copies: Copies::default() }
    }

    /// Number of vertex rows.
    pub fn row_count(&self) -> usize {
        self.vertex_order.len() + self.spare
    }

    /// Vertex of the user's mesh that a row belongs to, or is a ghost of.
    pub fn vertex_of(&self, row: LocalRow) -> MeshVertex {
        let ghost = row.index().checked_sub(self.vertex_order.len());
        let source = ghost.map_or(row.0, |g| self.copies.ghosts.get(g).copied().unwrap_or(0));
        self.vertex_order[LocalRow(source)]
    }

    /// Number of elements of the user's mesh, without copies.
    pub fn mesh_elements(&self, kind: ElementKind) -> usize {
        self.order[kind].len() - self.sources(kind).len()
    }

    /// Element of the mesh that every copy of a kind is of.
    pub fn sources(&self, kind: ElementKind) -> &[u32] {
        match kind {
            ElementKind::Triangle => &self.copies.sheet_sources,
            _ if kind == self.copies.kind => &self.copies.sources,
            _ => &[],
        }
    }

    /// Parts of the area of a membrane triangle, given by its row, that are at its corners.
    pub fn sheet_portion(&self, triangle: u32) -> [f64; 3] {
        self.copies.sheet_portions.get(triangle as usize).copied().unwrap_or(WHOLE_TRIANGLE)
    }

    /// Whether no cut parted an element, given by its row.
    pub fn is_whole(&self, kind: ElementKind, element: u32) -> bool {
        if kind == ElementKind::Triangle {
            return self.sheet_portion(element) == WHOLE_TRIANGLE;
        }
        let portion = self.copies.portions.get(element as usize);
        kind != self.copies.kind || portion.is_none_or(|portion| *portion == [0.25; 4])
    }

    /// What the vertices of an element have that a cut parted, if it is no linear tetrahedron.
    pub fn lumps(&self, kind: ElementKind, element: u32) -> Option<&Lumps> {
        let parted = !self.is_whole(kind, element);
        self.copies.lumps.get(element as usize).filter(|_| parted)
    }

    /// Index in the user's mesh of an element, for a copy that of the element it is of.
    pub fn source(&self, kind: ElementKind, index: u32) -> u32 {
        let copy = (index as usize).checked_sub(self.mesh_elements(kind));
        copy.map_or(index, |copy| self.sources(kind)[copy])
    }

    /// Vertex rows of the tetrahedra, where they have four vertices.
    pub fn tetrahedra(&self) -> &[[u32; 4]] {
        self.nodes.tetrahedra.each()
    }

    /// Vertex rows of the tetrahedra, where they have ten vertices.
    pub fn tetrahedra10(&self) -> &[[u32; 10]] {
        self.nodes.tetrahedra.each()
    }

    /// Vertex rows of the membrane triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        self.nodes.triangles.each()
    }

    /// Vertex rows of the hexahedra.
    pub fn hexahedra(&self) -> &[[u32; 8]] {
        self.nodes.hexahedra.each()
    }

    /// Vertex rows of the membrane quadrilaterals.
    pub fn quads(&self) -> &[[u32; 4]] {
        self.nodes.quads.each()
    }

    /// Index in the user's mesh or list -> element row.
    pub fn rows_of(&self, kind: ElementKind) -> Vec<u32> {
        let order = &self.order[kind];
        let mut rows = vec![0; order.len()];
        (0..).zip(order).for_each(|(row, &index)| rows[index as usize] = row);
        rows
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
    /// Orders a mesh of `vertex_count` vertices, whose elements have valid, distinct ones (which
    /// [`crate::mesh`]'s check guarantees). Elements share vertices and edges where they share indices.
    pub fn new(vertex_count: usize, elements: &ByKind<PerElement>) -> Self {
        Self::coupled(vertex_count, elements, |_| Vec::new())
    }

    /// The same, with pairs of vertex rows, the lower first, that forces couple although no element has both.
    pub fn coupled(
        vertex_count: usize,
        elements: &ByKind<PerElement>,
        pairs: impl FnOnce(&BodyElements) -> Vec<[u32; 2]>,
    ) -> Self {
        let ordered = BodyElements::new(vertex_count, elements);
        let pairs = pairs(&ordered);
        let cells = Cells::coupled(ordered.vertex_order.len(), &ordered.nodes, pairs);
        Self { ordered, cells }
    }
}

/// Items of a sorted list that are spread among each other, and into how many strips.
const PIECE: usize = 512;
const STRIPS: usize = 16;

/// The order in which tables hold the items of a list that is sorted by vertex rows: those that follow each other come
/// from different strips of a piece. Neighbours in the list share vertices, and adding to a row has to wait until
/// what was added just before is stored.
pub fn spread(count: usize) -> impl Iterator<Item = usize> {
    (0..count).step_by(PIECE).flat_map(move |first| {
        let end = count.min(first + PIECE);
        let strip = (end - first).div_ceil(STRIPS);
        (first..first + strip).flat_map(move |item| (item..end).step_by(strip))
    })
}

/// Elements sorted by their vertex rows and [`spread`]: the order, and the rows of local vertices, which `turn` puts in
/// order.
fn ordered<const N: usize>(
    elements: &PerElement,
    row_of_vertex: &IndexVec<MeshVertex, Option<LocalRow>>,
    turn: impl Fn([u32; N]) -> [u32; N],
) -> (Vec<u32>, PerElement) {
    let elements = elements.each::<N>();
    let row = |v| row_of_vertex[MeshVertex(v)].map_or(UNUSED, |row| row.0);
    let rows = |e: u32| elements[e as usize].map(row);
    let mut order: Vec<u32> = (0..elements.len() as u32).collect();
    order.sort_by_cached_key(|&e| (sorted(rows(e)), e));
    let order: Vec<u32> = spread(order.len()).map(|place| order[place]).collect();
    let rows: Vec<[u32; N]> = order.iter().map(|&e| turn(rows(e))).collect();
    (order, rows.into())
}

/// Edges, triangles and quadrilateral faces of the elements of a body.
#[derive(Clone, Debug, Default)]
pub struct Cells {
    /// Vertex rows of the edges, lower first, sorted: all pairs of vertices that share an element,
    /// diagonals of quadrilaterals and hexahedra included.
    pub edges: Vec<[u32; 2]>,
    /// Edge rows of pairs that no element has, but that forces couple.
    pub couplings: Vec<u32>,
    /// Edge rows of the elements in the order of their local edges or pairs: of [`TETRAHEDRON_EDGES`],
    /// [`TETRAHEDRON10_PAIRS`], [`TRIANGLE_EDGES`], [`HEXAHEDRON_PAIRS`] and [`QUAD_PAIRS`].
    ///
    /// [`TETRAHEDRON_EDGES`]: crate::element::TETRAHEDRON_EDGES
    /// [`TETRAHEDRON10_PAIRS`]: crate::isoparametric::TETRAHEDRON10_PAIRS
    /// [`TRIANGLE_EDGES`]: crate::element::TRIANGLE_EDGES
    /// [`HEXAHEDRON_PAIRS`]: crate::isoparametric::HEXAHEDRON_PAIRS
    /// [`QUAD_PAIRS`]: crate::isoparametric::QUAD_PAIRS
    pub edges_of: ByKind<PerElement>,
    /// Vertex rows of the triangles, ascending, sorted.
    pub triangles: Vec<[u32; 3]>,
    /// Edge rows of the triangles, edge `i` opposite vertex `i`.
    pub triangle_edges: Vec<[u32; 3]>,
    /// Triangle rows of the tetrahedra, in the order of [`TETRAHEDRON_FACES`](crate::element::TETRAHEDRON_FACES) or
    /// [`TETRAHEDRON10_FACES`](crate::isoparametric::TETRAHEDRON10_FACES), and that of every membrane triangle.
    pub triangles_of: ByKind<PerElement>,
    /// Vertex rows of the faces of hexahedra, ascending, sorted.
    pub faces: Vec<[u32; 4]>,
    /// Face rows of the hexahedra in the order of [`HEXAHEDRON_FACES`].
    pub faces_of: PerElement,
}

impl Cells {
    /// Of elements given by their vertex rows, below `vertex_count`; those of membrane triangles
    /// ascending.
    pub fn new(vertex_count: usize, nodes: &ByKind<PerElement>) -> Self {
        Self::coupled(vertex_count, nodes, Vec::new())
    }

    /// The same with pairs of vertex rows, the lower first, beside those of elements.
    fn coupled(vertex_count: usize, nodes: &ByKind<PerElement>, more: Vec<[u32; 2]>) -> Self {
        let mut edges =
            ascending(vertex_count, all_pairs(nodes).map(|[a, b]| sorted2(a, b)).collect());
        let mut more = more;
        more.retain(|pair| edges.binary_search(pair).is_err());
        more.sort_unstable();
        more.dedup();
        edges.extend_from_slice(&more);
        edges.sort_unstable();
        let is_more = |edge: &[u32; 2]| more.binary_search(edge).is_ok();
        let couplings = (0..).zip(&edges).filter(|(_, edge)| is_more(edge)).map(|(i, _)| i);
        let couplings = couplings.collect();
        let all_triangles = |kind| nodes[kind].at(local_triangles(kind, nodes[kind].width()));
        let triangles = ElementKind::ALL.into_iter().flat_map(all_triangles).map(sorted).collect();
        let triangles = ascending(vertex_count, triangles);
        let all_faces = || nodes.hexahedra.at(&HEXAHEDRON_FACES).map(sorted);
        let faces = ascending(vertex_count, all_faces().collect());

        let edge_start = starts(vertex_count, edges.iter().map(|e| e[0]));
        let triangle_start = starts(vertex_count, triangles.iter().map(|t| t[0]));
        let edge_row = |[a, b]: [u32; 2]| {
            let key = sorted2(a, b);
            let (from, to) = (edge_start[key[0] as usize], edge_start[key[0] as usize + 1]);
            from + edges[from as usize..to as usize].binary_search(&key).unwrap_or(0) as u32
        };
        let triangle_row = |triangle: [u32; 3]| {
            let key = sorted(triangle);
            let (from, to) = (triangle_start[key[0] as usize], triangle_start[key[0] as usize + 1]);
            from + triangles[from as usize..to as usize].binary_search(&key).unwrap_or(0) as u32
        };
        let face_row = |face| faces.binary_search(&face).unwrap_or(0) as u32;
        let edges_of = ByKind::of(|kind| {
            let local = pairs(kind, nodes[kind].width());
            PerElement::filled(local.len(), nodes[kind].at(local).map(edge_row))
        });
        let triangles_of = ByKind::of(|kind| {
            let local = local_triangles(kind, nodes[kind].width());
            PerElement::filled(local.len(), nodes[kind].at(local).map(triangle_row))
        });
        let faces_of = PerElement::filled(6, all_faces().map(face_row));
        let opposite = |t: &[u32; 3]| TRIANGLE_EDGES.map(|[a, b]| edge_row([t[a], t[b]]));
        let triangle_edges = triangles.iter().map(opposite).collect();
        Self {
            edges_of,
            triangles_of,
            faces_of,
            triangle_edges,
            edges,
            couplings,
            triangles,
            faces,
        }
    }
}

impl Cells {
    /// The same after some elements of a kind, by their rows, got other vertices or came to be. What no element has any more stays in
    /// the lists.
    pub fn after(&self, kind: ElementKind, nodes: &PerElement, changed: &[u32]) -> Self {
        fn at<const N: usize>(nodes: &PerElement, e: u32, local: [usize; N]) -> [u32; N] {
            sorted(local.map(|i| nodes.of(e)[i]))
        }
        fn all<const N: usize>(
            nodes: &PerElement,
            changed: &[u32],
            local: &[[usize; N]],
        ) -> Vec<[u32; N]> {
            let of = |&e: &u32| local.iter().map(move |own| at(nodes, e, *own));
            changed.iter().flat_map(of).collect()
        }
        let local_pairs = pairs(kind, nodes.width());
        let triangle_corners = local_triangles(kind, nodes.width());
        let quads: &[[usize; 4]] = match kind {
            ElementKind::Hexahedron => &HEXAHEDRON_FACES,
            _ => &[],
        };
        let (edges, edge) = with(&self.edges, all(nodes, changed, local_pairs));
        let (triangles, triangle) = with(&self.triangles, all(nodes, changed, triangle_corners));
        let (faces, face) = with(&self.faces, all(nodes, changed, quads));
        fn row<const N: usize>(list: &[[u32; N]], item: [u32; N]) -> u32 {
            list.binary_search(&item).unwrap_or(0) as u32
        }
        let own = |k: ElementKind| if k == kind { changed } else { &[] };
        let edges_of = ByKind::of(|k| {
            let of = |e, i: usize| row(&edges, at(nodes, e, local_pairs[i]));
            self.edges_of[k].renumbered(&edge, own(k), of)
        });
        let triangles_of = ByKind::of(|k| {
            let of = |e, i: usize| row(&triangles, at(nodes, e, triangle_corners[i]));
            self.triangles_of[k].renumbered(&triangle, own(k), of)
        });
        let of = |e, i: usize| row(&faces, at(nodes, e, quads[i]));
        let faces_of = self.faces_of.renumbered(&face, own(ElementKind::Hexahedron), of);
        let opposite = |t: &[u32; 3]| TRIANGLE_EDGES.map(|[a, b]| row(&edges, sorted2(t[a], t[b])));
        let mut triangle_edges = vec![[UNUSED; 3]; triangles.len()];
        for (own, &place) in self.triangle_edges.iter().zip(&triangle) {
            triangle_edges[place as usize] = own.map(|e| edge[e as usize]);
        }
        for (t, own) in triangles.iter().zip(&mut triangle_edges).filter(|(_, e)| e[0] == UNUSED) {
            *own = opposite(t);
        }
        let couplings = self.couplings.iter().map(|&e| edge[e as usize]).collect();
        Self {
            edges_of,
            triangles_of,
            faces_of,
            triangle_edges,
            edges,
            couplings,
            triangles,
            faces,
        }
    }
}

/// Some ascending items and more of them, ascending, each once, and the place of each of the former.
fn with<const N: usize>(items: &[[u32; N]], mut more: Vec<[u32; N]>) -> (Vec<[u32; N]>, Vec<u32>) {
    more.retain(|item| items.binary_search(item).is_err());
    more.sort_unstable();
    more.dedup();
    let mut all = [items, &more].concat();
    // two runs that are ascending, which a stable sort merges
    all.sort();
    let mut former = items.iter().peekable();
    let places = (0..).zip(&all).filter_map(|(i, item)| former.next_if_eq(&item).map(|_| i));
    let places = places.collect();
    (all, places)
}

/// An even permutation that puts the lowest entry first and the next lowest second. Then only the
/// edge of the last two local vertices may run against the order of rows.
pub fn lowest_first(mut t: [u32; 4]) -> [u32; 4] {
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

fn sorted<const N: usize>(mut rows: [u32; N]) -> [u32; N] {
    rows.sort_unstable();
    rows
}

/// Each of these once, ascending; their first numbers are below `count`. Those that share the first are few, so that no list of all is
/// sorted.
pub fn ascending<const N: usize>(count: usize, items: Vec<[u32; N]>) -> Vec<[u32; N]> {
    let start = starts(count, items.iter().map(|item| item[0]));
    let (mut next, mut all) = (start.clone(), vec![[0; N]; items.len()]);
    for item in items {
        let place = &mut next[item[0] as usize];
        all[*place as usize] = item;
        *place += 1;
    }
    start.windows(2).for_each(|own| all[own[0] as usize..own[1] as usize].sort_unstable());
    all.dedup();
    all
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
fn reverse_cuthill_mckee(
    n: usize,
    elements: &ByKind<PerElement>,
) -> IndexVec<LocalRow, MeshVertex> {
    // adjacency in compressed rows, duplicates removed
    let mut pairs: Vec<[u32; 2]> =
        all_pairs(elements).flat_map(|[a, b]| [[a, b], [b, a]]).collect();
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
    use crate::element::{TETRAHEDRON_EDGES, TETRAHEDRON_FACES};

    fn layout(n: usize, tetrahedra: &[[u32; 4]], triangles: &[[u32; 3]]) -> BodyLayout {
        let (tetrahedra, triangles) = (tetrahedra.into(), triangles.into());
        BodyLayout::new(n, &ByKind { tetrahedra, triangles, ..ByKind::default() })
    }

    #[test]
    fn two_tetrahedra_share_a_face() {
        let layout = layout(6, &[[0, 1, 2, 3], [1, 2, 3, 5]], &[]);
        assert_eq!(layout.vertex_order.len(), 5);
        assert_eq!(layout.row_of_vertex[MeshVertex(4)], None);
        assert_eq!(layout.cells.edges.len(), 9);
        assert_eq!(layout.cells.triangles.len(), 7);
        for (t, edges) in
            layout.nodes.tetrahedra.iter().zip(layout.cells.edges_of.tetrahedra.iter())
        {
            for (local, &e) in edges.iter().enumerate() {
                let [a, b] = TETRAHEDRON_EDGES[local];
                assert_eq!(layout.cells.edges[e as usize], sorted2(t[a], t[b]));
            }
        }
        let faces_of = layout.cells.triangles_of.tetrahedra.iter();
        for (t, faces) in layout.nodes.tetrahedra.iter().zip(faces_of) {
            for (local, &f) in faces.iter().enumerate() {
                let [a, b, c] = TETRAHEDRON_FACES[local];
                assert_eq!(layout.cells.triangles[f as usize], sorted([t[a], t[b], t[c]]));
            }
        }
        for t in layout.nodes.tetrahedra.iter() {
            assert!(t[0] < t[1] && t[1] < t[2].min(t[3]));
        }
        for (t, edges) in layout.cells.triangles.iter().zip(&layout.cells.triangle_edges) {
            assert_eq!(layout.cells.edges[edges[0] as usize], sorted2(t[1], t[2]));
            assert_eq!(layout.cells.edges[edges[1] as usize], sorted2(t[2], t[0]));
        }
    }

    #[test]
    fn spreading_parts_neighbours_and_keeps_all() {
        for count in [0, 1, 15, 16, 17, 512, 1000, 5040] {
            let order: Vec<usize> = spread(count).collect();
            let mut all = order.clone();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..count), "{count}");
            // pieces stay where they are
            assert!(order.iter().enumerate().all(|(to, from)| to / PIECE == from / PIECE));
            if count >= PIECE {
                let near = |pair: &[usize]| pair[0].abs_diff(pair[1]) < PIECE / STRIPS - 1;
                assert!(!order[..PIECE].windows(2).any(near), "{count}");
            }
        }
    }

    #[test]
    fn a_membrane_shares_the_edges_of_the_solid() {
        // a triangle on a face of the tetrahedron, and one that hangs on an edge of it
        let mixed = layout(6, &[[0, 1, 2, 3]], &[[5, 2, 1], [2, 1, 0]]);
        assert_eq!(mixed.vertex_order.len(), 5);
        assert_eq!((mixed.cells.edges.len(), mixed.cells.triangles.len()), (8, 5));
        for (i, t) in (0..).zip(mixed.nodes.triangles.each::<3>()) {
            assert!(t[0] < t[1] && t[1] < t[2]);
            assert_eq!(
                mixed.cells.triangles[mixed.cells.triangles_of.triangles.of(i)[0] as usize],
                *t
            );
            let edges = mixed.cells.edges_of.triangles.of(i);
            assert_eq!(mixed.cells.edges[edges[0] as usize], [t[1], t[2]]);
            assert_eq!(mixed.cells.edges[edges[1] as usize], [t[0], t[2]]);
        }
        let mut order = mixed.order.triangles.clone();
        order.sort_unstable();
        assert_eq!(order, [0, 1]);
        let alone = layout(3, &[], &[[2, 0, 1]]);
        assert_eq!(
            (alone.cells.edges.len(), alone.cells.triangles.len(), alone.nodes.tetrahedra.len()),
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
        let layout = layout(200, &tets, &[]);
        let mut seen: Vec<_> = layout.vertex_order.iter().collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), layout.vertex_order.len());
        let width = layout.cells.edges.iter().map(|e| e[1] - e[0]).max().unwrap();
        assert!(width <= 8, "bandwidth {width}");
    }
}
