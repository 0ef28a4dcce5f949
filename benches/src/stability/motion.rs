//! Groups 6 and 7: bars twisted, stretched, teleported, and held and let go at every step.

use super::prelude::*;
use std::f64::consts::TAU;

const DRIVEN: CasePart = CasePart {
    group: 6,
    name: "twist 4 turns, stretch 5 x",
    criterion: "none inverted while held (nu 0.3); 2 s after release edge error < 1 %, none inverted",
};
const TELEPORT: CasePart = CasePart {
    group: 7,
    name: "teleport",
    criterion: "none inverted while held (nu 0.3); 2 s after release edge error < 1 %, none inverted",
};
const TOGGLED: CasePart = CasePart {
    group: 7,
    name: "constraints on and off",
    criterion: "2 s later edge error < 1 %, none inverted",
};
const SIZE: DVec3 = DVec3::new(0.2, 0.04, 0.04);
/// Steps (s) and for how long (s): the step changes on the way, two seconds together.
const CHANGES: [(f64, f64); 4] = [(1.0 / 60.0, 0.7), (0.1, 0.6), (0.001, 0.1), (1.0 / 60.0, 0.6)];

pub(super) fn cases() -> Result<Cases, MeshError> {
    let mesh = Arc::new(jitter_interior(&box_tets(SIZE, [10, 2, 2])?, 0.15, 6)?);
    let mut cases = Cases::default();
    for nu in [0.3, 0.45] {
        let motions = [
            ("twist", Motion::Rotate { centre: 0.5 * SIZE, axis: DVec3::X, angle: 4.0 * TAU }),
            ("stretch", Motion::Translate(DVec3::X * 4.0 * SIZE.x)),
        ];
        for (name, motion) in motions {
            let (name, quick) = (format!("{name} nu {nu}"), nu == 0.3);
            cases.add(DRIVEN, name, quick, &mesh, move |s, mesh| drive(s, mesh, &motion, nu));
        }
        for dt in [1.0 / 60.0, 0.1] {
            let quick = nu == 0.3 && dt < 0.1;
            let name = format!("one body length, nu {nu} h {dt:.4}");
            cases.add(TELEPORT, name, quick, &mesh, move |s, mesh| teleport(s, mesh, nu, dt));
            let name = format!("100 steps, nu {nu} h {dt:.4}");
            cases.add(TOGGLED, name, quick, &mesh, move |s, mesh| toggle(s, mesh, nu, dt));
        }
    }
    Ok(cases)
}

fn drive(setting: &CaseSetting, mesh: &Mesh, motion: &Motion, nu: f64) -> CaseOutcome {
    let mut run = CaseRun::damped(setting, mesh, nu)?;
    let held = run.clamp("x0")?;
    let rows = run.side("x1")?;
    let moving = Constraint::moving("x1", rows, motion.clone(), Curve::ramp(0.0, 2.0));
    let moving = run.simulation.add_constraint(moving);
    for (dt, seconds) in CHANGES {
        run.seconds(dt, seconds)?;
    }
    let inverted = run.held_steps()?;
    for entity in [held, moving] {
        run.simulation.world_mut().despawn(entity);
    }
    let scale = run.open_books();
    for (dt, seconds) in CHANGES {
        run.seconds(dt, seconds)?;
    }
    let mut checks = run.recovered().to_vec();
    if nu == 0.3 {
        checks.push(Check::none("inverted while held", inverted));
    }
    Ok(run.finish(scale, checks))
}

fn teleport(setting: &CaseSetting, mesh: &Mesh, nu: f64, dt: f64) -> CaseOutcome {
    let mut run = CaseRun::damped(setting, mesh, nu)?;
    run.clamp("x0")?;
    run.simulation.set_dt(dt);
    run.step()?;
    let tip = nearest(&mesh.points, SIZE) as u32;
    let rows = run.simulation.rows(run.body, "tip", &[tip])?;
    let motion = Motion::Translate(DVec3::new(0.0, 0.6, 0.8) * SIZE.x);
    let jump = Constraint::moving("tip", rows, motion, Curve::Constant);
    let jump = run.simulation.add_constraint(jump);
    run.steps(10)?;
    let inverted = run.held_steps()?;
    run.simulation.world_mut().despawn(jump);
    let scale = run.open_books();
    run.seconds(dt, 2.0)?;
    let mut checks = run.recovered().to_vec();
    if nu == 0.3 {
        checks.push(Check::none("inverted while held", inverted));
    }
    Ok(run.finish(scale, checks))
}

fn toggle(setting: &CaseSetting, mesh: &Mesh, nu: f64, dt: f64) -> CaseOutcome {
    let mut run = CaseRun::damped(setting, mesh, nu)?;
    run.clamp("x0")?;
    run.simulation.set_dt(dt);
    // bent by a half turn
    let u = bend(mesh, 2.0 * SIZE.x / TAU);
    run.place_still(&u)?;
    let scale = run.energy();
    let mut random = CaseRandom(0x4567_89ab_cdef_1234);
    let vertices = mesh.points.len() as u32;
    for _ in 0..100 {
        let some: Vec<u32> = (0..vertices).filter(|_| random.number() < 0.3).collect();
        let rows = run.simulation.rows(run.body, "held", &some)?;
        let held = run.simulation.add_constraint(Constraint::hold("held", rows));
        run.step()?;
        run.simulation.world_mut().despawn(held);
    }
    run.seconds(dt, 2.0)?;
    let checks = run.recovered();
    Ok(run.finish(scale, checks))
}
