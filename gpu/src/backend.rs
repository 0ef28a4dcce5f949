//! The integrator of [`StepSystems::Integrate`] that works on the device.
//!
//! Bodies, constraints, loads, report and the columns that others read stay those of the CPU; of the size of the
//! body only what changed since the last step goes up (held vertices, loads, a state set from outside). When the new
//! state comes down is told in `readback.rs`.

use bevy_ecs::change_detection::Tick;
use bevy_ecs::prelude::*;
use bevy_ecs::world::WorldId;
use glam::DVec3;
use sinew_adapter::{AdapterRequest, AdapterSummary, Gpu, open};
use sinew_contact::pair::BodyContact;
use sinew_contact::pull::Pull;
use sinew_contact::thread::{Clip, Thread};
use sinew_contact::tool::Tool;
use sinew_engine::law::BodiesWithoutRecovery;
use sinew_engine::report::{StepReport, SystemTimes, VolumeReport};
use sinew_engine::resource::ensure;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{ActiveLaws, StepSchedule, StepSystems, changed_laws, has_dampers};
use sinew_engine::step::{
    IntegratorInstalled, StepClock, StepError, StepFailure, VolumesReported, not_finite,
};
use sinew_engine::topology::{BodyRows, Topology};
use sinew_models::body::{SoftBody, VolumeRule};
use sinew_solvers::explicit::Caution;
use sinew_solvers::recovery::{BodyShape, BodyState, load_measures};
use sinew_solvers::settings::{Integrator, Preconditioner, SolverSettings};
use sinew_solvers::state::{NodeState, Rows, read_rest, write_displacement, write_state};
use std::ops::Range;
use std::time::Instant;

use crate::body::{BodyParts, DeviceBody, RowSlot, VertexConstants};
use crate::coarse::{Coarse, CoarseParts, KeptInverse};
use crate::context::Context;
use crate::error::GpuError;
use crate::laws;
use crate::recovery::{Decision, Refusal};
use crate::report::{GpuReport, Phase};
use crate::safe::{BodyInput, BodyOutput, SafeStep};

/// How the device is chosen and used.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GpuOptions {
    /// Adapter.
    pub adapter: AdapterRequest,
    /// Largest binding (bytes), if smaller than the adapter's: buffers of elements and matrices are cut to fit.
    pub binding_limit: Option<u64>,
}

/// The device of a world and its bodies there.
#[derive(Resource)]
pub struct GpuBackend {
    pub(crate) context: Context,
    pub(crate) bodies: Vec<Resident>,
    revision: Option<(WorldId, u64)>,
    tick: Option<Tick>,
    /// Rest positions (m) of all rows.
    pub(crate) rest: Vec<DVec3>,
    /// With matrix, with damping, with motions of aggregates: what the bodies were made for.
    made_for: [bool; 3],
    pub(crate) limit: Limit,
    pub(crate) readback: ReadbackState,
}

/// Stability limit of explicit steps, kept as the processor keeps it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Limit {
    /// Largest stable step (s), with the relative change of every squared edge length when it was found.
    pub known: Option<(f64, Vec<f32>)>,
    pub caution: Caution,
}

/// What is known of where the state is.
#[derive(Clone, Debug, Default)]
pub(crate) struct ReadbackState {
    /// The state comes down when somebody asks for it.
    pub on_demand: bool,
    /// The columns are older than the state on the device.
    pub behind: bool,
    /// The device has the volume ratios of all bodies.
    pub volumes: bool,
    /// The device was lost when somebody asked.
    pub lost: Option<GpuError>,
}

/// A body on the device, and what it was last told.
pub(crate) struct Resident {
    pub(crate) body: DeviceBody,
    pub(crate) vertices: Vec<VertexConstants>,
    /// Centre (m) from which its rest positions are counted.
    pub(crate) centre: DVec3,
    /// Displacements and velocities as the host has them.
    pub(crate) state: [Vec<[f32; 4]>; 2],
    pub(crate) target: Vec<[f32; 4]>,
    /// Where held unknowns are since the last implicit step.
    place: Vec<[f32; 4]>,
    pub(crate) load: Vec<[f32; 4]>,
    pub(crate) iterations: u32,
    /// State of the preconditioner.
    pub(crate) kept: Option<KeptInverse>,
    /// How it moves.
    pub(crate) recovery: BodyState,
    /// The device carries along what displacements of the last explicit step could not hold.
    pub(crate) carries_low: bool,
}

