//! Looks for everything in a mesh that would spoil a simulation, before its first step.
//!
//! All tolerances are relative to the cells themselves, so that a body of micrometres and one of
//! kilometres are judged alike; only `implausible-size` looks at metres, and only warns.

pub(in crate::mesh) mod places;
mod shape;
mod topology;

use super::cell::{edges, ten};
use super::{CellVertices, LINEAR, Mesh};
use crate::element_kind::{ByKind, ElementKind};
use serde::Serialize;
use std::fmt;

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

macro_rules! codes {
    ($($(#[$doc:meta])* $name:ident = $text:literal,)+) => {
        /// Kind of a finding; its text form (such as `zero-volume`) stays the same between versions.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
        #[non_exhaustive]
        pub enum FindingCode {
            $($(#[$doc])* #[serde(rename = $text)] $name,)+
        }

        impl fmt::Display for FindingCode {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(match self { $(Self::$name => $text,)+ })
            }
        }
    };
}
codes! {
    /// A coordinate is NaN or infinite.
    NonFiniteCoordinate = "non-finite-coordinate",
    /// A cell uses a vertex that does not exist.
    IndexOutOfRange = "index-out-of-range",
    /// A cell uses a vertex twice.
    RepeatedVertexInCell = "repeated-vertex-in-cell",
    /// Two used vertices lie at one place.
    DuplicateCoordinates = "duplicate-coordinates",
    /// A volume cell without volume, or a face cell without area.
    ZeroVolume = "zero-volume",
    /// A cell that is nearly flat.
    Sliver = "sliver",
    /// A tetrahedron or hexahedron of negative volume.
    InvertedWinding = "inverted-winding",
    /// A hexahedron, quadrilateral or curved tetrahedron that is folded somewhere: its Jacobian determinant is not
    /// positive at a vertex or at a Gauss point.
    NonConvexCell = "non-convex-cell",
    /// A quadrilateral far from flat.
    WarpedCell = "warped-cell",
    /// Two cells with the same vertices.
    DuplicateCell = "duplicate-cell",
    /// A face of more than two volume cells.
    NonManifoldFace = "non-manifold-face",
    /// A quadrilateral face of a hexahedron against triangular faces of tetrahedra.
    NonConformingFace = "non-conforming-face",
    /// An edge of more than two surface triangles or quadrilaterals.
    NonManifoldEdge = "non-manifold-edge",
    /// A vertex that no cell uses.
    UnusedVertices = "unused-vertices",
    /// Parts that share no vertex.
    SeveralComponents = "several-components",
    /// Nothing to simulate.
    NoCells = "no-cells",
    /// A cell of low quality.
    PoorQuality = "poor-quality",
    /// An extent that suggests a wrong unit.
    ImplausibleSize = "implausible-size",
    /// Cells of kinds that the engine cannot use.
    SkippedCells = "skipped-cells",
    /// Hexahedra that reach from one side of a body to the other.
    OneCellAcross = "one-cell-across",
    /// Tetrahedra of four and of ten vertices in one mesh, or hexahedra beside the latter.
    MixedOrder = "mixed-order",
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

/// Size and quality of a mesh. Cells are the tetrahedra and hexahedra, or the triangles and
/// quadrilaterals when there are none.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MeshStatistics {
    /// Number of vertices, used or not.
    pub vertices: usize,
    /// Number of vertices that cells use.
    pub used_vertices: usize,
    /// Number of tetrahedra.
    pub tetrahedra: usize,
    /// Number of hexahedra.
    pub hexahedra: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of quadrilaterals.
    pub quads: usize,
    /// Number of parts that share no vertex.
    pub components: usize,
    /// Lowest quality of a cell, 0 (flat) to 1 (regular): 6 sqrt(2) V / l^3 of a tetrahedron and
    /// 4 A / (sqrt(3) l^2) of a triangle, with l the root mean square of the edge lengths; of
    /// hexahedra and quadrilaterals the scaled Jacobian, the lowest determinant of the unit vectors
    /// along the edges at a corner, 1 for bricks and rectangles and below 0 for folded cells; 0
    /// without cells.
    pub worst_quality: f64,
    /// Mean quality of the cells; 0 without cells.
    pub mean_quality: f64,
    /// Sum of the volumes of the tetrahedra and hexahedra after repair (m^3).
    pub total_volume: f64,
    /// Smallest and largest corner (m) of the box around the used vertices.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Smallest altitude of a cell (m), of hexahedra and quadrilaterals volume over largest face and
    /// area over longest edge; 0 without cells.
    pub smallest_altitude: f64,
}

impl MeshStatistics {
    /// The numbers of cells in words: tetrahedra and triangles always, the other kinds where they are.
    pub fn cells(&self) -> String {
        let mut text = format!("{} tetrahedra", self.tetrahedra);
        if self.hexahedra > 0 {
            text.push_str(&format!(", {} hexahedra", self.hexahedra));
        }
        text.push_str(&format!(", {} triangles", self.triangles));
        if self.quads > 0 {
            text.push_str(&format!(", {} quadrilaterals", self.quads));
        }
        text
    }
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
            "{}: {} vertices, {}, worst quality {:.3}",
            self.source,
            s.vertices,
            s.cells(),
            s.worst_quality
        )?;
        self.findings.iter().try_for_each(|finding| write!(f, "\n  {finding}"))
    }
}

/// A mesh that can be simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedMesh {
    /// The mesh, every tetrahedron and hexahedron of positive volume.
    pub mesh: Mesh,
    /// What was found, without errors.
    pub report: CheckReport,
    /// Indices of the vertices that a tetrahedron or hexahedron uses, or a triangle or quadrilateral in
    /// a mesh without them; sorted.
    pub used_vertices: Vec<u32>,
}

