//! The printed springs of one element against reference vectors (closed forms differentiated automatically).

use glam::DVec3;
use serde_json::Value;
use sinew::models::axes::element::AXIS_PAIRS;
use sinew::models::axes::site::Blocks;
use sinew_papers::axes::attachment::{self, Attachment};
use sinew_papers::axes::springs::{
    AngularForm, AngularSprings, AxialSprings, Curvature, RadialSprings, RadiusSum, VolumeForm,
};
use std::path::PathBuf;

/// Largest distance from a reference that passes, in units of the largest number there.
const TOLERANCE: f64 = 1e-9;

/// Compares with numbers of a case.
fn comparison(case: &Value) -> impl Fn(&str, &[f64], &Value) {
    let name = case["name"].as_str().unwrap();
    move |what, found, expected| {
        let expected = flat(expected);
        assert_eq!(found.len(), expected.len(), "{what} of {name}");
        let unit = expected.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        for (a, b) in found.iter().zip(&expected) {
            // a NaN must not pass
            assert!((a - b).abs() <= TOLERANCE * unit, "{what} of {name}: {a} {b}");
        }
    }
}

fn load() -> Value {
    let path = match std::env::var_os("SINEW_REFERENCE") {
        Some(root) => PathBuf::from(root).join("reference/axis_springs.json"),
        None => PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join("../../models/tests/data/axis_springs.json"),
    };
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap()
}

fn flat(value: &Value) -> Vec<f64> {
    match value.as_array() {
        Some(rows) => rows.iter().flat_map(flat).collect(),
        None => vec![value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))],
    }
}

fn rows<const N: usize, const M: usize>(value: &Value) -> [[f64; M]; N] {
    let flat = flat(value);
    assert_eq!(flat.len(), N * M);
    std::array::from_fn(|i| std::array::from_fn(|j| flat[M * i + j]))
}

fn three(value: &Value) -> [f64; 3] {
    flat(value).try_into().unwrap()
}

fn dense<const N: usize>(blocks: &Blocks<N>) -> Vec<f64> {
    let entry = |i: usize, j: usize| blocks[i / 3][j / 3][3 * (i % 3) + j % 3];
    (0..9 * N * N).map(|k| entry(k / (3 * N), k % (3 * N))).collect()
}

/// What tetrahedra and hexahedra share of a reference case.
fn check_springs<const N: usize>(case: &Value, ends: [Attachment<N>; 3]) {
    let compare = comparison(case);
    let x: [[f64; 3]; N] = rows(&case["deformed"]);
    let v: [[f64; 3]; N] = rows(&case["velocity"]);
    compare("weights", ends.map(|e| e.plus).as_flattened(), &case["weights_plus"]);
    compare("weights", ends.map(|e| e.minus).as_flattened(), &case["weights_minus"]);
    let length = three(&case["rest_chord"]);
    compare("chords", &ends.map(|e| e.length), &case["rest_chord"]);
    let spread = ends.map(|e| e.spread());

    let axial = &case["axial"];
    let springs = AxialSprings {
        spread,
        length,
        stiffness: three(&axial["ks"]),
        damping: three(&axial["kd"]),
    };
    compare("axial energy", &[springs.energy(&x)], &axial["energy"]);
    compare("axial forces", springs.forces(&x).as_flattened(), &axial["forces"]);
    let damping = springs.damping_forces(&x, &v);
    compare("axial damping", damping.as_flattened(), &axial["forces_damping"]);
    let by_matrix: Vec<f64> = dense(&springs.damping_matrix(&x))
        .chunks(3 * N)
        .map(|row| -row.iter().zip(v.as_flattened()).map(|(a, b)| a * b).sum::<f64>())
        .collect();
    compare("damping matrix", &by_matrix, &axial["forces_damping"]);
    for (curvature, key) in [(Curvature::Exact, "hessian"), (Curvature::Definite, "hessian_psd")] {
        compare("axial tangent", &dense(&springs.tangent(&x, curvature)), &axial[key]);
    }

    let angular = &case["angular"];
    assert_eq!(rows::<3, 2>(&angular["pairs"]), AXIS_PAIRS.map(|p| p.map(|i| i as f64)));
    let springs = AngularSprings {
        spread,
        cosine: [0.0; 3],
        printed: three(&angular["k_printed_N"]),
        stiffness: three(&angular["k_energy_J"]),
    };
    let printed = springs.forces(&x, AngularForm::Printed);
    compare("angular forces, printed", printed.as_flattened(), &angular["forces_printed"]);
    // oblique rest angles: section 2.2 of Bourguignon & Cani 2000 once more, `-k (cos - cos_0)` times the other
    // axis on the ends of either
    let cosine = [0.3, -0.5, 0.1];
    let chord = |i: usize| {
        let points = spread[i].iter().zip(&x).map(|(w, x)| *w * DVec3::from_array(*x));
        points.sum::<DVec3>().normalize()
    };
    let mut oblique = [DVec3::ZERO; N];
    for (p, [i, j]) in AXIS_PAIRS.into_iter().enumerate() {
        let (a, b) = (chord(i), chord(j));
        let size = -springs.printed[p] * (a.dot(b) - cosine[p]);
        for (vertex, f) in oblique.iter_mut().enumerate() {
            *f += size * (spread[i][vertex] * b + spread[j][vertex] * a);
        }
    }
    let found = AngularSprings { cosine, ..springs }.forces(&x, AngularForm::Printed);
    let expected: Vec<f64> = oblique.iter().flat_map(|f| f.to_array()).collect();
    compare("oblique angular forces, printed", found.as_flattened(), &expected.into());
    let centre = (0..3).map(|k| x.iter().map(|x| x[k]).sum::<f64>() / N as f64);
    let centre = DVec3::from_slice(&centre.collect::<Vec<_>>());
    let torque = |f: &[[f64; 3]; N]| {
        let arms = x.iter().zip(f);
        let each = arms.map(|(x, f)| (DVec3::from_array(*x) - centre).cross(DVec3::from_array(*f)));
        each.sum::<DVec3>().to_array()
    };
    compare("printed moment", &torque(&printed), &angular["net_torque_printed"]);
    compare("angular energy", &[springs.energy(&x)], &angular["energy"]);
    let forces = springs.forces(&x, AngularForm::Energy);
    compare("angular forces", forces.as_flattened(), &angular["forces"]);
    for (curvature, key) in
        [(Curvature::Exact, "hessian"), (Curvature::GaussNewton, "hessian_gauss_newton")]
    {
        compare("angular tangent", &dense(&springs.tangent(&x, curvature)), &angular[key]);
    }
}