impl GpuBackend {
    /// Opens a device.
    ///
    /// # Errors
    /// When no adapter fits.
    pub fn new(options: &GpuOptions) -> Result<Self, GpuError> {
        Ok(Self::with_gpu(open(&options.adapter)?, options.binding_limit))
    }

    /// Uses a device that was opened already.
    pub fn with_gpu(gpu: Gpu, binding_limit: Option<u64>) -> Self {
        Self {
            context: Context::new(gpu, binding_limit),
            bodies: Vec::new(),
            revision: None,
            tick: None,
            rest: Vec::new(),
            made_for: [false; 3],
            limit: Limit::default(),
            readback: ReadbackState::default(),
        }
    }

    /// Whether passes are timed on the device.
    pub fn has_timestamps(&self) -> bool {
        self.context.gpu.timestamps
    }

    /// The device, and the coarse space of a body there; for tests.
    #[doc(hidden)]
    pub fn coarse(&self, body: usize) -> Option<(&Context, &Coarse)> {
        Some((&self.context, self.bodies[body].body.coarse.as_ref()?))
    }

    /// What the adapter is.
    pub fn summary(&self) -> &AdapterSummary {
        &self.context.gpu.summary
    }
}

/// Installs the integrator of the device, in place of `sinew_solvers::install_solver`.
pub fn install_gpu<S: Scalar>(world: &mut World, backend: GpuBackend) {
    ensure::<SolverSettings>(world);
    ensure::<IntegratorInstalled>(world);
    ensure::<GpuReport>(world);
    world.insert_resource(backend);
    world
        .resource_mut::<Schedules>()
        .entry(StepSchedule)
        .add_systems(integrate::<S>.in_set(StepSystems::Integrate));
}

/// Whether every body, law and setting of a world has its place on the device.
///
/// # Errors
/// [`GpuError`] naming the first law and body, integrator or preconditioner that has none.
pub fn check(world: &mut World, settings: &SolverSettings) -> Result<(), GpuError> {
    if !settings.integrator.facts().device {
        let known = Integrator::ALL.iter().filter(|i| i.facts().device);
        let known: Vec<String> = known.map(|i| format!("\"{}\"", i.name())).collect();
        let integrator = settings.integrator.name();
        return Err(GpuError::Integrator { integrator, known: known.join(", ") });
    }
    match settings.preconditioner {
        Preconditioner::Auto | Preconditioner::BlockJacobi | Preconditioner::Multigrid => {}
        other => return Err(GpuError::Preconditioner { preconditioner: other.name() }),
    }
    if settings.integrator.is_explicit()
        && let Some(active) = world.get_resource::<ActiveLaws>()
        && active.0.contains(&laws::pressure::LAW.name())
    {
        let law = format!("{} in explicit substeps", laws::pressure::LAW.name());
        return Err(GpuError::WorldLaw { law });
    }
    let touching = [
        world
            .query::<&Tool>()
            .iter(world)
            .next()
            .map(|tool| format!("contact with tool `{}`", tool.name)),
        world.query::<&BodyContact>().iter(world).next().map(|c| format!("contact `{}`", c.name)),
        world.query::<&Pull>().iter(world).next().map(|pull| format!("pull `{}`", pull.name)),
        world.query::<&Thread>().iter(world).next().map(|own| format!("thread `{}`", own.name)),
        world.query::<&Clip>().iter(world).next().map(|own| format!("clip `{}`", own.name)),
    ];
    if let Some(law) = touching.into_iter().flatten().next() {
        return Err(GpuError::WorldLaw { law });
    }
    let mut bodies = world.query::<&SoftBody>();
    for soft in bodies.iter(world) {
        let rows = world.resource::<Topology>().bodies.get(soft.index);
        if let Some((rows, law)) = rows.zip(missing(soft)) {
            return Err(GpuError::Law { body: rows.name.clone(), law: law.into() });
        }
    }
    if settings.integrator.is_explicit() && has_dampers(world) {
        return Err(GpuError::WorldLaw { law: "axial dampers in explicit substeps".into() });
    }
    if let Some(active) = world.get_resource::<ActiveLaws>()
        && let Some(law) = active.0.iter().find(|law| !laws::is_known(law))
    {
        return Err(GpuError::WorldLaw { law: (*law).into() });
    }
    Ok(())
}

