// The page: its controls, and the loop that draws.
import { Beside } from "./beside.js";
import { readBvh } from "./bvh.js";
import { lowerSkin } from "./covered.js";
import { Comparison } from "./comparison.js";
import { Figure } from "./figure.js";
import { bytesOf, makeWorker } from "./files.js";
import { GripKeys } from "./keys.js";
import { Hand } from "./hand.js";
import { methodsOf } from "./methods.js";
import { FPS } from "./motion.js";
import { openBaked } from "./opening.js";
import { Overlays } from "./overlays.js";
import { Playback } from "./playback.js";
import { footHeight, retarget } from "./retarget.js";
import { rolesOf } from "./roles.js";
import { hasVectors } from "./runtime.js";
import { Stage } from "./scene.js";

const control = (name) => document.getElementById(name);
const AVERAGED = 30; // frames
const PICTURE = 1 / AVERAGED; // share of a picture in the mean of the last ones
const TOO_LONG = 1000 / FPS; // milliseconds that a frame of cloth takes where its playback slows down
const NARROW = "(max-width: 600px)";
const MARGIN = 12; // pixels around the panes
const retargeted = new WeakSet(); // animations of .bvh files
const pictures = { shown: 0, drawn: 0 }; // milliseconds

let stage, updateSkin, hand, keys, playback, beside, comparison, overlays, opened, animations, wasm, current, costs = [], opening = 0, showing = 0, isOpening = false;

function say(sentence) {
  control("message").textContent = sentence;
}

/** Load the .glb of an option of the list and play it; if it cannot be, what was shown plays on. */
async function open(option) {
  const turn = ++opening;
  control("busy").hidden = false;
  isOpening = true;
  const worker = makeWorker();
  try {
    const bytes = await (option.content ? option.content.arrayBuffer() : bytesOf(option.value));
    wasm ??= await bytesOf("uvcloth.wasm");
    const made = await openBaked(bytes, worker, wasm);
    if (turn !== opening) return worker.terminate();
    close();
    opened = made;
    animations = [...made.animations];
    stage.show(made.gltf);
    listAnimations();
    say("");
    await begin(JSON.parse(option.dataset.methods ?? "[]"));
    stage.frame();
    if (!option.parentNode) control("character").append(option);
    option.selected = true;
    current = option;
  } catch (error) {
    worker.terminate();
    if (turn !== opening) return;
    if (current) current.selected = true;
    say(`${option.text}: ${error.message}`);
  } finally {
    if (turn === opening) isOpening = false;
    control("busy").hidden = !isOpening;
  }
}

function close() {
  for (const { pane } of beside?.methods ?? []) pane?.close();
}

/** Begin to play what was opened. described: methods that the page has beside its cloth. */
async function begin(described) {
  const { playing = true } = playback ?? {}, { gltf, cloth } = opened;
  const figure = new Figure(gltf.scene, cloth, rolesOf(cloth.names));
  updateSkin = lowerSkin(figure);
  const methods = methodsOf(opened, described, wasm, adjust), truth = methods.find(({ isTruth }) => isTruth);
  const panes = [await methods[0].opened()];
  comparison = truth ? await compare(truth, described) : null;
  playback = new Playback(figure, panes, truth ? animations.at(-1) : null, count, say);
  beside = new Beside(control("panes"), control("methods"), methods, showWanted);
  costs = [];
  adjust(cloth);
  Object.assign(playback, { playing, speed: Number(control("speed").value) });
  playback.start(playback.compared ?? animations[0], 0);
  control("animation").value = animations.indexOf(playback.clip);
  figure.ground = footHeight(figure); // Where animations from elsewhere, and hands, leave the feet.
  control("time").max = playback.last;
  hand.show(playback);
  keys.show();
  control("errors").hidden = !truth;
  control("retargeted").hidden = true;
  listQualities(methods);
  listGarments();
  globalThis.uvcloth = { cloth, playback, stage, hand, beside, comparison }; // for the browser's console
  dress();
  if (truth) beside.choose(methods.filter(({ quality }) => !quality));
}

/** Make the comparison with a simulation. */
async function compare(truth, described) {
  const { source } = await truth.opened(), { warmUp } = described.find(({ kind }) => kind === "truth");
  const choose = (share) => seek(playback.compared, (share * (source.count - 1)) / FPS);
  return new Comparison(source, warmUp, opened.cloth, { curve: control("curve"), scale: control("scale") }, choose);
}

