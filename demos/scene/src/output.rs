//! VTU frames with their PVD index, and the CSV of probes. All bodies of a scene are in one frame;
//! the cell field `body` tells them apart.

use crate::assemble::{BuiltBody, BuiltScene};
use crate::error::RunError;
use crate::probe;
use crate::warning::{Level, Warning};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::engine::connectivity::{ByKind, ElementKind};
use sinew::engine::mesh::LINEAR;
use sinew::engine::mesh::io::{VtuData, write_pvd, write_vtu};
use sinew::engine::mesh::{CellData, Mesh, MeshError};
use sinew::models::axes::field::to_cell_data;
use sinew::models::cutting::cut_material;
use std::collections::BTreeSet;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Columns of every CSV file, before those of the probes.
pub const COMMON_COLUMNS: [&str; 13] = [
    "step",
    "time_s",
    "elastic_energy_J",
    "kinetic_energy_J",
    "load_work_J",
    "constraint_work_J",
    "recovery_J",
    "dissipated_J",
    "smallest_J",
    "inverted",
    "newton_iterations",
    "cg_iterations",
    "step_ms",
];

/// Columns after these of a scene in which something touches.
pub const CONTACT_COLUMNS: [&str; 7] = [
    "contact_work_J",
    "contact_energy_J",
    "friction_J",
    "contact_points",
    "contact_depth_m",
    "inner_iterations",
    "forces_unconverged",
];

/// Cell data that every frame has.
const FRAME_CELL_DATA: [&str; 2] = ["J", "body"];

/// The fibres of a body as cell data: unit vectors at rest, `NAME_x`, `NAME_y` and `NAME_z`.
fn fibre_data(body: &BuiltBody) -> Vec<CellData> {
    let count = body.mesh.tetrahedra.len() + body.mesh.hexahedra.len();
    let families = body.axes.iter().flat_map(|axes| &axes.families);
    families
        .flat_map(|family| {
            let all = match family.directions.len() {
                1 => vec![family.directions[0]; count],
                _ => family.directions.to_vec(),
            };
            to_cell_data(&family.name, &all, &body.mesh)
        })
        .collect()
}

/// Cell data of all bodies, one after another, on tetrahedra and hexahedra; arrays of a frame's own names
/// are left out.
fn joined_cell_data(built: &BuiltScene) -> Vec<CellData> {
    let mut joined: Vec<CellData> = Vec::new();
    // fibres come before data of the file that have their name: these are their source
    let of_bodies: Vec<Vec<CellData>> = built
        .bodies
        .iter()
        .map(|b| {
            let mut data = fibre_data(b);
            data.extend(b.mesh.cell_data.iter().cloned());
            data
        })
        .collect();
    for data in of_bodies.iter().flatten() {
        if !FRAME_CELL_DATA.contains(&data.name.as_str())
            && joined.iter().all(|known| known.name != data.name)
        {
            let name = data.name.clone();
            joined.push(CellData { name, integer: true, ..CellData::default() });
        }
    }
    let is_fibre =
        |name: &str| built.bodies.iter().flat_map(fibre_data).any(|data| data.name == name);
    for array in &mut joined {
        // a vector of length 0 is no direction
        let missing = if is_fibre(&array.name) { 0.0 } else { f64::NAN };
        for (body, own) in built.bodies.iter().zip(&of_bodies) {
            let data = own.iter().find(|data| data.name == array.name);
            array.integer &= data.is_some_and(|data| data.integer);
            for kind in ElementKind::ALL {
                let values = &mut array.values[kind];
                let length = values.len() + body.element_count(kind);
                // membranes have no data of their own
                if let Some(data) = data.filter(|_| kind.is_solid()) {
                    values.extend(&data.values[kind]);
                }
                values.resize(length, missing);
            }
        }
    }
    joined
}