/// What the preconditioner stands for in a body of `vertices` vertices. `"auto"` has two levels from the size on from
/// which it has them on the processor, and inverse diagonal blocks below.
fn preconditioner(settings: &SolverSettings, vertices: u32) -> Preconditioner {
    match settings.preconditioner.resolve(vertices as usize) {
        Preconditioner::Multigrid => Preconditioner::Multigrid,
        _ => Preconditioner::BlockJacobi,
    }
}

/// The first part of a body without a twin on the device.
fn missing(soft: &SoftBody) -> Option<&'static str> {
    (soft.volume == VolumeRule::Clusters).then_some("volume kept by clusters")
}

/// The one system of [`StepSystems::Integrate`].
fn integrate<S: Scalar>(world: &mut World) {
    let start = Instant::now();
    let mut settings = world.resource::<SolverSettings>().clone();
    settings.recovery &= settings.integrator.recovers();
    let mut report = StepReport::default();
    let mut device = GpuReport::default();
    let Some(mut backend) = world.remove_resource::<GpuBackend>() else {
        world.resource_mut::<StepFailure>().0 = Some(StepError::NoIntegrator);
        return;
    };
    let result = settings
        .validate()
        .and_then(|()| check(world, &settings).map_err(refused))
        .and_then(|()| backend.step::<S>(world, &settings, &mut report, &mut device));
    device.adapter = backend.summary().to_string();
    device.software = backend.summary().software();
    if let Some((times, all)) = backend.context.device_times() {
        device.device_seconds = Phase::ALL
            .iter()
            .map(|&phase| {
                let own = times.iter().filter(|(p, _)| *p == phase);
                (phase.name(), own.fold(0.0, |sum, (_, seconds)| sum + seconds))
            })
            .collect();
        device.untimed_passes = !all;
    }
    backend.context.restart_timer();
    (device.bytes_up, device.bytes_down, device.submissions) = backend.context.take_traffic();
    device.waited_seconds = backend.context.take_waited();
    device.host_seconds = start.elapsed().as_secs_f64();
    world.insert_resource(backend);
    world.resource_mut::<StepFailure>().0 = result.err();
    world.insert_resource(report);
    world.insert_resource(device);
    world.resource_mut::<SystemTimes>().add("integrator in all", start.elapsed());
}

pub(crate) fn refused(error: GpuError) -> StepError {
    StepError::Backend { backend: "gpu", reason: error.to_string() }
}

/// The columns as the last step read them; kept, because a large body's would be millions of fresh bytes a step.
#[derive(Resource, Default)]
struct HostColumns<S: Scalar>(NodeState<S>);

/// What the safe steps of all bodies of a world share.
struct StepOfBodies<'a, S: Scalar> {
    world: &'a mut World,
    settings: &'a SolverSettings,
    node: &'a NodeState<S>,
    volumes: &'a VolumeReport,
    /// New displacements and velocities come down.
    read_back: bool,
}

impl GpuBackend {
    /// Bodies on the device, with the displacements in the columns.
    pub(crate) fn prepare<S: Scalar>(&mut self, world: &mut World) -> Result<(), GpuError> {
        check(world, &SolverSettings::default())?;
        self.bring_columns_up_to_date::<S>(world)?;
        let mut node = NodeState::<S>::default();
        node.read(world);
        let needs_matrix = SolverSettings {
            integrator: Integrator::Safe,
            preconditioner: Preconditioner::BlockJacobi,
            ..Default::default()
        };
        self.make_resident::<S>(world, &needs_matrix, &mut GpuReport::default())?;
        self.apply_pressures(world);
        for (resident, body) in self.bodies.iter_mut().zip(&world.resource::<Topology>().bodies) {
            let rows = body.vertices.start as usize..body.vertices.end as usize;
            resident.tell(&self.context, &node, rows, body, false);
        }
        Ok(())
    }

