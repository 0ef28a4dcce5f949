//! One point of contact: its law, with derivatives.
//!
//! Pressure `p = k <-g>` on the rest area `A` of the point, a potential in the signed distance `g`; friction as a
//! spring with memory whose force is capped at the limit of the last iterate (Coulomb), a potential too within the
//! step, so that line search and energy cap stay valid (Simo & Laursen 1992 integrate friction alike):
//!
//! * normal: `A k <-g>^2 / 2`, force `A p n`, tangent `A k n n^T`. What the curvature of the tool adds is left out: it
//!   is small beside, and negative but for cavities. Behind an edge or vertex of another body the tangent is exact:
//!   `A k (1 - t t^T)`, `t` along the edge, and `A k 1`.
//! * friction: slip `t = P (e + x - x_tool)` since the point began to stick, `P` the projection on the tangent plane,
//!   `l = |t|`, `A s l^2 / 2` while `s l` is below the limit `f p` (`f`: friction), else `A (f p l - (f p)^2 / (2 s))`. `s` is
//!   `k`, and a tenth of it between bodies: points then need not stick harder than the tissue under them.

use crate::beside::{Beside, NearFaces, Rim, beside};
use crate::limits::Limits;
use crate::needle::NeedleNow;
use crate::skin::{grown, overlap};
use crate::tool::Part;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use sinew_engine::order::Order;
use sinew_engine::row::VertexRow;

/// Stands in a [`Key`] where there is no vertex.
pub(crate) const NO_ROW: VertexRow = VertexRow(u32::MAX);

/// Identity of a point from step to step: the owner of the contact, its part, and the point of the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct PointKey {
    /// Index of the body whose surface the point is on.
    pub body: u32,
    /// Tool, pair or pull.
    pub owner: Order,
    /// Part of a tool, direction of a pair.
    pub part: u32,
    /// Vertex row and twice [`NO_ROW`], or vertex rows of a face.
    pub rows: [VertexRow; 3],
    /// Number of the point in the face.
    pub number: u32,
}

impl PointKey {
    /// Of a vertex row.
    pub fn of_vertex(body: u32, owner: Order, part: u32, row: VertexRow) -> Self {
        Self { body, owner, part, rows: [row, NO_ROW, NO_ROW], number: 0 }
    }
}

/// State of a point in contact that is kept from step to step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct PointMemory {
    /// Elastic slip (m) in the world.
    pub slip: DVec3,
    /// Unit normal, from tool to tissue; zero for points that are near but do not touch.
    pub normal: DVec3,
    /// Pressure (Pa).
    pub pressure: f64,
    /// The grip holds it, whatever the pressure, until the jaws open.
    pub gripped: bool,
    /// Side (1 or -1) of a membrane on which a point of another surface is, 0 unknown.
    pub side: f64,
}

/// A rigid motion: centre and rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RigidPose {
    pub centre: DVec3,
    pub rotation: DQuat,
}

impl RigidPose {
    /// Place in the pose `to` of the point of the rigid body that is at `x` in this pose.
    pub fn carry(&self, x: DVec3, to: &Self) -> DVec3 {
        to.centre + to.rotation * (self.rotation.inverse() * (x - self.centre))
    }

    /// A direction of the rigid body, turned from this pose to the pose `to`.
    pub fn turn(&self, d: DVec3, to: &Self) -> DVec3 {
        to.rotation * (self.rotation.inverse() * d)
    }

    /// A pose between this one and another, reached evenly.
    pub fn towards(&self, to: &Self, part: f64) -> Self {
        if part >= 1.0 {
            return *to;
        }
        Self {
            centre: self.centre + (to.centre - self.centre) * part,
            rotation: self.rotation.lerp(to.rotation, part),
        }
    }
}

/// The other side of a contact.
#[derive(Clone, Debug)]
pub(crate) enum Against {
    /// Part of a tool: index into the parts.
    Part(usize),
    /// Faces of a body, turned towards the point: range of the list of faces.
    Faces(std::ops::Range<usize>),
    /// A hand that draws it.
    Hand(Hand),
    /// The sharp edge of a tool.
    Edge(EdgeNow),
    /// The needle of a tool.
    Needle(Box<NeedleNow>),
}

