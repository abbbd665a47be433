"""Contact of a whole outfit with the body and among its garments."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.stature import beside_adults
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.records import to_device
from uvcloth.physics.contact import Contacts, Obstacle
from uvcloth.physics.layers import Layer


@dataclass(frozen=True)
class ResolvedOutfit:
    """Garments after contact: of each its vertices (N, 3) m, the result of its solve, its moves (N, 3) m."""

    vertices: tuple[Tensor, ...]
    contacts: tuple[Contacts, ...]
    moves: tuple[Tensor, ...]


class OutfitContact:
    """Contact of an outfit, frame by frame: garments off the collider, edges at rest length.

    The innermost comes first, and each other one stays on the outer side of the resolved ones. Clearances are
    for adults: a body of another size is scaled to that of the nearest adult.
    """

    def __init__(self, body: Body, meshes: Sequence[Mesh]) -> None:
        """Prepare the garments at rest, the innermost first; everything runs on the body's device."""
        self._size = beside_adults(body)
        rest = self._as_adult(body.mesh.vertices)
        self.obstacle = Obstacle(to_device(make_collider(body), rest.device), rest)
        points = [self._as_adult(mesh.vertices) for mesh in meshes]
        self.layers = [
            Layer(vertices, mesh.faces) for vertices, mesh in zip(points[:-1], meshes[:-1], strict=True)
        ]
        self.garments = [
            self.obstacle.contact_garment(vertices, mesh.faces, self.layers[:index])
            for index, (vertices, mesh) in enumerate(zip(points, meshes, strict=True))
        ]

    def resolve(
        self, raw: tuple[Tensor, ...], body_vertices: Tensor, moves: tuple[Tensor | None, ...]
    ) -> ResolvedOutfit:
        """Resolve garments (N, 3) m against the body (V, 3) and those beneath them.

        moves: (N, 3) m, the corrections of the frame before, None in the first.
        """
        self.obstacle.update(self._as_adult(body_vertices))
        finished, contacts = [], []
        for index, (vertices, garment) in enumerate(zip(raw, self.garments, strict=True)):
            before = moves[index]
            after, contact = self.obstacle.resolve(
                self._as_adult(vertices), garment, None if before is None else self._as_adult(before)
            )
            for layer in self.layers[index : index + 1]:
                layer.update(after)
            finished.append(after if self._size == 1.0 else after * self._size)
            contacts.append(replace(contact, deepest=contact.deepest * self._size))
        apart = (after - before for after, before in zip(finished, raw, strict=True))
        return ResolvedOutfit(tuple(finished), tuple(contacts), tuple(apart))

    def _as_adult(self, points: Tensor) -> Tensor:
        """Points (N, 3) m around a body of any size, scaled to an adult's."""
        return points if self._size == 1.0 else points / self._size
