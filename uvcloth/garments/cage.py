"""Cages: coarse meshes of garments, on which cloth is solved in real time and which carry the fine mesh.

A cage is the dual of a Voronoi diagram on the garment's surface, whose seeds are first drawn with a least
distance and then moved to the centres of their cells. Distances are measured along the surface, so that
touching layers do not mix, and relative to the edge length that is wanted there.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree
from torch import Tensor

from rasterize.charts import face_components
from rasterize.gather import gather
from uvcloth.geometry.closest import closest_barycentrics
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.mesh import (
    Mesh,
    boundary_edges,
    edge_lengths,
    face_normals,
    neighbour_average,
    unique_edges,
    vertex_normals,
    weld,
)
from uvcloth.geometry.subdivide import subdivide

QUALITIES = {"fast": 0.057, "default": 0.040, "fine": 0.030}
"""Edge length, m, of a cage."""

AROUND = 10
"""Edges that are wanted around a hem, a cuff or a collar, as far as FINEST allows."""

FINEST = 0.6
"""Shortest edges that a hem can ask for, as a share of the edge length: the shortest limit the time step."""

GROWTH = 0.25
"""Metres that edges grow for each metre from a narrow hem."""

SAMPLES = 0.4
"""Edge length of the surface on which cells are made, over that of the cage."""

APART = 0.8
"""Least distance of seeds when they are drawn, in edge lengths."""

RELAXATIONS = 20
"""Times that seeds are moved to the centres of their cells."""

SMOOTHINGS = 3
"""Times that vertices are moved to the middle of the faces around them: no face is narrow then."""

BLEND = 0.35
"""Steps of averaging in which the cage's faces blend into each other on a garment whose edges are as long as
the cage's; more on a finer one, so that they blend over 0.4 edges of the cage: flat faces would show."""

LEAST_SHARE = 0.01
"""Weight of a cage vertex on a garment vertex below which it is left out."""

TRIM_SHARE = 0.02
"""Share of a garment's area below which a separate piece, a button, follows the cloth around it."""

FEWEST = 60
"""Least number of vertices of a cage, about: a strap gets smaller faces than a coat."""

KEPT = 32
"""Cages that stay in memory: the same garment is prepared again for each clip, fabric and view."""

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Cage:
    """Coarse mesh of a garment, and where the vertices of each lie in the other.

    vertices: (n, 3) m at rest. faces: (m, 3). corners, weights: (n, 3) the garment's vertices around each
    cage vertex, and their barycentrics. own_corners, own_weights: (N, K) the cage's vertices around each
    garment vertex, and their weights.
    """

    vertices: Tensor
    faces: Tensor
    corners: Tensor
    weights: Tensor
    own_corners: Tensor
    own_weights: Tensor

    def at_cage(self, values: Tensor) -> Tensor:
        """Values (..., n, C) at the cage's vertices from values at the garment's (..., N, C)."""
        return gather(values, self.corners, self.weights)

    def at_garment(self, values: Tensor) -> Tensor:
        """Values (..., N, C) at the garment's vertices from values at the cage's (..., n, C)."""
        return gather(values, self.own_corners, self.own_weights)


_KEPT: dict[str, Cage] = {}


def kept_cage(vertices: Tensor, faces: Tensor, edge: float) -> Cage:
    """`make_cage`, or its result for the same garment, if that is one of the last KEPT."""
    key = fingerprint(vertices, faces, f"{edge}")
    cage = _KEPT.pop(key, None) or make_cage(vertices, faces, edge)
    _KEPT[key] = cage
    while len(_KEPT) > KEPT:
        del _KEPT[next(iter(_KEPT))]
    return cage


