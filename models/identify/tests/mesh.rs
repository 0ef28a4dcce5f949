//! Whole meshes: pooling, congruence, threads, errors, and what spring lattices can be.

use sinew_identify::cells::Cells;
use sinew_identify::mass::MassLumping;
use sinew_identify::mesh::{fit_elements, mesh_masses};
use sinew_identify::response::effective_moduli;
use sinew_identify::springs::pairs;
use sinew_identify::{
    ElementError, ElementGeometry, ElementKind, ElementMethod, IdentifyError, LinearMaterial,
    Plane, Section, fit_element,
};

const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

/// Numbers in [-1, 1), the same in every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn point(&mut self) -> [f64; 3] {
        [self.next(), self.next(), self.next()]
    }
}

/// Grid of `n` cubes of `edge` along every axis: points and hexahedra.
pub fn grid(n: usize, edge: f64) -> (Vec<[f64; 3]>, Vec<[u32; 8]>) {
    let m = n + 1;
    let index = |x: usize, y: usize, z: usize| (x + m * (y + m * z)) as u32;
    let points = (0..m * m * m)
        .map(|i| [(i % m) as f64 * edge, (i / m % m) as f64 * edge, (i / m / m) as f64 * edge])
        .collect();
    let cells = (0..n * n * n)
        .map(|c| {
            let (x, y, z) = (c % n, c / n % n, c / n / n);
            let face = |z| {
                [index(x, y, z), index(x + 1, y, z), index(x + 1, y + 1, z), index(x, y + 1, z)]
            };
            let ([a, b, c, d], [e, f, g, h]) = (face(z), face(z + 1));
            [a, b, c, d, e, f, g, h]
        })
        .collect();
    (points, cells)
}

/// Moduli of one cell: `E_eff / E`, `nu_eff`, `G / G_0`.
fn lattice(geometry: &ElementGeometry, nu: f64, method: ElementMethod) -> [f64; 3] {
    let material = LinearMaterial::new(1.0, nu).expect("material");
    let section = Section::default();
    let fit = fit_element(geometry, &material, &section, method).expect("fit");
    let moduli = effective_moduli(geometry, &fit.constants, &section).expect("moduli");
    let shear = moduli.shear_modulus * 2.0 * (1.0 + nu);
    // Cauchy relation of central forces
    let c = &moduli.stiffness;
    let last = c.nrows() - 1;
    assert!((c[(0, 1)] - c[(last, last)]).abs() < 1e-12 * c[(0, 0)]);
    [moduli.youngs_modulus, moduli.poissons_ratio, shear]
}

/// The moduli that spring lattices have, to the printed digits. Poisson's ratio of the 2-norm fit is
/// that of a flat minimum: the stored minimiser of the last case has 0.20646, the point with a norm
/// larger by 1e-7 that breaks ties 0.20654.
#[test]
fn lattices_have_their_own_moduli() {
    use ElementMethod::{Baudet, Block, Frobenius, TwoNorm};
    let square = ElementGeometry::planar(ElementKind::Quad, &SQUARE).expect("square");
    let (points, cells) = grid(1, 1.0);
    let cells = Cells { hexahedra: &cells, ..Cells::default() };
    let cube = cells.geometry(&points, 0).expect("cube");
    let third = 1.0 / 3.0;
    for (geometry, nu, method, expected, half) in [
        (&square, 0.3, Frobenius, [0.836, 0.402, 1.04], [5e-4, 5e-4, 5e-3]),
        (&square, 0.3, Block, [0.854, 0.413, 1.11], [5e-4, 5e-4, 5e-3]),
        (&square, 0.3, TwoNorm, [0.874, 0.383, 1.02], [5e-4, 5e-4, 5e-3]),
        (&square, third, Frobenius, [0.852, 0.404, 1.10], [5e-4, 5e-4, 5e-3]),
        (&square, third, Block, [0.882, 0.412, 1.17], [5e-4, 5e-4, 5e-3]),
        (&square, third, TwoNorm, [0.871, 0.394, 1.08], [5e-4, 5e-4, 5e-3]),
        (&square, third, Baudet, [1.0, third, 1.0], [1e-12; 3]),
        (&cube, 0.3, Frobenius, [0.796, 0.276, 1.00], [5e-4, 5e-4, 5e-3]),
        (&cube, 0.3, Block, [0.977, 0.288, 1.34], [5e-4, 5e-4, 5e-3]),
        (&cube, 0.3, TwoNorm, [0.920, 0.268, 1.09], [5e-4, 5e-4, 5e-3]),
        (&cube, 0.45, Frobenius, [2.03, 0.289, 3.1], [5e-3, 5e-4, 5e-2]),
        (&cube, 0.45, Block, [3.25, 0.276, 4.5], [5e-3, 5e-4, 5e-2]),
        (&cube, 0.45, TwoNorm, [4.20, 0.2065, 3.6], [5e-3, 5e-5, 5e-2]),
    ] {
        let found = lattice(geometry, nu, method);
        for i in 0..3 {
            let off = (found[i] - expected[i]).abs();
            assert!(off <= half[i] * 1.001, "{method}, nu {nu}: {found:?}, not {expected:?}");
        }
    }
}

