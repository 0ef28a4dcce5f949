//! A perspective camera that circles a scene and fits all of it into the free part of a picture.

use crate::error::RenderError;
use glam::camera::rh;
use glam::{Mat4, Vec3};

/// Tangent of half the vertical field of view: 28 degrees in all, little distortion.
const TAN_HALF: f32 = 0.249_328;

/// Where to look from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraRequest {
    /// On a circle around the scene, at the distance from which all of it is seen times a factor.
    Orbit {
        /// Angle (degrees) about the upward axis: 0 looks along +y with up = z, 90 along -x.
        azimuth: f32,
        /// Angle (degrees) above the horizon, -89 to 89.
        elevation: f32,
        /// Factor on the fitting distance.
        distance: f32,
    },
    /// From a place to a place (m).
    Fixed {
        /// Eye (m).
        eye: Vec3,
        /// What is in the middle of the picture (m).
        target: Vec3,
    },
}

impl Default for CameraRequest {
    fn default() -> Self {
        Self::Orbit { azimuth: 25.0, elevation: 18.0, distance: 1.0 }
    }
}

impl std::str::FromStr for CameraRequest {
    type Err = RenderError;

    /// `AZIMUTH,ELEVATION[,FACTOR]` or `EX,EY,EZ,TX,TY,TZ`.
    fn from_str(text: &str) -> Result<Self, RenderError> {
        let wrong = || {
            RenderError::Option {
            option: "--camera",
            found: text.into(),
            remedy: "give AZIMUTH,ELEVATION[,DISTANCE-FACTOR] in degrees, such as 25,18,1.1, or an eye and a \
                     target EX,EY,EZ,TX,TY,TZ in metres"
                .into(),
        }
        };
        let numbers: Result<Vec<f32>, _> = text.split(',').map(|x| x.trim().parse()).collect();
        let numbers = numbers.map_err(|_| wrong())?;
        if numbers.iter().any(|x: &f32| !x.is_finite()) {
            return Err(wrong());
        }
        match numbers[..] {
            [azimuth, elevation] if elevation.abs() <= 89.0 => {
                Ok(Self::Orbit { azimuth, elevation, distance: 1.0 })
            }
            [azimuth, elevation, distance] if elevation.abs() <= 89.0 && distance > 0.0 => {
                Ok(Self::Orbit { azimuth, elevation, distance })
            }
            [a, b, c, x, y, z] if [a, b, c] != [x, y, z] => {
                Ok(Self::Fixed { eye: Vec3::new(a, b, c), target: Vec3::new(x, y, z) })
            }
            _ => Err(wrong()),
        }
    }
}

/// Parts of width or height at the sides of a picture that are kept free for text.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Margins {
    /// Left, of the width.
    pub left: f32,
    /// Right, of the width.
    pub right: f32,
    /// Top, of the height.
    pub top: f32,
    /// Bottom, of the height.
    pub bottom: f32,
}

/// A camera in place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Eye (m).
    pub eye: Vec3,
    /// Unit vector to the right.
    pub right: Vec3,
    /// Unit vector upward in the picture.
    pub up: Vec3,
    /// Unit vector into the picture.
    pub forward: Vec3,
    /// Tangents of half the field of view, across and upright.
    pub tangents: [f32; 2],
    /// Depths (m) between which things are drawn.
    pub depth: [f32; 2],
}

