//! Cases, counts, limits and the report of the bench.

use sinew::engine::scalar::Real;
use sinew::prelude::*;
use sinew_benches::bench::accuracy::AccuracyReport;
use sinew_benches::bench::aims;
use sinew_benches::bench::cases::{Method, cases};
use sinew_benches::bench::flops::{Counted, ElementFlops, count};
use sinew_benches::bench::kernels::KernelReport;
use sinew_benches::bench::membranes;
use sinew_benches::bench::report::BenchReport;
use sinew_benches::bench::roofline::{
    LANES_READ, MachineLimits, ReadLimit, fma_f32, fma_f64, rate, sum,
};
use sinew_benches::bench::step::{StepRow, StepsReport};
use sinew_benches::toolbox::aim::BenchAim;
use sinew_benches::toolbox::stats::{Rounds, Spread};
use sinew_tune::machine::Load;
use sinew_tune::measures::displacement_error;
use sinew_tune::page::Judgement;
use sinew_tune::table::Table;
use std::hint::black_box;

#[test]
fn operations_are_counted() {
    let operations = count(|| {
        let mut x = Counted(2.0) * Counted(3.0) + Counted(1.0);
        x -= Counted(3.0);
        x = x.mul_add(Counted(1.0), Counted(0.0));
        assert_eq!(x.sqrt() / Counted(2.0), Counted(1.0));
    });
    assert_eq!(operations, 7);
    let (plain, compressed) = (ElementFlops::count(false), ElementFlops::count(true));
    // a displacement gradient alone takes 9 dot products of length 3
    assert!(plain.forces > 100 && plain.forces < 400, "{plain:?}");
    assert!(plain.energy < plain.forces && plain.forces < plain.tangent, "{plain:?}");
    // the term is computed for every element of a register, wanted or not
    assert!(compressed.forces >= plain.forces && compressed.forces < 2 * plain.forces);
    assert!(compressed.compression > 50 && compressed.compression < compressed.forces);
}

#[test]
fn probes_count_their_work() {
    assert_eq!(fma_f64(4), 4.0 * fma_f64(1));
    assert_eq!(fma_f32(1), 2.0 * fma_f64(1));
    assert_eq!(sum(&vec![0.5; 4 * LANES_READ]), 2.0 * LANES_READ as f64);
    let rate = rate(
        2,
        || 0.0,
        |x, k| {
            *x = (0..k * 1000).fold(*x, |x: f64, i| black_box(x + i as f64));
            k as f64
        },
    );
    assert!(rate > 0.0 && rate.is_finite());
}

#[test]
fn the_tighter_limit_binds() {
    let read = |level: &str, rate, holds| ReadLimit {
        level: level.into(),
        kib: 1,
        gb_per_s: rate,
        holds_bytes: holds,
    };
    let limits = MachineLimits {
        threads: 1,
        fma_f64: 10.0,
        fma_f32: 20.0,
        read: vec![read("L1", 100.0, 1e3), read("memory", 1.0, f64::INFINITY)],
    };
    let (time, by) = limits.bound("f64", 1e9, 1e9, 500.0);
    assert_eq!((time, by.as_str()), (0.1, "multiply-add"));
    assert_eq!(limits.bound("f32", 1e9, 1e9, 500.0).0, 0.05);
    let (time, by) = limits.bound("f64", 1e9, 1e9, 5000.0);
    assert_eq!((time, by.as_str()), (1.0, "read memory"));
}

#[test]
fn settling_and_load_steps_find_the_truth() {
    let all = cases(true).unwrap();
    let case = all.iter().find(|c| c.name == "stretch").unwrap();
    let mesh = &case.meshes[0];
    let truth = case.truth(mesh).unwrap();
    assert!(truth.own_error < 1e-6, "{}", truth.own_error);
    let method = |integrator, dt| Method {
        dt,
        settings: SolverSettings { integrator, mass_damping: 10.0, ..Default::default() },
        settled: 1e-4,
        ..Method::default()
    };
    for method in [method(Integrator::QuasiStatic, 0.5), method(Integrator::Safe, 0.05)] {
        let outcome = case.run(mesh, &method).unwrap();
        let error = displacement_error(&outcome.states, &truth.states, mesh.points.len()).unwrap();
        assert!(error < 1e-3, "{:?}: {error}", method.settings.integrator);
    }
}

#[test]
fn what_is_not_a_number_is_missed() {
    assert!(BenchAim::at_most("a", 1.0, "x", 1.0).met);
    assert!(!BenchAim::at_most("a", 1.0, "x", f64::NAN).met);
    assert!(aims::kernels(&KernelReport::default()).is_empty());
    assert!(aims::steps(&StepsReport::default()).is_empty());
    assert!(aims::accuracy(&AccuracyReport::default()).is_empty());
}

