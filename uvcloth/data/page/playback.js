// Playing of an animation with its cloth: the cloth has fixed frames, the display shows what is between two of them.
import { AnimationMixer } from "./three.min.js";

export const FPS = 30;
const AHEAD = 3; // frames of cloth that are asked for before they are shown
let count = 0;
const SLOW = 0.1; // seconds that the display takes at most for one turn

export class Playback {
  /** onFrame: called with every frame of cloth: {frame, joints, vertices, milliseconds}. onError: with a sentence. */
  constructor(gltf, cloth, clip, onFrame, onError) {
    Object.assign(this, { gltf, cloth, clip, onFrame, onError });
    Object.assign(this, { number: count++, speed: 1, playing: true, isStarting: false, time: 0, run: 0, frames: [], wanted: null });
    this.mixer = new AnimationMixer(gltf.scene);
    this.mixer.clipAction(clip).play();
    this.last = Math.max(1, Math.floor(clip.duration * FPS + 1e-3));
  }

  /** Begin at a time of the animation, with cloth at rest there; what is shown stays until it has come to rest. */
  async restart(time) {
    this.wanted = time;
    if (this.isStarting) return; // It goes to the last time that was wanted, not to each.
    this.isStarting = true;
    while (this.wanted !== null) {
      const first = Math.min(Math.round(this.wanted * FPS), this.last - 1);
      Object.assign(this, { wanted: null, time: first / FPS, next: first, run: this.run + 1, frames: [] });
      const joints = this.#joints(first);
      this.#pose(this.shown ?? this.time);
      try {
        await this.cloth.start(joints, first === 0 ? this.number : null);
      } catch (error) {
        this.onError(error.message);
      }
    }
    this.isStarting = false;
    this.#ask();
  }

  /** Go on by seconds of the clock, and pose the character and its cloth. */
  advance(seconds) {
    if (this.isStarting) return;
    if (this.frames.length) {
      const ready = this.frames.at(-1).frame / FPS; // Slower where the cloth is not ready.
      if (this.playing) this.time = Math.min(this.time + this.speed * Math.min(seconds, SLOW), ready);
      while (this.frames.length > 2 && this.frames[1].frame <= this.time * FPS) this.frames.shift();
      const [from, to = from] = this.frames;
      const share = to === from ? 0 : (this.time * FPS - from.frame) / (to.frame - from.frame);
      this.cloth.show(from.vertices, to.vertices, Math.min(1, Math.max(0, share)));
      this.shown = this.time;
    }
    this.#ask();
    this.#pose(this.shown ?? this.time);
    if (this.playing && this.shown >= this.last / FPS - 1e-6) this.restart(0);
  }

  #ask() {
    while (this.next <= this.last && this.next <= this.time * FPS + AHEAD) this.#step(this.next++);
  }

  async #step(frame) {
    const run = this.run, joints = this.#joints(frame);
    let answer;
    try {
      answer = await this.cloth.step(joints, 1 / FPS);
    } catch (error) {
      if (run !== this.run) return;
      this.onError(error.message);
      // The cloth stays as it was, and the animation goes on.
      answer = this.frames.at(-1);
      if (!answer) return;
    }
    if (run !== this.run) return;
    this.frames.push({ ...answer, frame });
    this.onFrame?.({ ...answer, frame, joints });
  }

  #joints(frame) {
    this.#pose(frame / FPS);
    return this.cloth.transforms();
  }

  #pose(time) {
    // At its end an animation that repeats is at its beginning.
    this.mixer.setTime(Math.min(time, this.clip.duration - 1e-6));
    this.gltf.scene.updateMatrixWorld(true);
  }
}
