//! What the project aims at, and whether this run met it.

use super::accuracy::AccuracyReport;
use super::elements::ElementReport;
use super::kernels::KernelReport;
use super::step::{StepRow, StepsReport};
use crate::toolbox::aim::BenchAim;
use crate::toolbox::prelude::*;
use sinew_tune::page::Judgement;

const SIZES: [(&str, usize); 2] = [("5k", 5_000), ("50k", 50_000)];

/// Aims of the kernels, as far as they were measured.
pub fn kernels(report: &KernelReport) -> Vec<BenchAim> {
    let median = |key, size, threads| report.find(key, size, threads).map(|r| r.ns_per_tet.median);
    let mut aims = Vec::new();
    let mut add = |what: String, limit, unit: &str, found: Option<f64>| {
        aims.extend(found.map(|found| BenchAim::at_most(what, limit, unit, found)));
    };
    let force = [
        ("fused", "svk", "f64", [8.0, 5.0]),
        ("fused", "svk", "f32", [6.0, 3.5]),
        ("pooled, all passes", "svk", "f64", [14.0, 8.0]),
    ];
    for (kernel, model, precision, limits) in force {
        for (threads, limit) in [1, 2].into_iter().zip(limits) {
            for (name, size) in SIZES {
                let found = median([kernel, "force", model, precision], size, threads);
                let threads = if threads == 1 { "1 thread" } else { "2 threads" };
                let what = format!("{kernel} {model} force, {precision}, {name}, {threads}");
                add(what, limit, "ns/tet", found);
            }
        }
    }
    for precision in ["f64", "f32"] {
        for (name, size) in SIZES {
            let [plain, full] = ["svk", "svk_comp"]
                .map(|model| median(["fused", "force", model, precision], size, 1));
            let ratio = plain.zip(full).map(|(plain, full)| full / plain);
            add(
                format!("compression term, fused force, {precision}, {name}, of without"),
                1.1,
                "x",
                ratio,
            );
        }
        let key = ["fused", "force", "svk_comp", precision];
        let growth = median(key, 500_000, 1).zip(median(key, 50_000, 1)).map(|(l, s)| l / s);
        add(format!("fused force, {precision}, 500k over 50k per tet"), 1.4, "x", growth);
    }
    for row in &report.columns {
        let what =
            format!("entity columns over plain arrays, {}, {} tets", row.precision, row.tetrahedra);
        add(what, 1.05, "x", Some(row.ratio));
    }
    for precision in ["f64", "f32"] {
        for (name, size) in SIZES {
            let quadratic = median(["quadratic springs", "force", "tqs", precision], size, 1);
            let biquadratic = median(["fused", "force", "svk", precision], size, 1);
            let ratio = quadratic.zip(biquadratic).map(|(q, b)| q / b);
            add(
                format!("quadratic over biquadratic springs, {precision}, {name}"),
                1.3,
                "x",
                ratio,
            );
        }
    }
    aims
}

fn setting(row: &StepRow) -> String {
    let solver = if row.solver.is_empty() { String::new() } else { format!(", {}", row.solver) };
    format!("{}{solver}, {}, {} threads", row.integrator, row.precision, row.threads)
}