    /// Loads on every body over what its material can hold, where one may begin to recover. By the laws of the
    /// host, whose columns are up to date where elements are inverted.
    fn loads_of_beginners<S: Scalar>(
        &self,
        world: &mut World,
        node: &NodeState<S>,
        shapes: &[BodyShape],
    ) -> Vec<f64> {
        let may_begin = |(shape, body): (&BodyShape, &Resident)| {
            body.recovery == BodyState::Own && shape.is_out_of_shape()
        };
        if !shapes.iter().zip(&self.bodies).any(may_begin) {
            return vec![0.0; shapes.len()];
        }
        let loads = load_measures(world, node, &self.rest);
        write_displacement(world, &node.u);
        loads
    }

    fn step<S: Scalar>(
        &mut self,
        world: &mut World,
        settings: &SolverSettings,
        report: &mut StepReport,
        device: &mut GpuReport,
    ) -> Result<(), StepError> {
        let mut columns = world.remove_resource::<HostColumns<S>>().unwrap_or_default();
        let result = self.step_from(world, settings, &mut columns.0, report, device);
        world.insert_resource(columns);
        result
    }

    fn step_from<S: Scalar>(
        &mut self,
        world: &mut World,
        settings: &SolverSettings,
        node: &mut NodeState<S>,
        report: &mut StepReport,
        device: &mut GpuReport,
    ) -> Result<(), StepError> {
        if let Some(error) = self.readback.lost.take() {
            return Err(refused(error));
        }
        if world.resource::<Topology>().vertex_count() == 0 {
            return Ok(());
        }
        if settings.integrator.is_explicit() {
            self.bring_columns_up_to_date::<S>(world).map_err(refused)?;
        }
        self.make_resident::<S>(world, settings, device).map_err(refused)?;
        self.apply_pressures(world);
        node.read(world);
        let rows: Vec<_> = world
            .resource::<Topology>()
            .bodies
            .iter()
            .map(|b| b.vertices.start as usize..b.vertices.end as usize)
            .collect();
        if settings.integrator.is_explicit() {
            let outputs = self.explicit_steps(world, settings, node, &rows, report)?;
            world.remove_resource::<VolumesReported>();
            device.state_read = true;
            self.accept(world, node, rows, outputs, "accept_explicit");
            return Ok(());
        }
        let volumes = world.resource::<VolumeReport>().clone();
        if self.needs_columns(world, node, &rows, &volumes) {
            self.bring_columns_up_to_date::<S>(world).map_err(refused)?;
            node.read(world);
        }
        let read_back = !(self.readback.on_demand && self.readback.volumes);
        device.state_read = read_back;
        let shapes: Vec<BodyShape> = rows
            .iter()
            .enumerate()
            .map(|(i, rows)| {
                let state = self.bodies[i].recovery;
                BodyShape::of(&volumes, i, state.hold(node, rows.clone()))
            })
            .collect();
        let loads = match settings.recovery {
            true => self.loads_of_beginners(world, node, &shapes),
            false => vec![0.0; rows.len()],
        };
        let mut outputs: Vec<BodyOutput> = Vec::with_capacity(rows.len());
        let mut step =
            StepOfBodies { world: &mut *world, settings, node, volumes: &volumes, read_back };
        for (i, rows) in rows.iter().enumerate() {
            let state = (shapes[i], loads[i]);
            outputs.push(self.safe_step(&mut step, i, rows.clone(), state, report, device)?);
        }
        let work = report.load_work + report.constraint_work;
        report.dissipation += work - report.elastic_energy - report.kinetic_energy;
        self.report_volumes(world, &outputs);
        self.accept(world, node, rows, outputs, "accept");
        Ok(())
    }

