// Errors of methods against a stored simulation: the mean distance of their vertices, in mm, frame by frame.

const MILLIMETRES = 1000;

export class Errors {
  /** truth: stored frames. warmUp: its frames at the beginning that do not count. cloth: whose axes vertices have. */
  constructor(truth, warmUp, { axes }) {
    Object.assign(this, { truth, warmUp, axes, frames: truth.count, curves: new Map() });
  }

  /** The errors of a method in each frame of the animation, NaN where it has none yet. */
  curve(method) {
    if (!this.curves.has(method)) this.curves.set(method, new Float32Array(this.frames).fill(NaN));
    return this.curves.get(method);
  }

  /** Measure the vertices of a method in the scene, where the figure is at {frame, place}. */
  measure(method, vertices, { frame, place }) {
    const { axes } = this, back = place.clone().invert(), points = new Float64Array(vertices.length);
    const { elements: e } = back;
    for (let i = 0; i < points.length; i += 3) {
      const [x, y, z] = vertices.subarray(i, i + 3);
      const p = e[0] * x + e[4] * y + e[8] * z + e[12], q = e[1] * x + e[5] * y + e[9] * z + e[13], r = e[2] * x + e[6] * y + e[10] * z + e[14];
      for (let row = 0; row < 3; row++) points[i + row] = axes[row] * p + axes[4 + row] * q + axes[8 + row] * r;
    }
    this.curve(method)[frame] = this.#distance(frame, points);
  }

  /** Measure all frames of a method that has them stored. */
  measureStored(method, stored) {
    for (let frame = 0; frame < this.frames; frame++) {
      const points = stored.vertices(frame);
      if (points) this.curve(method)[frame] = this.#distance(frame, points);
    }
  }

  /** Mean of a method over the frames that count, and how many of them it has: {mean, share}. */
  mean(method) {
    const values = this.curve(method).subarray(this.warmUp).filter((error) => !Number.isNaN(error));
    return { mean: values.reduce((sum, each) => sum + each, 0) / values.length, share: values.length / (this.frames - this.warmUp) };
  }

  #distance(frame, points) {
    const truth = this.truth.vertices(frame);
    let sum = 0;
    for (let i = 0; i < points.length; i += 3) sum += Math.hypot(points[i] - truth[i], points[i + 1] - truth[i + 1], points[i + 2] - truth[i + 2]);
    return (MILLIMETRES * sum) / (points.length / 3);
  }
}
