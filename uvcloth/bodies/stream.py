"""A body posed over a motion, batch after batch, in coordinates around its root.

float32 resolves 0.1 micrometres near the origin, 1 mm at 10 km. Positions are therefore computed relative to
the root, which is subtracted in float64.
"""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import LEAD, BodyFrames, body_frames
from uvcloth.bodies.stature import beside_adults
from uvcloth.errors import InputError

BATCH = 8
"""Frames that the body is posed for at once."""

JUMP = 10.0
"""Change of the joints' velocity from one frame to the next, m/s on average, with which a motion jumps.

No adult moves so (at most 8.2 in 68 of 69 CMU clips, at 10 to 120 fps); cuts and lost markers do. For other
bodies, on which a motion takes shorter or longer ways, it is in proportion to their height.
"""


@dataclass(frozen=True)
class PosedBatch:
    """B consecutive frames of a posed body.

    frames: with positions relative to the origin. origin: (3,) float64 m, world, where the root is in the
    first of them. begins: whether the body stood still before, in its first frame: the motion begins, or
    jumped. milliseconds: time that posing took per frame.
    """

    frames: BodyFrames
    origin: Tensor
    begins: bool
    milliseconds: float


def posed_batches(
    body: Body, transforms: Iterable[Tensor], fps: float, jumps: bool = True
) -> Iterator[PosedBatch]:
    """Pose a body over a motion, (J, 3, 4) of each frame in turn, float64 where it leads far away.

    It keeps LEAD earlier frames, and reads no further than a batch. jumps: start again as at the first frame
    where the motion jumps, without the frames before.
    Raises InputError naming the frame where a transform is not a finite number.
    """
    device = body.mesh.vertices.device
    heads = body.skeleton.heads.double().cpu()
    limit = JUMP * beside_adults(body)
    led: list[Tensor] = []
    fresh: list[Tensor] = []
    posed: Tensor | None = None
    origin = torch.zeros(3, dtype=torch.float64)
    joints: Tensor | None = None
    velocity = torch.zeros_like(heads)
    begins = True

    def pose() -> PosedBatch:
        nonlocal led, fresh, posed, origin, begins
        begun = time.perf_counter()
        before, origin = origin, (fresh[0][0] @ torch.cat([heads[0], heads.new_ones(1)])).clone()
        led = led or fresh[:1] * LEAD
        local = torch.stack(led + fresh)
        local[..., 3] -= origin
        known = None if posed is None else posed + (before - origin).to(posed)
        frames = replace(
            body_frames(body, local.float().to(device), fps, known),
            joints=torch.stack(fresh),
            origin=origin.expand(len(fresh), 3),
        )
        batch = PosedBatch(frames, origin, begins, 1000.0 * (time.perf_counter() - begun) / len(fresh))
        led, fresh, posed, begins = (led + fresh)[-LEAD:], [], frames.vertices[-LEAD:, -1], False
        return batch

    for index, given in enumerate(transforms):
        if not torch.isfinite(given).all():
            raise InputError(f"frame {index} of the motion: a joint's transform is not a finite number")
        transform = given.detach().double().cpu()
        now = (transform[..., :3] @ heads[..., None]).squeeze(-1) + transform[..., 3]
        current = (now - (now if joints is None else joints)) * fps
        if jumps and float((current - velocity).norm(dim=1).mean()) > limit:
            if fresh:
                yield pose()
            led, posed, begins, current = [], None, True, torch.zeros_like(current)
        joints, velocity = now, current
        fresh.append(transform)
        if len(fresh) == BATCH:
            yield pose()
    if fresh:
        yield pose()