/** Show the panes that are wanted, after those that are not yet there have been made, in the garments that are chosen. */
async function showWanted() {
  const character = opening, turn = ++showing, { wanted } = beside, worn = chosenGarments();
  control("busy").hidden = false;
  try {
    const panes = await Promise.all(wanted.map((method) => method.opened()));
    const sources = await Promise.all(wanted.map((method) => method.wearing(worn)));
    if (turn !== showing || character !== opening) {
      panes.forEach(({ source, whole }, index) => { if (![source, whole].includes(sources[index])) sources[index].worker.terminate(); });
      return;
    }
    panes.forEach((pane, index) => {
      pane.onError = say;
      pane.take(sources[index]);
    });
    playback.show(panes);
    comparison?.show(panes);
    costs = [];
    dress();
  } catch (error) {
    if (turn === showing && character === opening) say(error.message);
  }
}

/** The places of the garments that are chosen, the innermost first. */
function chosenGarments() {
  const boxes = [...control("garments").querySelectorAll("input")].reverse();
  return boxes.flatMap(({ checked }, place) => (checked ? [place] : []));
}

/** Show the garments that are chosen, and solve no others where there is an outfit without them. */
function wear() {
  const worn = chosenGarments(), solves = ({ method, source }) => !source.worn || source.worn.join() === method.solved(worn).join();
  dress();
  if (!playback.panes.every(solves)) showWanted();
}

/** Show in all panes the garments that are chosen, and what is chosen over them. */
function dress() {
  const { value } = control("layer"), worn = chosenGarments();
  for (const { garments } of playback.panes) garments.forEach((garment, place) => { garment.isShown = worn.includes(place); });
  control("hidden").hidden = playback.panes.every(({ method, source }) => !source.worn || method.solved(worn).length === worn.length);
  updateSkin();
  overlays?.remove();
  overlays = new Overlays(stage, playback.panes, value);
  globalThis.uvcloth.overlays = overlays;
  control("legend").hidden = value !== "strain";
}

function play(clip, time) {
  // What is compared begins without a way from what was before.
  if (clip === playback.compared) playback.start(clip, time);
  else playback.goTo(clip, time);
  control("time").max = playback.last;
  control("retargeted").hidden = !retargeted.has(clip);
}

/** Go to a time while it is chosen: the compared animation is shown there, any other one goes over to it. */
function seek(clip, time) {
  if (clip !== playback.compared) return play(clip, time);
  playback.preview(clip, time);
  control("time").max = playback.last;
}

function listAnimations() {
  const named = animations.map((clip, index) => new Option(clip.name || `animation ${index + 1}`, index));
  control("animation").replaceChildren(...named);
  control("animation").closest("label").hidden = named.length < 2;
}

function listQualities(methods) {
  const qualities = methods.filter(({ quality }) => quality);
  control("quality").replaceChildren(...qualities.map(({ quality }) => new Option(quality, methods.findIndex((each) => each.quality === quality))));
  control("quality").closest("label").hidden = qualities.length < 2;
}

function changeQuality() {
  beside.lead(beside.methods[Number(control("quality").value)]);
}

function count(frame) {
  const { panes } = playback, { answers, milliseconds } = frame, [{ parts }] = answers;
  beside.count(panes, answers);
  if (comparison && !isAltered()) comparison.note(panes, frame);
  costs = [...costs, { ...parts, pose: milliseconds }].slice(-AVERAGED);
  const mean = (name) => costs.reduce((sum, each) => sum + each[name], 0) / costs.length;
  const text = (name) => mean(name).toFixed(1), others = mean("pose") + mean("vertices");
  control("milliseconds").textContent =
    `${text("cloth")} ms per frame of cloth, ${others.toFixed(1)} for its pose and its vertices; ` +
    `${pictures.shown.toFixed(1)} to show a picture, ${pictures.drawn.toFixed(1)} to draw it`;
  if (costs.length === AVERAGED && mean("cloth") + others > TOO_LONG) slow(mean("cloth") + others);
}

/** Take the fast quality, if there is one and nothing else takes time. */
function slow(milliseconds) {
  const fast = beside.methods.find(({ quality }) => quality === "fast");
  costs = [];
  if (!fast || fast === beside.first || beside.wanted.length > 1 || document.hidden) return;
  say(`A frame of cloth takes ${milliseconds.toFixed(0)} ms here, and ${TOO_LONG.toFixed(0)} are there: it goes on in fast quality.`);
  control("quality").value = beside.methods.indexOf(fast);
  changeQuality();
}

