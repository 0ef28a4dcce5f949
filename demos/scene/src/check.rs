//! `sinew check`: everything that is looked at before the first step, and no step.

use crate::assemble::{BuildOptions, BuiltBody, BuiltScene, MaterialRanges, build};
use crate::error::{SceneError, SceneProblem};
use crate::scene::{BodyEntry, LoadedScene, Mode};
use crate::summary::{LoadSummary, PressureSummary};
use crate::text::{counted, pressure, short};
use crate::warning::{Level, Warning};
use serde::Serialize;
use sinew::engine::mesh::{CheckOptions, CheckReport, EmbeddedPoints, Mesh, MeshError, check};
use std::fmt;
use std::path::Path;

/// Outcome of a check.
#[derive(Clone, Debug, Serialize)]
pub struct CheckSummary {
    /// `"sinew-check/1"`.
    pub schema: &'static str,
    /// The file.
    pub file: String,
    /// `"scene"` or `"mesh"`.
    pub kind: &'static str,
    /// Whether it can be simulated.
    pub usable: bool,
    /// Why not.
    pub error: Option<String>,
    /// All that is wrong in a scene, as far as it can be told at once, the error among it.
    pub mistakes: Vec<String>,
    /// For each of them the line of the file and marks under the place; empty where there is none.
    pub marks: Vec<String>,
    /// One report per mesh.
    pub meshes: Vec<CheckReport>,
    /// What was found beside the meshes: materials, constraints; in a scene also the meshes.
    pub warnings: Vec<Warning>,
    /// What the scene would do, one line each.
    pub plan: Vec<String>,
}

/// Checks a scene (`.toml`) or a mesh (any other file).
///
/// Whatever is wrong is in the summary; there is no other error.
pub fn check_file(path: &Path) -> CheckSummary {
    let scene = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let mut summary = CheckSummary {
        schema: "sinew-check/1",
        file: path.display().to_string(),
        kind: if scene { "scene" } else { "mesh" },
        usable: true,
        error: None,
        mistakes: Vec::new(),
        marks: Vec::new(),
        meshes: Vec::new(),
        warnings: Vec::new(),
        plan: Vec::new(),
    };
    let error = if scene {
        let error = check_scene(path, &mut summary).err();
        (summary.mistakes, summary.marks) = error.iter().flat_map(|_| mistakes(path)).unzip();
        error.map(|e| e.to_string())
    } else {
        check_mesh(path, &mut summary).err().map(|e| e.to_string())
    };
    summary.usable = error.is_none() && !summary.meshes.iter().any(CheckReport::has_errors);
    summary.error = error;
    summary
}

/// What is wrong in a scene that cannot be built, each with its line and marks under the place.
pub fn mistakes(path: &Path) -> Vec<(String, String)> {
    // what is no text was told
    let Ok(text) = std::fs::read_to_string(path) else { return Vec::new() };
    let options = BuildOptions { threads: Some(1), ..BuildOptions::default() };
    let found = LoadedScene::mistakes(&text, path, |scene| build(scene, &options).map(drop));
    found.iter().map(|error| (error.to_string(), LoadedScene::marked(&text, error))).collect()
}

fn check_scene(path: &Path, summary: &mut CheckSummary) -> Result<(), SceneError> {
    let loaded = LoadedScene::read(path)?;
    let options = BuildOptions { threads: Some(1), ..BuildOptions::default() };
    let mut built = build(&loaded, &options).inspect_err(|error| {
        if let SceneError::At { problem: SceneProblem::Check(source), .. } = error {
            summary.meshes.push((*source.report).clone());
        }
    })?;
    summary.warnings = built.all_warnings();
    for (body, entry) in built.bodies.iter().zip(&loaded.scene.bodies) {
        summary.plan.extend(about_body(body, entry));
        summary.meshes.push(body.report.clone());
    }
    summary.plan.extend(about_what_acts(&built));
    let (steps, dt) = (built.plan.steps, built.plan.dt);
    summary.plan.push(match built.plan.mode {
        Mode::Dynamic => format!("{steps} steps of {} s", short(dt)),
        Mode::Static => format!("equilibrium in {steps} load step(s)"),
    });
    let limit = built.simulation.stable_step();
    summary.plan.push(format!("largest stable explicit step about {limit:.2e} s, at rest"));
    Ok(())
}

