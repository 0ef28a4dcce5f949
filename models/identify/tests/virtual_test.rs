//! Virtual tests: linear finite elements against stored solutions, springs against finite elements.

use crate::json::{indices, number, numbers, points};
use crate::mesh::grid;
use serde_json::Value;
use sinew_identify::baselines::baudet_tension_correction;
use sinew_identify::cells::Cells;
use sinew_identify::error_metrics::position_errors;
use sinew_identify::mesh::{FittedSprings, fit_elements};
use sinew_identify::virtual_test::facets::{facets_within, loose_nodes, nodes_at, traction_forces};
use sinew_identify::virtual_test::gauge::tensile_moduli;
use sinew_identify::virtual_test::{
    Loading, SpringOptions, VirtualTestError, dimension, finite_elements, linear_springs,
    rest_length_springs,
};
use sinew_identify::{ElementMethod, LinearMaterial, Plane, Section};

struct Case {
    name: String,
    points: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    fours: Vec<[u32; 4]>,
    hexahedra: Vec<[u32; 8]>,
    quads: bool,
    material: LinearMaterial,
    loading: Loading,
    u: Vec<[f64; 3]>,
    value: Value,
}

impl Case {
    fn cells(&self) -> Cells<'_> {
        Cells {
            triangles: &self.triangles,
            quads: if self.quads { &self.fours } else { &[] },
            tetrahedra: if self.quads { &[] } else { &self.fours },
            hexahedra: &self.hexahedra,
        }
    }
}

fn rows(value: &Value) -> Vec<Vec<f64>> {
    value.as_array().expect("rows").iter().map(numbers).collect()
}

fn cells<const N: usize>(value: &Value, kind: &[&str]) -> Vec<[u32; N]> {
    if !kind.contains(&value["kind"].as_str().expect("kind")) {
        return Vec::new();
    }
    indices(&value["cells"])
}

fn cases() -> Vec<Case> {
    let file: Value =
        serde_json::from_str(include_str!("data/virtual_test.json")).expect("reference data");
    let cases = file["cases"].as_array().expect("cases").iter().map(|value| {
        let number = |key: &str| number(&value[key]);
        let held = rows(&value["dirichlet"]);
        let loads = rows(&value["nodal_loads"]);
        Case {
            name: value["name"].as_str().expect("name").to_owned(),
            points: points(&value["points"]),
            triangles: cells(value, &["tri"]),
            fours: cells(value, &["quad", "tet"]),
            hexahedra: cells(value, &["hex"]),
            quads: value["kind"] == "quad",
            material: LinearMaterial::new(number("E"), number("nu")).expect("material"),
            loading: Loading {
                displacements: held.iter().map(|h| (h[0] as usize, h[1] as usize, h[2])).collect(),
                forces: loads
                    .iter()
                    .map(|l| (l[0] as usize, [l[1], l[2], l.get(3).copied().unwrap_or(0.0)]))
                    .collect(),
            },
            u: points(&value["u"]),
            value: value.clone(),
        }
    });
    cases.collect()
}

fn add(points: &[[f64; 3]], u: &[[f64; 3]]) -> Vec<[f64; 3]> {
    points.iter().zip(u).map(|(x, u)| [x[0] + u[0], x[1] + u[1], x[2] + u[2]]).collect()
}

fn springs_of(case: &Case, method: ElementMethod) -> FittedSprings {
    let section = Section::default();
    fit_elements(&case.points, &case.cells(), &[case.material], &section, method).expect("fit")
}

/// The stored displacements were found by another program with the same elements.
#[test]
fn finite_elements_equal_the_stored_solutions() {
    for case in cases() {
        let section = Section::default();
        let u =
            finite_elements(&case.points, &case.cells(), &[case.material], &section, &case.loading)
                .expect("displacements");
        let largest = case.u.iter().flatten().fold(0f64, |m, x| m.max(x.abs()));
        for (node, (found, stored)) in u.iter().zip(&case.u).enumerate() {
            for axis in 0..3 {
                let off = (found[axis] - stored[axis]).abs();
                assert!(off < 1e-9 * largest, "{} node {node}: {found:?} {stored:?}", case.name);
            }
        }
    }
}

