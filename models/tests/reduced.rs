//! Hexahedra with reduced integration: derivatives, objectivity, patch test, zero modes, and hourglass modes that keep their
//! stiffness under compression.

use crate::common::{self, Response, max_abs, max_difference, symmetric_eigen};
use bevy_ecs::prelude::*;
use glam::{DMat3, DQuat, DVec3};
use sinew_engine::lanes::InstructionSet;
use sinew_engine::law::TangentKind;
use sinew_engine::mesh::generate::box_hexahedra;
use sinew_engine::mesh::{Filled, Mesh};
use sinew_engine::workers::Workers;
use sinew_models::body::{BodyDescription, Integration, Model, VolumeRule};
use sinew_models::material::YoungPoisson;

/// Edge (m) of a cell.
const CELL: f64 = 1.0;

fn material(poisson_ratio: f64) -> YoungPoisson {
    YoungPoisson { young_modulus: 1.0, poisson_ratio, density: 1.0 }
}

/// A cube of `n` cells along each edge, all of whose vertices are moved by up to `fraction` of a cell; those in sides and edges
/// stay in these.
fn shaken(n: usize, fraction: f64, seed: u64) -> Mesh {
    let size = CELL * n as f64;
    let mut mesh = box_hexahedra(DVec3::splat(size), [n; 3]).unwrap();
    let mut next = numbers(seed);
    for x in &mut mesh.points {
        for k in 0..3 {
            if x[k] > 1e-9 && x[k] < size - 1e-9 {
                x[k] += fraction * CELL * next();
            }
        }
    }
    mesh
}

/// One cell, all of whose corners are moved.
fn cell(fraction: f64, seed: u64) -> Mesh {
    let mut next = numbers(seed);
    let mut mesh = box_hexahedra(DVec3::splat(CELL), [1; 3]).unwrap();
    for x in &mut mesh.points {
        *x += fraction * CELL * DVec3::new(next(), next(), next());
    }
    mesh
}

/// Numbers between -1 and 1.
fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

fn noise(count: usize, size: f64, seed: u64) -> Vec<DVec3> {
    let mut next = numbers(seed);
    (0..count).map(|_| size * DVec3::new(next(), next(), next())).collect()
}

/// Every law of hexahedra by points and as a mean, with a Poisson's ratio that goes with it.
fn laws() -> impl Iterator<Item = (Model, VolumeRule, f64)> {
    let models = Model::ALL.into_iter();
    let models = models
        .filter(|model| model.law().is_some() && model.serves_hexahedra_by(Integration::Reduced));
    models.flat_map(|model| {
        let mean = model.keeps_mean_volume().then_some((model, VolumeRule::Clusters, 0.4999));
        std::iter::once((model, VolumeRule::Elements, 0.3)).chain(mean)
    })
}

fn reduced(
    mesh: &Mesh,
    (model, volume, poisson_ratio): (Model, VolumeRule, f64),
) -> BodyDescription<'_> {
    let integration = Integration::Reduced;
    let body = BodyDescription::new("body", mesh, material(poisson_ratio));
    BodyDescription { model, volume, integration, ..body }
}

/// What may fill cells: a part between planes along the axes, a layer of a tenth, the corner that a plane through three others cuts
/// off, and all but for its share.
fn parts(count: usize) -> Vec<Filled> {
    let between = |ends: [[f64; 2]; 3]| {
        let wide = ends.map(|[a, b]| (b - a) * (b - a) / 12.0);
        Filled {
            share: ends.iter().map(|[a, b]| 0.5 * (b - a)).product(),
            middle: ends.map(|[a, b]| 0.5 * (a + b)),
            spread: [wide[0], wide[1], wide[2], 0.0, 0.0, 0.0],
        }
    };
    let corner = Filled {
        share: 1.0 / 6.0,
        middle: [-0.5, -0.5, 0.5],
        spread: [0.15, 0.15, 0.15, 0.05, 0.05, -0.05],
    };
    let kinds = [
        between([[-1.0, 0.2], [-0.3, 1.0], [-1.0, 1.0]]),
        between([[-1.0, 1.0], [-1.0, 1.0], [-1.0, -0.8]]),
        corner,
        Filled::evenly(0.4),
    ];
    (0..count).map(|i| kinds[i % 4]).collect()
}

/// The same body, filled and filled in part.
fn filled<'a>(body: BodyDescription<'a>, parts: &'a [Filled]) -> [BodyDescription<'a>; 2] {
    let cut = BodyDescription { filled: Some(&parts[..body.hexahedra.len()]), ..body.clone() };
    [body, cut]
}

