"""Refined garments: one step of Loop's subdivision, so that a mesh can hold folds its solver cannot."""

from dataclasses import dataclass

from torch import Tensor

from uvcloth.geometry.mesh import Mesh, welded
from uvcloth.geometry.subdivide import halve_edges, loop_matrix


@dataclass(frozen=True)
class Refined:
    """A garment's mesh after one step of Loop's subdivision, as a product for any of its poses.

    places: (N,) the point of the welded mesh that each vertex of the garment is at; kept: (U,) a vertex at
    each of these. matrix: sparse (P, U). mesh: at rest, P vertices, with the garment's texture coordinates.
    """

    kept: Tensor
    places: Tensor
    matrix: Tensor
    mesh: Mesh

    @classmethod
    def of(cls, mesh: Mesh) -> "Refined":
        """Refine a mesh; vertices at one place, as at texture seams, are joined."""
        joined = welded(mesh.vertices, mesh.faces)
        uvs, face_uvs = mesh.uvs, mesh.face_uvs
        if len(uvs):
            uvs, face_uvs = halve_edges(uvs, face_uvs)
        matrix, faces = loop_matrix(joined.faces, len(joined.points))
        matrix = matrix.to(joined.points)
        return cls(joined.kept, joined.places, matrix, Mesh(matrix @ joined.points, faces, uvs, face_uvs))

    def at(self, vertices: Tensor) -> Tensor:
        """Vertices (..., P, 3) m of the refined mesh, of the garment at (..., N, 3) m."""
        points = vertices[..., self.kept, :]
        flat = points.movedim(-2, 0).reshape(len(self.kept), -1)
        refined = self.matrix.to(flat.dtype) @ flat
        return refined.view(-1, *points.shape[:-2], 3).movedim(0, -2)
