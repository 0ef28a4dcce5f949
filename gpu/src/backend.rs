//! The integrator of [`StepSystems::Integrate`] that works on the device.
//!
//! Bodies, constraints, loads, report and the columns that others read stay those of the CPU; of the size of the
//! body only what changed since the last step goes up (held vertices, loads, a state set from outside), and the new
//! state comes down, 32 bytes a vertex, since volume ratios, positions and probes are read from the columns.

use bevy_ecs::change_detection::Tick;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_adapter::{AdapterRequest, AdapterSummary, Gpu, open};
use sinew_engine::law::TangentKind;
use sinew_engine::report::{StepReport, SystemTimes, VolumeReport};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{ActiveLaws, StepSchedule, StepSystems, law_inputs_unchanged};
use sinew_engine::step::{IntegratorInstalled, StepClock, StepError, StepFailure, not_finite};
use sinew_engine::substep::WithinStep;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_models::body::{Evaluation, Model, SoftBody};
use sinew_solvers::explicit::estimate_stable_step;
use sinew_solvers::settings::{Integrator, Preconditioner, SolverSettings};
use sinew_solvers::state::{NodeState, Rows, read_rest, write_state};
use std::ops::Range;
use std::time::Instant;

use crate::body::{BodyParts, DeviceBody, Slot, StepUniform, VertexConstants, total};
use crate::context::Context;
use crate::error::GpuError;
use crate::explicit::ExplicitStep;
use crate::laws::{self, LAWS};
use crate::recovery::{Decision, elastic_energy};
use crate::report::{GpuReport, Phase};
use crate::safe::{BodyInput, BodyOutput, SafeStep};

/// Integrators that run on the device, for messages.
const INTEGRATORS: &str = "\"safe\" (also \"auto\"), \"symplectic-euler\" or \"stormer-verlet\"";

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
    context: Context,
    bodies: Vec<Resident>,
    revision: Option<u64>,
    tick: Option<Tick>,
    /// Rest positions (m) of all rows.
    rest: Vec<DVec3>,
    /// With matrix, with damping: what the bodies were made for.
    made_for: [bool; 2],
    limit: Limit,
}

/// Stability limit of explicit steps, kept as the processor keeps it.
#[derive(Clone, Debug)]
struct Limit {
    /// Largest stable step (s), with the relative change of every squared edge length when it was found.
    known: Option<(f64, Vec<f32>)>,
    /// Factor on it, lowered when energy grows.
    caution: f64,
    /// Energy (J) that came from nowhere.
    creep: f64,
}

impl Default for Limit {
    fn default() -> Self {
        Self { known: None, caution: 1.0, creep: 0.0 }
    }
}

/// Change of a squared edge length over that at rest at which the limit is renewed, as on the CPU.
const STRAIN_CHANGE: f32 = 0.2;
/// Doublings of the substep count before a step is given up, as on the CPU.
const MAX_REFINEMENTS: u32 = 6;
/// Growth of the energy over many steps that lowers the limit, and by what, as on the CPU.
const CREEP: f64 = 0.25;
const CAUTION: [f64; 2] = [0.8, 0.25];

/// A body on the device, and what it was last told.
struct Resident {
    body: DeviceBody,
    vertices: Vec<VertexConstants>,
    /// Centre (m) from which its rest positions are counted.
    centre: DVec3,
    /// Displacements and velocities as the host has them.
    state: [Vec<[f32; 4]>; 2],
    target: Vec<[f32; 4]>,
    load: Vec<[f32; 4]>,
    iterations: u32,
    /// Energy (J) when recovery from inversion began.
    recovery: Option<f64>,
    /// The device carries along what displacements of the last explicit step could not hold.
    carries_low: bool,
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
            made_for: [false; 2],
            limit: Limit::default(),
        }
    }

    /// Whether passes are timed on the device.
    pub fn has_timestamps(&self) -> bool {
        self.context.gpu.timestamps
    }

    /// What the adapter is.
    pub fn summary(&self) -> &AdapterSummary {
        &self.context.gpu.summary
    }
}

