//! A cut beside rivals: the beam of the case `continuum` of `sinew validate`, 180 x 60 x 60 mm, held at one end, is cut from
//! above by an oblique plane that ends inside, and a load at the other end opens the wound; same mesh, lumped masses, load
//! and damping in every engine.
//!
//! * **Truth**: the plane itself, and the opening of a converged continuum. A mesh of linear tetrahedra misses much of that
//!   whatever cuts it: where its faces lie on the cut it misses 44 % with eight cells across.
//! * **Distance**: of the wound from the plane above the end of the blade, at rest, at middles of triangles, in edges.
//! * **Opening**: 2 s after the cut. **Energy**: elastic and kinetic, each engine's own law, of a beam that is loaded first and
//!   cut then, before and after.
//! * Engines run one after the other, each on one thread.

use super::rival::{DAMPING, milliseconds, say};
use crate::toolbox::prelude::*;
use crate::toolbox::stats::median;
use sinew::engine::mesh::Surface;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};

/// Height and width (m) of the beam, which is three times as long.
const SIDE: f64 = 0.06;
/// Load (Pa) at the end, downward: strains for which elasticity is linear.
const LOAD: f64 = 10.0;
const TISSUE: YoungPoisson =
    YoungPoisson { young_modulus: 1e5, poisson_ratio: 0.3, density: 1000.0 };
/// Opening of the continuum over the cube of the height, where the load is Young's modulus (`continuum.json`, extrapolated; its
/// last refinement changed it by 0.7 %).
const OPENING: f64 = 33.65;
/// Height over that of the beam at which the blade ends.
const LOW: f64 = 0.45;
/// Step (s) of every engine.
pub const STEP: f64 = 1.0 / 60.0;
/// Steps of settling after a cut at rest, and before one of a loaded beam.
pub const SETTLED: [usize; 2] = [120, 60];

/// A triangle of a wound, outward: places (m) at rest and displacements (m) of its corners.
pub type WoundFace = [[DVec3; 2]; 3];

/// One engine in one setting.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CutRow {
    /// Engine.
    pub engine: String,
    /// Its version.
    pub version: String,
    /// Tetrahedra.
    pub elements: usize,
    /// Step, solver, energy in words.
    pub setting: String,
    /// Threads.
    pub threads: usize,
    /// `"f64"` or `"f32"`.
    pub precision: String,
    /// Root mean square distance of the wound from the blade, over the mean edge of a cell.
    pub distance_rms: Option<f64>,
    /// Largest one.
    pub distance_largest: Option<f64>,
    /// Error (%) of the opening against the continuum.
    pub opening_percent: Option<f64>,
    /// Energy after the cut of a loaded beam over that before, less 1.
    pub energy_change: Option<f64>,
    /// Time (ms) of the cut.
    pub cut_ms: Option<f64>,
    /// Median time (ms) of a step after it.
    pub ms_per_step: Option<f64>,
    /// What else there is to know, in words.
    pub note: String,
}

/// The beam.
#[derive(Clone)]
pub struct CutBeam {
    /// Its mesh.
    pub mesh: Mesh,
    /// Its material.
    pub material: YoungPoisson,
    /// Vertices that are held.
    pub fixed: Vec<u32>,
    /// Triangles that bear the load.
    loaded: Vec<[u32; 3]>,
    cells: usize,
}

/// What came of it.
pub struct CutOutcome {
    /// Faces of the wound.
    pub wound: Vec<WoundFace>,
    /// Energies (J) before and after.
    pub energy: [f64; 2],
    /// Time (ms) of the cut.
    pub cut_ms: f64,
    /// Times (ms) of the steps after it.
    pub ms: Vec<f64>,
}

/// An engine that can cut.
pub trait Carver {
    /// A row without figures.
    fn row(&self, beam: &CutBeam) -> CutRow;
    /// Cuts the beam at rest and lets it settle under its load; cuts another one that is loaded.
    ///
    /// # Errors
    /// When the engine fails.
    fn carve(&mut self, beam: &CutBeam) -> Result<CutOutcome>;
}

