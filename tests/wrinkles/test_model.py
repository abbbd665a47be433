"""The network, its checkpoint, and what it serves."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.small_body import small_body
from tests.wrinkles.small_network import CONFIG, made_up_wrinkles
from tests.wrinkles.strip import garment, strip
from uvcloth.checkpoint import TrainingData, load_checkpoint, save_checkpoint
from uvcloth.errors import InputError
from uvcloth.physics.fabric import FABRICS
from uvcloth.wrinkles.inputs import CHANNELS
from uvcloth.wrinkles.model import Wrinkles, load_wrinkles, wrinkles_checkpoint
from uvcloth.wrinkles.network import WrinkleConfig, WrinkleNet, dealt


@pytest.fixture
def wrinkles() -> Wrinkles:
    return made_up_wrinkles()


def test_shapes_of_the_network() -> None:
    net = WrinkleNet(CONFIG)
    maps = torch.randn(3, CHANNELS, 32, 32)
    assert net(maps).shape == (3, 12, 32, 32)
    assert dealt(net(maps)).shape == (3, 3, 64, 64)
    assert float(net(maps).detach().abs().max()) == 0.0  # Untrained it makes no wrinkles.


def test_sizes_that_do_not_halve_are_refused() -> None:
    with pytest.raises(InputError, match="--size 60: has to be a multiple of 16 for --levels 4"):
        WrinkleConfig(size=60)


def test_a_checkpoint_gives_the_same_wrinkles(wrinkles: Wrinkles, tmp_path: Path) -> None:
    body = small_body()
    save_checkpoint(wrinkles_checkpoint(wrinkles, body, TrainingData(), {}), tmp_path / "run")
    again = load_wrinkles(tmp_path / "run")
    assert again.config == CONFIG
    maps = torch.randn(1, CHANNELS, 32, 32)
    torch.testing.assert_close(again.net(maps), wrinkles.net(maps), atol=2e-4, rtol=1e-2)  # Half precision.


def test_a_model_of_another_method_is_refused(wrinkles: Wrinkles, tmp_path: Path) -> None:
    body = small_body()
    save_checkpoint(
        replace(wrinkles_checkpoint(wrinkles, body, TrainingData(), {}), method="pbns"), tmp_path / "run"
    )
    assert load_checkpoint(tmp_path / "run").method == "pbns"
    with pytest.raises(InputError, match="a model of method 'pbns', expected wrinkles"):
        load_wrinkles(tmp_path / "run")


def test_what_a_network_was_not_trained_for_is_named() -> None:
    wrinkles = Wrinkles.untrained(CONFIG)
    assert wrinkles.unsupported_reason(garment(strip()), "default") == ""
    assert "trained for --quality default, not fast" in wrinkles.unsupported_reason(garment(strip()), "fast")
    silk = replace(garment(strip()), fabric=FABRICS["silk"])
    assert "trained for jersey, not for another fabric" in wrinkles.unsupported_reason(silk, "default")
    other = garment(strip(), "dress")
    assert "garment dress: wrinkles are trained for tops, not dress" in wrinkles.unsupported_reason(
        other, "default"
    )
