//! Biquadratic springs pooled over the mesh (Delingette 2008, section 3): one tensile spring per
//! edge, three angular springs per triangle, three volumetric springs per tetrahedron, whose
//! constants are sums over the adjacent tetrahedra.
//!
//! Every spring is a law on changes of squared edge length `delta`, so the pipeline works on
//! scalars:
//!
//! 1. `measure_edges` writes `delta` per edge;
//! 2. `evaluate_tensile`, `evaluate_angular`, `evaluate_volumetric` (and the compression term of
//!    [`crate::fused::Compression`]) each read it and write tensions into their own column. They
//!    share nothing they write, so they may run in any order or side by side;
//! 3. `collect_tension` adds the tensions `s_e = dW/d delta_e` per edge in a fixed order;
//! 4. `evaluate_spring_forces` turns tension into forces `f_a = -2 sum s_e (x_a - x_b)`.
//!
//! Each law also gives its share of the tangent `K = J^T B J + 2 L(s) (x) I`, where row e of `J` is
//! `2 (x_a - x_b)^T` at a and the negative at b, and `L(s)` is the graph Laplacian with weights `s`.

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use sinew_engine::columns::single_table;
use sinew_engine::element::{
    EdgeBlock, EdgeChange, EdgeTension, EdgeVertices, RestEdge, TETRAHEDRON_EDGES,
    TetrahedronEdges, TetrahedronVertices, TriangleEdges,
};
use sinew_engine::law::{EvaluationRequest, Law, LawBuffer, Span, TangentKind};
use sinew_engine::report::SystemTimes;
use sinew_engine::scalar::{Scalar, add, sub, xyz};
use sinew_engine::schedule::{
    ForceSystems, activate_law, activate_systems, column_changed, declare_inputs,
};
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::time::Instant;

use crate::precompute::OPPOSITE_EDGES;
use crate::spring::{
    coupling_energy, coupling_tensions, edge_force, squared_length_change, tensile_energy,
    tensile_tension,
};

/// Vertex rows of a triangle, ascending.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct TriangleVertices(pub [u32; 3]);

/// Tensile stiffness `k` of an edge (N/m^3).
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct TensileStiffness<S: Scalar>(pub S);

/// Tension (N/m) of the tensile spring of an edge.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct TensileTension<S: Scalar>(pub S);

/// Angular stiffnesses of a triangle (N/m^3): entry `m` couples the two edges that meet at vertex `m`.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct AngularStiffness<S: Scalar>(pub [S; 3]);

/// Tensions (N/m) that the angular springs of a triangle add to its edges.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct AngularTension<S: Scalar>(pub [S; 3]);

/// Volumetric stiffnesses `d` of a tetrahedron (N/m^3), one per pair of opposite edges.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct VolumetricStiffness<S: Scalar>(pub [S; 3]);

/// Tensions (N/m) that the volumetric springs of a tetrahedron add to its edges.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct VolumetricTension<S: Scalar>(pub [S; 6]);

/// Which triangles and tetrahedra contain each edge, in compressed rows.
#[derive(Resource, Clone, Debug)]
pub struct EdgeIncidence {
    /// First entry of each edge in `triangles`.
    pub triangle_start: Vec<u32>,
    /// `3 * triangle row + local edge`.
    pub triangles: Vec<u32>,
    /// First entry of each edge in `tetrahedra`.
    pub tetrahedron_start: Vec<u32>,
    /// `6 * tetrahedron row + local edge`.
    pub tetrahedra: Vec<u32>,
}

impl Default for EdgeIncidence {
    fn default() -> Self {
        Self {
            triangle_start: vec![0],
            triangles: Vec::new(),
            tetrahedron_start: vec![0],
            tetrahedra: Vec::new(),
        }
    }
}

