//! Hexahedron with one evaluation of its law and a quadratic energy of its hourglass modes: reduced integration with a
//! stabilisation that has an energy.
//!
//! The trilinear field of a hexahedron is an affine part, which its mean gradient says, and four hourglass modes. With the
//! mean gradients `b_a = 1/V int grad N_a`, the gradients `b0_a` in the middle, and `h_1..4 = (xi eta, eta zeta, zeta xi,
//! xi eta zeta)`, whose values at the corners are `h_ga`:
//!
//! ```text
//! gamma_ga = 1/8 (h_ga - (sum_b h_gb X_b) . b0_a)     sum_a gamma_ga = 0, sum_a gamma_ga X_a = 0
//! F = I + sum_a u_a b_a^T     q_g = sum_a gamma_ga u_a                                         1, m
//! grad u = (F - I) + sum_g q_g (grad h_g - <grad h_g>)^T                                       exact
//! ```
//!
//! (Flanagan & Belytschko 1981, A uniform strain hexahedron and quadrilateral with orthogonal hourglass control). All of the law
//! acts on `F`. The modes have the energy of linear elasticity at rest, in the frame that `F` carries along, so that a turn costs nothing:
//!
//! ```text
//! Z_g = F^T q_g     G_g = sum_h K_gh Z_h
//! W   = V psi(F) + 1/2 sum_g Z_g . G_g + 1/2 sum_gh kappa_gh q_g . q_h                         J
//! dW/dF   = V P(F) + sum_g q_g G_g^T
//! dW/dq_g = F G_g + sum_h kappa_gh q_h
//! f_a = -(dW/dF b_a + sum_g gamma_ga dW/dq_g)                                                  N
//! ```
//!
//! Second derivatives, with the components `i, j` of columns of `F` and `k, l` of places:
//!
//! ```text
//! FF(ki, lj)  = V A_ki,lj + sum_gh q_gk K_gi,hj q_hl
//! Fq(ki, hl)  = sum_g q_gk sum_j K_gi,hj F_lj + G_hi delta_kl
//! qq(gk, hl)  = sum_ij F_ki K_gi,hj F_lj + kappa_gh delta_kl
//! K_ab        = sum_IJ m_Ia H_IJ m_Jb     m = (b, gamma)
//! ```
//!
//! Without the second term of `Fq` (Gauss-Newton) all of this is positive semidefinite where `A` is.
//!
//! # Stiffness of the modes
//!
//! `K + kappa I` is that of the strains `e_gi = sym(e_i (grad h_g - <grad h_g>)^T)` with the nine enhanced strains `m_k` of Wilson's
//! incompatible modes, pulled to the middle and condensed at rest (Simo & Rifai 1990, A class of mixed assumed strain methods),
//! without which bending would be far too stiff:
//!
//! ```text
//! m_k = det J0 / det J  J0^-T M_k J0^-1      M: xi_i in ii; xi_i and xi_j in ij
//! K_h = int e:C:e - (int m:C:e)^T (int m:C:m)^-1 (int m:C:e)      C = C(min(lambda, mu), mu)
//! ```
//!
//! All of lambda in `C` would lock on cells that are no bricks. A part `kappa` of `K_h` is taken out of the frame of `F`, as
//! much as leaves `K` semidefinite: it still holds the modes when an element is flattened, where `F^T q` vanishes. With the mean
//! over directions `M_gh = 1/3 sum_i K_h(gi, hi)` and the least eigenvalue `t` of `K_h` against `M x I`, `kappa = 0.3 t M`. So no mode
//! loses its stiffness under any compression, as incompatible modes do (Wriggers & Reese 1996).
//!
//! # Elements that are filled in part
//!
//! All means and integrals are those over what is filled, with `V` and the moduli times its share: `b_a = <grad N_a>` is then the
//! gradient where the matter is, and affine fields stay exact whatever is filled. The part is stood in for by a
//! parallelepiped in local coordinates of the same middle and the same second moments, on which the Gauss rule of 3x3x3 points lies: exact
//! for what planes along the axes cut off. `m_k` loses its mean. A flat part would leave modes nearly without stiffness, so the second
//! moments are drawn towards those of the whole element by a sixteenth: nothing is thinner than a quarter of it.

use sinew_engine::isoparametric::{
    CORNERS, RestHexahedron, gauss_point, hexahedron_derivatives, hexahedron_shape,
};
use sinew_engine::mesh::Filled;
use sinew_engine::scalar::{Real, add, cross, dot, mat_vec, scale, sub};

