//! St Venant-Kirchhoff tetrahedron with linear shape functions, with an optional compression term,
//! evaluated per element in one pass from nodal displacements.
//!
//! With shape vectors `D_a` (1/m), rest volume `V` and `G = sum_a u_a (x) D_a`, `F = I + G`:
//!
//! ```text
//! E   = (G + G^T + G^T G)/2                       Green-Lagrange strain
//! S   = lambda (tr E) I + 2 mu E                  second Piola-Kirchhoff stress, Pa
//! J-1 = tr G + (sum of principal 2x2 minors of G) + det G
//! m   = min(J-1, 0),  p1 = 2 kappa m^3,  p2 = 6 kappa m^2
//! W   = V (lambda/2 (tr E)^2 + mu tr E^2 + kappa/2 m^4)                   J
//! f_a = -dW/du_a = -V (F S + p1 cof F) D_a                                N
//! K_ab = V [ lambda (F D_a)(F D_b)^T + mu ((F D_b)(F D_a)^T + (D_a.D_b) F F^T)
//!          + (D_a . S D_b) I
//!          + p2 (cof F D_a)(cof F D_b)^T + p1 skew(F (D_b x D_a)) ]       N/m
//! ```
//!
//! `K = +d2W/du2`, and `skew(w) v = w x v`: varying `F` by `v (x) D_b` turns `cof F D_a` by
//! `F (D_b x D_a) x v`, because `cof F (p x q) = F p x F q`.
//!
//! The elastic part is the energy of Delingette 2008, section 3 (tetrahedral biquadratic springs);
//! [`SpringConstants`](crate::element::precompute::SpringConstants) gives the same energy spring by spring,
//! and the test `springs_equal_the_fused_element` holds the two together. The compression term is
//! that of section 4, with `kappa = lambda + mu`; the printed energy lacks the rest volume `V`
//! (without it the units are Pa, not J) and writes `J` as the determinant of the deformation where
//! that of its gradient is meant. Energy, force and tangent are then three, two and one times
//! continuously differentiable at `J = 1`. The term makes compression of one altitude monotone for
//! every `lambda, mu > 0`; it is no barrier, `J <= 0` costs finite energy, and the flattened state
//! is not a local minimum as the paper has it, but unstable along the normal unless the face is
//! stretched.
//!
//! Nothing here is a position, and nothing subtracts 1 from a number near 1, so `f32` keeps five
//! digits of the force at strains of 1e-6. (`m^4` leaves the range of `f32` at `J` = -1e9.)

use sinew_engine::element::{displacement_gradient, minor, volume_change};
pub use sinew_engine::law::TangentKind;
use sinew_engine::scalar::{Real, Scalar, cross, dot, mat_vec};

use crate::element::matrix::{
    add_identity, add_skew, deformation, dense, rows, symmetric, transposed,
};
use crate::element::precompute::RestTetrahedron;
use crate::element::projection;
use crate::material::LameParameters;

/// Constants of one tetrahedron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element<S> {
    /// Shape vectors `D_1`, `D_2`, `D_3`, 1/m; `D_0` is minus their sum.
    pub gradients: [[S; 3]; 3],
    /// Rest volume, m^3.
    pub volume: S,
    /// First Lamé parameter, Pa.
    pub lambda: S,
    /// Shear modulus, Pa.
    pub mu: S,
    /// Modulus `kappa` of the compression term, Pa: `lambda + mu`, or 0 to leave the term out.
    pub compression: S,
    /// Pressure (Pa, positive in expansion) that acts on `J - 1` besides that of the element: that of the elements whose
    /// mean volume is kept. 0 without; only laws with [`VOLUME`](crate::frame::law::TetrahedronLaw) read it.
    pub pressure: S,
    /// Modulus `kappa` (Pa) of a term `kappa/2 x^4`; 0 without, and read by the same laws.
    pub quartic: S,
    /// Where that term begins: `x = J - 1` where this is 0, else `x = min(J - 1 + slack, 0)`, which is nothing until so large
    /// a part of the volume is lost.
    pub slack: S,
}

impl<R: Real> Element<R> {
    /// With moduli `lambda`, `mu` and `kappa`, and without what clusters or means add.
    #[inline(always)]
    pub fn plain(gradients: [[R; 3]; 3], volume: R, [lambda, mu, compression]: [R; 3]) -> Self {
        let (pressure, quartic, slack) = (R::ZERO, R::ZERO, R::ZERO);
        Self { gradients, volume, lambda, mu, compression, pressure, quartic, slack }
    }

