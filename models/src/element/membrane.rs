//! Membranes: triangles in space that resist stretch in their plane and nothing else (no bending),
//! evaluated per element from nodal displacements.
//!
//! # Element
//!
//! With rest edges `E_1 = X_1 - X_0`, `E_2 = X_2 - X_0` (m), deformed edges `x_a = E_a + w_a`, rest area
//! `A` (m^2) and `d` the inverse of the Gram matrix `G_ab = E_a . E_b`, deformation enters through the
//! change of the Gram matrix, formed from displacements so that nothing cancels:
//!
//! ```text
//! c_ab = x_a . x_b - E_a . E_b = w_a . E_b + E_a . w_b + w_a . w_b         (m^2)
//! tr E = d^ab c_ab / 2,   E^ab = (d c d)^ab / 2                          Green-Lagrange strain
//! S^ab = lambda (tr E) d^ab + 2 mu E^ab                                  (N/m^3: stress by edge pair)
//! W    = A (lambda/2 (tr E)^2 + mu tr E^2) = A/4 S^ab c_ab                 (J)
//! f_a  = -A S^ab x_b   (a = 1, 2),   f_0 = -f_1 - f_2                      (N)
//! K_ab = A [ S^ab I + lambda y_a y_b^T + mu (d^ab F F^T + y_b y_a^T) ]     (N/m)
//! ```
//!
//! where `y_a = d^ab x_b` and `F F^T = d^ab x_a x_b^T`. The moduli are those of plane stress times the
//! thickness `t` ([`plane_stress`]), in N/m. `mu` is the shear modulus times `t`; Delingette 2008
//! (section 2.1) writes `mu` for twice of it.
//!
//! # Formulations
//!
//! | module | energy |
//! |---|---|
//! | [`biquadratic`] | the above: triangular biquadratic springs (TRBS, Delingette 2008, section 2), equal to St Venant-Kirchhoff in plane stress; [`SpringConstants`] gives it spring by spring |
//! | [`quadratic`] | triangular quadratic springs (TRQS): `2 L (l - L)` in place of the change of squared edge lengths. The factors printed in section 2.4 make it exactly twice too stiff; these agree with TRBS to second order |
//! | [`linear`] | constant-strain triangle: `x_b` in `f_a` replaced by `E_b`, `c` by its part of first order. Only displacements in the plane of the rest triangle count, so nothing at all resists motion out of it: hold that axis |
//! | [`corotational`] | linear in the stretch `U - I`, with `F = R U`: `W = A (lambda/2 tr^2 (U - I) + mu |U - I|^2)`, and forces that are its exact gradient |
//!
//! A mass-spring membrane is the tensile part of TRQS on edges alone, `k` of [`SpringConstants`] summed
//! over the triangles round an edge ([`crate::laws::quadratic::MassSpring`]); it is exact for equilateral
//! triangles with a Poisson's ratio of 1/3 only.
//!
//! # Compression term
//!
//! A membrane in space escapes compression by wrinkling, and its triangles have no inside: turned over
//! they are as good as before. So there is no inversion to prevent; what an energy in `c` alone lets
//! happen is that triangles shrink to a line. The optional term
//!
//! ```text
//! W_comp = A kappa/2 (J2 - 1)^4 for J2 < 1,   kappa = lambda + mu,   J2 = deformed over rest area
//! ```
//!
//! is not in the paper. It is the term of Delingette 2008, section 4, with the ratio of areas in place
//! of that of volumes: the force along an altitude is `-A/h [a s (s^2 - 1) + 2 kappa (s - 1)^3]`, `a =
//! (lambda + 2 mu)/2`, the same function of the altitude ratio `s` as for tetrahedra, and so monotone
//! down to `s = 0` for every `lambda, mu > 0`. Energy, force and tangent are three, two and one times
//! differentiable at `J2 = 1`; at `J2 = 0` energy and force are bounded. Since the normal is lost
//! there, `J2` is continued below 1e-3 by a parabola in `J2`, whose force ends at zero. It is off by
//! default: sheets that wrinkle need no such stiffness, and with it a sheet is stiffer in compression
//! than its material.
//!
//! # Definite tangents
//!
//! `GaussNewton` leaves out `S^ab I` (and, of the compression term, all but the square of the gradient
//! of `J2`). `Projected` keeps it with the compressive principal stresses set to zero: the stress and
//! not the edge tensions, because the latter depend on how a sheet is cut into triangles, and clamping
//! them would also weaken the direction in which a wrinkled sheet is taut.

use sinew_engine::element::minor;
pub use sinew_engine::law::TangentKind;
use sinew_engine::scalar::{Real, Scalar, add, cross, dot, mat_vec, scale, sub};
use thiserror::Error;

use crate::element::matrix::{
    add_identity, add_outer, dense, part_of_tension, symmetrise, transposed,
};
use crate::element::spring::Stretch;
use crate::material::LameParameters;

/// Moduli of plane stress times the thickness, N/m: `lambda = E t nu/(1 - nu^2)`, `mu = E t/(2 (1 +
/// nu))`, the latter the shear modulus. `stretch_modulus` is `E t` (N/m), -1 < `poisson_ratio` < 1.
///
/// ```
/// let moduli = sinew_models::element::membrane::plane_stress(300.0, 0.25);
/// assert_eq!((moduli.lambda, moduli.mu), (80.0, 120.0));
/// ```
pub fn plane_stress(stretch_modulus: f64, poisson_ratio: f64) -> LameParameters {
    LameParameters {
        lambda: stretch_modulus * poisson_ratio / (1.0 - poisson_ratio * poisson_ratio),
        mu: stretch_modulus / (2.0 * (1.0 + poisson_ratio)),
    }
}

