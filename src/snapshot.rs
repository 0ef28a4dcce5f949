//! Snapshots: everything that the steps to come depend on, to be taken up again at another time, in a simulation built
//! anew or in another process. What follows from a snapshot has the same bits as what would have followed without.
//!
//! A snapshot holds displacements and velocities, time and settings, constraints, loads, tools and the like, the memory of
//! integrators, kept preconditioners, friction and muscles, and the list of what was done to bodies. It does not hold
//! bodies: the simulation that it is restored into must have been built from the same meshes and materials. Neither
//! does it hold what users of the engine keep beside it.

use crate::simulation::{Backend, Simulation};
use crate::warning::totals::RunTotals;
use bevy_ecs::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sinew_contact::edge::EdgeState;
use sinew_contact::pair::{BodyContact, BodyContactReport};
use sinew_contact::pull::{Pull, PullReport};
use sinew_contact::set::{ContactMemory, ContactSet};
use sinew_contact::shape::Shape;
use sinew_contact::thread::{Clip, Thread, ThreadReport};
use sinew_contact::tool::{Tool, ToolReport};
use sinew_engine::by_precision;
use sinew_engine::columns::single_table;
use sinew_engine::fnv::Fnv64;
use sinew_engine::lanes::InstructionSet;
use sinew_engine::law::{DisabledLaws, RecoveringBodies};
use sinew_engine::load::{Constraint, Load, LoadTime, LoadedFaces, Pressure, SweptVolumes};
use sinew_engine::order::{LastOrder, Order};
use sinew_engine::precision::Precision;
use sinew_engine::report::{AreaReport, StepReport, VolumeReport};
use sinew_engine::resource::ensure;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::ActiveLaws;
use sinew_engine::step::{Gravity, StepClock, write_positions};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{
    Displacement, ElasticForce, ExternalForce, FixedAxes, PrescribedDisplacement, Velocity,
};
use sinew_engine::workers::Workers;
use sinew_models::axes::muscle::{self, ActivationWork, Activations, Muscles};
use sinew_models::body::edit_log::{Edit, scene_hash};
use sinew_models::cutting::blade::{BladeViews, StrokeMemory};
use sinew_models::cutting::glue::{self, GlueMemory};
use sinew_models::cutting::tear::{Tear, TearReport};
use sinew_models::edits::{EditError, EditState};
use sinew_models::laws::pressure::activate as activate_pressure;
use sinew_models::resection::RemovalRequest;
use sinew_solvers::memory::SolverMemory;
use sinew_solvers::settings::SolverSettings;
use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

/// First bytes of a snapshot.
const MAGIC: &[u8; 8] = b"SinewSnp";
/// Number of the format. It is raised whenever something that is stored changes, which a stored snapshot in the tests
/// notices; other numbers are refused by name.
const FORMAT: u32 = 13;

