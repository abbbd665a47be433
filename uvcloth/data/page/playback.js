// Playing of a figure with its cloth: the cloth has fixed frames, the display shows what is between two of them.
import { placeOf } from "./limb.js";
import { FPS, Motion } from "./motion.js";

const AHEAD = 3, HELD_AHEAD = 2; // frames of cloth that are asked for before they are shown; fewer follow a hand sooner
const SLOW = 0.1; // seconds that the display takes at most for one turn
const QUIET = 0.012; // m/s, mean speed at which cloth has settled
const SETTLING = 6 * FPS; // frames in which it does so at most
const FAILURES = 10; // frames that the cloth cannot follow before it comes to rest again

export class Playback {
  /** onFrame: called with every frame of cloth: {frame, time, pose, joints, vertices, parts}. onError: with a sentence. */
  constructor(figure, onFrame, onError) {
    Object.assign(this, { figure, cloth: figure.cloth, onFrame, onError, motion: new Motion(figure) });
    Object.assign(this, { speed: 1, playing: true, isStarting: false, run: 0, frames: [], time: 0, failed: 0 });
  }

  /** Begin with an animation at a time, with cloth at rest there. */
  async start(clip, time) {
    this.run++;
    Object.assign(this, { frames: [], next: 0, clock: 0, isStarting: true, failed: 0 });
    this.wake();
    const { run } = this;
    this.motion.begin(clip, time);
    this.motion.next(false);
    const joints = this.cloth.transforms();
    this.motion.begin(clip, time);
    try {
      await this.cloth.start(joints);
    } catch (error) {
      this.onError(error.message);
    }
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

  /** Let the cloth settle, even while nothing plays. */
  wake() {
    this.settling = SETTLING;
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
    return this.motion.grip?.carried.clone() ?? placeOf(this.cloth.bones[0]);
  }

  get clip() {
    return this.motion.clip;
  }

  get last() {
    return this.motion.last / FPS;
  }

  /** Go on by seconds of the clock, and pose the figure and its cloth. */
  advance(seconds) {
    if (this.isStarting) return;
    if (this.frames.length) {
      const ready = this.frames.at(-1).frame; // Slower where the cloth is not ready.
      this.clock = Math.min(this.clock + this.speed * Math.min(seconds, SLOW) * FPS, ready);
      while (this.frames.length > 2 && this.frames[1].frame <= this.clock) this.frames.shift();
    }
    this.#ask();
    if (this.frames.length) this.#show();
  }

  get #isRunning() {
    return this.playing || this.motion.isMoving || this.settling > 0;
  }

  #show() {
    const [from, to = from] = this.frames;
    const share = to === from ? 0 : Math.min(1, Math.max(0, (this.clock - from.frame) / (to.frame - from.frame)));
    this.figure.write(from.pose.mixed(to.pose, share));
    this.cloth.show(from.vertices, to.vertices, share);
    this.shownCages = [from.cages, to.cages, share];
    this.time = to.time < from.time ? to.time : from.time + share * (to.time - from.time);
    this.shown = this.time;
  }

  #ask() {
    const ahead = this.motion.grip ? HELD_AHEAD : AHEAD;
    while (this.#isRunning && this.next <= this.clock + ahead) this.#step(this.next++);
  }

  async #step(frame) {
    const { run } = this, before = performance.now(), pose = this.motion.next(this.playing), { time } = this.motion;
    if (this.playing || this.motion.isMoving) this.settling = SETTLING;
    else if (this.settling) this.settling--;
    const joints = this.cloth.transforms(), milliseconds = performance.now() - before;
    let answer;
    try {
      answer = await this.cloth.step(joints, 1 / FPS);
      this.failed = 0;
    } catch (error) {
      if (run !== this.run) return;
      this.onError(error.message);
      if (++this.failed > FAILURES) return this.start(this.clip, time);
      // The cloth stays as it was, and the animation goes on.
      answer = this.frames.at(-1);
      if (!answer) return;
    }
    if (run !== this.run) return;
    const parts = { ...answer.parts, pose: milliseconds };
    this.#look(answer.vertices);
    this.frames.push({ frame, time, pose, vertices: answer.vertices, cages: answer.cages });
    this.onFrame?.({ frame, time, pose, joints, vertices: answer.vertices, parts });
  }

  // Where nothing plays, cloth is moved until it has settled.
  #look(vertices) {
    const before = this.frames.at(-1)?.vertices;
    if (!before || this.playing || this.motion.isMoving || this.settling > SETTLING - FPS / 2) return;
    let way = 0, count = 0;
    vertices.forEach((garment, index) => {
      for (let k = 0; k < garment.length; k += 3, count++)
        way += Math.hypot(garment[k] - before[index][k], garment[k + 1] - before[index][k + 1], garment[k + 2] - before[index][k + 2]);
    });
    if ((way / count) * FPS < QUIET * this.figure.unit) this.settling = 0;
  }
}
