//! Compaction of tables and edge graph.
//!
//! Rows that are left move down in their order, column by column, and the entities at the end of the
//! table are despawned, so that entities, tables and their order stay as a freshly spawned body would
//! have them. Vertex rows do not change.

use super::Resection;
use crate::axes::change::AxisSource;
use crate::axes::columns::*;
use crate::axes::damper::AxialDamper;
use crate::axes::printed_system::PrintedAxes;
use crate::body::partition_laws;
use crate::fused::{CompressionModulus, FirstLameParameter, ShearModulus};
use crate::fused_membrane::{
    MembraneCompressionModulus, MembraneFirstModulus, MembraneShearModulus,
};
use crate::pooled::{
    AngularStiffness, TensileStiffness, TensileTension, TriangleVertices, VolumetricStiffness,
};
use bevy_ecs::component::{ComponentId, Mutable};
use bevy_ecs::prelude::*;
use sinew_engine::connectivity::{ByKind, ElementKind};
use sinew_engine::element::{
    AxisBlocks, AxisTetrahedron, AxisVertices, EdgeBlock, EdgeChange, EdgeTension, EdgeVertices,
    MembraneBlocks, MembraneEdge, MembraneIndex, MembraneVertices, RestArea, RestEdge, RestVolume,
    ShapeGradient, TetrahedronBlocks, TetrahedronEdges, TetrahedronIndex, TetrahedronVertices,
    TriangleEdges,
};
use sinew_engine::isoparametric::{
    AxisHexahedron, AxisHexahedronBlocks, AxisHexahedronVertices, HexahedronBlocks,
    HexahedronIndex, HexahedronRest, HexahedronVertices, QuadBlocks, QuadIndex, QuadRest,
    QuadVertices,
};
use sinew_engine::layout::{UNUSED, starts};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{ElementTables, Topology};
use sinew_engine::vertex::BodyId;

/// How a column is moved: rows in ascending order to the front of the table of an entity.
#[derive(Clone, Copy)]
struct Column {
    id: ComponentId,
    shift: fn(&mut World, Entity, &[usize]),
}

fn shift<C: Component<Mutability = Mutable> + Copy>(
    world: &mut World,
    first: Entity,
    rows: &[usize],
) {
    let mut query = world.query::<(Entity, &mut C)>();
    let tables = query.contiguous_iter_mut(world).expect("element components are stored in tables");
    for (entities, mut column) in tables {
        if entities.first() == Some(&first) {
            for (to, &from) in rows.iter().enumerate() {
                column[to] = column[from];
            }
        }
    }
}

macro_rules! columns {
    ($world:ident: $($component:ty),+ $(,)?) => {
        vec![$(Column {
            id: $world.register_component::<$component>(),
            shift: shift::<$component>,
        }),+]
    };
}

/// Columns of elements that move with their row.
fn known_columns<S: Scalar>(world: &mut World) -> Vec<Column> {
    columns![world:
        BodyId, TetrahedronVertices, TetrahedronBlocks, TetrahedronIndex, TetrahedronEdges,
        ShapeGradient<S, 1, 0>, ShapeGradient<S, 1, 1>, ShapeGradient<S, 1, 2>,
        ShapeGradient<S, 2, 0>, ShapeGradient<S, 2, 1>, ShapeGradient<S, 2, 2>,
        ShapeGradient<S, 3, 0>, ShapeGradient<S, 3, 1>, ShapeGradient<S, 3, 2>,
        RestVolume<S>, FirstLameParameter<S>, ShearModulus<S>, CompressionModulus<S>,
        VolumetricStiffness<S, 0>, VolumetricStiffness<S, 1>, VolumetricStiffness<S, 2>,
        EdgeVertices, EdgeBlock, RestEdge<S, 0>, RestEdge<S, 1>, RestEdge<S, 2>,
        EdgeChange<S>, EdgeTension<S>, TensileStiffness<S>, TensileTension<S>,
        TriangleVertices, TriangleEdges,
        AngularStiffness<S, 0>, AngularStiffness<S, 1>, AngularStiffness<S, 2>,
        MembraneVertices, MembraneBlocks, MembraneIndex, RestArea<S>,
        MembraneEdge<S, 1, 0>, MembraneEdge<S, 1, 1>, MembraneEdge<S, 1, 2>,
        MembraneEdge<S, 2, 0>, MembraneEdge<S, 2, 1>, MembraneEdge<S, 2, 2>,
        MembraneFirstModulus<S>, MembraneShearModulus<S>, MembraneCompressionModulus<S>,
        HexahedronVertices, HexahedronBlocks, HexahedronIndex, HexahedronRest<S>,
        AxisHexahedronVertices, AxisHexahedronBlocks, AxisHexahedron,
        QuadVertices, QuadBlocks, QuadIndex, QuadRest<S>,
        AxisVertices, AxisBlocks, AxisTetrahedron,
        AxisDirection<S, 0, 0>, AxisDirection<S, 0, 1>, AxisDirection<S, 0, 2>,
        AxisDirection<S, 1, 0>, AxisDirection<S, 1, 1>, AxisDirection<S, 1, 2>,
        AxisDirection<S, 2, 0>, AxisDirection<S, 2, 1>, AxisDirection<S, 2, 2>,
        AxialStiffness<S, 0>, AxialStiffness<S, 1>, AxialStiffness<S, 2>,
        AxisAngleStiffness<S, 0>, AxisAngleStiffness<S, 1>, AxisAngleStiffness<S, 2>,
        VolumeStiffness<S>, FibreShape<S, 1>, FibreShape<S, 2>, FibreShape<S, 3>,
        FibreShortening<S>, FibreActive<S>, FibreOffset<S>, FibreInverseWidth<S>,
        PassiveStiffness<S>, PeakTension<S>, MuscleIndex,
        PrintedAxes<4>, PrintedAxes<8>, AxialDamper<4>, AxialDamper<8>, AxisSource,
    ]
}

/// Rows of one table of elements.
struct Table {
    entities: Vec<Entity>,
    keep: Vec<bool>,
}

/// Removes the rows of removed elements from all tables, and the edges that no element uses from the
/// edge graph. Does nothing, and says so, when an element has a component that is not known here:
/// its column would not move along.
pub(super) fn compact<S: Scalar>(world: &mut World, resection: &mut Resection) -> bool {
    let columns = known_columns::<S>(world);
    let tables = find_tables(world, resection);
    let edge_tension = world.register_component::<EdgeTension<S>>();
    let mut plan = Vec::new();
    for table in tables {
        let entity = world.entity(table.entities[0]);
        let archetype = entity.archetype();
        let mut shifts = Vec::new();
        for &component in archetype.components() {
            if let Some(column) = columns.iter().find(|c| c.id == component) {
                shifts.push(column.shift);
            } else if world.components().get_info(component).is_none_or(|i| i.layout().size() > 0) {
                return false;
            }
        }
        let pooled_edges = archetype.contains(edge_tension);
        plan.push((table, shifts, pooled_edges));
    }

    let mut row_of_edge = Vec::new();
    for (table, shifts, pooled_edges) in plan {
        let Table { entities, keep } = table;
        let rows: Vec<usize> = (0..keep.len()).filter(|&row| keep[row]).collect();
        if pooled_edges {
            row_of_edge = new_places(&keep);
        }
        if rows.len() == keep.len() {
            continue;
        }
        for shift in shifts {
            shift(world, entities[0], &rows);
        }
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
