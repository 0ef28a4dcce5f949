//! Energy, forces and tangents of axes in a tetrahedron with linear shape functions: pure functions of the
//! four displacements.
//!
//! With the displacement gradient `G`, `F = I + G`, rest axes `a_i` (unit vectors), `h_i = G a_i`,
//! `p_i = a_i + h_i = F a_i`, `l_i = |p_i|`, `n_i = p_i/l_i`:
//!
//! ```text
//! e_i  = l_i - 1 = (2 a_i.h_i + |h_i|^2)/(l_i + 1)            stretch
//! m_ij = n_i.n_j - a_i.a_j                                    change of the cosine
//!      = (a_i.h_j + h_i.p_j - a_i.a_j (e_i + e_j + e_i e_j))/(l_i l_j)
//! W    = V (1/2 sum Y_i e_i^2 + 1/2 sum G_ij m_ij^2 + Lambda/2 (J-1)^2)           J
//! g_i  = (n_j - (n_i.n_j) n_i)/l_i                            derivative of the cosine by p_i
//! t_i  = V (Y_i e_i n_i + sum_j G_ij m_ij g_i)                derivative of W by p_i, J
//! f_b  = -(sum_i t_i (a_i.D_b) + V Lambda (J-1) cof F D_b)                        N
//! ```
//!
//! A chord of an axis through the barycentre, held by the faces of its element, is `L_i F a_i` under an
//! affine deformation, so the axial springs are those of Bourguignon & Cani 2000, section 2, with
//! `k = Y V/L^2`, whatever faces the axis meets: moduli in Pa make the result independent of the mesh. The
//! angular springs differ from the printed ones, which have no energy and a moment
//! (package `sinew-papers`); so does the volume term, which measures volume, not radii. With
//! three orthogonal axes, `Y = 2 mu`, `G = mu` and `Lambda = lambda` the tangent at rest is that of linear
//! elasticity.
//!
//! Tangents: `Exact` is the second derivative. `GaussNewton` keeps `Y n n^T`, `G g g^T` and
//! `Lambda (cof F D)(cof F D)^T`. `Projected` adds `Y (1 - 1/l)(I - n n^T)` where that is positive. The rest
//! of the angular part has a zero curvature along every `p_i` that it does not map to zero, hence an
//! eigenvalue of either sign, and so has `(J-1)` times the second derivative of `J`; both are left out.
//! The stand-ins are semidefinite.
//!
//! Chords shorter than 1e-6 of their rest length count as that long where they are divided by: everything
//! is finite in collapsed and inverted elements.

use sinew_engine::compression::COMPRESSED;
use sinew_engine::element::{displacement_gradient, volume_change};
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::{Real, add, cross, dot, mat_vec, scale, sub};

use crate::element::matrix::{
    add_identity, add_outer, add_skew, deformation, part_of_tension, transposed,
};
use crate::element::tetrahedron::{CORE, TetrahedronTangent, assemble, cofactor};

/// Pairs of the three axes, in the order of their angular moduli.
pub const AXIS_PAIRS: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];

/// What a law of axes needs of an element: one tetrahedron or a register full of them.
pub trait AxisElement<R: Real> {
    /// Energy (J).
    fn energy(&self, u: &[[R; 3]; 4]) -> R;
    /// Forces (N).
    fn forces(&self, u: &[[R; 3]; 4]) -> [[R; 3]; 4];
    /// Tangent `+d2W/du2` or a stand-in for it (N/m).
    fn tangent(&self, u: &[[R; 3]; 4], kind: TangentKind) -> TetrahedronTangent<R>;
    /// Where `Projected` leaves out a negative axial or active stiffness.
    fn is_clamped(&self, u: &[[R; 3]; 4]) -> R::Mask;
}

/// A deformed unit axis.
#[derive(Clone, Copy, Debug)]
struct Chord<R> {
    /// `F a`.
    deformed: [R; 3],
    /// Its direction.
    direction: [R; 3],
    /// `|F a| - 1`.
    stretch: R,
    /// `1/|F a|`.
    inverse: R,
}

