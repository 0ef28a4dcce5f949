//! Delingette 2008, figure 3, top: time of force and matrix-vector product of the formulations, for
//! membranes and tetrahedra.

use super::prelude::*;
use sinew::engine::scalar::Scalar;
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::MembraneModel;
use sinew::models::frame::stand_in::Corotational;
use sinew::models::laws::corotational::WarpedStiffness;
use sinew::models::laws::quadratic::QuadraticSprings;
use sinew::models::laws::svk::FusedStVK;
use sinew_benches::bench::membranes::{MembraneSubject, QUANTITIES, sheet};
use sinew_benches::bench::subject::{Free, KernelTiming, Reference, Timed, free, repetitions};
use sinew_benches::toolbox::beam::{beam, bend, bent, cells_for, precision_of};
use sinew_benches::toolbox::plot::{Bar, bars};
use sinew_benches::toolbox::stats::{Rounds, Spread, interleave};

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

const SOLIDS: [(&str, Model, Evaluation, bool); 12] = {
    use Evaluation::{Fused, Pooled};
    [
        ("mass-spring", Model::MassSpring, Fused, false),
        ("TBS", Model::StVK, Fused, false),
        ("TBS (pooled)", Model::StVK, Pooled, false),
        ("TBS + compression", Model::CompressibleStVK, Fused, false),
        ("TBS + compression (pooled)", Model::CompressibleStVK, Pooled, false),
        ("TQS", Model::QuadraticSprings, Fused, false),
        ("corotational", Model::Corotational, Fused, false),
        ("corotational (warped)", Model::WarpedStiffness, Fused, false),
        ("TBS (crushed)", Model::StVK, Fused, true),
        ("TBS (pooled, crushed)", Model::StVK, Pooled, true),
        ("TBS + compression (crushed)", Model::CompressibleStVK, Fused, true),
        ("TBS + compression (pooled, crushed)", Model::CompressibleStVK, Pooled, true),
    ]
};

/// Element, law, law it is compared with, ratio in the text of the paper, whether that is an upper limit. The paper's
/// own passes are pooled springs and warped stiffness; quadratic springs exist fused only, so these are
/// compared with fused ones.
const RATIOS: [(&str, &str, &str, f64, bool); 9] = [
    ("triangle", "TRBS", "mass-spring", 1.6, false),
    ("triangle", "TRBS (pooled)", "mass-spring", 1.6, false),
    ("triangle", "TRQS", "TRBS", 1.6, false),
    ("tetrahedron", "TQS", "TBS", 2.0, false),
    ("tetrahedron", "TBS + compression", "TBS", 1.65, true),
    ("tetrahedron", "TBS + compression (crushed)", "TBS (crushed)", 1.65, true),
    ("tetrahedron", "TBS + compression (pooled, crushed)", "TBS (pooled, crushed)", 1.65, true),
    ("tetrahedron", "corotational (warped)", "TBS", 1.8, false),
    ("tetrahedron", "corotational (warped)", "TBS (pooled)", 1.8, false),
];

/// How far a ratio may be from the paper's and still be called the same.
const SAME: f64 = 0.2;

/// A formulation in one precision, its times in seconds.
struct Subject {
    element: &'static str,
    law: &'static str,
    precision: &'static str,
    elements: usize,
    /// How many of [`QUANTITIES`] it can compute.
    quantities: usize,
    /// Errors of force and product.
    errors: [f64; 2],
    timed: Box<dyn KernelTiming>,
    /// Samples by quantity, turn by turn.
    samples: [Vec<f64>; QUANTITIES.len()],
}

impl Subject {
    fn sheet<S: Scalar>(
        mesh: &Mesh,
        law: &'static str,
        model: MembraneModel,
        evaluation: Evaluation,
    ) -> Result<Self> {
        let (element, precision, elements) = ("triangle", S::NAME, mesh.triangles.len());
        let own = MembraneSubject::new::<S>(mesh, model, evaluation)?;
        let MembraneSubject { timed, quantities, errors, .. } = own;
        let samples = Default::default();
        Ok(Self { element, law, precision, elements, quantities, errors, timed, samples })
    }

