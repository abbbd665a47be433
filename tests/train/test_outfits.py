"""A garment worn over another: its seeds, its training, and the rollout of both."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.train.simulated import save_clips, swaying
from train.loop import fit
from train.motion_guided.dataset import GarmentDataset
from train.motion_guided.objective import SHAPE, DynamicsObjective, ShapeObjective, load_shape_space
from train.motion_guided.run import LOOPS, LOSSES
from uvcloth.bodies.body import load_body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.skinning import skin
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.motion_guided.config import PRESETS
from uvcloth.methods.motion_guided.seeds import pose_seeds, sample_seeds, seeds_on
from uvcloth.methods.registry import load_method, load_methods
from uvcloth.physics.surface import BodySurface
from uvcloth.rollouts.rollout import rollout

pytest.importorskip("lightning_fabric")

LOOP = replace(LOOPS["tiny"], steps=2, validate_every=2)
INNER = replace(PRESETS["tiny"], garment="bottoms")
OUTER = replace(PRESETS["tiny"], garment="tops", under="bottoms")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two clips of both garments, and a third without the inner one."""
    folder = tmp_path_factory.mktemp("layers")
    save_clips(folder, ("tops", "bottoms"), clips=3, frames=12, warm_up=4)
    return folder


@pytest.fixture(scope="module")
def runs(data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Both garments, trained for a moment."""
    folder = tmp_path_factory.mktemp("runs")
    for config in (INNER, OUTER):
        run, dataset = folder / config.garment, GarmentDataset(config, LOSSES["tiny"], [data])
        fit(ShapeObjective(dataset, LOSSES["tiny"]), run / SHAPE, LOOP, resume=False)
        space = load_shape_space(run / SHAPE, dataset.config)
        fit(DynamicsObjective(dataset, LOSSES["tiny"], space), run, LOOP, resume=False)
    return folder / "bottoms", folder / "tops"


def test_seeds_lie_on_the_inner_garment_and_follow_it() -> None:
    body = load_body()
    bottoms = fit_template("bottoms", body)
    mesh = bottoms.mesh
    seeds = sample_seeds(body, 61, bottoms)
    assert seeds.points.shape == (61, 3)
    assert BodySurface(mesh.vertices, mesh.faces).closest(seeds.points).signed_distance.abs().max() < 1e-5
    transforms = swaying(3, seed=0).transforms()
    carried = skin(mesh.vertices, bottoms.smooth_weights, transforms)
    moved = carried + 0.02 * vertex_normals(carried, mesh.faces)
    followed, still = seeds_on(seeds, moved, transforms), pose_seeds(seeds, transforms)
    for vertices, points in zip(moved, followed.points, strict=True):
        apart = BodySurface(vertices, mesh.faces).closest(points).signed_distance.abs()
        assert apart.max() < 1e-5
    away = ((followed.points - still.points) * followed.normals).sum(2)
    assert (away - 0.02).abs().median() < 0.002
    torch.testing.assert_close(followed.rotations, still.rotations)


def test_an_outfit_trains_on_the_clips_that_have_both(data: Path) -> None:
    dataset = GarmentDataset(OUTER, LOSSES["tiny"], [data])
    assert sorted(dataset.data.files) == [
        f"{data.name}/clip{k}_{name}.npz" for k in (0, 1) for name in ("bottoms", "tops")
    ]
    bottoms = fit_template("bottoms", load_body()).mesh
    seeds = dataset.training.pose.seeds.points[0]
    late = swaying(12, seed=0).transforms()[:1]
    vertices = skin(bottoms.vertices, fit_template("bottoms", load_body()).smooth_weights, late)[0]
    assert BodySurface(vertices, bottoms.faces).closest(seeds).signed_distance.abs().max() < 1e-4


def test_an_outfit_rolls_out_with_a_model_for_each_garment(runs: tuple[Path, Path]) -> None:
    body = load_body()
    outfit = Outfit(body, tuple(fit_template(name, body) for name in ("bottoms", "tops")))
    method, motion = load_methods(runs, body), swaying(4, seed=5).transforms()
    assert method.name == "bottoms+tops"
    frames = list(rollout(method, outfit, motion, 30.0))
    inner = Outfit(body, outfit.garments[:1])
    alone = list(rollout(load_method(runs[0], body), inner, motion, 30.0))
    assert len(frames) == 4
    for frame, single in zip(frames, alone, strict=True):
        assert torch.equal(frame.vertices[0], single.vertices[0])
        for vertices, garment in zip(frame.vertices, outfit.garments, strict=True):
            assert vertices.shape == garment.mesh.vertices.shape


def test_an_outer_model_sees_the_inner_garment(runs: tuple[Path, Path]) -> None:
    body = load_body()
    outfit = Outfit(body, tuple(fit_template(name, body) for name in ("bottoms", "tops")))
    (inner, outer), motion = (load_method(run, body) for run in runs), swaying(3, seed=5).transforms()
    shirts = [
        list(rollout(Ensemble.of((below, outer)), outfit, motion, 30.0, clear=False))[-1].raw[1]
        for below in (inner, load_method("lbs", body))
    ]
    assert not torch.equal(*shirts)


@pytest.mark.parametrize(
    ("garments", "words"),
    [
        (("tops",), "is for it over bottoms, here it is over nothing"),
        (("dress", "tops"), "is for it over bottoms, here it is over dress"),
    ],
)
def test_an_outer_model_without_its_inner_garment_is_refused(
    garments: tuple[str, ...], words: str, runs: tuple[Path, Path]
) -> None:
    body = load_body()
    outfit = Outfit(body, tuple(fit_template(name, body) for name in garments))
    method = load_methods(("lbs", runs[1])[-len(garments) :], body)
    with pytest.raises(InputError, match=words):
        next(iter(rollout(method, outfit, swaying(2, seed=0).transforms(), 30.0)))


def test_more_models_than_garments_are_refused() -> None:
    body = load_body()
    method, motion = load_methods(("lbs", "lbs_smooth"), body), swaying(2, seed=0).transforms()
    outfit = Outfit(body, (fit_template("tops", body),))
    with pytest.raises(InputError, match="models given: 2, garments: 1; expected one model for all"):
        next(iter(rollout(method, outfit, motion, 30.0)))


def test_a_data_set_without_the_inner_garment_is_refused(data: Path) -> None:
    with pytest.raises(InputError, match="no training clip was simulated with tops and dress"):
        GarmentDataset(replace(OUTER, under="dress"), LOSSES["tiny"], [data])
