//! The page in a headless browser: it draws, it follows the scrub bar, and nothing is reported as an error.

use glam::Vec3;
use sinew_render::camera::CameraRequest;
use sinew_render::page::page;
use sinew_render::rigid::{Placed, Rigid};
use sinew_render::scene::{ArrowKey, Graph, Recording, Series};
use std::io::Write;
use std::process::{Command, Stdio};

/// Looks at the page and writes what it saw into the document.
const PROBE: &str = r#"<script>
const errors = [];
addEventListener("error", (e) => errors.push(e.message));
addEventListener("unhandledrejection", (e) => errors.push(String(e.reason)));
const report = console.error;
console.error = (...words) => { errors.push(words.join(" ")); report(...words); };
function pixels(canvas) {
  const gl = canvas.getContext("webgl2"), w = canvas.width, h = canvas.height, p = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
  if (gl.getError()) errors.push("WebGL error");
  return p;
}
function probe() {
  if (!window.sinew) { setTimeout(probe, 50); return; }
  const canvases = [...document.querySelectorAll("canvas")], scrub = document.getElementById("scrub");
  const look = () => { sinew.draw(); return canvases.map(pixels); };
  const first = look();
  const opened = { playing: sinew.playing(), time: sinew.time() };
  scrub.value = 1000;
  scrub.dispatchEvent(new Event("input"));
  const box = (e) => e.getBoundingClientRect();
  const marks = [...document.querySelectorAll('#scale .mark')], strip = box(document.getElementById("strip"));
  const graph = { shown: !document.getElementById("graph").hidden, words: document.getElementById("names").textContent,
    lines: document.querySelectorAll('#graph polyline').length,
    cursor: Number(document.getElementById("now")?.getAttribute("x1")) / document.querySelector('#graph svg').clientWidth };
  const legend = { bars: document.querySelectorAll('#strip').length, words: document.getElementById("legend").textContent,
    // the tick of the first mark is at the lower end of the strip, its number beside it
    off: marks.length ? Math.abs((box(marks[0]).top + box(marks[0]).bottom) / 2 - strip.bottom) : NaN,
    gap: marks.length ? box(marks[0]).left - strip.right : NaN };
  // the cursor over the middle of the bar, then beside it
  sinew.draw();
  const canvas = box(canvases[0]), tip = document.getElementById("tip");
  const pointed = [[0.5, 0.5], [0.02, 0.98]].map(([x, y]) => {
    const place = { clientX: canvas.left + x * canvas.width, clientY: canvas.top + y * canvas.height };
    canvases[0].dispatchEvent(new PointerEvent("pointermove", place));
    return tip.hidden ? "" : tip.textContent;
  });
  const wide = document.documentElement.scrollWidth - innerWidth;
  const last = look(), note = document.querySelector(".note").textContent;
  const field = document.getElementById("field");
  field.value = "none";
  field.dispatchEvent(new Event("change"));
  const plain = look();
  // cut open in the middle: half of it goes, and the cursor tells what is inside
  const choose = (id, value) => { const e = document.getElementById(id); e.value = value; e.dispatchEvent(new Event(id === "depth" ? "input" : "change")); };
  choose("field", "displacement");
  choose("cut", "view");
  const open = look(), half = sinew.views[0].open;
  const inside = { changed: open.map((p, i) => changed(p, last[i])), triangles: half.index.length / 3,
    bytes: [Math.min(...half.bytes), Math.max(...half.bytes)], hit: sinew.views[0].under(0.5, 0.5) };
  const address = sinew.link();
  choose("cut", "none");
  choose("to", "1");
  const ranged = { changed: look().map((p, i) => changed(p, last[i])), address: sinew.link().split("range=")[1] ?? "" };
  document.getElementById("whole").click();
  const back = look().map((p, i) => changed(p, last[i]));
  sinew.setField("none");
  const view = sinew.views[1];
  view.stretches = [];
  const without = look();
  // bodies have colours, background and ground are grey
  function changed(a, b) { let n = 0; for (let i = 0; i < a.length; i += 4) n += a[i] !== b[i]; return n * 4 / a.length; }
  const vivid = (p) => {
    let n = 0;
    for (let i = 0; i < p.length; i += 4) n += Math.max(p[i], p[i + 1], p[i + 2]) - Math.min(p[i], p[i + 1], p[i + 2]) > 50;
    return n * 4 / p.length;
  };
  const shot = sinew.picture();
  const saved = { url: shot.toDataURL("image/png").slice(0, 22), width: shot.width, views: canvases.reduce((w, c) => w + c.width, 0) };
  const warned = [...document.querySelectorAll(".warning")].map((e) => (box(e).height > 0 ? e.textContent : ""));
  const result = { saved, warned, inside, address, ranged, back, errors, note, opened, pointed, graph, legend, wide, views: canvases.length, vivid: first.map(vivid),
    moved: first.map((p, i) => changed(p, last[i])), recoloured: last.map((p, i) => changed(p, plain[i])),
    tools: [0, 1].map((i) => changed(plain[i], without[i])) };
  const out = document.createElement("pre");
  out.id = "result";
  out.textContent = "RESULT" + JSON.stringify(result) + "END";
  document.body.append(out);
}
setTimeout(probe, 50);
</script>"#;

