//! Kernels of membranes: nanoseconds per triangle of the formulations whose cost Delingette 2008 compares
//! (Fig. 3, top), each with the error of what was computed.

use super::error::BenchError;
use super::kernels::Spring;
use super::stats::{Rounds, Spread, interleave};
use super::table::Table;
use crate::beam::{as_in_a_step, request};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use sinew::engine::law::TangentKind;
use sinew::engine::matrix::{BlockMatrix, ProductSpans, Tangent};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{jitter_interior, triangle_grid};
use sinew::engine::scalar::{Scalar, add, sub};
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::topology::Topology;
use sinew::engine::workers::Workers;
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::element::membrane::{
    Element, RestTriangle, SpringConstants, biquadratic, corotational, plane_stress, quadratic,
};
use sinew::models::frame::triangles::multiply;
use sinew::models::laws::membranes::{
    BiquadraticMembrane, CorotationalMembrane, QuadraticMembrane,
};
use sinew::prelude::*;
use std::time::Instant;

/// One kernel of one formulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MembraneRow {
    /// Name of the formulation in scene files.
    pub model: String,
    /// `fused` or `pooled`.
    pub evaluation: String,
    /// What it computes.
    pub quantity: String,
    /// Triangles.
    pub triangles: usize,
    /// `f64` or `f32`.
    pub precision: String,
    /// Wall time per triangle (ns), gather included.
    pub ns_per_triangle: Spread,
    /// Median over that of the mass-spring membrane: same quantity, or its assembled product for
    /// products.
    pub over_mass_spring: Option<f64>,
    /// The same ratio in the text of Delingette 2008 (section 5), all of it together.
    pub paper: Option<f64>,
    /// Largest difference from the plain `f64` sum over elements, over the largest value there.
    pub error: f64,
}

const SUBJECTS: [(MembraneModel, Evaluation, Option<f64>); 5] = [
    (MembraneModel::MassSpring, Evaluation::Fused, Some(1.0)),
    (MembraneModel::Biquadratic, Evaluation::Fused, Some(1.6)),
    (MembraneModel::Biquadratic, Evaluation::Pooled, Some(1.6)),
    (MembraneModel::Quadratic, Evaluation::Fused, Some(1.6 * 1.6)),
    (MembraneModel::Corotational, Evaluation::Fused, None),
];

pub(crate) const QUANTITIES: [&str; 4] =
    ["force", "exact tangent", "product, assembled", "product, matrix-free"];

const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e5, poisson_ratio: 0.3, density: 1000.0 };
const THICKNESS: f64 = 1e-3;

/// A sheet of one formulation.
pub(crate) struct Subject<S: Scalar> {
    simulation: Simulation,
    model: MembraneModel,
    evaluation: Evaluation,
    matrix: BlockMatrix<S>,
    spans: ProductSpans<S>,
    x: Vec<[S; 4]>,
    y: Vec<[S; 4]>,
    /// Errors of force and product.
    pub(crate) errors: [f64; 2],
}

/// Measures all formulations on a jittered sheet of about so many triangles, bent and stretched.
///
/// # Errors
/// When the sheet cannot be built.
pub fn run(triangles: usize, rounds: Rounds) -> Result<Vec<MembraneRow>, BenchError> {
    let mesh = sheet(triangles)?;
    let mut rows = rows_of::<f64>(&mesh, rounds)?;
    rows.extend(rows_of::<f32>(&mesh, rounds)?);
    Ok(rows)
}

/// A jittered sheet of about so many triangles.
pub(crate) fn sheet(triangles: usize) -> Result<Mesh, BenchError> {
    let n = ((triangles as f64 / 2.0).sqrt().round() as usize).max(2);
    Ok(jitter_interior(&triangle_grid(DVec2::splat(0.1), [n, n])?, 0.2, 1)?)
}

