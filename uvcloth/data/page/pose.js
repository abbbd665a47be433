// A rig that follows the pose, PBNS or DeePSD: a perceptron turns the turns of the joints into weights of blend shapes.
import { readArrays } from "./arrays.js";
import { bytesOf } from "./files.js";
import { Layer, positive } from "./perceptron.js";
import { placed } from "./runtime.js";
import { Skin } from "./skinning.js";
import { Matrix4, Quaternion } from "./three.min.js";

/** Read a rig for the garments of cloth. */
export async function readPose(file, { bones, garments, inverseAxes }) {
  const { header, arrays } = await readArrays(await bytesOf(file)), { sizes } = header;
  if (arrays.parents.length !== bones.length || sizes.length !== garments.length || sizes.some((size, index) => size !== garments[index].size))
    throw new Error("its rig is of other garments");
  return new PoseRig(header, arrays, inverseAxes);
}

/** A source for panes. It remembers nothing. */
class PoseRig {
  constructor({ sizes, layers, sumToOne }, arrays, inverseAxes) {
    const { rest, owner, joints, weights, shapes, parents } = arrays;
    Object.assign(this, { sizes, sumToOne, owner, shapes, parents, inverseAxes, isStateless: true });
    this.layers = Array.from({ length: layers }, (_, index) => new Layer(arrays[`${index}.weight`], arrays[`${index}.bias`]));
    this.skin = new Skin(Float64Array.from(rest), joints, weights);
    this.moves = new Float64Array(3 * owner.reduce((most, point) => Math.max(most, point + 1), 0));
    this.points = new Float64Array(rest.length);
  }

  start() {}

  step(transforms) {
    const begun = performance.now(), all = placed(this.#posed(transforms), this.inverseAxes);
    let first = 0;
    const vertices = this.sizes.map((size) => all.slice(3 * first, 3 * (first += size)));
    return { vertices, parts: { cloth: performance.now() - begun, vertices: 0 } };
  }

  #posed(transforms) {
    const { owner, shapes, moves, points, skin } = this, size = moves.length;
    moves.fill(0);
    this.#weights(poseVector(transforms, this.parents)).forEach((weight, shape) => {
      if (weight) for (let i = 0, k = shape * size; i < size; i++, k++) moves[i] += weight * shapes[k];
    });
    owner.forEach((point, vertex) => {
      for (let row = 0; row < 3; row++) points[3 * vertex + row] = skin.points[3 * vertex + row] + moves[3 * point + row];
    });
    return skin.moved(transforms, points);
  }

  #weights(pose) {
    const keys = this.layers.reduce((values, layer) => positive(layer.of(values)), pose);
    const sum = keys.reduce((a, b) => a + b, 0);
    return this.sumToOne && sum > 0 ? keys.map((key) => key / sum) : keys;
  }
}

/** Axis times angle of each joint's turn from its parent, and in place of the root's the way down in its axes; see
 * uvcloth.methods.rig.pose_vectors. */
function poseVector(transforms, parents) {
  const out = new Float64Array(3 * parents.length);
  const turns = Array.from(parents, (_, joint) => {
    const [a, b, c, , d, e, f, , g, h, i] = transforms.subarray(12 * joint, 12 * joint + 11);
    return new Quaternion().setFromRotationMatrix(new Matrix4().set(a, b, c, 0, d, e, f, 0, g, h, i, 0, 0, 0, 0, 1));
  });
  parents.forEach((parent, joint) => {
    if (parent < 0) return out.set([8, 9, 10].map((k) => -transforms[12 * joint + k]), 3 * joint);
    const { x, y, z, w } = turns[parent].clone().invert().multiply(turns[joint]), sine = Math.hypot(x, y, z) * Math.sign(w || 1);
    const scale = sine ? (2 * Math.atan2(Math.abs(sine), Math.abs(w))) / sine : 0;
    out.set([scale * x, scale * y, scale * z], 3 * joint);
  });
  return out;
}
