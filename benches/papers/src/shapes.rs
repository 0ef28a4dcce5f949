//! The bodies of Natsupakpong & Cavusoglu 2010 as meshes of the printed counts. Sizes are printed, but not the outlines
//! of the soft tissue, here a rectangle, and of the shoulders of the specimen, here parabolas.
//!
//! How a mesh was chosen, from geometry alone: vertices as printed where the generator can have any number; in the
//! plane as many fixed points on edges as give the printed number of triangles (Euler's formula); in space as many as
//! give edges of the length that regular tetrahedra of the printed number have (on the specimen a tenth more, since no
//! grading comes near the print otherwise); the least grading, in steps of 0.1, with which the tetrahedra are within
//! 4 % of those printed. No angle of a triangle is below 35 degrees and none between faces of a tetrahedron below 15.
//! Grids: of the numbers of cells within 4 % of the printed counts, those whose cells are nearest to squares and cubes.
//! The printed 675 vertices and 496 hexahedra of the cylinder can only be 75 vertices and 62 quadrilaterals of a disc in 8
//! layers, and 24 edges on its rim follow by Euler's formula. The printed 445 vertices and 405 quadrilaterals of the tissue are
//! those of 135 triangles of 88 vertices that are cut into three each, with 39 edges on the rim by the same formula; grids
//! cannot have them.

use super::relaxed::Region;
use glam::{DVec2, DVec3};
use sinew::engine::mesh::generate::{
    box_hexahedra, jitter_interior, quad_grid, specimen_hexahedra, specimen_quads,
};
use sinew::engine::mesh::io::write_gmsh;
use sinew::engine::mesh::{Group, Mesh};
use sinew_benches::toolbox::error::{BenchError, Result};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Width of the straight part of the specimen and thickness of the solid one (m).
pub(crate) const WIDTH: f64 = 0.01;
/// Radius and length of the cylinder, radius of the empty sphere, side of cube and square (m).
const RADIUS: f64 = 0.01;
const SIDE: f64 = 0.02;
const HOLE: f64 = 0.006;
/// Soft tissue (m).
const TISSUE: DVec2 = DVec2::new(0.06, 0.02);

/// Name, printed vertices and elements.
pub(crate) const PRINTED: [(&str, [usize; 2]); 13] = [
    ("tissue_tri", [210, 366]),
    ("tissue_quad", [445, 405]),
    ("square_tri", [101, 168]),
    ("square_quad", [121, 100]),
    ("cylinder_tet", [124, 381]),
    ("cylinder_hex", [675, 496]),
    ("cylinder_hole_tet", [404, 1559]),
    ("cube_tet", [170, 592]),
    ("cube_hex", [729, 512]),
    ("dogbone_tri", [125, 192]),
    ("dogbone_quad", [329, 266]),
    ("dogbone_tet", [538, 1500]),
    ("dogbone_hex", [1396, 843]),
];

/// The printed counts of a mesh.
pub(crate) fn printed(name: &str) -> Option<[usize; 2]> {
    PRINTED.iter().find(|p| p.0 == name).map(|p| p.1)
}

/// Vertices of the triangles whose thirds are the quadrilaterals of the tissue.
const OF_THIRDS: usize = 88;
/// Vertices more than printed in the meshes of [`variant`].
const MORE: [isize; 5] = [0, -2, 2, -4, 4];
/// Part of the width that the ends of the bulged tissue lack.
const BULGE: f64 = 0.2;

