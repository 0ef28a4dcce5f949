//! Kernels: nanoseconds per tetrahedron, operations and bytes per second, share of the roofline, and
//! the error of what was computed.

use super::arrays::PlainArrays;
use super::error::BenchError;
use super::flops::{ElementFlops, pooled_flops};
use super::membranes::{self, MembraneRow};
use super::roofline::Limits;
use super::stats::{Rounds, Spread, interleave};
use super::table::{Cell, Table};
use crate::beam::{
    MATERIAL, as_in_a_step, beam, bend, bent, cells_for, evaluate, lend, precision_of, request,
    take_back,
};
use bevy_ecs::prelude::World;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::engine::columns::single_table;
use sinew::engine::element::{
    EdgeVertices, TETRAHEDRON_EDGES, TetrahedronBlocks, TetrahedronEdges, TetrahedronVertices,
    TriangleEdges,
};
use sinew::engine::lanes::InstructionSet;
use sinew::engine::law::{ElasticEnergy, LawBuffers, TangentKind};
use sinew::engine::matrix::{BlockMatrix, ProductSpans, Tangent};
use sinew::engine::mesh::Mesh;
use sinew::engine::report::SystemTimes;
use sinew::engine::row::{IndexVec, LocalRow};
use sinew::engine::scalar::{Scalar, add, dot, scale, sub};
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::ElasticForce;
use sinew::engine::workers::Workers;
use sinew::models::axes::element::{AxisElement, Triad};
use sinew::models::body::Evaluation;
use sinew::models::element::precompute::{RestTetrahedron, SpringConstants};
use sinew::models::element::spring::Stretch;
use sinew::models::element::spring::{tensile_energy, tensile_tension};
use sinew::models::element::tetrahedron::{self, Element};
use sinew::models::frame::law::TetrahedronLaw;
use sinew::models::frame::stand_in::Corotational;
use sinew::models::frame::tetrahedra;
use sinew::models::laws::corotational::WarpedStiffness;
use sinew::models::laws::linear::Linear;
use sinew::models::laws::neo_hookean::NeoHookean;
use sinew::models::laws::quadratic::QuadraticSprings;
use sinew::models::laws::stvk_fem::StVKFem;
use sinew::models::laws::svk::FusedStVK;
use sinew::models::laws::svk_volume::StVKVolume;
use sinew::models::material::LameParameters;
use sinew::prelude::*;
use sinew_tune::table_of;
use std::collections::BTreeMap;
use std::hint::black_box;
use std::mem::size_of;
use std::time::Instant;

/// Sizes, threads and turns of kernels and steps.
#[derive(Clone, Debug)]
pub struct SizeOptions {
    /// Sizes of the beam (tetrahedra, about).
    pub sizes: Vec<usize>,
    /// Numbers of threads.
    pub threads: Vec<usize>,
    /// Turns of every variant.
    pub rounds: Rounds,
}

/// One kernel at one size.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KernelRow {
    /// Law or data structure.
    pub kernel: String,
    /// What it computes.
    pub quantity: String,
    /// `svk` or `svk_comp`.
    pub model: String,
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// `f64` or `f32`.
    pub precision: String,
    /// Threads.
    pub threads: usize,
    /// Instruction set of the kernels.
    pub instructions: String,
    /// Wall time per tetrahedron (ns).
    pub ns_per_tet: Spread,
    /// Counted operations over median time (GFLOP/s).
    pub gflop_per_s: Option<f64>,
    /// Compulsory bytes over median time (GB/s).
    pub gb_per_s: Option<f64>,
    /// Roofline time over median time (0 to 1).
    pub roofline_share: Option<f64>,
    /// What the roofline says is the limit.
    pub limit: Option<String>,
    /// Largest difference from the plain `f64` sum over elements, over the largest value there.
    pub error: Option<f64>,
}

/// Entity columns against plain arrays, one thread.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColumnRow {
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// `f64` or `f32`.
    pub precision: String,
    /// Force schedule over entity columns (ns per tetrahedron).
    pub columns: Spread,
    /// The same over plain vectors (ns per tetrahedron).
    pub arrays: Spread,
    /// Median of the ratios of neighbouring samples.
    pub ratio: f64,
    /// Largest difference of the forces over the largest force.
    pub difference: f64,
}

/// All kernels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KernelReport {
    /// One row per kernel, size, precision and number of threads.
    pub rows: Vec<KernelRow>,
    /// Entity columns against plain arrays.
    pub columns: Vec<ColumnRow>,
    /// Membranes.
    #[serde(default)]
    pub membranes: Vec<MembraneRow>,
}

/// What a kernel computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The energy.
    Energy,
    /// Forces.
    Force,
    /// A tangent, assembled.
    Tangent(TangentKind),
    /// The assembled tangent times a vector.
    Product,
    /// The tangent times a vector, element by element.
    MatrixFree,
    /// Adding up the forces of the laws.
    Gather,
}

