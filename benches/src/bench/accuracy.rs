//! Speed against error: every method on every case is a point (cost, error).

use super::cases::{AccuracyCase, AccuracyKind, CaseTruth, Method, MethodOutcome, cases};
use super::elements::{self, ElementBody, ElementReport};
use crate::toolbox::options::BenchOptions;
use crate::toolbox::prelude::*;
use crate::toolbox::stats::{Rounds, Spread, interleave};
use sinew::models::body::Evaluation;
use sinew_scene::summary::{evaluation_name, model_name};
use sinew_tune::measures::{displacement_error, front};

/// One method on one mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AccuracyPoint {
    /// Case.
    pub case: String,
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Vertices.
    pub vertices: usize,
    /// `svk` or `svk_comp`.
    pub model: String,
    /// `fused` or `pooled`.
    pub evaluation: String,
    /// `f64` or `f32`.
    pub precision: String,
    /// Threads.
    pub threads: usize,
    /// Integrator.
    pub integrator: String,
    /// Step (s); of explicit integrators the mean substep; `None` for load steps.
    pub step_s: Option<f64>,
    /// Load steps of an equilibrium found without motion.
    pub load_steps: Option<u32>,
    /// Relative residual of linear systems; `None` for explicit integrators.
    pub linear_tolerance: Option<f64>,
    /// Motions: wall time per simulated second. Equilibria: wall time to the answer (s).
    pub cost: Option<Spread>,
    /// Error against the converged solution on the same mesh (%).
    pub error_percent: Option<f64>,
    /// Error against the converged solution on the refined mesh (%).
    pub refined_error_percent: Option<f64>,
    /// Steps carried out.
    pub steps: u64,
    /// Conjugate-gradient iterations.
    pub cg_iterations: u64,
    /// No other point of this case and mesh is both faster and nearer to the truth on the mesh.
    pub pareto: bool,
    /// No other point of this case, on any mesh, is both faster and nearer to the refined mesh.
    pub pareto_refined: bool,
    /// What the reader must know.
    pub note: String,
}

/// A converged solution.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TruthRow {
    /// Case.
    pub case: String,
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Estimate of the error of the converged solution (%).
    pub own_error_percent: f64,
    /// Distance of this mesh's converged solution from that of the refined mesh (%).
    pub mesh_error_percent: Option<f64>,
    /// What it took (s).
    pub seconds: f64,
}

/// Names and descriptions of the cases.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseRow {
    /// Name.
    pub case: String,
    /// What happens.
    pub description: String,
    /// Whether cost is per simulated second; else it is to the answer.
    pub motion: bool,
    /// Tetrahedra of the refined mesh.
    pub refined_tetrahedra: Option<usize>,
}

/// All points.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AccuracyReport {
    /// The cases.
    pub cases: Vec<CaseRow>,
    /// The converged solutions.
    pub truths: Vec<TruthRow>,
    /// The points.
    pub points: Vec<AccuracyPoint>,
    /// Kinds of elements, of one body each.
    pub elements: Vec<ElementReport>,
}

/// Runs all cases; `tell` hears what is going on.
///
/// # Errors
/// When a case cannot be set up or has no converged solution. A method that fails is a point without
/// error, with a note.
pub fn run(
    options: &BenchOptions,
    rounds: Rounds,
    mut tell: impl FnMut(&str),
) -> Result<AccuracyReport> {
    let mut report = AccuracyReport::default();
    let all = cases(options.quick)?;
    let known: Vec<&str> =
        all.iter().map(|c| c.name).chain(ElementBody::ALL.map(ElementBody::name)).collect();
    if let Some(name) = options.cases.iter().find(|name| !known.contains(&name.as_str())) {
        return Err(BenchError::Request {
            what: format!("there is no case `{name}`"),
            remedy: format!("choose among {}", known.join(", ")),
        });
    }
    let wanted = |name: &str| options.cases.is_empty() || options.cases.iter().any(|n| n == name);
    for case in all.iter().filter(|case| wanted(case.name)) {
        tell(&format!("accuracy: {}", case.name));
        run_case(case, options.quick, rounds, &mut report)?;
    }
    for body in ElementBody::ALL.into_iter().filter(|body| wanted(body.name())) {
        report.elements.push(elements::run(body, options, &mut tell)?);
    }
    Ok(report)
}