/// Moduli of plane strain times the thickness, N/m: the Lamé parameters of the solid times `t`.
/// `stretch_modulus` is `E t` (N/m), -1 < `poisson_ratio` < 1/2.
///
/// ```
/// let moduli = sinew_models::element::membrane::plane_strain(300.0, 0.25);
/// assert_eq!((moduli.lambda, moduli.mu), (120.0, 120.0));
/// ```
pub fn plane_strain(stretch_modulus: f64, poisson_ratio: f64) -> LameParameters {
    let mu = stretch_modulus / (2.0 * (1.0 + poisson_ratio));
    LameParameters { lambda: 2.0 * mu * poisson_ratio / (1.0 - 2.0 * poisson_ratio), mu }
}

/// Smallest rest area accepted, as a part of the square of the longest edge.
pub const MIN_RELATIVE_AREA: f64 = 1e-10;

/// Why three points are no rest shape.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum RestTriangleError {
    /// A coordinate, or the area made from them, is infinite or not a number.
    #[error("local vertex {vertex} has rest position {point:?}: give finite coordinates in metres")]
    NonFinite {
        /// Local index of the vertex.
        vertex: usize,
        /// Its rest position, m.
        point: [f64; 3],
    },
    /// The vertices lie on a line or in a point.
    #[error(
        "rest area is {area:e} m^2 with a longest edge of {longest_edge:e} m: the triangle is \
         degenerate; remove it or remesh"
    )]
    Degenerate {
        /// Area, m^2.
        area: f64,
        /// Length of the longest edge, m.
        longest_edge: f64,
    },
}

/// Edges and area of an undeformed triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestTriangle {
    /// `X_1 - X_0` and `X_2 - X_0`, m.
    pub edges: [[f64; 3]; 2],
    /// Area, m^2; positive.
    pub area: f64,
}

impl RestTriangle {
    /// Edges and area of the triangle with these rest positions (m), of any winding.
    ///
    /// # Errors
    /// When a coordinate is not finite or the points lie on a line to within [`MIN_RELATIVE_AREA`].
    pub fn new(points: [[f64; 3]; 3]) -> Result<Self, RestTriangleError> {
        for vertex in 0..3 {
            if points[vertex].iter().any(|x| !x.is_finite()) {
                return Err(RestTriangleError::NonFinite { vertex, point: points[vertex] });
            }
        }
        let edges = [sub(points[1], points[0]), sub(points[2], points[0])];
        let normal = cross(edges[0], edges[1]);
        let area = 0.5 * dot(normal, normal).sqrt();
        let third = sub(edges[1], edges[0]);
        let longest2 =
            [edges[0], edges[1], third].map(|e| dot(e, e)).into_iter().fold(0.0, f64::max);
        if !(area > MIN_RELATIVE_AREA * longest2 && area.is_finite()) {
            return Err(RestTriangleError::Degenerate { area, longest_edge: longest2.sqrt() });
        }
        Ok(Self { edges, area })
    }

    /// The part of a direction in the plane of the triangle, made a unit vector; `None` where there is none to speak of: it
    /// is within 1e-6 of the normal.
    pub fn in_plane(&self, direction: [f64; 3]) -> Option<[f64; 3]> {
        let [a, b] = self.edges;
        let normal = scale(cross(a, b), 0.5 / self.area);
        let part = sub(direction, scale(normal, dot(normal, direction)));
        let square = dot(part, part);
        (square > 1e-12 * dot(direction, direction) && square.is_finite())
            .then(|| scale(part, 1.0 / square.sqrt()))
    }

    /// Products (1/m) of a vector with the gradients of the barycentric coordinates in the plane.
    pub fn along(&self, vector: [f64; 3]) -> [f64; 3] {
        let [a, b] = self.edges;
        let (aa, ab, bb) = (dot(a, a), dot(a, b), dot(b, b));
        let (va, vb) = (dot(vector, a), dot(vector, b));
        let unit = 1.0 / (4.0 * self.area * self.area);
        let (first, second) = ((bb * va - ab * vb) * unit, (aa * vb - ab * va) * unit);
        [-(first + second), first, second]
    }
}

/// Stiffnesses of the biquadratic springs of one triangle, N/m^3; edge `i` lies opposite vertex `i`.
///
/// With `cot_i` at vertex `i` (Delingette 2008, section 2.3, in our `mu`, half of the paper's):
///
/// ```text
/// W   = sum_3 k_i/4 delta_i^2 + sum_3 c_m/2 delta_i delta_j      (each pair once; m the third index)
/// k_i = (cot_i^2 (lambda + 2 mu) + mu)/(8 A),   c_m = (cot_i cot_j (lambda + 2 mu) - mu)/(8 A)
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpringConstants {
    /// `k` per edge; positive.
    pub tensile: [f64; 3],
    /// `c` per vertex, between the two edges that meet there.
    pub angular: [f64; 3],
}

