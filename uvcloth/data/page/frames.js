// Stored frames of a garment: where a browser cannot compute a method in time, and the simulation that is the truth.
import { readArrays } from "./arrays.js";
import { bytesOf } from "./files.js";
import { placed } from "./runtime.js";
import { Vector3 } from "./three.min.js";

/** Read the frames of a file, for the garment of cloth. */
export async function readFrames(file, { inverseAxes, garments: [garment] }) {
  const { header, arrays } = await readArrays(await bytesOf(file));
  if (header.vertices !== garment.size) throw new Error("its stored frames are of another garment");
  return new StoredFrames(header, unpacked(header, arrays), inverseAxes);
}

/** A source for panes. first: frame of the animation that the first stored one belongs to. */
class StoredFrames {
  constructor({ frames, vertices, first, step }, steps, inverseAxes) {
    Object.assign(this, { count: frames, size: 3 * vertices, first, unit: step, steps, inverseAxes, isStored: true });
  }

  start() {}

  /** The frame of the animation that the figure is in; no vertices where there is none. */
  step(_, __, at) {
    const begun = performance.now(), vertices = at && this.vertices(at.frame);
    if (!vertices) return { vertices: null, parts: { cloth: 0, vertices: 0 } };
    const out = placed(vertices, this.inverseAxes), point = new Vector3();
    for (let i = 0; i < out.length; i += 3) point.fromArray(out, i).applyMatrix4(at.place).toArray(out, i);
    return { vertices: [out], parts: { cloth: 0, vertices: performance.now() - begun } };
  }

  /** Vertices (3 N numbers, m) of a frame of the animation in the runtime's world, null where there are none. */
  vertices(frame) {
    const row = frame - this.first;
    if (row < 0 || row >= this.count) return null;
    return Float64Array.from(this.steps.subarray(row * this.size, (row + 1) * this.size), (number) => number * this.unit);
  }
}

/** Inverse of uvcloth.formats.moving.pack: whole steps of every coordinate, frame after frame. */
function unpacked({ frames, vertices }, { changes, parents, origin }) {
  const numbers = 3 * vertices, high = numbers * frames, out = new Int32Array(high);
  // Second differences in time of a vertex, relative to those of its parent, which comes before it.
  const rows = new Int32Array(high);
  for (const vertex of parentsFirst(parents)) {
    const parent = parents[vertex];
    for (let i = 3 * vertex * frames; i < 3 * (vertex + 1) * frames; i++) {
      const code = changes[i] | (changes[high + i] << 8);
      rows[i] = ((code >>> 1) ^ -(code & 1)) + (parent < vertices ? rows[i + 3 * (parent - vertex) * frames] : 0);
    }
  }
  for (let number = 0; number < numbers; number++) {
    let place = 0, speed = 0;
    for (let frame = 0; frame < frames; frame++) {
      const change = rows[number * frames + frame];
      if (frame === 0) place = change + origin[number % 3];
      else place += speed += change;
      out[frame * numbers + number] = place;
    }
  }
  return out;
}

function parentsFirst(parents) {
  const order = [], isDone = new Uint8Array(parents.length);
  for (let vertex = 0; vertex < parents.length; vertex++) {
    const way = [];
    for (let each = vertex; each < parents.length && !isDone[each]; each = parents[each]) {
      isDone[each] = 1;
      way.push(each);
    }
    order.push(...way.reverse());
  }
  return order;
}
