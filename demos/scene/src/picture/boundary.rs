//! The surface of what is left of a body, with the element behind every face.

use glam::DVec3;
use sinew::engine::isoparametric::{HEXAHEDRON_FACES, TETRAHEDRON10_FACES};
use sinew::engine::mesh::Mesh;
use std::collections::HashMap;

/// A triangle of the surface, outward.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Face {
    /// Vertices in the mesh.
    pub vertices: [u32; 3],
    /// Element behind: tetrahedra, then hexahedra, in the order of the mesh; none behind a membrane.
    pub element: Option<u32>,
    /// Whether it is the second half of a quadrilateral.
    pub second: bool,
}

/// Faces of a right-handed tetrahedron, outward.
const TETRAHEDRON_FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

/// Faces that exactly one of these elements (tetrahedra, then hexahedra) has, and the membrane triangles and
/// quadrilaterals that do not lie on them.
pub(crate) fn boundary(
    mesh: &Mesh,
    solids: &[u32],
    triangles: &[[u32; 3]],
    quads: &[[u32; 4]],
) -> Vec<Face> {
    let tetrahedra = mesh.tetrahedra.len();
    let point = |v: u32| mesh.points[v as usize];
    let inverted = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).cross(c - a).dot(d - a) < 0.0;
    // (sorted vertices, u32::MAX last for triangles) -> how often
    let mut count: HashMap<[u32; 4], u32> = HashMap::new();
    let mut faces: Vec<([u32; 4], u32)> = Vec::new();
    for &e in solids {
        if let Some(t) = mesh.tetrahedra.get(e as usize) {
            let [a, b, c, d] = t.map(point);
            let turned = inverted(a, b, c, d);
            if let Some(ten) = mesh.second_order(e as usize) {
                for f in TETRAHEDRON10_FACES {
                    let [a, b, c] = f.map(|k| ten[k]);
                    let face = if turned { [a, c, b, u32::MAX] } else { [a, b, c, u32::MAX] };
                    faces.push((face, e));
                }
                continue;
            }
            for f in TETRAHEDRON_FACES {
                let [a, b, c] = f.map(|k| t[k]);
                let face = if turned { [a, c, b, u32::MAX] } else { [a, b, c, u32::MAX] };
                faces.push((face, e));
            }
        } else if let Some(h) = mesh.hexahedra.get(e as usize - tetrahedra) {
            let [a, b, _, d, up, ..] = h.map(point);
            let turned = inverted(a, b, d, up);
            for f in HEXAHEDRON_FACES {
                let [a, b, c, d] = f.map(|k| h[k]);
                faces.push((if turned { [a, d, c, b] } else { [a, b, c, d] }, e));
            }
        }
    }
    let key = |mut face: [u32; 4]| {
        face.sort_unstable();
        face
    };
    for (face, _) in &faces {
        *count.entry(key(*face)).or_default() += 1;
    }
    let mut found = Vec::new();
    let mut push = |[a, b, c, d]: [u32; 4], element| {
        found.push(Face { vertices: [a, b, c], element, second: false });
        if d != u32::MAX {
            found.push(Face { vertices: [a, c, d], element, second: true });
        }
    };
    for &(face, e) in &faces {
        if count[&key(face)] == 1 {
            push(face, Some(e));
        }
    }
    let sheets =
        triangles.iter().map(|&[a, b, c]| [a, b, c, u32::MAX]).chain(quads.iter().copied());
    for sheet in sheets.filter(|sheet| count.get(&key(*sheet)) != Some(&1)) {
        push(sheet, None);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use sinew::engine::mesh::generate::{box_hexahedra, box_tets};

    fn volume(mesh: &Mesh, faces: &[Face]) -> f64 {
        let p = |v: u32| mesh.points[v as usize];
        faces.iter().map(|f| f.vertices.map(p)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    #[test]
    fn surfaces_enclose_their_elements_outward() {
        let size = DVec3::new(1.0, 2.0, 3.0);
        for mesh in [box_tets(size, [2, 3, 2]).unwrap(), box_hexahedra(size, [2, 3, 2]).unwrap()] {
            let solids = (mesh.tetrahedra.len() + mesh.hexahedra.len()) as u32;
            let all: Vec<u32> = (0..solids).collect();
            let faces = boundary(&mesh, &all, &[], &[]);
            assert_eq!(faces.len(), 2 * 2 * (6 + 6 + 4));
            assert!((volume(&mesh, &faces) - 6.0).abs() < 1e-12);
            // the same as the engine's own surface
            let mut own: Vec<[u32; 3]> = faces.iter().map(|f| f.vertices).collect();
            if mesh.hexahedra.is_empty() {
                let mut engine = mesh.surface_triangles();
                let turn = |t: &mut [u32; 3]| {
                    let least = (0..3).min_by_key(|&k| t[k]).unwrap();
                    t.rotate_left(least);
                };
                own.iter_mut().for_each(turn);
                engine.iter_mut().for_each(turn);
                own.sort_unstable();
                engine.sort_unstable();
                assert_eq!(own, engine);
            }
            // a hole appears where an element went
            let left: Vec<u32> = all[1..].to_vec();
            let rest = volume(&mesh, &boundary(&mesh, &left, &[], &[]));
            let gone = match mesh.tetrahedra.first() {
                Some(t) => mesh.signed_volume(*t).unwrap(),
                None => mesh.hexahedron_volume(mesh.hexahedra[0]).unwrap(),
            };
            assert!((rest - (6.0 - gone)).abs() < 1e-12);
        }
    }

    #[test]
    fn membranes_on_a_solid_are_not_drawn_twice() {
        let mesh = box_hexahedra(DVec3::ONE, [1, 1, 1]).unwrap();
        let [a, b, c, d] = mesh.surface_quads()[0];
        let alone = [a, b, 7 - a];
        let faces = boundary(&mesh, &[0], &[alone], &[[c, d, a, b]]);
        assert_eq!(faces.len(), 12 + 1);
        assert_eq!(faces[12], Face { vertices: alone, element: None, second: false });
    }
}
