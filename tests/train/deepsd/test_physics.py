"""Physics trains chi alone, on bodies of different shape, in poses of all, with data or on one outfit."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from tests.train.simulated import database_of, swaying
from train.batched_collision import PosedParts
from train.deepsd.dataset import OutfitDataset, posed_outfit
from train.deepsd.losses import PhysicsLosses
from train.deepsd.outfit_energy import OutfitEnergy
from train.deepsd.physics import PhysicsObjective
from train.deepsd.prediction import PosedOutfit
from train.deepsd.run import LOOPS, DeePSDRun
from train.deepsd.start import TrainedStart, load_start
from train.loop import fit
from train.pbns.poses import BodyPoses
from train.state import STATE
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import PRESSED_PARTS, SLEEVE_PAIRS, make_collider
from uvcloth.checkpoint import Checkpoint, TrainingData, load_checkpoint, load_tensors, save_checkpoint
from uvcloth.errors import InputError
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import edge_lengths, unique_edges, vertex_normals
from uvcloth.geometry.records import CPU
from uvcloth.geometry.skinning import skin
from uvcloth.methods.deepsd.config import PRESETS, DeePSDConfig
from uvcloth.methods.deepsd.method import DeePSD, deepsd_checkpoint
from uvcloth.methods.deepsd.network import DeePSDNetwork
from uvcloth.methods.deepsd.outfit_graph import pack
from uvcloth.physics.obstacle import Obstacle

pytest.importorskip("lightning_fabric")

TINY = PRESETS["tiny"]
LOOP = replace(LOOPS["tiny"], steps=4, batch=2, validate_every=4, weight_decay=0.5, schedule="constant")
LOSSES = PhysicsLosses(poses_drawn=2)


@pytest.fixture
def start(dataset: OutfitDataset) -> TrainedStart:
    """What the first phase would leave: no branch of physics yet."""
    torch.manual_seed(1)
    method = DeePSD(TINY, DeePSDNetwork(TINY, 31), dataset.vectors, ("data",))
    return TrainedStart(method, TrainingData({"old.npz": "x"}, {"train": {"old": "eve"}}), {"step": 7})


def trained(config: DeePSDConfig, joints: int) -> TrainedStart:
    method = DeePSD(config, DeePSDNetwork(config, joints), torch.zeros(1, 3 * joints))
    return TrainedStart(method, TrainingData(), {})


class Quick(PhysicsObjective):
    """Draws nothing."""

    def picture(self, net: Any) -> Tensor:
        return torch.zeros(2, 2, 3, dtype=torch.uint8)


def test_energies_by_hand(dataset: OutfitDataset) -> None:
    """A belt that is a tenth longer everywhere, in poses that do not touch it."""
    belt = dataset.training[0]
    losses = replace(LOSSES, stretch=30.0 / (3**0.5 / 2), bend=0.01, small=0.02)
    energy = OutfitEnergy(losses, dataset.body, 2, CPU)
    points = belt.graph.points
    far = torch.tensor([5.0, 0.0, 0.0])
    longer = (1.1 * points + far).expand(2, -1, 3)
    outfit = PosedOutfit(belt.graph.smooth, {"physics": torch.full((2, len(points), 3), 0.02)}, longer)
    average = pack([belt.graph, belt.graph], CPU).average
    parts = energy([belt, belt], [outfit, outfit], [belt.transforms[:2]] * 2, average)
    assert all(part.shape == (2, 2) for part in parts.values())
    assert all(float(part.std()) < 1e-4 * float(part.mean()) + 1e-9 for part in parts.values())
    parts = {name: part.mean() for name, part in parts.items()}
    faces = torch.cat(belt.graph.faces)
    lengths = edge_lengths(points, unique_edges(faces))
    assert float(parts["stretch"]) == pytest.approx(15.0 * float((0.1 * lengths).square().sum()), rel=1e-3)
    assert float(parts["small"]) == pytest.approx(0.01 * len(points) * 3 * 0.02**2, rel=1e-4)
    assert float(parts["collision"]) == 0.0
    sunk = skin(0.8 * points, belt.graph.smooth, belt.transforms[:2])
    tight = replace(outfit, deformation={"physics": torch.zeros_like(longer)}, posed=sunk)
    both = energy([belt, belt], [outfit, tight], [belt.transforms[:2]] * 2, average)
    for name, meets in (("small", (True, False)), ("collision", (False, True))):
        assert [bool(column.all()) for column in both[name].unbind(1)] == list(meets), name
    at_rest = replace(outfit, posed=points.expand(1, -1, 3) + far)
    alone = pack([belt.graph], CPU).average
    rest = energy([belt], [at_rest], [belt.transforms[:1]], alone)
    assert float(rest["stretch"]) == pytest.approx(0.0, abs=1e-9)
    assert float(parts["roughness"]) == pytest.approx(float(rest["roughness"]), rel=1e-3)
    assert float(parts["bend"]) == pytest.approx(float(rest["bend"]), rel=1e-3)
    assert float(parts["bend"]) > 0.0
    unused = OutfitEnergy(replace(losses, bend=0.0, roughness=0.0), dataset.body, 2, CPU)
    assert list(unused([belt], [at_rest], [belt.transforms[:1]], alone)) == ["stretch", "collision", "small"]


def test_roughness_is_over_the_neighbours_of_each_outfit(dataset: OutfitDataset) -> None:
    """By a dense matrix of who is linked, as the network's average has them."""
    belt = dataset.training[0]
    energy = OutfitEnergy(replace(LOSSES, roughness=0.5), dataset.body, 2, CPU)
    points = belt.graph.points
    noise = torch.randn(2, *points.shape, generator=torch.Generator().manual_seed(0))
    posed = points + 0.002 * noise + torch.tensor([5.0, 0.0, 0.0])
    outfit = PosedOutfit(belt.graph.smooth, {"physics": torch.zeros_like(posed)}, posed)
    found = energy([belt], [outfit], [belt.transforms[:2]], pack([belt.graph], CPU).average)["roughness"]
    faces = torch.cat(belt.graph.faces)
    linked = torch.eye(len(points))
    first, second = unique_edges(faces).T
    linked[first, second] = linked[second, first] = 1.0
    normals = vertex_normals(posed, faces)
    mean = (linked @ normals) / linked.sum(1, keepdim=True)
    expected = 0.5 * (normals - mean).square().sum((1, 2))
    torch.testing.assert_close(found[:, 0], expected, rtol=1e-4, atol=1e-5)