impl SpringConstants {
    /// The constants with which the springs carry exactly the plane-stress St Venant-Kirchhoff energy.
    pub fn new(rest: &RestTriangle, moduli: LameParameters) -> Self {
        let LameParameters { lambda, mu } = moduli;
        let [a, b] = rest.edges;
        let c = sub(b, a);
        let cot = [dot(a, b), -dot(a, c), dot(b, c)].map(|x| x / (2.0 * rest.area));
        let unit = 1.0 / (8.0 * rest.area);
        let tensile = cot.map(|x| (x * x * (lambda + 2.0 * mu) + mu) * unit);
        let pair = |i: usize, j: usize| (cot[i] * cot[j] * (lambda + 2.0 * mu) - mu) * unit;
        Self { tensile, angular: [pair(1, 2), pair(2, 0), pair(0, 1)] }
    }

    /// Adds the springs of fibres along the unit vector `axis` in the plane with the modulus times thickness `modulus`
    /// (N/m): energy `A Y/2 (a.E a)^2`, `k_i = A/2 Y s_i^2` and `c_m = A/2 Y s_i s_j` with `s_i` the product of `a.D` at
    /// the ends of edge `i`, as in [tetrahedra](crate::element::precompute).
    pub fn add_fibre(&mut self, rest: &RestTriangle, axis: [f64; 3], modulus: f64) {
        let q = rest.along(axis);
        let s = [q[1] * q[2], q[2] * q[0], q[0] * q[1]];
        let unit = 0.5 * rest.area * modulus;
        for m in 0..3 {
            self.tensile[m] += unit * s[m] * s[m];
            self.angular[m] += unit * s[(m + 1) % 3] * s[(m + 2) % 3];
        }
    }
}

/// Constants of one membrane triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element<S> {
    /// Rest edges `X_1 - X_0` and `X_2 - X_0`, m.
    pub edges: [[S; 3]; 2],
    /// Rest area, m^2.
    pub area: S,
    /// First modulus `lambda` of plane stress times thickness, N/m.
    pub lambda: S,
    /// Shear modulus times thickness, N/m.
    pub mu: S,
    /// Modulus `kappa` of the compression term, N/m: `lambda + mu`, or 0 to leave the term out. Only
    /// [`biquadratic`] has it.
    pub compression: S,
}

impl<S: Scalar> Element<S> {
    /// Element with the given rest shape and moduli (N/m), with or without the compression term.
    pub fn new(rest: &RestTriangle, moduli: LameParameters, compression: bool) -> Self {
        let kappa = if compression { moduli.lambda + moduli.mu } else { 0.0 };
        Self {
            edges: rest.edges.map(|e| e.map(S::from_f64)),
            area: S::from_f64(rest.area),
            lambda: S::from_f64(moduli.lambda),
            mu: S::from_f64(moduli.mu),
            compression: S::from_f64(kappa),
        }
    }
}

/// Vectors of the three vertices, displacements (m) or forces (N).
pub type Nodes<R> = [[R; 3]; 3];

/// Symmetric 9x9 element matrix (N/m) as 3x3 blocks, each row-major.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleTangent<S> {
    /// Blocks of a local vertex with itself; symmetric.
    pub diagonal: [[S; 9]; 3],
    /// Block `i` belongs to the edge opposite vertex `i`: its rows to the lower of the two local
    /// vertices, its columns to the higher.
    pub off: [[S; 9]; 3],
}

impl<S: Real> TriangleTangent<S> {
    /// Block with the rows of local vertex `a` and the columns of `b`, row-major.
    #[inline(always)]
    pub fn block(&self, a: usize, b: usize) -> [S; 9] {
        if a == b {
            return self.diagonal[a];
        }
        let m = self.off[3 - a - b];
        if a < b { m } else { transposed(&m) }
    }

    /// Product `K v` (N when `v` is in m).
    #[inline(always)]
    pub fn product(&self, v: &[[S; 3]; 3]) -> [[S; 3]; 3] {
        let mut result = [[S::ZERO; 3]; 3];
        for a in 0..3 {
            for b in 0..3 {
                result[a] = add(result[a], mat_vec(&self.block(a, b), v[b]));
            }
        }
        result
    }

    /// All 81 entries; row and column `3 vertex + axis`.
    pub fn to_dense(&self) -> [[S; 9]; 9] {
        dense::<S, 3, 9>(|a, b| self.block(a, b))
    }
}

/// Symmetric tensor by edge pair: entries 11, 22, 12.
type Pairs<R> = [R; 3];

/// `d`, the inverse of the rest Gram matrix, 1/m^2.
#[inline(always)]
fn dual<R: Real>(e: &Element<R>) -> Pairs<R> {
    let [a, b] = e.edges;
    let p = inverse_determinant(e);
    [dot(b, b) * p, dot(a, a) * p, -(dot(a, b) * p)]
}

/// `1/(4 A^2)`, one over the determinant of the rest Gram matrix (1/m^4).
#[inline(always)]
fn inverse_determinant<R: Real>(e: &Element<R>) -> R {
    let inverse = (e.area + e.area).recip();
    inverse * inverse
}

/// Displacements of vertices 1 and 2 relative to vertex 0.
#[inline(always)]
fn relative<R: Real>(u: &Nodes<R>) -> [[R; 3]; 2] {
    [sub(u[1], u[0]), sub(u[2], u[0])]
}

/// Deformed edges `x_1`, `x_2`, m.
#[inline(always)]
fn deformed<R: Real>(e: &Element<R>, w: &[[R; 3]; 2]) -> [[R; 3]; 2] {
    [add(e.edges[0], w[0]), add(e.edges[1], w[1])]
}

