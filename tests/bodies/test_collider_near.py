"""The part of a body near a garment is one closed surface that has all of the skin nearby, and moves."""

from itertools import product

import pytest
import torch
import trimesh

from tests.thorough import always
from tests.train.simulated import swaying
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import collider_near
from uvcloth.errors import InputError
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.physics.surface import BodySurface


@pytest.mark.parametrize(
    ("name", "reach"),
    always(
        [("tops", 0.2), ("bottoms", 0.02), ("dress", 0.2)], product(["tops", "bottoms", "dress"], [0.02, 0.2])
    ),
)
def test_it_is_closed_in_every_pose_and_contains_what_is_near(name: str, reach: float, body: Body) -> None:
    points = fit_template(name, body).mesh.vertices
    kept, collider = collider_near(body, points, reach)
    (part,) = collider.parts
    for posed in skin(body.mesh.vertices, body.weights, swaying(2, seed=3).transforms()):
        mesh = trimesh.Trimesh(collider.vertices(posed[kept]).numpy(), part.numpy(), process=False)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert 0.01 < mesh.volume < 0.1
    near = (torch.cdist(points, body.mesh.vertices) < reach - 1e-5).any(0)
    own = near[body.mesh.faces].all(1)
    skin_faces = part[(part < len(kept)).all(1)]
    rows = {tuple(face) for face in kept[skin_faces].tolist()}
    assert {tuple(face) for face in body.mesh.faces[own].tolist()} <= rows
    assert len(rows) < len(body.mesh.faces)
    assert len(kept.unique()) == len(kept)


def test_the_garment_is_as_far_from_it_as_from_the_body(body: Body) -> None:
    points = fit_template("tops", body).mesh.vertices
    kept, collider = collider_near(body, points, 0.2)
    near = BodySurface(collider.vertices(body.mesh.vertices[kept]), collider.parts[0]).closest(points)
    whole = BodySurface(body.mesh.vertices, body.mesh.faces).closest(points)
    torch.testing.assert_close(near.signed_distance, whole.signed_distance, atol=1e-6, rtol=0)


def test_a_body_out_of_reach_is_refused(body: Body) -> None:
    with pytest.raises(InputError, match=r"no part of it is within 0\.20 m of the garment"):
        collider_near(body, torch.tensor([[5.0, 0.0, 0.0]]), 0.2)
