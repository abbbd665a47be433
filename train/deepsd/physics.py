"""The objective of DeePSD's second phase: it trains only the branch chi, on physics (section 4.3)."""

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import torch
from torch import Tensor, nn

from uvcloth.errors import InputError
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.records import CPU
from uvcloth.geometry.skeleton import joint_transforms
from uvcloth.methods.deepsd.method import BRANCHES
from uvcloth.methods.deepsd.outfit_graph import pack
from uvcloth.methods.method import require_supported

from .dataset import OutfitDataset, OutfitFrames
from .losses import MILLI, PhysicsLosses
from .objective import DeePSDObjective
from .outfit_energy import OutfitEnergy
from .prediction import Described, DrawnPoses, PosedOutfit, describe, pose_outfits
from .start import TrainedStart
from .validation import POSES

KEPT_POINTS = 1_000_000
"""Points whose descriptors are kept in memory, at most: about 2.2 GB."""


class PhysicsObjective(DeePSDObjective):
    """Edges, bending, collision and size of the deformation by chi, in poses drawn at random.

    batch: outfits in a step. Raises InputError for a network without shapes to train, or for other bodies.
    """

    branches = BRANCHES

    def __init__(
        self,
        start: TrainedStart,
        losses: PhysicsLosses,
        dataset: OutfitDataset,
        batch: int,
        device: torch.device = CPU,
    ) -> None:
        config = start.method.config
        if config.deformation == "none":
            raise InputError(
                "--physics-only: a network without a deformation has nothing to train on physics"
            )
        require_supported(start.method, dataset.training[0].outfit)
        super().__init__(config, replace(dataset, data=start.joined(dataset.data)), device)
        self.start, self.losses = start, losses
        drawn = losses.poses_drawn * (batch if len(dataset.training) == 1 else 1)
        self.energy = OutfitEnergy(losses, dataset.body, max(drawn, POSES), device)
        self.kept: dict[int, tuple[Tensor, Tensor]] = {}
        self.keeps = sum(len(outfit.graph.points) for outfit in dataset.training) <= KEPT_POINTS

    def networks(self) -> dict[str, nn.Module]:
        """The network that it starts from, of which chi alone is trained; from none where it was not yet."""
        net = copy.deepcopy(self.start.method.network).requires_grad_(False)
        net.branches["physics"].requires_grad_(True)
        if "physics" not in self.start.method.branches:
            last = list(net.branches["physics"].children())[-1]
            with torch.no_grad():
                for parameter in last.parameters():
                    parameter.zero_()
        return {"net": net}

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        """The energies of some outfits in drawn poses, mJ: the mean over outfits and poses."""
        outfits, frames = self.dataset.draw(rows.cpu(), self.losses.poses_drawn)
        poses = self._poses(outfits, frames)
        described = self._described(networks["net"], outfits)
        predicted = pose_outfits(networks["net"], described, poses)
        energies = self.energy(outfits, predicted, list(poses.transforms), described.packed.average)
        parts = {name: MILLI * energy.mean() for name, energy in energies.items()}
        yield "net", torch.stack(list(parts.values())).sum(), parts

    def _poses(self, outfits: Sequence[OutfitFrames], frames: Sequence[Tensor]) -> DrawnPoses:
        """The poses of those frames, or as many of any training frame, put on the outfits' bodies."""
        if self.losses.pose_source == "own":
            vectors = [outfit.vectors[indices] for outfit, indices in zip(outfits, frames, strict=True)]
            transforms = [outfit.transforms[indices] for outfit, indices in zip(outfits, frames, strict=True)]
        else:
            drawn = [torch.randint(len(self.dataset.rows), (len(indices),)) for indices in frames]
            vectors = [self.dataset.vectors[rows] for rows in drawn]
            transforms = [
                joint_transforms(
                    outfit.body.skeleton,
                    self.dataset.rotations[rows],
                    outfit.body.skeleton.heads[:1].expand(len(rows), 3),
                )
                for outfit, rows in zip(outfits, drawn, strict=True)
            ]
        return DrawnPoses(torch.stack(vectors).to(self.device), torch.stack(transforms).to(self.device))

    @torch.no_grad()
    def _described(self, net: Any, outfits: Sequence[OutfitFrames]) -> Described:
        """Outfits as the network reads them, which no longer changes: kept from one visit to the next."""
        if not self.keeps:
            return describe(net, [outfit.graph for outfit in outfits], self.device)
        for outfit in outfits:
            if id(outfit) not in self.kept:
                read = describe(net, [outfit.graph], self.device)
                self.kept[id(outfit)] = read.features, read.weights
        features, weights = zip(*(self.kept[id(outfit)] for outfit in outfits), strict=True)
        packed = pack([outfit.graph for outfit in outfits], self.device)
        return Described(packed, torch.cat(features), torch.cat(weights))

    def validate(self, net: Any) -> dict[str, float]:
        """Energy, mJ, vertex error where it is known, and measures, see `Validation.measure`."""
        return self.validation.measure(net, self.branches, self._total)

    def _total(self, frames: OutfitFrames, outfit: PosedOutfit, transforms: Tensor) -> Tensor:
        """The energy of an outfit, mJ: () mean over its poses."""
        average = pack([frames.graph], self.device).average
        energies = self.energy([frames], [outfit], [transforms], average)
        return MILLI * torch.stack([energy.mean() for energy in energies.values()]).sum()

    def _notes(self) -> dict[str, Any]:
        return {"physics": asdict(self.losses), "start": self.start.notes}

    def settings(self) -> dict[str, Any]:
        """Settings that must not change within a run."""
        return {
            "method": asdict(self.config) | {"start": self.start.fingerprint},
            "losses": asdict(self.losses),
            "drawing": {"balanced": self.dataset.balanced},
            "data": asdict(self.dataset.data),
            "garments": {outfit.name: fingerprint(outfit.graph.points) for outfit in self.dataset.training},
        }
