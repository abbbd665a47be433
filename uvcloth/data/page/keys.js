// Parts of the figure for the keyboard: each is a button over its mark, and arrow keys drag it as a pointer does.

const STEP = 0.015; // heights that an arrow key moves a part
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class GripKeys {
  /** element: in which the buttons are. */
  constructor(element, hand) {
    Object.assign(this, { element, hand, buttons: [], move: null });
  }

  /** Show the parts of the figure that the hand takes from now on. */
  show() {
    this.move = null;
    this.buttons = this.hand.marks.map(({ part }) => {
      const button = Object.assign(document.createElement("button"), { type: "button", className: "grip" });
      button.setAttribute("aria-label", part.replace("_", " "));
      button.addEventListener("keydown", (event) => this.#press(part, event));
      button.addEventListener("blur", () => this.#letGo());
      return button;
    });
    this.element.replaceChildren(...this.buttons);
  }

  /** Bring the buttons to their marks in the first pane. */
  follow() {
    this.hand.marks.forEach(({ mesh }, index) => {
      const [x, y] = this.hand.stage.onPage(mesh.position);
      Object.assign(this.buttons[index].style, { left: `${x}px`, top: `${y}px` });
    });
  }

  #press(part, event) {
    if (event.key === "Escape") return this.#letGo();
    const arrow = ARROWS[event.key];
    if (!arrow) return;
    event.preventDefault();
    this.move ??= this.hand.takeByKeys(part);
    this.move?.(STEP * arrow[0], STEP * arrow[1]);
  }

  #letGo() {
    this.move?.();
    this.move = null;
  }
}
