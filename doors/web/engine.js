"use strict";
// The doors of the engine for JavaScript. Texts and arrays go through its memory; errors become exceptions.
class Engine {
  static async start(bytes) {
    const module = await WebAssembly.compile(bytes);
    // crates that could ask a browser for something are linked in, and never called
    const host = {};
    for (const { module: from, name } of WebAssembly.Module.imports(module)) {
      (host[from] ??= {})[name] = () => { throw new Error(`the engine asked for ${name}`); };
    }
    return new Engine((await WebAssembly.instantiate(module, host)).exports);
  }

  // bytes of an engine that build.sh packed; the module that unpacks it has the same kind of doors
  static async unpacked(unpacker, packed) {
    const own = await Engine.start(unpacker);
    own.call("unpack", [], packed);
    return own.bytes();
  }

  constructor(doors) { this.doors = doors; }

  // calls a door, after what it reads was put into its room
  call(name, numbers = [], room = null) {
    if (room !== null) {
      const bytes = typeof room === "string" ? new TextEncoder().encode(room) : room;
      const at = this.doors.sinew_room(bytes.length);
      new Uint8Array(this.doors.memory.buffer, at, bytes.length).set(bytes);
    }
    let code;
    try {
      code = this.doors[`sinew_${name}`](...numbers);
    } catch (trap) {
      throw new Error(`the engine stopped: ${this.text() || trap.message}`);
    }
    if (code !== 0) throw Object.assign(new Error(this.text()), { code });
  }

  // a copy of the last answer
  bytes() {
    const at = this.doors.sinew_answer();
    return new Uint8Array(this.doors.memory.buffer.slice(at, at + this.doors.sinew_answer_length()));
  }
  text() { return new TextDecoder().decode(this.bytes()); }
  json() { return JSON.parse(this.text()); }

  file(name, bytes) {
    const words = new TextEncoder().encode(name), all = new Uint8Array(words.length + 1 + bytes.length);
    all.set(words);
    all.set(bytes, words.length + 1);
    this.call("file", [], all);
  }
  open(scene) { this.call("open", [], scene); }
  names() { this.call("names"); return this.json(); }
  look(radius) { this.call("look", [radius]); return this.json(); }
  step(count = 1) { this.call("step", [count]); }
  report() { this.call("report"); return this.json(); }
  hash() { this.call("hash"); return this.text(); }
  points(body) { this.call("points", [body]); return new Float32Array(this.bytes().buffer); }
  surface(body) {
    this.call("surface", [body]);
    const { buffer } = this.bytes(), [points, triangles] = new Uint32Array(buffer, 0, 2);
    return { points, index: new Uint32Array(buffer, 8, 3 * triangles), shade: new Uint8Array(buffer, 8 + 12 * triangles, points) };
  }
  pick(from, along) { this.call("pick", [...from, ...along]); return this.json(); }
  pull(stiffness, damping) { this.call("pull", [stiffness, damping]); }
  move(by) { this.call("move", by); }
  release() { this.call("release"); }
  tool(index, place, jump) { this.call("tool", [index, ...place, jump ? 1 : 0]); }
  // the two ends of a blade, position after position
  cut(body, ends) { this.call("cut", [body], new Uint8Array(new Float64Array(ends.flat(2)).buffer)); return this.json(); }
  material(body, young, poisson) { this.call("material", [body, young, poisson]); }
  dt(seconds) { this.call("dt", [seconds]); }
  solver(settings) { this.call("solver", [], JSON.stringify(settings)); }
}
