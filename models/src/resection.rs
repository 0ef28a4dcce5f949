//! Resection: tetrahedra are removed while the scene runs.
//!
//! A removed tetrahedron keeps its table row for the time being, with moduli, volume and shape
//! vectors 0: every law then gives exact zeros for it, and `J = 1`. Pooled constants of the edges and
//! triangles round it are summed again over the tetrahedra that are left, never subtracted, so they do
//! not drift. A batch costs in proportion to the elements it touches, but for choosing elements by a
//! region or by their state, which looks at every one. Once more than a quarter of a body's
//! rows are dead, tables and edge graph are compacted in place, in their order.
//!
//! Vertices keep their rows, so constraints and loads stay valid. One that has lost its last element
//! flies freely if it has mass left, and stays where it is if not ([`MassPolicy`]).
//!
//! Removing elements is an action from outside: their elastic energy (and the kinetic energy of the
//! removed mass) leaves the scene, see [`RemovalReport`].
//!
//! [`remove_tetrahedra`] acts at once. In a schedule, spawn a [`RemovalRequest`]: it is carried out in
//! [`StepSystems::Edit`], and [`RemovalLog`] tells what came of it.

use bevy_ecs::prelude::*;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use sinew_engine::columns::single_table;
use sinew_engine::connectivity::{Connectivity, Touched};
use sinew_engine::element::{
    EdgeVertices, RestVolume, ShapeGradient, ShapeGradients, TetrahedronIndex,
    displacement_gradient, volume_change,
};
use sinew_engine::layout::UNUSED;
use sinew_engine::scalar::{Scalar, sub};
use sinew_engine::schedule::{StepSchedule, StepSystems};
use sinew_engine::topology::{ElementTables, Topology};
use sinew_engine::vertex::{BodyId, Displacement, Mass, RestPosition, Velocity};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::body::{Evaluation, Model, SoftBody, angular_place};
use crate::corotational::{Corotational, WarpedStiffness};
use crate::fused::{CompressionModulus, FirstLameParameter, ShearModulus, TetrahedronLaw};
use crate::linear::Linear;
use crate::material::LameParameters;
use crate::neo_hookean::NeoHookean;
use crate::pooled::{AngularStiffness, TensileStiffness, TriangleVertices, VolumetricStiffness};
use crate::precompute::{ADJACENT_PAIRS, EDGES, RestTetrahedron, SpringConstants};
use crate::quadratic::{self, Stretch};
use crate::spring::tensile_energy;
use crate::stvk_fem::StVKFem;
use crate::tetrahedron::{self, Element, green_strain, second_piola_kirchhoff};

mod compact;
mod verify;

pub use verify::{FreshDifference, compare_with_fresh};

/// Which tetrahedra of a body to remove. Positions are those at the present state.
#[derive(Clone, Debug, PartialEq)]
pub enum Region {
    /// By their indices in the user's mesh.
    Tetrahedra(Vec<u32>),
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
    /// Those whose largest principal Green strain is above a limit.
    Strain {
        /// The limit (-).
        above: f64,
    },
    /// Those whose von Mises equivalent of the Cauchy stress is above a limit. The stress is that of
    /// St Venant-Kirchhoff with the moduli of the element, whatever the model; the compression term is
    /// a pressure and plays no part.
    Stress {
        /// The limit (Pa).
        above: f64,
    },
}

/// What becomes of the mass of the vertices of removed tetrahedra.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MassPolicy {
    /// Their masses are summed again over the tetrahedra that are left: removed matter is gone
    /// (default). A vertex without element has no mass then and stays where it is.
    #[default]
    Recompute,
    /// Vertices keep their masses; one without element flies freely.
    Keep,
}

