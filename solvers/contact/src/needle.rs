//! Needles: where tissue holds them, and the force along and across their shaft.
//!
//! A needle is a straight line or an arc of a circle. Of a place `y`, `u(y)` is how far along the needle behind its tip the
//! closest point `c(y)` lies. It is held by two kinds of points of the tissue:
//!
//! * what its tip meets holds it by a spring of stiffness `k` and slip `l = u`, which pushes up to a limit: `F_p` until the
//!   surface gives way, then `F_c = G w` with the toughness `G` and the width `w = pi d / 2` of what a tip of diameter `d`
//!   parts. A tip that goes back meets no force.
//! * points of the channel, every half edge of the tissue, stay on its axis by `k_n |y - c(y)|^2 / 2`, and hold it along the
//!   axis by a spring whose slip `l = u - u_0` gives way at `tau` times the length of the channel that a point stands for.
//!
//! Along the needle the energy is `q l - q^2 / (2 k)`, `q` being `k l` within its limits: convex, whatever the limits are.
//! So a steady needle that is `L` deep needs `F_c + tau L`, and `tau L` to be drawn back (the law that DiMaio & Salcudean 2003
//! measured, with memory).

use crate::edge::YIELD;
use crate::point::{RigidPose, outer};
use crate::thread::Hold;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// Largest angle (rad) of a curved needle: beyond, what is nearest to a place would be its other end.
const MOST_ANGLE: f64 = 4.0;

/// A needle, in the frame of the tool.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Needle {
    /// Its tip (m).
    pub tip: DVec3,
    /// Direction in which the tip points, of any length.
    pub into: DVec3,
    /// Centre (m) of the circle of which it is an arc; straight without. What of `into` leads to the centre does not count.
    pub centre: Option<DVec3>,
    /// Length (m), from the tip.
    pub length: f64,
    /// Diameter (m).
    pub diameter: f64,
    /// Toughness `G` (J/m^2) of the tissue that its tip parts over half of its circumference: `F_c = G pi d / 2`. 0 for one
    /// whose tip meets no force.
    pub toughness: f64,
    /// Force (N) at which a surface gives way; twice `F_c` if none is given.
    pub puncture: Option<f64>,
    /// Friction `tau` (N/m) of the shaft in tissue, by length.
    pub friction: f64,
}

impl Needle {
    /// A straight needle whose tip is the origin of the tool and points along the x axis.
    pub fn new(length: f64, diameter: f64, toughness: f64, friction: f64) -> Self {
        let (tip, into, centre, puncture) = (DVec3::ZERO, DVec3::X, None, None);
        Self { tip, into, centre, length, diameter, toughness, puncture, friction }
    }

    /// Force (N) that its tip needs in tissue, `F_c`.
    pub fn cutting_force(&self) -> f64 {
        self.toughness * self.diameter * std::f64::consts::FRAC_PI_2
    }

    /// Force (N) at which a surface gives way, `F_p`.
    pub fn puncture_force(&self) -> f64 {
        self.puncture.unwrap_or(2.0 * self.cutting_force())
    }

    /// The error in it, if there is one.
    pub fn problem(&self) -> Option<String> {
        let positive = [("length", self.length), ("diameter", self.diameter)];
        if let Some((what, x)) = positive.into_iter().find(|(_, x)| !(*x > 0.0 && x.is_finite())) {
            return Some(format!("the {what} of its needle is {x} m: it must be positive"));
        }
        let forces = [
            ("toughness", self.toughness, "J/m^2"),
            ("friction", self.friction, "N/m"),
            ("puncture", self.puncture_force(), "N"),
        ];
        let bad = forces.into_iter().find(|(_, x, _)| !(*x >= 0.0 && x.is_finite()));
        if let Some((what, x, unit)) = bad {
            return Some(format!(
                "the {what} of its needle is {x} {unit}: it must be 0 or positive"
            ));
        }
        if self.puncture_force() < self.cutting_force() {
            let (puncture, cutting) = (self.puncture_force(), self.cutting_force());
            return Some(format!(
                "its needle punctures at {puncture} N: it must be no less than what the tip needs in tissue, {cutting} N"
            ));
        }
        let frame = self.tip.is_finite().then(|| self.frame()).flatten();
        let Some([_, radial]) = frame else {
            return Some("its needle needs a tip, a direction, and a centre beside the tip".into());
        };
        let angle = self.length / radial.length();
        (self.centre.is_some() && angle > MOST_ANGLE).then(|| {
            format!("its needle is an arc of {angle} rad: it must be no more than {MOST_ANGLE}")
        })
    }

