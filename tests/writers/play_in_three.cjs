// node play_in_three.cjs FILE.glb OUT.f32 CHROMIUM MESH ... -- SECOND ...
// Plays the file with three.js in headless Chromium and writes the vertices of each mesh in turn, as it skins
// and morphs them, (times, V, 3) float32, world. NODE_PATH names the folder of three and playwright-core.
const fs = require("fs");
const path = require("path");
const { chromium } = require("playwright-core");

const [glb, out, executablePath, ...rest] = process.argv.slice(2);
const names = rest.slice(0, rest.indexOf("--"));
const times = rest.slice(rest.indexOf("--") + 1).map(Number);
const three = path.join(process.env.NODE_PATH.split(path.delimiter)[0], "three");
const page_html = `<script type="importmap">{"imports":
  {"three": "http://three/build/three.module.js", "three/addons/": "http://three/examples/jsm/"}}</script>`;

async function play([names, times]) {
  const THREE = await import("three");
  const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
  const gltf = await new GLTFLoader().loadAsync("http://three/file.glb");
  const mixer = new THREE.AnimationMixer(gltf.scene);
  const action = mixer.clipAction(gltf.animations[0]);
  action.setLoop(THREE.LoopOnce);
  action.clampWhenFinished = true;
  action.play();
  const point = new THREE.Vector3();
  const bytes = [];
  for (const name of names) {
    const mesh = gltf.scene.getObjectByName(name);
    const count = mesh.geometry.attributes.position.count;
    const played = new Float32Array(3 * count * times.length);
    times.forEach((time, frame) => {
      action.reset();
      mixer.setTime(time);
      gltf.scene.updateMatrixWorld(true);
      for (let vertex = 0; vertex < count; vertex++) {
        mesh.getVertexPosition(vertex, point).applyMatrix4(mesh.matrixWorld);
        point.toArray(played, 3 * (frame * count + vertex));
      }
    });
    const data = new Uint8Array(played.buffer);
    let text = "";
    for (let at = 0; at < data.length; at += 32768)
      text += String.fromCharCode(...data.subarray(at, at + 32768));
    bytes.push(btoa(text));
  }
  return bytes;
}

(async () => {
  const browser = await chromium.launch({
    executablePath,
    args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
      "--disable-background-networking", "--disable-component-update"],
  });
  try {
    const page = await browser.newPage();
    page.on("pageerror", (error) => console.error(error));
    await page.route("http://three/**", (route) => {
      const file = new URL(route.request().url()).pathname;
      if (file === "/") return route.fulfill({ contentType: "text/html", body: page_html });
      return route.fulfill({ path: file === "/file.glb" ? glb : path.join(three, file) });
    });
    await page.goto("http://three/");
    const bytes = await page.evaluate(play, [names, times]);
    fs.writeFileSync(out, Buffer.concat(bytes.map((text) => Buffer.from(text, "base64"))));
  } finally {
    await browser.close();
  }
})().catch((error) => { console.error(error); process.exit(1); });
