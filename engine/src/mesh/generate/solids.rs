//! Boxes, cylinders and balls of volume cells.

use super::sheets::{core_disc, core_disc_counts, disc};
use super::{
    cells, fits, grid_hexahedra, length, name_grid_sides, name_sides, oriented, part, product,
};
use crate::mesh::error::MeshError;
use crate::mesh::{Mesh, sorted};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Paths from the first to the last corner of a cell along the three axes, one for each order.
const STEPS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// A box with one corner at the origin, each of its cells cut into six tetrahedra.
///
/// `size` in metres; vertex `(i, j, k)` has the index `(i (ny + 1) + j) (nz + 1) + k`. Groups `x0`,
/// `x1`, `y0`, `y1`, `z0`, `z1` (vertices and outward triangles) and `body`.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn box_tets(size: DVec3, n: [usize; 3]) -> Result<Mesh, MeshError> {
    const NAME: &str = "box_tets";
    let [n_points, n_tets] = box_counts(NAME, "tetrahedra", size, n, 6)?;
    let [nx, ny, nz] = n;
    let points = box_points(size, n, n_points);
    // odd orders wind the other way
    const EVEN: [bool; 6] = [true, false, false, true, true, false];
    let stride = [((ny + 1) * (nz + 1)) as u32, (nz + 1) as u32, 1];
    let mut tetrahedra = Vec::with_capacity(n_tets);
    for i in 0..nx as u32 {
        for j in 0..ny as u32 {
            for k in 0..nz as u32 {
                let corner = i * stride[0] + j * stride[1] + k;
                for (steps, even) in STEPS.iter().zip(EVEN) {
                    let a = corner;
                    let b = a + stride[steps[0]];
                    let c = b + stride[steps[1]];
                    let d = c + stride[steps[2]];
                    tetrahedra.push(if even { [a, b, c, d] } else { [a, b, d, c] });
                }
            }
        }
    }
    let source = format!("{NAME} {} x {} x {} m, {nx} x {ny} x {nz} cells", size.x, size.y, size.z);
    let mut mesh = Mesh { source, points, tetrahedra, ..Mesh::default() };
    name_grid_sides(&mut mesh, n);
    Ok(mesh)
}

/// Vertices of a box of cells in the order of [`box_tets`].
fn box_points(size: DVec3, [nx, ny, nz]: [usize; 3], n_points: usize) -> Vec<DVec3> {
    let mut points = Vec::with_capacity(n_points);
    for i in 0..=nx {
        for j in 0..=ny {
            for k in 0..=nz {
                let point = [part(i, nx, size.x), part(j, ny, size.y), part(k, nz, size.z)];
                points.push(DVec3::from_array(point));
            }
        }
    }
    points
}

/// Checks size and cells of a box; the numbers of its vertices and of its cells times `per_cell`.
pub(super) fn box_counts(
    name: &'static str,
    what: &'static str,
    size: DVec3,
    n: [usize; 3],
    per_cell: usize,
) -> Result<[usize; 2], MeshError> {
    for (value, parameter) in size.to_array().into_iter().zip(["size.x", "size.y", "size.z"]) {
        length(name, parameter, value)?;
    }
    for (value, parameter) in n.into_iter().zip(["cells[0]", "cells[1]", "cells[2]"]) {
        cells(name, parameter, value)?;
    }
    let [nx, ny, nz] = n;
    let n_points = fits(name, "vertices", product(&n.map(|n| n.saturating_add(1))))?;
    let n_cells = fits(name, what, product(&[per_cell, nx, ny, nz]))?;
    Ok([n_points, n_cells])
}

/// A box with one corner at the origin, of `n` brick-shaped hexahedra along each axis.
///
/// `size` in metres; vertices and groups as those of [`box_tets`], with outward quadrilaterals in
/// place of triangles.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn box_hexahedra(size: DVec3, n: [usize; 3]) -> Result<Mesh, MeshError> {
    const NAME: &str = "box_hexahedra";
    let [n_points, _] = box_counts(NAME, "hexahedra", size, n, 1)?;
    let [nx, ny, nz] = n;
    let source = format!("{NAME} {} x {} x {} m, {nx} x {ny} x {nz} cells", size.x, size.y, size.z);
    let points = box_points(size, n, n_points);
    let mut mesh = Mesh { source, points, hexahedra: grid_hexahedra(n), ..Mesh::default() };
    name_grid_sides(&mut mesh, n);
    Ok(mesh)
}

