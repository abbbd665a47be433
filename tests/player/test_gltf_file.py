"""Binary glTF read with NumPy alone: arrays of every kind, and files that are not whole."""

from pathlib import Path

import numpy as np
import pytest

from tests.small_gltf import document, sparse_document, write_glb, write_gltf
from uvcloth.formats.gltf import read_gltf
from uvcloth.player.gltf_file import read_glb


@pytest.mark.parametrize("zeros", [True, False])
def test_sparse_accessors_are_what_plain_ones_are(tmp_path: Path, zeros: bool) -> None:
    plain = read_glb(write_glb(tmp_path / "plain.glb", *document()))
    sparse = read_glb(write_glb(tmp_path / "sparse.glb", *sparse_document(zeros)))
    for index, entry in enumerate(plain.entries("accessors")):
        np.testing.assert_array_equal(plain.array(index, entry["type"]), sparse.array(index, entry["type"]))


def test_strided_and_normalized_numbers(tmp_path: Path) -> None:
    written, content = document()
    rows = np.zeros((4, 8), np.uint8)
    rows[:, :4] = [[0, 51, 255, 0], [1, 2, 3, 0], [4, 5, 6, 0], [7, 8, 9, 0]]
    rows[:, 4:] = 99
    start = len(content)
    written["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": 32, "byteStride": 8})
    entry = {"bufferView": len(written["bufferViews"]) - 1, "componentType": 5121, "count": 4, "type": "VEC3"}
    written["accessors"] += [entry, entry | {"normalized": True}, entry | {"componentType": 5120}]
    written["accessors"][-1]["normalized"] = True
    written["buffers"][0]["byteLength"] += 32
    file = read_glb(write_glb(tmp_path / "a.glb", written, content + rows.tobytes()))
    last = len(written["accessors"])
    np.testing.assert_array_equal(file.array(last - 3, "VEC3"), rows[:, :3])
    np.testing.assert_allclose(file.array(last - 2, "VEC3"), rows[:, :3] / 255)
    np.testing.assert_allclose(file.array(last - 1, "VEC3")[0], [0.0, 51 / 127, -1 / 127], atol=1e-6)


def test_the_laboratory_reads_the_same(tmp_path: Path) -> None:
    path = write_glb(tmp_path / "a.glb", *document())
    player, laboratory = read_glb(path), read_gltf(path)
    assert player.document == laboratory.document
    for index, entry in enumerate(player.entries("accessors")):
        np.testing.assert_array_equal(
            player.array(index, entry["type"]), laboratory.array(index, entry["type"])
        )


def test_files_that_are_not_whole(tmp_path: Path) -> None:
    whole = write_glb(tmp_path / "a.glb", *document()).read_bytes()
    for length in range(0, len(whole), 37):
        (tmp_path / "cut.glb").write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"cut\.glb: not a complete glTF file"):
            read_glb(tmp_path / "cut.glb")
    write_gltf(tmp_path / "b.gltf", *document())
    file = read_glb(tmp_path / "b.gltf")
    with pytest.raises(ValueError, match=r"b\.gltf: keeps its data in other files, expected all in one"):
        file.array(0, "VEC3")
