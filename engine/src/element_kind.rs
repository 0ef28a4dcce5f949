//! The kinds of elements, and lists by kind.

use crate::element::{TETRAHEDRON_EDGES, TETRAHEDRON_FACES, TRIANGLE_EDGES};
use crate::isoparametric::{
    HEXAHEDRON_PAIRS, QUAD_PAIRS, TETRAHEDRON10_FACES, TETRAHEDRON10_PAIRS,
};
use serde::{Deserialize, Serialize};
use std::ops::{Index, IndexMut};
use std::slice::ChunksExact;

/// Kinds of elements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ElementKind {
    /// Tetrahedron of first or of second order; a body has those of one order only.
    #[default]
    Tetrahedron,
    /// Membrane triangle.
    Triangle,
    /// Hexahedron.
    Hexahedron,
    /// Membrane quadrilateral.
    Quad,
}

impl ElementKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Tetrahedron, Self::Triangle, Self::Hexahedron, Self::Quad];
    /// All of them in the order in which mesh files list their cells.
    pub const IN_FILES: [Self; 4] =
        [Self::Tetrahedron, Self::Hexahedron, Self::Triangle, Self::Quad];

    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tetrahedron => "tetrahedron",
            Self::Triangle => "membrane triangle",
            Self::Hexahedron => "hexahedron",
            Self::Quad => "membrane quadrilateral",
        }
    }

    /// Whether it has a volume.
    pub fn is_solid(self) -> bool {
        matches!(self, Self::Tetrahedron | Self::Hexahedron)
    }
}

/// Something for every kind of element.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "[T; 4]", into = "[T; 4]", bound(serialize = "T: Clone + Serialize"))]
pub struct ByKind<T> {
    /// For tetrahedra of either order.
    pub tetrahedra: T,
    /// For triangles.
    pub triangles: T,
    /// For hexahedra.
    pub hexahedra: T,
    /// For quadrilaterals.
    pub quads: T,
}

impl<T> ByKind<T> {
    /// From the kind.
    pub fn of(make: impl FnMut(ElementKind) -> T) -> Self {
        ElementKind::ALL.map(make).into()
    }

    /// Every entry, in the order of [`ElementKind::ALL`].
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        ElementKind::ALL.into_iter().map(|kind| &self[kind])
    }

    /// Likewise, to be changed.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        let Self { tetrahedra, triangles, hexahedra, quads } = self;
        [tetrahedra, triangles, hexahedra, quads].into_iter()
    }

    /// Every entry in the order of [`ElementKind::IN_FILES`].
    pub fn in_files(&self) -> [&T; 4] {
        ElementKind::IN_FILES.map(|kind| &self[kind])
    }
}

impl<T> From<[T; 4]> for ByKind<T> {
    /// In the order of [`ElementKind::ALL`].
    fn from([tetrahedra, triangles, hexahedra, quads]: [T; 4]) -> Self {
        Self { tetrahedra, triangles, hexahedra, quads }
    }
}

impl<T> From<ByKind<T>> for [T; 4] {
    fn from(all: ByKind<T>) -> Self {
        [all.tetrahedra, all.triangles, all.hexahedra, all.quads]
    }
}

impl<T> Index<ElementKind> for ByKind<T> {
    type Output = T;
    fn index(&self, kind: ElementKind) -> &T {
        match kind {
            ElementKind::Tetrahedron => &self.tetrahedra,
            ElementKind::Triangle => &self.triangles,
            ElementKind::Hexahedron => &self.hexahedra,
            ElementKind::Quad => &self.quads,
        }
    }
}

impl<T> IndexMut<ElementKind> for ByKind<T> {
    fn index_mut(&mut self, kind: ElementKind) -> &mut T {
        match kind {
            ElementKind::Tetrahedron => &mut self.tetrahedra,
            ElementKind::Triangle => &mut self.triangles,
            ElementKind::Hexahedron => &mut self.hexahedra,
            ElementKind::Quad => &mut self.quads,
        }
    }
}