use crate::element::matrix::{add_identity, add_outer, deformation, rows, transposed};
use crate::material::LameParameters;

/// Part of the mean hourglass stiffness that does not turn with `F`, over the largest that leaves the rest semidefinite.
const KEPT: f64 = 0.3;

/// Weights `m_I` of the vertices in the columns of `F - I` (1/m) and in the modes `q` (1): `[b_x, b_y, b_z, gamma_1..4]`.
pub type Weights<R> = [[R; 8]; 7];

/// Rest shape in `f64`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestShape {
    /// Weights of the vertices.
    pub weights: Weights<f64>,
    /// Volume (m^3).
    pub volume: f64,
}

/// Values of the hourglass functions `h` at local coordinates.
fn functions([x, y, z]: [f64; 3]) -> [f64; 4] {
    [x * y, y * z, z * x, x * y * z]
}

/// Their derivatives by the local coordinates.
fn function_derivatives([x, y, z]: [f64; 3]) -> [[f64; 3]; 4] {
    [[y, x, 0.0], [0.0, z, y], [z, 0.0, x], [y * z, z * x, x * y]]
}

/// Edges `X_xi, X_eta, X_zeta` (m) at local coordinates.
fn edges_at(at: [f64; 3], points: &[[f64; 3]; 8]) -> [[f64; 3]; 3] {
    let mut edges = [[0.0; 3]; 3];
    for (derivative, point) in hexahedron_derivatives(at).iter().zip(points) {
        for k in 0..3 {
            edges[k] = add(edges[k], scale(sub(*point, points[0]), derivative[k]));
        }
    }
    edges
}

/// Jacobian (m^3) and gradients (1/m) of the local coordinates, from the edges.
fn gradients([a, b, c]: [[f64; 3]; 3]) -> (f64, [[f64; 3]; 3]) {
    let jacobian = dot(a, cross(b, c));
    (jacobian, [cross(b, c), cross(c, a), cross(a, b)].map(|d| scale(d, 1.0 / jacobian)))
}

/// `sum_k d_k D_k`: the gradient of a function with these derivatives.
fn combined(derivatives: [f64; 3], d: &[[f64; 3]; 3]) -> [f64; 3] {
    let [x, y, z] = derivatives;
    add(scale(d[0], x), add(scale(d[1], y), scale(d[2], z)))
}

impl RestShape {
    /// Of a hexahedron with these corners (m), whose rest shape at Gauss points is `rest`; the volume is that of all of it.
    pub fn new(rest: &RestHexahedron, points: &[[f64; 3]; 8], filled: &Filled) -> Self {
        let volume = rest.total_volume();
        let mut weights = [[0.0; 8]; 7];
        if !filled.is_even() {
            weights[..3].copy_from_slice(&mean_gradients(points, filled));
        }
        for q in (0..8).filter(|_| filled.is_even()) {
            for (a, derivatives) in hexahedron_derivatives(gauss_point(q)).into_iter().enumerate() {
                let gradient = combined(derivatives, &rest.gradients[q]);
                for x in 0..3 {
                    weights[x][a] += rest.volume[q] / volume * gradient[x];
                }
            }
        }
        let (_, middle) = gradients(edges_at([0.0; 3], points));
        let values = CORNERS.map(functions);
        for g in 0..4 {
            let mut sum = [0.0; 3];
            for (value, point) in values.iter().zip(points) {
                sum = add(sum, scale(sub(*point, points[0]), value[g]));
            }
            let derivatives = hexahedron_derivatives([0.0; 3]);
            for (a, (value, derivatives)) in values.iter().zip(derivatives).enumerate() {
                let gradient = combined(derivatives, &middle);
                weights[3 + g][a] = 0.125 * (value[g] - dot(sum, gradient));
            }
        }
        Self { weights, volume }
    }
}

/// Part of the way by which second moments of what is filled are drawn towards those of the whole element.
const DRAWN: f64 = 1.0 / 16.0;

/// Least mass of a vertex over an eighth of the element's. What is filled next to the face opposite gives its shape function next to
/// nothing, and explicit steps would be the shorter for it.
const LEAST_MASS: f64 = 0.25;

