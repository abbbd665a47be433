"""Readers of trained models: tensors, descriptions, and each method."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import nn

from tests.fuzz.target import Target, require, require_indices
from tests.small_body import small_body
from uvcloth.checkpoint import (
    Checkpoint,
    TrainingData,
    body_record,
    load_checkpoint,
    load_tensors,
    save_checkpoint,
    save_tensors,
)
from uvcloth.methods.deepsd.config import DeePSDConfig
from uvcloth.methods.deepsd.method import DeePSD, deepsd_checkpoint
from uvcloth.methods.deepsd.network import DeePSDNetwork
from uvcloth.methods.motion_guided.config import MotionGuidedConfig
from uvcloth.methods.motion_guided.method import Both as MotionGuidedNetworks
from uvcloth.methods.motion_guided.method import MotionGuided, motion_guided_checkpoint
from uvcloth.methods.pbns.method import PBNS, ModelOutfit, new_network, pbns_checkpoint
from uvcloth.methods.pbns.network import PBNSConfig
from uvcloth.methods.physxnet.config import PhysXNetConfig
from uvcloth.methods.physxnet.method import PhysXNet, physxnet_checkpoint
from uvcloth.methods.registry import load_method
from uvcloth.wrinkles.model import Wrinkles, load_wrinkles, wrinkles_checkpoint
from uvcloth.wrinkles.network import WrinkleConfig

DATA = TrainingData({"walk_tops.npz": "abc"}, {"train": {"walk": "ann"}, "validation": {"run": ""}})


def saved(checkpoint: Callable[[], Checkpoint]) -> Callable[[Path], Path]:
    """What makes a run folder of a checkpoint."""

    def make(folder: Path) -> Path:
        torch.manual_seed(0)
        save_checkpoint(checkpoint(), folder / "run")
        return folder / "run"

    return make


def good_tensors(folder: Path) -> Path:
    tensors = {"weight": torch.arange(6.0).view(2, 3), "half": torch.ones(4).half(), "count": torch.tensor(3)}
    save_tensors(tensors, {"done": {"step": 3}}, folder / "state.safetensors")
    return folder / "state.safetensors"


def check_tensors(found: tuple[dict[str, torch.Tensor], dict[str, Any]]) -> None:
    tensors, metadata = found
    require(isinstance(metadata, dict), "metadata that are no object")
    for name, tensor in tensors.items():
        require(torch.isfinite(tensor).all(), f"{name} is not finite")


def plain_checkpoint() -> Checkpoint:
    identity = body_record(small_body())
    return Checkpoint("physxnet", {"size": 32}, {"a": torch.ones(2)}, identity, ("tops",), DATA, {"step": 7})


def check_checkpoint(checkpoint: Checkpoint) -> None:
    check_tensors((checkpoint.tensors, checkpoint.notes))
    texts = [checkpoint.method, *checkpoint.garments, *checkpoint.data.files, *checkpoint.data.files.values()]
    texts += [text for clips in checkpoint.data.clips.values() for item in clips.items() for text in item]
    require(all(isinstance(text, str) for text in texts), "a name that is no text")


def physxnet() -> Checkpoint:
    config = PhysXNetConfig(size=8, width=2, levels=2, history=1, norm="batch", templates=("tops", "dress"))
    return physxnet_checkpoint(PhysXNet.untrained(config), small_body(), DATA, {})


def motion_guided() -> Checkpoint:
    config = MotionGuidedConfig(size=8, width=2, hidden=4, seeds=7, near=4, latent=3, vertices=5)
    tensors = MotionGuidedNetworks(MotionGuided.untrained(config)).state_dict()
    return motion_guided_checkpoint(config, tensors, small_body(), DATA, {"garment_topology": "0" * 64})


def pbns() -> Checkpoint:
    body = small_body()
    garments = ModelOutfit(("dress",), (body.mesh,), body.skeleton.heads, body.skeleton.parents)
    config = PBNSConfig(width=3, layers=2, influences=2)
    network = new_network(config, garments, body.weights, torch.zeros(4, 6))
    return pbns_checkpoint(PBNS(config, network, garments), body, DATA, {})


def deepsd() -> Checkpoint:
    layers = {name: (3,) for name in ("global_layers", "weight_layers", "shape_layers", "pose_layers")}
    config = DeePSDConfig(convolutions=(2, 3), keys=2, **layers)
    method = DeePSD(config, DeePSDNetwork(config, 2), torch.zeros(4, 6))
    return deepsd_checkpoint(method, small_body(), DATA, {})


def wrinkles() -> Checkpoint:
    config = WrinkleConfig(size=8, width=2, levels=2)
    return wrinkles_checkpoint(Wrinkles.untrained(config), small_body(), DATA, {})


def check_method(method: Any) -> None:
    networks = [value for value in vars(method).values() if isinstance(value, nn.Module)]
    require(networks, "no network")
    for network in networks:
        for name, tensor in network.state_dict().items():
            require(torch.isfinite(tensor).all(), f"{name} is not finite")
    if isinstance(method, PBNS):
        network = method.network
        for mesh in method.garments.meshes:
            require_indices(mesh.faces, (-1, 3), len(mesh.vertices), "faces")
        require(torch.isfinite(network.blend_weights()).all(), "blend weights are not finite")
        require(torch.isfinite(network.deform(network.poses[:1])).all(), "a deformation is not finite")


def load(path: Path) -> Any:
    """A method as commands load it."""
    return load_method(path, small_body())


TARGETS = [
    Target("tensors", good_tensors, load_tensors, check_tensors),
    Target("checkpoint", saved(plain_checkpoint), load_checkpoint, check_checkpoint),
    Target("physxnet", saved(physxnet), load, check_method),
    Target("motion_guided", saved(motion_guided), load, check_method),
    Target("pbns", saved(pbns), load, check_method),
    Target("deepsd", saved(deepsd), load, check_method),
    Target("wrinkles", saved(wrinkles), load_wrinkles, check_method),
]
