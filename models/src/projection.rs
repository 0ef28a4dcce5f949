//! Positive semidefinite projection of the 9x9 second derivative of the energy density by `F`.
//!
//! With the signed singular value decomposition `F = U diag(s) V^T` (`U`, `V` rotations, the sign
//! on `s_3`), the 9x9 matrix falls apart in the basis `U e_i e_j^T V^T`. With
//! `t = (sum s^2 - 3)/2`, `c_i` the product of the other two `s`, and `k` the third index:
//!
//! ```text
//! stretches, 3x3:  A_ii = lambda s_i^2 + p2 c_i^2 + lambda t + mu (3 s_i^2 - 1)
//!                  A_ij = lambda s_i s_j + p2 c_i c_j + p1 s_k
//! pairs (i, j):    [b o; o b] on (e_i e_j^T, e_j e_i^T), eigenvalues b + o and b - o,
//!                  b = lambda t - mu + mu (s_i^2 + s_j^2),  o = mu s_i s_j - p1 s_k
//! ```
//!
//! The idea of analytic eigensystems of isotropic energies is that of Smith, de Goes and Kim 2019
//! (Analytic Eigensystems for Isotropic Distortion Energies, ACM TOG 38(1)); the entries above are
//! derived for this energy, and checked against numerical eigenvalues in the tests.

use sinew_engine::scalar::{cross, dot, scale, sub};

use crate::tetrahedron::{CORE, Element, green_strain, second_piola_kirchhoff};
use sinew_engine::element::volume_change;

/// Eigenvalues above minus this part of the largest entry count as not negative: rounding of `s`
/// alone moves the zero eigenvalues of a rotation by a few units of it.
const NEGLIGIBLE: f64 = 16.0 * f64::EPSILON;

