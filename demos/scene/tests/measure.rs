//! Strain, stress and energy that pictures show.

use glam::{DMat3, DVec3};
use sinew::models::material::{LameParameters, YoungPoisson};
use sinew_scene::picture::{measures, sheet_measures};

const LAME: LameParameters = LameParameters { lambda: 3.0, mu: 2.0 };

#[test]
fn a_uniaxial_stretch_has_its_textbook_measures() {
    let g = DMat3::from_diagonal(DVec3::new(0.2, 0.0, 0.0));
    let [strain, stress, energy, ratio] = measures(g, LAME);
    let e = 0.5 * (1.2f64.powi(2) - 1.0);
    assert!((strain - e).abs() < 1e-14);
    assert!((ratio - 1.2).abs() < 1e-14);
    assert!((energy - (0.5 * 3.0 + 2.0) * e * e).abs() < 1e-14);
    // Cauchy: 1.44 S_x / 1.2 along, S_y / 1.2 across
    let along = 1.44 * (3.0 + 4.0) * e / 1.2;
    let across = 3.0 * e / 1.2;
    assert!((stress - (along - across)).abs() < 1e-12);
}

#[test]
fn rotations_have_no_strain_and_keep_the_stress() {
    let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-1.1);
    let [strain, stress, energy, ratio] = measures(turn - DMat3::IDENTITY, LAME);
    assert!(strain.abs() < 1e-14 && stress < 1e-13 && energy < 1e-25);
    assert!((ratio - 1.0).abs() < 1e-14);
    let stretch = DMat3::from_cols_array(&[1.1, 0.1, 0.0, 0.05, 0.9, 0.2, 0.0, 0.1, 1.0]);
    let plain = measures(stretch - DMat3::IDENTITY, LAME);
    let turned = measures(turn * stretch - DMat3::IDENTITY, LAME);
    for k in 0..4 {
        assert!((plain[k] - turned[k]).abs() < 1e-12, "{k}");
    }
}

#[test]
fn a_sheet_measures_as_a_solid_whose_thickness_follows() {
    // plane stress at small strain: sigma = E e along a free stretch
    let (young, nu) = (100.0, 0.3);
    let material = YoungPoisson { young_modulus: young, poisson_ratio: nu, density: 1.0 };
    let LameParameters { lambda, mu } = material.lame().unwrap();
    let lame = LameParameters { lambda: 2.0 * lambda * mu / (lambda + 2.0 * mu), mu };
    let rest = [DVec3::ZERO, DVec3::new(2.0, 1.0, 0.0), DVec3::new(-0.5, 1.5, 0.3)];
    let (x, e) = (DVec3::new(2.0, 1.0, 0.0).normalize(), 1e-6);
    let normal = (rest[1] - rest[0]).cross(rest[2] - rest[0]).normalize();
    let y = normal.cross(x);
    let u = rest.map(|p| (x * p.dot(x) - y * (nu * p.dot(y))) * e);
    let [strain, stress, energy, ratio] = sheet_measures(lame, rest, u);
    assert!((strain / e - 1.0).abs() < 1e-4);
    assert!((stress / (young * e) - 1.0).abs() < 1e-4);
    assert!((energy / (0.5 * young * e * e) - 1.0).abs() < 1e-4);
    assert!((ratio - 1.0 - (1.0 - nu) * e).abs() < 1e-10);
}
