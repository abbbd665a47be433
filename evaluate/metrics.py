"""Metrics of a prediction against the simulation: distances, and measures of cloth. Batched over frames.

Shapes: F frames, N vertices, P texels. Positions in metres, results in millimetres (or mm2, radians).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.gather import gather
from uvcloth.geometry.mesh import weld
from uvcloth.physics.layers import wrong_side_percent
from uvcloth.physics.measures import acceleration_jitter, edge_change, fold_angle, fold_cosine
from uvcloth.physics.self_intersection import crossing_edges_percent

MM = 1000.0


@dataclass(frozen=True)
class Reference:
    """A simulated garment over the scored frames.

    vertices: (F, N, 3). rest: (N, 3). faces: (M, 3). fps: frames per second.
    texel_corners: (P, 3) int64 garment vertices that each valid texel of the garment's map sees, and
    texel_barycentrics: (P, 3) their weights (PhysXNet's transference matrix T^BC); None without a map.
    """

    vertices: Tensor
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


def map_mse(predicted: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Mean squared distance in mm2 of the garment's map over its valid texels, (F,) from (F, N, 3).

    An offset map stores, per body texel, the garment point that it sees minus the body point (PhysXNet
    eq. 8); both maps share the body, so their difference is the vertex error baked through the texels'
    corners and barycentrics. Nothing for a garment without a map.
    """
    if reference.texel_corners is None or reference.texel_barycentrics is None:
        return {}
    error = (predicted - reference.vertices) * MM
    texels = gather(error, reference.texel_corners, reference.texel_barycentrics)
    return {"map_mse_mm2": texels.square().sum(-1).mean(-1)}


def shape_scores(vertices: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Every measure of (F, N, 3) that needs no body, per frame: (F,) each, jitter (F - 2,).

    Vertex errors, change of edges, bending, jitter and self-intersection.
    """
    return {
        **distance_scores(vertices, reference.vertices),
        "edge_mm": edge_change(vertices, reference.rest, reference.faces) * MM,
        "bend_cos": fold_cosine(vertices, reference.faces),
        "bend_rad": fold_angle(vertices, reference.faces),
        "jitter": acceleration_jitter(vertices, reference.fps),
        "crossing_edges_percent": crossing_edges_percent(vertices, weld(reference.rest)[reference.faces]),
    }


def layer_scores(garments: Mapping[str, Tensor], faces: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Percent of an outer garment's vertices near an inner one that are on its inner side: (F,) each.

    garments: (F, N, 3) m of each, the innermost first, and faces: (M, 3), by name.
    """
    names = list(garments)
    return {
        wrong_side_key(outer, inner): torch.tensor(
            [
                wrong_side_percent(over[None], under[None], faces[inner])
                for over, under in zip(garments[outer], garments[inner], strict=True)
            ]
        )
        for index, outer in enumerate(names)
        for inner in names[:index]
    }


def wrong_side_key(outer: str, inner: str) -> str:
    """The name of the score of an outer garment over an inner one."""
    return f"wrong_side_percent/{outer}/{inner}"
