//! Hexahedra, ten-node tetrahedra and quadrilaterals: reference vectors, derivatives, rigid motions, definite tangents, and the
//! same through every instruction set and number of threads.

use crate::common;
use bevy_ecs::prelude::*;
use glam::{DMat3, DQuat, DVec3};
use sinew_engine::element_kind::ElementKind;
use sinew_engine::isoparametric::{
    CORNERS, MIDDLES, TETRAHEDRON_POINTS, tetrahedron10_derivatives, tetrahedron10_shape,
};
use sinew_engine::lanes::InstructionSet;
use sinew_engine::law::TangentKind;
use sinew_engine::mesh::Mesh;
use sinew_engine::mesh::generate::irregular_box_tets;
use sinew_engine::scalar::Scalar;
use sinew_engine::workers::Workers;
use sinew_models::axes::description::{AxesDescription, AxisAngle, AxisFamily, FibreForm};
use sinew_models::body::sheet::{MembraneDescription, MembraneError, MembraneModel, PlaneState};
use sinew_models::body::{
    BodyDescription, BodyError, Evaluation, Integration, Model, VolumeRule, spawn_body,
};
use sinew_models::element::face;
use sinew_models::material::{LameParameters, YoungPoisson};

/// Models of a material that hexahedra have.
fn solids() -> impl Iterator<Item = Model> {
    Model::ALL.into_iter().filter(|model| model.law().is_some() && model.serves_hexahedra())
}

const SHEETS: [MembraneModel; 4] = [
    MembraneModel::Biquadratic,
    MembraneModel::CompressibleBiquadratic,
    MembraneModel::Linear,
    MembraneModel::Corotational,
];

fn material(nu: f64) -> YoungPoisson {
    YoungPoisson { young_modulus: 1.0, poisson_ratio: nu, density: 1.0 }
}

/// Numbers between -1 and 1.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Two distorted hexahedra that share a face.
fn bricks() -> (Vec<DVec3>, Vec<[u32; 8]>) {
    let mut next = noise(3);
    let point = |i: u32| {
        let (x, y, z) = (i % 3, i / 3 % 2, i / 6);
        DVec3::new(f64::from(x), f64::from(y), f64::from(z))
    };
    let points = (0..12).map(|i| point(i) + 0.15 * DVec3::new(next(), next(), next())).collect();
    (points, vec![[0, 1, 4, 3, 6, 7, 10, 9], [1, 2, 5, 4, 7, 8, 11, 10]])
}

/// A body of such hexahedra.
fn of_bricks<'a>(
    points: &'a [DVec3],
    hexahedra: &'a [[u32; 8]],
    poisson_ratio: f64,
) -> BodyDescription<'a> {
    let plain = BodyDescription::from_parts("body", points, &[], material(poisson_ratio));
    BodyDescription { hexahedra, ..plain }
}

/// Two ten-node tetrahedra that share a face, their edges curved.
fn tens() -> Mesh {
    let mut next = noise(9);
    let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.1], [0.1, 0.2, 1.0], [0.9, 0.8, 0.9]];
    let points = corners.map(DVec3::from_array).to_vec();
    let tetrahedra = vec![[0, 1, 2, 3], [1, 4, 2, 3]];
    let mut mesh = Mesh { points, tetrahedra, ..Mesh::default() }.with_second_order();
    mesh.points.iter_mut().for_each(|p| *p += 0.05 * DVec3::new(next(), next(), next()));
    mesh
}

/// Two quadrilaterals that share a side, warped a little.
fn plates() -> (Vec<DVec3>, Vec<[u32; 4]>) {
    let mut next = noise(5);
    let point = |i: u32| DVec3::new(f64::from(i % 3), f64::from(i / 3), 0.0);
    let points = (0..6).map(|i| point(i) + 0.15 * DVec3::new(next(), next(), next())).collect();
    (points, vec![[0, 1, 4, 3], [1, 2, 5, 4]])
}

/// What a body gives at some displacements, in the user's order.
struct Response {
    energy: f64,
    forces: Vec<DVec3>,
    /// Rows and columns `3 vertex + axis`.
    tangent: Vec<Vec<f64>>,
    masses: Vec<f64>,
}

fn world<S: Scalar>(body: &BodyDescription, set: InstructionSet) -> World {
    let workers = Workers::serial().with_instruction_set(set).unwrap();
    common::world::<S>(body, &vec![DVec3::ZERO; body.points.len()], workers)
}