impl Quantity {
    fn name(self) -> &'static str {
        match self {
            Self::Energy => "energy",
            Self::Force => "force",
            Self::Tangent(TangentKind::Exact) => "exact tangent",
            Self::Tangent(TangentKind::Projected) => "projected tangent",
            Self::Tangent(TangentKind::GaussNewton) => "Gauss-Newton tangent",
            Self::Product => "matrix-vector product",
            Self::MatrixFree => "exact tangent times vector",
            Self::Gather => "gather of forces",
        }
    }
}

/// Runs all kernels; `tell` hears what is going on.
///
/// # Errors
/// When a beam cannot be built.
pub fn run(
    options: &SizeOptions,
    limits: &[Limits],
    mut tell: impl FnMut(&str),
) -> Result<KernelReport, BenchError> {
    let mut report = KernelReport::default();
    for &size in &options.sizes {
        let mesh = beam(cells_for(size))?;
        tell(&format!("kernels: {} tetrahedra", mesh.tetrahedra.len()));
        size_rows(&mesh, options, limits, &mut report.rows)?;
        let rounds = Rounds { most: 2 * options.rounds.most + 1, ..options.rounds };
        report.columns.push(columns_against_arrays::<f64>(&mesh, rounds)?);
        report.columns.push(columns_against_arrays::<f32>(&mesh, rounds)?);
        report.membranes.extend(membranes::run(size, options.rounds)?);
    }
    Ok(report)
}

/// A kernel of a subject on a number of threads.
struct Variant {
    subject: usize,
    quantity: Quantity,
    threads: usize,
    instructions: InstructionSet,
    repetitions: usize,
}

/// What is timed: every model in every evaluation that it has, and axes.
fn subjects() -> impl Iterator<Item = (Evaluation, Model)> {
    let models = Model::ALL.into_iter().chain([Model::Axes]);
    models.flat_map(|model| {
        let evaluations = [Evaluation::Fused, Evaluation::Pooled].into_iter();
        evaluations.filter(move |&by| model.supports(by)).map(move |by| (by, model))
    })
}

