"""glTF files that lie: what their JSON says is checked before it is believed, and nothing else is opened."""

import base64
import json
from collections.abc import Callable
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.small_gltf import document, sparse_document, write_glb, write_gltf
from uvcloth.characters.reader import read_character
from uvcloth.errors import InputError
from uvcloth.formats.gltf import read_gltf
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.geometry.authored import AuthoredMesh
from uvcloth.motion.gltf import read_gltf_motion

Document = dict[str, Any]


def put(*way: Any) -> Callable[[Document], None]:
    """A change that puts the last of some words at the place that the others lead to."""
    *holders, key, value = way

    def change(written: Document) -> None:
        place: Any = written
        for holder in holders:
            place = place[holder]
        place[key] = value

    return change


def read_all(path: Path) -> None:
    read_mesh(path)
    read_character(path)
    read_gltf_motion(path)


def test_the_unchanged_file_is_what_was_written(tmp_path: Path) -> None:
    for path in (write_glb(tmp_path / "a.glb", *document()), write_gltf(tmp_path / "b.gltf", *document())):
        mesh = read_mesh(path)
        assert isinstance(mesh, AuthoredMesh)
        assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
        texture = mesh.polygons.materials[0].texture
        assert texture is not None
        assert texture.content.startswith(b"\x89PNG")
        assert read_character(path).joints == ("hips", "chest")
        assert len(read_gltf_motion(path)) == 31


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (put("accessors", 0, "count", 10**10), "accessor 0 reaches beyond"),
        (put("accessors", 0, "byteOffset", 10**9), "accessor 0 reaches beyond"),
        (put("accessors", 0, "count", -1), r"accessors\[0\]\.count is -1"),
        (put("accessors", 0, "count", 1e400), r"accessors\[0\]\.count is inf"),
        (put("accessors", 0, "bufferView", 99), r"bufferView is 99, expected one of the 12 bufferViews"),
        (put("accessors", 0, "componentType", 5130), "accessor 0 is VEC3 of 5130"),
        (put("accessors", 0, "type", "VEC2"), "accessor 0 is VEC2 of 5126, expected VEC3"),
        (put("accessors", 0, "sparse", {"count": 1}), r"accessors\[0\]\.sparse has no indices"),
        (put("bufferViews", 0, "byteLength", 10**12), r"bufferViews\[0\] reaches beyond"),
        (put("bufferViews", 0, "byteOffset", -8), r"byteOffset is -8"),
        (put("bufferViews", 0, "byteStride", 0), "elements that overlap"),
        (put("buffers", 0, "uri", "data:application/octet-stream;base64,AAAA"), "reaches beyond"),
        (put("meshes", 0, "primitives", 0, "indices", 4), "accessor 4 is VEC4"),
        (put("nodes", 1, "children", [0]), "is its own ancestor"),
        (put("nodes", 2, "children", [1]), "child of two nodes"),
        (put("nodes", 0, "scale", [1, 1]), r"nodes\[0\]\.scale is \[1, 1\], expected 3 numbers"),
        (put("nodes", 0, "translation", [1e39, 0, 0]), r"expected 3 numbers"),
        (put("nodes", 2, "rotation", [0, 0, 0, 0]), r"nodes\[2\]\.rotation: is 0, 0, 0, 0, expected a unit"),
        (put("scene", 3), "scene is 3, expected one of the 1 scenes"),
        (put("asset", "version", "1.0"), r"is glTF 1\.0, expected 2\.0"),
        (put("extensionsRequired", ["KHR_draco_mesh_compression"]), r"is compressed \(KHR_draco_mesh"),
        (put("extensionsRequired", ["EXT_meshopt_compression"]), r"is compressed \(EXT_meshopt_comp"),
        (put("extensions", {"VRMC_vrm": {"humanoid": {"humanBones": 3}}}), "neither a list nor an object"),
        (put("extensions", {"VRM": {"humanoid": {"humanBones": [3]}}}), "damaged, 3 is no bone"),
        (
            put("extensions", {"VRMC_vrm": {"humanoid": {"humanBones": {"hips": {"node": 9}}}}}),
            "damaged, hips is node 9, which does not exist",
        ),
        (
            put(
                "extensions", {"VRMC_vrm": {"humanoid": {"humanBones": {bone: {"node": 0} for bone in "ab"}}}}
            ),
            "damaged, node 0 is both a and b",
        ),
        (put("materials", 0, "pbrMetallicRoughness", []), "pbrMetallicRoughness is .*, expected an object"),
    ],
)
def test_what_a_file_claims_is_checked(change: Callable[[Document], None], said: str, tmp_path: Path) -> None:
    written, content = document()
    change(written)
    with pytest.raises(InputError, match=rf"lie\.glb: .*{said}"):
        read_all(write_glb(tmp_path / "lie.glb", written, content))


