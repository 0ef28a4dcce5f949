//! Modes of free vibration about rest, for the comparison with modal references: subspace iteration
//! with the engine's linear solver and a small dense Rayleigh-Ritz problem.
//!
//! Solves `K x = w^2 M x` with the tangent at rest and the lumped masses. Every round solves
//! `K Y = M X` and rotates `Y` to the eigenvectors of the problem within its span.

use glam::DVec3;
use sinew::engine::law::TangentKind;
use sinew::engine::matrix::Tangent;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::{FixedAxes, RestPosition};
use sinew::engine::workers::Workers;
use sinew::prelude::*;
use sinew::solvers::cg::CgStatus;
use sinew::solvers::linear_solver::LinearSolver;
use sinew::solvers::settings::LinearOptions;
use sinew::solvers::state::{NodeState, Rows, dot3, evaluate};
use sinew::solvers::system::ShiftedTangent;

/// A mode of free vibration.
#[derive(Clone, Debug, PartialEq)]
pub struct VibrationMode {
    /// Frequency (Hz).
    pub frequency: f64,
    /// Displacements in the user's order, of any length.
    pub shape: Vec<DVec3>,
}

/// Modes that could not be found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModesError {
    /// The simulation is not in double precision.
    #[error("modes are computed in double precision only: use precision f64")]
    Precision,
    /// A linear solve failed.
    #[error("the stiffness at rest could not be inverted: hold enough vertices")]
    Solve,
    /// The frequencies still changed in the last round.
    #[error("the frequencies did not settle in {0} rounds")]
    Unsettled(usize),
}

/// Most rounds; convergence is linear in the ratio of wanted to first unwanted eigenvalue.
const ROUNDS: usize = 200;
/// Vectors beyond those wanted, which speeds up the last of these.
const GUARD: usize = 6;

/// The `count` lowest modes of the only body of a simulation about rest, with the vertices `held`
/// fixed, and the conjugate-gradient iterations spent. Leaves the body at rest.
///
/// # Errors
/// [`ModesError`].
pub fn modes(
    simulation: &mut Simulation,
    body: BodyHandle,
    held: &[u32],
    count: usize,
) -> Result<(Vec<VibrationMode>, u64), ModesError> {
    if simulation.precision() != Precision::F64 {
        return Err(ModesError::Precision);
    }
    let rows = simulation.topology().bodies[body.0].clone();
    let world = simulation.world_mut();
    let mut node = NodeState::<f64>::default();
    node.read(world);
    let n = node.len();
    let mut fixed = vec![FixedAxes::NONE; n];
    for &vertex in held {
        if let Some(row) = rows.row(vertex) {
            fixed[row.index()] = FixedAxes(7);
        }
    }
    let rest: Vec<DVec3> = world.query::<&RestPosition>().iter(world).map(|x| x.0).collect();
    evaluate(world, &vec![[0.0; 4]; n], false, false, Some(TangentKind::Exact));
    let system = ShiftedTangent {
        topology: world.resource::<Topology>(),
        workers: world.resource::<Workers>(),
        mass: &node.mass,
        mass_factor: 0.0,
        tangent: &world.resource::<Tangent<f64>>().matrix,
        low_rank: &world.resource::<Tangent<f64>>().low_rank,
        tangent_factor: 1.0,
        damping: None,
        fixed: &fixed,
        contact: None,
    };
    let options =
        LinearOptions { tolerance: 1e-11, max_iterations: 50_000, ..LinearOptions::default() };
    let mut solver = LinearSolver::default();
    let free = n - fixed.iter().filter(|f| f.0 != 0).count();
    let size = (count + GUARD).min(3 * free);
    let mut x: Vec<Rows<f64>> = (0..size).map(|k| start_vector(&fixed, k)).collect();
    let mut values = vec![f64::INFINITY; size];
    let mut iterations = 0;
    for _ in 0..ROUNDS {
        let mut loads = Vec::with_capacity(size);
        let mut y = Vec::with_capacity(size);
        for (x, value) in x.iter().zip(&values) {
            let load: Rows<f64> = x.iter().zip(&node.mass).map(|(x, m)| x.map(|x| m * x)).collect();
            let mut solution: Rows<f64> = x.iter().map(|x| x.map(|x| x / value)).collect();
            let outcome =
                solver.solve(&system, &rest, body.0..body.0 + 1, &load, &mut solution, &options);
            iterations += u64::from(outcome.iterations);
            if outcome.status != CgStatus::Converged {
                return Err(ModesError::Solve);
            }
            loads.push(load);
            y.push(solution);
        }
        // K Y = M X, so Y^T K Y = Y^T M X
        let stiffness = products(&y, &loads);
        for (load, y) in loads.iter_mut().zip(&y) {
            *load = y.iter().zip(&node.mass).map(|(y, m)| y.map(|y| m * y)).collect();
        }
        let (new, vectors) = ritz(stiffness, products(&y, &loads)).ok_or(ModesError::Solve)?;
        for (k, x) in x.iter_mut().enumerate() {
            x.fill([0.0; 4]);
            for (y, vector) in y.iter().zip(&vectors) {
                for (x, y) in x.iter_mut().zip(y) {
                    (0..3).for_each(|axis| x[axis] += vector[k] * y[axis]);
                }
            }
        }
        // above the rounding of the linear solves
        let settled = new[..count].iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-10 * a);
        values = new;
        if settled {
            let shape = |x: &Rows<f64>| {
                let mut shape = vec![DVec3::ZERO; rows.mesh_vertices()];
                for (row, vertex) in rows.vertex_order.iter().enumerate() {
                    shape[vertex.index()] = DVec3::new(x[row][0], x[row][1], x[row][2]);
                }
                shape
            };
            let frequency = |value: f64| value.max(0.0).sqrt() / std::f64::consts::TAU;
            let all = values.iter().zip(&x).take(count);
            let modes = all
                .map(|(&value, x)| VibrationMode { frequency: frequency(value), shape: shape(x) });
            return Ok((modes.collect(), iterations));
        }
    }
    Err(ModesError::Unsettled(ROUNDS))
}

