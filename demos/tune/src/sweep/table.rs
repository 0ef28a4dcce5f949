//! All runs of a sweep as one table.

use super::manifest::{Manifest, PlannedRun};
use super::record::SweepRow;
use super::study::Kept;
use crate::table::{Cell, Table};
use serde_json::Value;
use std::ops::Range;

/// All runs, a row each.
pub struct SweepTable {
    /// The table.
    pub cells: Table,
    /// Which columns are parameters.
    pub parameters: Range<usize>,
    /// Which columns are results.
    pub results: Range<usize>,
}

/// Columns between parameters and results.
const OUTCOME: [&str; 5] = ["status", "error", "warnings", "steps", "state_hash"];

/// Names of the columns of results.
fn result_columns(manifest: &Manifest) -> Vec<String> {
    let columns = manifest.header.columns.iter();
    match manifest.header.probes {
        Kept::Last | Kept::All => columns.cloned().collect(),
        Kept::Max => columns.flat_map(|c| [format!("min {c}"), format!("max {c}")]).collect(),
    }
}

/// Whole numbers are shown in full.
fn number(x: f64) -> Cell {
    let whole = x.fract() == 0.0 && (0.0..1e9).contains(&x) && x.is_sign_positive();
    if whole { Cell::Count(x as u64) } else { Cell::Number(x) }
}

fn parameter(value: &Value) -> Cell {
    match (value, value.as_f64()) {
        (Value::Null, _) => Cell::Missing,
        (Value::String(text), _) => Cell::from(text),
        (_, Some(x)) => number(x),
        (other, None) => Cell::Text(other.to_string()),
    }
}

impl SweepTable {
    /// Of the results that there are.
    pub(super) fn new(manifest: &Manifest, rows: &[Option<SweepRow>]) -> Self {
        let parameters = 2..2 + manifest.header.parameters.len();
        let values = result_columns(manifest);
        let start = parameters.end + OUTCOME.len();
        let results = start..start + values.len();
        let names = ["index", "id"].into_iter();
        let names = names.chain(manifest.header.parameters.iter().map(String::as_str));
        let names = names.chain(OUTCOME).chain(values.iter().map(String::as_str));
        let mut cells = Table::new("runs", "Runs", &names.collect::<Vec<_>>());
        for (run, row) in manifest.runs.iter().zip(rows) {
            cells.row(Self::cells(run, row.as_ref(), values.len()));
        }
        Self { cells, parameters, results }
    }

    fn cells(run: &PlannedRun, row: Option<&SweepRow>, values: usize) -> Vec<Cell> {
        let mut cells = vec![run.index.into(), Cell::from(&run.id)];
        cells.extend(run.values.iter().map(parameter));
        cells.extend(match row {
            None => ["missing".into(), Cell::Missing, Cell::Missing, Cell::Missing, Cell::Missing],
            Some(row) => [
                if row.error.is_none() { "ok" } else { "failed" }.into(),
                row.error.clone().unwrap_or_default().into(),
                Cell::from(&row.warnings),
                row.steps.into(),
                Cell::from(&row.state),
            ],
        });
        let value = |i: usize| row.and_then(|row| row.values.get(i).copied().flatten());
        cells.extend((0..values).map(|i| value(i).map_or(Cell::Missing, number)));
        cells
    }

    /// Index of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.cells.columns.iter().position(|column| column == name)
    }

    /// The values of a column, unless it holds words.
    pub fn numbers(&self, column: usize) -> Option<Vec<Option<f64>>> {
        let numbers = || self.cells.rows.iter().map(|row| row[column].number()).collect();
        (!self.is_words(column)).then(numbers)
    }

    /// Whether a column holds words, or would if there were a result.
    fn is_words(&self, column: usize) -> bool {
        let outcome = column.checked_sub(self.parameters.end).and_then(|i| OUTCOME.get(i));
        outcome.map_or(self.cells.is_words(column), |name| *name != "steps")
    }
}
