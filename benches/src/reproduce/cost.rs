//! Delingette 2008, figure 3, top: time of force and matrix-vector product of the formulations, for
//! membranes and tetrahedra.

use super::{Figure, Finding};
use crate::beam::{as_in_a_step, beam, bend, bent, cells_for, request};
use crate::bench::error::BenchError;
use crate::bench::kernels::{Reference, directions, largest_difference, quartiles};
use crate::bench::membranes::{self, QUANTITIES, sheet};
use crate::bench::plot::{Bar, bars};
use crate::bench::report::Chart;
use crate::bench::stats::{Rounds, Spread, interleave};
use crate::bench::table::Table;
use glam::DVec3;
use sinew::engine::law::TangentKind;
use sinew::engine::matrix::{BlockMatrix, ProductSpans, Tangent};
use sinew::engine::mesh::Mesh;
use sinew::engine::scalar::Scalar;
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::topology::Topology;
use sinew::engine::workers::Workers;
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::MembraneModel;
use sinew::models::frame::tetrahedra;
use sinew::models::laws::corotational::Corotational;
use sinew::models::laws::quadratic::QuadraticSprings;
use sinew::models::laws::svk::FusedStVK;
use sinew::prelude::*;
use std::time::Instant;

/// Places in [`QUANTITIES`].
const FORCE: usize = 0;
const TANGENT: usize = 1;
const ASSEMBLED: usize = 2;
const FREE: usize = 3;

/// Elements of sheet and beam, about those of the paper's liver.
const ELEMENTS: usize = 5_000;
const TURNS: usize = 250;

const MEMBRANES: [(&str, MembraneModel, Evaluation); 5] = [
    ("mass-spring", MembraneModel::MassSpring, Evaluation::Fused),
    ("TRBS", MembraneModel::Biquadratic, Evaluation::Fused),
    ("TRBS (pooled)", MembraneModel::Biquadratic, Evaluation::Pooled),
    ("TRQS", MembraneModel::Quadratic, Evaluation::Fused),
    ("corotational", MembraneModel::Corotational, Evaluation::Fused),
];

const SOLIDS: [(&str, Model, bool); 7] = [
    ("mass-spring", Model::MassSpring, false),
    ("TBS", Model::StVK, false),
    ("TBS + compression", Model::CompressibleStVK, false),
    ("TQS", Model::QuadraticSprings, false),
    ("corotational", Model::Corotational, false),
    ("TBS (crushed)", Model::StVK, true),
    ("TBS + compression (crushed)", Model::CompressibleStVK, true),
];

/// Element, law, law it is compared with, ratio in the text of the paper, whether that is an upper limit.
const RATIOS: [(&str, &str, &str, f64, bool); 7] = [
    ("triangle", "TRBS", "mass-spring", 1.6, false),
    ("triangle", "TRBS (pooled)", "mass-spring", 1.6, false),
    ("triangle", "TRQS", "TRBS", 1.6, false),
    ("tetrahedron", "TQS", "TBS", 2.0, false),
    ("tetrahedron", "TBS + compression", "TBS", 1.65, true),
    ("tetrahedron", "TBS + compression (crushed)", "TBS (crushed)", 1.65, true),
    ("tetrahedron", "corotational", "TBS", 1.8, false),
];

/// How far a ratio may be from the paper's and still be called the same.
const SAME: f64 = 0.2;

/// A formulation in one precision, its times in seconds.
struct Subject {
    element: &'static str,
    law: &'static str,
    precision: &'static str,
    elements: usize,
    quantities: Vec<usize>,
    /// Errors of force and product.
    errors: [f64; 2],
    /// Seconds of one repetition of a quantity.
    measure: Box<dyn FnMut(usize, usize) -> f64>,
    /// Samples by quantity, turn by turn.
    samples: [Vec<f64>; QUANTITIES.len()],
}

impl Subject {
    fn sheet<S: Scalar>(
        mesh: &Mesh,
        law: &'static str,
        model: MembraneModel,
        evaluation: Evaluation,
    ) -> Result<Self, BenchError> {
        let mut subject = membranes::Subject::<S>::new(mesh, model, evaluation)?;
        Ok(Self {
            element: "triangle",
            law,
            precision: S::NAME,
            elements: mesh.triangles.len(),
            quantities: subject.quantities(),
            errors: subject.errors,
            measure: Box::new(move |quantity, repetitions| subject.measure(quantity, repetitions)),
            samples: Default::default(),
        })
    }

