"""Garments that were modelled on bodies of other families are worn, and transferred with their ease."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from tests.acceptance.families import FAMILIES, made_up, on_another_mesh, written
from uvcloth.bodies.body import Body
from uvcloth.garments.fit import read_on_body
from uvcloth.garments.templates import fit_template
from uvcloth.garments.transfer import transfer
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.surface import BodySurface


def distances(vertices: Tensor, body: Mesh) -> Tensor:
    """Signed distances (N,) of vertices from a body."""
    return BodySurface(body.vertices, body.faces).closest(vertices, 2.0).signed_distance


def asymmetry(vertices: Tensor) -> float:
    """Mean distance, m, between a garment and its mirror image."""
    every = vertices[:: max(1, len(vertices) // 800)]
    return float(torch.cdist(every * torch.tensor([-1.0, 1.0, 1.0]), vertices).amin(1).mean())


@pytest.mark.parametrize(
    ("family", "template", "most"),
    [
        pytest.param("vroid", "bottoms", 0.04, marks=pytest.mark.thorough),
        ("doll", "shirt", 0.03),
        pytest.param("smpl", "tops", 0.03, marks=pytest.mark.thorough),
        pytest.param("vroid_a", "shirt", 0.04, marks=pytest.mark.thorough),
    ],
)
def test_a_garment_of_another_body_is_worn_where_ours_would_be(
    family: str, template: str, most: float, body: Body, tmp_path: Path
) -> None:
    """The template on our own body is where the garment belongs."""
    ours = fit_template(template, body).mesh.vertices
    placed = read_on_body(written(made_up(family, template, body).garment, tmp_path / "it.obj"), body)
    found = placed.mesh.vertices
    assert float((found - ours).norm(dim=1).mean()) < most
    assert float(distances(found, body.mesh).min()) > 0.0
    assert 0.25 < float(distances(found, body.mesh).median() / distances(ours, body.mesh).median()) < 2.5
    assert asymmetry(found) < asymmetry(ours) + 0.012
    assert placed.diagnosis.placing is None
    assert "Y up, shift" in placed.diagnosis.lines()[1]


def test_a_waistband_that_lies_in_the_skin_settles_where_it_is(body: Body, tmp_path: Path) -> None:
    made = made_up("smpl", "skirt", body)
    placed = read_on_body(written(made.garment, tmp_path / "it.obj"), body)
    modelled = made.garment.vertices @ torch.tensor(FAMILIES["smpl"].axes)
    assert 0.01 < float((distances(modelled, body.mesh) < 0).float().mean()) < 0.05
    assert float(distances(placed.mesh.vertices, body.mesh).min()) > 0.0
    assert float((placed.mesh.vertices - modelled).norm(dim=1).mean()) < 0.02
    assert "settled on the skin" in placed.diagnosis.lines()[2]


@pytest.mark.parametrize(("family", "template"), [("vroid", "tops")])
def test_a_garment_is_transferred_with_its_ease(
    family: str, template: str, body: Body, tmp_path: Path
) -> None:
    """Another mesh of the other body, whose scale is the only one that the ease and the edges have."""
    made = made_up(family, template, body)
    garment, other = made.garment, on_another_mesh(made.body)
    transferred = transfer(garment, written(other, tmp_path / "body.obj"), body)
    scale = transferred.alignment.scale
    before = distances(garment.vertices * scale, replace(other, vertices=other.vertices * scale))
    after = distances(transferred.mesh.vertices, body.mesh)
    assert float(after.min()) > 0.0
    assert float(((after / before - 1.0).abs() < 0.3).float().mean()) > 0.95
    assert float(((transferred.settled.stretch - 1.0).abs() < 0.1).float().mean()) > 0.8
    ours = fit_template(template, body).mesh.vertices
    assert float((transferred.mesh.vertices - ours).norm(dim=1).mean()) < 0.04
