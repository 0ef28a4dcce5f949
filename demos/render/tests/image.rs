//! Pictures: PNG files, palettes, pasting.

use sinew_render::image::{Image, Packing, quantise};

fn ramp() -> Image {
    let mut image = Image::filled(64, 32, [0; 3]);
    for y in 0..32 {
        for x in 0..64 {
            image.blend(x, y, [(4 * x) as u8, (8 * y) as u8, 90], 1.0);
        }
    }
    image
}

fn temporary(name: &str) -> std::path::PathBuf {
    std::env::temp_dir().join(format!("sinew-image-{}-{name}.png", std::process::id()))
}

#[test]
fn png_files_come_back() {
    let (image, path) = (ramp(), temporary("fast"));
    image.write_png(&path, Packing::Fast).unwrap();
    assert_eq!(Image::read_png(&path).unwrap(), image);
    std::fs::remove_file(&path).unwrap();
    let missing = Image::read_png(&path).unwrap_err().to_string();
    assert!(missing.contains("sinew-image"), "{missing}");
}

#[test]
fn a_palette_stays_close_and_small() {
    let (image, path) = (ramp(), temporary("small"));
    image.write_png(&path, Packing::Small).unwrap();
    let back = Image::read_png(&path).unwrap();
    let [mean, largest] = image.difference(&back).unwrap();
    // 2048 colours by 256: boxes of 8, of a size of 8 to 16
    assert!(mean < 5.0 && largest < 24.0, "{mean} {largest}");
    std::fs::remove_file(path).unwrap();
    // few colours are kept as they are
    let plain = Image::filled(9, 7, [1, 2, 3]);
    let (palette, indices) = quantise(&plain);
    assert_eq!((palette, indices), (vec![[1, 2, 3]], vec![0; 63]));
}

#[test]
fn pasting_and_blending_stay_inside() {
    let mut image = Image::filled(4, 4, [0; 3]);
    image.paste(&Image::filled(3, 3, [200; 3]), [2, 3]);
    assert_eq!(image.pixel(3, 3), [200; 3]);
    assert_eq!(image.pixel(1, 3), [0; 3]);
    image.fill([-5, -5], [7, 7], [100; 3], 0.5);
    assert_eq!(image.pixel(1, 1), [50; 3]);
    assert_eq!(image.pixel(2, 2), [0; 3]);
    assert_eq!(image.difference(&Image::filled(4, 5, [0; 3])), None);
}
