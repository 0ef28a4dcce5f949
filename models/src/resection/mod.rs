//! Resection: elements are removed while the scene runs.
//!
//! A removed tetrahedron or hexahedron keeps its table row for the time being, with moduli, volume and shape
//! vectors 0: every law then gives exact zeros for it, and `J = 1`. A removed membrane element gets
//! moduli 0 and is drawn together into one vertex, which leaves its area ratio at 1. Pooled constants of
//! the edges and triangles round them are summed again over the elements that are left, never
//! subtracted, so they do not drift. A batch costs in proportion to the elements it touches, but for
//! choosing elements by a region or by their state, which looks at every one. Once more than a quarter of
//! a body's rows of either kind are dead, tables and edge graph are compacted in place, in their order.
//!
//! Vertices keep their rows, so constraints and loads stay valid. One that has lost its last element
//! flies freely if it has mass left, and stays where it is if not ([`MassPolicy`]).
//!
//! A follower pressure goes on acting on a face for as long as an element of either kind has it; faces
//! that none has any more leave their [`Pressure`] for good. The surface that a cut lays open carries no
//! pressure until it is given one.
//!
//! Removing elements is an action from outside: their elastic energy (and the kinetic energy of the
//! removed mass) leaves the scene, see [`RemovalReport`].
//!
//! [`remove_elements`] acts at once. In a schedule, spawn a [`RemovalRequest`]: it is carried out in
//! [`StepSystems::Edit`], with the others of the same body and [`MassPolicy`] that were made in a row as one
//! batch, and [`RemovalLog`] tells what came of it.

use bevy_ecs::prelude::*;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use sinew_engine::columns::single_table;
use sinew_engine::compiled_here;
use sinew_engine::connectivity::{ByKind, Connectivity, ElementKind, Touched};
use sinew_engine::element::{
    AxisTetrahedron, EdgeVertices, MembraneBlocks, MembraneIndex, MembraneVertices, RestVolume,
    ShapeGradient, ShapeGradients, TetrahedronIndex, displacement_gradient, volume_change,
};
use sinew_engine::isoparametric::{
    AxisHexahedron, HEXAHEDRON_PAIRS, HexahedronIndex, HexahedronRest, QUAD_PAIRS, QuadBlocks,
    QuadIndex, QuadVertices, RestHexahedron, RestQuad,
};
use sinew_engine::layout::UNUSED;
use sinew_engine::load::Pressure;
use sinew_engine::scalar::{Scalar, sub};
use sinew_engine::schedule::{StepSchedule, StepSystems};
use sinew_engine::topology::{ElementTables, Topology};
use sinew_engine::vertex::{BodyId, Displacement, Mass, RestPosition, Velocity};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::axes;
use crate::body::lumped;
use crate::body::sheet::{MembraneModel, MembraneSettings};
use crate::body::{Evaluation, SoftBody, angular_place};
use crate::element::membrane::{self, RestTriangle};
use crate::element::precompute::{ADJACENT_PAIRS, EDGES, RestTetrahedron, SpringConstants};
use crate::element::tetrahedron::{Element, green_strain, second_piola_kirchhoff};
use crate::frame::hexahedra;
use crate::frame::quads;
use crate::frame::tetrahedra::{CompressionModulus, FirstLameParameter, ShearModulus};
use crate::frame::triangles::{
    MembraneCompressionModulus, MembraneFirstModulus, MembraneShearModulus,
};
use crate::laws::LawRow;
use crate::laws::pooled::{
    AngularStiffness, TensileStiffness, TriangleVertices, VolumetricStiffness,
};
use crate::laws::pressure;
use crate::laws::quadratic::MassSpring;
use crate::material::LameParameters;

mod compact;
mod verify;

pub use verify::{FreshDifference, compare_with_fresh};

/// Which elements of a body to remove: all but the lists take elements of every kind alike.
/// Positions are those at the present state.
#[derive(Clone, Debug, PartialEq)]
pub enum Region {
    /// Tetrahedra by their indices in the user's mesh.
    Tetrahedra(Vec<u32>),
    /// Membrane triangles by their indices in the user's list.
    Triangles(Vec<u32>),
    /// Hexahedra by their indices in the user's mesh.
    Hexahedra(Vec<u32>),
    /// Membrane quadrilaterals by their indices in the user's list.
    Quads(Vec<u32>),
    /// Those whose barycentre lies within a sphere.
    Sphere {
        /// Centre (m).
        centre: DVec3,
        /// Radius (m).
        radius: f64,
    },
    /// Those whose barycentre lies within a sphere that is swept along a segment, such as a tool from
    /// its last position to the present one. The volume removed is then that swept, on average; a tool
    /// thinner than the elements misses some.
    Capsule {
        /// Start of the segment (m).
        from: DVec3,
        /// End of the segment (m).
        to: DVec3,
        /// Radius (m).
        radius: f64,
    },
    /// Those whose largest principal Green strain is above a limit, at some Gauss point if there are
    /// several.
    Strain {
        /// The limit (-).
        above: f64,
    },
    /// Those whose von Mises equivalent of the Cauchy stress is above a limit. The stress is that of
    /// St Venant-Kirchhoff with the moduli of the element (of plane stress in a membrane, over its
    /// deformed thickness at constant volume), whatever the model; compression terms play no part.
    Stress {
        /// The limit (Pa).
        above: f64,
    },
}

/// What becomes of the mass of the vertices of removed elements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MassPolicy {
    /// Their masses are summed again over the elements that are left: removed matter is gone
    /// (default). A vertex without element has no mass then and stays where it is.
    #[default]
    Recompute,
    /// Vertices keep their masses; one without element flies freely.
    Keep,
}

/// What to remove.
#[derive(Clone, Debug, PartialEq)]
pub struct Removal {
    /// Which elements.
    pub region: Region,
    /// What becomes of their mass.
    pub mass: MassPolicy,
}

impl Removal {
    /// Removes a region, mass included.
    pub fn new(region: Region) -> Self {
        Self { region, mass: MassPolicy::default() }
    }
}

/// What a removal did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RemovalReport {
    /// Tetrahedra removed, by their indices in the user's mesh, ascending.
    pub tetrahedra: Vec<u32>,
    /// Membrane triangles removed, by their indices in the user's list, ascending.
    pub triangles: Vec<u32>,
    /// Hexahedra removed, by their indices in the user's mesh, ascending.
    pub hexahedra: Vec<u32>,
    /// Membrane quadrilaterals removed, by their indices in the user's list, ascending.
    pub quads: Vec<u32>,
    /// Tetrahedra left in the body.
    pub remaining: usize,
    /// Membrane triangles left in the body.
    pub remaining_triangles: usize,
    /// Hexahedra left in the body.
    pub remaining_hexahedra: usize,
    /// Membrane quadrilaterals left in the body.
    pub remaining_quads: usize,
    /// Mesh edges that no element uses any more.
    pub edges: usize,
    /// Mesh faces that no element uses any more.
    pub faces: usize,
    /// Faces that follower pressures lost with them.
    pub pressure_faces: usize,
    /// Vertices that lost their last element, by their indices in the user's mesh, ascending.
    pub orphans: Vec<u32>,
    /// Connected pieces of the body now; vertices without elements are none.
    pub pieces: usize,
    /// Volume of the removed solid elements (m^3, at rest).
    pub volume: f64,
    /// Mass removed (kg); 0 when masses are kept.
    pub mass: f64,
    /// Elastic energy (J) that left with the elements.
    pub elastic_energy: f64,
    /// Kinetic energy (J) that left with the mass.
    pub kinetic_energy: f64,
    /// Whether tables and edge graph were compacted.
    pub compacted: bool,
    /// Host time taken.
    pub time: Duration,
}

