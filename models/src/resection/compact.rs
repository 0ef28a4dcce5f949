//! Compaction of tables and edge graph.
//!
//! Rows that are left move down in their order, column by column, and the entities at the end of the
//! table are despawned, so that entities, tables and their order stay as a freshly spawned body would
//! have them. Vertex rows do not change.

use super::Resection;
use bevy_ecs::prelude::*;
use sinew_engine::columns::{can_move_rows, move_rows_to_front};
use sinew_engine::connectivity::{ByKind, ElementKind};
use sinew_engine::element::{
    AxisBlocks, AxisTetrahedron, EdgeBlock, EdgeTension, EdgeVertices, MembraneBlocks,
    MembraneIndex, TetrahedronBlocks, TetrahedronEdges, TetrahedronIndex, TriangleEdges,
};
use sinew_engine::isoparametric::{
    AxisHexahedron, AxisHexahedronBlocks, HexahedronBlocks, HexahedronIndex, QuadBlocks, QuadIndex,
};
use sinew_engine::law::partition_laws;
use sinew_engine::layout::{UNUSED, starts};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{ElementTables, Topology};
use sinew_engine::vertex::BodyId;

use crate::laws::pooled::TriangleVertices;

/// Rows of one table of elements.
struct Table {
    entities: Vec<Entity>,
    keep: Vec<bool>,
}

/// Removes the rows of removed elements from all tables, and the edges that no element uses from the
/// edge graph. Does nothing, and says so, when an element has a component whose values cannot be moved as
/// plain bytes, because they own something.
pub(super) fn compact<S: Scalar>(world: &mut World, resection: &mut Resection) -> bool {
    let tables = find_tables(world, resection);
    if !tables.iter().all(|table| can_move_rows(world, table.entities[0])) {
        return false;
    }
    let mut row_of_edge = Vec::new();
    for Table { entities, keep } in tables {
        let rows: Vec<usize> = (0..keep.len()).filter(|&row| keep[row]).collect();
        if world.entity(entities[0]).contains::<EdgeTension<S>>() {
            row_of_edge = new_places(&keep);
        }
        if rows.len() == keep.len() {
            continue;
        }
        move_rows_to_front(world, entities[0], &rows);
        // from the end, so that no row takes the place of another
        for &entity in entities[rows.len()..].iter().rev() {
            world.despawn(entity);
        }
    }

    let mut topology = world.resource_mut::<Topology>();
    let keep: Vec<bool> = (0..topology.edges.len()).map(|edge| topology.uses_edge(edge)).collect();
    let block = new_places(&keep);
    let before = |edge: u32| keep[..edge as usize].iter().filter(|k| **k).count() as u32;
    for body in 0..topology.bodies.len() {
        let blocks = topology.bodies[body].blocks.clone();
        topology.bodies[body].blocks = before(blocks.start)..before(blocks.end);
    }
    let mut kept = keep.iter();
    topology.edges.retain(|_| kept.next() == Some(&true));
    topology.edge_start = starts(topology.vertex_count(), topology.edges.iter().map(|e| e[0]));
    topology.unused_edges.clear();
    topology.revision += 1;

    for mut blocks in world.query::<&mut TetrahedronBlocks>().iter_mut(world) {
        blocks.0 = blocks.0.map(|b| block[b as usize]);
    }
    for mut blocks in world.query::<&mut MembraneBlocks>().iter_mut(world) {
        blocks.0 = blocks.0.map(|b| block[b as usize]);
    }
    for mut blocks in world.query::<&mut HexahedronBlocks>().iter_mut(world) {
        blocks.0 = blocks.0.map(|b| block[b as usize]);
    }
    for mut blocks in world.query::<&mut AxisHexahedronBlocks>().iter_mut(world) {
        blocks.0 = blocks.0.map(|b| block[b as usize]);
    }
    for mut blocks in world.query::<&mut QuadBlocks>().iter_mut(world) {
        blocks.0 = blocks.0.map(|b| block[b as usize]);
    }
    for mut blocks in world.query::<&mut AxisBlocks>().iter_mut(world) {
        blocks.0 = blocks.0.map(|b| block[b as usize]);
    }
    for mut own in world.query::<&mut EdgeBlock>().iter_mut(world) {
        own.0 = block[own.0 as usize];
    }
    for mut edges in world.query::<&mut TetrahedronEdges>().iter_mut(world) {
        edges.0 = edges.0.map(|e| row_of_edge[e as usize]);
    }
    for mut edges in world.query::<&mut TriangleEdges>().iter_mut(world) {
        edges.0 = edges.0.map(|e| row_of_edge[e as usize]);
    }
    partition_laws::<S>(world);
    let tables = ElementTables::of(world);
    world.insert_resource(tables);
    resection.bodies.iter_mut().flatten().for_each(|own| own.dead = ByKind::default());
    resection.find_rows(world);
    true
}

