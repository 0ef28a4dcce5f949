//! Threads and clips through points of bodies: stitches, staples, knots.
//!
//! A thread runs straight from point to point. Of the segment `i` between two of them, `d_i` long, `l_i` is the free length;
//! its tension is `T_i = k_i <d_i - l_i>`, `k_i = EA / m_i`, where the measures `m_i` are the free lengths when the thread
//! took hold. Through the points between its ends the thread slides: `l_i = l_i^n + s_i - s_(i-1)` with the slides `s_i` of the
//! step, until what the point can hold is no less than the difference of the tensions on its sides (capstan):
//! `T_i <= T_(i+1) e^(mu theta_i) + f_i` and the reverse, `theta_i` the angle by which the thread turns there.
//!
//! With limits `c_i` of these differences that are kept within an iterate, slides minimise
//! `psi = sum_i k_i <d_i - l_i>^2 / 2 + sum_i c_i |s_i|`. Partly minimised it is a convex potential of the places, whose forces
//! are `-T_i` times the gradient of `d_i`; so line search and energy cap hold. Its tangent is
//! `sum_G K_G g_G g_G^T + sum_i T_i / d_i (1 - n_i n_i^T)` on the differences of places: segments between points where nothing
//! slides are one group `G` of stiffness `1 / K_G = sum 1 / k_i` and length `sum d_i`, `g_G` being its gradient. Without
//! friction all segments have one tension, `T = EA <L - L0> / L0`.
//!
//! Slides are found exactly, in one pass: from the first point to the last, `s_i` as a falling, piecewise linear function of
//! `T_i` (`Curve`); then back. The same pass solves the capstan inequalities themselves, from which the limits are taken.

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::order::Order;
use sinew_engine::row::{MeshVertex, VertexRow};

/// What a thread or clip goes through.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Hold {
    /// A point of the material of a body of solid elements. Where a cut parts its element it goes with the side that
    /// has the point.
    Tissue {
        /// Index of the body.
        body: usize,
        /// The tetrahedron of the mesh that it lies in.
        element: u32,
        /// Its vertices, and their weights, which sum to 1.
        vertices: [MeshVertex; 4],
        /// Weights.
        weights: [f64; 4],
    },
    /// Vertices of any body, such as those of a [`Pick`](crate::pull::Pick), with their weights, which sum to 1.
    Vertices {
        /// Vertex rows, at most four.
        rows: Vec<VertexRow>,
        /// Weights.
        weights: Vec<f64>,
    },
    /// A place (m) in space, such as a hand or a ring: where it is at the end of the next step.
    Place(DVec3),
    /// The end of the needle of the tool with this number, as the last point of a thread. Points of tissue that it passes come before
    /// it: as it passes one, the thread goes through there instead.
    Needle(Order),
}

impl Hold {
    fn problem(&self, rows: usize, bodies: usize) -> Option<&'static str> {
        let sum_is_one = |weights: &[f64]| {
            let sum: f64 = weights.iter().sum();
            (sum - 1.0).abs() <= 1e-6 && weights.iter().all(|w| w.is_finite())
        };
        match self {
            Self::Tissue { body, .. } if *body >= bodies => {
                Some("names a body that does not exist")
            }
            Self::Tissue { weights, .. } if !sum_is_one(weights) => {
                Some("has weights that do not sum to 1")
            }
            Self::Vertices { rows: own, .. } if own.iter().any(|row| row.index() >= rows) => {
                Some("names a vertex row that does not exist")
            }
            Self::Vertices { rows: own, .. } if own.is_empty() || own.len() > 4 => {
                Some("needs one to four vertices")
            }
            Self::Vertices { rows: own, weights } if own.len() != weights.len() => {
                Some("needs a weight for each vertex")
            }
            Self::Vertices { weights, .. } if !sum_is_one(weights) => {
                Some("has weights that do not sum to 1")
            }
            Self::Place(at) if !at.is_finite() => Some("is at a place that is not finite"),
            _ => None,
        }
    }
}

