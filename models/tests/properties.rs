//! Properties that hold for every tetrahedron and every displacement: forces and tangents are
//! derivatives, rigid motions cost nothing, projections are semidefinite, degenerate states are
//! finite, springs and fused element agree, `f32` follows `f64`.

use crate::common;

use std::f64::consts::TAU;

use common::{config, max_abs, max_difference, symmetric_eigen, vector};
use proptest::prelude::*;
use sinew_engine::scalar::{Scalar, add, cross, dot, mat_vec, scale, sub};
use sinew_models::element::precompute::{
    ADJACENT_EDGES, EDGES, OPPOSITE_EDGES, RestTetrahedron, SpringConstants,
};
use sinew_models::element::spring;
use sinew_models::element::tetrahedron::{self, Element, TangentKind, compression};
use sinew_models::material::{LameParameters, YoungPoisson};

type Nodes = [[f64; 3]; 4];

#[derive(Clone, Debug)]
struct Body {
    points: Nodes,
    rest: RestTetrahedron,
    lame: LameParameters,
    /// Least altitude, m.
    altitude: f64,
    /// Longest edge, m.
    size: f64,
}

impl Body {
    fn element(&self) -> Element<f64> {
        Element::new(&self.rest, self.lame, true)
    }

    fn stiffness(&self) -> f64 {
        self.lame.lambda.abs() + 2.0 * self.lame.mu
    }
}

/// Rotation about `axis` (any vector) by `angle`, row-major.
fn rotation(axis: [f64; 3], angle: f64) -> [f64; 9] {
    let [x, y, z] = scale(axis, 1.0 / dot(axis, axis).sqrt());
    let (s, c) = angle.sin_cos();
    let d = 1.0 - c;
    [
        c + d * x * x,
        d * x * y - s * z,
        d * x * z + s * y,
        d * x * y + s * z,
        c + d * y * y,
        d * y * z - s * x,
        d * x * z - s * y,
        d * y * z + s * x,
        c + d * z * z,
    ]
}

fn unit_axis() -> impl Strategy<Value = [f64; 3]> {
    vector().prop_filter("long enough", |v| dot(*v, *v) > 0.01)
}

/// A tetrahedron flattened by one of `flattenings`, turned and scaled, with a material.
fn body(flattenings: &'static [f64]) -> impl Strategy<Value = Body> {
    (
        prop::array::uniform4(vector()),
        prop::sample::select(flattenings),
        (unit_axis(), 0.0..TAU),
        prop::sample::select(&[1e-3, 1e-2, 1.0][..]),
        (2.0..6.0_f64, prop::sample::select(&[-0.3, 0.0, 0.3, 0.45, 0.49][..])),
    )
        .prop_filter_map("too flat", |(points, flat, (axis, angle), size, (log_e, nu))| {
            let turn = rotation(axis, angle);
            let place = |p: [f64; 3]| scale(mat_vec(&turn, [p[0], p[1], flat * p[2]]), size);
            let mut points = points.map(place);
            let edges = EDGES.map(|[a, b]| sub(points[a], points[b]));
            let size = edges.iter().fold(0.0_f64, |m, e| m.max(dot(*e, *e).sqrt()));
            let volume = dot(cross(edges[0], edges[1]), edges[2]).abs() / 6.0;
            if volume < 0.01 * flat * size.powi(3) {
                return None;
            }
            let rest = RestTetrahedron::new(points).or_else(|_| {
                points.swap(0, 1);
                RestTetrahedron::new(points)
            });
            let rest = rest.ok()?;
            let lame = YoungPoisson {
                young_modulus: 10.0_f64.powf(log_e),
                poisson_ratio: nu,
                density: 1000.0,
            };
            let longest = rest.gradients.iter().fold(0.0_f64, |m, d| m.max(dot(*d, *d)));
            let altitude = 1.0 / longest.sqrt();
            Some(Body { points, rest, lame: lame.lame().ok()?, altitude, size })
        })
}

const ROUND: &[f64] = &[1.0];
const ANY: &[f64] = &[1.0, 1.0, 1e-2, 1e-4];

#[derive(Clone, Copy, Debug)]
enum State {
    Rest,
    Small,
    Moderate,
    Large,
    /// Gradients of 1e5 in slivers: for finiteness only, rounding swamps differences.
    Huge,
    Crushed,
    Inverted,
    PointInverted,
    Flat,
    Line,
    Collapsed,
}

