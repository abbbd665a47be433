"""A motion clip: world joint rotations relative to a skeleton's rest pose, and the root's path."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.geometry.skeleton import Skeleton, joint_transforms
from uvcloth.motion.options import FPS_RANGE


def require_fps(fps: float) -> None:
    """Raise InputError for frames per second outside FPS_RANGE."""
    least, greatest = FPS_RANGE
    if not least <= fps <= greatest:
        raise InputError(f"--fps {fps:g}: expected {least:g} to {greatest:g} frames per second")


@dataclass(frozen=True)
class Clip:
    """Motion of one skeleton.

    rotations: (T, J, 3, 3) world rotations relative to the skeleton's rest pose. translation: (T, 3) world
    position of the root joint, float32 or float64, in the skeleton's unit: metres on a body, that of its file
    as read. fps: frames per second. table: joint of each role, where the file has a table of them.
    """

    name: str
    skeleton: Skeleton
    rotations: Tensor
    translation: Tensor
    fps: float
    table: Mapping[str, int] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.rotations)

    def transforms(self, dtype: torch.dtype = torch.float32) -> Tensor:
        """Rest-to-posed transforms of every joint and frame: (T, J, 3, 4); float64 is exact far away too."""
        wide = torch.promote_types(self.translation.dtype, dtype)
        return joint_transforms(self.skeleton, self.rotations.to(wide), self.translation.to(wide)).to(dtype)

    def positions(self) -> Tensor:
        """Posed joints: (T, J, 3), in the translation's type."""
        transforms = self.transforms(self.translation.dtype)
        heads = self.skeleton.heads.to(transforms)
        return (transforms[..., :3] @ heads[:, :, None]).squeeze(-1) + transforms[..., 3]

    def require_frames(self, end: int, source: object) -> None:
        """Raise InputError naming the source if a window ends at a frame that the motion does not have."""
        if end > len(self):
            raise InputError(f"{source}: has {len(self)} frames, the window ends at {end}")

    def window(self, start: int, frames: int) -> "Clip":
        """Frames start .. start + frames as a clip of its own."""
        end = start + frames
        return replace(self, rotations=self.rotations[start:end], translation=self.translation[start:end])
