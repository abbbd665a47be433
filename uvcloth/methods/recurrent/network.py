"""Recurrent networks of garments: the body's motion in, weights of blend shapes out, memory between.

All garments share the layers that read and remember motion; each enters with a bias of its own and leaves
with a layer of its own.
"""

import copy
from collections.abc import Iterator, Mapping
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

FIRST_SPREAD = 0.1
"""Standard deviation of the first bias of a garment before the training: garments are told apart by it."""

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


@dataclass(frozen=True)
class GarmentSize:
    """Numbers of a garment: vertices of its cage and of its mesh, and corners that carry each of these."""

    cage: int
    vertices: int
    around: int = 3


class Trunk(nn.Module):
    """Layers that garments share: a gated recurrent unit (Cho et al., 2014) between two perceptrons."""

    def __init__(self, config: RecurrentConfig, joints: int) -> None:
        super().__init__()
        width = config.width
        self.memory = config.memory
        self.motion = nn.Linear(motion_size(joints), width)
        self.given = nn.Linear(condition_size(joints), width, bias=False)
        self.enter = nn.Sequential(nn.ReLU(), nn.Dropout(config.dropout), nn.Linear(width, width), nn.ReLU())
        self.unit = nn.GRU(width, width, batch_first=True)
        self.leave = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU())

    def forward(self, inputs: Tensor, told: Tensor) -> Tensor:
        """Features (B, T, H) of sequences of T frames, TICK apart.

        inputs: (B, T, C), normalized. told: (B, H), what the first layer is given besides.
        """
        entered = self.entered(inputs, told[:, None])
        hidden = self.unit(entered)[0] if self.memory else torch.zeros_like(entered)
        features: Tensor = self.leave(torch.cat([entered, hidden], dim=-1))
        return features

    def entered(self, inputs: Tensor, told: Tensor) -> Tensor:
        """The unit's input (..., H) of normalized motion (..., C)."""
        entered: Tensor = self.enter(self.motion(inputs.clamp(-STRANGEST, STRANGEST)) + told)
        return entered

    def step(
        self, inputs: Tensor, told: Tensor, hidden: Tensor, ticks: Tensor | float
    ) -> tuple[Tensor, Tensor]:
        """One frame: motion (B, C), hidden (B, H) -> features (B, H), the next hidden.

        ticks: time since the last frame, in TICK. The gate z keeps the share z of the state in one tick,
        hence z^ticks in several: h' = n + z^ticks (h - n).
        """
        entered = self.entered(inputs, told)
        if self.memory:
            of_input, of_hidden, input_bias, hidden_bias = self.unit.all_weights[0]
            given = nn.functional.linear(entered, of_input, input_bias).chunk(3, dim=-1)
            kept = nn.functional.linear(hidden, of_hidden, hidden_bias).chunk(3, dim=-1)
            reset, gate = torch.sigmoid(given[0] + kept[0]), torch.sigmoid(given[1] + kept[1])
            wanted = torch.tanh(given[2] + reset * kept[2])
            hidden = wanted + gate**ticks * (hidden - wanted)
        return self.leave(torch.cat([entered, hidden], dim=-1)), hidden


