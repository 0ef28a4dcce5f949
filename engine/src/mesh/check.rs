//! Looks for everything in a mesh that would spoil a simulation, before its first step.
//!
//! All tolerances are relative to the cells themselves, so that a body of micrometres and one of
//! kilometres are judged alike; only `implausible-size` looks at metres, and only warns.

use super::{Mesh, for_equal_cells, sorted, tetrahedron_faces};
use glam::DVec3;
use serde::Serialize;
use std::fmt;

/// Below this share of the cubed (squared) longest edge a volume (area) counts as zero.
const ZERO: f64 = 1e-12;
/// Below this share a cell counts as a sliver.
const SLIVER: f64 = 1e-6;
/// Below this quality a cell counts as poor.
const POOR: f64 = 0.05;
/// Vertices nearer than this share of their middling edge count as one place.
const SAME_PLACE: f64 = 1e-9;
/// Entities that a finding names before it only counts.
const NAMED: usize = 5;

/// What counts as an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckOptions {
    /// Inverted winding is an error instead of being repaired.
    pub strict: bool,
    /// Shortest and longest plausible extent of the body in metres; `None` for no such warning.
    pub expected_size: Option<(f64, f64)>,
}

impl Default for CheckOptions {
    fn default() -> Self {
        CheckOptions { strict: false, expected_size: Some((1e-3, 2.0)) }
    }
}

/// How much a finding matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Worth knowing.
    Info,
    /// The simulation runs, perhaps not as meant.
    Warning,
    /// The mesh cannot be simulated.
    Error,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Severity::Info => "info",
            Severity::Warning => "warning",
            Severity::Error => "error",
        })
    }
}

/// Kind of a finding; its text form (such as `zero-volume`) stays the same between versions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FindingCode {
    /// A coordinate is NaN or infinite.
    NonFiniteCoordinate,
    /// A cell uses a vertex that does not exist.
    IndexOutOfRange,
    /// A cell uses a vertex twice.
    RepeatedVertexInCell,
    /// Two used vertices lie at one place.
    DuplicateCoordinates,
    /// A tetrahedron without volume, or a triangle without area.
    ZeroVolume,
    /// A cell that is nearly flat.
    Sliver,
    /// A tetrahedron of negative volume.
    InvertedWinding,
    /// Two cells with the same vertices.
    DuplicateCell,
    /// A face of more than two tetrahedra.
    NonManifoldFace,
    /// An edge of more than two surface triangles.
    NonManifoldEdge,
    /// A vertex that no cell uses.
    UnusedVertices,
    /// Parts that share no vertex.
    SeveralComponents,
    /// Nothing to simulate.
    NoCells,
    /// A cell of low quality.
    PoorQuality,
    /// An extent that suggests a wrong unit.
    ImplausibleSize,
    /// Cells of kinds that the engine cannot use.
    SkippedCells,
}

impl fmt::Display for FindingCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            FindingCode::NonFiniteCoordinate => "non-finite-coordinate",
            FindingCode::IndexOutOfRange => "index-out-of-range",
            FindingCode::RepeatedVertexInCell => "repeated-vertex-in-cell",
            FindingCode::DuplicateCoordinates => "duplicate-coordinates",
            FindingCode::ZeroVolume => "zero-volume",
            FindingCode::Sliver => "sliver",
            FindingCode::InvertedWinding => "inverted-winding",
            FindingCode::DuplicateCell => "duplicate-cell",
            FindingCode::NonManifoldFace => "non-manifold-face",
            FindingCode::NonManifoldEdge => "non-manifold-edge",
            FindingCode::UnusedVertices => "unused-vertices",
            FindingCode::SeveralComponents => "several-components",
            FindingCode::NoCells => "no-cells",
            FindingCode::PoorQuality => "poor-quality",
            FindingCode::ImplausibleSize => "implausible-size",
            FindingCode::SkippedCells => "skipped-cells",
        })
    }
}