/// Tractions on the loaded ends of the specimens are the stored nodal forces.
#[test]
fn tractions() {
    let mut compared = 0;
    for case in cases().iter().filter(|c| c.name.starts_with("dogbone")) {
        let end = case.points.iter().map(|p| p[0]).fold(f64::NEG_INFINITY, f64::max);
        let facets = facets_within(&case.cells(), &nodes_at(&case.points, 0, end));
        let forces = traction_forces(&case.points, &facets, [1000.0 / 3.0, 0.0, 0.0], 1.0);
        let mut sums = vec![0.0; case.points.len()];
        for (node, force) in forces {
            sums[node] += force[0];
        }
        for (node, force) in &case.loading.forces {
            assert!((sums[*node] - force[0]).abs() < 1e-9, "{}", case.name);
            sums[*node] = 0.0;
            compared += 1;
        }
        assert!(sums.iter().all(|&s| s == 0.0));
    }
    assert!(compared > 10);
}

/// Grid of `n` cubes along every axis, `size` m wide.
fn cube(n: usize, size: f64) -> (Vec<[f64; 3]>, Vec<[u32; 8]>) {
    grid(n, size / n as f64)
}

/// Paper B, Tables 1 and 3: the 2 cm cube of 512 hexahedra in tension. The Frobenius fit is printed
/// with 14.98 and 25.19 %.
#[test]
fn cube_in_tension_of_paper_b() {
    let (points, hexahedra) = cube(8, 0.02);
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let section = Section::default();
    let material = [LinearMaterial::new(1e4, 0.3).expect("material")];
    let facets = facets_within(&cells, &nodes_at(&points, 2, 0.02));
    assert_eq!(facets.len(), 64);
    let mut loading = Loading {
        forces: traction_forces(&points, &facets, [0.0, 0.0, 1000.0], 1.0),
        ..Loading::default()
    };
    let total: f64 = loading.forces.iter().map(|f| f.1[2]).sum();
    assert!((total - 0.4).abs() < 1e-12);
    loading.hold(&nodes_at(&points, 2, 0.0), 3, [0.0; 3]);
    let fem = finite_elements(&points, &cells, &material, &section, &loading).expect("fem");
    let reference = add(&points, &fem);
    let errors = |method| {
        let springs = fit_elements(&points, &cells, &material, &section, method).expect("fit");
        let lem = linear_springs(&points, &springs.edges, &springs.constants, 3, &loading);
        let lem = lem.expect("springs");
        assert!(lem.definite);
        let found = add(&points, &lem.displacements);
        position_errors(&points, &reference, &found).expect("errors")
    };
    let frobenius = errors(ElementMethod::Frobenius);
    assert!((frobenius.rms_percent - 14.98).abs() < 0.005, "{frobenius:?}");
    assert!((frobenius.max_percent - 25.58).abs() < 0.005, "{frobenius:?}");
    let block = errors(ElementMethod::Block);
    assert!((block.rms_percent - 1.37).abs() < 0.005, "{block:?}");
}

/// Under small loads springs with rest lengths are the springs of `K(k)`.
#[test]
fn small_loads_are_linear() {
    for case in cases().into_iter().filter(|c| c.name != "patch_hex") {
        let d = dimension(&case.points, &case.cells()).expect("dimension");
        let springs = springs_of(&case, ElementMethod::Nonnegative);
        let mut loading = case.loading.clone();
        loading.displacements.iter_mut().for_each(|x| x.2 *= 1e-6);
        loading.forces.iter_mut().for_each(|f| f.1 = f.1.map(|x| x * 1e-6));
        let (edges, constants) = (&springs.edges, &springs.constants);
        let linear = linear_springs(&case.points, edges, constants, d, &loading).expect("linear");
        let options = SpringOptions { load_steps: 1, ..SpringOptions::default() };
        let full = rest_length_springs(&case.points, edges, constants, d, &loading, &options)
            .expect("equilibrium");
        let largest = linear.displacements.iter().flatten().fold(0f64, |m, x| m.max(x.abs()));
        for (a, b) in linear.displacements.iter().zip(&full.displacements) {
            for axis in 0..3 {
                assert!((a[axis] - b[axis]).abs() < 1e-4 * largest, "{}: {a:?} {b:?}", case.name);
            }
        }
    }
}

