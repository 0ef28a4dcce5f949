//! Bodies: built from components, their state, and messages about them.

use crate::asset::SoftMesh;
use crate::{BodySystems, StepOutcome};
use bevy_app::App;
use bevy_asset::{AssetEvent, AssetServer, Assets, Handle, LoadState};
use bevy_ecs::intern::Interned;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;
use bevy_math::{DAffine3, DVec3, Vec3};
use bevy_transform::components::{GlobalTransform, Transform};
use sinew::engine::by_precision;
use sinew::engine::columns::single_table;
use sinew::engine::law::{ElasticEnergy, RecoveringBodies};
use sinew::engine::precision::Precision;
use sinew::engine::report::VolumeReport;
use sinew::engine::row::{LocalRow, MeshVertex};
use sinew::engine::scalar::Scalar;
use sinew::engine::surface::SurfaceReader;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::{Mass, Velocity};
use sinew::models::body::change::set_material;
use sinew::models::body::sheet::MembraneSettings;
use sinew::models::body::{BodyError, Evaluation, Integration, MassRule, VolumeRule};
use sinew::models::cutting::{MaterialSkin, carries_surface, is_cut, update_skin};
use sinew::models::material::field::FieldError;
use sinew::models::resection::{
    Region, Removal, RemovalError, RemovalLog, RemovalReport, RemovalRequest,
};
use sinew::prelude::{BodyDescription, BodyHandle, Model, StepClock, YoungPoisson};
use sinew::solvers::explicit::forget_steps;
use sinew::solvers::implicit::forget_matrices;
use sinew::touch::set::ContactSet;
use sinew::warning::spawn_checked_body;
use std::ops::Range;
use std::sync::Arc;

/// A soft body. It is built before the next step after its mesh was loaded; [`SinewBodyIndex`] and
/// [`SinewBodyState`] then come to its entity, or [`SinewBodyError`].
///
/// The `Transform` it has then, with those of its parents, takes the mesh to where the body rests, scale included. A
/// later `Transform` moves neither tissue nor picture, as tissue is no rigid body: the mesh is written in
/// the frame that the entity has. A changed material or model acts from the next step on; a changed
/// `mesh` does nothing.
///
/// A `Name` is the name of the body in errors; where it is taken, the entity is added to it.
#[derive(Component, Clone, Debug)]
#[require(Transform)]
pub struct SinewBody {
    /// Mesh with solid elements, or of faces alone if it has a `membrane`.
    pub mesh: Handle<SoftMesh>,
    /// Material.
    pub material: YoungPoisson,
    /// Energy; it cannot be changed later.
    pub model: Model,
    /// Evaluation; it cannot be changed later.
    pub evaluation: Evaluation,
    /// What keeps its volume; it cannot be changed later.
    pub volume: VolumeRule,
    /// How its hexahedra are integrated; it cannot be changed later.
    pub integration: Integration,
    /// How its mass is shared out; it cannot be changed later.
    pub masses: MassRule,
    /// Vertices kept for what [`cut_body`](sinew::models::cutting::cut_body) makes; without, it cannot be cut.
    pub spare: usize,
    /// Stiffness of what holds its wounds closed ahead of a blade ([glue](sinew::models::cutting::glue)); it cannot be changed later.
    pub glue: f64,
    /// Makes all triangles and quadrilaterals of the mesh a membrane; it cannot be changed later.
    pub membrane: Option<MembraneSettings>,
}

impl SinewBody {
    /// A body with the default model and evaluation.
    pub fn new(mesh: Handle<SoftMesh>, material: YoungPoisson) -> Self {
        Self {
            mesh,
            material,
            model: Model::default(),
            evaluation: Evaluation::default(),
            volume: VolumeRule::default(),
            integration: Integration::default(),
            masses: MassRule::default(),
            spare: 0,
            glue: 0.0,
            membrane: None,
        }
    }
}

/// Index of a body that was built into [`Topology::bodies`], as [`RemovalRequest::new`] takes it, and as a [`BodyHandle`]
/// [`BodyContact::new`](sinew::prelude::BodyContact::new).
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub struct SinewBodyIndex(pub usize);

impl From<SinewBodyIndex> for BodyHandle {
    fn from(index: SinewBodyIndex) -> Self {
        Self(index.0)
    }
}

