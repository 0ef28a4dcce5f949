// Steps the engine beside the page, in time with the clock as far as it can, and sends what there is to draw. Numbers go over as
// transferables: nothing is shared, so no header of a server is needed.

// so long (ms) a round of steps lasts at most, so that the hand is heard in between
const ROUND = 30;
// the finger: radius (m), how deep (m) it presses, how fast (m/s) it moves, and where it waits
const RADIUS = 0.012, DEPTH = 0.025, SPEED = 0.3, AWAY = [0, 0, 10];

const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const length = (a) => Math.hypot(...a);

let engine, source, pulled = null, finger = null, running = false, dt, due, told, revision, settings, done;

// a loop, because Uint8Array.from with a function takes ten times as long
function bytes(base64) {
  const letters = atob(base64), all = new Uint8Array(letters.length);
  for (let i = 0; i < all.length; i++) all[i] = letters.charCodeAt(i);
  return all;
}

// always with an engine of its own: one that panicked cannot be used again
async function begin() {
  running = false;
  engine = await Engine.start(source.wasm);
  for (const [name, bytes] of Object.entries(source.files)) engine.file(name, bytes);
  engine.open(source.scene);
  const names = engine.names();
  ({ dt, solver: settings } = names);
  [pulled, finger, revision, told, done, due] = [null, null, -1, true, { steps: 0, time: 0 }, performance.now()];
  running = true;
  return names;
}

const doors = {
  async start({ unpacker, packed, scene, files }) {
    source = { scene, files, wasm: await Engine.unpacked(bytes(unpacker), bytes(packed)) };
    postMessage({ scene: await begin(), look: engine.look(RADIUS), rest: engine.points(0), surface: engine.surface(0) });
    setTimeout(round);
  },
  again: begin,
  pull({ from, along, stiffness }) {
    const pick = engine.pick(from, along);
    if (pick) engine.pull(stiffness, 0.02 * stiffness);
    pulled = pick && { ...pick, target: pick.position };
    postMessage({ held: pick && pick.position });
  },
  poke({ from, along }) {
    const pick = engine.pick(from, along);
    if (pick) {
      const into = along.map((x) => x / length(along)), start = add(pick.position, into, -RADIUS - 0.001);
      engine.tool(0, start, true);
      finger = { start, at: start, into, by: [0, 0, 0] };
    }
    postMessage({ held: pick && pick.position });
  },
  // by how far the hand moved since it came down
  move({ by }) {
    if (finger) finger.by = by;
    if (!pulled) return;
    pulled.target = add(pulled.position, by);
    engine.move(by);
  },
  release() {
    if (pulled) engine.release();
    if (finger) engine.tool(0, AWAY, true);
    pulled = finger = null;
  },
  cut: ({ ends }) => postMessage({ cut: engine.cut(0, ends) }),
  material: ({ young, poisson }) => engine.material(0, young, poisson),
  step({ seconds }) {
    engine.dt(seconds);
    dt = seconds;
  },
  integrator({ name }) {
    settings = { ...settings, integrator: name };
    engine.solver(settings);
  },
  run({ on }) {
    running = on;
    due = performance.now();
  },
  told() { told = true; },
};

function step() {
  if (finger) {
    const way = add(add(add(finger.start, finger.by), finger.into, DEPTH), finger.at, -1);
    finger.at = add(finger.at, way, Math.min(1, SPEED * dt / (length(way) || 1)));
    engine.tool(0, finger.at, false);
  }
  const start = performance.now();
  engine.step();
  done.time += performance.now() - start;
  done.steps += 1;
}

function frame() {
  const report = engine.report(), points = engine.points(0), message = { points, report, done: { ...done, clock: performance.now() / 1000 } };
  const others = [points.buffer];
  if (report.revisions[0] !== revision) {
    revision = report.revisions[0];
    message.surface = engine.surface(0);
    others.push(message.surface.index.buffer);
  }
  if (pulled) message.pulled = { vertices: pulled.vertices, weights: pulled.weights, target: pulled.target };
  if (finger) message.finger = finger.at;
  postMessage(message, others);
  done = { steps: 0, time: 0 };
  told = false;
}

function round() {
  const start = performance.now();
  try {
    if (running) {
      // what could not be done in time is left out
      due = Math.max(due, start - 100);
      while (due <= performance.now() && performance.now() - start < ROUND) {
        step();
        due += 1000 * dt;
      }
    }
    if (told && done.steps) frame();
  } catch (error) {
    running = false;
    postMessage({ stopped: error.message });
  }
  setTimeout(round, running ? Math.max(0, Math.min(due - performance.now(), 20)) : 20);
}

// one after another, also those that wait for the engine
let queue = Promise.resolve();
onmessage = ({ data }) => {
  queue = queue.then(() => doors[data.door](data)).catch((error) => {
    postMessage({ [engine ? "refused" : "stopped"]: error.message });
  });
};
