"""User garments cut from the body itself: file kinds, units and axes, and what a fit keeps of the file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from tests.thorough import always
from uvcloth.bodies.body import REGIONS, Body, load_body
from uvcloth.errors import InputError
from uvcloth.garments.fit import covered_faces, fit
from uvcloth.geometry.authored import AuthoredMesh
from uvcloth.geometry.mesh import face_normals, vertex_normals

EASE = 0.01
"""Metres that the test garments stand off the skin."""


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


def cut(body: Body, regions: tuple[str, ...], low: float, high: float) -> trimesh.Trimesh:
    """A garment that follows the skin EASE away from it, over some regions between two heights."""
    normals = vertex_normals(body.mesh.vertices, body.mesh.faces)
    centres = body.mesh.vertices[body.mesh.faces].mean(1)
    wanted = torch.isin(body.regions, torch.tensor([REGIONS.index(region) for region in regions]))
    wanted &= (centres[:, 2] > low) & (centres[:, 2] < high)
    shell = trimesh.Trimesh(
        (body.mesh.vertices + EASE * normals).numpy(), body.mesh.faces[wanted].numpy(), process=False
    )
    shell.remove_unreferenced_vertices()
    return shell


@pytest.fixture(scope="module")
def tank_top(body: Body) -> trimesh.Trimesh:
    return cut(body, ("torso",), 0.05, 0.55)


@pytest.fixture(scope="module")
def shorts(body: Body) -> trimesh.Trimesh:
    return cut(body, ("torso", "thigh"), -0.4, 0.12)


@pytest.fixture(scope="module")
def skirt(body: Body) -> trimesh.Trimesh:
    """A cone around both legs, from the waist to the knees."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rows = np.linspace(0, 1, 30)
    radius = 0.21 + 0.06 * rows[:, None]
    hips = body.mesh.vertices[(body.mesh.vertices[:, 2] - 0.05).abs() < 0.03]
    middle = float((hips[:, 1].min() + hips[:, 1].max()) / 2)
    heights = np.broadcast_to(0.08 - 0.45 * rows[:, None], (30, 60))
    points = np.stack([radius * np.cos(angle), middle + radius * np.sin(angle), heights], axis=-1)
    index = np.arange(30 * 60).reshape(30, 60)
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, 1), np.roll(a, -1, 1)
    faces = np.concatenate([np.stack([i.ravel() for i in t], axis=1) for t in ((a, b, c), (a, c, d))])
    return trimesh.Trimesh(points.reshape(-1, 3), faces, process=False)


def written(mesh: trimesh.Trimesh, path: Path) -> Path:
    mesh.export(path)
    return path


@pytest.mark.parametrize("suffix", always(["obj", "glb"], ["obj", "ply", "glb", "off"]))
def test_vertices_come_back_in_the_file_s_order(suffix, tank_top, body, tmp_path):
    fitted = fit(written(tank_top, tmp_path / f"vest.{suffix}"), body)
    torch.testing.assert_close(
        fitted.garment.mesh.vertices, torch.tensor(tank_top.vertices).float(), atol=1e-5, rtol=0
    )
    assert torch.equal(fitted.garment.mesh.faces, torch.tensor(tank_top.faces))
    assert fitted.garment.name == "vest"
    assert fitted.garment.template == "tops"
    assert fitted.diagnosis.placing.unit == "m"
    assert fitted.diagnosis.placing.up == "Z"
    assert fitted.diagnosis.inside_share == 0
    assert fitted.diagnosis.mean_distance == pytest.approx(EASE, abs=1e-3)
    assert fitted.diagnosis.unwrapped
    uvs = fitted.garment.mesh.uvs
    assert 0 <= uvs.min() <= uvs.max() <= 1


def test_a_triangle_soup_is_one_piece(tank_top, body, tmp_path):
    fitted = fit(written(tank_top, tmp_path / "vest.stl"), body)
    assert fitted.garment.mesh.vertices.shape == (3 * len(tank_top.faces), 3)
    assert fitted.diagnosis.components == 1
    joined = fitted.garment.smooth_weights
    _, place = torch.unique(fitted.garment.mesh.vertices, dim=0, return_inverse=True)
    order = torch.argsort(place)
    same = place[order][1:] == place[order][:-1]
    assert torch.equal(joined[order][1:][same], joined[order][:-1][same])
    whole = fit(written(tank_top, tmp_path / "vest.ply"), body).garment
    corners = whole.smooth_weights[whole.mesh.faces.reshape(-1)]
    torch.testing.assert_close(joined, corners, atol=1e-3, rtol=0)


def units_and_axes() -> Iterator[Any]:
    """Every garment in every unit; two garments are enough where time is short."""
    for place, (scale, up) in enumerate([(1, "Y"), (10, "Z"), (100, "Y"), (1000, "Z")]):
        for number, template in enumerate(("bottoms", "dress", "tops")):
            marks = () if (place, number) in ((1, 1), (2, 2)) else pytest.mark.thorough
            yield pytest.param(scale, up, template, marks=marks)


@pytest.mark.parametrize(("scale", "up", "template"), list(units_and_axes()))
def test_units_and_axes_are_recognised(scale, up, template, shorts, skirt, tank_top, body, tmp_path):
    garment = {"bottoms": shorts, "dress": skirt, "tops": tank_top}[template]
    points = garment.vertices * scale
    if up == "Y":
        points = np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)
    path = written(trimesh.Trimesh(points, garment.faces, process=False), tmp_path / "garment.ply")
    fitted = fit(path, body)
    assert {"m": 1, "dm": 10, "cm": 100, "mm": 1000}[fitted.diagnosis.placing.unit] == scale
    assert fitted.diagnosis.placing.up == up
    assert fitted.garment.template == template
    torch.testing.assert_close(
        fitted.garment.mesh.vertices, torch.tensor(garment.vertices).float(), atol=1e-5, rtol=0
    )