/// A body and its membrane, a line each.
fn about_body(body: &BuiltBody, entry: &BodyEntry) -> Vec<String> {
    let mut lines = Vec::new();
    let vertices = body.used_vertices.len();
    if body.mesh.is_solid() {
        let ranges = MaterialRanges::new(&entry.material, &body.mesh);
        lines.push(format!(
            "body `{}`: {vertices} vertices, {}, {}",
            body.name,
            counted(&[
                ("tetrahedra", body.mesh.tetrahedra.len()),
                ("hexahedra", body.mesh.hexahedra.len()),
            ]),
            ranges.words(&body.material),
        ));
        if let Some(report) = &body.lattice {
            let [cell, held] = [1e3 * report.cell, 100.0 * report.held / report.volume];
            lines.push(format!(
                "lattice of `{}`: cubes of {} mm hold {held:.1} % of the volume inside the surface",
                body.name,
                short(cell),
            ));
        }
        if let Some(carried) = &body.carried {
            let EmbeddedPoints { outside, farthest, .. } = carried.embedding;
            lines.push(format!(
                "`{}` carries a surface of {} points, {outside} of them outside of its elements by up to {} m",
                body.name,
                carried.points.len(),
                short(farthest),
            ));
        }
    } else {
        lines.push(format!("body `{}`: {vertices} vertices, a membrane alone", body.name));
    }
    if let Some(m) = &body.membrane {
        lines.push(format!(
            "membrane of `{}`: {}, {} m thick, {}",
            body.name,
            counted(&[("triangles", m.triangles.len()), ("quadrilaterals", m.quads.len())]),
            short(m.settings.thickness),
            MaterialRanges::default().words(&m.settings.material),
        ));
    }
    lines
}

/// Everything that holds, moves, touches, cuts or records, a line each.
fn about_what_acts(built: &BuiltScene) -> Vec<String> {
    let mut lines = Vec::new();
    let name = |body: usize| &built.bodies[body].name;
    let newtons = |force: [f64; 3]| {
        let [x, y, z] = force.map(short);
        format!("[{x}, {y}, {z}] N")
    };
    for c in &built.constraints {
        let (count, times) = (c.vertices.len(), window(c.from, c.until));
        let body = name(c.body);
        lines.push(format!(
            "constraint `{}`: {count} vertices of `{body}` {}{times}",
            c.name, c.motion
        ));
    }
    for load in &built.loads {
        let LoadSummary { name, body, vertices, force } = &load.summary;
        let force = newtons(*force);
        lines.push(format!("load `{name}`: {force} on {vertices} vertices of `{body}`"));
    }
    for own in &built.pressures {
        let PressureSummary { name, body, triangles, pressure: p } = &own.summary;
        let p = pressure(*p);
        lines.push(format!("pressure `{name}`: {p} on {triangles} triangles of `{body}`"));
    }
    for tool in &built.tools {
        let friction = short(tool.friction);
        lines.push(format!("tool `{}`: {}, friction {friction}", tool.name, tool.words));
    }
    for pull in &built.pulls {
        let times = window(pull.from, pull.until);
        lines.push(format!(
            "pull `{}`: {} N/m on {} vertices of `{}`, the hand {}{times}",
            pull.name,
            short(pull.stiffness),
            pull.rows.len(),
            name(pull.body),
            pull.motion
        ));
    }
    for c in &built.contacts {
        let [a, b] = c.bodies.map(name);
        let of = if a == b { format!("`{a}` with itself") } else { format!("`{a}` and `{b}`") };
        lines.push(format!("contact `{}`: {of}, friction {}", c.name, short(c.friction)));
    }
    for (kind, own) in [("thread", &built.strands), ("clip", &built.clips)] {
        lines.extend(own.iter().map(|own| {
            format!("{kind} `{}`: {}{}", own.name, own.words, window(own.from, own.until))
        }));
    }
    for own in &built.resections {
        let (name, body) = (&own.summary.name, &own.summary.body);
        lines.push(format!("resection `{name}`: elements of `{body}` {}", own.words()));
    }
    for own in &built.cuts {
        let (name, body) = (&own.summary.name, &own.summary.body);
        lines.push(format!("cut `{name}`: through `{body}` {}", own.words()));
    }
    for probe in &built.probes {
        let (body, count) = (name(probe.body), probe.vertices.len());
        let record: Vec<&str> = probe.record.iter().map(|own| own.key).collect();
        let of = if record.iter().any(|key| key.starts_with("tool_") || key.starts_with("pull_")) {
            String::new()
        } else {
            format!("{count} vertices of `{body}`, ")
        };
        lines.push(format!("probe `{}`: {of}{}", probe.name, record.join(", ")));
    }
    lines
}

