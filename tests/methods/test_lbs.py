import torch

from tests.train.simulated import swaying
from uvcloth.bodies.body import load_body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.methods.registry import load_method
from uvcloth.rollouts.rollout import rollout


def test_a_rigid_motion_carries_the_garment_exactly():
    body = load_body()
    garment = fit_template("tops", body)
    turn = torch.tensor([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    rigid = torch.cat([turn, torch.tensor([[1.0], [2.0], [3.0]])], dim=1)
    motion = rigid.expand(2, len(body.skeleton.names), 3, 4)
    expected = garment.mesh.vertices @ turn.T + rigid[:, 3]
    for name in ("lbs", "lbs_smooth"):
        for frame in rollout(load_method(name, body), Outfit(body, (garment,)), motion, 30.0, clear=False):
            torch.testing.assert_close(frame.vertices[0], expected, atol=1e-5, rtol=0.0)


def test_lbs_follows_the_closest_body_vertices():
    body = load_body()
    garment = fit_template("tops", body)
    motion = swaying(3, seed=0).transforms()
    some = torch.arange(0, len(garment.mesh.vertices), 20)
    points = garment.mesh.vertices[some]
    nearest = torch.cdist(points.double(), body.mesh.vertices.double()).argmin(1)
    expected = skin(points, body.weights[nearest], motion)
    frames = rollout(load_method("lbs", body), Outfit(body, (garment,)), motion, 30.0, clear=False)
    vertices = torch.stack([frame.vertices[0][some] for frame in frames])
    torch.testing.assert_close(vertices, expected, atol=1e-5, rtol=0.0)


def test_smooth_weights_stretch_edges_less():
    body = load_body()
    garment = fit_template("dress", body)
    motion = swaying(20, seed=0).transforms()
    faces, rest = garment.mesh.faces, garment.mesh.vertices
    strain = {}
    for name in ("lbs", "lbs_smooth"):
        method = load_method(name, body)
        frames = list(rollout(method, Outfit(body, (garment,)), motion, 30.0, clear=False))
        vertices = torch.stack([frame.vertices[0] for frame in frames])
        length = (vertices[:, faces[:, 0]] - vertices[:, faces[:, 1]]).norm(dim=2)
        rest_length = (rest[faces[:, 0]] - rest[faces[:, 1]]).norm(dim=1)
        strain[name] = (length / rest_length - 1).abs().max()
    assert strain["lbs_smooth"] < strain["lbs"]
