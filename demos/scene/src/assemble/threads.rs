//! Threads and clips of a scene: checked, laid, drawn, moved and taken away.

use super::curves::{self, window};
use super::scene::BuiltScene;
use super::select::which_body;
use super::touch::place;
use crate::error::SceneError;
use crate::scene::{ClipEntry, Key, ThreadEntry};
use crate::text::short;
use bevy_ecs::entity::Entity;
use sinew::engine::load::Curve;
use sinew::simulation::Simulation;
use sinew::touch::thread::{Clip, Hold, Thread, ThreadError, ThreadReport};

/// What is to be laid.
#[derive(Clone, Debug)]
enum Line {
    Thread(Thread),
    Clip(Clip),
}

/// A thread or clip of a scene; it is in the simulation while it acts.
#[derive(Clone, Debug)]
pub struct BuiltThread {
    /// Name.
    pub name: String,
    /// What it is, in words.
    pub words: String,
    /// Time (s) from which it holds.
    pub from: f64,
    /// Time (s) after which it is taken out.
    pub until: f64,
    line: Line,
    /// Length (m) drawn past its last point, and place (m) of the hand there, over time (s).
    drawn: Option<Curve>,
    path: Option<Vec<Curve>>,
    /// Times (s) from which its first tail is held, and at which it is tied.
    held: Option<f64>,
    tied: Option<f64>,
    entity: Option<Entity>,
}

impl BuiltThread {
    /// The thread or clip, while it acts.
    pub fn entity(&self) -> Option<Entity> {
        self.entity
    }

    /// Goes on from where a run was.
    pub(super) fn resume(&mut self, entity: Option<Entity>) {
        self.entity = entity;
    }

    /// What it did in the last step; nothing while it does not act.
    pub fn report(&self, simulation: &Simulation) -> ThreadReport {
        let known = self.entity.and_then(|own| simulation.thread_report(own).cloned());
        known.unwrap_or_default()
    }

    /// Lays, draws, moves or takes it away in the step that ends at `end` (s).
    pub(super) fn drive(&mut self, simulation: &mut Simulation, end: f64, slack: f64) {
        let acts = end + slack >= self.from && end - slack <= self.until;
        match self.entity {
            // it was checked when the scene was built
            None if acts => {
                self.entity = match self.line.clone() {
                    Line::Thread(thread) => simulation.add_thread(thread).ok(),
                    Line::Clip(clip) => simulation.add_clip(clip).ok(),
                };
            }
            Some(own) if !acts => {
                simulation.remove_contact(own);
                self.entity = None;
            }
            _ => {}
        }
        let (Some(own), Line::Thread(thread)) = (self.entity, &self.line) else { return };
        let now = simulation.world().get::<Thread>(simulation.current(own));
        let is_open = now.is_some_and(|now| now.points.last().is_some_and(is_hand));
        let is_due = |time: Option<f64>| time.is_some_and(|time| end + slack >= time);
        if is_due(self.tied) && is_open {
            // until there is enough tissue to tie it in
            self.entity = simulation.tie_thread(own).ok().or(Some(own));
        }
        if self.tied.is_some() && !is_open {
            return;
        }
        let Some(own) = self.entity.filter(|now| *now == own) else { return };
        if is_due(self.held) {
            // what is held already has no tail
            let _: Result<(), ThreadError> = simulation.hold_thread(own, 0);
        }
        // both are of ends that were found to be there
        let _: Result<(), ThreadError> = self
            .drawn
            .as_ref()
            .map_or(Ok(()), |drawn| simulation.draw_thread(own, 1, drawn.value(end)));
        let _: Result<(), ThreadError> = self.path.as_ref().map_or(Ok(()), |path| {
            simulation.move_thread(own, thread.points.len() - 1, place(path, end))
        });
    }
}

/// Whether that is a hand or a needle.
fn is_hand(point: &Hold) -> bool {
    matches!(point, Hold::Place(_) | Hold::Needle(_))
}

/// Points in tissue of a body, or of one body each.
fn points(
    key: &Key,
    [body, bodies]: [&[String]; 2],
    at: &[[f64; 3]],
    built: &mut BuiltScene,
) -> Result<Vec<Hold>, SceneError> {
    let of_points = key.at("bodies");
    if !bodies.is_empty() && (bodies.len() != at.len() || !body.is_empty()) {
        let found = format!("{} bodies for {} points", bodies.len(), at.len());
        return Err(of_points.value(found, "name one for each point, or `body` for all"));
    }
    let mut points = Vec::with_capacity(at.len());
    for (i, &own) in at.iter().enumerate() {
        let index = match bodies.get(i) {
            Some(name) => {
                let known = || built.bodies.iter().map(|body| body.name.as_str());
                let found = known().position(|own| own == name);
                found.ok_or_else(|| of_points.entry(i).unknown("body", name, known()))?
            }
            None => which_body(key, body.first().map(String::as_str), &built.bodies)?,
        };
        let key = key.at("points").entry(i);
        let place = key.finite(own)?;
        let handle = built.bodies[index].handle;
        let Some(point) = built.simulation.tissue_point(handle, place) else {
            let found = format!("no solid element of `{}` there", built.bodies[index].name);
            return Err(key.value(
                found,
                "give a point inside of a body of tetrahedra or hexahedra, at rest",
            ));
        };
        points.push(point);
    }
    Ok(points)
}

