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
//! that none has any more leave their [`Pressure`](sinew_engine::load::Pressure) for good. The surface that a cut lays open carries no
//! pressure until it is given one.
//!
//! Removing elements is an action from outside: their elastic energy (and the kinetic energy of the
//! removed mass) leaves the scene, see [`RemovalReport`].
//!
//! [`remove_elements`] acts at once. In a schedule, spawn a [`RemovalRequest`]: it is carried out in
//! [`StepSystems::Edit`](sinew_engine::schedule::StepSystems::Edit), with the others of the same body and [`MassPolicy`] that were made in a row as one
//! batch, and [`RemovalLog`] tells what came of it.

use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::compiled_here;
use sinew_engine::connectivity::{ByKind, Connectivity, ElementKind, Touched};
use sinew_engine::element::{MembraneBlocks, MembraneVertices};
use sinew_engine::isoparametric::{QuadBlocks, QuadVertices};
use sinew_engine::layout::UNUSED;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{ElementTables, Topology};
use std::time::Instant;

use crate::axes;
use crate::body::SoftBody;
use crate::body::matter::Chosen;
use crate::edits::{Edit, before_edit, log_edit};
use crate::laws::pressure;
use rows::Entities;
use state::{Queries, State};

mod clusters;
mod columns;
mod compact;
mod region;
mod report;
mod request;
mod rows;
pub(crate) mod state;
mod sums;
mod verify;

pub use region::Region;
pub use report::{RemovalError, RemovalReport};
pub(crate) use request::install;
pub use request::{RemovalLog, RemovalRequest};
pub use verify::{FreshDifference, compare_with_fresh};

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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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

/// What bodies keep for removals, from [`prepare_removals`] on.
#[derive(Resource, Clone, Debug, Default)]
pub struct Resection {
    bodies: Vec<Option<BodyResection>>,
}

impl Resection {
    /// Connectivity of a body, `None` while nothing was prepared for or removed from it.
    pub fn connectivity(&self, body: usize) -> Option<&Connectivity> {
        Some(&self.bodies.get(body)?.as_ref()?.connectivity)
    }
}

#[derive(Clone, Debug)]
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

/// Kinds of elements in the order in which their energies are added up.
const IN_SUMS: [ElementKind; 4] =
    [ElementKind::Tetrahedron, ElementKind::Hexahedron, ElementKind::Triangle, ElementKind::Quad];

/// Part of a body's rows that may be dead.
const DEAD_SHARE: f64 = 0.25;

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
        resection.bodies[body] = Some(BodyResection {
            connectivity: Connectivity::new(rows),
            element_of: ByKind(ElementKind::ALL.map(|kind| rows.rows_of(kind))),
            rows: Entities::default(),
            dead: ByKind::default(),
            pieces: rows.piece_count(),
        });
        resection.find_rows(world);
    }
    world.insert_resource(resection);
    Ok(())
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

/// Takes up what was kept for removals, with the rows as they stand now.
pub(crate) fn rows_again(world: &mut World, mut resection: Resection) {
    resection.find_rows(world);
    world.insert_resource(resection);
}

