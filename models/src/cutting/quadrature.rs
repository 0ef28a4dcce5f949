//! Quadrature over the material of elements with Gauss points.

use glam::{DMat3, DVec3};

/// Gauss-Legendre points of (0, 1) with their weights.
const FIVE: [[f64; 2]; 5] = [
    [0.046_910_077_030_668, 0.118_463_442_528_094_54],
    [0.230_765_344_947_158_45, 0.239_314_335_249_683_24],
    [0.5, 0.284_444_444_444_444_44],
    [0.769_234_655_052_841_5, 0.239_314_335_249_683_24],
    [0.953_089_922_969_332, 0.118_463_442_528_094_54],
];

/// Barycentric coordinates and weights (which add up to 1) of points of a tetrahedron: those of a cube, drawn together into a
/// corner. Exact to degree 7.
pub fn fine() -> Vec<([f64; 4], f64)> {
    let mut points = Vec::with_capacity(125);
    for [u, wu] in &FIVE {
        for [v, wv] in &FIVE {
            for [w, ww] in &FIVE {
                let (a, b) = (1.0 - u, (1.0 - u) * (1.0 - v));
                let at = [*u, a * v, b * w, b * (1.0 - w)];
                points.push((at, 6.0 * wu * wv * ww * a * a * (1.0 - v)));
            }
        }
    }
    points
}

/// The symmetric square root of a symmetric positive semidefinite matrix (Jacobi's rotations).
pub fn square_root(m: DMat3) -> DMat3 {
    let mut a = m.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    // each sweep squares what is left beside the diagonal
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + libm::hypot(theta, 1.0));
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for k in 0..3 {
                let (x, y) = (a[k][p], a[k][q]);
                (a[k][p], a[k][q]) = (c * x - s * y, s * x + c * y);
            }
            for k in 0..3 {
                let (x, y) = (a[p][k], a[q][k]);
                (a[p][k], a[q][k]) = (c * x - s * y, s * x + c * y);
                let (x, y) = (v[p][k], v[q][k]);
                (v[p][k], v[q][k]) = (c * x - s * y, s * x + c * y);
            }
        }
    }
    let part = |k: usize| {
        let axis = DVec3::from_array(v[k]);
        DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z) * a[k][k].max(0.0).sqrt()
    };
    part(0) + part(1) + part(2)
}

/// Takes points away until eight are left at most, all of positive weight, whose sums of `1, x, y, z, xy, yz, zx` and `xyz` are
/// those of all (Tchakaloff's theorem): of any nine, one can go along a vector in which no sum changes. There are two ways
/// along it. The one is taken that keeps the sum of `x^2 + y^2 + z^2` nearer to what it was, without which the points left may be
/// those at the rim, or all in the middle.
pub fn eliminate(points: &[(DVec3, f64)]) -> Vec<(DVec3, f64)> {
    let low = points.iter().fold(DVec3::INFINITY, |low, (x, _)| low.min(*x));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |high, (x, _)| high.max(*x));
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let half = DVec3::select(half.cmpgt(DVec3::ZERO), half, DVec3::ONE);
    let moments = |x: DVec3| {
        let x = (x - middle) / half;
        [1.0, x.x, x.y, x.z, x.x * x.y, x.y * x.z, x.z * x.x, x.x * x.y * x.z]
    };
    let square = |x: DVec3| ((x - middle) / half).length_squared();
    // by how much the sum of squares is too large
    let mut excess = 0.0;
    let mut left: Vec<(DVec3, f64)> = Vec::with_capacity(9);
    for &point in points.iter().filter(|(_, weight)| *weight > 0.0) {
        left.push(point);
        if left.len() < 9 {
            continue;
        }
        let rows: [[f64; 8]; 9] = std::array::from_fn(|i| moments(left[i].0));
        let along = null_vector(rows);
        // the first weight that falls to 0, either way
        let ways = [1.0, -1.0].map(|sign| {
            let ratio = |i: usize| match sign * along[i] {
                down if down > 0.0 => left[i].1 / down,
                _ => f64::INFINITY,
            };
            let gone = (0..9).min_by(|&i, &j| ratio(i).total_cmp(&ratio(j))).unwrap_or(0);
            let step = sign * ratio(gone);
            let change: f64 = (0..9).map(|i| step * along[i] * square(left[i].0)).sum();
            (gone, step, excess - change)
        });
        let [one, other] =
            ways.map(|way| if way.1.is_finite() { way.2.abs() } else { f64::INFINITY });
        let (gone, step, now) = ways[usize::from(other < one)];
        excess = now;
        for (i, own) in left.iter_mut().enumerate() {
            own.1 = (own.1 - step * along[i]).max(0.0);
        }
        left.remove(gone);
    }
    left
}

/// Factors, one of them 1 and the largest, with which nine rows of eight numbers add up to 0.
fn null_vector(rows: [[f64; 8]; 9]) -> [f64; 9] {
    // a column for each point; elimination with full pivoting
    let mut m: [[f64; 9]; 8] = std::array::from_fn(|k| std::array::from_fn(|i| rows[i][k]));
    let mut order: [usize; 9] = std::array::from_fn(|i| i);
    let mut rank = 0;
    while rank < 8 {
        let places = (rank..8).flat_map(|k| (rank..9).map(move |i| (k, i)));
        let size = |&(k, i): &(usize, usize)| m[k][i].abs();
        let Some((k, i)) = places.max_by(|a, b| size(a).total_cmp(&size(b))) else { break };
        if m[k][i].abs() < 1e-14 {
            break;
        }
        m.swap(rank, k);
        m.iter_mut().for_each(|row| row.swap(rank, i));
        order.swap(rank, i);
        for k in rank + 1..8 {
            let factor = m[k][rank] / m[rank][rank];
            for i in rank..9 {
                m[k][i] -= factor * m[rank][i];
            }
        }
        rank += 1;
    }
    let mut solution = [0.0; 9];
    solution[rank] = 1.0;
    for k in (0..rank).rev() {
        let sum: f64 = (k + 1..=rank).map(|i| m[k][i] * solution[i]).sum();
        solution[k] = -sum / m[k][k];
    }
    let mut along = [0.0; 9];
    order.iter().zip(solution).for_each(|(&i, x)| along[i] = x);
    let largest =
        along.iter().fold(0.0_f64, |most, x| if x.abs() > most.abs() { *x } else { most });
    along.map(|x| x / largest)
}
