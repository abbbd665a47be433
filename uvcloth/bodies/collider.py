"""Colliders: the body as closed parts, and the parts that each vertex of cloth may touch.

Mocap pushes thighs into bellies and calves into thighs. Cloth between them has to stay there: each closed
part defines its outside, where a single surface of the whole body would push cloth through a leg. `opened.py`
makes room for it. Mocap also pushes forearms through bellies and hands through skirts, which would drag cloth
along: only sleeves touch forearms.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import boundary_edges, edge_groups, unique_edges
from uvcloth.geometry.once import once_per_record

Parts = Sequence[tuple[tuple[str, ...], tuple[int, ...]]]
"""Regions that move together, and their sides."""

COLLIDER_PARTS: Parts = (
    (("head",), (0,)),
    (("upper_arm",), (1, -1)),
    (("torso",), (0,)),
    (("thigh",), (1, -1)),
    (("calf", "foot"), (1, -1)),
    (("forearm", "hand"), (1, -1)),
)
"""Parts of the body that cloth touches, in the order of the constants below."""

ARM_PARTS, TORSO_PART, LEG_PARTS, FOREARM_PARTS = (1, 2), 3, (4, 5, 6, 7), (8, 9)
"""Indices of upper arms, torso, thighs and calves, and forearms among the parts."""

PRESSED_PARTS = (
    *((arm, TORSO_PART) for arm in ARM_PARTS),
    *((thigh, TORSO_PART) for thigh in LEG_PARTS[:2]),
    LEG_PARTS[:2],
    *zip(LEG_PARTS[2:], LEG_PARTS[:2], strict=True),
)
"""Pairs of parts that mocap presses into each other: arm, ribs; thigh, belly; both thighs; calf, thigh."""

SLEEVE_PAIRS = (
    *((forearm, TORSO_PART) for forearm in FOREARM_PARTS),
    *zip(FOREARM_PARTS, LEG_PARTS[:2], strict=True),
)
"""Pairs of a forearm and a part that mocap presses it into: a sleeve around it would be caught there."""

LIMBS = (*zip(FOREARM_PARTS, ARM_PARTS, strict=True), *zip(LEG_PARTS[2:], LEG_PARTS[:2], strict=True))
"""Pairs of a forearm and its upper arm, a calf and its thigh: a bent joint pulls cloth of the first onto the
second.
"""

PART_SLACK = 0.03
"""Metres by which a part may be farther than twice the closest one and still be next to a point at rest."""

FREE_HANGING_DISTANCE = 0.04
"""Metres from the body at rest beyond which cloth drapes freely, as a skirt does, and touches both legs."""

BELOW_CROTCH = 0.05
"""Metres below the crotch from where cloth that joins both legs is a skirt: trousers join them above."""

CAP_HEIGHT = 0.7
"""Height of the caps, in radii of the opening: high enough that a cut knee keeps its shape."""


@dataclass(frozen=True)
class Collider:
    """The body as closed surfaces, one per part.

    parts: faces (F, 3) of each, into the body's V vertices followed by the tips of the caps.

    A part that the body lacks has no faces. rims: per cap, the directed edges (E, 2) of body vertices
    around it. pressed: pairs of parts that mocap presses into each other, between which contact needs room.
    """

    parts: tuple[Tensor, ...]
    rims: tuple[Tensor, ...]
    pressed: tuple[tuple[int, int], ...] = ()

    @cached_property
    def _rim_edges(self) -> tuple[Tensor, Tensor, Tensor]:
        """The edges of all rims (E, 2), their caps (E,), and which edges each cap has, as ones: (caps, E)."""
        edges = torch.cat(self.rims)
        caps = torch.arange(len(self.rims), device=edges.device)
        owner = caps.repeat_interleave(torch.tensor([len(rim) for rim in self.rims], device=edges.device))
        return edges, owner, (caps[:, None] == owner).float()

    def vertices(self, body_vertices: Tensor) -> Tensor:
        """Posed body vertices (..., V, 3) with the tips of the caps appended: (..., V + caps, 3)."""
        if not self.rims:
            return body_vertices
        edges, owner, members = self._rim_edges
        members = members.to(body_vertices)
        ends = body_vertices.index_select(-2, edges.flatten()).unflatten(-2, (-1, 2))
        centre = (members @ ends[..., 1, :]) / members.sum(1, keepdim=True)
        start, end = (ends - centre.index_select(-2, owner)[..., None, :]).flip(-2).unbind(-2)
        area = 0.5 * members @ torch.linalg.cross(start, end)
        size = area.norm(dim=-1, keepdim=True)
        tips = centre + CAP_HEIGHT * (size / math.pi).sqrt() * area / size.clamp(min=1e-9)
        return torch.cat([body_vertices, tips], dim=-2)

    def for_cloth(self, touched: Tensor) -> "Collider":
        """The collider for cloth that touches some of its parts, (parts,) bool.

        A forearm with a sleeve needs room beside trunk and thigh too; without one it acts on nothing.
        """
        sleeved = tuple(pair for pair in SLEEVE_PAIRS if self.pressed and bool(touched[pair[0]]))
        return replace(self, pressed=tuple(dict.fromkeys((*self.pressed, *sleeved))))

    def touches(self, points: Tensor, body_vertices: Tensor, faces: Tensor | None = None) -> Tensor:
        """Mask of the parts that each point of a garment (N, 3) m at rest may touch: (parts, N) bool.

        faces: (M, 3) of the garment, by which a narrow skirt is known.

        Cloth touches the parts that it lies next to, and a skirt both legs and the torso, over which it
        rides up. In the armpit it touches arm and torso: contact opens them, so that cloth has room. A
        forearm is touched by its sleeve alone, which is at least twice as far from trunk and legs; a wide
        skirt next to a hand does not touch it.
        """
        vertices = self.vertices(body_vertices)
        distance = torch.stack([_nearest(points, vertices[part.unique()]) for part in self.parts])
        limbs, trunk = list(FOREARM_PARTS), distance[[TORSO_PART, *LEG_PARTS]].amin(0)
        distance[limbs] = torch.where(2.0 * distance[limbs] < trunk, distance[limbs], math.inf)
        nearest = distance.amin(0)
        touches = distance < 2.0 * nearest + PART_SLACK
        touches[list(LEG_PARTS)] |= (nearest > FREE_HANGING_DISTANCE) & (nearest < distance[limbs].amin(0))
        touches &= torch.isfinite(distance)
        for lower, upper in LIMBS:
            touches[upper] |= touches[lower]
        if faces is not None:
            touches[[TORSO_PART, *LEG_PARTS]] |= self._skirt(points, faces, body_vertices, distance)
        return touches

    def _skirt(self, points: Tensor, faces: Tensor, body_vertices: Tensor, distance: Tensor) -> Tensor:
        """Mask (N,) of the points of cloth that joins both legs below the crotch.

        distance: (parts, N) m of the points from the parts.
        """
        torso = self.parts[TORSO_PART]
        heights = body_vertices[torso[(torso < len(body_vertices)).all(1)], 2].flatten()
        crotch = heights.amin() if len(heights) else -math.inf
        edges = unique_edges(faces)
        edges = edges[(points[edges, 2] < crotch - BELOW_CROTCH).all(1)]
        groups = edge_groups(edges, len(points)).repeat_interleave(2)
        ends = edges.flatten()
        left, right = (distance[list(LEG_PARTS)[side::2]].amin(0) for side in (0, 1))
        sides = torch.zeros(2, len(points), dtype=torch.bool)
        sides[(left < right).long()[ends], groups] = True
        skirt = torch.zeros(len(points), dtype=torch.bool)
        skirt[ends] = sides.all(0)[groups]
        return skirt

    @staticmethod
    def crossed(touches: Tensor) -> Tensor:
        """Mask (parts, N) of the parts that each point may be moved into: mocap moves forearms through legs.

        touches: (parts, N), as `touches` returns it.
        """
        legs, forearms = list(LEG_PARTS), list(FOREARM_PARTS)
        sleeve = touches[forearms].any(0)
        crossed = torch.zeros_like(touches)
        crossed[legs] = sleeve & ~touches[legs].any(0)
        crossed[forearms] = touches[legs].any(0) & ~sleeve
        return crossed


@once_per_record
def make_collider(body: Body, parts: Parts = COLLIDER_PARTS) -> Collider:
    """Cut the body into parts and close each opening with a cap; `touches` needs the default parts."""
    kept = [
        body.mesh.faces[torch.isin(body.regions, _indices(regions)) & (body.sides == side)]
        for regions, sides in parts
        for side in sides
    ]
    closed = _closed(kept, len(body.mesh.vertices))
    return replace(closed, pressed=PRESSED_PARTS) if parts is COLLIDER_PARTS else closed


def touch_bits(touches: Tensor) -> Tensor:
    """Mask (parts, N) of the parts that each point may touch, as a bit per part: (N,) int32."""
    bits = 2 ** torch.arange(len(touches), device=touches.device)
    return (touches * bits[:, None]).sum(0).int()


def compact(parts: Sequence[Tensor]) -> tuple[Tensor, list[NDArray]]:
    """Collider vertices (C,) int64 of some parts, and the faces (F, 3) of each part into these.

    A vertex on the rim between two parts is there for each, so that each is a surface of its own.
    """
    used, faces, first = [torch.zeros(0, dtype=torch.int64)], [], 0
    for part in parts:
        vertices, corners = part.unique(return_inverse=True)
        used.append(vertices)
        faces.append((corners + first).numpy())
        first += len(vertices)
    return torch.cat(used), faces


@once_per_record
def part_alone(body: Body, part: int) -> tuple[Tensor, Collider]:
    """One of COLLIDER_PARTS as a collider of its own, for uses of many poses of that part alone.

    Returns its vertices (K,) int64 among the body's, and the closed part, into those K.
    """
    faces = make_collider(body).parts[part]
    kept, corners = faces[(faces < len(body.mesh.vertices)).all(1)].unique(return_inverse=True)
    return kept, _closed([corners], len(kept))


def collider_near(body: Body, points: Tensor, reach: float) -> tuple[Tensor, Collider]:
    """Collider of the body's faces within reach, m, of points (N, 3) m at rest, as one closed part.

    Returns its vertices (K,) int64 among the body's, and the part, into those K. Raises InputError if none is
    near.
    """
    distance, _ = KDTree(points.numpy()).query(body.mesh.vertices.numpy(), distance_upper_bound=reach)
    faces = body.mesh.faces[torch.from_numpy(distance < reach)[body.mesh.faces].all(1)]
    if not len(faces):
        raise InputError(f"body {body.name}: no part of it is within {reach:.2f} m of the garment")
    kept, corners = faces.unique(return_inverse=True)
    return kept, _closed([corners], len(kept))


def _closed(parts: list[Tensor], count: int) -> Collider:
    """Collider of parts (F, 3) into `count` vertices, openings closed with caps; equal rims share one."""
    tips: dict[tuple[int, ...], int] = {}
    rims: list[Tensor] = []

    def closed(faces: Tensor) -> Tensor:
        fans = [faces]
        for rim in _rims(faces, count):
            tip = tips.setdefault(tuple(rim.flatten().tolist()), count + len(rims))
            if tip == count + len(rims):
                rims.append(rim)
            fans.append(torch.stack([rim[:, 1], rim[:, 0], torch.full((len(rim),), tip)], dim=1))
        return torch.cat(fans)

    return Collider(tuple(closed(faces) for faces in parts), tuple(rims))


def _nearest(points: Tensor, others: Tensor) -> Tensor:
    """Distance (N,) from points (N, 3) to the nearest of others (M, 3), infinite if none."""
    if not len(others):
        return points.new_full((len(points),), math.inf)
    return torch.from_numpy(KDTree(others.cpu().numpy()).query(points.cpu().numpy())[0]).to(points)


def _indices(regions: tuple[str, ...]) -> Tensor:
    return torch.tensor([REGIONS.index(region) for region in regions])


def _rims(faces: Tensor, count: int) -> list[Tensor]:
    """The boundary edges of a surface, one (E, 2) per opening."""
    edges = boundary_edges(faces)
    labels = edge_groups(edges, count)
    return [edges[labels == label] for label in labels.unique()]
