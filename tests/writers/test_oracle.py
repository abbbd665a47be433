"""What a file says is what was written: places, normals, texture coordinates, winding, weights and colours.

Every format is read by a library of others and evaluated here by its specification. The scene: a garment of
triangles, one of polygons and materials, and a body, or a character that wears a prop.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from tests.writers.glb_reader import GlbReader, to_z_up
from uvcloth.bodies.body import Appearance, Body
from uvcloth.bodies.visible import visible_body
from uvcloth.geometry.authored import AuthoredMesh, Labels, Polygons, SurfaceMaterial, UvSet
from uvcloth.geometry.mesh import Mesh
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS
from uvcloth.writers.gltf_rig import write_rig_glb
from uvcloth.writers.rig import Rig, RiggedGarment
from uvcloth.writers.usd_rig import write_rig_usd
from uvcloth.writers.writer import open_writer

alembic3d = pytest.importorskip("alembic3d", reason="alembic3d is not installed")
pytest.importorskip("pxr")
from pxr import Usd, UsdGeom, UsdShade, UsdSkel  # noqa: E402

FRAMES, AROUND, RINGS = 3, 7, 4
FPS = 25.0
DENIM, BRASS = (0.1, 0.3, 0.9, 1.0), (0.8, 0.5, 0.2, 0.5)


@dataclass(frozen=True)
class Thing:
    """An object as it has to be: mesh at rest, places (F, V, 3) m, colour of each triangle (T, 3) in sRGB.

    weights: (V, J) of what a skeleton moves.
    """

    mesh: Mesh
    places: np.ndarray
    colors: np.ndarray
    weights: np.ndarray | None = None


@dataclass(frozen=True)
class Seen:
    """Triangles as a reader finds them, Z up, counter-clockwise seen from outside, V from the bottom.

    places: (T, 3, 3) m. uvs: (T, 3, 2), normals: (T, 3, 3), colors: (T, 3) linear, weights: (T, 3, J).
    """

    places: np.ndarray
    uvs: np.ndarray | None = None
    normals: np.ndarray | None = None
    colors: np.ndarray | None = None
    weights: np.ndarray | None = None


def tube(radius: float, low: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """An open tube around Z: vertices, quads, texture coordinates with a seam, quads of these."""
    turn, ring = np.meshgrid(np.arange(AROUND), np.arange(RINGS))
    angle = 2 * np.pi * turn / AROUND
    wide = radius * (1 + 0.1 * ring)
    vertices = np.stack([wide * np.cos(angle), 0.7 * wide * np.sin(angle), low + 0.1 * ring], axis=-1)
    column, row = np.meshgrid(np.arange(AROUND + 1), np.arange(RINGS))
    uvs = np.stack([column / AROUND, 0.1 + 0.1 * row], axis=-1)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(AROUND), np.arange(RINGS - 1)))

    def quads(wide: int) -> np.ndarray:
        right = (i + 1) % wide
        return np.stack([i + j * wide, right + j * wide, right + (j + 1) * wide, i + (j + 1) * wide], axis=1)

    return vertices.reshape(-1, 3).astype(np.float32), quads(AROUND), uvs.reshape(-1, 2), quads(AROUND + 1)


def triangulated(quads: np.ndarray) -> np.ndarray:
    return quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def plain(radius: float, low: float) -> Mesh:
    vertices, quads, uvs, uv_quads = tube(radius, low)
    faces, face_uvs = triangulated(quads), triangulated(uv_quads)
    return Mesh(*map(torch.from_numpy, (vertices, faces, uvs.astype(np.float32), face_uvs)))


def drawn(radius: float, low: float) -> AuthoredMesh:
    """The tube in quads, of two materials."""
    vertices, quads, uvs, uv_quads = tube(radius, low)
    count = len(quads)
    material = (np.arange(count) >= AROUND).astype(np.int64)
    materials = (SurfaceMaterial("denim", DENIM), SurfaceMaterial("brass", BRASS))
    labels = Labels(("vest",), np.zeros(count, np.int64))
    uv_set = UvSet(uvs.astype(np.float32), uv_quads.ravel())
    none = Labels((), np.full(count, -1))
    polygons = Polygons(np.full(count, 4), quads.ravel(), (uv_set,), labels, none, materials, material)
    return AuthoredMesh.of(torch.from_numpy(vertices), polygons)


def with_prop(mesh: Mesh, weights: np.ndarray, joint: int) -> tuple[Mesh, np.ndarray]:
    """The mesh and a box above it that one joint moves."""
    box = trimesh.creation.box(extents=(0.1, 0.2, 0.3))
    faces, count = torch.tensor(box.faces.copy()), len(mesh.vertices)
    uvs = torch.tensor(box.vertices[:, [0, 2]] + 0.4, dtype=torch.float32)
    joined = Mesh(
        torch.cat(
            [mesh.vertices, torch.tensor(box.vertices, dtype=torch.float32) + torch.tensor([0.05, 0, 1.8])]
        ),
        torch.cat([mesh.faces, faces + count]),
        torch.cat([mesh.uvs, uvs]),
        torch.cat([mesh.face_uvs, faces + len(mesh.uvs)]),
    )
    rigid = np.zeros((len(box.vertices), weights.shape[1]), np.float32)
    rigid[:, joint] = 1
    return joined, np.concatenate([weights, rigid])


def blended(points: np.ndarray, weights: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """Linear blend skinning: (V, 3), (V, J), (F, J, 3, 4) -> (F, V, 3)."""
    matrices = np.einsum("vj,fjab->fvab", weights, transforms)
    return np.einsum("fvab,vb->fva", matrices[..., :3], points) + matrices[..., 3]


def largest(weights: np.ndarray, count: int = 4) -> np.ndarray:
    """The largest weights of each vertex (V, J), their sum one."""
    kept = np.where(weights >= np.sort(weights, axis=1)[:, [-count]], weights, 0)
    return kept / kept.sum(1, keepdims=True)


@dataclass(frozen=True)
class Scene:
    things: dict[str, Thing]
    body: Body
    transforms: np.ndarray

    def rig(self) -> Rig:
        """The garments skinned, with one blend shape."""
        shape = np.float32([0.02, -0.03, 0.05])
        garments = []
        for name in ("shirt", "vest"):
            mesh = self.things[name].mesh
            weights = largest(weights_of(mesh, len(self.body.skeleton.names)))
            joints = np.argsort(-weights, axis=1)[:, :4]
            shapes = torch.from_numpy(shape).expand(1, len(mesh.vertices), 3).clone()
            one = torch.ones(1)
            garments.append(
                RiggedGarment(name, mesh, joints, np.take_along_axis(weights, joints, 1), shapes, one, one)
            )
        levels = np.linspace(0, 1, FRAMES, dtype=np.float32)[:, None]
        return Rig(
            tuple(garments),
            self.body.skeleton,
            self.body,
            np.zeros(1, np.float32),
            self.transforms,
            levels,
            FPS,
        )

    def rigged(self) -> "Scene":
        """The same things, garments as the rig moves them."""
        things = dict(self.things)
        for garment in self.rig().garments:
            thing = things[garment.name]
            weights = np.zeros((len(garment.joints), len(self.body.skeleton.names)), np.float32)
            np.put_along_axis(weights, garment.joints, garment.weights, 1)
            frames = [
                blended(
                    thing.mesh.vertices.numpy() + level * garment.shapes[0].numpy(), weights, posed[None]
                )[0]
                for level, posed in zip(self.rig().weights[:, 0], self.transforms, strict=True)
            ]
            things[garment.name] = replace(thing, places=np.stack(frames), weights=weights)
        return replace(self, things=things)


def weights_of(mesh: Mesh, joints: int) -> np.ndarray:
    """Weights of six joints at each vertex, all different."""
    count = len(mesh.vertices)
    weights = np.zeros((count, joints), np.float32)
    rows = np.arange(count)[:, None]
    weights[rows, (rows + np.array([0, 3, 5, 8, 11, 13])) % joints] = [0.3, 0.25, 0.2, 0.15, 0.06, 0.04]
    return weights


@pytest.fixture(scope="module", params=["body", "character"])
def scene(request: pytest.FixtureRequest, body: Body) -> Scene:
    joints = len(body.skeleton.names)
    turns = Rotation.from_rotvec(np.linspace(-0.4, 0.5, FRAMES * joints * 3).reshape(-1, 3)).as_matrix()
    shifts = np.linspace(-0.1, 0.2, FRAMES * joints * 3).reshape(FRAMES, joints, 3, 1)
    transforms = np.concatenate([turns.reshape(FRAMES, joints, 3, 3), shifts], axis=-1).astype(np.float32)
    skinned, colors = plain(0.15, 0.9), [np.array(color) for color in (*GARMENT_COLORS[:1], BODY_COLOR)]
    weights = weights_of(skinned, joints)
    small = replace(
        body, mesh=skinned, weights=torch.from_numpy(weights), regions=torch.zeros(len(skinned.faces)).long(),
        sides=torch.zeros(len(skinned.faces)).long(), proxies={}, base=None,
    )  # fmt: skip
    if request.param == "character":
        skinned, weights = with_prop(plain(0.17, 0.8), weights, body.skeleton.names.index("Head"))
        small = replace(small, appearance=Appearance(skinned, torch.from_numpy(weights)))
    things = {}
    for name, mesh, color in (("shirt", plain(0.2, 1.0), colors[0]), ("vest", drawn(0.25, 0.9), None)):
        still = mesh.vertices.numpy()
        moves = Rotation.from_rotvec(np.outer(np.linspace(0, 1, FRAMES), [0.5, -0.3, 0.8])).as_matrix()
        places = np.einsum("fab,vb->fva", moves, still) + np.float32([0.1, 0.2, 0.3])
        owner = np.repeat(np.arange(len(mesh.faces) // 2) >= AROUND, 2)
        two = np.where(owner[:, None], BRASS[:3], DENIM[:3])
        things[name] = Thing(mesh, places.astype(np.float32), two if color is None else color + 0 * two)
    places = blended(skinned.vertices.numpy(), weights, transforms).astype(np.float32)
    things["body"] = Thing(skinned, places, np.tile(colors[1], (len(skinned.faces), 1)), weights)
    return Scene(things, small, transforms)


def written(scene: Scene, path: Path) -> Path:
    """The scene in the format of a suffix."""
    garments = [(name, thing.mesh) for name, thing in scene.things.items() if name != "body"]
    with open_writer(path, garments, scene.body, FPS) as writer:
        writer.add([torch.from_numpy(scene.things[name].places) for name, _ in garments],
                   torch.from_numpy(scene.transforms))  # fmt: skip
    return path


def fans(sizes: np.ndarray) -> np.ndarray:
    """Corners (T, 3) of the triangles that polygons of so many corners are cut into."""
    starts = np.cumsum(sizes) - sizes
    return np.array([
        (start, start + step, start + step + 1)
        for start, size in zip(starts.tolist(), sizes.tolist(), strict=True) for step in range(1, size - 1)
    ])  # fmt: skip


def read_glb(path: Path) -> Iterator[tuple[str, int | None, Seen]]:
    """By pygltflib, evaluated by the specification of glTF 2.0."""
    glb = GlbReader.load(path)
    names = {node.name: node for node in glb.gltf.nodes if node.mesh is not None}
    for name, node in names.items():
        primitives = glb.mesh(name).primitives
        corners = [glb.read(each.indices).astype(int).reshape(-1, 3) for each in primitives]
        factors = [
            glb.gltf.materials[each.material].pbrMetallicRoughness.baseColorFactor for each in primitives
        ]
        colors = np.concatenate([np.tile(f[:3], (len(c), 1)) for f, c in zip(factors, corners, strict=True)])
        faces, attributes = np.concatenate(corners), primitives[0].attributes
        uvs = glb.read(attributes.TEXCOORD_0) * [1, -1] + [0, 1]
        weights = None
        if node.skin is not None:
            joints, shares = glb.read(attributes.JOINTS_0).astype(int), glb.read(attributes.WEIGHTS_0)
            weights = np.zeros((len(joints), len(glb.gltf.skins[node.skin].joints)))
            np.add.at(weights, (np.arange(len(joints))[:, None], joints), shares)
        normals = to_z_up(glb.read(attributes.NORMAL))
        still = to_z_up(glb.read(attributes.POSITION))
        yield (
            name,
            None,
            Seen(
                still[faces], uvs[faces], normals[faces], colors, None if weights is None else weights[faces]
            ),
        )
        for frame in range(FRAMES):
            if node.skin is not None:
                yield name, frame, Seen(glb.posed(name, frame)[faces])
                continue
            levels = glb.weights(name, frame)
            normals = to_z_up(glb.morphed(name, levels, "NORMAL"))
            yield name, frame, Seen(to_z_up(glb.morphed(name, levels))[faces], normals=normals[faces])


def check(seen: Seen, thing: Thing, frame: int | None) -> None:
    """Compare triangles with those of an object; frame: None is rest."""
    faces = thing.mesh.faces.numpy()
    places = thing.mesh.vertices.numpy() if frame is None else thing.places[frame]
    expected = places[faces]
    _, order = cKDTree(expected.mean(1)).query(seen.places.mean(1))
    assert sorted(order) == list(range(len(faces)))
    # A triangle may begin at any of its corners, and never runs the other way around.
    begins = np.array([(np.roll(seen.places, -turn, 1)[:, 0] - expected[order, 0]) for turn in range(3)])
    begin = (np.linalg.norm(begins, axis=-1)).argmin(0)[:, None]
    corner = (np.arange(3) + begin) % 3

    def turned(values: np.ndarray) -> np.ndarray:
        return np.take_along_axis(values, corner[..., None], 1)

    np.testing.assert_allclose(turned(seen.places), expected[order], atol=2e-6, rtol=0)
    if seen.uvs is not None:
        uvs = thing.mesh.uvs.numpy()[thing.mesh.face_uvs.numpy()]
        np.testing.assert_allclose(turned(seen.uvs), uvs[order], atol=1e-6, rtol=0)
    if seen.normals is not None:
        a, b, c = expected.swapaxes(0, 1)
        normals = np.zeros_like(places)
        np.add.at(normals, faces, np.cross(b - a, c - a)[:, None])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        np.testing.assert_allclose(turned(seen.normals), normals[faces][order], atol=1e-4)
    if seen.colors is not None:
        np.testing.assert_allclose(seen.colors, thing.colors[order] ** 2.2, atol=0.005)
    if seen.weights is not None:
        assert thing.weights is not None
        np.testing.assert_allclose(turned(seen.weights), thing.weights[faces][order], atol=1e-6)


def read_usd(path: Path) -> Iterator[tuple[str, int | None, Seen]]:
    """By OpenUSD, whose own skinning poses what hangs on a skeleton."""
    stage = Usd.Stage.Open(str(path))
    baked = Usd.Stage.Open(stage.Flatten())
    for prim in list(baked.Traverse()):
        if prim.IsA(UsdSkel.Root):
            assert UsdSkel.BakeSkinning(UsdSkel.Root(prim))
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        name = "body" if "body" in str(prim.GetPath()) else prim.GetName()
        mesh, posed = UsdGeom.Mesh(prim), UsdGeom.Mesh(baked.GetPrimAtPath(prim.GetPath()))
        assert mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.rightHanded
        sizes = np.array(mesh.GetFaceVertexCountsAttr().Get())
        triangles, indices = fans(sizes), np.array(mesh.GetFaceVertexIndicesAttr().Get())
        faces = indices[triangles]
        uvs = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").ComputeFlattened())[triangles]
        skinned = prim.HasAPI(UsdSkel.BindingAPI)
        first = Usd.TimeCode.Default() if skinned else 0
        normals = np.array(mesh.GetNormalsAttr().Get(first))[faces]
        points = np.array(mesh.GetPointsAttr().Get(first))[faces]
        seen = Seen(points, uvs, normals, _usd_colors(mesh, sizes))
        weights = None
        if skinned:
            binding = UsdSkel.BindingAPI(prim)
            joints, shares = binding.GetJointIndicesPrimvar(), binding.GetJointWeightsPrimvar()
            rows = np.array(joints.Get()).reshape(-1, joints.GetElementSize())
            count = len(binding.GetInheritedSkeleton().GetJointsAttr().Get())
            weights = np.zeros((len(rows), count))
            np.add.at(
                weights, (np.arange(len(rows))[:, None], rows), np.array(shares.Get()).reshape(rows.shape)
            )
            weights = weights[faces]
        yield name, None if skinned else 0, replace(seen, weights=weights)
        for frame in range(FRAMES):
            normals = None if skinned else np.array(mesh.GetNormalsAttr().Get(frame))[faces]
            yield name, frame, Seen(np.array(posed.GetPointsAttr().Get(frame))[faces], normals=normals)


def _usd_colors(mesh: Any, sizes: np.ndarray) -> np.ndarray:
    """Linear colour of each triangle: of its material, else the one that is shown."""
    colors = np.tile(np.array(mesh.GetDisplayColorAttr().Get())[:1], (len(sizes), 1))
    for subset in UsdGeom.Subset.GetAllGeomSubsets(mesh):
        material = UsdShade.MaterialBindingAPI(subset.GetPrim()).ComputeBoundMaterial()[0]
        if material:
            surface = material.ComputeSurfaceSource()[0]
            colors[np.array(subset.GetIndicesAttr().Get())] = surface.GetInput("diffuseColor").Get()
    return np.repeat(colors, sizes - 2, axis=0)


def read_abc(path: Path) -> Iterator[tuple[str, int | None, Seen]]:
    """By Alembic, whose faces are clockwise seen from outside, Y up."""
    top = alembic3d.Abc.IArchive(str(path)).getTop()
    for index in range(top.getNumChildren()):
        name = top.getChildHeader(index).getName()
        schema = alembic3d.AbcGeom.IPolyMesh(top, name).getSchema()
        for frame in range(FRAMES):
            sample = schema.getValue(alembic3d.Abc.ISampleSelector(frame / FPS))
            triangles = fans(np.array(list(sample.getFaceCounts())))[:, [0, 2, 1]]
            points = to_z_up(np.asarray(sample.getPositions()))
            faces = np.array(list(sample.getFaceIndices()))[triangles]
            uvs = np.asarray(schema.getUVsParam().getExpandedValue().getVals())[triangles]
            yield name, frame, Seen(points[faces], uvs)


def read_obj(path: Path) -> Iterator[tuple[str, int | None, Seen]]:
    """By trimesh: a file for each frame."""
    for frame in range(FRAMES):
        for name, seen in objects_of(path.with_name(f"{path.stem}_{frame:05d}.obj")):
            yield name, frame, seen


def objects_of(path: Path) -> Iterator[tuple[str, Seen]]:
    """The objects of an OBJ, which trimesh cuts at materials into OBJECT_MATERIAL."""
    parts = trimesh.load_scene(path, split_objects=True, process=False).geometry
    for name in {name.partition("_")[0] for name in parts}:
        meshes = [mesh for each, mesh in parts.items() if each.partition("_")[0] == name]
        places, uvs = (np.concatenate(each) for each in zip(
            *((mesh.vertices[mesh.faces], mesh.visual.uv[mesh.faces]) for mesh in meshes), strict=True
        ))  # fmt: skip
        shown = [np.tile(mesh.visual.material.diffuse[:3] / 255, (len(mesh.faces), 1)) for mesh in meshes]
        yield name, Seen(places, uvs, colors=np.concatenate(shown) ** 2.2)


def read_pc2(path: Path) -> Iterator[tuple[str, int | None, Seen]]:
    """Points by numpy, the mesh at rest by trimesh, with the vertices of the file in their order."""
    for cache in path.parent.glob("*.pc2"):
        name = cache.stem.removeprefix(f"{path.stem}-")
        points = np.frombuffer(cache.read_bytes(), "<f4", offset=32).reshape(FRAMES, -1, 3)
        parts = [seen for _, seen in objects_of(cache.with_suffix(".obj"))]
        for seen in parts:
            yield name, None, replace(seen, colors=seen.colors if name == "vest" else None)
        rest = np.concatenate([seen.places for seen in parts])
        lines = cache.with_suffix(".obj").read_text().splitlines()
        order = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], np.float64)
        assert len(order) == points.shape[1]
        faces = cKDTree(order).query(rest)[1]
        for frame in range(FRAMES):
            yield name, frame, Seen(points[frame][faces])


READERS = {".glb": read_glb, ".usdc": read_usd, ".abc": read_abc, ".obj": read_obj, ".pc2": read_pc2}
INFLUENCES = {".glb": 4, ".usdc": 7}
"""Joints that move a vertex of the body, at most; all where a file has its places."""


@pytest.mark.parametrize("suffix", READERS)
def test_a_file_says_what_was_written(scene: Scene, suffix: str, tmp_path: Path) -> None:
    _require(scene, written(scene, tmp_path / f"walk{suffix}"))


@pytest.mark.parametrize("write", [write_rig_glb, write_rig_usd])
def test_a_rig_says_what_was_written(
    scene: Scene, write: Callable[[Rig, Path], None], tmp_path: Path
) -> None:
    path = tmp_path / f"rig.{write.__name__[-3:].replace('usd', 'usdc')}"
    shown = visible_body(scene.body)
    write(replace(scene.rig(), body=shown), path)
    _require(scene.rigged(), path)


def _require(scene: Scene, path: Path) -> None:
    things, body, seen = dict(scene.things), scene.things["body"], set()
    if influences := INFLUENCES.get(path.suffix):
        assert body.weights is not None
        weights = largest(body.weights, influences)
        places = blended(body.mesh.vertices.numpy(), weights, scene.transforms)
        things["body"] = replace(body, weights=weights, places=places)
    for name, frame, found in READERS[path.suffix](path):
        check(found, things[name], frame)
        seen.add((name, frame))
    assert seen >= {(name, frame) for name in scene.things for frame in range(FRAMES)}
