//! Observations: CSV files of displacements, or of reactions of constraints.

use super::error::{DataFitError, Result};
use glam::DVec3;
use serde::Serialize;
use sinew_scene::assemble::{BuiltBody, BuiltScene};
use sinew_scene::error::hint;
use std::path::{Path, PathBuf};

/// What was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Observed {
    /// Displacement (m) of a vertex along an axis.
    Displacement {
        /// Index of the body.
        body: usize,
        /// Index in the user's mesh.
        vertex: u32,
        /// 0, 1 or 2.
        axis: usize,
    },
    /// Force (N) of a constraint on its body along an axis.
    Reaction {
        /// Index of the constraint.
        constraint: usize,
        /// 0, 1 or 2.
        axis: usize,
    },
}

/// One measured number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// What was measured.
    pub measured: Observed,
    /// Factor on the loads, 0 to 1.
    pub load: f64,
    /// What was found (m or N).
    pub value: f64,
    /// What its residual is divided by: its standard deviation, or the largest value of its file over
    /// the root of its weight (m or N).
    pub scale: f64,
}

/// What a file of observations holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DataKind {
    /// Displacements of vertices (m).
    Displacements,
    /// Reactions of constraints (N).
    Forces,
}

impl DataKind {
    /// Unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Displacements => "m",
            Self::Forces => "N",
        }
    }
}

/// A file of observations.
#[derive(Clone, Debug, Serialize)]
pub struct DataFile {
    /// Its path.
    pub path: PathBuf,
    /// What it holds.
    pub kind: DataKind,
    /// Rows.
    pub rows: usize,
    /// Numbers that were observed.
    pub observations: usize,
    /// Largest observed displacement (m, length of the observed components) or force (N).
    pub largest: f64,
    /// Largest distance (m) from a given position to the vertex that it was taken for.
    pub farthest_vertex: f64,
    /// Indices of its observations.
    #[serde(skip)]
    pub range: std::ops::Range<usize>,
}

/// All observations of a fit.
#[derive(Clone, Debug, Default)]
pub struct Observations {
    /// Files.
    pub files: Vec<DataFile>,
    /// Observed numbers, file by file.
    pub list: Vec<Observation>,
    /// Whether they come with standard deviations.
    pub has_sigma: bool,
}

impl Observations {
    /// Reads files of observations for a scene.
    ///
    /// # Errors
    /// [`DataFitError::Io`], [`DataFitError::Table`], [`DataFitError::Header`] or [`DataFitError::Cell`].
    pub fn read(paths: &[PathBuf], scene: &BuiltScene) -> Result<Self> {
        let mut all = Self::default();
        for (i, path) in paths.iter().enumerate() {
            let has_sigma = read_file(path, scene, &mut all)?;
            if i > 0 && has_sigma != all.has_sigma {
                return Err(DataFitError::Header {
                    path: path.clone(),
                    found: "some files have a column `sigma` and others have none".into(),
                    remedy: "give standard deviations in all files or in none".into(),
                });
            }
            all.has_sigma = has_sigma;
        }
        Ok(all)
    }
}

/// Columns of a table of displacements.
const DISPLACEMENT_COLUMNS: &[&str] =
    &["vertex", "x", "y", "z", "ux", "uy", "uz", "body", "load", "weight", "sigma"];
/// Columns of a force-displacement curve.
const FORCE_COLUMNS: &[&str] = &["load", "force", "constraint", "axis", "weight", "sigma"];

/// A file that is being read.
struct ObservedTable<'a> {
    path: &'a Path,
    header: Vec<String>,
    line: u64,
    record: csv::StringRecord,
}

