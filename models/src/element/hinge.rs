//! The angle between two triangles with a common edge, and what moves it: plain functions of one hinge.
//!
//! Vertices 0 and 1 are the ends of the edge, 2 and 3 the corners opposite to it. With deformed vectors
//! `e = x_1 - x_0`, `a = x_2 - x_0`, `b = x_3 - x_0` and normals `n_1 = e x a`, `n_2 = b x e`:
//!
//! ```text
//! sin t = -|e| det(e, a, b) / (|n_1| |n_2|),   cos t = n_1 . n_2 / (|n_1| |n_2|)
//! dt    = g_1 . (da - t_1 de) + g_2 . (db - t_2 de)
//!         g_i = -|e| n_i / |n_i|^2,  t_1 = a . e / |e|^2,  t_2 = b . e / |e|^2
//! ```
//!
//! `t` is 0 where the triangles are in one plane, on different sides of the edge, and pi where one lies on the other. With
//! `s = sin(t - t_0)`, `k = 1 - cos(t - t_0)` for the angle `t_0` without moment, and a factor `f` that is 1 but for
//! triangles that have lost nine tenths of their area and more, a hinge gives to energies
//!
//! ```text
//! sigma = f s,   kappa = f k
//! ```
//!
//! Both are smooth where an edge is folded over (an angle itself jumps there), and go to zero with the area of a
//! triangle, whose angle then means nothing. Changes of sine and cosine come from displacements, so that nothing
//! cancels while angles are small.

use sinew_engine::scalar::{Real, add, cross, dot, scale, sub};

use super::matrix::{add_outer, add_skew, symmetrise};

/// Displacements (m) or forces (N) at the vertices of a hinge.
pub type Nodes<R> = [[R; 3]; 4];

/// Blocks of a matrix (of second derivatives, 1/m^2) between the vertices of a hinge.
pub type Blocks<R> = [[[R; 9]; 4]; 4];

/// Rest shape of a hinge.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hinge<R> {
    /// Vectors (m) from vertex 0 to the others at rest.
    pub edges: [[R; 3]; 3],
    /// Sine and cosine of the angle without moment.
    pub free: [R; 2],
    /// Sine and cosine of the angle at rest, measured from that.
    pub offset: [R; 2],
}

/// What a hinge gives at some displacements.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HingeState<R> {
    /// `sigma` (module docs).
    pub sigma: R,
    /// `kappa`.
    pub kappa: R,
    /// Sine of the angle from the one without moment.
    pub sin: R,
    /// Its cosine.
    pub cos: R,
    /// The factor `f`.
    pub fade: R,
    /// Derivative of the angle (1/m).
    pub gradient: Nodes<R>,
    /// Derivative of `sigma` (1/m).
    pub of_sigma: Nodes<R>,
    /// Derivative of `kappa` (1/m).
    pub of_kappa: Nodes<R>,
}

/// Share of the squared rest area from which on a triangle fades: a tenth of its area.
const FADE: f64 = 0.01;
/// Squared areas and lengths are no smaller than this share of those at rest where something is divided by them.
const FLOOR: f64 = 1e-6;

impl Hinge<f64> {
    /// Of rest positions (m); `flat`: the angle without moment is 0, else that at rest.
    pub fn new([x0, x1, x2, x3]: &Nodes<f64>, flat: bool) -> Self {
        let edges = [sub(*x1, *x0), sub(*x2, *x0), sub(*x3, *x0)];
        let rest = Rest::new(&edges);
        let (sin, cos) = (-rest.lever * rest.det, rest.inverse * rest.product);
        if flat {
            Self { edges, free: [0.0, 1.0], offset: [sin, cos] }
        } else {
            // of unit length even in rounding, so that a body at rest has no moment
            let length = sin.hypot(cos);
            Self { edges, free: [sin / length, cos / length], offset: [0.0, 1.0] }
        }
    }

    /// In another precision.
    pub fn cast<R: Real>(&self) -> Hinge<R> {
        Hinge {
            edges: self.edges.map(|v| v.map(R::from_f64)),
            free: self.free.map(R::from_f64),
            offset: self.offset.map(R::from_f64),
        }
    }
}

/// Numbers of the rest shape.
struct Rest<R> {
    normals: [[R; 3]; 2],
    /// Squared lengths of the edge and of the normals.
    square: [R; 3],
    det: R,
    product: R,
    /// `|e| / (|n_1| |n_2|)`.
    lever: R,
    /// `1 / (|n_1| |n_2|)`.
    inverse: R,
}

impl<R: Real> Rest<R> {
    #[inline(always)]
    fn new(&[e, a, b]: &[[R; 3]; 3]) -> Self {
        let normals = [cross(e, a), cross(b, e)];
        let square = [dot(e, e), dot(normals[0], normals[0]), dot(normals[1], normals[1])];
        // roots one by one: the product of the squares is a length to the eighth power
        let inverse = (square[1].sqrt() * square[2].sqrt()).recip();
        Self {
            normals,
            square,
            det: dot(a, normals[1]),
            product: dot(normals[0], normals[1]),
            lever: square[0].sqrt() * inverse,
            inverse,
        }
    }
}

