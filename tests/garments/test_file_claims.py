"""Mesh files and clothes that claim what they do not have, and that name files of other folders."""

import os
import struct
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.garments.test_mhclo import HEAD, ROWS, written
from tests.small_body import small_body
from tests.small_gltf import PIXEL, document, write_glb
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.garments.mhclo import fit_clothes
from uvcloth.geometry.authored import AuthoredMesh

PLY = (
    "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 {last}\n"
)
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def box_that_names(vertex: int) -> bytes:
    """Indices of the small file whose first names another vertex."""
    written, content = document()
    indices = written["meshes"][0]["primitives"][0]["indices"]
    start = written["bufferViews"][indices]["byteOffset"]
    return content[:start] + struct.pack("<H", vertex) + content[start + 2 :]


@pytest.mark.parametrize("last", [3, -1, 2**31 - 1])
def test_a_ply_whose_faces_name_no_vertex_is_refused(last: int, tmp_path: Path) -> None:
    (tmp_path / "out.ply").write_text(PLY.format(vertices=3, last=last))
    with pytest.raises(InputError, match=r"out\.ply: (a face has the vertices|not a readable PLY)"):
        read_mesh(tmp_path / "out.ply")


def test_a_glb_whose_faces_name_no_vertex_is_refused(tmp_path: Path) -> None:
    path = write_glb(tmp_path / "out.glb", document()[0], box_that_names(8))
    with pytest.raises(InputError, match=r"out\.glb: a face refers to a vertex beyond the 8 of its mesh"):
        read_mesh(path)


@pytest.mark.parametrize("index", ["99999999999999999999", "-99999999999999999999", "4", "9" * 5000])
def test_an_obj_whose_faces_name_no_vertex_is_refused(index: str, tmp_path: Path) -> None:
    (tmp_path / "out.obj").write_text(OBJ.replace("f 1 2 3", f"f 1 2 {index}"))
    with pytest.raises(InputError, match=r"out\.obj.*(line 4|does not have)") as caught:
        read_mesh(tmp_path / "out.obj")
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("many.ply", PLY.format(vertices=10**12, last=2).encode()),
        ("many.stl", bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(50)),
        ("many.off", b"OFF\n1000000000000 1000000000000 0\n0 0 0\n"),
        ("far.obj", OBJ.replace("v 1 0 0", "v 1e39 0 0").encode()),
        ("far.stl", bytes(80) + struct.pack("<I", 1) + np.full(12, 3e38, "<f4").tobytes() + bytes(2)),
    ],
)
def test_what_a_header_counts_is_not_believed(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name):
        read_mesh(tmp_path / name)


