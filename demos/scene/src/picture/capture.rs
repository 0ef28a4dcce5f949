//! Makes a recording of a scene while it runs: an observer that copies what pictures need.

use super::boundary::{Face, boundary};
use super::measure::MeasuredBody;
use super::quantity::Quantity;
use super::tools::{Force, Tools, append};
use super::wound::Wound;
use crate::assemble::{BuiltBody, BuiltScene};
use crate::probe;
use crate::run::Observer;
use crate::scene::Mode;
use bevy_ecs::entity::Entity;
use bevy_ecs::world::World;
use glam::{DVec3, Vec3};
use sinew::engine::connectivity::ElementKind;
use sinew::engine::load::{Constraint, Load, Motion, Pressure};
use sinew::engine::mesh::Mesh;
use sinew::engine::report::SystemTimes;
use sinew::engine::row::{MeshVertex, VertexRow};
use sinew::engine::step::StepClock;
use sinew::engine::topology::BodyRows;
use sinew::models::body::SoftBody;
use sinew::touch::pull::{Pull, PullReport};
use sinew_render::colour::{ColourMap, Rgb};
use sinew_render::scale::with_unit;
use sinew_render::scene::{Arrow, Ball, Cell, Frame, Graph, Recording, Rod, Series};
use sinew_render::skin::{CREASE_ANGLE, Facet, Skin};
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

/// Held vertices.
const HELD: Rgb = [58, 70, 90];
/// Moved vertices, and the forces that move them.
const MOVED: Rgb = [222, 112, 30];
/// Tools that cut.
const CUTTER: Rgb = [168, 176, 186];
/// Loads.
const LOAD: Rgb = [196, 48, 58];
/// Fibres over the map whose colours are dark or saturated, and over all else.
const FIBRE: [Rgb; 2] = [[248, 248, 244], [44, 30, 44]];

/// What is recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureOptions {
    /// Frames in all, first and last included; those of the scene's output without.
    pub frames: Option<usize>,
    /// Scalars, in this order.
    pub quantities: Vec<Quantity>,
    /// Angle (degrees) between faces above which edges stay sharp.
    pub crease: f32,
    /// Steps between frames of a recording whose end nobody knows, in place of those of the scene's output. Where there come to
    /// be too many, every second goes and the steps between them double.
    pub every: Option<u64>,
    /// Steps of this run in one of the run whose frames it must meet; 1 for a run of its own.
    pub substeps: u64,
    /// For a page: with what is inside of bodies and what probes record, and within a bound on its size.
    pub page: bool,
}

/// Bytes of all points and values of a page before they are packed, and its frames: of more, some are left out.
const PAGE: (usize, usize) = (24 << 20, 600);
/// Points up to which a page can cut bodies open.
const INSIDE: usize = 30_000;
/// Elements above which a page that was not asked for more shows displacements alone: strains take memory and time.
const MEASURED: usize = 200_000;
/// Points of a line over time at which half of them, the extremes, are kept.
const LINE: usize = 8192;

impl Default for CaptureOptions {
    fn default() -> Self {
        Self {
            frames: None,
            every: None,
            quantities: vec![Quantity::Displacement],
            crease: CREASE_ANGLE,
            substeps: 1,
            page: false,
        }
    }
}

/// A body and where its points are among all: those of its mesh, then those of the surface that it carries.
struct BodyPart {
    first: usize,
    /// Whether that surface is drawn in place of its own.
    carries: bool,
    measured: Option<MeasuredBody>,
    faces: Vec<Face>,
    /// Count of changes of the body at the last look.
    changes: Option<u64>,
    /// Since it was cut.
    wound: Option<Box<Wound>>,
}

/// Pressure (Pa) along the normal of a face, at its middle.
type Push = (Vec3, f32, Vec3);

/// Arrows of a pressure.
const PUSHES: usize = 40;

/// An observer that records.
pub struct Recorder {
    /// Name of what is recorded.
    name: String,
    options: CaptureOptions,
    /// Steps done when it began, and most frames, where nobody knows the end.
    open: (u64, usize),
    parts: Vec<BodyPart>,
    /// Place of each point of the scene among those recorded.
    place: Vec<u32>,
    kept: Vec<u32>,
    wanted: Vec<u64>,
    skin: Arc<Skin>,
    radius: f32,
    recording: Recording,
    forces: Vec<Vec<Force>>,
    tools: Tools,
    pushes: Vec<Vec<Push>>,
    /// Largest force (N) and pressure (Pa) of arrows so far.
    largest: [f32; 2],
    /// Of every pressure: its faces at the last look, and those with an arrow.
    pushed: HashMap<Entity, (usize, Vec<usize>)>,
    /// Values of probes before the first step, which are read before anybody is told of the scene.
    before: Vec<f64>,
    /// Frames that the scene asks for.
    pub(super) due: usize,
    /// The element behind every cell, and its body.
    elements: Vec<(usize, ElementKind, u32)>,
    seconds: f64,
}

impl Recorder {
    /// For a run that has this name.
    pub fn new(name: impl Into<String>, options: CaptureOptions) -> Self {
        let recording = Recording {
            up: Vec3::Z,
            fields: options.quantities.iter().filter_map(|q| q.field()).collect(),
            ..Recording::default()
        };
        Self {
            name: name.into(),
            options,
            open: (0, PAGE.1),
            parts: Vec::new(),
            place: Vec::new(),
            kept: Vec::new(),
            wanted: Vec::new(),
            skin: Arc::default(),
            radius: 0.0,
            tools: Tools::new(recording.fields.first()),
            recording,
            forces: Vec::new(),
            pushes: Vec::new(),
            largest: [0.0; 2],
            pushed: HashMap::new(),
            before: Vec::new(),
            due: 0,
            elements: Vec::new(),
            seconds: 0.0,
        }
    }