/// The deformed shape.
struct Shape<R> {
    /// `e`, `a`, `b`.
    edges: [[R; 3]; 3],
    /// `n_1`, `n_2`.
    normals: [[R; 3]; 2],
    /// Squared lengths of the normals over those at rest, floored.
    area: [R; 2],
    /// Squared length of the edge, floored.
    length: R,
    /// Squared lengths of the normals, floored.
    square: [R; 2],
    /// `t_1`, `t_2`.
    foot: [R; 2],
}

impl<R: Real> Hinge<R> {
    #[inline(always)]
    fn shape(&self, rest: &Rest<R>, u: &Nodes<R>) -> (Shape<R>, [[R; 3]; 2], [R; 3]) {
        let two = R::from_f64(2.0);
        let floor = R::from_f64(FLOOR);
        let [e0, a0, b0] = self.edges;
        let [we, wa, wb] = [sub(u[1], u[0]), sub(u[2], u[0]), sub(u[3], u[0])];
        let change = [
            add(cross(e0, wa), add(cross(we, a0), cross(we, wa))),
            add(cross(b0, we), add(cross(wb, e0), cross(wb, we))),
        ];
        let edges = [add(e0, we), add(a0, wa), add(b0, wb)];
        let [e, a, b] = edges;
        let normals = [add(rest.normals[0], change[0]), add(rest.normals[1], change[1])];
        let relative = |rest: [R; 3], change: [R; 3], square: R| {
            (two * dot(rest, change) + dot(change, change)) * square.recip()
        };
        let grown = [
            relative(e0, we, rest.square[0]),
            relative(rest.normals[0], change[0], rest.square[1]),
            relative(rest.normals[1], change[1], rest.square[2]),
        ];
        let area = [(R::ONE + grown[1]).max(floor), (R::ONE + grown[2]).max(floor)];
        let length = rest.square[0] * (R::ONE + grown[0]).max(floor);
        let square = [area[0] * rest.square[1], area[1] * rest.square[2]];
        let foot = [dot(a, e) * length.recip(), dot(b, e) * length.recip()];
        (Shape { edges, normals, area, length, square, foot }, change, grown)
    }

    /// Its state at displacements `u` (m).
    #[inline(always)]
    pub fn state(&self, u: &Nodes<R>) -> HingeState<R> {
        let rest = Rest::new(&self.edges);
        let (shape, change, [of_edge, of_1, of_2]) = self.shape(&rest, u);
        let (wa, a0) = (sub(u[2], u[0]), self.edges[1]);
        // what lever and inverse have become, less 1: differences of squares, without cancellation
        let both = shape.area[0] * shape.area[1];
        let edge = (R::ONE + of_edge).max(R::ZERO);
        let grown = of_1 + of_2 + of_1 * of_2;
        let floor = R::from_f64(FLOOR);
        let floored = R::either(R::less(R::ONE + of_1, floor), R::less(R::ONE + of_2, floor));
        let lever = R::select(floored, edge - both, of_edge - grown) * both.recip();
        let lever = lever * (R::ONE + (edge * both.recip()).sqrt()).recip();
        let inverse = R::select(floored, R::ONE - both, -grown) * both.recip();
        let inverse = inverse * (R::ONE + both.recip().sqrt()).recip();
        let det = dot(a0, change[1]) + dot(wa, shape.normals[1]);
        let product = dot(rest.normals[0], change[1]) + dot(change[0], shape.normals[1]);
        let sin = -rest.lever * (det * (R::ONE + lever) + lever * rest.det);
        let cos = rest.inverse * (product * (R::ONE + inverse) + inverse * rest.product);
        let [free_sin, free_cos] = self.free;
        let [offset_sin, offset_cos] = self.offset;
        let turned_sin = offset_sin + (sin * free_cos - cos * free_sin);
        let turned_cos = offset_cos + (cos * free_cos + sin * free_sin);
        let small = turned_sin * turned_sin * (R::ONE + turned_cos.max(R::ZERO)).recip();
        let one_less_cos = R::select(R::less(R::ZERO, turned_cos), small, R::ONE - turned_cos);
        let (sin, cos) = (turned_sin, turned_cos);

        let gradient = shape.gradient();
        let (fade, of_fade) = shape.fade(&rest);
        let mut state = HingeState {
            sigma: fade * sin,
            kappa: fade * one_less_cos,
            sin,
            cos,
            fade,
            gradient,
            of_sigma: gradient,
            of_kappa: gradient,
        };
        for v in 0..4 {
            for x in 0..3 {
                state.of_sigma[v][x] = fade * cos * gradient[v][x] + sin * of_fade[v][x];
                state.of_kappa[v][x] = fade * sin * gradient[v][x] + one_less_cos * of_fade[v][x];
            }
        }
        state
    }

