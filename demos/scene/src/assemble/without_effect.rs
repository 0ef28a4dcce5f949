//! Keys that a scene gives and that change nothing of its states.

use super::scene::BuiltScene;
use crate::scene::{
    BodyEntry, CurveEntry, LoadedScene, MaterialEntry, Mode, SolidCells, SpringMethod,
};
use crate::warning::{Level, Warning};
use glam::DVec3;
use sinew::models::body::Model;
use sinew::simulation::Backend;

/// Code of the note about such a key; its subject is the key.
pub const CODE: &str = "scene.key.without-effect";

/// Keys without effect, each with the reason.
struct Idle<'a> {
    loaded: &'a LoadedScene,
    found: Vec<(String, String)>,
}

impl Idle<'_> {
    /// Adds those of some keys that the scene gives.
    fn add(&mut self, table: &str, keys: &[&str], why: &str) {
        for key in keys {
            let path = if table.is_empty() { (*key).to_string() } else { format!("{table}.{key}") };
            if self.loaded.gives(&path) {
                self.found.push((path, why.to_string()));
            }
        }
    }
}

/// Notes of all keys without effect.
pub(super) fn notes(loaded: &LoadedScene, built: &BuiltScene) -> Vec<Warning> {
    let mut idle = Idle { loaded, found: Vec::new() };
    of_solver(&mut idle, built);
    let scene = &loaded.scene;
    for (i, body) in scene.bodies.iter().enumerate() {
        of_body(&mut idle, &format!("body[{i}]"), body, i, built);
    }
    if built.plan.mode == Mode::Dynamic {
        of_times(&mut idle);
    }
    let note = |(key, why): (String, String)| {
        let remedy = "leave it out, or change what makes it idle";
        Warning::new(
            CODE,
            Level::Note,
            format!("`{key}`"),
            format!("it has no effect: {why}"),
            remedy,
        )
    };
    idle.found.into_iter().map(note).collect()
}

fn of_solver(idle: &mut Idle, built: &BuiltScene) {
    let facts = built.plan.settings.integrator.facts();
    let own = format!("integrator \"{}\"", facts.name);
    if !facts.converges {
        let why = format!("{own} does not iterate to convergence");
        idle.add("solver", &["newton_tolerance", "max_newton_iterations"], &why);
    }
    if facts.explicit {
        let keys =
            ["linear_tolerance", "max_linear_iterations", "preconditioner", "linear_precision"];
        idle.add("solver", &keys, &format!("{own} solves no linear system"));
    } else {
        let why = format!("{own} has no substeps");
        idle.add("solver", &["explicit_safety", "max_substeps"], &why);
    }
    if !facts.recovers {
        idle.add("solver", &["recovery"], &format!("{own} recovers no bodies"));
    }
    if !facts.dynamic {
        let why = "an equilibrium knows no velocity";
        idle.add("solver", &["mass_damping", "stiffness_damping"], why);
    }
    if !facts.dynamic || facts.explicit {
        idle.add("solver", &["sleep_speed"], &format!("{own} lets no body sleep"));
    } else if built.simulation.backend() == Backend::Gpu {
        idle.add("solver", &["sleep_speed"], "on the device no body sleeps");
    }
}

fn of_body(idle: &mut Idle, path: &str, body: &BodyEntry, index: usize, built: &BuiltScene) {
    let material = format!("{path}.material");
    let own = &built.bodies[index];
    if !own.mesh.is_solid() {
        let why = "the body has no solid elements, its membrane is all of it";
        idle.add(path, &["model", "evaluation", "volume"], why);
        if body.membrane.as_ref().is_some_and(|m| m.material.is_some()) {
            let all = serde_json::to_value(MaterialEntry::default()).unwrap_or_default();
            let keys = all.as_object().into_iter().flatten().map(|(key, _)| key.as_str());
            let why = "the membrane has a material of its own";
            idle.add(&material, &keys.collect::<Vec<_>>(), why);
        }
    } else {
        of_moduli(idle, &material, body, built);
    }
    if built.plan.mode == Mode::Static && built.plan.gravity == DVec3::ZERO {
        let why = "in an equilibrium without gravity nothing has weight";
        idle.add(&material, &["density", "density_field"], why);
        idle.add(path, &["masses"], why);
        if body.membrane.as_ref().is_some_and(|m| m.material.is_some()) {
            idle.add(&format!("{path}.membrane.material"), &["density"], why);
        }
    }
    if let Some(shape) = body.generate.as_ref().and_then(|g| g.cuboid.as_ref())
        && shape.elements != SolidCells::Irregular
    {
        idle.add(&format!("{path}.generate.box"), &["seed"], "it is for elements = \"irregular\"");
    }
    if let Some(shape) = body.generate.as_ref().and_then(|g| g.specimen.as_ref()) {
        let (key, why) = match shape.thickness {
            Some(_) => ("sheet", "the specimen has a thickness: it is a solid"),
            None => ("solid", "the specimen has no thickness: it is a sheet"),
        };
        idle.add(&format!("{path}.generate.specimen"), &[key], why);
    }
    for (i, fibres) in body.fibres.iter().enumerate() {
        let Some(muscle) = &fibres.muscle else { continue };
        let path = format!("{path}.fibres[{i}].muscle");
        if muscle.peak_stress.unwrap_or(0.0) == 0.0 {
            let why = "the muscle has no active stress, `peak_stress` is 0";
            idle.add(&path, &["optimal_stretch", "width"], why);
        }
        if fibres.modulus == 0.0 {
            let why = "the fibres have no stiffness, `modulus` is 0";
            idle.add(&path, &["stiffening", "shortening"], why);
        }
    }
}

