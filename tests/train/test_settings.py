"""Settings of a run by part: a method's own `batch` and `seed` are none of the loop's."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from train.loop import LoopConfig, Objective, fit
from train.state import STATE
from uvcloth.checkpoint import load_tensors
from uvcloth.errors import InputError

pytest.importorskip("lightning_fabric")

LOOP = LoopConfig(steps=1, batch=2, validate_every=1, average=0.0, seed=3)


class Line(Objective):
    """One weight, of a method whose settings are named as the loop's are."""

    samples = torch.arange(4)

    def __init__(self, **method: Any) -> None:
        self.method = method

    def networks(self) -> dict[str, nn.Module]:
        return {"net": nn.Linear(1, 1)}

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        self.rows = rows
        loss = networks["net"](rows[:, None].float()).square().mean()
        yield "net", loss, {"loss": loss}

    def validate(self, net: nn.Module) -> dict[str, float]:
        return {"mean_mm": 1.0}

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        self.saved = notes

    def settings(self) -> dict[str, Any]:
        return {"method": self.method}


def test_equal_names_stand_beside_each_other(tmp_path: Path) -> None:
    objective = Line(batch=64, seed=7)
    fit(objective, tmp_path, LOOP, resume=False)
    assert len(objective.rows) == 2
    assert objective.saved["loop"]["batch"] == 2
    settings = load_tensors(tmp_path / STATE)[1]["settings"]
    assert settings["method"] == {"batch": 64, "seed": 7}
    assert (settings["loop"]["batch"], settings["loop"]["seed"]) == (2, 3)


def test_each_part_is_compared_for_itself(tmp_path: Path) -> None:
    fit(Line(batch=64, seed=7), tmp_path, LOOP, resume=False)
    longer = replace(LOOP, steps=2)
    with pytest.raises(InputError, match=r"was started with loop\.batch = 2, not 4"):
        fit(Line(batch=64, seed=7), tmp_path, replace(longer, batch=4), resume=True)
    with pytest.raises(InputError, match=r"was started with method\.seed = 7, not 3"):
        fit(Line(batch=64, seed=3), tmp_path, longer, resume=True)
    fit(Line(batch=64, seed=7), tmp_path, longer, resume=True)
    assert load_tensors(tmp_path / STATE)[1]["done"]["step"] == 2
