"""Contact: moves a garment out of the posed body and evens out its edges, in one go.

A frame begins with what the one before moved, so that folds last and few passes suffice.

Mocap presses arms into ribs and thighs into bellies. A vertex touches only the parts of the body that it lies
beside at rest, as in the simulations: another part that reaches into the cloth is none of its business. Where
two of its own parts leave no room for it, pushing leads nowhere: it is left calm and counted apart.

What is worn over other garments stays on their outer side wherever they cover it. What lies on their inner
side at rest, as a shirt that is tucked in, stays as free of them as they are of it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.collider import Collider
from uvcloth.physics import kernels, surface
from uvcloth.physics.launch import array, launch
from uvcloth.physics.layers import Layer
from uvcloth.physics.strain_limiter import StrainLimiter
from uvcloth.physics.surface import FREE

MARGIN = 0.004
"""Metres that contact keeps between cloth and skin, so that the faces between vertices clear it too."""

CLOSEST = 0.0005
"""Metres that it is content with in the end, where the edges would have it nearer."""

GAP = 0.004
"""Metres that it keeps between one garment and the next."""

PASSES = 20
"""Passes over the edges in a frame."""

KEPT = 0.9
"""Share of what a frame moved a vertex that the next one begins with."""

FARTHEST = 0.04
"""Metres that it begins with, at most: cloth caught on the wrong side of a limb comes free again."""

NARROW = 0.004
"""Metres between two parts of the body that leave cloth no room."""

PUSHES = 4
"""Times that a vertex is moved out in the end, at most: one part's surface may lead into another's."""

ALERT = 0.03
"""Metres from the skin within which a plane keeps a vertex off it."""

REACH = 0.1
"""Metres within which the nearest skin is sought: deeper in the body, cloth does not find its way out."""


@dataclass(frozen=True)
class Contacts:
    """What resolving did. Counts are of vertices that are not squeezed.

    inside_before, inside_after: vertices inside the body, before with what is carried over from the frame
    before. squeezed: vertices left calm between two parts of the body. deepest: metres that the deepest
    vertex is inside afterwards (0 if none).
    """

    inside_before: int
    inside_after: int
    squeezed: int
    deepest: float


@dataclass(frozen=True)
class InnerLayerContact:
    """An inner garment, as one that is worn over it meets it.

    rows: (R,) int64, the outer garment's vertices that are kept on its outer side. touches: (R,) int32, as in
    ContactGarment; parts: (F,) int32, the same of the inner garment's faces. A sleeve meets sleeves, not the
    trousers that an arm is pressed into.
    """

    layer: Layer
    rows: Tensor
    touches: Tensor
    parts: Tensor

    def find(self, vertices: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Which of an outer garment's vertices (N, 3) the layer is beside, as it lies now.

        Their rows (n,), their distance (n,) m and its normals there (n, 3).
        """
        found = self.layer.beside(vertices[self.rows])
        met = found.covered & (self.parts[found.faces] & self.touches != 0)
        return self.rows[met], found.distance[met], found.normals[met]


@dataclass(frozen=True)
class ContactGarment:
    """A garment in contact.

    cloth: its edges. touches: (N,) int32, a bit per part that may touch a vertex. over: what it is worn over,
    the innermost first.
    """

    cloth: StrainLimiter
    touches: Tensor
    over: tuple[InnerLayerContact, ...] = ()


@dataclass(frozen=True)
class Skin:
    """The nearest skin of N vertices. distance: (N,) m to it, negative inside, or less than that.

    normals: (N, 3) and offsets: (N,) m, the plane through it, as the product of its points with the normal.
    squeezed: (N,) bool, where two parts leave less than NARROW between them.
    """

    distance: Tensor
    normals: Tensor
    offsets: Tensor
    squeezed: Tensor

    @property
    def inside(self) -> Tensor:
        """Which vertices (N,) bool are inside the body and not squeezed."""
        return (self.distance < 0) & ~self.squeezed


