// The view: one key light with a soft shadow, a floor that shows only the shadow, a camera that follows the figure, all of
// them the same in all panes.
import {
  Box3, DirectionalLight, HemisphereLight, Mesh, OrbitControls, PCFShadowMap, PerspectiveCamera, PlaneGeometry, Scene,
  ShadowMaterial, Vector3, WebGLRenderer,
} from "./three.min.js";
import { panesIn } from "./layout.js";

const FOLLOWING = 4; // of the way to the figure that the camera goes in a second
const LABEL = 32; // pixels
const NARROWEST = 0.66; // width of a pane, of its height, beyond which the figure fills it

export class Stage {
  constructor(canvas) {
    Object.assign(this, { canvas, panes: [], distance: 1 });
    // Without a colour of its own: behind it is the page, dark or light.
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.autoClear = false; // The whole of it is cleared once for all panes.
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(35, 1, 0.01, 100);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enablePan = false;
    this.controls.maxPolarAngle = 0.55 * Math.PI;
    this.light = new DirectionalLight("#fff4e6", 2.6);
    this.light.castShadow = true;
    this.light.shadow.mapSize.set(2048, 2048);
    this.light.shadow.radius = 4;
    this.floor = new Mesh(new PlaneGeometry(), new ShadowMaterial({ opacity: 0.25 }));
    this.floor.rotation.x = -0.5 * Math.PI;
    this.floor.receiveShadow = true;
    this.scene.add(new HemisphereLight("#ffffff", "#8a8070", 1.6), this.light, this.light.target, this.floor);
  }

  /** Show a file in place of the one before. */
  show(gltf) {
    if (this.shown) this.scene.remove(this.shown);
    this.shown = gltf.scene;
    this.scene.add(gltf.scene);
    gltf.scene.traverse((each) => {
      if (!each.isMesh) return;
      each.castShadow = each.receiveShadow = true;
      each.frustumCulled = false; // The bounds of a skinned mesh are those at rest.
    });
  }

  /** Look at the figure, whatever its unit, from the front and a little from above. */
  frame() {
    const box = new Box3();
    // Joints too, for a figure that is cloth alone, whose meshes are not yet anywhere.
    this.shown.traverse((each) => {
      if (each.isSkinnedMesh) box.expandByObject(each, true);
      else if (each.isBone) box.expandByPoint(new Vector3().setFromMatrixPosition(each.matrixWorld));
    });
    const size = box.getSize(new Vector3()).y;
    this.distance = this.#distance();
    // A little below the middle, since controls lie over the lower edge.
    this.target = box.getCenter(new Vector3()).sub(new Vector3(0, 0.05 * size, 0));
    this.size = size;
    this.controls.target.copy(this.target);
    this.camera.position.copy(this.target).add(new Vector3(0.5, 0.25, 2.05).multiplyScalar(size * this.distance));
    this.camera.near = 0.05 * size;
    this.camera.far = 50 * size;
    this.camera.updateProjectionMatrix();
    this.controls.minDistance = 0.4 * size;
    this.controls.maxDistance = 8 * size;
    this.floor.position.y = box.min.y;
    this.floor.scale.setScalar(20 * size);
    const { camera } = this.light.shadow;
    Object.assign(camera, { left: -size, right: size, top: size, bottom: -size, near: 0.1 * size, far: 6 * size });
    camera.updateProjectionMatrix();
    this.light.shadow.normalBias = 0.004 * size;
    this.light.shadow.bias = -0.0005;
    this.#moveLight();
  }

  /** Divide a rectangle of the canvas, {left, top, width, height} in pixels, into panes; they show what is on these layers
   * beside what is on none of their own. */
  divide(rectangle, layers) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width !== this.width || height !== this.height) this.#resize(width, height);
    this.panes = panesIn(rectangle, layers.length).map((pane, index) => ({ ...pane, layer: layers[index] }));
    const [pane] = this.panes;
    // Lower where a label lies over the upper edge.
    this.camera.setViewOffset(pane.width, pane.height, 0, layers.length > 1 ? -LABEL / 2 : 0, pane.width, pane.height);
    const before = this.distance;
    this.distance = this.#distance();
    this.camera.position.sub(this.controls.target).multiplyScalar(this.distance / before).add(this.controls.target);
  }

  /** Draw all panes, with their camera on its way to a point of the figure. */
  draw(point, seconds) {
    if (point) {
      const share = 1 - Math.exp(-FOLLOWING * seconds);
      const shift = point.clone().sub(this.target).setY(0).multiplyScalar(share);
      for (const each of [this.target, this.controls.target, this.camera.position]) each.add(shift);
      this.#moveLight();
    }
    this.controls.update();
    const { renderer, camera } = this;
    renderer.setScissorTest(false);
    renderer.clear();
    renderer.setScissorTest(true);
    for (const { left, top, width, height, layer } of this.panes) {
      const place = [left, this.height - top - height, width, height];
      renderer.setViewport(...place);
      renderer.setScissor(...place);
      camera.layers.set(0);
      camera.layers.enable(layer);
      renderer.render(this.scene, camera);
    }
  }

  /** The pane at a place of the page, or the nearest one. */
  paneAt(x, y) {
    const away = (value, from, size) => Math.max(from - value, value - from - size, 0);
    const distances = this.panes.map((pane) => away(x, pane.left, pane.width) + away(y, pane.top, pane.height));
    return this.panes[distances.indexOf(Math.min(...distances))];
  }

  /** Where a point of the scene is on the page, in a pane: [x, y] in pixels. */
  onPage(point, { left, top, width, height } = this.panes[0]) {
    const { x, y } = point.clone().project(this.camera);
    return [left + (0.5 + x / 2) * width, top + (0.5 - y / 2) * height];
  }

  #moveLight() {
    this.light.target.position.copy(this.target);
    this.light.position.copy(this.target).add(new Vector3(1.2, 2, 1.6).multiplyScalar(this.size));
    this.floor.position.setX(this.target.x).setZ(this.target.z);
  }

  // A narrow display has to be farther off.
  #distance() {
    return Math.max(1, NARROWEST / this.camera.aspect);
  }

  #resize(width, height) {
    Object.assign(this, { width, height });
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height, false);
  }
}
