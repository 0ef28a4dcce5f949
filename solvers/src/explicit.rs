//! Symplectic Euler and Störmer-Verlet with automatic substeps.
//!
//! Both are stable up to `h = 2 / omega_max` ([`crate::stability`]); a step is cut into as many
//! substeps as that asks for. If the energy nevertheless grows, the step is undone and repeated with
//! twice as many, and growth that creeps in over many steps lowers the limit.
//!
//! Dampers act with the velocity that is known when the force is evaluated, half a substep behind in
//! Störmer-Verlet (Bourguignon & Cani 2000, section 5): no linear system is solved. In a mode of frequency
//! omega and damping rate c that makes `v <- v - h (omega^2 x + c v)`, `x <- x + h v`, stable while
//! `(omega h)^2 + 2 c h <= 4` (Jury), that is up to `h = 4 / (c + sqrt(c^2 + 4 omega^2))`. For many unknowns
//! the largest omega and a bound on the largest c are put in, which is on the safe side.
//!
//! * One force evaluation per substep: the force of the last one is that of the next step's start,
//!   as long as nobody touched displacements, constants or bodies in between.
//! * Loads and prescribed motion act as their curves have them at every substep ([`WithinStep`]).
//! * Between two evaluations there is one pass over the vertices: the two half kicks of
//!   Störmer-Verlet that meet there, and the drift. Held unknowns take part with inverse mass 0 and
//!   are put in their place afterwards.
//! * Displacements carry what their number type cannot hold (`low`) along, over substeps and steps:
//!   in `f32`, `h v` is below the rounding of a displacement of metres.

use crate::burst::check_pressures;
use crate::contact_of;
use crate::settings::{Integrator, SolverSettings};
use crate::stability::StabilityLimit;
use crate::state::{
    NodeState, Rows, book_momentum, dot3, evaluate, position, read_force, read_rest, vector,
    viscous_rate, write_state,
};
use bevy_ecs::change_detection::Tick;
use bevy_ecs::prelude::*;
use bevy_ecs::system::SystemState;
use bytemuck::TransparentWrapper;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_contact::limits::Limits;
use sinew_contact::set::{ContactSet, RowPlaces};
use sinew_engine::columns::single_table;
use sinew_engine::compiled_here;
use sinew_engine::law::{ElasticEnergy, EvaluationRequest, ViscousRequest};
use sinew_engine::load::{LoadTime, SweptVolumes};
use sinew_engine::report::{ContactFigures, StepReport};
use sinew_engine::resource::{put, take};
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{
    ActiveLaws, ForceSchedule, evaluate_viscous, has_dampers, law_inputs_unchanged,
};
use sinew_engine::simd::{VectorKernel, vectorised};
use sinew_engine::step::{StepClock, StepError};
use sinew_engine::substep::WithinStep;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{Displacement, ElasticForce, FixedAxes, RecentCuts, Velocity};
use sinew_engine::workers::Workers;

/// Work space of the explicit integrators, and what they remember from step to step.
#[derive(Resource, Debug, Default)]
pub struct ExplicitScratch<S: Scalar> {
    node: NodeState<S>,
    /// Inverse masses (1/kg), 0 for held unknowns and padding.
    weight: Rows<S>,
    /// Masses and held axes that `weight` was made of.
    made_of: (Vec<S>, Vec<FixedAxes>),
    /// External force (N) at the present substep.
    external: Rows<S>,
    /// Elastic force (N) at the start of the step.
    force: Rows<S>,
    /// Force of the dampers (N) at the present substep, and velocities (m/s) that it is taken at.
    viscous: Rows<S>,
    known: ViscousRequest<S>,
    /// Rounding remainders of the displacements (m): at the start of the step, and now.
    low_start: Rows<S>,
    low: Rows<S>,
    within: WithinStep,
    limit: StabilityLimit<S>,
    caution: Caution,
    last: Option<LastStep<S>>,
    /// Volumes that pressures have swept, at the start of the step.
    swept: SweptVolumes,
    /// Rest positions (m), read once per topology.
    rest: Vec<DVec3>,
    /// Displacements (m) at the start of the substep, where something may touch.
    before: Rows<S>,
    revision: Option<u64>,
}

/// Values that explicit steps keep for the next one.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(bound = "S: Scalar")]
pub(crate) struct ExplicitMemory<S: Scalar> {
    /// Displacements (m) and elastic energy (J) at the end of the last step.
    u: Rows<S>,
    elastic: f64,
    /// Elastic force (N) there.
    force: Rows<S>,
    /// Rounding remainders of the displacements (m).
    low: Rows<S>,
    limit: StabilityLimit<S>,
    caution: Caution,
    swept: SweptVolumes,
    /// Masses (kg) and held axes that inverse masses and limit belong to.
    made_of: (Vec<S>, Vec<FixedAxes>),
}

