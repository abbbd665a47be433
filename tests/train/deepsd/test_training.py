"""DeePSD learns from outfits of different meshes: packing, losses, exact resuming, ablations, bad input."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from tests.small_body import small_body
from tests.train.simulated import save_clips
from train.__main__ import main
from train.deepsd.dataset import OutfitDataset, read_outfits
from train.deepsd.losses import DataLosses, data_losses, prior_share
from train.deepsd.objective import DataObjective
from train.deepsd.prediction import DrawnPoses, PosedOutfit, describe, pose_outfits
from train.deepsd.run import LOOPS, DeePSDRun
from train.deepsd.start import TrainedStart, load_start
from train.loop import LoopConfig, batch_after, fit, rows_of_step
from train.state import STATE
from uvcloth.bodies.body import load_body
from uvcloth.checkpoint import TrainingData, load_checkpoint, load_tensors
from uvcloth.dataset.bodies import BODIES
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import edge_lengths
from uvcloth.geometry.records import CPU
from uvcloth.methods.deepsd.config import PRESETS, DeePSDConfig
from uvcloth.methods.deepsd.method import DeePSD
from uvcloth.methods.deepsd.network import DeePSDNetwork, pose
from uvcloth.methods.deepsd.outfit_graph import outfit_graph, pack
from uvcloth.methods.registry import load_method
from uvcloth.physics.fabric import FABRICS

pytest.importorskip("lightning_fabric")

TINY = PRESETS["tiny"]
LOOP = replace(LOOPS["tiny"], steps=4, batch=2, validate_every=4, schedule="constant")


class Quick(DataObjective):
    """Draws nothing."""

    def picture(self, net: Any) -> Tensor:
        return torch.zeros(2, 2, 3, dtype=torch.uint8)


def drawn(dataset: OutfitDataset, frames: int = 3) -> DrawnPoses:
    """The first frames of every training outfit."""
    return DrawnPoses(
        torch.stack([outfit.vectors[:frames] for outfit in dataset.training]),
        torch.stack([outfit.transforms[:frames] for outfit in dataset.training]),
    )


def test_the_paper_s_network_has_the_printed_size() -> None:
    count = sum(parameter.numel() for parameter in DeePSDNetwork(PRESETS["paper"], 24).parameters())
    assert count == 1_092_632
    assert 4 * count / 1e6 == pytest.approx(4.4, abs=0.05)


def test_the_frames_that_count_are_read(dataset: OutfitDataset) -> None:
    """Six frames, a warm-up of two: one of it does not teach, neither of it validates."""
    assert [(o.name, len(o.vertices)) for o in dataset.training] == [("belt", 5), ("hips", 5)]
    assert [(o.name, len(o.vertices)) for o in dataset.held] == [("skirt", 4)]
    assert dataset.rows.tolist() == [[outfit, frame] for outfit in range(2) for frame in range(5)]
    assert dataset.data.clips == {
        "train": {"clip0": "person0", "clip1": "person1"},
        "validation": {"clip2": "person2"},
    }
    assert len(dataset.data.files) == 4
    hips = dataset.training[1]
    assert len(hips.graph.faces) == 2
    assert hips.vertices.shape[1] == len(hips.graph.points)
    smooth = pose(hips.graph.points, torch.zeros(1), hips.graph.smooth, hips.transforms)
    assert 0 < (smooth - hips.vertices).norm(dim=-1).max() < 0.025


@pytest.mark.parametrize("graph_heads", [False, True])
def test_outfits_of_one_pack_are_as_each_alone(graph_heads: bool, dataset: OutfitDataset) -> None:
    net = DeePSDNetwork(replace(TINY, graph_heads=graph_heads), 31)
    graphs, poses = [outfit.graph for outfit in dataset.training], drawn(dataset)
    together = pose_outfits(net, describe(net, graphs, CPU), poses)
    for index, graph in enumerate(graphs):
        own = DrawnPoses(poses.vectors[index : index + 1], poses.transforms[index : index + 1])
        (alone,) = pose_outfits(net, describe(net, [graph], CPU), own)
        torch.testing.assert_close(together[index].posed, alone.posed, atol=1e-6, rtol=0)
        torch.testing.assert_close(together[index].weights, alone.weights, atol=1e-6, rtol=0)
    assert len(together[0].posed[0]) != len(together[1].posed[0])


@pytest.mark.parametrize("graph_heads", [False, True])
def test_what_is_trained_is_what_the_method_does(graph_heads: bool, dataset: OutfitDataset) -> None:
    """Deformations without forming blend shapes are those of the network's blend shapes."""
    net = DeePSDNetwork(replace(TINY, graph_heads=graph_heads), 31)
    graph, poses = dataset.training[1].graph, drawn(dataset)
    own = DrawnPoses(poses.vectors[1:], poses.transforms[1:])
    (predicted,) = pose_outfits(net, describe(net, [graph], CPU), own, ("data",))
    packed = pack([graph], CPU, net.config.spread)
    described = net.describe(packed)
    shapes, keys = (
        net.shapes(described, packed, "data"),
        net.embed(own.vectors[0], net.joint_visibility(packed.joint_areas[0])),
    )
    moved = torch.einsum("bk,ukc->buc", keys, shapes)
    torch.testing.assert_close(predicted.deformation["data"], moved, atol=1e-6, rtol=0)
    expected = pose(graph.points, moved, net.blend_weights(described, packed), own.transforms[0])
    torch.testing.assert_close(predicted.posed, expected, atol=1e-6, rtol=0)
    some = torch.arange(0, len(graph.points), 3)
    if not graph_heads:
        (part,) = pose_outfits(net, describe(net, [graph], CPU, [some]), own, ("data",))
        torch.testing.assert_close(part.posed, expected[:, some], atol=1e-6, rtol=0)


