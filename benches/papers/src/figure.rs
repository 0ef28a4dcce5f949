//! A figure made again, and what it says about the paper.

use serde::Serialize;
use sinew_tune::page::{Chart, Judgement};
use sinew_tune::table::Table;

/// A statement of a paper held against the numbers of this run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Whether they agree.
    pub agrees: bool,
    /// The statement and the numbers.
    pub text: String,
    /// Whether it hangs on times, which a busy machine makes longer.
    pub timed: bool,
    /// Whether the machine was too busy to judge it.
    pub not_judged: bool,
}

impl Finding {
    /// Whether the numbers agree; [`Finding::says`] adds what they say.
    pub fn of(agrees: bool) -> Self {
        Self { agrees, text: String::new(), timed: false, not_judged: false }
    }

    /// One that hangs on times.
    pub fn of_times(agrees: bool) -> Self {
        Self { timed: true, ..Self::of(agrees) }
    }

    /// How it was judged.
    pub fn judgement(&self) -> Judgement {
        match (self.not_judged, self.agrees) {
            (true, _) => Judgement::Open,
            (false, true) => Judgement::Yes,
            (false, false) => Judgement::No,
        }
    }

    /// With the statement and the numbers.
    #[must_use]
    pub fn says(self, text: impl Into<String>) -> Self {
        Self { text: text.into(), ..self }
    }
}

/// A figure or table of a paper, made again.
#[derive(Default)]
pub struct Figure {
    /// How it was made: sizes and settings that the paper does not print.
    pub setting: String,
    /// What agrees with the paper and what does not.
    pub findings: Vec<Finding>,
    /// What people read.
    pub tables: Vec<Table>,
    /// All numbers, for files only.
    pub numbers: Vec<Table>,
    /// Charts.
    pub charts: Vec<Chart>,
}
