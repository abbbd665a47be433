"""The network of DeePSD: an outfit's mesh in, blend weights and blend shapes out (sections 4.2 and 9)."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn

from uvcloth.garments.fabric import FEATURES
from uvcloth.geometry.skinning import apply_transforms, blend_transforms
from uvcloth.methods.deepsd.config import DeePSDConfig
from uvcloth.methods.deepsd.outfit_graph import PackedOutfits
from uvcloth.methods.rig import shares

Branch = Literal["data", "physics"]

LEAST_WEIGHT = 1e-4
"""Blend weight from which a joint without any is changed, where the smooth weights are."""

TINY_WEIGHT = 1e-7
"""Added to every weight that is kept: joints of equal weights, all of them, keep equal ones."""

FIRST_SHAPE = 0.1
"""Factor on the last layer of new blend shapes: the smoothly skinned outfit is what training starts near."""


class DeePSDNetwork(nn.Module):
    """Descriptor Phi, blend weights Omega, blend shapes Psi (of data) and chi (of physics), pose embedding.

    joints: of the skeleton, J.
    """

    def __init__(self, config: DeePSDConfig, joints: int) -> None:
        super().__init__()
        self.config, self.joints = config, joints
        channels = 6 if config.inputs == "mesh" else 9 + joints
        self.convolutions = _linears([channels, *config.convolutions])
        local = config.convolutions[-1]
        self.pooled = _linears([local, *config.global_layers])
        described = local + (config.global_layers[-1] if config.global_layers else 0)
        described += FEATURES if config.reads_fabric else 0
        learned = config.blend_weights != "smooth"
        self.weights = _linears([described, *config.weight_layers, joints] if learned else [])
        poses = 3 * joints
        self.embedding = _linears([poses, *config.pose_layers, config.keys] if config.keys else [])
        keys = config.keys or poses
        if config.deformation == "offsets":
            widths = [described + keys, *config.shape_layers, 3]
        else:
            widths = [described, *config.shape_layers, 3 * keys]
        branches = () if config.deformation == "none" else ("data", "physics")
        self.branches = nn.ModuleDict({branch: _linears(widths) for branch in branches})
        with torch.no_grad():
            for layers in self.branches.values():
                _last(layers).weight.mul_(FIRST_SHAPE)
                _last(layers).bias.zero_()
            if config.blend_weights == "changed":
                _last(self.weights).weight.mul_(FIRST_SHAPE)
                _last(self.weights).bias.zero_()

    def describe(self, outfits: PackedOutfits) -> Tensor:
        """Descriptors Phi of U points, local and of their outfit, and their fabric: (U, F)."""
        parts = [outfits.points, outfits.normals]
        if self.config.inputs == "body":
            parts += [outfits.offsets, outfits.smooth]
        local = torch.cat(parts, dim=1)
        for layer in self.convolutions:
            local = torch.relu(outfits.convolve(layer(local)[None])[0])
        described = [local]
        if self.config.global_layers:
            described.append(self._pool(local, outfits)[outfits.outfit])
        if self.config.reads_fabric:
            described.append(outfits.fabric)
        return torch.cat(described, dim=1)

    def _pool(self, local: Tensor, outfits: PackedOutfits) -> Tensor:
        """Descriptors of outfits (B, G) from those of their points (U, F)."""
        pooled = local
        for layer in self.pooled:
            pooled = torch.relu(layer(pooled))
        # ReLU leaves nothing below zero, so a maximum may start there.
        start = pooled.new_zeros(len(outfits.sizes), pooled.shape[1])
        index = outfits.outfit[:, None].expand_as(pooled)
        return start.scatter_reduce(0, index, pooled, "amax", include_self=True)

    def blend_weights(self, described: Tensor, outfits: PackedOutfits) -> Tensor:
        """Blend weights Omega of U points (U, J): rows sum to one, at most the config's influences each."""
        if self.config.blend_weights == "smooth":
            return self._strongest(outfits.smooth)
        scores = self._head(self.weights, described, outfits)
        if self.config.blend_weights == "changed":
            scores = scores + (outfits.smooth + LEAST_WEIGHT).log()
        return self._strongest(torch.softmax(scores, dim=1))

    def _strongest(self, shares: Tensor) -> Tensor:
        """The config's influences of each point, less the strongest of those left out (U, J).

        A joint comes and goes with no weight, so that neighbours of other joints have no seam between them.
        """
        if self.config.influences >= self.joints:
            return shares
        strongest, index = shares.topk(self.config.influences + 1, dim=1)
        kept = strongest[:, :-1] - strongest[:, -1:] + TINY_WEIGHT
        return torch.zeros_like(shares).scatter(1, index[:, :-1], kept / kept.sum(1, keepdim=True))

    def shapes(self, described: Tensor, outfits: PackedOutfits, branch: Branch) -> Tensor:
        """Blend shapes of U points by a branch, Psi or chi: (U, K, 3) m."""
        return self._head(self.branches[branch], described, outfits).view(len(described), -1, 3)

    def embed(self, poses: Tensor) -> Tensor:
        """Pose keys Theta (B, K) of pose vectors (B, 3 J): none negative, their sum 1 (or all are 0)."""
        if not len(self.embedding):
            return poses
        keys = poses
        for layer in self.embedding:
            keys = torch.relu(layer(keys))
        return shares(keys)

    def linears(self) -> Iterator[nn.Linear]:
        """The layers of the pose embedding, none where the pose itself is the keys."""
        for layer in self.embedding:
            assert isinstance(layer, nn.Linear)
            yield layer

    def offsets(self, described: Tensor, keys: Tensor, branch: Branch) -> Tensor:
        """Deformation (B, U, 3) m of points described (U, F) in B poses, without blend shapes (Table 1)."""
        both = (len(keys), len(described))
        rows = torch.cat(
            [described.expand(*both, -1), keys[:, None].expand(*both, -1)],
            dim=-1,
        )
        for index, layer in enumerate(self.branches[branch].children()):
            rows = layer(rows if index == 0 else torch.relu(rows))
        return rows

    def _head(self, layers: nn.Module, described: Tensor, outfits: PackedOutfits) -> Tensor:
        """Layers on the descriptors of points, the last one linear."""
        for index, layer in enumerate(layers.children()):
            described = layer(described if index == 0 else torch.relu(described))
            if self.config.graph_heads:
                described = _average(outfits, described)
        return described


def pose(points: Tensor, deformation: Tensor, weights: Tensor, transforms: Tensor) -> Tensor:
    """Posed points (B, U, 3) m (paper eq. 1): rest (U, 3), deformation (B, U, 3), weights (U, J)."""
    return apply_transforms(blend_transforms(weights, transforms), points + deformation)


def _average(outfits: PackedOutfits, values: Tensor) -> Tensor:
    """Mean over the neighbours of each point and itself: (U, C) -> (U, C)."""
    return outfits.average(values[None])[0]


def _linears(widths: Sequence[int]) -> nn.ModuleList:
    return nn.ModuleList(nn.Linear(before, after) for before, after in pairwise(widths))


def _last(layers: nn.Module) -> nn.Linear:
    last = list(layers.children())[-1]
    assert isinstance(last, nn.Linear)
    return last
