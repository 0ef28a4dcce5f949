//! Trade-offs between cost and error.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_points_that_nothing_beats_remain() {
        let points = [[3.0, 1.0], [1.0, 5.0], [2.0, 5.0], [2.0, 2.0], [4.0, 1.0], [1.0, 6.0]];
        assert_eq!(front(&points, 0.0), [1, 3, 0]);
        assert_eq!(front(&[], 0.0), [0usize; 0]);
        assert_eq!(front(&[[1.0, 1.0], [1.0, 1.0]], 0.0), [0]);
        assert_eq!(front(&[[f64::NAN, 0.0], [1.0, f64::INFINITY], [5.0, 2.0]], 0.0), [2]);
        assert_eq!(front(&[[1.0, 1.0], [2.0, 0.995], [3.0, 0.98]], 0.01), [0, 2]);
    }
}
