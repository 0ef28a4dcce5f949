//! Kinds of elements beside each other: places, the continuum, verdicts.

use glam::DVec3;
use sinew_benches::bench::elements::report::{time_at_error, time_within, without_luck};
use sinew_benches::bench::elements::{
    CAPPED, ContinuumTruth, Discretisation, ENERGY, ElementBody, ElementPlaces, ElementReport,
    ElementRow, ElementTruth,
};
use sinew_benches::peers::equilibrium::equilibrium;
use sinew_benches::toolbox::stats::Spread;

#[test]
fn vertices_are_compared_at_their_places() {
    let field = |points: &[DVec3]| points.iter().map(|p| DVec3::Z * p.x * p.x).collect();
    for (body, kind) in
        ElementBody::ALL.into_iter().flat_map(|b| Discretisation::ALL.map(|k| (b, k)))
    {
        let (fine, fixed) = body.mesh(Discretisation::Linear, 2).unwrap();
        let places = ElementPlaces::new(body, &fine.points);
        let truth: Vec<Vec<DVec3>> = vec![field(&fine.points)];
        let (mesh, own) = body.mesh(kind, 1).unwrap();
        // ten-node tetrahedra are held where the finer mesh is
        let held = if kind == Discretisation::TenNode { fixed.len() } else { own.len() };
        assert!(own.len() == held && (1..=fixed.len()).contains(&held), "{body:?} {kind:?}");
        assert_eq!(places.pairs(&mesh.points).len(), mesh.points.len(), "{body:?} {kind:?}");
        let found: Vec<Vec<DVec3>> = vec![field(&mesh.points)];
        assert!(places.error(&mesh.points, &found, &truth).unwrap() < 1e-12, "{body:?} {kind:?}");
        let off: Vec<Vec<DVec3>> = vec![found[0].iter().map(|u| *u * 1.1).collect()];
        let error = places.error(&mesh.points, &off, &truth).unwrap();
        assert!((error - 10.0).abs() < 1e-9, "{body:?} {kind:?}: {error}");
    }
}

/// The finer the mesh the nearer to the continuum, and ten-node elements before linear ones.
#[test]
fn elements_converge_to_the_continuum() {
    let truth = ContinuumTruth::new(ElementBody::Beam, 0.4999, 2, Some(1)).unwrap();
    assert!(truth.row.own_percent > 0.0 && truth.row.own_percent < 1.0, "{:?}", truth.row);
    assert!(truth.row.energies_percent[0].unwrap() < 1.0, "{:?}", truth.row);
    let error = |kind: Discretisation| {
        let beam = kind.beam(ElementBody::Beam, 1, 0.4999).unwrap();
        let own = equilibrium(&beam, ENERGY, kind.volume()).unwrap();
        truth.still.0.error(&beam.mesh.points, &[own], &truth.still.1).unwrap()
    };
    let [plain, clusters, ten] =
        [Discretisation::Linear, Discretisation::Clusters, Discretisation::TenNode].map(error);
    assert!(ten < 0.2 * clusters && clusters < 0.7 * plain, "{plain} {clusters} {ten}");
}

fn row(kind: &str, nu: f64, level: usize, ms: f64, error: f64) -> ElementRow {
    let engine = kind.split(' ').next().filter(|e| ["MuJoCo", "Rapier"].contains(e));
    ElementRow {
        poisson_ratio: nu,
        kind: kind.into(),
        engine: engine.unwrap_or("Sinew").into(),
        level,
        mesh: format!("mesh {level}"),
        ms: Spread::of(&[ms]),
        iterations: Some(ms),
        static_percent: Some(error),
        ..ElementRow::default()
    }
}