    fn solid<S: Scalar>(
        mesh: &Mesh,
        law: &'static str,
        model: Model,
        u: &[DVec3],
    ) -> Result<Self, BenchError> {
        let mut solid = Solid::<S>::new(mesh, model, u)?;
        let free = model != Model::MassSpring;
        Ok(Self {
            element: "tetrahedron",
            law,
            precision: S::NAME,
            elements: mesh.tetrahedra.len(),
            quantities: (0..QUANTITIES.len() - usize::from(!free)).collect(),
            errors: solid.errors,
            measure: Box::new(move |quantity, repetitions| solid.measure(quantity, repetitions)),
            samples: Default::default(),
        })
    }

    /// Nanoseconds per element.
    fn time(&self, quantity: usize) -> Option<Spread> {
        Some(Spread::of(&self.samples[quantity])?.scaled(1e9 / self.elements as f64))
    }

    /// Time of one quantity or several together over that of another subject, turn by turn; `None` when
    /// one of them cannot do it.
    fn over(&self, other: &Self, quantities: &[usize]) -> Option<Spread> {
        let turns = |s: &Self| quantities.iter().map(|&q| s.samples[q].len()).min().unwrap_or(0);
        let time =
            |s: &Self, turn: usize| quantities.iter().map(|&q| s.samples[q][turn]).sum::<f64>();
        let ratios: Vec<f64> = (0..turns(self).min(turns(other)))
            .map(|turn| time(self, turn) / time(other, turn))
            .collect();
        Spread::of(&ratios)
    }
}

/// A beam under one law.
struct Solid<S: Scalar> {
    simulation: Simulation,
    model: Model,
    matrix: BlockMatrix<S>,
    spans: ProductSpans<S>,
    x: Vec<[S; 4]>,
    y: Vec<[S; 4]>,
    errors: [f64; 2],
}

impl<S: Scalar> Solid<S> {
    fn new(mesh: &Mesh, model: Model, u: &[DVec3]) -> Result<Self, BenchError> {
        let precision = if S::NAME == "f32" { Precision::F32 } else { Precision::F64 };
        let (mut simulation, body) = bent(mesh, precision, 1, Evaluation::Fused, model)?;
        simulation.set_state(body, u, &vec![DVec3::ZERO; u.len()])?;
        request(&mut simulation, false, true, Some(TangentKind::Exact));
        simulation.world_mut().run_schedule(ForceSchedule);
        let reference = Reference::of(mesh, u, model)?;
        let order = simulation.topology().bodies[body.0].vertex_order.clone();
        let direction = directions(u.len());
        let row = |&vertex: &u32| {
            let [a, b, c] = direction[vertex as usize].to_array().map(S::from_f64);
            [a, b, c, S::ZERO]
        };
        let x: Vec<[S; 4]> = order.iter().map(row).collect();
        let y = vec![[S::ZERO; 4]; x.len()];
        let matrix = simulation.world().resource::<Tangent<S>>().matrix.clone();
        let forces = simulation.elastic_forces(body);
        let force = largest_difference(forces.into_iter().zip(reference.forces.iter().copied()));
        let spans = ProductSpans::default();
        let mut solid = Self { simulation, model, matrix, spans, x, y, errors: [force, 0.0] };
        for quantity in [ASSEMBLED, FREE] {
            if quantity == ASSEMBLED || model != Model::MassSpring {
                solid.measure(quantity, 1);
                let found = order.iter().zip(&solid.y).map(|(&vertex, y)| {
                    let y = DVec3::from_array([0, 1, 2].map(|k| y[k].to_f64()));
                    (y, reference.product[vertex as usize])
                });
                let error = largest_difference(found);
                // a NaN must not hide
                let worst = &mut solid.errors[1];
                *worst = if error.is_nan() { error } else { worst.max(error) };
            }
        }
        Ok(solid)
    }

    /// Seconds of one repetition.
    fn measure(&mut self, quantity: usize, repetitions: usize) -> f64 {
        let kind = TangentKind::Exact;
        let tangent = (quantity == TANGENT).then_some(kind);
        request(&mut self.simulation, false, quantity == FORCE, tangent);
        let Self { simulation, model, matrix, spans, x, y, .. } = self;
        as_in_a_step(simulation, |world| {
            let start = Instant::now();
            for _ in 0..repetitions {
                if quantity == ASSEMBLED {
                    let workers = world.resource::<Workers>();
                    matrix.multiply(world.resource::<Topology>(), workers, spans, x, y);
                } else if quantity == FREE {
                    y.fill([S::ZERO; 4]);
                    let done = match model {
                        Model::QuadraticSprings => {
                            tetrahedra::multiply::<QuadraticSprings, S>(world, kind, x, y)
                        }
                        Model::Corotational => {
                            tetrahedra::multiply::<Corotational, S>(world, kind, x, y)
                        }
                        _ => tetrahedra::multiply::<FusedStVK, S>(world, kind, x, y),
                    };
                    debug_assert!(done.is_ok(), "exact tangents have a product");
                } else {
                    world.run_schedule(ForceSchedule);
                }
            }
            start.elapsed().as_secs_f64() / repetitions as f64
        })
    }
}

