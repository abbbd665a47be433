// Plays an outfit in WebAssembly: node play.mjs MODULE OUTFIT MOTION VERTICES, files as in docs/runtime.md.
import { readFileSync, writeFileSync } from "node:fs";
import { performance } from "node:perf_hooks";
import { WASI } from "node:wasi";

const [path, outfitPath, motionPath, out] = process.argv.slice(2);
const wasi = new WASI({ version: "preview1" });
const module = await WebAssembly.compile(readFileSync(path));
const instance = await WebAssembly.instantiate(module, wasi.getImportObject());
wasi.initialize(instance);
const core = instance.exports;

const ROOM = 160;
const message = core.malloc(ROOM);
const bytes = (place, size) => new Uint8Array(core.memory.buffer, place, size);

function put(content) {
    const place = core.malloc(content.length);
    bytes(place, content.length).set(content);
    return place;
}

function check(result) {
    if (result) return result;
    const sentence = bytes(message, ROOM);
    throw new Error(Buffer.from(sentence.subarray(0, sentence.indexOf(0))).toString());
}

const content = readFileSync(outfitPath), motion = readFileSync(motionPath);
const outfit = check(core.uvc_read(put(content), content.length, message, ROOM));
const joints = put(motion), row = 96 * core.uvc_joints(outfit);
const size = 24 * core.uvc_garment_vertices(outfit, 0);
const cloth = core.uvc_new(outfit), vertices = core.malloc(size), frames = [];
check(core.uvc_start(cloth, joints, message, ROOM));
let milliseconds = 0;
for (let place = 0; place < motion.length; place += row) {
    const begun = performance.now();
    check(core.uvc_step(cloth, joints + place, 1 / 30, message, ROOM));
    core.uvc_vertices(cloth, 0, vertices);
    milliseconds += performance.now() - begun;
    frames.push(Buffer.from(bytes(vertices, size)));
}
writeFileSync(out, Buffer.concat(frames));
console.log(`${(milliseconds / frames.length).toFixed(1)} ms a frame in WebAssembly`);
