//! Corotational elasticity: linear elasticity in a frame that turns with the element. A comparison
//! model ([`laws::corotational`](crate::laws::corotational)), and the energy that brings bodies with many inverted
//! elements back ([`frame::stand_in`](crate::frame::stand_in)).
//!
//! With the polar decomposition `F = R S` of the deformation gradient and `e = S - I`:
//!
//! ```text
//! W    = V (mu |F - R|^2 + lambda/2 (tr e)^2) = V (mu e:e + lambda/2 (tr e)^2)          J
//! P    = R (2 mu e + lambda (tr e) I),   f_a = -V P D_a                                 N
//! K_ab = V [ 2 mu (D_a.D_b) I + lambda (R D_a)(R D_b)^T - c [R D_a]x H [R D_b]x ]       N/m
//! c    = lambda tr e - 2 mu,   H = (tr(S) I - R S R^T)^-1
//! ```
//!
//! `[w]x v = w x v`. The last term of `K` is the turning of `R`: `R^T dR` has the axis
//! `(tr(S) I - S)^-1` times the axis of `R^T dF - dF^T R`. It becomes singular where two singular values
//! of `F` add up to zero, where `R` is not unique, and is kept finite there.
//!
//! `R` is the rotation that maximises `tr(R^T F)` whatever the sign of `det F`: the smallest singular
//! value takes the sign, so a flat or inverted element finds a rotation too, the one that needs the
//! least movement to become right again (Irving, Teran and Fedkiw 2004). It is found without a singular
//! value decomposition: `tr S` is the largest root of
//! `(x^2 - |F|^2)^2 - 8 det(F) x - 4 |cof F|^2`, and `R` is rational in it (Markley 1993, attitude
//! determination by the fast optimal attitude matrix); only where `R` is badly determined the
//! decomposition of [`Projected`](TangentKind::Projected) tangents is used.
//!
//! `e` solves `(S + I) e = 2 E` with the Green-Lagrange strain `E`, which keeps its digits at small
//! strain; `S - I` would lose them.
//!
//! | tangent | what it is |
//! |---|---|
//! | `Exact` | as above |
//! | `GaussNewton` | `R` held: `R K0 R^T` of linear elasticity, semidefinite; exact where `e = 0` |
//! | `Projected` | eigenvalues of the turning part below `-2 mu` raised to it: semidefinite |
//!
//! The 42 % limit of St Venant-Kirchhoff under compression does not exist: the resistance to a flat
//! element is that of linear elasticity. But a body may pass through `J = 0`, and at large strain the
//! law is softer in tension and less stiff in volume than a real material.

use sinew_engine::element::{displacement_gradient, volume_change};
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::{Real, cross, dot, mat_vec};

use crate::element::matrix::{add_identity, column, deformation, rows, symmetric, symmetrise};
use crate::element::projection::{
    Svd, is_positive_definite, rounding, signed_svd, symmetric_eigen,
};
use crate::element::tetrahedron::{
    CORE, Element, Nodes, TetrahedronTangent, assemble, cofactor, green_strain, nodal_forces,
    small_strain_density, small_strain_stress,
};

/// Polar decomposition of a deformation gradient.
#[derive(Clone, Copy, Debug)]
pub struct Polar<R> {
    /// Rotation `R`, row-major.
    pub rotation: [R; 9],
    /// `e = S - I`: entries xx, yy, zz, yz, xz, xy.
    pub strain: [R; 6],
}

impl<R: Real> Polar<R> {
    /// Of `F = I + G`.
    #[inline(always)]
    pub fn new(g: &[R; 9]) -> Self {
        Self::with(rotation(g), g)
    }

