// The cages that the cloth is solved on, as lines over it.
import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments } from "./three.min.js";

export class CageLines {
  /** cages: {corners, vertices}, the corners of their faces and how many vertices they have. layer: of the scene. */
  constructor(stage, { corners, vertices }, layer) {
    const edges = new Set();
    for (let face = 0; face < corners.length; face += 3)
      for (let k = 0; k < 3; k++) {
        const ends = [corners[face + k], corners[face + ((k + 1) % 3)]];
        edges.add(Math.min(...ends) * vertices + Math.max(...ends));
      }
    const geometry = new BufferGeometry();
    geometry.setIndex([...edges].flatMap((edge) => [Math.floor(edge / vertices), edge % vertices]));
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * vertices), 3));
    const material = new LineBasicMaterial({ color: "#ffb454", transparent: true, opacity: 0.6, depthTest: false });
    this.lines = new LineSegments(geometry, material);
    this.lines.frustumCulled = false;
    this.lines.layers.set(layer);
    stage.scene.add(this.lines);
  }

  /** Show the cages between two frames. */
  update(from, to, share) {
    const { position } = this.lines.geometry.attributes;
    for (let i = 0; i < from.length; i++) position.array[i] = from[i] + share * (to[i] - from[i]);
    position.needsUpdate = true;
  }

  remove() {
    this.lines.removeFromParent();
  }
}
