"""One step of a method, from its start."""

import torch
from torch import Tensor

from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Outfit
from uvcloth.methods.method import Method


def predicted(method: Method, outfit: Outfit, frames: BodyFrames) -> tuple[Tensor, ...]:
    """The garments (B, N, 3), m, of B frames that the method meets first."""
    prepared = method.prepare(outfit, torch.device("cpu"))
    _, garments = method.step(prepared, method.init(prepared, frames), frames)
    return garments