    /// The same with a rotation that is known.
    #[inline(always)]
    fn with(rotation: [R; 9], g: &[R; 9]) -> Self {
        let (one, f) = (R::ONE, deformation(g));
        // S = R^T F to rounding of its largest entry
        let entry = |i: usize, j: usize| {
            let (r, f) = (column(&rotation, i), column(&f, j));
            dot(r, f)
        };
        let half = R::from_f64(0.5);
        let s = [
            entry(0, 0),
            entry(1, 1),
            entry(2, 2),
            half * (entry(1, 2) + entry(2, 1)),
            half * (entry(0, 2) + entry(2, 0)),
            half * (entry(0, 1) + entry(1, 0)),
        ];
        // From the Green-Lagrange strain where S - I would cancel; a mirrored element has none either,
        // but there S + I is singular.
        let green = green_strain(g);
        let sum = [s[0] + one, s[1] + one, s[2] + one, s[3], s[4], s[5]];
        let (adjugate, determinant) = adjugate(&sum);
        let mut size = R::ZERO;
        for x in green {
            size = size.max(x.abs());
        }
        let upright = R::less(R::from_f64(-0.5), volume_change(g));
        let small = R::both(upright, R::less(size, R::from_f64(0.05)));
        let factor = R::from_f64(2.0) / R::select(small, determinant, one);
        let (green, adjugate) = (square(&green), square(&adjugate));
        let product = |i: usize, j: usize| dot(green[i], adjugate[j]);
        let near = [
            factor * product(0, 0),
            factor * product(1, 1),
            factor * product(2, 2),
            half * factor * (product(1, 2) + product(2, 1)),
            half * factor * (product(0, 2) + product(2, 0)),
            half * factor * (product(0, 1) + product(1, 0)),
        ];
        let far = [s[0] - one, s[1] - one, s[2] - one, s[3], s[4], s[5]];
        let mut strain = far;
        for k in 0..6 {
            strain[k] = R::select(small, near[k], far[k]);
        }
        Self { rotation, strain }
    }

    /// `tr e`.
    #[inline(always)]
    pub fn trace(&self) -> R {
        self.strain[0] + self.strain[1] + self.strain[2]
    }

    /// `R` times a symmetric matrix.
    #[inline(always)]
    fn turned(&self, s: &[R; 6]) -> [R; 9] {
        let (r, s) = (rows(&self.rotation), square(s));
        let mut product = [R::ZERO; 9];
        for i in 0..3 {
            for j in 0..3 {
                product[3 * i + j] = dot(r[i], s[j]);
            }
        }
        product
    }

    /// `tr(S) I - R S R^T`, whose eigenvalues are the sums of two singular values.
    #[inline(always)]
    fn sums(&self) -> [R; 6] {
        // tr(S) I - S = (2 + tr e) I - e, turned by R
        let trace = R::from_f64(2.0) + self.trace();
        let (r, turned) = (rows(&self.rotation), rows(&self.turned(&self.strain)));
        let entry = |i: usize, j: usize| dot(turned[i], r[j]);
        [
            trace - entry(0, 0),
            trace - entry(1, 1),
            trace - entry(2, 2),
            -entry(1, 2),
            -entry(0, 2),
            -entry(0, 1),
        ]
    }
}

/// Steps after which Newton's method for `tr S` gives up; one to four are usual.
const MAX_STEPS: usize = 12;

/// `(s_1 + s_2)(s_2 + s_3)(s_3 + s_1)` below this part of `|F|^3` leaves `R` to the decomposition.
const BADLY_DETERMINED: f64 = 0.3;

