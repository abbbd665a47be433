"""The garment's map that errors are measured on, and what writing to it and reading back loses."""

from dataclasses import dataclass

from torch import Tensor

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Garment
from uvcloth.methods.physxnet.config import PRESETS
from uvcloth.methods.physxnet.maps import garment_vertices, template_offsets
from uvcloth.methods.physxnet.texels import (
    BodyTexels,
    GarmentDecoder,
    TemplateTexels,
    body_texels,
    build_decoder,
    template_texels,
)


@dataclass(frozen=True)
class GarmentMap:
    """A garment on the texels of its body: T^UB, T^BC and T^XB of the PhysXNet paper, section 4."""

    texels: BodyTexels
    template: TemplateTexels
    worn: GarmentDecoder


def garment_map(garment: Garment, body: Body, size: int) -> GarmentMap | None:
    """Cast the rays from the texels of a size x size sheet of the body's layout to a garment at rest.

    The rays meet the garment's own mesh, also where that is not a template's. None if none of them meets it.
    """
    texels = body_texels(body, size)
    try:
        template = template_texels(garment.template, garment.mesh, body, texels)
    except InputError:
        return None
    return GarmentMap(texels, template, build_decoder(garment, template, texels))


def round_trip(seen: GarmentMap, vertices: Tensor, body_vertices: Tensor, transforms: Tensor) -> Tensor:
    """Garment vertices (F, N, 3) written to offset maps and decoded back, as the default PhysXNet does it.

    body_vertices: (F, V, 3). transforms: (F, J, 3, 4).
    """
    place = (PRESETS["default"], seen.texels, seen.template, seen.worn)
    offsets = template_offsets(*place, vertices=vertices, body_vertices=body_vertices, transforms=transforms)
    return garment_vertices(*place, offsets=offsets, body_vertices=body_vertices, transforms=transforms)
