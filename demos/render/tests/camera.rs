//! Cameras that fit what they show.

use glam::Vec3;
use sinew_render::camera::{Camera, CameraRequest, Margins};

fn box_corners(low: Vec3, high: Vec3) -> Vec<Vec3> {
    (0..8)
        .map(|i| {
            let pick = |k: usize| if i >> k & 1 == 1 { high[k] } else { low[k] };
            Vec3::new(pick(0), pick(1), pick(2))
        })
        .collect()
}

#[test]
fn all_points_are_inside_the_margins_and_touch_them() {
    let margins = Margins { left: 0.05, right: 0.2, top: 0.1, bottom: 0.15 };
    for size in [Vec3::new(0.2, 0.02, 0.02), Vec3::new(0.01, 0.01, 3.0), Vec3::ONE] {
        let points = box_corners(Vec3::new(5.0, -1.0, 2.0), Vec3::new(5.0, -1.0, 2.0) + size);
        for (azimuth, elevation) in [(0.0, 0.0), (25.0, 18.0), (200.0, 80.0), (-70.0, -30.0)] {
            let request = CameraRequest::Orbit { azimuth, elevation, distance: 1.0 };
            let camera =
                Camera::fit(request, Vec3::Z, points.iter().copied(), 16.0 / 9.0, margins).unwrap();
            let seen: Vec<[f32; 2]> = points.iter().map(|&p| camera.project(p)).collect();
            let of = |k: usize| seen.iter().map(move |p| p[k]);
            let low = [0, 1].map(|k| of(k).fold(f32::INFINITY, f32::min));
            let high = [0, 1].map(|k| of(k).fold(f32::NEG_INFINITY, f32::max));
            let slack = 2e-3;
            assert!(low[0] > 0.05 - slack && high[0] < 0.8 + slack, "{low:?} {high:?}");
            assert!(low[1] > 0.1 - slack && high[1] < 0.85 + slack, "{low:?} {high:?}");
            let gaps = [low[0] - 0.05, 0.8 - high[0], low[1] - 0.1, 0.85 - high[1]];
            assert!((gaps[0] - gaps[1]).abs() < 0.02, "centred: {gaps:?}");
            let touches = gaps[0].max(gaps[1]).min(gaps[2].max(gaps[3]));
            let nearest = camera.depth[0];
            assert!(touches < 0.01 || nearest < 0.3 * size.length(), "{gaps:?}");
            for p in &points {
                let depth = (*p - camera.eye).dot(camera.forward);
                assert!(depth > camera.depth[0] && depth < camera.depth[1]);
            }
        }
    }
}

#[test]
fn up_is_up_and_axes_are_as_said() {
    let points = box_corners(Vec3::splat(-1.0), Vec3::ONE);
    let at = |azimuth, up: Vec3| {
        let request = CameraRequest::Orbit { azimuth, elevation: 0.0, distance: 1.0 };
        Camera::fit(request, up, points.iter().copied(), 1.0, Margins::default()).unwrap()
    };
    assert!((at(0.0, Vec3::Z).forward - Vec3::Y).length() < 1e-6);
    assert!((at(90.0, Vec3::Z).forward + Vec3::X).length() < 1e-6);
    for up in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::Y] {
        assert!(at(30.0, up).up.dot(up) > 0.999);
    }
}

#[test]
fn words_are_read_or_refused() {
    let read = |s: &str| s.parse::<CameraRequest>();
    let orbit = CameraRequest::Orbit { azimuth: 30.0, elevation: -10.0, distance: 1.5 };
    assert_eq!(read("30, -10, 1.5").unwrap(), orbit);
    let fixed = CameraRequest::Fixed { eye: Vec3::X, target: Vec3::ZERO };
    assert_eq!(read("1,0,0,0,0,0").unwrap(), fixed);
    for wrong in ["", "1", "1,2,3,4", "1,95", "1,2,-1", "a,b", "1,nan", "1,1,1,1,1,1"] {
        let error = read(wrong).unwrap_err().to_string();
        assert!(error.contains("--camera") && error.contains("AZIMUTH"), "{error}");
    }
    let none = std::iter::empty();
    let request = CameraRequest::default();
    assert!(Camera::fit(request, Vec3::Z, none, 1.0, Margins::default()).is_err());
}