/// Change `c` of the Gram matrix, m^2; `x` the deformed edges.
#[inline(always)]
fn gram_change<R: Real>(e: &Element<R>, w: &[[R; 3]; 2], x: &[[R; 3]; 2]) -> Pairs<R> {
    let [a, b] = e.edges;
    [dot(w[0], add(a, x[0])), dot(w[1], add(b, x[1])), dot(w[0], b) + dot(x[0], w[1])]
}

/// `S` of a change `c`, N/m^3.
#[inline(always)]
fn stress<R: Real>(e: &Element<R>, d: &Pairs<R>, c: &Pairs<R>) -> Pairs<R> {
    let (dcd, trace) = raised(d, c);
    let pressure = R::from_f64(0.5) * e.lambda * trace;
    [
        pressure.mul_add(d[0], e.mu * dcd[0]),
        pressure.mul_add(d[1], e.mu * dcd[1]),
        pressure.mul_add(d[2], e.mu * dcd[2]),
    ]
}

/// `d c d` and the trace of `d c`.
#[inline(always)]
fn raised<R: Real>(d: &Pairs<R>, c: &Pairs<R>) -> (Pairs<R>, R) {
    let m11 = d[0].mul_add(c[0], d[2] * c[2]);
    let m12 = d[0].mul_add(c[2], d[2] * c[1]);
    let m21 = d[2].mul_add(c[0], d[1] * c[2]);
    let m22 = d[2].mul_add(c[2], d[1] * c[1]);
    let dcd = [
        m11.mul_add(d[0], m12 * d[2]),
        m22.mul_add(d[1], m21 * d[2]),
        m11.mul_add(d[2], m12 * d[1]),
    ];
    (dcd, m11 + m22)
}

/// `A/4 S^ab c_ab`, J.
#[inline(always)]
fn elastic_energy<R: Real>(e: &Element<R>, s: &Pairs<R>, c: &Pairs<R>) -> R {
    let sum = s[0].mul_add(c[0], s[1].mul_add(c[1], (s[2] + s[2]) * c[2]));
    R::from_f64(0.25) * e.area * sum
}

/// `f_a = -A S^ab x_b`.
#[inline(always)]
fn nodal_forces<R: Real>(e: &Element<R>, s: &Pairs<R>, x: &[[R; 3]; 2]) -> Nodes<R> {
    let (s11, s22, s12) = (-(e.area * s[0]), -(e.area * s[1]), -(e.area * s[2]));
    let mut f = [[R::ZERO; 3]; 3];
    for i in 0..3 {
        f[1][i] = s11.mul_add(x[0][i], s12 * x[1][i]);
        f[2][i] = s12.mul_add(x[0][i], s22 * x[1][i]);
        f[0][i] = -(f[1][i] + f[2][i]);
    }
    f
}

/// Adds `a (lambda y_a y_b^T + mu (d^ab F F^T + y_b y_a^T))` to the blocks 11, 22, 12.
#[inline(always)]
fn add_material<R: Real>(core: &mut [[R; 9]; 3], e: &Element<R>, d: &Pairs<R>, x: &[[R; 3]; 2]) {
    let (lambda, mu) = (e.lambda * e.area, e.mu * e.area);
    let y = [add(scale(x[0], d[0]), scale(x[1], d[2])), add(scale(x[0], d[2]), scale(x[1], d[1]))];
    let mut left = [R::ZERO; 9];
    add_outer(&mut left, x[0], y[0]);
    add_outer(&mut left, x[1], y[1]);
    for (block, (a, b, dual)) in core.iter_mut().zip([(0, 0, d[0]), (1, 1, d[1]), (0, 1, d[2])]) {
        add_outer(block, scale(y[a], lambda), y[b]);
        add_outer(block, scale(y[b], mu), y[a]);
        for k in 0..9 {
            block[k] = (mu * dual).mul_add(left[k], block[k]);
        }
    }
}

/// Adds `A S^ab I` to the blocks.
#[inline(always)]
fn add_geometric<R: Real>(core: &mut [[R; 9]; 3], e: &Element<R>, s: &Pairs<R>) {
    for k in 0..3 {
        add_identity(&mut core[k], e.area * s[k]);
    }
}

/// Principal stresses (N/m), larger first.
#[inline(always)]
fn principal_stresses<R: Real>(e: &Element<R>, s: &Pairs<R>) -> [R; 2] {
    let [a, b] = e.edges;
    let half = R::from_f64(0.5);
    // eigenvalues of the mixed tensor S^ac G_cb
    let (ab, two) = (dot(a, b), s[2] + s[2]);
    let mean = half * s[0].mul_add(dot(a, a), s[1].mul_add(dot(b, b), two * ab));
    let determinant = minor(s[0], s[1], s[2], s[2]) * (R::from_f64(4.0) * e.area * e.area);
    let radius = (mean * mean - determinant).max(R::ZERO).sqrt();
    [mean + radius, mean - radius]
}

/// `S` with its compressive principal stresses set to zero, and where there were any.
#[inline(always)]
fn tensile_part<R: Real>(e: &Element<R>, d: &Pairs<R>, s: &Pairs<R>) -> (R::Mask, Pairs<R>) {
    let [high, low] = principal_stresses(e, s);
    let clamped = R::less(low, R::ZERO);
    let slack = R::less(high, R::ZERO);
    // one tensile: S+ = high (S - low I)/(high - low); I has the components d
    let spread = R::select(R::less(low, high), high - low, R::ONE);
    let factor = high.max(R::ZERO) / spread;
    let mut tensile = *s;
    for k in 0..3 {
        let one = factor * (s[k] - low * d[k]);
        tensile[k] = R::select(clamped, R::select(slack, R::ZERO, one), s[k]);
    }
    (clamped, tensile)
}

