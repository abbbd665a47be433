"""Triangle meshes as plain tensors: normals, edges, adjacency, neighbour averages."""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import torch
from torch import Tensor

# Products with compressed rows are what makes smoothing fast; torch warns of their beta state on every run.
warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")

LEAST_AREA = 1e-9
"""Square metres of the smallest triangle that an engine can lay flat."""


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with texture coordinates that may be cut at seams.

    vertices: (V, 3) metres. faces: (F, 3) int64 into vertices, counter-clockwise seen from outside.
    uvs: (U, 2) in [0, 1]. face_uvs: (F, 3) int64 into uvs (the same corner order as faces).
    """

    vertices: Tensor
    faces: Tensor
    uvs: Tensor
    face_uvs: Tensor


@dataclass(frozen=True)
class JoinedMesh:
    """Meshes one after another as one.

    vertices: (N, 3). faces: (F, 3) into them. starts: first vertex of each mesh. sizes: number of its
    vertices.
    """

    vertices: Tensor
    faces: Tensor
    starts: tuple[int, ...]
    sizes: tuple[int, ...]


def join_meshes(parts: Iterable[tuple[Tensor, Tensor]]) -> JoinedMesh:
    """Join one mesh or more: vertices (n, 3) and faces (f, 3) of each, as in an outfit."""
    vertices, faces = zip(*parts, strict=True)
    sizes = tuple(len(each) for each in vertices)
    starts = tuple(accumulate(sizes[:-1], initial=0))
    shifted = [corners + start for corners, start in zip(faces, starts, strict=True)]
    return JoinedMesh(torch.cat(vertices), torch.cat(shifted), starts, sizes)


def face_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Normals scaled by twice the face area: vertices (..., V, 3), faces (F, 3) -> (..., F, 3)."""
    a, b, c = (vertices[..., faces[:, corner], :] for corner in range(3))
    return torch.linalg.cross(b - a, c - a)


def unit_face_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Unit normals: vertices (..., V, 3), faces (F, 3) -> (..., F, 3)."""
    return torch.nn.functional.normalize(face_normals(vertices, faces), dim=-1)


def flat_faces(vertices: Tensor, faces: Tensor) -> Tensor:
    """Mask (F,) of the faces of vertices (V, 3) m that have no area, which no engine can simulate."""
    return face_normals(vertices, faces).norm(dim=1) < 2.0 * LEAST_AREA


def vertex_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Area-weighted unit vertex normals: (..., V, 3)."""
    per_face = face_normals(vertices, faces)
    normals = torch.zeros_like(vertices)
    for corner in range(3):
        normals = normals.index_add(-2, faces[:, corner], per_face)
    return torch.nn.functional.normalize(normals, dim=-1)


def faces_around(faces: Tensor, count: int) -> Tensor:
    """The faces of each of V = `count` vertices: (V, K) int64, -1 where a vertex has fewer than others."""
    corners = faces.T.reshape(-1)
    order = corners.argsort(stable=True)
    counts = corners.bincount(minlength=count)
    slots = torch.arange(len(corners)) - (counts.cumsum(0) - counts)[corners[order]]
    table = torch.full((count, int(counts.max())), -1)
    table[corners[order], slots] = order % len(faces)
    return table


def unique_edges(faces: Tensor) -> Tensor:
    """The undirected edges of a mesh, each once, lower vertex index first: (E, 2) int64."""
    keys = torch.unique(edge_keys(_directed_edges(faces)))
    return torch.stack([keys >> 32, keys & 0xFFFFFFFF], dim=1)


def edge_lengths(vertices: Tensor, edges: Tensor) -> Tensor:
    """Lengths (..., E) of edges (E, 2) between vertices (..., V, 3)."""
    return (vertices[..., edges[:, 0], :] - vertices[..., edges[:, 1], :]).norm(dim=-1)


def face_pairs(faces: Tensor) -> Tensor:
    """Pairs of faces that share an edge (interior edges of a manifold mesh): (P, 2) int64."""
    return torch.stack(_shared_edges(faces), dim=1) % len(faces)


