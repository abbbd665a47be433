// A recurrent rig: a gated recurrent unit turns the body's motion into weights of blend shapes.
import { readArrays } from "./arrays.js";
import { bytesOf } from "./files.js";
import { Layer, positive } from "./perceptron.js";
import { placed } from "./runtime.js";
import { Skin } from "./skinning.js";

/** Read a rig for the garments of cloth. */
export async function readRecurrent(file, { bones, garments, inverseAxes }) {
  const { header, arrays } = await readArrays(await bytesOf(file));
  const rigs = Array.from({ length: header.garments }, (_, index) => {
    const own = Object.entries(arrays).filter(([name]) => name.startsWith(`${index}.`));
    return new RecurrentGarment(Object.fromEntries(own.map(([name, values]) => [name.slice(2), values])), header, header.memory[index]);
  });
  if (arrays.heads.length !== 3 * bones.length || rigs.length !== garments.length || rigs.some(({ skin }, index) => skin.points.length !== 3 * garments[index].size))
    throw new Error("its recurrent rig is of other garments");
  return new RecurrentRig(rigs, arrays.heads, header, inverseAxes);
}

/** A source for panes. heads: of the joints at rest, m. */
class RecurrentRig {
  constructor(rigs, heads, { gravity, tick }, inverseAxes) {
    Object.assign(this, { rigs, heads, gravity, tick, inverseAxes });
  }

  /** Let it remember a body that has stood still. */
  start(joints) {
    this.last = [joints, joints];
    const still = bodyMotion([joints, joints, joints], this.heads, 1 / this.tick, this.gravity);
    for (const rig of this.rigs) rig.rest(still);
  }

  step(joints, seconds) {
    const begun = performance.now(), motion = bodyMotion([...this.last, joints], this.heads, 1 / seconds, this.gravity);
    this.last = [this.last[1], joints];
    const vertices = this.rigs.map((rig) => placed(rig.posed(rig.step(motion, seconds / this.tick), joints), this.inverseAxes));
    return { vertices, parts: { cloth: performance.now() - begun, vertices: 0 } };
  }
}

/** One garment of the rig, with its network and its memory. Letters: C numbers of motion, W width, K shapes, n vertices of
 * the cage, N of the garment. */
class RecurrentGarment {
  constructor(arrays, { strangest, stillSteps }, hasMemory) {
    const whole = (name) => widened(arrays[name], arrays[`${name}.rows`]);
    this.layers = Object.fromEntries(
      [["motion", "motion"], ["enter", "enter.2"], ["leave", "leave.0"], ["weights", "leave.2"]].map(([layer, name]) => [layer, new Layer(whole(`${name}.weight`), arrays[`${name}.bias`])]),
    );
    this.given = new Layer(whole("unit.weight_ih_l0"), arrays["unit.bias_ih_l0"]);
    this.kept = new Layer(whole("unit.weight_hh_l0"), arrays["unit.bias_hh_l0"]);
    const { center, spread, corners, shares, rest, joints, weights } = arrays;
    Object.assign(this, { center, spread, corners, shares, shapes: whole("shapes"), strangest, stillSteps, hasMemory });
    this.skin = new Skin(Float64Array.from(rest), joints, weights);
    this.around = corners.length / (rest.length / 3);
    this.cage = new Float64Array(this.shapes.length / this.layers.weights.bias.length);
    this.points = new Float64Array(rest.length);
  }

  /** Forget all, and remember a body that stands still. */
  rest(motion) {
    this.hidden = new Float64Array(this.kept.bias.length / 3);
    for (let step = 0; this.hasMemory && step < this.stillSteps; step++) this.step(motion, 1);
  }

