//! Constraints and loads: entities of their own that name vertex rows, with a time curve.
//! [`StepSystems::Prepare`](crate::schedule::StepSystems::Prepare) turns them into the vertex
//! columns [`FixedAxes`], [`PrescribedDisplacement`] and [`ExternalForce`].

use crate::columns::single_table;
use crate::scalar::Scalar;
use crate::time::{Gravity, StepClock};
use crate::vertex::{
    Displacement, ExternalForce, FixedAxes, Mass, PrescribedDisplacement, RestPosition,
};
use bevy_ecs::prelude::*;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU64, Ordering};

/// A factor that varies with time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Curve {
    /// Always 1.
    Constant,
    /// Linear between (time in s, factor) points, constant outside; times ascending.
    Points(Vec<[f64; 2]>),
    /// `sin(2 pi frequency t + phase)`; frequency in Hz, phase in rad.
    Sine {
        /// Frequency (Hz).
        frequency: f64,
        /// Phase (rad).
        phase: f64,
    },
}

impl Curve {
    /// From 0 at `start` to 1 at `end` (s).
    pub fn ramp(start: f64, end: f64) -> Self {
        Self::Points(vec![[start, 0.0], [end, 1.0]])
    }

    /// Whether it takes more than one value between `from` and `to` (s).
    pub fn varies(&self, from: f64, to: f64) -> bool {
        match self {
            Self::Constant => false,
            Self::Points(points) => {
                let start = self.value(from);
                let within = points.iter().filter(|p| p[0] > from && p[0] < to);
                self.value(to) != start || within.into_iter().any(|p| p[1] != start)
            }
            Self::Sine { frequency, .. } => *frequency != 0.0,
        }
    }

    /// Whether it jumps after `from` and up to `to` (s): two points at the same time.
    pub fn jumps(&self, from: f64, to: f64) -> bool {
        match self {
            Self::Points(points) => points.windows(2).any(|p| {
                p[0][0] == p[1][0] && p[0][1] != p[1][1] && p[0][0] > from && p[0][0] <= to
            }),
            _ => false,
        }
    }

    /// What is wrong with it, if anything.
    fn problem(&self) -> Option<&'static str> {
        match self {
            Self::Constant => None,
            Self::Points(points) if points.is_empty() => Some("its curve has no points"),
            Self::Points(points) if points.iter().flatten().any(|x| !x.is_finite()) => {
                Some("its curve has a number that is not finite")
            }
            Self::Points(points) if points.windows(2).any(|p| p[0][0] > p[1][0]) => {
                Some("the times of its curve do not ascend")
            }
            Self::Points(_) => None,
            Self::Sine { frequency, phase } => (!frequency.is_finite() || !phase.is_finite())
                .then_some("its sine has a number that is not finite"),
        }
    }

    /// Value at a time (s).
    ///
    /// ```
    /// # use sinew_engine::load::Curve;
    /// assert_eq!(Curve::ramp(1.0, 3.0).value(1.5), 0.25);
    /// assert_eq!(Curve::ramp(1.0, 3.0).value(9.0), 1.0);
    /// ```
    pub fn value(&self, t: f64) -> f64 {
        match self {
            Self::Constant => 1.0,
            Self::Points(points) => {
                let after = points.partition_point(|p| p[0] <= t);
                match (points.get(after.wrapping_sub(1)), points.get(after)) {
                    (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (t - a[0]) / (b[0] - a[0]),
                    (Some(a), None) | (None, Some(a)) => a[1],
                    (None, None) => 1.0,
                }
            }
            Self::Sine { frequency, phase } => {
                (std::f64::consts::TAU * frequency * t + phase).sin()
            }
        }
    }
}

/// Where constrained vertices go, relative to where they were when the constraint took hold; the
/// curve scales it.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    /// They stay.
    Hold,
    /// A common translation (m).
    Translate(DVec3),
    /// One translation (m) per vertex of the constraint.
    TranslateEach(Vec<DVec3>),
    /// A rotation about an axis.
    Rotate {
        /// Point on the axis (m).
        centre: DVec3,
        /// Direction of the axis (any length).
        axis: DVec3,
        /// Angle (rad) at curve value 1.
        angle: f64,
    },
}

/// Holds or moves vertices while it is active.
#[derive(Component, Clone, Debug)]
pub struct Constraint {
    /// Name for reports and probes.
    pub name: String,
    /// Vertex rows.
    pub rows: Vec<u32>,
    /// Held axes.
    pub axes: FixedAxes,
    /// Prescribed motion.
    pub motion: Motion,
    /// Factor on the motion.
    pub curve: Curve,
    /// Time (s) from which it acts.
    pub from: f64,
    /// Time (s) after which the vertices are free again.
    pub until: f64,
    /// Displacements (m) when it took hold; filled by the engine.
    pub start: Vec<DVec3>,
    /// Place in the order of creation.
    pub(crate) sequence: u64,
}

