//! Shapes of tools: signed distance, negative inside, and its gradient, in the frame of the shape.

use crate::field::DistanceField;
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Shape of a tool or of one of its parts. Lengths in metres, in the shape's own frame, whose origin is its centre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Radius (m).
        radius: f64,
    },
    /// A rod with round ends along the x axis.
    Capsule {
        /// Half the distance between the centres of its ends (m).
        half_length: f64,
        /// Radius (m).
        radius: f64,
    },
    /// A box with rounded edges.
    Box {
        /// Half sizes (m), rounding included.
        half: DVec3,
        /// Radius of its edges (m). Points deeper than that are pushed out through the wrong side, so it should
        /// be several times the penetration.
        rounding: f64,
    },
    /// All points with `z <= 0`: a table or floor whose normal is the z axis.
    HalfSpace,
    /// A closed mesh.
    Field(Arc<DistanceField>),
    /// The sides of a blade that cuts along the x axis and whose edge is along the y axis: thickest in the middle, without
    /// thickness at its rim. They touch the faces of solids that are turned towards them, such as the lips of a wound, and push
    /// each to its own side, and touch nothing else ([`Edge::flanks`](crate::edge::Edge::flanks)).
    Blade {
        /// Half sizes (m) along x and y.
        half: DVec2,
        /// Thickness (m) in the middle.
        thickness: f64,
    },
}

/// Least cosine between the direction across a blade and the normal of a face that its sides touch.
const FACING: f64 = 0.5;

impl Shape {
    /// The error in its sizes, if there is one.
    pub fn problem(&self) -> Option<String> {
        let positive = |what: &str, x: f64| {
            (!(x > 0.0 && x.is_finite()))
                .then(|| format!("its {what} is {x} m: it must be positive and finite"))
        };
        match self {
            Self::Sphere { radius } => positive("radius", *radius),
            Self::Capsule { half_length, radius } => {
                positive("radius", *radius).or_else(|| positive("half length", *half_length))
            }
            Self::Box { half, rounding } => {
                let smallest = half.min_element();
                positive("half size", smallest)
                    .or_else(|| positive("half size", half.max_element()))
                    .or_else(|| positive("rounding", *rounding))
                    .or_else(|| {
                        (*rounding > smallest).then(|| {
                            format!(
                                "its rounding is {rounding} m: it can be at most its smallest half size, \
                                 {smallest} m"
                            )
                        })
                    })
            }
            Self::Blade { half, thickness } => positive("thickness", *thickness)
                .or_else(|| positive("half size", half.min_element())),
            Self::HalfSpace | Self::Field(_) => None,
        }
    }

    /// Half the thickness (m) of a blade at a place, and its gradient; none beside the blade.
    fn half_thickness(half: DVec2, thickness: f64, y: DVec3) -> Option<(f64, DVec2)> {
        let at = DVec2::new(y.x, y.y) / half;
        let left = DVec2::ONE - at * at;
        let middle = 0.5 * thickness;
        let slope = -2.0 * middle * at * DVec2::new(left.y, left.x) / half;
        (left.min_element() > 0.0).then_some((middle * left.x * left.y, slope))
    }

    /// Signed distance (m) from a side of a blade to a point of a face whose outward normal is `outward`, and its gradient; none where
    /// the face is turned to no side, or this is no blade.
    pub(crate) fn side_distance(&self, y: DVec3, outward: DVec3) -> Option<(f64, DVec3)> {
        let Self::Blade { half, thickness } = self else { return None };
        if outward.z.abs() < FACING {
            return Some((f64::INFINITY, DVec3::Z));
        }
        let Some((height, slope)) = Self::half_thickness(*half, *thickness, y) else {
            return Some((f64::INFINITY, DVec3::Z));
        };
        // the solid behind the face is on that side
        let side = -outward.z.signum();
        Some((side * y.z - height, DVec3::new(-slope.x, -slope.y, side)))
    }

