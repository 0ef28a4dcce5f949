//! The hard cases: what an engine for soft bodies must survive, in eleven groups, each case with its
//! pass criteria. A case that misses one stays in the table as failing.
//!
//! Every simulated case has to stay finite after every step, and its total energy below its start plus
//! outside work (`Run` keeps the books); the groups add criteria of their own.

mod cantilever;
mod collapse;
mod input;
mod motion;
mod release;
mod report;
mod runner;
mod shape;
mod spin;

use rayon::prelude::*;
use runner::{Case, Scope, Setting};
use serde::Serialize;
use sinew::engine::mesh::MeshError;
use sinew::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// A column of the pass table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Column {
    /// Integrator.
    pub integrator: Integrator,
    /// Energy.
    pub model: Model,
}

impl Column {
    /// Whether the suite must pass with it: the integrators that are meant for anything, with the
    /// energy that undoes inversion. The others are shown for comparison.
    pub fn required(self) -> bool {
        let robust = [Integrator::default(), Integrator::Safe].contains(&self.integrator);
        robust && self.model == Model::CompressibleStVK
    }

    /// Name in tables; the default model goes without saying.
    pub fn name(self) -> String {
        let integrator = integrator_name(self.integrator);
        match self.model {
            Model::CompressibleStVK => integrator,
            model => format!("{integrator} {}", model.name()),
        }
    }
}

/// Name of an integrator in scene files.
fn integrator_name(integrator: Integrator) -> String {
    let name = serde_json::to_value(integrator).ok();
    name.as_ref().and_then(|n| n.as_str()).unwrap_or("?").to_string()
}

/// A subgroup of cases: a row of the pass table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Part {
    /// Number of its group, 1 to 11.
    pub group: u8,
    /// What its cases have in common.
    pub name: &'static str,
    /// What they must meet, beside finite states and bounded energy.
    pub criterion: &'static str,
}

/// A measured quantity against its limit.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// What was measured.
    pub what: &'static str,
    /// Its value.
    pub measured: f64,
    /// The value that it is held against.
    pub limit: f64,
    /// Whether it must stay at or below the limit, not at or above it.
    pub at_most: bool,
    /// Whether it does.
    pub pass: bool,
}

impl Check {
    /// Must not be larger; NaN is.
    pub fn at_most(what: &'static str, measured: f64, limit: f64) -> Self {
        Self { what, measured, limit, at_most: true, pass: measured <= limit }
    }

    /// Must not be smaller; NaN is.
    pub fn at_least(what: &'static str, measured: f64, limit: f64) -> Self {
        Self { what, measured, limit, at_most: false, pass: measured >= limit }
    }

    /// Must be none.
    pub fn none(what: &'static str, count: u64) -> Self {
        Self::at_most(what, count as f64, 0.0)
    }

    /// Must be so.
    pub fn holds(what: &'static str, holds: bool) -> Self {
        Self::at_least(what, f64::from(u8::from(holds)), 1.0)
    }
}

/// What a case went through.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// Steps.
    pub steps: u64,
    /// Linear systems, all steps together.
    pub solves: u64,
    /// Most linear systems in one step.
    pub most_solves: u32,
    /// Steps on a projected tangent.
    pub projected: u64,
    /// Steps whose velocity the energy cap scaled.
    pub capped: u64,
    /// Steps with a gradient in place of a solution, or without a decrease.
    pub fallbacks: u64,
    /// Steps in which Newton's method did not converge.
    pub unconverged: u64,
    /// Explicit substeps, all steps together.
    pub substeps: u64,
    /// Largest rise of total energy above its start plus outside work, over the energy scale.
    pub energy_excess: Option<f64>,
    /// Most inverted elements in a step.
    pub most_inverted: u64,
    /// Inverted elements at the end.
    pub inverted: u64,
    /// Root mean square of relative edge-length change at the end.
    pub edge_error: Option<f64>,
    /// Hash of the last state.
    pub hash: u64,
}

/// How a case ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// All criteria met.
    Pass,
    /// One was not.
    Fail,
    /// Not in the engine yet.
    NotAvailable,
}

/// Result of one case in one column.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Subgroup.
    pub part: Part,
    /// What was run.
    pub case: String,
    /// With what; none where neither integrator nor model matters.
    pub column: Option<Column>,
    /// How it ended.
    pub status: Status,
    /// Counted in the pass criterion, or shown for comparison only.
    pub required: bool,
    /// The criteria one by one.
    pub checks: Vec<Check>,
    /// What it went through.
    pub figures: Figures,
    /// What stopped it, why it is not available, or what was tried where it fails.
    pub note: String,
    /// Wall time (s).
    pub seconds: f64,
}

/// A finished suite.
#[derive(Clone, Debug, Serialize)]
pub struct Suite {
    /// Schema of the JSON form.
    pub schema: &'static str,
    /// Command that makes such a suite.
    pub command: String,
    /// Where it ran.
    pub machine: crate::bench::machine::MachineNotes,
    /// Whether cases were left out.
    pub quick: bool,
    /// Number type.
    pub precision: &'static str,
    /// Columns of the pass table.
    pub columns: Vec<Column>,
    /// One row per case and column.
    pub rows: Vec<Row>,
    /// Wall time (s).
    pub seconds: f64,
}

