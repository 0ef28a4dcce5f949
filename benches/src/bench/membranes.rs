//! Kernels of membranes: nanoseconds per triangle of the formulations whose cost Delingette 2008 compares
//! (Fig. 3, top), each with the error of what was computed.

use super::spring_products;
use super::subject::{
    Free, KernelQuantity, KernelTiming, Reference, Timed, directions, edge_sums, repetitions,
};
use crate::toolbox::beam::{self, precision_of};
use crate::toolbox::prelude::*;
use crate::toolbox::stats::{Rounds, Spread, interleave};
use bevy_ecs::prelude::World;
use glam::DVec2;
use sinew::engine::law::TangentKind;
use sinew::engine::mesh::generate::{jitter_interior, triangle_grid};
use sinew::engine::scalar::Scalar;
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::element::membrane::{
    Element, RestTriangle, SpringConstants, biquadratic, corotational, plane_stress, quadratic,
};
use sinew::models::frame::law::TriangleLaw;
use sinew::models::frame::triangles::multiply;
use sinew::models::laws::membranes::{
    BiquadraticMembrane, CorotationalMembrane, QuadraticMembrane,
};

/// One kernel of one formulation.
#[derive(Clone, Debug, PartialEq, Serialize)]
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

/// What is timed of membranes and, in the figures of Delingette 2008, of solids.
pub const QUANTITIES: [(&str, KernelQuantity); 4] = [
    ("force", KernelQuantity::Force),
    ("exact tangent", KernelQuantity::Tangent(TangentKind::Exact)),
    ("product, assembled", KernelQuantity::Product),
    ("product, matrix-free", KernelQuantity::MatrixFree),
];

const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e5, poisson_ratio: 0.3, density: 1000.0 };
const THICKNESS: f64 = 1e-3;

/// A sheet of one formulation.
pub struct MembraneSubject {
    /// It, ready to be timed.
    pub timed: Box<dyn KernelTiming>,
    model: MembraneModel,
    evaluation: Evaluation,
    /// How many of [`QUANTITIES`] it can compute.
    pub quantities: usize,
    /// Errors of force and product.
    pub errors: [f64; 2],
}

/// Measures all formulations on a jittered sheet of about so many triangles, bent and stretched.
///
/// # Errors
/// When the sheet cannot be built.
pub fn run(triangles: usize, rounds: Rounds) -> Result<Vec<MembraneRow>> {
    let mesh = sheet(triangles)?;
    let mut rows = rows_of::<f64>(&mesh, rounds)?;
    rows.extend(rows_of::<f32>(&mesh, rounds)?);
    Ok(rows)
}

/// A jittered sheet of about so many triangles.
///
/// # Errors
/// When it would have too many.
pub fn sheet(triangles: usize) -> Result<Mesh> {
    let n = ((triangles as f64 / 2.0).sqrt().round() as usize).max(2);
    Ok(jitter_interior(&triangle_grid(DVec2::splat(0.1), [n, n])?, 0.2, 1)?)
}

