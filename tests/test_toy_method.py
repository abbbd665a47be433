"""A new method from end to end: method, trainer, one line each that registers them, and no other file."""

import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from evaluate.__main__ import main as evaluate
from tests.writers.glb_reader import GlbReader
from train.__main__ import main as train
from train.loop import LoopConfig, Objective, fit
from train.registry import TRAINERS
from train.trainer import TrainerEntry
from train.validation import mean_errors, rollout_distances
from uvcloth.bodies.body import Body, load_body
from uvcloth.checkpoint import Checkpoint, body_record, save_checkpoint
from uvcloth.commands.export import Export
from uvcloth.commands.rollout import Rollout
from uvcloth.commands.run.export import export
from uvcloth.commands.run.rollout import animate
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.dataset.reader import read_clips
from uvcloth.dataset.splits import training_data
from uvcloth.garments.garment import Garment
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.methods.capabilities import Riggable
from uvcloth.methods.method import Method, MethodEntry, Traits
from uvcloth.methods.registry import METHODS, Registered, list_methods
from uvcloth.methods.rig import PoseRig
from uvcloth.motion.library import load_clip
from uvcloth.motion.options import MotionOptions
from uvcloth.writers.animation import load_animation

OUTFIT = ("bottoms", "tops")
BODY = load_body()


# The method: smooth LBS of garments that were moved at rest. The trainer: by how much.
@dataclass(frozen=True)
class Moved(Method, Riggable):
    move: Tensor
    name: str = "moved"
    traits = Traits(quasi_static=True)

    def prepare(self, outfit, device):
        return [(g.mesh.vertices + self.move, g.smooth_weights) for g in outfit.garments]

    def step(self, prepared, state, frames):
        return state, tuple(skin(points, weights, frames.transforms[:, -1]) for points, weights in prepared)

    def as_rig(self, body: Body, garments: tuple[Garment, ...] = ()) -> PoseRig:
        worn = [fit_template(name, body) for name in OUTFIT]
        meshes = [replace(g.mesh, vertices=g.mesh.vertices + self.move) for g in worn]
        weights = torch.cat([g.smooth_weights for g in worn])
        shapes, poses = torch.zeros(0, len(weights), 3), torch.zeros(0, 3 * weights.shape[1])
        named = tuple(zip(OUTFIT, meshes, strict=True))
        every = torch.arange(len(weights))
        return PoseRig(self.name, named, every, weights, shapes, (), body.skeleton.parents, poses)


class MovedObjective(Objective):
    samples = torch.arange(1)

    def __init__(self, data: Path) -> None:
        ((_, clips),) = read_clips([data], OUTFIT)
        self.clips = [clip.labelled(split="train") for clip in clips]
        self.garments = [fit_template(name, BODY) for name in OUTFIT]

    def networks(self) -> dict[str, nn.Module]:
        net = nn.Linear(1, 3)
        nn.init.zeros_(net.bias)
        return {"net": net}

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        (move,), clip = networks["net"](torch.zeros(1, 1)), self.clips[0]
        loss = torch.zeros(())
        for g in self.garments:
            moved = skin(g.mesh.vertices + move, g.smooth_weights, clip.transforms)
            loss = loss + (moved - clip.by_name[g.name].vertices).abs().mean()
        yield "net", loss, {"distance": loss}

    def validate(self, net: Any) -> dict[str, float]:
        prepared = [(g.mesh.vertices + net.bias, g.smooth_weights) for g in self.garments]
        device = torch.device("cpu")
        return mean_errors(rollout_distances(Moved(net.bias), prepared, BODY, OUTFIT, self.clips, device))

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        tensors, data = {"move": net.bias.detach()}, training_data(self.clips)
        save_checkpoint(Checkpoint("moved", {}, tensors, body_record(BODY), OUTFIT, data, notes), run)

    def settings(self) -> dict[str, Any]:
        return {"data": asdict(training_data(self.clips))}


@dataclass(frozen=True)
class MovedRun:
    data: Path
    out: Path
    loop: LoopConfig = field(default_factory=lambda: LoopConfig(steps=60, average=0.0, learning_rate=0.003))

    def train(self) -> dict[str, float]:
        return fit(MovedObjective(self.data), self.out, self.loop, resume=False)


def load_moved(checkpoint: Checkpoint, folder: Path) -> Moved:
    return Moved(checkpoint.tensors["move"])


ENTRY = MethodEntry(None, lambda _: Moved(torch.zeros(3)), load=load_moved)
TRAINER = TrainerEntry(MovedRun, {})


# The two lines in the registries.
def register(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Registered("bottoms under tops", "tests.test_toy_method:ENTRY", rig=True)
    monkeypatch.setitem(METHODS, "moved", line)
    monkeypatch.setitem(TRAINERS, "moved", "tests.test_toy_method:TRAINER")


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Trousers and a shirt over them, as if simulated together, that hang two centimetres to the front."""
    for clip, frames in (("a", 8), ("b", 6)):
        transforms = load_clip("walk", BODY).window(10 * frames, frames).transforms()
        for garment in (fit_template(name, BODY) for name in OUTFIT):
            front = garment.mesh.vertices + torch.tensor([0.0, -0.02, 0.0])
            sequence = clip_of_garment(
                vertices=skin(front, garment.smooth_weights, transforms),
                faces=garment.mesh.faces,
                rest=garment.mesh.vertices,
                transforms=transforms,
                fps=30.0,
                warm_up=2,
                metadata={"clip": clip, "garment": garment.name, "layers": list(OUTFIT)},
            )
            save_simulated(sequence, tmp_path / "data" / f"{clip}_{garment.name}.npz")
    return tmp_path / "data"


@pytest.mark.usefixtures("coarse_pixels")
def test_a_method_in_one_file_trains_rolls_out_is_judged_and_exported(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    register(monkeypatch)
    assert "moved (bottoms under tops)" in list_methods()
    run = tmp_path / "mine"
    monkeypatch.setattr(sys, "argv", ["train", "moved", "--data", str(data), "--out", str(run)])
    train()

    options = MotionOptions(frames="0:24")
    summary = animate(
        Rollout("walk", OUTFIT, (tmp_path / "walk.npz",), (str(run),), finish="none", options=options)
    )
    worn = load_animation(tmp_path / "walk.npz")
    assert worn.names == OUTFIT
    assert len(worn) == summary.frames

    judged = ["--model", "lbs_smooth", str(run), "--data", str(data), "--out", str(tmp_path / "report")]
    assert evaluate([*judged, "--no-pictures", "--actions", "a", "--frames", "2"]) == 0
    results = json.loads((tmp_path / "report" / "metrics.json").read_text())
    (outfit,) = results["outfits"]
    cells = {name: method["outfits"][outfit]["actions"]["a"] for name, method in results["methods"].items()}
    assert cells["lbs_smooth"]["vertex_mean_mm_raw"] > 15.0
    assert cells["mine"]["vertex_mean_mm_raw"] < 2.0

    exported = export(Export(str(run), tmp_path / "rig.glb", motion="walk"))
    assert exported.written == (tmp_path / "rig.glb",)
    played = GlbReader.load(tmp_path / "rig.glb")
    for name, vertices in zip(OUTFIT, worn.vertices, strict=True):
        apart = played.posed(name, 20) - vertices[20][played.source(name)]
        assert np.linalg.norm(apart, axis=1).mean() < 1e-3
