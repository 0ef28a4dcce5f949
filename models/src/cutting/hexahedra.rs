//! What a blade leaves of a hexahedron: the same shape functions over a part of it, at eight points of its own.
//!
//! Material is divided in local coordinates, where a hexahedron is a cube; its faces there are those of its neighbours. From
//! points of positive weight in each part eight are left ([`eliminate`]) that have the same moments. Their gradients get what
//! makes their mean that of the shape functions over the material, which is what forces of a uniform stress follow from,
//! in distorted hexahedra, too:
//!
//! ```text
//! G_qa = dN_a/dX(q) + 1/V (int dN_a/dX dV - sum_q v_q dN_a/dX(q))      sum_q v_q = V
//! ```

use glam::{DMat3, DVec3};
use sinew_engine::isoparametric::{
    CORNERS, Derivatives, TETRAHEDRON_POINTS, hexahedron_derivatives, hexahedron_shape,
};
use sinew_engine::layout::Lumps;

use super::quadrature::{eliminate, fine};

/// Rest shape of some material of a hexahedron.
pub(super) struct Piece {
    /// Gradients (1/m) of the shape functions at the points.
    pub gradients: Derivatives<f64, 8, 3, 8>,
    /// Volumes (m^3) of the points.
    pub volume: [f64; 8],
    /// Volumes (m^3) of the vertices, `int N_a dV`.
    pub lumps: Lumps,
}

/// Apex and six tetrahedra of a hexahedron: over the faces that do not have its first vertex in the order of the mesh, each
/// cut from its own first vertex, so that neighbours agree.
pub(super) fn tetrahedra(vertices: &[u32; 8]) -> [[u32; 4]; 6] {
    let apex = *vertices.iter().min().unwrap_or(&0);
    let faces = sinew_engine::isoparametric::HEXAHEDRON_FACES.map(|face| face.map(|i| vertices[i]));
    let far = faces.iter().filter(|face| !face.contains(&apex));
    let halves = far.flat_map(|face| {
        let first = (0..4).min_by_key(|&k| face[k]).unwrap_or(0);
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| face[(first + k) % 4]);
        [[apex, a, b, c], [apex, a, c, d]]
    });
    let mut all = [[apex; 4]; 6];
    all.iter_mut().zip(halves).for_each(|(to, half)| *to = half);
    all
}

/// Place in the cube of a point between some vertices; on a face of the cube to the last bit where all of these are.
pub(super) fn local(vertices: &[u32; 8], point: &super::material::Point) -> DVec3 {
    let corner = |v: u32| {
        vertices
            .iter()
            .position(|&own| own == v)
            .map_or(DVec3::ZERO, |i| DVec3::from_array(CORNERS[i]))
    };
    let used = || point.vertices.iter().zip(point.weights).filter(|(_, w)| *w != 0.0);
    let corners = || used().map(|(&v, _)| corner(v));
    let low = corners().fold(DVec3::ONE, DVec3::min);
    let high = corners().fold(-DVec3::ONE, DVec3::max);
    used().map(|(&v, w)| w * corner(v)).sum::<DVec3>().clamp(low, high.max(low))
}

/// Gradients (1/m) of the shape functions of a hexahedron of the corners `rest` (m) at a place in the cube, and the Jacobian.
fn gradients(rest: &[DVec3; 8], at: DVec3) -> ([DVec3; 8], f64) {
    let by = hexahedron_derivatives(at.to_array()).map(DVec3::from_array);
    let column = |j: usize| (0..8).map(|a| by[a][j] * (rest[a] - rest[0])).sum();
    let jacobian = DMat3::from_cols(column(0), column(1), column(2));
    let inverse = jacobian.inverse().transpose();
    (by.map(|d| inverse * d), jacobian.determinant())
}

/// Rest shape of the material in these tetrahedra of the cube.
pub(super) fn piece(parts: &[[DVec3; 4]], rest: &[DVec3; 8]) -> Piece {
    let mut lumps = Lumps::default();
    let (mut volume, mut mean) = (0.0, [DVec3::ZERO; 8]);
    let mut points = Vec::new();
    let exact = fine();
    for part in parts {
        let size = (part[1] - part[0]).cross(part[2] - part[0]).dot(part[3] - part[0]) / 6.0;
        let place = |l: &[f64; 4]| (0..4).map(|i| l[i] * part[i]).sum::<DVec3>();
        for (l, w) in &exact {
            let (own, jacobian) = gradients(rest, place(l));
            let v = w * size * jacobian;
            volume += v;
            (0..8).for_each(|a| mean[a] += v * own[a]);
            for (a, n) in hexahedron_shape(place(l).to_array()).into_iter().enumerate() {
                lumps.mass[a] += v * n;
            }
        }
        points.extend(TETRAHEDRON_POINTS.iter().map(|l| {
            let x = place(l);
            (x, size * gradients(rest, x).1 / 4.0)
        }));
    }
    lumps.weight = lumps.mass;
    let few = eliminate(&points);
    let all: f64 = few.iter().map(|(_, w)| w).sum();
    let first = few.first().map_or(DVec3::ZERO, |point| point.0);
    let mut piece = Piece { gradients: Derivatives([[[0.0; 8]; 3]; 8]), volume: [0.0; 8], lumps };
    let at: [[DVec3; 8]; 8] = std::array::from_fn(|q| {
        let (x, w) = few.get(q).copied().unwrap_or((first, 0.0));
        piece.volume[q] = w / all * volume;
        gradients(rest, x).0
    });
    for a in 0..8 {
        let found: DVec3 = (0..8).map(|q| piece.volume[q] * at[q][a]).sum();
        let more = (mean[a] - found) / volume;
        for q in 0..8 {
            (0..3).for_each(|j| piece.gradients.0[a][j][q] = (at[q][a] + more)[j]);
        }
    }
    piece
}
