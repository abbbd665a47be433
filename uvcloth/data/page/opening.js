// Opening of a baked file: its scene, its cloth and the animations that move it.
import { makeCloth } from "./cloth.js";
import { GLTFLoader } from "./three.min.js";

const OF_FILE = "glTF", GLB = 0x46546c67;

/** Open the bytes of a .glb with its cloth in a worker. Throws an Error with a sentence if it cannot be played. */
export async function openBaked(bytes, worker, wasm) {
  checkWhole(bytes);
  const gltf = await new GLTFLoader().parseAsync(bytes, ""), cloth = await makeCloth(gltf, worker, wasm);
  const animations = gltf.animations.filter((clip) => moves(clip, cloth.bones));
  if (!animations.length) throw new Error(gltf.animations.length ? "its animations move other joints than those of its cloth" : "it has no animation");
  return { gltf, cloth, animations };
}

// What the loader of three.js says of a cut file is no sentence for readers.
function checkWhole(bytes) {
  const head = new DataView(bytes);
  if (bytes.byteLength < 20 || head.getUint32(0, true) !== GLB) throw new Error(`it is no binary ${OF_FILE} (.glb)`);
  const size = head.getUint32(8, true);
  if (size > bytes.byteLength) throw new Error(`it is cut: ${bytes.byteLength} of ${size} bytes are there`);
}

/** Whether an animation moves joints, or what they hang on. */
function moves(clip, joints) {
  const names = new Set();
  for (let node of joints) for (; node; node = node.parent) names.add(node.name || node.uuid);
  return clip.duration > 0 && clip.tracks.some(({ name }) => names.has(name.slice(0, name.lastIndexOf("."))));
}
