//! Another modulus for the axes of a body that exists.

use bevy_ecs::prelude::*;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;

use super::change::sum_springs;
use super::description::SoftBody;
use super::edit_log::{Edit, before_edit, log_edit};
use crate::axes::columns::*;
use crate::axes::description::{AxesError, FibreForm, ModulusOf};
use crate::axes::muscle::Muscles;
use crate::frame::rules::Evaluation;

/// Gives a family of axes, or of fibres of the membrane, of body number `body` another modulus (Pa). Displacements, activations and
/// everything else stay.
///
/// What solvers remember is not touched: `sinew::simulation::Simulation::set_axis_modulus` does that too.
///
/// # Errors
/// When there is no such family or the modulus cannot be used; nothing is changed then.
pub fn set_axis_modulus<S: Scalar>(
    world: &mut World,
    body: usize,
    family: &str,
    modulus: f64,
) -> Result<(), AxesError> {
    before_edit::<S>(world);
    let mut bodies = world.query::<&mut SoftBody>();
    let mut families = Vec::new();
    if let Some(soft) = bodies.iter_mut(world).find(|soft| soft.index == body) {
        let soft = soft.into_inner();
        let of_solid =
            soft.axes.as_mut().map_or(&mut [][..], |axes| &mut axes.description.families);
        let pooled = soft.evaluation == Evaluation::Pooled;
        families.extend(of_solid.iter_mut().map(|own| (own, pooled)));
        let pooled = soft.membrane.is_some_and(|membrane| membrane.is_pooled());
        families.extend(soft.sheet_fibres.iter_mut().map(|own| (own, pooled)));
    }
    let Some(index) = families.iter().position(|(own, _)| own.name == family) else {
        let known = families.iter().map(|(own, _)| own.name.to_string()).collect();
        return Err(AxesError::Unknown { family: family.to_string(), known });
    };
    if !(modulus >= 0.0 && modulus.is_finite()) {
        return Err(AxesError::Modulus { of: ModulusOf::Family(family.into()), value: modulus });
    }
    let (own, pooled) = &mut families[index];
    own.modulus = modulus;
    let is_pooled = *pooled && own.form == FibreForm::Biquadratic;
    let muscles = world.get_resource::<Muscles>().cloned().unwrap_or_default();
    let mut entities = world.query::<(
        (&AxisSource, &BodyId, Option<&MuscleIndex>),
        Option<&mut PassiveStiffness<S>>,
        (
            Option<&mut AxialStiffness<S, 0>>,
            Option<&mut AxialStiffness<S, 1>>,
            Option<&mut AxialStiffness<S, 2>>,
        ),
    )>();
    for ((source, id, muscle), passive, (a, b, c)) in entities.iter_mut(world) {
        let Some(axis) = source.family.iter().position(|&f| f as usize == index) else { continue };
        if id.0 as usize != body {
            continue;
        }
        let stiffness = S::from_f64(modulus * source.weight[axis]);
        if let Some(mut passive) = passive {
            passive.0 = stiffness;
        }
        let muscle = muscle.and_then(|muscle| muscles.iter().nth(muscle.0 as usize));
        let stiffness = muscle.map_or(stiffness, |muscle| muscle.stiffened(stiffness));
        match axis {
            0 => a.into_iter().for_each(|mut a| a.0 = stiffness),
            1 => b.into_iter().for_each(|mut b| b.0 = stiffness),
            _ => c.into_iter().for_each(|mut c| c.0 = stiffness),
        }
    }
    if is_pooled {
        sum_springs::<S>(world, body);
    }
    log_edit(world, Edit::AxisModulus { body, family: family.into(), modulus });
    Ok(())
}
