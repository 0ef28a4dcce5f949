//! Holds a body that was cut or lost elements against one that is built anew from what is left.

use super::columns::{AtRemoval, Order, Quantity, quantities};
use super::region::Region;
use super::remove::{Removal, remove_elements};
use crate::axes::columns::{
    AxisAngleStiffness, Biquadratic, FibreActive, PooledBiquadratic, PooledSheetBiquadratic,
    SheetBiquadratic, VolumeAlone,
};
use crate::axes::muscle::{Muscles, copy_activations};
use crate::body::description::{BodyDescription, BodyError, SoftBody};
use crate::body::present::Resection;
use crate::body::sheet::MembraneDescription;
use crate::body::spawn::spawn_body;
use crate::cutting::{divide_alike, glue};
use crate::frame::moduli::ClusterIndex;
use crate::frame::row::ElementRows;
use crate::frame::rules::VolumeRule;
use crate::laws::pooled::TriangleVertices;
use crate::laws::pressure;
use crate::laws::quadratic::MassSpring;
use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryFilter;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::compiled_here;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::element::{
    AxisVertices, EdgeVertices, MembraneVertices, TetrahedronIndex, TetrahedronVertices,
};
use sinew_engine::isoparametric::{
    AxisHexahedronVertices, AxisTetrahedron10Vertices, HexahedronVertices, QuadVertices,
    Tetrahedron10Vertices,
};
use sinew_engine::law::{ElasticEnergy, EvaluationRequest, RecoveringBodies, TangentKind};
use sinew_engine::load::{LoadTime, Pressure};
use sinew_engine::matrix::Tangent;
use sinew_engine::mesh::Mesh;
use sinew_engine::row::{LocalRow, VertexRow};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{Executor, ForceSchedule, evaluate_dampers, has_dampers};
use sinew_engine::step::install_engine;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{BodyId, Displacement, ElasticForce, Mass, RestPosition, WeightShift};
use std::collections::BTreeMap;

/// Largest difference of each quantity, over its largest value in the new body (or in the old one,
/// if that is larger).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FreshDifference {
    /// Lumped masses; equal only as long as removals recompute them.
    pub mass: f64,
    /// Everything else by name: columns, energy, forces, and the three tangents.
    pub others: Vec<(&'static str, f64)>,
    /// Where the largest of the others is: quantity, element, and what old and new body hold.
    pub place: String,
}

impl FreshDifference {
    /// Largest difference, masses left out; NaN if any difference is NaN.
    pub fn largest(&self) -> f64 {
        let larger = |most: f64, (_, x): &(_, f64)| if *x <= most { most } else { *x };
        // a comparison with NaN is false, so it stays
        self.others.iter().fold(0.0, |most, x| if most.is_nan() { most } else { larger(most, x) })
    }
}

