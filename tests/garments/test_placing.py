"""Garment files in other units, axes and origins are placed; what does not lie as clothes lie is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.errors import InputError
from uvcloth.garments.diagnose import diagnose
from uvcloth.garments.judge import UnwearableError
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.geometry.mesh import Mesh, vertex_normals

INCH, FOOT = 0.0254, 0.3048

UP = {  # Rows: where the file's axes have the body's X, Y and Z (Z up, facing -Y).
    "Z up": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "Z up, front to +Y": ((-1, 0, 0), (0, -1, 0), (0, 0, 1)),
    "Z up, front to +X": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "Z up, front to -X": ((0, 1, 0), (-1, 0, 0), (0, 0, 1)),
    "Y up": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "Y up, front to -Z": ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
}


def floor(body: Body) -> Tensor:
    """Way from the body's origin to one on the floor."""
    return torch.tensor([0.0, 0.0, -float(body.mesh.vertices[:, 2].min())])


@pytest.mark.parametrize(
    ("name", "unit", "axes", "on_floor"),
    [
        ("tops", "inches", "Y up", True),
        ("tops", "cm", "Z up, front to +Y", False),
        ("tops", "m", "Y up, front to -Z", True),
        ("shirt", "feet", "Y up", True),
        ("shirt", "dm", "Z up", False),
        ("shirt", "mm", "Z up, front to -X", True),
        ("bottoms", "cm", "Y up", True),
        ("bottoms", "feet", "Z up", False),
        ("bottoms", "m", "Z up, front to +X", False),
        ("dress", "dm", "Y up, front to -Z", False),
        ("dress", "inches", "Z up", True),
        ("dress", "mm", "Y up", False),
    ],
)
def test_a_file_is_placed_as_it_was_modelled(
    name: str, unit: str, axes: str, on_floor: bool, body: Body
) -> None:
    mesh = fit_template(name, body).mesh
    metres = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "inches": INCH, "feet": FOOT}[unit]
    vertices = mesh.vertices + floor(body) if on_floor else mesh.vertices
    written = vertices.double() @ torch.tensor(UP[axes]).double().T / metres
    placed, found = diagnose(Path(f"{name}.obj"), replace(mesh, vertices=written), body)
    torch.testing.assert_close(placed.vertices, mesh.vertices, atol=1e-5, rtol=0)
    assert torch.equal(placed.faces, mesh.faces)
    text = found.lines()[1]
    assert f"unit {unit}, {axes}" in text
    assert ("between the feet" in text) == on_floor


def about_centre(vertices: Tensor, turn: tuple[tuple[int, ...], ...]) -> Tensor:
    centre = (vertices.amax(0) + vertices.amin(0)) / 2
    return (vertices - centre) @ torch.tensor(turn).float().T + centre


UPSIDE_DOWN = ((-1, 0, 0), (0, 1, 0), (0, 0, -1))
BACK_TO_FRONT = ((-1, 0, 0), (0, -1, 0), (0, 0, 1))
ON_ITS_SIDE = ((0, 0, -1), (0, 1, 0), (1, 0, 0))


@pytest.fixture(scope="module")
def overalls(body: Body) -> Mesh:
    shell = body.proxies["tights"]
    off = shell.vertices + 0.006 * vertex_normals(shell.vertices, shell.faces)
    return Mesh(off, shell.faces, torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64))


def refusal(mesh: Mesh, body: Body) -> str:
    with pytest.raises(UnwearableError) as caught:
        diagnose(Path("mine.obj"), mesh, body)
    assert "\n" not in str(caught.value)
    assert caught.value.mesh.vertices.shape == mesh.vertices.shape
    return str(caught.value)


@pytest.mark.parametrize(
    ("turn", "words"),
    [
        (UPSIDE_DOWN, "lies upside down"),
        (BACK_TO_FRONT, "lies back to front"),
        (ON_ITS_SIDE, "lies on its side"),
    ],
)
def test_a_shirt_that_is_turned_on_the_body_is_refused(
    turn: tuple[tuple[int, ...], ...], words: str, body: Body
) -> None:
    mesh = fit_template("shirt", body).mesh
    sentence = refusal(replace(mesh, vertices=about_centre(mesh.vertices, turn)), body)
    assert sentence.startswith(f"mine.obj: the garment {words}: ")


def test_overalls_over_the_head_are_refused(overalls: Mesh, body: Body) -> None:
    turned = about_centre(overalls.vertices, UPSIDE_DOWN)
    assert "upside down" in refusal(replace(overalls, vertices=turned), body)
    assert diagnose(Path("mine.obj"), overalls, body)[1].inside_share == 0


def test_a_garment_at_the_wrong_height_is_refused(body: Body) -> None:
    for name in TEMPLATES:
        mesh = fit_template(name, body).mesh
        for height in (-0.3, 0.3):
            refusal(replace(mesh, vertices=mesh.vertices + torch.tensor([0.0, 0.0, height])), body)


def part(body: Body, regions: tuple[str, ...]) -> Mesh:
    """The skin of some regions, three millimetres out."""
    off = body.mesh.vertices + 0.003 * vertex_normals(body.mesh.vertices, body.mesh.faces)
    wanted = torch.isin(body.regions, torch.tensor([REGIONS.index(region) for region in regions]))
    used, faces = torch.unique(body.mesh.faces[wanted], return_inverse=True)
    return Mesh(off[used], faces, torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64))


def test_what_is_no_garment_for_the_trunk_or_limbs_is_refused(body: Body) -> None:
    assert "worn on the foot (100 % of it)" in refusal(part(body, ("foot",)), body)
    assert "worn on the hand" in refusal(part(body, ("hand",)), body)
    assert "worn on the head" in refusal(part(body, ("head",)), body)
    assert "it is a body" in refusal(part(body, REGIONS), body)


def test_closed_and_loose_meshes_are_refused(body: Body) -> None:
    box = trimesh.creation.box((0.5, 0.4, 0.6))
    bare = torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64)
    cube = Mesh(torch.tensor(np.array(box.vertices)) + 0.1, torch.tensor(np.array(box.faces)), *bare)
    assert "closed all around" in refusal(cube, body)
    rows = torch.arange(900).reshape(30, 30)
    corners = torch.stack([rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:]], -1).reshape(-1, 4)
    faces = torch.cat([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    flat = torch.cartesian_prod(torch.linspace(-0.5, 0.5, 30), torch.linspace(-0.6, 0.6, 30))
    cape = torch.cat([flat, torch.zeros(900, 1)], 1) - floor(body)
    refusal(Mesh(cape, faces, *bare), body)


def test_what_fits_in_no_unit_names_them(body: Body) -> None:
    mesh = fit_template("tops", body).mesh
    with pytest.raises(InputError, match="m, dm, cm, mm, inches, feet"):
        diagnose(Path("mine.obj"), replace(mesh, vertices=mesh.vertices * 1e5), body)
