//! What a body still has of its elements once some were removed, and in which rows of the tables they stand.

use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::connectivity::{ByKind, Connectivity, ElementKind};
use sinew_engine::element::{
    AxisTetrahedron, AxisTriangle, EdgeVertices, MembraneIndex, TetrahedronIndex,
};
use sinew_engine::isoparametric::{AxisHexahedron, HexahedronIndex, QuadIndex};
use sinew_engine::resource::put;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::BodyId;
use std::sync::Arc;

use crate::cutting::material::Material;
use crate::laws::pooled::TriangleVertices;
use crate::laws::quadratic::MassSpring;

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

/// What bodies keep for removals, from [`prepare_removals`](crate::resection::prepare_removals) on.
#[derive(Resource, Clone, Debug, Default)]
pub struct Resection {
    pub(crate) bodies: Vec<Option<BodyResection>>,
}

impl Resection {
    /// Connectivity of a body, `None` while nothing was prepared for or removed from it.
    pub fn connectivity(&self, body: usize) -> Option<&Connectivity> {
        Some(&self.bodies.get(body)?.as_ref()?.connectivity)
    }
}

#[derive(Clone, Debug)]
pub(crate) struct BodyResection {
    pub connectivity: Connectivity,
    /// Index of the user -> element.
    pub element_of: ByKind<Vec<u32>>,
    /// Entities in whose rows the elements stand; a placeholder for those that have no row.
    pub rows: Entities,
    /// Removed elements that still have a row.
    pub dead: ByKind<usize>,
    /// Number of connected pieces.
    pub pieces: usize,
    /// Its material, once it was cut.
    pub material: Option<Arc<Material>>,
}

/// Entities in whose rows the elements of a body stand.
#[derive(Clone, Debug, Default)]
pub(crate) struct Entities {
    pub elements: ByKind<Vec<Entity>>,
    /// Edges of pooled springs, and those that are springs by themselves.
    pub edges: [Vec<Entity>; 2],
    pub triangles: Vec<Entity>,
    /// Axes of all kinds, with the element that they lie in, by elements.
    axes: ByKind<Vec<(u32, Entity)>>,
}

impl Entities {
    /// Axes in an element.
    pub fn axes(&self, kind: ElementKind, element: u32) -> impl Iterator<Item = Entity> {
        let axes = &self.axes[kind];
        let first = axes.partition_point(|(e, _)| *e < element);
        axes[first..].iter().take_while(move |(e, _)| *e == element).map(|(_, entity)| *entity)
    }
}

impl BodyResection {
    /// Edge between two vertices of the body.
    pub fn edge(&self, vertices: [u32; 2]) -> Option<usize> {
        self.connectivity.cells.edges.binary_search(&vertices).ok()
    }

    /// Triangle between three vertices of the body.
    pub fn triangle(&self, vertices: [u32; 3]) -> Option<usize> {
        self.connectivity.cells.triangles.binary_search(&vertices).ok()
    }
}

impl Resection {
    /// Finds the entities in whose rows the elements of the prepared bodies stand.
    pub(crate) fn find_rows(&mut self, world: &mut World) {
        let topology = world.resource::<Topology>();
        let first: Vec<u32> = topology.bodies.iter().map(|b| b.vertices.start).collect();
        for own in self.bodies.iter_mut().flatten() {
            let cells = &own.connectivity.cells;
            let none = |count: usize| vec![Entity::PLACEHOLDER; count];
            own.rows = Entities {
                elements: ByKind::of(|kind| none(own.element_of[kind].len())),
                edges: [none(cells.edges.len()), none(cells.edges.len())],
                triangles: none(cells.triangles.len()),
                axes: ByKind::default(),
            };
        }
        macro_rules! find {
            ($data:ty, |$own:ident, $entity:ident, $item:ident, $first:ident| $put:expr) => {
                let mut items = world.query::<(Entity, &BodyId, $data)>();
                for ($entity, id, $item) in items.iter(world) {
                    let $first = first[id.0 as usize];
                    if let Some(Some($own)) = self.bodies.get_mut(id.0 as usize) {
                        $put;
                    }
                }
            };
        }
        macro_rules! find_elements {
            ($index:ty, $axes:ty, $kind:expr) => {
                find_elements!($index, $kind);
                find!(&$axes, |own, entity, index, _first| {
                    let element = own.element_of[$kind][index.0 as usize];
                    own.rows.axes[$kind].push((element, entity));
                });
            };
            ($index:ty, $kind:expr) => {
                find!(&$index, |own, entity, index, _first| {
                    let element = own.element_of[$kind][index.0 as usize];
                    own.rows.elements[$kind][element as usize] = entity;
                });
            };
        }
        find_elements!(TetrahedronIndex, AxisTetrahedron, ElementKind::Tetrahedron);
        find_elements!(MembraneIndex, AxisTriangle, ElementKind::Triangle);
        find_elements!(HexahedronIndex, AxisHexahedron, ElementKind::Hexahedron);
        find_elements!(QuadIndex, ElementKind::Quad);
        for own in self.bodies.iter_mut().flatten() {
            // those of an element in the order of their tables: entities are others after a rollback
            own.rows.axes.iter_mut().for_each(|axes| axes.sort_by_key(|(element, _)| *element));
        }
        find!((&EdgeVertices, Has<MassSpring>), |own, entity, edge, first| {
            if let Some(at) = own.edge(edge.0.0.map(|v| v - first)) {
                own.rows.edges[usize::from(edge.1)][at] = entity;
            }
        });
        find!(&TriangleVertices, |own, entity, triangle, first| {
            if let Some(at) = own.triangle(triangle.0.map(|v| v - first)) {
                own.rows.triangles[at] = entity;
            }
        });
    }
}

/// Takes up what was kept for removals, with the rows as they stand now.
pub(crate) fn rows_again(world: &mut World, mut resection: Resection) {
    resection.find_rows(world);
    put(world, resection);
}
