"""Linear blend skinning, the baselines: a garment that follows the body without any dynamics."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.records import to_device
from uvcloth.geometry.skinning import skin
from uvcloth.methods.method import Method, MethodEntry, Traits


@dataclass(frozen=True)
class SkinnedGarment:
    """points: (N, 3) garment vertices at rest, m. weights: (N, J) the blend weights that move them."""

    points: Tensor
    weights: Tensor


@dataclass(frozen=True)
class LinearBlendSkinning(Method):
    """A quasi-static method. smooth: weights diffused over the garment, so that skirts do not split."""

    name: str
    smooth: bool
    traits = Traits(quasi_static=True, is_baseline=True)

    def prepare(self, outfit: Outfit, device: torch.device) -> tuple[SkinnedGarment, ...]:
        """The blend weights of every garment."""
        skinned = (
            SkinnedGarment(garment.mesh.vertices, garment.smooth_weights if self.smooth else garment.weights)
            for garment in outfit.garments
        )
        return tuple(to_device(garment, device) for garment in skinned)

    def step(
        self, prepared: tuple[SkinnedGarment, ...], state: tuple[()], frames: BodyFrames
    ) -> tuple[tuple[()], tuple[Tensor, ...]]:
        """Garment vertices (B, N, 3) of each garment, m."""
        transforms = frames.transforms[:, -1]
        return state, tuple(skin(garment.points, garment.weights, transforms) for garment in prepared)


@dataclass(frozen=True)
class LBSConfig:
    """smooth: False is `lbs` (closest body vertex at rest), True is `lbs_smooth` (diffused weights)."""

    smooth: bool = False


def create_lbs(config: LBSConfig) -> LinearBlendSkinning:
    """Build the method."""
    return LinearBlendSkinning("lbs_smooth" if config.smooth else "lbs", config.smooth)


LBS = MethodEntry(LBSConfig(smooth=False), create_lbs)

LBS_SMOOTH = MethodEntry(LBSConfig(smooth=True), create_lbs)