/// A thread; see the [module](self). It weighs nothing, and between its points it touches nothing.
#[derive(Component, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[require(ThreadReport, Order)]
pub struct Thread {
    /// Name for reports and probes.
    pub name: String,
    /// What it goes through, in order, two at least; one if that is a needle that has not passed any yet. What is put before the last
    /// point later it takes over with the length that it has there, so that none is made or lost.
    pub points: Vec<Hold>,
    /// Stiffness `EA` (N): the force that stretches it to twice its length.
    pub stiffness: f64,
    /// Free length (m) between its first and last point when it takes hold; what lies there then, if none is given.
    pub length: Option<f64>,
    /// Coefficient of friction `mu` at the points between its ends.
    pub friction: f64,
    /// Force (N) that such a point holds whatever the tension.
    pub grip: f64,
    /// Length (m) beyond its first and its last point when it takes hold. 0: it is knotted there. Else it slips through that point, and
    /// off it once the length is used up, or until this is 0: then it is knotted there as it is.
    pub tails: [f64; 2],
    /// Length (m) that hands have drawn past its first and its last point by the end of the next step.
    pub drawn: [f64; 2],
}

impl Thread {
    /// A thread without friction, knotted at its ends, that begins with no tension.
    pub fn new(name: impl Into<String>, points: Vec<Hold>, stiffness: f64) -> Self {
        Self {
            name: name.into(),
            points,
            stiffness,
            length: None,
            friction: 0.0,
            grip: 0.0,
            tails: [0.0; 2],
            drawn: [0.0; 2],
        }
    }

    /// The error in it in a world of so many vertex rows and bodies, if there is one.
    pub fn problem(&self, rows: usize, bodies: usize) -> Option<String> {
        let on_needle = matches!(self.points.last(), Some(Hold::Needle(_)));
        if self.points.len() < 2 && !on_needle {
            return Some("it needs two points at least".into());
        }
        if self.points.len() == 1 && (self.length.is_some() || self.tails[0] == 0.0) {
            return Some(
                "its needle draws it out of its first tail: give it that, and no length".into(),
            );
        }
        let before = &self.points[..self.points.len() - 1];
        if before.iter().any(|point| matches!(point, Hold::Needle(_))) {
            return Some("a needle is its last point, or none of them".into());
        }
        let of_points = self.points.iter().enumerate().find_map(|(i, point)| {
            Some(format!("its point {} {}", i + 1, point.problem(rows, bodies)?))
        });
        if of_points.is_some() {
            return of_points;
        }
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let not_negative = |x: f64| x >= 0.0 && x.is_finite();
        if !positive(self.stiffness) {
            return Some(format!("its stiffness is {} N: it must be positive", self.stiffness));
        }
        if let Some(length) = self.length.filter(|length| !positive(*length)) {
            return Some(format!("its length is {length} m: it must be positive"));
        }
        // e^(mu pi) must stay a number
        if !(0.0..=10.0).contains(&self.friction) {
            return Some(format!("its friction is {}: it must be from 0 to 10", self.friction));
        }
        let others = [self.grip, self.tails[0], self.tails[1]];
        if let Some(bad) = others.into_iter().find(|x| !not_negative(*x)) {
            return Some(format!("its grip or a tail is {bad}: it must not be negative"));
        }
        if !self.drawn.iter().all(|x| x.is_finite()) {
            return Some(format!("the lengths drawn, {:?} m, are not finite", self.drawn));
        }
        (0..2)
            .find(|&end| self.drawn[end] != 0.0 && self.tails[end] != 0.0)
            .map(|_| "it is drawn past an end that is free: give it no tail there".into())
    }
}

