//! The removal itself.

use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::compiled_here;
use sinew_engine::connectivity::{ByKind, Connectivity, ElementKind, Touched};
use sinew_engine::element::{MembraneBlocks, MembraneVertices};
use sinew_engine::isoparametric::{QuadBlocks, QuadVertices};
use sinew_engine::layout::UNUSED;
use sinew_engine::resource::{ensure, put, take};
use sinew_engine::scalar::Scalar;
use sinew_engine::stopwatch::Stopwatch;
use sinew_engine::topology::{ElementTables, Topology};

use super::region::Region;
use super::report::{RemovalError, RemovalReport};
use super::state::{Queries, State};
use super::{columns, compact};
use crate::axes;
use crate::body::description::SoftBody;
use crate::body::edit_log::{Edit, before_edit, log_edit};
use crate::body::matter::Chosen;
use crate::body::present::{BodyResection, Entities, MassPolicy, Resection};
use crate::cutting::glue;
use crate::frame::row::LawTable;
use crate::laws::{bending, pressure};

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
    let mut resection = take::<Resection>(world);
    resection.bodies.resize_with(count, || None);
    if resection.bodies[body].is_none() {
        let rows = &world.resource::<Topology>().bodies[body];
        resection.bodies[body] = Some(BodyResection {
            connectivity: Connectivity::new(rows),
            element_of: ByKind::of(|kind| rows.rows_of(kind)),
            rows: Entities::default(),
            dead: ByKind::default(),
            pieces: rows.piece_count(),
            material: None,
        });
        resection.find_rows(world);
    }
    put(world, resection);
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

/// Removes what several regions hold as one batch: the errors of regions that cannot be used, then the
/// report of the others, if there are any.
pub(crate) fn remove_batch<S: Scalar>(
    world: &mut World,
    body: usize,
    regions: &[Region],
    mass: MassPolicy,
) -> Vec<Result<RemovalReport, RemovalError>> {
    let start = Stopwatch::start();
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
    let mut resection = take::<Resection>(world);
    let mut results = resection.remove::<S>(world, body, regions, mass);
    put(world, resection);
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
                Ok(found) => add(&mut chosen, &found),
                Err(error) => results.push(Err(error)),
            }
        }
        if results.len() == regions.len() {
            return results;
        }
        let rows = &world.resource::<Topology>().bodies[body];
        let user = |kind: ElementKind| {
            let order = &rows.order[kind];
            chosen[kind].iter().map(|&e| order[e as usize]).collect::<Vec<u32>>()
        };
        let elements = ByKind::of(user);
        if ElementKind::ALL.iter().any(|&kind| !elements[kind].is_empty()) {
            log_edit(world, Edit::Removal { body, elements, mass });
        }
        let mut report = RemovalReport::default();
        let (bent, glued) = (bending::energy::<S>(world, body), glue::energy::<S>(world, body));
        let mut queries = Queries::<S>::new(world);
        let state = State::new(own, world, &soft, &mut queries);
        state.book(&chosen, &mut report);
        let losing = own.losing(&state, world, &chosen[ElementKind::Tetrahedron]);
        own.clear::<S>(world, &chosen);
        let touched = own.connectivity.remove(&chosen);
        report.elastic_energy += own.settle_clusters::<S>(world, &soft, losing);
        own.sum_constants::<S>(world, &soft, &touched, &mut report);
        if mass == MassPolicy::Recompute {
            own.sum_masses::<S>(world, &soft, &touched, &mut report);
        }
        if !own.connectivity.ordered.tetrahedra10().is_empty() {
            own.sum_weight_shifts::<S>(world, &soft, &touched);
        }
        if !touched.unused_triangles.is_empty() || !touched.unused_edges.is_empty() {
            report.pressure_faces = own.drop_faces(world, body);
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
        if !chosen[ElementKind::Triangle].is_empty() {
            bending::refresh::<S>(world, Some(self));
            report.elastic_energy += bent - bending::energy::<S>(world, body);
        }
        if too_many && compact::compact::<S>(world, self) {
            report.compacted = true;
        }
        let is_cut = self.bodies[body].as_ref().is_some_and(|own| own.material.is_some());
        if report.compacted || report.pressure_faces > 0 || is_cut {
            pressure::refresh::<S>(world, Some(self));
        }
        if is_cut {
            glue::refresh::<S>(world, Some(self));
            report.elastic_energy += glued - glue::energy::<S>(world, body);
        }
        results.push(Ok(report));
        results
    }
}

/// Adds to `chosen` what is not in it.
fn add(chosen: &mut Chosen, other: &Chosen) {
    for kind in ElementKind::ALL {
        let own = &mut chosen[kind];
        own.extend(&other[kind]);
        own.sort_unstable();
        own.dedup();
    }
}

impl BodyResection {
    /// Makes the rows of elements dead.
    fn clear<S: Scalar>(&self, world: &mut World, chosen: &Chosen) {
        let mut columns = columns::Clear::new::<S>();
        let table = ensure::<LawTable>(world);
        let of_others: Vec<_> = table.rows().iter().filter_map(|row| row.removal).collect();
        let rows = &self.rows.elements;
        for kind in ElementKind::ALL {
            for &e in &chosen[kind] {
                let element = &mut world.entity_mut(rows[kind][e as usize]);
                columns.entity(element);
                of_others.iter().for_each(|clear| clear(element));
            }
            for axes in chosen[kind].iter().flat_map(|&e| self.rows.axes(kind, e)) {
                let axes = &mut world.entity_mut(axes);
                columns.entity(axes);
                axes::removal::clear(axes);
                of_others.iter().for_each(|clear| clear(axes));
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
            rows.set_pieces(self.connectivity.pieces());
            self.pieces = rows.piece_count();
        }
    }
}
