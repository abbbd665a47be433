"""What a garment file's diagnosis finds and repairs, and what is refused with its reason."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from uvcloth.bodies.body import Body, load_body
from uvcloth.errors import InputError
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.garments.fit import fit
from uvcloth.geometry.mesh import face_normals, vertex_normals


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


@pytest.fixture(scope="module")
def suit(body: Body) -> trimesh.Trimesh:
    """A clean overall: the body's own tight suit, a few millimetres off the skin."""
    shell = body.proxies["tights"]
    normals = vertex_normals(shell.vertices, shell.faces)
    return trimesh.Trimesh((shell.vertices + 0.004 * normals).numpy(), shell.faces.numpy(), process=False)


def saved(vertices, faces, path: Path) -> Path:
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


def test_a_clean_garment_has_nothing_to_repair(suit, body, tmp_path):
    found = fit(saved(suit.vertices, suit.faces, tmp_path / "suit.ply"), body).diagnosis
    assert (found.components, found.duplicate_faces, found.double_sided_faces) == (1, 0, 0)
    assert (found.flipped_faces, found.degenerate_faces, found.inside_share) == (0, 0, 0)
    assert "2674 vertices" in found.lines()[0]
    assert not any("dropped" in line or "turned" in line for line in found.lines())


def test_repeated_and_degenerate_faces_are_dropped(suit, body, tmp_path):
    turned = np.roll(suit.faces[:30], 1, axis=1)
    needle = np.repeat(suit.faces[:5, :1], 3, axis=1)
    path = saved(suit.vertices, np.concatenate([suit.faces, turned, needle]), tmp_path / "suit.ply")
    fitted = fit(path, body)
    assert fitted.diagnosis.duplicate_faces == 30
    assert fitted.diagnosis.degenerate_faces == 5
    assert torch.equal(fitted.garment.mesh.faces, torch.tensor(suit.faces))
    assert any("30 duplicate faces" in line for line in fitted.diagnosis.lines())


def test_a_double_sided_garment_keeps_its_outside(suit, body, tmp_path):
    path = saved(suit.vertices, np.concatenate([suit.faces[:, ::-1], suit.faces]), tmp_path / "suit.ply")
    fitted = fit(path, body)
    assert fitted.diagnosis.double_sided_faces == len(suit.faces)
    assert _directions(fitted.garment.mesh.vertices, fitted.garment.mesh.faces, suit) > 0.999


@pytest.mark.parametrize(
    "share",
    [0.5, 1.0, pytest.param(0.1, marks=pytest.mark.thorough), pytest.param(0.9, marks=pytest.mark.thorough)],
)
def test_flipped_faces_are_turned_outside_out(share, suit, body, tmp_path):
    turned = np.random.default_rng(0).random(len(suit.faces)) < share
    faces = np.where(turned[:, None], suit.faces[:, ::-1], suit.faces)
    fitted = fit(saved(suit.vertices, faces, tmp_path / "suit.obj"), body)
    assert fitted.diagnosis.flipped_faces == turned.sum()
    assert _directions(fitted.garment.mesh.vertices, fitted.garment.mesh.faces, suit) > 0.999


def _directions(vertices, faces, reference: trimesh.Trimesh) -> float:
    """The smallest cosine between the normals of faces and those of the reference, face by face."""
    normals = torch.nn.functional.normalize(face_normals(vertices, faces), dim=1)
    return float((normals * torch.tensor(reference.face_normals)).sum(1).min())


def test_pieces_are_counted(suit, body, tmp_path):
    low, high = suit.triangles_center[:, 2] < -0.3, suit.triangles_center[:, 2] > 0.0
    path = saved(suit.vertices, suit.faces[low | high], tmp_path / "suit.ply")
    assert fit(path, body).diagnosis.components == 3


def test_the_share_inside_the_body_is_reported(suit, body, tmp_path):
    """Less than what settles."""
    shifted = suit.vertices + np.array([0.0, 0.0088, 0.0])
    found = fit(saved(shifted, suit.faces, tmp_path / "suit.ply"), body).diagnosis
    inside = trimesh.Trimesh(body.mesh.vertices.numpy(), body.mesh.faces.numpy(), process=False)
    assert found.inside_share == pytest.approx(inside.contains(shifted).mean(), abs=0.001)
    assert found.inside_share > 0.003