/// A mesh of [`PRINTED`] by its name, with the groups `x0` and `x1` of its ends; of several about as near to the print as
/// each other the one with this number, counted from 0. Relaxed meshes have a few vertices more or less, grids have their
/// inner vertices moved, the disc of the hexahedral cylinder is built round a vertex of five or of four quadrilaterals,
/// and the soft tissue is a rectangle or bulges by a fifth, its quadrilaterals thirds of triangles or, from number 2 on, a
/// grid: a paper that says no more than counts could have had any.
///
/// # Errors
/// When the name is not there.
pub(crate) fn variant(name: &str, number: u64) -> Result<Mesh> {
    if name.starts_with("tissue") && number % 2 == 1 {
        let mut mesh = variant(name, number - 1)?;
        let middle = 0.5 * TISSUE;
        for p in &mut mesh.points {
            let along = p.x / middle.x - 1.0;
            p.y = middle.y + (p.y - middle.y) * (1.0 - BULGE * along * along);
        }
        return Ok(mesh);
    }
    let Some([count, _]) = printed(name) else {
        let names: Vec<&str> = PRINTED.iter().map(|p| p.0).collect();
        return Err(BenchError::Request {
            what: format!("a mesh called {name}"),
            remedy: format!("choose of {}", names.join(", ")),
        });
    };
    let thirds_of_triangles = name == "tissue_quad" && number < 2;
    let count = match name {
        "tissue_quad" => OF_THIRDS,
        _ => count.saturating_add_signed(MORE[number as usize % MORE.len()]),
    };
    let outside = |p: DVec3, size: DVec3| ((p - 0.5 * size).abs() - 0.5 * size).max_element();
    let sheet =
        |p: DVec3, size: DVec2| ((p.truncate() - 0.5 * size).abs() - 0.5 * size).max_element();
    let round = |p: DVec3| {
        let side = (p.y * p.y + p.z * p.z).sqrt() - RADIUS;
        side.max(-p.x).max(p.x - SIDE)
    };
    let hollow = |p: DVec3| round(p).max(HOLE - p.distance(DVec3::X * (0.5 * SIDE)));
    let square = DVec2::splat(SIDE);
    let barrel = [DVec3::new(0.0, -RADIUS, -RADIUS), DVec3::new(SIDE, RADIUS, RADIUS)];
    let half = DVec2::new(8.0, 1.5) * WIDTH;
    let bone = |z: f64| [(-half).extend(0.0), half.extend(z)];
    let solid_bone = |p: DVec3| flat_bone(p).max(-p.z).max(p.z - WIDTH);
    let plane = |size: DVec2| [DVec3::ZERO, size.extend(0.0)];
    let (dimension, bounds, distance, fixed, grade): (_, _, &dyn Fn(DVec3) -> f64, _, _) =
        match name {
            "tissue_tri" => {
                (2, plane(TISSUE), &|p| sheet(p, TISSUE), rim(TISSUE, [20, 20], 6), 0.0)
            }
            "tissue_quad" if thirds_of_triangles => {
                (2, plane(TISSUE), &|p| sheet(p, TISSUE), rim(TISSUE, [14, 15], 5), 0.0)
            }
            "square_tri" => (2, plane(square), &|p| sheet(p, square), rim(square, [8, 8], 8), 0.0),
            "dogbone_tri" => (2, bone(0.0), &flat_bone, outline(24, 4), 0.0),
            "cylinder_tet" => (3, barrel, &round, rims(12), 0.3),
            "cylinder_hole_tet" => (3, barrel, &hollow, rims(20), 0.0),
            "cube_tet" => {
                let cube = DVec3::splat(SIDE);
                (3, [DVec3::ZERO, cube], &move |p| outside(p, cube), cube_edges(4), 0.1)
            }
            "dogbone_tet" => (3, bone(WIDTH), &solid_bone, bone_edges(), 0.6),
            _ => return grid(name, number),
        };
    let region = Region { dimension, bounds, distance, fixed, grade };
    let (points, cells) = region.mesh(count);
    let mut mesh = Mesh { source: format!("{name}, relaxed"), points, ..Mesh::default() };
    if dimension == 2 {
        mesh.triangles = cells.into_iter().map(|[a, b, c, _]| [a, b, c]).collect();
    } else {
        mesh.tetrahedra = cells;
    }
    if thirds_of_triangles {
        mesh.quads = thirds(&mut mesh.points, &std::mem::take(&mut mesh.triangles));
    }
    // points pressed against an end lie in its plane but for rounding
    for (group, end) in [("x0", bounds[0].x), ("x1", bounds[1].x)] {
        let mut vertices = Vec::new();
        for (v, p) in mesh.points.iter_mut().enumerate() {
            if (p.x - end).abs() < 1e-9 {
                p.x = end;
                vertices.push(v as u32);
            }
        }
        mesh.groups.push(Group { name: group.into(), vertices, ..Group::default() });
    }
    Ok(mesh)
}

