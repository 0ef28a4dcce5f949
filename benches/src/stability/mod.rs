//! The hard cases: what an engine for soft bodies must survive, in thirteen groups, each case with its
//! pass criteria. What is known to miss one on some machine or with some setting is listed with its reason
//! ([`KNOWN_MISSES`]): it may miss, and it may pass.
//!
//! Every simulated case has to stay finite after every step, and its total energy below its start plus
//! outside work (`Run` keeps the books); the groups add criteria of their own.

mod axes;
mod cantilever;
mod collapse;
mod contact;
mod friction;
mod input;
mod membranes;
mod motion;
mod overload;
mod release;
mod report;
mod resection;
mod runner;
mod shape;
mod spin;

use rayon::prelude::*;
use runner::{Case, OtherCells, Scope, Setting};
use serde::{Deserialize, Serialize};
use sinew::engine::lanes::{InstructionSet, InstructionSetError};
use sinew::engine::mesh::MeshError;
use sinew::models::body::VolumeRule;
use sinew::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// What solids are cut into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cells {
    /// Linear tetrahedra.
    #[default]
    Tetrahedra,
    /// Ten-node tetrahedra: the same ones with vertices in the middle of their edges.
    Tetrahedra10,
    /// Hexahedra: the cells that the tetrahedra of boxes are cut from.
    Hexahedra,
}

impl Cells {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Tetrahedra, Self::Tetrahedra10, Self::Hexahedra];

    /// Name in tables and commands.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tetrahedra => "tetrahedra",
            Self::Tetrahedra10 => "tetrahedra10",
            Self::Hexahedra => "hexahedra",
        }
    }
}

impl std::fmt::Display for Cells {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// A column of the pass table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Column {
    /// Integrator.
    pub integrator: Integrator,
    /// Energy.
    pub model: Model,
    /// What keeps the volume of bodies.
    pub volume: VolumeRule,
    /// What solids are cut into.
    pub cells: Cells,
    /// Recovery from inversion switched on; not every integrator has it.
    pub recovery: bool,
}

impl Column {
    /// The default setting.
    pub const DEFAULT: Self = Self {
        integrator: Integrator::Auto,
        model: Model::CompressibleStVK,
        volume: VolumeRule::Elements,
        cells: Cells::Tetrahedra,
        recovery: true,
    };

    /// Whether the suite must pass with it: the integrators that are meant for anything, with the
    /// energy that undoes inversion and recovery as by default. The others are shown for comparison.
    pub fn required(self) -> bool {
        self.recovers() && self.model == Model::CompressibleStVK && self.cells == Cells::Tetrahedra
    }

    /// Whether the elements of solids, or what keeps their volume, are not the default ones.
    pub fn other_elements(self) -> bool {
        self.cells != Self::DEFAULT.cells || self.volume != Self::DEFAULT.volume
    }

    /// Whether bodies with many inverted elements recover by another energy.
    pub fn recovers(self) -> bool {
        self.recovery && self.integrator.recovers()
    }

    /// Name in tables; what is default goes without saying.
    pub fn name(self) -> String {
        let mut name = self.integrator.name().to_string();
        if self.model != Self::DEFAULT.model {
            name = format!("{name} {}", self.model.name());
        }
        if self.cells != Cells::Tetrahedra {
            name = format!("{name}, {}", self.cells);
        }
        if self.volume == VolumeRule::Clusters {
            name += ", clusters";
        }
        if self.integrator.recovers() && !self.recovery {
            name += ", no recovery";
        }
        name
    }
}

/// A subgroup of cases: a row of the pass table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Part {
    /// Number of its group, 1 to 13.
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
    /// Steps in recovery from inversion.
    pub recovering: u64,
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
    /// Why it may miss a criterion, for required cases that do so on some machine or with some setting.
    pub known: Option<&'static KnownMiss>,
    /// The criteria one by one.
    pub checks: Vec<Check>,
    /// What it went through.
    pub figures: Figures,
    /// What stopped it.
    pub note: String,
    /// Wall time (s).
    pub seconds: f64,
}

impl Row {
    /// Whether all that it misses is what it is known to miss.
    pub fn excused(&self) -> bool {
        let mut missed = self.checks.iter().filter(|c| !c.pass).peekable();
        self.known.is_some_and(|known| {
            missed.peek().is_some() && missed.all(|c| known.checks.contains(&c.what))
        })
    }
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
    /// Instruction set of the kernels.
    pub instruction_set: InstructionSet,
    /// Columns of the pass table.
    pub columns: Vec<Column>,
    /// One row per case and column.
    pub rows: Vec<Row>,
    /// Wall time (s).
    pub seconds: f64,
}