    /// The safe step of body `i`, with its shape and the load on it over what its material can hold.
    fn safe_step<S: Scalar>(
        &mut self,
        step: &mut StepOfBodies<'_, S>,
        i: usize,
        rows: Range<usize>,
        (shape, load): (BodyShape, f64),
        report: &mut StepReport,
        device: &mut GpuReport,
    ) -> Result<BodyOutput, StepError> {
        let StepOfBodies { world, settings, node, volumes, read_back } = step;
        let read_back = *read_back;
        let ReadbackState { behind, volumes: volumes_here, .. } = self.readback;
        let inverted = volumes.inverted_by_body.get(i).is_some_and(|&count| count > 0);
        let topology = world.resource::<Topology>();
        let body = &topology.bodies[i];
        let resident = &mut self.bodies[i];
        let elements = &mut resident.body.elements;
        elements.set_stiffness_damping(&self.context, settings.stiffness_damping);
        let moves = resident.tell(&self.context, node, rows.clone(), body, behind);
        let mut own = StepReport::default();
        // nothing that is decided needs it while the columns are behind
        let [kinetic, load_potential] = match behind {
            true => [0.0; 2],
            false => [
                node.kinetic_energy(rows.clone(), &node.v)[0],
                node.load_potential(rows.clone(), &node.u),
            ],
        };
        let decision = Decision {
            index: i,
            topology,
            shape,
            u: &resident.state[0],
            rest: &self.rest[rows.clone()],
            kinetic,
            load_potential,
            load,
        };
        let (context, device_body) = (&self.context, &mut resident.body);
        let on = settings.recovery && !world.resource::<BodiesWithoutRecovery>().contains(i);
        let recovers = decision
            .take(on, context, device_body, &mut resident.recovery, &mut own)
            .map_err(|refusal| match refusal {
                Refusal::Device(error) => refused(error),
                Refusal::Unending(error) => error.of_body(world, i),
            })?;
        let input = BodyInput {
            inverted: inverted || recovers,
            moves,
            free_pieces: free_pieces(body, node, rows.start),
            size: body.size,
            iterations: resident.iterations,
            read_back,
            volumes: volumes_here,
        };
        let step = SafeStep {
            context: &self.context,
            body: &resident.body,
            settings,
            preconditioner: preconditioner(settings, resident.body.n),
            dt: world.resource::<StepClock>().dt,
        };
        let output = step.run(&input, &mut resident.kept, &mut own, device).map_err(refused)?;
        resident.iterations = output.iterations;
        if !output.finite {
            // the device still has the old state; say which vertex, if it can be told
            let bad = |x: &[f32; 4]| x.iter().any(|x| !x.is_finite());
            let row = output.u.iter().position(bad).unwrap_or(0);
            return Err(not_finite(
                world,
                rows.start + row,
                "new displacement",
                "the step was undone; the deformation is beyond the range of f32 or the step too \
                 large: check material and loads, or use a smaller step or the CPU backend",
            ));
        }
        add_angular(&mut own, resident.centre);
        report.add_body(&own);
        Ok(output)
    }

    /// Makes the new state that of the device and of the columns.
    fn accept<S: Scalar>(
        &mut self,
        world: &mut World,
        node: &mut NodeState<S>,
        rows: Vec<Range<usize>>,
        outputs: Vec<BodyOutput>,
        kernel: &'static str,
    ) {
        let (u, v): (&mut Rows<S>, &mut Rows<S>) = (&mut node.u, &mut node.v);
        let read_back = outputs.iter().all(|output| !output.u.is_empty());
        for ((rows, output), resident) in rows.into_iter().zip(outputs).zip(&mut self.bodies) {
            widen(&mut u[rows.clone()], &output.u);
            widen(&mut v[rows], &output.v);
            let mut recorder = self.context.record();
            recorder.pass(Phase::Rows, |pass| resident.body.each_row(pass, kernel));
            recorder.submit();
            if read_back {
                resident.state = [output.u, output.v];
            }
            resident.place.clone_from(&resident.target);
            resident.carries_low = kernel == "accept_explicit";
        }
        if read_back {
            write_state(world, u, v);
        }
        self.mark_columns(world, !read_back);
    }

