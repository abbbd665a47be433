"""Which side of an inner layer points are on: a flat sheet, beside its hem, and far from it."""

import pytest
import torch
import trimesh

from uvcloth.physics.layers import Layer, inner_layer, wrong_side_percent

SQUARE = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = torch.tensor([[0, 1, 2], [0, 2, 3]])
POINTS = torch.tensor([[0.5, 0.4, 0.01], [0.5, 0.4, -0.01], [1.02, 0.5, 0.001], [0.5, 0.5, 0.2]])


def test_points_over_and_under_a_sheet_and_beside_its_hem() -> None:
    found = Layer(SQUARE, FACES).beside(POINTS)
    assert found.covered.tolist() == [True, True, False, False]
    torch.testing.assert_close(found.distance[:2], torch.tensor([0.01, -0.01]))


def test_normals_between_corners_are_blended() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=2)
    layer = Layer(torch.tensor(sphere.vertices).float(), torch.tensor(sphere.faces))
    outwards = torch.tensor(sphere.triangles_center).float()
    found = layer.beside(1.01 * outwards)
    assert found.covered.all()
    cosine = (found.normals * torch.nn.functional.normalize(outwards, dim=1)).sum(1)
    assert float(cosine.min()) > 0.9999


def test_a_vertex_meets_the_faces_that_touch_a_part_of_the_body_with_it() -> None:
    """Over both faces, and far off: the first face touches part 1 alone, the second part 2 as well."""
    over = torch.tensor([[0.6, 0.3, 0.01], [0.3, 0.6, 0.01], [0.5, 0.5, 0.2]])
    touches, corners = torch.tensor([2, 2, 2]), torch.tensor([1, 1, 1, 3])
    rows, distance, normals = inner_layer(Layer(SQUARE, FACES), touches.int(), corners.int()).find(over)
    assert rows.tolist() == [1]
    torch.testing.assert_close(distance, torch.tensor([0.01]))
    torch.testing.assert_close(normals, torch.tensor([[0.0, 0.0, 1.0]]))


def test_the_share_counts_only_what_is_covered_at_each_frame() -> None:
    frames = torch.stack([POINTS, POINTS + torch.tensor([0.0, 0.0, 0.02])])
    sheets = torch.stack([SQUARE, SQUARE])
    assert wrong_side_percent(frames, sheets, FACES) == pytest.approx(100 / 4)
    assert wrong_side_percent(POINTS[None, 3:], SQUARE[None], FACES) == 0.0
