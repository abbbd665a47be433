"""Frames of a posed body, with the velocity and acceleration of its surface."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin

HISTORY = 3
"""Frames of the body that are a method's input: k-2, k-1 and k (PhysXNet section 3.1)."""

LEAD = HISTORY + 1
"""Frames before the first one that are needed to difference its history twice."""


@dataclass(frozen=True)
class BodyFrames:
    """B frames of a posed body, each with its short history (H = HISTORY, the last is the frame itself).

    joints: (B, J, 3, 4) float64, transforms in the world, and origin: (B, 3) float64 m, around which all else
    is; both on the CPU. transforms: (B, H, J, 3, 4). vertices: (B, H, V, 3) m. velocity: (B, H, V, 3) m/s,
    acceleration: (B, H, V, 3) m/s2, both backward differences (PhysXNet eq. 6 and 7) divided by the frame
    time. under: (B, N, 3) m, the garment beneath the one to predict, where a method needs it.
    """

    body: Body
    fps: float
    transforms: Tensor
    vertices: Tensor
    velocity: Tensor
    acceleration: Tensor
    joints: Tensor
    origin: Tensor
    under: Tensor | None = None

    def __len__(self) -> int:
        return len(self.transforms)

    def __getitem__(self, rows: slice) -> "BodyFrames":
        """Some of the frames."""
        return replace(
            self,
            transforms=self.transforms[rows],
            vertices=self.vertices[rows],
            velocity=self.velocity[rows],
            acceleration=self.acceleration[rows],
            joints=self.joints[rows],
            origin=self.origin[rows],
            under=self.under[rows] if self.under is not None else None,
        )


def side_by_side(frames: Sequence[BodyFrames]) -> BodyFrames:
    """Frames of several motions of one body as one batch, without `under`; all need the same frame rate."""
    return BodyFrames(
        body=frames[0].body,
        fps=frames[0].fps,
        transforms=torch.cat([frame.transforms for frame in frames]),
        vertices=torch.cat([each.vertices for each in frames]),
        velocity=torch.cat([each.velocity for each in frames]),
        acceleration=torch.cat([each.acceleration for each in frames]),
        joints=torch.cat([each.joints for each in frames]),
        origin=torch.cat([each.origin for each in frames]),
    )


def body_frames(body: Body, transforms: Tensor, fps: float, posed: Tensor | None = None) -> BodyFrames:
    """Pose a body over LEAD + B consecutive frames of joint transforms (LEAD + B, J, 3, 4).

    The first LEAD frames only serve the differences; `with_lead` makes them at a clip's start. The origin is
    that of the world. fps: frames per second. posed: (K, V, 3) m, the body in the first K frames, where that
    is known.
    """
    known = 0 if posed is None else len(posed)
    vertices = posed_skin(body, transforms[known:])
    if posed is not None:
        vertices = torch.cat([posed, vertices])
    velocity = (vertices[1:] - vertices[:-1]) * fps
    acceleration = (velocity[1:] - velocity[:-1]) * fps

    def history(values: Tensor) -> Tensor:
        runs = values[-(len(transforms) - LEAD + HISTORY - 1) :].unfold(0, HISTORY, 1)
        return runs.movedim(-1, 1)

    return BodyFrames(
        body=body,
        fps=fps,
        transforms=history(transforms),
        vertices=history(vertices),
        velocity=history(velocity),
        acceleration=history(acceleration),
        joints=transforms[LEAD:].double().cpu(),
        origin=torch.zeros(len(transforms) - LEAD, 3, dtype=torch.float64),
    )


def with_lead(transforms: Tensor) -> Tensor:
    """Joint transforms (T, J, 3, 4) with the first frame repeated LEAD times in front: (LEAD + T, J, 3, 4).

    The body then stood still before the clip began.
    """
    return torch.cat([transforms[:1].expand(LEAD, -1, -1, -1), transforms])
