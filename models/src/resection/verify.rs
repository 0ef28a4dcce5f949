//! Holds a body that lost elements against one that is built anew from what is left.

use super::Resection;
use crate::axes::muscle::{Muscles, copy_activations};
use crate::body::{BodyDescription, BodyError, SoftBody, spawn_body};
use crate::frame::tetrahedra::{CompressionModulus, FirstLameParameter, ShearModulus};
use crate::frame::triangles::{
    MembraneCompressionModulus, MembraneFirstModulus, MembraneShearModulus,
};
use crate::laws::pooled::{
    AngularStiffness, TensileStiffness, TriangleVertices, VolumetricStiffness,
};
use crate::laws::pressure;
use crate::laws::quadratic::MassSpring;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::compiled_here;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::element::{
    EdgeVertices, MembraneRest, MembraneVertices, RestEdges, RestVolume, ShapeGradients,
    TETRAHEDRON_EDGES, TetrahedronVertices,
};
use sinew_engine::isoparametric::{HexahedronRest, HexahedronVertices, QuadRest, QuadVertices};
use sinew_engine::law::{ElasticEnergy, EvaluationRequest, RecoveringBodies, TangentKind};
use sinew_engine::load::{LoadTime, Pressure};
use sinew_engine::matrix::Tangent;
use sinew_engine::mesh::Mesh;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{Executor, ForceSchedule, evaluate_dampers, has_dampers};
use sinew_engine::step::install_engine;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{BodyId, Displacement, ElasticForce, Mass, RestPosition};
use std::collections::BTreeMap;

/// Largest difference of each quantity, over its largest value in the new body (or in the old one,
/// if that is larger).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FreshDifference {
    /// Lumped masses; equal only as long as removals recompute them.
    pub mass: f64,
    /// Everything else by name: columns, energy, forces, and the three tangents.
    pub others: Vec<(&'static str, f64)>,
}

impl FreshDifference {
    /// Largest difference, masses left out.
    pub fn largest(&self) -> f64 {
        self.others.iter().map(|(_, x)| *x).fold(0.0, f64::max)
    }
}

/// Values of elements, keyed by the user's indices of their vertices.
type Values = BTreeMap<Vec<u32>, Vec<f64>>;

/// Compares everything that a body holds (masses, rest shapes, moduli, pooled constants) and gives at
/// the present state (energy, forces, tangents) with a body built anew from the elements left, under the
/// same pressures. For tests and doubts: it builds that body.
///
/// # Errors
/// When the new body cannot be built.
pub fn compare_with_fresh<S: Scalar>(
    world: &mut World,
    body: usize,
) -> Result<FreshDifference, BodyError> {
    compiled_here!(S, compare(world: &mut World, body: usize) -> Result<FreshDifference, BodyError>)
}

