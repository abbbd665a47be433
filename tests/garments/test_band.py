"""What holds garments up: the rule for files gives the templates' bands, and says what it cannot hold."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.band import TEMPLATE_MASS, holding_band
from uvcloth.garments.garment import Garment
from uvcloth.garments.loading import load_garment
from uvcloth.garments.templates import fit_template, load_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.writers.obj import save_obj

SKIRT = str(files("uvcloth") / "data" / "garments" / "miniskirt.obj")


@pytest.fixture(scope="module")
def shirt(body: Body) -> Garment:
    """The T-shirt as if it came from a file."""
    return replace(fit_template("tops", body), name="shirt", source="file")


@pytest.fixture(scope="module")
def trousers(body: Body) -> Garment:
    return replace(fit_template("bottoms", body), name="trousers", source="file")


def moved(garment: Garment, faces: torch.Tensor) -> Garment:
    return replace(garment, mesh=replace(garment.mesh, faces=faces, face_uvs=faces))


def test_templates_hang_by_their_own_bands(body: Body) -> None:
    band = holding_band(fit_template("dress", body), body)
    assert torch.equal(band.vertices, load_template("dress").band)
    assert band.mass == TEMPLATE_MASS["dress"]


def test_the_rule_for_files_agrees_with_the_templates(body: Body, shirt: Garment, trousers: Garment) -> None:
    waist = holding_band(trousers, body)
    assert torch.equal(waist.vertices, load_template("bottoms").band)
    assert waist.mass == pytest.approx(TEMPLATE_MASS["bottoms"], rel=0.1)
    neck = holding_band(shirt, body)
    assert int((neck.vertices != load_template("tops").band).sum()) <= 5
    assert TEMPLATE_MASS["tops"] < neck.mass < 1.5 * TEMPLATE_MASS["tops"]


def test_a_file_that_is_named_as_its_template_hangs_by_its_own_hem(body: Body, shirt: Garment) -> None:
    named = replace(shirt, template="shirt")
    assert torch.equal(holding_band(named, body).vertices, holding_band(shirt, body).vertices)


def test_a_file_of_a_template_by_its_name_hangs_by_its_own_hem(body: Body, tmp_path: Path) -> None:
    """The same faces under the same name are no sign that a mesh lies where the template does."""
    mesh = fit_template("tops", body).mesh
    save_obj(mesh, tmp_path / "tops.obj")
    worn = load_garment(str(tmp_path / "tops.obj"), body)
    assert (worn.name, worn.template, worn.source) == ("tops", "tops", "file")
    assert torch.equal(worn.mesh.faces, mesh.faces)
    assert holding_band(worn, body).mass != TEMPLATE_MASS["tops"]


def test_a_template_hangs_by_its_own_band_whatever_its_name(body: Body) -> None:
    band = holding_band(replace(fit_template("dress", body), name="gown"), body)
    assert torch.equal(band.vertices, load_template("dress").band)


def test_a_garment_without_template_hangs_by_its_hem(body: Body, shirt: Garment) -> None:
    bare = replace(shirt, template=None)
    assert torch.equal(holding_band(bare, body).vertices, holding_band(shirt, body).vertices)


def test_a_skirt_hangs_by_its_waist(body: Body) -> None:
    skirt = load_garment(SKIRT, body)
    heights = skirt.mesh.vertices[:, 2]
    held = holding_band(skirt, body).vertices
    assert float(heights[held].min()) > float(heights.max()) - 0.03
    assert float(heights[~held].max()) < float(heights.max()) - 0.02


def test_a_mesh_that_is_cut_at_seams_hangs_as_the_whole_one(body: Body, trousers: Garment) -> None:
    mesh = trousers.mesh
    corners = torch.arange(3 * len(mesh.faces)).reshape(-1, 3)
    cut = replace(trousers, mesh=Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), corners, mesh.uvs, corners))
    whole, parts = holding_band(trousers, body), holding_band(cut, body)
    assert torch.equal(parts.vertices, whole.vertices[mesh.faces].reshape(-1))
    assert parts.mass == pytest.approx(whole.mass)


def test_an_open_jacket_hangs_by_its_neck_not_by_its_bottom(body: Body, shirt: Garment) -> None:
    mesh = shirt.mesh
    centres = mesh.vertices[mesh.faces].mean(1)
    front = (centres[:, 0].abs() < 0.03) & (centres[:, 1] < centres[:, 1].median())
    held = mesh.vertices[holding_band(moved(shirt, mesh.faces[~front]), body).vertices]
    assert float(held[:, 2].min()) > float(mesh.vertices[:, 2].max()) - 0.25
    assert len(held) > 85


def test_separate_pieces_hang_each_by_its_own_hem(body: Body, trousers: Garment) -> None:
    mesh = trousers.mesh
    centres = mesh.vertices[mesh.faces].mean(1)
    low = centres[:, 2] < -0.4
    held = holding_band(moved(trousers, mesh.faces[low | (centres[:, 2] > 0.0)]), body).vertices
    below = held & (mesh.vertices[:, 2] < -0.3)
    assert bool((below & (mesh.vertices[:, 0] > 0)).any())
    assert bool((below & (mesh.vertices[:, 0] < 0)).any())


def test_what_has_no_hem_at_its_top_is_refused(body: Body, trousers: Garment) -> None:
    corners = torch.tensor([[0.0, 0.0, 0.2], [0.1, 0.0, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    closed = replace(trousers, mesh=Mesh(corners, faces, corners[:, :2], faces))
    with pytest.raises(
        InputError, match="garment trousers: cannot be simulated, a piece of it has no open hem that"
    ):
        holding_band(closed, body)
    with pytest.raises(InputError, match=r"no open hem within 0\.10 m of its top"):
        holding_band(moved(closed, faces[:3]), body)
