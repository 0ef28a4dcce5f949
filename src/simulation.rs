//! A headless simulation: a world, its schedules and one call per step.

use crate::blade::install_blades;
use crate::plugin::threads_beside_host;
use crate::replay::Recorder;
use crate::snapshot::{self, History};
use crate::tear::install_tears;
use crate::warning::{keep_findings, spawn_checked_body, totals};
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_contact::pair::BodyContact;
use sinew_contact::pull::Pull;
use sinew_contact::set::ContactSet;
use sinew_contact::thread::{Clip, Thread};
use sinew_contact::tool::Tool;
use sinew_engine::by_precision;
use sinew_engine::columns::single_table;
use sinew_engine::compression::CompressionReport;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::fnv::Fnv64;
use sinew_engine::lanes::InstructionSet;
use sinew_engine::law::{ElasticEnergy, EvaluationRequest};
use sinew_engine::load::{
    Constraint, Curve, Load, LoadedFace, LoadedFaces, Pose, Pressure, TargetError,
};
use sinew_engine::mesh::{CheckReport, Mesh, Surface};
use sinew_engine::order::Order;
pub use sinew_engine::precision::Precision;
use sinew_engine::ratios::{ElementNow, each_element, measure_area_ratios, measure_volume_ratios};
use sinew_engine::read::{by_vertex, each_vertex, reaction};
use sinew_engine::report::{AreaReport, StepReport, VolumeReport};
use sinew_engine::row::{MeshVertex, VertexRow};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{Executor, ForceSchedule};
#[cfg(feature = "gpu")]
use sinew_engine::step::ColumnsBehind;
use sinew_engine::step::{Gravity, StepClock, StepError, install_engine};
pub use sinew_engine::topology::BodyHandle;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{Displacement, Mass, Velocity};
use sinew_engine::workers::{Threads, Workers, WorkersError};
use sinew_models::axes::description::AxesError;
use sinew_models::body::change::set_material;
use sinew_models::body::present::Resection;
use sinew_models::body::{BodyDescription, BodyError, spawn_body};
use sinew_models::cutting::faces::{FacePart, face_parts};
use sinew_models::laws::pressure::activate as activate_pressure;
use sinew_models::material::field::{FieldError, MaterialField};
use sinew_models::traction::loaded_faces;
use sinew_solvers::explicit::{estimate_stable_step, forget_steps};
use sinew_solvers::implicit::forget_matrices;
use sinew_solvers::install_solver;
use sinew_solvers::settings::SolverSettings;

/// Where forces and steps are computed.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// The processor (default).
    #[default]
    Cpu,
    /// A graphics processor, in `f32` whatever the precision of the columns; needs the cargo feature `gpu`.
    Gpu,
}

impl Backend {
    /// Name as in a scene file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

/// When the state of a graphics processor comes to the columns of the world. The bits are the same either way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Readback {
    /// After every step (default): 32 bytes a vertex. For systems that read columns between steps.
    #[default]
    EveryStep,
    /// When [`Simulation::world_mut`] or a method that reads or changes the state is called; [`Simulation::world`]
    /// may show columns of an earlier step. Steps with inverted elements bring it down all the same.
    OnDemand,
}

/// How a simulation is carried out.
#[derive(Clone, Copy, Debug, Default)]
pub struct SimulationOptions {
    /// Number type.
    pub precision: Precision,
    /// Threads; 0 means one less than there are cores, or one per core if the simulation has the machine to itself. Results
    /// do not depend on it.
    pub threads: usize,
    /// The simulation has the machine to itself. Threads then stay awake through a step, and a pool with one per core keeps
    /// each to a core of its own: the fastest when nothing else runs, and much slower when something does, since all wait for
    /// the one that has lost its core. By default threads sleep when they have no work, and the system chooses their cores.
    pub exclusive: bool,
    /// Executor of the schedules.
    pub executor: Executor,
    /// Instruction set of the kernels; `None` means the best that the machine has. Results depend on
    /// it in the last digits.
    pub instruction_set: Option<InstructionSet>,
    /// Where steps are computed.
    pub backend: Backend,
    /// When the state comes back from there.
    pub readback: Readback,
}

impl SimulationOptions {
    /// Threads, and how they treat what else runs on the machine.
    fn threads(&self) -> Threads {
        let beside = threads_beside_host();
        match (self.exclusive, self.threads) {
            (true, threads) => threads.into(),
            (false, 0) => beside,
            (false, count) => Threads { count, ..beside },
        }
    }
}