fn respond<S: Scalar>(world: &mut World, u: &[DVec3], kind: TangentKind) -> Response {
    common::displace::<S>(world, u);
    let all = common::respond::<S>(world, u.len(), kind);
    let forces = all.force.chunks(3).map(DVec3::from_slice).collect();
    let tangent = all.tangent.chunks(3 * u.len()).map(<[f64]>::to_vec).collect();
    Response { energy: all.energy, forces, tangent, masses: all.mass }
}

fn sizes(tangent: &[Vec<f64>]) -> f64 {
    tangent.iter().flatten().fold(0.0, |m: f64, x| m.max(x.abs()))
}

/// Whether a symmetric matrix plus `shift` on its diagonal has a Cholesky factor.
fn is_definite(matrix: &[Vec<f64>], shift: f64) -> bool {
    let n = matrix.len();
    let mut l = vec![vec![0.0; n]; n];
    for i in 0..n {
        for j in 0..=i {
            let own = matrix[i][j] + if i == j { shift } else { 0.0 };
            let sum = own - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i == j {
                if sum <= 0.0 {
                    return false;
                }
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
        }
    }
    true
}

/// Calls `check` with every body of this file and a name.
fn for_bodies(mut check: impl FnMut(&BodyDescription, &str, bool)) {
    let (points, hexahedra) = bricks();
    for integration in [Integration::Full, Integration::Reduced] {
        for model in solids() {
            let body = of_bricks(&points, &hexahedra, 0.4);
            let body = BodyDescription { model, integration, ..body };
            check(&body, &format!("{}, {integration:?}", model.name()), model == Model::Linear);
        }
        for model in solids().filter(|model| model.keeps_mean_volume()) {
            for nu in [0.4, 0.49] {
                let body = BodyDescription {
                    model,
                    integration,
                    volume: VolumeRule::Clusters,
                    ..of_bricks(&points, &hexahedra, nu)
                };
                let name = format!("{}, {integration:?}, mean volume, {nu}", model.name());
                check(&body, &name, model == Model::Linear);
            }
        }
    }
    let mesh = tens();
    for model in Model::ALL.into_iter().filter(|model| model.serves_tetrahedra10()) {
        let body = BodyDescription { model, ..BodyDescription::new("body", &mesh, material(0.4)) };
        check(&body, &format!("{}, ten nodes", model.name()), false);
        if model.keeps_mean_volume() {
            let material = material(0.49);
            let body = BodyDescription { volume: VolumeRule::Clusters, material, ..body };
            check(&body, &format!("{}, ten nodes, mean volume", model.name()), false);
        }
    }
    // six tetrahedra round a diagonal of each, in clusters that share a face
    let ring = [1, 2, 3, 7, 4, 5, 1];
    let of_brick = |h: &[u32; 8]| {
        let h = *h;
        ring.windows(2).map(move |pair| [h[0], h[pair[0]], h[pair[1]], h[6]]).collect::<Vec<_>>()
    };
    let tetrahedra: Vec<[u32; 4]> = hexahedra.iter().flat_map(of_brick).collect();
    let clusters: Vec<u32> = (0..12).map(|t| if t < 5 { 7 } else { 3 }).collect();
    for model in solids().filter(|model| model.keeps_mean_volume()) {
        for nu in [0.1, 0.4, 0.49] {
            let body = BodyDescription {
                model,
                volume: VolumeRule::Clusters,
                clusters: Some(&clusters),
                ..BodyDescription::from_parts("body", &points, &tetrahedra, material(nu))
            };
            check(&body, &format!("{}, clusters, {nu}", model.name()), model == Model::Linear);
        }
    }
    // axes alone and beside a material, single fibres, volume
    let turned = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7);
    let families = [[turned * DVec3::X], [turned * DVec3::Y], [turned * DVec3::Z]];
    let family = |i: usize, modulus| AxisFamily::new(["a", "b", "c"][i], &families[i], modulus);
    let angle = |families, modulus| AxisAngle { families, modulus };
    let triad = AxesDescription {
        families: vec![family(0, 3.0), family(1, 0.5), family(2, 0.7)],
        angles: vec![angle([0, 1], 0.3), angle([0, 2], 0.2), angle([1, 2], 0.4)],
        volume_modulus: 0.6,
    };
    let fibre = AxesDescription {
        families: vec![family(0, 3.0)],
        volume_modulus: 0.4,
        ..AxesDescription::default()
    };
    let biquadratic = AxesDescription {
        families: vec![AxisFamily { form: FibreForm::Biquadratic, ..family(1, 3.0) }],
        ..AxesDescription::default()
    };
    for (name, model, axes) in [
        ("axes", Model::Axes, triad.clone()),
        ("axes and material", Model::StVK, triad),
        ("fibres and volume", Model::StVK, fibre),
        ("biquadratic fibres", Model::StVK, biquadratic.clone()),
    ] {
        let body =
            BodyDescription { model, axes: Some(axes), ..of_bricks(&points, &hexahedra, 0.3) };
        check(&body, name, false);
    }
    let axes = Some(biquadratic);
    let body = BodyDescription { axes, ..BodyDescription::new("body", &mesh, material(0.3)) };
    check(&body, "biquadratic fibres, ten nodes", false);
    let (points, quads) = plates();
    for model in SHEETS {
        for plane in [PlaneState::Stress, PlaneState::Strain] {
            let sheet = MembraneDescription::new(&[], 0.1, material(0.3));
            let sheet = MembraneDescription { quads: &quads, plane, model, ..sheet };
            let body = common::sheet(&points, sheet);
            check(&body, model.name(), model == MembraneModel::Linear);
        }
    }
}

