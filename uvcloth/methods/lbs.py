"""Linear blend skinning, the baselines: a garment that follows the body without any dynamics."""

from dataclasses import dataclass

from torch import Tensor

from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.skinning import skin


@dataclass(frozen=True)
class SkinnedGarment:
    """points: (N, 3) garment vertices at rest, m. weights: (N, J) the blend weights that move them."""

    points: Tensor
    weights: Tensor


@dataclass(frozen=True)
class LinearBlendSkinning:
    """A Method without memory. smooth: weights diffused over the garment, so that skirts do not split."""

    name: str
    smooth: bool
    autoregressive: bool = False
    quasi_static: bool = True

    def unsupported_reason(self, outfit: Outfit) -> str:
        """It dresses everything."""
        return ""

    def start(self, outfit: Outfit, frames: BodyFrames) -> tuple[SkinnedGarment, ...]:
        """Take the blend weights of every garment."""
        return tuple(
            SkinnedGarment(garment.mesh.vertices, garment.smooth_weights if self.smooth else garment.weights)
            for garment in outfit.garments
        )

    def step(
        self, state: tuple[SkinnedGarment, ...], frames: BodyFrames
    ) -> tuple[tuple[SkinnedGarment, ...], tuple[Tensor, ...]]:
        """Garment vertices (B, N, 3) of each garment, m."""
        transforms = frames.transforms[:, -1]
        return state, tuple(skin(worn.points, worn.weights, transforms) for worn in state)

    def observe(
        self, state: tuple[SkinnedGarment, ...], garments: tuple[Tensor, ...]
    ) -> tuple[SkinnedGarment, ...]:
        """It remembers nothing."""
        return state


@dataclass(frozen=True)
class LBSConfig:
    """smooth: False is `lbs` (closest body vertex at rest), True is `lbs_smooth` (diffused weights)."""

    smooth: bool = False

    def create(self) -> LinearBlendSkinning:
        """Build the method."""
        return LinearBlendSkinning("lbs_smooth" if self.smooth else "lbs", self.smooth)