/// A simulation that cannot be set up.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// Threads.
    #[error(transparent)]
    Workers(#[from] WorkersError),
    /// The build has no such backend.
    #[error(
        "backend = \"{}\" is not in this build: build with the cargo feature `gpu`, or use backend = \
         \"cpu\"", .0.name()
    )]
    Backend(Backend),
    /// The build has no such number type.
    #[error("precision = \"{}\" is not in WebAssembly: use precision = \"f64\"", .0.name())]
    Precision(Precision),
    /// The graphics processor.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] sinew_gpu::GpuError),
    /// A body.
    #[error(transparent)]
    Body(#[from] BodyError),
    /// A step.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A target of a constraint.
    #[error(transparent)]
    Target(#[from] TargetError),
    /// A material for a body that exists.
    #[error("new material of body `{body}`: {source}")]
    Material {
        /// Body.
        body: String,
        /// What is wrong.
        source: FieldError,
    },
    /// Axes of a body that exists.
    #[error("axes of body `{body}`: {source}")]
    Axes {
        /// Body.
        body: String,
        /// What is wrong.
        source: AxesError,
    },
    /// A constraint or load names a vertex that its body does not have.
    #[error(
        "`{name}`: vertex {vertex} of body `{body}` does not exist or belongs to no element, so it \
         cannot be held or loaded"
    )]
    Vertex {
        /// Constraint or load.
        name: String,
        /// Body.
        body: String,
        /// Vertex of the user's mesh.
        vertex: MeshVertex,
    },
    /// A pressure or traction names a face whose edges are not all in elements of its body.
    #[error(
        "`{name}`: face {triangle} (vertices {vertices:?}) of body `{body}` is no face of its \
         solid elements, as far as these are whole, and no cell of its membrane, so nothing can act on it"
    )]
    Face {
        /// Pressure or traction.
        name: String,
        /// Body.
        body: String,
        /// Index in the list that was given.
        triangle: usize,
        /// Its vertices in the user's mesh, of a quadrilateral the first three.
        vertices: [u32; 3],
    },
    /// A mesh has no group of this name.
    #[error("{mesh} has no group `{group}`; it has {}", known.join(", "))]
    Group {
        /// Mesh.
        mesh: String,
        /// Group asked for.
        group: String,
        /// Groups that exist.
        known: Vec<String>,
    },
    /// As many values as vertices are needed.
    #[error("{given} {what} given for body `{body}` with {expected} vertices")]
    Length {
        /// What was given.
        what: &'static str,
        /// Body.
        body: String,
        /// Entries needed.
        expected: usize,
        /// Entries given.
        given: usize,
    },
}

/// What a new material made of the energy of a body at rest in time: work done from outside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MaterialChange {
    /// Change of the elastic energy (J): the same displacements in another material.
    pub elastic_energy: f64,
    /// Change of the kinetic energy (J): the same velocities of other masses.
    pub kinetic_energy: f64,
}

/// What acts on bodies and has a name, for [`Simulation::find`].
pub trait Named: Component {
    /// Its name.
    fn name(&self) -> &str;
}

macro_rules! named {
    ($($what:ty),+) => {$(
        impl Named for $what {
            fn name(&self) -> &str {
                &self.name
            }
        }
    )+};
}

named!(Constraint, Load, Pressure, Tool, Pull, BodyContact, Thread, Clip);

/// A world with bodies, and its clock: build it, step it, read it.
///
/// | build | step | read |
/// |---|---|---|
/// | [`new`](Self::new), [`add_body`](Self::add_body) | [`set_dt`](Self::set_dt), [`set_solver`](Self::set_solver) | [`positions`](Self::positions), [`each_position`](Self::each_position) |
/// | [`group_rows`](Self::group_rows), [`add_constraint`](Self::add_constraint) | [`set_target`](Self::set_target), [`move_tool`](Self::move_tool) | [`tool_report`](Self::tool_report), [`surface`](Self::surface) |
/// | [`add_load`](Self::add_load), [`add_loaded_faces`](Self::add_loaded_faces), [`add_pressure`](Self::add_pressure) | [`step`](Self::step) | [`evaluate`](Self::evaluate), [`reaction`](Self::reaction) |
/// | [`add_tool`](Self::add_tool), [`add_body_contact`](Self::add_body_contact) | [`remove_elements`](Self::remove_elements) | [`report`](Self::report), [`volume_report`](Self::volume_report) |
/// | | | [`warnings`](Self::warnings), [`verdict`](Self::verdict) |
///
/// ```
/// use sinew::engine::mesh::generate::box_tets;
/// use sinew::prelude::*;
///
/// // build: a block of 0.5 kg that stands on a table
/// let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [4, 4, 2])?;
/// let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.4, density: 1000.0 };
/// let mut simulation = Simulation::new(SimulationOptions::default())?;
/// let block = simulation.add_body(&BodyDescription::new("block", &mesh, material))?;
/// let bottom = simulation.group_rows(block, &mesh, "z0")?;
/// let table = simulation.add_constraint(Constraint::hold("table", bottom));
/// // step: with this integrator one step is the equilibrium
/// let integrator = Integrator::QuasiStatic;
/// simulation.set_solver(SolverSettings { integrator, ..SolverSettings::default() });
/// simulation.step()?;
/// // read: it sags, and the table carries its weight
/// let top = mesh.group("z1").unwrap().vertices[0] as usize;
/// assert!((0.047..0.05).contains(&simulation.positions(block)[top].z));
/// assert!((simulation.reaction(table).unwrap().z - 0.5 * 9.81).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Everything in it is ordinary ECS data: [`Simulation::world_mut`] gives access to it. It may be moved to
/// another thread and stepped there. In a Bevy app use [`crate::SinewPlugins`] instead, which installs the
/// same systems.
pub struct Simulation {
    world: World,
    precision: Precision,
    history: History,
    recorder: Option<Recorder>,
    /// Whether the columns hold the forces of the current state.
    forces_known: bool,
}

/// # Build
impl Simulation {
    /// An empty world. With [`Backend::Gpu`] the adapter is the best there is, or what the environment
    /// variable `SINEW_ADAPTER` names.
    ///
    /// # Errors
    /// When the threads cannot be started, or backend or precision are not in this build, or the backend finds no adapter.
    pub fn new(options: SimulationOptions) -> Result<Self, SimulationError> {
        match options.backend {
            Backend::Cpu => {
                let mut simulation = Self::without_solver(options)?;
                by_precision!(options.precision, install_solver(&mut simulation.world));
                Ok(simulation)
            }
            #[cfg(feature = "gpu")]
            Backend::Gpu => {
                Self::with_gpu(options, sinew_gpu::GpuBackend::new(&Default::default())?)
            }
            #[cfg(not(feature = "gpu"))]
            Backend::Gpu => Err(SimulationError::Backend(Backend::Gpu)),
        }
    }

