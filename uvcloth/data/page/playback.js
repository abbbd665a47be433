// Playing of a figure in panes: their cloth has fixed frames, the display shows what is between two of them.
import { placeOf } from "./limb.js";
import { FPS, Motion } from "./motion.js";

const AHEAD = 3, HELD_AHEAD = 2; // frames of cloth that are asked for before they are shown; fewer follow a hand sooner
const SLOW = 0.1; // seconds that the display takes at most for one turn
const QUIET = 0.012; // m/s, mean speed at which cloth has settled
const SETTLING = 6 * FPS; // frames in which it does so at most

export class Playback {
  /** panes: at least one. compared: an animation that restarts at its end, with cloth at rest at its first frame, or null.
   * onFrame: called with every frame: {frame, time, at, isWhole, pose, joints, vertices, answers}, of the panes in their
   * order; vertices: of the first. at: {frame, place} where the figure is in the compared animation, null where it is
   * not. isWhole: whether it has come there from the first frame without a break. onError: with a sentence. */
  constructor(figure, panes, compared, onFrame, onError) {
    Object.assign(this, { figure, panes, compared, onFrame, onError, motion: new Motion(figure) });
    Object.assign(this, { speed: 1, playing: true, isStarting: false, run: 0, frames: [], time: 0 });
  }

  /** Show other panes, which begin where the figure is; a compared animation begins anew. */
  show(panes) {
    this.panes = panes;
    return this.start(this.clip, this.isComparing ? 0 : this.motion.time);
  }

  /** Begin with an animation at a time, with cloth at rest there. */
  async start(clip, time) {
    this.run++;
    Object.assign(this, { frames: [], next: 0, clock: 0, isStarting: true, isHeld: false });
    this.wake();
    const { run, panes } = this;
    this.motion.begin(clip, time);
    this.motion.next(false);
    const joints = this.figure.cloth.transforms();
    this.motion.begin(clip, time);
    this.isWhole = this.motion.frame === 0;
    await Promise.all(panes.map((pane) => pane.start(joints).catch((error) => this.onError(error.message))));
    if (run !== this.run) return;
    this.isStarting = false;
    this.#ask();
  }

  /** Go over to an animation, or to another time of the same. */
  goTo(clip, time) {
    if (this.isStarting) return this.start(clip, time);
    this.motion.goTo(clip, time);
    this.wake();
  }

  /** Whether the animation is the compared one. */
  get isComparing() {
    return this.clip === this.compared;
  }

  /** Show a time of an animation at once, in panes that need no cloth to come to rest; `start` then goes on from there. */
  preview(clip, time) {
    this.run++;
    Object.assign(this, { frames: [], isHeld: true });
    this.motion.begin(clip, time);
    this.figure.write(this.motion.next(false));
    const joints = this.figure.cloth.transforms(), { at } = this.motion;
    for (const pane of this.panes) pane.preview(joints, at);
    this.time = this.motion.time;
  }

  hold(part) {
    this.motion.hold(part);
    this.wake();
  }

  drag(point) {
    this.motion.drag(point);
  }

  release() {
    this.motion.release(this.playing);
  }

  /** Let the cloth settle, even while nothing plays, from something that has changed. */
  wake() {
    this.settling = SETTLING;
    this.isWhole = false;
  }

  /** Stop the time of figure and cloth, after the frames that were asked for, or let it go on. */
  toggle() {
    this.playing = !this.playing;
    if (this.playing) return;
    this.motion.stop();
    this.settling = 0;
  }

  /** The place that the camera follows: that of the root, or, while a hand holds the figure, what moves without it. */
  get followed() {
    return this.motion.grip?.carried.clone() ?? placeOf(this.figure.cloth.bones[0]);
  }

  get clip() {
    return this.motion.clip;
  }

  get last() {
    return this.motion.last / FPS;
  }

  /** Go on by seconds of the clock, and pose the figure and its cloth. */
  advance(seconds) {
    if (this.isStarting || this.isHeld) return;
    if (this.frames.length) {
      const ready = this.frames.at(-1).frame; // Slower where the cloth is not ready.
      this.clock = Math.min(this.clock + this.speed * Math.min(seconds, SLOW) * FPS, ready);
      while (this.frames.length > 2 && this.frames[1].frame <= this.clock) this.frames.shift();
    }
    if (this.#isOver && this.clock >= this.next - 1) return this.start(this.clip, 0);
    this.#ask();
    if (this.frames.length) this.#show();
  }

  // Whether the compared animation has been asked for to its end.
  get #isOver() {
    return this.isComparing && this.playing && !this.motion.isMoving && this.next > 0 && this.motion.frame === this.motion.last;
  }

  get #isRunning() {
    return this.next === 0 || this.playing || this.motion.isMoving || this.settling > 0;
  }

  #show() {
    const [from, to = from] = this.frames;
    const share = to === from ? 0 : Math.min(1, Math.max(0, (this.clock - from.frame) / (to.frame - from.frame)));
    this.figure.write(from.pose.mixed(to.pose, share));
    this.panes.forEach((pane, index) => pane.show(from.answers[index], to.answers[index], share));
    this.between = { from, to, share };
    this.time = to.time < from.time ? to.time : from.time + share * (to.time - from.time);
    this.shown = this.time;
  }

  #ask() {
    const ahead = this.motion.grip ? HELD_AHEAD : AHEAD;
    while (this.#isRunning && !this.#isOver && this.next <= this.clock + ahead) this.#step(this.next++);
  }

  async #step(frame) {
    const { run, panes } = this, before = performance.now(), pose = this.motion.next(this.playing), { time } = this.motion;
    const at = this.isComparing ? this.motion.at : null;
    if (!at) this.isWhole = false;
    const { isWhole } = this;
    if (this.playing || this.motion.isMoving) this.settling = SETTLING;
    else if (this.settling) this.settling--;
    const joints = this.figure.cloth.transforms(), milliseconds = performance.now() - before;
    const answers = await Promise.all(panes.map((pane) => pane.step(joints, 1 / FPS, at)));
    if (run !== this.run || answers.includes(null)) return;
    const [{ vertices }] = answers;
    if (vertices) this.#look(vertices);
    this.frames.push({ frame, time, pose, vertices, answers });
    this.onFrame?.({ frame, time, at, isWhole, pose, joints, vertices, answers, milliseconds });
  }

  // Where nothing plays, cloth is moved until it has settled.
  #look(vertices) {
    const before = this.frames.at(-1)?.vertices;
    if (!before || this.playing || this.motion.isMoving || this.settling > SETTLING - FPS / 2) return;
    let way = 0, count = 0;
    vertices.forEach((garment, index) => {
      for (let k = 0; k < (garment?.length ?? 0); k += 3, count++)
        way += Math.hypot(garment[k] - before[index][k], garment[k + 1] - before[index][k + 1], garment[k + 2] - before[index][k + 2]);
    });
    if ((way / count) * FPS < QUIET * this.figure.unit) this.settling = 0;
  }
}