/// Blocks of vertices 1, 2, 3 in the order of [`CORE`], of the matrix with negative eigenvalues
/// clamped at zero, or `None` when there are none to clamp.
pub(crate) fn projected_blocks(e: &Element<f64>, g: &[f64; 9]) -> Option<[[f64; 9]; 6]> {
    let (lambda, mu) = (e.lambda, e.mu);
    let m = volume_change(g).min(0.0);
    // Without compression term the matrix is a semidefinite material part plus the stress on its
    // diagonal: a definite stress settles it without decomposing F.
    let strain = green_strain(g);
    if m == 0.0 {
        let [xx, yy, zz, yz, xz, xy] = second_piola_kirchhoff(e, &strain);
        let nothing = lambda == 0.0 && mu == 0.0;
        let material = mu > 0.0 && 3.0 * lambda + 2.0 * mu >= 0.0;
        if nothing || material && is_positive_definite(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        {
            return None;
        }
    }
    let p1 = 2.0 * e.compression * m * m * m;
    let p2 = 6.0 * e.compression * m * m;
    let f = [[1.0 + g[0], g[1], g[2]], [g[3], 1.0 + g[4], g[5]], [g[6], g[7], 1.0 + g[8]]];
    let Svd { u, s, v } = signed_svd(&f);
    // t = tr E, from G rather than from s: exact to rounding near rest, where it is small.
    let t = strain[0] + strain[1] + strain[2];
    let c = [s[1] * s[2], s[0] * s[2], s[0] * s[1]];

    // The 9x9 in the basis of the decomposition.
    let mut a = [[0.0; 3]; 3];
    let mut largest = 0.0_f64;
    for i in 0..3 {
        for j in 0..3 {
            let own = if i == j {
                lambda * t + mu * (3.0 * s[i] * s[i] - 1.0)
            } else {
                p1 * s[3 - i - j]
            };
            a[i][j] = lambda * s[i] * s[j] + p2 * c[i] * c[j] + own;
            largest = largest.max(a[i][j].abs());
        }
    }
    // Pair k couples the two indices other than k.
    let mut plus = [0.0; 3];
    let mut minus = [0.0; 3];
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let b = lambda * t - mu + mu * (s[i] * s[i] + s[j] * s[j]);
        let o = mu * s[i] * s[j] - p1 * s[k];
        (plus[k], minus[k]) = (b + o, b - o);
        largest = largest.max(b.abs()).max(o.abs());
    }

    let floor = -NEGLIGIBLE * largest;
    let mut clamp = false;
    for k in 0..3 {
        clamp |= plus[k] < floor || minus[k] < floor;
    }
    if !is_positive_definite(&a) {
        let (values, vectors) = symmetric_eigen(a);
        if values[0].min(values[1]).min(values[2]) < floor {
            clamp = true;
            for i in 0..3 {
                for j in 0..3 {
                    a[i][j] = 0.0;
                    for n in 0..3 {
                        a[i][j] += values[n].max(0.0) * vectors[i][n] * vectors[j][n];
                    }
                }
            }
        }
    }
    if !clamp {
        return None;
    }
    let mut straight = [0.0; 3];
    let mut crossed = [0.0; 3];
    for k in 0..3 {
        let (p, q) = (plus[k].max(0.0), minus[k].max(0.0));
        (straight[k], crossed[k]) = (0.5 * (p + q), 0.5 * (p - q));
    }

    // K_ab = V U [ sum_jl H_ij,kl (V^T D_a)_j (V^T D_b)_l ]_ik U^T.
    let mut d = [[0.0; 3]; 3];
    for n in 0..3 {
        for i in 0..3 {
            d[n][i] = dot(column(&v, i), e.gradients[n]);
        }
    }
    let mut blocks = [[0.0; 9]; 6];
    for (block, [p, q]) in blocks.iter_mut().zip(CORE) {
        let mut inner = [[0.0; 3]; 3];
        for i in 0..3 {
            for k in 0..3 {
                inner[i][k] += a[i][k] * d[p][i] * d[q][k];
                if i != k {
                    let third = 3 - i - k;
                    inner[i][k] += crossed[third] * d[p][k] * d[q][i];
                    inner[i][i] += straight[third] * d[p][k] * d[q][k];
                }
            }
        }
        let mut half = [[0.0; 3]; 3];
        for i in 0..3 {
            for k in 0..3 {
                half[i][k] = dot(u[i], column(&inner, k));
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                block[3 * i + j] = e.volume * dot(half[i], u[j]);
            }
        }
    }
    // Diagonal blocks are symmetric up to rounding; make them so exactly.
    for block in &mut blocks[..3] {
        for (x, y) in [(1, 3), (2, 6), (5, 7)] {
            let mean = 0.5 * (block[x] + block[y]);
            (block[x], block[y]) = (mean, mean);
        }
    }
    Some(blocks)
}

/// `F = U diag(s) V^T` with rotations `U`, `V` given by rows, and `s_1 >= s_2 >= |s_3|`.
struct Svd {
    u: [[f64; 3]; 3],
    s: [f64; 3],
    v: [[f64; 3]; 3],
}