    /// The recording, with colour ranges and lengths of arrows that suit all its frames, and the host time (s)
    /// that it took.
    pub fn finish(mut self) -> (Recording, f64) {
        let start = Instant::now();
        if let [first, .., last] = &self.recording.frames[..]
            && !self.recording.is_static
        {
            let intervals = self.recording.frames.len() - 1;
            self.recording.interval = (last.time - first.time) / intervals as f64;
        }
        self.recording.forces.retain(|series| series.points.iter().any(|p| p[1] > 0.0));
        self.complete();
        self.seconds += start.elapsed().as_secs_f64();
        (self.recording, self.seconds)
    }

    /// The state now alone, after so many steps. Ranges of colours and lengths of arrows suit all states that were shown.
    #[cfg(feature = "render")]
    pub(super) fn show(&mut self, built: &mut BuiltScene, step: u64) -> &mut Recording {
        if self.parts.is_empty() {
            self.prepare(built);
        }
        let Self { recording, forces, pushes, .. } = self;
        // of what does not vary a range is but a guess
        let varies = |(i, field): (usize, &sinew_render::scene::Field)| {
            let rest = if field.map == ColourMap::Diverging { 1.0 } else { 0.0 };
            let values = recording.frames.first().and_then(|frame| frame.fields.get(i));
            let mut values = values.into_iter().flatten().filter(|x| x.is_finite());
            values.any(|x| *x != rest).then_some(field.range)
        };
        let ranges: Vec<_> = recording.fields.iter().enumerate().map(varies).collect();
        recording.frames.clear();
        forces.clear();
        pushes.clear();
        recording.forces.iter_mut().for_each(|series| series.points.clear());
        let time = built.simulation.time();
        self.tools.forces(built.simulation.world_mut(), time, &mut self.recording.forces);
        self.record(built, step);
        self.complete();
        for (field, known) in self.recording.fields.iter_mut().zip(ranges) {
            let [low, high] = known.unwrap_or(field.range);
            field.range = [field.range[0].min(low), field.range[1].max(high)];
        }
        &mut self.recording
    }

    /// Gives all frames their arrows, notes and ranges of colours.
    fn complete(&mut self) {
        for frame in &mut self.recording.frames {
            // points that cuts made later
            frame.points.extend(&self.recording.rest[frame.points.len()..]);
            frame.fields.iter_mut().for_each(|own| own.resize(frame.points.len(), f32::NAN));
        }
        let largest = self.forces.iter().flatten().map(|f| f.force.length());
        let largest = largest.fold(self.largest[0], f32::max);
        let scale = 0.2 * self.recording.size() / largest.max(f32::MIN_POSITIVE);
        for (frame, forces) in self.recording.frames.iter_mut().zip(&self.forces) {
            for &Force { at, force, ends, colour } in forces {
                let along = force * scale;
                // an arrow shorter than its head says nothing
                if force.length() > 0.02 * largest {
                    let to = if ends { at } else { at + along };
                    let (to, along) = (to.to_array(), along.to_array());
                    frame.arrows.push(Arrow { to, along, colour });
                }
            }
        }
        self.largest[0] = largest;
        let largest = self.pushes.iter().flatten().map(|p| p.1.abs());
        let largest = largest.fold(self.largest[1], f32::max);
        let scale = 0.06 * self.recording.size() / largest.max(f32::MIN_POSITIVE);
        for (frame, pushes) in self.recording.frames.iter_mut().zip(&self.pushes) {
            for &(at, push, normal) in pushes.iter().filter(|p| p.1.abs() > 0.1 * largest) {
                let along = normal * (push * scale);
                // suction begins at the surface
                let to = if push > 0.0 { at } else { at + along };
                let (to, along) = (to.to_array(), along.to_array());
                frame.arrows.push(Arrow { to, along, colour: LOAD });
            }
        }
        self.largest[1] = largest;
        set_ranges(&mut self.recording);
        for frame in self.recording.frames.iter_mut().filter(|frame| frame.step > 0) {
            frame.note = note(&self.recording.forces, frame);
        }
        self.tools.finish(&mut self.recording);
    }

