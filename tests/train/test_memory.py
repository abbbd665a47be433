"""What the network sees of its own last predictions in training."""

from dataclasses import replace
from pathlib import Path

import torch

from tests.train.simulated import save_clips
from train.physxnet import LOSSES, PhysXNetObjective
from uvcloth.methods.physxnet import PRESETS


def seen_memory(forget: float, folder: Path) -> torch.Tensor:
    """The memory channels (B, C, H, W) that unmirrored samples are shown; all predictions so far were 1."""
    config = replace(PRESETS["tiny"], templates=("tops",))
    objective = PhysXNetObjective(config, replace(LOSSES["tiny"], forget=forget), folder, folder / "run")
    objective.past.fill_(1.0)
    shown: list[torch.Tensor] = []
    net = objective.networks()["net"]
    net.register_forward_pre_hook(lambda _, inputs: shown.append(inputs[0]))
    rows = objective.samples.repeat(4)
    list(objective.steps({"net": net}, rows))
    return shown[0][len(rows) // 2 :, -3 * config.history :]


def test_as_many_samples_as_asked_for_have_no_memory(tmp_path: Path) -> None:
    save_clips(tmp_path, ("tops",), clips=2, frames=14)
    assert (seen_memory(1.0, tmp_path) == 0).all()
    assert (seen_memory(0.0, tmp_path)[:, -3:] == 1).float().mean() > 0.9
    torch.manual_seed(0)
    blank = (seen_memory(0.5, tmp_path) == 0).flatten(1).all(1).float().mean()
    assert 0.25 < blank < 0.75
