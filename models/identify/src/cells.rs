//! Elements of a mesh.

use crate::error::{ElementError, IdentifyError};
use crate::geometry::ElementGeometry;
use crate::kind::ElementKind;

/// Cells of a mesh, nodes in the order of Gmsh and VTK. Elements are counted in this order of kinds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cells<'a> {
    /// Triangles.
    pub triangles: &'a [[u32; 3]],
    /// Quadrilaterals.
    pub quads: &'a [[u32; 4]],
    /// Tetrahedra.
    pub tetrahedra: &'a [[u32; 4]],
    /// Hexahedra.
    pub hexahedra: &'a [[u32; 8]],
}

impl<'a> Cells<'a> {
    /// Number of elements of all kinds.
    pub fn len(&self) -> usize {
        self.triangles.len() + self.quads.len() + self.tetrahedra.len() + self.hexahedra.len()
    }

    /// Whether there is no element.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Kind, index among its kind, and nodes of element `element` among all.
    ///
    /// # Panics
    /// If there is no such element.
    pub fn element(&self, element: usize) -> (ElementKind, usize, &'a [u32]) {
        let mut index = element;
        if index < self.triangles.len() {
            return (ElementKind::Triangle, index, &self.triangles[index]);
        }
        index -= self.triangles.len();
        if index < self.quads.len() {
            return (ElementKind::Quad, index, &self.quads[index]);
        }
        index -= self.quads.len();
        if index < self.tetrahedra.len() {
            return (ElementKind::Tetrahedron, index, &self.tetrahedra[index]);
        }
        index -= self.tetrahedra.len();
        (ElementKind::Hexahedron, index, &self.hexahedra[index])
    }

    /// Rest shape of element `element` among all.
    ///
    /// # Errors
    /// [`IdentifyError::NodeOutOfRange`], [`IdentifyError::Element`].
    pub fn geometry(
        &self,
        points: &[[f64; 3]],
        element: usize,
    ) -> Result<ElementGeometry, IdentifyError> {
        let (kind, index, nodes) = self.element(element);
        let mut positions = [[0.0; 3]; 8];
        for (position, &node) in positions.iter_mut().zip(nodes) {
            *position = *points.get(node as usize).ok_or(IdentifyError::NodeOutOfRange {
                kind,
                index,
                node,
                points: points.len(),
            })?;
        }
        ElementGeometry::new(kind, &positions[..nodes.len()])
            .map_err(|source| self.locate(element, source))
    }

    pub(crate) fn locate(&self, element: usize, source: ElementError) -> IdentifyError {
        let (kind, index, _) = self.element(element);
        IdentifyError::Element { kind, index, source }
    }
}
