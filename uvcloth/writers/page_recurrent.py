"""A recurrent rig for a web page, whose `recurrent.js` plays it in plain JavaScript."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from uvcloth.files.eight_bits import ROWS, in_eight_bits
from uvcloth.geometry.skinning import strongest
from uvcloth.geometry.units import GRAVITY
from uvcloth.methods.recurrent.network import STILL_STEPS, STRANGEST, TICK, RecurrentNetwork
from uvcloth.methods.recurrent.rig import RecurrentRig
from uvcloth.writers.page_arrays import pack_arrays

INFLUENCES = 12
"""Joints of a vertex; the others move a dress by less than 0.1 mm."""

EIGHT_BITS = (
    *("motion.weight", "enter.2.weight", "unit.weight_ih_l0", "unit.weight_hh_l0"),
    *("leave.0.weight", "leave.2.weight", "shapes"),
)
"""Tensors of a network that have eight bits; checkpoints have them so too."""

PLAIN = (
    *("motion.bias", "enter.2.bias", "unit.bias_ih_l0", "unit.bias_hh_l0", "leave.0.bias", "leave.2.bias"),
    *("center", "spread"),
)
"""Its other tensors, besides those of its garment."""


def pack_recurrent(rig: RecurrentRig) -> bytes:
    """Pack a rig, of which each garment has a network of its own, and one whose dynamics are not scaled."""
    arrays: dict[str, NDArray[Any]] = {"heads": rig.heads.numpy().astype(np.float32)}
    first = 0
    for place, ((_, mesh), scaled) in enumerate(zip(rig.garments, rig.networks, strict=True)):
        assert scaled.dynamics == 1.0
        rows = rig.owner[first : first + len(mesh.vertices)]
        joints, weights = strongest(rig.weights[rows], INFLUENCES)
        of_garment = {
            **_network(scaled.network),
            "rest": mesh.vertices.numpy().astype(np.float32),
            "joints": joints.astype(np.uint16),
            "weights": weights.astype(np.float32),
        }
        arrays |= {f"{place}.{name}": values for name, values in of_garment.items()}
        first += len(mesh.vertices)
    return pack_arrays(
        arrays,
        garments=len(rig.garments),
        gravity=GRAVITY,
        tick=TICK,
        strangest=STRANGEST,
        stillSteps=STILL_STEPS,
        memory=[network.network.memory for network in rig.networks],
    )


def _network(network: RecurrentNetwork) -> dict[str, NDArray[Any]]:
    """The arrays of a network by name: in eight bits with the scales of their rows, or whole."""
    state = {name: network.state_dict()[name].float() for name in (*EIGHT_BITS, *PLAIN)}
    packed = in_eight_bits(state, lambda name: name in EIGHT_BITS)
    arrays = {
        name: tensor.numpy() if tensor.dtype == torch.int8 else tensor.flatten().numpy().astype(np.float32)
        for name, tensor in packed.items()
    }
    assert all(name + ROWS in arrays for name in EIGHT_BITS)
    return arrays | {
        "corners": network.corners.numpy().astype(np.uint16),
        "shares": network.shares.numpy().astype(np.float16),
    }
