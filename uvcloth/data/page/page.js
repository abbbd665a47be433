// The page: its controls, and the loop that draws.
import { makeCloth } from "./cloth.js";
import { readBvh } from "./bvh.js";
import { CageLines } from "./cage.js";
import { lowerSkin } from "./covered.js";
import { Figure } from "./figure.js";
import { bytesOf, makeWorker } from "./files.js";
import { Hand } from "./hand.js";
import { Playback } from "./playback.js";
import { footHeight, retarget } from "./retarget.js";
import { rolesOf } from "./roles.js";
import { hasVectors } from "./runtime.js";
import { Stage } from "./scene.js";
import { StrainMap } from "./strain.js";
import { GLTFLoader } from "./three.min.js";

const OF_FILE = "glTF", GLB = 0x46546c67;
const control = (name) => document.getElementById(name);
const AVERAGED = 30; // frames
const PICTURE = 1 / AVERAGED; // share of a picture in the mean of the last ones
const pictures = { shown: 0, drawn: 0 }; // milliseconds

let stage, updateSkin, hand, playback, view, cloth, animations, wasm, current, costs = [], opening = 0, isOpening = false;

function say(sentence) {
  control("message").textContent = sentence;
}

/** Load the .glb of an option of the list and play it; if it cannot be, what was shown plays on. */
async function open(option) {
  const turn = ++opening;
  control("busy").hidden = false;
  isOpening = true;
  let worker;
  try {
    const bytes = await (option.content ? option.content.arrayBuffer() : bytesOf(option.value));
    checkWhole(bytes);
    const gltf = await new GLTFLoader().parseAsync(bytes, "");
    worker = makeWorker();
    wasm ??= await bytesOf("uvcloth.wasm");
    const opened = await makeCloth(gltf, worker, wasm);
    const moving = gltf.animations.filter((clip) => moves(clip, opened.bones));
    if (!moving.length) throw new Error(gltf.animations.length ? "its animations move other joints than those of its cloth" : "it has no animation");
    if (turn !== opening) return worker.terminate();
    cloth?.worker.terminate();
    cloth = opened;
    stage.show(gltf);
    animations = moving;
    listAnimations();
    say("");
    if (control("fabric").value) changeFabric();
    changeWorld();
    begin(gltf);
    stage.frame();
    if (!option.parentNode) control("character").append(option);
    option.selected = true;
    current = option;
  } catch (error) {
    worker?.terminate();
    if (turn !== opening) return;
    if (current) current.selected = true;
    say(`${option.text}: ${error.message}`);
  } finally {
    if (turn === opening) isOpening = false;
    control("busy").hidden = !isOpening;
  }
}

/** Whether an animation moves joints, or what they hang on. */
function moves(clip, joints) {
  const names = new Set();
  for (let node of joints) for (; node; node = node.parent) names.add(node.name || node.uuid);
  return clip.duration > 0 && clip.tracks.some(({ name }) => names.has(name.slice(0, name.lastIndexOf("."))));
}

// What the loader of three.js says of a cut file is no sentence for readers.
function checkWhole(bytes) {
  const head = new DataView(bytes);
  if (bytes.byteLength < 20 || head.getUint32(0, true) !== GLB) throw new Error(`it is no binary ${OF_FILE} (.glb)`);
  const size = head.getUint32(8, true);
  if (size > bytes.byteLength) throw new Error(`it is cut: ${bytes.byteLength} of ${size} bytes are there`);
}

function begin(gltf) {
  const { playing = true } = playback ?? {}, figure = new Figure(gltf.scene, cloth, rolesOf(cloth.names));
  updateSkin = lowerSkin(figure);
  playback = new Playback(figure, count, say);
  Object.assign(playback, { playing, speed: Number(control("speed").value) });
  playback.start(animations[0], 0);
  figure.ground = footHeight(figure); // Where animations from elsewhere put it.
  control("time").max = playback.last;
  hand.show(playback);
  view?.cage.remove();
  view = {
    cage: new CageLines(stage, cloth.cages.corners, cloth.cages.vertices),
    strain: new StrainMap(cloth.garments),
  };
  listGarments();
  changeLayer();
  globalThis.uvcloth = { cloth, playback, stage, hand, view }; // for the browser's console
}

function play(clip, time) {
  playback.goTo(clip, time);
  control("time").max = playback.last;
}

function listAnimations() {
  const named = animations.map((clip, index) => new Option(clip.name || `animation ${index + 1}`, index));
  control("animation").replaceChildren(...named);
  control("animation").closest("label").hidden = named.length < 2;
}

function count({ parts }) {
  costs = [...costs, parts].slice(-AVERAGED);
  const mean = (name) => costs.reduce((sum, each) => sum + each[name], 0) / costs.length;
  const text = (name) => mean(name).toFixed(1), beside = mean("pose") + mean("vertices");
  control("milliseconds").textContent =
    `${text("cloth")} ms per frame of cloth, ${beside.toFixed(1)} for its pose and its vertices; ` +
    `${pictures.shown.toFixed(1)} to show a picture, ${pictures.drawn.toFixed(1)} to draw it`;
}

