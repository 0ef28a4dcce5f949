//! Deformed bodies as plain SVG: the edges of the surface that the viewer sees, and fibres on it.

use super::prelude::*;
use glam::{DMat3, DVec2};
use sinew_tune::table::escape;
use std::fmt::Write;

/// A body as it is drawn.
pub(crate) struct Panel<'a> {
    /// What it is.
    pub title: String,
    /// Its mesh at rest.
    pub mesh: &'a Mesh,
    /// Where its vertices are (m).
    pub points: Vec<DVec3>,
    /// Direction of the fibres at rest in every solid element, or one for all; none without.
    pub fibres: Vec<DVec3>,
}

/// Directions (rad) from which bodies are seen: round the vertical, and from above.
const VIEW: [f64; 2] = [0.45, 0.2];
/// Width and height (pixels) of a panel, and the height of its title.
const PANEL: [f64; 2] = [170.0, 270.0];
const TITLE: f64 = 40.0;
/// Length of a drawn fibre over the square root of the area of its face.
const FIBRE: f64 = 0.9;

/// Right, up and towards the viewer.
fn view() -> [DVec3; 3] {
    let ((sin, cos), (up, flat)) = (VIEW[0].sin_cos(), VIEW[1].sin_cos());
    let (right, viewer) = (DVec3::new(cos, sin, 0.0), DVec3::new(sin * flat, -cos * flat, up));
    [right, viewer.cross(right), viewer]
}

/// Deformation gradient of an element, of a hexahedron that of its mean edges.
fn gradient(nodes: &[u32], rest: &[DVec3], points: &[DVec3]) -> DMat3 {
    let edges = |x: &[DVec3]| {
        let at = |i: usize| x[nodes[i] as usize];
        let mean = |from: [usize; 4], to: [usize; 4]| {
            (0..4).map(|i| at(to[i]) - at(from[i])).sum::<DVec3>() / 4.0
        };
        match nodes.len() {
            4 => DMat3::from_cols(at(1) - at(0), at(2) - at(0), at(3) - at(0)),
            _ => DMat3::from_cols(
                mean([0, 3, 4, 7], [1, 2, 5, 6]),
                mean([0, 1, 4, 5], [3, 2, 7, 6]),
                mean([0, 1, 2, 3], [4, 5, 6, 7]),
            ),
        }
    };
    edges(points) * edges(rest).inverse()
}

/// A face that the viewer sees: its corners in the plane of the picture, its depth and how far it turns towards the
/// viewer (0 to 1), and the ends of its fibre.
struct Face {
    corners: Vec<DVec2>,
    depth: f64,
    light: f64,
    fibre: Option<[DVec2; 2]>,
}

impl Panel<'_> {
    /// Faces that the viewer sees, the farthest first.
    fn faces(&self) -> Vec<Face> {
        let [right, up, viewer] = view();
        let flat = |x: DVec3| DVec2::new(x.dot(right), x.dot(up));
        let surface = self.mesh.surface();
        let triangles = surface.triangles.iter().map(|t| &t[..]);
        let solid = self.mesh.tetrahedra.iter().map(|t| &t[..]);
        let solid: Vec<&[u32]> = solid.chain(self.mesh.hexahedra.iter().map(|h| &h[..])).collect();
        let face = |nodes: &[u32]| {
            let x: Vec<DVec3> = nodes.iter().map(|&v| self.points[v as usize]).collect();
            let last = x.len() - 1;
            let normal = 0.5 * (x[2] - x[0]).cross(x[last] - x[1]);
            // of a triangle both factors share the last corner
            let normal = if last == 2 { 0.5 * (x[1] - x[0]).cross(x[2] - x[0]) } else { normal };
            let middle = x.iter().sum::<DVec3>() / x.len() as f64;
            let light = normal.normalize_or_zero().dot(viewer);
            let owner = || solid.iter().position(|e| nodes.iter().all(|v| e.contains(v)));
            let element = if self.fibres.is_empty() { None } else { owner() };
            let fibre = element.map(|element| {
                let along = self.fibres[if self.fibres.len() == 1 { 0 } else { element }];
                let f = gradient(solid[element], &self.mesh.points, &self.points);
                let half = 0.5 * FIBRE * normal.length().sqrt() * (f * along).normalize_or_zero();
                [flat(middle - half), flat(middle + half)]
            });
            let corners = x.into_iter().map(flat).collect();
            Face { corners, depth: middle.dot(viewer), light, fibre }
        };
        let all = triangles.chain(surface.quads.iter().map(|q| &q[..]));
        let mut faces: Vec<Face> = all.map(face).filter(|face| face.light > 0.0).collect();
        faces.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        faces
    }
}

