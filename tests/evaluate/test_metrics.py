"""The measures on cases whose answer is known without them."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from evaluate.metrics import (
    Reference,
    distance_scores,
    energy_scores,
    ensemble_scores,
    map_mse,
    shape_scores,
    spread_scores,
    swing_scores,
)
from uvcloth.geometry.mesh import unique_edges

FPS = 30.0


def sheet(count: int = 6) -> tuple[Tensor, Tensor]:
    """A flat sheet of 1 cm squares in the XY plane."""
    x, y = torch.meshgrid(torch.arange(count), torch.arange(count), indexing="ij")
    vertices = torch.stack([x, y, 0 * x], dim=-1).reshape(-1, 3) * 0.01
    corner = (x[:-1, :-1] * count + y[:-1, :-1]).reshape(-1)
    a, b, c, d = corner, corner + count, corner + count + 1, corner + 1
    return vertices, torch.cat([torch.stack([a, b, c], 1), torch.stack([a, c, d], 1)])


def rotation(angle: float) -> Tensor:
    return torch.tensor(
        [[math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )


def reference(frames: int = 8) -> Reference:
    """A sheet that turns and travels, seen by one texel at every vertex and one at every face's middle."""
    rest, faces = sheet()
    moved = torch.stack([rest @ rotation(0.1 * k).T + 0.02 * k for k in range(frames)])
    at_vertices = torch.arange(len(rest))[:, None].expand(-1, 3)
    corners = torch.cat([at_vertices, faces])
    weights = torch.cat(
        [torch.tensor([[1.0, 0.0, 0.0]]).expand(len(rest), 3), torch.full((len(faces), 3), 1 / 3)]
    )
    return Reference(moved, (), torch.zeros_like(moved), rest, faces, FPS, corners, weights)


def test_a_shift_is_its_own_length() -> None:
    truth = reference()
    shifted = truth.vertices + torch.tensor([0.003, 0.0, 0.004])
    scores = {**shape_scores(shifted, truth), **map_mse(shifted, truth)}
    assert torch.allclose(scores["vertex_mean_mm"], torch.full((8,), 5.0), atol=1e-3)
    assert torch.allclose(scores["vertex_mse_mm2"], torch.full((8,), 25.0), atol=1e-2)
    assert torch.allclose(scores["map_mse_mm2"], torch.full((8,), 25.0), atol=1e-2)


def test_mean_and_root_mean_square_differ_as_they_should() -> None:
    truth = torch.zeros(2, 4, 3)
    predicted = truth.clone()
    predicted[1, 0, 2] = 0.008
    scores = distance_scores(predicted, truth)
    assert scores["vertex_mean_mm"].tolist() == pytest.approx([0.0, 2.0])
    assert scores["vertex_mse_mm2"].tolist() == pytest.approx([0.0, 16.0])


def test_map_error_is_the_vertex_error_seen_through_the_texels() -> None:
    still = torch.zeros(1, 3, 3)
    predicted = torch.tensor([[[0.006, 0.0, 0.0], [0.0, 0.0, 0.0], [-0.006, 0.0, 0.0]]])
    corners = torch.tensor([[0, 1, 2], [0, 1, 2]])
    weights = torch.tensor([[0.5, 0.5, 0.0], [0.5, 0.0, 0.5]])
    # The first texel sees 3 mm, in the second the two errors cancel.
    truth = Reference(still, (), still, still[0], torch.tensor([[0, 1, 2]]), FPS, corners, weights)
    assert float(map_mse(predicted, truth)["map_mse_mm2"]) == pytest.approx(9.0 / 2)
    assert map_mse(predicted, replace(truth, texel_corners=None)) == {}