fn displacements(count: usize, size: f64, seed: u64) -> Vec<DVec3> {
    let mut next = noise(seed);
    (0..count).map(|_| size * DVec3::new(next(), next(), next())).collect()
}

#[test]
fn derivatives_of_energy_and_force() {
    for_bodies(|body, name, _| {
        let mut world = world::<f64>(body, InstructionSet::Portable);
        let n = body.points.len();
        // the last has points that are turned over
        for (size, seed) in [(0.05, 1), (0.3, 2), (0.7, 3)] {
            let u = displacements(n, size, seed);
            let at = respond::<f64>(&mut world, &u, TangentKind::Exact);
            let scale = sizes(&at.tangent);
            let h = 1e-6;
            for v in 0..n {
                for axis in 0..3 {
                    let mut moved = [u.clone(), u.clone()];
                    moved[0][v][axis] += h;
                    moved[1][v][axis] -= h;
                    let [a, b] = moved.map(|u| respond::<f64>(&mut world, &u, TangentKind::Exact));
                    let slope = (a.energy - b.energy) / (2.0 * h);
                    let error = (slope + at.forces[v][axis]).abs();
                    assert!(error < 1e-8 * scale, "{name}: force off by {error:e}");
                    for w in 0..n {
                        for x in 0..3 {
                            let slope = (b.forces[w][x] - a.forces[w][x]) / (2.0 * h);
                            let own = at.tangent[3 * w + x][3 * v + axis];
                            // stiffness warping aside, every law has its exact tangent
                            let error = (slope - own).abs();
                            assert!(error < 1e-7 * scale, "{name}: tangent off by {error:e}");
                        }
                    }
                }
            }
        }
    });
}

/// In an even compression the mean is that of every point: what is left is the term that holds points.
#[test]
fn points_that_lost_half_their_volume_are_held() {
    let (corners, hexahedra) = bricks();
    let (even, tens) = (corners.iter().map(|x| x.round()).collect::<Vec<_>>(), tens());
    for (model, nu, ratio) in [Model::NeoHookean, Model::StVKVolume].into_iter().flat_map(|model| {
        [0.0, 0.3, 0.4999]
            .into_iter()
            .flat_map(move |nu| [0.8, 0.5, 0.2, 0.0, -0.5_f64].map(|j| (model, nu, j)))
    }) {
        let LameParameters { lambda, mu } = material(nu).lame().unwrap();
        let flat = 0.5 * (lambda + mu).min(10.0 * mu);
        let held = flat * ((0.5 - ratio).max(0.0) / 0.5).powi(4);
        let bricks = BodyDescription {
            hexahedra: &hexahedra,
            ..BodyDescription::from_parts("body", &even, &[], material(nu))
        };
        for body in [bricks, BodyDescription::new("body", &tens, material(nu))] {
            let energies = [VolumeRule::Elements, VolumeRule::Clusters].map(|volume| {
                let body = BodyDescription { model, volume, ..body.clone() };
                let u: Vec<DVec3> =
                    body.points.iter().map(|x| (ratio - 1.0) * x.x * DVec3::X).collect();
                let mut world = world::<f64>(&body, InstructionSet::Portable);
                let Response { energy, masses, .. } =
                    respond::<f64>(&mut world, &u, TangentKind::Exact);
                energy / masses.iter().sum::<f64>()
            });
            let error = energies[1] - energies[0] - held;
            assert!(
                error.abs() < 1e-12 * energies[1].max(1.0),
                "{model:?} {nu} {ratio}: {error:e}"
            );
        }
    }
}