/// Gauss rule over what is filled: local coordinates, and weights that give the volume of all of the element.
fn rule(filled: &Filled, points: &[[f64; 3]; 8]) -> Vec<([f64; 3], f64)> {
    let [a, b, c, d, e, f] = filled.spread;
    let wide = [a, b, c].map(|s| 3.0 * (s + DRAWN * (1.0 / 3.0 - s)));
    let [yz, zx, xy] = [d, e, f].map(|s| 3.0 * (1.0 - DRAWN) * s);
    let moments = [[wide[0], xy, zx], [xy, wide[1], yz], [zx, yz, wide[2]]];
    // definite where the moments are those of a part
    let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let edges = cholesky(&moments).unwrap_or(unit);
    let mut all = Vec::with_capacity(27);
    for (x, wx) in THREE {
        for (y, wy) in THREE {
            for (z, wz) in THREE {
                let local = edges.map(|row| dot(row, [x, y, z]));
                all.push((add(filled.middle, local), wx * wy * wz));
            }
        }
    }
    if !filled.is_even() {
        let volume = |rule: &[([f64; 3], f64)]| -> f64 {
            rule.iter().map(|(local, weight)| weight * gradients(edges_at(*local, points)).0).sum()
        };
        let factor = volume(&rule(&Filled::evenly(1.0), points)) / volume(&all);
        all.iter_mut().for_each(|(_, weight)| *weight *= factor);
    }
    all
}

/// `<grad N_a>` (1/m), component by component.
fn mean_gradients(points: &[[f64; 3]; 8], filled: &Filled) -> [[f64; 8]; 3] {
    let (mut sums, mut volume) = ([[0.0; 8]; 3], 0.0);
    for (local, weight) in rule(filled, points) {
        let (jacobian, d) = gradients(edges_at(local, points));
        volume += weight * jacobian;
        for (a, derivatives) in hexahedron_derivatives(local).into_iter().enumerate() {
            let gradient = combined(derivatives, &d);
            for x in 0..3 {
                sums[x][a] += weight * jacobian * gradient[x];
            }
        }
    }
    sums.map(|row| row.map(|sum| sum / volume))
}

/// Volume (m^3) of every vertex, `int N_a dV` over what is filled as if it filled all of the element, but not less than a share.
pub fn vertex_volumes(rest: &RestHexahedron, points: &[[f64; 3]; 8], filled: &Filled) -> [f64; 8] {
    if filled.is_even() {
        return rest.vertex_volumes();
    }
    let mut shares = [0.0; 8];
    for (local, weight) in rule(filled, points) {
        let (jacobian, _) = gradients(edges_at(local, points));
        for (share, n) in shares.iter_mut().zip(hexahedron_shape(local)) {
            *share += weight * jacobian * n;
        }
    }
    let whole: f64 = shares.iter().sum();
    let shares = shares.map(|share| (share / whole).max(LEAST_MASS / 8.0));
    let sum: f64 = shares.iter().sum();
    shares.map(|share| rest.total_volume() * share / sum)
}

/// Number of entries of [`Stiffness`].
pub const ENTRIES: usize = 78 + 10;

/// Stiffness of the hourglass modes (N/m): the upper half of `K`, row and column `3 g + i`, then that of `kappa`, both row by
/// row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness<R>(pub [R; ENTRIES]);

/// Place of an entry in the upper half of a symmetric matrix of `n` rows.
const fn packed(n: usize, i: usize, j: usize) -> usize {
    let (i, j) = if i < j { (i, j) } else { (j, i) };
    i * (2 * n - 1 - i) / 2 + j
}

impl<R: Real> Stiffness<R> {
    /// Entry of `K`.
    #[inline(always)]
    fn turning(&self, i: usize, j: usize) -> R {
        self.0[packed(12, i, j)]
    }

    /// Entry of `kappa`.
    #[inline(always)]
    fn fixed(&self, g: usize, h: usize) -> R {
        self.0[78 + packed(4, g, h)]
    }
}

/// Places and weights of the Gauss rule of three points.
const THREE: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];

/// Local coordinate, and entry of a symmetric tensor, of the enhanced strains.
const MODES: [(usize, [usize; 2]); 9] = [
    (0, [0, 0]),
    (1, [1, 1]),
    (2, [2, 2]),
    (0, [0, 1]),
    (1, [0, 1]),
    (1, [1, 2]),
    (2, [1, 2]),
    (2, [2, 0]),
    (0, [2, 0]),
];

/// A square matrix by rows.
type Square<const N: usize> = [[f64; N]; N];

