// Cloth of Jolt Physics over one motion: node jolt_cloth.mjs INPUT OUTPUT FOLDER, as jolt.py calls it.
//
// INPUT: uint32 length of a JSON header, the header, then the arrays that it lists. OUTPUT: float32
// positions (F, n, 3) m. FOLDER: in which `npm install jolt-physics` ran. Prints milliseconds of
// processor time that its steps take in a frame.
import fs from 'fs';
import { createRequire } from 'module';
import { pathToFileURL } from 'url';

const [input, output, folder] = process.argv.slice(2);
const required = createRequire(pathToFileURL(`${folder}/package.json`));
const { default: initialize } = await import(pathToFileURL(required.resolve('jolt-physics/wasm')));
const Jolt = await initialize({ printErr: () => {} });
const FREE = 3.4e38;

function read(path) {
  const bytes = fs.readFileSync(path);
  const length = bytes.readUInt32LE(0);
  const header = JSON.parse(bytes.toString('utf8', 4, 4 + length));
  const arrays = {};
  let at = bytes.byteOffset + 4 + length;
  for (const { name, kind, count } of header.arrays) {
    const piece = bytes.buffer.slice(at, at + 4 * count);
    arrays[name] = kind === 'int32' ? new Int32Array(piece) : new Float32Array(piece);
    at += 4 * count;
  }
  return { header, arrays };
}

function makeWorld(gravity) {
  const settings = new Jolt.JoltSettings();
  settings.mMaxWorkerThreads = 0;
  const layers = new Jolt.ObjectLayerPairFilterTable(2);
  layers.EnableCollision(0, 1);
  const broad = new Jolt.BroadPhaseLayerInterfaceTable(2, 2);
  for (const layer of [0, 1]) broad.MapObjectToBroadPhaseLayer(layer, new Jolt.BroadPhaseLayer(layer));
  settings.mObjectLayerPairFilter = layers;
  settings.mBroadPhaseLayerInterface = broad;
  settings.mObjectVsBroadPhaseLayerFilter = new Jolt.ObjectVsBroadPhaseLayerFilterTable(broad, 2, layers, 2);
  const world = new Jolt.JoltInterface(settings);
  world.GetPhysicsSystem().SetGravity(new Jolt.Vec3(0, 0, -gravity));
  return world;
}

// Kinematic convex hulls, which move with the body's joints.
function addHulls(bodies, hulls, points, friction) {
  const point = new Jolt.Vec3(0, 0, 0), origin = new Jolt.RVec3(0, 0, 0), upright = new Jolt.Quat(0, 0, 0, 1);
  let first = 0;
  return hulls.map(({ joint, count }) => {
    const shape = new Jolt.ConvexHullShapeSettings();
    shape.mMaxConvexRadius = 0;
    for (let k = first; k < first + count; k++) {
      point.Set(points[3 * k], points[3 * k + 1], points[3 * k + 2]);
      shape.mPoints.push_back(point);
    }
    first += count;
    const made = new Jolt.BodyCreationSettings(shape.Create().Get(), origin, upright, Jolt.EMotionType_Kinematic, 0);
    made.mFriction = friction;
    made.mAllowSleeping = false;
    const body = bodies.CreateBody(made);
    bodies.AddBody(body.GetID(), Jolt.EActivation_Activate);
    return { id: body.GetID(), joint };
  });
}

function makeCloth(o, { rest, faces, mass, held, clearance, below }) {
  const count = rest.length / 3;
  const shared = new Jolt.SoftBodySharedSettings();
  const vertex = new Jolt.SoftBodySharedSettingsVertex();
  for (let i = 0; i < count; i++) {
    [vertex.mPosition.x, vertex.mPosition.y, vertex.mPosition.z] = rest.subarray(3 * i, 3 * i + 3);
    vertex.mInvMass = held[i] ? 0 : 1 / mass[i];
    shared.mVertices.push_back(vertex);
  }
  const face = new Jolt.SoftBodySharedSettingsFace(0, 0, 0, 0);
  for (let i = 0; i < faces.length; i += 3) {
    for (let k = 0; k < 3; k++) face.set_mVertex(k, faces[i + k]);
    shared.AddFace(face);
  }
  const attributes = new Jolt.SoftBodySharedSettingsVertexAttributes();
  attributes.mCompliance = o.stretch;
  attributes.mShearCompliance = o.shear;
  attributes.mBendCompliance = o.bend;
  attributes.mLRAType = Jolt[`SoftBodySharedSettings_ELRAType_${o.tether}`];
  attributes.mLRAMaxDistanceMultiplier = o.tether_length;
  shared.CreateConstraints(attributes, 1, Jolt.SoftBodySharedSettings_EBendType_Dihedral);
  // Each vertex has a "joint" of its own, which goes where the skinned garment goes. Elements of these arrays
  // cannot be made, so the arrays are resized and filled.
  const identity = Jolt.Mat44.prototype.sIdentity();
  shared.mInvBindMatrices.resize(count);
  shared.mSkinnedConstraints.resize(count);
  for (let i = 0; i < count; i++) {
    const bind = shared.mInvBindMatrices.at(i), limit = shared.mSkinnedConstraints.at(i);
    bind.mJointIndex = i;
    bind.mInvBind = identity;
    limit.mVertex = i;
    for (let k = 0; k < 4; k++) {
      limit.get_mWeights(k).mInvBindIndex = k ? 0 : i;
      limit.get_mWeights(k).mWeight = k ? 0 : 1;
    }
    const close = clearance[i] < o.tight ? o.tight_distance : FREE;
    const sloped = o.slope ? 0.005 + o.slope * below[i] : FREE;
    limit.mMaxDistance = held[i] ? 0 : Math.min(o.farthest, close, sloped);
    limit.mBackStopDistance = !held[i] && clearance[i] < o.backstop ? Math.max(0, clearance[i] - 0.003 + o.slack) : FREE;
    limit.mBackStopRadius = 40;
  }
  shared.CalculateSkinnedConstraintNormals();
  shared.Optimize();
  const made = new Jolt.SoftBodyCreationSettings(shared, new Jolt.RVec3(0, 0, 0), new Jolt.Quat(0, 0, 0, 1), 1);
  Object.assign(made, {
    mNumIterations: o.iterations, mLinearDamping: o.damping, mFriction: o.friction, mRestitution: 0,
    mUpdatePosition: false, mMakeRotationIdentity: false, mAllowSleeping: false, mMaxLinearVelocity: 100,
  });
  for (const each of [shared, made]) if ('mVertexRadius' in each) each.mVertexRadius = o.radius;
  return made;
}

