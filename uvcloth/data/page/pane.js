// A pane: one way to move the garments of the figure, beside others, and the meshes that show it.

const FAILURES = 10; // frames that it cannot follow before it begins again

export class Pane {
  /** method: that it shows. source: {start(joints), step(joints, seconds, at)}, of which a step gives {vertices, cages,
   * parts}, the vertices null where it has none. at: as Playback has it. */
  constructor(method, source, garments) {
    Object.assign(this, { method, source, whole: source, garments, onError: () => {}, failed: 0, isThere: true });
    for (const { meshes } of garments) for (const mesh of meshes) mesh.layers.set(method.layer);
  }

  /** Show another source: that of fewer garments, or the whole one again. */
  take(source) {
    if (source !== this.source && this.source !== this.whole) this.source.worker.terminate();
    this.source = source;
  }

  /** End its workers. */
  close() {
    this.take(this.whole);
    this.whole.worker?.terminate();
  }

  /** Let it begin at joints. */
  async start(joints) {
    Object.assign(this, { last: null, failed: 0 });
    await this.source.start(joints);
  }

  /** The next frame; where the source cannot follow, the one before, null if there is none. */
  async step(joints, seconds, at) {
    try {
      this.last = await this.source.step(joints, seconds, at);
      this.failed = 0;
    } catch (error) {
      this.onError(error.message);
      if (++this.failed > FAILURES) await this.#again(joints);
    }
    return this.last;
  }

  /** Show a frame without those before it, or nothing where the source cannot. */
  preview(joints, at) {
    const isInstant = this.source.isStateless || this.source.isStored;
    const frame = isInstant ? this.source.step(joints, 0, at) : { vertices: null };
    this.show(frame, frame, 0);
  }

  /** Show what is between two frames. */
  show(from, to, share) {
    this.isThere = Boolean(from.vertices && to.vertices);
    this.garments.forEach((garment, index) =>
      this.isThere && to.vertices[index] ? garment.show(from.vertices[index], to.vertices[index], share) : garment.vanish(),
    );
  }

  async #again(joints) {
    this.failed = 0;
    try {
      await this.source.start(joints);
    } catch (error) {
      this.onError(error.message);
    }
  }
}
