//! What blades and tears decide about the material of a body: where its edges are crossed, and which cells fall apart by that.

use glam::DVec3;
use sinew_engine::layout::{ascending, starts};
use sinew_engine::sets::DisjointSets;
use std::collections::BTreeSet;

use super::material::{Cell, EDGES, Material, NONE, Order};

/// How near (in edges) to its end an edge may be cut: a point of the wound never lies on a vertex.
const MARGIN: f64 = 1e-3;

/// An edge of the material that a blade crosses.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Mark {
    /// Its points, the lower first.
    pub edge: [u32; 2],
    /// Where: at `(1 - at) a + at b`.
    pub at: f64,
    /// The blade itself crossed it; else the cut was prolonged to the end of an element.
    pub swept: bool,
}

/// What a blade that goes through the material does to it: decisions, from which all else follows.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Stroke {
    /// Marks, by their edges; of a stroke that goes on, those that it used before are left out.
    pub marks: Vec<Mark>,
    /// Cells that fall apart, ascending, as they were numbered when the stroke began.
    pub separated: Vec<u32>,
    /// A stroke before it goes on: edges and cells are those of the material when that one began.
    pub goes_on: bool,
}

/// The material as it is when a stroke begins. Decisions are made on it, so that they do not depend on the number of moves in which
/// the blade goes its way.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Uncut {
    /// Number of points.
    pub(super) points: u32,
    /// Corners of the cells.
    pub(super) cells: Vec<[u32; 4]>,
    /// Edges, ascending.
    pub(super) edges: Vec<[u32; 2]>,
    /// Edges of every cell; [`NONE`] for those of triangles to the corner that they do not have.
    edges_of: Vec<[u32; 6]>,
    /// Element of every cell where elements are of several, which are entered together.
    elements: Vec<u32>,
}

/// What a stroke has decided so far, by edges and cells of the [`Uncut`] material.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Progress {
    marks: Vec<Option<Mark>>,
    /// Edges that a separated cell left whole, and edges whose marks were handed out.
    whole: Vec<bool>,
    used: Vec<bool>,
    separated: Vec<bool>,
    /// Sides of points that a blade passed so near that rounding would tell them: 1 or -1, 0 for all others.
    pub(super) sides: Vec<i8>,
}

/// A move of the edge of a blade through cells.
pub struct BladeMove<'a> {
    /// Edges that may be crossed, ascending, and where.
    pub crossed: Vec<(u32, f64)>,
    /// Place (m) of a point now, and where it counts as being: beside the blade, if it passed too near to tell.
    pub place: &'a dyn Fn(u32) -> [DVec3; 2],
    /// A place (m) on the edge now, its direction, and its way (m) beside that of a cell with these corners.
    pub on: DVec3,
    /// Direction of the edge, of any length.
    pub along: DVec3,
    /// Its way (m) beside that of a cell with these corners.
    pub way: &'a dyn Fn([u32; 4]) -> DVec3,
    /// Cells that were entered before and did not fall apart are looked at again.
    pub again: bool,
}

impl Progress {
    /// Whether something was opened by it.
    pub fn has_opened(&self) -> bool {
        self.used.contains(&true)
    }
}

impl Uncut {
    /// Of a material.
    pub fn new(material: &Material) -> Self {
        let edges = material.cells.iter().flat_map(Cell::edges).filter(|edge| edge[1] != NONE);
        let edges = ascending(material.points.len(), edges.collect());
        let start = starts(material.points.len(), edges.iter().map(|edge| edge[0]));
        let number = |edge: [u32; 2]| {
            if edge[1] == NONE {
                return NONE;
            }
            let [from, to] = [0, 1].map(|i| start[edge[0] as usize + i] as usize);
            (from + edges[from..to].partition_point(|own| *own < edge)) as u32
        };
        let edges_of = material.cells.iter().map(|cell| cell.edges().map(number)).collect();
        let cells = material.cells.iter().map(|cell| cell.corners).collect();
        let elements = match material.order {
            Order::Hexahedra => material.cells.iter().map(|cell| cell.element).collect(),
            _ => Vec::new(),
        };
        Self { points: material.points.len() as u32, cells, edges, edges_of, elements }
    }

    /// Nothing decided yet.
    pub fn begin(&self) -> Progress {
        Progress {
            marks: vec![None; self.edges.len()],
            whole: vec![false; self.edges.len()],
            used: vec![false; self.edges.len()],
            separated: vec![false; self.cells.len()],
            sides: vec![0; self.points as usize],
        }
    }

    /// Whether decisions can be about it.
    pub fn fits(&self, progress: &Progress) -> bool {
        let Progress { marks, whole, used, separated, sides } = progress;
        [marks.len(), whole.len(), used.len()] == [self.edges.len(); 3]
            && separated.len() == self.cells.len()
            && sides.len() == self.points as usize
    }

