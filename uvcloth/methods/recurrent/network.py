"""Recurrent network of a garment: the body's motion in, weights of blend shapes out, memory between."""

import copy
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from uvcloth.files.settings import require_settings
from uvcloth.methods.recurrent.body_motion import motion_size
from uvcloth.methods.recurrent.condition import condition_size
from uvcloth.physics.fabric import FEATURES

TICK = 1.0 / 30.0
"""Seconds between two frames of training."""

STRANGEST = 6.0
"""Standard deviations beyond which an input is cut off: no motion of the training is there."""

STILL_STEPS = 45
"""Steps in which the hidden state comes to rest on a body that stands still."""


@dataclass(frozen=True)
class RecurrentConfig:
    """Sizes of the network."""

    shapes: int = 64
    """Blend shapes of a garment."""
    width: int = 192
    """Width of all layers and of the hidden state."""
    memory: bool = True
    """False: the hidden state stays zero, and a frame depends on the body's motion in it alone."""
    dropout: float = 0.1
    """Share of the first layer that is left out at random in training."""

    def __post_init__(self) -> None:
        """Raises InputError for invalid sizes."""
        require_settings(self, {"shapes": (1, 1000), "width": (1, 4096), "dropout": (0, 0.9)})


class RecurrentNetwork(nn.Module):
    """A gated recurrent unit (Cho et al., 2014) between two perceptrons, for one garment of N vertices.

    The garment at rest is the sum of its own mesh, a mean (n, 3) m and K shapes (K, n, 3) m by their weights;
    both are on the n vertices of a cage and carried to the N by corners (N, A) and shares (N, A).
    center, spread: (C,) mean and standard deviation of the motion. usual, scale: (S,) mean of the condition,
    and one over its standard deviation, 0 where it was always the same. extremes: (2 K, K) weights in the
    training frames in which each of them is the least or the greatest.
    """

    center: Tensor
    spread: Tensor
    usual: Tensor
    scale: Tensor
    mean: Tensor
    shapes: Tensor
    corners: Tensor
    shares: Tensor
    extremes: Tensor

    def __init__(
        self, config: RecurrentConfig, joints: int, cage: int, vertices: int, around: int = 3
    ) -> None:
        super().__init__()
        width, size, given = config.width, motion_size(joints), condition_size(joints)
        self.memory = config.memory
        self.motion = nn.Linear(size, width)
        self.given = nn.Linear(given, width, bias=False)
        self.enter = nn.Sequential(nn.ReLU(), nn.Dropout(config.dropout), nn.Linear(width, width), nn.ReLU())
        self.unit = nn.GRU(width, width, batch_first=True)
        self.leave = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), nn.Linear(width, config.shapes))
        self.register_buffer("center", torch.zeros(size))
        self.register_buffer("spread", torch.ones(size))
        self.register_buffer("usual", torch.zeros(given))
        self.register_buffer("scale", torch.zeros(given))
        self.register_buffer("mean", torch.zeros(cage, 3))
        self.register_buffer("shapes", torch.zeros(config.shapes, cage, 3))
        self.register_buffer("extremes", torch.zeros(2 * config.shapes, config.shapes))
        self.register_buffer("corners", torch.zeros(vertices, around, dtype=torch.int64))
        self.register_buffer("shares", torch.zeros(vertices, around))

    def normalized(self, motion: Tensor) -> Tensor:
        """Body motion (..., C) in standard deviations from its mean in the training."""
        return (motion - self.center) / self.spread

    def forward(self, inputs: Tensor, condition: Tensor) -> Tensor:
        """Weights (B, T, K) of the shapes over sequences of T frames, TICK apart.

        inputs: (B, T, C), normalized. condition: (B, S), see `condition`.
        """
        told = self._told(condition)[:, None]
        entered = self.enter(self.motion(inputs.clamp(-STRANGEST, STRANGEST)) + told)
        hidden = self.unit(entered)[0] if self.memory else torch.zeros_like(entered)
        weights: Tensor = self.leave(torch.cat([entered, hidden], dim=-1))
        return weights

    def conditioned(self, condition: Tensor) -> "RecurrentNetwork":
        """The network for one condition (S,), which is in its bias: `step` and rigs need no other input."""
        network = copy.deepcopy(self)
        with torch.no_grad():
            network.motion.bias.add_(self._told(condition))
            network.usual.copy_(condition)
        return network

    def _told(self, condition: Tensor) -> Tensor:
        """The share of a condition (..., S) in the first layer: (..., H)."""
        told: Tensor = self.given((condition - self.usual) * self.scale)
        return told

    def step(self, inputs: Tensor, hidden: Tensor, ticks: Tensor | float) -> tuple[Tensor, Tensor]:
        """One frame in the usual condition: motion (B, C), hidden (B, H) -> weights (B, K), the next hidden.

        ticks: time since the last frame, in TICK. The gate z keeps the share z of the state in one tick,
        hence z^ticks in several: h' = n + z^ticks (h - n).
        """
        entered = self.enter(self.motion(inputs.clamp(-STRANGEST, STRANGEST)))
        if self.memory:
            of_input, of_hidden, input_bias, hidden_bias = self.unit.all_weights[0]
            given = nn.functional.linear(entered, of_input, input_bias).chunk(3, dim=-1)
            kept = nn.functional.linear(hidden, of_hidden, hidden_bias).chunk(3, dim=-1)
            reset, gate = torch.sigmoid(given[0] + kept[0]), torch.sigmoid(given[1] + kept[1])
            wanted = torch.tanh(given[2] + reset * kept[2])
            hidden = wanted + gate**ticks * (hidden - wanted)
        return self.leave(torch.cat([entered, hidden], dim=-1)), hidden

    def at_rest(self, inputs: Tensor) -> Tensor:
        """Hidden state (B, H) of bodies that have stood still: normalized motion (B, C) of standing still."""
        hidden = inputs.new_zeros(len(inputs), self.unit.hidden_size)
        for _ in range(STILL_STEPS if self.memory else 0):
            hidden = self.step(inputs, hidden, 1.0)[1]
        return hidden

    def require_corners(self) -> None:
        """Raise ValueError unless the corners are vertices of the cage."""
        if len(self.corners) and not 0 <= self.corners.min() <= self.corners.max() < len(self.mean):
            raise ValueError(f"a corner is out of range, expected 0 to {len(self.mean) - 1}")


class RecurrentNetworks(nn.ModuleDict):
    """The networks of several garments, by name."""

    def forward(self, name: str, inputs: Tensor, condition: Tensor) -> Tensor:
        """Weights (B, T, K) of the shapes of a garment, see `RecurrentNetwork.forward`."""
        weights: Tensor = self.of(name)(inputs, condition)
        return weights

    def of(self, name: str) -> RecurrentNetwork:
        """The network of a garment."""
        network = self[name]
        assert isinstance(network, RecurrentNetwork)
        return network

    @property
    def read_fabrics(self) -> bool:
        """True if all were trained on several fabrics."""
        return len(self) > 0 and all(bool(self.of(name).scale[-FEATURES:].any()) for name in self)