/// The rotation closest to `F = I + G`, row-major: of the proper rotations it maximises `tr(R^T F)`.
#[inline(always)]
pub fn rotation<R: Real>(g: &[R; 9]) -> [R; 9] {
    let (one, f) = (R::ONE, deformation(g));
    let cof = cofactor(g);
    let (mut squares, mut cofactors) = (R::ZERO, R::ZERO);
    for k in 0..9 {
        squares = f[k].mul_add(f[k], squares);
        cofactors = cof[k].mul_add(cof[k], cofactors);
    }
    let eight_j = R::from_f64(8.0) * (one + volume_change(g));
    let four = R::from_f64(4.0);
    // from above, where the steps are monotone
    let mut x = (R::from_f64(3.0) * squares).sqrt();
    // Converges quadratically: a step of s leaves an error of about s^2, which must be below rounding. Sixteen
    // times as long steps left 1e-5 of R, and so 2e-4 of a strain of 5 %, in single precision.
    let enough = R::from_f64(0.25) * rounding::<R>().sqrt();
    let mut done = R::less(one, R::ZERO);
    for _step in 0..MAX_STEPS {
        let d = x * x - squares;
        let value = d.mul_add(d, -(eight_j.mul_add(x, four * cofactors)));
        let slope = four * x * d - eight_j;
        let step = value / slope;
        x -= step;
        done = R::less(step.abs(), enough * x);
        if !R::any(R::less(R::select(done, one, R::ZERO), one)) {
            break;
        }
    }
    let kappa = R::from_f64(0.5) * (x * x - squares);
    let zeta = kappa * x - R::from_f64(0.125) * eight_j;
    let determined = R::less(R::from_f64(BADLY_DETERMINED) * squares * squares.sqrt(), zeta);
    // cofactors from displacements have lost their digits where `F` is small
    let resolved = R::less(R::from_f64(1e-2), squares);
    let good = R::both(done, R::both(determined, resolved));
    let scale = one / R::select(good, zeta, one);
    // F F^T
    let [r0, r1, r2] = rows(&f);
    let (b01, b02, b12) = (dot(r0, r1), dot(r0, r2), dot(r1, r2));
    let left = [[dot(r0, r0), b01, b02], [b01, dot(r1, r1), b12], [b02, b12, dot(r2, r2)]];
    let sum = kappa + squares;
    let mut rotation = [R::ZERO; 9];
    for i in 0..3 {
        for j in 0..3 {
            let k = 3 * i + j;
            let cubic = dot(left[i], column(&f, j));
            rotation[k] = scale * (sum.mul_add(f[k], x * cof[k]) - cubic);
        }
    }
    if R::any(R::less(R::select(good, one, R::ZERO), one)) {
        let Svd { u, v, .. } = signed_svd(&[r0, r1, r2]);
        for i in 0..3 {
            for j in 0..3 {
                let k = 3 * i + j;
                rotation[k] = R::select(good, rotation[k], dot(u[i], v[j]));
            }
        }
    }
    rotation
}

/// The eigenvalues of the turning part are `2 mu + 2 c/g` with the sums `g` of two singular values.
#[inline(always)]
fn clamped<R: Real>(e: &Element<R>, c: R, sums: &[R; 6]) -> R::Mask {
    let soft = R::both(R::less(c, R::ZERO), R::less(R::ZERO, e.mu));
    let least = -c / R::select(soft, e.mu, R::ONE);
    // a rotation alone has its eigenvalues at zero: those are not negative
    let slack = R::from_f64(64.0) * rounding::<R>() * least;
    let mut shifted = *sums;
    for k in 0..3 {
        shifted[k] = sums[k] - least + slack;
    }
    let definite = is_positive_definite(&square(&shifted), 0.0);
    R::both(soft, R::less(R::select(definite, R::ONE, R::ZERO), R::from_f64(0.5)))
}

/// Blocks of `R K0 R^T`, from turned shape vectors and moduli times volume.
#[inline(always)]
pub(crate) fn warped<R: Real>(d: &[[R; 3]; 3], lambda: R, mu: R) -> [[R; 9]; 6] {
    let mut core = [[R::ZERO; 9]; 6];
    for (block, [a, b]) in core.iter_mut().zip(CORE) {
        let shear = mu * dot(d[a], d[b]);
        for i in 0..3 {
            for j in 0..3 {
                let volume = lambda * d[a][i] * d[b][j];
                block[3 * i + j] = (mu * d[b][i]).mul_add(d[a][j], volume);
            }
        }
        add_identity(block, shear);
    }
    core
}

/// Places of the six entries of a symmetric matrix.
const ENTRIES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)];

/// Rows of a symmetric matrix from its entries xx, yy, zz, yz, xz, xy.
#[inline(always)]
fn square<R: Real>(s: &[R; 6]) -> [[R; 3]; 3] {
    rows(&symmetric(*s))
}