/// Writes the meshes of some of [`PRINTED`] as `b_NAME.msh`, with the groups `fixed` and `loaded` that `--meshes` reads.
///
/// # Errors
/// When a file cannot be written.
pub(crate) fn write<'n>(
    folder: &Path,
    names: impl IntoIterator<Item = &'n str>,
) -> Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder)
        .map_err(|e| BenchError::Write { path: folder.into(), reason: e.to_string() })?;
    let file = |name: &str| {
        let mut mesh = variant(name, 0)?;
        for group in &mut mesh.groups {
            group.name = match group.name.as_str() {
                "x0" => "fixed".into(),
                "x1" => "loaded".into(),
                _ => continue,
            };
        }
        let path = folder.join(format!("b_{name}.msh"));
        write_gmsh(&path, &mesh)?;
        Ok(path)
    };
    names.into_iter().map(file).collect()
}

/// Meshes of squares and bricks.
fn grid(name: &str, number: u64) -> Result<Mesh> {
    let mesh = match name {
        "cylinder_hex" if number.is_multiple_of(2) => return Ok(cylinder(5, [16, 24, 24])),
        "cylinder_hex" => return Ok(cylinder(4, [18, 24, 24])),
        "tissue_quad" => return Ok(jitter_interior(&quad_grid(TISSUE, [34, 12])?, 0.2, 1)?),
        "square_quad" => quad_grid(DVec2::splat(SIDE), [10, 10])?,
        "cube_hex" => box_hexahedra(DVec3::splat(SIDE), [8, 8, 8])?,
        "dogbone_quad" => specimen_quads(WIDTH, [53, 5])?,
        _ => specimen_hexahedra(WIDTH, WIDTH, [56, 5, 3])?,
    };
    Ok(if number == 0 { mesh } else { jitter_interior(&mesh, 0.2, number)? })
}

/// Layers of the cylinder of hexahedra, and sweeps that smooth its disc.
const LAYERS: usize = 8;
const SMOOTHINGS: usize = 500;

/// A disc of quadrilaterals in layers: so many round the middle, then rings up to these numbers of vertices. Where a ring
/// has more vertices than the one inside, some of its quadrilaterals have three corners on it. Inner vertices come to lie
/// in the middle of their neighbours, so that no quadrilateral is turned over (Tutte 1963, How to draw a graph).
fn cylinder(middle: usize, rings: [usize; 3]) -> Mesh {
    let circle = |radius: f64, n: usize| {
        (0..n).map(move |i| radius * DVec2::from_angle(TAU * i as f64 / n as f64))
    };
    let mut places = vec![DVec2::ZERO];
    let mut count = 2 * middle;
    places.extend(circle(0.25, count));
    let around = |i: usize| 1 + i % (2 * middle);
    let mut quads: Vec<[usize; 4]> =
        (0..middle).map(|i| [0, around(2 * i), around(2 * i + 1), around(2 * i + 2)]).collect();
    let mut inner = 1;
    for (ring, outer_count) in rings.into_iter().enumerate() {
        let outer = places.len();
        places.extend(circle(0.25 * (ring + 2) as f64, outer_count));
        let [a, b] =
            [(inner, count), (outer, outer_count)].map(|(first, n)| move |i: usize| first + i % n);
        let more = (outer_count - count) / 2;
        let mut j = 0;
        for i in 0..count {
            quads.push([a(i), b(j), b(j + 1), a(i + 1)]);
            j += 1;
            if (i + 1) * more / count > i * more / count {
                quads.push([a(i + 1), b(j), b(j + 1), b(j + 2)]);
                j += 2;
            }
        }
        (inner, count) = (outer, outer_count);
    }
    let mut beside = vec![std::collections::BTreeSet::new(); places.len()];
    for quad in &quads {
        for (i, &v) in quad.iter().enumerate() {
            beside[v].extend([quad[(i + 1) % 4], quad[(i + 3) % 4]]);
        }
    }
    for _ in 0..SMOOTHINGS {
        for v in 0..inner {
            let sum: DVec2 = beside[v].iter().map(|&w| places[w]).sum();
            places[v] = sum / beside[v].len() as f64;
        }
    }
    let mut mesh =
        Mesh { source: format!("disc round {middle} quadrilaterals"), ..Mesh::default() };
    for layer in 0..=LAYERS {
        let x = SIDE * layer as f64 / LAYERS as f64;
        mesh.points.extend(places.iter().map(|p| DVec3::new(x, RADIUS * p.x, RADIUS * p.y)));
    }
    let vertex = |layer: usize, v: usize| (layer * places.len() + v) as u32;
    for layer in 0..LAYERS {
        mesh.hexahedra
            .extend(quads.iter().map(|q| std::array::from_fn(|i| vertex(layer + i / 4, q[i % 4]))));
    }
    for (name, layer) in [("x0", 0), ("x1", LAYERS)] {
        let vertices = (0..places.len()).map(|v| vertex(layer, v)).collect();
        mesh.groups.push(Group { name: name.into(), vertices, ..Group::default() });
    }
    mesh
}

