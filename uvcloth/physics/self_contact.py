"""Self-contact of a posed body: how deep its parts are inside one another."""

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import Parts, make_collider
from uvcloth.geometry.mesh import first_of
from uvcloth.physics.surface import BodySurface

BODY_PARTS: Parts = (
    (("head",), (0,)),
    (("torso",), (0,)),
    (("upper_arm",), (1, -1)),
    (("forearm", "hand"), (1, -1)),
    (("thigh",), (1, -1)),
    (("calf", "foot"), (1, -1)),
)
"""Parts of the whole body."""

PART_NAMES = tuple(regions[0] for regions, sides in BODY_PARTS for _ in sides)
"""The first region of each part; limbs come twice, left before right."""

LEAST_REST_DISTANCE = 0.02
"""Metres from a part at rest beyond which a vertex has to stay out of it: caps and creases overlap."""

SAMPLE_SPACING = 0.012
"""Approximate spacing, m, of the vertices that are tested: face, hands and feet have many more."""

DEPTH_TOLERANCE = 0.01
"""Metres that one part may be inside another."""

SOFT_TOLERANCES = {
    frozenset(("upper_arm", "torso")): 0.03,
    frozenset(("forearm", "torso")): 0.02,
    frozenset(("forearm", "upper_arm")): 0.03,
    frozenset(("thigh", "torso")): 0.03,
    frozenset(("thigh",)): 0.03,
    frozenset(("calf", "thigh")): 0.03,
}
"""The same, metres, where soft tissue gives way: armpits, elbows at the waist, bellies, hips and knees."""


class SelfContact:
    """The closed parts of a body, and for each the vertices of the others that must stay out of it."""

    def __init__(self, body: Body) -> None:
        self._collider = make_collider(body, BODY_PARTS)
        self._tolerances = tolerances()
        rest = self._collider.vertices(body.mesh.vertices)
        samples = _spread(body.mesh.vertices, SAMPLE_SPACING)
        owners = _owners(self._collider.parts, len(rest))
        self._parts: list[tuple[int, BodySurface, Tensor, Tensor]] = []
        for part, faces in enumerate(self._collider.parts):
            if not len(faces):
                continue
            surface = BodySurface(rest, faces)
            others = samples[owners[samples] != part]
            others = others[surface.closest(rest[others]).signed_distance >= LEAST_REST_DISTANCE]
            self._parts.append((part, surface, others, owners[others]))

    def depths(self, vertices: Tensor) -> Tensor:
        """Depths of parts of the posed body (V, 3) m inside others: (P, P) m, 0 where they are not.

        Row and column are the two parts, as in PART_NAMES: the deepest vertex of the column's inside the
        row's.
        """
        posed = self._collider.vertices(vertices)
        depths = vertices.new_zeros(len(PART_NAMES), len(PART_NAMES))
        for part, surface, others, owners in self._parts:
            corners = posed[self._collider.parts[part]].flatten(0, 1)
            points = posed[others]
            boxed = ((points > corners.amin(0)) & (points < corners.amax(0))).all(1)
            if not bool(boxed.any()):
                continue
            surface.update(posed)
            inside = -surface.closest(points[boxed]).signed_distance
            depths[part].scatter_reduce_(0, owners[boxed], inside.clamp(min=0.0), "amax")
        return depths

    def clear(self, vertices: Tensor) -> bool:
        """Test that no part of the posed body (V, 3) m is deeper in another than `tolerances` allow."""
        return bool((self.depths(vertices) <= self._tolerances.to(vertices)).all())


def tolerances() -> Tensor:
    """Metres that the parts of PART_NAMES may be inside one another: (P, P)."""
    return torch.tensor(
        [
            [SOFT_TOLERANCES.get(frozenset((row, column)), DEPTH_TOLERANCE) for column in PART_NAMES]
            for row in PART_NAMES
        ]
    )


def _spread(vertices: Tensor, spacing: float) -> Tensor:
    """One vertex of (V, 3) in each cell of a grid: (K,) indices."""
    _, cell = torch.unique((vertices / spacing).floor().long(), dim=0, return_inverse=True)
    return first_of(cell)


def _owners(parts: tuple[Tensor, ...], count: int) -> Tensor:
    """Index of a part that each of `count` vertices belongs to: (count,) int64."""
    owners = torch.zeros(count, dtype=torch.int64)
    for part, faces in enumerate(parts):
        owners[faces.flatten()] = part
    return owners
