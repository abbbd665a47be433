"""Blender's cloth through its own process: what it is told, physics, and one sentence for what goes wrong."""

import os
import stat
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import trimesh

from tests.simulation.physics.scenes import FPS, G, play, scene, sheet
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.physics.fabric import Fabric
from uvcloth.simulation import blender
from uvcloth.simulation.batch import simulate_batch
from uvcloth.simulation.blender import PYTHON_VARIABLE, Blender, find_blender
from uvcloth.simulation.options import SimulationOptions
from uvcloth.simulation.plan import ClipSelection

STILL = Fabric(drag=0.0)
"""Cloth without air."""

needs_blender = pytest.mark.skipif(
    not os.environ.get(PYTHON_VARIABLE), reason=f"needs {PYTHON_VARIABLE}, a Python that has the package bpy"
)


@needs_blender
def test_a_sheet_falls_at_g() -> None:
    frames, engine = 16, replace(find_blender(), fabric=STILL)
    heights = play(engine, scene(*sheet(0.1, 0.1, 6, 6), (frames - 1) / FPS))[..., 2]
    step = torch.arange(frames) * engine.quality
    fallen = -G / (FPS * engine.quality) ** 2 * step * (step + 1) / 2  # as steps add it up
    torch.testing.assert_close(heights, fallen[:, None].expand_as(heights), atol=1e-5, rtol=1e-4)


@needs_blender
def test_a_sheet_held_along_an_edge_swings() -> None:
    points, faces = sheet(0.3, 0.3, 12, 12)
    fast = replace(scene(points, faces, 1.3, points[:, 0] < 1e-6), fps=60.0)
    engine = replace(find_blender(), fabric=STILL, quality=8)
    moved = play(engine, fast)
    rim = moved[:, points[:, 0] > 0.299, 2].mean(1)
    lowest = int(rim.argmin())
    assert torch.equal(moved[:, fast.band], fast.skinned[:, fast.band])
    assert 0.25 < lowest / 60.0 < 0.29
    assert -0.305 < float(rim[lowest]) < -0.28
    assert -0.10 < float(rim[lowest:].max()) < -0.03
    assert int(rim[lowest:].argmax()) + lowest in range(31, 37)


@needs_blender
@pytest.mark.parametrize("stretch", [60.0, 300.0])
def test_a_hanging_strip_stretches_as_its_membrane_stiffness_says(stretch: float) -> None:
    points, faces = sheet(0.6, 0.08, 31, 5)
    hanging = torch.stack([points[:, 2], points[:, 1], -points[:, 0]], 1)
    fabric = Fabric(stretch=stretch, drag=20.0)
    engine = replace(find_blender(), fabric=fabric)
    last = play(engine, scene(hanging, faces, 2.0, hanging[:, 2] > -1e-6))[-10:]
    longer = -float(last[:, hanging[:, 2] < -0.599, 2].mean()) - 0.6
    assert longer == pytest.approx(fabric.density * G * 0.6**2 / (2.0 * stretch), rel=0.12)


@needs_blender
@pytest.mark.parametrize(("degrees", "slides"), [(20.0, False), (24.0, True)])
def test_cloth_slides_down_an_incline_beyond_the_angle_of_its_friction(degrees: float, slides: bool) -> None:
    points, faces = sheet(0.1, 0.1, 6, 6)
    points = points - points.mean(0) + torch.tensor([0.0, 0.0, 0.0045])
    slab = trimesh.creation.box((2.0, 1.0, 0.1)).subdivide().subdivide().subdivide()
    slab.apply_translation((0.0, 0.0, -0.05))
    tilt = trimesh.transformations.rotation_matrix(torch.pi * degrees / 180.0, (0.0, 1.0, 0.0))
    slab.apply_transform(tilt)
    turn = torch.from_numpy(tilt[:3, :3]).float()
    engine = replace(find_blender(), fabric=replace(STILL, friction=0.4))  # holds up to 21.8 degrees
    moved = play(engine, scene(points @ turn.T, faces, 1.0, obstacles=[slab])) @ turn
    slid = float((moved[-1] - moved[0])[:, 0].mean())
    assert (slid > 0.15) if slides else (abs(slid) < 0.001)
    assert float(moved[..., 2].min()) > 0.003


