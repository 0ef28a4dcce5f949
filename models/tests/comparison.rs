//! The comparison laws and the quadratic springs: derivatives, invariance, small strain, definiteness, registers, determinism.

use crate::common;

use common::{Columns, Sums, max_abs, max_difference, strip_of, symmetric_eigen, vector};
use glam::{DMat3, DQuat, DVec3};
use proptest::prelude::*;
use sinew_engine::element::TETRAHEDRON_EDGES;
use sinew_engine::lanes::InstructionSet;
use sinew_engine::scalar::Scalar;
use sinew_models::element::corotational::{self, Polar};
use sinew_models::element::precompute::RestTetrahedron;
use sinew_models::element::tetrahedron::{self, Element, TangentKind};
use sinew_models::frame::law::TetrahedronLaw;
use sinew_models::frame::stand_in::Corotational;
use sinew_models::laws::corotational::WarpedStiffness;
use sinew_models::laws::linear::Linear;
use sinew_models::laws::neo_hookean::NeoHookean;
use sinew_models::laws::quadratic::QuadraticSprings;
use sinew_models::laws::stvk_fem::StVKFem;
use sinew_models::laws::svk_volume::StVKVolume;
use sinew_models::material::LameParameters;

type Nodes = [[f64; 3]; 4];

fn element(points: Nodes) -> Element<f64> {
    let lame = LameParameters { lambda: 1.4, mu: 0.6 };
    Element::new(&RestTetrahedron::new(points).unwrap(), lame, false)
}

fn volume(p: &Nodes) -> f64 {
    let p = p.map(DVec3::from_array);
    (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) / 6.0
}

/// A tetrahedron that is not too flat.
fn shape() -> impl Strategy<Value = Nodes> {
    prop::array::uniform4(vector()).prop_filter_map("flat", |mut p| {
        if volume(&p) < 0.0 {
            p.swap(0, 1);
        }
        (volume(&p) > 0.1).then_some(p)
    })
}

/// Displacements of a given size, small to inverting.
fn state() -> impl Strategy<Value = (Nodes, Nodes)> {
    let size = prop::sample::select(vec![1e-4, 0.1, 0.5, 1.0]);
    (shape(), prop::array::uniform4(vector()), size)
        .prop_map(|(p, u, size)| (p, u.map(|u| u.map(|x| size * x))))
}

fn gradient(p: &Nodes, u: &Nodes) -> DMat3 {
    let (p, u) = (p.map(DVec3::from_array), u.map(DVec3::from_array));
    let columns = |x: [DVec3; 4]| DMat3::from_cols(x[1] - x[0], x[2] - x[0], x[3] - x[0]);
    columns(std::array::from_fn(|a| p[a] + u[a])) * columns(p).inverse()
}

/// Shortest edge now over rest length.
fn shortest(p: &Nodes, u: &Nodes) -> f64 {
    let (p, u) = (p.map(DVec3::from_array), u.map(DVec3::from_array));
    TETRAHEDRON_EDGES.iter().fold(f64::INFINITY, |m, &[a, b]| {
        m.min((p[a] + u[a] - p[b] - u[b]).length() / (p[a] - p[b]).length())
    })
}

/// How well the rotation is determined: the smallest sum of two signed singular values.
fn gap(f: DMat3) -> f64 {
    let c = f.transpose() * f;
    let rows = |i: usize| [c.row(i).x, c.row(i).y, c.row(i).z];
    let (mut values, _) = symmetric_eigen([rows(0), rows(1), rows(2)]);
    values.sort_by(f64::total_cmp);
    values[1].max(0.0).sqrt() + f.determinant().signum() * values[0].max(0.0).sqrt()
}

