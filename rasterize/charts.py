"""Cut a surface into charts along its edges: pieces, copies of seam vertices, rims, paths."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from rasterize.errors import InputError


def edges_of(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every face's directed edges (3F, 2), corner 0-1 of all faces first, and the face of each (3F,)."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return directed, np.tile(np.arange(len(faces)), 3)


def edge_keys(edges: np.ndarray, count: int) -> np.ndarray:
    """One integer per undirected edge (E, 2) of a mesh of `count` vertices: (E,) int64."""
    return edges.min(1).astype(np.int64) * count + edges.max(1)


def edge_twins(faces: np.ndarray, cuts: np.ndarray) -> np.ndarray:
    """Pairs (P, 2) of rows of `edges_of` that are one edge in its two faces, except the edges whose keys are
    cut.
    """
    directed, _ = edges_of(faces)
    keys = edge_keys(directed, int(faces.max()) + 1)
    order = np.argsort(keys, kind="stable")
    same = keys[order][1:] == keys[order][:-1]
    twins = np.stack([order[:-1][same], order[1:][same]], axis=1)
    return twins[~np.isin(keys[twins[:, 0]], cuts)]


def face_components(faces: np.ndarray, cuts: np.ndarray) -> np.ndarray:
    """Number the pieces into which the cut edges divide a mesh: (F,) int64."""
    pairs = edge_twins(faces, cuts) % len(faces)
    return _components(pairs, len(faces))


def largest_piece(faces: np.ndarray) -> np.ndarray:
    """Faces of the largest connected piece of a mesh: (n,) int64, ascending."""
    pieces = face_components(faces, np.zeros(0, dtype=np.int64))
    return np.flatnonzero(pieces == np.bincount(pieces).argmax())


def weld_corners(faces: np.ndarray, cuts: np.ndarray) -> np.ndarray:
    """Give each vertex one copy per piece and side of the cuts: faces into the copies (F, 3) int64.

    Two corners share a copy exactly if a chain of faces connects them across edges that are not cut.
    """
    twins = edge_twins(faces, cuts)
    # Edge i of a face runs from its corner i to i + 1, its twin the other way.
    edge, face = np.divmod(twins, len(faces))
    start, stop = face * 3 + edge, face * 3 + (edge + 1) % 3
    welds = np.concatenate([np.stack([start[:, 0], stop[:, 1]], 1), np.stack([stop[:, 0], start[:, 1]], 1)])
    return _components(welds, 3 * len(faces)).reshape(-1, 3)


def _components(pairs: np.ndarray, count: int) -> np.ndarray:
    graph = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def boundary_loops(faces: np.ndarray) -> list[np.ndarray]:
    """The closed boundaries of a mesh, longest first, each with its surface on the left: vertex indices."""
    directed, _ = edges_of(faces)
    keys = edge_keys(directed, int(faces.max()) + 1)
    _, inverse, count = np.unique(keys, return_inverse=True, return_counts=True)
    following = dict(directed[count[inverse] == 1].tolist())
    loops = []
    while following:
        start, current = following.popitem()
        loop = [start]
        while current != start:
            loop.append(current)
            if current not in following:
                raise InputError(f"vertex {current}: the boundary of the surface does not close here")
            current = following.pop(current)
        loops.append(np.array(loop, dtype=np.int64))
    return sorted(loops, key=len, reverse=True)


def cheapest_path(
    faces: np.ndarray, costs: np.ndarray, sources: np.ndarray, targets: np.ndarray, place: str
) -> np.ndarray:
    """Vertices of the cheapest edge path from any source to any target vertex.

    costs: (3F,) per row of `edges_of`. Raises InputError naming `place` if no path exists.
    """
    directed, _ = edges_of(faces)
    count = int(faces.max()) + 1
    _, once = np.unique(edge_keys(directed, count), return_index=True)
    graph = sparse.coo_matrix((costs[once], (directed[once, 0], directed[once, 1])), shape=(count, count))
    distance, previous, _ = dijkstra(
        graph.tocsr(), directed=False, indices=sources, return_predecessors=True, min_only=True
    )
    path = [int(targets[np.argmin(distance[targets])])]
    if not np.isfinite(distance[path[0]]):
        raise InputError(f"{place}: no path over the surface joins its two ends")
    while previous[path[-1]] >= 0:
        path.append(int(previous[path[-1]]))
    return np.array(path[::-1], dtype=np.int64)


def path_edges(path: np.ndarray) -> np.ndarray:
    """The edges (E, 2) along a path of vertices."""
    return np.stack([path[:-1], path[1:]], axis=1)