/// A lattice of Baudet's cubes with nu = 1/4 under uniaxial stretch stays a lattice: its force is that
/// of the springs, in closed form.
#[test]
fn rest_length_springs_at_thirty_percent() {
    let (points, hexahedra) = cube(2, 2.0);
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let material = [LinearMaterial::new(1.0, 0.25).expect("material")];
    let springs =
        fit_elements(&points, &cells, &material, &Section::default(), ElementMethod::Baudet)
            .expect("fit");
    // stretch along z by 1.3, sides free but on rollers at 0
    let mut loading = Loading::default();
    for axis in 0..3 {
        for node in nodes_at(&points, axis, 0.0) {
            loading.displacements.push((node, axis, 0.0));
        }
    }
    for node in nodes_at(&points, 2, 2.0) {
        loading.displacements.push((node, 2, 0.6));
    }
    let options = SpringOptions::default();
    let solution =
        rest_length_springs(&points, &springs.edges, &springs.constants, 3, &loading, &options)
            .expect("equilibrium");
    assert!(solution.definite);
    // one cell: 4 edges along each axis (0.2 each), 4 body diagonals (0.3 each); lateral stretch s
    // minimises its energy
    let energy = |s: f64| {
        let diagonal = (2.0 * s * s + 1.3 * 1.3).sqrt() - 3f64.sqrt();
        4.0 * 0.5 * 0.3 * diagonal * diagonal + 8.0 * 0.5 * 0.2 * (s - 1.0) * (s - 1.0)
    };
    let (mut low, mut high) = (0.8, 1.0);
    for _ in 0..200 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if energy(a) < energy(b) { high = b } else { low = a }
    }
    let u = solution.displacements[26];
    for axis in 0..2 {
        assert!((1.0 + u[axis] / 2.0 - low).abs() < 1e-7, "{u:?} {low}");
    }
    let middle = solution.displacements[13];
    assert!((middle[2] - 0.3).abs() < 1e-9, "{middle:?}");
}

/// The specimens of paper B's Table 4: finite elements measure what went in, springs their own moduli.
#[test]
fn specimens() {
    for case in cases().iter().filter(|c| c.name.starts_with("dogbone")) {
        let stored = &case.value["gauge"];
        let number = |key: &str| number(&stored[key]);
        let middle = 0.5 * case.points.iter().map(|p| p[0]).fold(f64::NEG_INFINITY, f64::max);
        let gauge: Vec<usize> = (0..case.points.len())
            .filter(|&n| (case.points[n][0] - middle).abs() <= 0.01 * (1.0 + 1e-9))
            .collect();
        let stress = number("sigma");
        let moduli =
            |u: &[[f64; 3]]| tensile_moduli(&case.points, u, &gauge, 2, 0, stress).expect("moduli");
        let fem = moduli(&case.u);
        assert!((fem.youngs_modulus - number("E_out")).abs() < 1e-9 * number("E_out"), "{fem:?}");
        assert!((fem.poissons_ratio - number("nu_out")).abs() < 1e-9, "{fem:?}");
        let springs = springs_of(case, ElementMethod::Frobenius);
        let (edges, constants) = (&springs.edges, &springs.constants);
        let lem =
            linear_springs(&case.points, edges, constants, 2, &case.loading).expect("springs");
        let found = moduli(&lem.displacements);
        // springs have their own ratio, near 1/3 whatever went in; the values are those of these meshes
        assert!(found.poissons_ratio > 1.0 / 3.0, "{found:?}");
        assert!(found.youngs_modulus < 0.95 * 1e4, "{found:?}");
    }
}

/// Baudet's springs with their lateral forces have the moduli that went in; without them they do not.
#[test]
fn baudets_correction() {
    let nu = 0.1;
    let material = [LinearMaterial::new(1e4, nu).expect("material")];
    let section = Section { plane: Plane::Stress, thickness: 0.5 };
    let (solid, hexahedra) = cube(3, 0.3);
    // rectangles of 1 x 2, in z = 0
    let plane: Vec<[f64; 3]> =
        (0..12).map(|i| [(i % 4) as f64, 2.0 * (i / 4) as f64, 0.0]).collect();
    let quads: Vec<[u32; 4]> = (0..6)
        .map(|c| {
            let corner = c % 3 + 4 * (c / 3);
            [corner, corner + 1, corner + 5, corner + 4]
        })
        .collect();
    let quads = Cells { quads: &quads, ..Cells::default() };
    let hexahedra = Cells { hexahedra: &hexahedra, ..Cells::default() };
    for (points, cells, end, d) in [(&solid, hexahedra, 0.3, 3), (&plane, quads, 3.0, 2)] {
        let springs = fit_elements(points, &cells, &material, &section, ElementMethod::Baudet);
        let springs = springs.expect("fit");
        let mut loading = Loading::default();
        for axis in 0..d {
            loading
                .displacements
                .extend(nodes_at(points, axis, 0.0).iter().map(|&n| (n, axis, 0.0)));
        }
        let facets = facets_within(&cells, &nodes_at(points, 0, end));
        let traction = [500.0, 0.0, 0.0];
        loading.forces = traction_forces(points, &facets, traction, section.thickness);
        let measure = |loading: &Loading| {
            let (edges, constants) = (&springs.edges, &springs.constants);
            let u = linear_springs(points, edges, constants, d, loading).expect("springs");
            let all: Vec<usize> = (0..points.len()).collect();
            tensile_moduli(points, &u.displacements, &all, d, 0, 500.0).expect("moduli")
        };
        let without = measure(&loading);
        assert!((without.poissons_ratio - nu).abs() > 0.1, "{without:?}");
        let lateral = baudet_tension_correction(points, &cells, &section, nu, 0, 500.0);
        loading.forces.extend(lateral.expect("forces").into_iter().enumerate());
        let with = measure(&loading);
        assert!((with.youngs_modulus - 1e4).abs() < 1e-7, "{with:?}");
        assert!((with.poissons_ratio - nu).abs() < 1e-11, "{with:?}");
    }
}