impl<S: Scalar> ExplicitMemory<S> {
    /// Whether it can belong to a world of so many vertex rows and edges.
    pub fn fits(&self, rows: usize, edges: usize) -> bool {
        [&self.u, &self.force, &self.low].iter().all(|field| field.len() == rows)
            && [self.made_of.0.len(), self.made_of.1.len()] == [rows; 2]
            && self.limit.fits(rows, edges)
    }
}

/// The end of the last step.
#[derive(Clone, Debug)]
struct LastStep<S> {
    /// Displacements (m) written.
    u: Rows<S>,
    /// Elastic energy (J) there; the elastic force is `ExplicitScratch::force`.
    elastic: f64,
    revision: u64,
    laws: usize,
    tick: Tick,
}

impl<S: Scalar> ExplicitScratch<S> {
    /// The part that the next step will use, if it still holds.
    pub(crate) fn remember(&mut self, world: &mut World) -> Option<ExplicitMemory<S>> {
        let last = self.last.as_ref().filter(|last| holds(last, world))?;
        Some(ExplicitMemory {
            u: last.u.clone(),
            elastic: last.elastic,
            force: self.force.clone(),
            low: self.low_start.clone(),
            limit: self.limit.memory(),
            caution: self.caution,
            swept: self.swept.clone(),
            made_of: self.made_of.clone(),
        })
    }

    /// Restores kept values, for the world as it is now.
    pub(crate) fn recall(&mut self, world: &mut World, memory: &ExplicitMemory<S>) {
        let ExplicitMemory { u, elastic, force, low, limit, caution, swept, made_of } =
            memory.clone();
        let topology = world.resource::<Topology>();
        let revision = topology.revision;
        self.last = Some(LastStep {
            u,
            elastic,
            revision,
            laws: world.get_resource::<ActiveLaws>().map_or(0, |laws| laws.0.len()),
            tick: world.increment_change_tick(),
        });
        (self.force, self.low_start, self.limit) = (force, low, limit);
        (self.caution, self.swept) = (caution, swept);
        self.use_masses(made_of.0, made_of.1);
    }

    /// Inverse masses.
    fn use_masses(&mut self, mass: Vec<S>, fixed: Vec<FixedAxes>) {
        self.weight.clear();
        self.weight.extend(mass.iter().zip(&fixed).map(|(m, fixed)| {
            // vertices without mass stay where they are
            let weight = if *m > S::ZERO { S::ONE / *m } else { S::ZERO };
            let axis = |k| if fixed.holds(k) { S::ZERO } else { weight };
            [axis(0), axis(1), axis(2), S::ZERO]
        }));
        self.made_of = (mass, fixed);
    }
}

/// Whether elastic force and energy at the end of the last step are still those of its displacements.
fn holds<S: Scalar>(last: &LastStep<S>, world: &mut World) -> bool {
    let revision = world.resource::<Topology>().revision;
    let laws = world.get_resource::<ActiveLaws>().map_or(0, |laws| laws.0.len());
    last.revision == revision && last.laws == laws && law_inputs_unchanged(world, last.tick)
}

/// Doublings of the substep count before a step is given up.
pub const MAX_REFINEMENTS: u32 = 6;
/// Energy growth (relative to the energies involved) at which a step counts as unstable: symplectic
/// Euler and Störmer-Verlet. Within the stable range their energies oscillate in the first and second
/// order of omega h; seen in smooth motion at 0.9 of the limit: 0.05 and 0.003.
pub const GROWTH: [f64; 2] = [0.25, 0.1];
/// The same, summed over steps.
const CREEP: f64 = 0.25;
/// Factor on the stability limit when energy has crept up, and its least product.
const CAUTION: [f64; 2] = [0.8, 0.25];
/// Vertices per piece of work.
const ROW_CHUNK: usize = 2048;
/// Estimated work per vertex and pass (ns).
const ROW_NS: usize = 5;

/// Trust in the stability limit, by the energies of past steps.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Caution {
    /// Factor on the limit.
    factor: f64,
    /// Growth (J) of the total energy beyond the work done, summed over steps and never below 0.
    creep: f64,
}

impl Default for Caution {
    fn default() -> Self {
        Self { factor: 1.0, creep: 0.0 }
    }
}

impl Caution {
    /// Substeps that a step needs at a stability limit (s).
    ///
    /// # Errors
    /// When these are more than allowed.
    pub fn substeps(
        &self,
        clock: &StepClock,
        limit: f64,
        settings: &SolverSettings,
    ) -> Result<u32, StepError> {
        let needed = (clock.dt / (limit * self.factor * settings.explicit_safety)).ceil().max(1.0);
        if needed <= f64::from(settings.max_substeps) {
            Ok(needed as u32)
        } else {
            Err(too_many(clock, needed, limit, settings))
        }
    }