/// Writes the files of a run into one folder.
pub struct Writer {
    folder: PathBuf,
    stem: String,
    frames: Vec<(f64, String)>,
    /// What was found in the folder at the start.
    note: Option<Warning>,
    csv: std::fs::File,
    csv_path: PathBuf,
    /// Length of its whole rows (bytes).
    csv_length: u64,
    /// All bodies at rest, membranes as its faces, with the cell data of the mesh files, NaN for bodies without it, and the
    /// directions of fibres, 0 for bodies without them.
    mesh: Mesh,
    /// Smallest altitude of a cell at rest (m).
    smallest: f64,
    /// First cell of every kind of each body, among those of its kind.
    start: Vec<ByKind<usize>>,
    /// Whether bodies carry surfaces along.
    has_surface: bool,
}

/// Checkpoints in a folder with their steps, ascending.
pub(crate) fn checkpoints(folder: &Path) -> Vec<(u64, PathBuf)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let step = |path: &Path| {
        let name = path.file_name()?.to_str()?;
        name.strip_prefix("checkpoint-")?.strip_suffix(".sinew")?.parse().ok()
    };
    let mut all: Vec<(u64, PathBuf)> =
        entries.filter_map(|entry| Some((step(&entry.path())?, entry.path()))).collect();
    all.sort();
    all
}

/// The name of a scene as that of files.
pub(crate) fn stem(name: &str) -> String {
    let kept = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
    name.chars().map(|c| if kept(c) { c } else { '_' }).collect()
}

fn write_error(path: &Path) -> impl Fn(std::io::Error) -> RunError + '_ {
    |source| RunError::Write { path: path.into(), source }
}

/// What a writer has written, for checkpoints.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WriterState {
    csv_length: u64,
    frames: Vec<(f64, String)>,
    /// What was found in the folder at the start.
    note: Option<Warning>,
}

impl Writer {
    /// Goes on where another writer of the scene was; what that one wrote later goes.
    ///
    /// # Errors
    /// When its rows are no longer there, or the folder cannot be written to.
    pub fn resume(
        folder: &Path,
        name: &str,
        built: &mut BuiltScene,
        state: WriterState,
    ) -> Result<Self, RunError> {
        let csv_path = folder.join(format!("{}.csv", stem(name)));
        let path = csv_path.clone();
        let error = write_error(&path);
        let mut csv = std::fs::OpenOptions::new().write(true).open(&csv_path).map_err(&error)?;
        if csv.metadata().map_err(&error)?.len() < state.csv_length {
            let message =
                "rows that were written before it are gone from the CSV file: run the scene anew";
            return Err(RunError::Checkpoint { path: csv_path, message });
        }
        csv.set_len(state.csv_length).map_err(&error)?;
        csv.seek(SeekFrom::End(0)).map_err(&error)?;
        // half of a summary, or that of an interrupted run
        let _ = std::fs::remove_file(folder.join("summary.json"));
        built.warnings.extend(state.note.clone());
        let WriterState { csv_length, frames, note } = state;
        Ok(Self { csv_length, frames, note, ..Self::of(folder, name, built, csv, csv_path) })
    }

    /// What it has written.
    pub fn state(&self) -> WriterState {
        let Self { csv_length, frames, note, .. } = self;
        WriterState { csv_length: *csv_length, frames: frames.clone(), note: note.clone() }
    }

    /// Makes the folder, takes away what an earlier run of the scene left in it, which becomes a note of the scene if it
    /// `tells` of that, and
    /// starts the CSV file.
    ///
    /// # Errors
    /// When the folder cannot be made or written to.
    pub fn new(
        folder: &Path,
        name: &str,
        built: &mut BuiltScene,
        tells: bool,
    ) -> Result<Self, RunError> {
        let frames = folder.join("frames");
        std::fs::create_dir_all(&frames).map_err(write_error(&frames))?;
        let stem = stem(name);
        let note = remove_old(folder, &stem)?.filter(|_| tells);
        built.warnings.extend(note.clone());
        let csv_path = folder.join(format!("{stem}.csv"));
        let csv = std::fs::File::create(&csv_path).map_err(write_error(&csv_path))?;
        let of_contact: &[&str] = if built.touches() { &CONTACT_COLUMNS } else { &[] };
        let columns = COMMON_COLUMNS.iter().chain(of_contact).map(|c| (*c).to_string());
        let header: Vec<String> =
            columns.chain(probe::columns(&built.probes)).map(|c| csv_heading(&c)).collect();
        let mut writer = Self { note, ..Self::of(folder, name, built, csv, csv_path) };
        writer.line(&header.join(","))?;
        Ok(writer)
    }

