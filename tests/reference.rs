//! Whole bodies against reference vectors: pooled constants and sums, tangent products, single
//! implicit steps. Trajectories and static fields are in `demos/scene/tests/validation.rs`.

use crate::common::*;
use glam::DVec3;
use serde_json::Value;
use sinew::engine::columns::single_table;
use sinew::engine::element::{EdgeVertices, TetrahedronIndex, TetrahedronVertices};
use sinew::engine::law::TangentKind;
use sinew::engine::matrix::Tangent;
use sinew::engine::vertex::{FixedAxes, Mass, RestPosition};
use sinew::models::body::Evaluation;
use sinew::models::laws::pooled::{
    AngularStiffnesses, TensileStiffness, TriangleVertices, VolumetricStiffnesses,
};
use sinew::prelude::*;
use sinew::solvers::cg::CgStatus;
use sinew::solvers::linear_solver::LinearSolver;
use sinew::solvers::settings::LinearOptions;
use sinew::solvers::system::ShiftedTangent;

#[path = "common/json.rs"]
mod json;

use json::{indices, list, number, numbers};

fn reference(file: &str) -> Value {
    json::load(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/reference"), file)
}

fn vectors(v: &Value) -> Vec<DVec3> {
    json::points(v).into_iter().map(DVec3::from).collect()
}

const BOTH: [Evaluation; 2] = [Evaluation::Pooled, Evaluation::Fused];

/// A body of a case.
struct Case<'a> {
    json: &'a Value,
    name: &'a str,
    rest: Vec<DVec3>,
    tetrahedra: Vec<[u32; 4]>,
}

impl<'a> Case<'a> {
    fn all(file: &'a Value) -> impl Iterator<Item = Self> {
        file["cases"].as_array().unwrap().iter().map(|json| Self {
            json,
            name: json["name"].as_str().unwrap(),
            rest: vectors(&json["rest"]),
            tetrahedra: indices::<4>(&json["tets"]),
        })
    }

    /// Displacements that lead to the positions `key`.
    fn displacements(&self, key: &str) -> Vec<DVec3> {
        vectors(&self.json[key]).iter().zip(&self.rest).map(|(x, r)| *x - *r).collect()
    }

    fn simulation(&self, model: Model, evaluation: Evaluation) -> (Simulation, BodyHandle) {
        let material = YoungPoisson {
            young_modulus: number(&self.json["E"]),
            poisson_ratio: number(&self.json["nu"]),
            density: number(&self.json["rho"]),
        };
        let options = SimulationOptions::default();
        simulation(options, &self.rest, &self.tetrahedra, material, model, evaluation)
    }
}

