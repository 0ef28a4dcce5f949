//! Needles: tools that enter what they puncture; what of the tissue holds them in the step to come.

use crate::blade::{Path, cannot_enter};
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_contact::edge::{EdgeState, YIELD};
use sinew_contact::needle::{Needle, NeedlePoint, NeedleState};
use sinew_contact::thread::{Hold, Thread};
use sinew_contact::tool::{Tool, ToolError, ToolPose};
use sinew_engine::order::Order;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::StepError;
use sinew_engine::topology::Topology;
use sinew_models::cutting::blade::hull;
use sinew_models::cutting::held::{Tissue, tissue};

use crate::simulation::Simulation;

/// Parts of a needle, or of its way, that are looked at one by one.
const PARTS: u32 = 16;
/// Halvings of a part in which a surface is: nothing is left of it.
const HALVINGS: u32 = 40;
/// Most points of a channel.
const MOST: usize = 512;
/// What rounding may take of a limit that was reached.
const REACHED: f64 = 1.0 - 1e-9;

/// A needle: where it is, and where it will be at the end of the step to come.
struct Own<'a> {
    needle: Needle,
    now: ToolPose,
    then: ToolPose,
    state: NeedleState,
    /// Tissue near it, by body.
    near: Vec<Option<Tissue>>,
    /// Points that its end has passed now.
    passed: Vec<Hold>,
    world: &'a World,
}

/// Lets needles enter tissue by what they did in the step before.
pub(crate) fn look<S: Scalar>(world: &mut World, all: Vec<Path>) -> Result<(), StepError> {
    let bodies = world.resource::<Topology>().bodies.len();
    for Path { entity, name, now, then, is_placed, mut state } in all {
        let Some(needle) = world.get::<Tool>(entity).and_then(|tool| tool.needle) else { continue };
        if is_placed {
            let NeedleState { punctures, fracture, .. } = state.needle;
            state.needle = NeedleState { punctures, fracture, ..NeedleState::default() };
        }
        let line = |pose: &ToolPose| {
            let at = |i| needle.length * f64::from(i) / f64::from(PARTS);
            (0..=PARTS).map(|i| pose.position + pose.rotation * needle.place(at(i))).collect()
        };
        let lines: [Vec<DVec3>; 2] = [line(&now), line(&then)];
        let margin = needle.length / f64::from(PARTS);
        let low = lines.iter().flatten().fold(DVec3::INFINITY, |low, x| low.min(*x)) - margin;
        let high =
            lines.iter().flatten().fold(DVec3::NEG_INFINITY, |high, x| high.max(*x)) + margin;
        let mut near = Vec::new();
        for body in 0..bodies {
            let NeedleState { points, passed, tip, .. } = &state.needle;
            let mut holds = points.iter().map(|own| &own.hold).chain(passed).chain(tip);
            let is_of =
                |hold: &Hold| matches!(hold, Hold::Tissue { body: own, .. } if *own == body);
            let [from, to] = hull::<S>(world, body);
            let is_near = low.cmple(to).all() && from.cmple(high).all() || holds.any(is_of);
            let found = is_near.then(|| tissue::<S>(world, body, [low, high]));
            if let Some(None) = found {
                let own = &world.resource::<Topology>().bodies[body].name;
                let why = format!("body `{own}` has no solid elements");
                cannot_enter(
                    world,
                    body,
                    (&name, "needle meets what it cannot enter"),
                    &lines[1],
                    &why,
                )?;
            }
            near.push(found.flatten());
        }
        let mut own =
            Own { needle, now, then, state: state.needle, near, passed: Vec::new(), world };
        own.advance();
        state.needle = own.state;
        let passed = own.passed;
        if !passed.is_empty() {
            let end = world.get::<Order>(entity).map(|order| Hold::Needle(*order));
            for mut thread in world.query::<&mut Thread>().iter_mut(world) {
                if thread.points.last() == end.as_ref() {
                    let at = thread.points.len() - 1;
                    thread.points.splice(at..at, passed.iter().cloned());
                }
            }
        }
        if let Some(mut of_tool) = world.get_mut::<EdgeState>(entity) {
            *of_tool = state;
        }
    }
    Ok(())
}

