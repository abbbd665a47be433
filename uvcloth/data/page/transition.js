// A smooth way from a motion that ends into another one.
import { Pose } from "./figure.js";
import { Quaternion } from "./three.min.js";

const FADING = 0.1; // seconds in which the old motion comes to a stop
const SHORTEST = 0.4, LONGEST = 0.9; // seconds
const FASTEST = 3.5; // radians/s, mean speed of the joint that turns most

/** From the two last poses of a motion, a frame apart: it runs out while the new one is faded in. */
export class Transition {
  constructor(before, last, next, fps) {
    Object.assign(this, { before, last, fps, frame: 0 });
    const largest = Math.max(...last.turns.map((turn, index) => turn.angleTo(next.turns[index])));
    this.frames = Math.round(fps * Math.min(LONGEST, Math.max(SHORTEST, largest / FASTEST)));
  }

  get isDone() {
    return this.frame >= this.frames;
  }

  /** The pose of the next frame, where the new motion has `pose`. */
  next(pose) {
    const share = ++this.frame / this.frames;
    const seconds = this.frame / this.fps, steps = this.fps * FADING * (1 - Math.exp(-seconds / FADING));
    return this.#runOut(steps).mixed(pose, share ** 3 * (10 + share * (6 * share - 15)));
  }

  // The old motion, so many of its last steps on.
  #runOut(steps) {
    const { before, last } = this;
    return new Pose(
      last.places.map((place, index) => place.clone().addScaledVector(place, steps).addScaledVector(before.places[index], -steps)),
      last.turns.map((turn, index) => power(turn.clone().multiply(before.turns[index].clone().invert()), steps).multiply(turn)),
    );
  }
}

/** A turn, so many times. */
function power(turn, times) {
  if (turn.w < 0) turn.set(-turn.x, -turn.y, -turn.z, -turn.w);
  const sine = Math.hypot(turn.x, turn.y, turn.z), half = times * Math.atan2(sine, turn.w);
  const scale = sine > 1e-9 ? Math.sin(half) / sine : 0;
  return new Quaternion(scale * turn.x, scale * turn.y, scale * turn.z, Math.cos(half));
}
