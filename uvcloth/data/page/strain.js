// Strain of cloth as colours: the largest principal strain of each face, in the mean around each vertex.
import { BufferAttribute, MeshStandardMaterial } from "./three.min.js";

/** Strains and their colours, linear red, green and blue; page.css has the same as a legend. */
const COLOURS = [
  [-0.05, [0.05, 0.2, 0.75]],
  [0, [0.85, 0.85, 0.82]],
  [0.05, [0.95, 0.6, 0.05]],
  [0.15, [0.65, 0.02, 0.02]],
];
const MATERIAL = { color: "#ffffff", vertexColors: true, roughness: 0.9, side: 2 };

export class StrainMap {
  constructor(garments) {
    this.garments = garments.map((garment) => new Strained(garment));
  }

  set isShown(isShown) {
    for (const { meshes, plain, coloured } of this.garments)
      meshes.forEach((mesh, index) => { mesh.material = isShown ? coloured : plain[index]; });
  }

  /** Colour the garments as they are shown now. */
  update() {
    for (const garment of this.garments) garment.update();
  }
}

class Strained {
  constructor({ meshes, vertices, points, faces, rest, size }) {
    Object.assign(this, { meshes, vertices, points, faces, plain: meshes.map((mesh) => mesh.material) });
    this.coloured = new MeshStandardMaterial(MATERIAL);
    this.inverse = new Float32Array((4 * faces.length) / 3);
    for (let face = 0; face < faces.length / 3; face++) this.inverse.set(inverseOf(sides(rest, faces, face)), 4 * face);
    this.sums = new Float32Array(size);
    this.counts = new Float32Array(size);
    for (const vertex of faces) this.counts[vertex]++;
    for (const mesh of meshes) mesh.geometry.setAttribute("color", new BufferAttribute(new Float32Array(3 * vertices.length), 3));
  }

  update() {
    const { faces, points, inverse, sums, counts, vertices } = this;
    sums.fill(0);
    for (let face = 0; face < faces.length / 3; face++) {
      const strain = largestStrain(sides(points, faces, face), inverse, 4 * face);
      for (let k = 3 * face; k < 3 * face + 3; k++) sums[faces[k]] += strain;
    }
    for (const mesh of this.meshes) {
      const { color } = mesh.geometry.attributes;
      vertices.forEach((vertex, index) => color.array.set(colourOf(sums[vertex] / counts[vertex]), 3 * index));
      color.needsUpdate = true;
    }
  }
}

/** Dot products of the two sides of a face: aa, ab, bb. */
function sides(points, faces, face) {
  const o = 3 * faces[3 * face], a = 3 * faces[3 * face + 1], b = 3 * faces[3 * face + 2], out = [0, 0, 0];
  for (let k = 0; k < 3; k++) {
    const u = points[a + k] - points[o + k], v = points[b + k] - points[o + k];
    out[0] += u * u;
    out[1] += u * v;
    out[2] += v * v;
  }
  return out;
}

/** Inverse, row by row, of the sides at rest in the plane of the face: the first along x. */
function inverseOf([aa, ab, bb]) {
  const length = Math.sqrt(aa), across = Math.sqrt(Math.max(0, bb - (ab * ab) / aa));
  return across > 0 ? [1 / length, -ab / (aa * across), 0, 1 / across] : [0, 0, 0, 0];
}

// The root of the larger eigenvalue of C = R' G R, with G the dot products now and R the inverse at rest, less one.
function largestStrain([aa, ab, bb], inverse, at) {
  const r = inverse[at], s = inverse[at + 1], t = inverse[at + 3];
  const xx = r * r * aa, xy = r * (s * aa + t * ab), yy = s * s * aa + 2 * s * t * ab + t * t * bb;
  if (!(xx > 0)) return 0;
  return Math.sqrt((xx + yy) / 2 + Math.hypot((xx - yy) / 2, xy)) - 1;
}

function colourOf(strain) {
  const upper = COLOURS.findIndex(([limit]) => strain < limit);
  if (upper === 0) return COLOURS[0][1];
  if (upper < 0) return COLOURS.at(-1)[1];
  const [[low, from], [high, to]] = [COLOURS[upper - 1], COLOURS[upper]], share = (strain - low) / (high - low);
  return from.map((value, index) => value + share * (to[index] - value));
}