    fn prepare(&mut self, built: &mut BuiltScene) {
        let cutting = self.opens(built);
        let r = &mut self.recording;
        r.is_static = built.plan.mode == Mode::Static;
        r.falling = !(built.resections.is_empty() && built.cuts.is_empty());
        r.up = -built.plan.gravity.normalize_or_zero().as_vec3();
        if r.up == Vec3::ZERO {
            r.up = Vec3::Z;
        }
        (r.title, r.subtitle) = titles(&self.name, built);
        if self.options.page
            && self.options.quantities.first() == Some(&Quantity::default())
            && built.element_count() > MEASURED
        {
            self.options.quantities.retain(|q| q.index().is_none());
            r.fields = self.options.quantities.iter().filter_map(|q| q.field()).collect();
        }
        let needs_measures = self.options.quantities.iter().any(|q| q.index().is_some());
        let mut points = Vec::new();
        for (i, body) in built.bodies.iter().enumerate() {
            let world = built.simulation.world_mut();
            let measured = (needs_measures || has_fibres(body)).then(|| measured(world, i, body));
            let (first, faces, changes, wound) = (points.len(), Vec::new(), None, None);
            // cuts open the body, and only a skin knows of them
            let follows = !cutting || built.simulation.carries_surface(body.handle);
            let carries = body.carried.is_some() && follows;
            self.parts.push(BodyPart { first, carries, measured, faces, changes, wound });
            points.extend(body.mesh.points.iter().map(|p| p.as_vec3().to_array()));
            if let Some(carried) = body.carried.as_ref().filter(|_| carries) {
                points.extend(carried.points.iter().map(|p| p.as_vec3().to_array()));
            }
            r.bodies.push(body.name.clone());
        }
        self.faces(built);
        if self.options.page {
            self.inside(built, points.len());
            if self.options.every.is_none() {
                let quantities = probe::quantities(&built.probes);
                self.recording.graphs = quantities.map(graph).collect();
            }
            let before = std::mem::take(&mut self.before);
            self.probed(0.0, &before);
        }
        let r = &mut self.recording;
        // only what can be seen, unless removals or a page open bodies
        let mut kept = vec![cutting; points.len()];
        for part in &self.parts {
            // points that cuts made are not among them
            let most = part.wound.as_ref().map_or(u32::MAX, |wound| wound.fixed as u32);
            for v in part.faces.iter().flat_map(|f| f.vertices).filter(|v| *v < most) {
                kept[part.first + v as usize] = true;
            }
        }
        for v in r.cells.iter().flat_map(|cell| cell.points) {
            kept[v as usize] = true;
        }
        self.place = vec![u32::MAX; points.len()];
        for (i, _) in kept.iter().enumerate().filter(|(_, kept)| **kept) {
            self.place[i] = self.kept.len() as u32;
            self.kept.push(i as u32);
        }
        let place = &self.place;
        r.cells.iter_mut().for_each(|cell| cell.points = cell.points.map(|v| place[v as usize]));
        r.rest = self.kept.iter().map(|&i| points[i as usize]).collect();
        self.skin = self.new_skin();
        let r = &mut self.recording;
        r.rest_skin = self.skin.clone();
        let skin = &self.skin;
        let at = |v: u32| Vec3::from_array(r.rest[skin.points[v as usize] as usize]);
        let mut lengths: Vec<f32> =
            skin.triangles.iter().map(|&[a, b, _]| at(a).distance(at(b))).collect();
        lengths.sort_unstable_by(f32::total_cmp);
        let typical = lengths.get(lengths.len() / 2).copied().unwrap_or(0.0);
        self.radius = (0.22 * typical).clamp(0.003 * r.size(), 0.0085 * r.size());
        let substeps = self.options.substeps.max(1);
        let steps = built.plan.steps / substeps;
        let every = (built.plan.frame_every / substeps).max(1);
        self.wanted = match self.options.frames {
            Some(frames) => {
                let last = frames.max(2) as u64 - 1;
                (0..=last).map(|i| (i * steps + last / 2) / last).collect()
            }
            None => (0..=steps).filter(|step| *step == steps || step % every == 0).collect(),
        };
        self.wanted.iter_mut().for_each(|step| *step *= substeps);
        self.wanted.dedup();
        self.due = self.wanted.len();
        self.open.0 = built.simulation.world().resource::<StepClock>().step;
        if self.options.page && self.options.frames.is_none() {
            // every cut may bring a new surface
            let of_point = 6 + self.recording.fields.len() + if cutting { 32 } else { 0 };
            // and points of wounds, about as many as vertices are kept for it
            let spare: usize = built.simulation.topology().bodies.iter().map(|b| b.spare).sum();
            let points = self.kept.len() + spare;
            let most = (PAGE.0 / (of_point * points).max(1)).clamp(2, PAGE.1);
            self.open.1 = most;
            let (every, last) = ((self.due - 1).div_ceil(most - 1).max(1), self.due - 1);
            let mut at = 0..;
            self.wanted
                .retain(|_| at.next().is_some_and(|i: usize| i.is_multiple_of(every) || i == last));
        }
    }

    /// What fills the bodies, by indices among all points, as far as it is not too much.
    fn inside(&mut self, built: &BuiltScene, points: usize) {
        if points > INSIDE {
            return;
        }
        // cells of a lattice stick out of the surface that the body carries
        let parts = self.parts.iter().enumerate().filter(|(_, part)| !part.carries);
        for (i, part) in parts {
            for (corners, kind, element) in filling(&built.bodies[i].mesh) {
                let points = corners.map(|v| v + part.first as u32);
                self.recording.cells.push(Cell { points, body: i as u16, born: 0, gone: u32::MAX });
                self.elements.push((i, kind, element));
            }
        }
    }

    /// One more point of every line of the probes.
    fn probed(&mut self, time: f64, probes: &[f64]) {
        let lines = self.recording.graphs.iter_mut().flat_map(|graph| &mut graph.lines);
        for (line, value) in lines.zip(probes).filter(|(_, value)| value.is_finite()) {
            line.points.push([time, *value]);
            if line.points.len() >= LINE {
                line.points = line.thinned(LINE / 2);
            }
        }
    }

    /// Marks cells whose elements were removed or parted, and fills what was parted anew.
    fn change_cells(&mut self, built: &BuiltScene) {
        let left = |body: &BuiltBody, kind| body.whole(&built.simulation, kind);
        let left: Vec<_> = built
            .bodies
            .iter()
            .map(|b| [ElementKind::Tetrahedron, ElementKind::Hexahedron].map(|kind| left(b, kind)))
            .collect();
        let now = self.recording.frames.len() as u32;
        let (whole, parted) = self.recording.cells.split_at_mut(self.elements.len());
        for (cell, (body, kind, e)) in whole.iter_mut().zip(&self.elements) {
            let left = &left[*body][usize::from(*kind == ElementKind::Hexahedron)];
            if cell.gone == u32::MAX && left.binary_search(e).is_err() {
                cell.gone = now;
            }
        }
        parted.iter_mut().for_each(|cell| cell.gone = cell.gone.min(now));
        if self.elements.is_empty() {
            return;
        }
        // what is inside of a surface that a body carries is not shown
        for (i, part) in self.parts.iter().enumerate().filter(|(_, part)| !part.carries) {
            for (corners, _) in part.wound.iter().flat_map(|wound| &wound.skin.cells) {
                let points = corners.map(|v| self.slot(part, v));
                let (body, born, gone) = (i as u16, now, u32::MAX);
                self.recording.cells.push(Cell { points, body, born, gone });
            }
        }
    }