/// What has the values: its kind, the user's indices of its vertices in ascending order, and how many of the
/// same kind and vertices came before.
type Key = (&'static str, Vec<u32>, usize);
/// Values of a quantity.
type Values = BTreeMap<Key, Vec<f64>>;
/// Values of all quantities.
type Snapshot = BTreeMap<&'static str, Values>;

/// Compares everything that a body holds (masses, rest shapes, moduli, pooled constants, axes) and gives at
/// the present state (energy, forces, tangents) with a body built anew from the elements left, under the
/// same pressures. A body that was cut is compared with one of the same copies: a whole body, divided at once into the
/// shares that its copies have. Points of parted hexahedra depend on the cuts one by one, so that those that were cut
/// again have others there. For tests and doubts: it builds that body.
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
    let Some(soft) = world.query::<&SoftBody>().iter(world).find(|b| b.index == body).cloned()
    else {
        return Ok(FreshDifference::default());
    };
    let resection = world.get_resource::<Resection>();
    let own = resection.and_then(|all| all.bodies.get(body)?.as_ref());
    let material = own.and_then(|own| own.material.clone());
    let (mut mesh, [index, triangles]) = what_is_left(world, body, &rows);
    let mut own = world.query::<(&TetrahedronIndex, &BodyId, &ClusterIndex)>();
    let own = own.iter(world).filter(|(_, id, _)| id.0 as usize == body);
    let cluster: BTreeMap<u32, u32> = own.map(|(index, _, own)| (index.0, own.0)).collect();
    let of_tetrahedra = index[..mesh.tetrahedra.len()].iter();
    let clusters: Option<Vec<u32>> =
        of_tetrahedra.map(|&index| cluster.get(&(index as u32)).copied()).collect();
    let clusters = clusters.filter(|_| soft.volume == VolumeRule::Clusters);
    let mut vertices = world.query::<(&RestPosition, &Displacement<S>)>();
    let nodes = rows.mesh_vertices() + rows.copies.ghosts.len();
    let mut displacement = vec![Displacement::<S>::default(); nodes];
    if let Some((rest, u)) = single_table(vertices.contiguous_iter(world)) {
        for (node, row) in nodes_and_rows(&rows) {
            if let Some(point) = mesh.points.get_mut(node as usize) {
                *point = rest[row.index()].0;
            }
            displacement[node as usize] = u[row.index()];
        }
    }
    let mut fresh = World::new();
    install_engine::<S>(&mut fresh, Executor::SingleThreaded);
    if !(index.is_empty() && mesh.triangles.is_empty() && mesh.quads.is_empty()) {
        let index = [&index[..], &triangles];
        let spare = rows.spare;
        spawn_again(&mut fresh, &soft, (&mesh, clusters.as_deref(), spare), index)?;
        if let Some(material) = &material {
            glue::sweep_alike(world, body, &mut fresh);
            divide_alike::<S>(&mut fresh, 0, material);
        }
        copy_state(world, &mut fresh, body, &displacement);
        if material.is_some() {
            lose_alike::<S>(world, &mut fresh, (body, &rows), &cluster);
        }
    }
    let recovers = world.get_resource::<RecoveringBodies>().is_some_and(|r| r.contains(body));
    fresh.insert_resource(RecoveringBodies(vec![recovers]));
    let (old, new) = (snapshot::<S>(world, body), snapshot::<S>(&mut fresh, 0));
    Ok(difference(&old, &new, spread(&displacement)))
}

/// Takes from a body that was divided like another one what that has lost, and gives its tetrahedra the clusters of that.
fn lose_alike<S: Scalar>(
    world: &World,
    fresh: &mut World,
    (body, rows): (usize, &BodyRows),
    cluster: &BTreeMap<u32, u32>,
) {
    let connectivity = world.get_resource::<Resection>().and_then(|r| r.connectivity(body));
    for kind in [rows.copies.kind, ElementKind::Triangle] {
        let is_gone = |e: u32| connectivity.is_some_and(|own| !own.is_present(kind, e));
        let gone = (0..).zip(&rows.order[kind]).filter(|(e, _)| is_gone(*e)).map(|(_, own)| *own);
        let gone: Vec<u32> = gone.collect();
        let region = match kind {
            ElementKind::Hexahedron => Region::Hexahedra(gone),
            ElementKind::Triangle => Region::Triangles(gone),
            _ => Region::Tetrahedra(gone),
        };
        // whatever it could not do is a difference
        let _ = remove_elements::<S>(fresh, 0, &Removal::new(region));
    }
    let mut labels = fresh.query::<(&TetrahedronIndex, &mut ClusterIndex)>();
    for (index, mut label) in labels.iter_mut(fresh) {
        label.0 = cluster.get(&index.0).copied().unwrap_or(label.0);
    }
}

