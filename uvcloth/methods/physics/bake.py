"""Baking: all that the runtime needs to dress a character, as named arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.methods.physics.caged_garment import CagedGarment
from uvcloth.physics.cloth.solver import Solver
from uvcloth.physics.outfit_clearing import OutfitClearing
from uvcloth.player.sections import row_starts

REST_STEP, SHARE_STEP, COVERED_STEP = 2.0**-15, 2.0**-15, 2.0**-12
"""Steps that vertices at rest, m, shares that make one whole, and those of covered points are rounded to."""

LEAST_WEIGHT = 1e-4
"""Blend weight of cloth below which a joint is left out of a file."""

STEPS = {
    **{f"{name}.rest": REST_STEP for name in ("body", "cages", "points")},
    **{f"{name}.weights": SHARE_STEP for name in ("body", "cages", "points", "follow")},
    "covered.shares": COVERED_STEP,
    "opening.clear": REST_STEP,
}
"""Step of each section that is rounded."""

DERIVED = (
    *("skin.rest", "fine.rest", "cloth.rest", "membrane.corners", "covered.weights", "opening.faces"),
    *("opening.tips", "opening.rim_starts", "opening.rims"),
    *("collider.rest", "collider.faces", "collider.starts"),
)
"""Sections that the runtime derives from others (runtime/src/derived.h)."""


def baked_sections(
    body: Body,
    garments: Sequence[CagedGarment],
    solver: Solver,
    clearing: OutfitClearing,
    hold: NDArray[np.floating],
    rounded: bool,
) -> dict[str, NDArray[Any]]:
    """The arrays of a baked outfit, by their names in runtime/src/outfit.h.

    solver: of all cages. clearing: of the garments. hold: (n,) 1/s, the attachment of bands. rounded: as
    a file has them.
    """
    settings = solver.settings
    rims = [rim.numpy() for rim in clearing.closed.rims]
    shown = [
        each.mesh.places.numpy() + start
        for each, start in zip(
            garments, row_starts([len(each.mesh.points) for each in garments]), strict=False
        )
    ]
    shapes = body.pose_shapes
    nothing = np.zeros((0, 3 * len(body.mesh.vertices)))
    sections = {
        "outfit.shapes": nothing if shapes is None else shapes.flatten(1).numpy(),
        "outfit.size": np.array([clearing.size]),
        "outfit.hold": hold,
        "outfit.shown_starts": row_starts([len(each) for each in shown]),
        "outfit.shown": np.concatenate(shown),
        "settings.needed": np.array([max(settings.substeps, 1.0 / (settings.safety * solver.stable_step))]),
        "settings.radius": np.array([settings.radius]),
        "settings.self_radius": np.array([settings.self_radius]),
        "settings.fold_radius": np.array([solver.fold_radius]),
        "settings.self_margin": np.array([settings.self_margin]),
        "settings.reach": np.array([settings.reach]),
        "settings.interval": np.array([settings.interval]),
        "settings.renewal": np.array([float(settings.renewal)]),
        "settings.hinge_interval": np.array([1.0]),
        "skeleton.parents": np.array(body.skeleton.parents),
        "skeleton.heads": body.skeleton.heads.numpy(),
        "caps.rim_starts": row_starts([len(rim) for rim in rims]),
        "caps.rims": np.concatenate([np.zeros((0, 2), np.int64), *rims]),
        **_skin("body", body.mesh.vertices, body.weights, 0.0, rounded),
        **_skin(
            "cages",
            torch.cat([garment.cage.vertices for garment in garments]),
            torch.cat([each.cage_weights for each in garments]),
            LEAST_WEIGHT,
            rounded,
        ),
        **_skin(
            "points",
            torch.cat([each.mesh.points for each in garments]),
            torch.cat([each.weights for each in garments]),
            LEAST_WEIGHT,
            rounded,
        ),
        **_following(garments, rounded),
        **_parts(body.mesh.faces.numpy(), clearing),
        **clearing.opening.sections,
        **clearing.sections,
        **solver.cloth.sections(),
        **solver.body.sections(),
    }
    sections["covered.shares"] = sections["covered.weights"][:, :2]
    return {name: array for name, array in sections.items() if name not in DERIVED}


def _skin(name: str, rest: Tensor, weights: Tensor, least: float, rounded: bool) -> dict[str, NDArray[Any]]:
    """Vertices (V, 3) m at rest, and those of their weights (V, J) that are above 0, or at least `least`.

    rounded: as a file has them; otherwise all that are above 0 stay.
    """
    kept = weights.numpy() >= least if rounded and least else weights.numpy() != 0.0
    rows, joints = np.nonzero(kept)
    counts = np.bincount(rows, minlength=len(rest))
    return {
        f"{name}.rest": rest.numpy(),
        f"{name}.starts": row_starts(counts),
        f"{name}.joints": joints,
        f"{name}.weights": _shares(weights.numpy()[rows, joints], counts, rounded),
    }


def _following(garments: Sequence[CagedGarment], rounded: bool) -> dict[str, NDArray[Any]]:
    """Vertices of all cages around each point of all garments, and their weights."""
    corners, weights, counts = [], [], []
    for garment in garments:
        shares = garment.cage.own_weights.numpy()
        near = shares != 0.0
        corners.append(garment.cage.own_corners.numpy()[near] + garment.rows.start)
        weights.append(shares[near])
        counts.extend(near.sum(1).tolist())
    return {
        "follow.starts": row_starts(counts),
        "follow.cage": np.concatenate(corners),
        "follow.weights": _shares(np.concatenate(weights), np.array(counts), rounded),
    }


def _shares(weights: NDArray[Any], counts: NDArray[np.int64], rounded: bool) -> NDArray[np.float64]:
    """All but the last of the weights (E,) of each row, of so many, as shares of their sum.

    If they are rounded, the last one, which follows from them, is off by no more than the others are.
    """
    ends = np.cumsum(counts)
    sums = np.add.reduceat(weights.astype(np.float64), ends - counts)
    shares = weights / np.repeat(sums, counts)
    if rounded:
        shares = SHARE_STEP * np.diff(np.rint(np.cumsum(shares) / SHARE_STEP), prepend=0.0)
    return np.delete(shares, ends - 1)


def _parts(faces: NDArray[np.int64], clearing: OutfitClearing) -> dict[str, NDArray[Any]]:
    """Closed parts of a body: their rows among its faces (F, 3), their caps, and those that cloth meets."""
    closed, body = clearing.closed, len(clearing.opening.sections["skin.rest"])
    skins, caps = [], []
    for part in closed.parts:
        corners = part.numpy()
        is_skin = (corners < body).all(1)
        skins.append(_rows_of(corners[is_skin], faces, body))
        caps.append(list(dict.fromkeys((corners[~is_skin, 2] - body).tolist())))
    return {
        "parts.met": clearing.met.numpy(),
        "parts.starts": row_starts([len(rows) for rows in skins]),
        "parts.faces": np.concatenate(skins),
        "parts.cap_starts": row_starts([len(few) for few in caps]),
        "parts.caps": np.array([cap for few in caps for cap in few], np.int64),
    }


def _rows_of(some: NDArray[np.int64], faces: NDArray[np.int64], vertices: int) -> NDArray[np.int64]:
    """Row of each of some faces (N, 3) among all faces (F, 3) of so many vertices."""
    keys, wanted = ((each[:, 0] * vertices + each[:, 1]) * vertices + each[:, 2] for each in (faces, some))
    order = np.argsort(keys, kind="stable")
    return order[np.searchsorted(keys, wanted, sorter=order)]
