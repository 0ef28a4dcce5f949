//! What every report is made of, tables, charts and findings, and the one writer of pages and files.

use crate::bench::error::BenchError;
use crate::bench::machine::MachineNotes;
use crate::bench::table::{Table, escape};
use serde::Serialize;
use std::fmt::{Display, Write};
use std::path::{Path, PathBuf};

/// A chart and what it is called.
pub struct Chart {
    /// Name of the file.
    pub name: String,
    /// SVG text.
    pub svg: String,
}

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

/// Rows above which a table is folded in a page.
const LONG: usize = 60;

/// A self-contained page in the style of all reports.
pub struct Page {
    title: String,
    body: String,
}

impl Page {
    /// A page that begins with a heading and the machine.
    pub fn new(title: impl Into<String>, heading: &str, machine: &MachineNotes) -> Self {
        let mut page = Self { title: title.into(), body: String::new() };
        page.add(format_args!("<h1>{}</h1>", escape(heading)));
        page.paragraph("machine", &machine.line());
        page
    }

    /// A line of HTML as it stands.
    pub fn add(&mut self, html: impl Display) {
        let _ = writeln!(self.body, "{html}");
    }

    /// A paragraph of plain text in a style, which may be empty.
    pub fn paragraph(&mut self, class: &str, text: &str) {
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
        self.add(format_args!("<p{class}>{}</p>", escape(text)));
    }

    /// A chart.
    pub fn chart(&mut self, chart: &Chart) {
        // the page decides on the size
        let svg = chart.svg.find("<svg").map_or(&*chart.svg, |at| &chart.svg[at..]);
        self.add(format_args!("<figure id=\"chart-{}\">{svg}</figure>", chart.name));
    }

    /// A table; a long one is folded.
    pub fn table(&mut self, table: &Table) {
        if table.rows.len() <= LONG {
            self.body += &table.html();
            return;
        }
        let (title, rows) = (escape(&table.title), table.rows.len());
        self.add(format_args!(
            "<details><summary>{title} ({rows} rows)</summary>\n{}</details>",
            table.html()
        ));
    }

    /// All of it.
    pub fn html(self) -> String {
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width\">\n<title>{}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{}</main>\n</body>\n</html>\n",
            escape(&self.title),
            self.body
        )
    }
}

/// Files of a report by name.
#[derive(Default)]
pub struct Files(Vec<(String, Vec<u8>)>);

impl Files {
    /// One more file.
    pub fn add(&mut self, name: impl Into<String>, content: impl Into<Vec<u8>>) {
        self.0.push((name.into(), content.into()));
    }

    /// A value in JSON.
    ///
    /// # Errors
    /// When it has no such form.
    pub fn json(
        &mut self,
        name: impl Into<String>,
        value: &impl Serialize,
    ) -> Result<(), BenchError> {
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
    ) -> Result<(), BenchError> {
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
    pub fn write(self, folder: &Path) -> Result<Vec<PathBuf>, BenchError> {
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

const STYLE: &str = "\
body { margin: 0; background: #fff; color: #222; font: 15px/1.45 system-ui, sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 24px; }
h1 { font-size: 26px; margin: 0 0 4px; }
h2 { font-size: 21px; margin: 36px 0 8px; }
h3 { font-size: 17px; margin: 28px 0 6px; }
p { margin: 6px 0; max-width: 90ch; }
.machine, .note { color: #444; font-size: 13px; }
.warning { background: #fff3d6; border-left: 4px solid #d98e00; padding: 6px 10px; }
code { background: #f2f2f2; padding: 1px 4px; border-radius: 3px; }
nav { margin: 12px 0; font-size: 14px; }
nav a { margin-right: 12px; color: #0059a8; }
figure { margin: 18px 0; }
figure svg { max-width: 100%; height: auto; border: 1px solid #e2e2e2; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 9px; border-bottom: 1px solid #e4e4e4; text-align: right; white-space: nowrap; }
th { background: #f4f4f4; position: sticky; top: 0; }
.words { text-align: left; }
tr.marked td { background: #e8f4e8; font-weight: 600; }
summary { cursor: pointer; font-weight: 600; margin: 18px 0 4px; }
";
