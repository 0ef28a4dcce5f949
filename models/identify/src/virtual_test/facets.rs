//! Facets of a mesh, and nodal forces of tractions.

use crate::cells::Cells;
use crate::geometry::{cross, norm, sub};

/// Facets of hexahedra, nodes running round.
const HEXAHEDRON_FACES: [[usize; 4]; 6] =
    [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

/// Facets (edges of plane elements, triangles or quadrilaterals of solids) whose nodes are all in `nodes`.
///
/// On a flat end of a body these are the facets of its surface there. Facets that two elements share
/// come once.
pub fn facets_within(cells: &Cells<'_>, nodes: &[usize]) -> Vec<Vec<u32>> {
    let mut found: Vec<(Vec<u32>, Vec<u32>)> = Vec::new();
    let mut sorted = nodes.to_vec();
    sorted.sort_unstable();
    let within = |node: &u32| sorted.binary_search(&(*node as usize)).is_ok();
    let mut take = |facet: Vec<u32>| {
        if facet.iter().all(within) {
            let mut key = facet.clone();
            key.sort_unstable();
            found.push((key, facet));
        }
    };
    for t in cells.triangles {
        (0..3).for_each(|i| take(vec![t[i], t[(i + 1) % 3]]));
    }
    for q in cells.quads {
        (0..4).for_each(|i| take(vec![q[i], q[(i + 1) % 4]]));
    }
    for t in cells.tetrahedra {
        (0..4).for_each(|i| take((0..4).filter(|&j| j != i).map(|j| t[j]).collect()));
    }
    for h in cells.hexahedra {
        HEXAHEDRON_FACES.iter().for_each(|f| take(f.map(|i| h[i]).to_vec()));
    }
    found.sort();
    found.dedup_by(|a, b| a.0 == b.0);
    found.into_iter().map(|f| f.1).collect()
}

/// Consistent nodal forces (N) of the constant traction `traction` (Pa) on `facets`; edges of plane
/// bodies have the thickness `thickness` (m).
///
/// ```
/// use sinew_identify::virtual_test::facets::traction_forces;
///
/// let points = [[0.0; 3], [0.0, 2.0, 0.0]];
/// let forces = traction_forces(&points, &[vec![0, 1]], [10.0, 0.0, 0.0], 0.1);
/// assert_eq!(forces, [(0, [1.0, 0.0, 0.0]), (1, [1.0, 0.0, 0.0])]);
/// ```
pub fn traction_forces(
    points: &[[f64; 3]],
    facets: &[Vec<u32>],
    traction: [f64; 3],
    thickness: f64,
) -> Vec<(usize, [f64; 3])> {
    let mut forces = Vec::new();
    for facet in facets {
        let at = |i: usize| points[facet[i] as usize];
        let areas: Vec<f64> = match facet.len() {
            2 => vec![0.5 * thickness * norm(sub(at(1), at(0))); 2],
            3 => vec![norm(cross(sub(at(1), at(0)), sub(at(2), at(0)))) / 6.0; 3],
            _ => quad_areas([at(0), at(1), at(2), at(3)]),
        };
        for (&node, area) in facet.iter().zip(areas) {
            forces.push((node as usize, traction.map(|t| t * area)));
        }
    }
    forces
}

/// `integral of N_a dA` of a bilinear facet, 2x2 Gauss points.
fn quad_areas(x: [[f64; 3]; 4]) -> Vec<f64> {
    let kind = crate::kind::ElementKind::Quad;
    let mut areas = vec![0.0; 4];
    for (xi, weight) in kind.gauss_points() {
        let gradients = kind.reference_gradients(xi);
        let mut tangents = [[0.0; 3]; 2];
        for (node, gradient) in x.iter().zip(&gradients) {
            for (tangent, g) in tangents.iter_mut().zip(gradient) {
                for axis in 0..3 {
                    tangent[axis] += g * node[axis];
                }
            }
        }
        let area = weight * norm(cross(tangents[0], tangents[1]));
        for (a, n) in areas.iter_mut().zip(kind.shape_functions(xi)) {
            *a += area * n;
        }
    }
    areas
}

/// Nodes of `points` whose coordinate along `axis` is `value` to `1e-6` of the body's extent along all
/// axes.
pub fn nodes_at(points: &[[f64; 3]], axis: usize, value: f64) -> Vec<usize> {
    let extent = (0..3)
        .map(|d| {
            let range = points
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p[d]), b.max(p[d])));
            range.1 - range.0
        })
        .fold(0.0, f64::max);
    (0..points.len()).filter(|&n| (points[n][axis] - value).abs() <= 1e-6 * extent).collect()
}

/// Nodes that belong to no element: they make a system singular unless they are held.
pub fn loose_nodes(points: usize, cells: &Cells<'_>) -> Vec<usize> {
    let mut used = vec![false; points];
    for element in 0..cells.len() {
        for &node in cells.element(element).2 {
            if let Some(used) = used.get_mut(node as usize) {
                *used = true;
            }
        }
    }
    (0..points).filter(|&n| !used[n]).collect()
}
