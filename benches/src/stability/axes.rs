//! Group 10: axes, the stiffest a hundred times as stiff as the others, with and without a material beside
//! them; steps beyond the limit of explicit integrators; momenta of an element by itself.

use super::prelude::*;
use super::spin::momenta;
use sinew::models::axes::description::{AxesDescription, AxisAngle, AxisFamily};
use sinew::models::body::VolumeRule;
use std::borrow::Cow;

const BESIDE: CasePart =
    CasePart { group: 10, name: "axes 100 : 1 with a material", criterion: "none inverted" };
const ALONE: CasePart =
    CasePart { group: 10, name: "axes 100 : 1 alone", criterion: "bounded; elements may invert" };
const EXPLICIT: CasePart = CasePart {
    group: 10,
    name: "axes 100 : 1, explicit",
    criterion: "with one substep refused beyond the limit and bounded below; bounded with more",
};
const ISOLATED: CasePart = CasePart {
    group: 10,
    name: "axes in one free element",
    criterion: "momentum and angular momentum to 1e-10",
};
/// A bar (m) of 324 tetrahedra.
const SIZE: DVec3 = DVec3::new(0.2, 0.1, 0.1);
const CELLS: [usize; 3] = [6, 3, 3];
/// Moduli (Pa) of the soft axes and of angles, and of the stiff one beside the former.
const SOFT: f64 = 1e4;
const CONTRAST: f64 = 100.0;

pub(super) fn cases() -> Result<Cases, MeshError> {
    let mesh = Arc::new(jitter_interior(&box_tets(SIZE, CELLS)?, 0.15, 10)?);
    let mut cases = Cases::default();
    for (part, base) in [(BESIDE, true), (ALONE, false)] {
        for (name, slanted) in [("straight", false), ("slanted", true)] {
            for dt in [1e-3, 1.0 / 60.0, 0.1] {
                let (name, quick) = (format!("{name}, h {dt:.4}"), slanted && dt > 0.01);
                let run = move |s: &CaseSetting, mesh: &Mesh| hang(s, mesh, base, slanted, dt);
                cases.within(Scope::Integrators, part, name, quick, &mesh, run);
            }
        }
    }
    for dt in [1e-5, 1e-4, 3e-4, 1e-3, 3e-3] {
        let run = move |s: &CaseSetting, mesh: &Mesh| limit(s, mesh, dt);
        cases.within(Scope::Explicit, EXPLICIT, format!("h {dt}"), dt >= 1e-3, &mesh, run);
    }
    let points = [[0.0, 0.0, 0.0], [0.03, 0.002, 0.0], [0.005, 0.02, 0.001], [0.01, 0.004, 0.015]];
    let element = Arc::new(Mesh {
        source: "an irregular tetrahedron".into(),
        points: points.map(DVec3::from_array).to_vec(),
        tetrahedra: vec![[0, 1, 2, 3]],
        ..Mesh::default()
    });
    let name = "forces of an energy".into();
    cases.within(Scope::Explicit, ISOLATED, name, true, &element, isolated);
    Ok(cases)
}

/// Three axes, the first stiff, along the bar or at an angle to it.
fn axes(slanted: bool) -> AxesDescription<'static> {
    let turn = if slanted { DQuat::from_axis_angle(DVec3::Y, 0.7) } else { DQuat::IDENTITY };
    let families = [("a", DVec3::X, CONTRAST), ("b", DVec3::Y, 1.0), ("c", DVec3::Z, 1.0)];
    let families = families.map(|(name, axis, factor)| AxisFamily {
        directions: Cow::Owned(vec![turn * axis]),
        ..AxisFamily::new(name, &[], factor * SOFT)
    });
    let angles = [[0, 1], [0, 2], [1, 2]].map(|families| AxisAngle { families, modulus: SOFT });
    AxesDescription { families: families.to_vec(), angles: angles.to_vec(), volume_modulus: SOFT }
}

