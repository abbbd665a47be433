// The motion of a figure, frame after frame: an animation, smooth ways between animations, and a hand that holds it.
import { Grip } from "./grip.js";
import { AnimationMixer, Matrix4, Quaternion, Vector3 } from "./three.min.js";
import { Transition } from "./transition.js";

export const FPS = 30;
const AWAY = 0.25; // heights that the figure goes back, at most, to where an animation has it
const TURNED = 1; // radians that it turns back at most
const UP = new Vector3(0, 1, 0), ONE = new Vector3(1, 1, 1);

export class Motion {
  constructor(figure) {
    Object.assign(this, { figure, mixer: new AnimationMixer(figure.scene) });
    this.rest = figure.relative();
  }

  /** Begin with an animation, without a way from what was before. */
  begin(clip, time) {
    this.#choose(clip);
    this.frame = Math.min(Math.round(time * FPS), this.last);
    Object.assign(this, { poses: [], free: [], isFirst: true, still: null, transition: null, grip: null });
    this.turn = new Quaternion();
    this.shift = new Vector3();
  }

  /** Go over to an animation, or to another time of this one. */
  goTo(clip, time) {
    if (clip !== this.clip) this.#choose(clip);
    this.frame = Math.min(Math.round(time * FPS), this.last);
    this.#join();
  }

  /** Hold a part of the figure; `drag` then says where to. */
  hold(part) {
    this.grip = new Grip(this.figure, part, FPS);
  }

  drag(point) {
    this.grip?.drag(point);
  }

  /** Let go: the figure returns into its animation, or, where that does not play, stays as it is. */
  release(playing) {
    if (!this.grip) return;
    this.grip = null;
    if (playing) this.#join();
    else this.still = this.poses.at(-1);
  }

  /** Stay in the pose of the last frame until the animation goes on. */
  stop() {
    if (this.transition) this.still = this.poses.at(-1);
  }

  /** Whether the figure moves even while its animation does not play. */
  get isMoving() {
    return Boolean(this.grip || (this.transition && !this.still));
  }

  /** Seconds of the animation at the last frame. */
  get time() {
    return this.frame / FPS;
  }

  /** The frame of the animation that the figure is in, and the move from where it has it; null where a hand or a
   * transition has changed the pose. */
  get at() {
    if (this.grip || this.transition || this.still) return null;
    return { frame: this.frame, place: new Matrix4().compose(this.shift, this.turn, ONE) };
  }

  /** The pose of the next frame, which the nodes have then; playing: whether the animation goes on. */
  next(playing) {
    if (playing && this.still) this.#join();
    if (playing && !this.isFirst) this.#advance();
    this.isFirst = false;
    let pose = this.still ?? this.#sampled();
    if (this.transition && !this.still) pose = this.transition.next(pose);
    if (this.transition?.isDone) this.transition = null;
    this.free = [...this.free, pose].slice(-2);
    this.figure.write(pose);
    if (this.grip) {
      this.grip.apply(this.poses.at(-1) ?? pose);
      pose = this.figure.read();
    }
    this.poses = [...this.poses, pose].slice(-2);
    return pose;
  }

  #choose(clip) {
    this.mixer.stopAllAction();
    this.animated = this.rest;
    this.figure.setRelative(this.rest);
    this.mixer.clipAction(clip).play();
    this.clip = clip;
    this.last = Math.max(1, Math.floor(clip.duration * FPS + 1e-3));
  }

  // After its end an animation begins again.
  #advance() {
    if (this.frame < this.last) {
      this.frame++;
    } else {
      this.frame = 0;
      this.#join();
    }
  }

  // From the last poses into the animation. It goes on where the figure is, unless it is almost where it was.
  #join() {
    this.still = this.transition = null;
    // While a hand holds the figure, the animation goes on without it.
    const poses = this.grip ? this.free : this.poses, last = poses.at(-1);
    if (!last) return;
    const { root } = this.figure, turn = last.turns[root], place = last.places[root];
    let next = this.#sampled();
    const way = place.clone().sub(next.places[root]).setY(0);
    const back = heading(turn.clone().multiply(next.turns[root].clone().invert()));
    if (way.length() > AWAY * this.figure.height || Math.abs(back) > TURNED) {
      this.turn.premultiply(new Quaternion().setFromAxisAngle(UP, back));
      next = this.#sampled();
      this.shift.add(place.clone().sub(next.places[root]).setY(0));
      next = this.#sampled();
    }
    this.transition = new Transition(poses[0], last, next, FPS);
  }

  // The animation, turned and moved to where the figure has come.
  #sampled() {
    // The mixer writes what changes, so the nodes have to be as it has left them.
    this.figure.setRelative(this.animated);
    // At its end an animation that repeats is at its beginning.
    this.mixer.setTime(Math.min(this.time, this.clip.duration - 1e-6));
    this.animated = this.figure.relative();
    const pose = this.figure.read(), { root } = this.figure;
    pose.places[root].applyQuaternion(this.turn).add(this.shift);
    pose.turns[root].premultiply(this.turn);
    return pose;
  }
}

/** The part of a turn that is about the vertical, radians. */
function heading(turn) {
  const angle = 2 * Math.atan2(turn.y, turn.w);
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