impl<R: Real> Chord<R> {
    /// Of the axis `a` whose ends move by `h = G a` against each other.
    #[inline(always)]
    fn new(a: [R; 3], h: [R; 3]) -> Self {
        let deformed = add(a, h);
        let square = dot(deformed, deformed).max(R::from_f64(1e-12));
        let inverse = square.recip_sqrt();
        let change = dot(h, add(a, deformed));
        Self {
            deformed,
            direction: scale(deformed, inverse),
            stretch: change * square.mul_add(inverse, R::ONE).recip(),
            inverse,
        }
    }

    /// `along n n^T + across (I - n n^T)`.
    #[inline(always)]
    fn stiffness(&self, along: R, across: R) -> [R; 9] {
        let mut m = [R::ZERO; 9];
        add_outer(&mut m, scale(self.direction, along - across), self.direction);
        add_identity(&mut m, across);
        m
    }
}

/// Three axes, the angles between them and the term of volume. Moduli are multiplied by the rest volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triad<R> {
    /// Shape vectors `D_1`, `D_2`, `D_3` (1/m).
    pub gradients: [[R; 3]; 3],
    /// Unit vectors `a_i`.
    pub axes: [[R; 3]; 3],
    /// `V Y_i` (J).
    pub axial: [R; 3],
    /// `V G_ij` (J), in the order of [`AXIS_PAIRS`].
    pub angular: [R; 3],
    /// `V Lambda` (J).
    pub volumetric: R,
}

/// Change of the cosine of two axes and its derivatives.
#[derive(Clone, Copy, Debug)]
struct Angle<R> {
    cosine: R,
    change: R,
    /// By `F a_i` and `F a_j`.
    gradient: [[R; 3]; 2],
}

impl<R: Real> Triad<R> {
    #[inline(always)]
    fn chords(&self, g: &[R; 9]) -> ([[R; 3]; 3], [Chord<R>; 3]) {
        let [a, b, c] = self.axes;
        let h = [mat_vec(g, a), mat_vec(g, b), mat_vec(g, c)];
        (h, [Chord::new(a, h[0]), Chord::new(b, h[1]), Chord::new(c, h[2])])
    }

    /// `n_i.n_j - a_i.a_j` and the rest cosine.
    #[inline(always)]
    fn cosine_change(&self, h: &[[R; 3]; 3], chords: &[Chord<R>; 3], [i, j]: [usize; 2]) -> (R, R) {
        let rest = dot(self.axes[i], self.axes[j]);
        let (p, q) = (&chords[i], &chords[j]);
        let stretch = p.stretch.mul_add(q.stretch, p.stretch + q.stretch);
        let sum = dot(self.axes[i], h[j]) + dot(h[i], q.deformed) - rest * stretch;
        (sum * (p.inverse * q.inverse), rest)
    }

    #[inline(always)]
    fn angle(&self, h: &[[R; 3]; 3], chords: &[Chord<R>; 3], pair: [usize; 2]) -> Angle<R> {
        let (change, rest) = self.cosine_change(h, chords, pair);
        let cosine = rest + change;
        let (p, q) = (&chords[pair[0]], &chords[pair[1]]);
        let first = sub(q.direction, scale(p.direction, cosine));
        let second = sub(p.direction, scale(q.direction, cosine));
        let gradient = [scale(first, p.inverse), scale(second, q.inverse)];
        Angle { cosine, change, gradient }
    }
}

impl<R: Real> AxisElement<R> for Triad<R> {
    #[inline(always)]
    fn energy(&self, u: &[[R; 3]; 4]) -> R {
        let g = displacement_gradient(&self.gradients, u);
        let (h, chords) = self.chords(&g);
        let j = volume_change(&g);
        let mut sum = self.volumetric * (j * j);
        for i in 0..3 {
            let e = chords[i].stretch;
            sum = (self.axial[i] * e).mul_add(e, sum);
            let (m, _) = self.cosine_change(&h, &chords, AXIS_PAIRS[i]);
            sum = (self.angular[i] * m).mul_add(m, sum);
        }
        R::from_f64(0.5) * sum
    }