fn compare<S: Scalar>(world: &mut World, body: usize) -> Result<FreshDifference, BodyError> {
    let rows = world.resource::<Topology>().bodies[body].clone();
    let resection = world.get_resource::<Resection>();
    let connectivity = resection.and_then(|r| r.connectivity(body));
    let mut mesh = Mesh { points: vec![DVec3::ZERO; rows.row_of_vertex.len()], ..Mesh::default() };
    let user = |v: u32| rows.vertex_order[v as usize];
    let left = |kind, e| connectivity.is_none_or(|c| c.is_present(kind, e));
    let mut index = Vec::new();
    for (t, &original) in (0..).zip(&rows.tetrahedron_order) {
        if left(ElementKind::Tetrahedron, t) {
            mesh.tetrahedra.push(rows.tetrahedra[t as usize].map(user));
            index.push(original as usize);
        }
    }
    let mut hexahedra = Vec::new();
    for (h, &original) in (0..).zip(&rows.hexahedron_order) {
        if left(ElementKind::Hexahedron, h) {
            hexahedra.push(rows.hexahedra[h as usize].map(user));
            index.push(rows.tetrahedra.len() + original as usize);
        }
    }
    for t in 0..rows.membrane.len() as u32 {
        if left(ElementKind::Triangle, t) {
            mesh.triangles.push(rows.membrane[t as usize].map(user));
        }
    }
    let quads = (0..rows.quads.len() as u32).filter(|&q| left(ElementKind::Quad, q));
    let quads: Vec<_> = quads.map(|q| rows.quads[q as usize].map(user)).collect();
    let mut vertices = world.query::<(&RestPosition, &Displacement<S>)>();
    let mut displacement = vec![Displacement::<S>::default(); rows.row_of_vertex.len()];
    if let Some((rest, u)) = single_table(vertices.contiguous_iter(world)) {
        for (row, &v) in (rows.vertices.start as usize..).zip(&rows.vertex_order) {
            mesh.points[v as usize] = rest[row].0;
            displacement[v as usize] = u[row];
        }
    }
    let Some(soft) = world.query::<&SoftBody>().iter(world).find(|b| b.index == body).cloned()
    else {
        return Ok(FreshDifference::default());
    };
    let mut fresh = World::new();
    install_engine::<S>(&mut fresh, Executor::SingleThreaded);
    let elements = [&mesh.tetrahedra.len(), &mesh.triangles.len(), &hexahedra.len(), &quads.len()];
    if elements.iter().any(|&&count| count > 0) {
        let field = soft.field();
        let pick = |array: Option<&[f64]>| -> Option<Vec<f64>> {
            array.map(|values| index.iter().map(|&t| values[t]).collect())
        };
        let (young, poisson, density) =
            (pick(field.young_modulus), pick(field.poisson_ratio), pick(field.density));
        let membrane = soft.membrane.as_ref().map(|m| m.of(&mesh.triangles, &quads));
        let description = BodyDescription {
            young_modulus: young.as_deref(),
            poisson_ratio: poisson.as_deref(),
            density: density.as_deref(),
            model: soft.model,
            evaluation: soft.evaluation,
            membrane,
            hexahedra: &hexahedra,
            springs: soft.spring_method,
            axes: match &soft.axes {
                Some(axes) if !index.is_empty() => Some(axes.description.of_elements(&index)),
                _ => None,
            },
            ..BodyDescription::new("fresh", &mesh, soft.material)
        };
        spawn_body(&mut fresh, &description)?;
        if let Some(muscles) = world.get_resource::<Muscles>() {
            let own = muscles.iter().filter(|m| m.body == body);
            let activations: Vec<_> = own.map(|m| (m.family.clone(), m.activation())).collect();
            copy_activations::<S>(&mut fresh, &activations);
        }
        let new = fresh.resource::<Topology>().bodies[0].clone();
        let row = |row: u32| new.row(user(row - rows.vertices.start)).unwrap_or(0);
        let mut pressures: Vec<(Entity, Pressure)> = world
            .query::<(Entity, &Pressure)>()
            .iter(world)
            .filter(|(_, p)| p.faces.iter().all(|face| rows.vertices.contains(&face[0])))
            .map(|(entity, p)| {
                (
                    entity,
                    Pressure { faces: p.faces.iter().map(|f| f.map(row)).collect(), ..p.clone() },
                )
            })
            .collect();
        pressures.sort_unstable_by_key(|(entity, _)| *entity);
        if !pressures.is_empty() {
            fresh.spawn_batch(pressures.into_iter().map(|(_, p)| p).collect::<Vec<_>>());
            pressure::activate::<S>(&mut fresh);
            let time = world.get_resource::<LoadTime>().map_or(0.0, |time| time.0);
            fresh.insert_resource(LoadTime(time));
        }
        let order = fresh.resource::<Topology>().bodies[0].vertex_order.clone();
        let mut vertices = fresh.query::<&mut Displacement<S>>();
        if let Some(mut u) = single_table(vertices.contiguous_iter_mut(&mut fresh)) {
            for (u, v) in u.iter_mut().zip(order) {
                *u = displacement[v as usize];
            }
        }
    }
    let recovers = world.get_resource::<RecoveringBodies>().is_some_and(|r| r.contains(body));
    fresh.insert_resource(RecoveringBodies(vec![recovers]));
    let old = snapshot::<S>(world, body);
    let new = snapshot::<S>(&mut fresh, 0);
    // forces of a body that is turned but hardly strained are small differences of large numbers
    let none = Values::new();
    let stiffness = size(old.get("exact tangent").unwrap_or(&none));
    let reach = spread(&displacement);
    let mut difference = FreshDifference::default();
    for (name, old) in &old {
        let least = match *name {
            "force" => ROUNDED * stiffness * reach,
            "energy" => ROUNDED * stiffness * reach * reach,
            _ => 0.0,
        };
        let x = largest_difference(old, new.get(name).unwrap_or(&none), least);
        if *name == "mass" {
            difference.mass = x;
        } else {
            difference.others.push((name, x));
        }
    }
    Ok(difference)
}

