//! `sinew check`: everything that is looked at before the first step, and no step.

use crate::assemble::{BuildOptions, build};
use crate::error::{SceneError, SceneProblem};
use crate::scene::LoadedScene;
use crate::summary::{LoadSummary, PressureSummary};
use crate::text::{counted, short};
use crate::warning::{Level, Warning};
use serde::Serialize;
use sinew::engine::mesh::{CheckOptions, CheckReport, Mesh, MeshError, check};
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
        meshes: Vec::new(),
        warnings: Vec::new(),
        plan: Vec::new(),
    };
    let error = if scene {
        check_scene(path, &mut summary).err().map(|e| e.to_string())
    } else {
        check_mesh(path, &mut summary).err().map(|e| e.to_string())
    };
    summary.usable = error.is_none() && !summary.meshes.iter().any(CheckReport::has_errors);
    summary.error = error;
    summary
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
    for body in &built.bodies {
        summary.plan.push(format!(
            "body `{}`: {} vertices, {}, E = {} Pa, nu = {}, {} kg/m^3",
            body.name,
            body.used_vertices.len(),
            counted(&[
                ("tetrahedra", body.mesh.tetrahedra.len()),
                ("hexahedra", body.mesh.hexahedra.len()),
            ]),
            short(body.material.young_modulus),
            body.material.poisson_ratio,
            short(body.material.density),
        ));
        if let Some(m) = &body.membrane {
            summary.plan.push(format!(
                "membrane of `{}`: {}, {} m thick, E = {} Pa, nu = {}, {} kg/m^3",
                body.name,
                counted(&[("triangles", m.triangles.len()), ("quadrilaterals", m.quads.len())]),
                short(m.settings.thickness),
                short(m.settings.material.young_modulus),
                m.settings.material.poisson_ratio,
                short(m.settings.material.density),
            ));
        }
        summary.meshes.push(body.report.clone());
    }
    for c in &built.constraints {
        let body = &built.bodies[c.body].name;
        let count = c.vertices.len();
        summary.plan.push(format!("constraint `{}`: {count} vertices of `{body}`", c.name));
    }
    for load in &built.loads {
        let LoadSummary { name, body, vertices, .. } = &load.summary;
        summary.plan.push(format!("load `{name}`: {vertices} vertices of `{body}`"));
    }
    for p in &built.pressures {
        let PressureSummary { name, body, triangles, .. } = &p.summary;
        summary.plan.push(format!("pressure `{name}`: {triangles} triangles of `{body}`"));
    }
    for probe in &built.probes {
        let (body, count) = (&built.bodies[probe.body].name, probe.vertices.len());
        summary.plan.push(format!("probe `{}`: {count} vertices of `{body}`", probe.name));
    }
    let (steps, dt) = (built.plan.steps, built.plan.dt);
    summary.plan.push(match built.plan.mode {
        crate::scene::Mode::Dynamic => format!("{steps} steps of {} s", short(dt)),
        crate::scene::Mode::Static => format!("equilibrium in {steps} load step(s)"),
    });
    let limit = built.simulation.stable_step();
    summary.plan.push(format!("largest stable explicit step about {limit:.2e} s, at rest"));
    Ok(())
}

fn check_mesh(path: &Path, summary: &mut CheckSummary) -> Result<(), MeshError> {
    let mesh = Mesh::read(path)?;
    mesh.fits_into_memory()?;
    let report = match check(&mesh, &CheckOptions::default()) {
        Ok(checked) => checked.report,
        Err(error) => *error.report,
    };
    summary.meshes.push(report);
    Ok(())
}

impl fmt::Display for CheckSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = if self.usable { "can be simulated" } else { "CANNOT be simulated" };
        writeln!(f, "{} ({}): {verdict}", self.file, self.kind)?;
        if let Some(error) = &self.error {
            writeln!(f, "  error: {error}")?;
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