#[test]
fn equal_errors_are_interpolated_in_logarithms() {
    // error = 10 / time
    let curve = [[1.0, 10.0], [100.0, 0.1], [10.0, 1.0]];
    let (time, outside) = time_at_error(&curve, 2.0).unwrap();
    assert!((time - 5.0).abs() < 1e-12 && !outside);
    let (time, outside) = time_at_error(&curve, 0.02).unwrap();
    assert!((time - 500.0).abs() < 1e-9 && outside);
    let (time, outside) = time_at_error(&curve, 20.0).unwrap();
    assert!((time - 0.5).abs() < 1e-12 && outside);
    assert_eq!(time_at_error(&curve, 10.0), Some((1.0, false)));
    // an error that rises leads nowhere
    assert_eq!(time_at_error(&[[1.0, 1.0], [10.0, 2.0]], 0.5), None);
    assert_eq!(time_at_error(&[[1.0, 1.0]], 0.5), None);
    assert_eq!(time_at_error(&[], 0.5), None);
    // a bound is measured or lies between: never beyond
    assert!((time_within(&curve, 2.0).unwrap() - 5.0).abs() < 1e-12);
    assert_eq!(time_within(&curve, 20.0), Some(1.0));
    assert_eq!(time_within(&curve, 0.02), None);
    // a coarse mesh that is near by chance counts as the finer one
    let lucky = without_luck(vec![[10.0, 8.0], [1.0, 2.0], [100.0, 4.0]]);
    assert_eq!(lucky, [[1.0, 8.0], [10.0, 8.0], [100.0, 4.0]]);
    assert_eq!(time_within(&lucky, 2.0), None);
    assert_eq!(time_within(&lucky, 8.0), Some(1.0));
}

#[test]
fn verdicts_compare_what_they_say() {
    let [linear, clusters, _, ten_node, _] = Discretisation::ALL.map(Discretisation::name);
    let (a, b) = (1, 2);
    let mut report = ElementReport {
        rows: vec![
            row(linear, 0.3, a, 1.0, 20.0),
            row(linear, 0.3, b, 10.0, 5.0),
            row(linear, 0.45, a, 2.0, 20.0),
            row(clusters, 0.49, a, 5.5, 20.0),
            row(clusters, 0.4999, a, 3.0, 20.0),
            row(ten_node, 0.3, a, 1.0, 5.0),
            row("MuJoCo tetrahedra", 0.3, b, 100.0, 10.0),
            row("Rapier tetrahedra", 0.3, b, 100.0, 1.25),
        ],
        ..ElementReport::default()
    };
    let found = |report: &ElementReport| -> Vec<(f64, bool)> {
        report.aims().iter().map(|a| ((a.found * 1e6).round() / 1e6, a.met)).collect()
    };
    // steps 3 to 2; iterations 3 to 5.5; 1 ms to 10; the ten-node row beats MuJoCo; linear ones reach 1.25 % at 100 ms
    let all = [(1.5, true), (2.5, false), (0.1, true), (0.01, true), (1.0, false)];
    assert_eq!(found(&report), all);
    assert!(report.aims()[2].what.contains("equal static error of 5.00 %"));
    assert!(report.aims()[4].what.ends_with("nu 0.3 (extrapolated)"));
    // an extrapolation says so
    report.rows[5].static_percent = Some(2.5);
    assert_eq!(report.aims().len(), 5);
    // an error that is not known well enough is not compared
    let own_percent = 1.3;
    report.truths = vec![ElementTruth { poisson_ratio: 0.3, own_percent, ..Default::default() }];
    assert_eq!(report.aims().len(), 4);
    report.truths.clear();
    assert!(report.aims()[2].what.ends_with("mesh 1 (extrapolated)"));
    // a cap that gives the same error is what counts, one that does not is not
    let capped = format!("Rapier tetrahedra{CAPPED}");
    report.rows.push(row(&capped, 0.3, b, 40.0, 1.26));
    report.rows.push(row(&capped, 0.3, a, 1.0, 30.0));
    report.rows.push(row("Rapier tetrahedra", 0.3, a, 9.0, 3.0));
    assert_eq!(report.drawn("Rapier tetrahedra", 0.3), [[9.0, 3.0], [40.0, 1.26]]);
    assert!((report.aims()[4].found - 2.5).abs() < 0.05, "{:?}", report.aims()[4]);
    report.rows.truncate(8);
    // a rival's row stands beside what ours take for its error
    let equal: Vec<_> = report.at_equal_error().map(|(_, _, best)| best).collect();
    assert_eq!(equal.len(), 2);
    assert_eq!(equal[0].unwrap().0, Discretisation::TenNode);
    assert_eq!((equal[0].unwrap().1, equal[1]), (1.0, None));
    // what failed is no figure
    report.rows[6].static_percent = None;
    assert_eq!(report.aims().len(), 4);
    assert!(ElementReport::default().aims().is_empty());
}