impl ObservedTable<'_> {
    fn has(&self, column: &str) -> bool {
        self.header.iter().any(|name| name == column)
    }

    /// What stands in a column of the row, `None` when there is no such column or nothing in it.
    fn text(&self, column: &str) -> Option<&str> {
        let at = self.header.iter().position(|name| name == column)?;
        self.record.get(at).map(str::trim).filter(|text| !text.is_empty())
    }

    fn cell(
        &self,
        column: &str,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> DataFitError {
        DataFitError::Cell {
            path: self.path.into(),
            line: self.line,
            column: column.into(),
            found: found.into(),
            remedy: remedy.into(),
        }
    }

    fn number(&self, column: &str) -> Result<Option<f64>> {
        let Some(text) = self.text(column) else { return Ok(None) };
        match text.parse::<f64>() {
            Ok(value) if value.abs() <= 1e12 => Ok(Some(value)),
            Ok(value) if value.is_finite() => {
                Err(self.cell(column, format!("{text} is beyond 1e12"), "check the unit, SI"))
            }
            _ => Err(self.cell(column, format!("`{text}` is no number"), "give a finite number")),
        }
    }

    fn required(&self, column: &str, remedy: &str) -> Result<f64> {
        self.number(column)?.ok_or_else(|| self.cell(column, "nothing is given", remedy))
    }

    fn load(&self) -> Result<f64> {
        let load = self.number("load")?.unwrap_or(1.0);
        if (0.0..=1.0).contains(&load) {
            return Ok(load);
        }
        let remedy = "it is a factor on loads and motions of the scene, from 0 to 1";
        Err(self.cell("load", format!("load is {load}"), remedy))
    }

    /// Divisor of the residual over the scale of the file (1 with `sigma`, which is absolute).
    fn scale(&self) -> Result<f64> {
        for column in ["sigma", "weight"] {
            if !self.has(column) {
                continue;
            }
            let value = self.required(column, "give a positive number in every row")?;
            if value <= 0.0 {
                let found = format!("{column} is {value}");
                return Err(self.cell(column, found, "give a positive number"));
            }
            return Ok(if column == "sigma" { value } else { 1.0 / value.sqrt() });
        }
        Ok(1.0)
    }
}

/// Reads one file and returns whether it has standard deviations.
fn read_file(path: &Path, scene: &BuiltScene, all: &mut Observations) -> Result<bool> {
    let io = |source: csv::Error| {
        let path = path.into();
        match source.is_io_error() {
            true => DataFitError::Io { path, source },
            false => DataFitError::Table { path, source },
        }
    };
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(io)?;
    let header: Vec<String> = reader.headers().map_err(io)?.iter().map(str::to_owned).collect();
    let has = |column: &str| header.iter().any(|name| name == column);
    let fault = |found: String, remedy: &str| {
        Err(DataFitError::Header { path: path.into(), found, remedy: remedy.into() })
    };
    let forces = has("force");
    let known = if forces { FORCE_COLUMNS } else { DISPLACEMENT_COLUMNS };
    for (i, name) in header.iter().enumerate() {
        if !known.contains(&name.as_str()) {
            let remedy = hint("column", name, known.iter().copied());
            return fault(format!("unknown column `{name}`"), &remedy);
        }
        if header[..i].contains(name) {
            return fault(format!("column `{name}` stands twice"), "keep one of them");
        }
    }
    if has("sigma") && has("weight") {
        return fault("both `sigma` and `weight` are given".into(), "keep one of them");
    }
    if forces {
        if let Some(name) = ["load", "constraint", "axis"].into_iter().find(|name| !has(name)) {
            let remedy = "a curve has the columns load, force, constraint and axis";
            return fault(format!("there is no column `{name}`"), remedy);
        }
    } else {
        if !["ux", "uy", "uz"].into_iter().any(has) {
            let remedy = "give `ux`, `uy`, `uz` (m), or `force` (N) for a curve";
            return fault("there is neither a displacement nor a force".into(), remedy);
        }
        let place = ["x", "y", "z"].into_iter().filter(|name| has(name)).count();
        if has("vertex") == (place > 0) || (place > 0 && place < 3) {
            let remedy =
                "give `vertex` (index in the mesh), or `x`, `y` and `z` (rest position, m)";
            return fault("it does not say which vertices".into(), remedy);
        }
    }
    let kind = if forces { DataKind::Forces } else { DataKind::Displacements };
    let has_sigma = has("sigma");
    let first = all.list.len();
    let (mut rows, mut largest, mut farthest) = (0, 0.0_f64, 0.0_f64);
    let mut table = ObservedTable { path, header, line: 0, record: csv::StringRecord::new() };
    while reader.read_record(&mut table.record).map_err(io)? {
        table.line = table.record.position().map_or(0, csv::Position::line);
        rows += 1;
        let (load, scale) = (table.load()?, table.scale()?);
        if forces {
            let (measured, value) = reaction(&table, scene)?;
            largest = largest.max(value.abs());
            all.list.push(Observation { measured, load, value, scale });
            continue;
        }
        let (body, vertex, distance) = vertex(&table, scene)?;
        farthest = farthest.max(distance);
        let mut length = 0.0;
        for (axis, column) in ["ux", "uy", "uz"].into_iter().enumerate() {
            let Some(value) = table.number(column)? else { continue };
            let measured = Observed::Displacement { body, vertex, axis };
            all.list.push(Observation { measured, load, value, scale });
            length = f64::hypot(length, value);
        }
        largest = largest.max(length);
    }
    let range = first..all.list.len();
    if range.is_empty() {
        return fault("there is no observation".into(), "give at least one row with a value");
    }
    if !has_sigma {
        if largest == 0.0 {
            let remedy = "give some that are not zero, or a column `sigma`";
            return fault("all observations are zero".into(), remedy);
        }
        all.list[range.clone()].iter_mut().for_each(|o| o.scale *= largest);
    }
    let observations = range.len();
    let (path, farthest_vertex) = (path.to_path_buf(), farthest);
    all.files.push(DataFile { path, kind, rows, observations, largest, farthest_vertex, range });
    Ok(has_sigma)
}

