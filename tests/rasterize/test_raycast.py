"""Rays and closest points against a sphere, where the answers are known."""

import torch
import trimesh

from rasterize.raycast import body_to_garment, cast_rays, closest_points, garment_to_body

SPHERE = trimesh.creation.icosphere(subdivisions=5, radius=1.0)
VERTICES = torch.from_numpy(SPHERE.vertices.copy()).float()
FACES = torch.from_numpy(SPHERE.faces.copy())


def directions(count: int) -> torch.Tensor:
    found = torch.randn(count, 3, generator=torch.Generator().manual_seed(0))
    return torch.nn.functional.normalize(found, dim=1)


def test_rays_from_the_centre_meet_the_sphere_at_its_radius() -> None:
    towards = directions(200)
    hits = cast_rays(torch.zeros(200, 3), 3.0 * towards, VERTICES, FACES, max_distance=2.0, both_ways=False)
    assert hits.hit.all()
    assert (hits.distance - 1).abs().max() < 2e-3
    assert (hits.interpolate(VERTICES, FACES) - towards * hits.distance[:, None]).abs().max() < 1e-5


def test_both_ways_takes_the_nearer_side_and_signs_it() -> None:
    origins = 0.9 * directions(50)
    hits = cast_rays(origins, -origins, VERTICES, FACES, max_distance=3.0, both_ways=True)
    assert (hits.distance + 0.1).abs().max() < 2e-3
    one_way = cast_rays(origins, -origins, VERTICES, FACES, max_distance=3.0, both_ways=False)
    assert (one_way.distance - 1.9).abs().max() < 2e-3


def test_a_miss_is_marked_and_distance_is_limited() -> None:
    origins = torch.tensor([[2.0, 0.0, 0.0], [2.0, 0.1, 0.0]])
    away = torch.tensor([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    hits = cast_rays(origins, away, VERTICES, FACES, max_distance=0.5, both_ways=False)
    assert hits.face.tolist() == [-1, -1]
    assert torch.isinf(hits.distance).all()
    assert (hits.barycentrics == 0).all()


def test_closest_points_lie_along_the_radius() -> None:
    points = directions(100) * torch.linspace(0.2, 2.0, 100)[:, None]
    hits = closest_points(points, VERTICES, FACES)
    found = hits.interpolate(VERTICES, FACES)
    assert (hits.distance - (points.norm(dim=1) - 1).abs()).abs().max() < 2e-3
    assert ((found - points).norm(dim=1) - hits.distance).abs().max() < 1e-5


def test_body_and_garment_see_each_other() -> None:
    inner = 0.8 * VERTICES
    there = body_to_garment(inner, VERTICES, VERTICES, FACES, max_distance=0.5)
    assert there.hit.float().mean() > 0.999
    assert (there.interpolate(VERTICES, FACES)[there.hit] - VERTICES[there.hit]).norm(dim=1).max() < 1e-3
    back = garment_to_body(VERTICES, VERTICES, inner, FACES, max_distance=0.5)
    assert (back.distance[back.hit] + 0.2).abs().max() < 1e-3


def test_the_outside_of_cloth_on_another_limb_is_not_seen() -> None:
    origin = torch.tensor([[1.5, 0.01, 0.02]])
    hits = body_to_garment(origin, torch.tensor([[-1.0, 0.0, 0.0]]), VERTICES, FACES, max_distance=2.0)
    assert not hits.hit.any()
