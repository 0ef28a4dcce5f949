//! Fine meshes that bodies carry along, such as those of an artist.

mod through_cuts;

use crate::body::{RestFrame, affine};
use crate::draw::{WOUND, between, drawn_at};
use crate::input::label;
use crate::{
    InputError, InputFailed, SinewBody, SinewBodyIndex, SinewBodyState, SinewInputError,
    SinewInterpolation, SinewSurface, SoftMesh,
};
use bevy_app::App;
use bevy_asset::{AssetId, Assets, Handle, RenderAssetUsages};
use bevy_ecs::prelude::*;
use bevy_math::{DAffine3, DVec3, Quat, Vec3, Vec3A};
use bevy_mesh::{Indices, Mesh, Mesh3d, PrimitiveTopology, VertexAttributeValues};
use bevy_shape::Aabb3d;
use bevy_time::{Fixed, Time};
use bevy_transform::components::{GlobalTransform, Transform};
use sinew::engine::columns::single_table;
use sinew::engine::connectivity::{Connectivity, ElementKind};
use sinew::engine::mesh::EmbeddedPoints;
use sinew::engine::topology::{BodyRows, Topology};
use sinew::engine::vertex::{Position, RestPosition};
use sinew::models::body::present::Resection;
use std::collections::{HashMap, HashSet};

/// Lets a body carry the `Mesh3d` of this entity along, which is a child of it or further below: a surface that is finer than its tissue,
/// with normals, tangents and textures of its own.
///
/// Where the `Transform`s between have it in the frame of the body when it is taken hold of, there it lies in the body at rest. Each of
/// its vertices then moves as the solid element round it does, or the nearest one. Normals and tangents turn with the
/// triangles round them and are the artist's own at rest. The entity gets a copy of the mesh, as others may draw it
/// too; another `Mesh3d` is taken hold of anew. Triangles at elements that were removed are no longer drawn.
///
/// In a body that can be cut ([`SinewBody::spare`]) it is cut as well, and is drawn from the first step on: triangles are divided along wounds,
/// attributes of `f32` are known at their new vertices, and wounds are part of the mesh. Such a body is of tetrahedra or hexahedra, carries
/// one mesh, and needs no [`SinewMeshSync`](crate::SinewMeshSync), which would draw the same surface.
///
/// What cannot be carried gets [`SinewInputError`], and [`InputFailed`] is sent.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[require(Transform)]
pub struct SinewCarriedMesh {
    /// Colour (linear red, green, blue, alpha) of what cuts laid open, as the attribute `COLOR`, which is white elsewhere where the mesh has
    /// none. Without, that attribute is yours.
    pub wound: Option<[f32; 4]>,
}

impl Default for SinewCarriedMesh {
    fn default() -> Self {
        Self { wound: Some(WOUND) }
    }
}

/// How a mesh is carried.
#[derive(Component)]
pub(crate) struct Carried {
    mesh: AssetId<Mesh>,
    body: Entity,
    by: By,
    shape: Shape,
    /// Where its vertices are drawn in the frame of the entity.
    positions: Vec<[f32; 3]>,
    /// What it was drawn for: changes of the body, and the part of a step.
    drawn: Option<(u64, f64)>,
}

/// What moves the vertices of a mesh.
enum By {
    /// Elements; where the vertices rest (m).
    Elements { embedding: EmbeddedPoints, rest: Vec<DVec3> },
    /// The surface of a body that can be cut.
    Surface(Box<through_cuts::Cut>),
}

/// A mesh as it was loaded.
struct Shape {
    normals: Vec<[f32; 3]>,
    tangents: Vec<[f32; 4]>,
    triangles: Vec<[u32; 3]>,
    /// Group of every vertex: those at one place with one normal turn alike, such as on both sides of a seam.
    group: Vec<u32>,
    /// Areas of the triangles round every group, at rest and now.
    at_rest: Vec<Vec3>,
    now: Vec<Vec3>,
}

/// Part of the size of a body that a mesh may lie away from it.
const FAR: f64 = 0.1;

