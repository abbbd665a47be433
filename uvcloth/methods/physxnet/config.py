"""Settings of PhysXNet; every idea beyond the paper is one field, so that an ablation is one line."""

from dataclasses import dataclass
from typing import Literal

from uvcloth.bodies.frames import HISTORY
from uvcloth.errors import InputError
from uvcloth.files.settings import require_settings

RANGES: dict[str, tuple[float, float]] = {
    "size": (1, 1024),
    "width": (1, 1024),
    "levels": (1, 10),
    "dropout": (0.0, 0.99),
    "history": (0, 16),
    "reach": (0.0, 1e6),
}
"""Least and greatest value of every number."""

LIKE = {"shirt": "tops", "jacket": "tops", "skirt": "dress"}
"""By template, the one whose motion serves it where a network was not trained on it."""


@dataclass(frozen=True)
class PhysXNetConfig:
    """Inputs, outputs and sizes of the network; `PRESETS["paper"]` is the method as published."""

    size: int = 64
    """Height and width of every map, a multiple of 2 to the number of levels."""
    width: int = 32
    """Channels of the first encoder level; every next level doubles them, up to eight times."""
    levels: int = 4
    """Encoder and decoder levels; fewer have a smaller receptive field."""
    norm: Literal["batch", "group", "instance"] = "group"
    """Normalization layers."""
    upsample: Literal["transposed", "resize"] = "resize"
    """Enlargement in the decoders: transposed convolution (paper), or convolution and bilinear resize."""
    dropout: float = 0.0
    """Share of the deepest level's channels dropped in training."""
    frame: Literal["world", "body"] = "body"
    """Axes of motion and offsets: the world's (paper) or the rest axes that turn with the body."""
    acceleration: Literal["plain", "specific_force"] = "specific_force"
    """Acceleration (paper) or specific force: acceleration minus gravity, which also tells where down is."""
    motion: bool = True
    """Velocity and acceleration of the body in three frames (paper)."""
    pose: bool = True
    """Three more channels: position of the body point relative to the root joint, minus that at rest."""
    anchor: Literal["body", "smooth_lbs"] = "smooth_lbs"
    """The origin of offsets: the texel's body point (paper) or the smoothly skinned garment."""
    history: int = 0
    """Number of last predicted offset maps in the input; 0: no memory."""
    scaling: Literal["min_max", "mean_std"] = "mean_std"
    """Each channel to [-1, 1] by its extremes (paper), or to zero mean and unit deviation."""
    reach: float = 4.0
    """Limit of scaled inputs, for motion far from the training. 0: no limit (paper)."""
    centre: Literal["channel", "texel"] = "texel"
    """Predicted offsets are measured from the middle of their channel (paper) or the mean of each texel."""
    templates: tuple[str, ...] = ("tops", "bottoms", "dress")
    """Templates with a decoder."""

    def __post_init__(self) -> None:
        """Raises InputError for values out of range, and if the levels do not halve the size evenly."""
        require_settings(self, RANGES)
        if not self.templates or len(set(self.templates)) < len(self.templates):
            raise InputError("--templates: has to be one template or more, each once")
        if not (self.motion or self.pose):
            raise InputError("--no-motion --no-pose: leave the network without input from the body")
        if self.size % 2**self.levels:
            raise InputError(
                f"--size {self.size}: has to be a multiple of {2**self.levels} for --levels {self.levels}"
            )

    @property
    def inputs(self) -> int:
        """Channels of the network's input."""
        channels = (HISTORY * 6 if self.motion else 0) + (3 if self.pose else 0)
        return channels + self.history * 3 * len(self.templates)

    def decoder(self, template: str | None) -> str | None:
        """The template whose decoder serves a garment of this one: its own, else that of the one LIKE it.

        None where there is no such decoder.
        """
        candidates = (template, LIKE.get(template or ""))
        return next((candidate for candidate in candidates if candidate in self.templates), None)


PRESETS: dict[str, PhysXNetConfig] = {
    "default": PhysXNetConfig(),
    "gpu": PhysXNetConfig(),
    "paper": PhysXNetConfig(
        size=256,
        width=64,
        norm="batch",
        upsample="transposed",
        frame="world",
        acceleration="plain",
        pose=False,
        anchor="body",
        scaling="min_max",
        reach=0.0,
        centre="channel",
    ),
    "tiny": PhysXNetConfig(size=32, width=8, levels=3, dropout=0.4, history=2),
}