    /// Unit direction at the tip, and the way (m) from the centre to the tip.
    fn frame(&self) -> Option<[DVec3; 2]> {
        let radial = self.centre.map_or(DVec3::ZERO, |centre| self.tip - centre);
        let out = radial.normalize_or_zero();
        let apart = self.centre.is_none() || out != DVec3::ZERO;
        let into = self.into.try_normalize()?;
        let into = (into - into.dot(out) * out).try_normalize()?;
        (into.is_finite() && radial.is_finite() && apart).then_some([into, radial])
    }

    /// The place (m) of it `u` (m) behind its tip, before it where that is negative.
    pub fn place(&self, u: f64) -> DVec3 {
        let Some([into, radial]) = self.frame() else { return self.tip };
        if self.centre.is_none() {
            return self.tip - u * into;
        }
        let radius = radial.length();
        let (sin, cos) = libm::sincos(-u / radius);
        self.tip - radial + radial * cos + into * (radius * sin)
    }

    /// What of it is closest to a place (m).
    pub fn nearest(&self, at: DVec3) -> Nearest {
        let Some([into, radial]) = self.frame() else { return Nearest::default() };
        let Some(centre) = self.centre else {
            let u = (self.tip - at).dot(into);
            let away = at - self.tip + u * into;
            return Nearest { u, slope: -into, away, across: DMat3::IDENTITY - outer(into, into) };
        };
        let radius = radial.length();
        let out = radial / radius;
        let (way, normal) = (at - centre, out.cross(into));
        let (x, y) = (way.dot(out), way.dot(into));
        let mut angle = libm::atan2(y, x);
        if angle > std::f64::consts::FRAC_PI_2 {
            angle -= std::f64::consts::TAU;
        }
        let from_axis = libm::hypot(x, y).max(f64::MIN_POSITIVE);
        let outward = (out * x + into * y) / from_axis;
        let along = normal.cross(outward);
        let away = (from_axis - radius) * outward + way.dot(normal) * normal;
        // what is inside of the circle is drawn less along it, which is left out
        let bent = (1.0 - radius / from_axis).max(0.0);
        let across = DMat3::IDENTITY - (1.0 - bent) * outer(along, along);
        Nearest { u: -radius * angle, slope: -radius / from_axis * along, away, across }
    }
}

/// What of a needle is closest to a place.
#[derive(Clone, Copy, Debug, Default)]
pub struct Nearest {
    /// How far (m) behind the tip it is.
    pub u: f64,
    /// Gradient of that by the place.
    pub slope: DVec3,
    /// The way (m) from it to the place.
    pub away: DVec3,
    /// Second derivatives of half of the square of that way, without what is negative.
    pub across: DMat3,
}

/// A point of a channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NeedlePoint {
    /// The point of the tissue.
    pub hold: Hold,
    /// Where (m behind the tip) it would lie without friction.
    pub rest: f64,
    /// Length (m) of the channel, from it on towards the tip, for which it stands in this step.
    pub width: f64,
    /// The needle left the tissue here.
    pub exit: bool,
    /// The needle goes through it in this step.
    pub held: bool,
    /// The end of the needle has gone through it.
    pub passed: bool,
}

/// What a needle does, kept from step to step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NeedleState {
    /// It has been looked at.
    pub came: bool,
    /// The channel, from where it entered.
    pub points: Vec<NeedlePoint>,
    /// Points of channels that it has left, on the other side.
    pub passed: Vec<Hold>,
    /// What its tip meets.
    pub tip: Option<Hold>,
    /// The surface before its tip has given way.
    pub punctured: bool,
    /// Mean edge (m, at rest) of the body that it entered last.
    pub edge: f64,
    /// Surfaces that gave way.
    pub punctures: u32,
    /// Energy (J) that its tip took.
    pub fracture: f64,
}

impl NeedleState {
    /// Stiffness (N/m) of what the tip meets.
    pub fn tip_stiffness(&self, needle: &Needle) -> f64 {
        0.5 * needle.puncture_force().max(2.0 * needle.cutting_force()) / (YIELD * self.edge)
    }

    /// Limit (N) of the force on its tip.
    pub fn tip_limit(&self, needle: &Needle) -> f64 {
        if self.punctured { needle.cutting_force() } else { needle.puncture_force() }
    }

    /// Distance (m) between points of a channel.
    pub fn spacing(&self) -> f64 {
        0.5 * self.edge
    }

    /// Length (m) of it in tissue.
    pub fn depth(&self) -> f64 {
        self.points.iter().map(|point| point.width).sum()
    }

    /// What holds it in the step to come, its tip last, by number.
    pub(crate) fn holds(&self) -> Vec<Hold> {
        self.points.iter().map(|point| point.hold.clone()).chain(self.tip.clone()).collect()
    }
}

