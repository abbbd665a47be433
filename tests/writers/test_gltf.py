"""The file read back with pygltflib and evaluated by the specification's rules, and the Khronos validator."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.writers.glb_reader import GlbReader, require_clean, to_z_up
from uvcloth.errors import InputError
from uvcloth.geometry.skinning import skin
from uvcloth.writers.animation import Animation
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf import write_glb
from uvcloth.writers.gltf_scene import split_seams, unit_normals


@pytest.fixture(scope="module")
def path(animation: Animation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("glb") / "walk.glb"
    write_glb(animation, path)
    return path


@pytest.fixture(scope="module")
def glb(path: Path) -> GlbReader:
    return GlbReader.load(path)


def test_garment_frames_are_the_vertices(glb: GlbReader, animation: Animation) -> None:
    for index, name in enumerate(animation.names):
        source = glb.source(name)
        count = len(animation.meshes[index].vertices)
        np.testing.assert_array_equal(source[:count], np.arange(count))
        corners = glb.read(glb.mesh(name).primitives[0].indices).astype(int).reshape(-1, 3)
        for frame in range(len(animation)):
            weights = glb.weights(name, frame)
            written = to_z_up(glb.morphed(name, weights))
            assert np.abs(written - animation.vertices[index][frame, source]).max() < 1e-5
            normals = to_z_up(glb.morphed(name, weights, "NORMAL"))
            a, b, c = (animation.vertices[index][frame, corner] for corner in animation.meshes[index].faces.T)
            flat = np.cross(b - a, c - a)
            agreement = (normals[corners[:, 0]] * flat).sum(-1) / np.linalg.norm(flat, axis=-1)
            assert np.median(agreement) > 0.98


def test_seam_vertices_follow_the_mesh_s_own(animation: Animation) -> None:
    mesh = animation.meshes[0]
    source, _, uvs = split_seams(mesh)
    corners = torch.stack([mesh.faces.ravel(), mesh.face_uvs.ravel()], dim=1)
    assert len(source) == len(corners.unique(dim=0)) > len(mesh.vertices)
    assert len(uvs) == len(source)


def test_normals_are_unit_and_a_vertex_without_faces_points_up(animation: Animation) -> None:
    mesh = animation.meshes[0]
    alone = torch.cat([mesh.vertices, torch.ones(1, 3)]).numpy()
    normals = unit_normals(alone, mesh)
    assert normals[-1].tolist() == [0.0, 0.0, 1.0]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-5)


def test_body_follows_its_joints(glb: GlbReader, animation: Animation) -> None:
    body = animation.body
    assert body is not None
    source = glb.source("body")
    four = body.weights.topk(4, dim=1)
    pruned = torch.zeros_like(body.weights).scatter(1, four.indices, four.values)
    pruned /= pruned.sum(1, keepdim=True)
    for frame in (0, 13, len(animation) - 1):
        written = glb.posed("body", frame)
        transforms = torch.from_numpy(animation.transforms[frame : frame + 1])
        expected = skin(body.mesh.vertices, pruned, transforms)[0].numpy()
        assert np.abs(written - expected[source]).max() < 1e-5
        full = skin(body.mesh.vertices, body.weights, transforms)[0].numpy()
        error = np.linalg.norm(written - full[source], axis=1)
        print(f"frame {frame}: mean {error.mean() * 1e3:.3f} mm, max {error.max() * 1e3:.2f} mm")
        assert error.mean() < 2e-4


def test_khronos_validator_finds_nothing(path: Path) -> None:
    require_clean(path)


def test_a_file_of_four_gibibytes_is_refused(tmp_path: Path) -> None:
    document = Document(length=2**31)
    document.write(tmp_path / "head.glb")
    document.length = 2**32 - (tmp_path / "head.glb").stat().st_size
    with pytest.raises(InputError, match=r"large\.glb: 4\.0 GiB do not fit"):
        document.write(tmp_path / "large.glb")
    document.length -= 4
    document.write(tmp_path / "largest.glb")
