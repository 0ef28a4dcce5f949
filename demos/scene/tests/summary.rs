//! What a run reports.

use sinew_scene::summary::StepTimes;

#[test]
fn quantiles_are_taken_from_the_sorted_times() {
    let mut times = StepTimes::default();
    (1..=200).rev().for_each(|i| times.add(f64::from(i) * 1e-3));
    let t = times.timing();
    let near = |found: f64, expected: f64| (found / expected - 1.0).abs() < 2e-3;
    assert_eq!((t.count, t.max_ms, times.last()), (200, 200.0, 1e-3));
    assert!(near(t.mean_ms, 100.5) && near(t.median_ms, 100.0) && near(t.p99_ms, 198.0), "{t:?}");
    assert_eq!(StepTimes::default().timing().median_ms, 0.0);
    (0..100_000).for_each(|i| times.add(1e-3 * (1.0 + f64::from(i) * 1e-5)));
    assert!(times.bins() < 1500, "{}", times.bins());
}
