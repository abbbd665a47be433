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
    """vertices: (N, 3) m of each garment. contacts: what was done to it. moves: (N, 3) m, by how much."""

    vertices: tuple[Tensor, ...]
    contacts: tuple[Contacts, ...]
    moves: tuple[Tensor, ...]


class OutfitContact:
    """Finishes the garments of an outfit, frame after frame: off the collider, edges at rest length.

    The innermost comes first, and where it ends each other one stays on its outer side.
    """

    def __init__(self, body: Body, meshes: Sequence[Mesh]) -> None:
        """meshes: of the garments at rest, the innermost first; everything runs on the body's device."""
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

        moves: what that moved in the frame before, None in the first.
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
