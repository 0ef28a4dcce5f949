//! Tools: rigid shapes that press, drag and grasp bodies, their motion, and what they report.

use crate::edge::{Edge, EdgeState};
use crate::needle::Needle;
use crate::shape::Shape;
use bevy_ecs::prelude::*;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use sinew_engine::load::{Curve, rotation};
use sinew_engine::order::Order;
use sinew_engine::row::VertexRow;

/// Where a tool is: its origin and its rotation in the world, and how far its jaws are open.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ToolPose {
    /// Place (m) of the tool's origin.
    pub position: DVec3,
    /// Rotation of the tool.
    pub rotation: DQuat,
    /// Angle (rad) between its jaws, 0 for tools without.
    pub opening: f64,
}

impl Default for ToolPose {
    fn default() -> Self {
        Self { position: DVec3::ZERO, rotation: DQuat::IDENTITY, opening: 0.0 }
    }
}

impl From<DVec3> for ToolPose {
    fn from(position: DVec3) -> Self {
        Self { position, ..Self::default() }
    }
}

impl ToolPose {
    /// The error in it, if there is one; rotations are normalised.
    fn checked(mut self) -> Result<Self, String> {
        if !(self.position.is_finite() && self.rotation.is_finite() && self.opening.is_finite()) {
            return Err(format!("{self:?} has a number that is not finite"));
        }
        let length = self.rotation.length();
        if !length.is_normal() {
            return Err(format!("{} is no rotation; use DQuat::IDENTITY for none", self.rotation));
        }
        if (length - 1.0).abs() > 1e-12 {
            self.rotation /= length;
        }
        Ok(self)
    }

    /// A pose on the way to another, which is reached evenly; rotations along the shorter arc.
    pub fn towards(&self, to: &Self, part: f64) -> Self {
        if part >= 1.0 {
            return *to;
        }
        Self {
            position: self.position + (to.position - self.position) * part,
            rotation: self.rotation.lerp(to.rotation, part),
            opening: self.opening + (to.opening - self.opening) * part,
        }
    }
}

/// A rigid part of a tool: a solid, or with `cavity` a hollow one round the bodies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Its shape.
    pub shape: Shape,
    /// Place (m) of the shape's centre in the frame of the tool.
    pub at: DVec3,
    /// Rotation of the shape in the frame of the tool.
    pub rotation: DQuat,
    /// The shape is hollow: bodies may not leave its inside, as organs the abdomen. Of several cavities they have to be in all.
    /// A half-space is none.
    pub cavity: bool,
    /// Share of the opening angle by which it turns about the hinge: 0 for a part that is no jaw, 0.5 and -0.5 for
    /// two jaws, 1 for a single one.
    pub jaw: f64,
}

impl From<Shape> for Part {
    fn from(shape: Shape) -> Self {
        Self { shape, at: DVec3::ZERO, rotation: DQuat::IDENTITY, cavity: false, jaw: 0.0 }
    }
}

impl Part {
    /// Signed distance (m) at `y` (m, in the frame of the shape) from where no body may be, negative there, and its
    /// gradient.
    #[inline]
    pub fn distance(&self, y: DVec3) -> (f64, DVec3) {
        let (distance, gradient) = self.shape.distance(y);
        if self.cavity { (-distance, -gradient) } else { (distance, gradient) }
    }

    /// Whether it fills a bounded place: what is neither a cavity, a half-space nor the sides of a blade.
    pub fn is_bounded(&self) -> bool {
        !self.cavity && !matches!(self.shape, Shape::HalfSpace | Shape::Blade { .. })
    }

    /// The axis-parallel box (m) that holds all places where no body may be, when the shape stands at `centre`, turned by
    /// `rotation`; infinite for a cavity and a half-space.
    pub fn bounds(&self, centre: DVec3, rotation: DQuat) -> [DVec3; 2] {
        match self.cavity {
            true => [DVec3::NEG_INFINITY, DVec3::INFINITY],
            false => self.shape.bounds(centre, rotation),
        }
    }