    /// Uploads bodies that are not there, or no longer what they were.
    fn make_resident<S: Scalar>(
        &mut self,
        world: &mut World,
        settings: &SolverSettings,
        device: &mut GpuReport,
    ) -> Result<(), GpuError> {
        // what is on the device may still serve
        let revision = (world.id(), world.resource::<Topology>().revision);
        let with_matrix = !settings.integrator.is_explicit();
        let two_levels = settings.preconditioner != Preconditioner::BlockJacobi;
        let damped = settings.stiffness_damping > 0.0 || has_dampers(world);
        let made_for = [with_matrix, with_matrix && damped, with_matrix && two_levels];
        let serves = self.made_for.iter().zip(made_for).all(|(&has, needs)| has || !needs);
        let tick = self.tick.filter(|_| serves && self.revision == Some(revision));
        if let Some(changed) = tick.and_then(|tick| changed_laws(world, tick))
            && (changed.is_empty() || self.renew_constants::<S>(world, &changed))
        {
            return Ok(());
        }
        // the bodies that have the state go
        self.bring_columns_up_to_date::<S>(world)?;
        self.revision = None;
        self.made_for = made_for;
        read_rest(world, &mut self.rest);
        let count = world.resource::<Topology>().bodies.len();
        self.bodies.clear();
        self.limit = Limit::default();
        for i in 0..count {
            let topology = world.resource::<Topology>();
            let body = &topology.bodies[i];
            let (first, end) = (body.vertices.start, body.vertices.end);
            let edges = &topology.edges[body.blocks.start as usize..body.blocks.end as usize];
            let edges = edges.iter().map(|edge| edge.map(|row| row - first)).collect();
            let own = &self.rest[first as usize..end as usize];
            let centre = own.iter().sum::<DVec3>() / own.len().max(1) as f64;
            let relative = |x: &DVec3| {
                let x = (*x - centre).as_vec3();
                [x.x, x.y, x.z, 0.0]
            };
            let rest = own.iter().map(relative).collect();
            let piece = body.piece.clone();
            let laws = laws::columns::<S>(world, i, first, |_| true);
            let n = end - first;
            let two_levels =
                made_for[2] && preconditioner(settings, n) == Preconditioner::Multigrid;
            let parts = BodyParts {
                n,
                edges,
                laws: &laws,
                rest,
                with_matrix: made_for[0],
                with_damping: made_for[1],
                coarse: two_levels.then_some(CoarseParts { rest: own, piece: &piece }),
            };
            self.bodies.push(Resident {
                body: self.context.within_memory(|| DeviceBody::new(&self.context, parts))?,
                vertices: Vec::new(),
                centre,
                state: Default::default(),
                target: Vec::new(),
                place: Vec::new(),
                load: Vec::new(),
                iterations: 0,
                kept: None,
                recovery: BodyState::Own,
                carries_low: false,
            });
            device.uploads += 1;
        }
        self.readback.volumes = self.has_all_volumes(world);
        self.revision = Some(revision);
        // what is changed from here on has a later tick
        self.tick = Some(world.increment_change_tick());
        Ok(())
    }
}

impl GpuBackend {
    /// Tells the device the pressures (Pa) of the time whose loads act.
    fn apply_pressures(&mut self, world: &mut World) {
        if self.bodies.iter().any(|resident| resident.body.elements.has_loads()) {
            for (load, value) in laws::pressure::values(world) {
                for resident in &mut self.bodies {
                    resident.body.elements.set_factor(&self.context, load, value as f32);
                }
            }
        }
    }

