//! Bodies whose material varies from tetrahedron to tetrahedron.

use crate::common::*;
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew::models::body::{BodyError, Evaluation};
use sinew::models::material::field::FieldError;
use sinew::prelude::*;

const KINDS: [(Model, Evaluation); 6] = [
    (Model::StVK, Evaluation::Fused),
    (Model::CompressibleStVK, Evaluation::Fused),
    (Model::StVK, Evaluation::Pooled),
    (Model::CompressibleStVK, Evaluation::Pooled),
    (Model::QuadraticSprings, Evaluation::Fused),
    (Model::MassSpring, Evaluation::Fused),
];

/// Mean of the four corners.
fn centroid(mesh: &Mesh, t: [u32; 4]) -> DVec3 {
    t.iter().map(|&v| mesh.points[v as usize]).sum::<DVec3>() / 4.0
}

/// Forces and masses of a displaced body.
fn forces(description: &BodyDescription) -> (f64, Vec<DVec3>, Vec<f64>) {
    let (mut simulation, body) = alone(SimulationOptions::default(), description);
    disturb(&mut simulation, body, 2e-3, 11);
    (simulation.evaluate(), simulation.elastic_forces(body), simulation.masses(body))
}

#[test]
fn a_constant_field_gives_the_same_bits() {
    let mesh = jittered_box([0.1, 0.05, 0.05], [4, 2, 2]);
    let n = mesh.tetrahedra.len();
    let material = soft(2e4, 0.37);
    let (e, nu, rho) = (vec![2e4; n], vec![0.37; n], vec![1000.0; n]);
    for (model, evaluation) in KINDS {
        let plain =
            BodyDescription { model, evaluation, ..BodyDescription::new("a", &mesh, material) };
        let base = YoungPoisson { young_modulus: 1.0, poisson_ratio: 0.0, density: 1.0 };
        let field = BodyDescription {
            young_modulus: Some(&e),
            poisson_ratio: Some(&nu),
            density: Some(&rho),
            material: base,
            ..plain.clone()
        };
        assert_eq!(forces(&plain), forces(&field), "{model:?} {evaluation:?}");
    }
}

/// Every element's own stiffness: the forces of a body with a field are the sum of those of its
/// halves, each as a body of its own.
#[test]
fn halves_add_up() {
    let mesh = jittered_box([0.1, 0.05, 0.05], [4, 2, 2]);
    let n = mesh.tetrahedra.len();
    let left = |t: &[u32; 4]| centroid(&mesh, *t).x < 0.05;
    let pick = |a: f64, b: f64| -> Vec<f64> {
        mesh.tetrahedra.iter().map(|t| if left(t) { a } else { b }).collect()
    };
    let (e, nu, rho) = (pick(1e4, 9e4), pick(0.2, 0.45), pick(900.0, 1800.0));
    assert!(e.contains(&1e4) && e.contains(&9e4) && e.len() == n);
    for (model, evaluation) in KINDS {
        let whole = BodyDescription {
            young_modulus: Some(&e),
            poisson_ratio: Some(&nu),
            density: Some(&rho),
            model,
            evaluation,
            ..BodyDescription::new("a", &mesh, soft(1.0, 0.0))
        };
        let (energy, f, m) = forces(&whole);
        let mut sums = (0.0, vec![DVec3::ZERO; f.len()], vec![0.0; f.len()]);
        for (side, e, nu, density) in [(true, 1e4, 0.2, 900.0), (false, 9e4, 0.45, 1800.0)] {
            let half: Vec<_> =
                mesh.tetrahedra.iter().copied().filter(|t| left(t) == side).collect();
            let material = YoungPoisson { young_modulus: e, poisson_ratio: nu, density };
            let part = BodyDescription { tetrahedra: &half, material, ..whole.clone() };
            let part =
                BodyDescription { young_modulus: None, poisson_ratio: None, density: None, ..part };
            let (energy, f, m) = forces(&part);
            sums.0 += energy;
            sums.1.iter_mut().zip(f).for_each(|(sum, f)| *sum += f);
            sums.2.iter_mut().zip(m).for_each(|(sum, m)| *sum += m);
        }
        assert!((sums.0 - energy).abs() < 1e-13 * energy, "{model:?} {evaluation:?}");
        let error = max_distance(&sums.1, &f) / max_length(&f);
        assert!(error < 1e-13, "{model:?} {evaluation:?}: {error:e}");
        let error = sums.2.iter().zip(&m).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(error < 1e-15 * m.iter().sum::<f64>(), "{error:e}");
    }
}