/// Triangles cut into three quadrilaterals each, from their middles to those of their sides; new points are added.
fn thirds(points: &mut Vec<DVec3>, triangles: &[[u32; 3]]) -> Vec<[u32; 4]> {
    let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let mut quads = Vec::new();
    for t in triangles {
        let corners = t.map(|v| points[v as usize]);
        let sides = [0, 1, 2].map(|i| {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                points.push(0.5 * (corners[i] + corners[(i + 1) % 3]));
                points.len() as u32 - 1
            })
        });
        points.push(corners.iter().sum::<DVec3>() / 3.0);
        let middle = points.len() as u32 - 1;
        quads.extend([0, 1, 2].map(|i| [t[i], sides[i], middle, sides[(i + 2) % 3]]));
    }
    quads
}

/// Points round a rectangle, so many edges on its lower and its upper side, and on either end.
fn rim(size: DVec2, along: [usize; 2], ny: usize) -> Vec<DVec3> {
    let part = |i: usize, n: usize, length: f64| length * i as f64 / n as f64;
    let sides = along.into_iter().zip([0.0, size.y]);
    let rows =
        sides.flat_map(|(n, y)| (0..=n).map(move |i| DVec3::new(part(i, n, size.x), y, 0.0)));
    let ends = (1..ny).flat_map(|j| [0.0, size.x].map(|x| DVec3::new(x, part(j, ny, size.y), 0.0)));
    rows.chain(ends).collect()
}

/// Points on the rims of both ends of the cylinder.
fn rims(n: usize) -> Vec<DVec3> {
    let place = |x: f64, i: usize| {
        let (sin, cos) = libm::sincos(TAU * i as f64 / n as f64);
        DVec3::new(x, RADIUS * cos, RADIUS * sin)
    };
    [0.0, SIDE].into_iter().flat_map(|x| (0..n).map(move |i| place(x, i))).collect()
}

/// Points on the twelve edges of the cube, `n` to an edge.
fn cube_edges(n: usize) -> Vec<DVec3> {
    let all = (0..(n + 1).pow(3)).map(|i| [i / (n + 1).pow(2), i / (n + 1) % (n + 1), i % (n + 1)]);
    let on_edge = |p: &[usize; 3]| p.iter().filter(|&&x| x == 0 || x == n).count() >= 2;
    all.filter(on_edge).map(|p| DVec3::from_array(p.map(|x| SIDE * x as f64 / n as f64))).collect()
}