    /// The beam under one law.
    fn solid<S: Scalar>(
        mesh: &Mesh,
        law: &'static str,
        (model, evaluation): (Model, Evaluation),
        u: &[DVec3],
    ) -> Result<Self> {
        let (element, precision, elements) = ("tetrahedron", S::NAME, mesh.tetrahedra.len());
        let (mut simulation, body) = bent(mesh, precision_of::<S>(), 1, evaluation, model)?;
        simulation.set_state(body, u, &vec![DVec3::ZERO; u.len()])?;
        let product: Option<Free<S>> = match model {
            _ if evaluation == Evaluation::Pooled => None,
            Model::MassSpring => None,
            Model::WarpedStiffness => Some(free::<WarpedStiffness, S>),
            Model::QuadraticSprings => Some(free::<QuadraticSprings, S>),
            Model::Corotational => Some(free::<Corotational, S>),
            _ => Some(free::<FusedStVK, S>),
        };
        let quantities = QUANTITIES.len() - usize::from(product.is_none());
        let mut timed = Timed::new(simulation, body, product);
        let reference = Reference::of(mesh, u, model)?;
        let mut errors = [timed.force_error(body, &reference.forces), 0.0];
        for (_, product) in &QUANTITIES[ASSEMBLED..quantities] {
            let error = timed.product_error(*product, &reference.product);
            // a NaN must not hide
            errors[1] = if error.is_nan() { error } else { errors[1].max(error) };
        }
        let (timed, samples) = (Box::new(timed), Default::default());
        Ok(Self { element, law, precision, elements, quantities, errors, timed, samples })
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

/// Displacements (m) that shorten everything by about 15 %, unevenly.
fn crush(mesh: &Mesh) -> Vec<DVec3> {
    let wave = |x: f64, k: f64| 0.03 * (k * x).sin() / k;
    let uneven = |p: &DVec3| DVec3::new(wave(p.x, 70.0), wave(p.y, 150.0), wave(p.z, 110.0));
    mesh.points.iter().map(|p| -0.15 * *p + uneven(p)).collect()
}

/// Everything measured, turn by turn, `turns` times; largest volume ratio of the crushed beam.
fn measure(elements: usize, turns: usize) -> Result<(Vec<Subject>, f64)> {
    let (sheet, beam) = (sheet(elements)?, beam(cells_for(elements))?);
    let (bent_u, crushed_u) = (bend(&beam), crush(&beam));
    let mut subjects = Vec::new();
    for (law, model, evaluation) in MEMBRANES {
        subjects.push(Subject::sheet::<f64>(&sheet, law, model, evaluation)?);
        subjects.push(Subject::sheet::<f32>(&sheet, law, model, evaluation)?);
    }
    for (law, model, evaluation, crushed) in SOLIDS {
        let (u, kind) = (if crushed { &crushed_u } else { &bent_u }, (model, evaluation));
        subjects.push(Subject::solid::<f64>(&beam, law, kind, u)?);
        subjects.push(Subject::solid::<f32>(&beam, law, kind, u)?);
    }
    let mut variants = Vec::new();
    for (i, subject) in subjects.iter_mut().enumerate() {
        for quantity in 0..subject.quantities {
            let count = repetitions(&mut *subject.timed, QUANTITIES[quantity].1, 5e-4);
            variants.push((i, quantity, count));
        }
    }
    let rounds = Rounds { most: turns, least: turns, seconds: f64::INFINITY };
    let samples = interleave(&mut variants, rounds, |&mut (subject, quantity, repetitions)| {
        let timed = &mut subjects[subject].timed;
        Ok::<f64, BenchError>(timed.measure(QUANTITIES[quantity].1, repetitions))
    })?;
    for (&(subject, quantity, _), samples) in variants.iter().zip(samples) {
        subjects[subject].samples[quantity] = samples;
    }
    let (mut simulation, body) = bent(&beam, Precision::F64, 1, Evaluation::Fused, Model::StVK)?;
    simulation.set_state(body, &crushed_u, &vec![DVec3::ZERO; crushed_u.len()])?;
    let ratios = simulation.volume_ratios(body);
    Ok((subjects, ratios.into_iter().fold(f64::NEG_INFINITY, f64::max)))
}

pub(crate) fn figure() -> Result<Figure> {
    let (subjects, largest_ratio) = measure(ELEMENTS, TURNS)?;
    let count = |element| subjects.iter().find(|s| s.element == element).map_or(0, |s| s.elements);
    Ok(Figure {
        setting: format!(
            "An uneven sheet of {} triangles, bent and stretched, and a beam of {} tetrahedra, bent by half a \
             radian; crushed: every tetrahedron compressed, J at most {largest_ratio:.2}. Fused evaluation unless said, one \
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
        findings.push(Finding::of_times(agrees).says(text));
    }
    let roots = [("triangle", "TRQS", "TRBS"), ("tetrahedron", "TQS", "TBS")].map(|(e, a, b)| {
        ratio(subjects, [e, a, b, "f64"], &[FORCE]).map_or(f64::NAN, |s| s.median)
    });
    let faster = roots.iter().all(|r| *r > 1.0);
    findings.push(Finding::of_times(faster).says(format!(
            "biquadratic springs, which need no square root, are {} than quadratic ones: force takes {:.2} \
             (triangles) and {:.2} times as long with these (tetrahedra)",
            if faster { "faster" } else { "not both faster" },
            roots[0],
            roots[1]
        )));
    findings
}

fn tables(subjects: &[Subject]) -> Vec<Table> {
    let laws = RATIOS.map(|(e, law, base, paper, _)| (e, law, base, Some(paper)));
    let unprinted = [
        ("triangle", "corotational", "mass-spring", None),
        ("triangle", "corotational", "TRBS", None),
        ("tetrahedron", "TBS", "mass-spring", None),
        ("tetrahedron", "TBS (pooled)", "mass-spring", None),
        ("tetrahedron", "TQS", "TBS (pooled)", None),
        ("tetrahedron", "corotational", "TBS", None),
    ];
    let title = "Ratios of times per element, one thread (medians, quartiles of the turns)";
    let rows = laws.into_iter().chain(unprinted);
    let ratios = table_of!("c-ratios", title; for (element, law, base, paper) in rows;
        where {
            let of = |precision, quantities: &[usize]| {
                ratio(subjects, [element, law, base, precision], quantities)
            };
            let median = |precision, quantities: &[usize]| of(precision, quantities).map(|s| s.median);
        }
        "element" => element, "law" => law, "over" => base, "paper" => paper,
        "force f64" => median("f64", &[FORCE]),
        "quartiles" => of("f64", &[FORCE]).as_ref().map_or("-".into(), Spread::quartiles),
        "product f64" => median("f64", &[FREE]), "both f64" => median("f64", &[FORCE, FREE]),
        "force f32" => median("f32", &[FORCE]), "product f32" => median("f32", &[FREE]),
    )
    .note(
        "product: exact tangent times vector without a matrix, which edge springs and pooled ones have not; \
         both: force and product together.",
    );
    let mut tables = vec![ratios];
    for (name, element, title) in [
        ("c-membranes", "triangle", "Membranes, ns per triangle (medians)"),
        ("c-solids", "tetrahedron", "Solids, ns per tetrahedron (medians)"),
    ] {
        let own = || subjects.iter().filter(|s| s.element == element);
        let mut table = table_of!(name, title; for s in own();
            where {
                let median = |quantity| s.time(quantity).map(|t| t.median);
                let spread = |quantity| s.time(quantity).as_ref().map_or("-".into(), Spread::quartiles);
            }
            "law" => s.law, "precision" => s.precision, "force" => median(FORCE),
            "quartiles" => spread(FORCE), "product without matrix" => median(FREE),
            "quartiles" => spread(FREE), "product, assembled" => median(ASSEMBLED),
            "assembly" => median(TANGENT), "error of force" => s.errors[0],
            "error of product" => s.errors[1],
        )
        .note(
            "errors: largest difference from a plain f64 sum over elements, over the largest value.",
        );
        let wide = own().filter(|s| s.precision == "f64");
        let mut assembled: Vec<f64> =
            wide.filter_map(|s| Some(s.time(ASSEMBLED)?.median)).collect();
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
    let all = subjects.iter().flat_map(|s| (0..s.quantities).map(move |quantity| (s, quantity)));
    table_of!("c-numbers", "Times per element"; for (s, quantity) in all;
        where { let Some(time) = s.time(quantity) else { continue }; }
        "element" => s.element, "law" => s.law, "precision" => s.precision,
        "quantity" => QUANTITIES[quantity].0, "least ns" => time.minimum,
        "lower quartile ns" => time.lower_quartile, "median ns" => time.median,
        "upper quartile ns" => time.upper_quartile,
        "error" => s.errors[usize::from(quantity != FORCE)],
    )
}

/// Times in f64, with those that the paper's ratios would give.
fn chart(name: &str, element: &str, title: &str, subjects: &[Subject]) -> Result<Chart> {
    let mut rows = Vec::new();
    let own = || subjects.iter().filter(|s| s.element == element && s.precision == "f64");
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
            rows.push(Bar::new(format!("{}: {what}", s.law), &time, aim, colour));
        }
    }
    // the same for every law
    if let Some(time) = own().next().and_then(|s| s.time(ASSEMBLED)) {
        rows.push(Bar::new("any law: product, assembled".into(), &time, None, 2));
    }
    bars(name, title, &format!("ns per {element}, one thread"), &rows)
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
            let free = s.law != "mass-spring" && !s.law.contains("pooled");
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
        let verdicts: Vec<bool> = findings(&known).iter().map(|f| f.agrees()).collect();
        // 1 beside 1.6 three times, 1.5 beside 2, 1 below 1.65 three times, 1 beside 1.8 twice, triangles as fast
        let no = [false; 2];
        assert_eq!(verdicts, [&[false; 4][..], &[true; 3], &no, &[false]].concat());
    }
}
