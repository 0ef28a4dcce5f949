//! What the tables of Natsupakpong & Cavusoglu 2010 share: meshes, material, methods, and how a printed
//! number is held against ours.

use super::Options;
use crate::bench::error::BenchError;
use crate::bench::table::{Cell, Table};
use crate::report::Finding;
use glam::{DVec2, DVec3};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{
    box_hexahedra, cylinder_hexahedra, cylinder_tets, irregular_box_tets, jitter_interior,
    quad_grid, specimen_hexahedra, specimen_quads, specimen_tets, specimen_triangles,
    triangle_grid,
};
use sinew_identify::error_metrics::PositionErrors;
use sinew_identify::mesh::{FittedSprings, fit_elements};
use sinew_identify::virtual_test::{Loading, SpringOptions};
use sinew_identify::{ElementMethod, LinearMaterial, Plane, Section};
use sinew_tune::fit::assess::{against, reference};
use sinew_tune::fit::rig::{Grips, Reading, Rig};
use sinew_tune::table_of;
use std::path::{Path, PathBuf};

/// Paper B's material: 10 kPa, 0.3.
pub(super) const MATERIAL: LinearMaterial =
    LinearMaterial { youngs_modulus: 1e4, poissons_ratio: 0.3 };
/// Plane stress, per metre of thickness.
pub(super) const SECTION: Section = Section { plane: Plane::Stress, thickness: 1.0 };

/// A printed error and one of ours count as the same within this factor: the printed meshes and loads
/// are not known.
pub(super) const ALIKE: f64 = 1.5;

/// Where meshes come from.
pub(super) struct Meshes {
    folder: Option<PathBuf>,
}

/// A mesh in the machine.
pub(super) struct Specimen {
    /// Mesh and ends.
    pub rig: Rig,
    /// Nodes and elements.
    pub counts: [usize; 2],
}

impl Meshes {
    /// Where [`Options`] say, or where they are looked for.
    pub fn find(options: &Options) -> Result<Self, BenchError> {
        let file = "b_cube_hex.msh";
        if options.quick {
            return Ok(Self::new(None));
        }
        if let Some(folder) = &options.meshes {
            if !folder.join(file).is_file() {
                let remedy = "name another folder, or none for generated meshes";
                return Err(BenchError::Request {
                    what: format!("meshes in {}", folder.display()),
                    remedy: format!("there is no {file}; {remedy}"),
                });
            }
            return Ok(Self::new(Some(folder)));
        }
        let named = std::env::var_os("SINEW_REFERENCE").map(|root| Path::new(&root).join("meshes"));
        let folder = named.unwrap_or_else(|| PathBuf::from("../shared/meshes"));
        Ok(Self::new(folder.join(file).is_file().then_some(&*folder)))
    }

    /// From a folder of files `b_*.msh`; without one, or where a file is missing, generated.
    pub fn new(folder: Option<&Path>) -> Self {
        Self { folder: folder.map(Path::to_path_buf) }
    }

    /// What to say of the source.
    pub fn source(&self) -> String {
        match &self.folder {
            Some(folder) => format!(
                "meshes b_*.msh of {}, made to the printed counts (outline of the soft tissue and shoulders of \
                 the specimen are not printed)",
                folder.display()
            ),
            None => "meshes generated to about the printed counts; rectangles of 2 x 6 cm stand for the soft \
                     tissue, whose outline is not printed"
                .to_string(),
        }
    }

    /// A mesh by its name, such as `cube_hex`; `None` where there is neither a file nor a generator.
    pub fn get(&self, name: &str) -> Result<Option<Specimen>, BenchError> {
        let file = self.folder.as_ref().map(|f| f.join(format!("b_{name}.msh")));
        let (mesh, ends) = match file.filter(|f| f.is_file()) {
            Some(file) => (Mesh::read(&file)?, ["fixed", "loaded"]),
            None => match generated(name)? {
                Some(mesh) => (mesh, ["x0", "x1"]),
                None => return Ok(None),
            },
        };
        let [held, loaded] = ends.map(|name| Some(name.to_string()));
        let rig = Rig::new(&mesh, SECTION, &Grips { axis: None, held, loaded })?;
        let counts = [rig.points.len(), rig.cells().len()];
        Ok(Some(Specimen { rig, counts }))
    }
}