/// Numbers without pattern on the free unknowns (splitmix64).
fn start_vector(fixed: &[FixedAxes], index: usize) -> Rows<f64> {
    let mut state = index as u64 + 1;
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let entry = |f: &FixedAxes| if f.0 == 0 { [next(), next(), next(), 0.0] } else { [0.0; 4] };
    fixed.iter().map(entry).collect()
}

/// `A^T B`, made symmetric.
fn products(a: &[Rows<f64>], b: &[Rows<f64>]) -> Vec<Vec<f64>> {
    let product =
        |i: usize, j: usize| -> f64 { a[i].iter().zip(&b[j]).map(|(a, b)| dot3(a, b)).sum() };
    let entry = |i: usize, j: usize| 0.5 * (product(i, j) + product(j, i));
    (0..a.len()).map(|i| (0..a.len()).map(|j| entry(i, j)).collect()).collect()
}

/// Ascending eigenvalues and eigenvectors (columns, of length 1 in `b`) of `a v = w b v`, `None` when
/// `b` is not definite.
pub fn ritz(mut a: Vec<Vec<f64>>, b: Vec<Vec<f64>>) -> Option<(Vec<f64>, Vec<Vec<f64>>)> {
    let n = a.len();
    // b = L L^T
    let mut l = vec![vec![0.0; n]; n];
    for i in 0..n {
        for j in 0..=i {
            let sum = b[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i == j {
                if sum.is_nan() || sum <= 0.0 {
                    return None;
                }
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
        }
    }
    // a <- L^-1 a L^-T, one triangular solve from each side
    for _ in 0..2 {
        for column in 0..n {
            for i in 0..n {
                let sum = a[i][column] - (0..i).map(|k| l[i][k] * a[k][column]).sum::<f64>();
                a[i][column] = sum / l[i][i];
            }
        }
        for i in 0..n {
            for j in 0..i {
                let (upper, lower) = (a[i][j], a[j][i]);
                (a[i][j], a[j][i]) = (lower, upper);
            }
        }
    }
    let mut v: Vec<Vec<f64>> =
        (0..n).map(|i| (0..n).map(|j| if i == j { 1.0 } else { 0.0 }).collect()).collect();
    for _sweep in 0..60 {
        let mut turned = false;
        for p in 0..n {
            for q in p + 1..n {
                if a[p][q].abs() <= f64::EPSILON * (a[p][p] * a[q][q]).abs().sqrt() {
                    continue;
                }
                turned = true;
                let zeta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for k in 0..n {
                    (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                }
                for k in 0..n {
                    (a[k][p], a[k][q]) = (c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]);
                    (v[k][p], v[k][q]) = (c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]);
                }
            }
        }
        if !turned {
            break;
        }
    }
    // v <- L^-T v
    for column in 0..n {
        for i in (0..n).rev() {
            let sum = v[i][column] - (i + 1..n).map(|k| l[k][i] * v[k][column]).sum::<f64>();
            v[i][column] = sum / l[i][i];
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    let values = order.iter().map(|&i| a[i][i]).collect();
    let vectors = v.iter().map(|row| order.iter().map(|&j| row[j]).collect()).collect();
    Some((values, vectors))
}