const STATES: &[State] = &[
    State::Rest,
    State::Small,
    State::Moderate,
    State::Large,
    State::Crushed,
    State::Inverted,
    State::PointInverted,
    State::Flat,
    State::Line,
    State::Collapsed,
];

/// Displacement into `state`, with random directions from `noise`.
fn displacement(b: &Body, state: State, noise: Nodes) -> Nodes {
    let x = b.points;
    // Foot of the altitude of vertex 3, seen from vertex 3.
    let d = b.rest.gradients[3];
    let drop = scale(d, -1.0 / dot(d, d));
    let shaken = |amplitude: f64| noise.map(|n| scale(n, amplitude * b.altitude));
    match state {
        State::Rest => [[0.0; 3]; 4],
        State::Small => shaken(1e-3),
        State::Moderate => shaken(0.3),
        State::Large => shaken(2.0),
        State::Huge => noise.map(|n| scale(n, 10.0 * b.size)),
        State::Crushed => {
            let shake = shaken(0.1);
            std::array::from_fn(|a| add(scale(x[a], -0.5), shake[a]))
        }
        State::Inverted => {
            let mut u = shaken(0.1);
            u[3] = add(u[3], scale(drop, 2.0));
            u
        }
        State::PointInverted => x.map(|p| scale(p, -2.0)),
        State::Flat => [[0.0; 3], [0.0; 3], [0.0; 3], drop],
        State::Line => {
            let along = |a: usize| scale(noise[0], dot(noise[1], x[a]));
            std::array::from_fn(|a| sub(along(a), x[a]))
        }
        State::Collapsed => x.map(|p| scale(p, -1.0)),
    }
}

fn case(flattenings: &'static [f64]) -> impl Strategy<Value = (Body, State, Nodes)> {
    (body(flattenings), prop::sample::select(STATES), prop::array::uniform4(vector())).prop_map(
        |(b, state, noise)| {
            let u = displacement(&b, state, noise);
            (b, state, u)
        },
    )
}

/// Derivative along coordinate (`a`, `x`) of whatever `f` returns, by the five-point rule: exact
/// for the quartic elastic energy.
fn derivative<const N: usize>(
    u: &Nodes,
    a: usize,
    x: usize,
    h: f64,
    f: impl Fn(&Nodes) -> [f64; N],
) -> [f64; N] {
    let at = |steps: f64| {
        let mut moved = *u;
        moved[a][x] += steps * h;
        f(&moved)
    };
    let (m2, m1, p1, p2) = (at(-2.0), at(-1.0), at(1.0), at(2.0));
    std::array::from_fn(|i| (8.0 * (p1[i] - m1[i]) - (p2[i] - m2[i])) / (12.0 * h))
}

/// Step for [`derivative`], the relative error of its abscissae from rounding, and the error left
/// in the derivative of the force by the jump of its third derivative at `J = 1`.
fn step(b: &Body, e: &Element<f64>, u: &Nodes) -> (f64, f64, f64) {
    let h = 1e-5 * b.altitude;
    let rounding = 2.0 * f64::EPSILON * max_abs(u.as_flattened()) / h;
    let mut slope = 0.0_f64;
    for n in 0..12 {
        let [d] = derivative(u, n / 3, n % 3, h, |u| [tetrahedron::volume_ratio(e, u)]);
        slope = slope.max(d.abs());
    }
    let near = (tetrahedron::volume_ratio(e, u) - 1.0).abs() < 4.0 * h * slope;
    let kink = if near { 12.0 * e.compression * e.volume * slope.powi(4) * h * h } else { 0.0 };
    (h, rounding, kink)
}

fn flatten(f: Nodes) -> [f64; 12] {
    std::array::from_fn(|i| f[i / 3][i % 3])
}