/// A snapshot that cannot be taken, read or restored. The simulation is what it was before.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SnapshotError {
    /// The bytes do not begin like a snapshot.
    #[error("this is no snapshot: it does not begin with `SinewSnp`")]
    NoSnapshot,
    /// Some bytes are missing or others than were written.
    #[error("the snapshot is damaged ({what}): take an earlier one")]
    Damaged {
        /// What does not fit.
        what: &'static str,
    },
    /// It was written by a version that stores something else.
    #[error(
        "the snapshot has format {found}, written by Sinew {version}; this is Sinew {} and reads format {FORMAT}: use \
         the version that wrote it", env!("CARGO_PKG_VERSION")
    )]
    Format {
        /// Format found.
        found: u32,
        /// Version that wrote it.
        version: String,
    },
    /// The bodies are others.
    #[error(
        "the snapshot belongs to another scene: bodies, meshes, materials or models differ from those of this \
         simulation; build it as the one that the snapshot was taken of"
    )]
    Scene,
    /// The number type differs.
    #[error("the snapshot is in {}, the simulation in {}: set its precision to that of the snapshot", .snapshot.name(), .simulation.name())]
    Precision {
        /// Of the snapshot.
        snapshot: Precision,
        /// Of the simulation.
        simulation: Precision,
    },
    /// The instruction set differs, so that results would differ in the last digits.
    #[error(
        "the snapshot was taken with instruction set {}, the simulation uses {}: run it with `instruction_set = \"{}\"`, \
         or take snapshots with \"portable\", which every machine has", .snapshot.name(), .simulation.name(), .snapshot.name()
    )]
    InstructionSet {
        /// Of the snapshot.
        snapshot: InstructionSet,
        /// Of the simulation.
        simulation: InstructionSet,
    },
    /// The backend keeps its state elsewhere.
    #[error("backend = \"gpu\" has no snapshots: use backend = \"cpu\"")]
    Backend,
    /// Bodies were cut or changed.
    #[error(transparent)]
    Edits(#[from] EditError),
    /// The world has no engine.
    #[error("the world has no engine: add `SinewPlugins` to the app, or call `install_engine`")]
    NoEngine,
    /// So many steps back are not kept.
    #[error("{asked} steps back were asked for and {kept} are kept: call `keep_history` with more")]
    History {
        /// Steps asked for.
        asked: usize,
        /// Steps kept.
        kept: usize,
    },
}

/// What a snapshot says of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SnapshotHeader {
    /// Version of Sinew that took it.
    pub version: String,
    /// Number type of the state.
    pub precision: Precision,
    /// Instruction set of the kernels.
    pub instruction_set: InstructionSet,
    /// Number of the scene: bodies, meshes, materials and models as they were spawned.
    pub scene: u64,
    /// Steps done.
    pub step: u64,
    /// Simulated time (s).
    pub time: f64,
}

/// A state of a simulation; see the [module](self). Clones share their data.
///
/// ```
/// use sinew::prelude::*;
/// use sinew::engine::mesh::generate::box_tets;
/// use sinew::snapshot::Snapshot;
///
/// let build = || -> Result<Simulation, Box<dyn std::error::Error>> {
///     let mesh = box_tets(DVec3::new(0.2, 0.1, 0.1), [4, 2, 2])?;
///     let mut simulation = Simulation::new(SimulationOptions::default())?;
///     let body = simulation.add_body(&BodyDescription::new("box", &mesh, preset("liver")?.material))?;
///     let wall = simulation.group_rows(body, &mesh, "x0")?;
///     simulation.add_constraint(Constraint::hold("wall", wall));
///     Ok(simulation)
/// };
/// let run = |simulation: &mut Simulation, steps| (0..steps).try_for_each(|_| simulation.step());
/// let mut simulation = build()?;
/// run(&mut simulation, 10)?;
/// let snapshot = simulation.snapshot()?;
/// run(&mut simulation, 10)?;
/// let hash = simulation.state_hash();
/// simulation.restore(&snapshot)?;
/// assert_eq!(simulation.report().cg_iterations, snapshot.report().cg_iterations);
/// run(&mut simulation, 10)?;
/// assert_eq!(simulation.state_hash(), hash);
///
/// // through bytes, into a simulation built anew
/// let mut other = build()?;
/// other.restore(&Snapshot::from_bytes(&snapshot.to_bytes())?)?;
/// run(&mut other, 10)?;
/// assert_eq!(other.state_hash(), hash);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Snapshot {
    header: SnapshotHeader,
    edits: EditState,
    state: State,
    /// It comes from bytes, so nothing in it is certain.
    read: bool,
}

#[derive(Clone, Debug)]
enum State {
    F64(Arc<WorldState<f64>>),
    F32(Arc<WorldState<f32>>),
}

/// What restoring did to entities.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Restored {
    /// Constraints, loads, tools and the like that were no more there, by their [`Order`], and the entities that they are
    /// now. Those that were there keep their entities. [`current`] leads from what they were to what they are.
    pub spawned: Vec<(Order, Entity)>,
}