/// What to remove.
#[derive(Clone, Debug, PartialEq)]
pub struct Removal {
    /// Which tetrahedra.
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
    /// Tetrahedra left in the body.
    pub remaining: usize,
    /// Mesh edges that no tetrahedron uses any more.
    pub edges: usize,
    /// Mesh triangles that no tetrahedron uses any more.
    pub triangles: usize,
    /// Vertices that lost their last tetrahedron, by their indices in the user's mesh, ascending.
    pub orphans: Vec<u32>,
    /// Connected pieces of the body now; vertices without tetrahedra are none.
    pub pieces: usize,
    /// Volume removed (m^3, at rest).
    pub volume: f64,
    /// Mass removed (kg); 0 when masses are kept.
    pub mass: f64,
    /// Elastic energy (J) that left with the tetrahedra.
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
    /// There is no such tetrahedron.
    #[error("body `{body}` has no tetrahedron {tetrahedron}: indices must be below {count}")]
    Tetrahedron {
        /// Name of the body.
        body: String,
        /// Index asked for.
        tetrahedron: u32,
        /// Number of tetrahedra in the user's mesh.
        count: usize,
    },
    /// It is gone already, or named twice.
    #[error(
        "tetrahedron {tetrahedron} of body `{body}` was removed before or is named twice; ask which \
         ones are left"
    )]
    Removed {
        /// Name of the body.
        body: String,
        /// Index asked for.
        tetrahedron: u32,
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

/// What came of the [`RemovalRequest`]s of the last step, with the index of the body. A request that
/// fails changes nothing and does not stop the step.
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
    /// Index in the user's mesh -> tetrahedron.
    tetrahedron_of: Vec<u32>,
    /// Entities in whose rows the tetrahedra, edges and triangles stand; a placeholder for those that
    /// have no row.
    rows: Entities,
    /// Removed tetrahedra that still have a row.
    dead: usize,
}

#[derive(Debug, Default)]
struct Entities {
    tetrahedra: Vec<Entity>,
    edges: Vec<Entity>,
    triangles: Vec<Entity>,
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
    for (entity, RemovalRequest { body, removal, .. }) in requests {
        world.despawn(entity);
        let result = remove_tetrahedra::<S>(world, body, &removal);
        world.resource_mut::<RemovalLog>().0.push((body, result));
    }
}

