// A hand that holds a figure: the hips, or the end of an arm or a leg, follow a point, and the rest of it follows them.
import { Limb, placeOf, soft, turn } from "./limb.js";
import { Quaternion, Vector3 } from "./three.min.js";

const FOLLOWING = 0.07; // seconds in which the point is approached
const FASTEST = 1.8; // heights a second
const TURNING = 12; // radians/s, of a joint at most
const LEASH = 0.1; // heights that the hips go sideways before the feet follow
const CROUCH = 0.26, RISE = 0.01; // heights that the hips go down at most, and up before the feet follow
const LEAN = 0.7; // radians that the back leans to a point out of reach
const RAISED = 4; // times at most that a foot is taken off the floor in a frame
const TORSO = 0.085; // heights around the spine that hands stay out of
const UP = new Vector3(0, 1, 0);

const LIMBS = {
  hand: { roles: ["upper_arm", "forearm", "hand"], front: -1, angle: 1.9, axis: [0.7, -0.2, 0.7] },
  foot: { roles: ["thigh", "shin", "foot"], front: 1, angle: 1.3, axis: [0.2, -1, 0.6] },
};
/** What limits each limb: the cone about an axis at rest (outwards, upwards, forwards) in which its end stays. */

const SPINE = ["lower_spine", "middle_spine", "upper_spine"];

/** Parts of a figure that can be held, by name, with the joint of each. */
export function partsOf(figure) {
  const { joints } = figure, parts = { hips: figure.cloth.bones[0] };
  for (const side of ["left", "right"])
    for (const [end, { roles }] of Object.entries(LIMBS))
      if (roles.every((role) => joints[`${side}_${role}`])) parts[`${side}_${end}`] = joints[`${side}_${end}`];
  return parts;
}

export class Grip {
  constructor(figure, part, fps) {
    Object.assign(this, { figure, part, fps, feet: new Vector3(), turning: new Set() });
    this.limbs = Object.fromEntries(
      Object.keys(partsOf(figure)).filter((name) => name !== "hips").map((name) => [name, this.#limb(name)]),
    );
    this.hips = figure.cloth.bones[0];
    this.point = placeOf(partsOf(figure)[part]);
    this.wanted = this.point.clone();
    this.carried = placeOf(this.hips); // where the animation alone would have the figure, on its height when it was taken
    this.spine = SPINE.map((role) => figure.joints[role]).filter(Boolean);
    this.neck = figure.joints.lower_neck ?? figure.joints.head ?? this.hips;
  }

  /** Say where the hand is, in the scene. */
  drag(point) {
    this.wanted.copy(point);
  }

  /** Change the nodes, which have the pose of a frame; last: the pose before it. */
  apply(last) {
    this.turning.clear();
    this.levels = this.#levels();
    const place = placeOf(this.hips), limb = this.limbs[this.part];
    this.#approach(place);
    if (!limb) {
      this.#moveHips(this.point.clone().sub(place));
    } else {
      const end = this.part.endsWith("hand") ? this.#lean(limb) : this.point;
      const over = end.clone().sub(placeOf(limb.upper)).setLength(limb.beyond(end));
      if (over.lengthSq()) this.#moveHips(over);
      this.#reach(this.part, end);
    }
    this.#slow(last);
  }

  // Smoothly, and not faster than cloth follows; the point goes along with the animation.
  #approach(place) {
    const carried = place.clone().setY(this.carried.y);
    this.point.add(carried).sub(this.carried);
    this.carried = carried;
    const way = this.wanted.clone().sub(this.point).multiplyScalar(1 - Math.exp(-1 / (FOLLOWING * this.fps)));
    this.point.add(way.clampLength(0, (FASTEST * this.figure.height) / this.fps));
  }

  // The hips move; the feet stay until they are pulled along, over the floor or off it.
  #moveHips(way) {
    const { height } = this.figure;
    way.y = way.y < 0 ? -soft(-way.y, CROUCH * height) : way.y;
    const pulled = way.clone().sub(this.feet).setY(0), far = pulled.length();
    if (far > LEASH * height) this.feet.addScaledVector(pulled, 1 - (LEASH * height) / far);
    this.feet.y = Math.max(0, way.y - RISE * height);
    const feet = Object.keys(this.limbs).filter((name) => name.endsWith("foot") && name !== this.part);
    const stood = feet.map((name) => ({ name, place: placeOf(this.limbs[name].end), turn: worldTurn(this.limbs[name].end) }));
    this.hips.parent.worldToLocal(this.hips.position.copy(placeOf(this.hips).add(way)));
    this.hips.updateMatrixWorld(true);
    for (const { name, place, turn: before } of stood) {
      this.#reach(name, place.add(this.feet));
      const { end } = this.limbs[name];
      turn(end, before.multiply(worldTurn(end).invert()));
      this.turning.add(end);
    }
  }

