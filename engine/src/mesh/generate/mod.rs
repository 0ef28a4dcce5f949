//! Meshes of simple bodies, with their sides as named groups.

mod cup;
mod jitter;
mod sheets;
mod solids;
mod specimen;

pub use cup::cup_hexahedra;
pub use jitter::{irregular_box_tets, jitter_interior};
pub use sheets::{disc_quads, disc_triangles, quad_grid, sphere_triangles, triangle_grid};
pub use solids::{
    box_hexahedra, box_tets, cylinder_hexahedra, cylinder_tets, sphere_tets, tube_hexahedra,
};
pub use specimen::{specimen_hexahedra, specimen_quads, specimen_tets, specimen_triangles};

use super::error::MeshError;
use super::{Group, Mesh};
use crate::element_kind::{ByKind, ElementKind};
use crate::memory;
use glam::DVec3;

pub(super) fn length(
    generator: &'static str,
    parameter: &'static str,
    value: f64,
) -> Result<(), MeshError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    let remedy = "give a finite length above 0 m";
    Err(MeshError::InvalidParameter { generator, parameter, value: value.to_string(), remedy })
}

fn cells(generator: &'static str, parameter: &'static str, value: usize) -> Result<(), MeshError> {
    if value > 0 {
        return Ok(());
    }
    let remedy = "give at least one cell";
    Err(MeshError::InvalidParameter { generator, parameter, value: value.to_string(), remedy })
}

/// Refuses meshes whose vertices or cells 32-bit indices cannot count.
pub(super) fn fits(
    generator: &str,
    what: &'static str,
    count: Option<usize>,
) -> Result<usize, MeshError> {
    match count.filter(|&count| count < u32::MAX as usize) {
        Some(count) => {
            // with its edges and faces while it is made
            memory::fits(&format!("{generator} with {count} {what}"), || 260 * count as u64)?;
            Ok(count)
        }
        None => Err(MeshError::TooMany {
            file: generator.to_owned(),
            what,
            count: count.map_or(u64::MAX, |count| count as u64),
            limit: u64::from(u32::MAX) - 1,
        }),
    }
}

pub(super) fn product(factors: &[usize]) -> Option<usize> {
    factors.iter().try_fold(1usize, |product, &factor| product.checked_mul(factor))
}

fn volume(points: &[DVec3], [a, b, c, d]: [u32; 4]) -> f64 {
    let p = |i: u32| points[i as usize];
    (p(b) - p(a)).dot((p(c) - p(a)).cross(p(d) - p(a))) / 6.0
}

/// The tetrahedron, with its last two vertices exchanged if its volume is negative.
fn oriented(points: &[DVec3], [a, b, c, d]: [u32; 4]) -> [u32; 4] {
    if volume(points, [a, b, c, d]) < 0.0 { [a, b, d, c] } else { [a, b, c, d] }
}

/// Makes the cells of a box from the origin to `size` (m) smaller towards its sides through the origin: along each axis a
/// vertex at the share `t` of the edge moves to the share `t^grading`. Above 1 cells at the origin are the smallest; below
/// 1 those at the far end.
///
/// Small cells pay at the rim of a clamp, where stress is singular.
///
/// # Errors
/// [`MeshError::InvalidParameter`] for an exponent below 0.25 or above 4, and for vertices that are not in this box; the mesh is
/// then as it was.
///
/// ```
/// use glam::DVec3;
/// use sinew_engine::mesh::generate::{box_hexahedra, grade_box};
///
/// let size = DVec3::new(0.4, 0.1, 0.1);
/// let mut mesh = box_hexahedra(size, [4, 1, 1])?;
/// grade_box(&mut mesh, size, DVec3::new(2.0, 1.0, 1.0))?;
/// let mut x: Vec<f64> = mesh.points.iter().map(|p| p.x).collect();
/// x.dedup();
/// assert!(x.iter().zip([0.0, 0.025, 0.1, 0.225, 0.4]).all(|(x, at)| (x - at).abs() < 1e-15));
/// # Ok::<(), sinew_engine::mesh::MeshError>(())
/// ```
pub fn grade_box(mesh: &mut Mesh, size: DVec3, grading: DVec3) -> Result<(), MeshError> {
    let invalid = |parameter, value: f64, remedy| {
        let (generator, value) = ("grade_box", value.to_string());
        Err(MeshError::InvalidParameter { generator, parameter, value, remedy })
    };
    for (k, parameter) in ["grading[0]", "grading[1]", "grading[2]"].into_iter().enumerate() {
        if !(0.25..=4.0).contains(&grading[k]) {
            let remedy = "give an exponent from 0.25 to 4; 1 leaves cells equal";
            return invalid(parameter, grading[k], remedy);
        }
    }
    let graded = |k: &usize| grading[*k] != 1.0;
    for k in (0..3).filter(graded) {
        if !mesh.points.iter().all(|x| (0.0..=1.0).contains(&(x[k] / size[k]))) {
            let remedy = "give the size of the box, which has a corner at the origin";
            return invalid(["size.x", "size.y", "size.z"][k], size[k], remedy);
        }
    }
    for k in (0..3).filter(graded) {
        for x in &mut mesh.points {
            x[k] = size[k] * libm::pow(x[k] / size[k], grading[k]);
        }
    }
    Ok(())
}

