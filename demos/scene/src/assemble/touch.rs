//! Tools, pulls and contacts of a scene, built, and driven step by step.

use super::threads::BuiltThread;
use bevy_ecs::entity::Entity;
use glam::DVec3;
use sinew::engine::load::Curve;
use sinew::engine::row::VertexRow;
use sinew::engine::time::StepClock;
use sinew::simulation::Simulation;
use sinew::touch::pull::{Pull, PullReport};
use sinew::touch::tool::{Tool, ToolReport};

/// A tool in the simulation.
#[derive(Clone, Debug)]
pub struct BuiltTool {
    /// Name.
    pub name: String,
    /// The tool.
    pub entity: Entity,
    /// What it is and how it moves, in words.
    pub words: String,
    /// Coefficient of friction.
    pub friction: f64,
    /// Times (s) from which until which it grips.
    pub grip: Option<[f64; 2]>,
    /// It finds the force by points of the other kind too.
    pub error_bar: bool,
    /// Number of its parts.
    pub parts: usize,
}

impl BuiltTool {
    /// What it felt in the last step; while it does not touch, no force, and where it would be.
    pub fn report(&self, simulation: &Simulation) -> ToolReport {
        let known = simulation.tool_report(self.entity).cloned().unwrap_or_default();
        let time = simulation.time();
        match simulation.world().get::<Tool>(self.entity) {
            Some(tool) if time == 0.0 || !tool.active(time) => {
                let pose = tool.wanted(time, tool.start);
                ToolReport {
                    position: pose.position,
                    rotation: pose.rotation,
                    opening: pose.opening,
                    centre: pose.position,
                    work: known.work,
                    dissipation: known.dissipation,
                    ..ToolReport::default()
                }
            }
            _ => known,
        }
    }
}

/// Way (m) of a hand since it took hold, over time (s).
#[derive(Clone, Debug)]
pub(super) enum Way {
    /// One curve for every axis.
    Path(Vec<Curve>),
    /// A translation, scaled by a curve.
    Scaled(DVec3, Curve),
}

impl Way {
    fn at(&self, t: f64) -> DVec3 {
        match self {
            Self::Path(axes) => place(axes, t),
            Self::Scaled(by, curve) => *by * curve.value(t),
        }
    }
}

/// Values of the first three curves.
pub(super) fn place(axes: &[Curve], t: f64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|k| axes[k].value(t)))
}

/// A pull of a scene; it is in the simulation while it acts.
#[derive(Clone, Debug)]
pub struct BuiltPull {
    /// Name.
    pub name: String,
    /// Index of the body.
    pub body: usize,
    /// Vertex rows.
    pub rows: Vec<VertexRow>,
    /// Stiffness (N/m) of all of them together.
    pub stiffness: f64,
    /// Damping (N s/m) of all of them together.
    pub damping: f64,
    /// How the hand moves, in words.
    pub motion: String,
    pub(super) way: Way,
    /// Time (s) from which it pulls.
    pub from: f64,
    /// Time (s) after which it lets go.
    pub until: f64,
    pub(super) entity: Option<Entity>,
    /// Work (J) of the hand until it let go.
    pub(super) work: f64,
}

impl BuiltPull {
    pub(super) fn new(
        name: String,
        body: usize,
        rows: Vec<VertexRow>,
        way: Way,
        motion: String,
    ) -> Self {
        let (from, until) = (f64::NEG_INFINITY, f64::INFINITY);
        let (stiffness, damping, work) = (0.0, 0.0, 0.0);
        Self { name, body, rows, stiffness, damping, motion, way, from, until, entity: None, work }
    }

    /// The pull, while it acts.
    pub fn entity(&self) -> Option<Entity> {
        self.entity
    }

    /// Work (J) of the hand until it last let go.
    pub(crate) fn work(&self) -> f64 {
        self.work
    }

    /// Goes on from where a run was.
    pub(crate) fn resume(&mut self, entity: Option<Entity>, work: f64) {
        (self.entity, self.work) = (entity, work);
    }

    /// Way (m) of the hand at a time (s).
    pub(super) fn way_at(&self, t: f64) -> DVec3 {
        self.way.at(t)
    }

    /// What it did in the last step; no force while it does not act.
    pub fn report(&self, simulation: &Simulation) -> PullReport {
        let known = self.entity.and_then(|pull| simulation.pull_report(pull).copied());
        known.unwrap_or(PullReport { work: self.work, ..PullReport::default() })
    }

    /// Takes hold, moves or lets go in the step that ends at `end` (s).
    fn drive(&mut self, simulation: &mut Simulation, end: f64, slack: f64) {
        let acts = end + slack >= self.from && end - slack <= self.until;
        match self.entity {
            None if acts => {
                let pull = Pull::new(&self.name, self.rows.clone(), self.stiffness, self.damping);
                self.entity = Some(simulation.add_pull(pull));
            }
            Some(pull) if !acts => {
                self.work = self.report(simulation).work;
                simulation.remove_contact(pull);
                self.entity = None;
            }
            _ => {}
        }
        if let Some(pull) = self.entity {
            simulation.move_pull(pull, self.way.at(end));
        }
    }
}

/// A contact between bodies in the simulation.
#[derive(Clone, Debug)]
pub struct BuiltContact {
    /// Name.
    pub name: String,
    /// Indices of the bodies, twice the same for one that touches itself.
    pub bodies: [usize; 2],
    /// Coefficient of friction.
    pub friction: f64,
    /// The contact.
    pub entity: Entity,
}

/// Moves what the scene moves through the step to come: hands of pulls, threads and clips, grips of tools.
pub(super) fn drive<'a>(
    tools: &[BuiltTool],
    pulls: &mut [BuiltPull],
    lines: impl Iterator<Item = &'a mut BuiltThread>,
    simulation: &mut Simulation,
) {
    let StepClock { time, dt, .. } = *simulation.world().resource::<StepClock>();
    // times are compared to within the rounding of the clock
    let (end, slack) = (time + dt, 1e-6 * dt);
    for (own, [from, until]) in tools.iter().filter_map(|own| Some((own, own.grip?))) {
        let grips = end + slack >= from && end - slack <= until;
        if let Some(mut tool) = simulation.world_mut().get_mut::<Tool>(own.entity) {
            tool.grip = grips;
        }
    }
    for pull in pulls {
        pull.drive(simulation, end, slack);
    }
    lines.for_each(|line| line.drive(simulation, end, slack));
}
