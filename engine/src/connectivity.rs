//! Which elements of a body (tetrahedra, membrane triangles) are left and what hangs together through
//! them: plain data, kept up to date while elements are removed at a cost that grows with their number
//! alone. Numbers are local to the body and those of its layout; they never change.

use crate::element::TETRAHEDRON_FACES;
use crate::layout::{Cells, UNUSED, starts};
use crate::topology::{BodyRows, pieces, root};

/// Elements of one kind round vertices, edges or triangles, in ascending order.
#[derive(Clone, Debug, Default)]
pub struct Incidence {
    start: Vec<u32>,
    elements: Vec<u32>,
}

impl Incidence {
    /// Of `count` items, from the items of every element.
    fn new<const N: usize>(count: usize, items: &[[u32; N]]) -> Self {
        let start = starts(count, items.iter().flatten().copied());
        let mut next = start.clone();
        let mut elements = vec![0; items.len() * N];
        for (t, items) in items.iter().enumerate() {
            for &item in items {
                elements[next[item as usize] as usize] = t as u32;
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

    /// Number of elements of both kinds round every item.
    fn counts_with(&self, other: &Self) -> Vec<u32> {
        self.counts().iter().zip(other.counts()).map(|(a, b)| a + b).collect()
    }
}

/// Connectivity of a body whose elements are removed.
#[derive(Clone, Debug, Default)]
pub struct Connectivity {
    /// Vertex rows of the tetrahedra.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Vertex rows of the membrane triangles, ascending.
    pub membrane: Vec<[u32; 3]>,
    /// Edges and triangles of the whole body.
    pub cells: Cells,
    /// Tetrahedra round every vertex.
    pub round_vertex: Incidence,
    /// Tetrahedra round every edge.
    pub round_edge: Incidence,
    /// Tetrahedra at every triangle.
    pub round_triangle: Incidence,
    /// Membrane triangles round every vertex.
    pub membrane_round_vertex: Incidence,
    /// Membrane triangles round every edge.
    pub membrane_round_edge: Incidence,
    /// Membrane triangle at every triangle, [`UNUSED`] where there is none.
    pub membrane_at: Vec<u32>,
    present: Vec<bool>,
    membrane_present: Vec<bool>,
    remaining: usize,
    membrane_remaining: usize,
    /// Elements of either kind round vertices and edges; tetrahedra at triangles.
    vertex_count: Vec<u32>,
    edge_count: Vec<u32>,
    triangle_count: Vec<u32>,
    /// Triangles with one tetrahedron, and where each of them stands there.
    surface: Vec<u32>,
    surface_place: Vec<u32>,
    /// Union-find over vertices, every one its own root between calls.
    parent: Vec<u32>,
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
    /// Whether the number of pieces may be another than before.
    pub may_split: bool,
}

impl Connectivity {
    /// Of a whole body.
    pub fn new(body: &BodyRows) -> Self {
        let n = body.vertex_order.len();
        let tetrahedra = body.tetrahedra.clone();
        let cells = Cells::new(n, &tetrahedra, &body.membrane);
        let round_vertex = Incidence::new(n, &tetrahedra);
        let round_edge = Incidence::new(cells.edges.len(), &cells.tetrahedron_edges);
        let round_triangle = Incidence::new(cells.triangles.len(), &cells.tetrahedron_triangles);
        let triangle_count = round_triangle.counts();
        let membrane = body.membrane.clone();
        let membrane_round_vertex = Incidence::new(n, &membrane);
        let membrane_round_edge = Incidence::new(cells.edges.len(), &cells.membrane_edges);
        let mut membrane_at = vec![UNUSED; cells.triangles.len()];
        for (t, &triangle) in (0..).zip(&cells.membrane_triangles) {
            membrane_at[triangle as usize] = t;
        }
        let mut surface = Vec::new();
        let mut surface_place = vec![UNUSED; cells.triangles.len()];
        for (i, _) in triangle_count.iter().enumerate().filter(|(_, count)| **count == 1) {
            surface_place[i] = surface.len() as u32;
            surface.push(i as u32);
        }
        Self {
            present: vec![true; tetrahedra.len()],
            remaining: tetrahedra.len(),
            membrane_present: vec![true; membrane.len()],
            membrane_remaining: membrane.len(),
            vertex_count: round_vertex.counts_with(&membrane_round_vertex),
            edge_count: round_edge.counts_with(&membrane_round_edge),
            triangle_count,
            surface,
            surface_place,
            parent: (0..n as u32).collect(),
            tetrahedra,
            membrane,
            cells,
            round_vertex,
            round_edge,
            round_triangle,
            membrane_round_vertex,
            membrane_round_edge,
            membrane_at,
        }
    }

    /// Whether a tetrahedron is left.
    #[inline]
    pub fn is_present(&self, tetrahedron: u32) -> bool {
        self.present[tetrahedron as usize]
    }

    /// Whether a membrane triangle is left.
    #[inline]
    pub fn is_membrane_present(&self, triangle: u32) -> bool {
        self.membrane_present[triangle as usize]
    }

    /// Number of tetrahedra left.
    pub fn remaining(&self) -> usize {
        self.remaining
    }

    /// Number of membrane triangles left.
    pub fn membrane_remaining(&self) -> usize {
        self.membrane_remaining
    }

    /// Whether some element uses an edge.
    pub fn uses_edge(&self, edge: u32) -> bool {
        self.edge_count[edge as usize] > 0
    }

    /// Whether some element uses a triangle.
    pub fn uses_triangle(&self, triangle: u32) -> bool {
        let membrane = self.membrane_at[triangle as usize];
        self.triangle_count[triangle as usize] > 0
            || (membrane != UNUSED && self.is_membrane_present(membrane))
    }

    /// Whether some element uses a vertex.
    pub fn uses_vertex(&self, vertex: u32) -> bool {
        self.vertex_count[vertex as usize] > 0
    }

    /// Tetrahedra that are left among some.
    pub fn left<'a>(&'a self, among: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        among.iter().copied().filter(|&t| self.is_present(t))
    }

    /// Membrane triangles that are left among some.
    pub fn membrane_left<'a>(&'a self, among: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        among.iter().copied().filter(|&t| self.is_membrane_present(t))
    }

    /// Triangles of the surface of the solid, outward, each with the tetrahedron behind it; in no particular
    /// order, but the same one for the same removals.
    pub fn surface(&self) -> impl ExactSizeIterator<Item = ([u32; 3], u32)> + '_ {
        self.surface.iter().map(|&triangle| {
            let t = self.left(self.round_triangle.of(triangle)).next().unwrap_or(0);
            let faces = &self.cells.tetrahedron_triangles[t as usize];
            let face = faces.iter().position(|&f| f == triangle).unwrap_or(0);
            let vertices = self.tetrahedra[t as usize];
            (TETRAHEDRON_FACES[face].map(|v| vertices[v]), t)
        })
    }

