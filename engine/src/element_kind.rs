//! The kinds of elements.

use serde::{Deserialize, Serialize};

/// Kinds of elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ElementKind {
    /// Tetrahedron of first or of second order; a body has those of one order only.
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

    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tetrahedron => "tetrahedron",
            Self::Triangle => "membrane triangle",
            Self::Hexahedron => "hexahedron",
            Self::Quad => "membrane quadrilateral",
        }
    }
}

/// Something for every kind of element.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ByKind<T>(pub [T; 4]);

impl<T> std::ops::Index<ElementKind> for ByKind<T> {
    type Output = T;
    fn index(&self, kind: ElementKind) -> &T {
        &self.0[kind as usize]
    }
}

impl<T> std::ops::IndexMut<ElementKind> for ByKind<T> {
    fn index_mut(&mut self, kind: ElementKind) -> &mut T {
        &mut self.0[kind as usize]
    }
}
