//! Stable neo-Hookean elasticity (Smith, de Goes and Kim 2018, Stable Neo-Hookean Flesh Simulation, ACM
//! TOG 37(2)), the form with the logarithm: a comparison model for large strain.
//!
//! ```text
//! W = V (m/2 (I - 3) - m/2 log((I + 1)/4) + l/2 (J - 1 - 3m/(4l))^2) - const,   I = tr F^T F
//! ```
//!
//! The logarithm, which the paper adds against a spurious minimum at `F = 0`, changes the moduli of
//! small strain; they are the material's when
//!
//! ```text
//! m = 4/3 mu,   l = lambda + 5/6 mu
//! ```
//!
//! which is what this module does. (`l` is positive for every material with a positive bulk modulus.)
//! With `q = I - 3 = 2 tr E`, `x = q/4`, and `J - 1` from displacements, so that nothing cancels:
//!
//! ```text
//! W    = V (mu/2 (q - 2 (J-1)) + 2/3 mu (x - log(1 + x)) + l/2 (J-1)^2)                 J
//! P    = mu (F - cof F) + mu/3 q/(4+q) F + l (J-1) cof F,   f_a = -V P D_a              N
//! K_ab = V [ a (D_a.D_b) I + b (F D_a)(F D_b)^T + l (cof F D_a)(cof F D_b)^T
//!            + p skew(F (D_b x D_a)) ]                                                  N/m
//! a = mu (1 + q/(3 (4+q))),   b = 8/3 mu/(4+q)^2,   p = l (J-1) - mu
//! ```
//!
//! `W` vanishes at rest and grows without bound under stretch, but only to a finite value at `J = 0`:
//! inversion is allowed, and undone. `GaussNewton` is the same as `Projected`: `p` is not small at
//! rest, so leaving its term out would give rotations a stiffness.
//!
//! ```
//! use sinew_models::material::YoungPoisson;
//! use sinew_models::element::precompute::RestTetrahedron;
//! use sinew_models::frame::law::TetrahedronLaw;
//! use sinew_models::laws::neo_hookean::NeoHookean;
//! use sinew_models::element::tetrahedron::{Element, TangentKind};
//!
//! // at rest the stiffness matrix is that of linear elasticity
//! let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.4, density: 1000.0 };
//! let corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
//! let rest = RestTetrahedron::new(corner)?;
//! let e = Element::<f64>::new(&rest, material.lame()?, false);
//! let k = NeoHookean::tangent(&e, &[[0.0; 3]; 4], TangentKind::Exact);
//! // a pull along x on vertex 1 meets V (lambda + 2 mu), one along y meets V mu
//! let (lambda, mu) = (e.lambda, e.mu);
//! assert!((k.diagonal[1][0] - (lambda + 2.0 * mu) / 6.0).abs() < 1e-9 * mu);
//! assert!((k.diagonal[1][4] - mu / 6.0).abs() < 1e-9 * mu);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use bevy_ecs::prelude::*;
use sinew_engine::element::{displacement_gradient, minor, volume_change};
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::{Real, cross, dot, mat_vec};

use crate::element::matrix::{add_identity, add_skew, deformation, rows};
use crate::element::projection::{Spectrum, Svd, clamped_blocks, signed_svd};
use crate::element::tetrahedron::{
    CORE, Element, Nodes, TetrahedronTangent, assemble, cofactor, green_strain, nodal_forces,
};
use crate::frame::law::TetrahedronLaw;
use crate::frame::row::LawRow;
use crate::frame::rules::VolumeMeasure;

/// `l` from the moduli of small strain.
#[inline(always)]
fn bulk<R: Real>(e: &Element<R>) -> R {
    R::from_f64(5.0 / 6.0).mul_add(e.mu, e.lambda)
}

/// `q = 2 tr E`.
#[inline(always)]
fn stretch<R: Real>(g: &[R; 9]) -> R {
    let [xx, yy, zz, ..] = green_strain(g);
    let trace = xx + yy + zz;
    trace + trace
}

/// `x - log(1 + x)` for `x > -1`, without cancellation at small `x`.
#[inline(always)]
fn excess_over_logarithm<R: Real>(x: R) -> R {
    // log(1 + x) = 2 artanh(t) with t = x/(2 + x)
    let near = R::less(x.abs(), R::from_f64(0.4));
    let small = R::select(near, x, R::ZERO);
    let t = small / (small + R::from_f64(2.0));
    let near_value = small * t - series(t);
    // beyond: 64 log(y^(1/64))
    let mut root = (R::ONE + x).max(R::from_f64(1e-30));
    for _ in 0..6 {
        root = root.sqrt();
    }
    let t = (root - R::ONE) / (root + R::ONE);
    let far_value = x - R::from_f64(64.0) * (t + t + series(t));
    R::select(near, near_value, far_value)
}