impl Suite {
    /// Whether every required row passed.
    pub fn passed(&self) -> bool {
        self.failures().next().is_none()
    }

    /// Required rows that failed.
    pub fn failures(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|r| r.required && r.status == Status::Fail)
    }
}

/// Choice of cases and columns.
#[derive(Clone, Debug, Default)]
pub struct SuiteOptions {
    /// A selection from every group, short enough for continuous integration.
    pub quick: bool,
    /// Number type.
    pub precision: Precision,
    /// Integrators; with none, the default one and others beside it for comparison.
    pub integrators: Vec<Integrator>,
    /// Models; with none, the default one and others beside it for comparison.
    pub models: Vec<Model>,
    /// Groups; all when empty.
    pub groups: Vec<u8>,
}

impl SuiteOptions {
    /// Every integrator named with every model named. With neither named: the robust integrators and the
    /// others with the default model, and the default integrator with the other models.
    pub fn columns(&self) -> Vec<Column> {
        let default = Model::CompressibleStVK;
        if self.integrators.is_empty() && self.models.is_empty() {
            let integrators = [
                Integrator::Safe,
                Integrator::Newton,
                Integrator::StormerVerlet,
                Integrator::SymplecticEuler,
            ];
            let models = [Model::StVK, Model::QuadraticSprings, Model::MassSpring];
            let with = |integrator, model| Column { integrator, model };
            let first = integrators.map(|integrator| with(integrator, default));
            let others = models.map(|model| with(Integrator::Safe, model));
            return first.into_iter().chain(others).collect();
        }
        let integrators = match self.integrators.is_empty() {
            true => vec![Integrator::default()],
            false => self.integrators.clone(),
        };
        let models = match self.models.is_empty() {
            true => vec![default],
            false => self.models.clone(),
        };
        let pairs = integrators
            .iter()
            .flat_map(|&integrator| models.iter().map(move |&model| Column { integrator, model }));
        pairs.collect()
    }

    /// The command that runs it.
    fn command(&self) -> String {
        let mut words = vec!["sinew bench stability".to_string()];
        if self.quick {
            words.push("--quick".into());
        }
        if self.precision == Precision::F32 {
            words.push("--precision f32".into());
        }
        words.extend(
            self.integrators.iter().map(|&i| format!("--integrator {}", integrator_name(i))),
        );
        words.extend(self.models.iter().map(|m| format!("--model {}", m.name())));
        words.extend(self.groups.iter().map(|g| format!("--group {g}")));
        words.join(" ")
    }
}

/// A suite that cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SuiteError {
    /// A mesh cannot be generated.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// There is no such group.
    #[error("there is no group {0}: choose one of 1 to 11")]
    Group(u8),
    /// An integrator that finds equilibria cannot run a suite of motion.
    #[error("quasi-static finds equilibria, the hard cases are motion: choose another integrator")]
    QuasiStatic,
}

/// Parts of the suite that the engine cannot run yet.
const NOT_AVAILABLE: [(Part, &str); 5] = [
    (
        Part {
            group: 3,
            name: "collapse, recovery mode",
            criterion: "edge error < 1 %, none inverted",
        },
        "the engine has no recovery mode yet",
    ),
    (
        Part { group: 4, name: "stiffness 1e6 : 1", criterion: "none inverted" },
        "a body has one Young's modulus; fields per element are not in the engine yet",
    ),
    (
        Part {
            group: 8,
            name: "resection",
            criterion: "closed form of an isolated vertex to 1e-9",
        },
        "elements cannot be removed yet",
    ),
    (
        Part { group: 9, name: "membranes", criterion: "edge error < 1e-3, radius within 0.5 %" },
        "there are no membrane elements yet",
    ),
    (
        Part { group: 10, name: "axis springs 100 : 1", criterion: "none inverted with a base" },
        "there are no axis springs yet",
    ),
];

/// What is known of cases that fail: group, part of the case's name, remark.
const KNOWN: [(u8, &str, &str); 6] = [
    (
        1,
        "E 1e4 nu 0",
        "inverts in full swing and recovers; so it does with converged implicit Euler",
    ),
    (3, "line 5^3 nu 0.3", "ends wound around, every element positive"),
    (3, "mirror 5^3 nu 0.3", "ends wound around, every element positive"),
    (3, "random 3x 1 5^3", "still untangling after 180 steps"),
    (4, "dihedral 0.01", "one thin element turns over in a step of 0.1 s and back"),
    (
        4,
        "of aspect 1000, nu",
        "thin elements turn over in the first swing; with converged Newton and the explicit integrators \
         too",
    ),
];

