//! Activation of muscles, and volumes, for [`Simulation`].

use crate::simulation::{BodyHandle, Precision, Simulation};
use sinew_engine::columns::single_table;
use sinew_engine::element::{
    RestVolume, ShapeGradients, TetrahedronVertices, displacement_gradient, volume_change,
};
use sinew_engine::isoparametric::{Derivatives, HexahedronRest, HexahedronVertices};
use sinew_engine::scalar::{Scalar, xyz};
use sinew_engine::step::hexahedron_ratios;
use sinew_engine::vertex::{BodyId, Displacement};
use sinew_models::axes::muscle::{ActivationError, ActivationWork, Muscles};

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

    /// Energy (J) that changes of activation put into fibres: work from outside, which
    /// [`StepReport`](sinew_engine::report::StepReport) counts as energy at the start of the step.
    pub fn activation_work(&self) -> ActivationWork {
        self.world().get_resource().copied().unwrap_or_default()
    }

    /// Volume (m^3) of the solid elements of a body as it is now, counting inverted ones negative.
    pub fn volume(&mut self, body: BodyHandle) -> f64 {
        match self.precision() {
            Precision::F64 => volume::<f64>(self, body),
            Precision::F32 => volume::<f32>(self, body),
        }
    }
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
    let derivatives = &Derivatives::hexahedron();
    let mut hexahedra = world.query::<(&HexahedronVertices, &HexahedronRest<S>, &BodyId)>();
    let Some(u) = single_table(vertices.contiguous_iter(world)) else { return sum };
    for (nodes, rest, of) in hexahedra.iter(world) {
        if of.0 as usize == body.0 {
            let ratios = hexahedron_ratios(derivatives, u, *nodes, rest);
            let points = ratios.iter().zip(&rest.volume);
            sum += points.map(|(ratio, volume)| ratio * volume.to_f64()).sum::<f64>();
        }
    }
    sum
}
