"""Launching of Warp kernels over torch tensors, on a GPU's stream or on the processor's cores."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any

import torch
import warp as wp
from torch import Tensor

from rasterize.warp_start import start_warp

LEAST_ITEMS_PER_THREAD = 500
"""Fewest items that justify a thread of their own."""

start_warp()


def array(values: Tensor) -> Any:
    """Warp array over a contiguous tensor, without a copy: (N, 3) as N vectors."""
    return wp.from_torch(values, dtype=wp.vec3 if values.ndim == 2 else None)


def stream(device: torch.device) -> wp.ScopedStream:
    """Context in which Warp's work is ordered with torch's own on the device."""
    return wp.ScopedStream(wp.stream_from_torch(device) if device.type == "cuda" else None)


def launch(kernel: wp.Kernel, count: int, device: torch.device, *arguments: Any) -> None:
    """Run a kernel for `count` items, on a processor one share per core, and there wait for it.

    The kernel's first argument is the first item of the share.
    """
    # Warp runs a CPU kernel on one core and without the interpreter's lock.
    cores = torch.get_num_threads() if device.type == "cpu" else 1
    shares = max(1, min(cores, count // LEAST_ITEMS_PER_THREAD))
    bounds = [count * index // shares for index in range(shares + 1)]
    first, *others = (
        wp.launch(kernel, end - start, [start, *arguments], device=str(device), record_cmd=True)
        for start, end in pairwise(bounds)
    )
    waiting = [_workers().submit(share.launch) for share in others]
    with stream(device):
        first.launch()
    for other in waiting:
        other.result()


@cache
def _workers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(thread_name_prefix="contact")