/// Whole matrix from the blocks 11, 22, 12: rigid translations cost nothing.
#[inline(always)]
fn assemble<R: Real>([k11, k22, k12]: &[[R; 9]; 3]) -> TriangleTangent<R> {
    let half = R::from_f64(0.5);
    let (mut k01, mut k02, mut k00) = ([R::ZERO; 9], [R::ZERO; 9], [R::ZERO; 9]);
    for i in 0..3 {
        for j in 0..3 {
            let (x, t) = (3 * i + j, 3 * j + i);
            k01[x] = -(k11[x] + k12[t]);
            k02[x] = -(k12[x] + k22[x]);
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            let (x, t) = (3 * i + j, 3 * j + i);
            k00[x] = -(half * ((k01[x] + k01[t]) + (k02[x] + k02[t])));
        }
    }
    let mut tangent = TriangleTangent { diagonal: [k00, *k11, *k22], off: [*k12, k02, k01] };
    for block in &mut tangent.diagonal {
        symmetrise(block);
    }
    tangent
}

/// Ratio of deformed to rest area; zero when shrunk to a line or a point, never negative.
#[inline(always)]
pub fn area_ratio<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
    sinew_engine::element::area_ratio(&e.edges, e.area, u)
}

/// Area ratio from the change of the Gram matrix, continued where it vanishes.
struct Compressed<R: Real> {
    /// `min(J2 - 1, 0)`.
    m: R,
    /// One over `J2`, bounded.
    inverse: R,
    /// `J2` is small enough to be continued.
    flat: R::Mask,
}

/// `J2` below which it is continued by a parabola.
const FLAT: f64 = 1e-3;

#[inline(always)]
fn compressed<R: Real>(e: &Element<R>, d: &Pairs<R>, c: &Pairs<R>) -> Compressed<R> {
    let trace = d[0].mul_add(c[0], d[1].mul_add(c[1], (d[2] + d[2]) * c[2]));
    let change = inverse_determinant(e).mul_add(minor(c[0], c[1], c[2], c[2]), trace);
    let square = (R::ONE + change).max(R::ZERO);
    let ratio = square.sqrt();
    let flat = R::less(ratio, R::from_f64(FLAT));
    let inverse = ratio.max(R::from_f64(FLAT)).recip();
    // near 1 without cancellation; when flat, J2 = (J2^2/f + f)/2
    let m = change * (ratio + R::ONE).recip();
    let parabola = square.mul_add(R::from_f64(0.5 / FLAT), R::from_f64(0.5 * FLAT - 1.0));
    Compressed { m: R::select(flat, parabola, m).min(R::ZERO), inverse, flat }
}

/// Biquadratic springs (TRBS): St Venant-Kirchhoff in plane stress, with the compression term where
/// [`Element::compression`] is not 0.
pub mod biquadratic {
    use super::*;