/// A body after the last step. It changes when a step was made, and only then.
#[derive(Component, Clone, Debug, Default, PartialEq)]
pub struct SinewBodyState {
    /// Steps of the world done.
    pub step: u64,
    /// Simulated time (s).
    pub time: f64,
    /// Elastic energy (J), as the integrator found it last in the step.
    pub elastic_energy: f64,
    /// Kinetic energy (J).
    pub kinetic_energy: f64,
    /// Smallest volume ratio J of its solid elements; infinite without.
    pub smallest_ratio: f64,
    /// Elements turned inside out.
    pub inverted: u64,
    /// It moves by the energy that brings crushed elements back into shape.
    pub recovering: bool,
    /// Sum of the forces (N) of tools, other bodies and pulls on it.
    pub contact_force: DVec3,
}

/// Material that a body has.
#[derive(Component)]
struct Applied(YoungPoisson);

/// What took the mesh of a body to where it rests.
#[derive(Component, Clone, Copy)]
pub(crate) struct RestFrame(pub DAffine3);

/// The surface of what is left of a body, by vertices of the user's mesh, then points that cuts made.
#[derive(Component, Clone, Debug, Default)]
pub struct SinewSurface {
    /// Outside triangles of the solid, outward, then triangles of membranes.
    pub triangles: Vec<[u32; 3]>,
    /// Whether each was laid open by a cut; empty while nothing was cut and no mesh that cuts divide is carried.
    pub wound: Vec<bool>,
    /// Depth (m, at rest) of points of wounds below the surface of the mesh, 0 of all others; empty where `wound` is.
    pub depth: Vec<f64>,
    /// Rows of the body, relative to its first, and weights by which each point that is no vertex moves: first those of a mesh that is
    /// [carried](crate::SinewCarriedMesh) through cuts, then those that cuts made.
    pub made: Vec<([u32; 4], [f64; 4])>,
    /// The fifth and further rows of each, with their weights, where elements are ten-node tetrahedra or hexahedra; none elsewhere.
    pub further: Vec<([u32; 6], [f64; 6])>,
    /// Counts up when the triangles change; there may be more points then.
    pub revision: u64,
    /// Where a surface is carried, by points: places (m) at rest, and what of that surface each lies between.
    pub(crate) rest: Vec<DVec3>,
    pub(crate) carried: Vec<([u32; 3], [f64; 3])>,
    /// Faces of the mesh outside, where others are drawn in their place: what rays meet.
    pub(crate) tissue: Vec<[u32; 3]>,
    /// [`BodyRows::changes`](sinew::engine::topology::BodyRows::changes) that it was read at.
    changes: u64,
}

impl SinewSurface {
    /// Where a point of `made` is (m), from where rows of the body are (m).
    pub fn place(&self, point: usize, at: impl Fn(usize) -> DVec3) -> DVec3 {
        mean((&self.made, &self.further), point, at)
    }

    /// Lets it be read anew, after the next step; what is carried is not known until then.
    pub(crate) fn forget(&mut self) {
        self.changes = u64::MAX;
        self.carried.clear();
    }
}

/// A body that was not built. Correct [`SinewBody`], its `Transform` or its asset, and it is tried again; after a
/// change of the `Transform` alone, remove this component.
#[derive(Component, Clone, Debug)]
pub struct SinewBodyError(pub BuildError);

/// Why a body was not built or not changed.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// Its mesh was not loaded.
    #[error("body `{body}`: {problem}")]
    Asset {
        /// Body.
        body: String,
        /// What the loader said.
        problem: String,
    },
    /// Its `Transform` flattens or mirrors it, or is not finite.
    #[error(
        "body `{body}`: its `Transform` {transform:?} scales its volume by {scale}: a body needs a positive, finite \
         scale along every axis"
    )]
    Transform {
        /// Body.
        body: String,
        /// The transform, parents included.
        transform: GlobalTransform,
        /// Its determinant.
        scale: f64,
    },
    /// The engine refuses it.
    #[error(transparent)]
    Body(#[from] BodyError),
    /// The engine refuses its new material.
    #[error("new material of body `{body}`: {source}")]
    Material {
        /// Body.
        body: String,
        /// What is wrong.
        source: FieldError,
    },
}

/// A body was built.
#[derive(Message, Clone, Copy, Debug, PartialEq, Eq)]
pub struct BodyBuilt {
    /// Its entity.
    pub entity: Entity,
    /// Its index.
    pub index: usize,
}

