"""The timeline of the extension, without Blender: cloth that counts what it was told."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.blender.conftest import load_module

FILE = Path(__file__).parents[2] / "blender" / "extension" / "timeline.py"


@pytest.fixture(scope="module")
def timeline() -> ModuleType:
    """The module, without the package around it, which needs bpy."""
    return load_module("extension_timeline", FILE)


class Counted:
    """Cloth whose state is a number that no two ways of getting to a frame share."""

    def __init__(self) -> None:
        self.state, self.steps, self.starts = 0.0, 0, 0
        self.seconds: list[float] = []

    def start(self, joints: np.ndarray) -> None:
        self.state, self.starts = float(joints.sum()), self.starts + 1

    def step(self, joints: np.ndarray, seconds: float) -> None:
        if joints.max() > 1e3:
            raise ValueError("too far")
        self.state = 0.7 * self.state + float(joints.sum()) * seconds
        self.steps += 1
        self.seconds.append(seconds)

    def set_world(self, wind: np.ndarray, gravity: np.ndarray) -> None:
        self.state += float(wind.sum())

    def save(self) -> np.ndarray:
        return np.array([self.state]).view(np.uint8).copy()

    def restore(self, content: np.ndarray) -> None:
        self.state = float(content.view(np.float64)[0])


def moments(timeline: ModuleType, count: int, wind: float = 0.0) -> list:
    joints = np.random.default_rng(0).uniform(size=(count, 2, 3, 4))
    none = np.zeros(3)
    return [timeline.Moment(frame, joints[frame], none + wind, none) for frame in range(count)]


def test_frames_come_back_with_the_same_bits(timeline: ModuleType) -> None:
    cloth = Counted()
    played = timeline.Timeline(cloth, 10.0)
    states = []
    for moment in moments(timeline, 35):
        played.show(moment)
        states.append(cloth.state)
    for frame in (3, 30, 29, 0, 34, 17):
        played.show(moments(timeline, 35)[frame])
        assert cloth.state == states[frame]
    assert cloth.starts == 1


def test_a_frame_back_costs_a_second_of_steps_at_most(timeline: ModuleType) -> None:
    cloth = Counted()
    played = timeline.Timeline(cloth, 10.0)
    for moment in moments(timeline, 35):
        played.show(moment)
    before = cloth.steps
    played.show(moments(timeline, 35)[19])
    assert cloth.steps - before == 9


@pytest.mark.parametrize(("frame", "starts", "seconds"), [(7, 1, 0.3), (14, 1, 1.0), (15, 2, 0.1)])
def test_skipped_frames_are_one_longer_step_or_a_new_start(
    timeline: ModuleType, frame: int, starts: int, seconds: float
) -> None:
    cloth = Counted()
    played = timeline.Timeline(cloth, 10.0)
    for moment in moments(timeline, 5):
        played.show(moment)
    played.show(moments(timeline, 20)[frame])
    assert cloth.starts == starts
    assert cloth.seconds[-1] == pytest.approx(seconds)


def test_a_frame_that_was_skipped_is_played_before_those_after_it(timeline: ModuleType) -> None:
    cloth, straight = Counted(), Counted()
    played, other = timeline.Timeline(cloth, 10.0), timeline.Timeline(straight, 10.0)
    every = moments(timeline, 4)
    for frame in (0, 3, 1, 2, 3):
        played.show(every[frame])
    for moment in every:
        other.show(moment)
    assert cloth.state == straight.state


def test_a_changed_frame_is_played_again_with_all_after_it(timeline: ModuleType) -> None:
    cloth, straight = Counted(), Counted()
    played, other = timeline.Timeline(cloth, 10.0), timeline.Timeline(straight, 10.0)
    for moment in moments(timeline, 6):
        played.show(moment)
    mixed = [*moments(timeline, 3), *moments(timeline, 6, wind=2.0)[3:]]
    for moment in mixed[3:]:
        played.show(moment)
    for moment in mixed:
        other.show(moment)
    assert cloth.state == straight.state
    assert len(played) == 6


def test_before_the_first_frame_cloth_starts_again(timeline: ModuleType) -> None:
    cloth = Counted()
    played = timeline.Timeline(cloth, 10.0)
    every = moments(timeline, 6)
    for frame in (4, 5, 2):
        played.show(every[frame])
    assert cloth.starts == 2
    assert len(played) == 1


def test_between_frames_cloth_is_stepped_and_frames_stay(timeline: ModuleType) -> None:
    cloth = Counted()
    played = timeline.Timeline(cloth, 10.0)
    every = moments(timeline, 6)
    for moment in every:
        played.show(moment)
    state = cloth.state
    played.between(timeline.Moment(2, every[3].joints, every[3].wind, every[3].gravity), 0.5)
    assert cloth.seconds[-1] == pytest.approx(0.05)
    played.show(every[5])
    assert cloth.state == state
    assert len(played) == 6


def test_a_step_that_fails_leaves_what_was_played(timeline: ModuleType) -> None:
    cloth = Counted()
    played = timeline.Timeline(cloth, 10.0)
    every = moments(timeline, 6)
    for moment in every[:3]:
        played.show(moment)
    state = cloth.state
    with pytest.raises(ValueError, match="too far"):
        played.show(timeline.Moment(3, every[3].joints + 1e4, np.zeros(3), np.zeros(3)))
    assert len(played) == 3
    played.show(every[2])
    assert cloth.state == state
