"""Units and sizes: a person in any unit is dressed alike, and one of any size as models know adults."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from tests.characters.made_up import Piece, write_character
from tests.motion.bvh_text import bvh_text, performer
from tests.test_rollout import FPS
from tests.thorough import always
from uvcloth.bodies.body import load_body, resized, save_body
from uvcloth.bodies.stature import ADULTS, beside_adults, stature
from uvcloth.bodies.stream import posed_batches
from uvcloth.characters.reader import read_character
from uvcloth.characters.rig import RiggedCharacter, rig_character
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.registry import load_method
from uvcloth.methods.resized import Resized
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip
from uvcloth.rollouts.rollout import RolloutFrame, prepare_rollout

TENTH = 1e-4
"""Metres that results may differ."""


def walked(folder: Path, unit: float) -> Clip:
    """A step or two of somebody whose file is in so many metres a unit, on the body that ships."""
    joints = performer()
    values = np.zeros((12, sum(len(joint[3]) for joint in joints)))
    values[:, 6:] = 8.0 * np.sin(np.arange(12) / 3)[:, None] * np.cos(np.arange(values.shape[1] - 6))
    values[:, :3] = np.linspace([0.0, 1.0, 0.0], [0.4, 1.0, 0.2], 12) / unit
    sized = [(name, parent, tuple(0.0254 / unit * np.array(at)), kinds) for name, parent, at, kinds in joints]
    path = folder / f"{unit}.bvh"
    path.write_text(bvh_text(sized, values), encoding="utf-8")
    return load_clip(path, load_body())


def test_a_motion_is_the_same_in_any_unit(tmp_path: Path) -> None:
    metres = walked(tmp_path, 1.0).positions()
    assert (metres[-1, 0] - metres[0, 0]).norm() > 0.3
    for unit in (0.0254, 0.01, 0.001):
        assert (walked(tmp_path, unit).positions() - metres).abs().max() < TENTH


def character(path: Path, scale: float, unit: str | None = None) -> RiggedCharacter:
    """The body that ships as a character so many times as large, whose file says nothing of that."""
    body = load_body()
    write_character(path, resized(body, scale), [Piece("Body", "Skin", body.mesh.faces)])
    return rig_character(read_character(path), {}, body, unit)


def test_a_character_is_the_same_in_any_unit(tmp_path: Path) -> None:
    metres = character(tmp_path / "m.glb", 1.0)
    for unit, scale in {"cm": 100.0, "mm": 1000.0, "inches": 1 / 0.0254, "feet": 1 / 0.3048}.items():
        other = character(tmp_path / "other.glb", scale)
        assert other.unit == unit
        assert (other.skeleton.heads - metres.skeleton.heads).abs().max() < TENTH
        assert (other.parts[0].mesh.vertices - metres.parts[0].mesh.vertices).abs().max() < TENTH


def test_the_unit_of_a_child_is_said(tmp_path: Path) -> None:
    """71 centimetres are 71 inches to who does not know that it is a child."""
    scale = 71 / stature(load_body())
    assert character(tmp_path / "child.glb", scale).unit == "inches"
    rigged = character(tmp_path / "child.glb", scale, "cm")
    tall = rigged.parts[0].mesh.vertices[:, 2]
    assert tall.max() - tall.min() == pytest.approx(0.71, abs=TENTH)
    with pytest.raises(InputError, match=r"71 units tall, 71 m in m, expected 0\.5 to 3\.0 m; .* --unit"):
        character(tmp_path / "child.glb", scale, "m")


@pytest.mark.parametrize(("factor", "unit"), [(100.0, "cm"), (1000.0, "mm"), (3.3, "feet"), (0.001, "km")])
def test_a_body_that_is_not_in_metres_is_refused(factor: float, unit: str, tmp_path: Path) -> None:
    save_body(resized(load_body(), factor), tmp_path / "body.npz")
    with pytest.raises(
        InputError, match=rf"body\.npz: the body measures .*, the height of a person in {unit}"
    ):
        load_body(tmp_path / "body.npz")


@pytest.mark.parametrize(
    ("name", "tall", "adult"),
    always([("physxnet", 0.5, ADULTS[0])], [("physxnet", 0.5, ADULTS[0]), ("motion_guided", 3.0, ADULTS[1])]),
)
def test_a_model_sees_everybody_as_an_adult(name: str, tall: float, adult: float) -> None:
    """A person of 0.5 m, as one of 1.4 m in smaller clothes would be; over frames that feed back."""

    def predicted(height: float) -> list[RolloutFrame]:
        own = load_body()
        body = resized(own, height / stature(own))
        dress = fit_template("dress", own)
        worn = replace(dress, mesh=replace(dress.mesh, vertices=dress.mesh.vertices * height / stature(own)))
        clip = load_clip("run", body).window(20, 6)
        method = load_method(name, body)
        assert isinstance(method, Resized) == (beside_adults(body) != 1.0)
        prepared = prepare_rollout(method, Outfit(body, (worn,)), clear=False)
        return list(prepared.around_root(clip.transforms(torch.float64), clip.fps))

    nearest = 1.0001 * adult if adult == ADULTS[0] else 0.9999 * adult
    for one, other in zip(predicted(tall), predicted(nearest), strict=True):
        assert (one.raw[0] * (nearest / tall) - other.raw[0]).abs().max() < 1e-3


def test_what_jumps_is_in_proportion() -> None:
    """A step of 12 m/s: nothing for somebody of 3 m, a cut for an adult; and 4 m/s for somebody of 0.5 m."""
    own = load_body()
    for tall, speed, jumps in ((3.0, 12.0, 0), (1.8, 12.0, 1), (1.8, 4.0, 0), (0.5, 4.0, 1)):
        motion = torch.eye(3, 4).repeat(4, len(own.skeleton.names), 1, 1)
        motion[2:, :, 0, 3] = speed / FPS
        motion[3, :, 0, 3] *= 2
        body = resized(own, tall / stature(own))
        begun = sum(batch.begins for batch in posed_batches(body, motion, FPS))
        assert (begun > 1) == bool(jumps)


def test_a_clip_of_one_kilometre_ends_as_it_began() -> None:
    """The garments beside the root, in every frame, as of the same motion in one place."""
    body = load_body()
    walk = load_clip("walk", body).window(0, 90)
    clip = replace(
        walk,
        rotations=torch.cat([walk.rotations, walk.rotations.flip(0)]),
        translation=torch.cat([walk.translation, walk.translation.flip(0)]),
    )
    way = torch.linspace(0.0, 1.0, 180, dtype=torch.float64)[:, None] ** 2 * 1000.0
    shift = way * torch.tensor([0.8, -0.6, 0.0], dtype=torch.float64)
    far = replace(clip, translation=clip.translation.double() + shift)
    prepared = prepare_rollout(
        load_method("lbs_smooth", body), Outfit(body, (fit_template("dress", body),)), clear=False
    )
    here, there = (
        list(prepared.around_root(each.transforms(torch.float64), each.fps)) for each in (clip, far)
    )

    def beside_hips(frame: RolloutFrame) -> Tensor:
        return frame.vertices[0] - body.skeleton.heads[0] - frame.transforms[0, :, 3]

    assert (there[-1].origin - there[0].origin).norm() > 900
    for one, other in zip(here, there, strict=True):
        apart = beside_hips(other) - beside_hips(one)
        assert apart.abs().max() < TENTH
