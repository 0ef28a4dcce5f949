//! Group 14: cuts of bodies that swing, are stretched, squeezed flat or touched, and blades that move through them.

use super::prelude::*;
use super::runner::OtherColumns;
use super::touch_rig::{STEP, ToolHand};
use sinew::models::axes::description::{AxesDescription, AxisFamily};
use sinew::models::axes::muscle::MuscleSettings;
use sinew::models::body::present::MassPolicy;
use sinew::models::cutting::CutError;
use sinew::models::resection::Removal;
use std::borrow::Cow;
use std::collections::BTreeSet;

const SWINGING: CasePart = CasePart {
    group: 14,
    name: "ten cuts of a swinging bar",
    criterion: "energy at the instant of a cut to 1e-12 (linear tetrahedra); what is left equals a fresh build to 1e-12",
};
const STRETCHED: CasePart = CasePart {
    group: 14,
    name: "blade without force through stretched tissue",
    criterion: "energy at rest after it that of steps of 10 ms to 1e-3; none inverted",
};
const SQUEEZED: CasePart = CasePart {
    group: 14,
    name: "cut while squeezed",
    criterion: "two pieces, none inverted at the end",
};
const TOUCHED: CasePart = CasePart {
    group: 14,
    name: "cut under a tool",
    criterion: "none inverted at the end, no force once it is away",
};
const BAR: DVec3 = DVec3::new(0.25, 0.1, 0.1);
const SIDE: f64 = 0.06;

pub(super) fn cases() -> Result<Cases, MeshError> {
    let bar = Arc::new(box_tets(BAR, [10, 4, 4])?);
    let block = Arc::new(jitter_interior(&box_tets(DVec3::splat(SIDE), [5; 3])?, 0.2, 5)?);
    let mut cases = Cases::default();
    for dt in [0.001, 1.0 / 60.0, 1.0 / 30.0, 0.1] {
        for beside in [Beside::Nothing, Beside::Removals, Beside::Muscle] {
            let name = match beside {
                Beside::Nothing => "cuts",
                Beside::Removals => "with removals",
                Beside::Muscle => "with a muscle",
            };
            let (name, quick) = (format!("{name} h {dt:.4}"), dt == 1.0 / 60.0);
            let run = move |s: &CaseSetting, mesh: &Mesh| swinging(s, mesh, beside, dt);
            cases.add(SWINGING, name, quick, &bar, run);
        }
    }
    for stretch in [0.15, 0.6] {
        for dt in [0.001, 0.002, 0.005, 0.01, 0.02, 1.0 / 30.0] {
            let (name, quick) = (format!("{:.0} % h {dt:.4}", 100.0 * stretch), dt == 1.0 / 30.0);
            let run = move |s: &CaseSetting, mesh: &Mesh| stretched(s, mesh, stretch, dt);
            cases.within(Scope::Robust, STRETCHED, name, quick, &block, run);
        }
    }
    for squeeze in [0.5, 0.8, 0.95] {
        let (name, quick) = (format!("{:.0} %", 100.0 * squeeze), squeeze == 0.8);
        let run = move |s: &CaseSetting, mesh: &Mesh| squeezed(s, mesh, squeeze);
        cases.add(SQUEEZED, name, quick, &block, run);
    }
    cases.within(Scope::Robust, TOUCHED, "ball".into(), true, &block, touched);
    Ok(cases)
}

/// What a bar that is cut has, or what is done to it, beside the cuts.
#[derive(Clone, Copy, PartialEq)]
enum Beside {
    Nothing,
    Removals,
    Muscle,
}

/// Fibres along the bar, half as stiff as its material, that pull as strongly as that resists to a tenth.
fn muscle() -> AxesDescription<'static> {
    let settings = MuscleSettings { peak_stress: 1e3, ..MuscleSettings::default() };
    let family = AxisFamily {
        directions: Cow::Owned(vec![DVec3::X]),
        muscle: Some(settings),
        ..AxisFamily::new("muscle", &[], 5e3)
    };
    AxesDescription { families: vec![family], angles: vec![], volume_modulus: 0.0 }
}