/// Equilateral triangles with lambda = mu are springs exactly, wherever they lie in space.
#[test]
fn exact_cases() {
    let h = 3f64.sqrt() / 2.0;
    let flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, h, 0.0]];
    let (s, c) = 0.7f64.sin_cos();
    let turned =
        flat.map(|[x, y, _]| [5.0 + c * x - s * y * 0.6, s * x + c * y * 0.6, 0.8 * y - 2.0]);
    for (plane, nu) in [(Plane::Stress, 1.0 / 3.0), (Plane::Strain, 0.25)] {
        let material = LinearMaterial::new(1e4, nu).expect("material");
        let section = Section { plane, thickness: 0.01 };
        for nodes in [flat, turned] {
            let geometry = ElementGeometry::new(ElementKind::Triangle, &nodes).expect("geometry");
            assert!(geometry.off_plane() < 1e-14);
            for method in [
                ElementMethod::Frobenius,
                ElementMethod::Block,
                ElementMethod::TwoNorm,
                ElementMethod::Nonnegative,
                ElementMethod::TwoNormNonnegative,
                ElementMethod::VanGelderFull,
                ElementMethod::Delingette,
            ] {
                let fit = fit_element(&geometry, &material, &section, method).expect("fit");
                assert!(fit.frobenius_residual < 1e-14, "{method}: {}", fit.frobenius_residual);
            }
        }
    }
}

/// Constants depend on lengths alone: not on place, rotation, mirror image or side of the plane.
#[test]
fn constants_do_not_depend_on_the_frame() {
    let mut random = Random(3);
    let material = LinearMaterial::new(2e3, 0.35).expect("material");
    let section = Section { plane: Plane::Strain, thickness: 0.3 };
    let (cube, _) = grid(1, 1.0);
    let hexahedron = [0, 1, 3, 2, 4, 5, 7, 6].map(|i| {
        let r = random.point();
        [cube[i][0] + 0.15 * r[0], cube[i][1] + 0.15 * r[1], cube[i][2] + 0.15 * r[2]]
    });
    let quad = [[0.0, 0.0, 0.0], [1.2, 0.1, 0.0], [0.9, 0.8, 0.0], [-0.1, 1.0, 0.0]];
    let turn = |x: [f64; 3], mirror: f64| {
        let (s, c) = 1.1f64.sin_cos();
        let y = [c * x[0] - s * x[1], s * x[0] + c * x[1], mirror * x[2]];
        [y[2] + 3.0, y[0] - 2.0, y[1]]
    };
    for (kind, nodes) in
        [(ElementKind::Hexahedron, hexahedron.to_vec()), (ElementKind::Quad, quad.to_vec())]
    {
        let fit = |nodes: &[[f64; 3]]| {
            let geometry = ElementGeometry::new(kind, nodes).expect("geometry");
            fit_element(&geometry, &material, &section, ElementMethod::Frobenius).expect("fit")
        };
        let reference = fit(&nodes);
        for mirror in [1.0, -1.0] {
            let other = fit(&nodes.iter().map(|&x| turn(x, mirror)).collect::<Vec<_>>());
            for (a, b) in reference.constants.iter().zip(&other.constants) {
                assert!((a - b).abs() < 1e-9 * a.abs().max(b.abs()), "{a} and {b}");
            }
        }
    }
}

