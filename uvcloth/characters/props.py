"""Props of a character: bags, armour plates and the like in the meshes that cloth lies on.

Skin wraps the bones, whatever is worn over it: rays in all directions leave from points on them. The
connected pieces of the meshes are taken in the order in which most rays meet them first, and a piece is skin
if it meets rays that no piece before it meets. A piece that wraps a bone by itself, such as a vest over the
skin, is kept as skin, for cloth lies on it. Any other piece stays visible and moves by its blend weights, but
the body's surface is not fitted to it.
"""

from collections.abc import Iterable
from dataclasses import replace

import torch
from torch import Tensor

from rasterize.raycast import cast_rays
from uvcloth.characters.reader import Part
from uvcloth.geometry.mesh import Mesh, edge_groups, face_normals, join_meshes, weld
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.rendering.lighting import sphere

ALONG = (0.0, 0.25, 0.5, 0.75)
"""Points on each bone, as shares of its length, that rays leave from."""

DIRECTIONS = 96
"""Rays from each point."""

LEAST_SEEN = 0.1
"""Least share of a point's rays that meet a piece of skin, and none before it."""

WRAPS = 0.6
"""Least share of the rays that meet a piece that wraps a bone by itself, at as many points as a bone has."""

SMALL = 0.01
"""Share of the area below which a piece that hardly any ray meets first is a prop."""


def split_props(parts: Iterable[Part], skeleton: Skeleton) -> tuple[tuple[Part, ...], tuple[Part, ...]]:
    """Split parts into what wraps the bones of a skeleton and what is worn over that.

    Parts and skeleton are in the same pose. A part with both is in both results, with the faces of either.
    """
    parts = tuple(parts)
    joined = join_meshes((part.mesh.vertices, part.mesh.faces) for part in parts)
    corners = weld(joined.vertices)[joined.faces]
    piece = edge_groups(torch.cat([corners[:, :2], corners[:, 1:]]), len(joined.vertices))[: len(corners)]
    pieces, piece = piece.unique(return_inverse=True)
    wraps = _wrapping(joined.vertices, joined.faces, piece, len(pieces), _bone_points(skeleton))
    is_skin = wraps[piece].split([len(part.mesh.faces) for part in parts])
    skin = [_with_faces(part, mask) for part, mask in zip(parts, is_skin, strict=True) if mask.any()]
    props = [_with_faces(part, ~mask) for part, mask in zip(parts, is_skin, strict=True) if not mask.all()]
    return (tuple(skin), tuple(props)) if skin else (parts, ())


def _bone_points(skeleton: Skeleton) -> Tensor:
    """Points (P, 3) along the bones, and as far beyond each joint that ends one."""
    heads, parents = skeleton.heads, torch.tensor(skeleton.parents)
    below = torch.nonzero(parents >= 0).squeeze(1)
    starts, ends = heads[parents[below]], heads[below]
    last = torch.tensor([joint not in skeleton.parents for joint in below.tolist()])
    starts = torch.cat([starts, ends[last]])
    ends = torch.cat([ends, 2.0 * ends[last] - starts[: len(below)][last]])
    return torch.cat([torch.lerp(starts, ends, share) for share in ALONG])


def _wrapping(vertices: Tensor, faces: Tensor, piece: Tensor, pieces: int, points: Tensor) -> Tensor:
    """Mask (pieces,) of those that are skin, given the piece of each face (F,) and points (P, 3) on bones."""
    directions = torch.from_numpy(sphere(DIRECTIONS)).to(points).repeat(len(points), 1)
    origins = points.repeat_interleave(DIRECTIONS, 0)

    def met(of: Tensor) -> Tensor:
        hits = cast_rays(origins, directions, vertices, faces[of], max_distance=torch.inf, both_ways=False)
        return hits.face

    first = met(torch.ones(len(faces), dtype=torch.bool))
    counts = torch.zeros(pieces, len(points))
    point = torch.arange(len(points)).repeat_interleave(DIRECTIONS)[first >= 0]
    counts.index_put_((piece[first[first >= 0]], point), torch.ones(len(point)), accumulate=True)
    area = torch.zeros(pieces).index_add(0, piece, face_normals(vertices, faces).norm(dim=1))
    likely = (counts.amax(1) >= LEAST_SEEN * DIRECTIONS) | (area >= SMALL * area.sum())
    near = torch.nonzero(likely).squeeze(1)
    covered = torch.zeros(len(points), DIRECTIONS, dtype=torch.bool)
    skin = torch.zeros(pieces, dtype=torch.bool)
    for each in near[counts[near].sum(1).argsort(descending=True)].tolist():
        meets = (met(piece == each) >= 0).unflatten(0, (len(points), DIRECTIONS))
        added, whole = (rays.float().mean(1) for rays in (meets & ~covered, meets))
        skin[each] = float(added.max()) >= LEAST_SEEN or int((whole >= WRAPS).sum()) >= len(ALONG)
        covered |= meets & skin[each]
    return skin


def _with_faces(part: Part, mask: Tensor) -> Part:
    """A part with some of its faces (F,) bool, and only their vertices."""
    used, faces = part.mesh.faces[mask].unique(return_inverse=True)
    mesh = Mesh(part.mesh.vertices[used], faces, part.mesh.uvs, part.mesh.face_uvs[mask])
    return replace(part, mesh=mesh, weights=part.weights[used])