macro_rules! law {
    ($(#[$doc:meta])* $name:ident, $text:literal, $order:literal) => {
        $(#[$doc])*
        pub struct $name;
        impl Law for $name {
            const NAME: &'static str = $text;
            const ORDER: u8 = $order;
        }
    };
}
law!(
    /// Tensile springs on edges: energy and tangent.
    Tensile, "tensile springs", 1
);
law!(
    /// Angular springs in triangles: energy and tangent.
    Angular, "angular springs", 2
);
law!(
    /// Volumetric springs in tetrahedra: energy and tangent.
    Volumetric, "volumetric springs", 3
);
law!(
    /// Edge tensions of all springs turned into forces.
    SpringForces, "spring forces", 4
);

/// Puts the spring laws into the force schedule.
pub fn activate<S: Scalar>(world: &mut World) {
    world.init_resource::<EdgeIncidence>();
    activate_systems(world, EDGE_CHANGES, |schedule| {
        schedule.add_systems((
            measure_edges::<S>.in_set(ForceSystems::Measure),
            collect_tension::<S>.in_set(ForceSystems::Collect),
        ));
    });
    activate_law::<Tensile, S>(world, |schedule| {
        schedule.add_systems(evaluate_tensile::<S>.in_set(ForceSystems::Evaluate));
    });
    activate_law::<Angular, S>(world, |schedule| {
        schedule.add_systems(evaluate_angular::<S>.in_set(ForceSystems::Evaluate));
    });
    activate_law::<Volumetric, S>(world, |schedule| {
        schedule.add_systems(evaluate_volumetric::<S>.in_set(ForceSystems::Evaluate));
    });
    activate_law::<SpringForces, S>(world, |schedule| {
        schedule.add_systems(
            evaluate_spring_forces::<S>.in_set(ForceSystems::Collect).after(collect_tension::<S>),
        );
    });
    let edges = [column_changed::<EdgeVertices>, column_changed::<RestEdge<S>>];
    declare_inputs(world, EDGE_CHANGES, &edges);
    declare_inputs(world, SpringForces::NAME, &edges);
    declare_inputs(world, Tensile::NAME, &[column_changed::<TensileStiffness<S>>]);
    let triangles = [column_changed::<TriangleEdges>, column_changed::<AngularStiffness<S>>];
    declare_inputs(world, Angular::NAME, &triangles);
    let tetrahedra = [column_changed::<TetrahedronEdges>, column_changed::<VolumetricStiffness<S>>];
    declare_inputs(world, Volumetric::NAME, &tetrahedra);
}

/// Name of the systems that measure edges and collect their tensions.
const EDGE_CHANGES: &str = "edge changes";

const ROW_CHUNK: usize = 2048;

/// The part of the tangent that springs themselves give; the projected one is formed elsewhere.
fn spring_tangent(request: &EvaluationRequest) -> Option<TangentKind> {
    request.tangent.filter(|&kind| kind != TangentKind::Projected)
}

fn measure_edges<S: Scalar>(
    workers: Res<Workers>,
    vertices: Query<&Displacement<S>>,
    mut edges: Query<(&EdgeVertices, &RestEdge<S>, &mut EdgeChange<S>)>,
    mut times: ResMut<SystemTimes>,
) {
    let start = Instant::now();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let u = Displacement::peel_slice(u);
    let Some((nodes, rest, mut change)) = single_table(edges.contiguous_iter_mut()) else { return };
    let work = nodes.len() * 3;
    workers.for_chunks(change.bypass_change_detection(), ROW_CHUNK, work, |first, rows| {
        let range = first..first + rows.len();
        for ((delta, n), r) in rows.iter_mut().zip(&nodes[range.clone()]).zip(&rest[range]) {
            let [a, b] = n.0;
            delta.0 = squared_length_change(r.0, xyz(u[a as usize]), xyz(u[b as usize]));
        }
    });
    times.add("edge changes", start.elapsed());
}

fn evaluate_tensile<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    mut buffer: ResMut<LawBuffer<Tensile, S>>,
    vertices: Query<&Displacement<S>>,
    mut edges: Query<(
        &EdgeVertices,
        &EdgeBlock,
        &RestEdge<S>,
        &EdgeChange<S>,
        &TensileStiffness<S>,
        &mut TensileTension<S>,
    )>,
) {
    let start = Instant::now();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let u = Displacement::peel_slice(u);
    let Some((nodes, block, rest, change, stiffness, mut tension)) =
        single_table(edges.contiguous_iter_mut())
    else {
        return;
    };
    let tension = tension.bypass_change_detection();
    workers.for_chunks(tension, ROW_CHUNK, nodes.len(), |first, rows| {
        let range = first..first + rows.len();
        for ((t, k), delta) in rows.iter_mut().zip(&stiffness[range.clone()]).zip(&change[range]) {
            t.0 = tensile_tension(k.0, delta.0);
        }
    });
    let tension = &*tension;
    let kind = spring_tangent(&request);
    workers.for_each(&mut buffer.spans, nodes.len() * 4, |_, span| {
        if request.energy {
            let mut sum = 0.0;
            for i in span.elements.clone() {
                sum += tensile_energy(stiffness[i].0, change[i].0).to_f64();
            }
            span.energy = sum;
        }
        let Some(kind) = kind else {
            span.drop_tangent();
            return;
        };
        span.clear_tangent();
        for i in span.elements.clone() {
            let [a, b] = nodes[i].0;
            let d = add(rest[i].0, sub(xyz(u[a as usize]), xyz(u[b as usize])));
            let two_k = stiffness[i].0 + stiffness[i].0;
            let mut m = outer(two_k, d, d);
            if kind == TangentKind::Exact {
                add_identity(&mut m, tension[i].0 + tension[i].0);
            }
            span.add_diagonal(a, &m);
            span.add_diagonal(b, &m);
            span.add_off_diagonal(block[i].0, a, b, &m.map(|x| -x));
        }
    });
    buffer.time = start.elapsed();
}

fn evaluate_angular<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    mut buffer: ResMut<LawBuffer<Angular, S>>,
    vertices: Query<&Displacement<S>>,
    edges: Query<(&EdgeBlock, &RestEdge<S>, &EdgeChange<S>)>,
    mut triangles: Query<(
        &TriangleVertices,
        &TriangleEdges,
        &AngularStiffness<S>,
        &mut AngularTension<S>,
    )>,
) {
    let start = Instant::now();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let u = Displacement::peel_slice(u);
    let Some((block, rest, change)) = single_table(edges.contiguous_iter()) else { return };
    let Some((nodes, of, stiffness, mut tension)) = single_table(triangles.contiguous_iter_mut())
    else {
        return;
    };
    let tension = tension.bypass_change_detection();
    workers.for_chunks(tension, ROW_CHUNK, nodes.len() * 2, |first, rows| {
        let range = first..first + rows.len();
        for ((t, c), e) in rows.iter_mut().zip(&stiffness[range.clone()]).zip(&of[range]) {
            let delta = e.0.map(|e| change[e as usize].0);
            t.0 = [S::ZERO; 3];
            for m in 0..3 {
                let (p, q) = ((m + 1) % 3, (m + 2) % 3);
                let [sp, sq] = coupling_tensions(c.0[m], delta[p], delta[q]);
                t.0[p] += sp;
                t.0[q] += sq;
            }
        }
    });
    let tension = &*tension;
    let kind = spring_tangent(&request);
    workers.for_each(&mut buffer.spans, nodes.len() * 8, |_, span| {
        if request.energy {
            let mut sum = 0.0;
            for i in span.elements.clone() {
                let delta = of[i].0.map(|e| change[e as usize].0);
                let c = stiffness[i].0;
                sum += (coupling_energy(c[0], delta[1], delta[2])
                    + coupling_energy(c[1], delta[2], delta[0])
                    + coupling_energy(c[2], delta[0], delta[1]))
                .to_f64();
            }
            span.energy = sum;
        }
        let Some(kind) = kind else {
            span.drop_tangent();
            return;
        };
        span.clear_tangent();
        // local vertices of edge i of a triangle with ascending rows, lower row first
        const ENDS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];
        for i in span.elements.clone() {
            let mut local = LocalTangent::<S, 3>::default();
            let rows = nodes[i].0;
            let mut d = [[S::ZERO; 3]; 3];
            for e in 0..3 {
                let [a, b] = ENDS[e].map(|v| xyz(u[rows[v] as usize]));
                d[e] = add(rest[of[i].0[e] as usize].0, sub(a, b));
            }
            for m in 0..3 {
                let (p, q) = ((m + 1) % 3, (m + 2) % 3);
                local.couple(stiffness[i].0[m], ENDS[p], d[p], ENDS[q], d[q]);
            }
            if kind == TangentKind::Exact {
                for e in 0..3 {
                    local.tension(tension[i].0[e], ENDS[e]);
                }
            }
            for e in 0..3 {
                let [a, b] = ENDS[e];
                let edge = of[i].0[e] as usize;
                span.add_off_diagonal(block[edge].0, rows[a], rows[b], &local.0[a][b]);
                span.add_diagonal(rows[e], &local.0[e][e]);
            }
        }
    });
    buffer.time = start.elapsed();
}