    /// `x` of the quartic term at `m = J - 1`.
    #[inline(always)]
    fn beyond_slack(&self, m: R) -> R {
        R::select(R::less(R::ZERO, self.slack), (m + self.slack).min(R::ZERO), m)
    }

    /// What pressure and quartic term add to the slope of the volume energy at `m = J - 1`.
    #[inline(always)]
    pub(crate) fn more_slope(&self, m: R) -> R {
        let x = self.beyond_slack(m);
        let twice = self.quartic + self.quartic;
        (twice * x * x).mul_add(x, self.pressure)
    }

    /// Density (Pa) of the quartic term.
    #[inline(always)]
    pub(crate) fn quartic_density(&self, m: R) -> R {
        let x = self.beyond_slack(m);
        let square = x * x;
        R::from_f64(0.5) * self.quartic * square * square
    }

    /// `lambda` with what the quartic term adds to the curvature.
    #[inline(always)]
    pub(crate) fn volume_curvature(&self, m: R) -> R {
        let x = self.beyond_slack(m);
        (R::from_f64(6.0) * self.quartic * x).mul_add(x, self.lambda)
    }
}

impl<S: Scalar> Element<S> {
    /// Element with the given rest shape and material, with or without the compression term.
    pub fn new(rest: &RestTetrahedron, material: LameParameters, compression: bool) -> Self {
        let mut gradients = [[S::ZERO; 3]; 3];
        for a in 0..3 {
            for x in 0..3 {
                gradients[a][x] = S::from_f64(rest.gradients[a + 1][x]);
            }
        }
        let kappa = if compression { material.lambda + material.mu } else { 0.0 };
        let moduli = [material.lambda, material.mu, kappa].map(S::from_f64);
        Self::plain(gradients, S::from_f64(rest.volume), moduli)
    }

    /// The same element in `f64`.
    #[inline(always)]
    pub(crate) fn widen(&self) -> Element<f64> {
        Element {
            gradients: widened(&self.gradients),
            volume: self.volume.to_f64(),
            lambda: self.lambda.to_f64(),
            mu: self.mu.to_f64(),
            compression: self.compression.to_f64(),
            pressure: self.pressure.to_f64(),
            quartic: self.quartic.to_f64(),
            slack: self.slack.to_f64(),
        }
    }
}

/// Vectors of the four vertices, displacements (m) or forces (N).
pub type Nodes<S> = [[S; 3]; 4];

/// Symmetric 12x12 element matrix (N/m) as 3x3 blocks, each row-major.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TetrahedronTangent<S> {
    /// Blocks of a local vertex with itself; symmetric.
    pub diagonal: [[S; 9]; 4],
    /// Blocks of two local vertices in the order of [`EDGES`](crate::element::precompute::EDGES); rows
    /// belong to the lower vertex, columns to the higher. The mirrored block is the transpose.
    pub off: [[S; 9]; 6],
}

/// Place of the block of local vertices `a < b` in `off`.
const OFF_INDEX: [[usize; 4]; 4] = [[0, 0, 1, 2], [0, 0, 3, 4], [1, 3, 0, 5], [2, 4, 5, 0]];

impl<S: Real> TetrahedronTangent<S> {
    /// Block with the rows of local vertex `a` and the columns of `b`, row-major.
    #[inline(always)]
    pub fn block(&self, a: usize, b: usize) -> [S; 9] {
        if a == b {
            self.diagonal[a]
        } else if a < b {
            self.off[OFF_INDEX[a][b]]
        } else {
            transposed(&self.off[OFF_INDEX[a][b]])
        }
    }

    /// Product `K v` (N when `v` is in m).
    #[inline(always)]
    pub fn product(&self, v: &Nodes<S>) -> Nodes<S> {
        let mut result = [[S::ZERO; 3]; 4];
        for a in 0..4 {
            for b in 0..4 {
                let part = mat_vec(&self.block(a, b), v[b]);
                for x in 0..3 {
                    result[a][x] += part[x];
                }
            }
        }
        result
    }

    /// All 144 entries; row and column `3 vertex + axis`.
    pub fn to_dense(&self) -> [[S; 12]; 12] {
        dense::<S, 4, 12>(|a, b| self.block(a, b))
    }
}