/// A cylinder along x from the origin, of `rings` rings around its axis and `layers` layers along it.
///
/// `radius` and `length` in metres. Ring `r` has `6 r` vertices; each layer has `6 rings^2` prisms of
/// three tetrahedra. Groups `x0`, `x1`, `side` and `body`.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn cylinder_tets(
    radius: f64,
    height: f64,
    rings: usize,
    layers: usize,
) -> Result<Mesh, MeshError> {
    const NAME: &str = "cylinder_tets";
    length(NAME, "radius", radius)?;
    length(NAME, "length", height)?;
    cells(NAME, "rings", rings)?;
    cells(NAME, "layers", layers)?;
    let per_layer = product(&[3, rings, rings.saturating_add(1)]).and_then(|n| n.checked_add(1));
    let n_points = per_layer.and_then(|n| product(&[n, layers.saturating_add(1)]));
    let n_points = fits(NAME, "vertices", n_points)?;
    let n_tets = fits(NAME, "tetrahedra", product(&[18, rings, rings, layers]))?;
    let per_layer = n_points / (layers + 1);

    let (disc, triangles) = disc(radius, rings);
    let points = layer_points(&disc, layers, height);
    let mut tetrahedra = Vec::with_capacity(n_tets);
    for layer in 0..layers {
        let bottom = (layer * per_layer) as u32;
        let top = bottom + per_layer as u32;
        for &triangle in &triangles {
            // The smaller index of every side starts its diagonal, so that neighbours agree.
            let [a, b, c] = sorted(triangle);
            for [p, q, r, s] in [
                [bottom + a, bottom + b, bottom + c, top + c],
                [bottom + a, bottom + b, top + b, top + c],
                [bottom + a, top + a, top + b, top + c],
            ] {
                tetrahedra.push(oriented(&points, [p, q, r, s]));
            }
        }
    }
    let source =
        format!("{NAME} radius {radius} m, length {height} m, {rings} rings, {layers} layers");
    let mut mesh = Mesh { source, points, tetrahedra, ..Mesh::default() };
    name_cylinder_sides(&mut mesh, height);
    Ok(mesh)
}

/// Vertices of `layers` layers of a disc along x.
fn layer_points(disc: &[DVec2], layers: usize, height: f64) -> Vec<DVec3> {
    let layer = |layer| {
        let x = part(layer, layers, height);
        disc.iter().map(move |p| DVec3::new(x, p.x, p.y))
    };
    (0..=layers).flat_map(layer).collect()
}

