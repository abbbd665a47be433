// The ways to move the garments of a figure, each made when it is first shown.
import { bytesOf, makeWorker } from "./files.js";
import { readFrames } from "./frames.js";
import { Pane } from "./pane.js";
import { readPose } from "./pose.js";
import { readRecurrent } from "./recurrent.js";
import { Skinning } from "./skinning.js";

const STORED = "stored frames";

/** A way to move garments. kind: "live" or "stored frames". layer: of the scene, from 1 on. values: {quality} of the cages
 * where it is the cloth of the runtime, {isTruth} for what others are compared with. fewer: {file, worn} of outfits without
 * some of the garments, worn: the places of those that they have. */
class Method {
  constructor(name, kind, layer, open, values) {
    Object.assign(this, { name, kind, layer, open, fewer: [], ...values });
  }

  get title() {
    return this.quality ? `${this.name}, ${this.quality}` : this.name;
  }

  /** Its pane, on its own layer of the scene. Throws an Error with a sentence if it cannot be made. */
  async opened() {
    if (this.pane) return this.pane;
    const { source, garments } = await this.open();
    this.pane ??= new Pane(this, source, garments);
    return this.pane;
  }

  /** Of garments at these places, those that it solves: no others, or all where the page has no outfit of them. */
  solved(worn) {
    return this.fewer.some((each) => isSame(each.worn, worn)) ? worn : [...this.pane.garments.keys()];
  }

  /** A source for its pane that solves no others than it has to for the garments at these places. */
  async wearing(worn) {
    const { source, whole } = this.pane, outfit = this.fewer.find((each) => isSame(each.worn, worn));
    if (!outfit) return whole;
    return isSame(source.worn, worn) ? source : this.openFewer(this.pane, outfit);
  }
}

function isSame(worn, other) {
  return worn.join() === other.join();
}

/** The methods of a file that was opened: the cloth as it was baked, skinning, and what the page has beside them.
 * described: of that, {name, kind, file}. adjust: what to do with new cloth. */
export function methodsOf({ cloth }, described, wasm, adjust) {
  const methods = [], add = (name, kind, open, values) => methods.push(new Method(name, kind, methods.length + 1, open, values));
  const openFewer = async ({ garments }, { file, worn }) => (await clothOf(cloth, wasm, file, adjust, garments, worn)).source;
  const own = described.find(({ kind }) => kind === "baked")?.name ?? "as it was baked";
  add("cloth", "live", () => ({ source: cloth, garments: cloth.garments }), { quality: own });
  const makers = {
    outfit: ({ name, file }) => add("cloth", "live", () => clothOf(cloth, wasm, file, adjust), { quality: name }),
    recurrent: ({ name, file }) => add(name, "live", () => shownBy(readRecurrent(file, cloth), cloth)),
    pose: ({ name, file }) => add(name, "live", () => shownBy(readPose(file, cloth), cloth)),
    frames: ({ name, file }) => add(name, STORED, () => shownBy(readFrames(file, cloth), cloth)),
    truth: ({ name, file }) => add(name, STORED, () => shownBy(readFrames(file, cloth), cloth), { isTruth: true }),
  };
  for (const each of described) makers[each.kind]?.(each);
  for (const method of methods.filter(({ quality }) => quality)) {
    const fewer = described.filter(({ kind, name }) => kind === "fewer" && name === method.quality);
    Object.assign(method, { fewer, openFewer });
  }
  add("skinning", "live", () => shownBy(new Skinning(cloth), cloth));
  return methods;
}

/** Cloth of another outfit in a worker of its own. */
async function clothOf(cloth, wasm, file, adjust, garments, worn) {
  const worker = makeWorker();
  try {
    const other = await cloth.withOutfit(worker, wasm, new Uint8Array(await bytesOf(file)), garments, worn);
    adjust(other);
    return { source: other, garments: other.garments };
  } catch (error) {
    worker.terminate();
    throw error;
  }
}

async function shownBy(source, cloth) {
  return { source: await source, garments: cloth.twins() };
}
