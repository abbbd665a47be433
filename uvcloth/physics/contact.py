"""Contact: moves garments out of the posed body and restores edge lengths, in one solve.

A frame starts from the corrections of the one before, so that folds persist and few passes suffice.

Mocap presses arms into ribs and thighs into bellies: such parts are opened first. A vertex touches only
the parts of the body that it lies next to at rest, as in the simulations; other parts do not act on it. A
vertex between two parts without room cannot be pushed out of both: it stays where the edges put it and is
counted as squeezed.

A garment over others stays on their outer side wherever it covers them. Vertices that are on their inner side
at rest, as those of a tucked-in shirt, are not moved by these garments.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.collider import Collider, touch_bits
from uvcloth.bodies.opened import make_opening
from uvcloth.physics import kernels, surface
from uvcloth.physics.launch import array, launch
from uvcloth.physics.layers import Layer
from uvcloth.physics.strain_limiter import StrainLimiter
from uvcloth.physics.surface import FREE

SKIN_CLEARANCE = 0.004
"""Metres that contact keeps between cloth and skin, so that the faces between vertices clear it too."""

FINAL_CLEARANCE = 0.0005
"""Metres that cloth keeps at the end, where edges pull it closer."""

LAYER_CLEARANCE = 0.004
"""Metres that contact keeps between one garment and the next."""

EDGE_PASSES = 20
"""Passes over the edges in a frame."""

WARM_START_SHARE = 0.7
"""Share of a frame's correction of a vertex that the next frame starts from."""

MAX_WARM_START = 0.04
"""Largest correction, m, that a frame starts from: cloth caught on the wrong side of a limb gets free."""

SQUEEZE_GAP = 0.004
"""Metres between two parts of the body below which they squeeze cloth."""

MAX_PUSHES = 4
"""Most times that a vertex is moved out at the end: the way out of one part may lead into another."""

PLANE_DISTANCE = 0.03
"""Metres from the skin within which a plane keeps a vertex off it."""

MEASURED_DISTANCE = 0.01
"""Metres outside the body beyond which a vertex is neither inside nor squeezed, however far away it is."""

SKIN_SEARCH_DISTANCE = 0.1
"""Metres within which the closest skin is searched; cloth deeper in the body is not moved out."""


@dataclass(frozen=True)
class Contacts:
    """Result of one contact solve. Counts are of vertices that are not squeezed.

    inside_before, inside_after: vertices inside the body; before includes the corrections of the frame
    before. squeezed: vertices left between two parts of the body. deepest: metres that the deepest
    vertex is inside afterwards (0 if none).
    """

    inside_before: int
    inside_after: int
    squeezed: int
    deepest: float


