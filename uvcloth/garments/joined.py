"""Garments as engines simulate them: joined where the mesh is cut at UV seams, with their holding band."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.band import Band, holding_band
from uvcloth.garments.garment import Garment
from uvcloth.geometry.mesh import flat_faces, weld


@dataclass(frozen=True)
class EngineMesh:
    """A garment for an engine.

    kept: (n,) the vertices of the garment's mesh that are simulated, one where several are at one place.
    places: (N,) index into kept for each vertex of the mesh, -1 for a vertex that no face uses. faces: (M, 3)
    into kept.
    """

    garment: Garment
    band: Band
    kept: Tensor
    places: Tensor
    faces: Tensor

    def whole(self, simulated: Tensor, skinned: Tensor) -> Tensor:
        """Whole meshes (F, N, 3) m from simulated vertices (F, n, 3) m; vertices that no face uses are
        skinned.
        """
        return torch.where((self.places < 0)[:, None], skinned, simulated[:, self.places])


def join(garment: Garment, body: Body) -> EngineMesh:
    """Join a garment for simulation.

    Raises InputError if it has no hem that holds it, or a face without an area.
    """
    mesh = garment.mesh
    flat = flat_faces(mesh.vertices, mesh.faces)
    if bool(flat.any()):
        face = mesh.faces[flat][0].tolist()
        raise InputError(
            f"garment {garment.name}: {int(flat.sum())} faces have no area, which no engine can simulate "
            f"(one is between the vertices {', '.join(map(str, face))})"
        )
    owner = weld(mesh.vertices)
    kept, faces = owner[mesh.faces].unique(return_inverse=True)
    places = torch.full_like(owner, -1)
    places[kept] = torch.arange(len(kept))
    return EngineMesh(garment, holding_band(garment, body), kept, places[owner], faces)
