//! A figure made again, and what it says about the paper.

use serde::Serialize;
use sinew_tune::page::Chart;
use sinew_tune::table::Table;

/// A statement of a paper held against the numbers of this run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Whether they agree.
    pub agrees: bool,
    /// The statement and the numbers.
    pub text: String,
}

impl Finding {
    /// Whether the numbers agree; [`Finding::says`] adds what they say.
    pub fn of(agrees: bool) -> Self {
        Self { agrees, text: String::new() }
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
