//! What the data do not determine, in words.

use super::observe::{DataKind, Observations};
use super::parameter::{Constant, Parameter};
use super::statistics::Directions;
use sinew_scene::assemble::BuiltScene;
use sinew_scene::scene::{LoadedScene, PrecisionName};
use sinew_scene::summary::{Level, Warning};

/// Change of the observations, over their size, under a change of a parameter by its scale, below which
/// the parameter counts as without influence.
pub(super) const LEAST_INFLUENCE: f64 = 1e-6;
/// Share of the largest entry from which a parameter takes part in a direction.
const TAKES_PART: f64 = 0.1;

fn warning(code: &str, level: Level, subject: String, message: String, remedy: &str) -> Warning {
    let (code, remedy) = (code.into(), remedy.into());
    Warning { code, level, subject, message, remedy }
}

fn title(p: &Parameter) -> String {
    format!("{} (`{}`)", p.constant.name(), p.name)
}

/// Whether everything follows from prescribed motions: there is no force whose size is known.
fn only_motions(loaded: &LoadedScene, observations: &Observations) -> bool {
    let scene = &loaded.scene;
    let loaded = scene.loads.iter().any(|load| load.force.or(load.traction) != Some([0.0; 3]))
        || scene.pressures.iter().any(|p| p.pressure != 0.0)
        || scene.gravity != [0.0; 3];
    !loaded && observations.files.iter().all(|file| file.kind == DataKind::Displacements)
}

const FORCE_NEEDED: &str =
    "give a force: a second --data file with the reaction of a constraint, or a scene with loads";

/// What is worth knowing before the fit.
pub(super) fn of_scene(
    loaded: &LoadedScene,
    scene: &BuiltScene,
    parameters: &[Parameter],
) -> Vec<Warning> {
    let mut found = Vec::new();
    if loaded.scene.precision == PrecisionName::F32 {
        let message = "the scene asks for f32; fits are computed in f64".into();
        let subject = "scene".into();
        found.push(warning(
            "fit.precision",
            Level::Note,
            subject,
            message,
            "nothing is to be done",
        ));
    }
    for p in parameters.iter().filter(|p| p.varies) {
        let message = format!(
            "it varies over the elements in the scene; one value is fitted, from the mean {:.4e} {}",
            p.start,
            p.constant.unit()
        );
        let remedy = "name a region to keep it different";
        found.push(warning("fit.varies", Level::Warning, title(p), message, remedy));
    }
    for (i, body) in scene.bodies.iter().enumerate() {
        if body.membrane.is_some() && parameters.iter().any(|p| p.body == i) {
            let message = "its membrane keeps the material of the scene".into();
            let subject = format!("body `{}`", body.name);
            let remedy = "only solid elements are fitted";
            found.push(warning("fit.membrane", Level::Note, subject, message, remedy));
        }
    }
    found
}

/// Parameters without influence on the observations.
pub(super) fn insensitive(
    loaded: &LoadedScene,
    parameters: &[Parameter],
    without: &[usize],
    observations: &Observations,
) -> Vec<Warning> {
    let motions = only_motions(loaded, observations);
    let all = without.iter().map(|&i| &parameters[i]);
    all.map(|p| {
        let (message, remedy) = match p.constant {
            Constant::Young if motions => (
                "it cannot be found from displacements under prescribed motions alone: they do not \
                 depend on it"
                    .to_string(),
                FORCE_NEEDED,
            ),
            Constant::Young | Constant::Axis => (
                format!(
                    "it cannot be found: the observations change by less than {LEAST_INFLUENCE:e} of \
                     their size when it is doubled"
                ),
                match p.constant {
                    Constant::Axis => "load the body along its fibres, or measure where they are",
                    _ => "measure in or next to the elements that have it",
                },
            ),
            Constant::Poisson => (
                format!(
                    "it cannot be found: a change by 0.5 changes the observations by less than \
                     {LEAST_INFLUENCE:e} of their size"
                ),
                "measure displacements across the load too, or hold the sides",
            ),
        };
        warning("fit.no-influence", Level::Warning, title(p), message, remedy)
    })
    .collect()
}

/// What the derivatives at the solution say.
pub(super) fn of_fit(
    loaded: &LoadedScene,
    parameters: &[Parameter],
    values: &[f64],
    standard_errors: &[Option<f64>],
    directions: &Directions,
    observations: &Observations,
) -> Vec<Warning> {
    let mut found = Vec::new();
    let motions = only_motions(loaded, observations);
    for direction in directions.unidentifiable() {
        let largest = direction.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let part: Vec<usize> =
            (0..parameters.len()).filter(|&i| direction[i].abs() > TAKES_PART * largest).collect();
        let names: Vec<String> = part.iter().map(|&i| title(&parameters[i])).collect();
        let moduli = part.iter().all(|&i| parameters[i].constant != Constant::Poisson);
        let (message, remedy) = if moduli && motions {
            let message = "only their ratios can be found: displacements under prescribed motions do \
                           not depend on a common factor";
            (message.to_string(), FORCE_NEEDED)
        } else {
            let weights: Vec<String> =
                part.iter().map(|&i| format!("{:+.2}", direction[i])).collect();
            let message = format!(
                "they cannot be found apart: the observations hardly change when they change \
                 together (by {} of their scales)",
                weights.join(", ")
            );
            (message, "fit fewer of them, or observe more places, directions or load cases")
        };
        let subject = names.join(", ");
        found.push(warning("fit.not-identifiable", Level::Warning, subject, message, remedy));
    }
    for ((p, &value), error) in parameters.iter().zip(values).zip(standard_errors) {
        if let Some(error) = error.filter(|&error| error > value.abs()) {
            let message = format!("its standard error {error:.2e} exceeds its value {value:.2e}");
            let remedy = "the data do not determine it; observe more, or more exactly";
            found.push(warning("fit.uncertain", Level::Warning, title(p), message, remedy));
        }
        let freedom = observations.list.len() - parameters.len();
        if error.is_none() && freedom == 0 && !observations.has_sigma {
            let message = "there is no standard error".into();
            let remedy = "observe more numbers than parameters, or give a column `sigma`";
            found.push(warning("fit.no-error", Level::Note, title(p), message, remedy));
        }
        if p.at_bound(value) {
            let message = format!(
                "it ended at a bound of {:.4e} .. {:.4e} {}: the bound decides it, not the data",
                p.bounds[0],
                p.bounds[1],
                p.constant.unit()
            );
            let remedy = "widen the bound, or look for what else is wrong with the scene";
            found.push(warning("fit.bound", Level::Warning, title(p), message, remedy));
        }
    }
    found
}
