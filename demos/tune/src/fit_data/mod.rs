//! Parameters from data: constants of the material and the fibres of a static scene from measured displacements and forces.
//!
//! Minimises the sum of squared differences between observations and equilibria by Levenberg's and
//! Marquardt's method, with derivatives from the implicit function theorem ([`gradient`]); says how sure
//! the values are, and which of them the data do not determine.
//!
//! * [`observe`]: CSV files of displacements, or of force-displacement curves.
//! * [`parameter`]: what is fitted, and the maps that keep it in range.
//! * [`forward`]: equilibria, each started from that of earlier parameters.
//! * [`statistics`]: errors, correlations, directions without information.
//! * [`report`]: the result.

pub mod error;
pub mod forward;
pub mod gradient;
pub mod observe;
pub mod parameter;
pub mod report;
pub mod statistics;

mod least_squares;
mod verdict;

use error::{DataFitError, Result};
use forward::Forward;
use gradient::Gradient;
use nalgebra::DMatrix;
use observe::{DataFile, Observation, Observations};
use parameter::{ElementMaterials, Parameter};
use report::{DataFitReport, DataMisfit, GradientCheck, ParameterFit, SCHEMA};
use sinew::models::body::Model;
use sinew::simulation::Precision;
use sinew_scene::assemble::{BuildOptions, build};
use sinew_scene::scene::{LoadedScene, Mode};
use statistics::{Directions, half_width};
use std::path::PathBuf;
use std::time::Instant;

/// What to fit, to which data.
#[derive(Clone, Debug, Default)]
pub struct DataFitRequest {
    /// Files of observations.
    pub data: Vec<PathBuf>,
    /// Parameters, such as `young`, `poisson:REGION` or `BODY/young:ARRAY`.
    pub fit: Vec<String>,
    /// Bounds, such as `young=1e3..1e5`.
    pub bounds: Vec<String>,
    /// Compare the derivatives at the end with central differences of equilibria.
    pub check_gradient: bool,
    /// Threads, 0 for one per core; `None` as in the scene.
    pub threads: Option<usize>,
}

/// Fits parameters of a static scene.
///
/// Data that do not determine a parameter, or a method that does not converge, are no error here: the
/// report then has [`DataFitReport::failure`] or warnings.
///
/// # Errors
/// [`DataFitError`] for scenes, data and parameters that cannot be used, and when the starting values have no
/// stable equilibrium.
pub fn fit(loaded: &LoadedScene, request: &DataFitRequest) -> Result<DataFitReport> {
    let clock = Instant::now();
    if loaded.scene.mode == Mode::Dynamic {
        return Err(DataFitError::Dynamic { file: loaded.file.clone() });
    }
    let scene = &loaded.scene;
    let touched = !(scene.tools.is_empty() && scene.pulls.is_empty() && scene.contacts.is_empty());
    let tied = !(scene.strands.is_empty() && scene.clips.is_empty());
    if touched || tied {
        return Err(DataFitError::Contact { file: loaded.file.clone() });
    }
    let options = BuildOptions {
        precision: Some(Precision::F64),
        threads: request.threads,
        ..BuildOptions::default()
    };
    let mut scene = build(loaded, &options)?;
    if let Some(body) = scene.bodies.iter().find(|b| b.model == Model::WarpedStiffness) {
        return Err(DataFitError::NoTangent { body: body.name.clone() });
    }
    let materials = ElementMaterials::of(&mut scene);
    let elements = materials.iter().map(|m| m.young.len()).sum();
    let parameters = parameter::parse(&request.fit, &request.bounds, &scene, &materials)?;
    let observations = Observations::read(&request.data, &scene)?;
    let observed = &observations.list;
    let mut warnings = scene.all_warnings();
    warnings.extend(verdict::of_scene(loaded, &scene, &parameters));

    let values: Vec<f64> = parameters.iter().map(|p| p.start).collect();
    let mut forward = Forward::new(scene, materials, observed);
    forward.solve(&parameters, &values)?;
    let reference = forward.predictions(observed);
    let (jacobian, gradient) = forward.jacobian(&parameters, &values, observed)?;
    let scaled = scaled_jacobian(&jacobian, &parameters, &values, observed);
    let measured: Vec<f64> = observed.iter().map(|o| o.value).collect();
    let size = size(observed, &reference).max(size(observed, &measured));
    let (active, insensitive): (Vec<usize>, Vec<usize>) = (0..parameters.len())
        .partition(|&i| scaled.column(i).norm() > verdict::LEAST_INFLUENCE * size);
    warnings.extend(verdict::insensitive(loaded, &parameters, &insensitive, &observations));

    if observed.len() < active.len() {
        let (observations, parameters) = (observed.len(), active.len());
        return Err(DataFitError::TooFew { observations, parameters });
    }
    let report = DataFitReport {
        schema: SCHEMA,
        scene: loaded.file.display().to_string(),
        elements,
        parameters: Vec::new(),
        correlation: None,
        data: Vec::new(),
        given_sigma: observations.has_sigma,
        observations: observed.len(),
        degrees_of_freedom: observed.len() - active.len(),
        objective: [squares(observed, &reference), 0.0],
        singular_values: Vec::new(),
        condition: None,
        gradient,
        gradient_reason: forward.without_tangent(),
        gradient_check: None,
        iterations: 0,
        work: forward.work,
        seconds: 0.0,
        converged: false,
        termination: "nothing was fitted".into(),
        failure: None,
        warnings,
    };
    let standard = vec![None; parameters.len()];
    let mut fit = Fit { loaded, observations, parameters, active, values, standard, report };
    if fit.active.is_empty() {
        fit.report.failure =
            Some("the data say nothing about any of the parameters, see the warnings".into());
    } else {
        forward = fit.minimise(forward, request.check_gradient)?;
    }
    let mut report = fit.finish(&forward);
    report.seconds = clock.elapsed().as_secs_f64();
    Ok(report)
}