/// Times (s) from which and until which something acts, where it does not always.
fn window(from: f64, until: f64) -> String {
    let from = if from > 0.0 { format!(", from {from} s") } else { String::new() };
    let until = if until.is_finite() { format!(", until {until} s") } else { String::new() };
    from + &until
}

fn check_mesh(path: &Path, summary: &mut CheckSummary) -> Result<(), MeshError> {
    let mesh = Mesh::read(path)?;
    mesh.fits_into_memory()?;
    let report = match check(&mesh, &CheckOptions::default()) {
        Ok(checked) => checked.report,
        Err(error) => *error.report,
    };
    summary.meshes.push(report);
    if !mesh.is_solid() && mesh.triangles.len() + mesh.quads.len() > 0 {
        summary.warnings.push(Warning::new(
            SURFACE_ONLY,
            Level::Warning,
            "elements",
            "there are faces but no tetrahedra or hexahedra: it is no solid body, a membrane at most",
            recipe(path, &mesh),
        ));
    }
    Ok(())
}

/// Code of the warning about a mesh without solid elements.
const SURFACE_ONLY: &str = "check.surface-only";

/// How to fill a surface, with the file's own name.
fn recipe(path: &Path, mesh: &Mesh) -> String {
    // a cube in fifteen along the body, to two digits
    let extent = mesh.bounds().map_or(0.0, |(low, high)| (high - low).max_element());
    let cell = format!("{:.1e}", extent / 15.0).parse().map_or_else(|_| "...".into(), short);
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    format!(
        "give it a thickness in a scene, membrane = {{ thickness = 0.001 }}, or fill it with cubes there, lattice = {cell}, \
         or with tetrahedra by Gmsh: sinew mesh fill {file} {stem}.msh (in millimetres: --scale 0.001; other triangles: --edge {cell}); more in docs/own-mesh.md"
    )
}

impl fmt::Display for CheckSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let surface = self.warnings.iter().any(|w| w.code == SURFACE_ONLY);
        let verdict = match (self.usable, surface) {
            (true, true) => "a surface only, no solid body",
            (true, false) => "can be simulated",
            (false, _) => "CANNOT be simulated",
        };
        writeln!(f, "{} ({}): {verdict}", self.file, self.kind)?;
        let known = |error: &&String| !self.mistakes.contains(*error);
        if let Some(error) = self.error.as_ref().filter(known) {
            writeln!(f, "  error: {error}")?;
        }
        for (error, mark) in self.mistakes.iter().zip(&self.marks) {
            writeln!(f, "  error: {error}")?;
            if !mark.is_empty() {
                writeln!(f, "{mark}")?;
            }
        }
        for line in &self.plan {
            writeln!(f, "  {line}")?;
        }
        for report in &self.meshes {
            let s = &report.statistics;
            writeln!(f, "mesh {}", report.source)?;
            writeln!(
                f,
                "  {} vertices ({} used), {}, {} part(s)",
                s.vertices,
                s.used_vertices,
                s.cells(),
                s.components
            )?;
            writeln!(
                f,
                "  quality worst {:.3}, mean {:.3} (1 is regular); volume {:.4e} m^3; smallest \
                 altitude {:.4e} m",
                s.worst_quality, s.mean_quality, s.total_volume, s.smallest_altitude
            )?;
            for finding in &report.findings {
                writeln!(f, "  {finding}")?;
            }
            if report.findings.is_empty() {
                writeln!(f, "  no findings")?;
            }
        }
        // those of the meshes stand with them
        for warning in self.warnings.iter().filter(|w| !w.code.starts_with("mesh.")) {
            writeln!(f, "{warning}")?;
        }
        let warnings = self.warnings.iter().filter(|w| w.level == Level::Warning).count();
        if self.kind == "scene" && self.usable {
            writeln!(f, "{warnings} warning(s)")?;
        }
        Ok(())
    }
}
