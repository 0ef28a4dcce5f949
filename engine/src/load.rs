//! Constraints and loads: entities of their own that name vertex rows, with a time curve.
//! [`StepSystems::Prepare`](crate::schedule::StepSystems::Prepare) turns them into the vertex
//! columns [`FixedAxes`], [`PrescribedDisplacement`] and [`ExternalForce`].

use crate::columns::single_table;
use crate::order::Order;
use crate::row::VertexRow;
use crate::scalar::Scalar;
use crate::time::{Gravity, StepClock, StepPart};
use crate::vertex::{
    Displacement, ExternalForce, FixedAxes, Mass, PrescribedDisplacement, RestPosition, WeightShift,
};
use bevy_ecs::prelude::*;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

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

    /// Largest change within a window of `dt` (s), between `from` and `until` (s).
    ///
    /// ```
    /// # use sinew_engine::load::Curve;
    /// assert_eq!(Curve::ramp(1.0, 3.0).largest_change(0.5, 0.0, 9.0), 0.25);
    /// assert_eq!(Curve::ramp(1.0, 1.1).largest_change(0.5, 0.0, 9.0), 1.0);
    /// ```
    pub fn largest_change(&self, dt: f64, from: f64, until: f64) -> f64 {
        let change = |t: f64| (self.value((t + dt).min(until)) - self.value(t)).abs();
        match self {
            Self::Constant => 0.0,
            // pieces are straight: the largest change begins or ends at a point
            Self::Points(points) => points
                .iter()
                .flat_map(|p| [p[0], p[0] - dt])
                .map(|t| change(t.max(from).min(until)))
                .fold(0.0, f64::max),
            Self::Sine { frequency, .. } => {
                let quarter = (frequency * dt).abs().min(0.5) * std::f64::consts::PI;
                2.0 * libm::sin(quarter)
            }
        }
    }

    /// What is wrong with it, if anything.
    pub fn problem(&self) -> Option<&'static str> {
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
                libm::sin(std::f64::consts::TAU * frequency * t + phase)
            }
        }
    }
}

/// Where constrained vertices go, relative to where they were when the constraint took hold; the
/// curve scales it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Where [`Constraint::set_target`] says, whatever the curve.
    Follow(Box<TargetPath>),
}

/// Rigid motion of held vertices, relative to where they were when their constraint took hold: turned
/// about a centre, then shifted. A vector is a translation (m) alone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Translation (m).
    pub translation: DVec3,
    /// Rotation about the centre.
    pub rotation: DQuat,
    /// Point (m) that the rotation leaves in place.
    pub centre: DVec3,
}

impl Pose {
    /// Nothing moved.
    pub const IDENTITY: Self =
        Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, centre: DVec3::ZERO };

    /// Way (m) of a point.
    pub fn way(&self, point: DVec3) -> DVec3 {
        let arm = point - self.centre;
        self.rotation * arm - arm + self.translation
    }

    /// A pose on the way to another: translation and rotation about the other's centre pass evenly.
    fn towards(&self, to: &Self, part: f64) -> Self {
        if part >= 1.0 {
            return *to;
        }
        let start = self.way(to.centre);
        Self {
            translation: start + (to.translation - start) * part,
            rotation: self.rotation.lerp(to.rotation, part),
            centre: to.centre,
        }
    }
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl From<DVec3> for Pose {
    fn from(translation: DVec3) -> Self {
        Self { translation, ..Self::IDENTITY }
    }
}

/// Path of a constraint through the step being made, to the target that the host set last.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TargetPath {
    /// Target of the next step.
    target: Pose,
    /// Poses at the start and at the end of the step.
    ends: [Pose; 2],
    /// Time (s) at the start of the step, and its length (s).
    span: [f64; 2],
    /// Pose at the start of the whole step, if it is made in parts.
    start: Pose,
    /// Number of the step.
    step: u64,
}

impl TargetPath {
    /// Target of the next step.
    pub fn target(&self) -> Pose {
        self.target
    }

    /// Leads from where the last step ended to the target. A step that failed is made again from its start.
    fn prepare(&mut self, clock: &StepClock, part: StepPart) {
        if self.step != clock.step {
            self.start = self.ends[1];
        }
        self.ends[0] = if part.index == 0 { self.start } else { self.ends[1] };
        self.ends[1] = self.ends[0].towards(&self.target, part.share_of_rest());
        self.span = [clock.time, clock.dt];
        self.step = clock.step;
    }