/// Something that the check found, once for all entities that have it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Kind of the finding.
    pub code: FindingCode,
    /// How much it matters.
    pub severity: Severity,
    /// The first few entities, such as "tetrahedron 17 (vertices 3 5 9 12)", counted from 0.
    pub entity: String,
    /// Number of entities.
    pub count: usize,
    /// What is wrong, with the offending value.
    pub message: String,
    /// What to do about it.
    pub remedy: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} [{}]: {}", self.severity, self.code, self.message)?;
        if !self.entity.is_empty() {
            write!(f, ": {}", self.entity)?;
        }
        write!(f, "; {}", self.remedy)
    }
}

/// Size and quality of a mesh. Cells are the tetrahedra, or the triangles when there are none.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MeshStatistics {
    /// Number of vertices, used or not.
    pub vertices: usize,
    /// Number of vertices that cells use.
    pub used_vertices: usize,
    /// Number of tetrahedra.
    pub tetrahedra: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of parts that share no vertex.
    pub components: usize,
    /// Lowest quality of a cell, 0 (flat) to 1 (regular): 6 sqrt(2) V / l^3, or 4 A / (sqrt(3) l^2),
    /// with l the root mean square of the edge lengths; 0 without cells.
    pub worst_quality: f64,
    /// Mean quality of the cells; 0 without cells.
    pub mean_quality: f64,
    /// Sum of the volumes of the tetrahedra after repair (m^3).
    pub total_volume: f64,
    /// Smallest and largest corner (m) of the box around the used vertices.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Smallest altitude of a cell (m); 0 without cells.
    pub smallest_altitude: f64,
}

/// Everything that the check found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CheckReport {
    /// Name of the mesh.
    pub source: String,
    /// The findings, errors first.
    pub findings: Vec<Finding>,
    /// Size and quality, over all cells that could be measured.
    pub statistics: MeshStatistics,
}

impl CheckReport {
    /// Whether the mesh cannot be simulated.
    pub fn has_errors(&self) -> bool {
        self.errors().next().is_some()
    }

    /// The findings that are errors.
    pub fn errors(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|finding| finding.severity == Severity::Error)
    }

    /// The first finding of a kind.
    pub fn finding(&self, code: FindingCode) -> Option<&Finding> {
        self.findings.iter().find(|finding| finding.code == code)
    }
}

impl fmt::Display for CheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let s = &self.statistics;
        write!(
            f,
            "{}: {} vertices, {} tetrahedra, {} triangles, worst quality {:.3}",
            self.source, s.vertices, s.tetrahedra, s.triangles, s.worst_quality
        )?;
        self.findings.iter().try_for_each(|finding| write!(f, "\n  {finding}"))
    }
}

/// A mesh that can be simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedMesh {
    /// The mesh, every tetrahedron of positive volume.
    pub mesh: Mesh,
    /// What was found, without errors.
    pub report: CheckReport,
    /// Indices of the vertices that a tetrahedron uses, or a triangle in a mesh without tetrahedra;
    /// sorted.
    pub used_vertices: Vec<u32>,
}

/// A mesh that cannot be simulated; the message lists every error.
#[derive(Clone, Debug)]
pub struct CheckError {
    /// Everything that was found, also warnings.
    pub report: Box<CheckReport>,
}

impl fmt::Display for CheckError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: the mesh cannot be simulated", self.report.source)?;
        self.report.errors().try_for_each(|finding| write!(f, "\n  {finding}"))
    }
}

impl std::error::Error for CheckError {}

/// Entities that share a finding: all counted, the first few named.
#[derive(Default)]
struct Tally {
    count: usize,
    named: Vec<String>,
}

impl Tally {
    fn add(&mut self, name: impl FnOnce() -> String) {
        self.count += 1;
        if self.named.len() < NAMED {
            self.named.push(name());
        }
    }
}

struct Findings(Vec<Finding>);

