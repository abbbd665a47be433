"""A recurrent rig as ONNX: joints of three frames and the memory in, blend shape weights and memory out."""

import json
import warnings
from pathlib import Path

import torch
from torch import Tensor, nn

from uvcloth.methods.recurrent.network import STILL_STEPS, TICK
from uvcloth.methods.recurrent.rig import RecurrentRig
from uvcloth.writers.embedding import IR_VERSION, OPSET, require_onnx
from uvcloth.writers.rig import Rigged

DESCRIPTIONS = {
    "joints": (
        "matrices (3, 4) of each joint, in the order of `names`, that take a point from where it is at rest "
        "to where it is in the world, metres, Z up: of the frame before the last, the last and this frame"
    ),
    "memory": (
        f"next_memory of the last frame; at the start zeros, then {STILL_STEPS} steps of {TICK:.6f} seconds "
        "in which the body stands in the first frame"
    ),
    "seconds": "time since the last frame",
}
"""Descriptions of the inputs."""


class _Frame(nn.Module):
    """One frame of a rig, with weights as its file has them."""

    def __init__(self, rig: RecurrentRig, rigged: Rigged) -> None:
        super().__init__()
        self.rig, self.code = rig, rigged.code
        self.networks = nn.ModuleList(network.network for network in rig.networks)

    def forward(self, joints: Tensor, memory: Tensor, seconds: Tensor) -> tuple[Tensor, Tensor]:
        weights, memory = self.rig.step(joints, memory, seconds)
        return self.code.weights(weights), memory


def write_recurrent(rig: RecurrentRig, rigged: Rigged, path: Path) -> None:
    """Write a frame of a rig as ONNX, the number of characters B free.

    joints (B, 3, J, 3, 4), memory (B, H) and seconds (1,) in, weights (B, K) in [0, 1] and next_memory (B, H)
    out; the metadata describes the inputs, and names joints and shapes. Raises InputError if the package onnx
    is not installed.
    """
    require_onnx(path)
    import onnx
    from onnx import helper

    names = rigged.rig.skeleton.names
    still = torch.eye(3, 4).expand(2, 3, len(names), 3, 4)
    inputs = (still, torch.zeros(2, rig.memory), torch.tensor([TICK]))
    with warnings.catch_warnings():
        # The exporter that torch recommends needs another package, and says so.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            _Frame(rig, rigged).eval(),
            inputs,
            str(path),
            dynamo=False,
            opset_version=OPSET,
            input_names=["joints", "memory", "seconds"],
            output_names=["weights", "next_memory"],
            dynamic_axes={name: {0: "batch"} for name in ("joints", "memory", "weights", "next_memory")},
        )
    model = onnx.load(str(path))
    model.ir_version, model.producer_name = IR_VERSION, "uvcloth"
    facts = {"names": json.dumps(names), "shapes": json.dumps(rigged.rig.shape_names)}
    helper.set_model_props(model, DESCRIPTIONS | facts)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