/// The 9x9 second derivative of the energy density by `F` (row-major pairs), from the law itself.
fn stress_derivative(e: &Element<f64>, u: &Nodes) -> [[f64; 9]; 9] {
    let mut g = [[0.0; 3]; 3];
    for a in 0..3 {
        for i in 0..3 {
            for j in 0..3 {
                g[i][j] += (u[a + 1][i] - u[0][i]) * e.gradients[a][j];
            }
        }
    }
    let mut f = g;
    for i in 0..3 {
        f[i][i] += 1.0;
    }
    let mut s = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            let square = (0..3).map(|k| g[k][i] * g[k][j]).sum::<f64>();
            s[i][j] = e.mu * (g[i][j] + g[j][i] + square);
        }
    }
    let trace = (s[0][0] + s[1][1] + s[2][2]) / (2.0 * e.mu);
    for i in 0..3 {
        s[i][i] += e.lambda * trace;
    }
    let m = (tetrahedron::volume_ratio(e, u) - 1.0).min(0.0);
    let p1 = 2.0 * e.compression * m.powi(3);
    let p2 = 6.0 * e.compression * m.powi(2);
    let cofactor = |f: &[[f64; 3]; 3]| [cross(f[1], f[2]), cross(f[2], f[0]), cross(f[0], f[1])];
    let cof = cofactor(&f);
    let mut h = [[0.0; 9]; 9];
    for n in 0..9 {
        let mut df = [[0.0; 3]; 3];
        df[n / 3][n % 3] = 1.0;
        let mut de = [[0.0; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                for k in 0..3 {
                    de[i][j] += 0.5 * (df[k][i] * f[k][j] + f[k][i] * df[k][j]);
                }
            }
        }
        let trace = de[0][0] + de[1][1] + de[2][2];
        // cof is quadratic: its derivative is half a central difference with unit steps.
        let (mut ahead, mut behind) = (f, f);
        ahead[n / 3][n % 3] += 1.0;
        behind[n / 3][n % 3] -= 1.0;
        let (ahead, behind) = (cofactor(&ahead), cofactor(&behind));
        for i in 0..3 {
            for j in 0..3 {
                let mut dp = e.lambda * trace * f[i][j];
                for k in 0..3 {
                    dp += df[i][k] * s[k][j] + 2.0 * e.mu * f[i][k] * de[k][j];
                }
                dp += p2 * cof[n / 3][n % 3] * cof[i][j];
                dp += p1 * 0.5 * (ahead[i][j] - behind[i][j]);
                h[3 * i + j][n] = dp;
            }
        }
    }
    h
}

