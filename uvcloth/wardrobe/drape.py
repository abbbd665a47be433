"""Drape of loose cloth: below the widest place around trunk or leg it falls straight, off the skin."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, map_coordinates

from uvcloth.bodies.body import Body
from uvcloth.garments.openings import forearm_share, upper_arm_share
from uvcloth.garments.shells import joint
from uvcloth.wardrobe.designs import Design
from uvcloth.wardrobe.patterns import ARM_BEGINS

Array = NDArray[np.float64]

DIRECTIONS, LEVELS = 32, 28
"""Directions around a column, and heights along it, at which its radius is sampled."""

SMOOTHING = 1.2
"""Standard deviation, in directions and levels, by which the radius of the drape is smoothed."""

BEGINNING = 0.06
"""Metres below the top of a column within which cloth begins to fall."""

MID_THIGH = 0.45
"""Height between knee and hip from which on trousers fall."""

TIGHT, LOOSE = 0.01, 0.035
"""Metres of ease at which cloth follows the skin, and at which it falls straight."""


@dataclass(frozen=True)
class Column:
    """Cloth around a trunk or a leg.

    rows: (K,) int64 vertices. centre: (K, 2) m, the axis at their heights. top: height, m, from which on it
    falls. looseness: 0 along the skin to 1 straight down.
    """

    rows: NDArray[np.int64]
    centre: Array
    top: float
    looseness: float


def drape(design: Design, body: Body, vertices: Array, off: Array, room: Array) -> Array:
    """Vertices (N, 3) m of a tight piece moved outwards to where loose cloth falls, `off` metres (N,) off it.

    room: (N,) m that a vertex moves at most.
    """
    draped = vertices.copy()
    for column in _columns(design, body, vertices):
        if column.looseness > 0 and len(column.rows):
            rows = column.rows
            draped[rows] = _fallen(vertices[rows], off[rows], room[rows], column)
    return draped


def _columns(design: Design, body: Body, vertices: Array) -> list[Column]:
    columns = []
    z = vertices[:, 2]
    if design.upper is not None and not (design.legs or design.skirt):
        top = float(joint(body, "Spine1")[2])
        arms = (upper_arm_share(body, vertices) > ARM_BEGINS) | (forearm_share(body, vertices) > -0.5)
        rows = np.flatnonzero(~arms & (z < top))
        centre = np.tile([0.0, joint(body, "LowerBack")[1] - 0.03], (len(rows), 1))
        loose = (design.upper.ease + design.upper.flare - TIGHT) / (LOOSE - TIGHT)
        columns.append(Column(rows, centre, top, float(np.clip(loose, 0, 1))))
    if design.legs is not None:
        for side, sign in (("Left", 1.0), ("Right", -1.0)):
            knee, foot = joint(body, f"{side}Leg"), joint(body, f"{side}Foot")
            top = float(knee[2] + MID_THIGH * (joint(body, f"{side}UpLeg")[2] - knee[2]))
            rows = np.flatnonzero((z < top) & (vertices[:, 0] * sign > 0))
            share = (z[rows] - knee[2]) / (foot[2] - knee[2])
            centre = knee[:2] + share[:, None] * (foot - knee)[:2]
            loose = (design.legs.ease + design.legs.flare - TIGHT) / (LOOSE - TIGHT)
            columns.append(Column(rows, centre, top, float(np.clip(loose, 0, 1))))
    return columns


def _fallen(points: Array, off: Array, room: Array, column: Column) -> Array:
    """Points (K, 3) m moved away from the axis, to the widest place above them as far as they are loose."""
    around = points[:, :2] - column.centre
    radius = np.linalg.norm(around, axis=1)
    angle = (np.arctan2(around[:, 1], around[:, 0]) / (2 * np.pi) % 1.0) * DIRECTIONS
    drop = column.top - points[:, 2]
    level = drop / max(float(drop.max()), 1e-6) * (LEVELS - 1)
    wanted = radius + off
    places = np.array([angle, level])
    grid = _grid(places, wanted)
    straight = np.maximum.accumulate(grid, axis=1)
    straight = gaussian_filter1d(straight, SMOOTHING, axis=0, mode="wrap")
    straight = gaussian_filter1d(straight, SMOOTHING, axis=1, mode="nearest")
    falls = map_coordinates(straight, places, order=1, mode="grid-wrap")
    target = wanted + column.looseness * np.maximum(falls - wanted, 0)
    move = np.minimum(target - radius, room) * np.clip(drop / BEGINNING, 0, 1)
    outward = around / np.maximum(radius, 1e-9)[:, None]
    return np.column_stack([points[:, :2] + move[:, None] * outward, points[:, 2]])


def _grid(places: Array, values: Array) -> Array:
    """Values (K,) at places (2, K) on the grid of directions and levels, by the nearest one."""
    from scipy.spatial import KDTree

    directions, levels = np.meshgrid(np.arange(DIRECTIONS), np.arange(LEVELS), indexing="ij")
    asked = np.column_stack([directions.ravel(), levels.ravel()]).astype(float)
    turn = np.array([DIRECTIONS, 0.0])
    copies = np.concatenate([places.T - turn, places.T, places.T + turn])
    _, nearest = KDTree(copies).query(asked)
    return values[nearest % len(values)].reshape(DIRECTIONS, LEVELS)
