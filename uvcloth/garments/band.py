"""Holding bands of garments: the strip that a template names, or one along the uppermost hem."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from rasterize.charts import face_components
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.shells import joint_of
from uvcloth.garments.templates import load_template
from uvcloth.geometry.mesh import boundary_edges, face_normals, weld

BAND_WIDTH = 0.03
"""Metres from the hem that the band reaches."""

BELOW_TOP = 0.1
"""Metres that the uppermost hem may be below the top of its piece: the hem of a hood is."""

DROP = 0.2
"""Metres below its top up to which a hem holds the piece: the hem of an open jacket runs down to the bottom.
"""

TEMPLATE_MASS = {
    "tops": 11.0,
    "bottoms": 31.0,
    "dress": 11.0,
    "shirt": 15.0,
    "skirt": 39.0,
    "jacket": 23.0,
}
"""Mass of the templates' bands, as a multiple of the mass of their area."""

WAIST_SHARE, SHOULDER_SHARE = 0.85, 0.3
"""Mass of any other band over the mass below it; shoulders carry most of the rest."""


@dataclass(frozen=True)
class Band:
    """Held vertices of a garment.

    vertices: (N,) bool. mass: how many times heavier they are, so that they carry the rest.
    """

    vertices: Tensor
    mass: float


def unheld_reason(outfit: Outfit) -> str:
    """The reason that nothing holds a garment of an outfit up, "" where a band holds each."""
    try:
        for garment in outfit.garments:
            holding_band(garment, outfit.body)
    except InputError as error:
        return str(error)
    return ""


def holding_band(garment: Garment, body: Body) -> Band:
    """The band of a garment, which a simulation attaches to the body; each separate piece is held by its own.

    Raises InputError for a piece without an open hem at its top.
    """
    if garment.source == "template" and garment.template:
        return Band(load_template(garment.template).band, TEMPLATE_MASS[garment.template])
    mesh = garment.mesh
    faces = weld(mesh.vertices)[mesh.faces]
    pieces = torch.from_numpy(face_components(faces.numpy(), np.zeros(0, dtype=np.int64)))
    held = torch.zeros(len(mesh.vertices), dtype=torch.bool)
    for piece in pieces.unique():
        rows = pieces == piece
        hem = _top_hem(garment.name, mesh.vertices, faces[rows])
        used = mesh.faces[rows].unique()
        held[used] |= hem_band(mesh.vertices[used], mesh.vertices[hem], BAND_WIDTH)
    area = face_normals(mesh.vertices, mesh.faces).norm(dim=1)
    banded = float((area * held[mesh.faces].float().mean(1)).sum())
    on_shoulders = float(mesh.vertices[held][:, 2].mean()) > joint_of(body, "left_upper_arm")[2]
    share = SHOULDER_SHARE if on_shoulders else WAIST_SHARE
    return Band(held, 1.0 + share * (float(area.sum()) - banded) / banded)


def hem_band(vertices: Tensor, hem: Tensor, width: float) -> Tensor:
    """Mask of the vertices (N, 3) m within `width` metres of points (H, 3) along a hem: (N,) bool."""
    return torch.cdist(vertices, hem).min(dim=1).values < width


def _top_hem(name: str, vertices: Tensor, faces: Tensor) -> Tensor:
    """The vertices (H,) along the upper part of the uppermost hem of one piece."""
    heights = vertices[:, 2]
    top = max(hems(boundary_edges(faces)), key=lambda hem: float(heights[hem].max()), default=None)
    below = float(heights[faces.unique()].max() - heights[top].max()) if top is not None else np.inf
    if top is None or below > BELOW_TOP:
        fault = "no open hem" if top is None else f"no open hem within {BELOW_TOP:.2f} m of its top"
        raise InputError(f"garment {name}: cannot be simulated, a piece of it has {fault} that would hold it")
    return top[heights[top] > heights[top].max() - DROP]


def hems(edges: Tensor) -> Sequence[Tensor]:
    """The vertices of each connected run of boundary edges (E, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    used, ends = edges.unique(return_inverse=True)
    start, end = ends.numpy().T
    graph = coo_array((np.ones(len(edges)), (start, end)), shape=(len(used), len(used)))
    run = torch.from_numpy(connected_components(graph, directed=False)[1])
    return [used[run == each] for each in run.unique()]