    /// Books the growth of the energy in a step and the energies that it is measured by (J); true, where the limit was
    /// too optimistic and has to be estimated again.
    pub fn book(&mut self, [grown, scale]: [f64; 2], refined: bool) -> bool {
        self.creep = (self.creep + grown).max(0.0);
        let optimistic = refined || self.creep > CREEP * scale;
        if optimistic {
            *self = Self { factor: (self.factor * CAUTION[0]).max(CAUTION[1]), creep: 0.0 };
        }
        optimistic
    }
}

fn too_many(clock: &StepClock, needed: f64, limit: f64, settings: &SolverSettings) -> StepError {
    StepError::Diverged {
        step: clock.step,
        time: clock.time,
        reason: format!(
            "an explicit step of {} s needs {needed:.0} substeps (stability limit {limit:.3e} s), \
             more than max_substeps = {}; reduce dt, raise max_substeps or use integrator = \"safe\"",
            clock.dt, settings.max_substeps
        ),
    }
}

/// The error of a step whose energy grew with as many substeps as were tried.
pub fn unstable(clock: &StepClock, substeps: u32, limit: f64) -> StepError {
    // none where everything is held
    let limit = match limit.is_finite() {
        true => format!("estimated stability limit {limit:.3e} s"),
        false => "nothing is free that could limit it".into(),
    };
    StepError::Diverged {
        step: clock.step,
        time: clock.time,
        reason: format!(
            "the energy grew, or a number overflowed, even with {substeps} substeps ({limit}); check loads and prescribed \
             motion, reduce dt or use integrator = \"safe\""
        ),
    }
}

/// Carries out one step with an explicit integrator.
///
/// # Errors
/// When the step needs more substeps than allowed, or stays unstable; the columns are unchanged.
pub fn explicit_step<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
) -> Result<(), StepError> {
    let mut scratch = take::<ExplicitScratch<S>>(world);
    // nothing here remembers what vertices did before
    RecentCuts::<S>::take(world);
    scratch.node.read(world);
    let revision = Some(world.resource::<Topology>().revision);
    if scratch.revision != revision {
        read_rest(world, &mut scratch.rest);
        scratch.revision = revision;
    }
    let result = if scratch.node.is_empty() {
        Ok(())
    } else {
        let contact = contact_of(world);
        let result = scratch.substep(world, settings, report, contact.as_ref());
        let (contact, result) = match result {
            Ok(new) => (new, Ok(())),
            Err(error) => (contact, Err(error)),
        };
        if let Some(contact) = contact {
            put(world, contact);
        }
        result
    };
    if result.is_err() {
        write_state(world, &scratch.node.u, &scratch.node.v);
        scratch.last = None;
    }
    put(world, scratch);
    result
}

/// Forgets what the integrators remember from step to step, so that the next step depends
/// on nothing but the state.
pub fn forget_steps<S: Scalar>(world: &mut World) {
    world.remove_resource::<ExplicitScratch<S>>();
    world.remove_resource::<crate::implicit::ImplicitScratch<S>>();
}

/// Largest stable explicit step (s) at the current state, before any safety factor; infinite when
/// nothing can move. Constraints count as far as the last step applied them.
pub fn estimate_stable_step<S: Scalar>(world: &mut World) -> f64 {
    compiled_here!(S, estimate(world: &mut World) -> f64)
}

fn estimate<S: Scalar>(world: &mut World) -> f64 {
    let mut node = NodeState::<S>::default();
    node.read(world);
    if node.is_empty() {
        return f64::INFINITY;
    }
    let mut force = Rows::default();
    evaluate(world, &node.u, false, true, None);
    read_force(world, &mut force);
    let limit = StabilityLimit::default().get(world, &node, &force, &mut 0);
    let limit = with_dampers(limit, viscous_rate(world, &node));
    write_state(world, &node.u, &node.v);
    limit
}

/// The stability limit (s) with dampers of at most the rate `c` (1/s), from the limit without dampers.
fn with_dampers(limit: f64, c: f64) -> f64 {
    // omega = 2 / limit
    if c > 0.0 { 4.0 / (c + c.hypot(4.0 / limit)) } else { limit }
}