    /// Goes on with a stroke; the cells that fall apart by this move.
    ///
    /// A cell is separated as soon as the blade has crossed one of its edges, if what the blade crossed, prolonged by the
    /// plane of the blade, parts its corners. The first mark of an edge counts for all cells round it.
    pub fn advance(&self, progress: &mut Progress, to: &BladeMove) -> Vec<u32> {
        if to.crossed.is_empty() && !to.again {
            return Vec::new();
        }
        let Progress { marks, whole, separated, .. } = progress;
        let mark = |e: u32, at: f64, swept| {
            let edge = self.edges[e as usize];
            Some(Mark { edge, at: at.clamp(MARGIN, 1.0 - MARGIN), swept })
        };
        let mut fresh = BTreeSet::new();
        for &(e, at) in &to.crossed {
            match &mut marks[e as usize] {
                Some(mark) => mark.swept = true,
                none => {
                    *none = mark(e, at, true);
                    fresh.insert(e);
                }
            }
        }
        let mut entered = vec![false; self.edges.len()];
        to.crossed.iter().for_each(|(e, _)| entered[*e as usize] = true);
        if to.again {
            let swept = marks.iter().map(|mark| mark.is_some_and(|mark| mark.swept));
            entered.iter_mut().zip(swept).for_each(|(entered, swept)| *entered |= swept);
        }
        let is_entered = |cell: &usize| self.real_edges(*cell).any(|e| entered[e as usize]);
        let mut cells: Vec<usize> = (0..self.cells.len()).filter(is_entered).collect();
        if !self.elements.is_empty() {
            let own: BTreeSet<u32> = cells.iter().map(|&cell| self.elements[cell]).collect();
            let all = 0..self.cells.len();
            cells = all.filter(|&cell| own.contains(&self.elements[cell])).collect();
        }
        let mut apart = Vec::new();
        for cell in cells {
            let own = &self.edges_of[cell];
            if separated[cell] {
                // the blade came where it was not expected
                let held =
                    groups(is_cut(own, |e| marks[e].is_some() && !fresh.contains(&(e as u32))));
                if parts(held, is_cut(own, |e| marks[e].is_some())) {
                    apart.push(cell as u32);
                }
                continue;
            }
            let normal = to.along.cross((to.way)(self.cells[cell]));
            for e in self.real_edges(cell) {
                let away = |x: DVec3| normal.dot(x - to.on);
                let [a, b] = self.edges[e as usize].map(|p| (to.place)(p).map(away));
                if marks[e as usize].is_none()
                    && !whole[e as usize]
                    && (a[1] >= 0.0) != (b[1] >= 0.0)
                {
                    marks[e as usize] = mark(e, share(a, b), false);
                }
            }
            if parts(self.whole(cell), is_cut(own, |e| marks[e].is_some())) {
                separated[cell] = true;
                apart.push(cell as u32);
                self.real_edges(cell)
                    .for_each(|e| whole[e as usize] |= marks[e as usize].is_none());
            }
        }
        apart
    }