    /// An empty world on a device that was chosen already.
    ///
    /// # Errors
    /// When the threads cannot be started.
    #[cfg(feature = "gpu")]
    pub fn with_gpu(
        options: SimulationOptions,
        mut backend: sinew_gpu::GpuBackend,
    ) -> Result<Self, SimulationError> {
        backend.read_back_on_demand(options.readback == Readback::OnDemand);
        let mut simulation = Self::without_solver(options)?;
        let world = &mut simulation.world;
        world.insert_resource(Backend::Gpu);
        by_precision!(simulation.precision, install_on_gpu(world, backend));
        Ok(simulation)
    }

    fn without_solver(options: SimulationOptions) -> Result<Self, SimulationError> {
        let mut workers = Workers::new(options.threads())?;
        if let Some(set) = options.instruction_set {
            workers = workers.with_instruction_set(set)?;
        }
        let SimulationOptions { precision, executor, .. } = options;
        if !precision.is_built() {
            return Err(SimulationError::Precision(precision));
        }
        let mut world = World::new();
        by_precision!(precision, install_engine(&mut world, executor));
        by_precision!(precision, install_blades(&mut world));
        by_precision!(precision, install_tears(&mut world));
        world.insert_resource(workers);
        world.insert_resource(Backend::Cpu);
        Ok(Self {
            world,
            precision,
            history: History::default(),
            recorder: None,
            forces_known: false,
        })
    }

    /// Builds a body. What its mesh and material make one doubt, such as lengths that look like millimetres, is in
    /// [`Simulation::warnings`].
    ///
    /// # Errors
    /// When mesh or material cannot be used; nothing is added then.
    ///
    /// A sheet or a hollow organ has no solid elements, only a membrane of its faces:
    ///
    /// ```
    /// use sinew::engine::mesh::generate::sphere_triangles;
    /// use sinew::models::body::sheet::MembraneDescription;
    /// use sinew::prelude::*;
    ///
    /// let mesh = sphere_triangles(0.02, 3)?;
    /// let wall = preset("skin")?.material;
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let balloon = simulation.add_body(&BodyDescription {
    ///     membrane: Some(MembraneDescription::new(&mesh.triangles, 0.001, wall)),
    ///     ..BodyDescription::new("balloon", &mesh, wall)
    /// })?;
    /// assert_eq!(simulation.vertex_count(balloon), mesh.points.len());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn add_body(&mut self, body: &BodyDescription) -> Result<BodyHandle, BodyError> {
        self.fetch();
        spawn_checked_body(&mut self.world, body)?;
        Ok(BodyHandle(self.topology().bodies.len() - 1))
    }

    /// Builds a body of a mesh that was checked already, with what the [check](sinew_engine::mesh::check()) found.
    ///
    /// # Errors
    /// As [`Simulation::add_body`].
    pub fn add_checked_body(
        &mut self,
        body: &BodyDescription,
        report: &CheckReport,
    ) -> Result<BodyHandle, BodyError> {
        self.fetch();
        let entity = spawn_body(&mut self.world, body)?;
        keep_findings(&mut self.world, entity, body, report);
        Ok(BodyHandle(self.topology().bodies.len() - 1))
    }

    /// Number of vertices of a body's mesh: the length of every list in the user's order. It is good for one
    /// [`Simulation::layout_revision`].
    pub fn vertex_count(&self, body: BodyHandle) -> usize {
        self.topology().bodies[body.0].mesh_vertices()
    }

    /// Counts up whenever bodies, rows or elements are numbered anew. Whoever keeps buffers of the size of a body or
    /// rows of it asks for them again when it is another than before.
    pub fn layout_revision(&self) -> u64 {
        self.topology().revision
    }

    /// Vertex rows of vertices given in the user's order.
    ///
    /// # Errors
    /// When one does not exist or no element uses it; `name` says in the error who asked.
    pub fn rows(
        &self,
        body: BodyHandle,
        name: &str,
        vertices: &[impl Into<MeshVertex> + Copy],
    ) -> Result<Vec<VertexRow>, SimulationError> {
        let rows = &self.topology().bodies[body.0];
        let row = |&vertex: &_| {
            let vertex = Into::into(vertex);
            let (name, body) = (name.into(), rows.name.clone());
            rows.row(vertex).ok_or(SimulationError::Vertex { name, body, vertex })
        };
        vertices.iter().map(row).collect()
    }

    /// Vertex rows of a named group of the mesh that the body was made from.
    ///
    /// # Errors
    /// When the mesh has no such group, or a vertex of it belongs to no element.
    pub fn group_rows(
        &self,
        body: BodyHandle,
        mesh: &Mesh,
        group: &str,
    ) -> Result<Vec<VertexRow>, SimulationError> {
        match mesh.group(group) {
            Some(found) => self.rows(body, group, &found.vertices),
            None => Err(SimulationError::Group {
                mesh: mesh.source.clone(),
                group: group.into(),
                known: mesh.groups.iter().map(|g| format!("`{}`", g.name)).collect(),
            }),
        }
    }

    /// Adds a constraint on rows of [`Simulation::rows`]; the entity identifies it. Vertices of a mesh are no rows, and are not
    /// taken for such:
    ///
    /// ```compile_fail,E0308
    /// use sinew::prelude::*;
    ///
    /// let bed: Vec<u32> = vec![0, 1, 2];
    /// Constraint::hold("bed", bed);
    /// ```
    pub fn add_constraint(&mut self, constraint: Constraint) -> Entity {
        self.world_mut().spawn(constraint).id()
    }

    /// Moves what a constraint of [`Constraint::hold`] holds: a vector is a translation (m) from where the
    /// vertices were when it took hold, a [`Pose`] turns them too. They reach it at the end of the next step,
    /// evenly through the step, and stay there until another target is set.
    ///
    /// # Errors
    /// When there is no such constraint, it has a motion of its own, or the pose cannot be used.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    ///
    /// let mesh = box_tets(DVec3::new(0.2, 0.1, 0.1), [4, 2, 2])?;
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let body = simulation.add_body(&BodyDescription::new("box", &mesh, preset("liver")?.material))?;
    /// let wall = simulation.group_rows(body, &mesh, "x0")?;
    /// simulation.add_constraint(Constraint::hold("wall", wall));
    /// let held = simulation.group_rows(body, &mesh, "x1")?;
    /// let tool = simulation.add_constraint(Constraint::hold("tool", held));
    /// for frame in 1..=10 {
    ///     let hand = DVec3::new(0.001 * f64::from(frame), 0.0, 0.0); // where the device is in this frame
    ///     simulation.set_target(tool, hand)?;
    ///     simulation.step()?;
    /// }
    /// assert!(simulation.reaction(tool).unwrap().x > 0.5);
    /// let corner = mesh.group("x1").unwrap().vertices[0] as usize;
    /// assert_eq!(simulation.positions(body)[corner].x, 0.2 + 0.01);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn set_target(
        &mut self,
        constraint: Entity,
        pose: impl Into<Pose>,
    ) -> Result<(), TargetError> {
        let constraint = self.current(constraint);
        match self.world_mut().get_mut::<Constraint>(constraint) {
            Some(mut constraint) => constraint.set_target(pose),
            None => Err(TargetError::NoConstraint(constraint)),
        }
    }

