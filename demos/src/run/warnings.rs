//! What happened during a run and deserves a word: a row of [`RULES`] for each.

use super::facts::RunFacts;
use crate::warning;
use crate::warning::Level::{self, Note, Warning};
use sinew::simulation::{Backend, Precision};

/// A warning and when it is due.
struct Rule {
    level: Level,
    code: &'static str,
    subject: &'static str,
    /// How often it happened, 0 when there is nothing to say.
    count: fn(&RunFacts) -> u64,
    message: fn(&RunFacts, u64) -> String,
    remedy: &'static str,
}

/// Warnings of a run in the order of the report.
pub(super) fn run_warnings(run: &RunFacts) -> Vec<warning::Warning> {
    let due = RULES.iter().map(|rule| (rule, (rule.count)(run))).filter(|(_, count)| *count > 0);
    due.map(|(rule, count)| {
        let message = (rule.message)(run, count);
        warning::Warning::new(rule.code, rule.level, rule.subject, message, rule.remedy)
    })
    .collect()
}

static RULES: [Rule; 14] = [
    Rule {
        level: Warning,
        code: "run.inverted",
        subject: "elements",
        count: |run| run.totals.volume.inverted_max,
        message: |run, n| {
            let at_the_end = run.totals.volume.inverted_final;
            format!("up to {n} elements were turned inside out, {at_the_end} at the end")
        },
        remedy: "use model = \"svk_comp\", smaller steps or a finer mesh where it happens",
    },
    Rule {
        level: Warning,
        code: "run.cg.cap",
        subject: "solver",
        count: |run| run.totals.solver.cg_caps,
        message: |_, n| format!("{n} linear solves stopped at the iteration cap"),
        remedy: "raise solver.max_linear_iterations or linear_tolerance",
    },
    Rule {
        level: Warning,
        code: "run.gpu.stalled",
        subject: "gpu",
        count: |run| run.totals.gpu.as_ref().map_or(0, |gpu| gpu.stalled),
        message: |run, n| {
            let worst = run.totals.solver.worst_residual;
            format!(
                "{n} linear solves could not be brought to the tolerance in f32; worst residual {worst:.1e}"
            )
        },
        remedy: "raise solver.linear_tolerance, or use backend = \"cpu\"",
    },
    Rule {
        level: Warning,
        code: "run.newton.unconverged",
        subject: "solver",
        count: |run| if run.is_dynamic() { run.totals.solver.unconverged_steps } else { 0 },
        message: |run, n| format!("Newton did not converge in {n} of {} steps", run.steps()),
        remedy: "use a smaller dt, a smaller linear_tolerance or more max_newton_iterations",
    },
    Rule {
        level: Warning,
        code: "run.gradient",
        subject: "solver",
        count: |run| run.totals.solver.gradient_fallbacks,
        message: |_, n| format!("{n} linear solves fell back to a gradient step"),
        remedy: "use a smaller dt; elements are far out of shape",
    },
    Rule {
        level: Warning,
        code: "run.line-search",
        subject: "solver",
        count: |run| run.totals.solver.line_search_failures,
        message: |_, n| {
            format!("in {n} steps a body was halted where it was, no lower energy was found")
        },
        remedy: "use a smaller dt or a smaller linear_tolerance",
    },
    Rule {
        level: Warning,
        code: "run.energy.cap",
        subject: "solver",
        count: |run| run.totals.solver.energy_caps,
        message: |_, n| format!("in {n} steps a body was slowed down to keep its energy bounded"),
        remedy: "the motion is damped there; use a smaller dt where it matters",
    },
    Rule {
        level: Note,
        code: "run.backtrack",
        subject: "solver",
        count: |run| if run.integrator().converges() { 0 } else { run.totals.solver.backtracks },
        message: |_, n| format!("{n} steps were shortened by the line search"),
        remedy: "the motion is damped there; use a smaller dt where it matters",
    },
    Rule {
        level: Note,
        code: "run.not-robust",
        subject: "solver",
        count: |run| run.integrator().facts().caution.is_some().into(),
        message: |run, _| run.integrator().facts().caution.unwrap_or_default().into(),
        remedy: "compare with integrator = \"tr-bdf2\", or leave the integrator out",
    },
    Rule {
        level: Note,
        code: "run.recovery",
        subject: "solver",
        count: |run| run.totals.solver.recovering,
        message: |_, n| format!("in {n} steps a body moved by the corotational energy"),
        remedy: "nothing to do; its own law is back when it is in shape again",
    },
    Rule {
        level: Note,
        code: "run.load-parts",
        subject: "solver",
        count: |run| run.totals.solver.load_partings,
        message: |_, n| format!("loads were applied in parts, {n} halvings"),
        remedy: "nothing to do; a larger load_steps may save the failed attempts",
    },
    Rule {
        level: Note,
        code: "run.refinement",
        subject: "solver",
        count: |run| run.totals.solver.refinements,
        message: |_, n| format!("substeps were halved {n} times because the energy grew"),
        remedy: "nothing to do; a smaller explicit_safety avoids the repetition",
    },
    Rule {
        level: Note,
        code: "run.projection",
        subject: "solver",
        count: |run| run.totals.solver.projections,
        message: |_, n| format!("{n} steps or iterations used the projected tangent"),
        remedy: "nothing to do; a sign of strong compression, inverted elements or large steps",
    },
    Rule {
        level: Warning,
        code: "run.energy.gain",
        subject: "energy",
        count: |run| (energy_gain(run) > allowed_gain(run)).into(),
        message: |run, _| format!("{:.2e} J more at the end than was put in", energy_gain(run)),
        remedy: "use a smaller dt or integrator = \"safe\"",
    },
];

/// Energy (J) from nowhere.
fn energy_gain(run: &RunFacts) -> f64 {
    -run.totals.energy.dissipated.unwrap_or(0.0)
}

/// Energy (J) that rounding, or the budget of the integrator, may add.
fn allowed_gain(run: &RunFacts) -> f64 {
    let (e, integrator) = (&run.totals.energy, run.integrator());
    let work = e.load_work.abs() + e.constraint_work.abs() + e.activation_work.abs();
    // what runs on the device is f32 whatever the columns hold
    let single = run.built.simulation.backend() == Backend::Gpu
        || run.built.simulation.precision() == Precision::F32;
    let share = match single {
        _ if integrator.facts().energy_swings => 1e-2,
        false => 1e-6,
        true => 1e-3,
    };
    share * (e.initial + work + e.elastic_max)
}
