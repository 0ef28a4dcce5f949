//! Shared by the integration tests: small dense linear algebra and the worst-error bookkeeping.
#![allow(dead_code, reason = "each test binary uses its own part")]

#[path = "../../../tests/common/bodies.rs"]
pub mod bodies;
#[path = "../../../tests/common/json.rs"]
pub mod json;

use bevy_ecs::prelude::*;
use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use sinew_engine::element::{TETRAHEDRON_EDGES, TetrahedronShapes};
use sinew_engine::element_kind::ByKind;
use sinew_engine::lanes::InstructionSet;
use sinew_engine::law::{ElasticEnergy, EvaluationRequest, LawBuffer};
use sinew_engine::layout::BodyElements;
use sinew_engine::matrix::{ProductSpans, Tangent};
use sinew_engine::precision::Precision;
use sinew_engine::row::{LocalRow, MeshVertex};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{Executor, ForceSchedule, install};
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{Displacement, ElasticForce, Mass};
use sinew_engine::workers::Workers;
use sinew_models::body::sheet::MembraneDescription;
use sinew_models::body::{BodyDescription, spawn_body};
use sinew_models::element::tetrahedron::{self, Element, TangentKind};
use sinew_models::frame::law::TetrahedronLaw;
use sinew_models::frame::tetrahedra::{TetrahedronColumns, evaluate_columns};
use std::io::Write;

/// Largest error seen per quantity, in units of its tolerance.
#[derive(Default)]
pub struct Worst(Vec<(&'static str, f64, String)>);

impl Worst {
    /// Notes `error` of `quantity`, measured in units of `unit`, for the case called `name`.
    pub fn note(&mut self, quantity: &'static str, error: f64, unit: f64, name: &str) {
        // NaN must not pass: it counts as infinite.
        let ratio = if error == 0.0 { 0.0 } else { error / unit };
        let ratio = if ratio.is_nan() { f64::INFINITY } else { ratio };
        match self.0.iter_mut().find(|w| w.0 == quantity) {
            Some(w) if w.1 >= ratio => {}
            Some(w) => (w.1, w.2) = (ratio, name.to_owned()),
            None => self.0.push((quantity, ratio, name.to_owned())),
        }
    }

    /// Notes how far numbers are from those of the reference, in units of `unit`.
    pub fn beside(
        &mut self,
        quantity: &'static str,
        ours: &[f64],
        theirs: &[f64],
        unit: f64,
        name: &str,
    ) {
        self.note(quantity, max_difference(ours, theirs), unit, name);
    }

    /// The same in units of the largest of the reference.
    pub fn same(&mut self, quantity: &'static str, ours: &[f64], theirs: &[f64], name: &str) {
        self.beside(quantity, ours, theirs, max_abs(theirs), name);
    }

    /// Fails if any quantity is off by more than `tolerance` of its units. Lists all of them when
    /// the variable `SINEW_REPORT` is set.
    pub fn check(self, tolerance: f64) {
        if std::env::var_os("SINEW_REPORT").is_some() {
            for (quantity, ratio, name) in &self.0 {
                let _ = writeln!(std::io::stderr(), "{quantity:32} {ratio:9.2e}  {name}");
            }
        }
        assert!(!self.0.is_empty(), "nothing was checked");
        for (quantity, ratio, name) in &self.0 {
            assert!(*ratio <= tolerance, "{quantity} is off by {ratio:e} at {name}");
        }
    }
}

pub fn max_abs<'a>(values: impl IntoIterator<Item = &'a f64>) -> f64 {
    values.into_iter().fold(0.0, |m, x| if x.is_nan() { f64::NAN } else { x.abs().max(m) })
}

pub fn max_difference<'a>(
    a: impl IntoIterator<Item = &'a f64>,
    b: impl IntoIterator<Item = &'a f64>,
) -> f64 {
    let (a, b): (Vec<_>, Vec<_>) = (a.into_iter().collect(), b.into_iter().collect());
    assert_eq!(a.len(), b.len());
    let differences: Vec<f64> = a.iter().zip(&b).map(|(x, y)| **x - **y).collect();
    if differences.iter().any(|x| x.is_nan()) { f64::NAN } else { max_abs(&differences) }
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix by cyclic Jacobi rotations.
pub fn symmetric_eigen<const N: usize>(mut a: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut v = [[0.0; N]; N];
    for i in 0..N {
        v[i][i] = 1.0;
    }
    for _sweep in 0..60 {
        let size = max_abs(a.as_flattened());
        let mut off = 0.0_f64;
        for p in 0..N {
            for q in p + 1..N {
                off = off.max(a[p][q].abs());
                if a[p][q] == 0.0 {
                    continue;
                }
                let zeta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for k in 0..N {
                    (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                }
                for k in 0..N {
                    (a[k][p], a[k][q]) = (c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]);
                    (v[k][p], v[k][q]) = (c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]);
                }
            }
        }
        if off <= 1e-17 * size {
            break;
        }
    }
    let mut values = [0.0; N];
    for i in 0..N {
        values[i] = a[i][i];
    }
    (values, v)
}

