//! What a blade leaves of a ten-node tetrahedron with straight sides: the same shape functions over a part of it, at four points
//! of its own.
//!
//! In coordinates in which the corners are the vectors `s_i = (1,1,1), (1,-1,-1), (-1,1,-1), (-1,-1,1)`, the material has the
//! mean `m` and the second moments `C` about it; the points are `m + C^(1/2) s_i`, a quarter of its volume each. Since
//! `sum_i s_i s_i^T = 4 I`, they integrate polynomials of second degree exactly, so the stiffness at rest, and the forces of
//! a uniform stress. Of a whole element they are its Gauss points. Which corner has which vector does not matter.

use glam::{DMat3, DVec3};
use sinew_engine::isoparametric::{Derivatives, tetrahedron10_derivatives, tetrahedron10_shape};
use sinew_engine::layout::Lumps;

use super::quadrature::{fine, square_root};

/// The vectors of the corners.
const CORNERS: [DVec3; 4] = [
    DVec3::new(1.0, 1.0, 1.0),
    DVec3::new(1.0, -1.0, -1.0),
    DVec3::new(-1.0, 1.0, -1.0),
    DVec3::new(-1.0, -1.0, 1.0),
];

/// A part of the material of an element: barycentric coordinates of the corners of a tetrahedron, and its part of the volume.
pub type Part = ([[f64; 4]; 4], f64);

/// Derivatives at the points of some material, and the parts of the volume (m^3) of the element `whole` that its vertices have
/// of it.
///
/// A vertex has the part of its mass that `int N_a^2` over the material is of that over the element, so that all masses
/// stay and none is negative. Weight is shared out by `int N_a`, as in whole elements, times what makes it add up to that of
/// these masses: what is loose falls as everything does.
pub fn piece(parts: &[Part], whole: f64) -> (Derivatives<f64, 10, 3, 4>, Lumps) {
    let place = |l: &[f64; 4]| (0..4).map(|i| l[i] * CORNERS[i]).sum::<DVec3>();
    let share: f64 = parts.iter().map(|part| part.1).sum();
    let mean = parts.iter().map(|(at, v)| at.iter().map(place).sum::<DVec3>() * (v / 4.0));
    let mean = mean.sum::<DVec3>() / share;
    let mut second = DMat3::ZERO;
    for (at, v) in parts {
        let at = at.map(|l| place(&l) - mean);
        let square = |x: DVec3| DMat3::from_cols(x * x.x, x * x.y, x * x.z);
        let sum =
            square(at.iter().sum()) + square(at[0]) + square(at[1]) + square(at[2]) + square(at[3]);
        second += sum * (v / (20.0 * share));
    }
    let root = square_root(second);
    let mut derivatives = Derivatives([[[0.0; 4]; 3]; 10]);
    for (q, s) in CORNERS.iter().enumerate() {
        let x = mean + root * *s;
        let own = tetrahedron10_derivatives(CORNERS.map(|s| (1.0 + s.dot(x)) / 4.0));
        for (a, d) in own.iter().enumerate() {
            (0..3).for_each(|j| derivatives.0[a][j][q] = d[j]);
        }
    }
    let mut lumps = Lumps::default();
    let rule = fine();
    for (at, v) in parts {
        for (l, w) in &rule {
            let inside = std::array::from_fn(|i| (0..4).map(|k| l[k] * at[k][i]).sum());
            for (a, n) in tetrahedron10_shape(inside).into_iter().enumerate() {
                // over a whole element int N_a^2 is 36/70 of these parts of the mass
                lumps.mass[a] += whole * v * w * n * n * (70.0 / 36.0);
                lumps.weight[a] += v * w * n;
            }
        }
    }
    let mass: f64 = lumps.mass.iter().sum();
    lumps.weight = lumps.weight.map(|weight| weight / share * mass);
    (derivatives, lumps)
}