/// Removes what several regions hold as one batch: the errors of regions that cannot be used, then the
/// report of the others, if there are any.
pub(crate) fn remove_batch<S: Scalar>(
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
    before_edit::<S>(world);
    let mut resection = world.remove_resource::<Resection>().unwrap_or_default();
    let mut results = resection.remove::<S>(world, body, regions, mass);
    world.insert_resource(resection);
    for report in results.iter_mut().flatten() {
        report.time = start.elapsed();
    }
    results
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
            match own.choose::<S>(world, &soft, region, &chosen) {
                Ok(found) => add(&mut chosen, found),
                Err(error) => results.push(Err(error)),
            }
        }
        if results.len() == regions.len() {
            return results;
        }
        let rows = &world.resource::<Topology>().bodies[body];
        let user = |kind: ElementKind| {
            let order = rows.order(kind);
            chosen[kind].iter().map(|&e| order[e as usize]).collect::<Vec<u32>>()
        };
        let elements = ByKind(ElementKind::ALL.map(user));
        if ElementKind::ALL.iter().any(|&kind| !elements[kind].is_empty()) {
            log_edit(world, Edit::Removal { body, elements, mass });
        }
        let mut report = RemovalReport::default();
        let mut queries = Queries::<S>::new(world);
        let state = State::new(own, world, &soft, &mut queries);
        state.book(&chosen, &mut report);
        let losing = own.losing(&state, world, &chosen);
        own.clear::<S>(world, &chosen);
        let touched = own.connectivity.remove(&chosen);
        report.elastic_energy += own.settle_clusters::<S>(world, &soft, losing);
        own.sum_constants::<S>(world, &soft, &touched, &mut report);
        if mass == MassPolicy::Recompute {
            own.sum_masses::<S>(world, &soft, &touched, &mut report);
        }
        if !touched.unused_triangles.is_empty() || !touched.unused_edges.is_empty() {
            report.pressure_faces = own.drop_pressures(world, body);
        }

        own.update_topology(&mut world.resource_mut::<Topology>(), body, &touched);
        report.fill(own, &world.resource::<Topology>().bodies[body], &chosen, &touched);

        for kind in ElementKind::ALL {
            own.dead[kind] += chosen[kind].len();
        }
        let too_many = ElementKind::ALL.iter().any(|&kind| {
            let dead = own.dead[kind];
            dead as f64 > DEAD_SHARE * (own.connectivity.remaining(kind) + dead) as f64
        });
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
    /// Makes the rows of elements dead.
    fn clear<S: Scalar>(&self, world: &mut World, chosen: &Chosen) {
        let mut columns = columns::Clear::new::<S>();
        let rows = &self.rows.elements;
        for kind in ElementKind::ALL {
            for &e in &chosen[kind] {
                columns.entity(&mut world.entity_mut(rows[kind][e as usize]));
            }
            for axes in chosen[kind].iter().flat_map(|&e| self.rows.axes(kind, e)) {
                let axes = &mut world.entity_mut(axes);
                columns.entity(axes);
                axes::removal::clear(axes);
            }
        }
        // one vertex, and the block that its row owns: the deformed edges are those at rest
        let mut query = world.query::<(&mut MembraneVertices, &mut MembraneBlocks)>();
        for &t in &chosen[ElementKind::Triangle] {
            if let Ok((mut nodes, mut blocks)) =
                query.get_mut(world, rows[ElementKind::Triangle][t as usize])
            {
                (nodes.0, blocks.0) = ([nodes.0[0]; 3], [blocks.0[2]; 3]);
            }
        }
        let mut query = world.query::<(&mut QuadVertices, &mut QuadBlocks)>();
        for &q in &chosen[ElementKind::Quad] {
            if let Ok((mut nodes, mut blocks)) =
                query.get_mut(world, rows[ElementKind::Quad][q as usize])
            {
                (nodes.0, blocks.0) = ([nodes.0[0]; 4], [blocks.0[0]; 6]);
            }
        }
    }

    /// Tells the topology which edges are unused and what hangs together.
    fn update_topology(&mut self, topology: &mut Topology, body: usize, touched: &Touched) {
        let edge_count = topology.edges.len();
        if !touched.unused_edges.is_empty() {
            topology.unused_edges.resize(edge_count, false);
        }
        let v0 = topology.bodies[body].vertices.start;
        for &edge in &touched.unused_edges {
            let [a, b] = self.connectivity.cells.edges[edge as usize].map(|v| v + v0);
            if let Some(block) = topology.block(a, b) {
                topology.unused_edges[block as usize] = true;
            }
        }
        let rows = &mut topology.bodies[body];
        rows.changes += 1;
        for &v in &touched.orphans {
            rows.piece[v as usize] = UNUSED;
        }
        if touched.may_split {
            let pieces = self.connectivity.pieces();
            if pieces != rows.piece {
                rows.piece = pieces;
                rows.splits += 1;
            }
            self.pieces = rows.piece_count();
        }
    }
}
