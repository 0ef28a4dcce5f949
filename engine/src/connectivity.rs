//! Which elements of a body are left and what hangs together through them: plain data, kept up to date while elements are removed at a cost that grows with their number
//! alone. Numbers are local to the body and those of its layout; they never change.

use crate::element_kind::local_triangles;
pub use crate::element_kind::{ByKind, ElementKind, PerElement};
use crate::isoparametric::HEXAHEDRON_FACES;
use crate::layout::{BodyElements, Cells, UNUSED, starts};
use crate::sets::DisjointSets;
use crate::topology::{BodyRows, pieces};

/// Elements of one kind round vertices, edges or triangles, in ascending order.
#[derive(Clone, Debug, Default)]
pub struct Incidence {
    start: Vec<u32>,
    elements: Vec<u32>,
}

impl Incidence {
    /// Of `count` items, from the items of every element.
    pub fn new(count: usize, items: &PerElement) -> Self {
        let start = starts(count, items.flat().iter().copied());
        let mut next = start.clone();
        let mut elements = vec![0; items.flat().len()];
        for (t, items) in (0..).zip(items.iter()) {
            for &item in items {
                elements[next[item as usize] as usize] = t;
                next[item as usize] += 1;
            }
        }
        Self { start, elements }
    }

    /// Elements round an item, removed ones included.
    #[inline]
    pub fn of(&self, item: u32) -> &[u32] {
        let item = item as usize;
        &self.elements[self.start[item] as usize..self.start[item + 1] as usize]
    }

    /// Number of elements round every item.
    fn counts(&self) -> Vec<u32> {
        self.start.windows(2).map(|w| w[1] - w[0]).collect()
    }
}

/// Number of elements of any kind round each of `count` items.
fn counted(count: usize, round: &ByKind<Incidence>) -> Vec<u32> {
    let mut sum = vec![0; count];
    for own in round.iter() {
        sum.iter_mut().zip(own.counts()).for_each(|(sum, n)| *sum += n);
    }
    sum
}

/// Connectivity of a body whose elements are removed.
#[derive(Clone, Debug, Default)]
pub struct Connectivity {
    /// Elements of the whole body.
    pub ordered: BodyElements,
    /// Edges, triangles and faces of the whole body.
    pub cells: Cells,
    /// Elements round every vertex.
    pub round_vertex: ByKind<Incidence>,
    /// Elements round every edge.
    pub round_edge: ByKind<Incidence>,
    /// Tetrahedra at every triangle.
    pub round_triangle: Incidence,
    /// Hexahedra at every face.
    pub round_face: Incidence,
    /// Membrane triangle at every triangle, [`UNUSED`] where there is none.
    pub membrane_at: Vec<u32>,
    present: ByKind<Vec<bool>>,
    remaining: ByKind<usize>,
    /// Elements of any kind round vertices and edges; tetrahedra at triangles; hexahedra at faces.
    vertex_count: Vec<u32>,
    edge_count: Vec<u32>,
    triangle_count: Vec<u32>,
    face_count: Vec<u32>,
    /// Triangles with one tetrahedron, and faces with one hexahedron.
    surface: OpenSet,
    open_faces: OpenSet,
    /// Of vertices; every one is alone between calls.
    sets: DisjointSets,
}

/// A set of numbers in which every one knows its place.
#[derive(Clone, Debug, Default)]
struct OpenSet {
    items: Vec<u32>,
    place: Vec<u32>,
}

impl OpenSet {
    /// Those that are counted once.
    fn new(count: &[u32]) -> Self {
        let mut set = Self { items: Vec::new(), place: vec![UNUSED; count.len()] };
        for (i, &count) in (0..).zip(count) {
            set.update(i, count == 1);
        }
        set
    }

    fn update(&mut self, item: u32, belongs: bool) {
        let place = self.place[item as usize];
        match (belongs, place == UNUSED) {
            (true, true) => {
                self.place[item as usize] = self.items.len() as u32;
                self.items.push(item);
            }
            (false, false) => {
                self.items.swap_remove(place as usize);
                if let Some(&moved) = self.items.get(place as usize) {
                    self.place[moved as usize] = place;
                }
                self.place[item as usize] = UNUSED;
            }
            _ => {}
        }
    }
}

