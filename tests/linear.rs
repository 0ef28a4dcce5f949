//! Linear systems of implicit steps: every preconditioner and precision against a dense solve, masks,
//! indefinite matrices, values kept over solves, threads, and how iterations grow with the mesh.

use crate::common::*;
use glam::DVec3;
use sinew::engine::columns::single_table;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::scalar::Scalar;
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::vertex::{ElasticForce, FixedAxes, Mass, RestPosition};
use sinew::engine::workers::Workers;
use sinew::prelude::*;
use sinew::solvers::cg::CgStatus;
use sinew::solvers::linear_solver::{CgOutcome, LinearSolver};
use sinew::solvers::settings::{LinearOptions, LinearPrecision, Preconditioner};
use sinew::solvers::system::ShiftedTangent;

const PRECONDITIONERS: [Preconditioner; 3] =
    [Preconditioner::BlockJacobi, Preconditioner::IncompleteCholesky, Preconditioner::Multigrid];
const PRECISIONS: [LinearPrecision; 2] = [LinearPrecision::Mixed, LinearPrecision::Full];

/// A bent beam and the system of its next step.
struct Case<S> {
    simulation: Simulation,
    mass: Vec<S>,
    rest: Vec<DVec3>,
    fixed: Vec<FixedAxes>,
    b: Vec<[S; 4]>,
}

impl<S: Scalar> Case<S> {
    /// Clamped at x = 0, and along z alone at the other end.
    fn new(cells: [usize; 3], precision: Precision, threads: usize) -> Self {
        Self::of(&box_tets(DVec3::new(0.2, 0.05, 0.05), cells).unwrap(), precision, threads)
    }

    fn of(mesh: &Mesh, precision: Precision, threads: usize) -> Self {
        let body = BodyDescription::new("body", mesh, soft(1e4, 0.45));
        Self::of_body(mesh, &body, options(precision, threads))
    }

    fn of_body(mesh: &Mesh, body: &BodyDescription, options: SimulationOptions) -> Self {
        let (mut simulation, body) = alone(options, body);
        let bend = |x: DVec3| DVec3::new(0.0, 0.0, 2.0 * x.x * x.x) + 0.05 * x.y * DVec3::X;
        let u: Vec<DVec3> = mesh.points.iter().map(|x| bend(*x)).collect();
        simulation.displace(body, &u);
        Self::now(simulation)
    }

    fn now(mut simulation: Simulation) -> Self {
        simulation.world_mut().insert_resource(EvaluationRequest {
            energy: false,
            force: true,
            tangent: Some(TangentKind::Projected),
        });
        simulation.world_mut().run_schedule(ForceSchedule);
        let world = simulation.world_mut();
        let mut query = world.query::<(&ElasticForce<S>, &Mass<S>, &RestPosition)>();
        let (force, mass, rest) = single_table(query.contiguous_iter(world)).unwrap();
        let mass: Vec<S> = mass.iter().map(|m| m.0).collect();
        let rest: Vec<DVec3> = rest.iter().map(|x| x.0).collect();
        let mut b: Vec<[S; 4]> = force.iter().map(|f| f.0).collect();
        let mut fixed = vec![FixedAxes::NONE; b.len()];
        for row in 0..b.len() {
            b[row][2] -= mass[row] * S::from_f64(9.81);
            if rest[row].x == 0.0 || mass[row] == S::ZERO {
                fixed[row] = FixedAxes::ALL;
            } else if rest[row].x > 0.2 - 1e-9 {
                fixed[row] = FixedAxes(4);
            }
            for k in (0..3).filter(|&k| fixed[row].holds(k)) {
                b[row][k] = S::ZERO;
            }
        }
        Self { simulation, mass, rest, fixed, b }
    }

