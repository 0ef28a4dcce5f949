//! Colour maps.

use sinew_render::colour::{ColourMap, from_oklab, oklab};

#[test]
fn oklab_there_and_back() {
    for colour in [[0, 0, 0], [255, 255, 255], [12, 200, 99], [250, 3, 180]] {
        let back = from_oklab(oklab(colour));
        for k in 0..3 {
            assert!(back[k].abs_diff(colour[k]) <= 1, "{colour:?} {back:?}");
        }
    }
    assert!((oklab([255, 255, 255])[0] - 1.0).abs() < 1e-3);
}

#[test]
fn sequential_maps_change_lightness_evenly() {
    for map in [ColourMap::Viridis, ColourMap::Ember] {
        let lightness: Vec<f32> = map.table().into_iter().map(|c| oklab(c)[0]).collect();
        let mean = (lightness[255] - lightness[0]) / 255.0;
        assert!(mean.abs() > 0.0015, "{map:?}");
        // over 16 samples, since eight bits round
        for w in lightness.windows(17) {
            let share = (w[16] - w[0]) / 16.0 / mean;
            assert!(share > 0.4 && share < 1.9, "{map:?}: {share} of the mean");
        }
    }
}

#[test]
fn the_diverging_map_is_lightest_in_the_middle() {
    let table = ColourMap::Diverging.table();
    let lightness = |i: usize| oklab(table[i])[0];
    for i in 0..127 {
        assert!(lightness(i) <= lightness(i + 1) + 0.004);
        assert!(lightness(255 - i) <= lightness(254 - i) + 0.004);
        assert!((lightness(i) - lightness(255 - i)).abs() < 0.09, "{i}");
    }
}

#[test]
fn values_outside_take_the_ends() {
    for map in ColourMap::ALL {
        assert_eq!(map.at(-3.0), map.at(0.0));
        assert_eq!(map.at(9.0), map.at(1.0));
        assert_eq!(map.at(f32::NAN), map.at(0.0));
    }
}
