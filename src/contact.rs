//! Tools, contact between bodies and pulls of a [`Simulation`].

use crate::simulation::{BodyHandle, Simulation};
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_contact::pair::{BodyContact, BodyContactReport};
use sinew_contact::pull::{Pick, Pull, PullReport};
use sinew_contact::set::ContactSet;
use sinew_contact::thread::{Clip, Thread};
use sinew_contact::tool::{Tool, ToolError, ToolPose, ToolReport};
use sinew_engine::columns::single_table;
use sinew_engine::load::Pose;
use sinew_engine::row::LocalRow;
use sinew_engine::surface::SurfacePoint;
use sinew_engine::topology::BodyRows;
use sinew_engine::vertex::Position;
use std::collections::BTreeMap;

/// # Tools, contact and pulls
impl Simulation {
    /// Adds a tool; the entity identifies it. It touches all bodies from the next step on.
    ///
    /// # Errors
    /// When a size, coefficient or time of it cannot be used.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    ///
    /// let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [8, 8, 4])?;
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let body = simulation.add_body(&BodyDescription::new("box", &mesh, preset("liver")?.material))?;
    /// let floor = simulation.group_rows(body, &mesh, "z0")?;
    /// simulation.add_constraint(Constraint::hold("floor", floor));
    /// let above = DVec3::new(0.05, 0.05, 0.08);
    /// let tool = simulation.add_tool(Tool::new("finger", Shape::Sphere { radius: 0.03 }, above))?;
    /// for step in 1..=50 {
    ///     simulation.move_tool(tool, above - DVec3::Z * 0.0002 * f64::from(step))?;
    ///     simulation.step()?;
    /// }
    /// let report = simulation.tool_report(tool).unwrap();
    /// assert!(report.force.z > 0.1 && report.depth < 1e-3, "{report:?}");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn add_tool(&mut self, tool: Tool) -> Result<Entity, ToolError> {
        let rows = self.topology().vertex_count();
        match tool.problem(rows) {
            Some(problem) => Err(ToolError::Invalid { name: tool.name, problem }),
            None => Ok(self.world_mut().spawn(tool).id()),
        }
    }

    /// Moves a tool: it is at the pose (a vector is a position, m) at the end of the next step, evenly through the
    /// step, and stays there until it is moved again.
    ///
    /// # Errors
    /// When there is no such tool, it has a motion of its own, or the pose cannot be used.
    pub fn move_tool(&mut self, tool: Entity, pose: impl Into<ToolPose>) -> Result<(), ToolError> {
        let tool = self.current(tool);
        match self.world_mut().get_mut::<Tool>(tool) {
            Some(mut tool) => tool.set_target(pose),
            None => Err(ToolError::NoTool(tool)),
        }
    }

    /// Puts a tool somewhere else at once, without touching anything on the way.
    ///
    /// # Errors
    /// As [`Simulation::move_tool`].
    pub fn place_tool(&mut self, tool: Entity, pose: impl Into<ToolPose>) -> Result<(), ToolError> {
        let tool = self.current(tool);
        match self.world_mut().get_mut::<Tool>(tool) {
            Some(mut tool) => tool.place(pose),
            None => Err(ToolError::NoTool(tool)),
        }
    }

    /// Closes or opens the grip of a tool, from the next step on: what it touches while it is closed sticks to it; see
    /// [`Tool::grip`].
    ///
    /// # Errors
    /// When there is no such tool.
    pub fn set_grip(&mut self, tool: Entity, closed: bool) -> Result<(), ToolError> {
        let tool = self.current(tool);
        match self.world_mut().get_mut::<Tool>(tool) {
            Some(mut tool) => {
                tool.grip = closed;
                Ok(())
            }
            None => Err(ToolError::NoTool(tool)),
        }
    }

    /// What a tool felt in the last step; `None` when there is no such tool.
    pub fn tool_report(&self, tool: Entity) -> Option<&ToolReport> {
        self.world().get(self.current(tool))
    }

    /// Takes a tool, a contact between bodies, a pull, a thread or a clip away; whether there was one.
    pub fn remove_contact(&mut self, entity: Entity) -> bool {
        let entity = self.current(entity);
        let world = self.world_mut();
        let known = world.get::<Tool>(entity).is_some()
            || world.get::<BodyContact>(entity).is_some()
            || world.get::<Pull>(entity).is_some()
            || world.get::<Thread>(entity).is_some()
            || world.get::<Clip>(entity).is_some();
        known && world.despawn(entity)
    }

    /// Lets two bodies, or a body and itself, touch each other.
    pub fn add_body_contact(&mut self, contact: BodyContact) -> Entity {
        self.world_mut().spawn(contact).id()
    }

    /// What two bodies did to each other in the last step; `None` when there is no such contact.
    pub fn body_contact_report(&self, contact: Entity) -> Option<&BodyContactReport> {
        self.world().get(self.current(contact))
    }

    /// Pulls on vertex rows from the next step on.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    ///
    /// let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [4, 4, 2])?;
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let body = simulation.add_body(&BodyDescription::new("box", &mesh, preset("liver")?.material))?;
    /// let floor = simulation.group_rows(body, &mesh, "z0")?;
    /// simulation.add_constraint(Constraint::hold("floor", floor));
    /// // the mouse points at the middle of the top
    /// let pick = simulation.pick(DVec3::new(0.05, 0.04, 1.0), DVec3::NEG_Z).unwrap();
    /// assert!((pick.position.z - 0.05).abs() < 1e-12);
    /// let hand = Pull::new("mouse", pick.rows.to_vec(), 50.0, 0.1).with_weights(pick.weights.to_vec());
    /// let hand = simulation.add_pull(hand);
    /// simulation.move_pull(hand, DVec3::Z * 0.01);
    /// for _ in 0..50 {
    ///     simulation.step()?;
    /// }
    /// let report = simulation.pull_report(hand).unwrap();
    /// // the hand feels its spring, and a little of its damper
    /// assert!((report.force.length() / report.distance - 50.0).abs() < 5.0, "{report:?}");
    /// assert!(report.force.z < -0.05);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn add_pull(&mut self, pull: Pull) -> Entity {
        self.world_mut().spawn(pull).id()
    }

    /// Moves the pose that a pull draws to, relative to where its patch was when it took hold; a vector is a
    /// translation (m). It is reached at the end of the next step. Whether there is such a pull.
    pub fn move_pull(&mut self, pull: Entity, pose: impl Into<Pose>) -> bool {
        let pull = self.current(pull);
        match self.world_mut().get_mut::<Pull>(pull) {
            Some(mut pull) => {
                pull.target = pose.into();
                true
            }
            None => false,
        }
    }

    /// What a pull did in the last step; `None` when there is no such pull.
    pub fn pull_report(&self, pull: Entity) -> Option<&PullReport> {
        self.world().get(self.current(pull))
    }

    /// The first point of a surface that a ray from `origin` (m) meets; `direction` may have any length.
    pub fn pick(&mut self, origin: DVec3, direction: DVec3) -> Option<Pick> {
        let direction = direction.try_normalize()?;
        let bodies = self.topology().bodies.len();
        let mut found: Option<Pick> = None;
        for body in 0..bodies {
            let rows = self.topology().bodies[body].clone();
            let world = self.columns();
            let read = world.get_resource::<sinew_engine::surface::SurfaceReader>().copied()?;
            let surface = (read.0)(world, body);
            let mut places = world.query::<&Position>();
            let places = single_table(places.contiguous_iter(world))?;
            let own_rows = rows.row_count() as u32;
            let made = |v: u32| v.checked_sub(own_rows).map(|made| surface.points[made as usize]);
            let at = |v: u32| places[(rows.vertices.start + v) as usize].0;
            let place = |v: u32| match made(v) {
                Some(point) => point.shares().map(|(v, w)| w * at(v)).sum(),
                None => at(v),
            };
            for triangle in surface.triangles.iter().chain(&surface.sheets) {
                let Some((distance, weights)) =
                    sinew_contact::pull::hit(origin, direction, triangle.map(place))
                else {
                    continue;
                };
                if found.is_some_and(|found| distance >= found.distance) {
                    continue;
                }
                let (on, weights) = match triangle.iter().any(|v| made(*v).is_some()) {
                    true => nearest_vertices(triangle, weights, &made, &rows),
                    false => (*triangle, weights),
                };
                found = Some(Pick {
                    body,
                    rows: on.map(|v| rows.in_table(LocalRow(v))),
                    weights,
                    position: origin + distance * direction,
                    distance,
                });
            }
        }
        found
    }

    /// Pressures (Pa) that contact exerts on the vertices of a body at the end of the last step, in the user's order.
    pub fn contact_pressures(&self, body: BodyHandle) -> Vec<f64> {
        let rows = &self.topology().bodies[body.0];
        let mut result = vec![0.0; rows.mesh_vertices()];
        if let Some(contact) = self.world().get_resource::<ContactSet>() {
            for &(row, pressure) in contact.pressures() {
                if let Some(local) = rows.local(row) {
                    result[rows.vertex_of(local).index()] = pressure;
                }
            }
        }
        result
    }

    /// Forces (N) of contact and pulls on the vertices of a body at the end of the last step, in the user's order.
    pub fn contact_forces(&self, body: BodyHandle) -> Vec<DVec3> {
        let rows = &self.topology().bodies[body.0];
        let mut result = vec![DVec3::ZERO; rows.mesh_vertices()];
        if let Some(contact) = self.world().get_resource::<ContactSet>() {
            for &(row, force) in contact.forces() {
                if let Some(local) = rows.local(row) {
                    result[rows.vertex_of(local).index()] = force;
                }
            }
        }
        result
    }
}