/// Moduli of a solid whose law does not ask for them.
fn of_moduli(idle: &mut Idle, material: &str, body: &BodyEntry, built: &BuiltScene) {
    let why = match body.model {
        Model::Axes => "model \"axes\" takes the density only",
        Model::MassSpring if body.springs.is_some() => {
            "the constants of the springs are in their file"
        }
        Model::MassSpring if body.element_method == Some(SpringMethod::Uniform) => {
            "all springs have the constant `spring_constant`"
        }
        _ => return,
    };
    if body.membrane.as_ref().is_some_and(|m| m.material.is_none()) {
        return;
    }
    idle.add(material, &["poisson_ratio", "poisson_ratio_field"], why);
    // the stiffness of contact is relative to Young's modulus
    if !built.touches() {
        idle.add(material, &["young_modulus", "young_modulus_field"], why);
    }
}

/// What acts after the end alone.
fn of_times(idle: &mut Idle) {
    let scene = &idle.loaded.scene;
    let Some(end) = scene.duration else { return };
    let late = |from: Option<f64>| from.is_some_and(|from| from >= end);
    let gone = |until: Option<f64>| until.is_some_and(|until| until < 0.0);
    let mut all: Vec<(String, Option<f64>, Option<f64>, Option<&CurveEntry>)> = Vec::new();
    macro_rules! windows {
        ($($name:literal $entries:ident;)*) => {$(
            all.extend(scene.$entries.iter().enumerate().map(|(i, own)| {
                (format!(concat!($name, "[{}]"), i), own.from, own.until, own.curve.as_ref())
            }));
        )*};
    }
    windows! { "constraint" constraints; "tool" tools; "pull" pulls; }
    let with = |name: &str, i: usize| format!("{name}[{i}]");
    let loads = scene.loads.iter().enumerate();
    all.extend(loads.map(|(i, own)| (with("load", i), None, None, own.curve.as_ref())));
    let pressures = scene.pressures.iter().enumerate();
    all.extend(pressures.map(|(i, own)| (with("pressure", i), None, None, own.curve.as_ref())));
    let cuts = scene.resections.iter().enumerate();
    all.extend(cuts.map(|(i, own)| (with("resection", i), own.from, own.until, None)));
    let threads = scene.strands.iter().enumerate();
    all.extend(threads.map(|(i, own)| (with("thread", i), own.from, own.until, None)));
    let clips = scene.clips.iter().enumerate();
    all.extend(clips.map(|(i, own)| (with("clip", i), own.from, own.until, None)));
    let cuts = scene.cuts.iter().enumerate();
    all.extend(cuts.map(|(i, own)| (with("cut", i), Some(own.time), None, None)));
    let found: Vec<(String, String)> = all
        .into_iter()
        .filter_map(|(path, from, until, curve)| {
            if late(from) {
                Some((
                    path,
                    format!("it acts from {} s, the scene ends at {end} s", from.unwrap_or(end)),
                ))
            } else if gone(until) {
                Some((path, format!("it acts until {} s, before the start", until.unwrap_or(0.0))))
            } else if curve.and_then(starts).is_some_and(|start| start >= end) {
                Some((path + ".curve", format!("it is 0 until the end of the scene at {end} s")))
            } else {
                None
            }
        })
        .collect();
    idle.found.extend(found);
}

/// Time (s) until which a curve is 0.
fn starts(curve: &CurveEntry) -> Option<f64> {
    let first = curve.ramp.map(|r| r[0]).or(curve.pulse.map(|p| p[0]));
    first.or_else(|| {
        let points = curve.points.as_ref()?;
        let first = points.iter().position(|p| p[1] != 0.0)?;
        first.checked_sub(1).map(|before| points[before][0])
    })
}
