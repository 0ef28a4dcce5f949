//! Active fibres: a muscle is an axis family of a body with an activation from 0 to 1, given by a curve in
//! time or set between steps.
//!
//! With activation `a` and stretch `l = |F a_0|` the stress along the fibre (force over rest area) is
//!
//! ```text
//! Y (1 + s a) (l - (1 - c a)) + T a f_l(l),   f_l = max(0, 1 - ((l - l_opt)/w)^2)          Pa
//! ```
//!
//! the derivative of an energy in closed form ([`Fibre`](super::element::Fibre)). An activation holds for a
//! whole step, with the value of the step's end. A change of it changes the energy at the same displacements;
//! the jump is work from outside, booked in [`ActivationWork`].

use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::columns::single_table;
use sinew_engine::isoparametric::{
    AxisHexahedronBlocks, AxisHexahedronVertices, AxisTetrahedron10Blocks,
    AxisTetrahedron10Vertices,
};
use sinew_engine::law::{EvaluationRequest, LawBuffers};
use sinew_engine::load::Curve;
use sinew_engine::resource::{ensure, put, take};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{Evaluation, StepSchedule, StepSystems};
use sinew_engine::step::StepClock;
use sinew_engine::vertex::Displacement;

use super::columns::*;
use super::{points, systems};
use crate::frame::hexahedra::{Brick, TenNodes};

/// What activation does to fibres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MuscleSettings {
    /// Active stress `T` at full activation and optimal stretch (Pa).
    pub peak_stress: f64,
    /// Stretch `l_opt` at which it is largest (-).
    pub optimal_stretch: f64,
    /// Half width `w` of the length-tension curve (-): no active stress at `l_opt - w` and `l_opt + w`.
    pub width: f64,
    /// `s`: relative growth of the modulus at full activation (-).
    pub stiffening: f64,
    /// `c`: relative shortening of the rest length at full activation (-), below 1.
    pub shortening: f64,
    /// Activation over time, held within 0 and 1; without it what [`Muscles::set_activation`] said last.
    pub curve: Option<Curve>,
}

impl Default for MuscleSettings {
    /// No active stress, its curve around the rest length with a half width of 0.5.
    fn default() -> Self {
        Self {
            peak_stress: 0.0,
            optimal_stretch: 1.0,
            width: 0.5,
            stiffening: 0.0,
            shortening: 0.0,
            curve: None,
        }
    }
}

/// Settings that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("`{quantity}` is {value}; it must be {range}")]
pub struct MuscleError {
    /// Which one.
    pub quantity: &'static str,
    /// Its value.
    pub value: f64,
    /// What it may be.
    pub range: &'static str,
}

impl MuscleSettings {
    pub(crate) fn validate(&self) -> Result<(), MuscleError> {
        let checks = [
            ("peak_stress", self.peak_stress, 0.0..=f64::MAX, "finite and not negative"),
            ("optimal_stretch", self.optimal_stretch, f64::MIN_POSITIVE..=f64::MAX, "positive"),
            ("width", self.width, f64::MIN_POSITIVE..=f64::MAX, "positive and finite"),
            ("stiffening", self.stiffening, -1.0..=f64::MAX, "finite and at least -1"),
            ("shortening", self.shortening, -1.0..=0.999, "between -1 and 0.999"),
        ];
        for (quantity, value, allowed, range) in checks {
            if !allowed.contains(&value) {
                return Err(MuscleError { quantity, value, range });
            }
        }
        if let Some(Curve::Points(points)) = &self.curve {
            let range = "a list of finite [time, activation] pairs in order of time";
            let ordered = points.windows(2).all(|p| p[0][0] <= p[1][0]);
            let finite = points.iter().flatten().all(|x| x.is_finite());
            if points.is_empty() || !ordered || !finite {
                return Err(MuscleError { quantity: "curve", value: f64::NAN, range });
            }
            if let Some(p) = points.iter().find(|p| !(0.0..=1.0).contains(&p[1])) {
                let range = "between 0 and 1, as an activation";
                return Err(MuscleError { quantity: "curve", value: p[1], range });
            }
        }
        Ok(())
    }
}

