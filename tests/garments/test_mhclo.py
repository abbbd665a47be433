"""Clothes bound to the base mesh: where they lie, on which bodies, and the files that are refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from tests.small_body import small_body
from uvcloth.bodies.body import Body, load_body, save_body
from uvcloth.errors import InputError
from uvcloth.files.image import write_png
from uvcloth.garments.mhclo import fit_clothes, read_binding
from uvcloth.geometry.authored import AuthoredMesh
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.hidden_skin import HiddenSkin

HEAD = "basemesh hm08\nobj_file box.obj\nx_scale 0 4 2\ny_scale 0 1 2\nz_scale 0 2 2\nz_depth 7\nverts 0\n"

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 4 3\n"


@pytest.fixture
def boxed() -> Body:
    """A cube of 0.2 m that takes its own corners for the base mesh: offsets of one decimetre are one."""
    box = small_body()
    return replace(box, base=box.mesh.vertices)


def written(folder: Path, rows: str, head: str = HEAD) -> Path:
    (folder / "box.obj").write_text(OBJ)
    (folder / "box.mhclo").write_text(f"# clothes\n{head}{rows}\ndelete_verts\n3 5 - 7\n")
    return folder / "box.mhclo"


ROWS = "0 4 6 0.5 0.5 0.0 0 0 0\n0 1 2 1 0 0 0.1 0.2 0.3\n5\n0 1 2 0.25 0.25 0.5 0 0 0"


def expected(base: Tensor, scale: Tensor) -> Tensor:
    x, y, z = (torch.tensor([0.1, 0.2, 0.3]) * scale).tolist()
    return torch.stack(
        [
            (base[0] + base[4]) / 2,
            base[0] + torch.tensor([x, -z, y]),
            base[5],
            (base[0] + base[1]) / 4 + base[2] / 2,
        ]
    )


def test_vertices_lie_where_they_are_bound(boxed: Body, tmp_path: Path) -> None:
    mesh, _ = fit_clothes(written(tmp_path, ROWS), boxed)
    assert boxed.base is not None
    torch.testing.assert_close(mesh.vertices, expected(boxed.base, torch.full((3,), 0.1)))
    assert len(mesh.faces) == 2


def test_offsets_grow_with_the_body_along_each_axis(boxed: Body, tmp_path: Path) -> None:
    base = boxed.mesh.vertices * torch.tensor([2.0, 3.0, 4.0])
    mesh, _ = fit_clothes(written(tmp_path, ROWS), replace(boxed, base=base))
    # The file's axes: X is the body's X, Y its Z, Z its -Y.
    torch.testing.assert_close(mesh.vertices, expected(base, torch.tensor([0.2, 0.4, 0.3])))


def test_what_clothes_delete_is_hidden(boxed: Body, tmp_path: Path) -> None:
    _, binding = fit_clothes(written(tmp_path, ROWS), boxed)
    assert binding.deleted.tolist() == [3, 5, 6, 7]
    # The body's vertices in another order than those of the base mesh, one of which it lacks.
    order = torch.tensor([6, 0, 3, 1, 7, 2, 4])
    fewer = replace(boxed, mesh=replace(boxed.mesh, vertices=boxed.mesh.vertices[order]))
    assert binding.hides(fewer).tolist() == [0, 2, 4]
    cloth = Mesh(boxed.mesh.vertices + 1.0, boxed.mesh.faces, boxed.mesh.uvs, boxed.mesh.face_uvs)
    hidden = HiddenSkin(boxed, [cloth], [torch.tensor([0, 1]), torch.tensor([3])])
    hidden.add([cloth.vertices], boxed.mesh.vertices)
    assert boxed.mesh.faces[hidden.faces()].tolist() == [[0, 1, 3]]


@pytest.mark.parametrize("named", ["box.mhmat", "missing.mhmat"])
def test_the_material_of_clothes_is_read(named: str, boxed: Body, tmp_path: Path) -> None:
    write_png(tmp_path / "weave.png", np.full((2, 2, 3), 0.5, np.float32))
    (tmp_path / "box.mhmat").write_text(
        "// made up\nname Blue Box\ndiffuseColor 0.2 0.3 0.4\nopacity 0.9\ndiffuseTexture weave.png\n"
    )
    mesh, _ = fit_clothes(written(tmp_path, ROWS, HEAD.replace("verts", f"material {named}\nverts")), boxed)
    assert isinstance(mesh, AuthoredMesh)
    if named == "missing.mhmat":
        assert (mesh.polygons.materials, mesh.polygons.missing) == ((), ("missing.mhmat",))
        return
    (material,) = mesh.polygons.materials
    assert (material.name, material.color) == ("Blue Box", (0.2, 0.3, 0.4, 0.9))
    assert material.texture is not None
    assert material.texture.content == (tmp_path / "weave.png").read_bytes()
    assert mesh.polygons.material.tolist() == [0]


def test_a_body_without_base_mesh_says_how_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"box\.mhclo: body box does not contain .* `uvcloth body`"):
        fit_clothes(written(tmp_path, ROWS), small_body())


@pytest.mark.parametrize(
    ("rows", "head", "reason"),
    [
        (ROWS.splitlines()[0], HEAD, r"binds 1 vertices, but box\.obj has 4"),
        (ROWS.replace("0 4 6", "0 4 8"), HEAD, "bound to vertex 8, the base mesh has 8"),
        (ROWS.replace("0.25 0.25", "0.25 nan"), HEAD, "line 12: .* finite"),
        (ROWS.replace("0 4 6", "0 -4 6"), HEAD, "line 9: .*vertex -4"),
        (ROWS, HEAD.replace("hm08", "hm07"), "base mesh hm07, expected hm08"),
        (ROWS, HEAD.replace("0 4 2", "0 4 0"), "line 4"),
        ("", HEAD, "binds no vertices"),
        (ROWS, HEAD.replace("box.obj", "bag.obj"), r"bag\.obj: no such file"),
    ],
)
def test_bad_clothes_are_refused_with_the_reason(
    rows: str, head: str, reason: str, boxed: Body, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=reason):
        fit_clothes(written(tmp_path, rows, head), boxed)
    with pytest.raises(InputError, match=r"none\.mhclo: no such file"):
        read_binding(tmp_path / "none.mhclo")


def test_the_shipped_body_holds_the_base_mesh_that_it_is_part_of(body: Body, tmp_path: Path) -> None:
    from scipy.spatial import KDTree

    assert body.base is not None
    assert body.base.shape == (19158, 3)
    assert KDTree(body.base.numpy()).query(body.mesh.vertices.numpy())[0].max() == 0.0
    save_body(body, tmp_path / "copy.npz")
    copied = load_body(tmp_path / "copy.npz").base
    assert copied is not None
    assert torch.equal(copied, body.base)
    save_body(replace(body, base=None), tmp_path / "bare.npz")
    assert load_body(tmp_path / "bare.npz").base is None