/// Element matrix of a 9x9 second derivative.
fn pulled_back(b: &Body, h: &[[f64; 9]; 9]) -> [[f64; 12]; 12] {
    let d = b.rest.gradients;
    let mut k = [[0.0; 12]; 12];
    for r in 0..12 {
        for c in 0..12 {
            for j in 0..3 {
                for l in 0..3 {
                    k[r][c] += b.rest.volume
                        * d[r / 3][j]
                        * h[3 * (r % 3) + j][3 * (c % 3) + l]
                        * d[c / 3][l];
                }
            }
        }
    }
    k
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn forces_are_minus_the_energy_gradient((b, _, u) in case(ANY)) {
        let e = b.element();
        let (w, f) = (tetrahedron::energy(&e, &u), tetrahedron::forces(&e, &u));
        let f = flatten(f);
        let fc = flatten(compression::forces(&e, &u));
        let floor = 0.1 * b.rest.volume * b.stiffness();
        let (h, rounding, _) = step(&b, &e, &u);
        let unit = max_abs(&f).max(max_abs(&fc)) + (w + floor) / b.altitude;
        let bound = (1e-6 + rounding) * unit;
        for n in 0..12 {
            let [dw, dc] = derivative(&u, n / 3, n % 3, h, |u| {
                [tetrahedron::energy(&e, u), compression::energy(&e, u)]
            });
            prop_assert!((f[n] + dw).abs() <= bound, "{n}: {} {dw} unit {unit}", f[n]);
            prop_assert!((fc[n] + dc).abs() <= bound, "{n}: {} {dc} unit {unit}", fc[n]);
        }
    }

    #[test]
    fn tangents_are_minus_the_force_gradient((b, state, u) in case(ANY)) {
        let e = b.element();
        let k = tetrahedron::tangent(&e, &u, TangentKind::Exact).to_dense();
        let kc = compression::tangent(&e, &u, TangentKind::Exact).to_dense();
        let f = flatten(tetrahedron::forces(&e, &u));
        let floor = 0.1 * b.rest.volume * b.stiffness() / (b.altitude * b.altitude);
        let (h, rounding, kink) = step(&b, &e, &u);
        let unit = max_abs(k.as_flattened()) + max_abs(&f) / b.altitude + floor;
        let bound = (1e-6 + rounding) * unit + kink;
        for n in 0..12 {
            let df = derivative(&u, n / 3, n % 3, h, |u| flatten(tetrahedron::forces(&e, u)));
            let dc = derivative(&u, n / 3, n % 3, h, |u| flatten(compression::forces(&e, u)));
            for r in 0..12 {
                let error = (k[r][n] + df[r]).abs();
                prop_assert!(error <= bound, "{state:?}: {r} {n} {error:e} of {unit:e}");
                let error = (kc[r][n] + dc[r]).abs();
                prop_assert!(error <= bound, "{state:?}: {r} {n} {error:e} of {unit:e}");
            }
        }
    }

    #[test]
    fn tangents_are_symmetric_and_indifferent_to_translation((b, _, u) in case(ANY)) {
        for kind in [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected] {
            let t = tetrahedron::tangent(&b.element(), &u, kind);
            let k = t.to_dense();
            let unit = max_abs(k.as_flattened());
            for r in 0..12 {
                for c in 0..r {
                    prop_assert!((k[r][c] - k[c][r]).abs() <= 1e-14 * unit);
                }
            }
            let moved = t.product(&[[1.0, -2.0, 0.5]; 4]);
            prop_assert!(max_abs(moved.as_flattened()) <= 1e-13 * unit);
            let v: Nodes = std::array::from_fn(|a| [0.3 * a as f64, 1.0, -0.7 * a as f64]);
            let (kv, flat) = (flatten(t.product(&v)), flatten(v));
            for r in 0..12 {
                let row = (0..12).map(|c| k[r][c] * flat[c]).sum::<f64>();
                prop_assert!((row - kv[r]).abs() <= 1e-13 * unit);
            }
        }
    }

    #[test]
    fn forces_have_no_resultant_and_no_moment((b, _, u) in case(ANY)) {
        let f = tetrahedron::forces(&b.element(), &u);
        let (mut sum, mut moment, mut arm) = ([0.0; 3], [0.0; 3], 0.0);
        for a in 0..4 {
            let x = add(b.points[a], u[a]);
            sum = add(sum, f[a]);
            moment = add(moment, cross(x, f[a]));
            arm += dot(x, x).sqrt() + dot(b.points[a], b.points[a]).sqrt();
        }
        // The arm per altitude amplifies the rounding of F.
        let unit = max_abs(f.as_flattened())
            + b.rest.volume * b.stiffness() / b.altitude;
        prop_assert!(max_abs(&sum) <= 1e-14 * unit);
        prop_assert!(max_abs(&moment) <= 1e-13 * unit * arm * (arm / b.altitude));
    }

    #[test]
    fn rigid_motions_cost_nothing(
        b in body(ANY),
        axis in unit_axis(),
        angle in 0.0..TAU,
        shift in vector(),
    ) {
        let turn = rotation(axis, angle);
        let u: Nodes = std::array::from_fn(|a| {
            sub(add(mat_vec(&turn, b.points[a]), shift), b.points[a])
        });
        let e = b.element();
        // Strain left by rounding the displacement itself.
        let noise = 1e-15 * (b.size + 2.0) / b.altitude;
        let unit = b.rest.volume * b.stiffness();
        let (w, f) = (tetrahedron::energy(&e, &u), tetrahedron::forces(&e, &u));
        prop_assert!(w.abs() <= 100.0 * noise * noise * unit);
        prop_assert!(max_abs(f.as_flattened()) <= 10.0 * noise * unit / b.altitude);
        let j = tetrahedron::volume_ratio(&e, &u);
        prop_assert!((j - 1.0).abs() <= 10.0 * noise);
    }

    #[test]
    fn projected_tangents_clamp_the_eigenvalues_of_the_stress_derivative(
        (b, state, u) in case(ANY),
        with_compression in any::<bool>(),
    ) {
        let e = Element::<f64>::new(&b.rest, b.lame, with_compression);
        let h = stress_derivative(&e, &u);
        let (values, v) = symmetric_eigen(h);
        let mut clamped = [[0.0; 9]; 9];
        for n in 0..9 {
            for i in 0..9 {
                for j in 0..9 {
                    clamped[i][j] += values[n].max(0.0) * v[i][n] * v[j][n];
                }
            }
        }
        let size = max_abs(h.as_flattened());
        let expected = pulled_back(&b, &clamped);
        let unit = b.rest.volume * size / (b.altitude * b.altitude);
        let exact = tetrahedron::tangent(&e, &u, TangentKind::Exact);
        let difference =
            max_difference(exact.to_dense().as_flattened(), pulled_back(&b, &h).as_flattened());
        prop_assert!(difference <= 1e-11 * unit, "exact {difference:e} of {unit:e}");
        let projected = tetrahedron::tangent(&e, &u, TangentKind::Projected);
        let k = projected.to_dense();
        let difference = max_difference(k.as_flattened(), expected.as_flattened());
        prop_assert!(difference <= 1e-11 * unit, "{state:?}: {difference:e} of {unit:e}");

        // Nothing to clamp: the very same matrix.
        let least = values.iter().fold(f64::INFINITY, |m, x| m.min(*x));
        if least > 1e-12 * size {
            prop_assert_eq!(projected, exact);
        }

        // Definite as an element matrix, and so is Gauss-Newton.
        let bound = -1e-13 * max_abs(k.as_flattened());
        let (values, _) = symmetric_eigen(k);
        prop_assert!(values.iter().all(|x| *x >= bound), "{state:?}: {values:?}");
        let k = tetrahedron::tangent(&e, &u, TangentKind::GaussNewton).to_dense();
        let bound = -1e-13 * max_abs(k.as_flattened());
        let (values, _) = symmetric_eigen(k);
        prop_assert!(values.iter().all(|x| *x >= bound), "{state:?}: {values:?}");
    }

    #[test]
    fn projected_compression_is_semidefinite((b, state, u) in case(ANY)) {
        let e = b.element();
        let k = compression::tangent(&e, &u, TangentKind::Projected).to_dense();
        let exact = compression::tangent(&e, &u, TangentKind::Exact).to_dense();
        let bound = 1e-13 * max_abs(exact.as_flattened()).max(max_abs(k.as_flattened()));
        let (values, _) = symmetric_eigen(k);
        prop_assert!(values.iter().all(|x| *x >= -bound), "{state:?}: {values:?}");
    }

    #[test]
    fn everything_is_finite_in_both_precisions(
        b in body(ANY),
        state in prop::sample::select(STATES).boxed().prop_union(Just(State::Huge).boxed()),
        noise in prop::array::uniform4(vector()),
    ) {
        let u = displacement(&b, state, noise);
        fn check<S: Scalar>(b: &Body, u: &Nodes) -> bool {
            let e = Element::<S>::new(&b.rest, b.lame, true);
            let u = u.map(|x| x.map(S::from_f64));
            let (w, f) = (tetrahedron::energy(&e, &u), tetrahedron::forces(&e, &u));
            let mut finite = w.is_finite() && f.as_flattened().iter().all(|x| x.is_finite());
            for kind in [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected] {
                for k in [
                    tetrahedron::tangent(&e, &u, kind).to_dense(),
                    compression::tangent(&e, &u, kind).to_dense(),
                ] {
                    finite &= k.as_flattened().iter().all(|x| x.is_finite());
                }
            }
            finite
        }
        prop_assert!(check::<f64>(&b, &u), "f64 {state:?}");
        // m^4 leaves the range of f32 at J = -1e9, which only Huge reaches.
        if !matches!(state, State::Huge) {
            prop_assert!(check::<f32>(&b, &u), "f32 {state:?}");
        }
    }

    #[test]
    fn springs_equal_the_fused_element((b, _, u) in case(ANY)) {
        let e = Element { compression: 0.0, ..b.element() };
        let springs = SpringConstants::new(&b.rest, b.lame);
        let mut delta = [0.0; 6];
        let mut edge = [[0.0; 3]; 6];
        // What delta and the edges are made of, before anything cancels.
        let (mut reach, mut arm) = ([0.0; 6], [0.0; 6]);
        for n in 0..6 {
            let [i, j] = EDGES[n];
            let rest = sub(b.points[i], b.points[j]);
            delta[n] = spring::squared_length_change(rest, u[i], u[j]);
            let stretch = sub(u[i], u[j]);
            edge[n] = add(rest, stretch);
            let (length, change) = (dot(rest, rest).sqrt(), dot(stretch, stretch).sqrt());
            arm[n] = length + change;
            reach[n] = change * (2.0 * length + change);
        }
        // The units are sums of the absolute terms: slivers and collapse cancel most of them.
        let (mut w, mut w_unit, mut tension, mut s_unit) = (0.0, 0.0, [0.0; 6], [0.0; 6]);
        for n in 0..6 {
            let k = springs.tensile[n];
            w += spring::tensile_energy(k, delta[n]);
            w_unit += spring::tensile_energy(k, reach[n]);
            tension[n] += spring::tensile_tension(k, delta[n]);
            s_unit[n] += spring::tensile_tension(k, reach[n]);
        }
        let angular = springs.angular.iter().zip(ADJACENT_EDGES);
        let volumetric = springs.volumetric.iter().zip(OPPOSITE_EDGES);
        for (&c, [m, n]) in angular.chain(volumetric) {
            w += spring::coupling_energy(c, delta[m], delta[n]);
            w_unit += spring::coupling_energy(c.abs(), reach[m], reach[n]);
            let [to_m, to_n] = spring::coupling_tensions(c, delta[m], delta[n]);
            tension[m] += to_m;
            tension[n] += to_n;
            let [to_m, to_n] = spring::coupling_tensions(c.abs(), reach[m], reach[n]);
            s_unit[m] += to_m;
            s_unit[n] += to_n;
        }
        let (mut f, mut f_unit) = ([[0.0; 3]; 4], 0.0_f64);
        for n in 0..6 {
            let [i, j] = EDGES[n];
            let force = spring::edge_force(tension[n], edge[n]);
            f[i] = add(f[i], force);
            f[j] = sub(f[j], force);
            f_unit += 2.0 * s_unit[n] * arm[n];
        }
        let (w_fused, f_fused) = (tetrahedron::energy(&e, &u), tetrahedron::forces(&e, &u));
        prop_assert!((w - w_fused).abs() <= 1e-12 * w_unit, "{w} {w_fused} of {w_unit}");
        let difference = max_difference(f.as_flattened(), f_fused.as_flattened());
        prop_assert!(difference <= 1e-12 * f_unit, "{difference:e} of {f_unit:e}");
    }

    #[test]
    fn f32_forces_follow_f64(
        b in body(ROUND),
        noise in prop::array::uniform4(vector()),
        exponent in 1..=6_i32,
    ) {
        let strain = 10.0_f64.powi(-exponent);
        let u = noise.map(|n| scale(n, strain * b.altitude));
        let wide = tetrahedron::forces(&b.element(), &u);
        let narrow = tetrahedron::forces(
            &Element::<f32>::new(&b.rest, b.lame, true),
            &u.map(|x| x.map(|y| y as f32)),
        );
        let narrow = narrow.map(|x| x.map(f64::from));
        let error = max_difference(narrow.as_flattened(), wide.as_flattened());
        // The floor is for nodes that happen to move almost together: little strain, little force.
        let floor = 0.03 * strain * b.rest.volume * b.stiffness() / b.altitude;
        let unit = floor.max(max_abs(wide.as_flattened()));
        prop_assert!(error <= 1e-5 * unit, "{exponent}: {error:e} of {unit:e}");
    }
}

