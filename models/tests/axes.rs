//! Axes of one element: reference vectors (closed forms differentiated automatically), derivatives,
//! definiteness, rigid motion, digits in single precision.

use glam::{DQuat, DVec3};
use proptest::prelude::*;
use serde_json::Value;
use sinew_models::axes::damper::AxialDamper;
use sinew_models::axes::element::{AxisElement, BiquadraticFibre, Fibre, Triad, VolumeTerm};
use sinew_models::axes::site::{Blocks, Nodes};
use sinew_models::element::precompute::{EDGES, RestTetrahedron, SpringConstants};
use sinew_models::element::spring::squared_length_change;
use sinew_models::element::tetrahedron::{Element, TangentKind, TetrahedronTangent};
use sinew_models::frame::law::TetrahedronLaw;
use sinew_models::laws::linear::Linear;
use sinew_models::material::LameParameters;

use crate::common::json::{flat, rows};
use crate::common::{Worst, max_abs, max_difference, reference, symmetric_eigen, vector};

fn three(value: &Value) -> [f64; 3] {
    flat(value).try_into().unwrap()
}

fn dense<const N: usize>(blocks: &Blocks<N>) -> Vec<f64> {
    let entry = |i: usize, j: usize| blocks[i / 3][j / 3][3 * (i % 3) + j % 3];
    (0..9 * N * N).map(|k| entry(k / (3 * N), k % (3 * N))).collect()
}

/// Dampers on the chords of a reference case.
fn check_dampers<const N: usize>(case: &Value, worst: &mut Worst) -> Nodes<N> {
    let name = case["name"].as_str().unwrap();
    let [rest, x, v]: [Nodes<N>; 3] = ["rest", "deformed", "velocity"].map(|key| rows(&case[key]));
    let [plus, minus] = ["weights_plus", "weights_minus"].map(|key| rows::<3, N>(&case[key]));
    let (length, damping) = (three(&case["rest_chord"]), three(&case["axial"]["kd"]));
    let u: Nodes<N> = std::array::from_fn(|a| std::array::from_fn(|k| x[a][k] - rest[a][k]));
    let (mut sum, mut by_force) = (vec![0.0; 3 * N], vec![0.0; 3 * N]);
    for (i, axis) in rows::<3, 3>(&case["axes"]).into_iter().enumerate() {
        let shape = std::array::from_fn(|a| (plus[i][a] - minus[i][a]) / length[i]);
        let damper = AxialDamper::new(axis, shape, damping[i] * length[i] * length[i]);
        for (sum, f) in by_force.iter_mut().zip(damper.forces(&u, &v).as_flattened()) {
            *sum += f;
        }
        let matrix = dense(&damper.matrix(&u));
        for (sum, row) in sum.iter_mut().zip(matrix.chunks(3 * N)) {
            *sum -= row.iter().zip(v.as_flattened()).map(|(a, b)| a * b).sum::<f64>();
        }
    }
    let expected = flat(&case["axial"]["forces_damping"]);
    for (what, found) in [("dampers", &sum), ("forces of dampers", &by_force)] {
        worst.note(what, max_difference(found, &expected), max_abs(&expected), name);
    }
    u
}