/// Elements of 1e-6 m and 1e3 m are the same problem: constants of solids grow with size.
#[test]
fn scale() {
    let material = [LinearMaterial::new(1e4, 0.3).expect("material")];
    for method in [ElementMethod::Frobenius, ElementMethod::TwoNorm, ElementMethod::Nonnegative] {
        let fit = |edge: f64| {
            let (points, cells) = grid(2, edge);
            let cells = Cells { hexahedra: &cells, ..Cells::default() };
            fit_elements(&points, &cells, &material, &Section::default(), method).expect("fit")
        };
        let one = fit(1.0);
        for edge in [1e-6, 1e3] {
            let other = fit(edge);
            assert_eq!(one.edges, other.edges);
            assert_eq!(other.report.distinct_fits, 1);
            for (a, b) in one.constants.iter().zip(&other.constants) {
                assert!((a * edge - b).abs() < 1e-6 * b.abs(), "{method}: {a} {b}");
            }
        }
    }
}

/// Pooled stiffness is the sum over elements, masses add up to the mass, congruent elements are found.
#[test]
fn pooling() {
    let (mut points, hexahedra) = grid(3, 0.02);
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let section = Section::default();
    let material = [LinearMaterial::new(1e4, 0.3).expect("material")];
    let frobenius = ElementMethod::Frobenius;
    let regular = fit_elements(&points, &cells, &material, &section, frobenius).expect("fit");
    assert_eq!(regular.report.distinct_fits, 1);
    assert_eq!((regular.report.negative_edges, regular.report.negative_element_constants), (0, 0));
    let masses =
        mesh_masses(&points, &cells, 1000.0, &section, MassLumping::RowSum).expect("masses");
    assert!((masses.iter().sum::<f64>() - 1000.0 * 0.06f64.powi(3)).abs() < 1e-12);

    let mut random = Random(7);
    for point in &mut points {
        let r = random.point();
        for axis in 0..3 {
            point[axis] += 0.004 * r[axis];
        }
    }
    let jittered = fit_elements(&points, &cells, &material, &section, frobenius).expect("fit");
    assert_eq!(jittered.report.distinct_fits, 27);
    assert_eq!(jittered.edges, regular.edges);
    assert!(jittered.edges.is_sorted());
    let mut expected = vec![0.0; jittered.edges.len()];
    let mut worst = (0.0, 0);
    for element in 0..27 {
        let geometry = cells.geometry(&points, element).expect("geometry");
        let fit = fit_element(&geometry, &material[0], &section, frobenius).expect("fit");
        if fit.frobenius_residual > worst.0 {
            worst = (fit.frobenius_residual, element);
        }
        let nodes = hexahedra[element];
        for ((a, b), k) in pairs(8).zip(&fit.constants) {
            let edge = [nodes[a].min(nodes[b]), nodes[a].max(nodes[b])];
            expected[jittered.edges.binary_search(&edge).expect("edge")] += k;
        }
    }
    assert_eq!(jittered.constants, expected);
    let residual = jittered.report.frobenius_residual;
    assert_eq!((residual.worst, residual.worst_element), worst);
    assert!(residual.mean < residual.worst);
}

/// One material for each element: the same shape with another modulus is another fit.
#[test]
fn materials() {
    let (points, hexahedra) = grid(2, 1.0);
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let section = Section::default();
    let materials: Vec<_> = (0..8)
        .map(|i| LinearMaterial::new(if i == 5 { 3.0 } else { 1.0 }, 0.3).expect("material"))
        .collect();
    let method = ElementMethod::Block;
    let fit = fit_elements(&points, &cells, &materials, &section, method).expect("fit");
    assert_eq!(fit.report.distinct_fits, 2);
    let soft = fit_elements(&points, &cells, &materials[..1], &section, method).expect("fit");
    // a body diagonal belongs to one element only
    for (element, factor) in [(0, 1.0), (5, 3.0)] {
        let nodes = hexahedra[element];
        let at = fit.edges.binary_search(&[nodes[0], nodes[6]]).expect("diagonal");
        assert!((fit.constants[at] - factor * soft.constants[at]).abs() < 1e-13);
    }
    let error = fit_elements(&points, &cells, &materials[..3], &section, method).unwrap_err();
    assert_eq!(error, IdentifyError::MaterialCount { given: 3, elements: 8 });
}