    /// Signed distance (m) at `y`, negative inside, and its gradient, of length one for all but fields.
    #[inline]
    pub fn distance(&self, y: DVec3) -> (f64, DVec3) {
        let round = |arm: DVec3, radius: f64| {
            let length = arm.length();
            // in the very middle any direction is as good
            let normal = if length > 0.0 { arm / length } else { DVec3::Z };
            (length - radius, normal)
        };
        match self {
            Self::Sphere { radius } => round(y, *radius),
            Self::Capsule { half_length, radius } => {
                let along = y.x.clamp(-half_length, *half_length);
                round(y - DVec3::new(along, 0.0, 0.0), *radius)
            }
            Self::Box { half, rounding } => {
                let sign = DVec3::new(sign(y.x), sign(y.y), sign(y.z));
                let q = y.abs() - (*half - DVec3::splat(*rounding));
                let deepest = q.max_element();
                if deepest > 0.0 {
                    let (distance, normal) = round(q.max(DVec3::ZERO), *rounding);
                    (distance, sign * normal)
                } else {
                    let axis = if q.x == deepest {
                        DVec3::X
                    } else if q.y == deepest {
                        DVec3::Y
                    } else {
                        DVec3::Z
                    };
                    (deepest - rounding, sign * axis)
                }
            }
            Self::HalfSpace => (y.z, DVec3::Z),
            Self::Field(field) => field.distance(y),
            Self::Blade { half, thickness } => match Self::half_thickness(*half, *thickness, y) {
                Some((height, slope)) => {
                    (y.z.abs() - height, DVec3::new(-slope.x, -slope.y, sign(y.z)))
                }
                None => {
                    let beyond = (y.truncate().abs() - half).max(DVec2::ZERO);
                    let sides = DVec2::new(sign(y.x), sign(y.y));
                    round((beyond * sides).extend(y.z), 0.0)
                }
            },
        }
    }

    /// Distance (m) from a point inside along the unit vector `along` to the surface, and the gradient of the signed
    /// distance there. The surface is found by steps of the distance, which never pass it.
    pub fn way_out(&self, from: DVec3, along: DVec3) -> (f64, DVec3) {
        let mut way = 0.0;
        let mut gradient = along;
        let size = self.thickness().min(1e6);
        for _ in 0..200 {
            let (distance, now) = self.distance(from + way * along);
            gradient = now;
            if distance >= -1e-12 * size {
                return (way, gradient);
            }
            // near the surface the distance along a slanting ray is longer than the way to the surface
            let slope = now.dot(along);
            let newton = if slope > 0.1 { -distance / slope } else { -distance };
            let (beyond, at) = self.distance(from + (way + newton) * along);
            if beyond.abs() < 1e-12 * size {
                return (way + newton, at);
            }
            way += if beyond < 0.0 { newton } else { -distance };
        }
        // a ray that leaves at a small angle to the surface: the steps have become too short, so halve a bracket
        let ahead = |way: f64| self.distance(from + way * along);
        let step = -ahead(way).0;
        let farther = std::iter::successors(Some(step), |step| Some(2.0 * step)).take(60);
        let outside = farther.map(|step| way + step).find(|&way| ahead(way).0 >= 0.0);
        if let Some(mut outside) = outside {
            for _ in 0..100 {
                let middle = 0.5 * (way + outside);
                if ahead(middle).0 < 0.0 { way = middle } else { outside = middle }
            }
            (way, gradient) = (outside, ahead(outside).1);
        }
        (way, gradient)
    }

    /// Radius (m) of the ball round the centre of the frame that holds it.
    pub fn reach(&self) -> f64 {
        match self {
            Self::Sphere { radius } => *radius,
            Self::Capsule { half_length, radius } => half_length + radius,
            Self::Box { half, .. } => half.length(),
            Self::Blade { half, thickness } => half.extend(0.5 * thickness).length(),
            Self::HalfSpace => f64::INFINITY,
            Self::Field(field) => {
                let [low, high] = field.bounds();
                low.abs().max(high.abs()).length()
            }
        }
    }