    /// Takes tetrahedra and membrane triangles out; they must be left and be named once.
    pub fn remove(&mut self, removed: &[u32], membrane: &[u32]) -> Touched {
        let mut touched = Touched::default();
        for &t in removed {
            self.present[t as usize] = false;
            for v in self.tetrahedra[t as usize] {
                self.vertex_count[v as usize] -= 1;
                touched.vertices.push(v);
            }
            for e in self.cells.tetrahedron_edges[t as usize] {
                self.edge_count[e as usize] -= 1;
                touched.edges.push(e);
            }
            for f in self.cells.tetrahedron_triangles[t as usize] {
                self.triangle_count[f as usize] -= 1;
                touched.triangles.push(f);
            }
        }
        self.remaining -= removed.len();
        for &t in membrane {
            self.membrane_present[t as usize] = false;
            for v in self.membrane[t as usize] {
                self.vertex_count[v as usize] -= 1;
                touched.vertices.push(v);
            }
            for e in self.cells.membrane_edges[t as usize] {
                self.edge_count[e as usize] -= 1;
                touched.edges.push(e);
            }
            touched.triangles.push(self.cells.membrane_triangles[t as usize]);
        }
        self.membrane_remaining -= membrane.len();
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
            self.update_surface(f);
        }
        touched.may_split = self.may_split(removed, membrane, &touched.vertices);
        touched
    }

    fn update_surface(&mut self, triangle: u32) {
        let place = self.surface_place[triangle as usize];
        match (self.triangle_count[triangle as usize] == 1, place == UNUSED) {
            (true, true) => {
                self.surface_place[triangle as usize] = self.surface.len() as u32;
                self.surface.push(triangle);
            }
            (false, false) => {
                self.surface.swap_remove(place as usize);
                if let Some(&moved) = self.surface.get(place as usize) {
                    self.surface_place[moved as usize] = place;
                }
                self.surface_place[triangle as usize] = UNUSED;
            }
            _ => {}
        }
    }

    /// Whether pieces may have split or vanished. They have not when whatever the removed elements
    /// held together still hangs together through their neighbours: every way that led through them
    /// can then go round.
    fn may_split(&mut self, removed: &[u32], membrane: &[u32], vertices: &[u32]) -> bool {
        let mut parent = std::mem::take(&mut self.parent);
        let mut seen: Vec<u32> = vertices.to_vec();
        let mut join = |parent: &mut [u32], vertices: &[u32]| {
            for &v in vertices {
                seen.push(v);
                let (a, b) = (root(parent, vertices[0]), root(parent, v));
                parent[a.max(b) as usize] = a.min(b);
            }
        };
        for &v in vertices {
            for t in self.left(self.round_vertex.of(v)) {
                join(&mut parent, &self.tetrahedra[t as usize]);
            }
            for t in self.membrane_left(self.membrane_round_vertex.of(v)) {
                join(&mut parent, &self.membrane[t as usize]);
            }
        }
        // components that hold elements: roots of used vertices
        let mut alive: Vec<u32> = vertices
            .iter()
            .filter(|&&v| self.vertex_count[v as usize] > 0)
            .map(|&v| root(&mut parent, v))
            .collect();
        alive.sort_unstable();
        alive.dedup();
        let gone: Vec<&[u32]> = removed
            .iter()
            .map(|&t| &self.tetrahedra[t as usize][..])
            .chain(membrane.iter().map(|&t| &self.membrane[t as usize][..]))
            .collect();
        for vertices in &gone {
            join(&mut parent, vertices);
        }
        // the removed elements must join none of them, and be joined to one each
        let mut joined: Vec<u32> = alive.iter().map(|&v| root(&mut parent, v)).collect();
        joined.sort_unstable();
        let before = joined.len();
        joined.dedup();
        let vanished = gone.iter().any(|vertices| {
            let own = root(&mut parent, vertices[0]);
            joined.binary_search(&own).is_err()
        });
        let may_split = joined.len() < before || vanished;
        for v in seen {
            parent[v as usize] = v;
        }
        self.parent = parent;
        may_split
    }

    /// Number of the connected piece of every vertex, [`UNUSED`] for one without an element. Linear
    /// in the size of the body.
    pub fn pieces(&self) -> Vec<u32> {
        let edges = self.cells.edges.iter().zip(&self.edge_count);
        let used = edges.filter(|(_, count)| **count > 0).map(|(&edge, _)| edge);
        let mut piece = pieces(self.parent.len(), used);
        // number the pieces with elements without gaps
        let mut number = vec![UNUSED; self.parent.len()];
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
    use crate::layout::BodyLayout;
    use crate::mesh::generate::box_tets;
    use glam::DVec3;

    /// A box, with a membrane on its surface and through some of its inside if asked for.
    fn body(cells: [usize; 3], skin: bool) -> BodyRows {
        let mesh = box_tets(DVec3::ONE, cells).unwrap();
        let mut membrane = if skin { mesh.surface_triangles() } else { Vec::new() };
        if skin {
            let inner = mesh.tetrahedra.iter().step_by(3).map(|t| [t[0], t[1], t[2]]);
            membrane.extend(inner);
            membrane.iter_mut().for_each(|t| t.sort_unstable());
            membrane.sort_unstable();
            membrane.dedup();
        }
        let layout = BodyLayout::with_membrane(mesh.points.len(), &mesh.tetrahedra, &membrane);
        BodyRows {
            name: String::new(),
            vertices: 0..0,
            blocks: 0..0,
            vertex_order: layout.vertex_order,
            row_of_vertex: layout.row_of_vertex,
            tetrahedra: layout.tetrahedra,
            tetrahedron_order: layout.tetrahedron_order,
            size: 1.0,
            piece: Vec::new(),
            splits: 0,
            membrane: layout.membrane,
            membrane_order: layout.membrane_order,
        }
    }

    /// Everything that is kept up to date equals what follows from the tetrahedra that are left, and
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
            while connectivity.remaining() + connectivity.membrane_remaining() > 0 {
                let left: Vec<u32> = (0..body.tetrahedra.len() as u32)
                    .filter(|&t| connectivity.is_present(t))
                    .collect();
                let sheets: Vec<u32> = (0..body.membrane.len() as u32)
                    .filter(|&t| connectivity.is_membrane_present(t))
                    .collect();
                let mut some = |left: &[u32]| {
                    let count = if left.is_empty() { 0 } else { next(5) };
                    let mut batch: Vec<u32> = (0..count).map(|_| left[next(left.len())]).collect();
                    batch.sort_unstable();
                    batch.dedup();
                    batch
                };
                let touched = connectivity.remove(&some(&left), &some(&sheets));
                let kept: Vec<[u32; 4]> = (0..body.tetrahedra.len() as u32)
                    .filter(|&t| connectivity.is_present(t))
                    .map(|t| body.tetrahedra[t as usize])
                    .collect();
                assert_eq!(kept.len(), connectivity.remaining());
                let sheets: Vec<[u32; 3]> = (0..body.membrane.len() as u32)
                    .filter(|&t| connectivity.is_membrane_present(t))
                    .map(|t| body.membrane[t as usize])
                    .collect();
                assert_eq!(sheets.len(), connectivity.membrane_remaining());
                let fresh = Cells::new(body.vertex_order.len(), &kept, &sheets);
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
                    .map(|(mut f, _)| {
                        f.sort_unstable();
                        f
                    })
                    .collect();
                surface.sort_unstable();
                let faces: Vec<u32> =
                    fresh.tetrahedron_triangles.iter().flatten().copied().collect();
                let boundary: Vec<[u32; 3]> = (0..fresh.triangles.len())
                    .filter(|&f| faces.iter().filter(|&&g| g == f as u32).count() == 1)
                    .map(|f| fresh.triangles[f])
                    .collect();
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
                assert!(connectivity.parent.iter().enumerate().all(|(i, &p)| i as u32 == p));
            }
            assert!(splits > 0);
            assert!(connectivity.pieces().iter().all(|&p| p == UNUSED));
        }
    }
}
