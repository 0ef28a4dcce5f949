//! Picking bodies by a ray, and pulling them about.

use crate::body::affine;
use crate::{Moved, SinewBodyIndex, SinewPull, SinewSurface};
use bevy_ecs::prelude::*;
use bevy_ecs::system::SystemParam;
use bevy_math::{DVec3, Vec3};
use bevy_shape::Ray3d;
use bevy_transform::components::Transform;
use bevy_transform::helper::TransformHelper;
use sinew::engine::columns::single_table;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::Position;
use sinew::touch::pull::hit;

/// A point on the surface of a body that a ray hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SinewHit {
    /// Body.
    pub entity: Entity,
    /// Vertices of the triangle in the user's mesh.
    pub vertices: [u32; 3],
    /// Barycentric coordinates of the point in it.
    pub weights: [f64; 3],
    /// The point (m).
    pub position: DVec3,
    /// Distance (m) from the origin of the ray.
    pub distance: f64,
}

impl SinewHit {
    /// The vertex nearest to the point.
    pub fn vertex(&self) -> u32 {
        let largest = (0..3).max_by(|&i, &j| self.weights[i].total_cmp(&self.weights[j]));
        self.vertices[largest.unwrap_or(0)]
    }

    /// Pulls on the point, moved once a frame; spawn it as a child of the body, at the point.
    pub fn pull(&self, stiffness: f64, damping: f64) -> SinewPull {
        SinewPull {
            vertices: self.vertices.to_vec().into(),
            weights: self.weights.to_vec(),
            stiffness,
            damping,
            moved: Moved::EveryFrame,
        }
    }
}

/// Casts rays on the surfaces that bodies have now, before [`SinewInterpolation`](crate::SinewInterpolation): on faces of their meshes, not on
/// wounds, nor on a finer mesh that is carried.
#[derive(SystemParam)]
pub struct SinewRayCast<'w, 's> {
    topology: Res<'w, Topology>,
    positions: Query<'w, 's, &'static Position>,
    bodies: Query<'w, 's, (Entity, &'static SinewBodyIndex, &'static SinewSurface)>,
}

impl SinewRayCast<'_, '_> {
    /// The first point that a ray meets.
    pub fn cast(&self, ray: Ray3d) -> Option<SinewHit> {
        let (origin, way) = (ray.origin.as_dvec3(), ray.direction.as_dvec3().normalize());
        let positions = single_table(self.positions.contiguous_iter())?;
        let mut found: Option<SinewHit> = None;
        for (entity, index, surface) in &self.bodies {
            let body = &self.topology.bodies[index.0];
            let triangles = match surface.tissue[..] {
                [] => &surface.triangles,
                _ => &surface.tissue,
            };
            for &vertices in triangles {
                let Some(rows) = body.rows(&vertices) else { continue };
                let corners = [rows[0], rows[1], rows[2]].map(|row| positions[row.index()].0);
                let Some((distance, weights)) = hit(origin, way, corners) else { continue };
                if found.is_none_or(|found| distance < found.distance) {
                    let position = origin + distance * way;
                    found = Some(SinewHit { entity, vertices, weights, position, distance });
                }
            }
        }
        found
    }
}

/// A pull made by [`SinewMouse::grab`], and the plane in which it is moved.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct SinewDrag {
    /// A point of the plane (m): where the body was grabbed.
    pub point: DVec3,
    /// Its normal.
    pub normal: DVec3,
}

/// Pulls bodies about by rays, as of a mouse: in the plane through the point that was grabbed which faces the camera.
#[derive(SystemParam)]
pub struct SinewMouse<'w, 's> {
    cast: SinewRayCast<'w, 's>,
    transforms: TransformHelper<'w, 's>,
    drags: Query<'w, 's, (&'static SinewDrag, &'static ChildOf)>,
    commands: Commands<'w, 's>,
}

impl SinewMouse<'_, '_> {
    /// Takes hold of the first point that a ray meets, by a spring of `stiffness` (N/m) and a damper of `damping`
    /// (N s/m); `facing` is the direction in which the camera looks. The entity is that of the pull, a child of the body.
    pub fn grab(
        &mut self,
        ray: Ray3d,
        facing: Vec3,
        stiffness: f64,
        damping: f64,
    ) -> Option<(Entity, SinewHit)> {
        let hit = self.cast.cast(ray)?;
        let normal = facing.as_dvec3().try_normalize()?;
        let place = self.place(hit.entity, hit.position)?;
        let drag = SinewDrag { point: hit.position, normal };
        let pull = (hit.pull(stiffness, damping), drag, place, ChildOf(hit.entity));
        Some((self.commands.spawn(pull).id(), hit))
    }

    /// Moves what was grabbed to where the ray meets its plane; `None`, and nothing is moved, when it does not, or
    /// there is no such pull.
    pub fn drag(&mut self, pull: Entity, ray: Ray3d) -> Option<DVec3> {
        let (&SinewDrag { point, normal }, body) = self.drags.get(pull).ok()?;
        let (origin, way) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let along = (point - origin).dot(normal) / way.dot(normal);
        let there = origin + along * way;
        if !(along > 0.0 && there.is_finite()) {
            return None;
        }
        let place = self.place(body.parent(), there)?;
        self.commands.entity(pull).try_insert(place);
        Some(there)
    }

    /// Lets go.
    pub fn release(&mut self, pull: Entity) {
        if self.drags.contains(pull) {
            self.commands.entity(pull).try_despawn();
        }
    }

    /// A point (m) in the frame of a body.
    fn place(&self, body: Entity, point: DVec3) -> Option<Transform> {
        let frame = affine(&self.transforms.compute_global_transform(body).ok()?);
        Some(Transform::from_translation(frame.inverse().transform_point3(point).as_vec3()))
    }
}