    /// Energy, J.
    #[inline(always)]
    pub fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        let (w, d) = (relative(u), dual(e));
        let c = gram_change(e, &w, &deformed(e, &w));
        let elastic = elastic_energy(e, &stress(e, &d, &c), &c);
        if !R::any(R::less(R::ZERO, e.compression)) {
            return elastic;
        }
        let m = compressed(e, &d, &c).m;
        let m2 = m * m;
        (R::from_f64(0.5) * e.area * e.compression * m2).mul_add(m2, elastic)
    }

    /// Forces on the three vertices, N.
    #[inline(always)]
    pub fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Nodes<R> {
        let (w, d) = (relative(u), dual(e));
        let x = deformed(e, &w);
        let c = gram_change(e, &w, &x);
        let mut s = stress(e, &d, &c);
        if R::any(R::less(R::ZERO, e.compression)) {
            let Compressed { m, inverse, .. } = compressed(e, &d, &c);
            let p1 = (e.compression + e.compression) * (m * m * m) * inverse;
            let q = adjugate(e, &x);
            for k in 0..3 {
                s[k] = p1.mul_add(q[k], s[k]);
            }
        }
        nodal_forces(e, &s, &x)
    }

    /// Derivative of `J2^2` by the Gram matrix, 1/m^2.
    #[inline(always)]
    fn adjugate<R: Real>(e: &Element<R>, x: &[[R; 3]; 2]) -> Pairs<R> {
        let p = inverse_determinant(e);
        [dot(x[1], x[1]) * p, dot(x[0], x[0]) * p, -(dot(x[0], x[1]) * p)]
    }

    /// Where the projected tangent differs from the exact one.
    #[inline(always)]
    pub fn is_clamped<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R::Mask {
        let (w, d) = (relative(u), dual(e));
        let c = gram_change(e, &w, &deformed(e, &w));
        let low = principal_stresses(e, &stress(e, &d, &c))[1];
        let compression = compressed(e, &d, &c).m * e.compression;
        R::either(R::less(low, R::ZERO), R::less(compression, R::ZERO))
    }

    /// Tangent `+d2W/du2`, N/m, or a semidefinite stand-in.
    #[inline(always)]
    pub fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TriangleTangent<R> {
        let (w, d) = (relative(u), dual(e));
        let x = deformed(e, &w);
        let c = gram_change(e, &w, &x);
        let s = stress(e, &d, &c);
        let mut core = [[R::ZERO; 9]; 3];
        add_material(&mut core, e, &d, &x);
        match kind {
            TangentKind::Exact => add_geometric(&mut core, e, &s),
            TangentKind::GaussNewton => {}
            TangentKind::Projected => add_geometric(&mut core, e, &tensile_part(e, &d, &s).1),
        }
        if R::any(R::less(R::ZERO, e.compression)) {
            add_compression(&mut core, e, &x, &compressed(e, &d, &c), kind == TangentKind::Exact);
        }
        assemble(&core)
    }

    /// The compression term's part: `A [p2 g_a g_b^T + p1 d2J2]`, or the first of them alone, with `g_a =
    /// q^ac x_c / J2` the gradient of `J2`.
    #[inline(always)]
    fn add_compression<R: Real>(
        core: &mut [[R; 9]; 3],
        e: &Element<R>,
        x: &[[R; 3]; 2],
        state: &Compressed<R>,
        exact: bool,
    ) {
        let Compressed { m, inverse, flat } = *state;
        let q = adjugate(e, x);
        let g = [
            add(scale(x[0], q[0] * inverse), scale(x[1], q[2] * inverse)),
            add(scale(x[0], q[2] * inverse), scale(x[1], q[1] * inverse)),
        ];
        let kappa = e.compression * e.area;
        let mut p2 = R::from_f64(6.0) * kappa * (m * m);
        let p1 = (kappa + kappa) * (m * m * m) * inverse;
        if exact {
            // the second derivative of the square root
            p2 -= R::select(flat, R::ZERO, p1);
        }
        for (block, (a, b)) in core.iter_mut().zip([(0, 0), (1, 1), (0, 1)]) {
            add_outer(block, scale(g[a], p2), g[b]);
        }
        if exact {
            for k in 0..3 {
                add_identity(&mut core[k], p1 * q[k]);
            }
            let p = p1 * inverse_determinant(e);
            add_outer(&mut core[0], scale(x[1], -p), x[1]);
            add_outer(&mut core[1], scale(x[0], -p), x[0]);
            add_outer(&mut core[2], scale(x[0], p + p), x[1]);
            add_outer(&mut core[2], scale(x[1], -p), x[0]);
        }
    }

    /// Product `K v` (N when `v` is in m) of the exact or the Gauss-Newton tangent without forming it:
    /// `(K v)_a = A (dS^ab x_b + S^ab v_b)`. The compression term is formed.
    #[inline(always)]
    pub fn product<R: Real>(e: &Element<R>, u: &Nodes<R>, v: &Nodes<R>, exact: bool) -> Nodes<R> {
        if R::any(R::less(R::ZERO, e.compression)) {
            let kind = if exact { TangentKind::Exact } else { TangentKind::GaussNewton };
            return tangent(e, u, kind).product(v);
        }
        let (w, d) = (relative(u), dual(e));
        let x = deformed(e, &w);
        let v = relative(v);
        let two = R::from_f64(2.0);
        let rate =
            [two * dot(x[0], v[0]), two * dot(x[1], v[1]), dot(x[0], v[1]) + dot(v[0], x[1])];
        let mut product = nodal_forces(e, &stress(e, &d, &rate), &x);
        if exact {
            let s = stress(e, &d, &gram_change(e, &w, &x));
            let geometric = nodal_forces(e, &s, &v);
            for a in 0..3 {
                product[a] = add(product[a], geometric[a]);
            }
        }
        for row in &mut product {
            *row = [-row[0], -row[1], -row[2]];
        }
        product
    }
}

/// Constant-strain triangle in the plane of its rest shape; see the table above for what it leaves out.
pub mod linear {
    use super::*;

    /// First-order part of the change of the Gram matrix.
    #[inline(always)]
    fn change<R: Real>(e: &Element<R>, w: &[[R; 3]; 2]) -> Pairs<R> {
        let ([a, b], two) = (e.edges, R::from_f64(2.0));
        [two * dot(w[0], a), two * dot(w[1], b), dot(w[0], b) + dot(w[1], a)]
    }

    /// Energy, J.
    #[inline(always)]
    pub fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        let c = change(e, &relative(u));
        elastic_energy(e, &stress(e, &dual(e), &c), &c)
    }

    /// Forces on the three vertices, N.
    #[inline(always)]
    pub fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Nodes<R> {
        nodal_forces(e, &stress(e, &dual(e), &change(e, &relative(u))), &e.edges)
    }

    /// Tangent, N/m: constant and semidefinite.
    #[inline(always)]
    pub fn tangent<R: Real>(e: &Element<R>) -> TriangleTangent<R> {
        let mut core = [[R::ZERO; 9]; 3];
        add_material(&mut core, e, &dual(e), &e.edges);
        assemble(&core)
    }
}

/// Quadratic springs (TRQS). Edges shorter than 1e-6 of their rest length count as that long where
/// they are divided by ([`Stretch`]).
pub mod quadratic {
    use super::*;

    /// Edges 01, 02 and 12, each pointing to its higher vertex.
    #[inline(always)]
    fn stretches<R: Real>(e: &Element<R>, u: &Nodes<R>) -> [Stretch<R>; 3] {
        let ([a, b], w) = (e.edges, relative(u));
        [Stretch::new(a, w[0]), Stretch::new(b, w[1]), Stretch::new(sub(b, a), sub(w[1], w[0]))]
    }