    #[inline(always)]
    fn forces(&self, u: &[[R; 3]; 4]) -> [[R; 3]; 4] {
        let g = displacement_gradient(&self.gradients, u);
        let (h, chords) = self.chords(&g);
        let mut tension = [[R::ZERO; 3]; 3];
        for i in 0..3 {
            tension[i] = scale(chords[i].direction, self.axial[i] * chords[i].stretch);
        }
        for k in 0..3 {
            let [i, j] = AXIS_PAIRS[k];
            let angle = self.angle(&h, &chords, [i, j]);
            let force = self.angular[k] * angle.change;
            tension[i] = add(tension[i], scale(angle.gradient[0], force));
            tension[j] = add(tension[j], scale(angle.gradient[1], force));
        }
        let mut p = volume_stress(self.volumetric, &g);
        for i in 0..3 {
            add_outer(&mut p, tension[i], self.axes[i]);
        }
        nodal_forces(&self.gradients, &p)
    }

    #[inline(always)]
    fn tangent(&self, u: &[[R; 3]; 4], kind: TangentKind) -> TetrahedronTangent<R> {
        let g = displacement_gradient(&self.gradients, u);
        let (h, chords) = self.chords(&g);
        // second derivatives by F a_i and F a_j
        let mut own = [[R::ZERO; 9]; 3];
        let mut mixed = [[R::ZERO; 9]; 3];
        for i in 0..3 {
            let Chord { stretch, inverse, .. } = chords[i];
            let across = self.axial[i] * part_of_tension(kind, stretch * inverse);
            own[i] = chords[i].stiffness(self.axial[i], across);
        }
        for k in 0..3 {
            let [i, j] = AXIS_PAIRS[k];
            let angle = self.angle(&h, &chords, [i, j]);
            let [gi, gj] = angle.gradient;
            add_outer(&mut own[i], scale(gi, self.angular[k]), gi);
            add_outer(&mut own[j], scale(gj, self.angular[k]), gj);
            add_outer(&mut mixed[k], scale(gi, self.angular[k]), gj);
            if kind == TangentKind::Exact {
                let force = self.angular[k] * angle.change;
                let (p, q) = (&chords[i], &chords[j]);
                add_cosine_curvature(&mut own[i], force, angle.cosine, p, q);
                add_cosine_curvature(&mut own[j], force, angle.cosine, q, p);
                let both = force * (p.inverse * q.inverse);
                add_identity(&mut mixed[k], both);
                let (n, m) = (p.direction, q.direction);
                add_outer(&mut mixed[k], scale(n, -both), n);
                add_outer(&mut mixed[k], scale(m, -both), m);
                add_outer(&mut mixed[k], scale(n, both * angle.cosine), m);
            }
        }
        let mut q = [[R::ZERO; 3]; 3];
        for a in 0..3 {
            for i in 0..3 {
                q[a][i] = dot(self.gradients[a], self.axes[i]);
            }
        }
        let mut core = [[R::ZERO; 9]; 6];
        for a in 0..3 {
            // rows of vertex a, columns of the axes
            let mut rows = own;
            for j in 0..3 {
                for x in 0..9 {
                    rows[j][x] = own[j][x] * q[a][j];
                }
            }
            for k in 0..3 {
                let [i, j] = AXIS_PAIRS[k];
                let turned = transposed(&mixed[k]);
                for x in 0..9 {
                    rows[j][x] = mixed[k][x].mul_add(q[a][i], rows[j][x]);
                    rows[i][x] = turned[x].mul_add(q[a][j], rows[i][x]);
                }
            }
            for (block, [c, d]) in core.iter_mut().zip(CORE) {
                if c != a {
                    continue;
                }
                for j in 0..3 {
                    for x in 0..9 {
                        block[x] = rows[j][x].mul_add(q[d][j], block[x]);
                    }
                }
            }
        }
        add_volume_stiffness(&mut core, &self.gradients, self.volumetric, &g, kind);
        assemble(&core)
    }

    #[inline(always)]
    fn is_clamped(&self, u: &[[R; 3]; 4]) -> R::Mask {
        let (_, chords) = self.chords(&displacement_gradient(&self.gradients, u));
        let mut least = R::ZERO;
        for i in 0..3 {
            least = least.min(self.axial[i] * chords[i].stretch);
        }
        R::less(least, R::ZERO)
    }
}

