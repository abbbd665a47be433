"""A body that cloth collides with, as closed parts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Body:
    """Parts of a body, each a closed surface, all over the same V vertices.

    rest: (V, 3) m. parts: faces (F, 3) of each of K. touches: (K, N) bool, the parts that may touch each
    vertex of the cloth; crossed: (K, N) bool, those that it may be inside of without a touch.
    """

    rest: NDArray[Any]
    parts: tuple[NDArray[Any], ...]
    touches: NDArray[np.bool_]
    crossed: NDArray[np.bool_]

    def sections(self) -> dict[str, NDArray[Any]]:
        """The arrays that the runtime reads, by their names there."""
        return {
            "collider.rest": self.rest,
            "collider.faces": np.concatenate([np.zeros((0, 3), np.int64), *self.parts]),
            "collider.starts": np.cumsum([0, *(len(part) for part in self.parts)]),
            "cloth.touches": _bits(self.touches),
            "cloth.crossed": _bits(self.crossed),
        }


def make_body(
    vertices: NDArray[Any],
    parts: Sequence[NDArray[Any]],
    touches: NDArray[np.bool_],
    crossed: NDArray[np.bool_] | None = None,
) -> Body:
    """Make the body of its parts, faces (F, 3) each, at vertices (V, 3) m. touches, crossed: (K, N) bool."""
    return Body(vertices, tuple(parts), touches, np.zeros_like(touches) if crossed is None else crossed)


def _bits(masks: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Bits (N,), one for each part, of masks (K, N)."""
    return (masks * (1 << np.arange(len(masks)))[:, None]).sum(0)