fn rows_of<S: Scalar>(mesh: &Mesh, rounds: Rounds) -> Result<Vec<MembraneRow>, BenchError> {
    let mut subjects = Vec::new();
    for (model, evaluation, paper) in SUBJECTS {
        subjects.push((Subject::<S>::new(mesh, model, evaluation)?, paper));
    }
    let mut variants = Vec::new();
    for (i, (subject, _)) in subjects.iter_mut().enumerate() {
        for quantity in subject.quantities() {
            let start = Instant::now();
            subject.measure(quantity, 1);
            let repetitions = (1e-3 / start.elapsed().as_secs_f64().max(1e-6)).ceil();
            variants.push((i, quantity, repetitions.clamp(1.0, 1000.0) as usize));
        }
    }
    let samples = interleave(&mut variants, rounds, |&mut (subject, quantity, repetitions)| {
        Ok::<f64, BenchError>(subjects[subject].0.measure(quantity, repetitions))
    })?;
    let mut rows: Vec<MembraneRow> = Vec::new();
    for (&(subject, quantity, _), samples) in variants.iter().zip(&samples) {
        // the first figure warms up pages and caches
        let later = if samples.len() > 1 { &samples[1..] } else { &samples[..] };
        let Some(seconds) = Spread::of(later) else { continue };
        let (subject, paper) = &subjects[subject];
        let spread = seconds.scaled(1e9 / mesh.triangles.len() as f64);
        let alike = if quantity == 3 { QUANTITIES[2] } else { QUANTITIES[quantity] };
        let base = rows.iter().find(|r| r.model == "mass_spring" && r.quantity == alike);
        let own = (subject.model == MembraneModel::MassSpring).then_some(1.0);
        rows.push(MembraneRow {
            model: subject.model.name().into(),
            evaluation: sinew_demos::summary::evaluation_name(subject.evaluation).into(),
            quantity: QUANTITIES[quantity].into(),
            triangles: mesh.triangles.len(),
            precision: S::NAME.into(),
            over_mass_spring: base.map(|b| spread.median / b.ns_per_triangle.median).or(own),
            ns_per_triangle: spread,
            paper: *paper,
            error: subject.errors[usize::from(quantity > 0)],
        });
    }
    Ok(rows)
}

impl<S: Scalar> Subject<S> {
    pub(crate) fn new(
        mesh: &Mesh,
        model: MembraneModel,
        evaluation: Evaluation,
    ) -> Result<Self, BenchError> {
        let precision = if S::NAME == "f32" { Precision::F32 } else { Precision::F64 };
        let options = SimulationOptions { precision, threads: 1, ..Default::default() };
        let mut simulation = Simulation::new(options)?;
        let membrane = MembraneDescription {
            model,
            evaluation,
            ..MembraneDescription::new(&mesh.triangles, THICKNESS, MATERIAL)
        };
        let body = simulation.add_body(&BodyDescription {
            membrane: Some(membrane),
            ..BodyDescription::from_parts("sheet", &mesh.points, &[], MATERIAL)
        })?;
        let u: Vec<DVec3> = mesh
            .points
            .iter()
            .map(|p| DVec3::new(0.1 * p.x, 0.02 * p.y, 0.01 * (60.0 * p.x).sin()))
            .collect();
        simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()])?;
        request(&mut simulation, false, true, Some(TangentKind::Exact));
        simulation.world_mut().run_schedule(ForceSchedule);
        let order = simulation.topology().bodies[body.0].vertex_order.clone();
        let wave = |i: u32, k: f64| (f64::from(i) * k).sin();
        let direction = |i: u32| DVec3::new(wave(i, 0.7), wave(i, 1.3), wave(i, 2.1));
        let x: Vec<[S; 4]> = order
            .iter()
            .map(|&i| {
                let [a, b, c] = direction(i).to_array().map(S::from_f64);
                [a, b, c, S::ZERO]
            })
            .collect();
        let mut y = vec![[S::ZERO; 4]; x.len()];
        let mut spans = ProductSpans::default();
        let matrix = simulation.world().resource::<Tangent<S>>().matrix.clone();
        let workers = Workers::serial();
        matrix.multiply(simulation.topology(), &workers, &mut spans, &x, &mut y);
        let v: Vec<DVec3> = (0..mesh.points.len() as u32).map(direction).collect();
        let (force, product) = plain_sums(mesh, &u, &v, model)?;
        let forces = simulation.elastic_forces(body);
        let mut products = vec![DVec3::ZERO; v.len()];
        for (&i, y) in order.iter().zip(&y) {
            products[i as usize] = DVec3::new(y[0].to_f64(), y[1].to_f64(), y[2].to_f64());
        }
        let difference = |a: &[DVec3], b: &[DVec3]| {
            let worst = a.iter().zip(b).map(|(a, b)| (*a - *b).length());
            // a NaN must not hide
            let worst = worst.fold(0.0, |m: f64, d| if d.is_nan() { d } else { m.max(d) });
            worst / b.iter().map(|b| b.length()).fold(0.0, f64::max)
        };
        let errors = [difference(&forces, &force), difference(&products, &product)];
        Ok(Self { simulation, model, evaluation, matrix, spans, x, y, errors })
    }

    /// Places in [`QUANTITIES`] of what it can compute.
    pub(crate) fn quantities(&self) -> Vec<usize> {
        let free = self.model != MembraneModel::MassSpring && self.evaluation == Evaluation::Fused;
        (0..QUANTITIES.len() - usize::from(!free)).collect()
    }

    /// Seconds of one repetition.
    pub(crate) fn measure(&mut self, quantity: usize, repetitions: usize) -> f64 {
        let tangent = (quantity == 1).then_some(TangentKind::Exact);
        request(&mut self.simulation, false, quantity == 0, tangent);
        let Self { simulation, model, matrix, spans, x, y, .. } = self;
        as_in_a_step(simulation, |world| {
            let start = Instant::now();
            for _ in 0..repetitions {
                match (quantity, *model) {
                    (0 | 1, _) => world.run_schedule(ForceSchedule),
                    (2, _) => {
                        let topology = world.resource::<Topology>();
                        matrix.multiply(topology, world.resource::<Workers>(), spans, x, y);
                    }
                    (_, MembraneModel::Quadratic) => {
                        y.fill([S::ZERO; 4]);
                        multiply::<QuadraticMembrane, S>(world, TangentKind::Exact, x, y);
                    }
                    (_, MembraneModel::Corotational) => {
                        y.fill([S::ZERO; 4]);
                        multiply::<CorotationalMembrane, S>(world, TangentKind::Exact, x, y);
                    }
                    _ => {
                        y.fill([S::ZERO; 4]);
                        multiply::<BiquadraticMembrane, S>(world, TangentKind::Exact, x, y);
                    }
                }
            }
            start.elapsed().as_secs_f64() / repetitions as f64
        })
    }
}

