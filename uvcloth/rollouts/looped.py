"""Loops: rollouts over a cycle whose end joins their start."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import torch
from torch import Tensor

from uvcloth.motion.cycle import Cycle, compose
from uvcloth.rollouts.rollout import BrokenRolloutError, RolloutFrame

RUN_UP = 2.0
"""Seconds, at least, for which the cycle is repeated before its first frame is shown."""

OVERLAP = 0.5
"""Seconds at the end of the loop in which garments pass into those of the repetition before."""

RollOut = Callable[[Iterable[Tensor], int], Iterator[RolloutFrame]]
"""A rollout over joint transforms (J, 3, 4) of each frame in turn, the first of them of that index."""


def looped(roll_out: RollOut, cycle: Cycle) -> Iterator[RolloutFrame]:
    """Roll out a cycle again and again, and yield the frames of the last time.

    What follows the end of one repetition is the start of the next. So in the last OVERLAP the garments pass
    smoothly into those of the repetition before, which the first frame follows. Only these frames are kept in
    memory. The last frame is the first one, moved by the way of the cycle.
    Raises BrokenRolloutError as the rollout does.
    """
    count = len(cycle)
    passes = math.ceil(RUN_UP * cycle.motion.fps / count)
    overlap = min(count - 1, math.ceil(OVERLAP * cycle.motion.fps))
    frames = roll_out(_repeated(cycle, passes), -passes * count)
    earlier: deque[RolloutFrame] = deque(maxlen=overlap)
    try:
        first = next(frame for frame in _kept(frames, earlier) if frame.index == 0)
    except BrokenRolloutError as error:
        raise BrokenRolloutError(f"in the repetitions before the loop, {error}") from error
    yield first
    for frame in frames:
        number = frame.index - (count - overlap) + 1
        if number <= 0:
            yield frame
        else:
            yield _between(frame, _placed(earlier.popleft(), cycle.travel), number / (overlap + 1))
    yield replace(_placed(first, cycle.travel), index=count)


def _kept(frames: Iterator[RolloutFrame], earlier: deque[RolloutFrame]) -> Iterator[RolloutFrame]:
    """The frames, of which the last ones before the first of the loop are kept."""
    for frame in frames:
        if frame.index < 0:
            earlier.append(frame)
        yield frame


def _repeated(cycle: Cycle, passes: int) -> Iterator[Tensor]:
    """Joint transforms (J, 3, 4) of repetitions, each of which goes on where the one before it ends.

    Of the last one they are those of the motion.
    """
    transforms = cycle.motion.transforms(torch.float64)[:-1]
    turn, way = cycle.travel[:, :3], cycle.travel[:, 3:]
    back = [torch.eye(3, 4, dtype=torch.float64)]
    for _ in range(passes):
        back.append(torch.cat([turn.mT @ back[-1][:, :3], turn.mT @ (back[-1][:, 3:] - way)], dim=1))
    for travel in reversed(back):
        yield from compose(travel, transforms)


def _placed(frame: RolloutFrame, travel: Tensor) -> RolloutFrame:
    """The frame moved by a rigid transform (3, 4) of the world."""
    turn = travel[:, :3].to(frame.body_vertices)
    return replace(
        frame,
        raw=tuple(vertices @ turn.mT for vertices in frame.raw),
        vertices=tuple(vertices @ turn.mT for vertices in frame.vertices),
        transforms=turn @ frame.transforms,
        body_vertices=frame.body_vertices @ turn.mT,
        origin=travel[:, :3] @ frame.origin + travel[:, 3],
    )


def _between(frame: RolloutFrame, other: RolloutFrame, share: float) -> RolloutFrame:
    """The frame with garments on the way to those of another one with the same body.

    share: 0 to 1, of the time from the one to the other; the way begins and ends smoothly.
    """
    weight = share * share * (3.0 - 2.0 * share)
    shift = other.origin - frame.origin

    def blended(garments: tuple[Tensor, ...], others: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        return tuple(
            torch.lerp(vertices, (beside.double() + shift).to(vertices), weight)
            for vertices, beside in zip(garments, others, strict=True)
        )

    return replace(frame, raw=blended(frame.raw, other.raw), vertices=blended(frame.vertices, other.vertices))