function listGarments() {
  const boxes = opened.cloth.garments.map(({ node }, index) => {
    const label = document.createElement("label"), box = document.createElement("input");
    Object.assign(box, { type: "checkbox", checked: true });
    box.addEventListener("change", wear);
    label.append(box, node.name.replaceAll("_", " ") || `garment ${index + 1}`);
    return label;
  });
  control("garments").replaceChildren(...boxes.reverse()); // The outermost on top.
}

/** Give cloth the fabric and the world of the controls. */
function adjust(cloth) {
  const value = (name) => Number(control(name).value), fabric = control("fabric").value;
  const done = [cloth.setWorld([value("wind-x"), value("wind-y"), 0], [0, 0, -value("gravity")])];
  done.push(cloth.setFabric(fabric && fabric.split(" ").map(Number)));
  for (const each of done) each.catch((error) => say(error.message));
}

/** Whether the cloth is not as it was baked, or the world not as it was simulated. */
function isAltered() {
  return Boolean(control("fabric").value) || ["wind-x", "wind-y", "gravity"].some((name) => control(name).value !== control(name).defaultValue);
}

function change() {
  for (const name of ["wind-x", "wind-y", "gravity"]) control(name).nextElementSibling.value = Number(control(name).value);
  playback?.wake();
  for (const { pane } of beside?.methods ?? []) for (const source of new Set([pane?.source, pane?.whole])) if (source?.setWorld) adjust(source);
}

function togglePlaying() {
  playback?.toggle();
}

/** Play the motion of a BVH file on the figure, as one more of its animations. */
async function addMotion(file) {
  try {
    if (!playback) throw new Error("there is no figure to play it yet");
    const { figure } = playback, clip = retarget(readBvh(await file.text()), figure, file.name);
    if (figure !== playback.figure) return;
    animations.push(clip);
    retargeted.add(clip);
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
  control("controls").open = !matchMedia(NARROW).matches;
  const on = (name, kind, act) => control(name).addEventListener(kind, act);
  on("play", "click", togglePlaying);
  on("time", "input", () => playback && seek(playback.clip, Number(control("time").value)));
  on("time", "change", () => playback?.isHeld && play(playback.clip, Number(control("time").value)));
  for (const kind of ["pointerup", "pointercancel"]) on("curve", kind, () => playback?.isHeld && play(playback.clip, playback.time));
  on("speed", "input", () => {
    const speed = Number(control("speed").value);
    control("speed").nextElementSibling.value = speed;
    if (playback) playback.speed = speed;
  });
  for (const name of ["wind-x", "wind-y", "gravity"]) on(name, "input", change);
  on("fabric", "change", change);
  on("quality", "change", changeQuality);
  on("layer", "change", () => playback && dress());
  on("character", "change", openChosen);
  on("animation", "change", () => play(animations[Number(control("animation").value)], 0));
  on("file", "change", () => openFile(control("file").files[0]));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    openFile(event.dataTransfer.files[0]);
  });
  addEventListener("keydown", (event) => {
    if (event.key !== " " || event.target.closest("button:not(.grip), select, input, summary")) return;
    event.preventDefault();
    togglePlaying();
  });
}

/** Divide the page among the panes: one has all of it, or, as several, what the controls leave free. */
function divide() {
  const { panes } = playback, { clientWidth: width, clientHeight: height } = stage.canvas;
  const place = { left: 0, top: 0, width, height }, isNarrow = matchMedia(NARROW).matches, { open } = control("controls");
  if (panes.length > 1 || (isNarrow && open)) {
    const { left, bottom } = control("controls").getBoundingClientRect();
    place.left = place.top = MARGIN;
    // Several panes are too small below controls that are open.
    if (isNarrow && !(open && panes.length > 1)) place.top += bottom;
    place.width = (isNarrow ? width : left) - 2 * MARGIN;
    place.height = control("bar").getBoundingClientRect().top - place.top - MARGIN;
  }
  stage.divide(place, panes.map(({ method }) => method.layer));
  beside.label(panes, stage.panes);
  if (!comparison) return;
  beside.tell((method) => comparison.text(method));
  if (playback.isComparing) comparison.curve.point(playback.time * FPS);
}

let before = performance.now();

function draw(now) {
  const seconds = Math.max(0, now - before) / 1e3;
  before = now;
  if (playback) {
    const begun = performance.now();
    divide();
    playback.advance(seconds);
    hand.follow();
    keys.follow();
    overlays.update(playback.between);
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
  keys = new GripKeys(control("grips"), hand);
  connect();
  openChosen();
  requestAnimationFrame(draw);
}

boot();
