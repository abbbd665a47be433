"""Mirror images of training clips, which double the data where body and garment are symmetric."""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from rasterize.raycast import closest_points
from uvcloth.bodies.body import Body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.garments.garment import Garment
from uvcloth.geometry.mirror import mirror_transforms

SYMMETRIC = 0.005
"""Metres that a garment's mirrored vertices may be off its surface at rest."""


def mirror_clips(
    clips: Sequence[SimulatedClip], body: Body, garments: Sequence[Garment]
) -> list[SimulatedClip]:
    """The clips with left and right changed, of some garments; none if one of these is not symmetric.

    The vertices of a mesh have no partners: each takes the mirrored motion of the point of the surface that
    lies opposite to it at rest, between three vertices. Raises InputError if a joint has no counterpart.
    """
    opposite: dict[str, tuple[Tensor, Tensor]] = {}
    for garment in garments:
        mesh = garment.mesh
        closest = closest_points(_across(mesh.vertices), mesh.vertices, mesh.faces)
        if closest.distance.max() > SYMMETRIC:
            return []
        opposite[garment.name] = mesh.faces[closest.face], closest.barycentrics
    return [
        replace(
            clip,
            transforms=mirror_transforms(clip.transforms, body.skeleton),
            garments=tuple(
                replace(clip.by_name[name], vertices=_mirrored(clip.by_name[name].vertices, *points))
                for name, points in opposite.items()
            ),
        )
        for clip in clips
    ]


def _mirrored(vertices: Tensor, corners: Tensor, shares: Tensor) -> Tensor:
    """Mirrored motion (T, N, 3) of points given by corners (N, 3) and barycentrics (N, 3)."""
    return _across(torch.einsum("tnkc,nk->tnc", vertices[:, corners].float(), shares))


def _across(points: Tensor) -> Tensor:
    """Points (..., 3) mirrored across x = 0."""
    return points * points.new_tensor([-1.0, 1.0, 1.0])