fn world(body: &BodyDescription) -> World {
    let workers = Workers::serial().with_instruction_set(InstructionSet::Portable).unwrap();
    common::world::<f64>(body, &vec![DVec3::ZERO; body.points.len()], workers)
}

fn respond(world: &mut World, u: &[DVec3]) -> Response {
    common::displace::<f64>(world, u);
    common::respond::<f64>(world, u.len(), TangentKind::Exact)
}

/// Displacements of an affine map.
fn affine(mesh: &Mesh, f: DMat3) -> Vec<DVec3> {
    mesh.points.iter().map(|x| f * *x - *x).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

#[test]
fn forces_and_tangents_are_derivatives_to_nine_digits() {
    let (mesh, parts) = (shaken(2, 0.25, 3), parts(8));
    for (law, body) in laws().flat_map(|law| filled(reduced(&mesh, law), &parts).map(|b| (law, b)))
    {
        let mut world = world(&body);
        let n = mesh.points.len();
        for (size, seed) in [(0.02, 1), (0.2, 2)] {
            let u = noise(n, size, seed);
            let along = noise(n, 1.0, seed + 10);
            let direction: Vec<f64> = along.iter().flat_map(DVec3::to_array).collect();
            let at = respond(&mut world, &u);
            let mut state = |t: f64| {
                let u: Vec<DVec3> = u.iter().zip(&along).map(|(u, d)| *u + t * *d).collect();
                respond(&mut world, &u)
            };
            // differences of sixth order; the compression term has jumps in its fourth derivative, so steps are small
            let h = 2e-4;
            let steps = [1.0, 2.0, 3.0].map(|k| [state(k * h), state(-k * h)]);
            let weights = [45.0, -9.0, 1.0];
            let slope = |of: &dyn Fn(&Response) -> f64| {
                let terms = steps.iter().zip(weights);
                terms.map(|([a, b], w)| w * (of(a) - of(b))).sum::<f64>() / (60.0 * h)
            };
            let energy = slope(&|state| state.energy);
            let error = (energy + dot(&at.force, &direction)).abs();
            let size = norm(&at.force) * norm(&direction);
            assert!(error < 1e-9 * size, "{law:?}: force off by {:e}", error / size);
            let m = 3 * n;
            let product: Vec<f64> =
                (0..m).map(|i| dot(&at.tangent[m * i..m * (i + 1)], &direction)).collect();
            let differences: Vec<f64> = (0..m).map(|i| -slope(&|state| state.force[i])).collect();
            let error = max_difference(&product, &differences) / max_abs(&product);
            assert!(error < 1e-9, "{law:?}: tangent off by {error:e}");
        }
    }
}

#[test]
fn turns_cost_nothing() {
    let (mesh, parts) = (shaken(2, 0.25, 4), parts(8));
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1));
    let laws = laws().filter(|law| law.0 != Model::Linear);
    for (law, body) in laws.flat_map(|law| filled(reduced(&mesh, law), &parts).map(|b| (law, b))) {
        let mut world = world(&body);
        let u = noise(mesh.points.len(), 0.2, 5);
        let turned: Vec<DVec3> =
            mesh.points.iter().zip(&u).map(|(x, u)| turn * (*x + *u) - *x).collect();
        let [a, b] = [u, turned].map(|u| respond(&mut world, &u).energy);
        assert!((a - b).abs() < 1e-14 * a, "{law:?}: {a} {b}");
    }
}

/// An affine displacement of 15 % is in equilibrium inside shaken cells.
#[test]
fn the_patch_test_is_passed() {
    let (mesh, regular) = (shaken(3, 0.25, 6), shaken(3, 0.0, 6));
    let size = 3.0 * CELL;
    let f = DMat3::IDENTITY
        + 0.15 * DMat3::from_cols_array(&[0.8, -0.3, 0.5, 0.9, -1.0, 0.2, -0.4, 0.7, 0.6]);
    // matter that repeats from cell to cell, whatever part of them it fills
    let cut = parts(4).into_iter().map(|part| vec![part; 27]).collect::<Vec<_>>();
    for law in laws() {
        let mut bodies = vec![reduced(&mesh, law)];
        let in_part = |filled| BodyDescription { filled: Some(filled), ..reduced(&regular, law) };
        bodies.extend(cut.iter().map(|filled| in_part(&filled[..])));
        for body in bodies {
            let mesh = Mesh { points: body.points.to_vec(), ..Mesh::default() };
            let at = respond(&mut world(&body), &affine(&mesh, f));
            let largest = max_abs(&at.force);
            for (x, f) in mesh.points.iter().zip(at.force.chunks(3)) {
                let inside = x.to_array().iter().all(|x| *x > 1e-9 && *x < size - 1e-9);
                let f = max_abs(f);
                assert!(!inside || f < 1e-13 * largest, "{law:?}: {f:e} of {largest}");
            }
        }
    }
}

