"""Recurrent networks as a rig: blend shapes of the garments, and their weights over a motion."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.methods.recurrent.body_motion import body_motion
from uvcloth.methods.recurrent.network import TICK
from uvcloth.methods.recurrent.scaled import ScaledNetwork
from uvcloth.methods.rig import BlendRig


@dataclass(frozen=True)
class RecurrentRig(BlendRig):
    """A rig whose K blend shapes, those of one garment after those of another, swing.

    networks: of the garments. heads: (J, 3) m, joints at rest.
    """

    networks: tuple[ScaledNetwork, ...]
    heads: Tensor

    @property
    def memory(self) -> int:
        """Numbers that are remembered, those of one network after those of another."""
        return sum(network.memory for network in self.networks)

    def known(self) -> Tensor:
        """Weights (M, K) of the training in which each was the least or the greatest.

        Where dynamics are larger, they are as much farther from their mean.
        """
        most = max(len(each.network.extremes) for each in self.networks)
        rows = []
        for network in self.networks:
            extremes = network.network.extremes
            spread = torch.lerp(extremes.mean(0), extremes, max(1.0, network.dynamics))
            rows.append(spread[torch.arange(most) % len(spread)])
        return torch.cat(rows, dim=1)

    def step(self, joints: Tensor, hidden: Tensor, seconds: Tensor | float) -> tuple[Tensor, Tensor]:
        """One frame of B rollouts: weights (B, K) and the next memory (B, H).

        joints: (B, 3, J, 3, 4), transforms of this frame and, before it, of the last two. hidden: (B, H).
        seconds: since the last frame.
        """
        motion = body_motion(joints, self.heads, 1.0 / seconds)
        sizes = [network.memory for network in self.networks]
        steps = [
            each.step(motion, some, seconds / TICK)
            for each, some in zip(self.networks, hidden.split(sizes, dim=1), strict=True)
        ]
        return torch.cat([weights for weights, _ in steps], 1), torch.cat([after for _, after in steps], 1)

    def play(self, transforms: Tensor, fps: float) -> Tensor:
        """Weights (F, K) over a motion (F, J, 3, 4) of a body that stood still before."""
        if not len(transforms):
            return transforms.new_zeros(0, len(self.shapes))
        joints = torch.cat([transforms[:1].expand(2, -1, -1, -1), transforms]).unfold(0, 3, 1).movedim(-1, 1)
        first = body_motion(joints[:1], self.heads, fps)
        hidden = torch.cat([network.at_rest(first) for network in self.networks], dim=1)
        played = []
        for frame in joints.split(1):
            weights, hidden = self.step(frame, hidden, 1.0 / fps)
            played.append(weights)
        return torch.cat(played)
