"""Animation of the nodes of a glTF document by their transforms to the world."""

from collections.abc import Sequence

import numpy as np
import torch

from uvcloth.geometry.rotations import to_quaternions
from uvcloth.player.gltf_document import parents_of
from uvcloth.player.nodes import REST, chain, local_transform, parents_first
from uvcloth.writers.glb import Document

STILL = {"translation": 1e-6, "scale": 1e-4}
"""Largest change of a node's shift or scale, over one more than its size at rest, that is not written."""


def animate_nodes(document: Document, nodes: Sequence[int], worlds: np.ndarray, time: int) -> None:
    """Move J nodes so that their transforms to the scene are worlds (F, J, 4, 4) at F times (an accessor).

    Other nodes keep their transforms relative to their parents; at rest the file stays as it is.
    """
    above = parents_of({"nodes": document.nodes})
    wanted = {node: worlds[:, index] for index, node in enumerate(nodes)}
    order = parents_first({each for node in nodes for each in (node, *chain(node, above))}, above)
    world: dict[int, np.ndarray] = {}
    for node in order:
        parent = world[above[node]] if node in above else np.eye(4)
        if node not in wanted:
            world[node] = parent @ local_transform(document.nodes[node])
            continue
        world[node] = wanted[node]
        _animate(document, node, np.linalg.inv(parent) @ wanted[node], time)


def _animate(document: Document, node: int, local: np.ndarray, time: int) -> None:
    """Give a node its transforms (F, 4, 4) relative to its parent."""
    entry = document.nodes[node]
    if "matrix" in entry:
        # A node that is animated has no matrix.
        rest = _parts(local_transform(entry)[None])
        entry |= {path: values[0].tolist() for path, values in rest.items()}
        del entry["matrix"]
    parts = _parts(local)
    document.animate(node, "rotation", time, document.array(parts["rotation"], "VEC4"))
    for path, still in STILL.items():
        resting = np.array(entry.get(path, REST[path]))
        if np.abs(parts[path] - resting).max() > still * (1.0 + np.abs(resting).max()):
            document.animate(node, path, time, document.array(parts[path], "VEC3"))


def _parts(local: np.ndarray) -> dict[str, np.ndarray]:
    """Shifts (F, 3), unit quaternions (F, 4) that never jump to their negative, and scales (F, 3)."""
    size = np.linalg.norm(local[:, :3, :3], axis=1)
    size[np.linalg.det(local[:, :3, :3]) < 0] *= -1.0
    turns = to_quaternions(torch.from_numpy(local[:, :3, :3] / size[:, None])).numpy()
    flips = np.sign((turns[1:] * turns[:-1]).sum(-1, keepdims=True))
    turns[1:] *= np.cumprod(np.where(flips == 0, 1, flips), axis=0)
    return {"translation": local[:, :3, 3], "rotation": turns, "scale": size}