/// A point of an edge in this step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EdgeNow {
    /// Index into the tools of the step.
    pub tool: usize,
    /// The point (m) in the frame of the tool.
    pub local: DVec3,
    /// Its place (m) at the start of the step, in substeps of what is left of it; now it is `carried`.
    pub from: DVec3,
}

/// A hand that draws a point, in this step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hand {
    /// Index into the pulls of the step.
    pub pull: usize,
    /// Place (m) drawn to at the start of the step, in substeps of what is left of it, and at its end; now it is
    /// `carried`.
    pub from: DVec3,
    pub to: DVec3,
    /// Velocity (m/s) of that place.
    pub velocity: DVec3,
    /// Damping (N s/m).
    pub damping: f64,
    /// Damping (N/m) by ways from the start of the step, and the way (m) for which it is silent.
    pub rate: f64,
    pub silent: DVec3,
}

/// A point that something may touch in this step.
#[derive(Clone, Debug)]
pub(crate) struct ContactPoint {
    pub key: PointKey,
    pub against: Against,
    /// Vertex rows; unused ones have weight 0.
    pub rows: [VertexRow; 4],
    pub weights: [f64; 4],
    /// Rest area (m^2); of pulls the share of the patch.
    pub area: f64,
    /// Pressure over penetration (Pa/m); of pulls the stiffness (N/m).
    pub k: f64,
    /// Coefficient of friction, infinite for a grip.
    pub friction: f64,
    pub memory: PointMemory,
    /// Place (m) at the start of the step.
    pub start: DVec3,
    /// Slip kept, turned with the tool, and the place (m) that the point would have if it went with the tool. Of
    /// pulls, the second is the place (m) drawn to now.
    pub slip: DVec3,
    pub carried: DVec3,
    /// Limit (Pa) of friction and normal of the last iterate.
    pub limit: f64,
    pub normal: DVec3,
    /// It was pressed when the limit was last chosen.
    pub pressed: bool,
    /// Multiplier (Pa) of exact contact.
    pub multiplier: Option<f64>,
    pub side: Side,
    /// Against faces: what there is beyond the rim of those near it.
    pub rim: Rim,
    /// Against faces of a solid: distance (m) outside of it when distances of faces were last taken; 0 where it may touch
    /// however little it moves.
    pub clear: f64,
    /// Against faces: how far (m) the surfaces are drawn in.
    pub drawn_in: f64,
}

/// The side of a tool on which a point has to stay.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Side {
    /// Remembered normal, turned with the tool; zero without.
    pub normal: DVec3,
    /// Outward unit normal of a solid at the start of the step; zero where there are two sides.
    pub outward: DVec3,
    /// The tool is thinner than the edges of the surface: whatever is in it goes straight into the solid, since the
    /// nearest side may soon be the wrong one.
    pub straight: bool,
    /// In this step depth is measured along the remembered normal, or straight into the solid, not to the nearest
    /// side. Chosen once a step: both differ, and energy must not jump where the choice would change.
    pub along: bool,
}

/// A part of a tool in this step.
#[derive(Clone, Debug)]
pub(crate) struct PartNow {
    pub of: Part,
    /// Index into the tools of the step.
    pub tool: usize,
    pub start: RigidPose,
    pub end: RigidPose,
    pub now: RigidPose,
    /// How far (m) its surface is drawn in.
    pub drawn_in: f64,
    /// How much farther (m) than its way it may go, where it is held by a spring.
    pub slack: f64,
}

/// A point as it is at some state.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Active {
    /// It pushes or holds.
    pub on: bool,
    /// Vertex rows that its force acts on, and their shares; the shares of faces on the other side are negative.
    pub rows: [VertexRow; 5],
    pub weights: [f64; 5],
    /// Place (m).
    pub at: DVec3,
    /// Normal and friction force (N) on a share of 1.
    pub push: DVec3,
    pub rub: DVec3,
    /// Tangent (N/m), symmetric and positive semi-definite.
    pub block: DMat3,
    /// Against faces: `s` of the part `s s^T` of it by which pressure grows with depth (N/m)^(1/2).
    pub stiff: DVec3,
    /// Energy (J).
    pub energy: f64,
    /// Signed distance (m).
    pub gap: f64,
    /// Unit normal.
    pub normal: DVec3,
    /// Pressure (Pa).
    pub pressure: f64,
    /// Slip (m) since it began to stick.
    pub slip: DVec3,
}

