//! Colours and colour maps. Maps are laid through a few anchor colours in Oklab, where equal steps look
//! equal, and sampled to [`SAMPLES`] colours.

use serde::{Deserialize, Serialize};

/// Colours of a sampled map.
pub const SAMPLES: usize = 256;

/// An sRGB colour.
pub type Rgb = [u8; 3];

/// From numbers to colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColourMap {
    /// Dark violet over teal to yellow; lightness rises evenly, so that it survives grey print and the
    /// common colour-vision deficiencies.
    #[default]
    Viridis,
    /// Pale over orange to crimson; lightness falls evenly.
    Ember,
    /// Blue over near-white to red, for values with a middle.
    Diverging,
}

impl ColourMap {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Viridis, Self::Ember, Self::Diverging];

    /// Its word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Viridis => "viridis",
            Self::Ember => "ember",
            Self::Diverging => "diverging",
        }
    }

    /// sRGB anchors at equal distances.
    fn anchors(self) -> &'static [Rgb] {
        match self {
            Self::Viridis => &[
                [68, 1, 84],
                [71, 44, 122],
                [59, 81, 139],
                [44, 113, 142],
                [33, 144, 141],
                [39, 173, 129],
                [92, 200, 99],
                [170, 220, 50],
                [253, 231, 37],
            ],
            Self::Ember => &[
                [250, 240, 224],
                [253, 212, 158],
                [247, 166, 104],
                [230, 114, 82],
                [196, 66, 78],
                [146, 26, 68],
            ],
            Self::Diverging => &[
                [33, 62, 140],
                [67, 119, 188],
                [140, 183, 222],
                [236, 238, 240],
                [234, 163, 138],
                [206, 92, 77],
                [140, 24, 46],
            ],
        }
    }

    /// Colour at `t` in 0 to 1; outside the ends are taken.
    ///
    /// ```
    /// use sinew_render::colour::ColourMap;
    ///
    /// assert_eq!(ColourMap::Viridis.at(0.0), [68, 1, 84]);
    /// assert_eq!(ColourMap::Viridis.at(7.0), [253, 231, 37]);
    /// ```
    pub fn at(self, t: f32) -> Rgb {
        let anchors = self.anchors();
        let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) } * (anchors.len() - 1) as f32;
        let i = (t as usize).min(anchors.len() - 2);
        let (a, b) = (oklab(anchors[i]), oklab(anchors[i + 1]));
        let s = t - i as f32;
        from_oklab([0, 1, 2].map(|k| a[k] + s * (b[k] - a[k])))
    }

    /// The map as [`SAMPLES`] colours.
    pub fn table(self) -> Vec<Rgb> {
        (0..SAMPLES).map(|i| self.at(i as f32 / (SAMPLES - 1) as f32)).collect()
    }
}

/// Linear light of an sRGB component.
pub fn to_linear(c: u8) -> f32 {
    let c = f32::from(c) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// sRGB component of linear light; outside 0 to 1 the ends are taken.
pub fn from_linear(x: f32) -> u8 {
    let x = x.clamp(0.0, 1.0);
    let c = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (255.0 * c + 0.5) as u8
}

/// Oklab (Ottosson 2020): lightness, green to red, blue to yellow.
pub fn oklab(colour: Rgb) -> [f32; 3] {
    let [r, g, b] = colour.map(to_linear);
    let l = (0.412_221_46 * r + 0.536_332_55 * g + 0.051_445_995 * b).cbrt();
    let m = (0.211_903_5 * r + 0.680_699_5 * g + 0.107_396_96 * b).cbrt();
    let s = (0.088_302_46 * r + 0.281_718_85 * g + 0.629_978_7 * b).cbrt();
    [
        0.210_454_26 * l + 0.793_617_8 * m - 0.004_072_047 * s,
        1.977_998_5 * l - 2.428_592_2 * m + 0.450_593_7 * s,
        0.025_904_037 * l + 0.782_771_77 * m - 0.808_675_77 * s,
    ]
}

/// Back to sRGB.
pub fn from_oklab([lightness, a, b]: [f32; 3]) -> Rgb {
    let l = (lightness + 0.396_337_78 * a + 0.215_803_76 * b).powi(3);
    let m = (lightness - 0.105_561_346 * a - 0.063_854_17 * b).powi(3);
    let s = (lightness - 0.089_484_18 * a - 1.291_485_5 * b).powi(3);
    [
        4.076_741_7 * l - 3.307_711_6 * m + 0.230_969_94 * s,
        -1.268_438 * l + 2.609_757_4 * m - 0.341_319_38 * s,
        -0.004_196_086_3 * l - 0.703_418_6 * m + 1.707_614_7 * s,
    ]
    .map(from_linear)
}

/// Colours of bodies without a scalar, told apart by hue and lightness.
pub const BODY_COLOURS: [Rgb; 6] = [
    [196, 104, 92],
    [86, 140, 178],
    [214, 168, 88],
    [112, 160, 118],
    [150, 118, 172],
    [120, 132, 144],
];

/// Colours of a wound: under the surface, and deep inside.
pub const WOUND_COLOURS: [Rgb; 2] = [[244, 168, 150], [132, 18, 32]];

/// Colour of a wound so far between [`WOUND_COLOURS`].
pub fn wound_colour(shade: f32) -> Rgb {
    let [near, deep] = WOUND_COLOURS.map(|colour| colour.map(f32::from));
    std::array::from_fn(|i| (near[i] + shade * (deep[i] - near[i])).round() as u8)
}

/// How far between [`WOUND_COLOURS`] a depth (m) is in a scene of this size (m): half of the way at 3 % of it.
pub fn wound_shade(depth: f32, size: f32) -> f32 {
    1.0 - (-depth.max(0.0) / (0.04 * size)).exp()
}
