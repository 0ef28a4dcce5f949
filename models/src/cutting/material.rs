//! The material of a body, and how it is divided by what a stroke decided, as plain numbers.

use glam::DVec3;
use sinew_engine::isoparametric::{MIDDLES, hexahedron_shape, middle_of, tetrahedron10_shape};
use sinew_engine::layout::WHOLE_TRIANGLE;
use sinew_engine::sets::DisjointSets;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::blade::shares;
use super::faces::Sheet;
use super::glue::Bond;
use super::hexahedra;
use super::stroke::{Mark, Stroke, Uncut, groups};

/// Local corners of the edges of a tetrahedron.
pub(super) const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
/// Part of the volume of a whole element below which what comes off is a chip: it gets no copy, hangs together with nothing, and is moved
/// by the largest rest of its element. Its rows would be too small beside all others for the residual of a linear system to tell that
/// they are wrong.
const CHIP: f64 = 1e-8;
/// No number.
pub const NONE: u32 = u32::MAX;

/// A point of the material: a mean of vertices of the mesh by these weights, which add up to 1. Vertices of no weight come
/// last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Vertices of the mesh, all of one element.
    pub vertices: [u32; 4],
    /// Their weights.
    pub weights: [f64; 4],
}

impl Point {
    fn vertex(vertex: u32) -> Self {
        Self { vertices: [vertex; 4], weights: [1.0, 0.0, 0.0, 0.0] }
    }

    /// A mean of points of one cell.
    fn mean<'a>(of: impl IntoIterator<Item = (&'a Self, f64)>) -> Self {
        let mut sum = BTreeMap::<u32, f64>::new();
        for (point, part) in of {
            for (&v, w) in point.vertices.iter().zip(point.weights) {
                if w != 0.0 {
                    *sum.entry(v).or_default() += part * w;
                }
            }
        }
        let mut point = Self { vertices: [*sum.keys().next().unwrap_or(&0); 4], weights: [0.0; 4] };
        for (at, (v, w)) in sum.into_iter().take(4).enumerate() {
            (point.vertices[at], point.weights[at]) = (v, w);
        }
        point
    }

    /// The weights of the vertices of an element that it lies in.
    pub fn weights_in(&self, vertices: [u32; 4]) -> [f64; 4] {
        let of = |v| (0..4).filter(|&i| self.vertices[i] == v).map(|i| self.weights[i]).sum();
        vertices.map(of)
    }
}

/// A tetrahedron of the material, or a triangle of that of a membrane, whose faces are its edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Points, positively oriented; a triangle has [`NONE`] in the last place, as have its faces.
    pub corners: [u32; 4],
    /// Element that moves it.
    pub element: u32,
    /// Part of the volume, or area, of the element of the mesh.
    pub volume: f64,
    /// Whether the face opposite each corner was laid open; of a triangle always that opposite the corner which it does not have.
    pub wound: [bool; 4],
    /// Number that it, or what it is a part of, had when the last stroke began.
    pub began: u32,
}

impl Cell {
    /// The face opposite a corner, outward.
    pub fn face(&self, opposite: usize) -> [u32; 3] {
        let [a, b, c] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]][opposite];
        [self.corners[a], self.corners[b], self.corners[c]]
    }

    fn is_chip(&self) -> bool {
        self.volume < CHIP && self.wound == [true; 4]
    }

    fn has(&self, point: u32) -> bool {
        self.corners.contains(&point)
    }

    /// Its corners: four of a tetrahedron, three of a triangle.
    pub fn points(&self) -> &[u32] {
        real(&self.corners)
    }

    /// Its edges, the lower point first; a triangle has three, and three to the corner that it does not have.
    pub(super) fn edges(&self) -> [[u32; 2]; 6] {
        EDGES.map(|ends| sorted(ends.map(|i| self.corners[i])))
    }
}

/// Kinds of elements that have material.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Tetrahedra of four vertices.
    #[default]
    Linear,
    /// Tetrahedra of ten vertices and straight sides. Material knows their corners alone.
    TenNodes,
    /// Hexahedra: six tetrahedra each in local coordinates, where they are cubes.
    Hexahedra,
    /// Triangles of a membrane without anything under it.
    Triangles,
}

impl Order {
    /// Vertices of an element.
    pub fn size(self) -> usize {
        match self {
            Self::Linear => 4,
            Self::TenNodes => 10,
            Self::Hexahedra => 8,
            Self::Triangles => 3,
        }
    }

    /// Whether a point moves as the corners of its element do, by the weights that it has of them.
    pub fn is_linear(self) -> bool {
        matches!(self, Self::Linear | Self::Triangles)
    }

    /// Cells of an element that is whole.
    pub(super) fn cells(self) -> usize {
        if self == Self::Hexahedra { 6 } else { 1 }
    }
}

/// An element: one of the mesh, or a copy of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// Its vertices in the mesh, which give its shape at rest; the first four, [`NONE`] in the last place of a triangle.
    pub vertices: [u32; 4],
    /// The vertices that move it: those of the mesh, or ghosts of them, which are numbered from the last vertex of the mesh on.
    pub nodes: [u32; 4],
    /// The further vertices of elements that have more than four, and what moves them.
    pub further: [[u32; 6]; 2],
    /// Element of the mesh that it is a copy of, or itself.
    pub source: u32,
    /// Element that it fell off, or itself.
    pub parent: u32,
    /// Part of the volume of the whole element that lies at each corner: integrals of linear shape functions over the
    /// material. Of hexahedra a quarter of the part of the cube. Of triangles the same of the area, and 0 in the last place.
    pub portion: [f64; 4],
}

impl Element {
    /// A vertex in the mesh.
    pub fn vertex(&self, i: usize) -> u32 {
        if i < 4 { self.vertices[i] } else { self.further[0][i - 4] }
    }

