"""Blend shapes linear in the pose, of a garment that is known: how near a quasi-static method may come.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/quasi_static.py --data DATA [--strength 1000]

For each garment that has sequences of both splits, ridge regression finds the offset from smooth skinning at
rest as a linear function of the standardized pose, from the training's frames. It prints the mean distance in
the validation's frames, mm, for poses of all joints and of those alone that DeePSD's keys see.
"""

from pathlib import Path

import torch
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table
from torch import Tensor

from train.deepsd.dataset import OutfitFrames, read_outfits
from train.deepsd.losses import MILLI, DataLosses
from uvcloth.geometry.skinning import blend_transforms
from uvcloth.methods.deepsd.config import DeePSDConfig
from uvcloth.methods.deepsd.network import LEAST_DEVIATION, DeePSDNetwork, pose

FRAMES = 128
"""Posed at once."""


def offsets(frames: OutfitFrames) -> Tensor:
    """What skinning lacks at rest (F, U, 3), m."""
    found = []
    for transforms, vertices in zip(
        frames.transforms.split(FRAMES), frames.vertices.split(FRAMES), strict=True
    ):
        blended = blend_transforms(frames.graph.smooth, transforms)
        at_rest = torch.linalg.solve(blended[..., :3], (vertices - blended[..., 3])[..., None])[..., 0]
        found.append(at_rest - frames.graph.points)
    return torch.cat(found)


def distance(frames: OutfitFrames, moved: Tensor) -> float:
    """Mean distance, mm, of the outfit with offsets at rest (F, U, 3) from its simulation."""
    errors = []
    for transforms, vertices, own in zip(
        frames.transforms.split(FRAMES), frames.vertices.split(FRAMES), moved.split(FRAMES), strict=True
    ):
        posed = pose(frames.graph.points, own, frames.graph.smooth, transforms)
        errors.append((posed - vertices).norm(dim=-1).mean(1))
    return MILLI * float(torch.cat(errors).mean())


def regressed(
    taught: OutfitFrames, held: OutfitFrames, known: Tensor, seen: Tensor, strength: float
) -> Tensor:
    """Offsets (F, U, 3) in the held poses, by ridge regression on what is seen (J,) of the joints."""
    mean, deviation = taught.vectors.mean(0), taught.vectors.std(0).clamp(min=LEAST_DEVIATION)
    shares = seen.repeat_interleave(3)
    poses, others = ((each.vectors - mean) / deviation * shares for each in (taught, held))
    middle = known.mean(0)
    system = poses.T @ poses + strength * torch.eye(poses.shape[1])
    shapes = torch.linalg.solve(system, poses.T @ (known - middle).flatten(1))
    return middle + (others @ shapes).unflatten(1, middle.shape)


def main(data: Path, strength: float = 1000.0) -> None:
    """Print the distances of every garment. strength: of the ridge, in squared standard deviations."""
    dataset = read_outfits([data], DataLosses().rest_frames)
    net = DeePSDNetwork(DeePSDConfig(), len(dataset.body.skeleton.names))
    held = {frames.name: frames for frames in dataset.held}
    table = Table("garment", "smooth LBS, mm", "mean offset", "all joints", "joints seen")
    for taught in track([each for each in dataset.training if each.name in held], "regressing"):
        other, known = held[taught.name], offsets(taught)
        still = torch.zeros(len(other.vectors), *known.shape[1:])
        seen = net.joint_visibility(taught.graph.joint_areas)
        rows = [
            still,
            still + known.mean(0),
            *(regressed(taught, other, known, each, strength) for each in (torch.ones_like(seen), seen)),
        ]
        table.add_row(taught.name, *(f"{distance(other, row):.1f}" for row in rows))
    Console().print(table)


if __name__ == "__main__":
    tyro.cli(main)