def test_another_order_of_vertices_gives_the_same_outfit(dataset: OutfitDataset) -> None:
    (garment,) = dataset.training[0].outfit.garments
    count = len(garment.mesh.vertices)
    order = torch.randperm(count, generator=torch.Generator().manual_seed(0))
    place = torch.empty_like(order)
    place[order] = torch.arange(count)
    shuffled = permuted(garment, order, place)
    net = DeePSDNetwork(TINY, 31)
    posed = []
    for each in (garment, shuffled):
        graph = outfit_graph(Outfit(dataset.body, (each,)))
        own = DrawnPoses(*(values[:1] for values in (drawn(dataset).vectors, drawn(dataset).transforms)))
        (outfit,) = pose_outfits(net, describe(net, [graph], CPU), own)
        posed.append(outfit.posed[:, graph.owner])
    torch.testing.assert_close(posed[1], posed[0][:, order], atol=1e-5, rtol=0)


def permuted(garment: Garment, order: Tensor, place: Tensor) -> Garment:
    mesh = replace(garment.mesh, vertices=garment.mesh.vertices[order], faces=place[garment.mesh.faces])
    weights, smooth = garment.weights[order], garment.smooth_weights[order]
    return replace(garment, mesh=mesh, weights=weights, smooth_weights=smooth)


def test_losses_by_hand(dataset: OutfitDataset) -> None:
    """Two points in one pose, one 3 mm off, the other 4: mean 3.5 mm, mean square 12.5 mm2."""
    graph = dataset.training[0].graph
    rows = torch.tensor([0, 5])
    truth = torch.full((1, 2, 3), 0.1)
    posed = truth + torch.tensor([[[0.003, 0.0, 0.0], [0.0, 0.0, 0.004]]])
    weights = graph.closest[rows].clone()
    weights[0, :2] += torch.tensor([0.5, -0.5])
    outfit = PosedOutfit(weights, {"data": torch.full((1, 2, 3), 0.01)}, posed)
    losses = DataLosses(edges=0.0, closest_weights=10.0, small_shapes=2.0)
    parts = data_losses([outfit], [truth], [graph], [rows], losses, epochs=0.5)
    assert {name: pytest.approx(float(part), rel=1e-4) for name, part in parts.items()} == {
        "error": 3.5,
        "weights": 10.0 * 0.25,
        "shapes": 2.0 * 3.0,
    }
    squared = replace(losses, error="squared")
    later = data_losses([outfit], [truth], [graph], [rows], squared, epochs=3.0)
    assert float(later["error"]) == pytest.approx(12.5, rel=1e-4)
    assert float(later["shapes"]) == pytest.approx(0.06)
    assert [prior_share(epochs) for epochs in (0.0, 1.0, 2.0, 3.0)] == pytest.approx([1.0, 1.0, 0.1, 0.01])


