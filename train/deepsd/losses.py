"""Losses of DeePSD: settings of its two phases, the error against data, and the priors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.files.options import Between
from uvcloth.methods.deepsd.outfit_graph import OutfitGraph
from uvcloth.physics.measures import length_change

from .prediction import PosedOutfit

MILLI = 1000.0
"""Lengths are logged in millimetres, energies in millijoules."""

CENTI = 100.0
"""The prior on deformations counts in centimetres."""


@dataclass(frozen=True)
class DataLosses:
    """Losses against the outfits' data, and the priors of the start (paper sections 4.3 and 9)."""

    poses_per_outfit: Annotated[int, Between(1, 100_000)] = 32
    """Poses per outfit in a step: the drawn frame and random others (paper: 1)."""
    points: Annotated[float, Between(0, 1, above=True)] = 0.33
    """Share of an outfit's points that a step compares, drawn each time (paper: 1)."""
    error: Literal["distance", "squared"] = "distance"
    """Compare points by their distance (the paper's program) or its square (paper, eq. 3)."""
    pose_dropout: Annotated[float, Between(0, 1)] = 0.2
    """Probability that a joint is hidden from the keys of a pose (paper: 0)."""
    edges: Annotated[float, Between(0, 1e9)] = 2.0
    """Weight of the mean change of edge lengths between the compared points (paper: none)."""
    closest_weights: Annotated[float, Between(0, 1e9)] = 0.0
    """Weight of the prior that blend weights are those of the closest skin (paper); useless where they start
    from the smooth ones."""
    small_shapes: Annotated[float, Between(0, 1e9)] = 0.0
    """Weight of the prior that deformations are small (paper), on their mean square in square centimetres."""
    mirror: bool = True
    """Also train on mirror images, as separate outfits (paper: no)."""
    rest_frames: Annotated[int, Between(0, 10**6)] = 15
    """Warm-up frames to leave out of training, in which cloth comes down from the rest shape. Validation
    leaves out the whole warm-up."""

    def __post_init__(self) -> None:
        """Raises InputError for values out of range."""
        if self.poses_per_outfit < 1:
            raise InputError(f"--poses-per-outfit {self.poses_per_outfit}: has to be 1 or more")
        if not 0 < self.points <= 1:
            raise InputError(f"--points {self.points}: has to be more than 0, and 1 at most")
        if not 0 <= self.pose_dropout < 1:
            raise InputError(f"--pose-dropout {self.pose_dropout}: has to be 0 or more, and less than 1")
        if self.rest_frames < 0:
            raise InputError(f"--rest-frames {self.rest_frames}: has to be 0 or more")
        for name in ("edges", "closest_weights", "small_shapes"):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise InputError(f"--{name.replace('_', '-')} {value}: has to be 0 or more")


def prior_share(epochs: float) -> float:
    """Weight of the priors after some epochs: 1 in the first, then a tenth of the last with each."""
    return 10.0 ** min(0.0, 1.0 - epochs)


def data_losses(
    outfits: Sequence[PosedOutfit],
    truths: Sequence[Tensor],
    graphs: Sequence[OutfitGraph],
    rows: Sequence[Tensor],
    losses: DataLosses,
    epochs: float,
) -> dict[str, Tensor]:
    """The parts of the loss of the data phase, each outfit weighing alike.

    truths: (Q, n, 3) m of the points predicted, rows (n,) of each outfit's. Errors are in mm (or mm2).
    """
    share = prior_share(epochs)
    errors, stretches, weights, shapes = [], [], [], []
    for outfit, truth, graph, points in zip(outfits, truths, graphs, rows, strict=True):
        wrong = MILLI * (outfit.posed - truth)
        if losses.error == "distance":
            errors.append(wrong.norm(dim=-1).mean())
        else:
            errors.append(wrong.square().sum(-1).mean())
        if losses.edges:
            stretches.append(MILLI * _edge_change(outfit.posed, graph, points))
        closest = graph.closest[points].to(outfit.weights)
        weights.append((outfit.weights - closest).square().sum(-1).mean())
        deformation = CENTI * sum(outfit.deformation.values(), truth.new_zeros(1, 3))
        shapes.append(deformation.square().sum(-1).mean())
    parts = {"error": torch.stack(errors).mean()}
    if losses.edges:
        parts["edges"] = losses.edges * torch.stack(stretches).mean()
    if losses.closest_weights:
        parts["weights"] = losses.closest_weights * share * torch.stack(weights).mean()
    if losses.small_shapes:
        parts["shapes"] = losses.small_shapes * share * torch.stack(shapes).mean()
    return parts


def _edge_change(posed: Tensor, graph: OutfitGraph, rows: Tensor) -> Tensor:
    """Mean absolute change, metres, of the edges between the points `rows` (n,), posed (Q, n, 3): ()."""
    place = torch.full((len(graph.points),), -1)
    place[rows] = torch.arange(len(rows))
    edges = place[graph.edges]
    edges = edges[(edges >= 0).all(1)]
    change = length_change(posed, graph.points[rows].to(posed), edges.to(posed.device))
    return change.sum() / max(change.numel(), 1)


@dataclass(frozen=True)
class PhysicsLosses:
    """The energies that train the branch chi, in joules of an outfit (paper eq. 4 to 6).

    Stretch, collision and size of the deformation are springs, of the energy k d^2 / 2.
    """

    stretch: Annotated[float, Between(0, 1e9)] = 34.641016
    """N/m, membrane stiffness (paper: 2.3; its program: 34.6)."""
    bend: Annotated[float, Between(0, 1e9)] = 0.0
    """N m, bending rigidity, by the normals of faces (paper: 0; its program: 1.7e-4)."""
    roughness: Annotated[float, Between(0, 1e9)] = 1e-4
    """J, resistance of vertex normals to differ from their neighbours' mean (paper: 5e-4; its program: 0)."""
    collision: Annotated[float, Between(0, 1e9)] = 50.0
    """N/m, against cloth too close to the skin or to an inner garment (paper: 4 to 20; its program: 50)."""
    thickness: Annotated[float, Between(0, 1e9)] = 0.005
    """Distance to keep, in metres."""
    small: Annotated[float, Between(0, 1e9)] = 0.02
    """N/m, on the deformation by chi (paper: 0.02)."""
    layers: bool = True
    """Also resolve collisions between the pieces of an outfit (paper: no)."""
    pose_source: Literal["any", "own"] = "any"
    """Draw poses from all training frames (paper), or from the outfit's frames alone."""
    poses_drawn: Annotated[int, Between(1, 100_000)] = 8
    """Poses per outfit in a step (paper: 1)."""

    def __post_init__(self) -> None:
        """Raises InputError for values out of range."""
        for name in ("stretch", "bend", "roughness", "collision", "thickness", "small"):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise InputError(f"--{name} {value}: has to be 0 or more")
        if self.poses_drawn < 1:
            raise InputError(f"--poses-drawn {self.poses_drawn}: has to be 1 or more")
