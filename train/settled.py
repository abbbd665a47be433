"""Outfits at rest in poses, settled on cages: they supervise the start of models that see the pose alone."""

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.methods.physics.outfit import CagedOutfit

from .cage_sequences import simulated

SETTLED_FRAMES = 30
"""Frames in which a body holds its pose."""


@torch.no_grad()
def settle(prepared: CagedOutfit, body: Body, transforms: Tensor) -> tuple[Tensor, ...]:
    """Each garment (N, 3) m on a body that has held its pose (J, 3, 4) for a second, not cleared."""
    held = transforms.expand(SETTLED_FRAMES, *transforms.shape)
    skin_vertices = posed_skin(body, transforms[None]).expand(SETTLED_FRAMES, -1, -1)
    *_, last = simulated(prepared, body, held, skin_vertices)
    return last
