//! Columns of elements that a cut changed, and those of copies.

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use glam::DVec3;
use sinew_engine::columns::{copy_entity, set};
use sinew_engine::connectivity::ElementKind;
use sinew_engine::element::{
    MembraneBlocks, MembraneIndex, MembraneVertices, RestVolume, TETRAHEDRON_EDGES, TRIANGLE_EDGES,
    TetrahedronBlocks, TetrahedronIndex, TetrahedronVertices, membrane_rest_bundle,
    shape_gradient_bundle,
};
use sinew_engine::isoparametric::{
    Derivatives, HEXAHEDRON_PAIRS, HexahedronIndex, OwnPoints, PointsRest, RestPoints,
    TETRAHEDRON10_PAIRS,
};
use sinew_engine::layout::Lumps;
use sinew_engine::resource::{put, take};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{BodyRows, Topology};
use std::collections::BTreeMap;

use super::axes;
use super::faces::Sheet;
use super::material::{Element, Material, Order};
use super::{hexahedra, ten_node};
use crate::axes::points::AxisShape;
use crate::body::present::BodyResection;
use crate::body::sheet::MembraneSettings;
use crate::element::membrane::RestTriangle;
use crate::element::precompute::RestTetrahedron;
use crate::frame::hexahedra::{Brick, TenNodes};
use crate::frame::triangles::{
    MembraneCompressionModulus, MembraneFirstModulus, MembraneShearModulus,
};
use crate::material::LameParameters;

/// Points of their own of a parted element.
pub(super) enum Points {
    TenNodes(Box<Derivatives<f64, 10, 3, 4>>),
    Hexahedron(Box<Derivatives<f64, 8, 3, 8>>, [f64; 8]),
}

/// Points and lumps of those of some elements that are parted, where elements are no linear tetrahedra; `rest` says where the
/// vertices of the mesh are.
pub(super) fn points_of(
    material: &Material,
    changed: &[u32],
    rest: &dyn Fn(u32) -> DVec3,
) -> BTreeMap<u32, (Points, Lumps)> {
    let mut cells = BTreeMap::<u32, Vec<usize>>::new();
    let parted = |e: &u32| material.elements[*e as usize].portion != [0.25; 4];
    if !material.order.is_linear() {
        cells.extend(changed.iter().filter(|e| parted(e)).map(|&e| (e, Vec::new())));
        for (number, cell) in material.cells.iter().enumerate() {
            if let Some(own) = cells.get_mut(&cell.element) {
                own.push(number);
            }
        }
    }
    let points = |(e, own): (u32, Vec<usize>)| {
        let element = &material.elements[e as usize];
        let cells = own.into_iter().map(|number| &material.cells[number]);
        let point = |p: u32| &material.points[p as usize];
        if material.order == Order::TenNodes {
            let corners = |p: u32| point(p).weights_in(element.vertices);
            let parts: Vec<_> =
                cells.map(|cell| (cell.corners.map(corners), cell.volume)).collect();
            let whole = rest_tetrahedron(element.vertices.map(rest)).volume;
            let (derivatives, lumps) = ten_node::piece(&parts, whole);
            return (e, (Points::TenNodes(Box::new(derivatives)), lumps));
        }
        let vertices = element.all_vertices();
        let local = |p: u32| hexahedra::local(&vertices, point(p));
        let parts: Vec<_> = cells.map(|cell| cell.corners.map(local)).collect();
        let piece = hexahedra::piece(&parts, &vertices.map(rest));
        (e, (Points::Hexahedron(Box::new(piece.gradients), piece.volume), piece.lumps))
    };
    // nothing is left of elements that were removed
    cells.into_iter().filter(|(_, own)| !own.is_empty()).map(points).collect()
}

fn rest_tetrahedron(corners: [DVec3; 4]) -> RestTetrahedron {
    RestTetrahedron::new(corners.map(|x| x.to_array())).expect("the body was built with it")
}