/// An active family of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Muscle {
    /// Index of the body.
    pub body: usize,
    /// Name of the family.
    pub family: String,
    /// What activation does.
    pub settings: MuscleSettings,
    /// Activation (0 to 1) asked for; a curve overwrites it.
    wanted: f64,
    /// Activation that the columns hold.
    applied: f64,
}

impl Muscle {
    /// Activation (0 to 1) that acts.
    pub fn activation(&self) -> f64 {
        self.applied
    }

    /// Stiffness at the activation that acts, from that without activation.
    pub(crate) fn stiffened<S: Scalar>(&self, passive: S) -> S {
        passive * S::from_f64(1.0 + self.settings.stiffening * self.applied)
    }

    pub(crate) fn new(body: usize, family: String, settings: MuscleSettings) -> Self {
        Self { body, family, settings, wanted: 0.0, applied: 0.0 }
    }
}

/// All muscles of a world, in the order in which bodies were spawned.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct Muscles(pub(crate) Vec<Muscle>);

/// Activations of all muscles: asked for, and acting.
pub type Activations = Vec<[f64; 2]>;

/// An activation that cannot be set.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ActivationError {
    /// No such muscle.
    #[error("body {body} has no active family `{family}`; it has {known:?}")]
    Unknown {
        /// Index of the body.
        body: usize,
        /// Name that was asked for.
        family: String,
        /// Names that there are.
        known: Vec<String>,
    },
    /// Out of range.
    #[error("activation {value} of family `{family}` is not between 0 and 1")]
    Range {
        /// Name of the family.
        family: String,
        /// The value.
        value: f64,
    },
    /// It follows a curve.
    #[error("family `{family}` follows a curve of time; leave the curve out to set its activation")]
    Curve {
        /// Name of the family.
        family: String,
    },
}

impl Muscles {
    /// Sets all activations asked for, those that curves give too, as [`Muscles::memory`] gave them.
    pub fn want(&mut self, activations: &[f64]) {
        for (muscle, wanted) in self.0.iter_mut().zip(activations) {
            muscle.wanted = *wanted;
        }
    }

    /// All activations.
    pub fn memory(&self) -> Activations {
        self.0.iter().map(|muscle| [muscle.wanted, muscle.applied]).collect()
    }

    /// The muscles.
    pub fn iter(&self) -> impl Iterator<Item = &Muscle> {
        self.0.iter()
    }

    /// Sets the activation of an active family from the next step on.
    ///
    /// # Errors
    /// When there is no such muscle, it follows a curve, or the value is not between 0 and 1.
    pub fn set_activation(
        &mut self,
        body: usize,
        family: &str,
        value: f64,
    ) -> Result<(), ActivationError> {
        let Some(at) = self.0.iter().position(|m| m.body == body && m.family == family) else {
            let own = self.0.iter().filter(|m| m.body == body);
            let known = own.map(|m| m.family.clone()).collect();
            return Err(ActivationError::Unknown { body, family: family.to_string(), known });
        };
        if !(0.0..=1.0).contains(&value) {
            return Err(ActivationError::Range { family: family.to_string(), value });
        }
        let muscle = &mut self.0[at];
        if muscle.settings.curve.is_some() {
            return Err(ActivationError::Curve { family: family.to_string() });
        }
        muscle.wanted = value;
        Ok(())
    }
}

/// Energy (J) that changes of activation put into the fibres (negative: took out), at unchanged displacements:
/// work from outside, like that of loads.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ActivationWork {
    /// During the last step.
    pub step: f64,
    /// Since the muscles were made.
    pub total: f64,
}

