"""A cloth engine that computes next to nothing, so that trials spend their time on all that is around it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from uvcloth.simulate.engine import Scene


@dataclass(frozen=True)
class Following:
    """Cloth that goes where the body carries it, a frame in some seconds."""

    seconds: float = 0.05

    def describe(self) -> dict[str, Any]:
        """Describe the engine, as `Engine` says."""
        return {"engine": "following", "versions": {}, "settings": {}}

    def simulate(self, scene: Scene) -> Iterator[Tensor]:
        """Yield the frames as `Engine` says."""
        for vertices in scene.skinned:
            time.sleep(self.seconds)
            yield vertices