#[test]
fn rigid_motions_cost_nothing() {
    for_bodies(|body, name, linear| {
        let mut world = world::<f64>(body, InstructionSet::Portable);
        let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 2.0));
        let way = DVec3::new(3.0, -1.0, 2.0);
        let moved = |x: &DVec3| if linear { way } else { turn * *x + way - *x };
        let u: Vec<DVec3> = body.points.iter().map(moved).collect();
        let at = respond::<f64>(&mut world, &u, TangentKind::Exact);
        let scale = sizes(&at.tangent);
        assert!(at.energy.abs() < 1e-12 * scale, "{name}: {}", at.energy);
        assert!(at.forces.iter().all(|f| f.length() < 1e-12 * scale), "{name}");
        // forces balance at any state, and so do their moments
        let u = displacements(body.points.len(), 0.3, 7);
        let at = respond::<f64>(&mut world, &u, TangentKind::Exact);
        let sum: DVec3 = at.forces.iter().sum();
        assert!(sum.length() < 1e-13 * scale, "{name}: {sum}");
        let places = body.points.iter().zip(&u).map(|(x, u)| if linear { *x } else { *x + *u });
        let moment: DVec3 = places.zip(&at.forces).map(|(x, f)| x.cross(*f)).sum();
        assert!(moment.length() < 1e-13 * scale, "{name}: {moment}");
    });
}

#[test]
fn stand_ins_are_definite() {
    for_bodies(|body, name, _| {
        let mut world = world::<f64>(body, InstructionSet::Portable);
        let n = body.points.len();
        let squash = |x: &DVec3| -0.6 * x.x * DVec3::X;
        let states = [
            displacements(n, 0.3, 11),
            displacements(n, 1.5, 12),
            body.points.iter().map(squash).collect(),
            body.points.iter().map(|x| -2.0 * x.x * DVec3::X).collect(),
        ];
        for u in states {
            for kind in [TangentKind::GaussNewton, TangentKind::Projected] {
                let tangent = respond::<f64>(&mut world, &u, kind).tangent;
                let shift = 1e-9 * sizes(&tangent);
                assert!(is_definite(&tangent, shift), "{name}: {kind:?}");
            }
        }
        // the definite tangent of axes leaves some terms out everywhere
        if body.axes.is_some() {
            return;
        }
        // where nothing is compressed nothing is clamped; with a volume term in J bodies lose stiffness in dilation
        let in_j = ["neo_hookean", "svk_volume"].iter().any(|model| name.starts_with(model));
        let stretch = if in_j { 0.0 } else { 0.3 };
        let u: Vec<DVec3> = body.points.iter().map(|x| stretch * *x).collect();
        let exact = respond::<f64>(&mut world, &u, TangentKind::Exact).tangent;
        let projected = respond::<f64>(&mut world, &u, TangentKind::Projected).tangent;
        let scale = sizes(&exact);
        for (a, b) in exact.iter().flatten().zip(projected.iter().flatten()) {
            assert!((a - b).abs() < 1e-12 * scale, "{name}: {a} {b}");
        }
    });
}

#[test]
fn instruction_sets_and_precisions_agree() {
    for_bodies(|body, name, _| {
        let u = displacements(body.points.len(), 0.2, 21);
        for kind in [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected] {
            let reference =
                respond::<f64>(&mut world::<f64>(body, InstructionSet::Portable), &u, kind);
            let scale = sizes(&reference.tangent);
            let check = |other: Response, tolerance: f64, what: &str| {
                let energy = (other.energy - reference.energy).abs();
                assert!(energy <= tolerance * scale, "{name} {what}: energy {energy:e}");
                for (a, b) in other.forces.iter().zip(&reference.forces) {
                    assert!((*a - *b).length() < tolerance * scale, "{name} {what}: {a} {b}");
                }
                let both = other.tangent.iter().flatten().zip(reference.tangent.iter().flatten());
                for (a, b) in both {
                    assert!((a - b).abs() < tolerance * scale, "{name} {what} {kind:?}: {a} {b}");
                }
            };
            for set in InstructionSet::available() {
                check(respond::<f64>(&mut world::<f64>(body, set), &u, kind), 1e-13, "f64");
                check(respond::<f32>(&mut world::<f32>(body, set), &u, kind), 1e-5, "f32");
            }
        }
    });
}