def test_a_mesh_is_read_without_its_textures_in_ktx2(tmp_path: Path) -> None:
    written, content = document()
    put("textures", 0, {"extensions": {"KHR_texture_basisu": {"source": 0}}})(written)
    mesh = read_mesh(write_glb(tmp_path / "box.glb", written, content))
    assert isinstance(mesh, AuthoredMesh)
    assert mesh.polygons.materials[0].texture is None
    (said,) = mesh.polygons.missing
    assert said.startswith("textures in KTX2, which is not read: `gltf-transform ktxdecompress`")


def test_a_key_that_is_no_rotation_is_refused(tmp_path: Path) -> None:
    written, content = document()
    keys = written["animations"][0]["samplers"][0]["output"]
    start = written["bufferViews"][written["accessors"][keys]["bufferView"]]["byteOffset"] + 16
    zeroed = content[:start] + bytes(16) + content[start + 16 :]
    with pytest.raises(InputError, match=r"lie\.glb: a rotation of the animation is 0, 0, 0, 0"):
        read_gltf_motion(write_glb(tmp_path / "lie.glb", written, zeroed))


@pytest.mark.parametrize("zeros", [False, True])
def test_sparse_accessors_hold_what_whole_ones_do(zeros: bool, tmp_path: Path) -> None:
    whole = write_glb(tmp_path / "box.glb", *document())
    (tmp_path / "sparse").mkdir()
    sparse = write_glb(tmp_path / "sparse" / "box.glb", *sparse_document(zeros))
    meshes, characters = (
        [read_mesh(path) for path in (whole, sparse)],
        [*map(read_character, (whole, sparse))],
    )
    assert torch.equal(meshes[0].vertices, meshes[1].vertices)
    assert torch.equal(meshes[0].faces, meshes[1].faces)
    assert torch.equal(meshes[0].uvs, meshes[1].uvs)
    assert torch.equal(characters[0].heads, characters[1].heads)
    for name in ("mesh.vertices", "weights"):
        expected, found = (attrgetter(name)(character.parts[0]) for character in characters)
        assert torch.equal(expected, found), name
    clips = [read_gltf_motion(path) for path in (whole, sparse)]
    assert torch.equal(clips[0].rotations, clips[1].rotations)
    assert torch.equal(clips[0].translation, clips[1].translation)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (put("accessors", 0, "sparse", "count", 0), "accessor 0 is sparse with 0 indices of 5121"),
        (put("accessors", 0, "sparse", "count", 9), "accessor 0 is sparse with 9 indices of 5121"),
        (
            put("accessors", 0, "sparse", "indices", "componentType", 5126),
            "4 indices of 5126, expected 1 to 8",
        ),
        (put("accessors", 0, "sparse", "indices", "bufferView", 99), "bufferView is 99, expected one of the"),
        (put("accessors", 0, "sparse", "indices", "byteOffset", 1), r"accessor 0\.sparse\.indices reaches"),
        (put("accessors", 0, "sparse", "values", "byteOffset", 10**9), r"accessor 0\.sparse\.values reaches"),
        (
            put("accessors", 0, "sparse", "indices", "bufferView", 4),
            "indices that do not increase or are bey",
        ),
        (put("accessors", 0, "count", 6), "indices that do not increase or are beyond its 6"),
    ],
)
def test_what_a_sparse_accessor_claims_is_checked(
    change: Callable[[Document], None], said: str, tmp_path: Path
) -> None:
    written, content = sparse_document(zeros=False)
    change(written)
    with pytest.raises(InputError, match=rf"lie\.glb: .*{said}"):
        read_all(write_glb(tmp_path / "lie.glb", written, content))