/// Ratio `J` of deformed to rest volume; zero when flat, negative when turned inside out.
#[inline(always)]
pub fn volume_ratio<S: Real>(e: &Element<S>, u: &Nodes<S>) -> S {
    S::ONE + volume_change(&displacement_gradient(&e.gradients, u))
}

/// Energy, J.
#[inline(always)]
pub fn energy<S: Real>(e: &Element<S>, u: &Nodes<S>) -> S {
    let g = displacement_gradient(&e.gradients, u);
    e.volume * (elastic_density(e, &green_strain(&g)) + compression_density(e, &g))
}

/// Forces on the four vertices, N.
#[inline(always)]
pub fn forces<S: Real>(e: &Element<S>, u: &Nodes<S>) -> Nodes<S> {
    let g = displacement_gradient(&e.gradients, u);
    let mut p = elastic_stress(&g, &second_piola_kirchhoff(e, &green_strain(&g)));
    add_compression_stress(e, &g, &mut p);
    nodal_forces(e, &p)
}

/// Exact tangent `+d2W/du2`, N/m, in any number type.
#[inline(always)]
pub fn exact_tangent<S: Real>(e: &Element<S>, u: &Nodes<S>) -> TetrahedronTangent<S> {
    tangent_parts(e, u, true, true)
}

/// Tangent `+d2W/du2` or a stand-in for it, N/m.
pub fn tangent<S: Scalar>(
    e: &Element<S>,
    u: &Nodes<S>,
    kind: TangentKind,
) -> TetrahedronTangent<S> {
    tangent_of(e, &e.widen(), u, kind, true)
}

/// Tangent with the elastic part on request; `wide` is what eigenvalues are clamped of.
fn tangent_of<S: Scalar>(
    e: &Element<S>,
    wide: &Element<f64>,
    u: &Nodes<S>,
    kind: TangentKind,
    elastic: bool,
) -> TetrahedronTangent<S> {
    if kind == TangentKind::Projected {
        let g = displacement_gradient(&wide.gradients, &widened(u));
        if let (true, Some(blocks)) = projection::projected_blocks(wide, &g) {
            return assemble(&blocks.map(|block| block.map(S::from_f64)));
        }
    }
    tangent_parts(e, u, elastic, kind != TangentKind::GaussNewton)
}

/// Product `K v` (N when `v` is in m) of the tangent with the displacements `v`, without forming it:
/// `(K v)_a = V dP D_a`, `dP` being the rate of the first Piola-Kirchhoff stress `F S + p1 cof F` along
/// `dF = sum_a v_a (x) D_a`. `exact` or else `GaussNewton`, which drops `dF S` and `p1 d(cof F)`; the elastic
/// part on request.
#[inline(always)]
pub(crate) fn product_parts<S: Real>(
    e: &Element<S>,
    u: &Nodes<S>,
    v: &Nodes<S>,
    elastic: bool,
    exact: bool,
) -> Nodes<S> {
    let g = displacement_gradient(&e.gradients, u);
    let h = displacement_gradient(&e.gradients, v);
    // dP; `nodal_forces` turns a stress into forces against it, hence the sign at the end
    let mut p = [S::ZERO; 9];
    if elastic {
        // dE = sym(F^T dF) = sym(dF) + sym(G^T dF)
        let mut rate = [S::ZERO; 9];
        for i in 0..3 {
            for j in 0..3 {
                let product = dot([g[i], g[3 + i], g[6 + i]], [h[j], h[3 + j], h[6 + j]]);
                rate[3 * i + j] = h[3 * i + j] + product;
            }
        }
        let half = S::from_f64(0.5);
        let strain_rate = [
            rate[0],
            rate[4],
            rate[8],
            half * (rate[5] + rate[7]),
            half * (rate[2] + rate[6]),
            half * (rate[1] + rate[3]),
        ];
        p = elastic_stress(&g, &second_piola_kirchhoff(e, &strain_rate));
        if exact {
            let s = rows(&symmetric(second_piola_kirchhoff(e, &green_strain(&g))));
            for i in 0..3 {
                for j in 0..3 {
                    p[3 * i + j] += dot([h[3 * i], h[3 * i + 1], h[3 * i + 2]], s[j]);
                }
            }
        }
    }
    let m = volume_change(&g).min(S::ZERO);
    let p2 = S::from_f64(6.0) * e.compression * (m * m);
    if S::any(S::less(S::ZERO, p2)) {
        let cof = cofactor(&g);
        let mut volume_rate = S::ZERO;
        for k in 0..9 {
            volume_rate = cof[k].mul_add(h[k], volume_rate);
        }
        let c = p2 * volume_rate;
        for k in 0..9 {
            p[k] = c.mul_add(cof[k], p[k]);
        }
        if exact {
            let p1 = (e.compression + e.compression) * (m * m * m);
            let (f, h) = (rows(&deformation(&g)), rows(&h));
            for i in 0..3 {
                // row i of cof F is the vector product of the next two rows of F
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                let (a, b) = (cross(h[j], f[k]), cross(f[j], h[k]));
                for x in 0..3 {
                    p[3 * i + x] = p1.mul_add(a[x] + b[x], p[3 * i + x]);
                }
            }
        }
    }
    let f = nodal_forces(e, &p);
    let mut product = [[S::ZERO; 3]; 4];
    for a in 0..4 {
        for x in 0..3 {
            product[a][x] = -f[a][x];
        }
    }
    product
}

