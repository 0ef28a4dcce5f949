//! Against the stored stiffness matrices, fits, masses and closed forms.
//!
//! 2-norm fits are compared by their norm: the minimiser is flat.

use crate::json::{flat, number, numbers, points};
use nalgebra::DMatrix;
use serde_json::Value;
use sinew_identify::error_metrics::position_errors;
use sinew_identify::mass::{MassLumping, lumped_masses};
use sinew_identify::stiffness::element_stiffness;
use sinew_identify::{
    ElementFit, ElementGeometry, ElementKind, ElementMethod, LinearMaterial, Plane, Section,
    fit_element,
};

fn load(text: &str) -> Value {
    serde_json::from_str(text).expect("reference data")
}

fn lem() -> Value {
    load(include_str!("data/lem_fits.json"))
}

struct Case {
    name: String,
    value: Value,
    geometry: ElementGeometry,
    material: LinearMaterial,
    section: Section,
}

impl Case {
    fn fit(&self, method: ElementMethod) -> ElementFit {
        fit_element(&self.geometry, &self.material, &self.section, method)
            .unwrap_or_else(|e| panic!("{}: {method}: {e}", self.name))
    }

    fn stiffness(&self) -> DMatrix<f64> {
        element_stiffness(&self.geometry, &self.material, &self.section).expect("stiffness")
    }

    fn expected(&self, key: &str) -> Vec<f64> {
        numbers(&self.value[key])
    }

    fn number(&self, key: &str) -> f64 {
        number(&self.value[key])
    }

    /// Springs meet the stiffness exactly, to rounding.
    fn exact(&self) -> bool {
        self.number("two_norm_rel") < 1e-12
    }
}

fn cases() -> Vec<Case> {
    let file = lem();
    let cases = file["cases"].as_array().expect("cases").iter().map(|value| {
        let kind = match value["kind"].as_str().expect("kind") {
            "tri" => ElementKind::Triangle,
            "quad_paper" => ElementKind::Quad,
            "tet" => ElementKind::Tetrahedron,
            "hex" => ElementKind::Hexahedron,
            other => panic!("kind {other}"),
        };
        let nodes = points(&value["nodes"]);
        let geometry = if kind.dimension() == 2 {
            let nodes: Vec<_> = nodes.iter().map(|n| [n[0], n[1]]).collect();
            ElementGeometry::planar(kind, &nodes)
        } else {
            ElementGeometry::new(kind, &nodes)
        };
        let number = |key: &str| number(&value[key]);
        let plane = if value["mode"] == "plane_strain" { Plane::Strain } else { Plane::Stress };
        Case {
            name: value["name"].as_str().expect("name").to_owned(),
            geometry: geometry.expect("geometry"),
            material: LinearMaterial::new(number("E"), number("nu")).expect("material"),
            section: Section { plane, thickness: number("thickness") },
            value: value.clone(),
        }
    });
    let cases: Vec<_> = cases.collect();
    assert_eq!(cases.len(), 31);
    cases
}

#[track_caller]
fn assert_close(name: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{name}");
    let scale = expected.iter().fold(0f64, |m, e| m.max(e.abs()));
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((f - e).abs() <= tolerance * scale, "{name}[{i}]: {f} instead of {e}");
    }
}

#[test]
fn stiffness_and_masses() {
    for case in cases() {
        let expected = flat(&case.value["fem_stiffness"]);
        // symmetric, so the order of rows and columns does not matter
        assert_close(&case.name, case.stiffness().as_slice(), &expected, 1e-12);
        let density = case.number("rho");
        for (key, lumping) in
            [("mass_nodal", MassLumping::NodalQuadrature), ("mass_rowsum", MassLumping::RowSum)]
        {
            let masses =
                lumped_masses(&case.geometry, density, &case.section, lumping).expect("masses");
            assert_close(&case.name, &masses, &case.expected(key), 1e-12);
        }
        assert_close(&case.name, &[case.geometry.measure()], &[case.number("measure")], 1e-12);
    }
}

#[test]
fn frobenius_fits() {
    for case in cases() {
        let fit = case.fit(ElementMethod::Frobenius);
        assert_close(&case.name, &fit.constants, &case.expected("k_frobenius"), 1e-9);
        let expected = case.number("frobenius_rel_residual");
        assert!((fit.frobenius_residual - expected).abs() < 1e-12, "{}", case.name);
        assert_eq!(fit.negative > 0, case.value["any_negative"] == true, "{}", case.name);
    }
}

