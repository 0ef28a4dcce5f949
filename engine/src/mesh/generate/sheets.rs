//! Rectangles, discs and spheres of triangles and quadrilaterals.

use super::{cells, fits, grid_quads, length, part, product, sphere_tets, whole};
use crate::mesh::error::MeshError;
use crate::mesh::{Group, Mesh};
use glam::{DVec2, DVec3};

/// A rectangle of triangles in the plane z = 0 with one corner at the origin and its normal along z.
///
/// `size` in metres; vertex `(i, j)` has the index `i (ny + 1) + j`. Groups `x0`, `x1`, `y0`, `y1`
/// (vertices of the edges) and `body`.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn triangle_grid(size: DVec2, n: [usize; 2]) -> Result<Mesh, MeshError> {
    let mut mesh = grid("triangle_grid", "triangles", size, n, 2)?;
    for [a, b, c, d] in grid_quads(n) {
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh.groups.push(whole(&mesh));
    Ok(mesh)
}

/// A rectangle of quadrilaterals: vertices and groups as those of [`triangle_grid`].
///
/// ```
/// use glam::DVec2;
/// use sinew_engine::mesh::generate::quad_grid;
///
/// let mesh = quad_grid(DVec2::new(0.2, 0.1), [4, 2])?;
/// assert_eq!((mesh.points.len(), mesh.quads.len()), (15, 8));
/// # Ok::<(), sinew_engine::mesh::MeshError>(())
/// ```
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn quad_grid(size: DVec2, n: [usize; 2]) -> Result<Mesh, MeshError> {
    let mut mesh = grid("quad_grid", "quadrilaterals", size, n, 1)?;
    mesh.quads = grid_quads(n);
    mesh.groups.push(whole(&mesh));
    Ok(mesh)
}

/// Vertices and edge groups of a rectangle, without cells.
fn grid(
    name: &'static str,
    what: &'static str,
    size: DVec2,
    n: [usize; 2],
    per_cell: usize,
) -> Result<Mesh, MeshError> {
    length(name, "size.x", size.x)?;
    length(name, "size.y", size.y)?;
    let [nx, ny] = n;
    cells(name, "cells[0]", nx)?;
    cells(name, "cells[1]", ny)?;
    fits(name, "vertices", product(&[nx.saturating_add(1), ny.saturating_add(1)]))?;
    fits(name, what, product(&[per_cell, nx, ny]))?;
    let mut mesh = Mesh {
        source: format!("{name} {} x {} m, {nx} x {ny} cells", size.x, size.y),
        ..Mesh::default()
    };
    for i in 0..=nx {
        for j in 0..=ny {
            mesh.points.push(DVec3::new(part(i, nx, size.x), part(j, ny, size.y), 0.0));
        }
    }
    mesh.groups = grid_edges(n);
    Ok(mesh)
}

/// Groups `x0`, `x1`, `y0`, `y1` of the vertices on the edges of a grid.
pub(super) fn grid_edges([nx, ny]: [usize; 2]) -> Vec<Group> {
    let names = ["x0", "x1", "y0", "y1"];
    let mut groups =
        names.map(|name| Group { name: name.to_owned(), dimension: 1, ..Group::default() });
    for i in 0..=nx {
        for j in 0..=ny {
            for (group, on) in groups.iter_mut().zip([i == 0, i == nx, j == 0, j == ny]) {
                if on {
                    group.vertices.push((i * (ny + 1) + j) as u32);
                }
            }
        }
    }
    groups.into()
}

/// The unit vector at an angle (rad) to x, with the same bits on every machine.
fn at_angle(angle: f64) -> DVec2 {
    let (sin, cos) = libm::sincos(angle);
    DVec2::new(cos, sin)
}