    fn system(&self, mass_factor: f64) -> ShiftedTangent<'_, S> {
        let world = self.simulation.world();
        ShiftedTangent {
            topology: self.simulation.topology(),
            workers: world.resource::<Workers>(),
            mass: &self.mass,
            mass_factor: S::from_f64(mass_factor),
            tangent: &world.resource::<Tangent<S>>().matrix,
            low_rank: &[],
            tangent_factor: S::ONE,
            damping: None,
            fixed: &self.fixed,
            contact: None,
        }
    }

    fn solve(
        &self,
        solver: &mut LinearSolver<S>,
        mass_factor: f64,
        options: &LinearOptions,
    ) -> (Vec<[S; 4]>, CgOutcome) {
        let mut x = vec![[S::ZERO; 4]; self.b.len()];
        let system = self.system(mass_factor);
        let outcome = solver.solve(&system, &self.rest, 0..1, &self.b, &mut x, options);
        (x, outcome)
    }

    /// The matrix on the free unknowns, column by column from products, and a dense Cholesky solve.
    fn dense(&self, mass_factor: f64) -> Vec<[f64; 4]> {
        let n = self.b.len();
        let free: Vec<(usize, usize)> = (0..n)
            .flat_map(|row| (0..3).map(move |k| (row, k)))
            .filter(|&(row, k)| !self.fixed[row].holds(k))
            .collect();
        let system = self.system(mass_factor);
        let (mut spans, mut scratch) = (ProductSpans::default(), Vec::new());
        let mut matrix = Vec::new();
        for &(row, k) in &free {
            let (mut x, mut y) = (vec![[S::ZERO; 4]; n], vec![[S::ZERO; 4]; n]);
            x[row][k] = S::ONE;
            system.multiply(&mut spans, &mut scratch, 0..1, &x, &mut y);
            matrix.push(free.iter().map(|&(row, k)| y[row][k].to_f64()).collect::<Vec<f64>>());
        }
        let mut x: Vec<f64> = free.iter().map(|&(row, k)| self.b[row][k].to_f64()).collect();
        for i in 0..free.len() {
            for j in 0..=i {
                let dot: f64 = (0..j).map(|k| matrix[i][k] * matrix[j][k]).sum();
                let rest = matrix[i][j] - dot;
                matrix[i][j] = if i == j { rest.sqrt() } else { rest / matrix[j][j] };
            }
            let dot: f64 = (0..i).map(|k| matrix[i][k] * x[k]).sum();
            x[i] = (x[i] - dot) / matrix[i][i];
        }
        for i in (0..free.len()).rev() {
            let dot: f64 = (i + 1..free.len()).map(|k| matrix[k][i] * x[k]).sum();
            x[i] = (x[i] - dot) / matrix[i][i];
        }
        let mut out = vec![[0.0; 4]; n];
        for (&(row, k), x) in free.iter().zip(x) {
            out[row][k] = x;
        }
        out
    }
}

fn difference<S: Scalar>(a: &[[S; 4]], b: &[[f64; 4]]) -> f64 {
    let entries = || a.iter().flatten().zip(b.iter().flatten());
    let scale = entries().map(|(_, b)| b.abs()).fold(0.0, f64::max);
    entries().map(|(a, b)| (a.to_f64() - b).abs()).fold(0.0, f64::max) / scale
}

fn against_dense<S: Scalar>(precision: Precision, tolerance: f64, error: f64) {
    let case = Case::<S>::new([8, 3, 3], precision, 1);
    for mass_factor in [1e4, 0.0] {
        let expected = case.dense(mass_factor);
        for preconditioner in PRECONDITIONERS {
            for precision in PRECISIONS {
                let options =
                    LinearOptions { tolerance, preconditioner, precision, ..Default::default() };
                let mut solver = LinearSolver::default();
                let (x, outcome) = case.solve(&mut solver, mass_factor, &options);
                let found = difference(&x, &expected);
                assert_eq!(outcome.status, CgStatus::Converged, "{options:?} {outcome:?}");
                assert!(outcome.residual <= tolerance, "{options:?} {outcome:?}");
                assert!(found < error, "{options:?} {mass_factor}: {found:e}");
                assert!(!outcome.fell_back && outcome.preconditioner == preconditioner);
                // unknowns that are held stay at zero, bit for bit
                for (row, x) in x.iter().enumerate() {
                    for k in (0..3).filter(|&k| case.fixed[row].holds(k)) {
                        assert_eq!(x[k], S::ZERO);
                    }
                }
            }
        }
    }
}