  // The back leans to a point that is out of the arm's reach. Returns the point, outside of the torso.
  #lean(limb) {
    const from = placeOf(this.spine[0] ?? this.hips), arm = placeOf(limb.upper).sub(from);
    const over = limb.beyond(this.point), axis = arm.clone().cross(this.point.clone().sub(from));
    if (over > 0 && axis.lengthSq() > 0) {
      const by = new Quaternion().setFromAxisAngle(axis.normalize(), soft(over / arm.length(), LEAN) / this.spine.length);
      for (const joint of this.spine) {
        turn(joint, by);
        this.turning.add(joint);
      }
    }
    return this.#outside(this.point);
  }

  #outside(point) {
    const low = placeOf(this.hips), along = placeOf(this.neck).sub(low);
    const share = Math.min(1, Math.max(0, point.clone().sub(low).dot(along) / along.lengthSq()));
    const axis = low.addScaledVector(along, share), out = point.clone().sub(axis), least = TORSO * this.figure.height;
    if (out.length() >= least) return point;
    // Rather in front of it than behind.
    out.addScaledVector(this.figure.turned(this.figure.forward, this.hips), 1.5 * (least - out.length()));
    return axis.add(out.setLength(least));
  }

  // Heights that feet and toes do not go below: the floor's, or where the animation has them.
  #levels() {
    const { figure } = this, levels = new Map();
    for (const side of ["left", "right"])
      for (const role of ["foot", "toes"]) {
        const joint = figure.joints[`${side}_${role}`];
        if (joint) levels.set(joint, Math.min(figure.floorOf(joint), placeOf(joint).y));
      }
    return levels;
  }

  // How far a foot, or its toes, are below their levels.
  #below(name) {
    const [side] = name.split("_"), joints = ["foot", "toes"].map((role) => this.figure.joints[`${side}_${role}`]);
    return Math.max(0, ...joints.filter(Boolean).map((joint) => this.levels.get(joint) - placeOf(joint).y));
  }

  #reach(name, point) {
    const limb = this.limbs[name];
    limb.reach(point, name.endsWith("foot") ? this.hips : (this.spine.at(-1) ?? this.hips));
    // Raised as often as that turns its toes down again.
    for (let turn = 0, below; name.endsWith("foot") && turn < RAISED && (below = this.#below(name)) > 0; turn++)
      limb.reach((point = point.clone().setY(point.y + below)), this.hips);
    this.turning.add(limb.upper).add(limb.lower);
  }

  // Where a joint would snap over, it turns there at a speed that cloth follows.
  #slow(last) {
    const { nodes } = this.figure;
    for (const joint of this.turning) {
      const wanted = joint.quaternion.clone();
      joint.quaternion.copy(last.turns[nodes.indexOf(joint)]).rotateTowards(wanted, TURNING / this.fps);
    }
  }

  #limb(name) {
    const [side, end] = name.split("_"), { roles, front, angle, axis } = LIMBS[end], { figure } = this;
    const out = UP.clone().cross(figure.forward).multiplyScalar(side === "left" ? axis[0] : -axis[0]);
    return new Limb(
      figure,
      roles.map((role) => figure.joints[`${side}_${role}`]),
      figure.forward.clone().multiplyScalar(front),
      out.addScaledVector(UP, axis[1]).addScaledVector(figure.forward, axis[2]).normalize(),
      angle,
    );
  }
}

function worldTurn(node) {
  return node.getWorldQuaternion(new Quaternion());
}
