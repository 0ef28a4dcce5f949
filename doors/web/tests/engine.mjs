// The engine as WebAssembly, in Node: the same bits as the command with portable instructions, every door, errors.
// node tests/engine.mjs ENGINE.wasm [COMMAND]
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";

const root = fileURLToPath(new URL("../../../", import.meta.url));
const [wasm, command] = process.argv.slice(2);
const Engine = new Function(`${readFileSync(`${root}doors/web/engine.js`, "utf8")}; return Engine;`)();
const bytes = readFileSync(wasm);

async function opened(scene) {
  const engine = await Engine.start(bytes), text = readFileSync(`${root}${scene}`, "utf8");
  for (const [, name] of text.matchAll(/^mesh = "(.*)"/gm)) {
    engine.file(name, readFileSync(`${root}demos/meshes/${name.split("/").at(-1)}`));
  }
  engine.open(text);
  return engine;
}

// the same bits
for (const [scene, steps] of [["liver", 100], ["incision", 60], ["scissors", 60], ["muscle_bar", 40], ["membrane_drum", 30]]) {
  const file = `demos/scenes/${scene}.toml`, engine = await opened(file);
  const start = performance.now();
  engine.step(steps);
  const time = (performance.now() - start) / steps, own = engine.hash();
  if (!command) { console.log(`skipped: no command to compare ${scene} with; ${own}`); continue; }
  const options = ["--steps", steps, "--instruction-set", "portable", "--threads", "1", "--json", "-"];
  const { final_state_hash: native } =
    JSON.parse(execFileSync(command, ["run", `${root}${file}`, ...options], { stdio: ["ignore", "pipe", "ignore"] }));
  console.log(`${scene}: ${steps} steps of ${time.toFixed(2)} ms, hash ${own}, native ${native}`);
  assert.equal(own, native, scene);
}

// the hand: what pulls feels the body, and lets it go
{
  const engine = await opened("doors/web/liver.toml");
  const far = [0, -1, 0], at = engine.look(0.01).middle.map((x, k) => x + far[k]);
  assert.equal(engine.pick(at, far), null, "a ray that leads away");
  assert.throws(() => engine.pull(100, 1), /no place was picked/);
  // until it hangs at rest; in time with the clock, by what the processor does for it
  engine.step(100);
  const { user } = process.cpuUsage();
  engine.step(100);
  const cost = process.cpuUsage({ user, system: 0 }).user / 1e5;
  console.log(`a step of the page: ${cost.toFixed(2)} ms of processor time`);
  assert.ok(cost < 1000 / 60, "60 steps in a second");
  const pick = engine.pick(at, [0, 1, 0]);
  assert.equal(pick.body, 0);
  engine.pull(100, 1);
  const force = () => Math.hypot(...engine.report().hand.force);
  const forces = [0.01, 0.02, 0.03].map((far) => {
    engine.move([0, -far, 0]);
    engine.step(40);
    return force();
  });
  console.log(`forces of the hand: ${forces.map((f) => `${f.toFixed(3)} N`).join(", ")}`);
  assert.ok(forces[0] > 0.02 && forces[1] > 1.5 * forces[0] && forces[2] > 1.3 * forces[1]);
  const points = engine.points(0), held = pick.vertices.reduce((sum, v, k) => sum + pick.weights[k] * points[3 * v + 1], 0);
  assert.ok(held < pick.position[1] - 0.001, "what is held follows");
  engine.release();
  engine.step(1);
  assert.equal(engine.report().hand, null);
  assert.throws(() => engine.move([0, 0, 0]), /it holds nothing/);

  // softer: it hangs lower
  const lowest = () => engine.points(0).reduce((low, x, i) => (i % 3 === 2 ? Math.min(low, x) : low), 1);
  engine.step(100);
  const hard = lowest();
  engine.material(0, 2500, 0.45);
  engine.solver({ integrator: "newton", mass_damping: 4 });
  engine.dt(0.02);
  engine.step(100);
  assert.ok(lowest() < hard - 0.005, `${lowest()} after ${hard}`);

  // the finger of the scene presses and feels it
  engine.open(readFileSync(`${root}doors/web/liver.toml`, "utf8"));
  engine.step(120);
  const place = engine.pick(at, [0, 1, 0]).position;
  engine.tool(0, [place[0], place[1] - 0.013, place[2]], true);
  for (let k = 1; k <= 20; k++) {
    engine.tool(0, [place[0], place[1] - 0.013 + 0.001 * k, place[2]], false);
    engine.step(1);
  }
  assert.ok(Math.hypot(...engine.report().tools.finger) > 0.05, "the finger feels something");

  // a blade through the whole body parts it, and the wound has triangles of its own
  engine.open(readFileSync(`${root}doors/web/liver.toml`, "utf8"));
  const before = engine.surface(0), revision = engine.report().revisions[0];
  assert.ok(before.shade.every((s) => s === 0));
  const cut = engine.cut(0, [[[0.03, -0.2, -0.2], [0.03, 0.2, -0.2]], [[0.03, -0.2, 0.2], [0.03, 0.2, 0.2]]]);
  engine.step(10);
  const after = engine.surface(0);
  console.log(`cut: ${JSON.stringify(cut)}, ${before.index.length / 3} triangles before, ${after.index.length / 3} after`);
  assert.ok(cut.pieces === 2 && cut.vertices > 10 && after.index.length > before.index.length);
  assert.ok(engine.report().revisions[0] !== revision && after.shade.some((s) => s > 0));
  assert.equal(engine.points(0).length, 3 * after.points);
  assert.ok(engine.points(0).every(Number.isFinite) && after.index.every((v) => v < after.points));
}

// what cannot be used is refused by name, and the simulation goes on
{
  const engine = await Engine.start(bytes);
  assert.throws(() => engine.step(), /open a scene first/);
  assert.throws(() => engine.open("dt = 0.0"), (error) => error.code === 4);
  assert.throws(() => engine.open('name = "a"\ndt = 0.01\nduration = 1.0\n[[body]]\nname = "b"\nmesh = "none.msh"\nmaterial = { preset = "liver" }'), /none.msh/);
  const single = `precision = "f32"\n${readFileSync(`${root}doors/web/liver.toml`, "utf8")}`;
  engine.file("liver_medium.msh", readFileSync(`${root}demos/meshes/liver_medium.msh`));
  assert.throws(() => engine.open(single), /precision = "f32" is not in WebAssembly/);
  const own = await opened("doors/web/liver.toml"), hash = own.hash();
  assert.throws(() => own.points(1), /1 is none of the 1 of the scene/);
  assert.throws(() => own.material(0, -1, 0.3), /Young/);
  assert.throws(() => own.material(0, 1e4, 0.5), /Poisson/);
  assert.throws(() => own.dt(0), /dt/);
  assert.throws(() => own.solver({ integrator: "none" }), /integrator|none/);
  assert.throws(() => own.call("solver", [], Uint8Array.of(255, 254)), /UTF-8/);
  assert.throws(() => own.cut(0, [[[0, 0, 0], [NaN, 0, 0]]]), (error) => error.code > 0);
  assert.throws(() => own.call("cut", [0], new Uint8Array(47)), /six numbers/);
  assert.throws(() => own.pick([0, 0, 0], [0, 0, 0]), /no length/);
  assert.throws(() => own.tool(0, [NaN, 0, 0], false), (error) => error.code > 0);
  assert.throws(() => own.call("file", [], Uint8Array.of(65)), /zero byte/);
  assert.equal(own.hash(), hash, "nothing was changed");
  own.step();
}
console.log("the engine in WebAssembly is in order");
