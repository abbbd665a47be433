"""What the rollout command writes and counts, and that Ctrl-C leaves nothing."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tests.writers.glb_reader import GlbReader, to_z_up
from uvcloth.commands.rollout import Rollout
from uvcloth.commands.run import rollout as animation
from uvcloth.commands.run import worn
from uvcloth.commands.run.rollout import animate
from uvcloth.commands.run.summary import Totals
from uvcloth.errors import InputError
from uvcloth.garments.proxy import ProxiedOutfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skinning import skin
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.method import Traits
from uvcloth.motion.library import load_clip
from uvcloth.rollouts import ready
from uvcloth.rollouts.rollout import BrokenRolloutError, RolloutFrame
from uvcloth.writers.animation import load_animation
from uvcloth.writers.pictures import COARSE_SHEET
from uvcloth.writers.writer import WRITERS

FRAMES = 4


def skinned(out, **options) -> Rollout:
    """A rollout of the tops over the walk by linear blend skinning."""
    files = tuple(out) if isinstance(out, list) else (out,)
    return Rollout("walk", ("tops",), files, ("lbs",), **options)


@pytest.fixture
def scene(monkeypatch, body):
    """Four frames of standing still in a triangle; the method puts one of its corners inside the belly."""
    clip = load_clip("walk", body).window(0, FRAMES)
    still = torch.cat([torch.eye(3), torch.zeros(3, 1)], 1).expand(FRAMES, len(body.skeleton.names), 3, 4)
    hips = body.skeleton.heads[0]
    raw = hips + torch.tensor([[0.0, -0.5, 0], [0.1, -0.5, 0], [0, 0, 0.05]])
    resolved = raw - torch.tensor([0, 0.5, 0])
    faces = torch.tensor([[0, 1, 2]])
    mesh = Mesh(raw, faces, torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64))

    def rollout(method, proxied, transforms, fps, clear, device, every, keep_going, first):
        for joints in still:
            yield RolloutFrame(
                raw=(raw,),
                vertices=(resolved,),
                transforms=joints,
                body_vertices=body.mesh.vertices,
                milliseconds={"network": 2.0},
                index=0,
                replaced=(),
            )

    monkeypatch.setattr(animation, "load_clip", lambda *_: clip)
    monkeypatch.setattr(
        worn, "load_outfit", lambda names, *_: tuple(SimpleNamespace(name=n, mesh=mesh) for n in names)
    )
    method = SimpleNamespace(
        traits=Traits(is_baseline=True),
        unsupported_reason=lambda outfit: "it itches" if len(outfit.garments) > 1 else "",
    )
    monkeypatch.setattr(ready, "load_method", lambda *_: method)
    monkeypatch.setattr(ready, "with_proxies", lambda outfit, _: ProxiedOutfit.as_is(outfit))
    monkeypatch.setattr(ready, "rollout_proxied", rollout)
    return SimpleNamespace(resolved=resolved, rollout=rollout)


def test_the_file_holds_the_resolved_frames(scene, tmp_path):
    out = tmp_path / "walk.npz"
    summary = animate(skinned(out))
    written = load_animation(out)
    assert written.names == ("tops",)
    torch.testing.assert_close(
        torch.tensor(written.vertices[0]), scene.resolved.expand(FRAMES, 3, 3), rtol=0, atol=1e-6
    )
    assert summary.written == (out,)
    assert summary.frames == FRAMES


def test_one_rollout_writes_every_file_that_is_asked_for(scene, tmp_path):
    wanted = [tmp_path / "walk.npz", tmp_path / "walk.glb"]
    assert animate(skinned(wanted)).written == tuple(wanted)
    assert len(load_animation(wanted[0])) == FRAMES
    glb = GlbReader.load(wanted[1])
    assert len(glb.times()) == FRAMES
    for frame in range(FRAMES):
        written = to_z_up(glb.morphed("tops", glb.weights("tops", frame)))
        assert np.abs(written - scene.resolved[glb.source("tops")].numpy()).max() < 1e-5


def test_the_summary_says_what_a_person_sees(monkeypatch, body, tmp_path):
    """A shirt that hangs two centimetres too far back lets the chest through, one in its place hardly any."""
    clip = load_clip("walk", body).window(0, FRAMES)
    shirt = fit_template("tops", body)

    def rollout(method, proxied, transforms, fps, clear, device, every, keep_going, first):
        aside = torch.tensor([0.0, 0.0 if clear else 0.02, 0.0])
        for joints in transforms.float():
            worn = skin(shirt.mesh.vertices, shirt.smooth_weights, joints[None])[0] + aside
            yield RolloutFrame(
                raw=(worn,),
                vertices=(worn,),
                transforms=joints,
                body_vertices=skin(body.mesh.vertices, body.weights, joints[None])[0],
                milliseconds={},
                index=0,
                replaced=(),
            )

    monkeypatch.setattr(animation, "load_clip", lambda *_: clip)
    monkeypatch.setattr(ready, "rollout_proxied", rollout)
    shown = [animate(skinned(tmp_path / "walk.npz", finish=finish)) for finish in ("clear", "none")]
    assert shown[0].skin.mean < 1.0
    assert shown[1].skin.mean > 10.0
    assert shown[1].skin.worst >= shown[1].skin.mean
    assert (
        f"skin will show through the cloth: on {shown[1].skin.mean:.2f} % of what it covers"
        in shown[1].lines()[-1]
    )


def test_the_summary_names_the_frame_to_look_at_and_what_was_replaced():
    totals = Totals()
    for index, percent in enumerate((0.0, 2.5, 1.0)):
        totals.frames += 1
        totals.add_shares(percent, 0.0, index)
    totals.replaced.append("frame 1: garment tops is torn")
    lines = totals.summary((), 1.0, 1).lines()
    assert "2.5 % at frame 1" in lines[-1]
    assert "frame 1: garment tops is torn" in lines


@pytest.mark.parametrize(
    ("skin", "cloth", "said"),
    [
        (0.0, 0.0, ("no skin and no inner garment shows",)),
        (1.0, 0.0, ("skin will show",)),
        (
            0.0,
            0.3,
            ("inner garments will show through outer ones: on 0.30 % .* at most on 0.3 % at frame 0",),
        ),
        (1.0, 0.03, ("skin will show", "inner garments .* at most on 0.03 % at frame 0")),
    ],
)
def test_the_summary_says_that_nothing_shows_only_where_nothing_does(skin, cloth, said):
    totals = Totals(several=True, frames=1)
    totals.add_shares(skin, cloth, 0)
    lines = totals.summary((), 1.0, 1).lines()[2:]
    assert len(lines) == len(said)
    assert all(re.match(expected, line) for expected, line in zip(said, lines, strict=True))


def test_a_preview_shows_every_third_frame_and_a_sheet_needs_fewer():
    assert animation._interval([Path("walk.mp4"), Path("walk.png")], 600) == 3
    assert animation._interval([Path("walk.png")], 600) == 599 // COARSE_SHEET.on_sheet
    assert animation._interval([Path("walk.png")], 5) == 3


def test_a_file_that_cannot_be_written_keeps_the_others_away(scene, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(WRITERS, ".glb", full)
    for order in (["a.npz", "a.glb"], ["a.glb", "a.npz"]):
        with pytest.raises(InputError, match=r"a\.glb: cannot be written \(No space left"):
            animate(skinned([tmp_path / name for name in order]))
        assert not list(tmp_path.iterdir())


def test_a_rollout_that_stops_keeps_the_frames_before(scene, tmp_path, monkeypatch):
    def stops(*arguments, **options):
        frames = scene.rollout(*arguments, **options)
        yield next(frames)
        yield next(frames)
        raise BrokenRolloutError("frame 2: garment tops is torn")

    monkeypatch.setattr(ready, "rollout_proxied", stops)
    with pytest.raises(
        InputError, match=r"frame 2: .* is torn; the 2 frames before it are in .*walk\.npz; --keep-going"
    ):
        animate(skinned(tmp_path / "walk.npz"))
    assert len(load_animation(tmp_path / "walk.npz")) == 2


@pytest.mark.parametrize("error", [KeyboardInterrupt(), InputError("the disk is full")])
def test_a_broken_rollout_leaves_nothing(scene, tmp_path, monkeypatch, error):
    def breaks(*arguments, **options):
        frames = scene.rollout(*arguments, **options)
        yield next(frames)
        raise error

    monkeypatch.setattr(ready, "rollout_proxied", breaks)
    with pytest.raises(type(error)):
        animate(skinned(tmp_path / "walk.npz"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("models", "place"), [(("physics",), None), (("lbs", "physics"), 1)])
def test_the_quality_is_that_of_physics_alone_and_among_others(tmp_path, monkeypatch, models, place):
    asked = []

    def stop(method, *_, **__):
        asked.append(method if place is None else method.methods[place])
        raise KeyboardInterrupt

    monkeypatch.setattr(animation, "ready_rollout", stop)
    files = (tmp_path / "walk.npz",)
    with pytest.raises(KeyboardInterrupt):
        animate(Rollout("walk", ("bottoms", "tops"), files, models, quality="fine"))
    assert [physics.config.quality for physics in asked] == ["fine"]


def test_an_objection_of_one_model_to_several_garments_hints_at_one_each(scene, tmp_path, monkeypatch):
    baseline = Traits(is_baseline=True)
    fussy = SimpleNamespace(traits=baseline, unsupported_reason=lambda outfit: "it itches")
    monkeypatch.setattr(ready, "load_method", lambda *_: fussy)
    monkeypatch.setattr(ready, "in_order", lambda some: some[0] if len(some) == 1 else Ensemble((*some,)))

    def refused(models):
        with pytest.raises(InputError, match="it itches") as caught:
            animate(Rollout("walk", ("tops", "dress"), (tmp_path / "walk.npz",), models))
        return str(caught.value)

    assert refused(("lbs",)).endswith("each garment may have a model of its own, as in --model A B")
    assert refused(("lbs", "lbs")) == "it itches"
