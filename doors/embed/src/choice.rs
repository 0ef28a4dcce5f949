//! Words of scene files, by name.

use crate::error::{EmbedError, InputError, Result};
use serde::de::DeserializeOwned;
use sinew::identify::ElementMethod;
use sinew::models::body::lumped::{HexahedronSprings, SpringRule, UniformSprings};
use sinew::models::material::{self, YoungPoisson};
use sinew::solvers::settings::SolverSettings;
use sinew::touch::edge::Edge;
use sinew::touch::needle::Needle;
use sinew::touch::tool::Tool;
use sinew_scene::error::hint;
use sinew_scene::scene::{EdgeEntry, NeedleEntry};

/// What a word of scene files stands for, such as a [`Model`](crate::Model) by `"svk_comp"`; `kind` says in the error what was
/// looked for.
///
/// # Errors
/// [`Code::Argument`](crate::Code::Argument) with near misses or all words.
pub fn choice<T: DeserializeOwned>(kind: &'static str, name: &str) -> Result<T> {
    serde_json::from_value(name.into()).map_err(|error| {
        let message = error.to_string();
        let known = message.split('`').skip(3).step_by(2);
        InputError::Unknown { kind, name: name.into(), hint: hint(kind, name, known) }.into()
    })
}

/// Where constants of springs come from: a method of fitting by its name, or `"uniform"` with a constant (N/m).
///
/// # Errors
/// When there is no such method, or a constant is missing or given in vain.
pub fn spring_rule(method: &str, constant: Option<f64>) -> Result<SpringRule> {
    let invalid = |problem: &str| Err(InputError::invalid("springs", problem).into());
    match (method, constant) {
        ("uniform", Some(constant)) => {
            let hexahedron = HexahedronSprings::All;
            Ok(SpringRule::Uniform(UniformSprings { constant, hexahedron }))
        }
        ("uniform", None) => invalid("method \"uniform\" needs a constant (N/m)"),
        (_, Some(_)) => invalid("a constant belongs to method \"uniform\" alone"),
        (name, None) => Ok(SpringRule::Fitted(name.parse::<ElementMethod>()?)),
    }
}

/// The material of a tissue preset.
///
/// # Errors
/// When there is no such preset.
pub fn preset(name: &str) -> Result<YoungPoisson> {
    Ok(material::preset(name)?.material)
}

/// Settings of the solver from text: TOML as below `[solver]` of a scene, or JSON when it starts with a brace. What is left out
/// keeps its default.
///
/// # Errors
/// When a key is unknown or a value out of range.
pub fn solver_settings(text: &str) -> Result<SolverSettings> {
    let settings: SolverSettings = words("solver settings", text)?;
    settings.validate()?;
    Ok(settings)
}

/// What TOML or JSON says.
pub(crate) fn words<T: DeserializeOwned>(what: &str, text: &str) -> Result<T> {
    let problem = |error: String| EmbedError::from(InputError::invalid(what, error));
    match text.trim_start().starts_with('{') {
        true => serde_json::from_str(text).map_err(|e| problem(e.to_string())),
        false => toml::from_str(text).map_err(|e| problem(e.message().replace('\n', ", "))),
    }
}

/// Gives a tool the sharp edge that a text tells, and its flanks: TOML as below `edge` of a tool in a scene, or JSON.
///
/// # Errors
/// When a key is unknown or missing, or the flanks cannot be used.
pub fn give_edge(tool: &mut Tool, text: &str) -> Result<()> {
    let own = words::<EdgeEntry>("edge", text)?;
    let flanks = own.flanks().map_err(|problem| InputError::invalid("edge.flanks", problem))?;
    tool.edge = Some(Edge::from(&own));
    tool.parts.extend(flanks);
    Ok(())
}

/// The needle of a tool from text, likewise.
///
/// # Errors
/// When a key is unknown or missing.
pub fn needle(text: &str) -> Result<Needle> {
    words::<NeedleEntry>("needle", text).map(|own| Needle::from(&own))
}