/// Puts the system that follows curves into the step, once.
pub(crate) fn install<S: Scalar>(world: &mut World) {
    if world.contains_resource::<Muscles>() {
        return;
    }
    ensure::<Muscles>(world);
    ensure::<ActivationWork>(world);
    if let Some(mut schedules) = world.get_resource_mut::<Schedules>() {
        // alone between the two stages, so that it is ordered against whatever Prepare holds
        schedules.entry(StepSchedule).add_systems(
            update::<S>
                .after(StepSystems::Prepare)
                .before(StepSystems::Integrate)
                // systems of the whole world always conflict; those here share no data with this one
                .ambiguous_with_all(),
        );
    }
}

/// Sets the activations that curves ask for at a time (s); says whether any activation has to change.
fn follow_curves(world: &mut World, time: f64) -> bool {
    let Some(mut muscles) = world.get_resource_mut::<Muscles>() else { return false };
    let mut changed = false;
    for muscle in &mut muscles.bypass_change_detection().0 {
        if let Some(curve) = &muscle.settings.curve {
            // a curve that is not a number leaves the muscle alone
            let value = curve.value(time).clamp(0.0, 1.0);
            muscle.wanted = if value.is_nan() { muscle.wanted } else { value };
        }
        changed |= muscle.wanted != muscle.applied;
    }
    changed
}

/// Gives all muscles the activation of a time (s) now, outside of a step: for evaluations at states of
/// other times.
pub fn activate_at<S: Scalar>(world: &mut World, time: f64) {
    if follow_curves(world, time) {
        apply::<S>(world);
    }
}

fn update<S: Scalar>(world: &mut World) {
    let clock = *world.resource::<StepClock>();
    let mut work = 0.0;
    if follow_curves(world, clock.time + clock.dt) {
        let before = energy::<S>(world);
        apply::<S>(world);
        work = energy::<S>(world) - before;
    }
    let mut booked = world.resource_mut::<ActivationWork>();
    booked.step = work;
    booked.total += work;
}

/// Takes up the activations of a world of the same muscles.
pub fn recall<S: Scalar>(world: &mut World, activations: &Activations) {
    let Some(mut muscles) = world.get_resource_mut::<Muscles>() else { return };
    if muscles.memory() == *activations {
        return;
    }
    for (muscle, [_, applied]) in muscles.0.iter_mut().zip(activations) {
        muscle.wanted = *applied;
    }
    apply::<S>(world);
    let mut muscles = world.resource_mut::<Muscles>();
    for (muscle, [wanted, _]) in muscles.0.iter_mut().zip(activations) {
        muscle.wanted = *wanted;
    }
}

/// Writes the activations that act into the columns of all fibres, which may hold others.
pub(crate) fn apply_all<S: Scalar>(world: &mut World) {
    let Some(mut muscles) = world.get_resource_mut::<Muscles>() else { return };
    let wanted: Vec<f64> = muscles.0.iter().map(|muscle| muscle.wanted).collect();
    for muscle in &mut muscles.0 {
        muscle.wanted = std::mem::replace(&mut muscle.applied, f64::NAN);
    }
    apply::<S>(world);
    let mut muscles = world.resource_mut::<Muscles>();
    muscles.0.iter_mut().zip(wanted).for_each(|(muscle, wanted)| muscle.wanted = wanted);
}

/// Writes the activations asked for into the columns of the fibres.
pub(crate) fn apply<S: Scalar>(world: &mut World) {
    if !world.contains_resource::<Muscles>() {
        return;
    }
    let mut muscles = take::<Muscles>(world);
    let changed: Vec<bool> = muscles.0.iter().map(|m| m.wanted != m.applied).collect();
    for muscle in &mut muscles.0 {
        muscle.applied = muscle.wanted;
    }
    let mut fibres = world.query::<(
        &MuscleIndex,
        (&PassiveStiffness<S>, &PeakTension<S>),
        (&mut AxialStiffness<S, 0>, &mut FibreShortening<S>, &mut FibreActive<S>),
    )>();
    for (index, (passive, peak), (mut stiffness, mut shortening, mut active)) in
        fibres.iter_mut(world)
    {
        let at = index.0 as usize;
        if !changed.get(at).is_some_and(|&c| c) {
            continue;
        }
        let Muscle { settings, applied, .. } = &muscles.0[at];
        stiffness.0 = muscles.0[at].stiffened(passive.0);
        shortening.0 = S::from_f64(settings.shortening * applied);
        active.0 = peak.0 * S::from_f64(*applied);
    }
    put(world, muscles);
}