fn zero_modes<const N: usize>(body: &BodyDescription) -> usize {
    let at = respond(&mut world(body), &vec![DVec3::ZERO; body.points.len()]);
    let mut matrix = [[0.0; N]; N];
    for (row, from) in matrix.iter_mut().zip(at.tangent.chunks(N)) {
        row.copy_from_slice(from);
    }
    let (values, _) = symmetric_eigen(matrix);
    // the softest hourglass mode has some hundredths of the shear modulus times the edge, which is 0.3 here, and a thousandth of
    // that where a layer of a tenth fills the cell
    assert!(values.iter().all(|value| *value > -1e-12), "{values:?}");
    values.iter().filter(|value| value.abs() < 1e-6).count()
}

#[test]
fn rigid_motions_are_the_only_zero_modes() {
    for law in laws() {
        let parts = parts(8);
        for mesh in [cell(0.0, 0), cell(0.2, 7)] {
            for first in 0..4 {
                for body in filled(reduced(&mesh, law), &parts[first..]) {
                    assert_eq!(zero_modes::<24>(&body), 6, "{law:?} {:?}", body.filled);
                }
            }
        }
        for body in filled(reduced(&shaken(2, 0.25, 8), law), &parts) {
            assert_eq!(zero_modes::<81>(&body), 6, "{law:?}");
        }
    }
}

/// Uniaxial compression without stress across: no hourglass mode goes soft, whatever Poisson's ratio.
#[test]
fn hourglass_modes_stay_stiff_under_compression() {
    let (mesh, mut parts) = (cell(0.0, 0), parts(2));
    // the whole cell has some hundredths; a thin layer is bent the more easily
    parts.push(Filled::evenly(1.0));
    for (poisson_ratio, part) in
        [0.0, 0.3, 0.45, 0.4999].into_iter().flat_map(|nu| parts.iter().map(move |part| (nu, part)))
    {
        let bound = if part.is_even() { 0.04 } else { 1e-5 };
        for volume in [VolumeRule::Elements, VolumeRule::Clusters] {
            let mu = material(poisson_ratio).lame().unwrap().mu;
            let body = reduced(&mesh, (Model::NeoHookean, volume, poisson_ratio));
            let filled = Some(std::slice::from_ref(part));
            let mut world = world(&BodyDescription { filled, ..body });
            for stretch in [1.0, 0.6, 0.4, 0.25] {
                let at = |across: f64| {
                    affine(&mesh, DMat3::from_diagonal(DVec3::new(stretch, across, across)))
                };
                // the vertices at the far side along y are pulled back where the stretch across is too large
                let (mut low, mut high) = (0.5, 2.5);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    let force = respond(&mut world, &at(middle)).force;
                    let far = mesh.points.iter().zip(force.chunks(3));
                    let pull: f64 = far.filter(|(x, _)| x.y > 0.5).map(|(_, f)| f[1]).sum();
                    if pull > 0.0 { low = middle } else { high = middle }
                }
                let tangent = respond(&mut world, &at(low)).tangent;
                // displacements of the modes: q_g = 1 along one axis, which leave the mean gradient as it is
                let mut block = [[0.0; 12]; 12];
                let value = |a: usize, g: usize| {
                    let [x, y, z] = (mesh.points[a] * 2.0 - DVec3::ONE).to_array().map(f64::signum);
                    let [a, b, c] = part.middle;
                    // less the gradient in the middle of what is filled
                    match g {
                        0 => x * y - b * x - a * y,
                        1 => y * z - c * y - b * z,
                        2 => z * x - a * z - c * x,
                        _ => x * y * z - b * c * x - c * a * y - a * b * z,
                    }
                };
                for (i, j) in (0..12).flat_map(|i| (0..12).map(move |j| (i, j))) {
                    for (a, b) in (0..8).flat_map(|a| (0..8).map(move |b| (a, b))) {
                        let entry = tangent[(3 * a + i % 3) * 24 + 3 * b + j % 3];
                        block[i][j] += value(a, i / 3) * entry * value(b, j / 3);
                    }
                }
                let (values, _) = symmetric_eigen(block);
                let least = values.into_iter().fold(f64::INFINITY, f64::min) / (mu * CELL);
                assert!(
                    least > bound,
                    "nu {poisson_ratio}, {volume:?}, {stretch}: {least} {part:?}"
                );
            }
        }
    }
}