/// Aims of the steps, as far as they were measured.
pub fn steps(report: &StepsReport) -> Vec<BenchAim> {
    let mut aims = Vec::new();
    // the solver that a user gets without asking
    let default = |r: &StepRow| r.integrator == "auto" && r.solver.starts_with("auto");
    // what the default leaves to the safe step
    let safe = |r: &StepRow| r.integrator == "safe" && r.solver.starts_with("auto");
    let explicit = |r: &StepRow| !["auto", "safe"].contains(&r.integrator.as_str());
    let sizes = [
        ("5k", 5_000, 1.0, Some(0.4)),
        ("50k", 50_000, 20.0, Some(6.0)),
        ("500k", 500_000, 300.0, None),
    ];
    for (name, size, implicit_ms, explicit_ms) in sizes {
        if let Some(row) = report.fastest(size, 2, default) {
            let what = format!("step of 10 ms, {name} ({})", setting(row));
            aims.push(BenchAim::at_most(what, implicit_ms, "ms", row.ms.median));
        }
        if let Some((row, limit)) = report.fastest(size, 2, explicit).zip(explicit_ms) {
            let what = format!("10 ms explicit, {name} ({})", setting(row));
            aims.push(BenchAim::at_most(what, limit, "ms", row.ms.median));
        }
        for (state, projected, limit) in
            [("in smooth motion", false, 1.2), ("with projection", true, 2.0)]
        {
            let pick = |r: &StepRow| {
                let kind = if projected { safe(r) } else { default(r) };
                kind && (r.projections > 0) == projected && r.precision == "f64"
            };
            if let Some((row, ratio)) =
                report.fastest(size, 2, pick).and_then(|r| Some((r, r.ratio_to_plain?)))
            {
                let what =
                    format!("step over plain linearised one {state}, {name} ({})", setting(row));
                aims.push(BenchAim::at_most(what, limit, "x", ratio));
            }
        }
    }
    for build in &report.builds {
        let limit = match build.tetrahedra {
            40_000..60_000 => 0.3,
            400_000..600_000 => 3.0,
            _ => continue,
        };
        let what = format!("loading and building {} tets", build.tetrahedra);
        aims.push(BenchAim::at_most(what, limit, "s", build.total_s.median));
    }
    let first = report.builds.first().map(|b| b.tetrahedra);
    let last = report.builds.last().map(|b| b.tetrahedra);
    if let Some((small, large)) = first.zip(last).filter(|(small, large)| large > small) {
        let at = |size| report.fastest(size, 2, default);
        if let Some((a, b)) = at(small).zip(at(large)) {
            let refinement = (large as f64 / small as f64).cbrt();
            let growth = f64::from(b.cg_iterations) / f64::from(a.cg_iterations.max(1));
            let what = format!(
                "growth of CG iterations from {small} to {large} tets over that of the inverse \
                 element size ({})",
                setting(b)
            );
            aims.push(BenchAim::at_most(what, 1.0, "", growth / refinement));
        }
    }
    aims
}

/// Aims of accuracy, as far as they were measured.
pub fn accuracy(report: &AccuracyReport) -> Vec<BenchAim> {
    let still: Vec<_> = report.points.iter().filter(|p| p.integrator == "quasi-static").collect();
    let worst = |tolerance: f64, load_steps: u32| {
        let chosen = still.iter().filter(|p| {
            p.linear_tolerance == Some(tolerance)
                && p.load_steps == Some(load_steps)
                && p.model == "svk_comp"
                && p.precision == "f64"
                && p.note.is_empty()
        });
        let errors: Vec<f64> = chosen.map(|p| p.error_percent.unwrap_or(f64::INFINITY)).collect();
        errors.into_iter().reduce(f64::max)
    };
    let mut aims = Vec::new();
    if let Some(found) = worst(1e-8, 4) {
        let what =
            "error of equilibria solved to 1e-8 (quasi-static, f64, 4 load steps), worst case";
        aims.push(BenchAim::at_most(what, 1e-4, "%", found));
    }
    if let Some(found) = worst(1e-3, 4) {
        let what = "error of equilibria with default tolerances (quasi-static, f64, 4 load steps), worst case";
        aims.push(BenchAim::at_most(what, 1.0, "%", found));
    }
    aims.extend(report.elements.iter().flat_map(ElementReport::aims));
    aims
}

/// For people.
pub fn table(aims: &[BenchAim]) -> Table {
    table_of!("aims", "Aims of the project"; for aim in aims;
        "what" => &aim.what, "aim" => aim.limit, "found" => aim.found, "unit" => &aim.unit,
        "" => match aim.judgement() {
            Judgement::Yes => "met",
            Judgement::No => "missed",
            Judgement::Open => "not judged",
        },
    )
    .note("at most the aim counts as met, or at least, where it says so; medians of this run. Times and their ratios on a busy machine are not judged.")
}
