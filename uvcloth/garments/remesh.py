"""Remeshing of cut surfaces: triangles of about one size whose hems lie on the cuts."""

import warnings

import numpy as np
import torch
from numpy.typing import NDArray

from rasterize.charts import boundary_loops, largest_piece
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import face_normals, neighbour_average
from uvcloth.physics.surface import BodySurface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

POINTS_PER_VERTEX = 12
"""Points of the subdivided surface, for each vertex, that are clustered."""

RELAXATIONS = 10
"""Passes that equalize the triangles."""


def remesh(vertices: Array, faces: Indices, count: int) -> tuple[Array, Indices]:
    """Remesh a surface (P, 3) m, (Q, 3) with holes to about `count` vertices; its largest piece.

    Raises InputError if the `body` extra (the remesher) is missing, or where a hem does not close.
    """
    try:
        import pyacvd
        import pyvista
    except ModuleNotFoundError as error:
        raise InputError("tailoring needs the remesher: install uvcloth[body]") from error
    cells = np.column_stack([np.full(len(faces), 3), faces]).ravel()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pyvista.PyVistaDeprecationWarning)  # Of what pyacvd itself calls.
        clustering = pyacvd.Clustering(pyvista.PolyData(vertices, cells))
        clustering.subdivide(_subdivisions(len(vertices), count))
        clustering.cluster(count)
        # Each centre's place on the surface, ray by ray, would take most of the time; relaxing finds it.
        clustered = clustering.create_mesh(moveclus=False, flipnorm=False)
    points = np.asarray(clustered.points, dtype=np.float64)
    triangles = np.asarray(clustered.faces).reshape(-1, 4)[:, 1:].astype(np.int64)
    points, triangles = largest(points, triangles)
    source = surface_of(vertices, faces)
    triangles = _turned_as(source, faces, points, triangles)
    hems = [vertices[run] for run in boundary_loops(faces)]
    rims = boundary_loops(triangles)
    for _ in range(RELAXATIONS):
        points = _relaxed(points, triangles, rims)
        points = source.closest(torch.from_numpy(points).float()).points.numpy().astype(np.float64)
        for rim in rims:
            points[rim] = _snapped(points[rim], hems)
    return points, triangles


def largest(vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    """Largest piece of a mesh (P, 3), (Q, 3)."""
    kept, renumbered = largest_faces(faces)
    return vertices[kept], renumbered


def largest_faces(faces: Indices) -> tuple[Indices, Indices]:
    """Vertices (N,) of the largest piece of a mesh, and its faces (M, 3) renumbered to them."""
    kept, renumbered = np.unique(faces[largest_piece(faces)], return_inverse=True)
    return kept, renumbered.reshape(-1, 3)


def surface_of(vertices: Array, faces: Indices) -> BodySurface:
    """The surface (P, 3) m, (Q, 3) to ask for closest points."""
    return BodySurface(torch.from_numpy(vertices).float(), torch.from_numpy(faces))


def _subdivisions(vertices: int, count: int) -> int:
    """Subdivisions, each into four times as many points, that leave enough of them to a vertex."""
    return max(1, int(np.ceil(np.log(max(POINTS_PER_VERTEX * count / vertices, 1.0)) / np.log(4.0))))


def _turned_as(source: BodySurface, faces: Indices, points: Array, triangles: Indices) -> Indices:
    """Triangles with the orientation of the faces (Q, 3) of the surface that they replace."""
    placed, corners = torch.from_numpy(points).float(), torch.from_numpy(triangles)
    stands_for = source.closest(placed[corners].mean(1)).faces
    there = face_normals(source.points, torch.from_numpy(faces)[stands_for])
    against = (face_normals(placed, corners) * there).sum(1) < 0
    return np.where(against.numpy()[:, None], triangles[:, ::-1], triangles)


def _relaxed(points: Array, faces: Indices, rims: list[Indices]) -> Array:
    """Points half way to the mean of their neighbours, those of a rim to the mean of their two along it."""
    average = neighbour_average(torch.from_numpy(faces), len(points)).double()
    relaxed = 0.5 * points + 0.5 * (average @ torch.from_numpy(points)).numpy()
    for rim in rims:
        relaxed[rim] = 0.5 * points[rim] + 0.25 * (np.roll(points[rim], 1, 0) + np.roll(points[rim], -1, 0))
    return relaxed


def _snapped(points: Array, hems: list[Array]) -> Array:
    """Closest points on the nearest closed polyline among `hems`."""
    best, distance = points, np.full(len(points), np.inf)
    for hem in hems:
        start, along = hem, np.roll(hem, -1, axis=0) - hem
        share = ((points[:, None] - start) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
        on_line = start + share.clip(0, 1)[..., None] * along
        gap = np.linalg.norm(on_line - points[:, None], axis=-1)
        nearest = gap.argmin(axis=1)
        rows = np.arange(len(points))
        closer = gap[rows, nearest] < distance
        best = np.where(closer[:, None], on_line[rows, nearest], best)
        distance = np.minimum(distance, gap[rows, nearest])
    return best