#[test]
fn reference_elements() {
    let data = reference("axis_springs.json");
    let mut worst = Worst::default();
    let (mut tetrahedra, mut hexahedra) = (0, 0);
    for case in data["cases"].as_array().unwrap() {
        let name = case["name"].as_str().unwrap();
        let axes: [[f64; 3]; 3] = rows(&case["axes"]);
        let compare = |worst: &mut Worst, what, found: &[f64], expected: &Value| {
            let expected = flat(expected);
            worst.note(what, max_difference(found, &expected), max_abs(&expected), name);
        };
        if case["kind"] == "hex" {
            hexahedra += 1;
            check_dampers::<8>(case, &mut worst);
            continue;
        }
        tetrahedra += 1;
        let rest: [[f64; 3]; 4] = rows(&case["rest"]);
        let u = check_dampers::<4>(case, &mut worst);

        // the element functions of the engine, from moduli
        let shape = RestTetrahedron::new(rest).unwrap();
        let d = [shape.gradients[1], shape.gradients[2], shape.gradients[3]];
        let v = shape.volume;
        let (young, shear) = (three(&case["Y"]), three(&case["G"]));
        let none =
            Triad { gradients: d, axes, axial: [0.0; 3], angular: [0.0; 3], volumetric: 0.0 };
        let kinds = |e: &dyn Fn(TangentKind) -> TetrahedronTangent<f64>,
                     of: [(TangentKind, &str); 2]| {
            of.map(|(kind, key)| (e(kind).to_dense().as_flattened().to_vec(), key.to_string()))
        };
        let axial = Triad { axial: young.map(|y| y * v), ..none };
        let angular = Triad { angular: shear.map(|g| g * v), ..none };
        let jacobian = &case["jacobian_volume"];
        let lambda = jacobian["Lambda"].as_f64().unwrap();
        let volumetric = Triad { volumetric: lambda * v, ..none };
        let alone = VolumeTerm { gradients: d, volumetric: lambda * v };
        for (what, element, expected, of) in [
            (
                "axes",
                axial,
                &case["axial"],
                [(TangentKind::Exact, "hessian"), (TangentKind::Projected, "hessian_psd")],
            ),
            (
                "angles",
                angular,
                &case["angular"],
                [(TangentKind::Exact, "hessian"), (TangentKind::Projected, "hessian_gauss_newton")],
            ),
            (
                "volume",
                volumetric,
                jacobian,
                [
                    (TangentKind::Exact, "hessian"),
                    (TangentKind::GaussNewton, "hessian_gauss_newton"),
                ],
            ),
        ] {
            compare(&mut worst, what, &[element.energy(&u)], &expected["energy"]);
            compare(&mut worst, what, element.forces(&u).as_flattened(), &expected["forces"]);
            for (found, key) in kinds(&|kind| element.tangent(&u, kind), of) {
                if !expected[&key].is_null() {
                    compare(&mut worst, what, &found, &expected[&key]);
                }
            }
        }
        worst.note(
            "volume alone",
            (alone.energy(&u) - volumetric.energy(&u)).abs(),
            lambda * v,
            name,
        );
        assert_eq!(alone.forces(&u), volumetric.forces(&u));
        let fibres = (0..3).map(|i| fibre(&shape, axes[i], young[i]).energy(&u)).sum::<f64>();
        worst.note("fibres", (fibres - axial.energy(&u)).abs(), axial.energy(&u), name);
    }
    assert_eq!((tetrahedra, hexahedra), (5, 5));
    worst.check(1e-9);
}

/// A passive fibre.
fn fibre(shape: &RestTetrahedron, axis: [f64; 3], modulus: f64) -> Fibre<f64> {
    let along = |d: [f64; 3]| d[0] * axis[0] + d[1] * axis[1] + d[2] * axis[2];
    Fibre {
        shape: [1, 2, 3].map(|b| along(shape.gradients[b])),
        axis,
        stiffness: modulus * shape.volume,
        shortening: 0.0,
        active: 0.0,
        offset: 0.0,
        inverse_width: 1.0,
    }
}

/// A biquadratic fibre with the axis and modulus of another.
fn biquadratic(fibre: &Fibre<f64>) -> BiquadraticFibre<f64> {
    let &Fibre { shape, axis, stiffness, .. } = fibre;
    BiquadraticFibre { shape, axis, stiffness }
}

fn unit() -> impl Strategy<Value = [f64; 3]> {
    vector().prop_filter_map("no direction", |v| {
        let v = DVec3::from_array(v);
        (v.length() > 0.1).then(|| v.normalize().to_array())
    })
}