/// A thread of a scene.
pub(super) fn thread(
    key: &Key,
    entry: &ThreadEntry,
    built: &mut BuiltScene,
) -> Result<BuiltThread, SceneError> {
    let mode = built.plan.mode;
    let body = entry.body.as_slice();
    let bodies = entry.bodies.as_deref().unwrap_or_default();
    let mut points = points(key, [body, bodies], &entry.points, built)?;
    let in_tissue = points.len();
    let mut path = None;
    match (&entry.hand, &entry.path) {
        (Some(_), Some(_)) => {
            return Err(key.at("hand").value("`path` is given as well", "keep one of them"));
        }
        (Some(at), None) => points.push(Hold::Place(key.at("hand").finite(*at)?)),
        (None, Some(rows)) => {
            let curves = curves::path(&key.at("path"), rows, "[time, x, y, z] points", mode)?;
            let start = entry.from.unwrap_or(0.0);
            points.push(Hold::Place(place(&curves, start)));
            path = Some(curves);
        }
        (None, None) => {}
    }
    if let Some(name) = &entry.needle {
        let key = key.at("needle");
        curves::in_time(&key, "needle", mode)?;
        if points.last().is_some_and(is_hand) {
            return Err(key.value("a hand holds the same end", "keep one of them"));
        }
        let known = || built.tools.iter().map(|tool| tool.name.as_str());
        let tool = built.tools.iter().find(|tool| tool.name == *name);
        let tool = tool.ok_or_else(|| key.unknown("tool", name, known()))?.entity;
        let end = built.simulation.needle_end(tool);
        points.push(end.map_err(|_| key.value("this tool has no needle", "give it one"))?);
    }
    let stiffness = key.at("stiffness").positive(entry.stiffness, "the stiffness", "N")?;
    let length = entry.length.map(|length| key.at("length").positive(length, "the length", "m"));
    let of = |name: &str, value: Option<f64>, unit: &str| {
        key.at(name).not_negative(value.unwrap_or(0.0), name, unit)
    };
    let (friction, grip) = (of("friction", entry.friction, "")?, of("grip", entry.grip, "N")?);
    let mut tails = [0.0; 2];
    for (end, tail) in entry.tails.unwrap_or_default().into_iter().enumerate() {
        tails[end] = key.at("tails").entry(end).not_negative(tail, "a tail", "m")?;
    }
    let drawn = match &entry.drawn {
        None => None,
        Some(rows) => {
            let key = key.at("drawn");
            curves::in_time(&key, "drawn", mode)?;
            key.ascending(rows, "list", "[time, length] pairs")?;
            for (i, row) in rows.iter().enumerate() {
                key.entry(i).finite(*row)?;
            }
            Some(Curve::Points(rows.clone()))
        }
    };
    let [from, until] = window(key, [entry.from, entry.until], mode)?;
    let ends = [
        ("held", entry.held, tails[0] > 0.0),
        ("tied", entry.tied, points.last().is_some_and(is_hand)),
    ];
    for (name, time, has_end) in ends {
        let Some(time) = time else { continue };
        let key = key.at(name);
        curves::in_time(&key, name, mode)?;
        key.finite([time])?;
        if !has_end {
            return Err(key
                .value("no such end", "`held` needs a first tail, `tied` a hand, path or needle"));
        }
    }
    let own = Thread {
        length: length.transpose()?,
        friction,
        grip,
        tails,
        ..Thread::new(&entry.name, points, stiffness)
    };
    // with what is drawn at last, where that is more than there may be
    let last = drawn.as_ref().map_or(0.0, |drawn| drawn.value(f64::MAX));
    let topology = built.simulation.topology();
    let tried = Thread { drawn: [0.0, last], ..own.clone() };
    if let Some(problem) = tried.problem(topology.vertex_count(), topology.bodies.len()) {
        return Err(key.value(problem, "correct it"));
    }
    let words = format!(
        "through {in_tissue} points, EA {} N, friction {}",
        short(stiffness),
        short(friction)
    );
    let (name, line) = (entry.name.clone(), Line::Thread(own));
    let (held, tied) = (entry.held, entry.tied);
    Ok(BuiltThread { name, words, from, until, line, drawn, path, held, tied, entity: None })
}

/// A clip of a scene.
pub(super) fn clip(
    key: &Key,
    entry: &ClipEntry,
    built: &mut BuiltScene,
) -> Result<BuiltThread, SceneError> {
    let body = entry.body.as_slice();
    let bodies = entry.bodies.as_deref().unwrap_or_default();
    let points = points(key, [body, bodies], &entry.points, built)?;
    let points = <[Hold; 2]>::try_from(points).expect("the entry has two");
    let stiffness = key.at("stiffness").positive(entry.stiffness, "the stiffness", "N/m")?;
    let length = key.at("length").not_negative(entry.length.unwrap_or(0.0), "the length", "m")?;
    let strength = entry.strength.map(|f| key.at("strength").positive(f, "the strength", "N"));
    let [from, until] = window(key, [entry.from, entry.until], built.plan.mode)?;
    let strength = strength.transpose()?;
    let line = Line::Clip(Clip { length, strength, ..Clip::new(&entry.name, points, stiffness) });
    let words = format!("{} N/m beyond {} mm", short(stiffness), short(length * 1e3));
    let name = entry.name.clone();
    let [held, tied] = [None; 2];
    let (drawn, path, entity) = (None, None, None);
    Ok(BuiltThread { name, words, from, until, line, drawn, path, held, tied, entity })
}
