// Cloth of a .glb that three.js has loaded: transforms of its joints go to a worker, vertices come back to its meshes.
// It imports nothing, so it works beside any copy of three.js.

const EXTENSION = "UVCLOTH_cloth", VERSION = 1;

/** Make the cloth of a file. gltf: from GLTFLoader. worker: of worker.js. wasm: bytes of uvcloth.wasm.
 * Throws an Error with a sentence for a file without cloth, of another version, or damaged. */
export async function makeCloth(gltf, worker, wasm) {
  const { json } = gltf.parser, extension = json.extensions?.[EXTENSION];
  if (!extension) throw new Error(`it has no cloth (no extension ${EXTENSION}); \`uvcloth bake\` writes such files`);
  if (extension.version !== VERSION)
    throw new Error(`its cloth is of version ${extension.version}, this page plays version ${VERSION}`);
  const part = (kind, index) => gltf.parser.getDependency(kind, index);
  const skin = json.skins[extension.skin];
  const bones = await Promise.all(skin.joints.map((node) => part("node", node)));
  const inverseBind = (await part("accessor", skin.inverseBindMatrices)).array;
  const garments = await Promise.all(
    extension.garments.map(async (entry) =>
      new Garment(
        gltf.scene,
        await part("node", entry.node),
        (await part("accessor", entry.vertices)).array,
        entry.fabric,
      ),
    ),
  );
  const outfit = new Uint8Array(await part("bufferView", extension.bufferView)).slice();
  const cloth = new Cloth(worker, bones, extension.joints, inverseBind, extension.axes, garments);
  await cloth.open(wasm, outfit);
  garments.forEach((garment) => garment.release());
  return cloth;
}

class Cloth {
  // worn: places of the garments that the outfit has, among all.
  constructor(worker, bones, names, inverseBind, axes, garments, worn = [...garments.keys()]) {
    Object.assign(this, { worker, bones, names, inverseBind, axes, garments, worn, asked: new Map(), count: 0 });
    this.inverseAxes = inverse(axes);
    this.toRest = bones.map((_, index) => product(inverseBind.subarray(16 * index, 16 * index + 16), this.inverseAxes));
    worker.onmessage = ({ data }) => {
      const { answer, fail } = this.asked.get(data.id);
      this.asked.delete(data.id);
      if (data.error) fail(new Error(data.error));
      else answer(data);
    };
    worker.onerror = () => this.asked.forEach(({ fail }) => fail(new Error("the worker cannot be started")));
  }

  /** Read the bytes of an outfit. Throws an Error with a sentence for one that is damaged, or of other garments. */
  async open(wasm, outfit) {
    const { bones } = this, garments = this.worn.map((place) => this.garments[place]);
    const { joints, garments: sizes, cages, corners } = await this.ask("open", { wasm, outfit, inverseAxes: this.inverseAxes });
    if (joints !== bones.length || sizes.length !== garments.length || sizes.some((size, index) => size !== garments[index].size))
      throw new Error("its cloth does not fit its meshes");
    this.cages = { vertices: cages, corners };
  }

  /** Cloth of the same garments in another worker, of another outfit's bytes. garments: that show it, or twins.
   * worn: places of the garments that the outfit has, if it has not all. */
  async withOutfit(worker, wasm, outfit, garments = this.twins(), worn = undefined) {
    const { bones, names, inverseBind, axes } = this;
    const other = new Cloth(worker, bones, names, inverseBind, axes, garments, worn);
    await other.open(wasm, outfit);
    return other;
  }

  /** The garments once more, with meshes of their own. */
  twins() {
    return this.garments.map((garment) => garment.twin());
  }

  /** The transforms of the joints as the nodes are now, 12 J numbers; their matrixWorld has to be up to date. */
  transforms() {
    const out = new Float64Array(12 * this.bones.length);
    this.bones.forEach((bone, index) => {
      const whole = product(product(this.axes, bone.matrixWorld.elements), this.toRest[index]);
      for (let row = 0; row < 3; row++)
        for (let column = 0; column < 4; column++) out[12 * index + 4 * row + column] = whole[4 * column + row];
    });
    return out;
  }

  /** Let the cloth come to rest. */
  start(joints) {
    return this.ask("start", { joints });
  }

  /** Move the cloth on; the answer has the vertices of each garment, null for one that the outfit has not, and of the
   * cages, and in parts the milliseconds. */
  async step(joints, seconds) {
    const answer = await this.ask("step", { joints, seconds }), vertices = this.garments.map(() => null);
    this.worn.forEach((place, index) => { vertices[place] = answer.vertices[index]; });
    return { ...answer, vertices };
  }

  /** Wind, m/s, and gravity, m/s2, along the runtime's axes, of which Z points up. */
  setWorld(wind, gravity) {
    return this.ask("world", { wind, gravity });
  }

