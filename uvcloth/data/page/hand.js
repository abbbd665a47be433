// The pointer as a hand: it takes parts of the figure, which are marked, and drags them in the plane of the display.
import { partsOf } from "./grip.js";
import { placeOf } from "./limb.js";
import { Mesh, MeshBasicMaterial, Plane, Raycaster, SphereGeometry, Vector2, Vector3 } from "./three.min.js";

const NEAR = { mouse: 22, pen: 22, touch: 34 }; // pixels
const MARK = 0.011; // heights
const KEYS = "keys", FARTHEST = 1; // heights that keys move a part
const FAINT = 0.3, CLEAR = 0.85;

export class Hand {
  constructor(stage) {
    Object.assign(this, { stage, marks: [], ray: new Raycaster(), plane: new Plane(), shift: new Vector3() });
    const { canvas } = stage, on = (kind, act) => canvas.addEventListener(kind, act, { capture: true });
    on("pointerdown", (event) => this.#take(event));
    on("pointermove", (event) => this.#move(event));
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) on(kind, (event) => this.#release(event));
    on("pointerleave", () => this.#mark(null));
  }

  /** Take parts of the figure that is played from now on. */
  show(playback) {
    this.#release();
    for (const { mesh } of this.marks) this.stage.scene.remove(mesh);
    this.playback = playback;
    const { figure } = playback, geometry = new SphereGeometry(MARK * figure.height, 16, 12);
    this.marks = Object.entries(partsOf(figure)).map(([part, joint]) => {
      const material = new MeshBasicMaterial({ color: "#3a6ea5", transparent: true, opacity: FAINT, depthTest: false });
      const mesh = new Mesh(geometry, material);
      mesh.renderOrder = 1;
      this.stage.scene.add(mesh);
      return { part, joint, mesh };
    });
  }

  /** Bring the marks, and what is held, to where the figure is now. */
  follow() {
    for (const { joint, mesh } of this.marks) mesh.position.copy(placeOf(joint));
    if (this.held === undefined) return;
    if (this.held === KEYS) {
      const point = this.keyed();
      this.carried = this.playback.followed;
      return this.playback.drag(point);
    }
    // The plane goes along with the animation.
    const { followed } = this.playback;
    this.plane.translate(followed.clone().sub(this.carried));
    this.carried = followed;
    this.playback.drag(this.#point().add(this.shift));
  }

  #take(event) {
    const mark = this.playback && event.isPrimary && event.button === 0 && this.held === undefined && this.#nearest(event);
    if (!mark) return;
    event.stopImmediatePropagation(); // The camera stays.
    this.held = event.pointerId;
    this.stage.canvas.setPointerCapture(event.pointerId);
    const place = placeOf(mark.joint), away = this.stage.camera.getWorldDirection(new Vector3());
    this.playback.hold(mark.part);
    this.plane.setFromNormalAndCoplanarPoint(away, place);
    this.carried = this.playback.followed;
    this.#aim(event);
    this.shift = place.sub(this.#point());
    this.#mark(mark);
  }

  #move(event) {
    if (this.held === undefined) return this.#mark(this.playback && this.#nearest(event));
    if (event.pointerId !== this.held) return;
    event.stopImmediatePropagation();
    this.#aim(event);
  }

  #release(event) {
    if (this.held === undefined || (event && event.pointerId !== this.held)) return;
    event?.stopImmediatePropagation();
    this.#letGo();
  }

  #letGo() {
    this.held = undefined;
    this.playback.release();
    this.#mark(null);
  }

  #mark(mark) {
    for (const each of this.marks) each.mesh.material.opacity = each === mark ? CLEAR : FAINT;
    this.stage.canvas.style.cursor = mark ? (this.held === undefined ? "grab" : "grabbing") : "";
  }

  // Within the pane in which the pointer has taken something.
  #aim({ clientX, clientY }) {
    const { left, top, width, height } = this.pane;
    this.aim = new Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height);
  }

  /** Take a part without a pointer. Returns a function that moves it by shares of the height, to the right and upwards as
   * it is shown, and lets it go without numbers; null while something is held. */
  takeByKeys(part) {
    const mark = this.marks.find((each) => each.part === part);
    if (this.held !== undefined || !mark) return null;
    const { playback } = this, { camera } = this.stage, from = placeOf(mark.joint), moved = new Vector3();
    this.held = KEYS;
    playback.hold(part);
    this.carried = playback.followed;
    this.keyed = () => from.add(playback.followed.sub(this.carried)).clone().add(moved);
    this.#mark(mark);
    return (right, up) => {
      if (this.held !== KEYS || playback !== this.playback) return;
      if (right === undefined) return this.#letGo();
      const [x, y] = [new Vector3(), new Vector3()];
      camera.matrixWorld.extractBasis(x, y, new Vector3());
      moved.addScaledVector(x, right * playback.figure.height).addScaledVector(y, up * playback.figure.height);
      moved.clampLength(0, FARTHEST * playback.figure.height);
      playback.wake();
    };
  }

  // Where the pointer is in the plane of what was taken.
  #point() {
    this.ray.setFromCamera(this.aim, this.stage.camera);
    return this.ray.ray.intersectPlane(this.plane, new Vector3()) ?? this.plane.coplanarPoint(new Vector3());
  }

  #nearest({ clientX, clientY, pointerType }) {
    this.pane = this.stage.paneAt(clientX, clientY);
    const distances = this.marks.map(({ joint }) => {
      const [x, y] = this.stage.onPage(placeOf(joint), this.pane);
      return Math.hypot(x - clientX, y - clientY);
    });
    const least = Math.min(...distances);
    return least < (NEAR[pointerType] ?? NEAR.mouse) ? this.marks[distances.indexOf(least)] : null;
  }
}
