"""The networks in the package."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from tests.wrinkles.in_torch import WrinkledInTorch
from uvcloth.bodies.body import Body, load_body
from uvcloth.checkpoint import load_checkpoint
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.refined import Refined
from uvcloth.garments.templates import fit_template
from uvcloth.physics.surface import BodySurface
from uvcloth.wrinkles.model import SHIPPED, load_wrinkles, shipped_for
from uvcloth.wrinkles.outfit import WrinkledOutfit


@pytest.mark.parametrize("folder", sorted(SHIPPED.iterdir()), ids=lambda folder: folder.name)
def test_it_is_small_and_no_person_is_in_two_splits(folder: Path, body: Body) -> None:
    assert sum(file.stat().st_size for file in folder.iterdir()) < 1.5e6
    clips = load_checkpoint(folder).data.clips
    assert len(clips["train"]) > 20
    assert not {*clips["train"].values()} & {*clips["validation"].values()}
    assert load_wrinkles(folder).config.garments == (folder.name,)


def test_the_outermost_garment_chooses_the_network(body: Body, shirt: Garment) -> None:
    trousers, long = (fit_template(name, body) for name in ("bottoms", "shirt"))
    assert shipped_for(Outfit(body, (shirt, long, trousers))).name == "shirt"
    assert shipped_for(Outfit(body, (long, shirt))).name == "tops"
    assert shipped_for(Outfit(body, (trousers,))).name == "tops"


def test_a_file_is_served_on_the_texture_coordinates_of_the_template_alone(shirt: Garment) -> None:
    """Whatever the order of its faces; the networks know where on the sheet a fold is."""
    wrinkles = load_wrinkles(SHIPPED / "tops")
    turned = replace(shirt.mesh, faces=shirt.mesh.faces.flip(0), face_uvs=shirt.mesh.face_uvs.flip(0))
    assert wrinkles.unsupported_reason(replace(shirt, source="file", mesh=turned), "default") == ""
    mirrored = replace(shirt.mesh, uvs=1.0 - shirt.mesh.uvs)
    reason = wrinkles.unsupported_reason(replace(shirt, source="file", mesh=mirrored), "default")
    assert "texture coordinates of the template tops, which it does not have" in reason


def squeezed(vertices: Tensor, share: float) -> Tensor:
    """A T-shirt of which the part below the arms is squeezed along its height."""
    waist = float(vertices[:, 2].mean())
    height = torch.where(vertices[:, 2] < waist, waist + share * (vertices[:, 2] - waist), vertices[:, 2])
    return torch.cat([vertices[:, :2], height[:, None]], dim=1)


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


@pytest.fixture(scope="module")
def shirt(body: Body) -> Garment:
    return fit_template("tops", body)


def test_a_raised_hem_folds(body: Body, shirt: Garment) -> None:
    """The T-shirt is squeezed by a fifth along its height below the arms: folds appear, of millimetres."""
    wrinkles = load_wrinkles(SHIPPED / "tops")
    assert wrinkles.unsupported_reason(shirt, "default") == ""
    wrinkled = WrinkledOutfit(wrinkles, Outfit(body, (shirt,)), [shirt.mesh], "default")
    refined = Refined.of(shirt.mesh)

    def offsets(vertices: Tensor) -> Tensor:
        wrinkled.begin()
        (shown,) = wrinkled.shown((vertices,), body.mesh.vertices, 30.0)
        return shown - refined.at(vertices)

    made = offsets(squeezed(shirt.mesh.vertices, 0.8))
    assert torch.isfinite(made).all()
    waist = float(shirt.mesh.vertices[:, 2].mean())
    change = (made - offsets(shirt.mesh.vertices)).norm(dim=1)
    assert 5e-4 < float(change[refined.mesh.vertices[:, 2] < waist - 0.03].mean()) < 0.03


def test_the_runtime_shows_what_the_network_makes_in_pytorch(body: Body, shirt: Garment) -> None:
    """Within 0.02 mm but for one vertex of a thousand, where the sides of skin that folds differ."""
    wrinkles = load_wrinkles(SHIPPED / "tops")
    reference = WrinkledInTorch(wrinkles, shirt)
    runtime = WrinkledOutfit(wrinkles, Outfit(body, (shirt,)), [shirt.mesh], "default")
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    for frame in range(4):
        vertices = squeezed(shirt.mesh.vertices, 1.0 - 0.03 * frame)
        expected = reference.wrinkled(vertices, 30.0, surface)
        (shown,) = runtime.shown((vertices,), body.mesh.vertices, 30.0)
        apart = (shown - expected).norm(dim=1)
        assert float((apart < 2e-5).float().mean()) > 0.999
        assert float(apart.mean()) < 5e-6