/// Numbers of entities that were taken away, or may be, after a snapshot brought their like back.
#[derive(Resource, Default)]
struct Before(HashMap<Entity, Order>);

/// What a constraint, load, tool or the like is now that was `entity` once: itself, or what a restored snapshot made of it
/// after it had been taken away.
pub fn current(world: &World, entity: Entity) -> Entity {
    if world.get_entity(entity).is_ok() {
        return entity;
    }
    let order = world.get_resource::<Before>().and_then(|before| before.0.get(&entity));
    let query = world.try_query::<(Entity, &Order)>();
    let (Some(order), Some(mut query)) = (order, query) else { return entity };
    let now = query.iter(world).find(|(_, own)| *own == order);
    now.map_or(entity, |(now, _)| now)
}

/// An entity that acts on bodies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Acting {
    pub order: Order,
    pub constraint: Option<Constraint>,
    pub load: Option<Load>,
    pub faces: Option<LoadedFaces>,
    pub pressure: Option<Pressure>,
    pub removal: Option<RemovalRequest>,
    pub tool: Option<(Tool, ToolReport)>,
    pub edge: Option<EdgeState>,
    pub contact: Option<(BodyContact, BodyContactReport)>,
    pub pull: Option<(Pull, PullReport)>,
    pub thread: Option<(Thread, ThreadReport)>,
    pub clip: Option<(Clip, ThreadReport)>,
    pub tear: Option<(Tear, TearReport)>,
}

/// A padded vector per vertex row.
type Rows<S> = Vec<[S; 4]>;

/// Everything that changes from step to step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(bound = "S: Scalar")]
struct WorldState<S: Scalar> {
    clock: StepClock,
    gravity: Gravity,
    load_time: LoadTime,
    settings: Option<SolverSettings>,
    disabled: Vec<String>,
    displacements: Rows<S>,
    velocities: Rows<S>,
    elastic: Rows<S>,
    external: Rows<S>,
    prescribed: Rows<S>,
    fixed: Vec<FixedAxes>,
    last_order: LastOrder,
    acting: Vec<Acting>,
    /// Their entities when it was taken; unknown where it comes from bytes.
    #[serde(skip)]
    entities: Vec<Entity>,
    solver: SolverMemory<S>,
    contact: Option<ContactMemory>,
    strokes: Option<StrokeMemory>,
    glue: Option<GlueMemory>,
    recovering: Vec<bool>,
    swept: Option<SweptVolumes>,
    activations: Activations,
    activation_work: Option<ActivationWork>,
    report: StepReport,
    volumes: VolumeReport,
    areas: Option<AreaReport>,
    totals: Option<RunTotals>,
}

impl Snapshot {
    /// What it says of itself.
    pub fn header(&self) -> &SnapshotHeader {
        &self.header
    }

    /// Figures of the step that it was taken after.
    pub fn report(&self) -> &StepReport {
        match &self.state {
            State::F64(state) => &state.report,
            State::F32(state) => &state.report,
        }
    }

    /// As bytes, for a file: the same on every machine, with a checksum at their end.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(FORMAT.to_le_bytes());
        add(&mut bytes, &self.header);
        let edits: Vec<&Edit> = self.edits.edits.iter().map(|edit| &**edit).collect();
        add(&mut bytes, &edits);
        match &self.state {
            State::F64(state) => add(&mut bytes, &**state),
            State::F32(state) => add(&mut bytes, &**state),
        }
        bytes.extend(checksum(&bytes).to_le_bytes());
        bytes
    }

    /// Reads what [`Snapshot::to_bytes`] wrote.
    ///
    /// # Errors
    /// When they are anything else, damaged, or of another format.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        let damaged = |what| SnapshotError::Damaged { what };
        let rest = bytes.strip_prefix(MAGIC).ok_or(SnapshotError::NoSnapshot)?;
        let (format, rest) = rest.split_first_chunk().ok_or(damaged("it ends early"))?;
        let (mut rest, sum) = rest.split_last_chunk().ok_or(damaged("it ends early"))?;
        let found = u32::from_le_bytes(*format);
        if found != FORMAT {
            let version = take::<SnapshotHeader>(&mut rest).map(|header| header.version);
            return Err(SnapshotError::Format { found, version: version.unwrap_or("?".into()) });
        }
        if checksum(&bytes[..bytes.len() - 8]) != u64::from_le_bytes(*sum) {
            return Err(damaged("its checksum is wrong"));
        }
        let header: SnapshotHeader = take(&mut rest).ok_or(damaged("its header"))?;
        let edits = take(&mut rest).ok_or(damaged("its list of edits"))?;
        let state = match header.precision {
            Precision::F64 => take(&mut rest).map(|state| State::F64(Arc::new(state))),
            Precision::F32 => take(&mut rest).map(|state| State::F32(Arc::new(state))),
        };
        match state {
            Some(state) if rest.is_empty() => {
                Ok(Self { header, edits: EditState::new(edits), state, read: true })
            }
            _ => Err(damaged("its state")),
        }
    }
}

