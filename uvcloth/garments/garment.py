"""Garments at rest on a body, ready to be skinned with it."""

from dataclasses import dataclass

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh

LIKE = {"shirt": "tops"}
"""Substitutes: by template, the one whose motion serves it where a network was not trained on it."""


@dataclass(frozen=True)
class Garment:
    """One garment on one body.

    template: the template whose decoder serves it ("tops", "bottoms", "dress", "shirt").
    mesh: N vertices, at rest on the body's rest pose.
    weights: (N, J) blend weights of the closest body vertex (the LBS baseline).
    smooth_weights: (N, J) the same, diffused over the garment, so that a skirt does not split.
    """

    name: str
    template: str
    mesh: Mesh
    weights: Tensor
    smooth_weights: Tensor


@dataclass(frozen=True)
class Outfit:
    """Garments worn together on one body, the innermost first: contact keeps each over those before it.

    under: what is worn beneath all of them, for a method that asks; it is not rolled out.
    """

    body: Body
    garments: tuple[Garment, ...]
    under: Garment | None = None
