"""The public door: `import uvcloth` is typed, and gives what the command line gives."""

import ast
import logging
import sys
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

import uvcloth
from uvcloth import cli
from uvcloth.api import _sources
from uvcloth.bodies.body import Body, resized, save_body
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.templates import fit_template
from uvcloth.motion.lead_in import LeadIn
from uvcloth.motion.library import load_clip
from uvcloth.physics.fabric import FABRICS
from uvcloth.rollouts.rollout import JUMPED, RolloutFrame
from uvcloth.simulation import batch
from uvcloth.writers.animation import load_animation
from uvcloth.writers.obj import save_obj

ROOT = Path(__file__).parents[1]


def test_every_public_name_is_where_the_table_and_the_types_say() -> None:
    assert sorted(uvcloth._HOMES) == sorted(uvcloth.__all__) == dir(uvcloth)
    for name, home in uvcloth._HOMES.items():
        assert getattr(uvcloth, name) is getattr(import_module(home), name)
    tree = ast.parse((ROOT / "uvcloth" / "__init__.py").read_text(encoding="utf-8"))
    typed = next(node for node in tree.body if isinstance(node, ast.If))
    imported = {
        alias.name: node.module
        for node in typed.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert imported == uvcloth._HOMES
    with pytest.raises(AttributeError, match="module 'uvcloth' has no attribute 'rolout'"):
        uvcloth.rolout  # type: ignore[attr-defined]  # noqa: B018


def command_line(monkeypatch: pytest.MonkeyPatch, *words: object) -> None:
    monkeypatch.setattr(sys, "argv", ["uvcloth", *map(str, words)])
    assert cli.main() == 0


def test_the_version_is_that_of_the_installed_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from importlib.metadata import version

    command_line(monkeypatch, "--version")
    assert capsys.readouterr().out == f"uvcloth {version('uvcloth')}\n"
    assert uvcloth.__version__ == version("uvcloth")


def test_a_rollout_gives_the_bytes_of_the_command_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In float32 places a shirt in the jump was 2 mm elsewhere."""
    monkeypatch.setitem(QUALITIES, "default", QUALITIES["fast"])
    clip, model, garments = "jump", "motion_guided", ("dress",)
    names = ("a.npz", "a.glb")
    files = [tmp_path / name for name in names]
    words = ("--motion", clip, "--model", model, "--frames", "0:6", "--garment", *garments)
    command_line(monkeypatch, "rollout", *words, "--out", *files)
    (tmp_path / "door").mkdir()
    motion = uvcloth.load_motion(clip, frames="0:6")
    animation = uvcloth.rollout(model, motion, list(garments))
    for name, file in zip(names, files, strict=True):
        assert uvcloth.export(animation, tmp_path / "door" / name) == (tmp_path / "door" / name,)
        assert (tmp_path / "door" / name).read_bytes() == file.read_bytes()
    frames = uvcloth.rollout_frames(uvcloth.load_model(model), motion, uvcloth.fit(list(garments)))
    first = list(islice(frames, 3))
    for index, name in enumerate(animation.names):
        written = load_animation(files[0]).vertices[index]
        assert np.array_equal(animation.vertices[index], written), name
        assert np.array_equal(np.stack([frame.vertices[index] for frame in first]), written[:3]), name


def test_a_simulation_gives_the_frames_of_the_command_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In this process instead of a worker's, and but for the file, which holds vertices to within 0.05 mm."""
    client = SimpleNamespace(subscribe_topic=lambda *_: None)
    monkeypatch.setattr(batch, "connected", lambda *_: nullcontext(client))
    monkeypatch.setattr(batch, "results", lambda _, todo, work, look: ((job, work(job)) for job in todo))
    worker = SimpleNamespace(log_event=lambda *_: None)
    monkeypatch.setattr("dask.distributed.get_worker", lambda: worker)
    short = LeadIn(2, 12, 6)
    monkeypatch.setattr(batch, "LEAD_IN", short)
    monkeypatch.setattr("uvcloth.api.LeadIn", lambda: short)
    words = ("--garment", "tops", "--fabric", "silk", "--frames", "0:5", "--jobs", "1")
    command_line(monkeypatch, "simulate", "jump", *words, "--out", tmp_path)
    written = load_simulated(tmp_path / "jump_tops.npz")
    made: list[int] = []
    motion = uvcloth.load_motion("jump", frames="0:5")
    animation = uvcloth.simulate(motion, uvcloth.fit("tops", fabric="silk"), progress=made.append)
    assert written.warm_up == len(short)
    assert made == list(range(len(short) + 6))
    assert np.abs(animation.vertices[0] - written.vertices[len(short) :].numpy()).max() < 1e-4
    assert np.array_equal(animation.transforms, written.transforms[len(short) :].numpy())
    assert (len(animation), animation.fps, animation.names) == (5, 30.0, ("tops",))


def test_arrays_and_matrices_are_the_motion_that_they_hold(body: Body) -> None:
    clip = load_clip("walk", body).window(0, 20)
    transforms = clip.transforms(torch.float64)
    last = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.float64).expand(*transforms.shape[:2], 1, 4)
    for given in (
        transforms,
        transforms.numpy(),
        torch.cat([transforms, last], 2).numpy(),
        transforms.tolist(),
    ):
        motion = uvcloth.load_motion(given, body, fps=25)
        assert (motion.fps, motion.name, len(motion)) == (25.0, "motion", 20)
        assert (motion.transforms(torch.float64) - transforms).abs().max() < 1e-6
        assert motion.translation.dtype == torch.float64
    part = uvcloth.load_motion(transforms, body, frames="5:8", in_place=True)
    assert len(part) == 3
    assert not part.translation[:, :2].any()


