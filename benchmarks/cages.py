"""Physics on cages, networks with and without its finish, and skinning, against the fine simulation.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/cages.py DATA [--garments tops bottoms dress] [--clips 11_01 26_01 31_01 35_01]

on one thread; DATA: a folder of `uvcloth simulate`. For every sequence CLIP_GARMENT it rolls each method out
over the whole motion and prints, after the warm-up, the mean distance of the vertices in mm, and of the tenth
of the vertices that moves most against the skinned garment the ratio of its speed to the simulation's and
their correlation (swing); then the milliseconds of processor time that a frame takes on average, posing
included. Other simulations, members of the ensemble in DATA/members, show how much of that is chance. The
machine's load is printed.
"""

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
import tyro
from torch import Tensor

from evaluate.metrics import Reference, distance_scores, swing_scores
from evaluate.results import swing
from uvcloth.bodies.body import Body, load_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.skinning import skin
from uvcloth.methods.method import Method
from uvcloth.methods.physics.finish import Finished
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.methods.registry import load_method
from uvcloth.process.command import run_command
from uvcloth.rollouts.rollout import prepare_rollout


@dataclass(frozen=True)
class Cages:
    """Compare physics on cages with the fine simulation."""

    data: tyro.conf.Positional[Path]
    """Folder of sequences."""
    garments: tuple[str, ...] = ("tops", "bottoms", "dress")
    """Garments of the sequences."""
    clips: tuple[str, ...] = ("11_01", "26_01", "31_01", "35_01")
    """Clips of the sequences: windows of validation."""

    def run(self) -> None:
        """Print the table. Raises InputError for a sequence that is not there."""
        torch.set_num_threads(1)
        torch.set_grad_enabled(False)
        body = load_body()
        print(f"load {os.getloadavg()[0]:.1f}; mm, swing, correlation, ms")
        for garment in self.garments:
            for clip in self.clips:
                sequence = load_simulated(self.data / f"{clip}_{garment}.npz")
                outfit = Outfit(body, (load_garment(garment, body),))
                for name, method in methods(body):
                    if method.unsupported_reason(outfit):
                        continue
                    print(f"{garment} {clip} {name}: {measured(method, sequence, outfit)}", flush=True)
                for path in sorted(self.data.glob(f"members/*/{clip}_{garment}.npz")):
                    member = load_simulated(path).vertices
                    print(f"{garment} {clip} another simulation: {scored(member, sequence, outfit)}")


def methods(body: Body) -> Iterator[tuple[str, Method]]:
    """Yield what is compared, by name."""
    network = load_method("physxnet", body)
    yield "lbs_smooth", load_method("lbs_smooth", body)
    yield "recurrent, clear", load_method("recurrent", body)
    yield "physxnet, clear", network
    yield "physxnet, dynamic", Finished.of(network, Physics(PhysicsConfig()))
    for quality in ("fast", "default", "fine"):
        yield f"physics, {quality}", Physics(PhysicsConfig(quality))


def measured(method: Method, sequence: SimulatedClip, outfit: Outfit) -> str:
    """Measure a method on a sequence of the outfit's garment: one line of figures."""
    prepared = prepare_rollout(method, outfit)
    before = time.process_time()
    frames = [frame.vertices[0] for frame in prepared.frames(sequence.transforms, sequence.fps)]
    spent = 1000.0 * (time.process_time() - before) / len(frames)
    return f"{scored(torch.stack(frames), sequence, outfit)}, {spent:.1f}"


def scored(vertices: Tensor, sequence: SimulatedClip, outfit: Outfit) -> str:
    """Error, swing and correlation of vertices (F, N, 3) m after the warm-up of a sequence."""
    (garment,), frames = outfit.garments, slice(sequence.warm_up, None)
    mesh, vertices, truth = garment.mesh, vertices[frames], sequence.vertices[frames]
    skinned = skin(mesh.vertices, garment.smooth_weights, sequence.transforms)[frames]
    reference = Reference(truth, (), skinned, mesh.vertices, mesh.faces, sequence.fps, None, None)
    error = float(distance_scores(vertices, truth)["vertex_mean_mm"].mean())
    ratio, correlation = swing([swing_scores(vertices, reference)]).values()
    return f"{error:.1f}, {ratio:.2f}, {correlation:.2f}"


if __name__ == "__main__":
    sys.exit(run_command("cages.py", lambda: tyro.cli(Cages).run()))
