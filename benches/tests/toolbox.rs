//! Statistics, meshes and charts.

use glam::DVec3;
use sinew::engine::mesh::generate::box_tets;
use sinew_benches::toolbox::beam::cells_for;
use sinew_benches::toolbox::meshes::refined;
use sinew_benches::toolbox::plot::{
    Bar, ChartPanel, Scales, Series, bars, decades, lines, panels, plain_label, sparse_label,
    speed_against_error,
};
use sinew_benches::toolbox::stats::{Rounds, Spread, interleave};

#[test]
fn quartiles_lie_between_neighbours() {
    let spread = Spread::of(&[4.0, 1.0, 3.0, 2.0]).unwrap();
    assert_eq!(
        spread,
        Spread {
            samples: 4,
            minimum: 1.0,
            lower_quartile: 1.75,
            median: 2.5,
            upper_quartile: 3.25
        }
    );
    assert_eq!(spread.scaled(2.0).median, 5.0);
    let one = Spread::of(&[7.0]).unwrap();
    assert_eq!([one.minimum, one.lower_quartile, one.median, one.upper_quartile], [7.0; 4]);
    assert_eq!((Spread::of(&[]), Spread::of(&[1.0, f64::NAN])), (None, None));
}

#[test]
fn variants_take_turns_and_slow_ones_drop_out() {
    let mut order = Vec::new();
    let rounds = Rounds { most: 4, least: 2, seconds: 1.5 };
    let samples = interleave(&mut [0.1, 1.0], rounds, |seconds| {
        order.push(*seconds);
        Ok::<f64, ()>(*seconds)
    })
    .unwrap();
    assert_eq!(order, [0.1, 1.0, 0.1, 1.0, 0.1, 0.1]);
    assert_eq!((samples[0].len(), samples[1].len()), (4, 2));
    assert_eq!(interleave(&mut [1], rounds, |_| Err::<f64, _>("no")), Err("no"));
}

#[test]
fn refinement_keeps_volume_vertices_and_faces() {
    let coarse = box_tets(DVec3::new(0.3, 0.2, 0.1), [2, 1, 1]).unwrap();
    let fine = refined(&coarse);
    assert_eq!(fine.tetrahedra.len(), 8 * coarse.tetrahedra.len());
    assert_eq!(fine.points[..coarse.points.len()], coarse.points[..]);
    // the box with twice the cells has the same vertices
    let double = box_tets(DVec3::new(0.3, 0.2, 0.1), [4, 2, 2]).unwrap();
    assert_eq!(fine.points.len(), double.points.len());
    assert!((fine.total_volume() - coarse.total_volume()).abs() < 1e-15);
    let all_positive =
        fine.tetrahedra.iter().all(|&t| fine.signed_volume(t).is_some_and(|v| v > 0.0));
    assert!(all_positive);
    let side = fine.group("x0").unwrap();
    assert_eq!(side.vertices.len(), double.group("x0").unwrap().vertices.len());
    assert!(side.vertices.iter().all(|&v| fine.points[v as usize].x == 0.0));
}

#[test]
fn charts_hold_their_points_and_words() {
    let points = vec![[1e-3, 1.0], [1e-2, 0.1], [f64::NAN, 1.0], [1.0, 0.0]];
    let series = Series::new("a < b", points, 0);
    let front = vec![vec![[1e-3, 1.0], [1e-2, 0.1]]];
    let axes = ["cost", "error"];
    let text = speed_against_error("n", "title", axes, &[series], &front).unwrap().svg;
    assert!(text.starts_with("<svg") && text.contains("a &lt; b") && text.contains("Pareto"));
    // three points and one in the legend; zero lies on the floor, NaN nowhere
    assert_eq!(text.matches("<circle").count(), 4);
    assert!(!text.contains("NaN"));
    assert!(speed_against_error("n", "t", axes, &[], &[]).is_err());
}