/// Torsion: a turned end, and a linear one to first order.
#[test]
fn torsion() {
    let (points, hexahedra) = cube(3, 0.03);
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let material = [LinearMaterial::new(1e4, 0.3).expect("material")];
    let springs =
        fit_elements(&points, &cells, &material, &Section::default(), ElementMethod::Block)
            .expect("fit");
    let twist = |angle: f64, linear| {
        let mut loading = Loading::default();
        loading.hold(&nodes_at(&points, 2, 0.0), 3, [0.0; 3]);
        let top = nodes_at(&points, 2, 0.03);
        loading.turn(&points, &top, 2, [0.015, 0.015, 0.03], angle, linear);
        loading
    };
    let (edges, constants) = (&springs.edges, &springs.constants);
    let options = SpringOptions::default();
    let turned = rest_length_springs(&points, edges, constants, 3, &twist(0.5, false), &options)
        .expect("equilibrium");
    // the end is rigid, and the middle turns by symmetry half as much
    let corner = turned.displacements[63];
    let (s, c) = 0.5f64.sin_cos();
    assert!((corner[0] - 0.015 * (c - s - 1.0)).abs() < 1e-15);
    assert!((corner[1] - 0.015 * (s + c - 1.0)).abs() < 1e-15);
    let linear = linear_springs(&points, edges, constants, 3, &twist(1e-6, true)).expect("linear");
    let full = rest_length_springs(&points, edges, constants, 3, &twist(1e-6, false), &options)
        .expect("equilibrium");
    for (a, b) in linear.displacements.iter().zip(&full.displacements) {
        for axis in 0..3 {
            assert!((a[axis] - b[axis]).abs() < 1e-5 * 0.03e-6, "{a:?} {b:?}");
        }
    }
}

#[test]
fn errors() {
    let (points, hexahedra) = cube(1, 1.0);
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let section = Section::default();
    let material = [LinearMaterial::new(1.0, 0.3).expect("material")];
    let mut loading = Loading { forces: vec![(7, [1.0, 0.0, 0.0])], ..Loading::default() };
    let fem = |loading: &Loading| finite_elements(&points, &cells, &material, &section, loading);
    assert!(matches!(fem(&loading), Err(VirtualTestError::Singular { .. })));
    let balanced =
        Loading { forces: vec![(7, [1.0, 0.0, 0.0]), (6, [-1.0, 0.0, 0.0])], ..Loading::default() };
    assert!(matches!(fem(&balanced), Err(VirtualTestError::Singular { .. })));
    loading.hold(&[0, 1, 2, 3], 3, [0.0; 3]);
    assert!(fem(&loading).is_ok());
    loading.forces.push((8, [0.0; 3]));
    assert!(fem(&loading).unwrap_err().to_string().contains("node 8"));

    let mut warped = points.clone();
    warped[2][2] = 0.1;
    let quads = Cells { quads: &[[0, 1, 3, 2]], ..Cells::default() };
    let error = dimension(&warped[..4], &quads).unwrap_err();
    assert!(matches!(error, VirtualTestError::NotPlane { node: 2, .. }));
    let both = Cells { quads: &[[0, 1, 3, 2]], ..cells };
    assert_eq!(dimension(&points, &both), Err(VirtualTestError::MixedDimensions));
    assert_eq!(loose_nodes(9, &cells), [8]);
}
