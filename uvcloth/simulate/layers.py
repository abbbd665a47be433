"""Garments worn over one another: which side of an inner one an outer one is on, and the room it leaves."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.errors import InputError
from uvcloth.mesh import vertex_normals
from uvcloth.physics.surface import BodySurface
from uvcloth.simulate.cloth import Cloth

NEAR = 0.03
"""Metres within which an inner garment is looked for."""

STEEPEST = 0.7
"""Cosine of the angle from its normal under which it covers a point: beside its hem it does not."""

THICKNESS = 0.006
"""Metres that layers keep apart."""

MOST_CROSSED = 1.0
"""Percent of the covered vertices that may be on the wrong side at rest."""


@dataclass(frozen=True)
class Beside:
    """Where N points are beside an inner garment.

    covered: (N,) bool, whether it is within NEAR of a point, and not beside its hem. distance: (N,) m along
    its normals, negative on its inner side.
    """

    covered: Tensor
    distance: Tensor


def beside(points: Tensor, vertices: Tensor, faces: Tensor) -> Beside:
    """Where points (N, 3) are beside an inner garment, vertices (M, 3) and faces (F, 3)."""
    found = BodySurface(vertices, faces).closest(points, NEAR)
    normals = vertex_normals(vertices, faces)[faces[found.faces.clamp(min=0)]]
    normals = torch.nn.functional.normalize((normals * found.barycentrics[..., None]).sum(1), dim=-1)
    offset = points - found.points
    distance = (offset * normals).sum(1)
    return Beside((found.faces >= 0) & (distance.abs() >= STEEPEST * offset.norm(dim=1)), distance)


def wrong_side_percent(outer: Tensor, inner: Tensor, faces: Tensor) -> float:
    """Percent of an outer garment's vertices that are on the inner side of an inner one, of those it covers.

    outer: (F, N, 3), inner: (F, M, 3) m, over all frames; 0 if it covers none.
    """
    covered = wrong = 0
    for points, vertices in zip(outer, inner, strict=True):
        found = beside(points, vertices, faces)
        covered += int(found.covered.sum())
        wrong += int((found.covered & (found.distance < 0)).sum())
    return 100.0 * wrong / max(covered, 1)


def check_order(cloths: Sequence[Cloth]) -> None:
    """Raise InputError if, at rest, one garment is not over those before it wherever they cover it."""
    for index, outer in enumerate(cloths):
        for inner in cloths[:index]:
            over, under = outer.garment, inner.garment
            crossed = wrong_side_percent(
                over.mesh.vertices[None], under.mesh.vertices[None], under.mesh.faces
            )
            if crossed > MOST_CROSSED:
                raise InputError(
                    f"garment {over.name}: cannot be worn over the garment {under.name}, at rest it is "
                    f"under it in {crossed:.0f} % of the places where they meet"
                )


def room_below(cloth: Cloth, inner: Sequence[Cloth]) -> Tensor:
    """Metres (n,) that the garments under a cloth's vertices take, at rest."""
    points = cloth.garment.mesh.vertices[cloth.kept]
    room = torch.zeros(len(points))
    for other in inner:
        mesh = other.garment.mesh
        room += THICKNESS * beside(points, mesh.vertices, mesh.faces).covered
    return room