impl Suite {
    /// Whether every required row passed, or misses only what it is known to miss.
    pub fn passed(&self) -> bool {
        self.failures().all(Row::excused)
    }

    /// Required rows that failed, known misses among them.
    pub fn failures(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|r| r.required && r.status == Status::Fail)
    }

    /// Rows that are known to miss a criterion elsewhere and pass here.
    pub fn better_than_known(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|r| r.known.is_some() && r.status == Status::Pass)
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
    /// Volume by clusters, with models that have it.
    pub clusters: bool,
    /// What solids are cut into.
    pub cells: Cells,
    /// Recovery from inversion switched off, also where it is on by default.
    pub no_recovery: bool,
    /// Groups; all when empty.
    pub groups: Vec<u8>,
    /// Parts of the names of cases; all cases when empty.
    pub cases: Vec<String>,
}

impl SuiteOptions {
    /// Every integrator named with every model named. With neither named: the robust integrators, and
    /// for comparison the others with the default model and the default integrator with the other models,
    /// of which the quick selection has one each.
    pub fn columns(&self) -> Vec<Column> {
        let recovery = !self.no_recovery;
        let cells = self.cells;
        let default = Column { recovery, cells, ..Column::DEFAULT };
        let volume = |model: Model| match self.clusters && model.keeps_mean_volume() {
            true => VolumeRule::Clusters,
            false => VolumeRule::Elements,
        };
        let with = |integrator, model| Column {
            integrator,
            model,
            volume: volume(model),
            cells,
            recovery,
        };
        if self.integrators.is_empty() && self.models.is_empty() {
            let safe = Column { integrator: Integrator::Safe, ..default };
            if self.quick {
                let newton = Column { integrator: Integrator::Newton, ..default };
                return vec![default, safe, newton, Column { model: Model::MassSpring, ..default }];
            }
            let mut columns = vec![default, safe];
            if recovery {
                columns.push(Column { recovery: false, ..default });
            }
            let others = Integrator::ALL.iter().filter(|i| i.facts().dynamic && !i.recovers());
            columns.extend(others.map(|&integrator| Column { integrator, ..default }));
            let models = Model::ALL.into_iter().filter(|m| *m != default.model);
            columns.extend(models.map(|model| Column { model, ..default }));
            let clusters =
                Column { model: Model::NeoHookean, volume: VolumeRule::Clusters, ..default };
            columns.push(clusters);
            return columns;
        }
        fn or<T: Copy>(named: &[T], default: T) -> Vec<T> {
            if named.is_empty() { vec![default] } else { named.to_vec() }
        }
        let integrators = or(&self.integrators, default.integrator);
        let models = or(&self.models, default.model);
        let pairs = integrators
            .iter()
            .flat_map(|&integrator| models.iter().map(move |&model| with(integrator, model)));
        pairs.collect()
    }

    /// The command that runs it.
    fn command(&self) -> String {
        let mut words = vec!["sinew-lab bench stability".to_string()];
        if self.quick {
            words.push("--quick".into());
        }
        if self.precision == Precision::F32 {
            words.push("--precision f32".into());
        }
        if self.clusters {
            words.push("--clusters".into());
        }
        if self.cells != Cells::default() {
            words.push(format!("--cells {}", self.cells));
        }
        words.extend(self.integrators.iter().map(|i| format!("--integrator {}", i.name())));
        words.extend(self.models.iter().map(|m| format!("--model {}", m.name())));
        if self.no_recovery {
            words.push("--no-recovery".into());
        }
        words.extend(self.groups.iter().map(|g| format!("--group {g}")));
        words.extend(self.cases.iter().map(|name| format!("--case '{name}'")));
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
    #[error("there is no group {0}: choose one of 1 to 13")]
    Group(u8),
    /// Nothing is left to run.
    #[error(
        "no case is left: leave out --case or --quick, or take a part of a name that --json writes"
    )]
    NoCase,
    /// An integrator that finds equilibria cannot run a suite of motion.
    #[error("quasi-static finds equilibria, the hard cases are motion: choose another integrator")]
    QuasiStatic,
    /// The environment names an instruction set that cannot be used.
    #[error(transparent)]
    InstructionSet(#[from] InstructionSetError),
}