    /// What moves a vertex.
    pub fn node(&self, i: usize) -> u32 {
        if i < 4 { self.nodes[i] } else { self.further[1][i - 4] }
    }

    fn move_by(&mut self, i: usize, node: u32) {
        if i < 4 { self.nodes[i] = node } else { self.further[1][i - 4] = node }
    }

    /// Its first `N` vertices.
    pub fn all_vertices<const N: usize>(&self) -> [u32; N] {
        std::array::from_fn(|i| self.vertex(i))
    }

    /// Part of the volume of the whole element.
    pub fn share(&self) -> f64 {
        self.portion.iter().sum()
    }
}

/// The material of a body.
///
/// A blade divides the *material* only. An element whose material falls apart becomes as many copies of the same shape, each
/// with its share of the volume and vertices of its own where the two sides come apart (virtual nodes: Molino, Bao, Fedkiw
/// 2004; Sifakis, Der, Fedkiw 2007). So no small or flat element ever reaches a solver, and nothing is interpolated.
#[derive(Debug, Default, PartialEq)]
pub struct Material {
    /// Points; those of the mesh first.
    pub points: Vec<Point>,
    /// Tetrahedra between them.
    pub cells: Vec<Cell>,
    /// Elements; those of the mesh first.
    pub elements: Vec<Element>,
    /// Vertex of the mesh that every ghost is of.
    pub ghosts: Vec<u32>,
    /// Number of vertices of the mesh.
    pub vertices: u32,
    /// What it was when the last stroke began.
    pub uncut: Option<Arc<Uncut>>,
    /// Marks on edges of that which are cut, by their edges.
    pub(super) cut: Vec<Mark>,
    /// Kind of its elements.
    pub order: Order,
    /// Membrane triangles on faces of its elements; those of the mesh first.
    pub sheets: Vec<Sheet>,
    /// What glue holds, swept since or not; that of earlier strokes first.
    pub bonds: Vec<Bond>,
    /// Points in the middles of edges of wounds: of ten-node tetrahedra, whose lips would bulge into each other between corners. They are
    /// corners of no cell.
    middles: BTreeMap<Middle, u32>,
}

/// What tells the middle of an edge of a wound from others: the ends of the edge, and the nodes that move it. At the end of a wound both lips
/// have the same ends, and not all nodes.
type Middle = ([u32; 2], [u32; 10]);

/// Places that a copy of a material has to spare: it is made for a cut.
const ROOM: usize = 256;

impl Clone for Material {
    fn clone(&self) -> Self {
        fn roomy<T: Copy>(list: &[T]) -> Vec<T> {
            let mut own = Vec::with_capacity(list.len() + ROOM);
            own.extend_from_slice(list);
            own
        }
        Self {
            points: roomy(&self.points),
            cells: self.cells.clone(),
            elements: roomy(&self.elements),
            ghosts: self.ghosts.clone(),
            vertices: self.vertices,
            uncut: self.uncut.clone(),
            cut: roomy(&self.cut),
            order: self.order,
            sheets: self.sheets.clone(),
            bonds: self.bonds.clone(),
            middles: self.middles.clone(),
        }
    }
}

/// Where glue is in a triangle of a wound: middles of nine equal parts, by the corners.
const SAMPLES: [[f64; 3]; 9] = {
    const A: [f64; 5] = [1.0 / 9.0, 2.0 / 9.0, 4.0 / 9.0, 5.0 / 9.0, 7.0 / 9.0];
    [
        [A[4], A[0], A[0]],
        [A[0], A[4], A[0]],
        [A[0], A[0], A[4]],
        [A[2], A[2], A[0]],
        [A[0], A[2], A[2]],
        [A[2], A[0], A[2]],
        [A[3], A[1], A[1]],
        [A[1], A[3], A[1]],
        [A[1], A[1], A[3]],
    ]
};

/// The same in a line of a wound of a membrane: middles of three equal parts.
const LINE_SAMPLES: [[f64; 2]; 3] = [[5.0 / 6.0, 1.0 / 6.0], [0.5, 0.5], [1.0 / 6.0, 5.0 / 6.0]];

/// Stiffness (N/m) of all the glue in a triangle, or line, of a wound, by the element of the mesh and the corners.
pub type Gluing<'a> = &'a dyn Fn(u32, &[Point]) -> f64;

impl Material {
    /// Of a whole mesh.
    pub fn new(vertices: usize, tetrahedra: &[[u32; 4]]) -> Self {
        let whole = |(element, &corners): (u32, _)| Cell {
            corners,
            element,
            volume: 1.0,
            wound: [false; 4],
            began: element,
        };
        let element = |(source, &vertices): (u32, _)| Element {
            vertices,
            nodes: vertices,
            further: [[NONE; 6]; 2],
            source,
            parent: source,
            portion: [0.25; 4],
        };
        Self {
            points: (0..vertices as u32).map(Point::vertex).collect(),
            cells: (0..).zip(tetrahedra).map(whole).collect(),
            elements: (0..).zip(tetrahedra).map(element).collect(),
            vertices: vertices as u32,
            order: Order::Linear,
            ..Self::default()
        }
    }

    /// Of a mesh of triangles.
    pub fn of_triangles(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let padded: Vec<[u32; 4]> = triangles.iter().map(|&[a, b, c]| [a, b, c, NONE]).collect();
        let mut material = Self { order: Order::Triangles, ..Self::new(vertices, &padded) };
        let [a, b, c] = WHOLE_TRIANGLE;
        material.elements.iter_mut().for_each(|element| element.portion = [a, b, c, 0.0]);
        material.cells.iter_mut().for_each(|cell| cell.wound[3] = true);
        material.spread_sheets();
        material
    }

