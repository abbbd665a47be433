"""The PBNS that ships: whom it dresses, how it looks at rest and in motion, and who taught it."""

import csv
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.writers.glb_reader import GlbReader
from train.settled import settle
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.checkpoint import load_checkpoint
from uvcloth.commands.export import Export
from uvcloth.commands.run.export import export
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.pbns.method import PBNS
from uvcloth.methods.physics.outfit import PhysicsConfig, make_caged_outfit
from uvcloth.methods.registry import SHIPPED, load_method
from uvcloth.motion.library import load_clip
from uvcloth.physics.measures import edge_change
from uvcloth.physics.obstacle import Obstacle
from uvcloth.rollouts.rollout import rollout

GARMENTS = ("bottoms", "tops")


@pytest.fixture(scope="module")
def method(body: Body) -> PBNS:
    method = load_method("pbns", body)
    assert isinstance(method, PBNS)
    return method


@pytest.fixture(scope="module")
def outfit(body: Body) -> Outfit:
    return Outfit(body, tuple(fit_template(name, body) for name in GARMENTS))


def test_it_dresses_a_shirt_over_trousers_and_each_alone(method: PBNS, body: Body, outfit: Outfit) -> None:
    assert method.unsupported_reason(outfit) == ""
    assert [method.unsupported_reason(Outfit(body, (garment,))) for garment in outfit.garments] == ["", ""]
    assert "model pbns is for tops over bottoms, not for dress" in method.unsupported_reason(
        Outfit(body, (fit_template("dress", body),))
    )


def test_at_rest_it_hangs_as_physics_has_it(method: PBNS, body: Body, outfit: Outfit) -> None:
    rest = torch.eye(3, 4).expand(1, len(body.skeleton.names), 3, 4)
    settled = settle(make_caged_outfit(outfit, PhysicsConfig("fast")), rest[0])
    (frame,) = rollout(method, outfit, rest, 30.0, clear=False)
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    for garment, vertices, physics in zip(outfit.garments, frame.raw, settled, strict=True):
        mesh = garment.mesh
        assert float((vertices - physics).norm(dim=1).mean()) < 0.015
        assert float(edge_change(vertices[None], mesh.vertices, mesh.faces).mean()) < 0.003
        worn = obstacle.contact_garment(mesh.vertices)
        assert float(obstacle.inside_percent(vertices[None], worn, body.mesh.vertices[None])) < 1.0


def test_its_export_plays_its_own_walk(method: PBNS, body: Body, outfit: Outfit, tmp_path: Path) -> None:
    path = tmp_path / "walk.glb"
    export(Export("pbns", path, motion="walk", with_body=False))
    clip = load_clip("walk", body)
    glb = GlbReader.load(path)
    np.testing.assert_allclose(glb.times(), np.arange(len(clip)) / 30.0, atol=1e-6)
    middle = len(clip) // 2
    frames = list(rollout(method, outfit, clip.transforms()[: middle + 1], clip.fps, clear=False))
    for garment, vertices in zip(outfit.garments, frames[middle].raw, strict=True):
        written = glb.posed(garment.name, middle)[: len(vertices)]
        assert np.linalg.norm(written - vertices.numpy(), axis=1).max() < 1e-4


def test_it_fits_into_the_package() -> None:
    assert sum(file.stat().st_size for file in (SHIPPED / "pbns").iterdir()) < 6.5e6


def test_nobody_of_the_test_taught_or_chose_it(mocap_folder: Path) -> None:
    """Taught by people of the training split alone, chosen by those of the validation split."""
    with (mocap_folder / "index_v2.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    people = {
        split: {row["subject"] for row in rows if row["split"] == split}
        for split in ("train", "validation", "test")
    }
    clips = load_checkpoint(SHIPPED / "pbns").data.clips
    met = {split: set(whose.values()) for split, whose in clips.items()}
    assert set(met) == {"train", "validation"}
    assert met["train"]
    assert met["train"] <= people["train"]
    assert met["validation"] <= people["validation"]
    assert not met["train"] & (people["validation"] | people["test"])
    assert not (met["train"] | met["validation"]) & people["test"]
