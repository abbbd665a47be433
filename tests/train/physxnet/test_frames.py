"""Training frames as maps: motion by each clip's frame rate, what is seen of the past, and offsets."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.train.physxnet.two_triangles import BODY, CONFIG, PIXELS, prepared, save_clip
from train.physxnet.frames import Frames, load_frames, sheet_of
from train.physxnet.prepare import share_texels
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.reader import read_clips

BOTH = ("tops", "dress")
ASIDE = torch.tensor([0.0, 0.015625, -0.03125]).expand(4, 3)


@pytest.fixture
def frames(tmp_path: Path) -> Frames:
    """A clip of both garments at 10 frames a second, and one of the tops alone at 20, with no warm-up."""
    save_clip(tmp_path, "a", {"tops": 0.0 * ASIDE, "dress": ASIDE})
    save_clip(tmp_path, "b", {"tops": 2.0 * ASIDE}, frames=5, fps=20.0, warm_up=0)
    worn = read_clips([tmp_path], BOTH)
    seen = [prepared(BOTH)]
    shared = [share_texels(seen, name) for name in BOTH]
    return load_frames(replace(CONFIG, templates=BOTH), worn, seen, shared, "")


def test_rows_are_the_scored_frames_with_their_lead(frames: Frames) -> None:
    """Of the first clip frames 1 to 7 are kept, of which 3 to 7 count; of the second all, 2 to 4 count."""
    assert frames.rows.samples.tolist() == [2, 3, 4, 5, 6, 9, 10, 11]
    assert frames.rows.starts.tolist() == [0] * 7 + [7] * 5
    assert frames.present.tolist() == [[True, True]] * 7 + [[True, False]] * 5
    assert frames.rows.transforms.shape == (12, 2, 3, 4)
    assert frames.rows.transforms[0, 0, 0, 3].item() == pytest.approx(0.5 * 2.0 * 0.1**2)


def test_each_clip_moves_at_its_own_frame_rate(frames: Frames) -> None:
    """x = t^2: from frame k - 1 to k the velocity is (2 k - 1) / fps m/s, and the acceleration 2 m/s2."""
    seen = frames.motion.flatten(2)[:, :, PIXELS].float()
    for row, velocity in ((0, 0.1), (4, 0.9), (9, 0.15), (11, 0.35)):
        assert seen[row, 0].tolist() == pytest.approx([velocity] * 4, abs=1e-3)
    for row in (2, 6, 9, 11):
        assert seen[row, 3].tolist() == pytest.approx([2.0] * 4, abs=2e-2)
    assert seen[:, [1, 2, 4, 5]].abs().max() < 1e-4
    elsewhere = torch.ones(64, dtype=torch.bool)
    elsewhere[PIXELS] = False
    assert (frames.motion.flatten(2)[:, :, elsewhere] == 0).all()


def test_inputs_are_the_last_three_frames_oldest_first(frames: Frames) -> None:
    seen = frames.inputs(torch.tensor([4, 11]))
    assert seen.shape == (2, 18, 8, 8)
    velocities = seen[:, [0, 6, 12]].flatten(2)[:, :, PIXELS[0]]
    torch.testing.assert_close(
        velocities, torch.tensor([[0.5, 0.7, 0.9], [0.15, 0.25, 0.35]]), atol=1e-3, rtol=0
    )


def test_offsets_are_those_from_the_skinned_garment_and_zero_where_there_is_none(frames: Frames) -> None:
    tops, dress = frames.offsets
    torch.testing.assert_close(tops[:7].float(), torch.zeros(7, 4, 3), atol=1e-4, rtol=0)
    torch.testing.assert_close(tops[7:].float(), 2.0 * ASIDE.expand(5, 4, 3), atol=1e-4, rtol=0)
    torch.testing.assert_close(dress[:7].float(), ASIDE.expand(7, 4, 3), atol=1e-4, rtol=0)
    assert (dress[7:] == 0).all()


def test_values_lie_at_their_texels() -> None:
    values = torch.arange(24.0).view(1, 6, 4)
    sheet = sheet_of(values, prepared(("tops",)))
    assert (sheet.shape, sheet.dtype) == ((1, 6, 8, 8), torch.float16)
    assert sheet[0, 2, 1, 6].item() == values[0, 2, 1]
    assert sheet.float().sum() == values.sum()


def test_the_body_follows_its_transforms() -> None:
    lifted = torch.eye(3, 4).repeat(1, 2, 1, 1)
    lifted[0, 1, 2, 3] = 0.5
    moved = posed_skin(BODY, lifted)[0] - BODY.mesh.vertices
    upper = BODY.mesh.vertices[:, 2] > 0
    torch.testing.assert_close(moved[:, 2], 0.5 * upper)