/// Vertices of a disc around the origin, ring by ring from the centre, and its counter-clockwise
/// triangles.
pub(super) fn disc(radius: f64, rings: usize) -> (Vec<DVec2>, Vec<[u32; 3]>) {
    let mut disc = vec![DVec2::ZERO];
    for ring in 1..=rings {
        for i in 0..6 * ring {
            let angle = std::f64::consts::TAU * i as f64 / (6 * ring) as f64;
            disc.push(at_angle(angle) * (radius * ring as f64 / rings as f64));
        }
    }
    // Each sixth of a ring is a strip of triangles between its inner and its outer vertices.
    let vertex = |ring: usize, i: usize| -> u32 {
        if ring == 0 { 0 } else { (1 + 3 * ring * (ring - 1) + i % (6 * ring)) as u32 }
    };
    let mut triangles = Vec::with_capacity(6 * rings * rings);
    for ring in 1..=rings {
        for sixth in 0..6 {
            for i in 0..ring {
                let outer = sixth * ring + i;
                let inner = sixth * (ring - 1) + i;
                triangles.push([
                    vertex(ring, outer),
                    vertex(ring, outer + 1),
                    vertex(ring - 1, inner),
                ]);
                if i + 1 < ring {
                    let (a, b) = (vertex(ring - 1, inner), vertex(ring - 1, inner + 1));
                    triangles.push([a, vertex(ring, outer + 1), b]);
                }
            }
        }
    }
    (disc, triangles)
}

/// A mesh of cells with the vertices of a disc, the last `rim` of which lie on its rim.
fn flat(disc: &[DVec2], rim: usize, cells: Mesh) -> Mesh {
    let vertices = (disc.len() - rim) as u32..disc.len() as u32;
    let vertices = vertices.collect();
    let rim = Group { name: "rim".to_owned(), dimension: 1, vertices, ..Group::default() };
    let points = disc.iter().map(|p| p.extend(0.0)).collect();
    let mut mesh = Mesh { points, ..cells };
    mesh.groups = vec![rim, whole(&mesh)];
    mesh
}

/// A disc of triangles in the plane z = 0 around the origin, its normal along z.
///
/// `radius` in metres; `rings` rings around the centre, `6 rings^2` triangles. Groups `rim` (vertices) and
/// `body`.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn disc_triangles(radius: f64, rings: usize) -> Result<Mesh, MeshError> {
    const NAME: &str = "disc_triangles";
    length(NAME, "radius", radius)?;
    cells(NAME, "rings", rings)?;
    fits(NAME, "triangles", product(&[6, rings, rings]))?;
    let (disc, triangles) = disc(radius, rings);
    let source = format!("{NAME} radius {radius} m, {rings} rings");
    Ok(flat(&disc, 6 * rings, Mesh { source, triangles, ..Mesh::default() }))
}

/// Numbers of vertices and quadrilaterals of a disc with a square core.
pub(super) fn core_disc_counts(core: usize, rings: usize) -> [Option<usize>; 2] {
    let ring = product(&[4, core, rings]);
    let plus = core.saturating_add(1);
    let sum = |a: Option<usize>, b: Option<usize>| a?.checked_add(b?);
    [sum(product(&[plus, plus]), ring), sum(product(&[core, core]), ring)]
}

