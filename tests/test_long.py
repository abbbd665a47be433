"""Long rollouts: neither memory nor the size of a file grows faster than the frames."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import torch

from evaluate.memory import process_megabytes
from tests.small_body import small_body
from tests.test_rollout import FPS, outfit
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.methods.registry import load_method
from uvcloth.rollouts.rollout import prepare_rollout
from uvcloth.writers.animation import Animation, local_pose
from uvcloth.writers.usd import write_usd
from uvcloth.writers.writer import open_writer

FRAMES = 360


def drifting(motion: torch.Tensor, frames: int, fps: float) -> Iterator[torch.Tensor]:
    """The frames of a motion (T, J, 3, 4) over and over, 1 m/s farther along x."""
    for index in range(frames):
        transforms = motion[index % len(motion)].clone()
        transforms[:, 0, 3] += index / fps
        yield transforms


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads memory as Linux tells it")
def test_memory_does_not_grow_with_the_frames(tmp_path: Path) -> None:
    """Here by 0.2 MB, with all of its parts: clearing, the rollout, and what writes both files."""
    worn = outfit()
    still = torch.eye(3, 4).repeat(7, 2, 1, 1).double()
    method = load_method("lbs_smooth", worn.body)
    frames = prepare_rollout(method, worn).around_root(drifting(still, FRAMES, FPS), FPS)
    meshes = [(garment.name, garment.mesh) for garment in worn.garments]
    with (
        open_writer(tmp_path / "long.pc2", meshes, worn.body, FPS) as one,
        open_writer(tmp_path / "long.usdc", meshes, worn.body, FPS) as other,
    ):
        for frame in islice(frames, FRAMES // 6):
            one.add(frame.vertices, frame.transforms)
        before, count = process_megabytes("RssAnon"), 0
        for frame in frames:
            for writer in (one, other):
                writer.add(frame.vertices, frame.transforms)
            count += 1
        grown = process_megabytes("RssAnon") - before
    assert count == FRAMES - FRAMES // 6
    assert grown < 1.0


def test_a_stage_grows_with_its_frames(tmp_path: Path) -> None:
    """Saved after every few frames, it repeated its tables of samples so often that most of it was tables."""
    sizes = []
    for frames in (1000, 4000):
        mesh = small_body().mesh
        moving = np.random.default_rng(0).normal(size=(frames, 8, 3)).astype(np.float32)
        joints = np.zeros((frames, 0, 3, 4), np.float32)
        path = tmp_path / f"{frames}.usdc"
        write_usd(Animation(("shell",), (mesh,), (moving,), None, joints, FPS), path)
        sizes.append(path.stat().st_size)
    assert sizes[1] < 4.4 * sizes[0]


def test_rotations_do_not_jump_between_parts_of_a_long_motion() -> None:
    turns = from_axis_angles(torch.linspace(0, 9.0, 40)[:, None, None] * torch.tensor([0.0, 0.0, 1.0]))
    transforms = torch.cat([turns, torch.zeros(40, 1, 3, 1)], dim=-1).repeat(1, 2, 1, 1).numpy()
    skeleton = small_body().skeleton
    _, whole = local_pose(skeleton, transforms)
    _, first = local_pose(skeleton, transforms[:17])
    _, second = local_pose(skeleton, transforms[17:], first[-1])
    np.testing.assert_array_equal(np.concatenate([first, second]), whole)
