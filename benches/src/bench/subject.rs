//! A body whose kernels are timed, and the plain sums over elements that its errors are measured against.

use crate::toolbox::beam::{MATERIAL, as_in_a_step, evaluate, request};
use crate::toolbox::prelude::*;
use bevy_ecs::prelude::World;
use sinew::engine::element::TETRAHEDRON_EDGES;
use sinew::engine::law::{LawBuffers, TangentKind};
use sinew::engine::matrix::{BlockMatrix, ProductSpans, Tangent};
use sinew::engine::row::{IndexVec, LocalRow};
use sinew::engine::scalar::{Scalar, add, dot, scale, sub};
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::topology::Topology;
use sinew::engine::workers::Workers;
use sinew::models::axes::element::{AxisElement, Triad};
use sinew::models::element::precompute::{RestTetrahedron, SpringConstants};
use sinew::models::element::spring::{Stretch, tensile_energy, tensile_tension};
use sinew::models::element::tetrahedron::{self, Element};
use sinew::models::frame::law::TetrahedronLaw;
use sinew::models::frame::stand_in::Corotational;
use sinew::models::frame::tetrahedra;
use sinew::models::laws::corotational::WarpedStiffness;
use sinew::models::laws::linear::Linear;
use sinew::models::laws::neo_hookean::NeoHookean;
use sinew::models::laws::quadratic::QuadraticSprings;
use sinew::models::laws::stvk_fem::StVKFem;
use sinew::models::laws::svk::FusedStVK;
use sinew::models::laws::svk_volume::StVKVolume;
use sinew::models::material::LameParameters;
use std::hint::black_box;

/// What a kernel computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KernelQuantity {
    /// Energy.
    Energy,
    /// Forces.
    Force,
    /// A tangent, assembled.
    Tangent(TangentKind),
    /// The assembled exact tangent times a vector.
    Product,
    /// The exact tangent times a vector, element after element.
    MatrixFree,
    /// Adding up the private arrays of forces.
    Gather,
    /// Adding up the private blocks of tangents.
    GatherTangent,
}

impl KernelQuantity {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Energy => "energy",
            Self::Force => "force",
            Self::Tangent(TangentKind::Exact) => "exact tangent",
            Self::Tangent(TangentKind::Projected) => "projected tangent",
            Self::Tangent(TangentKind::GaussNewton) => "Gauss-Newton tangent",
            Self::Product => "matrix-vector product",
            Self::MatrixFree => "exact tangent times vector",
            Self::Gather => "gather of forces",
            Self::GatherTangent => "gather of tangents",
        }
    }
}

/// A product of a tangent and a vector without a matrix.
pub type Free<S> = fn(&mut World, &[[S; 4]], &mut [[S; 4]]);

/// That of a law of tetrahedra, with its exact tangent.
pub fn free<L: TetrahedronLaw, S: Scalar>(world: &mut World, x: &[[S; 4]], y: &mut [[S; 4]]) {
    let done = tetrahedra::multiply::<L, S>(world, TangentKind::Exact, x, y);
    debug_assert!(done.is_ok(), "exact tangents have a product");
}

/// A body whose kernels are timed.
pub struct Timed<S: Scalar> {
    pub(super) simulation: Simulation,
    /// Vertex of every row.
    order: IndexVec<LocalRow, MeshVertex>,
    /// The exact tangent of the state, and what it is multiplied with.
    matrix: BlockMatrix<S>,
    spans: ProductSpans<S>,
    pub(super) x: Vec<[S; 4]>,
    y: Vec<[S; 4]>,
    free: Option<Free<S>>,
}

/// [`Timed`], whatever its number type.
pub trait KernelTiming {
    /// Seconds of one repetition.
    fn measure(&mut self, quantity: KernelQuantity, repetitions: usize) -> f64;
    /// The body's world.
    fn world(&mut self) -> &mut World;
}

