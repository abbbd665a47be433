// A worker that holds the cloth of one character: a question in, an answer out, in the same order.
import { makeRuntime } from "./runtime.js";

let runtime, toScene;

const ANSWERS = {
  async open({ wasm, outfit, inverseAxes }) {
    runtime = await makeRuntime(wasm, outfit);
    toScene = inverseAxes;
    const { joints, garments, cages } = runtime;
    return { joints, garments, cages, corners: runtime.cageCorners() };
  },
  start({ joints }) {
    runtime.start(joints);
    return {};
  },
  step({ joints, seconds }) {
    const begun = performance.now();
    runtime.step(joints, seconds);
    const stepped = performance.now();
    const vertices = runtime.garments.map((_, garment) => placed(runtime.vertices(garment)));
    const cages = placed(runtime.cageVertices());
    return { vertices, cages, parts: { cloth: stepped - begun, vertices: performance.now() - stepped } };
  },
  world({ wind, gravity }) {
    runtime.setWorld(wind, gravity);
    return {};
  },
  fabrics({ factors }) {
    factors.forEach((each, garment) => runtime.setFabric(garment, ...each));
    return {};
  },
};

/** Vertices in the scene's axes and unit: 3 N numbers, rounded for the graphics card. */
function placed(vertices) {
  const out = new Float32Array(vertices.length);
  for (let i = 0; i < out.length; i += 3) {
    const x = vertices[i], y = vertices[i + 1], z = vertices[i + 2];
    for (let row = 0; row < 3; row++)
      out[i + row] = toScene[row] * x + toScene[4 + row] * y + toScene[8 + row] * z;
  }
  return out;
}

onmessage = async ({ data }) => {
  try {
    const answer = await ANSWERS[data.kind](data);
    postMessage({ id: data.id, ...answer }, answer.vertices ? [...answer.vertices, answer.cages].map((each) => each.buffer) : []);
  } catch (error) {
    postMessage({ id: data.id, error: error.message });
  }
};
