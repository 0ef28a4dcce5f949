"use strict";
// A body that the engine steps in a worker, drawn as it comes, and the hand that pulls, pokes and cuts it.
(async () => {
  const byId = (id) => document.getElementById(id);
  const text = (id) => byId(id).textContent.trim();
  const warn = (words) => { byId("heading").querySelector(".warning").textContent = words; };
  const data = { runs: [], camera: [25, 14], colours: [], wound: [], maps: {} };
  const ranges = {}, own = () => "";
  let around;

  @VIEW@

  // ---- the engine

  const worker = new Worker(URL.createObjectURL(new Blob([text("worker")], { type: "text/javascript" })));
  const tell = (door, more = {}) => worker.postMessage({ door, ...more });
  worker.onerror = (e) => warn(`The worker stopped: ${e.message}`);

  // ---- drawing

  // positions come in metres
  class Live extends View {
    metres(places) { return places; }

    lay(points, surface) {
      const keep = !surface;
      this.points = points;
      if (surface) {
        const n = surface.points;
        this.run.skins = [{ source: Uint32Array.from({ length: n }, (_, i) => i), index: surface.index, depth: surface.shade }];
      }
      const [skin] = this.run.skins, [near, deep] = data.wound, [plain] = data.colours;
      const tint = (v) => {
        const d = skin.depth[v];
        return d ? [...near.map((c, k) => c + (deep[k] - c) * (d - 1) / 254), 255] : [...plain, 255];
      };
      this.skin = 0;
      this.fill(this.body, skin, points, tint, keep);
    }

    at(v) { return this.points.subarray(3 * v, 3 * v + 3); }

    // where a ray meets it
    meets(eye, ray) {
      const met = firstMet(eye, ray, this.run.skins[0].index, (v) => this.at(v));
      return met && add(eye, ray, met.far);
    }

    // the place of what is held
    place({ vertices, weights }) {
      return vertices.reduce((sum, v, k) => add(sum, this.at(v), weights[k]), [0, 0, 0]);
    }

    // the finger, or the spring between the hand and what it holds
    hand(finger, spring) {
      this.placed({ tools: Float32Array.from(finger ? [0, ...finger, 0, 0, 0, 1] : []) });
      const { size } = this.run, ink = 0x3d4653;
      const rods = spring ? [...spring.from, ...spring.to, ink] : [];
      const balls = spring ? [...spring.from, 0.006 * size, ink, ...spring.to, 0.009 * size, 0xd8a13a] : [];
      this.solids({ balls: Float32Array.from(balls), rods: Float32Array.from(rods), arrows: new Float32Array(0) });
    }
  }

  // ---- what the panel shows

  const KEPT = 10;
  const GRAPHS = {
    force: ["forces (N)", "N", ["hand", "ligament"]],
    energy: ["energies (J)", "J", ["elastic", "kinetic"]],
    volume: ["smallest volume ratio", "", ["smallest J"]],
    cost: ["time of a step (ms)", "ms", ["step"]],
  };
  const INKS = ["#d55e00", "#0072b2"];
  const past = [];
  const energy = (value) => (Math.abs(value) < 0.9995 ? `${(1e3 * value).toFixed(2)} mJ` : `${value.toFixed(3)} J`);
  const values = (name, p) => ({ force: [p.hand, p.ligament], energy: [p.elastic, p.kinetic], volume: [p.smallest], cost: [p.cost] })[name];

  function drawGraph() {
    const svg = document.querySelector("#graph svg"), width = svg.clientWidth, height = svg.clientHeight;
    const name = byId("what").value, [, unitName, names] = GRAPHS[name];
    if (!width || !past.length) return;
    const [left, right, top, bottom] = [46, width - 4, 18, height - 6], now = past.at(-1).clock;
    const all = past.flatMap((p) => values(name, p));
    let low = Math.min(0, ...all), high = Math.max(...all, low + 1e-9);
    if (name === "volume") [low, high] = [Math.min(0.9, ...all), Math.max(1, ...all)];
    const x = (t) => right - (right - left) * (now - t) / KEPT, y = (v) => bottom - (bottom - top) * (v - low) / (high - low);
    const out = ticks(low, high, 3).map((v) => `<line class="grid" x1="${left}" x2="${right}" y1="${y(v)}" y2="${y(v)}"/>
      <text x="${left - 6}" y="${y(v) + 4}" text-anchor="end">${Number(v.toPrecision(3))} ${unitName}</text>`);
    names.forEach((series, k) => {
      const points = past.map((p) => `${x(p.clock).toFixed(1)},${y(values(name, p)[k]).toFixed(1)}`).join(" ");
      out.push(`<polyline points="${points}" stroke="${INKS[k]}"/>
        <text x="${left + 4 + 70 * k}" y="10" style="fill:${INKS[k]}">${series}</text>`);
    });
    svg.innerHTML = out.join("");
  }

  // steps in the last second, and what one of them took (ms), both by the clock of the worker
  function pace() {
    const recent = past.filter((p) => p.clock > past.at(-1).clock - 1), since = past[past.length - recent.length - 1]?.clock;
    const steps = recent.reduce((sum, p) => sum + p.steps, 0);
    return { rate: since === undefined ? 0 : steps / (past.at(-1).clock - since),
      cost: recent.reduce((sum, p) => sum + p.cost * p.steps, 0) / steps };
  }
  let paced = 0;
  function show(report, { steps, time, clock }) {
    const force = report.hand ? report.hand.force : report.tools.finger;
    const entry = {
      clock, steps, hand: Math.hypot(...force), ligament: Math.hypot(...report.reactions.ligament),
      elastic: report.elastic_energy, kinetic: report.kinetic_energy, smallest: report.volume.smallest_ratio, cost: time / steps,
    };
    past.push(entry);
    while (past[0].clock < clock - KEPT) past.shift();
    if (clock > paced + 0.5) {
      paced = clock;
      const { rate, cost } = pace();
      byId("cost").textContent = `${cost.toFixed(2)} ms`;
      byId("rate").textContent = rate.toFixed(0);
    }
    const put = (id, words) => { byId(id).textContent = words; };
    put("force", `${entry.hand.toFixed(2)} N`);
    put("ligament", `${entry.ligament.toFixed(2)} N`);
    put("elastic", energy(entry.elastic));
    put("kinetic", energy(entry.kinetic));
    put("smallest", entry.smallest.toFixed(3));
    put("time", `${report.time.toFixed(1)} s`);
    warn(report.verdict ?? "");
    drawGraph();
    return entry;
  }

  // ---- the hand

  const HINTS = {
    pull: "Drag the organ: a spring pulls at the place you hold. Drag beside it to turn it, wheel or two fingers to zoom.",
    poke: "Press on the organ: a finger of 24 mm goes in 25 mm deep and follows the pointer.",
    cut: "Draw a stroke across the organ: a blade goes through along your line of sight.",
  };
  let mode = "pull", view, latest = null, dirty = true, grip = null;

  function setMode(name) {
    mode = name;
    for (const button of document.querySelectorAll("#modes button")) button.ariaPressed = String(button.dataset.mode === name);
    byId("hint").textContent = HINTS[name];
    byId("forceName").textContent = name === "poke" ? "Force of the finger" : "Force of the hand";
    view?.canvas.classList.toggle("cuts", name === "cut");
  }

  // where the line of sight through a pointer meets the plane across the view at a place
  function inPlane(e, place) {
    const box = view.canvas.getBoundingClientRect(), { eye, forward } = view.sight;
    const ray = view.ray((e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height);
    return { eye, ray, at: place && add(eye, ray, dot(add(place, eye, -1), forward) / dot(ray, forward)) };
  }
  // whether a pointer that comes down takes hold of the organ, or begins a stroke
  function takeHold(e) {
    const { eye, ray } = inPlane(e), place = view.meets(eye, ray);
    if (mode !== "cut" && !place) return false;
    grip = { down: e, place, stroke: mode === "cut" ? [e] : null };
    if (!grip.stroke) tell(mode, { from: eye, along: ray, stiffness: slide("spring") });
    view.canvas.classList.add("held");
    return true;
  }
  function follow(e) {
    if (grip.stroke) {
      const last = grip.stroke.at(-1);
      if (Math.hypot(e.clientX - last.clientX, e.clientY - last.clientY) < 8) return;
      grip.stroke.push(e);
      const box = view.canvas.getBoundingClientRect();
      byId("stroke").innerHTML =
        `<polyline points="${grip.stroke.map((p) => `${p.clientX - box.left},${p.clientY - box.top}`).join(" ")}"/>`;
      return;
    }
    tell("move", { by: add(inPlane(e, grip.place).at, grip.place, -1) });
  }
  function letGo(done = true) {
    if (!grip) return;
    if (done && grip.stroke?.length > 1) {
      // from before the organ to behind it
      const { forward } = view.sight, { middle, radius } = around;
      const ends = grip.stroke.map((e) => [-1, 1].map((side) => inPlane(e, add(middle, forward, side * radius)).at));
      tell("cut", { ends });
    } else if (!grip.stroke) {
      tell("release");
    }
    byId("stroke").innerHTML = "";
    grip = null;
    view.canvas.classList.remove("held");
  }

  // ---- beginning

  const INTEGRATORS = ["safe", "linearised-bdf2", "linearised-tr-bdf2", "newton", "bdf2", "implicit-midpoint", "symplectic-euler"];
  const slides = {
    young: [(v) => 10 ** v, (v) => `${(v / 1000).toFixed(v < 9950 ? 1 : 0)} kPa`],
    poisson: [(v) => v, (v) => v.toFixed(2)],
    step: [(v) => v / 1000, (v) => `${(1000 * v).toFixed(0)} ms`],
    spring: [(v) => 10 ** v, (v) => `${v.toFixed(0)} N/m`],
  };
  const slide = (id) => slides[id][0](byId(id).valueAsNumber);
  const label = (id) => { byId(id).parentNode.querySelector("b").textContent = slides[id][1](slide(id)); };
  const material = () => tell("material", { young: slide("young"), poisson: slide("poisson") });
  const apply = () => {
    material();
    tell("step", { seconds: slide("step") });
    tell("integrator", { name: byId("integrator").value });
  };

  function begin({ scene, look, rest, surface }) {
    const [body] = scene.bodies, { ball } = look;
    byId("heading").querySelector("span").textContent =
      `${body.tetrahedra} tetrahedra, ${body.vertices} vertices: the engine is in this page, as WebAssembly, in double precision on one thread.`;
    Object.assign(data, { colours: look.colours, wound: look.wound });
    around = { middle: look.middle, radius: 0.5 * look.size };
    const shape = { points: Float32Array.from(ball.points.flat()), normals: Float32Array.from(ball.normals.flat()),
      index: ball.triangles.flat(), colour: [120, 132, 144], plate: false, hollow: false };
    const skin = { source: Uint32Array.from({ length: surface.points }, (_, i) => i), index: surface.index, depth: surface.shade };
    const run = { up: look.up, size: look.size, middle: look.middle, floor: look.floor, shade: look.shade, grid: look.grid, rest,
      skins: [skin], shapes: [shape] };
    data.runs = [run];
    view = new Live(run);
    Object.assign(shown, { field: "none", ghost: false });
    view.box.insertAdjacentHTML("beforeend", '<svg id="stroke"></svg><div id="said" role="status"></div>');
    view.lay(rest, surface);
    view.hand(null, null);
    byId("young").value = Math.log10(body.young_modulus);
    byId("poisson").value = body.poisson_ratio;
    byId("step").value = 1000 * scene.dt;
    for (const name of INTEGRATORS) byId("integrator").add(new Option(name));
    byId("integrator").value = scene.solver.integrator;
    Object.keys(slides).forEach(label);
    hear();
    setMode("pull");
    requestAnimationFrame(tick);
  }

  // what comes down on the organ holds it, all else moves the camera
  function hear() {
    const { canvas } = view;
    gestures(canvas, { hover: () => {}, turned: () => { dirty = true; }, reset: () => {
      Object.assign(camera, { azimuth: data.camera[0], elevation: data.camera[1], zoom: 1, shift: [0, 0] });
      dirty = true;
    } });
    const { onpointerdown, onpointermove, onpointerup } = canvas;
    canvas.onpointerdown = (e) => {
      if (grip) {
        // a second finger: both move the camera
        const { down } = grip;
        letGo(false);
        onpointerdown(down);
      } else if (e.button === 0 && !e.shiftKey && takeHold(e)) {
        canvas.setPointerCapture(e.pointerId);
        return;
      }
      onpointerdown(e);
    };
    canvas.onpointermove = (e) => {
      if (grip?.down.pointerId === e.pointerId) follow(e);
      else onpointermove(e);
    };
    canvas.onpointerup = canvas.onpointercancel = (e) => {
      if (grip?.down.pointerId === e.pointerId) letGo(e.type === "pointerup");
      onpointerup(e);
    };
    for (const button of document.querySelectorAll("#modes button")) button.onclick = () => setMode(button.dataset.mode);
    for (const id of Object.keys(slides)) byId(id).oninput = () => label(id);
    byId("young").onchange = byId("poisson").onchange = material;
    byId("step").onchange = () => tell("step", { seconds: slide("step") });
    byId("integrator").onchange = (e) => tell("integrator", { name: e.target.value });
    for (const [id, name] of [["ghost", "ghost"], ["edges", "mesh"]]) {
      byId(id).onchange = (e) => { shown[name] = e.target.checked; dirty = true; };
    }
    byId("run").onclick = () => run(byId("run").textContent !== "Pause");
    byId("again").onclick = () => {
      letGo(false);
      tell("again");
      apply();
      run(true);
    };
    for (const [name, [title]] of Object.entries(GRAPHS)) byId("what").add(new Option(title, name));
    byId("what").onchange = drawGraph;
    night.onchange = () => { dirty = true; };
    addEventListener("resize", () => { dirty = true; });
  }
  function run(on) {
    byId("run").textContent = on ? "Pause" : "Run";
    tell("run", { on });
  }

  let saying;
  function say(words) {
    byId("said").textContent = words;
    clearTimeout(saying);
    saying = setTimeout(() => { byId("said").textContent = ""; }, 6000);
  }

  function tick() {
    if (latest) {
      const { points, surface, report, done, pulled, finger } = latest;
      latest = null;
      view.lay(points, surface);
      view.hand(finger, pulled && { from: view.place(pulled), to: pulled.target });
      last = show(report, done);
      tell("told");
      dirty = true;
    }
    if (dirty) { dirty = false; view.draw(); }
    requestAnimationFrame(tick);
  }
  // for tests
  let last = null, frames = 0;
  window.sinew = { last: () => last, frames: () => frames, pace, view: () => view, hold: () => grip };

  worker.onmessage = ({ data: message }) => {
    if (message.scene) begin(message);
    if (message.points) { latest = { ...message, surface: message.surface ?? latest?.surface }; frames += message.done.steps; }
    if ("held" in message && grip) {
      if (message.held) grip.place = message.held;
      else letGo(false);
    }
    if (message.cut) say(message.cut.vertices ? "" : "The blade met nothing.");
    if (message.refused) say(message.refused);
    // before there is a view, nothing can begin again
    if (message.stopped) warn(view ? `${message.stopped} Press "Again".` : message.stopped);
  };
  const name = byId("mesh").dataset.name;
  tell("start", { unpacker: text("unpacker"), packed: text("packed"), scene: text("scene"),
    files: { [name]: new TextEncoder().encode(`${text("mesh")}\n`) } });
})().catch((error) => {
  document.querySelector("#heading .warning").textContent = error.message;
  throw error;
});