impl Findings {
    fn push(
        &mut self,
        code: FindingCode,
        severity: Severity,
        tally: Tally,
        message: impl FnOnce(usize) -> String,
        remedy: &str,
    ) {
        if tally.count == 0 {
            return;
        }
        let mut entity = tally.named.join(", ");
        if tally.count > tally.named.len() && !tally.named.is_empty() {
            entity.push_str(&format!(" and {} more", tally.count - tally.named.len()));
        }
        let (count, message, remedy) = (tally.count, message(tally.count), remedy.to_owned());
        self.0.push(Finding { code, severity, entity, count, message, remedy });
    }
}

fn cell_name(kind: &str, index: usize, vertices: &[u32], lines: &[u32]) -> String {
    let list: Vec<String> = vertices.iter().map(u32::to_string).collect();
    let line = lines.get(index).map_or(String::new(), |line| format!("; line {line}"));
    format!("{kind} {index} (vertices {}{line})", list.join(" "))
}

fn vertex_name(index: u32, mesh: &Mesh) -> String {
    let line = mesh.lines.points.get(index as usize);
    line.map_or(format!("vertex {index}"), |line| format!("vertex {index} (line {line})"))
}

/// Shape of a cell, as pure numbers and one length.
struct Shape {
    /// Volume over cubed longest edge, or area over its square; signed for tetrahedra.
    relative: f64,
    quality: f64,
    altitude: f64,
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
    let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    Shape {
        relative: ratio(volume, longest.powi(3)),
        quality: ratio(6.0 * 2f64.sqrt() * volume.abs(), rms.powi(3)),
        altitude: scale * ratio(3.0 * volume.abs(), area),
    }
}

fn triangle_shape([a, b, c]: [DVec3; 3]) -> Shape {
    let mut edges = [b - a, c - a, c - b];
    let scale = unit(&mut edges);
    let (rms, longest) = lengths(edges);
    let area = edges[0].cross(edges[1]).length() / 2.0;
    let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    Shape {
        relative: ratio(area, longest.powi(2)),
        quality: ratio(4.0 / 3f64.sqrt() * area, rms.powi(2)),
        altitude: scale * ratio(2.0 * area, longest),
    }
}

/// Checks a mesh and turns inverted tetrahedra round.
///
/// # Errors
///
/// [`CheckError`] with the whole report when a finding is an error.
pub fn check(mesh: &Mesh, options: &CheckOptions) -> Result<CheckedMesh, CheckError> {
    let mut mesh = mesh.clone();
    let mut found = Findings(Vec::new());
    let mut statistics = MeshStatistics {
        vertices: mesh.points.len(),
        tetrahedra: mesh.tetrahedra.len(),
        triangles: mesh.triangles.len(),
        ..MeshStatistics::default()
    };
    let solid = !mesh.tetrahedra.is_empty();

    no_cells(&mesh, &mut found);
    // Everything after this looks only at cells whose indices can be followed.
    let tets_ok =
        indices(&mesh, &mesh.tetrahedra, "tetrahedron", &mesh.lines.tetrahedra, &mut found);
    let triangles_ok =
        indices(&mesh, &mesh.triangles, "triangle", &mesh.lines.triangles, &mut found);

    let n = mesh.points.len();
    let mut used = vec![false; n];
    let mut mark = |cell: &[u32]| cell.iter().for_each(|&v| used[v as usize] = true);
    if solid {
        sound(&mesh.tetrahedra, &tets_ok).for_each(|(_, cell)| mark(cell));
    } else {
        sound(&mesh.triangles, &triangles_ok).for_each(|(_, cell)| mark(cell));
    }
    let used_vertices: Vec<u32> = (0..n as u32).filter(|&v| used[v as usize]).collect();
    statistics.used_vertices = used_vertices.len();

    let mut tally = Tally::default();
    for &v in &used_vertices {
        let point = mesh.points[v as usize];
        if !point.is_finite() {
            tally.add(|| format!("{} at {point}", vertex_name(v, &mesh)));
        }
    }
    found.push(
        FindingCode::NonFiniteCoordinate,
        Severity::Error,
        tally,
        |count| format!("{count} vertices have a coordinate that is not a finite number"),
        "correct the coordinates",
    );

    shapes(&mut mesh, &tets_ok, &triangles_ok, options, &mut statistics, &mut found);
    duplicate_coordinates(&mesh, &tets_ok, &triangles_ok, &used_vertices, &mut found);
    duplicate_cells(&mesh, &tets_ok, &triangles_ok, &mut found);
    manifold(&mesh, &tets_ok, &triangles_ok, &mut found);
    components(&mesh, &tets_ok, &triangles_ok, &used_vertices, &mut statistics, &mut found);
    unused(&mesh, &used, &mut found);
    size(&mesh, &used_vertices, options, &mut statistics, &mut found);
    skipped(&mesh, &mut found);

    statistics.total_volume = sound(&mesh.tetrahedra, &tets_ok)
        .filter_map(|(_, &tet)| mesh.signed_volume(tet))
        .filter(|volume| volume.is_finite())
        .sum();
    let mut findings = found.0;
    // Stable, so that equal severities keep the order of the checks.
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    let report = CheckReport { source: mesh.source.clone(), findings, statistics };
    if report.has_errors() {
        Err(CheckError { report: Box::new(report) })
    } else {
        Ok(CheckedMesh { mesh, report, used_vertices })
    }
}