pub(crate) fn build(app: &mut App) {
    app.add_observer(|gone: On<Remove<SinewCarriedMesh>>, mut commands: Commands| {
        if let Ok(mut entity) = commands.get_entity(gone.entity) {
            entity.try_remove::<(Carried, SinewInputError)>();
        }
    });
    app.add_observer(|gone: On<Remove<Carried>>, all: Query<&Carried>, mut commands: Commands| {
        if let Ok(Carried { body, by: By::Surface(_), .. }) = all.get(gone.entity) {
            let body = *body;
            commands.queue(move |world: &mut World| through_cuts::let_go(world, body));
        }
    });
}

type Untried = (Without<Carried>, Without<SinewInputError>);
type New = (
    With<SinewCarriedMesh>,
    Or<(Changed<SinewCarriedMesh>, Changed<Mesh3d>, Changed<ChildOf>, Untried)>,
);
type Waiting<'a> = (Entity, Option<&'a Mesh3d>, Option<&'a Carried>, Option<&'a Name>);

/// What taking hold of a mesh asks for.
#[derive(bevy_ecs::system::SystemParam)]
pub(crate) struct Hierarchy<'w, 's> {
    soft: Res<'w, Assets<SoftMesh>>,
    parents: Query<'w, 's, &'static ChildOf>,
    transforms: Query<'w, 's, &'static Transform>,
    bodies: Query<'w, 's, (&'static SinewBody, Option<&'static RestFrame>)>,
}

/// Takes hold of meshes that are new, as soon as they are loaded and their bodies built.
pub(crate) fn begin(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    hierarchy: Hierarchy,
    waiting: Query<Waiting, New>,
    mut failed: MessageWriter<InputFailed>,
) {
    for (entity, mesh, carried, name) in &waiting {
        if carried.is_some_and(|own| mesh.is_some_and(|mesh| mesh.id() == own.mesh)) {
            continue;
        }
        let name = label("carried mesh", entity, name);
        match hierarchy.carry(&name, entity, mesh, &meshes) {
            // tried again in the next frame
            Ok(None) => _ = commands.entity(entity).try_remove::<(Carried, SinewInputError)>(),
            Ok(Some((mut made, copy))) => {
                let copy = meshes.add(copy);
                made.mesh = copy.id();
                commands
                    .queue(move |world: &mut World| take_hold(world, name, entity, (made, copy)));
            }
            Err(error) => {
                log::error!("{error}");
                let own = SinewInputError(error.clone());
                commands.entity(entity).try_remove::<Carried>().try_insert(own);
                failed.write(InputFailed { entity, error });
            }
        }
    }
}

/// Lets a body carry a mesh, in the world: what cuts divide is a surface of the engine's.
fn take_hold(
    world: &mut World,
    name: String,
    entity: Entity,
    (made, copy): (Carried, Handle<Mesh>),
) {
    if world.get::<SinewCarriedMesh>(entity).is_none() {
        return;
    }
    // another body may have carried it
    world.entity_mut(entity).remove::<Carried>();
    let result = match &made.by {
        By::Surface(cut) => cut.hang(world, made.body),
        By::Elements { .. } => Ok(()),
    };
    let Ok(mut own) = world.get_entity_mut(entity) else { return };
    match result {
        Ok(()) => _ = own.remove::<SinewInputError>().insert((made, Mesh3d(copy))),
        Err(problem) => {
            let error = InputError::Invalid { name, problem };
            log::error!("{error}");
            own.insert(SinewInputError(error.clone()));
            world.write_message(InputFailed { entity, error });
        }
    }
}

