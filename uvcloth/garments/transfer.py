"""Garments transferred from the body that they were modelled on to another, with their ease.

Our body is aligned with the other one and registered to its surface, as it is to characters. Each vertex of a
garment moves as the skin near it does, keeps its distance from the skin, and goes to the rest pose with it.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from rasterize.gather import gather
from uvcloth.bodies.body import Body
from uvcloth.characters.registration import limbs_of, register
from uvcloth.characters.shape import SkinnedSurface
from uvcloth.errors import InputError
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.garments.alignment import UNKNOWN, Alignment, AlignmentCost, Known, Places, StancedBody, search
from uvcloth.garments.placing import ACROSS_COST, SEARCH_DISTANCE, lies_along
from uvcloth.garments.pose import REST, limbs_held, posed_body, unposed
from uvcloth.garments.relaxation import Ease, Relaxed, settle
from uvcloth.geometry.mesh import Mesh, edge_lengths, neighbour_average, unique_edges, weld
from uvcloth.physics.surface import BodySurface, closest_points

SIZES = (0.94, 1.06, 5)
"""Least and greatest height at which another body is compared with ours, over ours, and how many."""

SKEW_COST = 0.004
"""Metres added to the distance of another body for each degree between its heading and an axis, up to 10."""

FARTHEST = 0.02
"""Median distance, m, between the surfaces of two registered bodies above which they do not correspond."""

NEIGHBOURS, SOFTENING = 12, 0.005
"""Nearest vertices of the skin that move a point, and metres that soften their inverse-square weights."""

SMOOTHING_PASSES, LOOSE = 40, 0.05
"""Passes that smooth the motion of a garment, and metres of ease from which on they do so fully."""

EASE_KEPT, LEAST_EASE = 0.2, 0.001
"""Share by which the ease may change, and metres that it has at least."""

EASE_REACH = 0.1
"""Metres of ease up to which it is kept: farther from the skin, cloth hangs by its edges."""

EASE_TURNS = 6
"""Iterations that restore the ease in the stance of the other body."""


@dataclass(frozen=True)
class Transferred:
    """A garment on the rest pose of a body, the alignment of its file, and how it settled."""

    mesh: Mesh
    alignment: Alignment
    settled: Relaxed


class _BodyComparison(AlignmentCost):
    """Distance between two bodies' surfaces, for another body somewhere on ours."""

    def cost(self, places: Places, standing: StancedBody, count: int) -> Tensor:
        """Mean distance (K,) m of another body's surface from ours, more where their normals differ."""
        cloth = self.cloth[count]
        points = self.placed(places, cloth.points)
        normals = torch.einsum("kij,pj->kpi", self.frames(places), cloth.normals)
        nearest = standing.surface.closest(points.reshape(-1, 3), SEARCH_DISTANCE)
        apart = nearest.signed_distance.abs() + ACROSS_COST * ~lies_along(normals.reshape(-1, 3), nearest)
        return apart.reshape(points.shape[:2]).mean(1) + SKEW_COST * self.skew(places)

    def starts(self, known: Known) -> Places:
        """Every start: up axes, four headings, and heights near ours, standing on one floor."""
        tall = self.extent[torch.tensor([1, 2])]
        headings, sizes = torch.tensor([0.0, 180.0, 90.0, -90.0]), torch.linspace(*SIZES)
        up, turn, size = torch.cartesian_prod(torch.tensor([0.0, 1.0]), headings, sizes).unbind(1)
        scale = size * self.height / tall[up.long()]
        shift = self.middle.expand(len(up), 3).clone()
        shift[:, 2] = self.floor + size * self.height / 2
        return self.held(Places(up.long(), turn, scale, shift), known)