/// A removal that cannot be carried out; nothing has changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RemovalError {
    /// There is no such body.
    #[error("there is no body {index}: the world has {count}")]
    Body {
        /// Index asked for.
        index: usize,
        /// Number of bodies.
        count: usize,
    },
    /// There is no such element.
    #[error("body `{body}` has no {kind} {index}: indices must be below {count}")]
    Element {
        /// Name of the body.
        body: String,
        /// [`ElementKind::name`].
        kind: &'static str,
        /// Index asked for.
        index: u32,
        /// Number of those in the user's mesh.
        count: usize,
    },
    /// It is gone already, or named twice.
    #[error(
        "{kind} {index} of body `{body}` was removed before or is named twice; ask which ones are left"
    )]
    Removed {
        /// Name of the body.
        body: String,
        /// [`ElementKind::name`].
        kind: &'static str,
        /// Index asked for.
        index: u32,
    },
    /// A number of the region cannot be used.
    #[error("region of the removal: {quantity} is {value}, it must be {range}")]
    Region {
        /// Which number.
        quantity: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        range: &'static str,
    },
    /// The tables of the bodies were changed from outside.
    #[error(
        "nothing can be removed from body `{body}`: a component was added to or removed from a vertex \
         or element entity (or one was despawned), so the order of rows is lost; keep such data on \
         entities of your own"
    )]
    LayoutChanged {
        /// Name of the body.
        body: String,
    },
}

/// Asks for a removal in [`StepSystems::Edit`] of the next step; the entity is despawned then.
/// Requests are carried out in the order in which they were made.
#[derive(Component, Clone, Debug)]
pub struct RemovalRequest {
    /// Index into [`Topology::bodies`].
    pub body: usize,
    /// What to remove.
    pub removal: Removal,
    sequence: u64,
}

/// Requests made so far.
static REQUESTS: AtomicU64 = AtomicU64::new(0);

impl RemovalRequest {
    /// Asks for a removal from the body at an index of [`Topology::bodies`].
    pub fn new(body: usize, removal: Removal) -> Self {
        Self { body, removal, sequence: REQUESTS.fetch_add(1, Ordering::Relaxed) }
    }
}

/// What came of the [`RemovalRequest`]s of the last step, with the index of the body: a report for every
/// batch, after the errors of its requests. A request that fails changes nothing and does not stop the
/// step; an element of a list that an earlier request of the batch takes counts as removed.
#[derive(Resource, Clone, Debug, Default)]
pub struct RemovalLog(pub Vec<(usize, Result<RemovalReport, RemovalError>)>);

/// What bodies keep for removals, from [`prepare_removals`] on.
#[derive(Resource, Debug, Default)]
pub struct Resection {
    bodies: Vec<Option<BodyResection>>,
}

impl Resection {
    /// Connectivity of a body, `None` while nothing was prepared for or removed from it.
    pub fn connectivity(&self, body: usize) -> Option<&Connectivity> {
        Some(&self.bodies.get(body)?.as_ref()?.connectivity)
    }
}

#[derive(Debug)]
struct BodyResection {
    connectivity: Connectivity,
    /// Index of the user -> element.
    element_of: ByKind<Vec<u32>>,
    /// Entities in whose rows the elements stand; a placeholder for those that have no row.
    rows: Entities,
    /// Removed elements that still have a row.
    dead: ByKind<usize>,
    /// Number of connected pieces.
    pieces: usize,
}

/// Elements of every kind, each list ascending.
type Chosen = ByKind<Vec<u32>>;

#[derive(Debug, Default)]
struct Entities {
    elements: ByKind<Vec<Entity>>,
    /// Edges of pooled springs, and those that are springs by themselves.
    edges: [Vec<Entity>; 2],
    triangles: Vec<Entity>,
    /// Axes of all kinds, with the tetrahedron or hexahedron that they lie in, ascending.
    axes: ByKind<Vec<(u32, Entity)>>,
}

impl Entities {
    /// Axes in an element.
    fn axes(&self, kind: ElementKind, element: u32) -> impl Iterator<Item = Entity> {
        let axes = &self.axes[kind];
        let first = axes.partition_point(|(e, _)| *e < element);
        axes[first..].iter().take_while(move |(e, _)| *e == element).map(|(_, entity)| *entity)
    }
}

/// Part of a body's rows that may be dead.
const DEAD_SHARE: f64 = 0.25;

/// Puts the system that carries out [`RemovalRequest`]s into the step, once.
pub(crate) fn install<S: Scalar>(world: &mut World) {
    if world.contains_resource::<RemovalLog>() {
        return;
    }
    world.init_resource::<RemovalLog>();
    if let Some(mut schedules) = world.get_resource_mut::<Schedules>() {
        let requests = apply_removal_requests::<S>.in_set(StepSystems::Edit);
        schedules.entry(StepSchedule).add_systems(requests);
    }
}

fn apply_removal_requests<S: Scalar>(world: &mut World) {
    world.resource_mut::<RemovalLog>().0.clear();
    let mut query = world.query::<(Entity, &RemovalRequest)>();
    let mut requests: Vec<_> = query.iter(world).map(|(e, r)| (e, r.clone())).collect();
    requests.sort_unstable_by_key(|(_, request)| request.sequence);
    let mut requests = requests.into_iter().peekable();
    while let Some((entity, RemovalRequest { body, removal, .. })) = requests.next() {
        world.despawn(entity);
        let mut regions = vec![removal.region];
        let same = |r: &RemovalRequest| r.body == body && r.removal.mass == removal.mass;
        while let Some((entity, next)) = requests.next_if(|(_, request)| same(request)) {
            world.despawn(entity);
            regions.push(next.removal.region);
        }
        let results = remove_batch::<S>(world, body, &regions, removal.mass);
        let log = &mut world.resource_mut::<RemovalLog>().0;
        log.extend(results.into_iter().map(|result| (body, result)));
    }
}

/// Finds out what [`remove_elements`] needs to know about a body, which it otherwise does at first
/// use. Linear in the size of the body.
///
/// # Errors
/// When there is no such body.
pub fn prepare_removals(world: &mut World, body: usize) -> Result<(), RemovalError> {
    let count = world.resource::<Topology>().bodies.len();
    if body >= count {
        return Err(RemovalError::Body { index: body, count });
    }
    let mut resection = world.remove_resource::<Resection>().unwrap_or_default();
    resection.bodies.resize_with(count, || None);
    if resection.bodies[body].is_none() {
        let rows = &world.resource::<Topology>().bodies[body];
        let inverse = |order: &[u32]| {
            let mut inverse = vec![0; order.len()];
            (0..).zip(order).for_each(|(t, &index)| inverse[index as usize] = t);
            inverse
        };
        resection.bodies[body] = Some(BodyResection {
            connectivity: Connectivity::new(rows),
            element_of: ByKind([
                inverse(&rows.tetrahedron_order),
                inverse(&rows.membrane_order),
                inverse(&rows.hexahedron_order),
                inverse(&rows.quad_order),
            ]),
            rows: Entities::default(),
            dead: ByKind::default(),
            pieces: rows.piece_count(),
        });
        resection.find_rows(world);
    }
    world.insert_resource(resection);
    Ok(())
}

