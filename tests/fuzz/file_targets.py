"""Readers of motions, meshes, clothes and characters."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from tests.fuzz.array_targets import check_clip, check_weights
from tests.fuzz.glb_mutators import GLB
from tests.fuzz.target import Target, require, require_indices, require_numbers
from tests.garments.test_mhclo import HEAD, ROWS, written
from tests.motion.bvh_text import bvh_text, performer, still
from tests.player.baked_box import write_baked_box
from tests.small_body import small_body
from tests.small_gltf import PIXEL, document, sparse_document, write_glb, write_gltf
from uvcloth.bodies.body import load_body
from uvcloth.characters.reader import Character, read_character
from uvcloth.errors import InputError
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.garments.mhclo import Binding, fit_clothes
from uvcloth.geometry.authored import AuthoredMesh, Labels
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.bvh import read_bvh
from uvcloth.motion.clip import Clip
from uvcloth.motion.gltf import read_gltf_motion
from uvcloth.motion.library import load_clip
from uvcloth.player.baked import JointMotion, open_baked


def good_bvh(folder: Path) -> Path:
    joints = performer()
    values = still(joints, 4) + np.random.default_rng(0).uniform(-0.9, 0.9, (4, 1))
    (folder / "walk.bvh").write_text(bvh_text(joints, values))
    return folder / "walk.bvh"


def on_our_body(path: Path) -> Clip:
    return load_clip(path, load_body())


def check_on_body(clip: Clip) -> None:
    require(len(clip) > 0, "no frames")
    require_numbers(clip.rotations, (len(clip), len(clip.skeleton.names), 3, 3), "rotations")
    require_numbers(clip.translation.double(), (len(clip), 3), "translation", torch.float64)
    require(len(clip) <= 60, f"four frames became {len(clip)}")


def good_glb(folder: Path) -> Path:
    return write_glb(folder / "box.glb", *document())


def good_gltf(folder: Path) -> Path:
    return write_gltf(folder / "box.gltf", *document())


def skinless_glb(folder: Path) -> Path:
    """An animation alone, which turns nodes."""
    written, binary = document()
    written.pop("skins")
    for node in written["nodes"]:
        node.pop("skin", None)
    return write_glb(folder / "box.glb", written, binary)


def sparse_glb(folder: Path) -> Path:
    return write_glb(folder / "box.glb", *sparse_document(zeros=False))


def sparse_gltf(folder: Path) -> Path:
    return write_gltf(folder / "box.gltf", *sparse_document(zeros=True))


def good_obj(folder: Path) -> Path:
    (folder / "box.mtl").write_text(
        "newmtl wool\nKd 0.8 0.2 0.2\nd 0.9\nmap_Kd -s 1 1 1 wool.png\nnewmtl b\nTr 0\n"
    )
    (folder / "box.obj").write_text(
        "mtllib box.mtl\no box\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0 1 1 1\nvt 0 0\nvt 1 0\n"
        "vt 1 1\nvn 0 0 1\ng front\nusemtl wool\nf 1/1/1 2/2/1 3/3/1\nusemtl b\nf -4/1 3/2 4/3 2/1\n"
    )
    return folder / "box.obj"


def saved(name: str, kind: str, share: float, **options: str) -> Target:
    """A reader of the box as another program writes it, in a kind that it names."""

    def make(folder: Path) -> Path:
        import trimesh

        mesh = small_body().mesh
        box = trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy(), process=False)
        content = box.export(file_type=kind, **options)
        path = folder / f"box.{kind[:3]}"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return Target(name, make, read_mesh, check_garment, share=share)


def check_garment(mesh: Mesh) -> None:
    count = len(mesh.vertices)
    require(count > 0 and len(mesh.faces) > 0, "an empty mesh")
    require_numbers(mesh.vertices, (count, 3), "vertices", mesh.vertices.dtype)
    require(torch.isfinite(mesh.vertices.float().square()).all(), "vertices beyond single precision")
    require_indices(mesh.faces, (-1, 3), count, "faces")
    require_numbers(mesh.uvs, (-1, 2), "uvs")
    require_indices(mesh.face_uvs, (-1, 3), len(mesh.uvs), "face_uvs")
    require(len(mesh.face_uvs) in (0, len(mesh.faces)), "face_uvs of other faces")
    if isinstance(mesh, AuthoredMesh):
        check_polygons(mesh)


def check_polygons(mesh: AuthoredMesh) -> None:
    polygons, sizes = mesh.polygons, mesh.polygons.sizes
    require(bool((sizes >= 3).all()) and sizes.sum() == len(polygons.corners), "corners of other polygons")
    require(polygons.triangles()[0].shape == tuple(mesh.faces.shape), "triangles of other polygons")
    require_indices(torch.from_numpy(polygons.corners), (-1,), len(mesh.vertices), "corners")
    for each in polygons.uv_sets:
        require_indices(torch.from_numpy(each.corners), (len(polygons.corners),), len(each.uvs), "uv corners")
        require_numbers(torch.from_numpy(each.uvs), (-1, 2), "a set of uvs")
    named: list[Labels] = [polygons.objects, polygons.groups]
    named.append(Labels(tuple(each.name for each in polygons.materials), polygons.material))
    for labels in named:
        require_indices(torch.from_numpy(labels.of + 1), (len(sizes),), len(labels.names) + 1, "labels")
    for material in polygons.materials:
        require(all(0 <= channel <= 1 for channel in material.color), f"the colour {material.color}")
        in_sets = material.texture is None or material.uv_set < max(len(polygons.uv_sets), 1)
        require(in_sets, "a texture on texture coordinates that there are not")
    if polygons.colors is not None:
        require_numbers(torch.from_numpy(polygons.colors), (len(mesh.vertices), 4), "colours")


def good_clothes(folder: Path) -> Path:
    (folder / "weave.png").write_bytes(PIXEL)
    (folder / "box.mhmat").write_text("name Box\ndiffuseColor 0.2 0.3 0.4\ndiffuseTexture weave.png\n")
    return written(folder, ROWS, HEAD.replace("verts", "material box.mhmat\nverts"))


def clothes_on_box(path: Path) -> tuple[Mesh, Binding]:
    box = small_body()
    return fit_clothes(path, replace(box, base=box.mesh.vertices))


def check_clothes(found: tuple[Mesh, Binding]) -> None:
    mesh, binding = found
    check_garment(mesh)
    require_indices(binding.corners, (len(mesh.vertices), 3), 8, "corners")
    require(binding.deleted.ndim == 1, "deleted vertices")


def check_character(character: Character) -> None:
    joints = len(character.joints)
    require(joints > 0 and len(set(character.joints)) == joints, "joint names missing or doubled")
    require(all(-1 <= parent < j for j, parent in enumerate(character.parents)), "a parent after its joint")
    require_numbers(character.heads, (joints, 3), "heads")
    require(len(character.parts) > 0, "no parts")
    for part in character.parts:
        require_numbers(part.mesh.vertices, (-1, 3), "vertices")
        require(torch.isfinite(part.mesh.vertices.square()).all(), "vertices beyond single precision")
        require_indices(part.mesh.faces, (-1, 3), len(part.mesh.vertices), "faces")
        check_weights(part.weights, len(part.mesh.vertices), joints, "weights")
        require_numbers(part.mesh.uvs, (-1, 2), "uvs")


def good_baked(folder: Path) -> Path:
    return write_baked_box(folder / "box.glb")


def baked_motion(path: Path) -> JointMotion:
    """Joints of a baked file's animation; the player, which has no InputError, says ValueError."""
    try:
        return open_baked(path).motion()
    except ValueError as error:
        raise InputError(str(error)) from error


