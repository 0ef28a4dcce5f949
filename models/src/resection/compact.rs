//! Compaction of tables and edge graph.
//!
//! Rows that are left move down in their order, column by column, and the entities at the end of the
//! table are despawned, so that ranges stay short as in a freshly spawned body. Vertex rows do not change.

use bevy_ecs::prelude::*;
use sinew_engine::columns::{can_move_rows, move_rows_to_front};
use sinew_engine::connectivity::{ByKind, ElementKind};
use sinew_engine::element::{
    AxisBlocks, AxisTetrahedron, AxisTriangle, EdgeBlock, EdgeTension, EdgeVertices,
    MembraneBlocks, MembraneIndex, TetrahedronBlocks, TetrahedronEdges, TetrahedronIndex,
    TriangleEdges,
};
use sinew_engine::isoparametric::{
    AxisHexahedron, AxisHexahedronBlocks, AxisTetrahedron10Blocks, HexahedronBlocks,
    HexahedronIndex, QuadBlocks, QuadIndex, Tetrahedron10Blocks,
};
use sinew_engine::law::partition_laws;
use sinew_engine::layout::{UNUSED, starts};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{ElementTables, Topology};
use sinew_engine::vertex::BodyId;

use crate::body::present::Resection;
use crate::cutting::glue;
use crate::laws::bending;
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

    let mut coupled = bending::used_blocks::<S>(world);
    glue::mark_edges(world.resource::<Topology>(), resection, &mut coupled);
    let mut topology = world.resource_mut::<Topology>();
    let used: Vec<bool> = (0..topology.edges.len()).map(|edge| topology.uses_edge(edge)).collect();
    let keep: Vec<bool> =
        used.iter().zip(coupled).map(|(&used, coupled)| used || coupled).collect();
    let block = new_places(&keep);
    let before = |edge: u32| keep[..edge as usize].iter().filter(|k| **k).count() as u32;
    for body in 0..topology.bodies.len() {
        let blocks = topology.bodies[body].blocks.clone();
        topology.bodies[body].blocks = before(blocks.start)..before(blocks.end);
    }
    let mut kept = keep.iter();
    topology.edges.retain(|_| kept.next() == Some(&true));
    topology.edge_start = starts(topology.vertex_count(), topology.edges.iter().map(|e| e[0]));
    let kept_uses = used.iter().zip(&keep).filter(|(_, keep)| **keep);
    let unused: Vec<bool> = kept_uses.map(|(used, _)| !used).collect();
    topology.unused_edges = if unused.contains(&true) { unused } else { Vec::new() };
    topology.revision += 1;

    renumber_blocks(world, &block);
    for mut own in world.query::<&mut TetrahedronEdges>().iter_mut(world) {
        own.0 = own.0.map(|edge| row_of_edge[edge as usize]);
    }
    for mut own in world.query::<&mut TriangleEdges>().iter_mut(world) {
        own.0 = own.0.map(|edge| row_of_edge[edge as usize]);
    }
    partition_laws::<S>(world);
    let tables = ElementTables::of(world);
    world.insert_resource(tables);
    resection.bodies.iter_mut().flatten().for_each(|own| own.dead = ByKind::default());
    resection.find_rows(world);
    bending::refresh::<S>(world, Some(resection));
    glue::refresh::<S>(world, Some(resection));
    true
}

/// Gives the blocks of all elements the numbers that `block` has in the place of their old ones.
pub(crate) fn renumber_blocks(world: &mut World, block: &[u32]) {
    macro_rules! renumber {
        ($($column:ty),+) => {$(
            for mut items in world.query::<&mut $column>().iter_mut(world) {
                items.0 = items.0.map(|item| block[item as usize]);
            }
        )+};
    }
    renumber!(TetrahedronBlocks, MembraneBlocks, HexahedronBlocks, QuadBlocks);
    renumber!(Tetrahedron10Blocks, AxisBlocks, AxisHexahedronBlocks, AxisTetrahedron10Blocks);
    for mut own in world.query::<&mut EdgeBlock>().iter_mut(world) {
        own.0 = block[own.0 as usize];
    }
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
    macro_rules! tables {
        ($column:ty, |$own:ident, $item:ident, $first:ident| $is_left:expr) => {
            let mut query = world.query::<(Entity, &$column, &BodyId)>();
            for (entities, items, id) in query.contiguous_iter(world).expect("stored in tables") {
                let keep = items.iter().zip(id).map(|($item, id)| {
                    let $first = first[id.0 as usize];
                    bodies(id).is_none_or(|$own| $is_left)
                });
                tables.push(Table { entities: entities.to_vec(), keep: keep.collect() });
            }
        };
        ($column:ty, $kind:expr) => {
            tables!($column, |own, index, _first| {
                let element = own.element_of[$kind][index.0 as usize];
                own.connectivity.is_present($kind, element)
            });
        };
    }
    tables!(TetrahedronIndex, ElementKind::Tetrahedron);
    tables!(MembraneIndex, ElementKind::Triangle);
    tables!(HexahedronIndex, ElementKind::Hexahedron);
    tables!(QuadIndex, ElementKind::Quad);
    tables!(EdgeVertices, |own, edge, first| {
        let edge = own.edge(edge.0.map(|v| v - first));
        edge.is_some_and(|edge| own.connectivity.uses_edge(edge as u32))
    });
    tables!(TriangleVertices, |own, triangle, first| {
        let triangle = own.triangle(triangle.0.map(|v| v - first));
        triangle.is_some_and(|triangle| own.connectivity.uses_triangle(triangle as u32))
    });
    tables!(AxisTetrahedron, ElementKind::Tetrahedron);
    tables!(AxisTriangle, ElementKind::Triangle);
    tables!(AxisHexahedron, ElementKind::Hexahedron);
    tables.retain(|table| !table.entities.is_empty());
    tables
}
