"""Cloth through cloth: inner garments that show where an outer one is worn over them, at points on both."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh, face_normals
from uvcloth.physics.exposure import (
    COVER_DISTANCE,
    HIDING_DISTANCE,
    RAY_START_HEIGHT,
    UNDER_SKIN_DISTANCE,
    SurfaceSample,
    spread,
)
from uvcloth.physics.shell import Shell

OUTFIT_POINTS = 12000
"""Points over the cloth of an outfit: about one in a square of 15 mm."""


@dataclass(frozen=True)
class _Covered:
    """Points of a garment that others over it cover or cross at rest, and these others.

    place: of the garment in the outfit; those after it are over it.
    """

    points: SurfaceSample
    over: Shell
    place: int

    def beneath(self, garments: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Points (n, 3) m with a garment directly beneath that is worn over theirs, and their normals."""
        self.over.update(torch.cat(list(garments[self.place + 1 :])))
        points, normals = self.points.oriented(garments[self.place])
        distance, facing = self.over.first_hit(points, -normals, UNDER_SKIN_DISTANCE)
        rows = (distance < UNDER_SKIN_DISTANCE) & (facing < 0)
        return points[rows], normals[rows]


class ClothExposure:
    """Cloth that should lie beneath a garment and shows, as a share of the cloth that is visible at rest.

    A point of a garment comes through one that is worn over it if the ray inwards first meets the outer side
    of that, within UNDER_SKIN_DISTANCE, and is visible if neither cloth nor body is within HIDING_DISTANCE
    in front. Only points count that the other covers at rest, or crosses there: cloth that hangs over the
    waistband that it is tucked into is not wrong.
    """

    def __init__(self, body: Body, garments: Sequence[Mesh]) -> None:
        """Find the points; garments: as they lie on the body at rest, the innermost first."""
        self._body = Shell(body.mesh.vertices, body.mesh.faces)
        self._cloth = Shell.joined(garments)
        areas = [float(face_normals(mesh.vertices, mesh.faces).norm(dim=1).sum()) for mesh in garments]
        self._covered, self._visible = [], 0
        for place, (mesh, area) in enumerate(zip(garments, areas, strict=True)):
            sample = spread(mesh.vertices, mesh.faces, math.ceil(OUTFIT_POINTS * area / sum(areas)))
            sample = sample.subset(sample.in_tiles(mesh.vertices))
            self._visible += int(self._is_visible(*sample.oriented(mesh.vertices)).sum())
            if over := garments[place + 1 :]:
                self._covered.append(_covered(sample, mesh, place, over))

    def percent(self, garments: Sequence[Tensor], body_vertices: Tensor) -> float:
        """Percent of the visible cloth that should lie beneath other garments: 0 for one alone.

        garments: (N, 3) m of each. body_vertices: (V, 3) m of the posed body.
        """
        through = [covered.beneath(garments) for covered in self._covered]
        if not any(len(points) for points, _ in through):
            return 0.0
        points, normals = (torch.cat(each) for each in zip(*through, strict=True))
        self._cloth.update(torch.cat(list(garments)))
        self._body.update(body_vertices)
        return 100.0 * int(self._is_visible(points, normals).sum()) / max(self._visible, 1)

    def _is_visible(self, points: Tensor, normals: Tensor) -> Tensor:
        """Mask (n,) of points on cloth in front of which nothing is."""
        starts = points + RAY_START_HEIGHT * normals
        cloth, _ = self._cloth.first_hit(starts, normals, HIDING_DISTANCE)
        limbs, _ = self._body.first_hit(starts, normals, HIDING_DISTANCE)
        return torch.minimum(cloth, limbs) >= HIDING_DISTANCE


def _covered(sample: SurfaceSample, mesh: Mesh, place: int, over: Sequence[Mesh]) -> _Covered:
    """Points of a garment at rest that others over it cover or cross."""
    shell = Shell.joined(over)
    points, normals = sample.oriented(mesh.vertices)
    front, leaves = shell.first_hit(points, normals, COVER_DISTANCE)
    back, enters = shell.first_hit(points, -normals, UNDER_SKIN_DISTANCE)
    meets = ((front < COVER_DISTANCE) & (leaves > 0)) | ((back < UNDER_SKIN_DISTANCE) & (enters < 0))
    return _Covered(sample.subset(meets), shell, place)