/// Repetitions of a kernel that take about so many seconds; its second run counts.
pub fn repetitions(timed: &mut dyn KernelTiming, quantity: KernelQuantity, seconds: f64) -> usize {
    timed.measure(quantity, 1);
    (seconds / timed.measure(quantity, 1).max(1e-6)).ceil().clamp(1.0, 1000.0) as usize
}

impl<S: Scalar> Timed<S> {
    /// A body in the state that is set.
    pub fn new(mut simulation: Simulation, body: BodyHandle, free: Option<Free<S>>) -> Self {
        let order = simulation.topology().bodies[body.0].vertex_order.clone();
        let direction = directions(order.len());
        let row = |vertex: &MeshVertex| {
            let [a, b, c] = direction[vertex.index()].to_array().map(S::from_f64);
            [a, b, c, S::ZERO]
        };
        let x: Vec<[S; 4]> = order.iter().map(row).collect();
        let y = vec![[S::ZERO; 4]; x.len()];
        request(&mut simulation, true, true, Some(TangentKind::Exact));
        evaluate(&mut simulation);
        let matrix = simulation.world().resource::<Tangent<S>>().matrix.clone();
        Self { simulation, order, matrix, spans: ProductSpans::default(), x, y, free }
    }

    /// Takes the tangent evaluated last.
    pub(super) fn take_tangent(&mut self) {
        self.matrix = self.simulation.world().resource::<Tangent<S>>().matrix.clone();
    }

    /// Largest difference of the forces evaluated last from true ones.
    pub fn force_error(&mut self, body: BodyHandle, truth: &[DVec3]) -> f64 {
        let forces = self.simulation.elastic_forces(body);
        largest_difference(forces.into_iter().zip(truth.iter().copied()))
    }

    /// Largest difference of a product from the true one, by vertex.
    pub fn product_error(&mut self, quantity: KernelQuantity, truth: &[DVec3]) -> f64 {
        self.measure(quantity, 1);
        let by_vertex = self.order.iter().zip(&self.y).map(|(vertex, y)| {
            (DVec3::from_array([0, 1, 2].map(|k| y[k].to_f64())), truth[vertex.index()])
        });
        largest_difference(by_vertex)
    }
}

impl<S: Scalar> KernelTiming for Timed<S> {
    fn measure(&mut self, quantity: KernelQuantity, repetitions: usize) -> f64 {
        let tangent = match quantity {
            KernelQuantity::Tangent(kind) => Some(kind),
            KernelQuantity::GatherTangent => Some(TangentKind::Exact),
            _ => None,
        };
        let energy = quantity == KernelQuantity::Energy;
        let force = matches!(quantity, KernelQuantity::Force | KernelQuantity::Gather);
        request(&mut self.simulation, energy, force, tangent);
        let mut sum = None;
        if matches!(quantity, KernelQuantity::Gather | KernelQuantity::GatherTangent) {
            evaluate(&mut self.simulation);
            sum = Some(self.matrix.clone());
        }
        let Self { simulation, matrix, spans, x, y, free, .. } = self;
        as_in_a_step(simulation, |world| {
            let start = Instant::now();
            for _ in 0..repetitions {
                match quantity {
                    KernelQuantity::Product => {
                        let workers = world.resource::<Workers>();
                        matrix.multiply(world.resource::<Topology>(), workers, spans, x, y);
                    }
                    KernelQuantity::MatrixFree => {
                        y.fill([S::ZERO; 4]);
                        free.expect("the subject has this quantity")(world, x, y);
                    }
                    KernelQuantity::Gather | KernelQuantity::GatherTangent => {
                        let workers = world.resource::<Workers>();
                        let buffers = world.resource::<LawBuffers<S>>();
                        let buffer = buffers.get(FusedStVK::NAME).expect("the body's law");
                        match &mut sum {
                            Some(sum) if tangent.is_some() => {
                                buffer.add_tangent_to(workers, sum, false)
                            }
                            _ => buffer.add_forces_to(workers, black_box(y)),
                        }
                    }
                    _ => world.run_schedule(ForceSchedule),
                }
            }
            start.elapsed().as_secs_f64() / repetitions as f64
        })
    }

