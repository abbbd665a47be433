"""Check that a garment lies on a body at rest as clothes do, and the reason if not."""

import math
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.errors import InputError
from uvcloth.garments.placing import AXES, SEARCH_DISTANCE, ClothSample, lies_along, misfit
from uvcloth.geometry.mesh import Mesh, boundary_edges, face_normals, unique_edges
from uvcloth.physics.exposure import Shell
from uvcloth.physics.surface import BodySurface

POINTS = 2000
"""Points over the cloth that are tested."""

DEEP = 0.01
"""Metres inside the body beyond which clearing does not easily move cloth out."""

MOST_DEEP = 0.05
"""Largest share of the cloth that may be so deep."""

LEAST_ALONG = 0.75
"""Least share of the cloth along the skin."""

FARTHEST = 0.1
"""Distance to the skin, m, of the closest quarter of the cloth above which it is not worn: a wide skirt hangs
from its waistband.
"""

ENGULFED = 0.95
"""Share of the cloth inside the body above which a garment counts as wholly inside it."""

CLOTHED = ("torso", "upper_arm", "thigh")
"""Regions of which a garment has to cover some: shoes, gloves and hats are not moved as cloth."""

LEAST_CLOTHED = 0.2
"""Least share of the cloth over these."""

BARE = ("head", "hand", "foot")
"""Regions that are all covered only by a mesh of a body."""

COVERED = 0.5
"""Share of a region's area from which it counts as covered."""

LEAST_AROUND = 0.7
"""Share of the directions across a bone in which a ray hits a garment that goes around it."""

AROUND_REACH = 0.4
"""Length of these rays, m."""

SHORTEST_BONE = 0.05
"""Least length of a bone, m, to cast rays across it."""

PLACES, DIRECTIONS = 5, 24
"""Places along each bone, and directions across it."""

TURNS = {
    "upside down": (((-1, 0, 0), (0, 1, 0), (0, 0, -1)), ((1, 0, 0), (0, -1, 0), (0, 0, -1))),
    "back to front": (((-1, 0, 0), (0, -1, 0), (0, 0, 1)),),
    "on its side": (((0, 0, 1), (0, 1, 0), (-1, 0, 0)), ((0, 0, -1), (0, 1, 0), (1, 0, 0))),
    "flat on its back or belly": (((1, 0, 0), (0, 0, 1), (0, -1, 0)), ((1, 0, 0), (0, 0, -1), (0, 1, 0))),
}
"""Rotations that make a wrongly oriented garment lie well."""


class UnwearableError(InputError):
    """A garment that does not lie as clothes do, with its mesh in the best placing.

    anywhere: it would not, however it was placed.
    """

    def __init__(self, message: str, mesh: Mesh, anywhere: bool = False) -> None:
        super().__init__(message)
        self.mesh, self.anywhere = mesh, anywhere


@dataclass(frozen=True)
class Measures:
    """Measures of the cloth at points spread over its area.

    inside, deep: shares inside the body, and deeper than DEEP. distance, nearest: metres to the skin, on
    average, and up to which the closest quarter of the cloth lies. along: share that lies along the skin.
    regions: (8,) share over each of REGIONS. body_share: (8,) cloth over each region, of the region's own
    area. around, around_head: share of the directions across a bone in which a ray hits the garment: the
    largest over all places, and that across the middle of the head.
    """

    inside: float
    deep: float
    distance: float
    nearest: float
    along: float
    regions: Tensor
    body_share: Tensor
    around: float
    around_head: float


def measure(mesh: Mesh, body: Body, surface: BodySurface) -> Measures:
    """Measure how a garment at rest, in metres, lies on a body; surface: of the body at rest."""
    cloth = ClothSample.of(mesh.vertices, mesh.faces, POINTS)
    nearest = surface.closest(cloth.points, SEARCH_DISTANCE)
    regions = torch.bincount(body.regions[nearest.faces], minlength=len(REGIONS)) / POINTS
    skin = face_normals(body.mesh.vertices, body.mesh.faces).norm(dim=1)
    areas = torch.zeros(len(REGIONS)).index_add(0, body.regions, skin)
    area = face_normals(mesh.vertices, mesh.faces).norm(dim=1).sum()
    around = _around(mesh, body)
    return Measures(
        inside=float((nearest.signed_distance < 0).float().mean()),
        deep=float((nearest.signed_distance < -DEEP).float().mean()),
        distance=float(nearest.signed_distance.abs().mean()),
        nearest=float(nearest.signed_distance.abs().quantile(0.25)),
        along=float(lies_along(cloth.normals, nearest).float().mean()),
        regions=regions,
        body_share=regions * area / areas.clamp(min=1e-9),
        around=float(around[:-1].max()),
        around_head=float(around[-1]),
    )