/// Finds out what [`remove_tetrahedra`] needs to know about a body, which it otherwise does at first
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
        let mut tetrahedron_of = vec![0; rows.tetrahedra.len()];
        for (t, &index) in rows.tetrahedron_order.iter().enumerate() {
            tetrahedron_of[index as usize] = t as u32;
        }
        resection.bodies[body] = Some(BodyResection {
            connectivity: Connectivity::new(rows),
            tetrahedron_of,
            rows: Entities::default(),
            dead: 0,
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
            own.rows.tetrahedra.clear();
            own.rows.tetrahedra.resize(own.tetrahedron_of.len(), Entity::PLACEHOLDER);
            own.rows.edges.clear();
            own.rows.edges.resize(cells.edges.len(), Entity::PLACEHOLDER);
            own.rows.triangles.clear();
            own.rows.triangles.resize(cells.triangles.len(), Entity::PLACEHOLDER);
        }
        for (entity, index, body) in
            world.query::<(Entity, &TetrahedronIndex, &BodyId)>().iter(world)
        {
            if let Some(own) = &mut self.bodies[body.0 as usize] {
                own.rows.tetrahedra[own.tetrahedron_of[index.0 as usize] as usize] = entity;
            }
        }
        for (entity, edge, body) in world.query::<(Entity, &EdgeVertices, &BodyId)>().iter(world) {
            if let Some(own) = &mut self.bodies[body.0 as usize] {
                let local = edge.0.map(|v| v - first[body.0 as usize]);
                if let Ok(at) = own.connectivity.cells.edges.binary_search(&local) {
                    own.rows.edges[at] = entity;
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

/// Removes tetrahedra of a body, between steps.
///
/// The work is done on the calling thread in a fixed order.
///
/// # Errors
/// When the region cannot be used, or names a tetrahedron that does not exist, is gone already or
/// comes twice; nothing is changed then. A region that holds no tetrahedra is no error.
pub fn remove_tetrahedra<S: Scalar>(
    world: &mut World,
    body: usize,
    removal: &Removal,
) -> Result<RemovalReport, RemovalError> {
    let start = Instant::now();
    check_region(&removal.region)?;
    prepare_removals(world, body)?;
    if let Some(spawned) = world.get_resource::<ElementTables>()
        && *spawned != ElementTables::of(world)
    {
        let body = world.resource::<Topology>().bodies[body].name.clone();
        return Err(RemovalError::LayoutChanged { body });
    }
    let mut resection = world.remove_resource::<Resection>().unwrap_or_default();
    let result = resection.remove::<S>(world, body, removal);
    world.insert_resource(resection);
    result.map(|report| RemovalReport { time: start.elapsed(), ..report })
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
        Region::Tetrahedra(_) => Ok(()),
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

/// Rest positions and displacements (m) of the vertices of one body.
struct Vertices {
    rest: Vec<DVec3>,
    displacement: Vec<DVec3>,
}

impl Vertices {
    fn read<S: Scalar>(world: &mut World, body: usize) -> Self {
        let rows = world.resource::<Topology>().bodies[body].vertices.clone();
        let rows = rows.start as usize..rows.end as usize;
        let mut query = world.query::<(&RestPosition, &Displacement<S>)>();
        let Some((rest, displacement)) = single_table(query.contiguous_iter(world)) else {
            return Self { rest: Vec::new(), displacement: Vec::new() };
        };
        let vector =
            |u: &Displacement<S>| DVec3::new(u.0[0].to_f64(), u.0[1].to_f64(), u.0[2].to_f64());
        Self {
            rest: rest[rows.clone()].iter().map(|x| x.0).collect(),
            displacement: displacement[rows].iter().map(vector).collect(),
        }
    }

    fn position(&self, vertex: u32) -> DVec3 {
        self.rest[vertex as usize] + self.displacement[vertex as usize]
    }

    fn displacements(&self, tetrahedron: [u32; 4]) -> [[f64; 3]; 4] {
        tetrahedron.map(|v| self.displacement[v as usize].to_array())
    }

    /// Rest shape; it was found usable when the body was built.
    fn rest_shape(&self, tetrahedron: [u32; 4]) -> RestTetrahedron {
        RestTetrahedron::new(tetrahedron.map(|v| self.rest[v as usize].to_array()))
            .expect("the body was built with it")
    }
}

impl Resection {
    fn remove<S: Scalar>(
        &mut self,
        world: &mut World,
        body: usize,
        removal: &Removal,
    ) -> Result<RemovalReport, RemovalError> {
        let Some(own) = &mut self.bodies[body] else { return Ok(RemovalReport::default()) };
        let Some(soft) = world.query::<&SoftBody>().iter(world).find(|b| b.index == body).cloned()
        else {
            return Ok(RemovalReport::default());
        };
        let vertices = Vertices::read::<S>(world, body);
        let chosen = own.choose::<S>(world, body, &removal.region, &vertices)?;
        let mut report = RemovalReport::default();
        for (&t, element) in chosen.iter().zip(own.elements::<S>(world, &chosen)) {
            let nodes = own.connectivity.tetrahedra[t as usize];
            report.elastic_energy += energy(soft.model, &element, nodes, &vertices);
            report.volume += element.volume;
        }
        own.clear::<S>(world, &chosen);
        let touched = own.connectivity.remove(&chosen);
        own.sum_constants::<S>(world, &soft, &touched, &vertices);
        if removal.mass == MassPolicy::Recompute {
            let density = soft.material.density;
            own.sum_masses::<S>(world, body, density, &touched, &vertices, &mut report);
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
        }
        report.pieces = of_body.piece_count();
        let index = |v: &u32| of_body.vertex_order[*v as usize];
        report.orphans = touched.orphans.iter().map(index).collect();
        report.orphans.sort_unstable();
        let index = |t: &u32| of_body.tetrahedron_order[*t as usize];
        report.tetrahedra = chosen.iter().map(index).collect();
        report.tetrahedra.sort_unstable();
        report.remaining = own.connectivity.remaining();
        report.edges = touched.unused_edges.len();
        report.triangles = touched.unused_triangles;

        own.dead += chosen.len();
        let rows = own.connectivity.remaining() + own.dead;
        if own.dead as f64 > DEAD_SHARE * rows as f64 && compact::compact::<S>(world, self) {
            report.compacted = true;
        }
        Ok(report)
    }
}

impl BodyResection {
    /// Tetrahedra of a region that are left, ascending.
    fn choose<S: Scalar>(
        &self,
        world: &mut World,
        body: usize,
        region: &Region,
        vertices: &Vertices,
    ) -> Result<Vec<u32>, RemovalError> {
        let all = 0..self.tetrahedron_of.len() as u32;
        let left = all.filter(|&t| self.connectivity.is_present(t));
        let nodes = |t: u32| self.connectivity.tetrahedra[t as usize];
        let barycentre =
            |t: u32| nodes(t).iter().map(|&v| vertices.position(v)).sum::<DVec3>() / 4.0;
        let exceed = |world: &mut World, limit: f64, measure: fn(&Element<f64>, &_) -> f64| {
            let left: Vec<u32> = left.clone().collect();
            let elements = self.elements::<S>(world, &left);
            let above = left.iter().zip(&elements).filter(|&(&t, element)| {
                measure(element, &vertices.displacements(nodes(t))) > limit
            });
            above.map(|(&t, _)| t).collect()
        };
        Ok(match region {
            Region::Tetrahedra(list) => {
                let name = |world: &World| world.resource::<Topology>().bodies[body].name.clone();
                let mut chosen = Vec::with_capacity(list.len());
                for &tetrahedron in list {
                    let count = self.tetrahedron_of.len();
                    let Some(&t) = self.tetrahedron_of.get(tetrahedron as usize) else {
                        let body = name(world);
                        return Err(RemovalError::Tetrahedron { body, tetrahedron, count });
                    };
                    chosen.push((t, tetrahedron));
                }
                chosen.sort_unstable();
                let twice = chosen.windows(2).find(|w| w[0] == w[1]).map(|w| w[0].1);
                let gone = chosen.iter().find(|(t, _)| !self.connectivity.is_present(*t));
                if let Some(tetrahedron) = twice.or(gone.map(|g| g.1)) {
                    return Err(RemovalError::Removed { body: name(world), tetrahedron });
                }
                chosen.into_iter().map(|(t, _)| t).collect()
            }
            Region::Sphere { centre, radius } => {
                left.filter(|&t| barycentre(t).distance(*centre) <= *radius).collect()
            }
            Region::Capsule { from, to, radius } => {
                let axis = *to - *from;
                let square = axis.length_squared();
                let distance = |x: DVec3| {
                    let along = if square > 0.0 {
                        ((x - *from).dot(axis) / square).clamp(0.0, 1.0)
                    } else {
                        0.0
                    };
                    x.distance(*from + axis * along)
                };
                left.filter(|&t| distance(barycentre(t)) <= *radius).collect()
            }
            Region::Strain { above } => exceed(world, *above, largest_strain),
            Region::Stress { above } => exceed(world, *above, von_mises_stress),
        })
    }

    /// Columns of tetrahedra that have a row.
    fn elements<S: Scalar>(&self, world: &mut World, of: &[u32]) -> Vec<Element<f64>> {
        let mut query = world.query::<StiffRead<S>>();
        of.iter()
            .map(|&t| {
                let columns = query.get(world, self.rows.tetrahedra[t as usize]);
                element!(columns.expect("a tetrahedron that is left has a row"))
            })
            .collect()
    }

    /// Sets the columns of tetrahedra to zero.
    fn clear<S: Scalar>(&self, world: &mut World, removed: &[u32]) {
        let mut query = world.query::<Stiff<S>>();
        for &t in removed {
            let columns = query.get_mut(world, self.rows.tetrahedra[t as usize]);
            let (mut d1, mut d2, mut d3, mut volume, mut lambda, mut mu, mut compression) =
                columns.expect("a tetrahedron that is left has a row");
            (d1.0.0, d1.1.0, d1.2.0) = (S::ZERO, S::ZERO, S::ZERO);
            (d2.0.0, d2.1.0, d2.2.0) = (S::ZERO, S::ZERO, S::ZERO);
            (d3.0.0, d3.1.0, d3.2.0) = (S::ZERO, S::ZERO, S::ZERO);
            (volume.0, lambda.0, mu.0, compression.0) = (S::ZERO, S::ZERO, S::ZERO, S::ZERO);
        }
        let mut query = world.query::<(
            &mut VolumetricStiffness<S, 0>,
            &mut VolumetricStiffness<S, 1>,
            &mut VolumetricStiffness<S, 2>,
        )>();
        for &t in removed {
            let entity = self.rows.tetrahedra[t as usize];
            // only pooled bodies have these
            if let Ok((mut a, mut b, mut c)) = query.get_mut(world, entity) {
                (a.0, b.0, c.0) = (S::ZERO, S::ZERO, S::ZERO);
            }
        }
    }

    /// Sums the constants of the touched edges and triangles again.
    fn sum_constants<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        touched: &Touched,
        vertices: &Vertices,
    ) {
        let pooled = soft.evaluation == Evaluation::Pooled;
        if !pooled && soft.model != Model::MassSpring {
            return;
        }
        let Connectivity { tetrahedra, cells, round_edge, round_triangle, .. } = &self.connectivity;
        let edges = touched.edges.iter().flat_map(|&e| round_edge.of(e));
        // whoever shares a triangle with a removed tetrahedron shares its edges
        let mut round: Vec<u32> =
            edges.copied().filter(|&t| self.connectivity.is_present(t)).collect();
        round.sort_unstable();
        round.dedup();
        let elements = self.elements::<S>(world, &round);
        let constants: Vec<SpringConstants> = round
            .iter()
            .zip(&elements)
            .map(|(&t, element)| {
                SpringConstants::new(&vertices.rest_shape(tetrahedra[t as usize]), lame(element))
            })
            .collect();
        let constants = |t: u32| {
            let at = round.binary_search(&t).expect("it is one of those around");
            (&constants[at], tetrahedra[t as usize])
        };

        let mut query = world.query::<&mut TensileStiffness<S>>();
        for &edge in &touched.edges {
            let mut sum = 0.0;
            for t in self.connectivity.left(round_edge.of(edge)) {
                let own = &cells.tetrahedron_edges[t as usize];
                let local = own.iter().position(|&e| e == edge).unwrap_or(0);
                sum += constants(t).0.tensile[local];
            }
            if let Ok(mut stiffness) = query.get_mut(world, self.rows.edges[edge as usize]) {
                stiffness.0 = S::from_f64(sum);
            }
        }
        if !pooled {
            return;
        }
        let mut query = world.query::<(
            &mut AngularStiffness<S, 0>,
            &mut AngularStiffness<S, 1>,
            &mut AngularStiffness<S, 2>,
        )>();
        for &triangle in &touched.triangles {
            let mut sum = [0.0; 3];
            for t in self.connectivity.left(round_triangle.of(triangle)) {
                let (constants, nodes) = constants(t);
                for (c, pair) in constants.angular.iter().zip(ADJACENT_PAIRS) {
                    let (face, apex) = angular_place(pair);
                    if cells.tetrahedron_triangles[t as usize][face] == triangle {
                        let own = cells.triangles[triangle as usize];
                        let m = own.iter().position(|&v| v == nodes[apex]).unwrap_or(0);
                        sum[m] += c;
                    }
                }
            }
            let columns = query.get_mut(world, self.rows.triangles[triangle as usize]);
            if let Ok((mut a, mut b, mut c)) = columns {
                (a.0, b.0, c.0) = (S::from_f64(sum[0]), S::from_f64(sum[1]), S::from_f64(sum[2]));
            }
        }
    }

    /// Sums the masses of the touched vertices again, and books what went.
    fn sum_masses<S: Scalar>(
        &self,
        world: &mut World,
        body: usize,
        density: f64,
        touched: &Touched,
        vertices: &Vertices,
        report: &mut RemovalReport,
    ) {
        let v0 = world.resource::<Topology>().bodies[body].vertices.start;
        let mut query = world.query::<(&mut Mass<S>, &mut Velocity<S>)>();
        let Some((mut mass, mut velocity)) = single_table(query.contiguous_iter_mut(world)) else {
            return;
        };
        let (mass, velocity) = (mass.bypass_change_detection(), velocity.bypass_change_detection());
        for &v in &touched.vertices {
            let mut sum = 0.0;
            for t in self.connectivity.left(self.connectivity.round_vertex.of(v)) {
                let nodes = self.connectivity.tetrahedra[t as usize];
                sum += density * vertices.rest_shape(nodes).volume / 4.0;
            }
            let row = (v + v0) as usize;
            let before = mass[row].0.to_f64();
            mass[row].0 = S::from_f64(sum);
            let gone = before - mass[row].0.to_f64();
            let speed = (0..3).map(|k| velocity[row].0[k].to_f64().powi(2)).sum::<f64>();
            report.mass += gone;
            report.kinetic_energy += 0.5 * gone * speed;
            if !self.connectivity.uses_vertex(v) {
                velocity[row] = Velocity::default();
            }
        }
    }
}

fn lame(element: &Element<f64>) -> LameParameters {
    LameParameters { lambda: element.lambda, mu: element.mu }
}

/// Energy (J) of a tetrahedron by its own.
fn energy(model: Model, element: &Element<f64>, nodes: [u32; 4], vertices: &Vertices) -> f64 {
    let u = vertices.displacements(nodes);
    match model {
        Model::StVK | Model::CompressibleStVK => tetrahedron::energy(element, &u),
        Model::QuadraticSprings => quadratic::tetrahedron::energy(element, &u),
        Model::Linear => Linear::energy(element, &u),
        Model::WarpedStiffness => WarpedStiffness::energy(element, &u),
        Model::Corotational => Corotational::energy(element, &u),
        Model::StVKFem => StVKFem::energy(element, &u),
        Model::NeoHookean => NeoHookean::energy(element, &u),
        Model::MassSpring => {
            let constants = SpringConstants::new(&vertices.rest_shape(nodes), lame(element));
            let change = |[a, b]: [usize; 2]| {
                let rest = vertices.rest[nodes[a] as usize] - vertices.rest[nodes[b] as usize];
                Stretch::new(rest.to_array(), sub(u[a], u[b])).change
            };
            let edges = constants.tensile.iter().zip(EDGES);
            edges.map(|(&k, edge)| tensile_energy(k, change(edge))).sum()
        }
    }
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
    let angle = (det / (2.0 * radius * square)).clamp(-1.0, 1.0).acos() / 3.0;
    mean + 2.0 * radius * angle.cos()
}
