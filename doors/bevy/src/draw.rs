//! What is drawn of bodies: meshes written in place, interpolation between steps, and lines.

use crate::body::affine;
use crate::carried;
use crate::{BodySystems, SinewBodyIndex, SinewBodyState, SinewSurface};
use bevy_app::{App, PostUpdate};
use bevy_asset::{AssetApp, AssetEventSystems, Assets, RenderAssetUsages};
use bevy_ecs::intern::Interned;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;
use bevy_math::{DVec3, Vec3, Vec3A};
use bevy_mesh::{Indices, Mesh, Mesh3d, PrimitiveTopology, VertexAttributeValues};
use bevy_shape::Aabb3d;
use bevy_time::{Fixed, Time};
use bevy_transform::TransformSystems;
use bevy_transform::components::GlobalTransform;
use sinew::engine::columns::single_table;
use sinew::engine::element::TetrahedronVertices;
use sinew::engine::topology::{BodyRows, Topology};
use sinew::engine::vertex::{BodyId, Position};
use sinew::prelude::{Constraint, StepClock};
use sinew::touch::set::ContactSet;

/// Writes the surface of a body into a `Mesh`, once a drawn frame, in place. Without a `Mesh3d` the body gets one.
///
/// Vertex `i` of the mesh is vertex `i` of the user's mesh, whatever is cut away, so that attributes of your own
/// such as texture coordinates stay right; points that cuts made follow. Without `smooth_normals` every triangle has three vertices of its own.
/// Membranes are drawn from one side: switch culling off in their material.
#[derive(Component, Clone, Copy, Debug)]
pub struct SinewMeshSync {
    /// Normals are means over triangles, weighted by area (default). Without, triangles are flat.
    pub smooth_normals: bool,
    /// Colour (linear red, green, blue, alpha) of what cuts laid open, as the attribute `COLOR`, by which materials multiply their
    /// own; the outside is white. A mesh gets it when its body is cut. Without, that attribute is yours.
    pub wound: Option<[f32; 4]>,
}

/// Colour of wounds.
pub(crate) const WOUND: [f32; 4] = [0.4, 0.03, 0.03, 1.0];

impl Default for SinewMeshSync {
    fn default() -> Self {
        Self { smooth_normals: true, wound: Some(WOUND) }
    }
}

/// Draws a body between the last two steps, by how far Bevy's clock is past the last one: smooth where frames and steps
/// differ, and late by up to one step. For steps in a fixed schedule.
#[derive(Component, Clone, Debug, Default)]
pub struct SinewInterpolation {
    /// Positions (m) of its rows before the last step, those of vertices that cuts made last.
    before: Vec<DVec3>,
}

/// What is kept of a body's mesh from frame to frame.
#[derive(Component, Default)]
pub struct Drawn {
    revision: u64,
    smooth: bool,
    fraction: f64,
    /// Vertex of the user's mesh, by vertex of the mesh; empty where they are the same.
    source: Vec<u32>,
    /// Positions by vertices of the user's mesh, in the frame of the body.
    positions: Vec<[f32; 3]>,
    normals: Vec<Vec3>,
}

/// Lines to draw, refilled every frame for bodies with [`SinewGizmos`].
#[derive(Resource, Clone, Debug, Default)]
pub struct SinewGizmoLines(pub Vec<GizmoLine>);

/// A line in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GizmoLine {
    /// Start (m).
    pub from: Vec3,
    /// End (m).
    pub to: Vec3,
    /// What it shows.
    pub kind: GizmoKind,
}

/// What a line shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GizmoKind {
    /// Arm of the cross at a held vertex.
    Held,
    /// Force of tools, other bodies and pulls on a vertex.
    Force,
    /// Edge of an element that is turned inside out.
    Inverted,
}

/// Shows held vertices, forces and inverted tetrahedra of a body in [`SinewGizmoLines`].
#[derive(Component, Clone, Copy, Debug)]
pub struct SinewGizmos {
    /// Length (m) of a line for a force of 1 N.
    pub per_newton: f64,
}

impl Default for SinewGizmos {
    fn default() -> Self {
        Self { per_newton: 0.05 }
    }
}

/// Where meshes and lines are written, in `PostUpdate`: after transforms are propagated, before changes of assets are
/// told.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub struct MeshSystems;

pub(crate) fn build(app: &mut App) {
    if !app.world().contains_resource::<Assets<Mesh>>() {
        app.init_asset::<Mesh>();
    }
    app.init_resource::<SinewGizmoLines>();
    let in_order = MeshSystems.after(TransformSystems::Propagate).before(AssetEventSystems);
    app.configure_sets(PostUpdate, in_order);
    let systems = (begin_meshes, sync_meshes, carried::begin, carried::sync, collect_lines).chain();
    app.add_systems(PostUpdate, systems.in_set(MeshSystems));
    carried::build(app);
}

pub(crate) fn build_steps(app: &mut App, schedule: Interned<dyn ScheduleLabel>) {
    app.add_systems(schedule, keep_positions.in_set(BodySystems::Input));
}