/// A fit on its way.
struct Fit<'a> {
    loaded: &'a LoadedScene,
    observations: Observations,
    parameters: Vec<Parameter>,
    /// Those that the data say something about.
    active: Vec<usize>,
    values: Vec<f64>,
    standard: Vec<Option<f64>>,
    report: DataFitReport,
}

impl Fit<'_> {
    /// Finds the active parameters, and what the derivatives there say about them.
    fn minimise(&mut self, forward: Forward, check: bool) -> Result<Forward> {
        let (report, observed) = (&mut self.report, &self.observations.list);
        let chosen: Vec<Parameter> =
            self.active.iter().map(|&i| self.parameters[i].clone()).collect();
        let outcome = least_squares::minimise(forward, &chosen, observed)?;
        let mut forward = outcome.forward;
        for (&i, value) in self.active.iter().zip(&outcome.values) {
            self.values[i] = *value;
        }
        report.iterations = outcome.iterations;
        report.converged = outcome.converged;
        report.termination = outcome.termination;
        if !outcome.converged {
            report.failure = Some(format!(
                "the least-squares method did not converge ({}); the values are not the best ones. \
                 Start nearer to the solution, give bounds, or fit fewer parameters",
                report.termination
            ));
        }
        let (jacobian, gradient) = forward.jacobian(&chosen, &outcome.values, observed)?;
        report.gradient = gradient;
        let scaled = scaled_jacobian(&jacobian, &chosen, &outcome.values, observed);
        let directions = Directions::of(&scaled);
        let squares = squares(observed, &forward.predictions(observed));
        let variance = match (self.observations.has_sigma, report.degrees_of_freedom) {
            (true, _) => Some(1.0),
            (false, 0) => None,
            (false, freedom) => Some(squares / freedom as f64),
        };
        if let Some(variance) = variance {
            let (covariance, determined) = (directions.covariance(), directions.determined());
            for (k, (&i, p)) in self.active.iter().zip(&chosen).enumerate() {
                let error = p.scale(self.values[i]) * (variance * covariance[(k, k)]).sqrt();
                self.standard[i] = determined[k].then_some(error);
            }
            report.correlation = determined.iter().all(|&d| d).then(|| correlations(&covariance));
        }
        report.condition = Some(directions.condition()).filter(|c| c.is_finite());
        let errors: Vec<Option<f64>> = self.active.iter().map(|&i| self.standard[i]).collect();
        let (values, observations) = (&outcome.values, &self.observations);
        let found =
            verdict::of_fit(self.loaded, &chosen, values, &errors, &directions, observations);
        report.warnings.extend(found);
        report.singular_values = directions.singular_values;
        if check && gradient != Gradient::Differences {
            let before = forward.work.forward_solves;
            let differences = forward.differences(&chosen, values, observed)?;
            let forward_solves = forward.work.forward_solves - before;
            let worst = worst_difference(&jacobian, &differences);
            report.gradient_check = Some(GradientCheck { worst, forward_solves });
        }
        Ok(forward)
    }

    /// The report, but for the time.
    fn finish(self, forward: &Forward) -> DataFitReport {
        let Self { loaded, observations, parameters, active, values, standard, mut report } = self;
        let predictions = forward.predictions(&observations.list);
        report.objective[1] = squares(&observations.list, &predictions);
        report.data = misfits(&observations, &predictions);
        let freedom = (!observations.has_sigma).then_some(report.degrees_of_freedom);
        let fitted = |(i, p): (usize, &Parameter)| ParameterFit {
            name: p.name.clone(),
            constant: p.constant,
            body: loaded.scene.bodies[p.body].name.clone(),
            elements: p.elements.len(),
            unit: p.constant.unit(),
            start: p.start,
            value: values[i],
            fitted: active.contains(&i),
            standard_error: standard[i],
            confidence_95: standard[i].map(|error| interval(p, values[i], error, freedom)),
        };
        report.parameters = parameters.iter().enumerate().map(fitted).collect();
        report.work = forward.work;
        report
    }
}