/// `2 artanh(t) - 2 t`.
#[inline(always)]
fn series<R: Real>(t: R) -> R {
    let t2 = t * t;
    let mut sum = R::ZERO;
    for n in (1..=12).rev() {
        sum = sum.mul_add(t2, R::from_f64(2.0 / f64::from(2 * n + 1)));
    }
    sum * t2 * t
}

/// `F - cof F = G + G^T - (tr G) I - cof G`.
#[inline(always)]
fn deviation<R: Real>(g: &[R; 9]) -> [R; 9] {
    [
        g[0] - (g[4] + g[8]) - minor(g[4], g[8], g[5], g[7]),
        g[1] + g[3] - minor(g[5], g[6], g[3], g[8]),
        g[2] + g[6] - minor(g[3], g[7], g[4], g[6]),
        g[3] + g[1] - minor(g[2], g[7], g[1], g[8]),
        g[4] - (g[0] + g[8]) - minor(g[0], g[8], g[2], g[6]),
        g[5] + g[7] - minor(g[1], g[6], g[0], g[7]),
        g[6] + g[2] - minor(g[1], g[5], g[2], g[4]),
        g[7] + g[5] - minor(g[2], g[3], g[0], g[5]),
        g[8] - (g[0] + g[4]) - minor(g[0], g[4], g[1], g[3]),
    ]
}

/// Coefficients `a`, `b`, `p` and `l` of the tangent.
#[inline(always)]
fn coefficients<R: Real>(e: &Element<R>, g: &[R; 9]) -> (R, R, R, R) {
    let q = stretch(g);
    let inverse = R::ONE / (R::from_f64(4.0) + q);
    let a = (R::from_f64(1.0 / 3.0) * e.mu * q).mul_add(inverse, e.mu);
    let b = R::from_f64(8.0 / 3.0) * e.mu * inverse * inverse;
    let m = volume_change(g);
    let curvature = R::from_f64(5.0 / 6.0).mul_add(e.mu, e.volume_curvature(m));
    (a, b, bulk(e).mul_add(m, e.more_slope(m) - e.mu), curvature)
}

/// Whether eigenvalues were clamped, and the blocks of the rest.
#[inline(always)]
fn projected<R: Real>(e: &Element<R>, u: &Nodes<R>) -> (R::Mask, [[R; 9]; 6]) {
    let g = displacement_gradient(&e.gradients, u);
    let f = deformation(&g);
    let (a, b, p, l) = coefficients(e, &g);
    let svd = signed_svd(&rows(&f));
    let Svd { s, .. } = svd;
    let c = [s[1] * s[2], s[0] * s[2], s[0] * s[1]];
    let mut spectrum =
        Spectrum { stretches: [[R::ZERO; 3]; 3], plus: [R::ZERO; 3], minus: [R::ZERO; 3] };
    let mut largest = R::ZERO;
    for i in 0..3 {
        for j in 0..3 {
            let own = if i == j { a } else { p * s[3 - i - j] };
            spectrum.stretches[i][j] = (b * s[i]).mul_add(s[j], (l * c[i]).mul_add(c[j], own));
            largest = largest.max(spectrum.stretches[i][j].abs());
        }
        let turn = p * s[i];
        (spectrum.plus[i], spectrum.minus[i]) = (a - turn, a + turn);
        largest = largest.max(spectrum.plus[i].abs()).max(spectrum.minus[i].abs());
    }
    let acts = R::less(R::ZERO, e.mu);
    clamped_blocks(&svd, spectrum, largest, acts, &e.gradients, e.volume)
}

/// Stable neo-Hookean elasticity; also the mark of its tetrahedra.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct NeoHookean;

