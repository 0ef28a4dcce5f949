//! Membrane triangles: reference vectors computed elsewhere (as `reference.rs`), and what holds for
//! every triangle and every displacement.

use crate::common;

use common::json::{flat, number, rows};
use common::{Worst, config, max_abs, max_difference, reference, symmetric_eigen, vector};
use proptest::prelude::*;
use sinew_engine::scalar::{Real, add, cross, dot, scale, sub};
use sinew_models::element::membrane::{
    Element, RestTriangle, RestTriangleError, SpringConstants, TangentKind, TriangleTangent,
    area_ratio, biquadratic, linear, plane_stress, quadratic,
};
use sinew_models::element::spring::Stretch;
use sinew_models::element::spring::{tensile_energy, tensile_tension};
use sinew_models::frame::law::TriangleLaw;
use sinew_models::laws::membranes::{
    BiquadraticMembrane, CorotationalMembrane, LinearMembrane, QuadraticMembrane,
};
use sinew_models::material::LameParameters;

type Nodes = [[f64; 3]; 3];

fn displacement(rest: Nodes, deformed: Nodes) -> Nodes {
    std::array::from_fn(|a| sub(deformed[a], rest[a]))
}

/// Edge `i` lies opposite vertex `i`.
const EDGES: [[usize; 2]; 3] = [[1, 2], [2, 0], [0, 1]];

#[test]
fn triangles() {
    let mut worst = Worst::default();
    let file = reference("triangles.json");
    let cases = file["cases"].as_array().unwrap();
    assert!(cases.len() >= 28);
    for case in cases {
        let name = case["name"].as_str().unwrap();
        let (stretch, nu) = (number(&case["E_2d"]), number(&case["nu"]));
        let moduli = plane_stress(stretch, nu);
        let rest_points = rows(&case["rest"]);
        let rest = RestTriangle::new(rest_points).unwrap();
        let u = displacement(rest_points, rows(&case["deformed"]));
        let e = Element::<f64>::new(&rest, moduli, false);
        let energy_unit = stretch * rest.area;
        let force_unit = stretch * rest.area.sqrt();
        worst.same(
            "moduli (the paper's mu is twice ours)",
            &[moduli.lambda, 2.0 * moduli.mu],
            &[number(&case["lambda_2d"]), number(&case["mu_2d_paper"])],
            name,
        );
        worst.same("rest area", &[rest.area], &[number(&case["rest_area"])], name);
        let springs = SpringConstants::new(&rest, moduli);
        let trbs = &case["trbs"];
        worst.same("k", &springs.tensile, &flat(&trbs["k"]), name);
        let k_unit = max_abs(&springs.tensile);
        worst.beside("c", &springs.angular, &flat(&trbs["c"]), k_unit, name);

        let error = (biquadratic::energy(&e, &u) - number(&trbs["energy"])).abs();
        worst.note("energy", error, energy_unit, name);
        let f = biquadratic::forces(&e, &u);
        worst.beside("forces", f.as_flattened(), &flat(&trbs["forces"]), force_unit, name);
        let exact = biquadratic::tangent(&e, &u, TangentKind::Exact).to_dense();
        worst.same("tangent", exact.as_flattened(), &flat(&trbs["hessian"]), name);
        let material = biquadratic::tangent(&e, &u, TangentKind::GaussNewton).to_dense();
        let theirs = flat(&trbs["hessian_material"]);
        worst.same("material tangent", material.as_flattened(), &theirs, name);

        let trqs = &case["trqs"];
        let error = (quadratic::energy(&e, &u) - number(&trqs["energy"])).abs();
        worst.note("TRQS energy", error, energy_unit, name);
        let f = quadratic::forces(&e, &u);
        worst.beside("TRQS forces", f.as_flattened(), &flat(&trqs["forces"]), force_unit, name);
        let exact = quadratic::tangent(&e, &u, TangentKind::Exact).to_dense();
        worst.same("TRQS tangent", exact.as_flattened(), &flat(&trqs["hessian"]), name);

        // the tensile part on edges
        let ms = &case["mass_spring"];
        let (mut energy, mut forces) = (0.0, [[0.0; 3]; 3]);
        let mut constants = [0.0; 3];
        for (i, [a, b]) in EDGES.into_iter().enumerate() {
            let edge = sub(rest_points[a], rest_points[b]);
            let stretch = Stretch::new(edge, sub(u[a], u[b]));
            constants[i] = 2.0 * dot(edge, edge) * springs.tensile[i];
            energy += tensile_energy(springs.tensile[i], stretch.change);
            let tension = tensile_tension(springs.tensile[i], stretch.change);
            let pull = scale(stretch.edge, stretch.slope * tension);
            (forces[a], forces[b]) = (sub(forces[a], pull), add(forces[b], pull));
        }
        worst.same("spring constants", &constants, &flat(&ms["spring_constant"]), name);
        worst.note("spring energy", (energy - number(&ms["energy"])).abs(), energy_unit, name);
        worst.beside(
            "spring forces",
            forces.as_flattened(),
            &flat(&ms["forces"]),
            force_unit,
            name,
        );
    }
    worst.check(1e-9);
}