/// A body was not built, or not changed; see [`SinewBodyError`].
#[derive(Message, Clone, Debug)]
pub struct BodyFailed {
    /// Its entity.
    pub entity: Entity,
    /// Why.
    pub error: BuildError,
}

/// The entity of a body was despawned, or its [`SinewBody`] taken away. All its elements are removed before the next
/// step. Its vertices stay in the world, at rest and without mass, contact or picture.
#[derive(Message, Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "body `{name}`, entity {entity}, was despawned: its elements are removed, but its {vertices} vertices stay in the \
     tables until the world goes"
)]
pub struct BodyDespawned {
    /// Entity that it had.
    pub entity: Entity,
    /// Index that it has.
    pub index: usize,
    /// Its name, which stays taken.
    pub name: String,
    /// Its vertices.
    pub vertices: usize,
}

/// Elements of a body were removed.
#[derive(Message, Clone, Debug)]
pub struct Resected {
    /// Body.
    pub entity: Entity,
    /// What was removed.
    pub report: RemovalReport,
}

/// A removal was refused; nothing was changed.
#[derive(Message, Clone, Debug)]
pub struct ResectionFailed {
    /// Body.
    pub entity: Entity,
    /// Why.
    pub error: RemovalError,
}

/// So many elements of a body are inside out that it began to recover.
#[derive(Message, Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecoveryBegan {
    /// Body.
    pub entity: Entity,
}

/// A body ended its recovery; [`SinewBodyState::inverted`] says in what shape.
#[derive(Message, Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// Body.
    pub entity: Entity,
}

/// Entities of the bodies that were built here.
#[derive(Resource, Default)]
struct Built(Vec<(Entity, usize)>);

impl Built {
    fn entity(&self, index: usize) -> Option<Entity> {
        self.0.iter().find(|(_, i)| *i == index).map(|(entity, _)| *entity)
    }
}

pub(crate) fn build(app: &mut App, schedule: Interned<dyn ScheduleLabel>) {
    app.init_resource::<Built>();
    app.add_message::<BodyBuilt>().add_message::<BodyFailed>().add_message::<BodyDespawned>();
    app.add_message::<Resected>().add_message::<ResectionFailed>();
    app.add_message::<RecoveryBegan>().add_message::<Recovered>();
    app.add_systems(
        schedule,
        (
            (forget_errors, build_bodies, change_bodies, clear_despawned)
                .chain()
                .in_set(BodySystems::Build),
            (read_state, read_surfaces).chain().in_set(BodySystems::State),
        ),
    );
}

/// Bodies that failed are tried again when they or their assets changed.
pub(crate) fn forget_errors(
    mut commands: Commands,
    mut assets: MessageReader<AssetEvent<SoftMesh>>,
    failed: Query<(Entity, Ref<SinewBody>, &SinewBodyError)>,
) {
    let (mut added, mut modified) = (Vec::new(), Vec::new());
    for event in assets.read() {
        match event {
            AssetEvent::Added { id } => added.push(*id),
            AssetEvent::Modified { id } => modified.push(*id),
            _ => {}
        }
    }
    for (entity, body, error) in &failed {
        let mesh = body.mesh.id();
        let was_missing = matches!(error.0, BuildError::Asset { .. });
        let arrived = modified.contains(&mesh) || was_missing && added.contains(&mesh);
        if body.is_changed() || arrived {
            commands.entity(entity).remove::<SinewBodyError>();
        }
    }
}

type Waiting = (Without<SinewBodyIndex>, Without<SinewBodyError>);

/// Builds bodies whose meshes are there.
fn build_bodies(world: &mut World, waiting: &mut QueryState<(Entity, &SinewBody), Waiting>) {
    let mut waiting: Vec<_> =
        waiting.iter(world).map(|(entity, body)| (entity, body.clone())).collect();
    // a query goes through archetypes in an order that other components may change
    waiting.sort_unstable_by_key(|(entity, _)| entity.index_u32());
    for (entity, body) in waiting {
        let name = name(world, entity);
        let result = match find_mesh(world, &name, &body.mesh) {
            Ok(None) => continue,
            Ok(Some(mesh)) => build_body(world, entity, name, &body, &mesh),
            Err(error) => Err(error),
        };
        match result {
            Ok((index, frame)) => {
                let surface = surface(world, index);
                let state = SinewBodyState::default();
                let own = (SinewBodyIndex(index), state, surface, RestFrame(frame));
                world.entity_mut(entity).insert((own, Applied(body.material)));
                world.resource_mut::<Built>().0.push((entity, index));
                world.write_message(BodyBuilt { entity, index });
            }
            Err(error) => fail(world, entity, error),
        }
    }
}