/// Bodies side by side, `columns` in a row, all to one scale and with the tops of their boxes at one height.
pub(crate) fn bodies(name: &str, title: &str, panels: &[Panel], columns: usize) -> Chart {
    let drawn: Vec<Vec<Face>> = panels.iter().map(Panel::faces).collect();
    let bounds = |faces: &[Face]| {
        let corners = || faces.iter().flat_map(|f| &f.corners);
        let low = corners().fold(DVec2::INFINITY, |a, b| a.min(*b));
        (low, corners().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b)))
    };
    let sizes = drawn.iter().map(|faces| bounds(faces)).map(|(low, high)| high - low);
    let largest = sizes.fold(DVec2::splat(f64::MIN_POSITIVE), DVec2::max);
    let scale = ((PANEL[0] - 20.0) / largest.x).min((PANEL[1] - TITLE - 10.0) / largest.y);
    let rows = panels.len().div_ceil(columns);
    let (width, height) = (PANEL[0] * columns as f64, 30.0 + PANEL[1] * rows as f64);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" font-family=\"sans-serif\" stroke-linejoin=\"round\">\n<rect width=\"{width}\" \
         height=\"{height}\" fill=\"#fff\"/>\n<text x=\"12\" y=\"20\" font-size=\"15\">{}</text>\n",
        escape(title)
    );
    for (i, (panel, faces)) in panels.iter().zip(&drawn).enumerate() {
        let (low, high) = bounds(faces);
        let left = PANEL[0] * (i % columns) as f64;
        let top = 30.0 + PANEL[1] * (i / columns) as f64;
        let place = |p: DVec2| {
            let x = left + 0.5 * PANEL[0] + scale * (p.x - 0.5 * (low.x + high.x));
            [x, top + TITLE + scale * (high.y - p.y)].map(|x| (x * 100.0).round() / 100.0)
        };
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" font-size=\"12\" text-anchor=\"middle\">{}</text>",
            left + 0.5 * PANEL[0],
            top + 20.0,
            escape(&panel.title)
        );
        for face in faces {
            let corners: Vec<String> =
                face.corners.iter().map(|p| place(*p)).map(|[x, y]| format!("{x},{y}")).collect();
            let grey = (205.0 + 45.0 * face.light) as u8;
            let _ = writeln!(
                svg,
                "<polygon points=\"{}\" fill=\"rgb({grey},{grey},{grey})\" stroke=\"#667\" stroke-width=\"0.6\"/>",
                corners.join(" ")
            );
            if let Some([[x1, y1], [x2, y2]]) = face.fibre.map(|ends| ends.map(place)) {
                let _ = writeln!(
                    svg,
                    "<line x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\" stroke=\"#d55e00\" stroke-width=\"1.4\"/>"
                );
            }
        }
    }
    Chart { name: name.into(), svg: svg + "</svg>\n" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sinew::engine::mesh::generate::{box_hexahedra, box_tets};

    #[test]
    fn a_box_shows_three_of_its_sides_and_fibres_turn_with_it() {
        let size = DVec3::new(0.1, 0.1, 0.2);
        for (mesh, faces) in [
            (box_hexahedra(size, [2, 2, 4]).unwrap(), 8 + 8 + 4),
            (box_tets(size, [2, 2, 4]).unwrap(), 40),
        ] {
            let turned = |x: &DVec3| DVec3::new(x.z, x.y, -x.x);
            let points = mesh.points.iter().map(turned).collect();
            let along = DVec3::Z;
            let panel = Panel { title: "a < b".into(), mesh: &mesh, points, fibres: vec![along] };
            let seen = panel.faces();
            assert_eq!(seen.len(), faces);
            let [right, up, _] = view();
            let expected = DVec2::new(DVec3::X.dot(right), DVec3::X.dot(up)).normalize();
            for [from, to] in seen.iter().filter_map(|face| face.fibre) {
                assert!(((to - from).normalize() - expected).length() < 1e-12);
            }
            let svg = bodies("a", "b", &[panel], 2).svg;
            assert_eq!(svg.matches("<polygon").count(), faces);
            assert_eq!(svg.matches("<line").count(), faces);
            assert!(svg.contains("a &lt; b") && !svg.contains("NaN"));
        }
    }
}
