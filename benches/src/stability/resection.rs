//! Group 8: elements removed from loaded bars, until what is left hangs on an edge, on a vertex or on
//! nothing.

use super::prelude::*;
use sinew::models::body::present::MassPolicy;
use sinew::models::resection::{Region, Removal};

const REMOVED: CasePart = CasePart {
    group: 8,
    name: "30 % removed, 100 one by one",
    criterion: "what is left equals a fresh build to 1e-12",
};
const HANGING: CasePart = CasePart {
    group: 8,
    name: "hanging on edge, vertex, nothing",
    criterion: "none inverted; what is left equals a fresh build to 1e-12",
};
const LOOSE: CasePart = CasePart {
    group: 8,
    name: "vertex without elements",
    criterion: "closed form of the scheme to 1e-9; stays where it has no mass",
};
const BAR: DVec3 = DVec3::new(0.25, 0.1, 0.1);

pub(super) fn cases() -> Result<Cases, MeshError> {
    let bar = Arc::new(box_tets(BAR, [10, 4, 4])?);
    let short = Arc::new(box_tets(DVec3::new(0.15, 0.1, 0.1), [3, 2, 2])?);
    let coarse = Arc::new(box_tets(BAR, [5, 2, 2])?);
    let mut cases = Cases::default();
    let policies = [("masses kept", MassPolicy::Keep), ("masses summed", MassPolicy::Recompute)];
    for dt in [1.0 / 60.0, 0.1] {
        for (masses, policy) in policies {
            let quick = dt < 0.1 && policy == MassPolicy::Recompute;
            for (name, times) in [("30 % at once", 1), ("100 one by one", 100)] {
                let name = format!("{name}, {masses} h {dt:.4}");
                let run = move |s: &CaseSetting, mesh: &Mesh| remove(s, mesh, policy, times, dt);
                cases.add(REMOVED, name, quick, &bar, run);
            }
            for (name, shared) in [("edge", 2), ("vertex", 1), ("nothing", 0)] {
                let name = format!("{name}, {masses} h {dt:.4}");
                let run = move |s: &CaseSetting, mesh: &Mesh| hang(s, mesh, policy, shared, dt);
                cases.add(HANGING, name, quick, &short, run);
            }
            let (name, quick) = (format!("{masses} h {dt:.4}"), dt < 0.1);
            cases.add(LOOSE, name, quick, &coarse, move |s, mesh| orphan(s, mesh, policy, dt));
        }
    }
    Ok(cases)
}

fn loaded<'a>(setting: &CaseSetting, mesh: &'a Mesh, dt: f64) -> Result<CaseRun<'a>> {
    let mut run = CaseRun::new(setting, mesh, tissue(1e4, 0.45))?;
    run.simulation.set_gravity(GRAVITY);
    run.simulation.set_dt(dt);
    run.clamp("x0")?;
    Ok(run)
}

/// Energy scale (J): the weight of the whole bar times its length.
fn weight(run: &mut CaseRun) -> f64 {
    run.mass() * 9.81 * BAR.x
}

/// Difference from a body built anew; masses count where they were summed again.
fn fresh(run: &mut CaseRun, setting: &CaseSetting, policy: MassPolicy) -> Result<Check> {
    let difference = run.simulation.verify_against_fresh(run.body)?;
    let mass = if policy == MassPolicy::Recompute { difference.mass } else { 0.0 };
    let limit = setting.pick(1e-12, 2e-5);
    Ok(Check::at_most("difference from a fresh build", difference.largest().max(mass), limit))
}

/// Takes away elements of a list in so many parts, with a step after each.
fn cut(run: &mut CaseRun, policy: MassPolicy, gone: &[u32], parts: usize) -> Result<()> {
    for some in gone.chunks(gone.len().div_ceil(parts)) {
        let removal = Removal { region: run.region(some), mass: policy };
        run.remove(&removal)?;
        run.step()?;
    }
    Ok(())
}

