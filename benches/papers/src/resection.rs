//! Delingette 2008, figure 3, bottom: interactive resection of a liver.

use super::prelude::*;
use sinew::models::resection::Region;
use sinew_benches::bench::resection::{FRAME, Organ, ResectionFrame, ResectionRun, at_random, cut};
use sinew_benches::toolbox::meshes::demo_mesh;

/// Frames while single tetrahedra are taken out.
const FRAMES: usize = 300;
/// Strokes of the tool, and frames of each.
const STROKES: usize = 14;
const STROKE: usize = 20;
/// Radius (m) of the tool.
const TOOL: f64 = 0.01;
/// Where the tool is at the start of a frame: to and fro across the organ, a stroke lower every time.
fn tool(frame: usize) -> DVec3 {
    let (stroke, part) = (frame / STROKE, (frame % STROKE) as f64 / STROKE as f64);
    let along = if stroke.is_multiple_of(2) { part } else { 1.0 - part };
    DVec3::new(0.045, -0.07 + 0.15 * along, 0.06 - 0.011 * stroke as f64)
}

/// Frames while a lobe is cut off by a tool, or while single tetrahedra are taken out at random.
struct Case {
    name: &'static str,
    run: ResectionRun,
}

fn measure(frames: [usize; 2]) -> Result<Vec<Case>> {
    let mesh = demo_mesh("liver.msh")?;
    let held = mesh.groups.iter().find(|g| g.name == "ligament");
    let held = held.map(|g| g.vertices.clone()).unwrap_or_default();
    // stiffer than the preset, so that it keeps its shape while it hangs
    let material = YoungPoisson { young_modulus: 2e4, ..preset("liver")?.material };
    let organ = Organ { mesh: &mesh, held: &held, material };
    let failed = |e: BenchError| BenchError::Request {
        what: format!("resection: {e}"),
        remedy: "this is a defect of the engine, report it".into(),
    };
    let stroke =
        |frame: usize| Region::Capsule { from: tool(frame), to: tool(frame + 1), radius: TOOL };
    let lobe = cut(&organ, frames[0], 1, stroke).map_err(failed)?;
    let single = cut(&organ, frames[1], 1, at_random(mesh.tetrahedra.len())).map_err(failed)?;
    Ok(vec![Case { name: "lobe cut off", run: lobe }, Case { name: "one a frame", run: single }])
}

pub(crate) fn figure() -> Result<Figure> {
    let cases = measure([STROKES * STROKE, FRAMES])?;
    let series = |name: &str, case: &Case, colour, hollow, pick: fn(&ResectionFrame) -> f64| {
        let mut times: Vec<f64> = case.run.frames.iter().map(pick).collect();
        times.sort_by(f64::total_cmp);
        let share = 100.0 / times.len() as f64;
        let points = times.iter().enumerate().map(|(i, t)| [*t, share * (i + 1) as f64]).collect();
        Series::new(format!("{}: {name}", case.name), points, colour).hollow(hollow)
    };
    let mut curves = Vec::new();
    for (i, case) in cases.iter().enumerate() {
        curves.push(series("frame", case, i, false, |f| f.removal_ms + f.step_ms));
        curves.push(series("removal alone", case, i, true, |f| f.removal_ms));
    }
    curves.push(
        Series::new("frame at 60 Hz", vec![[1e3 * FRAME, 0.0], [1e3 * FRAME, 100.0]], 7)
            .hollow(true),
    );
    let axes = ["time (ms)", "frames that take no longer (%)"];
    let chart =
        lines("f-resection", "Liver resection: frame times", axes, &curves, Scales::Linear)?;
    let (tables, numbers) = tables(&cases);
    let tets = cases.first().map_or(0, |c| c.run.tetrahedra);
    Ok(Figure {
        setting: format!(
            "A liver-like organ of {tets} tetrahedra (the paper: 5015) that hangs from its ligament, compressible \
             biquadratic springs, 20 kPa; a safe implicit step of 1/60 s a frame, f64, one thread. Lobe cut off: a \
             tool of {} mm goes to and fro, {STROKES} strokes; one a frame: single tetrahedra at random. A frame is \
             the removal, which sums stiffnesses and masses again, and the step.",
            2e3 * TOOL
        ),
        findings: findings(&cases),
        tables,
        numbers,
        charts: vec![chart],
    })
}

