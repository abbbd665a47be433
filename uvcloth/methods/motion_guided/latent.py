"""The networks of Motion-guided: a latent space of garment shapes, and the encoder that moves through it."""

import math
from collections.abc import Callable
from itertools import pairwise

import torch
from torch import Tensor, nn

from uvcloth.methods.motion_guided.descriptor import Forces, RelativePositions, SeedForces
from uvcloth.methods.motion_guided.seeds import PARTS
from uvcloth.methods.physxnet.unet import KERNEL, normalization, upsampling

SLOPE = 0.2
"""Negative slope of the leaky ReLUs between convolutions."""

FREQUENCIES = 8
"""Number of frequencies in the positional encoding of texture coordinates."""

FIRST_RADIUS = 0.05
"""Radius of every kernel before training, m."""

DISPLACEMENT_SCALE = 0.05
"""Metres of displacement for an output of 1 of the network's last layer."""


def uv_encoding(uvs: Tensor) -> Tensor:
    """Sines and cosines of texture coordinates (N, 2): (N, 4 * FREQUENCIES)."""
    angles = uvs[:, :, None] * math.pi * 2.0 ** torch.arange(FREQUENCIES, device=uvs.device)
    return torch.cat([angles.sin(), angles.cos()], dim=2).flatten(1)


def _block(layer: nn.Module, channels: int, norm: str) -> nn.Sequential:
    """A layer, its normalization and a leaky ReLU."""
    return nn.Sequential(layer, normalization(norm, channels), nn.LeakyReLU(SLOPE, inplace=True))


def _stem(width: int, layers: int, norm: str) -> nn.Sequential:
    """The layers after a first convolution: its normalization, and more layers of the same size."""
    return nn.Sequential(
        normalization(norm, width),
        nn.LeakyReLU(SLOPE, inplace=True),
        *(_block(nn.Conv2d(width, width, 3, padding=1), width, norm) for _ in range(layers - 1)),
    )


class Encoder(nn.Module):
    """Maps (B, C, H, W) -> latent codes (B, Z), halving the maps down to 2 x 2."""

    def __init__(
        self, inputs: int, widths: tuple[int, ...], latent: int, norm: str, dropout: float = 0.0
    ) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            *(
                _block(nn.Conv2d(before, after, KERNEL, stride=2, padding=1), after, norm)
                for before, after in zip((inputs, *widths[:-1]), widths, strict=True)
            )
        )
        self.dropout = nn.Dropout(dropout)
        self.code = nn.Linear(4 * widths[-1], latent)

    def forward(self, maps: Tensor) -> Tensor:
        """Maps (B, C, H, W) -> codes (B, Z)."""
        return self.code(self.dropout(self.layers(maps).flatten(1)))


class Space(nn.Module):
    """A generative space: positions -> features -> code, and code -> displacements at rest (section 4.2).

    local_offsets: its input are offsets from the smooth LBS reference, less their mean (shift) and divided by
    their deviation (scale), instead of positions relative to every seed.
    """

    shift: Tensor
    scale: Tensor

    def __init__(self, *, size: int, local_offsets: bool) -> None:
        super().__init__()
        self.local_offsets = local_offsets
        self.register_buffer("shift", torch.zeros(3, size, size))
        self.register_buffer("scale", torch.ones(()))
        self.log_radii = nn.Parameter(torch.full((len(PARTS),), math.log(FIRST_RADIUS)))

    @property
    def radii(self) -> Tensor:
        """Radius of each body part's kernels (parts,), m."""
        return self.log_radii.exp()

    def centred(self, offsets: Tensor) -> Tensor:
        """Offsets from the smooth LBS reference (B, 3, H, W), m, as the network reads them."""
        return (offsets - self.shift) / self.scale

    def features(self, *maps: Tensor) -> Tensor:
        """S(M^P): (B, features, H, W).

        Of offsets from the smooth LBS reference (B, 3, H, W), m; or, as published, of positions (B, 3, H, W),
        the charts' mask (1, 1, H, W) and seeds (B, S, 3).
        """
        raise NotImplementedError

    def encode(self, features: Tensor) -> Tensor:
        """Features (B, features, H, W) -> codes (B, Z)."""
        raise NotImplementedError

    def decode(self, codes: Tensor, sample: Callable[[Tensor], Tensor], places: Tensor) -> Tensor:
        """Codes (B, Z) -> displacements (B, N, 3) in the local frames at rest, m.

        sample: reads decoded maps (B, 4 H W, C) at the vertices: (B, N, C). places: (N, P) encoded UVs.
        """
        raise NotImplementedError