/// Rows of vertices of the mesh, of the element that a point of a wound is in, that have most of it, and their shares. Ghosts are
/// taken only where there is nothing else.
fn nearest_vertices(
    triangle: &[u32; 3],
    weights: [f64; 3],
    made: &dyn Fn(u32) -> Option<SurfacePoint>,
    rows: &BodyRows,
) -> ([u32; 3], [f64; 3]) {
    let mut shares = BTreeMap::<u32, f64>::new();
    for (&corner, weight) in triangle.iter().zip(weights) {
        let of = made(corner).unwrap_or_else(|| SurfacePoint::of_row(corner));
        for (row, own) in of.shares() {
            *shares.entry(row).or_default() += weight * own;
        }
    }
    // those of corners of ten-node tetrahedra may be below 0
    shares.retain(|_, share| *share > 0.0);
    let is_ghost = |row: u32| row as usize >= rows.vertex_order.len();
    let mut shares: Vec<(u32, f64)> = shares.into_iter().collect();
    shares.sort_by(|a, b| is_ghost(a.0).cmp(&is_ghost(b.0)).then(b.1.total_cmp(&a.1)));
    let real = shares.iter().filter(|(row, _)| !is_ghost(*row)).count();
    shares.truncate(if real == 0 { 3 } else { real.min(3) });
    let sum: f64 = shares.iter().map(|(_, share)| share).sum();
    let (mut on, mut weights) = ([shares[0].0; 3], [1.0, 0.0, 0.0]);
    for (i, (row, share)) in shares.into_iter().enumerate().filter(|_| sum > 0.0) {
        (on[i], weights[i]) = (row, share / sum);
    }
    (on, weights)
}