fn add(bytes: &mut Vec<u8>, value: &impl Serialize) {
    let start = std::mem::take(bytes);
    // nothing that is stored refuses, and there is no end to a vector
    *bytes = postcard::to_extend(value, start).expect("data without maps of unknown length");
}

fn take<T: DeserializeOwned>(bytes: &mut &[u8]) -> Option<T> {
    let (value, rest) = postcard::take_from_bytes(bytes).ok()?;
    *bytes = rest;
    Some(value)
}

/// FNV-1a over words of eight bytes, the last one filled up with zeros: what a snapshot ends with, over all before it.
pub fn checksum(bytes: &[u8]) -> u64 {
    let mut sum = Fnv64::default();
    for chunk in bytes.chunks(8) {
        let mut word = [0; 8];
        word[..chunk.len()].copy_from_slice(chunk);
        sum.add(u64::from_le_bytes(word));
        sum.fold(29);
    }
    sum.0
}

/// The precision and the instruction set of a world that has snapshots.
fn kind(world: &World) -> Result<(Precision, InstructionSet), SnapshotError> {
    if world.get_resource::<Backend>() == Some(&Backend::Gpu) {
        return Err(SnapshotError::Backend);
    }
    let precision = *world.get_resource::<Precision>().ok_or(SnapshotError::NoEngine)?;
    let workers = world.get_resource::<Workers>().ok_or(SnapshotError::NoEngine)?;
    Ok((precision, workers.instruction_set()))
}

/// Takes a snapshot of a world, between steps.
///
/// # Errors
/// When the world has no engine, or keeps its state on a graphics processor.
pub fn take_snapshot(world: &mut World) -> Result<Snapshot, SnapshotError> {
    let (precision, instruction_set) = kind(world)?;
    let clock = *world.resource::<StepClock>();
    let header = SnapshotHeader {
        version: env!("CARGO_PKG_VERSION").into(),
        precision,
        instruction_set,
        scene: by_precision!(precision, scene_hash(world)),
        step: clock.step,
        time: clock.time,
    };
    let edits = EditState::of(world);
    let state = match precision {
        Precision::F64 => State::F64(Arc::new(WorldState::of(world))),
        Precision::F32 => State::F32(Arc::new(WorldState::of(world))),
    };
    Ok(Snapshot { header, edits, state, read: false })
}

