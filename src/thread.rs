//! Threads and clips of a [`Simulation`]: stitches, staples, knots.

use crate::simulation::{BodyHandle, Simulation};
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_contact::thread::{Clip, Hold, Thread, ThreadError, ThreadReport};
use sinew_engine::by_precision;
use sinew_models::cutting::held::material_point;

/// # Threads and clips
impl Simulation {
    /// The point of tissue at a place (m) in the present shape of a body of solid elements, for a [`Thread`] or [`Clip`]. None
    /// where there is no tissue of that body. Membranes offer their vertices ([`Hold::Vertices`]).
    pub fn tissue_point(&mut self, body: BodyHandle, at: DVec3) -> Option<Hold> {
        let precision = self.precision();
        let found = by_precision!(precision, material_point(self.columns(), body.0, at));
        let (element, vertices, weights) = found?;
        Some(Hold::Tissue { body: body.0, element, vertices, weights })
    }

    /// Lays a thread, which takes hold in the next step.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    ///
    /// let mesh = box_tets(DVec3::new(0.06, 0.06, 0.02), [6, 6, 2])?;
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let block = BodyDescription::new("block", &mesh, preset("liver")?.material);
    /// let body = simulation.add_body(&BodyDescription { spare: 200, ..block })?;
    /// let floor = simulation.group_rows(body, &mesh, "z0")?;
    /// simulation.add_constraint(Constraint::hold("floor", floor));
    /// let edge = |y: f64| [DVec3::new(0.031, y, 0.03), DVec3::new(0.031, y, 0.008)];
    /// simulation.cut(body, &[edge(-0.01), edge(0.07)])?;
    /// // through both lips, and drawn tight by a hand above
    /// let mut points = Vec::new();
    /// for (x, z) in [(0.02, 0.019), (0.02, 0.012), (0.042, 0.012), (0.042, 0.019)] {
    ///     points.push(simulation.tissue_point(body, DVec3::new(x, 0.03, z)).ok_or("no tissue")?);
    /// }
    /// points.push(Hold::Place(DVec3::new(0.03, 0.03, 0.03)));
    /// let stitch = simulation.add_thread(Thread::new("stitch", points, 20.0))?;
    /// for step in 1..=20 {
    ///     simulation.draw_thread(stitch, 1, 1e-4 * f64::from(step))?;
    ///     simulation.step()?;
    /// }
    /// let report = simulation.thread_report(stitch).ok_or("no such thread")?;
    /// assert!(report.largest() > 0.01 && report.spans[1] < 0.022, "{report:?}");
    /// // tied, it keeps its length
    /// let stitch = simulation.tie_thread(stitch)?;
    /// simulation.step()?;
    /// assert!(simulation.thread_report(stitch).is_some_and(|report| report.largest() > 0.005));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// When a point or number of it cannot be used.
    pub fn add_thread(&mut self, thread: Thread) -> Result<Entity, ThreadError> {
        let topology = self.topology();
        match thread.problem(topology.vertex_count(), topology.bodies.len()) {
            Some(problem) => Err(ThreadError::Invalid { name: thread.name, problem }),
            None => Ok(self.world_mut().spawn(thread).id()),
        }
    }

    /// Sets a clip, which takes hold in the next step.
    ///
    /// # Errors
    /// When a point or number of it cannot be used.
    pub fn add_clip(&mut self, clip: Clip) -> Result<Entity, ThreadError> {
        let topology = self.topology();
        match clip.problem(topology.vertex_count(), topology.bodies.len()) {
            Some(problem) => Err(ThreadError::Invalid { name: clip.name, problem }),
            None => Ok(self.world_mut().spawn(clip).id()),
        }
    }

    /// Moves a place in space that a thread goes through, such as the hand at its end: it is there (m) at the end of the next
    /// step. `point` is its number, from 0.
    ///
    /// # Errors
    /// When there is no such thread, or the point is in tissue.
    pub fn move_thread(
        &mut self,
        thread: Entity,
        point: usize,
        at: DVec3,
    ) -> Result<(), ThreadError> {
        let entity = self.current(thread);
        let mut own = self.world_mut().get_mut::<Thread>(entity);
        let own = own.as_mut().ok_or(ThreadError::NoThread(thread))?;
        match own.points.get(point) {
            Some(Hold::Place(_)) if at.is_finite() => {
                own.points[point] = Hold::Place(at);
                Ok(())
            }
            _ => Err(ThreadError::NoHand { name: own.name.clone(), point }),
        }
    }

    /// Draws a thread past its first (`end` 0) or last (1) point: the length (m) that was drawn in all is reached at the end of
    /// the next step.
    ///
    /// # Errors
    /// When there is no such thread, or that end is free. A length that is not there lets the step fail.
    pub fn draw_thread(
        &mut self,
        thread: Entity,
        end: usize,
        length: f64,
    ) -> Result<(), ThreadError> {
        let entity = self.current(thread);
        let mut own = self.world_mut().get_mut::<Thread>(entity);
        let own = own.as_mut().ok_or(ThreadError::NoThread(thread))?;
        let held = own.tails.get(end) == Some(&0.0);
        if !held || !length.is_finite() {
            return Err(ThreadError::NoHand { name: own.name.clone(), point: end });
        }
        own.drawn[end] = length;
        Ok(())
    }

