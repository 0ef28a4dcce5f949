//! Implicit integrators and quasi-static equilibrium as minimisation of an incremental potential, body
//! by body (bodies share a world, not a solve, a line search or a cap). The unknown is the increment `d`
//! of the displacements since the start of the step:
//!
//! `P(d) = |d - d_inertia|^2_M / (2 H^2) + W(x_n + d) - f.d + 1/(2 H) (d - o)^T C (d - o)`
//!
//! over the free unknowns. The velocity at the end is `(d - o) / H`, and without forces it would be
//! `v_ref`: `d_inertia = o + H v_ref`. `C = alpha M + beta K_gn + C_d` is Rayleigh damping and the
//! matrix of dampers, frozen where the iteration starts; `K_gn` is the positive semi-definite part of the
//! tangent.
//!
//! | | file | `H` | `o` | `v_ref` |
//! |---|---|---|---|---|
//! | implicit Euler | `euler` | `h` | 0 | `v_n` |
//! | BDF2, `r = h / h_prev`, `b = r^2 / (1 + 2 r)` | `bdf2`, `linearised_bdf2` | `h (1 + r) / (1 + 2 r)` | `b d_prev` | `v_n + b (v_n - v_prev)` |
//! | TR-BDF2, trapezoid to `gamma h`, `gamma = 2 - sqrt 2` | `tr_bdf2` | `gamma h / 2` | `H v_n` | `v_n`, and the force at `x_n` beside `f` |
//! | then BDF2, `a = 1 / (gamma (2 - gamma))` | | `gamma h / 2` | `a d_gamma` | `a v_gamma + (1 - a) v_n` |
//! | midpoint: implicit Euler to the middle, then `2 d` | `midpoint` | `h / 2` | 0 | `v_n` |
//! | equilibrium | `equilibrium` | infinite | | |
//!
//! * **Safe**: one Newton step from `x_n` (held vertices moved) with the exact Hessian. If conjugate
//!   gradients meet non-positive curvature, or the last step ended with inverted elements, the tangent
//!   is assembled again with clamped elements and the system solved again. Armijo backtracking on `P`,
//!   then the energy cap: since Armijo gives `W(y) + |v - v_n|^2_M / 2 <= W(y_0) + |v_n|^2_M / 2`, a
//!   factor on `v` exists that keeps kinetic plus potential energy at or below `T_n + W(y_0)` (plus
//!   what damping stores when held vertices move), so the total energy never rises between outside
//!   actions, for any step length.
//! * **Linearised BDF2**: one Newton step of BDF2 from `x_n + h v_n`, which must pass tests
//!   (`linearised_bdf2`); a body that fails them takes the safe step.
//! * **Linearised TR-BDF2**: one Newton step a stage, under the same tests (`tr_bdf2`).
//! * **Newton, BDF2, TR-BDF2, midpoint**: iterated to convergence, the last three from where the
//!   velocities lead. A body in contact for which that fails takes the safe step.
//! * **Quasi-static**: the same without inertia; in parts if it does not converge in one go, or turns
//!   elements inside out (`equilibrium`).

mod bdf2;
mod equilibrium;
mod euler;
mod finish;
mod line_search;
mod linearised_bdf2;
mod local_stiffness;
mod midpoint;
mod newton;
mod pieces;
mod start;
mod step;
mod touch;
mod tr_bdf2;

use crate::burst::check_pressures;
use crate::contact_of;
use crate::integrator::Integrator;
use crate::settings::SolverSettings;
use crate::state::{evaluate, position, read_rest, vector, write_state};
use crate::support::check_support;
use bevy_ecs::prelude::*;
pub use equilibrium::MAX_PARTINGS;
pub use finish::BUDGET_DECAY;
pub use linearised_bdf2::WAIT;
use sinew_contact::set::{ContactSet, RowPlaces};
use sinew_engine::law::ElasticEnergy;
use sinew_engine::load::SweptVolumes;
use sinew_engine::report::StepReport;
use sinew_engine::resource::{put, take};
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StateWatched, StepClock, StepError, check_watched, not_finite};
use sinew_engine::topology::Topology;
pub use step::ImplicitScratch;
use step::Step;

