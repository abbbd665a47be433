"""The linear space of shapes that are known combinations of two."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from tests.train.simulated import swaying
from train.motion_guided.dataset import GarmentFrames, offsets_of
from train.motion_guided.linear_space import fit_linear, rest_displacements
from uvcloth.bodies.body import load_body
from uvcloth.dataset.rows import Rows
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.rotations import rotate
from uvcloth.methods.motion_guided.config import PRESETS
from uvcloth.methods.motion_guided.dynamics_input import Pose, posed_shape
from uvcloth.methods.motion_guided.latent import DISPLACEMENT_SCALE, LinearSpace
from uvcloth.methods.motion_guided.seeds import pose_seeds

FRAMES = 9


def combined(skinning: Any) -> tuple[LinearSpace, Any, Tensor, Tensor]:
    """A new space, posed garments to fit it to, their displacements at rest (F, 3 N) m, and both shapes."""
    config, body = PRESETS["tiny"], load_body()
    config = replace(config, skinning=skinning)
    maps = config.maps(fit_template("dress", body), body)
    config = replace(config, vertices=len(maps.points))
    space = config.shape_space()
    assert isinstance(space, LinearSpace)
    x, y, z = maps.points.unbind(1)
    shapes = torch.stack([torch.stack([z.sin(), x, 0 * y], 1), torch.stack([y, 0 * z, (3 * z).cos()], 1)])
    shares = 0.02 * torch.randn(FRAMES, 2, generator=torch.Generator().manual_seed(0))
    displaced = 0.01 + torch.einsum("fk,knc->fnc", shares, shapes)
    transforms = swaying(FRAMES, seed=1).transforms()
    pose = Pose(transforms, pose_seeds(maps.seeds, transforms))
    vertices = posed_shape(space, maps, maps.points + rotate(maps.axes, displaced), pose)
    offsets = offsets_of(maps, vertices, transforms)
    order = torch.arange(FRAMES)
    rows = Rows(transforms, torch.full((FRAMES,), 30.0), torch.zeros_like(order), samples=order)
    frames = GarmentFrames(rows, vertices, offsets, pose)
    space.shift.copy_(maps.map(offsets).mean(0))
    return space, SimpleNamespace(maps=maps, training=frames), displaced.flatten(1), shapes.flatten(1)


@pytest.mark.parametrize("skinning", ["smooth_lbs", "fixed"])
def test_posed_garments_go_back_to_where_they_came_from(skinning: str) -> None:
    space, dataset, displaced, _ = combined(skinning)
    with torch.no_grad():
        found = rest_displacements(space, dataset, dataset.training.rows.samples)
    torch.testing.assert_close(found, displaced, atol=1e-5, rtol=0)


def test_kernels_that_depend_on_the_displacement_are_undone_by_iteration() -> None:
    """Between two legs it does not converge; nine vertices in ten come back to a millimetre, half exactly."""
    space, dataset, displaced, _ = combined("kernels")
    with torch.no_grad():
        found = rest_displacements(space, dataset, dataset.training.rows.samples)
    wrong = (found - displaced).unflatten(1, (-1, 3)).norm(dim=2).flatten()
    assert wrong.median() < 1e-5
    assert wrong.quantile(0.9) < 1e-3


def test_two_components_hold_what_two_shapes_made() -> None:
    space, dataset, displaced, shapes = combined("smooth_lbs")
    fit_linear(space, dataset)
    mean = displaced.mean(0)
    torch.testing.assert_close(DISPLACEMENT_SCALE * space.decoder.bias, mean, atol=1e-5, rtol=0)
    directions = DISPLACEMENT_SCALE * space.decoder.weight.detach().T
    assert directions[2:].norm(dim=1).max() < 1e-2 * directions[1].norm()
    basis = torch.linalg.qr(directions[:2].T).Q
    inside = (shapes @ basis) @ basis.T
    assert (inside - shapes).norm() < 1e-3 * shapes.norm()
    # Codes have unit variance: the components carry all of the shapes'.
    variance = (displaced - mean).square().sum() / (FRAMES - 1)
    torch.testing.assert_close(directions.square().sum(), variance, rtol=1e-3, atol=0)


def test_the_encoder_finds_the_codes_of_what_it_was_fitted_to() -> None:
    space, dataset, displaced, _ = combined("smooth_lbs")
    fit_linear(space, dataset)
    with torch.no_grad():
        codes = space.encode(space.features(dataset.maps.map(dataset.training.offsets)))
        decoded = space.decode(codes, dataset.maps.sample, dataset.maps.places).flatten(1)
    torch.testing.assert_close(codes[:, :2].std(0), torch.ones(2), atol=0.05, rtol=0)
    assert (decoded - displaced).norm() < 0.05 * (displaced - displaced.mean(0)).norm()
