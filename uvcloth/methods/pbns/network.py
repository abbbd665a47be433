"""The network of PBNS: pose embedding, blend shapes and blend weights (eq. 1 and 2)."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from uvcloth.files.settings import require_settings

SHARPNESS = 100.0
"""Of blend weights while they are trained: a step of 0.01 moves about a hundredth of the weight."""


LEAST_WEIGHT = 0.01
"""Start of a joint without weight, in units of SHARPNESS, so that it can gain some."""


FIRST_SHAPE = 1e-3
"""Standard deviation of the blend shapes before training, metres."""


@dataclass(frozen=True)
class PBNSConfig:
    """Sizes of the network."""

    width: int = 256
    """Width of the pose embedding's layers, and number of blend shapes."""
    layers: int = 4
    """Layers of the pose embedding."""
    influences: int = 4
    """Joints that may move a vertex, the strongest (paper: all): four are what every engine plays."""

    def __post_init__(self) -> None:
        """Raises InputError for invalid sizes."""
        require_settings(self, {"width": (1, 4096), "layers": (1, 64), "influences": (1, 1000)})


class PBNSNetwork(nn.Module):
    """Pose embedding, blend shapes and blend weights for N vertices on J joints.

    Vertices at one place at rest (texture seams) are one to the network: owner (N,) int64 says which of U.
    rest: (N, 3) m. poses: (M, 3 J) the training poses as vectors, which give the embedding its range. shapes:
    number of blend shapes, the width by default.
    """

    rest: Tensor
    owner: Tensor
    strongest: Tensor
    poses: Tensor

    def __init__(
        self,
        config: PBNSConfig,
        vertices: int,
        unique: int,
        joints: int,
        poses: int,
        shapes: int | None = None,
    ) -> None:
        super().__init__()
        shapes = config.width if shapes is None else shapes
        widths = [3 * joints, *[config.width] * (config.layers - 1), shapes]
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.shapes = nn.Parameter(FIRST_SHAPE * torch.randn(shapes, 3 * unique))
        influences = min(config.influences, joints)
        self.sharp_weights = nn.Parameter(torch.zeros(unique, influences))
        self.register_buffer("strongest", torch.zeros(unique, influences, dtype=torch.int64))
        self.register_buffer("rest", torch.zeros(vertices, 3))
        self.register_buffer("owner", torch.zeros(vertices, dtype=torch.int64))
        self.register_buffer("poses", torch.zeros(poses, 3 * joints))

    @torch.no_grad()
    def used(self) -> dict[str, Tensor]:
        """The state without the blend shapes that no training pose has: their units never rise above zero."""
        state, last = self.state_dict(), f"layers.{len(self.layers) - 1}"
        kept = (self.embed(self.poses) > 0).any(0) if len(self.poses) else slice(None)
        rows = ("shapes", f"{last}.weight", f"{last}.bias")
        return {name: tensor[kept] if name in rows else tensor for name, tensor in state.items()}

    @property
    def joints(self) -> int:
        """Of the skeleton, J."""
        return self.poses.shape[1] // 3

    def start_from(self, weights: Tensor) -> None:
        """Take over the strongest of blend weights (U, J)."""
        shares, self.strongest = weights.topk(self.sharp_weights.shape[1], dim=1)
        positive = SHARPNESS * shares / shares.sum(1, keepdim=True)
        sharp = torch.where(positive > 1.0, positive - 1.0, positive.clamp(min=LEAST_WEIGHT).log())
        with torch.no_grad():
            self.sharp_weights.copy_(sharp / SHARPNESS)

    def forward(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        """Deformation (B, U, 3) m of some poses (B, 3 J), and the blend weights (U, J) that pose it."""
        with torch.autocast(poses.device.type, enabled=False):
            return self.deform(poses), self.unique_weights()

    def linears(self) -> Iterator[nn.Linear]:
        """The layers of the pose embedding."""
        for layer in self.layers:
            assert isinstance(layer, nn.Linear)
            yield layer

    def embed(self, poses: Tensor) -> Tensor:
        """High-level pose embedding f_X (paper eq. 2): pose vectors (B, 3 J) -> (B, width), none negative."""
        for layer in self.layers:
            poses = torch.relu(layer(poses))
        return poses

    def deform(self, poses: Tensor) -> Tensor:
        """Deformation dT of the rest shape, f_X(theta) D (paper eq. 2): (B, 3 J) -> (B, U, 3), m."""
        return (self.embed(poses) @ self.shapes).view(len(poses), -1, 3)

    def blend_weights(self) -> Tensor:
        """(N, J), rows sum to one; no row has more than the config's influences."""
        return self.unique_weights()[self.owner]

    def unique_weights(self) -> Tensor:
        """Blend weights of the U vertices: (U, J). What is trained is made positive by ELU and normalized."""
        positive = nn.functional.elu(SHARPNESS * self.sharp_weights) + 1.0
        shares = positive / positive.sum(1, keepdim=True)
        return shares.new_zeros(len(shares), self.joints).scatter_add(1, self.strongest, shares)