/// A criterion that a required case is known to miss on some machine or with some setting.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub struct KnownMiss {
    /// Name of its subgroup.
    pub part: &'static str,
    /// Names of its cases, whole: a part of a name would excuse cases that pass everywhere.
    pub cases: &'static [&'static str],
    /// What is missed.
    pub checks: &'static [&'static str],
    /// Why, and what helps.
    pub reason: &'static str,
}

const INVERTED: &str = "most inverted in a step";
const MORE_ENERGY: &str = "more energy than without recovery over work";
const MANY_MINIMA: &str = "without a term against compression a crushed bar has many equilibria, all inverted; \
                           it ends in another one, 4 to 6 % of the work higher";

/// All known misses. A case that misses anything else fails the suite.
pub static KNOWN_MISSES: [KnownMiss; 8] = [
    KnownMiss {
        part: "cantilevers",
        cases: &[
            "h 0.0333 E 1e4 nu 0",
            "h 0.0333 E 1e4 nu 0.3",
            "h 0.1000 E 1e4 nu 0",
            "h 0.1000 E 1e4 nu 0.3",
        ],
        checks: &[INVERTED],
        reason: "inverts in full swing and recovers; so it does with converged implicit Euler",
    },
    KnownMiss {
        part: "cantilevers",
        cases: &["h 0.0333 E 1e3 nu 0.45"],
        checks: &[INVERTED],
        reason: "inverts in full swing and recovers; the safe step does not",
    },
    KnownMiss {
        part: "slivers, needles, heavy vertex",
        cases: &["dihedral 0.01 deg, nu 0.3 h 0.1000"],
        checks: &[INVERTED],
        reason: "one thin element turns over in a step of 0.1 s and back",
    },
    KnownMiss {
        part: "slivers, needles, heavy vertex",
        cases: &[
            "plates of aspect 1000, nu 0.3 h 0.0167",
            "needles of aspect 1000, nu 0.3 h 0.0167",
        ],
        checks: &[INVERTED],
        reason: "thin elements turn over in the first swing; so they do with converged Newton and with the \
                 explicit integrators",
    },
    KnownMiss {
        part: "similar bodies, 1e-6 to 1e3 m",
        cases: &["nu 0.3", "nu 0.45"],
        checks: &["difference over size"],
        reason: "linear systems are solved in f32: what their rounding leaves differs between sizes, and \
                 whether it stays below the limit depends on the instruction set; passes with the safe step",
    },
    KnownMiss {
        part: "constraints on and off",
        cases: &["100 steps, nu 0.45 h 0.1000"],
        checks: &["edge error at the end"],
        reason: "with this step only; passes with the safe step, converged Newton, BDF2 and TR-BDF2",
    },
    KnownMiss {
        part: "overload",
        cases: &["svk crushed to 1 % clamped"],
        checks: &[MORE_ENERGY],
        reason: MANY_MINIMA,
    },
    KnownMiss {
        part: "overload",
        cases: &["tqs crushed to 1 % clamped"],
        checks: &[MORE_ENERGY],
        reason: MANY_MINIMA,
    },
];

/// The known miss of a case, if it has one.
fn known_miss(case: &Case) -> Option<&'static KnownMiss> {
    KNOWN_MISSES.iter().find(|k| k.part == case.part.name && k.cases.contains(&&*case.name))
}

/// Every case of every group.
fn all_cases() -> Result<Vec<Case>, MeshError> {
    let mut cases = Vec::new();
    for build in [
        cantilever::cases,
        release::cases,
        collapse::cases,
        shape::cases,
        spin::cases,
        motion::cases,
        resection::cases,
        membranes::cases,
        axes::cases,
        input::cases,
        overload::cases,
        contact::cases,
    ] {
        cases.extend(build()?.0);
    }
    Ok(cases)
}

