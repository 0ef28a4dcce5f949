  // What draws: part of the script of every page, within its function. Around it stand `data` (runs, camera, colours of bodies
  // and wounds, maps), `ranges` of colours, `around`, the ball that the camera looks at, `own` and `byId`.

  // ---- vectors

  const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
  const unit = (a) => scale(a, 1 / (Math.hypot(...a) || 1));
  // turned by a quaternion [x, y, z, w]
  const turn = (q, v) => add(v, cross(q, add(cross(q, v), v, q[3])), 2);
  const across = (d) => unit(cross(d, Math.abs(d[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0]));

  // the triangle that a ray meets first: its corners, their weights at the place, and how far along the ray that is
  function firstMet(eye, ray, index, at, counts = () => true) {
    let found = null;
    for (let t = 0; t < index.length; t += 3) {
      const v = [index[t], index[t + 1], index[t + 2]], a = at(v[0]);
      const e = add(at(v[1]), a, -1), f = add(at(v[2]), a, -1), p = cross(ray, f), size = dot(e, p);
      if (Math.abs(size) < 1e-30) continue;
      const from = add(eye, a, -1), b = dot(from, p) / size;
      if (b < 0 || b > 1) continue;
      const q = cross(from, e), c = dot(ray, q) / size, far = dot(f, q) / size;
      if (c < 0 || b + c > 1 || far <= 0 || far >= (found?.far ?? Infinity) || !counts(far)) continue;
      found = { v, weights: [1 - b - c, b, c], far };
    }
    return found;
  }

  // ---- shaders

  const COMMON = `#version 300 es
  precision highp float;
  uniform vec3 eye, key, upward;
  uniform float size, night;
  uniform vec4 cut;
  vec3 shade(vec3 albedo, vec3 place, vec3 normal, float gloss) {
    vec3 toEye = normalize(eye - place);
    float k = smoothstep(-0.12, 1.0, dot(normal, key));
    vec3 sky = mix(vec3(0.80, 0.76, 0.72), vec3(0.96, 0.98, 1.0), 0.5 + 0.5 * dot(normal, upward));
    float fill = max(dot(normal, toEye), 0.0);
    vec3 light = sky * 0.42 + vec3(1.0, 0.985, 0.96) * k * 0.56 + 0.16 * fill;
    float shine = pow(max(dot(normal, normalize(toEye + key)), 0.0), 60.0) * gloss;
    float rim = pow(1.0 - fill, 4.0) * 0.10;
    return albedo * light + shine + rim * vec3(0.96, 0.98, 1.0);
  }
  vec3 encode(vec3 c) {
    c = clamp(c, 0.0, 1.0);
    return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
  }
  vec3 decode(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
  `;
  const SURFACE_VERTEX = COMMON + `
  layout(location = 0) in vec3 place; layout(location = 1) in vec3 normal; layout(location = 2) in vec4 tint;
  uniform mat4 matrix; uniform float away;
  out vec3 p, n; out vec4 t;
  void main() {
    p = place + normalize(place - eye) * away * size; n = normal; t = tint;
    gl_Position = matrix * vec4(p, 1.0);
  }`;
  // tint: a colour, or with opacity 0 the place along the map in red
  const SURFACE_FRAGMENT = COMMON + `
  in vec3 p, n; in vec4 t; out vec4 colour;
  uniform sampler2D map; uniform float gloss;
  void main() {
    if (dot(p, cut.xyz) > cut.w) discard;
    vec3 normal = normalize(n) * (gl_FrontFacing ? 1.0 : -1.0);
    vec3 albedo = decode(t.a > 0.5 ? t.rgb : texture(map, vec2((t.r * 255.0 + 0.5) / 256.0, 0.5)).rgb);
    // what is inside has no light of its own: its colours are those of the bar
    colour = vec4(encode(gloss < 0.0 ? albedo : shade(albedo, p, normal, gloss)), 1.0);
  }`;
  const GHOST_FRAGMENT = COMMON + `
  in vec3 p, n; in vec4 t; out vec4 colour;
  void main() {
    float turned = 1.0 - abs(dot(normalize(n), normalize(eye - p)));
    colour = vec4(vec3(0.63, 0.66, 0.70), 0.10 + 0.40 * turned * turned);
  }`;
  // tools of glass, plates from behind, and what shines through others
  const GLASS_FRAGMENT = COMMON + `
  in vec3 p, n; in vec4 t; out vec4 colour;
  uniform float opacity;
  void main() {
    vec3 normal = normalize(n);
    float turned = 1.0 - abs(dot(normal, normalize(eye - p)));
    colour = vec4(encode(shade(decode(t.rgb), p, normal, 0.3)), opacity > 0.0 ? opacity : 0.22 + 0.5 * turned * turned);
  }`;
  const LINE_FRAGMENT = COMMON + `
  in vec3 p, n; in vec4 t; out vec4 colour;
  void main() {
    if (dot(p, cut.xyz) > cut.w) discard;
    colour = vec4(0.15, 0.17, 0.2, 0.35);
  }`;
  const SCREEN_VERTEX = COMMON + `
  out vec2 at;
  void main() {
    at = vec2(float(gl_VertexID & 1) * 4.0 - 1.0, float(gl_VertexID >> 1) * 4.0 - 1.0);
    gl_Position = vec4(at, 1.0, 1.0);
  }`;
  const GROUND_FRAGMENT = COMMON + `
  in vec2 at; out vec4 colour;
  uniform vec3 right, up, forward, gx, gy, centre;
  uniform float height, grid, there, side;
  uniform sampler2D contact;
  float lines(vec2 q, vec2 width) {
    vec2 d = abs(fract(q / grid - 0.5) - 0.5) * grid;
    vec2 l = (1.0 - smoothstep(vec2(0.0), 1.3 * width, d)) * (1.0 - smoothstep(vec2(0.06), vec2(0.25), width / grid));
    return max(l.x, l.y);
  }
  void main() {
    float high = 0.5 + 0.5 * at.y;
    vec3 day = mix(vec3(0.83, 0.85, 0.875), vec3(0.955, 0.962, 0.97), high);
    vec3 c = mix(day, mix(vec3(0.014, 0.016, 0.02), vec3(0.03, 0.034, 0.042), high), night);
    vec3 ray = forward + right * at.x + up * at.y;
    float down = min(dot(ray, upward), -1e-4);
    float t = (height - dot(eye, upward)) / down;
    vec3 from = eye + ray * t - centre;
    vec2 q = vec2(dot(from, gx), dot(from, gy));
    vec2 width = fwidth(q);
    float on = there * step(dot(ray, upward), -1e-4) * step(0.0, t);
    float r = length(q) / (1.5 * size);
    float fade = on * exp(-r * r * 1.4);
    c = mix(c, mix(vec3(0.94, 0.945, 0.95), vec3(0.06, 0.066, 0.076), night), 0.75 * fade);
    c *= 1.0 + mix(-0.085, 0.6, night) * lines(q, width) * fade;
    vec2 uv = 0.5 + 0.5 * q / (side);
    float inside = step(abs(uv.x - 0.5), 0.5) * step(abs(uv.y - 0.5), 0.5);
    c *= 1.0 - on * inside * 0.62 * texture(contact, uv).r;
    colour = vec4(encode(c), 1.0);
  }`;
  const CONTACT_VERTEX = COMMON + `
  layout(location = 0) in vec3 place; uniform vec3 gx, gy, centre; uniform float height, side; out float h;
  void main() {
    vec3 from = place - centre;
    h = dot(place, upward) - height;
    gl_Position = vec4(vec2(dot(from, gx), dot(from, gy)) / (side), 0.0, 1.0);
  }`;
  const CONTACT_FRAGMENT = COMMON + `
  in float h; out vec4 colour;
  void main() { colour = vec4(exp(-max(h, 0.0) / (0.30 * size)), 0.0, 0.0, 1.0); }`;
  const BLUR_FRAGMENT = COMMON + `
  in vec2 at; out vec4 colour; uniform sampler2D map; uniform vec2 along;
  void main() {
    float sum = 0.0, weights = 0.0;
    for (int i = -9; i <= 9; i++) {
      float x = float(i) / 4.5, w = exp(-0.5 * x * x);
      sum += w * texture(map, 0.5 + 0.5 * at + along * float(i) * 1.6 / 256.0).r; weights += w;
    }
    colour = vec4(sum / weights, 0.0, 0.0, 1.0);
  }`;

  // ---- a view of one run

  const camera = { azimuth: data.camera[0], elevation: data.camera[1], zoom: 1, shift: [0, 0] };
  // `cut`: normal and place of a plane that takes away what is before it
  const shown = { field: data.field, map: "", ghost: true, mesh: false, ground: true, wounds: true, cut: null };
  const night = matchMedia("(prefers-color-scheme: dark)");

  class View {
    constructor(run) {
      this.run = run;
      this.box = document.createElement("div");
      this.box.className = "view";
      this.box.innerHTML = `<canvas></canvas><div class="caption"><b></b><span></span><div class="warning"></div></div>
        <div class="note"><b></b><span></span></div>`;
      if (data.runs.length > 1) {
        this.box.querySelector("b").textContent = run.label || run.title;
        this.box.querySelector("span").textContent = own(run.subtitle, run.label);
        this.box.querySelector(".warning").textContent = run.warning;
      }
      byId("views").append(this.box);
      this.canvas = this.box.querySelector("canvas");
      const gl = this.gl = this.canvas.getContext("webgl2", { antialias: true, alpha: false, preserveDrawingBuffer: true });
      if (!gl) throw new Error("This page needs WebGL 2, which this browser does not offer.");
      this.programs = {
        surface: this.program(SURFACE_VERTEX, SURFACE_FRAGMENT),
        ghost: this.program(SURFACE_VERTEX, GHOST_FRAGMENT),
        glass: this.program(SURFACE_VERTEX, GLASS_FRAGMENT),
        line: this.program(SURFACE_VERTEX, LINE_FRAGMENT),
        ground: this.program(SCREEN_VERTEX, GROUND_FRAGMENT),
        contact: this.program(CONTACT_VERTEX, CONTACT_FRAGMENT),
        blur: this.program(SCREEN_VERTEX, BLUR_FRAGMENT),
      };
      this.body = this.shape();
      this.rest = this.shape();
      this.parts = this.shape();
      this.inside = this.shape();
      this.tools = this.shape();
      this.map = this.texture(256, 1);
      this.contacts = [0, 1].map(() => {
        const texture = this.texture(256, 256, null);
        const target = gl.createFramebuffer();
        gl.bindFramebuffer(gl.FRAMEBUFFER, target);
        gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
        return { texture, target };
      });
      const skin = run.skins[0];
      const places = this.metres(run.rest);
      this.fill(this.rest, skin, places, () => [0, 0, 0, 255]);
      this.skin = -1;
    }

    program(vertex, fragment) {
      const gl = this.gl, program = gl.createProgram();
      for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
        gl.attachShader(program, shader);
      }
      gl.linkProgram(program);
      if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
      const places = {};
      return { program, at: (name) => places[name] ??= gl.getUniformLocation(program, name) };
    }

    texture(width, height, pixels = new Uint8Array(4 * width * height)) {
      const gl = this.gl, texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      for (const [name, value] of [["MIN_FILTER", "LINEAR"], ["MAG_FILTER", "LINEAR"],
        ["WRAP_S", "CLAMP_TO_EDGE"], ["WRAP_T", "CLAMP_TO_EDGE"]]) {
        gl.texParameteri(gl.TEXTURE_2D, gl["TEXTURE_" + name], gl[value]);
      }
      return texture;
    }

    // vertices: place, normal (six floats), tint (four bytes)
    shape() {
      const gl = this.gl, array = gl.createVertexArray(), vertices = gl.createBuffer(), index = gl.createBuffer();
      const lines = gl.createBuffer();
      gl.bindVertexArray(array);
      gl.bindBuffer(gl.ARRAY_BUFFER, vertices);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, index);
      for (const [at, count, kind, whole, offset] of [[0, 3, gl.FLOAT, false, 0], [1, 3, gl.FLOAT, false, 12],
        [2, 4, gl.UNSIGNED_BYTE, true, 24]]) {
        gl.enableVertexAttribArray(at);
        gl.vertexAttribPointer(at, count, kind, whole, 28, offset);
      }
      gl.bindVertexArray(null);
      return { array, vertices, index, lines, count: 0 };
    }

    upload(shape, bytes, index) {
      const gl = this.gl;
      gl.bindVertexArray(null);
      gl.bindBuffer(gl.ARRAY_BUFFER, shape.vertices);
      gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.DYNAMIC_DRAW);
      if (index) {
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, shape.index);
        gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, index, gl.DYNAMIC_DRAW);
        shape.count = index.length;
      }
    }

    metres(places) {
      const { low, step } = this.run, out = new Float32Array(places.length);
      for (let i = 0; i < places.length; i++) out[i] = low[i % 3] + step[i % 3] * places[i];
      return out;
    }

    // normals weighted by angles, in wounds by areas, as in still pictures
    fill(shape, skin, places, tint, keep) {
      const { source, index } = skin, normals = new Float32Array(3 * source.length);
      const at = (v) => { const i = 3 * source[v]; return [places[i], places[i + 1], places[i + 2]]; };
      for (let t = 0; t < index.length; t += 3) {
        const v = [index[t], index[t + 1], index[t + 2]], p = v.map(at);
        const area = cross(add(p[1], p[0], -1), add(p[2], p[0], -1)), n = unit(area);
        for (let k = 0; k < 3; k++) {
          if (skin.depth[v[k]]) { for (let x = 0; x < 3; x++) normals[3 * v[k] + x] += area[x]; continue; }
          const a = unit(add(p[(k + 1) % 3], p[k], -1)), b = unit(add(p[(k + 2) % 3], p[k], -1));
          const angle = Math.acos(Math.max(-1, Math.min(1, dot(a, b))));
          for (let x = 0; x < 3; x++) normals[3 * v[k] + x] += angle * n[x];
        }
      }
      const buffer = new ArrayBuffer(28 * source.length);
      const floats = new Float32Array(buffer), bytes = new Uint8Array(buffer);
      for (let v = 0; v < source.length; v++) {
        for (let x = 0; x < 3; x++) {
          floats[7 * v + x] = places[3 * source[v] + x];
          floats[7 * v + 3 + x] = normals[3 * v + x];
        }
        bytes.set(tint(v, source[v]), 28 * v + 24);
      }
      this.upload(shape, bytes, keep ? null : index);
    }

    // tools as one mesh, of which each is a stretch
    placed(frame) {
      const { shapes } = this.run, numbers = [], index = [];
      this.stretches = [];
      for (let i = 0; i < frame.tools.length; i += 8) {
        const [which, ...pose] = frame.tools.subarray(i, i + 8), at = pose.slice(0, 3), q = pose.slice(3);
        const shape = shapes[which], first = numbers.length, { points, normals } = shape;
        for (let v = 0; v < points.length; v += 3) {
          numbers.push([add(at, turn(q, points.subarray(v, v + 3))), turn(q, normals.subarray(v, v + 3)), [...shape.colour, 255]]);
        }
        this.stretches.push({ start: index.length, count: shape.index.length, at, up: turn(q, [0, 0, 1]), plate: shape.plate, hollow: shape.hollow });
        for (const v of shape.index) index.push(first + v);
      }
      this.uploadMesh(this.tools, numbers, index);
    }

    uploadMesh(shape, numbers, index) {
      const buffer = new ArrayBuffer(28 * numbers.length);
      const floats = new Float32Array(buffer), bytes = new Uint8Array(buffer);
      numbers.forEach(([p, n, c], v) => {
        floats.set(p, 7 * v);
        floats.set(n, 7 * v + 3);
        bytes.set(c, 28 * v + 24);
      });
      this.upload(shape, bytes, new Uint32Array(index));
    }

    // balls, rods and arrows as one mesh
    solids(frame) {
      const numbers = [], index = [], { size } = this.run;
      const vertex = (p, n, c) => { numbers.push([p, n, c]); return numbers.length - 1; };
      const colour = (c) => [c >> 16 & 255, c >> 8 & 255, c & 255, 255];
      const strip = (rings, sides) => {
        for (let r = 0; r + 1 < rings.length; r++) {
          for (let i = 0; i < sides; i++) {
            const a = rings[r] + i, b = rings[r] + (i + 1) % sides, c = rings[r + 1] + i, d = rings[r + 1] + (i + 1) % sides;
            index.push(a, b, d, a, d, c);
          }
        }
      };
      const turned = (from, along, rings, sides, c) => {
        const d = unit(along), x = across(d), y = cross(d, x), length = Math.hypot(...along);
        strip(rings.map(([radius, t, out, ahead]) => {
          const first = numbers.length;
          for (let i = 0; i < sides; i++) {
            const a = 2 * Math.PI * i / sides, r = add(scale(x, Math.cos(a)), y, Math.sin(a));
            vertex(add(add(from, d, t * length), r, radius), add(scale(r, out), d, ahead), c);
          }
          return first;
        }), sides);
      };
      for (let i = 0; i < frame.balls.length; i += 5) {
        const [x, y, z, r, c] = frame.balls.subarray(i, i + 5), rings = [];
        for (let k = 0; k <= 6; k++) {
          const a = Math.PI * (1 - k / 6);
          rings.push([r * Math.sin(a), 0.5 + 0.5 * Math.cos(a), Math.sin(a), Math.cos(a)]);
        }
        turned([x, y, z - r], [0, 0, 2 * r], rings, 8, colour(c));
      }
      const rod = (from, along, r, c) =>
        turned(from, along, [[r, 0, 1, 0], [r, 1, 1, 0], [r, 1, 0, 1], [0, 1, 0, 1]], 6, c);
      for (let i = 0; i < frame.rods.length; i += 7) {
        const [a, b, c, x, y, z, tint] = frame.rods.subarray(i, i + 7);
        rod([a, b, c], [x - a, y - b, z - c], 0.0022 * size, colour(tint));
      }
      this.arrows = index.length;
      for (let i = 0; i < frame.arrows.length; i += 7) {
        const [a, b, c, x, y, z, tint] = frame.arrows.subarray(i, i + 7), along = [x, y, z];
        const length = Math.hypot(x, y, z), head = Math.min(0.4 * length, 0.05 * size), tail = add([a, b, c], along, -1);
        rod(tail, scale(along, 1 - head / length), 0.007 * size, colour(tint));
        turned(add(tail, along, 1 - head / length), scale(along, head / length),
          [[0, 0, 0, -1], [0.4 * head, 0, 0, -1], [0.4 * head, 0, 0.94, 0.35], [0, 1, 0.94, 0.35]], 12, colour(tint));
      }
      this.uploadMesh(this.parts, numbers, index);
    }

    // the frame at a time, of static runs at a share of the loads
    at(time) {
      const { frames } = this.run;
      let best = 0;
      frames.forEach((f, i) => { if (Math.abs(f.time - time) < Math.abs(frames[best].time - time)) best = i; });
      return best;
    }

    show(i) {
      const { run } = this, frame = run.frames[i], skin = run.skins[frame.skin];
      const field = run.fields.findIndex((f) => f.name === shown.field);
      const values = field < 0 ? null : frame.values[field];
      const own = run.fields[field]?.range, common = ranges[shown.field];
      const tint = (body, byte) => {
        if (!values) return [...data.colours[body % data.colours.length], 255];
        const x = own[0] + (own[1] - own[0]) * byte / 255;
        return [Math.max(0, Math.min(255, 255 * (x - common[0]) / (common[1] - common[0]))), 0, 0, 0];
      };
      const places = this.metres(frame.places);
      const inner = (depth) => [...data.wound[0].map((c, x) => c + (data.wound[1][x] - c) * (depth - 1) / 254), 255];
      const coloured = (v, source) =>
        skin.depth[v] && (shown.wounds || !values) ? inner(skin.depth[v]) : tint(skin.body[v], values?.[source]);
      this.fill(this.body, skin, places, coloured, this.skin === frame.skin);
      this.section(i, places, values, tint);
      this.skin = frame.skin;
      this.solids(frame);
      this.placed(frame);
      const note = this.box.querySelectorAll(".note > *");
      note[0].textContent = run.static ? `load ${(100 * frame.time).toFixed(0)} %` : `t = ${frame.time.toFixed(2)} s`;
      note[1].textContent = run.arrowKey ? `${frame.note} · ${run.arrowKey}` : frame.note;
      this.frame = i;
    }

    // what the plane lays open: every tetrahedron that it meets, cut
    section(frame, places, values, tint) {
      const { run } = this, { corners, fates } = run, numbers = [], index = [];
      this.open = { places: [], bodies: [], bytes: [] };
      if (shown.cut) {
        const [a, b, c, w] = shown.cut, heights = new Float32Array(run.points);
        for (let v = 0; v < run.points; v++) heights[v] = a * places[3 * v] + b * places[3 * v + 1] + c * places[3 * v + 2] - w;
        for (let cell = 0; cell < run.cells; cell++) {
          const [body, born, gone] = fates.subarray(3 * cell, 3 * cell + 3);
          if (frame < born || gone <= frame) continue;
          const below = [], above = [];
          for (let k = 4 * cell; k < 4 * cell + 4; k++) (heights[corners[k]] > 0 ? above : below).push(corners[k]);
          if (!below.length || !above.length) continue;
          const first = numbers.length;
          for (const p of below) {
            // round the quadrilateral, not across
            for (const q of p === below[1] && above.length === 2 ? [above[1], above[0]] : above) {
              const s = heights[p] / (heights[p] - heights[q]), at = (list, i, j) => list[i] + s * (list[j] - list[i]);
              const place = [0, 1, 2].map((x) => at(places, 3 * p + x, 3 * q + x)), byte = values ? at(values, p, q) : 0;
              numbers.push([place, [a, b, c], tint(body, byte)]);
              this.open.places.push(place);
              this.open.bodies.push(body);
              this.open.bytes.push(byte);
            }
          }
          // turned towards what was taken away
          const [p, q, r] = this.open.places.slice(first), back = dot(cross(add(q, p, -1), add(r, p, -1)), shown.cut) < 0;
          const fan = (i, j) => index.push(first, first + (back ? j : i), first + (back ? i : j));
          fan(1, 2);
          if (numbers.length - first === 4) fan(2, 3);
        }
      }
      this.open.index = index;
      this.uploadMesh(this.inside, numbers, index);
    }

    colours() {
      const map = data.maps[shown.map], gl = this.gl;
      const pixels = new Uint8Array(4 * 256);
      for (let i = 0; i < 256; i++) pixels.set([map[3 * i], map[3 * i + 1], map[3 * i + 2], 255], 4 * i);
      gl.bindTexture(gl.TEXTURE_2D, this.map);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    }

    draw() {
      const gl = this.gl, { run, canvas } = this, dense = Math.min(devicePixelRatio || 1, 2);
      const width = Math.max(1, Math.round(canvas.clientWidth * dense));
      const height = Math.max(1, Math.round(canvas.clientHeight * dense));
      if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
      const upward = run.up, side = Math.abs(upward[1]) > 0.9 ? [0, 0, 1] : [0, 1, 0];
      const ahead = unit(add(side, upward, -dot(side, upward))), beside = cross(ahead, upward);
      const a = camera.azimuth * Math.PI / 180, e = camera.elevation * Math.PI / 180;
      const level = add(scale(ahead, Math.cos(a)), beside, -Math.sin(a));
      const forward = add(scale(level, Math.cos(e)), upward, -Math.sin(e));
      const right = unit(cross(forward, upward)), up = cross(right, forward);
      const tangent = 0.249328, aspect = width / height;
      const distance = around.radius / Math.sin(Math.atan(tangent * Math.min(1, aspect))) * (data.runs.length > 1 ? 1.04 : 0.94) * camera.zoom;
      const centre = add(add(around.middle, right, camera.shift[0] * distance), up, camera.shift[1] * distance);
      const eye = add(centre, forward, -distance);
      const near = Math.max(distance - 4 * around.radius, 0.02 * around.radius), far = distance + 6 * around.radius;
      const f = 1 / tangent, q = far / (near - far);
      const m = [0, 1, 2].flatMap((k) => [right[k] * f / aspect, up[k] * f, -forward[k] * (far + near) / (near - far),
        forward[k]]);
      const d = [-dot(right, eye) * f / aspect, -dot(up, eye) * f,
        dot(forward, eye) * (far + near) / (near - far) + 2 * q * near, -dot(forward, eye)];
      const matrix = [...m, ...d];
      this.sight = { eye, forward, right: scale(right, tangent * aspect), up: scale(up, tangent) };
      const key = unit(add(add(scale(right, -0.55), upward), forward, -0.75));
      const gx = unit(add(Math.abs(upward[0]) > 0.9 ? [0, 1, 0] : [1, 0, 0], upward,
        -upward[Math.abs(upward[0]) > 0.9 ? 1 : 0]));
      const gy = cross(upward, gx), snap = (v) => Math.round(v / run.grid) * run.grid;
      const floor = add(add(scale(gx, snap(dot(run.middle, gx))), gy, snap(dot(run.middle, gy))), upward, run.floor);
      const use = (p, more = {}) => {
        gl.useProgram(p.program);
        const values = { eye, key, upward, gx, gy, centre: floor, right: scale(right, tangent * aspect),
          up: scale(up, tangent), forward, ...more };
        for (const [name, v] of Object.entries(values)) {
          if (v.length === 4) gl.uniform4fv(p.at(name), v);
          else if (v.length === 3) gl.uniform3fv(p.at(name), v);
          else if (v.length === 2) gl.uniform2fv(p.at(name), v);
          else gl.uniform1f(p.at(name), v);
        }
        gl.uniform1f(p.at("size"), run.size);
        gl.uniform1f(p.at("night"), night.matches ? 1 : 0);
        gl.uniform1f(p.at("height"), run.floor);
        gl.uniform1f(p.at("side"), run.shade);
        gl.uniform1f(p.at("grid"), run.grid);
        gl.uniformMatrix4fv(p.at("matrix"), false, matrix);
      };
      const shape = (s, start = 0, count = s.count - start) => {
        gl.bindVertexArray(s.array);
        gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * start);
      };
      // plates are clear from behind, walls of cavities always, other tools where they would hide the pressure under them
      const clear = ({ at, up, plate, hollow }) => plate ? dot(add(eye, at, -1), up) < 0 : hollow || shown.field === "pressure";
      const uncut = [0, 0, 0, 1], cut = shown.cut ?? uncut;
      const tools = (glass) => this.stretches.filter((s) => clear(s) === glass)
        .forEach((s) => shape(this.tools, s.start, s.count));
      // contact shade, blurred
      gl.disable(gl.DEPTH_TEST);
      gl.disable(gl.CULL_FACE);
      gl.viewport(0, 0, 256, 256);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.contacts[0].target);
      gl.clearColor(0, 0, 0, 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
      gl.enable(gl.BLEND);
      gl.blendEquation(gl.MAX);
      use(this.programs.contact);
      shape(this.body);
      tools(false);
      gl.blendEquation(gl.FUNC_ADD);
      gl.disable(gl.BLEND);
      gl.bindVertexArray(null);
      for (const [from, to, along] of [[0, 1, [1, 0]], [1, 0, [0, 1]]]) {
        gl.bindFramebuffer(gl.FRAMEBUFFER, this.contacts[to].target);
        gl.bindTexture(gl.TEXTURE_2D, this.contacts[from].texture);
        use(this.programs.blur, { along });
        gl.drawArrays(gl.TRIANGLES, 0, 3);
      }
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.viewport(0, 0, width, height);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.bindTexture(gl.TEXTURE_2D, this.contacts[0].texture);
      use(this.programs.ground, { there: shown.ground ? 1 : 0 });
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      // the rest shape stands behind the bodies
      if (shown.ghost && !shown.cut) {
        gl.enable(gl.BLEND);
        gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
        gl.enable(gl.CULL_FACE);
        use(this.programs.ghost, { away: 0 });
        shape(this.rest);
        gl.disable(gl.CULL_FACE);
        gl.disable(gl.BLEND);
      }
      gl.enable(gl.DEPTH_TEST);
      gl.bindTexture(gl.TEXTURE_2D, this.map);
      use(this.programs.surface, { away: 0, gloss: 0.16, cut });
      gl.enable(gl.POLYGON_OFFSET_FILL);
      gl.polygonOffset(1, 1);
      shape(this.body);
      gl.disable(gl.POLYGON_OFFSET_FILL);
      use(this.programs.surface, { away: 0, gloss: -1, cut: uncut });
      shape(this.inside);
      use(this.programs.surface, { away: 0, gloss: 0.16, cut: uncut });
      shape(this.parts);
      tools(false);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
      if (this.stretches.length) {
        gl.enable(gl.CULL_FACE);
        use(this.programs.glass, { away: 0, opacity: 0 });
        tools(true);
        // forces of tools act within them
        gl.depthFunc(gl.GREATER);
        use(this.programs.glass, { away: 0, opacity: 0.7 });
        shape(this.parts, this.arrows);
        gl.depthFunc(gl.LESS);
        gl.disable(gl.CULL_FACE);
      }
      if (shown.mesh) this.lines(use, cut);
      gl.depthMask(true);
      gl.disable(gl.BLEND);
    }

    // direction of sight through a place of the canvas, 0 to 1 from left to right and from top to bottom
    ray(x, y) {
      const { forward, right, up } = this.sight;
      return add(add(forward, right, 2 * x - 1), up, 1 - 2 * y);
    }

    // what is seen there: the body and the value
    under(x, y) {
      const { run } = this, frame = run.frames[this.frame], skin = run.skins[this.skin];
      const field = run.fields.findIndex((f) => f.name === shown.field);
      if (!this.sight || !skin) return null;
      const { eye } = this.sight, ray = this.ray(x, y);
      const { low, step } = run, places = frame.places, { open } = this;
      const onSkin = (v) => { const i = 3 * skin.source[v]; return [0, 1, 2].map((k) => low[k] + step[k] * places[i + k]); };
      const left = (far) => !shown.cut || dot(add(eye, ray, far), shown.cut) <= shown.cut[3];
      const outside = firstMet(eye, ray, skin.index, onSkin, left);
      const inside = firstMet(eye, ray, open.index, (v) => open.places[v]);
      const found = inside && !(outside?.far <= inside.far) ? inside : outside;
      if (!found) return null;
      const body = run.bodies[found === inside ? open.bodies[found.v[0]] : skin.body[found.v[0]]];
      if (field < 0) return { body };
      const { range, unit, label } = run.fields[field], values = frame.values[field];
      const byteOf = (v) => (found === inside ? open.bytes[v] : values[skin.source[v]]);
      const byte = found.v.reduce((sum, v, k) => sum + found.weights[k] * byteOf(v), 0);
      return { body, label, unit, value: range[0] + (range[1] - range[0]) * byte / 255, end: byte >= 254.5 };
    }

    lines(use, cut) {
      const gl = this.gl, skin = this.run.skins[this.skin];
      if (!skin.lines) {
        const seen = new Set(), out = [];
        for (let t = 0; t < skin.index.length; t += 3) {
          for (let k = 0; k < 3; k++) {
            const a = skin.index[t + k], b = skin.index[t + (k + 1) % 3];
            const p = skin.source[a], q = skin.source[b], name = p < q ? p * 2 ** 26 + q : q * 2 ** 26 + p;
            if (!seen.has(name)) { seen.add(name); out.push(a, b); }
          }
        }
        skin.lines = new Uint32Array(out);
      }
      use(this.programs.line, { away: 0, cut });
      gl.bindVertexArray(this.body.array);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.body.lines);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, skin.lines, gl.DYNAMIC_DRAW);
      gl.drawElements(gl.LINES, skin.lines.length, gl.UNSIGNED_INT, 0);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.body.index);
      gl.bindVertexArray(null);
    }
  }

  // ---- the camera's hand

  // one finger or the left button turns, two fingers or the right button move, wheel and pinch zoom
  function gestures(canvas, { hover, turned, reset }) {
    const down = new Map();
    const spread = () => {
      const [a, b] = [...down.values()];
      return { gap: Math.hypot(a.x - b.x, a.y - b.y), x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
    };
    canvas.oncontextmenu = (e) => e.preventDefault();
    canvas.ondblclick = reset;
    canvas.onpointerdown = (e) => {
      canvas.setPointerCapture(e.pointerId);
      down.set(e.pointerId, { x: e.clientX, y: e.clientY, pan: e.button !== 0 || e.shiftKey });
    };
    canvas.onpointerup = canvas.onpointercancel = (e) => down.delete(e.pointerId);
    canvas.onpointermove = (e) => {
      const own = down.get(e.pointerId);
      if (!own) { hover(e); return; }
      const old = down.size > 1 ? spread() : null;
      const dx = e.clientX - own.x, dy = e.clientY - own.y, reach = 0.5 / canvas.clientHeight;
      Object.assign(own, { x: e.clientX, y: e.clientY });
      if (old) {
        const now = spread();
        camera.zoom = Math.max(0.05, Math.min(8, camera.zoom * old.gap / Math.max(now.gap, 1)));
        camera.shift = [camera.shift[0] - (now.x - old.x) * reach, camera.shift[1] + (now.y - old.y) * reach];
      } else if (own.pan) {
        camera.shift = [camera.shift[0] - dx * reach, camera.shift[1] + dy * reach];
      } else {
        camera.azimuth += dx * 0.4;
        camera.elevation = Math.max(-89, Math.min(89, camera.elevation + dy * 0.4));
      }
      turned();
    };
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      camera.zoom = Math.max(0.05, Math.min(8, camera.zoom * Math.exp(0.0012 * e.deltaY)));
      turned();
    }, { passive: false });
  }

  // ---- numbers

  function ticks(low, high, count) {
    const raw = (high - low) / count;
    if (!(raw > 0)) return [low];
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 2.5, 5, 10].map((f) => f * power).find((s) => s >= 0.85 * raw) || 10 * power;
    const out = [];
    for (let i = Math.ceil(low / step - 1e-6); i <= Math.floor(high / step + 1e-6); i++) out.push(i * step);
    return out;
  }

  function unitOf(name, largest) {
    const steps = { m: [[1, "m"], [1e2, "cm"], [1e3, "mm"], [1e6, "µm"]],
      Pa: [[1e-6, "MPa"], [1e-3, "kPa"], [1, "Pa"], [1e3, "mPa"]],
      N: [[1e-3, "kN"], [1, "N"], [1e3, "mN"], [1e6, "µN"]],
      "J/m³": [[1e-6, "MJ/m³"], [1e-3, "kJ/m³"], [1, "J/m³"], [1e3, "mJ/m³"]] }[name];
    return steps ? steps.find(([f]) => largest * f >= 0.9995) || steps.at(-1) : [1, name];
  }

  // three digits, as in captions
  function withUnit(value, name) {
    if (value === 0) return `0 ${name}`;
    const [factor, unitName] = unitOf(name, Math.abs(value)), x = value * factor;
    const digits = Math.max(0, Math.min(2, 2 - Math.floor(Math.log10(Math.max(Math.abs(x), 1)))));
    const text = Math.abs(x) < 0.01 ? String(Number(x.toPrecision(3))) : x.toFixed(digits);
    return `${text} ${unitName}`.replace("-", "−");
  }
