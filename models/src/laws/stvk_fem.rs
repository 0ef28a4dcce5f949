//! St Venant-Kirchhoff elasticity written the way textbooks have it, to compare cost and rounding with
//! the forms of this crate; the energy is that of [`crate::element::tetrahedron`] without compression term.
//!
//! ```text
//! F = I + sum_a u_a (x) D_a,   E = (F^T F - I)/2,   S = lambda (tr E) I + 2 mu E,   P = F S
//! W    = V (lambda/2 (tr E)^2 + mu tr E^2),   f_a = -V P D_a
//! K_ab = V (B_a^T C B_b + (D_a . S D_b) I)
//! ```
//!
//! with the 6x3 matrices `B_a` of the strain increments and the 6x6 matrix `C` of the moduli, products
//! of zeros included. `F^T F - I` subtracts numbers near 1: the relative error of the force is about a
//! rounding over the strain, in `f32` 1e-7 over it, where the displacement form keeps five digits.

use bevy_ecs::prelude::*;
use sinew_engine::element::displacement_gradient;
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::{Real, dot, mat_vec};

use crate::element::matrix::{add_identity, column, deformation, rows, symmetrise};
use crate::element::tetrahedron::{
    CORE, Element, Nodes, TetrahedronTangent, assemble, nodal_forces,
};
use crate::frame::law::TetrahedronLaw;
use crate::frame::row::LawRow;
use crate::laws::svk;

/// `F` and `E`, row-major.
#[inline(always)]
fn kinematics<R: Real>(e: &Element<R>, u: &Nodes<R>) -> ([R; 9], [R; 9]) {
    let f = deformation(&displacement_gradient(&e.gradients, u));
    let half = R::from_f64(0.5);
    let mut strain = [R::ZERO; 9];
    for i in 0..3 {
        for j in 0..3 {
            let c = dot(column(&f, i), column(&f, j));
            let identity = if i == j { R::ONE } else { R::ZERO };
            strain[3 * i + j] = half * (c - identity);
        }
    }
    (f, strain)
}

/// `S`, row-major.
#[inline(always)]
fn stress<R: Real>(e: &Element<R>, strain: &[R; 9]) -> [R; 9] {
    let pressure = e.lambda * (strain[0] + strain[4] + strain[8]);
    let two_mu = e.mu + e.mu;
    let mut s = [R::ZERO; 9];
    for k in 0..9 {
        s[k] = two_mu * strain[k];
    }
    add_identity(&mut s, pressure);
    s
}

/// St Venant-Kirchhoff elasticity by the textbook; also the mark of its tetrahedra. `Projected` tangents
/// are those of [`crate::laws::svk::FusedStVK`].
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct StVKFem;

/// Row of its tetrahedra in the table of laws.
pub static TETRAHEDRA: LawRow = LawRow::tetrahedra::<StVKFem>().with_family(&[
    &svk::HEXAHEDRA,
    &svk::HEXAHEDRA_REDUCED,
    &svk::TETRAHEDRA10,
]);

impl TetrahedronLaw for StVKFem {
    const WIDE: bool = false;
    const NAME: &'static str = "St Venant-Kirchhoff by finite elements";
    const SOFTENS: bool = true;
    type Mark = Self;
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        let (_, strain) = kinematics(e, u);
        let trace = strain[0] + strain[4] + strain[8];
        let mut squares = R::ZERO;
        for x in strain {
            squares = x.mul_add(x, squares);
        }
        e.volume * (R::from_f64(0.5) * e.lambda * trace).mul_add(trace, e.mu * squares)
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>> {
        let (f, strain) = kinematics(e, u);
        let s = stress(e, &strain);
        let mut p = [R::ZERO; 9];
        for i in 0..3 {
            for j in 0..3 {
                p[3 * i + j] = dot(rows(&f)[i], column(&s, j));
            }
        }
        Some(nodal_forces(e, &p))
    }
    /// `+d2W/du2`, or for `GaussNewton` its first part.
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TetrahedronTangent<R> {
        let (f, strain) = kinematics(e, u);
        let s = stress(e, &strain);
        let (lambda, mu, o) = (e.lambda, e.mu, R::ZERO);
        let axial = lambda + mu + mu;
        let moduli = [
            [axial, lambda, lambda, o, o, o],
            [lambda, axial, lambda, o, o, o],
            [lambda, lambda, axial, o, o, o],
            [o, o, o, mu, o, o],
            [o, o, o, o, mu, o],
            [o, o, o, o, o, mu],
        ];
        // rows xx, yy, zz and twice yz, xz, xy; a column per axis of the vertex
        let mut b = [[[o; 3]; 6]; 3];
        let mut cb = [[[o; 3]; 6]; 3];
        for a in 0..3 {
            let d = e.gradients[a];
            for x in 0..3 {
                let row = rows(&f)[x];
                for k in 0..3 {
                    b[a][k][x] = row[k] * d[k];
                    let (i, j) = [(1, 2), (0, 2), (0, 1)][k];
                    b[a][3 + k][x] = row[i] * d[j] + row[j] * d[i];
                }
                for i in 0..6 {
                    for j in 0..6 {
                        cb[a][i][x] = moduli[i][j].mul_add(b[a][j][x], cb[a][i][x]);
                    }
                }
            }
        }
        let mut core = [[o; 9]; 6];
        for (block, [p, q]) in core.iter_mut().zip(CORE) {
            for i in 0..3 {
                for j in 0..3 {
                    let mut sum = o;
                    for k in 0..6 {
                        sum = b[p][k][i].mul_add(cb[q][k][j], sum);
                    }
                    block[3 * i + j] = e.volume * sum;
                }
            }
            if kind != TangentKind::GaussNewton {
                let geometric = e.volume * dot(e.gradients[p], mat_vec(&s, e.gradients[q]));
                add_identity(block, geometric);
            }
            if p == q {
                symmetrise(block);
            }
        }
        assemble(&core)
    }
}
