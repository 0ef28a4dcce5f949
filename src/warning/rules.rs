//! What happened during a run and deserves a word: a row of [`RULES`] for each.

use super::Level::{self, Note, Warning};
use super::totals::RunTotals;
use crate::simulation::Backend;
use bevy_ecs::prelude::World;
use sinew_contact::set::ContactSet;
use sinew_contact::thread::ThreadReport;
use sinew_engine::compression::COMPRESSED;
use sinew_engine::precision::Precision;
use sinew_engine::topology::Topology;
use sinew_solvers::settings::{Integrator, SolverSettings};

/// A run so far.
pub(super) struct Run<'a> {
    pub world: &'a World,
    pub totals: &'a RunTotals,
}

impl Run<'_> {
    fn steps(&self) -> u64 {
        self.totals.steps
    }

    fn integrator(&self) -> Integrator {
        self.world
            .get_resource::<SolverSettings>()
            .map_or_else(Integrator::default, |s| s.integrator)
    }

    /// Sum over threads and clips.
    fn threads(&self, of: fn(&ThreadReport) -> u32) -> u64 {
        let query = self.world.try_query::<&ThreadReport>();
        query.map_or(0, |mut query| query.iter(self.world).map(|own| u64::from(of(own))).sum())
    }

    /// A tool and a body that it may pass through unfelt.
    fn sparse(&self) -> Option<String> {
        let (tool, body) = self.world.get_resource::<ContactSet>()?.sparse()?;
        let body = self.world.get_resource::<Topology>()?.bodies.get(body)?;
        Some(format!("`{tool}` on `{}`", body.name))
    }
}

/// A warning and when it is due.
struct Rule {
    level: Level,
    code: &'static str,
    subject: &'static str,
    /// How often it happened, 0 when there is nothing to say.
    count: fn(&Run) -> u64,
    message: fn(&Run, u64) -> String,
    remedy: &'static str,
}

/// Warnings of a run in the order of the report.
pub(super) fn run_warnings(run: &Run) -> Vec<super::Warning> {
    if run.totals.steps == 0 {
        return Vec::new();
    }
    let due = RULES.iter().map(|rule| (rule, (rule.count)(run))).filter(|(_, count)| *count > 0);
    due.map(|(rule, count)| {
        let message = (rule.message)(run, count);
        super::Warning::new(rule.code, rule.level, rule.subject, message, rule.remedy)
    })
    .collect()
}

/// Rows of level, code and subject; how often it happened; what is said of that; what to do.
macro_rules! rules {
    ($($level:ident $code:literal $subject:literal: |$run:ident| $count:expr;
       |$n:ident| $($message:expr),+; $remedy:literal;)*) => {
        static RULES: &[Rule] = &[$(Rule {
            level: $level,
            code: $code,
            subject: $subject,
            count: |$run| $count,
            message: |$run, $n| {
                let _ = ($run, $n);
                format!($($message),+)
            },
            remedy: $remedy,
        }),*];
    };
}

