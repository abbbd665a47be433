"""The convolutions over seeds against their plain twins, which have a channel for every seed."""

import torch
from torch import Tensor
from torch.nn import functional

from uvcloth.methods.motion_guided.descriptor import Forces, RelativePositions, SeedForces, contact_forces

BATCH, SEEDS, OUTPUTS, SIZE = 2, 7, 5, 9


def random(*shape: int) -> Tensor:
    return torch.randn(*shape, dtype=torch.float64, generator=torch.manual_seed(sum(shape)))


def sheet() -> tuple[Tensor, Tensor]:
    """Some texels (P,) of a sheet, and their mask (1, 1, H, W)."""
    mask = random(1, 1, SIZE, SIZE) > 0
    return torch.nonzero(mask.flatten()).squeeze(1), mask.double()


def plain(kernel: Tensor, channels: Tensor) -> Tensor:
    """A convolution over maps of vectors (B, S, 3, H, W), as published."""
    return functional.conv2d(channels.flatten(1, 2), kernel.flatten(1, 2).unflatten(-1, (3, 3)), padding=1)


def same_gradients(first: Tensor, second: Tensor, inputs: list[Tensor]) -> None:
    weights = torch.linspace(-1, 1, first.numel(), dtype=first.dtype).view_as(first)
    for one, other in zip(
        torch.autograd.grad((first * weights).sum(), inputs, retain_graph=True),
        torch.autograd.grad((second * weights).sum(), inputs),
        strict=True,
    ):
        torch.testing.assert_close(one, other)


def test_positions_relative_to_every_seed_need_no_channel_each() -> None:
    layer = RelativePositions(SEEDS, OUTPUTS).double()
    _, mask = sheet()
    seeds = random(BATCH, SEEDS, 3).requires_grad_()
    positions = (random(BATCH, 3, SIZE, SIZE) * mask).requires_grad_()
    channels = (positions[:, None] - seeds[..., None, None]) * mask[:, :, None]
    expected = plain(layer.weight, channels)
    got = layer(positions, mask, seeds)
    torch.testing.assert_close(got, expected)
    same_gradients(got, expected, [seeds, layer.weight])


def test_forces_of_every_seed_need_no_channel_each() -> None:
    layer = SeedForces(SEEDS, OUTPUTS).double()
    pixels, _ = sheet()
    normals = random(BATCH, SEEDS, 3).requires_grad_()
    depth = random(BATCH, len(pixels), SEEDS).requires_grad_()
    forces = depth.clamp(min=0)
    vectors = torch.einsum("bps,bsa->bsap", forces, normals)
    channels = vectors.new_zeros(BATCH, SEEDS, 3, SIZE**2).index_copy(3, pixels, vectors)
    expected = plain(layer.weight, channels.unflatten(-1, (SIZE, SIZE)))
    pairs = torch.nonzero(forces.flatten()).squeeze(1)
    pushes = Forces(pairs, forces.flatten()[pairs], forces.shape)
    torch.testing.assert_close(pushes.dense(), forces)
    got = layer(pushes, normals, pixels, SIZE)
    torch.testing.assert_close(got, expected)
    same_gradients(got, expected, [normals, depth, layer.weight])


def test_only_what_is_behind_a_seeds_plane_is_pushed_the_more_the_nearer() -> None:
    seeds, normals = torch.zeros(1, 1, 3), torch.tensor([[[0.0, 0.0, 1.0]]])
    points = torch.tensor([[[0.0, 0.0, 0.01], [0.0, 0.0, -0.01], [0.08, 0.0, -0.01]]])
    forces = contact_forces(points, seeds, seeds, normals, sigma=0.04).dense()[0, :, 0]
    assert forces[0] == 0
    torch.testing.assert_close(forces[1], torch.tensor(0.01 * torch.e ** (-1 / 32)))
    torch.testing.assert_close(forces[2] / forces[1], torch.tensor(torch.e**-2.0))