impl Camera {
    /// Fits `points` (m) into a picture of this aspect ratio (width over height), inside its margins.
    ///
    /// The eye lies as near as the four sides of the view allow; where one pair of sides leaves room, the
    /// points are centred between them.
    ///
    /// # Errors
    /// When there is no point, or none that is finite.
    pub fn fit(
        request: CameraRequest,
        world_up: Vec3,
        points: impl Iterator<Item = Vec3> + Clone,
        aspect: f32,
        margins: Margins,
    ) -> Result<Self, RenderError> {
        let world_up = world_up.try_normalize().unwrap_or(Vec3::Z);
        let forward = match request {
            CameraRequest::Orbit { azimuth, elevation, .. } => {
                // the horizontal axes: those of the world where up is z
                let side = if world_up.y.abs() > 0.9 { Vec3::Z } else { Vec3::Y };
                let ahead = (side - world_up * side.dot(world_up)).normalize();
                let right = ahead.cross(world_up);
                let (a, e) = (azimuth.to_radians(), elevation.to_radians());
                (ahead * a.cos() - right * a.sin()) * e.cos() - world_up * e.sin()
            }
            CameraRequest::Fixed { eye, target } => (target - eye).normalize(),
        };
        let right = forward
            .cross(world_up)
            .try_normalize()
            .unwrap_or_else(|| forward.any_orthonormal_vector());
        let up = right.cross(forward);
        let tangents = [TAN_HALF * aspect, TAN_HALF];
        let local = |p: Vec3| Vec3::new(p.dot(right), p.dot(up), p.dot(forward));
        let finite = points.filter(|p| p.is_finite()).map(local);
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in finite.clone() {
            (low, high) = (low.min(p), high.max(p));
        }
        if low.x > high.x {
            return Err(RenderError::Empty("no point to look at".into()));
        }
        let size = (high - low).length().max(1e-6);
        let eye = match request {
            CameraRequest::Fixed { eye, .. } => local(eye),
            CameraRequest::Orbit { distance, .. } => {
                let middle = 0.5 * (low + high);
                // sides of the free part as tangents: low, high across; low, high upright
                let sides = [
                    [1.0 - 2.0 * margins.left, 1.0 - 2.0 * margins.right].map(|s| s * tangents[0]),
                    [1.0 - 2.0 * margins.bottom, 1.0 - 2.0 * margins.top].map(|s| s * tangents[1]),
                ];
                let mut reach = [[f32::NEG_INFINITY; 2]; 2];
                for p in finite.clone() {
                    let p = p - middle;
                    for k in 0..2 {
                        reach[k][0] = reach[k][0].max(-p[k] - sides[k][0] * p.z);
                        reach[k][1] = reach[k][1].max(p[k] - sides[k][1] * p.z);
                    }
                }
                let depth = |k: usize| -(reach[k][0] + reach[k][1]) / (sides[k][0] + sides[k][1]);
                // never so near that the picture is but a surface
                let z = depth(0).min(depth(1)).min(low.z - middle.z - 0.3 * size);
                let mut fitted = Vec3::new(0.0, 0.0, z);
                for k in 0..2 {
                    let from = reach[k][1] + sides[k][1] * z;
                    let to = -reach[k][0] - sides[k][0] * z;
                    fitted[k] = 0.5 * (from + to);
                    // room on either side is the same in the picture: secants, as depths differ
                    let aim = 0.5 * (sides[k][1] - sides[k][0]);
                    for _ in 0..12 {
                        let (mut least, mut most) =
                            ([f32::INFINITY, 1.0], [f32::NEG_INFINITY, 1.0]);
                        for p in finite.clone() {
                            let p = p - middle - fitted;
                            let x = p[k] / p.z;
                            least = if x < least[0] { [x, p.z] } else { least };
                            most = if x > most[0] { [x, p.z] } else { most };
                        }
                        let slope = 0.5 * (1.0 / least[1] + 1.0 / most[1]);
                        fitted[k] += (0.5 * (least[0] + most[0]) - aim) / slope;
                    }
                    fitted[k] = fitted[k].clamp(from.min(to), from.max(to));
                }
                // further away along the line to the middle
                middle + fitted * Vec3::new(1.0, 1.0, distance)
            }
        };
        // the ground and markers reach a little further
        let near = (low.z - eye.z - 0.3 * size).max(0.02 * size);
        let far = (high.z - eye.z + size).max(2.0 * near);
        let eye = right * eye.x + up * eye.y + forward * eye.z;
        Ok(Self { eye, right, up, forward, tangents, depth: [near, far] })
    }

    /// From world to clip space, depth 0 to 1.
    pub fn matrix(&self) -> Mat4 {
        let view = rh::view::look_to_mat4(self.eye, self.forward, self.up);
        let [x, y] = self.tangents;
        let [near, far] = self.depth;
        rh::proj::directx::perspective(2.0 * y.atan(), x / y, near, far) * view
    }

    /// Where a point appears: 0 to 1 from left to right and from top to bottom.
    pub fn project(&self, p: Vec3) -> [f32; 2] {
        let p = self.matrix().project_point3(p);
        [0.5 + 0.5 * p.x, 0.5 - 0.5 * p.y]
    }
}
