//! Pulls: implicit spring-dampers from a patch of a body to a moving pose, for mice, haptic devices and couplings to
//! rigid bodies; and picking by a ray.

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::load::Pose;
use sinew_engine::order::Order;
use sinew_engine::row::VertexRow;

/// Draws every vertex of a patch to the place to which a moving pose carries it. The pose starts when the pull takes
/// hold. The energy is `sum_a w_a (k |x_a - T(X_a)|^2 + c |v_a - v_T|^2 H) / 2`, solved implicitly with everything
/// else; `H` is the length of the stage of the integrator (s). `v_T` is the mean velocity of the pose in the step.
#[derive(Component, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[require(PullReport, Order)]
pub struct Pull {
    /// Name for reports and probes.
    pub name: String,
    /// Vertex rows.
    pub rows: Vec<VertexRow>,
    /// Share of each row in the stiffness; made to sum to 1.
    pub weights: Vec<f64>,
    /// Stiffness (N/m) of all rows together.
    pub stiffness: f64,
    /// Damping (N s/m) of all rows together, against the motion of the pose.
    pub damping: f64,
    /// Where the pose is at the end of the next step, relative to where the patch was; a vector is a translation (m).
    pub target: Pose,
    /// Where the pose was at the end of the last step.
    pub(crate) last: Pose,
    /// Places (m) of the rows when it took hold; filled by the engine.
    pub(crate) anchors: Vec<DVec3>,
}

impl Pull {
    /// Pulls on rows with equal weights.
    pub fn new(
        name: impl Into<String>,
        rows: Vec<VertexRow>,
        stiffness: f64,
        damping: f64,
    ) -> Self {
        let weights = vec![1.0; rows.len()];
        Self {
            name: name.into(),
            rows,
            weights,
            stiffness,
            damping,
            target: Pose::IDENTITY,
            last: Pose::IDENTITY,
            anchors: Vec::new(),
        }
    }

    /// With a weight for every row, as [`Pick::weights`] gives them.
    #[must_use]
    pub fn with_weights(mut self, weights: Vec<f64>) -> Self {
        self.weights = weights;
        self
    }

    /// Places (m) of its rows when it took hold; none before.
    pub fn anchors(&self) -> &[DVec3] {
        &self.anchors
    }

    /// From the moved centre of the target to where it draws each row (m); none before it took hold.
    pub fn arms(&self) -> Vec<DVec3> {
        let Pose { rotation, centre, .. } = self.target;
        self.anchors.iter().map(|anchor| rotation * (*anchor - centre)).collect()
    }

    /// Moved centre (m) of the target.
    pub fn moved_centre(&self) -> DVec3 {
        self.target.centre + self.target.translation
    }

    /// The error in it in a world of `rows` vertices, if there is one.
    pub fn problem(&self, rows: usize) -> Option<String> {
        if self.rows.is_empty() {
            return Some("it pulls on no vertex".into());
        }
        if self.rows.iter().any(|r| r.index() >= rows) {
            return Some("it names a vertex row that does not exist".into());
        }
        if self.weights.len() != self.rows.len() {
            return Some(format!(
                "it has {} weights for {} rows",
                self.weights.len(),
                self.rows.len()
            ));
        }
        let sum: f64 = self.weights.iter().sum();
        if self.weights.iter().any(|w| *w < 0.0 || w.is_nan()) || !(sum > 0.0 && sum.is_finite()) {
            return Some("its weights must be 0 or positive, one of them positive".into());
        }
        if !(self.stiffness > 0.0 && self.stiffness.is_finite()) {
            return Some(format!("its stiffness is {} N/m: it must be positive", self.stiffness));
        }
        if !(self.damping >= 0.0 && self.damping.is_finite()) {
            return Some(format!("its damping is {} N s/m: it must not be negative", self.damping));
        }
        let Pose { translation, rotation, centre } = self.target;
        if !(translation.is_finite() && rotation.is_finite() && centre.is_finite()) {
            return Some(format!("its target {:?} is not finite", self.target));
        }
        ((rotation.length() - 1.0).abs() > 1e-6)
            .then(|| format!("the rotation {rotation} of its target has not length one"))
    }
}

/// Force and work of a pull at the end of the last step.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PullReport {
    /// Force (N) on the hand that pulls.
    pub force: DVec3,
    /// Torque (N m) on the hand about the moved centre of the pose.
    pub torque: DVec3,
    /// Weighted mean distance (m) of the patch from the place that it is drawn to.
    pub distance: f64,
    /// Work (J) done by the hand since it took hold, by the force at the end of every step or explicit substep.
    pub work: f64,
    /// Whether the step that these forces are of did not converge: they are not to be relied on.
    pub unconverged: bool,
}

/// A point on the surface of a body that a ray hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Index of the body.
    pub body: usize,
    /// Vertex rows of the triangle.
    pub rows: [VertexRow; 3],
    /// Barycentric coordinates of the point in it, for [`Pull::with_weights`].
    pub weights: [f64; 3],
    /// The point (m).
    pub position: DVec3,
    /// Distance (m) from the origin of the ray.
    pub distance: f64,
}

/// Where a ray meets a triangle: distance in lengths of `direction`, and barycentric coordinates (Moeller & Trumbore
/// 1997).
pub fn hit(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<(f64, [f64; 3])> {
    let (u, v) = (b - a, c - a);
    let p = direction.cross(v);
    let determinant = u.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let from = origin - a;
    let beta = from.dot(p) / determinant;
    let q = from.cross(u);
    let gamma = direction.dot(q) / determinant;
    let along = v.dot(q) / determinant;
    let inside = beta >= 0.0 && gamma >= 0.0 && beta + gamma <= 1.0 && along >= 0.0;
    inside.then_some((along, [1.0 - beta - gamma, beta, gamma]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_hits_a_triangle_in_front_of_it() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let (way, at) = hit(DVec3::new(0.2, 0.3, 2.0), DVec3::NEG_Z, triangle).unwrap();
        assert_eq!(way, 2.0);
        assert!((at[0] - 0.5).abs() < 1e-15 && (at[1] - 0.2).abs() < 1e-15);
        assert_eq!(hit(DVec3::new(0.2, 0.3, 2.0), DVec3::Z, triangle), None);
        assert_eq!(hit(DVec3::new(0.7, 0.7, 2.0), DVec3::NEG_Z, triangle), None);
        assert_eq!(hit(DVec3::new(0.2, 0.3, 2.0), DVec3::X, triangle), None);
    }
}