/// Flat, mirrored, folded and collapsed states of a tetrahedron.
fn degenerate(p: &Nodes) -> Vec<Nodes> {
    let map = |m: DMat3| p.map(|x| (m * DVec3::from_array(x) - DVec3::from_array(x)).to_array());
    let diagonal = |x, y, z| DMat3::from_diagonal(DVec3::new(x, y, z));
    vec![
        map(diagonal(1.0, 1.0, 0.0)),
        map(diagonal(1.2, 0.0, 0.0)),
        map(DMat3::ZERO),
        map(diagonal(1.0, 1.0, -1.0)),
        map(diagonal(-1.0, -1.0, -1.0)),
        map(diagonal(0.7, 1.4, -0.5)),
        map(diagonal(3.0, 0.2, 0.2)),
        map(diagonal(0.3, 0.3, 0.3)),
        [[0.0; 3]; 4],
    ]
}

fn check_derivatives<L: TetrahedronLaw>(p: Nodes, u: Nodes) -> Result<(), TestCaseError> {
    let e = element(p);
    let h = 1e-5;
    // a logarithm by repeated roots has an error of 1e-14: a longer way leaves less of it
    let far = 10.0 * h;
    let forces = L::forces(&e, &u).unwrap();
    let tangent = L::tangent(&e, &u, TangentKind::Exact).to_dense();
    let scale = max_abs(tangent.as_flattened());
    for a in 0..4 {
        for x in 0..3 {
            let at = |steps: f64| {
                let mut moved = u;
                moved[a][x] += steps * h;
                moved
            };
            let energy = |s: f64| L::energy(&e, &at(10.0 * s));
            let slope =
                (8.0 * (energy(1.0) - energy(-1.0)) - (energy(2.0) - energy(-2.0))) / (12.0 * far);
            prop_assert!((slope + forces[a][x]).abs() < 1e-9 * scale, "{} {slope}", L::NAME);
            if L::NAME == WarpedStiffness::NAME {
                continue; // its tangent is not the derivative, see below
            }
            let force = |s: f64| L::forces(&e, &at(s)).unwrap();
            let (m2, m1, p1, p2) = (force(-2.0), force(-1.0), force(1.0), force(2.0));
            for b in 0..4 {
                for y in 0..3 {
                    let d = (8.0 * (p1[b][y] - m1[b][y]) - (p2[b][y] - m2[b][y])) / (12.0 * h);
                    let k = tangent[3 * b + y][3 * a + x];
                    prop_assert!((d + k).abs() < 1e-8 * scale, "{} {d} {k}", L::NAME);
                }
            }
        }
    }
    for i in 0..12 {
        for j in 0..12 {
            prop_assert!((tangent[i][j] - tangent[j][i]).abs() < 1e-13 * scale, "{}", L::NAME);
        }
    }
    Ok(())
}

fn check_definiteness<L: TetrahedronLaw>(p: Nodes, u: Nodes) -> Result<(), TestCaseError> {
    let e = element(p);
    let exact = L::tangent(&e, &u, TangentKind::Exact).to_dense();
    prop_assert!(exact.as_flattened().iter().all(|x| x.is_finite()), "{}", L::NAME);
    for kind in [TangentKind::GaussNewton, TangentKind::Projected] {
        if kind == TangentKind::Projected && L::STRESS_PROJECTION {
            continue; // asked of the pass over all elements only
        }
        let dense = L::tangent(&e, &u, kind).to_dense();
        let (values, _) = symmetric_eigen(dense);
        let least = values.iter().fold(f64::INFINITY, |m, x| m.min(*x));
        prop_assert!(least >= -1e-12 * max_abs(&values), "{} {kind:?} {least} {u:?}", L::NAME);
        if kind == TangentKind::Projected && !L::is_clamped(&e, &u) {
            let off = max_difference(dense.as_flattened(), exact.as_flattened());
            prop_assert!(off <= 1e-12 * max_abs(&values), "{} {off}", L::NAME);
        }
    }
    let force = L::forces(&e, &u).unwrap();
    prop_assert!(force.as_flattened().iter().all(|x| x.is_finite()), "{}", L::NAME);
    let energy = L::energy(&e, &u);
    prop_assert!(energy > -1e-28 * e.mu, "{} {energy:e}", L::NAME);
    Ok(())
}