/// Energies and forces as the device has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceEvaluation {
    /// Elastic energy of every body (J).
    pub energies: Vec<f64>,
    /// Elastic force on every vertex row (N); fourth entry padding.
    pub forces: Vec<[f32; 4]>,
}

/// Times of force passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceTiming {
    /// Passes in the times.
    pub passes: u32,
    /// Time (s) on the device, if it can be told.
    pub device_seconds: Option<f64>,
    /// Time (s) as the host sees it, from recording to the end.
    pub host_seconds: f64,
    /// Bytes that one pass has to move at least, every list and column once.
    pub bytes: u64,
}

/// Installs the integrator of the device, in place of `sinew_solvers::install_solver`.
pub fn install_gpu<S: Scalar>(world: &mut World, backend: GpuBackend) {
    world.init_resource::<SolverSettings>();
    world.init_resource::<IntegratorInstalled>();
    world.init_resource::<GpuReport>();
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
    match settings.integrator {
        Integrator::Auto
        | Integrator::Safe
        | Integrator::SymplecticEuler
        | Integrator::StormerVerlet => {}
        other => {
            return Err(GpuError::Integrator { integrator: other.name(), known: INTEGRATORS });
        }
    }
    match settings.preconditioner {
        Preconditioner::Auto | Preconditioner::BlockJacobi => {}
        other => return Err(GpuError::Preconditioner { preconditioner: other.name() }),
    }
    let mut bodies = world.query::<&SoftBody>();
    for soft in bodies.iter(world) {
        let rows = world.resource::<Topology>().bodies.get(soft.index);
        if let Some((rows, law)) = rows.and_then(|rows| Some((rows, missing(soft, rows)?))) {
            return Err(GpuError::Law { body: rows.name.clone(), law });
        }
    }
    if let Some(active) = world.get_resource::<ActiveLaws>()
        && let Some(law) = active.0.iter().find(|law| LAWS.iter().all(|known| known.name != **law))
    {
        return Err(GpuError::WorldLaw { law: (*law).into() });
    }
    Ok(())
}

/// The first part of a body without a twin on the device.
fn missing(soft: &SoftBody, rows: &BodyRows) -> Option<String> {
    if soft.membrane.is_some() {
        return Some("membrane".into());
    }
    if soft.axes.is_some() {
        return Some("axes of anisotropy".into());
    }
    if !rows.hexahedra.is_empty() && soft.model != Model::MassSpring {
        return Some(format!("{} of hexahedra", soft.model.name()));
    }
    if soft.evaluation == Evaluation::Pooled {
        return Some(format!("{} pooled", soft.model.name()));
    }
    matches!(soft.model, Model::Axes).then(|| soft.model.name().into())
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
                (phase.name(), own.map(|(_, seconds)| seconds).sum())
            })
            .collect();
        device.untimed_passes = !all;
    }
    backend.context.restart_timer();
    (device.bytes_up, device.bytes_down, device.submissions) = backend.context.take_traffic();
    device.host_seconds = start.elapsed().as_secs_f64();
    world.insert_resource(backend);
    world.resource_mut::<StepFailure>().0 = result.err();
    world.insert_resource(report);
    world.insert_resource(device);
    world.resource_mut::<SystemTimes>().add("integrator in all", start.elapsed());
}

fn refused(error: GpuError) -> StepError {
    StepError::Backend { backend: "gpu", reason: error.to_string() }
}

