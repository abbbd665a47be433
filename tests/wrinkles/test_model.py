"""The network, its checkpoint, and garments with its wrinkles."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import trimesh

from tests.small_body import small_body
from tests.wrinkles.strip import garment, strip
from uvcloth.checkpoint import TrainingData, load_checkpoint, save_checkpoint
from uvcloth.errors import InputError
from uvcloth.garments.refined import Refined
from uvcloth.physics.fabric import FABRICS
from uvcloth.physics.outfit_clearing import CLEARANCE
from uvcloth.physics.surface import BodySurface
from uvcloth.wrinkles.inputs import CHANNELS
from uvcloth.wrinkles.model import WrinkledGarment, Wrinkles, load_wrinkles, wrinkles_checkpoint
from uvcloth.wrinkles.network import WrinkleConfig, WrinkleNet, dealt

CONFIG = WrinkleConfig(size=64, width=4, levels=2)
FPS = 30.0


@pytest.fixture
def wrinkles() -> Wrinkles:
    """A network whose last layer is not zero, as after training."""
    torch.manual_seed(0)
    net = WrinkleNet(CONFIG)
    torch.nn.init.normal_(net.last.weight, std=1.0)
    return Wrinkles(CONFIG, net.eval())


def skin(away: float = 1.0) -> BodySurface:
    """The small body, so many metres beneath the strip."""
    body = small_body()
    return BodySurface(body.mesh.vertices - torch.tensor([0.0, 0.0, away]), body.mesh.faces)


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
    again = load_wrinkles(tmp_path / "run", body)
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
        load_wrinkles(tmp_path / "run", body)


def test_an_untrained_network_leaves_the_smooth_surface() -> None:
    cloth = garment(strip())
    wrinkled = WrinkledGarment(Wrinkles.untrained(CONFIG), cloth)
    vertices = strip(curvature=2.0).vertices
    shown = wrinkled.wrinkled(vertices, FPS, skin())
    torch.testing.assert_close(shown, Refined.of(cloth.mesh).at(vertices))


def test_wrinkles_turn_and_move_with_the_cloth(wrinkles: Wrinkles) -> None:
    """The inputs know no place: displacements of a body and cloth that are turned together are turned.

    But for gravity, around which the scene is turned.
    """
    vertices = strip(curvature=2.0).vertices
    turn = torch.tensor([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    shift = torch.tensor([1.0, -2.0, 0.5])
    body = small_body()
    here = WrinkledGarment(wrinkles, garment(strip())).wrinkled(vertices, FPS, skin())
    there_skin = BodySurface(skin().points @ turn.T + shift, body.mesh.faces)
    there = WrinkledGarment(wrinkles, garment(strip())).wrinkled(vertices @ turn.T + shift, FPS, there_skin)
    back = (there - shift) @ turn
    smooth = Refined.of(strip()).at(vertices)
    assert float((here - smooth).norm(dim=1).max()) > 1e-3
    torch.testing.assert_close(back, here, atol=1e-4, rtol=0.0)


def test_a_frame_depends_on_the_one_before_until_it_begins_again(wrinkles: Wrinkles) -> None:
    first, second = strip(curvature=1.0).vertices, strip(curvature=2.0).vertices
    wrinkled = WrinkledGarment(wrinkles, garment(strip()))
    alone = wrinkled.wrinkled(second, FPS, skin())
    wrinkled.begin()
    wrinkled.wrinkled(first, FPS, skin())
    after = wrinkled.wrinkled(second, FPS, skin())
    assert float((after - alone).norm(dim=1).max()) > 1e-5
    wrinkled.begin()
    torch.testing.assert_close(wrinkled.wrinkled(second, FPS, skin()), alone)


def test_wrinkles_keep_off_the_skin(wrinkles: Wrinkles) -> None:
    """On a block whose top is 5 mm beneath the strip."""
    block = trimesh.creation.box((2.0, 2.0, 2.0))
    top, far = (
        BodySurface(torch.tensor(block.vertices - [0.0, 0.0, 1.0 + away]), torch.tensor(block.faces))
        for away in (0.005, 0.05)
    )
    strong = Wrinkles(replace(CONFIG, gain=3.0), wrinkles.net)
    shown, free = (
        WrinkledGarment(strong, garment(strip())).wrinkled(strip().vertices, FPS, skin) for skin in (top, far)
    )
    assert float(free[:, 2].min()) < -0.004
    assert float(shown[:, 2].min()) > CLEARANCE - 0.005 - 1e-4


def test_what_is_shown_lags(wrinkles: Wrinkles) -> None:
    first, second = strip(curvature=1.0).vertices, strip(curvature=2.0).vertices
    smooth = Refined.of(strip()).at(second)

    def shown(lag: float) -> torch.Tensor:
        lagging = Wrinkles(replace(CONFIG, lag=lag), wrinkles.net)
        wrinkled = WrinkledGarment(lagging, garment(strip()))
        wrinkled.wrinkled(first, FPS, skin())
        return wrinkled.wrinkled(second, FPS, skin()) - smooth

    # Displacements are on the axes of the surface, which turns little here.
    at_once, late, never = shown(0.0), shown(1.0 / FPS), shown(10.0)
    whole = (never - at_once).norm()
    assert float((late - at_once).norm()) == pytest.approx(math.exp(-1.0) * float(whole), rel=0.05)


def test_the_gain_multiplies_what_is_shown(wrinkles: Wrinkles) -> None:
    vertices = strip(curvature=2.0).vertices
    smooth = Refined.of(strip()).at(vertices)
    more = Wrinkles(replace(CONFIG, gain=2.0), wrinkles.net)
    once, twice = (
        WrinkledGarment(each, garment(strip())).wrinkled(vertices, FPS, skin()) - smooth
        for each in (wrinkles, more)
    )
    torch.testing.assert_close(twice, 2.0 * once, atol=1e-6, rtol=1e-3)


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