    /// One that has written nothing.
    fn of(
        folder: &Path,
        name: &str,
        built: &BuiltScene,
        csv: std::fs::File,
        csv_path: PathBuf,
    ) -> Self {
        let mut mesh = Mesh { cell_data: joined_cell_data(built), ..Mesh::default() };
        let mut start = Vec::new();
        for b in &built.bodies {
            start.push(ByKind::of(|kind| mesh.count(kind)));
            let Mesh { points, tetrahedra, middles, hexahedra, triangles, quads, .. } = &mut mesh;
            let first = points.len() as u32;
            points.extend_from_slice(&b.mesh.points);
            tetrahedra.extend(b.mesh.tetrahedra.iter().map(|t| t.map(|v| v + first)));
            if b.mesh.is_second_order() {
                middles.resize(tetrahedra.len() - b.mesh.tetrahedra.len(), LINEAR);
                middles.extend(b.mesh.middles.iter().map(|m| m.map(|v| v + first)));
            } else if !middles.is_empty() {
                middles.resize(tetrahedra.len(), LINEAR);
            }
            hexahedra.extend(b.mesh.hexahedra.iter().map(|h| h.map(|v| v + first)));
            triangles.extend(b.membrane_triangles().iter().map(|t| t.map(|v| v + first)));
            quads.extend(b.membrane_quads().iter().map(|q| q.map(|v| v + first)));
        }
        let smallest = built.bodies.iter().map(|b| b.report.statistics.smallest_altitude);
        let smallest = smallest.fold(f64::INFINITY, f64::min);
        Self {
            folder: folder.to_path_buf(),
            stem: stem(name),
            frames: Vec::new(),
            note: None,
            csv,
            csv_path,
            csv_length: 0,
            mesh,
            smallest,
            start,
            has_surface: built.bodies.iter().any(|body| body.carried.is_some()),
        }
    }

    /// Adds a line to the CSV file, whole or not at all.
    fn line(&mut self, text: &str) -> Result<(), RunError> {
        let line = format!("{text}\n");
        self.csv.write_all(line.as_bytes()).map_err(|source| {
            // best effort: the disk may be full, and the error is told anyway
            let _ = self.csv.set_len(self.csv_length);
            write_error(&self.csv_path)(source)
        })?;
        self.csv_length += line.len() as u64;
        Ok(())
    }

