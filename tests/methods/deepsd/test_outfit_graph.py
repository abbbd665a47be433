"""Graph convolutions over a distance: the same of a garment of any mesh, with anything beside it."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from tests.small_body import small_body
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.subdivide import halve_edges
from uvcloth.methods.deepsd.outfit_graph import OutfitGraph, outfit_graph, pack

CPU = torch.device("cpu")
SPREAD = 0.03


def square(edge: float, halved: int = 0) -> OutfitGraph:
    """A flat square of 0.4 m in a lattice with edges of about `edge`, halved so often."""
    count = round(0.4 / edge)
    grid = torch.cartesian_prod(torch.arange(count + 1), torch.arange(count + 1))
    corner = (torch.arange(count)[:, None] * (count + 1) + torch.arange(count)).flatten()
    lower = torch.stack([corner, corner + count + 1, corner + 1], dim=1)
    upper = torch.stack([corner + 1, corner + count + 1, corner + count + 2], dim=1)
    vertices = torch.cat([grid * 0.4 / count, torch.full((len(grid), 1), 0.2)], dim=1)
    faces = torch.cat([lower, upper])
    for _ in range(halved):
        vertices, faces = halve_edges(vertices, faces)
    weights = torch.full((len(vertices), 2), 0.5)
    mesh = Mesh(vertices, faces, torch.zeros(0, 2), faces)
    return outfit_graph(Outfit(small_body(), (Garment("sheet", "tops", mesh, weights, weights),)))


def convolved(graph: OutfitGraph, values: Tensor, spread: float = SPREAD) -> Tensor:
    """Values (U, C) of the only outfit, convolved."""
    return pack([graph], CPU, spread).convolve(values[None])[0]


@pytest.mark.parametrize(("edge", "halved"), [(0.02, 0), (0.02, 1), (0.01, 0), (0.005, 0)])
def test_values_get_as_far_as_the_spread_on_edges_of_any_length(edge: float, halved: int) -> None:
    graph = square(edge, halved)
    middle = (graph.points[:, :2] - 0.2).norm(dim=1).argmin()
    ways = graph.points - graph.points[middle]
    # Row `middle` of the kernel, times the squared distances: the mean of where its values come from.
    found = convolved(graph, torch.cat([ways.square().sum(1, keepdim=True), torch.ones(len(ways), 1)], dim=1))
    assert float(found[middle, 0]) ** 0.5 == pytest.approx(SPREAD, rel=0.03)
    torch.testing.assert_close(found[:, 1], torch.ones(len(ways)), atol=1e-5, rtol=0)


def test_neighbours_alone_are_their_mean() -> None:
    graph = square(0.1)
    values = torch.rand(len(graph.points), 3)
    found = convolved(graph, values, 0.0)
    for index in range(len(values)):
        near = graph.columns[graph.rows[index] : graph.rows[index + 1]]
        torch.testing.assert_close(found[index], values[near].mean(0))


def test_a_coarse_and_a_fine_mesh_average_alike() -> None:
    graphs = square(0.02), square(0.02, 2)
    same = torch.cdist(graphs[0].points, graphs[1].points).argmin(1)
    inner = ((graphs[0].points[:, :2] - 0.2).abs() < 0.1).all(1)

    def difference(spread: float, points: Tensor) -> float:
        coarse, fine = (
            convolved(graph, torch.sin(12.0 * graph.points[:, :2].sum(1, keepdim=True)), spread)
            for graph in graphs
        )
        return float((coarse - fine[same]).abs()[points].mean())

    assert difference(SPREAD, inner) < 0.1 * difference(0.0, inner)
    assert difference(SPREAD, ~inner) < 0.4 * difference(0.0, ~inner)


def test_what_lies_beside_an_outfit_in_a_batch_changes_nothing() -> None:
    coarse, fine = square(0.05), square(0.01)
    values = torch.rand(len(coarse.points) + len(fine.points), 2)
    together = pack([coarse, fine], CPU, SPREAD).convolve(values[None])[0]
    apart = [
        convolved(graph, part)
        for graph, part in zip(
            (coarse, fine), values.split([len(coarse.points), len(fine.points)]), strict=True
        )
    ]
    torch.testing.assert_close(together, torch.cat(apart), atol=1e-5, rtol=0)


def test_gradients_are_those_of_the_transposed_kernel() -> None:
    graph = square(0.1)
    packed = pack([graph], CPU, 0.1)
    kernel = packed.convolve(torch.eye(len(graph.points))[None])[0]
    values = torch.rand(1, len(graph.points), 2, requires_grad=True)
    slopes = torch.rand(1, len(graph.points), 2)
    packed.convolve(values).backward(slopes)
    assert values.grad is not None
    torch.testing.assert_close(values.grad[0], kernel.T @ slopes[0], atol=1e-6, rtol=1e-5)


def test_points_at_one_place_and_points_without_neighbours_stay_finite() -> None:
    graph = square(0.1)
    gathered = replace(graph, points=torch.zeros_like(graph.points))
    values = torch.rand(len(graph.points), 2)
    assert convolved(gathered, values).isfinite().all()
    count = len(graph.points)
    lonely = replace(graph, rows=torch.arange(count + 1), columns=torch.arange(count))
    torch.testing.assert_close(convolved(lonely, values), values)


def test_the_gradient_is_the_transposed_kernel() -> None:
    """The kernel is a matrix K: what a weighted sum (w, K v) is by v is K's transpose times w."""
    graph = square(0.05, 1)
    count = len(graph.points)
    kernel = convolved(graph, torch.eye(count))
    values = torch.rand(count, 2, requires_grad=True)
    weights = torch.rand(count, 2)
    (gradient,) = torch.autograd.grad((weights * convolved(graph, values)).sum(), values)
    torch.testing.assert_close(gradient, kernel.T @ weights, atol=1e-5, rtol=1e-5)
    assert not torch.allclose(kernel, kernel.T, atol=1e-3)
