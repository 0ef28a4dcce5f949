//! The surface of what is left of a body, with the element behind every face.

use sinew::engine::connectivity::ElementKind;
use std::collections::HashSet;

/// A triangle of the surface, outward.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Face {
    /// Vertices in the mesh.
    pub vertices: [u32; 3],
    /// Kind and index of the element behind; none behind a membrane.
    pub element: Option<(ElementKind, u32)>,
    /// Whether it is the second half of a quadrilateral.
    pub second: bool,
}

/// The surface of a solid ([`Simulation::surface`](sinew::simulation::Simulation::surface)), and the membrane triangles and
/// quadrilaterals that do not lie on it.
pub fn boundary(
    solid: &[([u32; 3], ElementKind, u32)],
    triangles: &[[u32; 3]],
    quads: &[[u32; 4]],
) -> Vec<Face> {
    let key = |mut face: [u32; 4]| {
        face.sort_unstable();
        face
    };
    let mut outside = HashSet::new();
    let mut found = Vec::new();
    let mut half: Option<[u32; 3]> = None;
    for &(vertices, kind, e) in solid {
        // the halves of a quadrilateral follow each other
        let first = half.take();
        found.push(Face { vertices, element: Some((kind, e)), second: first.is_some() });
        let [a, b, c] = vertices;
        match first {
            Some([p, q, r]) => drop(outside.insert(key([p, q, r, c]))),
            None if kind == ElementKind::Hexahedron => half = Some(vertices),
            None => drop(outside.insert(key([a, b, c, u32::MAX]))),
        }
    }
    let triangles = triangles.iter().map(|&[a, b, c]| [a, b, c, u32::MAX]);
    let sheets = triangles.chain(quads.iter().copied());
    for sheet in sheets.filter(|sheet| !outside.contains(&key(*sheet))) {
        let [a, b, c, d] = sheet;
        found.push(Face { vertices: [a, b, c], element: None, second: false });
        if d != u32::MAX {
            found.push(Face { vertices: [a, c, d], element: None, second: true });
        }
    }
    found
}
