"""How a training step of PBNS spends its time, side by side with two other ways to find the closest points.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/pbns_step.py --poses poses.npz [--garment tops] [--epochs 1 6 12]

Trains as usual and prints, after so many passes over the poses: milliseconds of a step, the shares of it in
which the body is skinned and in which its trees are refitted and asked, and how long the same questions take
without the cache, and as the brute-force distance to every vertex of the body, in
units of ours.
"""

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import torch
import tyro
from rich.progress import Progress
from torch import Tensor

from train.loop import rows_of_step, set_rates
from train.pbns.energy import PROGRAM_FABRIC, EnergyConfig
from train.pbns.objective import AttachmentConfig, PBNSObjective
from train.pbns.poses import poses_for
from train.pbns.run import LOOPS
from uvcloth.bodies.body import load_body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.skinning import skin
from uvcloth.methods.pbns.network import PBNSConfig
from uvcloth.process.command import run_command

MEASURED = 20
"""Steps that are averaged."""


def main(
    poses: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NPZ|DIR ...")] = (),
    garment: tuple[str, ...] = ("tops",),
    epochs: tuple[int, ...] = (1, 6, 12),
) -> None:
    """Train, and time single steps on the way."""
    body = load_body()
    outfit = Outfit(body, tuple(load_garment(name, body) for name in garment))
    config = LOOPS["default"]
    with TemporaryDirectory() as folder:
        database = poses_for(poses, body, Path(folder))
    objective = PBNSObjective(
        PBNSConfig(), PROGRAM_FABRIC, EnergyConfig(), AttachmentConfig(), outfit, database, config.batch
    )
    net: Any = objective.networks()["net"]
    optimizer = torch.optim.AdamW(net.parameters(), lr=config.learning_rate, weight_decay=0.0, fused=True)
    spent: dict[str, float] = {}
    nearby: Any = objective.energy.body
    nearby.move = _timed(nearby.move, "move", spent)
    nearby._meshes.update = _timed(nearby._meshes.update, "refit", spent)
    nearby.planes = _timed(nearby.planes, "planes", spent)

    def step(number: int) -> Tensor:
        rows = rows_of_step(objective.samples, config, number)
        for _, loss, _ in objective.steps({"net": net}, rows):
            set_rates({"net": optimizer}, config, number / config.steps)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        return rows

    each = len(objective.samples) // config.batch
    print("| passes | step ms | body skinned | trees refitted and asked | without the cache | brute force |")
    print("|---:|---:|---:|---:|---:|---:|")
    done = 0
    with Progress(transient=True) as bar:
        task = bar.add_task("training", total=max(epochs) * each)
        for epoch in epochs:
            while done < epoch * each:
                step(done)
                done += 1
                bar.update(task, completed=done)
            spent.clear()
            begun = time.perf_counter()
            for _ in range(MEASURED):
                rows = step(done)
                done += 1
            whole, asked = time.perf_counter() - begun, spent["planes"] / MEASURED
            skinned = (spent["move"] - spent["refit"]) / whole
            share = (spent["refit"] + spent["planes"]) / whole
            with torch.no_grad():
                _, posed = objective.pose(net, objective.poses, rows)
            bodies = skin(body.mesh.vertices, body.weights, objective.poses.transforms[rows])
            anew = _seconds(partial(nearby.planes, posed, 0.005, None, "surface"))
            brute = _seconds(partial(_nearest, posed, bodies))
            print(
                f"| {epoch} | {1000 * whole / MEASURED:.0f} | {100 * skinned:.0f} % | {100 * share:.0f} % "
                f"| {anew / asked:.1f} | {brute / asked:.0f} |"
            )


def _nearest(points: Tensor, vertices: Tensor) -> list[Tensor]:
    """The closest of all vertices (B, V, 3) to each of (B, N, 3), as the published program searches."""
    return [torch.cdist(some, others).argmin(1) for some, others in zip(points, vertices, strict=True)]


def _seconds(run: Callable[[], object]) -> float:
    begun = time.perf_counter()
    run()
    return time.perf_counter() - begun


def _timed(run: Callable[..., Any], name: str, spent: dict[str, float]) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        begun = time.perf_counter()
        found = run(*arguments)
        spent[name] = spent.get(name, 0.0) + time.perf_counter() - begun
        return found

    return timed


if __name__ == "__main__":
    sys.exit(run_command("pbns_step", lambda: tyro.cli(main)))