/// Displacements (m) that shorten everything by about 15 %, unevenly.
fn crush(mesh: &Mesh) -> Vec<DVec3> {
    let wave = |x: f64, k: f64| 0.03 * (k * x).sin() / k;
    let uneven = |p: &DVec3| DVec3::new(wave(p.x, 70.0), wave(p.y, 150.0), wave(p.z, 110.0));
    mesh.points.iter().map(|p| -0.15 * *p + uneven(p)).collect()
}

/// Everything measured, turn by turn, `turns` times; largest volume ratio of the crushed beam.
fn measure(elements: usize, turns: usize) -> Result<(Vec<Subject>, f64), BenchError> {
    let (sheet, beam) = (sheet(elements)?, beam(cells_for(elements))?);
    let (bent_u, crushed_u) = (bend(&beam), crush(&beam));
    let mut subjects = Vec::new();
    for (law, model, evaluation) in MEMBRANES {
        subjects.push(Subject::sheet::<f64>(&sheet, law, model, evaluation)?);
        subjects.push(Subject::sheet::<f32>(&sheet, law, model, evaluation)?);
    }
    for (law, model, crushed) in SOLIDS {
        let u = if crushed { &crushed_u } else { &bent_u };
        subjects.push(Subject::solid::<f64>(&beam, law, model, u)?);
        subjects.push(Subject::solid::<f32>(&beam, law, model, u)?);
    }
    let mut variants = Vec::new();
    for (i, subject) in subjects.iter_mut().enumerate() {
        for quantity in subject.quantities.clone() {
            // about half a millisecond; the first call warms up pages and caches
            (subject.measure)(quantity, 1);
            let once = (subject.measure)(quantity, 1);
            variants.push((i, quantity, (5e-4 / once.max(1e-6)).ceil() as usize));
        }
    }
    let rounds = Rounds { most: turns, least: turns, seconds: f64::INFINITY };
    let samples = interleave(&mut variants, rounds, |&mut (subject, quantity, repetitions)| {
        Ok::<f64, BenchError>((subjects[subject].measure)(quantity, repetitions))
    })?;
    for (&(subject, quantity, _), samples) in variants.iter().zip(samples) {
        subjects[subject].samples[quantity] = samples;
    }
    let (mut simulation, body) = bent(&beam, Precision::F64, 1, Evaluation::Fused, Model::StVK)?;
    simulation.set_state(body, &crushed_u, &vec![DVec3::ZERO; crushed_u.len()])?;
    let ratios = simulation.volume_ratios(body);
    Ok((subjects, ratios.into_iter().fold(f64::NEG_INFINITY, f64::max)))
}

pub(super) fn figure() -> Result<Figure, BenchError> {
    let (subjects, largest_ratio) = measure(ELEMENTS, TURNS)?;
    let count = |element| subjects.iter().find(|s| s.element == element).map_or(0, |s| s.elements);
    Ok(Figure {
        letter: 'c',
        title: "Time of force and matrix-vector product (Fig. 3, top)",
        setting: format!(
            "An uneven sheet of {} triangles, bent and stretched, and a beam of {} tetrahedra, bent by half a \
             radian; crushed: every tetrahedron compressed, J at most {largest_ratio:.2}. Fused evaluation, one \
             thread, gather included; all take turns {TURNS} times in one run. The paper scans edges, triangles \
             and tetrahedra one after the other, as pooled evaluation does, on a Core Duo at 1.83 GHz; its text \
             gives ratios for force and product together. Within a fifth is called the same.",
            count("triangle"),
            count("tetrahedron"),
        ),
        findings: findings(&subjects),
        tables: tables(&subjects),
        numbers: vec![numbers(&subjects)],
        charts: vec![
            chart(
                "c-membranes",
                "triangle",
                "Membranes, f64; red: what the paper's ratios would give",
                &subjects,
            )?,
            chart(
                "c-solids",
                "tetrahedron",
                "Solids, f64; red: what the paper's ratios would give",
                &subjects,
            )?,
        ],
    })
}

fn find<'a>(
    subjects: &'a [Subject],
    element: &str,
    law: &str,
    precision: &str,
) -> Option<&'a Subject> {
    subjects.iter().find(|s| (s.element, s.law, s.precision) == (element, law, precision))
}