impl Own<'_> {
    /// The place (m) of the needle now, so far behind its tip.
    fn at(&self, u: f64) -> DVec3 {
        self.now.position + self.now.rotation * self.needle.place(u)
    }

    /// How far (m) behind its tip a place (m) lies, and how far beside it, when it stands there.
    fn behind(&self, pose: &ToolPose, at: DVec3) -> [f64; 2] {
        let near = self.needle.nearest(pose.rotation.inverse() * (at - pose.position));
        [near.u, near.away.length()]
    }

    /// Place (m) of a point of the tissue, if it is left.
    fn place(&self, hold: &Hold) -> Option<DVec3> {
        let Hold::Tissue { body, element, vertices, weights } = hold else { return None };
        let tissue = self.near.get(*body)?.as_ref()?;
        tissue.place(self.world, (*element, *vertices, *weights))
    }

    /// The tissue at the place of the needle now, so far behind its tip.
    fn tissue(&self, u: f64) -> Option<Hold> {
        let at = self.at(u);
        self.near.iter().enumerate().find_map(|(body, tissue)| {
            let (element, vertices, weights) = tissue.as_ref()?.point(self.world, at)?;
            Some(Hold::Tissue { body, element, vertices, weights })
        })
    }

    /// The last tissue on the way along the needle from where there is some.
    fn last_tissue(&self, mut from: f64, mut to: f64) -> (f64, Option<Hold>) {
        for _ in 0..HALVINGS {
            let middle = 0.5 * (from + to);
            *(if self.tissue(middle).is_some() { &mut from } else { &mut to }) = middle;
        }
        (from, self.tissue(from))
    }

    fn push(&mut self, hold: Hold, u: f64, exit: bool) {
        let (width, held, passed) = (0.0, true, false);
        self.state.points.push(NeedlePoint { hold, rest: u, width, exit, held, passed });
    }

    /// Whether its tip is in a channel of its own.
    fn is_inside(&self) -> bool {
        self.state.points.last().is_some_and(|last| !last.exit)
    }

    /// Finds what holds it in the step to come.
    fn advance(&mut self) {
        self.state.came = true;
        self.let_go();
        self.cut();
        if self.state.tip.is_none() {
            if self.is_inside() {
                // it came back through where it had left the tissue, or what it met was removed
                self.state.tip = self.tissue(0.0);
                self.state.punctured = true;
                self.leave_unless_held(0.0);
            } else {
                self.enter();
            }
        }
        self.grow();
        self.share();
    }

    /// Lets go of what was removed, and of what it has gone back behind.
    fn let_go(&mut self) {
        let left = |own: &Self, hold: &Hold| own.place(hold).is_some();
        for i in (0..self.state.points.len()).rev() {
            if !left(self, &self.state.points[i].hold) {
                self.state.points.remove(i);
                // no tissue is known from the point before to the next
                if let Some(before) = i.checked_sub(1) {
                    self.state.points[before].exit = true;
                }
            }
        }
        if self.state.tip.as_ref().is_some_and(|tip| !left(self, tip)) {
            self.state.tip = None;
        }
        let where_is = |own: &Self, point: &NeedlePoint| {
            own.place(&point.hold).map_or(0.0, |at| own.behind(&own.now, at)[0])
        };
        while let Some(last) = self.state.points.last().filter(|last| where_is(self, last) < 0.0) {
            if !last.exit {
                self.state.punctured &= self.state.points.len() > 1;
            }
            self.state.points.pop();
        }
        if !self.is_inside() {
            (self.state.tip, self.state.punctured) = (None, false);
        }
        for i in 0..self.state.points.len() {
            let passed = where_is(self, &self.state.points[i]) > self.needle.length;
            if passed && !self.state.points[i].passed {
                self.state.points[i].passed = true;
                self.passed.push(self.state.points[i].hold.clone());
            }
        }
        // it has left on the other side
        if !self.is_inside() && self.state.points.iter().all(|point| point.passed) {
            let points = std::mem::take(&mut self.state.points);
            self.state.passed.extend(points.into_iter().map(|point| point.hold));
        }
    }

    /// Moves on what the tip holds by what it parted.
    fn cut(&mut self) {
        let Some(at) = self.state.tip.as_ref().and_then(|tip| self.place(tip)) else { return };
        let [slip, beside] = self.behind(&self.now, at);
        let (k, before) =
            (self.state.tip_stiffness(&self.needle), self.state.tip_limit(&self.needle));
        if slip <= 0.0 || k * slip < REACHED * before {
            if slip < 0.0 && beside > self.state.spacing() {
                self.state.tip = None;
            }
            return;
        }
        self.state.punctures += u32::from(!self.state.punctured);
        self.state.punctured = true;
        let limit = self.state.tip_limit(&self.needle);
        let stored = |limit: f64| if k > 0.0 { 0.5 * limit * limit / k } else { 0.0 };
        self.state.fracture += before * slip - stored(before) - stored(limit);
        let rest = if k > 0.0 { limit / k } else { 0.0 };
        if slip > rest {
            self.state.tip = self.tissue(rest);
            self.leave_unless_held(rest);
        }
    }

    /// Ends the channel where the tissue ends, if the tip has left it.
    fn leave_unless_held(&mut self, u: f64) {
        let Some(last) = self.state.points.last().filter(|_| self.state.tip.is_none()) else {
            return;
        };
        let from = self.place(&last.hold).map_or(u, |at| self.behind(&self.now, at)[0]);
        if let (u, Some(hold)) = self.last_tissue(from, u) {
            self.push(hold, u, true);
        } else if let Some(last) = self.state.points.last_mut() {
            last.exit = true;
        }
        self.state.punctured = false;
    }

    /// Holds the tip where it meets tissue on its way in the step to come.
    fn enter(&mut self) {
        let to = self.behind(&self.now, self.then.position + self.then.rotation * self.needle.tip);
        let way = to[0].min(0.0);
        let part = |i: u32| way * f64::from(i) / f64::from(PARTS);
        let Some(first) = (0..=PARTS).find(|i| self.tissue(part(*i)).is_some()) else { return };
        let u = match first {
            0 => 0.0,
            _ => self.last_tissue(part(first), part(first - 1)).0,
        };
        let Some(hold) = self.tissue(u) else { return };
        if let (true, Hold::Tissue { body, .. }) = (self.state.points.is_empty(), &hold) {
            self.state.edge = self.near[*body].as_ref().map_or(0.0, |tissue| tissue.edge);
        }
        self.state.tip = Some(hold.clone());
        self.push(hold, u, false);
        self.state.punctured = false;
    }

    /// Adds points of the channel up to what the tip holds.
    fn grow(&mut self) {
        let tip = self.state.tip.as_ref().filter(|_| self.state.punctured);
        let Some(end) = tip.and_then(|tip| self.place(tip)) else { return };
        let end = self.behind(&self.now, end)[0].max(0.0);
        let Some(last) = self.state.points.last().and_then(|last| self.place(&last.hold)) else {
            return;
        };
        let mut u = self.behind(&self.now, last)[0] - self.state.spacing();
        let spacing = self.state.spacing();
        // a point on the axis bends nothing, and takes over force and slip with a part of the channel
        while u > end && self.state.points.len() < MOST {
            let Some(hold) = self.tissue(u) else { break };
            let Some(last) = self.state.points.last_mut() else { break };
            let (slip, width) = (u + spacing - last.rest, (last.width - spacing).max(0.0));
            last.width -= width;
            self.push(hold, u, false);
            if let Some(new) = self.state.points.last_mut() {
                (new.rest, new.width) = (u - slip, width);
            }
            u -= spacing;
        }
    }

    /// Shares the channel out to its points, as long as it will be if the tissue stays.
    fn share(&mut self) {
        let ends: Vec<[f64; 2]> = self
            .state
            .points
            .iter()
            .map(|point| {
                let at = self.place(&point.hold).unwrap_or_default();
                [&self.now, &self.then].map(|pose| self.behind(pose, at)[0])
            })
            .collect();
        let (length, last) = (self.needle.length, ends.len().wrapping_sub(1));
        let most = YIELD * self.state.edge;
        for (i, (point, [now, then])) in self.state.points.iter_mut().zip(&ends).enumerate() {
            let next = ends.get(i + 1).map_or(0.0, |next| next[1]);
            let dents = i == last && !self.state.punctured;
            let width = match point.exit || dents {
                true => 0.0,
                false => (then.clamp(0.0, length) - next.clamp(0.0, length)).max(0.0),
            };
            // force is kept where there is more of it, so that no energy comes from nothing
            let share = if width > 0.0 { (point.width / width).min(1.0) } else { 0.0 };
            point.rest = now - share * (now - point.rest).clamp(-most, most);
            point.width = width;
            point.held = !point.passed && (0.0..=length).contains(then);
        }
    }
}