#[test]
fn block_fits() {
    for case in cases() {
        let fit = case.fit(ElementMethod::Block);
        assert_close(&case.name, &fit.constants, &case.expected("k_offdiag"), 1e-9);
    }
}

#[test]
fn nonnegative_fits() {
    let mut bound = 0;
    for case in cases() {
        let fit = case.fit(ElementMethod::Nonnegative);
        assert_close(&case.name, &fit.constants, &case.expected("k_frobenius_nonneg"), 1e-9);
        assert!(fit.constants.iter().all(|&k| k >= 0.0), "{}", case.name);
        bound += fit.constants.iter().filter(|&&k| k == 0.0).count();
    }
    assert!(bound > 0, "some constraints are active");
}

#[test]
fn two_norm_fits_reach_the_stored_optima_and_prove_it() {
    for case in cases() {
        let fit = case.fit(ElementMethod::TwoNorm);
        let scale = case.number("two_norm") / case.number("two_norm_rel");
        let bound = fit.two_norm_bound.expect("a certificate");
        if case.exact() {
            assert!(fit.two_norm_residual < 1e-13, "{}", case.name);
            continue;
        }
        let (norm, bound) = (fit.two_norm_residual * scale, bound * scale);
        let (best, lower) = (case.number("two_norm"), case.number("two_norm_lower_bound"));
        assert!(norm <= best * (1.0 + 1e-6), "{}: {norm} above the stored {best}", case.name);
        assert!(norm >= lower * (1.0 - 1e-12), "{}: {norm} below the bound {lower}", case.name);
        assert!(bound <= best * (1.0 + 1e-12), "{}: {bound} is no bound of {best}", case.name);
        assert!(bound >= norm * (1.0 - 2e-8), "{}: certificate {bound} of {norm}", case.name);
    }
}

#[test]
fn nonnegative_two_norm_fits() {
    for case in cases() {
        let free = case.fit(ElementMethod::TwoNorm);
        let fit = case.fit(ElementMethod::TwoNormNonnegative);
        assert!(fit.constants.iter().all(|&k| k >= 0.0), "{}", case.name);
        if case.exact() {
            continue;
        }
        let bound = fit.two_norm_bound.expect("a certificate");
        assert!(fit.two_norm_residual - bound <= 2e-8 * bound, "{}", case.name);
        let (free_norm, free_bound) =
            (free.two_norm_residual, free.two_norm_bound.expect("a certificate"));
        assert!(fit.two_norm_residual >= free_bound * (1.0 - 1e-12), "{}", case.name);
        if free.constants.iter().all(|&k| k >= 0.0) {
            assert!(fit.two_norm_residual <= free_norm * (1.0 + 1e-6), "{}", case.name);
        }
        // no non-negative constants at hand do better
        let other = case.fit(ElementMethod::Nonnegative).two_norm_residual;
        assert!(bound <= other * (1.0 + 1e-12), "{}", case.name);
    }
}

#[test]
fn errors_of_positions() {
    let file = lem();
    let metrics = &file["error_metrics"];
    let [rest, fem, found] = ["rest", "fem", "lem"].map(|key| points(&metrics[key]));
    let errors = position_errors(&rest, &fem, &found).expect("errors");
    for (found, key) in [
        (errors.rms_percent, "e_rms_percent"),
        (errors.max_percent, "e_max_percent"),
        (errors.largest_displacement, "o_max"),
    ] {
        let expected = number(&metrics[key]);
        assert!((found - expected).abs() < 1e-12 * expected, "{key}: {found}");
    }
}

