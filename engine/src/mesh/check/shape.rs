//! Shapes of single cells: flat, folded, warped, inverted or of poor quality.

use super::{
    CheckOptions, FindingCode, Findings, MeshStatistics, Severity, Sound, Tally, cell_name,
};
use crate::element_kind::ElementKind;
use crate::isoparametric::{HEXAHEDRON_FACES, folded_tetrahedron};
use crate::mesh::Mesh;
use crate::mesh::cell::{
    HEXAHEDRON_EDGES, corner_jacobian, determinant, gauss_determinants, mirrored_hexahedron,
    mirrored_middles,
};
use glam::DVec3;

/// Below this share of the cubed (squared) longest edge a volume (area) counts as zero, and so does a
/// determinant below this share of the edges that span it.
const ZERO: f64 = 1e-12;
/// Below this share a cell counts as a sliver.
const SLIVER: f64 = 1e-6;
/// Below this quality a cell counts as poor.
const POOR: f64 = 0.05;
/// Above this angle (degrees) between its halves a quadrilateral counts as warped.
const WARPED: f64 = 15.0;

/// Shape of a cell, as pure numbers and one length.
struct Shape {
    /// Volume over cubed longest edge, or area over its square; signed for volumes.
    relative: f64,
    quality: f64,
    altitude: f64,
    /// Where a hexahedron or quadrilateral is folded, if it is.
    folded: Option<String>,
    /// Largest angle between the halves of a quadrilateral (degrees).
    warp: f64,
}

/// The quotient, or 0 where it does not exist.
fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

/// A measure over its scale; NaN where a coordinate is not finite, so that its own finding names it.
fn relative(measure: f64, scale: f64) -> f64 {
    if measure.is_finite() { ratio(measure, scale) } else { f64::NAN }
}

/// Root mean square of edge lengths, and the longest one.
fn lengths<const N: usize>(edges: [DVec3; N]) -> (f64, f64) {
    let longest = edges.iter().map(|e| e.length()).fold(0.0, f64::max);
    let squares: f64 = edges.iter().map(|e| e.length_squared()).sum();
    ((squares / N as f64).sqrt(), longest)
}

/// Edges are first divided by their largest component, so that nothing overflows or vanishes.
fn unit(edges: &mut [DVec3]) -> f64 {
    let scale = edges.iter().map(|e| e.abs().max_element()).fold(0.0, f64::max);
    if scale > 0.0 {
        edges.iter_mut().for_each(|e| *e /= scale);
    }
    scale
}

fn tetrahedron_shape([a, b, c, d]: [DVec3; 4]) -> Shape {
    let mut edges = [b - a, c - a, d - a, c - b, d - b, d - c];
    let scale = unit(&mut edges);
    let [ab, ac, ad, bc, bd, _] = edges;
    let (rms, longest) = lengths(edges);
    let volume = ab.dot(ac.cross(ad)) / 6.0;
    let faces = [ab.cross(ac), ab.cross(ad), ac.cross(ad), bc.cross(bd)];
    let area = faces.iter().map(|n| n.length() / 2.0).fold(0.0, f64::max);
    Shape {
        relative: relative(volume, longest.powi(3)),
        quality: ratio(6.0 * 2f64.sqrt() * volume.abs(), rms.powi(3)),
        altitude: scale * ratio(3.0 * volume.abs(), area),
        folded: None,
        warp: 0.0,
    }
}

fn triangle_shape([a, b, c]: [DVec3; 3]) -> Shape {
    let mut edges = [b - a, c - a, c - b];
    let scale = unit(&mut edges);
    let (rms, longest) = lengths(edges);
    let area = edges[0].cross(edges[1]).length() / 2.0;
    Shape {
        relative: relative(area, longest.powi(2)),
        quality: ratio(4.0 / 3f64.sqrt() * area, rms.powi(2)),
        altitude: scale * ratio(2.0 * area, longest),
        folded: None,
        warp: 0.0,
    }
}

