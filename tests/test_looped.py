"""Loops: the end of a rollout over a cycle joins its start, in the garments and in the files."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.test_rollout import Recorder, outfit
from tests.writers.glb_reader import GlbReader
from uvcloth.api import export, rollout
from uvcloth.bodies.body import Body
from uvcloth.commands.rollout import Rollout
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.rotations import from_euler
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.motion.clip import Clip
from uvcloth.motion.cycle import make_cycle
from uvcloth.writers.animation import Animation

FPS = 24.0
PERIOD = 24


def twisting(body: Body, way: float = 0.0) -> Clip:
    """A stiff body that twists to and fro and sways once a second, and goes forward by metres."""
    share = torch.arange(PERIOD, dtype=torch.float64) / PERIOD
    phase = 2 * math.pi * share + 1.0
    turns = from_euler("z", 0.6 * phase.sin()[:, None])
    heads = body.skeleton.heads.double()
    path = heads[0] + torch.stack([0.15 * phase.cos(), -way * share, 0 * phase], dim=1)
    count = len(body.skeleton.names)
    return Clip("twist", body.skeleton, turns[:, None].expand(-1, count, 3, 3), path, FPS)


@pytest.fixture(scope="module")
def clip(body: Body) -> Clip:
    return twisting(body, way=1.0)


@pytest.fixture(scope="module")
def loop(body: Body, clip: Clip) -> Animation:
    skirt = Outfit(body, (fit_template("skirt", body),))
    return rollout(Physics(PhysicsConfig("fast")), clip, skirt, loop=True)


def test_the_seam_of_a_loop_is_as_any_other_frame(loop: Animation, clip: Clip) -> None:
    vertices = torch.from_numpy(loop.vertices[0])
    way = make_cycle(clip).travel[:, 3].float()
    assert len(loop) == PERIOD + 1
    torch.testing.assert_close(vertices[-1], vertices[0] + way, atol=1e-5, rtol=0)
    steps = torch.cat([vertices, vertices[1:2] + way]).diff(dim=0)
    bends = steps.diff(dim=0).norm(dim=-1).mean(-1)
    sizes = steps.norm(dim=-1).mean(-1)
    assert sizes[PERIOD - 1] <= sizes[: PERIOD - 1].max()
    assert bends[PERIOD - 2 :].max() <= bends[: PERIOD - 2].max()
    assert sizes.mean() > 0.02


def test_files_of_a_loop_end_as_they_start(tmp_path: Path) -> None:
    worn = outfit()
    loop = rollout("lbs", twisting(worn.body), worn, finish="none", loop=True)
    (name,) = loop.names
    export(loop, tmp_path / "loop.glb")
    glb = GlbReader.load(tmp_path / "loop.glb")
    np.testing.assert_allclose(glb.times(), np.arange(PERIOD + 1) / FPS, atol=1e-6)
    start, end = (glb.morphed(name, glb.weights(name, frame)) for frame in (0, PERIOD))
    np.testing.assert_allclose(end, start, atol=1e-5)
    np.testing.assert_allclose(glb.posed("body", PERIOD), glb.posed("body", 0), atol=1e-5)
    usd = pytest.importorskip("pxr.Usd", reason="USD is not installed")
    export(loop, tmp_path / "loop.usdc")
    stage = usd.Stage.Open(str(tmp_path / "loop.usdc"))
    points = stage.GetPrimAtPath(f"/Outfit/{name}").GetAttribute("points")
    assert stage.GetEndTimeCode() == PERIOD
    np.testing.assert_allclose(np.array(points.Get(PERIOD)), np.array(points.Get(0)), atol=1e-5)


@dataclass
class Counted(Recorder):
    """A garment displaced by the number of frames so far, and torn in one of them."""

    torn: int = -1

    def init(self, garments, frames):
        return 0

    def step(self, garments, before, frames):
        _, skinned = super().step(garments, (), frames)
        away = torch.full((3,), 0.001 * before)
        if before == self.torn:
            away = away * torch.inf
        return before + 1, tuple(each + away for each in skinned)

    def feed_back(self, prepared, state, garments):
        return state


def test_what_still_differs_is_spread_over_the_overlap() -> None:
    """A garment that creeps by a millimetre a frame is back at the end, nowhere 8 times as fast."""
    worn = outfit()
    loop = rollout(Counted(autoregressive=True), twisting(worn.body), worn, finish="none", loop=True)
    still = rollout("lbs", twisting(worn.body), worn, finish="none", loop=True)
    away = torch.from_numpy(loop.vertices[0] - still.vertices[0]).mean(dim=(1, 2))
    torch.testing.assert_close(away[-1], away[0], atol=1e-5, rtol=0)
    assert float(away[0]) == pytest.approx(0.001 * 2 * PERIOD, abs=1e-5)
    assert float(away.diff().abs().max()) < 0.008
    # Half a second, 12 frames, begins as smoothly as it ends.
    overlap = away.diff()[-13:]
    torch.testing.assert_close(overlap, overlap.flip(0), atol=1e-6, rtol=0)


def test_what_breaks_before_the_loop_is_said_so() -> None:
    worn = outfit()
    for torn, reason in ((5, "in the repetitions before the loop, frame -43:"), (50, "frame 2:")):
        with pytest.raises(InputError, match=f"^{reason} garment shell left the finite numbers"):
            rollout(Counted(True, torn=torn), twisting(worn.body), worn, finish="none", loop=True)


def test_a_preview_of_a_loop_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--loop: --preview leaves out frames"):
        Rollout("walk", ("tops",), (tmp_path / "loop.png",), loop=True, preview=True).run()