impl<S: Scalar> ExplicitScratch<S> {
    fn substep(
        &mut self,
        world: &mut World,
        settings: &SolverSettings,
        report: &mut StepReport,
        contact: Option<&ContactSet>,
    ) -> Result<Option<ContactSet>, StepError> {
        let clock = *world.resource::<StepClock>();
        let prepared = |contact| self.prepare(contact, world, settings.integrator);
        let contact = contact.map(prepared).transpose()?;
        self.within.read(world, &self.node.u, &self.node.prescribed, &self.node.fixed);
        let elastic = self.bring_up_to_date(world, report);
        let limit = self.limit.get(world, &self.node, &self.force, &mut report.evaluations);
        let touch = contact.as_ref().map_or([0.0; 2], |contact| {
            let mass = |row: VertexRow| self.node.mass[row.index()].to_f64();
            contact.rates(&mass)
        });
        // omega^2 of contact adds to that of the elements
        let limit = 2.0 / (2.0 / limit).hypot(touch[0]);
        let limit = with_dampers(limit, viscous_rate(world, &self.node) + touch[1]);
        report.stable_step = limit;
        let mut substeps = self.caution.substeps(&clock, limit, settings)?;
        for refinement in 0..=MAX_REFINEMENTS {
            if substeps > settings.max_substeps {
                return Err(too_many(&clock, f64::from(substeps), limit, settings));
            }
            let mut contact = contact.clone();
            let tried = self.attempt(world, settings, report, &mut contact, elastic, substeps);
            if let Some(growth) = tried {
                check_pressures::<S>(world)?;
                report.substeps = substeps;
                report.refinements = refinement;
                self.finish(world, report, growth, refinement > 0);
                return Ok(contact);
            }
            substeps = substeps.saturating_mul(2);
        }
        self.limit.forget();
        Err(unstable(&clock, substeps / 2, limit))
    }

    /// Finds the points of contact of the coming step.
    fn prepare(
        &self,
        contact: &ContactSet,
        world: &mut World,
        integrator: Integrator,
    ) -> Result<ContactSet, StepError> {
        let mut contact = contact.clone();
        let x = position(&self.rest, &self.node.u);
        let v = |row: VertexRow| vector(&self.node.v[row.index()]);
        contact.prepare(world, &x, &v, [false; 2])?;
        integrator.check_contact(&contact)?;
        Ok(contact)
    }

    /// Brings the elastic force (`self.force`) and the elastic energy (J, returned) at the start up to date: those of
    /// the last step if they still hold.
    fn bring_up_to_date(&mut self, world: &mut World, report: &mut StepReport) -> f64 {
        let n = self.node.len();
        if self.made_of.0 != self.node.mass || self.made_of.1 != self.node.fixed {
            let (mass, fixed) = (self.node.mass.clone(), self.node.fixed.clone());
            self.use_masses(mass, fixed);
            self.limit.forget();
        }
        let Some(last) = self.last.as_ref().filter(|last| holds(last, world)) else {
            self.limit.forget();
            self.caution = Caution::default();
            self.low_start.clear();
            self.low_start.resize(n, [S::ZERO; 4]);
            return self.evaluate_start(world, report);
        };
        if bytemuck::cast_slice::<_, u8>(&last.u) == bytemuck::cast_slice::<_, u8>(&self.node.u) {
            return last.elastic;
        }
        // somebody moved vertices: what their displacements could not hold is void
        for ((low, then), now) in self.low_start.iter_mut().zip(&last.u).zip(&self.node.u) {
            if then != now {
                *low = [S::ZERO; 4];
            }
        }
        self.evaluate_start(world, report)
    }

    fn evaluate_start(&mut self, world: &mut World, report: &mut StepReport) -> f64 {
        report.evaluations += 1;
        let start = world.resource::<StepClock>().time;
        world.insert_resource(LoadTime(start));
        evaluate(world, &self.node.u, true, true, None);
        read_force(world, &mut self.force);
        self.swept = world.get_resource::<SweptVolumes>().cloned().unwrap_or_default();
        world.resource::<ElasticEnergy>().elastic()
    }

