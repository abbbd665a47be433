"""Opened colliders: parts that mocap presses into each other are pushed apart, for contact only.

Cloth between arm and ribs, thigh and belly, thigh and thigh, or calf and thigh needs room there. Where the
skins of two such parts come closer than GAP, each is pushed back by half of the missing distance, and the
skin around it moves along. The visible body does not change.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
import torch
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree
from torch import Tensor

from uvcloth.bodies.collider import Collider
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.mesh import edge_lengths, unique_edges
from uvcloth.geometry.records import CPU, to_device
from uvcloth.player import opening
from uvcloth.player.sections import row_starts
from uvcloth.player.surface_graph import SurfaceGraph

GAP = 0.012
"""Metres of room between two parts: for two layers of cloth that each keep some millimetres off the skin."""

REST_MARGIN = 1e-4
"""Metres by which parts may come closer than at rest, so that rounding moves nothing."""

SLOPE = 0.75
"""Metres that a push changes for each metre along the skin, at most."""

LONGEST_PUSH = 0.05
"""Most metres that a part is pushed: half of an arm's thickness."""

POINT_SPACING = 0.012
"""Metres between the points at which distances are measured; of a finer mesh only some vertices are points.
"""

MOST_KEPT = 8
"""Openings that are kept: garments on one body share one, or one each for those with and without sleeves."""


@dataclass(frozen=True)
class ColliderOpening:
    """Opening of a collider; sections: its arrays by name, as `uvcloth.player.opening.Opening` has them."""

    sections: Mapping[str, np.ndarray]

    @cached_property
    def runtime(self) -> opening.Opening:
        """The same in the runtime, read before it first opens a frame."""
        return opening.Opening(self.sections)

    def opened(self, vertices: Tensor) -> Tensor:
        """Collider vertices (F, C, 3) or (C, 3) m with room between the parts, float32.

        Each frame is opened by itself. Vertices far from every other part keep the same bits.
        """
        apart = vertices.detach().to("cpu", torch.float32, copy=True).contiguous()
        self.runtime.open_frames(apart.view(-1, *apart.shape[-2:]).numpy())
        return apart.to(vertices.device)


@dataclass(frozen=True)
class _AtRest:
    """A collider and the body (V, 3) m at rest that it belongs to, equal by their content."""

    content: str
    collider: Collider = field(compare=False)
    body: Tensor = field(compare=False)


def make_opening(collider: Collider, body_vertices: Tensor) -> ColliderOpening:
    """Opening of a collider's pressed parts, for a body with vertices (V, 3) m at rest.

    The latest ones are kept, and are the same for the same content.
    """
    body, collider = body_vertices.detach().to("cpu", torch.float32, copy=True), to_device(collider, CPU)
    faces = (*collider.parts, *collider.rims)
    content = fingerprint(f"{collider.pressed} {[len(each) for each in faces]}", *faces, body)
    return _opening(_AtRest(content, collider, body))


@lru_cache(MOST_KEPT)
def _opening(standing: _AtRest) -> ColliderOpening:
    collider, body = standing.collider, standing.body
    rest, count = body.numpy(), len(body) + len(collider.rims)
    skins = [part[(part < len(body)).all(1)] for part in collider.parts]
    vertices_of = [skin.unique().numpy() for skin in skins]
    sides = [
        side
        for a, b in collider.pressed
        if len(vertices_of[a]) and len(vertices_of[b])
        for side in ((a, b), (b, a))
    ]
    graph = _skin_graph(body, torch.cat(skins), count)
    skin = SurfaceGraph(graph.indptr, graph.indices, graph.data)
    clear = np.full(count, -1.0, np.float32)
    for part in {part for part, _ in sides}:
        clear = np.maximum(clear, skin.thin_out(_in_order(rest, vertices_of[part]), POINT_SPACING))
    points_of = [
        _close_together(
            rest, np.setdiff1d(vertices_of[part][clear[vertices_of[part]] >= 0], vertices_of[other])
        )
        for part, other in sides
    ]
    points, rims = _joined(points_of), [rim[:, 0].numpy() for rim in collider.rims]
    allowed = [_allowed(vertices_of[other], graph) for _, other in sides]
    wanted = [
        np.minimum(KDTree(rest[vertices_of[other]]).query(rest[own_points])[0], GAP)
        for own_points, (_, other) in zip(points_of, sides, strict=True)
    ]
    sections = {
        "opening.starts": row_starts([len(few) for few in points_of]),
        "opening.points": points,
        "opening.want": np.concatenate([np.zeros(0), *wanted]),
        "opening.spacing": np.array([POINT_SPACING]),
        "opening.slope": np.array([SLOPE]),
        "opening.allowed": np.array(allowed).reshape(-1, count),
        "opening.clear": clear,
        "opening.reach": np.array([LONGEST_PUSH / SLOPE]),
        "opening.faces": torch.cat(skins).numpy(),
        "skin.rest": rest,
        "opening.tips": np.arange(len(body), count),
        "opening.rim_starts": row_starts([len(rim) for rim in rims]),
        "opening.rims": _joined(rims),
    }
    at_rest = opening.Opening(sections).distances(collider.vertices(body).numpy()) - REST_MARGIN
    sections["opening.want"] = np.minimum(sections["opening.want"], at_rest)
    return ColliderOpening(sections)


def _skin_graph(body: Tensor, faces: Tensor, count: int) -> csr_array:
    """Edges of the skin's faces (F, 3) among `count` vertices, both ways, with their lengths, m."""
    edges = unique_edges(faces)
    rows, columns = torch.cat([edges, edges.flip(1)]).T.numpy()
    lengths = edge_lengths(body, edges).repeat(2).numpy()
    graph = csr_array(coo_array((lengths, (rows, columns)), shape=(count, count)))
    graph.sort_indices()
    return graph


def _in_order(rest: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Vertices (N,) from the feet upwards, the same on both sides of the body."""
    x, y, z = np.round(rest[vertices], 4).T
    return vertices[np.lexsort((x, y, np.abs(x), z))]


def _close_together(rest: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Vertices (N,) in an order in which neighbours lie close together."""
    return vertices[opening.in_tiles(rest[vertices])]


def _allowed(other: np.ndarray, graph: csr_array) -> np.ndarray:
    """Longest push (C,) m of each vertex away from another part (N,): shorter where that part is near along
    the skin.
    """
    ways = dijkstra(graph, indices=other, limit=LONGEST_PUSH / SLOPE, min_only=True)
    return np.minimum(SLOPE * ways, LONGEST_PUSH).astype(np.float32)


def _joined(groups: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros(0, np.int32), *groups]).astype(np.int32)