@needs_blender
def test_a_sheet_comes_to_lie_on_a_ball_the_same_way_twice_unless_it_may_not_touch() -> None:
    points, faces = sheet(0.33, 0.33, 12, 12)
    points = points - points.mean(0) + torch.tensor([0.0, 0.0, 0.13])
    ball = scene(points, faces, 19 / FPS, obstacles=[trimesh.creation.icosphere(3, radius=0.12)])
    first, second = (play(find_blender(), ball) for _ in range(2))
    assert torch.equal(first, second)
    assert float(first[-1].norm(dim=1).min()) > 0.12
    assert float(first[-1, :, 2].min()) < 0.10
    apart = replace(ball, touches=torch.zeros_like(ball.touches))
    assert float(play(find_blender(), apart)[-1, :, 2].max()) < 0.0


def test_faces_beside_cloth_that_may_not_touch_them_are_left_out() -> None:
    points, faces = sheet(1.0, 0.2, 11, 3)
    box = trimesh.creation.box((1.0, 0.2, 0.1)).subdivide().subdivide()
    box.apply_translation((0.5, 0.1, 0.0))
    both = scene(points, faces, 1 / FPS, obstacles=[box])
    half = points[:, 0] > 0.5
    (kept,) = blender._reachable(replace(both, touches=half[None]))
    centres = both.collider[0][kept].mean(1)
    assert 0 < len(kept) < len(both.collider_parts[0])
    assert float(centres[:, 0].min()) > 0.3
    (every,) = blender._reachable(both)
    assert torch.equal(every, both.collider_parts[0])
    assert not blender._reachable(replace(both, touches=torch.zeros_like(both.touches)))


@pytest.fixture(autouse=True)
def _asked_anew() -> Iterator[None]:
    yield
    find_blender.cache_clear()


def fake(path: Path, script: str) -> str:
    """A program that stands for an interpreter."""
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (
            "echo \"ModuleNotFoundError: No module named 'bpy'\" >&2; exit 1",
            "ModuleNotFoundError: No module named .bpy., expected a",
        ),
        ("echo Blender says hello; echo 4.2.3 LTS", "has Blender 4.2.3, expected 4.5"),
        ("exit 3", "it says nothing, expected a"),
    ],
)
def test_an_interpreter_that_does_not_serve_is_named(
    script: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find_blender.cache_clear()
    monkeypatch.setenv(PYTHON_VARIABLE, fake(tmp_path / "python", script))
    with pytest.raises(InputError, match=f"{PYTHON_VARIABLE}=.*python: {words}"):
        find_blender()


def test_the_variable_has_to_name_something(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    find_blender.cache_clear()
    monkeypatch.delenv(PYTHON_VARIABLE, raising=False)
    with pytest.raises(InputError, match=f"needs the environment variable {PYTHON_VARIABLE}"):
        find_blender()
    monkeypatch.setenv(PYTHON_VARIABLE, str(tmp_path / "nothing"))
    with pytest.raises(InputError, match=r"nothing: cannot be run \(No such file"):
        find_blender()


def test_nothing_is_written_where_the_engine_is_missing(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find_blender.cache_clear()
    monkeypatch.delenv(PYTHON_VARIABLE, raising=False)
    for engine, words in (
        ("blender", PYTHON_VARIABLE),
        ("havok", "--engine havok: expected one of explicit, blender"),
    ):
        with pytest.raises(InputError, match=words):
            simulate_batch(
                ClipSelection(["walk"]),
                [["tops"]],
                tmp_path / "data",
                body,
                options=SimulationOptions(engine),
            )
    assert not list(tmp_path.iterdir())


def test_a_blender_that_ends_early_says_why(tmp_path: Path) -> None:
    points, faces = sheet(0.1, 0.1, 2, 2)
    ends = fake(tmp_path / "python", "head -c 48 /dev/zero; echo 'MemoryError' >&2")
    frames = Blender(ends, "4.5.0").simulate(scene(points, faces, 2 / FPS))
    assert torch.equal(next(frames).vertices, torch.zeros(4, 3))
    with pytest.raises(InputError, match=r"Blender ended at frame 1 of 3 \(MemoryError\)"):
        next(frames)


def test_the_process_ends_with_who_asked(tmp_path: Path) -> None:
    mark = tmp_path / "pid"
    slow = fake(tmp_path / "python", f"echo $$ > {mark}; head -c 48 /dev/zero; exec sleep 60")
    frames = Blender(slow, "4.5.0").simulate(scene(*sheet(0.1, 0.1, 2, 2), 2 / FPS))
    next(frames)
    frames.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int(mark.read_text()), 0)


def test_more_friction_than_blender_has_is_refused() -> None:
    engine = Blender("python", "4.5.0", fabric=Fabric(friction=0.9))
    with pytest.raises(InputError, match=r"friction up to 0\.8, not 0\.9"):
        next(engine.simulate(scene(*sheet(0.1, 0.1, 2, 2), 1 / FPS)))