/// Numbers of the elements of one kind, as many for each: their vertices, or their edges. A ten-node tetrahedron
/// differs from one of four vertices in how many it has.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PerElement {
    width: usize,
    numbers: Vec<u32>,
}

impl PerElement {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.iter().len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// How many numbers an element has.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Those of an element.
    ///
    /// # Panics
    /// When there is no such element.
    #[inline]
    pub fn of(&self, element: u32) -> &[u32] {
        &self.numbers[element as usize * self.width..][..self.width]
    }

    /// Those of every element.
    pub fn iter(&self) -> ChunksExact<'_, u32> {
        self.numbers.chunks_exact(self.width.max(1))
    }

    /// Those of every element, where each has `N`; nothing where they have more or fewer.
    pub fn each<const N: usize>(&self) -> &[[u32; N]] {
        if self.width == N { self.numbers.as_chunks().0 } else { &[] }
    }

    /// All one after another.
    pub fn flat(&self) -> &[u32] {
        &self.numbers
    }

    /// The numbers of every element at some tuples of local places.
    pub(crate) fn at<const M: usize>(
        &self,
        local: &'static [[usize; M]],
    ) -> impl Iterator<Item = [u32; M]> {
        self.iter().flat_map(move |own| local.iter().map(move |places| places.map(|i| own[i])))
    }

    /// The same after what it tells the numbers of got others, and some elements others altogether; those beyond the end are new.
    pub(crate) fn renumbered(
        &self,
        number: &[u32],
        changed: &[u32],
        of: impl Fn(u32, usize) -> u32,
    ) -> Self {
        let width = self.width;
        let mut numbers: Vec<u32> = self.numbers.iter().map(|&own| number[own as usize]).collect();
        let count = changed.iter().map(|&e| e as usize + 1).max().unwrap_or(0);
        numbers.resize((width * count).max(numbers.len()), 0);
        for &e in changed {
            (0..width).for_each(|i| numbers[e as usize * width + i] = of(e, i));
        }
        Self { width, numbers }
    }

    /// `width` numbers for each element, one after another.
    pub(crate) fn filled(width: usize, numbers: impl Iterator<Item = u32>) -> Self {
        Self { width, numbers: numbers.collect() }
    }
}

impl<const N: usize> From<Vec<[u32; N]>> for PerElement {
    fn from(elements: Vec<[u32; N]>) -> Self {
        Self { width: N, numbers: elements.into_flattened() }
    }
}

impl<const N: usize> From<&[[u32; N]]> for PerElement {
    fn from(elements: &[[u32; N]]) -> Self {
        elements.to_vec().into()
    }
}

/// Local vertices of every pair of an element with so many vertices, in the order of its blocks and edges.
pub(crate) fn pairs(kind: ElementKind, vertices: usize) -> &'static [[usize; 2]] {
    match kind {
        ElementKind::Tetrahedron if vertices == 10 => &TETRAHEDRON10_PAIRS,
        ElementKind::Tetrahedron => &TETRAHEDRON_EDGES,
        ElementKind::Triangle => &TRIANGLE_EDGES,
        ElementKind::Hexahedron => &HEXAHEDRON_PAIRS,
        ElementKind::Quad => &QUAD_PAIRS,
    }
}

/// Local vertices of the triangles on the surface of a tetrahedron with so many vertices, outward; the membrane
/// triangle is one itself, and others have none.
pub(crate) fn local_triangles(kind: ElementKind, vertices: usize) -> &'static [[usize; 3]] {
    match kind {
        ElementKind::Tetrahedron if vertices == 10 => &TETRAHEDRON10_FACES,
        ElementKind::Tetrahedron => &TETRAHEDRON_FACES,
        ElementKind::Triangle => &[[0, 1, 2]],
        ElementKind::Hexahedron | ElementKind::Quad => &[],
    }
}