#[test]
fn isotropic_axes_are_linear_elasticity_at_rest() {
    let (points, hexahedra) = bricks();
    let linear = BodyDescription { model: Model::Linear, ..of_bricks(&points, &hexahedra, 0.4) };
    let axes = AxesDescription::isotropic(material(0.4).lame().unwrap());
    let axes = BodyDescription { model: Model::Axes, axes: Some(axes), ..linear.clone() };
    let rest = vec![DVec3::ZERO; points.len()];
    let kind = TangentKind::Exact;
    let a = respond::<f64>(&mut world::<f64>(&linear, InstructionSet::Portable), &rest, kind);
    let b = respond::<f64>(&mut world::<f64>(&axes, InstructionSet::Portable), &rest, kind);
    let scale = sizes(&a.tangent);
    for (a, b) in a.tangent.iter().flatten().zip(b.tangent.iter().flatten()) {
        assert!((a - b).abs() < 1e-12 * scale, "{a} {b}");
    }
}

#[test]
fn masses_are_row_sums() {
    let points = CORNERS.map(DVec3::from_array);
    let hexahedra = [[0, 1, 2, 3, 4, 5, 6, 7]];
    let body = of_bricks(&points, &hexahedra, 0.3);
    let mut solid = world::<f64>(&body, InstructionSet::Portable);
    let at = respond::<f64>(&mut solid, &[DVec3::ZERO; 8], TangentKind::Exact);
    assert!(at.masses.iter().all(|m| (m - 1.0).abs() < 1e-14));
    let (points, quads) = plates();
    let sheet = MembraneDescription::new(&[], 0.1, material(0.3));
    let body = BodyDescription {
        membrane: Some(MembraneDescription { quads: &quads, ..sheet }),
        ..BodyDescription::from_parts("body", &points, &[], material(0.4))
    };
    let mut plate = world::<f64>(&body, InstructionSet::Portable);
    let at = respond::<f64>(&mut plate, &[DVec3::ZERO; 6], TangentKind::Exact);
    assert!(at.masses.iter().all(|m| *m > 0.0));
}

/// Places and weights of a rule on a tetrahedron exact to degree 7 and more: Gauss points on a cube that is drawn together to a
/// tetrahedron.
fn fine_rule() -> Vec<([f64; 4], f64)> {
    let (a, b) = (
        (3.0f64 / 7.0 - 2.0 / 7.0 * 1.2f64.sqrt()).sqrt(),
        (3.0f64 / 7.0 + 2.0 / 7.0 * 1.2f64.sqrt()).sqrt(),
    );
    let (wa, wb) = ((18.0 + 30f64.sqrt()) / 36.0, (18.0 - 30f64.sqrt()) / 36.0);
    let line = [(a, wa), (-a, wa), (b, wb), (-b, wb)].map(|(x, w)| (0.5 + 0.5 * x, 0.5 * w));
    let mut rule = Vec::new();
    for (x, wx) in line {
        for (y, wy) in line {
            for (z, wz) in line {
                let l = [x, (1.0 - x) * y, (1.0 - x) * (1.0 - y) * z];
                let weight = wx * wy * wz * (1.0 - x) * (1.0 - x) * (1.0 - y);
                rule.push(([1.0 - l[0] - l[1] - l[2], l[0], l[1], l[2]], weight));
            }
        }
    }
    rule
}