    /// Holds a free end of a thread, the first (`end` 0) or last (1), where it is: from the next step on it slides through there no more.
    ///
    /// # Errors
    /// When there is no such thread, or it has no tail there.
    pub fn hold_thread(&mut self, thread: Entity, end: usize) -> Result<(), ThreadError> {
        let entity = self.current(thread);
        let mut own = self.world_mut().get_mut::<Thread>(entity);
        let own = own.as_mut().ok_or(ThreadError::NoThread(thread))?;
        let is_free = own.points.len() > 1 && own.tails.get(end).is_some_and(|tail| *tail > 0.0);
        if !is_free {
            return Err(ThreadError::NoTail { name: own.name.clone(), end });
        }
        own.tails[end] = 0.0;
        Ok(())
    }

    /// Ties the ends of a thread together: hands and needles let go, what lies between its points in tissue keeps its free length, and it is
    /// closed from the last of them to the first as taut as it is there. Returns the closed thread in place of the old one.
    ///
    /// # Errors
    /// When there is no such thread, or it has less than two points in tissue, or no step was made with it.
    pub fn tie_thread(&mut self, thread: Entity) -> Result<Entity, ThreadError> {
        let (own, report) = self.laid(thread)?;
        let is_hand = |hold: &Hold| matches!(hold, Hold::Place(_) | Hold::Needle(_));
        let tissue = |&i: &u32| !is_hand(&own.points[i as usize]);
        let held: Vec<usize> =
            (0..report.held.len()).filter(|&i| tissue(&report.held[i])).collect();
        let (Some(&first), Some(&last)) = (held.first(), held.last()) else {
            return Err(ThreadError::Short { name: own.name });
        };
        if first == last {
            return Err(ThreadError::Short { name: own.name });
        }
        let ends = [report.points[first], report.points[last]];
        let strain = report.tension[first..last].iter().fold(0.0_f64, |t, own| t.max(*own));
        let closing = ends[0].distance(ends[1]) / (1.0 + strain / own.stiffness);
        let inside = &report.held[first..=last];
        let mut points: Vec<Hold> =
            inside.iter().map(|&i| own.points[i as usize].clone()).collect();
        points.push(points[0].clone());
        let length = Some(report.free[first..last].iter().sum::<f64>() + closing);
        let tied = Thread { points, length, tails: [0.0; 2], drawn: [0.0; 2], ..own };
        self.replace(thread, tied)
    }

    /// Cuts a thread between two points that follow each other and hold it: `segment` counts from 0, as
    /// [`ThreadReport::tension`] does. Both parts have a free end there, half of the segment long; parts that no second point
    /// holds are gone.
    ///
    /// # Errors
    /// When there is no such thread or segment, or no step was made with it.
    pub fn cut_thread(
        &mut self,
        thread: Entity,
        segment: usize,
    ) -> Result<[Option<Entity>; 2], ThreadError> {
        let (own, report) = self.laid(thread)?;
        if segment >= report.free.len() {
            return Err(ThreadError::Short { name: own.name });
        }
        let half = 0.5 * report.free[segment].max(f64::MIN_POSITIVE);
        let part = |held: &[u32], free: &[f64], tails: [f64; 2]| {
            let points = held.iter().map(|&i| own.points[i as usize].clone()).collect();
            let length = Some(free.iter().sum());
            let drawn = [0.0; 2];
            (!free.is_empty()).then(|| Thread { points, length, tails, drawn, ..own.clone() })
        };
        let (before, behind) = report.held.split_at(segment + 1);
        let parts = [
            part(before, &report.free[..segment], [own.tails[0], half]),
            part(behind, &report.free[segment + 1..], [half, own.tails[1]]),
        ];
        let entity = self.current(thread);
        self.world_mut().despawn(entity);
        let [a, b] = parts.map(|part| part.map(|part| self.world_mut().spawn(part).id()));
        Ok([a, b])
    }

    /// What a thread or clip did in the last step; `None` when there is no such.
    pub fn thread_report(&self, thread: Entity) -> Option<&ThreadReport> {
        self.world().get(self.current(thread))
    }

    /// A thread and its report, if it took hold.
    fn laid(&self, thread: Entity) -> Result<(Thread, ThreadReport), ThreadError> {
        let entity = self.current(thread);
        let own = self.world().get::<Thread>(entity).ok_or(ThreadError::NoThread(thread))?;
        let report = self.world().get::<ThreadReport>(entity).cloned().unwrap_or_default();
        if report.free.is_empty() {
            return Err(ThreadError::Short { name: own.name.clone() });
        }
        Ok((own.clone(), report))
    }

    fn replace(&mut self, old: Entity, new: Thread) -> Result<Entity, ThreadError> {
        let topology = self.topology();
        if let Some(problem) = new.problem(topology.vertex_count(), topology.bodies.len()) {
            return Err(ThreadError::Invalid { name: new.name, problem });
        }
        let entity = self.current(old);
        let world = self.world_mut();
        world.despawn(entity);
        Ok(world.spawn(new).id())
    }
}
