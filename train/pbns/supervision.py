"""Supervision of PBNS beside the energies: the outfit at rest on cages in some of the poses."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.files.options import Between
from uvcloth.garments.garment import Outfit
from uvcloth.motion.poses import PoseDatabase
from uvcloth.physics.fabric import Fabric

from ..settled import SETTLED_FILE, settled_outfit

HELD_SHARE = 8
"""Training poses that are settled for each validation pose."""


@dataclass(frozen=True)
class SupervisionConfig:
    """Supervision by the outfit at rest, as `physics` simulates it on cages."""

    settled: Annotated[int, Between(0, 100_000)] = 250
    """Training poses in which the outfit is settled on cages at first; 0: train on physics alone (paper)."""
    supervision: Annotated[float, Between(0, 1e9)] = 100.0
    """Weight of the settled outfit, millijoules per millimetre of mean distance."""


@dataclass(frozen=True)
class SettledPoses:
    """The outfit at rest in S poses of a split: rows (S,) of its poses, vertices (S, N, 3) m."""

    rows: Tensor
    vertices: Tensor

    def some(self, drawn: Tensor) -> "SettledPoses":
        """Some of them, (n,)."""
        return SettledPoses(self.rows[drawn], self.vertices[drawn])


@dataclass(frozen=True)
class Supervision:
    """The settled poses of the training and of the validation."""

    config: SupervisionConfig
    training: SettledPoses
    held: SettledPoses


def settle_poses(
    config: SupervisionConfig, outfit: Outfit, fabric: Fabric, database: PoseDatabase, run: Path
) -> Supervision | None:
    """Settle an outfit of a fabric in some poses of both splits, kept in the run; None for no poses.

    Raises InputError as `settled_outfit` does, and if the cloth flew apart in every training pose.
    """
    if not config.settled:
        return None
    outfit = replace(outfit, garments=tuple(replace(garment, fabric=fabric) for garment in outfit.garments))
    splits = {split: database.of(split).transforms(outfit.body.skeleton) for split in ("train", "validation")}
    counts = {"train": config.settled, "validation": max(1, config.settled // HELD_SHARE)}
    rows = {split: _spread(len(poses), counts[split]) for split, poses in splits.items()}
    wanted = torch.cat([splits[split][rows[split]] for split in splits])
    settled = settled_outfit(outfit, wanted, run / SETTLED_FILE)
    trained = settled.rows < len(rows["train"])
    if not trained.any():
        raise InputError(f"{run / SETTLED_FILE}: the cloth flew apart in every pose; train with --settled 0")
    first, second = settled.rows[trained], settled.rows[~trained] - len(rows["train"])
    return Supervision(
        config,
        SettledPoses(rows["train"][first], settled.vertices[trained]),
        SettledPoses(rows["validation"][second], settled.vertices[~trained]),
    )


def _spread(count: int, most: int) -> Tensor:
    """At most so many of `count` rows, evenly spread."""
    return torch.linspace(0, count - 1, min(count, most)).long()
