"""Baking of wrinkles: the network and the garments' sheets as the runtime reads them, as named arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from uvcloth.wrinkles.network import TexelGain, WrinkleConfig, WrinkleNet
from uvcloth.wrinkles.sheet import Sheet

NETWORK_STEPS = {"wrinkles.weights": 2.0**-14, "wrinkles.gains": 2.0**-9, "wrinkles.mean": 2.0**-8}
"""Steps that the numbers of the network are rounded to in a file."""

SHEET_STEPS = {
    "shares": 2.0**-12,
    "slopes": 2.0**-6,
    "turns": 2.0**-12,
    "back_shares": 2.0**-8,
    "free": 2.0**-6,
}
"""The same for those of a sheet."""


def wrinkle_sections(
    config: WrinkleConfig,
    net: WrinkleNet,
    sheets: Sequence[Sheet],
    places: Sequence[int],
    free: Sequence[Tensor],
) -> dict[str, NDArray[Any]]:
    """The arrays of a network and of the garments that it makes wrinkles on, see runtime/src/wrinkles.h.

    places: of the garments in their outfit. free: (U,) of each, the share of its displacements that is shown.
    """
    sections = {"wrinkles.garments": np.array(places, np.int64), **_network(config, net)}
    for index, (sheet, share) in enumerate(zip(sheets, free, strict=True)):
        sections |= {f"wrinkles{index}.{name}": array for name, array in _sheet(sheet).items()}
        sections[f"wrinkles{index}.free"] = share.numpy()
    return sections


def wrinkle_steps(garments: int) -> dict[str, float]:
    """Steps of the sections of so many garments with wrinkles, to which a file rounds them."""
    of_sheets = {
        f"wrinkles{index}.{name}": step for index in range(garments) for name, step in SHEET_STEPS.items()
    }
    return {**NETWORK_STEPS, **of_sheets}


@torch.no_grad()
def _network(config: WrinkleConfig, net: WrinkleNet) -> dict[str, NDArray[Any]]:
    kernels = [net.first, *net.down, *net.across, *net.narrow, *net.up, net.last]
    shape = [config.size // 2, *(kernel.out_channels for kernel in net.across)]
    return {
        "wrinkles.shape": np.array(shape),
        "wrinkles.reach": np.array([config.reach]),
        "wrinkles.gain": np.array([config.gain]),
        "wrinkles.lag": np.array([config.lag]),
        "wrinkles.shift": _flat(net.input_shift),
        "wrinkles.scale": _flat(net.input_scale),
        "wrinkles.output": _flat(net.output_scale),
        "wrinkles.mean": net.mean[0].flatten(1).T.float().numpy(),
        "wrinkles.weights": np.concatenate(
            [_flat(kernel.get_parameter("weight").permute(2, 3, 1, 0)) for kernel in kernels]
        ),
        "wrinkles.biases": np.concatenate([_flat(kernel.get_parameter("bias")) for kernel in kernels]),
        "wrinkles.gains": np.concatenate([_gains(gain) for gain in (*net.here, net.end)]),
    }


def _gains(gain: nn.Module) -> NDArray[Any]:
    """Gain and offset (T, 2), of each channel of each pixel."""
    assert isinstance(gain, TexelGain)
    return np.stack([_flat(each[0].permute(1, 2, 0)) for each in (gain.gain, gain.offset)], axis=1)


def _flat(values: Tensor) -> NDArray[Any]:
    flat: NDArray[Any] = values.flatten().float().numpy()
    return flat


def _sheet(sheet: Sheet) -> dict[str, NDArray[Any]]:
    corners, shares = _three(sheet.places)
    return {
        "texels": sheet.texels.pixels.numpy(),
        "corners": corners,
        "shares": shares[:, :2],
        **_slopes(sheet.slopes),
        "sides": sheet.sides.numpy(),
        "beside": sheet.padding.pixels.numpy(),
        "sources": sheet.padding.sources.numpy(),
        "turns": sheet.padding.turns.flatten(1).numpy(),
        **_back(sheet.back),
    }


def _three(places: Tensor) -> tuple[NDArray[Any], NDArray[Any]]:
    """Columns and weights (P, 3) of rows of three entries or fewer."""
    starts, columns, weights = _csr(places)
    rows = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    slots = np.arange(len(columns)) - starts[rows]
    # A row with fewer has the first column once more, with no weight.
    corners = np.repeat(columns[starts[:-1]][:, None], 3, axis=1)
    shares = np.zeros(corners.shape)
    corners[rows, slots], shares[rows, slots] = columns, weights
    return corners, shares


def _slopes(slopes: Tensor) -> dict[str, NDArray[Any]]:
    """Points around each texel, and their weights for the derivatives along u and v, but for the first."""
    import scipy.sparse

    starts, columns, weights = _csr(slopes)
    both = scipy.sparse.csr_array((weights, columns, starts), shape=tuple(slopes.shape))
    along_u, along_v = both[: slopes.shape[0] // 2], both[slopes.shape[0] // 2 :]
    pattern = (abs(along_u) + abs(along_v)).tocsr()
    pattern.sort_indices()
    rows = np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
    entries = np.stack([along[rows, pattern.indices] for along in (along_u, along_v)], axis=1)
    later = np.ones(len(rows), bool)
    later[pattern.indptr[:-1]] = False
    return {
        "slope_starts": pattern.indptr,
        "slope_points": pattern.indices,
        "slopes": entries[later],
    }


def _back(back: Tensor) -> dict[str, NDArray[Any]]:
    """Quarters of each vertex, and all but the last of their shares."""
    starts, columns, weights = _csr(back)
    sums = np.add.reduceat(weights, starts[:-1])
    shares = weights / np.repeat(sums, np.diff(starts))
    return {
        "back_starts": starts,
        "back": columns,
        "back_shares": np.delete(shares, starts[1:] - 1),
    }


def _csr(matrix: Tensor) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Starts, columns and weights of a sparse matrix."""
    return matrix.crow_indices().numpy(), matrix.col_indices().numpy(), matrix.values().double().numpy()