/// A browser on the path.
fn browser() -> Option<&'static str> {
    ["chromium", "chromium-browser", "google-chrome"].into_iter().find(|name| {
        let (out, err) = (Stdio::null(), Stdio::null());
        Command::new(name)
            .arg("--version")
            .stdout(out)
            .stderr(err)
            .status()
            .is_ok_and(|s| s.success())
    })
}

/// What the probe saw in a page of these runs, in a window of this width; nothing without a browser.
fn seen(name: &str, runs: &[&Recording], width: u32, address: &str) -> Option<serde_json::Value> {
    let Some(browser) = browser() else {
        let _ = writeln!(std::io::stderr(), "skipped: no chromium on the path");
        return None;
    };
    let page = page(runs, CameraRequest::default()).unwrap();
    // before the player, so that nothing escapes it
    let page = page.replace("<div id=\"views\">", &format!("{PROBE}<div id=\"views\">"));
    let folder = std::env::temp_dir().join(format!("sinew-player-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("page.html");
    std::fs::write(&file, page).unwrap();
    let output = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--use-angle=swiftshader"])
        .args(["--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"])
        .arg(format!("--window-size={width},900"))
        .args(["--virtual-time-budget=20000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .arg(format!("file://{}{address}", file.display()))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let result = text.rsplit_once("RESULT").and_then(|(_, rest)| rest.split_once("END"));
    let result = result.unwrap_or_else(|| {
        panic!("no result: {}", String::from_utf8_lossy(&output.stderr));
    });
    // the browser writes text as HTML
    let result = [("&lt;", "<"), ("&gt;", ">"), ("&amp;", "&")]
        .iter()
        .fold(result.0.to_string(), |text, (from, to)| text.replace(from, to));
    let seen: serde_json::Value = serde_json::from_str(&result).unwrap();
    std::fs::remove_dir_all(folder).unwrap();
    assert_eq!(seen["errors"], serde_json::json!([]), "{seen}");
    assert!(seen["wide"].as_f64().unwrap() <= 0.0, "cut off at {width} pixels: {seen}");
    Some(seen)
}

#[test]
fn loads_open_where_all_of_them_act() {
    let mut recording = crate::common::bar();
    recording.is_static = true;
    let Some(seen) = seen("static", &[&recording, &recording], 390, "") else { return };
    assert_eq!(seen["warned"], serde_json::json!(["", "", ""]));
    assert_eq!(seen["opened"], serde_json::json!({ "playing": false, "time": 1.5 }));
    // nothing is moved by the scrub bar, which stands there already
    assert!(seen["moved"].as_array().unwrap().iter().all(|share| share == 0), "{seen}");
    // no forces, no graph
    assert_eq!(seen["graph"]["shown"], false, "{seen}");
}

#[test]
fn the_player_draws_scrubs_and_recolours_without_an_error() {
    let recording = crate::common::bar();
    // a ball beside the bar, and a floor
    let mut tools = recording.clone();
    let grey = [150, 156, 165];
    tools.shapes = vec![
        Rigid::rounded_box(Vec3::splat(0.1), 0.1, grey),
        Rigid::plate([0.0, -0.2], [1.0, 0.2], 0.02, grey),
    ];
    for frame in &mut tools.frames {
        let turn = [0.0, 0.0, 0.0, 1.0];
        frame.tools = vec![
            Placed { shape: 0, at: [0.5, -0.25, 0.1], turn },
            Placed { shape: 1, at: [0.0, 0.0, -0.6], turn },
        ];
    }
    let text = "force of tools".into();
    tools.arrow_key = Some(ArrowKey { text, colour: grey });
    let rising = (0..=30).map(|i| [0.05 * f64::from(i), 0.1 * f64::from(i)]);
    tools.forces = vec![Series { name: "ball".into(), points: rising.collect() }];
    tools.label = "with tools".into();
    tools.warning = "NOT TO BE TRUSTED: <b>".into();
    let Some(seen) = seen("tools", &[&recording, &tools], 1000, "") else { return };
    assert_eq!(seen["opened"]["playing"], true, "{seen}");
    // one colour bar whose numbers stand beside their ticks
    let legend = &seen["legend"];
    assert_eq!(legend["bars"], 1, "{seen}");
    assert!(legend["words"].as_str().unwrap().contains("displacement (cm)"), "{seen}");
    assert!(legend["off"].as_f64().unwrap() < 2.0, "{seen}");
    assert!((0.0..12.0).contains(&legend["gap"].as_f64().unwrap()), "{seen}");
    // the force over time, its value and the cursor at the end
    let graph = &seen["graph"];
    assert_eq!((&graph["shown"], &graph["lines"]), (&true.into(), &1.into()), "{seen}");
    assert!(graph["words"].as_str().unwrap().contains("with tools: ball 3.00 N"), "{seen}");
    assert!(graph["cursor"].as_f64().unwrap() > 0.95, "{seen}");
    // what is under the cursor: the middle of the bar has gone a part of the way of its end
    let value = seen["pointed"][0].as_str().unwrap();
    let number = value.strip_prefix("bar: displacement ").and_then(|v| v.strip_suffix(" cm"));
    let number: f64 = number.unwrap_or_else(|| panic!("{seen}")).parse().unwrap();
    assert!(number > 5.0 && number < 50.0, "{seen}");
    assert_eq!(seen["pointed"][1], "", "{seen}");
    assert_eq!(seen["views"], 2);
    // what is not to be trusted says so where it stands
    assert_eq!(seen["warned"], serde_json::json!(["", "", "NOT TO BE TRUSTED: <b>"]));
    // both views in one picture
    assert_eq!(seen["saved"]["url"], "data:image/png;base64,");
    assert_eq!(seen["saved"]["width"], seen["saved"]["views"]);
    assert!(seen["note"].as_str().unwrap().contains("1.50 s"), "{seen}");
    // cut open it is filled, and where it was removed it is not; the address says all of it
    let inside = &seen["inside"];
    assert!(inside["triangles"].as_u64().unwrap() > 20, "{seen}");
    assert!(inside["changed"][0].as_f64().unwrap() > 0.005, "{seen}");
    assert!(inside["hit"]["value"].as_f64().unwrap() > 0.01, "{seen}");
    let address = seen["address"].as_str().unwrap();
    assert!(address.contains("#t=1.5&field=displacement&") && address.contains("&cut="), "{seen}");
    // colours up to a tenth of the bar, and back
    assert!(seen["ranged"]["changed"][0].as_f64().unwrap() > 0.01, "{seen}");
    assert!(seen["ranged"]["address"].as_str().unwrap().starts_with("0,0.01"), "{seen}");
    assert_eq!(seen["back"], serde_json::json!([0, 0]), "{seen}");
    // the second has tools
    assert!(seen["tools"][0] == 0.0 && seen["tools"][1].as_f64().unwrap() > 0.02, "{seen}");
    for view in 0..2 {
        // the bar covers about a tenth
        assert!(seen["vivid"][view].as_f64().unwrap() > 0.03, "{seen}");
        assert!(seen["moved"][view].as_f64().unwrap() > 0.02, "{seen}");
        assert!(seen["recoloured"][view].as_f64().unwrap() > 0.01, "{seen}");
    }
}

#[test]
fn an_address_opens_at_its_time_and_colours() {
    let mut recording = crate::common::bar();
    let lines = ["x", "y"].map(|name| Series {
        name: name.into(),
        points: vec![[0.0, 0.0], [0.5, -2.0], [1.0, 3.0]],
    });
    recording.graphs =
        vec![Graph { name: "tip.mean_velocity".into(), unit: "m/s".into(), lines: lines.to_vec() }];
    // its last cells are gone when the third frame comes
    let count = recording.cells.len();
    recording.cells[count / 2..].iter_mut().for_each(|cell| cell.gone = 2);
    let address = "#t=0.5&field=none&camera=90,5,1.5,0,0&graph=tip.mean%20velocity";
    let Some(seen) = seen("address", &[&recording, &recording], 1280, address) else { return };
    assert_eq!(seen["opened"], serde_json::json!({ "playing": false, "time": 0.5 }));
    let words = seen["graph"]["words"].as_str().unwrap();
    assert!(words.contains("Bar: x 3.00 m/s") && seen["graph"]["lines"] == 4, "{seen}");
}