/// A body that can be cut; none, where cells or energy of the column cannot.
fn cuttable<'a>(
    setting: &CaseSetting,
    mesh: &'a Mesh,
    name: &str,
    axes: Option<AxesDescription>,
) -> Result<CaseRun<'a>> {
    let spare = 6 * mesh.points.len();
    let body = BodyDescription::new(name, mesh, tissue(1e4, 0.45));
    let mut run = CaseRun::of(setting, mesh, &BodyDescription { spare, axes, ..body })?;
    match run.simulation.check_cut(run.body) {
        Err(CutError::Body { .. }) => Err(OtherColumns.into()),
        result => {
            result?;
            Ok(run)
        }
    }
}

/// A blade across everything, or one that ends inside.
fn blade(random: &mut CaseRandom, size: DVec3) -> [[DVec3; 2]; 2] {
    let direction = |random: &mut CaseRandom| {
        let own = 2.0 * random.vector() - 1.0;
        if own.length() > 0.1 { own.normalize() } else { DVec3::X }
    };
    let (place, edge, across) = (random.vector() * size, direction(random), direction(random));
    let reach = 2.0 * size.length();
    let end = if random.number() < 0.5 { 0.0 } else { reach };
    [-reach, end]
        .map(|way| [place + way * across - reach * edge, place + way * across + reach * edge])
}

fn swinging(setting: &CaseSetting, mesh: &Mesh, beside: Beside, dt: f64) -> CaseOutcome {
    let axes = (beside == Beside::Muscle).then(muscle);
    let has_axes = axes.is_some();
    let mut run = cuttable(setting, mesh, "bar", axes)?;
    run.simulation.set_gravity(GRAVITY);
    run.simulation.set_dt(dt);
    run.clamp("x0")?;
    if has_axes {
        run.simulation.set_activation(run.body, "muscle", 0.6)?;
        run.step()?;
    }
    run.open_books();
    let scale = run.mass() * GRAVITY.length() * BAR.x;
    let mut random = CaseRandom(0x2468_ace0_1357_9bdf);
    let (mut change, mut gone) = (0.0_f64, BTreeSet::new());
    for _ in 0..10 {
        run.steps(10)?;
        change = change.max(run.cut(&blade(&mut random, BAR))?);
        if beside == Beside::Removals {
            let count = run.elements() as f64;
            let some = (0..10).map(|_| (random.number() * count) as u32);
            let some: Vec<u32> = some.filter(|e| gone.insert(*e)).collect();
            let removal = Removal { region: run.region(&some), mass: MassPolicy::Recompute };
            run.remove(&removal)?;
        }
    }
    run.steps(30)?;
    let mut checks = Vec::new();
    // rules of others are other ones for what is left of them
    if setting.of_tetrahedra().is_ok() {
        let limit = setting.pick(1e-12, 1e-5);
        checks.push(Check::at_most("change of energy at a cut", change, limit));
    }
    // hexahedra that are cut twice choose among points of the first time
    if run.mesh.hexahedra.is_empty() {
        let difference = run.simulation.verify_against_fresh(run.body)?;
        let limit = setting.pick(1e-12, 2e-5);
        let off = difference.largest().max(difference.mass);
        checks.push(Check::at_most("difference from a fresh build", off, limit));
    }
    Ok(run.finish(scale, checks))
}

