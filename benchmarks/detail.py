"""Room for detail over a cage: bare cages, cages with the true detail of every frame, and finer cages.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/detail.py DATA [--garments dress] [--clips 11_01 26_01 31_01 35_01]

on one thread; DATA: a folder of `uvcloth simulate`. A network over a cage would predict what the fine cloth
has beyond what the cage can carry. Here nothing is predicted: that detail is taken from the simulation, which
is the best that any such network can do. For each quality of cages it prints the mean over the clips, after
the warm-up, of the distance of the vertices in mm, the ratio and correlation of the swing, and the wrinkles
over the simulation's in bands of wavelength, from the longest waves on; then the milliseconds of processor
time that a bare cage takes for a frame, without posing the body. "carried" is the simulation itself without
its detail. The machine's load is printed.
"""

import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
import tyro
from torch import Tensor

from evaluate.metrics import Reference, distance_scores, swing_scores
from evaluate.results import swing
from evaluate.surface import make_surface
from evaluate.wrinkles import WaveFilters, wave_filters, wrinkle_scores
from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skinning import skin
from uvcloth.methods.physics.dressed import dressed, move_on, shown
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, make_caged_outfit
from uvcloth.physics.outfit_clearing import FOLLOWING, OutfitClearing
from uvcloth.process.command import run_command


@dataclass(frozen=True)
class Detail:
    """Compare bare cages, cages with the true detail, and finer cages."""

    data: tyro.conf.Positional[Path]
    """Folder of sequences."""
    garments: tuple[str, ...] = ("dress",)
    """Garments of the sequences."""
    clips: tuple[str, ...] = ("11_01", "26_01", "31_01", "35_01")
    """Clips of the sequences: windows of validation."""

    def run(self) -> None:
        """Print the table. Raises InputError for a sequence that is not there."""
        torch.set_num_threads(1)
        torch.set_grad_enabled(False)
        body = load_body()
        print(f"load {os.getloadavg()[0]:.1f}; mm, swing, correlation, wrinkles, ms")
        for name in self.garments:
            outfit = Outfit(body, (load_garment(name, body),))
            mesh = outfit.garments[0].mesh
            filters = wave_filters(make_surface(mesh.vertices, mesh.faces))
            sequences = [load_simulated(self.data / f"{clip}_{name}.npz") for clip in self.clips]
            for quality in QUALITIES:
                prepared = make_caged_outfit(outfit, PhysicsConfig(quality))
                runs = [rolled_out(prepared, body, mesh, sequence) for sequence in sequences]
                frames = sum(len(sequence.transforms) for sequence in sequences)
                milliseconds = 1000.0 * sum(run.seconds for run in runs) / frames
                for row in runs[0].vertices:
                    parts = [
                        scored(run.vertices[row], sequence, outfit, filters)
                        for run, sequence in zip(runs, sequences, strict=True)
                    ]
                    end = f", {milliseconds:.1f}" if row == "bare" else ""
                    print(f"{name} {quality}, {row}: {summarized(parts)}{end}", flush=True)


@dataclass(frozen=True)
class Run:
    """Vertices (F, N, 3) m of a sequence's frames, by row of the table.

    seconds: of processor time that the bare cage took.
    """

    vertices: Mapping[str, Tensor]
    seconds: float


@dataclass(frozen=True)
class Parts:
    """Scores of a row on one clip. waves, true_waves: (B,) mm2 in each band, of it and of the simulation."""

    error: float
    swinging: dict[str, Tensor]
    waves: Tensor
    true_waves: Tensor


def rolled_out(prepared: CagedOutfit, body: Body, mesh: Mesh, sequence: SimulatedClip) -> Run:
    """Roll a garment's cage out over a sequence; it carries the garment without and with the true detail."""
    (garment,) = prepared.garments
    carried = garment.represented(sequence.transforms, sequence.vertices)
    detail = (sequence.vertices - carried)[:, garment.mesh.kept]
    skins = posed_skin(body, sequence.transforms)
    clearing, cloth = OutfitClearing.of(body, [mesh]), dressed(prepared, sequence.transforms[0])
    memory, bare, detailed, seconds = clearing.start(), [], [], 0.0
    for transforms, skin_now, missing in zip(sequence.transforms, skins, detail, strict=True):
        begun = time.process_time()
        move_on(cloth, transforms, sequence.fps)
        (garment_now,) = shown(cloth, torch.zeros(3))
        seconds += time.process_time() - begun
        bare.append(garment_now)
        (points,) = prepared.followed(transforms, cloth.cages())
        collider = clearing.collider(skin_now)
        memory, (garment_now,) = clearing.clear([points + missing], collider, skin_now, memory, FOLLOWING)
        detailed.append(garment_now)
    rows = {"bare": torch.stack(bare), "true detail": torch.stack(detailed), "carried": carried}
    return Run(rows, seconds)


def scored(vertices: Tensor, sequence: SimulatedClip, outfit: Outfit, filters: WaveFilters) -> Parts:
    """Scores of vertices (F, N, 3) m after the warm-up of a sequence."""
    (garment,), frames = outfit.garments, slice(sequence.warm_up, None)
    mesh, vertices, truth = garment.mesh, vertices[frames], sequence.vertices[frames]
    skinned = skin(mesh.vertices, garment.smooth_weights, sequence.transforms)[frames]
    reference = Reference(truth, (), skinned, mesh.vertices, mesh.faces, sequence.fps, None, None)
    waves, true_waves = (
        wrinkle_scores(filters, each, reference)["wrinkle_mm2"].mean(0) for each in (vertices, truth)
    )
    error = float(distance_scores(vertices, truth)["vertex_mean_mm"].mean())
    return Parts(error, swing_scores(vertices, reference), waves, true_waves)


def summarized(parts: list[Parts]) -> str:
    """Error, swing, correlation and wrinkles over all clips, in one line."""
    error = sum(part.error for part in parts) / len(parts)
    ratio, correlation = swing([part.swinging for part in parts]).values()
    waves, truth = (
        sum(each) for each in zip(*((part.waves, part.true_waves) for part in parts), strict=True)
    )
    wrinkles = " ".join(f"{float(each):.2f}" for each in (waves / truth).sqrt())
    return f"{error:.1f}, {ratio:.2f}, {correlation:.2f}, {wrinkles}"


if __name__ == "__main__":
    sys.exit(run_command("detail.py", lambda: tyro.cli(Detail).run()))