fn check_rigid_motion<L: TetrahedronLaw>(
    p: Nodes,
    axis: [f64; 3],
    shift: [f64; 3],
) -> Result<(), TestCaseError> {
    let e = element(p);
    let turn = DQuat::from_scaled_axis(3.0 * DVec3::from_array(axis));
    let u = p.map(|x| {
        let x = DVec3::from_array(x);
        (turn * x + DVec3::from_array(shift) - x).to_array()
    });
    let rest = L::tangent(&e, &[[0.0; 3]; 4], TangentKind::Exact).to_dense();
    let scale = max_abs(rest.as_flattened());
    let f = L::forces(&e, &u).unwrap();
    prop_assert!(max_abs(f.as_flattened()) < 1e-13 * scale, "{} {f:?}", L::NAME);
    prop_assert!(L::energy(&e, &u).abs() < 1e-24 * scale, "{}", L::NAME);
    // a turned element has the turned stiffness, and no eigenvalue to clamp but rounding
    let least = symmetric_eigen(L::tangent(&e, &u, TangentKind::Exact).to_dense()).0;
    let least = least.iter().fold(f64::INFINITY, |m: f64, x| m.min(*x));
    prop_assert!(least > -1e-13 * scale, "{} {least}", L::NAME);
    Ok(())
}

fn check_small_strain<L: TetrahedronLaw>(p: Nodes, u: Nodes) -> Result<(), TestCaseError> {
    // forces agree with linear elasticity to first order: the difference falls with the square
    let e = element(p);
    let off = |size: f64| {
        let u = u.map(|u| u.map(|x| 1e-3 * size * x));
        let (a, b) = (L::forces(&e, &u).unwrap(), Linear::forces(&e, &u).unwrap());
        max_difference(a.as_flattened(), b.as_flattened())
    };
    let ratio = off(1.0) / off(0.5);
    prop_assert!((ratio - 4.0).abs() < 0.2, "{} {ratio}", L::NAME);
    let zero = [[0.0; 3]; 4];
    let a = L::tangent(&e, &zero, TangentKind::Exact).to_dense();
    let b = Linear::tangent(&e, &zero, TangentKind::Exact).to_dense();
    let off = max_difference(a.as_flattened(), b.as_flattened());
    prop_assert!(off < 1e-13 * max_abs(b.as_flattened()), "{} {off}", L::NAME);
    Ok(())
}

