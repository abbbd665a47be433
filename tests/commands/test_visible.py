"""`--wrinkles`: finer meshes where a network serves a garment, plain cloth and a sentence elsewhere."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from uvcloth.bodies.body import Body, load_body
from uvcloth.checkpoint import TrainingData, save_checkpoint
from uvcloth.commands.rollout import Rollout
from uvcloth.commands.run.visible import visible_outfit
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.proxy import ProxiedOutfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.lbs import LBS
from uvcloth.methods.method import Method
from uvcloth.methods.physics.method import Physics
from uvcloth.physics.surface import BodySurface
from uvcloth.rollouts.rollout import JUMPED, RolloutFrame
from uvcloth.wrinkles.model import Wrinkles, wrinkles_checkpoint
from uvcloth.wrinkles.network import WrinkleConfig, WrinkleNet

COMMAND = Rollout(motion="walk", garment=("tops",), out=(Path("walk.npz"),), wrinkles=True)


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


@pytest.fixture(scope="module")
def run(body: Body, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that pushes cloth 4 mm into the body."""
    config = WrinkleConfig(width=4, levels=2)
    net = WrinkleNet(config)
    net.output_scale.fill_(0.004)
    torch.nn.init.constant_(net.last.bias[8:], -1.0)
    folder = tmp_path_factory.mktemp("run") / "trained"
    save_checkpoint(wrinkles_checkpoint(Wrinkles(config, net), body, TrainingData(), {}), folder)
    return folder


def test_options_that_do_not_go_together_are_refused() -> None:
    with pytest.raises(InputError, match="--wrinkles-from: goes with --wrinkles"):
        replace(COMMAND, wrinkles=False, wrinkles_from=Path("run")).run()
    with pytest.raises(InputError, match="--wrinkles: cannot be closed into a loop yet"):
        replace(COMMAND, loop=True).run()


def test_a_method_without_cages_is_refused(body: Body) -> None:
    outfit = ProxiedOutfit.as_is(Outfit(body, (fit_template("tops", body),)))
    method = LBS.create(LBS.config)
    with pytest.raises(InputError, match="--wrinkles: lie on what the cloth solver moves, not on lbs"):
        visible_outfit(COMMAND, method, outfit)


def test_a_missing_network_is_named(body: Body, tmp_path: Path) -> None:
    outfit = ProxiedOutfit.as_is(Outfit(body, (fit_template("tops", body),)))
    with pytest.raises(InputError, match="not a trained model"):
        visible_outfit(replace(COMMAND, wrinkles_from=tmp_path), Physics(), outfit)


def test_pictures_of_a_t_shirt_have_wrinkles_unless_they_are_plain(body: Body) -> None:
    def refined(name: str = "tops", on: Body = body, method: Method | None = None, **options: Any) -> bool:
        outfit = ProxiedOutfit.as_is(Outfit(on, (fit_template(name, body),)))
        command = replace(COMMAND, **{"wrinkles": False, "out": (Path("a.mp4"), Path("b.png")), **options})
        return visible_outfit(command, method or Physics(), outfit).wrinkled is not None

    assert refined()
    assert not refined(plain=True)
    assert not refined(out=(Path("a.mp4"), Path("a.glb")))
    assert not refined(loop=True)
    assert not refined(quality="fast")
    assert not refined("bottoms")
    assert not refined("shirt")
    assert refined("shirt", wrinkles=True)
    assert not refined(on=replace(body, name="other"))
    assert not refined(method=LBS.create(LBS.config))
    with pytest.raises(InputError, match="--wrinkles: --plain leaves them out"):
        replace(COMMAND, plain=True).run()


def test_wrinkles_on_a_t_shirt_and_plain_trousers(body: Body, run: Path) -> None:
    outfit = Outfit(body, (fit_template("bottoms", body), fit_template("tops", body)))
    visible = visible_outfit(replace(COMMAND, wrinkles_from=run), Physics(), ProxiedOutfit.as_is(outfit))
    trousers, shirt = outfit.garments
    assert visible.meshes[0] is trousers.mesh
    assert len(visible.meshes[1].faces) == 4 * len(shirt.mesh.faces)
    assert visible.lines == (
        "  garment bottoms: wrinkles are trained for tops, not bottoms: it stays plain",
        f"  tops: wrinkles on {len(visible.meshes[1].vertices)} vertices",
    )
    frame = RolloutFrame(
        index=0,
        raw=(trousers.mesh.vertices, shirt.mesh.vertices),
        vertices=(trousers.mesh.vertices, shirt.mesh.vertices),
        transforms=torch.eye(3, 4).expand(len(body.skeleton.names), 3, 4),
        body_vertices=body.mesh.vertices,
        milliseconds={"body": 0.0},
        difficulties=(JUMPED,),
    )
    (shown,) = visible.frames([frame], 30.0)
    _, vertices = shown.vertices
    assert vertices.shape == visible.meshes[1].vertices.shape
    assert "wrinkles" in shown.milliseconds
    pushed = (visible.meshes[1].vertices - vertices).norm(dim=1)
    assert 0.001 < float(pushed.median()) < 0.006
    # What was pushed into the body is cleared.
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    assert float((surface.closest(vertices).signed_distance < 0.0).float().mean()) < 0.002