def make_cage(vertices: Tensor, faces: Tensor, edge: float) -> Cage:
    """Make the cage of a garment at rest, (N, 3) m and (M, 3), with edges of a length, m.

    Near narrow hems edges are shorter. Small separate pieces have none of their own. The same garment gives
    the same cage.
    """
    faces = weld(vertices)[faces]
    kept = faces[_without_trim(vertices, faces)]
    used, corners = kept.unique(return_inverse=True)
    surface = _Surface.of(vertices[used].double(), corners, edge)
    cells, seeds = _cells(surface)
    triangles = cells[surface.faces]
    triangles = triangles[(triangles != np.roll(triangles, 1, 1)).all(1)]
    _, once = np.unique(np.sort(triangles, 1), axis=0, return_index=True)
    places, dual = np.unique(triangles[np.sort(once)], return_inverse=True)
    dual = dual.reshape(-1, 3)
    points = surface.centred(cells, seeds)[places]
    renumbered = np.full(len(seeds), -1)
    renumbered[places] = np.arange(len(places))
    near = np.full(len(vertices), -1)
    near[used.numpy()] = renumbered[cells[: len(used)]]
    points, around, shares = _smoothed(points, dual, vertices[used].double().numpy(), corners.numpy())
    embedded = _embedded(vertices.double().numpy(), near, points, dual)
    own_corners, own_weights = _blended(*embedded, vertices, faces, points, dual)
    return Cage(
        torch.from_numpy(points).float(),
        torch.from_numpy(dual),
        used[torch.from_numpy(around)],
        torch.from_numpy(shares).float(),
        torch.from_numpy(own_corners),
        torch.from_numpy(own_weights).float(),
    )


def _without_trim(vertices: Tensor, faces: Tensor) -> Tensor:
    """Mask (M,) of the faces of pieces that are cloth, not buttons."""
    pieces = torch.from_numpy(face_components(faces.numpy(), np.zeros(0, np.int64)))
    areas = torch.zeros(int(pieces.max()) + 1).index_add_(
        0, pieces, face_normals(vertices, faces).norm(dim=1)
    )
    return (areas > TRIM_SHARE * areas.sum())[pieces]


@dataclass(frozen=True)
class _Surface:
    """Surface of P vertices, finer than its cage.

    points, normals: (P, 3). faces: (Q, 3). lengths: (P,) m, the edge length that is wanted. area: (P,) m2.
    graph: of its edges, in wanted lengths; hems: of those along hems alone. on_hem: (P,) bool.
    """

    points: Floats
    normals: Floats
    faces: Indices
    lengths: Floats
    area: Floats
    graph: csr_array
    hems: csr_array
    on_hem: NDArray[np.bool_]

    @classmethod
    def of(cls, vertices: Tensor, faces: Tensor, edge: float) -> "_Surface":
        none = torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64)
        mesh = subdivide(Mesh(vertices, faces, *none), SAMPLES * FINEST**0.5 * edge)
        edges, rims = unique_edges(mesh.faces), boundary_edges(mesh.faces)
        lengths = _wanted(mesh, edges, rims, edge)
        doubled = face_normals(mesh.vertices, mesh.faces).norm(dim=1)
        area = torch.zeros(len(mesh.vertices)).double()
        area.index_add_(0, mesh.faces.flatten(), (doubled / 6.0).repeat_interleave(3))
        on_hem = np.zeros(len(lengths), bool)
        on_hem[rims.flatten().numpy()] = True
        return cls(
            mesh.vertices.numpy(),
            vertex_normals(mesh.vertices, mesh.faces).numpy(),
            mesh.faces.numpy(),
            lengths,
            area.numpy(),
            _graph(mesh.vertices, edges, lengths),
            _graph(mesh.vertices, rims, lengths),
            on_hem,
        )

    def centred(self, cells: Indices, seeds: Indices) -> Floats:
        """Seeds (S, 3) m moved along the surface to the centres of their cells; those on hems stay."""
        moves = _centres(self, cells, len(seeds)) - self.points[seeds]
        normals = self.normals[seeds]
        moves -= (moves * normals).sum(1, keepdims=True) * normals
        return self.points[seeds] + np.where(self.on_hem[seeds, None], 0.0, moves)


def _wanted(mesh: Mesh, edges: Tensor, rims: Tensor, edge: float) -> Floats:
    """Edge length (P,) m that is wanted at each vertex."""
    area = 0.5 * float(face_normals(mesh.vertices, mesh.faces).norm(dim=1).sum())
    edge = min(edge, (area / (0.866 * FEWEST)) ** 0.5)
    count = len(mesh.vertices)
    narrow = np.full(count, edge)
    used, ends = rims.unique(return_inverse=True)
    if len(used):
        first, second = ends.numpy().T
        ones = np.ones(len(rims))
        runs = connected_components(
            coo_array((ones, (first, second)), shape=(len(used), len(used))), directed=False
        )[1]
        around = np.bincount(runs[first], edge_lengths(mesh.vertices, rims).numpy())
        narrow[used.numpy()] = np.maximum(around[runs] / AROUND, FINEST * edge)
    sources = np.flatnonzero(narrow < edge)
    wanted = np.full(count, edge)
    graph = _graph(mesh.vertices, edges, np.ones(count))
    for length in np.unique(narrow[sources]):
        ways = dijkstra(graph, indices=sources[narrow[sources] == length], min_only=True)
        wanted = np.minimum(wanted, length + GROWTH * ways)
    return wanted


