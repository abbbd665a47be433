"""UV layouts: the charts of a mesh, their places on the unit square."""

import io
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from rasterize.charts import boundary_loops, edge_keys, edges_of, face_components, weld_corners
from rasterize.errors import InputError
from rasterize.flatten import flatten

UNWRAP_WORKER = Path(__file__).with_name("unwrap_worker.py")

CHART_VERTICES = 4000
"""Limit for the vertices of an island of an unwrapped mesh: the cost grows faster than their number."""

UNEVEN = 0.05
"""Noise, in face sizes, on the copy of a mesh that is unwrapped where the mesh itself cannot be."""


@dataclass(frozen=True)
class Layout:
    """The kept faces of a mesh on the unit square; u runs right, v runs up.

    faces: (K,) int64, indices of the mesh faces that are kept. uvs: (U, 2) in [0, 1].
    face_uvs: (K, 3) int64 into uvs, in the corner order of the mesh faces. islands: (K,) int64 chart of each
    face; charts are never joined, not even where they touch.
    """

    faces: Tensor
    uvs: Tensor
    face_uvs: Tensor
    islands: Tensor


@dataclass(frozen=True)
class Chart:
    """One labelled piece of a surface and the rectangle that it fills.

    label: that of its faces. corners: the four mesh vertices, counter-clockwise from the lower left, that go
    to the corners of the rectangle; a vertex on a seam may be named twice, once for each side of the seam.
    rectangle: (left, bottom, right, top) on the sheet.
    """

    name: str
    label: int
    corners: tuple[int, int, int, int]
    rectangle: tuple[float, float, float, float]


def lay_out(
    vertices: Tensor, faces: Tensor, labels: Tensor, charts: Sequence[Chart], seams: Tensor, *, margin: float
) -> Layout:
    """Flatten each labelled piece of a surface onto its rectangle.

    vertices: (V, 3). faces: (F, 3). labels: (F,) int64; faces whose label no chart has are pruned.
    seams: (E, 2) edges along which pieces are cut open (edges between labels are cut anyway).
    margin: kept free inside each rectangle, so that neighbours are two margins apart.
    Raises InputError naming the chart if a piece is not a disk with those corners.
    """
    points, mesh_faces = vertices.double().numpy(), faces.numpy()
    kept: list[np.ndarray] = []
    uvs: list[np.ndarray] = []
    face_uvs: list[np.ndarray] = []
    islands: list[np.ndarray] = []
    cuts = edge_keys(seams.numpy(), len(points))
    for island, chart in enumerate(charts):
        rows = np.flatnonzero(labels.numpy() == chart.label)
        if not len(rows):
            raise InputError(f"{chart.name}: no face belongs to this part of the body")
        used, local = np.unique(mesh_faces[rows], return_inverse=True)
        local = local.reshape(-1, 3)
        ends = np.searchsorted(used, np.unravel_index(cuts, (len(points),) * 2)).T
        inside = np.isin(cuts, edge_keys(used[edges_of(local)[0]], len(points)))
        local_cuts = edge_keys(ends[inside], len(used)) if inside.any() else np.zeros(0, dtype=np.int64)
        if face_components(local, local_cuts).any():
            raise InputError(f"{chart.name}: this part of the body is not connected")
        welded = weld_corners(local, local_cuts)
        source = np.zeros(welded.max() + 1, dtype=np.int64)
        source[welded] = used[local]
        corners = _corner_copies(welded, source, chart)
        left, bottom, right, top = chart.rectangle
        low = np.array([left + margin, bottom + margin])
        size = np.array([right - margin, top - margin]) - low
        flat = flatten(points[source], welded, corners, size[0] / size[1], chart.name)
        face_uvs.append(welded + sum(len(part) for part in uvs))
        uvs.append(low + flat * size)
        kept.append(rows)
        islands.append(np.full(len(rows), island))
    return Layout(
        faces=torch.from_numpy(np.concatenate(kept)),
        uvs=torch.from_numpy(np.concatenate(uvs)).float(),
        face_uvs=torch.from_numpy(np.concatenate(face_uvs)),
        islands=torch.from_numpy(np.concatenate(islands)),
    )


def _corner_copies(welded: np.ndarray, source: np.ndarray, chart: Chart) -> np.ndarray:
    """The copies on the outer boundary that meet the chart's corners in their order."""
    loop = boundary_loops(welded)[0]
    met = loop[np.isin(source[loop], chart.corners)]
    for turn in range(len(met)):
        turned = np.roll(met, -turn)
        if source[turned].tolist() == list(chart.corners):
            return turned
    raise InputError(f"{chart.name}: its outer boundary does not meet the corners in their order")


def unwrap(vertices: Tensor, faces: Tensor, name: str) -> tuple[Tensor, Tensor]:
    """Unwrap any mesh with xatlas, the vertices staying as they are: uvs (U, 2) and face_uvs (F, 3) int64.

    vertices: (V, 3). faces: (F, 3). A vertex on a seam gets several uvs. Islands have about
    CHART_VERTICES at most, by their area. name: of the mesh, for the InputError that is raised if xatlas
    fails.
    """
    a, b, c = vertices.double()[faces].unbind(1)
    area = 0.5 * float(torch.linalg.cross(b - a, c - a).norm(dim=1).sum())
    share = CHART_VERTICES / len(vertices)
    most = area * share if share < 1.0 else 0.0
    answer = _xatlas(vertices, faces, most)
    if answer.returncode:
        # It ends the process with meshes that are exactly even.
        noise = torch.randn(vertices.shape, generator=torch.Generator().manual_seed(0))
        answer = _xatlas(vertices + UNEVEN * (area / len(faces)) ** 0.5 * noise, faces, most)
    if answer.returncode:
        error = answer.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise InputError(
            f"{name}: the mesh cannot be unwrapped: {error or f'xatlas ended with code {answer.returncode}'}"
        )
    stream = io.BytesIO(answer.stdout)
    source, indices, uvs = (np.load(stream) for _ in range(3))
    face_uvs = torch.from_numpy(indices.astype(np.int64))
    if not torch.equal(torch.from_numpy(source.astype(np.int64))[face_uvs], faces):
        raise InputError(f"{name}: the mesh cannot be unwrapped: xatlas dropped or turned some of its faces")
    return torch.from_numpy(np.ascontiguousarray(uvs)).clamp(0.0, 1.0), face_uvs


def layout_of_uvs(uvs: Tensor, face_uvs: Tensor) -> Layout:
    """Layout of all faces of a mesh with texture coordinates uvs (U, 2) and face_uvs (F, 3) int64.

    Faces that are joined on the sheet are one chart.
    """
    islands = face_components(face_uvs.numpy(), np.zeros(0, dtype=np.int64))
    return Layout(torch.arange(len(face_uvs)), uvs, face_uvs, torch.from_numpy(islands))


def _xatlas(vertices: Tensor, faces: Tensor, area: float) -> subprocess.CompletedProcess[bytes]:
    """Run the worker on a mesh until it ends. area: largest of an island, 0 for any."""
    asked = io.BytesIO()
    for array in (vertices.numpy().astype(np.float32), faces.numpy().astype(np.uint32), np.array(area)):
        np.save(asked, array)
    command = [sys.executable, "-P", str(UNWRAP_WORKER)]
    return subprocess.run(command, input=asked.getvalue(), capture_output=True, check=False)