    /// What takes the place of the change of the Gram matrix.
    #[inline(always)]
    fn change<R: Real>(edges: &[Stretch<R>; 3]) -> Pairs<R> {
        let [a, b, c] = [edges[0].change, edges[1].change, edges[2].change];
        [a, b, R::from_f64(0.5) * (a + b - c)]
    }

    /// Tensions `s = B change` of the edges 01, 02 and 12, N/m.
    #[inline(always)]
    fn tensions<R: Real>(e: &Element<R>, s: &Pairs<R>) -> [R; 3] {
        let half = R::from_f64(0.5) * e.area;
        [half * (s[0] + s[2]), half * (s[1] + s[2]), -(half * s[2])]
    }

    /// Energy, J.
    #[inline(always)]
    pub fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        let c = change(&stretches(e, u));
        elastic_energy(e, &stress(e, &dual(e), &c), &c)
    }

    /// Forces on the three vertices, N.
    #[inline(always)]
    pub fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Nodes<R> {
        let edges = stretches(e, u);
        let s = tensions(e, &stress(e, &dual(e), &change(&edges)));
        let mut pull = [[R::ZERO; 3]; 3];
        for i in 0..3 {
            pull[i] = scale(edges[i].edge, edges[i].slope * s[i]);
        }
        let [a, b, c] = pull;
        let mut f = [add(a, b), sub(c, a), [R::ZERO; 3]];
        for x in 0..3 {
            f[2][x] = -(b[x] + c[x]);
        }
        f
    }

    /// Where an edge is in compression: there the exact tangent may be indefinite, and the projected
    /// one, which leaves out the tensions of such edges, differs from it.
    #[inline(always)]
    pub fn is_clamped<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R::Mask {
        let s = tensions(e, &stress(e, &dual(e), &change(&stretches(e, u))));
        R::less(s[0].min(s[1]).min(s[2]), R::ZERO)
    }

    /// Tangent `+d2W/du2`, N/m, or a semidefinite stand-in. Quadratic springs know edges, not
    /// stresses, so it is the tensions of compressed edges that `Projected` leaves out.
    #[inline(always)]
    pub fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TriangleTangent<R> {
        let (edges, d) = (stretches(e, u), dual(e));
        let s = tensions(e, &stress(e, &d, &change(&edges)));
        let half = R::from_f64(0.5);
        let unit = [[R::ONE, R::ZERO, half], [R::ZERO, R::ONE, half], [R::ZERO, R::ZERO, -half]];
        let mut b = [[R::ZERO; 3]; 3];
        let mut z = [[R::ZERO; 3]; 3];
        let mut geometric = [[R::ZERO; 9]; 3];
        for i in 0..3 {
            b[i] = tensions(e, &stress(e, &d, &unit[i]));
            z[i] = scale(edges[i].edge, edges[i].slope);
            let tension = part_of_tension(kind, s[i]);
            edges[i].add_geometric(&mut geometric[i], edges[i].slope * tension);
        }
        let [a, c, t] = z;
        // products of the vertices 1 and 2 with every edge
        let mut core = [geometric[0], geometric[1], [R::ZERO; 9]];
        for k in 0..9 {
            core[0][k] += geometric[2][k];
            core[1][k] += geometric[2][k];
            core[2][k] = -geometric[2][k];
        }
        let mut at_1 = [[R::ZERO; 3]; 3];
        let mut at_2 = [[R::ZERO; 3]; 3];
        for j in 0..3 {
            at_1[j] = sub(scale(a, b[0][j]), scale(t, b[2][j]));
            at_2[j] = add(scale(c, b[1][j]), scale(t, b[2][j]));
        }
        add_outer(&mut core[0], at_1[0], a);
        add_outer(&mut core[0], at_1[2], [-t[0], -t[1], -t[2]]);
        add_outer(&mut core[1], at_2[1], c);
        add_outer(&mut core[1], at_2[2], t);
        add_outer(&mut core[2], at_1[1], c);
        add_outer(&mut core[2], at_1[2], t);
        assemble(&core)
    }
}

/// Linear elasticity of the stretch `U - I`, with `F = R U` and `R` orthonormal.
///
/// With `J2 = sqrt(det C)` and `t = tr U = sqrt(tr C + 2 J2)`, `U = (C + J2 I)/t`. Where the triangle is
/// shrunk to a line, `R` is not defined; `J2` and `t` count as 1e-6 at least where they are divided by.
pub mod corotational {
    use super::*;

    struct Polar<R> {
        x: [[R; 3]; 2],
        d: Pairs<R>,
        /// `tr U - 2`.
        excess: R,
        /// `tr U`.
        trace: R,
        /// One over `J2`.
        inverse: R,
        /// `U - I` by vertex pair, upper indices, 1/m^2.
        strain: Pairs<R>,
        /// Second Piola-Kirchhoff stress.
        s: Pairs<R>,
    }

