"""Metrics of a prediction against the simulation: distances, and measures of cloth. Batched over frames.

Shapes: F frames, N vertices, P texels. Positions in metres, results in millimetres (or mm2, radians).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import torch
from torch import Tensor

from rasterize.gather import gather
from uvcloth.geometry.mesh import weld
from uvcloth.physics.layers import wrong_side_counts
from uvcloth.physics.measures import acceleration_jitter, edge_change, fold_angle, fold_cosine
from uvcloth.physics.self_intersection import crossing_edges_percent

MM = 1000.0

SWINGING = 10
"""Swing is measured on one vertex in so many, those that move most against the skinned garment."""

SAMPLED_FRAMES = 30
"""Most frames of a window in which slow measures are taken, evenly spaced."""


def sampled_frames(count: int, most: int = SAMPLED_FRAMES) -> Tensor:
    """At most so many of `count` frames, evenly spaced: (S,) int64."""
    return torch.linspace(0, count - 1, min(most, count)).round().long()


@dataclass(frozen=True)
class Reference:
    """A simulated garment over the scored frames.

    vertices: (F, N, 3). members: the same of the other members of its ensemble, if there are any. skinned:
    (F, N, 3) the smoothly skinned garment. rest: (N, 3). faces: (M, 3). fps: frames per second.
    texel_corners: (P, 3) int64 garment vertices that each valid texel of the garment's map sees, and
    texel_barycentrics: (P, 3) their weights (PhysXNet's transference matrix T^BC); None without a map.
    """

    vertices: Tensor
    members: tuple[Tensor, ...]
    skinned: Tensor
    rest: Tensor
    faces: Tensor
    fps: float
    texel_corners: Tensor | None
    texel_barycentrics: Tensor | None


def distance_scores(predicted: Tensor, truth: Tensor) -> dict[str, Tensor]:
    """Vertex errors of (F, N, 3) against (F, N, 3), each (F,).

    vertex_mean_mm: mean Euclidean distance. vertex_mse_mm2: mean squared Euclidean distance.
    """
    squared = ((predicted - truth) * MM).square().sum(-1)
    return {"vertex_mean_mm": squared.sqrt().mean(-1), "vertex_mse_mm2": squared.mean(-1)}


def ensemble_scores(vertices: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Mean distances of (F, N, 3) from the members of an ensemble of simulations, (F,) each, mm.

    ensemble_mm: the mean over all members. nearest_member_mm: from the closest one of all frames. Nothing
    without an ensemble.
    """
    if not reference.members:
        return {}
    members = (reference.vertices, *reference.members)
    distances = torch.stack([distance_scores(vertices, member)["vertex_mean_mm"] for member in members])
    return {
        "ensemble_mm": distances.mean(0),
        "nearest_member_mm": distances[distances.mean(1).argmin()],
    }


def spread_scores(reference: Reference) -> dict[str, Tensor]:
    """Distances of an ensemble's members from each other, the mean over all pairs, as `distance_scores` has
    them: spread_vertex_mean_mm and spread_vertex_mse_mm2. Nothing without an ensemble.
    """
    if not reference.members:
        return {}
    pairs = combinations((reference.vertices, *reference.members), 2)
    apart = [distance_scores(*pair) for pair in pairs]
    return {f"spread_{key}": torch.stack([each[key] for each in apart]).mean(0) for key in apart[0]}


def energy_scores(rollouts: Sequence[Tensor], reference: Reference) -> dict[str, Tensor]:
    """Energy score of several rollouts of a method, (F, N, 3) each: energy_score_mm (F,).

    Their mean distance from the simulations minus half of their mean distance from each other (Gneiting and
    Raftery 2007, equation 22; the mean is over different rollouts, Ferro 2014): least for rollouts that are
    spread as the simulations are, and then half the distance between those. Nothing for one rollout.
    """
    if len(rollouts) < 2:
        return {}
    truths = (reference.vertices, *reference.members)
    far = [distance_scores(*pair)["vertex_mean_mm"] for pair in product(rollouts, truths)]
    apart = [distance_scores(*pair)["vertex_mean_mm"] for pair in combinations(rollouts, 2)]
    return {"energy_score_mm": torch.stack(far).mean(0) - 0.5 * torch.stack(apart).mean(0)}


def swing_velocities(vertices: Tensor, reference: Reference) -> tuple[Tensor, Tensor]:
    """Velocities relative to the skinned garment of (F, N, 3) and of the simulation, mm per frame.

    (F - 1, n, 3) each, of the tenth of the vertices that moves most in the simulation.
    """
    steps, truth = ((each - reference.skinned).diff(dim=0) * MM for each in (vertices, reference.vertices))
    free = truth.norm(dim=2).sum(0).topk(max(1, truth.shape[1] // SWINGING)).indices
    return steps[:, free], truth[:, free]


def swing_scores(vertices: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Sums from which the swing of (F, N, 3) follows, between neighbouring frames, (F - 1,) each.

    Of the velocities of `swing_velocities`. swing_speed, true_swing_speed: mean speed of the prediction and
    of the simulation, mm per frame. swing_product, swing_square, true_swing_square: sums of the products and
    squares of velocities.
    """
    steps, truth = swing_velocities(vertices, reference)
    return {
        "swing_speed": steps.norm(dim=2).mean(1),
        "true_swing_speed": truth.norm(dim=2).mean(1),
        "swing_product": (steps * truth).sum(dim=(1, 2)),
        "swing_square": steps.square().sum(dim=(1, 2)),
        "true_swing_square": truth.square().sum(dim=(1, 2)),
    }


def peak_accelerations(vertices: Tensor, reference: Reference) -> Tensor:
    """Largest acceleration of (F, N, 3) relative to the skinned garment in each frame, m/s2: (F - 2,).

    The 99.9th percentile over the vertices: a single one that jumps is not seen.
    """
    sizes = (vertices - reference.skinned).diff(n=2, dim=0).norm(dim=2) * reference.fps**2
    return sizes.kthvalue(math.ceil(0.999 * sizes.shape[1]), dim=1).values


def map_mse(predicted: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Mean squared distance in mm2 of the garment's map over its valid texels, (S,) from (F, N, 3).

    An offset map stores, per body texel, the garment point that it sees minus the body point (PhysXNet
    eq. 8); both maps share the body, so their difference is the vertex error baked through the texels'
    corners and barycentrics. Nothing for a garment without a map.
    """
    if reference.texel_corners is None or reference.texel_barycentrics is None:
        return {}
    some = sampled_frames(len(predicted))
    error = (predicted[some] - reference.vertices[some]) * MM
    texels = gather(error, reference.texel_corners, reference.texel_barycentrics)
    return {"map_mse_mm2": texels.square().sum(-1).mean(-1)}


def shape_scores(vertices: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Every measure of (F, N, 3) that needs no body.

    Per frame: vertex errors (F,), swing (F - 1,), jitter (F - 2,). In the `sampled_frames`: change of edges,
    bending, self-intersection (S,).
    """
    some = vertices[sampled_frames(len(vertices))]
    return {
        **distance_scores(vertices, reference.vertices),
        **ensemble_scores(vertices, reference),
        **swing_scores(vertices, reference),
        "edge_mm": edge_change(some, reference.rest, reference.faces) * MM,
        "bend_cos": fold_cosine(some, reference.faces),
        "bend_rad": fold_angle(some, reference.faces),
        "jitter": acceleration_jitter(vertices, reference.fps),
        "crossing_edges_percent": crossing_edges_percent(some, weld(reference.rest)[reference.faces]),
    }


def layer_scores(garments: Mapping[str, Tensor], faces: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Percent of an outer garment's vertices near an inner one that are on its inner side: (S,) each.

    garments: (F, N, 3) m of each, the innermost first, and faces: (M, 3), by name.
    """
    names = list(garments)
    garments = {name: each[sampled_frames(len(each))] for name, each in garments.items()}
    counts = {
        wrong_side_key(outer, inner): wrong_side_counts(garments[outer], garments[inner], faces[inner])
        for index, outer in enumerate(names)
        for inner in names[:index]
    }
    return {key: 100.0 * each[:, 0] / each[:, 1].clamp(min=1) for key, each in counts.items()}


def wrong_side_key(outer: str, inner: str) -> str:
    """The name of the score of an outer garment over an inner one."""
    return f"wrong_side_percent/{outer}/{inner}"