fn remove(
    setting: &CaseSetting,
    mesh: &Mesh,
    policy: MassPolicy,
    parts: usize,
    dt: f64,
) -> CaseOutcome {
    let mut run = loaded(setting, mesh, dt)?;
    let scale = weight(&mut run);
    run.steps(20)?;
    let mut all: Vec<u32> = (0..run.elements() as u32).collect();
    let mut random = CaseRandom(0x6789_abcd_ef12_3456);
    let count = if parts == 1 { all.len() * 3 / 10 } else { parts };
    for i in 0..count {
        let rest = (all.len() - i) as f64;
        all.swap(i, i + (random.number() * rest) as usize);
    }
    cut(&mut run, policy, &all[..count], parts)?;
    run.steps(60)?;
    let check = fresh(&mut run, setting, policy)?;
    Ok(run.finish(scale, [check]))
}

/// A held block and one more element that shares so many vertices with it.
fn hang(
    setting: &CaseSetting,
    mesh: &Mesh,
    policy: MassPolicy,
    shared: usize,
    dt: f64,
) -> CaseOutcome {
    setting.of_tetrahedra()?;
    let mut run = loaded(setting, mesh, dt)?;
    let scale = weight(&mut run);
    run.steps(10)?;
    let near = |t: &[u32; 4]| t.iter().filter(|&&v| mesh.points[v as usize].x < 0.051).count();
    let hanging = mesh.tetrahedra.iter().position(|t| near(t) == shared);
    let all = mesh.tetrahedra.iter().enumerate();
    let gone: Vec<u32> =
        all.filter(|(i, t)| near(t) < 4 && Some(*i) != hanging).map(|(i, _)| i as u32).collect();
    let report = run.remove(&Removal { region: Region::Tetrahedra(gone), mass: policy })?;
    let before = std::mem::take(&mut run.figures.most_inverted);
    run.seconds(dt, 2.0)?;
    let inverted = run.figures.most_inverted;
    run.figures.most_inverted = inverted.max(before);
    let checks = [
        Check::holds("pieces as they should be", report.pieces == if shared == 0 { 2 } else { 1 }),
        Check::none("most inverted in a step", inverted),
        fresh(&mut run, setting, policy)?,
    ];
    Ok(run.finish(scale, checks))
}

/// All elements round a corner go.
fn orphan(setting: &CaseSetting, mesh: &Mesh, policy: MassPolicy, dt: f64) -> CaseOutcome {
    setting.of_tetrahedra()?;
    let mut run = loaded(setting, mesh, dt)?;
    let scale = weight(&mut run);
    let vertex = nearest(&mesh.points, BAR);
    let round = (0..).zip(&mesh.tetrahedra).filter(|(_, t)| t.contains(&(vertex as u32)));
    let round: Vec<u32> = round.map(|(i, _)| i).collect();
    let removal = Removal { region: Region::Tetrahedra(round), mass: policy };
    let report = run.remove(&removal)?;
    // integrators of second order let it fly by the midpoint rule
    let facts = setting.column.integrator.facts();
    let rule =
        if facts.multistep { Integrator::ImplicitMidpoint } else { setting.column.integrator };
    let mut fall = Fall::new(DVec3::ZERO, DVec3::ZERO);
    let mut off = 0.0_f64;
    for _ in 0..30 {
        run.step()?;
        if policy == MassPolicy::Keep {
            fall.step(rule, run.simulation.report(), dt, GRAVITY);
        }
        let way = run.simulation.displacements(run.body)[vertex];
        off = off.max(way.distance(fall.x) / fall.x.length().max(BAR.x));
    }
    let limit = setting.pick(1e-9, 1e-5);
    let checks = [
        Check::holds("the vertex is reported", report.orphans == [MeshVertex(vertex as u32)]),
        Check::at_most("vertex off its course, relative", off, limit),
        fresh(&mut run, setting, policy)?,
    ];
    Ok(run.finish(scale, checks))
}