#[test]
fn equal_to_a_dense_solve_in_f64() {
    against_dense::<f64>(Precision::F64, 1e-10, 1e-8);
}

#[test]
fn equal_to_a_dense_solve_in_f32() {
    against_dense::<f32>(Precision::F32, 1e-5, 1e-3);
}

/// Corners carry what factors without fill pass on from middle to middle; the solution is the same.
#[test]
fn corners_halve_the_iterations_of_ten_node_beams() {
    let mesh = box_tets(DVec3::new(0.2, 0.05, 0.05), [10, 2, 2]).unwrap().with_second_order();
    let case = Case::<f64>::of(&mesh, Precision::F64, 1);
    for mass_factor in [1e4, 0.0] {
        for precision in PRECISIONS {
            let [(ours, corners), (x, alone)] =
                [Preconditioner::Multigrid, Preconditioner::IncompleteCholesky].map(|kind| {
                    let options = LinearOptions {
                        tolerance: 1e-10,
                        preconditioner: kind,
                        precision,
                        ..Default::default()
                    };
                    case.solve(&mut LinearSolver::default(), mass_factor, &options)
                });
            // inertia holds every vertex by itself and leaves less to carry
            let times = if mass_factor == 0.0 { 2 } else { 1 };
            assert!(times * corners.iterations <= alone.iterations, "{corners:?} {alone:?}");
            assert!(difference(&ours, &x) < 1e-7, "{mass_factor} {precision:?}");
        }
    }
}

/// First directions that are known save the way there, at any length and sign, and so do several that it is a sum of; one that
/// leads nowhere costs a product, one that is there already nothing more. What is held stays so.
#[test]
fn known_directions_are_searched_first() {
    let case = Case::<f64>::new([20, 6, 7], Precision::F64, 1);
    let system = case.system(1e4);
    for preconditioner in PRECONDITIONERS {
        for precision in PRECISIONS {
            let options = LinearOptions { preconditioner, precision, ..Default::default() };
            let (solution, alone) = case.solve(&mut LinearSolver::default(), 1e4, &options);
            let along = |seeds: &[Vec<[f64; 4]>]| {
                let mut x = vec![[0.0; 4]; case.b.len()];
                let mut solver = LinearSolver::default();
                let b = &case.b;
                let outcome =
                    solver.solve_along(&system, &case.rest, 0..1, b, (&mut x, seeds), &options);
                assert_eq!(outcome.status, CgStatus::Converged, "{options:?} {outcome:?}");
                let held = x
                    .iter()
                    .zip(&case.fixed)
                    .all(|(x, fixed)| (0..3).filter(|&k| fixed.holds(k)).all(|k| x[k] == 0.0));
                assert!(held, "{options:?}");
                outcome.iterations
            };
            let scaled: Vec<_> = solution.iter().map(|x| x.map(|x| -3.0 * x)).collect();
            assert!(along(std::slice::from_ref(&scaled)) <= 2, "{options:?}");
            let elsewhere: Vec<_> = case
                .fixed
                .iter()
                .map(|fixed| [0, 1, 2, 3].map(|k| f64::from(u8::from(k < 3 && !fixed.holds(k)))))
                .collect();
            let zero = vec![[0.0; 4]; case.b.len()];
            let sum = |a: &[[f64; 4]], b: &[[f64; 4]]| -> Vec<[f64; 4]> {
                let add = |(a, b): (&[f64; 4], &[f64; 4])| [0, 1, 2, 3].map(|k| a[k] + b[k]);
                a.iter().zip(b).map(add).collect()
            };
            let both = sum(&scaled, &elsewhere);
            assert!(along(&[zero.clone(), both.clone(), elsewhere.clone()]) <= 3, "{options:?}");
            assert!(along(&[scaled.clone(), scaled.clone(), scaled]) <= 2, "{options:?}");
            let once = along(std::slice::from_ref(&elsewhere));
            assert!(once <= alone.iterations + 4, "{options:?} {alone:?}");
            assert_eq!(along(&[elsewhere.clone(), elsewhere]), once, "{options:?}");
            assert_eq!(along(&[zero]), alone.iterations, "{options:?}");
        }
    }
}