    /// The error in it, if there is one.
    fn problem(&self) -> Option<String> {
        if let Some(problem) = self.shape.problem() {
            return Some(problem);
        }
        if self.cavity && self.shape == Shape::HalfSpace {
            return Some(
                "a half-space has no inside that could be a cavity: turn its normal round instead"
                    .into(),
            );
        }
        if self.cavity && matches!(self.shape, Shape::Blade { .. }) {
            return Some("the sides of a blade have no inside that could be a cavity".into());
        }
        if !(self.at.is_finite() && self.jaw.is_finite()) {
            return Some("its place is not finite".into());
        }
        ((self.rotation.length() - 1.0).abs() > 1e-6 || self.rotation.is_nan())
            .then(|| format!("{} is no rotation of length one", self.rotation))
    }
}

/// The hinge of the jaws, in the frame of the tool.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hinge {
    /// A point on it (m).
    pub point: DVec3,
    /// Its direction, of any length.
    pub axis: DVec3,
}

impl Default for Hinge {
    fn default() -> Self {
        Self { point: DVec3::ZERO, axis: DVec3::Z }
    }
}

/// A pose at a time (s) of a path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathPoint {
    /// Time (s).
    pub time: f64,
    /// Pose at that time.
    pub pose: ToolPose,
}

/// How a tool moves.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum ToolMotion {
    /// It stays, or goes where [`Tool::set_target`] says: there at the end of the next step, evenly through the step.
    #[default]
    Follow,
    /// From pose to pose, evenly between their times; it stays at the last one.
    Path(Vec<PathPoint>),
    /// A translation (m) from its first pose, scaled by a curve.
    Translate(DVec3, Curve),
}

/// The kind of points of a surface that are tested against a tool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Points {
    /// Vertices where the tool is a cavity or thick beside the edges of the surface, else points on faces (default).
    #[default]
    Auto,
    /// Vertices, each with its share in the rest areas of the faces round it.
    Vertex,
    /// The midpoints of `n^2` equal parts of every face. For 2 the Gauss points: three, (2/3, 1/6, 1/6), of a triangle, four
    /// of a face with four corners.
    Faces(u32),
}

/// Most points along an edge.
pub const MOST_POINTS: u32 = 8;

/// Stiffness of contact: pressure over penetration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Stiffness {
    /// Times Young's modulus of the body there over its mean edge. The default is 50: depth and force then differ
    /// from those of exact contact by 0.2 to 4 %.
    Relative(f64),
    /// In Pa/m.
    Absolute(f64),
}

impl Default for Stiffness {
    fn default() -> Self {
        Self::Relative(50.0)
    }
}

impl Stiffness {
    /// What is wrong with it, if anything.
    pub(crate) fn problem(&self) -> Option<String> {
        let (Self::Relative(x) | Self::Absolute(x)) = *self;
        (!(x > 0.0 && x.is_finite()))
            .then(|| format!("its stiffness is {x}: it must be positive and finite"))
    }
}

/// What is wrong with a coefficient of friction, if anything.
pub fn friction_problem(coefficient: f64) -> Option<String> {
    (!(coefficient >= 0.0 && coefficient.is_finite()))
        .then(|| format!("its friction is {coefficient}: the coefficient must be 0 or positive"))
}

