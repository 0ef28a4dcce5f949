//! One simulated case: a body, its clock and the books of its energy.

use super::rows::{CasePart, Check, Figures, PassColumn, SolidCells};
use bevy_ecs::entity::Entity;
use sinew::engine::mesh::Group;
use sinew::engine::report::{Fallbacks, StepReport};
use sinew::models::resection::{Region, Removal, RemovalReport};
use sinew::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Why a case could not be run to its end.
pub(super) type CaseProblem = Box<dyn std::error::Error + Send + Sync>;

/// What may stop a case.
pub(super) type Result<T, E = CaseProblem> = std::result::Result<T, E>;

/// What a case gives: figures and criteria.
pub(super) type CaseOutcome = Result<(Figures, Vec<Check>)>;

/// With what a case is run.
#[derive(Clone, Copy, Debug)]
pub(super) struct CaseSetting {
    pub column: PassColumn,
    pub precision: Precision,
    pub threads: usize,
}

impl CaseSetting {
    /// Refuses a case that has to do with four-node tetrahedra.
    pub fn of_tetrahedra(&self) -> Result<()> {
        if self.column.cells == SolidCells::Tetrahedra { Ok(()) } else { Err(OtherColumns.into()) }
    }

    /// A limit that single precision may miss by a factor of ten.
    pub fn loose(&self, limit: f64) -> f64 {
        self.pick(limit, 10.0 * limit)
    }

    /// The limit of the precision.
    pub fn pick(&self, double: f64, single: f64) -> f64 {
        match self.precision {
            Precision::F64 => double,
            Precision::F32 => single,
        }
    }

    /// Rise of energy over its scale that counts as none: rounding for the integrators that promise that
    /// there is none, and what explodes for the others.
    fn energy_limit(&self) -> f64 {
        if self.column.integrator.recovers() { self.loose(1e-6) } else { 0.05 }
    }
}

/// A case that is there for other cells or energies only.
#[derive(Debug, thiserror::Error)]
#[error("this case is there for other cells or energies only")]
pub(super) struct OtherColumns;

impl SolidCells {
    /// A mesh of tetrahedra, cut into these cells.
    fn of<'a>(self, mesh: &'a Mesh) -> Result<Cow<'a, Mesh>> {
        match self {
            Self::Tetrahedra => Ok(Cow::Borrowed(mesh)),
            // a sheet is the same, whatever solids are cut into
            _ if !mesh.is_solid() => Err(OtherColumns.into()),
            Self::Tetrahedra10 => Ok(Cow::Owned(mesh.with_second_order())),
            Self::Hexahedra | Self::ReducedHexahedra => {
                Ok(Cow::Owned(cells_of(mesh).ok_or(OtherColumns)?))
            }
        }
    }
}

/// The hexahedra that a box was cut from, six tetrahedra each; none of other meshes.
fn cells_of(mesh: &Mesh) -> Option<Mesh> {
    let (cells, rest) = mesh.tetrahedra.as_chunks::<6>();
    let hexahedron = |cell: &[[u32; 4]; 6]| {
        // ascending, corners are in the order of x, y and z
        let corners: BTreeSet<u32> = cell.iter().flatten().copied().collect();
        let corners: Vec<u32> = corners.into_iter().collect();
        let [a, b, c, d, e, f, g, h] = <[u32; 8]>::try_from(corners).ok()?;
        Some([a, e, g, c, b, f, h, d])
    };
    let hexahedra: Option<Vec<_>> = cells.iter().map(hexahedron).collect();
    let hexahedra = hexahedra.filter(|_| rest.is_empty() && !cells.is_empty())?;
    let (points, groups) = (mesh.points.clone(), mesh.groups.clone());
    let mut boxes = Mesh { hexahedra, points, groups, ..Mesh::default() };
    // groups of cells are those of tetrahedra
    boxes.groups.iter_mut().for_each(|group| {
        *group = Group {
            name: std::mem::take(&mut group.name),
            vertices: std::mem::take(&mut group.vertices),
            dimension: group.dimension,
            ..Group::default()
        };
    });
    Some(boxes)
}

/// Which columns a case concerns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scope {
    /// All.
    Every,
    /// All integrators with the default energy.
    Integrators,
    /// Those of the integrators that are meant for anything, with the default energy or other elements.
    Robust,
    /// The explicit integrators, whatever the columns; both must pass.
    Explicit,
    /// None: it does not depend on integrator and model.
    Once,
}

/// A case and how to run it.
pub(super) struct HardCase {
    pub part: CasePart,
    pub name: String,
    /// Part of the quick selection.
    pub quick: bool,
    pub scope: Scope,
    pub run: Box<dyn Fn(&CaseSetting) -> CaseOutcome + Send + Sync>,
}