/// Adds `force` times the second derivative of the cosine of `p` and `q` by `p`.
#[inline(always)]
fn add_cosine_curvature<R: Real>(m: &mut [R; 9], force: R, cosine: R, p: &Chord<R>, q: &Chord<R>) {
    let factor = -(force * (p.inverse * p.inverse));
    let (n, other) = (p.direction, q.direction);
    add_outer(m, scale(n, factor), other);
    add_outer(m, scale(other, factor), n);
    add_identity(m, factor * cosine);
    add_outer(m, scale(n, R::from_f64(-3.0) * (factor * cosine)), n);
}

/// `h = G a` from the products `a.D_b` of the vertices 1, 2, 3.
#[inline(always)]
fn along<R: Real>(shape: &[R; 3], u: &[[R; 3]; 4]) -> [R; 3] {
    let mut h = [R::ZERO; 3];
    for b in 0..3 {
        h = add(h, scale(sub(u[b + 1], u[0]), shape[b]));
    }
    h
}

/// Forces of a fibre, `f_b = -t (a.D_b)`.
#[inline(always)]
fn pull<R: Real>(shape: &[R; 3], t: [R; 3]) -> [[R; 3]; 4] {
    let mut f = [[R::ZERO; 3]; 4];
    for b in 0..3 {
        f[b + 1] = scale(t, -shape[b]);
        f[0] = sub(f[0], f[b + 1]);
    }
    f
}

/// Tangent of a fibre from the derivative `m` of its pull by `F a`.
#[inline(always)]
fn spread<R: Real>(shape: &[R; 3], m: &[R; 9]) -> TetrahedronTangent<R> {
    let mut core = [[R::ZERO; 9]; 6];
    for (block, [a, b]) in core.iter_mut().zip(CORE) {
        let factor = shape[a] * shape[b];
        for x in 0..9 {
            block[x] = m[x] * factor;
        }
    }
    assemble(&core)
}

/// One fibre, passive and active. Moduli are multiplied by the rest volume.
///
/// ```text
/// W = V (Y/2 (l - r)^2 + T a Phi(l)),   Phi' = f_l = max(0, 1 - ((l - l_opt)/w)^2)
/// ```
///
/// so that the stress along the fibre (force over rest area, Pa) is `Y (l - r) + T a f_l(l)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fibre<R> {
    /// `a.D_b` of the vertices 1, 2, 3 (1/m).
    pub shape: [R; 3],
    /// Unit vector `a`.
    pub axis: [R; 3],
    /// `V Y` (J).
    pub stiffness: R,
    /// `1 - r`: by how much the rest length is shorter than the element's.
    pub shortening: R,
    /// `V T a` (J): peak active stress times activation.
    pub active: R,
    /// `1 - l_opt`.
    pub offset: R,
    /// `1/w`.
    pub inverse_width: R,
}

impl<R: Real> Fibre<R> {
    #[inline(always)]
    fn chord(&self, u: &[[R; 3]; 4]) -> Chord<R> {
        Chord::new(self.axis, along(&self.shape, u))
    }

    /// `(l - l_opt)/w`, held within -1 and 1.
    #[inline(always)]
    fn place(&self, stretch: R) -> R {
        ((stretch + self.offset) * self.inverse_width).max(-R::ONE).min(R::ONE)
    }

    /// `t = dW/dl` and its derivative (J).
    #[inline(always)]
    fn tension(&self, stretch: R) -> (R, R) {
        let x = self.place(stretch);
        let force = self.stiffness * (stretch + self.shortening);
        let slope = (x + x) * self.inverse_width;
        (
            (R::ONE - x * x).mul_add(self.active, force),
            // at the ends of the curve its slope jumps to 0
            self.stiffness - self.active * R::select(R::less(x.abs(), R::ONE), slope, R::ZERO),
        )
    }

    /// Stretch `|F a|`.
    #[inline(always)]
    pub fn length(&self, u: &[[R; 3]; 4]) -> R {
        R::ONE + self.chord(u).stretch
    }
}