/// Every kind of tangent.
pub const KINDS: [TangentKind; 3] =
    [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected];

/// Numbers between -1 and 1, as many as [`strip`] takes.
pub fn noise() -> Vec<f64> {
    (0..97).map(|i| ((i * 37 + 11) % 97) as f64 / 48.5 - 1.0).collect()
}

/// Three numbers between -1 and 1.
pub fn vector() -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-1.0..1.0_f64)
}

/// The same cases in every run unless `PROPTEST_RNG_SEED` asks for others.
pub fn config() -> ProptestConfig {
    let mut config = ProptestConfig { failure_persistence: None, ..ProptestConfig::default() };
    if config.rng_seed == RngSeed::Random {
        config.rng_seed = RngSeed::Fixed(2008);
    }
    config.max_global_rejects = 100_000;
    config
}

/// How far vertices move, in units of the size of an element.
#[derive(Clone, Copy, Debug)]
pub enum Motion {
    Random(f64),
    /// All onto one point.
    Collapsed,
    /// Turned inside out.
    Mirrored,
    Rest,
}

/// A strip of tetrahedra, neighbours sharing three vertices, and displacements.
pub fn strip(
    count: usize,
    noise: &[f64],
    motion: Motion,
) -> (Vec<DVec3>, Vec<[u32; 4]>, Vec<DVec3>) {
    let mut at = 0;
    let mut next = || {
        at += 1;
        noise[at % noise.len()]
    };
    // points on a helix, so that four in a row span a volume
    let points: Vec<DVec3> = (0..count + 3)
        .map(|i| {
            let t = i as f64 * 1.9;
            let (x, y) = (t.cos() + 0.2 * next(), t.sin() + 0.2 * next());
            DVec3::new(x, y, 0.4 * i as f64 + 0.1 * next())
        })
        .collect();
    let moved = points
        .iter()
        .map(|p| match motion {
            Motion::Random(size) => size * DVec3::new(next(), next(), next()),
            Motion::Collapsed => -*p,
            Motion::Mirrored => DVec3::new(0.0, 0.0, -2.0 * p.z),
            Motion::Rest => DVec3::ZERO,
        })
        .collect();
    let tetrahedra = strip_of(&points);
    (points, tetrahedra, moved)
}

/// Tetrahedra of positive volume between four points in a row.
pub fn strip_of(points: &[DVec3]) -> Vec<[u32; 4]> {
    (0..points.len() as u32 - 3)
        .map(|i| {
            let t = [i, i + 1, i + 2, i + 3];
            let p = t.map(|v| points[v as usize]);
            let positive = (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) > 0.0;
            if positive { t } else { [t[0], t[1], t[3], t[2]] }
        })
        .collect()
}

/// Tetrahedra as the kernels see them, and the body that they make.
pub struct Columns<S: Scalar> {
    pub displacement: Vec<[S; 4]>,
    pub nodes: Vec<[u32; 4]>,
    pub blocks: Vec<[u32; 6]>,
    pub topology: Topology,
    /// Entries of the shape vectors, volume and moduli.
    numbers: [Vec<S>; 13],
}

impl<S: Scalar> Columns<S> {
    pub fn new(elements: &[Element<S>], nodes: Vec<[u32; 4]>, displacement: Vec<[S; 4]>) -> Self {
        let pair = |a: u32, b: u32| [a.min(b), a.max(b)];
        let pairs = |t: &[u32; 4]| TETRAHEDRON_EDGES.map(|[a, b]| pair(t[a], t[b]));
        let mut edges: Vec<[u32; 2]> = nodes.iter().flat_map(pairs).collect();
        edges.sort_unstable();
        edges.dedup();
        let block = |edge: [u32; 2]| edges.binary_search(&edge).unwrap() as u32;
        let blocks = nodes.iter().map(|t| pairs(t).map(block)).collect();
        let ordered = BodyElements {
            vertex_order: (0..displacement.len() as u32).map(MeshVertex).collect(),
            row_of_vertex: (0..displacement.len() as u32).map(|v| Some(LocalRow(v))).collect(),
            nodes: ByKind { tetrahedra: nodes.clone().into(), ..ByKind::default() },
            ..BodyElements::default()
        };
        let mut topology = Topology::default();
        topology.push(BodyRows::new(String::new(), ordered, 1.0), &edges);
        let number = |i: usize, e: &Element<S>| match i {
            0..9 => e.gradients[i / 3][i % 3],
            _ => [e.volume, e.lambda, e.mu, e.compression][i - 9],
        };
        let numbers =
            std::array::from_fn(|i| elements.iter().map(|e| number(i, e)).collect::<Vec<S>>());
        Self { displacement, nodes, blocks, topology, numbers }
    }