    /// Adds dead loads on rows of [`Simulation::rows`].
    pub fn add_load(&mut self, load: Load) -> Entity {
        self.world_mut().spawn(load).id()
    }

    /// Vertex rows of triangles given in the user's order, winding kept, for a [`Pressure`].
    ///
    /// # Errors
    /// When a triangle names a vertex that no element uses, or has an edge that none has; `name` says in
    /// the error who asked. Faces of linear tetrahedra and triangles of a membrane alone that a cut parted have what is left of them.
    pub fn face_rows(
        &self,
        body: BodyHandle,
        name: &str,
        triangles: &[[u32; 3]],
    ) -> Result<Vec<[VertexRow; 3]>, SimulationError> {
        let rows = |t: &[u32; 3]| {
            let rows = self.rows(body, name, t)?;
            Ok([rows[0], rows[1], rows[2]])
        };
        let faces = triangles.iter().map(rows).collect::<Result<Vec<_>, SimulationError>>()?;
        let resection = self.world().get_resource::<Resection>();
        let parts = face_parts(self.topology(), resection, &faces);
        self.rows_of_faces(body, name, triangles, &parts)
    }

    fn rows_of_faces<const N: usize>(
        &self,
        body: BodyHandle,
        name: &str,
        cells: &[[u32; N]],
        parts: &[Option<Vec<FacePart>>],
    ) -> Result<Vec<[VertexRow; N]>, SimulationError> {
        let mut faces = Vec::with_capacity(cells.len());
        let parted = self.parted_elements(body);
        for (triangle, vertices) in cells.iter().enumerate() {
            let rows = self.rows(body, name, vertices)?;
            let topology = self.topology();
            let is_edge = |(a, b): (VertexRow, VertexRow)| {
                topology.block(a.0, b.0).is_some_and(|edge| topology.uses_edge(edge as usize))
            };
            // of a quadrilateral both diagonals too: elements couple all their vertices
            let mut pairs = (0..N).flat_map(|i| (0..i).map(move |j| (i, j)));
            let is_on = |element: &Vec<VertexRow>| rows.iter().all(|row| element.contains(row));
            let mut is_whole =
                || !parted.iter().any(is_on) && pairs.all(|(i, j)| is_edge((rows[i], rows[j])));
            let has_parts = parts.get(triangle).is_some_and(Option::is_some);
            if !has_parts && !is_whole() {
                let (body, name) = (topology.bodies[body.0].name.clone(), name.into());
                let vertices = [vertices[0], vertices[1], vertices[2]];
                return Err(SimulationError::Face { name, body, triangle, vertices });
            }
            faces.push(std::array::from_fn(|i| rows[i]));
        }
        Ok(faces)
    }

