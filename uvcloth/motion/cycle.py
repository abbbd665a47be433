"""Cycles: motions whose last frame continues to the first one, and the closing of those that nearly do."""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.geometry.rotations import from_axis_angles, heading, to_axis_angles
from uvcloth.motion.clip import Clip

SHORTEST = 8
"""Least number of frames of a cycle."""

WIDEST = 0.08
"""Greatest gap of a cycle, metres, mean of the joints: a wider one is not closed."""

IN_PLACE, STRAIGHT = 0.1, math.radians(10.0)
"""A way of fewer metres, and a turn by a smaller angle, are none of a cycle: they are a part of its gap."""

ORDINARY = 3.0
"""Gap of a motion that closes by itself, over the median of what the mean of the steps beside it misses."""

NOTICED = 1e-4
"""Metres of the joints, on average, that are no difference."""

MOVED = 0.5
"""Metres that joints move around the root in a cycle, on average, to be more than standing."""

PACE = 0.1
"""Seconds by which velocities are compared as ways are, where poses are compared."""

COMPARED = 1000
"""Frames that are compared with each other, at most."""


@dataclass(frozen=True)
class Cycle:
    """A motion that repeats.

    motion: in float64; its last frame is the first one moved by `travel`. travel: (3, 4) float64, the way of
    one cycle: a turn about the vertical and a displacement, m. gap: m, mean of the joints, from where the
    motion led to its first frame, spread over the cycle; 0 for a motion that closed by itself.
    """

    motion: Clip
    travel: Tensor
    gap: float

    def __len__(self) -> int:
        return len(self.motion) - 1

    def line(self) -> str:
        """A sentence on the cycle."""
        way = float((self.motion.translation[-1] - self.motion.translation[0]).norm())
        travels = f", which travels {way:.2f} m and closes around the root" if way else ""
        closed = (
            f"; its end was {1000 * self.gap:.0f} mm from its start, which is spread over the cycle"
            if self.gap
            else ""
        )
        return f"{self.motion.name}: a cycle of {len(self)} frames{travels}{closed}"


@dataclass(frozen=True)
class _End:
    """The pose in which a motion's next cycle would begin, after `frames` frames.

    rotations: (J, 3, 3). translation: (3,) m.
    """

    frames: int
    rotations: Tensor
    translation: Tensor


def make_cycle(clip: Clip) -> Cycle:
    """Close a motion into a cycle.

    Its last frame continues to the first one, or repeats it and is then left out. The root may travel and
    turn about the vertical. If the last frame leads farther from the first one than other frames from their
    next ones (ORDINARY), the gap of every joint is spread evenly over the cycle.
    Raises InputError for a motion of fewer than SHORTEST frames, and one with a gap above WIDEST.
    """
    if len(clip) < SHORTEST:
        raise InputError(f"{clip.name}: a cycle (--loop) needs at least {SHORTEST} frames, not {len(clip)}")
    clip = replace(clip, rotations=clip.rotations.double(), translation=clip.translation.double())
    end, travel, gap = _closed(clip, _continued(clip))
    again = _closed(clip, _repeated(clip))
    if again[2] < gap / 2:
        end, travel, gap = again
    if gap > WIDEST:
        raise InputError(
            f"{clip.name}: is no cycle (--loop), its end is {1000 * gap:.0f} mm from its start, "
            f"{1000 * WIDEST:.0f} mm can be closed; {_closest(clip)}"
        )
    motion = clip.window(0, end.frames)
    if gap <= ORDINARY * _usual_bend(motion) + NOTICED:
        return Cycle(_joined(motion, travel), travel, 0.0)
    return Cycle(_joined(_spread(motion, end, travel), travel), travel, gap)


def compose(travel: Tensor, transforms: Tensor) -> Tensor:
    """Joint transforms (..., 3, 4), followed by a rigid one (3, 4)."""
    placed = travel[:, :3] @ transforms
    return torch.cat([placed[..., :3], placed[..., 3:] + travel[:, 3:]], dim=-1)


def _repeated(clip: Clip) -> _End:
    """The end if the last frame is the first one again."""
    return _End(len(clip) - 1, clip.rotations[-1], clip.translation[-1])