@dataclass(frozen=True)
class InnerLayerContact:
    """Contact of an outer garment with an inner one.

    rows: (R,) int64, the outer garment's vertices that are kept on its outer side. touches: (R,) int32, as in
    ContactGarment; parts: (F,) int32, the same of the inner garment's faces. A sleeve touches sleeves, not
    the trousers that an arm is pressed into.
    """

    layer: Layer
    rows: Tensor
    touches: Tensor
    parts: Tensor

    def find(self, vertices: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Vertices of the outer garment (N, 3) m that the layer covers, as it lies now.

        Returns their rows (n,), their distance (n,) m and its normals there (n, 3).
        """
        closest = self.layer.beside(vertices[self.rows])
        met = closest.covered & (self.parts[closest.faces] & self.touches != 0)
        return self.rows[met], closest.distance[met], closest.normals[met]


@dataclass(frozen=True)
class ContactGarment:
    """A garment prepared for contact.

    cloth: its strain limiter. touches: (N,) int32, a bit per part that may touch a vertex. over: the garments
    beneath it, the innermost first.
    """

    cloth: StrainLimiter
    touches: Tensor
    over: tuple[InnerLayerContact, ...] = ()


@dataclass(frozen=True)
class Skin:
    """Nearest skin of N vertices.

    distance: (N,) m to it, negative inside, or a lower bound of that. normals: (N, 3) and offsets: (N,) m,
    the plane through it, as the product of its points with the normal. gap: (N,) m, the room between the two
    parts that a vertex is nearest to where they face each other, negative where they overlap.
    """

    distance: Tensor
    normals: Tensor
    offsets: Tensor
    gap: Tensor

    @property
    def squeezed(self) -> Tensor:
        """Mask of the vertices that two parts leave less than SQUEEZE_GAP: (N,) bool."""
        return self.gap < SQUEEZE_GAP

    def room(self, clearance: float) -> Tensor:
        """Metres (N,) to keep off the skin: the clearance, or where two parts leave less, the middle.

        Where they overlap, it is the (negative) gap itself: it changes without a step as the gap closes.
        """
        return torch.where(self.gap > 0, 0.5 * self.gap, self.gap).clamp(max=clearance)

    @property
    def inside(self) -> Tensor:
        """Mask of the vertices that are inside the body and not squeezed: (N,) bool."""
        return (self.distance < 0) & ~self.squeezed


class Obstacle:
    """Posed collider: the closed parts of a body that garments are kept out of, opened to give them room.

    body_vertices: (V, 3) m at rest; everything runs on their device.
    """

    def __init__(self, collider: Collider, body_vertices: Tensor) -> None:
        self.collider, self._rest = collider, body_vertices
        self._opened, self._opening = collider, make_opening(collider, body_vertices)
        self._parts = surface.MovingMeshes(collider.vertices(body_vertices), collider.parts)

    def contact_garment(self, vertices: Tensor, faces: Tensor, over: Sequence[Layer] = ()) -> ContactGarment:
        """Prepare a garment at rest, vertices (N, 3) m and faces (M, 3), over others at rest."""
        touches = self._touches(vertices)
        touched = torch.stack([(touches >> part & 1).any() for part in range(len(self.collider.parts))])
        opened = self._opened.for_cloth(touched)
        if opened.pressed != self._opened.pressed:
            self._opened, self._opening = opened, make_opening(opened, self._rest)
        beneath = tuple(self._beneath(layer, vertices, touches) for layer in over)
        return ContactGarment(StrainLimiter(vertices, faces), touches, beneath)

    def update(self, body_vertices: Tensor) -> None:
        """Move to the posed body (V, 3), opened."""
        self._parts.update(self._opening.opened(self.collider.vertices(body_vertices)))

    def skin(
        self,
        vertices: Tensor,
        garment: ContactGarment,
        reach: float = SKIN_SEARCH_DISTANCE,
        exact: float = math.inf,
    ) -> Skin:
        """Nearest skin within reach, m, of the parts that each of a garment's vertices (N, 3) m may touch.

        exact: metres outside the body beyond which a distance is a lower bound, not below these.
        """
        return self._search(vertices, garment.touches, vertices.new_full((len(vertices),), reach), exact)

    def resolve(
        self, vertices: Tensor, garment: ContactGarment, before: Tensor | None = None
    ) -> tuple[Tensor, Contacts]:
        """Move garment vertices (N, 3) m out of the body, and give edges a plausible length.

        before: (N, 3) m, the corrections of the frame before. Each pass over the edges also keeps vertices
        SKIN_CLEARANCE off the nearest skin, or LAYER_CLEARANCE off the garment beneath, so that pushing out
        tears nothing. At the end vertices that are still inside are moved out to FINAL_CLEARANCE.

        Inner layers have to be at their final places of this frame.
        """
        start = vertices if before is None else vertices + _warm_start(before)
        skin = self.skin(start, garment, exact=PLANE_DISTANCE)
        inside_before = int(skin.inside.sum())
        held = skin.distance < PLANE_DISTANCE
        offsets = torch.where(held, skin.offsets + skin.room(SKIN_CLEARANCE), FREE)
        normals = skin.normals.clone() if garment.over else skin.normals
        for beneath in garment.over:
            rows, distance, directions = beneath.find(start)
            normals[rows] = directions
            offsets[rows] = (directions * start[rows]).sum(1) - distance + LAYER_CLEARANCE
        vertices = garment.cloth.relax(start, EDGE_PASSES, normals, offsets, predicted=vertices)
        for beneath in garment.over:
            rows, distance, directions = beneath.find(vertices)
            vertices[rows] += (FINAL_CLEARANCE - distance).clamp(min=0)[:, None] * directions
        self._follow(skin, vertices, vertices - start, garment)
        for _ in range(MAX_PUSHES):
            need = (skin.room(FINAL_CLEARANCE) - skin.distance).clamp(min=0)
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
        """Yield the nearest skin of a garment's vertices (F, N, 3) m on the body (F, V, 3) m, by frame.

        Distances are exact up to MEASURED_DISTANCE outside.
        """
        for vertices, body_vertices in zip(frames, body_frames, strict=True):
            self.update(body_vertices)
            yield self.skin(vertices, garment, surface.SEARCH_DISTANCE, MEASURED_DISTANCE)

    def inside_percent(self, frames: Tensor, garment: ContactGarment, body_frames: Tensor) -> Tensor:
        """Percent of a garment's vertices (F, N, 3) that are inside the body (F, V, 3): (F,)."""
        shares = [100.0 * skin.inside.float().mean() for skin in self.skins(frames, garment, body_frames)]
        return torch.stack(shares) if shares else frames.new_zeros(0)

    def _touches(self, vertices: Tensor) -> Tensor:
        """Bits of the parts that may touch each of a garment's vertices (N, 3) m at rest: (N,) int32."""
        return touch_bits(self.collider.touches(vertices, self._rest))

    def _beneath(self, layer: Layer, vertices: Tensor, touches: Tensor) -> InnerLayerContact:
        """Contact of vertices (N, 3) m with a layer at rest, all but those on its inner side."""
        closest = layer.beside(vertices, surface.SEARCH_DISTANCE)
        rows = torch.nonzero(~closest.covered | (closest.distance >= 0)).squeeze(1)
        first, second, third = self._touches(layer.points)[layer.faces].unbind(1)
        return InnerLayerContact(layer, rows, touches[rows], first | second | third)

    def _follow(self, skin: Skin, vertices: Tensor, move: Tensor, garment: ContactGarment) -> None:
        """Bring the skin up to date, in place, after a move (N, 3).

        A move changes no distance by more than its length: only vertices that may now be too close are
        searched, within little more than their greatest possible depth.
        """
        skin.distance.sub_(move.norm(dim=1))
        rows = torch.nonzero(skin.distance < FINAL_CLEARANCE).squeeze(1)
        if not len(rows):
            return
        reach = (-skin.distance[rows]).clamp(min=0) + 2.0 * SKIN_CLEARANCE
        closest = self._search(vertices[rows], garment.touches[rows], reach)
        skin.distance[rows] = closest.distance
        near = torch.nonzero(closest.distance < reach).squeeze(1)
        skin.normals[rows[near]], skin.offsets[rows[near]] = closest.normals[near], closest.offsets[near]
        skin.gap[rows] = closest.gap

    def _search(self, vertices: Tensor, touches: Tensor, reach: Tensor, exact: float = math.inf) -> Skin:
        """The nearest skin of N vertices within their reach (N,), m; exact as in `skin`."""
        distance, offsets, gap = (torch.empty_like(reach) for _ in range(3))
        normals = torch.empty_like(vertices)
        query = (*map(array, (touches, vertices, reach)), exact, SQUEEZE_GAP)
        results = map(array, (distance, normals, offsets, gap))
        launch(kernels.closest_touched, len(vertices), vertices.device, self._parts.ids, *query, *results)
        return Skin(distance, normals, offsets, gap)


def _warm_start(move: Tensor) -> Tensor:
    """Corrections (N, 3) m that the next frame starts from, of those of this frame (N, 3)."""
    return move * (
        MAX_WARM_START / move.norm(dim=1, keepdim=True).clamp(min=MAX_WARM_START) * WARM_START_SHARE
    )
