// The comparison of methods with a stored simulation: what each frame adds to it, and how it is shown.
import { Curve } from "./curve.js";
import { Errors } from "./errors.js";

export class Comparison {
  /** truth: stored frames, see Errors. elements: {curve, scale} of the curves. onChoose: called with a share of the
   * animation. */
  constructor(truth, warmUp, cloth, { curve, scale }, onChoose) {
    this.errors = new Errors(truth, warmUp, cloth);
    this.curve = new Curve(curve, scale, onChoose);
    this.methods = []; // Whose curves are shown.
  }

  /** Show the curves of panes, those that are stored at once. */
  show(panes) {
    this.methods = panes.map(({ method }) => method).filter(({ isTruth }) => !isTruth);
    for (const { method, source } of panes) if (source.isStored && !method.isTruth) this.errors.measureStored(method, source);
    this.#draw();
  }

  /** Measure a frame of the playback, see there; of methods that remember only if they have come the whole way. */
  note(panes, { at, isWhole, answers }) {
    panes.forEach(({ method, source }, index) => {
      const { vertices } = answers[index];
      if (at && vertices && !source.isStored && (isWhole || source.isStateless)) this.errors.measure(method, vertices[0], at);
    });
    if (at) this.#draw();
  }

  /** The mean error of a method as a text, with dots where frames are still to come; "" before the first. */
  text(method) {
    if (method.isTruth) return "";
    const { mean, share } = this.errors.mean(method);
    return share > 0 ? `${mean.toFixed(1)} mm${share < 1 ? " …" : ""}` : "";
  }

  #draw() {
    this.curve.draw(this.errors, this.methods);
  }
}