/// A hexahedron of negative volume is judged as its mirror image.
fn hexahedron_shape(corners: [DVec3; 8]) -> Shape {
    let mut corners = corners.map(|corner| corner - corners[0]);
    let scale = unit(&mut corners);
    let lengths =
        HEXAHEDRON_EDGES.as_flattened().iter().map(|&[i, j]| corners[j].distance(corners[i]));
    let longest = lengths.fold(0.0, f64::max);
    let gauss = gauss_determinants(&corners);
    let volume = gauss.iter().sum::<f64>() / 8.0;
    let sign = if volume < 0.0 { -1.0 } else { 1.0 };
    let mut folded = None;
    let mut quality = f64::INFINITY;
    for corner in 0..8 {
        let edges = corner_jacobian(&corners, corner);
        let spanned: f64 = edges.iter().map(|edge| edge.length()).product();
        let scaled = ratio(sign * determinant(edges), spanned);
        if scaled <= ZERO && folded.is_none() {
            folded = Some(format!("scaled Jacobian {scaled:.1e} at corner {corner}"));
        }
        quality = quality.min(scaled);
    }
    // The determinant may vanish inside though it is positive at all corners.
    if let Some(point) = gauss.iter().position(|&d| sign * d <= ZERO * longest.powi(3)) {
        folded = folded.or(Some(format!("Jacobian not positive at Gauss point {point}")));
    }
    let area = |face: &[usize; 4]| {
        let [a, b, c, d] = face.map(|corner| corners[corner]);
        (c - a).cross(d - b).length() / 2.0
    };
    let area = HEXAHEDRON_FACES.iter().map(area).fold(0.0, f64::max);
    Shape {
        relative: relative(volume, longest.powi(3)),
        quality,
        altitude: scale * ratio(volume.abs(), area),
        folded,
        warp: 0.0,
    }
}

fn quad_shape([a, b, c, d]: [DVec3; 4]) -> Shape {
    let mut edges = [b - a, c - b, d - c, a - d];
    let scale = unit(&mut edges);
    let (_, longest) = lengths(edges);
    // The vector area of the closed line, whatever surface spans it.
    let normal = (edges[0] + edges[1]).cross(edges[1] + edges[2]) / 2.0;
    let area = normal.length();
    let normal = normal.normalize_or_zero();
    let corner = |i: usize| edges[(i + 3) % 4].cross(edges[i]);
    let mut quality = f64::INFINITY;
    let mut folded = None;
    for i in 0..4 {
        let spanned = edges[(i + 3) % 4].length() * edges[i].length();
        let scaled = ratio(corner(i).dot(normal), spanned);
        if scaled <= ZERO && folded.is_none() {
            folded = Some(format!("scaled Jacobian {scaled:.1e} at corner {i}"));
        }
        quality = quality.min(scaled);
    }
    // Triangles at opposite corners are the halves on both sides of a diagonal.
    let angle = |p: DVec3, q: DVec3| p.cross(q).length().atan2(p.dot(q)).to_degrees();
    let warp = angle(corner(0), corner(2)).max(angle(corner(1), corner(3)));
    Shape {
        relative: relative(area, longest.powi(2)),
        quality,
        altitude: scale * ratio(area, longest),
        folded,
        warp,
    }
}

/// What was found about shapes, and the sums for the statistics.
#[derive(Default)]
struct Judge {
    zero: Tally,
    sliver: Tally,
    folded: Tally,
    warped: Tally,
    poor: Tally,
    worst: f64,
    sum: f64,
    altitude: f64,
    count: usize,
}

impl Judge {
    fn add(&mut self, shape: &Shape, name: &dyn Fn() -> String) {
        let relative = shape.relative.abs();
        // NaN, which comes from non-finite coordinates, is left to its own finding.
        if relative.is_nan() || shape.quality.is_nan() {
            return;
        }
        if relative < ZERO {
            self.zero.add(|| format!("{}: {relative:.1e}", name()));
        } else if relative < SLIVER {
            let quality = shape.quality;
            self.sliver.add(|| format!("{}: {relative:.1e}, quality {quality:.1e}", name()));
        }
        if relative >= ZERO {
            if let Some(place) = &shape.folded {
                self.folded.add(|| format!("{}: {place}", name()));
            } else if shape.quality < POOR {
                self.poor.add(|| format!("{}: {:.1e}", name(), shape.quality));
            }
            if shape.folded.is_none() && shape.warp > WARPED {
                self.warped.add(|| format!("{}: {:.1} degrees", name(), shape.warp));
            }
        }
        if self.count == 0 {
            (self.worst, self.altitude) = (shape.quality, shape.altitude);
        }
        self.worst = self.worst.min(shape.quality);
        self.altitude = self.altitude.min(shape.altitude);
        self.sum += shape.quality;
        self.count += 1;
    }
}

/// What the shapes of all cells come to.
struct Judged {
    judge: Judge,
    inverted: Tally,
    /// Tetrahedra and hexahedra with a negative volume.
    turn_tets: Vec<usize>,
    turn_hexes: Vec<usize>,
}