/// A point that holds a needle in this step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NeedleNow {
    /// Index into the tools of the step.
    pub tool: usize,
    pub needle: Needle,
    /// Poses of the tool at the start of the step, in substeps of what is left of it, at its end, and now.
    pub start: RigidPose,
    pub end: RigidPose,
    pub now: RigidPose,
    /// Slip along the needle is counted from here (m behind the tip).
    pub rest: f64,
    /// Stiffness (N/m) along the needle, and the force (N) up to which it holds back and draws.
    pub k: f64,
    pub limits: [f64; 2],
    /// Stiffness (N/m) across it.
    pub across: f64,
    pub is_tip: bool,
}

/// Forces on a point that holds a needle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NeedleForce {
    /// Forces (N) across and along the needle.
    pub across: DVec3,
    pub along: DVec3,
    /// The second by size, positive where the needle pushes the point ahead.
    pub push: f64,
    pub block: DMat3,
    /// Energy (J) of the potential, stored, and lost.
    pub energy: f64,
    pub stored: f64,
    pub lost: f64,
}

impl NeedleNow {
    /// Forces on the point at a place (m).
    pub fn at(&self, at: DVec3) -> NeedleForce {
        let RigidPose { centre, rotation } = self.now;
        let near = self.needle.nearest(rotation.inverse() * (at - centre));
        let [slope, away] = [near.slope, near.away].map(|own| rotation * own);
        let slip = near.u - self.rest;
        let (elastic, [back, ahead]) = (self.k * slip, self.limits);
        let push = elastic.clamp(-back, ahead);
        // not divided within the limits: rounding would lose a little less than nothing there
        let held = if push == elastic { slip } else { push / self.k };
        let turn = DMat3::from_quat(rotation);
        let mut block = self.across * (turn * near.across * turn.transpose());
        if push == elastic {
            block += self.k * outer(slope, slope);
        }
        let bent = 0.5 * self.across * away.length_squared();
        NeedleForce {
            across: -self.across * away,
            along: -push * slope,
            push,
            block,
            energy: push * slip - 0.5 * push * held + bent,
            stored: 0.5 * push * held + bent,
            lost: push * (slip - held),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    fn needle(curved: bool) -> Needle {
        let centre = curved.then_some(DVec3::new(0.1, 1.3, -0.2));
        let into = DVec3::new(0.9, 0.3, 0.2);
        Needle { tip: DVec3::new(0.2, 0.1, 0.1), into, centre, ..Needle::new(2.0, 0.1, 3.0, 0.4) }
    }

    proptest! {
        #[test]
        fn forces_on_needles_are_derivatives(
            curved: bool, along in 0.1..1.8_f64, off in prop::array::uniform3(-0.2..0.2_f64), slip in -0.1..0.1_f64
        ) {
            let needle = needle(curved);
            let pose = RigidPose { centre: DVec3::new(1.0, 2.0, 3.0), rotation: DQuat::from_rotation_y(0.7) };
            let own = NeedleNow {
                tool: 0, needle, start: pose, end: pose, now: pose, rest: along + slip,
                k: 5.0, limits: [0.2, 0.1], across: 7.0, is_tip: false,
            };
            let place = needle.place(along);
            let on = needle.nearest(place);
            prop_assert!((on.u - along).abs() < 1e-12 && on.away.length() < 1e-12);
            let at = pose.centre + pose.rotation * place + DVec3::from(off);
            let (here, h) = (own.at(at), 1e-6);
            prop_assert!(here.lost >= 0.0 && here.stored >= 0.0);
            prop_assert!((here.energy - here.stored - here.lost).abs() < 1e-12);
            let edges = [own.limits[0] + here.push, own.limits[1] - here.push];
            // across a corner of the law a difference is off by half of k h
            let elastic = own.k * (needle.nearest(pose.rotation.inverse() * (at - pose.centre)).u - own.rest);
            let corners = [elastic + own.limits[0], elastic - own.limits[1]];
            let is_near = corners.iter().any(|left| left.abs() < 1e-4);
            let bound = if is_near { own.k * h } else { 1e-8 };
            for axis in DVec3::AXES {
                let [more, less] = [own.at(at + h * axis), own.at(at - h * axis)];
                let slope = -(more.energy - less.energy) / (2.0 * h);
                prop_assert!((slope - (here.across + here.along).dot(axis)).abs() < bound);
                let force = |of: NeedleForce| of.across + of.along;
                let change = -(force(more) - force(less)) / (2.0 * h);
                // exact for straight ones, off the corners of the law
                if !curved && edges.iter().all(|left| *left == 0.0 || *left > 1e-4) {
                    let own = here.block * axis;
                    prop_assert!((change - own).length() < 1e-6 || edges.contains(&0.0));
                }
                prop_assert!(axis.dot(here.block * axis) >= 0.0);
            }
        }
    }
}