/// A tetrahedron, three axes (of any angles), moduli and displacements.
fn case() -> impl Strategy<Value = (RestTetrahedron, Nodes<4>, Triad<f64>, Fibre<f64>, Nodes<4>)> {
    let points = prop::array::uniform4(vector());
    let moduli = prop::array::uniform7(0.0..1e3_f64);
    let active = (-0.2..0.4_f64, 0.0..1e3_f64, -0.2..0.2_f64, 1.2..3.0_f64);
    let size = prop_oneof![Just(1e-3), Just(0.1), Just(0.5), Just(2.0)];
    (points, prop::array::uniform3(unit()), moduli, active, prop::array::uniform4(vector()), size)
        .prop_filter_map("flat", |(p, axes, m, active, u, size)| {
            let turned = [p[0], p[2], p[1], p[3]];
            let p = if RestTetrahedron::new(p).is_ok() { p } else { turned };
            let shape = RestTetrahedron::new(p).ok()?;
            if shape.volume < 0.02 {
                return None;
            }
            let d = [shape.gradients[1], shape.gradients[2], shape.gradients[3]];
            let v = shape.volume;
            let triad = Triad {
                gradients: d,
                axes,
                axial: [m[0] * v, m[1] * v, m[2] * v],
                angular: [m[3] * v, m[4] * v, m[5] * v],
                volumetric: m[6] * v,
            };
            let mut fibre = fibre(&shape, axes[0], m[0]);
            (fibre.shortening, fibre.offset, fibre.inverse_width) = (active.0, active.2, active.3);
            fibre.active = active.1 * v;
            Some((shape, p, triad, fibre, u.map(|u| u.map(|x| size * x))))
        })
}

fn check_derivatives(e: &impl AxisElement<f64>, u: &Nodes<4>) -> Result<(), TestCaseError> {
    let force = e.forces(u);
    let tangent = e.tangent(u, TangentKind::Exact).to_dense();
    let (f_size, k_size) = (max_abs(force.as_flattened()), max_abs(tangent.as_flattened()));
    let h = 1e-5;
    let moved = |i: usize, by: f64| {
        let mut u = *u;
        u[i / 3][i % 3] += by;
        u
    };
    // differences of fourth order
    let d = |f: &dyn Fn(&Nodes<4>) -> f64, i: usize| {
        let at = |s: f64| f(&moved(i, s * h));
        (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * h)
    };
    for i in 0..12 {
        let slope = d(&|u| e.energy(u), i);
        let floor = 1e-5 * (f_size + h * k_size) + 1e-10 * e.energy(u).abs() / h;
        prop_assert!((slope + force[i / 3][i % 3]).abs() <= floor, "{slope} {force:?}");
        for j in 0..12 {
            let slope = -d(&|u| e.forces(u)[j / 3][j % 3], i);
            prop_assert!(
                (slope - tangent[j][i]).abs() <= 1e-4 * k_size,
                "{i} {j}: {slope} {}",
                tangent[j][i]
            );
            prop_assert!((tangent[i][j] - tangent[j][i]).abs() <= 1e-13 * k_size);
        }
    }
    Ok(())
}

fn check_definite(e: &impl AxisElement<f64>, u: &Nodes<4>) -> Result<(), TestCaseError> {
    let exact = e.tangent(u, TangentKind::Exact).to_dense();
    prop_assert!(exact.as_flattened().iter().all(|x| x.is_finite()));
    prop_assert!(e.forces(u).as_flattened().iter().all(|x| x.is_finite()));
    prop_assert!(e.energy(u).is_finite());
    for kind in [TangentKind::GaussNewton, TangentKind::Projected] {
        let (values, _) = symmetric_eigen(e.tangent(u, kind).to_dense());
        let least = values.iter().fold(f64::INFINITY, |m, x| m.min(*x));
        prop_assert!(least >= -1e-12 * max_abs(&values), "{kind:?} {least}");
    }
    Ok(())
}