/// A block that is stretched across the way of the blade, cut, and left alone; its elastic energy (J) then.
fn drawn<'a>(
    setting: &CaseSetting,
    mesh: &'a Mesh,
    stretch: f64,
    dt: f64,
) -> Result<(CaseRun<'a>, f64)> {
    let mut run = cuttable(setting, mesh, "block", None)?;
    run.solver(|s| s.mass_damping = 20.0);
    for (side, sign) in [("x0", -0.5), ("x1", 0.5)] {
        let motion = Motion::Translate(DVec3::X * (sign * stretch * SIDE));
        let rows = run.side(side)?;
        run.simulation.add_constraint(Constraint::moving(
            side,
            rows,
            motion,
            Curve::ramp(0.0, 0.3),
        ));
    }
    run.seconds(dt, 0.5)?;
    run.open_books();
    let edge = Edge {
        ends: [DVec3::Z * 0.02, DVec3::Z * -0.02],
        into: DVec3::Y,
        toughness: 0.0,
        travel: DVec3::ZERO,
    };
    let start = DVec3::new(0.031, -0.005, 0.055);
    let knife = run.simulation.add_tool(Tool::blade("scalpel", edge, start))?;
    // beside the block when it is there, so that it meets no one at its first look
    run.step()?;
    let steps = (0.4 / dt).round();
    for i in 1..=steps as u32 {
        let way = DVec3::Y * (0.045 * f64::from(i) / steps);
        run.simulation.move_tool(knife, start + way)?;
        run.step()?;
    }
    run.seconds(dt, 1.5)?;
    let energy = run.simulation.report().elastic_energy;
    Ok((run, energy))
}

fn stretched(setting: &CaseSetting, mesh: &Mesh, stretch: f64, dt: f64) -> CaseOutcome {
    let (run, energy) = drawn(setting, mesh, stretch, dt)?;
    let (_, other) = drawn(setting, mesh, stretch, STEP)?;
    let checks = [
        Check::at_most(
            "energy at the end beside steps of 10 ms",
            (energy / other - 1.0).abs(),
            1e-3,
        ),
        Check::none("inverted at the end", run.inverted()),
    ];
    let scale = run.largest;
    Ok(run.finish(scale, checks))
}

fn squeezed(setting: &CaseSetting, mesh: &Mesh, squeeze: f64) -> CaseOutcome {
    let mut run = cuttable(setting, mesh, "block", None)?;
    run.solver(|s| s.mass_damping = 10.0);
    run.simulation.set_dt(1.0 / 60.0);
    for (side, sign) in [("x0", 0.5), ("x1", -0.5)] {
        let motion = Motion::Translate(DVec3::X * (sign * squeeze * SIDE));
        let rows = run.side(side)?;
        let mut own = Constraint::moving(side, rows, motion, Curve::ramp(0.0, 0.5));
        if side == "x1" {
            own.until = 0.7;
        }
        run.simulation.add_constraint(own);
    }
    run.steps(36)?;
    run.open_books();
    // across the direction of the squeeze, through its middle
    let x = DVec3::new(0.5 * SIDE + 0.001, 0.0, 0.0);
    let edge = |y: f64| [x + DVec3::new(0.0, y, -1.0), x + DVec3::new(0.002, y, 1.0)];
    run.cut(&[edge(-1.0), edge(1.0)])?;
    let pieces = run.simulation.topology().bodies[run.body.0].piece_count();
    run.steps(120)?;
    let checks = [
        Check::holds("two pieces", pieces == 2),
        Check::none("inverted at the end", run.inverted()),
    ];
    Ok(run.finish_by_largest(checks))
}

/// A ball presses a block that is cut from above beneath it, and goes away.
fn touched(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut run = cuttable(setting, mesh, "block", None)?;
    run.solver(|s| s.mass_damping = 10.0);
    run.simulation.set_dt(STEP);
    run.clamp("z0")?;
    let above = DVec3::new(0.03, 0.03, SIDE + 0.016);
    let mut hand = ToolHand::ball(&mut run, 0.015, above)?;
    hand.go(&mut run, above - DVec3::Z * 0.012, 0.1, STEP)?;
    let edge = |y: f64| [DVec3::new(0.031, y, 0.02), DVec3::new(0.031, y, 1.0)];
    run.cut(&[edge(-1.0), edge(1.0)])?;
    run.steps(50)?;
    hand.go(&mut run, above + DVec3::Z * 0.02, 0.1, STEP)?;
    run.steps(200)?;
    let checks = [
        Check::none("inverted at the end", run.inverted()),
        Check::at_most("force after withdrawal (N)", hand.force(&run).length(), 0.0),
    ];
    Ok(run.finish_by_largest(checks))
}