  /** Weights (K) of the shapes for motion (C), so many ticks after the last ones. */
  step(motion, ticks) {
    const { layers, center, spread, strangest, hidden } = this, width = hidden.length;
    const inputs = motion.map((value, index) => Math.min(strangest, Math.max(-strangest, (value - center[index]) / spread[index])));
    const entered = positive(layers.enter.of(positive(layers.motion.of(inputs))));
    if (this.hasMemory) {
      const given = this.given.of(entered), kept = this.kept.of(hidden);
      this.hidden = hidden.map((before, i) => {
        const reset = sigmoid(given[i] + kept[i]), gate = sigmoid(given[width + i] + kept[width + i]);
        const wanted = Math.tanh(given[2 * width + i] + reset * kept[2 * width + i]);
        return wanted + gate ** ticks * (before - wanted);
      });
    }
    return layers.weights.of(positive(layers.leave.of(Float64Array.of(...entered, ...this.hidden))));
  }

  /** The garment (3 N numbers) with weights (K) of its shapes, on transforms of the joints; the next call overwrites it. */
  posed(weights, transforms) {
    const { cage, shapes, corners, shares, around, points, skin } = this, size = cage.length;
    cage.fill(0);
    weights.forEach((weight, shape) => {
      for (let i = 0; i < size; i++) cage[i] += weight * shapes[shape * size + i];
    });
    for (let vertex = 0; 3 * vertex < points.length; vertex++)
      for (let row = 0; row < 3; row++) {
        let sum = skin.points[3 * vertex + row];
        for (let k = around * vertex; k < around * (vertex + 1); k++) sum += shares[k] * cage[3 * corners[k] + row];
        points[3 * vertex + row] = sum;
      }
    return skin.moved(transforms, points);
  }
}

/** Numbers of eight bits times the scale of their row. */
function widened(numbers, scales) {
  const width = numbers.length / scales.length;
  return Float32Array.from(numbers, (number, index) => number * scales[Math.floor(index / width)]);
}

function sigmoid(value) {
  return 1 / (1 + Math.exp(-value));
}

/** Motion of a body in the axes of its root, from transforms of three frames; see uvcloth.methods.recurrent.body_motion. */
function bodyMotion([oldest, before, now], heads, fps, gravity) {
  const count = heads.length / 3, out = new Float64Array(15 * count + 6), root = now.subarray(0, 12);
  const back = ([x, y, z]) => [0, 1, 2].map((column) => root[column] * x + root[4 + column] * y + root[8 + column] * z);
  const place = (frame, joint) => [0, 4, 8].map((row) => {
    const k = 12 * joint + row;
    return frame[k] * heads[3 * joint] + frame[k + 1] * heads[3 * joint + 1] + frame[k + 2] * heads[3 * joint + 2] + frame[k + 3];
  });
  let rootSpin;
  for (let joint = 0; joint < count; joint++) {
    const [first, second, third] = [oldest, before, now].map((frame) => place(frame, joint));
    const velocity = third.map((value, k) => (value - second[k]) * fps);
    const felt = velocity.map((value, k) => (value - (second[k] - first[k]) * fps) * fps + (k === 2 ? gravity : 0));
    const spin = back(spinOf(now, before, 12 * joint, fps));
    rootSpin ??= spin;
    // Its first two axes as the root has them, row by row.
    const axes = [0, 1].map((column) => back([0, 4, 8].map((row) => now[12 * joint + row + column])));
    out.set([0, 1, 2].flatMap((row) => [axes[0][row], axes[1][row]]), 15 * joint);
    out.set([...spin, ...back(velocity), ...back(felt)], 15 * joint + 6);
  }
  out.set([...back([0, 0, -1]), ...rootSpin], 15 * count);
  return out;
}

/** Angular velocity, radians/s, of a joint whose transform begins at k. */
function spinOf(now, before, k, fps) {
  const dot = (a, b) => now[k + 4 * a] * before[k + 4 * b] + now[k + 4 * a + 1] * before[k + 4 * b + 1] + now[k + 4 * a + 2] * before[k + 4 * b + 2];
  const half = (a, b) => 0.5 * fps * (dot(a, b) - dot(b, a));
  return [half(2, 1), half(0, 2), half(1, 0)];
}