impl<R: Real> AxisElement<R> for Fibre<R> {
    #[inline(always)]
    fn energy(&self, u: &[[R; 3]; 4]) -> R {
        let stretch = self.chord(u).stretch;
        let e = stretch + self.shortening;
        let (x, rest) = (self.place(stretch), self.place(R::ZERO));
        // w (x - x^3/3) against its value at rest
        let third = R::from_f64(1.0 / 3.0);
        let sum = R::ONE - third * (x * x + (x * rest + rest * rest));
        let phi = (x - rest) * sum * self.inverse_width.recip();
        // beyond the curve x is held and Phi constant
        (R::from_f64(0.5) * self.stiffness * e).mul_add(e, self.active * phi)
    }

    #[inline(always)]
    fn forces(&self, u: &[[R; 3]; 4]) -> [[R; 3]; 4] {
        let chord = self.chord(u);
        pull(&self.shape, scale(chord.direction, self.tension(chord.stretch).0))
    }

    #[inline(always)]
    fn tangent(&self, u: &[[R; 3]; 4], kind: TangentKind) -> TetrahedronTangent<R> {
        let chord = self.chord(u);
        let (force, slope) = self.tension(chord.stretch);
        let across = force * chord.inverse;
        let along = if kind == TangentKind::Exact { slope } else { slope.max(R::ZERO) };
        spread(&self.shape, &chord.stiffness(along, part_of_tension(kind, across)))
    }

    #[inline(always)]
    fn is_clamped(&self, u: &[[R; 3]; 4]) -> R::Mask {
        let (force, slope) = self.tension(self.chord(u).stretch);
        R::less(force.min(slope), R::ZERO)
    }
}

/// One biquadratic fibre. Its modulus is multiplied by the rest volume.
///
/// ```text
/// e   = a.E a = (|p|^2 - 1)/2 = (a.h + |h|^2/2)        strain along the fibre
/// W   = V Y/2 e^2
/// t   = V Y e p                                        derivative of W by p = F a
/// K_p = V Y (p p^T + e I)                              its derivative: (3 e + 1) along p, e across
/// ```
///
/// The tangent of the element is `K_p` times `(a.D_a) (a.D_b)`, so that it is projected exactly by clamping the two
/// eigenvalues. The pull `V Y e |p|` has a maximum in compression at `|p| = 1/sqrt(3)`, where `3 e + 1 = 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BiquadraticFibre<R> {
    /// `a.D_b` of the vertices 1, 2, 3 (1/m).
    pub shape: [R; 3],
    /// Unit vector `a`.
    pub axis: [R; 3],
    /// `V Y` (J).
    pub stiffness: R,
}

impl<R: Real> BiquadraticFibre<R> {
    /// `F a` and the strain.
    #[inline(always)]
    fn strain(&self, u: &[[R; 3]; 4]) -> ([R; 3], R) {
        let h = along(&self.shape, u);
        let deformed = add(self.axis, h);
        (deformed, R::from_f64(0.5) * dot(h, add(self.axis, deformed)))
    }

    /// Whether the stretch is below [`COMPRESSED`](sinew_engine::compression::COMPRESSED).
    #[inline(always)]
    pub(crate) fn is_pressed(&self, u: &[[R; 3]; 4]) -> R::Mask {
        let (_, e) = self.strain(u);
        R::less(e, R::from_f64(0.5 * (COMPRESSED * COMPRESSED - 1.0)))
    }

    /// `3 e + 1`.
    #[inline(always)]
    fn slope(strain: R) -> R {
        R::from_f64(3.0).mul_add(strain, R::ONE)
    }
}

impl<R: Real> AxisElement<R> for BiquadraticFibre<R> {
    #[inline(always)]
    fn energy(&self, u: &[[R; 3]; 4]) -> R {
        let (_, e) = self.strain(u);
        R::from_f64(0.5) * self.stiffness * (e * e)
    }

    #[inline(always)]
    fn forces(&self, u: &[[R; 3]; 4]) -> [[R; 3]; 4] {
        let (p, e) = self.strain(u);
        pull(&self.shape, scale(p, self.stiffness * e))
    }

