"""Faces of a character that its others enclose: ball joints inside a shell, skin inside clothes, a mouth.

Cloth cannot lie on them, and our surface would be drawn into the character by them.
"""

from dataclasses import replace

import torch
from torch import Tensor

from rasterize.raycast import cast_rays
from uvcloth.characters.shape import SkinnedSurface
from uvcloth.geometry.mesh import unit_face_normals
from uvcloth.rendering.lighting import sphere

FEW, MANY = 24, 96
"""Rays from each face, and from those of whose first rays none leaves the character."""

LEAST_LEAVING = 2
"""Rays of MANY that leave the character from a face that is not enclosed: an armpit is not."""

JUST_ABOVE = 1e-4
"""Metres above a face that rays begin."""


def without_enclosed(surface: SkinnedSurface) -> SkinnedSurface:
    """Leave out the faces of a surface from which hardly any ray leaves it, but for holes among open faces.

    Vertices stay.
    """
    normals = unit_face_normals(surface.vertices, surface.faces)
    origins = surface.vertices[surface.faces].mean(1) + JUST_ABOVE * normals
    doubtful = torch.nonzero(_leaving(surface, origins, FEW) == 0).squeeze(1)
    open_faces = torch.ones(len(surface.faces), dtype=torch.bool)
    open_faces[doubtful] = _leaving(surface, origins[doubtful], MANY) >= LEAST_LEAVING
    reached = torch.zeros(len(surface.vertices), dtype=torch.bool)
    reached[surface.faces[open_faces]] = True
    return replace(surface, faces=surface.faces[reached[surface.faces].all(1)])


def _leaving(surface: SkinnedSurface, origins: Tensor, rays: int) -> Tensor:
    """Number (N,) of the rays in all directions from points (N, 3) m that meet no face."""
    directions = torch.from_numpy(sphere(rays)).to(origins).repeat(len(origins), 1)
    starts = origins.repeat_interleave(rays, 0)
    hits = cast_rays(
        starts, directions, surface.vertices, surface.faces, max_distance=torch.inf, both_ways=False
    )
    return (hits.face < 0).view(-1, rays).sum(1)