/// Positions before the step.
fn keep_positions(
    topology: Res<Topology>,
    positions: Query<&Position>,
    mut bodies: Query<(&SinewBodyIndex, &mut SinewInterpolation)>,
) {
    let Some(positions) = single_table(positions.contiguous_iter()) else { return };
    for (index, mut interpolation) in &mut bodies {
        let rows = topology.bodies[index.0].vertices.clone();
        let before = &mut interpolation.bypass_change_detection().before;
        before.clear();
        before.extend(positions[rows.start as usize..rows.end as usize].iter().map(|p| p.0));
    }
}

type Undrawn = (With<SinewMeshSync>, With<SinewBodyIndex>, Without<Drawn>);

fn begin_meshes(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    bodies: Query<(Entity, Has<Mesh3d>), Undrawn>,
) {
    for (entity, has_mesh) in &bodies {
        let mut entity = commands.entity(entity);
        entity.try_insert(Drawn::default());
        if !has_mesh {
            // data for the renderer alone could not be written again
            let both = RenderAssetUsages::default();
            entity.try_insert(Mesh3d(meshes.add(Mesh::new(PrimitiveTopology::TriangleList, both))));
        }
    }
}

/// A body to be drawn.
type Body<'a> = (
    &'a SinewBodyIndex,
    Ref<'a, SinewBodyState>,
    Ref<'a, SinewSurface>,
    &'a SinewMeshSync,
    &'a mut Drawn,
    Ref<'a, Mesh3d>,
    Ref<'a, GlobalTransform>,
    Option<&'a SinewInterpolation>,
);

/// Writes meshes: positions, normals and bounds of bodies that moved, indices of those that were cut. Allocates
/// only when a mesh is new or was cut.
pub fn sync_meshes(
    topology: Res<Topology>,
    fixed: Option<Res<Time<Fixed>>>,
    positions: Query<&Position>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut bodies: Query<Body>,
) {
    let Some(positions) = single_table(positions.contiguous_iter()) else { return };
    for (index, state, surface, sync, mut drawn, mesh, transform, interpolation) in &mut bodies {
        let drawn = drawn.bypass_change_detection();
        let body = &topology.bodies[index.0];
        let (before, fraction) = between(interpolation, fixed.as_deref());
        let is_new = drawn.revision != surface.revision
            || drawn.positions.len() != body.mesh_vertices() + surface.made.len()
            || drawn.smooth != sync.smooth_normals
            || mesh.is_changed();
        let moved = state.is_changed() || transform.is_changed() || drawn.fraction != fraction;
        if !(is_new || moved) {
            continue;
        }
        let rows = body.vertices.start as usize..body.vertices.end as usize;
        let bounds =
            drawn.place((body, &surface), &positions[rows], (before, fraction), &transform);
        let Some(mut mesh) = meshes.get_mut(&mesh.0) else { continue };
        if is_new {
            drawn.renew(&mut mesh, &surface, sync);
        }
        drawn.find_normals(&surface.triangles);
        drawn.write(&mut mesh);
        mesh.final_aabb = Some(bounds);
    }
}

/// Positions (m) before the last step, none without interpolation, and how far a body is drawn from there to where it is.
pub(crate) fn between<'a>(
    interpolation: Option<&'a SinewInterpolation>,
    fixed: Option<&Time<Fixed>>,
) -> (&'a [DVec3], f64) {
    let before = interpolation.map_or(&[][..], |i| &i.before[..]);
    let fraction = fixed.map_or(1.0, |fixed| fixed.overstep_fraction_f64().min(1.0));
    (before, if before.is_empty() { 1.0 } else { fraction })
}

/// Where (m) a row of a body is drawn.
pub(crate) fn drawn_at(
    local: usize,
    positions: &[Position],
    (before, fraction): (&[DVec3], f64),
) -> DVec3 {
    let now = positions[local].0;
    before.get(local).map_or(now, |before| before.lerp(now, fraction))
}

impl Drawn {
    /// Positions in the frame of the body, and their bounds.
    fn place(
        &mut self,
        (body, surface): (&BodyRows, &SinewSurface),
        positions: &[Position],
        (before, fraction): (&[DVec3], f64),
        transform: &GlobalTransform,
    ) -> Aabb3d {
        let to_frame = affine(transform).inverse();
        self.fraction = fraction;
        self.positions.resize(body.mesh_vertices() + surface.made.len(), [0.0; 3]);
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let at = |local: usize| drawn_at(local, positions, (before, fraction));
        let mut place = |index: usize, there: DVec3| {
            let there = to_frame.transform_point3(there);
            (min, max) = (min.min(there), max.max(there));
            self.positions[index] = there.as_vec3().to_array();
        };
        for (local, vertex) in body.vertex_order.iter().enumerate() {
            place(vertex.index(), at(local));
        }
        for point in 0..surface.made.len() {
            place(body.mesh_vertices() + point, surface.place(point, at));
        }
        Aabb3d { min: Vec3A::from(min.as_vec3()), max: Vec3A::from(max.as_vec3()) }
    }

