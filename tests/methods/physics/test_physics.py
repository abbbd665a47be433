"""Physics: the solver on cages as a method, alone and as the finish of another one."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import pytest
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.frames import body_frames, side_by_side, with_lead
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import edge_lengths, unique_edges
from uvcloth.geometry.skinning import skin
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.lbs import LBSConfig, LinearBlendSkinning, create_lbs
from uvcloth.methods.method import Method
from uvcloth.methods.physics.finish import Finished, StaticFinish, finished
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, make_caged_outfit
from uvcloth.methods.registry import load_method
from uvcloth.motion.library import load_clip
from uvcloth.motion.stop import come_to_rest
from uvcloth.physics.exposure import Exposure
from uvcloth.physics.fabric import FABRICS
from uvcloth.physics.layers import wrong_side_percent
from uvcloth.physics.obstacle import Obstacle
from uvcloth.rollouts.rollout import BrokenRolloutError, rollout

FPS = 30.0


@lru_cache
def _caged(outfit: Outfit, config: PhysicsConfig) -> CagedOutfit:
    return make_caged_outfit(outfit, config)


class _PreparedOnce(Physics):
    """Physics of which all tests share what it makes for an outfit."""

    def prepare(self, outfit: Outfit, device: torch.device) -> CagedOutfit:
        return _caged(outfit, self.config)


FAST, DEFAULT = _PreparedOnce(PhysicsConfig("fast")), _PreparedOnce(PhysicsConfig())


def test_coarser_cages_give_way_to_compression_as_longer_strips_do() -> None:
    fast, default = PhysicsConfig("fast").compression, PhysicsConfig().compression
    assert fast / default == pytest.approx((QUALITIES["default"] / QUALITIES["fast"]) ** 2)
    assert replace(PhysicsConfig(), buckling=1.0).compression == 1.0


@pytest.fixture(scope="module")
def skirt(body: Body) -> Outfit:
    return Outfit(body, (fit_template("skirt", body),))


@pytest.fixture(scope="module")
def trousers_and_shirt(body: Body) -> Outfit:
    return Outfit(body, (fit_template("bottoms", body), fit_template("tops", body)))


def _sliding(body: Body, frames: int, stop: int, speed: float = 1.5) -> Tensor:
    """Transforms (T, J, 3, 4) of a body that slides sideways, stiff, and stops dead."""
    transforms = torch.eye(3, 4).expand(frames, len(body.skeleton.names), 3, 4).clone()
    transforms[..., 0, 3] = (torch.arange(frames).clamp(max=stop) * speed / FPS)[:, None]
    return transforms


def _garment(method: object, outfit: Outfit, transforms: Tensor, fps: float = FPS) -> Tensor:
    return torch.stack([frame.vertices[0] for frame in rollout(method, outfit, transforms, fps)])  # type: ignore[arg-type]


def test_cloth_swings_on_after_the_body_has_stopped(skirt: Outfit) -> None:
    transforms = _sliding(skirt.body, 34, stop=20)
    garment = skirt.garments[0]
    moved = _garment(FAST, skirt, transforms)
    skinned = skin(garment.mesh.vertices, garment.smooth_weights, transforms)
    hem = garment.mesh.vertices[:, 2] < garment.mesh.vertices[:, 2].min() + 0.05
    off = (moved - skinned)[:, hem, 0].mean(1)
    assert float(off[20]) < -0.02
    assert float(off[21:].max()) > float(off[20]) + 0.03
    speed = (moved[1:] - moved[:-1])[:, hem].norm(dim=-1).mean(1) * FPS
    assert float(speed[22:26].mean()) > 0.1


def test_cloth_starts_settled_and_stays_so_while_the_body_stands(skirt: Outfit) -> None:
    moved = _garment(FAST, skirt, _sliding(skirt.body, 6, stop=0))
    assert float((moved[-1] - moved[0]).norm(dim=1).mean()) < 0.006


def test_a_clip_that_starts_in_a_run_starts_dressed_and_moving(skirt: Outfit) -> None:
    """No knee is through the skirt in the first frame, and the skirt is not left behind in the next ones."""
    transforms = load_clip("run", skirt.body).window(6, 4).transforms()
    frames = list(rollout(FAST, skirt, transforms, FPS))
    garment = skirt.garments[0]
    exposure = Exposure(skirt.body, [garment.mesh])
    assert exposure.percent(frames[0].vertices, frames[0].body_vertices) < 0.05
    moved = torch.stack([frame.vertices[0] for frame in frames])
    off = moved - skin(garment.mesh.vertices, garment.smooth_weights, transforms)
    assert float((off[3] - off[0]).norm(dim=1).mean()) < 0.13


def test_garments_are_off_the_body_in_a_dance(body: Body, trousers_and_shirt: Outfit) -> None:
    transforms, outfit = load_clip("dance", body).window(20, 12).transforms(), trousers_and_shirt
    frames = list(rollout(FAST, outfit, transforms, FPS))
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    for place, garment in enumerate(outfit.garments):
        contact = obstacle.contact_garment(garment.mesh.vertices)
        vertices = torch.stack([frame.vertices[place] for frame in frames])
        posed = torch.stack([frame.body_vertices for frame in frames])
        assert float(obstacle.inside_percent(vertices, contact, posed).mean()) < 0.3
    outer, inner = (torch.stack([frame.vertices[place] for frame in frames]) for place in (1, 0))
    assert wrong_side_percent(outer, inner, outfit.garments[0].mesh.faces) < 0.5


def test_sleeves_stay_whole_as_a_crouch_begins_to_turn(body: Body, trousers_and_shirt: Outfit) -> None:
    """A vertex that is followed too far over the body stays on a wrong face and stretches edges.

    With that fault 1.25 to 1.6 edges a frame are over 3 times their length, without it 0.3 to 0.8.
    """
    outfit, tops = trousers_and_shirt, trousers_and_shirt.garments[1]
    frames = list(rollout(DEFAULT, outfit, load_clip("twirl", body).transforms()[:16], 30.0))
    edges = unique_edges(tops.mesh.faces)
    shirts = torch.stack([frame.vertices[1] for frame in frames])
    stretch = edge_lengths(shirts, edges) / edge_lengths(tops.mesh.vertices, edges).clamp(min=1e-3)
    assert float(stretch.max()) < 5.0
    assert float((stretch > 3.0).sum(1).float().mean()) < 1.0


def test_a_shirt_does_not_stay_rucked_up_after_a_sudden_stop(body: Body, trousers_and_shirt: Outfit) -> None:
    """The fine simulation's hem is 0.97 m high at the end; with soft compression alone it was 1.03 m."""
    outfit, tops = trousers_and_shirt, trousers_and_shirt.garments[1]
    stop = come_to_rest(load_clip("twirl", body).window(0, 18), 0.5).transforms()
    *_, last = rollout(DEFAULT, outfit, stop, 30.0)
    hem = tops.mesh.vertices[:, 2] < tops.mesh.vertices[:, 2].min() + 0.03
    assert float(last.vertices[1][hem, 2].mean()) < 0.99