    /// Whether a cut parted an element.
    pub fn is_parted(&self, element: u32) -> bool {
        let [a, b, c] = WHOLE_TRIANGLE;
        let whole = if self.order == Order::Triangles { [a, b, c, 0.0] } else { [0.25; 4] };
        self.elements[element as usize].portion != whole
    }

    /// Makes the membrane triangles of a body of nothing else what its elements are.
    fn spread_sheets(&mut self) {
        let known = std::mem::take(&mut self.sheets).into_iter().map(|sheet| sheet.is_gone);
        let gone = known.map(Some).chain(std::iter::repeat(None));
        let of = |(own, is_gone): (&Element, Option<bool>)| {
            let mut order = [0, 1, 2];
            order.sort_unstable_by_key(|&i| own.vertices[i]);
            Sheet {
                vertices: order.map(|i| own.vertices[i]),
                nodes: order.map(|i| own.nodes[i]),
                source: own.source,
                parent: own.parent,
                portion: order.map(|i| own.portion[i]),
                // nothing of what is gone has copies
                is_gone: is_gone.unwrap_or(false),
            }
        };
        self.sheets = self.elements.iter().zip(gone).map(of).collect();
    }

    /// Of a mesh of ten-node tetrahedra.
    pub fn of_ten_nodes(vertices: usize, tetrahedra: &[[u32; 10]]) -> Self {
        let corners: Vec<[u32; 4]> =
            tetrahedra.iter().map(|&[a, b, c, d, ..]| [a, b, c, d]).collect();
        let mut material = Self { order: Order::TenNodes, ..Self::new(vertices, &corners) };
        for (element, own) in material.elements.iter_mut().zip(tetrahedra) {
            element.further = [std::array::from_fn(|i| own[4 + i]); 2];
        }
        material
    }

    /// Of a mesh of hexahedra.
    pub fn of_hexahedra(vertices: usize, all: &[[u32; 8]]) -> Self {
        let first: Vec<[u32; 4]> = all.iter().map(|&[a, b, c, d, ..]| [a, b, c, d]).collect();
        let mut material = Self { order: Order::Hexahedra, ..Self::new(vertices, &first) };
        material.cells.clear();
        for ((number, own), element) in (0..).zip(all).zip(&mut material.elements) {
            element.further = [std::array::from_fn(|i| own.get(4 + i).copied().unwrap_or(NONE)); 2];
            material.cells.extend(hexahedra::tetrahedra(own).map(|corners| Cell {
                corners,
                element: number,
                volume: 1.0 / 6.0,
                wound: [false; 4],
                began: number,
            }));
        }
        material
    }

    /// Where a point is, as a corner of a cell, when `at` says where vertices and ghosts are.
    pub fn place(&self, cell: &Cell, point: u32, at: &dyn Fn(u32) -> DVec3) -> DVec3 {
        let element = &self.elements[cell.element as usize];
        let own = &self.points[point as usize];
        let size = self.order.size();
        if own.weights[0] == 1.0 {
            // to the last bit
            return at(element.node(self.place_of(element, own.vertices[0])));
        }
        let weights = self.weights(element, own);
        (0..size).zip(weights).map(|(i, w)| w * at(element.node(i))).sum()
    }

    /// Place of a vertex in an element.
    fn place_of(&self, element: &Element, vertex: u32) -> usize {
        (0..self.order.size()).find(|&i| element.vertex(i) == vertex).unwrap_or(0)
    }

    /// A point of an element that four of its vertices hold, as the material has points: of ten-node tetrahedra by the corners, between
    /// which its other vertices lie in the middle.
    pub(super) fn point_of(&self, element: &Element, held: Point) -> Point {
        if self.order != Order::TenNodes {
            return held;
        }
        let mut point = Point { vertices: element.vertices, weights: [0.0; 4] };
        for (vertex, weight) in held.vertices.into_iter().zip(held.weights) {
            match self.place_of(element, vertex) {
                corner @ 0..4 => point.weights[corner] += weight,
                middle => {
                    MIDDLES[middle - 4].iter().for_each(|&end| point.weights[end] += 0.5 * weight)
                }
            }
        }
        point
    }

    /// Shape functions of an element at a point that lies in it.
    pub(super) fn weights(&self, element: &Element, point: &Point) -> [f64; 10] {
        if point.weights[0] == 1.0 {
            let mut weights = [0.0; 10];
            weights[self.place_of(element, point.vertices[0])] = 1.0;
            return weights;
        }
        match self.order {
            Order::Linear | Order::Triangles => padded(point.weights_in(element.vertices)),
            Order::TenNodes => tetrahedron10_shape(point.weights_in(element.vertices)),
            Order::Hexahedra => {
                let at = hexahedra::local(&element.all_vertices(), point);
                padded(hexahedron_shape(at.to_array()))
            }
        }
    }

    /// Where a point of an element is, when `at` says where vertices and ghosts are.
    pub(super) fn held_at(
        &self,
        element: &Element,
        point: &Point,
        at: impl Fn(u32) -> DVec3,
    ) -> DVec3 {
        let held = self.held_by(element, point);
        held.map(|(i, w)| w * at(element.node(i))).sum()
    }

    /// Places in an element of the vertices that move a point of it, ascending, and their weights.
    pub(super) fn held_by(
        &self,
        element: &Element,
        point: &Point,
    ) -> impl Iterator<Item = (usize, f64)> + use<> {
        let weights = self.weights(element, point);
        weights.into_iter().enumerate().take(self.order.size()).filter(|(_, w)| *w != 0.0)
    }