def test_long_sleeves_are_worn_as_a_shirt(body, tmp_path):
    arms = ("torso", "upper_arm", "forearm")
    assert fit(written(cut(body, arms, 0.05, 0.62), tmp_path / "long.ply"), body).garment.template == "shirt"
    short = cut(body, arms[:2], 0.05, 0.62)
    assert fit(written(short, tmp_path / "short.ply"), body).garment.template == "tops"


def test_texture_seams_and_vertex_order_of_an_obj_survive(skirt, body, tmp_path):
    rows, around = 30, 60
    path = tmp_path / "skirt.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in skirt.vertices]
    lines += [f"vt {i / around} {j / (rows - 1)}" for j in range(rows) for i in range(around + 1)]
    quads = []
    for j in range(rows - 1):
        for i in range(around):
            corners = ((j, i), (j + 1, i), (j + 1, i + 1), (j, i + 1))
            quads.append([(row * around + col % around, row * (around + 1) + col) for row, col in corners])
    lines += ["f " + " ".join(f"{v + 1}/{t + 1}" for v, t in quad) for quad in quads]
    path.write_text("\n".join(lines))
    fitted = fit(path, body)
    mesh = fitted.garment.mesh
    torch.testing.assert_close(mesh.vertices, torch.tensor(skirt.vertices).float())
    assert not fitted.diagnosis.unwrapped
    assert mesh.uvs.shape == (rows * (around + 1), 2)
    assert torch.equal(mesh.faces[0], torch.tensor([quads[0][k][0] for k in (0, 1, 2)]))
    assert torch.equal(mesh.face_uvs[0], torch.tensor([quads[0][k][1] for k in (0, 1, 2)]))
    expected = {tuple(sorted(corner for corner in quad)) for quad in quads}
    pairs = torch.stack([mesh.faces, mesh.face_uvs], dim=-1).view(-1, 6, 2).tolist()
    assert {tuple(sorted({tuple(corner) for corner in quad})) for quad in pairs} == expected
    assert isinstance(mesh, AuthoredMesh)
    assert mesh.polygons.sizes.tolist() == [4] * len(quads)
    corners = np.stack([mesh.polygons.corners, mesh.polygons.uv_sets[0].corners], axis=1)
    np.testing.assert_array_equal(corners, np.array(quads).reshape(-1, 2))


def test_texture_coordinates_of_a_glb_survive(tank_top, body, tmp_path):
    uv = np.random.default_rng(0).random((len(tank_top.vertices), 2))
    textured = trimesh.Trimesh(
        tank_top.vertices, tank_top.faces, process=False, visual=trimesh.visual.TextureVisuals(uv=uv)
    )
    mesh = fit(written(textured, tmp_path / "vest.glb"), body).garment.mesh
    torch.testing.assert_close(mesh.uvs, torch.tensor(uv).float(), atol=1e-5, rtol=0)
    assert torch.equal(mesh.faces, mesh.face_uvs)


def test_negative_indices_and_polygons_of_an_obj_are_read(body, skirt, tmp_path):
    plain = written(skirt, tmp_path / "plain.obj")
    count = len(skirt.vertices)
    text = [line for line in plain.read_text().splitlines() if line.startswith("v ")]
    text += ["f " + " ".join(str(int(v) - count) for v in face) for face in skirt.faces]
    (tmp_path / "negative.obj").write_text("\n".join(text))
    fitted = fit(tmp_path / "negative.obj", body)
    assert torch.equal(fitted.garment.mesh.faces, torch.tensor(skirt.faces))


def test_every_vertex_covers_the_skin_below_it(shorts, body, tmp_path):
    fitted = fit(written(shorts, tmp_path / "shorts.ply"), body)
    garment = fitted.garment
    faces, missed = covered_faces(garment.mesh, body)
    normals = face_normals(body.mesh.vertices, body.mesh.faces[faces])
    away = garment.mesh.vertices - body.mesh.vertices[body.mesh.faces[faces, 0]]
    distance = (away * torch.nn.functional.normalize(normals, dim=1)).sum(1)
    assert distance.median() == pytest.approx(EASE, abs=1e-3)
    assert fitted.diagnosis.ray_misses == missed.sum()
    assert missed.float().mean() < 0.01
    for weights in (garment.weights, garment.smooth_weights):
        torch.testing.assert_close(weights.sum(1), torch.ones(len(weights)))


def test_a_skirt_is_carried_by_both_legs_and_shorts_by_one_each(skirt, shorts, body, tmp_path):
    left, right = (body.skeleton.names.index(name) for name in ("LeftUpLeg", "RightUpLeg"))
    for mesh, least, most in ((skirt, 0.25, 0.5), (shorts, 0.0, 0.15)):
        garment = fit(written(mesh, tmp_path / "garment.ply"), body).garment
        thigh = garment.mesh.vertices[:, 2] < -0.2
        weights = garment.smooth_weights[thigh]
        legs = weights[:, [left, right]]
        middle = garment.mesh.vertices[thigh, 0].abs() < 0.02 if mesh is skirt else legs.max(1).values > 0.8
        other = (legs.min(1).values / legs.sum(1))[middle]
        assert least <= other.mean() <= most


def test_the_given_template_is_taken(tank_top, body, tmp_path):
    path = written(tank_top, tmp_path / "vest.ply")
    assert fit(path, body, "dress").garment.template == "dress"
    with pytest.raises(InputError, match="cape"):
        fit(path, body, "cape")
