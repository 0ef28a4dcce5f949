//! Steps, intervals and settings of the solver.

use super::scene::{BuildOptions, RunPlan};
use crate::error::SceneError;
use crate::scene::{LoadedScene, Mode, Output};
use sinew::solvers::settings::Integrator;

/// Checks everything about time and the solver.
pub(super) fn plan(loaded: &LoadedScene, options: &BuildOptions) -> Result<RunPlan, SceneError> {
    let scene = &loaded.scene;
    let gravity = loaded.key("gravity").finite(scene.gravity)?;
    let mut settings = scene.solver.clone();
    let (dt, steps) = match scene.mode {
        Mode::Dynamic => dynamic_steps(loaded)?,
        Mode::Static => {
            refuse_key_of(Mode::Dynamic, loaded, "dt", scene.dt.is_some())?;
            refuse_key_of(Mode::Dynamic, loaded, "duration", scene.duration.is_some())?;
            let steps = options.steps.unwrap_or(scene.load_steps.unwrap_or(1).into());
            if steps == 0 {
                return Err(loaded.key("load_steps").value("load_steps is 0", "give at least 1"));
            }
            let integrator = settings.integrator;
            if integrator != Integrator::QuasiStatic && integrator != Integrator::default() {
                return Err(loaded.key("solver.integrator").value(
                    format!("integrator {} in a static scene", integrator.name()),
                    "leave it out, or use mode = \"dynamic\"",
                ));
            }
            settings.integrator = Integrator::QuasiStatic;
            (1.0 / steps as f64, steps)
        }
    };
    let steps = options.steps.unwrap_or(steps);
    if steps == 0 {
        return Err(loaded.key("").value("0 steps asked for", "give at least 1"));
    }
    settings.validate().map_err(|source| {
        let message = source.to_string();
        let key = message.split([' ', '=']).next().unwrap_or_default();
        loaded.key(format!("solver.{key}")).error(source)
    })?;
    check_dampers(loaded, settings.integrator)?;
    Ok(RunPlan {
        mode: scene.mode,
        dt,
        steps,
        frame_every: frame_interval(loaded, dt)?,
        probe_every: scene.output.probe_every.unwrap_or(1),
        gravity,
        settings,
        threads: options.threads.unwrap_or(scene.threads),
    })
}

/// Step length (s) and number of steps of a dynamic scene.
fn dynamic_steps(loaded: &LoadedScene) -> Result<(f64, u64), SceneError> {
    let scene = &loaded.scene;
    refuse_key_of(Mode::Static, loaded, "load_steps", scene.load_steps.is_some())?;
    let positive = |name: &str, value: Option<f64>, what: &str| {
        let key = loaded.key(name);
        let value = value.ok_or_else(|| {
            let remedy = format!("a dynamic scene needs {what}, for example {name} = 0.01");
            key.missing(format!("key `{name}`"), remedy)
        })?;
        key.positive(value, name, "s")
    };
    let dt = positive("dt", scene.dt, "a step length in seconds")?;
    let duration = positive("duration", scene.duration, "a simulated time in seconds")?;
    let steps = (duration / dt - 1e-9).ceil().max(1.0);
    if dt > duration * (1.0 + 1e-9) {
        let found = format!("dt is {dt} s, longer than the duration of {duration} s");
        return Err(loaded.key("dt").value(found, "give a shorter step"));
    }
    if steps > 1e9 {
        let found = format!("dt = {dt:e} s makes {steps:.3e} steps in {duration:e} s");
        return Err(loaded.key("dt").value(found, "give a longer step (at most 1e9 steps)"));
    }
    Ok((dt, steps as u64))
}

/// Steps from one frame to the next.
fn frame_interval(loaded: &LoadedScene, dt: f64) -> Result<u64, SceneError> {
    let key = loaded.key("output");
    let Output { every, frames_per_second, probe_every } = loaded.scene.output;
    if every.is_some() && frames_per_second.is_some() {
        let found = "both `every` and `frames_per_second` are given";
        return Err(key.at("every").value(found, "keep one of them"));
    }
    for (name, count) in [("every", every), ("probe_every", probe_every)] {
        if count == Some(0) {
            return Err(key.at(name).value("0 steps", "give at least 1"));
        }
    }
    let rate = frames_per_second.unwrap_or(30.0);
    key.at("frames_per_second").positive(rate, "the number of frames per second", "")?;
    Ok(match (every, loaded.scene.mode) {
        (Some(every), _) => every,
        (None, Mode::Static) => 1,
        (None, Mode::Dynamic) => ((1.0 / (rate * dt)).round() as u64).max(1),
    })
}

/// Dampers are for steps in time.
fn check_dampers(loaded: &LoadedScene, integrator: Integrator) -> Result<(), SceneError> {
    for (b, body) in loaded.scene.bodies.iter().enumerate() {
        let viscous = |v: Option<f64>| v.is_some_and(|v| v != 0.0);
        let Some(f) = body.fibres.iter().position(|f| viscous(f.viscosity)) else { continue };
        let key = format!("body[{b}].fibres[{f}].viscosity");
        refuse_key_of(Mode::Dynamic, loaded, &key, integrator == Integrator::QuasiStatic)?;
    }
    Ok(())
}

/// Refuses a key, if it is present, that means something in scenes of the other kind alone.
fn refuse_key_of(
    mode: Mode,
    loaded: &LoadedScene,
    key: &str,
    present: bool,
) -> Result<(), SceneError> {
    if !present {
        return Ok(());
    }
    let (own, other) = match mode {
        Mode::Static => ("static", "dynamic"),
        Mode::Dynamic => ("dynamic", "static"),
    };
    Err(loaded.key(key).value(
        format!("`{key}` in a {other} scene"),
        format!("leave it out, or use mode = \"{own}\" (see demos/scenes/README.md)"),
    ))
}
