//! Numbers that cuts are made of: where edges and blades cross, quadrature of what is left of an element.

use glam::{DMat3, DVec3};
use proptest::prelude::*;
use sinew_engine::isoparametric::{Derivatives, TETRAHEDRON10_MASSES};
use sinew_models::cutting::blade::{EdgeMove, crossing, roots};
use sinew_models::cutting::quadrature::{eliminate, fine, square_root};
use sinew_models::cutting::ten_node::piece;

proptest! {
    #[test]
    fn roots_of_a_cubic_are_all_found(mut own in prop::array::uniform3(0.02..0.98_f64), lead in 0.1..5.0_f64) {
        own.sort_by(f64::total_cmp);
        prop_assume!(own[1] - own[0] > 1e-3 && own[2] - own[1] > 1e-3);
        let [x, y, z] = own;
        let of = [-lead * x * y * z, lead * (x * y + y * z + z * x), -lead * (x + y + z), lead];
        for (found, exact) in roots(of).into_iter().zip(own) {
            prop_assert!((found.unwrap() - exact).abs() < 1e-9);
        }
    }
}

/// A blade crosses an edge while both move: the same place whoever moves.
#[test]
fn a_blade_and_tissue_cross_whoever_moves() {
    let edge = [DVec3::ZERO, DVec3::X];
    let still = |x: DVec3| [x, x];
    let shift = DVec3::new(0.3, 1.0, 0.2);
    let from = [DVec3::new(0.2, -0.5, -1.0), DVec3::new(0.2, -0.5, 1.0)];
    let into = DVec3::Y;
    let moving = EdgeMove { before: from, after: from.map(|x| x + shift), into };
    let one = crossing(edge.map(still), [DVec3::ZERO; 2], &moving).unwrap();
    let back = |x: DVec3| [x, x - shift];
    let stays = EdgeMove { before: from, after: from, into };
    let two = crossing(edge.map(back), [DVec3::ZERO; 2], &stays).unwrap();
    assert!((one - 0.35).abs() < 1e-12 && (two - one).abs() < 1e-12, "{one} {two}");
    let beside = EdgeMove { before: from, after: from.map(|x| x + 0.4 * shift), into };
    assert_eq!(crossing(edge.map(still), [DVec3::ZERO; 2], &beside), None);
}

#[test]
fn roots_squared_are_what_they_are_of() {
    let a = DMat3::from_cols_array(&[2.0, 0.3, -0.1, 0.3, 1.0, 0.2, -0.1, 0.2, 1e-9]);
    let m = a * a.transpose();
    let root = square_root(m);
    let off = (root * root - m).to_cols_array().iter().fold(0.0_f64, |s, x| s.max(x.abs()));
    assert!(
        off < 1e-14 && (root - root.transpose()).to_cols_array().iter().all(|x| x.abs() < 1e-14)
    );
}

#[test]
fn eight_points_have_the_moments_of_all() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::new(0.3, 1.0, 0.0), DVec3::new(0.1, 0.2, 0.7)];
    let at = |l: [f64; 4]| (0..4).map(|i| l[i] * corners[i]).sum::<DVec3>();
    let all: Vec<(DVec3, f64)> = fine().into_iter().map(|(l, w)| (at(l), w)).collect();
    let few = eliminate(&all);
    assert!(few.len() == 8 && few.iter().all(|(_, w)| *w > 0.0));
    let sum = |points: &[(DVec3, f64)], moment: fn(DVec3) -> f64| {
        points.iter().map(|(x, w)| w * moment(*x)).sum::<f64>()
    };
    for moment in [
        |_: DVec3| 1.0,
        |x: DVec3| x.x,
        |x: DVec3| x.y * x.z,
        |x: DVec3| x.z * x.x,
        |x: DVec3| x.x * x.y * x.z,
    ] {
        assert!((sum(&few, moment) - sum(&all, moment)).abs() < 1e-14);
    }
    let square = |x: DVec3| x.length_squared();
    assert!((sum(&few, square) / sum(&all, square) - 1.0).abs() < 0.1);
    // the rule itself: int x^7 over the tetrahedron of unit edges, 6 * 7! / 10!
    let sum: f64 = fine().iter().map(|(l, w)| w * l[1].powi(7)).sum();
    assert!((sum / (6.0 * 5040.0 / 3_628_800.0) - 1.0).abs() < 1e-13);
}

#[test]
fn a_whole_element_has_its_gauss_points_and_masses() {
    let unit = |i: usize| std::array::from_fn(|j| f64::from(u8::from(i == j)));
    let (derivatives, lumps) = piece(&[([0, 1, 2, 3].map(unit), 1.0)], 2.0);
    let known = Derivatives::<f64, 10, 3, 4>::tetrahedron10();
    for (a, b) in derivatives
        .0
        .as_flattened()
        .as_flattened()
        .iter()
        .zip(known.0.as_flattened().as_flattened())
    {
        assert!((a - b).abs() < 1e-14, "{a} {b}");
    }
    for (a, part) in TETRAHEDRON10_MASSES.into_iter().enumerate() {
        assert!((lumps.mass[a] - 2.0 * part).abs() < 1e-14);
        let weight = if a < 4 { -0.05 } else { 0.2 };
        assert!((lumps.weight[a] - 2.0 * weight).abs() < 1e-14);
    }
}
