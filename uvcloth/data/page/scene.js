// The view: one key light with a soft shadow, a floor that shows only the shadow, a camera that follows the figure.
import {
  Box3, DirectionalLight, HemisphereLight, Mesh, OrbitControls, PCFShadowMap, PerspectiveCamera, PlaneGeometry, Scene,
  ShadowMaterial, Vector3, WebGLRenderer,
} from "./three.min.js";

const FOLLOWING = 4; // of the way to the figure that the camera goes in a second

export class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    // Without a colour of its own: behind it is the page, dark or light.
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
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
    // A little below the middle, since controls lie over the lower edge.
    this.target = box.getCenter(new Vector3()).sub(new Vector3(0, 0.05 * size, 0));
    this.size = size;
    this.controls.target.copy(this.target);
    this.camera.position.copy(this.target).add(new Vector3(0.5, 0.25, 2.05).multiplyScalar(size * this.#distance()));
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

  /** Draw, with the camera on its way to a point of the figure. */
  draw(point, seconds) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width !== this.width || height !== this.height) this.#resize(width, height);
    if (point) {
      const share = 1 - Math.exp(-FOLLOWING * seconds);
      const shift = point.clone().sub(this.target).setY(0).multiplyScalar(share);
      for (const each of [this.target, this.controls.target, this.camera.position]) each.add(shift);
      this.#moveLight();
    }
    this.controls.update();
    this.renderer.render(this.scene, this.camera);
  }

  #moveLight() {
    this.light.target.position.copy(this.target);
    this.light.position.copy(this.target).add(new Vector3(1.2, 2, 1.6).multiplyScalar(this.size));
    this.floor.position.setX(this.target.x).setZ(this.target.z);
  }

  // A narrow display has to be farther off.
  #distance() {
    return Math.max(1, 0.75 / this.camera.aspect);
  }

  #resize(width, height) {
    Object.assign(this, { width, height });
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }
}