/// A clip, staple or knot: it draws two points together once they are farther apart than its length,
/// `k <|y_a - y_b| - l>^2 / 2`.
#[derive(Component, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[require(ThreadReport, Order)]
pub struct Clip {
    /// Name for reports and probes.
    pub name: String,
    /// What it joins.
    pub points: [Hold; 2],
    /// Stiffness `k` (N/m).
    pub stiffness: f64,
    /// Length `l` (m) up to which it does not pull.
    pub length: f64,
    /// Force (N) above which it breaks, for good.
    pub strength: Option<f64>,
}

impl Clip {
    /// One that draws two points onto each other and does not break.
    pub fn new(name: impl Into<String>, points: [Hold; 2], stiffness: f64) -> Self {
        Self { name: name.into(), points, stiffness, length: 0.0, strength: None }
    }

    /// The error in it in a world of so many vertex rows and bodies, if there is one.
    pub fn problem(&self, rows: usize, bodies: usize) -> Option<String> {
        let of_points = self.points.iter().enumerate().find_map(|(i, point)| {
            Some(format!("its point {} {}", i + 1, point.problem(rows, bodies)?))
        });
        if of_points.is_some() {
            return of_points;
        }
        if self.points.iter().any(|point| matches!(point, Hold::Needle(_))) {
            return Some("a needle draws a thread, and no clip".into());
        }
        if !(self.stiffness > 0.0 && self.stiffness.is_finite()) {
            return Some(format!("its stiffness is {} N/m: it must be positive", self.stiffness));
        }
        if !(self.length >= 0.0 && self.length.is_finite()) {
            return Some(format!("its length is {} m: it must not be negative", self.length));
        }
        self.strength
            .filter(|force| force.is_nan() || *force <= 0.0)
            .map(|force| format!("its strength is {force} N: it must be positive"))
    }
}

/// State of a thread or clip at the end of the last step.
#[derive(Component, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ThreadReport {
    /// Points that hold it, by their numbers, ascending, and where they are (m).
    pub held: Vec<u32>,
    /// Places (m) of these.
    pub points: Vec<DVec3>,
    /// Tension (N) from one of them to the next.
    pub tension: Vec<f64>,
    /// Distances (m) from one of them to the next: where a segment crosses a wound, how far apart its lips are there.
    pub spans: Vec<f64>,
    /// Sum of these (m).
    pub length: f64,
    /// Free lengths (m) between them.
    pub free: Vec<f64>,
    /// Length (m) that slid through every point, held or not, since it took hold, towards the first; 0 at knots.
    pub slid: Vec<f64>,
    /// Force (N) on what holds its first and its last point.
    pub ends: [DVec3; 2],
    /// Points that it lost: elements that held them were removed, or its end slipped off.
    pub lost: u32,
    /// It broke, and does nothing any more.
    pub broken: bool,
    /// Work (J) of hands that move and draw it, by the forces at the end of every step or explicit substep.
    pub work: f64,
    /// Energy (J) that friction took, and what was stored when it broke.
    pub dissipation: f64,
    /// Whether the step that these forces are of did not converge: they are not to be relied on.
    pub unconverged: bool,
}

impl ThreadReport {
    /// Largest tension (N).
    pub fn largest(&self) -> f64 {
        self.tension.iter().copied().fold(0.0, f64::max)
    }
}

/// Something that cannot be done to a thread or clip; nothing has changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ThreadError {
    /// A number or point of it cannot be used.
    #[error("thread or clip `{name}`: {problem}")]
    Invalid {
        /// Its name.
        name: String,
        /// What is wrong, and what it must be.
        problem: String,
    },
    /// No such thread.
    #[error("there is no thread {0}")]
    NoThread(Entity),
    /// No hand has it there.
    #[error(
        "thread `{name}` cannot be moved or drawn at {point}: moved is a point in space, to a finite place; drawn is an end          without a tail, 0 or 1, by a finite length"
    )]
    NoHand {
        /// Its name.
        name: String,
        /// Number of the point or end.
        point: usize,
    },
    /// No end of it is free there.
    #[error(
        "thread `{name}` cannot be held at {end}: held is a free end, 0 or 1, of a thread through two points at least"
    )]
    NoTail {
        /// Its name.
        name: String,
        /// Number of the end.
        end: usize,
    },
    /// It has no such part.
    #[error(
        "thread `{name}` has no such part: make a step with it, cut it between points that hold it, and tie it where two          points in tissue do"
    )]
    Short {
        /// Its name.
        name: String,
    },
}

