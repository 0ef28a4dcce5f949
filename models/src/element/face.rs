//! Pressure on a face of a ten-node tetrahedron: a surface of second degree through three corners and the middles of the edges
//! between them, in the order `a, b, c, ab, bc, ca`.
//!
//! With `N_a` the shape functions of the face, `x_1 = dx/dxi` and `x_2 = dx/deta` its tangents, `X` the same at rest, `u` the
//! displacement and `w_i` its derivatives:
//!
//! ```text
//! f_a  = p int N_a x_1 x x_2                                                                   (N)
//! V    = int u . (X_1 x X_2 + (X_1 x w_2 + w_1 x X_2)/2 + w_1 x w_2 / 3)                       (m^3)
//! k_ab = p int N_a (dN_b/dxi x_2 - dN_b/deta x_1)     -df_a/dx_b = skew(k_ab)
//! K_ab = skew(k_ab - k_ba)/2      symmetric part of -df/dx;  K_aa = 0                          (N/m)
//! ```
//!
//! All integrands are polynomials of degree 4 at most, so that six points give the integrals exactly, whatever the shape. On a
//! flat face under constant pressure corners get nothing and middles a third each. That `-p V` is a potential of the forces
//! where a surface is closed or its rim is held is as for flat triangles ([`crate::laws::pressure`]).

use sinew_engine::scalar::{Real, add, cross, dot, scale, sub};

/// Vertices of a face.
pub const VERTICES: usize = 6;

/// Pairs of vertices of a face: all, in lexicographic order.
pub const PAIRS: [[usize; 2]; 15] = {
    let mut pairs = [[0, 1]; 15];
    let mut i = 1;
    while i < 15 {
        let [a, b] = pairs[i - 1];
        pairs[i] = if b + 1 < VERTICES { [a, b + 1] } else { [a + 1, a + 2] };
        i += 1;
    }
    pairs
};

/// A part of a face that a pressure can act on: the whole, and the four quarters between its corners and middles.
pub const PARTS: [[usize; 3]; 5] = [[0, 1, 2], [0, 3, 5], [1, 4, 3], [2, 5, 4], [3, 4, 5]];

/// What is summed at a point.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// Weight in the integral over the local coordinates.
    weight: f64,
    /// Shape functions.
    shape: [f64; VERTICES],
    /// Their derivatives by `xi` and by `eta`.
    by: [[f64; VERTICES]; 2],
}

/// The points of one of the [`PARTS`].
#[derive(Clone, Copy, Debug)]
pub struct Points([Point; 6]);

/// The points of all [`PARTS`].
pub static POINTS: [Points; 5] = [points(0), points(1), points(2), points(3), points(4)];

/// Barycentric coordinates of the vertices.
const AT: [[f64; 3]; VERTICES] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [0.5, 0.5, 0.0],
    [0.0, 0.5, 0.5],
    [0.5, 0.0, 0.5],
];

/// Weights, whose sum is 1, and the coordinate that two corners have in common, of the two times three points that are exact for
/// degree 4 (Dunavant 1985, table II): `(8 - sqrt 10 +- sqrt(38 - 44 sqrt(2/5)))/18` and
/// `(620 +- sqrt(213125 - 53320 sqrt 10))/3720`.
const RULE: [[f64; 2]; 2] = [
    [0.223_381_589_678_011_47, 0.445_948_490_915_964_9],
    [0.109_951_743_655_321_87, 0.091_576_213_509_770_74],
];

const fn points(part: usize) -> Points {
    // what a quarter is of the whole
    let size = if part == 0 { 0.5 } else { 0.125 };
    let mut points = [Point { weight: 0.0, shape: [0.0; VERTICES], by: [[0.0; VERTICES]; 2] }; 6];
    let mut i = 0;
    while i < 6 {
        let [weight, common] = RULE[i / 3];
        let mut within = [common; 3];
        within[i % 3] = 1.0 - 2.0 * common;
        let mut l = [0.0; 3];
        let mut k = 0;
        while k < 9 {
            l[k % 3] += within[k / 3] * AT[PARTS[part][k / 3]][k % 3];
            k += 1;
        }
        let [a, b, c] = l;
        points[i] = Point {
            weight: size * weight,
            shape: [
                a * (2.0 * a - 1.0),
                b * (2.0 * b - 1.0),
                c * (2.0 * c - 1.0),
                4.0 * a * b,
                4.0 * b * c,
                4.0 * c * a,
            ],
            by: [
                [1.0 - 4.0 * a, 4.0 * b - 1.0, 0.0, 4.0 * (a - b), 4.0 * c, -4.0 * c],
                [1.0 - 4.0 * a, 0.0, 4.0 * c - 1.0, -4.0 * b, 4.0 * b, 4.0 * (a - c)],
            ],
        };
        i += 1;
    }
    Points(points)
}

/// Volume (m^3) per area in local coordinates that a surface with the tangents `edges` at rest sweeps at a point that moves by
/// `u` (m), where its tangents change by `w`.
#[inline(always)]
pub(crate) fn swept<R: Real>(u: [R; 3], edges: &[[R; 3]; 2], w: &[[R; 3]; 2]) -> R {
    let [a, b] = *edges;
    let rest = dot(u, cross(a, b));
    let first = dot(u, add(cross(a, w[1]), cross(w[0], b)));
    let second = dot(u, cross(w[0], w[1]));
    (R::from_f64(1.0 / 3.0)).mul_add(second, R::from_f64(0.5).mul_add(first, rest))
}

