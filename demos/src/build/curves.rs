//! Factors over time.

use crate::error::SceneError;
use crate::scene::{CurveEntry, Key, Mode};
use sinew::engine::load::Curve;

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