impl Stiffness<f64> {
    /// Of a hexahedron with these corners (m), whose rest shape is usable, and this material, already times the share.
    pub fn new(
        points: &[[f64; 3]; 8],
        LameParameters { lambda, mu }: LameParameters,
        filled: &Filled,
    ) -> Self {
        let mut all = [0.0; ENTRIES];
        if mu <= 0.0 {
            return Self(all);
        }
        let whole = Self::whole(points, lambda.min(mu), mu, filled);
        let mut kappa = [[0.0; 4]; 4];
        for g in 0..4 {
            for h in 0..4 {
                kappa[g][h] = (0..3).map(|i| whole[3 * g + i][3 * h + i]).sum::<f64>() / 3.0;
            }
        }
        let part = KEPT * removable_part(&whole, &kappa);
        let kappa = kappa.map(|row| row.map(|x| part * x));
        for i in 0..12 {
            for j in i..12 {
                let own = if i % 3 == j % 3 { kappa[i / 3][j / 3] } else { 0.0 };
                all[packed(12, i, j)] = whole[i][j] - own;
            }
        }
        for g in 0..4 {
            for h in g..4 {
                all[78 + packed(4, g, h)] = kappa[g][h];
            }
        }
        Self(all)
    }

    /// `K_h`, over 3x3x3 points.
    fn whole(points: &[[f64; 3]; 8], lambda: f64, mu: f64, filled: &Filled) -> Square<12> {
        let stress = |m: &[f64; 9]| {
            let mut stress = m.map(|x| 2.0 * mu * x);
            add_identity(&mut stress, lambda * (m[0] + m[4] + m[8]));
            stress
        };
        // gradients of h and the weights (m^3) of all points
        let mut at = Vec::with_capacity(27);
        let (mut mean, mut volume) = ([[0.0; 3]; 4], 0.0);
        for (local, weight) in rule(filled, points) {
            let (jacobian, d) = gradients(edges_at(local, points));
            let h = function_derivatives(local).map(|own| combined(own, &d));
            volume += weight * jacobian;
            for g in 0..4 {
                mean[g] = add(mean[g], scale(h[g], weight * jacobian));
            }
            at.push((local, weight, jacobian, h));
        }
        let mean = mean.map(|h| scale(h, 1.0 / volume));
        // the tensors of the enhanced strains in the middle, and moments of what multiplies them
        let (middle, d) = gradients(edges_at([0.0; 3], points));
        let tensors = MODES.map(|(_, [i, j])| {
            let mut m = [0.0; 9];
            add_outer(&mut m, d[i], d[j]);
            let other = transposed(&m);
            std::array::from_fn(|k| 0.5 * (m[k] + other[k]))
        });
        let stresses: [[f64; 9]; 9] = tensors.map(|m| stress(&m));
        let mut whole = [[0.0; 12]; 12];
        let (mut first, mut second) = ([[[0.0; 3]; 4]; 3], [[0.0; 3]; 3]);
        if !filled.is_even() {
            // the means of what multiplies them are taken away; those of the differences of gradients are none
            let mut sum = [0.0; 3];
            at.iter()
                .for_each(|(local, weight, ..)| sum = add(sum, scale(*local, weight * middle)));
            second = sum.map(|a| scale(sum, -a / volume));
        }
        for (local, weight, jacobian, h) in at {
            let h: [[f64; 3]; 4] = std::array::from_fn(|g| sub(h[g], mean[g]));
            for k in 0..3 {
                for g in 0..4 {
                    first[k][g] = add(first[k][g], scale(h[g], weight * middle * local[k]));
                }
                for l in 0..3 {
                    second[k][l] += weight * middle * middle / jacobian * local[k] * local[l];
                }
            }
            for g in 0..4 {
                for o in 0..4 {
                    let along = mu * dot(h[g], h[o]);
                    for i in 0..3 {
                        for j in 0..3 {
                            let own = if i == j { along } else { 0.0 };
                            whole[3 * g + i][3 * o + j] += weight
                                * jacobian
                                * (lambda * h[g][i] * h[o][j] + mu * h[g][j] * h[o][i] + own);
                        }
                    }
                }
            }
        }
        // definite for every stable material, since the strains are independent; otherwise they are left out
        let mut enhanced = [[0.0; 9]; 9];
        for p in 0..9 {
            for q in 0..9 {
                let product: f64 = stresses[p].iter().zip(&tensors[q]).map(|(s, m)| s * m).sum();
                enhanced[p][q] = product * second[MODES[p].0][MODES[q].0];
            }
        }
        let Some(factor) = cholesky(&enhanced) else { return whole };
        // L^-1 of the coupling, column by column
        let mut solved = [[0.0; 9]; 12];
        for g in 0..4 {
            for (p, (k, _)) in MODES.into_iter().enumerate() {
                let traction = mat_vec(&stresses[p], first[k][g]);
                for i in 0..3 {
                    let column = &mut solved[3 * g + i];
                    let known: f64 = (0..p).map(|q| factor[p][q] * column[q]).sum();
                    column[p] = (traction[i] - known) / factor[p][p];
                }
            }
        }
        for i in 0..12 {
            for j in 0..12 {
                whole[i][j] -= solved[i].iter().zip(&solved[j]).map(|(a, b)| a * b).sum::<f64>();
            }
        }
        whole
    }
}

