"""Difficult frames of a rollout, summed up as spans."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

MOST_SPANS = 5
"""Spans of difficult frames that are listed one by one."""


@dataclass
class FrameSpans:
    """Frames as spans, in the order in which they came; no more than are listed are kept."""

    count: int = 0
    last: int = -1
    listed: list[tuple[int, int]] = field(default_factory=list)

    def add(self, frame: int) -> None:
        """Add a frame after all others."""
        if self.listed and self.listed[-1][1] == frame - 1:
            self.listed[-1] = (self.listed[-1][0], frame)
        elif len(self.listed) < MOST_SPANS:
            self.listed.append((frame, frame))
        self.count, self.last = self.count + 1, frame

    def __str__(self) -> str:
        spans = ", ".join(str(first) if first == end else f"{first}-{end}" for first, end in self.listed)
        if self.listed[-1][1] < self.last:
            spans += f", ... to {self.last} ({self.count} in all)"
        return f"frame {spans}" if self.count == 1 else f"frames {spans}"


@dataclass
class Difficulties:
    """Frames of each difficulty, by its words."""

    spans: dict[str, FrameSpans] = field(default_factory=lambda: defaultdict(FrameSpans))

    def add(self, difficulties: Iterable[str], frame: int) -> None:
        """Add the difficulties of a frame, in words."""
        for words in difficulties:
            self.spans[words].add(frame)

    def lines(self) -> tuple[str, ...]:
        """A line for each difficulty, with its frames."""
        return tuple(f"difficult at {spans}: {words}" for words, spans in self.spans.items())
