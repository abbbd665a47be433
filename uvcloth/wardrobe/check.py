"""Check of a sewn outfit: outside the skin, not through itself, one piece each, with a hem that holds it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from rasterize.charts import edges_of, face_components
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.band import holding_band
from uvcloth.garments.diagnose import diagnose
from uvcloth.garments.garment import Garment
from uvcloth.garments.order import check_order
from uvcloth.garments.templates import faces_outward
from uvcloth.geometry.mesh import Mesh, edge_lengths, flat_faces, join_meshes, unique_edges, weld
from uvcloth.physics.self_intersection import crossing_edges_percent
from uvcloth.physics.surface import BodySurface

LEAST_OFF = 0.003
"""Metres off the skin below which an outfit is refused."""

LONGEST_EDGE = 6.0
"""Mean edges that the longest edge of a piece may have: a spike has more."""


def refuse_faulty(names: Sequence[str], pieces: Sequence[Mesh], body: Body) -> None:
    """Raise InputError that names the piece and what is wrong with it, if anything is.

    pieces: on the body's rest pose, the innermost first. Every piece is finite, of one piece with doubled
    seam vertices as one, turned outward, at least LEAST_OFF off the skin, without spikes, lies as clothes lie
    where it is (`diagnose`), and has a hem that holds it (`holding_band`); none crosses itself or another,
    and each is over those before it.
    """
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    for name, mesh in zip(names, pieces, strict=True):
        reason = _fault(mesh, body, surface)
        if reason:
            raise InputError(f"{name}: {reason}")
    for name, mesh in zip(names, pieces, strict=True):
        holding_band(bare_garment(name, mesh, body), body)
        placing = diagnose(Path(name), mesh, body)[1].placing
        if placing is None or not placing.usual or (placing.unit, placing.up) != ("m", "Z"):
            raise InputError(f"{name}: would be read as a file in other axes or units")
    check_order([bare_garment(name, mesh, body) for name, mesh in zip(names, pieces, strict=True)])
    outfit = join_meshes((mesh.vertices, mesh.faces) for mesh in pieces)
    crossing = _crossing(outfit.vertices, outfit.faces)
    if crossing > 0:
        raise InputError(f"{', '.join(names)}: {crossing:.2f} % of the edges cross cloth")


def bare_garment(name: str, mesh: Mesh, body: Body) -> Garment:
    """A garment without weights, for checks of its mesh alone."""
    none = torch.zeros(len(mesh.vertices), 0)
    return Garment(name, None, mesh, none, none)


def _fault(mesh: Mesh, body: Body, surface: BodySurface) -> str:
    """Fault of a single piece as a sentence, "" if it has none."""
    if not torch.isfinite(mesh.vertices).all():
        return "a vertex is not a finite number"
    broken = _broken(mesh)
    if broken:
        return broken
    if not faces_outward(mesh, body):
        return "its faces point inward"
    off = float(surface.closest(mesh.vertices).signed_distance.min())
    if off < LEAST_OFF:
        return f"comes within {1000 * off:.1f} mm of the skin, expected {1000 * LEAST_OFF:.0f} mm"
    lengths = edge_lengths(mesh.vertices, unique_edges(mesh.faces))
    if float(lengths.max()) > LONGEST_EDGE * float(lengths.mean()):
        longest, mean = 1000 * float(lengths.max()), 1000 * float(lengths.mean())
        return f"has an edge of {longest:.0f} mm, {mean:.0f} on average"
    return ""


def _broken(mesh: Mesh) -> str:
    """Reason why the faces of a piece are not a valid surface, "" if they are."""
    welded = weld(mesh.vertices)[mesh.faces]
    parts = int(face_components(welded.numpy(), welded.new_zeros(0).numpy()).max()) + 1
    if parts > 1:
        return f"consists of {parts} pieces"
    if bool(flat_faces(mesh.vertices, mesh.faces).any()):
        return "a face has no area"
    directed, _ = edges_of(welded.numpy())
    if len(np.unique(directed, axis=0)) < len(directed):
        return "two faces at an edge have opposite orientations"
    return ""


def _crossing(vertices: Tensor, faces: Tensor) -> float:
    return float(crossing_edges_percent(vertices[None], weld(vertices)[faces])[0])