/// Forces and products of the exact tangent with `v`, element after element.
fn plain_sums(
    mesh: &Mesh,
    u: &[DVec3],
    v: &[DVec3],
    model: MembraneModel,
) -> Result<(Vec<DVec3>, Vec<DVec3>), BenchError> {
    let moduli = plane_stress(MATERIAL.young_modulus * THICKNESS, MATERIAL.poisson_ratio);
    let mut force = vec![DVec3::ZERO; u.len()];
    let mut product = vec![DVec3::ZERO; u.len()];
    for &t in &mesh.triangles {
        let points = t.map(|i| mesh.points[i as usize].to_array());
        let rest = RestTriangle::new(points)?;
        let e = Element::<f64>::new(&rest, moduli, false);
        let (u, v) = (t.map(|i| u[i as usize].to_array()), t.map(|i| v[i as usize].to_array()));
        let kind = TangentKind::Exact;
        let (f, kv) = match model {
            MembraneModel::Quadratic => {
                (quadratic::forces(&e, &u), quadratic::tangent(&e, &u, kind).product(&v))
            }
            MembraneModel::Corotational => {
                (corotational::forces(&e, &u), corotational::tangent(&e, &u, kind).product(&v))
            }
            MembraneModel::MassSpring => {
                let springs = SpringConstants::new(&rest, moduli);
                let (mut f, mut kv) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
                for (i, k) in springs.tensile.into_iter().enumerate() {
                    let (a, b) = ((i + 1) % 3, (i + 2) % 3);
                    let spring = Spring::new(k, sub(points[a], points[b]), sub(u[a], u[b]));
                    let pull = spring.pull();
                    (f[a], f[b]) = (sub(f[a], pull), add(f[b], pull));
                    let change = spring.product(sub(v[a], v[b]));
                    (kv[a], kv[b]) = (add(kv[a], change), sub(kv[b], change));
                }
                (f, kv)
            }
            _ => (biquadratic::forces(&e, &u), biquadratic::tangent(&e, &u, kind).product(&v)),
        };
        for a in 0..3 {
            force[t[a] as usize] += DVec3::from_array(f[a]);
            product[t[a] as usize] += DVec3::from_array(kv[a]);
        }
    }
    Ok((force, product))
}

/// The rows as a table.
pub fn table(rows: &[MembraneRow]) -> Table {
    let mut table = Table::new(
        "membranes",
        "Membranes: jittered sheet, bent and stretched, one thread",
        &[
            "model", "evaluation", "quantity", "triangles", "precision", "ns/triangle", "least",
            "over mass-spring", "paper", "error",
        ],
    )
    .note(
        "over mass-spring: median over that of edge springs for the same quantity, the matrix-free product \
         over their assembled one. paper: ratios in the text of Delingette 2008, biquadratic 1.6 times \
         mass-spring, quadratic 1.6 times biquadratic, there for force and matrix-vector product.",
    )
    .note("error: largest difference from the plain f64 sum over elements, over the largest value.");
    for r in rows {
        table.row(vec![
            (&r.model).into(),
            (&r.evaluation).into(),
            (&r.quantity).into(),
            r.triangles.into(),
            (&r.precision).into(),
            r.ns_per_triangle.median.into(),
            r.ns_per_triangle.minimum.into(),
            r.over_mass_spring.into(),
            r.paper.into(),
            r.error.into(),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_compute_what_the_plain_sums_say() {
        let rounds = Rounds { most: 1, least: 1, seconds: 0.0 };
        let rows = run(200, rounds).unwrap();
        assert_eq!(rows.len(), 2 * (5 * 3 + 3));
        for row in &rows {
            let limit = if row.precision == "f64" { 1e-12 } else { 1e-4 };
            assert!(row.error < limit, "{row:?}");
            assert!(row.over_mass_spring.is_some(), "{row:?}");
        }
        assert_eq!(table(&rows).rows.len(), rows.len());
    }
}