    /// One step with a given number of substeps from the remembered start. Returns the growth of the energy and the
    /// energies that it is measured by (J); `None` when it grew too much or a number is not finite.
    fn attempt(
        &mut self,
        world: &mut World,
        settings: &SolverSettings,
        report: &mut StepReport,
        contact: &mut Option<ContactSet>,
        elastic0: f64,
        substeps: u32,
    ) -> Option<[f64; 2]> {
        let n = self.node.len();
        let StepClock { dt, time, .. } = *world.resource::<StepClock>();
        let h = dt / f64::from(substeps);
        let mut swept = self.swept.clone();
        let verlet = settings.integrator == Integrator::StormerVerlet;
        let damped = has_dampers(world);
        let [first, middle, last] = KickFactors::of(settings, h);

        // the start of the step
        write_state(world, &self.node.u, &self.node.v);
        self.low.clone_from(&self.low_start);
        self.external.clone_from(&self.node.external);
        self.viscous.clear();
        let [kinetic0, held0] = self.node.kinetic_energy(0..n, &self.node.v);
        let mut state = State::<S>::new(world);
        let before = [elastic0, kinetic0, held0];
        let mut books = Bookkeeping { before, ..Bookkeeping::default() };
        self.within.load_differences(0.0, &mut books.differences);
        let half = if verlet { 0.5 * h } else { h };
        if damped {
            // before held unknowns lose the velocity that they had
            books.dissipated += half * self.damp(&mut state, world);
        }
        self.stop_held(&mut state, world);
        let v = |row: VertexRow| -vector(&self.node.v[row.index()]);
        touch(contact, &self.rest, [&self.node.u; 2], 0.0, (1.0, &v));
        // the substeps
        for i in 1..=substeps {
            let part = f64::from(i) / f64::from(substeps);
            if damped && i > 1 {
                books.dissipated += h * self.damp(&mut state, world);
            }
            // kick and drift
            self.load(&books, contact.as_ref());
            self.within.ways(part, &mut books.ways);
            {
                let (workers, mut columns) = state.get_mut(world).expect("engine resources");
                let (mut u, mut v, f) =
                    single_table(columns.contiguous_iter_mut()).expect("there are vertices");
                let u = Displacement::peel_slice_mut(u.bypass_change_detection());
                let v = Velocity::peel_slice_mut(v.bypass_change_detection());
                let start = i == 1;
                let force = if start { &self.force[..] } else { ElasticForce::peel_slice(f) };
                self.open_books(&mut books, u, force);
                let factors = if start { first } else { middle };
                self.before.clear();
                if contact.as_ref().is_some_and(|contact| !contact.is_idle()) {
                    self.before.extend_from_slice(u);
                }
                advance(
                    &workers,
                    pieces(u, v, &mut self.low, [force, &self.external, &self.weight]),
                    factors,
                );
                self.place_held(&mut books, u, v, h, i == substeps);
                let of_rest = 1.0 / f64::from(substeps - i + 1);
                settle(contact, &self.rest, [u, &self.before], of_rest, h);
            }
            self.within.load_differences(part, &mut books.differences);
            let end = i == substeps;
            if damped && end && verlet {
                books.dissipated += half * self.damp(&mut state, world);
            }
            // forces at the new place
            self.load(&books, contact.as_ref());
            world.insert_resource(EvaluationRequest { energy: end, force: true, tangent: None });
            world.insert_resource(LoadTime(time + part * dt));
            world.run_schedule(ForceSchedule);
            if let Some(now) = world.get_resource::<SweptVolumes>() {
                books.load_work += now.work_since(&swept);
                swept.clone_from(now);
            }
            report.evaluations += 1;
            // energy books, and the last half kick of Störmer-Verlet
            let (workers, mut columns) = state.get_mut(world).expect("engine resources");
            let (mut u, mut v, f) =
                single_table(columns.contiguous_iter_mut()).expect("there are vertices");
            let u = Displacement::peel_slice_mut(u.bypass_change_detection());
            let force = ElasticForce::peel_slice(f);
            self.close_books(&mut books, u, force);
            if end && verlet {
                let v = Velocity::peel_slice_mut(v.bypass_change_detection());
                advance(
                    &workers,
                    pieces(u, v, &mut self.low, [force, &self.external, &self.weight]),
                    last,
                );
            }
        }

        self.close_step(&mut state, world, settings, report, contact, &books)
    }

    /// Writes the energies at the end of a step into the report. Returns the growth of the energy and the energies that it
    /// is measured by (J); `None` when it grew too much or a number is not finite.
    fn close_step(
        &self,
        state: &mut State<S>,
        world: &mut World,
        settings: &SolverSettings,
        report: &mut StepReport,
        contact: &mut Option<ContactSet>,
        books: &Bookkeeping,
    ) -> Option<[f64; 2]> {
        let (n, dt) = (self.node.len(), world.resource::<StepClock>().dt);
        let verlet = settings.integrator == Integrator::StormerVerlet;
        let [elastic0, kinetic0, held0] = books.before;
        let elastic = world.resource::<ElasticEnergy>().elastic();
        let (_, mut columns) = state.get_mut(world).expect("engine resources");
        let (u, v, _) = single_table(columns.contiguous_iter_mut()).expect("there are vertices");
        let (u, v) = (Displacement::peel_slice(&u), Velocity::peel_slice(&v));
        let [kinetic, held] = self.node.kinetic_energy(0..n, v);
        let [stored, tool_work] = contact.as_ref().map_or([0.0; 2], ContactSet::books);
        let load_work = books.load_work
            + (0..n)
                .map(|row| {
                    let mut way = [S::ZERO; 4];
                    for k in 0..3 {
                        way[k] = u[row][k] - self.node.u[row][k]
                            + (self.low[row][k] - self.low_start[row][k]);
                    }
                    dot3(&self.node.external[row], &way)
                })
                .sum::<f64>();
        let change = elastic - elastic0 - load_work + stored - tool_work;
        let scale = kinetic0 + kinetic + elastic.abs() + change.abs() + books.constraint_work.abs();
        let grown = kinetic - kinetic0 + change - books.constraint_work;
        if !grown.is_finite() || grown > GROWTH[usize::from(verlet)] * scale {
            return None;
        }
        let finite = |rows: &[[S; 4]]| {
            // a sum is finite only if its terms are, but may overflow
            rows.iter().all(|x| x[0].is_finite() & x[1].is_finite() & x[2].is_finite())
        };
        if !(finite(u) && finite(v)) {
            return None;
        }
        report.elastic_energy = elastic;
        report.kinetic_energy = kinetic + held;
        // what holds vertices also speeds them up and slows them down
        report.constraint_work = books.constraint_work + held - held0;
        report.load_work = load_work;
        report.dissipation = -grown;
        report.damping_dissipation =
            settings.mass_damping * dt * (kinetic0 + kinetic) + books.dissipated;
        book_momentum(report, &self.rest, &self.node.mass, u, v);
        if let Some(contact) = contact {
            let u = u.to_vec();
            let x = position(&self.rest, &u);
            // bodies are where the next substep starts from: the offset alone gives their velocity
            contact.set_dampers(&contact.bodies(), 1.0, &|row| -vector(&v[row.index()]));
            let figures = contact.finish(world, &RowPlaces { now: &x, start: &x }, dt, true);
            report.contact = ContactFigures { work: tool_work, ..figures };
        }
        Some([grown, scale])
    }

