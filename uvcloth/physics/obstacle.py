"""Obstacle: the closed, opened parts of a posed body, and the nearest skin of the vertices that touch them.

Mocap presses arms into ribs and thighs into bellies: such parts are opened first. A vertex touches only
the parts of the body that it lies next to at rest, as in the simulations. A vertex between two parts without
room cannot be outside both: it is squeezed, and counted so.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.collider import Collider, touch_bits
from uvcloth.bodies.opened import make_opening
from uvcloth.physics.layers import InnerLayer, Layer, inner_layer
from uvcloth.physics.surface import SEARCH_DISTANCE
from uvcloth.player.meshes import MovingMeshes

SQUEEZE_GAP = 0.004
"""Metres between two parts of the body below which they squeeze cloth."""

MEASURED_DISTANCE = 0.01
"""Metres outside the body beyond which a vertex is neither inside nor squeezed, however far away it is."""

SKIN_SEARCH_DISTANCE = 0.1
"""Metres within which the closest skin is searched."""


@dataclass(frozen=True)
class ContactGarment:
    """A garment prepared for contact.

    touches: (N,) int32, a bit per part that may touch a vertex. over: the garments beneath it, the innermost
    first.
    """

    touches: Tensor
    over: tuple[InnerLayer, ...] = ()


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

    @property
    def inside(self) -> Tensor:
        """Mask of the vertices that are inside the body and not squeezed: (N,) bool."""
        return (self.distance < 0) & ~self.squeezed


class Obstacle:
    """Posed collider: the closed parts of a body that garments are kept out of, opened to give them room.

    body_vertices: (V, 3) m at rest. Skin is searched on the processor; results are on the device of vertices.
    """

    def __init__(self, collider: Collider, body_vertices: Tensor) -> None:
        self.collider, self._rest = collider, body_vertices
        self._opened, self._opening = collider, make_opening(collider, body_vertices)
        rest, parts = collider.vertices(body_vertices), collider.parts
        self._parts = MovingMeshes(rest.cpu().numpy(), [part.cpu().numpy() for part in parts])

    def contact_garment(self, vertices: Tensor, over: Sequence[Layer] = ()) -> ContactGarment:
        """Prepare a garment at rest, vertices (N, 3) m, over others at rest."""
        touches = self._touches(vertices)
        touched = torch.stack([(touches >> part & 1).any() for part in range(len(self.collider.parts))])
        opened = self._opened.for_cloth(touched)
        if opened.pressed != self._opened.pressed:
            self._opened, self._opening = opened, make_opening(opened, self._rest)
        beneath = tuple(inner_layer(layer, touches, self._touches(layer.points)) for layer in over)
        return ContactGarment(touches, beneath)

    def update(self, body_vertices: Tensor) -> None:
        """Move to the posed body (V, 3), opened."""
        self._parts.move(self._opening.opened(self.collider.vertices(body_vertices)).cpu().numpy())

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
        touches, points = (each.detach().cpu().numpy() for each in (garment.touches, vertices))
        nearest = self._parts.nearest(touches, points, reach, exact, SQUEEZE_GAP)
        results = nearest.distances, nearest.normals, nearest.offsets, nearest.gaps
        return Skin(*(torch.from_numpy(result).to(vertices.device) for result in results))

    def skins(self, frames: Tensor, garment: ContactGarment, body_frames: Tensor) -> Iterator[Skin]:
        """Yield the nearest skin of a garment's vertices (F, N, 3) m on the body (F, V, 3) m, by frame.

        Distances are exact up to MEASURED_DISTANCE outside.
        """
        for vertices, body_vertices in zip(frames, body_frames, strict=True):
            self.update(body_vertices)
            yield self.skin(vertices, garment, SEARCH_DISTANCE, MEASURED_DISTANCE)

    def inside_percent(self, frames: Tensor, garment: ContactGarment, body_frames: Tensor) -> Tensor:
        """Percent of a garment's vertices (F, N, 3) that are inside the body (F, V, 3): (F,)."""
        shares = [100.0 * skin.inside.float().mean() for skin in self.skins(frames, garment, body_frames)]
        return torch.stack(shares) if shares else frames.new_zeros(0)

    def _touches(self, vertices: Tensor) -> Tensor:
        """Bits of the parts that may touch each of a garment's vertices (N, 3) m at rest: (N,) int32."""
        return touch_bits(self.collider.touches(vertices, self._rest))