    fn pose(&self, t: f64) -> Pose {
        let [start, dt] = self.span;
        self.ends[0].towards(&self.ends[1], if t < start + dt { (t - start) / dt } else { 1.0 })
    }
}

/// A target that a constraint cannot follow; what it followed before stays.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TargetError {
    /// A number is not finite.
    #[error("target of constraint `{name}`: {pose:?} has a number that is not finite")]
    NotFinite {
        /// Constraint.
        name: String,
        /// Offending value.
        pose: Pose,
    },
    /// The quaternion has no direction.
    #[error(
        "target of constraint `{name}`: rotation {rotation} is no rotation; use DQuat::IDENTITY for none"
    )]
    Rotation {
        /// Constraint.
        name: String,
        /// Offending value.
        rotation: DQuat,
    },
    /// The constraint has a motion of its own.
    #[error(
        "constraint `{name}` moves by a curve of its own and cannot be given targets; make it with \
         `Constraint::hold`"
    )]
    OwnMotion {
        /// Constraint.
        name: String,
    },
    /// There is no such constraint.
    #[error("entity {0} is no constraint; use what `add_constraint` returned")]
    NoConstraint(Entity),
}

/// Holds or moves vertices while it is active. Where constraints overlap, the one that came into the world last wins.
#[derive(Component, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[require(Order)]
pub struct Constraint {
    /// Name for reports and probes.
    pub name: String,
    /// Vertex rows.
    pub rows: Vec<VertexRow>,
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
}

impl Constraint {
    /// Holds `rows` where they are, for good.
    pub fn hold(name: impl Into<String>, rows: Vec<VertexRow>) -> Self {
        Self::moving(name, rows, Motion::Hold, Curve::Constant)
    }

    /// Moves `rows`, for good.
    pub fn moving(
        name: impl Into<String>,
        rows: Vec<VertexRow>,
        motion: Motion,
        curve: Curve,
    ) -> Self {
        Self {
            name: name.into(),
            rows,
            axes: FixedAxes::ALL,
            motion,
            curve,
            from: f64::NEG_INFINITY,
            until: f64::INFINITY,
            start: Vec::new(),
        }
    }

    /// Moves the held vertices: they reach the pose at the end of the next step, evenly through the step,
    /// and stay there until another target is set. For what is not known beforehand, such as a tool in a
    /// hand: set the target before every step.
    ///
    /// # Errors
    /// When the pose is not finite or not a rotation, or the constraint has a [`Motion`] of its own.
    ///
    /// ```
    /// use bevy_ecs::prelude::*;
    /// use sinew_engine::load::{Constraint, Pose};
    /// use sinew_engine::row::VertexRow;
    /// use glam::{DQuat, DVec3};
    ///
    /// let mut tool = Constraint::hold("tool", (0..3).map(VertexRow).collect());
    /// tool.set_target(DVec3::new(0.0, 0.0, 0.01))?;
    /// let jaw = DVec3::new(0.1, 0.0, 0.05);
    /// tool.set_target(Pose { rotation: DQuat::from_rotation_x(0.2), centre: jaw, ..Pose::IDENTITY })?;
    /// assert!(tool.set_target(DVec3::NAN).unwrap_err().to_string().contains("`tool`"));
    /// # Ok::<(), sinew_engine::load::TargetError>(())
    /// ```
    pub fn set_target(&mut self, pose: impl Into<Pose>) -> Result<(), TargetError> {
        let mut pose: Pose = pose.into();
        let name = || self.name.clone();
        if !(pose.translation.is_finite() && pose.rotation.is_finite() && pose.centre.is_finite()) {
            return Err(TargetError::NotFinite { name: name(), pose });
        }
        let length = pose.rotation.length();
        if !(length.is_normal()) {
            return Err(TargetError::Rotation { name: name(), rotation: pose.rotation });
        }
        pose.rotation /= length;
        match &mut self.motion {
            Motion::Follow(path) => path.target = pose,
            Motion::Hold => {
                let path = TargetPath { target: pose, ..Default::default() };
                self.motion = Motion::Follow(Box::new(path));
            }
            _ => return Err(TargetError::OwnMotion { name: name() }),
        }
        Ok(())
    }

