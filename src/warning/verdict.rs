//! Whether a run is to be trusted.

use super::BuiltBodies;
use super::totals::RunTotals;
use bevy_ecs::prelude::*;
use sinew_engine::report::VolumeReport;
use sinew_models::body::{Model, SoftBody};
use sinew_models::material::YoungPoisson;
use sinew_solvers::settings::{Integrator, SolverSettings};

/// Why a run is not to be trusted, although every step was carried out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Untrusted {
    /// Bodies were halted in too many steps.
    #[error(
        "in {halted} of {steps} steps a body was halted because no state of lower energy was found, so it hardly moved; {}",
        if *.by_contact {
            "contact was not found within its rounds there, or bodies lie in each other: let them start apart, move tools more \
             slowly, or use a smaller dt or a smaller stiffness of tools and contacts"
        } else {
            "loads, motions or units are far beyond what the material holds: make them smaller, or use a smaller dt"
        }
    )]
    Halted {
        /// Steps in which a body was halted.
        halted: u64,
        /// Whether in most of them contact was not found, or bodies lay in each other.
        by_contact: bool,
        /// Steps carried out.
        steps: u64,
    },
    /// An equilibrium that was asked for was not found.
    #[error(
        "no equilibrium found in {unconverged} of {steps} steps (last Newton step {newton_step:.1e} of the body size): \
         apply the loads in more parts (load_steps), or raise max_newton_iterations"
    )]
    NoEquilibrium {
        /// Steps without one.
        unconverged: u64,
        /// Steps carried out.
        steps: u64,
        /// Length of the largest last Newton step over body size.
        newton_step: f64,
    },
    /// An iteration that is to converge did not in too many steps.
    #[error(
        "integrator {} did not converge in {unconverged} of {steps} steps, in {in_contact} of them with something in contact; \
         use integrator = \"auto\" or \"safe\", or a smaller dt", .integrator.name()
    )]
    NotConverged {
        /// The integrator.
        integrator: Integrator,
        /// Steps in which it did not.
        unconverged: u64,
        /// Those of them with something in contact: it took steps of first order then.
        in_contact: u64,
        /// Steps carried out.
        steps: u64,
    },
    /// Forces of contact were not found too often.
    #[error(
        "forces did not converge in {missed} of the {touching} steps in which something touched; use integrator = \"auto\" or \
         \"safe\", a smaller dt, or a smaller stiffness of tools and contacts"
    )]
    Forces {
        /// Steps that did not converge while something touched or pulled.
        missed: u64,
        /// Steps in which something touched.
        touching: u64,
    },
    /// Too many elements are, or were, inside out.
    #[error(
        "{inverted} of {elements} elements {} inside out; loads, motions or units are beyond what the material holds: make \
         them smaller or slower", if *.now { "are" } else { "were" }
    )]
    InsideOut {
        /// Elements that are, or the most that were at one time.
        inverted: u64,
        /// All solid elements.
        elements: u64,
        /// Whether they still are.
        now: bool,
    },
    /// Bodies stored more energy than tissue can.
    #[error(
        "the bodies stored up to {stored:.2e} J, {:.1} times what a strain of one everywhere takes; no tissue holds that: make \
         loads and motions smaller, and check their units", .stored / .whole
    )]
    BeyondHold {
        /// Largest elastic energy (J).
        stored: f64,
        /// That of a strain of one everywhere (J).
        whole: f64,
    },
    /// There is more energy than was put in.
    #[error(
        "the bodies end with {gain:.2e} J more than the {put_in:.2e} J that loads and motions put in; use a smaller dt or \
         integrator = \"safe\""
    )]
    Energy {
        /// Energy from nowhere (J).
        gain: f64,
        /// Energy that was put in (J).
        put_in: f64,
    },
}