/// The compression term alone, on the same [`Element`]; its `lambda` and `mu` play no part.
///
/// Its exact tangent is indefinite wherever it is not zero. A definite tangent that solvers like
/// better than the projected sum is the projected elastic part (`compression: 0`) plus
/// [`GaussNewton`](TangentKind::GaussNewton) of this one.
pub mod compression {
    use super::*;

    /// Energy, J.
    #[inline(always)]
    pub fn energy<S: Real>(e: &Element<S>, u: &Nodes<S>) -> S {
        e.volume * compression_density(e, &displacement_gradient(&e.gradients, u))
    }

    /// Forces on the four vertices, N; zero for `J >= 1`.
    #[inline(always)]
    pub fn forces<S: Real>(e: &Element<S>, u: &Nodes<S>) -> Nodes<S> {
        let g = displacement_gradient(&e.gradients, u);
        let mut p = [S::ZERO; 9];
        add_compression_stress(e, &g, &mut p);
        nodal_forces(e, &p)
    }

    /// Tangent `+d2W/du2` or a stand-in for it, N/m; zero for `J >= 1`.
    #[inline(always)]
    pub fn tangent<S: Scalar>(
        e: &Element<S>,
        u: &Nodes<S>,
        kind: TangentKind,
    ) -> TetrahedronTangent<S> {
        let wide = Element { lambda: 0.0, mu: 0.0, ..e.widen() };
        tangent_of(e, &wide, u, kind, false)
    }
}

/// Entries xx, yy, zz, yz, xz, xy of `E = (G + G^T + G^T G)/2`.
#[inline(always)]
pub(crate) fn green_strain<S: Real>(g: &[S; 9]) -> [S; 6] {
    let half = S::from_f64(0.5);
    let (c0, c1, c2) = ([g[0], g[3], g[6]], [g[1], g[4], g[7]], [g[2], g[5], g[8]]);
    [
        half.mul_add(dot(c0, c0), g[0]),
        half.mul_add(dot(c1, c1), g[4]),
        half.mul_add(dot(c2, c2), g[8]),
        half * ((g[5] + g[7]) + dot(c1, c2)),
        half * ((g[2] + g[6]) + dot(c0, c2)),
        half * ((g[1] + g[3]) + dot(c0, c1)),
    ]
}

/// `S = lambda (tr E) I + 2 mu E`, in the order of [`green_strain`].
#[inline(always)]
pub(crate) fn second_piola_kirchhoff<S: Real>(e: &Element<S>, strain: &[S; 6]) -> [S; 6] {
    let pressure = e.lambda * (strain[0] + strain[1] + strain[2]);
    let two_mu = e.mu + e.mu;
    [
        two_mu.mul_add(strain[0], pressure),
        two_mu.mul_add(strain[1], pressure),
        two_mu.mul_add(strain[2], pressure),
        two_mu * strain[3],
        two_mu * strain[4],
        two_mu * strain[5],
    ]
}

/// `lambda/2 (tr E)^2 + mu tr E^2`, Pa.
#[inline(always)]
pub(crate) fn elastic_density<S: Real>(e: &Element<S>, strain: &[S; 6]) -> S {
    let [xx, yy, zz, yz, xz, xy] = *strain;
    let trace = xx + yy + zz;
    let shear = dot([yz, xz, xy], [yz, xz, xy]);
    let squares = dot([xx, yy, zz], [xx, yy, zz]) + (shear + shear);
    (S::from_f64(0.5) * e.lambda * trace).mul_add(trace, e.mu * squares)
}