impl Resection {
    /// Finds the entities in whose rows the elements of the prepared bodies stand.
    fn find_rows(&mut self, world: &mut World) {
        let topology = world.resource::<Topology>();
        let first: Vec<u32> = topology.bodies.iter().map(|b| b.vertices.start).collect();
        for own in self.bodies.iter_mut().flatten() {
            let cells = &own.connectivity.cells;
            let none = |count: usize| vec![Entity::PLACEHOLDER; count];
            own.rows = Entities {
                elements: ByKind(ElementKind::ALL.map(|kind| none(own.element_of[kind].len()))),
                edges: [none(cells.edges.len()), none(cells.edges.len())],
                triangles: none(cells.triangles.len()),
                axes: ByKind::default(),
            };
        }
        macro_rules! find {
            ($index:ty, $kind:expr) => {
                let mut elements = world.query::<(Entity, &$index, &BodyId)>();
                for (entity, index, body) in elements.iter(world) {
                    if let Some(own) = &mut self.bodies[body.0 as usize] {
                        let element = own.element_of[$kind][index.0 as usize];
                        own.rows.elements[$kind][element as usize] = entity;
                    }
                }
            };
        }
        find!(TetrahedronIndex, ElementKind::Tetrahedron);
        find!(MembraneIndex, ElementKind::Triangle);
        find!(HexahedronIndex, ElementKind::Hexahedron);
        find!(QuadIndex, ElementKind::Quad);
        macro_rules! find_axes {
            ($index:ty, $kind:expr) => {
                let mut axes = world.query::<(Entity, &$index, &BodyId)>();
                for (entity, index, body) in axes.iter(world) {
                    if let Some(own) = &mut self.bodies[body.0 as usize] {
                        let element = own.element_of[$kind][index.0 as usize];
                        own.rows.axes[$kind].push((element, entity));
                    }
                }
            };
        }
        find_axes!(AxisTetrahedron, ElementKind::Tetrahedron);
        find_axes!(AxisHexahedron, ElementKind::Hexahedron);
        for own in self.bodies.iter_mut().flatten() {
            own.rows.axes.0.iter_mut().for_each(|axes| axes.sort_unstable());
        }
        let mut edges = world.query::<(Entity, &EdgeVertices, &BodyId, Has<MassSpring>)>();
        for (entity, edge, body, alone) in edges.iter(world) {
            if let Some(own) = &mut self.bodies[body.0 as usize] {
                let local = edge.0.map(|v| v - first[body.0 as usize]);
                if let Ok(at) = own.connectivity.cells.edges.binary_search(&local) {
                    own.rows.edges[usize::from(alone)][at] = entity;
                }
            }
        }
        for (entity, triangle, body) in
            world.query::<(Entity, &TriangleVertices, &BodyId)>().iter(world)
        {
            if let Some(own) = &mut self.bodies[body.0 as usize] {
                let local = triangle.0.map(|v| v - first[body.0 as usize]);
                if let Ok(at) = own.connectivity.cells.triangles.binary_search(&local) {
                    own.rows.triangles[at] = entity;
                }
            }
        }
    }
}

/// Removes elements of a body, between steps.
///
/// The work is done on the calling thread in a fixed order.
///
/// # Errors
/// When the region cannot be used, or names an element that does not exist, is gone already or comes
/// twice; nothing is changed then. A region that holds no element is no error.
pub fn remove_elements<S: Scalar>(
    world: &mut World,
    body: usize,
    removal: &Removal,
) -> Result<RemovalReport, RemovalError> {
    compiled_here!(S, remove_now(world: &mut World, body: usize, removal: &Removal) -> Result<RemovalReport, RemovalError>)
}

fn remove_now<S: Scalar>(
    world: &mut World,
    body: usize,
    removal: &Removal,
) -> Result<RemovalReport, RemovalError> {
    let regions = std::slice::from_ref(&removal.region);
    let mut results = remove_batch::<S>(world, body, regions, removal.mass);
    results.swap_remove(0)
}

/// Removes what several regions hold as one batch: the errors of regions that cannot be used, then the
/// report of the others, if there are any.
fn remove_batch<S: Scalar>(
    world: &mut World,
    body: usize,
    regions: &[Region],
    mass: MassPolicy,
) -> Vec<Result<RemovalReport, RemovalError>> {
    let start = Instant::now();
    if let Err(error) = prepare_removals(world, body) {
        return vec![Err(error); regions.len()];
    }
    if let Some(spawned) = world.get_resource::<ElementTables>()
        && *spawned != ElementTables::of(world)
    {
        let body = world.resource::<Topology>().bodies[body].name.clone();
        return vec![Err(RemovalError::LayoutChanged { body }); regions.len()];
    }
    let mut resection = world.remove_resource::<Resection>().unwrap_or_default();
    let mut results = resection.remove::<S>(world, body, regions, mass);
    world.insert_resource(resection);
    for report in results.iter_mut().flatten() {
        report.time = start.elapsed();
    }
    results
}

fn check_region(region: &Region) -> Result<(), RemovalError> {
    let point = |quantity, value: DVec3| match value.is_finite() {
        true => Ok(()),
        false => Err(RemovalError::Region { quantity, value: value.to_string(), range: "finite" }),
    };
    let positive = |quantity, value: f64| match value > 0.0 && value.is_finite() {
        true => Ok(()),
        false => Err(RemovalError::Region {
            quantity,
            value: value.to_string(),
            range: "positive and finite",
        }),
    };
    match region {
        Region::Tetrahedra(_) | Region::Triangles(_) | Region::Hexahedra(_) | Region::Quads(_) => {
            Ok(())
        }
        Region::Sphere { centre, radius } => {
            point("centre", *centre).and_then(|()| positive("radius", *radius))
        }
        Region::Capsule { from, to, radius } => point("from", *from)
            .and_then(|()| point("to", *to))
            .and_then(|()| positive("radius", *radius)),
        Region::Strain { above } | Region::Stress { above } => positive("limit", *above),
    }
}

/// Columns of a tetrahedron that a removal sets to zero.
type Stiff<S> = (
    (
        &'static mut ShapeGradient<S, 1, 0>,
        &'static mut ShapeGradient<S, 1, 1>,
        &'static mut ShapeGradient<S, 1, 2>,
    ),
    (
        &'static mut ShapeGradient<S, 2, 0>,
        &'static mut ShapeGradient<S, 2, 1>,
        &'static mut ShapeGradient<S, 2, 2>,
    ),
    (
        &'static mut ShapeGradient<S, 3, 0>,
        &'static mut ShapeGradient<S, 3, 1>,
        &'static mut ShapeGradient<S, 3, 2>,
    ),
    &'static mut RestVolume<S>,
    &'static mut FirstLameParameter<S>,
    &'static mut ShearModulus<S>,
    &'static mut CompressionModulus<S>,
);

/// The same, to read.
type StiffRead<S> = (
    ShapeGradients<S>,
    &'static RestVolume<S>,
    &'static FirstLameParameter<S>,
    &'static ShearModulus<S>,
    &'static CompressionModulus<S>,
);

/// An element in `f64` from its columns.
macro_rules! element {
    ($columns:expr) => {{
        let ((d1, d2, d3), volume, lambda, mu, compression) = $columns;
        Element::<f64> {
            gradients: [
                [d1.0.0, d1.1.0, d1.2.0],
                [d2.0.0, d2.1.0, d2.2.0],
                [d3.0.0, d3.1.0, d3.2.0],
            ]
            .map(|d| d.map(|x| x.to_f64())),
            volume: volume.0.to_f64(),
            lambda: lambda.0.to_f64(),
            mu: mu.0.to_f64(),
            compression: compression.0.to_f64(),
        }
    }};
}

