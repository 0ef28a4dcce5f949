//! Pulls, and contact of bodies with each other.

use super::curves::{self, factor, window};
use super::scene::{BuildOptions, BuiltScene};
use super::select::{select, which_body};
use super::touch::{BuiltContact, BuiltPull, Way};
use crate::error::SceneError;
use crate::scene::{ContactEntry, Key, LoadedScene, PullEntry};
use crate::warning::{Level, Warning};
use sinew::simulation::{Backend, BodyHandle};
use sinew::touch::pair::BodyContact;
use sinew::touch::tool::{Stiffness, friction_problem};

/// Whether steps are computed where nothing can be touched: refuses tools, pulls, contacts, threads and clips there.
pub(super) fn check(loaded: &LoadedScene, options: &BuildOptions) -> Result<(), SceneError> {
    let scene = &loaded.scene;
    let kinds = [
        ("tool", scene.tools.len()),
        ("pull", scene.pulls.len()),
        ("contact", scene.contacts.len()),
        ("thread", scene.strands.len()),
        ("clip", scene.clips.len()),
    ];
    let Some((kind, _)) = kinds.into_iter().find(|(_, count)| *count > 0) else { return Ok(()) };
    if options.backend.unwrap_or(scene.backend.into()) == Backend::Gpu {
        let found = format!("backend \"gpu\" knows no [[{kind}]]");
        return Err(loaded.key("backend").value(found, "use backend = \"cpu\""));
    }
    Ok(())
}

/// A pull of a scene.
pub(super) fn pull(
    key: &Key,
    entry: &PullEntry,
    built: &BuiltScene,
) -> Result<BuiltPull, SceneError> {
    let body = which_body(key, entry.body.as_deref(), &built.bodies)?;
    let vertices = select(&key.at("select"), &entry.select, &built.bodies[body])?;
    let stiffness = key.at("stiffness").positive(entry.stiffness, "the stiffness", "N/m")?;
    let damping = entry.damping.unwrap_or(0.0);
    key.at("damping").not_negative(damping, "the damping", "N s/m")?;
    let mode = built.plan.mode;
    let (way, motion) = match (&entry.path, entry.translate) {
        (Some(_), Some(_)) => {
            return Err(key.at("translate").value("`path` is given as well", "keep one of them"));
        }
        (Some(path), None) => {
            let axes = curves::path(&key.at("path"), path, "[time, x, y, z] points", mode)?;
            (Way::Path(axes), format!("along a path of {} points", path.len()))
        }
        (None, translate) => {
            let by = key.at("translate").finite(translate.unwrap_or_default())?;
            if translate.is_none() && entry.curve.is_some() {
                return Err(key.at("curve").value(
                    "a curve without a translation",
                    "add `translate`, or use `from` and `until` to take hold and let go",
                ));
            }
            let words = match translate {
                Some(_) => format!("moved by [{}, {}, {}] m", by.x, by.y, by.z),
                None => "at rest".into(),
            };
            (Way::Scaled(by, factor(key, entry.curve.as_ref(), mode)?), words)
        }
    };
    let [from, until] = window(key, [entry.from, entry.until], mode)?;
    let (name, handle) = (entry.name.clone(), built.bodies[body].handle);
    let rows = built.simulation.rows(handle, &name, &vertices).map_err(|e| key.error(e))?;
    let own = BuiltPull::new(name, body, rows, way, motion);
    Ok(BuiltPull { stiffness, damping, from, until, ..own })
}

/// A contact of a scene.
pub(super) fn contact(
    key: &Key,
    entry: &ContactEntry,
    built: &mut BuiltScene,
) -> Result<BuiltContact, SceneError> {
    let known = || built.bodies.iter().map(|b| b.name.as_str());
    let find = |key: Key, name: &str| {
        known().position(|n| n == name).ok_or_else(|| key.unknown("body", name, known()))
    };
    let bodies = match (&entry.bodies, &entry.itself) {
        (Some([a, b]), None) => {
            let key = key.at("bodies");
            let bodies = [find(key.entry(0), a)?, find(key.entry(1), b)?];
            if bodies[0] == bodies[1] {
                let remedy = format!("name two bodies, or write self = \"{a}\"");
                return Err(key.value("both are the same body", remedy));
            }
            bodies
        }
        (None, Some(name)) => [find(key.at("self"), name)?; 2],
        _ => {
            let found = "not exactly one of `bodies` and `self` is given";
            return Err(key.value(found, "name two bodies, or one that may touch itself"));
        }
    };
    let friction = friction(key, [entry.friction, entry.mu], &mut built.warnings)?;
    let mut contact = BodyContact::new(&entry.name, bodies.map(BodyHandle)).with_friction(friction);
    contact.stiffness =
        stiffness(key, entry.stiffness, entry.stiffness_absolute, contact.stiffness)?;
    let entity = built.simulation.add_body_contact(contact);
    Ok(BuiltContact { name: entry.name.clone(), bodies, friction, entity })
}

/// A coefficient of friction by its key and by the one that it had before.
pub(super) fn friction(
    key: &Key,
    [friction, mu]: [Option<f64>; 2],
    warnings: &mut Vec<Warning>,
) -> Result<f64, SceneError> {
    let old = key.at("mu");
    if friction.is_some() && mu.is_some() {
        return Err(old.value("`friction` is given as well", "keep that one: `mu` is its old name"));
    }
    let key = if mu.is_some() { old } else { key.at("friction") };
    if mu.is_some() {
        warnings.push(Warning::new(
            "scene.key.renamed",
            Level::Note,
            format!("`{}`", key.path()),
            "`mu` is now called `friction`",
            "write `friction`; the next version does not know `mu`",
        ));
    }
    let coefficient = friction.or(mu).unwrap_or(0.0);
    match friction_problem(coefficient) {
        Some(problem) => Err(key.value(problem, "correct it")),
        None => key.finite([coefficient]).map(|_| coefficient),
    }
}

/// A stiffness of contact, relative or absolute.
pub(super) fn stiffness(
    key: &Key,
    relative: Option<f64>,
    absolute: Option<f64>,
    otherwise: Stiffness,
) -> Result<Stiffness, SceneError> {
    match (relative, absolute) {
        (None, None) => Ok(otherwise),
        (Some(times), None) => {
            Ok(Stiffness::Relative(key.at("stiffness").positive(times, "the stiffness", "")?))
        }
        (None, Some(k)) => {
            let key = key.at("stiffness_absolute");
            Ok(Stiffness::Absolute(key.positive(k, "the stiffness", "Pa/m")?))
        }
        (Some(_), Some(_)) => {
            let key = key.at("stiffness_absolute");
            Err(key.value("`stiffness` is given as well", "keep one of them"))
        }
    }
}
