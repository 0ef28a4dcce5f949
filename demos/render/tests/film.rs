//! Films, with and without ffmpeg.

use sinew_render::film::{Film, has_ffmpeg};
use sinew_render::image::Image;
use std::io::Write;
use std::path::PathBuf;

fn pictures() -> Vec<Image> {
    (0..5).map(|i| Image::filled(33, 17, [40 * i, 100, 200 - 30 * i])).collect()
}

fn temporary(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("sinew-film-{}-{name}", std::process::id()))
}

#[test]
fn an_animated_png_stands_in_for_a_film() {
    let path = temporary("stand-in.mp4");
    let mut film = Film::start_with(&path, [33, 17], 5, 25.0, false).unwrap();
    assert!(film.is_png());
    for picture in pictures() {
        film.add(&picture).unwrap();
    }
    let path = film.finish().unwrap();
    assert_eq!(path.extension().unwrap(), "png");
    let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
    let reader = png::Decoder::new(file).read_info().unwrap();
    assert_eq!(reader.info().animation_control().unwrap().num_frames, 5);
    std::fs::remove_file(path).unwrap();
}

#[test]
fn ffmpeg_makes_a_film_or_says_why_not() {
    if !has_ffmpeg() {
        let mut err = std::io::stderr();
        let _ = writeln!(err, "skipped: no ffmpeg on the path");
        return;
    }
    let path = temporary("real.mp4");
    let mut film = Film::start(&path, [33, 17], 5, 25.0).unwrap();
    for picture in pictures() {
        film.add(&picture).unwrap();
    }
    let bytes = std::fs::read(film.finish().unwrap()).unwrap();
    assert!(bytes.len() > 500 && &bytes[4..8] == b"ftyp");
    std::fs::remove_file(path).unwrap();
    let wrong = temporary("wrong.nonsense");
    let mut film = Film::start(&wrong, [33, 17], 5, 25.0).unwrap();
    let results: Vec<_> = pictures().iter().map(|p| film.add(p)).collect();
    let error = match results.into_iter().find_map(Result::err) {
        Some(error) => error,
        None => film.finish().unwrap_err(),
    };
    assert!(error.to_string().contains("nonsense"), "{error}");
}
