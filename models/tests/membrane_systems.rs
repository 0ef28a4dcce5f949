//! Membranes as entities: reference meshes, every instruction set, pooled against fused, and bodies of
//! tetrahedra and triangles against the two alone.

use crate::common;

use bevy_ecs::prelude::*;
use common::json::{flat, indices, number, points};
use common::{KINDS, Worst, max_abs, max_difference, reference, respond, sheet, symmetric_eigen};
use glam::DVec3;
use serde_json::Value;
use sinew_engine::element::{EdgeTension, EdgeVertices};
use sinew_engine::lanes::InstructionSet;
use sinew_engine::law::{ElasticEnergy, EvaluationRequest, TangentKind};
use sinew_engine::mesh::generate::box_tets;
use sinew_engine::row::LocalRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::ForceSchedule;
use sinew_engine::topology::Topology;
use sinew_engine::workers::Workers;
use sinew_models::body::sheet::{MembraneDescription, MembraneError, MembraneModel};
use sinew_models::body::{BodyDescription, BodyError, Evaluation, Model, spawn_body};
use sinew_models::frame::triangles::multiply;
use sinew_models::laws::membranes::{
    BiquadraticMembrane, CorotationalMembrane, LinearMembrane, QuadraticMembrane,
};
use sinew_models::material::YoungPoisson;

const FUSED: Evaluation = Evaluation::Fused;
const POOLED: Evaluation = Evaluation::Pooled;

/// Every way to build a membrane.
const MEMBRANES: [(MembraneModel, Evaluation); 8] = [
    (MembraneModel::Biquadratic, FUSED),
    (MembraneModel::Biquadratic, POOLED),
    (MembraneModel::CompressibleBiquadratic, FUSED),
    (MembraneModel::CompressibleBiquadratic, POOLED),
    (MembraneModel::Quadratic, FUSED),
    (MembraneModel::MassSpring, FUSED),
    (MembraneModel::Linear, FUSED),
    (MembraneModel::Corotational, FUSED),
];

fn vectors(value: &Value) -> Vec<DVec3> {
    points(value).into_iter().map(DVec3::from).collect()
}

fn material(young_modulus: f64, poisson_ratio: f64) -> YoungPoisson {
    YoungPoisson { young_modulus, poisson_ratio, density: 1000.0 }
}

/// A membrane of 1 cm.
fn skin(
    triangles: &[[u32; 3]],
    (model, evaluation): (MembraneModel, Evaluation),
    material: YoungPoisson,
) -> MembraneDescription<'_> {
    MembraneDescription { model, evaluation, ..MembraneDescription::new(triangles, 0.01, material) }
}

/// A world with one body, displaced by `moved` (user's order).
fn world<S: Scalar>(body: &BodyDescription, moved: &[DVec3], set: InstructionSet) -> World {
    common::world::<S>(body, moved, Workers::new(1).unwrap().with_instruction_set(set).unwrap())
}

fn product(tangent: &[f64], v: &[f64]) -> Vec<f64> {
    tangent.chunks(v.len()).map(|row| row.iter().zip(v).map(|(a, b)| a * b).sum()).collect()
}

#[test]
fn reference_meshes() {
    let mut worst = Worst::default();
    let file = reference("pooled_membrane_meshes.json");
    for case in file["cases"].as_array().unwrap() {
        let name = case["name"].as_str().unwrap();
        let points = vectors(&case["rest"]);
        let triangles: Vec<[u32; 3]> = indices(&case["triangles"]);
        let moved: Vec<DVec3> =
            vectors(&case["deformed"]).iter().zip(&points).map(|(x, p)| *x - *p).collect();
        let dx = flat(&case["dx"]);
        let stretch = number(&case["E_2d"]);
        let thickness = 0.002;
        let material = material(stretch / thickness, number(&case["nu"]));
        let variants = [
            ("trbs", MembraneModel::Biquadratic, FUSED),
            ("trbs", MembraneModel::Biquadratic, POOLED),
            ("trqs", MembraneModel::Quadratic, FUSED),
            ("mass_spring", MembraneModel::MassSpring, FUSED),
        ];
        for (key, model, evaluation) in variants {
            let membrane = MembraneDescription::new(&triangles, thickness, material);
            let body = sheet(&points, MembraneDescription { model, evaluation, ..membrane });
            for set in InstructionSet::available() {
                let mut world = world::<f64>(&body, &moved, set);
                let sums = respond::<f64>(&mut world, points.len(), TangentKind::Exact);
                let reference = &case[key];
                let energy = number(&reference["energy"]);
                worst.note("energy", (sums.energy - energy).abs(), energy, name);
                let forces = flat(&reference["forces"]);
                worst.note("forces", max_difference(&sums.force, &forces), max_abs(&forces), name);
                let expected = flat(&case[format!("{key}_K_dx")]);
                let ours = product(&sums.tangent, &dx);
                worst.note("K dx", max_difference(&ours, &expected), max_abs(&expected), name);
                if evaluation == POOLED {
                    let order = world.resource::<Topology>().bodies[0].vertex_order.clone();
                    let mut edges = world.query::<(&EdgeVertices, &EdgeTension<f64>)>();
                    let tensions = flat(&reference["edge_tension"]);
                    for (i, edge) in flat(&case["edges"]).chunks(2).enumerate() {
                        let found = edges.iter(&world).find(|(e, _)| {
                            let [a, b] = e.0.map(|row| f64::from(order[LocalRow(row)].0));
                            [a.min(b), a.max(b)] == [edge[0], edge[1]]
                        });
                        let (_, tension) = found.expect("an edge of the mesh");
                        let error = (tension.0 - tensions[i]).abs();
                        worst.note("edge tension", error, max_abs(&tensions), name);
                    }
                }
            }
        }
    }
    worst.check(1e-9);
}