impl Hierarchy<'_, '_> {
    /// How a body carries a mesh, and a copy of that; `None` while one of them is not there yet.
    fn carry(
        &self,
        name: &str,
        entity: Entity,
        mesh: Option<&Mesh3d>,
        meshes: &Assets<Mesh>,
    ) -> Result<Option<(Carried, Mesh)>, InputError> {
        let invalid = |problem: String| InputError::Invalid { name: name.into(), problem };
        // from the frame of the mesh to that of the body
        let own = |entity| self.transforms.get(entity).copied().unwrap_or_default();
        let (mut to_body, mut body) = (GlobalTransform::from(own(entity)), entity);
        let (of, frame) = loop {
            let parent = self.parents.get(body).map_err(|_| InputError::NoBody(name.into()))?;
            body = parent.parent();
            if let Ok(found) = self.bodies.get(body) {
                break found;
            }
            to_body = own(body) * to_body;
        };
        let mesh = mesh.ok_or_else(|| invalid("its entity has no `Mesh3d`: give it one".into()))?;
        let (Some(frame), Some(soft)) = (frame, self.soft.get(&of.mesh)) else { return Ok(None) };
        let Some(mesh) = meshes.get(&mesh.0) else { return Ok(None) };
        let to_body = affine(&to_body);
        if !(to_body.is_finite() && to_body.matrix3.determinant() != 0.0) {
            return Err(invalid(format!("its `Transform` {to_body:?} flattens it")));
        }
        let (shape, positions) = Shape::of(mesh, |_| [0; 10]).map_err(invalid)?;
        let can_be_cut = of.spare > 0;
        if can_be_cut && to_body.matrix3.determinant() < 0.0 {
            let problem = "its `Transform` mirrors it, and its body can be cut (`spare`): mirror the mesh itself";
            return Err(invalid(problem.into()));
        }
        if can_be_cut && mesh.attributes().any(|(_, values)| values.len() != positions.len()) {
            return Err(invalid("its attributes are not of one length".into()));
        }
        for (attribute, values) in mesh.attributes().filter(|_| can_be_cut) {
            if !through_cuts::is_divided(values) {
                let own = attribute.name;
                log::warn!(
                    "`{name}`: attribute {own} is not of `f32`, so it is left out once its body is cut"
                );
            }
        }
        let wide = |p: &[f32; 3]| to_body.transform_point3(Vec3::from(*p).as_dvec3());
        let points: Vec<DVec3> = positions.iter().map(wide).collect();
        let tissue = soft.mesh();
        let embedding = EmbeddedPoints::new(tissue, &points).ok_or_else(|| {
            invalid("its body has no solid elements, so nothing that could carry it".into())
        })?;
        let (low, high) = tissue.bounds().unwrap_or_default();
        if embedding.farthest > FAR * (high - low).length() {
            let far = embedding.farthest;
            let problem = format!(
                "a point of it lies {far} from its body, in units of the body's mesh: bring both into one frame and \
                 one unit by its `Transform`"
            );
            return Err(invalid(problem));
        }
        let (mesh, mut copy) = (AssetId::default(), mesh.clone());
        // found by area where it has none
        copy.insert_attribute(Mesh::ATTRIBUTE_NORMAL, shape.normals.clone());
        // it is written again and again
        copy.asset_usage |= RenderAssetUsages::MAIN_WORLD;
        let by = if can_be_cut {
            By::Surface(Box::new(through_cuts::Cut::new(&copy, frame.0 * to_body)))
        } else {
            let rest = points.iter().map(|&p| frame.0.transform_point3(p)).collect();
            By::Elements { embedding, rest }
        };
        Ok(Some((Carried { mesh, body, by, shape, positions, drawn: None }, copy)))
    }
}

/// A body that carries meshes.
type Body<'a> =
    (&'a SinewBodyIndex, Ref<'a, SinewBodyState>, &'a SinewSurface, Option<&'a SinewInterpolation>);

