import torch
import trimesh

from uvcloth.geometry.closest import closest_barycentrics


def test_closest_points_are_those_of_trimesh() -> None:
    torch.manual_seed(0)
    triangles, points = torch.randn(5000, 3, 3).double(), 2.0 * torch.randn(5000, 3).double()
    shares = closest_barycentrics(points, triangles)
    assert (shares >= 0.0).all()
    torch.testing.assert_close(shares.sum(1), torch.ones(5000).double())
    expected = trimesh.triangles.closest_point(triangles.numpy(), points.numpy())
    torch.testing.assert_close((shares[..., None] * triangles).sum(1), torch.from_numpy(expected))


def test_a_triangle_without_area_is_a_segment_or_a_point() -> None:
    segment = torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]).double()
    triangles = torch.stack([segment, torch.ones(3, 3).double()])
    points = torch.tensor([[0.25, 3.0, 0.0], [5.0, 5.0, 5.0]]).double()
    shares = closest_barycentrics(points, triangles)
    places = (shares[..., None] * triangles).sum(1)
    torch.testing.assert_close(places, torch.tensor([[0.25, 0.0, 0.0], [1.0, 1.0, 1.0]]).double())