/// Sum of vectors from the first vertex to the others, each times its factor.
#[inline(always)]
fn combine<R: Real>(factors: &[f64; VERTICES], vectors: &[[R; 3]; VERTICES - 1]) -> [R; 3] {
    let mut sum = scale(vectors[0], R::from_f64(factors[1]));
    for i in 1..VERTICES - 1 {
        sum = add(sum, scale(vectors[i], R::from_f64(factors[i + 1])));
    }
    sum
}

/// Displacements of the other vertices against the first.
#[inline(always)]
fn differences<R: Real>(u: &[[R; 3]; VERTICES]) -> [[R; 3]; VERTICES - 1] {
    let mut differences = [[R::ZERO; 3]; VERTICES - 1];
    for i in 0..VERTICES - 1 {
        differences[i] = sub(u[i + 1], u[0]);
    }
    differences
}

/// Tangents of the deformed face at a point, from the vectors between its vertices.
#[inline(always)]
fn tangents<R: Real>(point: &Point, now: &[[R; 3]; VERTICES - 1]) -> [[R; 3]; 2] {
    [combine(&point.by[0], now), combine(&point.by[1], now)]
}

/// Vectors from the first vertex of the deformed face to the others.
#[inline(always)]
fn deformed<R: Real>(
    rest: &[[R; 3]; VERTICES - 1],
    u: &[[R; 3]; VERTICES],
) -> [[R; 3]; VERTICES - 1] {
    let mut now = differences(u);
    for i in 0..VERTICES - 1 {
        now[i] = add(rest[i], now[i]);
    }
    now
}

/// Integrals (m^2) of the shape functions over a part of a face at rest. Of a curved face they are as good as the points, of a
/// flat one exact.
pub fn areas(Points(points): &Points, rest: &[[f64; 3]; VERTICES - 1]) -> [f64; VERTICES] {
    let mut areas = [0.0; VERTICES];
    for point in points {
        let [x, y] = tangents(point, rest);
        let normal = cross(x, y);
        let weight = point.weight * dot(normal, normal).sqrt();
        areas.iter_mut().zip(point.shape).for_each(|(area, n)| *area += weight * n);
    }
    areas
}

/// Volume (m^3) that a part of a face sweeps from rest to displacements `u` (m), positive along its normal; `rest` are the
/// vectors from its first vertex to the others at rest (m).
#[inline(always)]
pub fn swept_volume<R: Real>(
    Points(points): &Points,
    rest: &[[R; 3]; VERTICES - 1],
    u: &[[R; 3]; VERTICES],
) -> R {
    let w = differences(u);
    let mut volume = R::ZERO;
    for point in points {
        let here = add(u[0], combine(&point.shape, &w));
        let own = swept(here, &tangents(point, rest), &tangents(point, &w));
        volume = R::from_f64(point.weight).mul_add(own, volume);
    }
    volume
}

/// Forces (N) of `pressure` (Pa) on the vertices.
#[inline(always)]
pub fn forces<R: Real>(
    Points(points): &Points,
    rest: &[[R; 3]; VERTICES - 1],
    u: &[[R; 3]; VERTICES],
    pressure: R,
) -> [[R; 3]; VERTICES] {
    let now = deformed(rest, u);
    let mut forces = [[R::ZERO; 3]; VERTICES];
    for point in points {
        let [x, y] = tangents(point, &now);
        let own = scale(cross(x, y), R::from_f64(point.weight) * pressure);
        for a in 0..VERTICES {
            forces[a] = add(forces[a], scale(own, R::from_f64(point.shape[a])));
        }
    }
    forces
}

/// Vectors `v` (N/m) of the blocks `skew(v)` of the symmetric tangent of `pressure` (Pa), for all [`PAIRS`].
#[inline(always)]
pub fn tangent<R: Real>(
    Points(points): &Points,
    rest: &[[R; 3]; VERTICES - 1],
    u: &[[R; 3]; VERTICES],
    pressure: R,
) -> [[R; 3]; 15] {
    let now = deformed(rest, u);
    let half = R::from_f64(0.5) * pressure;
    let mut arms = [[R::ZERO; 3]; 15];
    for point in points {
        let [x, y] = tangents(point, &now);
        let weight = R::from_f64(point.weight) * half;
        let (x, y) = (scale(x, weight), scale(y, weight));
        for (arm, [a, b]) in arms.iter_mut().zip(PAIRS) {
            let Point { shape, by: [xi, eta], .. } = point;
            let along_y = R::from_f64(shape[a] * xi[b] - shape[b] * xi[a]);
            let along_x = R::from_f64(shape[a] * eta[b] - shape[b] * eta[a]);
            *arm = add(*arm, sub(scale(y, along_y), scale(x, along_x)));
        }
    }
    arms
}

/// The block `skew(v)`.
#[inline(always)]
pub fn skew<R: Real>([x, y, z]: [R; 3]) -> [R; 9] {
    [R::ZERO, -z, y, z, R::ZERO, -x, -y, x, R::ZERO]
}
