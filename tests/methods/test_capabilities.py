"""Capabilities of methods, and wrappers that forward them."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import torch

from uvcloth.bodies.body import Body, load_body, resized
from uvcloth.bodies.frames import BodyFrames, body_frames, with_lead
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import apply_transforms
from uvcloth.methods.capabilities import (
    CAPABILITIES,
    Feedback,
    FinishAware,
    Representation,
    Riggable,
    Swinging,
    before_finish,
    feed_back,
    garment_space,
    round_trip,
    with_dynamics,
)
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.method import Method, Traits
from uvcloth.methods.physics.finish import Finished
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.methods.registry import load_method
from uvcloth.methods.resized import Resized
from uvcloth.rollouts.rollout import rollout

CPU = torch.device("cpu")
RIG: Any = "the rig"


@dataclass(frozen=True)
class Bare(Method):
    """Frozen garments, and no capability."""

    name: str = "bare"

    def prepare(self, outfit: Outfit, device: torch.device) -> Any:
        return outfit.garments

    def step(self, prepared: Any, state: Any, frames: BodyFrames) -> Any:
        return state, tuple(garment.mesh.vertices[None] for garment in prepared)


class Raised:
    """A space whose only code raises the garment, in metres."""

    size = 1

    def __init__(self, garment: Garment) -> None:
        self.rest = garment.mesh.vertices

    def encode(self, vertices: torch.Tensor, transforms: torch.Tensor) -> torch.Tensor:
        height = vertices[..., 2].mean(1) - self.rest[:, 2].mean() - transforms[:, 0, 2, 3]
        return height[:, None]

    def decode(self, codes: torch.Tensor) -> torch.Tensor:
        return self.rest + codes[:, :, None] * torch.tensor([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Able(Bare, Feedback, FinishAware, Riggable, Swinging, Representation):
    """Every capability; its maps show everything at a height that is a multiple of 10 cm."""

    name: str = "able"
    traits = Traits(autoregressive=True, keeps_off_body=True, reads_fabric=True, is_baseline=True)

    def feed_back(self, prepared: Any, state: Any, garments: Any) -> Any:
        return garments

    def before_finish(self) -> Method:
        return Able("before a finish")

    def as_rig(self, body: Body, garments: tuple[Garment, ...] = ()) -> Any:
        return RIG

    def with_dynamics(self, factor: float) -> Method:
        return Able(f"{factor:g} times as lively")

    def round_trip(self, prepared: Any, frames: BodyFrames, garments: Any) -> Any:
        return tuple((10 * vertices).round() / 10 for vertices in garments)

    def garment_space(self, garment: Garment, body: Body) -> Any:
        return Raised(garment)


def wrapped(method: Method) -> list[Method]:
    physics = Physics(PhysicsConfig())
    return [Ensemble.of((Bare(), method)), Resized(method, 2.0, "twice"), Finished.of(method, physics)]


@pytest.mark.parametrize("kind", CAPABILITIES)
def test_a_method_has_a_capability_by_its_class(kind: type) -> None:
    assert Able().capability(kind) == Able()
    assert Bare().capability(kind) is None


@pytest.mark.parametrize("kind", CAPABILITIES)
def test_wrappers_have_a_capability_only_if_the_method_inside_has_it(kind: type) -> None:
    # A finish has cages in any case.
    bare = [type(wrapper) for wrapper in wrapped(Bare()) if wrapper.capability(kind)]
    assert bare == ([Finished] if kind is Representation else [])
    ensemble, twice, finished = (bool(wrapper.capability(kind)) for wrapper in wrapped(Able()))
    assert twice
    assert ensemble == (kind is not Riggable)
    # What the solver moves needs no clearing and is no rig; it feeds the method inside by itself.
    assert finished == (kind is Representation)


def test_traits_of_wrappers_are_those_of_the_methods_inside() -> None:
    still, able = Bare(), Able()
    assert Resized(able, 2.0, "twice").traits == able.traits
    assert Ensemble.of((still, able)).traits == Traits(autoregressive=True, reads_fabric=True)


def test_a_resized_method_is_asked_in_its_own_size() -> None:
    body = load_body()
    garment = fit_template("tops", body)
    outfit = Outfit(body, (garment,))
    twice = Resized(Able(), 2.0, "twice")
    prepared = twice.prepare(outfit, CPU)
    frames = body_frames(body, with_lead(torch.eye(3, 4).expand(1, len(body.skeleton.names), 3, 4)), 30.0)
    worn = (torch.tensor([[[0.04, 0.12, 0.51]]]),)
    torch.testing.assert_close(feed_back(twice, prepared, (), worn)[0], 2 * worn[0])
    shown = round_trip(twice, prepared, frames, worn)
    assert shown is not None
    torch.testing.assert_close(shown[0], torch.tensor([[[0.05, 0.1, 0.5]]]))
    space = garment_space(twice, garment, body)
    assert space is not None
    codes = torch.tensor([[0.0], [0.3]])
    decoded = space.decode(codes)
    torch.testing.assert_close(decoded[1] - decoded[0], torch.tensor([0.0, 0.0, 0.15]).expand_as(decoded[0]))
    up = torch.eye(3, 4).repeat(2, 1, 1, 1)
    up[..., 2, 3] = 0.7
    torch.testing.assert_close(space.encode(decoded + torch.tensor([0.0, 0.0, 0.7]), up), codes)
    assert before_finish(twice) == Resized(Able("before a finish"), 2.0, "twice")


def test_an_ensemble_asks_each_method_for_its_garment() -> None:
    body = load_body()
    garments = tuple(fit_template(name, body) for name in ("bottoms", "tops"))
    both = Ensemble.of((Able(), Able()))
    prepared = both.prepare(Outfit(body, garments), CPU)
    frames = body_frames(body, with_lead(torch.eye(3, 4).expand(1, len(body.skeleton.names), 3, 4)), 30.0)
    worn = (torch.full((1, 2, 3), 0.12), torch.full((1, 3, 3), 0.29))
    shown = round_trip(both, prepared, frames, worn)
    assert shown is not None
    assert [tuple(each.shape) for each in shown] == [(1, 2, 3), (1, 3, 3)]
    assert [round(float(each.mean()), 3) for each in shown] == [0.1, 0.3]
    half = Ensemble.of((Able(), Bare()))
    assert round_trip(half, prepared, frames, worn) is None
    assert garment_space(half, garments[0], body) is not None
    assert feed_back(both, prepared, ((), ()), worn) == ((worn[0],), (worn[1],))
    state = ((), ())
    assert feed_back(Ensemble.of((Bare(), Bare())), prepared, state, worn) is state


def test_a_body_that_is_no_adult_gets_no_rig_of_a_rig_and_other_methods_are_none() -> None:
    body = resized(load_body(), 0.6)
    pbns = load_method("pbns", load_body())
    rig = Resized(pbns, 1.0 / 0.6, "pbns").capability(Riggable)
    assert rig is not None
    with pytest.raises(InputError, match=r"model pbns: writes rigs for bodies of 1.4 to 2.2 m"):
        rig.as_rig(body)
    assert load_method("physxnet", body).name == "physxnet"
    assert isinstance(load_method("physxnet", body), Resized)
    assert load_method("physxnet", body).capability(Riggable) is None


def test_dynamics_are_scaled_inside_a_wrapper_and_refused_by_name() -> None:
    able, lively = Able(), Able("2 times as lively")
    assert with_dynamics(Resized(able, 2.0, "twice"), 2.0) == Resized(lively, 2.0, "twice")
    assert with_dynamics(Ensemble.of((able, able)), 2.0) == Ensemble((lively, lively), "able+able")
    for method in (Bare(), Ensemble.of((able, Bare()))):
        with pytest.raises(InputError, match="--dynamics 2: model bare cannot scale its motion"):
            with_dynamics(method, 2.0)


def test_the_method_of_the_contributing_page_runs() -> None:
    page = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    code = re.findall(r"```python\n(.*?)```", page, re.DOTALL)[0]
    names: dict[str, Any] = {
        "dataclass": dataclass,
        "Method": Method,
        "Traits": Traits,
        "apply_transforms": apply_transforms,
    }
    exec(code, names)
    body = load_body()
    garment = fit_template("tops", body)
    turn = torch.eye(3, 4).repeat(2, len(body.skeleton.names), 1, 1)
    turn[1, :, 2, 3] = 0.1
    frames = list(rollout(names["HipBound"](), Outfit(body, (garment,)), turn, 30.0, clear=False))
    up = torch.tensor([0.0, 0.0, 0.1])
    torch.testing.assert_close(frames[1].vertices[0], garment.mesh.vertices + up, atol=1e-5, rtol=0)
