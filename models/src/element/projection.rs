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

use sinew_engine::element::volume_change;
use sinew_engine::scalar::{Calculation, Real, cross, dot, scale, sub};

use crate::element::matrix::{deformation, rows, symmetrise};
use crate::element::tetrahedron::{CORE, Element, green_strain, second_piola_kirchhoff};

/// Eigenvalues above minus this part of the largest entry count as not negative: rounding of `s`
/// alone moves the zero eigenvalues of a rotation by a few units of it.
const NEGLIGIBLE: f64 = 16.0 * f64::EPSILON;

/// Smallest minor, relative to its terms, that surely has the right sign in `f64`.
const MARGIN: f64 = 1e-10;

/// Where the exact matrix could have a negative eigenvalue; elsewhere it surely has none, which is
/// told without decomposing `F`.
///
/// The material part and the `p2` part are semidefinite, the stress part is as definite as `S`, and
/// the eigenvalues of the second derivative of `J` are at most twice the largest singular value of
/// `F`. So `S - 2 |p1| |F| I` being definite settles it. `margin` is the rounding to allow for.
#[inline(always)]
pub(crate) fn is_doubtful<R: Real>(e: &Element<R>, g: &[R; 9], margin: f64) -> R::Mask {
    let m = volume_change(g).min(R::ZERO);
    let mut size = R::from_f64(3.0) + R::from_f64(2.0) * (g[0] + g[4] + g[8]);
    for x in g {
        size = x.mul_add(*x, size);
    }
    let shift = R::from_f64(4.0) * e.compression * m * m * m.abs() * size.max(R::ZERO).sqrt();
    let [xx, yy, zz, yz, xz, xy] = second_piola_kirchhoff(e, &green_strain(g));
    let (xx, yy, zz) = (xx - shift, yy - shift, zz - shift);
    let bulk = R::from_f64(3.0).mul_add(e.lambda, e.mu + e.mu);
    let material = R::both(R::less(R::ZERO, e.mu), R::less(R::ZERO, bulk));
    let stress = is_positive_definite(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], margin);
    // where no term acts at all there is nothing to doubt either
    let acts = R::less(R::ZERO, e.compression.max(e.lambda.abs()).max(e.mu));
    R::both(acts, not::<R>(R::both(material, stress)))
}

#[inline(always)]
fn not<R: Real>(mask: R::Mask) -> R::Mask {
    R::less(R::select(mask, R::ONE, R::ZERO), R::from_f64(0.5))
}

/// Blocks of vertices 1, 2, 3 in the order of [`CORE`], of the matrix with negative eigenvalues
/// clamped at zero, and where there are any to clamp; elsewhere the blocks are those of the exact
/// matrix to rounding. `None` where it surely has no negative eigenvalue in any lane. Always in `f64`.
#[inline(always)]
pub(crate) fn projected_blocks<R: Real>(
    e: &Element<R>,
    g: &[R; 9],
) -> (R::Mask, Option<[[R; 9]; 6]>) {
    let (lambda, mu) = (e.lambda, e.mu);
    let doubtful = is_doubtful(e, g, MARGIN);
    if !R::any(doubtful) {
        return (doubtful, None);
    }
    let two = R::from_f64(2.0);
    let m = volume_change(g).min(R::ZERO);
    let strain = green_strain(g);
    let p1 = two * e.compression * m * m * m;
    let p2 = R::from_f64(6.0) * e.compression * m * m;
    let svd = signed_svd(&rows(&deformation(g)));
    let Svd { s, .. } = svd;
    // t = tr E, from G rather than from s: exact to rounding near rest, where it is small.
    let t = strain[0] + strain[1] + strain[2];
    let c = [s[1] * s[2], s[0] * s[2], s[0] * s[1]];

    // The 9x9 in the basis of the decomposition.
    let three = R::from_f64(3.0);
    let mut a = [[R::ZERO; 3]; 3];
    let mut largest = R::ZERO;
    for i in 0..3 {
        for j in 0..3 {
            let own = if i == j {
                lambda * t + mu * (three * s[i] * s[i] - R::ONE)
            } else {
                p1 * s[3 - i - j]
            };
            a[i][j] = lambda * s[i] * s[j] + p2 * c[i] * c[j] + own;
            largest = largest.max(a[i][j].abs());
        }
    }
    // Pair k couples the two indices other than k.
    let mut plus = [R::ZERO; 3];
    let mut minus = [R::ZERO; 3];
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let b = lambda * t - mu + mu * (s[i] * s[i] + s[j] * s[j]);
        let o = mu * s[i] * s[j] - p1 * s[k];
        (plus[k], minus[k]) = (b + o, b - o);
        largest = largest.max(b.abs()).max(o.abs());
    }

    let spectrum = Spectrum { stretches: a, plus, minus };
    let (clamped, blocks) =
        clamped_blocks(&svd, spectrum, largest, doubtful, &e.gradients, e.volume);
    (clamped, Some(blocks))
}