/// Forgets the kept preconditioners and factors of the implicit integrators: they belong to matrices
/// that will not come again.
pub fn forget_matrices<S: Scalar>(world: &mut World) {
    world.remove_resource::<ImplicitScratch<S>>();
}

/// Carries out one implicit step, or finds one equilibrium.
///
/// # Errors
/// When a number stops being finite, an equilibrium is asked of a body that can move rigidly, or the
/// integrator chosen is an explicit one; the columns are then unchanged.
pub fn implicit_step<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
) -> Result<(), StepError> {
    let mut scratch = take::<ImplicitScratch<S>>(world);
    let still = scratch.is_still(world, settings);
    if !still {
        let finite = check_watched::<S>(world);
        scratch.node.read(world);
        if finite.is_err() {
            scratch.forget_sleep();
            put(world, scratch);
            return finite;
        }
    }
    let revision = world.resource::<Topology>().revision;
    if scratch.revision != revision || scratch.rest.len() != scratch.node.len() {
        read_rest(world, &mut scratch.rest);
        scratch.revision = revision;
        scratch.supported = None;
    }
    let mut contact = contact_of(world);
    let mut result = match &mut contact {
        Some(contact) if !scratch.node.is_empty() => {
            prepare(contact, world, settings, &scratch, still)
        }
        _ => Ok(()),
    };
    if still && result.is_ok() && contact.as_ref().is_none_or(is_far) {
        scratch.step_asleep(world, contact.as_mut(), report);
    } else if result.is_ok() && !scratch.node.is_empty() {
        if still {
            scratch.node.read(world);
        }
        let mut step = Step::new(world, settings, report, &mut scratch);
        step.contact_before = contact.as_ref().map_or(0.0, ContactSet::stored);
        step.contact = contact;
        result = step.run();
        contact = step.contact;
    }
    if let Some(contact) = contact {
        put(world, contact);
    }
    scratch.sleep.end(world);
    if result.is_err() {
        write_state(world, &scratch.node.u, &scratch.node.v);
        scratch.forget_sleep();
    }
    put(world, scratch);
    result
}

/// Whether nothing is near, and nobody asks how stiff it would be.
fn is_far(contact: &ContactSet) -> bool {
    contact.is_idle() && !contact.asks_stiffness()
}

impl<S: Scalar> ImplicitScratch<S> {
    /// Whether a step would leave the world as it is, unless something comes near.
    fn is_still(&self, world: &mut World, settings: &SolverSettings) -> bool {
        settings.sleep_speed > 0.0
            && settings.integrator.facts().dynamic
            && self.sleep.goes_on(world)
            && self.history.energies_hold(world)
            && !world.contains_resource::<SweptVolumes>()
    }

    /// Such a step: it does what any step does for tools and for those who read reports.
    fn step_asleep(
        &mut self,
        world: &mut World,
        contact: Option<&mut ContactSet>,
        report: &mut StepReport,
    ) {
        let dt = world.resource::<StepClock>().dt;
        self.sleep.report(world, report);
        if let Some(contact) = contact {
            let now = position(&self.rest, &self.node.u);
            let places = RowPlaces { now: &now, start: &now };
            report.contact = contact.finish(world, &places, dt, true);
        }
        self.history.dt = dt;
        self.history.asleep += 1;
        self.history.stamp(world);
        put(world, StateWatched(true));
    }
}

/// Finds the points of contact of the coming step.
fn prepare<S: Scalar>(
    contact: &mut ContactSet,
    world: &mut World,
    settings: &SolverSettings,
    scratch: &ImplicitScratch<S>,
    still: bool,
) -> Result<(), StepError> {
    let x = position(&scratch.rest, &scratch.node.u);
    let v = |row: VertexRow| vector(&scratch.node.v[row.index()]);
    contact.prepare(world, &x, &v, [true, still])?;
    settings.integrator.check_contact(contact)
}

