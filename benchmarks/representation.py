"""The representation floor: true garment maps, decoded back to the vertices that they were baked from.

No network can be better than this. Run from the checkout with PYTHONPATH=. as

    python benchmarks/representation.py --data DATA [--sizes 128 256]

It prints the mean, the 99th percentile and the largest distance, mm, over the frames of each sequence.
"""

from pathlib import Path

import torch
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table
from torch import Tensor

from rasterize.decode import nearest_sampler
from rasterize.gather import gather
from uvcloth.bodies.body import load_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.geometry.mesh import Mesh, vertex_normals
from uvcloth.methods.physxnet.texels import body_texels, template_texels


def floor(sequence: SimulatedClip, size: int, neighbours: int, stride: int = 5) -> Tensor:
    """Distance between decoded and simulated vertices (frames, N), metres."""
    body = load_body()
    texels = body_texels(body, size)
    empty = torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64)
    (garment,) = sequence.garments
    mesh = Mesh(garment.rest, garment.faces, *empty)
    seen = template_texels(garment.name, mesh, body, texels)
    points = torch.full_like(texels.points, torch.nan)
    normals = points.clone()
    points[seen.texels], normals[seen.texels] = seen.points, seen.normals
    facing = (normals, vertex_normals(garment.rest, garment.faces))
    sampler = nearest_sampler(points, texels.sheet, garment.rest, k=neighbours, normals=facing)
    samples = torch.searchsorted(seen.pixels, sampler.pixels)
    residual = garment.rest - gather(seen.gather(garment.rest), samples, sampler.weights)
    frames = sequence.vertices[sequence.warm_up :: stride]
    decoded = gather(seen.gather(frames), samples, sampler.weights) + residual
    return (decoded - frames).norm(dim=-1)


def main(data: Path, sizes: tuple[int, ...] = (128, 256), neighbours: int = 10) -> None:
    """Print the representation floor of every sequence in a folder."""
    table = Table("sequence", "size", "mean mm", "99 % mm", "max mm")
    for path in track(sorted(data.glob("*.npz")), "decoding true maps"):
        sequence = load_simulated(path)
        for size in sizes:
            error = floor(sequence, size, neighbours).flatten() * 1e3
            high = error.kthvalue(int(0.99 * len(error))).values
            table.add_row(path.stem, str(size), f"{error.mean():.2f}", f"{high:.2f}", f"{error.max():.1f}")
    Console().print(table)


if __name__ == "__main__":
    tyro.cli(main)
