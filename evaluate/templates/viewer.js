"use strict";
(async () => {
  const byId = (id) => document.getElementById(id);
  const THREE = await import(URL.createObjectURL(new Blob([byId("three").textContent], { type: "text/javascript" })));
  const json = (id) => JSON.parse(byId(id).textContent);
  const headers = json("viewer-clips");

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

  async function loadBody(index) {
    const header = json(`viewer-body-header-${index}`);
    const buffer = await inflate(`viewer-body-${index}`);
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

  /* World positions of a mesh of a clip, written to `out`. */
  function positions(clip, mesh, frame, out) {
    const { vertices, origin, quantum } = clip.header;
    const { first, next, share } = between(clip, frame);
    const values = clip.meshes[mesh], size = vertices * 3;
    for (let i = 0; i < size; i++) {
      const a = values[first * size + i], b = values[next * size + i];
      out[i] = (a + share * (b - a)) * quantum + origin[i % 3];
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

  /* ---- the stage: Z up, both sides in one scene, drawn one after the other ---- */
  const canvas = byId("viewer-canvas");
  const SKIN = "#b39e8f", BACK = 0.62, HOTTEST = 100;
  const RAMP = ["#33619e", "#f5db80", "#bf1f21"].map((text) => new THREE.Color(text));

  function colourOf(name) {
    return new THREE.Color(getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  }

  function createRenderer() {
    try {
      return new THREE.WebGLRenderer({ canvas, antialias: true });
    } catch {
      return null;
    }
  }

  const renderer = createRenderer();
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(35.5, 1, 0.05, 30);
  camera.up.set(0, 0, 1);
  camera.position.set(-1.51, -3.12, 0.49);
  const orbit = new THREE.OrbitControls(camera, canvas);
  Object.assign(orbit, { enablePan: false, minDistance: 0.6, maxDistance: 8, minPolarAngle: 0.17, maxPolarAngle: 1.87 });
  orbit.update();

  const ground = new THREE.GridHelper(4, 8, "white", "white");
  ground.rotation.x = Math.PI / 2;
  const sky = new THREE.HemisphereLight("white", "#8c8c8c", 1.3);
  sky.position.set(0, 0, 1);
  const key = new THREE.DirectionalLight("white", 1.5);
  key.position.set(-0.45, -0.65, 0.75);
  const headlight = new THREE.DirectionalLight("white", 0.8);
  scene.add(ground, sky, key, headlight);

  /* A surface with a darker inside. */
  class Cloth {
    constructor(geometry) {
      this.front = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial());
      this.back = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ side: THREE.BackSide }));
      for (const mesh of [this.front, this.back]) { mesh.frustumCulled = false; scene.add(mesh); }
    }

    remove() {
      for (const mesh of [this.front, this.back]) { scene.remove(mesh); mesh.material.dispose(); }
      this.front.geometry.dispose();
    }

    set visible(shown) { this.front.visible = this.back.visible = shown; }

    paint(colour, errors) {
      const { geometry } = this.front;
      if (errors) {
        const colours = geometry.getAttribute("color"), mixed = new THREE.Color();
        errors.forEach((error, v) => {
          const t = Math.min(error / HOTTEST, 1) * 2, low = t < 1 ? 0 : 1;
          mixed.lerpColors(RAMP[low], RAMP[low + 1], t - low);
          colours.setXYZ(v, mixed.r, mixed.g, mixed.b);
        });
        colours.needsUpdate = true;
      }
      for (const [mesh, share] of [[this.front, 1], [this.back, BACK]]) {
        if (mesh.material.vertexColors !== !!errors) {
          mesh.material.vertexColors = !!errors;
          mesh.material.needsUpdate = true;
        }
        mesh.material.color.copy(errors ? new THREE.Color("white") : colour).multiplyScalar(share);
      }
    }

    moved() {
      const { geometry } = this.front;
      geometry.getAttribute("position").needsUpdate = true;
      geometry.computeVertexNormals();
    }
  }

  function clothOf(clip) {
    const { vertices } = clip.header;
    const geometry = new THREE.BufferGeometry();
    for (const name of ["position", "color"]) {
      geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(vertices * 3), 3));
    }
    geometry.setIndex(new THREE.BufferAttribute(clip.faces, 1));
    return new Cloth(geometry);
  }

  function skinnedBody(body, joints) {
    const indices = new Uint16Array(body.vertices * 4), weights = new Float32Array(body.vertices * 4);
    for (let v = 0; v < body.vertices; v++) {
      for (let k = 0; k < body.influences; k++) {
        indices[v * 4 + k] = body.joints[v * body.influences + k];
        weights[v * 4 + k] = body.weights[v * body.influences + k] / 255;
      }
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(body.rest, 3));
    geometry.setAttribute("skinIndex", new THREE.BufferAttribute(indices, 4));
    geometry.setAttribute("skinWeight", new THREE.BufferAttribute(weights, 4));
    geometry.setIndex(new THREE.BufferAttribute(body.faces, 1));
    geometry.computeVertexNormals();
    const mesh = new THREE.SkinnedMesh(geometry, new THREE.MeshLambertMaterial({ color: SKIN }));
    mesh.normalizeSkinWeights();
    mesh.frustumCulled = false;
    // Transforms go from rest to pose already, so the bind matrices are identities.
    const bones = Array.from({ length: joints }, () => new THREE.Bone());
    mesh.bind(new THREE.Skeleton(bones, bones.map(() => new THREE.Matrix4())), new THREE.Matrix4());
    scene.add(mesh);
    return mesh;
  }

  /* The body of a clip, or null while it is unpacked, after which the page is drawn again. */
  function bodyOf(header) {
    if (!(header.body in bodies)) {
      bodies[header.body] = null;
      loadBody(header.body).then((loaded) => { bodies[header.body] = skinnedBody(loaded, header.joints); draw(); });
    }
    return bodies[header.body];
  }

  function poseBody(mesh, clip, frame) {
    const { first, next, share } = between(clip, frame);
    const size = clip.header.joints * 12, T = clip.transforms;
    const at = (i) => T[first * size + i] + share * (T[next * size + i] - T[first * size + i]);
    mesh.skeleton.bones.forEach((bone, j) => {
      bone.matrixWorld.set(...Array.from({ length: 12 }, (_, i) => at(j * 12 + i)), 0, 0, 0, 1);
    });
  }

  /* Move the camera with the cloth. */
  function follow(centre) {
    camera.position.add(centre).sub(orbit.target);
    orbit.target.copy(centre);
    ground.position.set(Math.round(centre.x * 2) / 2, Math.round(centre.y * 2) / 2, 0);
    headlight.position.subVectors(camera.position, centre);
  }

  function drawSides() {
    const width = canvas.clientWidth, height = canvas.clientHeight, half = width / 2;
    const ratio = window.devicePixelRatio || 1;
    if (canvas.width !== Math.floor(width * ratio) || canvas.height !== Math.floor(height * ratio)) {
      renderer.setPixelRatio(ratio);
      renderer.setSize(width, height, false);
    }
    renderer.setClearColor(colourOf("--panel"));
    renderer.setScissorTest(true);
    ground.material.color.copy(colourOf("--grid"));
    camera.aspect = half / height;
    camera.zoom = Math.min(1, camera.aspect / 0.62);
    camera.updateProjectionMatrix();
    current.sides.forEach((cloth, side) => {
      current.sides.forEach((each) => { each.visible = each === cloth; });
      renderer.setViewport(side * half, 0, half, height);
      renderer.setScissor(side * half, 0, half, height);
      renderer.render(scene, camera);
    });
  }

  /* ---- state and controls ---- */
  const state = { clip: 0, left: 0, right: headers[0].meshes.length - 1, frame: 0, playing: false };
  const bodies = {};
  let current = null;
  const slider = byId("viewer-frame");

  function draw() {
    if (!current) return;
    const { header, truth, sides } = current;
    positions(current, 0, state.frame, truth);
    byId("viewer-number").textContent = Math.round(state.frame) * header.stride;
    byId("viewer-time").textContent = (state.frame / header.fps).toFixed(2);
    slider.value = state.frame;
    ["left", "right"].forEach((side, i) => {
      const mesh = state[side], cloth = sides[i];
      const points = positions(current, mesh, state.frame, cloth.front.geometry.getAttribute("position").array);
      const errors = distances(points, truth);
      const mean = errors.reduce((sum, value) => sum + value, 0) / errors.length;
      byId(`viewer-${side}-error`).textContent =
        mesh === 0 ? "the reference" : `${mean.toFixed(1)} mm from the simulation`;
      cloth.moved();
      cloth.paint(colourOf(mesh === 0 ? "--simulation" : `--m${header.colors[mesh - 1] % 8}`),
        byId("viewer-paint").checked && mesh !== 0 ? errors : null);
    });
    if (!renderer) return;

    const centre = new THREE.Vector3(0, 0, 0.95);
    for (let i = 0; i < truth.length; i += 3) { centre.x += truth[i] * 3 / truth.length; centre.y += truth[i + 1] * 3 / truth.length; }
    follow(centre);
    const own = bodyOf(header);
    for (const mesh of Object.values(bodies)) if (mesh) mesh.visible = mesh === own && byId("viewer-show-body").checked;
    if (own) poseBody(own, current, state.frame);
    drawSides();
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
    if (current) current.sides.forEach((cloth) => cloth.remove());
    current = null;
    byId("viewer-note").textContent = "unpacking …";
    const clip = await loadClip(index);
    if (state.clip !== index || current) return;
    current = { ...clip, truth: new Float32Array(clip.header.vertices * 3), sides: [clothOf(clip), clothOf(clip)] };
    const last = clip.header.meshes.length - 1;
    state.left = Math.min(state.left, last);
    state.right = Math.min(state.right, last);
    state.frame = Math.min(state.frame, clip.header.frames - 1);
    fill(byId("viewer-left"), clip.header.meshes, state.left);
    fill(byId("viewer-right"), clip.header.meshes, state.right);
    slider.max = clip.header.frames - 1;
    byId("viewer-note").textContent = renderer ? "drag to turn, wheel or pinch to zoom"
      : "This browser has no WebGL 2: only the numbers are shown.";
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

  orbit.addEventListener("change", draw);

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
})();
