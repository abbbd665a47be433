"""Garments modelled in T or A pose: separated from those on the rest pose, and transferred to it."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body, load_body
from uvcloth.errors import InputError
from uvcloth.garments.fit import Fitting, read_on_body
from uvcloth.garments.garment import Garment
from uvcloth.garments.pose import arms_held, other_pose, posed_body
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.writers.obj import save_obj


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


@pytest.fixture(scope="module")
def shirt(body: Body) -> Garment:
    return fit_template("shirt", body)


def test_arms_are_straight_and_at_their_angle(body: Body) -> None:
    for pose, drop in (("t", 0.0), ("a", 1.0)):
        posed = posed_body(body, arms_held(body, pose))
        assert torch.equal(posed.skeleton.heads[0], body.skeleton.heads[0])
        for name in ("LeftHand", "RightHand"):
            hand = body.skeleton.names.index(name)
            arm = posed.skeleton.heads[hand] - posed.skeleton.heads[body.skeleton.parents[hand]]
            assert float(arm[1].abs() / arm.norm()) < 1e-5
            assert float(-arm[2] / arm[0].abs()) == pytest.approx(drop, abs=1e-4)


@pytest.mark.parametrize("pose", ["t", "a"])
def test_a_shirt_in_another_pose_is_recognized_and_taken_along(
    body: Body, shirt: Garment, tmp_path: Path, pose: str
) -> None:
    turned = skin(shirt.mesh.vertices, shirt.smooth_weights, arms_held(body, pose)[None])[0]
    path = tmp_path / "shirt.obj"
    save_obj(replace(shirt.mesh, vertices=turned), path)
    given, placed = read_on_body(path, body, Fitting(pose)), read_on_body(path, body)
    assert torch.equal(given.mesh.vertices, placed.mesh.vertices)
    apart = (placed.mesh.vertices - shirt.mesh.vertices).norm(dim=1)
    assert float(apart.mean()) < 0.0005
    assert float(apart.max()) < 0.008
    assert float((turned - shirt.mesh.vertices).norm(dim=1).max()) > 0.1
    assert f"modelled in {pose.upper()} pose" in "\n".join(placed.diagnosis.lines())


@pytest.mark.parametrize("name", TEMPLATES)
def test_what_lies_on_the_rest_pose_is_left_there(body: Body, name: str) -> None:
    assert other_pose(fit_template(name, body).mesh, body) == ""


def test_a_body_without_arms_is_named(body: Body, shirt: Garment) -> None:
    names = tuple(f"bone{index}" for index in range(len(body.skeleton.names)))
    armless = replace(body, skeleton=replace(body.skeleton, names=names))
    with pytest.raises(InputError, match="--garment-pose t: body 'default' has no arms"):
        arms_held(armless, "t")
    assert other_pose(shirt.mesh, armless) == ""