rules! {
    Warning "run.inverted" "elements": |run| run.totals.volume.inverted_max;
        |n| "up to {n} elements were turned inside out, {} at the end", run.totals.volume.inverted_final;
        "make loads and motions smaller or slower there, or use smaller steps or a finer mesh";
    Warning "run.compression" "elements": |run| run.totals.volume.compressed_max;
        |n| "up to {n} elements (or biquadratic fibres) were pressed to less than {COMPRESSED} of their length, where St \
             Venant-Kirchhoff resists far too little";
        "forces there are too small: use model = \"neo_hookean\" or \"svk_volume\", which get stiffer as tissue does, and \
         fibres of form = \"stretch\"";
    Warning "run.cg.cap" "solver": |run| run.totals.sums.cg_caps;
        |n| "{n} linear solves stopped at the iteration cap";
        "raise solver.max_linear_iterations or linear_tolerance";
    Warning "run.gpu.stalled" "gpu": |run| run.totals.gpu_stalled;
        |n| "{n} linear solves could not be brought to the tolerance in f32; worst residual {:.1e}",
            run.totals.solver.worst_residual;
        "raise solver.linear_tolerance, or use backend = \"cpu\"";
    Warning "run.newton.unconverged" "solver":
        |run| run.totals.solver.unconverged_steps - run.totals.solver.unconverged_in_contact;
        |n| "Newton did not converge in {n} of {} steps", run.steps();
        "use a smaller dt, a smaller linear_tolerance or more max_newton_iterations";
    Warning "run.newton.contact" "contact":
        |run| run.totals.solver.unconverged_in_contact;
        |n| "Newton did not converge in {n} of {} steps with something in contact; but for exact contact, what was touched \
             took a safe step of first order then", run.steps();
        "use integrator = \"auto\" or \"safe\", or a smaller dt";
    Warning "run.gradient" "solver": |run| run.totals.sums.gradient_fallbacks;
        |n| "{n} linear solves fell back to a gradient step";
        "elements are far out of shape: use a smaller dt, or precision = \"f64\" where the mesh has slivers";
    Warning "run.line-search" "solver": |run| run.totals.sums.line_search_failures;
        |n| "in {n} steps a body was halted where it was, no lower energy was found";
        "use a smaller dt or a smaller linear_tolerance";
    Warning "run.energy.cap" "solver": |run| run.totals.sums.energy_caps;
        |n| "in {n} steps a body was slowed down to keep its energy bounded";
        "the motion is damped there; use a smaller dt where it matters";
    Note "run.backtrack" "solver":
        |run| if run.integrator().converges() { 0 } else { run.totals.sums.backtracks };
        |n| "{n} steps were shortened by the line search";
        "the motion is damped there; use a smaller dt where it matters";
    Note "run.not-robust" "solver": |run| run.integrator().facts().caution.is_some().into();
        |n| "{}", run.integrator().facts().caution.unwrap_or_default();
        "compare with integrator = \"tr-bdf2\", or leave the integrator out";
    Note "run.recovery" "solver": |run| run.totals.sums.recovering;
        |n| "in {n} steps a body moved by the corotational energy, without pressure";
        "such steps are no motion of the material; its own law is back when it is in shape again";
    Warning "run.recovery.unfinished" "solver": |run| run.totals.solver.recovering_final.into();
        |n| "{n} bodies were still in recovery at the end: the last state is not that of their material";
        "run longer, or remove the load or constraint that crushes them";
    Warning "run.recovery.given-up" "solver": |run| run.totals.sums.recoveries_given_up;
        |n| "{n} recoveries from inversion came to rest out of shape and were given up";
        "a constraint holds the body crushed; it recovers when that changes";
    Warning "run.recovery.refused" "solver": |run| run.totals.sums.recoveries_refused;
        |n| "in {n} steps a body with many inverted elements did not recover, since its loads crush it";
        "make loads or pressures smaller, or the material stiffer";
    Warning "run.recovery.energy" "energy":
        |run| (run.totals.energy.recovery_turnover > LARGE_SWAP * run.totals.energy.elastic_max).into();
        |n| "recovery changed the elastic energy by {:.2e} J by changing laws",
            run.totals.energy.recovery_turnover;
        "compare with recovery = false; the motion meanwhile is not that of the material";
    Warning "run.contact.unconverged" "contact": |run| run.totals.contact.unconverged;
        |n| "{n} inner loops of contact ended at their cap, in {} steps", run.steps();
        "use a smaller dt, or a smaller stiffness of tools and contacts";
    Warning "run.contact.forces" "contact": |run| run.totals.contact.missed;
        |n| "forces did not converge in {n} of the {} steps in which something touched; peaks leave them out",
            run.totals.contact.touching;
        "use integrator = \"auto\" or \"safe\", a smaller dt, or a smaller stiffness of tools and contacts";
    Warning "run.contact.depth" "contact": |run| (run.totals.contact.depth_over_edge > DEEP).into();
        |n| "points were up to {:.2} edges deep in what they touch",
            run.totals.contact.depth_over_edge;
        "use a finer mesh, slower tools or a larger stiffness of tools and contacts";
    Warning "run.contact.lag" "tools": |run| run.totals.contact.lagging;
        |n| "in {n} steps a tool stayed behind its path, by {:.2e} m at most",
            run.totals.contact.lag;
        "move it more slowly, or use a smaller dt";
    Warning "run.contact.drawn-in" "tools": |run| run.totals.contact.drawn_in;
        |n| "{n} times a part of a tool, or a body, appeared inside of a body and was drawn in until that made way";
        "let tools and bodies start outside of each other";
    Warning "run.contact.buried" "contact": |run| run.totals.contact.buried;
        |n| "{n} times a tool was wholly inside of a body, or a point too deep inside to tell its sides: it touched nothing";
        "let tools and bodies start apart, or use a smaller dt";
    Warning "run.contact.pierced" "tools": |run| run.totals.contact.pierced;
        |n| "{n} times a part of a tool was inside of a body whose surface it had gone through: it touched nothing of it";
        "press less deep, use a finer mesh or a thicker tool; remove elements where the tool is meant to go through";
    Warning "run.contact.sparse" "tools": |run| run.sparse().is_some().into();
        |n| "tool {} meets nothing but vertices, which are farther apart than it is thick: it may pass between them unfelt",
            run.sparse().unwrap_or_default();
        "leave out what asks for vertices (exact, points = \"vertex\"), or use a thicker tool or a finer mesh";
    Warning "run.thread.lost" "threads": |run| run.threads(|own| own.lost);
        |n| "{n} points of threads and clips were lost: elements that held them were removed, or an end slipped off";
        "hold them elsewhere, or give the end a longer tail or a knot";
    Note "run.clip.broken" "threads": |run| run.threads(|own| own.broken.into());
        |n| "{n} clips broke";
        "nothing to do; a larger strength holds more";
    Note "run.contact.impact" "contact": |run| run.totals.contact.impacts;
        |n| "in {n} steps a body took a step of first order because of an impact";
        "nothing to do; a smaller dt resolves impacts better";
    Note "run.load-parts" "solver": |run| run.totals.sums.load_partings;
        |n| "loads were applied in parts, {n} halvings";
        "nothing to do; a larger load_steps may save the failed attempts";
    Note "run.refinement" "solver": |run| run.totals.sums.refinements;
        |n| "substeps were halved {n} times because the energy grew";
        "nothing to do; a smaller explicit_safety avoids the repetition";
    Note "run.projection" "solver": |run| run.totals.sums.projections;
        |n| "{n} steps or iterations used the projected tangent";
        "nothing to do; a sign of strong compression, inverted elements or large steps";
    Warning "run.energy.gain" "energy": |run| (energy_gain(run) > allowed_gain(run)).into();
        |n| "{:.2e} J more at the end than was put in", energy_gain(run);
        "use a smaller dt or integrator = \"safe\"";
}

/// Depth over an edge above which it is told.
const DEEP: f64 = 0.5;

/// Energy that recovery turns over, over the largest elastic energy, above which it is told.
const LARGE_SWAP: f64 = 0.01;

/// Energy (J) from nowhere.
fn energy_gain(run: &Run) -> f64 {
    -run.totals.energy.dissipated.unwrap_or(0.0)
}

/// Energy (J) that rounding, or the budget of the integrator, may add.
fn allowed_gain(run: &Run) -> f64 {
    let (e, integrator) = (&run.totals.energy, run.integrator());
    // what runs on the device is f32 whatever the columns hold
    let single = run.world.get_resource() == Some(&Backend::Gpu)
        || run.world.get_resource() == Some(&Precision::F32);
    let share = match single {
        _ if integrator.facts().energy_swings => 1e-2,
        false => 1e-6,
        true => 1e-3,
    };
    share * e.put_in()
}
