//! From a scene to a simulation. Everything is checked here, before the first step, and everything
//! that was found on the way is kept as a warning.
//!
//! One file for every kind of entry; each adds to the [`BuiltScene`] what its entries say.

mod axes;
mod bodies;
pub(crate) mod body;
pub(crate) mod conditions;
mod constraints;
mod curves;
mod cuts;
mod loads;
mod materials;
mod memory;
mod meshes;
mod outlook;
mod plan;
mod probes;
mod pulls;
mod removal;
mod resections;
mod scene;
mod select;
mod threads;
mod tools;
mod touch;
mod without_effect;

pub use body::{BuiltBody, BuiltMembrane, CarriedSurface};
pub use conditions::{BuiltConstraint, BuiltLoad, BuiltPressure};
pub use cuts::{BuiltCut, CutSummary};
pub use materials::MaterialRanges;
pub use memory::SceneSnapshot;
pub use meshes::generate;
pub use removal::{BuiltResection, ResectionSummary, swept};
pub use scene::{BuildOptions, BuiltScene, RunPlan};
pub use threads::BuiltThread;
pub use touch::{BuiltContact, BuiltPull, BuiltTool};
pub use without_effect::CODE as WITHOUT_EFFECT;

use crate::error::{SceneError, SceneProblem};
use crate::scene::LoadedScene;
use crate::warning::{Level, Warning};
use sinew::engine::workers::{Workers, WorkersError};
use sinew::models::body::VolumeRule;
use sinew::simulation::{Readback, Simulation, SimulationError, SimulationOptions};
use sinew::solvers::settings::Integrator;
use std::collections::HashSet;

/// Checks a scene and builds its simulation.
///
/// # Errors
/// [`SceneError`] with file, line, key and remedy.
pub fn build(loaded: &LoadedScene, options: &BuildOptions) -> Result<BuiltScene, SceneError> {
    let scene = &loaded.scene;
    if scene.name.trim().is_empty() {
        return Err(loaded.key("name").value("the name is empty", "give the scene a name"));
    }
    let plan = plan::plan(loaded, options)?;
    if scene.bodies.is_empty() {
        let remedy = "add a [[body]] with `mesh` or `generate`";
        return Err(loaded.key("").missing("a body", remedy));
    }
    check_names(loaded)?;
    pulls::check(loaded, options)?;
    let mut built = BuiltScene::empty(empty_simulation(loaded, options, &plan)?, plan);
    // one kind after another, each in the order of the file
    macro_rules! add {
        ($($key:literal $entries:ident: $make:path;)*) => {$(
            for (i, entry) in scene.$entries.iter().enumerate() {
                let own = $make(&loaded.key($key).entry(i), entry, &mut built)?;
                built.$entries.push(own);
            }
        )*};
    }
    add! {
        "body" bodies: bodies::body;
        "constraint" constraints: constraints::constraint;
        "load" loads: loads::load;
        "resection" resections: resections::resection;
        "pressure" pressures: loads::pressure;
        "tool" tools: tools::tool;
        "pull" pulls: pulls::pull;
        "contact" contacts: pulls::contact;
        "thread" strands: threads::thread;
        "clip" clips: threads::clip;
        "cut" cuts: cuts::cut;
        "probe" probes: probes::probe;
    }
    if built.plan.settings.integrator == Integrator::QuasiStatic {
        constraints::check_all_held(loaded, &built)?;
        built.simulation.check_support().map_err(|error| {
            loaded.key("mode").value(
                error.to_string(),
                "a static scene needs every body held; a flat sheet too across its plane, for example by \
                 `select = { all = true }` with `axes = \"z\"`",
            )
        })?;
    }
    let checked = built.simulation.check_backend();
    checked.map_err(|source| of_simulation(loaded, source))?;
    warn_of_long_runs(&mut built);
    warn_of_volume(&mut built);
    outlook::foretell(loaded, &mut built);
    let notes = without_effect::notes(loaded, &built);
    built.warnings.extend(notes);
    Ok(built)
}

/// Tells of explicit steps through nearly incompressible bodies, and of damping that leaves their volume out.
fn warn_of_volume(built: &mut BuiltScene) {
    let explicit = built.plan.settings.integrator.facts().explicit;
    for body in built.bodies.iter().filter(|body| body.volume == VolumeRule::Clusters) {
        if built.plan.settings.stiffness_damping > 0.0 {
            built.warnings.push(Warning::new(
                "scene.damping.volume",
                Level::Note,
                format!("body `{}`", body.name),
                "`stiffness_damping` leaves out the stiffness of clusters: it damps shear, not changes of volume",
                "nothing, if that is meant: volume hardly changes",
            ));
        }
        if !explicit {
            continue;
        }
        let lame = body.material.lame();
        let Some(ratio) = lame.ok().map(|l| ((l.lambda + 2.0 * l.mu) / (3.0 * l.mu)).sqrt()) else {
            continue;
        };
        if ratio > 2.0 {
            built.warnings.push(Warning::new(
                "scene.explicit.volume",
                Level::Warning,
                format!("body `{}`", body.name),
                format!(
                    "explicit steps have to resolve pressure waves: up to {ratio:.0} times as many as at nu = 0.25"
                ),
                "take an implicit integrator, such as \"safe\"",
            ));
        }
    }
}