/// The cells that passed the check of their indices.
fn sound<'a, const N: usize>(
    cells: &'a [[u32; N]],
    ok: &'a [bool],
) -> impl Iterator<Item = (usize, &'a [u32; N])> {
    cells.iter().enumerate().zip(ok).filter_map(|(cell, &ok)| ok.then_some(cell))
}

fn no_cells(mesh: &Mesh, found: &mut Findings) {
    if mesh.tetrahedra.is_empty() && mesh.triangles.is_empty() {
        let kinds: Vec<&str> = mesh.skipped.iter().map(|s| s.kind.as_str()).collect();
        let tally = Tally { count: 1, named: Vec::new() };
        found.push(
            FindingCode::NoCells,
            Severity::Error,
            tally,
            |_| match kinds.as_slice() {
                [] => "the mesh has no tetrahedra and no triangles".to_owned(),
                kinds => {
                    format!("the mesh has only cells that cannot be used: {}", kinds.join(", "))
                }
            },
            "mesh the body with linear tetrahedra or triangles",
        );
    }
}

/// Which cells have three or four different vertices that exist.
fn indices<const N: usize>(
    mesh: &Mesh,
    cells: &[[u32; N]],
    kind: &str,
    lines: &[u32],
    found: &mut Findings,
) -> Vec<bool> {
    let n = mesh.points.len();
    let (mut outside, mut repeated) = (Tally::default(), Tally::default());
    let mut ok = Vec::with_capacity(cells.len());
    for (i, cell) in cells.iter().enumerate() {
        let inside = cell.iter().all(|&v| (v as usize) < n);
        let distinct = sorted(*cell).windows(2).all(|pair| pair[0] != pair[1]);
        if !inside {
            outside.add(|| cell_name(kind, i, cell, lines));
        } else if !distinct {
            repeated.add(|| cell_name(kind, i, cell, lines));
        }
        ok.push(inside && distinct);
    }
    found.push(
        FindingCode::IndexOutOfRange,
        Severity::Error,
        outside,
        |count| {
            format!("{count} cells use a vertex that does not exist (the mesh has {n} vertices)")
        },
        "check whether vertices are counted from 0 or 1",
    );
    found.push(
        FindingCode::RepeatedVertexInCell,
        Severity::Error,
        repeated,
        |count| format!("{count} cells use the same vertex twice"),
        "remove these cells",
    );
    ok
}