/// Meshes of about the printed counts.
fn generated(name: &str) -> Result<Option<Mesh>, BenchError> {
    let (cube, width) = (DVec3::splat(0.02), 0.01);
    let tissue = DVec2::new(0.06, 0.02);
    Ok(Some(match name {
        "tissue_tri" => jitter_interior(&triangle_grid(tissue, [30, 6])?, 0.2, 1)?,
        "tissue_quad" => jitter_interior(&quad_grid(tissue, [45, 9])?, 0.2, 1)?,
        "square_tri" => jitter_interior(&triangle_grid(DVec2::splat(0.02), [9, 9])?, 0.2, 1)?,
        "square_quad" => quad_grid(DVec2::splat(0.02), [10, 10])?,
        "cylinder_tet" => jitter_interior(&cylinder_tets(0.01, 0.02, 2, 4)?, 0.1, 1)?,
        "cylinder_hex" => cylinder_hexahedra(0.01, 0.02, 4, 3, 8)?,
        "cube_tet" => irregular_box_tets(cube, [5, 5, 4], 0.15, 1)?,
        "cube_hex" => box_hexahedra(cube, [8, 8, 8])?,
        "dogbone_tri" => specimen_triangles(width, [24, 4])?,
        "dogbone_quad" => specimen_quads(width, [53, 5])?,
        "dogbone_tet" => specimen_tets(width, width, [42, 3, 2])?,
        "dogbone_hex" => specimen_hexahedra(width, width, [56, 5, 3])?,
        _ => return Ok(None),
    }))
}

impl Specimen {
    /// Springs by a method.
    pub fn springs(&self, method: ElementMethod) -> Result<FittedSprings, BenchError> {
        let (points, cells) = (&self.rig.points, self.rig.cells());
        Ok(fit_elements(points, &cells, &[MATERIAL], &self.rig.section, method)?)
    }

    /// One end held, a mean traction along `axis` on the other, so large that finite elements move by
    /// `part` of the length at most.
    pub fn loaded(
        &self,
        axis: usize,
        reading: Reading,
        part: f64,
    ) -> Result<(Loading, Vec<[f64; 3]>), BenchError> {
        let mut unit = [0.0; 3];
        unit[axis] = if axis == self.rig.axis { self.rig.length().signum() } else { 1.0 };
        let mut loading = self.rig.pushed(unit.map(|t| t * 1e3), reading);
        let fem = reference(&self.rig, &MATERIAL, &loading)?;
        let square = |u: &[f64; 3]| u.iter().map(|x| x * x).sum::<f64>();
        let largest = fem.iter().map(square).fold(0.0, f64::max).sqrt();
        let scale = part * self.rig.length().abs() / largest;
        loading.forces.iter_mut().for_each(|(_, f)| *f = f.map(|x| x * scale));
        Ok((loading, fem.iter().map(|u| u.map(|x| x * scale)).collect()))
    }
}

/// Errors of springs against finite elements in several readings; `None` where springs find no
/// equilibrium.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ours {
    /// Linear springs, consistent traction.
    pub traction: Option<PositionErrors>,
    /// Linear springs, equal nodal forces.
    pub equal: Option<PositionErrors>,
    /// Springs with rest lengths, consistent traction.
    pub rest_length: Option<PositionErrors>,
    /// Springs with negative constants.
    pub negative: usize,
}