def test_edges_between_compared_points_keep_their_length(dataset: OutfitDataset) -> None:
    """Cloth stretched by a tenth changes each edge by a tenth; with one point there is none to change."""
    graph = dataset.training[0].graph
    weights = graph.smooth
    for rows in (torch.arange(len(graph.points)), torch.arange(0, len(graph.points), 2)):
        points = graph.points[rows]
        chosen = [(a, b) for a, b in graph.edges.tolist() if a in rows and b in rows]
        mean = edge_lengths(graph.points, torch.tensor(chosen)).mean() * 1000.0
        outfit = PosedOutfit(weights[rows], {"data": torch.zeros(1, 1, 3)}, 1.1 * points[None])
        parts = data_losses([outfit], [points[None]], [graph], [rows], DataLosses(edges=3.0), epochs=0.0)
        assert float(parts["edges"]) == pytest.approx(3.0 * 0.1 * float(mean), rel=1e-3)
    one = PosedOutfit(weights[:1], {"data": torch.zeros(1, 1, 3)}, graph.points[None, :1])
    alone = data_losses([one], [one.posed], [graph], [torch.tensor([0])], DataLosses(edges=3.0), epochs=0.0)
    assert float(alone["edges"]) == 0.0


def test_a_step_draws_frames_of_the_outfits_asked_for(dataset: OutfitDataset) -> None:
    objective = Quick(TINY, DataLosses(poses_per_outfit=4, points=0.5), dataset)
    torch.manual_seed(3)
    outfits, frames = dataset.draw(torch.tensor([7, 2]), 4)
    assert [outfit.name for outfit in outfits] == ["hips", "belt"]
    assert [own[0].item() for own in frames] == [2, 2]
    assert all(len(own) == 4 and own.max() < 5 for own in frames)
    for some, outfit in zip(objective._points(outfits), outfits, strict=True):
        assert len(some.unique()) == len(some) == round(0.5 * len(outfit.graph.points))
    next(iter(objective.steps(objective.networks(), torch.tensor([7, 2]))))
    assert objective.memory()["seen"] == 8


def test_balanced_outfits_are_drawn_alike(dataset: OutfitDataset) -> None:
    """The belt has three frames and the hips five: each is one sample, its frames are drawn at random."""
    belt, hips = dataset.training
    short = replace(
        belt, vertices=belt.vertices[:3], transforms=belt.transforms[:3], vectors=belt.vectors[:3]
    )
    balanced = replace(dataset, training=(short, hips), balanced=True)
    assert balanced.samples.tolist() == [0, 1]
    assert len(replace(balanced, balanced=False).samples) == 8
    outfits, frames = balanced.draw(torch.tensor([1, 0]), 40)
    assert [outfit.name for outfit in outfits] == ["hips", "belt"]
    assert [own.unique().tolist() for own in frames] == [list(range(5)), list(range(3))]


def test_resuming_gives_the_weights_of_an_uninterrupted_run(dataset: OutfitDataset, tmp_path: Path) -> None:
    loop = replace(LOOP, double_every=0.5)

    def objective() -> DataObjective:
        return Quick(TINY, DataLosses(poses_per_outfit=2), dataset)

    fit(objective(), tmp_path / "whole", loop, resume=False)
    interrupted = Stopping(TINY, DataLosses(poses_per_outfit=2), dataset)
    with pytest.raises(KeyboardInterrupt):
        fit(interrupted, tmp_path / "parts", loop, resume=False)
    fit(objective(), tmp_path / "parts", loop, resume=True)
    whole, _ = load_tensors(tmp_path / "whole" / STATE)
    parts, _ = load_tensors(tmp_path / "parts" / STATE)
    assert whole.keys() == parts.keys()
    for name, tensor in whole.items():
        assert torch.equal(tensor, parts[name]), name
    assert whole["memory/seen"] == 2 * (2 + 2 + 4 + 4)
    notes = load_checkpoint(tmp_path / "parts").notes
    assert notes["branches"] == ["data"]
    assert notes["outfits"] == {"train": 2, "validation": 1}
    assert notes["people"] == 2
    assert notes["epochs"] == pytest.approx(2 / 5 + 2 / 2)
    method: Any = load_method(tmp_path / "parts", dataset.body)
    assert len(method.poses) == 10
    with pytest.raises(InputError, match=r"was started with losses.points = 0.33, not 0.5"):
        fit(Quick(TINY, DataLosses(2, points=0.5), dataset), tmp_path / "parts", loop, resume=True)