#[test]
fn springs_are_those_of_the_reference() {
    let data = load();
    let (mut tetrahedra, mut hexahedra) = (0, 0);
    for case in data["cases"].as_array().unwrap() {
        let compare = comparison(case);
        let axes: [[f64; 3]; 3] = rows(&case["axes"]);
        let volume = &case["volume"];
        let k = volume["k"].as_f64().unwrap();
        if case["kind"] == "hex" {
            hexahedra += 1;
            let rest: [[f64; 3]; 8] = rows(&case["rest"]);
            let points = rest.map(DVec3::from_array);
            let ends = axes.map(|a| attachment::hexahedron(points, a.into()).unwrap());
            check_springs(case, ends);
            let (x, v) = (rows::<8, 3>(&case["deformed"]), rows::<8, 3>(&case["velocity"]));
            let springs = RadialSprings {
                rest: flat(&volume["rest_radii"]).try_into().unwrap(),
                stiffness: k,
                damping: volume["kd"].as_f64().unwrap(),
            };
            let printed = springs.forces(&x, VolumeForm::Printed);
            compare("volume, printed", printed.as_flattened(), &volume["forces_printed"]);
            let balanced = springs.forces(&x, VolumeForm::Balanced);
            compare("volume forces", balanced.as_flattened(), &volume["forces"]);
            compare("volume energy", &[springs.energy(&x)], &volume["energy"]);
            let damping = springs.damping_forces(&x, &v, VolumeForm::Printed);
            let expected = &volume["forces_printed_damping"];
            compare("volume damping", damping.as_flattened(), expected);
            let damping = springs.damping_forces(&x, &v, VolumeForm::Balanced);
            let expected = &volume["forces_damping_balanced"];
            compare("volume damping", damping.as_flattened(), expected);
            let tangent = dense(&springs.tangent(&x, Curvature::Exact));
            compare("volume tangent", &tangent, &volume["hessian"]);
            continue;
        }
        tetrahedra += 1;
        let rest: [[f64; 3]; 4] = rows(&case["rest"]);
        let points = rest.map(DVec3::from_array);
        let ends = axes.map(|a| attachment::tetrahedron(points, a.into()).unwrap());
        check_springs(case, ends);
        let x = rows::<4, 3>(&case["deformed"]);
        let springs = RadiusSum { rest: volume["rest_sum"].as_f64().unwrap(), stiffness: k };
        let printed = springs.forces(&x, VolumeForm::Printed);
        compare("volume, printed", printed.as_flattened(), &volume["forces_printed"]);
        let net: [f64; 3] = std::array::from_fn(|k| printed.iter().map(|f| f[k]).sum());
        compare("volume, net force", &net, &volume["net_force_printed"]);
        let balanced = springs.forces(&x, VolumeForm::Balanced);
        compare("volume forces", balanced.as_flattened(), &volume["forces"]);
        compare("volume energy", &[springs.energy(&x)], &volume["energy"]);
        for (curvature, key) in
            [(Curvature::Exact, "hessian"), (Curvature::GaussNewton, "hessian_gauss_newton")]
        {
            let tangent = dense(&springs.tangent(&x, curvature));
            compare("volume tangent", &tangent, &volume[key]);
        }
    }
    assert_eq!((tetrahedra, hexahedra), (5, 5));
}