/// The 9x9 second derivative of an isotropic energy by `F` in the basis of the decomposition.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spectrum<R> {
    /// Second derivatives by the singular values.
    pub stretches: [[R; 3]; 3],
    /// Eigenvalues of the symmetric pairs; entry `k` belongs to the two indices other than `k`.
    pub plus: [R; 3],
    /// Eigenvalues of the antisymmetric pairs.
    pub minus: [R; 3],
}

/// Blocks of vertices 1, 2, 3 in the order of [`CORE`] from a spectrum whose negative eigenvalues are
/// clamped at zero, and where among the `doubtful` there were any below a rounding of `largest`.
#[inline(always)]
pub(crate) fn clamped_blocks<R: Real>(
    svd: &Svd<R>,
    spectrum: Spectrum<R>,
    largest: R,
    doubtful: R::Mask,
    gradients: &[[R; 3]; 3],
    volume: R,
) -> (R::Mask, [[R; 9]; 6]) {
    let Svd { u, v, .. } = svd;
    let Spectrum { stretches: mut a, plus, minus } = spectrum;
    let floor = R::from_f64(-NEGLIGIBLE / f64::EPSILON) * rounding::<R>() * largest;
    let mut least = plus[0].min(minus[0]);
    for k in 1..3 {
        least = least.min(plus[k]).min(minus[k]);
    }
    let mut clamp = R::less(least, floor);
    let indefinite = R::both(doubtful, not::<R>(is_positive_definite(&a, MARGIN)));
    if R::any(indefinite) {
        let (values, vectors) = symmetric_eigen(a, indefinite);
        let negative = R::both(indefinite, R::less(values[0].min(values[1]).min(values[2]), floor));
        clamp = R::either(clamp, negative);
        for i in 0..3 {
            for j in 0..3 {
                let mut sum = R::ZERO;
                for n in 0..3 {
                    sum += values[n].max(R::ZERO) * vectors[i][n] * vectors[j][n];
                }
                a[i][j] = R::select(negative, sum, a[i][j]);
            }
        }
    }
    clamp = R::both(clamp, doubtful);
    let half_of = R::from_f64(0.5);
    let mut straight = [R::ZERO; 3];
    let mut crossed = [R::ZERO; 3];
    for k in 0..3 {
        let (p, q) = (plus[k].max(R::ZERO), minus[k].max(R::ZERO));
        (straight[k], crossed[k]) = (half_of * (p + q), half_of * (p - q));
    }

    // K_ab = V U [ sum_jl H_ij,kl (V^T D_a)_j (V^T D_b)_l ]_ik U^T.
    let mut d = [[R::ZERO; 3]; 3];
    for n in 0..3 {
        for i in 0..3 {
            d[n][i] = dot(column(v, i), gradients[n]);
        }
    }
    let mut blocks = [[R::ZERO; 9]; 6];
    for (block, [p, q]) in blocks.iter_mut().zip(CORE) {
        let mut inner = [[R::ZERO; 3]; 3];
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
        let mut half = [[R::ZERO; 3]; 3];
        for i in 0..3 {
            for k in 0..3 {
                half[i][k] = dot(u[i], column(&inner, k));
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                block[3 * i + j] = volume * dot(half[i], u[j]);
            }
        }
    }
    // Diagonal blocks are symmetric up to rounding; make them so exactly.
    for block in &mut blocks[..3] {
        symmetrise(block);
    }
    (clamp, blocks)
}

/// `F = U diag(s) V^T` with rotations `U`, `V` given by rows, and `s_1 >= s_2 >= |s_3|`.
pub struct Svd<R> {
    /// Rows of `U`.
    pub u: [[R; 3]; 3],
    /// Singular values.
    pub s: [R; 3],
    /// Rows of `V`.
    pub v: [[R; 3]; 3],
}

