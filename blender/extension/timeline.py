"""Cloth along a timeline: a frame that was played comes back with the same bits."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LONGEST_GAP = 1.0
"""Seconds that may be skipped in one step; beyond, cloth starts again."""

SAVED_EVERY = 1.0
"""Seconds from one saved state to the next."""


class Playable(Protocol):
    """Cloth of the runtime, as far as a timeline needs it."""

    def start(self, joints: Floats) -> None:
        """Come to rest on the first pose, (J, 3, 4)."""

    def step(self, joints: Floats, seconds: float) -> None:
        """Move on to a pose, (J, 3, 4)."""

    def set_world(self, wind: Any, gravity: Any) -> None:
        """Set wind (3,) m/s and gravity (3,) m/s2."""

    def save(self) -> NDArray[np.uint8]:
        """Bytes of the state."""

    def restore(self, content: NDArray[np.uint8]) -> None:
        """Go on from the bytes of a state."""


@dataclass(frozen=True)
class Moment:
    """All that moves cloth to a frame.

    frame: its number. joints: (J, 3, 4) from rest, m. wind: (3,) m/s. gravity: (3,) m/s2; all in the
    runtime's world.
    """

    frame: int
    joints: Floats
    wind: Floats
    gravity: Floats

    def is_same(self, other: "Moment") -> bool:
        """Tell whether cloth would move in the same way."""
        mine, others = (self.joints, self.wind, self.gravity), (other.joints, other.wind, other.gravity)
        return self.frame == other.frame and all(map(np.array_equal, mine, others))


class Timeline:
    """The moments that were played, in order of their frames, and states of the cloth at some of them.

    A frame that was played is shown again from the last state before it. A frame whose moment has changed,
    as by a new key, makes all after it be played again.
    """

    def __init__(self, cloth: Playable, fps: float) -> None:
        """Begin without frames. fps: frames per second."""
        self._cloth, self._fps = cloth, fps
        self._moments: list[Moment] = []
        self._states: dict[int, NDArray[np.uint8]] = {}
        self._at = -1

    def __len__(self) -> int:
        """Number of frames that were played and are still valid."""
        return len(self._moments)

    def show(self, moment: Moment) -> None:
        """Move the cloth to a moment.

        Raises ValueError with the runtime's sentence where it cannot go on; it stays as it was then.
        """
        before = sum(known.frame < moment.frame for known in self._moments)
        if before < len(self._moments) and self._moments[before].is_same(moment):
            self._seek(before)
            return
        self._forget_from(before)
        if not self._moments or self._seconds(moment) > LONGEST_GAP:
            self._start(moment)
            return
        self._seek(before - 1)
        self._step(moment)
        self._moments.append(moment)
        self._at = before
        if moment.frame - self._moments[max(self._states)].frame >= SAVED_EVERY * self._fps:
            self._states[before] = self._cloth.save()

    def between(self, moment: Moment, share: float) -> None:
        """Move the cloth to a moment that is a share of a frame after its frame, as motion blur asks.

        Frames that were played stay; where its frame was not, the cloth stays as it is. Raises as `show`.
        """
        frames = [known.frame for known in self._moments]
        if moment.frame in frames:
            self._seek(frames.index(moment.frame))
            self.pose(moment, share / self._fps)

    def pose(self, moment: Moment, seconds: float) -> None:
        """Move the cloth on to a moment that is not played, as of a pose that is tried by hand.

        Frames that were played come back when they are shown. Raises ValueError as `show` does.
        """
        if not self._moments:
            self.show(moment)
        self._at = -1
        self._cloth.set_world(moment.wind, moment.gravity)
        self._cloth.step(moment.joints, seconds)

    def _start(self, moment: Moment) -> None:
        self._forget_from(0)
        self._cloth.set_world(moment.wind, moment.gravity)
        self._cloth.start(moment.joints)
        # The first step is to the first pose, as `uvcloth play` does it.
        self._cloth.step(moment.joints, 1.0 / self._fps)
        self._moments, self._at = [moment], 0
        self._states = {0: self._cloth.save()}

    def _step(self, moment: Moment) -> None:
        self._cloth.set_world(moment.wind, moment.gravity)
        self._cloth.step(moment.joints, self._seconds(moment))

    def _seconds(self, moment: Moment) -> float:
        """Seconds from the last moment before one."""
        earlier = [known.frame for known in self._moments if known.frame < moment.frame]
        return (moment.frame - earlier[-1]) / self._fps

    def _seek(self, index: int) -> None:
        """Bring the cloth to a moment that was played."""
        state = max(each for each in self._states if each <= index)
        if not state <= self._at <= index:
            self._cloth.restore(self._states[state])
            self._at = state
        while self._at < index:
            self._step(self._moments[self._at + 1])
            self._at += 1

    def _forget_from(self, index: int) -> None:
        del self._moments[index:]
        self._states = {each: state for each, state in self._states.items() if each < index}
        if self._at >= index:
            self._at = -1