/// Adjugate and determinant of a symmetric matrix.
#[inline(always)]
fn adjugate<R: Real>(s: &[R; 6]) -> ([R; 6], R) {
    let [r0, r1, r2] = square(s);
    let (c0, c1, c2) = (cross(r1, r2), cross(r2, r0), cross(r0, r1));
    ([c0[0], c1[1], c2[2], c1[2], c0[2], c0[1]], dot(r0, c0))
}

/// Inverse of `tr(S) I - S`, kept finite where two singular values add up to zero.
#[inline(always)]
fn inverse<R: Real>(s: &[R; 6]) -> [R; 6] {
    let (mut inverse, determinant) = adjugate(s);
    let size = s[0].abs().max(s[1].abs()).max(s[2].abs());
    let floor = (R::from_f64(1e-6) * size * size * size).max(R::from_f64(1e-30));
    let factor = R::ONE / determinant.max(floor);
    for x in &mut inverse {
        *x *= factor;
    }
    inverse
}

/// Energy (J).
#[inline(always)]
pub fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
    let polar = Polar::new(&displacement_gradient(&e.gradients, u));
    e.volume * small_strain_density(e, &polar.strain)
}

/// Forces (N).
#[inline(always)]
pub fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Nodes<R> {
    let polar = Polar::new(&displacement_gradient(&e.gradients, u));
    let stress = small_strain_stress(e, &polar.strain);
    nodal_forces(e, &polar.turned(&stress))
}

/// Tangent (N/m); see the table of the module.
#[inline(always)]
pub fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TetrahedronTangent<R> {
    let g = displacement_gradient(&e.gradients, u);
    let rotation = rotation(&g);
    let (lambda, two_mu) = (e.lambda * e.volume, (e.mu + e.mu) * e.volume);
    let mut rd = [[R::ZERO; 3]; 3];
    for a in 0..3 {
        rd[a] = mat_vec(&rotation, e.gradients[a]);
    }
    if kind == TangentKind::GaussNewton {
        return assemble(&warped(&rd, lambda, e.mu * e.volume));
    }
    let polar = Polar::with(rotation, &g);
    let c = e.lambda.mul_add(polar.trace(), e.pressure - (e.mu + e.mu));
    let sums = polar.sums();
    let mut h = inverse(&sums);
    if kind == TangentKind::Projected {
        let clamp = clamped(e, c, &sums);
        if R::any(clamp) {
            let least = -c / R::select(clamp, e.mu, R::ONE);
            let (values, vectors) = symmetric_eigen(square(&sums), clamp);
            for (k, (i, j)) in ENTRIES.into_iter().enumerate() {
                let mut sum = R::ZERO;
                for n in 0..3 {
                    let value = R::select(clamp, values[n].max(least), R::ONE);
                    sum += vectors[i][n] * vectors[j][n] / value;
                }
                h[k] = R::select(clamp, sum, h[k]);
            }
        }
    }
    let c = c * e.volume;
    let h = square(&h);
    // H [R D_b]x
    let mut turning = [[[R::ZERO; 3]; 3]; 3];
    for b in 0..3 {
        for i in 0..3 {
            turning[b][i] = cross(h[i], rd[b]);
        }
    }
    let mut core = [[R::ZERO; 9]; 6];
    for (block, [a, b]) in core.iter_mut().zip(CORE) {
        let shear = two_mu * dot(e.gradients[a], e.gradients[b]);
        for j in 0..3 {
            let of_column = [turning[b][0][j], turning[b][1][j], turning[b][2][j]];
            let turned = cross(rd[a], of_column);
            for i in 0..3 {
                let volume = lambda * rd[a][i] * rd[b][j];
                block[3 * i + j] = volume - c * turned[i];
            }
        }
        add_identity(block, shear);
        if a == b {
            symmetrise(block);
        }
    }
    assemble(&core)
}

/// Where the exact tangent has a negative eigenvalue that `Projected` raises.
#[inline(always)]
pub fn is_clamped<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R::Mask {
    let polar = Polar::new(&displacement_gradient(&e.gradients, u));
    let c = e.lambda.mul_add(polar.trace(), e.pressure - (e.mu + e.mu));
    clamped(e, c, &polar.sums())
}
