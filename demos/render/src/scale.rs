//! Marks on scales, units with factors, and numbers with their units.

/// Values for marks from `low` to `high`: multiples of 1, 2, 2.5 or 5 times a power of ten, about `count`.
///
/// ```
/// use sinew_render::scale::ticks;
///
/// assert_eq!(ticks(0.0, 0.061, 4), [0.0, 0.02, 0.04, 0.06]);
/// ```
pub fn ticks(low: f64, high: f64, count: usize) -> Vec<f64> {
    let span = high - low;
    if !(span > 0.0 && span.is_finite()) {
        return vec![low];
    }
    let raw = span / count.max(1) as f64;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .map(|f| f * power)
        .find(|s| *s >= 0.85 * raw)
        .unwrap_or(10.0 * power);
    let first = (low / step - 1e-6).ceil() as i64;
    let last = (high / step + 1e-6).floor() as i64;
    // division by the inverse gives 0.06 and not 0.06000000000000001
    (first..=last)
        .map(|i| if step < 1.0 { i as f64 / rounded(1.0 / step) } else { i as f64 * step })
        .collect()
}

/// To nine significant digits.
fn rounded(value: f64) -> f64 {
    let power = 10f64.powf(8.0 - value.abs().log10().floor());
    (value * power).round() / power
}

/// A number with as many digits as a step between marks needs, with a real minus sign.
pub fn mark(value: f64, step: f64) -> String {
    let digits = (-(step.abs().log10() + 1e-9).floor()).clamp(0.0, 6.0) as usize;
    let exact = (step * 10f64.powi(digits as i32)).fract().abs();
    let digits = if exact > 0.01 && exact < 0.99 { digits + 1 } else { digits };
    let text = format!("{value:.digits$}");
    if value == 0.0 { "0".into() } else { text.replace('-', "−") }
}

/// A unit with a factor, such that values look like 12 and not like 0.000012.
pub fn scaled_unit(unit: &str, largest: f64) -> (f64, String) {
    let steps: &[(f64, &str)] = match unit {
        "m" => &[(1.0, "m"), (1e2, "cm"), (1e3, "mm"), (1e6, "µm")],
        "Pa" => &[(1e-6, "MPa"), (1e-3, "kPa"), (1.0, "Pa"), (1e3, "mPa")],
        "N" => &[(1e-3, "kN"), (1.0, "N"), (1e3, "mN"), (1e6, "µN")],
        "J/m³" => &[(1e-6, "MJ/m³"), (1e-3, "kJ/m³"), (1.0, "J/m³"), (1e3, "mJ/m³")],
        "%" => &[(1.0, "%")],
        "" => return (1.0, String::new()),
        other => return (1.0, other.into()),
    };
    let fits = steps.iter().find(|(factor, _)| largest * factor >= 0.9995);
    let (factor, name) = fits.or(steps.last()).copied().unwrap_or((1.0, unit));
    (factor, name.into())
}

/// A value with its unit in three digits, such as `12.3 mN`; zero has the unit without a factor.
pub fn with_unit(value: f64, unit: &str) -> String {
    if value == 0.0 {
        return format!("0 {unit}").trim_end().into();
    }
    let (factor, unit) = scaled_unit(unit, value.abs());
    let value = value * factor;
    let digits = (2.0 - value.abs().max(1.0).log10().floor()).clamp(0.0, 2.0) as usize;
    format!("{value:.digits$} {unit}").replace('-', "−").trim_end().into()
}
