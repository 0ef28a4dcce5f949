//! Kernels: nanoseconds per tetrahedron, operations and bytes per second, share of the roofline, and
//! the error of what was computed.

use super::arrays::PlainArrays;
use super::flops::{ElementFlops, pooled_flops};
use super::membranes::{self, MembraneRow};
use super::roofline::MachineLimits;
use super::step::LARGE;
use super::subject::{
    KernelQuantity, KernelTiming, Reference, Timed, free, largest_difference, repetitions,
};
use crate::toolbox::beam::{
    beam, bend, bent, cells_for, evaluate, lend, precision_of, request, take_back,
};
use crate::toolbox::prelude::*;
use crate::toolbox::stats::{Rounds, Spread, interleave};
use sinew::engine::columns::single_table;
use sinew::engine::element::{
    EdgeVertices, TetrahedronBlocks, TetrahedronEdges, TetrahedronVertices, TriangleEdges,
};
use sinew::engine::lanes::InstructionSet;
use sinew::engine::law::{ElasticEnergy, TangentKind};
use sinew::engine::report::SystemTimes;
use sinew::engine::scalar::Scalar;
use sinew::engine::vertex::ElasticForce;
use sinew::engine::workers::Workers;
use sinew::models::body::Evaluation;
use sinew::models::laws::svk::FusedStVK;
use std::collections::BTreeMap;
use std::hint::black_box;
use std::mem::size_of;

/// One kernel at one size.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct KernelRow {
    /// Law or data structure.
    pub kernel: String,
    /// What it computes.
    pub quantity: String,
    /// Name of the model in scenes.
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
#[derive(Clone, Debug, PartialEq, Serialize)]
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
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct KernelReport {
    /// One row per kernel, size, precision and number of threads.
    pub rows: Vec<KernelRow>,
    /// Entity columns against plain arrays.
    pub columns: Vec<ColumnRow>,
    /// Membranes.
    pub membranes: Vec<MembraneRow>,
}

/// Runs all kernels; `tell` hears what is going on.
///
/// # Errors
/// When a beam cannot be built.
pub fn run(
    sizes: &[usize],
    threads: &[usize],
    rounds: Rounds,
    limits: &[MachineLimits],
    mut tell: impl FnMut(&str),
) -> Result<KernelReport> {
    let mut report = KernelReport::default();
    for &size in sizes {
        let mesh = beam(cells_for(size))?;
        tell(&format!("kernels: {} tetrahedra", mesh.tetrahedra.len()));
        size_rows(&mesh, threads, rounds, limits, &mut report.rows)?;
        let more = Rounds { most: 2 * rounds.most + 1, ..rounds };
        report.columns.push(columns_against_arrays::<f64>(&mesh, more)?);
        report.columns.push(columns_against_arrays::<f32>(&mesh, more)?);
        report.membranes.extend(membranes::run(size, rounds)?);
    }
    Ok(report)
}

/// A kernel of a subject on a number of threads.
struct KernelVariant {
    subject: usize,
    quantity: KernelQuantity,
    threads: usize,
    instructions: InstructionSet,
    repetitions: usize,
}

/// What is timed: every model in every evaluation that it has, and axes.
fn timed_models() -> impl Iterator<Item = (Evaluation, Model)> {
    let models = Model::ALL.into_iter().chain([Model::Axes]);
    models.flat_map(|model| {
        let evaluations = [Evaluation::Fused, Evaluation::Pooled].into_iter();
        evaluations.filter(move |&by| model.supports(by)).map(move |by| (by, model))
    })
}

