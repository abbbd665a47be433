"""Potential energy of an outfit on a body in many poses: stretch, bending, collision and gravity."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from train.batched_collision import NearbyBody, inner_layers
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.records import to_device
from uvcloth.physics.energies import bend_energy, collision_energy, edge_energy, gravity_energy, rest_shape
from uvcloth.physics.posed_batch import ClosestPointCache


@dataclass(frozen=True)
class ClothMaterial:
    """Material of the cloth, and stiffness of its contact with the body. Energies are in joules."""

    edge: float = 15.0
    """N/m, resistance to stretch and compression (PBNS, Figure 5: 5 to 25)."""
    bend: float = 5e-5
    """J, resistance to bending (PBNS, Figure 5: 1e-6 to 1e-4)."""
    mass: float = 0.3
    """kg/m2, for gravity."""
    collision: float = 50.0
    """N/m, against cloth too close to the skin or to an inner garment (PBNS: 25)."""
    thickness: float = 0.005
    """Distance to keep, in metres (PBNS: 0.004)."""
    pin: float = 10.0
    """N/m, on the deformation of pinned vertices (PBNS: 1000; its program: 10)."""
    plane: Literal["surface", "vertex"] = "surface"
    """Collision with the plane at the closest point of the skin, or at the closest vertex (PBNS)."""

    def __post_init__(self) -> None:
        """Raises InputError for values out of range."""
        for name in ("edge", "bend", "mass", "collision", "thickness", "pin"):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise InputError(f"--{name} {value}: has to be 0 or more")


class ClothEnergy:
    """The energies of an outfit of one material, J, on a body in as many poses at once as a batch has.

    points: (U, 3) m at rest, all garments' vertices. faces: (F, 3) into them, per garment, the innermost
    first. layers: whether a garment lies over another.
    """

    def __init__(
        self,
        body: Body,
        points: Tensor,
        faces: Sequence[Tensor],
        material: ClothMaterial,
        batch: int,
        device: torch.device,
    ) -> None:
        self.material = material
        self.cloth = to_device(rest_shape(points, torch.cat(list(faces)), material.mass), device)
        points = points.to(device)
        self.body = NearbyBody(body, points, batch, device)
        pieces = [each.to(device).unique(return_inverse=True) for each in faces]
        self.layers = inner_layers(points, pieces, batch)

    def __call__(
        self, posed: Tensor, transforms: Tensor, cache: ClosestPointCache | None = None
    ) -> dict[str, Tensor]:
        """Energies "edge", "bend", "collision" and "gravity", (B,) each, of outfits (B, U, 3) m.

        transforms: (B, J, 3, 4) of the body. cache: of the closest points, renewed in place; it saves time
        and changes nothing. Paper: PBNS eq. 3 to 8.
        """
        material, cloth = self.material, self.cloth
        self.body.move(transforms)
        planes = self.body.planes(posed, material.thickness, cache, material.plane)
        met = [collision_energy(planes.distance(posed), material.thickness, material.collision)]
        normals = vertex_normals(posed.detach(), cloth.faces) if self.layers else posed
        for layer in self.layers:
            distance = layer.planes(posed, normals).distance(posed[:, layer.outer])
            met.append(collision_energy(distance, material.thickness, material.collision))
        return {
            "edge": edge_energy(posed, cloth, material.edge),
            "bend": bend_energy(posed, cloth, material.bend),
            "collision": torch.stack(met).sum(0),
            "gravity": gravity_energy(posed, cloth),
        }
