//! Rivals: beams, the ball, what their processes answer, charts and verdicts.

use sinew::prelude::*;
use sinew_benches::peers::beam::masses;
use sinew_benches::peers::mujoco::{MuJoCo, parse, to_vectors};
#[cfg(feature = "rapier")]
use sinew_benches::peers::rapier;
use sinew_benches::peers::rival::{BeamCase, compete, static_error};
use sinew_benches::peers::touch::{
    self, AT, BALL, DEPTH, DRAG, FRICTION, Finger, GAP, RADIUS, SIZE, Sample, TURN, TouchBlock,
    TouchRow, TouchTruth, TouchTurn, figures, ours, ours_with_blocks, run,
};
use sinew_benches::peers::{Beam, PeerReport, PeerRow, aims, bodies, cut, sinew_rows};
use sinew_benches::toolbox::error::{BenchError, Result};
use sinew_tune::page::{Chart, Judgement};

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
*'"op":"touch-load"'*'"radius":null'*) echo '{{"nodes": 24, "elements": 24, "warnings": []}}' ;;
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
    let block = touch::TouchBlock::new([2, 1, 1]).unwrap();
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
    let other = touch::TouchBlock::new([2, 2, 1]).unwrap();
    let error = finger.start(&other, 0.0).unwrap_err().to_string();
    assert!(error.contains("12 vertices") && error.contains("of 18 and 24"), "{error}");
    // two blocks, of which the held vertices are told
    let pair = TouchBlock::pair([2, 1, 1]).unwrap();
    let mut fingers = mujoco.fingers(&pair).unwrap();
    fingers[0].start(&pair, 0.0).unwrap();
    let error = fingers[0].advance(&pair, &[DVec3::ZERO; 2]).err().unwrap().to_string();
    assert!(error.contains("36 numbers for 24 vertices"), "{error}");
    drop(fingers);
    drop(mujoco);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The script knows what it is asked.
