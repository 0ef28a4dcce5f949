//! Deformed bodies of springs with the finite elements of the same mesh dashed over them, as figures 4, 5, 6 and 8 of
//! Natsupakpong & Cavusoglu 2010 show them. Drawn as SVG text; bodies in space are seen from above and aside.

use super::lumped::{Meshes, Specimen, printed_name};
use super::prelude::*;
use glam::DVec2;
use sinew_identify::ElementMethod::{Frobenius, TwoNorm};
use sinew_tune::fit::assess::against;
use sinew_tune::fit::rig::Reading;
use sinew_tune::table::escape;
use std::collections::BTreeSet;
use std::fmt::Write;

/// Width of a panel and space round and above it (pixels).
const PANEL: f64 = 400.0;
const SPACE: f64 = 20.0;
const HEAD: f64 = 26.0;
/// Axes of the picture in space: to the right and up; the eye is where their cross product points.
const RIGHT: DVec3 = DVec3::new(0.92, 0.39, 0.0);
const UP: DVec3 = DVec3::new(-0.14, 0.33, 0.93);

/// Edges of the elements in the plane, or of the faces that the eye sees.
fn edges(specimen: &Specimen) -> Vec<[u32; 2]> {
    let (rig, cells) = (&specimen.rig, specimen.rig.cells());
    let points: Vec<DVec3> = rig.points.iter().map(|p| DVec3::from_array(*p)).collect();
    let mut sides: Vec<Vec<u32>> = cells.triangles.iter().map(|t| t.to_vec()).collect();
    sides.extend(cells.quads.iter().map(|q| q.to_vec()));
    if rig.dimension == 3 {
        let (tetrahedra, hexahedra) = (cells.tetrahedra.to_vec(), cells.hexahedra.to_vec());
        let mesh = Mesh { points: points.clone(), tetrahedra, hexahedra, ..Mesh::default() };
        let surface = mesh.surface();
        sides = surface.triangles.iter().map(|t| t.to_vec()).collect();
        sides.extend(surface.quads.iter().map(|q| q.to_vec()));
        let eye = RIGHT.cross(UP);
        sides.retain(|side| {
            let [a, b, c] = [0, 1, 2].map(|i| points[side[i] as usize]);
            (b - a).cross(c - a).dot(eye) > 0.0
        });
    }
    let mut edges = BTreeSet::new();
    for side in sides {
        for (i, &a) in side.iter().enumerate() {
            let b = side[(i + 1) % side.len()];
            edges.insert([a.min(b), a.max(b)]);
        }
    }
    edges.into_iter().collect()
}

/// Places of the nodes in the picture (m), displaced.
fn placed(specimen: &Specimen, displacements: &[[f64; 3]]) -> Vec<DVec2> {
    let flat = specimen.rig.dimension == 2;
    let at = specimen.rig.points.iter().zip(displacements).map(|(x, u)| {
        let p = DVec3::from_array(*x) + DVec3::from_array(*u);
        if flat { p.truncate() } else { DVec2::new(p.dot(RIGHT), p.dot(UP)) }
    });
    at.collect()
}

/// One path through all edges, at most a pixel wide where it is thin.
fn path(
    edges: &[[u32; 2]],
    places: &[DVec2],
    to_page: &dyn Fn(DVec2) -> DVec2,
    style: &str,
) -> String {
    let mut text = String::from("<path d=\"");
    for &[a, b] in edges {
        let [a, b] = [a, b].map(|v| to_page(places[v as usize]));
        let _ = write!(text, "M{:.1} {:.1}L{:.1} {:.1}", a.x, a.y, b.x, b.y);
    }
    text + &format!("\" fill=\"none\" {style}/>\n")
}

const SPRINGS: &str = "stroke=\"#0072b2\" stroke-width=\"2.4\"";
const ELEMENTS: &str = "stroke=\"#d55e00\" stroke-width=\"1.3\" stroke-dasharray=\"4 3\"";

fn words(x: f64, y: f64, size: u32, text: &str) -> String {
    let text = escape(text);
    format!("<text x=\"{x:.0}\" y=\"{y:.0}\" font-size=\"{size}\" fill=\"#222\">{text}</text>\n")
}

