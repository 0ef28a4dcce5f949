//! Matrices of 3x3 entries, row-major: blocks of tangents, stresses, gradients.

use sinew_engine::law::TangentKind;
use sinew_engine::scalar::Real;

/// Adds `a b^T`.
#[inline(always)]
pub fn add_outer<R: Real>(m: &mut [R; 9], a: [R; 3], b: [R; 3]) {
    for i in 0..3 {
        for j in 0..3 {
            m[3 * i + j] = a[i].mul_add(b[j], m[3 * i + j]);
        }
    }
}

/// Adds `s I`.
#[inline(always)]
pub fn add_identity<R: Real>(m: &mut [R; 9], s: R) {
    m[0] += s;
    m[4] += s;
    m[8] += s;
}

/// Adds `skew(w)`, with `skew(w) v = w x v`.
#[inline(always)]
pub(crate) fn add_skew<R: Real>(m: &mut [R; 9], w: [R; 3]) {
    m[1] -= w[2];
    m[2] += w[1];
    m[3] += w[2];
    m[5] -= w[0];
    m[6] -= w[1];
    m[7] += w[0];
}

/// Makes a matrix that is symmetric up to rounding so exactly.
#[inline(always)]
pub(crate) fn symmetrise<R: Real>(m: &mut [R; 9]) {
    for (k, l) in [(1, 3), (2, 6), (5, 7)] {
        let mean = R::from_f64(0.5) * (m[k] + m[l]);
        (m[k], m[l]) = (mean, mean);
    }
}

/// What a tension `x` gives to a tangent: a negative one would make it indefinite.
#[inline(always)]
pub(crate) fn part_of_tension<R: Real>(kind: TangentKind, x: R) -> R {
    match kind {
        TangentKind::Exact => x,
        TangentKind::Projected => x.max(R::ZERO),
        TangentKind::GaussNewton => R::ZERO,
    }
}

/// All entries of a matrix of `V` x `V` blocks; row and column `3 vertex + axis`.
pub(crate) fn dense<R: Real, const V: usize, const N: usize>(
    block: impl Fn(usize, usize) -> [R; 9],
) -> [[R; N]; N] {
    let mut dense = [[R::ZERO; N]; N];
    for a in 0..V {
        for b in 0..V {
            for (k, x) in block(a, b).into_iter().enumerate() {
                dense[3 * a + k / 3][3 * b + k % 3] = x;
            }
        }
    }
    dense
}

/// Transpose.
#[inline(always)]
pub fn transposed<R: Real>(m: &[R; 9]) -> [R; 9] {
    [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]]
}

/// Rows.
#[inline(always)]
pub(crate) fn rows<R: Real>(m: &[R; 9]) -> [[R; 3]; 3] {
    [[m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]]
}

/// Column `j`.
#[inline(always)]
pub(crate) fn column<R: Real>(m: &[R; 9], j: usize) -> [R; 3] {
    [m[j], m[3 + j], m[6 + j]]
}

/// `F = I + G`.
#[inline(always)]
pub(crate) fn deformation<R: Real>(g: &[R; 9]) -> [R; 9] {
    let one = R::ONE;
    [one + g[0], g[1], g[2], g[3], one + g[4], g[5], g[6], g[7], one + g[8]]
}

/// A symmetric matrix from its entries xx, yy, zz, yz, xz, xy.
#[inline(always)]
pub(crate) fn symmetric<R: Real>([xx, yy, zz, yz, xz, xy]: [R; 6]) -> [R; 9] {
    [xx, xy, xz, xy, yy, yz, xz, yz, zz]
}