/// Rest positions and displacements (m) of all vertices of a world, as one body numbers them.
struct Vertices<'a, S: Scalar> {
    rest: &'a [RestPosition],
    displacement: &'a [Displacement<S>],
}

type VertexQuery<S> = QueryState<(&'static RestPosition, &'static Displacement<S>)>;

impl<'a, S: Scalar> Vertices<'a, S> {
    /// Nothing is copied.
    fn of(query: &'a mut VertexQuery<S>, world: &'a World, body: usize) -> Self {
        let rows = world.resource::<Topology>().bodies[body].vertices.clone();
        let rows = rows.start as usize..rows.end as usize;
        match single_table(query.contiguous_iter(world)) {
            Some((rest, u)) => Self { rest: &rest[rows.clone()], displacement: &u[rows] },
            None => Self { rest: &[], displacement: &[] },
        }
    }

    fn displacement(&self, vertex: u32) -> DVec3 {
        let u = self.displacement[vertex as usize].0;
        DVec3::new(u[0].to_f64(), u[1].to_f64(), u[2].to_f64())
    }

    fn barycentre(&self, vertices: &[u32]) -> DVec3 {
        let sum: DVec3 =
            vertices.iter().map(|&v| self.rest[v as usize].0 + self.displacement(v)).sum();
        sum / vertices.len() as f64
    }

    fn displacements<const N: usize>(&self, vertices: [u32; N]) -> [[f64; 3]; N] {
        vertices.map(|v| self.displacement(v).to_array())
    }

    fn rest<const N: usize>(&self, vertices: [u32; N]) -> [[f64; 3]; N] {
        vertices.map(|v| self.rest[v as usize].0.to_array())
    }

    /// Rest shape; it was found usable when the body was built.
    fn rest_tetrahedron(&self, vertices: [u32; 4]) -> RestTetrahedron {
        RestTetrahedron::new(self.rest(vertices)).expect("the body was built with it")
    }

    /// The same of a hexahedron.
    fn rest_hexahedron(&self, vertices: [u32; 8]) -> RestHexahedron {
        RestHexahedron::new(self.rest(vertices)).expect("the body was built with it")
    }

    /// The same of a membrane quadrilateral.
    fn rest_quad(&self, vertices: [u32; 4]) -> RestQuad {
        RestQuad::new(self.rest(vertices)).expect("the body was built with it")
    }

    /// The same of a membrane triangle.
    fn rest_triangle(&self, vertices: [u32; 3]) -> RestTriangle {
        RestTriangle::new(self.rest(vertices)).expect("the body was built with it")
    }
}

impl Resection {
    fn remove<S: Scalar>(
        &mut self,
        world: &mut World,
        body: usize,
        regions: &[Region],
        mass: MassPolicy,
    ) -> Vec<Result<RemovalReport, RemovalError>> {
        let soft = world.query::<&SoftBody>().iter(world).find(|b| b.index == body).cloned();
        let (Some(own), Some(soft)) = (&mut self.bodies[body], soft) else {
            return vec![Ok(RemovalReport::default())];
        };
        let mut results = Vec::new();
        let mut chosen = Chosen::default();
        for region in regions {
            let found =
                check_region(region).and_then(|()| own.choose::<S>(world, &soft, region, &chosen));
            match found {
                Ok(found) => add(&mut chosen, found),
                Err(error) => results.push(Err(error)),
            }
        }
        if results.len() == regions.len() {
            return results;
        }
        let mut report = RemovalReport::default();
        own.book_energies::<S>(world, &soft, &chosen, &mut report);
        own.clear::<S>(world, &chosen);
        let touched = own.connectivity.remove(&chosen);
        own.sum_constants::<S>(world, &soft, &touched);
        if mass == MassPolicy::Recompute {
            own.sum_masses::<S>(world, &soft, &touched, &mut report);
        }
        if !touched.unused_triangles.is_empty() || !touched.unused_edges.is_empty() {
            report.pressure_faces = own.drop_pressures(world, body);
        }

        let mut topology = world.resource_mut::<Topology>();
        let edge_count = topology.edges.len();
        if !touched.unused_edges.is_empty() {
            topology.unused_edges.resize(edge_count, false);
        }
        let v0 = topology.bodies[body].vertices.start;
        for &edge in &touched.unused_edges {
            let [a, b] = own.connectivity.cells.edges[edge as usize].map(|v| v + v0);
            if let Some(block) = topology.find_edge(a, b) {
                topology.unused_edges[block] = true;
            }
        }
        let of_body = &mut topology.bodies[body];
        for &v in &touched.orphans {
            of_body.piece[v as usize] = UNUSED;
        }
        if touched.may_split {
            let pieces = own.connectivity.pieces();
            if pieces != of_body.piece {
                of_body.piece = pieces;
                of_body.splits += 1;
            }
            own.pieces = of_body.piece_count();
        }
        report.pieces = own.pieces;
        let sorted = |of: &[u32], order: &[u32]| {
            let mut user: Vec<u32> = of.iter().map(|&i| order[i as usize]).collect();
            user.sort_unstable();
            user
        };
        report.orphans = sorted(&touched.orphans, &of_body.vertex_order);
        let [tetrahedra, triangles, hexahedra, quads] = &chosen.0;
        report.tetrahedra = sorted(tetrahedra, &of_body.tetrahedron_order);
        report.triangles = sorted(triangles, &of_body.membrane_order);
        report.hexahedra = sorted(hexahedra, &of_body.hexahedron_order);
        report.quads = sorted(quads, &of_body.quad_order);
        let left = |kind| own.connectivity.remaining(kind);
        report.remaining = left(ElementKind::Tetrahedron);
        report.remaining_triangles = left(ElementKind::Triangle);
        report.remaining_hexahedra = left(ElementKind::Hexahedron);
        report.remaining_quads = left(ElementKind::Quad);
        report.edges = touched.unused_edges.len();
        report.faces = touched.unused_triangles.len() + touched.unused_faces;

        let too_many = ElementKind::ALL.iter().any(|&kind| {
            let dead = own.dead[kind] + chosen[kind].len();
            dead as f64 > DEAD_SHARE * (left(kind) + dead) as f64
        });
        for kind in ElementKind::ALL {
            own.dead[kind] += chosen[kind].len();
        }
        if too_many && compact::compact::<S>(world, self) {
            report.compacted = true;
        }
        if report.compacted || report.pressure_faces > 0 {
            pressure::refresh::<S>(world);
        }
        results.push(Ok(report));
        results
    }
}

/// Adds to `chosen` what is not in it.
fn add(chosen: &mut Chosen, other: Chosen) {
    for (own, more) in chosen.0.iter_mut().zip(other.0) {
        own.extend(more);
        own.sort_unstable();
        own.dedup();
    }
}