class GarmentPart(nn.Module):
    """The part of one garment of N vertices: its first bias, its last layer, and its blend shapes.

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

    def __init__(self, config: RecurrentConfig, joints: int, size: GarmentSize) -> None:
        super().__init__()
        motion, given = motion_size(joints), condition_size(joints)
        self.bias = nn.Parameter(torch.randn(config.width) * FIRST_SPREAD)
        self.weigh = nn.Linear(config.width, config.shapes)
        self.register_buffer("center", torch.zeros(motion))
        self.register_buffer("spread", torch.ones(motion))
        self.register_buffer("usual", torch.zeros(given))
        self.register_buffer("scale", torch.zeros(given))
        self.register_buffer("mean", torch.zeros(size.cage, 3))
        self.register_buffer("shapes", torch.zeros(config.shapes, size.cage, 3))
        self.register_buffer("extremes", torch.zeros(2 * config.shapes, config.shapes))
        self.register_buffer("corners", torch.zeros(size.vertices, size.around, dtype=torch.int64))
        self.register_buffer("shares", torch.zeros(size.vertices, size.around))

    def require_corners(self) -> None:
        """Raise ValueError unless the corners are vertices of the cage."""
        if len(self.corners) and not 0 <= self.corners.min() <= self.corners.max() < len(self.mean):
            raise ValueError(f"a corner is out of range, expected 0 to {len(self.mean) - 1}")


class RecurrentNetwork(nn.Module):
    """The network of one garment: the trunk and its part."""

    def __init__(self, trunk: Trunk, part: GarmentPart) -> None:
        super().__init__()
        self.trunk, self.part = trunk, part

    @property
    def remembered(self) -> int:
        """Length H of the hidden state."""
        return self.trunk.unit.hidden_size

    def normalized(self, motion: Tensor) -> Tensor:
        """Body motion (..., C) in standard deviations from its mean in the training."""
        return (motion - self.part.center) / self.part.spread

    def told(self, condition: Tensor) -> Tensor:
        """The share (..., H) of the garment and a condition (..., S), see `condition`, in the first layer."""
        told: Tensor = self.trunk.given((condition - self.part.usual) * self.part.scale) + self.part.bias
        return told

    def forward(self, inputs: Tensor, condition: Tensor) -> Tensor:
        """Weights (B, T, K) of the shapes over sequences (B, T, C) of normalized motion, TICK apart."""
        weights: Tensor = self.part.weigh(self.trunk(inputs, self.told(condition)))
        return weights

    def conditioned(self, condition: Tensor) -> "RecurrentNetwork":
        """The network for one condition (S,), which is in its bias: `step` and rigs need no other input."""
        network = copy.deepcopy(self)
        with torch.no_grad():
            network.part.bias.copy_(self.told(condition))
            network.part.usual.copy_(condition)
        return network

    def step(self, inputs: Tensor, hidden: Tensor, ticks: Tensor | float) -> tuple[Tensor, Tensor]:
        """One frame in the usual condition: motion (B, C), hidden (B, H) -> weights (B, K), the next hidden.

        ticks: time since the last frame, see `Trunk.step`.
        """
        features, hidden = self.trunk.step(inputs, self.part.bias, hidden, ticks)
        return self.part.weigh(features), hidden

    def at_rest(self, inputs: Tensor) -> Tensor:
        """Hidden state (B, H) of bodies that have stood still: normalized motion (B, C) of standing still."""
        hidden = inputs.new_zeros(len(inputs), self.remembered)
        for _ in range(STILL_STEPS if self.trunk.memory else 0):
            hidden = self.step(inputs, hidden, 1.0)[1]
        return hidden


class RecurrentNetworks(nn.Module):
    """The networks of several garments, by name."""

    def __init__(self, config: RecurrentConfig, joints: int, garments: Mapping[str, GarmentSize]) -> None:
        super().__init__()
        self.trunk = Trunk(config, joints)
        self.parts = nn.ModuleDict(
            {name: GarmentPart(config, joints, size) for name, size in garments.items()}
        )

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the garments."""
        return iter(self.parts)

    def __contains__(self, name: str) -> bool:
        """True for the name of a garment."""
        return name in self.parts

    def of(self, name: str) -> RecurrentNetwork:
        """The network of a garment."""
        return RecurrentNetwork(self.trunk, self.part(name))

    def part(self, name: str) -> GarmentPart:
        """The part of a garment."""
        part = self.parts[name]
        assert isinstance(part, GarmentPart)
        return part

    def forward(self, inputs: Mapping[str, Tensor], conditions: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Weights (B, T, K) of the shapes of each garment, from (B, T, C) and (B, S): one pass for all."""
        told = [self.of(name).told(conditions[name]) for name in inputs]
        features = self.trunk(torch.cat(list(inputs.values())), torch.cat(told))
        counts = [len(each) for each in inputs.values()]
        return {
            name: self.part(name).weigh(some)
            for name, some in zip(inputs, features.split(counts), strict=True)
        }

    @property
    def read_fabrics(self) -> bool:
        """True if all were trained on several fabrics."""
        return len(self.parts) > 0 and all(bool(self.part(name).scale[-FEATURES:].any()) for name in self)