def test_bad_garments_are_refused_with_file_and_reason(suit, body, tmp_path):
    fan = np.concatenate([suit.faces, [[suit.faces[0, 0], suit.faces[0, 1], 2000]]])
    flag = trimesh.creation.box((1.0, 0.2, 0.7)).subdivide().subdivide()
    flag.update_faces(flag.triangles_center[:, 1] > 0)
    cases = {
        "not manifold": (suit.vertices, fan),
        "too large": (suit.vertices * 1e6, suit.faces),
        "too small": (suit.vertices * 1e-6, suit.faces),
        "far from the body": (flag.vertices + 5.0, flag.faces),
        "wholly inside": (suit.vertices - 0.025 * suit.vertex_normals, suit.faces),
        "not a finite number": (
            np.where(np.arange(len(suit.vertices))[:, None] == 7, np.nan, suit.vertices),
            suit.faces,
        ),
    }
    for reason, (vertices, faces) in cases.items():
        path = saved(vertices, faces, tmp_path / "bad.ply")
        with pytest.raises(InputError, match=reason) as caught:
            fit(path, body)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_garment_that_cannot_be_unwrapped_is_named(suit, body, tmp_path, monkeypatch):
    worker = tmp_path / "worker.py"
    worker.write_text("import os\nos.abort()\n")
    monkeypatch.setattr("rasterize.layout.UNWRAP_WORKER", worker)
    path = saved(suit.vertices, suit.faces, tmp_path / "suit.ply")
    with pytest.raises(InputError, match=r"suit\.ply: .* unwrapped"):
        fit(path, body)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("empty.obj", b"", "empty"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\n", "empty"),
        ("word.obj", b"v 0 0 zero\n", "line 1"),
        ("missing.obj", b"v 0 0 0\nf 1 2 3\n", "does not have"),
        ("zero.obj", b"v 0 0 0\nf 0 1 1\n", "line 2"),
        ("nan.obj", b"v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "vertex 1"),
        ("million.obj", b"v 0 0 0\n" * 200_001, "has 200,001 vertices, at most 200,000 are supported"),
        ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 2\n", "."),
        ("empty.ply", b"", "readable PLY"),
        ("cut.ply", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n", "."),
        ("noise.glb", b"glTF" + bytes(range(100)), "not a complete glTF file"),
        ("noise.stl", b"\x00" * 90, "."),
        ("shirt.max", b"", "'.max'"),
        ("shirt.pkl", b"", "'.pkl'"),
        ("shirt", b"", "garment file ends in"),
    ],
)
def test_bad_files_are_refused_with_their_name(name, content, reason, body, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=reason) as caught:
        fit(tmp_path / name, body)
    assert str(tmp_path / name) in str(caught.value)


def test_a_missing_file_and_a_folder_are_refused(body, tmp_path):
    (tmp_path / "folder.obj").mkdir()
    for name in ("nothing.obj", "folder.obj"):
        with pytest.raises(InputError, match="no such file"):
            fit(tmp_path / name, body)


@pytest.fixture(scope="module")
def files(suit, tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("files")
    few = trimesh.Trimesh(suit.vertices, suit.faces[:40], process=False)
    few.remove_unreferenced_vertices()
    for kind in ("obj", "ply", "glb", "stl"):
        few.export(folder / f"few.{kind}")
    return {kind: (folder / f"few.{kind}").read_bytes() for kind in ("obj", "ply", "glb", "stl")}


@given(kind=st.sampled_from(["obj", "ply", "glb", "stl"]), data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_file_is_read_or_refused_but_never_trips(kind, data, files, tmp_path):
    content = bytearray(files[kind][: data.draw(st.integers(0, len(files[kind])))])
    for _ in range(data.draw(st.integers(0, 3))):
        if content:
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / f"damaged.{kind}"
    path.write_bytes(bytes(content))
    mesh = None
    with suppress(InputError):
        mesh = read_mesh(path)
    if mesh is not None:
        assert torch.isfinite(mesh.vertices).all()
        assert 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices)