/// Runs the suite; cases run side by side, one thread each. `tell` hears how many of how many are done.
///
/// # Errors
/// When a mesh cannot be generated, the options make no sense or the environment names no usable
/// instruction set.
pub fn run(
    options: &SuiteOptions,
    tell: impl Fn(usize, usize) + Sync,
) -> Result<Suite, SuiteError> {
    let start = Instant::now();
    if let Some(&group) = options.groups.iter().find(|g| !(1..=13).contains(*g)) {
        return Err(SuiteError::Group(group));
    }
    if options.integrators.iter().any(|i| !i.facts().dynamic) {
        return Err(SuiteError::QuasiStatic);
    }
    let instruction_set = InstructionSet::default_set()?;
    let mut cases = all_cases()?;
    let wanted = |group: u8| options.groups.is_empty() || options.groups.contains(&group);
    let named = |name: &str| {
        options.cases.is_empty() || options.cases.iter().any(|part| name.contains(part))
    };
    cases.retain(|case| {
        wanted(case.part.group) && named(&case.name) && (case.quick || !options.quick)
    });
    if cases.is_empty() {
        return Err(SuiteError::NoCase);
    }
    let columns = options.columns();
    let jobs: Vec<Job> = jobs(&cases, &columns);
    let done = AtomicUsize::new(0);
    let run = |job: &Job| {
        let row = job.run(options.precision);
        tell(done.fetch_add(1, Ordering::Relaxed) + 1, jobs.len());
        row
    };
    let mut rows: Vec<Option<Row>> = jobs.par_iter().map(run).collect();
    // one after the other: a thread that waits for another pool would take up further cases meanwhile
    for (job, row) in jobs.iter().zip(&mut rows).filter(|(job, _)| job.sampled) {
        if let Some(row) = row {
            job.repeat(options.precision, row);
        }
    }
    let mut rows: Vec<Row> = rows.into_iter().flatten().collect();
    rows.sort_by_key(|row| row.part.group);
    Ok(Suite {
        schema: "sinew-stability/3",
        command: options.command(),
        machine: crate::bench::machine::MachineNotes::now(),
        quick: options.quick,
        precision: options.precision.name(),
        instruction_set,
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
        let wanted = |c: &Column| case.scope == Scope::Every || c.model == Column::DEFAULT.model;
        match case.scope {
            Scope::Once => add(None, true),
            Scope::Explicit => Integrator::ALL
                .iter()
                .filter(|i| i.is_explicit())
                .for_each(|&integrator| add(Some(Column { integrator, ..Column::DEFAULT }), true)),
            Scope::Robust => {
                let concerned = |c: &&Column| c.required() || c.recovers() && c.other_elements();
                columns.iter().filter(concerned).for_each(|&c| add(Some(c), c.required()));
            }
            Scope::Every | Scope::Integrators => {
                columns.iter().filter(|c| wanted(c)).for_each(|&c| add(Some(c), c.required()))
            }
        }
    }
    jobs
}

impl Job<'_> {
    fn setting(&self, precision: Precision, threads: usize) -> Setting {
        Setting { column: self.column.unwrap_or(Column::DEFAULT), precision, threads }
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

    /// Runs the case; none, where it cannot be cut into the cells of the column.
    fn run(&self, precision: Precision) -> Option<Row> {
        let start = Instant::now();
        let setting = self.setting(precision, 1);
        let mut row = Row {
            part: self.case.part,
            case: self.case.name.clone(),
            column: self.column,
            status: Status::Fail,
            required: self.required,
            known: known_miss(self.case).filter(|_| self.required),
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
            Err(problem) if problem.is::<OtherCells>() => return None,
            Err(problem) => row.note = problem.to_string(),
        }
        row.seconds = start.elapsed().as_secs_f64();
        Some(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_known_miss_is_of_a_case() {
        let cases = all_cases().unwrap();
        for known in &KNOWN_MISSES {
            for name in known.cases {
                let of = |case: &Case| case.name == *name && known_miss(case) == Some(known);
                assert!(cases.iter().any(of), "{name}: {known:?}");
            }
        }
    }

    /// A row of a listed case with these checks.
    fn row(checks: Vec<Check>) -> Row {
        let part = Part { group: 1, name: "cantilevers", criterion: "" };
        let status = match checks.iter().all(|c| c.pass) && !checks.is_empty() {
            true => Status::Pass,
            false => Status::Fail,
        };
        Row {
            part,
            case: String::new(),
            column: None,
            status,
            required: true,
            known: Some(&KNOWN_MISSES[0]),
            checks,
            figures: Figures::default(),
            note: String::new(),
            seconds: 0.0,
        }
    }

    #[test]
    fn a_known_miss_excuses_nothing_else() {
        let missed = || Check::none(INVERTED, 1);
        assert!(row(vec![missed(), Check::none("other", 0)]).excused());
        assert!(!row(vec![missed(), Check::none("other", 1)]).excused());
        assert!(!row(vec![Check::none(INVERTED, 0)]).excused(), "it passes");
        assert!(!row(Vec::new()).excused(), "an error is no miss");
        assert!(!Row { known: None, ..row(vec![missed()]) }.excused());
        assert!(
            !Check::at_most("", f64::NAN, 1.0).pass && !Check::at_least("", f64::NAN, 1.0).pass
        );
    }
}
