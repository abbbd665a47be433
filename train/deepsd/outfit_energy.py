"""Energy of outfits on bodies of their own in many poses: what physics minimizes (paper eq. 4 to 6)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from train.batched_collision import InnerLayer, PosedParts, inner_layers
from train.deepsd.dataset import OutfitFrames
from train.deepsd.losses import PhysicsLosses
from train.deepsd.prediction import PosedOutfit
from uvcloth.bodies.body import Body
from uvcloth.bodies.opened import Opening
from uvcloth.bodies.posing import posed_skin
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.operators import Operator
from uvcloth.methods.deepsd.outfit_graph import pack
from uvcloth.physics.energies import RestShape, bend_energy, collision_energy, edge_energy, rest_shape


@dataclass(frozen=True)
class Cloth:
    """An outfit at rest as the energies need it.

    touches: (U,) int32, the parts of the body that each point may touch; opening: of these parts.
    average: over neighbours.
    """

    shape: RestShape
    touches: Tensor
    opening: Opening
    average: Operator
    layers: list[InnerLayer]


class OutfitEnergy:
    """Energies of outfits on bodies of the mesh of one, in `count` poses at most."""

    def __init__(self, losses: PhysicsLosses, body: Body, count: int, device: torch.device) -> None:
        self.losses, self.count, self.device = losses, count, device
        self._parts = PosedParts(body, count, device)
        self._known: dict[int, Cloth] = {}

    def __call__(self, frames: OutfitFrames, outfit: PosedOutfit, transforms: Tensor) -> dict[str, Tensor]:
        """Mean energies of an outfit over its poses, J: () each; joint transforms (Q, J, 3, 4)."""
        losses, posed = self.losses, outfit.posed
        cloth = self._cloth(frames)
        energies = {"edge": edge_energy(posed, cloth.shape, losses.edge)}
        normals = vertex_normals(posed, cloth.shape.faces)
        if losses.bend_normals == "vertex":
            energies["bend"] = normal_energy(normals, cloth.average, losses.bend)
        else:
            energies["bend"] = bend_energy(posed, cloth.shape, losses.bend)
        self._parts.move(posed_skin(frames.body, transforms), cloth.opening)
        planes = self._parts.planes(posed, cloth.touches, losses.thickness)
        met = [collision_energy(planes.distance(posed), losses.thickness, losses.collision)]
        for layer in cloth.layers:
            distance = layer.planes(posed, normals.detach()).distance(posed[:, layer.outer])
            met.append(collision_energy(distance, losses.thickness, losses.collision))
        energies["collision"] = torch.stack(met).sum(0)
        energies["small"] = losses.small * outfit.deformation["physics"].square().sum((-2, -1))
        return {name: energy.mean() for name, energy in energies.items()}

    def _cloth(self, frames: OutfitFrames) -> Cloth:
        """The outfit at rest, worked out at its first visit."""
        if id(frames) not in self._known:
            graph, losses = frames.graph, self.losses
            points = graph.points.to(self.device)
            faces = [faces.to(self.device) for faces in graph.faces]
            pieces = [each.unique(return_inverse=True) for each in faces]
            self._known[id(frames)] = Cloth(
                shape=rest_shape(points, torch.cat(faces), 0.0),
                touches=self._parts.touches(points, frames.body),
                opening=self._parts.opening(frames.body),
                average=pack([graph], self.device).average,
                layers=inner_layers(points, pieces, self.count) if losses.layers else [],
            )
        return self._known[id(frames)]


def normal_energy(normals: Tensor, average: Operator, stiffness: float) -> Tensor:
    """Bending of vertex normals (B, U, 3), (B,) J: stiffness times their squared Laplacians (paper eq. 4).

    average: over the neighbours of each and itself, which the Laplacian takes from it.
    """
    return stiffness * (normals - average(normals)).square().sum((-2, -1))
