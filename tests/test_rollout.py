from dataclasses import dataclass, replace
from itertools import count

import pytest
import torch

from tests.small_body import small_body
from tests.train.simulated import swaying
from uvcloth.bodies.body import load_body
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.bodies.stream import BATCH
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skinning import skin
from uvcloth.methods.capabilities import Feedback
from uvcloth.methods.method import Method, Traits
from uvcloth.methods.physxnet.config import PRESETS
from uvcloth.methods.physxnet.method import PhysXNet
from uvcloth.physics.layers import wrong_side_percent
from uvcloth.physics.outfit_clearing import OutfitClearing
from uvcloth.rollouts.rollout import (
    STRETCHED,
    BrokenRolloutError,
    prepare_rollout,
    roll_out_together,
    rollout,
)

FPS = 30.0


def outfit() -> Outfit:
    body = small_body()
    mesh = replace(body.mesh, vertices=body.mesh.vertices * 1.2)
    return Outfit(body, (Garment("shell", "tops", mesh, body.weights, body.weights),))


def clothed() -> Outfit:
    body = load_body()
    return Outfit(body, (fit_template("tops", body),))


def falling(frames: int) -> torch.Tensor:
    """Both joints fall freely: constant acceleration."""
    transforms = torch.eye(3, 4).repeat(frames, 2, 1, 1)
    transforms[:, :, 2, 3] = (-0.5 * 9.81 * (torch.arange(frames) / FPS) ** 2)[:, None]
    return transforms


@dataclass
class Recorder(Method, Feedback):
    """Skins the garment and keeps the body frames that it was shown; its state is what was fed back."""

    autoregressive: bool = False
    name: str = "recorder"
    prepared: int = 0

    @property
    def traits(self):
        return Traits(autoregressive=self.autoregressive)

    def prepare(self, outfit, device):
        self.prepared += 1
        self.seen = []
        return outfit.garments

    def step(self, garments, fed_back, frames):
        self.seen.append(frames)
        transforms = frames.transforms[:, -1]
        return fed_back, tuple(skin(g.mesh.vertices, g.weights, transforms) for g in garments)

    def feed_back(self, prepared, state, garments):
        self.fed_back = garments
        return garments


@pytest.mark.parametrize("autoregressive", [False, True])
def test_streams_every_frame_with_its_true_history(autoregressive):
    worn, motion = outfit(), falling(2 * BATCH + 3)
    method = Recorder(autoregressive)
    frames = list(rollout(method, worn, iter(motion), FPS, clear=False))
    assert [frame.index for frame in frames] == list(range(len(motion)))
    whole = body_frames(worn.body, with_lead(motion).double(), FPS)
    shown = torch.cat([part.acceleration for part in method.seen])
    # What float32 makes of it: places within half a metre of the origin, times 900 per second squared.
    torch.testing.assert_close(shown.double(), whole.acceleration, atol=1e-4, rtol=0)
    assert max(len(part) for part in method.seen) == (1 if autoregressive else BATCH)
    for frame, transforms in zip(frames, motion, strict=True):
        torch.testing.assert_close(frame.transforms, transforms)
        expected = skin(worn.garments[0].mesh.vertices, worn.garments[0].weights, transforms[None])[0]
        torch.testing.assert_close(frame.vertices[0], expected)
    # Free fall from the fourth frame on: the body's acceleration is g.
    torch.testing.assert_close(
        shown[6:, -1, :, 2], torch.full((len(motion) - 6, 8), -9.81), rtol=0.02, atol=0.0
    )


def test_takes_a_stream_without_reading_ahead():
    """After the first batch, no more of the motion has been read than that batch."""
    read = []

    def stream():
        for index, transforms in enumerate(falling(1000)):
            read.append(index)
            yield transforms

    next(iter(rollout(Recorder(True), outfit(), stream(), FPS, clear=False)))
    assert len(read) == BATCH


def test_clearing_leaves_no_vertex_inside():
    worn = outfit()
    inside = worn.garments[0].mesh.vertices * 0.79
    mesh = Mesh(inside, worn.garments[0].mesh.faces, worn.body.mesh.uvs, worn.body.mesh.face_uvs)
    tight = Outfit(worn.body, (Garment("tight", "tops", mesh, *[worn.body.weights] * 2),))
    timed = replace(prepare_rollout(Recorder(False), tight), clock=count(5.0, 0.002).__next__)
    frame = next(iter(timed.frames(falling(2), FPS)))
    assert frame.raw[0].abs().max() < 0.1
    assert frame.vertices[0].abs().amax(1).min() > 0.094
    assert frame.milliseconds["network"] == pytest.approx(1.0)
    assert frame.milliseconds["clearing"] == pytest.approx(2.0)


