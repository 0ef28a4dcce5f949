//! Axes, fibres, muscles and dampers in elements that a blade parts: each piece has those of the whole element with its share of
//! their stiffness. The deformation of a linear tetrahedron, or of a membrane triangle, is the same everywhere, so that is all;
//! in hexahedra and in ten-node tetrahedra axes lie at the points of the piece, as its law does.

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use glam::DVec3;
use sinew_engine::columns::{copy_entity, set};
use sinew_engine::connectivity::ElementKind;
use sinew_engine::element::{AxisBlocks, AxisTetrahedron, AxisTriangle, AxisVertices};
use sinew_engine::isoparametric::{AxisHexahedron, Derivatives, PointsRest, RestPoints};
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::BodyRows;

use super::columns::set_gradients;
use crate::axes::columns::*;
use crate::axes::damper::AxialDamper;
use crate::axes::muscle;
use crate::axes::points::{AxisShape, shape_of, shares};

/// An element as its axes see it.
pub(super) struct Place<'a> {
    /// Its body.
    pub rows: &'a BodyRows,
    /// Its number.
    pub element: u32,
    /// Its kind.
    pub kind: ElementKind,
    /// Vertex rows; of a triangle the last one twice.
    pub nodes: [u32; 4],
    /// Tangent blocks.
    pub blocks: [u32; 6],
    /// Shape vectors (1/m) of its last three vertices; fibres of triangles have none.
    pub gradients: [[f64; 3]; 3],
}

/// Spawns axes in a copy like those of the element that it fell off, with `factor` times their stiffness.
pub(super) fn copy<S: Scalar>(world: &mut World, axes: &[Entity], place: &Place, factor: f64) {
    for &entity in axes {
        let entity = copy_entity(world, entity);
        share::<S>(world, entity, place, factor);
    }
}

/// Gives an axis its place in an element whose vertices are others now, or stand in another order, and `factor` times its
/// stiffness.
pub(super) fn share<S: Scalar>(world: &mut World, axes: Entity, place: &Place, factor: f64) {
    let mut axes = world.entity_mut(axes);
    let Some(&AxisVertices(old)) = axes.get() else { return };
    let vertex = |row: u32| place.rows.vertex(VertexRow(row));
    let known = |row: u32| old.iter().position(|&own| vertex(own) == vertex(row)).unwrap_or(0);
    let mut was = place.nodes.map(known);
    set(&mut axes, AxisVertices(place.nodes));
    set(&mut axes, AxisBlocks(place.blocks));
    set(&mut axes, AxisTriangle(place.element));
    set(&mut axes, AxisTetrahedron(place.element));
    if place.kind == ElementKind::Triangle {
        // what stands for a fourth vertex has no part in anything
        was[3] = 3;
    }
    set_gradients::<S>(&mut axes, place.gradients);
    if let (Some(a), Some(b), Some(c)) = (
        axes.get::<FibreShape<S, 1>>(),
        axes.get::<FibreShape<S, 2>>(),
        axes.get::<FibreShape<S, 3>>(),
    ) {
        let shape = [-(a.0 + b.0 + c.0), a.0, b.0, c.0];
        let [_, a, b, c] = was.map(|i| shape[i]);
        set(&mut axes, FibreShape::<S, 1>(a));
        set(&mut axes, FibreShape::<S, 2>(b));
        set(&mut axes, FibreShape::<S, 3>(c));
    }
    if let Some(mut damper) = axes.get_mut::<AxialDamper<4>>() {
        (damper.shape, damper.spread) =
            (was.map(|i| damper.shape[i]), was.map(|i| damper.spread[i]));
        damper.viscosity *= factor;
    }
    scale::<S>(&mut axes, factor);
}

/// Gives an axis `factor` times its stiffness.
fn scale<S: Scalar>(axes: &mut EntityWorldMut, factor: f64) {
    if let Some(mut source) = axes.get_mut::<AxisSource>() {
        source.weight = source.weight.map(|weight| weight * factor);
    }
    macro_rules! scale {
        ($($column:ty),+) => {$(
            if let Some(mut column) = axes.get_mut::<$column>() {
                column.0 = S::from_f64(column.0.to_f64() * factor);
            }
        )+};
    }
    scale![
        AxialStiffness<S, 0>, AxialStiffness<S, 1>, AxialStiffness<S, 2>,
        AxisAngleStiffness<S, 0>, AxisAngleStiffness<S, 1>, AxisAngleStiffness<S, 2>,
        VolumeStiffness<S>, PassiveStiffness<S>, PeakTension<S>
    ];
    muscle::refresh::<S>(axes);
}

/// An element with points of its own, as its axes see it.
pub(super) struct PointPlace<'a, const V: usize, const P: usize, const Q: usize> {
    /// Its number.
    pub element: u32,
    /// Vertex rows.
    pub nodes: [u32; V],
    /// Tangent blocks.
    pub blocks: [u32; P],
    /// Rest shape at its points, the derivatives there, and their place in the list that
    /// [`PointsRest::own`](sinew_engine::isoparametric::PointsRest::own) tells; `None` while nothing of it is cut off.
    pub points: Option<(RestPoints<Q>, &'a Derivatives<f64, V, 3, Q>, u32)>,
}

/// Gives all axes of an element their place in it, and `factor` times their stiffness.
pub(super) fn share_at_points<S, E, const V: usize, const P: usize, const Q: usize>(
    world: &mut World,
    axes: &[Entity],
    place: &PointPlace<V, P, Q>,
    factor: f64,
) where
    S: Scalar,
    E: AxisShape<V, P, Q>,
{
    for &entity in axes {
        let mut axes = world.entity_mut(entity);
        set(&mut axes, E::AxisVertices::wrap(place.nodes));
        set(&mut axes, E::AxisBlocks::wrap(place.blocks));
        set(&mut axes, AxisHexahedron(place.element));
        set(&mut axes, AxisTetrahedron(place.element));
        if let Some((rest, _, own)) = &place.points {
            set(&mut axes, PointsRest { own: *own, ..shares(rest).component::<S>() });
        }
        scale::<S>(&mut axes, factor);
    }
    if let Some((rest, derivatives, _)) = &place.points {
        place_dampers(world, axes, (rest, derivatives), factor);
    }
}

/// Puts dampers, of which there is one for every point, to the points of an element: those along one axis share out anew, by the
/// volumes of the points, `factor` times what they had.
fn place_dampers<const V: usize, const Q: usize>(
    world: &mut World,
    axes: &[Entity],
    (rest, derivatives): (&RestPoints<Q>, &Derivatives<f64, V, 3, Q>),
    factor: f64,
) {
    let known = |&entity: &Entity| Some((entity, *world.get::<AxialDamper<V>>(entity)?));
    let mut dampers: Vec<_> = axes.iter().filter_map(known).collect();
    let bits = |damper: &AxialDamper<V>| damper.axis.map(f64::to_bits);
    dampers.sort_by_key(|(_, damper)| bits(damper));
    let part = shares(rest).volume;
    for along in dampers.chunk_by(|(_, a), (_, b)| bits(a) == bits(b)) {
        let sum: f64 = along.iter().map(|(_, damper)| damper.viscosity).sum();
        let families = (along.len() / Q) as f64;
        for (i, &(entity, AxialDamper { axis, .. })) in along.iter().enumerate() {
            let shape = shape_of(derivatives, rest, i % Q, DVec3::from_array(axis));
            let viscosity = factor * sum * part[i % Q] / families;
            set(&mut world.entity_mut(entity), AxialDamper::new(axis, shape, viscosity));
        }
    }
}
