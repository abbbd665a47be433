"""Evening out edges: what it must leave alone, and what it must undo."""

import pytest
import torch
from torch import Tensor

from uvcloth.geometry.mesh import unique_edges
from uvcloth.physics.measures import fold_angle
from uvcloth.physics.strain_limiter import STRETCH, StrainLimiter


def sheet(count: int = 12) -> tuple[Tensor, Tensor]:
    x, y = torch.meshgrid(torch.arange(count), torch.arange(count), indexing="ij")
    corner = (x[:-1, :-1] * count + y[:-1, :-1]).reshape(-1)
    a, b, c, d = corner, corner + count, corner + count + 1, corner + 1
    vertices = torch.stack([x, y, 0 * x], dim=-1).reshape(-1, 3) * 0.02
    return vertices, torch.cat([torch.stack([a, b, c], 1), torch.stack([a, c, d], 1)])


def relax(
    rest: Tensor, faces: Tensor, vertices: Tensor, passes: int, predicted: Tensor | None = None
) -> Tensor:
    """Without planes, and to the lengths at rest unless others are predicted."""
    offsets = torch.full((len(rest),), -1e6)
    kept = rest if predicted is None else predicted
    return StrainLimiter(rest, faces).relax(vertices, passes, torch.zeros_like(rest), offsets, kept)


def stretch(vertices: Tensor, rest: Tensor, faces: Tensor) -> float:
    edges = unique_edges(faces)
    length = (vertices[edges[:, 0]] - vertices[edges[:, 1]]).norm(dim=-1)
    return float((length - (rest[edges[:, 0]] - rest[edges[:, 1]]).norm(dim=-1)).abs().mean())


def test_a_rigid_motion_stays_as_it_is() -> None:
    rest, faces = sheet()
    turn = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = rest @ turn.T + 1.0
    torch.testing.assert_close(relax(rest, faces, moved, 20), moved, atol=2e-5, rtol=0)


def test_stretch_and_noise_are_undone_about_the_same_middle() -> None:
    rest, faces = sheet()
    noise = torch.randn(rest.shape, generator=torch.Generator().manual_seed(0))
    broken = 1.2 * rest + 0.003 * noise
    relaxed = relax(rest, faces, broken, 60)
    assert stretch(relaxed, rest, faces) < 0.1 * stretch(broken, rest, faces)
    torch.testing.assert_close(relaxed.mean(0), broken.mean(0), atol=2e-3, rtol=0)


def test_what_cloth_stretches_stays_and_what_it_does_not_goes() -> None:
    rest, faces = sheet()
    for wrong, right in ((1.02, 1.02), (1.3, STRETCH), (0.98, 1.0)):
        scaled = rest * torch.tensor([wrong, 1.0, 1.0])
        relaxed = relax(rest, faces, scaled, 60, scaled)
        width = float(relaxed[:, 0].max() - relaxed[:, 0].min()) / float(rest[:, 0].max())
        assert width == pytest.approx(right, abs=0.004)


def test_more_passes_keep_lengths_better_and_many_stay_calm() -> None:
    rest, faces = sheet()
    noise = torch.randn(rest.shape, generator=torch.Generator().manual_seed(0))
    broken = rest + 0.004 * noise
    few, some, many = (stretch(relax(rest, faces, broken, n), rest, faces) for n in (5, 25, 400))
    assert many < some < few


def test_nothing_passes_a_plane_in_any_number_of_passes() -> None:
    rest, faces = sheet()
    up = torch.tensor([0.0, 0.0, 1.0]).expand(len(rest), 3).contiguous()
    noise = torch.randn(rest.shape, generator=torch.Generator().manual_seed(0))
    offsets = torch.where(rest[:, 0] > 0.1, 0.01, -1e6)
    for passes in (1, 2, 25):
        relaxed = StrainLimiter(rest, faces).relax(rest + 0.004 * noise, passes, up, offsets, rest)
        assert (relaxed[:, 2] >= offsets - 1e-6).all()


def test_a_crumpled_sheet_comes_out_with_wider_folds() -> None:
    rest, faces = sheet(20)
    noise = torch.randn(rest.shape, generator=torch.Generator().manual_seed(0))
    crumpled = rest * torch.tensor([0.9, 1.0, 1.0]) + 0.003 * noise
    relaxed = relax(rest, faces, crumpled, 45)
    assert fold_angle(relaxed[None], faces).mean() < 0.5 * fold_angle(crumpled[None], faces).mean()
    assert stretch(relaxed, rest, faces) < 0.1 * stretch(crumpled, rest, faces)


def test_a_bend_that_was_there_at_rest_stays() -> None:
    flat, faces = sheet()
    around = flat[:, 0] / 0.05
    rest = torch.stack([0.05 * around.cos(), 0.05 * around.sin(), flat[:, 1]], dim=1)
    torch.testing.assert_close(relax(rest, faces, rest, 45), rest, atol=1e-6, rtol=0)


def test_seam_copies_stay_together() -> None:
    rest, faces = sheet()
    doubled = torch.cat([rest, rest[:12]])
    faces = faces.clone()
    faces[:5][faces[:5] < 12] += len(rest)
    broken = 1.1 * doubled
    broken[0, 0] += 0.01
    relaxed = relax(doubled, faces, broken, 10)
    torch.testing.assert_close(relaxed[:12], relaxed[len(rest) :], atol=0, rtol=0)
