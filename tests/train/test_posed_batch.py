"""Closest planes of many poses at once against each pose alone, and what a cache spares."""

import pytest
import torch
import trimesh
from torch import Tensor

from train.posed_batch import ClosestPointCache, Planes, PosedMeshBatch, empty_cache
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.physics.surface import FREE, SEARCH_DISTANCE, BodySurface

NEAR = 0.004
CPU = torch.device("cpu")


def ball() -> tuple[Tensor, Tensor]:
    mesh = trimesh.creation.icosphere(3, radius=0.15)
    return torch.tensor(mesh.vertices, dtype=torch.float32), torch.tensor(mesh.faces, dtype=torch.int64)


def limbs() -> tuple[Tensor, Tensor]:
    """Two ellipsoids that cross: the nearest sheet of one may lie within the other."""
    upright, across = trimesh.creation.icosphere(3), trimesh.creation.icosphere(3)
    upright.apply_scale([0.1, 0.08, 0.3])
    across.apply_scale([0.3, 0.1, 0.07])
    mesh = trimesh.util.concatenate([upright, across])
    return torch.tensor(mesh.vertices, dtype=torch.float32), torch.tensor(mesh.faces, dtype=torch.int64)


def posed(vertices: Tensor, count: int) -> Tensor:
    """Stretched and shifted, each pose otherwise: (count, V, 3)."""
    generator = torch.Generator().manual_seed(7)
    stretch = 0.8 + 0.4 * torch.rand(count, 1, 3, generator=generator)
    return vertices * stretch + 0.1 * torch.randn(count, 1, 3, generator=generator)


def around(poses: Tensor, count: int, spread: float, seed: int = 0) -> Tensor:
    """Points about the vertices of each pose: (B, count, 3)."""
    generator = torch.Generator().manual_seed(seed)
    chosen = torch.randint(poses.shape[1], (count,), generator=generator)
    return poses[:, chosen] + spread * torch.randn(len(poses), count, 3, generator=generator)


def meshes_of(mesh: tuple[Tensor, Tensor], poses: Tensor, copies: int | None = None) -> PosedMeshBatch:
    meshes = PosedMeshBatch(*mesh, copies or len(poses))
    meshes.update(poses)
    return meshes


def assert_same(planes: Planes, others: Planes) -> None:
    assert torch.equal(planes.offsets, others.offsets)
    assert torch.equal(planes.normals, others.normals)


@pytest.mark.parametrize("mesh", [ball(), limbs()], ids=["ball", "crossing limbs"])
@pytest.mark.parametrize("copies", [4, 7])
def test_planes_are_those_of_each_pose_alone(mesh: tuple[Tensor, Tensor], copies: int) -> None:
    poses = posed(mesh[0], 4)
    points = around(poses, 700, 0.02)
    planes = meshes_of(mesh, poses, copies).planes(points, NEAR)
    distance = planes.distance(points)
    for pose, cloth, normals, found in zip(poses, points, planes.normals, distance, strict=True):
        alone = BodySurface(pose, mesh[1]).closest(cloth)
        touched = alone.signed_distance < NEAR
        assert 100 < int(touched.sum()) < 600
        assert torch.equal(found < 1.0, touched)
        torch.testing.assert_close(found[touched], alone.signed_distance[touched], atol=1e-6, rtol=0)
        torch.testing.assert_close(normals[touched], alone.normals[touched], atol=1e-3, rtol=0)


def test_points_outside_touch_nothing_and_those_deep_inside_do() -> None:
    mesh = ball()
    meshes = meshes_of(mesh, mesh[0][None])
    heights = torch.tensor([0.0, 0.1, 0.15 + 0.9 * NEAR, 0.15 + 1.1 * NEAR, 0.5, 5.0])
    points = heights[:, None] * torch.nn.functional.normalize(mesh[0][10], dim=0)
    planes = meshes.planes(points[None], NEAR)
    assert (planes.offsets[0] > FREE).tolist() == [True, True, True, False, False, False]
    assert planes.normals[0, 3:].abs().max() == 0.0
    assert planes.distance(points[None])[0, 3:].min() > 1e5
    lacking = planes.distance(points[None])[0, 1:3]
    torch.testing.assert_close(lacking, heights[1:3] - 0.15, atol=1e-3, rtol=0)


