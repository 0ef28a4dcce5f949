//! Marks, numbers and letters of captions.

use sinew_render::image::Image;
use sinew_render::overlay::{Align, Fonts, INK, Weight};
use sinew_render::scale::{mark, scaled_unit, ticks, with_unit};

#[test]
fn marks_are_round_and_inside() {
    assert_eq!(ticks(0.0, 10.0, 5), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
    assert_eq!(ticks(-0.3, 0.3, 5), [-0.2, 0.0, 0.2]);
    for (low, high) in [(0.0, 0.0123), (-7.0, 3.0), (0.8, 1.2), (1e-9, 3e-9), (0.0, 4.2e6)] {
        let values = ticks(low, high, 5);
        assert!((3..=8).contains(&values.len()), "{low} {high}: {values:?}");
        let slack = 1e-6 * (high - low);
        assert!(values.iter().all(|v| *v >= low - slack && *v <= high + slack));
        let steps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(steps.iter().all(|s| (s / steps[0] - 1.0).abs() < 1e-6));
    }
    assert_eq!(ticks(1.0, 1.0, 5), [1.0]);
}

#[test]
fn numbers_have_the_digits_of_their_steps() {
    assert_eq!(mark(0.06, 0.02), "0.06");
    assert_eq!(mark(2.5, 2.5), "2.5");
    assert_eq!(mark(-4.0, 2.0), "−4");
    assert_eq!(mark(0.0, 0.25), "0");
    assert_eq!(mark(0.75, 0.25), "0.75");
    assert_eq!(scaled_unit("m", 0.034), (1e2, "cm".into()));
    assert_eq!(scaled_unit("Pa", 5400.0), (1e-3, "kPa".into()));
    assert_eq!(scaled_unit("m", 1e-9), (1e6, "µm".into()));
    assert_eq!(scaled_unit("", 3.0), (1.0, String::new()));
    assert_eq!(with_unit(0.012_34, "N"), "12.3 mN");
    assert_eq!(with_unit(1.5, "N"), "1.50 N");
    assert_eq!(with_unit(-345.6, "N"), "−346 N");
    assert_eq!(with_unit(0.0, "N"), "0 N");
}

#[test]
fn text_leaves_ink_where_it_stands() {
    let fonts = Fonts::default();
    let mut image = Image::filled(120, 40, [255; 3]);
    let style = (18.0, Weight::Medium);
    let width = fonts.write(&mut image, "Δσ = 1.5 kPa", [4.0, 28.0], style, Align::Left, INK);
    assert!(width > 60.0 && width < 116.0, "{width}");
    let dark = |x: std::ops::Range<u32>| {
        x.flat_map(|x| (0..40).map(move |y| (x, y)))
            .filter(|&(x, y)| image.pixel(x, y)[0] < 100)
            .count()
    };
    assert!(dark(0..(width as u32 + 4)) > 150);
    assert_eq!(dark(width as u32 + 6..120), 0);
    // every letter that the overlay may use is in the font
    for c in "0123456789.,−-–…µ³²%()/ =αλνσΔ·°".chars() {
        assert!(fonts.has(c), "{c}");
    }
    let cut = fonts.fitted("a very long caption indeed", 18.0, Weight::Regular, 100.0);
    assert!(cut.ends_with('…') && fonts.width(&cut, 18.0, Weight::Regular) <= 100.0, "{cut}");
}