    /// Places in its element of four vertices round a cell: its own corners, or those of the tetrahedron of a hexahedron that it is a part of.
    pub(super) fn round(&self, cell: &Cell) -> [usize; 4] {
        let mut places = [0, 1, 2, 3];
        if self.order == Order::Hexahedra {
            let element = &self.elements[cell.element as usize];
            let points = cell.corners.iter().map(|p| &self.points[*p as usize]);
            let all = points.flat_map(|point| point.vertices.into_iter().zip(point.weights));
            let all: BTreeSet<u32> = all.filter(|(_, w)| *w != 0.0).map(|(v, _)| v).collect();
            // a cell with a volume has points of all corners of its tetrahedron
            for (to, v) in places.iter_mut().zip(all) {
                *to = (0..8).find(|&i| element.vertex(i) == v).unwrap_or(0);
            }
        }
        places
    }

    /// A face of what is left of an element in triangles, which have as corners the vertices of the mesh on its edges, too, and the middles
    /// of edges of wounds.
    pub(super) fn with_middles(&self, [a, b, c]: [u32; 3], element: u32) -> Vec<[u32; 3]> {
        let own = &self.elements[element as usize];
        let is_there = |p: &u32| self.points[*p as usize].weights == [0.5, 0.5, 0.0, 0.0];
        let middle = |edge: [u32; 2]| match self.middle_on(own, edge) {
            // an edge that ends there has no middle
            Some(place) => (!edge.iter().any(is_there)).then(|| own.vertex(place)),
            None => self.middle(own, edge).1,
        };
        if self.order != Order::TenNodes {
            return vec![[a, b, c]];
        }
        match [[a, b], [b, c], [c, a]].map(middle) {
            [None, None, None] => vec![[a, b, c]],
            [Some(x), None, None] => vec![[a, x, c], [x, b, c]],
            [None, Some(y), None] => vec![[b, y, a], [y, c, a]],
            [None, None, Some(z)] => vec![[c, z, b], [z, a, b]],
            [Some(x), Some(y), None] => vec![[x, b, y], [a, x, y], [a, y, c]],
            [None, Some(y), Some(z)] => vec![[y, c, z], [b, y, z], [b, z, a]],
            [Some(x), None, Some(z)] => vec![[z, a, x], [c, z, x], [c, x, b]],
            [Some(x), Some(y), Some(z)] => vec![[a, x, z], [b, y, x], [c, z, y], [x, y, z]],
        }
    }

    /// Divides the material by what a stroke decided; see [`Material::stroke`]. Shares, copies and ghosts follow. For every
    /// ghost that came to be the vertex or ghost in whose place it comes.
    pub fn open(&mut self, stroke: &Stroke) -> Vec<u32> {
        self.open_glued(stroke, None)
    }

    /// The same, with glue in all that opens.
    pub fn open_glued(&mut self, stroke: &Stroke, glue: Option<Gluing>) -> Vec<u32> {
        if !stroke.goes_on {
            self.uncut = Some(Arc::new(Uncut::new(self)));
            self.cut.clear();
            (0..).zip(&mut self.cells).for_each(|(number, cell)| cell.began = number);
        }
        let (covers, known) = (self.covers(), self.elements.len() as u32);
        let uncut = self.uncut.take().unwrap_or_default();
        // separated cells are cut at their marks, and all round these
        let first = self.points.len() as u32;
        for Mark { edge, at, .. } in &stroke.marks {
            let [a, b] = edge.map(|p| self.points[p as usize]);
            self.points.push(Point::mean([(&a, 1.0 - at), (&b, *at)]));
        }
        let new = |edge: &[u32; 2]| stroke.marks.binary_search_by_key(edge, |m| m.edge).ok();
        let mut is_end = vec![false; first as usize];
        stroke.marks.iter().flat_map(|mark| mark.edge).for_each(|p| is_end[p as usize] = true);
        let mut cells = Vec::with_capacity(self.cells.len() + 8 * stroke.separated.len());
        for cell in &self.cells {
            if cell.points().iter().filter(|p| is_end[**p as usize]).count() < 2 {
                cells.push(*cell);
                continue;
            }
            let mut cuts: Vec<([u32; 2], usize)> =
                cell.edges().iter().filter_map(|edge| Some((*edge, new(edge)?))).collect();
            // in the order of all edges, so that neighbours agree
            cuts.sort_unstable();
            let begin = cells.len();
            cells.push(*cell);
            for ([a, b], mark) in cuts {
                let (m, t) = (first + mark as u32, stroke.marks[mark].at);
                for at in begin..cells.len() {
                    let part: Cell = cells[at];
                    if part.has(a) && part.has(b) {
                        cells[at] = part.with([a, b], m, t);
                        cells.push(part.with([b, a], m, 1.0 - t));
                    }
                }
            }
        }
        self.cut.extend(&stroke.marks);
        self.cut.sort_by_key(|mark| mark.edge);
        let mut falls_apart = vec![false; uncut.cells.len()];
        stroke.separated.iter().for_each(|&cell| falls_apart[cell as usize] = true);
        let mut parts: Vec<(u32, usize)> = (0..cells.len())
            .map(|at| (cells[at].began, at))
            .filter(|(began, _)| falls_apart[*began as usize])
            .collect();
        parts.sort_unstable();
        let mut opened = Vec::new();
        for own in parts.chunk_by(|a, b| a.0 == b.0) {
            let corners = uncut.cells[own[0].0 as usize];
            // nothing holds the corner that triangles do not have
            let is_cut = |edge: [u32; 2]| edge[1] == NONE || self.is_cut(edge);
            let is_cut = EDGES.map(|ends| is_cut(sorted(ends.map(|i| corners[i]))));
            let group = groups(is_cut);
            let of = |part: &Cell| group[(0..4).find(|&i| part.has(corners[i])).unwrap_or(0)];
            let places: Vec<usize> = own.iter().map(|(_, at)| *at).collect();
            opened.extend(part_groups(&mut cells, &places, of));
        }
        self.cells = cells;
        let own = parts.iter().map(|&(_, at)| self.cells[at].element).collect();
        let touched = self.part_elements(own);
        self.part_bonds(known);
        if let Some(glue) = glue {
            self.bind(&opened, glue);
        }
        self.part_points(uncut.points);
        self.uncut = Some(uncut);
        let origins = self.part_nodes(&touched);
        self.add_middles();
        match self.order {
            Order::Triangles => self.spread_sheets(),
            _ => self.part_sheets(&covers, known),
        }
        origins
    }