impl CutBeam {
    /// So many cells along the height, six tetrahedra each.
    ///
    /// # Errors
    /// When it is zero.
    pub fn new(cells: usize) -> Result<Self> {
        let mesh = box_tets(SIDE * DVec3::new(3.0, 1.0, 1.0), [3 * cells, cells, cells])?;
        let mesh = jitter_interior(&mesh, 0.2, 1)?;
        let fixed = super::at_zero(&mesh);
        let at_end = |t: &[u32; 3]| t.iter().all(|&v| mesh.points[v as usize].x > 2.999 * SIDE);
        let loaded = mesh.surface_triangles().into_iter().filter(at_end).collect();
        Ok(Self { mesh, material: TISSUE, fixed, loaded, cells })
    }

    /// Point (m) of the plane of the blade, in heights of the beam.
    fn plane(y: f64, z: f64) -> DVec3 {
        SIDE * DVec3::new(1.0 + 0.35 * (z - 0.5) + 0.2 * (y - 0.5), y, z)
    }

    /// One triangle of the plane that covers the section down to the end of the blade.
    pub fn triangle(&self) -> [DVec3; 3] {
        [(-3.0, LOW), (4.0, LOW), (0.5, LOW + 6.0)].map(|(y, z)| Self::plane(y, z))
    }

    /// Load (N) of every vertex that has any.
    pub fn forces(&self) -> Vec<(u32, DVec3)> {
        let force = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| self.mesh.points[v as usize]);
            let area = 0.5 * (b - a).cross(c - a).length();
            t.map(|v| (v, DVec3::Z * (-LOAD * area / 3.0)))
        };
        self.loaded.iter().flat_map(force).collect()
    }

    /// The figures of a wound: distances, and the error of the opening (%).
    pub fn judge(&self, wound: &[WoundFace]) -> [f64; 3] {
        let [a, b, c] = self.triangle();
        let normal = (b - a).cross(c - a).normalize();
        let (mut sum, mut largest, mut count, mut opening) = (0.0, 0.0_f64, 0.0, 0.0);
        for face in wound {
            let [x, y, z] = face.map(|corner| corner[0]);
            let moved: DVec3 = face.iter().map(|corner| corner[1]).sum();
            opening -= moved.dot((y - x).cross(z - x)) / 6.0;
            let middle = (x + y + z) / 3.0;
            if middle.z > LOW * SIDE {
                let off = (middle - a).dot(normal).abs() * self.cells as f64 / SIDE;
                (sum, largest, count) = (sum + off * off, largest.max(off), count + 1.0);
            }
        }
        let truth = OPENING * SIDE.powi(3) * LOAD / self.material.young_modulus;
        [f64::sqrt(sum / count), largest, 100.0 * (opening / truth - 1.0)]
    }

    /// A row without figures.
    pub fn row(&self, engine: &str, version: &str, setting: String, precision: &str) -> CutRow {
        CutRow {
            engine: engine.into(),
            version: version.into(),
            elements: self.mesh.tetrahedra.len(),
            setting,
            threads: 1,
            precision: precision.into(),
            ..CutRow::default()
        }
    }

    /// The beam in a world of ours, cut at once or loaded at once.
    fn stand(&self, ours: &Ours, cut: bool) -> Result<(Simulation, BodyHandle, f64)> {
        let options = SimulationOptions {
            threads: 1,
            exclusive: true,
            precision: ours.precision,
            ..Default::default()
        };
        let mut simulation = Simulation::new(options)?;
        let description = BodyDescription::new("beam", &self.mesh, self.material);
        let spare = self.mesh.points.len();
        let body = simulation.add_body(&BodyDescription { spare, ..description })?;
        let rows = simulation.rows(body, "clamp", &self.fixed)?;
        simulation.add_constraint(Constraint::hold("clamp", rows));
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_dt(STEP);
        let (integrator, mass_damping) = (ours.integrator, DAMPING);
        simulation.set_solver(SolverSettings { integrator, mass_damping, ..Default::default() });
        let begin = Instant::now();
        if cut {
            simulation.cut(body, &self.strip())?;
        }
        let cut_ms = begin.elapsed().as_secs_f64() * 1e3;
        let on = Surface { triangles: self.loaded.clone(), ..Surface::default() };
        let faces = simulation.traction_faces(body, "load", &on, DVec3::Z * -LOAD)?;
        simulation.add_loaded_faces("load", faces, Curve::Constant);
        Ok((simulation, body, cut_ms))
    }

    fn strip(&self) -> [[DVec3; 2]; 2] {
        [-0.1, 1.1].map(|y| [1.1, LOW].map(|z| Self::plane(y, z)))
    }
}

