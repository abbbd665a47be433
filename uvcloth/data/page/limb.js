// Two-bone inverse kinematics: an arm or a leg is bent so that its end is at a point.
import { Quaternion, Vector3 } from "./three.min.js";

const STRAIGHT = 0.995, FOLDED = 0.35; // of the length of both bones, distances of the end at most and at least
const SOFT = 0.15; // of a limit, in which it is approached ever more slowly

/** A limb of three joints. Its middle one is bent towards `front`, a direction at rest, where it is straight. */
export class Limb {
  constructor(figure, [upper, lower, end], front, axis, angle) {
    Object.assign(this, { figure, upper, lower, end, front, axis, angle });
    const [a, b, c] = this.#places();
    this.length = a.distanceTo(b) + b.distanceTo(c);
  }

  /** How far a point is out of reach. */
  beyond(point) {
    return Math.max(0, this.#places()[0].distanceTo(point) - STRAIGHT * this.length);
  }

  /** Bring the end as close to a point as its joints allow. above: the joint whose turn limits those of the limb. */
  reach(point, above) {
    let [a, b, c] = this.#places();
    const way = this.#allowed(point.clone().sub(a), above), distance = way.length();
    const [first, second] = [a.distanceTo(b), b.distanceTo(c)];
    // The plane of the bend: that which it has, or where it is straight that in which knees and elbows bend.
    const usual = this.figure.turned(this.front, this.upper).cross(c.clone().sub(a));
    const bend = b.clone().sub(a).cross(c.clone().sub(b));
    const normal = bend.addScaledVector(usual, -0.1 * first).normalize();
    const cosine = (first ** 2 + second ** 2 - distance ** 2) / (2 * first * second);
    const wanted = Math.PI - Math.acos(Math.min(1, Math.max(-1, cosine)));
    const has = signedAngle(b.clone().sub(a), c.clone().sub(b), normal);
    turn(this.lower, new Quaternion().setFromAxisAngle(normal, wanted - has));
    [a, b, c] = this.#places();
    turn(this.upper, new Quaternion().setFromUnitVectors(c.sub(a).normalize(), way.normalize()));
  }

  // A way from the first joint within its cone and the limb's reach.
  #allowed(way, above) {
    const axis = this.figure.turned(this.axis, above), angle = way.angleTo(axis), within = soft(angle, this.angle);
    const distance = Math.max(FOLDED * this.length, soft(way.length(), STRAIGHT * this.length));
    const around = axis.clone().cross(way).normalize();
    if (within < angle && around.lengthSq() > 0.5) way = axis.clone().applyAxisAngle(around, within);
    return way.setLength(distance);
  }

  #places() {
    return [this.upper, this.lower, this.end].map(placeOf);
  }
}

export function placeOf(node) {
  return new Vector3().setFromMatrixPosition(node.matrixWorld);
}

/** Turn a node, and all below it, by a turn of the scene. */
export function turn(node, by) {
  const above = node.parent.getWorldQuaternion(new Quaternion());
  node.quaternion.premultiply(above.clone().invert().multiply(by).multiply(above));
  node.updateMatrixWorld(true);
}

/** A number that approaches a limit and does not pass it. */
export function soft(number, limit) {
  const room = SOFT * limit, over = number - (limit - room);
  return over <= 0 ? number : limit - room * Math.exp(-over / room);
}

function signedAngle(from, to, normal) {
  return Math.atan2(from.clone().cross(to).dot(normal), from.dot(to));
}