impl Ours {
    /// Loads the specimen along `axis` to a displacement of `part` of its length.
    pub fn measure(
        specimen: &Specimen,
        method: ElementMethod,
        axis: usize,
        part: f64,
    ) -> Result<Self, BenchError> {
        let springs = specimen.springs(method)?;
        let rig = &specimen.rig;
        let [traction, equal] = [
            specimen.loaded(axis, Reading::Traction, part)?,
            specimen.loaded(axis, Reading::EqualForces, part)?,
        ];
        let errors = |(loading, fem): &(Loading, Vec<[f64; 3]>), options| {
            against(rig, &springs, loading, fem, options).ok().map(|a| a.errors)
        };
        let options = SpringOptions { tolerance: 1e-8, ..SpringOptions::default() };
        Ok(Self {
            traction: errors(&traction, None),
            equal: errors(&equal, None),
            rest_length: errors(&traction, Some(options)),
            negative: springs.report.negative_edges,
        })
    }

    /// The linear reading whose root mean square is nearer to the printed one.
    pub fn nearer(&self, printed: [f64; 2]) -> Option<PositionErrors> {
        let off = |e: &PositionErrors| (e.rms_percent / printed[0]).ln().abs();
        let both = [self.traction, self.equal];
        both.into_iter().flatten().min_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// Whether that is within [`ALIKE`] of the printed one.
    pub fn alike(&self, printed: [f64; 2]) -> bool {
        self.nearer(printed).is_some_and(|e| alike(e.rms_percent, printed[0]))
    }
}

/// Whether two numbers are within a factor of [`ALIKE`].
pub(super) fn alike(ours: f64, printed: f64) -> bool {
    (ours / printed).ln().abs() <= ALIKE.ln()
}

/// `rms / max` with two digits, as printed.
pub(super) fn percents(errors: Option<PositionErrors>) -> Cell {
    match errors {
        Some(e) => pair([e.rms_percent, e.max_percent]),
        None => "no equilibrium".into(),
    }
}

/// `rms / max` as printed.
pub(super) fn pair([rms, max]: [f64; 2]) -> Cell {
    format!("{rms:.2} / {max:.2}").into()
}

/// A mesh and a method of a table of the paper, measured.
pub(super) struct Row {
    pub mesh: &'static str,
    /// Element or object.
    pub what: &'static str,
    pub method: ElementMethod,
    /// Errors (rms, max).
    pub printed: Option<[f64; 2]>,
    pub counts: [usize; 2],
    pub ours: Ours,
}

/// Table of errors against those printed; `what` heads the columns of element or object and of method.
pub(super) fn error_table(name: &'static str, title: &str, what: [&str; 2], rows: &[Row]) -> Table {
    table_of!(name, title; for r in rows;
        what[0] => r.what, what[1] => printed_name(r.method), "printed" => r.printed.map(pair),
        "linear, traction" => percents(r.ours.traction),
        "linear, equal forces" => percents(r.ours.equal),
        "rest lengths, traction" => percents(r.ours.rest_length),
        "negative springs" => r.ours.negative, "nodes" => r.counts[0], "elements" => r.counts[1],
    )
    .note("% e_rms / % e_max of the largest displacement of linear finite elements")
}

/// Names of methods in the paper.
pub(super) fn printed_name(method: ElementMethod) -> &'static str {
    match method {
        ElementMethod::Frobenius => "F-norm",
        ElementMethod::TwoNorm => "2-norm",
        ElementMethod::Block => "closed form (27), (29)",
        ElementMethod::VanGelder => "Van Gelder",
        ElementMethod::Lloyd => "Lloyd et al.",
        ElementMethod::Baudet => "Baudet et al.",
        other => other.name(),
    }
}

/// One statement about all rows of a table: how many are alike, and which are not.
pub(super) fn rows_alike(
    table: &str,
    rows: impl Iterator<Item = (String, bool)>,
    what: &str,
) -> Finding {
    let all: Vec<(String, bool)> = rows.collect();
    let bad: Vec<&str> = all.iter().filter(|r| !r.1).map(|r| r.0.as_str()).collect();
    let tail = if bad.is_empty() { String::new() } else { format!("; not: {}", bad.join(", ")) };
    Finding::of(bad.is_empty()).says(format!(
        "{table}: {} of {} rows {what}{tail}",
        all.len() - bad.len(),
        all.len()
    ))
}