fn findings(cases: &[Case]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for Case { name, run } in cases {
        let removed: usize = run.frames.iter().map(|f| f.removed).sum();
        findings.push(Finding::of_times(run.frame.late <= 0.01).says(format!(
                "resection runs in real time ({name}, {removed} of {} tetrahedra): a frame takes {:.1} ms \
                 (median), {:.1} ms at 99 %, {:.1} ms at most; {:.1} % take more than {:.1} ms",
                run.tetrahedra,
                run.frame.median,
                run.frame.p99,
                run.frame.max,
                100.0 * run.frame.late,
                1e3 * FRAME
            )));
    }
    let worst = cases.iter().map(|c| c.run.residual).fold(0.0, f64::max);
    let tolerance = SolverSettings::default().linear_tolerance;
    let difference = cases.iter().map(|c| c.run.difference).fold(0.0, f64::max);
    findings.push(Finding::of(worst <= tolerance && difference < 1e-9).says(format!(
            "stiffnesses are updated at every removal, and the step is solved for real: in the end they are \
             off those of a body built afresh by {difference:.0e}, and no linear residual is above {worst:.1e} (asked for: {tolerance:.0e})"
        )));
    findings
}

/// For people, and all numbers.
fn tables(cases: &[Case]) -> (Vec<Table>, Vec<Table>) {
    let parts = cases.iter().flat_map(|Case { name, run }| {
        let parts = [("frame", &run.frame), ("removal", &run.removal), ("step", &run.step)];
        parts.map(|(what, times)| (*name, what, times))
    });
    let title = "Frame times while tetrahedra are removed, ms";
    let people = table_of!("f-resection", title; for (name, what, times) in parts;
        "case" => name, "what" => what, "median" => times.median, "95 %" => times.p95,
        "99 %" => times.p99, "longest" => times.max, "above 16.7 ms %" => 100.0 * times.late,
    );
    let solver = table_of!("f-solver", "What was cut and solved"; for Case { name, run } in cases;
        where {
            let mut residuals: Vec<f64> = run.frames.iter().map(|f| f.residual).collect();
            residuals.sort_by(f64::total_cmp);
        }
        "case" => *name, "frames" => run.frames.len(),
        "removed" => run.frames.iter().map(|f| f.removed).sum::<usize>(), "pieces" => run.pieces,
        "iterations a frame" => run.iterations, "projections" => run.projections,
        "median residual" => residuals.get(residuals.len() / 2).copied(),
        "worst residual" => run.residual, "off a fresh build" => run.difference,
    )
    .note("residual: of the linear system, over that of the start vector.");
    let frames = cases.iter().flat_map(|case| {
        case.run.frames.iter().enumerate().map(|(i, frame)| (case.name, i, frame))
    });
    let numbers = table_of!("f-frames", "Frames"; for (name, i, f) in frames;
        "case" => name, "frame" => i, "removed" => f.removed, "removal ms" => f.removal_ms,
        "step ms" => f.step_ms, "residual" => f.residual,
    );
    (vec![people, solver], vec![numbers])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_remove_and_solve() {
        // the first strokes pass above the organ
        let cases = measure([8 * STROKE, 30]).unwrap();
        let [lobe, single] = &cases[..] else { panic!("two cases") };
        assert_eq!([lobe.run.frames.len(), single.run.frames.len()], [8 * STROKE, 30]);
        assert!(single.run.frames.iter().all(|f| f.removed == 1));
        let removed: usize = lobe.run.frames.iter().map(|f| f.removed).sum();
        assert!((10..1000).contains(&removed), "{removed}");
        for Case { name, run } in &cases {
            let tolerance = SolverSettings::default().linear_tolerance;
            assert!(run.residual > 0.0 && run.residual <= tolerance, "{name}: {}", run.residual);
            assert!(run.difference < 1e-9, "{name}: {}", run.difference);
            assert!(run.frames.iter().all(|f| f.removal_ms > 0.0 && f.step_ms > 0.0));
        }
        // known times give known findings
        let mut late = cases;
        late[0].run.frame.late = 0.5;
        late[1].run.frame.late = 0.0;
        late[1].run.residual = 0.5;
        let verdicts: Vec<bool> = findings(&late).iter().map(|f| f.agrees()).collect();
        assert_eq!(verdicts, [false, true, false]);
    }

    #[test]
    fn the_tool_goes_to_and_fro() {
        assert!(tool(STROKE / 2).distance(DVec3::new(0.045, 0.005, 0.06)) < 1e-12);
        assert!(tool(STROKE).distance(DVec3::new(0.045, 0.08, 0.049)) < 1e-12);
        assert!(tool(2 * STROKE - 1).y < -0.06);
    }
}