/// The elements left, by the user's vertices, and the user's indices of the solid ones, hexahedra counted
/// after tetrahedra, and of the triangles.
fn what_is_left(world: &World, body: usize, rows: &BodyRows) -> (Mesh, [Vec<usize>; 2]) {
    let resection = world.get_resource::<Resection>();
    let connectivity = resection.and_then(|r| r.connectivity(body));
    // of a body that was cut all elements
    let is_cut = !rows.copies.portions.is_empty();
    let left = |kind: ElementKind| {
        let is_left = move |e: &u32| is_cut || connectivity.is_none_or(|c| c.is_present(kind, *e));
        let count = rows.mesh_elements(kind);
        // as they are numbered in the mesh, which is how the material knows them
        let all = if is_cut { rows.rows_of(kind) } else { (0..count as u32).collect() };
        all.into_iter().take(count).filter(is_left).map(|e| e as usize)
    };
    let user = |v: u32| rows.vertex_of(LocalRow(v)).0;
    let (tetrahedra, hexahedra) = (left(ElementKind::Tetrahedron), left(ElementKind::Hexahedron));
    let first = rows.mesh_elements(ElementKind::Tetrahedron);
    let index = tetrahedra.clone().map(|t| rows.order.tetrahedra[t] as usize);
    let index =
        index.chain(hexahedra.clone().map(|h| first + rows.order.hexahedra[h] as usize)).collect();
    let corners = |t: usize| match rows.tetrahedra10().get(t) {
        Some(&[a, b, c, d, ..]) => [a, b, c, d],
        None => rows.tetrahedra()[t],
    };
    let mesh = Mesh {
        points: vec![DVec3::ZERO; rows.mesh_vertices()],
        tetrahedra: tetrahedra.clone().map(|t| corners(t).map(user)).collect(),
        middles: match rows.tetrahedra10().is_empty() {
            true => Vec::new(),
            false => tetrahedra
                .map(|t| [4, 5, 6, 7, 8, 9].map(|i| user(rows.tetrahedra10()[t][i])))
                .collect(),
        },
        hexahedra: hexahedra.map(|h| rows.hexahedra()[h].map(user)).collect(),
        triangles: left(ElementKind::Triangle).map(|t| rows.triangles()[t].map(user)).collect(),
        quads: left(ElementKind::Quad).map(|q| rows.quads()[q].map(user)).collect(),
        ..Mesh::default()
    };
    let triangles = left(ElementKind::Triangle).map(|t| rows.order.triangles[t] as usize);
    (mesh, [index, triangles.collect()])
}

/// Spawns a body of a mesh that is like `soft`; `index` are the places of its solid elements, and of its triangles, in the
/// arrays of that.
fn spawn_again(
    fresh: &mut World,
    soft: &SoftBody,
    (mesh, clusters, spare): (&Mesh, Option<&[u32]>, usize),
    [index, triangles]: [&[usize]; 2],
) -> Result<Entity, BodyError> {
    let fibres: Vec<_> = soft.sheet_fibres.iter().map(|own| own.of_elements(triangles)).collect();
    let field = soft.field();
    let pick = |array: Option<&[f64]>| -> Option<Vec<f64>> {
        array.map(|values| index.iter().map(|&t| values[t]).collect())
    };
    let (young, poisson, density) =
        (pick(field.young_modulus), pick(field.poisson_ratio), pick(field.density));
    let axes = soft.axes.as_ref().filter(|_| !index.is_empty());
    let description = BodyDescription {
        young_modulus: young.as_deref(),
        poisson_ratio: poisson.as_deref(),
        density: density.as_deref(),
        model: soft.model,
        evaluation: soft.evaluation,
        volume: soft.volume,
        integration: soft.integration,
        clusters,
        spare,
        glue: soft.glue.map_or(0.0, |glue| glue.factor),
        membrane: soft
            .membrane
            .as_ref()
            .map(|m| MembraneDescription { fibres: &fibres, ..m.of(&mesh.triangles, &mesh.quads) }),
        springs: soft.spring_rule,
        spring_constants: soft.given.clone(),
        masses: soft.masses,
        axes: axes.map(|axes| axes.description.of_elements(index)),
        ..BodyDescription::new("fresh", mesh, soft.material)
    };
    spawn_body(fresh, &description)
}