/// A tool: an entity that touches the bodies of its world. Its pose comes from its motion; unless a hand holds it by a
/// [spring](Tool::spring), it never feels forces, it reports them.
#[derive(Component, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[require(ToolReport, EdgeState, Order)]
pub struct Tool {
    /// Name for reports and probes.
    pub name: String,
    /// Its rigid parts; a tool with an edge or needle needs none.
    pub parts: Vec<Part>,
    /// Its sharp edge, which cuts what it goes through.
    pub edge: Option<Edge>,
    /// Its needle, which enters what its tip punctures.
    pub needle: Option<Needle>,
    /// Hinge of its jaws.
    pub hinge: Hinge,
    /// Where it stands at first.
    pub start: ToolPose,
    /// How it moves.
    pub motion: ToolMotion,
    /// Coefficient of friction (Coulomb), 0 for none.
    pub friction: f64,
    /// While true, points that touch it do not slip, however little they are pressed: jaws that are closed for good.
    pub grip: bool,
    /// The kind of points that are tested against it.
    pub points: Points,
    /// Stiffness of contact.
    pub stiffness: Stiffness,
    /// No penetration: multipliers are iterated until none is left. For the integrators `newton` and `quasi-static`,
    /// and vertices as points.
    pub exact: bool,
    /// A point that was pushed out through one side stays on it however deep the tool goes (default). Without, it
    /// leaves through the nearest side, as it always does into a cavity.
    pub keeps_side: bool,
    /// Stiffness (N/m) of a spring by which a hand holds the tool. Targets and motion are then those of the hand: the tool turns
    /// and opens with it, and is where the spring and all that it touches are in balance at every state of the bodies. Without,
    /// the hand holds it rigidly. What lets it go suddenly, such as tissue that parts, lets it move back to the hand within a step; one
    /// thinner than that way may pass a surface then. So does an edge or needle move back that leaves tissue. Not for exact contact, a local stiffness
    /// of the tool, and a needle that draws a thread.
    pub spring: Option<f64>,
    /// Also finds the force by points of the other kind ([`ToolReport::other_points`]). It is no bound on the error.
    pub error_bar: bool,
    /// Also finds the change of its force with small motions ([`ToolReport::local_stiffness`]), which devices and rigid
    /// bodies need that go on between two steps. Costs three linear systems a step.
    pub local_stiffness: bool,
    /// Triangles of vertex rows that it touches; all surfaces without.
    pub faces: Option<Vec<[VertexRow; 3]>>,
    /// Time (s) from which it touches.
    pub from: f64,
    /// Time (s) after which it touches no more.
    pub until: f64,
    /// Target set by the program.
    pub(crate) target: Option<ToolPose>,
    /// The target is a place to appear at, not one to move to.
    pub(crate) placed: bool,
}

/// A tool that cannot be used, or a target that it cannot follow.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ToolError {
    /// A size, coefficient or time is unusable.
    #[error("tool `{name}`: {problem}")]
    Invalid {
        /// Tool.
        name: String,
        /// The error, with the value at fault.
        problem: String,
    },
    /// There is no such tool.
    #[error("entity {0} is no tool; use what `add_tool` returned")]
    NoTool(Entity),
}

impl Tool {
    /// A tool of one shape whose centre is at `position` (m), at rest, without friction.
    pub fn new(name: impl Into<String>, shape: Shape, position: DVec3) -> Self {
        Self::of_parts(name, vec![shape.into()], position.into())
    }

    /// A tool of several parts.
    pub fn of_parts(name: impl Into<String>, parts: Vec<Part>, start: ToolPose) -> Self {
        Self {
            name: name.into(),
            parts,
            edge: None,
            needle: None,
            hinge: Hinge::default(),
            start,
            motion: ToolMotion::Follow,
            friction: 0.0,
            grip: false,
            points: Points::Auto,
            stiffness: Stiffness::default(),
            exact: false,
            keeps_side: true,
            spring: None,
            error_bar: false,
            local_stiffness: false,
            faces: None,
            from: f64::NEG_INFINITY,
            until: f64::INFINITY,
            target: None,
            placed: false,
        }
    }

    /// A half-space at rest whose surface goes through `point` (m); `normal`, any length, points out of it.
    pub fn ground(name: impl Into<String>, point: DVec3, normal: DVec3) -> Self {
        let rotation = match normal.try_normalize() {
            Some(normal) => DQuat::from_rotation_arc(DVec3::Z, normal),
            // refused by `problem`
            None => DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
        };
        let start = ToolPose { position: point, rotation, opening: 0.0 };
        Self::of_parts(name, vec![Shape::HalfSpace.into()], start)
    }

    /// A cavity at rest: the inside of a shape whose centre is at `position` (m), which bodies may not leave.
    pub fn cavity(name: impl Into<String>, shape: Shape, position: DVec3) -> Self {
        let part = Part { cavity: true, ..shape.into() };
        Self::of_parts(name, vec![part], position.into())
    }

    /// A blade without thickness at `position` (m): an edge alone, whose sides touch nothing ([`Edge::flanks`] are sides that do).
    pub fn blade(name: impl Into<String>, edge: Edge, position: DVec3) -> Self {
        Self::of_parts(name, Vec::new(), position.into()).with_edge(edge)
    }

    /// With a sharp edge.
    #[must_use]
    pub fn with_edge(mut self, edge: Edge) -> Self {
        self.edge = Some(edge);
        self
    }

