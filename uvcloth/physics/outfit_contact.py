"""Contact of a whole outfit with the body and among its garments."""

from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
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

    The innermost comes first, and each other one stays on the outer side of where it ends.
    """

    def __init__(self, body: Body, meshes: Sequence[Mesh]) -> None:
        """Prepare the garments at rest, the innermost first; everything runs on the body's device."""
        body_vertices = body.mesh.vertices
        self.obstacle = Obstacle(to_device(make_collider(body), body_vertices.device), body_vertices)
        self.layers = [Layer(mesh.vertices, mesh.faces) for mesh in meshes[:-1]]
        self.garments = [
            self.obstacle.dress(mesh.vertices, mesh.faces, self.layers[:index])
            for index, mesh in enumerate(meshes)
        ]

    def resolve(
        self, raw: tuple[Tensor, ...], body_vertices: Tensor, moves: tuple[Tensor | None, ...]
    ) -> ResolvedOutfit:
        """Resolve garments (N, 3) m against the body (V, 3) and those beneath them.

        moves: (N, 3) m, the corrections of the frame before, None in the first.
        """
        self.obstacle.update(body_vertices)
        finished, contacts = [], []
        for index, (vertices, garment) in enumerate(zip(raw, self.garments, strict=True)):
            after, found = self.obstacle.resolve(vertices, garment, moves[index])
            for layer in self.layers[index : index + 1]:
                layer.update(after)
            finished.append(after)
            contacts.append(found)
        apart = (after - before for after, before in zip(finished, raw, strict=True))
        return ResolvedOutfit(tuple(finished), tuple(contacts), tuple(apart))