/// Runs the suite; cases run side by side, one thread each. `tell` hears how many of how many are done.
///
/// # Errors
/// When a mesh cannot be generated or the options make no sense.
pub fn run(
    options: &SuiteOptions,
    tell: impl Fn(usize, usize) + Sync,
) -> Result<Suite, SuiteError> {
    let start = Instant::now();
    if let Some(&group) = options.groups.iter().find(|g| !(1..=11).contains(*g)) {
        return Err(SuiteError::Group(group));
    }
    if options.integrators.contains(&Integrator::QuasiStatic) {
        return Err(SuiteError::QuasiStatic);
    }
    let mut cases = Vec::new();
    for build in [
        cantilever::cases,
        release::cases,
        collapse::cases,
        shape::cases,
        spin::cases,
        motion::cases,
        input::cases,
    ] {
        cases.extend(build()?);
    }
    let wanted = |group: u8| options.groups.is_empty() || options.groups.contains(&group);
    cases.retain(|case| wanted(case.part.group) && (case.quick || !options.quick));
    let columns = options.columns();
    let jobs: Vec<Job> = jobs(&cases, &columns);
    let done = AtomicUsize::new(0);
    let run = |job: &Job| {
        let row = job.run(options.precision);
        tell(done.fetch_add(1, Ordering::Relaxed) + 1, jobs.len());
        row
    };
    let mut rows: Vec<Row> = jobs.par_iter().map(run).collect();
    // one after the other: a thread that waits for another pool would take up further cases meanwhile
    for (job, row) in jobs.iter().zip(&mut rows).filter(|(job, _)| job.sampled) {
        job.repeat(options.precision, row);
    }
    rows.extend(NOT_AVAILABLE.iter().filter(|(part, _)| wanted(part.group)).map(|(part, why)| {
        Row {
            part: *part,
            case: String::new(),
            column: None,
            status: Status::NotAvailable,
            required: false,
            checks: Vec::new(),
            figures: Figures::default(),
            note: (*why).into(),
            seconds: 0.0,
        }
    }));
    rows.sort_by_key(|row| row.part.group);
    Ok(Suite {
        schema: "sinew-stability/2",
        command: options.command(),
        machine: crate::bench::machine::MachineNotes::now(),
        quick: options.quick,
        precision: options.precision.name(),
        columns,
        rows,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// A case in a column.
struct Job<'a> {
    case: &'a Case,
    column: Option<Column>,
    required: bool,
    /// Run again, and on two threads: the results must have the same bits.
    sampled: bool,
}

/// The cases in all columns that they concern; where they must pass, the first of every part is sampled
/// for repetition.
fn jobs<'a>(cases: &'a [Case], columns: &[Column]) -> Vec<Job<'a>> {
    let mut jobs: Vec<Job> = Vec::new();
    for case in cases {
        let mut add = |column: Option<Column>, required| {
            let first = !jobs.iter().any(|j| j.case.part == case.part && j.column == column);
            let sampled = required && first;
            jobs.push(Job { case, column, required, sampled });
        };
        match case.scope {
            Scope::Every => columns.iter().for_each(|&c| add(Some(c), c.required())),
            Scope::Explicit => {
                columns
                    .iter()
                    .filter(|c| runner::explicit(c.integrator))
                    .for_each(|&c| add(Some(c), true));
            }
            Scope::Once => add(None, true),
        }
    }
    jobs
}

impl Job<'_> {
    fn setting(&self, precision: Precision, threads: usize) -> Setting {
        let (integrator, model) = (Integrator::default(), Model::CompressibleStVK);
        let column = self.column.unwrap_or(Column { integrator, model });
        Setting { column, precision, threads }
    }

    /// Runs the case again, on one and on two threads: its row must stand, bit for bit.
    fn repeat(&self, precision: Precision, row: &mut Row) {
        if row.figures.steps == 0 {
            return;
        }
        let repeats = [1, 2].into_iter().all(|threads| {
            let again = (self.case.run)(&self.setting(precision, threads));
            again.is_ok_and(|(figures, _)| figures.hash == row.figures.hash)
        });
        row.checks.push(Check::holds("same bits again and with two threads", repeats));
        if !repeats {
            row.status = Status::Fail;
        }
    }

    fn run(&self, precision: Precision) -> Row {
        let start = Instant::now();
        let setting = self.setting(precision, 1);
        let mut row = Row {
            part: self.case.part,
            case: self.case.name.clone(),
            column: self.column,
            status: Status::Fail,
            required: self.required,
            checks: Vec::new(),
            figures: Figures::default(),
            note: String::new(),
            seconds: 0.0,
        };
        match (self.case.run)(&setting) {
            Ok((figures, checks)) => {
                if checks.iter().all(|c| c.pass) && !checks.is_empty() {
                    row.status = Status::Pass;
                }
                (row.figures, row.checks) = (figures, checks);
            }
            Err(problem) => row.note = problem.to_string(),
        }
        let known =
            KNOWN.iter().find(|(g, name, _)| *g == row.part.group && row.case.contains(name));
        if let Some((.., tried)) = known.filter(|_| row.required && row.status == Status::Fail) {
            row.note =
                format!("{}{}{tried}", row.note, if row.note.is_empty() { "" } else { "; " });
        }
        row.seconds = start.elapsed().as_secs_f64();
        row
    }
}
