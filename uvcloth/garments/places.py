"""Places of a garment that can hold it up: collar, waist, cuffs, and the cloth on the shoulders."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh, boundary_edges, vertex_normals, weld

PLACES = ("top", "collar", "waist", "cuffs", "shoulders")
"""Names of places; top: the uppermost hem of each piece, whatever it lies around."""

BAND_WIDTH = 0.03
"""Metres from a hem that its band reaches."""

COLLAR, WAIST = 0.75, 0.45
"""Heights over the hips, as shares of the trunk up to the shoulders: above the first a hem is a collar,
below the second a waist. A waist is also below the hips by as much.
"""

OFF_AXIS = 0.35
"""Distance of a hem's middle from that of the body, over that of a shoulder, from which it is a cuff."""

LIES_WITHIN = 0.04
"""Metres over the shoulders within which cloth lies on them."""


def places(mesh: Mesh, body: Body) -> Mapping[str, Tensor]:
    """Vertices (N,) bool of each place that a garment at rest on a body has, but for its top.

    A hem belongs to the place that its middle is nearest to. Raises InputError as `Body.head_of` does.
    """
    vertices, count = mesh.vertices, len(mesh.vertices)
    shoulder = body.head_of("left_upper_arm")
    hips, aside = float(body.head_of("hips")[2]), abs(float(shoulder[0]))
    trunk = float(shoulder[2]) - hips
    masks: dict[str, Tensor] = {}
    for hem in hems(boundary_edges(weld(vertices)[mesh.faces])):
        x, _, z = vertices[hem].double().mean(0).tolist()
        share = (z - hips) / trunk
        place = ""
        if abs(x) > OFF_AXIS * aside:
            place = "cuffs" if abs(x) > aside or share < -WAIST else ""
        elif share > COLLAR:
            place = "collar"
        elif abs(share) < WAIST:
            place = "waist"
        if place:
            nothing = torch.zeros(count, dtype=torch.bool)
            masks[place] = masks.get(place, nothing) | hem_band(vertices, vertices[hem], BAND_WIDTH)
    if (over := _on_shoulders(mesh, body, shoulder)).any():
        masks["shoulders"] = over
    return masks


def hem_band(vertices: Tensor, hem: Tensor, width: float) -> Tensor:
    """Mask of the vertices (N, 3) m within `width` metres of points (H, 3) along a hem: (N,) bool."""
    return torch.cdist(vertices, hem).min(dim=1).values < width


def hems(edges: Tensor) -> Sequence[Tensor]:
    """The vertices of each connected run of boundary edges (E, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    used, ends = edges.unique(return_inverse=True)
    start, end = ends.numpy().T
    graph = coo_array((np.ones(len(edges)), (start, end)), shape=(len(used), len(used)))
    run = torch.from_numpy(connected_components(graph, directed=False)[1])
    return [used[run == each] for each in run.unique()]


def _on_shoulders(mesh: Mesh, body: Body, shoulder: np.ndarray) -> Tensor:
    """Mask (N,) of the cloth between neck and upper arms that skin below it, facing upwards, carries."""
    from scipy.spatial import KDTree

    normals = vertex_normals(body.mesh.vertices, body.mesh.faces)
    x, _, z = body.mesh.vertices.T
    carries = (normals[:, 2] > 0.5) & (x.abs() < abs(shoulder[0])) & (x.abs() > OFF_AXIS * abs(shoulder[0]))
    carries &= (z > shoulder[2] - 0.05) & (z < shoulder[2] + 0.15)
    if not carries.any():
        return torch.zeros(len(mesh.vertices), dtype=torch.bool)
    distance, nearest = KDTree(body.mesh.vertices[carries].numpy()).query(mesh.vertices.numpy())
    above = mesh.vertices - body.mesh.vertices[carries][torch.from_numpy(nearest)]
    return torch.from_numpy(distance < LIES_WITHIN) & (above[:, 2] > 0)
