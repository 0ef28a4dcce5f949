//! The tensile specimen of Natsupakpong and Cavusoglu (2010): a strip with wide ends.
//!
//! The paper prints the width `B` of the straight part, the lengths of the straight part `2 B`, of each
//! shoulder `4 B` and of each grip `3 B`, and the width `3 B` of the grips, 16 B in all. The shape of the
//! shoulders is not printed; here their half width is `B/2 + B s^2`, with `s` from 0 at the straight part
//! to 1 at the grip, which meets the straight part smoothly.

use super::sheets::grid_edges;
use super::{
    cells, fits, grid_hexahedra, grid_quads, length, name_grid_sides, part, product, whole,
};
use crate::mesh::error::MeshError;
use crate::mesh::{Group, Mesh};
use glam::DVec3;

/// Columns along the specimen must leave one for each of its five sections.
const FEWEST_COLUMNS: usize = 5;

/// Half width at the distance `x` from the middle, both in units of `B`.
fn half_width(x: f64) -> f64 {
    let s = ((x.abs() - 1.0) / 4.0).clamp(0.0, 1.0);
    0.5 + s * s
}

/// Places of the columns from -8 to 8, in units of `B`: the ends of all sections are among them, and
/// they lie symmetrically.
fn columns(n: usize) -> Vec<f64> {
    let share = |length: f64| ((n as f64 * length / 16.0).round() as usize).max(1);
    let (mut grip, mut shoulder) = (share(3.0), share(4.0));
    while 2 * (grip + shoulder) >= n {
        if shoulder > 1 {
            shoulder -= 1;
        } else {
            grip -= 1;
        }
    }
    let middle = n - 2 * (grip + shoulder);
    let sections = [
        (-8.0, grip, 3.0),
        (-5.0, shoulder, 4.0),
        (-1.0, middle, 2.0),
        (1.0, shoulder, 4.0),
        (5.0, grip, 3.0),
    ];
    let mut places = vec![-8.0];
    for (start, n, length) in sections {
        places.extend((1..=n).map(|i| start + part(i, n, length)));
    }
    places
}

/// The points of the flat specimen, column by column; the counts are checked.
fn outline(
    name: &'static str,
    what: &'static str,
    width: f64,
    n: &[usize],
    per_cell: usize,
) -> Result<Vec<[f64; 2]>, MeshError> {
    length(name, "width", width)?;
    for (&value, parameter) in n.iter().zip(["cells[0]", "cells[1]", "cells[2]"]) {
        cells(name, parameter, value)?;
    }
    if n[0] < FEWEST_COLUMNS {
        return Err(MeshError::InvalidParameter {
            generator: name,
            parameter: "cells[0]",
            value: n[0].to_string(),
            remedy: "give at least 5 cells along the specimen, one for each section",
        });
    }
    let vertices: Vec<usize> = n.iter().map(|n| n.saturating_add(1)).collect();
    fits(name, "vertices", product(&vertices))?;
    fits(name, what, product(n).and_then(|cells| cells.checked_mul(per_cell)))?;
    let mut points = Vec::new();
    for x in columns(n[0]) {
        let half = half_width(x);
        points.extend((0..=n[1]).map(|j| [x * width, (part(j, n[1], 2.0 * half) - half) * width]));
    }
    Ok(points)
}

/// Groups of the vertices on both grips, to hold and to pull.
fn grips(mesh: &mut Mesh, width: f64) {
    // The share lets vertices at the very edge of a grip in, whatever their rounding.
    for (name, sign) in [("grip0", -1.0), ("grip1", 1.0)] {
        let on = |v: &u32| sign * mesh.points[*v as usize].x >= 5.0 * width * (1.0 - 1e-12);
        let vertices = (0..mesh.points.len() as u32).filter(on).collect();
        mesh.groups.push(Group { name: name.to_owned(), vertices, ..Group::default() });
    }
}

fn flat(name: &'static str, width: f64, n: [usize; 2], points: Vec<[f64; 2]>) -> Mesh {
    Mesh {
        source: format!("{name} width {width} m, {} x {} cells", n[0], n[1]),
        points: points.into_iter().map(|[x, y]| DVec3::new(x, y, 0.0)).collect(),
        groups: grid_edges(n),
        ..Mesh::default()
    }
}