    /// Keeps the end of the step for the next one.
    fn finish(&mut self, world: &mut World, report: &StepReport, growth: [f64; 2], refined: bool) {
        if self.caution.book(growth, refined) {
            self.limit.forget();
        }
        std::mem::swap(&mut self.low, &mut self.low_start);
        self.swept = world.get_resource::<SweptVolumes>().cloned().unwrap_or_default();
        read_force(world, &mut self.force);
        let mut u = self.last.take().map_or_else(Vec::new, |last| last.u);
        u.clear();
        let mut query = world.query::<&Displacement<S>>();
        if let Some(column) = single_table(query.contiguous_iter(world)) {
            u.extend_from_slice(Displacement::peel_slice(column));
        }
        self.last = Some(LastStep {
            u,
            elastic: report.elastic_energy,
            revision: world.resource::<Topology>().revision,
            laws: world.get_resource::<ActiveLaws>().map_or(0, |laws| laws.0.len()),
            // what is changed from here on has a later tick
            tick: world.increment_change_tick(),
        });
    }

    /// Forces of the dampers at the state of the columns into `self.viscous`; the power (W) that they take.
    fn damp(&mut self, state: &mut State<S>, world: &mut World) -> f64 {
        let mut velocity = match std::mem::take(&mut self.known) {
            ViscousRequest::Force(rows) => rows,
            _ => Vec::new(),
        };
        velocity.clear();
        {
            let (_, mut columns) = state.get_mut(world).expect("engine resources");
            let (_, v, _) =
                single_table(columns.contiguous_iter_mut()).expect("there are vertices");
            velocity.extend_from_slice(Velocity::peel_slice(&v));
        }
        self.known = ViscousRequest::Force(velocity);
        evaluate_viscous(world, &self.known, &mut self.viscous);
        let ViscousRequest::Force(velocity) = &self.known else { return 0.0 };
        -self.viscous.iter().zip(velocity).map(|(f, v)| dot3(f, v)).sum::<f64>()
    }

    /// Velocities of held unknowns to zero: those that move get theirs substep by substep.
    fn stop_held(&mut self, state: &mut State<S>, world: &mut World) {
        let (_, mut columns) = state.get_mut(world).expect("engine resources");
        let Some((_, mut v, _)) = single_table(columns.contiguous_iter_mut()) else { return };
        let v = v.bypass_change_detection();
        for (row, held) in self.node.fixed.iter().enumerate().filter(|(_, held)| held.0 != 0) {
            for k in (0..3).filter(|&k| held.holds(k)) {
                v[row].0[k] = S::ZERO;
                self.low[row][k] = S::ZERO;
            }
        }
    }

    /// External forces of the present substep into `self.external`.
    fn load(&mut self, books: &Bookkeeping, contact: Option<&ContactSet>) {
        let contact = contact.filter(|contact| !contact.is_idle());
        if contact.is_some() {
            self.external.clone_from(&self.node.external);
        }
        if !self.viscous.is_empty() {
            let known = self.node.external.iter().zip(&self.viscous);
            self.external.clear();
            self.external.extend(known.map(|(e, d)| [0, 1, 2, 3].map(|k| e[k] + d[k])));
        }
        for (&row, difference) in self.within.loaded.iter().zip(&books.differences) {
            let (now, end) = (&mut self.external[row.index()], &self.node.external[row.index()]);
            for k in 0..3 {
                let viscous = self.viscous.get(row.index()).map_or(S::ZERO, |d| d[k]);
                now[k] = end[k] + S::from_f64(difference[k]) + viscous;
            }
        }
        if let Some(contact) = contact {
            contact.for_forces(&contact.bodies(), |row, f| {
                for k in 0..3 {
                    self.external[row][k] += S::from_f64(f[k]);
                }
            });
        }
    }

    fn reaction(&self, force: &[[S; 4]], row: VertexRow, axis: u32) -> f64 {
        let (row, axis) = (row.index(), axis as usize);
        -(force[row][axis] + self.external[row][axis]).to_f64()
    }