function listGarments() {
  const boxes = cloth.garments.map((garment, index) => {
    const label = document.createElement("label"), box = document.createElement("input");
    Object.assign(box, { type: "checkbox", checked: true });
    box.addEventListener("change", () => {
      garment.isShown = box.checked;
      updateSkin();
    });
    label.append(box, garment.node.name.replaceAll("_", " ") || `garment ${index + 1}`);
    return label;
  });
  control("garments").replaceChildren(...boxes.reverse()); // The outermost on top.
}

function changeLayer() {
  const { value } = control("layer");
  if (view) [view.strain.isShown, view.cage.isShown] = [value === "strain", value === "cage"];
  control("legend").hidden = value !== "strain";
}

function changeWorld() {
  const value = (name) => Number(control(name).value);
  for (const name of ["wind-x", "wind-y", "gravity", "speed"]) control(name).nextElementSibling.value = value(name);
  playback?.wake();
  cloth?.setWorld([value("wind-x"), value("wind-y"), 0], [0, 0, -value("gravity")]).catch((error) => say(error.message));
}

function changeFabric() {
  const { value } = control("fabric");
  playback?.wake();
  cloth?.setFabric(value && value.split(" ").map(Number)).catch((error) => say(error.message));
}

function togglePlaying() {
  if (!playback) return;
  playback.toggle();
}

/** Play the motion of a BVH file on the figure, as one more of its animations. */
async function addMotion(file) {
  try {
    if (!playback) throw new Error("there is no figure to play it yet");
    const { figure } = playback, clip = retarget(readBvh(await file.text()), figure, file.name);
    if (figure !== playback.figure) return;
    animations.push(clip);
    listAnimations();
    control("animation").value = animations.length - 1;
    say("");
    play(clip, 0);
  } catch (error) {
    say(`${file.name}: ${error.message}`);
  }
}

function openFile(file) {
  if (!file) return;
  if (file.name.toLowerCase().endsWith(".bvh")) return addMotion(file);
  const { options } = control("character");
  const option = [...options].find((each) => each.text === file.name) ?? new Option(file.name, "");
  option.content = file;
  open(option);
}

function openChosen() {
  open(control("character").selectedOptions[0]);
}

function connect() {
  control("controls").open = !matchMedia("(max-width: 600px)").matches;
  const on = (name, kind, act) => control(name).addEventListener(kind, act);
  on("play", "click", togglePlaying);
  on("time", "input", () => playback && play(playback.clip, Number(control("time").value)));
  on("speed", "input", () => {
    if (playback) playback.speed = Number(control("speed").value);
    changeWorld();
  });
  for (const name of ["wind-x", "wind-y", "gravity"]) on(name, "input", changeWorld);
  on("fabric", "change", changeFabric);
  on("layer", "change", changeLayer);
  on("character", "change", openChosen);
  on("animation", "change", () => play(animations[Number(control("animation").value)], 0));
  on("file", "change", () => openFile(control("file").files[0]));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    openFile(event.dataTransfer.files[0]);
  });
  addEventListener("keydown", (event) => {
    if (event.key !== " " || event.target.closest("button, select, input, summary")) return;
    event.preventDefault();
    togglePlaying();
  });
}

let before = performance.now();

function draw(now) {
  const seconds = Math.max(0, now - before) / 1e3;
  before = now;
  if (playback) {
    const begun = performance.now();
    playback.advance(seconds);
    hand.follow();
    if (control("layer").value === "strain") view.strain.update();
    if (playback.shownCages) view.cage.update(...playback.shownCages);
    const isReady = performance.now();
    control("play").textContent = playback.playing ? "Pause" : "Play";
    if (document.activeElement !== control("time") || playback.playing) control("time").value = playback.time;
    control("clock").textContent = `${playback.time.toFixed(1)} s`;
    // Before the cloth has come to rest there is nothing to draw: the picture before stays.
    const isShown = playback.shown !== undefined;
    if (isShown) stage.draw(playback.followed, seconds);
    pictures.shown += PICTURE * (isReady - begun - pictures.shown);
    pictures.drawn += PICTURE * (performance.now() - isReady - pictures.drawn);
    if (!isOpening) control("busy").hidden = isShown && !playback.isStarting;
  }
  requestAnimationFrame(draw);
}

function boot() {
  if (!hasVectors()) return say("This browser has no WebAssembly with vectors (SIMD), which the cloth needs.");
  try {
    stage = new Stage(control("view"));
  } catch {
    return say("This browser shows no WebGL, which the page draws with.");
  }
  hand = new Hand(stage);
  connect();
  openChosen();
  requestAnimationFrame(draw);
}

boot();
