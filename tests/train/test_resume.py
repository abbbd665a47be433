"""Two steps, an interruption and two more give the same weights as four steps in one go, bit for bit."""

import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.thorough import always
from tests.train.simulated import save_clips
from train.loop import fit, rows_of_step
from train.physxnet.objective import PhysXNetObjective
from train.physxnet.run import LOOPS, LOSSES
from train.state import STATE
from uvcloth.checkpoint import load_tensors
from uvcloth.errors import InputError
from uvcloth.methods.physxnet.config import PRESETS

pytest.importorskip("lightning_fabric")

LOOP = replace(LOOPS["tiny"], steps=4, batch=4, validate_every=2, average=0.9)
NETWORK = replace(PRESETS["tiny"], templates=("tops", "bottoms"), dropout=0.2)
VARIANTS = {
    "default": (NETWORK, LOSSES["tiny"]),
    "no memory": (replace(NETWORK, history=0), LOSSES["tiny"]),
    "adversarial": (
        replace(PRESETS["paper"], size=32, width=8, templates=NETWORK.templates),
        LOSSES["paper"],
    ),
}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sequences")
    save_clips(folder, NETWORK.templates, clips=2, frames=14)
    return folder


class Interrupted(PhysXNetObjective):
    """Presses Ctrl-C in the middle of its second step."""

    asked = 0

    def steps(self, networks, rows):  # type: ignore[no-untyped-def]
        self.asked += 1
        for number, update in enumerate(super().steps(networks, rows)):
            yield update
            if (self.asked, number) == (2, 0):
                signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("variant", always(["adversarial"], ["default", "adversarial", "no memory"]))
def test_resuming_gives_the_weights_of_an_uninterrupted_run(variant: str, data: Path, tmp_path: Path) -> None:
    network, losses = VARIANTS[variant]

    def objective(run: str, kind: Callable[..., PhysXNetObjective] = PhysXNetObjective) -> PhysXNetObjective:
        return kind(network, losses, [data], tmp_path / run)

    fit(objective("whole"), tmp_path / "whole", LOOP, resume=False)
    with pytest.raises(KeyboardInterrupt):
        fit(objective("parts", Interrupted), tmp_path / "parts", LOOP, resume=False)
    assert load_tensors(tmp_path / "parts" / STATE)[1]["done"]["step"] == 2
    fit(objective("parts"), tmp_path / "parts", LOOP, resume=True)

    whole, _ = load_tensors(tmp_path / "whole" / STATE)
    parts, _ = load_tensors(tmp_path / "parts" / STATE)
    assert whole.keys() == parts.keys()
    for name, tensor in whole.items():
        assert torch.equal(tensor, parts[name]), name
    moved = [name for name in whole if name.startswith("network/net/") and name.endswith("weight")]
    start = objective("fresh").networks()["net"].state_dict()
    assert all(not torch.equal(whole[name], start[name.removeprefix("network/net/")]) for name in moved)

    with pytest.raises(InputError, match="learning_rate"):
        fit(objective("parts"), tmp_path / "parts", replace(LOOP, learning_rate=0.5), resume=True)
    other = PhysXNetObjective(network, replace(losses, edge=losses.edge + 1.0), [data], tmp_path / "parts")
    with pytest.raises(InputError, match=r"was started with losses.edge"):
        fit(other, tmp_path / "parts", LOOP, resume=True)
    with pytest.raises(InputError, match="--resume"):
        fit(objective("parts"), tmp_path / "parts", LOOP, resume=False)


def test_every_epoch_sees_every_row_once() -> None:
    samples = torch.arange(100, 121)
    epochs = [[rows_of_step(samples, LOOP, step) for step in range(5 * e, 5 * e + 5)] for e in range(2)]
    seen = [torch.cat(epoch) for epoch in epochs]
    for rows in seen:
        assert len(rows.unique()) == 20
        assert set(rows.tolist()) <= set(samples.tolist())
    assert not torch.equal(seen[0], seen[1])