fn run_case(
    case: &AccuracyCase,
    quick: bool,
    rounds: Rounds,
    report: &mut AccuracyReport,
) -> Result<()> {
    let truths: Vec<CaseTruth> =
        case.meshes.iter().map(|mesh| case.truth(mesh)).collect::<Result<_, _>>()?;
    let refined = truths.last().filter(|_| case.meshes.len() > case.measured);
    for (mesh, truth) in case.meshes.iter().zip(&truths) {
        let mesh_error = refined
            .filter(|r| !std::ptr::eq(*r, truth))
            .and_then(|r| displacement_error(&truth.states, &r.states, mesh.points.len()));
        report.truths.push(TruthRow {
            case: case.name.into(),
            tetrahedra: mesh.tetrahedra.len(),
            own_error_percent: 100.0 * truth.own_error,
            mesh_error_percent: mesh_error.map(|e| 100.0 * e),
            seconds: truth.seconds,
        });
    }
    report.cases.push(CaseRow {
        case: case.name.into(),
        description: case.description.into(),
        motion: case.is_motion(),
        refined_tetrahedra: refined.and(case.meshes.last()).map(|m| m.tetrahedra.len()),
    });

    let first = report.points.len();
    for (level, mesh) in case.meshes[..case.measured].iter().enumerate() {
        let n = mesh.points.len();
        let mut runs: Vec<(Method, Option<Result<MethodOutcome>>)> =
            methods(case, level, quick).into_iter().map(|m| (m, None)).collect();
        let samples = interleave(&mut runs, rounds, |(method, outcome)| {
            if let Some(Err(_)) = outcome {
                return Ok::<f64, BenchError>(f64::INFINITY);
            }
            let result = case.run(mesh, method);
            let seconds = result.as_ref().map_or(f64::INFINITY, |o| o.seconds);
            // states are the same every time
            outcome.get_or_insert(result);
            Ok(seconds)
        })?;
        let begin = report.points.len();
        for ((method, outcome), samples) in runs.into_iter().zip(samples) {
            let mut point = AccuracyPoint::new(case, mesh.tetrahedra.len(), n, &method);
            match outcome {
                Some(Ok(outcome)) => {
                    let percent = |truth: &CaseTruth| {
                        displacement_error(&outcome.states, &truth.states, n).map(|e| 100.0 * e)
                    };
                    let per = if case.is_motion() { outcome.simulated } else { 1.0 };
                    point.cost = Spread::of(&samples).map(|s| s.scaled(1.0 / per));
                    point.error_percent = percent(&truths[level]);
                    point.refined_error_percent = refined.and_then(percent);
                    (point.steps, point.cg_iterations) = (outcome.steps, outcome.cg_iterations);
                    if outcome.substeps > 0 {
                        point.step_s = Some(outcome.simulated / outcome.substeps as f64);
                    }
                    point.note.push_str(&outcome.note);
                }
                Some(Err(error)) => point.note = format!("failed: {error}"),
                None => point.note = "not run".into(),
            }
            report.points.push(point);
        }
        mark(&mut report.points[begin..], |p| p.error_percent, |p| &mut p.pareto);
    }
    let points = &mut report.points[first..];
    mark(points, |p| p.refined_error_percent, |p| &mut p.pareto_refined);
    Ok(())
}

/// Share by which an error must be smaller to count as smaller on a front.
const MARGIN: f64 = 0.01;

fn mark(
    points: &mut [AccuracyPoint],
    error: impl Fn(&AccuracyPoint) -> Option<f64>,
    flag: impl Fn(&mut AccuracyPoint) -> &mut bool,
) {
    let of = |p: &AccuracyPoint| {
        let cost = p.cost.map_or(f64::NAN, |c| c.median);
        [cost, error(p).unwrap_or(f64::NAN)]
    };
    let pairs: Vec<[f64; 2]> = points.iter().map(of).collect();
    for i in front(&pairs, MARGIN) {
        *flag(&mut points[i]) = true;
    }
}

