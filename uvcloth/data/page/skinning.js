// Linear blend skinning in plain JavaScript: garments that follow the joints without any dynamics.
import { placed } from "./runtime.js";

/** Garments at rest moved by joints. points: 3 N numbers. joints: N times K of them. weights: of each, N times K. */
export class Skin {
  constructor(points, joints, weights) {
    Object.assign(this, { points, joints, weights, most: joints.length / (points.length / 3) });
    this.out = new Float64Array(points.length);
  }

  /** The points moved by transforms of the joints, 12 numbers each; the next call overwrites them. */
  moved(transforms, points = this.points) {
    const { joints, weights, most, out } = this, blend = new Float64Array(12);
    for (let vertex = 0; 3 * vertex < points.length; vertex++) {
      blend.fill(0);
      for (let k = most * vertex; k < most * (vertex + 1); k++) {
        const weight = weights[k], first = 12 * joints[k];
        if (weight) for (let i = 0; i < 12; i++) blend[i] += weight * transforms[first + i];
      }
      const x = points[3 * vertex], y = points[3 * vertex + 1], z = points[3 * vertex + 2];
      for (let row = 0; row < 3; row++)
        out[3 * vertex + row] = blend[4 * row] * x + blend[4 * row + 1] * y + blend[4 * row + 2] * z + blend[4 * row + 3];
    }
    return out;
  }
}

/** A source for panes: the garments of a baked file, as its skin moves them. */
export class Skinning {
  constructor({ garments, axes, inverseAxes }) {
    Object.assign(this, { inverseAxes, isStateless: true });
    this.skins = garments.map((garment) => skinOf(garment, axes));
  }

  start() {}

  step(transforms) {
    const begun = performance.now(), vertices = this.skins.map((skin) => placed(skin.moved(transforms), this.inverseAxes));
    return { vertices, parts: { cloth: performance.now() - begun, vertices: 0 } };
  }
}

function skinOf({ meshes: [{ geometry }], vertices, rest, size }, axes) {
  const { skinIndex, skinWeight } = geometry.attributes, joints = new Uint16Array(4 * size), weights = new Float64Array(4 * size);
  vertices.forEach((vertex, index) => {
    for (let k = 0; k < 4; k++) {
      joints[4 * vertex + k] = skinIndex.getComponent(index, k);
      weights[4 * vertex + k] = skinWeight.getComponent(index, k);
    }
    const sum = weights.subarray(4 * vertex, 4 * vertex + 4).reduce((a, b) => a + b);
    for (let k = 0; k < 4; k++) weights[4 * vertex + k] /= sum;
  });
  const points = new Float64Array(3 * size);
  for (let i = 0; i < points.length; i += 3)
    for (let row = 0; row < 3; row++)
      points[i + row] = axes[row] * rest[i] + axes[4 + row] * rest[i + 1] + axes[8 + row] * rest[i + 2];
  return new Skin(points, joints, weights);
}
