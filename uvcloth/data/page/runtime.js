// The compiled runtime: the functions of uvcloth.h for one character, with typed arrays instead of addresses.

const ROOM = 160; // bytes of a sentence, as uvcloth.h has it
const VECTOR_MODULE = [
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11,
];

/** Whether this browser runs WebAssembly with 128-bit vectors, which the runtime is compiled for. */
export function hasVectors() {
  return typeof WebAssembly === "object" && WebAssembly.validate(new Uint8Array(VECTOR_MODULE));
}

/** Compile the runtime and read an outfit. Throws an Error with the runtime's sentence if it is damaged. */
export async function makeRuntime(wasm, outfit) {
  const { instance } = await WebAssembly.instantiate(wasm);
  instance.exports._initialize();
  return new Runtime(instance.exports, outfit);
}

class Runtime {
  constructor(core, outfit) {
    this.core = core;
    this.message = core.malloc(ROOM);
    const place = core.malloc(outfit.length);
    this.#bytes(place, outfit.length).set(outfit);
    this.outfit = this.#check(core.uvc_read(place, outfit.length, this.message, ROOM));
    core.free(place);
    this.cloth = core.uvc_new(this.outfit);
    this.joints = core.uvc_joints(this.outfit);
    this.garments = Array.from({ length: core.uvc_garments(this.outfit) }, (_, garment) =>
      core.uvc_garment_vertices(this.outfit, garment),
    );
    this.cages = core.uvc_cages(this.outfit);
    // One piece of memory for all numbers that go in or out, as large as the largest of them.
    this.numbers = core.malloc(8 * Math.max(12 * this.joints, 3 * Math.max(this.cages, ...this.garments), 6));
  }

  /** Let the cloth come to rest on joints (12 J numbers). Takes as long as 65 steps. */
  start(joints) {
    const place = this.#put(joints, 12 * this.joints);
    this.#check(this.core.uvc_start(this.cloth, place, this.message, ROOM));
  }

  step(joints, seconds) {
    const place = this.#put(joints, 12 * this.joints);
    this.#check(this.core.uvc_step(this.cloth, place, seconds, this.message, ROOM));
  }

  /** All that the cloth remembers, bytes for `restore`. */
  save() {
    const size = this.core.uvc_saved_size(this.cloth), place = this.core.malloc(size);
    this.core.uvc_save(this.cloth, place);
    const saved = this.#bytes(place, size).slice();
    this.core.free(place);
    return saved;
  }

  restore(saved) {
    const place = this.core.malloc(saved.length);
    this.#bytes(place, saved.length).set(saved);
    this.core.uvc_restore(this.cloth, place, saved.length);
    this.core.free(place);
  }

  setWorld(wind, gravity) {
    const place = this.#put([...wind, ...gravity], 6);
    this.#check(this.core.uvc_set_world(this.cloth, place, place + 24, this.message, ROOM));
  }

  setFabric(garment, density, stretch, bend) {
    this.#check(this.core.uvc_set_fabric(this.cloth, garment, density, stretch, bend, this.message, ROOM));
  }

  /** The vertices of a garment, 3 N numbers, which the next call overwrites. */
  vertices(garment) {
    this.core.uvc_vertices(this.cloth, garment, this.numbers);
    return new Float64Array(this.core.memory.buffer, this.numbers, 3 * this.garments[garment]);
  }

  /** The vertices of all cages, 3 N numbers, which the next call overwrites. */
  cageVertices() {
    this.core.uvc_cage_vertices(this.cloth, this.numbers);
    return new Float64Array(this.core.memory.buffer, this.numbers, 3 * this.cages);
  }

  /** The corners of the cages' faces, 3 M numbers. */
  cageCorners() {
    const size = 3 * this.core.uvc_cage_faces(this.outfit), place = this.core.malloc(4 * size);
    this.core.uvc_cage_corners(this.outfit, place);
    const corners = new Int32Array(this.core.memory.buffer, place, size).slice();
    this.core.free(place);
    return corners;
  }

  #put(numbers, count) {
    if (numbers.length !== count) throw new Error(`${numbers.length} numbers, expected ${count}`);
    new Float64Array(this.core.memory.buffer, this.numbers, count).set(numbers);
    return this.numbers;
  }

  // The memory moves when it grows, so nobody keeps such a view.
  #bytes(place, size) {
    return new Uint8Array(this.core.memory.buffer, place, size);
  }

  #check(result) {
    if (result) return result;
    const sentence = this.#bytes(this.message, ROOM);
    throw new Error(new TextDecoder().decode(sentence.slice(0, sentence.indexOf(0))));
  }
}

/** Vertices (3 N numbers) in the scene's axes and unit, rounded for the graphics card. toScene: a matrix (4, 4), column
 * after column, of a turn and a scale. */
export function placed(vertices, toScene) {
  const out = new Float32Array(vertices.length);
  for (let i = 0; i < out.length; i += 3) {
    const x = vertices[i], y = vertices[i + 1], z = vertices[i + 2];
    for (let row = 0; row < 3; row++)
      out[i + row] = toScene[row] * x + toScene[4 + row] * y + toScene[8 + row] * z;
  }
  return out;
}
