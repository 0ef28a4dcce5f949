//! What is shown of a recording, and where its ground is.

use crate::scene::{Field, Recording};
use glam::Vec3;

/// What is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Index of the field that gives colours; bodies have plain colours without.
    pub field: Option<usize>,
    /// Ground with grid and shadows.
    pub ground: bool,
    /// Shape at rest, once a body has left it.
    pub ghost: bool,
    /// Lines along sharp edges.
    pub edges: bool,
    /// Tools are of glass, so that they do not hide what they press on.
    pub glass: bool,
    /// Lowest height (m) along the upward axis: where the ground is.
    pub floor: f32,
    /// Middle of the scene (m).
    pub middle: Vec3,
    /// Half the side (m) of the square on the ground in which bodies and tools have shades.
    pub shade: f32,
    /// Distance (m) between grid lines.
    pub grid: f32,
}

impl Look {
    /// Ground under everything a recording shows, grid lines at a round distance.
    pub fn of(recording: &Recording, field: Option<usize>) -> Self {
        let up = recording.up;
        let (mut floor, mut low, mut high) = (f32::INFINITY, Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in recording.extent() {
            floor = floor.min(p.dot(up));
            (low, high) = (low.min(p), high.max(p));
        }
        let (middle, size) = (0.5 * (low + high), recording.size());
        let mut shade = 1.1 * size;
        for p in recording.tool_points() {
            floor = floor.min(p.dot(up));
            shade = shade.max(1.2 * (p - middle).reject_from(up).length());
        }
        let raw = 0.16 * size;
        let power = 10f32.powf(raw.log10().floor());
        let grid = [1.0, 2.0, 5.0, 10.0].map(|f| f * power).into_iter().find(|g| *g >= raw);
        Self {
            field,
            ground: true,
            ghost: true,
            edges: false,
            glass: field.and_then(|i| recording.fields.get(i)).is_some_and(Field::lies_under_tools),
            floor: floor - 0.02 * size,
            middle,
            shade,
            grid: grid.unwrap_or(raw),
        }
    }
}