def matrices(body: Body) -> np.ndarray:
    """Two frames (2, J, 4, 4) in which the body stands at rest."""
    return np.broadcast_to(np.eye(4), (2, len(body.skeleton.names), 4, 4)).copy()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda m: m[:, :24], r"mine: has 24 joints, the body \S+ has \d+"),
        (lambda m: m[0], r"mine: transforms has the shape \(\d+, 4, 4\), expected \(F, \d+, 3, 4\)"),
        (lambda m: m[:0], "mine: the clip has zero frames"),
        (lambda m: m * np.nan, "mine: transforms holds a value that is not a finite number"),
        (lambda m: m.astype(str), "mine: transforms holds str.*, expected numbers"),
        (lambda m: [[[1.0], [2.0, 3.0]]], "mine: transforms is not an array of numbers"),
        (lambda m: m + 1j, "mine: transforms holds complex128, expected numbers"),
        (lambda m: m + np.eye(4)[3, :, None] * np.eye(4)[0], "joint .* in frame 0 has a matrix whose last"),
        (lambda m: m * [[[[2.0], [1], [1], [1]]]], "mine: joint .* in frame 0 has a matrix that scales"),
        (lambda m: m * [[[[-1.0], [1], [1], [1]]]], "mine: joint .* in frame 0 has a matrix that scales"),
        (lambda m: m + np.eye(4)[0][:, None] * np.eye(4)[3] * np.arange(2)[:, None, None, None] * 2e5,
         "mine: frame 1: the person is more than 100 km"),
    ],
)  # fmt: skip
def test_matrices_that_do_not_fit_the_body_are_refused(change, sentence: str, body: Body) -> None:
    with pytest.raises(uvcloth.InputError, match=sentence):
        uvcloth.load_motion(change(matrices(body)), body, name="mine")


def test_a_joint_that_leaves_its_bone_is_named(body: Body) -> None:
    given = matrices(body)
    given[1, 5, 2, 3] = 0.02
    sentence = (
        f"motion: joint {body.skeleton.names[5]} in frame 1 has left the bone above it by more than 1 mm"
    )
    with pytest.raises(uvcloth.InputError, match=sentence):
        uvcloth.load_motion(given, body)