/// Force and energy in single precision against double precision at small strain.
fn check_digits<L: TetrahedronLaw>(
    p: Nodes,
    u: Nodes,
    size: f64,
    tolerance: f64,
) -> Result<(), TestCaseError> {
    let p = p.map(|x| x.map(|x| f64::from(x as f32)));
    let u = u.map(|x| x.map(|x| f64::from((size * x) as f32)));
    let rest = RestTetrahedron::new(p).unwrap();
    let lame = LameParameters { lambda: 1.4, mu: 0.6 };
    let narrow = Element::<f32>::new(&rest, lame, false);
    // the same rounded shape vectors on both sides
    let moduli = [f64::from(narrow.lambda), f64::from(narrow.mu), 0.0];
    let gradients = narrow.gradients.map(|d| d.map(f64::from));
    let wide = Element::plain(gradients, f64::from(narrow.volume), moduli);
    let f = L::forces(&wide, &u).unwrap();
    let g = L::forces(&narrow, &u.map(|x| x.map(|x| x as f32))).unwrap();
    let g = g.map(|x| x.map(f64::from));
    let off = max_difference(f.as_flattened(), g.as_flattened()) / max_abs(f.as_flattened());
    prop_assert!(off < tolerance, "{} {size:e}: {off:e}", L::NAME);
    let w = L::energy(&wide, &u);
    let v = f64::from(L::energy(&narrow, &u.map(|x| x.map(|x| x as f32))));
    prop_assert!((w - v).abs() < tolerance * w, "{} {size:e}: {w:e} {v:e}", L::NAME);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    #[test]
    fn forces_and_tangents_are_derivatives((p, u) in state()) {
        check_derivatives::<Linear>(p, u)?;
        check_derivatives::<StVKFem>(p, u)?;
        check_derivatives::<NeoHookean>(p, u)?;
        check_derivatives::<StVKVolume>(p, u)?;
        // an edge without length has no direction
        if shortest(&p, &u) > 0.1 {
            check_derivatives::<QuadraticSprings>(p, u)?;
        }
        // where the rotation is determined it is differentiable
        prop_assume!(gap(gradient(&p, &u)) > 0.1);
        check_derivatives::<Corotational>(p, u)?;
        check_derivatives::<WarpedStiffness>(p, u)?;
    }

    #[test]
    fn stand_ins_are_semidefinite((p, u) in state()) {
        for u in degenerate(&p).into_iter().chain([u]) {
            check_definiteness::<Linear>(p, u)?;
            check_definiteness::<WarpedStiffness>(p, u)?;
            check_definiteness::<Corotational>(p, u)?;
            check_definiteness::<StVKFem>(p, u)?;
            check_definiteness::<NeoHookean>(p, u)?;
            check_definiteness::<StVKVolume>(p, u)?;
            check_definiteness::<QuadraticSprings>(p, u)?;
        }
    }

    #[test]
    fn turning_costs_nothing(p in shape(), axis in vector(), shift in vector()) {
        check_rigid_motion::<WarpedStiffness>(p, axis, shift)?;
        check_rigid_motion::<Corotational>(p, axis, shift)?;
        check_rigid_motion::<StVKFem>(p, axis, shift)?;
        check_rigid_motion::<NeoHookean>(p, axis, shift)?;
        check_rigid_motion::<StVKVolume>(p, axis, shift)?;
        check_rigid_motion::<QuadraticSprings>(p, axis, shift)?;
    }

    #[test]
    fn small_strains_are_linear((p, u) in (shape(), prop::array::uniform4(vector()))) {
        check_small_strain::<WarpedStiffness>(p, u)?;
        check_small_strain::<Corotational>(p, u)?;
        check_small_strain::<StVKFem>(p, u)?;
        check_small_strain::<NeoHookean>(p, u)?;
        check_small_strain::<StVKVolume>(p, u)?;
        check_small_strain::<QuadraticSprings>(p, u)?;
    }

    #[test]
    fn single_precision_keeps_its_digits(
        p in shape().prop_filter("flat", |p| volume(p) > 0.2),
        u in prop::array::uniform4(vector()),
        size in prop::sample::select(vec![1e-6, 1e-4, 1e-2]),
    ) {
        check_digits::<Linear>(p, u, size, 1e-4)?;
        check_digits::<WarpedStiffness>(p, u, size, 1e-4)?;
        check_digits::<Corotational>(p, u, size, 1e-4)?;
        check_digits::<NeoHookean>(p, u, size, 1e-4)?;
        check_digits::<StVKVolume>(p, u, size, 1e-4)?;
    }

    /// Where the strain is no longer formed from that of Green and Lagrange, errors of the rotation are those of
    /// the force over the strain.
    #[test]
    fn rotations_keep_their_digits_at_strains_of_a_tenth(
        p in shape().prop_filter("flat", |p| volume(p) > 0.2),
        u in prop::array::uniform4(vector()),
        size in 0.02..0.2,
    ) {
        check_digits::<Corotational>(p, u, size, 1e-4)?;
        check_digits::<WarpedStiffness>(p, u, size, 1e-4)?;
    }

    #[test]
    fn textbook_form_is_st_venant_kirchhoff((p, u) in state()) {
        let e = element(p);
        let scale = max_abs(tetrahedron::exact_tangent(&e, &u).to_dense().as_flattened());
        let (a, b) = (StVKFem::forces(&e, &u).unwrap(), tetrahedron::forces(&e, &u));
        prop_assert!(max_difference(a.as_flattened(), b.as_flattened()) < 1e-12 * scale);
        let (a, b) = (StVKFem::energy(&e, &u), tetrahedron::energy(&e, &u));
        prop_assert!((a - b).abs() < 1e-12 * scale);
        for kind in [TangentKind::Exact, TangentKind::GaussNewton] {
            let a = StVKFem::tangent(&e, &u, kind).to_dense();
            let b = tetrahedron::tangent(&e, &u, kind).to_dense();
            let off = max_difference(a.as_flattened(), b.as_flattened());
            prop_assert!(off < 1e-12 * scale, "{kind:?} {off}");
        }
    }

    /// `R` is a rotation, `R^T F` is symmetric, and no rotation near it is closer to `F`.
    #[test]
    fn rotations_are_the_closest_ones((p, u) in state()) {
        for u in degenerate(&p).into_iter().chain([u]) {
            let f = gradient(&p, &u);
            let g = f - DMat3::IDENTITY;
            let g: [f64; 9] = std::array::from_fn(|k| g.row(k / 3)[k % 3]);
            let r = corotational::rotation(&g);
            let narrow = corotational::rotation(&g.map(|x| x as f32));
            let r = DMat3::from_cols_array(&r).transpose();
            let narrow = DMat3::from_cols_array(&narrow.map(f64::from)).transpose();
            for (r, tolerance) in [(r, 1e-11), (narrow, 2e-3)] {
                let off = (r.transpose() * r - DMat3::IDENTITY).to_cols_array();
                prop_assert!(max_abs(&off) < tolerance && r.determinant() > 0.0, "{r}");
                let s = r.transpose() * f;
                let skew = (s - s.transpose()).to_cols_array();
                let size = max_abs(&f.to_cols_array()).max(1e-30);
                prop_assert!(max_abs(&skew) < tolerance * size, "{r} {f}");
                // the stretch with the smallest singular value negative, if one is
                let rows = |i: usize| [s.row(i).x, s.row(i).y, s.row(i).z];
                let (mut values, _) = symmetric_eigen([rows(0), rows(1), rows(2)]);
                values.sort_by(f64::total_cmp);
                prop_assert!(values[0] + values[1] > -tolerance * size, "{values:?}");
            }
        }
    }
}