def _around(mesh: Mesh, body: Body) -> Tensor:
    """Share (P,) of the directions across places on the bones, the head last, in which a ray hits the
    garment.
    """
    skeleton = body.skeleton
    head = body.mesh.vertices[body.mesh.faces[body.regions == REGIONS.index("head")]].reshape(-1, 3).mean(0)
    bones = [(parent, joint) for joint, parent in enumerate(skeleton.parents) if parent >= 0]
    start, end = skeleton.heads[torch.tensor(bones)].unbind(1)
    long = (end - start).norm(dim=1) > SHORTEST_BONE
    start, end = start[long], end[long]
    along = torch.linspace(0, 1, PLACES)[:, None, None]
    places = torch.cat([(start + along * (end - start)).reshape(-1, 3), head[None]])
    axes = torch.cat([(end - start).repeat(PLACES, 1), AXES["+Z"][None]])
    axes = torch.nn.functional.normalize(axes, dim=1)
    side = torch.linalg.cross(axes, AXES["-Y"].expand_as(axes) + 0.1 * AXES["+X"])
    side = torch.nn.functional.normalize(side, dim=1)
    angles = torch.arange(DIRECTIONS)[:, None, None] * (2 * math.pi / DIRECTIONS)
    rays = angles.cos() * side + angles.sin() * torch.linalg.cross(axes, side)
    origins = places.expand(DIRECTIONS, -1, -1)
    met, _ = Shell(mesh.vertices, mesh.faces).first_hit(
        origins.reshape(-1, 3), rays.reshape(-1, 3), AROUND_REACH
    )
    return (met.reshape(DIRECTIONS, -1) < AROUND_REACH).float().mean(0)


def refuse_unworn(path: Path, mesh: Mesh, welded: Tensor, body: Body, surface: BodySurface) -> None:
    """Raise UnwearableError naming the path and the reason if a garment does not lie as clothes lie.

    mesh: at rest in metres. welded: (F, 3), its faces after vertices at the same place are joined.
    """
    measures = measure(mesh, body, surface)
    reason, anywhere = _no_garment(measures, welded)
    reason = reason or _misplaced(measures, mesh, surface)
    if reason:
        raise UnwearableError(f"{path}: {reason}", mesh, anywhere)


def _no_garment(measures: Measures, welded: Tensor) -> tuple[str, bool]:
    """Reason why a mesh is not a garment for the body, "" if it is one, and if that holds anywhere."""
    over = {region: float(share) for region, share in zip(REGIONS, measures.regions, strict=True)}
    most = max(over, key=lambda region: over[region])
    lies = measures.along > LEAST_ALONG and measures.deep < MOST_DEEP
    for wrong, anywhere, sentence in (
        (
            measures.nearest > FARTHEST,
            False,
            f"the garment is far from the body, {measures.distance:.2f} m on average: expected one "
            "modelled on the body's rest pose",
        ),
        (
            all(float(measures.body_share[REGIONS.index(region)]) > COVERED for region in BARE),
            True,
            "the mesh covers head, hands and feet: it is a body, not a garment",
        ),
        (measures.inside > ENGULFED, False, "the garment is wholly inside the body, not worn over it"),
        (_is_ball(welded), True, "the mesh is closed all around, a garment has openings for the body"),
        (
            sum(over[region] for region in CLOTHED) < LEAST_CLOTHED,
            lies,
            f"the garment is worn on the {most} ({100 * over[most]:.0f} % of it), expected one of "
            "trunk, upper arms or thighs: shoes, gloves and hats are not supported",
        ),
    ):
        if wrong:
            return sentence, anywhere
    return "", False


def _misplaced(measures: Measures, mesh: Mesh, surface: BodySurface) -> str:
    """Description of how a garment lies wrongly, "" if it lies as clothes do."""
    if measures.around_head > LEAST_AROUND:
        return "the garment is over the head, expected one modelled on the body's rest pose"
    if measures.deep > MOST_DEEP or measures.along < LEAST_ALONG:
        return (
            f"the garment {_turned(mesh, surface) or 'does not lie on the body as clothes lie'}: "
            f"{100 * measures.deep:.0f} % of it is more than {1000 * DEEP:.0f} mm inside the body, "
            f"{100 * (1 - measures.along):.0f} % crosses the skin; expected one modelled on this "
            "body's rest pose"
        )
    if measures.around < LEAST_AROUND:
        return "the garment does not go around any part of the body, so nothing holds it"
    return ""


def _is_ball(welded: Tensor) -> bool:
    """Test for a closed surface whose pieces have no holes through them, by Euler's formula."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if len(boundary_edges(welded)):
        return False
    used, faces = torch.unique(welded, return_inverse=True)
    edges = unique_edges(faces).numpy()
    graph = coo_array((edges[:, 0] >= 0, (edges[:, 0], edges[:, 1])), shape=(len(used), len(used)))
    pieces = connected_components(graph, directed=False)[0]
    return len(used) - len(edges) + len(faces) >= 2 * pieces


def _turned(mesh: Mesh, surface: BodySurface) -> str:
    """Description of its orientation, if a rotation about its centre would make it lie well."""
    cloth = ClothSample.of(mesh.vertices, mesh.faces, POINTS // 4)
    centre = (mesh.vertices.amax(0) + mesh.vertices.amin(0)) / 2
    turns = [(name, turn) for name, ways in TURNS.items() for turn in ways]
    rotations = torch.tensor([turn for _, turn in turns]).to(cloth.points).transpose(1, 2)
    points = (cloth.points - centre) @ rotations + centre
    misfits = misfit(ClothSample(points, cloth.normals @ rotations), surface)
    best = int(misfits.argmin())
    return f"lies {turns[best][0]}" if float(misfits[best]) < 0.5 * float(misfit(cloth, surface)) else ""
