//! States of a simulation, kept and taken up again.

use crate::embedding::Embedding;
use crate::error::Result;
use crate::handle::{Handles, Kind, Target};
use bevy_ecs::entity::Entity;
use bevy_ecs::query::AnyOf;
use sinew::engine::load::{Constraint, Load, Pressure};
use sinew::engine::order::Order;
use sinew::engine::step::StepClock;
use sinew::engine::time::Gravity;
use sinew::solvers::settings::SolverSettings;
use sinew::touch::pair::BodyContact;
use sinew::touch::pull::Pull;
use sinew::touch::thread::{Clip, Thread};
use sinew::touch::tool::Tool;
use sinew_scene::assemble::{BuiltScene, BuiltThread, SceneSnapshot};
use std::collections::BTreeMap;

/// A state of a simulation: everything that the steps to come depend on. Clones share their data.
///
/// ```
/// use sinew_embed::*;
///
/// let mesh = mesh_from_generator("box = { size = [0.2, 0.1, 0.1], cells = [4, 2, 2] }")?;
/// let mut simulation = Embedding::new(&Options::default())?;
/// let body = simulation.add_body(&mesh, &BodyDescription::new("box", &mesh, preset("liver")?))?;
/// let wall = simulation.group(body, "x0")?;
/// simulation.add_constraint(body, &ConstraintSpec::hold("wall", &wall))?;
/// let start = simulation.snapshot()?;
/// simulation.step(5)?;
/// let hash = simulation.hash();
/// simulation.restore(&Snapshot::from_bytes(&start.to_bytes())?)?;
/// assert_eq!(simulation.steps_done(), 0);
/// simulation.step(5)?;
/// assert_eq!(simulation.hash(), hash);
/// # Ok::<(), EmbedError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Snapshot {
    scene: SceneSnapshot,
    /// Handles of the simulation that it was taken of, with the order of the entities that they lead to.
    handles: Option<(u64, Handles, Orders)>,
}

type Orders = BTreeMap<Entity, Order>;

impl Snapshot {
    /// As bytes, for a file.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.scene.to_bytes()
    }

    /// Reads what [`Snapshot::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`Code::Snapshot`](crate::Code::Snapshot) when they are anything else.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        Ok(Self { scene: SceneSnapshot::from_bytes(bytes)?, handles: None })
    }

    /// Steps that were done.
    pub fn step(&self) -> u64 {
        self.scene.simulation.header().step
    }

    /// Simulated time (s).
    pub fn time(&self) -> f64 {
        self.scene.simulation.header().time
    }
}

impl Embedding {
    /// Everything that the steps to come depend on.
    ///
    /// # Errors
    /// [`Code::Snapshot`](crate::Code::Snapshot) on a graphics processor.
    pub fn snapshot(&mut self) -> Result<Snapshot> {
        let scene = self.built.snapshot()?;
        let handles = Some((self.number(), self.handles.clone(), self.orders()));
        Ok(Snapshot { scene, handles })
    }

    /// Takes up a state of this simulation, or of one that was built in the same way: by the same calls, or from the same
    /// scene. In the same simulation handles of what was removed since are good again, and those of what was added
    /// since are not; in another one handles of what the state does not have are
    /// stale, and what it has more gets handles, which [`Embedding::find`] gives.
    ///
    /// # Errors
    /// [`Code::Snapshot`](crate::Code::Snapshot) when the state is of another simulation or damaged; nothing is changed then.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<()> {
        let before = self.orders();
        self.built.restore(&snapshot.scene)?;
        let orders = match &snapshot.handles {
            Some((number, handles, orders)) if *number == self.number() => {
                self.handles = handles.clone();
                orders.clone()
            }
            _ => before,
        };
        let now: BTreeMap<Order, Entity> =
            self.orders().into_iter().map(|(entity, order)| (order, entity)).collect();
        self.handles.redirect(|target| match target {
            Target::Entity(entity) => {
                let entity = orders.get(&entity).and_then(|order| now.get(order));
                entity.map(|entity| Target::Entity(*entity))
            }
            other => Some(other),
        });
        for tool in &mut self.built.tools {
            let entity = orders.get(&tool.entity).and_then(|order| now.get(order));
            tool.entity = entity.copied().unwrap_or(tool.entity);
        }
        self.buffers.iter_mut().for_each(|own| own.forget_surface());
        self.add_missing_handles();
        let world = self.built.simulation.world();
        let gravity = world.resource::<Gravity>().0;
        self.built.plan.dt = world.resource::<StepClock>().dt;
        self.built.plan.settings = world.resource::<SolverSettings>().clone();
        if !self.is_static() {
            self.built.plan.gravity = gravity;
        }
        self.epoch += 1;
        self.publish();
        self.record_anew()
    }

    /// Handles for what acts on bodies and has none, which another simulation added.
    fn add_missing_handles(&mut self) {
        let world = self.built.simulation.world_mut();
        let mut query = world.query::<(
            Entity,
            &Order,
            AnyOf<(&Constraint, &Load, &Pressure, &Tool, &Pull, &BodyContact, &Thread, &Clip)>,
        )>();
        let mut found: Vec<(Order, Kind, String, Entity)> = query
            .iter(world)
            .filter_map(|(entity, order, own)| {
                let (constraint, load, pressure, tool, pull, contact, thread, clip) = own;
                let names = [
                    (Kind::Constraint, constraint.map(|c| &c.name)),
                    (Kind::Load, load.map(|l| &l.name)),
                    (Kind::Pressure, pressure.map(|p| &p.name)),
                    (Kind::Tool, tool.map(|t| &t.name)),
                    (Kind::Pull, pull.map(|p| &p.name)),
                    (Kind::Contact, contact.map(|c| &c.name)),
                    (Kind::Thread, thread.map(|t| &t.name)),
                    (Kind::Clip, clip.map(|c| &c.name)),
                ];
                let named = names.into_iter().find_map(|(kind, name)| Some((kind, name?)));
                named.map(|(kind, name)| (*order, kind, name.clone(), entity))
            })
            .collect();
        found.sort_by_key(|(order, ..)| *order);
        for (_, kind, name, entity) in found {
            let BuiltScene { pulls, strands, clips, .. } = &self.built;
            let lines = strands.iter().chain(clips).map(BuiltThread::entity);
            let mut driven = pulls.iter().map(|pull| pull.entity()).chain(lines);
            let of_scene = driven.any(|own| own == Some(entity));
            if !of_scene && !self.handles.lead_to(entity) {
                self.handles.add(kind, name, Target::Entity(entity));
            }
        }
    }

    fn orders(&mut self) -> Orders {
        let world = self.built.simulation.world_mut();
        world.query::<(Entity, &Order)>().iter(world).map(|(e, order)| (e, *order)).collect()
    }
}
