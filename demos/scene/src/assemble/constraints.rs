//! Held and moved vertices.

use super::conditions::BuiltConstraint;
use super::curves::{factor, window};
use super::scene::BuiltScene;
use super::select::{select, which_body};
use crate::error::{SceneError, SceneProblem};
use crate::scene::{ConstraintEntry, Key, LoadedScene, Mode, MotionEntry};
use crate::warning::{Level, Warning};
use sinew::engine::load::{Constraint, Curve, Motion};
use sinew::engine::vertex::FixedAxes;

/// A constraint of a scene.
pub(super) fn constraint(
    key: &Key,
    entry: &ConstraintEntry,
    built: &mut BuiltScene,
) -> Result<BuiltConstraint, SceneError> {
    let mode = built.plan.mode;
    let body = which_body(key, entry.body.as_deref(), &built.bodies)?;
    let vertices = select(&key.at("select"), &entry.select, &built.bodies[body])?;
    let axes = held_axes(&key.at("axes"), entry.axes.as_deref())?;
    let (motion, words) = motion(&key.at("motion"), entry.motion.as_ref())?;
    if entry.motion.is_none() && entry.curve.is_some() {
        return Err(key.at("curve").value(
            "a curve without a motion",
            "add `motion`, or use `from` and `until` to hold and release",
        ));
    }
    let curve = factor(key, entry.curve.as_ref(), mode)?;
    let [from, until] = window(key, [entry.from, entry.until], mode)?;
    let (name, handle) = (entry.name.clone(), built.bodies[body].handle);
    let rows = built.simulation.rows(handle, &name, &vertices).map_err(|e| key.error(e))?;
    warn_of_jumps(&name, entry, (&motion, &curve), from, until, body, built);
    let mut constraint = Constraint::moving(name.clone(), rows, motion, curve);
    (constraint.axes, constraint.from, constraint.until) = (axes, from, until);
    let entity = built.simulation.add_constraint(constraint);
    let own = BuiltConstraint { name, body, entity, vertices, axes, from, until, motion: words };
    warn_about(&own, entry, built);
    Ok(own)
}

/// Part of the longest side of a body, or of a radian, that a motion may go in a step without a word.
const LONG_WAY: f64 = 0.1;
/// Part of a period that a step may take.
const COARSE: f64 = 0.25;

/// Motions that are meant to be smooth but happen within a step.
fn warn_of_jumps(
    name: &str,
    entry: &ConstraintEntry,
    (motion, curve): (&Motion, &Curve),
    from: f64,
    until: f64,
    body: usize,
    built: &mut BuiltScene,
) {
    if built.plan.mode != Mode::Dynamic || entry.curve.is_none() {
        return;
    }
    let way = match motion {
        Motion::Translate(d) => {
            let extent =
                built.bodies[body].mesh.bounds().map_or(1.0, |(a, b)| (b - a).max_element());
            d.length() / extent
        }
        Motion::Rotate { angle, .. } => angle.abs(),
        _ => return,
    };
    let dt = built.plan.dt;
    let mut warn = |message: String, remedy: &str| {
        let subject = format!("constraint `{name}`");
        let code = "scene.motion.jump";
        built.warnings.push(Warning::new(code, Level::Warning, &subject, message, remedy));
    };
    if let Curve::Sine { frequency, .. } = curve
        && (frequency * dt).abs() > COARSE
    {
        warn(
            format!(
                "its sine has {:.3} periods in a step of {dt} s: what is computed is another motion",
                frequency * dt
            ),
            "use a smaller dt or frequency",
        );
        return;
    }
    // where it begins to act the motion begins with the factor that the curve has by then
    let begins = if from > 0.0 { curve.value(from).abs() } else { 0.0 };
    let change = curve.largest_change(dt, from.max(0.0), until).max(begins);
    if change * way > LONG_WAY {
        warn(
            format!(
                "{:.0} % of its motion happens within one step of {dt} s",
                100.0 * change.min(1.0)
            ),
            "make the curve slower, begin the curve where `from` is, or use a smaller dt",
        );
    }
}

/// A motion, and the same in words.
fn motion(key: &Key, entry: Option<&MotionEntry>) -> Result<(Motion, String), SceneError> {
    match entry.map(|m| (&m.translate, &m.rotate)) {
        None => Ok((Motion::Hold, "held".into())),
        Some((Some(d), None)) => {
            let d = key.at("translate").finite(*d)?;
            let words = format!("moved by [{}, {}, {}] m", d.x, d.y, d.z);
            Ok((Motion::Translate(d), words))
        }
        Some((None, Some(turn))) => {
            let key = key.at("rotate");
            let axis = key.axis(turn.axis)?;
            let centre = key.at("centre").finite(turn.centre)?;
            key.at("degrees").finite([turn.degrees])?;
            let angle = turn.degrees.to_radians();
            let words = format!("turned by {} degrees", turn.degrees);
            Ok((Motion::Rotate { centre, axis, angle }, words))
        }
        Some(_) => {
            let found = "not exactly one motion is given";
            Err(key.value(found, "give `translate` or `rotate`"))
        }
    }
}