impl GpuBackend {
    /// Elastic energies (J) and forces (N) at the displacements in the columns.
    ///
    /// # Errors
    /// When a law has no twin on the device, or the device gives up.
    pub fn evaluate<S: Scalar>(&mut self, world: &mut World) -> Result<DeviceEvaluation, GpuError> {
        self.prepare::<S>(world)?;
        let mut result = DeviceEvaluation::default();
        for resident in &self.bodies {
            let (context, body) = (&self.context, &resident.body);
            body.set(context, StepUniform::default());
            let mut recorder = context.record();
            recorder.pass(Phase::Rows, |pass| body.each_row(context, pass, "look_back"));
            body.energies(context, &mut recorder);
            body.forces(context, &mut recorder);
            let energies = body.read_energies(&mut recorder);
            let forces = body.read_rows(&mut recorder, Slot::Force);
            recorder.submit();
            let energies = energies.wait::<[f32; 4]>(context)?;
            result.energies.push(total(&energies, 1, 0, 0));
            result.forces.extend(forces.wait::<[f32; 4]>(context)?);
        }
        self.context.restart_timer();
        Ok(result)
    }

    /// Product (N when `direction` is in m) of the tangent at the displacements in the columns with one row
    /// per vertex row.
    ///
    /// # Errors
    /// As [`evaluate`](Self::evaluate).
    pub fn multiply<S: Scalar>(
        &mut self,
        world: &mut World,
        kind: TangentKind,
        direction: &[[f32; 4]],
    ) -> Result<Vec<[f32; 4]>, GpuError> {
        self.prepare::<S>(world)?;
        let mut result = Vec::with_capacity(direction.len());
        for resident in &self.bodies {
            let (context, body) = (&self.context, &resident.body);
            let kind = match kind {
                TangentKind::Exact => 0,
                TangentKind::GaussNewton => 1,
                TangentKind::Projected => 2,
            };
            body.set(context, StepUniform { kind, ..StepUniform::default() });
            let rows = result.len()..result.len() + body.n as usize;
            body.write_rows(context, Slot::P, &direction[rows]);
            let mut recorder = context.record();
            recorder.pass(Phase::Rows, |pass| body.each_row(context, pass, "look_back"));
            body.tangent(context, &mut recorder, false);
            recorder.pass(Phase::Solve, |pass| {
                body.product(context, pass, "product_plain", false);
            });
            let product = body.read_rows(&mut recorder, Slot::Q);
            recorder.submit();
            result.extend(product.wait::<[f32; 4]>(context)?);
        }
        self.context.restart_timer();
        Ok(result)
    }

    /// Times force passes (elements and gather) at the displacements in the columns, `repeats` of them in one
    /// submission, energies left out.
    ///
    /// # Errors
    /// As [`evaluate`](Self::evaluate).
    pub fn time_forces<S: Scalar>(
        &mut self,
        world: &mut World,
        repeats: u32,
    ) -> Result<ForceTiming, GpuError> {
        self.prepare::<S>(world)?;
        let context = &self.context;
        let mut timing = ForceTiming { passes: repeats, ..ForceTiming::default() };
        for resident in &self.bodies {
            let body = &resident.body;
            body.set(context, StepUniform::default());
            // pipelines compiled, displacements in place
            let mut recorder = context.record();
            recorder.pass(Phase::Rows, |pass| body.each_row(context, pass, "look_back"));
            body.forces(context, &mut recorder);
            let ready = body.read_sums(&mut recorder, 1);
            recorder.submit();
            ready.wait::<[f32; 4]>(context)?;
            context.restart_timer();
            let start = Instant::now();
            let mut recorder = context.record();
            for _ in 0..repeats {
                body.forces(context, &mut recorder);
            }
            let done = body.read_sums(&mut recorder, 1);
            recorder.submit();
            done.wait::<[f32; 4]>(context)?;
            timing.host_seconds += start.elapsed().as_secs_f64();
            let timed = context.device_times().filter(|(_, all)| *all);
            let device =
                timed.map(|(times, _)| times.iter().map(|(_, seconds)| seconds).sum::<f64>());
            timing.device_seconds = match (timing.device_seconds, device) {
                (sum, Some(device)) => Some(sum.unwrap_or(0.0) + device),
                (_, None) => None,
            };
            timing.bytes += body.force_bytes();
            context.restart_timer();
        }
        Ok(timing)
    }