/// Part of the steps above which a run whose bodies were halted, or whose iteration did not converge, is not to be trusted,
/// and how many there must be.
const OFTEN: (f64, u64) = (0.25, 5);
/// Energy from nowhere, over all that was put in, above which a run is not to be trusted.
const GAIN: f64 = 0.1;
/// Part of the elements that may be inside out: recovery takes a body with more of them for out of shape.
const INSIDE_OUT: f64 = 0.05;
/// Part of the elements that may have been inside out at any time: with more the motion is no longer that of the bodies.
const EVER_INSIDE_OUT: f64 = 0.5;
/// Elastic energy over that of a strain of one everywhere (the modulus of waves, lambda + 2 mu, times the volume), above which
/// no tissue is whole: bodies are then stretched to three or four times their length throughout.
const HELD: f64 = 10.0;

/// Whether the present state of a world can be trusted, as far as the steps that led to it tell; see
/// [`Simulation::verdict`](crate::simulation::Simulation::verdict).
///
/// # Errors
/// Why not.
pub fn verdict(world: &World) -> Result<(), Untrusted> {
    let Some(totals) = world.get_resource::<RunTotals>() else { return Ok(()) };
    let (steps, solver) = (totals.steps, &totals.solver);
    let often = |count: u64| count >= OFTEN.1 && count as f64 > OFTEN.0 * steps as f64;
    let (halted, unconverged) = (solver.halted_steps, solver.unconverged_steps);
    if often(halted) {
        let by_contact = 2 * solver.halted_by_contact > halted;
        return Err(Untrusted::Halted { halted, by_contact, steps });
    }
    let settings = world.get_resource::<SolverSettings>();
    let integrator = settings.map_or_else(Integrator::default, |own| own.integrator);
    if totals.energy.dissipated.is_none() && unconverged > 0 {
        let newton_step = solver.worst_newton_step;
        return Err(Untrusted::NoEquilibrium { unconverged, steps, newton_step });
    }
    if integrator.converges() && often(unconverged) {
        let in_contact = solver.unconverged_in_contact;
        return Err(Untrusted::NotConverged { integrator, unconverged, in_contact, steps });
    }
    // however short the touch was: what is reported of it would hang on the rest
    let (missed, touching) = (totals.contact.missed, totals.contact.touching);
    if missed as f64 > OFTEN.0 * touching as f64 {
        return Err(Untrusted::Forces { missed, touching });
    }
    let report = world.get_resource::<VolumeReport>();
    let elements = report.map_or(0, |report| report.elements_by_body.iter().sum::<u64>());
    let (inverted, most) = (totals.volume.inverted_final, totals.volume.inverted_max);
    if inverted as f64 > INSIDE_OUT * elements as f64 {
        return Err(Untrusted::InsideOut { inverted, elements, now: true });
    }
    if most as f64 > EVER_INSIDE_OUT * elements as f64 {
        return Err(Untrusted::InsideOut { inverted: most, elements, now: false });
    }
    let stored = totals.energy.elastic_max;
    if let Some(whole) = held_energy(world)
        && stored > HELD * whole
    {
        return Err(Untrusted::BeyondHold { stored, whole });
    }
    let Some(dissipated) = totals.energy.dissipated else { return Ok(()) };
    let (gain, put_in) = (-dissipated, totals.energy.put_in());
    // false for NaN
    if gain <= GAIN * put_in { Ok(()) } else { Err(Untrusted::Energy { gain, put_in }) }
}

/// Energy (J) of all bodies at a strain of one; `None` where a size is not known, or springs that are no material decide it.
fn held_energy(world: &World) -> Option<f64> {
    let built = world.get_resource::<BuiltBodies>()?;
    let mut query = world.try_query::<(Entity, &SoftBody)>()?;
    let mut held = 0.0;
    for (entity, soft) in query.iter(world) {
        let own = built.0.iter().find(|own| own.entity == entity)?;
        if own.volume > 0.0 {
            if soft.model == Model::MassSpring {
                return None;
            }
            let field = soft.field();
            let stiffest = field
                .young_modulus
                .into_iter()
                .flatten()
                .copied()
                .fold(field.material.young_modulus, f64::max);
            let material = YoungPoisson { young_modulus: stiffest, ..field.material };
            let lame = material.lame().ok()?;
            held += (lame.lambda + 2.0 * lame.mu + own.fibres) * own.volume;
        }
        if let Some(membrane) = &soft.membrane {
            held += membrane.material.young_modulus * membrane.thickness * own.area;
        }
    }
    (held > 0.0).then_some(held)
}