def test_planes_are_those_of_contact_on_bodies_of_two_shapes(dataset: OutfitDataset) -> None:
    """The distances of the solver that evaluation uses, on each body alone."""
    hips = dataset.training[1]
    stout = replace(
        dataset.body,
        mesh=replace(
            dataset.body.mesh, vertices=dataset.body.mesh.vertices * torch.tensor([1.06, 1.06, 1.0])
        ),
    )
    parts = PosedParts(dataset.body, 2, CPU)
    posed = skin(hips.graph.points, hips.graph.smooth, hips.transforms[:2])
    for body in (stout, dataset.body):
        touches, opening = parts.met_by(hips.graph.points, body)
        bodies = skin(body.mesh.vertices, body.weights, hips.transforms[:2])
        parts.move(bodies, opening)
        distance = parts.planes(posed, touches, near=0.01).distance(posed)
        obstacle = Obstacle(make_collider(body), body.mesh.vertices)
        garment = obstacle.contact_garment(hips.graph.points)
        for found, vertices, where in zip(distance, posed, bodies, strict=True):
            obstacle.update(where)
            skins = obstacle.skin(vertices, garment)
            met = (skins.distance < 0.01) & ~skins.squeezed
            assert 0.1 < met.float().mean() < 1.0
            torch.testing.assert_close(found[met], skins.distance[met], atol=1e-5, rtol=0)
            assert (found[~met] > 1e5).float().mean() > 0.99