/// What a point lets through: the larger tension is at most `factor` times the smaller plus `force` (N).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Hole {
    pub factor: f64,
    pub force: f64,
}

/// A segment of a thread: by how much (m) it would be stretched if nothing slid, and its stiffness (N/m).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Segment {
    pub stretch: f64,
    pub k: f64,
}

/// Slide `s` (m) out of a point towards the first as a falling function of the tension `t` (N) before it: straight between
/// corners `[t, s]`, upright above the first, beyond the last with this slope downwards (m/N), or upright without.
#[derive(Clone, Debug)]
struct Curve {
    corners: Vec<[f64; 2]>,
    beyond: Option<f64>,
}

impl Curve {
    /// Slide at a tension; the least of several.
    fn slide(&self, t: f64) -> f64 {
        let next = self.corners.partition_point(|corner| corner[0] <= t);
        let Some(&[t0, s0]) = next.checked_sub(1).and_then(|last| self.corners.get(last)) else {
            return f64::INFINITY;
        };
        match (self.corners.get(next), self.beyond) {
            (Some(&[t1, s1]), _) => s0 + (s1 - s0) * ((t - t0) / (t1 - t0)),
            (None, Some(slope)) => s0 - slope * (t - t0),
            (None, None) => f64::NEG_INFINITY,
        }
    }

    /// Tension at a slide.
    fn tension(&self, s: f64) -> f64 {
        let next = self.corners.partition_point(|corner| corner[1] >= s);
        let Some(&[t0, s0]) = next.checked_sub(1).and_then(|last| self.corners.get(last)) else {
            return self.corners[0][0];
        };
        match (self.corners.get(next), self.beyond) {
            (Some(&[t1, s1]), _) if s1.is_finite() => t0 + (t1 - t0) * ((s0 - s) / (s0 - s1)),
            (None, Some(slope)) => t0 + (s0 - s) / slope,
            _ => t0,
        }
    }

    /// The same with the tension behind a point for the one before it.
    fn through(&self, hole: Hole) -> Self {
        let Hole { factor, force } = hole;
        let less = |t: f64| ((t - force) / factor).max(0.0);
        let more = |t: f64| factor * t + force;
        let middle = self.tension(0.0);
        let mut corners = Vec::with_capacity(self.corners.len() + 2);
        // below what the point holds by itself nothing comes through it from behind
        let least = self.slide(force);
        corners.extend((least > 0.0).then_some([0.0, least]));
        let above = self.corners.iter().filter(|[t, s]| *t > force && *s > 0.0);
        corners.extend(above.map(|&[t, s]| [less(t), s]));
        corners.push([less(middle), 0.0]);
        corners.push([more(middle), 0.0]);
        let below = self.corners.iter().filter(|corner| corner[1] < 0.0);
        corners.extend(below.map(|&[t, s]| [more(t), s]));
        Self { corners, beyond: self.beyond.map(|slope| slope / factor) }
    }

    /// The same with the slide out of the next point for that out of the last, over a segment.
    fn along(mut self, segment: Segment) -> Self {
        let Segment { stretch, k } = segment;
        // what is slack lets pass any more
        let slack = self.corners.partition_point(|corner| corner[0] <= 0.0);
        self.corners.drain(..slack.saturating_sub(1));
        self.corners.iter_mut().for_each(|[t, s]| *s += stretch - *t / k);
        self.beyond = self.beyond.map(|slope| slope + 1.0 / k);
        self
    }
}