/// Time of a law over that of another, per element.
fn ratio(
    subjects: &[Subject],
    [element, law, base, precision]: [&str; 4],
    quantities: &[usize],
) -> Option<Spread> {
    let [law, base] = [law, base].map(|name| find(subjects, element, name, precision));
    law?.over(base?, quantities)
}

fn findings(subjects: &[Subject]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (element, law, base, paper, limit) in RATIOS {
        let of = |precision, quantities: &[usize]| {
            ratio(subjects, [element, law, base, precision], quantities).map(|s| s.median)
        };
        let Some(force) = of("f64", &[FORCE]) else { continue };
        let worst = if limit { "at worst " } else { "" };
        let mut text =
            format!("time of {law} over {base}, per {element}: {worst}{paper} in the paper, here ");
        let both = of("f64", &[FORCE, FREE]);
        if let (Some(both), Some(product)) = (both, of("f64", &[FREE])) {
            text += &format!(
                "{both:.2} for force and product without matrix together ({force:.2} and {product:.2})"
            );
        } else {
            text += &format!("{force:.2} for force");
        }
        let ratio = both.unwrap_or(force);
        let agrees = if limit { ratio <= paper } else { (ratio / paper - 1.0).abs() <= SAME };
        findings.push(Finding { agrees, text });
    }
    let roots = [("triangle", "TRQS", "TRBS"), ("tetrahedron", "TQS", "TBS")].map(|(e, a, b)| {
        ratio(subjects, [e, a, b, "f64"], &[FORCE]).map_or(f64::NAN, |s| s.median)
    });
    let faster = roots.iter().all(|r| *r > 1.0);
    findings.push(Finding {
        agrees: faster,
        text: format!(
            "biquadratic springs, which need no square root, are {} than quadratic ones: force takes {:.2} \
             (triangles) and {:.2} times as long with these (tetrahedra)",
            if faster { "faster" } else { "not both faster" },
            roots[0],
            roots[1]
        ),
    });
    findings
}

fn tables(subjects: &[Subject]) -> Vec<Table> {
    let mut ratios = Table::new(
        "c-ratios",
        "Ratios of times per element, one thread (medians, quartiles of the turns)",
        &[
            "element",
            "law",
            "over",
            "paper",
            "force f64",
            "quartiles",
            "product f64",
            "both f64",
            "force f32",
            "product f32",
        ],
    )
    .note(
        "product: exact tangent times vector without a matrix, which edge springs and pooled ones have not; \
         both: force and product together.",
    );
    let laws = RATIOS.map(|(e, law, base, paper, _)| (e, law, base, Some(paper)));
    let unprinted = [
        ("triangle", "corotational", "mass-spring", None),
        ("triangle", "corotational", "TRBS", None),
        ("tetrahedron", "TBS", "mass-spring", None),
    ];
    for (element, law, base, paper) in laws.into_iter().chain(unprinted) {
        let of = |precision, quantities: &[usize]| {
            ratio(subjects, [element, law, base, precision], quantities)
        };
        let median = |precision, quantities: &[usize]| of(precision, quantities).map(|s| s.median);
        ratios.row(vec![
            element.into(),
            law.into(),
            base.into(),
            paper.into(),
            median("f64", &[FORCE]).into(),
            of("f64", &[FORCE]).as_ref().map_or("-".into(), quartiles),
            median("f64", &[FREE]).into(),
            median("f64", &[FORCE, FREE]).into(),
            median("f32", &[FORCE]).into(),
            median("f32", &[FREE]).into(),
        ]);
    }
    let mut tables = vec![ratios];
    for (name, element, title) in [
        ("c-membranes", "triangle", "Membranes, ns per triangle (medians)"),
        ("c-solids", "tetrahedron", "Solids, ns per tetrahedron (medians)"),
    ] {
        let mut table = Table::new(
            name,
            title,
            &[
                "law", "precision", "force", "quartiles", "product without matrix", "quartiles",
                "product, assembled", "assembly", "error of force", "error of product",
            ],
        )
        .note(
            "errors: largest difference from a plain f64 sum over elements, over the largest value.",
        );
        let own = || subjects.iter().filter(|s| s.element == element);
        let mut assembled: Vec<f64> = Vec::new();
        for s in own() {
            let time = |quantity| s.time(quantity);
            let median = |quantity| time(quantity).map(|t| t.median);
            let spread = |quantity| time(quantity).as_ref().map_or("-".into(), quartiles);
            if s.precision == "f64" {
                assembled.extend(median(ASSEMBLED));
            }
            table.row(vec![
                s.law.into(),
                s.precision.into(),
                median(FORCE).into(),
                spread(FORCE),
                median(FREE).into(),
                spread(FREE),
                median(ASSEMBLED).into(),
                median(TANGENT).into(),
                s.errors[0].into(),
                s.errors[1].into(),
            ]);
        }
        assembled.sort_by(f64::total_cmp);
        if let [least, .., most] = assembled[..] {
            table = table.note(format!(
                "The product with an assembled matrix does not depend on the law: {least:.2} to {most:.2} ns in \
                 f64; what does is the assembly of its exact tangent."
            ));
        }
        tables.push(table);
    }
    tables
}