    /// Gives the points of the stroke, from `first` on, an own number for each side on which the cells round them hang together.
    fn part_points(&mut self, first: u32) {
        let mut round: Vec<Vec<u32>> = vec![Vec::new(); self.points.len() - first as usize];
        for (number, cell) in (0..).zip(&self.cells) {
            for &p in cell.points().iter().filter(|&&p| p >= first) {
                round[(p - first) as usize].push(number);
            }
        }
        let mut moves = Vec::new();
        for (point, own) in (first..).zip(&round) {
            let at_point = |number: u32, face: &[u32; 3]| {
                face.contains(&point).then(|| own.binary_search(&number).unwrap_or(0) as u32)
            };
            let part = self.joined(own, at_point);
            let count = part.iter().max().map_or(0, |last| last + 1);
            let copies: Vec<u32> = (1..count)
                .map(|_| {
                    self.points.push(self.points[point as usize]);
                    self.points.len() as u32 - 1
                })
                .collect();
            moves.extend(
                (0..own.len())
                    .filter(|&i| part[i] > 0)
                    .map(|i| (own[i], point, copies[part[i] as usize - 1])),
            );
        }
        for (cell, from, to) in moves {
            let corners = &mut self.cells[cell as usize].corners;
            corners.iter_mut().filter(|p| **p == from).for_each(|p| *p = to);
        }
    }

    /// Adds points in the middles of edges of wounds through ten-node tetrahedra.
    fn add_middles(&mut self) {
        if self.order != Order::TenNodes {
            return;
        }
        let mut new = BTreeSet::new();
        for cell in &self.cells {
            let element = &self.elements[cell.element as usize];
            for [a, b, c] in (0..4).filter(|&i| cell.wound[i]).map(|i| cell.face(i)) {
                let own = [[a, b], [b, c], [c, a]].into_iter();
                let own = own.filter(|edge| self.middle_on(element, *edge).is_none());
                new.extend(own.map(|edge| self.middle(element, edge).0));
            }
        }
        new.retain(|key| !self.middles.contains_key(key));
        for key in new {
            self.middles.insert(key, self.points.len() as u32);
            let [a, b] = key.0.map(|p| self.points[p as usize]);
            self.points.push(Point::mean([(&a, 0.5), (&b, 0.5)]));
        }
    }

    /// What tells the middle of an edge of a wound from others, and the number that it has.
    fn middle(&self, element: &Element, edge: [u32; 2]) -> (Middle, Option<u32>) {
        let edge = sorted(edge);
        let [a, b] = edge.map(|p| &self.points[p as usize]);
        let middle = Point::mean([(a, 0.5), (b, 0.5)]);
        let mut nodes = [NONE; 10];
        for (to, (place, _)) in nodes.iter_mut().zip(self.held_by(element, &middle)) {
            *to = element.node(place);
        }
        let key = (edge, sorted(nodes));
        (key, self.middles.get(&key).copied())
    }

