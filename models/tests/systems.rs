//! The systems of whole bodies, through entities: every instruction set of this machine against the
//! same sums formed one element at a time, pooled against fused, products against assembled tangents.

use crate::common;

use bevy_ecs::prelude::*;
use common::{KINDS, Motion, max_abs, max_difference, noise, strip};
use glam::DVec3;
use proptest::prelude::*;
use sinew_engine::columns::single_table;
use sinew_engine::element::{TETRAHEDRON_EDGES, TetrahedronVertices};
use sinew_engine::lanes::InstructionSet;
use sinew_engine::law::{ElasticEnergy, EvaluationRequest, TangentKind};
use sinew_engine::matrix::Tangent;
use sinew_engine::mesh::Mesh;
use sinew_engine::mesh::generate::box_tets;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::ForceSchedule;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{Displacement, ElasticForce, RestPosition};
use sinew_engine::workers::Workers;
use sinew_models::body::{BodyDescription, BodyError, Evaluation, Model, spawn_body};
use sinew_models::element::precompute::{RestTetrahedron, SpringConstants};
use sinew_models::element::spring::Stretch;
use sinew_models::element::tetrahedron::{self, Element};
use sinew_models::frame::law::TetrahedronLaw;
use sinew_models::frame::tetrahedra;
use sinew_models::laws::quadratic::{MassSpring, QuadraticSprings};
use sinew_models::laws::svk::FusedStVK;
use sinew_models::material::YoungPoisson;

const LAWS: [(Model, Evaluation); 5] = [
    (Model::CompressibleStVK, Evaluation::Fused),
    (Model::StVK, Evaluation::Pooled),
    (Model::CompressibleStVK, Evaluation::Pooled),
    (Model::QuadraticSprings, Evaluation::Fused),
    (Model::MassSpring, Evaluation::Fused),
];

fn material() -> YoungPoisson {
    YoungPoisson { young_modulus: 1.0, poisson_ratio: 0.4, density: 1.0 }
}

/// A body of the common material.
fn body<'a>(
    name: &'a str,
    points: &'a [DVec3],
    tetrahedra: &'a [[u32; 4]],
    model: Model,
    evaluation: Evaluation,
) -> BodyDescription<'a> {
    BodyDescription {
        model,
        evaluation,
        ..BodyDescription::from_parts(name, points, tetrahedra, material())
    }
}

/// A world with one body, displaced.
fn world<S: Scalar>(
    points: &[DVec3],
    tetrahedra: &[[u32; 4]],
    moved: &[DVec3],
    (model, evaluation): (Model, Evaluation),
    workers: Workers,
) -> World {
    common::world::<S>(&body("b", points, tetrahedra, model, evaluation), moved, workers)
}

/// Energy, forces, diagonal blocks, off-diagonal blocks, clamped elements, by vertex row.
struct Sums {
    energy: f64,
    force: Vec<f64>,
    diagonal: Vec<f64>,
    off: Vec<f64>,
    clamped: u64,
}

fn evaluate<S: Scalar>(world: &mut World, kind: TangentKind) -> Sums {
    world.insert_resource(EvaluationRequest { energy: true, force: true, tangent: Some(kind) });
    world.run_schedule(ForceSchedule);
    let mut forces = world.query::<&ElasticForce<S>>();
    let force = forces.iter(world).flat_map(|f| [f.0[0], f.0[1], f.0[2]].map(S::to_f64)).collect();
    let tangent = world.resource::<Tangent<S>>();
    let flat = |b: &[[S; 9]]| b.as_flattened().iter().map(|x| x.to_f64()).collect();
    Sums {
        energy: world.resource::<ElasticEnergy>().total,
        force,
        diagonal: flat(&tangent.matrix.diagonal),
        off: flat(&tangent.matrix.off_diagonal),
        clamped: tangent.clamped,
    }
}

