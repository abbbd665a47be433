"""Does simulated cloth converge with its mesh? Free cloth on even meshes of several edge lengths.

Writes a simulation per garment, clip, edge length and member to a folder, and goes on where it stopped.
Prints, per garment and edge length: vertices, substeps and seconds of a frame, distance from the finest mesh
and between two members (which start 0.1 mm apart), and energies of folds over those of the finest mesh.

    python benchmarks/mesh_convergence.py OUT --garments tops dress --motions ../shared/mocap/cmu/11_01.bvh
"""

import argparse
import time
from itertools import product
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from evaluate.folds import band_energies, fold_filters
from uvcloth.bodies.body import Body, load_body
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.motion.library import load_clip
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.surface import closest_points
from uvcloth.rollouts.rollout import rollout
from uvcloth.simulation.tracking import FineGarment, Tracking, track

START_APART = 1e-4
"""Metres, standard deviation of what members differ by at the start."""


def simulate(garment: Garment, body: Body, fine: FineGarment, clip: Path, frames: int, member: int) -> dict:
    """Positions of the refined garment's points on free cloth of a mesh, on its cage, and costs."""
    motion = load_clip(clip, body, MotionOptions(frames=f"0:{frames}"))
    transforms = motion.transforms(torch.float64)
    carried = rollout(Physics(PhysicsConfig()), Outfit(body, (garment,)), transforms, motion.fps)
    coarse = torch.stack([frame.vertices[0] for frame in carried])
    noise = torch.Generator().manual_seed(member)
    coarse = coarse + member * START_APART * torch.randn(coarse.shape[1:], generator=noise)
    began, substeps, places = time.thread_time(), [], []
    free = Tracking(pull=0.0)
    for frame in track(garment, fine, body, coarse, transforms.float(), motion.fps, free):
        places.append(frame.vertices.float())
        substeps.append(frame.substeps)
    seconds = (time.thread_time() - began) / (len(places) + free.settle)
    samples = closest_points(fine.refined.mesh.vertices, fine.rest, fine.faces)
    points = torch.stack([samples.interpolate(vertices, fine.faces) for vertices in places])
    smooth = fine.refined.at(coarse)
    return {
        "points": points.numpy(),
        "smooth": smooth.numpy(),
        "cost": np.array([len(fine.rest), np.mean(substeps), seconds]),
    }


def describe(name: str, folder: Path, garment: Garment, edges: list[float], clips: list[Path]) -> None:
    """Print the table of a garment."""
    mesh = FineGarment.of(garment, 0.05).refined.mesh
    filters = fold_filters(mesh.vertices, mesh.faces)

    def read(clip: Path, edge: float, member: int) -> dict[str, np.ndarray]:
        return dict(np.load(folder / file_name(name, clip, edge, member)))

    def energies(run: dict[str, np.ndarray]) -> Tensor:
        return band_energies(filters, torch.from_numpy(run["points"] - run["smooth"])).mean(0)

    print(f"{name}: edge mm | vertices | substeps | s a frame | mm from finest | of two members | folds")
    for edge in edges:
        costs, far, apart, folds = [], [], [], []
        for clip in clips:
            run, other, finest = read(clip, edge, 0), read(clip, edge, 1), read(clip, edges[-1], 0)
            costs.append(run["cost"])
            far.append(distance(run, finest))
            apart.append(distance(run, other))
            folds.append(energies(run) / energies(finest))
        count, substeps, seconds = np.mean(costs, axis=0)
        ratios = " ".join(f"{float(ratio):.2f}" for ratio in torch.stack(folds).mean(0))
        print(
            f"  {1000 * edge:4.1f} | {count:6.0f} | {substeps:5.0f} | {seconds:.2f} | {np.mean(far):5.1f} | "
            f"{np.mean(apart):5.1f} | {ratios}",
            flush=True,
        )


def distance(run: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> float:
    """Mean distance, mm, over points and frames."""
    return 1000.0 * float(np.linalg.norm(run["points"] - other["points"], axis=2).mean())


def file_name(name: str, clip: Path, edge: float, member: int) -> str:
    return f"{name}_{clip.stem}_{1000 * edge:.1f}_{member}.npz"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--garments", nargs="+", default=["tops", "dress"])
    parser.add_argument("--motions", nargs="+", type=Path, required=True)
    parser.add_argument("--edges", nargs="+", type=float, default=[0.024, 0.017, 0.012, 0.009])
    parser.add_argument("--frames", type=int, default=60)
    given = parser.parse_args()
    torch.set_num_threads(1)
    torch.set_grad_enabled(False)
    given.out.mkdir(parents=True, exist_ok=True)
    body, edges = load_body(), sorted(given.edges, reverse=True)
    for name in given.garments:
        garment = load_garment(name, body)
        for edge in edges:
            fine = None
            for clip, member in product(given.motions, (0, 1)):
                path = given.out / file_name(name, clip, edge, member)
                if path.exists():
                    continue
                fine = fine or FineGarment.of(garment, edge)
                run = simulate(garment, body, fine, clip, given.frames, member)
                np.savez(path, **run)
                print(f"{path.name}: {run['cost'][2]:.2f} s a frame", flush=True)
        describe(name, given.out, garment, edges, given.motions)


if __name__ == "__main__":
    main()