    #[inline(always)]
    fn tangent(&self, u: &[[R; 3]; 4], kind: TangentKind) -> TetrahedronTangent<R> {
        let (p, e) = self.strain(u);
        let mut outer = self.stiffness;
        if kind == TangentKind::Projected {
            // where e < 0 all that is left lies along p: (3 e + 1) p p^T/|p|^2 with |p|^2 = 2 e + 1, at least 1/3 where
            // it is positive
            let square = (e + e + R::ONE).max(R::from_f64(1.0 / 3.0));
            let left = Self::slope(e).max(R::ZERO) * square.recip();
            outer *= R::select(R::less(e, R::ZERO), left, R::ONE);
        }
        let mut m = [R::ZERO; 9];
        add_outer(&mut m, scale(p, outer), p);
        add_identity(&mut m, self.stiffness * part_of_tension(kind, e));
        spread(&self.shape, &m)
    }

    #[inline(always)]
    fn is_clamped(&self, u: &[[R; 3]; 4]) -> R::Mask {
        let (_, e) = self.strain(u);
        R::less(self.stiffness * e, R::ZERO)
    }
}

/// The term of volume alone: `W = V Lambda/2 (J-1)^2`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeTerm<R> {
    /// Shape vectors `D_1`, `D_2`, `D_3` (1/m).
    pub gradients: [[R; 3]; 3],
    /// `V Lambda` (J).
    pub volumetric: R,
}

impl<R: Real> AxisElement<R> for VolumeTerm<R> {
    #[inline(always)]
    fn energy(&self, u: &[[R; 3]; 4]) -> R {
        let j = volume_change(&displacement_gradient(&self.gradients, u));
        R::from_f64(0.5) * self.volumetric * (j * j)
    }
    #[inline(always)]
    fn forces(&self, u: &[[R; 3]; 4]) -> [[R; 3]; 4] {
        let g = displacement_gradient(&self.gradients, u);
        nodal_forces(&self.gradients, &volume_stress(self.volumetric, &g))
    }
    #[inline(always)]
    fn tangent(&self, u: &[[R; 3]; 4], kind: TangentKind) -> TetrahedronTangent<R> {
        let g = displacement_gradient(&self.gradients, u);
        let mut core = [[R::ZERO; 9]; 6];
        add_volume_stiffness(&mut core, &self.gradients, self.volumetric, &g, kind);
        assemble(&core)
    }
    #[inline(always)]
    fn is_clamped(&self, _: &[[R; 3]; 4]) -> R::Mask {
        R::less(R::ONE, R::ZERO)
    }
}

/// `V Lambda (J-1) cof F` (J), row-major.
#[inline(always)]
fn volume_stress<R: Real>(volumetric: R, g: &[R; 9]) -> [R; 9] {
    let mut p = [R::ZERO; 9];
    // axes without the term do not pay for it
    if R::any(R::less(R::ZERO, volumetric)) {
        let pressure = volumetric * volume_change(g);
        let cof = cofactor(g);
        for x in 0..9 {
            p[x] = pressure * cof[x];
        }
    }
    p
}

/// `f_b = -P D_b`, `P` being multiplied by the volume.
#[inline(always)]
fn nodal_forces<R: Real>(gradients: &[[R; 3]; 3], p: &[R; 9]) -> [[R; 3]; 4] {
    let mut f = [[R::ZERO; 3]; 4];
    for b in 0..3 {
        f[b + 1] = scale(mat_vec(p, gradients[b]), -R::ONE);
        f[0] = sub(f[0], f[b + 1]);
    }
    f
}

#[inline(always)]
fn add_volume_stiffness<R: Real>(
    core: &mut [[R; 9]; 6],
    gradients: &[[R; 3]; 3],
    volumetric: R,
    g: &[R; 9],
    kind: TangentKind,
) {
    if !R::any(R::less(R::ZERO, volumetric)) {
        return;
    }
    let cof = cofactor(g);
    let normal =
        [mat_vec(&cof, gradients[0]), mat_vec(&cof, gradients[1]), mat_vec(&cof, gradients[2])];
    let pressure = volumetric * volume_change(g);
    let f = deformation(g);
    for (block, [a, b]) in core.iter_mut().zip(CORE) {
        add_outer(block, scale(normal[a], volumetric), normal[b]);
        if kind == TangentKind::Exact {
            // varying F by v (x) D_b turns cof F D_a by F (D_b x D_a) x v
            add_skew(block, scale(mat_vec(&f, cross(gradients[b], gradients[a])), pressure));
        }
    }
}