    /// Half of its smallest extent (m). It decides how dense the points of a surface have to be, and how far the shape
    /// may move at once.
    pub fn thickness(&self) -> f64 {
        match self {
            Self::Sphere { radius } | Self::Capsule { radius, .. } => *radius,
            Self::Box { half, .. } => half.min_element(),
            // which side a point belongs to is known, however thin it is
            Self::Blade { half, .. } => half.min_element(),
            Self::HalfSpace => f64::INFINITY,
            Self::Field(field) => {
                let [low, high] = field.bounds();
                0.5 * (high - low).min_element()
            }
        }
    }

    /// Distance (m) of the points between which its distance is interpolated; 0 where it is known.
    pub(crate) fn cell(&self) -> f64 {
        if let Self::Field(field) = self { field.spacing() } else { 0.0 }
    }

    /// The axis-parallel box (m) that holds it when it stands at `centre`, turned by `rotation`; infinite for a
    /// half-space.
    pub fn bounds(&self, centre: DVec3, rotation: DQuat) -> [DVec3; 2] {
        let (middle, half) = match self {
            Self::Sphere { radius } => (DVec3::ZERO, DVec3::splat(*radius)),
            Self::Capsule { half_length, radius } => {
                let axis = (rotation * DVec3::X).abs() * *half_length;
                return [centre - axis - *radius, centre + axis + *radius];
            }
            Self::Box { half, rounding } => {
                let inner = *half - DVec3::splat(*rounding);
                let [low, high] = turned(centre, rotation, inner);
                return [low - *rounding, high + *rounding];
            }
            Self::Blade { half, thickness } => (DVec3::ZERO, half.extend(0.5 * thickness)),
            Self::HalfSpace => {
                return [DVec3::splat(f64::NEG_INFINITY), DVec3::splat(f64::INFINITY)];
            }
            Self::Field(field) => {
                let [low, high] = field.bounds();
                (0.5 * (low + high), 0.5 * (high - low))
            }
        };
        let centre = centre + rotation * middle;
        if matches!(self, Self::Sphere { .. }) {
            return [centre - half, centre + half];
        }
        turned(centre, rotation, half)
    }
}

/// The axis-parallel box round a box of half sizes `half` that is turned.
fn turned(centre: DVec3, rotation: DQuat, half: DVec3) -> [DVec3; 2] {
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| (rotation * axis).abs());
    let half = x * half.x + y * half.y + z * half.z;
    [centre - half, centre + half]
}