/// Part of stiffness times displacement to which forces and energies are compared at least.
const ROUNDED: f64 = 1e-3;

/// Largest extent (m) of displacements along an axis.
fn spread<S: Scalar>(u: &[Displacement<S>]) -> f64 {
    let along = |k: usize| {
        let values = || u.iter().map(|u| u.0[k].to_f64());
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    (0..3).map(along).fold(0.0, f64::max)
}

fn size(values: &Values) -> f64 {
    values.values().flatten().fold(0.0_f64, |m, x| m.max(x.abs()))
}

/// Over the largest value of either, or `least`. What one has and the other has not counts as zero there.
fn largest_difference(a: &Values, b: &Values, least: f64) -> f64 {
    let mut largest = 0.0_f64;
    for (key, x) in a.iter().chain(b) {
        let other = |v: &Values, i: usize| v.get(key).map_or(0.0, |v| v[i]);
        for i in 0..x.len() {
            let difference = (other(a, i) - other(b, i)).abs();
            // what is not a number must not pass
            largest = if difference <= largest { largest } else { difference };
        }
    }
    let size = size(a).max(size(b)).max(least);
    if size > 0.0 { largest / size } else { largest }
}

/// The blocks of the world's tangent that belong to a body, by the user's vertices.
fn tangent_blocks<S: Scalar>(world: &World, rows: &BodyRows, add: &mut dyn FnMut(&[u32], &[f64])) {
    let user = |row: u32| rows.vertex_order[(row - rows.vertices.start) as usize];
    let (topology, tangent) = (world.resource::<Topology>(), world.resource::<Tangent<S>>());
    let mut block = |a: u32, b: u32, m: &[S; 9]| {
        let (a, b) = (user(a), user(b));
        let m = m.map(|x| x.to_f64());
        let t = if a <= b { m } else { [0, 3, 6, 1, 4, 7, 2, 5, 8].map(|i| m[i]) };
        add(&[a.min(b), a.max(b)], &t);
    };
    for row in rows.vertices.clone() {
        block(row, row, &tangent.matrix.diagonal[row as usize]);
    }
    for edge in rows.blocks.clone() {
        let [a, b] = topology.edges[edge as usize];
        block(a, b, &tangent.matrix.off_diagonal[edge as usize]);
    }
}

/// Everything that a body holds and gives.
fn snapshot<S: Scalar>(world: &mut World, body: usize) -> BTreeMap<&'static str, Values> {
    let mut all: BTreeMap<&'static str, Values> = BTreeMap::new();
    let Some(rows) = world.resource::<Topology>().bodies.get(body).cloned() else { return all };
    let user = |row: u32| rows.vertex_order[(row - rows.vertices.start) as usize];
    let mut add = |name, key: &[u32], values: &[f64]| {
        all.entry(name).or_default().insert(key.to_vec(), values.to_vec());
    };
    let kinds = [
        (TangentKind::Exact, "exact tangent"),
        (TangentKind::GaussNewton, "Gauss-Newton tangent"),
        (TangentKind::Projected, "projected tangent"),
    ];
    for (kind, name) in kinds {
        world.insert_resource(EvaluationRequest { energy: true, force: true, tangent: Some(kind) });
        world.run_schedule(ForceSchedule);
        tangent_blocks::<S>(world, &rows, &mut |key, block| add(name, key, block));
    }
    if has_dampers(world) {
        evaluate_dampers::<S>(world);
        tangent_blocks::<S>(world, &rows, &mut |key, block| add("damping", key, block));
    }
    let energy = world.resource::<ElasticEnergy>().by_body[body];
    add("energy", &[], &[energy]);
    let mut vertices = world.query::<(&Mass<S>, &ElasticForce<S>)>();
    if let Some((mass, force)) = single_table(vertices.contiguous_iter(world)) {
        for row in rows.vertices.clone() {
            add("mass", &[user(row)], &[mass[row as usize].0.to_f64()]);
            let force = force[row as usize].0.map(|x| x.to_f64());
            add("force", &[user(row)], &force[..3]);
        }
    }
    let mut tetrahedra = world.query::<(
        &BodyId,
        &TetrahedronVertices,
        ShapeGradients<S>,
        &RestVolume<S>,
        (&FirstLameParameter<S>, &ShearModulus<S>, &CompressionModulus<S>),
    )>();
    for (id, nodes, (d1, d2, d3), volume, (lambda, mu, compression)) in tetrahedra.iter(world) {
        if id.0 as usize != body {
            continue;
        }
        let nodes = nodes.0.map(user);
        let mut key = nodes;
        key.sort_unstable();
        let d = [[d1.0.0, d1.1.0, d1.2.0], [d2.0.0, d2.1.0, d2.2.0], [d3.0.0, d3.1.0, d3.2.0]]
            .map(|d| d.map(|x| x.to_f64()));
        let mut by_vertex = Vec::new();
        for v in key {
            let local = nodes.iter().position(|&n| n == v).unwrap_or(0);
            by_vertex.extend((0..3).map(|x| match local {
                0 => -(d[0][x] + d[1][x] + d[2][x]),
                a => d[a - 1][x],
            }));
        }
        add("shape vectors", &key, &by_vertex);
        add("volume", &key, &[volume.0.to_f64()]);
        let moduli = [lambda.0.to_f64(), mu.0.to_f64(), compression.0.to_f64()];
        add("moduli", &key, &moduli);
    }
    let mut membrane = world.query::<(
        &BodyId,
        &MembraneVertices,
        MembraneRest<S>,
        &MembraneFirstModulus<S>,
        &MembraneShearModulus<S>,
        &MembraneCompressionModulus<S>,
    )>();
    for (id, nodes, (a, b, area), lambda, mu, compression) in membrane.iter(world) {
        // removed ones are drawn together into one vertex
        if id.0 as usize != body || nodes.0[0] == nodes.0[1] {
            continue;
        }
        // rest vectors of its edges by the user's order of vertices
        let nodes = nodes.0.map(user);
        let mut key = nodes;
        key.sort_unstable();
        let e = [[S::ZERO; 3], [a.0.0, a.1.0, a.2.0], [b.0.0, b.1.0, b.2.0]];
        let at = |v: u32| e[nodes.iter().position(|&n| n == v).unwrap_or(0)].map(|x| x.to_f64());
        let points = key.map(at);
        let sides = [1, 2].map(|i| [0, 1, 2].map(|k| points[i][k] - points[0][k]));
        add("membrane edges", &key, sides.as_flattened());
        add("area", &key, &[area.0.to_f64()]);
        let moduli = [lambda.0, mu.0, compression.0].map(|x| x.to_f64());
        add("membrane moduli", &key, &moduli);
    }
    let mut hexahedra = world.query::<(
        &BodyId,
        &HexahedronVertices,
        &HexahedronRest<S>,
        &RestVolume<S>,
        (&FirstLameParameter<S>, &ShearModulus<S>, &CompressionModulus<S>),
    )>();
    for (id, nodes, rest, volume, (lambda, mu, compression)) in hexahedra.iter(world) {
        // removed ones have no volume
        if id.0 as usize != body || volume.0 == S::ZERO {
            continue;
        }
        let mut key = nodes.0.map(user);
        key.sort_unstable();
        let gradients = rest.gradients.as_flattened().iter().map(|x| x.to_f64());
        add("hexahedron gradients", &key, &gradients.collect::<Vec<_>>());
        add("hexahedron volumes", &key, &rest.volume.map(|x| x.to_f64()));
        let moduli = [volume.0, lambda.0, mu.0, compression.0].map(|x| x.to_f64());
        add("hexahedron moduli", &key, &moduli);
    }
    let mut quads = world.query::<(
        &BodyId,
        &QuadVertices,
        &QuadRest<S>,
        &MembraneFirstModulus<S>,
        &MembraneShearModulus<S>,
        &MembraneCompressionModulus<S>,
    )>();
    for (id, nodes, rest, lambda, mu, compression) in quads.iter(world) {
        // removed ones are drawn together into one vertex
        if id.0 as usize != body || nodes.0[0] == nodes.0[1] {
            continue;
        }
        let mut key = nodes.0.map(user);
        key.sort_unstable();
        let edges = rest.edges.as_flattened().iter().map(|x| x.to_f64());
        add("quadrilateral edges", &key, &edges.collect::<Vec<_>>());
        add("quadrilateral areas", &key, &rest.half_area.map(|x| x.to_f64()));
        let moduli = [lambda.0, mu.0, compression.0].map(|x| x.to_f64());
        add("quadrilateral moduli", &key, &moduli);
    }
    let mut volumetric = world.query::<(
        &BodyId,
        &TetrahedronVertices,
        &VolumetricStiffness<S, 0>,
        &VolumetricStiffness<S, 1>,
        &VolumetricStiffness<S, 2>,
    )>();
    for (id, nodes, a, b, c) in volumetric.iter(world) {
        if id.0 as usize != body {
            continue;
        }
        let nodes = nodes.0.map(user);
        let mut key = nodes;
        key.sort_unstable();
        // a pair of opposite edges is named by the partner of the lowest vertex
        let mut pairs: Vec<(u32, f64)> = [a.0, b.0, c.0]
            .iter()
            .zip(TETRAHEDRON_EDGES)
            .map(|(d, [_, partner])| {
                let own = [nodes[0], nodes[partner]];
                let rest: Vec<u32> = nodes.iter().copied().filter(|n| !own.contains(n)).collect();
                let name = match own.iter().position(|&n| n == key[0]) {
                    Some(at) => own[1 - at],
                    None => rest.into_iter().find(|&n| n != key[0]).unwrap_or(0),
                };
                (name, d.to_f64())
            })
            .collect();
        pairs.sort_unstable_by_key(|p| p.0);
        add("volumetric stiffness", &key, &pairs.iter().map(|p| p.1).collect::<Vec<_>>());
    }
    let mut edges =
        world
            .query::<(&BodyId, &EdgeVertices, RestEdges<S>, &TensileStiffness<S>, Has<MassSpring>)>(
            );
    for (id, edge, (x, y, z), k, alone) in edges.iter(world) {
        // an edge without elements keeps its rest vector
        if id.0 as usize == body && k.0 != S::ZERO {
            let [a, b] = edge.0.map(user);
            let sign = if a < b { 1.0 } else { -1.0 };
            let rest = [x.0, y.0, z.0].map(|x| sign * x.to_f64());
            add("rest edges", &[a.min(b), a.max(b)], &rest);
            let name = if alone { "mass-spring stiffness" } else { "tensile stiffness" };
            add(name, &[a.min(b), a.max(b)], &[k.0.to_f64()]);
        }
    }
    let mut triangles = world.query::<(
        &BodyId,
        &TriangleVertices,
        &AngularStiffness<S, 0>,
        &AngularStiffness<S, 1>,
        &AngularStiffness<S, 2>,
    )>();
    for (id, nodes, a, b, c) in triangles.iter(world) {
        if id.0 as usize == body {
            let mut values: Vec<(u32, f64)> =
                nodes.0.map(user).into_iter().zip([a.0, b.0, c.0].map(|x| x.to_f64())).collect();
            values.sort_unstable_by_key(|v| v.0);
            let key: Vec<u32> = values.iter().map(|v| v.0).collect();
            add("angular stiffness", &key, &values.iter().map(|v| v.1).collect::<Vec<_>>());
        }
    }
    all
}