/// The formulations, and which of them have a compression term.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Law {
    Biquadratic,
    Compressible,
    Quadratic,
    Linear,
    Corotational,
}

const LAWS: [Law; 5] =
    [Law::Biquadratic, Law::Compressible, Law::Quadratic, Law::Linear, Law::Corotational];

macro_rules! by_law {
    ($law:expr, $f:ident($e:expr, $($more:expr),+)) => {{
        let e = &$law.element($e);
        match $law {
            Law::Biquadratic | Law::Compressible => BiquadraticMembrane::$f(e, $($more),+),
            Law::Quadratic => QuadraticMembrane::$f(e, $($more),+),
            Law::Linear => LinearMembrane::$f(e, $($more),+),
            Law::Corotational => CorotationalMembrane::$f(e, $($more),+),
        }
    }};
}

impl Law {
    fn element<R: Real>(self, e: &Element<R>) -> Element<R> {
        let keep = self == Self::Compressible;
        Element { compression: if keep { e.compression } else { R::ZERO }, ..*e }
    }
    fn energy<R: Real>(self, e: &Element<R>, u: &[[R; 3]; 3]) -> R {
        by_law!(self, energy(e, u))
    }
    fn forces<R: Real>(self, e: &Element<R>, u: &[[R; 3]; 3]) -> [[R; 3]; 3] {
        by_law!(self, forces(e, u))
    }
    fn tangent(self, e: &Element<f64>, u: &Nodes, kind: TangentKind) -> TriangleTangent<f64> {
        by_law!(self, tangent(e, u, kind))
    }
    fn is_clamped(self, e: &Element<f64>, u: &Nodes) -> bool {
        by_law!(self, is_clamped(e, u))
    }
}

#[derive(Clone, Debug)]
struct Sheet {
    points: Nodes,
    rest: RestTriangle,
    moduli: LameParameters,
    /// Longest edge, m.
    size: f64,
}

impl Sheet {
    fn element(&self) -> Element<f64> {
        Element::new(&self.rest, self.moduli, true)
    }
    fn stiffness(&self) -> f64 {
        self.moduli.lambda.abs() + 2.0 * self.moduli.mu
    }
    /// Largest entry of a tangent, as far as the shape lets it grow.
    fn k_unit(&self) -> f64 {
        self.stiffness() * self.size * self.size / self.rest.area
    }
}

fn sheet() -> impl Strategy<Value = Sheet> {
    let material = (2.0..6.0_f64, prop::sample::select(&[-0.3, 0.0, 0.3, 0.45][..]));
    (prop::array::uniform3(vector()), prop::sample::select(&[1e-3, 1e-2, 1.0][..]), material)
        .prop_filter_map("too thin", |(points, size, (log, nu))| {
            let points = points.map(|p| scale(p, size));
            let rest = RestTriangle::new(points).ok()?;
            let lengths = EDGES.map(|[a, b]| sub(points[a], points[b]));
            let size = lengths.iter().map(|e| dot(*e, *e)).fold(0.0, f64::max).sqrt();
            let moduli = plane_stress(10.0_f64.powf(log), nu);
            (rest.area > 0.05 * size * size).then_some(Sheet { points, rest, moduli, size })
        })
}