    /// Where a point of a body is among those recorded.
    fn slot(&self, part: &BodyPart, point: u32) -> u32 {
        let made = part.wound.as_ref().and_then(|wound| wound.place(point));
        made.unwrap_or_else(|| self.place[part.first + point as usize])
    }

    /// Looks for removed elements and cuts; returns whether there are any new ones.
    fn faces(&mut self, built: &mut BuiltScene) -> bool {
        let mut changed = false;
        let BuiltScene { simulation, bodies, .. } = built;
        for (part, body) in self.parts.iter_mut().zip(&*bodies) {
            let changes = Some(simulation.topology().bodies[body.handle.0].changes);
            if changes == part.changes {
                continue;
            }
            part.changes = changes;
            if simulation.has_skin(body.handle)
                && let Some(faces) = part.wound.get_or_insert_default().faces(simulation, body)
            {
                (part.faces, changed) = (faces, true);
                continue;
            }
            part.wound = None;
            if let Some(carried) = body.carried.as_ref().filter(|_| part.carries) {
                let first = body.mesh.points.len() as u32;
                let face = |t: &[u32; 3]| Face {
                    vertices: t.map(|v| first + v),
                    element: None,
                    second: false,
                };
                part.faces = carried.triangles.iter().map(face).collect();
                changed = true;
                continue;
            }
            // there is such a body
            let solid = simulation.surface(body.handle).unwrap_or_default();
            let left = |kind| body.whole(simulation, kind).into_iter();
            let triangles = left(ElementKind::Triangle);
            let triangles: Vec<_> =
                triangles.map(|e| body.membrane_triangles()[e as usize]).collect();
            let quads = left(ElementKind::Quad);
            let quads: Vec<_> = quads.map(|e| body.membrane_quads()[e as usize]).collect();
            part.faces = boundary(&solid, &triangles, &quads);
            changed = true;
        }
        changed
    }

    fn new_skin(&mut self) -> Arc<Skin> {
        let mut depth = vec![f32::NAN; self.kept.len()];
        for wound in self.parts.iter_mut().filter_map(|part| part.wound.as_mut()) {
            wound.first = depth.len();
            for (rest, own) in wound.made() {
                match self.recording.rest.get_mut(depth.len()) {
                    Some(known) => *known = rest,
                    None => self.recording.rest.push(rest),
                }
                depth.push(own);
            }
        }
        let this = &*self;
        let facets = this.parts.iter().enumerate().flat_map(|(body, part)| {
            let slots = |f: &Face| f.vertices.map(|v| this.slot(part, v));
            part.faces.iter().map(move |f| (slots(f), body as u16))
        });
        let facets: Vec<Facet> = facets.collect();
        Arc::new(Skin::with_wounds(&facets, &self.recording.rest, &depth, self.options.crease))
    }