    /// Sets of cells among some that hang together by faces for which `place` gives the place of the cell.
    fn joined(&self, cells: &[u32], place: impl Fn(u32, &[u32; 3]) -> Option<u32>) -> Vec<u32> {
        let mut sets = DisjointSets::new(cells.len());
        let mut faces: Vec<([u32; 3], u32)> = Vec::new();
        for &number in cells {
            let cell = &self.cells[number as usize];
            for opposite in (0..4).filter(|&i| !cell.wound[i]) {
                let face = sorted(cell.face(opposite));
                faces.extend(place(number, &face).map(|place| (face, place)));
            }
        }
        faces.sort_unstable();
        for pair in faces.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            sets.join(pair[0].1, pair[1].1);
        }
        sets.count()
    }

    /// Makes a copy of every element among some for each further piece of its material that is no chip, and sums the portions of all that
    /// changed. These elements and their copies.
    fn part_elements(&mut self, among: BTreeSet<u32>) -> Vec<u32> {
        let mut own: BTreeMap<u32, Vec<u32>> = among.into_iter().map(|e| (e, Vec::new())).collect();
        let mut is_among = vec![false; self.elements.len()];
        own.keys().for_each(|&e| is_among[e as usize] = true);
        for (number, cell) in (0..).zip(&self.cells).filter(|(_, c)| is_among[c.element as usize]) {
            own.entry(cell.element).or_default().push(number);
        }
        let copies = self.elements.len() as u32;
        let mut chips = Vec::new();
        for (&element, cells) in own.iter().filter(|(_, cells)| cells.len() > 1) {
            let place = |number: u32, _: &[u32; 3]| Some(cells.partition_point(|c| *c < number));
            let part = self.joined(cells, |number, face| place(number, face).map(|i| i as u32));
            let mut volumes = vec![0.0; part.iter().max().map_or(0, |last| *last as usize + 1)];
            if volumes.len() == 1 {
                continue;
            }
            let volume = |&cell: &u32| self.cells[cell as usize].volume;
            cells.iter().zip(&part).for_each(|(cell, p)| volumes[*p as usize] += volume(cell));
            let by_volume = (0..volumes.len()).rev();
            let largest = by_volume.max_by(|a, b| volumes[*a].total_cmp(&volumes[*b])).unwrap_or(0);
            // the first piece that is no chip stays what it was
            let mut all = vec![NONE; volumes.len()];
            let source = self.elements[element as usize];
            for p in (0..all.len()).filter(|&p| p == largest || volumes[p] >= CHIP) {
                all[p] = element;
                if all[..p].iter().any(|own| *own != NONE) {
                    all[p] = self.elements.len() as u32;
                    self.elements.push(Element { parent: element, ..source });
                }
                self.elements[all[p] as usize].portion = [0.0; 4];
            }
            for (&number, p) in cells.iter().zip(part) {
                let cell = &mut self.cells[number as usize];
                cell.element = all[p as usize];
                if cell.element == NONE {
                    chips.push(number);
                    cell.element = all[largest];
                }
                let to = &mut self.elements[cell.element as usize].portion;
                if self.order == Order::Hexahedra {
                    to.iter_mut().for_each(|part| *part += 0.25 * cell.volume);
                    continue;
                }
                let part = cell.volume / cell.points().len() as f64;
                for &p in cell.points() {
                    let weights = self.points[p as usize].weights_in(source.vertices);
                    (0..4).for_each(|i| to[i] += part * weights[i]);
                }
            }
        }
        self.free(&chips);
        own.into_keys().chain(copies..self.elements.len() as u32).collect()
    }

    /// Glues triangles, or lines, that were opened, by the cells on either side.
    fn bind(&mut self, opened: &[([u32; 3], [usize; 2])], glue: Gluing) {
        let is_line = self.order == Order::Triangles;
        let samples: Vec<&[f64]> = match is_line {
            true => LINE_SAMPLES.iter().map(|part| &part[..]).collect(),
            false => SAMPLES.iter().map(|part| &part[..]).collect(),
        };
        for &(face, cells) in opened {
            let sides = cells.map(|cell| self.cells[cell].element);
            if sides[0] == sides[1] {
                continue;
            }
            // the corner that triangles do not have comes last
            let real = if is_line { &face[..2] } else { &face[..] };
            let corners: Vec<Point> = real.iter().map(|p| self.points[*p as usize]).collect();
            let source = self.elements[sides[0] as usize].source;
            let stiffness = glue(source, &corners) / samples.len() as f64;
            self.bonds.extend(samples.iter().map(|part| {
                let place = Point::mean(corners.iter().zip(part.iter().copied()));
                Bond { place, sides, stiffness }
            }));
        }
    }

    /// Lets bonds go with those copies of their elements, numbered from `first` on, that have their places.
    fn part_bonds(&mut self, first: u32) {
        if self.bonds.is_empty() || self.elements.len() == first as usize {
            return;
        }
        // by the element from which each came
        let copies = &self.elements[first as usize..];
        let mut parts: BTreeMap<u32, Vec<&Cell>> =
            copies.iter().map(|copy| (copy.parent, Vec::new())).collect();
        for cell in &self.cells {
            let e = cell.element;
            let from = if e < first { e } else { self.elements[e as usize].parent };
            if let Some(own) = parts.get_mut(&from) {
                own.push(cell);
            }
        }
        let mut bonds = std::mem::take(&mut self.bonds);
        for bond in &mut bonds {
            let inside = |cell: &Cell| self.inside(&bond.place, cell);
            for side in &mut bond.sides {
                let own = parts.get(side).into_iter().flatten();
                let best = own.max_by(|a, b| inside(a).total_cmp(&inside(b)));
                *side = best.map_or(*side, |cell| cell.element);
            }
        }
        self.bonds = bonds;
    }

    /// Least share of the corners of a cell that a point of its element has, negative beside the cell.
    pub(super) fn inside(&self, place: &Point, cell: &Cell) -> f64 {
        let element = &self.elements[cell.element as usize];
        let at = |point: &Point| match self.order {
            Order::Hexahedra => hexahedra::local(&element.all_vertices(), point),
            _ => {
                let [_, x, y, z] = point.weights_in(element.vertices);
                DVec3::new(x, y, z)
            }
        };
        // beside a triangle there is nothing
        let beside = |p: u32| if p == NONE { DVec3::Z } else { at(&self.points[p as usize]) };
        let shares = shares(cell.corners.map(beside), at(place));
        shares.map_or(f64::NEG_INFINITY, |own| own.into_iter().fold(f64::INFINITY, f64::min))
    }

    /// Opens all faces of some cells.
    fn free(&mut self, cells: &[u32]) {
        let faces =
            |number: &u32| [0, 1, 2, 3].map(|i| sorted(self.cells[*number as usize].face(i)));
        let faces: BTreeSet<[u32; 3]> = cells.iter().flat_map(faces).collect();
        if faces.is_empty() {
            return;
        }
        for cell in &mut self.cells {
            for i in 0..4 {
                cell.wound[i] |= faces.contains(&sorted(cell.face(i)));
            }
        }
    }

    fn is_cut(&self, edge: [u32; 2]) -> bool {
        self.cut.binary_search_by_key(&edge, |mark| mark.edge).is_ok()
    }

    /// Numbers of the cells that are left of each cell of the material as the last stroke began, ascending.
    pub fn parts(&self) -> Vec<Vec<u32>> {
        let count = self.uncut.as_ref().map_or(self.cells.len(), |uncut| uncut.cells.len());
        let mut parts = vec![Vec::new(); count];
        for (number, cell) in (0..).zip(&self.cells) {
            // before a stroke cells are their own beginnings
            let began = if self.uncut.is_some() { cell.began } else { number };
            parts[began as usize].push(number);
        }
        parts
    }

    /// For every corner of each of those cells the first that its material holds together with it; none where all is gone.
    pub fn held(&self, uncut: &Uncut, parts: &[Vec<u32>]) -> Vec<Option<[u32; 4]>> {
        let of = |(corners, own): (&[u32; 4], &Vec<u32>)| {
            let place = |n: u32, _: &[u32; 3]| own.binary_search(&n).ok().map(|at| at as u32);
            let set = if own.len() > 1 { self.joined(own, place) } else { vec![0; own.len()] };
            let at = |&p: &u32| own.iter().position(|&n| self.cells[n as usize].has(p));
            let of_corner = corners.each_ref().map(|p| at(p).map(|at| set[at]));
            let first = |own| of_corner.iter().position(|other| *other == own).unwrap_or(0) as u32;
            let mut held = of_corner.map(first);
            if corners[3] == NONE {
                held[3] = 3;
            }
            (!own.is_empty()).then_some(held)
        };
        uncut.cells.iter().zip(parts).map(of).collect()
    }

    /// Pairs of elements among some that hang together across a face, ascending.
    pub fn joined_elements(&self, is_among: impl Fn(u32) -> bool) -> Vec<[u32; 2]> {
        let mut faces: Vec<([u32; 3], u32)> = Vec::new();
        for cell in self.cells.iter().filter(|cell| is_among(cell.element)) {
            let open = (0..4).filter(|&i| !cell.wound[i]);
            faces.extend(open.map(|i| (sorted(cell.face(i)), cell.element)));
        }
        faces.sort_unstable();
        let both = faces.windows(2).filter(|pair| pair[0].0 == pair[1].0 && pair[0].1 != pair[1].1);
        let mut pairs: Vec<[u32; 2]> = both.map(|pair| [pair[0].1, pair[1].1]).collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    /// Gives elements that no longer hang together vertices of their own: who holds a vertex of the mesh keeps it, all others
    /// get a ghost. Elements that hang together across a face share the vertices that both have. Only vertices of `touched` elements are
    /// looked at: round all others nothing changed.
    fn part_nodes(&mut self, touched: &[u32]) -> Vec<u32> {
        let size = self.order.size();
        let mut is_near = vec![false; self.vertices as usize];
        for element in touched.iter().map(|&e| &self.elements[e as usize]) {
            (0..size).for_each(|i| is_near[element.vertex(i) as usize] = true);
        }
        let near = |element: &Element, i| is_near[element.vertex(i) as usize];
        // elements among which vertices are looked at, and the place of each among them
        let mut among: Vec<u32> = Vec::new();
        let mut place_of = vec![NONE; self.elements.len()];
        for (e, own) in self.elements.iter().enumerate() {
            if (0..size).any(|i| near(own, i)) {
                place_of[e] = among.len() as u32;
                among.push(e as u32);
            }
        }
        let is_among = |e: u32| place_of[e as usize] != NONE;
        let place = |e: u32, i: usize| (size * place_of[e as usize] as usize + i) as u32;
        let mut sets = DisjointSets::new(size * among.len());
        let mut holds = vec![false; size * among.len()];
        let mut alive = vec![false; among.len()];
        for cell in self.cells.iter().filter(|cell| is_among(cell.element)) {
            alive[place_of[cell.element as usize] as usize] = true;
            if cell.is_chip() {
                continue;
            }
            let element = &self.elements[cell.element as usize];
            for &p in cell.corners.iter().filter(|&&p| p < self.vertices) {
                let i = (0..size).find(|&i| element.vertex(i) == p).unwrap_or(0);
                holds[place(cell.element, i) as usize] = true;
            }
            if self.order == Order::TenNodes {
                for i in cell.edges().iter().filter_map(|edge| self.middle_on(element, *edge)) {
                    holds[place(cell.element, i) as usize] = true;
                }
            }
        }
        for [a, b] in self.joined_elements(is_among) {
            let [of_a, of_b] = [a, b].map(|e| &self.elements[e as usize]);
            for i in (0..size).filter(|&i| near(of_a, i)) {
                if let Some(j) = (0..size).find(|&j| of_b.vertex(j) == of_a.vertex(i)) {
                    sets.join(place(a, i), place(b, j));
                }
            }
        }
        // whether a set holds its vertex, and what moves it from now on
        let all = 0..holds.len() as u32;
        let mut keeps = vec![false; holds.len()];
        all.clone().for_each(|i| keeps[sets.root(i) as usize] |= holds[i as usize]);
        let mut moved_by = vec![NONE; holds.len()];
        let mut taken = vec![false; self.vertices as usize + self.ghosts.len()];
        let corner = |i: u32| (among[i as usize / size] as usize, i as usize % size);
        let is_looked_at = |i: &u32| {
            let (element, at) = corner(*i);
            alive[*i as usize / size] && near(&self.elements[element], at)
        };
        let living: Vec<u32> = all.filter(is_looked_at).collect();
        for &i in &living {
            let (element, at) = corner(i);
            let node = self.elements[element].node(at);
            let root = sets.root(i) as usize;
            if keeps[root] {
                (moved_by[root], taken[node as usize]) = (node, true);
            }
        }
        let mut origins = Vec::new();
        for i in living {
            let (element, at) = corner(i);
            let (root, node) = (sets.root(i) as usize, self.elements[element].node(at));
            if moved_by[root] == NONE {
                moved_by[root] = node;
                if std::mem::replace(&mut taken[node as usize], true) {
                    moved_by[root] = self.vertices + self.ghosts.len() as u32;
                    self.ghosts.push(self.elements[element].vertex(at));
                    origins.push(node);
                }
            }
            self.elements[element].move_by(at, moved_by[root]);
        }
        origins
    }

    /// The vertex of a ten-node tetrahedron that lies on an edge of its material.
    fn middle_on(&self, element: &Element, edge: [u32; 2]) -> Option<usize> {
        let weights = edge.map(|p| self.points[p as usize].weights_in(element.vertices));
        let mut ends = (0..4).filter(|&i| weights.iter().any(|own| own[i] != 0.0));
        let (Some(a), Some(b), None) = (ends.next(), ends.next(), ends.next()) else { return None };
        // by the higher vertex, so that all who have this edge agree
        let end = if element.vertices[a] < element.vertices[b] { b } else { a };
        let [s, t] = weights.map(|own| own[end]);
        (s.min(t) <= 0.5 && 0.5 < s.max(t)).then(|| middle_of(a, b))
    }

    /// Forgets the material of elements that are gone.
    pub fn keep(&mut self, is_left: impl Fn(u32) -> bool) {
        self.cells.retain(|cell| is_left(cell.element));
    }

    /// Area of one side of all wounds, of triangles their length, when `rest` says where the vertices of the mesh are. Wounds in
    /// distorted hexahedra are taken as flat between their points.
    pub fn wound_area(&self, rest: &dyn Fn(u32) -> DVec3) -> f64 {
        let point = |p: u32| -> DVec3 {
            let Point { vertices, weights } = self.points[p as usize];
            vertices.iter().zip(weights).filter(|(_, w)| *w != 0.0).map(|(&v, w)| w * rest(v)).sum()
        };
        let faces = self.cells.iter().flat_map(|cell| {
            let open = (0..cell.points().len()).filter(|&i| cell.wound[i]);
            open.map(|i| cell.face(i))
        });
        if self.order == Order::Triangles {
            let length = |face: [u32; 3]| {
                let [a, b, _] = sorted(face);
                point(a).distance(point(b))
            };
            return faces.map(length).sum::<f64>() / 2.0;
        }
        // both sides, and two triangles in a parallelogram
        let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
        faces.map(|face| area(face.map(point))).sum::<f64>() / 4.0
    }

    /// Faces of the material that bound it, outward: the cell behind each, and whether it was laid open by a cut.
    pub fn skin(&self) -> Vec<([u32; 3], u32, bool)> {
        self.skin_of(|_| true)
    }

    /// The same of cells that `chosen` picks. Triangles of a membrane are all of it.
    pub fn skin_of(&self, chosen: impl Fn(&Cell) -> bool) -> Vec<([u32; 3], u32, bool)> {
        if self.order == Order::Triangles {
            let own = (0..).zip(&self.cells).filter(|(_, cell)| chosen(cell));
            let of = |(number, Cell { corners: [a, b, c, _], .. }): (u32, &Cell)| {
                ([*a, *b, *c], number, false)
            };
            return own.map(of).collect();
        }
        let mut is_near = vec![false; self.points.len()];
        for cell in self.cells.iter().filter(|cell| chosen(cell)) {
            cell.corners.iter().for_each(|&p| is_near[p as usize] = true);
        }
        let mut faces: Vec<([u32; 3], u32, usize)> = Vec::new();
        for (number, cell) in (0..).zip(&self.cells) {
            // others have no face in common with one of them
            if cell.corners.iter().filter(|p| is_near[**p as usize]).count() < 3 {
                continue;
            }
            faces.extend((0..4).map(|i| (sorted(cell.face(i)), number, i)));
        }
        faces.sort_unstable();
        let mut skin: Vec<(u32, usize)> = Vec::new();
        for round in faces.chunk_by(|a, b| a.0 == b.0) {
            let is_wound =
                |(_, cell, i): &([u32; 3], u32, usize)| self.cells[*cell as usize].wound[*i];
            skin.extend(
                round
                    .iter()
                    .filter(|f| round.len() == 1 || is_wound(f))
                    .filter(|(_, cell, _)| chosen(&self.cells[*cell as usize]))
                    .map(|&(_, cell, i)| (cell, i)),
            );
        }
        skin.sort_unstable();
        let of = |(number, i): (u32, usize)| {
            let cell = &self.cells[number as usize];
            (cell.face(i), number, cell.wound[i])
        };
        skin.into_iter().map(of).collect()
    }
}