    #[inline(always)]
    fn polar<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Polar<R> {
        let (w, d) = (relative(u), dual(e));
        let x = deformed(e, &w);
        let c = gram_change(e, &w, &x);
        let two = R::from_f64(2.0);
        let least = R::from_f64(1e-6);
        // tr C - 2, det C - 1 and what follows, without taking 1 from a number near 1
        let dt = d[0].mul_add(c[0], d[1].mul_add(c[1], (d[2] + d[2]) * c[2]));
        let dd = inverse_determinant(e).mul_add(minor(c[0], c[1], c[2], c[2]), dt);
        let j = (R::ONE + dd).max(R::ZERO).sqrt();
        let dj = dd * (R::ONE + j).recip();
        let trace = (two + two + dt + dj + dj).max(least * least).sqrt();
        let excess = (dt + dj + dj) * (trace + two).recip();
        let per_trace = trace.recip();
        let k = dj - excess;
        // (d c d + k d)/t
        let (mut strain, _) = raised(&d, &c);
        let (pressure, two_mu) = (e.lambda * excess, e.mu + e.mu);
        let mut t = [R::ZERO; 3];
        for i in 0..3 {
            strain[i] = (strain[i] + k * d[i]) * per_trace;
            t[i] = two_mu.mul_add(strain[i], pressure * d[i]);
        }
        // S = U^-1 T with U^-1 = ((t - 1) I - (U - I))/J2; (U - I) with one index lowered
        let inverse = j.max(least).recip();
        let [[v11, v12], [v21, v22]] = mixed(e, &strain);
        let rest = R::ONE + excess;
        let s = [
            (rest * t[0] - v11.mul_add(t[0], v12 * t[2])) * inverse,
            (rest * t[1] - v21.mul_add(t[2], v22 * t[1])) * inverse,
            (rest * t[2] - v11.mul_add(t[2], v12 * t[1])) * inverse,
        ];
        Polar { x, d, excess, trace, inverse, strain, s }
    }

    /// Tensor with its second index lowered.
    #[inline(always)]
    fn mixed<R: Real>(e: &Element<R>, t: &Pairs<R>) -> [[R; 2]; 2] {
        let [a, b] = e.edges;
        let (aa, bb, ab) = (dot(a, a), dot(b, b), dot(a, b));
        [
            [t[0].mul_add(aa, t[2] * ab), t[0].mul_add(ab, t[2] * bb)],
            [t[2].mul_add(aa, t[1] * ab), t[2].mul_add(ab, t[1] * bb)],
        ]
    }

    /// Energy, J.
    #[inline(always)]
    pub fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        let p = polar(e, u);
        let [[v11, v12], [v21, v22]] = mixed(e, &p.strain);
        let squares = v11.mul_add(v11, v22.mul_add(v22, R::from_f64(2.0) * v12 * v21));
        let bulk = R::from_f64(0.5) * e.lambda * p.excess * p.excess;
        e.area * e.mu.mul_add(squares, bulk)
    }

    /// Forces on the three vertices, N.
    #[inline(always)]
    pub fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Nodes<R> {
        let p = polar(e, u);
        nodal_forces(e, &p.s, &p.x)
    }

    /// Derivative of the energy density by the rotation that `F` undergoes in the plane, N/m: negative
    /// where the sum of the stretches is below 2.
    #[inline(always)]
    fn twist<R: Real>(e: &Element<R>, p: &Polar<R>) -> R {
        let two = R::from_f64(2.0);
        two * (e.lambda + e.mu) * p.excess * p.trace.recip()
    }

    /// Where the projected tangent differs from the exact one.
    #[inline(always)]
    pub fn is_clamped<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R::Mask {
        let p = polar(e, u);
        let low = principal_stresses(e, &p.s)[1];
        R::less(low.min(p.excess), R::ZERO)
    }

    /// Tangent `+d2W/du2`, N/m, or a semidefinite stand-in, mode by mode of the 6x6 `dP/dF`: the linear
    /// stiffness turned by `R` (which alone is `GaussNewton`), the rotation in the plane, and the
    /// stress against motion along the normal; the last two are clamped at zero by `Projected`.
    #[inline(always)]
    pub fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TriangleTangent<R> {
        let p = polar(e, u);
        let [x1, x2] = p.x;
        // rest edges turned by R: R E_a = F U^-1 E_a = x_b (U^-1)^b_a
        let v = mixed(e, &p.strain);
        let rest = R::ONE + p.excess;
        let i = [
            [(rest - v[0][0]) * p.inverse, -(v[0][1] * p.inverse)],
            [-(v[1][0] * p.inverse), (rest - v[1][1]) * p.inverse],
        ];
        let turned = [
            add(scale(x1, i[0][0]), scale(x2, i[1][0])),
            add(scale(x1, i[0][1]), scale(x2, i[1][1])),
        ];
        let mut core = [[R::ZERO; 9]; 3];
        add_material(&mut core, e, &p.d, &turned);
        if kind == TangentKind::GaussNewton {
            return assemble(&core);
        }
        let normal = cross(x1, x2);
        let size = dot(normal, normal).max(R::from_f64(1e-24) * e.area * e.area);
        let (_, tensile) = tensile_part(e, &p.d, &p.s);
        let s = if kind == TangentKind::Projected { tensile } else { p.s };
        let factor = e.area * size.recip();
        for k in 0..3 {
            add_outer(&mut core[k], scale(normal, s[k] * factor), normal);
        }
        // dF = R spin / sqrt 2: vertex a moves along R spin D_a
        let mut curvature = twist(e, &p);
        if kind == TangentKind::Projected {
            curvature = curvature.max(R::ZERO);
        }
        let half = R::from_f64(0.5);
        let unit = (e.area + e.area).recip();
        // n x R D_a is a rest edge over 2 A, turned: D_1 ~ E_2, D_2 ~ E_1
        let arms = [scale(turned[1], unit), scale(turned[0], -unit)];
        let c = half * curvature * e.area;
        for (block, (a, b)) in core.iter_mut().zip([(0, 0), (1, 1), (0, 1)]) {
            add_outer(block, scale(arms[a], c), arms[b]);
        }
        assemble(&core)
    }
}
