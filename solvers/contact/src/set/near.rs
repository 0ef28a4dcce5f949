//! Tools, pairs and pulls of the coming step, the surfaces near them, and the ways that tools may go.

use super::*;

impl ContactSet {
    /// Tools, pairs and pulls as they are, in order of creation.
    pub(super) fn read(&mut self, world: &mut World) -> Result<(), StepError> {
        with_query(world, |world, tools| self.read_tools(world, tools))?;
        let topology = world.resource::<Topology>();
        let (rows, bodies) = (topology.vertex_count(), topology.bodies.len());
        self.pairs = present(world, |pair: &BodyContact| {
            pair.problem(bodies).map(|problem| invalid(&pair.name, problem))
        })?;
        self.pulls = present(world, |pull: &Pull| {
            pull.problem(rows).map(|problem| invalid(&pull.name, problem))
        })?;
        Ok(())
    }

    /// Tools as they are: their poses at the start and the end of the step, part by part.
    fn read_tools(
        &mut self,
        world: &World,
        query: &mut QueryState<(Entity, &'static Order, &'static Tool)>,
    ) -> Result<(), StepError> {
        let clock = *world.resource::<StepClock>();
        let part = world.get_resource::<StepPart>().copied().unwrap_or_default();
        if part.index == 0 {
            match self.before_parts.take() {
                // that step failed in a later part, and is made again
                Some((step, before)) if step == clock.step => self.kept = *before,
                _ => {}
            }
            if part.count > 1 {
                self.before_parts = Some((clock.step, Box::new(self.kept.clone())));
            }
        }
        let t = clock.time + clock.dt;
        let rows = world.resource::<Topology>().vertex_count();
        let mut found: Vec<(Entity, &Order, &Tool)> = query.iter(world).collect();
        found.sort_unstable_by_key(|(entity, order, _)| (**order, *entity));
        self.tools.clear();
        self.parts.clear();
        for (entity, &id, tool) in found {
            if let Some(problem) = tool.problem(rows) {
                return Err(invalid(&tool.name, problem));
            }
            if !tool.active(t) {
                continue;
            }
            let known = self.kept.tools.get(&id);
            let mut start = match known {
                Some(state) => state.start(tool),
                // targets are reached from where it first stands
                None if tool.motion == ToolMotion::Follow => tool.start,
                None => tool.wanted(clock.time, tool.start),
            };
            let wanted = tool.wanted(t, start);
            let appears = known.is_none() || tool.placed;
            if tool.placed {
                start = wanted;
            }
            let end = match tool.motion {
                // what is left of the way, evenly over what is left of the step
                ToolMotion::Follow => start.towards(&wanted, part.share_of_rest()),
                _ => wanted,
            };
            let yields = known.filter(|_| tool.spring.is_some() && !appears);
            let yields = yields.map_or(DVec3::ZERO, |known| known.yields);
            let first = self.parts.len();
            let mut tool = tool.clone();
            tool.parts.shrink_to_fit();
            for i in 0..tool.parts.len() {
                let rigid = |pose| {
                    let (centre, rotation) = tool.part_pose(i, pose);
                    RigidPose { centre: centre + yields, rotation }
                };
                let (start, end) = (rigid(&start), rigid(&end));
                let drawn_in = known.filter(|_| !appears).and_then(|k| k.drawn_in.get(i)).copied();
                self.parts.push(PartNow {
                    of: tool.parts[i].clone(),
                    tool: self.tools.len(),
                    start,
                    end,
                    now: end,
                    drawn_in: drawn_in.unwrap_or(0.0),
                    slack: yields.length(),
                });
            }
            self.tools.push(ToolNow {
                entity,
                id,
                name: tool.name.clone(),
                start,
                end,
                begin: start,
                reached: end,
                spring: SpringNow { begin: yields, from: yields, now: yields, left: 0.0 },
                curved: false,
                lag: 0.0,
                appears,
                pierced: Vec::new(),
                released: 0.0,
                parts: first..self.parts.len(),
                tool,
            });
        }
        Ok(())
    }

    /// Whether a tool that acted in the last step stands elsewhere at the end of the coming one.
    fn any_moves(
        &self,
        world: &World,
        query: &mut QueryState<(&'static Order, &'static Tool)>,
    ) -> bool {
        let clock = *world.resource::<StepClock>();
        let moves = |(id, tool): (&Order, &Tool)| {
            let start = self.memory(clock.step).tools.get(id).map(|state| state.start(tool));
            start.is_some_and(|start| tool.wanted(clock.time + clock.dt, start) != start)
        };
        query.iter(world).any(moves)
    }

