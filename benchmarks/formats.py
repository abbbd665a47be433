"""Ten thousand frames in every format: memory that does not grow, time and size.

    OMP_NUM_THREADS=1 PYTHONPATH=. python benchmarks/formats.py [--frames 10000] [--only .abc .usdc]

A garment of 400 vertices that turns, with a piece of the body; each format in a process of its own.
Memory is what is not shared with files (Linux): the most while frames are added, in the second tenth of them
and in the last one, and the most while the file is finished. Pictures are coarse.
"""

import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import tyro
from rich.console import Console
from rich.table import Table

from benchmarks.long import anonymous_memory
from uvcloth.bodies.body import Body, load_body
from uvcloth.export.writer import PICTURES, WRITERS, open_writer
from uvcloth.geometry.mesh import Mesh

BATCH = 20
FPS = 30.0


def sheet(side: int = 20) -> Mesh:
    """A square of side x side vertices, 1 m wide."""
    row, column = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    points = np.stack([column, row, 0 * row], axis=-1).reshape(-1, 3) / (side - 1)
    corner = (row * side + column)[:-1, :-1].reshape(-1, 1)
    halves = [corner + np.array(half) for half in ((0, 1, side + 1), (0, side + 1, side))]
    faces = torch.from_numpy(np.concatenate(halves))
    vertices = torch.from_numpy(points.astype(np.float32))
    return Mesh(vertices, faces, vertices[:, :2], faces)


def part_of_body(faces: int = 500) -> Body:
    """Some faces of the body, on all of its joints."""
    body = load_body()
    used, local = body.mesh.faces[:faces].unique(return_inverse=True)
    mesh = Mesh(body.mesh.vertices[used], local, body.mesh.uvs, body.mesh.face_uvs[:faces])
    return replace(
        body,
        mesh=mesh,
        weights=body.weights[used],
        regions=body.regions[:faces],
        sides=body.sides[:faces],
        proxies={},
        base=None,
    )


def measure(suffix: str, frames: int) -> str:
    """Write so many frames: CPU ms per frame, MB of the files, MB of memory early, late and at the end."""
    body, mesh = part_of_body(), sheet()
    rest = torch.eye(3, 4).expand(frames, len(body.skeleton.names), 3, 4)
    memory, begun = [], time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"walk{suffix}"
        with open_writer(path, [("sheet", mesh)], body, FPS, rest, coarse=True) as writer:
            for start in range(0, frames, BATCH):
                angle = torch.arange(start, start + BATCH)[:, None] / 50
                x, y, _ = mesh.vertices.T
                turned = torch.stack([angle.cos() * x, angle.sin() * x, y.expand(BATCH, -1)], dim=2)
                writer.add([turned], rest[start : start + BATCH])
                memory.append(anonymous_memory())
            most, finished = [0.0], threading.Event()

            def watch() -> None:
                while not finished.wait(0.05):
                    most[0] = max(most[0], anonymous_memory())

            watcher = threading.Thread(target=watch)
            watcher.start()
            writer.finish()
            finished.set()
            watcher.join()
        size = sum(each.stat().st_size for each in Path(folder).iterdir())
    tenth = len(memory) // 10
    spent = 1000 * (time.process_time() - begun) / frames
    early, late = max(memory[tenth : 2 * tenth]), max(memory[-tenth:])
    return f"{spent:.1f} {size / 1e6:.0f} {early:.0f} {late:.0f} {most[0]:.0f}"


def main(frames: int = 10_000, only: tuple[str, ...] = (*WRITERS, *PICTURES), one: bool = False) -> None:
    """one: measure here and print the numbers alone."""
    if one:
        print(measure(only[0], frames))
        return
    table = Table("format", "CPU ms per frame", "MB written", "MB early", "MB late", "MB finishing")
    for suffix in only:
        words = [sys.executable, __file__, "--one", "--frames", str(frames), "--only", suffix]
        said = subprocess.run(words, check=True, capture_output=True, text=True).stdout
        print(suffix, said, end="", flush=True)
        table.add_row(suffix, *said.split())
    Console().print(table)


if __name__ == "__main__":
    tyro.cli(main)
