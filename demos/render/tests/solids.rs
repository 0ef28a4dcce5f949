//! Balls, rods and cones.

use glam::Vec3;
use sinew_render::solids::{Instance, ball, cone, rod};

#[test]
fn solids_are_closed_and_turned_outward() {
    // volumes by the divergence theorem: inscribed polygons are a little smaller
    let pi = std::f32::consts::PI;
    for ((vertices, indices), volume) in [(ball(), 4.0 / 3.0 * pi), (rod(), pi), (cone(), pi / 3.0)]
    {
        let sum: f32 = indices
            .chunks_exact(3)
            .map(|t| {
                let p = [t[0], t[1], t[2]].map(|i| Vec3::from_array(vertices[i as usize].place));
                p[0].dot(p[1].cross(p[2])) / 6.0
            })
            .sum();
        assert!(sum < volume && sum > 0.9 * volume, "{sum} beside {volume}");
    }
}

#[test]
fn instances_stand_along_their_direction() {
    let along = Vec3::new(0.0, 3.0, 4.0);
    let i = Instance::along(Vec3::ONE, along, 0.5, [255; 3]).unwrap();
    let [x, y, z] = i.axes.map(Vec3::from_array);
    assert_eq!(z, along);
    assert!(x.dot(y).abs() < 1e-6 && x.dot(z).abs() < 1e-6 && (x.length() - 0.5).abs() < 1e-6);
    assert!(x.cross(y).dot(z) > 0.0);
    assert!(Instance::along(Vec3::ONE, Vec3::ZERO, 0.5, [0; 3]).is_none());
}