/// Correlation matrix of a covariance.
fn correlations(covariance: &DMatrix<f64>) -> Vec<Vec<f64>> {
    let n = covariance.nrows();
    let entry =
        |i: usize, j: usize| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

/// How well the observations of every file are met.
fn misfits(observations: &Observations, predictions: &[f64]) -> Vec<DataMisfit> {
    let misfit = |file: &DataFile| {
        let own = file.range.clone();
        let gap = |i: usize| predictions[i] - observations.list[i].value;
        let squares: f64 = own.clone().map(|i| gap(i).powi(2)).sum();
        let rms = (squares / own.len() as f64).sqrt();
        let rms_percent = (file.largest > 0.0).then(|| 100.0 * rms / file.largest);
        let worst = own.map(|i| gap(i).abs()).fold(0.0, f64::max);
        DataMisfit { file: file.clone(), rms, rms_percent, worst }
    };
    observations.files.iter().map(misfit).collect()
}

/// 95 % confidence interval.
fn interval(p: &Parameter, value: f64, error: f64, freedom: Option<usize>) -> [f64; 2] {
    let half = half_width(freedom) * error;
    match p.constant.is_modulus() {
        true => [value * (-half / value).exp(), value * (half / value).exp()],
        false => [(value - half).max(p.bounds[0]), (value + half).min(p.bounds[1])],
    }
}

/// Differences over their scales.
fn residuals(observed: &[Observation], predictions: &[f64]) -> Vec<f64> {
    observed.iter().zip(predictions).map(|(o, p)| (p - o.value) / o.scale).collect()
}

/// Sum of their squares.
fn squares(observed: &[Observation], predictions: &[f64]) -> f64 {
    residuals(observed, predictions).iter().map(|r| r * r).sum()
}

/// Euclidean norm of predictions or observations over their scales.
fn size(observed: &[Observation], values: &[f64]) -> f64 {
    let all = observed.iter().zip(values);
    all.map(|(o, value)| (value / o.scale).powi(2)).sum::<f64>().sqrt()
}

/// Derivatives of the residuals by parameters in units of their scale.
fn scaled_jacobian(
    jacobian: &DMatrix<f64>,
    parameters: &[Parameter],
    values: &[f64],
    observed: &[Observation],
) -> DMatrix<f64> {
    DMatrix::from_fn(observed.len(), parameters.len(), |i, j| {
        jacobian[(i, j)] * parameters[j].scale(values[j]) / observed[i].scale
    })
}

/// Largest difference in a column over the largest entry of the column.
fn worst_difference(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    let columns = a.column_iter().zip(b.column_iter());
    columns.map(|(a, b)| (a - b).amax() / b.amax()).fold(0.0, f64::max)
}
