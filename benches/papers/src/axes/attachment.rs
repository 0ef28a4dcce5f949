//! Where an axis through the barycentre meets the faces of its element, as fixed weights of the vertices
//! (Bourguignon & Cani 2000, sections 3.1 and 4.1): barycentric on the faces of a tetrahedron, bilinear on
//! those of a hexahedron.

use glam::DVec3;

/// Local vertices of the faces of a hexahedron, each in cyclic order. Vertices 0 to 3 go round the bottom,
/// 4 to 7 lie above them.
pub const HEXAHEDRON_FACES: [[usize; 4]; 6] =
    [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

/// Ends of an axis on the faces of an element of `N` vertices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attachment<const N: usize> {
    /// Weights of the vertices at the end in the direction of the axis; they sum up to 1.
    pub plus: [f64; N],
    /// Weights at the other end.
    pub minus: [f64; N],
    /// Distance of the ends at rest (m).
    pub length: f64,
}

impl<const N: usize> Attachment<N> {
    /// `plus - minus`: the chord is `sum_j spread_j x_j`, and a force on its plus end with the opposite one
    /// on its minus end is spread in these shares, which keeps resultant and moment.
    pub fn spread(&self) -> [f64; N] {
        std::array::from_fn(|j| self.plus[j] - self.minus[j])
    }
}

fn mean(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len() as f64
}

/// Ends of the axis `axis` (any length) in the tetrahedron `points` (m); `None` where one of both is
/// degenerate.
///
/// ```
/// use glam::DVec3;
/// use sinew_papers::axes::attachment::tetrahedron;
/// let corner = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
/// let ends = tetrahedron(corner, DVec3::Z).unwrap();
/// // down to the bottom face, and up to the slanted one at x = y = 1/4
/// assert_eq!(ends.minus, [0.5, 0.25, 0.25, 0.0]);
/// assert_eq!(ends.plus, [0.0, 0.25, 0.25, 0.5]);
/// assert_eq!(ends.length, 0.5);
/// ```
pub fn tetrahedron(points: [DVec3; 4], axis: DVec3) -> Option<Attachment<4>> {
    let axis = axis.try_normalize()?;
    let [a, b, c] = [points[1] - points[0], points[2] - points[0], points[3] - points[0]];
    let six = a.dot(b.cross(c));
    if six == 0.0 {
        return None;
    }
    // barycentric coordinates change by this per metre along the axis
    let [b1, b2, b3] = [b.cross(c), c.cross(a), a.cross(b)].map(|n| n.dot(axis) / six);
    let rate = [-(b1 + b2 + b3), b1, b2, b3];
    let end = |sign: f64| {
        // the coordinate that reaches zero first
        let reach = |j: &usize| 0.25 / (-sign * rate[*j]);
        let falling = (0..4).filter(|&j| sign * rate[j] < 0.0);
        let first = falling.min_by(|i, j| reach(i).total_cmp(&reach(j)))?;
        let mut weights: [f64; 4] =
            std::array::from_fn(|j| (0.25 + sign * rate[j] * reach(&first)).max(0.0));
        weights[first] = 0.0;
        Some((weights, reach(&first)))
    };
    let ((plus, up), (minus, down)) = (end(1.0)?, end(-1.0)?);
    let attachment = Attachment { plus, minus, length: up + down };
    attachment.length.is_finite().then_some(attachment)
}

/// Ends of the axis `axis` (any length) in the hexahedron `points` (m, in the order of
/// [`HEXAHEDRON_FACES`]); `None` where an end lies on no face or the axis has no direction.
///
/// ```
/// use glam::DVec3;
/// use sinew_papers::axes::attachment::hexahedron;
/// let square = |z| [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)].map(|(x, y)| DVec3::new(x, y, z));
/// let [bottom, top] = [square(0.0), square(4.0)];
/// let points: Vec<DVec3> = bottom.into_iter().chain(top).collect();
/// let ends = hexahedron(points.try_into().unwrap(), DVec3::Z).unwrap();
/// assert_eq!(ends.plus, [0.0, 0.0, 0.0, 0.0, 0.25, 0.25, 0.25, 0.25]);
/// assert_eq!(ends.length, 4.0);
/// ```
pub fn hexahedron(points: [DVec3; 8], axis: DVec3) -> Option<Attachment<8>> {
    let axis = axis.try_normalize()?;
    let centre = mean(&points);
    let (e, f) = axis.any_orthonormal_pair();
    let flat = |x: DVec3| [e.dot(x), f.dot(x)];
    let mut ends: [Option<([f64; 8], f64)>; 2] = [None; 2];
    for face in HEXAHEDRON_FACES {
        let [a, b, c, d] = face.map(|v| points[v] - centre);
        // w = [z h, (1-z) h, (1-z)(1-h), z (1-h)] on a, b, c, d
        for [z, h] in bilinear_roots(flat(c), flat(d - c), flat(b - c), flat(a - b + c - d)) {
            let w = [z * h, (1.0 - z) * h, (1.0 - z) * (1.0 - h), z * (1.0 - h)];
            // on ties of two faces rounding may put the end just outside either
            if w.iter().any(|&w| w < -1e-9) || !(z.is_finite() && h.is_finite()) {
                continue;
            }
            let distance = axis.dot(a * w[0] + b * w[1] + c * w[2] + d * w[3]);
            let end = &mut ends[usize::from(distance < 0.0)];
            if end.is_none_or(|(_, known)| distance.abs() < known) {
                let mut weights = [0.0; 8];
                for (v, w) in face.into_iter().zip(w) {
                    weights[v] = w;
                }
                *end = Some((weights, distance.abs()));
            }
        }
    }
    let [(plus, up), (minus, down)] = [ends[0]?, ends[1]?];
    (up + down > 0.0).then_some(Attachment { plus, minus, length: up + down })
}

/// Solutions `[z, h]` of `p + z q + h r + z h s = 0` in the plane, at most two.
fn bilinear_roots(p: [f64; 2], q: [f64; 2], r: [f64; 2], s: [f64; 2]) -> Vec<[f64; 2]> {
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    // h eliminated: (p + z q) x (r + z s) = 0
    let (c, b, a) = (cross(p, r), cross(p, s) + cross(q, r), cross(q, s));
    let size = a.abs().max(b.abs()).max(c.abs());
    if size == 0.0 {
        return Vec::new();
    }
    let mut roots: Vec<f64> = Vec::new();
    if a.abs() <= 1e-13 * size {
        roots.push(-c / b);
    } else {
        let square = b * b - 4.0 * a * c;
        if square < 0.0 {
            return Vec::new();
        }
        // without cancellation
        let half = -0.5 * (b + square.sqrt().copysign(b));
        roots.push(half / a);
        if half != 0.0 {
            roots.push(c / half);
        }
    }
    let other = |z: f64| {
        let (u, v) = ([p[0] + z * q[0], p[1] + z * q[1]], [r[0] + z * s[0], r[1] + z * s[1]]);
        -(u[0] * v[0] + u[1] * v[1]) / (v[0] * v[0] + v[1] * v[1])
    };
    roots.into_iter().map(|z| [z, other(z)]).collect()
}