class Obstacle:
    """The posed collider as its closed parts.

    body_vertices: (V, 3) m at rest; everything runs on their device.
    """

    def __init__(self, collider: Collider, body_vertices: Tensor) -> None:
        self.collider, self._rest = collider, body_vertices
        self._parts = surface.MovingMeshes(collider.vertices(body_vertices), collider.parts)

    def dress(self, vertices: Tensor, faces: Tensor, over: Sequence[Layer] = ()) -> ContactGarment:
        """A garment (N, 3) m, (M, 3) as it lies on the body at rest, and over others that do so too."""
        touches = self._touches(vertices)
        beneath = tuple(self._beneath(layer, vertices, touches) for layer in over)
        return ContactGarment(StrainLimiter(vertices, faces), touches, beneath)

    def update(self, body_vertices: Tensor) -> None:
        """Move to the posed body (V, 3)."""
        self._parts.update(self.collider.vertices(body_vertices))

    def skin(
        self, vertices: Tensor, garment: ContactGarment, reach: float = REACH, alert: float = math.inf
    ) -> Skin:
        """The nearest skin within reach, m, that each of a garment's vertices (N, 3) may touch.

        alert: metres outside the body from which on a distance need only be a lower bound, not below alert.
        """
        return self._search(vertices, garment.touches, vertices.new_full((len(vertices),), reach), alert)

    def resolve(
        self, vertices: Tensor, garment: ContactGarment, before: Tensor | None = None
    ) -> tuple[Tensor, Contacts]:
        """Move garment vertices (N, 3) out of the body to MARGIN, and give edges their rest length back.

        before: (N, 3) m, what contact moved in the frame before. Passes over the edges and planes beside the
        nearest skin, or of the garment beneath, work together, so that what is pushed out tears nothing; in
        the end single vertices that are still inside are moved out to CLOSEST.

        The layers that it is worn over have to be where they end in this frame.
        """
        start = vertices if before is None else vertices + _carried(before)
        skin = self.skin(start, garment, alert=ALERT)
        inside_before = int(skin.inside.sum())
        held = (skin.distance < ALERT) & ~skin.squeezed
        offsets = torch.where(held, skin.offsets + MARGIN, FREE)
        normals = skin.normals.clone() if garment.over else skin.normals
        for beneath in garment.over:
            rows, distance, directions = beneath.find(start)
            normals[rows] = directions
            offsets[rows] = (directions * start[rows]).sum(1) - distance + GAP
        vertices = garment.cloth.relax(start, PASSES, normals, offsets)
        for beneath in garment.over:
            rows, distance, directions = beneath.find(vertices)
            vertices[rows] += (CLOSEST - distance).clamp(min=0)[:, None] * directions
        self._follow(skin, vertices, vertices - start, garment)
        for _ in range(PUSHES):
            need = torch.where(skin.squeezed, 0.0, CLOSEST - skin.distance).clamp(min=0)
            if not bool(need.any()):
                break
            move = need[:, None] * skin.normals
            vertices = vertices + move
            self._follow(skin, vertices, move, garment)
        depth = torch.where(skin.inside, -skin.distance, 0.0)
        return vertices, Contacts(
            inside_before, int(skin.inside.sum()), int(skin.squeezed.sum()), float(depth.max())
        )

    def skins(self, frames: Tensor, garment: ContactGarment, body_frames: Tensor) -> Iterator[Skin]:
        """The nearest skin of a garment's vertices (F, N, 3), frame after frame, on the body (F, V, 3)."""
        for vertices, body_vertices in zip(frames, body_frames, strict=True):
            self.update(body_vertices)
            yield self.skin(vertices, garment, surface.REACH)

    def inside_percent(self, frames: Tensor, garment: ContactGarment, body_frames: Tensor) -> Tensor:
        """Percent of a garment's vertices (F, N, 3) that are inside the body (F, V, 3): (F,)."""
        shares = [100.0 * skin.inside.float().mean() for skin in self.skins(frames, garment, body_frames)]
        return torch.stack(shares) if shares else frames.new_zeros(0)

    def _touches(self, vertices: Tensor) -> Tensor:
        """A bit per part that may touch each of a garment's vertices (N, 3) at rest: (N,) int32."""
        touches = self.collider.touches(vertices, self._rest)
        bits = 2 ** torch.arange(len(touches), device=touches.device)
        return (touches * bits[:, None]).sum(0).int()

    def _beneath(self, layer: Layer, vertices: Tensor, touches: Tensor) -> InnerLayerContact:
        """A layer at rest as the vertices (N, 3) over it meet it, all but those on its inner side."""
        found = layer.beside(vertices, surface.REACH)
        rows = torch.nonzero(~found.covered | (found.distance >= 0)).squeeze(1)
        first, second, third = self._touches(layer.points)[layer.faces].unbind(1)
        return InnerLayerContact(layer, rows, touches[rows], first | second | third)

    def _follow(self, skin: Skin, vertices: Tensor, move: Tensor, garment: ContactGarment) -> None:
        """Bring the skin up to date, in place, after a move (N, 3).

        A move changes no distance by more than its length: only vertices that may now be too near are looked
        up, and not much farther away than they can be inside.
        """
        skin.distance.sub_(move.norm(dim=1))
        rows = torch.nonzero(skin.distance < CLOSEST).squeeze(1)
        if not len(rows):
            return
        reach = (-skin.distance[rows]).clamp(min=0) + 2.0 * MARGIN
        found = self._search(vertices[rows], garment.touches[rows], reach)
        skin.distance[rows] = found.distance
        near = torch.nonzero(found.distance < reach).squeeze(1)
        skin.normals[rows[near]], skin.offsets[rows[near]] = found.normals[near], found.offsets[near]
        skin.squeezed[rows] = found.squeezed

    def _search(self, vertices: Tensor, touches: Tensor, reach: Tensor, alert: float = math.inf) -> Skin:
        """The nearest skin of N vertices within their reach (N,), m; alert as in `skin`."""
        distance, offsets, gap = (torch.empty_like(reach) for _ in range(3))
        normals = torch.empty_like(vertices)
        query = (*map(array, (touches, vertices, reach)), alert, NARROW)
        results = map(array, (distance, normals, offsets, gap))
        launch(kernels.closest_touched, len(vertices), vertices.device, self._parts.ids, *query, *results)
        return Skin(distance, normals, offsets, gap < NARROW)


def _carried(move: Tensor) -> Tensor:
    """What of the moves (N, 3) of one frame the next begins with."""
    return move * (FARTHEST / move.norm(dim=1, keepdim=True).clamp(min=FARTHEST) * KEPT)
