//! Group 2: a cube crushed between its faces and let go.

use super::prelude::*;

const PART: CasePart = CasePart {
    group: 2,
    name: "crushed and released",
    criterion: "none inverted while held at 50 and 80 %; after release edge error < 1 %, none inverted",
};
const CELL: f64 = 0.02;

pub(super) fn cases() -> Result<Cases, MeshError> {
    let mesh = Arc::new(jitter_interior(&box_tets(DVec3::splat(4.0 * CELL), [4, 4, 4])?, 0.15, 2)?);
    let mut cases = Cases::default();
    for squeeze in [0.5, 0.8, 0.95] {
        for nu in [0.3, 0.45, 0.49] {
            for dt in [1.0 / 60.0, 0.1] {
                let name = format!("{:.0} % nu {nu} h {dt:.4}", 100.0 * squeeze);
                let quick = nu != 0.49 && squeeze != 0.8;
                let run = move |s: &CaseSetting, mesh: &Mesh| crush(s, mesh, squeeze, nu, dt);
                cases.add(PART, name, quick, &mesh, run);
            }
        }
    }
    Ok(cases)
}

fn crush(setting: &CaseSetting, mesh: &Mesh, squeeze: f64, nu: f64, dt: f64) -> CaseOutcome {
    let mut run = CaseRun::damped(setting, mesh, nu)?;
    run.simulation.set_dt(dt);
    let ramp = (0.5 / dt).round() as u64;
    for (side, way) in [("x0", 2.0 * CELL), ("x1", -2.0 * CELL)] {
        let motion = Motion::Translate(DVec3::X * way * squeeze);
        let rows = run.side(side)?;
        let mut constraint = Constraint::moving(side, rows, motion, Curve::ramp(0.0, 0.5));
        constraint.until = (ramp as f64 + 10.5) * dt;
        run.simulation.add_constraint(constraint);
    }
    run.steps(ramp)?;
    let held = run.held_steps()?;
    let scale = run.open_books();
    run.steps((1.5 / dt).round() as u64)?;
    let mut checks = run.recovered().to_vec();
    if squeeze < 0.9 {
        checks.push(Check::none("inverted while held", held));
    }
    Ok(run.finish(scale, checks))
}
