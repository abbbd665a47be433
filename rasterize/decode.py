"""Maps back to points: sparse weights over texels, computed once in rest pose and applied to every frame."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from rasterize.gather import gather
from rasterize.layout import Layout
from rasterize.texels import Texels

ZERO_BARYCENTRIC = 1e-4
"""A barycentric coordinate below this counts as zero: the point lies on an edge or a vertex."""

LAYER_DISTANCE = 0.02
"""Two points whose normals are at right angles count as 1.4 times this many metres farther apart."""

RIDGES = (1e-4, 1e-2)
"""Ridge terms of moving least squares, as shares of the total weight; the second is used where the first
amplifies errors.
"""

MAX_GAIN = 2.0
"""Sum of the absolute weights of a point above which errors in the maps would be amplified too much."""


@dataclass(frozen=True)
class Sampler:
    """Sampling weights: for each of N points, S texels of the sheet and their weights.

    pixels: (N, S) int64 into H * W, all valid texels. weights: (N, S), rows sum to one.
    """

    pixels: Tensor
    weights: Tensor


def decode(maps: Tensor, sampler: Sampler) -> Tensor:
    """Weighted means of texels: maps (..., C, H, W) -> (..., N, C); differentiable, on any device."""
    return gather(maps.flatten(-2).transpose(-1, -2), sampler.pixels, sampler.weights)


def sample_points(
    layout: Layout, texels: Texels, mesh_faces: Tensor, face: Tensor, barycentrics: Tensor
) -> Sampler:
    """Bilinear weights at surface points, from valid texels of their own chart only (PhysXNet section 4.3).

    mesh_faces: (F, 3) int64 of the mesh. face: (N,) int64, kept faces of the mesh. barycentrics: (N, 3).
    A point on an edge or a vertex that the layout cuts is sampled at each of its places on the sheet, all
    places counting the same. Raises ValueError if a face is not on the sheet.
    """
    slot = torch.full((len(mesh_faces),), -1, dtype=torch.int64)
    slot[layout.faces] = torch.arange(len(layout.faces))
    if (slot[face] < 0).any():
        raise ValueError("a point lies on a face that the layout has pruned")
    owner, uvs, islands = _images(layout, mesh_faces, slot, face, barycentrics)
    pixels, weights = _bilinear(texels, uvs, islands)

    # Up to four texels for each place; places of one point go side by side, missing ones weigh nothing.
    place = torch.arange(len(owner)) - torch.searchsorted(owner, owner)
    shape = (len(face), int(place.max()) + 1, 4)
    all_pixels = pixels.new_zeros(shape).index_put((owner, place), pixels).flatten(1)
    all_weights = weights.new_zeros(shape).index_put((owner, place), weights).flatten(1)
    all_pixels = torch.where(all_weights > 0, all_pixels, pixels.new_tensor(int(texels.pixels[0])))
    return Sampler(all_pixels, (all_weights / all_weights.sum(1, keepdim=True)).float())


def _images(
    layout: Layout, mesh_faces: Tensor, slot: Tensor, face: Tensor, barycentrics: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Places of each point on the sheet, several on a cut: owner (P,) ascending, uvs (P, 2), islands (P,)."""
    corner_uvs = layout.uvs.double()[layout.face_uvs]
    face_places = gather(layout.uvs.double(), layout.face_uvs[slot[face]], barycentrics)
    owners, places, islands = [torch.arange(len(face))], [face_places], [layout.islands[slot[face]]]

    kept = mesh_faces[layout.faces]
    on = barycentrics > ZERO_BARYCENTRIC
    # At a vertex: every corner of a kept face there.
    at_vertex = torch.nonzero(on.sum(1) == 1).flatten()
    vertex = mesh_faces[face[at_vertex], barycentrics[at_vertex].argmax(1)]
    order = kept.flatten().argsort(stable=True)
    sorted_vertices = kept.flatten()[order]
    first, last = (torch.searchsorted(sorted_vertices, vertex, right=right) for right in (False, True))
    which, rank = _ranges(first, last)
    corner = order[rank]
    owners.append(at_vertex[which])
    places.append(layout.uvs.double()[layout.face_uvs.flatten()[corner]])
    islands.append(layout.islands[corner // 3])

    # On an edge: every kept face with that edge, opposite the corner that does not count.
    at_edge = torch.nonzero(on.sum(1) == 2).flatten()
    opposite = barycentrics[at_edge].argmin(1)
    start, stop = (mesh_faces[face[at_edge], (opposite + step) % 3] for step in (1, 2))
    starts, stops = (kept[:, [(c + step) % 3 for c in range(3)]].flatten() for step in (1, 2))
    count = len(slot) * 3 + int(mesh_faces.max())
    keys = torch.minimum(starts, stops) * count + torch.maximum(starts, stops)
    order = keys.argsort(stable=True)
    wanted = torch.minimum(start, stop) * count + torch.maximum(start, stop)
    first, last = (torch.searchsorted(keys[order], wanted, right=right) for right in (False, True))
    which, rank = _ranges(first, last)
    slots, corners = order[rank] // 3, order[rank] % 3
    forward = (starts[order[rank]] == start[which])[:, None]
    point = at_edge[which]
    part = barycentrics.double()[point, (opposite[which] + 1) % 3][:, None]
    ends = [corner_uvs[slots, (corners + step) % 3] for step in (1, 2)]
    places.append(
        torch.where(forward, ends[0], ends[1]) * part + torch.where(forward, ends[1], ends[0]) * (1 - part)
    )
    owners.append(point)
    islands.append(layout.islands[slots])

    # Faces that are joined on the sheet agree about the place: count each place once.
    owner, uvs, island = torch.cat(owners), torch.cat(places), torch.cat(islands)
    rounded = (uvs * 1e4).round().long()
    signature = torch.cat([owner[:, None], island[:, None], rounded], dim=1)
    pick = torch.from_numpy(np.unique(signature.numpy(), axis=0, return_index=True)[1])
    return owner[pick], uvs[pick], island[pick]


def _ranges(first: Tensor, last: Tensor) -> tuple[Tensor, Tensor]:
    """Write out the ranges first..last: the range of each index, and the index."""
    which = torch.arange(len(first)).repeat_interleave(last - first)
    begin = (last - first).cumsum(0) - (last - first)
    return which, torch.arange(len(which)) - begin[which] + first[which]


def _bilinear(texels: Texels, uvs: Tensor, islands: Tensor) -> tuple[Tensor, Tensor]:
    """The four texels around each place (P, 4) and weights (P, 4), zero off the chart.

    A place with no texel of its chart around it takes the chart's nearest, or that of any if it has none.
    """
    from scipy.spatial import cKDTree

    chart = torch.full((texels.height * texels.width,), -1, dtype=torch.int64)
    chart[texels.pixels] = texels.islands
    x = uvs[:, 0] * texels.width - 0.5
    y = (1 - uvs[:, 1]) * texels.height - 0.5
    left, top = x.floor(), y.floor()
    offsets = torch.tensor([[0, 0], [1, 0], [0, 1], [1, 1]])
    column = left[:, None].long() + offsets[:, 0]
    row = top[:, None].long() + offsets[:, 1]
    across = torch.where(offsets[:, 0] == 1, (x - left)[:, None], 1 - (x - left)[:, None])
    down = torch.where(offsets[:, 1] == 1, (y - top)[:, None], 1 - (y - top)[:, None])
    on_sheet = (column >= 0) & (column < texels.width) & (row >= 0) & (row < texels.height)
    pixels = torch.where(on_sheet, row * texels.width + column, 0)
    weights = torch.where(on_sheet & (chart[pixels] == islands[:, None]), across * down, 0.0)

    bare = torch.nonzero(weights.sum(1) < 1e-3).flatten()
    for island in sorted(set(islands[bare].tolist())):
        lost = bare[islands[bare] == island]
        island_texels = torch.nonzero(texels.islands == island).flatten()
        members = island_texels if len(island_texels) else torch.arange(len(texels))
        _, nearest = cKDTree(texels.uvs[members].numpy()).query(uvs[lost].numpy())
        pixels[lost] = texels.pixels[members[torch.from_numpy(nearest)]][:, None]
        weights[lost] = 0.25
    return pixels, weights / weights.sum(1, keepdim=True)


def nearest_sampler(
    points_at_texels: Tensor,
    texels: Texels,
    queries: Tensor,
    k: int = 10,
    normals: tuple[Tensor, Tensor] | None = None,
) -> Sampler:
    """Weights over the k texels whose points in rest pose lie nearest to each query.

    points_at_texels: (M, 3) metres, not finite where a ray missed. queries: (N, 3).
    normals: of the M points and the N queries; points that face the other way are then avoided, so that one
    layer of cloth does not take its values from another.
    The weights are moving least squares of the first order: wherever the texels surround the query, they
    reproduce every linear field almost exactly; where they do not, a ridge bounds the weights.
    """
    from scipy.spatial import cKDTree

    usable = torch.nonzero(torch.isfinite(points_at_texels).all(1)).flatten()
    points = points_at_texels[usable].double()
    query = queries.double()
    if normals is None:
        keys, query_keys = points, query
    else:
        keys = torch.cat([points, normals[0][usable].double() * LAYER_DISTANCE], dim=1)
        query_keys = torch.cat([query, normals[1].double() * LAYER_DISTANCE], dim=1)
    _, neighbours = cKDTree(keys.numpy()).query(query_keys.numpy(), k=k)
    nearest = torch.from_numpy(neighbours)

    offset = points[nearest] - query[:, None]
    reach = offset.norm(dim=2).amax(1).clamp(min=1e-6)[:, None]
    offset = offset / reach[..., None]
    closeness = (1 - offset.norm(dim=2) / 1.1).clamp(min=0) ** 2 + 1e-6
    basis = torch.cat([torch.ones_like(offset[..., :1]), offset], dim=2)
    moments = torch.einsum("nk,nki,nkj->nij", closeness, basis, basis)
    slopes = torch.diag(torch.tensor([0.0, 1.0, 1.0, 1.0], dtype=torch.float64))
    unit = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64).expand(len(query), 4)
    weights = torch.full_like(closeness, torch.inf)
    for ridge in RIDGES:
        coefficients = torch.linalg.solve(moments + ridge * slopes * moments[:, :1, :1], unit)
        bounded = closeness * torch.einsum("nki,ni->nk", basis, coefficients)
        bounded = bounded / bounded.sum(1, keepdim=True)
        weights = torch.where(weights.abs().sum(1, keepdim=True) > MAX_GAIN, bounded, weights)
    return Sampler(texels.pixels[usable[nearest]], weights.float())