    /// Faces of a body under the traction `traction` (N/m^2), which keeps its direction, for
    /// [`Simulation::add_loaded_faces`]: every vertex gets the traction times the integral of its shape function at rest. The
    /// faces are in the user's order, as [`Mesh::surface`](sinew_engine::mesh::Mesh::surface) gives them; which way they turn
    /// does not matter.
    ///
    /// ```
    /// use sinew::engine::mesh::generate::box_hexahedra;
    /// use sinew::engine::mesh::Surface;
    /// use sinew::prelude::*;
    ///
    /// let mesh = box_hexahedra(DVec3::splat(0.1), [2, 2, 2])?;
    /// let material = YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.4, density: 1000.0 };
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let body = simulation.add_body(&BodyDescription::new("block", &mesh, material))?;
    /// let at_end = |q: &[u32; 4]| q.iter().all(|&v| mesh.points[v as usize].x > 0.099);
    /// let quads = mesh.surface().quads.into_iter().filter(at_end).collect();
    /// let on = Surface { quads, ..Surface::default() };
    /// let faces = simulation.traction_faces(body, "pull", &on, DVec3::X * 200.0)?;
    /// let total: DVec3 = faces.iter().flat_map(|face| &face.forces).map(|(_, f)| *f).sum();
    /// assert!((total.x - 200.0 * 0.01).abs() < 1e-12);
    /// simulation.add_loaded_faces("pull", faces, Curve::ramp(0.0, 0.5));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// When a face names a vertex that no element uses, or has an edge that none has; `name` says in the error who
    /// asked.
    pub fn traction_faces(
        &mut self,
        body: BodyHandle,
        name: &str,
        on: &Surface,
        traction: DVec3,
    ) -> Result<Vec<LoadedFace>, SimulationError> {
        let triangles = self.rows_of_faces(body, name, &on.triangles, &[])?;
        let quads = self.rows_of_faces(body, name, &on.quads, &[])?;
        Ok(loaded_faces(&mut self.world, &triangles, &quads, traction))
    }

    /// Adds a dead load that faces bear, as [`Simulation::traction_faces`] gives them: a [`Load`] with the sum of their
    /// forces. A face that loses its last element takes its share along.
    pub fn add_loaded_faces(
        &mut self,
        name: impl Into<String>,
        faces: Vec<LoadedFace>,
        curve: Curve,
    ) -> Entity {
        let faces = LoadedFaces(faces);
        let load = Load { name: name.into(), forces: faces.forces(), curve };
        self.world_mut().spawn((load, faces)).id()
    }

    /// Adds a follower pressure on rows of [`Simulation::face_rows`]. Quadrilateral faces are best cut along both
    /// diagonals, their four triangles with half the pressure: every corner then gets the quarter that its
    /// shape function gives it.
    pub fn add_pressure(&mut self, pressure: Pressure) -> Entity {
        self.fetch();
        let world = &mut self.world;
        let entity = world.spawn(pressure).id();
        by_precision!(self.precision, activate_pressure(world));
        entity
    }

    /// Takes a constraint, a load or a pressure away; whether there was one. What it held is free from the next step
    /// on.
    pub fn remove_load_or_constraint(&mut self, entity: Entity) -> bool {
        let entity = self.current(entity);
        self.fetch();
        let world = &mut self.world;
        let pressure = world.get::<Pressure>(entity).is_some();
        let known = pressure
            || world.get::<Constraint>(entity).is_some()
            || world.get::<Load>(entity).is_some();
        let gone = known && world.despawn(entity);
        if pressure {
            // its faces go at once
            by_precision!(self.precision, activate_pressure(world));
        }
        gone
    }

    /// Gives a body another material, uniform ([`YoungPoisson`](sinew_models::material::YoungPoisson))
    /// or by tetrahedron ([`MaterialField`]), from the start of the next step on.
    ///
    /// Moduli, spring constants and masses are computed again; displacements and velocities stay, so
    /// elastic and kinetic energy jump by what is returned. The jump is work from outside: the next
    /// step starts from the energy after it, and the energy bound of the safe step counts from there.
    /// Kept preconditioners, factors and the remembered steps of explicit integrators are forgotten,
    /// the stability limit is estimated anew. A body changed so equals one built with the material at
    /// the same state, bit for bit.
    ///
    /// # Errors
    /// When the material cannot be used; nothing is changed then.
    ///
    /// # Panics
    /// As [`Simulation::evaluate`].
    pub fn set_material<'a>(
        &mut self,
        body: BodyHandle,
        material: impl Into<MaterialField<'a>>,
    ) -> Result<MaterialChange, SimulationError> {
        let field = material.into();
        let before = (self.evaluate(), self.kinetic_energy(body));
        self.fetch();
        let world = &mut self.world;
        let result = by_precision!(self.precision, set_material(world, body.0, &field));
        if let Err(source) = result {
            let body = self.topology().bodies[body.0].name.clone();
            return Err(SimulationError::Material { body, source });
        }
        self.fetch();
        let world = &mut self.world;
        by_precision!(self.precision, forget_steps(world));
        by_precision!(self.precision, forget_matrices(world));
        Ok(MaterialChange {
            elastic_energy: self.evaluate() - before.0,
            kinetic_energy: self.kinetic_energy(body) - before.1,
        })
    }

    /// Kinetic energy (J) of a body, what cuts made of it included.
    pub fn kinetic_energy(&mut self, body: BodyHandle) -> f64 {
        by_precision!(self.precision, kinetic_energy(self.columns(), body))
    }

    /// Sets gravity (m/s^2), from the next step on.
    ///
    /// Gravity acts as the load it has at the end of a step. A change between steps does no work by
    /// itself: reports count the work `m g . du` of each step with that step's gravity, and potential
    /// energies before and after a change cannot be compared.
    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.world_mut().insert_resource(Gravity(gravity));
    }
}

/// # Step
impl Simulation {
    /// Sets the length of the steps to come (s). Positions and velocities are those of the last step's
    /// end; explicit integrators divide the new step anew, and no energy is added or taken.
    pub fn set_dt(&mut self, dt: f64) {
        self.world_mut().resource_mut::<StepClock>().dt = dt;
    }

    /// Sets the solver.
    pub fn set_solver(&mut self, settings: SolverSettings) {
        self.world_mut().insert_resource(settings);
    }