def test_zeros_without_data_are_few(tmp_path: Path) -> None:
    written, content = sparse_document(zeros=True)
    written["accessors"][0]["count"] = 10**12
    path = write_glb(tmp_path / "zeros.glb", written, content)
    with pytest.raises(InputError, match=r"accessor 0 has 1000000000000 elements without data"):
        read_character(path)
    written["accessors"][0]["count"] = 8
    written["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    with pytest.raises(InputError, match=r"accessor 10 is compressed \(KHR_draco_mesh_compression\)"):
        read_mesh(write_glb(path, written, content))


def test_views_that_only_meshopt_would_fill_are_named(tmp_path: Path) -> None:
    written, content = document()
    written["buffers"].append({"byteLength": 10_000})
    written["bufferViews"][0] |= {"buffer": 1, "extensions": {"EXT_meshopt_compression": {"buffer": 0}}}
    path = write_glb(tmp_path / "packed.glb", written, content)
    with pytest.raises(InputError, match=r"bufferViews\[0\] is compressed \(EXT_mesh.* `gltf-transform copy"):
        read_character(path)


def test_a_skinned_mesh_is_where_its_joints_put_it(tmp_path: Path) -> None:
    written, content = document()
    expected = read_mesh(write_glb(tmp_path / "box.glb", written, content)).vertices
    # The armature is scaled and moved; the matrices of the skin take the mesh into its units.
    written["nodes"].append({"name": "Armature", "children": [0], "scale": [0.01] * 3})
    written["nodes"][0]["translation"] = [100 * each for each in written["nodes"][0]["translation"]]
    written["nodes"][1]["translation"] = [100 * each for each in written["nodes"][1]["translation"]]
    written["nodes"][2] |= {"scale": [7.0] * 3, "translation": [1.0, 2.0, 3.0]}
    written["nodes"][3]["translation"] = [0.0, 5.0, 0.0]
    written["scenes"][0]["nodes"] = [3, 2]
    matrices = written["skins"][0]["inverseBindMatrices"]
    start = written["bufferViews"][matrices]["byteOffset"]
    inverse = np.frombuffer(content, "<f4", 32, start).reshape(2, 4, 4).copy()
    inverse[:, :, :3] *= 100
    content = content[:start] + inverse.tobytes() + content[start + inverse.nbytes :]
    path = write_glb(tmp_path / "scaled.glb", written, content)
    torch.testing.assert_close(read_mesh(path).vertices, expected + torch.tensor([0.0, 5.0, 0.0]).double())
    height = read_character(path).parts[0].mesh.vertices[:, 1]
    assert float(height.max() - height.min()) == pytest.approx(float(np.ptp(expected[:, 1].numpy())))


def test_quantized_positions_are_placed_by_their_node(tmp_path: Path) -> None:
    written, content = document()
    expected = read_mesh(write_glb(tmp_path / "box.glb", written, content)).vertices
    attributes, view = written["meshes"][0]["primitives"][0]["attributes"], written["bufferViews"][0]
    quantized = np.rint(expected.numpy() * 10_000).astype("<i2")
    start = view["byteOffset"]
    padded = np.zeros((8, 4), "<i2")
    padded[:, :3] = quantized
    content = content[:start] + padded.tobytes() + content[start + padded.nbytes :]
    view |= {"byteLength": padded.nbytes, "byteStride": 8}
    written["accessors"][attributes["POSITION"]]["componentType"] = 5122
    del written["nodes"][2]["skin"]
    written["nodes"][2]["scale"] = [1e-4, 1e-4, 1e-4]
    written["extensionsRequired"] = ["KHR_mesh_quantization"]
    found = read_mesh(write_glb(tmp_path / "quantized.glb", written, content)).vertices
    assert (found - expected).abs().max() <= 0.5e-4


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (put("skins", 0, "joints", [0, 0]), "each once"),
        (put("skins", 0, "joints", [0]), "has a weight for a joint that its skin does not have"),
        (put("accessors", 10, "count", 1), "1 inverse bind matrices for 2 joints"),
        (put("nodes", 0, "scale", [1, 0, 1]), "the bind pose of joint hips"),
        (put("nodes", 0, "name", 300 * "x"), None),
        (put("accessors", 1, "count", 3), "has 8 vertices, accessor 1 has 3 elements"),
    ],
)
def test_what_a_skin_claims_is_checked(
    change: Callable[[Document], None], said: str | None, tmp_path: Path
) -> None:
    written, content = document()
    change(written)
    path = write_glb(tmp_path / "skin.glb", written, content)
    if said is None:
        assert len(read_character(path).joints[0]) == 200
        return
    with pytest.raises(InputError, match=rf"skin\.glb: .*{said}"):
        read_character(path)


