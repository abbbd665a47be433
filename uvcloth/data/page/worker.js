// A worker that holds the cloth of one character: a question in, an answer out, in the same order.
import { makeRuntime, placed } from "./runtime.js";

let runtime, toScene, rested; // rested: where it came to rest last, and what it remembered then

const ANSWERS = {
  async open({ wasm, outfit, inverseAxes }) {
    runtime = await makeRuntime(wasm, outfit);
    toScene = inverseAxes;
    const { joints, garments, cages } = runtime;
    return { joints, garments, cages, corners: runtime.cageCorners() };
  },
  start({ joints }) {
    if (rested?.joints.every((number, index) => number === joints[index])) {
      runtime.restore(rested.saved);
    } else {
      runtime.start(joints);
      rested = { joints, saved: runtime.save() };
    }
    return {};
  },
  step({ joints, seconds }) {
    const begun = performance.now();
    runtime.step(joints, seconds);
    const stepped = performance.now();
    const vertices = runtime.garments.map((_, garment) => placed(runtime.vertices(garment), toScene));
    const cages = placed(runtime.cageVertices(), toScene);
    return { vertices, cages, parts: { cloth: stepped - begun, vertices: performance.now() - stepped } };
  },
  world({ wind, gravity }) {
    rested = null;
    runtime.setWorld(wind, gravity);
    return {};
  },
  fabrics({ factors }) {
    rested = null;
    factors.forEach((each, garment) => runtime.setFabric(garment, ...each));
    return {};
  },
};

onmessage = async ({ data }) => {
  try {
    const answer = await ANSWERS[data.kind](data);
    postMessage({ id: data.id, ...answer }, answer.vertices ? [...answer.vertices, answer.cages].map((each) => each.buffer) : []);
  } catch (error) {
    postMessage({ id: data.id, error: error.message });
  }
};
