//! Directions without information, intervals.

use nalgebra::DMatrix;
use sinew_tune::fit_data::statistics::{Directions, half_width};

#[test]
fn null_directions_are_found_with_few_rows_too() {
    let wide = DMatrix::from_row_slice(1, 2, &[3.0, 4.0]);
    let directions = Directions::of(&wide);
    assert!((directions.singular_values[0] - 5.0).abs() < 1e-14);
    let null: Vec<&[f64]> = directions.unidentifiable().collect();
    assert_eq!(null.len(), 1);
    assert!((null[0][0] * 3.0 + null[0][1] * 4.0).abs() < 1e-14);
    assert_eq!(directions.determined(), [false, false]);

    // the third is apart from a pair that is not
    let pair = DMatrix::from_row_slice(2, 3, &[3.0, 4.0, 0.0, 0.0, 0.0, 2.0]);
    let directions = Directions::of(&pair);
    assert_eq!(directions.determined(), [false, false, true]);
    assert!((directions.covariance()[(2, 2)] - 0.25).abs() < 1e-14);

    let tall = DMatrix::from_row_slice(3, 2, &[1.0, 2.0, 0.5, -1.0, 2.0, 0.25]);
    let directions = Directions::of(&tall);
    let product = tall.transpose() * &tall * directions.covariance();
    assert!((product - DMatrix::identity(2, 2)).amax() < 1e-13);
    assert_eq!(directions.unidentifiable().count(), 0);
    assert!(directions.condition() < 10.0);
}

#[test]
fn intervals_are_those_of_the_tables() {
    // both sides of the switch to the expansion are in it
    let table = [
        (2, 4.3026527),
        (3, 3.1824463),
        (5, 2.5705818),
        (30, 2.0422725),
        (200, 1.9718962),
        (500, 1.9647198),
    ];
    for (freedom, expected) in table {
        assert!((half_width(Some(freedom)) - expected).abs() < 1e-6, "{freedom}");
    }
}
