"""Garments at rest on a body, ready to be skinned with it."""

from dataclasses import dataclass
from typing import Literal

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.fabric import JERSEY, Fabric


@dataclass(frozen=True, eq=False)
class Garment:
    """One garment on one body.

    template: the one of TEMPLATES whose motion it takes, None where none serves it.
    mesh: N vertices, at rest on the body's rest pose.
    weights: (N, J) blend weights of the closest body vertex (the LBS baseline).
    smooth_weights: (N, J) the same, diffused over the garment, so that a skirt does not split.
    source: whether its mesh is that of its template, or came from a file. hides: (K,) int64 vertices of the
    body that its file says it hides, None where it says nothing. fabric: what it is made of, for a method
    that reads it. holds: names of the PLACES that hold it up, none for the one that is found.
    """

    name: str
    template: str | None
    mesh: Mesh
    weights: Tensor
    smooth_weights: Tensor
    source: Literal["template", "file"] = "file"
    hides: Tensor | None = None
    fabric: Fabric = JERSEY
    holds: tuple[str, ...] = ()
    pins: Tensor | None = None


@dataclass(frozen=True)
class Outfit:
    """Garments worn together on one body, the innermost first: clearing keeps each over those before it.

    under: what is worn beneath all of them, for a method that asks; it is not rolled out.
    """

    body: Body
    garments: tuple[Garment, ...]
    under: Garment | None = None
