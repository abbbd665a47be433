"""OBJ files, read back with trimesh."""

import numpy as np
import pytest
import torch
import trimesh

from uvcloth.errors import InputError
from uvcloth.geometry.authored import Texture
from uvcloth.geometry.mesh import Mesh
from uvcloth.writers.obj import save_obj
from uvcloth.writers.textures import save_texture

SQUARE = Mesh(
    vertices=torch.tensor([[0.0, 0, 0.1], [1, 0, 0.2], [1, 1, 0.3], [0, 1, 0.4]]),
    faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
    uvs=torch.tensor([[0.0, 0], [0.5, 0], [0.5, 1], [0, 1]]),
    face_uvs=torch.tensor([[0, 1, 2], [0, 2, 3]]),
)


def test_positions_order_and_texture_coordinates_survive(tmp_path):
    save_obj(SQUARE, tmp_path / "square.obj")
    read = trimesh.load(tmp_path / "square.obj", process=False, maintain_order=True)
    np.testing.assert_allclose(read.vertices, SQUARE.vertices, atol=1e-7)
    np.testing.assert_array_equal(read.faces, SQUARE.faces)
    np.testing.assert_allclose(read.visual.uv, SQUARE.uvs, atol=1e-7)


def test_another_suffix_is_refused_and_leaves_nothing(tmp_path):
    with pytest.raises(InputError, match=r"square\.fbx"):
        save_obj(SQUARE, tmp_path / "square.fbx")
    assert not list(tmp_path.iterdir())


def test_a_file_in_the_place_of_the_folder_is_named(tmp_path):
    (tmp_path / "file.txt").write_text("")
    with pytest.raises(InputError, match=r"file\.txt: cannot be made a folder"):
        save_obj(SQUARE, tmp_path / "file.txt" / "square.obj")


def test_a_failed_write_leaves_nothing(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("numpy.savetxt", full)
    with pytest.raises(InputError, match="No space left"):
        save_obj(SQUARE, tmp_path / "square.obj")
    assert not list(tmp_path.iterdir())


def test_a_picture_gets_a_name_that_every_system_has(tmp_path):
    """The name is what a glTF file calls it."""
    assert save_texture(Texture('a: "b"', ".png", b"dots"), tmp_path / "coat.obj") == "coat_a___b_.png"
    assert (tmp_path / "coat_a___b_.png").read_bytes() == b"dots"
