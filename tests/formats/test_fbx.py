"""FBX files: a skinned bar in ASCII, in centimetres with Z up, written here."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.formats.fbx_text import array, document, model
from uvcloth.characters.reader import read_character
from uvcloth.errors import InputError
from uvcloth.formats import fbx
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.geometry.authored import AuthoredMesh
from uvcloth.motion.gltf import animation_names, read_gltf_motion

TICKS = 46186158000
"""Units of time of FBX in a second."""

BAR = np.array([(x, y, z) for z in (0.0, 100.0) for x, y in ((-5, -5), (5, -5), (5, 5), (-5, 5))], float)
"""Corners (8, 3) cm of a bar from the floor to 1 m, Z up."""

SIDES = ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


def bar_text() -> str:
    """A bar on two bones, 50 cm each, of which the upper one turns by 90 degrees about X in a second."""
    corners = [corner if place < 3 else -corner - 1 for side in SIDES for place, corner in enumerate(side)]
    uvs = np.tile([[0.0, 0.0], [0.25, 0.0], [0.25, 1.0], [0.0, 1.0]], (4, 1))
    objects = "\n".join(
        [
            f'Geometry: 1, "Geometry::bar", "Mesh" {{ {array("Vertices", BAR.reshape(-1))}'
            f"{array('PolygonVertexIndex', corners)} LayerElementUV: 0 {{ Version: 101\n"
            'Name: "map"\n MappingInformationType: "ByPolygonVertex"\n ReferenceInformationType: "Direct"\n'
            f"{array('UV', uvs.reshape(-1))} }}\n Layer: 0 {{ Version: 100\n LayerElement: {{\n"
            ' Type: "LayerElementUV"\n TypedIndex: 0\n } } }',
            model(2, "bar", "Mesh"),
            model(3, "low", "LimbNode"),
            model(4, "high", "LimbNode", (0, 0, 50)),
            'NodeAttribute: 5, "NodeAttribute::", "LimbNode" { TypeFlags: "Skeleton"\n }',
            'NodeAttribute: 6, "NodeAttribute::", "LimbNode" { TypeFlags: "Skeleton"\n }',
            'Material: 7, "Material::red", "" { Version: 102\n ShadingModel: "phong"\n Properties70: {\n'
            ' P: "DiffuseColor", "Color", "", "A",0.5,0.25,0.125\n } }',
            'Deformer: 8, "Deformer::", "Skin" { Version: 101\n }',
            cluster(9, range(4), (0, 0, 0)),
            cluster(10, range(4, 8), (0, 0, 50)),
            'AnimationStack: 11, "AnimStack::bend", "" { Properties70: {\n'
            f' P: "LocalStart", "KTime", "Time", "",0\n P: "LocalStop", "KTime", "Time", "",{TICKS}\n }} }}',
            'AnimationLayer: 12, "AnimLayer::base", "" {\n }',
            'AnimationCurveNode: 13, "AnimCurveNode::R", "" { Properties70: {\n'
            ' P: "d|X", "Number", "", "A",0\n } }',
            f'AnimationCurve: 14, "AnimCurve::", "" {{ Default: 0\n KeyVer: 4008\n'
            f"{array('KeyTime', (0, TICKS))}{array('KeyValueFloat', (0, 90))}{array('KeyAttrFlags', (260,))}"
            f"{array('KeyAttrDataFloat', (0, 0, 0, 0))}{array('KeyAttrRefCount', (2,))} }}",
        ]
    )
    links = ((2, 0), (1, 2), (3, 0), (4, 3), (5, 3), (6, 4), (7, 2), (8, 1), (9, 8), (10, 8), (3, 9), (4, 10))
    links = (*links, (12, 11), (13, 12))
    connections = "\n".join(f'C: "OO",{child},{parent}' for child, parent in links)
    return document(objects, f'{connections}\nC: "OP",13,4, "Lcl Rotation"\nC: "OP",14,13, "d|X"')


def cluster(number: int, vertices: range, place: tuple[int, int, int]) -> str:
    link, back = np.eye(4), np.eye(4)
    link[3, :3], back[3, :3] = place, [-value for value in place]
    return (
        f'Deformer: {number}, "SubDeformer::", "Cluster" {{ Version: 100\n'
        f"{array('Indexes', list(vertices))}{array('Weights', [1.0] * len(vertices))}"
        f"{array('Transform', back.reshape(-1))}{array('TransformLink', link.reshape(-1))} }}"
    )


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fbx") / "bar.fbx"
    path.write_text(bar_text(), encoding="utf-8")
    return path


def test_the_motion_of_an_fbx_turns_its_bones_in_metres_with_y_up(bar: Path) -> None:
    assert animation_names(bar) == ["bend"]
    clip = read_gltf_motion(bar)
    assert (clip.skeleton.names, clip.skeleton.parents) == (("low", "high"), (-1, 0))
    assert torch.allclose(clip.skeleton.heads, torch.tensor([[0.0, 0, 0], [0, 0.5, 0]]), atol=1e-5)
    # X is the same axis in both systems. The file's curve has flat tangents or straight ones: its ends count.
    turn = torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert torch.allclose(clip.rotations[0, 1], torch.eye(3), atol=1e-4)
    assert torch.allclose(clip.rotations[-1, 1], turn, atol=1e-4)
    assert len(clip) / clip.fps == pytest.approx(1.0, abs=2 / clip.fps)


def test_a_character_in_an_fbx_has_its_mesh_weights_and_material(bar: Path) -> None:
    character = read_character(bar)
    (part,) = character.parts
    assert (part.name, part.material, character.joints) == ("bar", "red", ("low", "high"))
    vertices = part.mesh.vertices
    assert torch.allclose(vertices.amax(0) - vertices.amin(0), torch.tensor([0.1, 1.0, 0.1]), atol=1e-5)
    assert torch.equal(part.weights[:, 1] == 1.0, vertices[:, 1] > 0.5)
    assert float(part.mesh.uvs.max()) == 1.0


def test_the_mesh_of_an_fbx_is_a_garment_s_with_its_colour(bar: Path) -> None:
    mesh = read_mesh(bar)
    assert isinstance(mesh, AuthoredMesh)
    assert len(mesh.faces) == 8
    (material,) = mesh.polygons.materials
    assert material.color[:3] == pytest.approx([value ** (1 / 2.2) for value in (0.5, 0.25, 0.125)], abs=1e-3)


def test_an_fbx_that_cannot_be_read_is_refused_with_the_way_through_blender(
    bar: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    damaged = tmp_path / "cut.fbx"
    damaged.write_bytes(bar.read_bytes()[:2000] + b"\x00" * 40)
    with pytest.raises(
        InputError, match=r"cut\.fbx: not a readable FBX file \(.*\).*Blender.*docs/motion\.md"
    ):
        read_gltf_motion(damaged)
    monkeypatch.setattr(fbx, "find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"bar\.fbx: .*install uvcloth\[fbx\], or .*Blender.*docs/motion\.md"
    ):
        read_gltf_motion(bar)


def test_a_conversion_that_ends_its_process_is_an_error_of_one_sentence(
    bar: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker = tmp_path / "worker.py"
    worker.write_text("import os; os.abort()")
    monkeypatch.setattr(fbx, "FBX_WORKER", worker)
    with pytest.raises(InputError, match=r"bar\.fbx: not a readable FBX file \(ufbx ended with code -6\)"):
        read_gltf_motion(bar)
