"""The garment's map that errors are measured on (PhysXNet, section 4)."""

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.methods.physxnet.texels import body_texels, template_texels

Texels = tuple[Tensor, Tensor]
"""Corners (P, 3) int64, the garment vertices that each texel of a map sees, and their barycentrics (P, 3)."""


def garment_map(garment: Garment, body: Body, size: int) -> Texels | None:
    """Cast the rays from the texels of a size x size sheet of the body's layout to a garment at rest.

    The rays meet the garment's own mesh, also where that is not a template's (T^BC of the paper). None if
    no ray meets it.
    """
    try:
        texels = template_texels(garment.template, garment.mesh, body, body_texels(body, size))
    except InputError:
        return None
    return texels.corners, texels.barycentrics