/// The same bits for any number of threads.
#[test]
fn threads() {
    let (mut points, hexahedra) = grid(4, 0.01);
    let mut random = Random(11);
    for point in &mut points {
        point[0] += 0.002 * random.next();
    }
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let material = [LinearMaterial::new(1e4, 0.4).expect("material")];
    let section = Section::default();
    let fit = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        let method = ElementMethod::Frobenius;
        pool.install(|| fit_elements(&points, &cells, &material, &section, method).expect("fit"))
    };
    let one = fit(1);
    let bits = |k: &[f64]| k.iter().map(|k| k.to_bits()).collect::<Vec<_>>();
    for threads in [2, 3] {
        let other = fit(threads);
        assert_eq!(bits(&one.constants), bits(&other.constants));
        assert_eq!(one, other);
    }
}

/// Slender rectangles get negative constants; the report says so, and the non-negative fits have none.
#[test]
fn negative_constants_are_counted() {
    let points = [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [8.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let cells = Cells { quads: &[[0, 1, 2, 3]], ..Cells::default() };
    let material = [LinearMaterial::new(1.0, 0.3).expect("material")];
    let fit = |method| {
        fit_elements(&points, &cells, &material, &Section::default(), method).expect("fit")
    };
    let free = fit(ElementMethod::Frobenius);
    assert_eq!((free.report.negative_element_constants, free.report.negative_edges), (2, 2));
    assert!(free.report.least_constant < 0.0);
    for method in [ElementMethod::Nonnegative, ElementMethod::TwoNormNonnegative] {
        let bound = fit(method);
        assert_eq!(bound.report.negative_edges, 0);
        assert!(bound.report.frobenius_residual.worst > free.report.frobenius_residual.worst);
    }
    assert!(fit(ElementMethod::TwoNormNonnegative).report.worst_certificate_gap.unwrap() < 1e-6);
}

/// 2-norm fits of random elements, good and bad, all come with a tight certificate.
#[test]
fn certificates_of_random_elements() {
    let mut random = Random(1);
    let section = Section::default();
    let (cube, _) = grid(1, 1.0);
    for trial in 0..60 {
        let kind = ElementKind::ALL[trial % 4];
        let flat = if trial % 3 == 0 { 10f64.powf(-1.0 + random.next()) } else { 1.0 };
        let nodes: Vec<_> = match kind {
            ElementKind::Hexahedron => [0, 1, 3, 2, 4, 5, 7, 6]
                .iter()
                .map(|&i: &usize| {
                    let r = random.point();
                    [
                        cube[i][0] + 0.2 * r[0],
                        cube[i][1] + 0.2 * r[1],
                        flat * (cube[i][2] + 0.2 * r[2]),
                    ]
                })
                .collect(),
            ElementKind::Quad => SQUARE
                .iter()
                .map(|n| {
                    let r = random.point();
                    [n[0] + 0.2 * r[0], flat * (n[1] + 0.2 * r[1]), 0.0]
                })
                .collect(),
            ElementKind::Triangle | ElementKind::Tetrahedron => (0..kind.nodes())
                .map(|_| random.point())
                .map(|x| [x[0], flat * x[1], x[2]])
                .collect(),
        };
        let nu = 0.24 + 0.24 * random.next();
        let material = LinearMaterial::new(1e4, nu).expect("material");
        let geometry = ElementGeometry::new(kind, &nodes).expect("geometry");
        for method in [ElementMethod::TwoNorm, ElementMethod::TwoNormNonnegative] {
            let fit = fit_element(&geometry, &material, &section, method)
                .unwrap_or_else(|e| panic!("trial {trial}, {kind}, {method}: {e}"));
            let bound = fit.two_norm_bound.expect("certificate");
            assert!(bound <= fit.two_norm_residual * (1.0 + 1e-12));
            assert!(fit.two_norm_residual - bound <= 2e-8 * fit.two_norm_residual);
            // without a symmetry the least norm determines all constants
            let free = method == ElementMethod::TwoNorm;
            assert_eq!(fit.two_norm_freedom, free.then_some(0), "trial {trial}, {kind}");
            let other = fit_element(&geometry, &material, &section, ElementMethod::Nonnegative);
            assert!(bound <= other.expect("fit").two_norm_residual * (1.0 + 1e-12));
        }
    }
}

#[test]
fn names() {
    for method in ElementMethod::ALL {
        assert_eq!(method.to_string().parse(), Ok(method));
        assert_eq!(serde_json::to_string(&method).unwrap(), format!("\"{method}\""));
    }
    assert!(ElementMethod::Lloyd.recalled() && !ElementMethod::Delingette.recalled());
}

/// What is wrong, where, and what to do.
#[test]
fn errors() {
    let (points, hexahedra) = grid(2, 1.0);
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let section = Section::default();
    let material = [LinearMaterial::new(1.0, 0.3).expect("material")];
    let fit = |points: &[[f64; 3]], cells: &Cells<'_>, method| {
        fit_elements(points, cells, &material, &section, method).unwrap_err()
    };
    let frobenius = ElementMethod::Frobenius;

    assert_eq!(fit(&points, &Cells::default(), frobenius), IdentifyError::NoElements);
    assert_eq!(
        fit(&points[..20], &cells, frobenius),
        IdentifyError::NodeOutOfRange {
            kind: ElementKind::Hexahedron,
            index: 4,
            node: 22,
            points: 20
        }
    );
    let mut bad = points.clone();
    bad[26] = [0.1; 3];
    assert!(matches!(
        fit(&bad, &cells, frobenius),
        IdentifyError::Element { index: 7, source: ElementError::Jacobian { .. }, .. }
    ));
    bad[26] = [f64::NAN; 3];
    assert_eq!(
        fit(&bad, &cells, frobenius),
        IdentifyError::Element {
            kind: ElementKind::Hexahedron,
            index: 7,
            source: ElementError::NotFinite { node: 6 },
        }
    );
    bad[26] = bad[25];
    assert!(matches!(
        fit(&bad, &cells, frobenius),
        IdentifyError::Element {
            index: 7,
            source: ElementError::CoincidentNodes { a: 6, b: 7 },
            ..
        }
    ));
    bad[26] = [2.0, 2.0, 2.02];
    let error = fit(&bad, &cells, ElementMethod::Baudet);
    let text = error.to_string();
    assert!(text.contains("hexahedron 7") && text.contains("needs a cube"), "{text}");
    assert!(text.contains("off by 1.055 %") && text.contains("`frobenius`"), "{text}");
    let text = fit(&points, &cells, ElementMethod::Lloyd).to_string();
    assert!(text.contains("serves: triangle, quadrilateral, tetrahedron"), "{text}");

    // numbered in another order: the faces cross
    let mut crossed = hexahedra.clone();
    crossed[3].swap(6, 7);
    let cells = Cells { hexahedra: &crossed, ..Cells::default() };
    assert!(fit(&points, &cells, frobenius).to_string().contains("Gmsh/VTK order"));

    assert!(matches!(LinearMaterial::new(0.0, 0.3), Err(ElementError::YoungsModulus(_))));
    assert!(matches!(LinearMaterial::new(f64::NAN, 0.3), Err(ElementError::YoungsModulus(_))));
    assert!(matches!(LinearMaterial::new(1.0, -1.0), Err(ElementError::PoissonsRatio { .. })));
    let incompressible = [LinearMaterial::new(1.0, 0.5).expect("allowed in plane stress")];
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let error = fit_elements(&points, &cells, &incompressible, &section, frobenius).unwrap_err();
    assert!(error.to_string().contains("below 0.5"), "{error}");
    let quads = Cells { quads: &[[0, 1, 4, 3]], ..Cells::default() };
    assert!(fit_elements(&points, &quads, &incompressible, &section, frobenius).is_ok());
    let section = Section { thickness: -1.0, ..section };
    let error = fit_elements(&points, &quads, &material, &section, frobenius).unwrap_err();
    assert!(error.to_string().contains("thickness is -1 m"), "{error}");
}