#[test]
fn pooled_constants_energies_forces_and_tangents() {
    let file = reference("pooled_tet_meshes.json");
    for own in Case::all(&file) {
        let (case, name) = (own.json, own.name);
        let u = own.displacements("deformed");
        let volume: f64 = numbers(&case["lumped_mass"]).iter().sum::<f64>() / number(&case["rho"]);
        let modulus = number(&case["lambda"]).max(number(&case["mu"]));
        let (energy_unit, force_unit) = (modulus * volume, modulus * volume.powf(2.0 / 3.0));
        let dx = vectors(&case["dx"]);

        for evaluation in BOTH {
            for model in [Model::StVK, Model::CompressibleStVK] {
                let (mut simulation, body) = own.simulation(model, evaluation);
                simulation.displace(body, &u);
                let with = f64::from(u8::from(model == Model::CompressibleStVK));
                let sum = |key: &str| -> Vec<DVec3> {
                    let (a, b) = match key {
                        "forces" => (&case["tbs"]["forces"], &case["compression"]["forces"]),
                        "exact" => (&case["tbs_K_dx"], &case["compression_K_dx"]),
                        _ => (&case["tbs_Kmaterial_dx"], &case["compression_Kgn_dx"]),
                    };
                    vectors(a).iter().zip(vectors(b)).map(|(a, b)| *a + b * with).collect()
                };
                let energy = simulation.evaluate();
                let expected =
                    number(&case["tbs"]["energy"]) + with * number(&case["compression"]["energy"]);
                let error = (energy - expected).abs() / energy_unit;
                assert!(error < 1e-12, "{name} {evaluation:?} {model:?}: energy {error:e}");
                let error =
                    max_distance(&simulation.elastic_forces(body), &sum("forces")) / force_unit;
                assert!(error < 1e-11, "{name} {evaluation:?} {model:?}: force {error:e}");
                for (kind, key) in
                    [(TangentKind::Exact, "exact"), (TangentKind::GaussNewton, "material")]
                {
                    let product = tangent_product(&mut simulation, body, kind, &dx);
                    let expected = sum(key);
                    let error = max_distance(&product, &expected) / max_length(&expected);
                    assert!(error < 1e-11, "{name} {evaluation:?} {model:?} {key}: {error:e}");
                }
            }
        }

        // the constants themselves, in the user's numbering
        let (mut simulation, body) = own.simulation(Model::StVK, Evaluation::Pooled);
        let order = simulation.topology().bodies[body.0].clone();
        let user = |rows: &[u32]| {
            let mut v: Vec<u64> =
                rows.iter().map(|&r| u64::from(order.vertex(VertexRow(r)).0)).collect();
            v.sort_unstable();
            v
        };
        let masses = simulation.masses(body);
        for (m, expected) in masses.iter().zip(numbers(&case["lumped_mass"])) {
            assert!((m - expected).abs() < 1e-13 * expected, "{name}: mass {m} {expected}");
        }
        let world = simulation.world_mut();
        let k = numbers(&case["edge_k"]);
        let largest = k.iter().fold(0.0_f64, |a, b| a.max(*b));
        let mut edges = world.query::<(&EdgeVertices, &TensileStiffness<f64>)>();
        let mut seen = 0;
        for (vertices, stiffness) in edges.iter(world) {
            let key = user(&vertices.0);
            let i = case["edges"]
                .as_array()
                .unwrap()
                .iter()
                .position(|e| e[0] == key[0] && e[1] == key[1])
                .unwrap();
            assert!((stiffness.0 - k[i]).abs() < 1e-12 * largest, "{name}: k of {key:?}");
            seen += 1;
        }
        assert_eq!(seen, k.len(), "{name}");
        let mut triangles = world.query::<(&TriangleVertices, AngularStiffnesses<f64>)>();
        for (vertices, (c0, c1, c2)) in triangles.iter(world) {
            let stiffness = [c0.0, c1.0, c2.0];
            let key = user(&vertices.0);
            let i = case["faces"]
                .as_array()
                .unwrap()
                .iter()
                .position(|f| (0..3).all(|j| f[j] == key[j]))
                .unwrap();
            for m in 0..3 {
                let vertex = u64::from(order.vertex(VertexRow(vertices.0[m])).0);
                let j = key.iter().position(|v| *v == vertex).unwrap();
                let expected = number(&case["face_c"][i][j]);
                assert!((stiffness[m] - expected).abs() < 1e-12 * largest, "{name}: c {key:?}");
            }
        }
        // pair m holds the first local vertex with vertex m + 1; the engine numbers vertices anew
        let d = case["tet_d"].as_array().unwrap();
        let mut tetrahedra =
            world.query::<(&TetrahedronIndex, &TetrahedronVertices, VolumetricStiffnesses<f64>)>();
        for (index, vertices, (d0, d1, d2)) in tetrahedra.iter(world) {
            let stiffness = [d0.0, d1.0, d2.0];
            let i = index.0 as usize;
            let own = vertices.0.map(|v| u64::from(order.vertex(VertexRow(v)).0));
            let reference = [0, 1, 2, 3].map(|j| case["tets"][i][j].as_u64().unwrap());
            for m in 0..3 {
                let pair = [own[0], own[m + 1]];
                let first = pair.contains(&reference[0]);
                let j = (1..4)
                    .position(|j| pair.contains(&reference[j]) == first)
                    .expect("one vertex on the same side as the first");
                let expected = number(&d[i][j]);
                assert!((stiffness[m] - expected).abs() < 1e-12 * largest, "{name}: d");
            }
        }
    }
}