/// Two materials in series, stretched by a fifth: without lateral contraction (nu = 0) the bar is a
/// one-dimensional one, and both halves carry `P = E (s^3 - s)/2`.
#[test]
fn two_materials_in_series() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 2, 2]);
    // jitter moves inner vertices only in part: the plane between the materials must stay one
    let mut mesh = mesh;
    let plain = sinew::engine::mesh::generate::box_tets(DVec3::new(0.2, 0.05, 0.05), [8, 2, 2]);
    for (x, plain) in mesh.points.iter_mut().zip(&plain.unwrap().points) {
        if (plain.x - 0.1).abs() < 1e-9 {
            *x = *plain;
        }
    }
    let (soft_modulus, stiff) = (1e4, 5e4);
    let e: Vec<f64> = mesh
        .tetrahedra
        .iter()
        .map(|&t| if centroid(&mesh, t).x < 0.1 { soft_modulus } else { stiff })
        .collect();
    let description = BodyDescription {
        young_modulus: Some(&e),
        ..BodyDescription::new("bar", &mesh, soft(1.0, 0.0))
    };
    let (mut simulation, body) = alone(SimulationOptions::default(), &description);
    simulation.set_gravity(DVec3::ZERO);
    clamp(&mut simulation, body, &mesh, "x0");
    let pull = Motion::Translate(DVec3::new(0.04, 0.0, 0.0));
    let end = drive(&mut simulation, body, &mesh, "x1", pull, Curve::Constant);
    simulation.set_dt(1.0);
    simulation.set_solver(solver!(
        Integrator::QuasiStatic,
        newton_tolerance = 1e-12,
        linear_tolerance = 1e-10
    ));
    simulation.step().unwrap();
    // stretches with equal stress: bisection
    let stress = |e: f64, s: f64| e * (s * s * s - s) / 2.0;
    let (mut low, mut high) = (1.0, 1.4);
    for _ in 0..60 {
        let s = 0.5 * (low + high);
        let other = 2.4 - s;
        if stress(soft_modulus, s) < stress(stiff, other) { low = s } else { high = s }
    }
    let u = simulation.displacements(body);
    for (x, u) in mesh.points.iter().zip(&u).filter(|(x, _)| (x.x - 0.1).abs() < 1e-9) {
        let expected = 0.1 * (low - 1.0);
        assert!((u.x - expected).abs() < 1e-9 * 0.2, "{x}: {} against {expected}", u.x);
        assert!(u.y.abs() + u.z.abs() < 1e-9 * 0.2);
    }
    simulation.evaluate();
    let force = simulation.reaction(end).unwrap().x;
    let expected = stress(soft_modulus, low) * 0.05 * 0.05;
    assert!((force - expected).abs() < 1e-9 * expected, "{force} against {expected}");
}

#[test]
fn bad_fields_are_refused_with_the_tetrahedron() {
    let mesh = jittered_box([0.1, 0.05, 0.05], [2, 1, 1]);
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    let plain = BodyDescription::new("liver", &mesh, soft(1e4, 0.3));
    let mut e = vec![1e4; mesh.tetrahedra.len()];
    e[7] = -2.0;
    let error = simulation
        .add_body(&BodyDescription { young_modulus: Some(&e), ..plain.clone() })
        .unwrap_err();
    let message = error.to_string();
    assert!(message.contains("`liver`") && message.contains("tetrahedron 7"), "{message}");
    let error = simulation
        .add_body(&BodyDescription { density: Some(&e[..3]), ..plain.clone() })
        .unwrap_err();
    assert!(
        matches!(error, BodyError::Material { source: FieldError::Length { found: 3, .. }, .. }),
        "{error}"
    );
    assert!(simulation.topology().bodies.is_empty());
    simulation.add_body(&plain).unwrap();
}