/// Takes up a snapshot in the world that it is of, or in one that was built in the same way.
///
/// Constraints, loads, pressures, tools, contacts, pulls and removals asked for are made those of the snapshot: others
/// go, and those that are gone come back as new entities. Settings, gravity and the length of steps come back, too.
///
/// # Errors
/// When the world is of another kind or scene, or the snapshot is damaged; nothing is changed then.
pub fn restore_snapshot(world: &mut World, snapshot: &Snapshot) -> Result<Restored, SnapshotError> {
    let (precision, instruction_set) = kind(world)?;
    let header = &snapshot.header;
    if header.precision != precision {
        return Err(SnapshotError::Precision { snapshot: header.precision, simulation: precision });
    }
    if header.instruction_set != instruction_set {
        return Err(SnapshotError::InstructionSet {
            snapshot: header.instruction_set,
            simulation: instruction_set,
        });
    }
    if header.scene != by_precision!(precision, scene_hash(world)) {
        return Err(SnapshotError::Scene);
    }
    // what was read is only known to fit when it is in its place
    let before = if snapshot.read { Some(take_snapshot(world)?) } else { None };
    let result = match &snapshot.state {
        State::F64(state) => state.restore(world, &snapshot.edits),
        State::F32(state) => state.restore(world, &snapshot.edits),
    };
    match (result, before) {
        (Err(error), Some(before)) => {
            restore_snapshot(world, &before)?;
            Err(error)
        }
        (result, _) => result,
    }
}

impl<S: Scalar> WorldState<S> {
    fn of(world: &mut World) -> Self {
        let mut state = Self::default();
        let mut query = world.query::<(
            &Displacement<S>,
            &Velocity<S>,
            &ElasticForce<S>,
            &ExternalForce<S>,
            &PrescribedDisplacement<S>,
            &FixedAxes,
        )>();
        if let Some((u, v, elastic, external, prescribed, fixed)) =
            single_table(query.contiguous_iter(world))
        {
            state.displacements.extend(u.iter().map(|x| x.0));
            state.velocities.extend(v.iter().map(|x| x.0));
            state.elastic.extend(elastic.iter().map(|x| x.0));
            state.external.extend(external.iter().map(|x| x.0));
            state.prescribed.extend(prescribed.iter().map(|x| x.0));
            state.fixed.extend_from_slice(fixed);
        }
        (state.entities, state.acting) = acting(world).into_iter().unzip();
        state.solver.remember(world);
        state.clock = *world.resource();
        state.gravity = *world.resource();
        state.load_time = *world.resource();
        state.last_order = *world.resource();
        state.settings = world.get_resource().cloned();
        let disabled = world.get_resource::<DisabledLaws>();
        state.disabled = disabled.iter().flat_map(|d| &d.0).map(|law| (*law).into()).collect();
        let step = state.clock.step;
        state.contact = world.get_resource::<ContactSet>().map(|set| set.memory(step).clone());
        state.strokes = world.get_resource().cloned();
        state.glue = world.get_resource().cloned();
        let recovering = world.get_resource::<RecoveringBodies>();
        state.recovering = recovering.map_or_else(Vec::new, |bodies| bodies.0.clone());
        state.swept = world.get_resource().cloned();
        let muscles = world.get_resource::<Muscles>();
        state.activations = muscles.map_or_else(Vec::new, Muscles::memory);
        state.activation_work = world.get_resource().copied();
        state.report = world.resource::<StepReport>().clone();
        state.volumes = world.resource::<VolumeReport>().clone();
        state.areas = world.get_resource().copied();
        state.totals = world.get_resource().cloned();
        state
    }

    /// Whether every part of it belongs to the bodies of a world.
    fn fits(&self, world: &World) -> bool {
        let topology = world.resource::<Topology>();
        let (rows, bodies) = (topology.vertex_count(), topology.bodies.len());
        let fields = [
            &self.displacements,
            &self.velocities,
            &self.elastic,
            &self.external,
            &self.prescribed,
        ];
        let muscles = world.get_resource::<Muscles>().map_or(0, |muscles| muscles.iter().count());
        let whole = |tool: &Tool| {
            tool.parts.iter().all(|part| match &part.shape {
                Shape::Field(field) => field.is_whole(),
                _ => true,
            })
        };
        fields.iter().all(|field| field.len() == rows)
            && self.fixed.len() == rows
            && self.recovering.len() <= bodies
            && self.activations.len() == muscles
            && self.activations.iter().flatten().all(|a| (0.0..=1.0).contains(a))
            && self.acting.is_sorted_by_key(|acting| acting.order)
            && self.acting.iter().all(|acting| acting.order <= Order(self.last_order.0))
            && self.acting.iter().flat_map(|acting| &acting.tool).all(|(tool, _)| whole(tool))
            && self.contact.as_ref().is_none_or(|contact| contact.fits(bodies, rows))
            && self.strokes.as_ref().is_none_or(|strokes| strokes.fits(bodies))
            && self.glue.as_ref().is_none_or(|glue| glue.fits(bodies))
            && self.solver.fits(topology)
    }