fn rows_of<S: Scalar>(mesh: &Mesh, rounds: Rounds) -> Result<Vec<MembraneRow>> {
    let mut subjects = Vec::new();
    for (model, evaluation, paper) in SUBJECTS {
        subjects.push((MembraneSubject::new::<S>(mesh, model, evaluation)?, paper));
    }
    let mut variants = Vec::new();
    for (i, (subject, _)) in subjects.iter_mut().enumerate() {
        for quantity in 0..subject.quantities {
            let count = repetitions(&mut *subject.timed, QUANTITIES[quantity].1, 1e-3);
            variants.push((i, quantity, count));
        }
    }
    let samples = interleave(&mut variants, rounds, |&mut (subject, quantity, repetitions)| {
        let timed = &mut subjects[subject].0.timed;
        Ok::<f64, BenchError>(timed.measure(QUANTITIES[quantity].1, repetitions))
    })?;
    let mut rows: Vec<MembraneRow> = Vec::new();
    for (&(subject, quantity, _), samples) in variants.iter().zip(&samples) {
        let Some(seconds) = Spread::warm(samples) else { continue };
        let (subject, paper) = &subjects[subject];
        let spread = seconds.scaled(1e9 / mesh.triangles.len() as f64);
        let alike = QUANTITIES[if quantity == 3 { 2 } else { quantity }].0;
        let base = rows.iter().find(|r| r.model == "mass_spring" && r.quantity == alike);
        let own = (subject.model == MembraneModel::MassSpring).then_some(1.0);
        rows.push(MembraneRow {
            model: subject.model.name().into(),
            evaluation: sinew_scene::summary::evaluation_name(subject.evaluation).into(),
            quantity: QUANTITIES[quantity].0.into(),
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

fn free<L: TriangleLaw, S: Scalar>(world: &mut World, x: &[[S; 4]], y: &mut [[S; 4]]) {
    multiply::<L, S>(world, TangentKind::Exact, x, y);
}

impl MembraneSubject {
    /// Of a sheet that is bent and stretched.
    ///
    /// # Errors
    /// When it cannot be built.
    pub fn new<S: Scalar>(
        mesh: &Mesh,
        model: MembraneModel,
        evaluation: Evaluation,
    ) -> Result<Self> {
        let precision = precision_of::<S>();
        let options = SimulationOptions { precision, threads: 1, ..Default::default() };
        let mut simulation = Simulation::new(options)?;
        let membrane = MembraneDescription::new(&mesh.triangles, THICKNESS, MATERIAL);
        let membrane = MembraneDescription { model, evaluation, ..membrane };
        let body = simulation.add_body(&beam::sheet("sheet", mesh, membrane))?;
        let u: Vec<DVec3> = mesh
            .points
            .iter()
            .map(|p| DVec3::new(0.1 * p.x, 0.02 * p.y, 0.01 * (60.0 * p.x).sin()))
            .collect();
        simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()])?;
        let springs = spring_products::of(
            model == MembraneModel::MassSpring,
            evaluation == Evaluation::Pooled,
        );
        let product: Free<S> = springs.unwrap_or(match model {
            MembraneModel::Quadratic => free::<QuadraticMembrane, S>,
            MembraneModel::Corotational => free::<CorotationalMembrane, S>,
            _ => free::<BiquadraticMembrane, S>,
        });
        let mut timed = Timed::new(simulation, body, Some(product));
        let reference = plain_sums(mesh, &u, model)?;
        let force = timed.force_error(body, &reference.forces);
        let [assembled, free] = [KernelQuantity::Product, KernelQuantity::MatrixFree]
            .map(|product| timed.product_error(product, &reference.product));
        Ok(Self {
            timed: Box::new(timed),
            model,
            evaluation,
            quantities: QUANTITIES.len(),
            // a NaN must not hide
            errors: [force, if free.is_nan() { free } else { assembled.max(free) }],
        })
    }
}

/// Forces and products of the exact tangent with [`directions`], element after element.
fn plain_sums(mesh: &Mesh, u: &[DVec3], model: MembraneModel) -> Result<Reference> {
    let moduli = plane_stress(MATERIAL.young_modulus * THICKNESS, MATERIAL.poisson_ratio);
    let v = directions(mesh.points.len());
    let mut sum = Reference::zero(mesh.points.len());
    for nodes in &mesh.triangles {
        let pick = |field: &[DVec3]| nodes.map(|i| field[i as usize].to_array());
        let (points, u, v) = (pick(&mesh.points), pick(u), pick(&v));
        let rest = RestTriangle::new(points)?;
        let e = Element::<f64>::new(&rest, moduli, false);
        let (kind, none) = (TangentKind::Exact, [[0.0; 3]; 3]);
        let (f, kv) = match model {
            MembraneModel::Quadratic => {
                (quadratic::forces(&e, &u), quadratic::tangent(&e, &u, kind).product(&v))
            }
            MembraneModel::Corotational => {
                (corotational::forces(&e, &u), corotational::tangent(&e, &u, kind).product(&v))
            }
            MembraneModel::MassSpring => {
                let tensile = SpringConstants::new(&rest, moduli).tensile.into_iter().enumerate();
                let springs = tensile.map(|(i, k)| (k, [(i + 1) % 3, (i + 2) % 3]));
                let (_, f, kv, _) = edge_sums(springs, points, [u, v]);
                (f, kv)
            }
            _ => (biquadratic::forces(&e, &u), biquadratic::tangent(&e, &u, kind).product(&v)),
        };
        sum.add(nodes, (0.0, f, kv, none));
    }
    Ok(sum)
}

/// The rows as a table.
pub fn table(rows: &[MembraneRow]) -> Table {
    table_of!("membranes", "Membranes: jittered sheet, bent and stretched, one thread"; for r in rows;
        "model" => &r.model, "evaluation" => &r.evaluation, "quantity" => &r.quantity,
        "triangles" => r.triangles, "precision" => &r.precision,
        "ns/triangle" => r.ns_per_triangle.median, "least" => r.ns_per_triangle.minimum,
        "over mass-spring" => r.over_mass_spring, "paper" => r.paper, "error" => r.error,
    )
    .note(
        "over mass-spring: median over that of edge springs for the same quantity, the matrix-free product \
         over their assembled one. paper: ratios in the text of Delingette 2008, biquadratic 1.6 times \
         mass-spring, quadratic 1.6 times biquadratic, there for force and matrix-vector product.",
    )
    .note("error: largest difference from the plain f64 sum over elements, over the largest value.")
}