/// Place on the shoulder, from 0 at the straight part to 1 at the grip.
fn shoulder(x: f64) -> f64 {
    ((x.abs() / WIDTH - 1.0) / 4.0).clamp(0.0, 1.0)
}

/// Distance (m) from the outline of the specimen, whose half width is that of
/// [`specimen_quads`](sinew::engine::mesh::generate::specimen_quads).
fn flat_bone(p: DVec3) -> f64 {
    let s = shoulder(p.x);
    let across = (p.y.abs() - WIDTH * (0.5 + s * s)) / (1.0 + 0.25 * s * s).sqrt();
    across.max(p.x.abs() - 8.0 * WIDTH)
}

/// Points on the outline of the specimen: `along` edges of equal length on either side, `across` on either end.
fn outline(along: usize, across: usize) -> Vec<DVec3> {
    const FINE: usize = 4000;
    let on = |x: f64| DVec2::new(x, WIDTH * (0.5 + shoulder(x) * shoulder(x)));
    let curve: Vec<DVec2> =
        (0..=FINE).map(|i| on(WIDTH * (16.0 * i as f64 / FINE as f64 - 8.0))).collect();
    let mut arc = vec![0.0];
    for pair in curve.windows(2) {
        arc.push(arc[arc.len() - 1] + pair[0].distance(pair[1]));
    }
    let mut points = Vec::new();
    for i in 0..=along {
        let wanted = arc[FINE] * i as f64 / along as f64;
        let DVec2 { x, y } = curve[arc.partition_point(|a| *a < wanted - 1e-9 * WIDTH).min(FINE)];
        points.extend([y, -y].map(|y| DVec3::new(x, y, 0.0)));
    }
    for j in 1..across {
        let y = WIDTH * (3.0 * j as f64 / across as f64 - 1.5);
        points.extend([-8.0, 8.0].map(|x| DVec3::new(x * WIDTH, y, 0.0)));
    }
    points
}

/// Points on the edges of the solid specimen.
fn bone_edges() -> Vec<DVec3> {
    let flat = outline(32, 6);
    let mut points: Vec<DVec3> = flat.iter().map(|p| p.with_z(WIDTH)).collect();
    points.extend(&flat);
    for x in [-8.0, 8.0] {
        points.extend([-1.5, 1.5].map(|y| DVec3::new(x, y, 0.5) * WIDTH));
    }
    points
}

#[cfg(test)]
mod tests {
    use super::super::relaxed::angles;
    use super::*;
    use sinew::engine::mesh::{CheckOptions, check};