#[test]
fn closed_forms() {
    let file = load(include_str!("data/baselines.json"));
    let section = Section::default();
    let mut compared = 0;
    for case in file["cases"].as_array().expect("cases") {
        let name = case["name"].as_str().expect("name");
        let number = |key: &str| number(&case[key]);
        let modulus = case.get("E_2d").or(case.get("E")).and_then(Value::as_f64).expect("modulus");
        let nu = case.get("nu").and_then(Value::as_f64).unwrap_or(0.3);
        let material = LinearMaterial::new(modulus, nu).expect("material");
        let (kind, nodes) = match case["kind"].as_str().expect("kind") {
            "tri" => (ElementKind::Triangle, points(&case["nodes"])),
            "tet" => (ElementKind::Tetrahedron, points(&case["nodes"])),
            "rect" => (ElementKind::Quad, scaled(&QUAD, [number("l"), number("h"), 0.0])),
            "cube" => (ElementKind::Hexahedron, scaled(&HEXAHEDRON, [number("a"); 3])),
            other => panic!("kind {other}"),
        };
        let geometry = ElementGeometry::new(kind, &nodes).expect("geometry");
        let mut check = |method, expected: Vec<f64>| {
            let fit = fit_element(&geometry, &material, &section, method).expect("constants");
            assert_close(name, &fit.constants, &expected, 1e-12);
            compared += 1;
        };
        match kind {
            ElementKind::Triangle => {
                check(ElementMethod::VanGelder, numbers(&case["van_gelder_simple"]));
                check(ElementMethod::VanGelderFull, numbers(&case["van_gelder_full"]));
                check(ElementMethod::Lloyd, numbers(&case["lloyd"]));
            }
            ElementKind::Tetrahedron => {
                check(ElementMethod::VanGelder, numbers(&case["van_gelder_3d"]));
                check(ElementMethod::Lloyd, numbers(&case["lloyd"]));
            }
            ElementKind::Quad => {
                let [l, h, d] =
                    ["along_l", "along_h", "diag"].map(|part| number(&format!("baudet_k_{part}")));
                check(ElementMethod::Baudet, vec![l, d, h, h, d, l]);
                let (side, d) = (number("lloyd_edge"), number("lloyd_diag"));
                check(ElementMethod::Lloyd, vec![side, d, side, side, d, side]);
            }
            ElementKind::Hexahedron => {
                let (edge, body) = (number("baudet_k_edge"), number("baudet_k_body_diag"));
                let expected = sinew_identify::springs::pairs(8).map(|(a, b)| {
                    match (0..3).filter(|&d| HEXAHEDRON[a][d] != HEXAHEDRON[b][d]).count() {
                        1 => edge,
                        3 => body,
                        _ => 0.0,
                    }
                });
                check(ElementMethod::Baudet, expected.collect());
            }
        }
    }
    assert_eq!(compared, 4 * 3 + 3 * 2 + 9 * 2 + 3);
}

const QUAD: [[f64; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
const HEXAHEDRON: [[f64; 3]; 8] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 0.0, 1.0],
    [1.0, 1.0, 1.0],
    [0.0, 1.0, 1.0],
];

fn scaled(nodes: &[[f64; 3]], s: [f64; 3]) -> Vec<[f64; 3]> {
    nodes.iter().map(|n| [n[0] * s[0], n[1] * s[1], n[2] * s[2]]).collect()
}

/// Delingette's tensile springs against the vectors of the solid and membrane laws.
#[test]
fn tensile_springs_of_delingette() {
    let triangles = load(include_str!("../../tests/data/triangles.json"));
    for case in triangles["cases"].as_array().expect("cases") {
        let nodes = points(&case["rest"]);
        let number = |key: &str| number(&case[key]);
        let material = LinearMaterial::new(number("E_2d"), number("nu")).expect("material");
        let geometry = ElementGeometry::new(ElementKind::Triangle, &nodes).expect("geometry");
        let section = Section::default();
        let fit =
            fit_element(&geometry, &material, &section, ElementMethod::Delingette).expect("fit");
        // stored: edge i opposite vertex i; ours: 01 02 12
        let stored = numbers(&case["mass_spring"]["spring_constant"]);
        let expected = [stored[2], stored[1], stored[0]];
        assert_close(case["name"].as_str().expect("name"), &fit.constants, &expected, 1e-9);
    }
    let tetrahedra = load(include_str!("../../tests/data/tetrahedra.json"));
    for case in tetrahedra["cases"].as_array().expect("cases") {
        let nodes = points(&case["rest"]);
        let number = |key: &str| number(&case[key]);
        let material = LinearMaterial::new(number("E"), number("nu")).expect("material");
        let geometry = ElementGeometry::new(ElementKind::Tetrahedron, &nodes).expect("geometry");
        let section = Section::default();
        let fit =
            fit_element(&geometry, &material, &section, ElementMethod::Delingette).expect("fit");
        let expected = numbers(&case["mass_spring"]["spring_constant"]);
        assert_close(case["name"].as_str().expect("name"), &fit.constants, &expected, 1e-9);
        assert!(fit.constants.iter().all(|&k| k > 0.0));
    }
}