/// Lower triangular `L` with `L L^T` the matrix; none where that is not definite.
fn cholesky<const N: usize>(matrix: &Square<N>) -> Option<Square<N>> {
    let mut factor = [[0.0; N]; N];
    for i in 0..N {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            let left = matrix[i][j] - known;
            if i > j {
                factor[i][j] = left / factor[j][j];
            } else if left > 0.0 {
                factor[i][i] = left.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(factor)
}

/// The least eigenvalue of `whole` against `mean x I`, to a thousandth from below: the largest `t` for which
/// `whole - t mean x I` is definite. It is not above 1, since `mean` is the mean over directions.
fn removable_part(whole: &Square<12>, mean: &Square<4>) -> f64 {
    let (mut least, mut step) = (0.0, 0.5);
    for _ in 0..11 {
        let mut left = *whole;
        for i in 0..12 {
            for j in (i % 3..12).step_by(3) {
                left[i][j] -= (least + step) * mean[i / 3][j / 3];
            }
        }
        if cholesky(&left).is_some() {
            least += step;
        }
        step *= 0.5;
    }
    least
}

/// Deformation of an element.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Modes<R> {
    /// Columns of `F - I`.
    pub affine: [[R; 3]; 3],
    /// The hourglass modes `q_g` (m).
    pub hourglass: [[R; 3]; 4],
}

impl<R: Real> Modes<R> {
    /// Of an element at rest.
    pub const NONE: Self = Self { affine: [[R::ZERO; 3]; 3], hourglass: [[R::ZERO; 3]; 4] };

    /// From the displacements (m) of the vertices.
    #[inline(always)]
    pub fn new(weights: &Weights<R>, u: &[[R; 3]; 8]) -> Self {
        let mut all = [[R::ZERO; 3]; 7];
        for a in 1..8 {
            // weights add up to nothing: a translation costs no digits
            let relative = sub(u[a], u[0]);
            for i in 0..7 {
                for x in 0..3 {
                    all[i][x] = weights[i][a].mul_add(relative[x], all[i][x]);
                }
            }
        }
        let [a, b, c, p, q, r, s] = all;
        Self { affine: [a, b, c], hourglass: [p, q, r, s] }
    }

    /// `F - I`, row-major.
    #[inline(always)]
    pub fn gradient(&self) -> [R; 9] {
        let [a, b, c] = self.affine;
        [a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]]
    }

    /// The same modes on an element that is not deformed otherwise: what a law sees that does not know rotations.
    #[inline(always)]
    pub fn hourglass_alone(self) -> Self {
        Self { affine: [[R::ZERO; 3]; 3], ..self }
    }

    /// `Z_g = F^T q_g` (m).
    #[inline(always)]
    fn carried(&self) -> [[R; 3]; 4] {
        let mut z = self.hourglass;
        for g in 0..4 {
            for i in 0..3 {
                z[g][i] += dot(self.affine[i], self.hourglass[g]);
            }
        }
        z
    }
}

/// `G_g` (N) of these `Z_g`.
#[inline(always)]
fn tractions<R: Real>(k: &Stiffness<R>, z: &[[R; 3]; 4]) -> [[R; 3]; 4] {
    let mut result = [[R::ZERO; 3]; 4];
    for i in 0..12 {
        for j in 0..12 {
            let own = &mut result[i / 3][i % 3];
            *own = k.turning(i, j).mul_add(z[j / 3][j % 3], *own);
        }
    }
    result
}

/// `sum_h kappa_gh q_h` (N).
#[inline(always)]
fn fixed_tractions<R: Real>(k: &Stiffness<R>, q: &[[R; 3]; 4]) -> [[R; 3]; 4] {
    let mut result = [[R::ZERO; 3]; 4];
    for g in 0..4 {
        for h in 0..4 {
            for x in 0..3 {
                result[g][x] = k.fixed(g, h).mul_add(q[h][x], result[g][x]);
            }
        }
    }
    result
}

