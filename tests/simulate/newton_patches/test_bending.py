"""Bending over an edge: the force is that of the energy."""

import torch
import warp as wp
from torch import Tensor

from rasterize.warp_start import start_warp
from uvcloth.simulate.newton_patches.bending import bending_force_hessian

STIFFNESS = 2.0


@wp.kernel(enable_backward=False)
def evaluate(  # type: ignore[no-untyped-def]
    pos: wp.array[wp.vec3],  # type: ignore[valid-type]
    edges: wp.array2d[wp.int32],  # type: ignore[valid-type]
    angles: wp.array[float],  # type: ignore[valid-type]
    lengths: wp.array[float],  # type: ignore[valid-type]
    forces: wp.array[wp.vec3],  # type: ignore[valid-type]
    hessians: wp.array[wp.mat33],  # type: ignore[valid-type]
):
    edge = wp.tid()
    for corner in range(4):
        force, hessian = bending_force_hessian(
            edge, corner, pos, pos, edges, angles, lengths, STIFFNESS, 0.0, 0.01
        )
        forces[4 * edge + corner] = force
        hessians[4 * edge + corner] = hessian


def run(points: Tensor, edges: Tensor, angles: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    start_warp()
    forces = torch.zeros(4 * len(edges), 3)
    hessians = torch.zeros(4 * len(edges), 3, 3)
    inputs = [
        wp.from_torch(points.float().contiguous(), dtype=wp.vec3),
        wp.from_torch(edges.int()),
        wp.from_torch(angles.float()),
        wp.from_torch(lengths.float()),
        wp.from_torch(forces, dtype=wp.vec3),
        wp.from_torch(hessians, dtype=wp.mat33),
    ]
    wp.launch(evaluate, dim=len(edges), inputs=inputs, device="cpu")
    return forces, hessians


def angles_of(points: Tensor) -> Tensor:
    """Angles over the edges between corners 2 and 3 of (E, 4, 3), positive where the faces fold to a side."""
    tip_0, tip_1, start, end = points.unbind(1)
    along = torch.nn.functional.normalize(end - start, dim=1)
    normals = (torch.linalg.cross(start - tip_0, end - tip_0), torch.linalg.cross(end - tip_1, start - tip_1))
    sine = (torch.linalg.cross(*normals) * along).sum(1)
    return torch.atan2(sine, (normals[0] * normals[1]).sum(1))


def test_force_is_the_gradient_of_the_energy() -> None:
    points = torch.rand(40, 4, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    rest, lengths = torch.linspace(-0.5, 0.5, 40), torch.linspace(0.5, 1.5, 40)
    leaf = points.clone().requires_grad_()
    angles = angles_of(leaf)
    energy = 0.5 * STIFFNESS * lengths * (angles - rest) ** 2
    (wanted,) = torch.autograd.grad(energy.sum(), leaf, retain_graph=True)
    (slope,) = torch.autograd.grad(angles.sum(), leaf)
    forces, hessians = run(points.reshape(-1, 3), torch.arange(160).reshape(40, 4), rest, lengths)
    torch.testing.assert_close(forces.reshape(40, 4, 3), -wanted.float(), rtol=1e-3, atol=1e-3)
    outer = slope[..., :, None] * slope[..., None, :] * (STIFFNESS * lengths[:, None, None, None])
    torch.testing.assert_close(hessians.reshape(40, 4, 3, 3), outer.float(), rtol=1e-3, atol=1e-3)


def test_rims_and_points_do_not_bend() -> None:
    points = torch.rand(4, 3)
    points[0] = points[2]
    edges = torch.tensor([[0, 1, 2, 3], [-1, 1, 2, 3], [0, -1, 2, 3]])
    forces, hessians = run(points, edges, torch.ones(3), torch.ones(3))
    assert not forces.any()
    assert not hessians.any()
