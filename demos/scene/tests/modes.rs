//! Modes of free vibration.

use glam::DVec3;
use sinew::engine::mesh::generate::box_tets;
use sinew::models::body::{BodyDescription, Model};
use sinew::models::material::YoungPoisson;
use sinew::simulation::{Simulation, SimulationOptions};
use sinew_scene::modes::{modes, ritz};

#[test]
fn small_eigenproblems_are_solved() {
    let a = vec![vec![2.0, -1.0, 0.3], vec![-1.0, 3.0, 0.1], vec![0.3, 0.1, 1.0]];
    let b = vec![vec![2.0, 0.5, 0.0], vec![0.5, 1.0, 0.2], vec![0.0, 0.2, 4.0]];
    let (values, vectors) = ritz(a.clone(), b.clone()).unwrap();
    assert!(values[0] <= values[1] && values[1] <= values[2]);
    for k in 0..3 {
        for i in 0..3 {
            let times = |m: &[Vec<f64>]| -> f64 { (0..3).map(|j| m[i][j] * vectors[j][k]).sum() };
            assert!((times(&a) - values[k] * times(&b)).abs() < 1e-13);
        }
    }
}

/// A bar without lateral contraction, held along y and z by symmetry of its first axial mode.
#[test]
fn a_bar_rings_at_its_frequency() {
    let mesh = box_tets(DVec3::new(1.0, 0.05, 0.05), [40, 1, 1]).unwrap();
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.0, density: 1000.0 };
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    let description =
        BodyDescription { model: Model::Linear, ..BodyDescription::new("bar", &mesh, material) };
    let body = simulation.add_body(&description).unwrap();
    let held = mesh.group("x0").unwrap().vertices.clone();
    let (modes, _) = modes(&mut simulation, body, &held, 8).unwrap();
    assert!(modes.windows(2).all(|m| m[0].frequency <= m[1].frequency));
    // bending comes in lower, equal or nearly equal pairs; the axial mode is the one that moves along x
    let axial = modes.iter().find(|m| {
        let along: f64 = m.shape.iter().map(|u| u.x * u.x).sum();
        along > 0.9 * m.shape.iter().map(|u| u.length_squared()).sum::<f64>()
    });
    let expected = (1e4f64 / 1000.0).sqrt() / 4.0;
    let found = axial.expect("an axial mode").frequency;
    // lumped masses are below the truth by (pi h/4L)^2/6 here; the mesh is irregular across
    assert!((found / expected - 1.0).abs() < 2e-3, "{found} against {expected}");
}