fn evaluate_volumetric<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    mut buffer: ResMut<LawBuffer<Volumetric, S>>,
    vertices: Query<&Displacement<S>>,
    edges: Query<(&EdgeVertices, &EdgeBlock, &RestEdge<S>, &EdgeChange<S>)>,
    mut tetrahedra: Query<(
        &TetrahedronVertices,
        &TetrahedronEdges,
        &VolumetricStiffness<S>,
        &mut VolumetricTension<S>,
    )>,
) {
    let start = Instant::now();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let u = Displacement::peel_slice(u);
    let Some((ends, block, rest, change)) = single_table(edges.contiguous_iter()) else { return };
    let Some((nodes, of, stiffness, mut tension)) = single_table(tetrahedra.contiguous_iter_mut())
    else {
        return;
    };
    let tension = tension.bypass_change_detection();
    workers.for_chunks(tension, ROW_CHUNK, nodes.len() * 3, |first, rows| {
        let range = first..first + rows.len();
        for ((t, c), e) in rows.iter_mut().zip(&stiffness[range.clone()]).zip(&of[range]) {
            for (m, [p, q]) in OPPOSITE_EDGES.into_iter().enumerate() {
                let delta = [p, q].map(|l| change[e.0[l] as usize].0);
                [t.0[p], t.0[q]] = coupling_tensions(c.0[m], delta[0], delta[1]);
            }
        }
    });
    let tension = &*tension;
    let kind = spring_tangent(&request);
    workers.for_each(&mut buffer.spans, nodes.len() * 8, |_, span| {
        if request.energy {
            let mut sum = 0.0;
            for i in span.elements.clone() {
                for (m, [p, q]) in OPPOSITE_EDGES.into_iter().enumerate() {
                    let delta = [p, q].map(|l| change[of[i].0[l] as usize].0);
                    sum += coupling_energy(stiffness[i].0[m], delta[0], delta[1]).to_f64();
                }
            }
            span.energy = sum;
        }
        let Some(kind) = kind else {
            span.drop_tangent();
            return;
        };
        span.clear_tangent();
        for i in span.elements.clone() {
            let mut local = LocalTangent::<S, 4>::default();
            let rows = nodes[i].0;
            let mut d = [[S::ZERO; 3]; 6];
            for (e, [a, b]) in TETRAHEDRON_EDGES.into_iter().enumerate() {
                let edge = of[i].0[e] as usize;
                let stored = add(rest[edge].0, {
                    let [low, high] = ends[edge].0;
                    sub(xyz(u[low as usize]), xyz(u[high as usize]))
                });
                // stored edges run from the lower row, local ones from the lower local vertex
                d[e] = if rows[a] < rows[b] { stored } else { stored.map(|x| -x) };
            }
            for (m, [p, q]) in OPPOSITE_EDGES.into_iter().enumerate() {
                let c = stiffness[i].0[m];
                local.couple(c, TETRAHEDRON_EDGES[p], d[p], TETRAHEDRON_EDGES[q], d[q]);
            }
            if kind == TangentKind::Exact {
                for (e, ends) in TETRAHEDRON_EDGES.into_iter().enumerate() {
                    local.tension(tension[i].0[e], ends);
                }
            }
            for (e, [a, b]) in TETRAHEDRON_EDGES.into_iter().enumerate() {
                let edge = of[i].0[e] as usize;
                span.add_off_diagonal(block[edge].0, rows[a], rows[b], &local.0[a][b]);
            }
            for (a, &row) in rows.iter().enumerate() {
                span.add_diagonal(row, &local.0[a][a]);
            }
        }
    });
    buffer.time = start.elapsed();
}