/// Tells what a run takes at least, where that is long.
fn warn_of_long_runs(built: &mut BuiltScene) {
    const LONG: f64 = 3600.0;
    // (s) per step and per element of a step, less than any machine of 2026 needs
    let explicit = built.plan.settings.integrator.facts().explicit;
    let [per_step, per_element] = if explicit { [3e-6, 2e-8] } else { [3e-5, 2e-7] };
    let elements = built.element_count();
    let seconds = built.plan.steps as f64 * (per_step + per_element * elements as f64);
    if seconds > LONG {
        built.warnings.push(Warning::new(
            "scene.steps.many",
            Level::Warning,
            "scene",
            format!("{} steps take hours: {:.1} at the very least", built.plan.steps, seconds / 3600.0),
            "give longer or fewer steps (dt, duration, load_steps, --steps); files are whole when it is interrupted",
        ));
    }
}

/// A simulation without bodies.
fn empty_simulation(
    loaded: &LoadedScene,
    options: &BuildOptions,
    plan: &RunPlan,
) -> Result<Simulation, SceneError> {
    let scene = &loaded.scene;
    // whatever this run uses: a check runs on one thread
    Workers::check_count(scene.threads).map_err(|e| of_simulation(loaded, e.into()))?;
    let mut simulation = Simulation::new(SimulationOptions {
        precision: options.precision.unwrap_or(scene.precision.into()),
        backend: options.backend.unwrap_or(scene.backend.into()),
        executor: options.executor.unwrap_or(scene.executor.into()),
        instruction_set: options.instruction_set.or(scene.instruction_set),
        threads: plan.threads,
        exclusive: !options.beside_host,
        // the runner reads the state through the simulation, which asks for it
        readback: Readback::OnDemand,
    })
    .map_err(|source| of_simulation(loaded, source))?;
    simulation.set_gravity(plan.gravity);
    simulation.set_dt(plan.dt);
    simulation.set_solver(plan.settings.clone());
    Ok(simulation)
}

/// What the machine or the build does not have, at the key that asks for it.
fn of_simulation(loaded: &LoadedScene, source: SimulationError) -> SceneError {
    let key = match source {
        SimulationError::Workers(WorkersError::InstructionSet(_)) => "instruction_set",
        SimulationError::Workers(_) => "threads",
        _ => "backend",
    };
    loaded.key(key).error(source)
}

/// Names are given and unique among entries of their kind; those of loads also among constraints.
fn check_names(loaded: &LoadedScene) -> Result<(), SceneError> {
    fn names<T>(entries: &[T], name: impl Fn(&T) -> &str) -> Vec<&str> {
        entries.iter().map(name).collect()
    }
    let scene = &loaded.scene;
    let kinds = [
        ("body", names(&scene.bodies, |b| &b.name)),
        ("constraint", names(&scene.constraints, |c| &c.name)),
        ("load", names(&scene.loads, |l| &l.name)),
        ("resection", names(&scene.resections, |r| &r.name)),
        ("cut", names(&scene.cuts, |c| &c.name)),
        ("pressure", names(&scene.pressures, |p| &p.name)),
        ("tool", names(&scene.tools, |t| &t.name)),
        ("pull", names(&scene.pulls, |p| &p.name)),
        ("contact", names(&scene.contacts, |c| &c.name)),
        ("thread", names(&scene.strands, |t| &t.name)),
        ("clip", names(&scene.clips, |c| &c.name)),
        ("probe", names(&scene.probes, |p| &p.name)),
    ];
    let constraints: HashSet<&str> = kinds[1].1.iter().copied().collect();
    for (kind, names) in kinds {
        let mut seen = HashSet::new();
        for (i, name) in names.into_iter().enumerate() {
            let key = loaded.key(kind).entry(i).at("name");
            if name.trim().is_empty() {
                return Err(key.value("the name is empty", "give it a name"));
            }
            if name.chars().any(char::is_control) {
                let found =
                    format!("the name {name:?} holds a line break or another control character");
                return Err(key.value(found, "use printable characters"));
            }
            let taken = match kind {
                _ if !seen.insert(name) => Some(kind),
                "load" if constraints.contains(name) => Some("constraint"),
                _ => None,
            };
            if let Some(kind) = taken {
                return Err(key.error(SceneProblem::Duplicate { kind, name: name.into() }));
            }
        }
    }
    Ok(())
}