    /// Start of a substep: reactions, and where the loaded vertices are.
    fn open_books(&self, books: &mut Bookkeeping, u: &[[S; 4]], force: &[[S; 4]]) {
        books.reactions.clear();
        let moving = &self.within.moving;
        books.reactions.extend(moving.iter().map(|m| self.reaction(force, m.row, m.axis)));
        books.differences_before.clone_from(&books.differences);
        books.loaded.clear();
        books.loaded.extend(self.within.loaded.iter().map(|row| vector(&u[row.index()])));
    }

    /// Puts the moving unknowns where their constraints want them.
    fn place_held(
        &mut self,
        books: &mut Bookkeeping,
        u: &mut [[S; 4]],
        v: &mut [[S; 4]],
        h: f64,
        end: bool,
    ) {
        books.ways_before.resize(books.ways.len(), 0.0);
        for ((m, way), before) in self.within.moving.iter().zip(&books.ways).zip(&books.ways_before)
        {
            let (row, k) = (m.row.index(), m.axis as usize);
            u[row][k] = if end {
                self.node.prescribed[row][k]
            } else {
                self.node.u[row][k] + S::from_f64(*way)
            };
            self.low[row][k] = S::ZERO;
            v[row][k] = S::from_f64((way - before) / h);
        }
    }

    /// End of a substep: work by the trapezoidal rule.
    fn close_books(&self, books: &mut Bookkeeping, u: &[[S; 4]], force: &[[S; 4]]) {
        for (i, m) in self.within.moving.iter().enumerate() {
            let mean = 0.5 * (books.reactions[i] + self.reaction(force, m.row, m.axis));
            books.constraint_work += mean * (books.ways[i] - books.ways_before[i]);
        }
        books.ways_before.clone_from(&books.ways);
        for (i, &row) in self.within.loaded.iter().enumerate() {
            let mean = 0.5 * (books.differences_before[i] + books.differences[i]);
            books.load_work += mean.dot(vector(&u[row.index()]) - books.loaded[i]);
        }
    }
}

/// Forces of contact at displacements `u`, those at the start of the substep being `before`, when the share `of_rest` of
/// what is left of the step has passed. Dampers meet velocities as [`ContactSet::set_dampers`] has them. They are added by
/// [`load`](ExplicitScratch::load).
fn touch<S: Scalar>(
    contact: &mut Option<ContactSet>,
    rest: &[DVec3],
    [u, before]: [&[[S; 4]]; 2],
    of_rest: f64,
    (span, offset): (f64, &dyn Fn(VertexRow) -> DVec3),
) {
    let Some(contact) = contact.as_mut().filter(|contact| !contact.is_idle()) else { return };
    contact.set_part(of_rest);
    let (now, start) = (position(rest, u), position(rest, before));
    let bodies = contact.bodies();
    contact.set_dampers(&bodies, span, offset);
    contact.evaluate(&bodies, &RowPlaces { now: &now, start: &start }, Limits::Take);
}

/// The columns that a substep works on.
type State<'w, 's, S> = SystemState<(
    Res<'w, Workers>,
    Query<
        'w,
        's,
        (&'static mut Displacement<S>, &'static mut Velocity<S>, &'static ElasticForce<S>),
    >,
)>;

/// Factors of a kick and a drift: `v <- keep v + kick (f / m)`, `u <- u + drift v`.
#[derive(Clone, Copy, Debug)]
pub struct KickFactors<S> {
    /// Factor of the velocity.
    pub keep: S,
    /// Factor (s) of the acceleration.
    pub kick: S,
    /// Factor (s) of the velocity in the displacement.
    pub drift: S,
}

impl<S: Scalar> KickFactors<S> {
    /// Factors of the first substep, of those in the middle, and of the kick at the end of the last; substeps have
    /// length `h` (s).
    pub fn of(settings: &SolverSettings, h: f64) -> [Self; 3] {
        // damping is taken implicitly in every kick
        let damped = |t: f64| 1.0 / (1.0 + settings.mass_damping * t);
        let (whole, half) = (damped(h), damped(0.5 * h));
        let factors = |keep: f64, kick: f64, drift: f64| Self {
            keep: S::from_f64(keep),
            kick: S::from_f64(kick),
            drift: S::from_f64(drift),
        };
        let last = factors(half, 0.5 * h * half, 0.0);
        if settings.integrator == Integrator::StormerVerlet {
            // the two half kicks between drifts are one
            let between = factors(half * half, 0.5 * h * (half * half + half), h);
            [factors(half, 0.5 * h * half, h), between, last]
        } else {
            [factors(whole, h * whole, h), factors(whole, h * whole, h), last]
        }
    }
}

/// Slices of the columns for a piece of rows.
struct RowSlices<'a, S> {
    u: &'a mut [[S; 4]],
    v: &'a mut [[S; 4]],
    low: &'a mut [[S; 4]],
    force: &'a [[S; 4]],
    external: &'a [[S; 4]],
    weight: &'a [[S; 4]],
}