    /// Adds a row to the CSV file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn row(&mut self, step: u64, values: &[f64]) -> Result<(), RunError> {
        let cells = values.iter().map(|value| CsvNumber(*value).to_string());
        self.line(&std::iter::once(step.to_string()).chain(cells).collect::<Vec<_>>().join(","))
    }

    /// Writes the current state as a frame.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn frame(&mut self, built: &mut BuiltScene) -> Result<(), RunError> {
        let simulation = &mut built.simulation;
        let time = simulation.time();
        let (mut u, mut v) = (Vec::new(), Vec::new());
        let mut ratios = Vec::new();
        let mut held = vec![0.0; self.mesh.points.len()];
        for (i, body) in built.bodies.iter().enumerate() {
            let first = u.len();
            u.extend(simulation.displacements(body.handle));
            v.extend(simulation.velocities(body.handle));
            // of a membrane the ratio of areas
            let mut solid = simulation.volume_ratios(body.handle);
            let mut sheet = simulation.area_ratios(body.handle);
            let hexahedra = solid.split_off(body.element_count(ElementKind::Tetrahedron));
            let quads = sheet.split_off(body.element_count(ElementKind::Triangle));
            ratios.push(ByKind { tetrahedra: solid, triangles: sheet, hexahedra, quads });
            for c in built.constraints.iter().filter(|c| c.body == i && c.acts(time)) {
                c.vertices.iter().for_each(|&vertex| held[first + vertex as usize] = 1.0);
            }
        }
        // only what is left, and in place of what cuts parted the tetrahedra, or triangles, of its material
        let mut made = Vec::new();
        // places in the file of triangles and of tetrahedra, their corners
        let (mut films, mut solids) = (Vec::new(), Vec::new());
        let mut count = ByKind::<usize>::default();
        let mut left = ByKind::<Vec<usize>>::default();
        let (mut j, mut of_body, mut index) = (Vec::new(), Vec::new(), Vec::new());
        for kind in ElementKind::IN_FILES {
            for (i, body) in built.bodies.iter().enumerate() {
                for e in body.whole(simulation, kind) {
                    left[kind].push(self.start[i][kind] + e as usize);
                    count[kind] += 1;
                    j.push(ratios[i][kind][e as usize]);
                    of_body.push(i as f64);
                    index.push(f64::from(e));
                }
                let of_mesh = body.solid_kind().unwrap_or(ElementKind::Triangle);
                let is_film = of_mesh == ElementKind::Triangle;
                let of_cut = if is_film { of_mesh } else { ElementKind::Tetrahedron };
                if kind != of_cut || !simulation.is_cut(body.handle) {
                    continue;
                }
                // it was cut, so it has one
                let Ok(skin) = simulation.skin(body.handle) else { continue };
                let before = built.bodies[..i].iter().map(|b| b.mesh.points.len());
                // a surface that it carries has a file of its own
                let surface = simulation.carries_surface(body.handle);
                let surface = body.carried.as_ref().filter(|_| surface);
                let surface = surface.map_or(0, |carried| carried.points.len());
                let (vertices, first) = (body.mesh.points.len(), before.sum::<usize>());
                let own = vertices + surface;
                let shift = self.mesh.points.len() + made.len();
                let velocities = simulation.node_velocities(body.handle);
                made.extend_from_slice(&skin.rest[own..]);
                u.extend((own..skin.points.len()).map(|p| skin.points[p] - skin.rest[p]));
                v.extend(skin.mean(|node| velocities[node as usize]).skip(own));
                let place = |p: u32| match (p as usize).checked_sub(own) {
                    Some(made) => shift + made,
                    None => first + p as usize,
                };
                let material = cut_material(simulation.world(), body.handle.0);
                let is_parted = |e: &u32| material.is_some_and(|own| own.is_parted(*e));
                let film = skin.triangles.iter().zip(&skin.elements).filter(|_| is_film);
                let film = film.filter(|(_, e)| is_parted(e));
                let film = film.map(|(&[a, b, c], e)| ([a, b, c, c], *e));
                for (corners, e) in skin.cells.iter().copied().chain(film) {
                    let source = simulation.topology().bodies[body.handle.0].source(of_mesh, e);
                    let [a, b, c, d] = corners.map(|p| place(p) as u32);
                    match is_film {
                        true => films.push((count[kind], [a, b, c])),
                        false => solids.push((count[kind], [a, b, c, d])),
                    }
                    count[kind] += 1;
                    j.push(ratios[i][of_mesh][source as usize]);
                    of_body.push(i as f64);
                    index.push(f64::from(source));
                }
            }
        }
        let mut mesh = self.mesh.only(&left);
        mesh.points.extend(made);
        held.resize(mesh.points.len(), 0.0);
        if !mesh.middles.is_empty() {
            let straight = solids.iter().map(|(at, _)| (*at, LINEAR)).collect();
            mesh.middles = merged(&mesh.middles, straight);
        }
        (mesh.triangles, mesh.tetrahedra) =
            (merged(&mesh.triangles, films), merged(&mesh.tetrahedra, solids));
        let points: Vec<DVec3> = mesh.points.iter().zip(&u).map(|(x, u)| x + u).collect();
        let name = format!("frames/{}_{:05}.vtu", self.stem, self.frames.len());
        let data = VtuData {
            points: &points,
            point_vectors: &[("displacement", &u), ("velocity", &v)],
            point_scalars: &[("held", &held)],
            cell_scalars: &[("J", &j), ("body", &of_body), ("index", &index)],
            single_precision: fit_in_f32(&points, self.smallest)
                && fit_in_f32(&v, f64::INFINITY)
                && j.iter().all(|j| j.abs() <= f64::from(f32::MAX)),
            ..VtuData::of_mesh(&mesh)
        };
        self.appear(&name, |path| write_vtu(path, &data))?;
        if self.has_surface {
            self.surface_frame(built, &surface_name(&name))?;
        }
        self.frames.push((time, name));
        // the index is written again and again, so that a run that is killed has one
        let often = self.frames.len() < 1000 || self.frames.len().is_multiple_of(100);
        if often { self.index().map(|_| ()) } else { Ok(()) }
    }

    /// Writes the surfaces that bodies carry; of those that can be cut the whole skin, whose points and triangles are others after cuts.
    fn surface_frame(&self, built: &mut BuiltScene, name: &str) -> Result<(), RunError> {
        let (mut mesh, mut of_body, mut of_wound) = (Mesh::default(), Vec::new(), Vec::new());
        let (mut u, mut v) = (Vec::new(), Vec::new());
        let BuiltScene { simulation, bodies, .. } = built;
        for (i, body) in bodies.iter().enumerate() {
            let Some(carried) = &body.carried else { continue };
            let first = mesh.points.len() as u32;
            let has_skin = simulation.carries_surface(body.handle);
            let skin = has_skin.then(|| simulation.skin(body.handle));
            if let Some(Ok(skin)) = skin {
                let velocities = simulation.node_velocities(body.handle);
                let all: Vec<DVec3> = skin.mean(|node| velocities[node as usize]).collect();
                let used: BTreeSet<u32> = skin.triangles.iter().flatten().copied().collect();
                let mut number = vec![0; skin.points.len()];
                for (p, to) in used.into_iter().zip(first..) {
                    let (from, rest) = (p as usize, skin.rest[p as usize]);
                    number[from] = to;
                    mesh.points.push(rest);
                    u.push(skin.points[from] - rest);
                    v.push(all[from]);
                }
                mesh.triangles.extend(skin.triangles.iter().map(|t| t.map(|p| number[p as usize])));
                of_wound.extend(skin.wound.iter().map(|wound| f64::from(*wound)));
            } else {
                let of = |vectors: Vec<DVec3>| carried.embedding.displacements(&vectors);
                mesh.points.extend_from_slice(&carried.points);
                u.extend(of(simulation.displacements(body.handle)));
                v.extend(of(simulation.velocities(body.handle)));
                mesh.triangles.extend(carried.triangles.iter().map(|t| t.map(|v| v + first)));
                of_wound.resize(mesh.triangles.len(), 0.0);
            }
            of_body.resize(mesh.triangles.len(), i as f64);
        }
        let points: Vec<DVec3> = mesh.points.iter().zip(&u).map(|(x, u)| x + u).collect();
        let data = VtuData {
            points: &points,
            point_vectors: &[("displacement", &u), ("velocity", &v)],
            cell_scalars: &[("body", &of_body), ("wound", &of_wound)],
            single_precision: fit_in_f32(&points, self.smallest) && fit_in_f32(&v, f64::INFINITY),
            ..VtuData::of_mesh(&mesh)
        };
        self.appear(name, |path| write_vtu(path, &data)).map(drop)
    }

    /// Writes the index of the frames, and that of the frames of surfaces.
    fn index(&self) -> Result<PathBuf, RunError> {
        if self.has_surface {
            let frames: Vec<_> =
                self.frames.iter().map(|(t, name)| (*t, surface_name(name))).collect();
            self.appear(&format!("{}-surface.pvd", self.stem), |path| write_pvd(path, &frames))?;
        }
        self.appear(&format!("{}.pvd", self.stem), |path| write_pvd(path, &self.frames))
    }

    /// Writes a file of the folder under another name and renames it, so that it is whole or not there.
    fn appear(
        &self,
        name: &str,
        write: impl FnOnce(&Path) -> Result<(), MeshError>,
    ) -> Result<PathBuf, RunError> {
        let (partial, path) = (self.folder.join("frames/unfinished"), self.folder.join(name));
        write(&partial).inspect_err(|_| drop(std::fs::remove_file(&partial)))?;
        std::fs::rename(&partial, &path).map_err(write_error(&path))?;
        Ok(path)
    }

    /// Writes the index of the last frames; returns what was written.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(self) -> Result<Vec<String>, RunError> {
        let index = self.index()?;
        let mut written =
            vec![format!("{} (open in ParaView; {} frames)", index.display(), self.frames.len())];
        if self.has_surface {
            let index = index.with_file_name(format!("{}-surface.pvd", self.stem));
            written.push(format!("{} (the surfaces that bodies carry)", index.display()));
        }
        written.push(format!("{} (energies and probes)", self.csv_path.display()));
        Ok(written)
    }
}