impl BodyResection {
    /// Elements of a region that are left and not `taken`.
    fn choose<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        region: &Region,
        taken: &Chosen,
    ) -> Result<Chosen, RemovalError> {
        let connectivity = &self.connectivity;
        let is_free = |kind: ElementKind, e: u32| {
            connectivity.is_present(kind, e) && taken[kind].binary_search(&e).is_err()
        };
        let listed = |list: &[u32], kind: ElementKind| {
            let body = || world.resource::<Topology>().bodies[soft.index].name.clone();
            let of = &self.element_of[kind];
            let mut chosen = Vec::with_capacity(list.len());
            for &index in list {
                let Some(&e) = of.get(index as usize) else {
                    let (kind, count) = (kind.name(), of.len());
                    return Err(RemovalError::Element { body: body(), kind, index, count });
                };
                chosen.push((e, index));
            }
            chosen.sort_unstable();
            let twice = chosen.windows(2).find(|w| w[0] == w[1]).map(|w| w[0].1);
            let gone = chosen.iter().find(|(e, _)| !is_free(kind, *e));
            if let Some(index) = twice.or(gone.map(|g| g.1)) {
                return Err(RemovalError::Removed { body: body(), kind: kind.name(), index });
            }
            let mut result = Chosen::default();
            result[kind] = chosen.into_iter().map(|(e, _)| e).collect();
            Ok(result)
        };
        match region {
            Region::Tetrahedra(list) => return listed(list, ElementKind::Tetrahedron),
            Region::Triangles(list) => return listed(list, ElementKind::Triangle),
            Region::Hexahedra(list) => return listed(list, ElementKind::Hexahedron),
            Region::Quads(list) => return listed(list, ElementKind::Quad),
            _ => {}
        }
        let mut chosen = Chosen::default();
        for kind in ElementKind::ALL {
            chosen[kind] = connectivity.all_left(kind).filter(|&e| is_free(kind, e)).collect();
        }
        match region {
            Region::Strain { above } => {
                let limit = *above;
                Ok(self.exceeding::<S>(
                    world,
                    soft,
                    chosen,
                    |e, u| largest_strain(e, u) > limit,
                    |e, u| principal(membrane_strain(e, u))[0] > limit,
                ))
            }
            Region::Stress { above } => {
                let limit = *above;
                let thickness = soft.membrane.map_or(0.0, |m| m.thickness);
                Ok(self.exceeding::<S>(
                    world,
                    soft,
                    chosen,
                    |e, u| von_mises_stress(e, u) > limit,
                    |e, u| membrane_von_mises(e, u, thickness) > limit,
                ))
            }
            _ => {
                let mut query = world.query();
                let vertices = Vertices::<S>::of(&mut query, world, soft.index);
                for kind in ElementKind::ALL {
                    chosen[kind].retain(|&e| {
                        region.holds(vertices.barycentre(connectivity.vertices(kind, e)))
                    });
                }
                Ok(chosen)
            }
        }
    }

    /// Elements that fulfil a condition on their constants and displacements, at some Gauss point.
    fn exceeding<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        mut chosen: Chosen,
        solid: impl Fn(&Element<f64>, &[[f64; 3]; 4]) -> bool,
        sheet: impl Fn(&membrane::Element<f64>, &[[f64; 3]; 3]) -> bool,
    ) -> Chosen {
        let connectivity = &self.connectivity;
        let mut query = world.query();
        let elements = self.elements::<S>(world, &chosen[ElementKind::Tetrahedron]);
        let bricks = self.bricks::<S>(world, &chosen[ElementKind::Hexahedron]);
        let vertices = Vertices::<S>::of(&mut query, world, soft.index);
        let mut elements = elements.iter();
        chosen[ElementKind::Tetrahedron].retain(|&t| {
            let u = vertices.displacements(connectivity.tetrahedra[t as usize]);
            elements.next().is_some_and(|e| solid(e, &u))
        });
        let mut bricks = bricks.iter();
        chosen[ElementKind::Hexahedron].retain(|&h| {
            let u = vertices.displacements(connectivity.hexahedra[h as usize]);
            bricks.next().is_some_and(|(rest, moduli)| {
                hexahedra::tetrahedra(rest, *moduli, &u).iter().any(|(e, u)| solid(e, u))
            })
        });
        let sheets = self.membrane_elements(soft, &chosen[ElementKind::Triangle], &vertices);
        let mut sheets = sheets.iter();
        chosen[ElementKind::Triangle].retain(|&t| {
            let u = vertices.displacements(connectivity.membrane[t as usize]);
            sheets.next().is_some_and(|e| sheet(e, &u))
        });
        if let Some(settings) = &soft.membrane {
            // the triangles come with twice the moduli
            let moduli = moduli_of(settings).map(|m| 0.5 * m);
            chosen[ElementKind::Quad].retain(|&q| {
                let nodes = connectivity.quads[q as usize];
                let (rest, u) = (vertices.rest_quad(nodes), vertices.displacements(nodes));
                quads::triangles(&rest.component(), moduli, &u).iter().any(|(e, u)| sheet(e, u))
            });
        }
        chosen
    }

    /// Books elastic energy and volume of the elements that go.
    fn book_energies<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        chosen: &Chosen,
        report: &mut RemovalReport,
    ) {
        let connectivity = &self.connectivity;
        let mut query = world.query();
        let elements = self.elements::<S>(world, &chosen[ElementKind::Tetrahedron]);
        let bricks = self.bricks::<S>(world, &chosen[ElementKind::Hexahedron]);
        let vertices = Vertices::<S>::of(&mut query, world, soft.index);
        for kind in ElementKind::ALL.into_iter().filter(|&kind| soft.springs.has(kind)) {
            let pairs: &[[usize; 2]] = match kind {
                ElementKind::Tetrahedron => &EDGES,
                ElementKind::Triangle => &[[1, 2], [2, 0], [0, 1]],
                ElementKind::Hexahedron => &HEXAHEDRON_PAIRS,
                ElementKind::Quad => &QUAD_PAIRS,
            };
            for &e in &chosen[kind] {
                let nodes = connectivity.vertices(kind, e);
                let end = |v: usize| {
                    let [rest] = vertices.rest([nodes[v]]);
                    let [u] = vertices.displacements([nodes[v]]);
                    (rest, u)
                };
                let ends = |pair: usize| pairs[pair].map(end);
                report.elastic_energy += soft.springs.energy(kind, e, ends);
            }
        }
        for (&t, element) in chosen[ElementKind::Tetrahedron].iter().zip(elements) {
            let u = vertices.displacements(connectivity.tetrahedra[t as usize]);
            report.elastic_energy += energy(soft.law, &element, &u);
            report.volume += element.volume;
            for entity in self.rows.axes(ElementKind::Tetrahedron, t) {
                report.elastic_energy += axes::removal::energy::<S>(world, entity, &u);
            }
        }
        let brick_law = soft.law.and_then(|law| law.hexahedra);
        for (&h, (rest, moduli)) in chosen[ElementKind::Hexahedron].iter().zip(&bricks) {
            let u = vertices.displacements(connectivity.hexahedra[h as usize]);
            let points = hexahedra::tetrahedra(rest, *moduli, &u);
            report.elastic_energy +=
                points.iter().map(|(e, u)| energy(brick_law, e, u)).sum::<f64>();
            report.volume += rest.volume.iter().sum::<f64>();
            for entity in self.rows.axes(ElementKind::Hexahedron, h) {
                report.elastic_energy += axes::removal::hexahedron_energy::<S>(world, entity, &u);
            }
        }
        let Some(settings) = &soft.membrane else { return };
        let sheets = self.membrane_elements(soft, &chosen[ElementKind::Triangle], &vertices);
        for (&t, element) in chosen[ElementKind::Triangle].iter().zip(&sheets) {
            let u = vertices.displacements(connectivity.membrane[t as usize]);
            report.elastic_energy += membrane_energy(settings.model, element, &u);
        }
        for &q in &chosen[ElementKind::Quad] {
            let nodes = connectivity.quads[q as usize];
            let (rest, u) = (vertices.rest_quad(nodes), vertices.displacements(nodes));
            let points = quads::triangles(&rest.component(), moduli_of(settings), &u);
            report.elastic_energy +=
                points.iter().map(|(e, u)| membrane_energy(settings.model, e, u)).sum::<f64>();
        }
    }

    /// Columns of tetrahedra that have a row.
    fn elements<S: Scalar>(&self, world: &mut World, of: &[u32]) -> Vec<Element<f64>> {
        let mut query = world.query::<StiffRead<S>>();
        of.iter()
            .map(|&t| {
                let columns =
                    query.get(world, self.rows.elements[ElementKind::Tetrahedron][t as usize]);
                element!(columns.expect("a tetrahedron that is left has a row"))
            })
            .collect()
    }

    /// Rest shapes and moduli (Pa) of hexahedra that have a row.
    fn bricks<S: Scalar>(
        &self,
        world: &mut World,
        of: &[u32],
    ) -> Vec<(HexahedronRest<f64>, [f64; 3])> {
        let mut query = world.query::<(
            &HexahedronRest<S>,
            &FirstLameParameter<S>,
            &ShearModulus<S>,
            &CompressionModulus<S>,
        )>();
        let brick = |&h: &u32| {
            let entity = self.rows.elements[ElementKind::Hexahedron][h as usize];
            let (rest, lambda, mu, compression) =
                query.get(world, entity).expect("a hexahedron that is left has a row");
            let rest = HexahedronRest {
                gradients: rest.gradients.map(|row| row.map(|x| x.to_f64())),
                volume: rest.volume.map(|x| x.to_f64()),
            };
            (rest, [lambda.0, mu.0, compression.0].map(|x| x.to_f64()))
        };
        of.iter().map(brick).collect()
    }

    /// Membrane triangles that are left; the membrane of a body is of one material.
    fn membrane_elements<S: Scalar>(
        &self,
        soft: &SoftBody,
        of: &[u32],
        vertices: &Vertices<S>,
    ) -> Vec<membrane::Element<f64>> {
        let Some(settings) = &soft.membrane else { return Vec::new() };
        let (moduli, _) = settings.surface();
        let compression = settings.compression() > 0.0;
        let element = |&t: &u32| {
            let rest = vertices.rest_triangle(self.connectivity.membrane[t as usize]);
            membrane::Element::new(&rest, moduli, compression)
        };
        of.iter().map(element).collect()
    }

    /// Makes the rows of elements dead.
    fn clear<S: Scalar>(&self, world: &mut World, chosen: &Chosen) {
        let mut query = world.query::<Stiff<S>>();
        let rows = &self.rows.elements;
        for &t in &chosen[ElementKind::Tetrahedron] {
            let columns = query.get_mut(world, rows[ElementKind::Tetrahedron][t as usize]);
            let (mut d1, mut d2, mut d3, mut volume, mut lambda, mut mu, mut compression) =
                columns.expect("a tetrahedron that is left has a row");
            (d1.0.0, d1.1.0, d1.2.0) = (S::ZERO, S::ZERO, S::ZERO);
            (d2.0.0, d2.1.0, d2.2.0) = (S::ZERO, S::ZERO, S::ZERO);
            (d3.0.0, d3.1.0, d3.2.0) = (S::ZERO, S::ZERO, S::ZERO);
            (volume.0, lambda.0, mu.0, compression.0) = (S::ZERO, S::ZERO, S::ZERO, S::ZERO);
        }
        for kind in [ElementKind::Tetrahedron, ElementKind::Hexahedron] {
            for entity in chosen[kind].iter().flat_map(|&e| self.rows.axes(kind, e)) {
                axes::removal::clear::<S>(world, entity);
            }
        }
        let mut query = world.query::<(
            &mut VolumetricStiffness<S, 0>,
            &mut VolumetricStiffness<S, 1>,
            &mut VolumetricStiffness<S, 2>,
        )>();
        for &t in &chosen[ElementKind::Tetrahedron] {
            let entity = rows[ElementKind::Tetrahedron][t as usize];
            // only pooled bodies have these
            if let Ok((mut a, mut b, mut c)) = query.get_mut(world, entity) {
                (a.0, b.0, c.0) = (S::ZERO, S::ZERO, S::ZERO);
            }
        }
        let mut query = world.query::<(
            &mut MembraneVertices,
            &mut MembraneBlocks,
            &mut MembraneFirstModulus<S>,
            &mut MembraneShearModulus<S>,
            &mut MembraneCompressionModulus<S>,
        )>();
        for &t in &chosen[ElementKind::Triangle] {
            let columns = query.get_mut(world, rows[ElementKind::Triangle][t as usize]);
            let (mut nodes, mut blocks, mut lambda, mut mu, mut compression) =
                columns.expect("a membrane triangle that is left has a row");
            // one vertex, and the block that its row owns: the deformed edges are those at rest
            nodes.0 = [nodes.0[0]; 3];
            blocks.0 = [blocks.0[2]; 3];
            (lambda.0, mu.0, compression.0) = (S::ZERO, S::ZERO, S::ZERO);
        }
        let mut query = world.query::<(
            &mut QuadVertices,
            &mut QuadBlocks,
            &mut MembraneFirstModulus<S>,
            &mut MembraneShearModulus<S>,
            &mut MembraneCompressionModulus<S>,
        )>();
        for &q in &chosen[ElementKind::Quad] {
            let columns = query.get_mut(world, rows[ElementKind::Quad][q as usize]);
            let (mut nodes, mut blocks, mut lambda, mut mu, mut compression) =
                columns.expect("a quadrilateral that is left has a row");
            (nodes.0, blocks.0) = ([nodes.0[0]; 4], [blocks.0[0]; 6]);
            (lambda.0, mu.0, compression.0) = (S::ZERO, S::ZERO, S::ZERO);
        }
        let mut query = world.query::<(
            &mut HexahedronRest<S>,
            &mut RestVolume<S>,
            &mut FirstLameParameter<S>,
            &mut ShearModulus<S>,
            &mut CompressionModulus<S>,
        )>();
        for &h in &chosen[ElementKind::Hexahedron] {
            let columns = query.get_mut(world, rows[ElementKind::Hexahedron][h as usize]);
            let (mut rest, mut volume, mut lambda, mut mu, mut compression) =
                columns.expect("a hexahedron that is left has a row");
            *rest = HexahedronRest { gradients: [[S::ZERO; 8]; 9], volume: [S::ZERO; 8] };
            (volume.0, lambda.0, mu.0, compression.0) = (S::ZERO, S::ZERO, S::ZERO, S::ZERO);
        }
    }

    /// Sums the constants of the springs at the touched edges and triangles again, in the order in which
    /// a new body sums them.
    fn sum_constants<S: Scalar>(&self, world: &mut World, soft: &SoftBody, touched: &Touched) {
        self.sum_edge_springs::<S>(world, soft, touched);
        let Connectivity { tetrahedra, membrane, cells, round_edge, round_triangle, .. } =
            &self.connectivity;
        let membrane_at = &self.connectivity.membrane_at;
        let left = |kind, edge: u32| self.connectivity.left(kind, round_edge[kind].of(edge));
        let solid = soft.evaluation == Evaluation::Pooled;
        let sheet = soft.membrane.filter(|m| m.is_pooled());
        if !solid && sheet.is_none() {
            return;
        }
        // whoever shares a triangle with a removed element shares its edges
        let round = |kind, pooled: bool| {
            let edges = touched.edges.iter().filter(|_| pooled);
            let mut round: Vec<u32> = edges.flat_map(|&e| left(kind, e)).collect();
            round.sort_unstable();
            round.dedup();
            round
        };
        let sheets = round(ElementKind::Triangle, sheet.is_some());
        let round = round(ElementKind::Tetrahedron, solid);
        let mut query = world.query();
        let elements = self.elements::<S>(world, &round);
        let vertices = Vertices::<S>::of(&mut query, world, soft.index);
        let constants: Vec<SpringConstants> = round
            .iter()
            .zip(&elements)
            .map(|(&t, element)| {
                let rest = vertices.rest_tetrahedron(tetrahedra[t as usize]);
                SpringConstants::new(&rest, lame(element))
            })
            .collect();
        let moduli = sheet.map(|settings| settings.surface().0);
        let sheet_constants: Vec<membrane::SpringConstants> = sheets
            .iter()
            .zip(moduli.into_iter().cycle())
            .map(|(&t, moduli)| {
                let rest = vertices.rest_triangle(membrane[t as usize]);
                membrane::SpringConstants::new(&rest, moduli)
            })
            .collect();
        // none where the elements have no springs
        let constants = |t: u32| Some(&constants[round.binary_search(&t).ok()?]);
        let sheet_constants = |t: u32| Some(&sheet_constants[sheets.binary_search(&t).ok()?]);

        let mut query = world.query::<&mut TensileStiffness<S>>();
        for &edge in &touched.edges {
            let mut sum = 0.0;
            for t in left(ElementKind::Tetrahedron, edge) {
                let own = &cells.tetrahedron_edges[t as usize];
                let local = own.iter().position(|&e| e == edge).unwrap_or(0);
                sum += constants(t).map_or(0.0, |c| c.tensile[local]);
            }
            for t in left(ElementKind::Triangle, edge) {
                let own = &cells.membrane_edges[t as usize];
                let local = own.iter().position(|&e| e == edge).unwrap_or(0);
                sum += sheet_constants(t).map_or(0.0, |c| c.tensile[local]);
            }
            if let Ok(mut k) = query.get_mut(world, self.rows.edges[0][edge as usize]) {
                k.0 = S::from_f64(sum);
            }
        }
        let mut query = world.query::<(
            &mut AngularStiffness<S, 0>,
            &mut AngularStiffness<S, 1>,
            &mut AngularStiffness<S, 2>,
        )>();
        for &triangle in &touched.triangles {
            let mut sum = [0.0; 3];
            let solid = if solid { round_triangle.of(triangle) } else { &[] };
            for t in self.connectivity.left(ElementKind::Tetrahedron, solid) {
                let (Some(constants), nodes) = (constants(t), tetrahedra[t as usize]) else {
                    continue;
                };
                for (c, pair) in constants.angular.iter().zip(ADJACENT_PAIRS) {
                    let (face, apex) = angular_place(pair);
                    if cells.tetrahedron_triangles[t as usize][face] == triangle {
                        let own = cells.triangles[triangle as usize];
                        let m = own.iter().position(|&v| v == nodes[apex]).unwrap_or(0);
                        sum[m] += c;
                    }
                }
            }
            let at = membrane_at[triangle as usize];
            let at = Some(at)
                .filter(|&t| t != UNUSED && self.connectivity.is_present(ElementKind::Triangle, t));
            if let Some(constants) = at.and_then(sheet_constants) {
                for m in 0..3 {
                    sum[m] += constants.angular[m];
                }
            }
            let columns = query.get_mut(world, self.rows.triangles[triangle as usize]);
            if let Ok((mut a, mut b, mut c)) = columns {
                (a.0, b.0, c.0) = (S::from_f64(sum[0]), S::from_f64(sum[1]), S::from_f64(sum[2]));
            }
        }
    }

    /// Sums edges that are springs by themselves again.
    fn sum_edge_springs<S: Scalar>(&self, world: &mut World, soft: &SoftBody, touched: &Touched) {
        if soft.springs.is_empty() {
            return;
        }
        let mut query = world.query();
        let vertices = Vertices::<S>::of(&mut query, world, soft.index);
        let stiffness = |&edge: &u32| {
            let [a, b] = vertices.rest(self.connectivity.cells.edges[edge as usize]);
            let sum = soft.springs.at_edge(&self.connectivity, edge);
            lumped::tensile_stiffness(sum, sub(a, b))
        };
        let sums: Vec<f64> = touched.edges.iter().map(stiffness).collect();
        let mut query = world.query::<&mut TensileStiffness<S>>();
        for (&edge, sum) in touched.edges.iter().zip(sums) {
            if let Ok(mut k) = query.get_mut(world, self.rows.edges[1][edge as usize]) {
                k.0 = S::from_f64(sum);
            }
        }
    }

    /// Sums the masses of the touched vertices again, and books what went.
    fn sum_masses<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        touched: &Touched,
        report: &mut RemovalReport,
    ) {
        let connectivity = &self.connectivity;
        let mut query = world.query();
        let vertices = Vertices::<S>::of(&mut query, world, soft.index);
        let rows = &world.resource::<Topology>().bodies[soft.index];
        let v0 = rows.vertices.start;
        let field = soft.field();
        let surface_density = soft.membrane.map_or(0.0, |m| m.surface().1);
        let of_vertex = |&v: &u32| {
            let mut sum = 0.0;
            let left = |kind| connectivity.left(kind, connectivity.round_vertex[kind].of(v));
            let local = |nodes: &[u32]| nodes.iter().position(|&n| n == v).unwrap_or(0);
            for t in left(ElementKind::Tetrahedron) {
                let density = field.at(rows.tetrahedron_order[t as usize] as usize).density;
                let rest = vertices.rest_tetrahedron(connectivity.tetrahedra[t as usize]);
                sum += density * rest.volume / 4.0;
            }
            for h in left(ElementKind::Hexahedron) {
                let at = rows.tetrahedra.len() + rows.hexahedron_order[h as usize] as usize;
                let nodes = connectivity.hexahedra[h as usize];
                let volumes = vertices.rest_hexahedron(nodes).vertex_volumes();
                sum += field.at(at).density * volumes[local(&nodes)];
            }
            for t in left(ElementKind::Triangle) {
                let rest = vertices.rest_triangle(connectivity.membrane[t as usize]);
                sum += surface_density * rest.area / 3.0;
            }
            for q in left(ElementKind::Quad) {
                let nodes = connectivity.quads[q as usize];
                sum += surface_density * vertices.rest_quad(nodes).vertex_areas()[local(&nodes)];
            }
            sum
        };
        let sums: Vec<f64> = touched.vertices.iter().map(of_vertex).collect();
        let mut query = world.query::<(&mut Mass<S>, &mut Velocity<S>)>();
        let Some((mut mass, mut velocity)) = single_table(query.contiguous_iter_mut(world)) else {
            return;
        };
        let (mass, velocity) = (mass.bypass_change_detection(), velocity.bypass_change_detection());
        for (&v, sum) in touched.vertices.iter().zip(sums) {
            let row = (v + v0) as usize;
            let before = mass[row].0.to_f64();
            mass[row].0 = S::from_f64(sum);
            let gone = before - mass[row].0.to_f64();
            let speed = (0..3).map(|k| velocity[row].0[k].to_f64().powi(2)).sum::<f64>();
            report.mass += gone;
            report.kinetic_energy += 0.5 * gone * speed;
            if !connectivity.uses_vertex(v) {
                velocity[row] = Velocity::default();
            }
        }
    }

    /// Takes the faces that no element has any more out of the pressures; how many there were.
    fn drop_pressures(&self, world: &mut World, body: usize) -> usize {
        let rows = world.resource::<Topology>().bodies[body].vertices.clone();
        let cells = &self.connectivity.cells;
        let is_gone = |face: &[u32; 3]| {
            if !rows.contains(&face[0]) {
                return false;
            }
            let mut local = face.map(|v| v - rows.start);
            local.sort_unstable();
            let [a, b, c] = local;
            match cells.triangles.binary_search(&local) {
                Ok(at) => !self.connectivity.uses_triangle(at as u32),
                // between edges of the body, but no face of it
                Err(_) => [[a, b], [b, c], [a, c]].iter().any(|edge| {
                    let at = cells.edges.binary_search(edge);
                    !at.is_ok_and(|at| self.connectivity.uses_edge(at as u32))
                }),
            }
        };
        let mut dropped = 0;
        for mut pressure in world.query::<&mut Pressure>().iter_mut(world) {
            let before = pressure.faces.len();
            pressure.bypass_change_detection().faces.retain(|face| !is_gone(face));
            dropped += before - pressure.faces.len();
        }
        dropped
    }
}