#[test]
fn shape_functions_of_ten_node_tetrahedra() {
    let at = |a: usize| -> [f64; 4] {
        let ends = if a < 4 { [a, a] } else { MIDDLES[a - 4] };
        std::array::from_fn(|i| 0.5 * ends.iter().filter(|e| **e == i).count() as f64)
    };
    for a in 0..10 {
        let shape = tetrahedron10_shape(at(a));
        assert!((0..10).all(|b| shape[b] == f64::from(u8::from(a == b))), "{a}: {shape:?}");
    }
    for (l, _) in fine_rule() {
        let shape = tetrahedron10_shape(l);
        assert!((shape.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        for j in 0..3 {
            let h = 1e-6;
            let moved = [h, -h].map(|h| {
                let mut l = l;
                (l[j + 1], l[0]) = (l[j + 1] + h, l[0] - h);
                tetrahedron10_shape(l)
            });
            for (a, d) in tetrahedron10_derivatives(l).iter().enumerate() {
                let slope = (moved[0][a] - moved[1][a]) / (2.0 * h);
                assert!((slope - d[j]).abs() < 1e-9, "{a} {j}: {slope} {}", d[j]);
            }
        }
    }
    // the four points are exact for squares of coordinates
    for (i, j) in [(0, 0), (1, 3)] {
        let four = TETRAHEDRON_POINTS.iter().map(|l| l[i] * l[j] / 24.0).sum::<f64>();
        let fine = fine_rule().iter().map(|(l, w)| w * l[i] * l[j]).sum::<f64>();
        assert!((four - fine).abs() < 1e-15, "{four} {fine}");
    }
}

/// At small strain the energy of straight elements is of second degree, which the four points integrate exactly.
#[test]
fn small_strain_energy_of_ten_node_tetrahedra_is_exact() {
    let corners = [[0.0; 3], [1.0, 0.1, 0.0], [0.2, 0.9, 0.1], [0.1, 0.2, 1.1]];
    let points = corners.map(DVec3::from_array).to_vec();
    let linear = Mesh { points, tetrahedra: vec![[0, 1, 2, 3]], ..Mesh::default() };
    let mesh = linear.with_second_order();
    let u = displacements(10, 1e-7, 31);
    let lame = material(0.4).lame().unwrap();
    let sum = |l: [f64; 4]| {
        let d = tetrahedron10_derivatives(l);
        let by = |field: &[DVec3]| {
            let along = |j: usize| field.iter().zip(&d).map(|(p, d)| *p * d[j]).sum::<DVec3>();
            DMat3::from_cols(along(0), along(1), along(2))
        };
        let edges = by(&mesh.points);
        let g = by(&u) * edges.inverse();
        let strain = (g + g.transpose()) * 0.5;
        let squares: f64 = strain.to_cols_array().iter().map(|e| e * e).sum();
        let trace = strain.x_axis.x + strain.y_axis.y + strain.z_axis.z;
        edges.determinant() * (lame.mu * squares + 0.5 * lame.lambda * trace * trace)
    };
    let exact: f64 = fine_rule().into_iter().map(|(l, w)| w * sum(l)).sum();
    for model in Model::ALL.into_iter().filter(|model| model.serves_tetrahedra10()) {
        let body = BodyDescription { model, ..BodyDescription::new("body", &mesh, material(0.4)) };
        let mut world = world::<f64>(&body, InstructionSet::Portable);
        let own = respond::<f64>(&mut world, &u, TangentKind::Exact).energy;
        assert!((own - exact).abs() < 1e-5 * exact, "{}: {own} {exact}", model.name());
    }
}

/// An affine displacement is in equilibrium inside a distorted mesh, whatever the law, edges straight or curved.
#[test]
fn ten_node_tetrahedra_pass_the_patch_test() {
    let whole = irregular_box_tets(DVec3::ONE, [2, 2, 2], 0.15, 3).unwrap().with_second_order();
    let on_surface = |p: &DVec3| p.to_array().iter().any(|x| *x < 1e-9 || *x > 1.0 - 1e-9);
    let inside: Vec<bool> = whole.points.iter().map(|p| !on_surface(p)).collect();
    let mut curved = whole.clone();
    let mut next = noise(8);
    for (p, inside) in curved.points.iter_mut().zip(&inside) {
        if *inside {
            *p += 0.02 * DVec3::new(next(), next(), next());
        }
    }
    let f = DMat3::from_cols(
        DVec3::new(1.1, 0.1, -0.05),
        DVec3::new(0.2, 0.9, 0.1),
        DVec3::new(0.0, -0.1, 1.05),
    );
    for mesh in [&whole, &curved] {
        let u: Vec<DVec3> = mesh.points.iter().map(|x| f * *x - *x).collect();
        for model in Model::ALL.into_iter().filter(|model| model.serves_tetrahedra10()) {
            for volume in [VolumeRule::Elements, VolumeRule::Clusters] {
                if volume == VolumeRule::Clusters && !model.keeps_mean_volume() {
                    continue;
                }
                let body = BodyDescription {
                    model,
                    volume,
                    ..BodyDescription::new("body", mesh, material(0.4))
                };
                let mut world = world::<f64>(&body, InstructionSet::Portable);
                let at = respond::<f64>(&mut world, &u, TangentKind::Exact);
                assert!(at.masses.iter().all(|m| *m > 0.0));
                assert!((at.masses.iter().sum::<f64>() - 1.0).abs() < 1e-3);
                let largest = at.forces.iter().fold(0.0, |m: f64, f| m.max(f.length()));
                // the rule of four points is exact for constant stress only where edges are straight
                let exact = std::ptr::eq(mesh, &whole);
                let bound = if exact { 1e-13 } else { 1e-2 };
                for (f, _) in at.forces.iter().zip(&inside).filter(|(_, inside)| **inside) {
                    let name = model.name();
                    assert!(
                        f.length() < bound * largest,
                        "{name} {volume:?} {exact}: {f} of {largest}"
                    );
                }
            }
        }
    }
}

/// Pressure on the face of a ten-node tetrahedron: its tangent is the symmetric part of the derivative of its forces, the
/// quarters add up to the whole, and on a flat face with straight edges each middle gets a third.
#[test]
fn pressure_on_a_curved_face() {
    let mut next = noise(11);
    let mut vector = |size: f64| [0; 3].map(|_| size * next());
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.2], [0.3, 0.9, -0.1]];
    let middle = |a: usize, b: usize| [0, 1, 2].map(|k| 0.5 * (corners[a][k] + corners[b][k]));
    let [a, b, c] = corners;
    let flat = [a, b, c, middle(0, 1), middle(1, 2), middle(2, 0)];
    let rest = |x: &[[f64; 3]; 6]| {
        let from_first = |i: usize| [0, 1, 2].map(|k| x[i + 1][k] - x[0][k]);
        [0, 1, 2, 3, 4].map(from_first)
    };
    let (pressure, whole) = (3.0, &face::POINTS[0]);
    let area = DVec3::from(b).cross(DVec3::from(c)) / 2.0;
    let forces = face::forces(whole, &rest(&flat), &[[0.0; 3]; 6], pressure);
    for (i, f) in forces.iter().enumerate() {
        let share = if i < 3 { 0.0 } else { 1.0 / 3.0 };
        assert!(DVec3::from(*f).distance(pressure * share * area) < 1e-15, "{i} {f:?}");
    }
    let bent = flat.map(|x| {
        let shift = vector(0.1);
        [0, 1, 2].map(|k| x[k] + shift[k])
    });
    let u = [0; 6].map(|_| vector(0.3));
    let rest = &rest(&bent);
    let forces = |u: &[[f64; 3]; 6]| face::forces(whole, rest, u, pressure);
    let (mut sum, mut volume) = ([[0.0; 3]; 6], 0.0);
    for quarter in &face::POINTS[1..] {
        volume += face::swept_volume(quarter, rest, &u);
        for (sum, f) in sum.iter_mut().zip(face::forces(quarter, rest, &u, pressure)) {
            (0..3).for_each(|k| sum[k] += f[k]);
        }
    }
    let expected = face::swept_volume(whole, rest, &u);
    assert!((volume - expected).abs() < 1e-14, "{volume} {expected}");
    assert!(common::max_difference(sum.as_flattened(), forces(&u).as_flattened()) < 1e-14);
    // forces are of second degree: differences are exact
    let slope = |a: usize, x: usize, b: usize, y: usize| {
        let at = |t: f64| {
            let mut u = u;
            u[b][y] += t;
            forces(&u)[a][x]
        };
        -(at(0.5) - at(-0.5))
    };
    let arms = face::tangent(whole, rest, &u, pressure);
    for (pair, [a, b]) in face::PAIRS.into_iter().enumerate() {
        let block = face::skew(arms[pair]);
        for (x, y) in (0..3).flat_map(|x| (0..3).map(move |y| (x, y))) {
            let symmetric = 0.5 * (slope(a, x, b, y) + slope(b, y, a, x));
            assert!((block[3 * x + y] - symmetric).abs() < 1e-14, "{a} {b} {x} {y}");
            let own = 0.5 * (slope(a, x, a, y) + slope(a, y, a, x));
            assert!(own.abs() < 1e-14, "{a} {own}");
        }
    }
}