    /// Uploads the constants of the elements of these laws anew; `false`, with nothing done, where more than
    /// constants may be different.
    fn renew_constants<S: Scalar>(&mut self, world: &mut World, changed: &[&'static str]) -> bool {
        if changed.iter().any(|name| laws::all().all(|law| law.name() != *name)) {
            return false;
        }
        // who reads dampers does not say when they change
        let dampers = laws::all().filter(|law| law.row.is_damper).map(|law| law.name());
        let renewed: Vec<_> = changed.iter().copied().chain(dampers).collect();
        let mut found = Vec::with_capacity(self.bodies.len());
        for (i, resident) in self.bodies.iter().enumerate() {
            let first = world.resource::<Topology>().bodies[i].vertices.start;
            let own = laws::columns::<S>(world, i, first, |law| renewed.contains(&law.name()));
            if !resident.body.elements.serve(&renewed, &own) {
                return false;
            }
            found.push(own);
        }
        for (resident, own) in self.bodies.iter().zip(&found) {
            resident.body.elements.write(&self.context, own);
        }
        self.limit = Limit::default();
        self.tick = Some(world.increment_change_tick());
        true
    }
}

impl Resident {
    /// Brings the device up to date with the columns; whether held unknowns have a way to go. With columns that are
    /// `behind` the device, displacements and velocities are left alone.
    pub(crate) fn tell<S: Scalar>(
        &mut self,
        context: &Context,
        node: &NodeState<S>,
        rows: Range<usize>,
        body: &BodyRows,
        behind: bool,
    ) -> bool {
        let narrow = |x: &[S; 4]| x.map(|x| x.to_f64() as f32);
        let loaded = &self.body.elements.loaded_rows;
        if renew(&mut self.vertices, vertex_constants(node, rows.clone(), body, loaded)) {
            self.body.write_vertices(context, &self.vertices);
            self.kept = None;
        }
        let device = &self.body;
        let refresh = |slot, known: &mut Vec<[f32; 4]>, now: &[[S; 4]]| {
            let changed = renew(known, now.iter().map(narrow));
            if changed {
                device.write_rows(context, slot, known);
            }
            changed
        };
        if !behind {
            let [u, v] = &mut self.state;
            self.carries_low &= !refresh(RowSlot::U, u, &node.u[rows.clone()]);
            refresh(RowSlot::V, v, &node.v[rows.clone()]);
        }
        refresh(RowSlot::Load, &mut self.load, &node.external[rows.clone()]);
        // free unknowns have no target: theirs is the displacement, so that it does not change with it
        let mut moves = false;
        let place = &self.place;
        let targets = rows.zip(&self.vertices).enumerate().map(|(local, (row, vertex))| {
            let mut own = [0.0; 4];
            for k in (0..3).filter(|k| vertex.held >> k & 1 == 1) {
                let is = if behind { place[local][k] } else { node.u[row][k].to_f64() as f32 };
                let massless = !node.fixed[row].holds(k);
                own[k] = if massless { is } else { node.prescribed[row][k].to_f64() as f32 };
                moves |= own[k] != is;
            }
            own
        });
        if renew(&mut self.target, targets) {
            device.write_rows(context, RowSlot::Target, &self.target);
        }
        moves
    }
}

/// Puts numbers in the place of others without asking for memory; whether any is different.
fn renew<T: PartialEq>(known: &mut Vec<T>, now: impl ExactSizeIterator<Item = T>) -> bool {
    if known.len() != now.len() {
        known.clear();
        known.extend(now);
        return true;
    }
    let mut changed = false;
    for (known, now) in known.iter_mut().zip(now) {
        if *known != now {
            *known = now;
            changed = true;
        }
    }
    changed
}

/// What the device has to know of the vertices of a body; pressure acts on the rows `loaded`, which ascend.
pub(crate) fn vertex_constants<'a, S: Scalar>(
    node: &'a NodeState<S>,
    rows: Range<usize>,
    body: &'a BodyRows,
    loaded: &'a [u32],
) -> impl ExactSizeIterator<Item = VertexConstants> + 'a {
    let mut loaded = loaded.iter().peekable();
    rows.zip(&body.piece).enumerate().map(move |(local, (row, &piece))| VertexConstants {
        mass: node.mass[row].to_f64() as f32,
        // without mass and element nothing says where it should go
        held: if node.mass[row] == S::ZERO { 7 } else { u32::from(node.fixed[row].0) },
        piece,
        loaded: u32::from(loaded.next_if(|&&own| own as usize == local).is_some()),
    })
}

/// Rows of the device in the number type of the columns.
pub(crate) fn widen<S: Scalar>(to: &mut [[S; 4]], from: &[[f32; 4]]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = from.map(|x| S::from_f64(f64::from(x)));
    }
}

/// Pieces of a body without held unknowns, and their masses (kg).
fn free_pieces<S: Scalar>(body: &BodyRows, node: &NodeState<S>, first: usize) -> Vec<(u32, f64)> {
    let mut pieces = vec![Some(0.0); body.piece_count()];
    for (row, &piece) in (first..).zip(&body.piece) {
        // vertices without elements belong to no piece
        let Some(mass) = pieces.get_mut(piece as usize) else { continue };
        *mass = mass.filter(|_| node.fixed[row].0 == 0).map(|m| m + node.mass[row].to_f64());
    }
    (0..).zip(pieces).filter_map(|(piece, mass)| Some((piece, mass?))).collect()
}

/// Angular momentum about the origin from that about the centre at rest.
pub(crate) fn add_angular(report: &mut StepReport, centre: DVec3) {
    let about = centre.cross(DVec3::from(report.momentum));
    report.angular_momentum = (DVec3::from(report.angular_momentum) + about).to_array();
}
