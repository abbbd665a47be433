// The ways to move the garments of a figure, each made when it is first shown.
import { bytesOf, makeWorker } from "./files.js";
import { readFrames } from "./frames.js";
import { Pane } from "./pane.js";
import { Skinning } from "./skinning.js";

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
 * described: of that, {name, kind, file}. adjust: what to do with new cloth. onError: called with a sentence. */
export function methodsOf({ cloth }, described, wasm, adjust) {
  const methods = [], add = (name, kind, open, values) => methods.push(new Method(name, kind, methods.length + 1, open, values));
  const own = described.find(({ kind }) => kind === "baked")?.name ?? "as it was baked";
  add("cloth", "live", () => ({ source: cloth, garments: cloth.garments }), { quality: own });
  for (const { name, kind, file } of described) {
    if (kind === "outfit")
      add("cloth", "live", async () => {
        const worker = makeWorker();
        try {
          const other = await cloth.withOutfit(worker, wasm, new Uint8Array(await bytesOf(file)));
          adjust(other);
          return { source: other, garments: other.garments };
        } catch (error) {
          worker.terminate();
          throw error;
        }
      }, { quality: name });
  }
  add("skinning", "live", () => ({ source: new Skinning(cloth), garments: cloth.twins() }));
  for (const { name, kind, file } of described) {
    const isTruth = kind === "truth";
    if (isTruth || kind === "frames")
      add(name, "stored frames", async () => ({ source: await readFrames(file, cloth), garments: cloth.twins() }), { isTruth });
  }
  return methods;
}
