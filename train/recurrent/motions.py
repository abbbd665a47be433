"""Motions without end for training: clips by number, sped up, mirrored, recombined, joined and stopped."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.mirror import mirror_transforms
from uvcloth.motion.clip import Clip
from uvcloth.motion.index import Entry, clip_file, read_index
from uvcloth.motion.join import join_clips
from uvcloth.motion.library import load_clip
from uvcloth.motion.recombine import legs_and_trunk
from uvcloth.motion.retarget import resample
from uvcloth.motion.stop import come_to_rest
from uvcloth.simulation.plan import interleaved

SPEEDS = (0.75, 1.33)
"""Least and greatest speed of a motion, as a share of the captured one; drawn evenly by logarithm."""

STOPPING = 0.4
"""Share of the motions that are brought to a stop in the middle."""

STILL_SECONDS = 2.0
"""Seconds that a body stands still after a stop: a skirt swings for a second and a half."""

RECOMBINED = 0.7
"""Share of the varied motions whose trunk, head and arms are those of another clip of the split."""

JOINED = 0.3
"""Share of the varied motions that go on in another clip of the split."""

FADE_SECONDS = 0.4
"""Seconds in which one clip fades into another."""

LONGEST = 600
"""Frames of a motion, at most."""

FPS = 30.0
"""Frames per second of the motions."""

KEPT_CLIPS = 32
"""Clips that are kept in memory."""


@dataclass(frozen=True)
class Motions:
    """Motions of one split of an index on one body, by number.

    The first round has every clip as it was captured, in an order in which any first part is a good mixture;
    later rounds vary them. entries: of the clips. folder: of their files. seed: of what is drawn.
    """

    entries: tuple[Entry, ...]
    folder: Path
    body: Body
    seed: int

    @classmethod
    def of_split(cls, split: str, windows: Path, folder: Path | None, body: Body, seed: int) -> "Motions":
        """The motions of a split; folder: by default that of the index. Raises InputError if none."""
        entries = tuple(interleaved(entry for entry in read_index(windows).values() if entry.split == split))
        if not entries:
            raise InputError(f"{windows}: has no clip of the split {split}")
        return cls(entries, folder or windows.parent, body, seed)

    def entry(self, number: int) -> Entry:
        """The clip that a motion is made of."""
        return self.entries[number % len(self.entries)]

    def transforms(self, number: int) -> Tensor:
        """Joint transforms (T, J, 3, 4) of a motion."""
        generator = np.random.default_rng((self.seed, number))
        varied = number >= len(self.entries)
        clip = self._clip(self.entry(number), generator if varied else None)
        clip = _cut(clip, LONGEST, generator)
        if varied and generator.random() < RECOMBINED:
            other = _cut(self._any(generator), len(clip), generator)
            clip = legs_and_trunk(clip, other)
        if varied and generator.random() < JOINED:
            other = self._any(generator)
            clip = join_clips(_cut(clip, LONGEST // 2, generator), other, FADE_SECONDS).window(0, LONGEST)
        if generator.random() < STOPPING:
            end = int(generator.integers(len(clip) // 2, len(clip) + 1))
            clip = come_to_rest(clip.window(0, end), STILL_SECONDS)
        transforms = clip.transforms()
        if varied and generator.random() < 0.5:
            transforms = mirror_transforms(transforms, self.body.skeleton)
        return transforms

    def _any(self, generator: np.random.Generator) -> Clip:
        """Any clip of the split, at any speed."""
        return self._clip(self.entries[generator.integers(len(self.entries))], generator)

    def _clip(self, entry: Entry, generator: np.random.Generator | None) -> Clip:
        """A clip of the split, at a speed that the generator draws."""
        clip = _loaded(clip_file(entry, self.folder), self.body)
        if generator is None:
            return clip
        low, high = np.log(SPEEDS)
        speed = float(np.exp(generator.uniform(low, high)))
        return resample(replace(clip, fps=FPS * speed), FPS)


def _cut(clip: Clip, frames: int, generator: np.random.Generator) -> Clip:
    """A part of so many frames of a clip, the whole of a shorter one."""
    return clip.window(int(generator.integers(max(len(clip) - frames, 0) + 1)), frames)


@lru_cache(KEPT_CLIPS)
def _loaded(file: Path, body: Body) -> Clip:
    return load_clip(file, body)
