// What the page has packed, as it lies in the page: unpacked it is the engine, and damaged it is refused.
// node tests/unpack.mjs PAGE.html ENGINE.wasm
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";

const [page, wasm] = process.argv.slice(2).map((name) => readFileSync(name));
const Engine = new Function(`${readFileSync(new URL("../engine.js", import.meta.url), "utf8")}; return Engine;`)();
const html = page.toString();
const [unpacker, packed] = ["unpacker", "packed"].map((id) => Buffer.from(html.match(`<script id="${id}"[^>]*>([^<]*)<`)[1], "base64"));

const start = performance.now(), engine = await Engine.unpacked(unpacker, packed);
console.log(`${packed.length} bytes unpacked by ${unpacker.length} in ${(performance.now() - start).toFixed(0)} ms`);
assert.ok(wasm.equals(engine), "what was packed");

// a wrong bit early, in the middle and late, what is cut short, and nothing at all
const refused = (bytes) => assert.rejects(Engine.unpacked(unpacker, bytes), /^Error: the engine in this page is damaged/);
for (const share of [0, 1e-5, 0.1, 0.5, 0.9, 0.99999]) {
  const wrong = Uint8Array.from(packed);
  wrong[Math.floor(share * wrong.length)] ^= 4;
  await refused(wrong);
}
// a dictionary of two gigabytes is as wrong
const huge = Uint8Array.from(packed);
huge[4] = 0x80;
await assert.rejects(Engine.unpacked(unpacker, huge), /^Error: (the engine in this page is damaged|there is no memory)/);
for (const length of [0, 12, 13, 1000, packed.length - 1]) await refused(packed.subarray(0, length));
console.log("what the page has packed is in order");