fn collect_tension<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    incidence: Res<EdgeIncidence>,
    mut edges: Query<(&TensileTension<S>, &mut EdgeTension<S>)>,
    triangles: Query<&AngularTension<S>>,
    tetrahedra: Query<&VolumetricTension<S>>,
    mut times: ResMut<SystemTimes>,
) {
    if !request.force {
        return;
    }
    let start = Instant::now();
    let Some((tensile, mut tension)) = single_table(edges.contiguous_iter_mut()) else { return };
    let Some(angular) = single_table(triangles.contiguous_iter()) else { return };
    let Some(volumetric) = single_table(tetrahedra.contiguous_iter()) else { return };
    let work = tensile.len() * 6;
    workers.for_chunks(tension.bypass_change_detection(), ROW_CHUNK, work, |first, rows| {
        for (i, s) in rows.iter_mut().enumerate() {
            let e = first + i;
            let mut sum = tensile[e].0;
            let range =
                incidence.triangle_start[e] as usize..incidence.triangle_start[e + 1] as usize;
            for &j in &incidence.triangles[range] {
                sum += angular[j as usize / 3].0[j as usize % 3];
            }
            let range = incidence.tetrahedron_start[e] as usize
                ..incidence.tetrahedron_start[e + 1] as usize;
            for &j in &incidence.tetrahedra[range] {
                sum += volumetric[j as usize / 6].0[j as usize % 6];
            }
            s.0 = sum;
        }
    });
    times.add("edge tensions", start.elapsed());
}