@pytest.mark.parametrize(
    ("name", "pairs"), [("tops", PRESSED_PARTS), ("shirt", PRESSED_PARTS + SLEEVE_PAIRS)]
)
def test_forearms_are_given_room_where_they_have_sleeves(
    name: str, pairs: tuple[Any, ...], body: Body
) -> None:
    """As in contact; each pair of parts is two sides that are pushed."""
    _, opening = PosedParts(body, 1, CPU).met_by(fit_template(name, body).mesh.vertices, body)
    assert len(opening.runtime.sections["opening.starts"]) - 1 == 2 * len(pairs)


def test_poses_are_anybody_s_on_the_outfit_s_own_body(dataset: OutfitDataset, start: TrainedStart) -> None:
    objective = Quick(start, replace(LOSSES, poses_drawn=5), dataset, 2)
    torch.manual_seed(0)
    outfits, frames = objective.dataset.draw(torch.tensor([0, 1]), 5)
    poses = objective._poses(outfits, frames)
    turns = dataset.rotations.flatten(1)
    for own, transforms in zip(poses.vectors, poses.transforms, strict=True):
        apart = torch.cdist(transforms[..., :3].flatten(1), turns)
        assert apart.amin(1).max() < 1e-4
        torch.testing.assert_close(own, dataset.vectors[apart.argmin(1)])
        head = dataset.body.skeleton.heads[0]
        moved = transforms[:, 0, :, :3] @ head + transforms[:, 0, :, 3]
        torch.testing.assert_close(moved, head.expand(5, 3), atol=1e-6, rtol=0)
    assert {int(row) // 5 for row in torch.cdist(poses.vectors.flatten(0, 1), dataset.vectors).argmin(1)} == {
        0,
        1,
    }
    own = Quick(start, replace(LOSSES, pose_source="own"), dataset, 2)._poses(outfits, frames)
    assert torch.equal(own.transforms[0], outfits[0].transforms[frames[0]])


def test_only_chi_moves_and_resuming_is_exact(
    dataset: OutfitDataset, start: TrainedStart, tmp_path: Path
) -> None:
    def objective() -> PhysicsObjective:
        return Quick(start, LOSSES, dataset, LOOP.batch)

    scores = fit(objective(), tmp_path / "whole", LOOP, resume=False)
    assert list(scores)[2:5] == ["energy_mJ", "mean_mm", "smooth_lbs_mm"]
    fit(objective(), tmp_path / "parts", replace(LOOP, steps=2), resume=False)
    fit(objective(), tmp_path / "parts", LOOP, resume=True)
    parts, _ = load_tensors(tmp_path / "parts" / STATE)
    whole, _ = load_tensors(tmp_path / "whole" / STATE)
    assert all(torch.equal(whole[name], tensor) for name, tensor in parts.items())
    before = start.method.network.state_dict()
    for name, tensor in before.items():
        same = torch.equal(whole[f"network/net/{name}"], tensor)
        assert same != name.startswith("branches.physics") or "bias" in name, name
        assert torch.equal(whole[f"average/{name}"], tensor) == same, name
    checkpoint = load_checkpoint(tmp_path / "whole", dataset.body)
    assert checkpoint.notes["branches"] == ["data", "physics"]
    assert checkpoint.notes["physics"]["thickness"] == 0.005
    assert checkpoint.notes["start"] == {"step": 7}
    assert checkpoint.data.clips["train"] == {"old": "eve", "clip0": "person0", "clip1": "person1"}
    assert {"old.npz", "clip0_belt_tops.npz"} <= checkpoint.data.files.keys()
    again = load_start(str(tmp_path / "whole"), "--physics-only")
    more = Quick(again, LOSSES, dataset, 2).networks()["net"].state_dict()
    assert all(torch.equal(more[name], value) for name, value in again.method.network.state_dict().items())