impl Default for Active {
    fn default() -> Self {
        Self {
            on: false,
            rows: [VertexRow(0); 5],
            weights: [0.0; 5],
            at: DVec3::ZERO,
            push: DVec3::ZERO,
            rub: DVec3::ZERO,
            block: DMat3::ZERO,
            stiff: DVec3::ZERO,
            energy: 0.0,
            gap: f64::INFINITY,
            normal: DVec3::ZERO,
            pressure: 0.0,
            slip: DVec3::ZERO,
        }
    }
}

/// Cosine between the directions out of a tool and out of a solid above which a point is on the wrong side.
const BEHIND: f64 = 0.0;
/// Least cosine between a direction and a surface normal with which the direction leads out.
const GRAZING: f64 = 0.05;
/// Largest cosine between a remembered normal and the outward one: a tool that is dragged must not be worked under the
/// surface bit by bit.
const AGAINST: f64 = -0.5;

/// Stiffness of friction over that of contact between bodies.
const SOFT_STICK: f64 = 0.1;
/// Share of the tangent along the slip that is taken off between bodies: with all of it rounds overshoot from slip to slip.
const ALONG_SLIP: f64 = 0.9;

/// `a b^T`.
pub(crate) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

impl ContactPoint {
    /// A point without friction that did not touch before, on rows with their shares.
    pub fn new(
        key: PointKey,
        against: Against,
        (rows, weights): ([VertexRow; 4], [f64; 4]),
        area: f64,
        k: f64,
    ) -> Self {
        Self {
            key,
            against,
            rows,
            weights,
            area,
            k,
            friction: 0.0,
            memory: PointMemory::default(),
            start: DVec3::ZERO,
            slip: DVec3::ZERO,
            carried: DVec3::ZERO,
            limit: 0.0,
            normal: DVec3::ZERO,
            pressed: false,
            multiplier: None,
            side: Side::default(),
            rim: Rim::None,
            clear: 0.0,
            drawn_in: 0.0,
        }
    }

    /// Place (m) among positions.
    pub fn at(&self, x: &(impl Fn(VertexRow) -> DVec3 + ?Sized)) -> DVec3 {
        let mut at = x(self.rows[0]) * self.weights[0];
        for i in 1..4 {
            if self.weights[i] != 0.0 {
                at += x(self.rows[i]) * self.weights[i];
            }
        }
        at
    }

    /// Takes note of its signed distance (m) from faces of a solid. A point that touches, or did at the start of the step, is
    /// looked at whatever its distance.
    pub fn note_distance(&mut self, distance: f64) {
        let free = self.memory == PointMemory::default();
        self.clear = if free { (distance + self.drawn_in).max(0.0) } else { 0.0 };
    }

    /// Whether it cannot touch faces that it came nearer to by at most `moved` (m), and no friction is left of earlier iterates.
    pub fn stays_clear(&mut self, moved: f64, limits: Limits) -> bool {
        let clear = self.clear > moved && self.limit == 0.0;
        if clear && limits != Limits::Keep {
            self.pressed = false;
        }
        clear
    }

    /// What of the faces of another body is nearest at positions `x`.
    pub fn beside(
        &self,
        faces: NearFaces,
        x: &(impl Fn(VertexRow) -> DVec3 + ?Sized),
    ) -> Option<Beside> {
        let Against::Faces(range) = &self.against else { return None };
        beside(self.at(x), &faces.all[range.clone()], faces.moved, x, self.rim)
    }