/// The default and, one at a time, everything that can be chosen otherwise.
fn methods(case: &AccuracyCase, level: usize, quick: bool) -> Vec<Method> {
    let with = |integrator, dt| Method {
        dt,
        settings: SolverSettings { integrator, ..Default::default() },
        ..Method::default()
    };
    let tolerance = |method: &Method, linear: f64| Method {
        settings: SolverSettings { linear_tolerance: linear, ..method.settings.clone() },
        ..method.clone()
    };
    let variants = |method: &Method| {
        vec![
            Method { precision: Precision::F32, ..method.clone() },
            Method { evaluation: Evaluation::Pooled, ..method.clone() },
            Method { model: Model::StVK, ..method.clone() },
        ]
    };
    let mut all = Vec::new();
    match case.kind {
        AccuracyKind::Equilibrium => {
            let load_steps: &[f64] = if quick { &[1.0, 4.0] } else { &[1.0, 2.0, 4.0, 8.0] };
            let tolerances = [(1e-2, 1e-2), (1e-2, 1e-4), (1e-3, 1e-6), (1e-3, 1e-9), (1e-8, 1e-9)];
            for &parts in load_steps {
                for (linear, newton) in tolerances {
                    let base = with(Integrator::QuasiStatic, 1.0 / parts);
                    let mut method = tolerance(&base, linear);
                    method.settings.newton_tolerance = newton;
                    all.push(method);
                }
            }
            let default = with(Integrator::QuasiStatic, 0.25);
            all.extend(variants(&default));
            all.push(Method { threads: 2, ..default });
            // critical damping of the slowest mode would need to be known; this suits all cases
            let damped = |method: Method| Method {
                settings: SolverSettings { mass_damping: 20.0, ..method.settings.clone() },
                ..method
            };
            let (steps, speeds): (&[f64], &[f64]) = match (quick, level) {
                (true, _) => (&[0.1, 0.02], &[1e-2]),
                (false, 0 | 1) => (&[0.1, 0.05, 0.02, 0.01], &[1e-2, 1e-4]),
                (false, _) => (&[0.1, 0.05], &[1e-2]),
            };
            for &dt in steps {
                for &settled in speeds {
                    all.push(Method { settled, ..damped(with(Integrator::Safe, dt)) });
                }
            }
            all.extend(variants(&Method { settled: 1e-2, ..damped(with(Integrator::Safe, 0.05)) }));
            if level == 0 && !quick {
                let explicit = damped(with(Integrator::StormerVerlet, 0.01));
                all.push(Method { settled: 1e-2, ..explicit.clone() });
                all.push(Method { settled: 1e-2, precision: Precision::F32, ..explicit });
            }
        }
        AccuracyKind::Motion { .. } => {
            let steps: &[f64] =
                if quick { &[0.02, 0.01, 0.005] } else { &[0.02, 0.01, 0.005, 0.002, 0.001] };
            for &dt in steps {
                all.push(with(Integrator::Auto, dt));
                let safe = with(Integrator::Safe, dt);
                all.push(safe.clone());
                all.push(tolerance(&safe, 1e-2));
                all.push(tolerance(&safe, 1e-6));
                all.extend(variants(&safe));
                if !quick {
                    all.push(Method { threads: 2, ..safe });
                }
                let newton = with(Integrator::Newton, dt);
                all.push(newton.clone());
                if !quick {
                    all.push(Method { precision: Precision::F32, ..newton });
                }
            }
            for integrator in [Integrator::StormerVerlet, Integrator::SymplecticEuler] {
                for part in [1.0, 0.5, 0.25] {
                    let mut method = with(integrator, 0.01);
                    method.settings.explicit_safety *= part;
                    all.push(Method { precision: Precision::F32, ..method.clone() });
                    if part == 1.0 && integrator == Integrator::StormerVerlet {
                        all.extend(variants(&method).split_off(1));
                        all.push(Method { threads: 2, ..method.clone() });
                    }
                    all.push(method);
                }
            }
        }
    }
    all
}