/// Checks `lengths` (m) and numbers of cells; vertices of a disc of radius `radius` with a square core, and the
/// hexahedra between its copies. `between` gives the copies below and above a layer.
pub(super) fn core_layers(
    name: &'static str,
    lengths: &[(&'static str, f64)],
    radius: f64,
    [core, rings, layers]: [usize; 3],
    between: impl Fn(usize) -> [usize; 2],
) -> Result<(Vec<DVec2>, Vec<[u32; 8]>), MeshError> {
    for &(parameter, value) in lengths {
        length(name, parameter, value)?;
    }
    for (parameter, value) in [("core", core), ("rings", rings), ("layers", layers)] {
        cells(name, parameter, value)?;
    }
    let [n_points, n_quads] = core_disc_counts(core, rings);
    let n_points =
        n_points.and_then(|n| layers.checked_add(1).and_then(|layers| n.checked_mul(layers)));
    fits(name, "vertices", n_points)?;
    fits(name, "hexahedra", n_quads.and_then(|n| n.checked_mul(layers)))?;
    let (disc, quads) = core_disc(radius, core, rings);
    let mut hexahedra = Vec::with_capacity(quads.len() * layers);
    for copies in (0..layers).map(between) {
        for quad in &quads {
            let [low, high] = copies.map(|copy| quad.map(|v| v + (copy * disc.len()) as u32));
            let ([a, b, c, d], [e, f, g, h]) = (low, high);
            hexahedra.push([a, b, c, d, e, f, g, h]);
        }
    }
    Ok((disc, hexahedra))
}

fn name_cylinder_sides(mesh: &mut Mesh, height: f64) {
    name_sides(mesh, &["x0", "x1", "side"], |mesh, face| {
        let on = |x: f64| face.iter().all(|&v| mesh.points[v as usize].x == x);
        if on(0.0) {
            0
        } else if on(height) {
            1
        } else {
            2
        }
    });
}

/// A cylinder of hexahedra along x from the origin.
///
/// `radius` and `length` in metres. Its cross-section is that of [`disc_quads`](super::disc_quads): a bulged square of
/// `core` cells along each side and `rings` rings of `4 core` cells around it; `layers` layers along
/// the axis. Groups `x0`, `x1`, `side` (vertices and outward quadrilaterals) and `body`.
///
/// ```
/// use sinew_engine::mesh::generate::cylinder_hexahedra;
///
/// let mesh = cylinder_hexahedra(0.01, 0.05, 4, 2, 10)?;
/// assert_eq!(mesh.hexahedra.len(), (4 * 4 + 2 * 16) * 10);
/// # Ok::<(), sinew_engine::mesh::MeshError>(())
/// ```
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn cylinder_hexahedra(
    radius: f64,
    height: f64,
    core: usize,
    rings: usize,
    layers: usize,
) -> Result<Mesh, MeshError> {
    const NAME: &str = "cylinder_hexahedra";
    let lengths = [("radius", radius), ("length", height)];
    let (disc, hexahedra) =
        core_layers(NAME, &lengths, radius, [core, rings, layers], |layer| [layer, layer + 1])?;
    let points = layer_points(&disc, layers, height);
    let source = format!(
        "{NAME} radius {radius} m, length {height} m, core {core} x {core}, {rings} rings, {layers} layers"
    );
    let mut mesh = Mesh { source, points, hexahedra, ..Mesh::default() };
    name_cylinder_sides(&mut mesh, height);
    Ok(mesh)
}

/// A tube of hexahedra along x from the origin, the simplest shape of a vessel or of a gut.
///
/// `radius` of its bore, `wall` (the thickness) and `length` in metres; numbers of cells around it, through the wall and along it.
/// Groups `x0`, `x1`, `inner`, `outer` (vertices and outward quadrilaterals) and `body`.
///
/// ```
/// use sinew_engine::mesh::generate::tube_hexahedra;
///
/// let mesh = tube_hexahedra(0.010, 0.004, 0.05, [48, 2, 10])?;
/// assert_eq!(mesh.hexahedra.len(), 48 * 2 * 10);
/// // a tube, but for the flat facets
/// let volume = std::f64::consts::PI * (0.014_f64.powi(2) - 0.010_f64.powi(2)) * 0.05;
/// assert!((mesh.total_volume() / volume - 1.0).abs() < 0.003);
/// # Ok::<(), sinew_engine::mesh::MeshError>(())
/// ```
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn tube_hexahedra(
    radius: f64,
    wall: f64,
    height: f64,
    [around, through, along]: [usize; 3],
) -> Result<Mesh, MeshError> {
    const NAME: &str = "tube_hexahedra";
    for (parameter, value) in [("radius", radius), ("wall", wall), ("length", height)] {
        length(NAME, parameter, value)?;
    }
    if around < 3 {
        let (parameter, remedy) = ("around", "give at least three cells");
        let value = around.to_string();
        return Err(MeshError::InvalidParameter { generator: NAME, parameter, value, remedy });
    }
    cells(NAME, "through", through)?;
    cells(NAME, "along", along)?;
    let ring = product(&[through.saturating_add(1), around]);
    let n_points = ring.and_then(|n| product(&[n, along.saturating_add(1)]));
    fits(NAME, "vertices", n_points)?;
    fits(NAME, "hexahedra", product(&[around, through, along]))?;

    // x, radius and angle turn to the right; the last cells around have the first vertices again
    let shells = through + 1;
    let mut points = Vec::with_capacity(shells * around * (along + 1));
    for layer in 0..=along {
        for shell in 0..shells {
            let r = radius + part(shell, through, wall);
            points.extend((0..around).map(|turn| {
                let (sin, cos) = libm::sincos(part(turn, around, TAU));
                DVec3::new(part(layer, along, height), r * cos, r * sin)
            }));
        }
    }
    let of_grid = |v: u32| {
        let (rest, turn) = (v as usize / (around + 1), v as usize % (around + 1));
        (around * rest + turn % around) as u32
    };
    let grid = grid_hexahedra([along, through, around]);
    let hexahedra = grid.into_iter().map(|h| h.map(of_grid)).collect();
    let source = format!(
        "{NAME} radius {radius} m, wall {wall} m, length {height} m, {around} x {through} x {along} cells"
    );
    let mut mesh = Mesh { source, points, hexahedra, ..Mesh::default() };
    name_sides(&mut mesh, &["x0", "x1", "inner", "outer"], |mesh, face| {
        let on = |x: f64| face.iter().all(|&v| mesh.points[v as usize].x == x);
        let inner = |&v: &u32| (v as usize / around).is_multiple_of(shells);
        match (on(0.0), on(height)) {
            (true, _) => 0,
            (_, true) => 1,
            _ if face.iter().all(inner) => 2,
            _ => 3,
        }
    });
    Ok(mesh)
}

/// A ball around the origin, of `n` shells: `20 n^3` tetrahedra.
///
/// `radius` in metres. The twenty tetrahedra between centre and faces of an icosahedron are cut
/// regularly and every shell is moved onto its sphere. Groups `surface` and `body`.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn sphere_tets(radius: f64, n: usize) -> Result<Mesh, MeshError> {
    const NAME: &str = "sphere_tets";
    length(NAME, "radius", radius)?;
    cells(NAME, "n", n)?;
    let n_tets = fits(NAME, "tetrahedra", product(&[20, n, n, n]))?;

    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let mut corners = Vec::with_capacity(12);
    for a in [-1.0, 1.0] {
        for b in [-golden, golden] {
            corners.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
        }
    }
    // Corners of a face have the shortest distance, 2.
    let near = |i: usize, j: usize| (corners[i] - corners[j]).length() < 2.5;
    let mut faces = Vec::with_capacity(20);
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j) && near(j, k) && near(i, k) {
                    faces.push([i, j, k]);
                }
            }
        }
    }

    let mut points = Vec::new();
    let mut tetrahedra = Vec::with_capacity(n_tets);
    // Vertices by the icosahedron corners and weights that they mix; shared ones have equal keys.
    let mut index: BTreeMap<[(usize, usize); 3], u32> = BTreeMap::new();
    for face in faces {
        // Lattice point x >= y >= z: weights x - y, y - z, z of the corners on the shell x.
        let mut vertex = |[x, y, z]: [usize; 3]| -> u32 {
            let mut key = [(face[0], x - y), (face[1], y - z), (face[2], z)];
            key.iter_mut().filter(|(_, weight)| *weight == 0).for_each(|entry| *entry = (99, 0));
            key.sort_unstable();
            *index.entry(key).or_insert_with(|| {
                let mixed = corners[face[0]] * (x - y) as f64
                    + corners[face[1]] * (y - z) as f64
                    + corners[face[2]] * z as f64;
                let shell = if x == n { radius } else { radius * x as f64 / n as f64 };
                points.push(mixed.normalize_or_zero() * shell);
                (points.len() - 1) as u32
            })
        };
        for x in 0..n {
            for y in 0..=x {
                for z in 0..=y {
                    for steps in STEPS {
                        let mut at = [x, y, z];
                        let mut path = [at; 4];
                        for (next, step) in path[1..].iter_mut().zip(steps) {
                            at[step] += 1;
                            *next = at;
                        }
                        // Only paths that stay inside x >= y >= z belong to this tetrahedron.
                        if path.iter().all(|[x, y, z]| x >= y && y >= z) {
                            tetrahedra.push(path.map(&mut vertex));
                        }
                    }
                }
            }
        }
    }
    for tet in &mut tetrahedra {
        *tet = oriented(&points, *tet);
    }
    let source = format!("{NAME} radius {radius} m, {n} shells");
    let mut mesh = Mesh { source, points, tetrahedra, ..Mesh::default() };
    name_sides(&mut mesh, &["surface"], |_, _| 0);
    Ok(mesh)
}