def test_spread_is_the_mean_distance_of_all_pairs_of_members() -> None:
    """Members 0, 3 and 6 mm along an axis: pairs of 3, 3 and 6 mm."""
    truth = reference()
    members = tuple(truth.vertices + torch.tensor([0.001 * off, 0.0, 0.0]) for off in (3.0, 6.0))
    truth = replace(truth, members=members)
    spread = spread_scores(truth)
    assert torch.allclose(spread["spread_vertex_mean_mm"], torch.full((8,), 4.0), atol=1e-3)
    assert torch.allclose(spread["spread_vertex_mse_mm2"], torch.full((8,), (9 + 9 + 36) / 3), atol=1e-2)
    scores = ensemble_scores(truth.vertices + torch.tensor([0.005, 0.0, 0.0]), truth)
    assert torch.allclose(scores["ensemble_mm"], torch.full((8,), (5.0 + 2.0 + 1.0) / 3), atol=1e-3)
    assert torch.allclose(scores["nearest_member_mm"], torch.full((8,), 1.0), atol=1e-3)
    assert spread_scores(reference()) == ensemble_scores(truth.vertices, reference()) == {}


def swinging(amplitude: float, delay: float = 0.0) -> Tensor:
    """A sheet of which one row swings across, a full turn in 32 frames: (33, 36, 3) m."""
    rest, _ = sheet()
    angles = 2 * torch.pi * torch.arange(33) / 32 - delay
    moved = rest.repeat(33, 1, 1)
    moved[:, :6, 2] += amplitude * angles.sin()[:, None]
    return moved


@pytest.mark.parametrize(
    ("amplitude", "delay", "ratio", "correlation"),
    [(0.02, 0.0, 1.0, 1.0), (0.01, 0.0, 0.5, 1.0), (0.02, torch.pi / 3, 1.0, 0.5), (0.0, 0.0, 0.0, None)],
)
def test_swing_knows_amplitude_and_delay(
    amplitude: float, delay: float, ratio: float, correlation: float | None
) -> None:
    """Half of the amplitude halves the ratio, a delay lowers the correlation to its cosine."""
    rest, faces = sheet()
    truth = Reference(swinging(0.02), (), rest.expand(33, -1, -1), rest, faces, FPS, None, None)
    sums = {
        key: float(values.sum()) for key, values in swing_scores(swinging(amplitude, delay), truth).items()
    }
    assert sums["swing_speed"] / sums["true_swing_speed"] == pytest.approx(ratio, abs=0.01)
    if correlation is not None:
        squares = sums["swing_square"] * sums["true_swing_square"]
        assert sums["swing_product"] / squares**0.5 == pytest.approx(correlation, abs=0.01)


def test_rigid_motion_neither_stretches_nor_bends() -> None:
    truth = reference()
    scores = shape_scores(truth.vertices, truth)
    assert scores["edge_mm"].max() < 1e-4
    assert scores["bend_rad"].max() < 1e-3
    assert scores["vertex_mean_mm"].max() == 0


def test_scores_are_in_millimetres_per_frame() -> None:
    truth = reference()
    stretched = shape_scores(1.1 * truth.vertices, truth)
    edges = unique_edges(truth.faces)
    lengths = (truth.rest[edges[:, 0]] - truth.rest[edges[:, 1]]).norm(dim=1)
    frames = len(truth.vertices)
    assert stretched["edge_mm"].tolist() == pytest.approx([100.0 * float(lengths.mean())] * frames, rel=1e-3)
    assert stretched["jitter"].shape == (frames - 2,)


def test_the_energy_score_is_least_for_rollouts_that_spread_as_the_simulations_do() -> None:
    generator = torch.Generator().manual_seed(0)

    def drawn(spread: float) -> list[Tensor]:
        """Garments that lie a random way off, the whole of each the same."""
        return [0.01 * spread * torch.randn(3, generator=generator).expand(1, 2, 3) for _ in range(40)]

    first, *members = drawn(1.0)
    known = replace(reference(), vertices=first, members=tuple(members))
    one, alike, narrow, wide = (
        float(energy_scores(rollouts, known).get("energy_score_mm", torch.tensor(torch.nan)).mean())
        for rollouts in (drawn(1.0)[:1], drawn(1.0), drawn(0.3), drawn(3.0))
    )
    assert math.isnan(one)
    spread = float(spread_scores(known)["spread_vertex_mean_mm"].mean())
    assert alike == pytest.approx(0.5 * spread, rel=0.1)
    assert alike < narrow
    assert alike < wide
