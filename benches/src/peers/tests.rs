use super::mujoco::{MuJoCo, parse, to_vectors};
use super::*;

#[test]
fn beams_have_the_stated_volume_and_mass() {
    for (beam, tetrahedra, volume) in [
        (Beam::rapier([8, 2, 2], 0.3, 9.81).unwrap(), 160, 5e-4),
        (Beam::rapier([16, 4, 4], 0.3, 9.81).unwrap(), 1280, 5e-4),
        (Beam::mujoco([16, 4, 4], 0.3).unwrap(), 1536, 4e-3),
    ] {
        assert_eq!(beam.mesh.tetrahedra.len(), tetrahedra);
        // every element the right way round, together the whole box
        let volumes = beam.mesh.tetrahedra.iter().map(|&t| beam.mesh.signed_volume(t).unwrap());
        assert!(volumes.clone().all(|v| v > 0.0));
        assert!((volumes.sum::<f64>() / volume - 1.0).abs() < 1e-12);
        assert!((beam.masses().iter().sum::<f64>() / (1000.0 * volume) - 1.0).abs() < 1e-12);
        // faces meet: the surface is the box and nothing inside
        let area: f64 = (beam.mesh.surface_triangles().iter())
            .map(|t| {
                let [a, b, c] = t.map(|v| beam.mesh.points[v as usize]);
                0.5 * (b - a).cross(c - a).length()
            })
            .sum();
        let size = beam.mesh.bounds().map(|(low, high)| high - low).unwrap();
        let expected = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        assert!((area / expected - 1.0).abs() < 1e-12);
    }
}

#[test]
fn the_mesh_file_holds_the_beam() {
    let beam = Beam::mujoco([2, 1, 1], 0.3).unwrap();
    let value: serde_json::Value =
        serde_json::from_str(&serde_json::to_string(&beam.file()).unwrap()).unwrap();
    assert_eq!(value["points"].as_array().unwrap().len(), 12);
    assert_eq!(value["points"][11], serde_json::json!([0.4, 0.1, 0.1]));
    assert_eq!(value["tetrahedra"].as_array().unwrap().len(), 12);
    assert_eq!(value["fixed"], serde_json::json!([0, 1, 2, 3]));
    let masses: f64 = value["masses"].as_array().unwrap().iter().map(|m| m.as_f64().unwrap()).sum();
    assert!((masses - 4.0).abs() < 1e-12);
}