/// Whether its vertices stay where they are along an axis (0, 1, 2).
fn stays(constraint: &Constraint, axis: usize) -> bool {
    match &constraint.motion {
        Motion::Hold => true,
        Motion::Translate(by) => by[axis] == 0.0,
        _ => false,
    }
}

/// What may not be meant: a motion in one step, vertices that an earlier constraint holds too.
fn warn_about(own: &BuiltConstraint, entry: &ConstraintEntry, built: &mut BuiltScene) {
    let BuiltScene { constraints, warnings, plan, simulation, .. } = built;
    let subject = format!("constraint `{}`", own.name);
    let mut warn = |code: &str, message: String, remedy: &str| {
        warnings.push(Warning::new(code, Level::Warning, &subject, message, remedy));
    };
    if plan.mode == Mode::Dynamic && entry.motion.is_some() && entry.curve.is_none() {
        warn(
            "scene.motion.jump",
            "the whole motion happens in its first step".into(),
            "add a curve such as `curve = { ramp = [0.0, 1.0] }`",
        );
    }
    let motion = |of: &BuiltConstraint| simulation.world().get::<Constraint>(of.entity);
    // along axes on which neither moves both ask for the same
    let differ = |other: &BuiltConstraint| {
        let still = |k| [motion(own), motion(other)].iter().all(|c| c.is_some_and(|c| stays(c, k)));
        (0..3).any(|k| own.axes.holds(k) && other.axes.holds(k) && !still(k))
    };
    for other in constraints.iter() {
        if other.body != own.body
            || own.from >= other.until
            || other.from >= own.until
            || !differ(other)
        {
            continue;
        }
        let held = |v: &&u32| other.vertices.binary_search(v).is_ok();
        let shared = own.vertices.iter().filter(held).count();
        if shared > 0 {
            warn(
                "scene.constraint.overlap",
                format!("{shared} of its vertices are held by `{}` too", other.name),
                "the later entry wins; make the selections disjoint",
            );
        }
    }
}

fn held_axes(key: &Key, axes: Option<&str>) -> Result<FixedAxes, SceneError> {
    let Some(axes) = axes else { return Ok(FixedAxes::ALL) };
    let mut bits = 0u8;
    for letter in axes.chars() {
        let bit = "xyz".find(letter).map_or(0, |k| 1 << k);
        if bit == 0 || bits & bit != 0 {
            bits = 0;
            break;
        }
        bits |= bit;
    }
    if bits == 0 {
        return Err(key.value(
            format!("axes are \"{axes}\""),
            "use the letters x, y and z, each at most once, such as \"xyz\" or \"z\"",
        ));
    }
    Ok(FixedAxes(bits))
}

/// Every body is held against rigid motion, as far as counting tells.
pub(super) fn check_all_held(loaded: &LoadedScene, built: &BuiltScene) -> Result<(), SceneError> {
    for (i, body) in built.bodies.iter().enumerate() {
        let own = || built.constraints.iter().filter(move |c| c.body == i);
        let held = own().fold(0, |held, c| held | c.axes.0);
        let free: Vec<&str> = ["x", "y", "z"]
            .into_iter()
            .enumerate()
            .filter_map(|(k, name)| (held >> k & 1 == 0).then_some(name))
            .collect();
        // six rigid motions need six held unknowns; a vertex in two constraints counts once
        let mut unknowns: Vec<(u32, usize)> = own()
            .flat_map(|c| c.vertices.iter().map(move |&v| (v, c.axes)))
            .flat_map(|(v, axes)| (0..3).filter(move |&k| axes.holds(k)).map(move |k| (v, k)))
            .collect();
        unknowns.sort_unstable();
        unknowns.dedup();
        let motion = if !free.is_empty() {
            format!("translation along {}", free.join(", "))
        } else if unknowns.len() < 6 {
            format!("rotation ({} unknowns are held, at least 6 are needed)", unknowns.len())
        } else {
            continue;
        };
        let key = loaded.key("body").entry(i).at("name");
        return Err(key.error(SceneProblem::NotHeld { body: body.name.clone(), motion }));
    }
    Ok(())
}
