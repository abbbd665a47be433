"""Closest points against analytic bodies."""

import pytest
import torch
import trimesh
from torch import Tensor

from uvcloth.physics.surface import BodySurface, closest_points


def tensors(mesh: trimesh.Trimesh) -> tuple[Tensor, Tensor]:
    return torch.tensor(mesh.vertices, dtype=torch.float32), torch.tensor(mesh.faces, dtype=torch.int64)


def crossing_limbs() -> BodySurface:
    """Two ellipsoids 1 m long and 0.2 m thick, one along z and one along x, that cross at the origin."""
    upright, across = trimesh.creation.icosphere(5), trimesh.creation.icosphere(5)
    upright.apply_scale([0.1, 0.1, 0.5])
    across.apply_scale([0.5, 0.1, 0.1])
    return BodySurface(*tensors(trimesh.util.concatenate([upright, across])))


def test_closest_points_of_a_sphere_follow_its_formula() -> None:
    vertices, faces = tensors(trimesh.creation.icosphere(5, radius=0.3))
    points = torch.nn.functional.normalize(torch.randn(1200, 3, generator=torch.manual_seed(0)), dim=1)
    radius = torch.linspace(0.15, 0.45, 1200)
    found = BodySurface(vertices, faces).closest(points * radius[:, None])
    torch.testing.assert_close(found.signed_distance, radius - 0.3, atol=3e-4, rtol=0)
    assert (found.normals * points).sum(1).min() > 0.999
    corners = vertices[faces[found.faces]]
    torch.testing.assert_close((corners * found.barycentrics[..., None]).sum(1), found.points)


def test_what_is_out_of_reach_has_no_face() -> None:
    surface = BodySurface(*tensors(trimesh.creation.icosphere(2, radius=0.3)))
    found = surface.closest(torch.tensor([[0.0, 0.0, 0.9]]), max_distance=0.1)
    assert found.faces.item() == -1
    assert found.signed_distance.item() == pytest.approx(0.1)


def test_the_sign_is_right_far_from_sharp_edges() -> None:
    """Outside of a thin wedge the closest point lies on its edge, where the two faces disagree."""
    wedge = trimesh.creation.cone(radius=0.01, height=0.5, sections=5)
    points = 0.2 * torch.nn.functional.normalize(torch.randn(4000, 3, generator=torch.manual_seed(3)), dim=1)
    points += torch.tensor([0.0, 0.0, 0.4])
    found = BodySurface(*tensors(wedge)).closest(points)
    outside = torch.from_numpy(~wedge.contains(points.numpy()))
    assert torch.equal(found.signed_distance > 0, outside)


def test_a_surface_that_crosses_itself_has_one_inside() -> None:
    """Where two limbs overlap, the nearest sheet faces into the other limb."""
    points = 0.6 * (torch.rand(4000, 3, generator=torch.manual_seed(4)) - 0.5)
    limbs = torch.tensor([[0.1, 0.1, 0.5], [0.5, 0.1, 0.1]])
    height = ((points[:, None] / limbs) ** 2).sum(-1).amin(1)
    clear = (height - 1).abs() > 0.02
    found = crossing_limbs().closest(points[clear])
    assert torch.equal(found.signed_distance < 0, height[clear] < 1)


def test_sheets_that_nearly_touch_are_told_apart() -> None:
    """Two blocks with a gap of 3 micrometres: the ray that leaves one enters the other at once."""
    blocks = [trimesh.creation.box((0.4, 0.4, 0.1)) for _ in range(2)]
    blocks[1].apply_translation([0, 0, 0.100003])
    points = 0.3 * (torch.rand(3000, 3, generator=torch.manual_seed(5)) - 0.5)
    surface = BodySurface(*tensors(trimesh.util.concatenate(blocks)))
    height = points[:, 2]
    clear = ((height + 0.05).abs() > 1e-4) & ((height - 0.05).abs() > 1e-4)
    assert torch.equal(surface.closest(points).signed_distance[clear] < 0, (height > -0.05)[clear])


def test_an_updated_surface_answers_at_its_new_place() -> None:
    vertices, faces = tensors(trimesh.creation.icosphere(4, radius=0.3))
    surface = BodySurface(vertices, faces)
    surface.update(vertices + torch.tensor([1.0, 0.0, 0.0]))
    distance = surface.closest(torch.tensor([[1.0, 0.0, 0.31], [0.0, 0.0, 0.31]]), max_distance=0.05)
    torch.testing.assert_close(distance.signed_distance, torch.tensor([0.01, 0.05]), atol=1e-3, rtol=0)


def test_nearest_points_are_found_however_far_away_they_are() -> None:
    """Around a box, where coordinates are cut off at its sides; only points that are nowhere miss."""
    half = torch.tensor([0.2, 0.1, 0.3])
    mesh = tensors(trimesh.creation.box(2 * half.numpy()))
    points = 2.0 * torch.randn(200, 3, generator=torch.manual_seed(6))
    points[0] = 300.0
    points = points[(points.abs() > half).any(1)]
    places = points.clamp(min=-half, max=half)
    hits = closest_points(points, *mesh)
    torch.testing.assert_close(hits.distance, (points - places).norm(dim=1))
    torch.testing.assert_close(hits.interpolate(*mesh), places)
    points[1] = torch.nan
    lost = closest_points(points, *mesh)
    assert (~lost.hit).nonzero().flatten().tolist() == [1]
    assert lost.distance[1] == torch.inf
