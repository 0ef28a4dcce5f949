//! Reading the state of a body from outside, by the vertices of the user's mesh.

use crate::columns::single_table;
use crate::load::Constraint;
use crate::row::{MeshVertex, VertexRow};
use crate::scalar::Scalar;
use crate::time::StepClock;
use crate::topology::Topology;
use crate::vertex::{Displacement, ElasticForce, ExternalForce, Mass, RestPosition, Velocity};
use bevy_ecs::prelude::*;
use glam::DVec3;

/// A vertex as it is now.
pub struct VertexNow<'a, S: Scalar> {
    /// Displacement (m).
    pub displacement: &'a Displacement<S>,
    /// Velocity (m/s).
    pub velocity: &'a Velocity<S>,
    /// Elastic force (N) of the last evaluation.
    pub elastic: &'a ElasticForce<S>,
    /// Force (N) from outside in the last step.
    pub external: &'a ExternalForce<S>,
    /// Lumped mass (kg).
    pub mass: &'a Mass<S>,
    /// Rest position (m).
    pub rest: &'a RestPosition,
}

impl<S: Scalar> VertexNow<'_, S> {
    /// Deformed position (m).
    pub fn position(&self) -> DVec3 {
        self.rest.0 + self.displacement.get()
    }
}

/// Calls `with` with every vertex of a body that elements use or used.
pub fn each_vertex<S: Scalar>(
    world: &mut World,
    body: usize,
    mut with: impl FnMut(MeshVertex, &VertexNow<S>),
) {
    let mut query = world.query::<(
        &Displacement<S>,
        &Velocity<S>,
        &ElasticForce<S>,
        &ExternalForce<S>,
        &Mass<S>,
        &RestPosition,
    )>();
    let world = &*world;
    let Some((u, v, elastic, external, mass, rest)) = single_table(query.contiguous_iter(world))
    else {
        return;
    };
    for (vertex, row) in world.resource::<Topology>().bodies[body].vertices_and_rows() {
        let row = row.index();
        let now = VertexNow {
            displacement: &u[row],
            velocity: &v[row],
            elastic: &elastic[row],
            external: &external[row],
            mass: &mass[row],
            rest: &rest[row],
        };
        with(vertex, &now);
    }
}

/// One vector per vertex of the user's mesh, zero for those that no element uses.
pub fn by_vertex<S: Scalar>(
    world: &mut World,
    body: usize,
    pick: fn(&VertexNow<S>) -> DVec3,
) -> Vec<DVec3> {
    let count = world.resource::<Topology>().bodies[body].mesh_vertices();
    let mut result = vec![DVec3::ZERO; count];
    each_vertex(world, body, |vertex, now| result[vertex.index()] = pick(now));
    result
}

/// Force (N) that a constraint exerts at the current state, and its torque (N m) about a point (m): what is needed at
/// its held unknowns to balance elastic forces, external ones and `touch`, ascending by row. Zero while it does not act;
/// `None` when there is no such constraint.
pub fn reaction<S: Scalar>(
    world: &mut World,
    constraint: Entity,
    point: DVec3,
    touch: &[(VertexRow, DVec3)],
) -> Option<[DVec3; 2]> {
    let [mut sum, mut torque] = [DVec3::ZERO; 2];
    let mut query =
        world.query::<(&ElasticForce<S>, &ExternalForce<S>, &RestPosition, &Displacement<S>)>();
    let world = &*world;
    let constraint = world.get::<Constraint>(constraint)?;
    let acts = world.get_resource::<StepClock>().is_none_or(|clock| constraint.active(clock.time));
    let columns = single_table(query.contiguous_iter(world)).filter(|_| acts);
    let Some((elastic, external, rest, u)) = columns else { return Some([sum, torque]) };
    for &row in constraint.rows.iter().filter(|row| row.index() < elastic.len()) {
        let touch = touch.binary_search_by_key(&row, |(row, _)| *row).map(|i| touch[i].1);
        let row = row.index();
        let f = elastic[row].get() + external[row].get() + touch.unwrap_or_default();
        let mut own = DVec3::ZERO;
        for k in 0..3 {
            if constraint.axes.holds(k) {
                sum[k] -= f[k];
                own[k] = -f[k];
            }
        }
        torque += (rest[row].0 + u[row].get() - point).cross(own);
    }
    Some([sum, torque])
}
