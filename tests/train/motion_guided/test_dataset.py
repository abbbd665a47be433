"""Rows of clips of different frame rates, and the velocities that training sees."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from train.motion_guided.dataset import GarmentDataset
from train.motion_guided.objective import DynamicsObjective
from train.motion_guided.run import LOSSES
from uvcloth.bodies.body import load_body
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.garments.templates import fit_template
from uvcloth.methods.motion_guided.config import PRESETS

STEP = 0.05
"""Metres from frame to frame."""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> GarmentDataset:
    """A body that drifts along X in a dress, at 30 and at 60 frames a second; a third clip validates."""
    folder, body = tmp_path_factory.mktemp("rates"), load_body()
    garment = fit_template("dress", body)
    transforms = torch.eye(3, 4).repeat(7, len(body.skeleton.names), 1, 1)
    transforms[:, :, 0, 3] = STEP * torch.arange(7)[:, None]
    for clip, fps in (("a", 30.0), ("b", 60.0), ("c", 60.0)):
        sequence = clip_of_garment(
            vertices=garment.mesh.vertices + transforms[:, :1, :, 3],
            faces=garment.mesh.faces,
            rest=garment.mesh.vertices,
            transforms=transforms,
            fps=fps,
            warm_up=4,
            metadata={"clip": clip, "garment": "dress", "body": body.name},
        )
        save_simulated(sequence, folder / f"{clip}_dress.npz")
    return GarmentDataset(PRESETS["tiny"], LOSSES["tiny"], [folder])


class Seeing(nn.Module):
    """In place of the dynamic encoder: keeps the motion maps that it was shown."""

    def change(self, motion: Tensor, *_: Tensor) -> Tensor:
        self.motion = motion
        return torch.zeros(len(motion), 1)

    def forward(self, features: Tensor, change: Tensor) -> Tensor:
        return torch.zeros(len(features), PRESETS["tiny"].latent)


def test_rows_are_led_in_and_know_their_clip(dataset: GarmentDataset) -> None:
    """Of the seven frames of each clip the last six are kept, of which the last three count."""
    assert dataset.training.rows.fps.tolist() == [30.0] * 6 + [60.0] * 6
    assert dataset.training.rows.starts.tolist() == [0] * 6 + [6] * 6
    assert dataset.training.rows.samples.tolist() == [3, 4, 5, 9, 10, 11]
    assert dataset.training.vertices[0].mean(0)[0] == pytest.approx(
        float(dataset.maps.points.mean(0)[0]) + STEP, abs=1e-4
    )


def test_each_clip_moves_at_its_own_frame_rate(dataset: GarmentDataset) -> None:
    losses, net = replace(LOSSES["tiny"], unroll=1, past="true", still=False), Seeing()
    objective = DynamicsObjective(dataset, losses, dataset.config.shape_space())
    next(iter(objective.steps({"net": net}, torch.tensor([4, 10]))))
    pixels = dataset.maps.sheet.pixels
    offsets, reference = net.motion.flatten(2)[:, :, pixels].split(6, dim=1)
    for seen, speed in zip(reference, (30 * STEP, 60 * STEP), strict=True):
        expected = torch.tensor([speed, 0.0, 0.0, 0.0, 0.0, 9.81])[:, None].expand_as(seen)
        torch.testing.assert_close(seen, expected, atol=5e-3, rtol=0)
    assert offsets[:, :3].abs().max() < 0.02