    /// Carries out one step. What was not as it should be in it, though it was carried out, is in
    /// [`Simulation::warnings`].
    ///
    /// # Errors
    /// When settings or state are invalid or the integrator gives up; the state is then unchanged.
    pub fn step(&mut self) -> Result<(), StepError> {
        self.forces_known = false;
        #[cfg(feature = "gpu")]
        if self.world().contains_resource::<ColumnsBehind>()
            && sinew_gpu::columns_needed(&mut self.world)
        {
            self.fetch();
        }
        let before = self.before_step();
        let mut recorder = self.recorder.take();
        if let Some(recorder) = &mut recorder {
            recorder.before_step(self);
        }
        let result = totals::step(&mut self.world);
        if let Some(before) = before
            && result.is_ok()
        {
            self.push_history(before);
        }
        if let Some(recorder) = &mut recorder
            && result.is_ok()
        {
            recorder.after_step(self);
        }
        self.recorder = recorder;
        // the engine keeps systems and columns by taking components out and putting them back: without this,
        // notes of the removals pile up for the rest of the run, as there is no app that drops them each frame
        self.world.clear_trackers();
        result
    }

    /// Sets displacements (m) and velocities (m/s) in the user's order.
    ///
    /// # Errors
    /// When the lengths differ from the number of vertices.
    pub fn set_state(
        &mut self,
        body: BodyHandle,
        displacements: &[DVec3],
        velocities: &[DVec3],
    ) -> Result<(), SimulationError> {
        let rows = self.topology().bodies[body.0].clone();
        let expected = rows.mesh_vertices();
        for (what, values) in [("displacements", displacements), ("velocities", velocities)] {
            if values.len() != expected {
                let body = rows.name;
                return Err(SimulationError::Length { what, body, expected, given: values.len() });
            }
        }
        Ok(by_precision!(self.precision, write_state(self, &rows, displacements, velocities))?)
    }

    /// Whether the constraints of the first step hold every body against all motions that deform no element, as
    /// an equilibrium needs: rigid motions of its pieces, and those of parts about hinges.
    ///
    /// # Errors
    /// When a body can move so.
    pub fn check_support(&mut self) -> Result<(), StepError> {
        by_precision!(self.precision, check_support(self.world_mut()))
    }

    /// Largest stable explicit step (s) at the current state, from the largest eigenvalue by Lanczos
    /// steps; see [`sinew_solvers::stability`].
    pub fn stable_step(&mut self) -> f64 {
        self.fetch();
        let world = &mut self.world;
        by_precision!(self.precision, estimate_stable_step(world))
    }
}

/// # Read
impl Simulation {
    /// Simulated time (s).
    pub fn time(&self) -> f64 {
        self.world().resource::<StepClock>().time
    }

    /// Figures of the last step.
    pub fn report(&self) -> &StepReport {
        self.world().resource()
    }

    /// Volume ratios after the last step.
    pub fn volume_report(&self) -> &VolumeReport {
        self.world().resource()
    }

    /// Elements that were pressed far together after the last step: those of the bodies whose model
    /// [softens](sinew_models::body::Model::softens) there, with a principal stretch below
    /// [`COMPRESSED`](sinew_engine::compression::COMPRESSED), and biquadratic fibres of other bodies. They resist too
    /// little.
    pub fn compressed_elements(&self) -> u64 {
        self.world().get_resource::<CompressionReport>().map_or(0, CompressionReport::compressed)
    }

    /// Smallest area ratio of membranes after the last step; infinite without membranes.
    pub fn area_report(&self) -> AreaReport {
        self.world().get_resource().copied().unwrap_or_default()
    }

    /// The body of that name, if it has elements left.
    pub fn find_body(&self, name: &str) -> Option<BodyHandle> {
        self.topology().find(name).map(BodyHandle)
    }

    /// The constraint, load, pressure, tool, pull, contact, thread or clip of that name, of several the one that came first:
    /// `simulation.find::<Tool>("ball")`.
    pub fn find<T: Named>(&mut self, name: &str) -> Option<Entity> {
        let world = self.columns();
        let mut query = world.query::<(Entity, &Order, &T)>();
        let named = query.iter(world).filter(|(.., own)| own.name() == name);
        named.min_by_key(|(_, order, _)| **order).map(|(entity, ..)| entity)
    }

    /// What a handle leads to now: the entity itself, or, where it was taken away and came back with a [restored
    /// snapshot](Self::restore), the one that it is since. Methods that take such handles ask this by themselves.
    pub fn current(&self, entity: Entity) -> Entity {
        snapshot::current(self.world(), entity)
    }

    /// Bodies and edge graph.
    pub fn topology(&self) -> &Topology {
        self.world().resource()
    }

    /// Deformed positions (m) in the user's order, what a host draws; zero for vertices without an element.
    pub fn positions(&mut self, body: BodyHandle) -> Vec<DVec3> {
        by_precision!(self.precision, by_vertex(self.columns(), body.0, |now| now.position()))
    }

    /// Displacements (m) in the user's order; vertices without an element have none (zero).
    pub fn displacements(&mut self, body: BodyHandle) -> Vec<DVec3> {
        by_precision!(
            self.precision,
            by_vertex(self.columns(), body.0, |now| now.displacement.get())
        )
    }

    /// Velocities (m/s) in the user's order.
    pub fn velocities(&mut self, body: BodyHandle) -> Vec<DVec3> {
        by_precision!(self.precision, by_vertex(self.columns(), body.0, |now| now.velocity.get()))
    }

    /// Elastic forces (N) at the current state in the user's order.
    ///
    /// # Panics
    /// As [`Simulation::evaluate`].
    pub fn elastic_forces(&mut self, body: BodyHandle) -> Vec<DVec3> {
        self.find_forces();
        by_precision!(self.precision, by_vertex(self.columns(), body.0, |now| now.elastic.get()))
    }

