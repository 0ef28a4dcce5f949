//! The state of elements that are left, in `f64`: what regions ask for and what leaves with removed ones.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::element::{RestVolume, ShapeGradients, displacement_gradient};
use sinew_engine::isoparametric::{
    Derivatives, HexahedronRest, OwnPoints, Tetrahedron10Rest, derivatives_of,
};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{Displacement, RestPosition};

use super::report::RemovalReport;
use crate::axes;
use crate::body::description::SoftBody;
use crate::body::matter::{Chosen, Matter};
use crate::body::present::BodyResection;
use crate::body::sheet::MembraneModel;
use crate::element::membrane;
use crate::element::tetrahedron::Element;
use crate::frame::hexahedra::{Brick, TenNodes};
use crate::frame::means::Sums;
use crate::frame::moduli::{CompressionModulus, FirstLameParameter, ShearModulus};
use crate::frame::reduced::InF64;
use crate::frame::row::{Elements, HourglassEnergy};
use crate::frame::rules::{VolumeMeasure, shared_part};
use crate::frame::{hexahedra, quads};
use crate::material::LameParameters;

/// Kinds of elements in the order in which their energies are added up.
const IN_SUMS: [ElementKind; 4] =
    [ElementKind::Tetrahedron, ElementKind::Hexahedron, ElementKind::Triangle, ElementKind::Quad];

/// Rest positions and displacements (m) of all vertices of a world, as one body numbers them.
pub(super) struct Vertices<'a, S: Scalar> {
    rest: &'a [RestPosition],
    displacement: &'a [Displacement<S>],
}

pub(super) type VertexQuery<S> = QueryState<(&'static RestPosition, &'static Displacement<S>)>;

impl<'a, S: Scalar> Vertices<'a, S> {
    /// Nothing is copied.
    pub fn of(query: &'a mut VertexQuery<S>, world: &'a World, body: usize) -> Self {
        let rows = world.resource::<Topology>().bodies[body].vertices.clone();
        let rows = rows.start as usize..rows.end as usize;
        match single_table(query.contiguous_iter(world)) {
            Some((rest, u)) => Self { rest: &rest[rows.clone()], displacement: &u[rows] },
            None => Self { rest: &[], displacement: &[] },
        }
    }

    pub fn rest(&self, vertex: u32) -> DVec3 {
        self.rest[vertex as usize].0
    }

    fn displacement(&self, vertex: u32) -> DVec3 {
        let [x, y, z, _] = self.displacement[vertex as usize].0.map(|x| x.to_f64());
        DVec3::new(x, y, z)
    }

    pub fn barycentre(&self, vertices: &[u32]) -> DVec3 {
        let sum: DVec3 = vertices.iter().map(|&v| self.rest(v) + self.displacement(v)).sum();
        sum / vertices.len() as f64
    }

    /// The mean with these weights: where the material of a copy is.
    pub fn mean(&self, vertices: &[u32], weights: &[f64]) -> DVec3 {
        let places =
            vertices.iter().zip(weights).map(|(&v, w)| *w * (self.rest(v) + self.displacement(v)));
        places.sum::<DVec3>() / weights.iter().sum::<f64>()
    }

    pub fn displacements<const N: usize>(&self, vertices: [u32; N]) -> [[f64; 3]; N] {
        vertices.map(|v| self.displacement(v).to_array())
    }
}