    /// Whether it moves its vertices between the times `from` and `to` (s) of the step being made, other
    /// than by a jump.
    pub(crate) fn moves(&self, from: f64, to: f64) -> bool {
        match &self.motion {
            Motion::Hold => false,
            Motion::Follow(path) => path.ends[0] != path.ends[1],
            _ => self.curve.varies(from, to) && !self.curve.jumps(from, to),
        }
    }

    /// Whether it acts on a step that ends at `t` (s).
    pub fn active(&self, t: f64) -> bool {
        t >= self.from && t <= self.until
    }

    /// The motion at a time (s).
    pub(crate) fn at(&self, t: f64) -> MotionAt {
        let factor = self.curve.value(t);
        match &self.motion {
            Motion::Rotate { axis, angle, .. } => {
                MotionAt::Turn(rotation(axis.normalize(), angle * factor))
            }
            Motion::Follow(path) => MotionAt::Pose(path.pose(t)),
            _ => MotionAt::Factor(factor),
        }
    }

    /// Displacement (m) of its vertex `i`, which rests at `rest` (m).
    pub(crate) fn displacement(&self, at: &MotionAt, i: usize, rest: DVec3) -> DVec3 {
        let start = self.start[i];
        match (&self.motion, at) {
            (Motion::Translate(d), MotionAt::Factor(factor)) => start + *d * *factor,
            (Motion::TranslateEach(d), MotionAt::Factor(factor)) => {
                start + d.get(i).copied().unwrap_or(DVec3::ZERO) * *factor
            }
            (Motion::Rotate { centre, .. }, MotionAt::Turn(turn)) => {
                *centre + *turn * (rest + start - *centre) - rest
            }
            (_, MotionAt::Pose(pose)) => start + pose.way(rest + start),
            _ => start,
        }
    }
}

/// Rotation about a unit vector by an angle (rad). That of glam takes sine and cosine from the platform,
/// which rounds them its own way; this one gives the same bits everywhere.
pub fn rotation(axis: DVec3, angle: f64) -> DQuat {
    let (sin, cos) = libm::sincos(0.5 * angle);
    let DVec3 { x, y, z } = axis * sin;
    DQuat::from_xyzw(x, y, z, cos)
}

/// A motion at one time.
#[derive(Clone, Copy, Debug)]
pub(crate) enum MotionAt {
    /// Value of the curve.
    Factor(f64),
    /// Rotation about the centre.
    Turn(DQuat),
    /// Pose on the way to a target.
    Pose(Pose),
}

impl Constraint {
    /// What is wrong with it in a world of `rows` vertices, if anything.
    pub(crate) fn problem(&self, rows: usize) -> Option<&'static str> {
        if self.rows.iter().any(|r| r.index() >= rows) {
            return Some("it names a vertex row that does not exist");
        }
        if self.axes.0 > 7 {
            return Some("its axes have other bits than x, y, z (1, 2, 4)");
        }
        if self.from.is_nan() || self.until.is_nan() {
            return Some("its times are not numbers");
        }
        let motion = match &self.motion {
            Motion::Hold | Motion::Follow(_) => None,
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
        if self.forces.iter().any(|(r, _)| r.index() >= rows) {
            return Some("it names a vertex row that does not exist");
        }
        if self.forces.iter().any(|(_, f)| !f.is_finite()) {
            return Some("one of its forces is not finite");
        }
        self.curve.problem()
    }
}

/// Dead loads: forces (N) on vertex rows, scaled by a curve.
#[derive(Component, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[require(Order)]
pub struct Load {
    /// Name for reports.
    pub name: String,
    /// Vertex rows and their forces (N).
    pub forces: Vec<(VertexRow, DVec3)>,
    /// Factor on the forces.
    pub curve: Curve,
}

/// Faces under tractions that keep their direction, on the entity of the [`Load`] whose forces are what they add up to. A
/// face that loses its last element leaves the list, and its forces the load.
#[derive(Component, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LoadedFaces(pub Vec<LoadedFace>);