/// The flat tensile specimen of triangles in the plane z = 0, its middle at the origin, its normal
/// along z.
///
/// `width` is that of the straight part in metres (1 cm in the paper), the length is 16 times as large.
/// `[24, 4]` cells give the printed 125 vertices and 192 triangles. Groups `x0`, `x1`, `y0`, `y1`
/// (vertices of the edges), `body`, `grip0` and `grip1` (all vertices of the wide ends).
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn specimen_triangles(width: f64, n: [usize; 2]) -> Result<Mesh, MeshError> {
    const NAME: &str = "specimen_triangles";
    let points = outline(NAME, "triangles", width, &n, 2)?;
    let mut mesh = flat(NAME, width, n, points);
    for (i, [a, b, c, d]) in grid_quads(n).into_iter().enumerate() {
        // Diagonals change from cell to cell, so that the mesh has no preferred direction.
        mesh.triangles.extend(if (i / n[1] + i % n[1]).is_multiple_of(2) {
            [[a, b, c], [a, c, d]]
        } else {
            [[b, c, d], [b, d, a]]
        });
    }
    mesh.groups.push(whole(&mesh));
    grips(&mut mesh, width);
    Ok(mesh)
}

/// The flat tensile specimen of quadrilaterals; as [`specimen_triangles`].
///
/// `[53, 5]` cells give 324 vertices and 265 quadrilaterals (329 and 266 in the paper).
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn specimen_quads(width: f64, n: [usize; 2]) -> Result<Mesh, MeshError> {
    const NAME: &str = "specimen_quads";
    let points = outline(NAME, "quadrilaterals", width, &n, 1)?;
    let mut mesh = flat(NAME, width, n, points);
    mesh.quads = grid_quads(n);
    mesh.groups.push(whole(&mesh));
    grips(&mut mesh, width);
    Ok(mesh)
}

/// The tensile specimen of hexahedra, from z = 0 to `thickness`.
///
/// `width` of the straight part and `thickness` in metres (1 cm each in the paper), the length is 16
/// widths. `[56, 5, 3]` cells give 1368 vertices and 840 hexahedra (1396 and 843 in the paper). Groups
/// `x0`, `x1`, `y0`, `y1`, `z0`, `z1` (vertices and outward faces), `body`, `grip0` and `grip1` (all
/// vertices of the wide ends).
///
/// ```
/// use sinew_engine::mesh::generate::specimen_hexahedra;
///
/// let mesh = specimen_hexahedra(0.01, 0.01, [56, 5, 3])?;
/// assert_eq!((mesh.points.len(), mesh.hexahedra.len()), (1368, 840));
/// # Ok::<(), sinew_engine::mesh::MeshError>(())
/// ```
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn specimen_hexahedra(width: f64, thickness: f64, n: [usize; 3]) -> Result<Mesh, MeshError> {
    let mut mesh = solid("specimen_hexahedra", "hexahedra", width, thickness, n, 1)?;
    name_grid_sides(&mut mesh, n);
    grips(&mut mesh, width);
    Ok(mesh)
}

/// The tensile specimen of tetrahedra, six for each cell; as [`specimen_hexahedra`].
///
/// `[42, 3, 2]` cells give 516 vertices and 1512 tetrahedra (538 and 1500 in the paper).
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn specimen_tets(width: f64, thickness: f64, n: [usize; 3]) -> Result<Mesh, MeshError> {
    let mesh = solid("specimen_tets", "tetrahedra", width, thickness, n, 6)?;
    let mut mesh = mesh.split_into_simplices();
    name_grid_sides(&mut mesh, n);
    grips(&mut mesh, width);
    Ok(mesh)
}

/// The specimen of hexahedra without groups.
fn solid(
    name: &'static str,
    what: &'static str,
    width: f64,
    thickness: f64,
    n: [usize; 3],
    per_cell: usize,
) -> Result<Mesh, MeshError> {
    length(name, "thickness", thickness)?;
    let flat = outline(name, what, width, &n, per_cell)?;
    let [nx, ny, nz] = n;
    let mut points = Vec::with_capacity(flat.len() * (nz + 1));
    for [x, y] in flat {
        points.extend((0..=nz).map(|k| DVec3::new(x, y, part(k, nz, thickness))));
    }
    Ok(Mesh {
        source: format!("{name} width {width} m, {thickness} m thick, {nx} x {ny} x {nz} cells"),
        points,
        hexahedra: grid_hexahedra(n),
        ..Mesh::default()
    })
}