    /// Evaluates the point at positions `x`, with what is [`beside`](Self::beside) it there. `limits` says whether limit and
    /// normal of friction are taken there or kept.
    pub fn evaluate(
        &mut self,
        parts: &[PartNow],
        near: Option<&Beside>,
        x: &(impl Fn(VertexRow) -> DVec3 + ?Sized),
        start: &dyn Fn(VertexRow) -> DVec3,
        limits: Limits,
    ) -> Active {
        let at = self.at(x);
        let [a, b, c, d] = self.rows;
        let [s, t, u, v] = self.weights;
        let mut active =
            Active { rows: [a, b, c, d, a], weights: [s, t, u, v, 0.0], at, ..Active::default() };
        // signed distance and its gradient
        let gradient;
        let mut across = None;
        match &self.against {
            Against::Hand(hand) => {
                let (stretch, way) = (at - self.carried, (at - self.start) - hand.silent);
                let (k, c) = (self.area * self.k, self.area * hand.rate);
                active.on = true;
                active.push = -k * stretch;
                active.rub = -c * way;
                active.energy = 0.5 * k * stretch.length_squared() + 0.5 * c * way.length_squared();
                active.block = DMat3::from_diagonal(DVec3::splat(k + c));
                active.gap = stretch.length();
                return active;
            }
            Against::Needle(needle) => {
                let own = needle.at(at);
                (active.on, active.gap) = (true, 0.0);
                (active.push, active.rub) = (own.across, own.along);
                (active.energy, active.block) = (own.energy, own.block);
                return active;
            }
            Against::Part(part) => {
                let part = &parts[*part];
                (active.gap, gradient) = part.gap(at, &self.side);
            }
            // the limit is known, and sides are left free
            Against::Edge(_) => gradient = DVec3::ZERO,
            Against::Faces(_) => {
                let Some(near) = near else { return active };
                (active.gap, gradient) = (near.distance + self.drawn_in, near.normal);
                // edges bend what is drawn in as much less as it is nearer to what can be touched
                let flat = outer(gradient, gradient);
                let bent = if self.drawn_in > 0.0 { active.gap / near.distance } else { 1.0 };
                across = Some(flat + bent.clamp(0.0, 1.0) * (near.across - flat));
                let [d, e, f, g] = near.face;
                let [p, q, r, s] = near.weights;
                (active.rows, active.weights) = ([a, d, e, f, g], [1.0, -p, -q, -r, -s]);
                let way = |row| x(row) - start(row);
                // what goes with the faces: the slip is the rest of the way
                self.carried = at - (way(a) - way(d) * p - way(e) * q - way(f) * r - way(g) * s);
            }
        }
        // pressure and limit of friction
        let lambda = self.multiplier.unwrap_or(0.0);
        active.pressure = (lambda - self.k * active.gap).max(0.0);
        active.normal = gradient.normalize_or_zero();
        if limits != Limits::Keep && !self.is_edge() {
            let pressed = active.pressure > 0.0;
            let pressure = match limits {
                Limits::Recall => self.memory.pressure,
                Limits::Follow if !self.pressed => 0.0,
                _ => active.pressure,
            };
            let limit = match self.friction {
                friction if friction.is_infinite() && (pressed || self.memory.gripped) => friction,
                friction if friction > 0.0 && pressure > 0.0 => friction * pressure,
                _ => 0.0,
            };
            let halfway = limits == Limits::Approach && limit.is_finite();
            self.limit = if halfway { 0.5 * (self.limit + limit) } else { limit };
            self.normal = active.normal;
            self.pressed = pressed || limits == Limits::Recall && pressure > 0.0;
        }
        // normal force
        if active.pressure > 0.0 || lambda > 0.0 {
            // of a point that leaves, too: the energy must not jump where its pressure ends
            active.energy =
                0.5 * self.area / self.k * (active.pressure * active.pressure - lambda * lambda);
        }
        if active.pressure > 0.0 {
            active.on = true;
            let stiffness = self.area * self.k;
            active.push = self.area * active.pressure * gradient;
            active.block = stiffness * across.unwrap_or_else(|| outer(gradient, gradient));
            if across.is_some() {
                active.stiff = stiffness.sqrt() * gradient;
            }
        }
        // friction: a spring up to the limit
        if self.limit > 0.0 {
            active.on = true;
            let way = self.slip + at - self.carried;
            let n = self.normal;
            let tangent =
                if self.memory.gripped { DMat3::IDENTITY } else { DMat3::IDENTITY - outer(n, n) };
            let t = tangent * way;
            let (l, k, limit) = (t.length(), self.stick(), self.limit);
            active.slip = t;
            if k * l <= limit {
                active.rub = -self.area * k * t;
                active.energy += 0.5 * self.area * k * l * l;
                active.block += self.area * k * tangent;
            } else {
                active.rub = -self.area * limit / l * t;
                active.energy += self.area * (limit * l - 0.5 * limit * limit / k);
                let along = if across.is_some() { ALONG_SLIP } else { 1.0 };
                active.block += self.area * limit / l * (tangent - along * outer(t, t) / (l * l));
            }
        }
        active
    }