#[test]
fn what_ten_node_tetrahedra_do_not_have_is_refused_by_name() {
    let mesh = tens();
    let refused = |change: &dyn Fn(&mut BodyDescription)| {
        let mut body = BodyDescription::new("liver", &mesh, material(0.3));
        change(&mut body);
        spawn_body(&mut common::empty::<f64>(), &body).unwrap_err().to_string()
    };
    let error = refused(&|body| body.model = Model::MassSpring);
    assert!(error.contains("liver") && error.contains("mass_spring"), "{error}");
    let error = refused(&|body| body.evaluation = Evaluation::Pooled);
    assert!(error.contains("fused"), "{error}");
    let error = refused(&|body| body.axes = Some(AxesDescription::default()));
    assert!(error.contains("axes"), "{error}");
    let error = refused(&|body| body.middles = &body.middles[1..]);
    assert!(error.contains("1 of 2"), "{error}");
    let wrong = [mesh.middles[0], [99, 1, 2, 3, 4, 5]];
    let mut body =
        BodyDescription { middles: &wrong, ..BodyDescription::new("liver", &mesh, material(0.3)) };
    let mut world = common::empty::<f64>();
    let error = spawn_body(&mut world, &body).unwrap_err();
    assert!(
        matches!(error, BodyError::Index { kind: ElementKind::Tetrahedron, index: 1, .. }),
        "{error}"
    );
    let [a, b, c, d, e, f] = mesh.middles[1];
    let turned = [mesh.middles[0], [a, b, c, d, f, e]];
    body.middles = &turned;
    let error = spawn_body(&mut world, &body).unwrap_err();
    assert!(
        matches!(error, BodyError::Element { kind: ElementKind::Tetrahedron, index: 1, .. }),
        "{error}"
    );
}