/// Name of the frame of surfaces beside a frame of bodies.
fn surface_name(frame: &str) -> String {
    let (stem, number) = frame.rsplit_once('_').unwrap_or((frame, ""));
    format!("{stem}-surface_{number}")
}

/// Whether `f32` rounds vectors by at most a thousandth of a length and does not overflow.
fn fit_in_f32(vectors: &[DVec3], length: f64) -> bool {
    let most = (1e-3 * length / f64::from(f32::EPSILON)).min(f64::from(f32::MAX));
    vectors.iter().all(|x| x.abs().max_element() <= most)
}

/// Takes away what an earlier run left under the same name, which this one would be mixed up with, and says so.
fn remove_old(folder: &Path, stem: &str) -> Result<Option<Warning>, RunError> {
    let frames = folder.join("frames");
    let [summary, index, surfaces, rows, page, unfinished] = [
        folder.join("summary.json"),
        folder.join(format!("{stem}.pvd")),
        folder.join(format!("{stem}-surface.pvd")),
        folder.join(format!("{stem}.csv")),
        folder.join(format!("{stem}.html")),
        frames.join("unfinished"),
    ];
    // a run that was killed has rows but no summary
    let cut_short = rows.exists() && !summary.exists();
    let mut old = vec![summary, index, surfaces, rows, page, unfinished];
    for entry in std::fs::read_dir(&frames).map_err(write_error(&frames))? {
        let path = entry.map_err(write_error(&frames))?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let rest =
            name.strip_prefix(stem).map(|rest| rest.strip_prefix("-surface").unwrap_or(rest));
        let number = rest.and_then(|rest| rest.strip_prefix('_'));
        let number = number.and_then(|rest| rest.strip_suffix(".vtu"));
        if number.is_some_and(|n| n.len() >= 5 && n.bytes().all(|b| b.is_ascii_digit())) {
            old.push(path);
        }
    }
    old.extend(checkpoints(folder).into_iter().map(|(_, path)| path));
    let mut count = 0;
    for path in old {
        match std::fs::remove_file(&path) {
            Ok(()) => count += 1,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(write_error(&path)(error)),
        }
    }
    let what = if cut_short { "an earlier run that was cut short" } else { "an earlier run" };
    Ok((count > 0).then(|| {
        Warning::new(
            "run.output.replaced",
            Level::Note,
            "output",
            format!("{count} files of {what} were taken away from {}", folder.display()),
            "nothing to do; give another folder to keep them",
        )
    }))
}