    /// Stiffness of friction (Pa/m) while it sticks.
    pub fn stick(&self) -> f64 {
        match self.against {
            Against::Faces(_) => SOFT_STICK * self.k,
            _ => self.k,
        }
    }

    /// Chooses how depth is measured in the step to come, from where the point is at its start.
    pub fn choose_side(&mut self, part: &PartNow) {
        let (outward, straight) = (self.side.outward, self.side.straight);
        if outward == DVec3::ZERO {
            return;
        }
        let (distance, gradient) = part.nearest(self.start, &part.start);
        let behind = gradient.dot(outward) > BEHIND;
        self.side.along = if self.memory.pressure > 0.0 {
            // exact contact stays at depth 0, where both ways to measure have different slopes: its force would
            // jump there, and the nearest side is the right one
            let straight = straight && self.multiplier.is_none();
            !self.came_from_behind()
                && (straight || behind || gradient.dot(self.side.direction()) < 0.0)
        } else if distance < 0.0 {
            straight || behind
        } else {
            straight && part.nearest(self.start, &part.end).1.dot(outward) <= BEHIND
        };
    }

    /// Energy (J) that is stored in what it remembers.
    pub fn kept(&self) -> f64 {
        let PointMemory { pressure, slip, .. } = self.memory;
        0.5 * self.area * (pressure * pressure / self.k + self.stick() * slip.length_squared())
    }

    /// Whether the tool met the point from inside of the solid: it then keeps to the side that is nearest.
    pub fn came_from_behind(&self) -> bool {
        self.memory.normal.dot(self.side.outward) > BEHIND
    }

    /// Elastic slip (m) after an evaluation: the slip that friction can hold at its limit.
    pub fn kept_slip(&self, active: &Active) -> DVec3 {
        let l = active.slip.length();
        if self.limit <= 0.0 || (active.pressure <= 0.0 && !self.is_held() && !self.is_edge()) {
            DVec3::ZERO
        } else if self.stick() * l <= self.limit {
            active.slip
        } else {
            active.slip * (self.limit / (self.stick() * l))
        }
    }

    /// The normal to be remembered: it always points somewhat against the outward normal of the solid.
    pub fn kept_normal(&self, active: &Active) -> DVec3 {
        let n = active.normal;
        let outward = self.side.outward;
        let cosine = n.dot(outward);
        let behind = match self.memory.pressure > 0.0 {
            true => self.came_from_behind(),
            false => cosine > BEHIND,
        };
        if outward == DVec3::ZERO || cosine <= AGAINST || behind {
            return n;
        }
        (n + (AGAINST - cosine) * outward).try_normalize().unwrap_or(-outward)
    }

    /// Whether an edge holds it.
    pub fn is_edge(&self) -> bool {
        matches!(self.against, Against::Edge(_))
    }

    /// Whether a grip holds it, whatever the pressure.
    pub fn is_held(&self) -> bool {
        self.limit.is_infinite()
    }
}

impl PartNow {
    /// The axis-parallel box (m) of the part in some pose.
    pub fn bounds(&self, pose: &RigidPose) -> [DVec3; 2] {
        self.of.bounds(pose.centre, pose.rotation)
    }

    /// Most (m) that a point of it moves in the step.
    pub fn longest_way(&self) -> f64 {
        let shift = self.start.centre.distance(self.end.centre);
        let reach = self.of.shape.reach();
        let angle = self.start.rotation.angle_between(self.end.rotation);
        if reach.is_finite() { shift + angle * reach } else { shift }
    }