/// A box with a membrane on one side and a flap that hangs on an edge of it, and displacements.
fn skinned_box() -> (Vec<DVec3>, Vec<[u32; 4]>, Vec<[u32; 3]>, Vec<DVec3>) {
    let mesh = box_tets(DVec3::new(1.0, 0.8, 0.6), [3, 2, 2]).unwrap();
    let mut points = mesh.points.clone();
    let mut triangles: Vec<[u32; 3]> = mesh
        .surface_triangles()
        .into_iter()
        .filter(|t| t.iter().all(|&v| points[v as usize].z > 0.59))
        .collect();
    let edge = triangles[0];
    points.push(DVec3::new(0.1, -0.2, 0.9));
    triangles.push([edge[0], points.len() as u32 - 1, edge[1]]);
    let mut seed = 7u64;
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    };
    let moved = points.iter().map(|_| 0.08 * DVec3::new(next(), next(), next())).collect();
    (points, mesh.tetrahedra, triangles, moved)
}

#[test]
fn a_body_of_both_is_the_sum_of_the_two() {
    let (points, tetrahedra, triangles, moved) = skinned_box();
    let n = points.len();
    let soft = material(5e3, 0.4);
    let hard = material(8e4, 0.3);
    let solids = [
        (Model::CompressibleStVK, FUSED),
        (Model::CompressibleStVK, POOLED),
        (Model::QuadraticSprings, FUSED),
        (Model::MassSpring, FUSED),
    ];
    for (membrane_model, membrane_evaluation) in MEMBRANES {
        for (model, evaluation) in solids {
            let membrane = skin(&triangles, (membrane_model, membrane_evaluation), hard);
            let solid = BodyDescription {
                model,
                evaluation,
                ..BodyDescription::from_parts("both", &points, &tetrahedra, soft)
            };
            let alone = sheet(&points, membrane);
            let both = BodyDescription { membrane: Some(membrane), ..solid.clone() };
            let best = InstructionSet::default_set().unwrap();
            let mut worlds = [&solid, &alone, &both].map(|b| world::<f64>(b, &moved, best));
            for kind in KINDS {
                let [a, b, sum] = worlds.each_mut().map(|w| respond::<f64>(w, n, kind));
                let what = format!("{membrane_model:?} {membrane_evaluation:?} {model:?} {kind:?}");
                let energy = (sum.energy - a.energy - b.energy).abs();
                assert!(energy < 1e-12 * sum.energy, "{what}");
                let parts = [
                    ("mass", &a.mass, &b.mass, &sum.mass),
                    ("force", &a.force, &b.force, &sum.force),
                    ("tangent", &a.tangent, &b.tangent, &sum.tangent),
                ];
                for (name, a, b, sum) in parts {
                    let added: Vec<f64> = a.iter().zip(b).map(|(a, b)| a + b).collect();
                    let error = max_difference(&added, sum) / max_abs(sum);
                    assert!(error < 1e-12, "{what} {name}: {error:e}");
                }
                // an edge spring that both share is clamped once
                if (membrane_model, model) != (MembraneModel::MassSpring, Model::MassSpring) {
                    assert_eq!(sum.clamped, a.clamped + b.clamped, "{what}");
                }
            }
        }
    }
}