fn size_rows(
    mesh: &Mesh,
    options: &SizeOptions,
    limits: &[Limits],
    rows: &mut Vec<KernelRow>,
) -> Result<(), BenchError> {
    let mut subjects: Vec<Subject> = Vec::new();
    for (evaluation, model) in self::subjects() {
        let reference = Reference::of(mesh, &bend(mesh), model)?;
        subjects.push(Subject::new::<f64>(mesh, evaluation, model, &reference)?);
        subjects.push(Subject::new::<f32>(mesh, evaluation, model, &reference)?);
    }
    let best = InstructionSet::best();
    let narrower = InstructionSet::ALL.into_iter().filter(|s| *s != best && s.is_available());
    let settings: Vec<(usize, InstructionSet)> = options
        .threads
        .iter()
        .map(|&n| (n, best))
        .chain(narrower.map(|set| (options.threads[0], set)))
        .collect();
    let mut pools = Vec::new();
    for &(n, set) in &settings {
        pools.push(((n, set), Some(Workers::new(n)?.with_instruction_set(set)?)));
    }

    let mut variants = Vec::new();
    for (i, subject) in subjects.iter_mut().enumerate() {
        for quantity in subject.quantities() {
            let repetitions = repetitions(&mut *subject.timed, quantity, 1e-3);
            for &(threads, instructions) in &settings {
                if instructions == best || subject.has_lanes(quantity) {
                    variants.push(Variant {
                        subject: i,
                        quantity,
                        threads,
                        instructions,
                        repetitions,
                    });
                }
            }
        }
    }
    let mut passes: BTreeMap<(usize, usize, &'static str), Vec<f64>> = BTreeMap::new();
    let samples = interleave(&mut variants, options.rounds, |v| {
        let subject = &mut subjects[v.subject];
        let key = (v.threads, v.instructions);
        let mut none = None;
        let pool = pools.iter_mut().find(|(k, _)| *k == key).map_or(&mut none, |(_, pool)| pool);
        let (seconds, parts) = subject.measure(v.quantity, pool, v.repetitions);
        if subject.evaluation == Evaluation::Pooled && v.quantity == Quantity::Force {
            for (name, seconds) in parts {
                passes.entry((v.subject, v.threads, name)).or_default().push(seconds);
            }
        }
        Ok::<f64, BenchError>(seconds)
    })?;

    let count = mesh.tetrahedra.len();
    let per_tet = 1e9 / count as f64;
    for (v, samples) in variants.iter().zip(&samples) {
        let subject = &subjects[v.subject];
        let Some(seconds) = Spread::warm(samples) else { continue };
        let work = subject.work(v.quantity);
        let median = seconds.median;
        let bound = limits.iter().find(|l| l.threads == v.threads).and_then(|l| {
            let bytes = work.bytes?;
            let (bound, by) = l.bound(subject.precision, work.flops.unwrap_or(0.0), bytes, bytes);
            Some((bound / median, by))
        });
        rows.push(KernelRow {
            threads: v.threads,
            instructions: v.instructions.name().into(),
            ns_per_tet: seconds.scaled(per_tet),
            gflop_per_s: work.flops.map(|flops| flops / median / 1e9),
            gb_per_s: work.bytes.map(|bytes| bytes / median / 1e9),
            roofline_share: bound.as_ref().map(|b| b.0),
            limit: bound.map(|b| b.1),
            ..subject.row(subject.kernel(v.quantity).into(), v.quantity, count)
        });
    }
    for ((subject, threads, name), samples) in passes {
        let Some(seconds) = Spread::of(&samples).filter(|s| s.median > 0.0) else { continue };
        rows.push(KernelRow {
            threads,
            instructions: best.name().into(),
            ns_per_tet: seconds.scaled(per_tet),
            ..subjects[subject].row(format!("pooled: {name}"), Quantity::Force, count)
        });
    }
    Ok(())
}

/// Work of one evaluation of the whole body.
#[derive(Clone, Copy, Debug, Default)]
struct Work {
    flops: Option<f64>,
    bytes: Option<f64>,
}

/// A product of a tangent and a vector without a matrix.
pub type Free<S> = fn(&mut World, &[[S; 4]], &mut [[S; 4]]);

/// That of a law of tetrahedra, with its exact tangent.
pub fn free<L: TetrahedronLaw, S: Scalar>(world: &mut World, x: &[[S; 4]], y: &mut [[S; 4]]) {
    let done = tetrahedra::multiply::<L, S>(world, TangentKind::Exact, x, y);
    debug_assert!(done.is_ok(), "exact tangents have a product");
}

/// A body whose kernels are timed.
pub struct Timed<S: Scalar> {
    simulation: Simulation,
    /// Vertex of every row.
    order: IndexVec<LocalRow, MeshVertex>,
    /// The exact tangent of the state, and what it is multiplied with.
    matrix: BlockMatrix<S>,
    spans: ProductSpans<S>,
    x: Vec<[S; 4]>,
    y: Vec<[S; 4]>,
    free: Option<Free<S>>,
}

/// [`Timed`], whatever its number type.
pub trait Timing {
    /// Seconds of one repetition.
    fn measure(&mut self, quantity: Quantity, repetitions: usize) -> f64;
    /// The body's world.
    fn world(&mut self) -> &mut World;
}

/// Repetitions of a kernel that take about so many seconds; its second run counts.
pub fn repetitions(timed: &mut dyn Timing, quantity: Quantity, seconds: f64) -> usize {
    timed.measure(quantity, 1);
    (seconds / timed.measure(quantity, 1).max(1e-6)).ceil().clamp(1.0, 1000.0) as usize
}

impl<S: Scalar> Timed<S> {
    /// A body in the state that is set.
    pub fn new(mut simulation: Simulation, body: BodyHandle, free: Option<Free<S>>) -> Self {
        let order = simulation.topology().bodies[body.0].vertex_order.clone();
        let direction = directions(order.len());
        let row = |vertex: &MeshVertex| {
            let [a, b, c] = direction[vertex.index()].to_array().map(S::from_f64);
            [a, b, c, S::ZERO]
        };
        let x: Vec<[S; 4]> = order.iter().map(row).collect();
        let y = vec![[S::ZERO; 4]; x.len()];
        request(&mut simulation, true, true, Some(TangentKind::Exact));
        evaluate(&mut simulation);
        let matrix = simulation.world().resource::<Tangent<S>>().matrix.clone();
        Self { simulation, order, matrix, spans: ProductSpans::default(), x, y, free }
    }

    /// Takes the tangent evaluated last.
    fn take_tangent(&mut self) {
        self.matrix = self.simulation.world().resource::<Tangent<S>>().matrix.clone();
    }

    /// Largest difference of the forces evaluated last from true ones.
    pub fn force_error(&mut self, body: BodyHandle, truth: &[DVec3]) -> f64 {
        let forces = self.simulation.elastic_forces(body);
        largest_difference(forces.into_iter().zip(truth.iter().copied()))
    }

    /// Largest difference of a product from the true one, by vertex.
    pub fn product_error(&mut self, quantity: Quantity, truth: &[DVec3]) -> f64 {
        self.measure(quantity, 1);
        let by_vertex = self.order.iter().zip(&self.y).map(|(vertex, y)| {
            (DVec3::from_array([0, 1, 2].map(|k| y[k].to_f64())), truth[vertex.index()])
        });
        largest_difference(by_vertex)
    }
}

impl<S: Scalar> Timing for Timed<S> {
    fn measure(&mut self, quantity: Quantity, repetitions: usize) -> f64 {
        let tangent = if let Quantity::Tangent(kind) = quantity { Some(kind) } else { None };
        let energy = quantity == Quantity::Energy;
        let force = matches!(quantity, Quantity::Force | Quantity::Gather);
        request(&mut self.simulation, energy, force, tangent);
        if quantity == Quantity::Gather {
            evaluate(&mut self.simulation);
        }
        let Self { simulation, matrix, spans, x, y, free, .. } = self;
        as_in_a_step(simulation, |world| {
            let start = Instant::now();
            for _ in 0..repetitions {
                match quantity {
                    Quantity::Product => {
                        let workers = world.resource::<Workers>();
                        matrix.multiply(world.resource::<Topology>(), workers, spans, x, y);
                    }
                    Quantity::MatrixFree => {
                        y.fill([S::ZERO; 4]);
                        free.expect("the subject has this quantity")(world, x, y);
                    }
                    Quantity::Gather => {
                        let workers = world.resource::<Workers>();
                        let buffers = world.resource::<LawBuffers<S>>();
                        let buffer = buffers.get(FusedStVK::NAME).expect("the body's law");
                        buffer.add_forces_to(workers, black_box(y));
                    }
                    _ => world.run_schedule(ForceSchedule),
                }
            }
            start.elapsed().as_secs_f64() / repetitions as f64
        })
    }

    fn world(&mut self) -> &mut World {
        self.simulation.world_mut()
    }
}

/// The beam under one law.
struct Subject {
    timed: Box<dyn Timing>,
    evaluation: Evaluation,
    model: Model,
    precision: &'static str,
    /// Of energy, force, products with exact and projected tangent.
    errors: [f64; 4],
    /// Tetrahedra, vertices, edges, triangles.
    counts: [f64; 4],
}

impl Subject {
    fn new<S: Scalar>(
        mesh: &Mesh,
        evaluation: Evaluation,
        model: Model,
        reference: &Reference,
    ) -> Result<Self, BenchError> {
        let (simulation, body) = bent(mesh, precision_of::<S>(), 1, evaluation, model)?;
        let mut timed = Timed::<S>::new(simulation, body, Some(free::<FusedStVK, S>));
        request(&mut timed.simulation, true, true, Some(TangentKind::Projected));
        evaluate(&mut timed.simulation);
        timed.take_tangent();
        let projected = timed.product_error(Quantity::Product, &reference.projected_product);
        request(&mut timed.simulation, true, true, Some(TangentKind::Exact));
        evaluate(&mut timed.simulation);
        timed.take_tangent();
        let energy = timed.simulation.world().resource::<ElasticEnergy>().total;
        let energy = (energy - reference.energy).abs() / reference.energy;
        let force = timed.force_error(body, &reference.forces);
        let exact = timed.product_error(Quantity::Product, &reference.product);
        let triangles = 2 * mesh.tetrahedra.len() + mesh.surface_triangles().len() / 2;
        let edges = timed.simulation.topology().edges.len();
        Ok(Self {
            evaluation,
            model,
            precision: S::NAME,
            errors: [energy, force, exact, projected],
            counts: [mesh.tetrahedra.len(), timed.x.len(), edges, triangles].map(|n| n as f64),
            timed: Box::new(timed),
        })
    }

    fn quantities(&self) -> Vec<Quantity> {
        let mut all =
            vec![Quantity::Energy, Quantity::Force, Quantity::Tangent(TangentKind::Exact)];
        if matches!(
            self.model,
            Model::CompressibleStVK
                | Model::Corotational
                | Model::NeoHookean
                | Model::StVKVolume
                | Model::Axes
        ) {
            all.push(Quantity::Tangent(TangentKind::Projected));
        }
        if self.model == Model::CompressibleStVK && self.evaluation == Evaluation::Fused {
            all.extend([Quantity::Product, Quantity::MatrixFree, Quantity::Gather]);
        }
        all
    }

    /// Seconds per repetition in a pool, and those of every system.
    fn measure(
        &mut self,
        quantity: Quantity,
        pool: &mut Option<Workers>,
        repetitions: usize,
    ) -> (f64, Vec<(&'static str, f64)>) {
        lend(self.timed.world(), pool);
        self.timed.measure(quantity, 1);
        self.timed.world().insert_resource(SystemTimes::default());
        let seconds = self.timed.measure(quantity, repetitions);
        let parts = self.timed.world().resource::<SystemTimes>().entries.iter();
        let parts = parts.map(|p| (p.name, p.seconds / repetitions as f64)).collect();
        take_back(self.timed.world(), pool);
        (seconds, parts)
    }

    /// A row without times.
    fn row(&self, kernel: String, quantity: Quantity, tetrahedra: usize) -> KernelRow {
        KernelRow {
            kernel,
            quantity: quantity.name().into(),
            model: sinew_scene::summary::model_name(self.model).into(),
            tetrahedra,
            precision: self.precision.into(),
            error: self.error(quantity),
            ..KernelRow::default()
        }
    }

    fn kernel(&self, quantity: Quantity) -> &'static str {
        match (quantity, self.evaluation) {
            (Quantity::Product, _) => "assembled symmetric half",
            (Quantity::MatrixFree, _) => "matrix-free",
            (Quantity::Gather, _) => "private force arrays",
            (_, Evaluation::Pooled) => "pooled, all passes",
            _ => match (self.model, self.model.law()) {
                (Model::StVK | Model::CompressibleStVK, _) => "fused",
                (_, Some(law)) => law.info.name,
                (Model::Axes, None) => "axes (triads)",
                (_, None) => "mass-spring edges",
            },
        }
    }

    /// Whether its kernel is compiled for several instruction sets and worth a comparison of them.
    fn has_lanes(&self, quantity: Quantity) -> bool {
        self.evaluation == Evaluation::Fused
            && self.model == Model::CompressibleStVK
            && !matches!(quantity, Quantity::Product | Quantity::Gather)
    }

    fn work(&self, quantity: Quantity) -> Work {
        match self.precision {
            "f32" => self.work_in::<f32>(quantity),
            _ => self.work_in::<f64>(quantity),
        }
    }

    fn work_in<S: Scalar>(&self, quantity: Quantity) -> Work {
        let [tetrahedra, vertices, edges, triangles] = self.counts;
        let fused = ElementFlops::count(self.model == Model::CompressibleStVK);
        let row = size_of::<[S; 4]>() as f64;
        let block = size_of::<[S; 9]>() as f64;
        // nine shape gradients, volume, three moduli
        let columns = match self.model {
            // nine shape gradients, three axes, three and three moduli, that of volume
            Model::Axes => size_of::<[S; 9 + 9 + 7]>(),
            _ => size_of::<[S; 9 + 1 + 3]>(),
        };
        let element = size_of::<TetrahedronVertices>() + columns;
        let read = tetrahedra * element as f64 + vertices * row;
        let tangent_bytes =
            tetrahedra * size_of::<TetrahedronBlocks>() as f64 + (vertices + edges) * block;
        if self.evaluation == Evaluation::Pooled {
            let compressible = self.model == Model::CompressibleStVK;
            let sizes = [
                tetrahedra * size_of::<(TetrahedronEdges, [S; 3])>() as f64,
                triangles * size_of::<(TriangleEdges, [S; 3])>() as f64,
                // rest vector, stiffness, change, tension by each of the three laws and in sum
                edges * size_of::<(EdgeVertices, [S; 3 + 1 + 1 + 3 + 1])>() as f64,
                // the compression term reads the columns of the fused law
                if compressible { read } else { vertices * row },
                vertices * row,
            ];
            return match quantity {
                Quantity::Force => Work {
                    flops: Some(pooled_flops(edges, triangles, tetrahedra, compressible)),
                    bytes: Some(sizes.iter().sum()),
                },
                _ => Work::default(),
            };
        }
        if self.model == Model::MassSpring {
            let read = edges * size_of::<(EdgeVertices, [S; 3 + 1])>() as f64 + vertices * row;
            let written = if quantity == Quantity::Force { vertices * row } else { 0.0 };
            return Work { flops: None, bytes: Some(read + written) };
        }
        if !matches!(self.model, Model::StVK | Model::CompressibleStVK) {
            let written = match quantity {
                Quantity::Force => vertices * row,
                Quantity::Tangent(_) => tangent_bytes,
                _ => 0.0,
            };
            return Work { flops: None, bytes: Some(read + written) };
        }
        let flops = |per_element: u64| Some(tetrahedra * per_element as f64);
        let (flops, bytes) = match quantity {
            Quantity::Energy => (flops(fused.energy), read),
            Quantity::Force => (flops(fused.forces), read + vertices * row),
            Quantity::Tangent(TangentKind::Exact) => (flops(fused.tangent), read + tangent_bytes),
            Quantity::Tangent(_) => (None, read + tangent_bytes),
            Quantity::Product => (
                Some(36.0 * edges + 18.0 * vertices),
                (edges + vertices) * block
                    + edges * size_of::<EdgeVertices>() as f64
                    + 2.0 * vertices * row,
            ),
            Quantity::MatrixFree => (None, read + 2.0 * vertices * row),
            Quantity::Gather => (Some(4.0 * vertices), 3.0 * vertices * row),
        };
        Work { flops, bytes: Some(bytes) }
    }

    fn error(&self, quantity: Quantity) -> Option<f64> {
        let [energy, force, exact, projected] = self.errors;
        Some(match quantity {
            Quantity::Energy => energy,
            Quantity::Force | Quantity::Gather => force,
            Quantity::Tangent(TangentKind::Exact) | Quantity::Product | Quantity::MatrixFree => {
                exact
            }
            Quantity::Tangent(TangentKind::Projected) => projected,
            Quantity::Tangent(TangentKind::GaussNewton) => return None,
        })
    }
}

/// A fixed direction with components along everything.
pub(crate) fn directions(n: usize) -> Vec<DVec3> {
    let wave = |i: usize, k: f64| (i as f64 * k).sin();
    (0..n).map(|i| DVec3::new(wave(i, 0.7), wave(i, 1.3), wave(i, 2.1))).collect()
}

/// Largest distance of two vectors over the largest length of the second ones.
pub(crate) fn largest_difference(pairs: impl Iterator<Item = (DVec3, DVec3)>) -> f64 {
    let (mut difference, mut size) = (0.0_f64, 0.0_f64);
    for (found, truth) in pairs {
        let d = (found - truth).length();
        // a NaN must not hide
        difference = if d.is_nan() { f64::NAN } else { difference.max(d) };
        size = size.max(truth.length());
    }
    difference / size
}

/// Energy, forces, and products with exact and projected tangent, of one element.
fn element_sums<L: TetrahedronLaw>(
    e: &Element<f64>,
    u: &[[f64; 3]; 4],
    v: &[[f64; 3]; 4],
) -> Sums<4> {
    let product = |kind| L::tangent(e, u, kind).product(v);
    let forces = L::forces(e, u).unwrap_or_default();
    (L::energy(e, u), forces, product(TangentKind::Exact), product(TangentKind::Projected))
}

/// The axes of [`AxesDescription::isotropic`] in an element.
fn isotropic_triad(rest: &RestTetrahedron, lame: LameParameters) -> Triad<f64> {
    let [_, a, b, c] = rest.gradients;
    Triad {
        gradients: [a, b, c],
        axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        axial: [2.0 * lame.mu * rest.volume; 3],
        angular: [lame.mu * rest.volume; 3],
        volumetric: lame.lambda * rest.volume,
    }
}

/// Plain `f64` sums over elements, without columns, ranges, lanes or springs.
pub struct Reference {
    energy: f64,
    /// By vertex (N).
    pub forces: Vec<DVec3>,
    /// Of the exact tangent with the vectors that [`Timed`] multiplies it with.
    pub product: Vec<DVec3>,
    projected_product: Vec<DVec3>,
}

/// Energy, forces, and products with exact and projected tangent, of one element.
pub(crate) type Sums<const N: usize> = (f64, [[f64; 3]; N], [[f64; 3]; N], [[f64; 3]; N]);

impl Reference {
    /// Of so many vertices, without elements.
    pub(crate) fn zero(vertices: usize) -> Self {
        let zero = vec![DVec3::ZERO; vertices];
        let (forces, product, projected_product) = (zero.clone(), zero.clone(), zero);
        Self { energy: 0.0, forces, product, projected_product }
    }

    /// Adds an element.
    pub(crate) fn add<const N: usize>(&mut self, nodes: &[u32; N], sums: Sums<N>) {
        self.energy += sums.0;
        for (a, &node) in nodes.iter().enumerate() {
            let node = node as usize;
            self.forces[node] += DVec3::from_array(sums.1[a]);
            self.product[node] += DVec3::from_array(sums.2[a]);
            self.projected_product[node] += DVec3::from_array(sums.3[a]);
        }
    }

    /// At displacements `u` (m), of [`MATERIAL`].
    ///
    /// # Errors
    /// When an element has no volume.
    pub fn of(mesh: &Mesh, u: &[DVec3], model: Model) -> Result<Self, BenchError> {
        let lame = MATERIAL.lame()?;
        let v = directions(mesh.points.len());
        let mut sum = Self::zero(mesh.points.len());
        for nodes in &mesh.tetrahedra {
            let pick = |field: &[DVec3]| nodes.map(|i| field[i as usize].to_array());
            let rest = RestTetrahedron::new(pick(&mesh.points))?;
            let e = Element::<f64>::new(&rest, lame, model == Model::CompressibleStVK);
            let (u, v) = (pick(u), pick(&v));
            sum.add(
                nodes,
                match model {
                    Model::MassSpring => {
                        let tensile = SpringConstants::new(&rest, lame).tensile;
                        let springs = tensile.into_iter().zip(TETRAHEDRON_EDGES);
                        edge_sums(springs, pick(&mesh.points), [u, v])
                    }
                    Model::QuadraticSprings => element_sums::<QuadraticSprings>(&e, &u, &v),
                    Model::Linear => element_sums::<Linear>(&e, &u, &v),
                    Model::WarpedStiffness => element_sums::<WarpedStiffness>(&e, &u, &v),
                    Model::Corotational => element_sums::<Corotational>(&e, &u, &v),
                    Model::StVKFem => element_sums::<StVKFem>(&e, &u, &v),
                    Model::NeoHookean => element_sums::<NeoHookean>(&e, &u, &v),
                    Model::StVKVolume => element_sums::<StVKVolume>(&e, &u, &v),
                    Model::Axes => {
                        let e = isotropic_triad(&rest, lame);
                        let product = |kind| e.tangent(&u, kind).product(&v);
                        let [exact, projected] = [TangentKind::Exact, TangentKind::Projected];
                        (e.energy(&u), e.forces(&u), product(exact), product(projected))
                    }
                    // no row of another crate is timed
                    Model::StVK | Model::CompressibleStVK | Model::Own(_) => {
                        let product = |kind| tetrahedron::tangent(&e, &u, kind).product(&v);
                        let [exact, projected] = [TangentKind::Exact, TangentKind::Projected];
                        let forces = tetrahedron::forces(&e, &u);
                        let energy = tetrahedron::energy(&e, &u);
                        (energy, forces, product(exact), product(projected))
                    }
                },
            );
        }
        Ok(sum)
    }
}

/// Tensile springs between the vertices of one element.
pub(crate) fn edge_sums<const N: usize>(
    springs: impl Iterator<Item = (f64, [usize; 2])>,
    points: [[f64; 3]; N],
    [u, v]: [[[f64; 3]; N]; 2],
) -> Sums<N> {
    let (mut energy, mut forces, mut products) = (0.0, [[0.0; 3]; N], [[0.0; 3]; N]);
    for (k, [a, b]) in springs {
        let spring = Spring::new(k, sub(points[a], points[b]), sub(u[a], u[b]));
        energy += tensile_energy(k, spring.stretch.change);
        let pull = spring.pull();
        (forces[a], forces[b]) = (sub(forces[a], pull), add(forces[b], pull));
        let change = spring.product(sub(v[a], v[b]));
        (products[a], products[b]) = (add(products[a], change), sub(products[b], change));
    }
    (energy, forces, products, [[0.0; 3]; N])
}

/// A quadratic spring on an edge, written for reference sums.
struct Spring {
    stiffness: f64,
    stretch: Stretch<f64>,
    /// Tension over length (N/m).
    tension: f64,
}

impl Spring {
    /// Of stiffness `k` (N/m^3), with rest vector and difference of displacements `a - b` (m).
    fn new(stiffness: f64, rest: [f64; 3], change: [f64; 3]) -> Self {
        let stretch = Stretch::new(rest, change);
        let tension = stretch.slope * tensile_tension(stiffness, stretch.change);
        Self { stiffness, stretch, tension }
    }

    /// Force (N) on `b`.
    fn pull(&self) -> [f64; 3] {
        scale(self.stretch.edge, self.tension)
    }

    /// Product (N) of the tangent with the difference `way` of directions `a - b`, at `a`.
    fn product(&self, way: [f64; 3]) -> [f64; 3] {
        let s = &self.stretch;
        let along = dot(s.edge, way);
        let stiff = 0.5 * self.stiffness * s.slope * s.slope - self.tension * s.inverse_square;
        add(scale(s.edge, stiff * along), scale(way, self.tension))
    }
}

fn columns_against_arrays<S: Scalar>(mesh: &Mesh, rounds: Rounds) -> Result<ColumnRow, BenchError> {
    let (evaluation, model) = (Evaluation::Fused, Model::CompressibleStVK);
    let (mut simulation, _) = bent(mesh, precision_of::<S>(), 1, evaluation, model)?;
    request(&mut simulation, false, true, None);
    evaluate(&mut simulation);
    let Some(mut arrays) = PlainArrays::<S>::of(&mut simulation) else {
        return Err(BenchError::NoColumns);
    };
    let world = simulation.world_mut();
    let mut query = world.query::<&ElasticForce<S>>();
    let forces: Vec<[S; 4]> = single_table(query.contiguous_iter(world))
        .ok_or(BenchError::NoColumns)?
        .iter()
        .map(|f| f.0)
        .collect();
    let wide = |f: &[S; 4]| DVec3::from_array([0, 1, 2].map(|k| f[k].to_f64()));
    let difference =
        largest_difference(arrays.forces().iter().map(wide).zip(forces.iter().map(wide)));
    let repetitions = (20_000 / mesh.tetrahedra.len()).max(1);
    let mut times = [Vec::new(), Vec::new()];
    interleave(&mut [0, 1], rounds, |which| {
        let start = Instant::now();
        for _ in 0..repetitions {
            if *which == 0 {
                evaluate(&mut simulation);
            } else {
                black_box(arrays.forces());
            }
        }
        let seconds = start.elapsed().as_secs_f64() / repetitions as f64;
        times[*which].push(seconds);
        Ok::<f64, BenchError>(seconds)
    })?;
    let ratios: Vec<f64> = times[0].iter().zip(&times[1]).map(|(a, b)| a / b).collect();
    let per_tet = 1e9 / mesh.tetrahedra.len() as f64;
    let spread = |samples: &[f64]| Spread::of(samples).ok_or(BenchError::NoColumns);
    Ok(ColumnRow {
        tetrahedra: mesh.tetrahedra.len(),
        precision: S::NAME.to_string(),
        columns: spread(&times[0])?.scaled(per_tet),
        arrays: spread(&times[1])?.scaled(per_tet),
        ratio: spread(&ratios)?.median,
        difference,
    })
}

impl KernelReport {
    /// The row of a kernel with the widest instruction set, with the number of tetrahedra nearest to one asked for.
    pub fn find(
        &self,
        [kernel, quantity, model, precision]: [&str; 4],
        tetrahedra: usize,
        threads: usize,
    ) -> Option<&KernelRow> {
        self.rows.iter().find(|r| {
            [&*r.kernel, &*r.quantity, &*r.model, &*r.precision]
                == [kernel, quantity, model, precision]
                && r.instructions == InstructionSet::best().name()
                && r.threads == threads
                && r.tetrahedra.abs_diff(tetrahedra) * 20 < tetrahedra
        })
    }

    /// For people.
    pub fn tables(&self) -> Vec<Table> {
        let title = "Kernels: beam 0.2 x 0.05 x 0.05 m bent by 0.5 rad, E 10 kPa, nu 0.45";
        let pass = |r: &KernelRow| r.kernel.strip_prefix("pooled: ").map(str::to_string);
        let kernels = table_of!("kernels", title; for r in self.rows.iter().filter(|r| pass(r).is_none());
            where { let s = &r.ns_per_tet; }
            "kernel" => &r.kernel, "quantity" => &r.quantity, "model" => &r.model, "tets" => r.tetrahedra,
            "precision" => &r.precision, "threads" => r.threads, "instructions" => &r.instructions,
            "ns/tet" => s.median, "quartiles" => quartiles(s), "least" => s.minimum,
            "GFLOP/s" => r.gflop_per_s, "GB/s" => r.gb_per_s,
            "roofline %" => r.roofline_share.map(|x| 100.0 * x), "limit" => r.limit.clone(),
            "error" => r.error,
        )
        .note(
            "ns/tet: median wall time of the whole evaluation, gather included, per tetrahedron; \
             quartiles and least of the same samples. Energy, force and tangent are asked for one at \
             a time.",
        )
        .note(
            "GFLOP/s: operations of the element formulas, counted by running them with a number type \
             that counts (mul, add, div, sqrt one each; the vector kernels may do fewer). GB/s: bytes \
             that must cross once: element columns, vertex rows read and written, tangent blocks \
             written.",
        )
        .note(
            "roofline %: time that the probed multiply-add rate or read bandwidth of the level that \
             holds those bytes allows at best, over the time taken. error: largest difference from \
             the plain f64 sum over elements, over the largest value there (tangents: product with a \
             fixed vector).",
        );
        let rows = self.rows.iter().filter_map(|r| Some((pass(r)?, r, &r.ns_per_tet)));
        let passes = table_of!("passes", "Passes of the pooled force"; for (pass, r, s) in rows;
            "pass" => pass, "tets" => r.tetrahedra, "precision" => &r.precision, "threads" => r.threads,
            "instructions" => &r.instructions, "ns/tet" => s.median, "quartiles" => quartiles(s),
            "least" => s.minimum, "error" => r.error,
        )
        .note("error: that of the force.");
        let title = "Entity columns against plain arrays: fused force, svk_comp, one thread";
        let columns = table_of!("columns", title; for r in &self.columns;
            "tets" => r.tetrahedra, "precision" => &r.precision, "columns ns/tet" => r.columns.median,
            "arrays ns/tet" => r.arrays.median, "ratio" => r.ratio, "difference" => r.difference,
        )
        .note("ratio: median of the ratios of samples taken in turn; difference of the forces.");
        vec![kernels, passes, columns, membranes::table(&self.membranes)]
    }
}

/// `lower-upper`.
pub fn quartiles(s: &Spread) -> Cell {
    use super::table::three_digits;
    let (low, high) = (three_digits(s.lower_quartile), three_digits(s.upper_quartile));
    Cell::Text(format!("{low}-{high}"))
}
