"""Outfits in one file: told apart, ordered from the skin outwards, and whose motion each takes."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.commands.fit import Fit
from uvcloth.commands.run.fit import examine
from uvcloth.errors import InputError
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.garments.loading import load_garment_for_data, load_outfit
from uvcloth.garments.pieces import pieces
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.fabric import FABRICS
from uvcloth.writers.obj import save_obj


def joined(*meshes: Mesh) -> Mesh:
    """Meshes as one, their vertices one after another."""
    starts = [sum(len(mesh.vertices) for mesh in meshes[:index]) for index in range(len(meshes))]
    seams = [sum(len(mesh.uvs) for mesh in meshes[:index]) for index in range(len(meshes))]
    return Mesh(
        torch.cat([mesh.vertices for mesh in meshes]),
        torch.cat([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]),
        torch.cat([mesh.uvs for mesh in meshes]),
        torch.cat([mesh.face_uvs + start for mesh, start in zip(meshes, seams, strict=True)]),
    )


def test_an_outfit_in_one_file_is_told_apart_and_layered(body: Body, tmp_path: Path) -> None:
    tops, bottoms = (fit_template(name, body).mesh for name in ("tops", "bottoms"))
    front = int(tops.vertices[:, 1].argmin())
    corners = tops.vertices[front] + torch.tensor([[0.0, -0.004, 0], [0.01, -0.004, 0], [0, -0.004, 0.01]])
    face = torch.tensor([[0, 1, 2]])
    button = Mesh(corners, face, corners[:, [0, 2]], face)
    save_obj(joined(tops, button, bottoms), tmp_path / "suit.obj")
    heard: list[str] = []
    inner, outer = load_outfit([str(tmp_path / "suit.obj")], body, heard.append)
    assert (inner.name, inner.template) == ("suit_bottoms", "bottoms")
    assert (outer.name, outer.template) == ("suit_tops", "tops")
    torch.testing.assert_close(inner.mesh.vertices, bottoms.vertices)
    torch.testing.assert_close(outer.mesh.vertices, torch.cat([tops.vertices, corners]))
    assert torch.equal(inner.mesh.faces, bottoms.faces)
    corner = inner.mesh.uvs[inner.mesh.face_uvs]
    torch.testing.assert_close(corner, bottoms.uvs[bottoms.face_uvs])
    assert "3 separate pieces" in heard[0]
    assert [line.split(":")[0].strip() for line in heard[-2:]] == ["suit_bottoms", "suit_tops"]


def test_simulation_takes_one_garment_and_says_how_to_part_them(body: Body, tmp_path: Path) -> None:
    tops, bottoms = (fit_template(name, body).mesh for name in ("tops", "bottoms"))
    suit = tmp_path / "suit.obj"
    save_obj(joined(tops, bottoms), suit)
    with pytest.raises(InputError, match=r"suit\.obj: holds 2 garments, .* `uvcloth fit .*suit\.obj --out"):
        load_garment_for_data(str(suit), body)
    lines = examine(Fit(suit, out=tmp_path / "mine.obj", picture=None))
    parted = [tmp_path / "mine-bottoms.obj", tmp_path / "mine-tops.obj"]
    assert lines[-2:] == [str(path) for path in parted]
    for path, mesh in zip(parted, (bottoms, tops), strict=True):
        torch.testing.assert_close(read_mesh(path).vertices.float(), mesh.vertices, atol=1e-6, rtol=0)


def test_a_mesh_cut_at_seams_is_one_piece(body: Body) -> None:
    mesh = fit_template("tops", body).mesh
    corners = torch.arange(3 * len(mesh.faces)).reshape(-1, 3)
    cut = replace(mesh, vertices=mesh.vertices[mesh.faces].reshape(-1, 3), faces=corners)
    assert int(pieces(cut).max()) == 0


def test_templates_are_chosen_for_all_or_for_each(body: Body) -> None:
    garments = load_outfit(["bottoms", "shirt"], body, templates=("auto", "tops"))
    assert [garment.template for garment in garments] == ["bottoms", "tops"]
    with pytest.raises(InputError, match="--template: 2 for 1 garments"):
        load_outfit(["shirt"], body, templates=("tops", "tops"))


def test_fabrics_are_of_all_garments_or_of_each(body: Body) -> None:
    garments = load_outfit(["bottoms", "tops"], body, fabric=["denim", "silk"])
    assert [garment.fabric for garment in garments] == [FABRICS["denim"], FABRICS["silk"]]
    assert {garment.fabric for garment in load_outfit(["bottoms", "tops"], body, fabric=["silk"])} == {
        FABRICS["silk"]
    }
    with pytest.raises(InputError, match="--fabric: 2 for 1 garments, expected one, or one for each"):
        load_outfit(["tops"], body, fabric=["denim", "silk"])


def test_a_name_that_is_neither_template_nor_file_names_the_templates(body: Body) -> None:
    with pytest.raises(
        InputError, match="garment top: no such template, expected one of tops, bottoms, dress"
    ):
        load_outfit(["top"], body)
