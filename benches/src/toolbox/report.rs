//! What every report is made of, tables and charts, and the one writer of files.

use crate::toolbox::error::{BenchError, Result};
use serde::Serialize;
use sinew_tune::page::Chart;
use sinew_tune::table::Table;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Files of a report by name.
#[derive(Default)]
pub struct ReportFiles(Vec<(String, Vec<u8>)>);

impl ReportFiles {
    /// One more file.
    pub fn add(&mut self, name: impl Into<String>, content: impl Into<Vec<u8>>) {
        self.0.push((name.into(), content.into()));
    }

    /// A value in JSON.
    ///
    /// # Errors
    /// When it has no such form.
    pub fn json(&mut self, name: impl Into<String>, value: &impl Serialize) -> Result<()> {
        let name = name.into();
        let text = serde_json::to_string_pretty(value).map_err(|e| failed(Path::new(&name), e))?;
        self.add(name, text + "\n");
        Ok(())
    }

    /// One SVG file a chart and one CSV file a table.
    ///
    /// # Errors
    /// When a table has no such form.
    pub fn parts<'a>(
        &mut self,
        charts: &[Chart],
        tables: impl IntoIterator<Item = &'a Table>,
    ) -> Result<()> {
        for chart in charts {
            self.add(format!("{}.svg", chart.name), chart.svg.as_str());
        }
        for table in tables {
            let name = format!("{}.csv", table.name);
            let csv = table.csv().map_err(|e| failed(Path::new(&name), e))?;
            self.add(name, csv);
        }
        Ok(())
    }

    /// Writes them into a folder, which is made; returns their paths.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(self, folder: &Path) -> Result<Vec<PathBuf>> {
        std::fs::create_dir_all(folder).map_err(|e| failed(folder, e))?;
        let write = |(name, content): (String, Vec<u8>)| {
            let path = folder.join(name);
            std::fs::write(&path, content).map_err(|e| failed(&path, e))?;
            Ok(path)
        };
        self.0.into_iter().map(write).collect()
    }
}

fn failed(path: &Path, reason: impl Display) -> BenchError {
    BenchError::Write { path: path.into(), reason: reason.to_string() }
}