    /// External forces (N), gravity included, of the last step in the user's order.
    pub fn external_forces(&mut self, body: BodyHandle) -> Vec<DVec3> {
        by_precision!(self.precision, by_vertex(self.columns(), body.0, |now| now.external.get()))
    }

    /// Lumped masses (kg) in the user's order; zero for vertices without an element.
    pub fn masses(&mut self, body: BodyHandle) -> Vec<f64> {
        let mut masses = vec![0.0; self.vertex_count(body)];
        by_precision!(
            self.precision,
            each_vertex(self.columns(), body.0, |vertex, now| {
                masses[vertex.index()] = now.mass.0.to_f64();
            })
        );
        masses
    }

    /// Volume ratio J of every tetrahedron of a body, then of every hexahedron (the smallest of its Gauss
    /// points), in the user's order.
    pub fn volume_ratios(&mut self, body: BodyHandle) -> Vec<f64> {
        self.ratios(body, [ElementKind::Tetrahedron, ElementKind::Hexahedron])
    }

    /// Area ratio of every membrane triangle of a body, then of every quadrilateral (the smallest of its Gauss
    /// points), in the user's order.
    pub fn area_ratios(&mut self, body: BodyHandle) -> Vec<f64> {
        self.ratios(body, [ElementKind::Triangle, ElementKind::Quad])
    }

    fn ratios(&mut self, body: BodyHandle, kinds: [ElementKind; 2]) -> Vec<f64> {
        let rows = &self.topology().bodies[body.0];
        let [first, second] = kinds.map(|kind| rows.mesh_elements(kind));
        let sources = kinds.map(|kind| rows.sources(kind).to_vec());
        let mut result = vec![f64::INFINITY; first + second];
        self.each_element(body, |e| {
            if let Some(list) = kinds.iter().position(|kind| *kind == e.kind) {
                // of an element that was cut the smallest of its copies
                let copy = (e.index as usize).checked_sub([first, second][list]);
                let index = copy.map_or(e.index, |copy| sources[list][copy]);
                let own = &mut result[list * first + index as usize];
                *own = own.min(e.smallest());
            }
        });
        result.iter_mut().filter(|ratio| **ratio == f64::INFINITY).for_each(|ratio| *ratio = 1.0);
        result
    }

    pub(crate) fn each_element(&mut self, body: BodyHandle, with: impl FnMut(ElementNow)) {
        by_precision!(self.precision, each_element(self.columns(), body.0, with));
    }

    /// Calls `with` with every vertex that elements use or used, by its index in the user's mesh, and its deformed
    /// position (m): [`Simulation::positions`] into whatever memory a host has.
    pub fn each_position(&mut self, body: BodyHandle, mut with: impl FnMut(usize, DVec3)) {
        by_precision!(
            self.precision,
            each_vertex(self.columns(), body.0, |vertex, now| with(vertex.index(), now.position()))
        );
    }

    /// Likewise with its displacement (m).
    pub fn each_displacement(&mut self, body: BodyHandle, mut with: impl FnMut(usize, DVec3)) {
        by_precision!(
            self.precision,
            each_vertex(self.columns(), body.0, |vertex, now| {
                with(vertex.index(), now.displacement.get())
            })
        );
    }

    /// Likewise with its velocity (m/s).
    pub fn each_velocity(&mut self, body: BodyHandle, mut with: impl FnMut(usize, DVec3)) {
        by_precision!(
            self.precision,
            each_vertex(self.columns(), body.0, |vertex, now| {
                with(vertex.index(), now.velocity.get())
            })
        );
    }

    /// Evaluates elastic energy (J) and forces at the current state, outside a step.
    ///
    /// # Panics
    /// When components of element entities were added or removed from outside; [`Simulation::step`]
    /// answers that with an error.
    pub fn evaluate(&mut self) -> f64 {
        let world = self.columns();
        world.insert_resource(EvaluationRequest { energy: true, force: true, tangent: None });
        world.run_schedule(ForceSchedule);
        let energy = world.resource::<ElasticEnergy>().elastic();
        self.forces_known = true;
        energy
    }

    /// Evaluates forces unless they are those of the current state.
    fn find_forces(&mut self) {
        if !self.forces_known {
            self.evaluate();
        }
    }

    /// Force (N) that a constraint exerts on the body at the current state: what is needed at its
    /// held unknowns to balance elastic and external forces. Inertia and damping of the held vertices
    /// are left out, and unknowns that two constraints hold count in both. Costs an evaluation of the forces, once for every
    /// state. Zero while the constraint does not act; `None` when there is no such constraint.
    ///
    /// # Panics
    /// As [`Simulation::evaluate`].
    pub fn reaction(&mut self, constraint: Entity) -> Option<DVec3> {
        Some(self.reaction_about(constraint, DVec3::ZERO)?[0])
    }

    /// The force (N) of [`Simulation::reaction`], and its torque (N m) about a point (m).
    pub fn reaction_about(&mut self, constraint: Entity, point: DVec3) -> Option<[DVec3; 2]> {
        self.find_forces();
        let constraint = self.current(constraint);
        let contact = self.world().get_resource::<ContactSet>();
        let touch = contact.map_or_else(Vec::new, |contact| contact.forces().to_vec());
        by_precision!(self.precision, reaction(self.columns(), constraint, point, &touch))
    }

    /// 64-bit FNV-1a hash of displacements and velocities, in the user's order: equal hashes mean
    /// equal results bit for bit.
    pub fn state_hash(&mut self) -> u64 {
        state_hash(self.columns())
    }
}

