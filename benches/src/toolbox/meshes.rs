//! Meshes of the demos, and uniform refinement: every tetrahedron into eight, vertices of the coarse mesh first.

use super::error::{BenchError, Result};
use glam::DVec3;
use sinew::engine::mesh::{CheckOptions, Group, Mesh, check};
use std::collections::HashMap;
use std::path::Path;

/// A mesh of the demos, checked.
///
/// # Errors
/// When it cannot be read or is damaged.
pub fn demo_mesh(file: &str) -> Result<Mesh> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../demos/meshes").join(file);
    let checked = check(&Mesh::read(&path)?, &CheckOptions::default());
    let checked = checked.map_err(|e| BenchError::Request {
        what: format!("{}: {e}", path.display()),
        remedy: "restore the file".into(),
    })?;
    Ok(checked.mesh)
}

/// The mesh with every edge halved. Vertex `i` of the mesh stays vertex `i`; midpoints follow. A
/// midpoint belongs to a group when both ends of its edge do, as on
/// flat faces and whole volumes it should.
pub fn refined(mesh: &Mesh) -> Mesh {
    let mut points = mesh.points.clone();
    let mut midpoints: HashMap<[u32; 2], u32> = HashMap::new();
    let mut tetrahedra = Vec::with_capacity(8 * mesh.tetrahedra.len());
    let mut middle = |points: &mut Vec<DVec3>, a: u32, b: u32| {
        *midpoints.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            points.push(0.5 * (points[a as usize] + points[b as usize]));
            points.len() as u32 - 1
        })
    };
    for &[a, b, c, d] in &mesh.tetrahedra {
        let ab = middle(&mut points, a, b);
        let ac = middle(&mut points, a, c);
        let ad = middle(&mut points, a, d);
        let bc = middle(&mut points, b, c);
        let bd = middle(&mut points, b, d);
        let cd = middle(&mut points, c, d);
        tetrahedra.extend([[a, ab, ac, ad], [ab, b, bc, bd], [ac, bc, c, cd], [ad, bd, cd, d]]);
        // the octahedron in the middle, cut along its shortest diagonal
        let length = |p: u32, q: u32| points[p as usize].distance(points[q as usize]);
        let rings = [
            ([ac, bd], [ab, bc, cd, ad]),
            ([ab, cd], [ac, ad, bd, bc]),
            ([ad, bc], [ab, ac, cd, bd]),
        ];
        let shortest = rings
            .into_iter()
            .min_by(|(p, _), (q, _)| length(p[0], p[1]).total_cmp(&length(q[0], q[1])));
        if let Some(([p, q], ring)) = shortest {
            for i in 0..4 {
                tetrahedra.push([p, q, ring[i], ring[(i + 1) % 4]]);
            }
        }
    }
    let volume = |t: &[u32; 4], points: &[DVec3]| {
        let [a, b, c, d] = t.map(|i| points[i as usize]);
        (b - a).cross(c - a).dot(d - a)
    };
    for t in &mut tetrahedra {
        if volume(t, &points) < 0.0 {
            t.swap(2, 3);
        }
    }
    let groups = mesh
        .groups
        .iter()
        .map(|group| {
            let inside = |v: &u32| group.vertices.binary_search(v).is_ok();
            let mut vertices = group.vertices.clone();
            let new = midpoints.iter().filter(|(edge, _)| edge.iter().all(inside));
            vertices.extend(new.map(|(_, &v)| v));
            vertices.sort_unstable();
            Group {
                name: group.name.clone(),
                dimension: group.dimension,
                vertices,
                ..Group::default()
            }
        })
        .collect();
    Mesh {
        source: format!("{}, refined", mesh.source),
        points,
        tetrahedra,
        groups,
        ..Mesh::default()
    }
}