fn fail(world: &mut World, entity: Entity, error: BuildError) {
    log::error!("{error}");
    world.entity_mut(entity).insert(SinewBodyError(error.clone()));
    world.write_message(BodyFailed { entity, error });
}

/// Name of a body to be built, unique in its world.
fn name(world: &World, entity: Entity) -> String {
    let taken = |name: &str| world.resource::<Topology>().body(name).is_some();
    match world.get::<Name>(entity) {
        Some(name) if !taken(name.as_str()) => name.to_string(),
        Some(name) => format!("{name} {entity}"),
        None => format!("body {entity}"),
    }
}

fn find_mesh(
    world: &World,
    body: &str,
    handle: &Handle<SoftMesh>,
) -> Result<Option<Arc<sinew::prelude::Mesh>>, BuildError> {
    if let Some(mesh) = world.resource::<Assets<SoftMesh>>().get(handle) {
        return Ok(Some(mesh.shared()));
    }
    match world.resource::<AssetServer>().get_load_state(handle) {
        Some(LoadState::Failed(error)) => {
            Err(BuildError::Asset { body: body.into(), problem: error.to_string() })
        }
        _ => Ok(None),
    }
}

fn build_body(
    world: &mut World,
    entity: Entity,
    name: String,
    body: &SinewBody,
    mesh: &sinew::prelude::Mesh,
) -> Result<(usize, DAffine3), BuildError> {
    let transform = global_transform(world, entity);
    let frame = affine(&transform);
    let scale = frame.matrix3.determinant();
    if !(scale > 0.0 && scale.is_finite() && frame.translation.is_finite()) {
        return Err(BuildError::Transform { body: name, transform, scale });
    }
    let moved: Vec<DVec3>;
    let points = if frame == DAffine3::IDENTITY {
        &mesh.points
    } else {
        moved = mesh.points.iter().map(|&point| frame.transform_point3(point)).collect();
        &moved
    };
    let description = BodyDescription {
        points,
        model: body.model,
        evaluation: body.evaluation,
        volume: body.volume,
        integration: body.integration,
        masses: body.masses,
        spare: body.spare,
        glue: body.glue,
        membrane: body.membrane.as_ref().map(|m| m.of(&mesh.triangles, &mesh.quads)),
        ..BodyDescription::new(&name, mesh, body.material)
    };
    spawn_checked_body(world, &description)?;
    Ok((world.resource::<Topology>().bodies.len() - 1, frame))
}

/// Where an entity is by the `Transform`s of itself and its parents, up to date at any time.
fn global_transform(world: &World, entity: Entity) -> GlobalTransform {
    let own = |entity| world.get::<Transform>(entity).copied().unwrap_or_default();
    let (mut global, mut at) = (GlobalTransform::from(own(entity)), entity);
    while let Some(parent) = world.get::<ChildOf>(at) {
        at = parent.parent();
        global = own(at) * global;
    }
    global
}

/// A transform in double precision.
pub(crate) fn affine(transform: &GlobalTransform) -> DAffine3 {
    let affine = transform.affine();
    let wide = |v: bevy_math::Vec3A| Vec3::from(v).as_dvec3();
    let columns = affine.matrix3;
    DAffine3::from_cols(
        wide(columns.x_axis),
        wide(columns.y_axis),
        wide(columns.z_axis),
        wide(affine.translation),
    )
}