    pub fn slices(&self) -> TetrahedronColumns<'_, S> {
        let [volume, lambda, mu, compression] = std::array::from_fn(|i| &self.numbers[9 + i][..]);
        TetrahedronColumns {
            shapes: TetrahedronShapes {
                displacement: &self.displacement,
                nodes: &self.nodes,
                gradients: std::array::from_fn(|i| &self.numbers[i][..]),
            },
            blocks: &self.blocks,
            volume,
            lambda,
            mu,
            compression,
            pressure: &[],
            predicted: &[],
        }
    }
}

/// A world without bodies.
pub fn empty<S: Scalar>() -> World {
    let mut world = World::new();
    install::<S>(&mut world, Executor::SingleThreaded);
    world.insert_resource(Precision::of::<S>());
    world
}

/// A world with one body, displaced by `moved` (user's order).
pub fn world<S: Scalar>(body: &BodyDescription, moved: &[DVec3], workers: Workers) -> World {
    let mut world = empty::<S>();
    world.insert_resource(workers);
    spawn_body(&mut world, body).unwrap();
    displace::<S>(&mut world, moved);
    world
}

/// Displaces all bodies alike (user's order).
pub fn displace<S: Scalar>(world: &mut World, moved: &[DVec3]) {
    let bodies = &world.resource::<Topology>().bodies;
    let order: Vec<MeshVertex> =
        bodies.iter().flat_map(|body| body.vertex_order.iter().copied()).collect();
    let mut query = world.query::<&mut Displacement<S>>();
    for (mut u, v) in query.iter_mut(world).zip(order) {
        let [x, y, z] = moved[v.index()].to_array().map(S::from_f64);
        u.0 = [x, y, z, S::ZERO];
    }
}

/// What the only body gives where it is, in the user's order.
pub struct Response {
    pub energy: f64,
    pub force: Vec<f64>,
    pub mass: Vec<f64>,
    /// Row by row; rows and columns are `3 vertex + axis`.
    pub tangent: Vec<f64>,
    pub clamped: u64,
}

/// Evaluates the only body, of `count` vertices.
pub fn respond<S: Scalar>(world: &mut World, count: usize, kind: TangentKind) -> Response {
    world.insert_resource(EvaluationRequest { energy: true, force: true, tangent: Some(kind) });
    world.run_schedule(ForceSchedule);
    let order = world.resource::<Topology>().bodies[0].vertex_order.clone();
    let n = 3 * count;
    let mut all = Response {
        energy: world.resource::<ElasticEnergy>().total,
        force: vec![0.0; n],
        mass: vec![0.0; count],
        tangent: vec![0.0; n * n],
        clamped: world.resource::<Tangent<S>>().clamped,
    };
    let mut rows = world.query::<(&ElasticForce<S>, &Mass<S>)>();
    for ((f, m), v) in rows.iter(world).zip(&order) {
        all.mass[v.index()] = m.0.to_f64();
        (0..3).for_each(|k| all.force[3 * v.index() + k] = f.0[k].to_f64());
    }
    let Tangent { matrix, low_rank, .. } = world.resource::<Tangent<S>>();
    let place = |row: u32| 3 * order[LocalRow(row)].index();
    let mut add = |[a, b]: [u32; 2], block: &[S; 9]| {
        let (i, j) = (place(a), place(b));
        for k in 0..9 {
            let (p, q, own) = (i + k / 3, j + k % 3, block[k].to_f64());
            all.tangent[p * n + q] += own;
            if a != b {
                all.tangent[q * n + p] += own;
            }
        }
    };
    (0..).zip(&matrix.diagonal).for_each(|(row, own)| add([row, row], own));
    let edges = &world.resource::<Topology>().edges;
    edges.iter().zip(&matrix.off_diagonal).for_each(|(&edge, own)| add(edge, own));
    for part in low_rank {
        for vector in 0..part.pattern.start.len() - 1 {
            let mut whole = vec![0.0; n];
            for entry in part.pattern.entries(vector) {
                let at = place(part.pattern.rows[entry]);
                (0..3).for_each(|k| whole[at + k] = part.vectors[entry][k].to_f64());
            }
            for (row, a) in all.tangent.chunks_mut(n).zip(&whole) {
                row.iter_mut().zip(&whole).for_each(|(x, b)| *x += a * b);
            }
        }
    }
    all
}