fn size_rows(
    mesh: &Mesh,
    threads: &[usize],
    rounds: Rounds,
    limits: &[MachineLimits],
    rows: &mut Vec<KernelRow>,
) -> Result<()> {
    let mut subjects: Vec<KernelSubject> = Vec::new();
    let large = mesh.tetrahedra.len() > LARGE;
    let is_timed = |model| !large || matches!(model, Model::StVK | Model::CompressibleStVK);
    for (evaluation, model) in timed_models().filter(|(_, model)| is_timed(*model)) {
        let reference = Reference::of(mesh, &bend(mesh), model)?;
        subjects.push(KernelSubject::new::<f64>(mesh, evaluation, model, &reference)?);
        subjects.push(KernelSubject::new::<f32>(mesh, evaluation, model, &reference)?);
    }
    let best = InstructionSet::best();
    let narrower =
        InstructionSet::ALL.into_iter().filter(|s| !large && *s != best && s.is_available());
    let settings: Vec<(usize, InstructionSet)> =
        threads.iter().map(|&n| (n, best)).chain(narrower.map(|set| (threads[0], set))).collect();
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
                    variants.push(KernelVariant {
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
    let samples = interleave(&mut variants, rounds, |v| {
        let subject = &mut subjects[v.subject];
        let key = (v.threads, v.instructions);
        let mut none = None;
        let pool = pools.iter_mut().find(|(k, _)| *k == key).map_or(&mut none, |(_, pool)| pool);
        let (seconds, parts) = subject.measure(v.quantity, pool, v.repetitions);
        if subject.evaluation == Evaluation::Pooled && v.quantity == KernelQuantity::Force {
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
            ..subjects[subject].row(format!("pooled: {name}"), KernelQuantity::Force, count)
        });
    }
    Ok(())
}

/// Work of one evaluation of the whole body.
#[derive(Clone, Copy, Debug, Default)]
struct KernelWork {
    flops: Option<f64>,
    bytes: Option<f64>,
}

/// The beam under one law.
struct KernelSubject {
    timed: Box<dyn KernelTiming>,
    evaluation: Evaluation,
    model: Model,
    precision: &'static str,
    /// Of energy, force, products with exact and projected tangent.
    errors: [f64; 4],
    /// Tetrahedra, vertices, edges, triangles.
    counts: [f64; 4],
}

impl KernelSubject {
    fn new<S: Scalar>(
        mesh: &Mesh,
        evaluation: Evaluation,
        model: Model,
        reference: &Reference,
    ) -> Result<Self> {
        let (simulation, body) = bent(mesh, precision_of::<S>(), 1, evaluation, model)?;
        let mut timed = Timed::<S>::new(simulation, body, Some(free::<FusedStVK, S>));
        request(&mut timed.simulation, true, true, Some(TangentKind::Projected));
        evaluate(&mut timed.simulation);
        timed.take_tangent();
        let projected = timed.product_error(KernelQuantity::Product, &reference.projected_product);
        request(&mut timed.simulation, true, true, Some(TangentKind::Exact));
        evaluate(&mut timed.simulation);
        timed.take_tangent();
        let energy = timed.simulation.world().resource::<ElasticEnergy>().total;
        let energy = (energy - reference.energy).abs() / reference.energy;
        let force = timed.force_error(body, &reference.forces);
        let exact = timed.product_error(KernelQuantity::Product, &reference.product);
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

    fn quantities(&self) -> Vec<KernelQuantity> {
        let mut all = vec![
            KernelQuantity::Energy,
            KernelQuantity::Force,
            KernelQuantity::Tangent(TangentKind::Exact),
        ];
        if matches!(
            self.model,
            Model::CompressibleStVK
                | Model::Corotational
                | Model::NeoHookean
                | Model::StVKVolume
                | Model::Axes
        ) {
            all.push(KernelQuantity::Tangent(TangentKind::Projected));
        }
        if self.model == Model::CompressibleStVK && self.evaluation == Evaluation::Fused {
            all.extend([
                KernelQuantity::Product,
                KernelQuantity::MatrixFree,
                KernelQuantity::Gather,
                KernelQuantity::GatherTangent,
            ]);
        }
        all
    }

    /// Seconds per repetition in a pool, and those of every system.
    fn measure(
        &mut self,
        quantity: KernelQuantity,
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
    fn row(&self, kernel: String, quantity: KernelQuantity, tetrahedra: usize) -> KernelRow {
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

    fn kernel(&self, quantity: KernelQuantity) -> &'static str {
        match (quantity, self.evaluation) {
            (KernelQuantity::Product, _) => "assembled symmetric half",
            (KernelQuantity::MatrixFree, _) => "matrix-free",
            (KernelQuantity::Gather, _) => "private force arrays",
            (KernelQuantity::GatherTangent, _) => "private tangent blocks",
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
    fn has_lanes(&self, quantity: KernelQuantity) -> bool {
        self.evaluation == Evaluation::Fused
            && self.model == Model::CompressibleStVK
            && !matches!(
                quantity,
                KernelQuantity::Product | KernelQuantity::Gather | KernelQuantity::GatherTangent
            )
    }

    fn work(&self, quantity: KernelQuantity) -> KernelWork {
        match self.precision {
            "f32" => self.work_in::<f32>(quantity),
            _ => self.work_in::<f64>(quantity),
        }
    }

    fn work_in<S: Scalar>(&self, quantity: KernelQuantity) -> KernelWork {
        let [tetrahedra, vertices, edges, triangles] = self.counts;
        let fused = ElementFlops::count(self.model.has_compression());
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
                KernelQuantity::Force => KernelWork {
                    flops: Some(pooled_flops(edges, triangles, tetrahedra, compressible)),
                    bytes: Some(sizes.iter().sum()),
                },
                _ => KernelWork::default(),
            };
        }
        if self.model == Model::MassSpring {
            let read = edges * size_of::<(EdgeVertices, [S; 3 + 1])>() as f64 + vertices * row;
            let written = if quantity == KernelQuantity::Force { vertices * row } else { 0.0 };
            return KernelWork { flops: None, bytes: Some(read + written) };
        }
        if !matches!(self.model, Model::StVK | Model::CompressibleStVK) {
            let written = match quantity {
                KernelQuantity::Force => vertices * row,
                KernelQuantity::Tangent(_) => tangent_bytes,
                _ => 0.0,
            };
            return KernelWork { flops: None, bytes: Some(read + written) };
        }
        let flops = |per_element: u64| Some(tetrahedra * per_element as f64);
        let (flops, bytes) = match quantity {
            KernelQuantity::Energy => (flops(fused.energy), read),
            KernelQuantity::Force => (flops(fused.forces), read + vertices * row),
            KernelQuantity::Tangent(TangentKind::Exact) => {
                (flops(fused.tangent), read + tangent_bytes)
            }
            KernelQuantity::Tangent(_) => (None, read + tangent_bytes),
            KernelQuantity::Product => (
                Some(36.0 * edges + 18.0 * vertices),
                (edges + vertices) * block
                    + edges * size_of::<EdgeVertices>() as f64
                    + 2.0 * vertices * row,
            ),
            KernelQuantity::MatrixFree => (None, read + 2.0 * vertices * row),
            KernelQuantity::Gather => (Some(4.0 * vertices), 3.0 * vertices * row),
            KernelQuantity::GatherTangent => {
                (Some(9.0 * (edges + vertices)), 3.0 * (edges + vertices) * block)
            }
        };
        KernelWork { flops, bytes: Some(bytes) }
    }

    fn error(&self, quantity: KernelQuantity) -> Option<f64> {
        let [energy, force, exact, projected] = self.errors;
        Some(match quantity {
            KernelQuantity::Energy => energy,
            KernelQuantity::Force | KernelQuantity::Gather => force,
            KernelQuantity::Tangent(TangentKind::Exact)
            | KernelQuantity::Product
            | KernelQuantity::MatrixFree
            | KernelQuantity::GatherTangent => exact,
            KernelQuantity::Tangent(TangentKind::Projected) => projected,
            KernelQuantity::Tangent(TangentKind::GaussNewton) => return None,
        })
    }
}

fn columns_against_arrays<S: Scalar>(mesh: &Mesh, rounds: Rounds) -> Result<ColumnRow> {
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
            "ns/tet" => s.median, "quartiles" => s.quartiles(), "least" => s.minimum,
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
            "instructions" => &r.instructions, "ns/tet" => s.median, "quartiles" => s.quartiles(),
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