fn evaluate_spring_forces<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    mut buffer: ResMut<LawBuffer<SpringForces, S>>,
    vertices: Query<&Displacement<S>>,
    edges: Query<(&EdgeVertices, &RestEdge<S>, &EdgeTension<S>)>,
) {
    if !request.force {
        return;
    }
    let start = Instant::now();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let u = Displacement::peel_slice(u);
    let Some((nodes, rest, tension)) = single_table(edges.contiguous_iter()) else { return };
    workers.for_each(&mut buffer.spans, nodes.len() * 4, |_, span: &mut Span<S>| {
        span.clear_force();
        for i in span.elements.clone() {
            let [a, b] = nodes[i].0;
            let d = add(rest[i].0, sub(xyz(u[a as usize]), xyz(u[b as usize])));
            let f = edge_force(tension[i].0, d);
            span.add_force(a, f);
            span.add_force(b, f.map(|x| -x));
        }
    });
    buffer.time = start.elapsed();
}

/// Blocks of a small element, `[row][column]`.
struct LocalTangent<S, const N: usize>([[[S; 9]; N]; N]);

impl<S: Scalar, const N: usize> Default for LocalTangent<S, N> {
    fn default() -> Self {
        Self([[[S::ZERO; 9]; N]; N])
    }
}

impl<S: Scalar, const N: usize> LocalTangent<S, N> {
    /// Adds `c/2 (J_e^T J_f + J_f^T J_e)`.
    fn couple(&mut self, c: S, e: [usize; 2], d_e: [S; 3], f: [usize; 2], d_f: [S; 3]) {
        let m = outer(c + c, d_e, d_f);
        let t = outer(c + c, d_f, d_e);
        for (i, &p) in e.iter().enumerate() {
            for (j, &q) in f.iter().enumerate() {
                let same = i == j;
                for k in 0..9 {
                    self.0[p][q][k] += if same { m[k] } else { -m[k] };
                    self.0[q][p][k] += if same { t[k] } else { -t[k] };
                }
            }
        }
    }

    /// Adds `2 s` times the Laplacian of an edge.
    fn tension(&mut self, s: S, [a, b]: [usize; 2]) {
        let two = s + s;
        add_identity(&mut self.0[a][a], two);
        add_identity(&mut self.0[b][b], two);
        add_identity(&mut self.0[a][b], -two);
        add_identity(&mut self.0[b][a], -two);
    }
}

#[inline(always)]
fn outer<S: Scalar>(c: S, a: [S; 3], b: [S; 3]) -> [S; 9] {
    let a = a.map(|x| c * x);
    [
        a[0] * b[0],
        a[0] * b[1],
        a[0] * b[2],
        a[1] * b[0],
        a[1] * b[1],
        a[1] * b[2],
        a[2] * b[0],
        a[2] * b[1],
        a[2] * b[2],
    ]
}

#[inline(always)]
fn add_identity<S: Scalar>(m: &mut [S; 9], s: S) {
    m[0] += s;
    m[4] += s;
    m[8] += s;
}