fn shapes(
    mesh: &mut Mesh,
    tets_ok: &[bool],
    triangles_ok: &[bool],
    options: &CheckOptions,
    statistics: &mut MeshStatistics,
    found: &mut Findings,
) {
    let solid = !mesh.tetrahedra.is_empty();
    let (mut zero, mut sliver, mut poor, mut inverted) =
        (Tally::default(), Tally::default(), Tally::default(), Tally::default());
    let (mut worst, mut sum, mut altitude, mut n) = (f64::INFINITY, 0.0, f64::INFINITY, 0usize);
    let mut judge = |shape: &Shape, name: &dyn Fn() -> String| {
        let relative = shape.relative.abs();
        // Written so that NaN, which comes from non-finite coordinates, is left to its own finding.
        if relative.is_nan() {
            return;
        }
        if relative < ZERO {
            zero.add(|| format!("{}: {relative:.1e}", name()));
        } else if relative < SLIVER {
            sliver.add(|| format!("{}: {relative:.1e}, quality {:.1e}", name(), shape.quality));
        }
        if shape.quality < POOR && relative >= ZERO {
            poor.add(|| format!("{}: {:.1e}", name(), shape.quality));
        }
        worst = worst.min(shape.quality);
        altitude = altitude.min(shape.altitude);
        sum += shape.quality;
        n += 1;
    };
    let p = |v: u32| mesh.points[v as usize];
    let mut turn = Vec::new();
    if solid {
        for (i, tet) in sound(&mesh.tetrahedra, tets_ok) {
            let shape = tetrahedron_shape(tet.map(p));
            let name = || cell_name("tetrahedron", i, tet, &mesh.lines.tetrahedra);
            judge(&shape, &name);
            if shape.relative <= -ZERO {
                inverted.add(name);
                turn.push(i);
            }
        }
    } else {
        for (i, triangle) in sound(&mesh.triangles, triangles_ok) {
            let shape = triangle_shape(triangle.map(p));
            judge(&shape, &|| cell_name("triangle", i, triangle, &mesh.lines.triangles));
        }
    }
    if n > 0 {
        statistics.worst_quality = worst;
        statistics.mean_quality = sum / n as f64;
        statistics.smallest_altitude = altitude;
    }
    let measure = if solid { "volume / longest edge^3" } else { "area / longest edge^2" };
    found.push(
        FindingCode::ZeroVolume,
        Severity::Error,
        zero,
        |count| format!("{count} cells are flat ({measure} below {ZERO:.0e})"),
        "remove these cells or mesh the body again",
    );
    found.push(
        FindingCode::Sliver,
        Severity::Warning,
        sliver,
        |count| format!("{count} cells are nearly flat ({measure} below {SLIVER:.0e})"),
        "improve the mesh, or expect small steps and poor accuracy there",
    );
    let (severity, remedy) = if options.strict {
        (Severity::Error, "exchange two vertices of each, or check without `strict`")
    } else {
        (Severity::Warning, "repaired by exchanging the last two vertices; nothing to do")
    };
    found.push(
        FindingCode::InvertedWinding,
        severity,
        inverted,
        |count| format!("{count} tetrahedra have a negative volume"),
        remedy,
    );
    found.push(
        FindingCode::PoorQuality,
        Severity::Warning,
        poor,
        |count| format!("{count} cells have a quality below {POOR} (regular cells have 1)"),
        "improve the mesh where accuracy matters",
    );
    if !options.strict {
        for i in turn {
            mesh.tetrahedra[i].swap(2, 3);
        }
    }
}

/// Calls `visit` with both ends of every edge of the cells, more than once where cells share it.
fn for_edges(
    mesh: &Mesh,
    tets_ok: &[bool],
    triangles_ok: &[bool],
    mut visit: impl FnMut(u32, u32),
) {
    if mesh.tetrahedra.is_empty() {
        for (_, &[a, b, c]) in sound(&mesh.triangles, triangles_ok) {
            [(a, b), (b, c), (c, a)].into_iter().for_each(|(i, j)| visit(i, j));
        }
    } else {
        for (_, &[a, b, c, d]) in sound(&mesh.tetrahedra, tets_ok) {
            let edges = [(a, b), (a, c), (a, d), (b, c), (b, d), (c, d)];
            edges.into_iter().for_each(|(i, j)| visit(i, j));
        }
    }
}

