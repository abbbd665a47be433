"""Pieces of a garment file that are separate garments, such as a shirt and trousers."""

from dataclasses import replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments.fit import make_fitted
from uvcloth.garments.garment import Garment
from uvcloth.geometry.authored import part_of
from uvcloth.geometry.mesh import Mesh, face_normals, weld
from uvcloth.physics.layers import wrong_side_percent

LEAST_SHARE = 0.08
"""Share of a file's area from which a piece is a garment; buttons and belts belong to the closest one."""


def split(name: str, mesh: Mesh, body: Body, template: str | None) -> tuple[Garment, ...]:
    """Garments of a mesh that lies on a body, the innermost first; one if its pieces are connected.

    A garment keeps the order of its vertices, and is called NAME_TEMPLATE where there are several. template:
    one for all of them, None to choose one for each, see `make_fitted`.
    """
    piece = pieces(mesh)
    if int(piece.max()) == 0:
        return (make_fitted(name, mesh, body, template)[0],)
    parts = [make_fitted(name, part_of(mesh, piece == index), body, template)[0] for index in piece.unique()]
    return layered(_named(name, parts))


def pieces(mesh: Mesh) -> Tensor:
    """Garment of each vertex of a mesh, from 0: (N,) int64. Vertices without faces belong to the closest
    garment."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    count, owner = len(mesh.vertices), weld(mesh.vertices)
    ends = torch.cat([mesh.faces.roll(1, 1).reshape(-1), torch.arange(count)]).numpy()
    starts = torch.cat([mesh.faces.reshape(-1), owner]).numpy()
    graph = coo_array((starts >= 0, (starts, ends)), shape=(count, count))
    component = torch.from_numpy(connected_components(graph, directed=False)[1]).long()
    area = face_normals(mesh.vertices, mesh.faces).norm(dim=1)
    areas = torch.zeros(int(component.max()) + 1).index_add(0, component[mesh.faces[:, 0]], area)
    large = areas >= min(LEAST_SHARE * float(areas.sum()), float(areas.max()))
    belongs = large[component]
    _, nearest = KDTree(mesh.vertices[belongs].numpy()).query(mesh.vertices.numpy())
    distance = (mesh.vertices - mesh.vertices[belongs][torch.from_numpy(nearest)]).norm(dim=1)
    # A small component goes as a whole with the piece that its closest vertex is beside.
    closest = torch.full((len(areas),), torch.inf).scatter_reduce(0, component, distance, "amin")
    at_closest = torch.nonzero(distance == closest[component]).squeeze(1)
    joined = torch.arange(len(areas))
    joined[component[at_closest]] = component[belongs][torch.from_numpy(nearest)[at_closest]]
    joined = torch.where(large, torch.arange(len(areas)), joined)
    return torch.unique(joined[component], return_inverse=True)[1]


def layered(garments: list[Garment]) -> tuple[Garment, ...]:
    """Order garments by which lies over which at rest, the innermost first; all others keep their order."""

    def over(one: Garment, other: Garment) -> bool:
        return _crossed(one, other) < _crossed(other, one)

    rank = [sum(over(one, other) for other in garments if other is not one) for one in garments]
    return tuple(garments[index] for index in sorted(range(len(garments)), key=lambda index: rank[index]))


def _crossed(outer: Garment, inner: Garment) -> float:
    """Percent of the places where two garments meet at which the first is not over the second."""
    return wrong_side_percent(outer.mesh.vertices[None], inner.mesh.vertices[None], inner.mesh.faces)


def _named(name: str, parts: list[Garment]) -> list[Garment]:
    """Garments by the name of their file and of their template, numbered where two have the same."""
    names = [f"{name}_{garment.template}" for garment in parts]
    return [
        replace(
            garment, name=piece if names.count(piece) == 1 else f"{piece}_{names[: index + 1].count(piece)}"
        )
        for index, (garment, piece) in enumerate(zip(parts, names, strict=True))
    ]