/// The residual that counts is that of the `f64` tangent, whatever the solve ran in.
#[test]
fn mixed_precision_reaches_tight_tolerances() {
    let case = Case::<f64>::new([20, 6, 7], Precision::F64, 1);
    for tolerance in [1e-3, 1e-8, 1e-10, 1e-12] {
        let options = LinearOptions { tolerance, ..Default::default() };
        let (x, outcome) = case.solve(&mut LinearSolver::default(), 1e4, &options);
        assert_eq!(outcome.status, CgStatus::Converged, "{outcome:?}");
        let (mut y, mut scratch) = (vec![[0.0; 4]; x.len()], Vec::new());
        case.system(1e4).multiply(&mut ProductSpans::default(), &mut scratch, 0..1, &x, &mut y);
        let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
        let entries = y.iter().flatten().zip(case.b.iter().flatten());
        let residual =
            norm(&mut entries.map(|(y, b)| b - y)) / norm(&mut case.b.iter().flatten().copied());
        assert!(residual <= 1.001 * tolerance, "{residual:e} for {tolerance:e}");
    }
}

#[test]
fn indefinite_matrices_are_told_from_definite_ones() {
    let case = Case::<f64>::new([20, 6, 7], Precision::F64, 1);
    for preconditioner in PRECONDITIONERS {
        for precision in PRECISIONS {
            let options =
                LinearOptions { tolerance: 1e-10, preconditioner, precision, ..Default::default() };
            // the lowest mode of the beam is far below 1e4 1/s^2, its highest far above
            let (_, outcome) = case.solve(&mut LinearSolver::default(), -1e4, &options);
            assert_eq!(outcome.status, CgStatus::Indefinite, "{options:?} {outcome:?}");
        }
    }
}

/// Factors break down on an indefinite matrix; weaker couplings give a preconditioner all the same.
#[test]
fn breakdowns_are_counted() {
    let case = Case::<f64>::new([20, 6, 7], Precision::F64, 1);
    let preconditioner = Preconditioner::IncompleteCholesky;
    let options = LinearOptions { preconditioner, ..Default::default() };
    let (_, outcome) = case.solve(&mut LinearSolver::default(), -1e5, &options);
    assert!(outcome.breakdowns > 0, "{outcome:?}");
}

#[test]
fn the_preconditioner_is_kept_until_something_changes() {
    let mut case = Case::<f64>::new([20, 6, 7], Precision::F64, 1);
    for preconditioner in PRECONDITIONERS {
        let options = LinearOptions { preconditioner, ..Default::default() };
        let mut solver = LinearSolver::default();
        let (first, outcome) = case.solve(&mut solver, 1e4, &options);
        assert_eq!(outcome.refreshes, 1);
        let (again, outcome) = case.solve(&mut solver, 1e4, &options);
        assert_eq!(outcome.refreshes, 0);
        assert!(again == first, "{preconditioner:?}");
        assert_eq!(case.solve(&mut solver, 2e4, &options).1.refreshes, 1);
        // one more unknown held
        let row = case.fixed.iter().position(|f| f.0 == 0).unwrap();
        let before = std::mem::take(&mut case.b[row]);
        case.fixed[row] = FixedAxes::ALL;
        let (x, outcome) = case.solve(&mut solver, 2e4, &options);
        assert_eq!((outcome.refreshes, x[row]), (1, [0.0; 4]), "{preconditioner:?}");
        (case.fixed[row], case.b[row]) = (FixedAxes::NONE, before);
    }
}