    fn restore(&self, world: &mut World, edits: &EditState) -> Result<Restored, SnapshotError> {
        edits.restore::<S>(world)?;
        if !self.fits(world) {
            return Err(SnapshotError::Damaged { what: "parts of it belong to another scene" });
        }
        let restored = self.restore_acting(world);
        let mut query = world.query::<(
            &mut Displacement<S>,
            &mut Velocity<S>,
            &mut ElasticForce<S>,
            &mut ExternalForce<S>,
            &mut PrescribedDisplacement<S>,
            &mut FixedAxes,
        )>();
        if let Some((mut u, mut v, mut elastic, mut external, mut prescribed, mut fixed)) =
            single_table(query.contiguous_iter_mut(world))
        {
            // every look through such a column marks all of its rows as changed
            let (u, v, elastic) = (&mut *u, &mut *v, &mut *elastic);
            let (external, prescribed) = (&mut *external, &mut *prescribed);
            for row in 0..self.fixed.len() {
                u[row].0 = self.displacements[row];
                v[row].0 = self.velocities[row];
                elastic[row].0 = self.elastic[row];
                external[row].0 = self.external[row];
                prescribed[row].0 = self.prescribed[row];
            }
            fixed.copy_from_slice(&self.fixed);
        }
        world.insert_resource(self.clock);
        world.insert_resource(self.gravity);
        world.insert_resource(self.last_order);
        if let Some(settings) = &self.settings {
            world.insert_resource(settings.clone());
        }
        switch_off(world, &self.disabled);
        let has_pressures = self.acting.iter().any(|acting| acting.pressure.is_some());
        if has_pressures || world.contains_resource::<SweptVolumes>() {
            activate_pressure::<S>(world);
        }
        world.insert_resource(self.load_time);
        put(world, self.swept.clone());
        muscle::recall::<S>(world, &self.activations);
        put(world, self.activation_work);
        world.insert_resource(RecoveringBodies(self.recovering.clone()));
        world.insert_resource(self.report.clone());
        world.insert_resource(self.volumes.clone());
        put(world, self.areas);
        put(world, self.totals.clone());
        put(world, self.strokes.clone());
        glue::recall::<S>(world, self.glue.as_ref());
        world.remove_resource::<BladeViews>();
        // the hooks of tools and the like make the set when commands are carried out
        world.flush();
        if self.contact.is_some() || world.contains_resource::<ContactSet>() {
            let memory = self.contact.clone().unwrap_or_default();
            ensure::<ContactSet>(world).recall(&memory);
        }
        world.run_system_cached(write_positions::<S>).expect("engine resources");
        let misfit = SnapshotError::Damaged { what: "its preconditioners belong to another scene" };
        self.solver.recall(world).map_err(|_| misfit)?;
        Ok(restored)
    }

    /// Makes the entities that act on bodies those of the snapshot.
    fn restore_acting(&self, world: &mut World) -> Restored {
        let mut restored = Restored::default();
        let now = acting(world);
        for (entity, own) in &now {
            if self.acting.binary_search_by_key(&own.order, |acting| acting.order).is_err() {
                own.take_away(world, *entity);
            }
        }
        for (at, wanted) in self.acting.iter().enumerate() {
            match now.binary_search_by_key(&wanted.order, |(_, own)| own.order) {
                Ok(own) if now[own].1 == *wanted => {}
                Ok(own) => {
                    let (entity, own) = &now[own];
                    own.take_away_but(world, *entity, wanted);
                    wanted.give(world, *entity);
                }
                Err(_) => {
                    let entity = world.spawn(wanted.order).id();
                    wanted.give(world, entity);
                    restored.spawned.push((wanted.order, entity));
                    let mut before = ensure::<Before>(world);
                    let old = self.entities.get(at).copied();
                    before.0.extend(old.into_iter().chain([entity]).map(|own| (own, wanted.order)));
                }
            }
        }
        restored
    }
}

