"""Faces of coarse garments: no skin shows through them, and nothing else moves."""

import math

import pytest
import torch

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.face_contact import FACE_CLEARANCE, FaceContact
from uvcloth.physics.surface import BodySurface

SIDES, RINGS = 6, 3


def tube(body: Body, loose: float, region: str = "thigh") -> Mesh:
    """A tube of 24 triangles around the left thigh: vertices outside of the skin, faces that cut it."""
    limb = (body.regions == REGIONS.index(region)) & (body.sides > 0)
    points = body.mesh.vertices[body.mesh.faces[limb]].reshape(-1, 3)
    low, high = torch.quantile(points[:, 2], torch.tensor([0.25, 0.6])).tolist()
    rings = []
    for height in torch.linspace(low, high, RINGS).tolist():
        ring = points[(points[:, 2] - height).abs() < 0.015]
        centre = ring.mean(0)
        radius = float((ring - centre)[:, :2].norm(dim=1).max()) + loose
        angles = torch.arange(SIDES) * (2 * math.pi / SIDES)
        around = torch.stack([angles.cos(), angles.sin(), 0 * angles], dim=1) * radius
        rings.append(centre + around)
    at = torch.arange(SIDES)
    after = (at + 1) % SIDES
    faces = [
        torch.stack([first + ring * SIDES for first in triangle], dim=1)
        for ring in range(RINGS - 1)
        for triangle in ((at, after, after + SIDES), (at, after + SIDES, at + SIDES))
    ]
    none = torch.zeros(0, 3, dtype=torch.int64)
    return Mesh(torch.cat(rings), torch.cat(faces), torch.zeros(0, 2), none)


def on_faces(vertices: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """Points all over the faces, by another rule than the one that is tested."""
    steps = [(a, b, 12 - a - b) for a in range(13) for b in range(13 - a)]
    weights = torch.tensor(steps, dtype=torch.float32) / 12
    return torch.einsum("pk,fkd->fpd", weights, vertices[faces]).reshape(-1, 3)


@pytest.fixture(scope="module")
def skin(body: Body) -> BodySurface:
    return BodySurface(body.mesh.vertices, body.mesh.faces)


def test_skin_comes_out_of_no_face_though_every_vertex_was_outside(body: Body, skin: BodySurface) -> None:
    mesh = tube(body, 0.002)
    assert float(skin.closest(mesh.vertices).signed_distance.min()) > 0
    before = skin.closest(on_faces(mesh.vertices, mesh.faces)).signed_distance
    assert float((before < 0).float().mean()) > 0.05
    (after,) = FaceContact(body, [mesh], [True]).resolve([mesh.vertices], body.mesh.vertices)
    lying = skin.closest(on_faces(after, mesh.faces)).signed_distance
    assert float(lying.min()) > -0.0005
    # No farther than what lacked, though each face moves with its corners.
    assert float((after - mesh.vertices).norm(dim=1).max()) < 2.0 * float(-before.min()) + FACE_CLEARANCE


def test_what_is_clear_of_the_skin_and_what_is_not_coarse_stay(body: Body) -> None:
    wide, tight = tube(body, 0.06, "calf"), tube(body, 0.002)
    (after,) = FaceContact(body, [wide], [True]).resolve([wide.vertices], body.mesh.vertices)
    assert torch.equal(after, wide.vertices)
    (after,) = FaceContact(body, [tight], [False]).resolve([tight.vertices], body.mesh.vertices)
    assert torch.equal(after, tight.vertices)


def test_an_outer_garment_s_faces_keep_off_an_inner_one(body: Body) -> None:
    inner, outer = tube(body, 0.02, "calf"), tube(body, 0.023, "calf")
    centre = outer.vertices.mean(0)
    # Turned by half a side, the corners of the inner one come through the faces of the outer one.
    angle = math.pi / SIDES
    turn = torch.tensor(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    )
    turned = Mesh((outer.vertices - centre) @ turn.T + centre, outer.faces, outer.uvs, outer.face_uvs)
    shell = BodySurface(inner.vertices, inner.faces)
    contact = FaceContact(body, [inner, turned], [False, True])
    _, after = contact.resolve([inner.vertices, turned.vertices], body.mesh.vertices)
    height = (turned.vertices[:, 2].min() + 0.02, turned.vertices[:, 2].max() - 0.02)

    def inside(vertices: torch.Tensor) -> float:
        points = on_faces(vertices, turned.faces)
        points = points[(points[:, 2] > height[0]) & (points[:, 2] < height[1])]
        return float((shell.closest(points).signed_distance < 0).float().mean())

    assert inside(turned.vertices) > 0.1
    assert inside(after) < 0.2 * inside(turned.vertices)
    lack = FACE_CLEARANCE - float(
        shell.closest(on_faces(turned.vertices, turned.faces)).signed_distance.min()
    )
    assert float((after - turned.vertices).norm(dim=1).max()) < 2.0 * lack


def test_vertices_doubled_at_a_seam_stay_together(body: Body) -> None:
    mesh = tube(body, 0.002)
    soup = Mesh(
        mesh.vertices[mesh.faces].reshape(-1, 3),
        torch.arange(3 * len(mesh.faces)).view(-1, 3),
        mesh.uvs,
        mesh.face_uvs,
    )
    (whole,) = FaceContact(body, [mesh], [True]).resolve([mesh.vertices], body.mesh.vertices)
    (split,) = FaceContact(body, [soup], [True]).resolve([soup.vertices], body.mesh.vertices)
    torch.testing.assert_close(split, whole[mesh.faces].reshape(-1, 3), atol=1e-5, rtol=0)