    /// Bandwidth (bytes/s, read and written) of copies between two buffers on the device, as the host sees it.
    ///
    /// # Errors
    /// When the device gives up.
    pub fn copy_bandwidth(&self) -> Result<f64, GpuError> {
        const COPIES: u32 = 16;
        let context = &self.context;
        let bytes = context.binding_limit.min(64 << 20).next_multiple_of(16);
        let [from, to] = ["from", "to"].map(|label| context.storage(label, bytes));
        let run = |copies: u32| {
            let start = Instant::now();
            let mut recorder = context.record();
            for _ in 0..copies {
                recorder.encoder.copy_buffer_to_buffer(&from, 0, &to, 0, bytes);
            }
            let done = recorder.read(&to, 0, 16);
            recorder.submit();
            done.wait::<[f32; 4]>(context)?;
            Ok::<_, GpuError>(start.elapsed().as_secs_f64())
        };
        run(1)?;
        Ok(2.0 * f64::from(COPIES) * bytes as f64 / run(COPIES)?)
    }

    /// Bodies on the device, with the displacements in the columns.
    fn prepare<S: Scalar>(&mut self, world: &mut World) -> Result<(), GpuError> {
        check(world, &SolverSettings::default())?;
        let mut node = NodeState::<S>::default();
        node.read(world);
        let needs_matrix = SolverSettings { integrator: Integrator::Safe, ..Default::default() };
        self.make_resident::<S>(world, &needs_matrix, &mut GpuReport::default())?;
        for (resident, body) in self.bodies.iter_mut().zip(&world.resource::<Topology>().bodies) {
            let rows = body.vertices.start as usize..body.vertices.end as usize;
            resident.tell(&self.context, &node, rows, body);
        }
        Ok(())
    }

    fn step<S: Scalar>(
        &mut self,
        world: &mut World,
        settings: &SolverSettings,
        report: &mut StepReport,
        device: &mut GpuReport,
    ) -> Result<(), StepError> {
        let mut node = NodeState::<S>::default();
        node.read(world);
        if node.is_empty() {
            return Ok(());
        }
        self.make_resident::<S>(world, settings, device).map_err(refused)?;
        let dt = world.resource::<StepClock>().dt;
        let rows: Vec<_> = world
            .resource::<Topology>()
            .bodies
            .iter()
            .map(|b| b.vertices.start as usize..b.vertices.end as usize)
            .collect();
        if settings.integrator.is_explicit() {
            let outputs = self.explicit_steps(world, settings, &node, &rows, report)?;
            self.accept(world, node, rows, outputs, "accept_explicit");
            return Ok(());
        }
        let volumes = world.resource::<VolumeReport>().clone();
        let mut outputs: Vec<BodyOutput> = Vec::with_capacity(rows.len());
        for (i, rows) in rows.iter().enumerate() {
            let inverted = volumes.inverted_by_body.get(i).is_some_and(|&count| count > 0);
            let topology = world.resource::<Topology>();
            let body = &topology.bodies[i];
            let resident = &mut self.bodies[i];
            let moves = resident.tell(&self.context, &node, rows.clone(), body);
            let mut own = StepReport::default();
            let free = node.kinetic_energy(rows.clone(), &node.v)[0];
            let decision = Decision {
                index: i,
                topology,
                volumes: &volumes,
                u: &resident.state[0],
                rest: &self.rest[rows.clone()],
                other: free - node.load_potential(rows.clone(), &node.u),
            };
            let (context, device_body) = (&self.context, &mut resident.body);
            let recovers = decision
                .take(settings.recovery, context, device_body, &mut resident.recovery, &mut own)
                .map_err(refused)?;
            let input = BodyInput {
                inverted: inverted || recovers,
                moves,
                free_pieces: free_pieces(body, &node, rows.start),
                size: body.size,
                iterations: resident.iterations,
            };
            let step = SafeStep { context: &self.context, body: &resident.body, settings, dt };
            let output = step.run(&input, &mut own, device).map_err(refused)?;
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
            add(report, &own);
            outputs.push(output);
        }
        let work = report.load_work + report.constraint_work;
        report.dissipation += work - report.elastic_energy - report.kinetic_energy;
        report.preconditioner = Preconditioner::BlockJacobi.name();

        self.accept(world, node, rows, outputs, "accept");
        Ok(())
    }

