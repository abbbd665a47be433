"""The body as cloth sees it: without forearms and hands, the elbows capped, still watertight.

Mocap pushes forearms through bellies and hands through skirts; a collider that has them
drags the cloth along.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.mesh import boundary_edges

LEFT_OUT = ("forearm", "hand")


@dataclass(frozen=True)
class Collider:
    """faces: (F, 3) into the body's V vertices followed by one cap centre per opening.

    rims: per opening, the body vertices around it.
    """

    faces: Tensor
    rims: tuple[Tensor, ...]

    def vertices(self, body_vertices: Tensor) -> Tensor:
        """Posed body vertices (..., V, 3) with the cap centres appended: (..., V + caps, 3)."""
        caps = [body_vertices[..., rim, :].mean(-2, keepdim=True) for rim in self.rims]
        return torch.cat([body_vertices, *caps], dim=-2)


def make_collider(body: Body) -> Collider:
    """Leave out forearms and hands and close each opening with a fan."""
    dropped = torch.isin(body.regions, torch.tensor([REGIONS.index(r) for r in LEFT_OUT]))
    faces = body.mesh.faces[~dropped]
    rim = boundary_edges(faces)
    fans: list[Tensor] = []
    rims: list[Tensor] = []
    for side in (1, -1):
        edges = rim[body.mesh.vertices[rim[:, 0], 0] * side > 0]
        if len(edges):
            centre = torch.full((len(edges),), len(body.mesh.vertices) + len(rims))
            fans.append(torch.stack([edges[:, 1], edges[:, 0], centre], dim=1))
            rims.append(torch.unique(edges))
    return Collider(torch.cat([faces, *fans]), tuple(rims))