#[test]
fn a_busy_machine_gives_no_verdict_on_times() {
    let busy = |unit, found| BenchAim::at_most("a", 1.0, unit, found).on_a_busy_machine();
    // too slow, and nobody knows why; fast enough in spite of it
    assert_eq!(busy("ms", 2.0).judgement(), Judgement::Open);
    assert_eq!(busy("ms", 0.5).judgement(), Judgement::Yes);
    // either side of a ratio may have been held up
    assert_eq!([busy("x", 2.0), busy("times", 0.5)].map(|a| a.judgement()), [Judgement::Open; 2]);
    // errors and counts do not hang on time
    assert_eq!([busy("%", 2.0), busy("", 2.0)].map(|a| a.judgement()), [Judgement::No; 2]);
    let load = Load { others: Some(0.9), ..Load::default() };
    let mut report = BenchReport::new("sinew-lab bench contact", true);
    report.add_load("contact", load);
    report.add_load("step", Load::default());
    report.add_aims("contact", [BenchAim::at_most("beside another job", 1.0, "x", 2.0)]);
    report.add_aims("step", [BenchAim::at_most("alone", 1.0, "ms", 2.0)]);
    let judged: Vec<_> = report.aims.iter().map(BenchAim::judgement).collect();
    assert_eq!(judged, [Judgement::Open, Judgement::No]);
    let html = report.html().unwrap();
    assert!(html.contains("Verdicts: 0 of 1 met, 1 not judged"), "{html}");
}

/// Half way, in logarithms, between 2 and 50 ms is half way between 1 000 and 100 000 tetrahedra.
#[test]
fn the_headline_tells_what_runs_in_real_time() {
    let row = |tetrahedra, milliseconds, integrator: &str| StepRow {
        tetrahedra,
        integrator: integrator.into(),
        solver: "auto mixed".into(),
        state: "swinging".into(),
        precision: "f64".into(),
        threads: 2,
        ms: Spread { median: milliseconds, ..Spread::default() },
        ratio_to_plain: None,
        cg_iterations: 9,
        residual: 8e-4,
        projections: 0,
        substeps: 0,
        error_percent: (integrator == "safe").then_some(1.25),
    };
    let report = |rows| StepsReport { rows, ..StepsReport::default() };
    let (small, large) = (row(1000, 2.0, "auto"), row(100_000, 50.0, "auto"));
    let safe = row(1000, 3.0, "safe");
    let both = report(vec![small.clone(), large.clone(), safe.clone()]).headline().unwrap();
    assert!(both.contains("about 10000 tetrahedra") && both.contains("1000 take 2"), "{both}");
    assert!(both.contains("`safe` is 1.25 % from the converged step"), "{both}");
    assert!(report(vec![small]).headline().unwrap().contains("more than 1000"));
    assert!(report(vec![large]).headline().unwrap().contains("fewer than 100000"));
    assert_eq!(report(vec![safe]).headline(), None);
}

#[test]
fn kernels_compute_what_the_plain_sums_say() {
    let rounds = Rounds { most: 1, least: 1, seconds: 0.0 };
    let rows = membranes::run(200, rounds).unwrap();
    assert_eq!(rows.len(), 2 * 5 * 4);
    for row in &rows {
        let limit = if row.precision == "f64" { 1e-12 } else { 1e-4 };
        assert!(row.error < limit, "{row:?}");
        assert!(row.over_mass_spring.is_some(), "{row:?}");
    }
    assert_eq!(membranes::table(&rows).rows.len(), rows.len());
}

#[test]
fn a_report_names_its_schema_and_fetches_nothing() {
    let mut report = BenchReport::new("sinew-lab bench kernels", true);
    report.aims.push(BenchAim::at_most("a", 1.0, "ns", 2.0));
    report.kernels = Some(KernelReport::default());
    let table = Table::new("t", "A table", &["n", "what"]);
    report.tables.push(Table { rows: vec![vec![0.5.into(), None::<u32>.into()]], ..table });
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["schema"], "sinew-bench/2");
    assert_eq!(json["tables"][0]["rows"], serde_json::json!([[0.5, null]]));
    assert_eq!(json["aims"][0]["met"], false);
    let html = report.html().unwrap();
    assert!(html.contains("not met") && html.ends_with("</html>\n"));
    assert!(!html.contains("src=") && !html.contains("<link") && !html.contains("@import"));
}
