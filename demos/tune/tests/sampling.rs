//! Values of parameters of a sweep.

use serde_json::Value;
use sinew_tune::sweep::sampling::{
    Axis, RangeScale, ValueRange, cell_value, grid_runs, hypercube_runs,
};

#[test]
fn a_hypercube_visits_every_part_once_and_parameters_do_not_disturb_each_other() {
    let axis = || Axis::Range {
        range: ValueRange { min: 10.0, max: 20.0, count: None, scale: RangeScale::Linear },
        whole: false,
    };
    let names = ["a".to_string(), "b".to_string()];
    let two = hypercube_runs(&[axis(), axis()], &names, 50, 7);
    for column in 0..2 {
        let mut parts: Vec<i64> =
            two.iter().map(|run| (run[column].as_f64().unwrap() * 5.0 - 50.0) as i64).collect();
        parts.sort_unstable();
        assert_eq!(parts, (0..50).collect::<Vec<_>>());
    }
    let one = hypercube_runs(&[axis()], &names[1..], 50, 7);
    assert!(one.iter().zip(&two).all(|(one, two)| one[0] == two[1] && two[0] != two[1]));
    assert_ne!(hypercube_runs(&[axis()], &names[..1], 50, 8)[0], [two[0][0].clone()]);
}

#[test]
fn grids_vary_the_last_parameter_fastest_and_ranges_keep_their_ends() {
    let axis = |scale, whole| Axis::Range {
        range: ValueRange { min: 1.0, max: 100.0, count: Some(3), scale },
        whole,
    };
    let log = axis(RangeScale::Log, false).points();
    assert!((log[1].as_f64().unwrap() - 10.0).abs() < 1e-13, "{log:?}");
    assert_eq!([&log[0], &log[2]], [&Value::from(1.0), &Value::from(100.0)]);
    assert_eq!(axis(RangeScale::Linear, true).points(), [Value::from(1), 51.into(), 100.into()]);
    let lists = [vec![1.into(), 2.into()], vec![Value::from("a"), "b".into()]];
    let runs = grid_runs(&lists, 4);
    assert_eq!(runs[1], [Value::from(1), "b".into()]);
    assert_eq!(runs[2], [Value::from(2), "a".into()]);
}

#[test]
fn cells_are_what_they_look_like() {
    let cases: [(&str, Value, Value); 7] = [
        ("", Value::Null, 1.5.into()),
        ("3", 3.into(), 1.5.into()),
        ("4e3", 4000.0.into(), Value::Null),
        (".5", 0.5.into(), Value::Null),
        ("true", true.into(), Value::Null),
        ("safe", "safe".into(), "auto".into()),
        ("3", "3".into(), "auto".into()),
    ];
    for (cell, value, present) in cases {
        assert_eq!(cell_value(cell, &present), value, "{cell}");
    }
}
