"""Frames of many clips, one after another, from which training draws single frames, windows and histories.

Clips without garments give motion without cloth.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.dataset.clip import SimulatedClip


@dataclass(frozen=True)
class Rows:
    """R frames, clip after clip, each clip led in by some frames of its warm-up.

    transforms: (R, J, 3, 4). fps: (R,) of the row's clip. starts: (R,) int64 first row of the row's clip.
    samples: (S,) int64 rows to draw: the scored frames that have all their frames before.
    """

    transforms: Tensor
    fps: Tensor
    starts: Tensor
    samples: Tensor

    def windows(self, frames: int) -> Tensor:
        """The samples (W,) at which windows of so many frames begin that end in the same clip."""
        last = frames - 1
        first = self.samples[self.samples + last < len(self.starts)]
        return first[self.starts[first + last] == self.starts[first]]

    def before(self, rows: Tensor, frames: int) -> tuple[Tensor, Tensor]:
        """The rows (B, frames) before rows (B,), oldest first, and a mask of those in the same clip."""
        before = rows[:, None] - torch.arange(frames, 0, -1, device=rows.device)
        return before, before >= self.starts[rows][:, None]


def joined_rows(clips: Sequence[SimulatedClip], history: int) -> Rows:
    """The frames of clips. history: frames before each sample, of the warm-up where that is long enough."""
    samples, starts, row = [], [], 0
    for clip, first in led_in(clips, history):
        count = len(clip.transforms) - first
        samples.append(torch.arange(row + max(history, clip.warm_up - first), row + count))
        starts.append(torch.full((count,), row))
        row += count
    return Rows(
        transforms=torch.cat([clip.transforms[first:] for clip, first in led_in(clips, history)]),
        fps=torch.cat(
            [torch.full((len(clip.transforms) - first,), clip.fps) for clip, first in led_in(clips, history)]
        ),
        starts=torch.cat(starts),
        samples=torch.cat(samples),
    )


def joined_vertices(clips: Sequence[SimulatedClip], garment: str, history: int) -> Tensor:
    """The vertices (R, N, 3) of a garment that all clips have, in the same rows as `joined_rows`."""
    return torch.cat([clip.by_name[garment].vertices[first:] for clip, first in led_in(clips, history)])


def led_in(clips: Sequence[SimulatedClip], history: int) -> Iterator[tuple[SimulatedClip, int]]:
    """Yield each clip and its first frame among the rows: up to `history` frames before the first scored."""
    for clip in clips:
        yield clip, max(0, clip.warm_up - history)