/// Writes meshes that bodies carry, where these moved.
pub(crate) fn sync(
    topology: Res<Topology>,
    resection: Option<Res<Resection>>,
    fixed: Option<Res<Time<Fixed>>>,
    rows: Query<(&Position, &RestPosition)>,
    mut meshes: ResMut<Assets<Mesh>>,
    bodies: Query<Body>,
    mut carried: Query<(&mut Carried, &SinewCarriedMesh, Ref<GlobalTransform>)>,
) {
    let Some((positions, rest)) = single_table(rows.contiguous_iter()) else { return };
    for (mut own, style, transform) in &mut carried {
        let own = own.bypass_change_detection();
        let Ok((index, state, surface, interpolation)) = bodies.get(own.body) else { continue };
        let body = &topology.bodies[index.0];
        let (before, fraction) = between(interpolation, fixed.as_deref());
        let now = Some((body.changes, fraction));
        let is_new = match &own.by {
            By::Elements { .. } => false,
            By::Surface(cut) if !cut.knows(surface) => continue,
            By::Surface(cut) => !cut.is_of(surface, style),
        };
        if !(state.is_changed() || transform.is_changed() || own.drawn != now || is_new) {
            continue;
        }
        let Some(mut mesh) = meshes.get_mut(own.mesh) else { continue };
        let cut = own.drawn.is_none_or(|(changes, _)| changes != body.changes);
        own.drawn = now;
        let table = body.vertices.start as usize..body.vertices.end as usize;
        let (positions, rest) = (&positions[table.clone()], &rest[table]);
        let at = |local: usize| drawn_at(local, positions, (before, fraction));
        let to_frame = affine(&transform).inverse();
        let bounds = match &mut own.by {
            By::Elements { embedding, rest: own_rest } => {
                let mut way = vec![DVec3::ZERO; body.mesh_vertices()];
                for (local, vertex) in body.vertex_order.iter().enumerate() {
                    way[vertex.index()] = at(local) - rest[local].0;
                }
                let moved = own_rest.iter().zip(embedding.displacements(&way));
                let bounds =
                    place(&mut own.positions, moved.map(|(rest, way)| *rest + way), to_frame);
                if cut {
                    let left = resection.as_deref().and_then(|own| own.connectivity(index.0));
                    own.shape.leave_out(embedding, body, left, &mut mesh);
                }
                bounds
            }
            By::Surface(cut) => {
                if is_new && let Some((whole, shape)) = cut.follow(body, surface, style) {
                    (*mesh, own.shape) = (whole, shape);
                }
                own.positions.resize(cut.made.len(), [0.0; 3]);
                let places = (0..cut.made.len()).map(|point| cut.place(point, at));
                place(&mut own.positions, places, to_frame)
            }
        };
        mesh.final_aabb = Some(bounds);
        own.shape.write(&own.positions, &mut mesh);
    }
}

/// Brings vertices to places (m) in the frame of the entity; their bounds.
fn place(
    positions: &mut [[f32; 3]],
    places: impl Iterator<Item = DVec3>,
    to_frame: DAffine3,
) -> Aabb3d {
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (to, place) in positions.iter_mut().zip(places) {
        let there = to_frame.transform_point3(place).as_vec3();
        (min, max) = (min.min(there), max.max(there));
        *to = there.to_array();
    }
    Aabb3d { min: Vec3A::from(min), max: Vec3A::from(max) }
}

impl Shape {
    /// Of a mesh, with its positions; or what of it cannot be carried. `side` tells vertices at one place apart that do not move alike.
    fn of(mesh: &Mesh, side: impl Fn(usize) -> [u32; 10]) -> Result<(Self, Vec<[f32; 3]>), String> {
        if mesh.primitive_topology() != PrimitiveTopology::TriangleList {
            return Err(format!(
                "its mesh is a {:?}: triangles are carried, as a `TriangleList`",
                mesh.primitive_topology()
            ));
        }
        // what is in the render world alone has neither
        let attribute = |which| mesh.try_attribute_option(which).map_err(|error| error.to_string());
        let Some(VertexAttributeValues::Float32x3(positions)) =
            attribute(Mesh::ATTRIBUTE_POSITION)?
        else {
            return Err("its mesh has no positions of three `f32`".into());
        };
        let indices = mesh.try_indices_option().map_err(|error| error.to_string())?;
        let corners: Vec<u32> = match indices {
            Some(indices) => indices.iter().map(|i| i as u32).collect(),
            None => (0..positions.len() as u32).collect(),
        };
        let (triangles, []) = corners.as_chunks::<3>() else {
            return Err(format!("its mesh has {} corners, not three a triangle", corners.len()));
        };
        if let Some(v) = corners.iter().find(|v| **v as usize >= positions.len()) {
            return Err(format!("its mesh has {} vertices, and no vertex {v}", positions.len()));
        }
        if let Some(v) = positions.iter().position(|p| !Vec3::from(*p).is_finite()) {
            return Err(format!("vertex {v} of its mesh is not finite"));
        }
        let normals = match attribute(Mesh::ATTRIBUTE_NORMAL)? {
            Some(VertexAttributeValues::Float32x3(normals)) => normals.clone(),
            _ => Vec::new(),
        };
        let tangents = match attribute(Mesh::ATTRIBUTE_TANGENT)? {
            Some(VertexAttributeValues::Float32x4(tangents)) => tangents.clone(),
            _ => Vec::new(),
        };
        let mut groups = HashMap::new();
        let group = (0..positions.len()).map(|v| {
            let bits = |x: &[f32; 3]| x.map(f32::to_bits);
            let next = groups.len() as u32;
            *groups.entry((bits(&positions[v]), normals.get(v).map(bits), side(v))).or_insert(next)
        });
        let group = group.collect();
        let at_rest = vec![Vec3::ZERO; groups.len()];
        let mut shape = Self {
            normals,
            tangents,
            triangles: triangles.to_vec(),
            group,
            now: at_rest.clone(),
            at_rest,
        };
        shape.find_areas(positions);
        shape.at_rest.clone_from(&shape.now);
        shape.normals.resize(positions.len(), [0.0; 3]);
        for (normal, group) in shape.normals.iter_mut().zip(&shape.group) {
            if *normal == [0.0; 3] {
                *normal = shape.at_rest[*group as usize].normalize_or(Vec3::Z).to_array();
            }
        }
        Ok((shape, positions.clone()))
    }