/// Median length of the edges at each vertex; a few edges to a stray vertex do not change it.
fn local_lengths(mesh: &Mesh, tets_ok: &[bool], triangles_ok: &[bool]) -> Vec<f64> {
    let n = mesh.points.len();
    let mut end = vec![0usize; n + 1];
    for_edges(mesh, tets_ok, triangles_ok, |i, j| {
        end[i as usize + 1] += 1;
        end[j as usize + 1] += 1;
    });
    for v in 0..n {
        end[v + 1] += end[v];
    }
    let mut next = end.clone();
    let mut lengths = vec![0.0f64; end[n]];
    for_edges(mesh, tets_ok, triangles_ok, |i, j| {
        let length = (mesh.points[i as usize] - mesh.points[j as usize]).length();
        for v in [i as usize, j as usize] {
            lengths[next[v]] = length;
            next[v] += 1;
        }
    });
    let median = |v: usize| {
        let list = &mut lengths[end[v]..end[v + 1]];
        let middle = list.len() / 2;
        if list.is_empty() { 0.0 } else { *list.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    (0..n).map(median).collect()
}

fn duplicate_coordinates(
    mesh: &Mesh,
    tets_ok: &[bool],
    triangles_ok: &[bool],
    used: &[u32],
    found: &mut Findings,
) {
    let p = |v: u32| mesh.points[v as usize];
    let local = local_lengths(mesh, tets_ok, triangles_ok);
    let mut pairs_in_cells = Tally::default();
    let near = |i: u32, j: u32| {
        let reach = local[i as usize].min(local[j as usize]);
        (p(i) - p(j)).length() <= SAME_PLACE * reach
    };
    let mut joined = std::collections::HashSet::new();
    for_edges(mesh, tets_ok, triangles_ok, |i, j| {
        if near(i, j) && joined.insert((i.min(j), i.max(j))) {
            pairs_in_cells.add(|| format!("vertices {i} and {j}"));
        }
    });
    // Vertices in different cells: the nearest other vertex within reach, by a tree of boxes.
    let mut order: Vec<u32> = used.iter().copied().filter(|&v| p(v).is_finite()).collect();
    let mut axes = vec![0u8; order.len()];
    build_tree(&mesh.points, &mut order, &mut axes);
    let mut seams = Tally::default();
    for &v in used.iter().filter(|&&v| p(v).is_finite()) {
        let accept = |other: u32| {
            let pair = (v.min(other), v.max(other));
            other != v && near(v, other) && !joined.contains(&pair)
        };
        let reach = SAME_PLACE * local[v as usize];
        if let Some(other) = search_tree(&mesh.points, &order, &axes, p(v), reach, &accept)
            && v > other
        {
            seams.add(|| format!("vertices {other} and {v}"));
        }
    }
    found.push(
        FindingCode::DuplicateCoordinates,
        Severity::Error,
        pairs_in_cells,
        |count| format!("{count} pairs of vertices of one cell lie at the same place"),
        "merge the vertices and remove the flat cells",
    );
    found.push(
        FindingCode::DuplicateCoordinates,
        Severity::Warning,
        seams,
        |count| format!("{count} vertices lie where another one lies, but in other cells"),
        "merge them unless the body is meant to be cut open there",
    );
}

/// Orders points as a balanced tree: the middle of each slice splits the rest along its widest axis.
fn build_tree(points: &[DVec3], order: &mut [u32], axes: &mut [u8]) {
    if order.len() < 2 {
        return;
    }
    let at = |v: u32| points[v as usize];
    let first = at(order[0]);
    let (low, high) =
        order.iter().fold((first, first), |(low, high), &v| (low.min(at(v)), high.max(at(v))));
    let axis = (high - low).max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(&b))
    });
    axes[middle] = axis as u8;
    let (left, right) = order.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    build_tree(points, left, left_axes);
    build_tree(points, &mut right[1..], &mut right_axes[1..]);
}