/// Tensions (N) of segments, and the slides (m) out of all points towards the first, that the points between them let be: the
/// first hole stands at the first point, the last one at the last. `free` says at which ends the thread slips through; it is
/// knotted at the others.
pub(crate) fn slides(
    segments: &[Segment],
    holes: &[Hole],
    free: [bool; 2],
) -> (Vec<f64>, Vec<f64>) {
    let n = segments.len();
    let (mut tension, mut slide) = (vec![0.0; n], vec![0.0; n + 1]);
    if n == 0 {
        return (tension, slide);
    }
    // before the first point a free end has no tension, a knot no slide
    let loose = Curve { corners: vec![[0.0, f64::NEG_INFINITY]], beyond: None };
    let knot = Curve { corners: vec![[0.0, 0.0]], beyond: Some(0.0) };
    let mut before = vec![if free[0] { loose.through(holes[0]) } else { knot }.along(segments[0])];
    for i in 1..n {
        let next = before[i - 1].through(holes[i]).along(segments[i]);
        before.push(next);
    }
    if free[1] {
        slide[n] = before[n - 1].slide(holes[n].force).max(0.0);
    }
    for i in (0..n).rev() {
        tension[i] = before[i].tension(slide[i + 1]).max(0.0);
        let needed = slide[i + 1] - segments[i].stretch;
        if i == 0 && !free[0] {
            break;
        }
        slide[i] = if tension[i] > 0.0 {
            needed + tension[i] / segments[i].k
        } else {
            // a slack segment gives what the tension before it draws, and takes nothing of itself
            let drawn = if i > 0 { before[i - 1].slide(holes[i].force) } else { 0.0 };
            drawn.max(0.0).min(needed)
        };
    }
    (tension, slide)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (*seed >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Every inequality holds, and whatever slides is at its limit, in random threads, slack ones and free ends among them.
    #[test]
    fn slides_fulfil_the_capstan_inequalities() {
        let (mut slid, mut stuck, mut slack) = (0, 0, 0);
        let mut seed = 7;
        for case in 0..4000 {
            let r = &mut seed;
            let n = 1 + case % 9;
            let segments: Vec<Segment> = (0..n)
                .map(|_| Segment { stretch: random(r) - 0.3, k: 0.5 + 10.0 * random(r) })
                .collect();
            let smooth = case % 3 == 0;
            let hole = |r: &mut u64| match smooth {
                true => Hole { factor: 1.0, force: 0.0 },
                false => Hole { factor: 1.0 + 2.0 * random(r), force: 0.3 * random(r) },
            };
            let holes: Vec<Hole> = (0..=n).map(|_| hole(r)).collect();
            let free = [case % 5 == 1, case % 7 == 1];
            let (t, s) = slides(&segments, &holes, free);
            for i in 0..n {
                let stretch = segments[i].stretch - (s[i + 1] - s[i]);
                let error = t[i] - segments[i].k * stretch.max(0.0);
                assert!(error.abs() < 1e-12, "{case} {i}: {t:?} {s:?}");
                slack += u32::from(t[i] == 0.0);
            }
            for i in 0..=n {
                let knotted = i == 0 && !free[0] || i == n && !free[1];
                if knotted {
                    assert_eq!(s[i], 0.0);
                    continue;
                }
                let before = if i > 0 { t[i - 1] } else { 0.0 };
                let behind = t.get(i).copied().unwrap_or(0.0);
                let Hole { factor, force } = holes[i];
                let [over, under] =
                    [before - (factor * behind + force), behind - (factor * before + force)];
                assert!(over < 1e-12 && under < 1e-12, "{case} {i}: {t:?} {s:?}");
                // towards the first where the tension is higher before the point
                let at_limit = if s[i] > 1e-9 { over } else { under };
                if s[i].abs() > 1e-9 {
                    assert!(at_limit.abs() < 1e-12, "{case} {i}: {t:?} {s:?}");
                    slid += 1;
                } else {
                    stuck += 1;
                }
            }
        }
        assert!(slid > 3000 && stuck > 3000 && slack > 300, "{slid} {stuck} {slack}");
    }
}
