"""Baking: analytic motions, derivatives."""

import pytest
import torch

from rasterize.bake import bake, scatter_map, valid_mask
from rasterize.texels import Texels, rasterize_layout
from uvcloth.bodies.body import Body
from uvcloth.bodies.layout import load_body_layout


@pytest.fixture(scope="module")
def texels() -> Texels:
    return rasterize_layout(load_body_layout(), 64)


def test_rigid_motion_bakes_to_its_exact_velocity(body: Body, texels: Texels) -> None:
    """Turning at omega about an axis while drifting at c: v(x) = omega x x + c at every texel."""
    omega = torch.tensor([0.3, -0.8, 1.1], dtype=torch.float64)
    drift = torch.tensor([0.5, 0.1, -0.2], dtype=torch.float64)
    rest = body.mesh.vertices.double()
    velocity = torch.linalg.cross(omega.expand_as(rest), rest) + drift
    points = bake(rest, body.mesh.faces, texels)
    expected = torch.linalg.cross(omega.expand_as(points), points) + drift
    assert (bake(velocity, body.mesh.faces, texels) - expected).abs().max() < 1e-6


def test_constants_survive_in_a_batch(body: Body, texels: Texels) -> None:
    values = torch.tensor([[1.0, 2.0], [3.0, 4.0]])[:, None].expand(2, len(body.mesh.vertices), 2)
    baked = bake(values, body.mesh.faces, texels)
    assert baked.shape == (2, len(texels), 2)
    assert torch.allclose(baked, values[:, :1].expand_as(baked), atol=1e-6)


def test_values_are_put_on_their_texels_and_the_rest_is_zero(texels: Texels) -> None:
    values = torch.rand(2, len(texels), 3) + 1.0
    maps = scatter_map(values, texels)
    assert maps.shape == (2, 3, 64, 64)
    assert torch.equal(maps.flatten(-2)[..., texels.pixels], values.transpose(-1, -2))
    assert (maps[:, :, ~valid_mask(texels)] == 0).all()


def test_derivatives_through_baking() -> None:
    texels = Texels(
        height=3,
        width=3,
        face=torch.tensor([0, 1, 1]),
        barycentrics=torch.tensor([[0.2, 0.3, 0.5], [0.0, 1.0, 0.0], [0.6, 0.1, 0.3]]),
        pixels=torch.tensor([0, 4, 5]),
        islands=torch.zeros(3, dtype=torch.int64),
        uvs=torch.zeros(3, 2),
    )
    faces = torch.tensor([[0, 1, 2], [2, 1, 3]])
    values = torch.rand(2, 4, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v: scatter_map(bake(v, faces, texels), texels), (values,))