#[test]
fn panels_share_their_scales_and_one_legend() {
    let panel = |name: &str, points: Vec<[f64; 2]>| ChartPanel {
        name: name.into(),
        title: name.into(),
        series: vec![Series::new("kind", points, 0), Series::new("absent", Vec::new(), 1)],
    };
    let both = [
        panel("one", vec![[1.0, 10.0], [10.0, 1.0]]),
        panel("two", vec![[2.0, 0.0], [1000.0, 0.5]]),
    ];
    let charts = panels("all", ["ms", "%"], &both, true).unwrap();
    let names: Vec<&str> = charts.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["one", "two", "all"]);
    assert_eq!(charts[2].svg.matches("<circle").count(), 4);
    assert_eq!(charts[2].svg.matches(">\nkind\n<").count(), 1, "{}", charts[2].svg);
    assert!(charts.iter().all(|c| !c.svg.contains("absent") && !c.svg.contains("NaN")));
    // the tick of 1000 ms is there without a point near it
    assert!(charts[0].svg.contains("\n1000\n"), "{}", charts[0].svg);
    assert_eq!(panels("all", ["ms", "%"], &both[..1], true).unwrap().len(), 1);
    assert!(panels("all", ["ms", "%"], &[], true).is_err());
}

#[test]
fn lines_are_drawn_with_their_names() {
    let line = |points| Series::new("a & b", points, 2);
    let series = [line(vec![[0.0, 0.0], [1.0, -2.0]])];
    let text = lines("n", "title", ["x", "y"], &series, Scales::Equal).unwrap().svg;
    assert!(text.contains("<polyline") && text.contains("a &amp; b") && !text.contains("NaN"));
    let nothing = [line(vec![[f64::NAN, 1.0]])];
    assert!(lines("n", "t", ["x", "y"], &nothing, Scales::Linear).is_err());
    // 0 has no place on logarithmic axes
    let series = [line(vec![[0.0, 1.0], [1.0, 1e-3], [10.0, 1e-2]])];
    let text = lines("n", "title", ["x", "y"], &series, Scales::Logarithmic).unwrap().svg;
    assert_eq!(text.matches("<circle").count(), 2);
}

#[test]
fn bars_have_lengths_and_aims() {
    let bar = |value: f64, aim| Bar {
        label: "x".into(),
        value,
        quartiles: [0.9 * value, 1.1 * value],
        aim,
        colour: 1,
    };
    let text = bars("n", "title", "ns", &[bar(1.0, None), bar(3.0, Some(2.0))]).unwrap().svg;
    assert!(text.matches("<rect").count() >= 3 && text.contains("#C80000"));
    assert!(bars("n", "t", "ns", &[bar(0.0, None)]).is_err());
    // of widely different ones the places are drawn, not lengths
    let text = bars("n", "title", "ns", &[bar(1.0, None), bar(100.0, None)]).unwrap().svg;
    assert_eq!(text.matches("<circle").count(), 2);
}

#[test]
fn lines_that_coincide_are_marked_at_other_places() {
    let points: Vec<[f64; 2]> = (0..60).map(|i| [f64::from(i), 2.0]).chain([[60.0, 3.0]]).collect();
    let series = [0, 1].map(|i| Series::new(format!("{i}"), points.clone(), i));
    let text = lines("n", "t", ["x", "y"], &series, Scales::Linear).unwrap().svg;
    let places = |colour: &str| -> Vec<String> {
        let circles = text.lines().filter(|l| l.starts_with("<circle") && l.contains(colour));
        circles.map(|l| l.split("cx=").nth(1).unwrap()[..6].to_string()).collect()
    };
    let [first, second] = ["#0072B2", "#D55E00"].map(places);
    assert!(first.len() > 5 && second.len() > 5, "{text}");
    assert!(first.iter().all(|x| !second.contains(x)), "{first:?} {second:?}");
}

#[test]
fn ticks_are_readable() {
    let labels =
        [0.1 + 1e-17, 0.30000000000000004, 9.999999999999e-5, 20.0].map(|x| sparse_label(&x));
    assert_eq!(labels, ["0.1", "", "1e-4", "20"]);
    assert_eq!([-1e-17, 0.30000000000000004, -40.0].map(|x| plain_label(&x)), ["0", "0.3", "-40"]);
}

#[test]
fn decades_enclose() {
    assert_eq!(decades([0.002, 0.5, 0.0].into_iter()), Some(1e-3..1.0));
    assert_eq!(decades([1.0].into_iter()), Some(1.0..10.0));
    assert_eq!(decades([0.0].into_iter()), None);
}

#[test]
fn sizes_are_about_as_asked() {
    for asked in [200, 1000, 5_000, 12_345, 50_000, 500_000] {
        let found: usize = 6 * cells_for(asked).iter().product::<usize>();
        assert!(found.abs_diff(asked) * 10 < asked, "{asked}: {found}");
    }
}
