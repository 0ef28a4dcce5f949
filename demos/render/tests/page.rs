//! Numbers of a page: packed, and as they come back.

use crate::common::displacement;
use base64::Engine;
use glam::Vec3;
use sinew_render::camera::CameraRequest;
use sinew_render::page::{self, Quantiser, run_data, whole_scalar};
use sinew_render::scene::{Frame, Recording};
use sinew_render::skin::Skin;
use std::sync::Arc;

#[test]
fn positions_come_back_within_half_a_step() {
    let quantiser = Quantiser { low: Vec3::new(-0.1, 2.0, 0.0), step: Vec3::new(1e-6, 3e-5, 1e-3) };
    for i in 0..2000u32 {
        let share = |k: u32| ((i * k) % 65_521) as f32;
        let p = quantiser.low + quantiser.step * Vec3::new(share(31), share(97), share(7919));
        let p = p + quantiser.step * 0.4;
        let back = Vec3::from_array(quantiser.position(quantiser.whole(p.to_array())));
        let error = (back - p).abs();
        // and the rounding of f32
        let bound = 0.5 * quantiser.step + 2.0 * f32::EPSILON * p.abs();
        assert!(error.cmple(bound).all(), "{error} beside {bound}");
    }
    assert_eq!(quantiser.whole([-9.0, 1e9, f32::NAN]), [0, u16::MAX, 0]);
}

#[test]
fn scalars_come_back_within_half_a_step() {
    let range = [-0.3, 1.7];
    for i in 0..=1000 {
        let value = -0.3 + 2.0 * i as f32 / 1000.0;
        let back = range[0] + (range[1] - range[0]) * f32::from(whole_scalar(value, range)) / 255.0;
        assert!((back - value).abs() <= 0.5 * 2.0 / 255.0 + 1e-6);
    }
    assert_eq!(whole_scalar(9.0, range), 255);
    assert_eq!(whole_scalar(f32::NAN, range), 0);
    assert_eq!(whole_scalar(1.0, [1.0, 1.0]), 0);
}

#[test]
fn the_packed_numbers_are_those_of_the_run() {
    let rest = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let skin = Arc::new(Skin::new(&[([0, 1, 2], 0)], &rest, 40.0));
    let frame = |i: usize| Frame {
        step: i as u64,
        time: i as f64,
        points: rest.iter().map(|p| p.map(|x| x * (1.0 - 0.1 * i as f32))).collect(),
        skin: skin.clone(),
        fields: vec![vec![0.1 * i as f32; 3]],
        ..Frame::default()
    };
    let recording = Recording {
        title: "A </script> title".into(),
        up: Vec3::Z,
        rest: rest.clone(),
        rest_skin: skin.clone(),
        fields: vec![displacement(0.3)],
        bodies: vec!["body".into()],
        interval: 1.0,
        frames: (0..4).map(frame).collect(),
        ..Recording::default()
    };
    let data = run_data(&recording).unwrap();
    let text = data["payload"].as_str().unwrap();
    let packed = base64::engine::general_purpose::STANDARD.decode(text).unwrap();
    let mut bytes = Vec::new();
    let mut decoder = flate2::read::ZlibDecoder::new(&packed[..]);
    std::io::Read::read_to_end(&mut decoder, &mut bytes).unwrap();
    // rest, surface, and four frames of positions and scalars
    assert_eq!(bytes.len(), 18 + 4 * (3 + 3 + 3) + 4 * (18 + 3));
    // walk through the differences up to the last frame
    let mut at = 18 + 36;
    let mut places: Vec<u16> =
        (0..9).map(|i| u16::from(bytes[i]) + 256 * u16::from(bytes[9 + i])).collect();
    let mut scalars = [0u8; 3];
    for _ in 0..4 {
        for i in 0..9 {
            let d = u16::from(bytes[at + i]) + 256 * u16::from(bytes[at + 9 + i]);
            places[i] = places[i].wrapping_add(d);
        }
        at += 18;
        for (i, s) in scalars.iter_mut().enumerate() {
            *s = s.wrapping_add(bytes[at + i]);
        }
        at += 3;
    }
    let quantiser = Quantiser::of(&recording);
    for (p, q) in recording.frames[3].points.iter().zip(places.chunks_exact(3)) {
        let back = quantiser.position([q[0], q[1], q[2]]);
        for k in 0..3 {
            assert!((back[k] - p[k]).abs() <= 0.5 * quantiser.step[k] + 1e-6);
        }
    }
    assert_eq!(scalars, [255; 3]);
    let page = page::page(&[&recording, &recording], CameraRequest::default()).unwrap();
    assert!(page.contains("<\\/script> title") && page.contains("A &lt;/script> title"));
    assert!(!page.contains("http:") && !page.contains("https:"), "nothing is fetched");
    assert!(page::page(&[], CameraRequest::default()).is_err());
}
