"""Poses are compared wherever the body stands and faces; training motion is found by its content."""

import math
from pathlib import Path

import pytest
import torch

from evaluate.judge import Candidate
from evaluate.motion_map import embedded, motion_maps, seed_positions
from evaluate.show import Shown
from tests.train.simulated import save_clips, swaying
from uvcloth.bodies.body import Body
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.garments.templates import fit_template
from uvcloth.methods.registry import load_method

pytest.importorskip("sklearn")


def test_place_and_heading_do_not_count(body: Body) -> None:
    transforms = swaying(4, seed=0).transforms()
    angle = 2.5
    turn = torch.tensor([
        [math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0], [0.0, 0.0, 1.0]
    ])  # fmt: skip
    moved = turn @ transforms
    moved[..., 3] += torch.tensor([1.0, -2.0, 0.5])
    poses = seed_positions(body, transforms)
    torch.testing.assert_close(seed_positions(body, moved), poses, atol=1e-4, rtol=0)
    assert (poses[0] - poses[2]).abs().max() > 0.05


def test_like_poses_lie_together() -> None:
    generator = torch.Generator().manual_seed(0)
    poses = torch.cat([torch.randn(40, 6, generator=generator) + 20.0 * k for k in range(2)])
    places = embedded(poses)
    assert places.min() >= 0.0
    assert places.max() <= 1.0
    first, second = places[:40], places[40:]
    assert (first.mean(0) - second.mean(0)).norm() > 2.0 * torch.cat([first.std(0), second.std(0)]).max()
    assert torch.equal(embedded(poses), places)
    assert embedded(poses[:2]).shape == (2, 2)


def test_a_map_per_training_set(body: Body, tmp_path: Path) -> None:
    save_clips(tmp_path, ("tops", "dress"), clips=3, frames=12)
    judged = load_simulated(tmp_path / "clip0_tops.npz")
    seen = ("clip1_tops", "clip1_dress", "clip2_tops")
    known = frozenset(load_simulated(tmp_path / f"{name}.npz").files[f"{name}.npz"] for name in seen)
    lbs = load_method("lbs", body)

    def candidate(name: str, seen: frozenset[str]) -> Candidate:
        return Candidate(name, lbs, 0.0, "", seen)

    moving = judged.transforms[judged.warm_up :]
    shown = [
        Shown("jump", "clip0", fit_template(template, body), 30.0, 1, moving, {})
        for template in ("tops", "dress")
    ]
    one, two, none = (candidate(*c) for c in (("one", known), ("two", known), ("none", frozenset({"x"}))))
    together, elsewhere = motion_maps([candidate("lbs", frozenset()), one, two, none], tmp_path, shown, body)
    assert together.methods == ("one", "two")
    assert (together.count, together.of) == (3, 3)
    # Two garments of one clip are one motion.
    assert together.training.shape == (2 * 9, 2)
    assert together.tests["jump"].shape == (9, 2)
    assert (elsewhere.methods, elsewhere.count, elsewhere.of) == (("none",), 0, 1)
    assert elsewhere.training.shape == (0, 2)
    assert torch.equal(elsewhere.tests["jump"], together.tests["jump"])
    assert motion_maps([candidate("lbs", frozenset())], tmp_path, shown, body) == []