/// A text that is no formula for a spreadsheet.
pub fn no_formula(text: &str) -> String {
    let formula = text.starts_with(['=', '+', '-', '@']);
    if formula { format!("'{text}") } else { text.to_string() }
}

/// A heading of a CSV file: quoted where its text asks for it, and no formula for a spreadsheet.
pub fn csv_heading(text: &str) -> String {
    let text = no_formula(text);
    let plain = !text.contains([',', '"', '\n', '\r']);
    if plain { text } else { format!("\"{}\"", text.replace('"', "\"\"")) }
}

/// A number of the CSV file, with nine digits.
struct CsvNumber(f64);

impl std::fmt::Display for CsvNumber {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // nothing to tell, such as volume ratios of a membrane
        if !self.0.is_finite() {
            Ok(())
        } else if self.0 == self.0.trunc() && self.0.abs() < 1e9 {
            write!(f, "{}", self.0)
        } else {
            write!(f, "{:.8e}", self.0)
        }
    }
}

/// A list with more entries, which have these places in the result, ascending.
fn merged<T: Copy>(list: &[T], more: Vec<(usize, T)>) -> Vec<T> {
    let mut rest = list.iter().copied();
    let mut all = Vec::with_capacity(list.len() + more.len());
    for (place, own) in more {
        all.extend(rest.by_ref().take(place - all.len()));
        all.push(own);
    }
    all.extend(rest);
    all
}
