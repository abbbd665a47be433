"""Scaled dynamics: the part of a recurrent network's answer that is due to motion, made smaller or larger.

Beside the network runs a second one, the very same, whose body stands still in the pose of every frame. What
the two differ by is the motion's part; Neural Cloth Simulation (Bertiche et al., 2022) scales that of a
separate encoder.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.methods.recurrent.body_motion import held_still
from uvcloth.methods.recurrent.network import RecurrentNetwork

HELD_STEPS, HELD_TICKS = 8, 2.0
"""Steps of the network held still in a frame, and their length: longer ones go back and forth."""


@dataclass(frozen=True)
class ScaledNetwork:
    """A network of which `dynamics` times the part that is due to motion is left: 1 leaves it as it is."""

    network: RecurrentNetwork
    dynamics: float = 1.0

    @property
    def memory(self) -> int:
        """Numbers that are remembered: where dynamics are scaled, those of the network held still as well."""
        return self.network.unit.hidden_size * (1 if self.dynamics == 1.0 else 2)

    def at_rest(self, motion: Tensor) -> Tensor:
        """Memory (B, M) of bodies that have stood still in the poses of a motion (B, C)."""
        hidden = self.network.at_rest(self.network.normalized(held_still(motion)))
        return hidden.repeat(1, self.memory // hidden.shape[1])

    def step(self, motion: Tensor, memory: Tensor, ticks: Tensor | float) -> tuple[Tensor, Tensor]:
        """One frame: motion (B, C), memory (B, M) -> weights (B, K) of the shapes, the next memory.

        ticks: time since the last frame, in TICK.
        """
        inputs = self.network.normalized(motion)
        if self.dynamics == 1.0:
            return self.network.step(inputs, memory, ticks)
        hidden, held = memory.chunk(2, dim=1)
        moving, hidden = self.network.step(inputs, hidden, ticks)
        inputs = self.network.normalized(held_still(motion))
        for _ in range(HELD_STEPS):
            still, held = self.network.step(inputs, held, HELD_TICKS)
        return still + self.dynamics * (moving - still), torch.cat([hidden, held], dim=1)