    /// A needle alone at `position` (m), whose shaft touches nothing but what it goes through.
    pub fn needle(name: impl Into<String>, needle: Needle, position: DVec3) -> Self {
        Self::of_parts(name, Vec::new(), position.into()).with_needle(needle)
    }

    /// With a needle.
    #[must_use]
    pub fn with_needle(mut self, needle: Needle) -> Self {
        self.needle = Some(needle);
        self
    }

    /// With a coefficient of friction.
    #[must_use]
    pub fn with_friction(mut self, coefficient: f64) -> Self {
        self.friction = coefficient;
        self
    }

    /// With points of a given kind.
    #[must_use]
    pub fn with_points(mut self, points: Points) -> Self {
        self.points = points;
        self
    }

    /// Without penetration ([`Tool::exact`]).
    #[must_use]
    pub fn exactly(mut self) -> Self {
        (self.exact, self.points) = (true, Points::Vertex);
        self
    }

    /// On a spring of some stiffness (N/m) in a hand ([`Tool::spring`]).
    #[must_use]
    pub fn with_spring(mut self, stiffness: f64) -> Self {
        self.spring = Some(stiffness);
        self
    }

    /// Target set by the program, and whether it is a place to appear at.
    pub fn target(&self) -> (Option<ToolPose>, bool) {
        (self.target, self.placed)
    }

    /// Restores the result of [`Tool::target`].
    pub fn aim(&mut self, target: Option<ToolPose>, placed: bool) {
        (self.target, self.placed) = (target, placed);
    }

    /// Moves the tool: it is there at the end of the next step, evenly through the step, and stays there until
    /// another target is set. Its speed is the way over the length of the step.
    ///
    /// # Errors
    /// When the pose is not finite or no rotation, or the tool has a motion of its own.
    pub fn set_target(&mut self, pose: impl Into<ToolPose>) -> Result<(), ToolError> {
        self.set(pose.into(), false)
    }

    /// Puts the tool somewhere else at once, without touching anything on the way. Where it then reaches into a body, it
    /// is drawn in, and a cavity is widened to what is outside of it. It grows again by 0.1 m/s, at most half a mean edge a
    /// step. That speed is the same for a body of any size: how hard the body is pushed meanwhile depends on its size in
    /// metres.
    ///
    /// # Errors
    /// As [`Tool::set_target`].
    pub fn place(&mut self, pose: impl Into<ToolPose>) -> Result<(), ToolError> {
        self.set(pose.into(), true)
    }

    fn set(&mut self, pose: ToolPose, placed: bool) -> Result<(), ToolError> {
        let invalid = |name: &String, problem| ToolError::Invalid { name: name.clone(), problem };
        if self.motion != ToolMotion::Follow {
            let problem = "it moves by a path or curve of its own and cannot be given targets";
            return Err(invalid(&self.name, problem.into()));
        }
        let pose = pose.checked().map_err(|p| invalid(&self.name, format!("target: {p}")))?;
        self.target = Some(pose);
        self.placed |= placed;
        Ok(())
    }

    /// Whether it touches at a time (s).
    pub fn active(&self, t: f64) -> bool {
        t >= self.from && t <= self.until
    }

