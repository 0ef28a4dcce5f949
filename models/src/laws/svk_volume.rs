//! St Venant-Kirchhoff shear with a volume term in `J`: for nearly incompressible solids at large strain, where
//! `lambda/2 (tr E)^2` has no incompressible limit (it holds the sum of the squared stretches, not the volume).
//!
//! ```text
//! W    = V (mu E:E + lambda/2 (J - 1)^2)                                                J
//! P    = 2 mu F E + p cof F,   p = lambda (J - 1),   f_a = -V P D_a                     N
//! K_ab = V [ mu (F D_b)(F D_a)^T + mu (D_a.D_b) F F^T + 2 mu (D_a.E D_b) I
//!            + lambda (cof F D_a)(cof F D_b)^T + p skew(F (D_b x D_a)) ]                N/m
//! ```
//!
//! At small strain the moduli are those of the material. `J - 1` comes from displacements, so that nothing
//! cancels. `GaussNewton` leaves out the two terms of stress; `Projected` clamps the eigenvalues of the 9x9
//! second derivative by `F`, which in the basis of the singular values `s` of `F` are those of
//!
//! ```text
//! stretches, 3x3:  A_ii = mu (3 s_i^2 - 1) + lambda c_i^2,  A_ij = lambda c_i c_j + p s_k,  c_i = s_j s_k
//! pairs (i, j):    mu (s_i^2 + s_j^2 - 1) +- (mu s_i s_j - p s_k)
//! ```
//!
//! A linear tetrahedron of this law still locks towards nu = 0.5: it is the energy that treatments of locking
//! build on, not the treatment.
//!
//! ```
//! use sinew_models::material::YoungPoisson;
//! use sinew_models::element::precompute::RestTetrahedron;
//! use sinew_models::element::tetrahedron::Element;
//! use sinew_models::frame::law::TetrahedronLaw;
//! use sinew_models::laws::svk_volume::StVKVolume;
//!
//! let material = YoungPoisson { young_modulus: 3e3, poisson_ratio: 0.49, density: 1000.0 };
//! let corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
//! let e = Element::<f64>::new(&RestTetrahedron::new(corner)?, material.lame()?, false);
//! // vertex 1 pulled out by 10 %: E_xx = 0.105, J - 1 = 0.1
//! let u = [[0.0; 3], [0.1, 0.0, 0.0], [0.0; 3], [0.0; 3]];
//! let expected = (e.mu * 0.105 * 0.105 + 0.5 * e.lambda * 0.1 * 0.1) / 6.0;
//! assert!((StVKVolume::energy(&e, &u) - expected).abs() < 1e-12 * expected);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use bevy_ecs::prelude::*;
use sinew_engine::element::{displacement_gradient, volume_change};
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::{Real, cross, dot, mat_vec};

use crate::element::matrix::{add_identity, add_skew, deformation, rows, symmetric};
use crate::element::projection::{Spectrum, Svd, clamped_blocks, signed_svd};
use crate::element::tetrahedron::{
    CORE, Element, Nodes, TetrahedronTangent, assemble, cofactor, elastic_stress, green_strain,
    nodal_forces, second_piola_kirchhoff,
};
use crate::frame::law::TetrahedronLaw;
use crate::frame::row::LawRow;
use crate::frame::rules::VolumeMeasure;

/// The element without its first modulus, which acts on the volume alone.
#[inline(always)]
fn shear_only<R: Real>(e: &Element<R>) -> Element<R> {
    Element { lambda: R::ZERO, ..*e }
}

/// Whether eigenvalues were clamped, and the blocks of the rest.
#[inline(always)]
fn projected<R: Real>(e: &Element<R>, u: &Nodes<R>) -> (R::Mask, [[R; 9]; 6]) {
    let g = displacement_gradient(&e.gradients, u);
    let m = volume_change(&g);
    let (lambda, mu, one) = (e.volume_curvature(m), e.mu, R::ONE);
    let p = e.lambda.mul_add(m, e.more_slope(m));
    let svd = signed_svd(&rows(&deformation(&g)));
    let Svd { s, .. } = svd;
    let c = [s[1] * s[2], s[0] * s[2], s[0] * s[1]];
    let mut spectrum =
        Spectrum { stretches: [[R::ZERO; 3]; 3], plus: [R::ZERO; 3], minus: [R::ZERO; 3] };
    let mut largest = R::ZERO;
    for i in 0..3 {
        for j in 0..3 {
            let own = if i == j {
                mu * (R::from_f64(3.0) * s[i]).mul_add(s[i], -one)
            } else {
                p * s[3 - i - j]
            };
            spectrum.stretches[i][j] = (lambda * c[i]).mul_add(c[j], own);
            largest = largest.max(spectrum.stretches[i][j].abs());
        }
    }
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let b = mu * s[i].mul_add(s[i], s[j].mul_add(s[j], -one));
        let o = (mu * s[i]).mul_add(s[j], -(p * s[k]));
        (spectrum.plus[k], spectrum.minus[k]) = (b + o, b - o);
        largest = largest.max(b.abs()).max(o.abs());
    }
    let acts = R::less(R::ZERO, mu);
    clamped_blocks(&svd, spectrum, largest, acts, &e.gradients, e.volume)
}

