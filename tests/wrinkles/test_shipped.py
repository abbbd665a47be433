"""The network in the package."""

import torch

from uvcloth.bodies.body import load_body
from uvcloth.checkpoint import load_checkpoint
from uvcloth.garments.templates import fit_template
from uvcloth.physics.surface import BodySurface
from uvcloth.wrinkles.model import SHIPPED, WrinkledGarment, load_wrinkles


def test_it_is_small_and_no_person_is_in_two_splits() -> None:
    assert sum(file.stat().st_size for file in SHIPPED.iterdir()) < 3e6
    clips = load_checkpoint(SHIPPED).data.clips
    assert len(clips["train"]) > 20
    assert not {*clips["train"].values()} & {*clips["validation"].values()}


def test_a_raised_hem_folds() -> None:
    """The T-shirt is squeezed by a fifth along its height below the arms: folds appear, of millimetres."""
    body = load_body()
    garment = fit_template("tops", body)
    wrinkles = load_wrinkles(SHIPPED, body)
    assert wrinkles.unsupported_reason(garment, "default") == ""
    skin = BodySurface(body.mesh.vertices, body.mesh.faces)
    vertices = garment.mesh.vertices.clone()
    waist = float(vertices[:, 2].mean())
    low = vertices[:, 2] < waist
    vertices[low, 2] = waist + 0.8 * (vertices[low, 2] - waist)
    wrinkled = WrinkledGarment(wrinkles, garment)
    offsets = wrinkled.wrinkled(vertices, 30.0, skin) - wrinkled.sheet.refined.at(vertices)
    wrinkled.begin()
    at_rest = wrinkled.wrinkled(garment.mesh.vertices, 30.0, skin)
    rest_offsets = at_rest - wrinkled.sheet.refined.at(garment.mesh.vertices)
    assert torch.isfinite(offsets).all()
    below = wrinkled.mesh.vertices[:, 2] < waist - 0.03
    change = (offsets - rest_offsets).norm(dim=1)
    assert 5e-4 < float(change[below].mean()) < 0.03