/// What a batch of removals touched: everything ascending, each once.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Touched {
    /// Vertices of the removed elements.
    pub vertices: Vec<u32>,
    /// Their edges.
    pub edges: Vec<u32>,
    /// Their triangles, those of membranes included.
    pub triangles: Vec<u32>,
    /// Vertices among them that have no element any more.
    pub orphans: Vec<u32>,
    /// Edges among them that have no element any more.
    pub unused_edges: Vec<u32>,
    /// Triangles among them that have no element any more.
    pub unused_triangles: Vec<u32>,
    /// Number of faces of hexahedra that no hexahedron has any more.
    pub unused_faces: usize,
    /// Whether the number of pieces may be another than before.
    pub may_split: bool,
}

impl Connectivity {
    /// Of a whole body.
    pub fn new(body: &BodyRows) -> Self {
        Self::of(body, Cells::new(body.row_count(), &body.nodes))
    }

    /// Of a whole body that differs from the one of this in some elements, by their rows, and in new ones after all others.
    pub fn after(&self, body: &BodyRows, changed: &ByKind<Vec<u32>>) -> Self {
        let kinds = ElementKind::ALL.into_iter().filter(|&kind| !changed[kind].is_empty());
        let after = |cells: Option<Cells>, kind| {
            let before = cells.as_ref().unwrap_or(&self.cells);
            Some(before.after(kind, &body.nodes[kind], &changed[kind]))
        };
        Self::of(body, kinds.fold(None, after).unwrap_or_else(|| self.cells.clone()))
    }

    fn of(body: &BodyRows, cells: Cells) -> Self {
        let n = body.row_count();
        let edges = cells.edges.len();
        let round_vertex = ByKind::of(|kind| Incidence::new(n, &body.nodes[kind]));
        let round_edge = ByKind::of(|kind| Incidence::new(edges, &cells.edges_of[kind]));
        let round_triangle = Incidence::new(cells.triangles.len(), &cells.triangles_of.tetrahedra);
        let triangle_count = round_triangle.counts();
        let round_face = Incidence::new(cells.faces.len(), &cells.faces_of);
        let face_count = round_face.counts();
        let mut membrane_at = vec![UNUSED; cells.triangles.len()];
        for (t, &triangle) in (0..).zip(cells.triangles_of.triangles.flat()) {
            membrane_at[triangle as usize] = t;
        }
        Self {
            present: ByKind::of(|kind| vec![true; body.order[kind].len()]),
            remaining: ByKind::of(|kind| body.order[kind].len()),
            vertex_count: counted(n, &round_vertex),
            edge_count: counted(edges, &round_edge),
            surface: OpenSet::new(&triangle_count),
            open_faces: OpenSet::new(&face_count),
            triangle_count,
            face_count,
            sets: DisjointSets::new(n),
            ordered: body.ordered.clone(),
            cells,
            round_vertex,
            round_edge,
            round_triangle,
            round_face,
            membrane_at,
        }
    }

    /// Vertex rows of an element.
    #[inline]
    pub fn vertices(&self, kind: ElementKind, element: u32) -> &[u32] {
        self.ordered.nodes[kind].of(element)
    }

    /// Edges of an element, in the order of its local pairs.
    #[inline]
    pub fn edges(&self, kind: ElementKind, element: u32) -> &[u32] {
        self.cells.edges_of[kind].of(element)
    }

    /// Number of elements, removed ones included.
    pub fn count(&self, kind: ElementKind) -> usize {
        self.present[kind].len()
    }

    /// Whether an element is left.
    #[inline]
    pub fn is_present(&self, kind: ElementKind, element: u32) -> bool {
        self.present[kind][element as usize]
    }

    /// Number of elements left.
    pub fn remaining(&self, kind: ElementKind) -> usize {
        self.remaining[kind]
    }

    /// Whether some element uses an edge.
    pub fn uses_edge(&self, edge: u32) -> bool {
        self.edge_count[edge as usize] > 0
    }

    /// Whether some element uses a triangle.
    pub fn uses_triangle(&self, triangle: u32) -> bool {
        let membrane = self.membrane_at[triangle as usize];
        self.triangle_count[triangle as usize] > 0
            || (membrane != UNUSED && self.is_present(ElementKind::Triangle, membrane))
    }

    /// Whether some element uses a vertex.
    pub fn uses_vertex(&self, vertex: u32) -> bool {
        self.vertex_count[vertex as usize] > 0
    }