def _graph(points: Tensor, edges: Tensor, lengths: Floats) -> csr_array:
    """Edges (E, 2) both ways, each as long as it is in wanted lengths (P,)."""
    first, second = edges.T.numpy()
    ways = edge_lengths(points, edges).numpy() / (0.5 * (lengths[first] + lengths[second]))
    rows, columns = np.concatenate([first, second]), np.concatenate([second, first])
    return csr_array(
        coo_array((np.maximum(np.tile(ways, 2), 1e-9), (rows, columns)), shape=(len(points), len(points)))
    )


def _cells(surface: _Surface) -> tuple[Indices, Indices]:
    """Cell (P,) of each vertex, and the seed (S,) of each cell: hems are divided first."""
    generator = np.random.default_rng(0)
    nothing = np.zeros(0, np.int64)
    rims = _relaxed(surface, surface.hems, nothing, _thrown(surface.hems, nothing, surface.on_hem, generator))
    inner = _thrown(surface.graph, rims, ~surface.on_hem, generator)
    seeds = np.concatenate([rims, _relaxed(surface, surface.graph, rims, inner)])
    cells = _nearest(surface.graph, seeds)[1]
    if len(rims):
        on_hem = np.flatnonzero(surface.on_hem)
        cells[on_hem] = _nearest(surface.hems, rims)[1][on_hem]
    return cells, seeds


def _nearest(graph: csr_array, seeds: Indices, limit: float = np.inf) -> tuple[Floats, Indices]:
    """Distance (P,) to the nearest seed, and its index (P,) among the S, -1 for none within the limit."""
    if not len(seeds):
        return np.full(graph.shape[0], np.inf), np.full(graph.shape[0], -1)
    ways, _, sources = dijkstra(graph, indices=seeds, min_only=True, return_predecessors=True, limit=limit)
    number = np.full(graph.shape[0] + 1, -1)
    number[seeds] = np.arange(len(seeds))
    return ways, number[np.where(sources < 0, graph.shape[0], sources)]