/// Place `i` of `n` equal parts of a length; the last one is exactly its end.
fn part(i: usize, n: usize, length: f64) -> f64 {
    if i == n { length } else { length * i as f64 / n as f64 }
}

/// Adds the boundary faces, a group for each name that `side` gives them, and the group `body`.
fn name_sides(mesh: &mut Mesh, names: &[&str], side: impl Fn(&Mesh, &[u32]) -> usize) {
    let surface = mesh.surface();
    (mesh.triangles, mesh.quads) = (surface.triangles, surface.quads);
    let mut groups: Vec<Group> = names
        .iter()
        .map(|&name| Group { name: name.to_owned(), dimension: 2, ..Group::default() })
        .collect();
    for (i, triangle) in mesh.triangles.iter().enumerate() {
        let group = &mut groups[side(mesh, triangle)];
        group.cells.triangles.push(i as u32);
        group.vertices.extend(triangle);
    }
    for (i, quad) in mesh.quads.iter().enumerate() {
        let group = &mut groups[side(mesh, quad)];
        group.cells.quads.push(i as u32);
        group.vertices.extend(quad);
    }
    for group in &mut groups {
        group.vertices.sort_unstable();
        group.vertices.dedup();
    }
    groups.push(Group {
        name: "body".to_owned(),
        dimension: 3,
        vertices: (0..mesh.points.len() as u32).collect(),
        cells: all(mesh, ElementKind::is_solid),
    });
    mesh.groups = groups;
}

/// The group `body` of a mesh of triangles and quadrilaterals.
fn whole(mesh: &Mesh) -> Group {
    Group {
        name: "body".to_owned(),
        dimension: 2,
        vertices: (0..mesh.points.len() as u32).collect(),
        cells: all(mesh, |kind| !kind.is_solid()),
    }
}

/// All cells of some kinds.
fn all(mesh: &Mesh, kinds: impl Fn(ElementKind) -> bool) -> ByKind<Vec<u32>> {
    ByKind::of(|kind| (0..if kinds(kind) { mesh.count(kind) as u32 } else { 0 }).collect())
}

/// The hexahedra of a grid of `n` cells whose vertex `(i, j, k)` has the index
/// `(i (ny + 1) + j) (nz + 1) + k`.
fn grid_hexahedra([nx, ny, nz]: [usize; 3]) -> Vec<[u32; 8]> {
    let (x, y) = (((ny + 1) * (nz + 1)) as u32, (nz + 1) as u32);
    let mut hexahedra = Vec::with_capacity(nx * ny * nz);
    for i in 0..nx as u32 {
        for j in 0..ny as u32 {
            for k in 0..nz as u32 {
                let a = i * x + j * y + k;
                let bottom = [a, a + x, a + x + y, a + y];
                let [e, f, g, h] = bottom.map(|v| v + 1);
                let [a, b, c, d] = bottom;
                hexahedra.push([a, b, c, d, e, f, g, h]);
            }
        }
    }
    hexahedra
}

/// The quadrilaterals of a grid of `n` cells whose vertex `(i, j)` has the index `i (ny + 1) + j`.
fn grid_quads([nx, ny]: [usize; 2]) -> Vec<[u32; 4]> {
    let x = (ny + 1) as u32;
    let corners = (0..nx as u32).flat_map(|i| (0..ny as u32).map(move |j| i * x + j));
    corners.map(|a| [a, a + x, a + x + 1, a + 1]).collect()
}

/// Names the six sides of a grid by the first or last vertices along each axis.
fn name_grid_sides(mesh: &mut Mesh, [nx, ny, nz]: [usize; 3]) {
    let place = |v: u32| {
        let (row, k) = (v as usize / (nz + 1), v as usize % (nz + 1));
        [row / (ny + 1), row % (ny + 1), k]
    };
    let sides = [(0, 0), (0, nx), (1, 0), (1, ny), (2, 0), (2, nz)];
    name_sides(mesh, &["x0", "x1", "y0", "y1", "z0", "z1"], |_, face| {
        let on = |&(axis, at): &(usize, usize)| face.iter().all(|&v| place(v)[axis] == at);
        sides.iter().position(on).unwrap_or(0)
    });
}

#[cfg(test)]
mod tests;
