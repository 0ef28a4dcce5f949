//! Group 5: momentum of spinning and flying bodies.

use super::prelude::*;
use crate::bench::integrators::spin_elsewhere;

const SPIN: CasePart = CasePart {
    group: 5,
    name: "spin at 100 rad/s",
    criterion: "linear momentum to 1e-10; angular momentum kept as the method has it",
};
const FLIGHT: CasePart = CasePart {
    group: 5,
    name: "free flight",
    criterion: "linear momentum and centre of mass as the scheme's closed form, to 1e-10",
};
const STEPS: [f64; 4] = [1e-4, 1e-3, 1e-2, 1.0 / 60.0];
/// The bar (m) for which the angular momentum that integrators keep was measured by a reference program, written apart
/// from this one in Python with direct solves ([`spin_elsewhere`] has its table).
const SIZE: DVec3 = DVec3::new(0.2, 0.05, 0.05);

pub(super) fn cases() -> Result<Cases, MeshError> {
    let mesh = Arc::new(jitter_interior(&box_tets(SIZE, [8, 2, 2])?, 0.15, 5)?);
    let mut cases = Cases::default();
    for (place, dt) in STEPS.into_iter().enumerate() {
        let name = format!("h {dt:.4}");
        cases.add(SPIN, name, true, &mesh, move |s, mesh| spin(s, mesh, place));
        let name = format!("(1, 2, 3) rad/s, h {dt:.4}");
        cases.add(FLIGHT, name, true, &mesh, move |s, mesh| fly(s, mesh, dt));
    }
    Ok(cases)
}

/// Mass (kg), centre of mass (m), momentum (kg m/s), angular momentum about the centre (kg m^2/s) and
/// the sum of m |v| (kg m/s).
pub(super) struct Momenta {
    pub mass: f64,
    pub centre: DVec3,
    pub linear: DVec3,
    pub angular: DVec3,
    pub size: f64,
}

pub(super) fn momenta(run: &mut CaseRun) -> Momenta {
    let m = run.simulation.masses(run.body);
    let u = run.simulation.displacements(run.body);
    let v = run.simulation.velocities(run.body);
    let x: Vec<DVec3> = run.mesh.points.iter().zip(&u).map(|(x, u)| *x + *u).collect();
    let mass: f64 = m.iter().sum();
    let centre = m.iter().zip(&x).map(|(m, x)| *m * *x).sum::<DVec3>() / mass;
    let linear = m.iter().zip(&v).map(|(m, v)| *m * *v).sum();
    let angular = (0..m.len()).map(|i| m[i] * (x[i] - centre).cross(v[i])).sum();
    let size = m.iter().zip(&v).map(|(m, v)| m * v.length()).sum();
    Momenta { mass, centre, linear, angular, size }
}

/// Turns about the centre of mass (rad/s) and flies (m/s).
fn launch(run: &mut CaseRun, turn: DVec3, flight: DVec3) -> Result<Momenta> {
    let centre = momenta(run).centre;
    let v: Vec<DVec3> = run.mesh.points.iter().map(|x| flight + turn.cross(*x - centre)).collect();
    run.place(&vec![DVec3::ZERO; v.len()], &v)?;
    Ok(momenta(run))
}

fn spin(setting: &CaseSetting, mesh: &Mesh, place: usize) -> CaseOutcome {
    let mut run = CaseRun::new(setting, mesh, tissue(1e5, 0.3))?;
    let dt = STEPS[place];
    let start = launch(&mut run, DVec3::Z * 100.0, DVec3::ZERO)?;
    let scale = run.energy();
    let mut drift = 0.0_f64;
    run.simulation.set_dt(dt);
    for _ in 0..(0.1 / dt).round() as u64 {
        run.step()?;
        drift = drift.max(momenta(&mut run).linear.length() / start.size);
    }
    let kept = momenta(&mut run).angular.z / start.angular.z;
    let mut checks = vec![Check::at_most("drift of momentum", drift, setting.pick(1e-10, 1e-5))];
    let facts = setting.column.integrator.facts();
    // percent kept, from another program; steps that may fall back are not compared
    let falls_back = facts.multistep && !facts.converges;
    let expected = spin_elsewhere(setting.column.integrator, place).filter(|_| !falls_back);
    if facts.explicit {
        let limit = setting.pick(1e-12, 1e-5);
        checks.push(Check::at_most("angular momentum lost", (1.0 - kept).abs(), limit));
    } else if let Some([expected, _]) = expected {
        let off = (100.0 * kept - expected).abs();
        checks.push(Check::at_most("points off the angular momentum expected", off, 2.0));
    } else if dt < 0.005 {
        let limit = if place == 0 { 0.998 } else { 0.98 };
        checks.push(Check::at_least("angular momentum kept", kept, limit));
    }
    Ok(run.finish(scale, checks))
}

fn fly(setting: &CaseSetting, mesh: &Mesh, dt: f64) -> CaseOutcome {
    let mut run = CaseRun::new(setting, mesh, tissue(1e5, 0.3))?;
    run.simulation.set_gravity(GRAVITY);
    let turn = DVec3::new(1.0, 2.0, 3.0);
    let start = launch(&mut run, turn, DVec3::new(0.3, -0.2, 0.5))?;
    let scale = run.energy() + start.mass * 9.81 * SIZE.x;
    run.simulation.set_dt(dt);
    let mut fall = Fall::new(start.centre, start.linear / start.mass);
    let (mut off_course, mut off_speed) = (0.0_f64, 0.0_f64);
    for _ in 0..((0.1 / dt).round() as u64).min(100) {
        run.step()?;
        fall.step(setting.column.integrator, run.simulation.report(), dt, GRAVITY);
        let now = momenta(&mut run);
        off_course = off_course.max(now.centre.distance(fall.x) / SIZE.x);
        let drift = now.linear.distance(start.mass * fall.v) / start.size;
        off_speed = off_speed.max(drift);
    }
    let limit = setting.pick(1e-10, 1e-5);
    let checks = [
        Check::at_most("centre of mass off its course over size", off_course, limit),
        Check::at_most("momentum off its value", off_speed, limit),
    ];
    Ok(run.finish(scale, checks))
}