    /// Second derivative of the angle (1/m^2) at displacements `u` (m), symmetric.
    #[inline(always)]
    pub fn second_derivative(&self, u: &Nodes<R>) -> Blocks<R> {
        let (shape, ..) = self.shape(&Rest::new(&self.edges), u);
        let [e, a, b] = shape.edges;
        let minus = |v| scale(v, -R::ONE);
        let [ee1, ea, aa] = shape.of_triangle(e, a, shape.normals[0], 0);
        // the other triangle, seen from its own side
        let [ee2, eb, bb] = shape.of_triangle(e, b, minus(shape.normals[1]), 1);
        let mut h = [[[R::ZERO; 9]; 4]; 4];
        for i in 0..9 {
            let turned = [0, 3, 6, 1, 4, 7, 2, 5, 8][i];
            h[1][1][i] = ee1[i] - ee2[i];
            h[1][2][i] = ea[i];
            h[2][1][turned] = ea[i];
            h[1][3][i] = -eb[i];
            h[3][1][turned] = -eb[i];
            h[2][2][i] = aa[i];
            h[3][3][i] = -bb[i];
        }
        // nothing changes when all vertices move alike
        for j in 1..4 {
            for i in 0..9 {
                h[0][j][i] = -(h[1][j][i] + h[2][j][i] + h[3][j][i]);
                h[j][0][i] = -(h[j][1][i] + h[j][2][i] + h[j][3][i]);
            }
        }
        for i in 0..9 {
            h[0][0][i] = -(h[1][0][i] + h[2][0][i] + h[3][0][i]);
        }
        symmetrise(&mut h[0][0]);
        h
    }
}

impl<R: Real> Shape<R> {
    /// Derivative of the angle.
    #[inline(always)]
    fn gradient(&self) -> Nodes<R> {
        let length = self.length.sqrt();
        let g = |side: usize| scale(self.normals[side], -length * self.square[side].recip());
        let (g1, g2) = (g(0), g(1));
        let of_end = add(scale(g1, -self.foot[0]), scale(g2, -self.foot[1]));
        [scale(add(of_end, add(g1, g2)), -R::ONE), of_end, g1, g2]
    }

    /// The factor `f` and its derivative (1/m).
    #[inline(always)]
    fn fade(&self, rest: &Rest<R>) -> (R, Nodes<R>) {
        let two = R::from_f64(2.0);
        let [e, a, b] = self.edges;
        let mut factor = [R::ONE; 2];
        let mut slope = [R::ZERO; 2];
        for side in 0..2 {
            let z = (self.area[side] * R::from_f64(1.0 / FADE)).min(R::ONE);
            factor[side] = z * z * (R::from_f64(3.0) - two * z);
            slope[side] =
                R::from_f64(12.0 / FADE) * z * (R::ONE - z) * rest.square[1 + side].recip();
        }
        let s1 = slope[0] * factor[1];
        let s2 = slope[1] * factor[0];
        let [n1, n2] = self.normals;
        let of_a = scale(cross(n1, e), s1);
        let of_b = scale(cross(e, n2), s2);
        let of_e = add(scale(cross(a, n1), s1), scale(cross(n2, b), s2));
        let of_start = scale(add(of_e, add(of_a, of_b)), -R::ONE);
        (factor[0] * factor[1], [of_start, of_e, of_a, of_b])
    }

    /// What a triangle of edge `e`, side `a` and normal `n = e x a` gives to the second derivative: blocks (e, e),
    /// (e, a) and (a, a) of the symmetric part of `d(g . (da - t de))`.
    #[inline(always)]
    fn of_triangle(&self, e: [R; 3], a: [R; 3], n: [R; 3], side: usize) -> [[R; 9]; 3] {
        let half = R::from_f64(0.5);
        let (length, foot) = (self.length.sqrt(), self.foot[side]);
        let inverse = self.square[side].recip();
        let lever = length * inverse;
        let g = scale(n, -lever);
        // (I - 2 n n^T) [v]x
        let mirrored = |v: [R; 3]| {
            let mut m = [R::ZERO; 9];
            add_skew(&mut m, v);
            add_outer(&mut m, scale(n, R::from_f64(-2.0) * inverse), cross(n, v));
            m
        };
        let by_a = mirrored(e).map(|x| -lever * x);
        let mut by_e = mirrored(a).map(|x| lever * x);
        add_outer(&mut by_e, scale(n, -inverse * length.recip()), e);
        let foot_by_a = scale(e, self.length.recip());
        let foot_by_e = scale(sub(a, scale(e, foot + foot)), self.length.recip());
        let mut ee = by_e.map(|x| -foot * x);
        add_outer(&mut ee, scale(g, -R::ONE), foot_by_e);
        symmetrise(&mut ee);
        let mut ea = by_a.map(|x| -foot * x);
        add_outer(&mut ea, scale(g, -R::ONE), foot_by_a);
        for (i, turned) in [0, 3, 6, 1, 4, 7, 2, 5, 8].into_iter().enumerate() {
            ea[i] = half * (ea[i] + by_e[turned]);
        }
        let mut aa = by_a;
        symmetrise(&mut aa);
        [ee, ea, aa]
    }
}