/// Cuts add rows and blocks. A preconditioner goes on, and what is found with it is the solution all the same, also where it is made anew in the
/// middle of a solve. That of block Jacobi costs less than one more iteration: it is made anew at once.
#[test]
fn the_preconditioner_goes_on_through_cuts() {
    let mesh = box_tets(DVec3::new(0.2, 0.05, 0.05), [20, 6, 7]).unwrap();
    let body = BodyDescription::new("body", &mesh, soft(1e4, 0.45));
    let body = BodyDescription { spare: 1000, ..body };
    let own = [(Preconditioner::BlockJacobi, 1e-7)].into_iter();
    let kept = [Preconditioner::IncompleteCholesky, Preconditioner::Multigrid];
    for (preconditioner, tolerance) in
        own.chain(kept.into_iter().flat_map(|own| [(own, 1e-3), (own, 1e-7)]))
    {
        let precision = LinearPrecision::Full;
        let options = LinearOptions { preconditioner, tolerance, precision, ..Default::default() };
        let mut case = Case::<f64>::of_body(&mesh, &body, self::options(Precision::F64, 1));
        let mut solver = LinearSolver::default();
        assert_eq!(case.solve(&mut solver, 1e4, &options).1.refreshes, 1);
        let mut refreshes = Vec::new();
        for cut in 1..=12 {
            let x = 0.2 / 13.0 * f64::from(cut);
            let down = 2.0 * x * x + 0.025;
            let edge = |y: f64| [DVec3::new(x, y, 0.3), DVec3::new(x + 0.002, y, down)];
            let report = case.simulation.cut(BodyHandle(0), &[edge(-0.1), edge(0.1)]).unwrap();
            assert_eq!((report.vertices > 10, report.pieces), (true, 1));
            case = Case::now(case.simulation);
            let (x, kept) = case.solve(&mut solver, 1e4, &options);
            let (anew, fresh) = case.solve(&mut LinearSolver::default(), 1e4, &options);
            let what = format!("{preconditioner:?} {cut}: {kept:?} {fresh:?}");
            let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
            let (x, anew) = (x.as_flattened(), anew.as_flattened());
            let apart: Vec<f64> = x.iter().zip(anew).map(|(x, y)| x - y).collect();
            assert_eq!([kept.status, fresh.status], [CgStatus::Converged; 2], "{what}");
            assert!(norm(&apart) < 100.0 * tolerance * norm(anew), "{what}");
            refreshes.push(kept.refreshes);
            // what was spent before a refresh is at most as much again
            let most = 2 + kept.refreshes;
            assert!(kept.iterations <= most * fresh.iterations, "{what}");
        }
        let sum: u32 = refreshes.iter().sum();
        if tolerance > 1e-4 {
            // every other cut at most is worth a new one
            assert!(refreshes[0] == 0 && sum <= 6, "{preconditioner:?} {refreshes:?}");
        } else {
            assert!(sum >= 1, "{preconditioner:?}");
        }
    }
}