    /// Elements that are left among some.
    pub fn left<'a>(
        &'a self,
        kind: ElementKind,
        among: &'a [u32],
    ) -> impl Iterator<Item = u32> + 'a {
        among.iter().copied().filter(move |&e| self.is_present(kind, e))
    }

    /// All elements that are left.
    pub fn all_left(&self, kind: ElementKind) -> impl Iterator<Item = u32> + '_ {
        (0..).zip(&self.present[kind]).filter(|(_, present)| **present).map(|(e, _)| e)
    }

    /// Triangles of the surface of the solid, outward, each with the element behind it; those of tetrahedra first,
    /// else in no particular order, but the same one for the same removals. Faces of hexahedra are cut along the
    /// diagonal from their lowest vertex row, into two triangles that follow each other, those of ten-node tetrahedra into [four](crate::isoparametric::TETRAHEDRON10_FACES).
    pub fn surface(&self) -> impl Iterator<Item = ([u32; 3], ElementKind, u32)> + '_ {
        let triangles = self.surface.items.iter().map(|&triangle| {
            let round = self.round_triangle.of(triangle);
            let t = self.left(ElementKind::Tetrahedron, round).next().unwrap_or(0);
            let faces = self.cells.triangles_of.tetrahedra.of(t);
            let face = faces.iter().position(|&f| f == triangle).unwrap_or(0);
            let vertices = self.ordered.nodes.tetrahedra.of(t);
            let local = local_triangles(ElementKind::Tetrahedron, vertices.len())[face];
            (local.map(|v| vertices[v]), ElementKind::Tetrahedron, t)
        });
        let quads = self.open_faces.items.iter().flat_map(|&face| {
            let round = self.round_face.of(face);
            let h = self.left(ElementKind::Hexahedron, round).next().unwrap_or(0);
            let faces = self.cells.faces_of.of(h);
            let local = faces.iter().position(|&f| f == face).unwrap_or(0);
            let mut q = HEXAHEDRON_FACES[local].map(|v| self.ordered.nodes.hexahedra.of(h)[v]);
            let lowest = (0..4).min_by_key(|&i| q[i]).unwrap_or(0);
            q.rotate_left(lowest);
            let brick = move |triangle| (triangle, ElementKind::Hexahedron, h);
            [[q[0], q[1], q[2]], [q[0], q[2], q[3]]].map(brick)
        });
        triangles.chain(quads)
    }

    /// Takes elements out; they must be left and be named once.
    pub fn remove(&mut self, removed: &ByKind<Vec<u32>>) -> Touched {
        let mut touched = Touched::default();
        let mut faces = Vec::new();
        for kind in ElementKind::ALL {
            for &e in &removed[kind] {
                self.present[kind][e as usize] = false;
                touched.vertices.extend_from_slice(self.vertices(kind, e));
                touched.edges.extend_from_slice(self.edges(kind, e));
                touched.triangles.extend_from_slice(self.cells.triangles_of[kind].of(e));
                if kind == ElementKind::Tetrahedron {
                    let own = self.cells.triangles_of.tetrahedra.of(e);
                    own.iter().for_each(|&f| self.triangle_count[f as usize] -= 1);
                } else if kind == ElementKind::Hexahedron {
                    let own = self.cells.faces_of.of(e);
                    own.iter().for_each(|&f| self.face_count[f as usize] -= 1);
                    faces.extend_from_slice(own);
                }
            }
            self.remaining[kind] -= removed[kind].len();
        }
        for &v in &touched.vertices {
            self.vertex_count[v as usize] -= 1;
        }
        for &e in &touched.edges {
            self.edge_count[e as usize] -= 1;
        }
        for list in [&mut touched.vertices, &mut touched.edges, &mut touched.triangles] {
            list.sort_unstable();
            list.dedup();
        }
        let unused = |list: &[u32], count: &[u32]| -> Vec<u32> {
            list.iter().copied().filter(|&i| count[i as usize] == 0).collect()
        };
        touched.orphans = unused(&touched.vertices, &self.vertex_count);
        touched.unused_edges = unused(&touched.edges, &self.edge_count);
        let unused = touched.triangles.iter().copied().filter(|&f| !self.uses_triangle(f));
        touched.unused_triangles = unused.collect();
        for &f in &touched.triangles {
            self.surface.update(f, self.triangle_count[f as usize] == 1);
        }
        faces.sort_unstable();
        faces.dedup();
        for &f in &faces {
            self.open_faces.update(f, self.face_count[f as usize] == 1);
        }
        touched.unused_faces = faces.iter().filter(|&&f| self.face_count[f as usize] == 0).count();
        touched.may_split = self.may_split(removed, &touched.vertices);
        touched
    }

    /// Whether pieces may have split or vanished. They have not when whatever the removed elements
    /// held together still hangs together through their neighbours: every way that led through them
    /// can then go round.
    fn may_split(&mut self, removed: &ByKind<Vec<u32>>, vertices: &[u32]) -> bool {
        let mut sets = std::mem::take(&mut self.sets);
        let mut seen: Vec<u32> = vertices.to_vec();
        let mut join = |sets: &mut DisjointSets, vertices: &[u32]| {
            for &v in vertices {
                seen.push(v);
                sets.join(vertices[0], v);
            }
        };
        for &v in vertices {
            for kind in ElementKind::ALL {
                for e in self.left(kind, self.round_vertex[kind].of(v)) {
                    join(&mut sets, self.vertices(kind, e));
                }
            }
        }
        // components that hold elements: roots of used vertices
        let mut alive: Vec<u32> = vertices
            .iter()
            .filter(|&&v| self.vertex_count[v as usize] > 0)
            .map(|&v| sets.root(v))
            .collect();
        alive.sort_unstable();
        alive.dedup();
        let this = &*self;
        let of_kind = |kind| removed[kind].iter().map(move |&e| this.vertices(kind, e));
        let gone: Vec<&[u32]> = ElementKind::ALL.into_iter().flat_map(of_kind).collect();
        for vertices in &gone {
            join(&mut sets, vertices);
        }
        // the removed elements must join none of them, and be joined to one each
        let mut joined: Vec<u32> = alive.iter().map(|&v| sets.root(v)).collect();
        joined.sort_unstable();
        let before = joined.len();
        joined.dedup();
        let vanished = gone.iter().any(|vertices| {
            let own = sets.root(vertices[0]);
            joined.binary_search(&own).is_err()
        });
        let may_split = joined.len() < before || vanished;
        for v in seen {
            sets.release(v);
        }
        self.sets = sets;
        may_split
    }

    /// Number of the connected piece of every vertex, [`UNUSED`] for one without an element. Linear
    /// in the size of the body.
    pub fn pieces(&self) -> Vec<u32> {
        let edges = self.cells.edges.iter().zip(&self.edge_count);
        let used = edges.filter(|(_, count)| **count > 0).map(|(&edge, _)| edge);
        let mut piece = pieces(self.vertex_count.len(), used);
        // number the pieces with elements without gaps
        let mut number = vec![UNUSED; self.vertex_count.len()];
        let mut count = 0;
        for (p, &elements) in piece.iter_mut().zip(&self.vertex_count) {
            if elements == 0 {
                *p = UNUSED;
                continue;
            }
            let number = &mut number[*p as usize];
            if *number == UNUSED {
                *number = count;
                count += 1;
            }
            *p = *number;
        }
        piece
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::generate::box_tets;
    use glam::DVec3;

    /// A box of tetrahedra and a wall of hexahedra on the same vertices, with a membrane on
    /// the surface and through some of the inside if asked for.
    fn body(cells: [usize; 3], skin: bool) -> BodyRows {
        let mesh = box_tets(DVec3::ONE, cells).unwrap();
        let [nx, ny, nz] = cells.map(|n| n as u32 + 1);
        let at = |i: u32, j: u32, k: u32| (k * ny + j) * nx + i;
        let mut hexahedra = Vec::new();
        // hexahedra overlap with the tetrahedra, which matters nothing here
        for (k, j, i) in (0..nz - 1).flat_map(|k| (0..ny - 1).map(move |j| (k, j, 0u32))) {
            let corner = |x, y, z| at(i + x, j + y, k + z);
            let low = [corner(0, 0, 0), corner(1, 0, 0), corner(1, 1, 0), corner(0, 1, 0)];
            let high = [corner(0, 0, 1), corner(1, 0, 1), corner(1, 1, 1), corner(0, 1, 1)];
            let [a, b, c, d] = low;
            let [e, f, g, h] = high;
            hexahedra.push([a, b, c, d, e, f, g, h]);
        }
        let (mut membrane, mut quads) = (Vec::new(), Vec::new());
        if skin {
            membrane = mesh.surface_triangles();
            let inner = mesh.tetrahedra.iter().step_by(3).map(|t| [t[0], t[1], t[2]]);
            membrane.extend(inner);
            membrane.iter_mut().for_each(|t| t.sort_unstable());
            membrane.sort_unstable();
            membrane.dedup();
            quads.extend(hexahedra.iter().map(|h| [h[0], h[1], h[2], h[3]]));
        }
        let nodes = ByKind {
            tetrahedra: mesh.tetrahedra.into(),
            triangles: membrane.into(),
            hexahedra: hexahedra.into(),
            quads: quads.into(),
        };
        BodyRows::new(String::new(), BodyElements::new(mesh.points.len(), &nodes), 1.0)
    }

    /// Everything that is kept up to date equals what follows from the elements that are left, and
    /// the local test never misses a split.
    #[test]
    fn updates_equal_a_fresh_count() {
        let mut state = 1u64;
        let mut next = move |n: usize| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 33) as usize) % n
        };
        let cases = [[1, 1, 1], [4, 1, 1], [3, 3, 2]].into_iter();
        for (cells, skin) in cases.flat_map(|cells| [(cells, false), (cells, true)]) {
            let body = body(cells, skin);
            let mut connectivity = Connectivity::new(&body);
            let mut pieces = connectivity.pieces().iter().max().copied();
            let mut splits = 0;
            while ElementKind::ALL.iter().any(|&kind| connectivity.remaining(kind) > 0) {
                let mut batch = ByKind::<Vec<u32>>::default();
                for kind in ElementKind::ALL {
                    let left: Vec<u32> = connectivity.all_left(kind).collect();
                    let count = if left.is_empty() { 0 } else { next(5) };
                    batch[kind] = (0..count).map(|_| left[next(left.len())]).collect();
                    batch[kind].sort_unstable();
                    batch[kind].dedup();
                }
                let touched = connectivity.remove(&batch);
                let left = ByKind::of(|kind| {
                    let nodes = &body.nodes[kind];
                    let left = connectivity.all_left(kind).flat_map(|e| nodes.of(e).to_vec());
                    PerElement::filled(nodes.width(), left)
                });
                for kind in ElementKind::ALL {
                    assert_eq!(left[kind].len(), connectivity.remaining(kind));
                }
                let fresh = Cells::new(body.vertex_order.len(), &left);
                let cells = &connectivity.cells;
                let edges: Vec<[u32; 2]> = (0..cells.edges.len() as u32)
                    .filter(|&e| connectivity.uses_edge(e))
                    .map(|e| cells.edges[e as usize])
                    .collect();
                assert_eq!(edges, fresh.edges);
                let triangles: Vec<[u32; 3]> = (0..cells.triangles.len() as u32)
                    .filter(|&f| connectivity.uses_triangle(f))
                    .map(|f| cells.triangles[f as usize])
                    .collect();
                assert_eq!(triangles, fresh.triangles);
                let mut surface: Vec<[u32; 3]> = connectivity
                    .surface()
                    .map(|(mut f, ..)| {
                        f.sort_unstable();
                        f
                    })
                    .collect();
                surface.sort_unstable();
                let once =
                    |faces: &[u32], f: usize| faces.iter().filter(|&&g| g == f as u32).count() == 1;
                let faces = fresh.triangles_of.tetrahedra.flat();
                let open = (0..fresh.triangles.len()).filter(|&f| once(faces, f));
                let mut boundary: Vec<[u32; 3]> = open.map(|f| fresh.triangles[f]).collect();
                for (h, own) in left.hexahedra.iter().zip(fresh.faces_of.iter()) {
                    for (local, &f) in HEXAHEDRON_FACES.iter().zip(own) {
                        if once(fresh.faces_of.flat(), f as usize) {
                            let mut q = local.map(|v| h[v]);
                            let lowest = (0..4).min_by_key(|&i| q[i]).unwrap();
                            q.rotate_left(lowest);
                            for mut t in [[q[0], q[1], q[2]], [q[0], q[2], q[3]]] {
                                t.sort_unstable();
                                boundary.push(t);
                            }
                        }
                    }
                }
                boundary.sort_unstable();
                assert_eq!(surface, boundary);
                let now = connectivity.pieces();
                let count = now.iter().filter(|&&p| p != UNUSED).max().copied();
                if count != pieces {
                    assert!(touched.may_split, "{pieces:?} -> {count:?}");
                }
                splits += u32::from(touched.may_split);
                pieces = count;
                for &v in &touched.orphans {
                    assert_eq!(now[v as usize], UNUSED);
                }
                assert_eq!(connectivity.sets, DisjointSets::new(connectivity.vertex_count.len()));
            }
            assert!(splits > 0);
            assert!(connectivity.pieces().iter().all(|&p| p == UNUSED));
        }
    }
}