def test_keys_far_apart_do_not_make_frames_without_end(tmp_path: Path) -> None:
    written, content = document()
    times = written["animations"][0]["samplers"][0]["input"]
    start = written["bufferViews"][times]["byteOffset"]
    far = np.array([0.0, 0.5, 1e8], np.float32).tobytes()
    path = write_glb(tmp_path / "slow.glb", written, content[:start] + far + content[start + 12 :])
    with pytest.raises(InputError, match=r"slow\.glb: the animation has 3 keys in 100000000 s"):
        read_gltf_motion(path)
    turns = written["animations"][0]["samplers"][0]["output"]
    written["accessors"][turns]["count"] = 10**12
    write_glb(path, written, content[:start] + far + content[start + 12 :])
    with pytest.raises(InputError, match=r"slow\.glb: the animation has 3 keys in 100000000 s"):
        read_gltf_motion(path)


def test_vertices_of_many_nodes_are_counted_before_they_are_made(tmp_path: Path) -> None:
    for meshes, vertices, said in ((2100, 3, "more than 2,000 meshes"), (210, 999, "has 200,799 vertices")):
        accessor = {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": vertices}
        written = {
            "asset": {"version": "2.0"},
            "nodes": [{"mesh": 0} for _ in range(meshes)],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [accessor],
            "bufferViews": [{"buffer": 0, "byteLength": 12 * vertices}],
            "buffers": [{"byteLength": 12 * vertices}],
        }
        with pytest.raises(InputError, match=rf"many\.glb: .*{said}"):
            read_mesh(write_glb(tmp_path / "many.glb", written, bytes(12 * vertices)))


def test_nesting_ends_as_a_damaged_file(tmp_path: Path) -> None:
    path = tmp_path / "deep.gltf"
    path.write_text('{"asset": ' + 100_000 * "[" + 100_000 * "]" + "}")
    with pytest.raises(InputError, match=r"deep\.gltf: not a complete glTF file"):
        read_gltf(path)


@pytest.mark.parametrize(
    "name", ["../secret", "{folder}/secret", "file:///{folder}/secret", "link", "a%2F..%2F..%2Fsecret"]
)
def test_buffers_outside_the_folder_are_not_read(name: str, tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    written, content = document()
    (tmp_path / "secret").write_bytes(content)
    (inside / "link").symlink_to(tmp_path / "secret")
    path = write_gltf(inside / "box.gltf", written, content)
    assert len(read_mesh(path).vertices) == 8
    written["buffers"][0]["uri"] = name.format(folder=tmp_path)
    path.write_text(json.dumps(written))
    with pytest.raises(InputError, match=r"box\.gltf: its buffer .* outside inside"):
        read_mesh(path)


def test_nothing_is_fetched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object, **named: object) -> None:
        raise AssertionError(f"a connection to {arguments}")

    monkeypatch.setattr("socket.socket.connect", refuse)
    monkeypatch.setattr("socket.getaddrinfo", refuse)
    written, content = document()
    path = write_gltf(tmp_path / "box.gltf", written, content)
    written["images"] = [{"uri": "http://127.0.0.1:9/wool.png"}]
    path.write_text(json.dumps(written))
    mesh = read_mesh(path)
    assert isinstance(mesh, AuthoredMesh)
    assert mesh.polygons.materials[0].texture is None
    assert "http://127.0.0.1:9/wool.png lies outside" in mesh.polygons.missing[-1]
    written["buffers"][0]["uri"] = "https://127.0.0.1:9/box.bin"
    path.write_text(json.dumps(written))
    with pytest.raises(
        InputError, match=r"box\.gltf: its buffer https://127\.0\.0\.1:9/box\.bin lies outside"
    ):
        read_mesh(path)


@pytest.mark.parametrize("name", ["../secret.png", "{folder}/secret.png", "link.png", "..%2Fsecret.png"])
def test_pictures_outside_the_folder_are_left_out(name: str, tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.png").write_bytes(b"secret")
    (inside / "link.png").symlink_to(tmp_path / "secret.png")
    written, content = document()
    path = write_gltf(inside / "box.gltf", written, content)
    written["images"] = [{"uri": name.format(folder=tmp_path)}]
    path.write_text(json.dumps(written))
    mesh = read_mesh(path)
    assert isinstance(mesh, AuthoredMesh)
    assert mesh.polygons.materials[0].texture is None
    assert "outside inside" in mesh.polygons.missing[-1]


def test_a_large_data_uri_is_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written, content = document()
    written["buffers"][0]["uri"] = "data:;base64," + base64.b64encode(content + bytes(1 << 20)).decode()
    path = tmp_path / "large.gltf"
    path.write_text(json.dumps(written))
    decoded: list[int] = []
    decode = base64.b64decode
    monkeypatch.setattr("base64.b64decode", lambda text: decoded.append(len(text)) or decode(text))
    assert len(read_mesh(path).vertices) == 8
    assert len(decoded) == 1
