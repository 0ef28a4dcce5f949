//! The page of a sweep: failures with their texts, scatter plots, the table.

use super::manifest::Manifest;
use super::sampling::RangeScale;
use super::table::SweepTable;
use crate::chart::Axes;
use crate::page::{Chart, Page};
use crate::table::{Cell, Table, escape, three_digits};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Rows of the table that a page shows.
const ROWS: usize = 1000;
/// Points of a plot.
const POINTS: usize = 2000;
/// Parameters and results that are plotted against each other.
const PLOTTED: (usize, usize) = (6, 12);
/// Failures of a kind that are listed.
const ALIKE: usize = 8;

/// Writes the page.
pub(super) fn page(
    manifest: &Manifest,
    table: &SweepTable,
    [failed, missing]: [usize; 2],
) -> String {
    let header = &manifest.header;
    let scene = header.scene.file_stem().unwrap_or_default().to_string_lossy();
    let runs = manifest.runs.len();
    let mut about = format!("{runs} runs of {}, {failed} failed", header.scene.display());
    if missing > 0 {
        let _ = write!(about, ", {missing} without a result");
    }
    let _ = write!(about, ". Sinew {}, {}.", header.engine, header.instruction_set.name());
    let title = format!("Sweep: {scene}");
    let mut page = Page::new(&title, &title, &about);
    page.add(format_args!("<style>{STYLE}</style>"));
    failures(&mut page, table, runs);
    plots(&mut page, table, runs, &header.scales);
    page.table(&rows(table, runs));
    if runs > ROWS {
        page.paragraph("note", &format!("The first {ROWS} of {runs} runs; all are in table.csv."));
    }
    page.html()
}