/// The sums of [`evaluate`] in `f64`, element after element, from the pure functions.
fn one_by_one(world: &mut World, u: &[[f64; 3]], model: Model, kind: TangentKind) -> Sums {
    let mut vertices = world.query::<&RestPosition>();
    let rest: Vec<DVec3> = vertices.iter(world).map(|x| x.0).collect();
    let mut elements = world.query::<&TetrahedronVertices>();
    let elements: Vec<[u32; 4]> = elements.iter(world).map(|t| t.0).collect();
    let edges = &world.resource::<Topology>().edges;
    let block = |a: u32, b: u32| edges.binary_search(&[a.min(b), a.max(b)]).unwrap();
    let mut sums = Sums {
        energy: 0.0,
        force: vec![0.0; 3 * rest.len()],
        diagonal: vec![0.0; 9 * rest.len()],
        off: vec![0.0; 9 * edges.len()],
        clamped: 0,
    };
    let lame = material().lame().unwrap();
    let mut tensile = vec![0.0; edges.len()];
    for rows in elements {
        let shape = RestTetrahedron::new(rows.map(|v| rest[v as usize].to_array())).unwrap();
        for (k, [a, b]) in SpringConstants::new(&shape, lame).tensile.iter().zip(TETRAHEDRON_EDGES)
        {
            tensile[block(rows[a], rows[b])] += k;
        }
        let e = Element::<f64>::new(&shape, lame, model == Model::CompressibleStVK);
        let local = rows.map(|v| u[v as usize]);
        let (energy, force, t) = match model {
            Model::MassSpring => continue,
            Model::QuadraticSprings => {
                let compressed = QuadraticSprings::is_clamped(&e, &local);
                sums.clamped += u64::from(compressed && kind == TangentKind::Projected);
                (
                    QuadraticSprings::energy(&e, &local),
                    QuadraticSprings::forces(&e, &local).unwrap(),
                    QuadraticSprings::tangent(&e, &local, kind),
                )
            }
            _ => {
                let t = tetrahedron::tangent(&e, &local, kind);
                let exact = tetrahedron::tangent(&e, &local, TangentKind::Exact);
                sums.clamped += u64::from(kind == TangentKind::Projected && t != exact);
                (tetrahedron::energy(&e, &local), tetrahedron::forces(&e, &local), t)
            }
        };
        sums.energy += energy;
        for (a, &row) in rows.iter().enumerate() {
            (0..3).for_each(|k| sums.force[3 * row as usize + k] += force[a][k]);
            (0..9).for_each(|k| sums.diagonal[9 * row as usize + k] += t.diagonal[a][k]);
        }
        for [a, b] in TETRAHEDRON_EDGES {
            let m = if rows[a] < rows[b] { t.block(a, b) } else { t.block(b, a) };
            (0..9).for_each(|k| sums.off[9 * block(rows[a], rows[b]) + k] += m[k]);
        }
    }
    if model == Model::MassSpring {
        for (i, (&[a, b], k)) in edges.iter().zip(tensile).enumerate() {
            add_spring(&mut sums, i, [a as usize, b as usize], &rest, u, k, kind);
        }
    }
    sums
}

/// A plain spring, from lengths.
fn add_spring(
    sums: &mut Sums,
    i: usize,
    [a, b]: [usize; 2],
    rest: &[DVec3],
    u: &[[f64; 3]],
    k: f64,
    kind: TangentKind,
) {
    let rest_edge = rest[a] - rest[b];
    let x = rest_edge + DVec3::from_array(u[a]) - DVec3::from_array(u[b]);
    let (l, l0) = (x.length(), rest_edge.length());
    let constant = 2.0 * l0 * l0 * k;
    let pull = constant * (l - l0);
    sums.energy += 0.5 * constant * (l - l0) * (l - l0);
    sums.clamped += u64::from(kind == TangentKind::Projected && pull < 0.0);
    // at length zero the kernels divide by a millionth of the rest length, and x is zero
    let n = x / l.max(1e-6 * l0);
    let geometric = match kind {
        TangentKind::Exact => pull,
        TangentKind::GaussNewton => 0.0,
        TangentKind::Projected => pull.max(0.0),
    } / l.max(1e-6 * l0);
    for p in 0..3 {
        sums.force[3 * a + p] -= pull * n[p];
        sums.force[3 * b + p] += pull * n[p];
        for q in 0..3 {
            let identity = f64::from(u8::from(p == q));
            let m = constant * n[p] * n[q] + geometric * (identity - n[p] * n[q]);
            sums.diagonal[9 * a + 3 * p + q] += m;
            sums.diagonal[9 * b + 3 * p + q] += m;
            sums.off[9 * i + 3 * p + q] -= m;
        }
    }
}