/// The assembled tangent times a vector, by rows.
pub fn assembled<S: Scalar>(world: &World, v: &[[S; 4]]) -> Vec<[S; 4]> {
    let mut product = vec![[S::ZERO; 4]; v.len()];
    let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
    let matrix = &world.resource::<Tangent<S>>().matrix;
    matrix.multiply(topology, workers, &mut ProductSpans::default(), v, &mut product);
    product
}

/// A body that is all membrane, of the membrane's material.
pub fn sheet<'a>(points: &'a [DVec3], membrane: MembraneDescription<'a>) -> BodyDescription<'a> {
    let plain = BodyDescription::from_parts("sheet", points, &[], membrane.material);
    BodyDescription { membrane: Some(membrane), ..plain }
}

/// What a law makes of the tetrahedra of [`Columns`]: energy, forces, diagonal and off-diagonal blocks, clamped
/// elements.
pub struct Sums {
    pub energy: f64,
    pub force: Vec<[f64; 4]>,
    pub diagonal: Vec<[f64; 9]>,
    pub off: Vec<[f64; 9]>,
    pub clamped: u64,
    /// Largest entry of the exact tangent of an element; of registers 0.
    pub stiffness: f64,
}

impl Sums {
    /// From the functions of the law, one element at a time.
    pub fn one_by_one<L: TetrahedronLaw, S: Scalar>(
        elements: &[Element<S>],
        Columns { displacement: u, nodes, blocks, topology, .. }: &Columns<S>,
        kind: TangentKind,
    ) -> Self {
        let mut sums = Self {
            energy: 0.0,
            force: vec![[0.0; 4]; u.len()],
            diagonal: vec![[0.0; 9]; u.len()],
            off: vec![[0.0; 9]; topology.edges.len()],
            clamped: 0,
            stiffness: 0.0,
        };
        let projected = kind == TangentKind::Projected;
        for (i, e) in elements.iter().enumerate() {
            let rows = nodes[i];
            let local = rows.map(|v| u[v as usize]).map(|u| [u[0], u[1], u[2]]);
            sums.energy += L::energy(e, &local).to_f64();
            let forces = L::forces(e, &local).unwrap();
            let exact = L::tangent(e, &local, TangentKind::Exact);
            let (t, clamped) = if projected && L::STRESS_PROJECTION {
                let t = tetrahedron::tangent(e, &local, kind);
                (t, t != tetrahedron::tangent(e, &local, TangentKind::Exact))
            } else {
                (L::tangent(e, &local, kind), projected && L::is_clamped(e, &local))
            };
            sums.clamped += u64::from(clamped);
            let entries = exact.to_dense();
            let entries = entries.as_flattened().iter().map(|x| x.to_f64().abs());
            sums.stiffness = entries.fold(sums.stiffness, f64::max);
            for (a, &row) in rows.iter().enumerate() {
                (0..3).for_each(|k| sums.force[row as usize][k] += forces[a][k].to_f64());
                (0..9).for_each(|k| sums.diagonal[row as usize][k] += t.diagonal[a][k].to_f64());
            }
            for (edge, [a, b]) in TETRAHEDRON_EDGES.into_iter().enumerate() {
                let (a, b) = if rows[a] < rows[b] { (a, b) } else { (b, a) };
                let m = t.block(a, b);
                (0..9).for_each(|k| sums.off[blocks[i][edge] as usize][k] += m[k].to_f64());
            }
        }
        sums
    }

    /// From the kernels with an instruction set.
    pub fn by_registers<L: TetrahedronLaw, S: Scalar>(
        columns: &Columns<S>,
        kind: TangentKind,
        set: InstructionSet,
    ) -> Self {
        let mut buffer = LawBuffer::<S>::default();
        let nodes = &columns.nodes;
        buffer.partition(nodes.len(), &columns.topology, |i| &nodes[i]);
        let workers = Workers::serial().with_instruction_set(set).unwrap();
        let request = EvaluationRequest { energy: true, force: true, tangent: Some(kind) };
        evaluate_columns::<L, S>(&columns.slices(), &request, &workers, &mut buffer);
        let [span] = &buffer.spans[..] else { panic!("a small body is one range") };
        fn widened<S: Scalar, const N: usize>(rows: &[[S; N]]) -> Vec<[f64; N]> {
            rows.iter().map(|row| row.map(S::to_f64)).collect()
        }
        Self {
            energy: span.energy,
            force: widened(&span.force),
            diagonal: widened(&span.diagonal),
            off: widened(&span.off_diagonal),
            clamped: span.clamped,
            stiffness: 0.0,
        }
    }
}

/// A file of reference vectors computed elsewhere: of our own, or from the folder that `SINEW_REFERENCE` names.
pub fn reference(file: &str) -> serde_json::Value {
    json::load(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data"), file)
}
