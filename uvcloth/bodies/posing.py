"""Skin of a posed body."""

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.skeleton import local_rotations
from uvcloth.geometry.skinning import apply_transforms, blend_transforms, skin

POSED_AT_ONCE = 64
"""Frames whose pose shapes are added at once: each needs a rest mesh of its own."""


def posed_skin(body: Body, transforms: Tensor, used: Tensor | None = None) -> Tensor:
    """Vertices (B, V, 3) m of a body posed by joint transforms (B, J, 3, 4), on their device.

    Linear blend skinning of the rest mesh, after the offsets of pose shapes are added if the body has them.
    used: indices of the vertices to pose, by default all.
    """
    vertices, weights, shapes = body.mesh.vertices, body.weights, body.pose_shapes
    if used is not None:
        vertices, weights = vertices[used], weights[used]
        shapes = None if shapes is None else shapes[:, used]
    vertices, weights = vertices.to(transforms), weights.to(transforms)
    if shapes is None:
        return skin(vertices, weights, transforms)
    shapes = shapes.to(transforms)
    posed = [
        apply_transforms(
            blend_transforms(weights, some), vertices + _corrections(shapes, body.skeleton.parents, some)
        )
        for some in transforms.split(POSED_AT_ONCE)
    ]
    return torch.cat(posed)


def _corrections(shapes: Tensor, parents: tuple[int, ...], transforms: Tensor) -> Tensor:
    """Offsets of the rest mesh by the pose shapes: (B, V, 3) m."""
    turns = local_rotations(parents, transforms[..., :3])[:, 1:] - torch.eye(3).to(transforms)
    return (turns.flatten(1) @ shapes.flatten(1)).unflatten(1, (-1, 3))