    /// Where the part may be in the step.
    pub fn reach(&self) -> Reach<'_> {
        let longest = self.longest_way() + self.slack;
        Reach { part: self, bounds: grown(self.bounds(&self.end), longest), longest }
    }

    /// Signed distance (m) of a point in the world from the part in some pose, and its gradient.
    fn nearest(&self, at: DVec3, pose: &RigidPose) -> (f64, DVec3) {
        let (distance, gradient) = self.of.distance(pose.rotation.inverse() * (at - pose.centre));
        (distance, pose.rotation * gradient)
    }

    /// The same of the part as it is now, drawn in. Where the nearest surface is that of the wrong side, the distance
    /// is that to the surface along the remembered normal, or into the solid.
    pub fn gap(&self, at: DVec3, side: &Side) -> (f64, DVec3) {
        let inverse = self.now.rotation.inverse();
        if side.outward != DVec3::ZERO
            && let Some((distance, gradient)) = self
                .of
                .shape
                .side_distance(inverse * (at - self.now.centre), inverse * side.outward)
        {
            return (distance + self.drawn_in, self.now.rotation * gradient);
        }
        let (distance, gradient) = self.nearest(at, &self.now);
        let direction = side.direction();
        // a surface with two sides has only the remembered one to go by
        let along = side.along || side.outward == DVec3::ZERO && gradient.dot(direction) < 0.0;
        if distance < 0.0 && along {
            let RigidPose { centre, rotation } = self.now;
            let inverse = rotation.inverse();
            let along = inverse * direction;
            let (way, exit) = self.of.shape.way_out(inverse * (at - centre), along);
            let slope = exit.dot(along);
            if slope > GRAZING {
                return (self.drawn_in - way, rotation * (exit / slope));
            }
        }
        (distance + self.drawn_in, gradient)
    }

    /// Second derivatives (1/m) of the distance, by differences of its gradient.
    pub fn curvature(&self, at: DVec3, side: &Side) -> DMat3 {
        let thickness = self.of.shape.thickness();
        if !thickness.is_finite() {
            return DMat3::ZERO;
        }
        let h = 1e-5 * thickness;
        let slope = |axis: DVec3| {
            (self.gap(at + h * axis, side).1 - self.gap(at - h * axis, side).1) / (2.0 * h)
        };
        let curvature = DMat3::from_cols(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
        0.5 * (curvature + curvature.transpose())
    }
}

/// Where a part may be in a step.
pub(crate) struct Reach<'a> {
    part: &'a PartNow,
    bounds: [DVec3; 2],
    longest: f64,
}

impl Reach<'_> {
    /// Whether the part may meet what is in a box (m) all through the step.
    pub fn meets(&self, of: &[DVec3; 2]) -> bool {
        let Self { part, bounds, longest } = self;
        let near = || {
            // distances grow by no more than the way; those of meshes by a cell more, where sides meet
            let (centre, radius) = (0.5 * (of[0] + of[1]), 0.5 * of[0].distance(of[1]));
            let distance = part.nearest(centre, &part.end).0;
            // false for a box that is not finite
            let apart = distance > radius + longest + part.of.shape.cell();
            !apart
        };
        overlap(of, bounds) && (!part.of.cavity || near())
    }
}

