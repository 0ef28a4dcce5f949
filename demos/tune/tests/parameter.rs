//! Maps that keep parameters in range.

use sinew_tune::fit_data::parameter::{Constant, Parameter};

fn parameter(constant: Constant, start: f64, bounds: [f64; 2]) -> Parameter {
    let (name, elements) = ("a".to_string(), vec![0]);
    Parameter { name, constant, body: 0, family: 0, elements, start, varies: false, bounds }
}

#[test]
fn maps_start_at_the_scene_and_stay_in_bounds() {
    let all = [
        parameter(Constant::Young, 5e3, [0.0, f64::INFINITY]),
        parameter(Constant::Axis, 5e3, [1e3, 1e5]),
        parameter(Constant::Poisson, 0.45, [-0.99, 0.4999]),
    ];
    for p in &all {
        assert!((p.value(1.0) / p.start - 1.0).abs() < 1e-13, "{p:?}");
        for x in [-3.0, 0.0, 1.0, 2.5] {
            let value = p.value(x);
            assert!(p.bounds[0] < value && value < p.bounds[1], "{p:?} {value}");
            let h = 1e-5;
            let slope = (p.value(x + h) - p.value(x - h)) / (2.0 * h);
            assert!((p.slope(x) / slope - 1.0).abs() < 1e-8, "{p:?} at {x}");
        }
    }
    assert!(all[1].at_bound(1.0001e3) && !all[1].at_bound(2e3) && !all[0].at_bound(1.0));
}
