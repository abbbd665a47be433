"""Outfits at rest in poses: they hang down, and the file that keeps them is continued, never mixed up."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from tests.train.simulated import swaying
from train import settled as settling
from train.settled import SETTLED_FILE, settle, settled_outfit
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, make_caged_outfit
from uvcloth.physics.fabric import find_fabric

POSES = swaying(4, seed=0).transforms()


@pytest.fixture(scope="module")
def trousers(body: Body) -> Outfit:
    return Outfit(body, (fit_template("bottoms", body),))


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Tensor]:
    """The poses that a stand-in for the solver settles; in the second one cloth flies apart."""
    poses: list[Tensor] = []

    def stand_in(prepared: CagedOutfit, transforms: Tensor) -> tuple[Tensor, ...]:
        poses.append(transforms)
        if torch.equal(transforms, POSES[1]):
            raise InputError("the cloth flies apart")
        count = sum(len(garment.mesh.places) for garment in prepared.garments)
        return (torch.full((count, 3), float(transforms.sum())),)

    monkeypatch.setattr(settling, "settle", stand_in)
    monkeypatch.setattr(settling, "SAVED_EVERY", 1)
    return poses


def test_trousers_come_to_rest_below_their_skinned_place(trousers: Outfit) -> None:
    prepared = make_caged_outfit(trousers, PhysicsConfig("fast"))
    (cloth,) = settle(prepared, POSES[0])
    (garment,) = trousers.garments
    skinned = skin(garment.mesh.vertices, garment.smooth_weights, POSES[:1])[0]
    lower = garment.mesh.vertices[:, 2] < garment.mesh.vertices[:, 2].median()
    assert float((cloth - skinned)[lower, 2].mean()) < -0.005
    assert float((cloth - skinned).norm(dim=1).mean()) < 0.05


def test_cloth_that_flies_apart_is_left_out(trousers: Outfit, asked: list[Tensor], tmp_path: Path) -> None:
    settled = settled_outfit(trousers, POSES, tmp_path / SETTLED_FILE)
    assert settled.rows.tolist() == [0, 2, 3]
    assert settled.vertices[:, 0, 0].tolist() == pytest.approx(POSES[[0, 2, 3]].sum((1, 2, 3)).tolist())
    assert len(asked) == 4


def test_an_interrupted_file_is_continued(
    trousers: Outfit, asked: list[Tensor], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, stand_in = tmp_path / SETTLED_FILE, settling.settle

    def interrupted(prepared: CagedOutfit, transforms: Tensor) -> tuple[Tensor, ...]:
        if torch.equal(transforms, POSES[3]):
            raise KeyboardInterrupt
        return stand_in(prepared, transforms)

    with monkeypatch.context() as changed:
        changed.setattr(settling, "settle", interrupted)
        with pytest.raises(KeyboardInterrupt):
            settled_outfit(trousers, POSES, path)
    asked.clear()
    again = settled_outfit(trousers, POSES, path)
    assert [float(pose.sum()) for pose in asked] == [float(POSES[3].sum())]
    assert again.rows.tolist() == [0, 2, 3]
    assert torch.equal(settled_outfit(trousers, POSES, path).vertices, again.vertices)
    assert len(asked) == 1


def test_another_fabric_or_pose_is_refused(trousers: Outfit, asked: list[Tensor], tmp_path: Path) -> None:
    path = tmp_path / SETTLED_FILE
    settled_outfit(trousers, POSES[:2], path)
    (garment,) = trousers.garments
    silken = replace(trousers, garments=(replace(garment, fabric=find_fabric("silk")),))
    for outfit, poses in ((silken, POSES[:2]), (trousers, POSES[2:])):
        with pytest.raises(InputError, match=r"settled\.npz: is of another outfit, fabric or poses"):
            settled_outfit(outfit, poses, path)