const STYLE: &str = "\
.plots { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 340px), 1fr)); gap: 12px; }
.plots figure { margin: 0; min-width: 0; }
.plots svg { width: 100%; border: 1px solid #e2e2e2; }
.plots figcaption { font-size: 13px; overflow-wrap: anywhere; }
.failure { border-left: 4px solid #c0392b; background: #fdf1ef; padding: 6px 10px; margin: 8px 0; overflow-wrap: anywhere; }
.failure p { max-width: none; }
td.words { white-space: normal; min-width: 9em; max-width: 40em; overflow-wrap: anywhere; }
@media (max-width: 600px) { main { padding: 12px; } h1 { font-size: 22px; overflow-wrap: anywhere; } }
";

/// Failures, those whose texts differ in numbers alone together.
fn failures(page: &mut Page, table: &SweepTable, runs: usize) {
    let Some(column) = table.column("error") else { return };
    let rows = &table.cells.rows;
    let error = |row: usize| match &rows[row][column] {
        Cell::Text(text) => text.as_str(),
        _ => "",
    };
    let mut alike: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for row in (0..runs).filter(|row| !error(*row).is_empty()) {
        alike.entry(without_numbers(error(row))).or_default().push(row);
    }
    if alike.is_empty() {
        return;
    }
    let mut alike: Vec<_> = alike.into_iter().collect();
    alike.sort_by_key(|(_, rows)| (std::cmp::Reverse(rows.len()), rows[0]));
    page.add("<h2 id=\"failures\">Failures</h2>");
    let texts = alike.len();
    for (_, same) in alike.into_iter().take(100) {
        let text = error(same[0]);
        let runs = if same.len() == 1 {
            "1 run".to_string()
        } else {
            format!("{} runs like this", same.len())
        };
        page.add(format_args!("<div class=\"failure\"><p><b>{runs}</b>: {}</p>", escape(text)));
        let given = |row: usize| {
            let value = |c: usize| format!("{} = {}", table.cells.columns[c], rows[row][c].shown());
            let values = table.parameters.clone().map(value);
            format!("run {row}: {}", values.collect::<Vec<_>>().join(", "))
        };
        for &row in same.iter().take(ALIKE) {
            page.paragraph("note", &given(row));
        }
        if same.len() > ALIKE {
            page.paragraph(
                "note",
                &format!("and {} more, listed in table.csv", same.len() - ALIKE),
            );
        }
        page.add("</div>");
    }
    if texts > 100 {
        page.paragraph("note", &format!("and {} other texts, listed in table.csv", texts - 100));
    }
}

/// A text with its numbers left out.
fn without_numbers(text: &str) -> String {
    text.chars().filter(|c| !c.is_ascii_digit()).collect()
}

/// Every result over every parameter that varies.
fn plots(page: &mut Page, table: &SweepTable, runs: usize, scales: &[Option<RangeScale>]) {
    let varies = |cells: &[Option<f64>]| {
        let mut known = cells.iter().flatten();
        known.next().is_some_and(|first| known.any(|x| x != first))
    };
    let numbers = |range: std::ops::Range<usize>| {
        range.filter_map(move |column| {
            let cells = table.numbers(column).filter(|cells| varies(cells))?;
            Some((column, &table.cells.columns[column], cells))
        })
    };
    let parameters: Vec<_> = numbers(table.parameters.clone()).collect();
    let results: Vec<_> = numbers(table.results.clone()).collect();
    let shown: Vec<_> = results.iter().take(PLOTTED.1).collect();
    if parameters.is_empty() || shown.is_empty() {
        return;
    }
    page.add("<h2 id=\"plots\">Results over parameters</h2>");
    let every = runs.div_ceil(POINTS).max(1);
    let mut notes = Vec::new();
    if every > 1 {
        notes.push(format!("Every {every}th run is drawn."));
    }
    if parameters.len() > PLOTTED.0 || results.len() > PLOTTED.1 {
        notes.push(format!(
            "The first {} of {} parameters and {} of {} results that vary are drawn.",
            parameters.len().min(PLOTTED.0),
            parameters.len(),
            shown.len(),
            results.len()
        ));
    }
    if !notes.is_empty() {
        page.paragraph("note", &notes.join(" "));
    }
    page.add("<div class=\"plots\">");
    for (i, (_, result, y)) in shown.into_iter().enumerate() {
        for (k, (column, parameter, x)) in parameters.iter().take(PLOTTED.0).enumerate() {
            let points: Vec<(usize, f64, f64)> =
                (0..runs).step_by(every).filter_map(|row| Some((row, x[row]?, y[row]?))).collect();
            let scale = scales.get(column - table.parameters.start).copied().flatten();
            if let Some(svg) = scatter(&points, (parameter, scale), result) {
                page.chart(&Chart { name: format!("{i}-{k}"), svg });
            }
        }
    }
    page.add("</div>");
}

/// A scatter plot; the axis of a parameter has the scale that the study gives it, else it is logarithmic over a decade and more.
fn scatter(
    points: &[(usize, f64, f64)],
    (parameter, scale): (&str, Option<RangeScale>),
    result: &str,
) -> Option<String> {
    let ends = |of: fn(&(usize, f64, f64)) -> f64| {
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        points.iter().map(of).fold(start, |(low, high), x| (low.min(x), high.max(x)))
    };
    let (x, y) = (ends(|p| p.1), ends(|p| p.2));
    if points.is_empty() || !(x.1 - x.0).is_finite() || !(y.1 - y.0).is_finite() {
        return None;
    }
    let log = x.0 > 0.0 && scale.map_or(x.1 >= 10.0 * x.0, |scale| scale == RangeScale::Log);
    let axes = Axes { size: [360.0, 240.0], x, y, log };
    let mut svg = axes.begin(result, parameter);
    let _ = writeln!(svg, "<g fill=\"#0059a8\" fill-opacity=\"0.55\">");
    let radius = if points.len() > 400 { 1.8 } else { 3.0 };
    for (row, px, py) in points {
        let _ = writeln!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\"><title>run {row}: {}, {}</title></circle>",
            axes.across(*px),
            axes.up(*py),
            three_digits(*px),
            three_digits(*py)
        );
    }
    Some(svg + "</g>\n</svg>")
}

/// The first rows, without ids, hashes and columns that have nothing to say.
fn rows(table: &SweepTable, runs: usize) -> Table {
    let cells = &table.cells;
    let silent = |cell: &Cell| matches!(cell, Cell::Missing) || *cell == Cell::from("");
    let plain = |&column: &usize| {
        !["id", "state_hash"].contains(&cells.columns[column].as_str())
            && (table.numbers(column).is_some() || !cells.rows.iter().all(|r| silent(&r[column])))
    };
    let shown: Vec<usize> = (0..cells.columns.len()).filter(plain).collect();
    let names: Vec<&str> = shown.iter().map(|&column| cells.columns[column].as_str()).collect();
    let mut rows = Table::new("runs", "Runs", &names);
    for row in &cells.rows[..runs.min(ROWS)] {
        rows.row(shown.iter().map(|&column| row[column].clone()).collect());
    }
    rows
}
