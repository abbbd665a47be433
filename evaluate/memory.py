"""Memory of a rollout: the growth of a process that does nothing else."""

import gc
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.garments.garment import Outfit
from uvcloth.methods.method import Method
from uvcloth.process.pool import pool
from uvcloth.rollouts.rollout import prepare_rollout

from .candidates import Candidate, assigned
from .progress import progress
from .selection import Cases

MEMORY_FRAMES = 30
"""Frames of a rollout, from the first on, whose memory is measured."""


def rollout_memory(candidates: Sequence[Candidate], cases: Cases) -> dict[str, dict[str, float]]:
    """Peak memory, MB, of preparing and rolling out each method, by name, on each outfit, by name.

    Body, garment, weights and libraries that are loaded before are not in it. Empty where the system does not
    tell (it is Linux that does).
    """
    if sys.platform != "linux":
        return {}
    dressing = assigned(candidates, cases.outfits, cases.data)
    first = {opener.outfit: opener for opener in reversed(cases.openers)}
    jobs = [
        _MemoryJob(each.name, name, each.method, cases.outfits[name], case.motion[:MEMORY_FRAMES], case.fps)
        for name, opener in first.items()
        for case in [opener.load()]
        for each in dressing[name]
    ]
    grown: dict[str, dict[str, float]] = {}
    with (
        progress("Memory", len(jobs)) as tick,
        pool(_measure, 1, "measured memory", fresh=True) as measured,
    ):
        for name, outfit, megabytes in measured(jobs):
            grown.setdefault(name, {})[outfit] = megabytes
            tick(note=f"{outfit}: {name}")
    return grown


@dataclass(frozen=True)
class _MemoryJob:
    """A method by name, and an outfit by name, over joint transforms (F, J, 3, 4)."""

    name: str
    outfit_name: str
    method: Method
    outfit: Outfit
    motion: Tensor
    fps: float


def _measure(job: _MemoryJob) -> tuple[str, str, float]:
    torch.set_num_threads(1)
    gc.collect()
    before = process_megabytes("VmRSS")
    prepared = prepare_rollout(job.method, job.outfit)
    for _ in islice(prepared.frames(job.motion, job.fps), len(job.motion)):
        continue
    return job.name, job.outfit_name, process_megabytes("VmHWM") - before


def process_megabytes(field: str) -> float:
    """Memory of this process, MB, by its name in /proc/self/status; not a number elsewhere than on Linux.

    VmRSS: all of it. VmHWM: the most that it ever was. RssAnon: what is not backed by files.
    """
    if sys.platform == "linux":
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        lines = dict(line.split(":", 1) for line in status.splitlines())
        return int(lines[field].split()[0]) / 1024
    return math.nan
