"""Energies of outfits on their bodies in many poses: what physics minimizes (paper eq. 4 to 6)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.opened import ColliderOpening
from uvcloth.bodies.posing import posed_skin
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.operators import Operator
from uvcloth.geometry.records import to_device
from uvcloth.physics.energies import (
    ClothEnergies,
    attachment_energy,
    cloth_energies,
    collision_energy,
    join_energies,
)
from uvcloth.physics.fabric import JERSEY

from ..batched_collision import LayerPair, PosedParts, inner_layers
from .dataset import OutfitFrames
from .losses import PhysicsLosses
from .prediction import PosedOutfit


@dataclass(frozen=True)
class RestOutfit:
    """An outfit at rest as the energies need it.

    touches: (U,) int32, the parts of the body that each point may touch; opening: of these parts.
    """

    cloth: ClothEnergies
    touches: Tensor
    opening: ColliderOpening
    layers: list[LayerPair]


class OutfitEnergy:
    """Energies of outfits on bodies of the mesh of one, in `count` poses at most."""

    def __init__(self, losses: PhysicsLosses, body: Body, count: int, device: torch.device) -> None:
        self.losses, self.count, self.device = losses, count, device
        self._fabric = replace(JERSEY, stretch=losses.stretch, bend=losses.bend)
        self._parts = PosedParts(body, count, device)
        self._known: dict[int, RestOutfit] = {}

    def __call__(
        self,
        frames: Sequence[OutfitFrames],
        outfits: Sequence[PosedOutfit],
        transforms: Sequence[Tensor],
        average: Operator,
    ) -> dict[str, Tensor]:
        """Energies of B outfits in Q poses each, (Q, B) J.

        transforms: (Q, J, 3, 4) of the body of each. average: over neighbours, of all points in a row.
        """
        losses = self.losses
        resting = [self._resting(each) for each in frames]
        cloth = join_energies([each.cloth for each in resting])
        posed = torch.cat([outfit.posed for outfit in outfits], dim=1)
        normals = vertex_normals(posed, cloth.faces)
        energies = {"stretch": cloth.springs(posed)}
        if losses.bend:
            energies["bend"] = cloth.folds(posed)
        if losses.roughness:
            energies["roughness"] = cloth.roughness(normals, average, losses.roughness)
        met, small = [], []
        pieces = normals.detach().split(cloth.vertex_counts, dim=1)
        for index, rest in enumerate(resting):
            self._parts.move(posed_skin(frames[index].body, transforms[index]), rest.opening)
            met.append(self._collision(rest, outfits[index].posed, pieces[index]))
            small.append(attachment_energy(outfits[index].deformation["physics"], losses.small))
        return {**energies, "collision": torch.stack(met, dim=-1), "small": torch.stack(small, dim=-1)}

    def _collision(self, rest: RestOutfit, posed: Tensor, normals: Tensor) -> Tensor:
        """Collision (Q,) J of an outfit (Q, U, 3) m with the body as it was moved, and of its layers."""
        thickness = self.losses.thickness
        planes = self._parts.planes(posed, rest.touches, thickness)
        distances = [planes.distance(posed), *(layer.distance(posed, normals) for layer in rest.layers)]
        met = [collision_energy(distance, thickness, self.losses.collision) for distance in distances]
        return torch.stack(met).sum(0)

    def _resting(self, frames: OutfitFrames) -> RestOutfit:
        """The outfit at rest, computed at its first visit."""
        if id(frames) not in self._known:
            points = frames.graph.points.to(self.device)
            faces = [faces.to(self.device) for faces in frames.graph.faces]
            pieces = [each.unique(return_inverse=True) for each in faces]
            touches, opening = self._parts.met_by(points, frames.body)
            cloth = cloth_energies(frames.graph.points, torch.cat(frames.graph.faces), self._fabric)
            self._known[id(frames)] = RestOutfit(
                cloth=to_device(cloth, self.device),
                touches=touches,
                opening=opening,
                layers=inner_layers(points, pieces, self.count) if self.losses.layers else [],
            )
        return self._known[id(frames)]
