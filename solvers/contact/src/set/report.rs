//! Results at the end of a step: forces on rows, and the reports of tools, pairs and pulls.

use super::*;
use crate::tool::PartReport;
use bevy_ecs::query::QueryFilter;
use sinew_engine::columns::set;

impl ContactSet {
    /// Force (N) on a tool with the elastic slip that is kept for the next step in place of that at the start: not the
    /// force of this step, but the one that some programs record.
    pub fn force_by_kept_slip(&self, tool: Entity) -> Option<DVec3> {
        let now = self.tools.iter().find(|now| now.entity == tool)?;
        let mut force = DVec3::ZERO;
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            if matches!(point.against, Against::Part(part) if now.parts.contains(&part)) {
                let n = point.normal;
                let before = point.slip - n * n.dot(point.slip);
                let slip = active.slip - before + point.kept_slip(active);
                let pull = (point.k * slip.length()).min(point.limit);
                force -= active.push - point.area * pull * slip.normalize_or_zero();
            }
        }
        Some(force)
    }

    /// Forces (N) that contact and pulls exert on vertex rows at the end of the last step, ascending.
    pub fn forces(&self) -> &[(VertexRow, DVec3)] {
        &self.kept.forces
    }

    /// Pressures (Pa) on vertex rows at the end of the last step, ascending; rows without are left out.
    pub fn pressures(&self) -> &[(VertexRow, f64)] {
        &self.kept.pressures
    }

    pub(super) fn keep_forces(&mut self) {
        let mut forces = Vec::new();
        let mut pressures: Vec<(VertexRow, f64)> = Vec::new();
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            let force = active.push + active.rub;
            let used = active.rows.into_iter().zip(active.weights).filter(|(_, w)| *w != 0.0);
            for (of, weight) in used {
                // what corners of ten-node tetrahedra have below 0 is no pressure
                let above = self.made.rows(of).map(|(_, own)| own.max(0.0)).sum::<f64>().max(1.0);
                for (row, own) in self.made.rows(of) {
                    forces.push((row, weight * own * force));
                    let area = self.vertex_area(row);
                    let is_surface = !matches!(point.against, Against::Hand(_));
                    if active.pressure > 0.0 && is_surface && area > 0.0 && own > 0.0 {
                        let share = weight.abs() * own / above;
                        pressures.push((row, share * point.area * active.pressure / area));
                    }
                }
            }
        }
        self.add_line_forces(&mut forces);
        sum_by_row(&mut forces);
        sum_by_row(&mut pressures);
        (self.kept.forces, self.kept.pressures) = (forces, pressures);
    }

    fn vertex_area(&self, row: VertexRow) -> f64 {
        for known in &self.skins {
            if let Ok(at) = known.skin.rows.binary_search(&row) {
                return known.skin.area[at];
            }
        }
        0.0
    }

    pub(super) fn report_tools(&mut self, world: &mut World, x: &RowPlaces, dt: f64) {
        let live = orders::<With<Tool>>(world);
        self.kept.tools.retain(|tool, _| live.contains(tool));
        // those that are away in this step feel nothing
        with_query::<(Entity, &Order, &mut ToolReport), With<Tool>, _>(world, |world, query| {
            for (entity, id, mut report) in query.iter_mut(world) {
                if !self.tools.iter().any(|now| now.entity == entity) && report.energy > 0.0 {
                    let ToolReport { rotation, opening, work, dissipation, .. } = *report;
                    // a spring with nothing to hold it back is where its hand is
                    let position = report.position - report.yields;
                    if let Some(kept) = self.kept.tools.get_mut(id) {
                        kept.yields = DVec3::ZERO;
                    }
                    let away = ToolReport { position, rotation, opening, ..ToolReport::default() };
                    *report = ToolReport { work, dissipation, ..away };
                }
            }
        });
        for index in 0..self.tools.len() {
            let mut report = self.report_tool(index, dt);
            if self.tools[index].tool.error_bar {
                report.other_points = Some(self.other_force(index, x));
            }
            let now = &self.tools[index];
            let state = self.kept.tools.entry(now.id).or_default();
            (state.pose, state.yields) = (now.end, now.spring.now);
            state.pierced.clone_from(&now.pierced);
            state.work += report.work;
            state.dissipation += report.dissipation;
            report.work = state.work;
            report.dissipation = state.dissipation;
            // a tool that was drawn in grows again
            state.drawn_in = self.parts[now.parts.clone()].iter().map(|p| p.drawn_in).collect();
            let edge = self.skins.iter().map(|k| k.skin.edge).fold(0.0, f64::max);
            for drawn_in in &mut state.drawn_in {
                *drawn_in = grown_again(*drawn_in, dt, edge);
            }
            self.figures.lag = self.figures.lag.max(report.lag);
            if let Ok(mut entity) = world.get_entity_mut(now.entity) {
                if let Some(mut tool) = entity.get_mut::<Tool>() {
                    tool.placed = false;
                }
                if let Some(state) = entity.get::<EdgeState>() {
                    let own = state.report;
                    (report.cut_area, report.fracture) = (own.area, own.fracture);
                    (report.separated, report.cut_vertices) = (own.separated, own.vertices);
                    let needle = &state.needle;
                    report.fracture += needle.fracture;
                    (report.inserted, report.punctures) = (needle.depth(), needle.punctures);
                }
                set(&mut entity, report);
            }
        }
    }

    /// Pose and motion of a tool, and nothing else.
    fn report_motion(&self, now: &ToolNow, dt: f64) -> ToolReport {
        let turn = now.end.rotation * now.start.rotation.inverse();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let origin = now.end.position + now.spring.now;
        let spring = now.tool.spring.unwrap_or(0.0);
        let mut report = ToolReport {
            position: origin,
            yields: now.spring.now,
            rotation: now.end.rotation,
            opening: now.end.opening,
            velocity: (now.end.position - now.start.position + now.spring.now - now.spring.begin)
                / dt,
            angular_velocity: turn.to_scaled_axis() / dt,
            lag: now.lag,
            pierced: !now.pierced.is_empty(),
            dissipation: now.released,
            energy: 0.5 * spring * now.spring.now.length_squared(),
            centre: origin,
            ..ToolReport::default()
        };
        if now.appears {
            (report.velocity, report.angular_velocity) = (DVec3::ZERO, DVec3::ZERO);
        }
        if now.parts.len() > 1 {
            report.parts = vec![PartReport::default(); now.parts.len()];
        }
        report
    }

    fn report_tool(&mut self, index: usize, dt: f64) -> ToolReport {
        let now = &self.tools[index];
        let mut report = self.report_motion(now, dt);
        let (spring, origin) = (now.spring.way(), report.position);
        // sums over the points that touch
        let (mut weight, mut centre) = (0.0, DVec3::ZERO);
        for part in &self.parts[now.parts.clone()] {
            report.drawn_in = report.drawn_in.max(part.drawn_in);
        }
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            let force = -(active.push + active.rub);
            if let Against::Edge(edge) = point.against
                && edge.tool == index
            {
                report.force += force;
                report.torque += (point.carried - origin).cross(force);
                let first = now.tool.start.opening;
                let way = now.tool.edge.map_or(DVec3::ZERO, |edge| edge.per_opening(first));
                report.closing += force.dot(now.end.rotation * way);
                report.work -= force.dot(point.carried - edge.from - spring);
                report.energy += stored(point, active);
                report.dissipation += lost(point, active);
                report.unconverged = self.figures.missed;
                weight += force.length();
                centre += force.length() * point.carried;
                continue;
            }
            if let Against::Needle(own) = &point.against
                && own.tool == index
            {
                let along = own.at(active.at);
                let way = active.at - own.now.carry(active.at, &own.start);
                report.force += force;
                report.torque += (active.at - origin).cross(force);
                report.work -= force.dot(way - spring);
                report.energy += along.stored;
                report.dissipation += along.lost;
                report.unconverged = self.figures.missed;
                *(if own.is_tip { &mut report.tip_force } else { &mut report.shaft_force }) +=
                    along.push;
                self.figures.friction_dissipation += if own.is_tip { 0.0 } else { along.lost };
                weight += force.length();
                centre += force.length() * active.at;
                continue;
            }
            let Against::Part(part) = point.against else { continue };
            if !now.parts.contains(&part) {
                continue;
            }
            report.force += force;
            report.normal -= active.push;
            report.friction -= active.rub;
            let torque = (active.at - origin).cross(force);
            report.torque += torque;
            let own = &now.tool.parts[part - now.parts.start];
            if own.jaw != 0.0 {
                let hinge = origin + now.end.rotation * now.tool.hinge.point;
                let axis = now.end.rotation * now.tool.hinge.axis.normalize();
                report.closing += own.jaw * axis.cross(active.at - hinge).dot(force);
            }
            if let Some(own) = report.parts.get_mut(part - now.parts.start) {
                own.force += force;
                own.torque += torque;
                own.depth = own.depth.max(-active.gap);
                let sticks = sticks(point, active);
                own.sticking += u32::from(sticks);
                own.slipping += u32::from(!sticks);
            }
            // what the tool's matter at this place went, or would have with its hand
            let part = &self.parts[part];
            let way = active.at - part.now.carry(active.at, &part.start);
            report.work -= force.dot(way - spring);
            report.energy += stored(point, active);
            report.unconverged = self.figures.missed;
            let lost = lost(point, active);
            report.dissipation += lost;
            self.figures.friction_dissipation += lost;
            if active.pressure > 0.0 {
                report.area += point.area;
                report.depth = report.depth.max(-active.gap);
                report.pressure = report.pressure.max(active.pressure);
                let push = point.area * active.pressure;
                weight += push;
                centre += push * active.at;
            }
            if sticks(point, active) {
                report.sticking += 1;
            } else {
                report.slipping += 1;
            }
        }
        // the work of a needle against its thread is in the thread's own report
        for (at, force) in self.lines.iter().filter_map(|line| line.pull_on_needle(now.id)) {
            report.force += force;
            report.torque += (at - origin).cross(force);
        }
        if weight > 0.0 {
            report.centre = centre / weight;
        }
        // local stiffness, and what substeps settled
        let local = self.local.iter().find(|(tool, _)| *tool == index);
        report.local_stiffness = local.map(|(_, stiffness)| *stiffness);
        let Settled { work, dissipation } = self.settled[index];
        report.work += work;
        report.dissipation += dissipation;
        self.figures.friction_dissipation += dissipation;
        report
    }

    /// Force (N) on a tool by points of the other kind at the same state.
    fn other_force(&mut self, index: usize, x: &RowPlaces) -> DVec3 {
        let mut force = DVec3::ZERO;
        for part in self.tools[index].parts.clone() {
            let own = part - self.tools[index].parts.start;
            for body in 0..self.skins.len() {
                if self.tools[index].pierced.contains(&[own, body]) {
                    continue;
                }
                let other = match self.kind_of_points(index, part, body) {
                    Points::Vertex => Points::Faces(2),
                    _ => Points::Vertex,
                };
                let mut points = Vec::new();
                self.collect(index, part, body, other, &mut points);
                let made = &self.made;
                let (now, start) = (|row| made.mean(row, x.now), |row| made.mean(row, x.start));
                for mut point in points {
                    point.friction = 0.0;
                    let active = point.evaluate(&self.parts, None, &now, &start, Limits::Take);
                    force -= active.push;
                }
            }
        }
        force
    }

    pub(super) fn report_pairs(&mut self, world: &mut World, x: &RowPlaces, dt: f64) {
        for now in &self.pairs {
            let edges = now.of.bodies.map(|body| self.skins[body].skin.edge);
            if let Some(state) = self.kept.pairs.get_mut(&now.id) {
                state.drawn_in = grown_again(state.drawn_in, dt, edges[0].min(edges[1]));
                if state.clear > 0.0 {
                    let now_at = |row| self.made.mean(row, x.now);
                    state.clear -= 2.0 * self.skins[now.of.bodies[0]].skin.largest_way(&now_at);
                }
            }
            let mut report = BodyContactReport::default();
            let own =
                |p: &ContactPoint| p.key.owner == now.id && matches!(p.against, Against::Faces(_));
            let points = self.points.iter().zip(&self.active);
            for (point, active) in points.filter(|(p, a)| a.on && own(p)) {
                let force = active.push + active.rub;
                if now.of.bodies[0] != now.of.bodies[1] {
                    report.force += if point.key.part == 0 { force } else { -force };
                }
                report.area += point.area;
                report.depth = report.depth.max(-active.gap);
                report.unconverged = self.figures.missed;
                let lost = lost(point, active);
                *self.kept.dissipated.entry(now.id).or_default() += lost;
                self.figures.friction_dissipation += lost;
                if sticks(point, active) {
                    report.sticking += 1;
                } else {
                    report.slipping += 1;
                }
            }
            report.dissipation = self.kept.dissipated.get(&now.id).copied().unwrap_or_default();
            if let Ok(mut entity) = world.get_entity_mut(now.entity) {
                set(&mut entity, report);
            }
        }
    }

    pub(super) fn report_pulls(&mut self, world: &mut World) {
        for (index, now) in self.pulls.iter_mut().enumerate() {
            let Ok(mut entity) = world.get_entity_mut(now.entity) else { continue };
            let mut report = entity.get::<PullReport>().copied().unwrap_or_default();
            (report.force, report.torque, report.distance) = (DVec3::ZERO, DVec3::ZERO, 0.0);
            report.unconverged = self.figures.missed;
            let pose = now.of.target;
            let centre = pose.centre + pose.translation;
            for (point, active) in self.points.iter().zip(&self.active) {
                let Against::Hand(hand) = point.against else { continue };
                if hand.pull != index {
                    continue;
                }
                let force = -(active.push + active.rub);
                report.force += force;
                report.torque += (hand.to - centre).cross(force);
                report.distance += point.area * active.gap;
                // what is left of the way after substeps
                report.work -= force.dot(hand.to - hand.from);
            }
            report.work += self.settled[self.tools.len() + index].work;
            set(&mut entity, report);
            if let Some(mut pull) = entity.get_mut::<Pull>() {
                pull.last = now.of.last;
                pull.anchors.clone_from(&now.of.anchors);
            }
        }
    }
}

/// The places in the order of creation of all things of a kind.
pub(super) fn orders<Kind: QueryFilter + 'static>(world: &mut World) -> Vec<Order> {
    with_query::<&Order, Kind, _>(world, |world, all| all.iter(world).copied().collect())
}

/// How far (m) a surface that was drawn in is after a step of `dt` (s), beside surfaces with edges of a mean length (m).
fn grown_again(drawn_in: f64, dt: f64, edge: f64) -> f64 {
    (drawn_in - (GROWTH * dt).min(0.5 * edge)).max(0.0)
}
