//! Fronts and errors.

use glam::DVec3;
use sinew_tune::measures::{displacement_error, front};

#[test]
fn only_points_that_nothing_beats_remain() {
    let points = [[3.0, 1.0], [1.0, 5.0], [2.0, 5.0], [2.0, 2.0], [4.0, 1.0], [1.0, 6.0]];
    assert_eq!(front(&points, 0.0), [1, 3, 0]);
    assert_eq!(front(&[], 0.0), [0usize; 0]);
    assert_eq!(front(&[[1.0, 1.0], [1.0, 1.0]], 0.0), [0]);
    assert_eq!(front(&[[f64::NAN, 0.0], [1.0, f64::INFINITY], [5.0, 2.0]], 0.0), [2]);
    assert_eq!(front(&[[1.0, 1.0], [2.0, 0.995], [3.0, 0.98]], 0.01), [0, 2]);
}

#[test]
fn errors_are_relative_to_the_largest_displacement() {
    let truth = vec![vec![DVec3::X, DVec3::ZERO], vec![2.0 * DVec3::X, DVec3::ZERO]];
    let mut found = truth.clone();
    assert_eq!(displacement_error(&found, &truth, 2), Some(0.0));
    found[0][1] = 0.1 * DVec3::Y;
    assert_eq!(displacement_error(&found, &truth, 2), Some(0.05));
    assert_eq!(displacement_error(&found, &truth, 1), Some(0.0));
    assert_eq!(displacement_error(&found[..1], &truth, 1), None);
    found[1][0].x = f64::NAN;
    assert_eq!(displacement_error(&found, &truth, 1), None);
}
