//! Springs of a whole body: known ones are found again, and finite elements are met as well as springs can.

use sinew_identify::cells::Cells;
use sinew_identify::mesh::fit_elements;
use sinew_identify::virtual_test::whole::{Sharing, State, WholeBody};
use sinew_identify::{ElementError, ElementMethod, LinearMaterial, Section};

/// Numbers between -1 and 1, the same every time.
fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

struct Block {
    points: Vec<[f64; 3]>,
    hexahedra: Vec<[u32; 8]>,
    tetrahedra: Vec<[u32; 4]>,
}

/// Cells of 1 cm, their nodes moved by part of that.
fn block([nx, ny, nz]: [u32; 3], shaken: f64) -> Block {
    let mut next = numbers(3);
    let at = |i: u32, j: u32, k: u32| i + (nx + 1) * (j + (ny + 1) * k);
    let mut points = Vec::new();
    for k in 0..=nz {
        for j in 0..=ny {
            for i in 0..=nx {
                points.push([i, j, k].map(|x| 0.01 * (f64::from(x) + shaken * next())));
            }
        }
    }
    let mut hexahedra = Vec::new();
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let ring = |k| [at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k)];
                let [a, b] = [ring(k), ring(k + 1)];
                hexahedra.push([a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]);
            }
        }
    }
    // six round the diagonal from corner 0 to corner 6
    let paths = [[1, 2], [2, 3], [3, 7], [7, 4], [4, 5], [5, 1]];
    let cut = |h: &[u32; 8]| paths.map(|[a, b]| [h[0], h[a], h[b], h[6]]);
    let tetrahedra = hexahedra.iter().flat_map(cut).collect();
    Block { points, hexahedra, tetrahedra }
}

fn plane() -> (Vec<[f64; 3]>, Vec<[u32; 4]>, Vec<[u32; 3]>) {
    let mut flat = block([4, 3, 1], 0.15);
    flat.points.truncate(20);
    flat.points.iter_mut().for_each(|p| p[2] = 0.0);
    let quads: Vec<[u32; 4]> = flat.hexahedra.iter().map(|h| [h[0], h[1], h[2], h[3]]).collect();
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    (flat.points, quads, triangles)
}

