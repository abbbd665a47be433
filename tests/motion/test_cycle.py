"""Cycles: motions that repeat are recognized, such as nearly do are closed, and others are refused."""

import math
from dataclasses import replace

import pytest
import torch

from tests.small_body import small_body
from uvcloth.errors import InputError
from uvcloth.geometry.rotations import from_euler
from uvcloth.motion.clip import Clip
from uvcloth.motion.cycle import compose, make_cycle

PERIOD = 30


def swaying(frames: int, turn: float = 0.0, speed: float = 0.0) -> Clip:
    """Hips sway and the chest swings once in PERIOD frames, on a way that turns by degrees a period."""
    phase = 2 * math.pi * torch.arange(frames, dtype=torch.float64) / PERIOD
    facing = math.radians(turn) * torch.arange(frames, dtype=torch.float64) / PERIOD
    hips = torch.stack([facing, 0.2 * phase.sin()], dim=1)
    chest = torch.stack([facing, 0.6 * (phase + 1.0).sin()], dim=1)
    around = from_euler("z", facing[:, None])
    sway = torch.stack([0.1 * phase.sin(), 0 * phase, 1.0 + 0.2 * phase.cos()], dim=1)
    steps = (around @ torch.tensor([0.0, -speed / PERIOD, 0.0], dtype=torch.float64)).cumsum(0)
    rotations = torch.stack([from_euler("zx", hips), from_euler("zx", chest)], dim=1)
    return Clip("sway", small_body().skeleton, rotations, (around @ sway[..., None])[..., 0] + steps, 30.0)


@pytest.mark.parametrize("frames", [PERIOD, PERIOD + 1])
@pytest.mark.parametrize(("turn", "speed"), [(0.0, 0.0), (0.0, 1.3), (40.0, 1.3)])
def test_a_cycle_is_found_with_and_without_its_first_frame_again(
    frames: int, turn: float, speed: float
) -> None:
    clip = swaying(frames, turn, speed)
    cycle = make_cycle(clip)
    assert (len(cycle), cycle.gap) == (PERIOD, 0.0)
    torch.testing.assert_close(cycle.motion.rotations[:-1], clip.rotations[:PERIOD])
    whole = swaying(PERIOD + 1, turn, speed).positions()
    assert (cycle.motion.positions() - whole).norm(dim=-1).max() < 0.002
    transforms = cycle.motion.transforms(torch.float64)
    torch.testing.assert_close(compose(cycle.travel, transforms[0]), transforms[-1])
    assert ("closes around the root" in cycle.line()) == (speed > 0)


def test_a_gap_is_spread_so_that_the_seam_is_as_other_frames() -> None:
    clip = swaying(PERIOD)
    share = torch.arange(PERIOD, dtype=torch.float64)[:, None] / PERIOD
    drift = share * torch.tensor([0.0, 0.0, 0.06], dtype=torch.float64)
    lean = from_euler("x", 0.2 * share)[:, None]
    open_end = replace(clip, rotations=lean @ clip.rotations, translation=clip.translation + drift)
    cycle = make_cycle(open_end)
    assert 0.055 < cycle.gap < 0.075
    assert f"its end was {1000 * cycle.gap:.0f} mm from its start, which is spread" in cycle.line()
    path = cycle.motion.positions()
    steps = torch.cat([path, path[1:3]]).diff(dim=0)
    bends = steps.diff(dim=0).norm(dim=-1).mean(-1)
    assert bends[PERIOD - 2 : PERIOD + 1].max() < 1.3 * bends[: PERIOD - 2].max()


def test_what_is_no_cycle_is_refused_and_a_cycle_in_it_is_named() -> None:
    with pytest.raises(InputError, match=r"sway: a cycle \(--loop\) needs at least 8 frames, not 1"):
        make_cycle(swaying(1))
    with pytest.raises(InputError, match=r"sway: is no cycle .* mm from its start.*and no part of it is one"):
        make_cycle(swaying(PERIOD // 2))
    with pytest.raises(InputError, match=r"its frames \d+:\d+ come closest to one") as error:
        make_cycle(swaying(3 * PERIOD // 2))
    first, last = map(int, str(error.value).partition("its frames ")[2].split()[0].split(":"))
    assert last - first == PERIOD
