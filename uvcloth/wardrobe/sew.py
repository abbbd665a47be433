"""Sewing of designs: patterns remeshed, eased off the skin and worn over one another on a body at rest."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from rasterize.charts import edge_keys, edge_twins, edges_of, weld_corners
from rasterize.gather import gather
from rasterize.raycast import cast_rays
from uvcloth.bodies.body import Body
from uvcloth.garments.band import DROP
from uvcloth.garments.places import BAND_WIDTH, hem_band
from uvcloth.garments.remesh import Array, Indices, remesh, surface_of
from uvcloth.garments.templates import faces_outward, offset_from_skin, smoothing_matrix
from uvcloth.geometry.mesh import Mesh, boundary_edges, face_normals, vertex_normals
from uvcloth.physics.exposure import spread
from uvcloth.physics.face_contact import FACE_CLEARANCE, POINT_SPACING
from uvcloth.physics.layers import Layer
from uvcloth.physics.surface import BodySurface
from uvcloth.wardrobe.designs import Design
from uvcloth.wardrobe.drape import drape
from uvcloth.wardrobe.patterns import Pattern, cut_pattern, ease, sleeves_stretched

LEAST_OFF = 0.004
"""Metres that every vertex is off the skin."""

OVER = 0.004
"""Metres that a piece lies over those beneath."""

REACH = 0.15
"""Metres off the skin within which a piece beneath is searched."""

ROOM_SHARE = 0.35
"""Share of the distance to the opposite side of the body, between the legs and under the arms, that cloth may
take.
"""

ROOM = 0.3
"""Metres within which the opposite side of the body is searched."""

EASE_SMOOTHING = 8
"""Passes that smooth the ease over neighbours, so that a sleeve meets the trunk without a step."""

SEAM_SMOOTHING = 8
"""Passes that smooth the normals by which front and back are separated."""

OVER_PASSES = 8
"""Passes that move a piece off those beneath."""


WAVE_STRETCH, WAVE_NUMBER = 0.55, 12.0
"""Share by which waves along the axes stretch a surface to be meshed unevenly, and their radians per m."""

FACE_PASSES = 8
"""Passes that move the faces of a piece off the skin."""


@dataclass(frozen=True)
class Meshing:
    """Meshing of an outfit.

    vertices: of all its pieces together, about. even: whether triangles are of about one size. seams: whether
    pieces are sewn of panels, whose vertices are doubled along the seams.
    """

    vertices: int
    even: bool
    seams: bool


def sew(designs: Sequence[Design], meshing: Meshing, body: Body) -> tuple[Mesh, ...]:
    """Make the pieces of an outfit, the innermost first, at rest on the body, without texture coordinates.

    Raises InputError if a pattern cannot be cut, or the `body` extra (the remesher) is missing.
    """
    patterns = [cut_pattern(design, body) for design in designs]
    stretched = [_stretched(pattern, meshing, body) for pattern in patterns]
    areas = np.array([_area(pattern) for pattern in stretched])
    counts = np.round(meshing.vertices * areas / areas.sum()).astype(int)
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    pieces: list[Mesh] = []
    for design, pattern, large, count in zip(designs, patterns, stretched, counts.tolist(), strict=True):
        points, triangles = _meshed(pattern, large, count)
        faces = torch.from_numpy(np.ascontiguousarray(triangles))
        vertices = torch.from_numpy(points).float()
        if not faces_outward(_mesh(vertices, faces), body):
            faces = faces.flip(1)
        pieces.append(_worn(design, vertices, faces, pieces, body, surface))
    return tuple(_panels(piece) if meshing.seams else piece for piece in pieces)


def _stretched(pattern: Pattern, meshing: Meshing, body: Body) -> Pattern:
    """The pattern in the shape in which its triangles are to be even."""
    vertices = sleeves_stretched(body, pattern.vertices)
    if not meshing.even:
        vertices = vertices + WAVE_STRETCH / WAVE_NUMBER * np.sin(WAVE_NUMBER * vertices)
    return replace(pattern, vertices=vertices)


def _meshed(pattern: Pattern, stretched: Pattern, count: int) -> tuple[Array, Indices]:
    """Remesh a pattern to `count` vertices whose triangles would be even if it were stretched so."""
    points, triangles = remesh(stretched.vertices, stretched.faces, count)
    nearest = surface_of(stretched.vertices, stretched.faces).closest(torch.from_numpy(points).float())
    corners = torch.from_numpy(pattern.faces)[nearest.faces]
    placed = gather(torch.from_numpy(pattern.vertices).float(), corners, nearest.barycentrics)
    return placed.numpy().astype(np.float64), triangles


def _worn(
    design: Design, vertices: Tensor, faces: Tensor, beneath: Sequence[Mesh], body: Body, surface: BodySurface
) -> Mesh:
    """A piece moved off the skin to its ease, and over the pieces beneath."""
    average = smoothing_matrix(faces, len(vertices))
    snug = _held(vertices, faces)
    room = _room(vertices, body, surface)
    points = vertices.numpy().astype(np.float64)
    off = torch.from_numpy(ease(design, body, points)).float()
    for inner in beneath:
        off = torch.maximum(off, _thickness(vertices, inner, surface) + OVER)
    for _ in range(EASE_SMOOTHING):
        off = torch.where(snug, off, torch.minimum(0.5 * off + 0.5 * (average @ off), room))
    vertices = torch.from_numpy(
        drape(design, body, points, off.double().numpy(), room.double().numpy())
    ).float()
    if design.skirt is None:
        # Smoothing along a small hem draws it together: it stays where it fell.
        off = torch.where(snug, off, torch.maximum(off, surface.closest(vertices).signed_distance))
    vertices = offset_from_skin(vertices, faces, off, snug & ~_over(vertices, beneath), body)
    for inner in beneath:
        vertices = _over_piece(vertices, average, inner, surface)
    return _mesh(_off_skin(_faces_off_skin(vertices, faces, surface), surface), faces)


def _held(vertices: Tensor, faces: Tensor) -> Tensor:
    """Mask (N,) of the strip along the top of the uppermost hem, which lies snug."""
    rim = boundary_edges(faces).unique()
    top = vertices[rim, 2].max()
    near = rim[vertices[rim, 2] > top - DROP / 2]
    return hem_band(vertices, vertices[near], BAND_WIDTH)


def _room(vertices: Tensor, body: Body, surface: BodySurface) -> Tensor:
    """Metres (N,) off the skin that cloth may take: a share of the distance to the body opposite."""
    skin = surface.closest(vertices)
    start = skin.points + 1e-4 * skin.normals
    hits = cast_rays(
        start, skin.normals, body.mesh.vertices, body.mesh.faces, max_distance=ROOM, both_ways=False
    )
    return (ROOM_SHARE * hits.distance.float()).clamp(min=LEAST_OFF)


def _thickness(vertices: Tensor, inner: Mesh, surface: BodySurface) -> Tensor:
    """Metres (N,) off the skin at which a piece beneath lies where points (N, 3) m are nearest; 0 without."""
    skin = surface.closest(vertices)
    hits = cast_rays(
        skin.points, skin.normals, inner.vertices, inner.faces, max_distance=REACH, both_ways=False
    )
    return torch.where(hits.hit, hits.distance, 0.0).float()


def _over(vertices: Tensor, beneath: Sequence[Mesh]) -> Tensor:
    """Mask (N,) of the points that lie over a piece beneath."""
    covered = torch.zeros(len(vertices), dtype=torch.bool)
    for inner in beneath:
        covered |= Layer(inner.vertices, inner.faces).beside(vertices, REACH).covered
    return covered


def _over_piece(vertices: Tensor, average: Tensor, inner: Mesh, surface: BodySurface) -> Tensor:
    """Vertices (N, 3) m moved over a piece beneath, neighbours along with them."""
    layer = Layer(inner.vertices, inner.faces)
    for turn in range(OVER_PASSES):
        nearest = layer.beside(vertices, REACH)
        lack = torch.where(nearest.covered, (OVER - nearest.distance).clamp(min=0), 0.0)
        move = lack[:, None] * nearest.normals
        if turn < OVER_PASSES - 2:
            move = torch.where((lack > 0)[:, None], move, 0.5 * (average @ move))
        vertices = _off_skin(vertices + move, surface)
    return vertices


def _faces_off_skin(vertices: Tensor, faces: Tensor, surface: BodySurface) -> Tensor:
    """Vertices (N, 3) m moved until points all over the faces, too, are off the skin."""
    count = math.ceil(0.5 * float(face_normals(vertices, faces).norm(dim=1).sum()) / POINT_SPACING**2)
    sample = spread(vertices, faces, count)
    weights = sample.barycentrics
    for _ in range(FACE_PASSES):
        skin = surface.closest(sample.points(vertices))
        lack = (FACE_CLEARANCE - skin.signed_distance).clamp(min=0)
        if not bool(lack.any()):
            break
        # A corner takes the most that a point beside it asks of it, along that point's normal.
        shares = weights / weights.square().sum(1, keepdim=True) * lack[:, None]
        most = torch.zeros(len(vertices)).scatter_reduce(
            0, sample.corners.reshape(-1), shares.reshape(-1), "amax"
        )
        normals = torch.zeros_like(vertices).index_add(
            0, sample.corners.reshape(-1), (shares[..., None] * skin.normals[:, None]).reshape(-1, 3)
        )
        vertices = vertices + most[:, None] * torch.nn.functional.normalize(normals, dim=1)
    return vertices


def _off_skin(vertices: Tensor, surface: BodySurface) -> Tensor:
    for _ in range(3):
        skin = surface.closest(vertices)
        vertices = vertices + (LEAST_OFF - skin.signed_distance).clamp(min=0)[:, None] * skin.normals
    return vertices


def _panels(mesh: Mesh) -> Mesh:
    """A piece cut along its sides into a front and a back, each with its own vertices along the seams."""
    faces = mesh.faces.numpy()
    in_front = _in_front(mesh).numpy()
    pairs = edge_twins(faces, np.zeros(0, dtype=np.int64))
    directed, owner = edges_of(faces)
    seam = in_front[owner[pairs[:, 0]]] != in_front[owner[pairs[:, 1]]]
    copies = weld_corners(faces, edge_keys(directed, len(mesh.vertices))[pairs[seam, 0]])
    vertices = torch.zeros(int(copies.max()) + 1, 3)
    vertices[torch.from_numpy(copies).reshape(-1)] = mesh.vertices[mesh.faces.reshape(-1)]
    return _mesh(vertices, torch.from_numpy(copies))


def _in_front(mesh: Mesh) -> Tensor:
    """Mask (M,) of the faces of the front, by normals smoothed so that the seams wind less."""
    average = smoothing_matrix(mesh.faces, len(mesh.vertices))
    backwards = vertex_normals(mesh.vertices, mesh.faces)[:, 1]
    for _ in range(SEAM_SMOOTHING):
        backwards = 0.5 * backwards + 0.5 * (average @ backwards)
    return backwards[mesh.faces].mean(1) < 0


def _area(pattern: Pattern) -> float:
    vertices, faces = torch.from_numpy(pattern.vertices), torch.from_numpy(pattern.faces.copy())
    return float(face_normals(vertices, faces).norm(dim=1).sum())


def _mesh(vertices: Tensor, faces: Tensor) -> Mesh:
    return Mesh(vertices, faces, torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64))