/// Elements that a cut changed.
pub(super) struct Changed<'a> {
    /// Their body, as it is now.
    pub rows: &'a BodyRows,
    /// Entities as they were.
    pub own: &'a BodyResection,
    /// Elements as they were, and the material now.
    pub elements: (&'a [Element], &'a Material),
    /// Their numbers, ascending.
    pub numbers: &'a [u32],
    /// Membrane triangles as they were, the numbers of those that are others now, ascending, and what they are made of.
    pub sheets: (&'a [Sheet], &'a [u32], Option<MembraneSettings>),
    /// Points of their own.
    pub points: BTreeMap<u32, (Points, Lumps)>,
    /// Rest positions (m) of all rows of the body.
    pub rest: &'a [DVec3],
}

/// Writes the columns of elements that have other vertices or another share now, and spawns the copies.
pub(super) fn write<S: Scalar>(world: &mut World, mut changed: Changed) {
    let Changed { rows, own, elements: (before, material), numbers, .. } = changed;
    let kind = rows.copies.kind;
    let mut points = take::<OwnPoints>(world);
    for &e in numbers {
        let element = &material.elements[e as usize];
        let row = own.element_of[kind][e as usize];
        // a copy has the columns of what it fell off, which was written before
        let parent = own.element_of[kind][element.parent as usize];
        let is_known = before.get(e as usize).is_some();
        let own_points = changed.points.remove(&e).map(|own| own.0);
        let at = (e, row, parent);
        match material.order {
            Order::Linear | Order::Triangles => {
                let entity = changed.entity(world, (row, parent), is_known);
                changed.linear::<S>(world, at, entity);
            }
            Order::TenNodes => {
                let shape = || {
                    let corners = element.vertices;
                    let at = |v| changed.rest[super::row_of(rows, v) as usize];
                    let shape = rest_tetrahedron(corners.map(at));
                    let [_, a, b, c] = shape.gradients;
                    let volume = [element.share() * shape.volume / 4.0; 4];
                    RestPoints { gradients: [[a, b, c]; 4], volume }
                };
                let own_points = match own_points {
                    Some(Points::TenNodes(derivatives)) => Some((shape(), derivatives)),
                    _ => None,
                };
                let list = &mut points.tens;
                let pairs = &TETRAHEDRON10_PAIRS;
                changed.at_points::<S, TenNodes, 10, 45, 4>(
                    world,
                    (at, is_known),
                    (own_points, list, pairs),
                );
            }
            Order::Hexahedra => {
                // the list has gradients in place, not by local coordinates
                let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
                let own_points = match own_points {
                    Some(Points::Hexahedron(gradients, volume)) => {
                        Some((RestPoints { gradients: [axes; 8], volume }, gradients))
                    }
                    _ => None,
                };
                let list = &mut points.bricks;
                let pairs = &HEXAHEDRON_PAIRS;
                changed.at_points::<S, Brick, 8, 28, 8>(
                    world,
                    (at, is_known),
                    (own_points, list, pairs),
                );
            }
        }
    }
    put(world, points);
    changed.write_sheets::<S>(world);
}

/// Writes the shape vectors (1/m) of a tetrahedron.
pub(super) fn set_gradients<S: Scalar>(entity: &mut EntityWorldMut, gradients: [[f64; 3]; 3]) {
    macro_rules! set_all {
        ($($value:expr),+) => {{ $(set(entity, $value);)+ }};
    }
    let ((a, b, c), (d, e, f), (g, h, i)) = shape_gradient_bundle::<S>(gradients);
    set_all![a, b, c, d, e, f, g, h, i];
}

/// Puts derivatives into a list, in the place that their element has there (0: none yet), and tells which it has.
fn place<T>(list: &mut Vec<T>, own: u32, derivatives: T) -> u32 {
    match own.checked_sub(1).and_then(|at| list.get_mut(at as usize)) {
        Some(place) => *place = derivatives,
        None => list.push(derivatives),
    }
    if own > 0 { own } else { list.len() as u32 }
}