/// A face, or an edge at the rim of a membrane, under a traction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadedFace {
    /// Three vertices of the element that bears it, of which the face is made or to which the edge belongs.
    pub corners: [VertexRow; 3],
    /// What its vertices get (N): traction times the integral of their shape functions at rest.
    pub forces: Vec<(VertexRow, DVec3)>,
}

impl LoadedFaces {
    /// Forces (N) of all faces, rows ascending. They are added up in the order of the faces.
    pub fn forces(&self) -> Vec<(VertexRow, DVec3)> {
        let mut all: Vec<_> = self.0.iter().flat_map(|face| face.forces.iter().copied()).collect();
        all.sort_by_key(|(row, _)| *row);
        all.dedup_by(|next, sum| {
            let same = next.0 == sum.0;
            if same {
                sum.1 += next.1;
            }
            same
        });
        all
    }
}

/// Follower pressure: pushes every triangle along its normal with pressure times deformed area. The law
/// that does so has to be activated (`sinew_models::laws::pressure::activate`).
#[derive(Component, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[require(Order)]
pub struct Pressure {
    /// Name for reports.
    pub name: String,
    /// Vertex rows of the triangles; the pressure pushes along `(x_1 - x_0) x (x_2 - x_0)`. Triangles with
    /// an edge that is in no element carry nothing. Those between vertices of the face of a ten-node tetrahedron stand for what
    /// they cover of that curved face: three corners for all of it; those of linear tetrahedra that a cut parted for what is left.
    pub faces: Vec<[VertexRow; 3]>,
    /// Pressure (Pa); negative for suction.
    pub pressure: f64,
    /// Factor on it.
    pub curve: Curve,
}