    fn world(&mut self) -> &mut World {
        self.simulation.world_mut()
    }
}

/// A fixed direction with components along everything.
pub fn directions(n: usize) -> Vec<DVec3> {
    let wave = |i: usize, k: f64| (i as f64 * k).sin();
    (0..n).map(|i| DVec3::new(wave(i, 0.7), wave(i, 1.3), wave(i, 2.1))).collect()
}

/// Largest distance of two vectors over the largest length of the second ones.
pub fn largest_difference(pairs: impl Iterator<Item = (DVec3, DVec3)>) -> f64 {
    let (mut difference, mut size) = (0.0_f64, 0.0_f64);
    for (found, truth) in pairs {
        let d = (found - truth).length();
        // a NaN must not hide
        difference = if d.is_nan() { f64::NAN } else { difference.max(d) };
        size = size.max(truth.length());
    }
    difference / size
}

/// Energy, forces, and products with exact and projected tangent, of one element.
fn element_sums<L: TetrahedronLaw>(
    e: &Element<f64>,
    u: &[[f64; 3]; 4],
    v: &[[f64; 3]; 4],
) -> ElementSums<4> {
    let product = |kind| L::tangent(e, u, kind).product(v);
    let forces = L::forces(e, u).unwrap_or_default();
    (L::energy(e, u), forces, product(TangentKind::Exact), product(TangentKind::Projected))
}

/// The axes of [`AxesDescription::isotropic`] in an element.
fn isotropic_triad(rest: &RestTetrahedron, lame: LameParameters) -> Triad<f64> {
    let [_, a, b, c] = rest.gradients;
    Triad {
        gradients: [a, b, c],
        axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        axial: [2.0 * lame.mu * rest.volume; 3],
        angular: [lame.mu * rest.volume; 3],
        volumetric: lame.lambda * rest.volume,
    }
}

/// Plain `f64` sums over elements, without columns, ranges, lanes or springs.
pub struct Reference {
    pub(super) energy: f64,
    /// Forces (N) on the vertices.
    pub forces: Vec<DVec3>,
    /// Of the exact tangent with [`directions`].
    pub product: Vec<DVec3>,
    pub(super) projected_product: Vec<DVec3>,
}

/// Energy, forces, and products with exact and projected tangent, of one element.
pub type ElementSums<const N: usize> = (f64, [[f64; 3]; N], [[f64; 3]; N], [[f64; 3]; N]);

impl Reference {
    /// Of so many vertices, without elements.
    pub fn zero(vertices: usize) -> Self {
        let zero = vec![DVec3::ZERO; vertices];
        let (forces, product, projected_product) = (zero.clone(), zero.clone(), zero);
        Self { energy: 0.0, forces, product, projected_product }
    }

    /// Adds an element.
    pub fn add<const N: usize>(&mut self, nodes: &[u32; N], sums: ElementSums<N>) {
        self.energy += sums.0;
        for (a, &node) in nodes.iter().enumerate() {
            let node = node as usize;
            self.forces[node] += DVec3::from_array(sums.1[a]);
            self.product[node] += DVec3::from_array(sums.2[a]);
            self.projected_product[node] += DVec3::from_array(sums.3[a]);
        }
    }