/// Distance from 1 to the next larger number of a lane.
#[inline(always)]
pub fn rounding<R: Real>() -> R {
    // a number between the two distances is rounded away in single precision
    let double = R::any(R::less(R::ONE, R::from_f64(1.0 + 1e-10)));
    R::from_f64(if double { f64::EPSILON } else { f64::from(f32::EPSILON) })
}

/// Sweeps after which a Jacobi iteration gives up; five to eight are usual.
const MAX_SWEEPS: usize = 30;

/// Signed singular values by one-sided Jacobi: `V` is turned until the columns of `F V` are
/// orthogonal, which diagonalises `F^T F` without forming it, so small singular values keep their
/// digits. Any finite `F` will do; missing directions of a singular one are filled in.
#[inline(always)]
pub fn signed_svd<R: Real>(f: &[[R; 3]; 3]) -> Svd<R> {
    R::apart(SignedSvd(*f))
}

struct SignedSvd<R>([[R; 3]; 3]);

impl<R: Real> Calculation<R> for SignedSvd<R> {
    type Output = Svd<R>;
    #[inline(always)]
    fn run(self) -> Svd<R> {
        svd_of(&self.0)
    }
}

#[inline(always)]
fn svd_of<R: Real>(f: &[[R; 3]; 3]) -> Svd<R> {
    let epsilon = rounding::<R>();
    // Columns of F V and of V; V stays a rotation.
    let mut b = [column(f, 0), column(f, 1), column(f, 2)];
    let (o, l) = (R::ZERO, R::ONE);
    let mut v = [[l, o, o], [o, l, o], [o, o, l]];
    for _sweep in 0..MAX_SWEEPS {
        let mut turned = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (alpha, beta, gamma) = (dot(b[p], b[p]), dot(b[q], b[q]), dot(b[p], b[q]));
            let turn = R::less(epsilon * alpha.sqrt() * beta.sqrt(), gamma.abs());
            if R::any(turn) {
                turned = true;
                let (cos, sin) = jacobi_rotation(alpha, beta, gamma, turn);
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
        let exchange = R::less(dot(b[p], b[p]), dot(b[q], b[q]));
        for x in [&mut b, &mut v] {
            let turned = scale(x[p], -l);
            (x[p], x[q]) = (chosen(exchange, x[q], x[p]), chosen(exchange, turned, x[q]));
        }
    }
    // Directions from the columns; where a column vanishes any perpendicular one serves.
    let tiny = R::from_f64(1e-150);
    let first = dot(b[0], b[0]).sqrt();
    let exists = R::less(tiny, first);
    let u0 = chosen(exists, scale(b[0], l / R::select(exists, first, l)), [l, o, o]);
    let rest = sub(b[1], scale(u0, dot(u0, b[1])));
    let second = dot(rest, rest).sqrt();
    let exists = R::less((R::from_f64(4.5) * epsilon * first).max(tiny), second);
    let mut u1 = chosen(exists, scale(rest, l / R::select(exists, second, l)), perpendicular(u0));
    // A second pass restores the angle that a short column lost to rounding.
    u1 = sub(u1, scale(u0, dot(u0, u1)));
    u1 = scale(u1, l / dot(u1, u1).sqrt());
    let u2 = cross(u0, u1);
    Svd {
        u: transpose(&[u0, u1, u2]),
        s: [dot(u0, b[0]), dot(u1, b[1]), dot(u2, b[2])],
        v: transpose(&v),
    }
}

/// Eigenvalues and eigenvectors (columns) of symmetric matrices by cyclic Jacobi rotations, where
/// `wanted` holds; elsewhere the values mean nothing.
#[inline(always)]
pub fn symmetric_eigen<R: Real>(a: [[R; 3]; 3], wanted: R::Mask) -> ([R; 3], [[R; 3]; 3]) {
    R::apart(SymmetricEigen(a, wanted))
}

struct SymmetricEigen<R: Real>([[R; 3]; 3], R::Mask);

impl<R: Real> Calculation<R> for SymmetricEigen<R> {
    type Output = ([R; 3], [[R; 3]; 3]);
    #[inline(always)]
    fn run(self) -> ([R; 3], [[R; 3]; 3]) {
        eigen_of(self.0, self.1)
    }
}

#[inline(always)]
fn eigen_of<R: Real>(mut a: [[R; 3]; 3], wanted: R::Mask) -> ([R; 3], [[R; 3]; 3]) {
    let (o, l) = (R::ZERO, R::ONE);
    let mut v = [[l, o, o], [o, l, o], [o, o, l]];
    for _sweep in 0..MAX_SWEEPS {
        let size = a[0][0].abs() + a[1][1].abs() + a[2][2].abs();
        let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        // false where something is not finite: there is nothing to find
        let turn = R::both(wanted, R::less(R::from_f64(1e-3) * rounding::<R>() * size, off));
        let turn = R::both(turn, R::less(off, R::from_f64(f64::INFINITY)));
        if !R::any(turn) {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let turn = R::both(turn, R::less(o, a[p][q].abs()));
            let (cos, sin) = jacobi_rotation(a[p][p], a[q][q], a[p][q], turn);
            (a[p], a[q]) = rotated(a[p], a[q], cos, sin);
            for row in a.iter_mut().chain(v.iter_mut()) {
                (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
            }
        }
    }
    ([a[0][0], a[1][1], a[2][2]], v)
}

/// Cosine and sine of the rotation that makes `[[alpha, gamma], [gamma, beta]]` diagonal, with the
/// smaller of the two possible angles, where `turn` holds (`gamma` is not zero there); no rotation
/// elsewhere.
#[inline(always)]
fn jacobi_rotation<R: Real>(alpha: R, beta: R, gamma: R, turn: R::Mask) -> (R, R) {
    let (o, l) = (R::ZERO, R::ONE);
    let gamma = R::select(turn, gamma, l);
    let zeta = (beta - alpha) / (gamma + gamma);
    let sign = R::select(R::less(zeta, o), -l, l);
    // Overflow of the square only means that there is nothing left to turn.
    let tangent = sign / (zeta.abs() + zeta.mul_add(zeta, l).sqrt());
    let cos = l / tangent.mul_add(tangent, l).sqrt();
    (R::select(turn, cos, l), R::select(turn, cos * tangent, o))
}

#[inline(always)]
fn rotated<R: Real>(x: [R; 3], y: [R; 3], cos: R, sin: R) -> ([R; 3], [R; 3]) {
    (sub(scale(x, cos), scale(y, sin)), sub(scale(x, sin), scale(y, -cos)))
}

#[inline(always)]
fn chosen<R: Real>(mask: R::Mask, yes: [R; 3], no: [R; 3]) -> [R; 3] {
    [R::select(mask, yes[0], no[0]), R::select(mask, yes[1], no[1]), R::select(mask, yes[2], no[2])]
}

/// Leading minors all positive; `false` in doubt.
#[inline(always)]
pub fn is_positive_definite<R: Real>(a: &[[R; 3]; 3], margin: f64) -> R::Mask {
    let m1 = a[0][0];
    let m2 = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    let m3 = dot(a[0], cross(a[1], a[2]));
    // Minors this close to zero relative to their terms could have the wrong sign.
    let size = a[0][0].abs().max(a[1][1].abs()).max(a[2][2].abs());
    let margin = R::from_f64(margin);
    R::both(
        R::less(margin * size, m1),
        R::both(R::less(margin * size * size, m2), R::less(margin * size * size * size, m3)),
    )
}

/// A unit vector at right angles to the unit vector `a`.
#[inline(always)]
fn perpendicular<R: Real>(a: [R; 3]) -> [R; 3] {
    let (o, l) = (R::ZERO, R::ONE);
    let (x, y, z) = (a[0].abs(), a[1].abs(), a[2].abs());
    let y_is_less = R::less(y, z);
    let axis = chosen(y_is_less, [o, l, o], [o, o, l]);
    let axis = chosen(R::less(x, y.min(z)), [l, o, o], axis);
    let b = cross(a, axis);
    scale(b, l / dot(b, b).sqrt())
}

#[inline(always)]
fn column<R: Real>(m: &[[R; 3]; 3], j: usize) -> [R; 3] {
    [m[0][j], m[1][j], m[2][j]]
}

#[inline(always)]
fn transpose<R: Real>(m: &[[R; 3]; 3]) -> [[R; 3]; 3] {
    [column(m, 0), column(m, 1), column(m, 2)]
}