/// St Venant-Kirchhoff shear with a volume term in `J`; also the mark of its tetrahedra.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct StVKVolume;

family! {
    StVKVolume;
    BY_CLUSTERS = tetrahedra_by_clusters(
        "St Venant-Kirchhoff, volume by clusters",
        "clusters of St Venant-Kirchhoff"
    );
    HEXAHEDRA = hexahedra("St Venant-Kirchhoff hexahedra, volume in J");
    HEXAHEDRA_BY_MEAN = hexahedra_by_mean(
        "St Venant-Kirchhoff hexahedra, mean volume",
        "means of St Venant-Kirchhoff hexahedra"
    );
    HEXAHEDRA_REDUCED = hexahedra_reduced("St Venant-Kirchhoff hexahedra, reduced integration, volume in J");
    HEXAHEDRA_REDUCED_BY_MEAN = hexahedra_reduced_by_mean(
        "St Venant-Kirchhoff hexahedra, reduced integration, mean volume",
        "means of St Venant-Kirchhoff hexahedra, reduced integration"
    );
    TETRAHEDRA10 = tetrahedra10("St Venant-Kirchhoff ten-node tetrahedra, volume in J");
    TETRAHEDRA10_BY_MEAN = tetrahedra10_by_mean(
        "St Venant-Kirchhoff ten-node tetrahedra, mean volume",
        "means of St Venant-Kirchhoff ten-node tetrahedra"
    );
}

impl TetrahedronLaw for StVKVolume {
    const NAME: &'static str = "St Venant-Kirchhoff, volume in J";
    type Mark = Self;
    const WIDE: bool = false;
    const STRESS_PROJECTION: bool = false;
    const VOLUME: Option<VolumeMeasure> = Some(VolumeMeasure::Jacobian);
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        let g = displacement_gradient(&e.gradients, u);
        let [xx, yy, zz, yz, xz, xy] = green_strain(&g);
        let shear = dot([yz, xz, xy], [yz, xz, xy]);
        let squares = dot([xx, yy, zz], [xx, yy, zz]) + (shear + shear);
        let m = volume_change(&g);
        let slope = (R::from_f64(0.5) * e.lambda).mul_add(m, e.pressure);
        e.volume * (slope.mul_add(m, e.mu * squares) + e.quartic_density(m))
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>> {
        let g = displacement_gradient(&e.gradients, u);
        let mut p = elastic_stress(&g, &second_piola_kirchhoff(&shear_only(e), &green_strain(&g)));
        let m = volume_change(&g);
        let pressure = e.lambda.mul_add(m, e.more_slope(m));
        let cof = cofactor(&g);
        for k in 0..9 {
            p[k] = pressure.mul_add(cof[k], p[k]);
        }
        Some(nodal_forces(e, &p))
    }
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TetrahedronTangent<R> {
        if kind == TangentKind::Projected {
            return assemble(&projected(e, u).1);
        }
        let exact = kind == TangentKind::Exact;
        let g = displacement_gradient(&e.gradients, u);
        let (f, cof) = (deformation(&g), cofactor(&g));
        let s = symmetric(second_piola_kirchhoff(&shear_only(e), &green_strain(&g)));
        let m = volume_change(&g);
        let pressure = (e.lambda * e.volume).mul_add(m, e.more_slope(m) * e.volume);
        let mu = e.mu * e.volume;
        // a material with nu < 0 would make the volume part negative
        let lambda = e.volume_curvature(m);
        let lambda = if exact { lambda } else { lambda.max(R::ZERO) } * e.volume;
        let mut fd = [[R::ZERO; 3]; 3];
        let mut cd = [[R::ZERO; 3]; 3];
        let mut sd = [[R::ZERO; 3]; 3];
        for n in 0..3 {
            fd[n] = mat_vec(&f, e.gradients[n]);
            cd[n] = mat_vec(&cof, e.gradients[n]);
            sd[n] = mat_vec(&s, e.gradients[n]);
        }
        let rows = rows(&f);
        let mut core = [[R::ZERO; 9]; 6];
        for (block, [n, m]) in core.iter_mut().zip(CORE) {
            let (dn, dm) = (e.gradients[n], e.gradients[m]);
            let along = mu * dot(dn, dm);
            for i in 0..3 {
                let (shear, volume) = (mu * fd[m][i], lambda * cd[n][i]);
                for j in 0..3 {
                    let material = shear.mul_add(fd[n][j], volume * cd[m][j]);
                    block[3 * i + j] = along.mul_add(dot(rows[i], rows[j]), material);
                }
            }
            if exact {
                add_identity(block, e.volume * dot(dn, sd[m]));
                let w = mat_vec(&f, cross(dm, dn));
                add_skew(block, [pressure * w[0], pressure * w[1], pressure * w[2]]);
            }
        }
        assemble(&core)
    }
    #[inline(always)]
    fn is_clamped<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R::Mask {
        projected(e, u).0
    }
}
