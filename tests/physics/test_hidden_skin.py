"""Skin under cloth is left out where cloth is close to it in every frame."""

import torch

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.garments.templates import fit_template
from uvcloth.physics.hidden_skin import HiddenSkin


def test_the_belly_under_a_shirt_is_hidden_and_the_head_is_not(body: Body) -> None:
    shirt = fit_template("tops", body).mesh
    hidden = HiddenSkin(body, [shirt])
    hidden.add([shirt.vertices], body.mesh.vertices)
    faces = hidden.faces()
    centres = body.mesh.vertices[body.mesh.faces].mean(1)
    torso = body.regions == REGIONS.index("torso")
    belly = torso & (centres[:, 2] - 0.4).abs().lt(0.1)
    assert faces[belly].float().mean() > 0.95
    assert not faces[centres[:, 2] > float(shirt.vertices[:, 2].max())].any()
    assert not faces[centres[:, 2] < float(shirt.vertices[:, 2].min())].any()
    # A shirt that is once pulled up shows the belly: it stays.
    hidden.add([shirt.vertices + torch.tensor([0.0, 0.0, 0.25])], body.mesh.vertices)
    low = torso & (centres[:, 2] < float(shirt.vertices[:, 2].min()) + 0.2)
    assert not hidden.faces()[low].any()