/// Chords that are nearly points make differences useless.
fn shortest(shape: &RestTetrahedron, axes: &[[f64; 3]; 3], u: &Nodes<4>) -> f64 {
    let length = |a: [f64; 3]| fibre(shape, a, 1.0).length(u);
    axes.iter().map(|a| length(*a)).fold(f64::INFINITY, f64::min)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    #[test]
    fn forces_and_tangents_are_derivatives((shape, _, triad, mut fibre, u) in case()) {
        prop_assume!(shortest(&shape, &triad.axes, &u) > 0.1);
        check_derivatives(&triad, &u)?;
        let volume = VolumeTerm { gradients: triad.gradients, volumetric: triad.volumetric };
        check_derivatives(&volume, &u)?;
        // away from the kinks of the slope of the length-tension curve
        let place = (fibre.length(&u) - 1.0 + fibre.offset) * fibre.inverse_width;
        if (place.abs() - 1.0).abs() > 1e-3 {
            check_derivatives(&fibre, &u)?;
        }
        fibre.active = 0.0;
        check_derivatives(&fibre, &u)?;
        check_derivatives(&biquadratic(&fibre), &u)?;
    }

    #[test]
    fn stand_ins_are_semidefinite((_, p, triad, fibre, u) in case()) {
        let collapsed = p.map(|x| x.map(|x| -x));
        let mirrored = p.map(|x| [0.0, 0.0, -2.0 * x[2]]);
        let flat = p.map(|x| [0.0, 0.0, -x[2]]);
        for u in [u, collapsed, mirrored, flat, [[0.0; 3]; 4]] {
            check_definite(&triad, &u)?;
            check_definite(&fibre, &u)?;
            check_definite(&biquadratic(&fibre), &u)?;
        }
    }

    /// The projected tangent of a biquadratic fibre is the exact one with its negative eigenvalues set to 0.
    #[test]
    fn biquadratic_fibres_are_projected_exactly((_, p, _, fibre, u) in case()) {
        let e = biquadratic(&fibre);
        let pressed = p.map(|x| x.map(|x| -0.5 * x));
        let collapsed = p.map(|x| x.map(|x| -x));
        for u in [u, pressed, collapsed] {
            let exact = e.tangent(&u, TangentKind::Exact).to_dense();
            let (values, vectors) = symmetric_eigen(exact);
            let mut clamped = [[0.0; 12]; 12];
            for (k, value) in values.iter().enumerate().filter(|(_, value)| **value > 0.0) {
                for i in 0..12 {
                    for j in 0..12 {
                        clamped[i][j] += value * vectors[i][k] * vectors[j][k];
                    }
                }
            }
            let found = e.tangent(&u, TangentKind::Projected).to_dense();
            let off = max_difference(found.as_flattened(), clamped.as_flattened());
            prop_assert!(off <= 1e-11 * max_abs(exact.as_flattened()), "{off}");
            prop_assert_eq!(
                e.is_clamped(&u),
                values.iter().any(|x| *x < -1e-13 * max_abs(&values)),
                "{:?}", values
            );
        }
    }

    /// `V Y/2 (a.E a)^2`, whatever the fibre is made of: as springs, as an axis, and from the deformation gradient.
    #[test]
    fn biquadratic_fibres_are_springs((shape, p, _, fibre, u) in case()) {
        let e = biquadratic(&fibre);
        let g = |i: usize, j: usize| (0..4).map(|b| u[b][i] * shape.gradients[b][j]).sum::<f64>();
        let (mut strain, mut most) = (0.0, 0.0);
        for i in 0..3 {
            for j in 0..3 {
                let green = 0.5 * (g(i, j) + g(j, i) + (0..3).map(|k| g(k, i) * g(k, j)).sum::<f64>());
                strain += e.axis[i] * green * e.axis[j];
                most += (e.axis[i] * green * e.axis[j]).abs();
            }
        }
        let direct = 0.5 * e.stiffness * strain * strain;
        let mut springs = SpringConstants::NONE;
        springs.add_fibre(&shape, e.axis, e.stiffness / shape.volume);
        let (mut energy, mut forces, mut size) = (0.0, [[0.0; 3]; 4], [0.0; 2]);
        let delta = EDGES.map(|[i, j]| {
            let rest = [0, 1, 2].map(|k| p[i][k] - p[j][k]);
            squared_length_change(rest, u[i], u[j])
        });
        let matrix = springs.matrix();
        for (m, [i, j]) in EDGES.into_iter().enumerate() {
            let tension: f64 = (0..6).map(|n| matrix[m][n] * delta[n]).sum();
            let reach: f64 = (0..6).map(|n| (matrix[m][n] * delta[n]).abs()).sum();
            energy += 0.5 * tension * delta[m];
            size[0] += 0.5 * reach * delta[m].abs();
            for k in 0..3 {
                let edge = p[i][k] + u[i][k] - p[j][k] - u[j][k];
                forces[i][k] -= 2.0 * tension * edge;
                forces[j][k] += 2.0 * tension * edge;
                size[1] += 2.0 * reach * edge.abs();
            }
        }
        prop_assert!((e.energy(&u) - energy).abs() <= 1e-12 * size[0]);
        let size_of_direct = size[0] + e.stiffness * most * most;
        prop_assert!((direct - energy).abs() <= 1e-12 * size_of_direct, "{direct} {energy}");
        let off = max_difference(e.forces(&u).as_flattened(), forces.as_flattened());
        prop_assert!(off <= 1e-12 * size[1], "{off}");
    }

    #[test]
    fn rigid_motions_cost_nothing((_, p, triad, mut fibre, u) in case(), axis in vector()) {
        let turn = DQuat::from_scaled_axis(3.0 * DVec3::from_array(axis));
        let moved = |u: &Nodes<4>| -> Nodes<4> {
            std::array::from_fn(|a| {
                let x = DVec3::from_array(p[a]) + DVec3::from_array(u[a]);
                (turn * x + DVec3::X - DVec3::from_array(p[a])).to_array()
            })
        };
        (fibre.active, fibre.shortening) = (0.0, 0.0);
        let rigid = moved(&[[0.0; 3]; 4]);
        let stiffness = triad.axial.iter().chain(&triad.angular).sum::<f64>() + triad.volumetric;
        let altitude = max_abs(triad.gradients.as_flattened());
        // rounding of G, of displacements of up to 5 times shape vectors, through its minors: 5e-14
        let rounded = (1e-13 * altitude).powi(2) * stiffness;
        prop_assert!(triad.energy(&rigid) <= rounded);
        prop_assert!(fibre.energy(&rigid) <= rounded);
        let own = biquadratic(&fibre);
        prop_assert!(own.energy(&rigid) <= rounded);
        let change = own.energy(&moved(&u)) - own.energy(&u);
        prop_assert!(change.abs() <= 1e-9 * (own.energy(&u) + own.stiffness));
        prop_assert!(
            max_abs(triad.forces(&rigid).as_flattened()) <= 1e-12 * stiffness * altitude
        );
        // and turning a deformed element turns its forces
        let (before, after) = (triad.forces(&u), triad.forces(&moved(&u)));
        let size = max_abs(before.as_flattened()) + stiffness * altitude;
        for a in 0..4 {
            let turned = (turn * DVec3::from_array(before[a])).to_array();
            prop_assert!(max_difference(&turned, &after[a]) <= 1e-9 * size);
        }
        // no resultant, no moment
        for f in [before, fibre.forces(&u), own.forces(&u)] {
            let force: DVec3 = f.iter().map(|f| DVec3::from_array(*f)).sum();
            let moment: DVec3 = (0..4)
                .map(|a| {
                    let x = DVec3::from_array(p[a]) + DVec3::from_array(u[a]);
                    x.cross(DVec3::from_array(f[a]))
                })
                .sum();
            prop_assert!(force.length() <= 1e-12 * size && moment.length() <= 1e-11 * size);
        }
    }

    #[test]
    fn single_precision_keeps_its_digits(
        (_, _, triad, fibre, u) in case(),
        strain in prop_oneof![Just(1e-5), Just(1e-3), Just(1e-1)],
    ) {
        let scale = strain / max_abs(u.as_flattened());
        let u = u.map(|u| u.map(|x| scale * x));
        let narrow = u.map(|u| u.map(|x| x as f32));
        // of the same numbers
        let wide = narrow.map(|u| u.map(f64::from));
        let (t, t64) = (narrowed(&triad), widened(&narrowed(&triad)));
        let (f32s, f64s) = (t.forces(&narrow), t64.forces(&wide));
        let size = max_abs(f64s.as_flattened());
        let off = max_difference(&f32s.as_flattened().iter().map(|x| f64::from(*x)).collect::<Vec<_>>(), f64s.as_flattened());
        prop_assert!(off <= 3e-5 * size, "{off} of {size}");
        prop_assert!(fibre.energy(&wide).is_finite());
        let own = biquadratic(&fibre);
        let half = BiquadraticFibre {
            shape: own.shape.map(|x| x as f32),
            axis: own.axis.map(|x| x as f32),
            stiffness: own.stiffness as f32,
        };
        let own = BiquadraticFibre {
            shape: half.shape.map(f64::from),
            axis: half.axis.map(f64::from),
            stiffness: f64::from(half.stiffness),
        };
        let (found, expected) = (half.forces(&narrow).map(|f| f.map(f64::from)), own.forces(&wide));
        let size = own.stiffness * max_abs(&own.shape).powi(2) * max_abs(wide.as_flattened());
        let off = max_difference(found.as_flattened(), expected.as_flattened());
        prop_assert!(off <= 3e-5 * size, "{off} of {size}");
    }

    #[test]
    fn orthogonal_axes_are_isotropic_at_small_strain(
        (shape, _, triad, _, _) in case(),
        axis in vector(),
        (lambda, mu) in (0.0..1e3_f64, 1.0..1e3_f64),
    ) {
        // in any orientation
        let turn = DQuat::from_scaled_axis(3.0 * DVec3::from_array(axis));
        let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|a| (turn * a).to_array());
        let v = shape.volume;
        let e = Triad {
            axes,
            axial: [2.0 * mu * v; 3],
            angular: [mu * v; 3],
            volumetric: lambda * v,
            ..triad
        };
        let linear = Element::<f64>::new(&shape, LameParameters { lambda, mu }, false);
        let rest = [[0.0; 3]; 4];
        let expected = Linear::tangent(&linear, &rest, TangentKind::Exact).to_dense();
        for kind in [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected] {
            let found = e.tangent(&rest, kind).to_dense();
            let off = max_difference(found.as_flattened(), expected.as_flattened());
            prop_assert!(off <= 1e-12 * max_abs(expected.as_flattened()), "{kind:?} {off}");
        }
    }
}