    /// Makes the new state that of the device and of the columns.
    fn accept<S: Scalar>(
        &mut self,
        world: &mut World,
        node: NodeState<S>,
        rows: Vec<Range<usize>>,
        outputs: Vec<BodyOutput>,
        kernel: &'static str,
    ) {
        let (mut u, mut v): (Rows<S>, Rows<S>) = (node.u, node.v);
        for ((rows, output), resident) in rows.into_iter().zip(outputs).zip(&mut self.bodies) {
            let wide = |x: &[f32; 4]| x.map(|x| S::from_f64(f64::from(x)));
            let old = u[rows.clone()].iter_mut().zip(&mut v[rows]);
            for ((u, v), (new_u, new_v)) in old.zip(output.u.iter().zip(&output.v)) {
                (*u, *v) = (wide(new_u), wide(new_v));
            }
            let mut recorder = self.context.record();
            recorder.pass(Phase::Rows, |pass| resident.body.each_row(&self.context, pass, kernel));
            recorder.submit();
            resident.state = [output.u, output.v];
            resident.carries_low = kernel == "accept_explicit";
        }
        write_state(world, &u, &v);
    }

    /// Explicit substeps of all bodies, not yet accepted.
    fn explicit_steps<S: Scalar>(
        &mut self,
        world: &mut World,
        settings: &SolverSettings,
        node: &NodeState<S>,
        rows: &[Range<usize>],
        report: &mut StepReport,
    ) -> Result<Vec<BodyOutput>, StepError> {
        let clock = *world.resource::<StepClock>();
        let mut within = WithinStep::default();
        within.read(world, &node.u, &node.prescribed, &node.fixed);
        for (i, rows) in rows.iter().enumerate() {
            let body = &world.resource::<Topology>().bodies[i];
            let resident = &mut self.bodies[i];
            let known = resident.vertices.clone();
            resident.tell(&self.context, node, rows.clone(), body);
            if known != resident.vertices {
                self.limit.known = None;
            }
        }
        let limit = self.stable_step::<S>(world, rows);
        report.stable_step = limit;
        let diverged = |reason| StepError::Diverged { step: clock.step, time: clock.time, reason };
        let refuse = |needed: f64| {
            diverged(format!(
                "an explicit step of {} s needs {needed:.0} substeps (stability limit {limit:.3e} s), more \
                 than max_substeps = {}; reduce dt, raise max_substeps or use integrator = \"safe\"",
                clock.dt, settings.max_substeps
            ))
        };
        let needed =
            (clock.dt / (limit * self.limit.caution * settings.explicit_safety)).ceil().max(1.0);
        if needed > f64::from(settings.max_substeps) {
            return Err(refuse(needed));
        }
        let mut outputs = Vec::with_capacity(rows.len());
        let (mut grown, mut scale, mut refined) = (0.0, 0.0, false);
        for (i, rows) in rows.iter().enumerate() {
            let resident = &mut self.bodies[i];
            let context = &self.context;
            if !resident.carries_low {
                let mut recorder = context.record();
                recorder
                    .pass(Phase::Rows, |pass| resident.body.each_row(context, pass, "forget_low"));
                recorder.submit();
            }
            let elastic = elastic_energy(context, &resident.body).map_err(refused)?;
            let [kinetic, held] = node.kinetic_energy(rows.clone(), &node.v);
            let now: Vec<_> = resident.state[0].clone();
            let step = ExplicitStep {
                context,
                body: &resident.body,
                settings,
                dt: clock.dt,
                rows: rows.clone(),
                load: &resident.load,
                place: [&now, &resident.target],
                before: [elastic, kinetic, held],
            };
            let mut substeps = needed as u32;
            let mut refinements = 0;
            let mut own = StepReport { evaluations: 1, ..StepReport::default() };
            let (output, growth) = loop {
                let found = step.attempt(substeps, &mut within, &mut own).map_err(refused)?;
                if let Some(found) = found {
                    break found;
                }
                substeps = substeps.saturating_mul(2);
                refinements += 1;
                if refinements > MAX_REFINEMENTS || substeps > settings.max_substeps {
                    self.limit.known = None;
                    return Err(diverged(format!(
                        "the energy grew, or a number overflowed, even with {} substeps (estimated \
                         stability limit {limit:.3e} s); check loads and prescribed motion, reduce dt or use \
                         integrator = \"safe\"",
                        substeps / 2
                    )));
                }
            };
            // the device has places between start and end in that slot
            resident.target.clear();
            refined |= refinements > 0;
            grown += growth[0];
            scale += growth[1];
            own.substeps = substeps;
            own.refinements = refinements;
            add_angular(&mut own, resident.centre);
            add(report, &own);
            outputs.push(output);
        }
        self.limit.creep = (self.limit.creep + grown).max(0.0);
        if refined || self.limit.creep > CREEP * scale {
            // the limit was too optimistic
            let caution = (self.limit.caution * CAUTION[0]).max(CAUTION[1]);
            self.limit = Limit { known: None, caution, creep: 0.0 };
        }
        Ok(outputs)
    }