#[test]
fn pooled_and_fused_agree_and_projections_are_semidefinite() {
    let (points, _, triangles, moved) = skinned_box();
    let n = points.len();
    for model in [MembraneModel::Biquadratic, MembraneModel::CompressibleBiquadratic] {
        for kind in KINDS {
            let mut results = Vec::new();
            for evaluation in [FUSED, POOLED] {
                let membrane = skin(&triangles, (model, evaluation), material(8e4, 0.3));
                let body = sheet(&points, membrane);
                let mut world = world::<f64>(&body, &moved, InstructionSet::default_set().unwrap());
                results.push(respond::<f64>(&mut world, n, kind));
            }
            let [fused, pooled] = &results[..] else { unreachable!() };
            assert!((fused.energy - pooled.energy).abs() < 1e-12 * fused.energy);
            for (a, b) in [(&fused.force, &pooled.force), (&fused.tangent, &pooled.tangent)] {
                assert!(max_difference(a, b) < 1e-11 * max_abs(a), "{model:?} {kind:?}");
            }
            if kind == TangentKind::Projected {
                assert!(fused.clamped > 0 && fused.clamped == pooled.clamped);
            }
        }
    }
}

/// One triangle, so that its matrix is small enough to decompose.
#[test]
fn projected_tangents_of_entities_are_semidefinite() {
    let points = [DVec3::ZERO, DVec3::X, DVec3::new(0.2, 0.9, 0.1)];
    let moved = [DVec3::ZERO, DVec3::new(-0.4, 0.1, 0.2), DVec3::new(0.1, -0.5, 0.3)];
    for (model, evaluation) in MEMBRANES {
        let membrane = skin(&[[0, 1, 2]], (model, evaluation), material(100.0, 0.3));
        let body = sheet(&points, membrane);
        let mut world = world::<f64>(&body, &moved, InstructionSet::default_set().unwrap());
        let least = |world: &mut World, kind| {
            let sums = respond::<f64>(world, 3, kind);
            let mut k = [[0.0; 9]; 9];
            for (row, values) in k.iter_mut().zip(sums.tangent.chunks(9)) {
                row.copy_from_slice(values);
            }
            symmetric_eigen(k).0.into_iter().fold(f64::INFINITY, f64::min)
        };
        assert!(least(&mut world, TangentKind::Projected) > -1e-12, "{model:?} {evaluation:?}");
        let indefinite = least(&mut world, TangentKind::Exact) < -1e-3;
        assert_eq!(indefinite, model != MembraneModel::Linear, "{model:?}");
    }
}

#[test]
fn products_without_assembly() {
    let (points, _, triangles, moved) = skinned_box();
    for (model, evaluation) in MEMBRANES.into_iter().filter(|(_, e)| *e == FUSED) {
        let membrane = skin(&triangles, (model, evaluation), material(8e4, 0.3));
        let body = sheet(&points, membrane);
        for kind in KINDS {
            let mut world = world::<f64>(&body, &moved, InstructionSet::default_set().unwrap());
            respond::<f64>(&mut world, points.len(), kind);
            let v: Vec<[f64; 4]> = (0..world.resource::<Topology>().vertex_count())
                .map(|i| [(i as f64).sin(), (2.0 * i as f64).cos(), (0.3 * i as f64).sin(), 0.0])
                .collect();
            let assembled = common::assembled(&world, &v);
            let mut free = vec![[0.0; 4]; v.len()];
            match model {
                MembraneModel::Quadratic => {
                    multiply::<QuadraticMembrane, f64>(&mut world, kind, &v, &mut free);
                }
                MembraneModel::Linear => {
                    multiply::<LinearMembrane, f64>(&mut world, kind, &v, &mut free);
                }
                MembraneModel::Corotational => {
                    multiply::<CorotationalMembrane, f64>(&mut world, kind, &v, &mut free);
                }
                MembraneModel::MassSpring => continue,
                _ => multiply::<BiquadraticMembrane, f64>(&mut world, kind, &v, &mut free),
            }
            let (a, b) = (assembled.as_flattened(), free.as_flattened());
            assert!(max_difference(a, b) < 1e-12 * max_abs(a), "{model:?} {kind:?}");
        }
    }
}