/// [`elastic_density`] of a strain whose trace is the change of volume, with the pressure that acts on it besides.
#[inline(always)]
pub(crate) fn small_strain_density<S: Real>(e: &Element<S>, strain: &[S; 6]) -> S {
    e.pressure.mul_add(strain[0] + strain[1] + strain[2], elastic_density(e, strain))
}

/// The stress (Pa) that belongs to it.
#[inline(always)]
pub(crate) fn small_strain_stress<S: Real>(e: &Element<S>, strain: &[S; 6]) -> [S; 6] {
    let [xx, yy, zz, yz, xz, xy] = second_piola_kirchhoff(e, strain);
    [xx + e.pressure, yy + e.pressure, zz + e.pressure, yz, xz, xy]
}

/// `kappa/2 m^4`, Pa.
#[inline(always)]
fn compression_density<S: Real>(e: &Element<S>, g: &[S; 9]) -> S {
    if !S::any(S::less(S::ZERO, e.compression)) {
        return S::ZERO;
    }
    let m = volume_change(g).min(S::ZERO);
    let m2 = m * m;
    S::from_f64(0.5) * e.compression * m2 * m2
}

/// `cof F = I + (tr G) I - G^T + cof G`, the derivative of `J` by `F`.
#[inline(always)]
pub(crate) fn cofactor<S: Real>(g: &[S; 9]) -> [S; 9] {
    [
        S::ONE + (g[4] + g[8]) + minor(g[4], g[8], g[5], g[7]),
        minor(g[5], g[6], g[3], g[8]) - g[3],
        minor(g[3], g[7], g[4], g[6]) - g[6],
        minor(g[2], g[7], g[1], g[8]) - g[1],
        S::ONE + (g[0] + g[8]) + minor(g[0], g[8], g[2], g[6]),
        minor(g[1], g[6], g[0], g[7]) - g[7],
        minor(g[1], g[5], g[2], g[4]) - g[2],
        minor(g[2], g[3], g[0], g[5]) - g[5],
        S::ONE + (g[0] + g[4]) + minor(g[0], g[4], g[1], g[3]),
    ]
}

/// First Piola-Kirchhoff stress `F S = S + G S`, row-major.
#[inline(always)]
pub(crate) fn elastic_stress<S: Real>(g: &[S; 9], s: &[S; 6]) -> [S; 9] {
    let full = symmetric(*s);
    let mut p = full;
    for i in 0..3 {
        for j in 0..3 {
            let column = [full[j], full[3 + j], full[6 + j]];
            for k in 0..3 {
                p[3 * i + j] = g[3 * i + k].mul_add(column[k], p[3 * i + j]);
            }
        }
    }
    p
}

/// Adds `p1 cof F`; adds zero for `J >= 1`.
#[inline(always)]
fn add_compression_stress<S: Real>(e: &Element<S>, g: &[S; 9], p: &mut [S; 9]) {
    // a body without the term does not pay for it
    if !S::any(S::less(S::ZERO, e.compression)) {
        return;
    }
    let m = volume_change(g).min(S::ZERO);
    let p1 = (e.compression + e.compression) * (m * m * m);
    let cof = cofactor(g);
    for i in 0..9 {
        p[i] = p1.mul_add(cof[i], p[i]);
    }
}

/// `f_a = -V P D_a`.
#[inline(always)]
pub(crate) fn nodal_forces<S: Real>(e: &Element<S>, p: &[S; 9]) -> Nodes<S> {
    let mut f = [[S::ZERO; 3]; 4];
    for a in 0..3 {
        let pd = mat_vec(p, e.gradients[a]);
        for x in 0..3 {
            f[a + 1][x] = -(e.volume * pd[x]);
        }
    }
    for x in 0..3 {
        f[0][x] = -(f[1][x] + f[2][x] + f[3][x]);
    }
    f
}

/// Pairs of vertices 1, 2, 3 (counted from 0 here) whose blocks determine the whole matrix.
pub(crate) const CORE: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [0, 2], [1, 2]];