/// `1` or `-1`, never `0`.
fn sign(x: f64) -> f64 {
    if x < 0.0 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shapes() -> Vec<Shape> {
        vec![
            Shape::Sphere { radius: 0.7 },
            Shape::Capsule { half_length: 0.8, radius: 0.4 },
            Shape::Box { half: DVec3::new(0.9, 0.5, 0.7), rounding: 0.3 },
            Shape::HalfSpace,
        ]
    }

    proptest! {
        #[test]
        fn gradients_are_derivatives(x in -2.0..2.0, y in -2.0..2.0, z in -2.0..2.0) {
            for shape in shapes() {
                let at = DVec3::new(x, y, z);
                let (distance, gradient) = shape.distance(at);
                prop_assert!((gradient.length() - 1.0).abs() < 1e-12);
                // away from where sides meet inside
                if distance < -0.25 {
                    continue;
                }
                let h = 1e-6;
                for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                    let difference =
                        (shape.distance(at + h * axis).0 - shape.distance(at - h * axis).0) / (2.0 * h);
                    prop_assert!((difference - gradient.dot(axis)).abs() < 1e-5, "{shape:?} {at}");
                }
            }
        }

        #[test]
        fn the_way_out_ends_on_the_surface(
            x in -0.5..0.5, y in -0.3..0.3, z in -0.3..0.3, turn in 0.0..6.2, height in -0.9..0.9,
        ) {
            let across = f64::sqrt(1.0 - height * height);
            let along = DVec3::new(across * libm::cos(turn), across * libm::sin(turn), height);
            for shape in &shapes()[..3] {
                let from = DVec3::new(x, y, z);
                if shape.distance(from).0 < 0.0 {
                    let (way, gradient) = shape.way_out(from, along);
                    prop_assert!(shape.distance(from + way * along).0.abs() < 1e-9, "{shape:?} {from}");
                    prop_assert!(gradient.dot(along) > 0.0);
                }
            }
        }
    }

    /// The distance from a side has its gradient, both sides are alike, and a face on the wrong side is drawn back.
    #[test]
    fn sides_of_a_blade_push_each_face_to_its_own_side() {
        let blade = Shape::Blade { half: DVec2::new(0.9, 0.5), thickness: 0.2 };
        let h = 1e-6;
        for i in 0..200 {
            let turn = f64::from(i) * 2.399_963;
            let at = DVec3::new(
                0.8 * libm::cos(turn),
                0.4 * libm::sin(turn),
                0.003 * f64::from(i - 100),
            );
            for side in [-1.0, 1.0] {
                let of = |y| blade.side_distance(y, DVec3::new(0.3, 0.2, -side)).unwrap();
                let (distance, gradient) = of(at);
                assert!(gradient.z * side > 0.0);
                let height = 0.1 * (1.0 - at.x * at.x / 0.81) * (1.0 - at.y * at.y / 0.25);
                assert!((distance - (side * at.z - height)).abs() < 1e-12);
                for axis in DVec3::AXES {
                    let difference = (of(at + h * axis).0 - of(at - h * axis).0) / (2.0 * h);
                    assert!((difference - gradient.dot(axis)).abs() < 1e-6, "{at}");
                }
                // the same as for any point where it is on its own side
                if at.z * side > 0.0 {
                    assert!((blade.distance(at).0 - distance).abs() < 1e-12);
                }
            }
            // beside it, and faces that are turned elsewhere
            assert_eq!(
                blade.side_distance(at + DVec3::X * 1.8, DVec3::Z).unwrap().0,
                f64::INFINITY
            );
            assert_eq!(blade.side_distance(at, DVec3::X).unwrap().0, f64::INFINITY);
        }
        let beside = blade.distance(DVec3::new(1.2, 0.9, 0.0));
        assert!(
            (beside.0 - 0.5).abs() < 1e-12
                && (beside.1 - DVec3::new(0.6, 0.8, 0.0)).length() < 1e-12
        );
        assert_eq!(Shape::HalfSpace.side_distance(DVec3::ZERO, DVec3::Z), None);
    }

    #[test]
    fn bounds_hold_the_shape() {
        let rotation = DQuat::from_xyzw(0.1, 0.5, -0.3, 0.7).normalize();
        let centre = DVec3::new(3.0, -1.0, 2.0);
        for shape in &shapes()[..3] {
            let [low, high] = shape.bounds(centre, rotation);
            let mut reached = [false; 2];
            for i in 0..40_000 {
                let t = f64::from(i) * 2.399_963;
                let height = 1.0 - 2.0 * (f64::from(i) + 0.5) / 40_000.0;
                let across = f64::sqrt(1.0 - height * height);
                let along = DVec3::new(across * libm::cos(t), across * libm::sin(t), height);
                let (way, _) = shape.way_out(DVec3::ZERO, along);
                let at = centre + rotation * (way * along);
                assert!((at - low).min_element() > -1e-9 && (high - at).min_element() > -1e-9);
                reached[0] |= (at - low).min_element() < 0.02;
                reached[1] |= (high - at).min_element() < 0.02;
            }
            assert_eq!(reached, [true; 2], "{shape:?}");
        }
    }

    #[test]
    fn shapes_without_size_are_named() {
        assert!(Shape::Sphere { radius: 0.0 }.problem().unwrap().contains("radius is 0 m"));
        let problem = Shape::Box { half: DVec3::ONE, rounding: 2.0 }.problem().unwrap();
        assert!(problem.contains("at most its smallest half size"), "{problem}");
        assert_eq!(Shape::HalfSpace.problem(), None);
        let blade = Shape::Blade { half: DVec2::ONE, thickness: 0.0 };
        assert!(blade.problem().unwrap().contains("thickness is 0 m"));
    }
}
