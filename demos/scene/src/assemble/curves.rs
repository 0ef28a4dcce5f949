//! Factors over time.

use crate::error::SceneError;
use crate::scene::{CurveEntry, Key, Mode};
use sinew::engine::load::Curve;

/// Refuses a key that needs time in a scene without.
pub(super) fn in_time(key: &Key, name: &str, mode: Mode) -> Result<(), SceneError> {
    match mode {
        Mode::Static => {
            let found = format!("`{name}` in a static scene");
            Err(key.value(found, "leave it out, there is no time"))
        }
        Mode::Dynamic => Ok(()),
    }
}

/// Times (s) from which and until which something acts.
pub(super) fn window(
    key: &Key,
    [from, until]: [Option<f64>; 2],
    mode: Mode,
) -> Result<[f64; 2], SceneError> {
    for (name, value) in [("from", from), ("until", until)] {
        let Some(value) = value else { continue };
        let key = key.at(name);
        in_time(&key, name, mode)?;
        key.finite([value])?;
    }
    let (from, until) = (from.unwrap_or(f64::NEG_INFINITY), until.unwrap_or(f64::INFINITY));
    if from >= until {
        let found = format!("it acts from {from} s until {until} s");
        return Err(key.at("until").value(found, "make `until` later than `from`"));
    }
    Ok([from, until])
}

/// Rows of a path `[time, x, y, z, ..]` that is in order, as one curve for every column after the time.
pub(super) fn path<const N: usize>(
    key: &Key,
    rows: &[[f64; N]],
    columns: &str,
    mode: Mode,
) -> Result<Vec<Curve>, SceneError> {
    in_time(key, "path", mode)?;
    key.ascending(rows, "path", columns)?;
    for row in rows {
        key.finite(*row)?;
    }
    let column = |k: usize| Curve::Points(rows.iter().map(|row| [row[0], row[k]]).collect());
    Ok((1..N).map(column).collect())
}

/// The curve below a key. In a static scene loads and motions grow with the load steps.
pub(super) fn factor(
    key: &Key,
    entry: Option<&CurveEntry>,
    mode: Mode,
) -> Result<Curve, SceneError> {
    let key = key.at("curve");
    match (mode, entry) {
        (Mode::Static, Some(_)) => Err(key.value(
            "a curve in a static scene",
            "leave it out, a static scene has no time (loads grow over `load_steps`)",
        )),
        (Mode::Static, None) => Ok(Curve::ramp(0.0, 1.0)),
        (Mode::Dynamic, Some(entry)) => curve(&key, entry),
        (Mode::Dynamic, None) => Ok(Curve::Constant),
    }
}

fn curve(key: &Key, entry: &CurveEntry) -> Result<Curve, SceneError> {
    let CurveEntry { hold, ramp, release, pulse, points, sine } = entry;
    let lists = [
        ("hold", hold.map(|factor| vec![[0.0, factor]])),
        ("ramp", ramp.map(|[a, b]| vec![[a, 0.0], [b, 1.0]])),
        ("release", release.map(|[a, b]| vec![[a, 1.0], [b, 0.0]])),
        ("pulse", pulse.map(|[a, b, c, d]| vec![[a, 0.0], [b, 1.0], [c, 1.0], [d, 0.0]])),
        ("points", points.clone()),
    ];
    let mut given: Vec<bool> = lists.iter().map(|(_, list)| list.is_some()).collect();
    given.push(sine.is_some());
    let keys = "`hold`, `ramp`, `release`, `pulse`, `points` and `sine`";
    key.exactly_one(&given, "curve", keys)?;
    if let Some(sine) = sine {
        key.at("sine").finite([sine.frequency, sine.degrees])?;
        return Ok(Curve::Sine { frequency: sine.frequency, phase: sine.degrees.to_radians() });
    }
    let mut list = Vec::new();
    for (name, own) in lists {
        if let Some(own) = own {
            key.at(name).ascending(&own, "list", "[time, factor] pairs")?;
            list = own;
        }
    }
    Ok(Curve::Points(list))
}