/// Energy (J) of the hourglass modes.
#[inline(always)]
pub(crate) fn energy<R: Real>(k: &Stiffness<R>, modes: &Modes<R>) -> R {
    let (z, q) = (modes.carried(), modes.hourglass);
    let (turning, fixed) = (tractions(k, &z), fixed_tractions(k, &q));
    let mut sum = R::ZERO;
    for g in 0..4 {
        sum += dot(z[g], turning[g]) + dot(q[g], fixed[g]);
    }
    R::from_f64(0.5) * sum
}

/// Derivatives of that energy by the columns of `F` (J) and by the modes (N).
#[inline(always)]
pub(crate) fn slopes<R: Real>(k: &Stiffness<R>, modes: &Modes<R>) -> [[R; 3]; 7] {
    let q = modes.hourglass;
    let turning = tractions(k, &modes.carried());
    let fixed = fixed_tractions(k, &q);
    let mut slopes = [[R::ZERO; 3]; 7];
    for g in 0..4 {
        for x in 0..3 {
            slopes[3 + g][x] = turning[g][x] + fixed[g][x];
        }
        for i in 0..3 {
            for x in 0..3 {
                slopes[i][x] = q[g][x].mul_add(turning[g][i], slopes[i][x]);
                slopes[3 + g][x] = modes.affine[i][x].mul_add(turning[g][i], slopes[3 + g][x]);
            }
        }
    }
    slopes
}

/// Forces (N) on the vertices from the derivatives by columns and modes.
#[inline(always)]
pub(crate) fn forces<R: Real>(weights: &Weights<R>, slopes: &[[R; 3]; 7]) -> [[R; 3]; 8] {
    let mut forces = [[R::ZERO; 3]; 8];
    for a in 0..8 {
        for i in 0..7 {
            for x in 0..3 {
                forces[a][x] = (-weights[i][a]).mul_add(slopes[i][x], forces[a][x]);
            }
        }
    }
    forces
}

/// Second derivatives by columns and modes, `[I][J]`, each a 3x3 block.
pub(crate) type Blocks<R> = [[[R; 9]; 7]; 7];

/// Second derivatives of the whole energy; `inner` are those of that of the law by the columns of `F`. Without the term that
/// makes them indefinite where `exact` is not set.
#[inline(always)]
pub(crate) fn second_derivatives<R: Real>(
    k: &Stiffness<R>,
    modes: &Modes<R>,
    inner: &[[[R; 9]; 3]; 3],
    exact: bool,
) -> Blocks<R> {
    let f = rows(&deformation(&modes.gradient()));
    let q = modes.hourglass;
    let mut blocks = [[[R::ZERO; 9]; 7]; 7];
    for h in 0..4 {
        // K_gh F^T, row by row, of every g
        let mut carried = [[[R::ZERO; 3]; 3]; 4];
        for g in 0..4 {
            for i in 0..3 {
                for l in 0..3 {
                    let mut sum = R::ZERO;
                    for j in 0..3 {
                        sum = k.turning(3 * g + i, 3 * h + j).mul_add(f[l][j], sum);
                    }
                    carried[g][i][l] = sum;
                }
            }
        }
        for g in 0..=h {
            let block = &mut blocks[3 + g][3 + h];
            for x in 0..3 {
                for l in 0..3 {
                    let mut sum = R::ZERO;
                    for i in 0..3 {
                        sum = f[x][i].mul_add(carried[g][i][l], sum);
                    }
                    block[3 * x + l] = sum;
                }
            }
            add_identity(block, k.fixed(g, h));
        }
        for i in 0..3 {
            let block = &mut blocks[i][3 + h];
            for g in 0..4 {
                add_outer(block, q[g], carried[g][i]);
            }
        }
    }
    if exact {
        let turning = tractions(k, &modes.carried());
        for i in 0..3 {
            for h in 0..4 {
                add_identity(&mut blocks[i][3 + h], turning[h][i]);
            }
        }
    }
    for i in 0..3 {
        for j in i..3 {
            let block = &mut blocks[i][j];
            *block = inner[i][j];
            for g in 0..4 {
                let mut sum = [R::ZERO; 3];
                for h in 0..4 {
                    for l in 0..3 {
                        sum[l] = k.turning(3 * g + i, 3 * h + j).mul_add(q[h][l], sum[l]);
                    }
                }
                add_outer(block, q[g], sum);
            }
        }
    }
    for i in 0..7 {
        for j in 0..i {
            blocks[i][j] = transposed(&blocks[j][i]);
        }
    }
    blocks
}
