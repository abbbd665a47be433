// A figure as the list of its nodes, and poses of them: places and turns, those of the root in the scene.
import { Matrix4, Quaternion, Vector3 } from "./three.min.js";

const ABOVE = new Quaternion();

/** A pose. places, turns: of each node of a figure, relative to the node above it, but of the root in the scene. */
export class Pose {
  constructor(places, turns) {
    Object.assign(this, { places, turns });
  }

  /** The pose at a share of the way to another one. */
  mixed(other, share) {
    return new Pose(
      this.places.map((place, index) => place.clone().lerp(other.places[index], share)),
      this.turns.map((turn, index) => turn.clone().slerp(other.turns[index], share)),
    );
  }
}

/** A figure of a baked file. root: index of its first joint. joints: by role. height: of its joints at rest. */
export class Figure {
  constructor(scene, cloth, roles) {
    Object.assign(this, { scene, cloth, nodes: [] });
    scene.traverse((node) => node !== scene && this.nodes.push(node));
    this.root = this.nodes.indexOf(cloth.bones[0]);
    this.joints = Object.fromEntries(Object.entries(roles).map(([role, joint]) => [role, cloth.bones[joint]]));
    this.rest = cloth.bones.map((_, joint) => new Matrix4().fromArray(cloth.inverseBind, 16 * joint).invert());
    const heights = this.rest.map((matrix) => matrix.elements[13]);
    this.height = Math.max(...heights) - Math.min(...heights);
    this.unit = 1 / Math.hypot(...cloth.axes.slice(0, 3)); // of the scene, of a metre
    // The runtime's figures face along -Y at rest.
    this.forward = new Vector3(-cloth.axes[1], -cloth.axes[5], -cloth.axes[9]).normalize();
  }

  /** Height of a joint where the figure stands on the floor; ground: how much higher the floor is than at rest. */
  floorOf(joint) {
    return this.rest[this.cloth.bones.indexOf(joint)].elements[13] + (this.ground ?? -Infinity);
  }

  /** Places and turns that the nodes have now, all relative to the nodes above. */
  relative() {
    return new Pose(this.nodes.map((node) => node.position.clone()), this.nodes.map((node) => node.quaternion.clone()));
  }

  /** Give them back to the nodes. */
  setRelative(pose) {
    this.nodes.forEach((node, index) => {
      node.position.copy(pose.places[index]);
      node.quaternion.copy(pose.turns[index]);
    });
  }

  /** The pose that the nodes have now. */
  read() {
    this.scene.updateMatrixWorld(true);
    const pose = this.relative();
    this.nodes[this.root].getWorldPosition(pose.places[this.root]);
    this.nodes[this.root].getWorldQuaternion(pose.turns[this.root]);
    return pose;
  }

  /** Give a pose to the nodes. */
  write(pose) {
    // Nodes come after those above them.
    this.nodes.forEach((node, index) => {
      node.position.copy(pose.places[index]);
      node.quaternion.copy(pose.turns[index]);
      if (index !== this.root) return;
      node.parent.updateWorldMatrix(true, false);
      node.parent.worldToLocal(node.position);
      node.quaternion.premultiply(node.parent.getWorldQuaternion(ABOVE).invert());
    });
    this.scene.updateMatrixWorld(true);
  }

  /** A direction at rest, turned with a joint as it is now. */
  turned(direction, joint) {
    const rest = this.rest[this.cloth.bones.indexOf(joint)];
    const turn = joint.getWorldQuaternion(new Quaternion());
    return direction.clone().applyQuaternion(turn.multiply(new Quaternion().setFromRotationMatrix(unscaled(rest)).invert()));
  }
}

function unscaled(matrix) {
  return new Matrix4().extractRotation(matrix);
}