@dataclass
class Slipping(Recorder):
    """Skins garments, trousers too far in front and the shirt too far behind."""

    def step(self, garments, state, frames):
        aside = {"bottoms": -0.015, "tops": 0.015}
        return state, tuple(
            skin(g.mesh.vertices, g.smooth_weights, frames.transforms[:, -1])
            + torch.tensor([0.0, aside[g.name], 0.0])
            for g in garments
        )


def test_clearing_keeps_an_outer_garment_over_the_inner_one():
    body = load_body()
    bottoms, tops = (fit_template(name, body) for name in ("bottoms", "tops"))
    motion = swaying(3, seed=0).transforms()

    def finished(*garments):
        frames = list(rollout(Slipping(False), Outfit(body, garments), motion, FPS))
        return [torch.stack(vertices) for vertices in zip(*(f.vertices for f in frames), strict=True)]

    (below,), (alone,) = finished(bottoms), finished(tops)
    both = finished(bottoms, tops)
    assert torch.equal(both[0], below)
    assert wrong_side_percent(alone, below, bottoms.mesh.faces) > 5.0
    assert wrong_side_percent(both[1], below, bottoms.mesh.faces) < 0.5


def test_what_clearing_left_is_fed_back_to_an_autoregressive_method():
    method = Recorder(True)
    for frame in prepare_rollout(method, outfit()).around_root(falling(3), FPS):
        kept = frame.vertices
    assert torch.equal(method.fed_back[0][0], kept[0])


def test_rollouts_of_one_preparation_are_those_of_their_own():
    method, worn = Recorder(True), outfit()
    prepared = prepare_rollout(method, worn)
    for motion in (falling(5), falling(3)):
        for one, other in zip(
            prepared.frames(motion, FPS), rollout(Recorder(True), worn, motion, FPS), strict=True
        ):
            assert torch.equal(one.vertices[0], other.vertices[0])
    assert method.prepared == 1


def test_rollouts_side_by_side_are_those_alone():
    method, worn = PhysXNet.untrained(replace(PRESETS["tiny"], templates=("tops",))), clothed()
    method.net.output_scale.fill_(0.01)
    motions = [swaying(frames, seed=frames).transforms() for frames in (BATCH + 3, BATCH + 1)]
    prepared = method.prepare(worn, torch.device("cpu"))
    together = list(roll_out_together(method, prepared, worn, motions, FPS))
    assert len(together) == BATCH + 1
    for index, motion in enumerate(motions):
        alone = rollout(method, worn, motion, FPS, clear=False)
        for (both,), frame in zip(together, alone, strict=False):
            torch.testing.assert_close(both[index], frame.vertices[0], atol=1e-5, rtol=0.0)


def test_stops_at_the_frame_that_is_not_finite():
    motion = falling(12)
    motion[10, 1, 0, 0] = torch.nan
    with pytest.raises(InputError, match="frame 10"):
        list(rollout(Recorder(False), outfit(), motion, FPS, clear=False))


@dataclass
class Exploding(Recorder):
    def step(self, garments, state, frames):
        state, (vertices,) = super().step(garments, state, frames)
        return state, (vertices / (len(self.seen) < 6),)


@dataclass
class Tearing(Recorder):
    def step(self, garments, state, frames):
        state, (vertices,) = super().step(garments, state, frames)
        return state, (vertices * (9.0 if len(self.seen) == 4 else 1.0),)


def test_a_method_that_tears_its_garment_is_stopped():
    with pytest.raises(BrokenRolloutError, match=r"frame 3: garment shell is torn"):
        list(rollout(Tearing(True), outfit(), falling(9), FPS, clear=False))


@dataclass
class Ninefold(Recorder):
    """A baseline whose garment has nine times its size."""

    @property
    def traits(self):
        return Traits(is_baseline=True)

    def step(self, garments, state, frames):
        state, (vertices,) = super().step(garments, state, frames)
        return state, (9.0 * vertices,)


def test_a_baseline_that_tears_its_garment_goes_on_and_says_so():
    frames = list(rollout(Ninefold(), outfit(), falling(3), FPS, clear=False))
    assert [frame.replaced for frame in frames] == [(), (), ()]
    assert all(frame.difficulties == (STRETCHED,) for frame in frames)


