//! What is aimed at.

use serde::Serialize;

/// One aim.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchAim {
    /// What is measured, and how.
    pub what: String,
    /// Value that just meets it.
    pub limit: f64,
    /// Value of this run.
    pub found: f64,
    /// Unit.
    pub unit: String,
    /// Whether it was met.
    pub met: bool,
}

impl BenchAim {
    /// An aim that is met at or below `limit`.
    pub fn at_most(what: impl Into<String>, limit: f64, unit: &str, found: f64) -> Self {
        Self { what: what.into(), limit, found, unit: unit.into(), met: found <= limit }
    }

    /// An aim that is met at or above `limit`, and says so.
    pub fn at_least(what: impl Into<String>, limit: f64, unit: &str, found: f64) -> Self {
        Self { met: found >= limit, ..Self::at_most(what, limit, unit, found) }
    }
}
