"""The tree of nodes of a glTF file, and their transforms to the world."""

from collections.abc import Iterable
from typing import Any

import numpy as np

REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
"""Transform of a node that gives none, by the format."""


def chain(node: int, above: dict[int, int]) -> list[int]:
    """Ancestors of a node, the nearest first."""
    nodes: list[int] = []
    while node in above:
        node = above[node]
        nodes.append(node)
    return nodes


def parents_first(nodes: Iterable[int], above: dict[int, int]) -> list[int]:
    """The nodes in an order in which every parent comes before its children."""
    return sorted(nodes, key=lambda node: [*reversed(chain(node, above)), node])


def worlds(order: list[int], above: dict[int, int], local: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """World transforms (..., 4, 4) by node, of nodes in an order of parents first."""
    world: dict[int, np.ndarray] = {}
    for node in order:
        world[node] = world[above[node]] @ local[node] if node in above else local[node]
    return world


def local_transform(node: dict[str, Any]) -> np.ndarray:
    """Transform (4, 4) of a node relative to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    values = {path: np.array(node.get(path, rest), dtype=np.float64) for path, rest in REST.items()}
    return compose(**values)


def compose(translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Transforms (..., 4, 4) of shifts (..., 3), unit quaternions (..., 4) x, y, z, w and scales (..., 3)."""
    local = np.zeros((*translation.shape[:-1], 4, 4))
    local[..., :3, :3] = _turns(rotation) * scale[..., None, :]
    local[..., :3, 3] = translation
    local[..., 3, 3] = 1.0
    return local


def _turns(quaternions: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) of quaternions (..., 4) x, y, z, w of any length above zero.

    In numpy: files have thousands of nodes, which a tensor each would make slow.
    """
    q = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    (x, y, z), w = np.moveaxis(q[..., :3], -1, 0), q[..., 3]
    rows = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        *(2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        *(2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    ]
    return np.stack(rows, axis=-1).reshape(*q.shape[:-1], 3, 3)
