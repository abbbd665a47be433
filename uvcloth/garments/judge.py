"""Check that a garment lies on a body at rest as clothes do, and the reason if not."""

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.errors import InputError
from uvcloth.garments.places import hems
from uvcloth.garments.placing import AXES, SEARCH_DISTANCE, ClothSample, lies_along, misfit
from uvcloth.geometry.mesh import Mesh, boundary_edges, edge_groups, face_normals, unique_edges
from uvcloth.physics.shell import Shell
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

UPPER = CLOTHED[:2]
"""Those of them on which a garment may not hang as a skirt hangs around the legs."""

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

FARTHEST_HEM = 0.15
"""Metres from the skin, at half of its corners, beyond which the uppermost hem holds nothing up."""

FARTHEST_PIECE = 0.2
"""Metres from the skin to the closest point of a piece beyond which it is not worn."""

MOSTLY = 0.5
"""Share of the cloth over trunk and upper arms from which on it is no skirt."""

WIDEST = 0.1
"""Metres from trunk and upper arms to the cloth over them, on average, beyond which it is too wide: loose
clothes have up to 0.05.
"""

BONES = (
    ("hips", "lower_spine", "middle_spine", "upper_spine", "neck", "head"),
    *(
        tuple(f"{side}_{part}" for part in limb)
        for side in ("left", "right")
        for limb in (("upper_arm", "forearm", "hand"), ("thigh", "shin", "foot"))
    ),
)
"""Chains of joints, by role, whose bones lie within the cloth: trunk, arms and legs."""

TURNED, CLEARLY_TURNED = 0.06, 0.6
"""Misfit, m, up to which cloth would lie well if it were turned, and its largest share of that as it lies."""

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

    anywhere: it would not, however it was placed. lies: it lies along the skin there, but is not held.
    """

    def __init__(self, message: str, mesh: Mesh, anywhere: bool = False, lies: bool = False) -> None:
        super().__init__(message)
        self.mesh, self.anywhere, self.lies = mesh, anywhere, lies


@dataclass(frozen=True)
class Measures:
    """Measures of the cloth at points spread over its area.

    inside, deep: shares inside the body, and deeper than DEEP. distance, nearest: metres to the skin, on
    average, and up to which the closest quarter of the cloth lies. along: share that lies along the skin.
    regions: (8,) share over each of REGIONS. body_share: (8,) cloth over each region, of the region's own
    area. around, around_head: share of the directions across a bone in which a ray hits the garment: the
    largest over all places, and that across the middle of the head. pierced: whether a bone runs through
    cloth. hem: metres from half of the uppermost hem's corners to the skin, 0 without a hem. upper: metres to
    trunk and upper arms from the cloth over them, on average, 0 for a skirt. piece: metres to the skin from
    the closest point of the farthest piece.
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
    pierced: bool
    hem: float
    upper: float
    piece: float


def measure(mesh: Mesh, welded: Tensor, body: Body, surface: BodySurface) -> Measures:
    """Measure how a garment at rest, in metres, lies on a body.

    welded: as of `refuse_unworn`. surface: of the body at rest.
    """
    cloth = ClothSample.of(mesh.vertices, mesh.faces, POINTS)
    nearest = surface.closest(cloth.points, SEARCH_DISTANCE)
    distance, over = nearest.signed_distance.abs(), body.regions[nearest.faces]
    regions = torch.bincount(over, minlength=len(REGIONS)) / POINTS
    skin = face_normals(body.mesh.vertices, body.mesh.faces).norm(dim=1)
    areas = torch.zeros(len(REGIONS)).index_add(0, body.regions, skin)
    area = face_normals(mesh.vertices, mesh.faces).norm(dim=1).sum()
    shell = Shell(mesh.vertices, mesh.faces)
    away = surface.closest(mesh.vertices, SEARCH_DISTANCE).signed_distance.abs()
    around = _around(shell, body)
    upper = torch.isin(over, torch.tensor([REGIONS.index(region) for region in UPPER]))
    return Measures(
        inside=float((nearest.signed_distance < 0).float().mean()),
        deep=float((nearest.signed_distance < -DEEP).float().mean()),
        distance=float(distance.mean()),
        nearest=float(distance.quantile(0.25)),
        along=float(lies_along(cloth.normals, nearest).float().mean()),
        regions=regions,
        body_share=regions * area / areas.clamp(min=1e-9),
        around=float(around[:-1].max()),
        around_head=float(around[-1]),
        pierced=_pierced(shell, body),
        hem=_uppermost_hem(mesh.vertices, welded, away),
        upper=float(distance[upper].mean()) if upper.float().mean() > MOSTLY else 0.0,
        piece=_farthest_piece(welded, away[mesh.faces]),
    )


def _pierced(cloth: Shell, body: Body) -> bool:
    """Test for a bone of BONES that runs through cloth."""
    roles = body.skeleton.roles
    chains = [[roles[role] for role in chain if role in roles] for chain in BONES]
    bones = torch.tensor([bone for chain in chains for bone in pairwise(chain)], dtype=torch.int64)
    start, end = body.skeleton.heads[bones.reshape(-1, 2)].unbind(1)
    length = (end - start).norm(dim=1)
    along = (end - start) / length[:, None]
    return bool((cloth.first_hit(start, along, AROUND_REACH)[0] < length).any())