fn surface(world: &mut World, index: usize) -> SinewSurface {
    let Some(read) = world.get_resource::<SurfaceReader>().copied() else {
        return SinewSurface::default();
    };
    let found = (read.0)(world, index);
    let body = &world.resource::<Topology>().bodies[index];
    let user = |triangle: &[u32; 3]| triangle.map(|v| body.vertex_of(LocalRow(v)).0);
    let of_vertices = |t: &&[u32; 3]| t.iter().all(|v| (*v as usize) < body.row_count());
    let triangles = found.triangles.iter().chain(&found.sheets).filter(of_vertices).map(user);
    let triangles: Vec<[u32; 3]> = triangles.collect();
    let changes = body.changes;
    let mut skin = MaterialSkin::default();
    let precision = *world.resource::<Precision>();
    if !(is_cut(world, index) || carries_surface(world, index))
        || by_precision!(precision, update_skin(world, index, &mut skin)).is_err()
    {
        return SinewSurface { triangles, revision: 1, changes, ..SinewSurface::default() };
    }
    let body = &world.resource::<Topology>().bodies[index];
    let row = |node: u32| match (node as usize).checked_sub(body.mesh_vertices()) {
        Some(ghost) => (body.vertex_order.len() + ghost) as u32,
        None => body.row_of_vertex[MeshVertex(node)].map_or(0, |row| row.0),
    };
    let rows = skin.nodes.iter().map(|nodes| nodes.map(row));
    let made = rows.zip(skin.weights).skip(body.mesh_vertices()).collect();
    let more = skin.further.iter().map(|(nodes, weights)| (nodes.map(row), *weights));
    let further = more.skip(body.mesh_vertices()).collect();
    // a ghost stands for a vertex on the other side of a wound
    let whole = |t: &&[u32; 3]| t.iter().all(|v| (*v as usize) < body.vertex_order.len());
    let faces = found.triangles[found.wounds..].iter().chain(&found.sheets).filter(whole);
    let user = |triangle: &[u32; 3]| triangle.map(|v| body.vertex_of(LocalRow(v)).0);
    let tissue = faces.filter(|_| !skin.carried.is_empty()).map(user).collect();
    let MaterialSkin { triangles, wound, depth, rest, carried, .. } = skin;
    let known = SinewSurface { revision: 1, changes, ..SinewSurface::default() };
    SinewSurface { triangles, wound, depth, made, further, rest, carried, tissue, ..known }
}

/// Mean of what there is at the rows by which one of some points moves.
pub(crate) fn mean(
    (made, further): (&[([u32; 4], [f64; 4])], &[([u32; 6], [f64; 6])]),
    point: usize,
    at: impl Fn(usize) -> DVec3,
) -> DVec3 {
    let (rows, weights) = &made[point];
    let first = rows.iter().zip(weights).map(|(&row, w)| *w * at(row as usize)).sum::<DVec3>();
    further.get(point).map_or(first, |(rows, weights)| {
        let used = rows.iter().zip(weights).filter(|(_, w)| **w != 0.0);
        used.map(|(&row, w)| *w * at(row as usize)).fold(first, |sum, own| sum + own)
    })
}

/// Changed materials.
fn change_bodies(
    world: &mut World,
    bodies: &mut QueryState<(Entity, Ref<SinewBody>, &SinewBodyIndex, &Applied)>,
) {
    let mut changed = Vec::new();
    for (entity, body, index, applied) in bodies.iter(world) {
        if body.is_changed() && body.material != applied.0 {
            changed.push((entity, index.0, body.material));
        }
    }
    for (entity, index, material) in changed {
        let precision = *world.resource::<Precision>();
        match by_precision!(precision, change_material(world, index, material)) {
            Ok(()) => {
                world.entity_mut(entity).insert(Applied(material));
            }
            Err(source) => {
                let body = world.resource::<Topology>().bodies[index].name.clone();
                let error = BuildError::Material { body, source };
                log::error!("{error}");
                world.write_message(BodyFailed { entity, error });
            }
        }
    }
}

fn change_material<S: Scalar>(
    world: &mut World,
    index: usize,
    material: YoungPoisson,
) -> Result<(), FieldError> {
    set_material::<S>(world, index, &material.into())?;
    forget_steps::<S>(world);
    forget_matrices::<S>(world);
    Ok(())
}

/// Empties bodies whose entities went.
fn clear_despawned(world: &mut World) {
    let is_gone = |world: &World, entity| world.get::<SinewBody>(entity).is_none();
    let built = &world.resource::<Built>().0;
    let Some(&(entity, index)) = built.iter().find(|(entity, _)| is_gone(world, *entity)) else {
        return;
    };
    world.resource_mut::<Built>().0.retain(|(e, _)| *e != entity);
    let body = &world.resource::<Topology>().bodies[index];
    let (name, vertices) = (body.name.clone(), body.vertex_order.len());
    let gone = BodyDespawned { entity, index, name, vertices };
    log::warn!("{gone}");
    world.write_message(gone);
    world.spawn(RemovalRequest::new(index, Removal::new(Region::Everything)));
    clear_despawned(world);
}

/// Number of the step that was seen last, and which bodies recovered then.
type Seen = (u64, Vec<bool>);