def test_it_goes_the_same_way_far_from_the_origin(skirt: Outfit) -> None:
    """A rollout is computed around the root; the state moves with it."""
    transforms = _sliding(skirt.body, 12, stop=12, speed=3.0).double()
    far = transforms.clone()
    far[..., 1, 3] += 1000.0
    here, there = _garment(FAST, skirt, transforms), _garment(FAST, skirt, far)
    there[..., 1] -= 1000.0
    assert float((there - here).norm(dim=-1).mean()) < 0.001


def test_rollouts_side_by_side_are_those_alone(skirt: Outfit) -> None:
    method, body = FAST, skirt.body
    prepared = method.prepare(skirt, torch.device("cpu"))
    motions = [_sliding(body, 3, stop, 2.0) for stop in (0, 3)]
    each = [body_frames(body, with_lead(motion), FPS) for motion in motions]
    both = side_by_side(each)
    together = method.step(prepared, method.init(prepared, both[::3]), both[1::3])[1][0]
    for place, frames in enumerate(each):
        alone = method.step(prepared, method.init(prepared, frames[:1]), frames[1:2])[1][0]
        assert alone[0].equal(together[place])


def test_a_heavier_stiffer_fabric_moves_otherwise(skirt: Outfit) -> None:
    denim = replace(skirt, garments=(replace(skirt.garments[0], fabric=FABRICS["denim"]),))
    transforms = _sliding(skirt.body, 8, stop=8, speed=2.0)
    apart = (_garment(FAST, skirt, transforms) - _garment(FAST, denim, transforms)).norm(dim=-1)
    assert float(apart[-1].max()) > 0.005


