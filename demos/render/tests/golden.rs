//! Pictures of a software adapter against stored ones. `SINEW_GOLDEN=write` draws these again.

use sinew_render::adapter::{AdapterError, AdapterRequest, Gpu, open};
use sinew_render::camera::CameraRequest;
use sinew_render::image::{Image, Packing};
use sinew_render::overlay::Fonts;
use sinew_render::painter::{Captions, Painter};
use sinew_render::scene::Recording;
use std::io::Write;
use std::path::PathBuf;

/// A software adapter, or none after a message.
fn software() -> Option<Gpu> {
    let request = AdapterRequest { software: Some(true), ..AdapterRequest::default() };
    match open(&request) {
        Ok(gpu) => Some(gpu),
        Err(error @ (AdapterError::NoneFound | AdapterError::NoMatch { .. })) => {
            let _ = writeln!(std::io::stderr(), "skipped: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Mean difference allowed, of 255: drivers round edges differently.
const MEAN: f64 = 0.6;
/// Share of pixels that may differ by more than [`STEP`] in a colour: edges moved by part of a pixel.
const SHARE: f64 = 0.004;
const STEP: u8 = 48;

fn compare(name: &str, image: &Image) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{name}.png"));
    if std::env::var("SINEW_GOLDEN").as_deref() == Ok("write") {
        image.write_png(&path, Packing::Fast).unwrap();
    }
    let golden = Image::read_png(&path).unwrap();
    let [mean, largest] = image.difference(&golden).expect("the same size");
    let far = image.data.chunks_exact(4).zip(golden.data.chunks_exact(4));
    let far = far.filter(|(a, b)| (0..3).any(|k| a[k].abs_diff(b[k]) > STEP)).count();
    let share = far as f64 / f64::from(image.width * image.height);
    if mean > MEAN || share > SHARE {
        let found = std::env::temp_dir().join(format!("sinew-golden-{name}.png"));
        image.write_png(&found, Packing::Fast).unwrap();
        panic!(
            "{name}: mean difference {mean:.3} ({MEAN} allowed), largest {largest}, share of far pixels {share:.4} \
             ({SHARE} allowed); found: {}",
            found.display()
        );
    }
}

#[test]
fn a_bent_bar_looks_as_it_did() {
    let Some(gpu) = software() else { return };
    let recording = crate::common::bar();
    let camera = CameraRequest::default();
    let mut painter =
        Painter::new(gpu, [320, 180], &recording, camera, Some(0), Captions::ALL).unwrap();
    let fonts = Fonts::default();
    let image = painter.picture(&fonts, &recording, 3).unwrap();
    compare("bar", &image);
    // it is the difference that tells: another frame is far away
    let straight = painter.picture(&fonts, &recording, 0).unwrap();
    assert!(image.difference(&straight).unwrap()[0] > 4.0 * MEAN);
}

#[test]
fn plain_colours_with_edges_and_without_ground_look_as_they_did() {
    let Some(gpu) = software() else { return };
    let recording = crate::common::bar();
    let camera = "205,35,1.2".parse().unwrap();
    let mut painter =
        Painter::new(gpu, [240, 240], &recording, camera, None, Captions::ALL).unwrap();
    (painter.look.ground, painter.look.edges) = (false, true);
    compare("plain", &painter.picture(&Fonts::default(), &recording, 2).unwrap());
}

#[test]
fn films_give_the_pictures_of_stills_in_order() {
    let Some(gpu) = software() else { return };
    let recording = crate::common::bar();
    let (camera, captions) = (CameraRequest::default(), Captions::ALL);
    let mut painter = Painter::new(gpu, [160, 90], &recording, camera, Some(0), captions).unwrap();
    painter.captions = Captions { title: false, note: false, bar: false };
    let mut film = Vec::new();
    let frames = [0, 1, 2, 3, 1, 0, 2];
    painter
        .film(&recording, &frames, |i, image| {
            film.push((i, image));
            Ok(())
        })
        .unwrap();
    assert_eq!(film.iter().map(|f| f.0).collect::<Vec<_>>(), frames);
    for (i, image) in &film {
        let still = painter.picture(&Fonts::default(), &recording, *i).unwrap();
        assert_eq!(still.difference(image), Some([0.0, 0.0]), "frame {i}");
    }
}

#[test]
fn sizes_out_of_range_are_refused() {
    let Some(gpu) = software() else { return };
    let recording = crate::common::bar();
    for size in [[0, 100], [100, 1 << 20]] {
        let painter = Painter::new(
            gpu.clone(),
            size,
            &recording,
            CameraRequest::default(),
            None,
            Captions::ALL,
        );
        let error = painter.err().expect("refused").to_string();
        assert!(error.contains("pixels along each side"), "{error}");
    }
}

#[test]
fn a_comparison_holds_its_panels_beside_each_other() {
    use sinew_render::compare::{Comparison, Grid, Layout, Panel};
    let Some(gpu) = software() else { return };
    let bent = crate::common::bar();
    let mut other = bent.clone();
    other.fields[0].range = [0.0, 1.3];
    let grid = Grid {
        title: "Title",
        layout: Layout::Panels(2, [160, 120]),
        camera: CameraRequest::default(),
        field: Some(0),
    };
    let of = |recordings: &[&Recording]| {
        let panel = |r: &&Recording| Panel { label: "label".into(), recording: (*r).clone() };
        Comparison::new(gpu.clone(), recordings.iter().map(panel).collect(), &grid)
    };
    let mut same = of(&[&bent, &bent, &bent]).unwrap();
    let image = same.picture("subtitle", &[3, 3, 0]).unwrap();
    // two columns and a bar, two rows and a title
    assert_eq!([image.width, image.height], same.size());
    assert!(image.width > 320 && image.height > 240 && image.width < 480, "{}", image.width);
    let wide = of(&[&bent, &bent, &other]).unwrap().picture("subtitle", &[3, 3, 0]).unwrap();
    // one run with larger values changes the colours of all
    assert!(image.difference(&wide).unwrap()[0] > 0.5);
    let beyond = same.picture("subtitle", &[3, 9, 0]).unwrap_err().to_string();
    assert!(beyond.contains("frame 9"), "{beyond}");
    assert!(of(&[]).is_err());
}