/// The constraint, axis and force of a row.
fn reaction(table: &ObservedTable, scene: &BuiltScene) -> Result<(Observed, f64)> {
    let name = table.text("constraint").unwrap_or_default();
    let names = || scene.constraints.iter().map(|c| c.name.as_str());
    let constraint = names().position(|known| known == name).ok_or_else(|| {
        let remedy = hint("constraint", name, names());
        table.cell("constraint", format!("the scene has no constraint `{name}`"), remedy)
    })?;
    let letter = table.text("axis").unwrap_or_default();
    let axis = ["x", "y", "z"]
        .into_iter()
        .position(|known| known == letter)
        .ok_or_else(|| table.cell("axis", format!("axis is `{letter}`"), "give x, y or z"))?;
    if !scene.constraints[constraint].axes.holds(axis) {
        let found = format!("constraint `{name}` does not hold {letter}, its force there is zero");
        return Err(table.cell("axis", found, "give an axis that it holds"));
    }
    let value = table.required("force", "give the force (N) of the constraint on the body")?;
    Ok((Observed::Reaction { constraint, axis }, value))
}

/// The body and vertex of a row, and how far (m) the vertex is from the given position.
fn vertex(table: &ObservedTable, scene: &BuiltScene) -> Result<(usize, u32, f64)> {
    let names = || scene.bodies.iter().map(|b| b.name.as_str());
    let body = match table.text("body") {
        Some(name) => names().position(|known| known == name).ok_or_else(|| {
            let remedy = hint("body", name, names());
            table.cell("body", format!("the scene has no body `{name}`"), remedy)
        })?,
        None if scene.bodies.len() == 1 => 0,
        None => {
            let remedy = format!("name one of {}", names().collect::<Vec<_>>().join(", "));
            return Err(table.cell("body", "the scene has several bodies", remedy));
        }
    };
    let of = &scene.bodies[body];
    if table.has("vertex") {
        let text = table.text("vertex").unwrap_or_default();
        let vertex = text.parse::<u32>().map_err(|_| {
            let remedy = "give the index in the mesh, counted from 0";
            table.cell("vertex", format!("`{text}` is no vertex"), remedy)
        })?;
        if of.used_vertices.binary_search(&vertex).is_err() {
            let found = format!(
                "vertex {vertex} does not exist in body `{}` of {} points, or no element uses it",
                of.name,
                of.mesh.points.len()
            );
            let remedy = "indices count from 0 in the order of the mesh";
            return Err(table.cell("vertex", found, remedy));
        }
        return Ok((body, vertex, 0.0));
    }
    let mut at = DVec3::ZERO;
    for (axis, column) in ["x", "y", "z"].into_iter().enumerate() {
        at[axis] = table.required(column, "give the rest position (m)")?;
    }
    let (vertex, distance) = nearest(of, at);
    let spacing = of
        .used_vertices
        .iter()
        .filter(|&&other| other != vertex)
        .map(|&other| of.mesh.points[other as usize].distance(of.mesh.points[vertex as usize]))
        .fold(f64::INFINITY, f64::min);
    if distance > 0.5 * spacing {
        let found = format!(
            "position {at} is {distance:.3e} m from the nearest vertex ({vertex}), more than half of \
             the {spacing:.3e} m to its neighbour"
        );
        let remedy = "give rest positions in metres, in the frame of the scene, near vertices";
        return Err(table.cell("x", found, remedy));
    }
    Ok((body, vertex, distance))
}

/// The used vertex nearest to a position, and its distance (m).
fn nearest(body: &BuiltBody, at: DVec3) -> (u32, f64) {
    let mut best = (0, f64::INFINITY);
    for &vertex in &body.used_vertices {
        let distance = body.mesh.points[vertex as usize].distance(at);
        if distance < best.1 {
            best = (vertex, distance);
        }
    }
    best
}
