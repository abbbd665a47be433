"""Garments with their cages."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from torch import Tensor

from uvcloth.garments.cage import Cage, kept_cage
from uvcloth.garments.garment import Garment
from uvcloth.geometry.mesh import WeldedMesh, welded
from uvcloth.geometry.skinning import skin


@dataclass(frozen=True)
class CagedGarment:
    """A garment with its cage.

    mesh: the garment, welded. weights: (U, J) of its points. cage: of those points. cage_weights: (n, J).
    rows: of its cage among all cages.
    """

    mesh: WeldedMesh
    weights: Tensor
    cage: Cage
    cage_weights: Tensor
    rows: slice

    def represented(self, transforms: Tensor, garment: Tensor) -> Tensor:
        """The garment (B, N, 3) m as a cage that lies in it carries it. transforms: (B, J, 3, 4)."""
        offsets = self.cage.at_cage(garment[:, self.mesh.kept])
        offsets -= skin(self.cage.vertices, self.cage_weights, transforms)
        near = skin(self.mesh.points, self.weights, transforms)
        return (near + self.cage.at_garment(offsets))[:, self.mesh.places]


def caged(garments: Sequence[Garment], edge: float) -> Iterator[CagedGarment]:
    """Yield garments with cages of an edge length, m."""
    first = 0
    for garment in garments:
        mesh = welded(garment.mesh.vertices, garment.mesh.faces)
        cage = kept_cage(mesh.points, mesh.faces, edge)
        weights = garment.smooth_weights[mesh.kept]
        yield CagedGarment(
            mesh=mesh,
            weights=weights,
            cage=cage,
            cage_weights=cage.at_cage(weights),
            rows=slice(first, first + len(cage.vertices)),
        )
        first += len(cage.vertices)
