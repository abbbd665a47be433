"""The training loop on one weight: the running mean of the weights, and the rate of learning."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from train.loop import LoopConfig, Objective, fit, set_rates
from train.state import STATE
from uvcloth.checkpoint import load_tensors

pytest.importorskip("lightning_fabric")

STEPS = 6


class OneWeight(Objective):
    """Lowers a weight; remembers its value before every step."""

    def __init__(self) -> None:
        self.values: list[float] = []
        self.validated: list[int] = []

    @property
    def samples(self) -> Tensor:
        return torch.arange(4)

    def networks(self) -> dict[str, nn.Module]:
        return {"net": nn.Linear(1, 1, bias=False)}

    def steps(
        self, networks: Mapping[str, nn.Module], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        (weight,) = networks["net"].parameters()
        self.values.append(weight.item())
        loss = networks["net"](torch.ones(1, 1)).sum()
        yield "net", loss, {"loss": loss}

    def validate(self, net: nn.Module) -> dict[str, float]:
        self.validated.append(len(self.values))
        return {"score": next(net.parameters()).item()}

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        return

    def settings(self) -> dict[str, Any]:
        return {}


def test_the_running_mean_follows_the_weights_fast_at_first(tmp_path: Path) -> None:
    """Decay min(d, (1 + n) / (10 + n)) after n steps, as in TensorFlow's ExponentialMovingAverage."""
    objective = OneWeight()
    config = LoopConfig(steps=STEPS, average=0.3, learning_rate=0.1, schedule="constant", weight_decay=0.0)
    scores = fit(objective, tmp_path / "run", config, resume=False)
    (last,) = load_tensors(tmp_path / "run" / STATE)[0]["network/net/weight"].flatten().tolist()
    mean, *values = *objective.values, last
    for step, value in enumerate(values):
        decay = min(0.3, (1 + step) / (10 + step))
        mean = decay * mean + (1 - decay) * value
    assert scores["score"] == pytest.approx(mean, abs=1e-6)


def test_weights_are_validated_at_every_interval_and_at_the_end(tmp_path: Path) -> None:
    objective = OneWeight()
    fit(objective, tmp_path / "run", LoopConfig(steps=STEPS, validate_every=4), resume=False)
    assert objective.validated == [4, STEPS]


def test_the_rate_rises_and_falls_along_a_cosine() -> None:
    weight = nn.Parameter(torch.zeros(1))
    optimizer = torch.optim.SGD([weight], lr=9.0)
    config = LoopConfig(learning_rate=2.0)
    rates = []
    for share in (0.0, 0.005, 0.25, 0.5, 1.0):
        set_rates({"net": optimizer}, config, share)
        rates.append(optimizer.param_groups[0]["lr"])
    expected = [0.02, 2 * 0.51, 1 + math.cos(math.pi / 4), 1.0, 0.0]
    assert rates == pytest.approx(expected, abs=1e-3)