    /// The error in it in a world of `rows` vertices, if there is one.
    pub fn problem(&self, rows: usize) -> Option<String> {
        match (self.edge, self.needle) {
            (None, None) if self.parts.is_empty() => {
                return Some("it has no parts, no edge and no needle".into());
            }
            (Some(_), Some(_)) => {
                return Some("it has an edge and a needle: make them two tools".into());
            }
            _ => {}
        }
        if let Some(problem) = self.needle.as_ref().and_then(Needle::problem) {
            return Some(problem);
        }
        if let Some(problem) = self.edge.as_ref().and_then(Edge::problem) {
            return Some(problem);
        }
        let travels = self.edge.is_some_and(|edge| edge.travel != DVec3::ZERO);
        if travels && !(self.start.opening > 0.0 && self.edge.is_some_and(|e| e.travel.is_finite()))
        {
            return Some(
                "an edge that travels while jaws close needs an opening above 0 at first, and a way that is finite".into(),
            );
        }
        for (i, part) in self.parts.iter().enumerate() {
            let of = |problem: String| {
                if self.parts.len() == 1 { problem } else { format!("part {i}: {problem}") }
            };
            if let Some(problem) = part.problem() {
                return Some(of(problem));
            }
            if part.jaw != 0.0
                && !(self.hinge.point.is_finite() && self.hinge.axis.try_normalize().is_some())
            {
                return Some("the axis of its hinge has no usable direction".into());
            }
        }
        if let Err(problem) = self.start.checked() {
            return Some(problem);
        }
        if let Some(problem) = friction_problem(self.friction) {
            return Some(problem);
        }
        if let Points::Faces(n) = self.points
            && !(2..=MOST_POINTS).contains(&n)
        {
            return Some(format!("its points are faces({n}): 2 to {MOST_POINTS} can be had"));
        }
        if self.exact && self.points != Points::Vertex {
            return Some(
                "exact contact needs points = \"vertex\": points on faces would hold more than the \
                 surface can move"
                    .into(),
            );
        }
        if self.exact && self.friction > 0.0 {
            return Some("exact contact has no friction; leave one of the two out".into());
        }
        if self.from.is_nan() || self.until.is_nan() {
            return Some("its times are not numbers".into());
        }
        let faces = self.faces.iter().flatten().flatten();
        if faces.into_iter().any(|row| row.index() >= rows) {
            return Some("it names a vertex row that does not exist".into());
        }
        self.stiffness.problem().or_else(|| self.spring_problem()).or_else(|| self.motion_problem())
    }

    fn spring_problem(&self) -> Option<String> {
        let spring = self.spring?;
        if !(spring > 0.0 && spring.is_finite()) {
            return Some(format!("its spring is {spring} N/m: it must be positive and finite"));
        }
        let has =
            [(self.exact, "exact contact"), (self.local_stiffness, "a local stiffness of its own")];
        let (_, what) = has.into_iter().find(|(has, _)| *has)?;
        Some(format!("a tool with {what} cannot be held by a spring; leave one of the two out"))
    }

    fn motion_problem(&self) -> Option<String> {
        match &self.motion {
            ToolMotion::Follow => None,
            ToolMotion::Path(points) => {
                if points.is_empty() {
                    return Some("its path has no poses".into());
                }
                if points.windows(2).any(|p| p[0].time >= p[1].time) {
                    return Some("the times of its path do not ascend".into());
                }
                points.iter().find_map(|p| {
                    let finite = p.time.is_finite().then_some(()).ok_or("a time is not finite");
                    finite.map_err(String::from).and_then(|()| p.pose.checked().map(|_| ())).err()
                })
            }
            ToolMotion::Translate(by, curve) => {
                let curve = curve.problem().map(String::from);
                (!by.is_finite()).then(|| "its translation is not finite".into()).or(curve)
            }
        }
    }

    /// The pose that its motion asks for at a time (s); `now` is its present pose.
    pub fn wanted(&self, t: f64, now: ToolPose) -> ToolPose {
        match &self.motion {
            ToolMotion::Follow => self.target.unwrap_or(now),
            ToolMotion::Path(points) => {
                let after = points.partition_point(|p| p.time <= t);
                match (points.get(after.wrapping_sub(1)), points.get(after)) {
                    (Some(a), Some(b)) => a.pose.towards(&b.pose, (t - a.time) / (b.time - a.time)),
                    (Some(a), None) | (None, Some(a)) => a.pose,
                    (None, None) => now,
                }
            }
            ToolMotion::Translate(by, curve) => {
                let position = self.start.position + *by * curve.value(t);
                ToolPose { position, ..self.start }
            }
        }
    }

    /// Centre (m) and rotation of a part when the tool stands at `pose`.
    pub fn part_pose(&self, part: usize, pose: &ToolPose) -> (DVec3, DQuat) {
        let part = &self.parts[part];
        let (mut at, mut turn) = (part.at, part.rotation);
        if part.jaw != 0.0 {
            let axis = self.hinge.axis.normalize();
            let jaw = rotation(axis, part.jaw * pose.opening);
            at = self.hinge.point + jaw * (at - self.hinge.point);
            turn = jaw * turn;
        }
        (pose.position + pose.rotation * at, pose.rotation * turn)
    }
}

