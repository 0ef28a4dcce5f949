//! Which cut of the bodies is chosen.

use glam::DVec3;
use sinew_tune::advise::cuts::{Cut, CutMotion, CutRow, choose, distance};

fn row(frame_ms: f64, error_percent: Option<f64>) -> CutRow {
    let (keys, note) = (String::new(), String::new());
    let cut = Cut::default();
    CutRow { keys, elements: 1, vertices: 4, frame_ms, error_percent, note, cut }
}

#[test]
fn the_fastest_that_is_near_enough_is_chosen() {
    let rows = [row(1.0, Some(30.0)), row(3.0, Some(2.0)), row(2.0, Some(4.0)), row(0.5, None)];
    assert_eq!(choose(&rows, 0.05), (2, true));
    assert_eq!(choose(&rows, 0.03), (1, true));
    assert_eq!(choose(&rows, 0.01), (1, false));
    // one that is nearer than a finer one of its kind is so by chance
    let finer = |row: CutRow| CutRow { cut: Cut { finer: 1, ..row.cut }, ..row };
    let rows = [row(1.0, Some(2.0)), finer(row(2.0, Some(10.0))), row(3.0, Some(3.0))];
    let other = Cut { hexahedra: true, ..Cut::default() };
    let [chance, fine, hexahedra] = rows;
    let rows = [chance, fine, CutRow { cut: other, ..hexahedra }];
    assert_eq!(choose(&rows, 0.05), (2, true));
}

#[test]
fn errors_are_measured_where_both_have_vertices() {
    let motion = |rest: &[f64], u: &[f64]| CutMotion {
        rest: rest.iter().map(|&x| (0, DVec3::X * x)).collect(),
        states: vec![u.iter().map(|&u| DVec3::Z * u).collect()],
        elements: 1,
        note: String::new(),
    };
    let truth = motion(&[0.0, 0.5, 1.0], &[0.0, 1.0, 4.0]);
    let coarse = motion(&[1.0, 0.0], &[3.0, 0.0]);
    assert_eq!(distance(&coarse, &truth), Some(0.25));
    let elsewhere = motion(&[0.3], &[1.0]);
    assert_eq!(distance(&elsewhere, &truth), None);
}
