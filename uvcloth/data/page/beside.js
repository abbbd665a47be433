// Panes beside each other: which are shown, and their names and costs over them.

const MOST = 4; // panes
const AVERAGED = 30; // frames

/** Panes of methods, of which the first is shown in any case. */
export class Beside {
  /** element: in which their labels are. list: of the boxes that choose them. onChange: called when others are wanted. */
  constructor(element, list, methods, onChange) {
    Object.assign(this, { element, list, methods, onChange, first: methods[0], chosen: [], costs: new Map() });
    this.#list();
  }

  /** The methods that are wanted, the first one before the others. */
  get wanted() {
    return [this.first, ...this.chosen];
  }

  /** Choose methods to be shown beside the first. */
  choose(methods) {
    this.chosen = methods.filter((method) => method !== this.first).slice(0, MOST - 1);
    this.#list();
    this.onChange();
  }

  /** Show another method first. */
  lead(method) {
    this.first = method;
    this.choose(this.chosen);
  }

  /** Label the panes that are shown, which are where the stage has divided its canvas. */
  label(panes, places) {
    const isNew = panes.length !== this.panes?.length || panes.some((pane, index) => pane !== this.panes[index]);
    if (isNew) {
      this.panes = panes;
      this.labels = panes.map(({ method }) => this.#label(method));
      this.element.replaceChildren(...this.labels.map(({ frame }) => frame));
    }
    this.element.hidden = panes.length < 2;
    this.labels.forEach(({ frame, note }, index) => {
      note.hidden = panes[index].isThere;
      const { left, top, width, height } = places[index];
      Object.assign(frame.style, { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` });
    });
  }

  /** Note what a frame of each pane has cost. */
  count(panes, answers) {
    panes.forEach(({ method }, index) => {
      const { parts } = answers[index];
      const costs = [...(this.costs.get(method) ?? []), parts.cloth + parts.vertices].slice(-AVERAGED);
      this.costs.set(method, costs);
      const label = panes === this.panes && this.labels[index];
      if (label && method.kind === "live") label.cost.textContent = `${this.milliseconds(method).toFixed(1)} ms`;
    });
  }

  /** Tell the errors of the panes that are shown. text: of a method. */
  tell(text) {
    this.panes.forEach(({ method }, index) => { this.labels[index].error.textContent = text(method); });
  }

  /** Mean milliseconds of the last frames of a method; NaN before the first. */
  milliseconds(method) {
    const costs = this.costs.get(method) ?? [];
    return costs.reduce((sum, each) => sum + each, 0) / costs.length;
  }

  #label(method) {
    const frame = element("div", "pane"), label = element("p", "label");
    const cost = element("span", "cost"), error = element("span", `error hue-${method.layer}`);
    const note = element("span", "note", "no frames of this pose"), figures = element("p", "figures");
    label.append(element("b", "", method.title), element("span", "kind", method.kind));
    figures.append(error, note, cost);
    frame.append(label, figures);
    return { frame, cost, error, note };
  }

  #list() {
    const isFull = this.chosen.length === MOST - 1;
    const boxes = this.methods.filter((method) => method !== this.first).map((method) => {
      const label = document.createElement("label"), box = document.createElement("input");
      const checked = this.chosen.includes(method);
      Object.assign(box, { type: "checkbox", checked, disabled: isFull && !checked });
      box.addEventListener("change", () =>
        this.choose(this.methods.filter((each) => (each === method ? box.checked : this.chosen.includes(each)))),
      );
      label.append(box, method.title);
      return label;
    });
    this.list.replaceChildren(...boxes);
  }
}

function element(kind, className, text = "") {
  return Object.assign(document.createElement(kind), { className, textContent: text });
}