impl Region {
    /// Whether a sphere or capsule holds a point.
    fn holds(&self, x: DVec3) -> bool {
        match self {
            Self::Sphere { centre, radius } => x.distance(*centre) <= *radius,
            Self::Capsule { from, to, radius } => {
                let axis = *to - *from;
                let square = axis.length_squared();
                let along = if square > 0.0 {
                    ((x - *from).dot(axis) / square).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                x.distance(*from + axis * along) <= *radius
            }
            _ => false,
        }
    }
}

fn lame(element: &Element<f64>) -> LameParameters {
    LameParameters { lambda: element.lambda, mu: element.mu }
}

/// Moduli (N/m) of a membrane: lambda, mu and that of the compression term.
fn moduli_of(settings: &MembraneSettings) -> [f64; 3] {
    let LameParameters { lambda, mu } = settings.surface().0;
    [lambda, mu, settings.compression()]
}

/// Energy (J) of a tetrahedron by its own law; springs on edges and axes are booked beside it.
fn energy(law: Option<&LawRow>, element: &Element<f64>, u: &[[f64; 3]; 4]) -> f64 {
    law.and_then(|row| row.energy).map_or(0.0, |energy| energy(element, u))
}

/// Energy (J) of a membrane triangle by its own law; springs on edges are booked beside it.
fn membrane_energy(model: MembraneModel, e: &membrane::Element<f64>, u: &[[f64; 3]; 3]) -> f64 {
    match model {
        MembraneModel::Biquadratic | MembraneModel::CompressibleBiquadratic => {
            membrane::biquadratic::energy(e, u)
        }
        MembraneModel::Quadratic => membrane::quadratic::energy(e, u),
        MembraneModel::Linear => membrane::linear::energy(e, u),
        MembraneModel::Corotational => membrane::corotational::energy(e, u),
        MembraneModel::MassSpring => 0.0,
    }
}

/// Green strain of a membrane triangle in its plane: entries xx, yy, xy, with x along the first edge.
fn membrane_strain(e: &membrane::Element<f64>, u: &[[f64; 3]; 3]) -> [f64; 3] {
    let [a, b] = e.edges.map(DVec3::from_array);
    let w = [1, 2].map(|i| DVec3::from_array(sub(u[i], u[0])));
    let c = [
        w[0].dot(a + a + w[0]),
        w[1].dot(b + b + w[1]),
        w[0].dot(b) + a.dot(w[1]) + w[0].dot(w[1]),
    ];
    // edges in the frame of the triangle: a = (l, 0), b = (p, q)
    let length = a.length();
    let (p, q) = (a.dot(b) / length, a.cross(b).length() / length);
    let xx = c[0] / (length * length);
    let xy = (c[2] / length - p * xx) / q;
    let yy = (c[1] - p * p * xx - 2.0 * p * q * xy) / (q * q);
    [0.5 * xx, 0.5 * yy, 0.5 * xy]
}

/// Principal values of a symmetric 2x2 matrix given as xx, yy, xy, larger first.
fn principal([xx, yy, xy]: [f64; 3]) -> [f64; 2] {
    let (mean, radius) = (0.5 * (xx + yy), libm::hypot(0.5 * (xx - yy), xy));
    [mean + radius, mean - radius]
}

/// Von Mises equivalent (Pa) of the Cauchy stress of a membrane triangle of this thickness (m), whose
/// material keeps its volume. Both stresses share the principal axes of the strain.
fn membrane_von_mises(e: &membrane::Element<f64>, u: &[[f64; 3]; 3], thickness: f64) -> f64 {
    let strain = principal(membrane_strain(e, u));
    let stress = strain.map(|x| e.lambda * (strain[0] + strain[1]) + 2.0 * e.mu * x);
    // F S F^T / (J2 t) with t = thickness / J2
    let [a, b] = [0, 1].map(|i| (1.0 + 2.0 * strain[i]) * stress[i] / thickness);
    (a * a - a * b + b * b).sqrt()
}

/// Largest principal Green strain (-).
fn largest_strain(element: &Element<f64>, u: &[[f64; 3]; 4]) -> f64 {
    let strain = green_strain(&displacement_gradient(&element.gradients, u));
    largest_eigenvalue(strain)
}

/// Von Mises equivalent (Pa) of the Cauchy stress `F S F^T / |J|`.
fn von_mises_stress(element: &Element<f64>, u: &[[f64; 3]; 4]) -> f64 {
    let g = displacement_gradient(&element.gradients, u);
    let [xx, yy, zz, yz, xz, xy] = second_piola_kirchhoff(element, &green_strain(&g));
    let s = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
    let f = DMat3::from_cols_array(&g).transpose() + DMat3::IDENTITY;
    let cauchy = f * s * f.transpose() * (1.0 + volume_change(&g)).abs().recip();
    let [x, y, z] = [cauchy.x_axis, cauchy.y_axis, cauchy.z_axis];
    let normal = (x.x - y.y).powi(2) + (y.y - z.z).powi(2) + (z.z - x.x).powi(2);
    let shear = x.y * x.y + y.z * y.z + x.z * x.z;
    (0.5 * normal + 3.0 * shear).sqrt()
}

/// Largest eigenvalue of a symmetric matrix given as xx, yy, zz, yz, xz, xy.
fn largest_eigenvalue([xx, yy, zz, yz, xz, xy]: [f64; 6]) -> f64 {
    let mean = (xx + yy + zz) / 3.0;
    let (x, y, z) = (xx - mean, yy - mean, zz - mean);
    let square = (x * x + y * y + z * z + 2.0 * (yz * yz + xz * xz + xy * xy)) / 6.0;
    if square == 0.0 {
        return mean;
    }
    let radius = square.sqrt();
    let det = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
    let angle = libm::acos((det / (2.0 * radius * square)).clamp(-1.0, 1.0)) / 3.0;
    mean + 2.0 * radius * libm::cos(angle)
}