    /// Leaves out triangles at elements that are gone; all are there where none is, as after a way back.
    fn leave_out(
        &self,
        embedding: &EmbeddedPoints,
        body: &BodyRows,
        left: Option<&Connectivity>,
        mesh: &mut Mesh,
    ) {
        let kinds: HashSet<ElementKind> = embedding.cells().map(|(kind, _)| kind).collect();
        let mut gone = HashSet::new();
        for kind in kinds {
            let all = (0..).zip(&body.order[kind]);
            let own = all.filter(|(e, _)| left.is_some_and(|left| !left.is_present(kind, *e)));
            gone.extend(own.map(|(_, &index)| (kind, index)));
        }
        let is_gone: Vec<bool> = embedding.cells().map(|cell| gone.contains(&cell)).collect();
        let is_left = |t: &&[u32; 3]| t.iter().all(|&v| !is_gone[v as usize]);
        let triangles = self.triangles.iter().filter(is_left);
        mesh.insert_indices(Indices::U32(triangles.flatten().copied().collect()));
    }

    fn find_areas(&mut self, positions: &[[f32; 3]]) {
        self.now.fill(Vec3::ZERO);
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|v| Vec3::from(positions[v as usize]));
            let area = (b - a).cross(c - a);
            triangle.iter().for_each(|&v| self.now[self.group[v as usize] as usize] += area);
        }
    }

    /// Positions, and what turns with the triangles.
    fn write(&mut self, positions: &[[f32; 3]], mesh: &mut Mesh) {
        self.find_areas(positions);
        let turn = |group: &u32| {
            let [from, to] = [&self.at_rest, &self.now].map(|own| own[*group as usize]);
            match (from.try_normalize(), to.try_normalize()) {
                (Some(from), Some(to)) => Quat::from_rotation_arc(from, to),
                _ => Quat::IDENTITY,
            }
        };
        let turns: Vec<Quat> = self.group.iter().map(turn).collect();
        if let Some(VertexAttributeValues::Float32x3(to)) =
            mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION)
        {
            to.iter_mut().zip(positions).for_each(|(to, from)| *to = *from);
        }
        if let Some(VertexAttributeValues::Float32x3(to)) =
            mesh.attribute_mut(Mesh::ATTRIBUTE_NORMAL)
        {
            for (to, (turn, &own)) in to.iter_mut().zip(turns.iter().zip(&self.normals)) {
                *to = (*turn * Vec3::from(own)).to_array();
            }
        }
        if let Some(VertexAttributeValues::Float32x4(to)) =
            mesh.attribute_mut(Mesh::ATTRIBUTE_TANGENT)
        {
            for (to, (turn, &[x, y, z, w])) in to.iter_mut().zip(turns.iter().zip(&self.tangents)) {
                let [x, y, z] = (*turn * Vec3::new(x, y, z)).to_array();
                *to = [x, y, z, w];
            }
        }
    }
}