impl AccuracyPoint {
    fn new(case: &AccuracyCase, tetrahedra: usize, vertices: usize, method: &Method) -> Self {
        let s = &method.settings;
        let explicit =
            matches!(s.integrator, Integrator::StormerVerlet | Integrator::SymplecticEuler);
        let loads = s.integrator == Integrator::QuasiStatic;
        Self {
            case: case.name.into(),
            tetrahedra,
            vertices,
            model: model_name(method.model).into(),
            evaluation: evaluation_name(method.evaluation).into(),
            precision: method.precision.name().into(),
            threads: method.threads,
            integrator: s.integrator.name().into(),
            step_s: (!loads).then_some(method.dt),
            load_steps: loads.then(|| (1.0 / method.dt).round() as u32),
            linear_tolerance: (!explicit).then_some(s.linear_tolerance),
            cost: None,
            error_percent: None,
            refined_error_percent: None,
            steps: 0,
            cg_iterations: 0,
            pareto: false,
            pareto_refined: false,
            note: if loads && s.newton_tolerance != SolverSettings::default().newton_tolerance {
                format!("Newton to {:.0e}; ", s.newton_tolerance)
            } else {
                String::new()
            },
        }
    }

    /// Its case and the size of its mesh.
    pub fn mesh(&self) -> (&str, usize) {
        (&self.case, self.tetrahedra)
    }

    /// How it was computed, in a few words.
    pub fn method(&self) -> String {
        let mut words = vec![self.integrator.clone()];
        match (self.load_steps, self.step_s) {
            (Some(n), _) => words.push(format!("{n} load steps")),
            (None, Some(h)) => {
                words.push(format!("{} ms", sinew_tune::table::three_digits(1e3 * h)))
            }
            (None, None) => {}
        }
        if let Some(tolerance) = self.linear_tolerance {
            words.push(format!("tol {tolerance:.0e}"));
        }
        words.join(", ")
    }
}

impl AccuracyReport {
    /// Tables: the fronts, the converged solutions, all points.
    pub fn tables(&self) -> Vec<Table> {
        let table = |name, title: &str, keep: fn(&AccuracyPoint) -> bool| {
            table_of!(name, title; for p in self.points.iter().filter(|p| keep(p));
                "case" => &p.case, "tets" => p.tetrahedra, "method" => p.method(), "model" => &p.model,
                "evaluation" => &p.evaluation, "precision" => &p.precision, "threads" => p.threads,
                "cost s" => p.cost.map(|c| c.median), "least s" => p.cost.map(|c| c.minimum),
                "error %" => p.error_percent, "refined error %" => p.refined_error_percent,
                "steps" => p.steps, "CG its" => p.cg_iterations,
                "front" => match (p.pareto, p.pareto_refined) {
                    (true, true) => "mesh, refined",
                    (true, false) => "mesh",
                    (false, true) => "refined",
                    (false, false) => "",
                },
                "note" => p.note.trim_end_matches("; "),
            )
        };
        let title = "Pareto fronts: no point is both faster and nearer by 1 %";
        let fronts = table("pareto", title, |p| p.pareto || p.pareto_refined)
            .note(
                "cost: wall time per simulated second of a motion, or to the answer of an \
                 equilibrium; median and least of interleaved repeats, set-up not included.",
            )
            .note(
                "error: largest distance of a vertex from where the converged solution of the same \
                 mesh (svk_comp) has it, at any time of comparison, over the largest displacement. \
                 refined error: the same against the converged solution on the refined mesh.",
            );
        let points = table("points", "Speed against error: all points", |_| true);
        let case = |t: &TruthRow| self.cases.iter().find(|c| c.case == t.case);
        let truths = table_of!("truths", "Converged solutions"; for t in &self.truths;
            "case" => &t.case, "tets" => t.tetrahedra, "own error %" => t.own_error_percent,
            "mesh error %" => t.mesh_error_percent, "took s" => t.seconds,
            "what happens" => case(t).map(|c| c.description.clone()),
        )
        .note(
            "own error: equilibria are solved once more to a relative residual of 1e-10, and that \
             changed them by so much; motions are run again with half the Störmer-Verlet step, and a \
             third of the difference is stated. mesh error: distance from the converged solution of \
             the refined mesh, which has the most tetrahedra of its case.",
        );
        let cases = [fronts, truths, points].into_iter().filter(|t| !t.rows.is_empty());
        self.elements.iter().flat_map(ElementReport::tables).chain(cases).collect()
    }
}
