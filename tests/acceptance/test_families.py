"""Garments that were modelled on bodies of other families are worn, and transferred with their ease."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from tests.acceptance.families import MadeUp, made_up, written
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
    [("smpl", "tops", 0.03), ("vroid", "bottoms", 0.04), ("doll", "shirt", 0.03)],
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


@pytest.mark.parametrize(("family", "template"), [("vroid", "tops")])
def test_a_garment_is_transferred_with_its_ease(
    family: str, template: str, body: Body, tmp_path: Path
) -> None:
    """Another mesh of the other body, whose scale is the only one that the ease and the edges have."""
    garment, other = _with_another_mesh(made_up(family, template, body))
    transferred = transfer(garment, written(other, tmp_path / "body.obj"), body)
    scale = transferred.alignment.scale
    before = distances(garment.vertices * scale, Mesh(other.vertices * scale, other.faces, *_BARE))
    after = distances(transferred.mesh.vertices, body.mesh)
    assert float(after.min()) > 0.0
    assert float(((after / before - 1.0).abs() < 0.3).float().mean()) > 0.95
    assert float(((transferred.settled.stretch - 1.0).abs() < 0.1).float().mean()) > 0.8
    ours = fit_template(template, body).mesh.vertices
    assert float((transferred.mesh.vertices - ours).norm(dim=1).mean()) < 0.04


_BARE = torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64)


def _with_another_mesh(made: MadeUp) -> tuple[Mesh, Mesh]:
    """The garment, and the body with other vertices: the middles of the edges and faces of the old ones."""
    vertices, faces = made.body.vertices, made.body.faces
    middles = vertices[faces].mean(1)
    corners = torch.arange(len(faces)) + len(vertices)
    split = torch.cat([torch.stack([faces[:, k], faces[:, (k + 1) % 3], corners], 1) for k in range(3)])
    turned = torch.randperm(len(vertices) + len(faces), generator=torch.Generator().manual_seed(0))
    place = torch.argsort(turned)
    return made.garment, Mesh(torch.cat([vertices, middles])[turned], place[split], *_BARE)
