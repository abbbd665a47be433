"""Condition of a recurrent network: the body's shape and the fabric, which stay the same in a rollout."""

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.physics.fabric import FEATURES, Fabric


def condition_size(joints: int) -> int:
    """Length of the condition on a skeleton of J joints."""
    return joints + FEATURES


def condition(body: Body, fabric: Fabric) -> Tensor:
    """The condition (J + FEATURES,): sizes of the parts of a body, m, and the features of a fabric.

    The size of a part is the mean distance of its skin from its joint at rest: its length and its girth.
    """
    distances = torch.cdist(body.skeleton.heads, body.mesh.vertices)
    sizes = (distances * body.weights.T).sum(1) / body.weights.sum(0).clamp(min=1e-6)
    return torch.cat([sizes, sizes.new_tensor(fabric.features())])
