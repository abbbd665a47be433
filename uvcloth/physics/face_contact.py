"""Contact of faces: moves the vertices of coarse garments until no skin shows through their faces.

All vertices of a coarse mesh may be outside the body while a knee comes through the face between them. Points
all over the faces are kept off the body, and off the faces of the garment beneath; a point that is too close
moves the three corners of its face.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.geometry.mesh import Mesh, face_normals, weld
from uvcloth.physics.exposure import SurfaceSample, spread
from uvcloth.physics.layers import Layer
from uvcloth.physics.obstacle import ContactGarment, Obstacle
from uvcloth.physics.surface import FREE

POINT_SPACING = 0.013
"""Metres between points on a face: between them, a limb of 40 mm radius comes 1 mm closer."""

FACE_CLEARANCE = 0.002
"""Metres that points keep off the skin and off the garment beneath."""

SEARCHES, PASSES = 3, 12
"""Searches for the nearest skin in a frame, and passes over its planes after each."""


@dataclass(frozen=True)
class CoarseGarment:
    """A garment whose faces are kept off the body.

    points: on its faces. contact: of these points. owner: (N,) first vertex at the place of each vertex.
    """

    points: SurfaceSample
    contact: ContactGarment
    owner: Tensor

    def push(self, vertices: Tensor, normals: Tensor, offsets: Tensor) -> Tensor:
        """Move vertices (N, 3) m until the P points are on the outer side of their planes.

        normals: (P, 3). offsets: (P,) m, the least product of a point with its normal.
        """
        corners, weights = self.owner[self.points.corners], self.points.barycentrics
        shares = weights / weights.square().sum(1, keepdim=True)
        for _ in range(PASSES):
            lack = (offsets - (self.points.points(vertices) * normals).sum(1)).clamp(min=0)
            rows = torch.nonzero(lack).squeeze(1)
            if not len(rows):
                break
            asked = (weights * shares)[rows, :, None] * (lack[:, None] * normals)[rows, None]
            places = corners[rows].reshape(-1)
            total = torch.zeros_like(vertices).index_add(0, places, asked.reshape(-1, 3))
            weight = torch.zeros_like(vertices[:, 0]).index_add(0, places, weights[rows].reshape(-1))
            vertices = vertices + (total / weight.clamp(min=1e-9)[:, None])[self.owner]
        return vertices


class FaceContact:
    """Contact of the faces of an outfit, the innermost garment first; see the module."""

    def __init__(self, body: Body, meshes: Sequence[Mesh], coarse: Sequence[bool]) -> None:
        """Prepare garments at rest. Those that are not coarse stay, and garments over them keep off them."""
        self._obstacle = Obstacle(make_collider(body), body.mesh.vertices)
        self._layers = [Layer(mesh.vertices, mesh.faces) for mesh in meshes[:-1]]
        self._garments = [
            self._garment(mesh, self._layers[:index]) if is_coarse else None
            for index, (mesh, is_coarse) in enumerate(zip(meshes, coarse, strict=True))
        ]

    def resolve(self, garments: Sequence[Tensor], body_vertices: Tensor) -> tuple[Tensor, ...]:
        """Move garments (N, 3) m off the posed body (V, 3) m, each also off those before it."""
        self._obstacle.update(body_vertices)
        finished = []
        for index, (vertices, garment) in enumerate(zip(garments, self._garments, strict=True)):
            after = self._cleared(vertices, garment) if garment else vertices
            for layer in self._layers[index : index + 1]:
                layer.update(after)
            finished.append(after)
        return tuple(finished)

    def _garment(self, mesh: Mesh, layers: Sequence[Layer]) -> CoarseGarment:
        area = 0.5 * float(face_normals(mesh.vertices, mesh.faces).norm(dim=1).sum())
        points = spread(mesh.vertices, mesh.faces, math.ceil(area / POINT_SPACING**2))
        contact = self._obstacle.contact_garment(points.points(mesh.vertices), layers)
        return CoarseGarment(points, contact, weld(mesh.vertices))

    def _cleared(self, vertices: Tensor, garment: CoarseGarment) -> Tensor:
        for _ in range(SEARCHES):
            points = garment.points.points(vertices)
            skin = self._obstacle.skin(points, garment.contact, exact=2.0 * FACE_CLEARANCE)
            near = (skin.distance < 2.0 * FACE_CLEARANCE) & ~skin.squeezed
            offsets = torch.where(near, skin.offsets + FACE_CLEARANCE, FREE)
            normals = skin.normals
            for beneath in garment.contact.over:
                rows, distance, directions = beneath.find(points)
                normals[rows] = directions
                offsets[rows] = (directions * points[rows]).sum(1) - distance + FACE_CLEARANCE
            vertices = garment.push(vertices, normals, offsets)
        return vertices