    fn record(&mut self, built: &mut BuiltScene, step: u64) {
        let start = Instant::now();
        let time = built.simulation.time();
        let cutting = self.opens(built);
        if step > 0 && cutting && self.faces(built) {
            self.skin = self.new_skin();
            self.change_cells(built);
        }
        let mut points = Vec::with_capacity(self.kept.len());
        let mut fields = vec![Vec::with_capacity(self.kept.len()); self.recording.fields.len()];
        let (mut balls, mut rods) = (Vec::new(), Vec::new());
        let mut displacements = Vec::new();
        let (mut made, mut values_made) = (Vec::new(), vec![Vec::new(); fields.len()]);
        for (part, body) in self.parts.iter_mut().zip(&built.bodies) {
            let mut u = built.simulation.displacements(body.handle);
            let wound = part.wound.as_mut();
            let parted =
                wound.map_or(Vec::new(), |own| own.update(&mut built.simulation, body, &mut u));
            let pressed = self.options.quantities.contains(&Quantity::Pressure);
            let pressures =
                if pressed { built.simulation.contact_pressures(body.handle) } else { Vec::new() };
            let measures = part.measured.as_ref().map(|measured| {
                let left = |kind| body.whole(&built.simulation, kind);
                let solids = solid_indices(
                    body,
                    &left(ElementKind::Tetrahedron),
                    &left(ElementKind::Hexahedron),
                );
                let triangles = left(ElementKind::Triangle);
                let quads = left(ElementKind::Quad);
                let count = body.membrane_triangles().len();
                measured.at_vertices(&u, &solids, &parted, &|e| {
                    if e < count {
                        triangles.binary_search(&(e as u32)).is_ok()
                    } else {
                        quads.binary_search(&((e - count) as u32)).is_ok()
                    }
                })
            });
            let quantities: Vec<Quantity> =
                self.options.quantities.iter().filter(|q| q.field().is_some()).copied().collect();
            let value = |v: usize, quantity: Quantity| match (quantity.index(), &measures) {
                (Some(k), Some(measures)) => measures[v][k],
                _ if quantity == Quantity::Pressure => pressures.get(v).copied().unwrap_or(0.0),
                _ => u[v].length(),
            };
            for (v, (x, u)) in body.mesh.points.iter().zip(&u).enumerate() {
                if self.place[part.first + v] == u32::MAX {
                    continue;
                }
                points.push((*x + *u).as_vec3().to_array());
                for (values, &quantity) in fields.iter_mut().zip(&quantities) {
                    values.push(value(v, quantity) as f32);
                }
            }
            if let Some(carried) = body.carried.as_ref().filter(|_| part.carries) {
                let moved: Vec<DVec3> = match &part.wound {
                    Some(wound) => wound.skin.points[wound.of_surface()].to_vec(),
                    None => {
                        let moved = carried.embedding.displacements(&u);
                        carried.points.iter().zip(moved).map(|(x, u)| *x + u).collect()
                    }
                };
                points.extend(moved.iter().map(|x| x.as_vec3().to_array()));
                for (values, &quantity) in fields.iter_mut().zip(&quantities) {
                    let is_way = quantity.index().is_none() && quantity != Quantity::Pressure;
                    let of_points: Vec<f64> = match &part.wound {
                        Some(_) if is_way => {
                            moved.iter().zip(&carried.points).map(|(x, y)| x.distance(*y)).collect()
                        }
                        Some(wound) => {
                            let of_all = wound.skin.mean(|node| value(node as usize, quantity));
                            let own = wound.of_surface();
                            of_all.skip(own.start).take(own.len()).collect()
                        }
                        None => carried.embedding.mean(|v| value(v as usize, quantity)),
                    };
                    values.extend(of_points.into_iter().map(|x| x as f32));
                }
            }
            if let Some(wound) = &part.wound {
                let skin = &wound.skin;
                made.extend(skin.points[wound.fixed..].iter().map(|x| x.as_vec3().to_array()));
                for (values, &quantity) in values_made.iter_mut().zip(&quantities) {
                    let all: Vec<f64> = match quantity.index() {
                        None if quantity != Quantity::Pressure => skin
                            .points
                            .iter()
                            .zip(&skin.rest)
                            .map(|(x, y)| x.distance(*y))
                            .collect(),
                        _ => skin.mean(|node| value(node as usize, quantity)).collect(),
                    };
                    values.extend(all[wound.fixed..].iter().map(|x| *x as f32));
                }
            }
            let dark = self.recording.fields.first().is_none_or(|f| f.map != ColourMap::Viridis);
            fibres(part, body, &u, FIBRE[usize::from(dark)], &mut rods);
            displacements.push(u);
        }
        points.extend(made);
        fields.iter_mut().zip(values_made).for_each(|(all, made)| all.extend(made));
        let now = Now::new(built, step, displacements);
        self.balls(built, &now, &points, &mut balls);
        let mut forces = forces(built, &now, &mut self.recording.forces);
        let world = built.simulation.world_mut();
        let (tools, own) = self.tools.record(world, step > 0, time);
        forces.extend(own);
        self.forces.push(forces);
        let pushes = self.pushes(built, &now);
        self.pushes.push(pushes);
        let note = accuracy(built, step);
        let (skin, arrows) = (self.skin.clone(), Vec::new());
        let frame = Frame { step, time, points, skin, fields, balls, arrows, rods, tools, note };
        self.recording.frames.push(frame);
        self.seconds += start.elapsed().as_secs_f64();
    }

    /// Whether bodies may lose elements or be cut: nobody knows where the end is open.
    fn opens(&self, built: &BuiltScene) -> bool {
        let spare = built.simulation.topology().bodies.iter().any(|body| body.spare > 0);
        spare || !built.resections.is_empty() || self.options.every.is_some()
    }

    /// Records the state that is the last, unless it is recorded already.
    pub fn last(&mut self, built: &mut BuiltScene) {
        let done = built.simulation.world().resource::<StepClock>().step;
        if self.recording.frames.last().is_some_and(|frame| frame.step != done) {
            self.record(built, done);
        }
    }

    /// Measures a body from now on by the material that it has now.
    pub fn material_changed(&mut self, built: &mut BuiltScene, body: usize) {
        let own = self.parts.get_mut(body).and_then(|part| part.measured.as_mut());
        if let Some(own) = own {
            *own = measured(built.simulation.world_mut(), body, &built.bodies[body]);
        }
    }

    /// Leaves every second frame out where there are too many, and thins lines over time.
    fn thin(&mut self) {
        let long = self.recording.forces.iter_mut().filter(|series| series.points.len() >= LINE);
        long.for_each(|series| series.points = series.thinned(LINE / 2));
        if self.recording.frames.len() <= self.open.1 {
            return;
        }
        fn every_second<T>(list: &mut Vec<T>) {
            let mut at = 0..;
            list.retain(|_| at.next().is_some_and(|i: usize| i.is_multiple_of(2)));
        }
        every_second(&mut self.recording.frames);
        every_second(&mut self.forces);
        every_second(&mut self.pushes);
        for cell in &mut self.recording.cells {
            cell.born = cell.born.div_ceil(2);
            if cell.gone != u32::MAX {
                cell.gone = cell.gone.div_ceil(2);
            }
        }
        self.options.every = self.options.every.map(|every| 2 * every);
    }