/// With the rotation held the stiffness is what `Exact` lacks only by the turning term.
#[test]
fn warping_leaves_out_only_the_turning() {
    let p = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 1.1, 0.0], [0.1, 0.3, 0.9]];
    let e = element(p);
    let stretched = p.map(|x| [0.3 * x[0], -0.2 * x[1], 0.1 * x[2]]);
    let exact = Corotational::tangent(&e, &stretched, TangentKind::Exact).to_dense();
    let held = Corotational::tangent(&e, &stretched, TangentKind::GaussNewton).to_dense();
    for kind in [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected] {
        assert_eq!(WarpedStiffness::tangent(&e, &stretched, kind).to_dense(), held);
    }
    let off = max_difference(exact.as_flattened(), held.as_flattened());
    assert!(off > 0.05 * max_abs(exact.as_flattened()), "{off}");
    let stretch = Polar::new(&[0.3, 0.0, 0.0, 0.0, -0.2, 0.0, 0.0, 0.0, 0.1]);
    assert!(max_difference(&stretch.strain, &[0.3, -0.2, 0.1, 0.0, 0.0, 0.0]) < 1e-15);
}

/// Uniform hydrostatic and uniaxial states against closed forms.
#[test]
fn energies_of_plain_states() {
    let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let e = element(p);
    let (lambda, mu, volume) = (e.lambda, e.mu, e.volume);
    for s in [-0.5, 0.2, 0.9, 1.0, 1.3, 4.0_f64] {
        let u = p.map(|x| [(s - 1.0) * x[0], 0.0, 0.0]);
        let d = s - 1.0;
        let cases = [
            (Linear::energy(&e, &u), (lambda / 2.0 + mu) * d * d),
            (Corotational::energy(&e, &u), (lambda / 2.0 + mu) * d * d),
            (StVKFem::energy(&e, &u), (lambda / 2.0 + mu) * ((s * s - 1.0) / 2.0).powi(2)),
            (NeoHookean::energy(&e, &u), {
                let (m, l) = (4.0 / 3.0 * mu, lambda + 5.0 / 6.0 * mu);
                let (i, a) = (s * s + 2.0, 1.0 + 3.0 * m / (4.0 * l));
                let w = |i: f64, j: f64| {
                    m / 2.0 * (i - 3.0) - m / 2.0 * (i + 1.0).ln() + l / 2.0 * (j - a).powi(2)
                };
                w(i, s) - w(3.0, 1.0)
            }),
        ];
        for (k, (found, expected)) in cases.into_iter().enumerate() {
            let error = (found / volume - expected).abs();
            assert!(error < 1e-13 * expected.max(mu), "{k} at {s}: {found} {expected}");
        }
    }
}