def test_a_torn_frame_is_skinned_instead_where_the_rollout_keeps_going():
    """The frame is the garment as its weights move it, says so, and is fed back; others are as predicted."""
    method, worn, motion = Tearing(True), outfit(), falling(9)
    prepared = prepare_rollout(method, worn, clear=False)
    frames = list(prepared.around_root(motion, FPS, keep_going=True))
    assert [frame.index for frame in frames if frame.replaced] == [3]
    assert "garment shell is torn" in frames[3].replaced[0]
    garment = worn.garments[0]
    expected = skin(garment.mesh.vertices, garment.smooth_weights, motion[:, :])
    for frame in frames:
        torch.testing.assert_close(frame.in_world().vertices[0], expected[frame.index])
    torch.testing.assert_close(method.fed_back[0][0] + frames[3].origin.float(), expected[3])


def test_an_explosion_is_skinned_away_too():
    frames = list(rollout(Exploding(True), outfit(), falling(9), FPS, clear=False, keep_going=True))
    assert [frame.index for frame in frames if frame.replaced] == [5, 6, 7, 8]
    assert all(torch.isfinite(frame.vertices[0]).all() for frame in frames)


@pytest.mark.parametrize("autoregressive", [False, True])
@pytest.mark.parametrize("every", [3, 2 * BATCH + 1])
def test_thinned_frames_are_those_of_the_whole_rollout(autoregressive, every):
    worn, motion = outfit(), falling(3 * BATCH + 5)
    whole, thinned = Recorder(autoregressive), Recorder(autoregressive)
    frames = list(rollout(whole, worn, motion, FPS, clear=False))[::every]
    fewer = list(rollout(thinned, worn, motion, FPS, clear=False, every=every))
    assert [frame.index for frame in fewer] == [frame.index for frame in frames]
    for one, other in zip(fewer, frames, strict=True):
        assert torch.equal(one.vertices[0], other.vertices[0])
        assert torch.equal(one.transforms, other.transforms)
    predicted = sum(len(part) for part in thinned.seen)
    assert predicted == (len(motion) if autoregressive else len(frames))


@dataclass
class Remembering(Recorder):
    """An autoregressive method that takes no notice of what clearing left."""

    def feed_back(self, prepared, state, garments):
        return state


@pytest.mark.parametrize(("method", "resolved"), [(Remembering(True), 3), (Recorder(True), 7)])
def test_clearing_leaves_out_the_frames_that_nobody_goes_on_from(monkeypatch, method, resolved):
    cleared, calls = OutfitClearing.cleared, []

    def counted(self, garments, *rest):
        calls.append(garments)
        return cleared(self, garments, *rest)

    monkeypatch.setattr(OutfitClearing, "cleared", counted)
    frames = list(rollout(method, outfit(), falling(7), FPS, clear=True, every=3))
    assert [frame.index for frame in frames] == [0, 3, 6]
    assert len(calls) == resolved


def test_a_method_that_explodes_is_stopped_at_its_frame():
    with pytest.raises(InputError, match=r"frame 5: garment shell"):
        list(rollout(Exploding(True), outfit(), falling(9), FPS, clear=False))


@dataclass
class Following(Recorder):
    """An autoregressive method that stays a metre above the garment that was last fed back."""

    def step(self, garments, state, frames):
        _, skinned = super().step(garments, state, frames)
        return state, tuple(vertices + torch.tensor([0.0, 0.0, 1.0]) for vertices in state or skinned)


@pytest.mark.parametrize("clear", [False, True])
def test_the_truth_is_fed_back_as_far_as_it_is_given(clear):
    worn, still = outfit(), torch.eye(3, 4).repeat(6, 2, 1, 1)
    truth = [(worn.garments[0].mesh.vertices + torch.tensor([10.0 * k, 0.0, 0.0]),) for k in (1, 2, 3)]
    frames = list(rollout(Following(True), worn, still, FPS, clear, truth))
    up = torch.tensor([0.0, 0.0, 1.0])
    for before, frame in zip(truth, frames[1:4], strict=True):
        torch.testing.assert_close(frame.raw[0], before[0] + up)
    # From then on it is on its own: it sees what clearing left, and without it nothing at all.
    alone = frames[3].vertices[0] if clear else truth[-1][0]
    torch.testing.assert_close(frames[4].raw[0], alone + up)


def test_a_method_without_feedback_takes_no_notice_of_the_truth():
    method, worn = Recorder(False), outfit()
    truth = [(worn.garments[0].mesh.vertices + 1.0,)] * 3
    told, untold = (list(rollout(method, worn, falling(3), FPS, truth=known)) for known in (truth, ()))
    assert not hasattr(method, "fed_back")
    for one, other in zip(told, untold, strict=True):
        assert torch.equal(one.vertices[0], other.vertices[0])
