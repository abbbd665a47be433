"""Seed points on the body or the inner garment, and the Gaussian kernels around them (Motion-guided)."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.gather import gather
from rasterize.texels import rasterize_layout
from uvcloth.bodies.body import REGIONS, Body
from uvcloth.bodies.layout import layout_of
from uvcloth.garments.garment import Garment
from uvcloth.garments.layout import own_layout
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.skinning import skin_frames

PARTS = ("torso", "upper_arm", "forearm", "thigh", "calf")
"""Body parts whose seeds share a kernel radius; other parts count as their parent."""

ATTACHED = {"head": "torso", "hand": "forearm", "foot": "calf"}


@dataclass(frozen=True)
class Seeds:
    """S points on a surface at rest: the body's, or that of the garment worn beneath.

    points, normals: (S, 3), m. weights: (S, J) blend weights. parts: (S,) int64 into PARTS. corners: (S, 3)
    vertices of the surface around each, barycentrics: (S, 3). faces: (M, 3) of the surface.
    """

    points: Tensor
    normals: Tensor
    weights: Tensor
    parts: Tensor
    corners: Tensor
    barycentrics: Tensor
    faces: Tensor


@dataclass(frozen=True)
class PosedSeeds:
    """Seeds b_t of B frames: points, normals (B, S, 3) m, and rotations R_t since rest (B, S, 3, 3)."""

    points: Tensor
    normals: Tensor
    rotations: Tensor

    def __getitem__(self, rows: Tensor | slice) -> "PosedSeeds":
        """Some of the frames."""
        return PosedSeeds(self.points[rows], self.normals[rows], self.rotations[rows])


def sample_seeds(body: Body, count: int, under: Garment | None = None) -> Seeds:
    """Seeds that lie regularly in a UV layout: the texels of a coarse sheet, evenly thinned.

    The layout is the body's, or that of the garment worn beneath (section 6.5).
    """
    mesh, weights, layout = (
        (under.mesh, under.smooth_weights, own_layout(under.mesh))
        if under
        else (body.mesh, body.weights, layout_of(body))
    )
    size = math.isqrt(count)
    while len((sheet := rasterize_layout(layout, size)).face) < count:
        size += 1
    kept = torch.linspace(0, len(sheet.face) - 1, count).round().long()
    corners, barycentrics = mesh.faces[sheet.face[kept]], sheet.barycentrics[kept]
    points, normals, weights = (
        gather(values, corners, barycentrics)
        for values in (mesh.vertices, vertex_normals(mesh.vertices, mesh.faces), weights)
    )
    part_of = torch.tensor([PARTS.index(ATTACHED.get(region, region)) for region in REGIONS])
    centres = body.mesh.vertices[body.mesh.faces].mean(1)
    beneath = torch.cdist(points, centres).argmin(1) if under else sheet.face[kept]
    return Seeds(points, normals, weights, part_of[body.regions[beneath]], corners, barycentrics, mesh.faces)


def pose_seeds(seeds: Seeds, transforms: Tensor) -> PosedSeeds:
    """Carry the seeds by joint transforms (B, J, 3, 4)."""
    points, rotations = skin_frames(seeds.points, seeds.weights, transforms)
    return PosedSeeds(points, (rotations @ seeds.normals[..., None]).squeeze(-1), rotations)


def seeds_on(seeds: Seeds, vertices: Tensor, transforms: Tensor) -> PosedSeeds:
    """The seeds on a moved surface, vertices (B, V, 3) m; their rotations are those of the skinning."""
    _, rotations = skin_frames(seeds.points, seeds.weights, transforms)
    normals = vertex_normals(vertices, seeds.faces)
    points, normals = (gather(values, seeds.corners, seeds.barycentrics) for values in (vertices, normals))
    return PosedSeeds(points, torch.nn.functional.normalize(normals, dim=2), rotations)


@dataclass(frozen=True)
class Kernels:
    """The K seeds that may move each of N points.

    seeds: (N, K) int64. points: (N, 3, K) m. parts: (N, K, parts), one where a seed is of that part.
    """

    seeds: Tensor
    points: Tensor
    parts: Tensor


def nearest_kernels(points: Tensor, seeds: Seeds, count: int) -> Kernels:
    """The seeds nearest to points (N, 3) at rest."""
    near = torch.cdist(points, seeds.points).topk(min(count, len(seeds.points)), largest=False).indices
    parts = torch.nn.functional.one_hot(seeds.parts[near], len(PARTS)).float()
    return Kernels(near, seeds.points[near].transpose(1, 2).contiguous(), parts)


def kernel_transforms(
    points: Tensor, kernels: Kernels, radii: Tensor, seeds: Seeds, posed: PosedSeeds
) -> Tensor:
    """Move points (B, N, 3) in the rest space, m, with the seeds that are near there (eq. 1): (B, N, 3, 4).

    radii: (parts,) of the kernels, m.
    """
    along = (points.transpose(0, 1) @ kernels.points).transpose(0, 1)
    apart = points.square().sum(-1, keepdim=True) - 2.0 * along + kernels.points.square().sum(1)
    # A product, not a lookup: its gradient is summed in the same order every time.
    weights = torch.softmax(-apart * (kernels.parts @ (0.5 / radii.square())), dim=-1)
    moves = posed.points - (posed.rotations @ seeds.points[..., None]).squeeze(-1)
    transforms = torch.cat([posed.rotations, moves[..., None]], dim=3).flatten(2)
    return gather(transforms, kernels.seeds, weights).unflatten(-1, (3, 4))
