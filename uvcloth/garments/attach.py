"""Attachment of a garment to a body at rest: its blend weights."""

from typing import Literal

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Garment
from uvcloth.geometry.mesh import Mesh, weld
from uvcloth.geometry.skinning import diffuse_weights

DIFFUSION = {
    "tops": 0.06,
    "bottoms": 0.06,
    "dress": 0.15,
    "shirt": 0.06,
    "skirt": 0.15,
    "jacket": 0.06,
}
"""Metres over which blend weights are diffused; far enough in a skirt that left and right leg blend."""


def make_garment(
    name: str,
    mesh: Mesh,
    body: Body,
    diffusion: float,
    *,
    template: str | None = None,
    source: Literal["template", "file"] = "file",
) -> Garment:
    """Make a garment on a body, from its mesh (N vertices) at rest on the body's rest pose.

    diffusion: metres over which the smooth blend weights are diffused. template, source: as in Garment.
    """
    weights = body.weights[_closest_vertices(mesh.vertices, body.mesh.vertices)]
    return Garment(
        name=name,
        template=template,
        mesh=mesh,
        weights=weights,
        smooth_weights=_diffused(weights, mesh, diffusion),
        source=source,
    )


def _closest_vertices(points: Tensor, vertices: Tensor) -> Tensor:
    from scipy.spatial import KDTree

    _, nearest = KDTree(vertices.numpy()).query(points.numpy())
    return torch.from_numpy(nearest)


def _diffused(weights: Tensor, mesh: Mesh, distance: float) -> Tensor:
    owner = weld(mesh.vertices)
    moving = torch.nonzero(weights.any(dim=0)).squeeze(1)
    diffused = diffuse_weights(weights[:, moving], mesh.vertices, owner[mesh.faces], distance)
    return torch.zeros_like(weights).index_copy(1, moving, diffused[owner])
