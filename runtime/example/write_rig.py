"""What an engine's importer knows of a baked file, as text for `host.cpp`.

    python runtime/example/write_rig.py HERO.glb    # writes HERO.cloth and HERO.rig beside it

HERO.cloth: the bytes for the runtime. HERO.rig: the transform from the scene to the runtime's world; how many
joints and garments there are; of each joint its role, its parent among the joints (-1 for none), its local
transform at rest and its inverse bind matrix; of each garment its name, the runtime's vertex of each vertex
of its mesh, and its triangles. Matrices are 4 x 4, row by row. Needs NumPy alone.
"""

import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from uvcloth.player.baked import open_baked
from uvcloth.player.nodes import chain


def main(path: Path) -> None:
    """Write both files. Raises ValueError naming the file for one that is not whole."""
    baked = open_baked(path)
    file, skin = baked.file, baked.skin
    rest = np.linalg.inv(skin.inverse_bind)
    lines = [numbers(skin.axes.flat), f"{len(skin.nodes)} {len(baked.garments)}"]
    for node, role, world, inverse_bind in zip(skin.nodes, skin.names, rest, skin.inverse_bind, strict=True):
        parent = next((skin.nodes.index(each) for each in chain(node, file.above) if each in skin.nodes), -1)
        local = np.linalg.inv(rest[parent]) @ world if parent >= 0 else world
        lines += [f"{role} {parent}", numbers(local.flat), numbers(inverse_bind.flat)]
    for garment in baked.garments:
        mesh = file.entries("meshes")[file.entries("nodes")[garment.node]["mesh"]]
        corners = [file.array(part["indices"], "SCALAR")[:, 0] for part in mesh["primitives"]]
        lines.append(garment.name)
        lines += [f"{len(each)} {numbers(each)}" for each in (garment.vertices, np.concatenate(corners))]
    path.with_suffix(".cloth").write_bytes(baked.content)
    path.with_suffix(".rig").write_text("\n".join(lines) + "\n", encoding="utf-8")


def numbers(values: Iterable[float]) -> str:
    """Numbers in one line, with all digits."""
    return " ".join(f"{value:.17g}" for value in values)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
