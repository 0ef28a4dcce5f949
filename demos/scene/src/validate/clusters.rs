//! Small meshes in clusters, schema `sinew-locking-forces/1`: energies, forces and products of the tangent at given
//! displacements.

use super::body::{CaseBody, CaseCells, CaseLaw, CaseMaterial};
use super::compare::{difference, largest, worst};
use super::read::ReferenceCase;
use super::{CaseError, Rows, Status, ValidationRow};
use glam::DVec3;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::topology::Topology;
use sinew::engine::workers::Workers;
use sinew::models::material::YoungPoisson;
use sinew::simulation::Simulation;
use std::time::Instant;

const LAWS: [&str; 2] = ["neo_hookean_cluster", "svk_volume_cluster"];

pub(super) fn run(case: &ReferenceCase) -> Rows {
    let mut rows = Vec::new();
    for law in LAWS {
        let count = case.root().get("cases").list()?.count();
        let mut row = ValidationRow::new(&case.name(), law, 0, count);
        row.note = "energies, forces and tangents of small meshes".into();
        let outcome = run_law(case, law, &mut row);
        rows.push(row.ended(outcome));
    }
    Ok(rows)
}

fn run_law(case: &ReferenceCase, name: &str, row: &mut ValidationRow) -> Result<(), CaseError> {
    let law = CaseLaw::find(name, "tet")?;
    (row.max_difference, row.rms_difference, row.energy_difference) = (0.0, 0.0, 0.0);
    let mut tangent_difference: f64 = 0.0;
    let start = Instant::now();
    for mesh in case.root().get("cases").list()? {
        let truth = mesh.get(name);
        let number = |key: &str| mesh.get(key).number();
        let (own, shared, mu) =
            (number("lambda_element")?, number("lambda_cluster")?, number("mu")?);
        let cells = mesh.get("cells").cells::<4>()?;
        let clusters = mesh.get("clusters").indices()?;
        let nodes = mesh.get("nodes").list()?.count();
        let [points, u, v] = ["nodes", "u", "v"].map(|key| mesh.get(key).field(nodes));
        let (points, u, v) = (points?, u?, v?);
        let material = CaseMaterial::uniform(young_poisson(own + shared, mu));
        let cells = CaseCells::Tetrahedra(&cells);
        let body = CaseBody::new(&points, cells, law, &material);
        let body = CaseBody { clusters: Some(&clusters), ..body };
        let (mut simulation, body) = body.displaced(case, &u)?;
        let energy = simulation.evaluate();
        row.worst_fields(&simulation.elastic_forces(body), &truth.get("force").field(nodes)?);
        row.worst_energy(energy, truth.get("energy").number()?);
        let product = tangent_times(&mut simulation, &v);
        let expected = truth.get("tangent_times_v").field(nodes)?;
        let (max, _) = difference(&product, &expected, largest(&expected));
        tangent_difference = worst(tangent_difference, max);
        row.nodes += nodes;
    }
    row.seconds = start.elapsed().as_secs_f64();
    row.remark(format!("tangent {tangent_difference:.1e}"));
    let [close, near] = case.options.tolerance.map_or([1e-12, 1e-11], |tolerance| [tolerance; 2]);
    if row.max_difference <= close && row.energy_difference <= close && tangent_difference <= near {
        row.status = Status::Pass;
    }
    Ok(())
}

/// The material that has these moduli; files give them in round numbers of `E` and `nu`, of which `lambda` keeps too few
/// digits near 0.5.
fn young_poisson(lambda: f64, mu: f64) -> YoungPoisson {
    let round = |x: f64, unit: f64| (x / unit).round() * unit;
    let poisson_ratio = round(lambda / (2.0 * (lambda + mu)), 1e-6);
    let young_modulus = round(2.0 * mu * (1.0 + poisson_ratio), 1e-6);
    YoungPoisson { young_modulus, poisson_ratio, density: 1000.0 }
}

/// The exact tangent of the one body times `v` (m), by the user's vertices.
fn tangent_times(simulation: &mut Simulation, v: &[DVec3]) -> Vec<DVec3> {
    let world = simulation.world_mut();
    world.insert_resource(EvaluationRequest {
        energy: false,
        force: false,
        tangent: Some(TangentKind::Exact),
    });
    world.run_schedule(ForceSchedule);
    let topology = world.resource::<Topology>();
    let rows = &topology.bodies[0];
    let mut x = vec![[0.0; 4]; topology.vertex_count()];
    let mut y = x.clone();
    for (vertex, x) in rows.vertex_order.iter().zip(&mut x) {
        let [a, b, c] = v[vertex.index()].to_array();
        *x = [a, b, c, 0.0];
    }
    let (tangent, workers) = (world.resource::<Tangent<f64>>(), world.resource::<Workers>());
    tangent.multiply(topology, workers, &mut ProductSpans::default(), &x, &mut y);
    let mut product = vec![DVec3::ZERO; v.len()];
    for (vertex, y) in rows.vertex_order.iter().zip(&y) {
        product[vertex.index()] = DVec3::new(y[0], y[1], y[2]);
    }
    product
}
