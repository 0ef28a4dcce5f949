//! Axes of bodies, activation of muscles, and volumes, for [`Simulation`].

use crate::simulation::{BodyHandle, Simulation, SimulationError};
use bevy_ecs::prelude::World;
use sinew_engine::by_precision;
use sinew_engine::columns::single_table;
use sinew_engine::element::{
    RestVolume, ShapeGradients, TetrahedronVertices, displacement_gradient, volume_change,
};
use sinew_engine::isoparametric::{
    Derivatives, HexahedronRest, HexahedronVertices, Tetrahedron10Rest, Tetrahedron10Vertices,
};
use sinew_engine::scalar::{Scalar, xyz};
use sinew_engine::step::point_ratios;
use sinew_engine::vertex::{BodyId, Displacement};
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
        let mut muscles = self.world_mut().get_resource_or_init::<Muscles>();
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
        by_precision!(self.precision(), volume(self, body))
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

fn volume<S: Scalar>(simulation: &mut Simulation, body: BodyHandle) -> f64 {
    let world = simulation.world_mut();
    let mut vertices = world.query::<&Displacement<S>>();
    let mut tetrahedra =
        world.query::<(&TetrahedronVertices, ShapeGradients<S>, &RestVolume<S>, &BodyId)>();
    let Some(u) = single_table(vertices.contiguous_iter(world)) else { return 0.0 };
    let mut sum = 0.0;
    for (nodes, (d1, d2, d3), rest, of) in tetrahedra.iter(world) {
        if of.0 as usize == body.0 {
            let gradients =
                [[d1.0.0, d1.1.0, d1.2.0], [d2.0.0, d2.1.0, d2.2.0], [d3.0.0, d3.1.0, d3.2.0]];
            let local = nodes.0.map(|v| xyz(u[v as usize].0));
            let change = volume_change(&displacement_gradient(&gradients, &local)).to_f64();
            sum += rest.0.to_f64() * (1.0 + change);
        }
    }
    let mut hexahedra = world.query::<(&HexahedronVertices, &HexahedronRest<S>, &BodyId)>();
    let mut tens = world.query::<(&Tetrahedron10Vertices, &Tetrahedron10Rest<S>, &BodyId)>();
    let Some(u) = single_table(vertices.contiguous_iter(world)) else { return sum };
    macro_rules! at_points {
        ($elements:expr, $derivatives:expr) => {
            let derivatives = &$derivatives;
            for (nodes, rest, of) in $elements.iter(world) {
                if of.0 as usize == body.0 {
                    let ratios = point_ratios(derivatives, u, &nodes.0, rest);
                    let points = ratios.iter().zip(&rest.volume);
                    sum += points.map(|(ratio, volume)| ratio * volume.to_f64()).sum::<f64>();
                }
            }
        };
    }
    at_points!(hexahedra, Derivatives::hexahedron());
    at_points!(tens, Derivatives::tetrahedron10());
    sum
}
