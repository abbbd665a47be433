"""Garments do not depend on where the body is, nor on what was before a jump of the motion."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from tests.motion.bvh_text import bvh_text, performer
from tests.test_rollout import FPS, Recorder, falling, outfit
from tests.thorough import always
from uvcloth.bodies.body import load_body
from uvcloth.bodies.stream import BATCH, posed_batches
from uvcloth.commands.run.summary import Totals
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.registry import load_method
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip
from uvcloth.rollouts.rollout import JUMPED, RolloutFrame, prepare_rollout, rollout

FAR = torch.tensor([10_000.123, -7_000.456, 300.789], dtype=torch.float64)
"""Metres, no number that float32 has."""

METHODS = {
    "lbs_smooth": ("dress",),
    "physxnet": ("dress",),
    "motion_guided": ("dress",),
    "pbns": ("bottoms", "tops"),
    "deepsd": ("tops",),
}


def moved(clip: Clip, shift: Tensor) -> Clip:
    return replace(clip, translation=clip.translation.double() + shift)


@cache
def dressed(*garments: str) -> Outfit:
    body = load_body()
    return Outfit(body, tuple(fit_template(garment, body) for garment in garments))


@pytest.mark.parametrize(
    "name",
    always(["lbs_smooth", "motion_guided"], ["lbs_smooth", "physxnet", "motion_guided", "pbns", "deepsd"]),
)
def test_garments_are_the_same_ten_kilometres_away(name: str) -> None:
    """To 0.1 mm is asked; every method that ships, over two changes of the origin, also when cleared."""
    worn = dressed(*METHODS[name])
    clip = load_clip("run", worn.body).window(20, 2 * BATCH + 3)
    prepared = prepare_rollout(load_method(name, worn.body), worn)
    here, there = (
        list(prepared.around_root(moved(clip, shift).transforms(torch.float64), clip.fps))
        for shift in (torch.zeros(3), FAR)
    )
    for near, far in zip(here, there, strict=True):
        torch.testing.assert_close(far.origin, near.origin + FAR, atol=1e-9, rtol=0)
        for one, other in zip((*near.raw, *near.vertices), (*far.raw, *far.vertices), strict=True):
            assert (one - other).abs().max() < 1e-4


def test_a_motion_file_is_read_as_exactly_ten_kilometres_away(tmp_path: Path) -> None:
    """In inches, with six digits after the point: the body takes the same steps to 0.1 micrometres."""
    joints = performer()
    values = np.zeros((12, sum(len(joint[3]) for joint in joints)))
    values[:, 0] = np.linspace(0.0, 3.0, 12) ** 2
    values[:, 1] = 40.0
    steps = []
    for place in (0.0, 400_000.0):
        path = tmp_path / f"{place}.bvh"
        far = values.copy()
        far[:, 0] += place
        path.write_text(bvh_text(joints, far), encoding="utf-8")
        clip = load_clip(path, load_body())
        steps.append(clip.translation - clip.translation[0])
    assert clip.translation[0].norm() > 9_000
    assert steps[0].norm(dim=1).max() > 0.1
    torch.testing.assert_close(steps[1], steps[0], atol=1e-7, rtol=0)


def test_a_frame_in_the_world_is_where_the_motion_leads() -> None:
    worn, motion = outfit(), falling(BATCH + 3).double()
    motion[..., 3] += FAR
    for frame in rollout(Recorder(True), worn, motion, FPS, clear=False):
        torch.testing.assert_close(frame.transforms.double(), motion[frame.index], atol=1e-3, rtol=0)
        assert not frame.origin.any()


def jumping(frames: int, at: int) -> Tensor:
    """Both joints stand still, and are 5 m farther from one frame on."""
    transforms = torch.eye(3, 4).repeat(frames, 2, 1, 1)
    transforms[at:, :, 0, 3] = 5.0
    return transforms


def test_what_was_before_a_jump_is_not_seen_after_it() -> None:
    batches = list(posed_batches(outfit().body, jumping(7, at=3), FPS))
    assert [(len(batch.frames), batch.begins) for batch in batches] == [(3, True), (4, True)]
    assert not torch.cat([batch.frames.velocity for batch in batches]).any()
    together = list(posed_batches(outfit().body, jumping(7, at=3), FPS, jumps=False))
    assert [len(batch.frames) for batch in together] == [7]
    torch.testing.assert_close(together[0].frames.velocity.amax(), torch.tensor(5.0 * FPS))


def test_falling_is_no_jump() -> None:
    assert sum(batch.begins for batch in posed_batches(outfit().body, falling(60), FPS)) == 1


def ran(motion: Tensor) -> list[RolloutFrame]:
    worn = dressed("dress")
    return list(rollout(load_method("motion_guided", worn.body), worn, motion, FPS))


def test_a_garment_starts_anew_where_the_motion_jumps() -> None:
    """As in a clip that begins there; without a new start edges were stretched 11.8 times."""
    clip = load_clip("walk", load_body()).window(0, 12)
    turned = clip.transforms()[6:].clone()
    turned[..., 0, 3] += 5.0
    whole, alone = ran(torch.cat([clip.transforms()[:6], turned])), ran(turned)
    assert [frame.index for frame in whole if JUMPED in frame.difficulties] == [6]
    for one, other in zip(whole[6:], alone, strict=True):
        torch.testing.assert_close(one.vertices[0], other.vertices[0], atol=1e-5, rtol=0)
    totals = Totals()
    for frame in whole:
        totals.add(frame)
    lines = totals.summary((), 1.0, 1).lines()
    assert f"difficult at frame 6: {JUMPED}" in lines


def test_difficult_frames_are_summed_up_as_spans() -> None:
    frame = next(rollout(Recorder(), outfit(), falling(1), FPS, clear=False))
    totals = Totals()
    for index in (3, 4, 5, 9, 20, 21, *range(30, 60, 2)):
        totals.add(replace(frame, index=index, difficulties=("the body is upside down",)))
    line = next(line for line in totals.summary((), 1.0, 1).lines() if line.startswith("difficult"))
    assert line == "difficult at frames 3-5, 9, 20-21, 30, 32, ... to 58 (21 in all): the body is upside down"