impl Side {
    /// Unit direction that leads out of the tool on the right side, as far as it is known.
    fn direction(&self) -> DVec3 {
        match self.straight || self.normal == DVec3::ZERO {
            true => -self.outward,
            false => self.normal,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beside::NearFacet;
    use crate::field::DistanceField;
    use crate::shape::Shape;
    use proptest::prelude::*;
    use sinew_engine::mesh::generate::sphere_tets;

    const FACES: NearFaces = {
        const ALL: [NearFacet; 3] = {
            let [b, c, d, e] = [VertexRow(1), VertexRow(2), VertexRow(3), VertexRow(4)];
            let distance = 0.0;
            let [p, q, r] = [[b, c, d, d], [c, e, d, d], [b, c, e, d]];
            [
                NearFacet { rows: p, distance },
                NearFacet { rows: q, distance },
                NearFacet { rows: r, distance },
            ]
        };
        NearFaces { all: &ALL, moved: 0.0 }
    };

    fn part(of: Part, turn: f64) -> PartNow {
        let pose = |turn: f64, centre| RigidPose {
            centre,
            rotation: DQuat::from_xyzw(0.1 * turn, -0.2, 0.3 * turn, 0.9).normalize(),
        };
        let (start, end) = (pose(0.5, DVec3::new(0.1, 0.0, 0.2)), pose(turn, DVec3::ZERO));
        PartNow { of, tool: 0, start, end, now: end, drawn_in: 0.0, slack: 0.0 }
    }

    /// Cavities of all shapes, about 1 m wide.
    fn cavities() -> Vec<Part> {
        let mesh = sphere_tets(0.45, 4).unwrap();
        let field = DistanceField::cached(&mesh.points, &mesh.surface().triangles, Some(0.06));
        let shapes = [
            Shape::Sphere { radius: 0.4 },
            Shape::Capsule { half_length: 0.2, radius: 0.3 },
            Shape::Box { half: DVec3::new(0.3, 0.4, 0.5), rounding: 0.1 },
            Shape::Field(field.unwrap()),
        ];
        shapes.map(|shape| Part { cavity: true, ..shape.into() }).to_vec()
    }

    fn point(against: Against, friction: f64) -> ContactPoint {
        let own = ([VertexRow(0); 4], [1.0, 0.0, 0.0, 0.0]);
        ContactPoint {
            friction,
            slip: DVec3::new(0.01, -0.02, 0.015),
            carried: DVec3::new(0.05, 0.1, -0.1),
            ..ContactPoint::new(PointKey::default(), against, own, 0.3, 7.0)
        }
    }

    /// Compares force and tangent of a point with differences of energy and force on every coordinate of five rows.
    /// `exact` shapes have no curvature where the test puts them.
    fn check(point: &mut ContactPoint, parts: &[PartNow], places: [DVec3; 5], exact: bool) -> bool {
        let start = |row: VertexRow| DVec3::splat(0.01 * f64::from(row.0));
        let at = |places: [DVec3; 5]| move |row: VertexRow| places[row.index()];
        let evaluate = |point: &mut ContactPoint, places, limits| {
            let near = point.beside(FACES, &at(places));
            point.evaluate(parts, near.as_ref(), &at(places), &start, limits)
        };
        let active = evaluate(point, places, Limits::Take);
        if !active.on || active.pressure < 0.05 {
            return false;
        }
        let force_on = |active: &Active, row: VertexRow| {
            let used =
                active.rows.iter().zip(active.weights).filter(|(r, w)| **r == row && *w != 0.0);
            used.map(|(_, w)| w).sum::<f64>() * (active.push + active.rub)
        };
        let h = 1e-6;
        for row in (0..5).map(VertexRow) {
            for axis in 0..3 {
                let mut step = |sign: f64| {
                    let mut moved = places;
                    moved[row.index()][axis] += sign * h;
                    evaluate(point, moved, Limits::Keep)
                };
                let (more, less) = (step(1.0), step(-1.0));
                let slope = -(more.energy - less.energy) / (2.0 * h);
                let force = force_on(&active, row)[axis];
                assert!((slope - force).abs() < 1e-6, "row {row}: {slope} {force}");
                if exact {
                    let own = (force_on(&more, row) - force_on(&less, row)) / (2.0 * h);
                    let used = active.rows.iter().zip(active.weights);
                    let share: f64 = used.filter(|(r, _)| **r == row).map(|(_, w)| w).sum();
                    let tangent = -share * share * active.block.col(axis);
                    assert!((own - tangent).length() < 1e-5, "row {row}: {own} {tangent}");
                }
            }
        }
        true
    }

    #[test]
    fn forces_and_tangents_are_derivatives() {
        let shapes = [
            (Shape::Sphere { radius: 0.8 }, false),
            (Shape::Capsule { half_length: 0.5, radius: 0.6 }, false),
            (Shape::Box { half: DVec3::new(0.7, 0.8, 0.9), rounding: 0.4 }, false),
            (Shape::HalfSpace, true),
        ];
        let hollow = cavities().into_iter().map(|part| (part, false));
        let parts: Vec<(Part, bool)> =
            shapes.into_iter().map(|(shape, exact)| (shape.into(), exact)).chain(hollow).collect();
        let (mut checked, mut slipped) = (0, 0);
        let mut seed = 11_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        for _ in 0..400 {
            for (of, exact) in &parts {
                for friction in [0.0, 0.05, 5.0] {
                    let parts = [part(of.clone(), random())];
                    let mut point = point(Against::Part(0), friction);
                    let mut places = [DVec3::ZERO; 5];
                    places[0] = 1.4 * DVec3::new(random(), random(), random());
                    if check(&mut point, &parts, places, *exact) {
                        checked += 1;
                        let x = |_: VertexRow| places[0];
                        let active = point.evaluate(&parts, None, &x, &x, Limits::Take);
                        slipped += u32::from(point.k * active.slip.length() > point.limit);
                    }
                }
            }
        }
        assert!(checked > 1000 && slipped > 100, "{checked} {slipped}");
    }

    /// Pushed back from anywhere, and told apart from what is well inside by the boxes of the broad phase.
    #[test]
    fn cavities_push_back_from_anywhere_and_pass_over_what_is_well_inside() {
        let mut seed = 5_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let mut passed = [0; 4];
        for (of, passed) in cavities().into_iter().zip(&mut passed) {
            let own = PartNow { start: part(of.clone(), 0.6).end, ..part(of, 0.5) };
            let reach = own.reach();
            let inner = own.of.shape.reach();
            for i in 0..3000 {
                let middle = 1.2 * DVec3::new(random(), random(), random());
                let half = DVec3::new(random(), random(), random()).abs() * 0.15;
                let met = reach.meets(&[middle - half, middle + half]);
                *passed += u32::from(!met);
                let at = middle + 2.0 * half * DVec3::new(random(), random(), random());
                let (gap, gradient) = own.gap(at, &Side::default());
                assert!(met || gap > own.longest_way(), "{:?}: {at} {gap}", own.of);
                assert!(gap < inner, "{gap}");
                // far outside the way back is as long as it is for a ball of the same reach, a diagonal of a grid's box less
                let far = at.normalize() * libm::exp2(f64::from(i % 40));
                let (gap, gradient_there) = own.gap(far, &Side::default());
                let way = far.length();
                assert!(
                    gap < 0.0 && -gap <= way && -gap >= (way - inner) / 2.0_f64.sqrt(),
                    "{far} {gap}"
                );
                assert!(
                    gradient_there.dot(far) < -0.6 * way,
                    "{:?}: {far} {gradient_there}",
                    own.of
                );
                // the field bends between its grid points
                let length = gradient.length();
                assert!((length - 1.0).abs() < 1e-12 || own.of.shape.cell() > 0.0, "{length}");
            }
        }
        assert!(passed.iter().all(|n| *n > 100), "{passed:?}");
    }

    proptest! {
        #[test]
        fn forces_between_bodies_are_derivatives(
            x in 0.1..0.6, y in 0.1..0.3, z in -0.2..-0.1, a in prop::array::uniform3(-0.05..0.05),
        ) {
            // behind a face of two that share an edge, away from that edge
            let places = [
                DVec3::new(x, y, z),
                DVec3::ZERO,
                DVec3::X + DVec3::from_array(a),
                DVec3::Y,
                DVec3::new(1.0, 1.0, 0.1),
            ];
            let mut point = point(Against::Faces(0..1), 0.0);
            prop_assume!(x + y < 0.85);
            prop_assert!(check(&mut point, &[], places, false));
        }

        #[test]
        fn forces_of_faces_with_four_corners_are_derivatives(
            x in 0.2..0.8, y in 0.05..0.15, z in -0.2..-0.1, a in prop::array::uniform3(-0.05..0.05),
        ) {
            // behind the quarter at the first edge
            let places = [
                DVec3::new(x, y, z),
                DVec3::ZERO,
                DVec3::X + DVec3::from_array(a),
                DVec3::Y,
                DVec3::new(1.0, 1.0, 0.1),
            ];
            let mut point = point(Against::Faces(2..3), 0.0);
            prop_assert!(check(&mut point, &[], places, false));
        }
    }

    #[test]
    fn what_friction_keeps_is_below_its_limit_and_what_it_takes_is_positive() {
        let parts = [part(Shape::HalfSpace.into(), 0.0)];
        let mut point = point(Against::Part(0), 0.2);
        let normal = parts[0].now.rotation * DVec3::Z;
        let at = -0.1 * normal;
        let active = point.evaluate(&parts, None, &|_| at, &|_| at, Limits::Take);
        let kept = point.kept_slip(&active);
        assert!((point.k * kept.length() / (0.2 * active.pressure) - 1.0).abs() < 1e-12);
        assert!(active.slip.length() > kept.length());
        assert!((active.pressure - 0.7).abs() < 1e-12);
    }
}
