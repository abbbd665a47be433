"""Edges through faces, against counts by hand and against every edge tried with every face in float64."""

import pytest
import torch
from torch import Tensor

from uvcloth.geometry.mesh import unique_edges
from uvcloth.physics.self_intersection import crossing_edges_percent

SIZE = 12


def sheet(size: int = SIZE) -> tuple[Tensor, Tensor]:
    """A level sheet of size x size points, 1 cm apart."""
    grid = torch.cartesian_prod(torch.arange(size), torch.arange(size))
    corner = grid[(grid < size - 1).all(1)] @ torch.tensor([size, 1])
    faces = torch.cat(
        [
            torch.stack([corner, corner + size, corner + 1], 1),
            torch.stack([corner + size, corner + size + 1, corner + 1], 1),
        ]
    )
    return torch.nn.functional.pad(0.01 * grid, (0, 1)), faces


def by_hand(vertices: Tensor, faces: Tensor) -> float:
    """Percent of the edges (E) that meet a face (M) which has neither end, by solving every 3 x 3 system."""
    points = vertices.double()
    edges = unique_edges(faces)
    start, along = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    a, b, c = points[faces].unbind(1)
    shape = (len(edges), len(faces), 3)
    columns = [(b - a).expand(shape), (c - a).expand(shape), -along[:, None].expand(shape)]
    met, broken = torch.linalg.inv_ex(torch.stack(columns, -1))
    u, v, t = (met @ (start[:, None] - a)[..., None]).squeeze(-1).unbind(-1)
    shared = (edges[:, None, :, None] == faces[None, :, None, :]).any(-1).any(-1)
    crosses = (u > 0) & (v > 0) & (u + v < 1) & (t > 0) & (t < 1) & ~shared & (broken == 0)
    return 100.0 * float(crosses.any(1).double().mean())


def test_the_two_edges_of_a_needle_through_a_face_count() -> None:
    points = torch.tensor([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.3, 1], [0.3, 0.2, 1.0]])
    faces = torch.tensor([[0, 1, 2], [3, 4, 5]])
    beside = points.clone()
    beside[3:, 0] -= 1.0
    touching = points.clone()
    touching[3] = points[0]
    frames = torch.stack([points, beside, touching])
    assert crossing_edges_percent(frames, faces).tolist() == pytest.approx([100 / 3, 0.0, 0.0])


def test_it_counts_what_trying_every_edge_with_every_face_counts() -> None:
    flat, faces = sheet()
    generator = torch.Generator().manual_seed(0)
    crumpled = flat + 0.006 * torch.randn(4, len(flat), 3, generator=generator)
    found = crossing_edges_percent(crumpled, faces)
    assert found.tolist() == pytest.approx([by_hand(frame, faces) for frame in crumpled], abs=1e-4)
    assert found.min() > 1.0


def test_folded_and_flat_cloth_does_not_cross_and_cloth_folded_through_itself_does() -> None:
    flat, faces = sheet()
    x = flat[:, 0]
    middle = float(x.mean())
    folded = torch.stack([(x - middle).abs(), flat[:, 1], 0.002 * (x > middle)], 1)
    through = folded.clone()
    through[:, 2] = 0.002 * torch.sign(x - middle) * torch.sign(flat[:, 1] - float(flat[:, 1].mean()))
    assert crossing_edges_percent(torch.stack([flat, folded]), faces).tolist() == [0.0, 0.0]
    assert float(crossing_edges_percent(through[None], faces)) > 1.0


def test_the_two_sides_of_a_seam_do_not_cross() -> None:
    """A crumpled sheet crosses itself at the same places when it is cut into single triangles."""
    flat, faces = sheet()
    whole = flat + 0.004 * torch.randn(flat.shape, generator=torch.Generator().manual_seed(1))
    cut = torch.arange(3 * len(faces)).view(-1, 3)
    through = crossing_edges_percent(whole[faces.flatten()][None], cut)
    assert float(through) == pytest.approx(by_hand(whole, faces), rel=0.2)
    assert crossing_edges_percent(flat[faces.flatten()][None], cut).tolist() == [0.0]


def test_no_faces_and_no_frames_are_no_crossings() -> None:
    flat, faces = sheet()
    assert crossing_edges_percent(flat[None], faces[:0]).tolist() == [0.0]
    assert crossing_edges_percent(flat[None][:0], faces).tolist() == []


def test_a_frame_that_flew_apart_does_not_count_as_free_of_crossings() -> None:
    vertices, faces = sheet(4)
    flown = vertices.clone()
    flown[0] = torch.nan
    shares = crossing_edges_percent(torch.stack([vertices, flown, vertices]), faces)
    assert shares.isnan().tolist() == [False, True, False]
