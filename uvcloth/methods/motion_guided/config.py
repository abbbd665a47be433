"""Settings of Motion-guided, and the networks and maps that they ask for."""

import math
from dataclasses import dataclass
from typing import Literal

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.files.settings import require_settings
from uvcloth.garments.garment import Garment
from uvcloth.methods.motion_guided.garment_maps import GarmentMaps, Skinning, garment_maps
from uvcloth.methods.motion_guided.latent import Dynamics, LinearSpace, ShapeSpace, Space
from uvcloth.methods.motion_guided.seeds import sample_seeds

RANGES: dict[str, tuple[float, float]] = {
    **dict.fromkeys(("size", "width", "hidden", "latent"), (1, 1024)),
    **dict.fromkeys(("stem", "motion_stem", "layers"), (1, 64)),
    **dict.fromkeys(("seeds", "near"), (1, 10_000)),
    "vertices": (1, 1_000_000),
    "dropout": (0.0, 0.99),
    "sigma": (0.0, 10.0),
}
"""Least and greatest value of every number."""


@dataclass(frozen=True)
class MotionGuidedConfig:
    """Inputs and sizes of the networks; `PRESETS["paper"]` is the method as published."""

    garment: str = "dress"
    """Garment of the networks, a template or a mesh file."""
    under: str = ""
    """Inner garment, a template or a mesh file, used instead of the body (section 6.5)."""
    size: int = 32
    """Height and width of the encoded maps (paper: 128); decoded maps are twice as large."""
    width: int = 32
    """Channels of maps at full size (paper: 128)."""
    stem: int = 2
    """Convolutions at full size before the encoders (paper: 4 on the garment)."""
    motion_stem: int = 2
    """Convolutions at full size on motion and contact (paper: 6)."""
    linear: bool = True
    """Linear space of shapes, fitted in closed form; else a convolutional autoencoder (paper)."""
    vertices: int = 3600
    """Number of vertices of the garment; set by training."""
    latent: int = 64
    """Length of a latent code."""
    hidden: int = 64
    """Width of the perceptron that displaces vertices."""
    layers: int = 4
    """Layers of the perceptron (paper: 6)."""
    norm: Literal["batch", "group", "instance", "none"] = "none"
    """Normalization layers (paper: instance, which hide how large a motion is)."""
    dropout: float = 0.0
    """Dropout before the last layer of the dynamic encoder."""
    upsample: Literal["transposed", "resize"] = "resize"
    """Enlargement in the decoder (paper: transposed)."""
    seeds: int = 581
    """Seed points on the body."""
    near: int = 64
    """Number of seeds, the closest at rest, whose kernels move a vertex (paper: all)."""
    skinning: Skinning = "smooth_lbs"
    """Skinning of a shape: smooth blend weights (smooth_lbs), or Gaussian kernels around the seeds, evaluated
    at rest (fixed) or at the displaced vertex (kernels, paper)."""
    local_offsets: bool = True
    """Encode offsets from the smooth LBS reference in its axes, their change, and pose and motion of that
    reference; else positions relative to every seed and the garment's motion, in world axes (paper)."""
    contact: bool = True
    """The next frame starts from the garment after contact; else from the prediction."""
    residual: bool = False
    """Collisions are resolved by a residual displacement map first (paper, section 5.1)."""
    sigma: float = 0.04
    """Metres within which a seed's plane pushes the garment."""

    def __post_init__(self) -> None:
        """Raises InputError for values out of range, maps that cannot be halved down to 2 x 2, and
        inputs that do not fit."""
        require_settings(self, RANGES)
        if self.linear and not self.local_offsets:
            raise InputError("--no-local-offsets: a linear space needs these, add --no-linear")
        if self.size < 4 or self.size & (self.size - 1):
            raise InputError(f"--size {self.size}: has to be a power of two, 4 or more")

    @property
    def widths(self) -> tuple[int, ...]:
        """Channels of the encoders' levels, which halve the maps down to 2 x 2."""
        levels = int(math.log2(self.size)) - 1
        return tuple(self.width * min(2**level, 8) for level in range(levels))

    def shape_space(self) -> Space:
        """The first stage, untrained."""
        if self.linear:
            return LinearSpace(size=self.size, latent=self.latent, vertices=self.vertices)
        return ShapeSpace(
            seeds=self.seeds,
            width=self.width,
            widths=self.widths,
            stem=self.stem,
            latent=self.latent,
            hidden=self.hidden,
            layers=self.layers,
            norm=self.norm,
            upsample=self.upsample,
            local_offsets=self.local_offsets,
            size=self.size,
        )

    def dynamics(self) -> Dynamics:
        """The second stage, untrained."""
        return Dynamics(
            features=(3 if self.linear else self.width) + (3 if self.local_offsets else 0),
            motion=12 if self.local_offsets else 6,
            seeds=self.seeds,
            width=self.width,
            widths=self.widths,
            stem=self.motion_stem,
            latent=self.latent,
            norm=self.norm,
            dropout=self.dropout,
        )

    def maps(self, garment: Garment, body: Body, under: Garment | None = None) -> GarmentMaps:
        """A garment on a body, or over an inner garment, as input of the networks."""
        seeds = sample_seeds(body, self.seeds, under)
        return garment_maps(garment, seeds, self.size, self.near, self.skinning)


PRESETS: dict[str, MotionGuidedConfig] = {
    "fast": MotionGuidedConfig(),
    "gpu": MotionGuidedConfig(),
    "paper": MotionGuidedConfig(
        size=128,
        width=128,
        stem=4,
        motion_stem=6,
        hidden=128,
        layers=6,
        norm="instance",
        upsample="transposed",
        near=581,
        skinning="kernels",
        linear=False,
        local_offsets=False,
        residual=True,
    ),
    "tiny": MotionGuidedConfig(size=8, width=8, hidden=16, seeds=61, near=16),
}
