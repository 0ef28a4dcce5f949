//! Snapshots: everything that the steps to come depend on, taken, stored and taken up again.

use crate::embedding::Embedding;
use crate::error::Result;
use crate::handle::{Kind, Target};
use bevy_ecs::entity::Entity;
use bevy_ecs::world::World;
use sinew::engine::load::{Constraint, Load, Pressure};
use sinew::engine::order::Order;
use sinew::engine::step::StepClock;
use sinew::engine::time::Gravity;
use sinew::solvers::settings::SolverSettings;
use sinew::touch::pair::BodyContact;
use sinew::touch::pull::Pull;
use sinew::touch::tool::Tool;
use sinew_demos::build::SceneSnapshot;
use std::collections::HashSet;

/// The state of a simulation at one time.
#[derive(Clone, Debug)]
pub struct Snapshot(SceneSnapshot);

impl Snapshot {
    /// As bytes, for a file.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.0.to_bytes()
    }

    /// Reads what [`Snapshot::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`Code::Snapshot`](crate::Code::Snapshot) when they are anything else.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        Ok(Self(SceneSnapshot::from_bytes(bytes)?))
    }
}

impl Embedding {
    /// The state as it is.
    ///
    /// # Errors
    /// When state is kept on a graphics processor.
    pub fn snapshot(&mut self) -> Result<Snapshot> {
        Ok(Snapshot(self.built.snapshot()?))
    }

    /// Takes up a state of this simulation, or of one built alike. What was added since is gone; what was removed since is
    /// there again, under a new handle that [`Embedding::find`] tells.
    ///
    /// # Errors
    /// When it is of another scene, precision or instruction set, or damaged; nothing is changed then.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<()> {
        self.built.restore(&snapshot.0)?;
        self.epoch += 1;
        // counts of removals went back, too
        self.buffers.iter_mut().for_each(|own| own.forget_surface());
        let still = self.is_static();
        let world = self.built.simulation.world();
        self.built.plan.dt = world.resource::<StepClock>().dt;
        if let Some(settings) = world.get_resource::<SolverSettings>() {
            self.built.plan.settings = settings.clone();
        }
        if !still {
            self.built.plan.gravity = world.resource::<Gravity>().0;
        }
        self.name_again();
        Ok(())
    }

    /// Makes handles those of what is there.
    fn name_again(&mut self) {
        let world = self.built.simulation.world_mut();
        let there: Vec<(Entity, Kind, String)> = acting(world);
        let left: HashSet<Entity> = there.iter().map(|(entity, ..)| *entity).collect();
        self.handles.retain(|target| match target {
            Target::Entity(entity) => left.contains(&entity),
            Target::Body(_) | Target::ScenePull(_) => true,
        });
        self.built.tools.retain(|tool| left.contains(&tool.entity));
        let own: HashSet<Entity> = self.built.pulls.iter().filter_map(|p| p.entity()).collect();
        for (entity, kind, name) in there {
            if !own.contains(&entity) && !self.handles.knows(entity) {
                self.handles.add(kind, name, Target::Entity(entity));
            }
        }
    }
}

/// What acts on bodies, in the order in which it was made.
fn acting(world: &mut World) -> Vec<(Entity, Kind, String)> {
    let mut query = world.query::<(
        Entity,
        Option<&Order>,
        Option<&Constraint>,
        Option<&Load>,
        Option<&Pressure>,
        Option<&Tool>,
        Option<&Pull>,
        Option<&BodyContact>,
    )>();
    let mut found: Vec<(Option<Order>, Entity, Kind, String)> = query
        .iter(world)
        .filter_map(|(entity, order, constraint, load, pressure, tool, pull, contact)| {
            let named = [
                (Kind::Constraint, constraint.map(|own| &own.name)),
                (Kind::Load, load.map(|own| &own.name)),
                (Kind::Pressure, pressure.map(|own| &own.name)),
                (Kind::Tool, tool.map(|own| &own.name)),
                (Kind::Pull, pull.map(|own| &own.name)),
                (Kind::Contact, contact.map(|own| &own.name)),
            ];
            let (kind, name) = named.into_iter().find_map(|(kind, name)| Some((kind, name?)))?;
            Some((order.copied(), entity, kind, name.clone()))
        })
        .collect();
    found.sort_by_key(|(order, entity, ..)| (*order, *entity));
    found.into_iter().map(|(_, entity, kind, name)| (entity, kind, name)).collect()
}