/// Switches these laws off and no others.
pub(crate) fn switch_off(world: &mut World, names: &[String]) {
    let active = world.get_resource::<ActiveLaws>().map_or(&[][..], |laws| &laws.0);
    let now = world.get_resource::<DisabledLaws>().map_or(&[][..], |laws| &laws.0);
    if !now.iter().eq(names.iter()) {
        let known = |name: &String| active.iter().chain(now).find(|law| *law == name).copied();
        let laws = names.iter().filter_map(known).collect();
        world.insert_resource(DisabledLaws(laws));
    }
}

/// Makes an entity that acts on bodies what it is to be: a new one if there is none of its number, and none if it is
/// nothing.
pub(crate) fn apply_acting(world: &mut World, wanted: &Acting) {
    let now = acting(world);
    let at = now.binary_search_by_key(&wanted.order, |(_, own)| own.order).ok();
    let nothing = Acting { order: wanted.order, ..Acting::default() };
    match at.map(|at| &now[at]) {
        Some((entity, own)) if *wanted == nothing => own.take_away(world, *entity),
        Some((entity, own)) => {
            own.take_away_but(world, *entity, wanted);
            wanted.give(world, *entity);
        }
        None => {
            let entity = world.spawn(wanted.order).id();
            wanted.give(world, entity);
        }
    }
    world.flush();
}

/// Makes a resource what it was, or takes it away.
fn put<R: Resource>(world: &mut World, value: Option<R>) {
    match value {
        Some(value) => world.insert_resource(value),
        None => drop(world.remove_resource::<R>()),
    }
}

/// The entities that act on bodies, in their order.
pub(crate) fn acting(world: &mut World) -> Vec<(Entity, Acting)> {
    let mut query = world.query::<(
        Entity,
        &Order,
        (Option<&Constraint>, Option<&Load>, Option<&LoadedFaces>),
        (Option<&Pressure>, Option<&RemovalRequest>),
        (Option<&Tool>, Option<&ToolReport>, Option<&EdgeState>),
        (Option<&BodyContact>, Option<&BodyContactReport>),
        (Option<&Pull>, Option<&PullReport>),
        (Option<&Thread>, Option<&Clip>, Option<&ThreadReport>),
        (Option<&Tear>, Option<&TearReport>),
    )>();
    let mut found: Vec<(Entity, Acting)> = query
        .iter(world)
        .map(|(entity, order, own, (pressure, removal), tool, contact, pull, line, tear)| {
            let (tool, report, edge) = tool;
            let (thread, clip, of_line) = line;
            let cuts = tool.is_some_and(|tool| tool.edge.is_some() || tool.needle.is_some());
            let (constraint, load, faces) = own;
            let acting = Acting {
                order: *order,
                constraint: constraint.cloned(),
                load: load.cloned(),
                faces: faces.cloned(),
                pressure: pressure.cloned(),
                removal: removal.cloned(),
                tool: both((tool, report)),
                edge: edge.filter(|_| cuts).cloned(),
                contact: both(contact),
                pull: both(pull),
                thread: both((thread, of_line)),
                clip: both((clip, of_line)),
                tear: both(tear),
            };
            (entity, acting)
        })
        .collect();
    found.sort_by_key(|(_, acting)| acting.order);
    found
}

fn both<A: Clone, B: Clone + Default>((a, b): (Option<&A>, Option<&B>)) -> Option<(A, B)> {
    Some((a?.clone(), b.cloned().unwrap_or_default()))
}

