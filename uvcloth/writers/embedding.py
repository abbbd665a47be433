"""Pose embedding as ONNX: pose vector in, blend shape weights out, for engines that run it themselves."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.errors import InputError
from uvcloth.methods.rig import PoseRig
from uvcloth.writers.rig import Rigged

OPSET, IR_VERSION = 13, 8
"""Old enough for the runtimes of engines; the operators are Gemm, Relu and Clip, and of `shares` ReduceSum,
Greater, Where and Div."""

POSE_DESCRIPTION = (
    "three numbers per joint, in the order of `joints`, along Z-up axes: the axis-angle (radians) of its "
    "rotation relative to its parent; in place of the root's the direction of gravity in the root's axes"
)


def require_onnx(path: Path) -> None:
    """Raise InputError naming the file to write if the package onnx is not installed."""
    try:
        import onnx  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"{path}: writing it needs the package onnx: pip install 'uvcloth[export]', or name a --motion"
        ) from error


def write_embedding(model: PoseRig, rigged: Rigged, path: Path) -> None:
    """Write the embedding and the map to a rig's weights: pose (B, 3 J) in, weights (B, K) in [0, 1] out.

    The metadata names joints, parents and shapes. Raises InputError if the package onnx is not installed.
    """
    require_onnx(path)
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    layers = [(weight.T, bias) for weight, bias in model.layers]
    layers.append((rigged.code.scale, rigged.code.shift))
    constants: list[Any] = [
        numpy_helper.from_array(np.array(value, np.float32), name)
        for name, value in (("lowest", 0.0), ("highest", 1.0))
    ]
    if model.sum_to_one:
        constants.append(numpy_helper.from_array(np.array([-1], np.int64), "last_axis"))
    nodes: list[Any] = []
    value = "pose"
    for index, (weight, bias) in enumerate(layers):
        for kind, tensor in (("weight", weight), ("bias", bias)):
            array = np.ascontiguousarray(tensor.detach().numpy())
            constants.append(numpy_helper.from_array(array, f"{kind}_{index}"))
        inputs = [value, f"weight_{index}", f"bias_{index}"]
        nodes.append(helper.make_node("Gemm", inputs, [f"linear_{index}"]))
        value = f"linear_{index}"
        if index < len(layers) - 1:
            nodes.append(helper.make_node("Relu", [value], [f"relu_{index}"]))
            value = f"relu_{index}"
        if index == len(layers) - 2 and model.sum_to_one:
            nodes += [
                helper.make_node("ReduceSum", [value, "last_axis"], ["total"], keepdims=1),
                helper.make_node("Greater", ["total", "lowest"], ["divisible"]),
                helper.make_node("Where", ["divisible", "total", "highest"], ["divisor"]),
                helper.make_node("Div", [value, "divisor"], ["shares"]),
            ]
            value = "shares"
    nodes.append(helper.make_node("Clip", [value, "lowest", "highest"], ["weights"]))
    sizes = (("pose", 3 * len(model.parents)), ("weights", len(rigged.code)))
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", size]) for name, size in sizes]
    graph = helper.make_graph(nodes, "pose_embedding", ends[:1], ends[1:], constants)
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION, producer_name="uvcloth"
    )
    skeleton = rigged.rig.skeleton
    helper.set_model_props(
        model,
        {
            "pose": POSE_DESCRIPTION,
            "joints": json.dumps(skeleton.names),
            "parents": json.dumps(skeleton.parents),
            "shapes": json.dumps(rigged.rig.shape_names),
        },
    )
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