/// Any accepted vertex within `reach` of `point` along each axis.
fn search_tree(
    points: &[DVec3],
    order: &[u32],
    axes: &[u8],
    point: DVec3,
    reach: f64,
    accept: &dyn Fn(u32) -> bool,
) -> Option<u32> {
    if order.is_empty() {
        return None;
    }
    let middle = order.len() / 2;
    let here = order[middle];
    if accept(here) {
        return Some(here);
    }
    let axis = axes[middle] as usize;
    let away = point[axis] - points[here as usize][axis];
    let left = || search_tree(points, &order[..middle], &axes[..middle], point, reach, accept);
    let right =
        || search_tree(points, &order[middle + 1..], &axes[middle + 1..], point, reach, accept);
    let found = if away <= reach { left() } else { None };
    if found.is_none() && away >= -reach { right() } else { found }
}

fn duplicate_cells(mesh: &Mesh, tets_ok: &[bool], triangles_ok: &[bool], found: &mut Findings) {
    fn repeats<const N: usize>(mesh: &Mesh, cells: &[[u32; N]], ok: &[bool], kind: &str) -> Tally {
        let (at, list): (Vec<usize>, Vec<[u32; N]>) = sound(cells, ok).unzip_copied();
        let mut tally = Tally::default();
        for_equal_cells(&list, mesh.points.len(), |equal| {
            if let [first, others @ ..] = equal {
                for other in others {
                    tally.add(|| {
                        let name = cell_name(kind, at[other.1 as usize], &other.0, &[]);
                        format!("{name} repeats {kind} {}", at[first.1 as usize])
                    });
                }
            }
        });
        tally
    }
    let remedy = "remove the repeated cells";
    let message = |count| format!("{count} cells have the same vertices as another one");
    let tally = repeats(mesh, &mesh.tetrahedra, tets_ok, "tetrahedron");
    found.push(FindingCode::DuplicateCell, Severity::Error, tally, message, remedy);
    // Beside tetrahedra, triangles only mark the surface, and a repeated one does no harm.
    let solid = !mesh.tetrahedra.is_empty();
    let severity = if solid { Severity::Warning } else { Severity::Error };
    let tally = repeats(mesh, &mesh.triangles, triangles_ok, "triangle");
    found.push(FindingCode::DuplicateCell, severity, tally, message, remedy);
}

trait UnzipCopied<const N: usize> {
    fn unzip_copied(self) -> (Vec<usize>, Vec<[u32; N]>);
}

impl<'a, const N: usize, I: Iterator<Item = (usize, &'a [u32; N])>> UnzipCopied<N> for I {
    fn unzip_copied(self) -> (Vec<usize>, Vec<[u32; N]>) {
        self.map(|(i, cell)| (i, *cell)).unzip()
    }
}

fn manifold(mesh: &Mesh, tets_ok: &[bool], triangles_ok: &[bool], found: &mut Findings) {
    let n = mesh.points.len();
    let solid = !mesh.tetrahedra.is_empty();
    let mut surface: Vec<[u32; 3]> = Vec::new();
    if solid {
        let faces: Vec<[u32; 3]> =
            sound(&mesh.tetrahedra, tets_ok).flat_map(|(_, &tet)| tetrahedron_faces(tet)).collect();
        let mut tally = Tally::default();
        for_equal_cells(&faces, n, |equal| match equal {
            [(face, _)] => surface.push(*face),
            [_, _] => {}
            [(face, _), ..] => {
                tally.add(|| cell_name("face", 0, face, &[]).replace("face 0", "face"));
            }
            [] => {}
        });
        found.push(
            FindingCode::NonManifoldFace,
            Severity::Error,
            tally,
            |count| format!("{count} faces belong to more than two tetrahedra"),
            "remove the tetrahedra that overlap others",
        );
    } else {
        surface.extend(sound(&mesh.triangles, triangles_ok).map(|(_, triangle)| *triangle));
    }
    let edges: Vec<[u32; 2]> =
        surface.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    let mut tally = Tally::default();
    for_equal_cells(&edges, n, |equal| {
        if let [([a, b], _), _, _, ..] = equal {
            tally.add(|| format!("edge (vertices {a} {b})"));
        }
    });
    found.push(
        FindingCode::NonManifoldEdge,
        Severity::Warning,
        tally,
        |count| format!("{count} edges of the surface belong to more than two triangles"),
        "parts that meet only along an edge turn about it like a hinge; join them by a face if they should not",
    );
}