    /// Edges of a cell, without those of a triangle to the corner that it does not have.
    fn real_edges(&self, cell: usize) -> impl Iterator<Item = u32> + '_ {
        self.edges_of[cell].iter().copied().filter(|e| *e != NONE)
    }

    /// Number of the group of every corner of a cell that nothing has parted.
    fn whole(&self, cell: usize) -> [u32; 4] {
        groups(is_cut(&self.edges_of[cell], |_| false))
    }

    /// What was decided by the stroke of which a material is, but for marks that opened nothing yet. `held` is its
    /// [`Material::held`].
    pub fn resume(&self, material: &Material, held: &[Option<[u32; 4]>]) -> Progress {
        let mut progress = self.begin();
        for mark in &material.cut {
            if let Ok(e) = self.edges.binary_search(&mark.edge) {
                (progress.marks[e], progress.used[e]) = (Some(*mark), true);
            }
        }
        let Progress { marks, whole, separated, .. } = &mut progress;
        for (cell, own) in held.iter().enumerate() {
            if own.is_some_and(|own| own != self.whole(cell)) {
                separated[cell] = true;
                self.real_edges(cell)
                    .for_each(|e| whole[e as usize] |= marks[e as usize].is_none());
            }
        }
        progress
    }

    /// Cells at the end of a wound, ascending: marks reach them, between corners that they still hold together.
    pub fn fronts(&self, progress: &Progress, held: &[Option<[u32; 4]>]) -> Vec<u32> {
        let all = 0..self.cells.len() as u32;
        let is_front = |cell: &u32| match held[*cell as usize] {
            Some(held) => self.ends(progress, *cell, held).next().is_some(),
            None => false,
        };
        all.filter(is_front).collect()
    }

    /// Local corners, the lower point first, and place of the marks that reach a cell without parting it.
    pub fn ends<'a>(
        &'a self,
        progress: &'a Progress,
        cell: u32,
        held: [u32; 4],
    ) -> impl Iterator<Item = ([usize; 2], f64)> + 'a {
        let corners = self.cells[cell as usize];
        let edges = EDGES.iter().zip(self.edges_of[cell as usize]);
        edges.filter(move |([a, b], _)| held[*a] == held[*b]).filter_map(move |(&[a, b], e)| {
            let mark = progress.marks[e as usize]?;
            Some((if corners[a] < corners[b] { [a, b] } else { [b, a] }, mark.at))
        })
    }

    /// Prolongs a wound through a cell by the plane through a place (m) across `normal`, where the corners of the cell are at `x`. Edges that
    /// cells beside it left whole stay whole if it comes apart without them. Whether it does; else nothing is decided.
    pub fn prolong(
        &self,
        progress: &mut Progress,
        (cell, held): (u32, [u32; 4]),
        x: [DVec3; 4],
        [on, normal]: [DVec3; 2],
    ) -> bool {
        let Progress { marks, whole, separated, .. } = progress;
        let (cell, own) = (cell as usize, &self.edges_of[cell as usize]);
        for spares_whole in [true, false] {
            let mut added = Vec::new();
            for (&[a, b], &e) in EDGES.iter().zip(own).filter(|(_, e)| **e != NONE) {
                let e = e as usize;
                let side = [a, b].map(|i| normal.dot(x[i] - on));
                let crosses = (side[0] >= 0.0) != (side[1] >= 0.0);
                if marks[e].is_some() || !crosses || spares_whole && whole[e] {
                    continue;
                }
                let part = side[0] / (side[0] - side[1]);
                let is_turned = self.cells[cell][a] > self.cells[cell][b];
                let at = if is_turned { 1.0 - part } else { part };
                let at = at.clamp(MARGIN, 1.0 - MARGIN);
                marks[e] = Some(Mark { edge: self.edges[e], at, swept: false });
                added.push(e);
            }
            if parts(held, is_cut(own, |e| marks[e].is_some())) {
                separated[cell] = true;
                self.real_edges(cell)
                    .for_each(|e| whole[e as usize] |= marks[e as usize].is_none());
                return true;
            }
            added.into_iter().for_each(|e| marks[e] = None);
        }
        false
    }

    /// Lets cells come apart that marks alone part: a wound has passed them. They, ascending.
    pub fn close(&self, progress: &mut Progress, held: &[Option<[u32; 4]>]) -> Vec<u32> {
        let Progress { marks, whole, separated, .. } = progress;
        let mut closed = Vec::new();
        for (cell, own) in self.edges_of.iter().enumerate() {
            let Some(held) =
                held[cell].filter(|_| self.real_edges(cell).any(|e| marks[e as usize].is_some()))
            else {
                continue;
            };
            if parts(held, is_cut(own, |e| marks[e].is_some())) {
                separated[cell] = true;
                self.real_edges(cell)
                    .for_each(|e| whole[e as usize] |= marks[e as usize].is_none());
                closed.push(cell as u32);
            }
        }
        closed
    }

    /// Corners of a cell.
    pub fn corners(&self, cell: u32) -> [u32; 4] {
        self.cells[cell as usize]
    }

    /// Cells round a point, ascending.
    pub fn round(&self, point: u32) -> impl Iterator<Item = u32> + '_ {
        let all = (0..).zip(&self.cells);
        all.filter(move |(_, corners)| corners.contains(&point)).map(|(cell, _)| cell)
    }

    /// The cells that come apart together with one: those of its element, ascending.
    pub fn together(&self, cell: u32) -> Vec<u32> {
        let Some(element) = self.elements.get(cell as usize) else { return vec![cell] };
        let all = (0..).zip(&self.elements);
        all.filter(|(_, own)| *own == element).map(|(cell, _)| cell).collect()
    }

    /// Mean length (m) of the edges between vertices of a mesh of so many, when `rest` says where these are.
    pub fn mean_edge(&self, vertices: u32, rest: &dyn Fn(u32) -> DVec3) -> f64 {
        let own = self.edges.iter().filter(|edge| edge[1] < vertices);
        let lengths = own.map(|&[a, b]| rest(a).distance(rest(b)));
        let (sum, count) = lengths.fold((0.0, 0.0), |(sum, count), own| (sum + own, count + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// What is to be opened after some cells fell apart, ascending.
    pub fn stroke(&self, progress: &mut Progress, separated: Vec<u32>, goes_on: bool) -> Stroke {
        let edges = separated.iter().flat_map(|&cell| self.real_edges(cell as usize));
        let mut edges: Vec<u32> = edges.filter(|&e| !progress.used[e as usize]).collect();
        edges.sort_unstable();
        edges.dedup();
        let of = |&e: &u32| progress.marks[e as usize];
        let marks: Vec<Mark> = edges.iter().filter_map(of).collect();
        edges.retain(|e| progress.marks[*e as usize].is_some());
        edges.iter().for_each(|&e| progress.used[e as usize] = true);
        Stroke { marks, separated, goes_on }
    }

    /// All marks, by their edges.
    pub fn marks(progress: &Progress) -> Vec<Mark> {
        progress.marks.iter().flatten().copied().collect()
    }
}

impl Material {
    /// What the surface that a blade sweeps does: between two positions of the blade (m) it consists of two triangles,
    /// `(p0, q0, p1)` and `(q0, q1, p1)`. `at` says where vertices and ghosts are. All marks that it made, and what is to be opened.
    pub fn stroke(&self, strip: &[[DVec3; 2]], at: &dyn Fn(u32) -> DVec3) -> (Vec<Mark>, Stroke) {
        let uncut = Uncut::new(self);
        let mut places = vec![DVec3::ZERO; self.points.len()];
        for cell in &self.cells {
            cell.points().iter().for_each(|&p| places[p as usize] = self.place(cell, p, at));
        }
        let place = |p: u32| places[p as usize];
        let mut progress = uncut.begin();
        let mut separated = Vec::new();
        for move_ in strip.windows(2) {
            let [[p0, q0], [p1, q1]] = [move_[0], move_[1]];
            let parts = [[p0, q0, p1], [q0, q1, p1]];
            let low = p0.min(q0).min(p1).min(q1);
            let high = p0.max(q0).max(p1).max(q1);
            let crossed = (0..).zip(&uncut.edges).filter_map(|(e, edge)| {
                let [a, b] = edge.map(place);
                let apart = a.min(b).cmpgt(high).any() || a.max(b).cmplt(low).any();
                let at = || parts.iter().find_map(|part| crossing([a, b], part));
                if apart { None } else { at().map(|at| (e, at)) }
            });
            let crossed = crossed.collect();
            let way = ((p1 + q1) - (p0 + q0)) / 2.0;
            let (on, along, way, again) = (p1, q1 - p1, &|_| way, true);
            let place = &|p| [place(p); 2];
            let to = BladeMove { crossed, place, on, along, way, again };
            separated.extend(uncut.advance(&mut progress, &to));
        }
        separated.sort_unstable();
        let stroke = uncut.stroke(&mut progress, separated, false);
        (Uncut::marks(&progress), stroke)
    }
}

/// Which edges of a cell are cut; those of a triangle to the corner that it does not have count as cut.
fn is_cut(edges: &[u32; 6], is_cut: impl Fn(usize) -> bool) -> [bool; 6] {
    edges.map(|e| e == NONE || is_cut(e as usize))
}

/// Number of the group of every corner of a tetrahedron: those that edges which are not cut hold together.
pub(super) fn groups(is_cut: [bool; 6]) -> [u32; 4] {
    let mut sets = DisjointSets::new(4);
    for ([a, b], _) in EDGES.iter().zip(is_cut).filter(|(_, cut)| !cut) {
        sets.join(*a as u32, *b as u32);
    }
    [0, 1, 2, 3].map(|corner| sets.root(corner))
}

/// Whether corners that are held together come apart by what is cut.
fn parts(held: [u32; 4], is_cut: [bool; 6]) -> bool {
    let now = groups(is_cut);
    EDGES.iter().any(|&[a, b]| held[a] == held[b] && now[a] != now[b])
}

/// The part of an edge at which a surface crosses it, by how far its ends are from that, and how far they count as being: on different sides.
pub(super) fn share(a: [f64; 2], b: [f64; 2]) -> f64 {
    let is_told = |own: [f64; 2]| (own[0] >= 0.0) == (own[1] >= 0.0);
    match (is_told(a), is_told(b)) {
        (true, true) => a[0] / (a[0] - b[0]),
        (false, true) => 0.0,
        (true, false) => 1.0,
        (false, false) => a[1] / (a[1] - b[1]),
    }
}

/// Where a segment crosses a triangle, as a part of the segment. An end that lies in its plane is on one side of it, for all segments there.
pub(super) fn crossing([a, b]: [DVec3; 2], &[p, q, r]: &[DVec3; 3]) -> Option<f64> {
    let (d, [x, y, z]) = (b - a, [p - a, q - a, r - a]);
    // triangles on either side of an edge get opposite numbers to the last bit: nothing passes between them
    let sides = [x.cross(y).dot(d), y.cross(z).dot(d), z.cross(x).dot(d)];
    if !(sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)) {
        return None;
    }
    let normal = (q - p).cross(r - p);
    let [a, b] = [a, b].map(|end| normal.dot(end - p));
    ((a >= 0.0) != (b >= 0.0)).then(|| a / (a - b))
}