/// Cases of a group.
#[derive(Default)]
pub(super) struct Cases(pub Vec<HardCase>);

impl Cases {
    /// A case that concerns all columns, on a mesh.
    pub fn add(
        &mut self,
        part: CasePart,
        name: String,
        quick: bool,
        mesh: &Arc<Mesh>,
        run: impl Fn(&CaseSetting, &Mesh) -> CaseOutcome + Send + Sync + 'static,
    ) {
        self.within(Scope::Every, part, name, quick, mesh, run);
    }

    /// A case that concerns some columns.
    pub fn within(
        &mut self,
        scope: Scope,
        part: CasePart,
        name: String,
        quick: bool,
        mesh: &Arc<Mesh>,
        run: impl Fn(&CaseSetting, &Mesh) -> CaseOutcome + Send + Sync + 'static,
    ) {
        let mesh = Arc::clone(mesh);
        let run = Box::new(move |setting: &CaseSetting| {
            run(setting, setting.column.cells.of(&mesh)?.as_ref())
        });
        self.0.push(HardCase { part, name, quick, scope, run });
    }
}

/// Gravity (m/s^2) on the cases that have weight.
pub(super) const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);

/// Soft tissue of water's density.
pub(super) fn tissue(young_modulus: f64, poisson_ratio: f64) -> YoungPoisson {
    YoungPoisson { young_modulus, poisson_ratio, density: 1000.0 }
}

/// Damping (1/s) proportional to mass where rest is to be reached.
const DAMPING: f64 = 3.5;

/// Explicit integrators refuse steps that need more: with stiffness 1e6 : 1 a case would take minutes.
const MAX_SUBSTEPS: u32 = 10_000;

/// A body on its way through a case.
pub(super) struct CaseRun<'a> {
    pub simulation: Simulation,
    pub body: BodyHandle,
    pub mesh: &'a Mesh,
    pub figures: Figures,
    setting: CaseSetting,
    /// Energy (J) at the start of the phase, and outside work since then.
    start: f64,
    outside: f64,
    /// Largest rise (J) above these.
    excess: f64,
    /// Largest energy (J) since then.
    pub largest: f64,
}

impl<'a> CaseRun<'a> {
    /// A body at rest without gravity, no damping.
    pub fn new(setting: &CaseSetting, mesh: &'a Mesh, material: YoungPoisson) -> Result<Self> {
        Self::of(setting, mesh, &BodyDescription::new("body", mesh, material))
    }

    /// The same of a body described in full; the energy is that of the column.
    pub fn of(
        setting: &CaseSetting,
        mesh: &'a Mesh,
        description: &BodyDescription,
    ) -> Result<Self> {
        let PassColumn { model, volume, .. } = setting.column;
        Self::with(setting, mesh, &BodyDescription { model, volume, ..description.clone() })
    }

    /// The same with the energy that the description names.
    pub fn with(
        setting: &CaseSetting,
        mesh: &'a Mesh,
        description: &BodyDescription,
    ) -> Result<Self> {
        let CaseSetting { precision, threads, .. } = *setting;
        let options =
            SimulationOptions { precision, threads, exclusive: true, ..Default::default() };
        let mut simulation = Simulation::new(options)?;
        let integration = setting.column.cells.integration();
        let description = BodyDescription { integration, ..description.clone() };
        let body = simulation.add_body(&description)?;
        simulation.set_gravity(DVec3::ZERO);
        let mut run = Self {
            simulation,
            body,
            mesh,
            figures: Figures::default(),
            setting: *setting,
            start: 0.0,
            outside: 0.0,
            excess: 0.0,
            largest: 0.0,
        };
        run.solver(|_| ());
        Ok(run)
    }

    /// The same of soft tissue that is damped on its way to rest.
    pub fn damped(setting: &CaseSetting, mesh: &'a Mesh, poisson_ratio: f64) -> Result<Self> {
        let mut run = Self::new(setting, mesh, tissue(1e4, poisson_ratio))?;
        run.solver(|s| s.mass_damping = DAMPING);
        Ok(run)
    }

    /// Sets the solver: defaults with the integrator of the column, then changes.
    pub fn solver(&mut self, change: impl FnOnce(&mut SolverSettings)) {
        let PassColumn { integrator, recovery, .. } = self.setting.column;
        let max_substeps = MAX_SUBSTEPS;
        let mut settings =
            SolverSettings { integrator, recovery, max_substeps, ..Default::default() };
        change(&mut settings);
        self.simulation.set_solver(settings);
    }