fn bits_over_threads<S: Scalar>(precision: Precision) {
    let solve = |threads, options: &LinearOptions| {
        let case = Case::<S>::new([26, 8, 9], precision, threads);
        case.solve(&mut LinearSolver::default(), 1e4, options).0
    };
    for preconditioner in PRECONDITIONERS {
        for linear in PRECISIONS {
            let options = LinearOptions { preconditioner, precision: linear, ..Default::default() };
            let one = solve(1, &options);
            for threads in [2, 3] {
                assert!(solve(threads, &options) == one, "{options:?} {threads} threads");
            }
        }
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    bits_over_threads::<f64>(Precision::F64);
    bits_over_threads::<f32>(Precision::F32);
}

/// Halving the elements doubles the iterations of block Jacobi; the coarse space must do better.
#[test]
fn multigrid_iterations_grow_slower_than_the_inverse_element_size() {
    let iterations = |cells, preconditioner| {
        let case = Case::<f64>::new(cells, Precision::F64, 1);
        let options = LinearOptions { preconditioner, ..Default::default() };
        f64::from(case.solve(&mut LinearSolver::default(), 1e4, &options).1.iterations)
    };
    let growth = |preconditioner| {
        let meshes = [[12, 3, 3], [24, 6, 6], [48, 12, 12]];
        let found = meshes.map(|cells| iterations(cells, preconditioner));
        (found[2] / found[0], found)
    };
    let (multigrid, found) = growth(Preconditioner::Multigrid);
    assert!(multigrid < 3.5, "{found:?}: elements are 4 times smaller");
    assert!(found[2] / found[1] < 2.0, "{found:?}");
    let (jacobi, found) = growth(Preconditioner::BlockJacobi);
    assert!(jacobi > multigrid, "{found:?}");
}

#[test]
fn zero_right_hand_side_gives_zero() {
    let mut case = Case::<f64>::new([8, 3, 3], Precision::F64, 1);
    case.b.fill([0.0; 4]);
    let (x, outcome) = case.solve(&mut LinearSolver::default(), 1e4, &LinearOptions::default());
    assert_eq!((outcome.status, outcome.iterations), (CgStatus::Converged, 0));
    assert!(x.iter().all(|x| *x == [0.0; 4]));
}

#[cfg(feature = "direct")]
#[test]
fn the_direct_solver_agrees_and_keeps_its_factor() {
    let case = Case::<f64>::new([20, 6, 7], Precision::F64, 1);
    let options = LinearOptions { tolerance: 1e-12, ..Default::default() };
    let direct = LinearOptions { preconditioner: Preconditioner::Direct, ..options };
    let mut solver = LinearSolver::default();
    for mass_factor in [1e4, 0.0] {
        let (x, outcome) = case.solve(&mut solver, mass_factor, &direct);
        assert_eq!((outcome.status, outcome.refreshes), (CgStatus::Converged, 1), "{outcome:?}");
        assert!(outcome.iterations <= 3, "{outcome:?}");
        assert_eq!(case.solve(&mut solver, mass_factor, &direct).1.refreshes, 0);
        let (other, _) = case.solve(&mut LinearSolver::default(), mass_factor, &options);
        assert!(difference(&other, &x) < 1e-9);
    }
    let (_, outcome) = case.solve(&mut solver, -1e4, &direct);
    assert_eq!(outcome.status, CgStatus::Indefinite);
}

#[cfg(not(feature = "direct"))]
#[test]
fn the_direct_solver_is_refused_without_its_feature() {
    let mut case = Case::<f64>::new([8, 3, 3], Precision::F64, 1);
    let preconditioner = Preconditioner::Direct;
    case.simulation.set_solver(SolverSettings { preconditioner, ..Default::default() });
    let error = case.simulation.step().unwrap_err().to_string();
    assert!(error.contains("direct") && error.contains("feature"), "{error}");
}

/// A settled state at tolerance 1e-8 against one at 1e-12 in full precision.
#[test]
fn equilibria_are_exact_when_asked_for() {
    let settle = |linear_tolerance, linear_precision| {
        let mesh = box_tets(DVec3::new(0.2, 0.05, 0.05), [12, 3, 3]).unwrap();
        let (mut simulation, body) = fused(&mesh, soft(3e5, 0.45));
        clamp(&mut simulation, body, &mesh, "x0");
        simulation.set_solver(solver!(Integrator::QuasiStatic, linear_tolerance, linear_precision));
        simulation.step().unwrap();
        assert!(!simulation.report().unconverged);
        assert_eq!(simulation.report().precision_fallbacks, 0);
        simulation.displacements(body)
    };
    let exact = settle(1e-12, LinearPrecision::Full);
    let found = settle(1e-8, LinearPrecision::Mixed);
    assert!(max_distance(&found, &exact) < 1e-9 * max_length(&exact));
}
