"""Clearing of a whole outfit: garments are moved off the skin and off the garments beneath them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import Collider, compact, make_collider, touch_bits
from uvcloth.bodies.opened import ColliderOpening, make_opening
from uvcloth.bodies.stature import beside_adults
from uvcloth.geometry.mesh import JoinedMesh, Mesh, WeldedMesh, join_meshes, welded
from uvcloth.physics.cloth.body import Body as SolidBody
from uvcloth.physics.cloth.body import make_body
from uvcloth.physics.exposure import Exposure
from uvcloth.physics.layer_thickness import outfit_thickness
from uvcloth.physics.layers_between import kept_apart
from uvcloth.player.clearing import Clearing, ClearingMemory

CLEARANCE = 0.003
"""Metres that garments keep from the skin, and from each other."""

COVERED_POINTS = 8000
"""Points over the whole body that look for cloth beneath them: about one in a square of 15 mm."""


@dataclass(frozen=True)
class Effort:
    """Effort of a clearing.

    reach: metres within which the skin is searched; deeper points stay. lifts: times that outer garments are
    moved off the inner ones; after all but the last one their neighbours follow.
    """

    reach: float
    lifts: int


PREDICTED = Effort(reach=0.1, lifts=3)
"""For predictions, which know nothing of body and layers."""

FOLLOWING = Effort(reach=0.03, lifts=1)
"""For garments that follow cages, which are off body and layers by themselves."""


@dataclass(frozen=True)
class OutfitClearing:
    """Garments, the innermost first, and the body that they are kept off.

    Clearances are for adults: size is the height of the body over that of the nearest adult. meshes: the
    garments, welded. closed: the body as closed parts. opening: moves these apart to give cloth room. met:
    (parts,) bool, those that cloth may touch; used: (C,) the collider's vertices of these. sections: the
    arrays of `fine`, by name; cages_solid: the same collider for the cages. apart: (G, G) bool, pairs of
    garments that never meet.
    """

    size: float
    meshes: tuple[WeldedMesh, ...]
    closed: Collider
    opening: ColliderOpening
    met: Tensor
    used: Tensor
    sections: Mapping[str, NDArray[Any]]
    cages_solid: SolidBody
    apart: Tensor

    @cached_property
    def fine(self) -> Clearing:
        """Clearing of all garments, of an adult's size, in the runtime, read before its first frame."""
        return Clearing(self.sections)

    @classmethod
    def of(cls, body: Body, meshes: Sequence[Mesh], cages: JoinedMesh | None = None) -> "OutfitClearing":
        """Prepare garments at rest, the innermost first.

        cages: (n, 3) m at rest, other cloth that meets the same collider.
        """
        size, closed = beside_adults(body), make_collider(body)
        rest = body.mesh.vertices / size
        garments = tuple(welded(mesh.vertices, mesh.faces) for mesh in meshes)
        sized = [(garment.points / size, garment.faces) for garment in garments]
        joined = join_meshes(sized)
        others = [] if cages is None else [(cages.vertices / size, cages.faces)]
        both = join_meshes([(joined.vertices, joined.faces), *others])
        every = closed.touches(both.vertices, rest, both.faces)
        met = every.any(1)
        touches, cages_touch = every.tensor_split([len(joined.vertices)], dim=1)
        used, faces = compact([part for part, is_met in zip(closed.parts, met, strict=True) if is_met])
        thickness, apart = outfit_thickness([points for points, _ in sized], sized), kept_apart(sized)
        # Pairs by their outer garment, each with those beneath it that it may meet.
        outer, inner = np.nonzero(np.tril(~apart.numpy().T, -1))
        at_rest = closed.vertices(rest)[used].numpy()
        unsized = join_meshes((each.points, each.faces) for each in garments)
        covered = Exposure(body, [unsized], COVERED_POINTS).covered
        sections = {
            "collider.rest": at_rest,
            "collider.faces": np.concatenate([np.zeros((0, 3), np.int64), *faces]),
            "collider.starts": np.cumsum([0, *(len(part) for part in faces)]),
            "fine.rest": joined.vertices.numpy(),
            "fine.faces": joined.faces.numpy(),
            "fine.touches": touch_bits(touches[met]).numpy(),
            "fine.thickness": thickness.numpy(),
            "skin.rest": rest.numpy(),
            "skin.faces": body.mesh.faces.numpy(),
            "garments.starts": np.array([*joined.starts, len(joined.vertices)]),
            "layers.outer": outer,
            "layers.inner": inner,
            "layers.touches": touch_bits(touches).numpy(),
            "covered.corners": covered.corners.numpy(),
            "covered.weights": covered.barycentrics.numpy(),
        }
        return cls(
            size,
            garments,
            closed,
            make_opening(closed.for_cloth(met), rest),
            met,
            used,
            sections,
            make_body(at_rest, faces, cages_touch[met].numpy(), closed.crossed(cages_touch)[met].numpy()),
            apart,
        )

    def collider(self, body_vertices: Tensor) -> NDArray[np.float32]:
        """Opened collider (C, 3) m of a posed body (V, 3) m."""
        vertices = self.closed.vertices(body_vertices.cpu() / self.size)
        return (self.size * self.opening.opened(vertices)[self.used]).numpy()

    def start(self) -> ClearingMemory:
        """Memory before the first frame, from which nothing is known."""
        return self.fine.begin()

    def clear(
        self,
        points: Sequence[Tensor],
        collider: NDArray[np.float32],
        body_vertices: Tensor,
        before: ClearingMemory,
        effort: Effort,
    ) -> tuple[ClearingMemory, tuple[Tensor, ...]]:
        """Move the points (U, 3) m of each welded garment off the collider (C, 3) m, and off each other.

        body_vertices: (V, 3) m, the posed body, whose skin they cover. before: of the frame before, which
        saves time, or of the start. Returns the garments (N, 3) m.
        """
        # Rounding is that of the innermost garment alone, whatever is worn over it.
        origin = points[0].double().numpy().mean(0)
        near = ((torch.cat(list(points)).numpy() - origin) / self.size).astype(np.float32)
        body = ((collider - origin) / self.size).astype(np.float32)
        memory, cleared = self.fine.clear(before, near, body, CLEARANCE, effort.reach)
        skin = ((body_vertices.cpu().double().numpy() - origin) / self.size).astype(np.float32)
        self.fine.cover(cleared, skin)
        self.fine.lift(cleared, CLEARANCE, effort.lifts)
        placed = (self.size * torch.from_numpy(cleared).double() + torch.from_numpy(origin)).float()
        garments = placed.split([len(each.points) for each in self.meshes])
        return memory, tuple(
            vertices[mesh.places] for vertices, mesh in zip(garments, self.meshes, strict=True)
        )

    def cleared(self, garments: Sequence[Tensor], body_vertices: Tensor) -> tuple[Tensor, ...]:
        """Garments (N, 3) m moved off a posed body (V, 3) m and off each other, whatever was before."""
        points = [
            vertices.detach().cpu()[mesh.kept] for vertices, mesh in zip(garments, self.meshes, strict=True)
        ]
        collider = self.collider(body_vertices)
        _, finished = self.clear(points, collider, body_vertices, self.start(), PREDICTED)
        return tuple(after.to(raw.device) for after, raw in zip(finished, garments, strict=True))