/// A held unknown or loaded vertex through a substep.
#[derive(Clone, Debug, Default)]
struct Bookkeeping {
    /// Ways (m) of the moving unknowns so far.
    ways: Vec<f64>,
    ways_before: Vec<f64>,
    /// Their reactions (N) at the start of the substep.
    reactions: Vec<f64>,
    /// Forces (N) of the varying loads less their values at the end of the step.
    differences: Vec<DVec3>,
    differences_before: Vec<DVec3>,
    /// Displacements (m) of the loaded vertices at the start of the substep.
    loaded: Vec<DVec3>,
    /// Work (J) of the reactions, and of pressures and the varying part of the loads.
    constraint_work: f64,
    load_work: f64,
    /// Work (J) that dampers took.
    dissipated: f64,
    /// Elastic and kinetic energy, and that of held unknowns, at the start of the step (J).
    before: [f64; 3],
}

/// Forces of contact at the end of a substep of length `h` (s), from where friction goes on.
fn settle<S: Scalar>(
    contact: &mut Option<ContactSet>,
    rest: &[DVec3],
    [u, before]: [&[[S; 4]]; 2],
    of_rest: f64,
    h: f64,
) {
    touch(contact, rest, [u, before], of_rest, (h, &|_| DVec3::ZERO));
    if let Some(contact) = contact.as_mut().filter(|contact| !contact.is_idle()) {
        contact.settle(&position(rest, u));
    }
}

/// Cuts the columns into pieces of fixed size.
fn pieces<'a, S: Scalar>(
    u: &'a mut [[S; 4]],
    v: &'a mut [[S; 4]],
    low: &'a mut [[S; 4]],
    [force, external, weight]: [&'a [[S; 4]]; 3],
) -> Vec<RowSlices<'a, S>> {
    let state = u.chunks_mut(ROW_CHUNK).zip(v.chunks_mut(ROW_CHUNK)).zip(low.chunks_mut(ROW_CHUNK));
    let given =
        force.chunks(ROW_CHUNK).zip(external.chunks(ROW_CHUNK)).zip(weight.chunks(ROW_CHUNK));
    let piece = |(((u, v), low), ((force, external), weight))| RowSlices {
        u,
        v,
        low,
        force,
        external,
        weight,
    };
    state.zip(given).map(piece).collect()
}

/// Kick and drift of all rows, displacements summed without loss into `u + low`.
fn advance<S: Scalar>(workers: &Workers, mut pieces: Vec<RowSlices<S>>, by: KickFactors<S>) {
    let rows: usize = pieces.iter().map(|p| p.u.len()).sum();
    workers.for_each(&mut pieces, rows * ROW_NS, |_, piece| vectorised(Advance { piece, by }));
}

struct Advance<'a, 'b, S> {
    piece: &'a mut RowSlices<'b, S>,
    by: KickFactors<S>,
}

impl<S: Scalar> VectorKernel for Advance<'_, '_, S> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { piece: p, by } = self;
        // number by number: by rows the compiler shuffles them into registers of one axis each
        let (u, v) = (p.u.as_flattened_mut().iter_mut(), p.v.as_flattened_mut().iter_mut());
        let state = u.zip(v).zip(p.low.as_flattened_mut());
        let given = p.force.as_flattened().iter().zip(p.external.as_flattened());
        for (((u, v), low), ((&f, &e), &w)) in state.zip(given.zip(p.weight.as_flattened())) {
            *v = by.keep * *v + by.kick * ((f + e) * w);
            let way = by.drift * *v + *low;
            let sum = *u + way;
            let gained = sum - *u;
            *low = (*u - (sum - gained)) + (way - gained);
            *u = sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::with_dampers;

    /// Largest amplitude of a damped oscillator after many substeps of the kick and drift that the limit is for.
    fn amplitude(omega: f64, c: f64, h: f64) -> f64 {
        let (mut x, mut v) = (1.0, 0.0);
        for _ in 0..2000 {
            v -= h * (omega * omega * x + c * v);
            x += h * v;
        }
        f64::max(x.abs(), v.abs() / omega)
    }

    #[test]
    fn the_limit_with_dampers_is_sharp() {
        for (omega, c) in [(1.0, 0.1), (3.0, 3.0), (2.0, 40.0)] {
            let limit = with_dampers(2.0 / omega, c);
            assert!(amplitude(omega, c, 0.99 * limit) < 10.0, "{omega} {c}");
            assert!(amplitude(omega, c, 1.01 * limit) > 1e6, "{omega} {c}");
        }
        assert_eq!(with_dampers(0.25, 0.0), 0.25);
        assert_eq!(with_dampers(f64::INFINITY, 4.0), 0.5);
    }
}
