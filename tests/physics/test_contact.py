"""Contact against analytic bodies (a sphere, two crossing limbs) and on the default body."""

import pytest
import torch
import trimesh
from torch import Tensor

from uvcloth.bodies.body import load_body
from uvcloth.mesh import unique_edges
from uvcloth.physics.contact import PATCH, BodySurface, Smoother, inside_share, resolve


def tensors(mesh: trimesh.Trimesh) -> tuple[Tensor, Tensor]:
    return torch.tensor(mesh.vertices, dtype=torch.float32), torch.tensor(mesh.faces, dtype=torch.int64)


def crossing_limbs() -> BodySurface:
    """Two ellipsoids 1 m long and 0.2 m thick, one along z and one along x, that cross at the origin."""
    upright, across = trimesh.creation.icosphere(5), trimesh.creation.icosphere(5)
    upright.apply_scale([0.1, 0.1, 0.5])
    across.apply_scale([0.5, 0.1, 0.1])
    return BodySurface(*tensors(trimesh.util.concatenate([upright, across])))


def test_closest_points_of_a_sphere_follow_its_formula():
    surface = BodySurface(*tensors(trimesh.creation.icosphere(5, radius=0.3)))
    points = torch.nn.functional.normalize(torch.randn(1200, 3, generator=torch.manual_seed(0)), dim=1)
    radius = torch.linspace(0.15, 0.45, 1200)
    found = surface.closest(points * radius[:, None])
    torch.testing.assert_close(found.signed_distance, radius - 0.3, atol=3e-4, rtol=0)
    assert (found.normals * points).sum(1).min() > 0.999
    corners = surface.corners(found.faces)
    torch.testing.assert_close((corners * found.barycentrics[..., None]).sum(1), found.points)


def test_what_is_out_of_reach_has_no_face():
    surface = BodySurface(*tensors(trimesh.creation.icosphere(2, radius=0.3)))
    found = surface.closest(torch.tensor([[0.0, 0.0, 0.9]]), max_distance=0.1)
    assert found.faces.item() == -1
    assert found.signed_distance.item() == pytest.approx(0.1)


def test_an_updated_surface_answers_at_its_new_place():
    vertices, faces = tensors(trimesh.creation.icosphere(4, radius=0.3))
    surface = BodySurface(vertices, faces)
    surface.update(vertices + torch.tensor([1.0, 0.0, 0.0]))
    distance = surface.closest(torch.tensor([[1.0, 0.0, 0.31], [0.0, 0.0, 0.31]]), max_distance=0.05)
    torch.testing.assert_close(distance.signed_distance, torch.tensor([0.01, 0.05]), atol=1e-3, rtol=0)


def test_the_winding_number_counts_the_parts_around_a_point():
    points = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 0.4], [0.4, 0.0, 0.03], [0.3, 0.3, 0.3]])
    directions = torch.randn(4, 3, generator=torch.manual_seed(1))
    assert crossing_limbs().winding(points, directions).tolist() == [2, 1, 1, 0]


def test_swallowed_faces_lie_where_the_body_crosses_itself():
    surface = crossing_limbs()
    swallowed = surface.swallowed()
    centres = surface.corners(torch.arange(len(swallowed))).mean(1)
    upright, across = (
        (centres / torch.tensor(axes)).norm(dim=1) for axes in ([0.1, 0.1, 0.5], [0.5, 0.1, 0.1])
    )
    within = torch.minimum(upright, across) < 0.9
    far = centres.norm(dim=1) > 0.1 * 2**0.5 + 3 * PATCH
    assert within.any()
    assert swallowed[within].all()
    assert not swallowed[far].any()