def test_physics_lowers_its_energy_and_starts_from_what_data_taught(
    dataset: OutfitDataset, start: TrainedStart
) -> None:
    losses = replace(LOSSES, poses_drawn=3, thickness=0.02, collision=100.0)
    objective = Quick(start, losses, dataset, 2)
    net = objective.networks()["net"]
    optimizer = torch.optim.Adam([p for p in net.parameters() if p.requires_grad], lr=3e-3)
    energies = []
    for _ in range(12):
        torch.manual_seed(0)
        _, loss, parts = next(iter(objective.steps({"net": net}, torch.tensor([0, 5]))))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        energies.append(float(loss.detach()))
        if len(energies) == 1:
            assert parts["small"] == 0.0
    assert energies[-1] < 0.95 * energies[0]


def test_an_outfit_of_one_s_own_is_fitted_without_data(
    body: Body, dataset: OutfitDataset, start: TrainedStart
) -> None:
    outfit = dataset.training[1].outfit
    poses = BodyPoses(database_of(body), TrainingData({"poses.npz": "abc"}, {"train": {"swaying": "ann"}}))
    mine = posed_outfit(outfit, poses)
    assert (len(mine.training[0].vectors), len(mine.held[0].vectors)) == (6, 3)
    objective = Quick(start, LOSSES, mine, 3)
    outfits, frames = objective.dataset.draw(torch.tensor([4, 0, 2]), 2)
    assert len(outfits) == 1
    assert frames[0][::2].tolist() == [4, 0, 2]
    assert len(frames[0]) == 6
    net = objective.networks()["net"]
    _, loss, _ = next(iter(objective.steps({"net": net}, torch.tensor([4, 0, 2]))))
    loss.backward()
    scores = objective.validate(net)
    assert list(scores) == ["energy_mJ", "edge_mm", "bend_cos", "inside_percent"]
    assert torch.equal(mine.training[0].transforms[..., :3], swaying(9, 0).rotations[:6])


def test_what_does_not_do_is_refused(dataset: OutfitDataset, start: TrainedStart, tmp_path: Path) -> None:
    flat = replace(TINY, deformation="none", blend_weights="changed")
    with pytest.raises(InputError, match="--physics-only: a network without a deformation"):
        Quick(trained(flat, 31), LOSSES, dataset, 2)
    with pytest.raises(InputError, match="is for a skeleton of 24 joints, body 'default' has 31"):
        Quick(trained(TINY, 24), LOSSES, dataset, 2)
    with pytest.raises(InputError, match="not a trained model"):
        load_start(str(tmp_path / "none"), "--physics-only")
    save_checkpoint(
        Checkpoint("pbns", {}, {"a": torch.zeros(1)}, {"name": "x"}, (), TrainingData(), {}),
        tmp_path / "other",
    )
    with pytest.raises(InputError, match="other: a model of method 'pbns', expected deepsd"):
        load_start(str(tmp_path / "other"), "--physics-only")
    with pytest.raises(InputError, match="name either --data, or --outfit"):
        DeePSDRun(out=tmp_path / "run").train()
    with pytest.raises(InputError, match="name either --data, or --outfit"):
        DeePSDRun(out=tmp_path / "run", data=(tmp_path,), outfit=("tops",)).train()
    with pytest.raises(InputError, match="--outfit: trains on physics alone"):
        DeePSDRun(out=tmp_path / "run", outfit=("tops",)).train()
    with pytest.raises(InputError, match=r"--thickness -1\.0: has to be 0 or more"):
        PhysicsLosses(thickness=-1.0)
    save_checkpoint(deepsd_checkpoint(start.method, dataset.body, TrainingData(), {}), tmp_path / "begun")
    assert load_start(str(tmp_path / "begun"), "--physics-only").method.branches == ("data",)
    assert not (tmp_path / "run").exists()