family! {
    NeoHookean;
    BY_CLUSTERS = tetrahedra_by_clusters(
        "stable neo-Hookean, volume by clusters",
        "clusters of neo-Hookean"
    );
    HEXAHEDRA = hexahedra("neo-Hookean hexahedra");
    HEXAHEDRA_BY_MEAN = hexahedra_by_mean(
        "neo-Hookean hexahedra, mean volume",
        "means of neo-Hookean hexahedra"
    );
    HEXAHEDRA_REDUCED = hexahedra_reduced("neo-Hookean hexahedra, reduced integration");
    HEXAHEDRA_REDUCED_BY_MEAN = hexahedra_reduced_by_mean(
        "neo-Hookean hexahedra, reduced integration, mean volume",
        "means of neo-Hookean hexahedra, reduced integration"
    );
    TETRAHEDRA10 = tetrahedra10("neo-Hookean ten-node tetrahedra");
    TETRAHEDRA10_BY_MEAN = tetrahedra10_by_mean(
        "neo-Hookean ten-node tetrahedra, mean volume",
        "means of neo-Hookean ten-node tetrahedra"
    );
}

impl TetrahedronLaw for NeoHookean {
    const WIDE: bool = false;
    const NAME: &'static str = "stable neo-Hookean";
    type Mark = Self;
    const STRESS_PROJECTION: bool = false;
    const VOLUME: Option<VolumeMeasure> = Some(VolumeMeasure::Jacobian);
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        let g = displacement_gradient(&e.gradients, u);
        let m = volume_change(&g);
        let strain = green_strain(&g);
        let [xx, yy, zz, yz, xz, xy] = strain;
        let two = R::from_f64(2.0);
        let q = two * (xx + yy + zz);
        // q - 2 (J - 1): both are of first order in the strain, the difference is not. J^2 - 1 = q + r.
        let minors = minor(yy, zz, yz, yz) + minor(xx, zz, xz, xz) + minor(xx, yy, xy, xy);
        let determinant = dot([xx, xy, xz], cross([xy, yy, yz], [xz, yz, zz]));
        let r = R::from_f64(8.0).mul_add(determinant, R::from_f64(4.0) * minors);
        let near = R::less(R::from_f64(-0.5), m);
        let shape = (q * m - (r + r)) / R::select(near, two + m, R::ONE);
        let shape = R::select(near, shape, q - (m + m));
        let half = R::from_f64(0.5);
        let excess = R::from_f64(2.0 / 3.0) * excess_over_logarithm(R::from_f64(0.25) * q);
        let slope = (half * bulk(e)).mul_add(m, e.pressure);
        let quadratic = slope.mul_add(m, e.mu * (half * shape + excess));
        e.volume * (quadratic + e.quartic_density(m))
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>> {
        let g = displacement_gradient(&e.gradients, u);
        let (f, cof) = (deformation(&g), cofactor(&g));
        let q = stretch(&g);
        let deviation = deviation(&g);
        let pull = R::from_f64(1.0 / 3.0) * e.mu * q / (R::from_f64(4.0) + q);
        let m = volume_change(&g);
        let pressure = bulk(e).mul_add(m, e.more_slope(m));
        let mut p = [R::ZERO; 9];
        for k in 0..9 {
            p[k] = pressure.mul_add(cof[k], pull.mul_add(f[k], e.mu * deviation[k]));
        }
        Some(nodal_forces(e, &p))
    }
    /// `+d2W/du2` or, for the other kinds, the same with its negative eigenvalues clamped.
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TetrahedronTangent<R> {
        if kind != TangentKind::Exact {
            return assemble(&projected(e, u).1);
        }
        let g = displacement_gradient(&e.gradients, u);
        let (f, cof) = (deformation(&g), cofactor(&g));
        let (a, b, p, l) = coefficients(e, &g);
        let [a, b, p, l] = [a, b, p, l].map(|x| x * e.volume);
        let mut fd = [[R::ZERO; 3]; 3];
        let mut cd = [[R::ZERO; 3]; 3];
        for n in 0..3 {
            fd[n] = mat_vec(&f, e.gradients[n]);
            cd[n] = mat_vec(&cof, e.gradients[n]);
        }
        let mut core = [[R::ZERO; 9]; 6];
        for (block, [n, m]) in core.iter_mut().zip(CORE) {
            let (dn, dm) = (e.gradients[n], e.gradients[m]);
            for i in 0..3 {
                let (bf, lc) = (b * fd[n][i], l * cd[n][i]);
                for j in 0..3 {
                    block[3 * i + j] = bf.mul_add(fd[m][j], lc * cd[m][j]);
                }
            }
            let shear = a * dot(dn, dm);
            add_identity(block, shear);
            let w = mat_vec(&f, cross(dm, dn));
            add_skew(block, [p * w[0], p * w[1], p * w[2]]);
        }
        assemble(&core)
    }
    #[inline(always)]
    fn is_clamped<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R::Mask {
        projected(e, u).0
    }
}