def hinges(faces: Tensor) -> Tensor:
    """Vertices around the edge that each of `face_pairs` shares: (P, 4) int64.

    In this order: the vertex of the first face opposite the edge, that of the second face, and the two ends
    of the edge in the direction of the first face.
    """
    directed, sides = _directed_edges(faces), _shared_edges(faces)
    opposite = [faces[side % len(faces), (side // len(faces) + 2) % 3] for side in sides]
    return torch.cat([torch.stack(opposite, dim=1), directed[sides[0]]], dim=1)


def boundary_edges(faces: Tensor) -> Tensor:
    """Directed edges (E, 2) that belong to one face only: hems, cuffs, necklines."""
    directed = _directed_edges(faces)
    _, edge, count = torch.unique(edge_keys(directed), return_inverse=True, return_counts=True)
    return directed[count[edge] == 1]


def edge_groups(edges: Tensor, count: int) -> Tensor:
    """Group of each edge (E, 2) among `count` vertices, the same for connected ones: (E,) int64."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(edges)), (edges[:, 0].numpy(), edges[:, 1].numpy())), shape=(count, count))
    return torch.from_numpy(connected_components(graph, directed=False)[1])[edges[:, 0]].long()


def _directed_edges(faces: Tensor) -> Tensor:
    """Every face's edges (3F, 2), corners 0-1 of all faces first."""
    return torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _shared_edges(faces: Tensor) -> tuple[Tensor, Tensor]:
    """The two directed edges of every shared edge, as rows (P,) each of `_directed_edges`."""
    keys, order = edge_keys(_directed_edges(faces)).sort(stable=True)
    shared = torch.nonzero(keys[1:] == keys[:-1]).squeeze(1)
    return order[shared], order[shared + 1]


def edge_keys(edges: Tensor) -> Tensor:
    """One integer per undirected edge (E, 2): (E,). Finding equal ones is much faster than equal rows."""
    return (edges.amin(1) << 32) + edges.amax(1)


def neighbour_average(faces: Tensor, count: int) -> Tensor:
    """Sparse (count, count) matrix whose rows average a vertex's neighbours (uniform weights).

    A vertex without neighbours averages to itself.
    """
    edges = unique_edges(faces)
    rows = torch.cat([edges[:, 0], edges[:, 1]])
    cols = torch.cat([edges[:, 1], edges[:, 0]])
    degree = torch.bincount(rows, minlength=count)
    lonely = torch.nonzero(degree == 0).squeeze(1)
    rows, cols = torch.cat([rows, lonely]), torch.cat([cols, lonely])
    values = 1.0 / degree.clamp(min=1)[rows].to(torch.get_default_dtype())
    matrix = torch.sparse_coo_tensor(
        torch.stack([rows, cols]), values, (count, count), check_invariants=False
    )
    return matrix.coalesce()


def laplacian(faces: Tensor, count: int) -> Tensor:
    """Sparse (count, count) matrix that subtracts from each vertex the mean of its neighbours (uniform
    weights).
    """
    here = torch.arange(count).expand(2, -1)
    identity = torch.sparse_coo_tensor(here, torch.ones(count), (count, count), check_invariants=False)
    return (identity - neighbour_average(faces, count)).coalesce()


@dataclass(frozen=True)
class WeldedMesh:
    """A mesh with its vertices at one place joined.

    kept: (U,) int64, its vertices at different places; places: (N,) int64, the one of these that each vertex
    is at. points: (U, 3) m. faces: (M, 3) int64, into the points.
    """

    kept: Tensor
    places: Tensor
    points: Tensor
    faces: Tensor


def welded(vertices: Tensor, faces: Tensor) -> WeldedMesh:
    """Join the vertices of a mesh (N, 3) m with faces (M, 3) that are at one place."""
    kept, places = weld(vertices).unique(return_inverse=True)
    return WeldedMesh(kept, places, vertices[kept], places[faces])


def weld(vertices: Tensor) -> Tensor:
    """First vertex (or any row) at the place of each, for meshes cut at UV seams: (V,) int64."""
    place = torch.zeros(len(vertices), dtype=torch.int64, device=vertices.device)
    # Column after column: equal numbers are found ten times as fast as equal rows.
    for column in vertices.unbind(1):
        _, value = torch.unique(column, return_inverse=True)
        _, place = torch.unique(place * len(vertices) + value, return_inverse=True)
    return first_of(place)[place]


def first_of(groups: Tensor) -> Tensor:
    """First index of each group: groups (N,) int64, from 0 without gaps -> (G,) int64."""
    order = torch.arange(len(groups), device=groups.device)
    first = torch.full_like(order, len(groups)).scatter_reduce(0, groups, order, "amin")
    return first[first < len(groups)]