fn compare<S: Scalar>(count: usize, noise: &[f64], motion: Motion) {
    let (points, tetrahedra, moved) = strip(count, noise, motion);
    for law in LAWS {
        for set in InstructionSet::available() {
            let workers = Workers::serial().with_instruction_set(set).unwrap();
            let mut world = world::<S>(&points, &tetrahedra, &moved, law, workers);
            let mut displacements = world.query::<&Displacement<S>>();
            let u: Vec<[f64; 3]> = displacements
                .iter(&world)
                .map(|u| [u.0[0], u.0[1], u.0[2]].map(S::to_f64))
                .collect();
            let still = vec![[0.0; 3]; u.len()];
            let stiffness =
                max_abs(&one_by_one(&mut world, &still, law.0, TangentKind::Exact).diagonal);
            for kind in KINDS {
                let name =
                    format!("{} {} {law:?} {kind:?} {count} {motion:?}", set.name(), S::NAME);
                let expected = one_by_one(&mut world, &u, law.0, kind);
                let found = evaluate::<S>(&mut world, kind);
                let scale = stiffness.max(max_abs(&expected.diagonal));
                let tolerance = 1000.0 * S::EPSILON.to_f64() * scale;
                let near = |what: &str, a: &[f64], b: &[f64]| {
                    let error = max_difference(a, b);
                    assert!(error <= tolerance, "{what} {name}: {:e}", error / scale);
                };
                near("force", &expected.force, &found.force);
                near("diagonal", &expected.diagonal, &found.diagonal);
                near("off-diagonal", &expected.off, &found.off);
                // energy per element of size 1
                let error = (expected.energy - found.energy).abs();
                assert!(error <= tolerance + 1e3 * S::EPSILON.to_f64() * expected.energy, "{name}");
                // an eigenvalue or a tension at the threshold may fall on either side
                if matches!(motion, Motion::Random(_)) && S::NAME == "f64" {
                    assert!(expected.clamped.abs_diff(found.clamped) <= 1, "clamped {name}");
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(24) })]

    #[test]
    fn every_instruction_set_gives_what_single_elements_give(
        count in 1usize..=33,
        noise in prop::collection::vec(-1.0..1.0f64, 97),
        size in prop::sample::select(vec![1e-6, 1e-3, 0.1, 0.6, 3.0]),
    ) {
        compare::<f64>(count, &noise, Motion::Random(size));
        compare::<f32>(count, &noise, Motion::Random(size));
    }
}

#[test]
fn every_remainder_and_degenerate_elements() {
    for count in 1..=33 {
        for motion in [Motion::Rest, Motion::Random(0.3), Motion::Mirrored] {
            compare::<f64>(count, &noise(), motion);
            compare::<f32>(count, &noise(), motion);
        }
    }
}

/// At one point directions are lost; all laws stay finite, and squared lengths keep their values.
#[test]
fn collapsed_bodies_are_finite() {
    for count in [1, 8, 21] {
        let (points, tetrahedra, moved) = strip(count, &noise(), Motion::Collapsed);
        for law in LAWS {
            let mut world = world::<f32>(&points, &tetrahedra, &moved, law, Workers::serial());
            for kind in KINDS {
                let sums = evaluate::<f32>(&mut world, kind);
                let all = sums.force.iter().chain(&sums.diagonal).chain(&sums.off);
                assert!(sums.energy.is_finite() && all.clone().all(|x| x.is_finite()), "{law:?}");
            }
        }
    }
}

fn jittered() -> (Mesh, Vec<DVec3>) {
    let mesh = box_tets(DVec3::new(0.3, 0.2, 0.2), [5, 3, 4]).unwrap();
    let noise = noise();
    let moved = (0..mesh.points.len())
        .map(|i| 0.02 * DVec3::from_array([0, 1, 2].map(|k| noise[(3 * i + k) % 97])))
        .collect();
    (mesh, moved)
}

#[test]
fn pooled_equals_fused() {
    let (mesh, moved) = jittered();
    for model in [Model::StVK, Model::CompressibleStVK] {
        for kind in KINDS {
            let [a, b] = [Evaluation::Fused, Evaluation::Pooled].map(|evaluation| {
                let law = (model, evaluation);
                let workers = Workers::serial();
                let mut w = world::<f64>(&mesh.points, &mesh.tetrahedra, &moved, law, workers);
                evaluate::<f64>(&mut w, kind)
            });
            assert!((a.energy - b.energy).abs() < 1e-12 * a.energy);
            for (x, y) in [(&a.force, &b.force), (&a.diagonal, &b.diagonal), (&a.off, &b.off)] {
                assert!(max_difference(x, y) < 1e-12 * max_abs(x), "{model:?} {kind:?}");
            }
        }
    }
}

/// `K v` by tetrahedra against the product with the assembled matrix.
fn products<L: TetrahedronLaw, S: Scalar>(law: (Model, Evaluation), tolerance: f64) {
    let (mesh, moved) = jittered();
    for size in [0.0, 0.3, 1.0, 3.0] {
        let moved: Vec<DVec3> = moved.iter().map(|u| size * *u).collect();
        for set in InstructionSet::available() {
            for kind in KINDS {
                let workers = Workers::serial().with_instruction_set(set).unwrap();
                let mut w = world::<S>(&mesh.points, &mesh.tetrahedra, &moved, law, workers);
                evaluate::<S>(&mut w, kind);
                let v: Vec<[S; 4]> = (0..mesh.points.len())
                    .map(|i| {
                        let row = [0, 1, 2].map(|k| S::from_f64(noise()[(5 * i + k) % 97]));
                        [row[0], row[1], row[2], S::ZERO]
                    })
                    .collect();
                let mut found = vec![[S::ZERO; 4]; v.len()];
                let outcome = tetrahedra::multiply::<L, S>(&mut w, kind, &v, &mut found);
                if kind == TangentKind::Projected && L::STRESS_PROJECTION {
                    assert!(outcome.unwrap_err().to_string().contains("assemble"));
                    continue;
                }
                outcome.unwrap();
                let expected = common::assembled(&w, &v);
                let wide = |rows: &[[S; 4]]| -> Vec<f64> {
                    rows.as_flattened().iter().map(|x| x.to_f64()).collect()
                };
                let (a, b) = (wide(&expected), wide(&found));
                let error = max_difference(&a, &b) / max_abs(&a);
                assert!(error < tolerance, "{law:?} {kind:?} {} {size}: {error:e}", set.name());
            }
        }
    }
}

#[test]
fn products_without_assembly() {
    products::<FusedStVK, f64>((Model::StVK, Evaluation::Fused), 1e-12);
    products::<FusedStVK, f64>((Model::CompressibleStVK, Evaluation::Fused), 1e-12);
    products::<FusedStVK, f32>((Model::CompressibleStVK, Evaluation::Fused), 1e-5);
    products::<QuadraticSprings, f64>((Model::QuadraticSprings, Evaluation::Fused), 1e-12);
}

#[test]
fn quadratic_springs_have_no_pooled_evaluation() {
    for model in [Model::QuadraticSprings, Model::MassSpring] {
        let mut world = common::empty::<f64>();
        let (points, tetrahedra, _) = strip(3, &noise(), Motion::Rest);
        let evaluation = Evaluation::Pooled;
        let error = spawn_body(&mut world, &body("b", &points, &tetrahedra, model, evaluation))
            .unwrap_err();
        assert_eq!(error, BodyError::Evaluation { body: "b".into(), model });
        assert!(error.to_string().contains(model.name()) && error.to_string().contains("fused"));
    }
}

/// Bodies of all kinds in one world keep to themselves.
#[test]
fn all_kinds_side_by_side() {
    let mut together = common::empty::<f64>();
    let mesh = box_tets(DVec3::new(0.2, 0.1, 0.1), [4, 2, 2]).unwrap();
    let moved: Vec<DVec3> = jittered().1[..mesh.points.len()].to_vec();
    let mut expected = Vec::new();
    let mut energies = Vec::new();
    let kinds: Vec<_> = LAWS.into_iter().chain(LAWS).collect();
    for (i, &law) in kinds.iter().enumerate() {
        let mut alone =
            world::<f64>(&mesh.points, &mesh.tetrahedra, &moved, law, Workers::serial());
        let sums = evaluate::<f64>(&mut alone, TangentKind::Exact);
        expected.extend(sums.force);
        energies.push(sums.energy);
        let (model, evaluation) = law;
        let name = i.to_string();
        let own = body(&name, &mesh.points, &mesh.tetrahedra, model, evaluation);
        spawn_body(&mut together, &own).unwrap();
    }
    common::displace::<f64>(&mut together, &moved);
    let sums = evaluate::<f64>(&mut together, TangentKind::Exact);
    assert!(max_difference(&expected, &sums.force) < 1e-13 * max_abs(&expected));
    let by_body = &together.resource::<ElasticEnergy>().by_body;
    assert!(max_difference(&energies, by_body) < 1e-13 * max_abs(&energies));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(256) })]

    #[test]
    fn stretches_keep_their_digits_in_single_precision(
        rest in prop::array::uniform3(-1.0..1.0_f64),
        u in prop::array::uniform3(-1.0..1.0_f64),
        exponent in -6..0i32,
    ) {
        prop_assume!(DVec3::from_array(rest).length() > 0.1);
        let u = u.map(|x| f64::from((x * 10f64.powi(exponent)) as f32));
        let rest = rest.map(|x| f64::from(x as f32));
        let wide = Stretch::new(rest, u);
        let narrow = Stretch::new(rest.map(|x| x as f32), u.map(|x| x as f32));
        let size = DVec3::from_array(u).length() * DVec3::from_array(rest).length();
        prop_assert!((f64::from(narrow.change) - wide.change).abs() < 1e-6 * size.max(wide.change));
    }
}

#[test]
fn a_column_of_slices_is_one_table() {
    // mass-spring and pooled edges are two tables; every query of the laws must see only its own
    let (points, tetrahedra, moved) = strip(4, &noise(), Motion::Rest);
    let law = (Model::MassSpring, Evaluation::Fused);
    let mut world = world::<f64>(&points, &tetrahedra, &moved, law, Workers::serial());
    let mut edges = world.query_filtered::<&sinew_engine::element::EdgeBlock, With<MassSpring>>();
    let column = single_table(edges.contiguous_iter(&world)).unwrap();
    assert!(column.iter().enumerate().all(|(i, b)| b.0 as usize == i));
}

#[test]
fn models_are_called_the_same_everywhere() {
    for model in Model::ALL {
        assert_eq!(serde_json::to_value(model).unwrap(), model.name());
        assert_eq!(serde_json::from_value::<Model>(model.name().into()).unwrap(), model);
        assert!(model.supports(Evaluation::Fused));
    }
}