    /// Largest stable explicit step (s), estimated on the processor, where an edge has changed enough.
    fn stable_step<S: Scalar>(&mut self, world: &mut World, rows: &[Range<usize>]) -> f64 {
        let topology = world.resource::<Topology>();
        let mut strain = Vec::with_capacity(topology.edges.len());
        for ((resident, rows), body) in self.bodies.iter().zip(rows).zip(&topology.bodies) {
            let blocks = body.blocks.start as usize..body.blocks.end as usize;
            let u = &resident.state[0];
            strain.extend(topology.edges[blocks].iter().map(|edge| {
                let [a, b] = edge.map(|row| row as usize);
                let way = (self.rest[a] - self.rest[b]).as_vec3();
                let [c, d] = [u[a - rows.start], u[b - rows.start]];
                let moved = glam::Vec3::new(c[0] - d[0], c[1] - d[1], c[2] - d[2]);
                moved.dot(2.0 * way + moved) / way.length_squared()
            }));
        }
        if let Some((limit, before)) = &self.limit.known {
            let apart = before.iter().zip(&strain).all(|(a, b)| (a - b).abs() <= STRAIN_CHANGE);
            if apart && before.len() == strain.len() {
                return *limit;
            }
        }
        let limit = estimate_stable_step::<S>(world);
        self.limit.known = Some((limit, strain));
        limit
    }

    /// Uploads bodies that are not there, or no longer what they were.
    fn make_resident<S: Scalar>(
        &mut self,
        world: &mut World,
        settings: &SolverSettings,
        device: &mut GpuReport,
    ) -> Result<(), GpuError> {
        let revision = world.resource::<Topology>().revision;
        let with_matrix = !settings.integrator.is_explicit();
        let made_for = [with_matrix, with_matrix && settings.stiffness_damping > 0.0];
        let serves = self.made_for.iter().zip(made_for).all(|(&has, needs)| has || !needs);
        let same = serves
            && self.revision == Some(revision)
            && self.tick.is_some_and(|tick| law_inputs_unchanged(world, tick));
        if same {
            return Ok(());
        }
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
            let laws = laws::columns::<S>(world, i, first);
            let parts = BodyParts {
                n: end - first,
                edges,
                laws: &laws,
                rest,
                with_matrix: made_for[0],
                with_damping: made_for[1],
            };
            self.bodies.push(Resident {
                body: self.context.within_memory(|| DeviceBody::new(&self.context, parts))?,
                vertices: Vec::new(),
                centre,
                state: Default::default(),
                target: Vec::new(),
                load: Vec::new(),
                iterations: 0,
                recovery: None,
                carries_low: false,
            });
            device.uploads += 1;
        }
        self.revision = Some(revision);
        // what is changed from here on has a later tick
        self.tick = Some(world.increment_change_tick());
        Ok(())
    }
}

