"""Holding bands of garments: the strip that a template names, named places and vertices, or one along the
uppermost hem.

A piece without a hem at its top, a hood that is closed, is held by its cloth on the shoulders.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from rasterize.charts import face_components
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.places import BAND_WIDTH, hem_band, hems, places
from uvcloth.garments.templates import load_template
from uvcloth.geometry.mesh import boundary_edges, face_normals, weld
from uvcloth.geometry.once import once_per_record

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

LEAST_BANDED = 0.01
"""Share of a garment's area that a band counts for, at least: single vertices hold it up too."""


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


@once_per_record
def holding_band(garment: Garment, body: Body) -> Band:
    """The band of a garment, which a simulation attaches to the body; each separate piece is held by its own.

    It is computed once per garment and body. The places of `garment.holds` and the vertices of `garment.pins`
    count, if it has any. Raises InputError
    for a piece that neither an open hem at its top nor the shoulders hold.
    """
    is_named = bool(garment.holds) or garment.pins is not None
    if garment.source == "template" and garment.template and not is_named:
        return Band(load_template(garment.template).band, TEMPLATE_MASS[garment.template])
    mesh, held = garment.mesh, torch.zeros(len(garment.mesh.vertices), dtype=torch.bool)
    if not is_named or "top" in garment.holds:
        held |= _top(garment, body)
    if garment.pins is not None:
        held |= garment.pins
    if garment.holds:
        masks = places(mesh, body)
        for place in garment.holds:
            held |= masks.get(place, held)
    area = face_normals(mesh.vertices, mesh.faces).norm(dim=1)
    banded = max(float((area * held[mesh.faces].float().mean(1)).sum()), LEAST_BANDED * float(area.sum()))
    on_shoulders = float(mesh.vertices[held][:, 2].mean()) > body.head_of("left_upper_arm")[2]
    share = SHOULDER_SHARE if on_shoulders else WAIST_SHARE
    return Band(held, 1.0 + share * (float(area.sum()) - banded) / banded)


def held_by(garment: Garment, body: Body) -> tuple[str, ...]:
    """Names of the places that hold a garment. Raises InputError as `holding_band` does."""
    if garment.holds or garment.pins is not None:
        return (*garment.holds, *(("pins",) if garment.pins is not None else ()))
    band = holding_band(garment, body).vertices
    shares = {
        name: float((mask & band).sum()) / float(band.sum())
        for name, mask in places(garment.mesh, body).items()
    }
    most = max(shares, key=lambda name: shares[name], default="")
    return (most,) if most and shares[most] > 0.5 else ("top",)


def _top(garment: Garment, body: Body) -> Tensor:
    """Mask (N,) of the band along the top of each piece."""
    mesh = garment.mesh
    faces = weld(mesh.vertices)[mesh.faces]
    pieces = torch.from_numpy(face_components(faces.numpy(), np.zeros(0, dtype=np.int64)))
    held = torch.zeros(len(mesh.vertices), dtype=torch.bool)
    over: Tensor | None = None
    for piece in pieces.unique():
        rows = pieces == piece
        used = mesh.faces[rows].unique()
        hem = _top_hem(mesh.vertices, faces[rows])
        if isinstance(hem, str):
            over = places(mesh, body).get("shoulders", held) if over is None else over
            if not over[used].any():
                raise InputError(
                    f"garment {garment.name}: cannot be simulated, a piece of it has {hem} that would hold it"
                )
            held[used] |= over[used]
        else:
            held[used] |= hem_band(mesh.vertices[used], mesh.vertices[hem], BAND_WIDTH)
    return held


def _top_hem(vertices: Tensor, faces: Tensor) -> Tensor | str:
    """The vertices (H,) along the upper part of the uppermost hem of one piece, or the reason for none."""
    heights = vertices[:, 2]
    top = max(hems(boundary_edges(faces)), key=lambda hem: float(heights[hem].max()), default=None)
    if top is None:
        return "no open hem"
    if float(heights[faces.unique()].max() - heights[top].max()) > BELOW_TOP:
        return f"no open hem within {BELOW_TOP:.2f} m of its top"
    return top[heights[top] > heights[top].max() - DROP]
