//! `sinew plot`: what runs recorded over time, several runs over each other.

use crate::chart::Curves;
use crate::page::{Chart, Page};
use sinew_render::scene::Series;
use std::path::{Path, PathBuf};

/// Why nothing could be drawn.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", .path.display())]
pub struct PlotError {
    path: PathBuf,
    problem: String,
}

impl PlotError {
    fn of(path: &Path, problem: impl ToString) -> Self {
        Self { path: path.into(), problem: problem.to_string() }
    }
}

/// A table of numbers.
struct Recorded {
    name: String,
    columns: Vec<String>,
    rows: Vec<Vec<Option<f64>>>,
}

fn read(path: &Path) -> Result<Recorded, PlotError> {
    let error = |e: csv::Error| PlotError::of(path, e);
    let mut reader = csv::Reader::from_path(path).map_err(error)?;
    let columns = reader.headers().map_err(error)?.iter().map(str::to_owned).collect();
    let rows = reader.records().map(|row| {
        Ok(row
            .map_err(error)?
            .iter()
            .map(|x| x.parse().ok().filter(|x: &f64| x.is_finite()))
            .collect())
    });
    let rows = rows.collect::<Result<_, _>>()?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Recorded { name, columns, rows })
}

/// A column as its quantity, with the unit, and the part of a vector that it is.
fn quantity(column: &str) -> (String, &str) {
    let (name, unit) = column.split_once(" (").unwrap_or((column, ""));
    let unit = unit.trim_end_matches(')');
    let part = ["_x", "_y", "_z"].into_iter().find(|end| name.ends_with(end));
    let name = name.strip_suffix(part.unwrap_or_default()).unwrap_or(name).replace('_', " ");
    let name = if matches!(unit, "" | "-") { name } else { format!("{name} ({unit})") };
    (name, part.map_or("", |part| &part[1..]))
}

/// One chart of every quantity that probes recorded, or of those whose columns hold one of the words; forces come first.
/// Runs after the first are drawn over it where they have the same columns.
///
/// # Errors
/// When a file cannot be read, or there is nothing to draw.
pub fn charts(files: &[PathBuf], words: &[String]) -> Result<Vec<(String, Chart)>, PlotError> {
    let mut runs = files.iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;
    // names that are the same say nothing: those of the folders are told
    if runs.len() > 1 && runs.iter().all(|run| run.name == runs[0].name) {
        for (run, path) in runs.iter_mut().zip(files) {
            run.name = path.with_extension("").display().to_string();
        }
    }
    let first = &runs[0];
    let time = usize::from(first.columns.first().is_some_and(|c| c == "step"));
    let wanted = |column: &&String| match words {
        // what probes recorded has a unit in brackets
        [] => column.ends_with(')'),
        words => words.iter().any(|word| column.contains(word.as_str())),
    };
    let mut found: Vec<(String, Vec<&String>)> = Vec::new();
    for column in first.columns.iter().skip(time + 1).filter(wanted) {
        let (name, _) = quantity(column);
        match found.iter_mut().find(|(known, _)| *known == name) {
            Some((_, columns)) => columns.push(column),
            None => found.push((name, vec![column])),
        }
    }
    found.sort_by_key(|(name, _)| !name.ends_with("(N)"));
    let curves = found.into_iter().map(|(name, columns)| {
        let of = |run: &Recorded| {
            let lines = columns.iter().filter_map(|column| {
                let at = run.columns.iter().position(|own| own == *column)?;
                let points =
                    run.rows.iter().filter_map(|row| Some([(*row.get(time)?)?, (*row.get(at)?)?]));
                Some(Series { name: quantity(column).1.into(), points: points.collect() })
            });
            (run.name.clone(), lines.collect())
        };
        Curves { name, runs: runs.iter().map(of).collect() }
    });
    let name = if time == 1 { "time (s)" } else { first.columns.first().map_or("", |c| c) };
    let charts: Vec<_> =
        curves.filter_map(|curves| Some((curves.name.clone(), curves.chart(name)?))).collect();
    if charts.is_empty() {
        let found = if words.is_empty() {
            "no probe recorded anything".into()
        } else {
            format!("no column holds {}", words.join(", "))
        };
        let known = first.columns.join(", ");
        return Err(PlotError::of(
            &files[0],
            format!("{found}; give --column WORD; columns: {known}"),
        ));
    }
    Ok(charts)
}

/// Writes charts into one file: a picture (`.svg`) of all below each other, or a page.
///
/// # Errors
/// When it cannot be written.
pub fn write(path: &Path, files: &[PathBuf], charts: &[(String, Chart)]) -> Result<(), PlotError> {
    let text = if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("svg")) {
        stacked(charts)
    } else {
        let names: Vec<_> = files.iter().map(|file| file.display().to_string()).collect();
        let mut page = Page::new(names[0].as_str(), "Recorded over time", &names.join(", "));
        charts.iter().for_each(|(_, chart)| page.chart(chart));
        page.html()
    };
    std::fs::write(path, text).map_err(|e| PlotError::of(path, e))
}

/// Charts below each other.
fn stacked(charts: &[(String, Chart)]) -> String {
    let [width, height] = crate::chart::CURVES;
    let all = height * charts.len() as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {all}\" width=\"{width}\" height=\"{all}\">\n\
         <rect width=\"{width}\" height=\"{all}\" fill=\"#fff\"/>\n"
    );
    for (i, (_, chart)) in charts.iter().enumerate() {
        let y = height * i as f64;
        let place = format!("<svg y=\"{y}\" width=\"{width}\" height=\"{height}\"");
        svg += &chart.svg.replacen("<svg", &place, 1);
        svg.push('\n');
    }
    svg + "</svg>\n"
}
