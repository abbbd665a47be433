"""Motions from elsewhere for baked files: retargeted by the laboratory."""

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.regions import face_regions
from uvcloth.characters.reader import read_character
from uvcloth.errors import InputError
from uvcloth.formats.gltf import read_gltf
from uvcloth.formats.gltf_rig import largest_skin, read_rig
from uvcloth.geometry.mesh import Mesh, join_meshes
from uvcloth.geometry.skeleton import Skeleton, in_order
from uvcloth.geometry.skinning import skin
from uvcloth.motion.lead_in import pose_from_rest
from uvcloth.motion.library import load_clip
from uvcloth.motion.options import MotionOptions
from uvcloth.player.baked import BakedFile, JointMotion
from uvcloth.player.nodes import chain


def retargeted(baked: BakedFile, motion: str, options: MotionOptions) -> JointMotion:
    """A motion file or a built-in clip on the joints of a baked file.

    A motion of one frame, a pose, becomes the way into it from rest. Raises InputError as `load_clip` does.
    """
    body = body_of_baked(baked)
    clip = pose_from_rest(load_clip(motion, body, options), body)
    times = np.arange(len(clip)) / clip.fps
    return JointMotion(clip.name, times, clip.transforms(torch.float64).numpy(), clip.fps)


def body_of_baked(baked: BakedFile) -> Body:
    """The character of a baked file as a body for motions: in its rest pose, on the runtime's joints.

    Its surface is that of all meshes of the character, without proxies; nothing can be fitted to it.
    """
    path, axes = baked.file.path, baked.skin.axes
    cloth = {garment.name for garment in baked.garments}
    character, file = read_character(path), read_gltf(path)
    rig = read_rig(file, largest_skin(file))
    place = {node: index for index, node in enumerate(baked.skin.nodes)}
    above = [
        next((place[each] for each in (node, *chain(node, file.above)) if each in place), 0)
        for node in rig.nodes
    ]
    parts = [part for part in character.parts if part.name not in cloth]
    mesh = join_meshes((part.mesh.vertices, part.mesh.faces) for part in parts)
    weights = torch.zeros(len(mesh.vertices), len(place)).index_add(
        1, torch.tensor(above), torch.cat([part.weights for part in parts])
    )
    bind = np.stack([rig.bind[rig.nodes.index(node)] for node in baked.skin.nodes])
    to_rest = axes @ np.linalg.inv(bind @ baked.skin.inverse_bind)
    vertices = skin(mesh.vertices, weights, torch.from_numpy(to_rest[None, :, :3]).float())[0]
    faces = mesh.faces
    parents = _parents(baked, place)
    if not in_order(parents):
        raise InputError(f"{path}: a joint of its cloth comes before its parent")
    skeleton = Skeleton(baked.skin.names, parents, _heads(baked))
    regions, sides = face_regions(skeleton, weights, faces)
    return Body(
        name=path.stem,
        mesh=Mesh(vertices, faces, torch.zeros(0, 2), torch.zeros_like(faces)),
        skeleton=skeleton,
        weights=weights,
        regions=regions,
        sides=sides,
        proxies={},
    )


def _parents(baked: BakedFile, place: dict[int, int]) -> tuple[int, ...]:
    """Parent of each joint: its nearest ancestor in the file that is one."""
    ancestors = (chain(node, baked.file.above) for node in baked.skin.nodes)
    return tuple(next((place[each] for each in way if each in place), -1) for way in ancestors)


def _heads(baked: BakedFile) -> Tensor:
    """Joints (J, 3) m at rest."""
    heads = (baked.skin.axes @ np.linalg.inv(baked.skin.inverse_bind))[:, :3, 3]
    return torch.from_numpy(heads).float()