/// Meshes by name and what they are called, a row each, stretched by `part` under a consistent traction: springs of the
/// 2-norm on the left, of the F-norm on the right.
///
/// # Errors
/// When a mesh cannot be had or fitted.
pub(crate) fn chart(
    meshes: &Meshes,
    name: &str,
    title: &str,
    wanted: &[(&str, &str)],
    part: f64,
) -> Result<Chart> {
    let mut body = words(SPACE, 24.0, 17, title);
    for (x, style, what) in [(0.0, SPRINGS, "springs"), (130.0, ELEMENTS, "finite elements")] {
        let _ = writeln!(body, "<path d=\"M{} 42H{}\" {style}/>", SPACE + x, SPACE + x + 34.0);
        body += &words(SPACE + x + 40.0, 46.0, 13, what);
    }
    let mut top = 60.0;
    for (mesh, what) in wanted {
        let specimen = meshes.get(mesh)?;
        let rig = &specimen.rig;
        let (loading, fem) = specimen.loaded(rig.axis, Reading::Traction, part)?;
        let (edges, elements) = (edges(&specimen), placed(&specimen, &fem));
        let bounds = |all: &[DVec2]| {
            let first = (all[0], all[0]);
            all.iter().fold(first, |(low, high), p| (low.min(*p), high.max(*p)))
        };
        let mut own = Vec::new();
        for method in [TwoNorm, Frobenius] {
            let springs = specimen.springs(method)?;
            let found = against(rig, &springs, &loading, &fem, None).ok();
            own.push((method, found.map(|own| placed(&specimen, &own.displacements))));
        }
        let all = own.iter().filter_map(|o| o.1.as_deref()).chain([&elements[..]]).map(bounds);
        let (low, high) =
            all.reduce(|(a, b), (c, d)| (a.min(c), b.max(d))).unwrap_or((DVec2::ZERO, DVec2::ONE));
        let scale = (PANEL / (high.x - low.x)).min(PANEL / (high.y - low.y));
        for (column, (method, places)) in own.iter().enumerate() {
            let left = SPACE + column as f64 * (PANEL + SPACE);
            body += &words(left, top + 14.0, 13, &format!("{what}, {}", printed_name(*method)));
            let corner = DVec2::new(left, top + HEAD);
            let to_page = |p: DVec2| corner + scale * DVec2::new(p.x - low.x, high.y - p.y);
            match places {
                Some(places) => body += &path(&edges, places, &to_page, SPRINGS),
                None => body += &words(left, top + HEAD + 20.0, 13, "springs: no equilibrium"),
            }
            body += &path(&edges, &elements, &to_page, ELEMENTS);
        }
        top += HEAD + scale * (high.y - low.y) + SPACE;
    }
    let width = 2.0 * PANEL + 3.0 * SPACE;
    let svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{top:.0}\" \
         viewBox=\"0 0 {width:.0} {top:.0}\" font-family=\"sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n{body}</svg>\n"
    );
    Ok(Chart { name: name.into(), svg })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn springs_are_solid_and_elements_dashed_over_them() {
        let meshes = Meshes::new(None);
        let wanted = [("square_quad", "square"), ("cube_hex", "cube")];
        let svg = chart(&meshes, "x", "two & more", &wanted, 0.1).unwrap().svg;
        let paths: Vec<&str> =
            svg.lines().filter(|l| l.starts_with("<path d=\"M") && l.contains('L')).collect();
        let dashed = |l: &&str| l.contains("stroke-dasharray");
        assert_eq!((paths.len(), paths.iter().filter(|l| dashed(l)).count()), (8, 4));
        // the square has 220 edges; three sides of the cube are seen, two of whose 144 edges are shared with another
        assert_eq!(paths[0].matches('L').count(), 220);
        assert_eq!(paths[4].matches('L').count(), 3 * 144 - 3 * 8);
        assert!(!dashed(&paths[0]) && dashed(&paths[1]) && svg.contains("two &amp; more"));
        assert!(!svg.contains("NaN") && !svg.contains("no equilibrium"));
    }
}
