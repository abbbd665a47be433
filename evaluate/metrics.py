"""How far a prediction is from the simulation, and whether it moves like cloth. Batched over frames.

Shapes: F frames, N vertices, P texels. Positions in metres, results in millimetres (or mm2, radians).
"""

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from uvcloth.mesh import face_normals, face_pairs, unique_edges

MM = 1000.0


@dataclass(frozen=True)
class Reference:
    """A simulated garment over the frames that count.

    vertices: (F, N, 3). rest: (N, 3). faces: (M, 3). fps: frames per second.
    texel_corners: (P, 3) int64 garment vertices that each valid texel of the garment's map sees, and
    texel_barycentrics: (P, 3) their weights (PhysXNet's transference matrix T^BC).
    """

    vertices: Tensor
    rest: Tensor
    faces: Tensor
    fps: float
    texel_corners: Tensor
    texel_barycentrics: Tensor

    @cached_property
    def edges(self) -> Tensor:
        return unique_edges(self.faces)

    @cached_property
    def hinges(self) -> Tensor:
        return face_pairs(self.faces)


def distance_scores(predicted: Tensor, truth: Tensor) -> dict[str, Tensor]:
    """Vertex errors of (F, N, 3) against (F, N, 3), each (F,).

    vertex_mean_mm: mean Euclidean distance. vertex_mse_mm2: mean squared Euclidean distance.
    """
    squared = ((predicted - truth) * MM).square().sum(-1)
    return {"vertex_mean_mm": squared.sqrt().mean(-1), "vertex_mse_mm2": squared.mean(-1)}


def map_mse(predicted: Tensor, truth: Tensor, corners: Tensor, barycentrics: Tensor) -> Tensor:
    """Mean squared distance in mm2 of the garment's map over its valid texels, (F,) from (F, N, 3).

    An offset map stores, per body texel, the garment point that it sees minus the body point (PhysXNet
    eq. 8); both maps share the body, so their difference is the vertex error baked through the texels'
    corners and barycentrics (P, 3).
    """
    error = (predicted - truth) * MM
    seen = torch.einsum("fpcx,pc->fpx", error[:, corners], barycentrics.to(error))
    return seen.square().sum(-1).mean(-1)


def edge_change(vertices: Tensor, rest: Tensor, edges: Tensor) -> Tensor:
    """Mean absolute change of edge length against rest in mm, (F,) from (F, N, 3), (N, 3) and (E, 2)."""

    def lengths(points: Tensor) -> Tensor:
        return (points[..., edges[:, 0], :] - points[..., edges[:, 1], :]).norm(dim=-1)

    return (lengths(vertices) - lengths(rest)).abs().mean(-1) * MM


def bend_angle(vertices: Tensor, faces: Tensor, hinges: Tensor) -> Tensor:
    """Mean angle in radians between the normals of neighbouring faces, (F,) from (F, N, 3) and (H, 2)."""
    normals = face_normals(vertices, faces)
    one, other = normals[..., hinges[:, 0], :], normals[..., hinges[:, 1], :]
    sine = torch.linalg.cross(one, other).norm(dim=-1)
    return torch.atan2(sine, (one * other).sum(-1)).mean(-1)


def jitter(vertices: Tensor, fps: float) -> Tensor:
    """Mean length of the change of acceleration from frame to frame in m/s2, (F - 3,) from (F, N, 3)."""
    acceleration = torch.diff(vertices.double(), n=2, dim=0) * fps**2
    return torch.diff(acceleration, dim=0).norm(dim=-1).mean(-1).float()


def frame_scores(raw: Tensor, resolved: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Every measure that needs no body, per frame: (F,) each, jitter (F - 3,).

    raw: (F, N, 3) as predicted, for the map. resolved: (F, N, 3) after contact, for everything else.
    """
    return {
        "map_mse_mm2": map_mse(
            raw, reference.vertices, reference.texel_corners, reference.texel_barycentrics
        ),
        **distance_scores(resolved, reference.vertices),
        "edge_mm": edge_change(resolved, reference.rest, reference.edges),
        "bend_rad": bend_angle(resolved, reference.faces, reference.hinges),
        "jitter": jitter(resolved, reference.fps),
    }
