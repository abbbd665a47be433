"""Processor time of recurrent rigs for many characters at once: of the network alone, and with the garment.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/crowd.py [--model recurrent] [--garment dress] [--characters 1 100 1000]

on one thread. All characters walk. For each number of them it prints the milliseconds of processor time that
a frame takes per character: blend shape weights alone, as an engine needs them for its own skinning, and
vertices.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
import tyro
from torch import Tensor

from uvcloth.bodies.body import load_body
from uvcloth.errors import InputError
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.skinning import skin_each
from uvcloth.methods.recurrent.method import Recurrent
from uvcloth.methods.registry import load_method
from uvcloth.motion.library import load_clip
from uvcloth.process.command import run_command

SECONDS = 1.0
"""Processor time that is measured, at least."""


@dataclass(frozen=True)
class Crowd:
    """Measure recurrent rigs."""

    model: str = "recurrent"
    """A shipped model or a run folder."""
    garment: str = "dress"
    """Template."""
    characters: tuple[int, ...] = (1, 100, 1000)
    """Numbers of characters."""

    def run(self) -> None:
        """Print the table. Raises InputError for another model."""
        torch.set_num_threads(1)
        torch.set_grad_enabled(False)
        body = load_body()
        method = load_method(self.model, body)
        if not isinstance(method, Recurrent):
            raise InputError(f"--model {self.model}: is not a recurrent rig")
        rig = method.as_rig(body, (load_garment(self.garment, body),))
        clip = load_clip("walk", body)
        joints = clip.transforms().unfold(0, 3, 1).movedim(-1, 1)
        rest, shapes = rig.rest.T.flatten(), rig.shapes.mT.flatten(1)

        def garments(weights: Tensor, now: Tensor) -> Tensor:
            points = torch.addmm(rest, weights, shapes).view(len(weights), 3, -1)
            return skin_each(points, rig.weights, now[:, -1])

        for count in self.characters:
            now = joints[torch.arange(count) % len(joints)].contiguous()
            hidden = torch.zeros(count, rig.memory)
            weights, _ = rig.step(now, hidden, 1.0 / clip.fps)
            network = _milliseconds(partial(rig.step, now, hidden, 1.0 / clip.fps)) / count
            vertices = network + _milliseconds(partial(garments, weights, now)) / count
            print(f"{count} characters: weights {network:.3f} ms, vertices {vertices:.3f} ms")


def _milliseconds(work: Callable[[], object]) -> float:
    """Processor time of one call, ms, on average."""
    work()
    begun, calls = time.process_time(), 0
    while time.process_time() - begun < SECONDS:
        work()
        calls += 1
    return 1000.0 * (time.process_time() - begun) / calls


if __name__ == "__main__":
    sys.exit(run_command("crowd.py", lambda: tyro.cli(Crowd).run()))