/// Everything, for files.
fn numbers(subjects: &[Subject]) -> Table {
    let mut table = Table::new(
        "c-numbers",
        "Times per element",
        &[
            "element",
            "law",
            "precision",
            "quantity",
            "least ns",
            "lower quartile ns",
            "median ns",
            "upper quartile ns",
            "error",
        ],
    );
    for s in subjects {
        for &quantity in &s.quantities {
            let Some(time) = s.time(quantity) else { continue };
            table.row(vec![
                s.element.into(),
                s.law.into(),
                s.precision.into(),
                QUANTITIES[quantity].into(),
                time.minimum.into(),
                time.lower_quartile.into(),
                time.median.into(),
                time.upper_quartile.into(),
                s.errors[usize::from(quantity != FORCE)].into(),
            ]);
        }
    }
    table
}

/// Times in f64, with those that the paper's ratios would give.
fn chart(
    name: &str,
    element: &str,
    title: &str,
    subjects: &[Subject],
) -> Result<Chart, BenchError> {
    let mut rows = Vec::new();
    let own = || subjects.iter().filter(|s| s.element == element && s.precision == "f64");
    let bar = |label, time: Spread, aim, colour| Bar {
        label,
        value: time.median,
        quartiles: [time.lower_quartile, time.upper_quartile],
        aim,
        colour,
    };
    for (colour, (quantity, what)) in
        [(FORCE, "force"), (FREE, "product without matrix")].into_iter().enumerate()
    {
        for s in own() {
            let Some(time) = s.time(quantity) else { continue };
            let paper = RATIOS.iter().find(|r| (r.0, r.1) == (element, s.law));
            let aim = paper.and_then(|r| {
                let base = find(subjects, element, r.2, "f64")?.time(quantity)?;
                Some(r.3 * base.median)
            });
            rows.push(bar(format!("{}: {what}", s.law), time, aim, colour));
        }
    }
    // the same for every law
    if let Some(time) = own().next().and_then(|s| s.time(ASSEMBLED)) {
        rows.push(bar("any law: product, assembled".into(), time, None, 2));
    }
    let svg = bars(title, &format!("ns per {element}, one thread"), &rows)?;
    Ok(Chart { name: name.into(), svg })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_come_with_small_errors_and_ratios_are_theirs() {
        let (subjects, largest_ratio) = measure(200, 3).unwrap();
        assert_eq!(subjects.len(), 2 * (MEMBRANES.len() + SOLIDS.len()));
        assert!(largest_ratio < 0.8, "{largest_ratio}");
        for s in &subjects {
            let limit = if s.precision == "f64" { 1e-12 } else { 1e-4 };
            let worst = s.errors[0].max(s.errors[1]);
            assert!(worst < limit, "{} {} {}: {:?}", s.element, s.law, s.precision, s.errors);
            let free = !["mass-spring", "TRBS (pooled)"].contains(&s.law);
            assert_eq!(s.time(FREE).is_some(), free, "{}", s.law);
        }
        // of known samples
        let mut known = subjects;
        for s in &mut known {
            let seconds = if s.law == "TQS" { 3e-6 } else { 2e-6 };
            s.samples = std::array::from_fn(|_| vec![seconds; 3]);
        }
        let [tqs, tbs] = ["TQS", "TBS"].map(|l| find(&known, "tetrahedron", l, "f64").unwrap());
        assert_eq!(tqs.over(tbs, &[FORCE, FREE]).unwrap().median, 3e-6 / 2e-6);
        assert!((tbs.time(FORCE).unwrap().median * tbs.elements as f64 - 2e3).abs() < 1e-9);
        let verdicts: Vec<bool> = findings(&known).iter().map(|f| f.agrees).collect();
        // 1 beside 1.6 three times, 1.5 beside 2, 1 below 1.65 twice, 1 beside 1.8, triangles as fast
        assert_eq!(verdicts, [false, false, false, false, true, true, false, false]);
    }
}