/// Constraints made so far.
static CONSTRAINTS: AtomicU64 = AtomicU64::new(0);

impl Constraint {
    /// Holds `rows` where they are, for good.
    pub fn hold(name: impl Into<String>, rows: Vec<u32>) -> Self {
        Self::moving(name, rows, Motion::Hold, Curve::Constant)
    }

    /// Moves `rows`, for good.
    pub fn moving(name: impl Into<String>, rows: Vec<u32>, motion: Motion, curve: Curve) -> Self {
        Self {
            name: name.into(),
            rows,
            axes: FixedAxes::ALL,
            motion,
            curve,
            from: f64::NEG_INFINITY,
            until: f64::INFINITY,
            start: Vec::new(),
            sequence: CONSTRAINTS.fetch_add(1, Ordering::Relaxed),
        }
    }

    /// Whether it acts on a step that ends at `t` (s).
    pub fn active(&self, t: f64) -> bool {
        t >= self.from && t <= self.until
    }

    /// The motion at a time (s).
    pub(crate) fn pose(&self, t: f64) -> Pose {
        let factor = self.curve.value(t);
        match &self.motion {
            Motion::Rotate { axis, angle, .. } => {
                Pose::Turn(DQuat::from_axis_angle(axis.normalize(), angle * factor))
            }
            _ => Pose::Factor(factor),
        }
    }

    /// Displacement (m) of its vertex `i`, which rests at `rest` (m).
    pub(crate) fn displacement(&self, pose: &Pose, i: usize, rest: DVec3) -> DVec3 {
        let start = self.start[i];
        match (&self.motion, pose) {
            (Motion::Translate(d), Pose::Factor(factor)) => start + *d * *factor,
            (Motion::TranslateEach(d), Pose::Factor(factor)) => {
                start + d.get(i).copied().unwrap_or(DVec3::ZERO) * *factor
            }
            (Motion::Rotate { centre, .. }, Pose::Turn(turn)) => {
                *centre + *turn * (rest + start - *centre) - rest
            }
            _ => start,
        }
    }
}

/// A motion at one time.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Pose {
    /// Value of the curve.
    Factor(f64),
    /// Rotation about the centre.
    Turn(DQuat),
}

impl Constraint {
    /// What is wrong with it in a world of `rows` vertices, if anything.
    pub(crate) fn problem(&self, rows: usize) -> Option<&'static str> {
        if self.rows.iter().any(|&r| r as usize >= rows) {
            return Some("it names a vertex row that does not exist");
        }
        if self.axes.0 > 7 {
            return Some("its axes have other bits than x, y, z (1, 2, 4)");
        }
        if self.from.is_nan() || self.until.is_nan() {
            return Some("its times are not numbers");
        }
        let motion = match &self.motion {
            Motion::Hold => None,
            Motion::Translate(d) => (!d.is_finite()).then_some("its translation is not finite"),
            Motion::TranslateEach(d) if d.len() != self.rows.len() => {
                Some("it needs one translation per vertex")
            }
            Motion::TranslateEach(d) => {
                d.iter().any(|d| !d.is_finite()).then_some("one of its translations is not finite")
            }
            Motion::Rotate { centre, axis, angle } => {
                if !(centre.is_finite() && axis.is_finite() && angle.is_finite()) {
                    Some("its rotation has a number that is not finite")
                } else if axis.try_normalize().is_none() {
                    Some("its axis of rotation has no usable direction")
                } else {
                    None
                }
            }
        };
        motion.or_else(|| self.curve.problem())
    }
}

impl Load {
    /// What is wrong with it in a world of `rows` vertices, if anything.
    pub(crate) fn problem(&self, rows: usize) -> Option<&'static str> {
        if self.forces.iter().any(|&(r, _)| r as usize >= rows) {
            return Some("it names a vertex row that does not exist");
        }
        if self.forces.iter().any(|(_, f)| !f.is_finite()) {
            return Some("one of its forces is not finite");
        }
        self.curve.problem()
    }
}

/// Dead loads: forces (N) on vertex rows, scaled by a curve.
#[derive(Component, Clone, Debug)]
pub struct Load {
    /// Name for reports.
    pub name: String,
    /// Vertex rows and their forces (N).
    pub forces: Vec<(u32, DVec3)>,
    /// Factor on the forces.
    pub curve: Curve,
}