/// A bar held at one end.
fn bar<'a>(
    setting: &CaseSetting,
    mesh: &'a Mesh,
    base: bool,
    slanted: bool,
) -> Result<CaseRun<'a>> {
    let description = BodyDescription {
        axes: Some(axes(slanted)),
        model: if base { setting.column.model } else { Model::Axes },
        volume: if base { setting.column.volume } else { VolumeRule::Elements },
        ..BodyDescription::new("bar", mesh, tissue(SOFT, 0.3))
    };
    let mut run = CaseRun::with(setting, mesh, &description)?;
    run.clamp("x0")?;
    Ok(run)
}

/// The bar swings under its weight, a second long.
fn hang(setting: &CaseSetting, mesh: &Mesh, base: bool, slanted: bool, dt: f64) -> CaseOutcome {
    let mut run = bar(setting, mesh, base, slanted)?;
    run.simulation.set_gravity(GRAVITY);
    run.open_books();
    run.seconds(dt, 1.0)?;
    let weight = run.mass() * GRAVITY.length();
    let (scale, inverted) = (run.largest + weight * SIZE.x, run.figures.most_inverted);
    let checks = base.then(|| Check::none("most inverted in a step", inverted));
    Ok(run.finish(scale, checks))
}

/// With one substep, a step is taken below the limit and refused beyond; with as many as it needs it is
/// taken.
fn limit(setting: &CaseSetting, mesh: &Mesh, dt: f64) -> CaseOutcome {
    let mut alone = bar(setting, mesh, true, true)?;
    let stable = alone.simulation.stable_step();
    alone.solver(|s| s.max_substeps = 1);
    alone.simulation.set_gravity(GRAVITY);
    alone.simulation.set_dt(dt);
    let before = alone.simulation.state_hash();
    let taken = alone.simulation.step().is_ok();
    let untouched = taken || alone.simulation.state_hash() == before;
    // what the integrator leaves as a margin lies between
    let safety = SolverSettings::default().explicit_safety;
    let right = match dt {
        dt if dt <= 0.95 * safety * stable => taken,
        dt if dt > stable => !taken,
        _ => true,
    };
    let mut run = bar(setting, mesh, true, true)?;
    run.simulation.set_gravity(GRAVITY);
    run.open_books();
    run.seconds(dt, 300.0 * dt.min(1e-3))?;
    let weight = run.mass() * GRAVITY.length();
    let scale = run.largest + weight * SIZE.x;
    let checks = [
        Check::holds("refused beyond the limit, taken below", right),
        Check::holds("state untouched by a refusal", untouched),
    ];
    Ok(run.finish(scale, checks))
}

/// A free element out of shape, for 40 ms: at a thirtieth of the stable step, where the energy that symplectic
/// Euler keeps is near the true one.
fn isolated(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    // axes that are not square to each other, so that chords and cosines differ
    let directions =
        [DVec3::new(1.0, 0.2, 0.1), DVec3::new(-0.1, 1.0, 0.4), DVec3::new(0.3, 0.2, 1.0)];
    let mut axes = axes(false);
    for (family, direction) in axes.families.iter_mut().zip(directions) {
        family.directions = Cow::Owned(vec![direction.normalize()]);
    }
    let description = BodyDescription {
        axes: Some(axes),
        model: Model::Axes,
        ..BodyDescription::new("element", mesh, tissue(SOFT, 0.3))
    };
    let mut run = CaseRun::with(setting, mesh, &description)?;
    let mut random = CaseRandom(10);
    let mut field = |size: f64| -> Vec<DVec3> {
        (0..4).map(|_| (random.vector() - DVec3::splat(0.5)) * size).collect()
    };
    let (u, v) = (field(2e-3), field(0.2));
    run.place(&u, &v)?;
    let (start, scale) = (momenta(&mut run), run.energy());
    run.simulation.set_dt(1e-5);
    let (mut linear, mut angular) = (0.0_f64, 0.0_f64);
    // of the angular momentum of the parts, not of the sum, which may be small
    let size = start.size * mesh.points[1].length();
    for _ in 0..4000 {
        run.step()?;
        let now = momenta(&mut run);
        linear = linear.max(now.linear.distance(start.linear) / start.size);
        angular = angular.max(now.angular.distance(start.angular) / size);
    }
    let limit = setting.pick(1e-10, 1e-4);
    let checks = [
        Check::at_most("drift of momentum", linear, limit),
        Check::at_most("drift of angular momentum", angular, limit),
    ];
    Ok(run.finish(scale, checks))
}
