"""Starts of garments: vertices that are inside the body, or beneath what they are worn over."""

from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments.untangling import crossing
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.surface import BodySurface

TOLERANCE = 0.002
"""Metres in the skin that do not count: the surface that cloth meets is not quite the character's."""


@dataclass(frozen=True)
class StartFaults:
    """Vertices (N,) bool of a garment inside the body, and beneath a garment that it is worn over."""

    inside: Tensor
    beneath: Tensor

    @property
    def wrong(self) -> Tensor:
        """Vertices (N,) bool that are either."""
        return self.inside | self.beneath


def starts(meshes: Sequence[Mesh], body: Body) -> tuple[StartFaults, ...]:
    """The starts of meshes that are worn on a body over each other, the innermost first."""
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    inside = [surface.closest(mesh.vertices).signed_distance < -TOLERANCE for mesh in meshes]
    return tuple(map(StartFaults, inside, crossing(meshes, surface)))