#[test]
fn the_script_serves_the_requests() {
    let script = include_str!("../peers/mujoco_flex.py");
    for word in [
        "touch-load",
        "touch",
        "places",
        "friction",
        "radius",
        "damping",
        "option",
        "contact",
        "held",
    ] {
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
}

/// Our own rows on a small beam: they settle to the truth, and faster steps count as cheaper.
#[test]
fn own_rows_settle_to_the_truth() {
    let case = BeamCase::new(Beam::mujoco([8, 2, 2], 0.3).unwrap()).unwrap();
    let rows = compete(&case, &mut sinew_rows::rivals(&[1e-2, 1.0 / 30.0], true), true);
    assert_eq!(rows.len(), 9);
    for row in &rows {
        let error = row.error_percent.unwrap_or_else(|| panic!("{row:?}"));
        assert!(error < 1.0, "{row:?}");
        assert!(row.ms_per_step.unwrap() > 0.0 && row.force_ns_per_element.unwrap() > 0.0);
        let euler = row.setting.starts_with("safe");
        assert_eq!(row.step_percent.is_some(), euler, "{row:?}");
        assert_eq!(row.swing_percent.is_some(), row.cost_per_simulated_second.is_some(), "{row:?}");
        // what linearisation and loose solves leave is little beside what the length of the step does
        if let (Some(step), Some(swing)) = (row.step_percent, row.swing_percent) {
            assert!(step < 0.5 * swing, "{row:?}");
        }
    }
    // steps of second order, by default, are the more exact
    let swing =
        |name: &str| rows.iter().find(|r| r.setting.starts_with(name)).unwrap().swing_percent;
    assert!(swing("auto, StVK") < swing("safe, StVK"), "{rows:?}");
}

#[test]
fn aims_compare_at_no_larger_error() {
    let case = BeamCase { beam: Beam::mujoco([24, 6, 6], 0.3).unwrap(), truth: Vec::new() };
    let row = |engine: &str, setting: &str, cost, force, error| PeerRow {
        ms_per_step: Some(10.0 * cost),
        cost_per_simulated_second: Some(cost),
        force_ns_per_element: Some(force),
        error_percent: Some(error),
        swing_percent: Some(error),
        ..case.row(engine, "1", setting.into())
    };
    let mut rows = vec![
        row("Sinew", "default, h = 10 ms", 0.1, 10.0, 0.5),
        row("Sinew", "exact", 0.5, 12.0, 1e-6),
        row("MuJoCo", "h = 10 ms", 2.0, 70.0, 1e-4),
    ];
    let judged =
        |rows: &[PeerRow]| -> Vec<Judgement> { aims(rows).iter().map(|a| a.judgement()).collect() };
    let [yes, no, open] = [Judgement::Yes, Judgement::No, Judgement::Open];
    // the cheaper row of ours is too wrong to count
    assert_eq!(judged(&rows), [yes, no, yes]);
    // what counts is the motion, not where it settles
    rows[0].error_percent = Some(1e-5);
    assert_eq!(judged(&rows), [yes, no, yes]);
    rows[0].swing_percent = Some(1e-5);
    assert_eq!(judged(&rows), [yes, yes, yes]);
    // at the cap that is the other's default less is aimed at
    rows[2].setting = "h = 10 ms, at most 100 iterations (its default)".into();
    (rows[0].ms_per_step, rows[0].cost_per_simulated_second) = (Some(1.9), Some(0.19));
    assert_eq!(judged(&rows), [yes, yes, yes]);
    rows[2].setting = "h = 10 ms".into();
    rows[0].error_percent = Some(2.0);
    assert_eq!(judged(&rows)[2], no);
    // steps of another length and numbers of another precision count for nothing
    rows[0] = row("Sinew", "default, h = 33 ms", 0.01, 1.0, 1e-6);
    rows[0].ms_per_step = Some(0.33);
    assert_eq!(judged(&rows), [yes, no, yes]);
    rows[0] = PeerRow { precision: "f32".into(), ..row("Sinew", "f32", 0.01, 1.0, 1e-6) };
    // forces: 70 ns against 12 in `f64`, not against the 1 in `f32`
    assert_eq!(judged(&rows), [no, no]);
    // Rapier cuts its steps into four, ours are compared with these
    let rapier = PeerRow { precision: "f32".into(), ..row("Rapier", "300", 0.4, 1.0, 1e-6) };
    rows.push(PeerRow { ms_per_step: Some(16.0), ..rapier });
    assert_eq!(judged(&rows), [no, no, yes]);
    rows.pop();
    rows[1].precision = "f32".into();
    // nothing of ours is like theirs: no forces, no verdict on steps
    assert_eq!(judged(&rows)[0], open);
    assert!(aims(&rows)[0].what.contains("f64"), "{:?}", aims(&rows)[0]);
}

#[test]
fn the_largest_beams_and_the_ball_come_first() {
    let row = |engine: &str, setting: &str, scene: &str, elements| PeerRow {
        engine: engine.into(),
        setting: setting.into(),
        scene: scene.into(),
        elements,
        cost_per_simulated_second: Some(0.1),
        swing_percent: Some(1.0),
        ..PeerRow::default()
    };
    let rows = vec![
        row("Sinew", "safe, StVK, h = 10 ms", "a, 10 tetrahedra", 10),
        row("MuJoCo", "flex, at most 1000 iterations", "a, 20 tetrahedra", 20),
        row("Rapier", "FEM, at most 20 CG iterations", "b, 5 tetrahedra", 5),
        row("Sinew", "quasi-static Newton, StVK", "c, 1 tetrahedra", 1),
    ];
    let touched = |error| TouchRow {
        engine: "MuJoCo".into(),
        cost_per_simulated_second: Some(1.0),
        error_percent: Some(error),
        ..TouchRow::default()
    };
    let (touch, bodies) = (vec![touched(1.0)], vec![touched(9.0)]);
    let contact = PeerReport { touch, bodies, ..PeerReport::default() };
    let report = PeerReport { rows, ..PeerReport::default() };
    let names =
        |charts: &[Chart]| -> Vec<String> { charts.iter().map(|c| c.name.clone()).collect() };
    let (charts, leading) = report.charts().unwrap();
    // an equilibrium has no cost per simulated second: its scene has no chart
    assert_eq!(names(&charts), ["peers-beam-1", "peers-beam-2", "peers-beam-3", "peers-beams"]);
    assert_eq!(leading, 2);
    assert!(charts[0].svg.contains("MuJoCo, converged") && charts[0].svg.contains("20 tetrahedra"));
    assert!(charts[1].svg.contains("Rapier, its cap"));
    assert!(PeerReport::default().charts().unwrap().0.is_empty());
    let (charts, leading) = contact.charts().unwrap();
    assert_eq!((names(&charts), leading), (vec!["peers-ball".into(), "peers-blocks".into()], 2));
}

fn block() -> TouchBlock {
    TouchBlock::new([6, 5, 3]).unwrap()
}

/// What an engine says in a test: the same vertical force throughout, and friction.
struct Steady {
    h: f64,
    force: DVec3,
    friction: Option<DVec3>,
    /// The surface sinks below the ball.
    yields: bool,
}

impl Finger for Steady {
    fn row(&self, block: &TouchBlock) -> TouchRow {
        block.row("steady", "1", "as told".into())
    }
    fn step(&self) -> f64 {
        self.h
    }
    fn start(&mut self, _: &TouchBlock, friction: f64) -> Result<()> {
        match self.friction {
            None if friction > 0.0 => Err(BenchError::Rival("no friction here".into())),
            _ => Ok(()),
        }
    }
    fn advance(&mut self, block: &TouchBlock, places: &[DVec3]) -> Result<TouchTurn> {
        let sample = Sample { ms: 2.0, force: self.force, friction: self.friction };
        let down = if self.yields { DVec3::Z * -(DEPTH + GAP) } else { DVec3::ZERO };
        let displacements = vec![down; block.mesh.points.len()];
        Ok(TouchTurn { samples: vec![sample; places.len()], displacements })
    }
}

/// Row of such an engine under runs without and with friction, against a truth of 1 N.
fn judge(finger: Steady) -> TouchRow {
    let block = block();
    let row = TouchRow { force: Some(1.0), ..TouchRow::default() };
    let truths = [TouchTruth { model: Model::StVK, row }];
    let mut fingers: Vec<Box<dyn Finger>> = vec![Box::new(finger)];
    let [smooth, rough] = [0.0, FRICTION].map(|friction| run(&block, &mut fingers, friction));
    let mut row = fingers[0].row(&block);
    let faces = TouchRow { force: Some(1.2), ..TouchRow::default() };
    figures(&mut row, fingers[0].as_ref(), &truths, &faces, [&smooth[0], &rough[0]], Some(1.1));
    row
}

#[test]
fn the_ball_goes_the_stated_way_in_whole_steps() {
    assert_eq!(BALL.place(0.0), AT);
    for (t, way) in BALL.phases().into_iter().zip([0.0, 0.0, DRAG[0]]) {
        let place = AT + DVec3::new(way, 0.0, -GAP - DEPTH);
        assert!(BALL.place(t).distance(place) < 1e-15);
        assert!((t / TURN - (t / TURN).round()).abs() < 1e-12);
    }
    for finger in ours(false) {
        let steps = TURN / finger.step();
        assert!((steps - steps.round()).abs() < 1e-9, "{steps}");
    }
    let block = block();
    // the ball stays within the sides
    for end in [AT, BALL.place(BALL.phases()[2])] {
        assert!(end.x - RADIUS > 0.0 && end.x + RADIUS < SIZE.x);
        assert!(end.y - RADIUS > 0.0 && end.y + RADIUS < SIZE.y);
    }
    assert_eq!([block.fixed.len(), block.surface.len()], [42; 2]);
    let mass: f64 = masses(&block.mesh, 1000.0).iter().sum();
    assert!((mass / (1000.0 * SIZE.element_product()) - 1.0).abs() < 1e-12);
}

#[test]
fn depth_is_that_of_the_deepest_vertex() {
    let block = block();
    let mut u = vec![DVec3::ZERO; block.mesh.points.len()];
    let vertex = block.surface[20] as usize;
    let over = block.mesh.points[vertex] + DVec3::Z * (RADIUS - 0.004);
    assert!((block.depth(&u, over) - 0.004).abs() < 1e-15);
    assert!(block.depth(&u, over + DVec3::Z * 0.005) < 0.0);
    u[vertex].z = -0.001;
    assert!((block.depth(&u, over) - 0.003).abs() < 1e-15);
}

#[test]
fn figures_follow_from_what_the_engines_say() {
    let friction = DVec3::X * -0.33;
    let told = DVec3::Z * 1.1 + friction;
    let row = judge(Steady { h: 0.01, force: told, friction: Some(friction), yields: true });
    assert!((row.force.unwrap() - 1.1).abs() < 1e-12);
    assert!((row.error_percent.unwrap() - 10.0).abs() < 1e-9);
    assert!((row.off_second_percent.unwrap() + 100.0 / 12.0).abs() < 1e-9);
    assert!((row.friction_ratio.unwrap() - 1.0).abs() < 1e-12);
    assert!(row.ripple_percent.unwrap().abs() < 1e-9);
    assert_eq!([row.ms_per_step, row.ms_with_friction], [Some(2.0); 2]);
    assert!((row.cost_per_simulated_second.unwrap() - 0.2).abs() < 1e-12);
    assert!(row.depth_mm.unwrap() < 0.1 && row.note.contains("the clamp feels"), "{row:?}");

    // a surface that does not move lets the ball through; an engine may refuse friction
    let row = judge(Steady { h: 0.05, force: DVec3::Z, friction: None, yields: false });
    assert!(row.note.contains("goes through") && row.note.contains("no friction here"), "{row:?}");
    assert_eq!([row.friction_ratio, row.ms_with_friction], [None; 2]);

    // no figure is made of a state that is not finite
    let row = judge(Steady { h: 0.1, force: DVec3::NAN, friction: None, yields: true });
    assert!(row.note.contains("not finite"), "{row:?}");
    assert_eq!([row.force, row.ripple_percent, row.ms_per_step], [None; 3]);
}

/// Exact contact in steps settles to the truth, and the row survives JSON.
#[test]
fn exact_steps_settle_to_the_truth() {
    let mut fingers: Vec<Box<dyn Finger>> = ours(true).into_iter().skip(2).take(1).collect();
    let rows = touch::compete(&block(), &mut fingers).unwrap();
    let [truth, faces, row] = rows.as_slice() else { panic!("{rows:?}") };
    assert_eq!([truth.engine.as_str(), faces.engine.as_str()], ["truth"; 2]);
    assert!(truth.force.unwrap() > 0.1 && faces.error_percent.unwrap() > 0.0);
    assert!(row.setting.contains("exact"), "{row:?}");
    assert!(row.error_percent.unwrap().abs() < 1e-2 && row.depth_mm.unwrap() < 1e-2, "{row:?}");
}

/// Units and signs: what the clamp feels is near the equilibrium of Rapier's own energy, though its cells are
/// of less than a cubic centimetre, and the ball stays outside.
#[cfg(feature = "rapier")]
#[test]
fn small_cells_push_back() {
    let block = TouchBlock::new([6, 5, 3]).unwrap();
    let mut fingers: Vec<Box<dyn Finger>> =
        rapier::fingers(&block, true).unwrap().into_iter().skip(1).collect();
    let rows = touch::compete(&block, &mut fingers).unwrap();
    let own = rows.iter().find(|r| r.setting.contains("corotational")).unwrap();
    let row = rows.last().unwrap();
    let ratio = row.force.unwrap() / own.force.unwrap();
    assert!((0.7..2.0).contains(&ratio) && row.engine == "Rapier", "{row:?}");
    assert!(row.depth_mm.unwrap() < 2.0 && row.friction_ratio.is_none(), "{row:?}");
    assert!(row.note.contains("corotational") && !row.note.contains("goes through"), "{row:?}");
}

#[test]
fn the_second_block_goes_the_stated_way_in_whole_steps() {
    let way = bodies::WAY;
    for (t, along) in way.phases().into_iter().zip([0.0, 0.0, way.drag[0]]) {
        let place = way.start + DVec3::new(along, 0.0, -way.gap - way.depth);
        assert!(way.place(t).distance(place) < 1e-15);
        assert!((t / TURN - (t / TURN).round()).abs() < 1e-9);
    }
    for finger in ours_with_blocks(false) {
        let steps = TURN / finger.step();
        assert!((steps - steps.round()).abs() < 1e-9, "{steps}");
    }
    for (quick, tetrahedra) in [(true, 2 * 1176), (false, 2 * 5184)] {
        let block = TouchBlock::pair(bodies::cells(quick)).unwrap();
        let row = block.row("e", "1", String::new());
        assert_eq!(row.elements, tetrahedra);
        assert!(row.scene.contains("two blocks of 0.1 x 0.1 x 0.05 m"), "{}", row.scene);
    }
}

#[test]
fn depth_of_blocks_is_that_of_the_deepest_vertex() {
    let block = TouchBlock::pair([3, 3, 2]).unwrap();
    let n = block.mesh.points.len();
    let mut u = vec![DVec3::ZERO; 2 * n];
    let depth = |u: &[DVec3]| block.depth(u, DVec3::ZERO);
    assert!((depth(&u) + bodies::WAY.gap).abs() < 1e-15);
    u[n..].fill(DVec3::Z * -0.003);
    assert!((depth(&u) - 0.002).abs() < 1e-15);
    // a vertex of the lower block in the upper one, then one of the upper block in the lower one
    let inner = |rows: &[u32]| {
        let inside = |x: f64| x > 0.02 && x < 0.08;
        let inside = |v: &&u32| {
            let p = block.mesh.points[**v as usize];
            inside(p.x) && inside(p.y)
        };
        *rows.iter().find(inside).unwrap() as usize
    };
    u[inner(&block.surface)].z += 0.001;
    assert!((depth(&u) - 0.003).abs() < 1e-15);
    u[n + inner(&block.fixed)].z -= 0.004;
    assert!((depth(&u) - 0.006).abs() < 1e-3, "{}", depth(&u));
}

#[test]
fn ripple_is_off_a_parabola() {
    let parabola = |i: i32| 3.0 + 0.5 * f64::from(i) - 0.02 * f64::from(i * i);
    let values: Vec<f64> = (0..20).map(parabola).collect();
    assert!(bodies::off_parabola(&values).iter().all(|x| x.abs() < 1e-12));
    let wavy: Vec<f64> =
        (0..20).map(|i| parabola(i) + if i % 2 == 0 { 0.1 } else { -0.1 }).collect();
    let rest = bodies::off_parabola(&wavy);
    assert!(rest.iter().all(|x| (x.abs() - 0.1).abs() < 0.03), "{rest:?}");
}

/// Default steps of two blocks come to the equilibrium on the same mesh, and the row has every figure.
#[test]
fn default_steps_of_two_blocks_settle_to_the_equilibrium() {
    let mut fingers: Vec<Box<dyn Finger>> = ours_with_blocks(true).into_iter().take(1).collect();
    let rows = touch::compete(&TouchBlock::pair([4, 4, 2]).unwrap(), &mut fingers).unwrap();
    let [same, fine, row] = rows.as_slice() else { panic!("{rows:?}") };
    assert_eq!([fine.engine.as_str(), same.engine.as_str()], ["truth"; 2]);
    assert_eq!([fine.elements, same.elements], [8 * row.elements, row.elements]);
    assert!(same.force > fine.force && fine.force.unwrap() > 1.0, "{rows:?}");
    assert!(row.error_percent.unwrap().abs() < 0.5, "{row:?}");
    assert!((0.5..1.2).contains(&row.friction_ratio.unwrap()), "{row:?}");
    assert!((0.0..0.5).contains(&row.depth_mm.unwrap()), "{row:?}");
    assert!(row.over_apart.is_some() && row.friction_over_apart.is_some(), "{row:?}");
    let page = serde_json::to_string(&row).unwrap();
    assert!(page.contains("over_apart") && page.contains("off_second_percent"), "{page}");
}

/// The held face moves, the skins of both blocks are taken off, and the lower block's clamp feels the upper one.
#[cfg(feature = "rapier")]
#[test]
fn soft_bodies_press_on_each_other() {
    let block = TouchBlock::pair([4, 4, 2]).unwrap();
    let mut fingers: Vec<Box<dyn Finger>> =
        rapier::fingers(&block, true).unwrap().into_iter().skip(1).collect();
    let rows = touch::compete(&block, &mut fingers).unwrap();
    let row = rows.last().unwrap();
    let own = rows.iter().find(|r| r.setting.contains("corotational")).unwrap();
    let ratio = row.force.unwrap() / own.force.unwrap();
    assert!((0.5..2.0).contains(&ratio) && row.engine == "Rapier", "{row:?}");
    assert!(!row.note.contains("goes through") && row.ms_apart.is_some(), "{row:?}");
}

/// A wound on the blade that opens by as much as the continuum has no error; one that is aside, or closed, has.
#[test]
fn wounds_are_judged_by_blade_and_continuum() {
    let beam = cut::CutBeam::new(2).unwrap();
    let load: DVec3 = beam.forces().iter().map(|(_, force)| *force).sum();
    assert!((load.z / (-10.0 * 0.06 * 0.06) - 1.0).abs() < 1e-12, "{load}");
    // triangle of the blade, and of both lips of a section through it
    let [a, b, c] = beam.triangle();
    let area = 0.5 * (b - a).cross(c - a);
    let truth = 33.65 * 0.06_f64.powi(3) * 1e-4;
    let lips = |aside: DVec3, part: f64| {
        let open = 0.5 * part * truth * area / area.length_squared();
        let right = [a, b, c].map(|x| [x + aside, open]);
        vec![right, [a, c, b].map(|x| [x + aside, -open])]
    };
    let [rms, largest, opening] = beam.judge(&lips(DVec3::ZERO, -1.0));
    assert!(rms < 1e-12 && largest < 1e-12 && opening.abs() < 1e-9, "{rms} {largest} {opening}");
    let aside = area.normalize() * 0.003;
    let [rms, largest, opening] = beam.judge(&lips(aside, -0.5));
    assert!((rms - 0.1).abs() < 1e-12 && (largest - 0.1).abs() < 1e-12, "{rms} {largest}");
    assert!((opening + 50.0).abs() < 1e-9, "{opening}");
}

/// Cuts through elements lie on the blade, and no energy comes or goes.
#[test]
fn a_beam_is_cut_beside_rivals() {
    let rows = cut::run(true).unwrap();
    let [ours, others]: [Vec<&cut::CutRow>; 2] =
        [true, false].map(|own| rows.iter().filter(|row| (row.engine == "Sinew") == own).collect());
    assert_eq!((ours.len(), others.len()), (3, if cfg!(feature = "rapier") { 3 } else { 0 }));
    for row in ours {
        let limit = if row.precision == "f32" { 1e-5 } else { 1e-12 };
        // a mark keeps a thousandth of an edge from its ends
        assert!(row.distance_largest.unwrap() < 1e-3 && row.cut_ms.is_some(), "{row:?}");
        assert!(row.energy_change.unwrap().abs() < limit, "{row:?}");
        assert!((-90.0..-20.0).contains(&row.opening_percent.unwrap()), "{row:?}");
    }
    for row in others {
        assert!(row.distance_rms.unwrap() > 0.05 && row.ms_per_step.is_some(), "{row:?}");
    }
}
