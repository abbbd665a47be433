// The ways to move the garments of a figure, each made when it is first shown.
import { bytesOf, makeWorker } from "./files.js";
import { readFrames } from "./frames.js";
import { Pane } from "./pane.js";
import { readPose } from "./pose.js";
import { readRecurrent } from "./recurrent.js";
import { Skinning } from "./skinning.js";

const STORED = "stored frames";

/** A way to move garments. kind: "live" or "stored frames". layer: of the scene, from 1 on. values: {quality} of the cages
 * where it is the cloth of the runtime, {isTruth} for what others are compared with. */
class Method {
  constructor(name, kind, layer, open, values) {
    Object.assign(this, { name, kind, layer, open, ...values });
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
}

/** The methods of a file that was opened: the cloth as it was baked, skinning, and what the page has beside them.
 * described: of that, {name, kind, file}. adjust: what to do with new cloth. */
export function methodsOf({ cloth }, described, wasm, adjust) {
  const methods = [], add = (name, kind, open, values) => methods.push(new Method(name, kind, methods.length + 1, open, values));
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
  add("skinning", "live", () => shownBy(new Skinning(cloth), cloth));
  return methods;
}

/** Cloth of another quality in a worker of its own. */
async function clothOf(cloth, wasm, file, adjust) {
  const worker = makeWorker();
  try {
    const other = await cloth.withOutfit(worker, wasm, new Uint8Array(await bytesOf(file)));
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