/// Gives the new body displacements (m, by the user's vertices), activations and pressures of the old one.
fn copy_state<S: Scalar>(
    world: &mut World,
    fresh: &mut World,
    body: usize,
    displacement: &[Displacement<S>],
) {
    if let Some(muscles) = world.get_resource::<Muscles>() {
        let own = muscles.iter().filter(|m| m.body == body);
        let activations: Vec<_> = own.map(|m| (m.family.clone(), m.activation())).collect();
        copy_activations::<S>(fresh, &activations);
    }
    let new = fresh.resource::<Topology>().bodies[0].clone();
    let mut pressures = world.query::<(Entity, &Pressure)>();
    let rows = &world.resource::<Topology>().bodies[body];
    let row = |row: VertexRow| new.row(rows.vertex(row)).unwrap_or_default();
    let own = |p: &Pressure| p.faces.iter().all(|face| rows.local(face[0]).is_some());
    let moved = |p: &Pressure| {
        let faces = p.faces.iter().map(|face| face.map(row)).collect();
        Pressure { faces, ..p.clone() }
    };
    let pressures = pressures.iter(world).filter(|(_, p)| own(p));
    let mut pressures: Vec<_> = pressures.map(|(entity, p)| (entity, moved(p))).collect();
    pressures.sort_unstable_by_key(|(entity, _)| *entity);
    if !pressures.is_empty() {
        fresh.spawn_batch(pressures.into_iter().map(|(_, p)| p).collect::<Vec<_>>());
        pressure::activate::<S>(fresh);
        let time = world.get_resource::<LoadTime>().map_or(0.0, |time| time.0);
        fresh.insert_resource(LoadTime(time));
    }
    let mut vertices = fresh.query::<&mut Displacement<S>>();
    if let Some(mut u) = single_table(vertices.contiguous_iter_mut(fresh)) {
        for (node, row) in nodes_and_rows(&new) {
            u[row.index()] = displacement[node as usize];
        }
    }
}

/// Part of stiffness times displacement to which forces and energies are compared at least.
const ROUNDED: f64 = 1e-3;

/// Differences of all quantities; displacements have the extent `reach` (m).
fn difference(old: &Snapshot, new: &Snapshot, reach: f64) -> FreshDifference {
    let none = Values::new();
    // forces of a body that is turned but hardly strained are small differences of large numbers
    let stiffness = size(old.get("exact tangent").unwrap_or(&none));
    let mut difference = FreshDifference::default();
    let mut largest = 0.0;
    for name in old.keys().chain(new.keys().filter(|name| !old.contains_key(*name))) {
        let [a, b] = [old, new].map(|values| values.get(name).unwrap_or(&none));
        let least = match *name {
            "force" => ROUNDED * stiffness * reach,
            "energy" => ROUNDED * stiffness * reach * reach,
            _ => 0.0,
        };
        let (x, key) = largest_difference(a, b, least);
        if *name == "mass" {
            difference.mass = x;
            continue;
        }
        difference.others.push((name, x));
        if let Some(key @ (kind, vertices, _)) = key.filter(|_| x > largest || x.is_nan()) {
            largest = x;
            let [old, new] = [a, b].map(|values| values.get(key));
            difference.place = format!("{name} of {kind} {vertices:?}: {old:?}, new {new:?}");
        }
    }
    difference
}

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

/// Over the largest value of either, or `least`, and where it is. What one has and the other has not counts
/// as zero there.
fn largest_difference<'a>(a: &'a Values, b: &'a Values, least: f64) -> (f64, Option<&'a Key>) {
    let (mut largest, mut place) = (0.0_f64, None);
    for (key, x) in a.iter().chain(b) {
        let other = |v: &Values, i: usize| v.get(key).map_or(0.0, |v| v[i]);
        for i in 0..x.len() {
            let difference = (other(a, i) - other(b, i)).abs();
            // what is not a number must not pass
            if difference > largest || difference.is_nan() {
                (largest, place) = (difference, Some(key));
            }
        }
    }
    let size = size(a).max(size(b)).max(least);
    (if size > 0.0 { largest / size } else { largest }, place)
}

/// What a row is: a vertex of the mesh, or a ghost, which are numbered after all of these.
fn node_of(rows: &BodyRows, row: u32) -> u32 {
    let ghost = (row - rows.vertices.start).checked_sub(rows.vertex_order.len() as u32);
    ghost.map_or(rows.vertex(VertexRow(row)).0, |ghost| rows.mesh_vertices() as u32 + ghost)
}

/// All vertices and ghosts with their rows.
fn nodes_and_rows(rows: &BodyRows) -> impl Iterator<Item = (u32, VertexRow)> + Clone {
    let count = (rows.vertex_order.len() + rows.copies.ghosts.len()) as u32;
    let all = rows.vertices.start..rows.vertices.start + count;
    all.map(|row| (node_of(rows, row), VertexRow(row)))
}

