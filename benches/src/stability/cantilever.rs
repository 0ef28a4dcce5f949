//! Group 1: cantilevers over a grid of steps and materials, and explicit steps beyond their limit.

use super::prelude::*;
use sinew::engine::step::StepError;

const GRID: CasePart = CasePart {
    group: 1,
    name: "cantilevers",
    criterion: "none inverted where rho g L < 2 (lambda + mu)",
};
const LIMITS: CasePart = CasePart {
    group: 1,
    name: "explicit step limit",
    criterion: "beyond it a typed error, state intact, or substeps; never garbage",
};
const LENGTH: f64 = 0.3;
/// Least number of steps, and least time (s): the softest beams are in full fall by then.
const STEPS: u64 = 30;
const SECONDS: f64 = 0.3;

pub(super) fn cases() -> Result<Cases, MeshError> {
    let size = DVec3::new(LENGTH, 0.075, 0.075);
    let mesh = Arc::new(jitter_interior(&box_tets(size, [12, 3, 3])?, 0.15, 1)?);
    let mut cases = Cases::default();
    for dt in [1e-4, 1e-3, 1e-2, 1.0 / 30.0, 0.1] {
        for young in [1e3, 1e4, 1e5, 1e6, 1e7] {
            for nu in [0.0, 0.3, 0.45, 0.49, 0.499] {
                let few = [1e3, 1e5, 1e7].contains(&young) && [0.0, 0.45, 0.499].contains(&nu);
                let quick = if dt == 1e-4 {
                    (young, nu) == (1e3, 0.45)
                } else {
                    few && [1e-2, 0.1].contains(&dt)
                };
                let name = format!("h {dt:.4} E {young:.0e} nu {nu}");
                cases.add(GRID, name, quick, &mesh, move |s, mesh| swing(s, mesh, young, nu, dt));
                if dt == 0.1 && [1e3, 1e7].contains(&young) && [0.0, 0.499].contains(&nu) {
                    let (name, quick) = (format!("E {young:.0e} nu {nu}"), young == 1e3);
                    let run = move |s: &CaseSetting, mesh: &Mesh| limit(s, mesh, young, nu);
                    cases.within(Scope::Explicit, LIMITS, name, quick, &mesh, run);
                }
            }
        }
    }
    Ok(cases)
}

fn hanging<'a>(setting: &CaseSetting, mesh: &'a Mesh, young: f64, nu: f64) -> Result<CaseRun<'a>> {
    let mut run = CaseRun::new(setting, mesh, tissue(young, nu))?;
    run.simulation.set_gravity(GRAVITY);
    run.clamp("x0")?;
    Ok(run)
}

fn swing(setting: &CaseSetting, mesh: &Mesh, young: f64, nu: f64, dt: f64) -> CaseOutcome {
    let mut run = hanging(setting, mesh, young, nu)?;
    run.simulation.set_dt(dt);
    let mass = run.mass();
    run.steps(STEPS.max((SECONDS / dt).round() as u64))?;
    // the compression term gives way above a nominal stress of 2 (lambda + mu)
    let lame = tissue(young, nu).lame()?;
    let loaded = 1000.0 * 9.81 * LENGTH;
    let inverted = run.figures.most_inverted;
    let check = (loaded < 2.0 * (lame.lambda + lame.mu))
        .then(|| Check::none("most inverted in a step", inverted));
    Ok(run.finish(mass * 9.81 * LENGTH, check))
}

/// Steps from a tenth to ten thousand times the limit, with one substep allowed.
fn limit(setting: &CaseSetting, mesh: &Mesh, young: f64, nu: f64) -> CaseOutcome {
    let mut run = hanging(setting, mesh, young, nu)?;
    let mass = run.mass();
    run.simulation.set_dt(1e-6);
    run.step()?;
    let stable = run.simulation.stable_step();
    run.solver(|s| s.max_substeps = 1);
    let mut checks = Vec::new();
    for factor in [0.1, 0.5, 1.2, 10.0, 1e4] {
        run.simulation.set_dt(factor * stable);
        let (hash, time) = (run.simulation.state_hash(), run.simulation.time());
        if factor < 0.9 {
            run.steps(10)?;
            continue;
        }
        let refused = match run.simulation.step() {
            Err(StepError::Diverged { reason, .. }) => reason.contains("substeps"),
            _ => false,
        };
        let intact = run.simulation.state_hash() == hash && run.simulation.time() == time;
        checks.push(Check::holds("refused beyond the limit", refused));
        checks.push(Check::holds("state intact after the refusal", intact));
    }
    // with substeps allowed the same step is carried out
    run.solver(|_| ());
    run.simulation.set_dt(10.0 * stable);
    run.steps(3)?;
    let substeps = f64::from(run.simulation.report().substeps);
    checks.push(Check::at_least("substeps of ten limits", substeps, 10.0));
    Ok(run.finish(mass * 9.81 * LENGTH, checks))
}
