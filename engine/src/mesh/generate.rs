//! Meshes of simple bodies, with their sides as named groups.

use super::error::MeshError;
use super::{Group, Mesh, boundary_faces, for_equal_cells, tetrahedron_faces};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

fn length(generator: &'static str, parameter: &'static str, value: f64) -> Result<(), MeshError> {
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
fn fits(generator: &str, what: &'static str, count: Option<usize>) -> Result<usize, MeshError> {
    match count.filter(|&count| count < u32::MAX as usize) {
        Some(count) => Ok(count),
        None => Err(MeshError::TooMany {
            file: generator.to_owned(),
            what,
            count: count.map_or(u64::MAX, |count| count as u64),
            limit: u64::from(u32::MAX) - 1,
        }),
    }
}

fn product(factors: &[usize]) -> Option<usize> {
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

/// Adds the boundary triangles, a group for each name that `side` gives them, and the group `body`.
fn name_sides(mesh: &mut Mesh, names: &[&str], side: impl Fn(&Mesh, [u32; 3]) -> usize) {
    mesh.triangles = mesh.surface_triangles();
    let mut groups: Vec<Group> = names
        .iter()
        .map(|&name| Group { name: name.to_owned(), dimension: 2, ..Group::default() })
        .collect();
    for (i, &triangle) in mesh.triangles.iter().enumerate() {
        let group = &mut groups[side(mesh, triangle)];
        group.triangles.push(i as u32);
        group.vertices.extend(triangle);
    }
    for group in &mut groups {
        group.vertices.sort_unstable();
        group.vertices.dedup();
    }
    groups.push(Group {
        name: "body".to_owned(),
        dimension: 3,
        vertices: (0..mesh.points.len() as u32).collect(),
        tetrahedra: (0..mesh.tetrahedra.len() as u32).collect(),
        triangles: Vec::new(),
    });
    mesh.groups = groups;
}

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
    for (value, name) in size.to_array().into_iter().zip(["size.x", "size.y", "size.z"]) {
        length(NAME, name, value)?;
    }
    for (value, name) in n.into_iter().zip(["cells[0]", "cells[1]", "cells[2]"]) {
        cells(NAME, name, value)?;
    }
    let [nx, ny, nz] = n;
    let plus = [nx.saturating_add(1), ny.saturating_add(1), nz.saturating_add(1)];
    let n_points = fits(NAME, "vertices", product(&plus))?;
    let n_tets = fits(NAME, "tetrahedra", product(&[6, nx, ny, nz]))?;

    let mut points = Vec::with_capacity(n_points);
    let at = |i: usize, n: usize, size: f64| if i == n { size } else { size * i as f64 / n as f64 };
    for i in 0..=nx {
        for j in 0..=ny {
            for k in 0..=nz {
                points.push(DVec3::new(at(i, nx, size.x), at(j, ny, size.y), at(k, nz, size.z)));
            }
        }
    }
    // Paths from the first to the last corner of a cell along the three axes, one for each order;
    // odd orders wind the other way.
    const STEPS: [[usize; 3]; 6] =
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
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
    name_sides(&mut mesh, &["x0", "x1", "y0", "y1", "z0", "z1"], |mesh, triangle| {
        let corners = triangle.map(|v| mesh.points[v as usize].to_array());
        let on = |axis: usize, value: f64| corners.iter().all(|corner| corner[axis] == value);
        let sides = [(0, 0.0), (0, size.x), (1, 0.0), (1, size.y), (2, 0.0), (2, size.z)];
        sides.iter().position(|&(axis, value)| on(axis, value)).unwrap_or(0)
    });
    Ok(mesh)
}

/// A beam along x: the same as [`box_tets`].
///
/// # Errors
///
/// As [`box_tets`].
pub fn beam_tets(size: DVec3, n: [usize; 3]) -> Result<Mesh, MeshError> {
    box_tets(size, n)
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
    let mut points = Vec::with_capacity(n_points);
    for layer in 0..=layers {
        let x = if layer == layers { height } else { height * layer as f64 / layers as f64 };
        points.extend(disc.iter().map(|p| DVec3::new(x, p.x, p.y)));
    }
    let mut tetrahedra = Vec::with_capacity(n_tets);
    for layer in 0..layers {
        let bottom = (layer * per_layer) as u32;
        let top = bottom + per_layer as u32;
        for &triangle in &triangles {
            // The smaller index of every side starts its diagonal, so that neighbours agree.
            let [a, b, c] = super::sorted(triangle);
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
    name_sides(&mut mesh, &["x0", "x1", "side"], |mesh, triangle| {
        let on = |x: f64| triangle.iter().all(|&v| mesh.points[v as usize].x == x);
        if on(0.0) {
            0
        } else if on(height) {
            1
        } else {
            2
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
        const STEPS: [[usize; 3]; 6] =
            [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
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

/// A rectangle of triangles in the plane z = 0 with one corner at the origin and its normal along z.
///
/// `size` in metres; vertex `(i, j)` has the index `i (ny + 1) + j`. Groups `x0`, `x1`, `y0`, `y1`
/// (vertices of the edges) and `body`.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn triangle_grid(size: DVec2, n: [usize; 2]) -> Result<Mesh, MeshError> {
    const NAME: &str = "triangle_grid";
    length(NAME, "size.x", size.x)?;
    length(NAME, "size.y", size.y)?;
    let [nx, ny] = n;
    cells(NAME, "cells[0]", nx)?;
    cells(NAME, "cells[1]", ny)?;
    fits(NAME, "vertices", product(&[nx.saturating_add(1), ny.saturating_add(1)]))?;
    fits(NAME, "triangles", product(&[2, nx, ny]))?;
    let at = |i: usize, n: usize, size: f64| if i == n { size } else { size * i as f64 / n as f64 };
    let mut mesh = Mesh {
        source: format!("{NAME} {} x {} m, {nx} x {ny} cells", size.x, size.y),
        ..Mesh::default()
    };
    let names = ["x0", "x1", "y0", "y1"];
    let mut groups =
        names.map(|name| Group { name: name.to_owned(), dimension: 1, ..Group::default() });
    for i in 0..=nx {
        for j in 0..=ny {
            let index = mesh.points.len() as u32;
            mesh.points.push(DVec3::new(at(i, nx, size.x), at(j, ny, size.y), 0.0));
            for (group, on) in groups.iter_mut().zip([i == 0, i == nx, j == 0, j == ny]) {
                if on {
                    group.vertices.push(index);
                }
            }
        }
    }
    let row = (ny + 1) as u32;
    for i in 0..nx as u32 {
        for j in 0..ny as u32 {
            let a = i * row + j;
            mesh.triangles.push([a, a + row, a + row + 1]);
            mesh.triangles.push([a, a + row + 1, a + 1]);
        }
    }
    mesh.groups = groups.into();
    mesh.groups.push(whole(mesh.points.len(), mesh.triangles.len()));
    Ok(mesh)
}

/// Vertices of a disc around the origin, ring by ring from the centre, and its counter-clockwise
/// triangles.
fn disc(radius: f64, rings: usize) -> (Vec<DVec2>, Vec<[u32; 3]>) {
    let mut disc = vec![DVec2::ZERO];
    for ring in 1..=rings {
        for i in 0..6 * ring {
            let angle = std::f64::consts::TAU * i as f64 / (6 * ring) as f64;
            disc.push(DVec2::from_angle(angle) * (radius * ring as f64 / rings as f64));
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
    let rim = (disc.len() - 6 * rings) as u32..disc.len() as u32;
    let rim =
        Group { name: "rim".to_owned(), dimension: 1, vertices: rim.collect(), ..Group::default() };
    Ok(Mesh {
        source: format!("{NAME} radius {radius} m, {rings} rings"),
        groups: vec![rim, whole(disc.len(), triangles.len())],
        points: disc.into_iter().map(|p| p.extend(0.0)).collect(),
        triangles,
        ..Mesh::default()
    })
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
    Ok(Mesh {
        source: format!("sphere_triangles radius {radius} m, edges cut into {n}"),
        groups: vec![whole(points.len(), triangles.len())],
        points,
        triangles,
        ..Mesh::default()
    })
}

/// The group `body` of a mesh of triangles.
fn whole(points: usize, triangles: usize) -> Group {
    Group {
        name: "body".to_owned(),
        dimension: 2,
        vertices: (0..points as u32).collect(),
        tetrahedra: Vec::new(),
        triangles: (0..triangles as u32).collect(),
    }
}

/// Random numbers for [`jitter_interior`]: the splitmix64 sequence.
struct SplitMix(u64);

impl SplitMix {
    /// Uniform in -1 to 1.
    fn signed(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// The mesh with every interior vertex moved at random, by at most `fraction` (0 to 1) of its shortest
/// edge along each axis; the same `seed` gives the same mesh.
///
/// A move that would leave a cell less than a tenth of its volume or area is halved, up to eight times,
/// and then left out. In a mesh of triangles alone, vertices move in the plane of their triangles.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] when `fraction` is not between 0 and 1.
pub fn jitter_interior(mesh: &Mesh, fraction: f64, seed: u64) -> Result<Mesh, MeshError> {
    if !(0.0..=1.0).contains(&fraction) {
        return Err(MeshError::InvalidParameter {
            generator: "jitter_interior",
            parameter: "fraction",
            value: fraction.to_string(),
            remedy: "give a fraction of the edge length between 0 and 1",
        });
    }
    let n = mesh.points.len();
    let inside = |cell: &[u32]| cell.iter().all(|&v| (v as usize) < n);
    let mut interior = vec![false; n];
    let mut cells_of: Vec<Vec<u32>> = vec![Vec::new(); n];
    let cells: Vec<&[u32]> = if mesh.tetrahedra.is_empty() {
        mesh.triangles.iter().map(|c| c.as_slice()).collect()
    } else {
        mesh.tetrahedra.iter().map(|c| c.as_slice()).collect()
    };
    for (i, cell) in cells.iter().enumerate().filter(|(_, cell)| inside(cell)) {
        for &v in *cell {
            interior[v as usize] = true;
            cells_of[v as usize].push(i as u32);
        }
    }
    if mesh.tetrahedra.is_empty() {
        let mut edges = Vec::new();
        for &[a, b, c] in mesh.triangles.iter().filter(|c| inside(*c)) {
            edges.extend([[a, b], [b, c], [c, a]]);
        }
        for_equal_cells(&edges, n, |equal| {
            if let &[([a, b], _)] = equal {
                interior[a as usize] = false;
                interior[b as usize] = false;
            }
        });
    } else {
        let tets = mesh.tetrahedra.iter().filter(|c| inside(*c));
        let faces: Vec<[u32; 3]> = tets.flat_map(|&tet| tetrahedron_faces(tet)).collect();
        for v in boundary_faces(&faces, n).into_iter().flatten() {
            interior[v as usize] = false;
        }
    }

    let mut jittered = mesh.clone();
    let points = &mut jittered.points;
    let area = |points: &[DVec3], cell: &[u32]| {
        let p = |i: usize| points[cell[i] as usize];
        (p(1) - p(0)).cross(p(2) - p(0))
    };
    let mut random = SplitMix(seed);
    for v in (0..n).filter(|&v| interior[v]) {
        let here = points[v];
        let mut shortest = f64::INFINITY;
        let mut normal = DVec3::ZERO;
        let mut before = Vec::new();
        for &cell in &cells_of[v] {
            let cell = cells[cell as usize];
            for &other in cell.iter().filter(|&&other| other as usize != v) {
                shortest = shortest.min((points[other as usize] - here).length());
            }
            match *cell {
                [a, b, c, d] => before.push(DVec3::X * volume(points, [a, b, c, d])),
                _ => {
                    before.push(area(points, cell));
                    normal += area(points, cell);
                }
            }
        }
        let random = DVec3::new(random.signed(), random.signed(), random.signed());
        let mut step = random * (fraction * shortest);
        step -= step.project_onto_normalized(normal.try_normalize().unwrap_or(DVec3::ZERO));
        for _ in 0..8 {
            points[v] = here + step;
            let kept = cells_of[v].iter().zip(&before).all(|(&cell, before)| {
                match *cells[cell as usize] {
                    [a, b, c, d] => {
                        volume(points, [a, b, c, d]) * before.x >= 0.1 * before.x * before.x
                    }
                    _ => {
                        area(points, cells[cell as usize]).dot(*before)
                            >= 0.1 * before.length_squared()
                    }
                }
            });
            if kept && points[v].is_finite() {
                break;
            }
            points[v] = here;
            step *= 0.5;
        }
    }
    jittered.source = format!("{}, interior moved by {fraction} (seed {seed})", mesh.source);
    Ok(jittered)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn discs_and_spheres_of_triangles() {
        let area = |mesh: &Mesh| -> DVec3 {
            let p = |i: u32| mesh.points[i as usize];
            let normal = |&[a, b, c]: &[u32; 3]| 0.5 * (p(b) - p(a)).cross(p(c) - p(a));
            mesh.triangles.iter().map(normal).sum()
        };
        let disc = disc_triangles(2.0, 5).unwrap();
        assert_eq!((disc.points.len(), disc.triangles.len()), (91, 150));
        // a polygon of 30 sides
        let polygon = 0.5 * 30.0 * 4.0 * (2.0 * PI / 30.0).sin();
        assert!((area(&disc) - polygon * DVec3::Z).length() < 1e-12);
        let rim = &disc.group("rim").unwrap().vertices;
        assert_eq!(rim.len(), 30);
        assert!(rim.iter().all(|&v| (disc.points[v as usize].length() - 2.0).abs() < 1e-12));
        let sphere = sphere_triangles(0.5, 8).unwrap();
        assert_eq!((sphere.points.len(), sphere.triangles.len()), (642, 1280));
        assert!(sphere.points.iter().all(|p| (p.length() - 0.5).abs() < 1e-12));
        assert!(area(&sphere).length() < 1e-12);
        let outward = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| sphere.points[v as usize]);
            (b - a).cross(c - a).dot(a) > 0.0
        };
        assert!(sphere.triangles.iter().all(outward));
        assert!(disc_triangles(-1.0, 5).is_err() && sphere_triangles(1.0, 0).is_err());
    }

    /// All volumes positive, their sum as enclosed by the surface, and every vertex used.
    fn sound(mesh: &Mesh) -> f64 {
        let p = |i: u32| mesh.points[i as usize];
        for &tet in &mesh.tetrahedra {
            assert!(volume(&mesh.points, tet) > 0.0, "{}", mesh.source);
        }
        let enclosed: f64 =
            mesh.triangles.iter().map(|&[a, b, c]| p(a).dot(p(b).cross(p(c))) / 6.0).sum();
        let total = mesh.total_volume();
        // Sums of n rounded terms.
        assert!((enclosed - total).abs() <= 1e-12 * total, "{} {enclosed} {total}", mesh.source);
        let mut used = vec![false; mesh.points.len()];
        mesh.tetrahedra.iter().flatten().for_each(|&v| used[v as usize] = true);
        assert!(used.iter().all(|&used| used));
        let body = mesh.group("body").unwrap();
        assert_eq!((body.dimension, body.tetrahedra.len()), (3, mesh.tetrahedra.len()));
        total
    }

    #[test]
    fn box_is_exact_and_ordered() {
        let mesh = box_tets(DVec3::new(3.0, 1.0, 0.5), [3, 2, 4]).unwrap();
        assert_eq!(mesh.points.len(), 60);
        assert_eq!(mesh.tetrahedra.len(), 144);
        assert!((sound(&mesh) - 1.5).abs() < 1e-14);
        assert_eq!(mesh.points[(2 * 3 + 1) * 5 + 3], DVec3::new(2.0, 0.5, 0.375));
        for (name, axis, value) in [
            ("x0", 0, 0.0),
            ("x1", 0, 3.0),
            ("y0", 1, 0.0),
            ("y1", 1, 1.0),
            ("z0", 2, 0.0),
            ("z1", 2, 0.5),
        ] {
            let group = mesh.group(name).unwrap();
            let on: Vec<u32> =
                (0..60).filter(|&i| mesh.points[i as usize].to_array()[axis] == value).collect();
            assert_eq!((group.dimension, &group.vertices), (2, &on), "{name}");
            let triangles = group.triangles.iter().map(|&i| mesh.triangles[i as usize]);
            assert!(triangles.flatten().all(|v| on.contains(&v)));
        }
    }

    #[test]
    fn cylinder_fills_its_polygon() {
        for (rings, layers) in [(1, 1), (2, 3), (5, 4)] {
            let mesh = cylinder_tets(0.5, 2.0, rings, layers).unwrap();
            let sides = 6.0 * rings as f64;
            let polygon = 0.5 * sides * 0.25 * (2.0 * PI / sides).sin();
            assert!((sound(&mesh) - 2.0 * polygon).abs() < 1e-13);
            assert_eq!(mesh.tetrahedra.len(), 18 * rings * rings * layers);
            for name in ["x0", "x1"] {
                assert_eq!(mesh.group(name).unwrap().triangles.len(), 6 * rings * rings);
            }
            assert_eq!(mesh.group("side").unwrap().triangles.len(), 12 * rings * layers);
        }
    }

    #[test]
    fn ball_approaches_its_volume() {
        for n in [1, 2, 3, 6, 12] {
            let mesh = sphere_tets(2.0, n).unwrap();
            assert_eq!(mesh.tetrahedra.len(), 20 * n * n * n);
            let shells: usize = (1..=n).map(|k| 10 * k * k + 2).sum();
            assert_eq!(mesh.points.len(), 1 + shells);
            let exact = 4.0 / 3.0 * PI * 8.0;
            let defect = 1.0 - sound(&mesh) / exact;
            // The inscribed polyhedron misses a share that falls with n^2; 0.395 for the icosahedron.
            assert!(defect > 0.0 && defect < 0.4 / (n * n) as f64 * 1.6, "{n} {defect}");
            let surface = mesh.group("surface").unwrap();
            assert_eq!(surface.triangles.len(), 20 * n * n);
            assert!(
                surface
                    .vertices
                    .iter()
                    .all(|&v| (mesh.points[v as usize].length() - 2.0).abs() < 1e-15 * 4.0)
            );
        }
    }

    #[test]
    fn grid_faces_up() {
        let mesh = triangle_grid(DVec2::new(2.0, 1.0), [4, 3]).unwrap();
        let p = |i: u32| mesh.points[i as usize];
        let area: f64 =
            mesh.triangles.iter().map(|&[a, b, c]| (p(b) - p(a)).cross(p(c) - p(a)).z / 2.0).sum();
        assert!((area - 2.0).abs() < 1e-14);
        assert_eq!(mesh.group("x0").unwrap().vertices, [0, 1, 2, 3]);
        assert_eq!(mesh.group("y1").unwrap().vertices, [3, 7, 11, 15, 19]);
        assert_eq!(mesh.group("body").unwrap().triangles.len(), 24);
    }

    #[test]
    fn jitter_keeps_the_surface_and_the_winding() {
        let mesh = box_tets(DVec3::ONE, [6, 6, 6]).unwrap();
        for fraction in [0.0, 0.2, 1.0] {
            let moved = jitter_interior(&mesh, fraction, 7).unwrap();
            assert!((sound(&moved) - 1.0).abs() < 1e-12);
            assert_eq!(moved.points, jitter_interior(&mesh, fraction, 7).unwrap().points);
            let n = mesh.points.iter().zip(&moved.points).filter(|(a, b)| a != b).count();
            // 5^3 of 7^3 vertices lie inside.
            assert!(if fraction == 0.0 { n == 0 } else { n <= 125 && n > 100 }, "{n}");
        }
        let flat = triangle_grid(DVec2::ONE, [5, 5]).unwrap();
        let moved = jitter_interior(&flat, 0.4, 1).unwrap();
        assert_eq!(flat.points.iter().zip(&moved.points).filter(|(a, b)| a != b).count(), 16);
        // The projection rounds.
        assert!(moved.points.iter().all(|p| p.z.abs() < 1e-16));
    }

    #[test]
    fn bad_parameters_are_named() {
        let one = [1, 1, 1];
        for size in [DVec3::new(0.0, 1.0, 1.0), DVec3::new(1.0, f64::NAN, 1.0), -DVec3::ONE] {
            assert!(matches!(box_tets(size, one), Err(MeshError::InvalidParameter { .. })));
        }
        let error = box_tets(DVec3::ONE, [1, 0, 1]).unwrap_err();
        assert!(error.to_string().contains("cells[1] = 0"), "{error}");
        let huge = [1 << 20, 1 << 20, 1 << 20];
        assert!(matches!(box_tets(DVec3::ONE, huge), Err(MeshError::TooMany { .. })));
        assert!(matches!(box_tets(DVec3::ONE, [usize::MAX; 3]), Err(MeshError::TooMany { .. })));
        assert!(cylinder_tets(1.0, f64::INFINITY, 1, 1).is_err());
        assert!(cylinder_tets(1.0, 1.0, usize::MAX, usize::MAX).is_err());
        assert!(sphere_tets(-1.0, 2).is_err());
        assert!(sphere_tets(1.0, 1 << 40).is_err());
        assert!(triangle_grid(DVec2::ONE, [0, 2]).is_err());
        assert!(triangle_grid(DVec2::ONE, [usize::MAX, 2]).is_err());
        let mesh = box_tets(DVec3::ONE, one).unwrap();
        assert!(jitter_interior(&mesh, f64::NAN, 0).is_err());
    }
}