/// What a step did to bodies, and what is told of it.
fn read_state(
    world: &mut World,
    bodies: &mut QueryState<(Entity, &SinewBodyIndex)>,
    mut seen: Local<Seen>,
) {
    let failed = world.get_resource::<StepOutcome>().is_some_and(|outcome| outcome.0.is_some());
    let step = world.get_resource::<StepClock>().map_or(0, |clock| clock.step);
    if failed || step == seen.0 {
        return;
    }
    seen.0 = step;
    let bodies: Vec<_> = bodies.iter(world).map(|(entity, index)| (entity, index.0)).collect();
    for (entity, index) in bodies {
        let state = state(world, index);
        if seen.1.len() <= index {
            seen.1.resize(index + 1, false);
        }
        match (std::mem::replace(&mut seen.1[index], state.recovering), state.recovering) {
            (false, true) => {
                world.write_message(RecoveryBegan { entity });
            }
            (true, false) => {
                world.write_message(Recovered { entity });
            }
            _ => {}
        }
        if let Some(mut own) = world.get_mut::<SinewBodyState>(entity) {
            *own = state;
        }
    }
    tell_removals(world);
}

fn state(world: &mut World, index: usize) -> SinewBodyState {
    let rows = world.resource::<Topology>().bodies[index].vertices.clone();
    let precision = *world.resource::<Precision>();
    let kinetic_energy = by_precision!(precision, kinetic_energy(world, rows.clone()));
    let (clock, volumes) = (world.resource::<StepClock>(), world.resource::<VolumeReport>());
    let contact = world.get_resource::<ContactSet>().map_or(&[][..], ContactSet::forces);
    let on_it = contact.iter().filter(|(row, _)| rows.contains(&row.0));
    let smallest_ratio = volumes.smallest_by_body.get(index).copied().unwrap_or(f64::INFINITY);
    SinewBodyState {
        step: clock.step,
        time: clock.time,
        elastic_energy: world
            .resource::<ElasticEnergy>()
            .by_body
            .get(index)
            .copied()
            .unwrap_or(0.0),
        kinetic_energy,
        smallest_ratio,
        inverted: volumes.inverted_by_body.get(index).copied().unwrap_or(0),
        recovering: world.resource::<RecoveringBodies>().contains(index),
        contact_force: on_it.map(|(_, force)| *force).sum(),
    }
}

fn kinetic_energy<S: Scalar>(world: &mut World, rows: Range<u32>) -> f64 {
    let mut query = world.query::<(&Mass<S>, &Velocity<S>)>();
    let Some((m, v)) = single_table(query.contiguous_iter(world)) else { return 0.0 };
    let rows = rows.start as usize..rows.end as usize;
    let own = m[rows.clone()].iter().zip(&v[rows]);
    own.map(|(m, v)| 0.5 * m.0.to_f64() * v.get().length_squared()).sum()
}

fn tell_removals(world: &mut World) {
    let Some(log) = world.get_resource::<RemovalLog>().filter(|log| !log.0.is_empty()) else {
        return;
    };
    for (index, result) in log.0.clone() {
        let Some(entity) = world.resource::<Built>().entity(index) else { continue };
        match result {
            Ok(report) => {
                world.write_message(Resected { entity, report });
            }
            Err(error) => {
                log::error!("{error}");
                world.write_message(ResectionFailed { entity, error });
            }
        }
    }
}

/// Surfaces of bodies that lost elements.
fn read_surfaces(
    world: &mut World,
    bodies: &mut QueryState<(Entity, &SinewBodyIndex, &SinewSurface)>,
) {
    bodies.update_archetypes(world);
    let Some(topology) = world.get_resource::<Topology>() else { return };
    let is_old = |(_, index, surface): &(Entity, &SinewBodyIndex, &SinewSurface)| {
        topology.bodies[index.0].changes != surface.changes
    };
    let old: Vec<_> = bodies.iter_manual(world).filter(is_old).map(|(e, i, _)| (e, i.0)).collect();
    for (entity, index) in old {
        let new = surface(world, index);
        let Some(mut own) = world.get_mut::<SinewSurface>(entity) else { continue };
        let is_new =
            own.triangles != new.triangles || own.made != new.made || own.carried != new.carried;
        let is_new = is_new || own.further != new.further;
        let revision = own.revision + u64::from(is_new);
        *own = SinewSurface { revision, ..new };
    }
}
