"""A waving body in a cut-open outfit: two garments with texture seams, and the transforms that move them."""

import math

import pytest
import torch

from uvcloth.bodies.body import Body, load_body
from uvcloth.export.animation import Animation
from uvcloth.mesh import Mesh
from uvcloth.skeleton import joint_transforms
from uvcloth.skinning import skin

FRAMES = 40


def _patch(body: Body, low: float, high: float) -> tuple[Mesh, torch.Tensor]:
    mesh = body.mesh
    height = mesh.vertices[:, 2]
    kept = ((height[mesh.faces] > low) & (height[mesh.faces] < high)).all(1)
    used, faces = mesh.faces[kept].unique(return_inverse=True)
    used_uvs, face_uvs = mesh.face_uvs[kept].unique(return_inverse=True)
    return Mesh(mesh.vertices[used] * 1.02, faces, mesh.uvs[used_uvs], face_uvs), body.weights[used]


@pytest.fixture(scope="session")
def body() -> Body:
    return load_body()


@pytest.fixture(scope="session")
def animation(body: Body) -> Animation:
    joints = len(body.skeleton.names)
    time = torch.linspace(0, 2 * math.pi, FRAMES)
    angles = 0.5 * torch.sin(time[:, None] + torch.arange(joints) * 0.7)
    axes = torch.nn.functional.normalize(
        torch.randn(joints, 3, generator=torch.Generator().manual_seed(1)), dim=1
    )
    skew = torch.zeros(joints, 3, 3)
    for row, column, axis, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        skew[:, row, column] = sign * axes[:, axis]
        skew[:, column, row] = -sign * axes[:, axis]
    rotations = torch.linalg.matrix_exp(angles[..., None, None] * skew)
    path = torch.stack([0.3 * time, -0.5 * time, 0.9 + 0 * time], dim=1)
    transforms = joint_transforms(body.skeleton, rotations, path)
    patches = [_patch(body, 0.9, 1.4), _patch(body, 0.4, 0.9)]
    return Animation(
        names=("shirt", "trousers"),
        meshes=tuple(mesh for mesh, _ in patches),
        vertices=tuple(skin(mesh.vertices, weights, transforms).numpy() for mesh, weights in patches),
        body=body,
        transforms=transforms.numpy(),
        fps=30.0,
    )