    /// Vertex rows of a side of the mesh.
    pub fn side(&self, name: &str) -> Result<Vec<VertexRow>> {
        Ok(self.simulation.group_rows(self.body, self.mesh, name)?)
    }

    /// Holds a side for good.
    pub fn clamp(&mut self, side: &str) -> Result<Entity> {
        let rows = self.side(side)?;
        Ok(self.simulation.add_constraint(Constraint::hold(side, rows)))
    }

    /// Puts the body somewhere, and starts the books there.
    pub fn place(&mut self, displacements: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        self.simulation.set_state(self.body, displacements, velocities)?;
        self.open_books();
        Ok(())
    }

    /// The same without motion.
    pub fn place_still(&mut self, displacements: &[DVec3]) -> Result<()> {
        self.place(displacements, &vec![DVec3::ZERO; displacements.len()])
    }

    /// Mass (kg) of the body.
    pub fn mass(&mut self) -> f64 {
        self.simulation.masses(self.body).iter().sum()
    }

    /// Kinetic plus elastic energy (J) now.
    pub fn energy(&mut self) -> f64 {
        // of ghosts, too
        self.simulation.kinetic_energy(self.body) + self.simulation.evaluate()
    }

    /// Energy may not rise above what it is now plus outside work; returns it (J).
    pub fn open_books(&mut self) -> f64 {
        (self.start, self.outside) = (self.energy(), 0.0);
        self.largest = self.start;
        self.start
    }

    /// One step, booked.
    pub fn step(&mut self) -> Result<()> {
        self.simulation.step()?;
        let report = self.simulation.report();
        let put_in = report.contact.work;
        self.outside += report.load_work + report.constraint_work + report.recovery_energy + put_in;
        let energy = report.kinetic_energy + report.elastic_energy + report.contact.energy;
        let excess = energy - self.start - self.outside;
        // a NaN must not get lost
        self.excess = if excess.is_nan() { f64::NAN } else { self.excess.max(excess) };
        self.largest = self.largest.max(energy);
        let f = &mut self.figures;
        f.steps += 1;
        f.solves += u64::from(report.newton_iterations);
        f.most_solves = f.most_solves.max(report.newton_iterations);
        f.projected += u64::from(report.projections > 0);
        f.capped += u64::from(report.energy_caps > 0);
        f.fallbacks += u64::from(report.gradient_fallbacks + report.line_search_failures > 0);
        f.unconverged += u64::from(report.unconverged);
        f.recovering += u64::from(report.recovering > 0);
        f.substeps += u64::from(report.substeps);
        f.inverted = self.simulation.volume_report().inverted;
        f.most_inverted = f.most_inverted.max(f.inverted);
        let u = self.simulation.displacements(self.body);
        let v = self.simulation.velocities(self.body);
        match u.iter().chain(&v).all(|x| x.is_finite()) {
            true => Ok(()),
            false => Err(format!("not finite after step {}", self.figures.steps).into()),
        }
    }

    /// Takes elements away; the energy that goes with them counts as outside work.
    pub fn remove(&mut self, removal: &Removal) -> Result<RemovalReport> {
        let report = self.simulation.remove_elements(self.body, removal)?;
        self.outside -= report.elastic_energy + report.kinetic_energy;
        Ok(report)
    }

    /// Cuts the body; what that changes of its energy counts as outside work: clusters that fall apart, and other rules for elements with
    /// Gauss points. The change (J) of which the report does not tell, over the largest energy.
    pub fn cut(&mut self, strip: &[[DVec3; 2]]) -> Result<f64> {
        let before = self.energy();
        let report = self.simulation.cut(self.body, strip)?;
        let change = self.energy() - before;
        self.outside += change;
        Ok((change - report.elastic_energy).abs() / self.largest)
    }

    /// Solid elements of its mesh.
    pub fn elements(&self) -> usize {
        self.mesh.tetrahedra.len() + self.mesh.hexahedra.len()
    }

    /// The region of some of them.
    pub fn region(&self, elements: &[u32]) -> Region {
        match self.mesh.hexahedra.is_empty() {
            true => Region::Tetrahedra(elements.to_vec()),
            false => Region::Hexahedra(elements.to_vec()),
        }
    }

    /// Several steps.
    pub fn steps(&mut self, count: u64) -> Result<()> {
        (0..count).try_for_each(|_| self.step())
    }

    /// Steps of `dt` until about so many seconds have passed.
    pub fn seconds(&mut self, dt: f64, seconds: f64) -> Result<()> {
        self.simulation.set_dt(dt);
        self.steps((seconds / dt).round() as u64)
    }