    /// Surfaces of the bodies as they are now, whatever was known of them before.
    pub(super) fn know(&mut self, world: &mut World) -> Result<(), StepError> {
        let topology = world.resource::<Topology>();
        let versions: Vec<(u64, u64)> =
            topology.bodies.iter().map(|body| (topology.revision + 1, body.changes)).collect();
        let live: Vec<Order> = self.tools.iter().map(|now| now.id).collect();
        self.own_skins.retain(|(tool, _), _| live.contains(tool));
        let alone = |now: &ToolNow| now.parts.is_empty() && now.tool.needle.is_none();
        if self.pairs.is_empty() && self.tools.iter().all(alone) {
            // pulls, threads and edges have no surface to meet; that of a body tells needles how stiff it is
            self.skins.resize_with(versions.len(), KnownSkin::default);
            return Ok(());
        }
        let own = |now: &&ToolNow| now.tool.faces.is_some();
        let known = |(body, version): (usize, &(u64, u64))| {
            let of_tool = |now: &ToolNow| self.own_skins.get(&(now.id, body));
            let mut own = self.tools.iter().filter(own).map(of_tool);
            self.skins.get(body).is_some_and(|known| known.version == *version)
                && own.all(|known| known.is_some_and(|known| known.version == *version))
        };
        if versions.iter().enumerate().all(known) {
            return Ok(());
        }
        self.fitted = false;
        // new faces may be nearer than those that went
        self.kept.pairs.values_mut().for_each(|state| state.clear = 0.0);
        let rest: Vec<DVec3> = with_query::<&RestPosition, (), _>(world, |world, rest| {
            rest.iter(world).map(|x| x.0).collect()
        });
        let Some(SurfaceReader(read)) = world.get_resource::<SurfaceReader>().copied() else {
            return Ok(());
        };
        self.skins.resize_with(versions.len(), KnownSkin::default);
        // a cut gives the points of all bodies other numbers
        let is_cut =
            world.resource::<Topology>().bodies.iter().any(|own| !own.copies.portions.is_empty());
        let mut made = MadePoints::none(rest.len());
        for (body, version) in versions.into_iter().enumerate() {
            let first = world.resource::<Topology>().bodies[body].vertices.start;
            let mut surface = None;
            let mut from = u32::MAX;
            if is_cut || self.skins[body].version != version {
                let read = read(world, body);
                from = if read.points.is_empty() {
                    u32::MAX
                } else {
                    made.push(&read, VertexRow(first))
                };
                let at_rest = |row| made.mean(row, &|row: VertexRow| rest[row.index()]);
                let skin = ContactSkin::new(&read, [first, from], &at_rest, None);
                // a body whose last face was removed is touched no more
                let own = &world.resource::<Topology>().bodies[body];
                let pair = self.pairs.iter().find(|n| n.of.bodies.contains(&body));
                if let Some(pair) = pair
                    && skin.faces.is_empty()
                    && own.changes == 0
                {
                    return Err(StepError::InvalidContact {
                        name: pair.of.name.clone(),
                        problem: format!(
                            "body `{}` has no surface that could be touched",
                            own.name
                        ),
                    });
                }
                self.skins[body] = KnownSkin { version, skin };
                surface = Some(read);
            }
            for now in self.tools.iter().filter(|now| now.tool.faces.is_some()) {
                let own = self.own_skins.entry((now.id, body)).or_default();
                if own.version != version {
                    let surface = surface.get_or_insert_with(|| read(world, body));
                    let faces = now.tool.faces.as_deref();
                    let at_rest = |row| made.mean(row, &|row: VertexRow| rest[row.index()]);
                    let skin = ContactSkin::new(surface, [first, from], &at_rest, faces);
                    *own = KnownSkin { version, skin };
                }
            }
        }
        self.made = made;
        Ok(())
    }

    /// Brings the places of surfaces that are known up to date.
    pub(super) fn refit(
        &mut self,
        world: &mut World,
        dt: f64,
        x: &dyn Fn(VertexRow) -> DVec3,
        v: &dyn Fn(VertexRow) -> DVec3,
    ) {
        let made = &self.made;
        let own = self.own_skins.values_mut();
        for known in self.skins.iter_mut().chain(own) {
            known.skin.refit(dt, &|row| made.mean(row, x), &|row| made.mean(row, v));
        }
        with_query::<&FixedAxes, (), _>(world, |world, fixed| {
            let Some(fixed) = single_table(fixed.contiguous_iter(world)) else { return };
            for known in &mut self.skins {
                let held = |of: &VertexRow| {
                    made.rows(*of).all(|(row, _)| fixed[row.index()] == FixedAxes::ALL)
                };
                known.skin.held = !known.skin.rows.is_empty() && known.skin.rows.iter().all(held);
            }
        });
    }

