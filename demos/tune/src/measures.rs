//! Numbers by which runs are compared: error of displacements, quantiles of times, trade-offs between
//! the two.

use glam::DVec3;

/// Indices of the points that no other point beats in both cost and error (a point that equals
/// another in both is beaten by the one that comes first), in ascending order of cost. A dearer point
/// counts only if its error is smaller by the share `margin`. Points with a value that is not finite
/// are left out.
pub fn front(points: &[[f64; 2]], margin: f64) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&i| points[i].iter().all(|x| x.is_finite())).collect();
    order.sort_by(|&a, &b| {
        let ([cost_a, error_a], [cost_b, error_b]) = (points[a], points[b]);
        cost_a.total_cmp(&cost_b).then(error_a.total_cmp(&error_b)).then(a.cmp(&b))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let error = points[i][1];
        let better = error < best * (1.0 - margin);
        if better {
            best = error;
        }
        better
    });
    order
}

/// Largest distance of a vertex from where it should be, over all times, over the largest true
/// displacement (a share, not percent). The first `vertices` of every state are compared; `None` when
/// states are missing or not finite.
pub fn displacement_error(
    found: &[Vec<DVec3>],
    truth: &[Vec<DVec3>],
    vertices: usize,
) -> Option<f64> {
    if found.len() != truth.len() {
        return None;
    }
    let (mut difference, mut size) = (0.0_f64, 0.0_f64);
    for (found, truth) in found.iter().zip(truth) {
        let pairs = found.get(..vertices)?.iter().zip(truth.get(..vertices)?);
        for (u, t) in pairs {
            if !u.is_finite() {
                return None;
            }
            difference = difference.max(u.distance(*t));
            size = size.max(t.length());
        }
    }
    (size > 0.0).then(|| difference / size)
}

/// Value at a share of the sorted samples, linear between neighbours; the slice is not empty.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share * (sorted.len() - 1) as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    sorted[low] + (at - low as f64) * (sorted[high] - sorted[low])
}
