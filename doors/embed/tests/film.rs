//! A recording and its page.

use crate::{held, options, slab};
use sinew_embed::*;

/// The data of a page: what its player reads.
fn data(page: &str) -> serde_json::Value {
    let head = "<script id=\"data\" type=\"application/json\">";
    let text = &page[page.find(head).expect("a player") + head.len()..];
    serde_json::from_str(&text[..text.find("</script>").unwrap()]).unwrap()
}

/// Steps of the frames of the first run.
fn steps(page: &str) -> Vec<u64> {
    let frames = data(page)["runs"][0]["frames"].as_array().unwrap().clone();
    let dt = options().dt;
    frames.iter().map(|frame| (frame["time"].as_f64().unwrap() / dt).round() as u64).collect()
}

#[test]
fn a_page_shows_what_was_recorded_and_changes_no_bit() {
    let gravity = Options { gravity: [0.0, 0.0, -9.81], ..options() };
    let (mut sim, ..) = held(&gravity);
    let (mut other, ..) = held(&gravity);
    other.step(7).unwrap();
    sim.step(2).unwrap();
    sim.record(2).unwrap();
    // a body that would not be seen
    let mesh = slab();
    let description = BodyDescription::new("late", &mesh, preset("liver").unwrap());
    let refused = sim.add_body(&mesh, &description).unwrap_err();
    assert!(refused.text.contains("recording is on its way"), "{}", refused.text);
    sim.step(5).unwrap();
    assert_eq!(sim.hash(), other.hash());
    // and the last state, which no frame was due for
    assert_eq!(steps(&sim.page().unwrap()), [2, 4, 6, 7]);
    // it has ended
    sim.add_body(&mesh, &description).unwrap();
    assert_eq!(steps(&sim.page().unwrap()), [7]);
    assert!(sim.record(0).unwrap_err().text.contains("step at least"));
    let none = Embedding::new(&options()).unwrap().page().unwrap_err();
    assert!(none.text.contains("no body"), "{}", none.text);
}

#[test]
fn a_recording_begins_anew_where_the_state_goes_back() {
    let (mut sim, ..) = held(&options());
    let start = sim.snapshot().unwrap();
    sim.record(1).unwrap();
    sim.step(3).unwrap();
    sim.restore(&start).unwrap();
    sim.step(2).unwrap();
    assert_eq!(steps(&sim.page().unwrap()), [0, 1, 2]);
}

#[test]
fn long_recordings_keep_every_second_frame() {
    let (mut sim, ..) = held(&options());
    sim.record(1).unwrap();
    sim.step(700).unwrap();
    let kept: Vec<u64> = (0..=700).step_by(2).collect();
    assert_eq!(steps(&sim.page().unwrap()), kept);
}

#[test]
fn what_is_cut_away_goes_from_the_page() {
    let (mut sim, body, _) = held(&options());
    let corners = |page: &str| data(page)["runs"][0]["skins"].as_array().map_or(0, Vec::len);
    sim.record(1).unwrap();
    sim.step(1).unwrap();
    let region = Region::Sphere { centre: DVec3::new(0.1, 0.1, 0.05), radius: 0.03 };
    let report = sim.remove_elements(body, region, MassPolicy::default()).unwrap();
    assert!(!report.tetrahedra.is_empty());
    sim.step(1).unwrap();
    let page = sim.page().unwrap();
    assert_eq!(corners(&page), 2, "a surface before and one after");
    // one that begins after it knows of it
    assert_eq!(corners(&sim.page().unwrap()), 1);
}
