"""Heat maps of garments: a value per vertex, drawn as faces in bands of colour."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.mesh import Mesh, edge_lengths, unique_edges

COLORS = (
    (68, 1, 84),
    (71, 45, 123),
    (59, 82, 139),
    (44, 114, 142),
    (33, 144, 141),
    (39, 173, 129),
    (92, 200, 99),
    (170, 220, 50),
    (253, 231, 37),
)
"""Colours of the bands, from the least value to the largest: matplotlib's viridis."""


@dataclass(frozen=True)
class Quantity:
    """A quantity on cloth: the largest value with a separate colour, and unit and factor of labels."""

    label: str
    largest: float
    unit: str
    factor: float


STRETCH = Quantity("stretch", 0.2, "%", 100.0)
CLEARING = Quantity("moved by clearing", 0.02, "mm", 1000.0)
ERROR = Quantity("error", 0.05, "mm", 1000.0)
QUANTITIES = (STRETCH, CLEARING, ERROR)


class Stretch:
    """Relative change of length since rest of the edges at each vertex of a garment."""

    def __init__(self, mesh: Mesh) -> None:
        self._edges = unique_edges(mesh.faces)
        self._rest = edge_lengths(mesh.vertices, self._edges)
        self._count = len(mesh.vertices)
        ends = self._edges.reshape(-1)
        self._degree = torch.bincount(ends, minlength=self._count).clamp(min=1)

    def __call__(self, vertices: Tensor) -> Tensor:
        """Mean of |length / rest length - 1| over the edges at each vertex: (N, 3) m -> (N,)."""
        strain = (edge_lengths(vertices, self._edges) / self._rest - 1).abs()
        summed = torch.zeros(self._count).index_add(0, self._edges.reshape(-1), strain.repeat_interleave(2))
        return summed / self._degree


def bands(values: Tensor, faces: Tensor, largest: float) -> Iterator[Tensor]:
    """Faces (K, 3) of each band of COLORS in turn, for values (N,) of vertices: from 0 to `largest`."""
    means = values[faces].mean(1) / largest
    band = (means * len(COLORS)).long().clamp(0, len(COLORS) - 1)
    for index in range(len(COLORS)):
        yield faces[band == index]


def legend(quantity: Quantity) -> str:
    """The bands with their values, as HTML."""
    steps = (quantity.largest * quantity.factor * index / len(COLORS) for index in range(len(COLORS)))
    cells = "".join(
        f'<span style="flex:1;text-align:center;font-size:10px;color:{"#fff" if index < 5 else "#000"};'
        f'background:rgb{color}">{step:.0f}</span>'
        for index, (color, step) in enumerate(zip(COLORS, steps, strict=True))
    )
    return f'<div style="padding:0 1em"><small>{quantity.label}, {quantity.unit}</small>' + (
        f'<div style="display:flex">{cells}</div></div>'
    )