#[test]
fn only_compressed_elements_are_projected() {
    let points = [[0.0; 3], [0.01, 0.0, 0.0], [0.002, 0.009, 0.0], [0.001, 0.003, 0.011]];
    let rest = RestTetrahedron::new(points).unwrap();
    let material = YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.45, density: 1000.0 };
    let e = Element::<f64>::new(&rest, material.lame().unwrap(), true);
    for (stretch, compressed) in [(0.2, false), (1e-7, false), (0.0, false), (-0.1, true)] {
        // The same strain with and without a large rotation.
        for angle in [0.0, 2.0] {
            let turn = rotation([1.0, -2.0, 0.5], angle);
            let u = points.map(|x| sub(mat_vec(&turn, scale(x, 1.0 + stretch)), x));
            let exact = tetrahedron::tangent(&e, &u, TangentKind::Exact);
            let projected = tetrahedron::tangent(&e, &u, TangentKind::Projected);
            assert_eq!(exact != projected, compressed, "{stretch} {angle}");
            let exact = compression::tangent(&e, &u, TangentKind::Exact);
            let projected = compression::tangent(&e, &u, TangentKind::Projected);
            // At the edge J = 1 both are rounding noise.
            if stretch != 0.0 {
                assert_eq!(exact != projected, compressed, "compression {stretch} {angle}");
            }
        }
    }
}
