"""The network of DeePSD: an outfit's mesh in, blend weights and blend shapes out (sections 4.2 and 9)."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn

from uvcloth.geometry.skinning import apply_transforms, blend_transforms
from uvcloth.methods.deepsd.config import DeePSDConfig
from uvcloth.methods.deepsd.outfit_graph import PackedOutfits
from uvcloth.methods.rig import shares
from uvcloth.physics.fabric import FEATURES

Branch = Literal["data", "physics"]

LEAST_WEIGHT = 1e-4
"""Blend weight from which a joint without any is changed, where the smooth weights are."""

TINY_WEIGHT = 1e-7
"""Added to every weight that is kept: joints of equal weights, all of them, keep equal ones."""

FIRST_SHAPE = 0.1
"""Factor on the last layer of new blend shapes: the smoothly skinned outfit is what training starts near."""


LEAST_DEVIATION = 0.05
"""Least standard deviation (metres, radians, shares) by which an input is divided."""

LEAST_SPREAD = 1e-6
"""Standard deviation up to which a layer's values are one value."""


class DeePSDNetwork(nn.Module):
    """Descriptor Phi, blend weights Omega, blend shapes Psi (of data) and chi (of physics), pose embedding.

    joints: of the skeleton, J.
    """

    input_mean: Tensor
    input_scale: Tensor
    pose_mean: Tensor
    pose_scale: Tensor

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
        for name, size in (("input", channels), ("pose", poses)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_scale", torch.ones(size))
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
        local = self._inputs(outfits)
        for layer in _linear_layers(self.convolutions):
            local = torch.relu(_convolved(layer, local, outfits))
        described = [local]
        if self.config.global_layers:
            described.append(self._pool(local, outfits)[outfits.outfit])
        if self.config.reads_fabric:
            described.append(outfits.fabric)
        return torch.cat(described, dim=1)

    def _inputs(self, outfits: PackedOutfits) -> Tensor:
        """Inputs of U points (U, C), standardized if the config says so."""
        return (self._read(outfits) - self.input_mean) / self.input_scale

    def _read(self, outfits: PackedOutfits) -> Tensor:
        """Inputs of U points (U, C), in metres and shares."""
        parts = [outfits.points, outfits.normals]
        if self.config.inputs == "body":
            parts += [outfits.offsets, outfits.smooth]
        return torch.cat(parts, dim=1)

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

    @torch.no_grad()
    def standardize(self, poses: Tensor, outfits: PackedOutfits) -> None:
        """Standardize what the network reads and, at the start, what its layers give, if the config says so.

        Zero mean and unit variance over the training's pose vectors (S, 3 J) and outfits (data-dependent
        initialization: Salimans and Kingma 2016, section 3, without its scale and offset as parameters).
        """
        config = self.config
        if not config.standardized:
            return
        for name, values in (("pose", poses), ("input", self._read(outfits))):
            for moment, value in zip(("mean", "scale"), _moments(values, LEAST_DEVIATION), strict=True):
                self.get_buffer(f"{name}_{moment}").copy_(value)
        local = self._inputs(outfits)
        for layer in _linear_layers(self.convolutions):
            local = torch.relu(_standardized(layer, _convolved(layer, local, outfits)))
        for layer in _linear_layers(self.pooled):
            local = torch.relu(_standardized(layer, layer(local)))
        if config.deformation == "blend_shapes":
            described = self.describe(outfits)
            for branch in self.branches.values():
                values = described
                for layer in list(_linear_layers(branch))[:-1]:
                    values = torch.relu(_standardized(layer, layer(values)))

    def joint_visibility(self, areas: Tensor) -> Tensor:
        """Weight (..., J) of each joint's rotation in the keys, 0 to 1; areas: (..., J) that it moves."""
        share = self.config.seen_joints
        return (areas / share - 0.5).clamp(0.0, 1.0) if share else torch.ones_like(areas)

    def embed(self, poses: Tensor, visibility: Tensor) -> Tensor:
        """Pose keys Theta (..., K) of pose vectors (..., 3 J): none negative, their sum 1 (or all are 0).

        visibility: (..., J), the weight of each joint's rotation, see `joint_visibility`.
        """
        if not len(self.embedding):
            return poses
        keys = (poses - self.pose_mean) / self.pose_scale * visibility.repeat_interleave(3, dim=-1)
        for layer in self.embedding:
            keys = torch.relu(layer(keys))
        return shares(keys)

    def embedding_layers(self, visibility: Tensor) -> tuple[tuple[Tensor, Tensor], ...]:
        """Weights and biases of the layers from pose vectors to keys; none where poses are the keys.

        visibility: (J,) of each joint to the keys. The first layer contains it, and mean and deviation.
        """
        layers = [(layer.weight.detach(), layer.bias.detach()) for layer in _linear_layers(self.embedding)]
        if not layers:
            return ()
        weight, bias = layers[0]
        weight = weight * (visibility.repeat_interleave(3) / self.pose_scale)
        layers[0] = weight, bias - weight @ self.pose_mean
        return tuple(layers)

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


def _convolved(layer: nn.Linear, values: Tensor, outfits: PackedOutfits) -> Tensor:
    """A layer and the mean of a graph convolution, which are linear and commute: on the fewer channels."""
    if layer.in_features < layer.out_features:
        return layer(outfits.convolve(values[None])[0])
    return outfits.convolve(layer(values)[None])[0]


def _moments(values: Tensor, least: float) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation, at least so much, of each channel of values (N, C): (C,) each."""
    return values.mean(0), values.std(0, correction=0).clamp(min=least)


def _standardized(layer: nn.Linear, values: Tensor) -> Tensor:
    """Change a layer so that its values (N, C) get zero mean and unit variance; returns them so."""
    mean, scale = _moments(values, LEAST_SPREAD)
    layer.weight.div_(scale[:, None])
    layer.bias.sub_(mean).div_(scale)
    return (values - mean) / scale


def _average(outfits: PackedOutfits, values: Tensor) -> Tensor:
    """Mean over the neighbours of each point and itself: (U, C) -> (U, C)."""
    return outfits.average(values[None])[0]


def _linears(widths: Sequence[int]) -> nn.ModuleList:
    return nn.ModuleList(nn.Linear(before, after) for before, after in pairwise(widths))


def _last(layers: nn.Module) -> nn.Linear:
    *_, last = _linear_layers(layers)
    return last


def _linear_layers(layers: nn.Module) -> Iterator[nn.Linear]:
    for layer in layers.children():
        assert isinstance(layer, nn.Linear)
        yield layer
