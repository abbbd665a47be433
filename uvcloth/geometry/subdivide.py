"""Subdivision of triangle meshes until no edge is long; the original vertices stay first."""

import math

import torch
from torch import Tensor

from uvcloth.geometry.mesh import Mesh, edge_lengths

MOST_ROUNDS = 8
"""Times that an edge is halved at most."""

PATTERNS = (
    torch.tensor([[0, 1, 2]]),
    torch.tensor([[0, 3, 2], [3, 1, 2]]),
    torch.tensor([[3, 1, 4], [0, 3, 4], [0, 4, 2]]),
    torch.tensor([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]),
)
"""Triangles of a face by the number of its halved edges: 0 to 2 are its corners, 3 to 5 the middles of the
edges after them. One halved edge is the first, two are the first two.
"""


def subdivide(mesh: Mesh, longest: float) -> Mesh:
    """Halve edges longer than `longest`, m, until there is none (at most MOST_ROUNDS times).

    Faces stay joined, and so do vertices at one place (UV seams). New vertices follow those of the mesh.
    """
    for _ in range(MOST_ROUNDS):
        around = mesh.faces.roll(-1, 1)
        long = edge_lengths(mesh.vertices, torch.stack([mesh.faces, around], dim=2).reshape(-1, 2)) > longest
        if not bool(long.any()):
            break
        split = long.reshape(-1, 3)
        turn = (_first_split(split)[:, None] + torch.arange(3)) % 3
        vertices, faces = _halved(mesh.vertices, mesh.faces, split, turn)
        uvs, face_uvs = mesh.uvs, mesh.face_uvs
        if len(uvs):
            uvs, face_uvs = _halved(uvs, face_uvs, split, turn)
        mesh = Mesh(vertices, faces, uvs, face_uvs)
    return mesh


def halve_edges(points: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """Halve every edge once: points (P, D) and faces (F, 3) -> (P + E, D), the middles last, and (4 F, 3)."""
    return _halved(points, faces, torch.ones_like(faces, dtype=torch.bool), torch.arange(3).expand_as(faces))


def loop_subdivision(points: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """One step of Loop's subdivision (1987): points (P, 3), faces (F, 3) -> (P + E, 3), (4 F, 3).

    Every edge gets a vertex, after the old ones; an edge has one face or two.
    """
    matrix, split = loop_matrix(faces, len(points))
    return matrix.to(points) @ points, split


def loop_matrix(faces: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """`loop_subdivision` of faces (F, 3) as a product, for all poses of P points.

    Returns the sparse matrix (P + E, P), float64, and the faces (4 F, 3).
    """
    ends = torch.stack([faces, faces.roll(-1, 1)], dim=2).reshape(-1, 2).sort(dim=1).values
    # By their higher vertex first, as trimesh has them: models that ship know templates in this order.
    keys, edge_of = torch.unique(ends[:, 1] * count + ends[:, 0], return_inverse=True)
    edges = torch.stack([keys % count, keys // count], dim=1)
    inner = torch.bincount(edge_of) == 2
    opposite, inside = faces.roll(1, 1).flatten(), inner[edge_of]
    rim = torch.zeros(count, dtype=torch.bool)
    rim[edges[~inner]] = True
    valence = torch.bincount(edges.flatten(), minlength=count).double()
    turn = 2.0 * math.pi / valence.clamp(min=1)
    share = (40.0 - (2.0 * turn.cos() + 3.0) ** 2) / (64.0 * valence.clamp(min=1))
    share[rim] = 0.125
    # A vertex on the rim follows those beside it on the rim alone, also where a face has two edges there.
    follows, along_rim = torch.cat([edges, edges.flip(1)]), torch.cat([~inner, ~inner])
    follows = follows[~rim[follows[:, 0]] | along_rim]
    corners, middles = torch.arange(count), count + torch.arange(len(edges))
    near = torch.where(inner, 0.375, 0.5).double()
    far = torch.full((int(inside.sum()),), 0.125, dtype=torch.float64)
    kept = torch.where(rim, 0.75, 1.0 - valence * share)
    rows = torch.cat([middles, middles, count + edge_of[inside], follows[:, 0], corners])
    columns = torch.cat([edges[:, 0], edges[:, 1], opposite[inside], follows[:, 1], corners])
    values = torch.cat([near, near, far, share[follows[:, 0]], kept])
    shape = (count + len(edges), count)
    matrix = torch.sparse_coo_tensor(torch.stack([rows, columns]), values, shape, check_invariants=False)
    a, b, c = faces.unbind(1)
    ab, bc, ca = (count + edge_of.view(-1, 3)).unbind(1)
    split = torch.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], dim=1).view(-1, 3)
    return matrix.coalesce().to_sparse_csr(), split


def _first_split(split: Tensor) -> Tensor:
    """Edge (F,) of each face from which on its halved edges (F, 3) bool follow one another."""
    after_whole = split & ~split.roll(1, 1)
    return after_whole.int().argmax(1)


def _halved(points: Tensor, faces: Tensor, split: Tensor, turn: Tensor) -> tuple[Tensor, Tensor]:
    """Points (P, D) and faces (F, 3) with split edges (F, 3) halved; turn: (F, 3), order of the corners."""
    edges = torch.stack([faces, faces.roll(-1, 1)], dim=2)
    ends, place = torch.unique(edges[split].sort(dim=1).values, dim=0, return_inverse=True)
    middles = torch.full_like(faces, -1)
    middles[split] = len(points) + place
    six = torch.cat([faces.gather(1, turn), middles.gather(1, turn)], dim=1)
    count = split.sum(1)
    parts = [six[count == halves][:, pattern].reshape(-1, 3) for halves, pattern in enumerate(PATTERNS)]
    return torch.cat([points, points[ends].mean(1)]), torch.cat(parts)