def _thrown(
    graph: csr_array, fixed: Indices, allowed: NDArray[np.bool_], generator: np.random.Generator
) -> Indices:
    """Draw seeds (S,) among the allowed vertices, none closer than APART to another or to a fixed one."""
    seeds = np.zeros(0, np.int64)
    first, second = coo_array(graph).coords
    while True:
        ways, _ = _nearest(graph, np.concatenate([fixed, seeds]), APART)
        free = np.flatnonzero(allowed & (ways > APART))
        if not len(free):
            return seeds
        darts = generator.permutation(free)[: max(1, len(free) // 8)]
        while True:
            ways, cells = _nearest(graph, darts, APART)
            met = (cells[first] != cells[second]) & (cells[first] >= 0) & (cells[second] >= 0)
            met &= ways[first] + graph.data + ways[second] < APART
            if not met.any():
                break
            # Of two that are too near each other the later one goes.
            darts = np.delete(darts, np.unique(np.maximum(cells[first[met]], cells[second[met]])))
        seeds = np.concatenate([seeds, darts])


def _relaxed(surface: _Surface, graph: csr_array, fixed: Indices, seeds: Indices) -> Indices:
    """Seeds (S,) that were moved to the vertices nearest to the centres of their cells."""
    if not len(seeds):
        return seeds
    allowed = surface.on_hem if graph is surface.hems else ~surface.on_hem
    for _ in range(RELAXATIONS):
        everyone = np.concatenate([fixed, seeds])
        cells = _nearest(graph, everyone)[1]
        off = np.linalg.norm(surface.points - _centres(surface, cells, len(everyone))[cells], axis=1)
        mine = np.flatnonzero(allowed & (cells >= len(fixed)))
        order = mine[np.lexsort((off[mine], cells[mine]))]
        owner, first = np.unique(cells[order], return_index=True)
        seeds = seeds.copy()
        seeds[owner - len(fixed)] = order[first]
    return seeds


def _centres(surface: _Surface, cells: Indices, count: int) -> Floats:
    """Centres (S, 3) m of cells, denser where edges are to be shorter."""
    known = cells >= 0
    weight = (surface.area / surface.lengths**4)[known]
    sums = np.stack(
        [np.bincount(cells[known], weight * axis[known], minlength=count) for axis in surface.points.T], 1
    )
    return sums / np.maximum(np.bincount(cells[known], weight, minlength=count), 1e-300)[:, None]


def _smoothed(
    points: Floats, faces: Indices, surface: Floats, corners: Indices
) -> tuple[Floats, Indices, Floats]:
    """Vertices (n, 3) m of a cage moved to the middle of their faces, along a surface; those on hems stay.

    Returns their corners (n, 3) in the surface and barycentrics too.
    """
    on_hem = np.zeros(len(points), bool)
    on_hem[boundary_edges(torch.from_numpy(faces)).flatten().numpy()] = True
    tree = KDTree(surface)
    for turn in range(SMOOTHINGS + 1):
        if turn:
            triangles = points[faces]
            areas = np.linalg.norm(
                np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
            )
            sums = np.zeros((len(points), 4))
            np.add.at(sums, faces, np.column_stack([areas[:, None] * triangles.mean(1), areas])[:, None])
            middles = sums[:, :3] / sums[:, 3:]
            points = np.where(on_hem[:, None], points, 0.3 * points + 0.7 * middles)
        around, shares = _embedded(points, tree.query(points)[1], surface, corners)
        points = (surface[around] * shares[..., None]).sum(1)
    return points, around, shares


def _embedded(points: Floats, near: Indices, vertices: Floats, faces: Indices) -> tuple[Indices, Floats]:
    """Corners (P, 3) and barycentrics of the point of a mesh that is closest to each of P points.

    near: (P,) the vertex of the mesh in whose faces it lies, -1 where any may be.
    """
    order = np.argsort(faces.ravel(), kind="stable")
    starts = np.searchsorted(faces.ravel()[order], np.arange(len(vertices) + 1))
    near = np.where(near >= 0, near, KDTree(vertices).query(points)[1])
    near = np.where(
        starts[near + 1] > starts[near], near, KDTree(vertices[np.unique(faces)]).query(points)[1]
    )
    counts = starts[near + 1] - starts[near]
    owner = np.repeat(np.arange(len(points)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    candidates = order[starts[near[owner]] + place] // 3
    triangles = vertices[faces[candidates]]
    shares = closest_barycentrics(*map(torch.from_numpy, (points[owner], triangles))).numpy()
    off = np.linalg.norm((shares[..., None] * triangles).sum(1) - points[owner], axis=1)
    ranked = np.lexsort((off, owner))
    best = ranked[np.unique(owner[ranked], return_index=True)[1]]
    return faces[candidates[best]], shares[best]


def _blended(
    corners: Indices, shares: Floats, vertices: Tensor, faces: Tensor, cage: Floats, cage_faces: Indices
) -> tuple[Indices, Floats]:
    """Corners (N, K) in a cage and weights of garment vertices, averaged over their neighbours.

    corners, shares: (N, 3) by faces of the cage, between which the slope of what they carry jumps. faces: of
    the welded garment.
    """
    fine = float(edge_lengths(vertices, unique_edges(faces)).mean())
    coarse = float(edge_lengths(torch.from_numpy(cage), unique_edges(torch.from_numpy(cage_faces))).mean())
    count = len(vertices)
    weights = csr_array(
        (shares.ravel(), (np.repeat(np.arange(count), 3), corners.ravel())), shape=(count, len(cage))
    )
    average = neighbour_average(faces, count)
    neighbours = csr_array((average.values().numpy(), average.indices().numpy()), shape=(count, count))
    for _ in range(round(BLEND * (coarse / fine) ** 2)):
        weights = 0.5 * (weights + neighbours @ weights)
    weights.data[weights.data < LEAST_SHARE] = 0.0
    weights.eliminate_zeros()
    counts = np.diff(weights.indptr)
    rows, places = np.repeat(np.arange(count), counts), np.arange(weights.nnz)
    columns = places - np.repeat(weights.indptr[:-1], counts)
    own_corners = np.repeat(corners[:, :1], counts.max(), axis=1)
    own_weights = np.zeros(own_corners.shape)
    own_corners[rows, columns], own_weights[rows, columns] = weights.indices, weights.data
    own_weights /= own_weights.sum(1, keepdims=True)
    twin = weld(vertices).numpy()
    return own_corners[twin], own_weights[twin]
