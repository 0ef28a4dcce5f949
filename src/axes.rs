//! Axes of bodies, activation of muscles, and volumes, for [`Simulation`].

use crate::simulation::{BodyHandle, Simulation, SimulationError};
use bevy_ecs::prelude::World;
use sinew_engine::by_precision;
use sinew_engine::resource::ensure;
use sinew_engine::scalar::Scalar;
use sinew_models::axes::description::AxesError;
use sinew_models::axes::muscle::{ActivationError, ActivationWork, Muscles};
use sinew_models::body::axis_modulus::set_axis_modulus;
use sinew_solvers::explicit::forget_steps;
use sinew_solvers::implicit::forget_matrices;

/// # Fibres, muscles and volume
impl Simulation {
    /// Sets the activation (0 to 1) of an active axis family of a body, from the next step on.
    ///
    /// # Errors
    /// When there is no such family, it follows a curve, or the value is out of range.
    pub fn set_activation(
        &mut self,
        body: BodyHandle,
        family: &str,
        activation: f64,
    ) -> Result<(), ActivationError> {
        let mut muscles = ensure::<Muscles>(self.world_mut());
        muscles.set_activation(body.0, family, activation)
    }

    /// Gives a family of axes of a body another modulus (Pa), between steps; returns by how much that changes
    /// the elastic energy (J) at the same displacements, which is work from outside. What solvers remember is
    /// forgotten.
    ///
    /// # Errors
    /// When there is no such family or the modulus cannot be used; nothing is changed then.
    ///
    /// # Panics
    /// As [`Simulation::evaluate`].
    pub fn set_axis_modulus(
        &mut self,
        body: BodyHandle,
        family: &str,
        modulus: f64,
    ) -> Result<f64, SimulationError> {
        let before = self.evaluate();
        let precision = self.precision();
        let world = self.world_mut();
        by_precision!(precision, set(world, body, family, modulus)).map_err(|source| {
            let body = self.topology().bodies[body.0].name.clone();
            SimulationError::Axes { body, source }
        })?;
        Ok(self.evaluate() - before)
    }

    /// Energy (J) that changes of activation put into fibres: work from outside, which
    /// [`StepReport`](sinew_engine::report::StepReport) counts as energy at the start of the step.
    pub fn activation_work(&self) -> ActivationWork {
        self.world().get_resource().copied().unwrap_or_default()
    }

    /// Volume (m^3) of the solid elements of a body as it is now, counting inverted ones negative.
    pub fn volume(&mut self, body: BodyHandle) -> f64 {
        let mut sum = 0.0;
        self.each_element(body, |e| {
            if e.kind.is_solid() {
                let points = e.ratios.iter().zip(e.sizes);
                sum += points.map(|(ratio, volume)| ratio * volume).sum::<f64>();
            }
        });
        sum
    }
}

fn set<S: Scalar>(
    world: &mut World,
    body: BodyHandle,
    family: &str,
    modulus: f64,
) -> Result<(), AxesError> {
    set_axis_modulus::<S>(world, body.0, family, modulus)?;
    forget_steps::<S>(world);
    forget_matrices::<S>(world);
    Ok(())
}