class Stopping(Quick):
    """Presses Ctrl-C in its second step."""

    asked = 0

    def steps(self, networks, rows):  # type: ignore[no-untyped-def]
        import signal

        self.asked += 1
        yield from super().steps(networks, rows)
        if self.asked == 2:
            signal.raise_signal(signal.SIGINT)


def test_a_trained_network_is_trained_further(dataset: OutfitDataset, tmp_path: Path) -> None:
    network = DeePSDNetwork(TINY, len(dataset.body.skeleton.names))
    method = DeePSD(TINY, network, dataset.vectors[:3], ("data",))
    start = TrainedStart(method, TrainingData({"old.npz": "x"}, {"train": {"old": "eve"}}), {"step": 7})
    objective = Quick(PRESETS["default"], DataLosses(poses_per_outfit=2), dataset, start=start)
    before = network.state_dict()
    begun = objective.networks()["net"].state_dict()
    assert all(torch.equal(begun[name], value) for name, value in before.items())
    fit(objective, tmp_path / "run", LOOP, resume=False)
    after = load_start(str(tmp_path / "run"), "--start-from")
    changed = {
        name for name, value in after.method.network.state_dict().items() if (value != before[name]).any()
    }
    assert any(name.startswith("branches.data") for name in changed)
    assert not any(name.startswith("branches.physics") for name in changed)
    assert after.notes["start"] == {"step": 7}
    assert after.data.clips["train"] == {"old": "eve", "clip0": "person0", "clip1": "person1"}


def test_training_lowers_the_error(dataset: OutfitDataset) -> None:
    """What smooth skinning lacks here is a bulge that the pose drives."""
    config = replace(TINY, shape_layers=(32, 32), pose_layers=(32, 32))
    objective = Quick(config, DataLosses(poses_per_outfit=4, points=1.0, small_shapes=0.0), dataset)
    torch.manual_seed(0)
    net = objective.networks()["net"]
    optimizer = torch.optim.Adam(net.parameters(), lr=1e-2)
    errors = []
    for step in range(30):
        torch.manual_seed(step)
        _, loss, parts = next(iter(objective.steps({"net": net}, torch.tensor([0, 5]))))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append(float(parts["error"].detach()))
    assert sum(errors[-5:]) < 0.7 * sum(errors[:5])
    scores = objective.validate(net)
    assert list(scores)[:2] == ["mean_mm", "smooth_lbs_mm"]
    assert 1.0 < scores["smooth_lbs_mm"] < 20.0


@pytest.mark.parametrize(
    "config",
    [
        replace(TINY, deformation="offsets"),
        replace(TINY, deformation="none", blend_weights="changed"),
        replace(TINY, blend_weights="changed"),
        replace(TINY, keys=0),
        replace(TINY, global_layers=()),
        replace(TINY, graph_heads=True),
        replace(TINY, reads_fabric=False),
        replace(TINY, inputs="mesh", blend_weights="learned", influences=99),
    ],
)
def test_every_ablation_trains(config: DeePSDConfig, dataset: OutfitDataset) -> None:
    objective = Quick(config, DataLosses(poses_per_outfit=2, closest_weights=1.0), dataset)
    net = objective.networks()["net"]
    _, loss, _ = next(iter(objective.steps({"net": net}, torch.tensor([1, 6]))))
    loss.backward()
    for name, parameter in net.named_parameters():
        moves = parameter.grad is not None and bool(parameter.grad.any())
        idle = name.startswith("branches.physics") or (
            name.startswith("embedding") and config.deformation == "none"
        )
        assert moves != idle or "bias" in name, name


def test_outfits_are_of_the_fabric_that_was_simulated(dataset: OutfitDataset) -> None:
    for outfit, name in zip((*dataset.training, *dataset.held), ("jersey", "silk", "jersey"), strict=True):
        features = torch.tensor(FABRICS[name].features())
        assert torch.equal(outfit.graph.fabric, features.expand(len(outfit.graph.points), -1))
        assert {garment.fabric for garment in outfit.outfit.garments} == {FABRICS[name]}