/// Signed singular values by one-sided Jacobi: `V` is turned until the columns of `F V` are
/// orthogonal, which diagonalises `F^T F` without forming it, so small singular values keep their
/// digits. Any finite `F` will do; missing directions of a singular one are filled in.
fn signed_svd(f: &[[f64; 3]; 3]) -> Svd {
    // Columns of F V and of V; V stays a rotation.
    let mut b = [column(f, 0), column(f, 1), column(f, 2)];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _sweep in 0..30 {
        let mut turned = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (alpha, beta, gamma) = (dot(b[p], b[p]), dot(b[q], b[q]), dot(b[p], b[q]));
            if gamma.abs() > f64::EPSILON * alpha.sqrt() * beta.sqrt() {
                turned = true;
                let (cos, sin) = jacobi_rotation(alpha, beta, gamma);
                (b[p], b[q]) = rotated(b[p], b[q], cos, sin);
                (v[p], v[q]) = rotated(v[p], v[q], cos, sin);
            }
        }
        if !turned {
            break;
        }
    }
    // Longest column first; each exchange turns one column round to keep V a rotation.
    for (p, q) in [(0, 1), (0, 2), (1, 2)] {
        if dot(b[p], b[p]) < dot(b[q], b[q]) {
            (b[p], b[q]) = (b[q], scale(b[p], -1.0));
            (v[p], v[q]) = (v[q], scale(v[p], -1.0));
        }
    }
    // Directions from the columns; where a column vanishes any perpendicular one serves.
    let first = dot(b[0], b[0]).sqrt();
    let u0 = if first > 1e-150 { scale(b[0], 1.0 / first) } else { [1.0, 0.0, 0.0] };
    let rest = sub(b[1], scale(u0, dot(u0, b[1])));
    let second = dot(rest, rest).sqrt();
    let mut u1 = if second > 1e-15 * first && second > 1e-150 {
        scale(rest, 1.0 / second)
    } else {
        perpendicular(u0)
    };
    // A second pass restores the angle that a short column lost to rounding.
    u1 = sub(u1, scale(u0, dot(u0, u1)));
    u1 = scale(u1, 1.0 / dot(u1, u1).sqrt());
    let u2 = cross(u0, u1);
    Svd {
        u: transpose(&[u0, u1, u2]),
        s: [dot(u0, b[0]), dot(u1, b[1]), dot(u2, b[2])],
        v: transpose(&v),
    }
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix by cyclic Jacobi rotations.
fn symmetric_eigen(mut a: [[f64; 3]; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _sweep in 0..30 {
        let size = a[0][0].abs() + a[1][1].abs() + a[2][2].abs();
        let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        // Not finite: nothing to find, and the comparison below would never end the loop.
        if off <= 1e-3 * f64::EPSILON * size || !off.is_finite() {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let (cos, sin) = jacobi_rotation(a[p][p], a[q][q], a[p][q]);
            (a[p], a[q]) = rotated(a[p], a[q], cos, sin);
            for row in a.iter_mut().chain(v.iter_mut()) {
                (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
            }
        }
    }
    ([a[0][0], a[1][1], a[2][2]], v)
}

/// Cosine and sine of the rotation that makes `[[alpha, gamma], [gamma, beta]]` diagonal, with the
/// smaller of the two possible angles. `gamma` is not zero.
fn jacobi_rotation(alpha: f64, beta: f64, gamma: f64) -> (f64, f64) {
    let zeta = (beta - alpha) / (2.0 * gamma);
    // Overflow of the square only means that there is nothing left to turn.
    let tangent = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
    let cos = 1.0 / (1.0 + tangent * tangent).sqrt();
    (cos, cos * tangent)
}

fn rotated(x: [f64; 3], y: [f64; 3], cos: f64, sin: f64) -> ([f64; 3], [f64; 3]) {
    (sub(scale(x, cos), scale(y, sin)), sub(scale(x, sin), scale(y, -cos)))
}

/// Leading minors all positive; `false` in doubt.
fn is_positive_definite(a: &[[f64; 3]; 3]) -> bool {
    let m1 = a[0][0];
    let m2 = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    let m3 = dot(a[0], cross(a[1], a[2]));
    // Minors this close to zero relative to their terms could have the wrong sign.
    let size = a[0][0].abs().max(a[1][1].abs()).max(a[2][2].abs());
    m1 > 1e-10 * size && m2 > 1e-10 * size * size && m3 > 1e-10 * size * size * size
}

/// A unit vector at right angles to the unit vector `a`.
fn perpendicular(a: [f64; 3]) -> [f64; 3] {
    let mut axis = [0.0; 3];
    let (x, y, z) = (a[0].abs(), a[1].abs(), a[2].abs());
    let least = if x <= y && x <= z {
        0
    } else if y <= z {
        1
    } else {
        2
    };
    axis[least] = 1.0;
    let b = cross(a, axis);
    scale(b, 1.0 / dot(b, b).sqrt())
}

fn column(m: &[[f64; 3]; 3], j: usize) -> [f64; 3] {
    [m[0][j], m[1][j], m[2][j]]
}

fn transpose(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    [column(m, 0), column(m, 1), column(m, 2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest deviation of `U diag(s) V^T` from `F`, of `U`, `V` from rotations.
    fn svd_errors(f: &[[f64; 3]; 3]) -> (f64, f64) {
        let Svd { u, s, v } = signed_svd(f);
        let (mut back, mut rotation) = (0.0_f64, 0.0_f64);
        for i in 0..3 {
            for j in 0..3 {
                let product = u[i][0] * s[0] * v[j][0] + u[i][1] * s[1] * v[j][1];
                back = back.max((product + u[i][2] * s[2] * v[j][2] - f[i][j]).abs());
                let one = if i == j { 1.0 } else { 0.0 };
                rotation = rotation.max((dot(u[i], u[j]) - one).abs());
                rotation = rotation.max((dot(v[i], v[j]) - one).abs());
            }
        }
        for m in [u, v] {
            rotation = rotation.max((dot(m[0], cross(m[1], m[2])) - 1.0).abs());
        }
        assert!(s[0] >= s[1] && s[1] >= s[2].abs() - 1e-15 * s[0], "{s:?}");
        (back, rotation)
    }

    #[test]
    fn decomposition_holds_for_regular_singular_and_inverted_matrices() {
        let outer = |a: [f64; 3], b: [f64; 3]| [scale(b, a[0]), scale(b, a[1]), scale(b, a[2])];
        let rank_one = outer([1.0, -2.0, 0.5], [0.3, 0.2, 0.7]);
        let mut rank_two = rank_one;
        let more = outer([0.1, 0.4, -0.9], [-0.5, 0.6, 0.1]);
        for i in 0..3 {
            for j in 0..3 {
                rank_two[i][j] += more[i][j];
            }
        }
        let diagonal = |x, y, z| [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]];
        let matrices = [
            [[0.0; 3]; 3],
            diagonal(1.0, 1.0, 1.0),
            diagonal(-1.0, -1.0, -1.0),
            diagonal(1.0, 1.0, -1.0),
            diagonal(0.5, 1.0, 2.0),
            diagonal(0.0, 0.0, 3.0),
            diagonal(0.0, -2.0, 0.0),
            diagonal(1e-12, 1.0, 1e-9),
            [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
            [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            [[1.0, 1e-9, 0.0], [-1e-9, 1.0, 1e-8], [0.0, -1e-8, 1.0]],
            [[1.0, 1e3, -1e3], [0.0, 1.0, 5.0], [0.0, 0.0, 1.0]],
            rank_one,
            rank_two,
        ];
        for f in matrices {
            let size = f.iter().flatten().fold(1e-300_f64, |m, x| m.max(x.abs()));
            let (back, rotation) = svd_errors(&f);
            assert!(back <= 1e-14 * size && rotation < 1e-14, "{f:?}: {back:e} {rotation:e}");
        }
        let Svd { s, .. } = signed_svd(&diagonal(-1.0, 2.0, 3.0));
        assert!((s[2] + 1.0).abs() < 1e-15);
    }

    #[test]
    fn small_eigensystem_is_right() {
        let a = [[2.0, -1.0, 0.5], [-1.0, 2.0, 0.25], [0.5, 0.25, -3.0]];
        let (values, v) = symmetric_eigen(a);
        for n in 0..3 {
            for i in 0..3 {
                let x = [v[0][n], v[1][n], v[2][n]];
                assert!((dot(a[i], x) - values[n] * x[i]).abs() < 1e-14);
            }
        }
    }
}