    /// At displacements `u` (m), of [`MATERIAL`].
    ///
    /// # Errors
    /// When an element is flat.
    pub fn of(mesh: &Mesh, u: &[DVec3], model: Model) -> Result<Self> {
        let lame = MATERIAL.lame()?;
        let v = directions(mesh.points.len());
        let mut sum = Self::zero(mesh.points.len());
        for nodes in &mesh.tetrahedra {
            let pick = |field: &[DVec3]| nodes.map(|i| field[i as usize].to_array());
            let rest = RestTetrahedron::new(pick(&mesh.points))?;
            let e = Element::<f64>::new(&rest, lame, model.has_compression());
            let (u, v) = (pick(u), pick(&v));
            let sums = match model {
                Model::MassSpring => {
                    let tensile = SpringConstants::new(&rest, lame).tensile;
                    let springs = tensile.into_iter().zip(TETRAHEDRON_EDGES);
                    edge_sums(springs, pick(&mesh.points), [u, v])
                }
                Model::QuadraticSprings => element_sums::<QuadraticSprings>(&e, &u, &v),
                Model::Linear => element_sums::<Linear>(&e, &u, &v),
                Model::WarpedStiffness => element_sums::<WarpedStiffness>(&e, &u, &v),
                Model::Corotational => element_sums::<Corotational>(&e, &u, &v),
                Model::StVKFem => element_sums::<StVKFem>(&e, &u, &v),
                Model::NeoHookean => element_sums::<NeoHookean>(&e, &u, &v),
                Model::StVKVolume => element_sums::<StVKVolume>(&e, &u, &v),
                Model::Axes => {
                    let e = isotropic_triad(&rest, lame);
                    let product = |kind| e.tangent(&u, kind).product(&v);
                    let [exact, projected] = [TangentKind::Exact, TangentKind::Projected];
                    (e.energy(&u), e.forces(&u), product(exact), product(projected))
                }
                // no row of another crate is timed
                Model::StVK | Model::CompressibleStVK | Model::Own(_) => {
                    let product = |kind| tetrahedron::tangent(&e, &u, kind).product(&v);
                    let [exact, projected] = [TangentKind::Exact, TangentKind::Projected];
                    let (energy, forces) =
                        (tetrahedron::energy(&e, &u), tetrahedron::forces(&e, &u));
                    (energy, forces, product(exact), product(projected))
                }
            };
            sum.add(nodes, sums);
        }
        Ok(sum)
    }
}

/// Tensile springs between the vertices of one element.
pub fn edge_sums<const N: usize>(
    springs: impl Iterator<Item = (f64, [usize; 2])>,
    points: [[f64; 3]; N],
    [u, v]: [[[f64; 3]; N]; 2],
) -> ElementSums<N> {
    let (mut energy, mut forces, mut products) = (0.0, [[0.0; 3]; N], [[0.0; 3]; N]);
    for (k, [a, b]) in springs {
        let spring = PlainSpring::new(k, sub(points[a], points[b]), sub(u[a], u[b]));
        energy += tensile_energy(k, spring.stretch.change);
        let pull = spring.pull();
        (forces[a], forces[b]) = (sub(forces[a], pull), add(forces[b], pull));
        let change = spring.product(sub(v[a], v[b]));
        (products[a], products[b]) = (add(products[a], change), sub(products[b], change));
    }
    (energy, forces, products, [[0.0; 3]; N])
}

/// A quadratic spring on an edge, written for reference sums.
struct PlainSpring {
    stiffness: f64,
    stretch: Stretch<f64>,
    /// Tension over length (N/m).
    tension: f64,
}

impl PlainSpring {
    /// Of stiffness `k` (N/m^3), with rest vector and difference of displacements `a - b` (m).
    fn new(stiffness: f64, rest: [f64; 3], change: [f64; 3]) -> Self {
        let stretch = Stretch::new(rest, change);
        let tension = stretch.slope * tensile_tension(stiffness, stretch.change);
        Self { stiffness, stretch, tension }
    }

    /// Force (N) on `b`.
    fn pull(&self) -> [f64; 3] {
        scale(self.stretch.edge, self.tension)
    }

    /// Product (N) of the tangent with the difference `way` of directions `a - b`, at `a`.
    fn product(&self, way: [f64; 3]) -> [f64; 3] {
        let s = &self.stretch;
        let along = dot(s.edge, way);
        let stiff = 0.5 * self.stiffness * s.slope * s.slope - self.tension * s.inverse_square;
        add(scale(s.edge, stiff * along), scale(way, self.tension))
    }
}
