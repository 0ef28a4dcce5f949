//! States that are kept and taken up again through the plain face.

use crate::{held, options};
use sinew_embed::*;
use sinew_scene::shipped_scene;

/// A scene with a cutter, one with hands, one with jaws: back to the middle, in the same simulation and in one built
/// anew, and on to the end.
#[test]
fn scenes_go_back_and_on() {
    for name in ["liver_resection", "grasp", "two_organs"] {
        let path = shipped_scene(name).display().to_string();
        let overrides = Overrides { threads: Some(1), ..Overrides::default() };
        let build = || Embedding::from_scene_file(&path, &overrides).unwrap();
        let mut sim = build();
        sim.step(25).unwrap();
        let middle = sim.snapshot().unwrap();
        sim.step(25).unwrap();
        let hash = sim.hash();
        sim.restore(&middle).unwrap();
        assert_eq!((sim.steps_done(), middle.step()), (25, 25));
        sim.step(25).unwrap();
        assert_eq!(sim.hash(), hash, "{name}");
        let mut new = build();
        new.restore(&Snapshot::from_bytes(&middle.to_bytes()).unwrap()).unwrap();
        new.step(25).unwrap();
        assert_eq!(new.hash(), hash, "{name}");
    }
}

#[test]
fn handles_go_back_too() {
    let (mut sim, body, hold) = held(&options());
    let ball = Shape::Sphere { radius: 0.01 };
    let at = DVec3::new(0.05, 0.05, 0.058);
    let gone = sim.add_tool(Tool::new("gone", ball.clone(), at), None).unwrap();
    sim.step(2).unwrap();
    let force = sim.tool_report(gone).unwrap().force;
    assert!(force.z > 0.0);
    let snapshot = sim.snapshot().unwrap();
    let positions = sim.positions(body).unwrap().to_vec();
    sim.remove(gone).unwrap();
    let later = sim.add_tool(Tool::new("later", ball, at), None).unwrap();
    sim.set_dt(0.002).unwrap();
    sim.remove_elements(body, Region::Tetrahedra(vec![0, 1]), MassPolicy::Recompute).unwrap();
    sim.step(2).unwrap();
    let cut = sim.surface(body).unwrap().revision;
    sim.restore(&snapshot).unwrap();
    assert_eq!(sim.tool_report(gone).unwrap().force, force);
    assert_eq!(sim.tool_report(later).unwrap_err().code, Code::Handle);
    assert_eq!((sim.dt(), sim.name(hold).unwrap().as_str()), (0.01, "floor"));
    assert_eq!(sim.positions(body).unwrap(), positions);
    assert_ne!(sim.surface(body).unwrap().revision, cut);
    assert_eq!(sim.remaining(body, ElementKind::Tetrahedron).unwrap().len(), 192);

    // another simulation, built alike but for the tool, which it gets
    let (mut other, _, hold) = held(&options());
    other.restore(&snapshot).unwrap();
    let tool = other.find(Kind::Tool, "gone").unwrap();
    assert_eq!(other.tool_report(tool).unwrap().force, force);
    assert_eq!(other.list(Kind::Tool).len(), 1);
    assert!(other.name(hold).is_ok());
    assert_eq!(other.hash(), sim.hash());
    let error = other.restore(&held(&Options { threads: 2, ..options() }).0.snapshot().unwrap());
    error.unwrap();
    let mut bytes = snapshot.to_bytes();
    bytes[40] ^= 1;
    let error = Snapshot::from_bytes(&bytes).unwrap_err();
    assert_eq!(error.code, Code::Snapshot);
    assert!(error.text.contains("checksum"), "{error}");
    let single = Options { precision: Precision::F32, ..options() };
    let error = held(&single).0.restore(&snapshot).unwrap_err();
    assert!(error.text.contains("the snapshot is in f64, the simulation in f32"), "{error}");
}