/// Displacements up to `amount` of the size, in all directions.
fn state(amount: f64) -> impl Strategy<Value = (Sheet, Nodes)> {
    (sheet(), prop::array::uniform3(vector()))
        .prop_map(move |(s, u)| (s.clone(), u.map(|v| scale(v, amount * s.size))))
}

/// States that are crushed, turned over, shrunk to a line or to a point.
fn degenerate() -> impl Strategy<Value = (Sheet, Nodes)> {
    (sheet(), 0..4usize, vector(), 0.0..1.0_f64).prop_map(|(s, kind, v, t)| {
        let [a, b, c] = s.points;
        let x = match kind {
            0 => [v, v, v].map(|v| scale(v, s.size)),
            1 => [a, b, add(scale(a, 1.0 - t), scale(b, t))],
            2 => {
                // the third vertex on the other side of its opposite edge
                let edge = sub(b, a);
                let foot = add(a, scale(edge, dot(sub(c, a), edge) / dot(edge, edge)));
                [a, b, sub(scale(foot, 1.0 + t), scale(c, t))]
            }
            _ => [scale(a, 0.3 * t), scale(b, 0.3 * t), scale(c, 0.3 * t)],
        };
        let u = displacement(s.points, x);
        (s, u)
    })
}

/// The altitude of every vertex, deformed, over the size: derivatives by differences need it.
fn least_altitude(s: &Sheet, u: &Nodes) -> f64 {
    let x: Nodes = std::array::from_fn(|a| add(s.points[a], u[a]));
    let lengths = EDGES.map(|[a, b]| sub(x[a], x[b]));
    let longest = lengths.iter().map(|e| dot(*e, *e)).fold(0.0, f64::max).sqrt();
    area_ratio(&s.element(), u) * 2.0 * s.rest.area / (longest * s.size)
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn forces_and_tangents_are_derivatives((s, u) in state(0.5), v in prop::array::uniform3(vector())) {
        prop_assume!(least_altitude(&s, &u) > 0.05);
        // the compression term is smooth to third order only at J2 = 1
        prop_assume!((area_ratio(&s.element(), &u) - 1.0).abs() > 0.01);
        let e = s.element();
        let h = 1e-5 * s.size;
        let at = |t: f64| -> Nodes { std::array::from_fn(|a| add(u[a], scale(v[a], t))) };
        for law in LAWS {
            let slope = (law.energy(&e, &at(h)) - law.energy(&e, &at(-h))) / (2.0 * h);
            let f = law.forces(&e, &u);
            let work: f64 = (0..3).map(|a| dot(f[a], v[a])).sum();
            let unit = s.k_unit() * s.size;
            prop_assert!((slope + work).abs() < 1e-7 * unit, "{law:?}: {slope} {work} {unit}");
            let kv = law.tangent(&e, &u, TangentKind::Exact).product(&v);
            let (ahead, behind) = (law.forces(&e, &at(h)), law.forces(&e, &at(-h)));
            for a in 0..3 {
                for x in 0..3 {
                    let slope = (behind[a][x] - ahead[a][x]) / (2.0 * h);
                    prop_assert!(
                        (slope - kv[a][x]).abs() < 2e-6 * s.k_unit(),
                        "{law:?} {a} {x}: {slope} {} of {}", kv[a][x], s.k_unit()
                    );
                }
            }
        }
        for exact in [true, false] {
            let kind = if exact { TangentKind::Exact } else { TangentKind::GaussNewton };
            for compression in [0.0, e.compression] {
                let e = Element { compression, ..e };
                let formed = biquadratic::tangent(&e, &u, kind).product(&v);
                let product = biquadratic::product(&e, &u, &v, exact);
                let error = max_difference(formed.as_flattened(), product.as_flattened());
                prop_assert!(error < 1e-12 * s.k_unit());
            }
        }
    }

    #[test]
    fn tangents_are_symmetric_and_stand_ins_semidefinite((s, u) in prop_oneof![state(1.0), degenerate()]) {
        let e = s.element();
        for law in LAWS {
            for kind in [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected] {
                let k = law.tangent(&e, &u, kind).to_dense();
                let size = max_abs(k.as_flattened());
                prop_assert!(size.is_finite(), "{law:?} {kind:?}");
                let unit = size.max(s.k_unit());
                for i in 0..9 {
                    for j in 0..9 {
                        prop_assert!((k[i][j] - k[j][i]).abs() <= 1e-13 * unit);
                    }
                }
                if kind != TangentKind::Exact {
                    let (values, _) = symmetric_eigen(k);
                    let least = values.into_iter().fold(f64::INFINITY, f64::min);
                    prop_assert!(least > -1e-11 * unit, "{law:?} {kind:?}: {least} of {unit}");
                }
            }
            let exact = law.tangent(&e, &u, TangentKind::Exact).to_dense();
            let projected = law.tangent(&e, &u, TangentKind::Projected).to_dense();
            let change = max_difference(exact.as_flattened(), projected.as_flattened());
            if !law.is_clamped(&e, &u) {
                prop_assert!(change <= 1e-12 * s.k_unit(), "{law:?}: {change}");
            }
        }
    }

    #[test]
    fn degenerate_states_are_finite((s, u) in degenerate()) {
        let e = s.element();
        for law in LAWS {
            prop_assert!(law.energy(&e, &u).is_finite());
            let f = law.forces(&e, &u);
            let largest = max_abs(f.as_flattened());
            // bounded by the stiffness, however far the triangle is shrunk
            prop_assert!(largest < 100.0 * s.k_unit() * s.size, "{law:?}: {largest}");
        }
    }

    #[test]
    fn rigid_motions_cost_nothing(s in sheet(), axis in vector(), angle in 0.0..6.0_f64, shift in vector()) {
        prop_assume!(dot(axis, axis) > 0.01);
        let axis = scale(axis, 1.0 / dot(axis, axis).sqrt());
        let (sin, cos) = angle.sin_cos();
        let turn = |p: [f64; 3]| {
            let along = scale(axis, dot(axis, p) * (1.0 - cos));
            add(add(scale(p, cos), scale(cross(axis, p), sin)), add(along, shift))
        };
        let u = displacement(s.points, s.points.map(turn));
        let e = s.element();
        for law in LAWS.into_iter().filter(|&law| law != Law::Linear) {
            let unit = s.stiffness() * s.rest.area;
            prop_assert!(law.energy(&e, &u) < 1e-24 * unit * (s.size.powi(2) / s.rest.area + 1.0 / s.size).powi(4));
            let f = law.forces(&e, &u);
            // rounding of displacements of up to a metre
            let noise = 1e-14 * (1.0 + 1.0 / s.size) * s.k_unit() * s.size;
            prop_assert!(max_abs(f.as_flattened()) < 10.0 * noise, "{law:?}: {f:?} of {noise}");
        }
        // net force and moment vanish in any state
        let u: Nodes = std::array::from_fn(|a| scale(u[(a + 1) % 3], 0.3 * s.size));
        for law in LAWS.into_iter().filter(|&law| law != Law::Linear) {
            let f = law.forces(&e, &u);
            let mut moment = [0.0; 3];
            let mut net = [0.0; 3];
            for a in 0..3 {
                net = add(net, f[a]);
                moment = add(moment, cross(add(s.points[a], u[a]), f[a]));
            }
            let unit = max_abs(f.as_flattened()) + s.k_unit() * s.size * 1e-3;
            prop_assert!(max_abs(&net) < 1e-12 * unit);
            prop_assert!(max_abs(&moment) < 1e-11 * unit * s.size.max(1e-3), "{law:?} {moment:?}");
        }
    }

    #[test]
    fn single_precision_keeps_its_digits(s in sheet(), u in prop::array::uniform3(vector()), log in -6.0..-1.0_f64) {
        // the same numbers in both types
        let e32 = Element::<f32>::new(&s.rest, s.moduli, true);
        let e = Element {
            edges: e32.edges.map(|row| row.map(f64::from)),
            area: f64::from(e32.area),
            lambda: f64::from(e32.lambda),
            mu: f64::from(e32.mu),
            compression: f64::from(e32.compression),
        };
        let u32 = u.map(|v| v.map(|x| (x * s.size * 10.0_f64.powf(log)) as f32));
        let u = u32.map(|v| v.map(f64::from));
        for law in LAWS {
            let (f, f32) = (law.forces(&e, &u), law.forces(&e32, &u32).map(|v| v.map(f64::from)));
            let unit = s.k_unit() * max_abs(u.as_flattened());
            let error = max_difference(f.as_flattened(), f32.as_flattened()) / unit;
            prop_assert!(error < 2e-5, "{law:?}: {error:e}");
        }
    }

    #[test]
    fn springs_carry_the_energy((s, u) in state(1.0)) {
        let springs = SpringConstants::new(&s.rest, s.moduli);
        let delta = EDGES.map(|[a, b]| {
            sinew_models::element::spring::squared_length_change(sub(s.points[a], s.points[b]), u[a], u[b])
        });
        let mut energy = 0.0;
        for i in 0..3 {
            energy += tensile_energy(springs.tensile[i], delta[i]);
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            energy += sinew_models::element::spring::coupling_energy(springs.angular[i], delta[j], delta[k]);
        }
        let own = Law::Biquadratic.energy(&s.element(), &u);
        prop_assert!((own - energy).abs() < 1e-11 * s.k_unit() * s.size * s.size);
    }
}

