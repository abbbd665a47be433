// Skin beneath cloth is drawn a little deeper, so that it does not come through between two frames or in creases.
import { BufferAttribute, Matrix4, Vector3 } from "./three.min.js";

const DEPTH = 0.012; // m
const NEAR = 0.06; // m, cloth over skin at rest
const RIM = 0.05; // m from a garment's edge in which the skin comes up to its place

/** Make skin lie deeper beneath the garments that are shown. Returns a function to call when others are. */
export function lowerSkin(figure) {
  const { cloth, scene, unit } = figure, covers = cloth.garments.map((garment) => new Cover(garment, NEAR * unit));
  const own = new Set(cloth.garments.flatMap(({ meshes }) => meshes)), skins = [];
  atRest(figure, () =>
    scene.traverse((mesh) => {
      if (!mesh.isSkinnedMesh || own.has(mesh) || !mesh.geometry.attributes.normal) return;
      const depths = covers.map((cover) => depthsBeneath(cover, mesh, unit));
      if (depths.some((each) => each.some((depth) => depth > 0))) skins.push({ mesh, depths, original: mesh.geometry.attributes.position });
    }),
  );
  const update = () => skins.forEach(({ mesh, depths, original }) => lower(mesh, original, depths.filter((_, index) => cloth.garments[index].isShown)));
  update();
  return update;
}

/** A garment at rest: the nearest of its vertices, and of those of its edges. */
class Cover {
  constructor({ rest, faces }, near) {
    Object.assign(this, { rest, near, cells: new Map() });
    for (let vertex = 0; vertex < rest.length / 3; vertex++) {
      const key = this.#key(...this.#cell(rest[3 * vertex], rest[3 * vertex + 1], rest[3 * vertex + 2]));
      if (!this.cells.has(key)) this.cells.set(key, []);
      this.cells.get(key).push(vertex);
    }
    this.rim = rimOf(faces);
  }

  /** The vertex that is nearest to a point and near it, or -1. */
  nearest(point) {
    const [x, y, z] = this.#cell(point.x, point.y, point.z);
    let least = this.near, nearest = -1;
    for (let i = x - 1; i <= x + 1; i++)
      for (let j = y - 1; j <= y + 1; j++)
        for (let k = z - 1; k <= z + 1; k++)
          for (const vertex of this.cells.get(this.#key(i, j, k)) ?? []) {
            const distance = this.#distance(vertex, point);
            if (distance < least) [least, nearest] = [distance, vertex];
          }
    return nearest;
  }

  fromRim(point) {
    return Math.min(...this.rim.map((vertex) => this.#distance(vertex, point)));
  }

  #distance(vertex, { x, y, z }) {
    const { rest } = this, k = 3 * vertex;
    return Math.hypot(rest[k] - x, rest[k + 1] - y, rest[k + 2] - z);
  }

  #cell(...point) {
    return point.map((number) => Math.floor(number / this.near));
  }

  #key(x, y, z) {
    return `${x} ${y} ${z}`;
  }
}

function rimOf(faces) {
  const count = new Map();
  for (let face = 0; face < faces.length; face += 3)
    for (let k = 0; k < 3; k++) {
      const ends = [faces[face + k], faces[face + ((k + 1) % 3)]].sort((a, b) => a - b), key = ends.join(" ");
      count.set(key, { ends, times: (count.get(key)?.times ?? 0) + 1 });
    }
  return [...new Set([...count.values()].filter(({ times }) => times === 1).flatMap(({ ends }) => ends))];
}

function depthsBeneath(cover, mesh, unit) {
  const { position, normal } = mesh.geometry.attributes, point = new Vector3(), way = new Vector3(), up = new Vector3();
  return Float32Array.from({ length: position.count }, (_, index) => {
    mesh.getVertexPosition(index, point).applyMatrix4(mesh.matrixWorld);
    const vertex = cover.nearest(point);
    if (vertex < 0) return 0;
    way.fromArray(cover.rest, 3 * vertex).sub(point);
    // Cloth on the other side of a hand or an arm does not cover it.
    mesh.applyBoneTransform(index, up.fromBufferAttribute(position, index).addScaledVector(way.clone().fromBufferAttribute(normal, index), unit * 1e-3));
    up.applyMatrix4(mesh.matrixWorld).sub(point);
    if (way.dot(up) < -0.3 * way.length() * up.length()) return 0;
    return DEPTH * unit * Math.min(1, cover.fromRim(point) / (RIM * unit));
  });
}

function lower(mesh, original, depths) {
  const { geometry } = mesh, { normal } = geometry.attributes, array = Float32Array.from({ length: 3 * original.count });
  for (let i = 0; i < original.count; i++) {
    const depth = Math.max(0, ...depths.map((each) => each[i]));
    array[3 * i] = original.getX(i) - depth * normal.getX(i);
    array[3 * i + 1] = original.getY(i) - depth * normal.getY(i);
    array[3 * i + 2] = original.getZ(i) - depth * normal.getZ(i);
  }
  geometry.setAttribute("position", new BufferAttribute(array, 3));
}

/** Do something while the joints are as they are where the garments are at rest. */
function atRest({ scene, cloth, rest }, act) {
  scene.updateMatrixWorld(true);
  const before = cloth.bones.map((bone) => bone.matrix.clone());
  cloth.bones.forEach((bone, index) => {
    bone.parent.updateWorldMatrix(true, false);
    const matrix = new Matrix4().copy(bone.parent.matrixWorld).invert().multiply(rest[index]);
    matrix.decompose(bone.position, bone.quaternion, bone.scale);
  });
  scene.updateMatrixWorld(true);
  act();
  cloth.bones.forEach((bone, index) => before[index].decompose(bone.position, bone.quaternion, bone.scale));
  scene.updateMatrixWorld(true);
}
