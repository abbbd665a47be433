// Curves of errors over the time of an animation, with a playhead.

const SVG = "http://www.w3.org/2000/svg";
const ENDS = [1, 1.5, 2, 3, 4, 5, 6, 8, 10]; // of the axis, times a power of ten, mm

export class Curve {
  /** element: an <svg>. scale: an element for the end of its axis. onChoose: called with a share of the animation. */
  constructor(element, scale, onChoose) {
    Object.assign(this, { element, scale, lines: new Map() });
    element.replaceChildren();
    element.setAttribute("preserveAspectRatio", "none");
    this.warmUp = this.#add("rect", "warm-up");
    this.warmUp.appendChild(document.createElementNS(SVG, "title")).textContent = "Warm-up of the simulation, which does not count";
    this.playhead = this.#add("line", "playhead");
    element.onpointerdown = (event) => {
      element.setPointerCapture(event.pointerId);
      this.#choose(event, onChoose);
    };
    element.onpointermove = (event) => event.buttons && this.#choose(event, onChoose);
  }

  /** Draw the curves of some methods. errors: of all. */
  draw(errors, methods) {
    const { frames, warmUp } = errors, most = Math.max(0, ...methods.map((method) => errors.curve(method).reduce((a, b) => (b > a ? b : a), 0)));
    const end = endFor(most);
    this.scale.textContent = `${end} mm`;
    this.element.setAttribute("viewBox", `0 0 ${frames - 1} ${end}`);
    for (const [name, value] of Object.entries({ x: 0, y: 0, width: warmUp, height: end })) this.warmUp.setAttribute(name, value);
    this.playhead.setAttribute("y2", end);
    for (const [method, line] of this.lines) if (!methods.includes(method)) line.remove();
    this.lines = new Map(methods.map((method) => {
      const line = this.lines.get(method) ?? document.createElementNS(SVG, "path");
      line.setAttribute("class", `error hue-${method.layer}`);
      line.setAttribute("d", pathOf(errors.curve(method), end));
      this.element.insertBefore(line, this.playhead);
      return [method, line];
    }));
    const told = methods.map((method) => `${method.title} ${errors.mean(method).mean.toFixed(1)} mm`);
    this.element.setAttribute("aria-label", `Mean error over the animation: ${told.join(", ")}`);
  }

  /** Put the playhead at a frame. */
  point(frame) {
    for (const name of ["x1", "x2"]) this.playhead.setAttribute(name, frame);
  }

  #add(kind, className) {
    const made = document.createElementNS(SVG, kind);
    made.setAttribute("class", className);
    return this.element.appendChild(made);
  }

  #choose({ clientX }, onChoose) {
    const { left, width } = this.element.getBoundingClientRect();
    onChoose(Math.min(1, Math.max(0, (clientX - left) / width)));
  }
}

/** A round number that is at least a number. */
function endFor(number) {
  const power = 10 ** Math.floor(Math.log10(Math.max(number, 1)));
  return power * ENDS.find((each) => power * each >= number);
}

/** Pieces of a line through the numbers of a curve that are there. */
function pathOf(curve, end) {
  let path = "", isDrawing = false;
  curve.forEach((error, frame) => {
    if (!Number.isNaN(error)) path += `${isDrawing ? "L" : "M"}${frame} ${(end - error).toFixed(2)}`;
    isDrawing = !Number.isNaN(error);
  });
  return path;
}