/// Follower pressure: pushes every triangle along its normal with pressure times deformed area. The law
/// that does so has to be activated (`sinew_models::pressure::activate`).
#[derive(Component, Clone, Debug, PartialEq)]
pub struct Pressure {
    /// Name for reports.
    pub name: String,
    /// Vertex rows of the triangles; the pressure pushes along `(x_1 - x_0) x (x_2 - x_0)`. Triangles with
    /// an edge that is in no element carry nothing.
    pub faces: Vec<[u32; 3]>,
    /// Pressure (Pa); negative for suction.
    pub pressure: f64,
    /// Factor on it.
    pub curve: Curve,
}

impl Pressure {
    /// What is wrong with it in a world of `rows` vertices, if anything.
    pub(crate) fn problem(&self, rows: usize) -> Option<&'static str> {
        if self.faces.iter().flatten().any(|&r| r as usize >= rows) {
            return Some("it names a vertex row that does not exist");
        }
        if !self.pressure.is_finite() {
            return Some("its pressure is not finite");
        }
        self.curve.problem()
    }
}

/// Time (s) whose loads the next run of [`ForceSchedule`](crate::schedule::ForceSchedule) takes: the end
/// of the step, unless an integrator cuts it into substeps.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct LoadTime(pub f64);

/// Pressure (Pa) and volume (m^3) swept from rest of every [`Pressure`], in order of entities, at the last
/// evaluation of energy or force.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct SweptVolumes(pub Vec<[f64; 2]>);

impl SweptVolumes {
    /// Work (J) from an earlier evaluation to this one, by the trapezoidal rule.
    pub fn work_since(&self, before: &Self) -> f64 {
        let ways = self.0.iter().zip(&before.0);
        ways.map(|([p, v], [q, w])| 0.5 * (p + q) * (v - w)).sum()
    }
}

/// Writes [`FixedAxes`] and [`PrescribedDisplacement`] for the end of the step.
pub fn apply_constraints<S: Scalar>(
    clock: Res<StepClock>,
    mut constraints: Query<(Entity, &mut Constraint)>,
    mut vertices: Query<(
        &RestPosition,
        &Displacement<S>,
        &mut FixedAxes,
        &mut PrescribedDisplacement<S>,
    )>,
    mut order: Local<Vec<(u64, Entity)>>,
) {
    let t = clock.time + clock.dt;
    let Some((rest, displacement, mut fixed, mut prescribed)) =
        single_table(vertices.contiguous_iter_mut())
    else {
        return;
    };
    let fixed = fixed.bypass_change_detection();
    let prescribed = prescribed.bypass_change_detection();
    fixed.fill(FixedAxes::NONE);
    // where constraints overlap the later one wins, in order of creation
    order.clear();
    order.extend(constraints.iter().map(|(e, c)| (c.sequence, e)));
    order.sort_unstable();
    for &(_, entity) in order.iter() {
        let Ok((_, mut constraint)) = constraints.get_mut(entity) else { continue };
        if !constraint.active(t) {
            continue;
        }
        if constraint.start.len() != constraint.rows.len() {
            constraint.start = constraint
                .rows
                .iter()
                .map(|&r| {
                    let u = displacement[r as usize].0;
                    DVec3::new(u[0].to_f64(), u[1].to_f64(), u[2].to_f64())
                })
                .collect();
        }
        let pose = constraint.pose(t);
        for (i, &row) in constraint.rows.iter().enumerate() {
            let u = constraint.displacement(&pose, i, rest[row as usize].0);
            fixed[row as usize].0 |= constraint.axes.0;
            for k in 0..3 {
                if constraint.axes.holds(k) {
                    prescribed[row as usize].0[k] = S::from_f64(u[k]);
                }
            }
        }
    }
}

/// Writes [`ExternalForce`] and [`LoadTime`] for the end of the step: gravity plus loads.
pub fn apply_loads<S: Scalar>(
    clock: Res<StepClock>,
    gravity: Res<Gravity>,
    loads: Query<(Entity, &Load)>,
    mut time: ResMut<LoadTime>,
    mut vertices: Query<(&Mass<S>, &mut ExternalForce<S>)>,
    mut order: Local<Vec<Entity>>,
) {
    let t = clock.time + clock.dt;
    time.0 = t;
    let Some((mass, mut force)) = single_table(vertices.contiguous_iter_mut()) else { return };
    let force = force.bypass_change_detection();
    let g = gravity.0.to_array().map(S::from_f64);
    for (f, m) in force.iter_mut().zip(mass) {
        f.0 = [m.0 * g[0], m.0 * g[1], m.0 * g[2], S::ZERO];
    }
    order.clear();
    order.extend(loads.iter().map(|(e, _)| e));
    order.sort_unstable();
    for &entity in order.iter() {
        let Ok((_, load)) = loads.get(entity) else { continue };
        let factor = load.curve.value(t);
        for &(row, f) in &load.forces {
            for k in 0..3 {
                force[row as usize].0[k] += S::from_f64(f[k] * factor);
            }
        }
    }
}
