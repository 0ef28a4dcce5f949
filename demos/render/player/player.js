"use strict";
// Plays recordings that lie in the page: positions and scalars are whole numbers in bands, told apart by
// differences between frames, low bytes before high bytes, and deflated. Nothing is fetched.
(async () => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const byId = (id) => document.getElementById(id);
  const fail = (text) => {
    byId("views").innerHTML = "";
    const p = document.createElement("p");
    p.id = "problem";
    p.textContent = text;
    byId("views").append(p);
  };

  // ---- unpacking

  async function inflate(text) {
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  class Reader {
    constructor(bytes) { this.bytes = bytes; this.at = 0; }
    // `count` numbers of two bytes, low ones first, as differences to `before`
    shorts(count, before) {
      const low = this.bytes.subarray(this.at, this.at + count);
      const high = this.bytes.subarray(this.at + count, this.at + 2 * count);
      this.at += 2 * count;
      const out = new Uint16Array(count);
      for (let i = 0; i < count; i++) out[i] = (low[i] + 256 * high[i] + (before ? before[i] : 0)) & 65535;
      return out;
    }
    bytesOf(count, before) {
      const raw = this.bytes.subarray(this.at, this.at + count);
      this.at += count;
      const out = new Uint8Array(count);
      for (let i = 0; i < count; i++) out[i] = (raw[i] + (before ? before[i] : 0)) & 255;
      return out;
    }
    words(count) {
      const out = new Uint32Array(this.bytes.slice(this.at, this.at + 4 * count).buffer);
      this.at += 4 * count;
      return out;
    }
    floats(count) {
      const out = new Float32Array(this.bytes.slice(this.at, this.at + 4 * count).buffer);
      this.at += 4 * count;
      return out;
    }
  }

  async function unpack(run) {
    const r = new Reader(await inflate(run.payload));
    delete run.payload;
    const n = run.points;
    run.rest = r.shorts(3 * n);
    for (const skin of run.skins) {
      skin.source = r.words(skin.vertices);
      skin.body = r.words(skin.vertices);
      skin.index = r.words(3 * skin.triangles);
      // how deep in a wound, from 1 on
      skin.depth = r.bytesOf(skin.depths);
    }
    for (const shape of run.shapes) {
      shape.points = r.floats(3 * shape.vertices);
      shape.normals = r.floats(3 * shape.vertices);
      shape.index = r.words(3 * shape.triangles);
    }
    for (const line of run.graphs.flatMap((graph) => graph.lines)) line.points = r.floats(2 * line.count);
    run.corners = r.words(4 * run.cells);
    run.fates = r.words(3 * run.cells);
    let before = run.rest;
    const fields = run.fields.map(() => null);
    for (const frame of run.frames) {
      before = frame.places = r.shorts(3 * n, before);
      frame.values = run.fields.map((_, i) => (fields[i] = r.bytesOf(n, fields[i])));
      frame.balls = r.floats(5 * frame.counts[0]);
      frame.rods = r.floats(7 * frame.counts[1]);
      frame.arrows = r.floats(7 * frame.counts[2]);
      frame.tools = r.floats(8 * frame.counts[3]);
    }
    return run;
  }

  @VIEW@

  // ---- what all views share

  // parts of captions that all runs have, and what is left of one
  const parts = (text) => text.split(" · ");
  const inAll = (part, of) => data.runs.every((run) => parts(of(run)).includes(part));
  const shared = (of) => parts(of(data.runs[0])).filter((part) => inAll(part, of)).join(" · ");
  const own = (text, label) =>
    parts(text).filter((part) => part !== label && !inAll(part, (run) => run.subtitle)).join(" · ");

  // one camera: a ball around all runs
  function ball(runs) {
    const middle = [0, 1, 2].map((k) => runs.reduce((sum, run) => sum + run.middle[k], 0) / runs.length);
    const reach = (run) => run.radius + Math.hypot(...add(run.middle, middle, -1));
    return { middle, radius: Math.max(...runs.map(reach)) };
  }

  // one colour bar
  function legend() {
    const box = byId("legend"), field = data.runs.flatMap((run) => run.fields).find((f) => f.name === shown.field);
    box.hidden = !field;
    if (!field) return;
    const map = data.maps[shown.map];
    const [low, high] = ranges[field.name], [factor, name] = unitOf(field.unit, Math.max(Math.abs(low), Math.abs(high)));
    for (const [id, value] of [["from", low], ["to", high]]) byId(id).value = Number((value * factor).toPrecision(4));
    byId("from").onchange = byId("to").onchange = () => {
      const [a, b] = [byId("from"), byId("to")].map((e) => e.valueAsNumber / factor);
      setRange(b > a ? [a, b] : whole[field.name]);
    };
    byId("whole").onclick = () => setRange(whole[field.name]);
    box.querySelector("span").textContent = field.label + (name ? ` (${name})` : "");
    const stops = [];
    for (let i = 0; i <= 16; i++) {
      const k = 3 * Math.round(255 * i / 16);
      stops.push(`rgb(${map[k]},${map[k + 1]},${map[k + 2]})`);
    }
    const scaleBox = byId("scale");
    scaleBox.querySelectorAll(".mark").forEach((m) => m.remove());
    byId("strip").style.setProperty("--stops", stops.join(","));
    for (const value of ticks(low * factor, high * factor, 5)) {
      const mark = document.createElement("div");
      mark.className = "mark";
      mark.style.setProperty("--at", `${100 * (value / factor - low) / (high - low)}%`);
      mark.textContent = String(Number(value.toPrecision(6))).replace("-", "−");
      scaleBox.append(mark);
    }
  }

  // what was recorded over time, with its values at the cursor
  const INKS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#b58900"];
  const graph = { lines: [], hover: null, unit: "" };
  function drawGraph() {
    const svg = document.querySelector("#graph svg"), width = svg.clientWidth, height = svg.clientHeight;
    byId("graph").hidden = graph.lines.length === 0 || last <= first;
    if (byId("graph").hidden || !width) return;
    const left = 58, right = width - 8, top = 8, bottom = height - 18;
    const ends = graph.lines.reduce(([low, high], { points }) => {
      for (let i = 1; i < points.length; i += 2) { low = Math.min(low, points[i]); high = Math.max(high, points[i]); }
      return [low, high];
    }, [0, 0]);
    const [factor, unitName] = unitOf(graph.unit, Math.max(-ends[0], ends[1])), room = 0.04 * (ends[1] - ends[0]) || 1;
    const low = factor * (ends[0] && ends[0] - room), high = factor * (ends[1] && ends[1] + room) || 1;
    const x = (t) => left + (right - left) * (t - first) / (last - first);
    const y = (v) => bottom - (bottom - top) * (v * factor - low) / (high - low);
    const isStatic = data.runs.every((run) => run.static);
    const out = [];
    for (const v of ticks(low, high, 3)) {
      const at = y(v / factor);
      out.push(`<line class="grid" x1="${left}" x2="${right}" y1="${at}" y2="${at}"/>`,
        `<text x="${left - 6}" y="${at + 4}" text-anchor="end">${Number(v.toPrecision(6))} ${unitName}</text>`);
    }
    for (const t of ticks(first, last, Math.max(2, Math.floor(width / 120)))) {
      const words = isStatic ? `${Number((100 * t).toPrecision(6))} %` : `${Number(t.toPrecision(6))} s`;
      const anchor = x(t) > right - 16 ? "end" : "middle";
      out.push(`<text x="${x(t)}" y="${height - 4}" text-anchor="${anchor}">${words}</text>`);
    }
    for (const { points, ink, dash } of graph.lines) {
      let path = "";
      for (let i = 0; i < points.length; i += 2) path += `${x(points[i]).toFixed(1)},${y(points[i + 1]).toFixed(1)} `;
      out.push(`<polyline points="${path}" fill="none" stroke="${ink}" stroke-dasharray="${dash}" stroke-width="1.6"/>`);
    }
    out.push('<line id="now"/><line id="there"/>');
    svg.innerHTML = out.join("");
    Object.assign(graph, { left, right, top, bottom, x });
    moveCursor();
  }
  // the value that holds at a time
  function valueAt(points, t) {
    let value = 0;
    for (let i = 0; i < points.length && points[i] <= t + 1e-6 * (last - first); i += 2) value = points[i + 1];
    return value;
  }
  function moveCursor() {
    if (!graph.x || byId("graph").hidden) return;
    const put = (id, t) => {
      const line = document.getElementById(id);
      line.style.display = t === null ? "none" : "";
      for (const [name, v] of [["x1", graph.x(t)], ["x2", graph.x(t)], ["y1", graph.top], ["y2", graph.bottom]]) line.setAttribute(name, v);
    };
    put("now", time);
    put("there", graph.hover);
    const t = graph.hover ?? time;
    graph.lines.forEach((line) => { line.value.textContent = withUnit(valueAt(line.points, t), graph.unit); });
  }
  // forces come first
  function setGraph(wanted) {
    graph.lines = [];
    byId("names").textContent = "";
    byId("what").value = wanted;
    // several runs have colours, their lines strokes
    const several = data.runs.length > 1;
    data.runs.forEach((run, r) => {
      for (const { name: own, unit, lines } of run.graphs.filter((g) => g.name === wanted)) {
        graph.unit = unit;
        lines.forEach((series, l) => {
          const ink = INKS[(several ? r : l) % INKS.length], dash = several ? ["", "6 3", "2 3"][l % 3] : "";
          const entry = document.createElement("div");
          const name = [several ? run.label || run.title : "", series.name || own].filter(Boolean).join(": ");
          const value = document.createElement("b"), key = document.createElement("i"), words = document.createElement("span");
          key.style.background = ink;
          words.textContent = `${name} `;
          value.style.fontWeight = 500;
          entry.append(key, words, value);
          byId("names").append(entry);
          graph.lines.push({ name, points: series.points, ink, dash, value });
        });
      }
    });
    drawGraph();
  }
  function prepareGraph() {
    const names = [...new Set(data.runs.flatMap((run) => run.graphs.map((g) => g.name)))];
    for (const name of names) byId("what").add(new Option(name, name));
    byId("what").hidden = names.length < 2;
    byId("what").onchange = (e) => setGraph(e.target.value);
    const svg = document.querySelector("#graph svg");
    const timeOf = (e) => {
      const share = (e.clientX - svg.getBoundingClientRect().left - graph.left) / (graph.right - graph.left);
      return first + (last - first) * Math.max(0, Math.min(1, share));
    };
    svg.onpointerdown = (e) => { svg.setPointerCapture(e.pointerId); play(false); setTime(timeOf(e)); };
    svg.onpointermove = (e) => {
      graph.hover = timeOf(e);
      if (e.buttons) setTime(graph.hover);
      moveCursor();
    };
    svg.onpointerleave = () => { graph.hover = null; moveCursor(); };
    byId("graph").hidden = names.length === 0 || last <= first;
    if (names.length) setGraph(names.includes(asked.graph) ? asked.graph : names[0]);
  }

  // ---- controls

  if (!("DecompressionStream" in window)) {
    fail("This page needs a browser that can inflate data: a recent Chrome, Edge, Firefox or Safari.");
    return;
  }
  // of colours: as asked for, and of the whole run
  const ranges = {}, whole = {};
  const around = ball(data.runs);
  byId("heading").querySelector("b").textContent = shared((run) => run.title) || document.title;
  byId("heading").querySelector("span").textContent = shared((run) => run.subtitle);
  if (data.runs.length === 1) byId("heading").querySelector(".warning").textContent = data.runs[0].warning;
  let views;
  try {
    const runs = await Promise.all(data.runs.map(unpack));
    for (const field of runs.flatMap((run) => run.fields)) {
      const known = ranges[field.name];
      ranges[field.name] = known
        ? [Math.min(known[0], field.range[0]), Math.max(known[1], field.range[1])] : field.range;
      whole[field.name] = ranges[field.name];
    }
    views = runs.map((run) => new View(run));
  } catch (error) {
    fail(error.message);
    throw error;
  }
  const names = [...new Set(data.runs.flatMap((run) => run.fields.map((f) => f.name)))];
  const labels = Object.fromEntries(data.runs.flatMap((run) => run.fields.map((f) => [f.name, f.label])));
  for (const name of [...names, "none"]) byId("field").add(new Option(labels[name] ?? "plain colours", name));
  for (const name of Object.keys(data.maps)) byId("map").add(new Option(name, name));
  byId("field").value = shown.field;
  const first = Math.min(...views.map((v) => v.run.frames[0].time));
  const last = Math.max(...views.map((v) => v.run.frames.at(-1).time));
  // what the address says: t, field, map, graph, camera, cut, range
  const asked = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const numbers = (text, count) => {
    const found = (text ?? "").split(",").map(Number);
    return text && found.length === count && found.every(Number.isFinite) ? found : null;
  };
  const [at] = numbers(asked.t, 1) ?? [null];
  // loads are of interest when all of them act; a motion from its start
  const still = data.runs.every((run) => run.static) || matchMedia("(prefers-reduced-motion: reduce)").matches;
  const opens = at ?? (still ? last : first);
  let time = opens, playing = false, before = 0, dirty = true;

  function setTime(value) {
    time = Math.max(first, Math.min(last, value));
    for (const view of views) {
      const i = view.at(time);
      if (i !== view.frame) { view.show(i); dirty = true; }
    }
    moveCursor();
    byId("scrub").value = last > first ? 1000 * (time - first) / (last - first) : 0;
  }
  function setField(name) {
    shown.field = name;
    const field = views.flatMap((v) => v.run.fields).find((f) => f.name === name);
    setMap(field ? field.map : shown.map || "viridis");
    views.forEach((v) => v.show(v.frame ?? 0));
  }
  function setRange(range) {
    ranges[shown.field] = range;
    views.forEach((v) => v.show(v.frame ?? 0));
    legend();
    dirty = true;
  }
  // a plane across an axis, or across the line of sight; what is nearer to the eye goes
  function setCut() {
    const axis = "xyz".indexOf(byId("cut").value), { eye, forward } = views[0].sight ?? {};
    byId("depth").hidden = byId("cut").value === "none";
    if (byId("cut").value === "none") shown.cut = null;
    else if (eye && byId("cut").value !== shown.across) {
      shown.normal = axis < 0 ? scale(forward, -1) : [0, 1, 2].map((k) => (k === axis ? (forward[k] > 0 ? -1 : 1) : 0));
    }
    shown.across = byId("cut").value;
    if (shown.across !== "none") {
      const place = dot(shown.normal, around.middle) + (1 - 2 * byId("depth").value / 1000) * around.radius;
      shown.cut = [...shown.normal, place];
    }
    views.forEach((v) => v.show(v.frame ?? 0));
    dirty = true;
  }
  // the address of what is seen
  function link() {
    const short = (list) => list.map((x) => Number(x.toPrecision(5))).join(",");
    const parts = { t: short([time]), field: shown.field, map: shown.map, graph: byId("what").value,
      camera: short([camera.azimuth, camera.elevation, camera.zoom, ...camera.shift]) };
    if (shown.cut) parts.cut = short(shown.cut);
    if (ranges[shown.field] !== whole[shown.field]) parts.range = short(ranges[shown.field]);
    return `${location.href.split("#")[0]}#${Object.entries(parts).map(([k, v]) => `${k}=${encodeURIComponent(v).replaceAll("%2C", ",")}`).join("&")}`;
  }
  function setMap(name) {
    shown.map = name;
    byId("map").value = name;
    views.forEach((v) => v.colours());
    legend();
    dirty = true;
  }
  function play(on) {
    playing = on;
    if (on) byId("tip").hidden = true;
    byId("play").textContent = on ? "Pause" : "Play";
    if (on && time >= last) setTime(first);
  }
  byId("play").onclick = () => play(!playing);
  byId("scrub").oninput = (e) => { play(false); setTime(first + (last - first) * e.target.value / 1000); };
  byId("field").onchange = (e) => setField(e.target.value);
  byId("map").onchange = (e) => setMap(e.target.value);
  for (const [id, name] of [["ghost", "ghost"], ["edges", "mesh"], ["ground", "ground"]]) {
    byId(id).onchange = (e) => { shown[name] = e.target.checked; dirty = true; };
  }
  // wounds in colours of their own, or by numbers as all else
  byId("wounds").parentNode.hidden = !views.some((v) => v.run.skins.some((skin) => skin.depths));
  byId("wounds").onchange = (e) => { shown.wounds = e.target.checked; setField(shown.field); };
  const reset = () => {
    Object.assign(camera, { azimuth: data.camera[0], elevation: data.camera[1], zoom: 1, shift: [0, 0] });
    dirty = true;
  };
  byId("reset").onclick = reset;
  byId("cut").onchange = byId("depth").oninput = setCut;
  byId("link").onclick = () => {
    location.replace(link());
    navigator.clipboard?.writeText(location.href).catch(() => {});
    byId("link").textContent = "in the address bar";
    setTimeout(() => { byId("link").textContent = "Link"; }, 2000);
  };
  byId("more").onclick = () => document.body.classList.toggle("all");
  night.onchange = () => { dirty = true; };
  // all views in one picture, with what stands above them: one that is passed on says what it shows
  const picture = () => {
    const out = document.createElement("canvas"), draw = out.getContext("2d");
    const shots = views.map((view) => { view.draw(); return view.canvas; });
    const rows = getComputedStyle(byId("views")).flexDirection === "column";
    const size = (of) => (rows === (of === "height") ? shots.reduce((sum, own) => sum + own[of], 0)
      : Math.max(...shots.map((own) => own[of])));
    const head = Math.round(44 * devicePixelRatio);
    out.width = size("width");
    out.height = size("height") + head;
    const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
    draw.fillStyle = colour("--paper");
    draw.fillRect(0, 0, out.width, out.height);
    const words = (selector) => byId("heading").querySelector(selector).textContent;
    const lines = [`${words("b")} · ${withUnit(time, views[0].run.static ? "of the loads" : "s")}`, words("span")];
    lines.forEach((line, i) => {
      draw.font = `${Math.round((i ? 12 : 15) * devicePixelRatio)}px ${getComputedStyle(document.body).fontFamily}`;
      draw.fillStyle = colour(i ? "--faint" : "--ink");
      draw.fillText(line, head / 4, head * (i ? 0.85 : 0.45), out.width - head / 2);
    });
    let x = 0, y = head;
    for (const own of shots) {
      draw.drawImage(own, x, y);
      if (rows) y += own.height; else x += own.width;
    }
    return out;
  };
  byId("save").onclick = () => {
    const link = document.createElement("a");
    link.href = picture().toDataURL("image/png");
    link.download = `${document.title.replace(/[^\w-]+/g, "_")}.png`;
    link.click();
  };
  addEventListener("keydown", (e) => {
    if (e.target.tagName === "SELECT" || e.target.tagName === "BUTTON") return;
    if (e.key === " ") { e.preventDefault(); play(!playing); }
    const frames = views[0].run.frames, i = views[0].frame;
    if (e.key === "ArrowRight" && e.target.id !== "scrub") setTime(frames[Math.min(i + 1, frames.length - 1)].time);
    if (e.key === "ArrowLeft" && e.target.id !== "scrub") setTime(frames[Math.max(i - 1, 0)].time);
  });
  addEventListener("resize", () => { dirty = true; drawGraph(); });

  // the value under the cursor
  const tip = byId("tip");
  function point(view, e) {
    const box = view.canvas.getBoundingClientRect();
    const seen = view.under((e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height);
    tip.hidden = !seen;
    if (!seen) return;
    // values beyond the end of the bar are stored as its end
    const value = seen.label ? `${seen.label} ${seen.end ? "at least " : ""}${withUnit(seen.value, seen.unit)}` : "";
    tip.textContent = [seen.body, value].filter(Boolean).join(": ");
    tip.style.left = `${Math.min(e.clientX + 14, innerWidth - tip.offsetWidth - 6)}px`;
    tip.style.top = `${Math.max(4, e.clientY - 34)}px`;
  }

  for (const view of views) {
    const { canvas } = view;
    canvas.onpointerleave = () => { tip.hidden = true; };
    gestures(canvas, {
      hover: (e) => { if (!playing) point(view, e); },
      turned: () => { tip.hidden = true; dirty = true; },
      reset,
    });
  }

  function tick(now) {
    if (playing) {
      // load steps have no time: the whole run in two seconds
      const rate = views.every((v) => v.run.static) ? (last - first) / 2 : 1;
      const next = time + Math.min(now - before, 200) / 1000 * rate * byId("speed").value;
      // the end is seen for a moment before it begins again
      if (next < last) setTime(next);
      else if (!byId("loop").checked) { setTime(last); play(false); }
      else if (next < last + 0.6 * rate) { setTime(last); time = next; }
      else setTime(first);
    }
    before = now;
    if (dirty) { dirty = false; views.forEach((v) => v.draw()); }
    requestAnimationFrame(tick);
  }
  const view = numbers(asked.camera, 5);
  if (view) Object.assign(camera, { azimuth: view[0], elevation: view[1], zoom: view[2], shift: view.slice(3) });
  const cut = numbers(asked.cut, 4);
  if (cut) {
    Object.assign(shown, { cut, across: "view", normal: cut.slice(0, 3) });
    byId("cut").value = "view";
    byId("depth").hidden = false;
    byId("depth").value = 500 * (1 - (cut[3] - dot(shown.normal, around.middle)) / around.radius);
  }
  setTime(time);
  views.forEach((v) => { if (v.frame === undefined) v.show(0); });
  byId("field").value = names.includes(asked.field) || asked.field === "none" ? asked.field : shown.field;
  setField(byId("field").value);
  if (asked.map in data.maps) setMap(asked.map);
  const range = numbers(asked.range, 2);
  if (range && range[1] > range[0] && ranges[shown.field]) setRange(range);
  prepareGraph();
  if (!still && at === null) play(true);
  requestAnimationFrame((now) => { before = now; tick(now); });
  // for scripts and tests
  window.sinew = { views, play, picture, playing: () => playing, time: () => time, setTime, setField, setMap, setGraph, setRange, link, draw: () => views.forEach((v) => v.draw()), first, last };
})();