def test_a_fabric_is_named_for_an_outfit_that_has_no_data(
    folder: Path, dataset: OutfitDataset, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="--fabric: needs --outfit; data contain their fabric"):
        DeePSDRun(out=tmp_path / "run", data=(folder,), fabric="silk").train()
    blind = Quick(replace(TINY, reads_fabric=False), DataLosses(), dataset)
    blind.save(blind.networks()["net"], tmp_path / "blind", {})
    run = DeePSDRun(
        out=tmp_path / "run", physics_only=str(tmp_path / "blind"), outfit=("tops",), fabric="silk"
    )
    with pytest.raises(InputError, match="--fabric silk: model deepsd knows only the fabric"):
        run.train()


def test_the_batch_doubles() -> None:
    loop = LoopConfig(steps=10, batch=4, double_every=0.2)
    assert [batch_after(loop, step / 10) for step in range(10)] == [4, 4, 8, 8, 16, 16, 32, 32, 64, 64]
    assert batch_after(replace(loop, double_every=0.0), 0.9) == 4
    assert len(rows_of_step(torch.arange(100), replace(loop, batch=64), 9)) == 64
    with pytest.raises(InputError, match=r"--double-every 1\.0: has to be 0 or more, and less than 1"):
        replace(loop, double_every=1.0)


def test_folders_that_do_not_do_are_refused(folder: Path, tmp_path: Path) -> None:
    for path in folder.glob("clip[01]*.npz"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / BODIES).mkdir()
    (tmp_path / BODIES / "ann.npz").write_bytes((folder / BODIES / "ann.npz").read_bytes())
    with pytest.raises(InputError, match="holds no outfit for validation, training needs at least one"):
        read_outfits([tmp_path], 1)
    with pytest.raises(InputError, match=r"no sequence \(\*.npz\)"):
        read_outfits([tmp_path / BODIES / "none"], 1)
    with pytest.raises(InputError, match=r"--points 0.0: has to be more than 0"):
        DataLosses(points=0.0)


def test_sequences_of_single_garments_are_outfits_of_one(folder: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    save_clips(plain, ("tops", "bottoms"), clips=3, frames=5)
    with pytest.raises(
        InputError, match=r"clip0_bottoms.npz: has no split: the index.csv of its folder lacks the clip clip0"
    ):
        read_outfits([plain], 1)
    rows = "clip0,ann,train,walk,0,2\nclip1,ann,train,run,0,2\nclip2,bob,validation,walk,0,2\n"
    (plain / "index.csv").write_text(f"trial,subject,split,action,window_start,window_frames\n{rows}")
    alone = read_outfits([plain], 1)
    assert [outfit.name for outfit in alone.training] == ["bottoms_default", "tops_default"]
    assert [len(outfit.vectors) for outfit in alone.training] == [8, 8]
    assert [outfit.name for outfit in alone.held] == ["tops_default"]
    assert alone.data.clips["train"] == {"clip0": "ann", "clip1": "ann"}
    both = read_outfits([folder, plain], 1)
    assert {"plain/tops_default", f"{folder.name}/belt"} <= {outfit.name for outfit in both.training}
    assert len(both.data.files) == len(alone.data.files) + len(read_outfits([folder], 1).data.files)
    (plain / "index.csv").write_text((plain / "index.csv").read_text().replace("ann", "person2"))
    with pytest.raises(InputError, match="plain: person person2 is in two splits"):
        read_outfits([folder, plain], 1)


def test_bodies_of_two_kinds_are_refused(
    dataset: OutfitDataset, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from train.deepsd import dataset as module

    first, (outfit, clip), last = module.outfit_clips(folder)
    other = replace(outfit, body=small_body())
    monkeypatch.setattr(module, "outfit_clips", lambda *_: [first, (other, clip), last])
    with pytest.raises(
        InputError, match="outfit hips is on a body of another mesh or skeleton than outfit belt"
    ):
        read_outfits([folder], 1)


def test_the_command_trains(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = "train deepsd --preset tiny --steps 2 --validate-every 2 --data"
    monkeypatch.setattr(sys, "argv", [*words.split(), str(folder), "--out", str(tmp_path / "run")])
    main()
    checkpoint = load_checkpoint(tmp_path / "run", load_body())
    assert checkpoint.notes["branches"] == ["data"]
    assert checkpoint.notes["losses"]["poses_per_outfit"] == 2