/// Vertices of a disc around the origin and its counter-clockwise quadrilaterals: a square of `core`
/// by `core` cells with bulged sides, and rings around it.
///
/// A plain map of the square onto the disc would leave cells with an angle of 180 degrees at its
/// corners, where the Jacobian determinant is 0.
pub(super) fn core_disc(radius: f64, core: usize, rings: usize) -> (Vec<DVec2>, Vec<[u32; 4]>) {
    // Distance of the corners of the core, and how far its sides are bent to the circle through them.
    const REACH: f64 = 0.6;
    const BULGE: f64 = 0.4;
    let unit = |i: usize| 2.0 * i as f64 / core as f64 - 1.0;
    let direction = |u: f64, v: f64| {
        let quarter = std::f64::consts::FRAC_PI_4;
        // Equal angles along each side of the square.
        if u.abs() >= v.abs() {
            at_angle(quarter * v / u) * u.signum()
        } else {
            let [x, y] = at_angle(quarter * u / v).to_array();
            DVec2::new(y, x) * v.signum()
        }
    };
    let mut disc = Vec::new();
    let mut direction_of = Vec::new();
    for i in 0..=core {
        for j in 0..=core {
            let (u, v) = (unit(i), unit(j));
            let size = u.abs().max(v.abs());
            let round = if size > 0.0 { direction(u, v) } else { DVec2::ZERO };
            let square = DVec2::new(u, v) / 2f64.sqrt();
            disc.push(square.lerp(round * size, BULGE * size) * (REACH * radius));
            direction_of.push(round);
        }
    }
    let mut quads = grid_quads([core, core]);
    // The outline of the core, counter-clockwise.
    let at = |i: usize, j: usize| (i * (core + 1) + j) as u32;
    let mut outline: Vec<u32> = (0..core).map(|i| at(i, 0)).collect();
    outline.extend((0..core).map(|j| at(core, j)));
    outline.extend((0..core).map(|i| at(core - i, core)));
    outline.extend((0..core).map(|j| at(0, core - j)));
    let n = outline.len() as u32;
    let first = disc.len() as u32;
    for ring in 1..=rings {
        let outward = ring as f64 / rings as f64;
        for &v in &outline {
            let rim = direction_of[v as usize] * radius;
            disc.push(if ring == rings { rim } else { disc[v as usize].lerp(rim, outward) });
        }
    }
    for ring in 0..rings as u32 {
        let vertex = |ring: u32, i: u32| {
            let i = i % n;
            if ring == 0 { outline[i as usize] } else { first + (ring - 1) * n + i }
        };
        for i in 0..n {
            quads.push([
                vertex(ring, i),
                vertex(ring + 1, i),
                vertex(ring + 1, i + 1),
                vertex(ring, i + 1),
            ]);
        }
    }
    (disc, quads)
}

/// A disc of quadrilaterals in the plane z = 0 around the origin, its normal along z.
///
/// `radius` in metres; a bulged square of `core` cells along each side in the middle, and `rings`
/// rings of `4 core` cells around it. Groups `rim` (vertices) and `body`.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn disc_quads(radius: f64, core: usize, rings: usize) -> Result<Mesh, MeshError> {
    const NAME: &str = "disc_quads";
    length(NAME, "radius", radius)?;
    cells(NAME, "core", core)?;
    cells(NAME, "rings", rings)?;
    let [n_points, n_quads] = core_disc_counts(core, rings);
    fits(NAME, "vertices", n_points)?;
    fits(NAME, "quadrilaterals", n_quads)?;
    let (disc, quads) = core_disc(radius, core, rings);
    let source = format!("{NAME} radius {radius} m, core {core} x {core}, {rings} rings");
    Ok(flat(&disc, 4 * core, Mesh { source, quads, ..Mesh::default() }))
}

/// A sphere of triangles around the origin, its normals outward.
///
/// `radius` in metres; the edges of an icosahedron are cut into `n` parts: `20 n^2` triangles. Group
/// `body`.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn sphere_triangles(radius: f64, n: usize) -> Result<Mesh, MeshError> {
    let ball = sphere_tets(radius, n)?;
    let mut index = vec![u32::MAX; ball.points.len()];
    let mut points = Vec::new();
    let triangles: Vec<[u32; 3]> = ball
        .surface_triangles()
        .into_iter()
        .map(|t| {
            t.map(|v| {
                let place = &mut index[v as usize];
                if *place == u32::MAX {
                    *place = points.len() as u32;
                    points.push(ball.points[v as usize]);
                }
                *place
            })
        })
        .collect();
    let source = format!("sphere_triangles radius {radius} m, edges cut into {n}");
    let mut mesh = Mesh { source, points, triangles, ..Mesh::default() };
    mesh.groups = vec![whole(&mesh)];
    Ok(mesh)
}