def test_the_plane_of_a_corner_is_tangent_at_the_nearest_vertex_of_the_closest_face() -> None:
    mesh = ball()
    poses = posed(mesh[0], 3)
    points = around(poses, 500, 0.01)
    meshes = meshes_of(mesh, poses, 5)
    planes, usual = meshes.planes(points, NEAR, corner=True), meshes.planes(points, NEAR)
    assert torch.equal(planes.offsets > FREE, usual.offsets > FREE)
    for pose, cloth, offsets, normals in zip(poses, points, planes.offsets, planes.normals, strict=True):
        touched = offsets > FREE
        faces = mesh[1][BodySurface(pose, mesh[1]).closest(cloth).faces[touched]]
        apart = (pose[faces] - cloth[touched, None]).norm(dim=2)
        nearest = faces.gather(1, apart.argmin(1, keepdim=True)).squeeze(1)
        expected = vertex_normals(pose, mesh[1])[nearest]
        # On an edge or at a vertex, several faces are the closest and any of them may be taken.
        alone = apart.sort(1).values.diff(dim=1)[:, 0] > 1e-6
        same = (normals[touched] - expected).norm(dim=1) < 1e-4
        assert same[alone].float().mean() > 0.99
        torch.testing.assert_close(offsets[touched][same], (expected * pose[nearest]).sum(1)[same])


@pytest.mark.parametrize("corner", [False, True], ids=["surface", "corner"])
@pytest.mark.parametrize("mesh", [ball(), limbs()], ids=["ball", "crossing limbs"])
def test_a_visit_changes_nothing_that_is_found(mesh: tuple[Tensor, Tensor], corner: bool) -> None:
    """Random walks of every length, with points on edges and at vertices among them."""
    poses = posed(mesh[0], 3)
    meshes = meshes_of(mesh, poses)
    points = around(poses, 1500, 0.05)
    cache = empty_cache(3, 1500, CPU)
    generator = torch.Generator().manual_seed(1)
    sizes = [0.0, *torch.logspace(-4, -1, 12).tolist(), 0.0, 0.01, 1e-3]
    for size in sizes:
        points = points + size * torch.randn(points.shape, generator=generator)
        points[:, :50] = poses[:, mesh[1][:50]].mean(2)
        points[:, 50:100] = poses[:, mesh[1][:50, :2]].mean(2)
        points[:, 100:150] = poses[:, :50] * 1.001
        assert_same(meshes.planes(points, NEAR, cache, corner), meshes.planes(points, NEAR, corner=corner))


def test_a_visit_spares_what_moved_less_than_it_was_away() -> None:
    mesh = ball()
    meshes, cache = meshes_of(mesh, mesh[0][None]), empty_cache(1, 3, CPU)
    direction = torch.nn.functional.normalize(mesh[0][10], dim=0)
    points = torch.tensor([[0.15], [0.2], [1.0]])[None] * direction
    meshes.planes(points, NEAR, cache)
    assert torch.equal(cache.points, points)
    expected = torch.tensor([[0.0, 0.05, SEARCH_DISTANCE]])
    torch.testing.assert_close(cache.clearance, expected, atol=1e-4, rtol=0)
    moved = points - 0.03 * direction
    meshes.planes(moved, NEAR, cache)
    assert torch.equal(cache.points, torch.stack([moved[0, 0], points[0, 1], points[0, 2]])[None])
    assert cache.clearance[0].tolist() == pytest.approx([-0.03, 0.05, SEARCH_DISTANCE], abs=3e-4)
    meshes.planes(moved - 0.03 * direction, NEAR, cache)
    assert cache.clearance[0].tolist() == pytest.approx([-0.06, -0.01, SEARCH_DISTANCE], abs=1e-3)


def test_a_visit_that_remembers_wrongly_is_believed() -> None:
    """What a cache spares is really not looked up: a point said to be far away is not found inside."""
    mesh = ball()
    meshes, points = meshes_of(mesh, mesh[0][None]), torch.zeros(1, 2, 3)
    cache = ClosestPointCache(points.clone(), torch.tensor([[1.0, -0.15]]))
    assert (meshes.planes(points, NEAR, cache).offsets > FREE).tolist() == [[False, True]]
