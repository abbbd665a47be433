"""Untangling of garments at rest: each comes to lie over those that are worn beneath it.

Layers are compared along rays from the skin: along the ray through a point of an outer garment, an inner one
has to end before it. Outer garments are moved out as far as their edges allow, inner ones are then pressed
in.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Garment
from uvcloth.garments.relaxation import LARGEST_STEP, PASSES
from uvcloth.geometry.mesh import Mesh, WeldedMesh, edge_lengths, neighbour_average, unique_edges, welded
from uvcloth.physics.shell import Shell
from uvcloth.physics.strain_limiter import StrainLimiter
from uvcloth.physics.surface import BodySurface, SurfacePoints

GAP = 0.003
"""Metres that layers at rest keep from each other, and the innermost from the skin."""

DEPTH = 0.06
"""Metres outside a garment within which one that is worn beneath it is looked for."""

BELOW = 0.02
"""Metres below the skin from where rays start: coarse clothes lie partly in the skin."""

FOLD = 0.015
"""Metres between two surfaces of one garment along a ray, as of a lining; what is farther is another limb."""

MOST_SURFACES = 4
"""Surfaces of a garment that a ray is followed through."""

PAST = 1e-4
"""Metres past a surface from where a ray goes on."""

ROUNDS, OUTWARDS = 14, 7
"""Rounds, and the first of them in which garments only move out."""

FINAL_ROUNDS = 3
"""Rounds at the end that even out no edges."""

LEAST_MOVED = 0.0005
"""Metres below which a move is not reported."""


@dataclass(frozen=True)
class Untangled:
    """Garments that lie over one another at rest, the innermost first, and a line on each that moved."""

    garments: tuple[Garment, ...]
    lines: tuple[str, ...]


class _Piece:
    """A garment while it is moved: welded, with its points (U, 3) m as they lie now."""

    def __init__(self, mesh: WeldedMesh) -> None:
        self.mesh, self.points = mesh, mesh.points.float()
        self.shell = Shell(self.points, mesh.faces)
        self._limiter = StrainLimiter(self.points, mesh.faces)
        self._average = neighbour_average(mesh.faces, len(self.points))

    def move(self, way: Tensor) -> None:
        """Move points by (U, 3) m; those that have no way of their own follow their neighbours."""
        stays = (way == 0).all(1, keepdim=True)
        self.points = self.points + torch.where(stays, self._average @ way, way)
        self.shell.update(self.points)

    def even(self, skin: SurfacePoints, least: Tensor) -> None:
        """Bring edges near their length, with points at least (U,) m off the skin that was closest."""
        offsets = (skin.points * skin.normals).sum(1) + least
        offsets = torch.minimum(offsets, (self.points * skin.normals).sum(1))
        self.points = self._limiter.relax(self.points, PASSES, skin.normals, offsets, self.points)
        self.shell.update(self.points)

    def text(self, name: str) -> str | None:
        """Report on a garment, None if it has hardly moved."""
        farthest = float((self.points - self.mesh.points).norm(dim=1).max())
        if farthest < LEAST_MOVED:
            return None
        edges = unique_edges(self.mesh.faces)
        before = edge_lengths(self.mesh.points, edges).clamp(min=1e-6)
        off = float((edge_lengths(self.points, edges) / before - 1.0).abs().quantile(0.95))
        return (
            f"  {name}: untangled from the other layers at rest, moved by up to {1000 * farthest:.0f} mm; "
            f"95 % of its edges are within {100 * off:.0f} % of their length"
        )


def untangle(garments: Sequence[Garment], body: Body) -> Untangled:
    """Move garments on a body at rest until each lies over those before it.

    Garments that do not cross stay as they are, to the bit.
    """
    if len(garments) < 2:
        return Untangled(tuple(garments), ())
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    pieces = [_Piece(welded(garment.mesh.vertices, garment.mesh.faces)) for garment in garments]
    if not any(bool(_crossing(pieces[:place], piece, surface).any()) for place, piece in enumerate(pieces)):
        return Untangled(tuple(garments), ())
    for turn in range(ROUNDS + FINAL_ROUNDS):
        for place, piece in enumerate(pieces[1:], 1):
            _move_out(pieces[:place], piece, surface, evened=turn < ROUNDS)
        for place in reversed(range(len(pieces) - 1) if turn >= OUTWARDS else ()):
            _press_in(pieces[:place], pieces[place], pieces[place + 1 :], surface)
    finished = tuple(
        replace(garment, mesh=replace(garment.mesh, vertices=piece.points[piece.mesh.places]))
        for garment, piece in zip(garments, pieces, strict=True)
    )
    texts = (piece.text(garment.name) for piece, garment in zip(pieces, garments, strict=True))
    return Untangled(finished, tuple(text for text in texts if text))


def crossing(meshes: Sequence[Mesh], surface: BodySurface) -> tuple[Tensor, ...]:
    """Masks (N,) of the vertices of each mesh that lie below one before it, which is worn beneath it."""
    pieces = [_Piece(welded(mesh.vertices, mesh.faces)) for mesh in meshes]
    masks = (_crossing(pieces[:place], piece, surface) for place, piece in enumerate(pieces))
    return tuple(mask[piece.mesh.places] for mask, piece in zip(masks, pieces, strict=True))


def _crossing(beneath: Sequence[_Piece], piece: _Piece, surface: BodySurface) -> Tensor:
    """Mask (U,) of the points of a garment that lie below one that is worn beneath it."""
    skin = surface.closest(piece.points)
    return (_ends(beneath, skin) > skin.signed_distance[:, None]).any(1)


def _move_out(beneath: Sequence[_Piece], piece: _Piece, surface: BodySurface, evened: bool) -> None:
    """Move a garment off the skin and off those beneath it."""
    skin = surface.closest(piece.points)
    ends = _ends(beneath, skin)
    least = GAP * (1.0 + torch.isfinite(ends).sum(1))
    wanted = torch.maximum(least, ends.amax(1) + GAP)
    step = (wanted - skin.signed_distance).clamp(min=0.0, max=LARGEST_STEP)
    piece.move(step[:, None] * skin.normals)
    if evened:
        piece.even(skin, least)


def _press_in(beneath: Sequence[_Piece], piece: _Piece, over: Sequence[_Piece], surface: BodySurface) -> None:
    """Move a garment below those over it, as far as the skin and those beneath it leave room."""
    skin = surface.closest(piece.points)
    starts = skin.points - BELOW * skin.normals
    reach = BELOW + DEPTH
    first = torch.stack([each.shell.first_hit(starts, skin.normals, reach)[0] for each in over]).amin(0)
    first = torch.where(first < reach, first - BELOW, torch.inf)
    room = GAP * (1.0 + torch.isfinite(_ends(beneath, skin)).sum(1))
    wanted = torch.maximum(first - GAP, room)
    step = (wanted - skin.signed_distance).clamp(min=-LARGEST_STEP, max=0.0)
    piece.move(step[:, None] * skin.normals)


def _ends(pieces: Sequence[_Piece], skin: SurfacePoints) -> Tensor:
    """Heights above the skin, m, at which garments end along the rays to points near it: (N, garments).

    -inf where a ray meets none, up to DEPTH outside its point.
    """
    columns = [_end(piece.shell, skin) for piece in pieces]
    return torch.stack(columns, 1) if columns else skin.signed_distance.new_full((len(skin.points), 0), 0.0)


def _end(shell: Shell, skin: SurfacePoints) -> Tensor:
    """Height (N,) m of the last surface of one garment that a ray leaves it through."""
    starts, farthest = skin.points - BELOW * skin.normals, torch.full_like(skin.signed_distance, -torch.inf)
    limits = skin.signed_distance + BELOW + DEPTH
    rows = torch.arange(len(starts))
    travelled = torch.zeros_like(limits)
    for surface in range(MOST_SURFACES):
        begin = starts[rows] + travelled[:, None] * skin.normals[rows]
        distance, facing = shell.first_hit(begin, skin.normals[rows], BELOW + 2.0 * DEPTH)
        near = (distance < FOLD) | (surface == 0)
        travelled = travelled + distance
        met = near & (travelled < limits[rows])
        rows, travelled = rows[met], travelled[met] + PAST
        leaves = facing[met] > 0
        farthest[rows[leaves]] = travelled[leaves] - BELOW
    return farthest