/// The blocks of the world's tangent that belong to a body, by the user's vertices.
fn tangent_blocks<S: Scalar>(world: &World, rows: &BodyRows) -> Values {
    let user = |row: u32| node_of(rows, row);
    let (topology, tangent) = (world.resource::<Topology>(), world.resource::<Tangent<S>>());
    let block = |a: u32, b: u32, m: &[S; 9]| {
        let (a, b) = (user(a), user(b));
        let m = m.map(|x| x.to_f64());
        let t = if a <= b { m } else { [0, 3, 6, 1, 4, 7, 2, 5, 8].map(|i| m[i]) };
        (("vertices", vec![a.min(b), a.max(b)], 0), t.to_vec())
    };
    let matrix = &tangent.matrix;
    let diagonal = rows.vertices.clone().map(|v| block(v, v, &matrix.diagonal[v as usize]));
    let others = rows.blocks.clone().map(|edge| {
        let [a, b] = topology.edges[edge as usize];
        block(a, b, &matrix.off_diagonal[edge as usize])
    });
    diagonal.chain(others).collect()
}

/// Everything that a body holds and gives.
fn snapshot<S: Scalar>(world: &mut World, body: usize) -> Snapshot {
    let mut all = Snapshot::new();
    let Some(rows) = world.resource::<Topology>().bodies.get(body).cloned() else { return all };
    let kinds = [
        (TangentKind::Exact, "exact tangent"),
        (TangentKind::GaussNewton, "Gauss-Newton tangent"),
        (TangentKind::Projected, "projected tangent"),
    ];
    for (kind, name) in kinds {
        world.insert_resource(EvaluationRequest { energy: true, force: true, tangent: Some(kind) });
        world.run_schedule(ForceSchedule);
        all.insert(name, tangent_blocks::<S>(world, &rows));
    }
    if has_dampers(world) {
        evaluate_dampers::<S>(world);
        all.insert("damping", tangent_blocks::<S>(world, &rows));
    }
    let energy = world.resource::<ElasticEnergy>().by_body[body];
    all.insert("energy", Values::from([(("body", Vec::new(), 0), vec![energy])]));
    let mut vertices = world.query::<(&Mass<S>, &WeightShift<S>, &ElasticForce<S>)>();
    if let Some((mass, shift, force)) = single_table(vertices.contiguous_iter(world)) {
        let own = nodes_and_rows(&rows);
        let own = own.map(|(node, row)| (row.index(), ("vertex", vec![node], 0)));
        let masses = own.clone().map(|(row, key)| (key, vec![mass[row].0.to_f64()]));
        all.insert("mass", masses.collect());
        let shifts = own.clone().map(|(row, key)| (key, vec![shift[row].0.to_f64()]));
        all.insert("weight", shifts.collect());
        let forces = own.map(|(row, key)| (key, force[row].0[..3].iter().map(|x| x.to_f64())));
        all.insert("force", forces.map(|(key, force)| (key, force.collect())).collect());
    }
    let of = Elements { rows: &rows, id: BodyId(body as u32), quantities: quantities::<S>() };
    of.add::<EdgeVertices, With<MassSpring>>(world, "spring", &mut all);
    of.add::<EdgeVertices, Without<MassSpring>>(world, "edge", &mut all);
    of.add::<TriangleVertices, ()>(world, "triangle", &mut all);
    of.add::<TetrahedronVertices, ()>(world, "tetrahedron", &mut all);
    of.add::<HexahedronVertices, ()>(world, "hexahedron", &mut all);
    of.add::<Tetrahedron10Vertices, ()>(world, "ten-node tetrahedron", &mut all);
    of.add::<MembraneVertices, ()>(world, "membrane triangle", &mut all);
    of.add::<QuadVertices, ()>(world, "membrane quadrilateral", &mut all);
    of.add_axes::<AxisVertices, S>(world, &mut all);
    of.add::<AxisVertices, Or<(With<SheetBiquadratic>, With<PooledSheetBiquadratic>)>>(
        world,
        "fibre of a membrane in",
        &mut all,
    );
    of.add_axes::<AxisHexahedronVertices, S>(world, &mut all);
    of.add_axes::<AxisTetrahedron10Vertices, S>(world, &mut all);
    all
}