#[test]
fn bad_elements_are_named() {
    let (points, hexahedra) = bricks();
    let fresh = common::empty::<f64>;
    let solid = of_bricks(&points, &hexahedra, 0.3);
    let mut turned = hexahedra.clone();
    turned[1] = [7, 8, 11, 10, 1, 2, 5, 4];
    let body = BodyDescription { hexahedra: &turned, ..solid.clone() };
    let error = spawn_body(&mut fresh(), &body).unwrap_err();
    assert!(
        matches!(error, BodyError::Element { kind: ElementKind::Hexahedron, index: 1, .. }),
        "{error}"
    );
    let body = BodyDescription { hexahedra: &[[0, 1, 2, 3, 4, 5, 6, 99]], ..solid.clone() };
    let error = spawn_body(&mut fresh(), &body).unwrap_err();
    assert!(
        matches!(error, BodyError::Index { kind: ElementKind::Hexahedron, index: 0, .. }),
        "{error}"
    );
    let body = BodyDescription { model: Model::QuadraticSprings, ..solid.clone() };
    let error = spawn_body(&mut fresh(), &body).unwrap_err();
    assert!(matches!(error, BodyError::HexahedronModel { .. }), "{error}");
    let (points, quads) = plates();
    let sheet = MembraneDescription::new(&[], 0.1, material(0.3));
    let spawn = |membrane: MembraneDescription, world: &mut World| {
        let body = BodyDescription {
            membrane: Some(membrane),
            ..BodyDescription::from_parts("body", &points, &[], material(0.4))
        };
        spawn_body(world, &body).unwrap_err()
    };
    let twice = [quads[0], [4, 3, 0, 1]];
    let error = spawn(MembraneDescription { quads: &twice, ..sheet }, &mut fresh());
    let BodyError::Membrane { source, .. } = error else { panic!("{error}") };
    assert!(matches!(source, MembraneError::Duplicate { first: 0, second: 1, .. }), "{source}");
    let folded = [[0, 1, 3, 4]];
    let error = spawn(MembraneDescription { quads: &folded, ..sheet }, &mut fresh());
    let BodyError::Membrane { source, .. } = error else { panic!("{error}") };
    assert!(matches!(source, MembraneError::Quad { quad: 0, .. }), "{source}");
    let model = MembraneModel::Quadratic;
    let error = spawn(MembraneDescription { quads: &quads, model, ..sheet }, &mut fresh());
    let BodyError::Membrane { source, .. } = error else { panic!("{error}") };
    assert!(matches!(source, MembraneError::QuadModel { .. }), "{source}");
}
