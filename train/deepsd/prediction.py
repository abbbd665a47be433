"""Outfits in drawn poses as DeePSD predicts them: a pass over several outfits, and what of it is trained."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from uvcloth.methods.deepsd.method import BRANCHES
from uvcloth.methods.deepsd.network import Branch, pose
from uvcloth.methods.deepsd.outfit_graph import OutfitGraph, PackedOutfits, pack


@dataclass(frozen=True)
class DrawnPoses:
    """Q poses of each of B outfits, vectors (B, Q, 3 J) and joint transforms (B, Q, J, 3, 4)."""

    vectors: Tensor
    transforms: Tensor


@dataclass(frozen=True)
class PosedOutfit:
    """An outfit in Q poses, n of its points.

    weights: (n, J). deformation: (Q, n, 3) m at rest, of each branch. posed: (Q, n, 3) m.
    """

    weights: Tensor
    deformation: dict[Branch, Tensor]
    posed: Tensor


@dataclass(frozen=True)
class Described:
    """B outfits, U points in all, as the network reads them. features: (U, F). weights: (U, J)."""

    packed: PackedOutfits
    features: Tensor
    weights: Tensor


def describe(
    net: Any, graphs: Sequence[OutfitGraph], device: torch.device, rows: Sequence[Tensor] | None = None
) -> Described:
    """Read outfits; rows: the points of each that go on, all without; the descriptor sees all."""
    packed = pack(graphs, device, net.config.spread)
    features = net.describe(packed)
    if rows is not None:
        features, packed = _kept(features, packed, rows)
    return Described(packed, features, net.blend_weights(features, packed))


def pose_outfits(
    net: Any,
    described: Described,
    poses: DrawnPoses,
    branches: Sequence[Branch] = BRANCHES,
    dropout: float = 0.0,
) -> list[PosedOutfit]:
    """Outfits in their poses with the deformation of some branches (paper eq. 1).

    dropout: probability that a pose's keys do not see a joint.
    """
    packed = described.packed
    weights = described.weights.split(packed.sizes)
    visibility = net.joint_visibility(packed.joint_areas)[:, None].expand(-1, poses.vectors.shape[1], -1)
    keys = net.embed(poses.vectors, torch.dropout(visibility, dropout, dropout > 0))
    by_branch = {branch: deformations(net, described.features, packed, keys, branch) for branch in branches}
    points = packed.points.split(packed.sizes)
    outfits = []
    for index, rest in enumerate(points):
        branch_offsets = {branch: each[index] for branch, each in by_branch.items()}
        deformation = sum(branch_offsets.values(), rest.new_zeros(()))
        posed = pose(rest, deformation, weights[index], poses.transforms[index])
        outfits.append(PosedOutfit(weights[index], branch_offsets, posed))
    return outfits


def deformations(
    net: Any, described: Tensor, packed: PackedOutfits, keys: Tensor, branch: Branch
) -> list[Tensor]:
    """Deformations (Q, n, 3) m of each outfit by a branch, of points described (U, F), keys (B, Q, K).

    Blend shapes are linear in the last layer: only their sums weighed by the keys are formed.
    """
    if net.config.deformation == "none":
        return [described.new_zeros(keys.shape[1], size, 3) for size in packed.sizes]
    if net.config.deformation == "offsets":
        parts = described.split(packed.sizes)
        return [net.offsets(part, part_keys, branch) for part, part_keys in zip(parts, keys, strict=True)]
    *hidden, last = net.branches[branch].children()
    for layer in hidden:
        described = layer(described)
        if net.config.graph_heads:
            described = packed.average(described[None])[0]
        described = torch.relu(described)
    if net.config.graph_heads:
        # The mean over neighbours is linear too: taken here, it is that of the last layer's.
        described = packed.average(described[None])[0]
    count = keys.shape[2]
    weighed = torch.einsum("bqk,kch->bqch", keys, last.weight.view(count, 3, -1)).flatten(1, 2)
    bias = torch.einsum("bqk,kc->bqc", keys, last.bias.view(count, 3)).flatten(1)
    parts = described.split(packed.sizes)
    return [
        torch.addmm(part_bias, part, matrix.T).unflatten(1, (-1, 3)).transpose(0, 1)
        for part, matrix, part_bias in zip(parts, weighed, bias, strict=True)
    ]


def _kept(described: Tensor, packed: PackedOutfits, rows: Sequence[Tensor]) -> tuple[Tensor, PackedOutfits]:
    """Descriptors and outfits of some points alone; their neighbours are no longer known."""
    starts = torch.tensor([0, *packed.sizes[:-1]]).cumsum(0).tolist()
    places = torch.cat([indices + start for indices, start in zip(rows, starts, strict=True)]).to(
        described.device
    )
    taken = {
        name: getattr(packed, name)[places]
        for name in ("outfit", "points", "normals", "offsets", "smooth", "fabric")
    }
    return described[places], replace(packed, sizes=tuple(map(len, rows)), **taken)