/// Columns of the moduli of solid elements.
pub(super) type ModuliData<S> =
    (&'static FirstLameParameter<S>, &'static ShearModulus<S>, &'static CompressionModulus<S>);
type TetrahedronData<S> = (ShapeGradients<S>, &'static RestVolume<S>, ModuliData<S>);
type HexahedronData<S> = (&'static HexahedronRest<S>, ModuliData<S>);
type Tetrahedron10Data<S> = (&'static Tetrahedron10Rest<S>, ModuliData<S>);

/// A simplex that stands for an element or one of its Gauss points, with the displacements (m) of its vertices.
pub(crate) enum Point<'a> {
    /// Of a solid element.
    Solid(&'a Element<f64>, &'a [[f64; 3]; 4]),
    /// Of a membrane; its moduli are so many times those of the element.
    Sheet(&'a membrane::Element<f64>, &'a [[f64; 3]; 3], f64),
}

/// Queries for the state of elements.
pub(crate) struct Queries<S: Scalar> {
    vertices: VertexQuery<S>,
    tetrahedra: QueryState<TetrahedronData<S>>,
    hexahedra: QueryState<HexahedronData<S>>,
    tens: QueryState<Tetrahedron10Data<S>>,
}

impl<S: Scalar> Queries<S> {
    pub fn new(world: &mut World) -> Self {
        Self {
            vertices: world.query(),
            tetrahedra: world.query(),
            hexahedra: world.query(),
            tens: world.query(),
        }
    }
}

/// Elements of a body that have a row.
pub(crate) struct State<'a, S: Scalar> {
    own: &'a BodyResection,
    world: &'a World,
    soft: &'a SoftBody,
    pub(super) vertices: Vertices<'a, S>,
    tetrahedra: &'a QueryState<TetrahedronData<S>>,
    hexahedra: &'a QueryState<HexahedronData<S>>,
    tens: &'a QueryState<Tetrahedron10Data<S>>,
    points: &'a OwnPoints,
}

impl<'a, S: Scalar> State<'a, S> {
    pub fn new(
        own: &'a BodyResection,
        world: &'a World,
        soft: &'a SoftBody,
        queries: &'a mut Queries<S>,
    ) -> Self {
        let Queries { vertices, tetrahedra, hexahedra, tens } = queries;
        let vertices = Vertices::of(vertices, world, soft.index);
        let points = world.resource::<OwnPoints>();
        Self { own, world, soft, vertices, tetrahedra, hexahedra, tens, points }
    }

    /// Does something with all points of an element, each with the stress that is its own.
    pub fn visit(&self, kind: ElementKind, element: u32, with: impl FnMut(Point)) {
        self.visit_by(kind, element, None, with);
    }

    /// The same with energies that add up to that of the element.
    fn visit_shares(&self, kind: ElementKind, element: u32, with: impl FnMut(Point)) {
        self.visit_by(kind, element, self.measure(), with);
    }

    /// How volumes are measured that are kept as means.
    fn measure(&self) -> Option<VolumeMeasure> {
        let SoftBody { law, volume, .. } = self.soft;
        let law = law.and_then(|law| law.in_elements(Elements::Tetrahedra, *volume));
        law.and_then(|row| row.measure).map(|measure| measure.volume)
    }

    fn visit_by(
        &self,
        kind: ElementKind,
        element: u32,
        mean: Option<VolumeMeasure>,
        mut with: impl FnMut(Point),
    ) {
        let (e, elements) = (element as usize, &self.own.connectivity.ordered);
        let entity = self.own.rows.elements[kind][e];
        let rest_of = |v| self.vertices.rest(v);
        let matter = self.soft.matter(elements, &rest_of);
        let has_row = "an element that is left has a row";
        let at_points = |points: &mut [(Element<f64>, [[f64; 3]; 4])],
                         with: &mut dyn FnMut(Point)| {
            if let Some(measure) = mean {
                hexahedra::by_mean(points, measure);
            }
            points.iter().for_each(|(e, u)| with(Point::Solid(e, u)));
        };
        match kind {
            ElementKind::Tetrahedron if !elements.tetrahedra10().is_empty() => {
                let (rest, moduli) = self.tens.get_manual(self.world, entity).expect(has_row);
                let u = self.vertices.displacements(elements.tetrahedra10()[e]);
                let (of_all, moduli, mut slot) =
                    (Derivatives::tetrahedron10(), numbers(moduli), None);
                let derivatives = derivatives_of(&of_all, &self.points.tens, rest.own, &mut slot);
                let points = &mut hexahedra::tetrahedra(derivatives, &rest.in_f64(), moduli, &u);
                at_points(points, &mut with);
            }
            ElementKind::Tetrahedron => {
                let columns = self.tetrahedra.get_manual(self.world, entity).expect(has_row);
                let u = self.vertices.displacements(elements.tetrahedra()[e]);
                with(Point::Solid(&tetrahedron(columns), &u));
            }
            ElementKind::Hexahedron => {
                let (rest, moduli) = self.hexahedra.get_manual(self.world, entity).expect(has_row);
                let u = self.vertices.displacements(elements.hexahedra()[e]);
                let (of_all, moduli, mut slot) = (Derivatives::hexahedron(), numbers(moduli), None);
                if let Some(own) = InF64::new::<S>(self.world.entity(entity), &u, moduli, mean) {
                    return with(Point::Solid(&own.point.0, &own.point.1));
                }
                let derivatives = derivatives_of(&of_all, &self.points.bricks, rest.own, &mut slot);
                let points = &mut hexahedra::tetrahedra(derivatives, &rest.in_f64(), moduli, &u);
                at_points(points, &mut with);
            }
            ElementKind::Triangle => {
                let u = self.vertices.displacements(elements.triangles()[e]);
                if let Some(e) = triangle(&matter, element) {
                    with(Point::Sheet(&e, &u, 1.0));
                }
            }
            ElementKind::Quad => {
                let Some(settings) = &self.soft.membrane else { return };
                let LameParameters { lambda, mu } = settings.surface().0;
                let moduli = [lambda, mu, settings.compression()];
                let rest = matter.quad(element).component();
                let u = self.vertices.displacements(elements.quads()[e]);
                for (e, u) in quads::triangles(&rest, moduli, &u) {
                    with(Point::Sheet(&e, &u, 2.0));
                }
            }
        }
    }

    /// Books elastic energy and volume of elements that go; springs on edges are booked where their constants are
    /// summed again.
    pub fn book(&self, chosen: &Chosen, report: &mut RemovalReport) {
        let Self { own, soft, .. } = self;
        for kind in IN_SUMS {
            let elements = match kind {
                ElementKind::Hexahedron => soft.integration.hexahedra(),
                _ if !own.connectivity.ordered.tetrahedra10().is_empty() => Elements::Tetrahedra10,
                _ => Elements::Tetrahedra,
            };
            let law = soft.law.and_then(|law| law.in_elements(elements, soft.volume));
            let hourglass = law.and_then(|law| law.hourglass);
            let law = law.and_then(|law| law.energy);
            for &e in &chosen[kind] {
                let (mut energy, mut volume) = (0.0, 0.0);
                let share = match kind {
                    ElementKind::Triangle if !own.connectivity.ordered.is_whole(kind, e) => {
                        own.connectivity.ordered.sheet_portion(e).iter().sum()
                    }
                    _ => 1.0,
                };
                self.visit_shares(kind, e, |point| match point {
                    Point::Solid(e, u) => {
                        energy += law.map_or(0.0, |energy| energy(e, u));
                        volume += e.volume;
                    }
                    Point::Sheet(e, u, _) => {
                        let whole = soft.membrane.map_or(0.0, |m| membrane_energy(m.model, e, u));
                        energy += whole * share;
                    }
                });
                if let Some(of_modes) = hourglass {
                    energy += self.hourglass_energy(e, of_modes);
                }
                report.elastic_energy += energy;
                report.volume += volume;
                for axes in own.rows.axes(kind, e) {
                    report.elastic_energy += self.axes_energy(kind, e, axes);
                }
            }
        }
    }

    /// Energy (J) of the hourglass modes of a hexahedron.
    fn hourglass_energy(&self, element: u32, of_modes: HourglassEnergy) -> f64 {
        let entity = self.own.rows.elements[ElementKind::Hexahedron][element as usize];
        let nodes = self.own.connectivity.ordered.hexahedra()[element as usize];
        let u = self.vertices.displacements(nodes);
        let own = InF64::new::<S>(self.world.entity(entity), &u, [0.0; 3], None);
        own.map_or(0.0, |own| of_modes(&own.stiffness, &own.modes))
    }

    /// Adds a tetrahedron to what is summed over its cluster.
    pub fn add_to(&self, sums: &mut Sums, element: u32) {
        let Some(measure) = self.measure() else { return };
        self.visit(ElementKind::Tetrahedron, element, |point| {
            if let Point::Solid(e, u) = point {
                let change = measure.change(&displacement_gradient(&e.gradients, u));
                sums.add([e.volume, shared_part(e.lambda, e.mu)], change);
            }
        });
    }

    fn axes_energy(&self, kind: ElementKind, e: u32, axes: Entity) -> f64 {
        let elements = &self.own.connectivity.ordered;
        if kind == ElementKind::Tetrahedron && !elements.tetrahedra10().is_empty() {
            let u = self.vertices.displacements(elements.tetrahedra10()[e as usize]);
            return axes::removal::energy_at::<S, TenNodes, 10, 45, 4>(self.world, axes, &u);
        }
        if kind == ElementKind::Tetrahedron {
            let u = self.vertices.displacements(elements.tetrahedra()[e as usize]);
            return axes::removal::energy::<S>(self.world, axes, &u);
        }
        if kind == ElementKind::Triangle {
            let [a, b, c] = elements.triangles()[e as usize];
            let u = self.vertices.displacements([a, b, c, c]);
            return axes::removal::energy::<S>(self.world, axes, &u);
        }
        let u = self.vertices.displacements(elements.hexahedra()[e as usize]);
        axes::removal::energy_at::<S, Brick, 8, 28, 8>(self.world, axes, &u)
    }
}

/// A membrane triangle; the membrane of a body is of one material.
fn triangle(matter: &Matter, t: u32) -> Option<membrane::Element<f64>> {
    let settings = matter.membrane?;
    let compression = settings.compression() > 0.0;
    Some(membrane::Element::new(&matter.triangle(t), settings.surface().0, compression))
}

/// Moduli lambda, mu and that of the compression term.
pub(super) fn numbers<S: Scalar>(
    (lambda, mu, compression): (&FirstLameParameter<S>, &ShearModulus<S>, &CompressionModulus<S>),
) -> [f64; 3] {
    [lambda.0, mu.0, compression.0].map(|x| x.to_f64())
}

/// A tetrahedron from its columns.
fn tetrahedron<S: Scalar>(
    ((d1, d2, d3), volume, moduli): <TetrahedronData<S> as bevy_ecs::query::QueryData>::Item<
        '_,
        '_,
    >,
) -> Element<f64> {
    let rows = [[d1.0.0, d1.1.0, d1.2.0], [d2.0.0, d2.1.0, d2.2.0], [d3.0.0, d3.1.0, d3.2.0]];
    let gradients = rows.map(|d| d.map(|x| x.to_f64()));
    Element::plain(gradients, volume.0.to_f64(), numbers(moduli))
}

/// Energy (J) of a membrane triangle by its own law; springs on edges are booked beside it.
/// Forces (N) of a whole triangle; none of springs on edges alone.
pub(crate) fn membrane_forces(
    model: MembraneModel,
    e: &membrane::Element<f64>,
    u: &[[f64; 3]; 3],
) -> Option<[[f64; 3]; 3]> {
    Some(match model {
        MembraneModel::Biquadratic | MembraneModel::CompressibleBiquadratic => {
            membrane::biquadratic::forces(e, u)
        }
        MembraneModel::Quadratic => membrane::quadratic::forces(e, u),
        MembraneModel::Linear => membrane::linear::forces(e, u),
        MembraneModel::Corotational => membrane::corotational::forces(e, u),
        MembraneModel::MassSpring => return None,
    })
}

fn membrane_energy(model: MembraneModel, e: &membrane::Element<f64>, u: &[[f64; 3]; 3]) -> f64 {
    match model {
        MembraneModel::Biquadratic | MembraneModel::CompressibleBiquadratic => {
            membrane::biquadratic::energy(e, u)
        }
        MembraneModel::Quadratic => membrane::quadratic::energy(e, u),
        MembraneModel::Linear => membrane::linear::energy(e, u),
        MembraneModel::Corotational => membrane::corotational::energy(e, u),
        MembraneModel::MassSpring => 0.0,
    }
}