impl Acting {
    /// Takes what it is from its entity, and the entity if nothing else is left of it.
    fn take_away(&self, world: &mut World, entity: Entity) {
        self.take_away_but(world, entity, &Self::default());
        let Ok(mut entity) = world.get_entity_mut(entity) else { return };
        entity.remove::<Order>();
        if entity.archetype().components().is_empty() {
            entity.despawn();
        }
    }

    /// Takes what it is, and `other` is not, from its entity.
    fn take_away_but(&self, world: &mut World, entity: Entity, other: &Self) {
        let Ok(mut entity) = world.get_entity_mut(entity) else { return };
        macro_rules! take {
            ($($field:ident: $what:ty),+) => {$(
                if self.$field.is_some() && other.$field.is_none() {
                    entity.remove::<$what>();
                }
            )+};
        }
        take!(
            constraint: Constraint,
            load: Load,
            faces: LoadedFaces,
            pressure: Pressure,
            removal: RemovalRequest,
            tool: (Tool, ToolReport, EdgeState),
            edge: EdgeState,
            contact: (BodyContact, BodyContactReport),
            pull: (Pull, PullReport),
            thread: (Thread, ThreadReport),
            clip: (Clip, ThreadReport),
            tear: (Tear, TearReport)
        );
    }

    /// Gives an entity what it is.
    fn give(&self, world: &mut World, entity: Entity) {
        let Ok(mut entity) = world.get_entity_mut(entity) else { return };
        macro_rules! give {
            ($($field:ident),+) => {$(
                if let Some(value) = self.$field.clone() {
                    entity.insert(value);
                }
            )+};
        }
        give!(
            constraint, load, faces, pressure, removal, tool, edge, contact, pull, thread, clip,
            tear
        );
    }
}

/// The last states of a simulation, for [`Simulation::rollback`].
#[derive(Debug, Default)]
pub(crate) struct History {
    most: usize,
    states: VecDeque<Snapshot>,
}

/// # Going back
impl Simulation {
    /// Everything that the steps to come depend on; see the [module](crate::snapshot).
    ///
    /// # Errors
    /// With [`Backend::Gpu`].
    pub fn snapshot(&mut self) -> Result<Snapshot, SnapshotError> {
        take_snapshot(self.columns())
    }

    /// Takes up a snapshot of this simulation, or of one that was built in the same way.
    ///
    /// # Errors
    /// When the simulation is of another kind or scene, or the snapshot is damaged; nothing is changed then.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<Restored, SnapshotError> {
        restore_snapshot(self.world_mut(), snapshot)
    }

    /// Keeps the states before the last `steps` steps from now on; 0 for none.
    ///
    /// # Errors
    /// With [`Backend::Gpu`].
    pub fn keep_history(&mut self, steps: usize) -> Result<(), SnapshotError> {
        kind(self.world())?;
        let history = self.history_mut();
        history.most = steps;
        let surplus = history.states.len().saturating_sub(steps);
        history.states.drain(..surplus);
        Ok(())
    }

    /// Goes back to the state in which the step was begun that now lies `steps` back: targets and the like that were set
    /// before that step are set.
    ///
    /// # Errors
    /// When fewer steps are kept; see [`Simulation::keep_history`].
    pub fn rollback(&mut self, steps: usize) -> Result<Restored, SnapshotError> {
        let kept = self.history_mut().states.len();
        if steps == 0 || steps > kept {
            return Err(SnapshotError::History { asked: steps, kept });
        }
        let snapshot = self.history_mut().states[kept - steps].clone();
        let restored = self.restore(&snapshot)?;
        self.history_mut().states.truncate(kept - steps);
        Ok(restored)
    }

    /// The state before a step, if it is to be kept.
    pub(crate) fn before_step(&mut self) -> Option<Snapshot> {
        if self.history_mut().most == 0 { None } else { self.snapshot().ok() }
    }

    /// Keeps the state before a step that was made.
    pub(crate) fn push_history(&mut self, before: Snapshot) {
        let history = self.history_mut();
        if history.states.len() == history.most {
            history.states.pop_front();
        }
        history.states.push_back(before);
    }
}