/// Vertex rows and tangent blocks of an element.
fn places<const N: usize, const P: usize>(
    world: &World,
    rows: &BodyRows,
    row: u32,
    pairs: &[[usize; 2]; P],
) -> ([u32; N], [u32; P]) {
    places_of(world, rows, (rows.copies.kind, row), pairs)
}

fn places_of<const N: usize, const P: usize>(
    world: &World,
    rows: &BodyRows,
    (kind, row): (ElementKind, u32),
    pairs: &[[usize; 2]; P],
) -> ([u32; N], [u32; P]) {
    let local = rows.nodes[kind].each::<N>()[row as usize];
    let nodes = local.map(|v| v + rows.vertices.start);
    let topology = world.resource::<Topology>();
    (nodes, pairs.map(|[a, b]| topology.block(nodes[a], nodes[b]).unwrap_or(0)))
}

impl Changed<'_> {
    /// Membrane triangles and their fibres. Their energies are proportional to the moduli, and only these: some know the shape by its area.
    fn write_sheets<S: Scalar>(&self, world: &mut World) {
        let (before, numbers, Some(settings)) = self.sheets else { return };
        let share = |sheet: &Sheet| sheet.portion.iter().sum::<f64>();
        let (rows, own, kind) = (self.rows, self.own, ElementKind::Triangle);
        let LameParameters { lambda, mu } = settings.surface().0;
        for &t in numbers {
            let sheet: &Sheet = &self.elements.1.sheets[t as usize];
            let row = own.element_of[kind][t as usize];
            let (nodes, blocks) = places_of(world, rows, (kind, row), &TRIANGLE_EDGES);
            let at = |row: u32| self.rest[(row - rows.vertices.start) as usize].to_array();
            let rest = RestTriangle::new(nodes.map(at)).expect("the body was built with it");
            let own_share = if rows.is_whole(kind, row) { 1.0 } else { share(sheet) };
            let [bc, ac, ab] = blocks;
            let [a, b, c] = nodes;
            let place = axes::Place {
                rows,
                element: t,
                kind,
                nodes: [a, b, c, c],
                blocks: [ab, ac, ac, bc, bc, bc],
                gradients: Default::default(),
            };
            let (was, parent) =
                (before.get(t as usize), own.element_of[kind][sheet.parent as usize]);
            match was {
                Some(was) => {
                    for entity in own.rows.axes(kind, row) {
                        axes::share::<S>(world, entity, &place, share(sheet) / share(was));
                    }
                }
                None => {
                    let whole = share(&self.elements.1.sheets[sheet.parent as usize]);
                    let of_parent: Vec<Entity> = own.rows.axes(kind, parent).collect();
                    axes::copy::<S>(world, &of_parent, &place, share(sheet) / whole);
                }
            }
            let entity = match own.rows.elements[kind].get(row as usize) {
                Some(&entity) => entity,
                None => copy_entity(world, own.rows.elements[kind][parent as usize]),
            };
            let mut entity = world.entity_mut(entity);
            set(&mut entity, MembraneVertices(nodes));
            set(&mut entity, MembraneBlocks(blocks));
            set(&mut entity, MembraneIndex(t));
            let ((a, b, c), (d, e, f), area) = membrane_rest_bundle::<S>(rest.edges, rest.area);
            set(&mut entity, a);
            set(&mut entity, b);
            set(&mut entity, c);
            set(&mut entity, d);
            set(&mut entity, e);
            set(&mut entity, f);
            set(&mut entity, area);
            set(&mut entity, MembraneFirstModulus(S::from_f64(own_share * lambda)));
            set(&mut entity, MembraneShearModulus(S::from_f64(own_share * mu)));
            let compression = S::from_f64(own_share * settings.compression());
            set(&mut entity, MembraneCompressionModulus(compression));
        }
    }

    /// Entity of an element: its own, or a copy of that of what it fell off.
    fn entity(&self, world: &mut World, (row, parent): (u32, u32), is_known: bool) -> Entity {
        let elements = &self.own.rows.elements[self.rows.copies.kind];
        match is_known {
            true => elements[row as usize],
            false => copy_entity(world, elements[parent as usize]),
        }
    }

    /// An element with Gauss points and its axes; its rest shape at points of its own, and the derivatives there.
    fn at_points<S, E, const V: usize, const P: usize, const Q: usize>(
        &self,
        world: &mut World,
        ((e, row, parent), is_known): ((u32, u32, u32), bool),
        (own_points, list, pairs): (
            Option<(RestPoints<Q>, Box<Derivatives<f64, V, 3, Q>>)>,
            &mut Vec<Derivatives<f64, V, 3, Q>>,
            &[[usize; 2]; P],
        ),
    ) where
        S: Scalar,
        E: AxisShape<V, P, Q>,
    {
        let kind = self.rows.copies.kind;
        let (nodes, blocks) = places(world, self.rows, row, pairs);
        let entity = self.entity(world, (row, parent), is_known);
        let mut entity = world.entity_mut(entity);
        set(&mut entity, E::Vertices::wrap(nodes));
        set(&mut entity, E::Blocks::wrap(blocks));
        set(&mut entity, HexahedronIndex(e));
        set(&mut entity, TetrahedronIndex(e));
        let (mut factor, mut points) = (1.0, None);
        if let Some((rest, derivatives)) = &own_points {
            let was = entity.get::<PointsRest<S, Q>>().map_or(0, |rest| rest.own);
            let own = place(list, if is_known { was } else { 0 }, **derivatives);
            let volume = rest.total_volume();
            let (before, material) = self.elements;
            // of what lost nothing not even rounding counts
            if before
                .get(e as usize)
                .is_none_or(|was| was.portion != material.elements[e as usize].portion)
            {
                factor = volume / entity.get::<RestVolume<S>>().map_or(volume, |v| v.0.to_f64());
            }
            set(&mut entity, PointsRest { own, ..rest.component::<S>() });
            set(&mut entity, RestVolume(S::from_f64(volume)));
            points = Some((*rest, &**derivatives, own));
        }
        let known = self.own.rows.axes(kind, if is_known { row } else { parent });
        let mut axes: Vec<Entity> = known.collect();
        if !is_known {
            axes.iter_mut().for_each(|entity| *entity = copy_entity(world, *entity));
        }
        let place = axes::PointPlace { element: e, nodes, blocks, points };
        axes::share_at_points::<S, E, V, P, Q>(world, &axes, &place, factor);
    }

    /// A linear tetrahedron and its axes.
    fn linear<S: Scalar>(
        &self,
        world: &mut World,
        (e, row, parent): (u32, u32, u32),
        entity: Entity,
    ) {
        let (rows, (before, material)) = (self.rows, self.elements);
        let (nodes, blocks) = places(world, rows, row, &TETRAHEDRON_EDGES);
        let at = |row: u32| self.rest[(row - rows.vertices.start) as usize];
        let shape = rest_tetrahedron(nodes.map(at));
        let share: f64 = rows.copies.portions[row as usize].iter().sum();
        let gradients = [shape.gradients[1], shape.gradients[2], shape.gradients[3]];
        let mut entity = world.entity_mut(entity);
        set(&mut entity, TetrahedronVertices(nodes));
        set(&mut entity, TetrahedronBlocks(blocks));
        set(&mut entity, TetrahedronIndex(e));
        set_gradients::<S>(&mut entity, gradients);
        set(&mut entity, RestVolume(S::from_f64(share * shape.volume)));
        let kind = rows.copies.kind;
        let place = axes::Place { rows, element: e, kind, nodes, blocks, gradients };
        let element = &material.elements[e as usize];
        match before.get(e as usize) {
            Some(was) => {
                for entity in self.own.rows.axes(kind, row) {
                    axes::share::<S>(world, entity, &place, element.share() / was.share());
                }
            }
            None => {
                let whole = material.elements[element.parent as usize].share();
                let of_parent: Vec<Entity> = self.own.rows.axes(kind, parent).collect();
                axes::copy::<S>(world, &of_parent, &place, element.share() / whole);
            }
        }
    }
}