    /// Ten steps; most elements inverted after one of them.
    pub fn held_steps(&mut self) -> Result<u64> {
        let mut inverted = 0;
        for _ in 0..10 {
            self.step()?;
            inverted = inverted.max(self.inverted());
        }
        Ok(inverted)
    }

    /// Inverted elements after the last step.
    pub fn inverted(&self) -> u64 {
        self.simulation.volume_report().inverted
    }

    /// Root mean square over edges of relative length change.
    pub fn edge_error(&mut self) -> f64 {
        let u = self.simulation.displacements(self.body);
        let topology = self.simulation.topology();
        let rows = &topology.bodies[self.body.0];
        let vertex = |row| rows.vertex(VertexRow(row)).index();
        let x = &self.mesh.points;
        let (mut sum, mut edges) = (0.0, 0.0);
        // edges of a body are between its own rows
        for edge in topology.edges.iter().filter(|edge| rows.vertices.contains(&edge[0])) {
            let [a, b] = edge.map(vertex);
            let now = (x[a] + u[a]).distance(x[b] + u[b]);
            sum += (now / x[a].distance(x[b]) - 1.0).powi(2);
            edges += 1.0;
        }
        let error = (sum / edges).sqrt();
        self.figures.edge_error = Some(error);
        error
    }

    /// Shape regained: small edge error, nothing inverted.
    pub fn recovered(&mut self) -> [Check; 2] {
        let error = self.edge_error();
        let limit = self.setting.loose(0.01);
        [
            Check::at_most("edge error at the end", error, limit),
            Check::none("inverted at the end", self.inverted()),
        ]
    }

    /// Closes the books: energy bounded, over a scale (J), and whatever else there is to check.
    pub fn finish(
        mut self,
        scale: f64,
        others: impl IntoIterator<Item = Check>,
    ) -> (Figures, Vec<Check>) {
        let excess = self.excess / scale;
        self.figures.energy_excess = Some(excess);
        let limit = self.setting.energy_limit();
        let mut checks = vec![Check::at_most("rise of energy over its scale", excess, limit)];
        checks.extend(others);
        (self.close(), checks)
    }

    /// The same over the largest energy (J) since the books were opened.
    pub fn finish_by_largest(
        self,
        others: impl IntoIterator<Item = Check>,
    ) -> (Figures, Vec<Check>) {
        let scale = self.largest;
        self.finish(scale, others)
    }

    /// Ends without a look at the books, which equilibria do not keep.
    pub fn close(mut self) -> Figures {
        self.figures.hash = self.simulation.state_hash();
        self.figures
    }
}

/// Motion of a mass under a constant acceleration, in the closed form of the integrator.
pub(super) struct Fall {
    /// Place (m) and velocity (m/s).
    pub x: DVec3,
    pub v: DVec3,
    /// Way (m) through the last step.
    way: DVec3,
}

impl Fall {
    pub fn new(x: DVec3, v: DVec3) -> Self {
        Self { x, v, way: DVec3::ZERO }
    }

    /// Follows a step of length `h` (s) that was reported; every step so far had this length.
    pub fn step(&mut self, integrator: Integrator, report: &StepReport, h: f64, a: DVec3) {
        let facts = integrator.facts();
        let v = self.v + h * a;
        self.way = match facts.order {
            2 if !facts.multistep => h * (self.v + v) / 2.0,
            2 if report.fallbacks == Fallbacks::default() => (2.0 * h * v + self.way) / 3.0,
            1 if facts.explicit => {
                let substeps = f64::from(report.substeps);
                h * self.v + h * h * a * (0.5 + 0.5 / substeps)
            }
            _ => h * v,
        };
        (self.x, self.v) = (self.x + self.way, v);
    }
}

/// A small generator of random numbers: the suite must be the same everywhere.
pub(super) struct CaseRandom(pub u64);

impl CaseRandom {
    /// Between 0 and 1.
    pub fn number(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In the unit cube.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.number(), self.number(), self.number())
    }
}

/// Index of the vertex nearest to a place.
pub(super) fn nearest(points: &[DVec3], to: DVec3) -> usize {
    let by_distance =
        |a: &usize, b: &usize| points[*a].distance(to).total_cmp(&points[*b].distance(to));
    (0..points.len()).min_by(by_distance).unwrap_or(0)
}

/// Displacements (m) of a bar along x bent into an arc of a radius (m).
pub(super) fn bend(mesh: &Mesh, radius: f64) -> Vec<DVec3> {
    let place = |x: &DVec3| {
        let (sin, cos) = (x.x / radius).sin_cos();
        let r = radius - x.z;
        DVec3::new(r * sin, x.y, radius - r * cos) - *x
    };
    mesh.points.iter().map(place).collect()
}
