// BVH files: joints, and their turns and places in the file's own axes and unit, frame after frame.
import { Quaternion, Vector3 } from "./three.min.js";

const AXES = { x: new Vector3(1, 0, 0), y: new Vector3(0, 1, 0), z: new Vector3(0, 0, 1) };
const SLOWEST = 0.5; // s, of a frame

/** Read a BVH file: {names, parents, heads, seconds, frames}: heads of the zero pose, seconds of a frame; frames is their
 * number, and `pose(frame)` has {turns, places} of each joint in the world. Throws an Error with a sentence. */
export function readBvh(text) {
  const [hierarchy, motion] = text.split(/^\s*MOTION\s*$/im);
  if (motion === undefined) throw new Error("it is no complete BVH file: it has no MOTION");
  const joints = readJoints(hierarchy);
  const [, count, seconds, rest] = /^\s*Frames:\s*(\d+)\s*Frame Time:\s*(\S+)\s*([\s\S]*)$/i.exec(motion) ?? [];
  if (!(Number(count) > 0) || !(Number(seconds) > 0 && Number(seconds) <= SLOWEST))
    throw new Error("its MOTION has no readable number of frames or frame time");
  const values = Float64Array.from(rest.trim().split(/\s+/), Number), width = joints.reduce((sum, joint) => sum + joint.channels.length, 0);
  if (values.length !== width * Number(count) || !values.every(Number.isFinite))
    throw new Error(`it is cut or damaged: expected ${count} frames of ${width} numbers`);
  return new Motion(joints, values, width, unrounded(Number(seconds)), Number(count));
}

/** The time of a frame of which there are a whole number in a second, without a file's rounding. */
function unrounded(seconds) {
  const fps = Math.round(1 / seconds);
  return Math.abs(1 / seconds - fps) < 1e-4 * fps ? 1 / fps : seconds;
}

function readJoints(text) {
  const joints = [], open = [], words = text.replace(/[{}]/g, " $& ").split(/\s+/).filter(Boolean);
  const take = (number) => words.splice(0, number);
  const damaged = () => new Error("its HIERARCHY is damaged");
  while (words.length) {
    const [word] = take(1), joint = joints[open.at(-1)];
    switch (word.toUpperCase()) {
      case "ROOT":
      case "JOINT":
        joints.push({ name: take(words.indexOf("{")).join(" "), parent: open.at(-1) ?? -1, offset: new Vector3(), channels: [] });
        open.push(joints.length - 1);
        break;
      case "END":
        take(1);
        open.push(-1);
        break;
      case "OFFSET":
        joint?.offset.fromArray(take(3).map(Number));
        break;
      case "CHANNELS":
        if (!joint) throw damaged();
        joint.channels = take(Number(take(1)[0])).map((name) => name.toLowerCase());
        break;
      case "}":
        open.pop();
    }
  }
  const isKnown = (name) => /^[xyz](position|rotation)$/.test(name);
  const isWhole = ({ offset, channels }) => offset.toArray().every(Number.isFinite) && channels.every(isKnown);
  if (!joints.length || open.length || !joints.every(isWhole)) throw damaged();
  return joints;
}

class Motion {
  constructor(joints, values, width, seconds, frames) {
    Object.assign(this, { values, width, seconds, frames });
    this.names = joints.map(({ name }) => name);
    this.parents = joints.map(({ parent }) => parent);
    let column = 0;
    this.joints = joints.map((joint) => ({ ...joint, first: (column += joint.channels.length) - joint.channels.length }));
    for (const joint of this.joints) joint.moves = this.#moves(joint);
    this.heads = [];
    for (const joint of this.joints) this.heads.push(this.#offset(joint).add(this.heads[joint.parent] ?? new Vector3()));
  }

  pose(frame) {
    const turns = [], places = [];
    for (const joint of this.joints) {
      const turn = new Quaternion(), place = joint.offset.clone();
      joint.channels.forEach((name, index) => {
        const value = this.values[frame * this.width + joint.first + index];
        if (name.endsWith("rotation")) turn.multiply(new Quaternion().setFromAxisAngle(AXES[name[0]], (value * Math.PI) / 180));
        else if (joint.moves) place[name[0]] = value;
      });
      const above = turns[joint.parent];
      turns.push(above ? above.clone().multiply(turn) : turn);
      places.push(above ? place.applyQuaternion(above).add(places[joint.parent]) : place);
    }
    return { turns, places };
  }

  // Places of a bone that are all zero are none.
  #moves({ parent, channels, first }) {
    const columns = channels.flatMap((name, index) => (name.endsWith("position") ? [first + index] : []));
    const isSet = (column) => this.values.some((value, index) => index % this.width === column && value !== 0);
    return columns.length > 0 && (parent < 0 || columns.some(isSet));
  }

  // In the zero pose a bone that moves is as long as in the mean.
  #offset({ parent, offset, channels, first, moves }) {
    const out = offset.clone();
    if (parent < 0 || !moves) return out;
    channels.forEach((name, index) => {
      if (!name.endsWith("position")) return;
      let sum = 0;
      for (let frame = 0; frame < this.frames; frame++) sum += this.values[frame * this.width + first + index];
      out[name[0]] = sum / this.frames;
    });
    return out;
  }
}
