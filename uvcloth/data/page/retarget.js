// Motions of other skeletons on a figure, as uvcloth/motion/retarget.py does it: turns of joints with known names.
import { rolesOf } from "./roles.js";
import { AnimationClip, Matrix4, Quaternion, QuaternionKeyframeTrack, Vector3, VectorKeyframeTrack } from "./three.min.js";

const FPS = 30;
const LONGEST = 60; // seconds that are played
const LIMB_BONES = [["thigh", "shin"], ["shin", "foot"], ["upper_arm", "forearm"], ["forearm", "hand"], ["hand", "fingers"]];
const SIDES = ["left", "right"];
const REQUIRED = ["hips", ...SIDES.flatMap((side) => [...LIMB_BONES.map(([bone]) => `${side}_${bone}`), `${side}_foot`])];
const UPRIGHT = 0.7; // cosine between the vertical and a body that stands
const FLOOR = 0.15; // share of the frames in which a foot is below the floor
const ELSEWHERE = "`uvcloth bake --motion` may take it";

/** Make an animation of a figure from a motion (bvh.js). Throws an Error with a sentence for other joints. */
export function retarget(motion, figure, name) {
  const source = rolesOf(motion.names), target = rolesOf(figure.cloth.names);
  for (const [roles, owner] of [[source, "it"], [target, "the figure"]]) {
    const missing = REQUIRED.filter((role) => !(role in roles)).map((role) => role.replace("_", " "));
    if (missing.length) throw new Error(`${owner} has no joint with a known name for the ${missing.slice(0, 3).join(", ")}; ${ELSEWHERE}`);
  }
  const axes = bodyAxes(motion.heads, source), heads = motion.heads.map((head) => head.clone().applyMatrix4(axes));
  const straight = tPose(heads, motion.parents, source), toBody = new Quaternion().setFromRotationMatrix(axes);
  const rests = restsOf(figure), own = rests.map(({ place }) => place);
  const sourceBones = bonesOf(heads, source, (role) => straight[source[role]]), targetBones = bonesOf(own, target, () => new Quaternion());
  const scale = legLength(own, target) / legLength(heads, source), poses = new Map();

  function posed(frame) {
    if (!poses.has(frame)) {
      const { turns, places } = motion.pose(frame);
      // In the axes of the body, from the T pose.
      const inBody = (turn) => toBody.clone().multiply(turn).multiply(toBody.clone().invert());
      const fromT = turns.map((turn, joint) => inBody(turn).multiply(straight[joint].clone().invert()));
      poses.set(frame, { turns: fromT, places: places.map((place) => place.applyMatrix4(axes)) });
    }
    return poses.get(frame);
  }

  const align = (role) => new Quaternion().setFromUnitVectors(targetBones[role], sourceBones[role]);
  const roleOf = new Map(Object.entries(target).filter(([role]) => role in source).map(([role, joint]) => [joint, role]));
  const count = Math.floor((Math.min(LONGEST, (motion.frames - 1) * motion.seconds) + 1e-6) * FPS) + 1;
  const frames = Array.from({ length: count }, (_, index) => {
    const time = index / FPS / motion.seconds, frame = Math.min(Math.floor(time + 1e-9), motion.frames - 1);
    const [before, after] = [posed(frame), posed(Math.min(frame + 1, motion.frames - 1))], share = Math.max(0, time - frame);
    const at = (role) => before.turns[source[role]].clone().slerp(after.turns[source[role]], share), turns = [];
    rests.forEach(({ parent }, joint) => {
      const role = roleOf.get(joint);
      if (!role) turns.push(parent < 0 ? at("hips") : turns[parent].clone());
      else turns.push(role in targetBones ? at(role).multiply(align(role)) : at(role));
    });
    const middle = meanOf(before.places, source).lerp(meanOf(after.places, source), share).multiplyScalar(scale);
    const fromHips = meanOf(own, target).sub(own[target.hips]).applyQuaternion(turns[target.hips]);
    const shoulders = meanOf(before.places, source, "upper_arm").sub(meanOf(before.places, source, "foot")).normalize();
    return { turns, hips: middle.sub(fromHips), isUpright: shoulders.z > UPRIGHT };
  });
  if (frames.filter(({ isUpright }) => isUpright).length <= 0.5 * count) throw new Error(`nobody stands in most of its frames; ${ELSEWHERE}`);
  return toClip(figure, rests, target, frames, name);
}

/** Height of the lower foot of a figure, over that at rest. */
export function footHeight({ cloth, rest }) {
  const roles = rolesOf(cloth.names), feet = SIDES.flatMap((side) => [roles[`${side}_foot`], roles[`${side}_toes`]]);
  return Math.min(
    ...feet.filter((joint) => joint !== undefined).map((joint) => cloth.bones[joint].matrixWorld.elements[13] - rest[joint].elements[13]),
  );
}

