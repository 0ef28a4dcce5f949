//! Cuts, blades, tears, threads and needles: cases of a separate program, schema `sinew-cut-ref/1`, and criteria without a
//! stored field, schema `sinew-cut-criteria/1`. Every row has bounds of its own, which `--tolerance` does not change.

mod fields;
mod hand;
mod random;
mod wounds;

use super::read::{CaseEntry, ReferenceCase};
use super::{CaseError, Rows, ValidationRow};
use sinew::engine::mesh::Surface;
use sinew::models::body::Evaluation;
use sinew::models::cutting::MaterialSkin;
use sinew::models::cutting::material::Material;
use sinew::models::cutting::stroke::Stroke;
use sinew::prelude::*;
use sinew::solvers::settings::LinearPrecision;
use std::error::Error;
use std::time::Instant;

type Failure = Box<dyn Error + Send + Sync>;
type Outcome<T = ()> = Result<T, Failure>;

/// The rows of a file as they come.
struct CutRows<'a> {
    case: &'a ReferenceCase<'a>,
    /// Name in the table.
    name: String,
    /// Why rows are known to miss a bound, by their names, if any are.
    known_misses: serde_json::Map<String, serde_json::Value>,
    rows: Vec<ValidationRow>,
}

impl CutRows<'_> {
    /// Adds a row of what is measured there; it passes when all of its figures are within their bounds.
    fn add(&mut self, what: &str, measure: impl FnOnce(&mut ValidationRow) -> Outcome) {
        let mut row = ValidationRow::new(&self.name, what, 0, 0);
        let start = Instant::now();
        let outcome = measure(&mut row);
        row.seconds = start.elapsed().as_secs_f64();
        let outcome = outcome.map_err(|error| match error.downcast() {
            Ok(own) => *own,
            Err(source) => CaseError::File { path: self.case.path.clone(), source },
        });
        if outcome.is_ok() {
            row.judge(self.known_misses.get(what).and_then(|why| why.as_str()));
        }
        self.rows.push(row.ended(outcome));
    }

    fn threads(&self) -> usize {
        self.case.options.threads
    }
}

fn rows_of<'a>(case: &'a ReferenceCase<'a>) -> Result<CutRows<'a>, CaseError> {
    if case.options.evaluation != Evaluation::Fused {
        return Err(CaseError::NotRun("bodies of pooled springs cannot be cut".into()));
    }
    let known_misses = Default::default();
    Ok(CutRows { case, name: case.name(), known_misses, rows: Vec::new() })
}

/// Cases of a separate program.
pub(super) fn run(case: &ReferenceCase) -> Rows {
    let mut rows = rows_of(case)?;
    let root = case.root();
    match rows.name.as_str() {
        "continuum" => wounds::against_continuum(&mut rows),
        "stitch" => fields::stitch(&mut rows),
        "capstan" => fields::capstan(&mut rows),
        "force" => hand::force(&mut rows),
        "recut" => random::recut(&mut rows),
        "two_pieces" => fields::at_the_instant(&mut rows),
        _ if root.get("kind").text()? == "static" => fields::at_rest(&mut rows),
        other => return Err(CaseError::NotRun(format!("the case `{other}` is not known"))),
    }
    Ok(rows.rows)
}

/// A criterion: its rows, by what the file says of it.
type Criterion = fn(&mut CutRows, &CaseEntry);
const CRITERIA: [(&str, Criterion); 10] = [
    ("random cuts", random::cuts),
    ("loose piece", hand::loose_piece),
    ("wound surface", wounds::on_the_blade),
    ("blade without force", hand::without_force),
    ("cutting force", hand::steady),
    ("glue", wounds::glued),
    ("iterations", wounds::iterations),
    ("tearing", wounds::tearing),
    ("closing tension", wounds::closing),
    ("needle", hand::needle),
];

/// Criteria without a stored field.
pub(super) fn run_criteria(case: &ReferenceCase) -> Rows {
    let mut rows = rows_of(case)?;
    for entry in case.root().get("criteria").list()? {
        let name = entry.get("name").text()?;
        let known = CRITERIA.iter().find(|(own, _)| *own == name);
        let names = || CRITERIA.map(|(own, _)| own).join(", ");
        let (_, measure) = known.ok_or_else(|| entry.get("name").error(names()))?;
        rows.name = name.into();
        let known = entry.get("known_misses").given();
        rows.known_misses =
            known.map_or(Ok(Default::default()), |known| known.object().cloned())?;
        measure(&mut rows, &entry);
    }
    Ok(rows.rows)
}

/// Cuts a material at its rest shape.
fn cut(material: &mut Material, rest: &[DVec3], strip: &[[DVec3; 2]]) -> Stroke {
    let sources = material.ghosts.clone();
    let at = |node: u32| match node.checked_sub(material.vertices) {
        None => rest[node as usize],
        Some(ghost) => rest[sources[ghost as usize] as usize],
    };
    let (marks, stroke) = material.stroke(strip, &at);
    material.open(&stroke);
    Stroke { marks, ..stroke }
}

/// A simulation without gravity of one body.
fn alone(threads: usize, body: &BodyDescription) -> Outcome<(Simulation, BodyHandle)> {
    let options = SimulationOptions { threads, exclusive: true, ..Default::default() };
    let mut simulation = Simulation::new(options)?;
    let body = simulation.add_body(body)?;
    simulation.set_gravity(DVec3::ZERO);
    Ok((simulation, body))
}

/// A body that can be cut.
fn cuttable<'a>(mesh: &'a Mesh, material: YoungPoisson, model: Model) -> BodyDescription<'a> {
    let spare = 3 * mesh.points.len();
    BodyDescription { spare, model, ..BodyDescription::new("block", mesh, material) }
}

fn hold(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh, group: &str) -> Outcome {
    let rows = simulation.group_rows(body, mesh, group)?;
    simulation.add_constraint(Constraint::hold(group, rows));
    Ok(())
}

/// Triangles bear a traction (Pa).
fn pull(
    simulation: &mut Simulation,
    body: BodyHandle,
    triangles: Vec<[u32; 3]>,
    traction: DVec3,
) -> Outcome {
    let on = Surface { triangles, ..Surface::default() };
    let faces = simulation.traction_faces(body, "pull", &on, traction)?;
    simulation.add_loaded_faces("pull", faces, Curve::Constant);
    Ok(())
}

/// Equilibria, solved to rounding.
fn static_settings() -> SolverSettings {
    SolverSettings {
        integrator: Integrator::QuasiStatic,
        linear_tolerance: 1e-12,
        newton_tolerance: 1e-13,
        linear_precision: LinearPrecision::Full,
        ..SolverSettings::default()
    }
}

fn moved_by(integrator: Integrator) -> SolverSettings {
    SolverSettings { integrator, ..SolverSettings::default() }
}

/// Volume (m^3) between the sides of a wound: the integral of the jump of displacement times the area vector at rest.
fn opening(skin: &MaterialSkin, rest: &[DVec3]) -> f64 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|p| rest[p as usize]);
        let moved: DVec3 = t.iter().map(|&p| skin.points[p as usize] - rest[p as usize]).sum();
        -moved.dot((b - a).cross(c - a)) / 6.0
    };
    skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound).map(|(t, _)| of(t)).sum()
}