/// # Needles
impl Simulation {
    /// Points of the channels that the needle of a tool went through, from the first entry on: those that its end has passed, then
    /// those that hold it. A [`Thread`] through them takes the needle's place.
    ///
    /// # Errors
    /// When there is no such tool.
    pub fn needle_channel(&self, tool: Entity) -> Result<Vec<Hold>, ToolError> {
        let state = self.world().get::<EdgeState>(self.current(tool));
        let NeedleState { points, passed, .. } = &state.ok_or(ToolError::NoTool(tool))?.needle;
        Ok(passed.iter().chain(points.iter().map(|point| &point.hold)).cloned().collect())
    }

    /// The end of the needle of a tool, for the last point of a [`Thread`] that it draws. The thread needs a first tail, out of
    /// which it is drawn as long as that is free; before there are points of tissue it does nothing.
    ///
    /// ```
    /// use sinew::prelude::*;
    ///
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let needle = Needle { into: -DVec3::Z, ..Needle::new(0.03, 5e-4, 200.0, 5.0) };
    /// let needle = simulation.add_tool(Tool::needle("needle", needle, DVec3::Z * 0.1))?;
    /// let end = simulation.needle_end(needle)?;
    /// let thread = Thread { tails: [0.4, 0.0], ..Thread::new("suture", vec![end], 20.0) };
    /// let thread = simulation.add_thread(thread)?;
    /// // once it goes through both lips: `hold_thread` holds its tail, the needle draws it tight, and `tie_thread` ties it
    /// assert!(simulation.tie_thread(thread).is_err(), "there is no tissue yet");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// When there is no such tool, or it has no needle.
    pub fn needle_end(&self, tool: Entity) -> Result<Hold, ToolError> {
        let own = self.world().get_entity(self.current(tool)).ok();
        let own = own.filter(|own| own.get::<Tool>().is_some_and(|tool| tool.needle.is_some()));
        let order = own.and_then(|own| own.get::<Order>());
        order.map(|order| Hold::Needle(*order)).ok_or(ToolError::NoTool(tool))
    }
}
