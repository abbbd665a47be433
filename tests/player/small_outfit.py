"""The smallest outfit with all that a baked one may have: runtime/tests/test_outfit.cpp makes mutants of it.

Three balls are trunk and thighs, open where they are cut; two tubes of cloth with wrinkles hang around them,
one over the other. `python -m tests.player.small_outfit OUTFIT MOTION` writes both as plain bytes.
"""

import sys
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from torch import Tensor

from tests.wrinkles.small_network import made_up_wrinkles
from uvcloth.bodies.body import REGIONS, Body
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh, join_meshes
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.methods.physics.bake import STEPS
from uvcloth.methods.physics.outfit import PhysicsConfig, _caged_sections
from uvcloth.player.sections import pack
from uvcloth.wrinkles.bake import wrinkle_sections, wrinkle_steps
from uvcloth.wrinkles.network import WrinkleConfig
from uvcloth.wrinkles.sheet import Sheet

TRUNK, LEFT, RIGHT = (0.0, 0.0, 0.62), (0.095, 0.0, 0.3), (-0.095, 0.0, 0.3)
"""Middles of the balls, m."""

ROWS, AROUND = 7, 12
"""Rings of vertices of a tube, and vertices around each."""

COARSE = 0.12
"""Edge length of the cages, m."""

FEW = 25
"""One of so many covered points is kept: thousands would be most of the file."""


def small_body() -> Body:
    """Three balls on four joints; the uppermost fifth of each thigh belongs to the trunk."""
    balls = [
        _ball(TRUNK, (0.14, 0.1, 0.17)),
        _ball(LEFT, (0.09, 0.09, 0.25)),
        _ball(RIGHT, (0.09, 0.09, 0.25)),
    ]
    joined = join_meshes(balls)
    vertices, faces = joined.vertices, joined.faces
    owner = torch.arange(3).repeat_interleave(len(balls[0][1]))
    is_thigh = (owner > 0) & (vertices[faces][..., 2].mean(1) < 0.4)
    weights = torch.zeros(len(vertices), 4)
    ball = torch.arange(3).repeat_interleave(len(balls[0][0]))
    lower = ((0.6 - vertices[:, 2]) / 0.3).clamp(0.0, 1.0) * (ball > 0)
    weights[:, 0] = 1.0 - lower
    weights[torch.arange(len(vertices)), torch.where(ball > 0, ball, 1)] += lower
    heads = torch.tensor([TRUNK, (0.095, 0.0, 0.5), (-0.095, 0.0, 0.5), (0.14, 0.0, 0.75)])
    random = torch.Generator().manual_seed(0)
    return Body(
        name="balls",
        mesh=Mesh(vertices, faces, vertices[:, :2], faces),
        skeleton=Skeleton(("Hips", "LeftUpLeg", "RightUpLeg", "LeftArm"), (-1, 0, 0, 0), heads),
        weights=weights,
        regions=torch.where(is_thigh, REGIONS.index("thigh"), REGIONS.index("torso")),
        sides=torch.where(is_thigh, torch.tensor([0, 1, -1])[owner], 0),
        proxies={},
        pose_shapes=0.002 * torch.randn(27, len(vertices), 3, generator=random).round(decimals=1),
    )


def small_outfit() -> bytes:
    """The outfit, rounded as in a file, in which its body has pose shapes too."""
    body = small_body()
    garments = tuple(_tube(name, body, wider) for name, wider in (("slip", 0.0), ("skirt", 0.015)))
    with patch.dict(QUALITIES, coarse=COARSE):
        _, sections = _caged_sections(Outfit(body, garments), PhysicsConfig("coarse"), rounded=True)
    covered = {name: array[::FEW] for name, array in sections.items() if name.startswith("covered.")}
    return pack(sections | covered | _wrinkles(garments), STEPS | wrinkle_steps(len(garments)))


def small_motion(frames: int = 6) -> NDArray[np.float64]:
    """Transforms (F, 4, 3, 4) from rest: all rises, and the left thigh is pressed into the right one."""
    motion = np.tile(np.eye(3, 4), (frames, 4, 1, 1))
    for frame, angle in enumerate(np.linspace(0.0, 0.3, frames)):
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        head = np.array([0.095, 0.0, 0.5])
        motion[frame, 1, :, :3] = turn
        motion[frame, 1, :, 3] = head - turn @ head
        motion[frame, :, 2, 3] += 0.01 * frame
    return motion


def _wrinkles(garments: tuple[Garment, ...]) -> dict[str, NDArray[Any]]:
    """The wrinkles of a network of 8 x 8 texels on three levels."""
    made = made_up_wrinkles(WrinkleConfig(size=16, width=2, levels=3))
    sheets = [Sheet.of(garment, made.config.size) for garment in garments]
    free = [torch.linspace(0.0, 1.0, len(sheet.mesh.points)) for sheet in sheets]
    return wrinkle_sections(made.config, made.net, sheets, range(len(sheets)), free)


def _ball(middle: tuple[float, float, float], radii: tuple[float, float, float]) -> tuple[Tensor, Tensor]:
    ball = trimesh.creation.icosphere(subdivisions=1)
    return torch.from_numpy(ball.vertices * radii + middle).float(), torch.from_numpy(ball.faces).long()


def _tube(name: str, body: Body, wider: float) -> Garment:
    """A tube around trunk and thighs, wider by some metres, open at both ends."""
    angles = torch.arange(AROUND) * (2 * torch.pi / AROUND)
    heights = torch.linspace(0.72, 0.2, ROWS)
    around = torch.stack([0.2 * angles.cos(), 0.12 * angles.sin()], 1) * (1.0 + wider / 0.12)
    vertices = torch.cat([around.repeat(ROWS, 1), heights.repeat_interleave(AROUND)[:, None]], 1)
    row, column = (
        index.flatten()
        for index in torch.meshgrid(torch.arange(ROWS - 1), torch.arange(AROUND), indexing="ij")
    )
    a, b = AROUND * row + column, AROUND * row + (column + 1) % AROUND
    faces = torch.cat([torch.stack([a, a + AROUND, b], 1), torch.stack([b, a + AROUND, b + AROUND], 1)])
    lower = ((0.5 - vertices[:, 2]) / 0.3).clamp(0.0, 1.0)
    left = (0.5 + vertices[:, 0] / 0.3).clamp(0.0, 1.0)
    weights = torch.stack([1.0 - lower, lower * left, lower * (1.0 - left), torch.zeros_like(left)], 1)
    # The tube is cut open along a line, where the last column of the texture meets the first.
    columns = torch.cartesian_prod(
        torch.arange(float(ROWS)) / ROWS, torch.arange(AROUND + 1.0) / (AROUND + 1)
    )
    cut = torch.where(
        (column == AROUND - 1).repeat(2)[:, None] & (faces % AROUND == 0), AROUND, faces % AROUND
    )
    face_uvs = (AROUND + 1) * (faces // AROUND) + cut
    return Garment(name, None, Mesh(vertices, faces, columns, face_uvs), weights, weights)


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(small_outfit())
    small_motion().tofile(sys.argv[2])