    /// Counts, angles, soundness and size are what the module says.
    #[test]
    fn meshes_are_near_the_printed_ones_and_sound() {
        let bone = 2.0 + 2.0 * (4.0 + 4.0 * 2.0 / 3.0) + 2.0 * 9.0;
        let ball = 4.0 / 3.0 * std::f64::consts::PI * HOLE.powi(3);
        let cylinder = std::f64::consts::PI * RADIUS * RADIUS * SIDE;
        let (cube, square) = (SIDE.powi(3), SIDE * SIDE);
        for (name, [vertices, elements]) in PRINTED {
            let mesh = variant(name, 0).unwrap();
            let cells = mesh.triangles.len() * usize::from(name.ends_with("tri"))
                + mesh.quads.len() * usize::from(name.ends_with("quad"))
                + mesh.tetrahedra.len()
                + mesh.hexahedra.len();
            let off = |own: usize, printed: usize| (own as f64 / printed as f64 - 1.0).abs();
            let counts = format!("{name}: {} / {cells}", mesh.points.len());
            assert!(
                off(mesh.points.len(), vertices) < 0.04 && off(cells, elements) < 0.04,
                "{counts}"
            );
            if ["tissue_quad", "cylinder_hex"].contains(&name) {
                assert_eq!((mesh.points.len(), cells), (vertices, elements), "{name}");
            }
            let checked = check(&mesh, &CheckOptions { strict: true, ..CheckOptions::default() });
            assert_eq!(checked.unwrap().report.findings, [], "{name}");
            for group in ["x0", "x1"] {
                assert!(mesh.group(group).unwrap().vertices.len() > 3, "{name}");
            }
            let sized = [("tissue", TISSUE.x * TISSUE.y, 1e-9), ("square", square, 1e-9)];
            let thick = [("cylinder_hole", cylinder - ball, 0.05), ("cylinder", cylinder, 0.05)];
            let more = [("cube", cube, 1e-9), ("dogbone", bone * WIDTH * WIDTH, 0.01)];
            let all = sized.into_iter().chain(thick).chain(more);
            let (_, size, allowed) = all.into_iter().find(|s| name.starts_with(s.0)).unwrap();
            let flat = !mesh.is_solid();
            let (own, wanted) = if flat {
                let split = mesh.split_into_simplices();
                let p = |v: u32| mesh.points[v as usize];
                let area = |&[a, b, c]: &[u32; 3]| 0.5 * (p(b) - p(a)).cross(p(c) - p(a)).z;
                (split.triangles.iter().map(area).sum(), size)
            } else {
                let thick = if name.starts_with("dogbone") { WIDTH } else { 1.0 };
                (mesh.total_volume(), size * thick)
            };
            assert!((own / wanted - 1.0f64).abs() < allowed, "{name}: {own} {wanted}");
            let triangles = mesh.triangles.iter().filter(|_| name.ends_with("tri"));
            for &[a, b, c] in triangles {
                assert!(angles(&mesh.points, [a, b, c, u32::MAX], 2)[0] > 35.0, "{name}");
            }
            for &cell in &mesh.tetrahedra {
                let [low, high] = angles(&mesh.points, cell, 3);
                assert!(low > 15.0 && high < 165.0, "{name}: {low} {high}");
            }
        }
    }

    /// A mesh that was written is what a figure takes in place of the one that is generated.
    #[test]
    fn meshes_that_are_written_are_read_as_they_were() {
        let folder = std::env::temp_dir().join(format!("sinew-meshes-{}", std::process::id()));
        let names = ["square_tri", "square_quad", "cube_tet", "cube_hex"];
        let files = write(&folder, names).unwrap();
        for (name, file) in names.into_iter().zip(&files) {
            let (own, read) = (variant(name, 0).unwrap(), Mesh::read(file).unwrap());
            let cells = |m: &Mesh| (m.tetrahedra.clone(), m.hexahedra.clone());
            assert_eq!((&own.points, cells(&own)), (&read.points, cells(&read)), "{name}");
            let [from_file, generated] = [Some(folder.as_path()), None]
                .map(|folder| super::super::lumped::Meshes::new(folder).get(name).unwrap());
            let ends = |s: &super::super::lumped::Specimen| {
                (s.counts, s.rig.held.clone(), s.rig.loaded.clone())
            };
            assert_eq!(ends(&from_file), ends(&generated), "{name}");
        }
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn the_same_mesh_comes_again() {
        let cylinder = || variant("cylinder_tet", 0).unwrap();
        assert_eq!(cylinder(), cylinder());
        let unknown = variant("cube_pyramid", 0).unwrap_err().to_string();
        assert!(unknown.contains("cube_pyramid") && unknown.contains("cube_tet"), "{unknown}");
    }

    /// Other meshes of about the printed counts, the cylinder's of exactly these.
    #[test]
    fn variants_are_other_sound_meshes() {
        for name in ["cylinder_hex", "tissue_quad", "dogbone_tri", "cube_hex"] {
            let [first, second] = [0, 1].map(|number| variant(name, number).unwrap());
            assert_ne!(first.points, second.points, "{name}");
            let options = CheckOptions { strict: true, ..CheckOptions::default() };
            assert_eq!(check(&second, &options).unwrap().report.findings, [], "{name}");
            if name == "cylinder_hex" {
                for mesh in [first, second] {
                    assert_eq!([mesh.points.len(), mesh.hexahedra.len()], [675, 496]);
                }
            }
        }
    }
}
