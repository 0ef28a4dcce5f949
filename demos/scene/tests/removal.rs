//! What a tool that cuts has swept.

use glam::DVec3;
use sinew::models::resection::Region;
use sinew_scene::assemble::swept;

#[test]
fn a_tool_sweeps_its_path_once() {
    let path = [(1.0, DVec3::ZERO), (2.0, DVec3::X), (3.0, DVec3::new(1.0, 1.0, 0.0))];
    assert!(swept(&path, 0.1, 0.0, 0.9).is_empty());
    assert!(swept(&path, 0.1, 3.0, 3.5).is_empty());
    let ends = |from, to| -> Vec<[DVec3; 2]> {
        let ends = |r| match r {
            Region::Capsule { from, to, .. } => [from, to],
            _ => unreachable!("a tool sweeps capsules"),
        };
        swept(&path, 0.1, from, to).into_iter().map(ends).collect()
    };
    assert_eq!(ends(0.5, 1.5), [[DVec3::ZERO, DVec3::ZERO], [DVec3::ZERO, DVec3::X * 0.5]]);
    let corner = [DVec3::X * 0.75, DVec3::X];
    assert_eq!(ends(1.75, 2.25), [corner, [DVec3::X, DVec3::new(1.0, 0.25, 0.0)]]);
    assert_eq!(ends(2.5, 4.0).last().unwrap()[1], DVec3::new(1.0, 1.0, 0.0));
}