    /// Held and moved vertices, and tools that cut.
    fn balls(&self, built: &mut BuiltScene, now: &Now, points: &[[f32; 3]], balls: &mut Vec<Ball>) {
        let BuiltScene { simulation, bodies, resections, .. } = built;
        let world = simulation.world_mut();
        for c in world.query::<&Constraint>().iter(world) {
            let (Some((of, _)), true) =
                (c.rows.first().and_then(|&row| now.place(row)), acts(c, now))
            else {
                continue;
            };
            let colour = if c.motion == Motion::Hold { HELD } else { MOVED };
            let (part, body) = (&self.parts[of], &bodies[of]);
            let own =
                c.rows.iter().filter_map(|&row| now.place(row)).map(|(_, v)| v.index() as u32);
            let carried = body.carried.as_ref().filter(|_| part.carries);
            let held: Vec<u32> = match carried {
                None => own.collect(),
                // points that hang on held vertices for the most part
                Some(carried) => {
                    let mut held = vec![0.0; body.mesh.points.len()];
                    own.for_each(|v| held[v as usize] = 1.0);
                    let share = carried.embedding.mean(|v| held[v as usize]);
                    let first = body.mesh.points.len() as u32;
                    (first..).zip(share).filter(|(_, share)| *share > 0.5).map(|x| x.0).collect()
                }
            };
            for v in held {
                let place = self.place[part.first + v as usize];
                if place != u32::MAX {
                    let centre = points[place as usize];
                    balls.push(Ball { centre, radius: self.radius, colour });
                }
            }
        }
        for (centre, radius) in resections.iter().filter_map(|own| own.ball(now.time)) {
            let centre = centre.as_vec3().to_array();
            balls.push(Ball { centre, radius: radius as f32, colour: CUTTER });
        }
    }

    /// Pressures on a few faces of each.
    fn pushes(&mut self, built: &mut BuiltScene, now: &Now) -> Vec<Push> {
        let BuiltScene { simulation, bodies, .. } = built;
        let world = simulation.world_mut();
        let mut pushes: Vec<Push> = Vec::new();
        for (entity, pressure) in world.query::<(Entity, &Pressure)>().iter(world) {
            let push = (pressure.pressure * pressure.curve.value(now.time)) as f32;
            let count = pressure.faces.len();
            let chosen = self.pushed.entry(entity).or_default();
            if chosen.0 != count {
                let middle = |face: &[VertexRow; 3]| {
                    let places = face.iter().filter_map(|&row| now.place(row));
                    let points = places.map(|(body, v)| bodies[body].mesh.points[v.index()]);
                    points.sum::<DVec3>() / 3.0
                };
                let middles: Vec<DVec3> = pressure.faces.iter().map(middle).collect();
                *chosen = (count, spread(&middles, PUSHES));
            }
            for &face in &chosen.1 {
                let [a, b, c] = pressure.faces[face].map(|row| {
                    // pressures act on vertices
                    let place = now.place(row);
                    place.map_or(Vec3::ZERO, |(body, v)| now.points[body][v.index()].as_vec3())
                });
                pushes.push(((a + b + c) / 3.0, push, (b - a).cross(c - a).normalize_or_zero()));
            }
        }
        pushes
    }
}

impl Observer for Recorder {
    fn built(&mut self, scene: &mut BuiltScene) {
        let start = Instant::now();
        self.prepare(scene);
        if self.open.0 > 0 && self.opens(scene) {
            // what has gone before it began
            self.change_cells(scene);
        }
        self.seconds += start.elapsed().as_secs_f64();
        self.record(scene, self.open.0);
    }

    fn step(&mut self, done: u64, _: f64, scene: &mut BuiltScene) {
        let start = Instant::now();
        // a blow may be over before the next frame
        let (time, world) = (scene.simulation.time(), scene.simulation.world_mut());
        self.tools.forces(world, time, &mut self.recording.forces);
        for (pull, report) in world.query::<(&Pull, &PullReport)>().iter(world) {
            append(&mut self.recording.forces, &pull.name, time, report.force.length());
        }
        self.seconds += start.elapsed().as_secs_f64();
        match self.options.every {
            Some(every) if done.saturating_sub(self.open.0).is_multiple_of(every) => {
                self.record(scene, done);
                self.thin();
            }
            None if self.wanted.binary_search(&done).is_ok() => self.record(scene, done),
            _ => {}
        }
    }

    fn row(&mut self, step: u64, time: f64, probes: &[f64]) {
        if step == 0 {
            self.before = probes.to_vec();
        }
        self.probed(time, probes);
    }
}

/// An empty graph of what a probe records.
fn graph((name, unit, endings): (String, &str, &[&str])) -> Graph {
    let line = |end: &&str| Series { name: end.trim_start_matches('_').into(), points: Vec::new() };
    let unit = if unit == "-" { String::new() } else { unit.into() };
    Graph { name, unit, lines: endings.iter().map(line).collect() }
}

/// Tetrahedra that fill the solid elements of a mesh, each with its element; those with middles and hexahedra in parts.
fn filling(mesh: &Mesh) -> Vec<([u32; 4], ElementKind, u32)> {
    // corners cut off, and the octahedron between them
    const TEN: [[usize; 4]; 8] = [
        [0, 4, 6, 7],
        [4, 1, 5, 8],
        [6, 5, 2, 9],
        [7, 8, 9, 3],
        [6, 8, 4, 5],
        [6, 8, 5, 9],
        [6, 8, 9, 7],
        [6, 8, 7, 4],
    ];
    // around a diagonal
    const EIGHT: [[usize; 4]; 6] =
        [[0, 6, 1, 2], [0, 6, 2, 3], [0, 6, 3, 7], [0, 6, 7, 4], [0, 6, 4, 5], [0, 6, 5, 1]];
    let mut cells = Vec::new();
    for (e, corners) in (0u32..).zip(&mesh.tetrahedra) {
        let kind = ElementKind::Tetrahedron;
        match mesh.second_order(e as usize) {
            Some(ten) => cells.extend(TEN.map(|cell| (cell.map(|v| ten[v]), kind, e))),
            None => cells.push((*corners, kind, e)),
        }
    }
    for (e, corners) in (0u32..).zip(&mesh.hexahedra) {
        cells.extend(EIGHT.map(|cell| (cell.map(|v| corners[v]), ElementKind::Hexahedron, e)));
    }
    cells
}

/// Whether a constraint acted on the step that has just ended.
fn acts(constraint: &Constraint, now: &Now) -> bool {
    (constraint.from..=constraint.until).contains(&now.time)
}