class ShapeSpace(Space):
    """The space as published, a convolutional autoencoder.

    widths: channels of the encoder's levels; the decoder mirrors them and enlarges once more.
    """

    def __init__(
        self,
        *,
        seeds: int,
        width: int,
        widths: tuple[int, ...],
        stem: int,
        latent: int,
        hidden: int,
        layers: int,
        norm: str,
        upsample: str,
        local_offsets: bool,
        size: int,
    ) -> None:
        super().__init__(size=size, local_offsets=local_offsets)
        self.first = nn.Conv2d(3, width, 3, padding=1) if local_offsets else RelativePositions(seeds, width)
        self.stem = _stem(width, stem, norm)
        self.encoder = Encoder(width, widths, latent, norm)
        deeper = widths[::-1]
        self.unfold = nn.Linear(latent, 4 * deeper[0])
        self.decoder = nn.Sequential(
            *(
                _block(upsampling(upsample, before, after), after, norm)
                for before, after in zip(deeper, (*deeper[1:], width), strict=True)
            ),
            upsampling(upsample, width, width),
        )
        sizes = (width + 4 * FREQUENCIES, *[hidden] * (layers - 1))
        self.vertex = nn.Sequential(
            *(
                nn.Sequential(nn.Linear(before, after), nn.LeakyReLU(inplace=True))
                for before, after in pairwise(sizes)
            ),
            nn.Linear(sizes[-1], 3),
        )

    def features(self, *maps: Tensor) -> Tensor:
        """S(M^P): (B, width, H, W), see `Space`."""
        return self.stem(self.first(self.centred(*maps)) if self.local_offsets else self.first(*maps))

    def encode(self, features: Tensor) -> Tensor:
        """Features (B, width, H, W) -> codes (B, Z)."""
        return self.encoder(features)

    def decode(self, codes: Tensor, sample: Callable[[Tensor], Tensor], places: Tensor) -> Tensor:
        """Codes (B, Z) -> displacements (B, N, 3), m, by maps and a perceptron, see `Space`."""
        maps = self.decoder(self.unfold(codes).unflatten(1, (-1, 2, 2)))
        samples = sample(maps.flatten(2).transpose(1, 2))
        return DISPLACEMENT_SCALE * self.vertex(
            torch.cat([samples, places.expand(len(codes), -1, -1)], dim=2)
        )


class LinearSpace(Space):
    """A space without hidden layers: codes are principal components of the garment's shapes.

    Its features are the centred offsets from the smooth LBS reference; it decodes the displacement of every
    vertex, without an intermediate map, which would be inexact along its seams.
    """

    def __init__(self, *, size: int, latent: int, vertices: int) -> None:
        super().__init__(size=size, local_offsets=True)
        self.code = nn.Linear(3 * size**2, latent)
        self.decoder = nn.Linear(latent, 3 * vertices)

    def features(self, *maps: Tensor) -> Tensor:
        """The centred offsets (B, 3, H, W)."""
        return self.centred(*maps)

    def encode(self, features: Tensor) -> Tensor:
        """Centred offsets (B, 3, H, W) -> codes (B, Z)."""
        return self.code(features.flatten(1))

    def decode(self, codes: Tensor, sample: Callable[[Tensor], Tensor], places: Tensor) -> Tensor:
        """Codes (B, Z) -> displacements (B, N, 3), m; neither sample nor places are needed."""
        return DISPLACEMENT_SCALE * self.decoder(codes).unflatten(1, (-1, 3))


class Dynamics(nn.Module):
    """The dynamic encoder (section 5): the previous garment, its motion and its contact -> the next code."""

    motion_scale: Tensor

    def __init__(
        self,
        *,
        features: int,
        motion: int,
        seeds: int,
        width: int,
        widths: tuple[int, ...],
        stem: int,
        latent: int,
        norm: str,
        dropout: float,
    ) -> None:
        super().__init__()
        self.motion = nn.Conv2d(motion, width, 3, padding=1)
        self.forces = SeedForces(seeds, width)
        self.stem = _stem(width, stem, norm)
        self.encoder = Encoder(width + features, widths, latent, norm, dropout)
        self.register_buffer("motion_scale", torch.ones(motion, 1, 1))

    def change(self, motion: Tensor, forces: Forces, normals: Tensor, pixels: Tensor) -> Tensor:
        """E_t of velocities and accelerations (B, C, H, W), forces (B, P, S) and normals (B, S, 3)."""
        pushed = self.forces(forces, normals, pixels, motion.shape[-1])
        return self.stem(self.motion(motion / self.motion_scale) + pushed)

    def forward(self, features: Tensor, change: Tensor) -> Tensor:
        """Z_t: (B, Z)."""
        return self.encoder(torch.cat([features, change], dim=1))
