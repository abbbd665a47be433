"""A scene that is turned, or far away, has the same cloth."""

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.motion.library import load_clip
from uvcloth.rollouts.rollout import PreparedRollout, prepare_rollout

FRAMES = 12


def test_a_turned_or_shifted_scene_has_the_same_cloth(body: Body) -> None:
    """To a hundredth of a millimetre, and a tenth at a kilometre, where float32 has no more."""
    motion = load_clip("run", body).window(0, FRAMES).transforms(torch.float64)
    worn = Outfit(body, (fit_template("dress", body),))
    prepared = prepare_rollout(Physics(PhysicsConfig("fast")), worn)
    here = vertices(prepared, motion)
    for degrees, shift, limit in ((37.0, (0.0, 0.0, 0.0), 1e-5), (90.0, (1000.0, -500.0, 0.0), 1e-4)):
        angle = math.radians(degrees)
        turn = torch.tensor(
            [
                [math.cos(angle), -math.sin(angle), 0.0],
                [math.sin(angle), math.cos(angle), 0.0],
                [0.0, 0.0, 1.0],
            ],
            dtype=torch.float64,
        )
        moved = turn @ motion
        moved[..., 3] += torch.tensor(shift, dtype=torch.float64)
        there = (vertices(prepared, moved) - np.array(shift)) @ turn.numpy()
        assert np.linalg.norm(there - here, axis=-1).max() < limit


def vertices(prepared: PreparedRollout, motion: Tensor) -> NDArray[np.float64]:
    frames = prepared.frames(motion, 30.0)
    return torch.stack([frame.vertices[0] for frame in frames]).double().numpy()