  /** Make all garments of a fabric, numbers as in the extension; none is what was baked. */
  setFabric(fabric) {
    const factors = this.worn.map((place) => this.garments[place]).map((garment) =>
      fabric && garment.fabric ? fabric.map((value, index) => value / garment.fabric[index]) : [1, 1, 1],
    );
    return this.ask("fabrics", { factors });
  }

  /** Show cloth between two frames, lists of vertices of each garment: share 0 is the first one, 1 the second. */
  show(from, to, share) {
    this.garments.forEach((garment, index) => garment.show(from[index], to[index], share));
  }

  ask(kind, values) {
    const id = this.count++;
    const answered = new Promise((answer, fail) => this.asked.set(id, { answer, fail }));
    this.worker.postMessage({ id, kind, ...values });
    return answered;
  }
}

class Garment {
  constructor(scene, node, vertices, fabric) {
    Object.assign(this, { scene, node, vertices, fabric, size: 1 + vertices.reduce((a, b) => Math.max(a, b), 0) });
    Object.assign(this, { meshes: [], isWanted: true, isThere: true });
    node.traverse((each) => each.isMesh && this.meshes.push(each));
    this.points = new Float32Array(3 * this.size);
    this.normals = new Float32Array(3 * this.size);
    this.faces = Int32Array.from(this.meshes.flatMap((mesh) => Array.from(mesh.geometry.index.array, (i) => vertices[i])));
    this.rest = new Float32Array(3 * this.size);
    const { position } = this.meshes[0].geometry.attributes;
    vertices.forEach((vertex, index) => {
      this.rest.set([position.getX(index), position.getY(index), position.getZ(index)], 3 * vertex);
    });
  }

  /** The garment once more, with meshes of its own. Only one that was released has twins. */
  twin() {
    const node = this.node.clone();
    node.traverse((each) => { if (each.isMesh) each.geometry = each.geometry.clone(); });
    this.node.parent.add(node);
    const twin = new Garment(this.scene, node, this.vertices, this.fabric);
    twin.rest = this.rest;
    twin.release();
    return twin;
  }

  /** Whether it is shown where there is something to show. */
  get isShown() {
    return this.isWanted;
  }

  set isShown(isShown) {
    this.isWanted = isShown;
    this.node.visible = isShown && this.isThere;
  }

  /** Show nothing. */
  vanish() {
    this.isThere = this.node.visible = false;
  }

  /** Take the meshes off the skeleton: their vertices are in the world from now on. */
  release() {
    for (const mesh of this.meshes) {
      mesh.isSkinnedMesh = false; // The renderer then draws it as a plain mesh.
      mesh.frustumCulled = false; // Its bounds are those at rest.
      mesh.matrixAutoUpdate = mesh.matrixWorldAutoUpdate = false;
      mesh.matrixWorld.identity();
      for (const name of ["position", "normal"]) {
        const attribute = mesh.geometry.attributes[name];
        const own = new attribute.constructor(new Float32Array(3 * this.vertices.length), 3);
        mesh.geometry.setAttribute(name, own);
      }
    }
  }

  show(from, to, share) {
    const { points } = this;
    this.isThere = true;
    this.node.visible = this.isWanted;
    if (!this.isWanted) return;
    for (let i = 0; i < points.length; i++) points[i] = from[i] + share * (to[i] - from[i]);
    this.#computeNormals();
    for (const { geometry } of this.meshes) {
      this.#spread(points, geometry.attributes.position);
      this.#spread(this.normals, geometry.attributes.normal);
    }
  }

  // On the runtime's vertices, so that seams of the texture are not seen. Of the length of the faces' areas;
  // the shader makes them unit.
  #computeNormals() {
    const { points, normals, faces } = this;
    normals.fill(0);
    for (let face = 0; face < faces.length; face += 3) {
      const a = 3 * faces[face], b = 3 * faces[face + 1], c = 3 * faces[face + 2];
      const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
      const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
      const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
      for (const corner of [a, b, c]) {
        normals[corner] += x;
        normals[corner + 1] += y;
        normals[corner + 2] += z;
      }
    }
    for (let i = 0; i < normals.length; i += 3) {
      const size = Math.hypot(normals[i], normals[i + 1], normals[i + 2]) || 1;
      for (let k = i; k < i + 3; k++) normals[k] /= size;
    }
  }

  #spread(values, attribute) {
    const { array } = attribute;
    this.vertices.forEach((vertex, index) => {
      for (let k = 0; k < 3; k++) array[3 * index + k] = values[3 * vertex + k];
    });
    attribute.needsUpdate = true;
  }
}

/** The product of two matrices (4, 4), column after column as glTF and three.js have them. */
function product(a, b) {
  const out = new Float64Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) out[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return out;
}

/** The inverse of a turn and a scale, without a shift. */
function inverse(axes) {
  const squared = axes[0] ** 2 + axes[1] ** 2 + axes[2] ** 2, out = new Float64Array(16);
  for (let column = 0; column < 3; column++)
    for (let row = 0; row < 3; row++) out[4 * column + row] = axes[4 * row + column] / squared;
  out[15] = 1;
  return out;
}
