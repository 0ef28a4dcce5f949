//! What is aimed at.

use serde::Serialize;
use sinew_tune::page::Judgement;

/// One aim.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchAim {
    /// What is measured, and how.
    pub what: String,
    /// Value that just meets it.
    pub limit: f64,
    /// Value of this run.
    pub found: f64,
    /// Unit; `x` and `times` are ratios of times.
    pub unit: String,
    /// Whether it was met.
    pub met: bool,
    /// Why it is not judged, whatever was found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_judged: Option<String>,
}

impl BenchAim {
    /// An aim that is met at or below `limit`.
    pub fn at_most(what: impl Into<String>, limit: f64, unit: &str, found: f64) -> Self {
        Self {
            what: what.into(),
            limit,
            found,
            unit: unit.into(),
            met: found <= limit,
            not_judged: None,
        }
    }

    /// An aim that is met at or above `limit`, and says so.
    pub fn at_least(what: impl Into<String>, limit: f64, unit: &str, found: f64) -> Self {
        Self { met: found >= limit, ..Self::at_most(what, limit, unit, found) }
    }

    /// As found while the machine did other work as well: what hangs on times is not judged, but for times that are
    /// short enough all the same.
    #[must_use]
    pub fn on_a_busy_machine(mut self) -> Self {
        let time = ["ns/tet", "ms", "s"].contains(&self.unit.as_str());
        let ratio = ["x", "times"].contains(&self.unit.as_str());
        if ratio || (time && !self.met) {
            self.not_judged = Some("the machine was busy".into());
        }
        self
    }

    /// What this run says of it.
    pub fn judgement(&self) -> Judgement {
        match (&self.not_judged, self.met) {
            (Some(_), _) => Judgement::Open,
            (None, true) => Judgement::Yes,
            (None, false) => Judgement::No,
        }
    }
}
