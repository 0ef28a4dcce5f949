//! Bodies of a [`Simulation`] that tear.

use crate::simulation::{BodyHandle, Simulation};
use bevy_ecs::prelude::*;
use sinew_engine::order::Order;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{StepSchedule, StepSystems};
use sinew_engine::step::{StepClock, StepError, StepFailure, may_edit};
use sinew_models::cutting::CutError;
use sinew_models::cutting::tear::{Tear, TearReport, check_tear, tear_body};

/// Lets bodies tear, from the first of them on.
pub(crate) fn install_tears<S: Scalar>(world: &mut World) {
    let tear = tear_bodies::<S>
        .in_set(StepSystems::Edit)
        .after(crate::blade::Blades)
        .run_if(any_with_component::<Tear>);
    world.resource_mut::<Schedules>().entry(StepSchedule).add_systems(tear);
}

fn tear_bodies<S: Scalar>(world: &mut World) {
    if world.resource::<StepFailure>().0.is_some() || !may_edit::<S>(world) {
        return;
    }
    let dt = world.resource::<StepClock>().dt;
    let mut query = world.query::<(&Order, Entity, &Tear, &TearReport)>();
    let mut all: Vec<_> = query.iter(world).map(|(a, b, c, d)| (*a, b, *c, *d)).collect();
    all.sort_unstable_by_key(|(order, entity, ..)| (*order, *entity));
    for (_, entity, tear, mut report) in all {
        match tear_body::<S>(world, &tear, &mut report, dt) {
            Ok(()) => {
                if let Some(mut own) = world.get_mut::<TearReport>(entity) {
                    *own = report;
                }
            }
            Err(error) => {
                world.resource_mut::<StepFailure>().0 =
                    Some(StepError::Tear { problem: error.to_string() });
                return;
            }
        }
    }
}

/// # Tears
impl Simulation {
    /// Lets a solid, or a membrane of triangles alone, tear where the tension in it, averaged over a ball, is above its strength: at
    /// the end of its wounds, and at its surface. [`sinew_models::cutting::tear`] says how; the body needs
    /// [spare](sinew_models::body::BodyDescription::spare) vertices. What was given before is replaced, and its report goes on.
    ///
    /// Linear tetrahedra miss a fifth and more of the opening of a wound on usual meshes: a tear comes to a halt sooner than on a fine one.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    ///
    /// let mesh = box_tets(DVec3::new(0.06, 0.02, 0.01), [12, 4, 2])?;
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let strip = BodyDescription::new("strip", &mesh, preset("liver")?.material);
    /// let body = simulation.add_body(&BodyDescription { spare: 300, ..strip })?;
    /// simulation.set_gravity(DVec3::ZERO);
    /// for (end, way) in [("x0", -0.01), ("x1", 0.01)] {
    ///     let rows = simulation.group_rows(body, &mesh, end)?;
    ///     let motion = Motion::Translate(DVec3::X * way);
    ///     let ramp = Curve::Points(vec![[0.0, 0.0], [0.5, 1.0]]);
    ///     simulation.add_constraint(Constraint::moving(end, rows, motion, ramp));
    /// }
    /// // less than what the strip comes to
    /// let tear = Tear { body: body.0, strength: 800.0, toughness: None, radius: Some(0.008), max_speed: None };
    /// simulation.set_tear(tear)?;
    /// for _ in 0..60 {
    ///     simulation.step()?;
    /// }
    /// let report = simulation.tear_report(body).ok_or("it does not tear")?;
    /// assert!(report.pieces >= 2 && report.area > 0.9 * 0.02 * 0.01, "{report:?}");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// When the body cannot tear, or a number cannot be used; nothing is changed then.
    pub fn set_tear(&mut self, tear: Tear) -> Result<Entity, CutError> {
        self.check_cut(BodyHandle(tear.body))?;
        let world = self.world_mut();
        let tear = check_tear(world, &tear)?;
        let mut query = world.query::<(Entity, &Tear)>();
        let known =
            query.iter(world).find(|(_, own)| own.body == tear.body).map(|(entity, _)| entity);
        Ok(match known {
            Some(entity) => world.entity_mut(entity).insert(tear).id(),
            None => world.spawn(tear).id(),
        })
    }

    /// Lets a body tear no more; whether it did.
    pub fn remove_tear(&mut self, body: BodyHandle) -> bool {
        let world = self.world_mut();
        let mut query = world.query::<(Entity, &Tear)>();
        let known = query.iter(world).find(|(_, own)| own.body == body.0).map(|own| own.0);
        known.is_some_and(|entity| world.despawn(entity))
    }

    /// What tears of a body did up to the last step; `None` when it does not tear.
    pub fn tear_report(&self, body: BodyHandle) -> Option<TearReport> {
        let mut query = self.world().try_query::<(&Tear, &TearReport)>()?;
        query.iter(self.world()).find(|(tear, _)| tear.body == body.0).map(|(_, report)| *report)
    }
}