def test_a_sheet_pushed_into_a_sphere_comes_out_smoothly():
    surface = BodySurface(*tensors(trimesh.creation.icosphere(5, radius=0.3)))
    x, y = torch.meshgrid(*[torch.linspace(-0.3, 0.3, 41)] * 2, indexing="ij")
    sheet = torch.stack([x.flatten(), y.flatten(), torch.full((41 * 41,), 0.28)], dim=1)
    index = torch.arange(41 * 41).view(41, 41)
    a, b, c, d = (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    faces = torch.cat([torch.stack([i.flatten() for i in t], dim=1) for t in ((a, b, c), (a, c, d))])
    resolved, contacts = resolve(sheet, surface, Smoother(sheet, faces))
    assert contacts.inside_before > 50
    assert contacts.inside_after == 0
    assert contacts.in_conflict == 0
    assert resolved.norm(dim=1).min() > 0.3 - 5e-4
    edges = unique_edges(faces)
    before, after = ((v[edges[:, 0]] - v[edges[:, 1]]).norm(dim=1) for v in (sheet, resolved))
    assert (after / before).max() < 1.25
    aside = sheet[:, :2].norm(dim=1) > 0.25
    torch.testing.assert_close(resolved[aside], sheet[aside], atol=1e-3, rtol=0)


def test_vertices_at_one_place_stay_together():
    surface = BodySurface(*tensors(trimesh.creation.icosphere(4, radius=0.3)))
    sheet = trimesh.creation.box((0.4, 0.4, 0.02)).subdivide().subdivide().subdivide()
    sheet.apply_translation([0, 0, 0.29])
    corners = torch.tensor(sheet.triangles.reshape(-1, 3), dtype=torch.float32)
    faces = torch.arange(len(corners)).view(-1, 3)
    resolved, contacts = resolve(corners, surface, Smoother(corners, faces))
    assert contacts.inside_before > 0
    _, place = torch.unique(corners, dim=0, return_inverse=True)
    for axis in range(3):
        highest = torch.zeros(int(place.max()) + 1).scatter_reduce(
            0, place, resolved[:, axis], "amax", include_self=False
        )
        torch.testing.assert_close(resolved[:, axis], highest[place], atol=1e-6, rtol=0)


def test_cloth_is_left_calm_where_the_body_intersects_itself():
    surface = crossing_limbs()
    angle = torch.linspace(0, 2 * torch.pi, 65)[:-1]
    heights = torch.linspace(-0.4, 0.4, 41)[:, None].expand(-1, 64)
    radius = 0.09 * (1 - (heights / 0.5) ** 2).sqrt()
    tube = torch.stack([radius * angle.cos(), radius * angle.sin(), heights], dim=-1).reshape(-1, 3)
    index = torch.arange(len(tube)).view(41, 64)
    a, b = index[:-1], index[1:]
    c, d = b.roll(-1, 1), a.roll(-1, 1)
    faces = torch.cat([torch.stack([i.flatten() for i in t], dim=1) for t in ((a, d, b), (b, d, c))])
    resolved, contacts = resolve(tube, surface, Smoother(tube, faces))
    outside = tube[:, 2].abs() > 0.1 + 3 * PATCH
    assert contacts.in_conflict > 100
    assert contacts.deepest < 1e-3
    assert (resolved[outside] / torch.tensor([0.1, 0.1, 0.5])).norm(dim=1).min() > 0.999
    raw, without_conflict = inside_share(resolved, surface)
    assert raw > 5
    assert without_conflict == 0
    step = (resolved - tube).norm(dim=1)
    assert step.max() < 0.015


def test_the_default_body_at_rest_has_clean_clothes_and_no_conflict_in_trunk_or_limbs():
    body = load_body()
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    suit = body.proxies["tights"]
    assert inside_share(suit.vertices, surface) == (0.0, 0.0)
    assert inside_share(suit.vertices + torch.tensor([0.0, 0.05, 0.0]), surface)[0] > 20
    resolved, contacts = resolve(suit.vertices, surface, Smoother(suit.vertices, suit.faces))
    assert contacts.in_conflict == 0
    assert (resolved - suit.vertices).norm(dim=1).max() < 2e-3


def test_the_number_of_threads_changes_no_answer():
    surface = crossing_limbs()
    points = 0.3 * torch.randn(2001, 3, generator=torch.manual_seed(2))
    threads = torch.get_num_threads()
    answers = []
    for count in (1, 3):
        torch.set_num_threads(count)
        found = surface.closest(points)
        answers.append((found.signed_distance, found.faces, surface.winding(points, found.normals + 1e-3)))
    torch.set_num_threads(threads)
    assert all(torch.equal(one, other) for one, other in zip(*answers, strict=True))
