//! The product of the exact tangent of springs with a vector, without a matrix, as Delingette 2008 scans them: edges,
//! then triangles, then tetrahedra. One spring at a time, without registers.

use super::subject::Free;
use bevy_ecs::prelude::World;
use sinew::engine::columns::single_table;
use sinew::engine::element::{
    EdgeShapes, EdgeTension, EdgeVertices, RestEdges, TetrahedronEdges, TriangleEdges,
};
use sinew::engine::scalar::{Scalar, add, dot, scale, sub};
use sinew::engine::vertex::Displacement;
use sinew::models::element::precompute::OPPOSITE_EDGES;
use sinew::models::element::spring::{Stretch, tensile_tension};
use sinew::models::laws::pooled::{AngularStiffnesses, TensileStiffness, VolumetricStiffnesses};

/// Vector of row `v` (no unit of its own).
fn at<S: Scalar>(x: &[[S; 4]], v: u32) -> [S; 3] {
    let [a, b, c, _] = x[v as usize];
    [a, b, c]
}

/// Adds a force to one end of an edge and takes it from the other.
fn spread<S: Scalar>(y: &mut [[S; 4]], [a, b]: [u32; 2], force: [S; 3]) {
    for k in 0..3 {
        y[a as usize][k] += force[k];
        y[b as usize][k] -= force[k];
    }
}

/// Quadratic springs on edges, of a mass-spring body that is alone in its world.
pub fn edges<S: Scalar>(world: &mut World, x: &[[S; 4]], y: &mut [[S; 4]]) {
    let mut vertices = world.query::<&Displacement<S>>();
    let mut edges = world.query::<(&EdgeVertices, RestEdges<S>, &TensileStiffness<S>)>();
    let Some(u) = single_table(vertices.contiguous_iter(world)) else { return };
    let Some((nodes, rest, stiffness)) = single_table(edges.contiguous_iter(world)) else { return };
    let shapes = EdgeShapes::new(u, nodes, rest);
    let half = S::from_f64(0.5);
    for (e, (&ends, &TensileStiffness(k))) in shapes.nodes.iter().zip(stiffness).enumerate() {
        let [p, q] = ends.map(|v| at(shapes.displacement, v));
        let stretch = Stretch::new(shapes.rest.map(|x| x[e]), sub(p, q));
        let tension = stretch.slope * tensile_tension(k, stretch.change);
        let way = sub(at(x, ends[0]), at(x, ends[1]));
        let stiff = half * k * stretch.slope * stretch.slope - tension * stretch.inverse_square;
        let along = stiff * dot(stretch.edge, way);
        spread(y, ends, add(scale(stretch.edge, along), scale(way, tension)));
    }
}

/// Biquadratic springs, pooled, of a body without the compression term that is alone in its world and was evaluated in
/// its state.
pub fn pooled<S: Scalar>(world: &mut World, x: &[[S; 4]], y: &mut [[S; 4]]) {
    let mut vertices = world.query::<&Displacement<S>>();
    type Edges<S> = (
        &'static EdgeVertices,
        RestEdges<S>,
        &'static TensileStiffness<S>,
        &'static EdgeTension<S>,
    );
    let mut edges = world.query::<Edges<S>>();
    let mut triangles = world.query::<(&TriangleEdges, AngularStiffnesses<S>)>();
    let mut tetrahedra = world.query::<(&TetrahedronEdges, VolumetricStiffnesses<S>)>();
    let Some(u) = single_table(vertices.contiguous_iter(world)) else { return };
    let Some((nodes, rest, stiffness, tension)) = single_table(edges.contiguous_iter(world)) else {
        return;
    };
    let shapes = EdgeShapes::new(u, nodes, rest);
    let (two, half) = (S::from_f64(2.0), S::from_f64(0.5));
    let edge = |e: usize| {
        let [p, q] = shapes.nodes[e].map(|v| at(shapes.displacement, v));
        add(shapes.rest.map(|x| x[e]), sub(p, q))
    };
    // changes of squared length, and of the tension by those
    let changes: Vec<S> = (0..nodes.len())
        .map(|e| {
            let [a, b] = shapes.nodes[e];
            two * dot(edge(e), sub(at(x, a), at(x, b)))
        })
        .collect();
    let mut tensions: Vec<S> =
        stiffness.iter().zip(&changes).map(|(k, &w)| tensile_tension(k.0, w)).collect();
    let mut couple = |c: S, e: u32, f: u32| {
        let (e, f, c) = (e as usize, f as usize, half * c);
        tensions[e] += c * changes[f];
        tensions[f] += c * changes[e];
    };
    if let Some((of, (c0, c1, c2))) = single_table(triangles.contiguous_iter(world)) {
        for (i, TriangleEdges(of)) in of.iter().enumerate() {
            couple(c0[i].0, of[1], of[2]);
            couple(c1[i].0, of[2], of[0]);
            couple(c2[i].0, of[0], of[1]);
        }
    }
    if let Some((of, (d0, d1, d2))) = single_table(tetrahedra.contiguous_iter(world)) {
        for (i, TetrahedronEdges(of)) in of.iter().enumerate() {
            let d = [d0[i].0, d1[i].0, d2[i].0];
            for ([e, f], d) in OPPOSITE_EDGES.into_iter().zip(d) {
                couple(d, of[e], of[f]);
            }
        }
    }
    for (e, &EdgeTension(s)) in tension.iter().enumerate() {
        let ends = shapes.nodes[e];
        let way = sub(at(x, ends[0]), at(x, ends[1]));
        let force = add(scale(edge(e), two * tensions[e]), scale(way, two * s));
        spread(y, ends, force);
    }
}

/// The product of a law of springs that is not summed element by element; none otherwise.
pub fn of<S: Scalar>(mass_spring: bool, pooled_springs: bool) -> Option<Free<S>> {
    match (mass_spring, pooled_springs) {
        (true, _) => Some(edges::<S>),
        (_, true) => Some(pooled::<S>),
        _ => None,
    }
}