#[test]
fn linearised_implicit_steps() {
    let file = reference("implicit_steps.json");
    let mut indefinite = 0;
    for own in Case::all(&file) {
        let (case, name) = (own.json, own.name);
        let v0 = vectors(&case["v0"]);
        let (h, alpha, beta) = (number(&case["h"]), number(&case["alpha"]), number(&case["beta"]));
        let gravity = vectors(&serde_json::json!([case["gravity"]]))[0];
        let mass = numbers(&case["mass"]);
        let pinned = list(&case["pinned"]);
        for evaluation in BOTH {
            for (kind, key) in [
                (TangentKind::Exact, "linear_implicit_exact"),
                (TangentKind::GaussNewton, "linear_implicit_gauss_newton"),
            ] {
                let (mut simulation, body) = own.simulation(Model::CompressibleStVK, evaluation);
                simulation.set_state(body, &own.displacements("x0"), &v0).unwrap();
                let energy = simulation.evaluate();
                assert!((energy / number(&case["energy0"]) - 1.0).abs() < 1e-10, "{name}");
                let force = simulation.elastic_forces(body);
                let expected = vectors(&case["elastic_force0"]);
                assert!(max_distance(&force, &expected) < 1e-10 * max_length(&expected), "{name}");

                let kv = tangent_product(&mut simulation, body, kind, &v0);
                let rhs: Vec<DVec3> = (0..v0.len())
                    .map(|i| {
                        let damping = v0[i] * alpha * mass[i] + kv[i] * beta;
                        (force[i] + gravity * mass[i] - damping - kv[i] * h) * h
                    })
                    .collect();
                let stored = vectors(&case[key]["rhs"]);
                assert!(max_distance(&rhs, &stored) < 1e-10 * max_length(&stored), "{name} {key}");

                // solve on the free unknowns
                let rows = simulation.topology().bodies[body.0].clone();
                let world = simulation.world_mut();
                let mut query = world.query::<(&Mass<f64>, &RestPosition)>();
                let (masses, positions) = single_table(query.contiguous_iter(world)).unwrap();
                let masses: Vec<f64> = masses.iter().map(|m| m.0).collect();
                let positions: Vec<DVec3> = positions.iter().map(|x| x.0).collect();
                let mut fixed = vec![FixedAxes::NONE; masses.len()];
                for &p in &pinned {
                    fixed[rows.row(p).unwrap().index()] = FixedAxes::ALL;
                }
                let b: Vec<[f64; 4]> = rows
                    .vertex_order
                    .iter()
                    .enumerate()
                    .map(|(row, v)| {
                        let r =
                            if fixed[row] == FixedAxes::ALL { DVec3::ZERO } else { rhs[v.index()] };
                        [r.x, r.y, r.z, 0.0]
                    })
                    .collect();
                let system = ShiftedTangent {
                    topology: world.resource(),
                    workers: world.resource(),
                    mass: &masses,
                    mass_factor: 1.0 + h * alpha,
                    tangent: &world.resource::<Tangent<f64>>().matrix,
                    low_rank: &[],
                    tangent_factor: h * h + h * beta,
                    damping: None,
                    fixed: &fixed,
                    contact: None,
                };
                let mut dv = vec![[0.0; 4]; b.len()];
                let options = LinearOptions {
                    tolerance: 1e-13,
                    max_iterations: 10_000,
                    ..Default::default()
                };
                let mut solver = LinearSolver::default();
                let outcome = solver.solve(&system, &positions, 0..1, &b, &mut dv, &options);
                if number(&case[key]["min_eig_A"]) < 0.0 {
                    assert_eq!(outcome.status, CgStatus::Indefinite, "{name} {key}");
                    indefinite += 1;
                    continue;
                }
                assert_eq!(outcome.status, CgStatus::Converged, "{name} {key} {outcome:?}");
                let expected = vectors(&case[key]["dv"]);
                let scale = max_length(&expected);
                for (row, v) in rows.vertex_order.iter().enumerate() {
                    let found = DVec3::new(dv[row][0], dv[row][1], dv[row][2]);
                    let error = found.distance(expected[v.index()]) / scale;
                    assert!(error < 1e-9, "{name} {key} {evaluation:?}: dv {error:e}");
                }
            }
        }
    }
    assert!(indefinite > 0, "no case with an indefinite matrix was run");
}

#[test]
fn converged_implicit_steps() {
    let file = reference("implicit_steps.json");
    for own in Case::all(&file) {
        let (case, name) = (own.json, own.name);
        let gravity = vectors(&serde_json::json!([case["gravity"]]))[0];
        for evaluation in BOTH {
            let (mut simulation, body) = own.simulation(Model::CompressibleStVK, evaluation);
            simulation.set_state(body, &own.displacements("x0"), &vectors(&case["v0"])).unwrap();
            let rows = simulation.rows(body, "pins", &list(&case["pinned"])).unwrap();
            simulation.add_constraint(Constraint::hold("pins", rows));
            simulation.set_gravity(gravity);
            simulation.set_dt(number(&case["h"]));
            simulation.set_solver(solver!(
                Integrator::Newton,
                linear_tolerance = 1e-10,
                newton_tolerance = 1e-12,
                mass_damping = number(&case["alpha"]),
                stiffness_damping = number(&case["beta"])
            ));
            simulation.step().unwrap();
            assert!(!simulation.report().unconverged, "{name}: {:?}", simulation.report());
            let x = simulation.positions(body);
            let size = max_distance(&own.rest, &vec![own.rest[0]; x.len()]);
            let error = max_distance(&x, &vectors(&case["newton"]["x1"])) / size;
            assert!(error < 1e-9, "{name} {evaluation:?}: {error:e}");
        }
    }
}
