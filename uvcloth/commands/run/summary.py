"""Summary of a rollout: files, times, and what shows through the cloth."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

from uvcloth.rollouts.difficulties import Difficulties
from uvcloth.rollouts.rollout import RolloutFrame

INVISIBLE = 0.05
"""Percent of the covered skin below which showing skin is invisible."""

INVISIBLE_CLOTH = 0.02
"""Percent of the visible cloth below which cloth that comes through is invisible: some square centimetres."""

MOST_FILES = 12
"""Files that a summary lists one by one: an OBJ sequence is one for each frame."""

MOST_LISTED = 5
"""Broken frames that a summary lists one by one."""


@dataclass(frozen=True)
class Percentage:
    """Percent of a surface that shows: its mean over the frames, its largest value, and the frame of that."""

    mean: float = 0.0
    worst: float = 0.0
    frame: int = 0

    def text(self, surface: str, least: float) -> str:
        """Mean and largest value in words; least: percent below which a mean is not told."""
        mean = f"below {least} %" if self.mean < least else f"{self.mean:.2f} %"
        worst = f"{self.worst:.2f} %" if self.worst < 0.1 else f"{self.worst:.1f} %"
        return f"on {mean} of {surface} on average, at most on {worst} at frame {self.frame}"


@dataclass(frozen=True)
class Summary:
    """Summary of a rollout.

    written: the files. frames: number of predicted frames, one of `every` of the clip. seconds: wall time of
    all frames. milliseconds: per frame, by stage. skin: percent of the skin covered at rest that shows
    through the garments; cloth: percent of the visible cloth that comes through a garment over it, None for a
    garment alone. replaced: messages on garments that had no valid prediction in a frame. difficult: messages
    on difficulties and their frames.
    """

    written: tuple[Path, ...]
    frames: int
    seconds: float
    milliseconds: dict[str, float]
    skin: Percentage
    cloth: Percentage | None = None
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
        return [*lines, *self._through()]

    def _through(self) -> list[str]:
        """Sentences on what shows through the cloth; only if nothing does, one says so."""
        sentences = []
        if self.skin.worst >= INVISIBLE:
            text = self.skin.text("what it covers", INVISIBLE)
            sentences.append(f"skin will show through the cloth: {text}")
        if self.cloth and self.cloth.worst >= INVISIBLE_CLOTH:
            text = self.cloth.text("the visible cloth", INVISIBLE_CLOTH)
            sentences.append(f"inner garments will show through outer ones: {text}")
        if self.cloth and not sentences:
            return ["no skin and no inner garment shows through the cloth"]
        return sentences or ["no skin shows through the cloth"]


@dataclass
class ShareTotal:
    """Sum of a percentage over the frames so far, and its largest value with the frame."""

    total: float = 0.0
    worst: float = 0.0
    frame: int = 0

    def add(self, percent: float, frame: int) -> None:
        """Add the percentage of a frame."""
        self.total += percent
        if percent > self.worst:
            self.worst, self.frame = percent, frame

    def share(self, frames: int) -> Percentage:
        """The share over so many frames."""
        return Percentage(self.total / frames, self.worst, self.frame)


@dataclass
class Totals:
    """Sums over the frames of a rollout so far, of several garments or of one alone."""

    several: bool = False
    frames: int = 0
    skin: ShareTotal = field(default_factory=ShareTotal)
    cloth: ShareTotal = field(default_factory=ShareTotal)
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

    def add_shares(self, skin: float, cloth: float, frame: int) -> None:
        """Add the percent of the skin, and of inner cloth, that shows in a frame."""
        self.skin.add(skin, frame)
        self.cloth.add(cloth, frame)

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
            skin=self.skin.share(self.frames),
            cloth=self.cloth.share(self.frames) if self.several else None,
            every=every,
            replaced=tuple(self.replaced),
            difficult=self.difficulties.lines(),
        )