fn components(
    mesh: &Mesh,
    tets_ok: &[bool],
    triangles_ok: &[bool],
    used: &[u32],
    statistics: &mut MeshStatistics,
    found: &mut Findings,
) {
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            let up = parent[parent[v as usize] as usize];
            parent[v as usize] = up;
            v = up;
        }
        v
    }
    let mut parent: Vec<u32> = (0..mesh.points.len() as u32).collect();
    for_edges(mesh, tets_ok, triangles_ok, |i, j| {
        let (a, b) = (root(&mut parent, i), root(&mut parent, j));
        // The smaller index is the root: the part is named by its first vertex.
        parent[a.max(b) as usize] = a.min(b);
    });
    let mut tally = Tally::default();
    for &v in used {
        if root(&mut parent, v) == v {
            tally.add(|| format!("part of vertex {v}"));
        }
    }
    statistics.components = tally.count;
    if tally.count > 1 {
        found.push(
            FindingCode::SeveralComponents,
            Severity::Warning,
            tally,
            |count| format!("the mesh falls into {count} parts that share no vertex"),
            "merge vertices at the seams unless the parts should move freely",
        );
    }
}

fn unused(mesh: &Mesh, used: &[bool], found: &mut Findings) {
    let mut tally = Tally::default();
    for v in (0..mesh.points.len() as u32).filter(|&v| !used[v as usize]) {
        tally.add(|| vertex_name(v, mesh));
    }
    found.push(
        FindingCode::UnusedVertices,
        Severity::Info,
        tally,
        |count| format!("{count} vertices belong to no cell and are left out"),
        "nothing to do",
    );
}

fn size(
    mesh: &Mesh,
    used: &[u32],
    options: &CheckOptions,
    statistics: &mut MeshStatistics,
    found: &mut Findings,
) {
    let mut points = used.iter().map(|&v| mesh.points[v as usize]).filter(|p| p.is_finite());
    let Some(first) = points.next() else { return };
    let (low, high) = points.fold((first, first), |(low, high), p| (low.min(p), high.max(p)));
    statistics.bounds = Some([low.to_array(), high.to_array()]);
    let extent = (high - low).max_element();
    let Some((shortest, longest)) = options.expected_size else { return };
    if extent >= shortest && extent <= longest {
        return;
    }
    // The commonest slips first: a file in millimetres, then one in centimetres.
    let hint =
        [("millimetres", 0.001), ("centimetres", 0.01), ("micrometres", 1e-6), ("kilometres", 1e3)]
            .iter()
            .find(|(_, scale)| extent * scale >= shortest && extent * scale <= longest)
            .map_or(String::from("check the unit of the file"), |(unit, scale)| {
                format!("if it is in {unit}, scale by {scale}")
            });
    found.push(
        FindingCode::ImplausibleSize,
        Severity::Warning,
        Tally { count: 1, named: Vec::new() },
        |_| format!("this mesh is {extent:.3e} m long (expected {shortest} m to {longest} m)"),
        &hint,
    );
}

fn skipped(mesh: &Mesh, found: &mut Findings) {
    let list: Vec<String> =
        mesh.skipped.iter().map(|s| format!("{} x {}", s.count, s.kind)).collect();
    let list = list.join(", ");
    // Points and lines are left over from the geometry; other cells hold material.
    let minor = |kind: &str| kind.contains("point") || kind.contains("line");
    let severity = if mesh.skipped.iter().all(|s| minor(&s.kind)) {
        Severity::Info
    } else {
        Severity::Warning
    };
    let count = mesh.skipped.iter().fold(0usize, |sum, s| sum.saturating_add(s.count));
    found.push(
        FindingCode::SkippedCells,
        severity,
        Tally { count, named: Vec::new() },
        |count| format!("{count} cells are of kinds that the engine does not use: {list}"),
        "mesh these parts with linear tetrahedra or triangles if they should take part",
    );
}