function interpolate(from, to, share, first, count, into) {
  for (let k = 0; k < count; k++) into[k] = from[first + k] + share * (to[first + k] - from[first + k]);
  return into;
}

function simulate({ header, arrays }) {
  const { options: o, fps, frames, hulls } = header;
  const count = arrays.rest.length / 3, size = 3 * count;
  const world = makeWorld(o.gravity), bodies = world.GetPhysicsSystem().GetBodyInterface();
  const colliders = addHulls(bodies, hulls, arrays.hull_points, o.friction);
  const cloth = bodies.CreateSoftBody(makeCloth(o, arrays));
  bodies.AddBody(cloth.GetID(), Jolt.EActivation_Activate);
  const moving = Jolt.castObject(cloth.GetMotionProperties(), Jolt.SoftBodyMotionProperties);
  const vertices = moving.GetVertices();
  const traits = Jolt.SoftBodyVertexTraits.prototype;
  const [base, next] = [0, 1].map((i) => Jolt.getPointer(vertices.at(i)) >> 2);
  const places = traits.mPositionOffset >> 2, before = traits.mPreviousPositionOffset >> 2;
  const speeds = traits.mVelocityOffset >> 2;
  const matrices = new Jolt.ArrayMat44();
  for (let i = 0; i < count; i++) matrices.push_back(Jolt.Mat44.prototype.sIdentity());
  const moved = (Jolt.getPointer(matrices.at(0)) >> 2) + 12;
  const root = (Jolt.RMat44 ?? Jolt.Mat44).prototype.sIdentity(), allocator = world.GetTempAllocator();
  const place = new Jolt.RVec3(0, 0, 0), turn = new Jolt.Quat(0, 0, 0, 1);
  const target = new Float32Array(size), pose = new Float32Array(7);
  const at = (i) => base + i * (next - base);
  const targets = (frame) => arrays.targets.subarray(frame * size, (frame + 1) * size);
  const joints = (frame) => arrays.joints.subarray(frame * 7 * header.joints, (frame + 1) * 7 * header.joints);

  const skin = (frame, share, hard) => {
    interpolate(targets(Math.max(frame - 1, 0)), targets(frame), share, 0, size, target);
    const heap = Jolt.HEAPF32, { rest } = arrays;
    for (let i = 0; i < count; i++) for (let c = 0; c < 3; c++) heap[moved + 16 * i + c] = target[3 * i + c] - rest[3 * i + c];
    moving.SkinVertices(root, matrices.data(), count, hard, allocator);
  };
  const carry = (frame, share, seconds) => {
    for (const { id, joint } of colliders) {
      interpolate(joints(Math.max(frame - 1, 0)), joints(frame), share, 7 * joint, 7, pose);
      const norm = Math.hypot(...pose.subarray(3));
      place.Set(pose[0], pose[1], pose[2]);
      turn.Set(...pose.subarray(3).map((x) => x / norm));
      if (seconds) bodies.MoveKinematic(id, place, turn, seconds);
      else bodies.SetPositionAndRotation(id, place, turn, Jolt.EActivation_Activate);
    }
  };
  // Damping relative to the skinned garment.
  const damp = (frame, seconds) => {
    const heap = Jolt.HEAPF32, share = Math.min(1, o.follow * seconds), { held } = arrays;
    const old = targets(frame - 1), now = targets(frame);
    for (let i = 0; i < count; i++) if (!held[i]) for (let c = 0; c < 3; c++) {
      const k = at(i) + speeds + c;
      heap[k] += share * ((now[3 * i + c] - old[3 * i + c]) * fps - heap[k]);
    }
  };

  const result = new Float32Array(frames * size);
  const keep = (frame) => {
    for (let i = 0; i < count; i++) for (let c = 0; c < 3; c++) {
      result[frame * size + 3 * i + c] = Jolt.HEAPF32[at(i) + places + c];
    }
  };
  carry(0, 1, 0);
  for (let i = 0; i < count; i++) for (let c = 0; c < 3; c++) {
    Jolt.HEAPF32[at(i) + places + c] = Jolt.HEAPF32[at(i) + before + c] = arrays.targets[3 * i + c];
  }
  skin(0, 1, true);
  keep(0);
  const step = 1 / (fps * o.substeps);
  let spent = 0;
  for (let frame = 1; frame < frames; frame++) {
    for (let s = 1; s <= o.substeps; s++) {
      skin(frame, s / o.substeps, false);
      carry(frame, s / o.substeps, step);
      damp(frame, step);
      const begun = process.cpuUsage();
      world.Step(step, 1);
      const { user, system } = process.cpuUsage(begun);
      spent += user + system;
    }
    keep(frame);
  }
  console.log(spent / 1000 / Math.max(frames - 1, 1));
  return result;
}

fs.writeFileSync(output, Buffer.from(simulate(read(input)).buffer));