def test_a_picture_that_a_ply_names_is_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "woven.ply"
    path.write_text(
        PLY.format(vertices=3, last=2).replace("element face", "comment TextureFile ../a.png\nelement face")
    )
    (tmp_path.parent / "a.png").write_bytes(PIXEL)
    opened: list[object] = []
    monkeypatch.setattr("PIL.Image.open", lambda *given, **named: opened.append(given))
    assert len(read_mesh(path).faces) == 1
    assert opened == []


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A folder in a folder that holds what nobody may read, and links to it."""
    folder = tmp_path / "inside"
    folder.mkdir()
    for name in ("secret.png", "secret.mtl", "secret.mhmat", "secret.obj"):
        (tmp_path / name).write_bytes(PIXEL if name.endswith("png") else OBJ.encode())
        (folder / f"link{name[6:]}").symlink_to(tmp_path / name)
    return folder


WAYS = (
    "../secret{end}",
    "{folder}/secret{end}",
    "link{end}",
    "..\\secret{end}",
    "http://127.0.0.1:9/a{end}",
    "C:/a{end}",
)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("end", [".mtl", ".png"])
def test_materials_of_an_obj_lie_in_its_folder(end: str, way: str, outside: Path) -> None:
    name = way.format(folder=outside.parent, end=end)
    (outside / "plain.mtl").write_text(f"newmtl wool\nKd 1 0 0\nmap_Kd {name}\n")
    library = name if end == ".mtl" else "plain.mtl"
    (outside / "box.obj").write_text(f"mtllib {library}\nusemtl wool\n{OBJ}")
    mesh = read_mesh(outside / "box.obj")
    assert isinstance(mesh, AuthoredMesh)
    (material,) = mesh.polygons.materials
    assert material.texture is None
    assert material.color[0] == 1.0
    assert len(mesh.polygons.missing) == 1


def test_a_picture_that_many_materials_name_is_held_once(tmp_path: Path) -> None:
    (tmp_path / "wool.png").write_bytes(PIXEL)
    (tmp_path / "a.mtl").write_text("".join(f"newmtl m{k}\nmap_Kd wool.png\n" for k in range(3)))
    text = "mtllib a.mtl\nmtllib a.mtl\n" + "".join(f"usemtl m{k}\nf 1 2 3\n" for k in range(3))
    (tmp_path / "a.obj").write_text(OBJ + text)
    mesh = read_mesh(tmp_path / "a.obj")
    assert isinstance(mesh, AuthoredMesh)
    assert len({id(each.texture) for each in mesh.polygons.materials}) == 1


@pytest.fixture
def boxed() -> Body:
    box = small_body()
    return replace(box, base=box.mesh.vertices)


@pytest.mark.parametrize("way", [way for way in WAYS if "\\" not in way])
def test_clothes_and_their_material_lie_in_one_folder(way: str, boxed: Body, outside: Path) -> None:
    obj, mhmat = (way.format(folder=outside.parent, end=end) for end in (".obj", ".mhmat"))
    path = written(outside, ROWS, HEAD.replace("box.obj", obj))
    with pytest.raises(InputError, match=r"box\.mhclo: its obj_file .* lies outside inside and is not read"):
        fit_clothes(path, boxed)
    mesh, _ = fit_clothes(written(outside, ROWS, HEAD.replace("verts", f"material {mhmat}\nverts")), boxed)
    assert isinstance(mesh, AuthoredMesh)
    assert mesh.polygons.materials == ()
    assert "outside inside" in mesh.polygons.missing[0]


def test_ranges_without_end_of_deleted_vertices_take_no_memory(boxed: Body, tmp_path: Path) -> None:
    path = written(tmp_path, ROWS)
    path.write_text(path.read_text() + 2000 * "0 - 99999\n")
    _, binding = fit_clothes(path, boxed)
    assert len(binding.deleted) == 100_000
    path.write_text(path.read_text() + "0 - 99999999999\n")
    with pytest.raises(InputError, match=r"box\.mhclo, line 2015"):
        fit_clothes(path, boxed)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    """A folder, and what never ends or never begins."""
    (tmp_path / "folder.obj").mkdir()
    (tmp_path / "endless.obj").symlink_to("/dev/zero")
    (tmp_path / "loop.obj").symlink_to("loop.obj")
    import os

    os.mkfifo(tmp_path / "pipe.obj")
    for name in ("folder", "endless", "loop", "pipe"):
        with pytest.raises(InputError, match=rf"{name}\.obj: (no such file|cannot be read)"):
            read_mesh(tmp_path / f"{name}.obj")


@pytest.mark.parametrize(
    ("name", "head", "size", "count"),
    [
        ("million.ply", PLY.format(vertices=10**6, last=2).encode(), 2**33, "1,000,000 vertices"),
        ("faces.ply", b"ply\nelement vertex 4\r\nelement face 3000000\n", 2**33, "3,000,000 faces"),
        ("million.stl", bytes(80) + struct.pack("<I", 10**8), 84 + 50 * 10**8, "300,000,000 vertices"),
        ("million.off", b"OFF # of a scanner\n1000000 4 0\n", 2**33, "1,000,000 vertices"),
        ("million.obj", b"v 0 0 0\n" * 10**6, 8 * 10**6, "1,000,000 vertices"),
        ("text.stl", b"vertex 0 0 0\n" * 10**6, 13 * 10**6, "1,000,000 vertices"),
    ],
)  # fmt: skip
def test_a_large_mesh_is_refused_before_it_is_read(
    name: str, head: bytes, size: int, count: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(head)
    os.truncate(path, size)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=rf"{name}: the garment has {count}, at most"):
            read_mesh(path)
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()