impl<S: Scalar> Step<'_, S> {
    /// The whole step, or the search for an equilibrium.
    fn run(&mut self) -> Result<(), StepError> {
        let integrator = self.settings.integrator.resolve();
        if !self.is_dynamic() && self.scratch.supported.as_ref() != Some(&self.scratch.node.fixed) {
            check_support(self.world, &self.scratch.node)?;
            self.scratch.supported = Some(self.scratch.node.fixed.clone());
        }
        self.hold_orphans();
        self.recall()?;
        // by the laws of this step, which recovery may have changed
        let start = follower_energies(self.world, &self.scratch.node.u);
        if self.bodies.is_empty() {
            self.scratch.begin();
            self.find_local_stiffness();
            self.finish();
            return Ok(());
        }
        match integrator {
            Integrator::Safe => self.safe_euler(),
            Integrator::LinearisedBdf2 => self.linearised_bdf2(),
            Integrator::Newton => self.converged_euler(),
            Integrator::Bdf2 => self.bdf2(),
            Integrator::TrBdf2 => self.tr_bdf2(),
            Integrator::LinearisedTrBdf2 => self.linearised_tr_bdf2(),
            Integrator::ImplicitMidpoint => self.midpoint(),
            Integrator::QuasiStatic => self.equilibrium(),
            Integrator::Auto | Integrator::SymplecticEuler | Integrator::StormerVerlet => {
                let name = integrator.name();
                Err(StepError::InvalidSetting(format!("integrator = \"{name}\" is not implicit")))
            }
        }?;
        self.step_safely_where_contact_is_missed()?;
        self.check_finite()?;
        self.find_local_stiffness();
        let end = follower_energies(self.world, &self.scratch.iterate);
        if end.is_some() {
            check_pressures::<S>(self.world)?;
        }
        self.finish();
        if let (Some(start), Some(end)) = (start, end) {
            self.book_followers(start, end);
        }
        Ok(())
    }

    /// Every displacement and energy found must be a number.
    fn check_finite(&mut self) -> Result<(), StepError> {
        let clock = self.world.resource::<StepClock>();
        if let Some(body) = self.bodies.iter().position(|body| !body.elastic.is_finite()) {
            return Err(StepError::Diverged {
                step: clock.step,
                time: clock.time,
                reason: format!(
                    "the energy of body {body} (in order of spawning) is beyond the range of numbers; the step \
                     was undone: try a smaller step or check material and loads"
                ),
            });
        }
        let finite = |u: &[S; 4]| u.iter().all(|u| u.is_finite());
        match self.scratch.iterate.iter().position(|u| !finite(u)) {
            None => Ok(()),
            Some(row) => Err(not_finite(
                self.world,
                row,
                "new displacement",
                "the step was undone; try a smaller step or check material and loads",
            )),
        }
    }

    /// Books the loads that are laws as loads: their potential is small beside that of the elements, so
    /// better read than found by subtraction.
    fn book_followers(&mut self, start: FollowerEnergies, end: FollowerEnergies) {
        let dynamic = self.is_dynamic();
        let report = &mut *self.report;
        let booked = report.elastic_energy - end.load;
        report.elastic_energy = end.elastic;
        if dynamic {
            report.dissipation += booked - end.elastic;
            report.load_work += start.load - end.load;
        }
    }
}

/// Energies in a world with follower loads: loads that are laws, such as pressure.
struct FollowerEnergies {
    /// Potential of these loads (J).
    load: f64,
    /// Elastic energy (J).
    elastic: f64,
}

/// Energies at displacements `u`; `None`, without an evaluation, where there are no follower loads.
fn follower_energies<S: Scalar>(world: &mut World, u: &[[S; 4]]) -> Option<FollowerEnergies> {
    if !world.contains_resource::<SweptVolumes>() {
        return None;
    }
    evaluate(world, u, true, false, None);
    let energy = world.resource::<ElasticEnergy>();
    Some(FollowerEnergies { load: energy.load, elastic: energy.elastic() })
}