#[test]
fn answers_of_the_script_are_read() {
    let reply = parse(r#"{"milliseconds": [1.5, 2.0], "warnings": ["a"], "more": 1}"#).unwrap();
    assert_eq!(reply.milliseconds, [1.5, 2.0]);
    assert_eq!(reply.warnings, ["a"]);
    let error = parse(r#"{"error": "ValueError: no mesh"}"#).unwrap_err().to_string();
    assert!(error.contains("MuJoCo") && error.contains("no mesh"), "{error}");
    let error = parse("Traceback").unwrap_err().to_string();
    assert!(error.contains("Traceback"), "{error}");
    assert_eq!(to_vectors(&[1.0, 2.0, 3.0], 1).unwrap(), [DVec3::new(1.0, 2.0, 3.0)]);
    assert!(to_vectors(&[1.0, 2.0], 1).is_err());
}

/// A script in place of Python that answers each kind of request as the real one does.
#[cfg(unix)]
#[test]
fn a_ball_is_driven_by_the_contract_of_the_script() {
    use std::os::unix::fs::PermissionsExt;
    let folder = std::env::temp_dir().join(format!("sinew-touch-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let python = folder.join("python");
    // 12 vertices, 12 tetrahedra; two steps; the third request has one force too few
    let zeros = ["0"; 36].join(",");
    let answers = format!(
        r#"#!/bin/sh
n=0
while read -r line; do
case "$line" in
*'"version"'*) echo '{{"version": "4.0.0"}}' ;;
*'"op":"touch-load"'*'"radius":0.02'*) echo '{{"nodes": 12, "elements": 12, "warnings": []}}' ;;
*'"op":"touch"'*'"places":[['*) n=$((n + 1)); more=',[0,0,3,-1,0,0]'; [ $n = 2 ] && more=''
echo '{{"milliseconds": [1, 2], "forces": [[0,0,2,0.5,0,0]'$more'], "displacements": [{zeros}], "warnings": ["so: 1"]}}' ;;
*) echo '{{"error": "what?"}}' ;;
esac
done
"#
    );
    std::fs::write(&python, answers).unwrap();
    std::fs::set_permissions(&python, std::fs::Permissions::from_mode(0o755)).unwrap();
    let mut mujoco = MuJoCo::start(python.to_str().unwrap()).unwrap();
    let block = touch::Block::new([2, 1, 1]).unwrap();
    let mut fingers = mujoco.fingers(&block).unwrap();
    assert_eq!(fingers.len(), 3);
    let finger = &mut fingers[0];
    finger.start(&block, 0.3).unwrap();
    let turn = finger.advance(&block, &[DVec3::ZERO; 2]).unwrap();
    assert_eq!(turn.displacements, [DVec3::ZERO; 12]);
    // normal force and friction add up
    assert_eq!(turn.samples[1].force, DVec3::new(-1.0, 0.0, 3.0));
    assert_eq!(turn.samples[0].friction, Some(DVec3::X * 0.5));
    let error = finger.advance(&block, &[DVec3::ZERO; 2]).err().unwrap().to_string();
    assert!(error.contains("MuJoCo") && error.contains("1 steps of 2"), "{error}");
    assert!(finger.remark().contains("it warns: so"), "{}", finger.remark());
    // another mesh than ours
    let other = touch::Block::new([2, 2, 1]).unwrap();
    let error = finger.start(&other, 0.0).unwrap_err().to_string();
    assert!(error.contains("12 vertices") && error.contains("of 18 and 24"), "{error}");
    drop(fingers);
    drop(mujoco);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The script knows what it is asked.
#[test]
fn the_script_serves_the_requests() {
    let script = include_str!("../../peers/mujoco_flex.py");
    for word in
        ["touch-load", "touch", "places", "friction", "radius", "damping", "option", "contact"]
    {
        assert!(
            script.contains(&format!("[\"{word}\"]"))
                || script.contains(&format!("op == \"{word}\"")),
            "{word}"
        );
    }
}

#[test]
fn a_missing_python_is_skipped_with_a_remedy() {
    let why = MuJoCo::start("/no/such/python").err().expect("there is none");
    assert!(why.contains("/no/such/python") && why.contains("pip install mujoco"), "{why}");
}

#[test]
fn errors_are_relative_to_the_truth() {
    let beam = Beam::mujoco([2, 1, 1], 0.3).unwrap();
    let truth: Vec<DVec3> = beam.mesh.points.iter().map(|p| DVec3::Z * -p.x).collect();
    let u: Vec<DVec3> = truth.iter().map(|u| *u * 1.02).collect();
    let (field, tip) = static_error(&beam, &u, &truth);
    assert!((field - 2.0).abs() < 1e-9 && (tip - 2.0).abs() < 1e-9);
    assert_eq!(static_error(&beam, &truth, &truth), (0.0, 0.0));
    assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
    assert_eq!(median(vec![1.0, 2.0]), Some(1.5));
    assert_eq!(median(Vec::new()), None);
}

/// Our own rows on a small beam: they settle to the truth, and faster steps count as cheaper.
#[test]
fn own_rows_settle_to_the_truth() {
    let case = Case::new(Beam::mujoco([8, 2, 2], 0.3).unwrap()).unwrap();
    let mut report = PeerReport::default();
    compete(&case, &mut sinew_rows::rivals(1, &[1e-2, 1.0 / 30.0], true), true, &mut report);
    assert_eq!(report.rows.len(), 6);
    for row in &report.rows {
        let error = row.error_percent.unwrap_or_else(|| panic!("{row:?}"));
        assert!(error < 1.0, "{row:?}");
        assert!(row.ms_per_step.unwrap() > 0.0 && row.force_ns_per_element.unwrap() > 0.0);
    }
    let text = serde_json::to_string(&report).unwrap();
    assert_eq!(serde_json::from_str::<PeerReport>(&text).unwrap().rows, report.rows);
}

#[test]
fn aims_compare_at_no_larger_error() {
    let case = Case { beam: Beam::mujoco([24, 6, 6], 0.3).unwrap(), truth: Vec::new() };
    let row = |engine: &str, setting: &str, cost, force, error| PeerRow {
        cost_per_simulated_second: Some(cost),
        force_ns_per_element: Some(force),
        error_percent: Some(error),
        ..case.row(engine, "1", setting.into())
    };
    let mut rows = vec![
        row("Sinew", "default, h = 10 ms", 0.1, 10.0, 0.5),
        row("Sinew", "exact", 0.5, 12.0, 1e-6),
        row("MuJoCo", "h = 10 ms", 2.0, 70.0, 1e-4),
    ];
    // the cheaper row of ours is too wrong to count
    let met: Vec<bool> = aims(&rows).iter().map(|a| a.met).collect();
    assert_eq!(met, [true, false, true]);
    rows[0].error_percent = Some(1e-5);
    let met: Vec<bool> = aims(&rows).iter().map(|a| a.met).collect();
    assert_eq!(met, [true, true, true]);
    rows[0].error_percent = Some(2.0);
    assert!(!aims(&rows).last().unwrap().met);
}
