"""What survives of a file: polygons, groups, materials, textures, vertex colours and UV sets, read back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pygltflib
import pytest
import torch
import trimesh

from tests.writers.glb_reader import GlbReader, require_clean
from uvcloth.bodies.body import Body
from uvcloth.files.image import write_png
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.geometry.authored import AuthoredMesh, Labels, UvSet, follow_triangles, part_of
from uvcloth.methods.rig import PoseRig
from uvcloth.writers.alembic import write_abc
from uvcloth.writers.animation import Animation
from uvcloth.writers.gltf import write_glb
from uvcloth.writers.gltf_rig import write_rig_glb
from uvcloth.writers.obj import save_obj
from uvcloth.writers.obj_sequence import write_obj_sequence
from uvcloth.writers.rig import rig_of
from uvcloth.writers.usd import write_usd
from uvcloth.writers.usd_rig import write_rig_usd

FACES = """o front
g panel
usemtl denim
f 1/1 2/2 5/5 4/4
f 2/2 3/3 6/6 5/5
g collar
usemtl brass
f 4/4 5/5 6/6 8/8 7/7
o back
usemtl denim
f 9/1 7/7 8/10
"""

OBJ = f"""mtllib made up.mtl
v 0 0 0 1 0 0
v 1 0 0 1 0.5 0
v 2 0 0 1 1 0
v 0 1 0 0 1 0
v 1 1 0.2 0 1 1
v 2 1 0 0 0 1
v 0.5 2 0 1 0 1
v 1.5 2 0 0.5 0.5 0.5
v 1 3 0 0.2 0.4 0.6
vt 0 0
vt 0.5 0
vt 1 0
vt 0 0.5
vt 0.5 0.5
vt 1 0.5
vt 0.25 1
vt 0.75 1
vt 0.9 0.9
vt 0.1 0.7
{FACES}"""

MTL = """newmtl denim
Kd 1 1 1
map_Kd -s 1 1 1 cloth 1.png
newmtl brass
Kd 0.8 0.6 0.2
d 0.5
"""


@pytest.fixture
def drawn(tmp_path: Path) -> AuthoredMesh:
    """An OBJ of two quads, a pentagon and a triangle, two materials and a texture, read."""
    (tmp_path / "in").mkdir()
    write_png(tmp_path / "in" / "cloth 1.png", np.full((2, 2, 3), 0.5, np.float32))
    (tmp_path / "in" / "made up.mtl").write_text(MTL)
    (tmp_path / "in" / "vest.obj").write_text(OBJ)
    mesh = read_mesh(tmp_path / "in" / "vest.obj")
    assert isinstance(mesh, AuthoredMesh)
    return AuthoredMesh(mesh.vertices.float(), mesh.faces, mesh.uvs, mesh.face_uvs, mesh.polygons)


def moving(mesh: AuthoredMesh) -> Animation:
    frames = np.stack([mesh.vertices.numpy(), mesh.vertices.numpy() + np.float32(0.5)])
    return Animation(("vest",), (mesh,), (frames,), None, np.zeros((2, 0, 3, 4), np.float32), 30.0)


def two_sets(mesh: AuthoredMesh) -> AuthoredMesh:
    """The same with a second set of texture coordinates, one for each polygon corner."""
    polygons = mesh.polygons
    corners = np.arange(len(polygons.corners))
    second = UvSet(np.stack([corners / 16, 1 - corners / 16], 1).astype(np.float32), corners)
    uv_sets = (polygons.uv_sets[0], second)
    return AuthoredMesh.of(mesh.vertices, type(polygons)(**{**vars(polygons), "uv_sets": uv_sets}))


def lines(path: Path, *words: str) -> list[str]:
    return [line for line in path.read_text().splitlines() if line.split(" ")[0] in words]


def test_an_obj_comes_back_line_by_line(drawn: AuthoredMesh, tmp_path: Path) -> None:
    save_obj(drawn, tmp_path / "out.obj")
    assert lines(tmp_path / "out.obj", "o", "g", "usemtl", "f") == FACES.splitlines()
    for word in ("v", "vt"):
        numbers = [
            [[float(n) for n in line.split()[1:]] for line in lines(path, word)]
            for path in (tmp_path / "out.obj", tmp_path / "in" / "vest.obj")
        ]
        np.testing.assert_allclose(*numbers, atol=1e-6)
    assert (tmp_path / "out.obj").read_text().startswith("# metres, Z up\nmtllib out.mtl\n")
    assert lines(tmp_path / "out.mtl", "Kd", "d", "map_Kd") == [
        "Kd 1 1 1",
        "d 1",
        "map_Kd out_cloth_1.png",
        "Kd 0.8 0.6 0.2",
        "d 0.5",
    ]
    assert (tmp_path / "out_cloth_1.png").read_bytes() == (tmp_path / "in" / "cloth 1.png").read_bytes()


def test_an_obj_sequence_is_a_file_per_frame(drawn: AuthoredMesh, tmp_path: Path) -> None:
    some = replace(drawn.polygons, groups=Labels(("panel", "collar"), np.array([0, 0, 1, -1])))
    write_obj_sequence(moving(AuthoredMesh.of(drawn.vertices, some)), tmp_path / "walk.obj")
    assert sorted(path.name for path in tmp_path.glob("walk*")) == [
        "walk.mtl",
        "walk_00000.obj",
        "walk_00001.obj",
        "walk_vest_cloth_1.png",
    ]
    for frame in range(2):
        path = tmp_path / f"walk_{frame:05d}.obj"
        assert lines(path, "f") == [line for line in FACES.splitlines() if line.startswith("f")]
        read = read_mesh(path)
        torch.testing.assert_close(read.vertices.float(), drawn.vertices + 0.5 * frame, atol=1e-5, rtol=0)
        assert isinstance(read, AuthoredMesh)
        assert [material.texture is not None for material in read.polygons.materials] == [True, False]
        groups = read.polygons.groups
        assert [groups.names[label] for label in groups.of] == ["panel", "panel", "collar", "vest"]
        assert {len(line.split()) for line in lines(path, "v")} == {1 + 3 + 3}


def test_a_glb_has_materials_pictures_colours_and_all_uv_sets(drawn: AuthoredMesh, tmp_path: Path) -> None:
    mesh = two_sets(drawn)
    write_glb(moving(mesh), tmp_path / "walk.glb")
    reader = GlbReader.load(tmp_path / "walk.glb")
    gltf: pygltflib.GLTF2 = reader.gltf
    primitives = gltf.meshes[0].primitives
    assert [gltf.materials[each.material].name for each in primitives] == ["denim", "brass"]
    assert [gltf.materials[index].alphaMode or "OPAQUE" for index in (0, 1)] == ["OPAQUE", "BLEND"]
    view = gltf.bufferViews[gltf.images[0].bufferView]
    stored = gltf.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    assert stored == (tmp_path / "in" / "cloth 1.png").read_bytes()
    assert gltf.materials[0].pbrMetallicRoughness.baseColorTexture.index == 0
    source = reader.source("vest")
    assert (source[: len(mesh.vertices)] == np.arange(len(mesh.vertices))).all()
    attributes = primitives[0].attributes
    colors = reader.read(attributes.COLOR_0)
    assert mesh.polygons.colors is not None
    np.testing.assert_allclose(colors[:, :3] ** (1 / 2.2), mesh.polygons.colors[source][:, :3], atol=1e-5)
    # At every corner of every triangle both sets are those of the polygon's corner.
    corners, owner = mesh.polygons.triangles()
    for index, primitive in enumerate(primitives):
        indices = reader.read(primitive.indices).astype(int).ravel()
        own = corners[mesh.polygons.material[owner] == index].ravel()
        assert (source[indices] == mesh.polygons.corners[own]).all()
        for number, each in enumerate(mesh.polygons.uv_sets):
            uvs = reader.read(getattr(attributes, f"TEXCOORD_{number}"))[indices] * [1, -1] + [0, 1]
            np.testing.assert_allclose(uvs, each.uvs[each.corners[own]], atol=1e-6)


def test_a_glb_is_clean_and_other_readers_find_the_texture(drawn: AuthoredMesh, tmp_path: Path) -> None:
    write_glb(moving(two_sets(drawn)), tmp_path / "walk.glb")
    parts = trimesh.load_scene(tmp_path / "walk.glb", process=False).dump()
    pictures = [part.visual.material.baseColorTexture for part in parts]
    assert [picture is not None and picture.size for picture in pictures] == [(2, 2), False]
    require_clean(tmp_path / "walk.glb")


def test_a_glb_is_read_with_all_that_it_has(drawn: AuthoredMesh, tmp_path: Path) -> None:
    mesh = two_sets(drawn)
    write_glb(moving(mesh), tmp_path / "vest.glb")
    read = read_mesh(tmp_path / "vest.glb")
    assert isinstance(read, AuthoredMesh)
    again = read.polygons
    assert [len(each.uvs) for each in again.uv_sets] == [len(read.vertices)] * 2
    assert again.objects.names == ("vest",)
    assert [material.name for material in again.materials] == ["denim", "brass"]
    np.testing.assert_allclose(again.materials[1].color, (0.8, 0.6, 0.2, 0.5), atol=1e-6)
    assert again.materials[0].texture == mesh.polygons.materials[0].texture.__class__(
        "cloth 1", ".png", (tmp_path / "in" / "cloth 1.png").read_bytes()
    )
    assert again.colors is not None
    assert mesh.polygons.colors is not None
    np.testing.assert_allclose(again.colors[: len(mesh.vertices)], mesh.polygons.colors, atol=1e-5)


def test_usd_has_polygons_subsets_and_materials(drawn: AuthoredMesh, tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom, UsdShade

    write_usd(moving(two_sets(drawn)), tmp_path / "walk.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "walk.usdc"))
    geometry = UsdGeom.Mesh(stage.GetPrimAtPath("/Outfit/vest"))
    assert list(geometry.GetFaceVertexCountsAttr().Get()) == [4, 4, 5, 3]
    assert list(geometry.GetFaceVertexIndicesAttr().Get()) == drawn.polygons.corners.tolist()
    primvars = UsdGeom.PrimvarsAPI(geometry)
    assert list(primvars.GetPrimvar("st1").GetIndices()) == list(range(16))
    assert primvars.GetPrimvar("displayColor").GetInterpolation() == "vertex"
    subsets = {
        s.GetPrim().GetName(): list(s.GetIndicesAttr().Get())
        for s in UsdGeom.Subset.GetAllGeomSubsets(geometry)
    }
    assert subsets == {
        "object_front": [0, 1, 2],
        "object_back": [3],
        "group_panel": [0, 1],
        "group_collar": [2, 3],
        "materialBind_denim": [0, 1, 3],
        "materialBind_brass": [2],
    }
    denim = stage.GetPrimAtPath("/Outfit/vest/materialBind_denim")
    bound = UsdShade.MaterialBindingAPI(denim).ComputeBoundMaterial()[0]
    shader = bound.ComputeSurfaceSource("")[0]
    picture = UsdShade.Shader(shader.GetInput("diffuseColor").GetConnectedSource()[0].GetPrim())
    file = picture.GetInput("file").Get().path
    assert file == "./walk_vest_cloth_1.png"
    assert (tmp_path / file).read_bytes() == (tmp_path / "in" / "cloth 1.png").read_bytes()
    assert [picture.GetInput(name).Get() for name in ("wrapS", "wrapT")] == ["repeat", "repeat"]
    reader = UsdShade.Shader(picture.GetInput("st").GetConnectedSource()[0].GetPrim())
    assert reader.GetInput("varname").Get() == "st"


def test_alembic_has_polygons(drawn: AuthoredMesh, tmp_path: Path) -> None:
    alembic3d = pytest.importorskip("alembic3d", reason="alembic3d is not installed")
    write_abc(moving(drawn), tmp_path / "walk.abc")
    archive = alembic3d.Abc.IArchive(str(tmp_path / "walk.abc"))
    schema = alembic3d.AbcGeom.IPolyMesh(archive.getTop(), "vest").getSchema()
    sample = schema.getValue(alembic3d.Abc.ISampleSelector(0.0))
    assert list(sample.getFaceCounts()) == [4, 4, 5, 3]
    # Each the other way around.
    assert list(sample.getFaceIndices())[:4] == [0, 3, 4, 1]


def test_polygons_follow_triangles_that_were_dropped_or_turned(drawn: AuthoredMesh) -> None:
    faces, face_uvs = drawn.faces[2:].clone(), drawn.face_uvs[2:].clone()
    faces[2:5], face_uvs[2:5] = faces[2:5].flip(1), face_uvs[2:5].flip(1)
    mesh = follow_triangles(AuthoredMesh(drawn.vertices, faces, drawn.uvs, face_uvs, drawn.polygons))
    assert isinstance(mesh, AuthoredMesh)
    polygons = mesh.polygons
    assert polygons.sizes.tolist() == [4, 5, 3]
    assert polygons.corners.tolist() == [1, 2, 5, 4, 3, 6, 7, 5, 4, 8, 6, 7]
    assert polygons.uv_sets[0].corners.tolist() == [1, 2, 5, 4, 3, 6, 7, 5, 4, 0, 6, 9]
    corners, _ = polygons.triangles()
    assert {tuple(sorted(face)) for face in polygons.corners[corners].tolist()} == {
        tuple(sorted(face)) for face in faces.tolist()
    }


def test_a_piece_keeps_its_own_polygons_and_materials(drawn: AuthoredMesh) -> None:
    chosen = torch.tensor([False, False, False, True, True, True, True, True, False])
    mesh = part_of(drawn, chosen)
    assert isinstance(mesh, AuthoredMesh)
    assert mesh.polygons.sizes.tolist() == [5]
    assert mesh.polygons.corners.tolist() == [0, 1, 2, 4, 3]
    assert [material.name for material in mesh.polygons.materials] == ["brass"]
    assert (mesh.polygons.material.tolist(), mesh.polygons.groups.names) == ([0], ("collar",))
    assert mesh.polygons.colors is not None
    assert mesh.polygons.colors.shape == (5, 4)


def test_a_texture_that_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "made up.mtl").write_text(MTL)
    (tmp_path / "vest.obj").write_text(OBJ)
    mesh = read_mesh(tmp_path / "vest.obj")
    assert isinstance(mesh, AuthoredMesh)
    assert mesh.polygons.missing == ("cloth 1.png",)
    (tmp_path / "made up.mtl").unlink()
    again = read_mesh(tmp_path / "vest.obj")
    assert isinstance(again, AuthoredMesh)
    assert again.polygons.missing == ("made up.mtl",)
    assert [material.name for material in again.polygons.materials] == ["denim", "brass"]


def test_a_rig_keeps_materials_and_pictures(drawn: AuthoredMesh, body: Body, tmp_path: Path) -> None:
    count, joints = len(drawn.vertices), len(body.skeleton.names)
    poses = torch.rand(4, 3 * joints, generator=torch.Generator().manual_seed(0))
    rig = PoseRig(
        name="made up",
        garments=(("vest", drawn),),
        owner=torch.arange(count),
        weights=torch.eye(joints)[:1].expand(count, joints),
        shapes=torch.full((1, count, 3), 0.1),
        layers=((torch.ones(1, 3 * joints), torch.zeros(1)),),
        parents=body.skeleton.parents,
        poses=poses,
    )
    rigged = rig_of(rig, body, with_body=False).rig
    write_rig_glb(rigged, tmp_path / "rig.glb")
    gltf = GlbReader.load(tmp_path / "rig.glb").gltf
    primitives = gltf.meshes[0].primitives
    assert [gltf.materials[each.material].name for each in primitives] == ["denim", "brass"]
    assert [len(each.targets) for each in primitives] == [1, 1]
    assert all(each.attributes.JOINTS_0 is not None for each in primitives)
    assert len(gltf.images) == 1
    pytest.importorskip("pxr")
    write_rig_usd(rigged, tmp_path / "rig.usdc")
    assert (tmp_path / "rig_vest_cloth_1.png").read_bytes() == (tmp_path / "in" / "cloth 1.png").read_bytes()
