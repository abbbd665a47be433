"""A linear space of garment shapes, fitted in closed form."""

import torch
from rich.progress import track
from torch import Tensor

from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.methods.motion_guided.dynamics_input import pose_transforms
from uvcloth.methods.motion_guided.latent import DISPLACEMENT_SCALE, LinearSpace, Space

from .dataset import FRAMES_AT_ONCE, GarmentDataset

ROUNDS = 4
"""Iterations that take a garment back to the rest space."""

RIDGE = 1e-3
"""Of the linear encoder, as a share of the mean square of what it sees."""


def rest_displacements(space: Space, dataset: GarmentDataset, rows: Tensor) -> Tensor:
    """Simulated garments of rows (B,) as displacements in the local frames at rest: (B, 3 N), m.

    Kernels that take a vertex back may depend on where it comes to lie: found by iteration.
    """
    maps, frames = dataset.maps, dataset.training
    resting = maps.points.expand(len(rows), -1, -1)
    for _ in range(ROUNDS):
        blended = pose_transforms(space, maps, resting, frames.pose[rows])
        resting = rotate(torch.linalg.inv(blended[..., :3]), frames.vertices[rows] - blended[..., 3])
    return rotate_back(maps.axes, resting - maps.points).flatten(1)


@torch.no_grad()
def fit_linear(space: LinearSpace, dataset: GarmentDataset) -> None:
    """Fit encoder and decoder in closed form: principal components of the shapes, of unit variance.

    Shapes are the simulated garments taken back to the rest space by the kernels there; the encoder is ridge
    regression from the maps that it sees.
    """
    maps, frames = dataset.maps, dataset.training
    rows = frames.rows.samples
    shapes = torch.cat(
        [
            rest_displacements(space, dataset, part)
            for part in track(rows.split(FRAMES_AT_ONCE), "shapes", transient=True)
        ]
    )
    mean = shapes.mean(0)
    count = min(space.decoder.in_features, len(shapes) - 1)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        codes, scales, components = torch.pca_lowrank(shapes - mean, q=count, center=False)
    size = codes.std(0).clamp(min=1e-9)
    directions = (components * (scales * size)).T
    space.decoder.weight.zero_()
    space.decoder.weight[:, : len(directions)] = directions.T / DISPLACEMENT_SCALE
    space.decoder.bias.copy_(mean / DISPLACEMENT_SCALE)
    features = torch.cat(
        [space.features(maps.map(frames.offsets[part])).flatten(1) for part in rows.split(FRAMES_AT_ONCE)]
    )
    wanted = codes / size
    gram = features @ features.T
    gram.diagonal().add_(RIDGE * gram.diagonal().mean())
    space.code.weight.zero_()
    space.code.bias.zero_()
    space.code.weight[: wanted.shape[1]] = (features.T @ torch.linalg.solve(gram, wanted)).T
