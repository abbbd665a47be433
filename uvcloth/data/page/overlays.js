// What is drawn over the cloth of panes: its strain, or the cages that it is solved on.
import { CageLines } from "./cage.js";
import { StrainMap } from "./strain.js";

export class Overlays {
  /** panes: that have them. kind: "strain", "cage" or "". */
  constructor(stage, panes, kind) {
    this.strains = kind === "strain" ? panes.map(({ garments }) => new StrainMap(garments)) : [];
    this.cages = panes.map(({ source: { cages }, method: { layer } }) => (kind === "cage" && cages ? new CageLines(stage, cages, layer) : null));
    for (const strain of this.strains) strain.isShown = true;
  }

  /** Bring them to where the cloth is shown; between: as Playback has it. */
  update(between) {
    for (const strain of this.strains) strain.update();
    if (!between) return;
    const { from, to, share } = between;
    this.cages.forEach((cage, index) => cage?.update(from.answers[index].cages, to.answers[index].cages, share));
  }

  /** Take them off. */
  remove() {
    for (const strain of this.strains) strain.isShown = false;
    for (const cage of this.cages) cage?.remove();
  }
}
