"""Summary of a rollout: files, times and visible skin."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

from uvcloth.difficulties import Difficulties
from uvcloth.rollout import RolloutFrame

INVISIBLE = 0.05
"""Percent of the covered skin below which showing skin is invisible."""

MOST_FILES = 12
"""Files that a summary lists one by one: an OBJ sequence is one for each frame."""

MOST_LISTED = 5
"""Broken frames that a summary lists one by one."""


@dataclass(frozen=True)
class Summary:
    """Summary of a rollout.

    written: the files. frames: number of predicted frames, one of `every` of the clip. seconds: wall time of
    all frames. milliseconds: per frame, by stage. skin: percent of the skin covered at rest that shows
    through the garments, mean over the written frames; worst: its largest value and the frame. replaced:
    messages on garments that had no valid prediction in a frame. difficult: messages on difficulties and
    their frames.
    """

    written: tuple[Path, ...]
    frames: int
    seconds: float
    milliseconds: dict[str, float]
    skin: float
    worst: tuple[float, int]
    every: int = 1
    replaced: tuple[str, ...] = ()
    difficult: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """The summary as text for a terminal."""
        stages = ", ".join(f"{stage} {spent:.1f}" for stage, spent in self.milliseconds.items())
        rate = self.frames / self.seconds
        thinned = f"; one frame of {self.every}" if self.every > 1 else ""
        more = len(self.written) - MOST_FILES
        lines = [
            *(str(path) for path in self.written[:MOST_FILES]),
            *([f"... and {more} more files, the last {self.written[-1]}"] if more > 0 else []),
            f"{self.frames} frames in {self.seconds:.1f} s, {rate:.1f} frames per second{thinned}",
            f"ms per frame: {stages}",
            *self.replaced[:MOST_LISTED],
        ]
        if len(self.replaced) > MOST_LISTED:
            lines.append(f"... and {len(self.replaced) - MOST_LISTED} more")
        if self.replaced:
            lines.append("these were replaced by linear blend skinning")
        lines.extend(self.difficult)
        return [*lines, self._visible_skin()]

    def _visible_skin(self) -> str:
        """Sentence on the skin that shows through the cloth."""
        worst, frame = self.worst
        if worst < INVISIBLE:
            return "no skin shows through the cloth"
        least = f"below {INVISIBLE} %" if self.skin < INVISIBLE else f"{self.skin:.2f} %"
        return (
            f"skin will show through the cloth: on {least} of what it covers on average, at most on "
            f"{worst:.1f} % at frame {frame}"
        )


@dataclass
class Totals:
    """Sums over the frames of a rollout so far."""

    frames: int = 0
    skin: float = 0.0
    worst: tuple[float, int] = (0.0, 0)
    replaced: list[str] = field(default_factory=list)
    difficulties: Difficulties = field(default_factory=Difficulties)
    milliseconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def add(self, frame: RolloutFrame) -> None:
        """Add what the rollout measured in a frame."""
        self.frames += 1
        for stage, milliseconds in frame.milliseconds.items():
            self.milliseconds[stage] += milliseconds
        self.replaced.extend(frame.replaced)
        self.difficulties.add(frame.difficulties, frame.index)

    def add_skin(self, percent: float, frame: int) -> None:
        """Add the share of the skin that shows in a frame."""
        self.skin += percent
        self.worst = max(self.worst, (percent, -frame))

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the time that the block takes to a stage."""
        begun = perf_counter()
        yield
        self.milliseconds[stage] += 1e3 * (perf_counter() - begun)

    def summary(self, written: tuple[Path, ...], seconds: float, every: int) -> Summary:
        """Summary of a whole rollout; every: see Summary."""
        return Summary(
            written=written,
            frames=self.frames,
            seconds=seconds,
            milliseconds={stage: total / self.frames for stage, total in self.milliseconds.items()},
            skin=self.skin / self.frames,
            worst=(self.worst[0], -self.worst[1]),
            every=every,
            replaced=tuple(self.replaced),
            difficult=self.difficulties.lines(),
        )
