"""A cloth engine that computes next to nothing, so that trials spend their time on all that is around it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from uvcloth.physics.fabric import Fabric
from uvcloth.simulation.engine import Frame, Scene


@dataclass(frozen=True)
class Following:
    """Cloth that comes nearer to where the body carries it, a frame in some seconds, from where it was."""

    seconds: float = 0.05

    def describe(self) -> dict[str, Any]:
        """Describe the engine, as `Engine` says."""
        return {"engine": "following", "versions": {}, "settings": {}}

    def with_fabric(self, fabric: Fabric) -> "Following":
        """The same: it has none."""
        return self

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        """Yield the frames as `Engine` says."""
        if after is None:
            after = Frame(0, scene.rest, scene.rest.flatten())
            yield after
        assert after.memory is not None
        vertices = after.memory.view(-1, 3)
        for index in range(after.index + 1, len(scene.skinned)):
            time.sleep(self.seconds)
            vertices = vertices.lerp(scene.skinned[index], 0.3)
            yield Frame(index, vertices, vertices.flatten())
