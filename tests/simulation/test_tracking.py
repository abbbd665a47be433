"""Fine cloth that tracks a garment: what the filter passes, and that it follows and stays off the body."""

import math
from dataclasses import replace

import pytest
import torch

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.garments.garment import Garment
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import load_clip
from uvcloth.physics.surface import BodySurface
from uvcloth.simulation.tracking import FineGarment, LongWaves, Tracking, track

EDGE = 0.03


def even_sheet(count: int, spacing: float) -> tuple[torch.Tensor, torch.Tensor]:
    """An even triangle lattice (N, 3) m, (M, 3)."""
    row, column = torch.meshgrid(torch.arange(count), torch.arange(count), indexing="ij")
    x = spacing * (column + 0.5 * (row % 2)).flatten()
    y = spacing * math.sqrt(0.75) * row.flatten()
    index = torch.arange(count * count).view(count, count)
    a, b, c, d = (part.flatten() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    even = (row[:-1, :-1] % 2 == 0).flatten()[:, None]
    first = torch.where(even, torch.stack([a, b, d], 1), torch.stack([a, b, c], 1))
    second = torch.where(even, torch.stack([b, c, d], 1), torch.stack([a, c, d], 1))
    return torch.stack([x, y, torch.zeros_like(x)], 1), torch.cat([first, second])


@pytest.mark.parametrize(("wavelength", "passed"), [(0.4, 1.0), (0.1, 0.5), (0.05, 1.0 / 17.0)])
def test_the_filter_passes_long_waves(wavelength: float, passed: float) -> None:
    rest, faces = even_sheet(60, 0.009)
    filtered = LongWaves(rest, faces, 0.1)
    wave = (2.0 * math.pi * rest[:, :1] / wavelength).sin().double().numpy()
    inside = ((rest[:, :2] - rest[:, :2].mean(0)).abs().amax(1) < 0.15).numpy()
    long = filtered.of(wave)[inside, 0]
    share = float((long * wave[inside, 0]).sum() / (wave[inside, 0] ** 2).sum())
    assert share == pytest.approx(passed, abs=0.05)


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


@pytest.fixture(scope="module")
def garment(body: Body) -> Garment:
    return fit_template("tops", body)


@pytest.fixture(scope="module")
def fine(garment: Garment) -> FineGarment:
    return FineGarment.of(garment, EDGE)


def test_the_fine_mesh_lies_on_the_garment_and_moves_with_it(garment: Garment, fine: FineGarment) -> None:
    torch.testing.assert_close(fine.at(garment.mesh.vertices), fine.rest, atol=1e-3, rtol=0.0)
    shift = torch.tensor([1.0, 2.0, 3.0])
    displaced = fine.at((garment.mesh.vertices + shift)[None])
    torch.testing.assert_close(displaced[0], fine.at(garment.mesh.vertices) + shift, atol=1e-4, rtol=0.0)


def test_fine_cloth_follows_the_garment_and_keeps_off_the_body(
    body: Body, garment: Garment, fine: FineGarment
) -> None:
    clip = load_clip("walk", body).window(0, 4)
    transforms = clip.transforms()
    coarse = skin(garment.mesh.vertices, garment.smooth_weights, transforms)
    settings = replace(Tracking(edge=EDGE), settle=4)
    frames = [frame.vertices for frame in track(garment, fine, body, coarse, transforms, clip.fps, settings)]
    assert len(frames) == len(transforms)
    away = (frames[-1] - fine.at(coarse[-1].double())).norm(dim=1)
    assert 1e-4 < float(away.mean()) < 0.012
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    surface.update(posed_skin(body, transforms[-1:])[0])
    inside = surface.closest(frames[-1].float()).signed_distance < -0.002
    assert float(inside.float().mean()) < 0.01
    free = replace(settings, pull=0.01)
    *_, last = track(garment, fine, body, coarse, transforms, clip.fps, free)
    assert float((last.vertices - frames[-1]).norm(dim=1).mean()) > 1e-4