/// Elements of a body whose quantities are added to a snapshot.
struct Elements<'a> {
    rows: &'a BodyRows,
    id: BodyId,
    quantities: Vec<Quantity>,
}

impl Elements<'_> {
    fn add_axes<C: ElementRows, S: Scalar>(&self, world: &mut World, all: &mut Snapshot) {
        self.add::<C, With<AxisAngleStiffness<S, 0>>>(world, "axes in", all);
        self.add::<C, With<FibreActive<S>>>(world, "fibre in", all);
        self.add::<C, Or<(With<Biquadratic>, With<PooledBiquadratic>)>>(
            world,
            "biquadratic fibre in",
            all,
        );
        self.add::<C, With<VolumeAlone>>(world, "volume of", all);
    }

    /// Adds those of one table; `kind` is its name. An element without any number that a removal would clear
    /// is gone.
    fn add<C: ElementRows, F: QueryFilter>(
        &self,
        world: &mut World,
        kind: &'static str,
        all: &mut Snapshot,
    ) {
        let mut elements = world.query_filtered::<(EntityRef, &BodyId, &C), F>();
        for (entity, _, nodes) in elements.iter(world).filter(|(_, id, _)| **id == self.id) {
            let nodes = nodes.vertex_rows().iter().map(|&row| node_of(self.rows, row));
            let mut nodes: Vec<u32> = nodes.collect();
            // fibres in triangles have their last vertex twice
            nodes.dedup();
            let mut key = (kind, nodes.clone(), 0);
            key.1.sort_unstable();
            let held = self.quantities.iter().map(|quantity| {
                let mut numbers = Vec::new();
                (quantity.read)(entity, &mut numbers);
                (quantity, numbers)
            });
            let held: Vec<_> = held.filter(|(_, numbers)| !numbers.is_empty()).collect();
            let mut cleared = held.iter().filter(|(q, _)| q.at_removal == AtRemoval::Cleared);
            if cleared.all(|(_, numbers)| numbers.iter().all(|&x| x == 0.0)) {
                continue;
            }
            for (quantity, numbers) in held {
                let values = all.entry(quantity.name).or_default();
                key.2 = 0;
                while values.contains_key(&key) {
                    key.2 += 1;
                }
                values.insert(key.clone(), arranged(quantity.order, &nodes, &key.1, &numbers));
            }
        }
    }
}

/// Numbers of an element with the vertices `nodes` as they would be with the vertices `key`, the same in
/// ascending order.
fn arranged(order: Order, nodes: &[u32], key: &[u32], numbers: &[f64]) -> Vec<f64> {
    let place = |v: &u32| nodes.iter().position(|n| n == v).unwrap_or(0);
    // of vertices after the first
    let size = numbers.len() / (nodes.len() - 1);
    let entry = |a: usize, x: usize| numbers[(a - 1) * size + x];
    let vectors = |first: &dyn Fn(usize) -> f64| -> Vec<f64> {
        let vector = |v| (0..size).map(move |x| (place(v), x));
        let entries = key.iter().flat_map(vector);
        entries.map(|(a, x)| if a == 0 { first(x) } else { entry(a, x) }).collect()
    };
    match order {
        Order::Fixed => numbers.to_vec(),
        Order::Vertices => key.iter().map(|v| numbers[place(v)]).collect(),
        Order::Gradients => vectors(&|x| -(1..nodes.len()).map(|a| entry(a, x)).sum::<f64>()),
        Order::Edges => {
            let points = vectors(&|_| 0.0);
            (size..points.len()).map(|i| points[i] - points[i % size]).collect()
        }
        // named by the partner of the lowest vertex; number i is that of edge 0, i + 1 and the opposite one
        Order::OppositeEdges => {
            let pairs = key[1..].iter().map(|v| match (place(&key[0]), place(v)) {
                (0, b) => b - 1,
                (a, 0) => a - 1,
                (a, b) => 5 - a - b,
            });
            pairs.map(|i| numbers[i]).collect()
        }
    }
}