def transfer(mesh: Mesh, source: Path, body: Body, known: Known = UNKNOWN) -> Transferred:
    """Transfer a garment, in the coordinates of another body's mesh file, over to a body's rest pose.

    source: the file of that body, of any topology. Raises InputError naming it if it cannot be read or is no
    body like this one.
    """
    other = read_mesh(source)
    alignment = search(_BodyComparison(other, body), body, known)
    transforms = limbs_held(body, alignment.stance) if alignment.stance != REST else None
    standing = body if transforms is None else posed_body(body, transforms)
    other = replace(other, vertices=alignment.apply(other.vertices))
    skin = registered(source, other, standing)
    natural = alignment.apply(mesh.vertices)
    ease = eased(natural, skin, body.mesh.faces, other)
    placed = moved_with_skin(natural, mesh.faces, ease, skin, standing)
    at_rest = replace(mesh, vertices=placed)
    if transforms is not None:
        at_rest = unposed(at_rest, standing, transforms)
    edges = unique_edges(weld(natural)[mesh.faces])
    lengths = edge_lengths(at_rest.vertices, edges).sum() / edge_lengths(natural, edges).sum()
    settled = settle(at_rest.vertices, mesh.faces, float(lengths) * natural, body, _kept(ease))
    return Transferred(replace(mesh, vertices=settled.vertices), alignment, settled)


def registered(source: Path, other: Mesh, body: Body) -> Tensor:
    """Vertices (V, 3) m of a body moved onto the surface of another that is aligned with it.

    Raises InputError naming the source if the surfaces stay apart.
    """
    start = SkinnedSurface(body.mesh.vertices, body.mesh.faces, body.weights)
    hits = closest_points(other.vertices, start.vertices, start.faces)
    weights = gather(start.weights, start.faces[hits.face], hits.barycentrics)
    target = SkinnedSurface(other.vertices, other.faces, weights)
    vertices = register(start, target, limbs_of(body.skeleton.names))
    apart = float(closest_points(vertices, other.vertices, other.faces).distance.median())
    if apart > FARTHEST:
        raise InputError(
            f"{source}: is no body like ours, half of our surface stays {1000 * apart:.0f} mm or more from it"
        )
    return vertices


def eased(vertices: Tensor, skin: Tensor, faces: Tensor, other: Mesh) -> Tensor:
    """Ease (N,) m of a garment on another body; its side is that of the skin (V, 3) registered to that.

    The other's own mesh may have holes and faces that are turned, but its surface is exact.
    """
    side = BodySurface(skin, faces).closest(vertices, SEARCH_DISTANCE).signed_distance.sign()
    return side * closest_points(vertices, other.vertices, other.faces).distance


def moved_with_skin(vertices: Tensor, faces: Tensor, ease: Tensor, skin: Tensor, body: Body) -> Tensor:
    """Vertices (N, 3) m of a garment with an ease (N,) m, moved from a skin (V, 3) to a body of its topology.

    Far from the skin, the motion is smoothed over the garment: a skirt does not tear between the legs.
    """
    from scipy.spatial import KDTree

    distance, nearest = KDTree(skin.numpy()).query(vertices.numpy(), k=NEIGHBOURS)
    share = 1.0 / (torch.from_numpy(distance).float() ** 2 + SOFTENING**2)
    share = share / share.sum(1, keepdim=True)
    motion = (share[..., None] * (body.mesh.vertices - skin)[torch.from_numpy(nearest)]).sum(1)
    owner = weld(vertices)
    average = neighbour_average(owner[faces], len(vertices))
    loose = (ease / LOOSE).clamp(0.1, 1.0)[:, None]
    for _ in range(SMOOTHING_PASSES):
        motion = motion + loose * (average @ motion - motion)
    surface, placed = BodySurface(body.mesh.vertices, body.mesh.faces), vertices + motion[owner]
    held = (ease < EASE_REACH)[:, None]
    for _ in range(EASE_TURNS):
        there = surface.closest(placed, SEARCH_DISTANCE)
        move = held * (ease.clamp(min=LEAST_EASE) - there.signed_distance)[:, None] * there.normals
        placed = (placed + 0.5 * (move + average @ move))[owner]
    return placed


def _kept(ease: Tensor) -> Ease:
    """Range of distances from the skin for a garment with an ease (N,) m."""
    ease = ease.clamp(min=LEAST_EASE)
    most = torch.where(ease < EASE_REACH, (1.0 + EASE_KEPT) * ease, torch.inf)
    return Ease((1.0 - EASE_KEPT) * ease.clamp(max=EASE_REACH), most)
