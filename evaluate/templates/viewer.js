"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const json = (id) => JSON.parse(byId(id).textContent);
  const headers = json("viewer-clips");
  if (!headers.length) return;

  async function inflate(id) {
    const text = byId(id).textContent.trim();
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  }

  /* Inverse of evaluate/viewer.py: planes of zigzag-coded second differences -> uint16 positions. */
  function integrate(bytes, offset, frames, vertices, reference) {
    const size = frames * vertices * 3;
    const out = new Uint16Array(size);
    const velocity = new Uint16Array(vertices * 3);
    for (let f = 0, at = offset; f < frames; f++) {
      for (let c = 0; c < 3; c++) {
        let previous = 0;
        for (let v = 0; v < vertices; v++, at++) {
          const code = bytes[at] | (bytes[at + size] << 8);
          const change = (code >>> 1) ^ -(code & 1);
          const to = v * 3 + c;
          const here = f * vertices * 3 + to;
          if (f === 0) {
            previous = (previous + change) & 0xffff;
            out[here] = previous;
          } else {
            velocity[to] = f === 1 ? change : velocity[to] + change;
            out[here] = out[here - vertices * 3] + velocity[to];
          }
        }
      }
    }
    if (reference) for (let i = 0; i < size; i++) out[i] += reference[i];
    return out;
  }

  async function loadClip(index) {
    const header = headers[index];
    const buffer = await inflate(`viewer-clip-${index}`);
    const faceBytes = header.faces * 12;
    const transformBytes = header.frames * header.joints * 48;
    const bytes = new Uint8Array(buffer, faceBytes + transformBytes);
    const meshes = [];
    const stride = header.frames * header.vertices * 3 * 2;
    header.meshes.forEach((_, m) => {
      meshes.push(integrate(bytes, m * stride, header.frames, header.vertices, meshes[0]));
    });
    return {
      header, meshes,
      faces: new Uint32Array(buffer, 0, header.faces * 3),
      transforms: new Float32Array(buffer, faceBytes, header.frames * header.joints * 12),
    };
  }

  async function loadBody() {
    if (!byId("viewer-body")) return null;
    const header = json("viewer-body-header");
    const buffer = await inflate("viewer-body");
    const { vertices, faces, influences } = header;
    let at = vertices * 12;
    const rest = new Float32Array(buffer, 0, vertices * 3);
    const indices = new Uint32Array(buffer, at, faces * 3);
    at += faces * 12;
    const weights = new Uint8Array(buffer, at, vertices * influences);
    const joints = new Uint8Array(buffer, at + vertices * influences, vertices * influences);
    return { rest, faces: indices, weights, joints, influences, vertices };
  }

  /* Playing blends between the frames that are stored; scrubbing shows the frames themselves. */
  function between(clip, frame) {
    const first = Math.floor(frame), next = Math.min(first + 1, clip.header.frames - 1);
    return { first, next, share: frame - first };
  }

  function positions(clip, mesh, frame) {
    const { vertices, origin, quantum } = clip.header;
    const { first, next, share } = between(clip, frame);
    const values = clip.meshes[mesh], size = vertices * 3;
    const out = new Float32Array(size);
    for (let i = 0; i < size; i++) {
      const a = values[first * size + i], b = values[next * size + i];
      out[i] = (a + share * (b - a)) * quantum + origin[i % 3];
    }
    return out;
  }

  function poseBody(body, clip, frame) {
    const out = new Float32Array(body.vertices * 3);
    const size = clip.header.joints * 12, { first, next, share } = between(clip, frame);
    const T = new Float32Array(size);
    for (let i = 0; i < size; i++) {
      const a = clip.transforms[first * size + i], b = clip.transforms[next * size + i];
      T[i] = a + share * (b - a);
    }
    for (let v = 0; v < body.vertices; v++) {
      const x = body.rest[v * 3], y = body.rest[v * 3 + 1], z = body.rest[v * 3 + 2];
      let total = 0;
      for (let k = 0; k < body.influences; k++) {
        const w = body.weights[v * body.influences + k];
        if (!w) continue;
        total += w;
        const j = body.joints[v * body.influences + k] * 12;
        for (let r = 0; r < 3; r++) {
          const i = j + r * 4;
          out[v * 3 + r] += w * (T[i] * x + T[i + 1] * y + T[i + 2] * z + T[i + 3]);
        }
      }
      for (let r = 0; r < 3; r++) out[v * 3 + r] /= total;
    }
    return out;
  }

  function normals(points, faces) {
    const out = new Float32Array(points.length);
    for (let f = 0; f < faces.length; f += 3) {
      const a = faces[f] * 3, b = faces[f + 1] * 3, c = faces[f + 2] * 3;
      const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
      const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
      const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      for (const i of [a, b, c]) { out[i] += nx; out[i + 1] += ny; out[i + 2] += nz; }
    }
    return out;
  }

  function distances(a, b) {
    const out = new Float32Array(a.length / 3);
    for (let v = 0; v < out.length; v++) {
      out[v] = 1000 * Math.hypot(a[v * 3] - b[v * 3], a[v * 3 + 1] - b[v * 3 + 1], a[v * 3 + 2] - b[v * 3 + 2]);
    }
    return out;
  }

  /* ---- drawing ---- */
  const canvas = byId("viewer-canvas");
  const gl = canvas.getContext("webgl2", { antialias: true });
  let program, attributes, uniforms;
  if (gl) {
    const compile = (type, source) => {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      return shader;
    };
    program = gl.createProgram();
    gl.attachShader(program, compile(gl.VERTEX_SHADER, `#version 300 es
      in vec3 point; in vec3 normal; in float amount;
      uniform mat4 view; out vec3 n; out float a;
      void main() { n = normal; a = amount; gl_Position = view * vec4(point, 1.0); }`));
    gl.attachShader(program, compile(gl.FRAGMENT_SHADER, `#version 300 es
      precision highp float;
      in vec3 n; in float a; out vec4 colour;
      uniform vec3 base; uniform float painted; uniform float lit; uniform vec3 eye;
      vec3 ramp(float t) {
        vec3 low = vec3(0.20, 0.38, 0.62), mid = vec3(0.96, 0.86, 0.50), high = vec3(0.75, 0.12, 0.13);
        return t < 0.5 ? mix(low, mid, t * 2.0) : mix(mid, high, t * 2.0 - 1.0);
      }
      void main() {
        vec3 albedo = painted > 0.5 ? ramp(clamp(a / 100.0, 0.0, 1.0)) : base;
        if (lit < 0.5) { colour = vec4(albedo, 1.0); return; }
        vec3 m = normalize(n);
        if (!gl_FrontFacing) { m = -m; albedo *= 0.62; }
        float key = max(dot(m, normalize(vec3(-0.45, -0.65, 0.75))), 0.0);
        float fill = max(dot(m, normalize(eye)), 0.0);
        colour = vec4(albedo * (0.30 + 0.16 * m.z + 0.46 * key + 0.26 * fill), 1.0);
      }`));
    gl.linkProgram(program);
    gl.useProgram(program);
    const at = (name) => gl.getUniformLocation(program, name);
    uniforms = { view: at("view"), base: at("base"), painted: at("painted"), lit: at("lit"), eye: at("eye") };
    attributes = ["point", "normal", "amount"].map((name) => gl.getAttribLocation(program, name));
    gl.enable(gl.DEPTH_TEST);
  } else {
    byId("viewer-note").textContent = "This browser offers no WebGL 2, so only the numbers move.";
  }
  const buffers = gl && { data: [0, 1, 2].map(() => gl.createBuffer()), index: gl.createBuffer() };

  function upload(points, shading, amount) {
    [points, shading, amount].forEach((values, i) => {
      const at = attributes[i];
      if (at < 0) return;
      if (!values) { gl.disableVertexAttribArray(at); gl.vertexAttrib3f(at, 0, 0, 1); return; }
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers.data[i]);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STREAM_DRAW);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, i === 2 ? 1 : 3, gl.FLOAT, false, 0, 0);
    });
  }

  function drawMesh(points, faces, base, amount) {
    upload(points, normals(points, faces), amount);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers.index);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STREAM_DRAW);
    gl.uniform3fv(uniforms.base, base);
    gl.uniform1f(uniforms.painted, amount ? 1 : 0);
    gl.uniform1f(uniforms.lit, 1);
    gl.drawElements(gl.TRIANGLES, faces.length, gl.UNSIGNED_INT, 0);
  }

  function drawGround(centre, colour) {
    const points = [], reach = 2, step = 0.5;
    const cx = Math.round(centre[0] / step) * step, cy = Math.round(centre[1] / step) * step;
    for (let k = -reach; k <= reach + 1e-6; k += step) {
      points.push(cx + k, cy - reach, 0, cx + k, cy + reach, 0, cx - reach, cy + k, 0, cx + reach, cy + k, 0);
    }
    upload(new Float32Array(points), null, null);
    gl.uniform3fv(uniforms.base, colour);
    gl.uniform1f(uniforms.painted, 0);
    gl.uniform1f(uniforms.lit, 0);
    gl.drawArrays(gl.LINES, 0, points.length / 3);
  }

  const camera = { turn: -0.45, tilt: 0.14, distance: 3.5 };

  /* Column-major projection * view of a camera that orbits a target, Z up. */
  function viewMatrix(target, aspect) {
    const ct = Math.cos(camera.tilt), st = Math.sin(camera.tilt);
    const back = [Math.sin(camera.turn) * ct, -Math.cos(camera.turn) * ct, st];
    const right = [Math.cos(camera.turn), Math.sin(camera.turn), 0];
    const up = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2],
      back[0] * right[1] - back[1] * right[0]];
    const eye = target.map((value, i) => value + back[i] * camera.distance);
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const near = 0.05, far = 30, focal = 1 / Math.tan(0.31);
    const narrow = Math.min(1, aspect / 0.62);
    const sx = focal * narrow / aspect, sy = focal * narrow;
    const z1 = (far + near) / (near - far), z2 = 2 * far * near / (near - far);
    const matrix = new Float32Array(16);
    for (let c = 0; c < 3; c++) {
      matrix[c * 4] = sx * right[c]; matrix[c * 4 + 1] = sy * up[c];
      matrix[c * 4 + 2] = z1 * back[c]; matrix[c * 4 + 3] = -back[c];
    }
    const e = [-dot(right, eye), -dot(up, eye), -dot(back, eye)];
    matrix[12] = sx * e[0]; matrix[13] = sy * e[1]; matrix[14] = z1 * e[2] + z2; matrix[15] = -e[2];
    return { matrix, back };
  }

  function colourOf(name) {
    const text = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    const value = parseInt(text.slice(1), 16);
    return [(value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255];
  }

  /* ---- state and controls ---- */
  const state = { clip: 0, left: 0, right: headers[0].meshes.length - 1, frame: 0, playing: false };
  let current = null, body = null;
  const slider = byId("viewer-frame");

  function draw() {
    if (!current) return;
    const { header } = current;
    const truth = positions(current, 0, state.frame);
    const shown = [state.left, state.right].map((m) => positions(current, m, state.frame));
    const errors = shown.map((points) => distances(points, truth));
    const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
    byId("viewer-number").textContent = Math.round(state.frame) * header.stride;
    byId("viewer-time").textContent = (state.frame / header.fps).toFixed(2);
    ["left", "right"].forEach((side, i) => {
      byId(`viewer-${side}-error`).textContent =
        state[side] === 0 ? "the reference" : `${mean(errors[i]).toFixed(1)} mm from the simulation`;
    });
    slider.value = state.frame;
    if (!gl) return;

    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    const centre = [0, 0, 0.95];
    for (let i = 0; i < truth.length; i += 3) { centre[0] += truth[i] * 3 / truth.length; centre[1] += truth[i + 1] * 3 / truth.length; }
    const panel = colourOf("--panel");
    gl.viewport(0, 0, width, height);
    gl.clearColor(panel[0], panel[1], panel[2], 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const skin = body && byId("viewer-show-body").checked ? poseBody(body, current, state.frame) : null;
    const half = Math.floor(width / 2);
    const { matrix, back } = viewMatrix(centre, half / height);
    gl.uniformMatrix4fv(uniforms.view, false, matrix);
    gl.uniform3fv(uniforms.eye, back);
    shown.forEach((points, side) => {
      gl.viewport(side * half, 0, half, height);
      drawGround(centre, colourOf("--grid"));
      if (skin) drawMesh(skin, body.faces, [0.70, 0.62, 0.56], null);
      const mesh = side === 0 ? state.left : state.right;
      const painted = byId("viewer-paint").checked && mesh !== 0;
      drawMesh(points, current.faces, colourOf(mesh === 0 ? "--simulation" : `--m${current.header.colors[mesh - 1] % 8}`),
        painted ? errors[side] : null);
    });
  }

  function remember() {
    const hash = `#clip=${state.clip}&left=${state.left}&right=${state.right}&frame=${Math.round(state.frame)}`;
    try { history.replaceState(null, "", hash); } catch { /* some browsers refuse on file: pages */ }
  }

  function fill(select, names, chosen) {
    select.replaceChildren(...names.map((name, i) => new Option(name, i, false, i === chosen)));
  }

  async function choose(index) {
    state.clip = index;
    current = null;
    byId("viewer-note").textContent = "unpacking …";
    const clip = await loadClip(index);
    if (state.clip !== index) return;
    current = clip;
    const last = clip.header.meshes.length - 1;
    state.left = Math.min(state.left, last);
    state.right = Math.min(state.right, last);
    state.frame = Math.min(state.frame, clip.header.frames - 1);
    fill(byId("viewer-left"), clip.header.meshes, state.left);
    fill(byId("viewer-right"), clip.header.meshes, state.right);
    slider.max = clip.header.frames - 1;
    byId("viewer-note").textContent = gl ? "drag to turn, wheel or pinch to zoom"
      : "This browser offers no WebGL 2, so only the numbers move.";
    draw();
    canvas.dataset.ready = index;
  }

  /* The mesh of another clip that has the same name; not every method dresses every garment. */
  function counterpart(mesh, from, to) {
    const names = headers[to].meshes, same = names.indexOf(headers[from].meshes[mesh]);
    return same < 0 ? names.length - 1 : same;
  }

  function show(frame) { state.frame = frame; draw(); }

  let before = null;
  function play(now) {
    if (!state.playing) { before = null; return; }
    if (current && before !== null) {
      const next = state.frame + (now - before) / 1000 * current.header.fps;
      show(next > current.header.frames - 1 ? 0 : next);
    }
    before = now;
    requestAnimationFrame(play);
  }

  fill(byId("viewer-clip"), headers.map((h) => `${h.action}: ${h.garment}`), 0);
  byId("viewer-clip").addEventListener("change", (e) => {
    const to = +e.target.value;
    for (const side of ["left", "right"]) state[side] = counterpart(state[side], state.clip, to);
    state.frame = 0;
    choose(to).then(remember);
  });
  for (const side of ["left", "right"]) {
    byId(`viewer-${side}`).addEventListener("change", (e) => { state[side] = +e.target.value; draw(); remember(); });
  }
  slider.addEventListener("input", () => show(+slider.value));
  slider.addEventListener("change", remember);
  byId("viewer-play").addEventListener("click", (e) => {
    state.playing = !state.playing;
    e.target.textContent = state.playing ? "Pause" : "Play";
    if (state.playing) requestAnimationFrame(play);
    else show(Math.round(state.frame));
  });
  for (const id of ["viewer-paint", "viewer-show-body"]) byId(id).addEventListener("change", draw);
  window.addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);

  const pointers = new Map();
  let pinch = 0;
  canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); pointers.set(e.pointerId, e); pinch = 0; });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => { pointers.delete(e.pointerId); pinch = 0; });
  canvas.addEventListener("pointermove", (e) => {
    const last = pointers.get(e.pointerId);
    if (!last) return;
    if (pointers.size === 1) {
      camera.turn -= (e.clientX - last.clientX) * 0.008;
      camera.tilt = Math.max(-0.3, Math.min(1.4, camera.tilt + (e.clientY - last.clientY) * 0.006));
    }
    pointers.set(e.pointerId, e);
    if (pointers.size === 2) {
      const [a, b] = [...pointers.values()];
      const gap = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
      if (pinch) zoom(pinch / gap);
      pinch = gap;
    }
    draw();
  });
  function zoom(factor) { camera.distance = Math.max(0.6, Math.min(8, camera.distance * factor)); }
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(e.deltaY * 0.001)); draw(); }, { passive: false });

  function followHash() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    const read = (name, most, fallback) => {
      const value = parseInt(wanted.get(name), 10);
      return value >= 0 && value <= most ? value : fallback;
    };
    const clip = read("clip", headers.length - 1, state.clip);
    state.left = read("left", headers[clip].meshes.length - 1, state.left);
    state.right = read("right", headers[clip].meshes.length - 1, state.right);
    state.frame = read("frame", headers[clip].frames - 1, state.frame);
    byId("viewer-clip").value = clip;
    return choose(clip);
  }
  window.addEventListener("hashchange", followHash);
  followHash();
  loadBody().then((loaded) => { body = loaded; draw(); });
})();