/// Calls a test with bodies of every kind of element, one of two kinds among them.
fn for_all(mut test: impl FnMut(&[[f64; 3]], &Cells<'_>)) {
    let Block { points, hexahedra, tetrahedra } = block([3, 2, 2], 0.15);
    test(&points, &Cells { hexahedra: &hexahedra, ..Cells::default() });
    test(&points, &Cells { tetrahedra: &tetrahedra, ..Cells::default() });
    let (first, last) = (&tetrahedra[..36], &hexahedra[6..]);
    test(&points, &Cells { tetrahedra: first, hexahedra: last, ..Cells::default() });
    let (points, quads, triangles) = plane();
    test(&points, &Cells { quads: &quads, ..Cells::default() });
    test(&points, &Cells { triangles: &triangles, ..Cells::default() });
}

const SECTION: Section = Section { plane: sinew_identify::Plane::Stress, thickness: 0.002 };

/// Displacements of a tenth of a cell and more, turned as a whole as well.
fn fields(points: &[[f64; 3]], flat: bool, count: u64) -> Vec<Vec<[f64; 3]>> {
    let field = |seed| {
        let mut next = numbers(100 + seed);
        let turn = 0.5 * next();
        let (sin, cos) = (turn.sin(), turn.cos());
        let moved = points.iter().map(|p| {
            let z = if flat { 0.0 } else { 0.0015 * next() };
            let (x, y) = (p[0] + 0.0015 * next(), p[1] + 0.0015 * next());
            [cos * x - sin * y - p[0], sin * x + cos * y - p[1], z]
        });
        moved.collect()
    };
    (0..count).map(field).collect()
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let size = b.iter().fold(0f64, |m, b| m.max(b.abs()));
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / size
}

#[test]
fn springs_that_made_a_stiffness_are_found_again() {
    for_all(|points, cells| {
        let body = WholeBody::new(points, cells, &SECTION).unwrap();
        let mut next = numbers(7);
        let known: Vec<f64> = body.edges.iter().map(|_| 50.0 * (1.0 + 0.9 * next())).collect();
        let target = body.stiffness_of_springs(&known);
        let fit = body.fit_stiffness(&target, Sharing::Springs).unwrap();
        assert!(largest_difference(&fit.constants, &known) < 1e-8);
        assert!(fit.residual < 1e-10 && fit.gradient < 1e-12 && fit.unknowns == known.len());
    });
}

#[test]
fn springs_that_made_forces_are_found_again() {
    for_all(|points, cells| {
        let flat = cells.hexahedra.len() + cells.tetrahedra.len() == 0;
        let body = WholeBody::new(points, cells, &SECTION).unwrap();
        let mut next = numbers(8);
        let known: Vec<f64> = body.edges.iter().map(|_| 50.0 * (1.0 + 0.9 * next())).collect();
        let states: Vec<State> =
            fields(points, flat, 12).iter().map(|u| body.state_of_springs(&known, u)).collect();
        let start = vec![0.0; known.len()];
        let fit = body.fit_forces(&states, Sharing::Springs, &start).unwrap();
        let off = largest_difference(&fit.constants, &known);
        assert!(off < 1e-8, "{off:e}, gradient {:e}", fit.gradient);
        assert!(fit.residual < 1e-8 && fit.iterations > 0);
    });
}

/// Springs of one modulus for each kind of pair are found again by either fit.
#[test]
fn moduli_are_found_again() {
    for_all(|points, cells| {
        let flat = cells.hexahedra.len() + cells.tetrahedra.len() == 0;
        let body = WholeBody::new(points, cells, &SECTION).unwrap();
        // what a modulus of 1 makes, by fits of springs that have it
        let zero = vec![0.0; body.edges.len()];
        let mut next = numbers(9);
        let any: Vec<f64> = body.edges.iter().map(|_| 50.0 * (1.0 + 0.9 * next())).collect();
        let first = body.fit_stiffness(&body.stiffness_of_springs(&any), Sharing::Moduli).unwrap();
        let (known, moduli) = (first.constants, first.moduli);
        assert_eq!(first.unknowns, moduli.len());
        assert!(first.residual > 0.05, "such springs have not one modulus");
        let again =
            body.fit_stiffness(&body.stiffness_of_springs(&known), Sharing::Moduli).unwrap();
        assert!(largest_difference(&again.constants, &known) < 1e-10 && again.residual < 1e-10);
        let states: Vec<State> =
            fields(points, flat, 2).iter().map(|u| body.state_of_springs(&known, u)).collect();
        let forces = body.fit_forces(&states, Sharing::Moduli, &zero).unwrap();
        assert!(largest_difference(&forces.constants, &known) < 1e-8);
        for ((kind, modulus), (of, found)) in moduli.iter().zip(&forces.moduli) {
            assert!(kind == of && (found / modulus - 1.0).abs() < 1e-8, "{kind} {modulus} {found}");
        }
    });
}

/// Elements that share no node are bodies of their own: the fit of the whole is that of each.
#[test]
fn isolated_elements_are_fitted_as_single_ones() {
    let Block { points: one, hexahedra, tetrahedra } = block([1, 1, 1], 0.0);
    let mut points = Vec::new();
    let (mut cubes, mut simplices) = (Vec::new(), Vec::new());
    for i in 0..3u32 {
        points.extend(one.iter().map(|p| [p[0] + 0.05 * f64::from(i), p[1], p[2]]));
        cubes.push(hexahedra[0].map(|v| v + 8 * i));
        simplices.push(tetrahedra[2].map(|v| v + 8 * i));
    }
    let material = [LinearMaterial::new(1e4, 0.3).unwrap()];
    for cells in [
        Cells { hexahedra: &cubes, ..Cells::default() },
        Cells { tetrahedra: &simplices, ..Cells::default() },
    ] {
        let body = WholeBody::new(&points, &cells, &SECTION).unwrap();
        let target = body.stiffness_of_elements(&cells, &material, &SECTION).unwrap();
        let whole = body.fit_stiffness(&target, Sharing::Springs).unwrap();
        let single = fit_elements(&points, &cells, &material, &SECTION, ElementMethod::Frobenius);
        let single = single.unwrap();
        assert_eq!(whole.residual > 0.01, single.report.frobenius_residual.mean > 0.01);
        assert!((whole.residual - single.report.frobenius_residual.mean).abs() < 1e-9);
        assert_eq!(body.edges, single.edges);
        assert!(largest_difference(&whole.constants, &single.constants) < 1e-9);
        if !cells.hexahedra.is_empty() {
            // by its symmetry a cube has one constant for each kind of pair
            let moduli = body.fit_stiffness(&target, Sharing::Moduli).unwrap();
            assert_eq!(moduli.moduli.len(), 3);
            assert!(largest_difference(&moduli.constants, &single.constants) < 1e-9);
        }
    }
}

/// Of elements that share nodes the whole is met better than by sums of their fits, and no other constants meet it better.
#[test]
fn the_whole_is_met_best() {
    let material = [LinearMaterial::new(1e4, 0.3).unwrap()];
    for_all(|points, cells| {
        let body = WholeBody::new(points, cells, &SECTION).unwrap();
        let target = body.stiffness_of_elements(cells, &material, &SECTION).unwrap();
        let fit = body.fit_stiffness(&target, Sharing::Springs).unwrap();
        let off = |k: &[f64]| target.distance(&body.stiffness_of_springs(k)) / target.norm();
        let sums = fit_elements(points, cells, &material, &SECTION, ElementMethod::Frobenius);
        let sums = sums.unwrap();
        assert_eq!(body.edges, sums.edges);
        assert!(fit.residual < off(&sums.constants), "{} {}", fit.residual, off(&sums.constants));
        let shared = body.fit_stiffness(&target, Sharing::Moduli).unwrap();
        assert!(shared.residual > fit.residual && shared.moduli.iter().all(|m| m.1.is_finite()));
        let mut next = numbers(5);
        for _ in 0..20 {
            let other: Vec<f64> = fit.constants.iter().map(|k| k + 0.1 * next()).collect();
            assert!(off(&other) > fit.residual);
        }
        // forces: at least as near as the constants of either fit of the stiffness
        let flat = cells.hexahedra.len() + cells.tetrahedra.len() == 0;
        let states: Vec<State> =
            fields(points, flat, 3).iter().map(|u| body.state(&target, u)).collect();
        let forces = body.fit_forces(&states, Sharing::Springs, &fit.constants).unwrap();
        for other in [&fit.constants, &sums.constants] {
            assert!(forces.residual <= body.force_residual(&states, other));
        }
        for _ in 0..20 {
            let other: Vec<f64> = forces.constants.iter().map(|k| k + 0.1 * next()).collect();
            assert!(body.force_residual(&states, &other) >= forces.residual);
        }
    });
}

/// Springs know their rest lengths: a turned body needs no force, and tells nothing of constants, which stay.
#[test]
fn turns_need_no_force_and_tell_nothing() {
    let Block { points, hexahedra, .. } = block([2, 2, 2], 0.15);
    let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
    let body = WholeBody::new(&points, &cells, &SECTION).unwrap();
    let known: Vec<f64> = (0..body.edges.len()).map(|i| 10.0 + i as f64).collect();
    let turned = points.iter().map(|p| [-p[1] - p[0], p[0] - p[1], 0.0]).collect::<Vec<_>>();
    let state = body.state_of_springs(&known, &turned);
    assert!(state.forces.iter().flatten().all(|f| f.abs() < 1e-12), "{state:?}");
    // one corner alone moves: what is not joined to it keeps its start
    let mut moved = vec![[0.0; 3]; points.len()];
    moved[0] = [-0.001, -0.002, 0.001];
    let states = [body.state_of_springs(&known, &moved)];
    let start = vec![3.0; known.len()];
    let fit = body.fit_forces(&states, Sharing::Springs, &start).unwrap();
    for (edge, k) in body.edges.iter().zip(&fit.constants) {
        assert!(edge.contains(&0) || *k == 3.0, "{edge:?} {k}");
    }
    assert!(fit.residual < 1e-10 && fit.constants.iter().any(|k| (k - 3.0).abs() > 1.0));
    let still = [body.state_of_springs(&known, &vec![[0.0; 3]; points.len()])];
    let fit = body.fit_forces(&still, Sharing::Springs, &start).unwrap();
    assert_eq!((fit.constants, fit.iterations), (start.clone(), 0));
    let none = body.fit_forces(&still, Sharing::Moduli, &start);
    assert_eq!(none, Err(ElementError::DependentSprings));
}