impl Resident {
    /// Brings the device up to date with the columns; whether held unknowns have a way to go.
    fn tell<S: Scalar>(
        &mut self,
        context: &Context,
        node: &NodeState<S>,
        rows: std::ops::Range<usize>,
        body: &BodyRows,
    ) -> bool {
        let narrow = |x: &[S; 4]| x.map(|x| x.to_f64() as f32);
        let vertices: Vec<_> = rows
            .clone()
            .zip(&body.piece)
            .map(|(row, &piece)| VertexConstants {
                mass: node.mass[row].to_f64() as f32,
                // without mass and element nothing says where it should go
                held: if node.mass[row] == S::ZERO { 7 } else { u32::from(node.fixed[row].0) },
                piece,
                padding: 0,
            })
            .collect();
        if vertices != self.vertices {
            self.body.write_vertices(context, &vertices);
            self.vertices = vertices;
        }
        let refresh = |slot, known: &mut Vec<[f32; 4]>, now: Vec<[f32; 4]>| {
            if *known != now {
                self.body.write_rows(context, slot, &now);
                *known = now;
            }
        };
        let [u, v] = &mut self.state;
        let before = u.clone();
        refresh(Slot::U, u, node.u[rows.clone()].iter().map(narrow).collect());
        self.carries_low &= before == *u;
        refresh(Slot::V, v, node.v[rows.clone()].iter().map(narrow).collect());
        refresh(
            Slot::Load,
            &mut self.load,
            node.external[rows.clone()].iter().map(narrow).collect(),
        );
        // free unknowns have no target: theirs is the displacement, so that it does not change with it
        let mut moves = false;
        let mut target = Vec::with_capacity(rows.len());
        for (row, vertex) in rows.zip(&self.vertices) {
            let mut own = [0.0; 4];
            for k in (0..3).filter(|k| vertex.held >> k & 1 == 1) {
                let massless = !node.fixed[row].holds(k);
                let at = if massless { node.u[row][k] } else { node.prescribed[row][k] };
                own[k] = at.to_f64() as f32;
                moves |= own[k] != node.u[row][k].to_f64() as f32;
            }
            target.push(own);
        }
        refresh(Slot::Target, &mut self.target, target);
        moves
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
fn add_angular(report: &mut StepReport, centre: DVec3) {
    let about = centre.cross(DVec3::from(report.momentum));
    report.angular_momentum = (DVec3::from(report.angular_momentum) + about).to_array();
}

/// Adds the figures of one body to those of the step.
fn add(sum: &mut StepReport, own: &StepReport) {
    sum.newton_iterations = sum.newton_iterations.max(own.newton_iterations);
    sum.cg_iterations += own.cg_iterations;
    sum.cg_caps += own.cg_caps;
    sum.cg_residual = sum.cg_residual.max(own.cg_residual);
    sum.newton_step = sum.newton_step.max(own.newton_step);
    sum.projections += own.projections;
    sum.backtracks += own.backtracks;
    sum.gradient_fallbacks += own.gradient_fallbacks;
    sum.line_search_failures += own.line_search_failures;
    sum.energy_caps += own.energy_caps;
    sum.linearisation_error = sum.linearisation_error.max(own.linearisation_error);
    sum.elastic_energy += own.elastic_energy;
    sum.kinetic_energy += own.kinetic_energy;
    sum.load_work += own.load_work;
    sum.constraint_work += own.constraint_work;
    sum.dissipation += own.dissipation;
    sum.damping_dissipation += own.damping_dissipation;
    sum.evaluations += own.evaluations;
    sum.substeps = sum.substeps.max(own.substeps);
    sum.refinements = sum.refinements.max(own.refinements);
    sum.recovering += own.recovering;
    sum.recovery_energy += own.recovery_energy;
    for k in 0..3 {
        sum.momentum[k] += own.momentum[k];
        sum.angular_momentum[k] += own.angular_momentum[k];
    }
}