/// Fibres in the plane add `A Y/2 (a.E a)^2`, and their springs in a membrane that is two layers add up.
#[test]
fn springs_of_fibres_carry_their_energy() {
    let points = [[0.1, 0.0, 0.2], [1.0, 0.1, -0.1], [0.3, 0.8, 0.4]];
    let rest = RestTriangle::new(points).unwrap();
    let axis = rest.in_plane([0.3, 0.9, 0.1]).unwrap();
    assert!((dot(axis, axis) - 1.0).abs() < 1e-15);
    let normal = cross(rest.edges[0], rest.edges[1]);
    assert!(dot(axis, normal).abs() < 1e-15 && rest.in_plane(normal).is_none());
    let along = rest.along(axis);
    // undeformed, the fibre is itself
    let image = (0..3).fold([0.0; 3], |sum, b| add(sum, scale(points[b], along[b])));
    assert!(max_difference(&image, &axis) < 1e-14, "{image:?} {axis:?}");
    let u = [[0.0, 0.1, -0.2], [0.3, -0.1, 0.05], [-0.2, 0.4, 0.1]];
    let mut springs = SpringConstants { tensile: [0.0; 3], angular: [0.0; 3] };
    springs.add_fibre(&rest, axis, 200.0);
    springs.add_fibre(&rest, axis, 100.0);
    let delta = EDGES.map(|[a, b]| {
        sinew_models::element::spring::squared_length_change(sub(points[a], points[b]), u[a], u[b])
    });
    let mut energy = 0.0;
    for i in 0..3 {
        energy += tensile_energy(springs.tensile[i], delta[i]);
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        energy +=
            sinew_models::element::spring::coupling_energy(springs.angular[i], delta[j], delta[k]);
    }
    let pull = (0..3).fold([0.0; 3], |sum, b| add(sum, scale(u[b], along[b])));
    let strain = dot(pull, add(axis, scale(pull, 0.5)));
    let expected = 0.5 * 300.0 * rest.area * strain * strain;
    assert!((energy / expected - 1.0).abs() < 1e-12, "{energy} {expected}");
}

