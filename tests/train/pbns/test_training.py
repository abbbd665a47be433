"""PBNS trains from energies alone: exact resuming, layers, weights, poses, and what it refuses."""

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from tests.train.cropped import cropped
from tests.train.simulated import database_of, swaying
from train.__main__ import main
from train.batched_collision import LAYER_SEARCH_DISTANCE
from train.loop import fit
from train.pbns import objective as pbns
from train.pbns.energy import EnergyConfig, FabricOptions
from train.pbns.objective import SMOOTHING, AttachmentConfig, PBNSObjective
from train.pbns.poses import BodyPoses
from train.pbns.run import LOOPS
from train.pbns.smoothing import GradientSmoothing
from train.pbns.supervision import SettledPoses, Supervision, SupervisionConfig
from train.posed_batch import empty_cache
from train.settled import SETTLED_FILE
from train.state import STATE
from uvcloth.bodies.body import Body
from uvcloth.checkpoint import TrainingData, load_checkpoint, load_tensors
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.pins import pinned
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.skinning import skin
from uvcloth.methods.pbns.network import PBNSConfig
from uvcloth.methods.registry import load_method
from uvcloth.motion.poses import save_poses
from uvcloth.physics.layers import Layer
from uvcloth.physics.surface import FREE
from uvcloth.rollouts.rollout import rollout

pytest.importorskip("lightning_fabric")

TINY = PBNSConfig(width=16, layers=2)
LOOP = replace(LOOPS["tiny"], steps=4, batch=4, validate_every=4, schedule="constant")
FREELY = AttachmentConfig(pins=("none",), weights="smooth", train_weights="no")


