//! One table of all results.

use super::error::SweepError;
use super::manifest::{Manifest, write_whole};
use super::page::page;
use super::record::{Results, Row};
use super::run::quoted;
use super::study::Kept;
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What merging made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Merged {
    /// Runs.
    pub runs: usize,
    /// Those that failed.
    pub failed: usize,
    /// Those without a result.
    pub missing: usize,
    /// Files written.
    pub files: Vec<PathBuf>,
}

/// A column of the table.
pub(super) struct Column {
    pub name: String,
    pub cells: Cells,
}

/// Its cells, one a run.
pub(super) enum Cells {
    Number(Vec<Option<f64>>),
    Text(Vec<Option<String>>),
}

impl Column {
    fn new(name: impl Into<String>, cells: Cells) -> Self {
        Self { name: name.into(), cells }
    }

    fn write(&self, row: usize, into: &mut String) {
        match &self.cells {
            Cells::Number(cells) => {
                if let Some(x) = cells[row] {
                    let start = into.len();
                    let _ = write!(into, "{x:?}");
                    if into.ends_with(".0") {
                        into.truncate(into.len() - 2);
                    }
                    debug_assert!(into.len() > start);
                }
            }
            Cells::Text(cells) => {
                let text = cells[row].as_deref().unwrap_or_default();
                if text.contains([',', '"', '\n', '\r']) {
                    let _ = write!(into, "\"{}\"", text.replace('"', "\"\""));
                } else {
                    into.push_str(text);
                }
            }
        }
    }
}

/// Names of the columns of results.
fn result_columns(manifest: &Manifest) -> Vec<String> {
    let columns = manifest.header.columns.iter();
    match manifest.header.probes {
        Kept::Last | Kept::All => columns.cloned().collect(),
        Kept::Max => columns.flat_map(|c| [format!("min {c}"), format!("max {c}")]).collect(),
    }
}

/// All columns in the order of the table.
pub(super) struct SweepTable {
    pub columns: Vec<Column>,
    /// Which columns are parameters.
    pub parameters: std::ops::Range<usize>,
    /// Which columns are results.
    pub results: std::ops::Range<usize>,
}

impl SweepTable {
    fn new(manifest: &Manifest, results: &Results) -> Self {
        let rows = &results.rows;
        let runs = &manifest.runs;
        let text = |of: fn(&Row) -> String| {
            Cells::Text(rows.iter().map(|row| row.as_ref().map(of)).collect())
        };
        let index = runs.iter().map(|run| Some(run.index as f64)).collect();
        let ids = runs.iter().map(|run| Some(run.id.clone())).collect();
        let mut columns =
            vec![Column::new("index", Cells::Number(index)), Column::new("id", Cells::Text(ids))];
        for (i, name) in manifest.header.parameters.iter().enumerate() {
            let values = || runs.iter().map(|run| &run.values[i]);
            let numbers = values().all(|value| value.is_number() || value.is_null());
            let shown = |value: &Value| match value {
                Value::Null => None,
                Value::String(text) => Some(text.clone()),
                other => Some(other.to_string()),
            };
            let cells = match numbers {
                true => Cells::Number(values().map(Value::as_f64).collect()),
                false => Cells::Text(values().map(shown).collect()),
            };
            columns.push(Column::new(name, cells));
        }
        let parameters = 2..columns.len();
        let status = |row: &Option<Row>| match row {
            None => "missing",
            Some(Row { error: None, .. }) => "ok",
            Some(_) => "failed",
        };
        let status = rows.iter().map(|row| Some(status(row).to_string())).collect();
        columns.push(Column::new("status", Cells::Text(status)));
        columns.push(Column::new("error", text(|row| row.error.clone().unwrap_or_default())));
        columns.push(Column::new("warnings", text(|row| row.warnings.clone())));
        let steps = rows.iter().map(|row| row.as_ref().map(|row| row.steps as f64)).collect();
        columns.push(Column::new("steps", Cells::Number(steps)));
        columns.push(Column::new("state_hash", text(|row| row.state.clone())));
        let start = columns.len();
        for (i, name) in result_columns(manifest).into_iter().enumerate() {
            let value = |row: &Option<Row>| row.as_ref()?.values.get(i).copied().flatten();
            columns.push(Column::new(name, Cells::Number(rows.iter().map(value).collect())));
        }
        let results = start..columns.len();
        Self { columns, parameters, results }
    }

    fn csv(&self, runs: usize) -> String {
        let head: Vec<String> = self.columns.iter().map(|c| quoted(&c.name)).collect();
        let mut text = head.join(",") + "\n";
        for row in 0..runs {
            for (i, column) in self.columns.iter().enumerate() {
                if i > 0 {
                    text.push(',');
                }
                column.write(row, &mut text);
            }
            text.push('\n');
        }
        text
    }
}

/// Writes `table.csv` and `sweep.html`, and `table.parquet` in a build with that feature, into the folder of a sweep.
///
/// The bytes do not depend on how the runs were divided.
///
/// # Errors
/// [`SweepError::Incomplete`] unless `partial`, [`SweepError::Conflict`], or a file that cannot be read or written.
pub fn merge(folder: &Path, partial: bool) -> Result<Merged, SweepError> {
    let manifest = Manifest::read(folder)?;
    let results = Results::read(folder, &manifest, None)?;
    let (runs, missing) = (manifest.runs.len(), results.missing().count());
    if let Some(first) = results.missing().next().filter(|_| !partial) {
        return Err(SweepError::Incomplete { missing, runs, first });
    }
    let failed = results.failed();
    let table = SweepTable::new(&manifest, &results);
    drop(results);
    let mut files = vec![folder.join("table.csv")];
    write_whole(&files[0], table.csv(runs).as_bytes())?;
    #[cfg(feature = "parquet")]
    {
        let path = folder.join("table.parquet");
        write_whole(&path, &super::parquet::bytes(&table, &path)?)?;
        files.push(path);
    }
    let path = folder.join("sweep.html");
    write_whole(&path, page(&manifest, &table, [failed, missing]).as_bytes())?;
    files.push(path);
    Ok(Merged { runs, failed, missing, files })
}