def _unheld(body: Body) -> Garment:
    """A garment without a hem, far below the shoulders."""
    lowered = replace(body.mesh, vertices=body.mesh.vertices - torch.tensor([0.0, 0.0, 1.0]))
    return replace(fit_template("tops", body), template=None, source="file", mesh=lowered)


def test_what_cannot_be_solved_is_said(body: Body) -> None:
    assert "that would hold it" in FAST.unsupported_reason(Outfit(body, (_unheld(body),)))


@dataclass(frozen=True)
class _Lifted(LinearBlendSkinning):
    """Skinned garments, 5 cm higher."""

    def step(self, prepared, state, frames):  # type: ignore[no-untyped-def]
        state, garments = super().step(prepared, state, frames)
        return state, tuple(vertices + torch.tensor([0.0, 0.0, 0.05]) for vertices in garments)


def test_a_finish_lies_between_the_prediction_and_physics(skirt: Outfit) -> None:
    transforms = _sliding(skirt.body, 10, stop=0)
    guide = _Lifted("lifted", smooth=True)
    free = _garment(FAST, skirt, transforms)[-1]
    none = _garment(Finished.of(guide, FAST, 0.0), skirt, transforms)[-1]
    assert float((none - free).norm(dim=1).mean()) < 0.004
    heights = [
        _garment(Finished.of(guide, FAST, pull), skirt, transforms)[-1, :, 2].mean() for pull in (5.0, 60.0)
    ]
    predicted = _garment(guide, skirt, transforms)[-1, :, 2].mean()
    assert float(free[:, 2].mean()) < float(heights[0]) < float(heights[1]) < float(predicted) + 0.002


def test_a_finish_lets_cloth_swing_on_where_the_prediction_freezes(skirt: Outfit) -> None:
    """Energy after the body has stopped; a critically damped pull leaves half of it."""
    transforms = _sliding(skirt.body, 34, stop=20)
    guide = create_lbs(LBSConfig(smooth=True))
    free, pulled = (
        float(_garment(method, skirt, transforms)[21:].diff(dim=0).square().sum(2).mean())
        for method in (FAST, Finished.of(guide, FAST))
    )
    assert 0.7 < pulled / free < 1.2


def test_a_finish_keeps_the_name_and_the_reasons_of_its_method(body: Body) -> None:
    finished = Finished.of(create_lbs(LBSConfig(smooth=True)), FAST)
    assert finished.name == "lbs_smooth"
    assert finished.traits.reads_fabric
    dress: Garment = fit_template("dress", body)
    assert Finished.of(load_method("pbns", body), FAST).unsupported_reason(Outfit(body, (dress,)))