/// A setting of ours.
struct Ours {
    integrator: Integrator,
    precision: Precision,
}

impl Carver for Ours {
    fn row(&self, beam: &CutBeam) -> CutRow {
        let precision = if self.precision == Precision::F32 { "f32" } else { "f64" };
        let setting = format!("{}, h = {}", self.integrator.name(), milliseconds(STEP));
        beam.row("Sinew", env!("CARGO_PKG_VERSION"), setting, precision)
    }

    fn carve(&mut self, beam: &CutBeam) -> Result<CutOutcome> {
        let (mut simulation, body, cut_ms) = beam.stand(self, true)?;
        let mut ms = Vec::new();
        for _ in 0..SETTLED[0] {
            let begin = Instant::now();
            simulation.step()?;
            ms.push(begin.elapsed().as_secs_f64() * 1e3);
        }
        let skin = simulation.skin(body)?;
        let corner = |p: u32| {
            let (rest, now) = (skin.rest[p as usize], skin.points[p as usize]);
            [rest, now - rest]
        };
        let open = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound);
        let wound = open.map(|(t, _)| t.map(corner)).collect();
        let (mut simulation, body, _) = beam.stand(self, false)?;
        for _ in 0..SETTLED[1] {
            simulation.step()?;
        }
        let now =
            |simulation: &mut Simulation| simulation.evaluate() + simulation.kinetic_energy(body);
        let before = now(&mut simulation);
        simulation.cut(body, &beam.strip())?;
        let energy = [before, now(&mut simulation)];
        Ok(CutOutcome { wound, energy, cut_ms, ms })
    }
}

/// Our settings, and what Rapier has.
///
/// # Errors
/// When the beam cannot be made.
pub fn run(quick: bool) -> Result<Vec<CutRow>> {
    let beam = CutBeam::new(if quick { 4 } else { 8 })?;
    let ours =
        |integrator, precision| -> Box<dyn Carver> { Box::new(Ours { integrator, precision }) };
    let carvers = vec![
        ours(Integrator::Auto, Precision::F64),
        ours(Integrator::Safe, Precision::F64),
        ours(Integrator::Safe, Precision::F32),
    ];
    #[cfg(feature = "rapier")]
    let carvers = carvers.into_iter().chain(super::rapier::carvers()).collect::<Vec<_>>();
    Ok(compete(&beam, carvers))
}

/// A row for every engine; one that fails has the reason in its note.
pub fn compete(beam: &CutBeam, carvers: Vec<Box<dyn Carver>>) -> Vec<CutRow> {
    let filled = |mut carver: Box<dyn Carver>| {
        let mut row = carver.row(beam);
        match carver.carve(beam) {
            Ok(found) => {
                let [rms, largest, opening] = beam.judge(&found.wound);
                (row.distance_rms, row.distance_largest) = (Some(rms), Some(largest));
                row.opening_percent = Some(opening);
                row.energy_change = Some(found.energy[1] / found.energy[0] - 1.0);
                (row.cut_ms, row.ms_per_step) = (Some(found.cut_ms), median(&found.ms));
            }
            Err(error) => say(&mut row.note, format!("failed: {error}")),
        }
        row
    };
    carvers.into_iter().map(filled).collect()
}