/** The joints of a figure at rest in the runtime's axes: places, turns in the scene, and parents among them. */
function restsOf({ cloth, rest }) {
  const axes = new Matrix4().fromArray(cloth.axes);
  return cloth.bones.map((bone, joint) => {
    let above = bone.parent;
    while (above && !cloth.bones.includes(above)) above = above.parent;
    const turn = new Quaternion().setFromRotationMatrix(new Matrix4().extractRotation(rest[joint]));
    return { place: new Vector3().setFromMatrixPosition(rest[joint]).applyMatrix4(axes), turn, parent: cloth.bones.indexOf(above) };
  });
}

/** Turn by right angles that takes joints of a pose that stands to Z up, facing -Y. */
function bodyAxes(heads, roles) {
  const [legs, arms] = [meanOf(heads, roles), meanOf(heads, roles, "upper_arm")], trunk = arms.clone().sub(legs), up = nearestAxis(trunk);
  const across = heads[roles.left_thigh].clone().sub(heads[roles.right_thigh]), left = nearestAxis(across.clone().addScaledVector(up, -across.dot(up)));
  const stands = SIDES.every((side) => {
    const leg = heads[roles[`${side}_foot`]].clone().sub(heads[roles[`${side}_thigh`]]);
    return -leg.dot(up) > UPRIGHT * leg.length();
  });
  if (!stands || trunk.dot(up) <= UPRIGHT * trunk.length()) throw new Error(`its zero pose does not stand; ${ELSEWHERE}`);
  return new Matrix4().makeBasis(left, up.clone().cross(left), up).transpose();
}

function nearestAxis(vector) {
  const numbers = vector.toArray(), largest = numbers.reduce((best, number, k) => (Math.abs(number) > Math.abs(numbers[best]) ? k : best), 0);
  return new Vector3().setComponent(largest, Math.sign(numbers[largest]) || 1);
}

/** Turns of the joints from the zero pose to one in which the shins point straight down. */
function tPose(heads, parents, roles) {
  const turns = heads.map(() => new Quaternion());
  for (const side of SIDES) {
    const shin = heads[roles[`${side}_foot`]].clone().sub(heads[roles[`${side}_shin`]]), leg = new Set([roles[`${side}_thigh`]]);
    parents.forEach((parent, joint) => leg.has(parent) && leg.add(joint));
    for (const joint of leg) turns[joint].setFromAxisAngle(new Vector3(0, 1, 0), Math.atan2(shin.x, -shin.z));
  }
  return turns;
}

/** Directions of the limbs' bones; a hand without fingers continues its forearm. */
function bonesOf(heads, roles, turnOf) {
  const bones = {};
  for (const side of SIDES)
    for (const [bone, tip] of LIMB_BONES) {
      const [role, end] = [`${side}_${bone}`, `${side}_${tip}`];
      bones[role] = end in roles ? heads[roles[end]].clone().sub(heads[roles[role]]).normalize().applyQuaternion(turnOf(role)) : bones[`${side}_forearm`].clone();
    }
  return bones;
}

function meanOf(places, roles, part = "thigh") {
  return places[roles[`left_${part}`]].clone().lerp(places[roles[`right_${part}`]], 0.5);
}

function legLength(heads, roles) {
  const length = (side) => heads[roles[`${side}_thigh`]].distanceTo(heads[roles[`${side}_shin`]]) + heads[roles[`${side}_shin`]].distanceTo(heads[roles[`${side}_foot`]]);
  return (length("left") + length("right")) / 2;
}

function toClip(figure, rests, target, frames, name) {
  const { bones, axes } = figure.cloth, { hips } = target, before = figure.relative();
  const toScene = new Matrix4().fromArray(axes).invert(), inScene = (place) => place.clone().applyMatrix4(toScene);
  const back = new Quaternion().setFromRotationMatrix(new Matrix4().extractRotation(toScene));
  const turns = bones.map(() => []), lowest = [];
  for (const frame of frames) {
    bones.forEach((bone, joint) => {
      const turn = back.clone().multiply(frame.turns[joint]).multiply(back.clone().invert()).multiply(rests[joint].turn);
      bone.quaternion.copy(bone.parent.getWorldQuaternion(new Quaternion()).invert().multiply(turn));
      if (joint === hips) bone.parent.worldToLocal(bone.position.copy(inScene(frame.hips)));
      turns[joint].push(...bone.quaternion.toArray());
    });
    figure.scene.updateMatrixWorld(true);
    lowest.push(footHeight(figure));
  }
  const floor = new Vector3(0, lowest.toSorted((a, b) => a - b)[Math.floor(FLOOR * (lowest.length - 1))] - figure.ground, 0);
  const places = frames.flatMap((frame) => bones[hips].parent.worldToLocal(inScene(frame.hips).sub(floor)).toArray());
  figure.setRelative(before);
  figure.scene.updateMatrixWorld(true);
  const times = frames.map((_, index) => index / FPS);
  const tracks = bones.map((bone, joint) => new QuaternionKeyframeTrack(`${bone.uuid}.quaternion`, times, turns[joint]));
  return new AnimationClip(name, -1, [...tracks, new VectorKeyframeTrack(`${bones[hips].uuid}.position`, times, places)]);
}