def test_trained_methods_are_finished_by_the_solver_where_it_can_move_the_outfit(body: Body) -> None:
    tops, trousers = fit_template("tops", body), fit_template("bottoms", body)
    outfit = Outfit(body, (trousers, tops))
    unheld = Outfit(body, (trousers, _unheld(body)))
    trained, baseline = load_method("physxnet", body), load_method("lbs_smooth", body)
    usual, cleared = finished(trained, outfit, None, FAST)
    assert isinstance(usual, Finished)
    assert usual.guide.name == "physxnet"
    assert cleared
    for method, worn in (
        (trained, unheld),
        (baseline, outfit),
        (FAST, outfit),
        (Ensemble((baseline, FAST)), outfit),
    ):
        assert finished(method, worn, None, FAST) == (method, True)
    assert finished(trained, outfit, "clear", FAST) == (trained, True)
    assert finished(trained, outfit, "none", FAST) == (trained, False)
    assert isinstance(finished(baseline, outfit, "dynamic", FAST)[0], Finished)
    assert isinstance(finished(FAST, outfit, "static", FAST)[0], StaticFinish)


def test_a_settled_pose_does_not_depend_on_what_was_before(skirt: Outfit) -> None:
    """Forwards, and backwards at another speed: the garments are the same."""
    method = StaticFinish.of(create_lbs(LBSConfig(smooth=True)), FAST, 0.0)
    assert not method.traits.autoregressive
    transforms = _sliding(skirt.body, 3, stop=3, speed=3.0)
    forwards = _garment(method, skirt, transforms)
    backwards = _garment(method, skirt, transforms.flip(0), 4 * FPS).flip(0)
    assert float((forwards - backwards).norm(dim=-1).mean()) < 0.0005
    standing = _garment(FAST, skirt, transforms[:1])
    assert float((forwards[0] - standing[0]).norm(dim=-1).mean()) < 0.003


@dataclass(frozen=True)
class _Lost(LinearBlendSkinning):
    """Skinned garments that are no numbers where the body is 0.1 m beside its start."""

    def step(self, prepared, state, frames):  # type: ignore[no-untyped-def]
        state, garments = super().step(prepared, state, frames)
        lost = frames.transforms[:, -1, 0, 0, 3] > 0.05
        return state, tuple(torch.where(lost[:, None, None], torch.nan, each) for each in garments)


@pytest.mark.parametrize("finish", [Finished.of, StaticFinish.of])
def test_a_prediction_that_is_no_number_is_named_and_forgotten(
    skirt: Outfit, finish: Callable[..., Method]
) -> None:
    transforms = _sliding(skirt.body, 5, stop=0)
    transforms[2, :, 0, 3] = 0.1
    method = finish(_Lost("lost", smooth=True), FAST, 2.0)
    frames = list(rollout(method, skirt, transforms, FPS, keep_going=True))
    assert [bool(frame.replaced) for frame in frames] == [False, False, True, False, False]
    assert "frame 2: garment skirt left the finite numbers" in frames[2].replaced[0]
    assert all(torch.isfinite(frame.vertices[0]).all() for frame in frames)
    with pytest.raises(BrokenRolloutError, match="frame 2"):
        list(rollout(method, skirt, transforms, FPS))


def test_the_frame_rate_does_not_matter(skirt: Outfit) -> None:
    """Half a second after the start of a slide the skirt hangs back alike."""
    ends = []
    for fps in (24.0, 60.0, 120.0):
        frames = round(0.5 * fps) + 1
        transforms = torch.eye(3, 4).expand(frames, len(skirt.body.skeleton.names), 3, 4).clone()
        transforms[..., 0, 3] = (torch.arange(frames) * 0.8 / fps)[:, None]
        moved = _garment(FAST, skirt, transforms, fps)
        ends.append(moved[-1])
    for end in ends[1:]:
        assert float((end - ends[0]).norm(dim=-1).mean()) < 0.015


def test_a_turned_scene_gives_the_turned_garment(skirt: Outfit) -> None:
    """Rounding alone differs, which cloth in free fall, as after a dead stop, would make far more of."""
    transforms = _sliding(skirt.body, 30, stop=30, speed=0.3)
    turn = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    plain, turned = _garment(FAST, skirt, transforms), _garment(FAST, skirt, turn @ transforms)
    assert float((turned - plain @ turn.T).norm(dim=-1).mean(1).max()) < 0.0005
