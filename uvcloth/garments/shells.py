"""Shells around a body from which templates are cut: the same topology on every body.

The tight shell is the body's tight proxy, smoothed by one subdivision. The dress shell is its upper part, cut
at the waist, with a skirt extruded from the waist loop: as wide as the convex outline of hips and legs, never
narrower than the row above.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from rasterize.charts import boundary_loops
from uvcloth.bodies.body import REGIONS, Body
from uvcloth.errors import InputError
from uvcloth.garments.cut import cut, place
from uvcloth.garments.remesh import largest_faces
from uvcloth.geometry.subdivide import loop_subdivision

Array = NDArray[np.float64]

SKIRT_ROWS = 24
"""Rows of vertices from waist to hem."""

ABOVE_KNEE = -0.02
"""Height of the hem of the template's skirt, m, over the knees."""


@dataclass(frozen=True)
class SkirtCut:
    """Shape of a skirt, by default that of the dress template.

    hem: height, m, None for just below the knees. ease: metres that it keeps off the outline of hips and
    legs. flare: A-line, metres that its radius grows per metre of height, at least.
    """

    hem: float | None = None
    ease: float = 0.02
    flare: float = 0.16


TEMPLATE_SKIRT = SkirtCut()


@dataclass(frozen=True)
class Bodice:
    """The tight shell above the waist: the edges of the shell that its vertices lie on, and its waist loop.

    edges: (P, 2) vertices of the tight shell. along: (P,) position on the edge in [0, 1]. faces: (Q, 3) into
    the P vertices. loop: (A,) vertices around the waist, counter-clockwise seen from above.
    """

    edges: NDArray[np.int64]
    along: Array
    faces: NDArray[np.int64]
    loop: NDArray[np.int64]


def tight_shell(body: Body) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (P, 3) m and faces (Q, 3) of the body's tight proxy after one Loop subdivision.

    Raises InputError if the body has no such proxy.
    """
    proxy = body.proxies.get("tights")
    if proxy is None:
        raise InputError(f"body {body.name}: has no garment proxy, templates cannot be tailored to it")
    vertices, faces = loop_subdivision(proxy.vertices.double(), proxy.faces)
    return vertices.numpy(), faces.numpy()


def cut_bodice(body: Body, field: Array) -> Bodice:
    """Bodice where a field (P,) over the tight shell's vertices is positive; its lowest hem is the waist.

    Raises InputError as `tight_shell` does.
    """
    vertices, faces = tight_shell(body)
    edges, along, cut_faces = cut(faces, field)
    placed = place(vertices, edges, along)
    kept, cut_faces = largest_faces(cut_faces)
    placed = placed[kept]
    loop = min(boundary_loops(cut_faces), key=lambda run: float(placed[run][:, 2].mean()))
    around = placed[loop][:, :2] - placed[loop][:, :2].mean(axis=0)
    turning = np.cross(np.c_[around, np.zeros(len(loop))], np.c_[np.roll(around, -1, 0), np.zeros(len(loop))])
    if turning[:, 2].sum() < 0:
        loop = loop[::-1]
    return Bodice(edges[kept], along[kept], cut_faces, loop)


def dress_shell(
    body: Body, bodice: Bodice, skirt: SkirtCut = TEMPLATE_SKIRT
) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (P, 3) m and faces (Q, 3) of bodice and skirt, welded at the waist loop.

    Raises InputError as `tight_shell` and `joint` do.
    """
    top = place(tight_shell(body)[0], bodice.edges, bodice.along)
    waist = top[bodice.loop]
    hem = joint(body, "LeftLeg")[2] + ABOVE_KNEE if skirt.hem is None else skirt.hem
    heights = np.linspace(0.0, 1.0, SKIRT_ROWS + 1)[1:]
    centre = waist[:, :2].mean(axis=0)
    around = waist[:, :2] - centre
    angles = np.arctan2(around[:, 1], around[:, 0])
    radius = np.linalg.norm(around, axis=1)
    rows = []
    for above_share, share in zip(np.r_[0.0, heights[:-1]], heights, strict=True):
        z = waist[:, 2] + (hem - waist[:, 2]) * share
        step = (waist[:, 2].mean() - hem) * (share - above_share)
        radius = np.maximum(
            radius + skirt.flare * step, _outline(body, centre, z.mean(), step, angles) + skirt.ease
        )
        radius = _smooth_around(radius)
        rows.append(
            np.column_stack([centre + radius[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]), z])
        )
    vertices = np.concatenate([top, *rows])
    return vertices, np.concatenate([bodice.faces, _skirt_faces(bodice.loop, len(top))])


def joint(body: Body, name: str) -> Array:
    """Rest position (3,) m of a joint by name; raises InputError if the body's skeleton lacks it."""
    if name not in body.skeleton.names:
        raise InputError(f"body {body.name}: its skeleton has no joint {name}")
    return body.skeleton.heads[body.skeleton.names.index(name)].numpy().astype(np.float64)


def _outline(body: Body, centre: Array, z: float, thickness: float, angles: Array) -> Array:
    """Radius of the convex hull of hips and legs in a slab around height z, in the given directions."""
    inside = [REGIONS.index(r) for r in ("torso", "thigh", "calf")]
    kept = np.isin(body.regions.numpy(), inside)
    points = body.mesh.vertices.numpy()[np.unique(body.mesh.faces.numpy()[kept])]
    slab = points[np.abs(points[:, 2] - z) < max(thickness, 0.03)][:, :2] - centre
    equations = ConvexHull(slab).equations
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    facing = directions @ equations[:, :2].T
    distance = np.where(facing > 1e-9, -equations[:, 2] / np.maximum(facing, 1e-9), np.inf)
    return distance.min(axis=1)


def _smooth_around(radius: Array, passes: int = 4) -> Array:
    smooth = radius
    for _ in range(passes):
        smooth = 0.5 * smooth + 0.25 * (np.roll(smooth, 1) + np.roll(smooth, -1))
    return np.maximum(smooth, radius - 0.004)


def _skirt_faces(loop: NDArray[np.int64], first: int) -> NDArray[np.int64]:
    count = len(loop)
    rings = [loop] + [first + row * count + np.arange(count) for row in range(SKIRT_ROWS)]
    faces = []
    for upper, lower in pairwise(rings):
        a, b, c, d = upper, np.roll(upper, -1), lower, np.roll(lower, -1)
        faces += [np.column_stack([a, c, d]), np.column_stack([a, d, b])]
    return np.concatenate(faces)
