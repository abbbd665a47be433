"""The body as a file to model on: rest pose and texture coordinates, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.writers.glb_reader import GlbReader, to_z_up
from uvcloth.bodies.body import Body, load_body
from uvcloth.commands.body import MakeBody, Phenotype
from uvcloth.commands.run.body import make
from uvcloth.errors import InputError
from uvcloth.files.options import check_options
from uvcloth.formats.mesh_file import read_mesh


def test_the_body_comes_as_obj_glb_and_npz(body: Body, tmp_path: Path) -> None:
    for suffix in ("obj", "glb", "npz"):
        made = make(MakeBody(tmp_path / f"model.{suffix}"))
        assert (made.name, len(made.mesh.vertices)) == ("model", len(body.mesh.vertices))
    mesh = read_mesh(tmp_path / "model.obj")
    torch.testing.assert_close(mesh.vertices.float(), body.mesh.vertices)
    torch.testing.assert_close(mesh.uvs[mesh.face_uvs], body.mesh.uvs[body.mesh.face_uvs])
    glb = GlbReader.load(tmp_path / "model.glb")
    written = to_z_up(glb.morphed("body", np.zeros(0)))
    assert np.abs(written - body.mesh.vertices.numpy()[glb.source("body")]).max() < 1e-6
    assert torch.equal(load_body(tmp_path / "model.npz").mesh.faces, body.mesh.faces)


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"model\.fbx: the format \.fbx is not supported, use one of \.npz, \.obj"
    ):
        check_options(MakeBody(tmp_path / "model.fbx"))
    with pytest.raises(InputError, match="cannot be combined with phenotypes"):
        make(MakeBody(tmp_path / "model.npz", tmp_path / "other.npz", phenotype=Phenotype(height=0.9)))