fn narrowed(t: &Triad<f64>) -> Triad<f32> {
    Triad {
        gradients: t.gradients.map(|d| d.map(|x| x as f32)),
        axes: t.axes.map(|d| d.map(|x| x as f32)),
        axial: t.axial.map(|x| x as f32),
        angular: t.angular.map(|x| x as f32),
        volumetric: t.volumetric as f32,
    }
}

fn widened(t: &Triad<f32>) -> Triad<f64> {
    Triad {
        gradients: t.gradients.map(|d| d.map(f64::from)),
        axes: t.axes.map(|d| d.map(f64::from)),
        axial: t.axial.map(f64::from),
        angular: t.angular.map(f64::from),
        volumetric: f64::from(t.volumetric),
    }
}

/// Stress along an active fibre follows the length-tension curve.
#[test]
fn active_stress_follows_its_curve() {
    let shape = RestTetrahedron::new([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        .unwrap();
    let (peak, optimum, width) = (100.0, 1.1, 0.4);
    let e = Fibre {
        active: peak * shape.volume,
        offset: 1.0 - optimum,
        inverse_width: 1.0 / width,
        ..fibre(&shape, [1.0, 0.0, 0.0], 0.0)
    };
    for stretch in [0.5, 0.69, 0.71, 0.9, 1.0, 1.1, 1.3, 1.49, 1.51, 3.0] {
        let u = [[0.0; 3], [stretch - 1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]];
        let expected = peak * (1.0 - ((stretch - optimum) / width).powi(2)).max(0.0);
        // the face through vertex 0 of area 1/2 carries a third at its vertices, vertex 1 all of it
        let stress = -e.forces(&u)[1][0] / shape.volume;
        assert!((stress - expected).abs() < 1e-12 * peak, "{stretch}: {stress} {expected}");
    }
}