def _continued(clip: Clip) -> _End:
    """The end if one more step, the mean of the last and the first one, leads to the first frame."""
    starts = torch.tensor([0, len(clip) - 2])
    before, after = clip.rotations[starts], clip.rotations[starts + 1]
    spin = to_axis_angles(before.mT @ after).mean(0)
    ways = clip.translation[starts + 1] - clip.translation[starts]
    way = (before[:, 0].mT @ ways[..., None]).mean(0)[:, 0]
    return _End(
        len(clip),
        clip.rotations[-1] @ from_axis_angles(spin),
        clip.translation[-1] + clip.rotations[-1, 0] @ way,
    )


def _closed(clip: Clip, end: _End) -> tuple[_End, Tensor, float]:
    """The end with the way of the cycle, and the gap, m, mean of the joints, to the frame that follows."""
    travel = _travel(clip, end)
    ended = replace(clip, rotations=end.rotations[None], translation=end.translation[None])
    apart = ended.positions() - _following(clip, travel).positions()
    return end, travel, float(apart.norm(dim=-1).mean())


def _travel(clip: Clip, end: _End) -> Tensor:
    """The way of the root (3, 4) from the first frame to the end; none of a motion in place."""
    turn = heading(end.rotations[0] @ clip.rotations[0, 0].mT)
    if abs(math.atan2(float(turn[1, 0]), float(turn[0, 0]))) < STRAIGHT:
        turn = torch.eye(3, dtype=torch.float64)
        shift = end.translation - clip.translation[0]
        shift = torch.where(shift[:2].norm() < IN_PLACE, torch.zeros_like(shift), shift)
    else:
        shift = end.translation - turn @ clip.translation[0]
    return torch.cat([turn, (shift * shift.new_tensor([1.0, 1.0, 0.0]))[:, None]], dim=1)


def _following(clip: Clip, travel: Tensor) -> Clip:
    """The first frame, moved by the way of a cycle."""
    return replace(
        clip,
        rotations=travel[:, :3] @ clip.rotations[:1],
        translation=clip.translation[:1] @ travel[:, :3].mT + travel[:, 3],
    )


def _joined(clip: Clip, travel: Tensor) -> Clip:
    """The clip, followed by its first frame moved by the way of a cycle."""
    following = _following(clip, travel)
    return replace(
        clip,
        rotations=torch.cat([clip.rotations, following.rotations]),
        translation=torch.cat([clip.translation, following.translation]),
    )


def _usual_bend(clip: Clip) -> float:
    """Difference, m, mean of the joints, of a step from the mean of those beside it; the median."""
    steps = clip.positions().diff(dim=0)
    return float((steps[1:-1] - (steps[:-2] + steps[2:]) / 2).norm(dim=-1).mean(-1).median())


def _spread(clip: Clip, end: _End, travel: Tensor) -> Clip:
    """The clip with the gap of each joint spread evenly, half of it at either side of the seam."""
    following = _following(clip, travel)
    share = torch.arange(len(clip), dtype=torch.float64) / len(clip) - 0.5
    spin = to_axis_angles(end.rotations.mT @ following.rotations[0])
    return replace(
        clip,
        rotations=clip.rotations @ from_axis_angles(share[:, None, None] * spin),
        translation=clip.translation + share[:, None] * (following.translation - end.translation),
    )


def _closest(clip: Clip) -> str:
    """The frames that close best of those in which the limbs take a way of MOVED, in words."""
    every = math.ceil(len(clip) / COMPARED)
    root = clip.translation * clip.translation.new_tensor([1.0, 1.0, 0.0])
    around = (clip.positions() - root[:, None]) @ heading(clip.rotations[:, 0])
    speeds = torch.gradient(around, dim=0)[0] * clip.fps
    poses = torch.cat([around, PACE * speeds], dim=-1)[::every].flatten(1)
    apart = torch.cdist(poses, poses) / math.sqrt(around.shape[1])
    ways = around.diff(dim=0, prepend=around[:1]).norm(dim=-1).mean(-1).cumsum(0)[::every]
    frames = torch.arange(len(poses)) * every
    is_cycle = (ways - ways[:, None] > MOVED) & (frames - frames[:, None] >= SHORTEST)
    apart = torch.where(is_cycle, apart, torch.inf)
    first, last = divmod(int(apart.argmin()), len(poses))
    if apart[first, last] > WIDEST:
        return "and no part of it is one"
    return f"its frames {first * every}:{last * every} come closest to one"