@pytest.mark.parametrize("fps", [0, -5, float("nan"), float("inf"), 1e9])
def test_frame_rates_that_no_motion_has_are_refused(fps: float, body: Body) -> None:
    for motion in ("walk", matrices(body)):
        with pytest.raises(uvcloth.InputError, match=r"--fps .*: expected 1 to 1000 frames per second"):
            uvcloth.load_motion(motion, body, fps=fps)


def test_a_mesh_from_arrays_is_fitted_as_its_file_is(
    body: Body, tmp_path: Path, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = fit_template("tops", body).mesh
    scaled = replace(mesh, vertices=100 * mesh.vertices)
    save_obj(scaled, tmp_path / "tee.obj")
    (from_file,) = uvcloth.fit(tmp_path / "tee.obj", body).garments
    caplog.set_level(logging.INFO, "uvcloth")
    (from_mesh,) = uvcloth.fit(scaled, body, name="tee").garments
    assert f"tee: {len(mesh.vertices)} vertices" in caplog.text
    arrays = (scaled.vertices.numpy(), scaled.faces.numpy().astype(np.int32))
    inner, outer = uvcloth.fit(["bottoms", arrays], body, fabric="silk").garments
    assert (from_file.name, from_mesh.name, inner.name, outer.name) == ("tee", "tee", "bottoms", "garment")
    for garment in (from_mesh, outer):
        assert (garment.mesh.vertices - from_file.mesh.vertices).abs().max() < 1e-5
        assert torch.equal(garment.mesh.faces, from_file.mesh.faces)
        assert garment.template == from_file.template == "tops"
    assert torch.equal(from_mesh.mesh.uvs, mesh.uvs)
    assert outer.fabric == FABRICS["silk"]
    assert capsys.readouterr() == ("", "")


SQUARE = (np.zeros((4, 3)), np.array([[0, 1, 2], [0, 2, 3]]))


@pytest.mark.parametrize(
    ("garments", "options", "sentence"),
    [
        ("sweater", {}, "garment sweater: no such template, expected one of tops"),
        ("nowhere.obj", {}, r"nowhere\.obj: no such file"),
        ((SQUARE[0][:, :2], SQUARE[1]), {}, r"garment: vertices has the shape \(4, 2\), expected \(N, 3\)"),
        ((SQUARE[0], SQUARE[1] + 2), {}, "garment: faces holds 5, expected 0 to 3"),
        ((SQUARE[0], 1.0 * SQUARE[1]), {}, "garment: faces holds float64, expected whole numbers"),
        ((SQUARE[0] + np.inf, SQUARE[1]), {}, "garment: vertices holds a value that is not a finite number"),
        ((SQUARE[0], SQUARE[1][:0]), {}, "garment: the garment is empty"),
        (["tops", (*SQUARE, SQUARE[0])], {}, "fit: a garment is the name of a template"),
        ([3], {}, "fit: a garment is the name of a template, .*, not int"),
        ("tops", {"fabric": "wool"}, "--fabric wool: expected one of jersey"),
        ("tops", {"template": "cape"}, "--template cape: expected one of tops"),
        (SQUARE, {"pose": "x"}, "--garment-pose x: expected one of t, a"),
    ],
)
def test_garments_that_cannot_be_worn_are_refused(garments, options, sentence: str, body: Body) -> None:
    with pytest.raises(uvcloth.InputError, match=sentence):
        uvcloth.fit(garments, body, **options)


def test_one_garment_and_several_are_told_apart() -> None:
    assert _sources("tops") == ["tops"]
    assert _sources(("bottoms", "tops")) == ["bottoms", "tops"]
    assert len(_sources(SQUARE)) == 1
    assert len(_sources((SQUARE, SQUARE))) == 2


def test_what_does_not_go_together_is_refused(body: Body, tmp_path: Path) -> None:
    walk, tops = uvcloth.load_motion("walk", body, frames="0:2"), uvcloth.fit("tops", body)
    small = resized(body, 0.9)
    for refused in (uvcloth.rollout_frames, uvcloth.rollout):
        with pytest.raises(uvcloth.InputError, match="walk: was loaded for another body"):
            refused("lbs", walk, uvcloth.fit("tops", small))
    with pytest.raises(uvcloth.InputError, match="walk: was loaded for another body"):
        uvcloth.simulate(walk, uvcloth.fit("tops", small))
    with pytest.raises(uvcloth.InputError, match="did you mean 'physxnet'"):
        uvcloth.rollout("physxnett", walk, tops)
    with pytest.raises(uvcloth.InputError, match="--fabric silk: model physxnet"):
        uvcloth.rollout("physxnet", walk, uvcloth.fit("tops", body, fabric="silk"), finish="clear")
    with pytest.raises(uvcloth.InputError, match="--finish varnish: expected one of dynamic, static"):
        uvcloth.rollout("lbs", walk, tops, finish="varnish")  # type: ignore[arg-type]
    with pytest.raises(uvcloth.InputError, match="--device abacus: is not available on this machine"):
        uvcloth.rollout_frames("lbs", walk, tops, device="abacus")
    with pytest.raises(uvcloth.InputError, match="--engine magic: expected one of explicit"):
        uvcloth.simulate(walk, tops, engine="magic")  # type: ignore[arg-type]
    with pytest.raises(uvcloth.InputError, match=r"models given: 2, garments: 1"):
        uvcloth.rollout(["lbs", "lbs"], walk, tops)
    with pytest.raises(uvcloth.InputError, match=r"nobody\.npz: no such file"):
        uvcloth.load_body(str(tmp_path / "nobody.npz"))
    with pytest.raises(uvcloth.InputError, match="--up x: expected y or z"):
        uvcloth.load_motion("walk", body, up="x")  # type: ignore[arg-type]
    with pytest.raises(
        uvcloth.InputError, match="up, joints, animation and rest_frame apply to motion files"
    ):
        uvcloth.load_motion(matrices(body), body, up="y")
    save_body(small, tmp_path / "small.npz")
    assert torch.equal(uvcloth.load_body(str(tmp_path / "small.npz")).mesh.vertices, small.mesh.vertices)


def test_difficult_and_replaced_frames_are_logged(
    body: Body, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    walk, tops = uvcloth.load_motion("walk", body, frames="0:3"), uvcloth.fit("tops", body)
    garment = tops.garments[0].mesh.vertices

    def frames(*_: object, **options: object) -> list[RolloutFrame]:
        assert options["keep_going"] is True
        posed = (walk.transforms(), (garment,), body.mesh.vertices)
        return [
            RolloutFrame(
                index, posed[1], posed[1], posed[0][index], posed[2], {},
                replaced=("frame 1: garment tops is torn",) if index == 1 else (),
                difficulties=(JUMPED,) if index else (),
            )
            for index in range(3)
        ]  # fmt: skip

    monkeypatch.setattr("uvcloth.rollouts.ready.rollout_proxied", frames)
    uvcloth.rollout("lbs", walk, tops, keep_going=True)
    assert [(record.name, record.levelname, record.getMessage()) for record in caplog.records] == [
        ("uvcloth.api", "WARNING", "frame 1: garment tops is torn; replaced by linear blend skinning"),
        ("uvcloth.api", "WARNING", f"walk: difficult at frames 1-2: {JUMPED}"),
    ]


def test_an_animation_without_a_body_has_no_pictures(body: Body, tmp_path: Path) -> None:
    walk, tops = uvcloth.load_motion("walk", body, frames="0:2"), uvcloth.fit("tops", body)
    alone = replace(uvcloth.rollout("lbs", walk, tops, finish="none"), body=None)
    (written,) = uvcloth.export(alone, tmp_path / "alone.npz")
    assert load_animation(written).transforms.shape[0] == 2
    with pytest.raises(uvcloth.InputError, match=r"a\.png: pictures need the body"):
        uvcloth.export(alone, tmp_path / "a.png")
    with pytest.raises(uvcloth.InputError, match=r"a\.fbx: the format \.fbx is not supported"):
        uvcloth.export(alone, str(tmp_path / "a.fbx"))
    assert [path.name for path in tmp_path.iterdir()] == ["alone.npz"]