impl CheckedMesh {
    /// Counts as used what solid elements and these faces of a membrane use: the check does not know which faces of a mesh
    /// make up a membrane.
    pub fn use_faces(&mut self, triangles: &[[u32; 3]], quads: &[[u32; 4]]) {
        let used = &mut self.used_vertices;
        *used = self.mesh.tetrahedra.as_flattened().to_vec();
        used.extend(self.mesh.middles.as_flattened());
        used.extend(self.mesh.hexahedra.as_flattened());
        used.extend(triangles.as_flattened());
        used.extend(quads.as_flattened());
        used.sort_unstable();
        used.dedup();
        let unused = self.mesh.points.len() - used.len();
        let findings = &mut self.report.findings;
        findings.retain(|f| f.code != FindingCode::UnusedVertices || unused > 0);
        for finding in findings.iter_mut().filter(|f| f.code == FindingCode::UnusedVertices) {
            (finding.count, finding.entity) = (unused, String::new());
            finding.message = format!("{unused} vertices belong to no element and are left out");
        }
    }
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

/// Name of a kind of cells in findings.
fn kind_name(kind: ElementKind) -> &'static str {
    match kind {
        ElementKind::Triangle => "triangle",
        ElementKind::Quad => "quadrilateral",
        solid => solid.name(),
    }
}

fn cell_name(mesh: &Mesh, kind: ElementKind, index: usize, vertices: &[u32]) -> String {
    let line = mesh.lines.cells[kind].get(index);
    let line = line.map_or(String::new(), |line| format!("; line {line}"));
    format!("{} {index} (vertices {}{line})", kind_name(kind), vertex_list(vertices))
}

fn vertex_list(vertices: &[u32]) -> String {
    let list: Vec<String> = vertices.iter().map(u32::to_string).collect();
    list.join(" ")
}

fn vertex_name(index: u32, mesh: &Mesh) -> String {
    let line = mesh.lines.points.get(index as usize);
    line.map_or(format!("vertex {index}"), |line| format!("vertex {index} (line {line})"))
}

/// Which cells have different vertices that all exist.
///
/// Everything but the check of the indices looks only at these.
struct Sound(ByKind<Vec<bool>>);

impl Sound {
    fn of(mesh: &Mesh, found: &mut Findings) -> Sound {
        let mut sound = ByKind::default();
        for kind in ElementKind::IN_FILES {
            sound[kind] = indices(mesh, kind, found);
        }
        Sound(sound)
    }

    fn tetrahedra<'a>(&'a self, mesh: &'a Mesh) -> impl Iterator<Item = (usize, &'a [u32; 4])> {
        sound(&mesh.tetrahedra, &self.0.tetrahedra)
    }

    fn hexahedra<'a>(&'a self, mesh: &'a Mesh) -> impl Iterator<Item = (usize, &'a [u32; 8])> {
        sound(&mesh.hexahedra, &self.0.hexahedra)
    }

    fn triangles<'a>(&'a self, mesh: &'a Mesh) -> impl Iterator<Item = (usize, &'a [u32; 3])> {
        sound(&mesh.triangles, &self.0.triangles)
    }

    fn quads<'a>(&'a self, mesh: &'a Mesh) -> impl Iterator<Item = (usize, &'a [u32; 4])> {
        sound(&mesh.quads, &self.0.quads)
    }

    /// The cells that make the body.
    fn matter<'a>(
        &'a self,
        mesh: &'a Mesh,
    ) -> impl Iterator<Item = (ElementKind, usize, CellVertices)> {
        mesh.matter().into_iter().flat_map(move |kind| {
            let cells = mesh.cells(kind).enumerate().zip(&self.0[kind]);
            cells.filter(|(_, ok)| **ok).map(move |((i, cell), _)| (kind, i, cell))
        })
    }

    /// Calls `visit` with both ends of every edge of these cells, more than once where cells share it.
    fn for_edges(&self, mesh: &Mesh, mut visit: impl FnMut(u32, u32)) {
        self.matter(mesh).for_each(|(kind, _, cell)| edges(kind, &cell, &mut visit));
    }
}