/// # The world behind it
impl Simulation {
    /// Whether the backend has all that bodies and settings need; a step checks it too.
    ///
    /// # Errors
    /// Names the first law, body or setting that the graphics processor does not have.
    pub fn check_backend(&mut self) -> Result<(), SimulationError> {
        #[cfg(feature = "gpu")]
        if self.backend() == Backend::Gpu {
            let world = &mut self.world;
            let settings = world.resource::<SolverSettings>().clone();
            sinew_gpu::check(world, &settings)?;
        }
        Ok(())
    }

    /// Where steps are computed.
    pub fn backend(&self) -> Backend {
        *self.world().resource()
    }

    /// The world. With [`Readback::OnDemand`] displacements, velocities and positions may be those of an earlier step:
    /// [`Simulation::world_mut`] brings them up to date.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The world, writable, its columns up to date.
    pub fn world_mut(&mut self) -> &mut World {
        self.fetch();
        &mut self.world
    }

    /// The world for whoever changes nothing that forces depend on, its columns up to date.
    pub(crate) fn columns(&mut self) -> &mut World {
        let known = self.forces_known;
        self.fetch();
        self.forces_known = known;
        &mut self.world
    }

    /// Brings the columns up to date, for a change: forces found before are then those of another state.
    fn fetch(&mut self) {
        self.forces_known = false;
        #[cfg(feature = "gpu")]
        {
            let world = &mut self.world;
            by_precision!(self.precision, fetch_state(world));
        }
    }

    pub(crate) fn recorder_mut(&mut self) -> &mut Option<Recorder> {
        &mut self.recorder
    }

    pub(crate) fn history_mut(&mut self) -> &mut History {
        &mut self.history
    }

    /// Number type of the state.
    pub fn precision(&self) -> Precision {
        self.precision
    }
}

/// [`Simulation::state_hash`] of a world, such as that of a Bevy app with [`crate::SinewPlugins`].
pub fn state_hash(world: &mut World) -> u64 {
    let Some(&precision) = world.get_resource::<Precision>() else { return Fnv64::default().0 };
    by_precision!(precision, hash_rows(world))
}

fn hash_rows<S: Scalar>(world: &mut World) -> u64 {
    let mut hash = Fnv64::default();
    for body in 0..world.resource::<Topology>().bodies.len() {
        let u = by_vertex::<S>(world, body, |now| now.displacement.get());
        let v = by_vertex::<S>(world, body, |now| now.velocity.get());
        let ghosts = ghosts::<S>(world, body);
        for x in u.iter().chain(&v).chain(&ghosts).flat_map(|x| x.to_array()) {
            x.to_bits().to_le_bytes().into_iter().for_each(|byte| hash.add(byte.into()));
        }
    }
    hash.0
}

/// Displacements (m) and velocities (m/s) of the ghosts that cuts of a body made.
fn ghosts<S: Scalar>(world: &mut World, body: usize) -> Vec<DVec3> {
    let rows = &world.resource::<Topology>().bodies[body];
    let first = rows.vertices.start as usize + rows.vertex_order.len();
    let count = rows.copies.ghosts.len();
    if count == 0 {
        return Vec::new();
    }
    let mut query = world.query::<(&Displacement<S>, &Velocity<S>)>();
    let own = query.iter(world).skip(first).take(count);
    own.flat_map(|(u, v)| [u.get(), v.get()]).collect()
}

#[cfg(feature = "gpu")]
use sinew_gpu::{fetch_state, install_gpu as install_on_gpu};

fn write_state<S: Scalar>(
    simulation: &mut Simulation,
    rows: &BodyRows,
    displacements: &[DVec3],
    velocities: &[DVec3],
) -> Result<(), StepError> {
    let world = simulation.world_mut();
    let mut query = world.query::<(&mut Displacement<S>, &mut Velocity<S>)>();
    if let Some((mut u, mut v)) = single_table(query.contiguous_iter_mut(world)) {
        // every look through such a column marks all of its rows as changed
        let (u, v) = (&mut *u, &mut *v);
        for (vertex, row) in rows.vertices_and_rows() {
            u[row.index()].set(displacements[vertex.index()]);
            v[row.index()].set(velocities[vertex.index()]);
        }
    }
    // what the solver does with a state must not depend on the state before
    forget_steps::<S>(world);
    let failed = |error: &dyn std::fmt::Display| StepError::InvalidSetting(error.to_string());
    if world.contains_resource::<AreaReport>() {
        world.run_system_cached(measure_area_ratios::<S>).map_err(|e| failed(&e))?;
    }
    world.run_system_cached(measure_volume_ratios::<S>).map_err(|e| failed(&e))
}

fn kinetic_energy<S: Scalar>(world: &mut World, body: BodyHandle) -> f64 {
    let own = world.resource::<Topology>().bodies[body.0].vertices.clone();
    let mut query = world.query::<(&Mass<S>, &Velocity<S>)>();
    let Some((m, v)) = single_table(query.contiguous_iter(world)) else { return 0.0 };
    let own = own.start as usize..own.end as usize;
    let rows = m[own.clone()].iter().zip(&v[own]);
    rows.map(|(m, v)| 0.5 * m.0.to_f64() * v.get().length_squared()).sum()
}

fn check_support<S: Scalar>(world: &mut World) -> Result<(), StepError> {
    world.run_system_cached(sinew_engine::load::apply_constraints::<S>).expect("engine resources");
    let mut node = sinew_solvers::state::NodeState::<S>::default();
    node.read(world);
    sinew_solvers::support::check_support(world, &node)
}