@pytest.fixture(autouse=True)
def few_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Smooth gradients by a fifth of the eigenvectors, which take longest of what a run begins with."""
    monkeypatch.setattr("train.pbns.smoothing.MODES", 40)


@pytest.fixture(scope="module")
def belt(body: Body) -> Outfit:
    """A strip of the shirt around the waist."""
    return Outfit(body, (cropped(fit_template("tops", body), 0.13, 0.19),))


@pytest.fixture(scope="module")
def layered(body: Body) -> Outfit:
    """The hem of the shirt over the waist of the trousers."""
    inner, outer = (cropped(fit_template(name, body), -0.02, 0.15) for name in ("bottoms", "tops"))
    return Outfit(body, (inner, outer))


class Quick(PBNSObjective):
    """Validates by its energy alone and draws nothing."""

    def measure(self, posed: Tensor, transforms: Tensor) -> dict[str, float]:
        return {}

    def picture(self, net: Any) -> Tensor:
        return torch.zeros(2, 2, 3, dtype=torch.uint8)


def objective_of(
    outfit: Outfit,
    attachment: AttachmentConfig = FREELY,
    kind: type[PBNSObjective] = Quick,
    smoothing: float = SMOOTHING,
    supervision: Supervision | None = None,
    **changed: Any,
) -> PBNSObjective:
    database = database_of(outfit.body)
    return kind(
        TINY,
        FabricOptions(**changed).resolved(),
        EnergyConfig(),
        attachment,
        outfit,
        BodyPoses(database, TrainingData({"poses.npz": "abc"})),
        LOOP.batch,
        smoothing,
        supervision=supervision,
    )


def lowered(outfit: Outfit, by: float) -> Supervision:
    """Supervision that has the skinned outfit lie lower, in two poses of each split."""
    database, skeleton = database_of(outfit.body), outfit.body.skeleton
    weights = objective_of(outfit).networks()["net"].blend_weights().detach()
    vertices = torch.cat([garment.mesh.vertices for garment in outfit.garments])
    parts = []
    for split in ("train", "validation"):
        poses = database.of(split).transforms(skeleton)[:2]
        parts.append(SettledPoses(torch.arange(2), skin(vertices, weights, poses) - torch.tensor([0, 0, by])))
    return Supervision(SupervisionConfig(settled=2, supervision=50.0), *parts)


def trained(objective: PBNSObjective, steps: int) -> tuple[list[float], Any]:
    """A few steps over the same poses: the energies before each, and the network."""
    torch.manual_seed(0)
    net = objective.networks()["net"]
    optimizer = torch.optim.Adam([p for p in net.parameters() if p.requires_grad], lr=1e-3)
    energies = []
    for _ in range(steps):
        for _, loss, _ in objective.steps({"net": net}, torch.arange(4)):
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            energies.append(float(loss.detach()))
    return energies, net


@pytest.mark.parametrize("threads", [pytest.param(1, marks=pytest.mark.thorough), 2])
def test_resuming_is_exact_though_visits_are_forgotten(threads: int, layered: Outfit, tmp_path: Path) -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    attachment = replace(FREELY, train_weights="yes")
    parts = tmp_path / "parts"
    try:
        for run, loop, resume in (
            (tmp_path / "whole", LOOP, False),
            (parts, replace(LOOP, steps=2), False),
            (parts, LOOP, True),
        ):
            objective = objective_of(layered, attachment, supervision=lowered(layered, 0.01))
            fit(objective, run, loop, resume=resume)
    finally:
        torch.set_num_threads(before)
    whole, _ = load_tensors(tmp_path / "whole" / STATE)
    again, _ = load_tensors(parts / STATE)
    assert whole.keys() == again.keys()
    assert not [name for name in whole if name.startswith("memory/")]
    for name, tensor in whole.items():
        assert torch.equal(tensor, again[name]), name


def test_a_smoothed_gradient_points_where_a_garment_as_a_whole_should_go(layered: Outfit) -> None:
    objective = objective_of(layered)
    smoothing, count = GradientSmoothing(objective.faces, 1.0), len(objective.points)
    down = torch.zeros(count, 3)
    inner = objective.faces[0].unique()
    down[inner, 2] = -1.0
    noise = 5.0 * torch.randn(count, 3, generator=torch.Generator().manual_seed(0))
    given = torch.stack([down + noise, torch.zeros(count, 3)]).view(2, -1)
    smoothed = smoothing(given).view(2, count, 3)
    assert float(torch.cosine_similarity(smoothed[0].flatten(), down.flatten(), dim=0)) > 0.7
    assert float(torch.cosine_similarity(given[0], down.flatten(), dim=0)) < 0.3
    assert not smoothed[1].any()
    torch.testing.assert_close(smoothed.norm(), given.norm())
    assert torch.equal(GradientSmoothing(objective.faces, 0.0)(given), given)


def test_a_share_that_is_none_is_refused(belt: Outfit) -> None:
    with pytest.raises(InputError, match=r"--smoothing 1\.5: expected a share from 0 to 1"):
        objective_of(belt, smoothing=1.5)


def test_a_run_is_not_continued_with_another_fabric_garment_or_body(belt: Outfit, tmp_path: Path) -> None:
    begun = replace(LOOP, steps=1)
    fit(objective_of(belt), tmp_path, begun, resume=False)
    with pytest.raises(InputError, match=r"was started with fabric.stretch = 34.641016, not 40.0"):
        fit(objective_of(belt, stretch=40.0), tmp_path, begun, resume=True)
    with pytest.raises(InputError, match=r"was started with attachment.weights = "):
        fit(objective_of(belt, replace(FREELY, weights="closest")), tmp_path, begun, resume=True)
    (garment,) = belt.garments
    wider = replace(garment.mesh, vertices=1.02 * garment.mesh.vertices)
    with pytest.raises(InputError, match="was started with other garments"):
        fit(
            objective_of(replace(belt, garments=(replace(garment, mesh=wider),))),
            tmp_path,
            begun,
            resume=True,
        )
    stout = replace(belt.body, mesh=replace(belt.body.mesh, vertices=1.01 * belt.body.mesh.vertices))
    with pytest.raises(InputError, match="was started with other body"):
        fit(objective_of(replace(belt, body=stout)), tmp_path, begun, resume=True)


def test_a_dozen_steps_lower_the_energy(belt: Outfit) -> None:
    energies, _ = trained(objective_of(belt, replace(FREELY, train_weights="yes")), 12)
    assert energies[-1] < 0.8 * energies[0]
    assert min(energies) == energies[-1]


def test_the_loss_is_the_sum_of_its_energies_each_the_mean_over_the_poses(belt: Outfit) -> None:
    objective = objective_of(belt)
    net = objective.networks()["net"]
    rows = [torch.tensor([0]), torch.tensor([3]), torch.tensor([0, 3])]
    single, other, both = (next(iter(objective.steps({"net": net}, some))) for some in rows)
    assert both[1].detach().item() == pytest.approx(
        sum(float(part.detach()) for part in both[2].values()), rel=1e-5
    )
    for name, part in both[2].items():
        mean = 0.5 * (single[2][name] + other[2][name])
        assert part.item() == pytest.approx(mean.item(), rel=1e-4), name
    assert both[2]["pin"] == 0.0
    heights = skin(objective.points, net.unique_weights(), objective.poses.transforms[:1])[0, :, 2]
    expected = 1000 * 9.81 * float((objective.energy.cloth.masses * heights).sum())
    assert single[2]["gravity"].item() == pytest.approx(expected, rel=0.02)


def test_the_outfit_at_rest_supervises_beside_the_energies(belt: Outfit) -> None:
    alone, objective = objective_of(belt), objective_of(belt, supervision=lowered(belt, 0.02))
    net = objective.networks()["net"]
    with torch.no_grad():
        net.shapes.zero_()
    rows = torch.tensor([0, 3])
    (_, loss, parts), (_, energy, _) = (
        next(iter(each.steps({"net": net}, rows))) for each in (objective, alone)
    )
    assert parts["settled"].item() == pytest.approx(50 * 20, rel=1e-3)
    assert loss.item() == pytest.approx(energy.item() + parts["settled"].item(), rel=1e-5)
    scores = objective.validate(net)
    assert scores["settled_mm"] == pytest.approx(20, rel=1e-3)
    assert "settled_mm" not in alone.validate(net)
    _, better = trained(objective, 60)
    assert objective.validate(better)["settled_mm"] < 15
    assert objective.settings()["supervision"] != alone.settings()["supervision"]


def test_layers_train_and_come_off_each_other(layered: Outfit) -> None:
    objective = objective_of(layered)
    energies, net = trained(objective, 8)
    assert energies[-1] < energies[0]
    inner, outer = (len(garment.mesh.vertices) for garment in layered.garments)
    (layer,) = objective.energy.layers
    assert torch.equal(layer.rows, torch.arange(inner))
    assert set(layer.outer.tolist()) <= set(range(inner, inner + outer))
    assert len(layer.outer) > 0.5 * outer
    assert objective.measure(*posed_by(objective, net)) == {}


def posed_by(objective: PBNSObjective, net: Any) -> tuple[Tensor, Tensor]:
    """The outfit (B, U, 3) in the validation poses, and their transforms."""
    with torch.no_grad():
        _, vertices = objective.pose(net, objective.held, torch.arange(len(objective.held.vectors)))
    return vertices, objective.held.transforms


def test_planes_between_layers_are_those_of_each_pose_alone(layered: Outfit) -> None:
    objective = objective_of(layered)
    posed, _ = posed_by(objective, objective.networks()["net"])
    normals = vertex_normals(posed, objective.energy.cloth.faces)
    (layer,) = objective.energy.layers
    noise = torch.randn(posed.shape, generator=torch.Generator().manual_seed(0))
    posed = posed + 0.001 * noise
    posed[:, layer.outer] += 0.015 * noise[:, layer.outer]
    planes = layer.planes(posed, normals)
    distance = planes.distance(posed[:, layer.outer])
    assert len(posed) < objective.batch
    for vertices, facing, found, bounds in zip(posed, normals, distance, planes.offsets, strict=True):
        alone = Layer(vertices[layer.rows], objective.faces[0])
        beside = alone.beside(vertices[layer.outer], LAYER_SEARCH_DISTANCE)
        met = beside.covered & ((beside.normals * facing[layer.outer]).sum(1) > 0)
        same = (bounds > FREE) == met
        assert same.float().mean() > 0.999
        covered = same & met
        assert covered.float().mean() > 0.5
        assert (beside.distance[covered] < 0).any()
        torch.testing.assert_close(found[covered], beside.distance[covered], atol=1e-4, rtol=0)
        assert (found[~met & same] > 1e5).all()


@pytest.mark.parametrize("asked", ["yes", "no"])
def test_blend_weights_are_trained_only_when_asked(asked: Any, belt: Outfit) -> None:
    objective = objective_of(belt, replace(FREELY, train_weights=asked))
    before = objective.networks()["net"].blend_weights()
    _, net = trained(objective, 3)
    after = net.blend_weights().detach()
    assert torch.equal(before, after) == (asked == "no")
    torch.testing.assert_close(after.sum(1), torch.ones(len(after)))
    assert (after >= 0).all()


def test_pinned_vertices_pay_for_what_is_deformed_also_at_a_seam(body: Body) -> None:
    """The shirt cut into single triangles has the energies of the whole one."""
    shirt = replace(fit_template("tops", body), source="file")
    order = shirt.mesh.faces.flatten()
    mesh = replace(
        shirt.mesh, vertices=shirt.mesh.vertices[order], faces=torch.arange(len(order)).view(-1, 3)
    )
    parts = {"weights": shirt.weights[order], "smooth_weights": shirt.smooth_weights[order]}
    uncut, cut = replace(shirt, name="uncut"), replace(shirt, name="cut", mesh=mesh, **parts)
    attachment = replace(FREELY, pins=("band",))
    losses = []
    for garment in (uncut, cut):
        objective = objective_of(Outfit(body, (garment,)), attachment)
        net = objective.networks()["net"]
        with torch.no_grad():
            net.shapes.fill_(0.001)
            for layer in net.layers:
                layer.weight.zero_()
                layer.bias.fill_(1.0)
        losses.append(next(iter(objective.steps({"net": net}, torch.arange(2))))[2])
        moved = TINY.width * 0.001
        expected = 1000 * 10.0 * 3 * moved**2 * len(objective.energy.pins)
        assert losses[-1]["pin"].item() == pytest.approx(expected, rel=1e-4)
        assert len(objective.energy.pins) == int(pinned([uncut], body, ["band"]).sum())
    whole, apart = losses
    for name in whole:
        assert apart[name].item() == pytest.approx(whole[name].item(), rel=1e-3), name


def test_auto_trains_and_smooths_weights_where_cloth_hangs_free(body: Body, belt: Outfit) -> None:
    auto = AttachmentConfig(pins=("none",))
    tight = objective_of(belt, auto)
    assert not tight.trains_weights
    (garment,) = belt.garments
    skirt = cropped(fit_template("dress", body), -1.0, 0.1)
    free = objective_of(Outfit(body, (skirt,)), auto)
    assert free.trains_weights
    apart = torch.cdist(skirt.mesh.vertices, body.mesh.vertices).amin(1)
    far = apart > 0.07
    assert far.any()
    torch.testing.assert_close(free.weights[far], skirt.smooth_weights[far])
    close = torch.cdist(garment.mesh.vertices, body.mesh.vertices).amin(1) < 0.02
    torch.testing.assert_close(tight.weights[close], garment.weights[close])
    assert torch.equal(objective_of(belt, replace(auto, weights="smooth")).weights, garment.smooth_weights)


def test_measures_of_smoothly_skinned_garments_are_sane(layered: Outfit, monkeypatch: Any) -> None:
    objective = objective_of(layered, kind=PBNSObjective)
    net = objective.networks()["net"]
    with torch.no_grad():
        net.shapes.zero_()
    scores = objective.validate(net)
    assert next(iter(scores)) == "energy_mJ"
    assert all(map(torch.isfinite, map(torch.tensor, scores.values())))
    assert 0.01 < scores["edge_mm"] < 3.0
    assert 0.02 < scores["bend_rad"] < 0.3
    assert 0.0 < scores["bend_cos"] < 0.05
    assert 0.0 <= scores["inside_percent"] < 10.0
    assert 0.0 <= scores["layers_percent"] < 10.0
    measured: list[int] = []
    monkeypatch.setattr(objective, "measure", lambda posed, transforms: measured.append(len(posed)) or {})
    for most in (1, 2, 3, 9):
        monkeypatch.setattr(pbns, "VALIDATION_POSES", most)
        objective.validate(net)
    assert measured == [1, 2, 3, 3]


def test_visits_are_kept_by_pose(belt: Outfit) -> None:
    objective = objective_of(belt)
    net = objective.networks()["net"]
    next(iter(objective.steps({"net": net}, torch.tensor([4, 1]))))
    seen = torch.isfinite(objective.caches.points).all((1, 2))
    assert seen.tolist() == [False, True, False, False, True, False]
    _, posed = objective.pose(net, objective.poses, torch.tensor([1]))
    torch.testing.assert_close(objective.caches.points[1], posed[0].detach())
    assert objective.memory() == {}
    fresh = empty_cache(6, len(objective.points), torch.device("cpu"))
    assert torch.equal(objective.caches.clearance[0], fresh.clearance[0])


def test_crossed_layers_and_pins_without_a_vertex_are_refused(layered: Outfit) -> None:
    body = layered.body
    turned = replace(layered, garments=layered.garments[::-1])
    with pytest.raises(InputError, match="garment part of bottoms: cannot be worn over the garment part of"):
        objective_of(turned)
    with pytest.raises(InputError, match="--pins neck: names no vertex"):
        objective_of(Outfit(body, (fit_template("bottoms", body),)), replace(FREELY, pins=("neck",)))


def command(monkeypatch: pytest.MonkeyPatch, *words: object) -> None:
    monkeypatch.setattr(sys, "argv", ["train", "pbns", *map(str, words)])
    main()


def test_one_command_trains_a_model_that_dresses(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_poses(database_of(body), tmp_path / "poses.npz")
    asked = ("--garment", "tops", "--out", tmp_path / "mine", "--poses", tmp_path / "poses.npz")
    tiny = (*asked, "--preset", "tiny", "--steps", 2)
    command(monkeypatch, *tiny)
    method = load_method(tmp_path / "mine", body)
    assert method.name == "mine"
    clips = load_checkpoint(tmp_path / "mine").data.clips
    assert clips == {"train": {"swaying": "ann"}, "validation": {"swaying": "ann"}}
    assert (tmp_path / "mine" / SETTLED_FILE).exists()
    assert 1 < load_checkpoint(tmp_path / "mine").notes["validation"]["settled_mm"] < 60
    motion = swaying(3, seed=1).transforms()
    outfit = Outfit(body, (fit_template("tops", body),))
    (first, *_) = list(rollout(method, outfit, motion, 30.0, clear=False))
    smooth = skin(outfit.garments[0].mesh.vertices, outfit.garments[0].weights, motion[:1])
    assert (first.raw[0] - smooth[0]).norm(dim=1).median() < 0.03
    with pytest.raises(InputError, match="holds a run already"):
        command(monkeypatch, *tiny)
    with pytest.raises(InputError, match=r"was started with attachment.pins = "):
        command(monkeypatch, *tiny, "--resume", "--pins", "none")


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("--preset", "silk"), "--preset silk: expected one of default, paper, tiny"),
        (("--preset", "tiny", "--stretch", "-1"), "--stretch -1: expected 1 to 10000"),
        (("--preset", "tiny", "--width", "0"), "--width 0: has to be from 1 to 4096"),
        (("--preset", "tiny", "--learning-rate", "nan"), "--learning-rate nan: has to be more than 0"),
        (("--preset", "tiny", "--average", "2"), r"--average 2\.0: has to be 0 or more, and less than 1"),
        (("--preset", "tiny", "--pins", "waist"), "--pins waist: names no vertex of tops"),
        (("--preset", "tiny", "--resume"), "nothing to resume"),
        (("--preset", "tiny", "--poses", "nowhere.npz"), "nowhere.npz: no such file"),
    ],
)
def test_what_cannot_be_trained_is_refused_and_leaves_nothing(
    words: tuple[str, ...],
    fault: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises((InputError, SystemExit)) as refused:
        command(monkeypatch, "--garment", "tops", "--out", tmp_path / "run", *words)
    assert re.search(fault, str(refused.value) + capsys.readouterr().err)
    assert not (tmp_path / "run").exists()


def test_what_nothing_holds_is_refused_before_poses_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("train.pbns.run.unheld_reason", lambda outfit: "garment tops: has no open hem")
    asked = ("--garment", "tops", "--preset", "tiny", "--pins", "none", "--out", tmp_path / "run")
    with pytest.raises(InputError, match="has no open hem; --settled 0 trains it on physics alone"):
        command(monkeypatch, *asked)
    assert not (tmp_path / "run").exists()


def test_a_run_that_cannot_be_a_folder_is_refused_before_training(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_poses(database_of(body), tmp_path / "poses.npz")
    (tmp_path / "run").write_text("mine")
    asked = ("--garment", "tops", "--preset", "tiny", "--steps", 2, "--poses", tmp_path / "poses.npz")
    for out in (tmp_path / "run", tmp_path / "run" / "deeper"):
        with pytest.raises(InputError, match="cannot be made a folder"):
            command(monkeypatch, *asked, "--out", out)
    assert (tmp_path / "run").read_text() == "mine"