#[test]
fn single_precision_follows() {
    let (points, tetrahedra, triangles, moved) = skinned_box();
    let n = points.len();
    for (model, evaluation) in MEMBRANES {
        let membrane = skin(&triangles, (model, evaluation), material(8e4, 0.3));
        let body = BodyDescription {
            membrane: Some(membrane),
            evaluation: POOLED,
            ..BodyDescription::from_parts("both", &points, &tetrahedra, material(5e3, 0.4))
        };
        let best = InstructionSet::default_set().unwrap();
        let wide = respond::<f64>(&mut world::<f64>(&body, &moved, best), n, TangentKind::Exact);
        for set in InstructionSet::available() {
            let mut narrow = world::<f32>(&body, &moved, set);
            let narrow = respond::<f32>(&mut narrow, n, TangentKind::Exact);
            let error = max_difference(&wide.force, &narrow.force) / max_abs(&wide.force);
            assert!(error < 1e-5, "{model:?} {evaluation:?} {set:?}: {error:e}");
        }
    }
}

#[test]
fn several_bodies_share_the_tables() {
    let (points, tetrahedra, triangles, moved) = skinned_box();
    let mut together = common::empty::<f64>();
    let mut energies = Vec::new();
    for (i, kind) in MEMBRANES.iter().chain(&MEMBRANES).enumerate() {
        let membrane = skin(&triangles, *kind, material(8e4 + i as f64, 0.3));
        let name = format!("body {i}");
        let tetrahedra = if i % 3 == 0 { &[][..] } else { &tetrahedra[..] };
        let body = BodyDescription {
            membrane: Some(membrane),
            evaluation: if i % 2 == 0 { POOLED } else { FUSED },
            ..BodyDescription::from_parts(&name, &points, tetrahedra, material(5e3, 0.4))
        };
        spawn_body(&mut together, &body).unwrap();
        let mut alone = world::<f64>(&body, &moved, InstructionSet::default_set().unwrap());
        energies.push(respond::<f64>(&mut alone, points.len(), TangentKind::Exact).energy);
    }
    common::displace::<f64>(&mut together, &moved);
    together.insert_resource(EvaluationRequest { energy: true, force: false, tangent: None });
    together.run_schedule(ForceSchedule);
    let by_body = &together.resource::<ElasticEnergy>().by_body;
    for (own, alone) in by_body.iter().zip(&energies) {
        assert!((own - alone).abs() < 1e-11 * alone, "{own} {alone}");
    }
}

#[test]
fn bad_membranes_are_refused() {
    let points = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(2.0, 0.0, 0.0)];
    let good = [[0, 1, 2]];
    let try_spawn = |membrane: MembraneDescription| {
        let mut world = common::empty::<f64>();
        // another material than that of the membrane, which may be bad
        let body = BodyDescription { material: material(1.0, 0.3), ..sheet(&points, membrane) };
        let result = spawn_body(&mut world, &body);
        if result.is_err() {
            assert!(world.resource::<Topology>().bodies.is_empty());
        }
        result.map(|_| ())
    };
    let hard = material(100.0, 0.3);
    let refused = |result| match result {
        Err(BodyError::Membrane { source, .. }) => source,
        other => panic!("{other:?}"),
    };
    let whole = MembraneDescription::new(&good, 0.01, hard);
    assert!(try_spawn(whole).is_ok());
    for thickness in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let source = refused(try_spawn(MembraneDescription { thickness, ..whole }));
        assert!(matches!(source, MembraneError::Thickness { .. }));
    }
    let bad = MembraneDescription { material: material(-1.0, 0.3), ..whole };
    assert!(matches!(refused(try_spawn(bad)), MembraneError::Material(_)));
    let pooled =
        MembraneDescription { model: MembraneModel::Quadratic, evaluation: POOLED, ..whole };
    assert!(matches!(refused(try_spawn(pooled)), MembraneError::Evaluation { .. }));
    for triangle in [[0, 1, 9], [0, 1, 1]] {
        let source = refused(try_spawn(MembraneDescription::new(&[triangle], 0.01, hard)));
        assert!(matches!(source, MembraneError::Index { kind: "triangle", index: 0, .. }));
    }
    let line = [[0, 1, 2], [0, 1, 3]];
    let source = refused(try_spawn(MembraneDescription::new(&line, 0.01, hard)));
    assert!(matches!(source, MembraneError::Triangle { triangle: 1, .. }));
    let twice = [[0, 1, 2], [2, 1, 0]];
    let source = refused(try_spawn(MembraneDescription::new(&twice, 0.01, hard)));
    assert!(matches!(source, MembraneError::Duplicate { .. }));
    let none = try_spawn(MembraneDescription::new(&[], 0.01, hard));
    assert!(matches!(none, Err(BodyError::Empty { .. })));
}
