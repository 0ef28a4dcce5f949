//! Threads and clips through tissue, and bodies that tear.

use crate::body::Quantity;
use crate::choice::words;
use crate::embedding::Embedding;
use crate::error::{InputError, Result};
use crate::handle::{Handle, Kind, Target};
use crate::mesh::vector;
use bevy_ecs::entity::Entity;
use glam::DVec3;
use serde::Deserialize;
use sinew::models::cutting::glue::GlueReport;
use sinew::models::cutting::tear::{Tear, TearReport};
use sinew::simulation::BodyHandle;
use sinew::touch::thread::{Clip, Hold, Thread, ThreadReport};
use sinew_scene::scene::TearEntry;

/// What a thread or clip goes through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreadPoint {
    /// A body of solid elements, whose tissue at the place is meant; a tool, for the channel that its needle went through, from
    /// the first entry on; 0 for a place in space, such as a hand.
    pub of: Handle,
    /// The place (m), in the present shape; of no meaning for a channel.
    pub at: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ThreadWords {
    name: String,
    stiffness: f64,
    length: Option<f64>,
    #[serde(default)]
    friction: f64,
    #[serde(default)]
    grip: f64,
    #[serde(default)]
    tails: [f64; 2],
    needle: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ClipWords {
    name: String,
    stiffness: f64,
    #[serde(default)]
    length: f64,
    strength: Option<f64>,
}

impl Embedding {
    fn holds(&mut self, line: &str, points: &[ThreadPoint]) -> Result<Vec<Hold>> {
        let mut holds = Vec::with_capacity(points.len());
        for (i, point) in points.iter().enumerate() {
            let invalid = |problem: &str| {
                InputError::invalid(format!("point {} of {line}", i + 1), problem).into()
            };
            if Kind::of(point.of) == Some(Kind::Tool) {
                let tool = self.touching(point.of, Kind::Tool)?;
                let channel = self.built.simulation.needle_channel(tool)?;
                if channel.is_empty() {
                    return Err(invalid("this tool has no needle in tissue; drive one in first"));
                }
                holds.extend(channel);
                continue;
            }
            let at = vector("point", point.at)?;
            if point.of == 0 {
                holds.push(Hold::Place(at));
                continue;
            }
            let body = BodyHandle(self.body(point.of)?);
            let problem = "no solid element of that body is there; give a point inside of one, in its present shape";
            let found = self.built.simulation.tissue_point(body, at);
            holds.push(found.ok_or_else(|| invalid(problem))?);
        }
        Ok(holds)
    }

    /// Lays a thread through points, or sets a clip between two ([`Kind::Thread`], [`Kind::Clip`]), which takes hold in the next
    /// step. Its words are TOML as in scenes, or JSON: `name`, `stiffness`, of threads `length`, `friction`, `grip`, `tails` and `needle`,
    /// the name of the tool whose needle draws it through further points, of clips `length` and `strength`.
    ///
    /// # Errors
    /// When there is no tissue at a point, or no such needle, the name is taken, or a word or number cannot be used.
    pub fn add_thread(
        &mut self,
        kind: Kind,
        settings: &str,
        points: &[ThreadPoint],
    ) -> Result<Handle> {
        self.can_touch(kind)?;
        let (name, entity) = match kind {
            Kind::Clip => {
                let own: ClipWords = words("clip", settings)?;
                self.name_is_free(kind, &own.name)?;
                let line = format!("clip `{}`", own.name);
                let holds = <[Hold; 2]>::try_from(self.holds(&line, points)?);
                let problem = "it needs two points of tissue or in space";
                let holds = holds.map_err(|_| InputError::invalid(line, problem))?;
                let ClipWords { name, stiffness, length, strength } = own;
                let clip = Clip { length, strength, ..Clip::new(&name, holds, stiffness) };
                (name, self.built.simulation.add_clip(clip)?)
            }
            Kind::Thread => {
                let own: ThreadWords = words("thread", settings)?;
                self.name_is_free(kind, &own.name)?;
                let mut holds = self.holds(&format!("thread `{}`", own.name), points)?;
                if let Some(needle) = &own.needle {
                    let tool = self.find(Kind::Tool, needle)?;
                    let end = self.built.simulation.needle_end(self.touching(tool, Kind::Tool)?);
                    let none =
                        |_| InputError::invalid("needle", format!("tool `{needle}` has none"));
                    holds.push(end.map_err(none)?);
                }
                let ThreadWords { name, stiffness, length, friction, grip, tails, .. } = own;
                let made = Thread::new(&name, holds, stiffness);
                let thread = Thread { length, friction, grip, tails, ..made };
                (name, self.built.simulation.add_thread(thread)?)
            }
            _ => {
                return Err(
                    InputError::invalid("kind", format!("a {kind} is no thread or clip")).into()
                );
            }
        };
        Ok(self.handles.add(kind, name, Target::Entity(entity)))
    }

    /// The thread of a handle, if it is none that a scene lays, draws and moves.
    fn thread(&self, thread: Handle) -> Result<Entity> {
        if let Target::Scene(index) = self.handles.get(thread, Kind::Thread)? {
            let what = format!("thread `{}`", self.built.strands[index].name);
            let problem = "it is as the scene says; add a thread in code, and that can be drawn, moved, tied and cut";
            return Err(InputError::invalid(what, problem).into());
        }
        self.touching(thread, Kind::Thread)
    }

    /// Moves a point in space that a thread goes through, by its number from 0: it is there (m) at the end of the next step.
    ///
    /// # Errors
    /// When there is no such thread, the scene moves it, or the point is in tissue.
    pub fn move_thread(&mut self, thread: Handle, point: usize, at: [f64; 3]) -> Result<()> {
        let (entity, at) = (self.thread(thread)?, vector("place", at)?);
        Ok(self.built.simulation.move_thread(entity, point, at)?)
    }

    /// Draws a thread past its first (`end` 0) or last (1) point: the length (m) in all by the end of the next step.
    ///
    /// # Errors
    /// When there is no such thread, the scene draws it, or that end is free.
    pub fn draw_thread(&mut self, thread: Handle, end: usize, length: f64) -> Result<()> {
        let entity = self.thread(thread)?;
        Ok(self.built.simulation.draw_thread(entity, end, length)?)
    }

    /// Holds a free end of a thread, the first (`end` 0) or last (1), where it is: it slides through there no more.
    ///
    /// # Errors
    /// When there is no such thread, it is the scene's, or that end is not free.
    pub fn hold_thread(&mut self, thread: Handle, end: usize) -> Result<()> {
        let entity = self.thread(thread)?;
        Ok(self.built.simulation.hold_thread(entity, end)?)
    }

    /// Ties the ends of a thread together, and lets hands go; the handle stands for what is tied.
    ///
    /// # Errors
    /// When there is no such thread, it is the scene's, less than two points in tissue hold it, or no step was made with it.
    pub fn tie_thread(&mut self, thread: Handle) -> Result<()> {
        let entity = self.thread(thread)?;
        let tied = self.built.simulation.tie_thread(entity)?;
        self.lead(thread, tied);
        Ok(())
    }

    /// Cuts a thread between two points that hold it, by the number of the segment from 0. The handle stands for the first part
    /// that is left, and for nothing when none is; what comes behind it gets a name with a number.
    ///
    /// # Errors
    /// When there is no such thread or segment, it is the scene's, or no step was made with it.
    pub fn cut_thread(&mut self, thread: Handle, segment: usize) -> Result<[Option<Handle>; 2]> {
        let (entity, name) = (self.thread(thread)?, self.name(thread)?);
        let parts = self.built.simulation.cut_thread(entity, segment)?;
        let mut own = Some(thread);
        let parts = parts.map(|part| {
            let part = part?;
            let Some(first) = own.take() else {
                let mut names = (2_u32..).map(|i| format!("{name}-{i}"));
                let name = names.find(|name| self.name_is_free(Kind::Thread, name).is_ok())?;
                if let Some(mut thread) = self.built.simulation.world_mut().get_mut::<Thread>(part)
                {
                    thread.name.clone_from(&name);
                }
                return Some(self.handles.add(Kind::Thread, name, Target::Entity(part)));
            };
            self.lead(first, part);
            Some(first)
        });
        if let Some(gone) = own {
            self.handles.remove(gone)?;
        }
        Ok(parts)
    }

    /// Has the handle of a thread stand for another one.
    fn lead(&mut self, thread: Handle, to: Entity) {
        if let Ok(Target::Entity(from)) = self.handles.get(thread, Kind::Thread) {
            self.handles.redirect(|target| match target {
                Target::Entity(own) if own == from => Some(Target::Entity(to)),
                other => Some(other),
            });
        }
    }

    /// What a thread or clip did in the last step; nothing before it took hold, and while one of a scene does not act.
    ///
    /// # Errors
    /// When there is no such thread or clip.
    pub fn thread_report(&self, line: Handle) -> Result<ThreadReport> {
        let kind = if Kind::of(line) == Some(Kind::Clip) { Kind::Clip } else { Kind::Thread };
        let report = self.entity(line, kind)?.and_then(|e| self.built.simulation.thread_report(e));
        Ok(report.cloned().unwrap_or_default())
    }

    /// Lets a body of linear tetrahedra, or of a membrane of triangles alone, with vertices to spare tear, by words as below `tear` of a body in a
    /// scene: `strength`, `toughness`, `radius`, `max_speed`; without words it tears no more. What was given before is replaced, and its report goes on.
    ///
    /// # Errors
    /// When there is no such body, it cannot tear, or a word or number cannot be used.
    pub fn set_tear(&mut self, body: Handle, settings: Option<&str>) -> Result<()> {
        let body = self.body(body)?;
        let Some(settings) = settings else {
            self.built.simulation.remove_tear(BodyHandle(body));
            return Ok(());
        };
        let TearEntry { strength, toughness, radius, max_speed } = words("tear", settings)?;
        self.built.simulation.set_tear(Tear { body, strength, toughness, radius, max_speed })?;
        Ok(())
    }

    /// What tears of a body did up to the last step; `None` when it does not tear.
    pub fn tear_report(&self, body: Handle) -> Result<Option<TearReport>> {
        let body = BodyHandle(self.body(body)?);
        Ok(self.built.simulation.tear_report(body))
    }

    /// What the glue of a body does; `None` when it has none.
    pub fn glue_report(&self, body: Handle) -> Result<Option<GlueReport>> {
        let body = BodyHandle(self.body(body)?);
        Ok(self.built.simulation.glue_report(body))
    }

    pub(crate) fn glue_numbers(&self, body: Handle) -> Result<Vec<f64>> {
        let none = || InputError::invalid("glue", "the body has no glue; build it with some");
        let GlueReport { springs, energy, released } = self.glue_report(body)?.ok_or_else(none)?;
        Ok(vec![springs as f64, energy, released])
    }

    pub(crate) fn tear_numbers(&self, body: Handle) -> Result<Vec<f64>> {
        let none = || InputError::invalid("tear", "the body does not tear; set its tear first");
        let TearReport { area, separated, vertices, begun, stress, energy_release, pieces, way } =
            self.tear_report(body)?.ok_or_else(none)?;
        let [separated, vertices, begun, pieces] =
            [separated, vertices, begun, pieces].map(f64::from);
        Ok(vec![area, separated, vertices, begun, stress, energy_release, pieces, way])
    }

    pub(crate) fn thread_numbers(&self, line: Handle, quantity: Quantity) -> Result<Vec<f64>> {
        let own = self.thread_report(line)?;
        let flat = |all: &[DVec3]| all.iter().flat_map(|x| x.to_array()).collect();
        let flag = |value: bool| f64::from(u8::from(value));
        Ok(match quantity {
            Quantity::ThreadHeld => own.held.into_iter().map(f64::from).collect(),
            Quantity::ThreadPoints => flat(&own.points),
            Quantity::ThreadTensions => own.tension,
            Quantity::ThreadSpans => own.spans,
            Quantity::ThreadFree => own.free,
            Quantity::ThreadSlid => own.slid,
            Quantity::ThreadEnds => flat(&own.ends),
            _ => {
                let flags = [f64::from(own.lost), flag(own.broken), flag(own.unconverged)];
                let ThreadReport { length, work, dissipation, .. } = own;
                [&[own.largest(), length, work, dissipation], &flags[..]].concat()
            }
        })
    }
}