/// All laws have the same stiffness at rest, where strains are small and in the plane.
#[test]
fn laws_agree_for_small_strains() {
    let points = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.3, 0.8, 0.0]];
    let rest = RestTriangle::new(points).unwrap();
    let e = Element::<f64>::new(&rest, plane_stress(100.0, 0.3), true);
    let u = [[0.0; 3], [1e-6, 2e-6, 0.0], [-3e-6, 1e-6, 0.0]];
    let reference = linear::forces(&e, &u);
    for law in LAWS {
        let error = max_difference(law.forces(&e, &u).as_flattened(), reference.as_flattened());
        assert!(error < 1e-5 * max_abs(reference.as_flattened()), "{law:?}");
    }
    // out of its plane the linear one feels nothing, whatever the size
    let lifted = [[0.0; 3], [0.0, 0.0, 5.0], [0.0; 3]];
    assert_eq!(linear::energy(&e, &lifted), 0.0);
    assert!(biquadratic::energy(&e, &lifted) > 0.0);
}

/// Along an altitude the compression term makes the force rise all the way to area 0; alone the
/// biquadratic springs give way below 0.577, and at area 0 energy and force are bounded.
#[test]
fn compression_term_along_an_altitude() {
    let (h, nus) = (0.5, [0.0, 0.3, 0.45]);
    for nu in nus {
        let moduli = plane_stress(100.0, nu);
        let rest = RestTriangle::new([[0.0; 3], [1.0, 0.0, 0.0], [0.5, h, 0.0]]).unwrap();
        let with = Element::<f64>::new(&rest, moduli, true);
        let without = Element { compression: 0.0, ..with };
        let a = 0.5 * (moduli.lambda + 2.0 * moduli.mu);
        let kappa = moduli.lambda + moduli.mu;
        let force = |e: &Element<f64>, s: f64| {
            biquadratic::forces(e, &[[0.0; 3], [0.0; 3], [0.0, (s - 1.0) * h, 0.0]])[2][1]
        };
        let mut last = 0.0;
        for i in 0..=400 {
            let s = 1.0 - f64::from(i) * 0.0025;
            let expected =
                -rest.area / h * (a * s * (s * s - 1.0) + 2.0 * kappa * (s - 1.0).powi(3));
            let f = force(&with, s);
            if s > 0.002 {
                assert!((f - expected).abs() < 1e-10 * 100.0, "{nu} {s}: {f} {expected}");
                assert!(f >= last, "{nu}: gives way at {s}");
                last = f;
            }
            assert!(f.abs() <= 2.0 * kappa * rest.area / h * (1.0 + 1e-9) + last);
        }
        assert!(force(&without, 0.2) < force(&without, 0.577));
        assert_eq!(force(&with, 1.3), force(&without, 1.3));
        let flat = biquadratic::energy(&with, &[[0.0; 3], [0.0; 3], [0.0, -h, 0.0]]);
        let elastic = biquadratic::energy(&without, &[[0.0; 3], [0.0; 3], [0.0, -h, 0.0]]);
        assert!(((flat - elastic) / (0.5 * kappa * rest.area) - 1.0).abs() < 3e-3);
    }
}

#[test]
fn bad_triangles_are_refused() {
    let line = [[0.0; 3], [1.0, 1.0, 0.0], [2.0, 2.0, 1e-12]];
    assert!(matches!(RestTriangle::new(line), Err(RestTriangleError::Degenerate { .. })));
    assert!(RestTriangle::new([[0.5; 3]; 3]).is_err());
    let mut nan = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    assert!((RestTriangle::new(nan).unwrap().area - 0.5).abs() < 1e-15);
    nan[1][2] = f64::NAN;
    assert!(matches!(RestTriangle::new(nan), Err(RestTriangleError::NonFinite { vertex: 1, .. })));
    for s in [1e-6, 1e3] {
        let points = [[0.0; 3], [s, 0.0, 0.0], [0.0, s, 0.0]];
        assert!(RestTriangle::new(points).is_ok());
    }
}