def _uppermost_hem(vertices: Tensor, welded: Tensor, away: Tensor) -> float:
    """Metres from half of the corners of the uppermost hem to the skin, 0 without a hem.

    vertices: (N, 3) m, of which away: (N,) m is the distance to the skin. welded: (F, 3).
    """
    loops = hems(boundary_edges(welded))
    if not loops:
        return 0.0
    highest = max(loops, key=lambda loop: float(vertices[loop, 2].mean()))
    return float(away[highest].median())


def _farthest_piece(welded: Tensor, away: Tensor) -> float:
    """Metres from the skin to the closest corner of the piece whose closest corner is farthest from it.

    welded: (F, 3). away: (F, 3) m, distances of the corners to the skin.
    """
    edges = torch.cat([welded[:, :2], welded[:, 1:]])
    piece = edge_groups(edges, int(welded.max()) + 1)[: len(welded)]
    closest = torch.full((len(welded),), torch.inf).scatter_reduce(0, piece, away.amin(1), "amin")
    return float(closest[torch.isfinite(closest)].max())


def _around(cloth: Shell, body: Body) -> Tensor:
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
    met, _ = cloth.first_hit(origins.reshape(-1, 3), rays.reshape(-1, 3), AROUND_REACH)
    return (met.reshape(DIRECTIONS, -1) < AROUND_REACH).float().mean(0)


def refuse_unworn(path: Path, mesh: Mesh, welded: Tensor, body: Body, surface: BodySurface) -> None:
    """Raise UnwearableError naming the path and the reason if a garment does not lie as clothes lie.

    mesh: at rest in metres. welded: (F, 3), its faces after vertices at the same place are joined.
    """
    measures = measure(mesh, welded, body, surface)
    reason, anywhere = _no_garment(measures, welded)
    reason = reason or _misplaced(measures, mesh, surface)
    loose = "" if reason else _loose(measures)
    if reason or loose:
        raise UnwearableError(f"{path}: {reason or loose}", mesh, anywhere, lies=bool(loose))


def _no_garment(measures: Measures, welded: Tensor) -> tuple[str, bool]:
    """Reason why a mesh is not a garment for the body, "" if it is one, and if that holds anywhere."""
    over = {region: float(share) for region, share in zip(REGIONS, measures.regions, strict=True)}
    most = max(over, key=lambda region: over[region])
    lies = measures.along > LEAST_ALONG and measures.deep < MOST_DEEP
    for wrong, anywhere, sentence in (
        (
            all(float(measures.body_share[REGIONS.index(region)]) > COVERED for region in BARE),
            True,
            "the mesh covers head, hands and feet: it is a body, not a garment",
        ),
        (_is_ball(welded), True, "the mesh is closed all around, a garment has openings for the body"),
        (
            measures.nearest > FARTHEST,
            False,
            f"the garment is far from the body, {measures.distance:.2f} m on average: expected one "
            "modelled on the body's rest pose",
        ),
        (measures.inside > ENGULFED, False, "the garment is wholly inside the body, not worn over it"),
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
    """Description of how a garment lies wrongly, "" if it lies along the skin."""
    if measures.around_head > LEAST_AROUND:
        return "the garment is over the head, expected one modelled on the body's rest pose"
    if measures.deep > MOST_DEEP or measures.along < LEAST_ALONG:
        return (
            f"the garment {_turned(mesh, surface) or 'does not lie on the body as clothes lie'}: "
            f"{100 * measures.deep:.0f} % of it is more than {1000 * DEEP:.0f} mm inside the body, "
            f"{100 * (1 - measures.along):.0f} % crosses the skin; expected one modelled on this "
            "body's rest pose"
        )
    return ""


def _loose(measures: Measures) -> str:
    """Description of why a garment along the skin is not worn, "" if it is."""
    for wrong, sentence in (
        (
            measures.around < LEAST_AROUND,
            "the garment does not go around any part of the body, so nothing holds it",
        ),
        (
            measures.piece > FARTHEST_PIECE,
            f"a piece of the garment is {measures.piece:.2f} m from the body, expected all of them on it",
        ),
        (
            measures.hem > FARTHEST_HEM,
            f"nothing holds the garment: its uppermost hem is {measures.hem:.2f} m from the skin, perhaps it "
            "lies upside down",
        ),
        (
            measures.upper > WIDEST,
            "the garment is too wide for the body: its cloth over trunk and upper arms is "
            f"{measures.upper:.2f} m from them on average",
        ),
        (
            measures.pierced,
            "the body goes through the cloth of the garment, not through its openings: perhaps neck or cuffs "
            "are closed",
        ),
    ):
        if wrong:
            return sentence
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
    limit = min(TURNED, CLEARLY_TURNED * float(misfit(cloth, surface)))
    return f"lies {turns[best][0]}" if float(misfits[best]) < limit else ""
