"""The potential energy that PBNS minimizes, and the fabric and stiffness that it depends on."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Literal

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.files.options import Between
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.records import to_device
from uvcloth.physics.energies import attachment_energy, cloth_energies, collision_energy
from uvcloth.physics.fabric import RANGES, Fabric, FabricName, fabric_from, find_fabric

from ..batched_collision import NearbyBody, inner_layers
from ..posed_batch import ClosestPointCache

PROGRAM_FABRIC = Fabric(density=0.3, stretch=34.641016, bend=8.660254e-5)
"""Fabric of the paper's program, whose weights of edges and bending are 15 N/m and 5e-5 J."""


@dataclass(frozen=True)
class FabricOptions:
    """Fabric of the cloth, and values that replace its own."""

    fabric: FabricName | None = None
    """Fabric (default: that of the paper's program: 34.6 N/m, 8.7e-5 N m, 0.3 kg/m2)."""
    stretch: Annotated[float | None, Between(*RANGES["stretch"])] = None
    """N/m, membrane stiffness, instead of the fabric's (PBNS, Figure 5: 12 to 58)."""
    bend: Annotated[float | None, Between(*RANGES["bend"])] = None
    """N m, bending rigidity, instead of the fabric's (PBNS, Figure 5: 1.7e-6 to 1.7e-4)."""
    density: Annotated[float | None, Between(*RANGES["density"])] = None
    """kg/m2, instead of the fabric's."""

    def resolved(self) -> Fabric:
        """The fabric that they describe. Raises InputError for a number that no fabric has."""
        fabric = PROGRAM_FABRIC if self.fabric is None else find_fabric(self.fabric)
        for name in ("stretch", "bend", "density"):
            value = getattr(self, name)
            if value is not None:
                fabric = fabric_from(asdict(replace(fabric, **{name: value})), f"--{name} {value}")
        return fabric


@dataclass(frozen=True)
class EnergyConfig:
    """Contact and pins of PBNS: each is a spring, of the energy k d^2 / 2."""

    collision: Annotated[float, Between(0, 1e9)] = 100.0
    """N/m, against cloth too close to the skin or to an inner garment (PBNS: 50)."""
    thickness: Annotated[float, Between(0, 1e9)] = 0.005
    """Distance to keep, in metres (PBNS: 0.004)."""
    pin: Annotated[float, Between(0, 1e9)] = 20.0
    """N/m, on the deformation of pinned vertices (PBNS: 2000; its program: 20)."""
    plane: Literal["surface", "vertex"] = "surface"
    """Collision with the plane at the closest point of the skin, or at the closest vertex (PBNS)."""

    def __post_init__(self) -> None:
        """Raises InputError for values out of range."""
        for name in ("collision", "thickness", "pin"):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise InputError(f"--{name} {value}: has to be 0 or more")


class PBNSEnergy:
    """The energies of an outfit of one fabric, J, on a body in as many poses at once as a batch has.

    points: (U, 3) m at rest, all garments' vertices. faces: (F, 3) into them, per garment, the innermost
    first. pins: (n,) of the points. layers: whether a garment lies over another.
    """

    def __init__(
        self,
        body: Body,
        points: Tensor,
        faces: Sequence[Tensor],
        pins: Tensor,
        fabric: Fabric,
        config: EnergyConfig,
        batch: int,
        device: torch.device,
    ) -> None:
        self.config, self.pins = config, pins.to(device)
        self.cloth = to_device(cloth_energies(points, torch.cat(list(faces)), fabric), device)
        points = points.to(device)
        self.body = NearbyBody(body, points, batch, device)
        self.layers = inner_layers(
            points, [each.to(device).unique(return_inverse=True) for each in faces], batch
        )

    def __call__(
        self, deformed: Tensor, posed: Tensor, transforms: Tensor, cache: ClosestPointCache | None = None
    ) -> dict[str, Tensor]:
        """Energies, (B,) each, of outfits (B, U, 3) m, deformed by (B, U, 3) m at rest (PBNS eq. 3 to 8).

        transforms: (B, J, 3, 4) of the body. cache: of the closest points, renewed in place; it saves time
        and changes nothing.
        """
        config, cloth = self.config, self.cloth
        self.body.move(transforms)
        planes = self.body.planes(posed, config.thickness, cache, config.plane)
        normals = vertex_normals(posed.detach(), cloth.faces) if self.layers else posed
        distances = [planes.distance(posed), *(layer.distance(posed, normals) for layer in self.layers)]
        met = [collision_energy(distance, config.thickness, config.collision) for distance in distances]
        return {
            "stretch": cloth.springs(posed).sum(-1),
            "bend": cloth.folds(posed).sum(-1),
            "collision": torch.stack(met).sum(0),
            "gravity": cloth.gravity(posed).sum(-1),
            "pin": attachment_energy(deformed[:, self.pins], config.pin),
        }
