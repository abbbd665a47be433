"""The objective of DeePSD's first phase: trains all but the branch of physics on outfits in motion."""

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from uvcloth.checkpoint import save_checkpoint
from uvcloth.geometry.records import CPU
from uvcloth.methods.deepsd.config import DeePSDConfig
from uvcloth.methods.deepsd.method import DeePSD, deepsd_checkpoint
from uvcloth.methods.deepsd.network import Branch, DeePSDNetwork
from uvcloth.methods.deepsd.outfit_graph import pack
from uvcloth.methods.method import require_supported

from ..loop import Objective
from .dataset import OutfitDataset, OutfitFrames
from .losses import DataLosses, data_losses
from .prediction import DrawnPoses, describe, pose_outfits
from .start import TrainedStart
from .validation import Validation

MEASURED_OUTFITS = 32
"""Outfits over which the layers of a new network are standardized, at most."""

KEPT_POSES = 512
"""Pose vectors of the training that a checkpoint keeps, at most."""


class DeePSDObjective(Objective):
    """The part that both phases share: the outfits, their validation, and the checkpoint."""

    branches: tuple[Branch, ...]

    def __init__(self, config: DeePSDConfig, dataset: OutfitDataset, device: torch.device = CPU) -> None:
        self.config, self.dataset, self.device = config, dataset, device
        self.validation = Validation(dataset.held, device)

    @property
    def samples(self) -> Tensor:
        """The training outfits, or their frames, see `OutfitDataset.samples`."""
        return self.dataset.samples

    def picture(self, net: Any) -> Tensor:
        """A few validation outfits: (H, W, 3) uint8."""
        return self.validation.picture(net, self.branches)

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        """Write the checkpoint of the network."""
        vectors = self.dataset.vectors
        some = torch.linspace(0, len(vectors) - 1, min(KEPT_POSES, len(vectors))).long()
        method = DeePSD(self.config, net, vectors[some], self.branches)
        dataset = self.dataset
        notes = (
            notes
            | self._notes()
            | {
                "outfits": {
                    "train": len({id(frames.outfit) for frames in dataset.training}),
                    "validation": len(dataset.held),
                },
                "people": len({person for person in dataset.data.clips["train"].values() if person}),
            }
        )
        save_checkpoint(deepsd_checkpoint(method, dataset.body, dataset.data, notes), run)

    def _notes(self) -> dict[str, Any]:
        """Settings of the phase, for the checkpoint."""
        return {}


class DataObjective(DeePSDObjective):
    """The error against simulated outfits, and priors that fade after the first epoch (eq. 3, section 9).

    start: a network to train further, of its own config, instead of a new one.
    """

    branches = ("data",)

    def __init__(
        self,
        config: DeePSDConfig,
        losses: DataLosses,
        dataset: OutfitDataset,
        device: torch.device = CPU,
        start: TrainedStart | None = None,
    ) -> None:
        if start is not None:
            require_supported(start.method, dataset.training[0].outfit)
            config, dataset = start.method.config, replace(dataset, data=start.joined(dataset.data))
        super().__init__(config, dataset, device)
        self.losses, self.start = losses, start
        self.frames_seen = torch.zeros((), dtype=torch.int64)

    def networks(self) -> dict[str, nn.Module]:
        """The network, whose branch of physics is not trained."""
        net = self._new() if self.start is None else copy.deepcopy(self.start.method.network)
        net.requires_grad_(True)
        if "physics" in net.branches:
            net.branches["physics"].requires_grad_(False)
        return {"net": net}

    def _new(self) -> DeePSDNetwork:
        """A network whose inputs and layers are standardized over the training outfits."""
        net = DeePSDNetwork(self.config, len(self.dataset.body.skeleton.names))
        outfits = self.dataset.training
        some = torch.linspace(0, len(outfits) - 1, min(MEASURED_OUTFITS, len(outfits))).long().tolist()
        measured = pack([outfits[index].graph for index in some], CPU, self.config.spread)
        net.standardize(self.dataset.vectors, measured)
        return net

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        """The losses of some outfits in some of their frames."""
        outfits, frames = self.dataset.draw(rows.cpu(), self.losses.poses_per_outfit)
        poses = DrawnPoses(
            torch.stack([o.vectors[indices] for o, indices in zip(outfits, frames, strict=True)]).to(
                self.device
            ),
            torch.stack([o.transforms[indices] for o, indices in zip(outfits, frames, strict=True)]).to(
                self.device
            ),
        )
        graphs = [outfit.graph for outfit in outfits]
        points = self._points(outfits)
        whole = self.config.graph_heads or self.losses.points == 1
        described = describe(networks["net"], graphs, self.device, None if whole else points)
        dropout = self.losses.pose_dropout
        predicted = pose_outfits(networks["net"], described, poses, self.branches, dropout)
        truths = [
            outfit.vertices[indices][:, some].to(self.device)
            for outfit, indices, some in zip(outfits, frames, points, strict=True)
        ]
        epochs = float(self.frames_seen) / len(self.dataset.rows)
        parts = data_losses(predicted, truths, graphs, points, self.losses, epochs)
        self.frames_seen += rows.numel() * self.losses.poses_per_outfit
        yield "net", torch.stack(list(parts.values())).sum(), parts

    def _points(self, outfits: Sequence[OutfitFrames]) -> list[Tensor]:
        """The points of each outfit that a step compares: all where heads see neighbours."""
        share = 1.0 if self.config.graph_heads else self.losses.points
        sizes = [len(outfit.graph.points) for outfit in outfits]
        if share == 1.0:
            return [torch.arange(size) for size in sizes]
        return [torch.randperm(size)[: max(1, round(share * size))].sort().values for size in sizes]

    def validate(self, net: Any) -> dict[str, float]:
        """Mean vertex error, mm, and measures of the cloth, see `Validation.measure`."""
        return self.validation.measure(net, self.branches)

    def _notes(self) -> dict[str, Any]:
        return {"losses": asdict(self.losses)} | ({"start": self.start.notes} if self.start else {})

    def settings(self) -> dict[str, Any]:
        """Settings that must not change within a run."""
        return {
            "method": asdict(self.config) | ({"start": self.start.fingerprint} if self.start else {}),
            "losses": asdict(self.losses),
            "drawing": {"balanced": self.dataset.balanced},
            "data": asdict(self.dataset.data),
        }

    def memory(self) -> dict[str, Tensor]:
        """The frames seen so far, by which the priors fade."""
        return {"seen": self.frames_seen}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Restore the state that `memory` gave."""
        self.frames_seen = memory["seen"].clone()
