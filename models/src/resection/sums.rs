//! Sums over the elements round what removals touched, formed again in the order in which a new body forms them.

use bevy_ecs::prelude::*;
use sinew_engine::columns::single_table;
use sinew_engine::connectivity::{ByKind, ElementKind, Incidence, Touched};
use sinew_engine::load::{Load, LoadedFaces, Pressure};
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::{Scalar, sub};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{Mass, Velocity, WeightShift};

use super::report::RemovalReport;
use super::state::{ModuliData, Vertices, numbers};
use crate::body::description::{MassRule, SoftBody};
use crate::body::matter::{Chosen, Items};
use crate::body::present::BodyResection;
use crate::element::spring::{Stretch, tensile_energy};
use crate::laws::pooled::{AngularStiffness, TensileStiffness};
use crate::material::LameParameters;

impl BodyResection {
    /// Elements of every kind that are left round some items.
    fn round(&self, items: &[u32], round: &ByKind<Incidence>) -> Chosen {
        ByKind::of(|kind| {
            let of = |&item: &u32| self.connectivity.left(kind, round[kind].of(item));
            let mut elements: Vec<u32> = items.iter().flat_map(of).collect();
            elements.sort_unstable();
            elements.dedup();
            elements
        })
    }

    /// Sums the constants of the springs at the touched edges and triangles again, and books the energy of springs
    /// on edges that went.
    pub(super) fn sum_constants<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        touched: &Touched,
        report: &mut RemovalReport,
    ) {
        let mut query = world.query();
        let mut moduli = world.query::<ModuliData<S>>();
        let vertices = Vertices::<S>::of(&mut query, world, soft.index);
        let rest_of = |v| vertices.rest(v);
        let cells = &self.connectivity.cells;
        let matter = soft.matter(&self.connectivity.ordered, &rest_of);
        if soft.springs.is_empty() && !matter.is_pooled() {
            return;
        }
        // whoever shares a triangle with a removed element shares its edges
        let round = self.round(&touched.edges, &self.connectivity.round_edge);
        let lame = |&t: &u32| {
            let entity = self.rows.elements[ElementKind::Tetrahedron][t as usize];
            let columns = moduli.get(world, entity).expect("a tetrahedron that is left has a row");
            let [lambda, mu, _] = numbers(columns);
            LameParameters { lambda, mu }
        };
        let lame: Vec<_> = round[ElementKind::Tetrahedron].iter().map(lame).collect();
        let (edges, triangles) = (Items::Only(&touched.edges), Items::Only(&touched.triangles));
        let alone = matter.edge_springs(&soft.springs, cells, edges, &round);
        let pooled = matter.pooled_springs(cells, [edges, triangles], &round, &lame);

        let stretch = |edge: u32| {
            let ends = cells.edges[edge as usize];
            let [a, b] = ends.map(|v| vertices.rest(v).to_array());
            let [ua, ub] = vertices.displacements(ends);
            Stretch::new(sub(a, b), sub(ua, ub)).change
        };
        // the energy of pooled springs is booked with their elements
        let changes: Vec<f64> = touched.edges.iter().map(|&edge| stretch(edge)).collect();
        let mut query = world.query::<&mut TensileStiffness<S>>();
        for (&edge, (&sum, change)) in touched.edges.iter().zip(alone.iter().zip(changes)) {
            if let Ok(k) = query.get_mut(world, self.rows.edges[1][edge as usize]) {
                report.elastic_energy += tensile_energy(k.0.to_f64() - sum, change);
            }
        }
        for (entities, sums) in self.rows.edges.iter().zip([&pooled.tensile, &alone]) {
            for (&edge, &sum) in touched.edges.iter().zip(sums) {
                if let Ok(mut k) = query.get_mut(world, entities[edge as usize]) {
                    k.0 = S::from_f64(sum);
                }
            }
        }
        let mut query = world.query::<(
            &mut AngularStiffness<S, 0>,
            &mut AngularStiffness<S, 1>,
            &mut AngularStiffness<S, 2>,
        )>();
        for (&triangle, sum) in touched.triangles.iter().zip(&pooled.angular) {
            let columns = query.get_mut(world, self.rows.triangles[triangle as usize]);
            if let Ok((mut a, mut b, mut c)) = columns {
                [a.0, b.0, c.0] = sum.unwrap_or_default().map(S::from_f64);
            }
        }
    }

    /// Sums the masses of the touched vertices again, and books what went.
    pub(super) fn sum_masses<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        touched: &Touched,
        report: &mut RemovalReport,
    ) {
        let connectivity = &self.connectivity;
        let mut query = world.query();
        let vertices = Vertices::<S>::of(&mut query, world, soft.index);
        let rest_of = |v| vertices.rest(v);
        let round = self.round(&touched.vertices, &connectivity.round_vertex);
        let matter = soft.matter(&connectivity.ordered, &rest_of);
        let sums = matter.masses(Items::Only(&touched.vertices), &round);
        let v0 = world.resource::<Topology>().bodies[soft.index].vertices.start;
        let mut query = world.query::<(&mut Mass<S>, &mut Velocity<S>)>();
        let Some((mut mass, mut velocity)) = single_table(query.contiguous_iter_mut(world)) else {
            return;
        };
        let (mass, velocity) = (mass.bypass_change_detection(), velocity.bypass_change_detection());
        for (&v, sum) in touched.vertices.iter().zip(sums) {
            let row = (v + v0) as usize;
            let before = mass[row].0.to_f64();
            // equal masses stay so while a vertex has an element
            if soft.masses != MassRule::Equal || !connectivity.uses_vertex(v) {
                mass[row].0 = S::from_f64(sum);
            }
            let gone = before - mass[row].0.to_f64();
            let speed = (0..3).map(|k| velocity[row].0[k].to_f64().powi(2)).sum::<f64>();
            report.mass += gone;
            report.kinetic_energy += 0.5 * gone * speed;
            if !connectivity.uses_vertex(v) {
                velocity[row] = Velocity::default();
            }
        }
    }

    /// Sums what the weight of the touched vertices is beside that of their masses again: over what is left even where masses
    /// are kept, so that the weight of the body stays that of its mass.
    pub(super) fn sum_weight_shifts<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        touched: &Touched,
    ) {
        let connectivity = &self.connectivity;
        let mut query = world.query();
        let vertices = Vertices::<S>::of(&mut query, world, soft.index);
        let rest_of = |v| vertices.rest(v);
        let round = self.round(&touched.vertices, &connectivity.round_vertex);
        let matter = soft.matter(&connectivity.ordered, &rest_of);
        let sums = matter.weight_shifts(Items::Only(&touched.vertices), &round);
        let v0 = world.resource::<Topology>().bodies[soft.index].vertices.start;
        let mut query = world.query::<&mut WeightShift<S>>();
        let Some(mut shift) = single_table(query.contiguous_iter_mut(world)) else { return };
        let shift = shift.bypass_change_detection();
        for (&v, sum) in touched.vertices.iter().zip(sums) {
            shift[(v + v0) as usize].0 = S::from_f64(sum);
        }
    }

    /// Takes the faces that no element has any more out of pressures and tractions; how many there were.
    pub(super) fn drop_faces(&self, world: &mut World, body: usize) -> usize {
        let own = world.resource::<Topology>().bodies[body].clone();
        let rows = &own.vertices;
        let has_none = |face: &[VertexRow; 3]| {
            if !rows.contains(&face[0].0) {
                return false;
            }
            let mut local = face.map(|row| row.0 - rows.start);
            local.sort_unstable();
            let [a, b, c] = local;
            match self.triangle(local) {
                Some(at) => !self.connectivity.uses_triangle(at as u32),
                // between edges of the body, but no face of it
                None => [[a, b], [b, c], [a, c]].into_iter().any(|edge| {
                    !self.edge(edge).is_some_and(|at| self.connectivity.uses_edge(at as u32))
                }),
            }
        };
        // copies may have what is left of a face, by other rows
        let is_gone = |faces: &[[VertexRow; 3]]| -> Vec<bool> {
            let parts = self.face_parts(&own, faces);
            faces.iter().zip(parts).map(|(face, own)| own.is_none() && has_none(face)).collect()
        };
        let mut dropped = 0;
        for mut pressure in world.query::<&mut Pressure>().iter_mut(world) {
            let before = pressure.faces.len();
            let mut gone = is_gone(&pressure.faces).into_iter();
            pressure.bypass_change_detection().faces.retain(|_| gone.next() != Some(true));
            dropped += before - pressure.faces.len();
        }
        for (mut load, mut faces) in world.query::<(&mut Load, &mut LoadedFaces)>().iter_mut(world)
        {
            let before = faces.0.len();
            let corners: Vec<_> = faces.0.iter().map(|face| face.corners).collect();
            let mut gone = is_gone(&corners).into_iter();
            faces.0.retain(|_| gone.next() != Some(true));
            if faces.0.len() < before {
                load.forces = faces.forces();
                dropped += before - faces.0.len();
            }
        }
        dropped
    }
}