fn judge_cells(mesh: &Mesh, cells: &Sound) -> Judged {
    let mut judge = Judge::default();
    let mut inverted = Tally::default();
    let p = |v: u32| mesh.points[v as usize];
    let (mut turn_tets, mut turn_hexes) = (Vec::new(), Vec::new());
    if mesh.is_solid() {
        for (i, tet) in cells.tetrahedra(mesh) {
            let mut shape = tetrahedron_shape(tet.map(p));
            if let Some(ten) = mesh.second_order(i) {
                // of a cell that will be turned round, as it is then
                let turned = shape.relative <= -ZERO;
                let [corners @ .., c, d] = *tet;
                let tet = if turned { [corners[0], corners[1], d, c] } else { *tet };
                let ten = match turned {
                    true => super::ten(tet, mirrored_middles(mesh.middles[i])),
                    false => ten,
                };
                shape.folded =
                    folded_tetrahedron(&ten.map(|v| p(v).to_array())).map(|(place, ratio)| {
                        format!("Jacobian {ratio:.1e} times that of its corners at {place}")
                    });
            }
            let name = || cell_name(mesh, ElementKind::Tetrahedron, i, tet);
            judge.add(&shape, &name);
            if shape.relative <= -ZERO {
                inverted.add(name);
                turn_tets.push(i);
            }
        }
        for (i, hex) in cells.hexahedra(mesh) {
            let shape = hexahedron_shape(hex.map(p));
            let name = || cell_name(mesh, ElementKind::Hexahedron, i, hex);
            judge.add(&shape, &name);
            if shape.relative <= -ZERO {
                inverted.add(name);
                turn_hexes.push(i);
            }
        }
    } else {
        for (i, triangle) in cells.triangles(mesh) {
            let shape = triangle_shape(triangle.map(p));
            judge.add(&shape, &|| cell_name(mesh, ElementKind::Triangle, i, triangle));
        }
        for (i, quad) in cells.quads(mesh) {
            let shape = quad_shape(quad.map(p));
            judge.add(&shape, &|| cell_name(mesh, ElementKind::Quad, i, quad));
        }
    }
    Judged { judge, inverted, turn_tets, turn_hexes }
}

pub(super) fn shapes(
    mesh: &mut Mesh,
    cells: &Sound,
    options: &CheckOptions,
    statistics: &mut MeshStatistics,
    found: &mut Findings,
) {
    let solid = mesh.is_solid();
    let Judged { judge, inverted, turn_tets, turn_hexes } = judge_cells(mesh, cells);
    if judge.count > 0 {
        statistics.worst_quality = judge.worst;
        statistics.mean_quality = judge.sum / judge.count as f64;
        statistics.smallest_altitude = judge.altitude;
    }
    let measure = if solid { "volume / longest edge^3" } else { "area / longest edge^2" };
    found.push(
        FindingCode::ZeroVolume,
        Severity::Error,
        judge.zero,
        |count| format!("{count} cells are flat ({measure} below {ZERO:.0e})"),
        "remove these cells or mesh the body again",
    );
    found.push(
        FindingCode::NonConvexCell,
        Severity::Error,
        judge.folded,
        |count| format!("{count} cells are folded or have a corner without angle"),
        "move their vertices, or check whether these are listed in the order of Gmsh and VTK (which list the last two \
         edges of a ten-node tetrahedron differently)",
    );
    found.push(
        FindingCode::Sliver,
        Severity::Warning,
        judge.sliver,
        |count| format!("{count} cells are nearly flat ({measure} below {SLIVER:.0e})"),
        "improve the mesh, or expect small steps and poor accuracy there",
    );
    let (severity, remedy) = if options.strict {
        (
            Severity::Error,
            "exchange two vertices of each tetrahedron, bottom and top of each hexahedron, or check \
             without `strict`",
        )
    } else {
        (
            Severity::Warning,
            "repaired by exchanging the last two vertices of tetrahedra, bottom and top of hexahedra; \
             nothing to do",
        )
    };
    found.push(
        FindingCode::InvertedWinding,
        severity,
        inverted,
        |count| format!("{count} cells have a negative volume"),
        remedy,
    );
    found.push(
        FindingCode::WarpedCell,
        Severity::Warning,
        judge.warped,
        |count| {
            format!(
                "{count} quadrilaterals are bent by more than {WARPED} degrees along a diagonal"
            )
        },
        "split them into triangles where accuracy matters",
    );
    found.push(
        FindingCode::PoorQuality,
        Severity::Warning,
        judge.poor,
        |count| format!("{count} cells have a quality below {POOR} (regular cells have 1)"),
        "improve the mesh where accuracy matters",
    );
    if !options.strict {
        for i in turn_tets {
            mesh.tetrahedra[i].swap(2, 3);
            if let Some(middles) = mesh.middles.get_mut(i) {
                *middles = mirrored_middles(*middles);
            }
        }
        for i in turn_hexes {
            mesh.hexahedra[i] = mirrored_hexahedron(mesh.hexahedra[i]);
        }
    }
}
