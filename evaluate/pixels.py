"""Faults in pixels: skin and cloth that a viewer sees through cloth, from four sides.

Level views along the axes of the world, drawn by ray casting with Embree and without perspective. A pixel is
at fault if what it sees has, just behind it, the outer side of a garment that has to hide it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh, face_normals, join_meshes

from .metrics import sampled_frames

SIDES = ((1, 1), (0, 1), (1, -1), (0, -1))
"""Axis and sign of the directions in which the views look."""

PIXEL = 0.008
"""Width of a pixel, m: a person of 1.7 m is 210 pixels high."""

VIEWED_FRAMES = 5
"""Most frames of a window that are drawn, evenly spaced: a picture is slow."""

DEPTH = 0.03
"""Metres behind what a pixel sees within which the cloth that has to hide it is found."""

START = 1e-5
"""Metres behind a hit at which the next ray starts."""

BARE, SKIN = -1, 0
"""Kinds of faces: skin that no garment covers at rest, and skin that one does. Garments are 1, 2, ..."""


@dataclass(frozen=True)
class Sight:
    """A body and its garments prepared for pictures.

    faces: (F, 3) of the body, then of its garments, the innermost first. kinds: (F,) int64 of faces.
    """

    faces: Tensor
    kinds: NDArray[np.int64]


def make_sight(body: Body, meshes: Sequence[Mesh], covered: Tensor) -> Sight:
    """Prepare garments on a body, the innermost first. covered: (F,) mask of the body's faces under them."""
    joined = join_meshes([(each.vertices, each.faces) for each in (body.mesh, *meshes)])
    kinds = [
        torch.where(covered, SKIN, BARE),
        *(torch.full((len(mesh.faces),), k) for k, mesh in enumerate(meshes, 1)),
    ]
    return Sight(joined.faces, torch.cat(kinds).numpy())


def pixel_scores(sight: Sight, garments: Tensor, body: Tensor) -> dict[str, Tensor]:
    """Percent of the pixels of garments (F, N, 3) m on the posed body (F, V, 3) m that are at fault.

    skin_pixels_percent: that show skin. cloth_pixels_percent: that show an inner garment, or the inner side
    of a garment, through its outer side. (S,) each, in at most VIEWED_FRAMES frames.
    """
    frames = sampled_frames(len(garments), VIEWED_FRAMES)
    shares = [_shares(sight, torch.cat([body[frame], garments[frame]]), len(body[0])) for frame in frames]
    skin, cloth = torch.tensor(shares).reshape(-1, 2).unbind(1)
    return {"skin_pixels_percent": skin, "cloth_pixels_percent": cloth}


def _shares(sight: Sight, vertices: Tensor, skin: int) -> tuple[float, float]:
    """Percent of the pixels of one frame that show skin, and cloth. skin: number of vertices of the body."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    points = vertices.float().numpy()
    normals = face_normals(vertices, sight.faces).numpy()
    embree = EmbreeScene()
    TriangleMesh(embree, points, sight.faces.int().numpy())
    origins, directions = rays(points[skin:].min(0), points[skin:].max(0), points.min(0), points.max(0))
    rows, places, first, first_outer = _hits(sight, embree, normals, origins, directions)
    behind, _, hidden, hidden_outer = _hits(
        sight, embree, normals, places + START * directions[rows], directions[rows], DEPTH
    )
    outer = np.zeros(len(rows), np.int64)
    outer[behind] = np.where(hidden_outer, hidden, 0)
    # A garment hides what is under it, and its own inner side.
    fault = (first >= SKIN) & ((outer > first) | ((outer == first) & ~first_outer & (first > SKIN)))
    of_skin, of_cloth = fault & (first == SKIN), fault & (first > SKIN)
    whole = max(1, int((of_skin | (first > SKIN)).sum()))
    return 100.0 * of_skin.sum() / whole, 100.0 * of_cloth.sum() / whole


def _hits(
    sight: Sight,
    embree: Any,
    normals: NDArray[Any],
    origins: NDArray[Any],
    directions: NDArray[Any],
    reach: float = np.inf,
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Rays (H,) that meet a face within reach, m: places (H, 3), kinds (H,), True where on the outer side."""
    hits = embree.run(origins, directions, output=True)
    rows = np.nonzero((hits["primID"] >= 0) & (hits["tfar"] <= reach))[0]
    faces, distances = hits["primID"][rows], hits["tfar"][rows, None]
    outer = (normals[faces] * directions[rows]).sum(1) < 0.0
    return rows, origins[rows] + distances * directions[rows], sight.kinds[faces], outer


def rays(
    low: NDArray[Any], high: NDArray[Any], lowest: NDArray[Any], highest: NDArray[Any]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Origins and directions (R, 3) of the pixels of all views, m.

    low, high: corners of the box that is drawn. lowest, highest: of the box of all that may hide it.
    """
    origins, directions = [], []
    for axis, sign in SIDES:
        across = 1 - axis
        grid = np.stack(
            np.meshgrid(*(np.arange(low[k] + PIXEL / 2, high[k], PIXEL) for k in (across, 2))), axis=-1
        ).reshape(-1, 2)
        start = np.zeros((len(grid), 3), np.float32)
        start[:, [across, 2]] = grid
        start[:, axis] = lowest[axis] - PIXEL if sign > 0 else highest[axis] + PIXEL
        direction = np.zeros(3, np.float32)
        direction[axis] = sign
        origins.append(start)
        directions.append(np.tile(direction, (len(grid), 1)))
    return np.concatenate(origins), np.concatenate(directions)