/// Where those kept go.
fn new_places(keep: &[bool]) -> Vec<u32> {
    let mut next = 0;
    let mut place = |&keep: &bool| {
        next += u32::from(keep);
        if keep { next - 1 } else { UNUSED }
    };
    keep.iter().map(&mut place).collect()
}

/// Tables of elements, each with the rows to keep.
fn find_tables(world: &mut World, resection: &Resection) -> Vec<Table> {
    let topology = world.resource::<Topology>();
    let first: Vec<u32> = topology.bodies.iter().map(|b| b.vertices.start).collect();
    let bodies = |id: &BodyId| resection.bodies.get(id.0 as usize).and_then(Option::as_ref);
    let mut tables = Vec::new();
    macro_rules! elements {
        ($index:ty, $kind:expr) => {
            let mut query = world.query::<(Entity, &$index, &BodyId)>();
            for (entities, index, id) in query.contiguous_iter(world).expect("stored in tables") {
                let keep = index.iter().zip(id).map(|(index, id)| {
                    bodies(id).is_none_or(|own| {
                        let element = own.element_of[$kind][index.0 as usize];
                        own.connectivity.is_present($kind, element)
                    })
                });
                tables.push(Table { entities: entities.to_vec(), keep: keep.collect() });
            }
        };
    }
    elements!(TetrahedronIndex, ElementKind::Tetrahedron);
    elements!(MembraneIndex, ElementKind::Triangle);
    elements!(HexahedronIndex, ElementKind::Hexahedron);
    elements!(QuadIndex, ElementKind::Quad);
    let mut query = world.query::<(Entity, &EdgeVertices, &BodyId)>();
    for (entities, edges, id) in query.contiguous_iter(world).expect("stored in tables") {
        let keep = edges.iter().zip(id).map(|(edge, id)| {
            let local = edge.0.map(|v| v - first[id.0 as usize]);
            bodies(id).is_none_or(|own| {
                let found = own.connectivity.cells.edges.binary_search(&local);
                found.is_ok_and(|edge| own.connectivity.uses_edge(edge as u32))
            })
        });
        tables.push(Table { entities: entities.to_vec(), keep: keep.collect() });
    }
    let mut query = world.query::<(Entity, &TriangleVertices, &BodyId)>();
    for (entities, triangles, id) in query.contiguous_iter(world).expect("stored in tables") {
        let keep = triangles.iter().zip(id).map(|(triangle, id)| {
            let local = triangle.0.map(|v| v - first[id.0 as usize]);
            bodies(id).is_none_or(|own| {
                let found = own.connectivity.cells.triangles.binary_search(&local);
                found.is_ok_and(|triangle| own.connectivity.uses_triangle(triangle as u32))
            })
        });
        tables.push(Table { entities: entities.to_vec(), keep: keep.collect() });
    }
    elements!(AxisTetrahedron, ElementKind::Tetrahedron);
    elements!(AxisHexahedron, ElementKind::Hexahedron);
    tables.retain(|table| !table.entities.is_empty());
    tables
}
