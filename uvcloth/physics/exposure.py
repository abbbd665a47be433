"""Visible penetration: skin that shows through the cloth, measured at points over the surface.

Vertices do not show it: the faces of a coarse garment may cut through a shoulder while all its vertices are
outside. Cloth and skin are therefore sampled at points spread evenly over their areas.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.gather import gather
from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import JoinedMesh, Mesh, face_normals
from uvcloth.physics.shell import Shell
from uvcloth.physics.visibility import VisibilityTest
from uvcloth.player.opening import in_tiles
from uvcloth.player.shell import sample

CLOTH_POINTS = 3000
"""Points over the cloth of a garment."""

SKIN_POINTS = 12000
"""Points over the whole body: about one in a square of 12 mm."""

COVER_DISTANCE = 0.3
"""Metres in front of the skin within which a garment at rest covers it: a skirt drapes away from the legs."""

UNDER_SKIN_DISTANCE = 0.05
"""Metres under the skin within which cloth is searched that the skin shows through."""

HIDING_DISTANCE = 0.1
"""Metres in front of the skin within which other cloth, or another limb, hides it."""

RAY_START_HEIGHT = 1.0e-5
"""Metres above the skin from where rays that may meet the body itself start."""

R2_STEPS = (0.7548776662466927, 0.5698402909980532)
"""Steps of the additive sequence R2, whose points fill the unit square evenly (Roberts 2018)."""


@dataclass(frozen=True)
class SurfaceSample:
    """Points on a mesh that move with it: corners (P, 3) int64 of their faces, and barycentrics (P, 3)."""

    corners: Tensor
    barycentrics: Tensor

    def points(self, vertices: Tensor) -> Tensor:
        """Positions on posed vertices (..., V, 3) m: (..., P, 3) m."""
        return gather(vertices, self.corners, self.barycentrics)

    def oriented(self, vertices: Tensor) -> tuple[Tensor, Tensor]:
        """Points and the unit normals of their faces, (P, 3) each, on posed vertices (V, 3) m."""
        arrays = (vertices, self.corners.int(), self.barycentrics)
        points, normals = sample(*(array.detach().cpu().numpy() for array in arrays))
        return torch.from_numpy(points).to(vertices.device), torch.from_numpy(normals).to(vertices.device)

    def in_tiles(self, vertices: Tensor) -> Tensor:
        """Order (P,) of the points on vertices (V, 3) m in which neighbours lie together: rays from them are
        faster.
        """
        return torch.from_numpy(in_tiles(self.points(vertices).float().numpy()))

    def subset(self, rows: Tensor) -> "SurfaceSample":
        """Subset of the points, by mask or index (K,)."""
        return SurfaceSample(self.corners[rows], self.barycentrics[rows])


def spread(vertices: Tensor, faces: Tensor, count: int) -> SurfaceSample:
    """Sample `count` points of a mesh (V, 3) m, (F, 3), each for the same area; the same on every call.

    A face gets its share of them to within one; within the faces they follow a sequence of low discrepancy.
    """
    areas = face_normals(vertices, faces).norm(dim=1).double().cumsum(0)
    places = (torch.arange(count, device=vertices.device) + 0.5) * (areas[-1] / count)
    rows = torch.searchsorted(areas, places).clamp(max=len(faces) - 1)
    steps = torch.tensor(R2_STEPS, dtype=torch.float64, device=vertices.device)
    u, v = torch.frac(torch.arange(1, count + 1, device=vertices.device)[:, None] * steps).unbind(1)
    folded = u + v > 1
    u, v = torch.where(folded, 1 - u, u), torch.where(folded, 1 - v, v)
    return SurfaceSample(faces[rows], torch.stack([u, v, 1 - u - v], dim=1).to(vertices.dtype))


@dataclass(frozen=True)
class ShownSkin:
    """Points of the skin that show through cloth, K of them, and the cloth beneath each.

    rows: (K,) of the points among the covered ones. normals: (K, 3) of the skin. depths: (K,) m from the skin
    to the cloth. faces: (K,) of the cloth. barycentrics: (K, 3) there.
    """

    rows: Tensor
    normals: Tensor
    depths: Tensor
    faces: Tensor
    barycentrics: Tensor


class Exposure:
    """Skin that garments cover at rest, and the share of it that sticks out of them when they move.

    A point of the skin is covered if the ray along its normal first meets, within COVER_DISTANCE, the inner
    side of the garments. It shows if, posed, the ray into the body first meets their outer side, within
    UNDER_SKIN_DISTANCE, and neither they nor another part of the body are within HIDING_DISTANCE in front.
    Skin that a hem has left bare does not count, nor in measures what is seen from no side, as in a lap.
    covered: these points.
    """

    def __init__(self, body: Body, garments: Sequence[Mesh | JoinedMesh], count: int = SKIN_POINTS) -> None:
        """Find the covered points among `count`; garments: as they lie on the body at rest."""
        self._cloth, self._body = _shells(body, garments)
        everywhere = spread(body.mesh.vertices, body.mesh.faces, count)
        covered = _covered(self._cloth, self._body, everywhere, body.mesh.vertices)
        self.covered = everywhere.subset(covered)
        self._order = self.covered.in_tiles(body.mesh.vertices)
        self._followed = self.covered.subset(self._order)
        self._onlooker = VisibilityTest((self._cloth, self._body))

    def shown(self, garments: Sequence[Tensor], body_vertices: Tensor) -> ShownSkin:
        """Covered points of a posed body (V, 3) m that show through garments (N, 3) m."""
        self._cloth.update(torch.cat(list(garments)))
        points, normals = self._followed.oriented(body_vertices)
        depths, facing, faces, barycentrics = self._cloth.first_faces(points, -normals, UNDER_SKIN_DISTANCE)
        rows = torch.nonzero((depths < UNDER_SKIN_DISTANCE) & (facing < 0)).squeeze(1)
        if len(rows):
            self._body.update(body_vertices)
            points, above = points[rows], normals[rows]
            folds, _ = self._cloth.first_hit(points, above, HIDING_DISTANCE)
            limbs, _ = self._body.first_hit(points + RAY_START_HEIGHT * above, above, HIDING_DISTANCE)
            rows = rows[(folds >= HIDING_DISTANCE) & (limbs >= HIDING_DISTANCE)]
        there = (values[rows] for values in (normals, depths, faces, barycentrics))
        return ShownSkin(self._order[rows], *there)

    def shows(self, garments: Sequence[Tensor], body_vertices: Tensor) -> Tensor:
        """Mask (P,) of the covered points that show, as of `shown`, and are seen from any side."""
        shows = torch.zeros(len(self.covered.corners), dtype=torch.bool, device=body_vertices.device)
        rows = self.shown(garments, body_vertices).rows
        if len(rows):
            shows[rows] = self._onlooker.sees(self.covered.subset(rows).points(body_vertices))
        return shows

    def percent(self, garments: Sequence[Tensor], body_vertices: Tensor) -> float:
        """Percent of the covered points that show, 0 if nothing is covered. Arguments as of `shows`."""
        shows = self.shows(garments, body_vertices)
        return 100.0 * float(shows.float().mean()) if len(shows) else 0.0


def middles(mesh: Mesh) -> SurfaceSample:
    """The middles of a mesh's faces, in their order."""
    return SurfaceSample(mesh.faces, mesh.vertices.new_full((len(mesh.faces), 3), 1 / 3))


def covered_skin(body: Body, garments: Sequence[Mesh]) -> Tensor:
    """Mask (F,) of the body's faces whose middle garments cover at rest, as `Exposure` says."""
    return _covered(*_shells(body, garments), middles(body.mesh), body.mesh.vertices)


def _shells(body: Body, garments: Sequence[Mesh | JoinedMesh]) -> tuple[Shell, Shell]:
    """The garments as one mesh, and the body, at rest."""
    return Shell.joined(garments), Shell(body.mesh.vertices, body.mesh.faces)


def _covered(cloth: Shell, skin: Shell, sample: SurfaceSample, body_vertices: Tensor) -> Tensor:
    """Mask (P,) of the points of a sample of the body at rest (V, 3) m that are covered there."""
    points, normals = sample.oriented(body_vertices)
    distance, facing = cloth.first_hit(points, normals, COVER_DISTANCE)
    limb, _ = skin.first_hit(points + RAY_START_HEIGHT * normals, normals, COVER_DISTANCE)
    return (distance < COVER_DISTANCE) & (facing > 0) & (distance < limb)