impl Cell {
    /// What is left on the side of `keeps` when its edge from there is cut at a point, `part` of it.
    fn with(&self, [keeps, goes]: [u32; 2], point: u32, part: f64) -> Self {
        let mut cell = *self;
        cell.volume *= part;
        for i in 0..4 {
            if self.corners[i] == goes {
                cell.corners[i] = point;
            } else if self.corners[i] == keeps {
                // the face between both parts
                cell.wound[i] = false;
            }
        }
        cell
    }
}

/// Opens the faces between parts of different groups of one cell, given by their places: those that were not open, with the two parts.
fn part_groups(
    cells: &mut [Cell],
    parts: &[usize],
    group: impl Fn(&Cell) -> u32,
) -> Vec<([u32; 3], [usize; 2])> {
    let mut faces: Vec<([u32; 3], usize, usize)> = Vec::new();
    for &part in parts {
        faces.extend((0..4).map(|i| (sorted(cells[part].face(i)), part, i)));
    }
    faces.sort_unstable();
    let mut opened = Vec::new();
    for pair in faces.windows(2) {
        let [(face, a, i), (other, b, j)] = [pair[0], pair[1]];
        if face == other && group(&cells[a]) != group(&cells[b]) {
            if !cells[a].wound[i] {
                opened.push((face, [a, b]));
            }
            (cells[a].wound[i], cells[b].wound[j]) = (true, true);
        }
    }
    opened
}

/// Weights with 0 behind them.
pub(super) fn padded<const N: usize>(weights: [f64; N]) -> [f64; 10] {
    std::array::from_fn(|i| weights.get(i).copied().unwrap_or(0.0))
}

/// Those of four corners that there are.
pub(super) fn real(corners: &[u32; 4]) -> &[u32] {
    &corners[..if corners[3] == NONE { 3 } else { 4 }]
}

fn sorted<const N: usize>(mut points: [u32; N]) -> [u32; N] {
    points.sort_unstable();
    points
}