/// Writes the activation that acts into the columns of a fibre whose peak tension and passive stiffness are others now, as
/// [`apply`] would.
pub(crate) fn refresh<S: Scalar>(fibre: &mut EntityWorldMut) {
    let own = fibre.get::<MuscleIndex>().map(|own| own.0 as usize);
    let (Some(at), Some(passive), Some(peak)) =
        (own, fibre.get::<PassiveStiffness<S>>(), fibre.get::<PeakTension<S>>())
    else {
        return;
    };
    let muscles = fibre.world().get_resource::<Muscles>();
    let Some(muscle) = muscles.and_then(|all| all.0.get(at)) else { return };
    let (stiffness, active) = (muscle.stiffened(passive.0), peak.0 * S::from_f64(muscle.applied));
    if let Some(mut own) = fibre.get_mut::<AxialStiffness<S, 0>>() {
        own.0 = stiffness;
    }
    if let Some(mut own) = fibre.get_mut::<FibreActive<S>>() {
        own.0 = active;
    }
}

/// Sets activation as asked for, whether or not a curve gives it: for copies of a body.
pub(crate) fn copy_activations<S: Scalar>(world: &mut World, activations: &[(String, f64)]) {
    if let Some(mut muscles) = world.get_resource_mut::<Muscles>() {
        for muscle in &mut muscles.0 {
            let known = activations.iter().find(|(family, _)| *family == muscle.family);
            muscle.wanted = known.map_or(0.0, |(_, a)| *a);
        }
    }
    apply::<S>(world);
}

/// Energy (J) of all fibres at the displacements that the world holds.
fn energy<S: Scalar>(world: &mut World) -> f64 {
    let mut vertices = world.query::<&Displacement<S>>();
    let mut fibres = world.query::<FibreData<S>>();
    let mut in_hexahedra =
        world.query::<points::FibreData<S, AxisHexahedronVertices, AxisHexahedronBlocks, 8>>();
    let mut in_tetrahedra10 =
        world
            .query::<points::FibreData<S, AxisTetrahedron10Vertices, AxisTetrahedron10Blocks, 4>>();
    let request = EvaluationRequest { energy: true, force: false, tangent: None };
    let with = Evaluation {
        request: &request,
        workers: world.resource(),
        recovering: world.resource(),
        points: world.resource(),
    };
    let buffers = world.resource::<LawBuffers<S>>();
    let Some(u) = single_table(vertices.contiguous_iter(world)) else { return 0.0 };
    let at = (u, with.points);
    let mut energy = 0.0;
    if let Some(mut buffer) = buffers.get(systems::FIBRES.info.name)
        && let Some(data) = single_table(fibres.contiguous_iter(world))
    {
        systems::evaluate(&FibreColumns::new(u, data), with, &mut buffer);
        energy += buffer.energy();
    }
    if let Some(mut buffer) = buffers.get(points::FIBRES.info.name)
        && let Some(data) = single_table(in_hexahedra.contiguous_iter(world))
    {
        points::evaluate(&points::FibreColumns::new::<Brick>(at, data), with, &mut buffer);
        energy += buffer.energy();
    }
    if let Some(mut buffer) = buffers.get(points::FIBRES10.info.name)
        && let Some(data) = single_table(in_tetrahedra10.contiguous_iter(world))
    {
        points::evaluate(&points::FibreColumns::new::<TenNodes>(at, data), with, &mut buffer);
        energy += buffer.energy();
    }
    energy
}