fn has_fibres(body: &BuiltBody) -> bool {
    body.axes.as_ref().is_some_and(|axes| !axes.families.is_empty())
}

/// What measures need of a body, with the material that it has now.
fn measured(world: &mut World, index: usize, body: &BuiltBody) -> MeasuredBody {
    let own = world.query::<&SoftBody>().iter(world).find(|own| own.index == index);
    MeasuredBody::new(body, own.map_or(body.material.into(), SoftBody::field))
}

/// Where everything is at a step.
struct Now {
    time: f64,
    step: u64,
    /// Of every body: its points, and the middle of those that elements use (m).
    points: Vec<Vec<DVec3>>,
    centres: Vec<DVec3>,
    rows: Vec<BodyRows>,
}

impl Now {
    fn new(built: &BuiltScene, step: u64, displacements: Vec<Vec<DVec3>>) -> Self {
        let moved = |(body, u): (&BuiltBody, Vec<DVec3>)| -> Vec<DVec3> {
            body.mesh.points.iter().zip(u).map(|(x, u)| *x + u).collect()
        };
        let points: Vec<_> = built.bodies.iter().zip(displacements).map(moved).collect();
        let middle = |(body, points): (&BuiltBody, &Vec<DVec3>)| {
            let used = &body.used_vertices;
            used.iter().map(|&v| points[v as usize]).sum::<DVec3>() / used.len().max(1) as f64
        };
        let centres = built.bodies.iter().zip(&points).map(middle).collect();
        let rows = built.simulation.topology().bodies.to_vec();
        Self { time: built.simulation.time(), step, points, centres, rows }
    }

    /// Body and vertex of a row.
    fn place(&self, row: VertexRow) -> Option<(usize, MeshVertex)> {
        let body = self.rows.iter().position(|body| body.local(row).is_some())?;
        Some((body, self.rows[body].vertex(row)))
    }
}

/// Reactions of what moves at its middle, loads, and pulls.
fn forces(built: &mut BuiltScene, now: &Now, series: &mut Vec<Series>) -> Vec<Force> {
    let simulation = &mut built.simulation;
    let mut forces = Vec::new();
    let world = simulation.world_mut();
    let mut all = world.query::<(Entity, &Constraint)>();
    let moving: Vec<(Entity, String, Vec<VertexRow>, bool)> = all
        .iter(world)
        .filter(|(_, c)| now.step > 0 && c.motion != Motion::Hold)
        .map(|(entity, c)| (entity, c.name.clone(), c.rows.clone(), acts(c, now)))
        .collect();
    if moving.iter().any(|(.., acts)| *acts) {
        let times = simulation.world().get_resource::<SystemTimes>().cloned();
        simulation.evaluate();
        if let Some(times) = times {
            simulation.world_mut().insert_resource(times);
        }
    }
    for (entity, name, rows, acts) in moving {
        let force = if acts { simulation.reaction(entity) } else { Some(DVec3::ZERO) };
        let (Some(force), Some((of, _))) = (force, rows.first().and_then(|&row| now.place(row)))
        else {
            continue;
        };
        let force = force.as_vec3();
        append(series, &name, now.time, f64::from(force.length()));
        let places = rows.iter().filter_map(|&row| now.place(row));
        let at: DVec3 = places.map(|(body, v)| now.points[body][v.index()]).sum();
        let at = (at / rows.len().max(1) as f64).as_vec3();
        forces.push(Force::new(at, force, now.centres[of].as_vec3(), MOVED));
    }
    let world = simulation.world_mut();
    for load in world.query::<&Load>().iter(world) {
        let (mut at, mut force, mut centre) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        for &(row, f) in &load.forces {
            let Some((body, v)) = now.place(row) else { continue };
            at += now.points[body][v.index()];
            force += f;
            centre = now.centres[body];
        }
        let at = at / load.forces.len().max(1) as f64;
        let force = force * load.curve.value(now.time);
        forces.push(Force::new(at.as_vec3(), force.as_vec3(), centre.as_vec3(), LOAD));
    }
    for (pull, report) in world.query::<(&Pull, &PullReport)>().iter(world) {
        let (mut at, mut weights) = (DVec3::ZERO, 0.0);
        for (&row, weight) in pull.rows.iter().zip(&pull.weights) {
            let Some((body, v)) = now.place(row) else { continue };
            at += *weight * now.points[body][v.index()];
            weights += weight;
        }
        let (at, force) = ((at / weights).as_vec3(), -report.force.as_vec3());
        forces.push(Force { at, force, ends: false, colour: MOVED });
    }
    forces
}

/// Indices of at most `count` points that are far from each other: the first, then each time the one furthest
/// from those before.
fn spread(points: &[DVec3], count: usize) -> Vec<usize> {
    let mut chosen = Vec::new();
    let mut distance = vec![f64::INFINITY; points.len()];
    let mut next = 0;
    while chosen.len() < count.min(points.len()) {
        chosen.push(next);
        let from = points[next];
        for (d, p) in distance.iter_mut().zip(points) {
            *d = d.min(p.distance_squared(from));
        }
        next = (0..points.len()).fold(0, |b, i| if distance[i] > distance[b] { i } else { b });
    }
    chosen
}

/// Indices among tetrahedra and then hexahedra.
fn solid_indices(body: &BuiltBody, tetrahedra: &[u32], hexahedra: &[u32]) -> Vec<u32> {
    let first = body.mesh.tetrahedra.len() as u32;
    tetrahedra.iter().copied().chain(hexahedra.iter().map(|&h| first + h)).collect()
}