/// A strip of tetrahedra over registers against the same functions one element at a time.
fn check_registers<L: TetrahedronLaw, S: Scalar>(count: usize, seed: usize, size: f64) {
    let noise = |k: usize| (((k * 37 + seed * 11) % 97) as f64) / 48.5 - 1.0;
    let points: Vec<DVec3> = (0..count + 3)
        .map(|i| {
            let t = i as f64 * 1.9;
            let n = |k| 0.1 * noise(3 * i + k);
            DVec3::new(t.cos() + n(0), t.sin() + n(1), 0.4 * i as f64 + n(2))
        })
        .collect();
    let lame = LameParameters { lambda: 1.4, mu: 0.6 };
    let nodes = strip_of(&points);
    let rest = |t: &[u32; 4]| RestTetrahedron::new(t.map(|v| points[v as usize].to_array()));
    let element = |t| Element::<S>::new(&rest(t).unwrap(), lame, false);
    let elements: Vec<_> = nodes.iter().map(element).collect();
    // turned, and stretched or mirrored along z, so that rotations are far from the identity
    let turn = DQuat::from_scaled_axis(DVec3::new(0.7, -1.1, 0.4));
    let stretch = if seed.is_multiple_of(2) { 1.2 } else { -0.4 };
    let u: Vec<[S; 4]> = (0..count + 3)
        .map(|i| {
            let x = points[i];
            let n = |k| size * noise(5 * i + k);
            let moved = turn * (x * DVec3::new(1.0, 0.9, stretch)) + DVec3::new(n(0), n(1), n(2));
            let [a, b, c] = (moved - x).to_array();
            [a, b, c, 0.0].map(S::from_f64)
        })
        .collect();
    let columns = Columns::new(&elements, nodes, u);
    for kind in [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected] {
        let expected = Sums::one_by_one::<L, S>(&elements, &columns, kind);
        let scale = expected.stiffness;
        for set in InstructionSet::available() {
            let found = Sums::by_registers::<L, S>(&columns, kind, set);
            let tolerance = 4000.0 * S::EPSILON.to_f64() * scale;
            let name = format!("{} {} {} {kind:?} {count}", L::NAME, set.name(), S::NAME);
            let close = |a: &[f64], b: &[f64], what: &str| {
                assert!(b.iter().all(|x| x.is_finite()), "{what} {name}");
                let error = max_difference(a, b);
                assert!(error < tolerance, "{what} {name}: {error:e} of {scale:e}");
            };
            close(expected.force.as_flattened(), found.force.as_flattened(), "force");
            close(expected.diagonal.as_flattened(), found.diagonal.as_flattened(), "diagonal");
            close(expected.off.as_flattened(), found.off.as_flattened(), "off");
            assert!((expected.energy - found.energy).abs() < tolerance, "energy {name}");
            // an eigenvalue at the threshold may fall on either side
            let [one, other] = [expected.clamped, found.clamped];
            assert!(one.abs_diff(other) <= 1, "{one} {other} {name}");
        }
    }
}

#[test]
fn every_instruction_set_gives_what_single_elements_give() {
    fn each<L: TetrahedronLaw>() {
        for count in [1, 3, 7, 8, 15, 16, 17, 33] {
            for seed in 0..4 {
                for size in [1e-3, 0.1] {
                    check_registers::<L, f64>(count, seed, size);
                    check_registers::<L, f32>(count, seed, size);
                }
            }
        }
    }
    each::<Linear>();
    each::<WarpedStiffness>();
    each::<Corotational>();
    each::<StVKFem>();
    each::<NeoHookean>();
    each::<StVKVolume>();
}