/// Sum of the elastic part (on request) and the compression part, each with or without the terms
/// that can make it indefinite.
#[inline(always)]
pub(crate) fn tangent_parts<S: Real>(
    e: &Element<S>,
    u: &Nodes<S>,
    elastic: bool,
    indefinite: bool,
) -> TetrahedronTangent<S> {
    let g = displacement_gradient(&e.gradients, u);
    let f = deformation(&g);

    // Quantities of the element: left Cauchy-Green tensor, stress, compression coefficients.
    let [r0, r1, r2] = rows(&f);
    let (b01, b02, b12) = (dot(r0, r1), dot(r0, r2), dot(r1, r2));
    let left = [dot(r0, r0), b01, b02, b01, dot(r1, r1), b12, b02, b12, dot(r2, r2)];
    let stress = symmetric(second_piola_kirchhoff(e, &green_strain(&g)));
    let m = volume_change(&g).min(S::ZERO);
    let p1 = (e.compression + e.compression) * (m * m * m);
    let p2 = S::from_f64(6.0) * e.compression * (m * m);
    // nothing to add anywhere: in tension, or without the term
    let compressed = S::any(S::less(S::ZERO, p2));
    let cof = if compressed { cofactor(&g) } else { g };

    // Quantities of vertices 1, 2, 3.
    let mut fd = [[S::ZERO; 3]; 3];
    let mut sd = [[S::ZERO; 3]; 3];
    let mut cd = [[S::ZERO; 3]; 3];
    for a in 0..3 {
        fd[a] = mat_vec(&f, e.gradients[a]);
        sd[a] = mat_vec(&stress, e.gradients[a]);
        cd[a] = mat_vec(&cof, e.gradients[a]);
    }

    let (lambda, mu) = (e.lambda * e.volume, e.mu * e.volume);
    let (p1, p2) = (p1 * e.volume, p2 * e.volume);
    let mut core = [[S::ZERO; 9]; 6];
    for (block, [a, b]) in core.iter_mut().zip(CORE) {
        if elastic {
            let shear = mu * dot(e.gradients[a], e.gradients[b]);
            for i in 0..3 {
                let (la, mb) = (lambda * fd[a][i], mu * fd[b][i]);
                for j in 0..3 {
                    let sum = mb.mul_add(fd[a][j], la * fd[b][j]);
                    block[3 * i + j] = shear.mul_add(left[3 * i + j], sum);
                }
            }
            if indefinite {
                let geometric = e.volume * dot(e.gradients[a], sd[b]);
                add_identity(block, geometric);
            }
        }
        if compressed {
            for i in 0..3 {
                let ca = p2 * cd[a][i];
                for j in 0..3 {
                    block[3 * i + j] = ca.mul_add(cd[b][j], block[3 * i + j]);
                }
            }
            if indefinite {
                let w = mat_vec(&f, cross(e.gradients[b], e.gradients[a]));
                add_skew(block, [p1 * w[0], p1 * w[1], p1 * w[2]]);
            }
        }
    }
    assemble(&core)
}

/// Whole matrix from the [`CORE`] blocks: rigid translations cost nothing, so the row and column
/// of vertex 0 are minus the sums of the others.
#[inline(always)]
pub(crate) fn assemble<S: Real>(core: &[[S; 9]; 6]) -> TetrahedronTangent<S> {
    let [k11, k22, k33, k12, k13, k23] = core;
    let mut k00 = [S::ZERO; 9];
    let mut k01 = [S::ZERO; 9];
    let mut k02 = [S::ZERO; 9];
    let mut k03 = [S::ZERO; 9];
    for i in 0..3 {
        for j in 0..3 {
            let (x, t) = (3 * i + j, 3 * j + i);
            k01[x] = -(k11[x] + k12[t] + k13[t]);
            k02[x] = -(k12[x] + k22[x] + k23[t]);
            k03[x] = -(k13[x] + k23[x] + k33[x]);
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            let (x, t) = (3 * i + j, 3 * j + i);
            // The two halves make the block symmetric to the last bit.
            let half = S::from_f64(0.5);
            k00[x] = -(half * ((k01[x] + k01[t]) + (k02[x] + k02[t]) + (k03[x] + k03[t])));
        }
    }
    TetrahedronTangent { diagonal: [k00, *k11, *k22, *k33], off: [k01, k02, k03, *k12, *k13, *k23] }
}

#[inline(always)]
fn widened<S: Scalar, const N: usize>(rows: &[[S; 3]; N]) -> [[f64; 3]; N] {
    rows.map(|row| row.map(S::to_f64))
}