def check_motion(motion: JointMotion) -> None:
    frames, joints = motion.transforms.shape[:2]
    require(frames == len(motion.times) > 1 and joints > 0, "no frames or no joints")
    require_numbers(torch.from_numpy(motion.transforms), (frames, joints, 3, 4), "transforms", torch.float64)


TARGETS = [
    Target("baked", good_baked, baked_motion, check_motion, GLB),
    Target("bvh", good_bvh, read_bvh, check_clip),
    Target("bvh_on_body", good_bvh, on_our_body, check_on_body, share=0.25),
    Target("glb_motion", good_glb, read_gltf_motion, check_clip, GLB, share=0.5),
    Target("gltf_motion", good_gltf, read_gltf_motion, check_clip, share=0.5),
    Target("skinless_motion", skinless_glb, read_gltf_motion, check_clip, GLB, share=0.5),
    Target("glb_character", good_glb, read_character, check_character, GLB, share=0.5),
    Target("gltf_character", good_gltf, read_character, check_character, share=0.5),
    Target("glb_mesh", good_glb, read_mesh, check_garment, GLB, share=0.5),
    Target("gltf_mesh", good_gltf, read_mesh, check_garment, share=0.5),
    Target("sparse_motion", sparse_glb, read_gltf_motion, check_clip, GLB, share=0.25),
    Target("sparse_character", sparse_gltf, read_character, check_character, share=0.25),
    Target("sparse_mesh", sparse_gltf, read_mesh, check_garment, share=0.25),
    Target("obj", good_obj, read_mesh, check_garment),
    saved("ply", "ply", 0.5),
    saved("ply_text", "ply", 0.5, encoding="ascii"),
    saved("stl", "stl", 0.5),
    saved("stl_text", "stl_ascii", 0.5),
    saved("off", "off", 1.0),
    Target("mhclo", good_clothes, clothes_on_box, check_clothes),
]
