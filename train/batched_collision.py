"""Collision of an outfit in many poses at once: with the body near it, and with its own inner layers."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import collider_near, make_collider, touch_bits
from uvcloth.bodies.opened import ColliderOpening, make_opening
from uvcloth.geometry.records import to_device
from uvcloth.geometry.skinning import skin
from uvcloth.physics.obstacle import SQUEEZE_GAP
from uvcloth.physics.surface import FREE, SEARCH_DISTANCE

from . import kernels
from .launch import array, launch
from .moving_meshes import MeshTrees, MovingSheet
from .posed_batch import ClosestPointCache, Planes, PosedMeshBatch

NEAR_BODY = 0.2
"""Metres from the outfit at rest within which the body is collided with."""

NEAR_LAYER = 0.1
"""Metres from an inner layer within which what it covers at rest lies over it."""

LAYER_SEARCH_DISTANCE = 0.03
"""Metres from an inner layer within which each step looks for what lies over it."""

COPY_SPACING = 10.0
"""Metres between the copies of a layer, one for each pose, which are one mesh."""


class NearbyBody:
    """The part of a body near an outfit at rest (U, 3) m, in as many poses at once as a batch has."""

    def __init__(self, body: Body, outfit: Tensor, batch: int, device: torch.device) -> None:
        kept, collider = collider_near(body, outfit.cpu(), NEAR_BODY)
        rest, weights = body.mesh.vertices[kept], body.weights[kept]
        self._rest, self._weights, self._collider = to_device((rest, weights, collider), device)
        self._meshes = PosedMeshBatch(self._collider.vertices(self._rest), collider.parts[0], batch)

    def move(self, transforms: Tensor) -> None:
        """Move to the poses of joint transforms (B, J, 3, 4)."""
        self._meshes.update(self._collider.vertices(skin(self._rest, self._weights, transforms)))

    def planes(self, outfit: Tensor, near: float, cache: ClosestPointCache | None, plane: str) -> Planes:
        """The planes that keep an outfit (B, U, 3) m off the body where it is near, m."""
        return self._meshes.planes(outfit, near, cache, corner=plane == "vertex")


class PosedParts:
    """The closed parts of a body, or of another of its mesh, in as many poses at once as `count`."""

    def __init__(self, body: Body, count: int, device: torch.device) -> None:
        self._collider = to_device(make_collider(body), device)
        rest = self._collider.vertices(body.mesh.vertices.to(device))
        faces = [part + pose * len(rest) for pose in range(count) for part in self._collider.parts]
        self._meshes = MeshTrees(rest.repeat(count, 1), faces)

    def met_by(self, points: Tensor, body: Body) -> tuple[Tensor, ColliderOpening]:
        """The parts of a body that points (N, 3) m at rest may touch, and how these are opened for them.

        A bit per part, (N,) int32. Forearms are opened where they have sleeves, as in contact.
        """
        touches = self._collider.touches(points, body.mesh.vertices.to(points))
        opening = make_opening(self._collider.for_cloth(touches.any(1)), body.mesh.vertices)
        return touch_bits(touches), opening

    def move(self, vertices: Tensor, opening: ColliderOpening) -> None:
        """Move to the poses of a body (B, V, 3) m, no more than `count`, opened."""
        placed = opening.opened(self._collider.vertices(vertices)).flatten(0, 1)
        self._meshes.update(torch.cat([placed, self._meshes.points[len(placed) :]]))

    def planes(self, points: Tensor, touches: Tensor, near: float) -> Planes:
        """The planes that keep points (B, N, 3) m off the parts that they may touch, where they are near, m.

        None where two parts leave no room between them: what is squeezed is not pushed.
        """
        points = points.detach().float().contiguous()
        normals, distance = torch.zeros_like(points), torch.zeros_like(points[..., 0])
        offsets, gap = torch.zeros_like(distance), torch.zeros_like(distance)
        reach = distance.new_full(distance.shape[1:], SEARCH_DISTANCE)
        each = len(self._collider.parts)
        for pose in range(len(points)):
            parts = self._meshes.ids[pose * each : (pose + 1) * each]
            query = (parts, *map(array, (touches, points[pose], reach)), near, SQUEEZE_GAP)
            outputs = map(array, (distance[pose], normals[pose], offsets[pose], gap[pose]))
            launch(kernels.closest_touched, points.shape[1], points.device, *query, *outputs)
        met = (distance < near) & (gap >= SQUEEZE_GAP)
        return Planes(normals, torch.where(met, offsets, FREE))


@dataclass(frozen=True)
class LayerPair:
    """A garment of an outfit and one worn over it.

    rows: (n,) of it among the outfit's U vertices. outer: (m,) those of the other that can meet it. copies:
    the layer in as many poses as a batch has.
    """

    rows: Tensor
    outer: Tensor
    copies: MovingSheet

    def distance(self, outfit: Tensor, normals: Tensor) -> Tensor:
        """Signed distance (B, m) m of the other garment from the layer, see `planes`."""
        return self.planes(outfit, normals).distance(outfit[:, self.outer])

    def planes(self, outfit: Tensor, normals: Tensor) -> Planes:
        """The planes that keep the other garment (B, m, 3) over the layer: outfit (B, U, 3) m, as it is now.

        normals: (B, U, 3) of the outfit. Only where both face the same way does one lie over the other:
        trousers of a thigh that is pressed into the belly do not lie under the shirt there.
        """
        aside = outfit.new_zeros(len(outfit), 1, 3)
        aside[:, 0, 0] = COPY_SPACING * torch.arange(len(outfit), device=outfit.device)
        inner, outer = (outfit[:, rows].detach() + aside for rows in (self.rows, self.outer))
        placed = self.copies.points.clone()
        placed[: inner[..., 0].numel()] = inner.flatten(0, 1)
        self.copies.update(placed)
        closest = self.copies.beside(outer.flatten(0, 1), LAYER_SEARCH_DISTANCE)
        offsets = (closest.normals * (outer - aside).flatten(0, 1)).sum(1) - closest.distance
        alike = (closest.normals * normals[:, self.outer].flatten(0, 1)).sum(1) > 0
        offsets = torch.where(closest.covered & alike, offsets, FREE)
        return Planes(closest.normals.view_as(outer), offsets.view(outer.shape[:2]))


def inner_layers(outfit: Tensor, garments: Sequence[tuple[Tensor, Tensor]], batch: int) -> list[LayerPair]:
    """The layers of an outfit at rest (U, 3) m: garments as rows (n,) among the U and faces (F, 3) into them.

    Innermost first, each with what it covers of each of those after it, but for what is on its inner side.
    """
    aside = (
        COPY_SPACING
        * torch.arange(batch, device=outfit.device)[:, None, None]
        * outfit.new_tensor([1.0, 0, 0])
    )
    layers = []
    for index, (rows, faces) in enumerate(garments[:-1]):
        tiled = faces + len(rows) * torch.arange(batch, device=outfit.device)[:, None, None]
        copies = MovingSheet((outfit[rows] + aside).flatten(0, 1), tiled.flatten(0, 1))
        alone = MovingSheet(outfit[rows], faces)
        for over, _ in garments[index + 1 :]:
            closest = alone.beside(outfit[over], NEAR_LAYER)
            layers.append(LayerPair(rows, over[closest.covered & (closest.distance >= 0)], copies))
    return layers