/// Forces on a tool and its contacts at the end of the last step.
#[derive(Component, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ToolReport {
    /// Where the tool was: place (m) of its origin.
    pub position: DVec3,
    /// Way (m) from where the hand would have it to there, of a tool on a spring.
    pub yields: DVec3,
    /// Its rotation.
    pub rotation: DQuat,
    /// Its opening (rad).
    pub opening: f64,
    /// Velocity (m/s) of its origin.
    pub velocity: DVec3,
    /// Angular velocity (rad/s).
    pub angular_velocity: DVec3,
    /// Force (N) on the tool: normal, friction, of what it cuts, and of the thread that its needle draws.
    pub force: DVec3,
    /// Torque (N m) on the tool about its origin.
    pub torque: DVec3,
    /// Torque (N m) about the hinge with which tissue holds its jaws open: the energy per angle (rad) that closing them takes.
    pub closing: f64,
    /// The part of the force that pressure makes (N).
    pub normal: DVec3,
    /// The part of the force that friction makes (N).
    pub friction: DVec3,
    /// Work (J) done by the tool on bodies since it came, by the force at the end of every step. That on the thread of its needle
    /// is in the report of the thread.
    pub work: f64,
    /// Energy (J) that friction has taken since it came.
    pub dissipation: f64,
    /// Energy (J) stored in its contacts: penetration and sticking.
    pub energy: f64,
    /// Area (m^2, at rest) that touches it.
    pub area: f64,
    /// Largest penetration (m).
    pub depth: f64,
    /// Largest pressure (Pa).
    pub pressure: f64,
    /// Centre of pressure (m); its origin while nothing touches it.
    pub centre: DVec3,
    /// Points that touch it and stick.
    pub sticking: u32,
    /// Points that touch it and slip.
    pub slipping: u32,
    /// Distance (m) to its target, where its way was longer than the substeps of a step can follow.
    pub lag: f64,
    /// How far (m) the surfaces of its shapes are drawn in, because it appeared partly inside of a body; of a cavity how
    /// far they are widened, because it appeared with tissue outside. A tool wholly inside touches nothing, and is counted
    /// as buried.
    pub drawn_in: f64,
    /// A part of it went through the surface of a body, and touches nothing of that body until it is out.
    pub pierced: bool,
    /// Force (N) by points of the other kind at the same state, if [`Tool::error_bar`] asks for it. It is no estimate of the
    /// error: these points have not pushed the tissue away, so it may be several times what they give in a run of their
    /// own.
    pub other_points: Option<DVec3>,
    /// Change of its force (N) per motion (m) of its pose at the end of the step, with the tissue moving along within
    /// the step, if [`Tool::local_stiffness`] asks for it of an implicit integrator: the force is about `force +
    /// local_stiffness * way`. Symmetric; limits of friction as they are. Exact for `newton`, to the tolerance of the
    /// linear solver.
    pub local_stiffness: Option<DMat3>,
    /// Whether the step that these forces are of did not converge: they are not to be relied on.
    pub unconverged: bool,
    /// Area (m^2, in the shapes of the steps) that its edge swept through tissue against its toughness since it came.
    pub cut_area: f64,
    /// Energy (J) that this took, or the tip of its needle.
    pub fracture: f64,
    /// Elements that its edge parted since it came.
    pub separated: u32,
    /// Vertices that this made.
    pub cut_vertices: u32,
    /// Length (m) of its needle in tissue.
    pub inserted: f64,
    /// Force (N) of the tissue on the tip of its needle, against the direction of the tip.
    pub tip_force: f64,
    /// Force (N) of the channel along the shaft, positive where it holds the needle back from going in.
    pub shaft_force: f64,
    /// Surfaces that gave way to its needle since it came.
    pub punctures: u32,
    /// Forces on each part, in their order; empty for a tool of one part.
    pub parts: Vec<PartReport>,
}

/// Forces on one part of a tool, such as one of two jaws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PartReport {
    /// Force (N) on it, normal and friction.
    pub force: DVec3,
    /// Torque (N m) on it about the tool's origin.
    pub torque: DVec3,
    /// Largest penetration (m).
    pub depth: f64,
    /// Points that touch it and stick.
    pub sticking: u32,
    /// Points that touch it and slip.
    pub slipping: u32,
}