    /// The surface of a body that a tool may touch.
    pub(super) fn skin(&self, tool: &ToolNow, body: usize) -> &ContactSkin {
        match self.own_skins.get(&(tool.id, body)) {
            Some(own) if tool.tool.faces.is_some() => &own.skin,
            _ => &self.skins[body].skin,
        }
    }

    /// Shortens the ways of tools that are too long for their thickness, where they meet tissue.
    pub(super) fn limit_ways(&mut self) {
        for index in 0..self.tools.len() {
            let now = &self.tools[index];
            let mut share = 1.0_f64;
            for part in &self.parts[now.parts.clone()] {
                let way = part.longest_way();
                let most = self.longest_step(part);
                if way > most && self.meets(part, now) {
                    share = share.min(most / way);
                }
            }
            if share < 1.0 && !now.appears {
                let end = now.start.towards(&now.end, share);
                let lag = end.position.distance(now.end.position);
                let now = &mut self.tools[index];
                (now.end, now.lag) = (end, lag);
                self.figures.lagging += 1;
                self.place_parts(index);
            }
        }
    }

    /// Most (m) that a part may move at once.
    fn longest_step(&self, part: &PartNow) -> f64 {
        let edge = self.skins.iter().map(|known| known.skin.edge).fold(0.0, f64::max);
        let thickness = part.of.shape.thickness();
        LONGEST_WAY[usize::from(thickness < edge)] * thickness
    }

    /// Whether the way of a part leads through the box of a body.
    fn meets(&self, part: &PartNow, tool: &ToolNow) -> bool {
        let swept = swept(part);
        (0..self.skins.len()).any(|body| overlap(&self.skin(tool, body).hull, &swept))
    }

    fn place_parts(&mut self, tool: usize) {
        let now = &self.tools[tool];
        for (i, part) in self.parts[now.parts.clone()].iter_mut().enumerate() {
            let (centre, rotation) = now.tool.part_pose(i, &now.end);
            part.end = RigidPose { centre: centre + now.spring.from, rotation };
            part.now = part.end;
        }
    }

    /// Substeps that the step to come needs, so that no tool passes through what it meets: 1 in all but fast motion.
    pub fn substeps(&mut self, world: &mut World, positions: fn(&mut World) -> Vec<DVec3>) -> u32 {
        if !with_query(world, |world, tools| self.any_moves(world, tools)) {
            return 1;
        }
        // errors come back in the step
        if self.read(world).is_err() || self.tools.iter().all(|now| now.appears) {
            return 1;
        }
        if self.know(world).is_err() {
            return 1;
        }
        let mut most = 1.0_f64;
        let mut at = Vec::new();
        for now in self.tools.iter().filter(|now| !now.appears) {
            for part in &self.parts[now.parts.clone()] {
                let ways = part.longest_way() / self.longest_step(part);
                if ways <= most {
                    continue;
                }
                let swept = swept(part);
                if at.is_empty() {
                    at = positions(world);
                }
                let near = (0..self.skins.len()).any(|body| {
                    let skin = self.skin(now, body);
                    let mut hull = EMPTY;
                    for &row in &skin.rows {
                        let Some(at) = at.get(row.index()) else { continue };
                        hull = [hull[0].min(*at), hull[1].max(*at)];
                    }
                    overlap(&grown(hull, skin.edge), &swept)
                });
                if near {
                    most = ways;
                }
            }
        }
        (most.ceil() as u32).clamp(1, MOST_SUBSTEPS)
    }
}

/// The box (m) that a part passes in the step.
fn swept(part: &PartNow) -> [DVec3; 2] {
    let (start, end) = (part.bounds(&part.start), part.bounds(&part.end));
    [start[0].min(end[0]), start[1].max(end[1])]
}

/// All components of a kind, in order of creation.
fn present<T: Component + Clone>(
    world: &mut World,
    error: impl Fn(&T) -> Option<StepError>,
) -> Result<Vec<Now<T>>, StepError> {
    with_query::<(Entity, &Order, &T), (), _>(world, |world, all| {
        let mut found = Vec::new();
        for (entity, &id, of) in all.iter(world) {
            if let Some(error) = error(of) {
                return Err(error);
            }
            found.push(Now { entity, id, of: of.clone() });
        }
        found.sort_unstable_by_key(|now| (now.id, now.entity));
        Ok(found)
    })
}

fn invalid(name: &str, problem: String) -> StepError {
    StepError::InvalidContact { name: name.into(), problem }
}
