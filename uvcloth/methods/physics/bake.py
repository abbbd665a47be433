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


def baked_sections(
    body: Body,
    garments: Sequence[CagedGarment],
    solver: Solver,
    clearing: OutfitClearing,
    hold: NDArray[np.floating],
) -> dict[str, NDArray[Any]]:
    """The arrays of a baked outfit, by their names in runtime/src/outfit.h.

    solver: of all cages. clearing: of the garments. hold: (n,) 1/s, the attachment of bands.
    """
    settings = solver.settings
    rims = [rim.numpy() for rim in clearing.closed.rims]
    first = len(body.mesh.vertices)
    shown = [
        each.mesh.places.numpy() + start
        for each, start in zip(garments, _starts([len(each.mesh.points) for each in garments]), strict=False)
    ]
    shapes = {} if body.pose_shapes is None else {"outfit.shapes": body.pose_shapes.flatten(1).numpy()}
    return {
        **shapes,
        "outfit.size": np.array([clearing.size]),
        "outfit.used": clearing.used.numpy(),
        "outfit.hold": hold,
        "outfit.shown_starts": _starts([len(each) for each in shown]),
        "outfit.shown": np.concatenate(shown),
        "settings.needed": np.array([max(settings.substeps, 1.0 / (settings.safety * solver.stable_step))]),
        "settings.radius": np.array([settings.radius]),
        "settings.self_radius": np.array([settings.self_radius]),
        "settings.self_margin": np.array([settings.self_margin]),
        "settings.reach": np.array([settings.reach]),
        "settings.interval": np.array([settings.interval]),
        "settings.renewal": np.array([float(settings.renewal)]),
        "settings.hinge_interval": np.array([1.0]),
        "skeleton.parents": np.array(body.skeleton.parents),
        "skeleton.heads": body.skeleton.heads.numpy(),
        "caps.tips": np.arange(first, first + len(rims)),
        "caps.rim_starts": _starts([len(rim) for rim in rims]),
        "caps.rims": np.concatenate([np.zeros((0, 2), np.int64), *rims]),
        **_skin("body", body.mesh.vertices, body.weights),
        **_skin("cages", torch.cat([each.cage.vertices for each in garments]), _weights(garments, True)),
        **_skin("points", torch.cat([each.mesh.points for each in garments]), _weights(garments, False)),
        **_following(garments),
        **clearing.opening.runtime.sections,
        **clearing.fine.sections,
        **solver.cloth.sections(),
        **solver.body.sections(),
    }


def _starts(sizes: Sequence[int]) -> NDArray[np.int64]:
    return np.cumsum([0, *sizes])


def _weights(garments: Sequence[CagedGarment], of_cages: bool) -> Tensor:
    return torch.cat([each.cage_weights if of_cages else each.weights for each in garments])


def _skin(name: str, rest: Tensor, weights: Tensor) -> dict[str, NDArray[Any]]:
    """Vertices (V, 3) m at rest, and those of their weights (V, J) that are not 0."""
    rows, joints = np.nonzero(weights.numpy())
    return {
        f"{name}.rest": rest.numpy(),
        f"{name}.starts": _starts(np.bincount(rows, minlength=len(rest)).tolist()),
        f"{name}.joints": joints,
        f"{name}.weights": weights.numpy()[rows, joints],
    }


def _following(garments: Sequence[CagedGarment]) -> dict[str, NDArray[Any]]:
    """Vertices of all cages around each point of all garments, and their weights."""
    corners, weights, counts = [], [], []
    for each in garments:
        shares = each.cage.own_weights.numpy()
        near = shares != 0.0
        corners.append(each.cage.own_corners.numpy()[near] + each.rows.start)
        weights.append(shares[near])
        counts.extend(near.sum(1).tolist())
    return {
        "follow.starts": _starts(counts),
        "follow.cage": np.concatenate(corners),
        "follow.weights": np.concatenate(weights),
    }