/// A short rod along the deformed direction of every family in every element at the surface.
fn fibres(part: &BodyPart, body: &BuiltBody, u: &[DVec3], colour: Rgb, rods: &mut Vec<Rod>) {
    let (Some(axes), Some(measured)) = (&body.axes, &part.measured) else { return };
    for family in &axes.families {
        for face in part.faces.iter().filter(|f| !f.second) {
            let Some((kind, element)) = face.element else { continue };
            let quad = kind == ElementKind::Hexahedron;
            let element = element + if quad { body.mesh.tetrahedra.len() as u32 } else { 0 };
            let of = |list: &[DVec3]| list[if list.len() == 1 { 0 } else { element as usize }];
            let rest = of(&family.directions).normalize_or_zero();
            if family.share.as_ref().is_some_and(|share| share[element as usize] == 0.0) {
                continue;
            }
            let [a, b, c] = face.vertices.map(|v| body.mesh.points[v as usize] + u[v as usize]);
            let area = (b - a).cross(c - a);
            // the middle of a quadrilateral is that of its diagonal
            let middle = if quad { 0.5 * (a + c) } else { (a + b + c) / 3.0 };
            let size = area.length().sqrt() * if quad { 1.0 } else { 0.8 };
            let along = measured.deformation(element as usize, u) * rest * (0.36 * size);
            // where they leave the surface, as at cut faces, they would stick out
            if along.dot(area).abs() > 0.5 * along.length() * area.length() {
                continue;
            }
            let lift = area.normalize_or_zero() * (0.02 * size);
            let ends =
                [middle + lift - along, middle + lift + along].map(|p| p.as_vec3().to_array());
            rods.push(Rod { ends, colour });
        }
    }
}

/// First and second line of the caption.
fn titles(name: &str, built: &BuiltScene) -> (String, String) {
    let mut title = name.replace('_', " ");
    if let Some(first) = title.get(..1) {
        title = first.to_uppercase() + &title[1..];
    }
    let mut models = Vec::new();
    for body in &built.bodies {
        let model = match &body.membrane {
            Some(membrane) if !body.mesh.is_solid() => membrane.settings.model.name(),
            _ => body.model.name(),
        };
        if !models.contains(&model) {
            models.push(model);
        }
    }
    let elements = built.element_count();
    let settings = &built.plan.settings;
    let step = match built.plan.mode {
        Mode::Dynamic => format!(", {:.3} ms", 1e3 * built.plan.dt),
        Mode::Static => String::new(),
    };
    let step = if step.contains('.') {
        let (number, unit) = step.split_at(step.len() - 3);
        format!("{}{unit}", number.trim_end_matches('0').trim_end_matches('.'))
    } else {
        step
    };
    let integrator = settings.integrator.resolve().name();
    let subtitle = format!("{} · {integrator}{step} · {elements} elements", models.join(", "));
    (title, subtitle)
}

/// How exactly a step was solved, in words.
fn accuracy(built: &BuiltScene, step: u64) -> String {
    let report = built.simulation.report();
    if step == 0 {
        return "at rest".into();
    }
    let mut parts = Vec::new();
    // of one linearised step it would be the step itself
    if report.newton_iterations > 1 {
        parts.push(format!("last correction {:.0e} of the size", report.newton_step));
    }
    if report.substeps > 0 {
        parts.push(format!("{} substeps", report.substeps));
    }
    parts.join(" · ").replace("e-", "e−")
}

/// Forces named in a caption: more are in the page.
const NAMED: usize = 3;

/// What the caption says about a frame: the forces that act now, then how exactly the step was solved.
fn note(forces: &[Series], frame: &Frame) -> String {
    let now = forces.iter().take(NAMED).map(|series| {
        let name = series.name.replace('_', " ");
        format!("{name} {}", with_unit(series.at(frame.time), "N"))
    });
    let accuracy = Some(frame.note.clone()).filter(|words| !words.is_empty());
    now.chain(accuracy).collect::<Vec<_>>().join(" · ")
}

/// Ranges of the colour bars from what is seen in all frames; single peaks, as at clamped corners, are cut off.
pub(crate) fn set_ranges(recording: &mut Recording) {
    let (size, inside) = (recording.size(), !recording.cells.is_empty());
    for (i, field) in recording.fields.iter_mut().enumerate() {
        let mut values: Vec<f32> = recording
            .frames
            .iter()
            .flat_map(|frame| {
                // where bodies can be cut open, all points are seen
                let surface: &[u32] = if inside { &[] } else { &frame.skin.points };
                let all: &[f32] = if inside { &frame.fields[i] } else { &[] };
                surface.iter().map(move |&v| frame.fields[i][v as usize]).chain(all.iter().copied())
            })
            .filter(|x| x.is_finite())
            .map(|x| if field.map == ColourMap::Diverging { (x - 1.0).abs() } else { x.abs() })
            .collect();
        if field.lies_under_tools() {
            // most of a surface is not touched
            values.retain(|x| *x > 0.0);
        }
        let share = match &*field.name {
            "displacement" => 1.0,
            // blows are short
            "pressure" => 0.99,
            _ => 0.998,
        };
        let at = ((values.len() as f64 * share) as usize).min(values.len().saturating_sub(1));
        if !values.is_empty() {
            values.select_nth_unstable_by(at, f32::total_cmp);
        }
        let mut largest = values.get(at).copied().filter(|x| *x > 0.0).unwrap_or(1.0);
        if recording.falling && field.unit == "m" {
            // what falls goes further than anything else, and out of the picture
            largest = largest.min(0.35 * size);
        }
        field.range = match field.map {
            ColourMap::Diverging => {
                let reach = largest.min(1.0);
                [1.0 - reach, 1.0 + reach]
            }
            _ => [0.0, largest],
        };
    }
}