/// Checks a mesh and turns inverted tetrahedra and hexahedra round.
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
        hexahedra: mesh.hexahedra.len(),
        triangles: mesh.triangles.len(),
        quads: mesh.quads.len(),
        ..MeshStatistics::default()
    };

    no_cells(&mesh, &mut found);
    mixed_order(&mut mesh, &mut found);
    let cells = Sound::of(&mesh, &mut found);

    let n = mesh.points.len();
    let mut used = vec![false; n];
    cells.matter(&mesh).for_each(|(_, _, cell)| cell.iter().for_each(|&v| used[v as usize] = true));
    let used_vertices: Vec<u32> = (0..n as u32).filter(|&v| used[v as usize]).collect();
    statistics.used_vertices = used_vertices.len();

    let mut tally = Tally::default();
    // unused ones as well: frames and other meshes would carry them on
    for (v, point) in (0..).zip(&mesh.points) {
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

    shape::shapes(&mut mesh, &cells, options, &mut statistics, &mut found);
    places::duplicate_coordinates(&mesh, &cells, &used_vertices, &mut found);
    topology::duplicate_cells(&mesh, &cells, &mut found);
    topology::manifold(&mesh, &cells, &mut found);
    topology::components(&mesh, &cells, &used_vertices, &mut statistics, &mut found);
    unused(&mesh, &used, &mut found);
    size(&mesh, &used_vertices, options, &mut statistics, &mut found);
    skipped(&mesh, &mut found);

    let tets = cells.tetrahedra(&mesh).filter_map(|(i, _)| mesh.tetrahedron_volume(i));
    let hexes = cells.hexahedra(&mesh).filter_map(|(_, &hex)| mesh.hexahedron_volume(hex));
    let volumes = tets.chain(hexes).filter(|volume| volume.is_finite());
    // From 0: the sum of nothing is -0.
    statistics.total_volume = volumes.fold(0.0, |sum, volume| sum + volume);
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

/// Tetrahedra of both orders do not fit together; the others are then looked at as linear ones.
fn mixed_order(mesh: &mut Mesh, found: &mut Findings) {
    let (all, given) = (mesh.tetrahedra.len(), mesh.middles.len());
    let linear = mesh.middles.iter().filter(|middles| **middles == LINEAR).count();
    let count = linear + all.abs_diff(given);
    if given > 0 && count > 0 {
        mesh.middles.clear();
        found.push(
            FindingCode::MixedOrder,
            Severity::Error,
            Tally { count, named: Vec::new() },
            |count| {
                format!("{count} of {all} tetrahedra have no vertices on their edges, others have")
            },
            "mesh all of the body in one order, or read it with the vertices of its corners alone",
        );
    }
    found.push(
        FindingCode::MixedOrder,
        Severity::Warning,
        Tally {
            count: if mesh.is_second_order() { mesh.hexahedra.len() } else { 0 },
            named: Vec::new(),
        },
        |count| {
            format!(
                "{count} hexahedra, which are of first order, beside tetrahedra of second order"
            )
        },
        "faces between them gape and count as surface: split the hexahedra into tetrahedra before",
    );
}

fn no_cells(mesh: &Mesh, found: &mut Findings) {
    if ElementKind::ALL.iter().all(|&kind| mesh.count(kind) == 0) {
        let kinds: Vec<&str> = mesh.skipped.iter().map(|s| s.kind.as_str()).collect();
        let tally = Tally { count: 1, named: Vec::new() };
        found.push(
            FindingCode::NoCells,
            Severity::Error,
            tally,
            |_| match kinds.as_slice() {
                [] => "the mesh has no cells".to_owned(),
                kinds => {
                    format!("the mesh has only cells that cannot be used: {}", kinds.join(", "))
                }
            },
            "mesh the body with tetrahedra of first or second order, or with linear hexahedra, triangles or quadrilaterals",
        );
    }
}

/// Which cells have different vertices that all exist.
fn indices(mesh: &Mesh, kind: ElementKind, found: &mut Findings) -> Vec<bool> {
    let n = mesh.points.len();
    let (mut outside, mut repeated) = (Tally::default(), Tally::default());
    let mut ok = Vec::with_capacity(mesh.count(kind));
    for (i, cell) in mesh.cells(kind).enumerate() {
        let mut sorted = cell;
        sorted.sort_unstable();
        let inside = sorted.last().is_none_or(|&v| (v as usize) < n);
        let distinct = sorted.windows(2).all(|pair| pair[0] != pair[1]);
        if !inside {
            outside.add(|| cell_name(mesh, kind, i, &cell));
        } else if !distinct {
            repeated.add(|| cell_name(mesh, kind, i, &cell));
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
        "remove these cells; cells with collapsed corners have to be meshed with tetrahedra or triangles",
    );
    ok
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
        "mesh these parts with tetrahedra of first or second order, or with linear hexahedra, triangles or \
         quadrilaterals, if they should take part",
    );
}