impl Pressure {
    /// What is wrong with it in a world of `rows` vertices, if anything.
    pub(crate) fn problem(&self, rows: usize) -> Option<&'static str> {
        if self.faces.iter().flatten().any(|r| r.index() >= rows) {
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
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LoadTime(pub f64);

/// Pressure (Pa) and volume (m^3) swept from rest of every [`Pressure`], in their [`Order`], at the last
/// evaluation of energy or force.
#[derive(Resource, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SweptVolumes(pub Vec<[f64; 2]>);

/// Rest area of the faces of every [`Pressure`] times the extent of their body (m^3), in their [`Order`]: what the volumes that
/// they sweep are measured by.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct PressureReach(pub Vec<f64>);

impl SweptVolumes {
    /// Places of the pressures that swept more than their reach, or no number.
    pub fn beyond(&self, PressureReach(reach): &PressureReach) -> Vec<usize> {
        let both = self.0.iter().zip(reach).enumerate();
        let within = |([_, volume], reach): ([f64; 2], f64)| volume.abs() <= reach;
        let far = both.filter(|(_, (own, reach))| !within((**own, **reach)));
        far.map(|(place, _)| place).collect()
    }

    /// Work (J) from an earlier evaluation to this one, by the trapezoidal rule.
    pub fn work_since(&self, before: &Self) -> f64 {
        let ways = self.0.iter().zip(&before.0);
        ways.map(|([p, v], [q, w])| 0.5 * (p + q) * (v - w)).sum()
    }
}

/// Writes [`FixedAxes`] and [`PrescribedDisplacement`] for the end of the step.
pub fn apply_constraints<S: Scalar>(
    (clock, part): (Res<StepClock>, Option<Res<StepPart>>),
    mut constraints: Query<(Entity, &Order, &mut Constraint)>,
    mut vertices: Query<(
        &RestPosition,
        &Displacement<S>,
        &mut FixedAxes,
        &mut PrescribedDisplacement<S>,
    )>,
    mut order: Local<Vec<(Order, Entity)>>,
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
    // where constraints overlap the later one wins
    order.clear();
    order.extend(constraints.iter().map(|(e, order, _)| (*order, e)));
    order.sort_unstable();
    for &(_, entity) in order.iter() {
        let Ok((.., mut constraint)) = constraints.get_mut(entity) else { continue };
        if !constraint.active(t) {
            continue;
        }
        if constraint.start.len() != constraint.rows.len() {
            constraint.start =
                constraint.rows.iter().map(|&r| displacement[r.index()].get()).collect();
        }
        if let Motion::Follow(path) = &mut constraint.motion {
            path.prepare(&clock, part.as_deref().copied().unwrap_or_default());
        }
        let at = constraint.at(t);
        for (i, &row) in constraint.rows.iter().enumerate() {
            let u = constraint.displacement(&at, i, rest[row.index()].0);
            fixed[row.index()].0 |= constraint.axes.0;
            for k in 0..3 {
                if constraint.axes.holds(k) {
                    prescribed[row.index()].0[k] = S::from_f64(u[k]);
                }
            }
        }
    }
}

/// Writes [`ExternalForce`] and [`LoadTime`] for the end of the step: gravity plus loads.
pub fn apply_loads<S: Scalar>(
    clock: Res<StepClock>,
    gravity: Res<Gravity>,
    loads: Query<(Entity, &Order, &Load)>,
    mut time: ResMut<LoadTime>,
    mut vertices: Query<(&Mass<S>, &WeightShift<S>, &mut ExternalForce<S>)>,
    mut order: Local<Vec<(Order, Entity)>>,
) {
    let t = clock.time + clock.dt;
    time.0 = t;
    let Some((mass, shift, mut force)) = single_table(vertices.contiguous_iter_mut()) else {
        return;
    };
    let force = force.bypass_change_detection();
    let g = gravity.0.to_array().map(S::from_f64);
    for ((f, m), shift) in force.iter_mut().zip(mass).zip(shift) {
        let m = m.0 + shift.0;
        f.0 = [m * g[0], m * g[1], m * g[2], S::ZERO];
    }
    order.clear();
    order.extend(loads.iter().map(|(e, order, _)| (*order, e)));
    order.sort_unstable();
    for &(_, entity) in order.iter() {
        let Ok((.., load)) = loads.get(entity) else { continue };
        let factor = load.curve.value(t);
        for &(row, f) in &load.forces {
            force[row.index()] += f * factor;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_leads_evenly_from_pose_to_pose() {
        let turned = |angle, axis: DVec3, centre| Pose {
            translation: DVec3::new(0.1, -0.2, 0.3),
            rotation: DQuat::from_axis_angle(axis.normalize(), angle),
            centre,
        };
        // another centre: the same motion from the same places
        let from = turned(0.4, DVec3::new(1.0, 2.0, 3.0), DVec3::X);
        let to = turned(-0.3, DVec3::new(3.0, 0.0, -1.0), DVec3::new(0.0, 2.0, 1.0));
        let points = [DVec3::ZERO, DVec3::ONE, DVec3::new(0.3, -4.0, 2.0)];
        for point in points {
            assert!(from.towards(&to, 0.0).way(point).distance(from.way(point)) < 1e-14);
            assert_eq!(from.towards(&to, 1.0).way(point), to.way(point));
        }
        let half = from.towards(&to, 0.5).rotation;
        assert!((half.angle_between(from.rotation) - half.angle_between(to.rotation)).abs() < 1e-7);
        // a translation alone passes along a line, exactly to its ends
        let line = Pose::IDENTITY.towards(&DVec3::new(0.1, 0.2, 0.3).into(), 0.25);
        assert_eq!(line.way(DVec3::splat(7.0)), DVec3::new(0.025, 0.05, 0.3 * 0.25));
    }

    #[test]
    fn a_path_goes_on_from_the_last_step_that_was_made() {
        let mut path = TargetPath { target: DVec3::X.into(), ..Default::default() };
        let mut clock = StepClock { dt: 0.5, ..Default::default() };
        path.prepare(&clock, StepPart::default());
        assert_eq!(path.pose(0.25).translation, 0.5 * DVec3::X);
        // that step failed; the next attempt is half as long
        clock.dt = 0.25;
        path.prepare(&clock, StepPart::default());
        assert_eq!(path.pose(0.125).translation, 0.5 * DVec3::X);
        assert_eq!(path.pose(0.25).translation, DVec3::X);
        clock = StepClock { dt: 0.25, time: 0.25, step: 1 };
        path.target = (3.0 * DVec3::X).into();
        path.prepare(&clock, StepPart::default());
        assert_eq!(path.pose(0.25).translation, DVec3::X);
        assert_eq!(path.pose(0.375).translation, 2.0 * DVec3::X);
    }
}