    /// Attributes of the right length, and indices.
    fn renew(&mut self, mesh: &mut Mesh, surface: &SinewSurface, sync: &SinewMeshSync) {
        let smooth = sync.smooth_normals;
        (self.revision, self.smooth) = (surface.revision, smooth);
        let corners = surface.triangles.iter().flatten().copied();
        self.source.clear();
        let count = if smooth {
            mesh.insert_indices(Indices::U32(corners.collect()));
            self.positions.len()
        } else {
            self.source.extend(corners);
            mesh.remove_indices();
            self.source.len()
        };
        self.normals.clear();
        self.normals.resize(count, Vec3::ZERO);
        for attribute in [Mesh::ATTRIBUTE_POSITION, Mesh::ATTRIBUTE_NORMAL] {
            let right = matches!(
                mesh.attribute(attribute),
                Some(VertexAttributeValues::Float32x3(values)) if values.len() == count
            );
            if !right {
                mesh.insert_attribute(attribute, vec![[0.0_f32; 3]; count]);
            }
        }
        let Some(colour) = sync.wound.filter(|_| surface.wound.contains(&true)) else { return };
        let mut colours = vec![[1.0_f32; 4]; count];
        let wound = surface.triangles.iter().enumerate().filter(|(t, _)| surface.wound[*t]);
        for (t, triangle) in wound {
            for (k, &v) in triangle.iter().enumerate() {
                colours[if smooth { v as usize } else { 3 * t + k }] = colour;
            }
        }
        mesh.insert_attribute(Mesh::ATTRIBUTE_COLOR, colours);
    }

    fn find_normals(&mut self, triangles: &[[u32; 3]]) {
        self.normals.fill(Vec3::ZERO);
        for (t, triangle) in triangles.iter().enumerate() {
            let [a, b, c] = triangle.map(|v| Vec3::from(self.positions[v as usize]));
            let normal = (b - a).cross(c - a);
            for (k, &v) in triangle.iter().enumerate() {
                let at = if self.source.is_empty() { v as usize } else { 3 * t + k };
                self.normals[at] += normal;
            }
        }
    }

    fn write(&self, mesh: &mut Mesh) {
        if let Some(VertexAttributeValues::Float32x3(to)) =
            mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION)
        {
            if self.source.is_empty() {
                to.copy_from_slice(&self.positions);
            } else {
                let from = self.source.iter().map(|&v| self.positions[v as usize]);
                to.iter_mut().zip(from).for_each(|(to, from)| *to = from);
            }
        }
        if let Some(VertexAttributeValues::Float32x3(to)) =
            mesh.attribute_mut(Mesh::ATTRIBUTE_NORMAL)
        {
            for (to, normal) in to.iter_mut().zip(&self.normals) {
                *to = normal.normalize_or(Vec3::Z).to_array();
            }
        }
    }
}

/// What lines are made from.
#[derive(bevy_ecs::system::SystemParam)]
struct Sources<'w, 's> {
    topology: Res<'w, Topology>,
    clock: Res<'w, StepClock>,
    contact: Option<Res<'w, ContactSet>>,
    positions: Query<'w, 's, &'static Position>,
    constraints: Query<'w, 's, &'static Constraint>,
    tetrahedra: Query<'w, 's, (&'static TetrahedronVertices, &'static BodyId)>,
}

fn collect_lines(
    from: Sources,
    bodies: Query<(&SinewBodyIndex, &SinewBodyState, &SinewGizmos)>,
    mut lines: ResMut<SinewGizmoLines>,
) {
    if bodies.is_empty() && lines.0.is_empty() {
        return;
    }
    lines.0.clear();
    let Some(positions) = single_table(from.positions.contiguous_iter()) else { return };
    let at = |row: u32| positions[row as usize].0;
    let line = |from: DVec3, to: DVec3, kind| {
        let (from, to) = (from.as_vec3(), to.as_vec3());
        GizmoLine { from, to, kind }
    };
    for (index, state, gizmos) in &bodies {
        let body = &from.topology.bodies[index.0];
        let arm = 0.01 * body.size;
        for constraint in from.constraints.iter().filter(|c| c.active(from.clock.time)) {
            for row in constraint.rows.iter().filter(|row| body.local(**row).is_some()) {
                for axis in DVec3::AXES {
                    let (a, b) = (at(row.0) - arm * axis, at(row.0) + arm * axis);
                    lines.0.push(line(a, b, GizmoKind::Held));
                }
            }
        }
        let forces = from.contact.as_ref().map_or(&[][..], |contact| contact.forces());
        for (row, force) in forces.iter().filter(|(row, _)| body.local(*row).is_some()) {
            let from = at(row.0);
            lines.0.push(line(from, from + gizmos.per_newton * *force, GizmoKind::Force));
        }
        if state.inverted > 0 {
            for (nodes, _) in from.tetrahedra.iter().filter(|(_, id)| id.0 as usize == index.0) {
                let [a, b, c, d] = nodes.0.map(at);
                if (b - a).cross(c - a).dot(d - a) < 0.0 {
                    for (p, q) in [(a, b), (a, c), (a, d), (b, c), (b, d), (c, d)] {
                        lines.0.push(line(p, q, GizmoKind::Inverted));
                    }
                }
            }
        }
    }
}
