"""RGBench's captures of real garments (AAAI 2026, arXiv 2511.06434), run by this project's cloth solver.

    python -m benchmarks.rgbench RGBENCH --out results.csv [--data DATA] [--garments brown_coat]

RGBENCH is a clone of github.com/hwk0809/RGBench, DATA its captures and meshes (RGBENCH/data/sample, where its
scripts/download_data.py puts them). The mode is fixed_point, which tests a cloth solver alone: two vertices
follow recorded grippers. Per point cloud whose time is in the capture's window it measures the mean distance
from the cloud's points to the nearest vertex in the L1 norm (cd_l1_r2s, by which the paper ranks), the same
from the vertices (cd_l1_s2r), and that in the L2 norm (cd_l2_s2r). Figures are means over clouds, then
samples, then pairs of garment and action. The list has up to eight samples of a pair, the published figures
are of three that nobody names: here all count.

A second of motion takes 20 to 80 s of a core (two-layered sheets of 5,100 and 17,300 vertices). Captures that
are in results.csv are not run again, so it may be stopped; or run it once a garment and join the tables.

`benchmarks/rgbench/env.py` says how fabrics are read, and what the repository leaves open.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
import tyro
from rich.console import Console
from rich.table import Table
from scipy.spatial import KDTree

from benchmarks.rgbench.env import UvclothEnv
from benchmarks.rgbench.files import (
    ARMS,
    METRICS,
    Cell,
    Points,
    cloud_times,
    read_baselines,
    read_camera,
    read_cloud,
    read_results,
    read_runs,
    write_results,
)
from uvcloth.errors import InputError
from uvcloth.process.command import run_command

ACTIONS = ("fling", "fold", "grasp")

ADDRESS = "https://huggingface.co/datasets/hwk0809/RGBench-Cloth-Sim2Real-v1"

LATEST = 0.5
"""Seconds before the last point cloud by which a gripper's path may end."""


def chamfer(points: Points, others: Points, norm: int) -> float:
    """Mean distance, m, from points (P, 3) to the nearest of others (Q, 3), in the L1 or L2 norm."""
    return float(KDTree(others).query(points, p=norm)[0].mean())


class PreparedCapture(NamedTuple):
    """A capture that is ready to be simulated.

    camera: (4, 4) from the camera into the world. clouds: point clouds in its window, with the simulated time
    of each, s, in order.
    """

    env: UvclothEnv
    camera: Points
    clouds: dict[Path, float]


def prepare(run: Mapping[str, Any]) -> PreparedCapture:
    """Read a capture. Raises InputError naming a file that is missing or wrong."""
    env = UvclothEnv(run)
    return PreparedCapture(env, read_camera(run["calibration"]["path"]), clouds_to_measure(run, env))


def clouds_to_measure(run: Mapping[str, Any], env: UvclothEnv) -> dict[Path, float]:
    """Point clouds in a capture's window, with the simulated time of each, s, in order.

    Raises InputError where there are none, and for a gripper's path that ends before them.
    """
    folder, window, grippers = run["data"]["pcd"], run["evaluate"], env.grippers
    first, last = (
        limit(float(window[f"{side}_{kind}_time"]) for kind in ("record", "calculate"))
        for side, limit in (("start", max), ("end", min))
    )
    delay = run["camera"]["system_delay_time"]
    times = {path: time + delay for path, time in cloud_times(folder, grippers.start).items()}
    inside = {path: time for path, time in times.items() if first <= time <= last}
    if not inside:
        raise InputError(f"{folder}: has no point clouds from {first:g} to {last:g} s, the window to measure")
    for arm, path in zip(ARMS, grippers.paths, strict=True):
        end, latest = path.times[-1] - grippers.start, max(inside.values())
        if end < latest - LATEST:
            name = run["data"]["robot_joints"][f"{arm}_arm_csv_path"]
            raise InputError(f"{name}: the path ends after {end:.1f} s, point clouds after {latest:.1f} s")
    return {path: time + grippers.lead for path, time in inside.items()}


def measure(run: Mapping[str, Any]) -> dict[str, float]:
    """Simulate one capture: mean Chamfer distances over its window, m, and the seconds that it took."""
    began = time.perf_counter()
    env, camera, clouds = prepare(run)
    distances = []
    for path, moment in clouds.items():
        env.step_to_time(moment)
        vertices, cloud = env.get_sim_vertices(), trimesh.transform_points(read_cloud(path), camera)
        distances.append(
            (chamfer(cloud, vertices, 1), chamfer(vertices, cloud, 1), chamfer(vertices, cloud, 2))
        )
    return {
        "clouds": len(clouds),
        **dict(zip(METRICS, np.mean(distances, 0).tolist(), strict=True)),
        "grip_distance": env.grippers.grip_distance(),
        "seconds": time.perf_counter() - began,
    }


def means(distances: Mapping[tuple[str, str], float], cells: Sequence[tuple[str, str]]) -> list[str]:
    """Mean distances, mm, over all pairs of garment and action, and those of each action, as text."""
    groups = [cells, *([cell for cell in cells if cell[1] == action] for action in ACTIONS)]
    return [
        f"{1e3 * np.mean([distances[cell] for cell in group]):.1f} ({len(group)})" if group else "-"
        for group in ([cell for cell in group if cell in distances] for group in groups)
    ]


def comparison(
    results: Mapping[Cell, Mapping[str, float]], baselines: Mapping[str, Mapping[tuple[str, str], float]]
) -> Table:
    """Our figures beside the published ones. In parentheses: pairs of garment and action that they are of."""
    table = Table(f"{METRICS[0]}, mm", "all", *ACTIONS)
    samples: dict[tuple[str, str], list[float]] = {}
    for cell, result in results.items():
        samples.setdefault((cell.garment, cell.action), []).append(result[METRICS[0]])
    ours = {cell: float(np.mean(values)) for cell, values in samples.items()}
    table.add_row("uvcloth", *means(ours, list(ours)))
    shared = [cell for cell in ours if all(cell in published for published in baselines.values())]
    if len(shared) < len(ours):
        table.add_row("uvcloth, those published", *means(ours, shared))
    for name, published in baselines.items():
        table.add_row(name, *means(published, shared))
    return table


def main(
    folder: tyro.conf.Positional[Path], out: Path, data: Path | None = None, garments: tuple[str, ...] = ()
) -> None:
    """Run the captures of RGBench in fixed_point mode, beside the published results.

    folder: a clone of RGBench. out: the table of results, which may have some already. data: captures and
    meshes. garments: all if none is named.
    """
    data = data or folder / "data" / "sample"
    runs, baselines = read_runs(folder, data, garments), read_baselines(folder)
    there = {cell: run for cell, run in runs.items() if run["data"]["root"].is_dir()}
    if not there:
        raise InputError(
            f"{data}: has no captures; scripts/download_data.py of RGBench gets them (6.7 GB) from {ADDRESS}"
        )
    results = {cell: result for cell, result in read_results(out).items() if cell in there}
    left = {cell: run for cell, run in there.items() if cell not in results}
    for run in left.values():  # A wrong file is named before hours of simulation.
        prepare(run)
    print(f"{len(there)} of {len(runs)} captures are there, {len(results)} of them in {out}")
    for cell, run in left.items():
        results[cell] = measure(run)
        write_results(out, results)
        print(
            f"{cell.garment} {cell.action} {cell.sample}: {1e3 * results[cell][METRICS[0]]:.1f} mm",
            flush=True,
        )
    Console(width=110).print(comparison(results, baselines))


if __name__ == "__main__":
    sys.exit(run_command("rgbench", lambda: tyro.cli(main)))
