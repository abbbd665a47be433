"""Rigged characters in glTF 2.0 and FBX files: meshes bound to a skeleton, in its bind pose."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.formats.gltf import SCENES, Gltf, read_gltf, require_few
from uvcloth.formats.gltf_rig import SkinJoints, inverse_bind, largest_skin, read_rig, resting_worlds
from uvcloth.formats.vrm import spring_nodes
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.roles import table_roles
from uvcloth.player.gltf_document import LARGEST
from uvcloth.player.gltf_file import one_line
from uvcloth.player.nodes import chain

TRIANGLES = 4
"""Mode of a primitive that is made of separate triangles."""

MOST_WEIGHTS = 100_000_000
"""Most vertices times joints of a character: its blend weights are dense."""


@dataclass(frozen=True)
class Part:
    """All faces of one material in one mesh of a character.

    name: of the mesh. material: its name, "" without one. mesh: V vertices in the bind pose, in the file's
    scene. weights: (V, J) blend weights, rows sum to one. spring_share: that of spring bones off
    the head: of a skirt or a coat.
    """

    name: str
    material: str
    mesh: Mesh
    weights: Tensor
    spring_share: float = 0.0


@dataclass(frozen=True)
class Character:
    """A rigged character in its bind pose, in the axes and the unit of its file's scene.

    joints: J names. parents: J indices, -1 for a root. heads: (J, 3). table: joint of each role, where the
    file has a table of them.
    """

    name: str
    joints: tuple[str, ...]
    parents: tuple[int, ...]
    heads: Tensor
    parts: tuple[Part, ...]
    table: Mapping[str, int] = field(default_factory=dict)


def read_character(path: Path) -> Character:
    """Read a rigged character: the skeleton of its largest skin, and all meshes that this skeleton moves.

    Meshes of other skins on the same joints are included, and meshes without a skin on a node below a joint,
    such as eyes or the limbs of a robot. Morph targets stay at zero. Raises InputError naming the file if it
    is of another kind, has no skin, no mesh bound to it, too many vertices, or damaged or unsupported
    content.
    """
    if Path(path).suffix.lower() not in SCENES:
        raise InputError(
            f"{path}: expected a character as {', '.join(SCENES)}; see docs/characters.md to convert others"
        )
    file = read_gltf(path)
    rig = read_rig(file, largest_skin(file))
    springs = spring_nodes(file)
    parts: list[Part] = []
    vertices = 0
    for index, node in enumerate(file.entries("nodes")):
        for part in _parts(file, rig, index, springs) if "mesh" in node else ():
            parts.append(part)
            require_few(file.path, len(parts))
            vertices += len(part.mesh.vertices)
            _require_room(file, vertices, len(rig.names))
    if not parts:
        raise InputError(f"{file.path}: no mesh is bound to its skeleton")
    heads = torch.from_numpy(rig.bind[:, :3, 3].astype(np.float32))
    return Character(file.path.stem, rig.names, rig.parents, heads, tuple(parts), table_roles(rig.bones))


def _require_room(file: Gltf, vertices: int, joints: int) -> None:
    if vertices * joints > MOST_WEIGHTS:
        most = MOST_WEIGHTS // joints
        raise InputError(f"{file.path}: has more than {most:,} vertices, the limit for {joints} joints")


def _parts(file: Gltf, rig: SkinJoints, index: int, springs: set[int]) -> Iterable[Part]:
    """Parts of a node's mesh, one after the other; none if the skeleton does not move it.

    springs: nodes that spring bones move.
    """
    node = file.entries("nodes")[index]
    mesh = file.entries("meshes")[node["mesh"]]
    name = one_line(node.get("name") or mesh.get("name") or f"mesh {node['mesh']}")
    number = {joint: place for place, joint in enumerate(rig.nodes)}
    is_spring = [False]
    if "skin" in node:
        skin = file.entries("skins")[node["skin"]]
        places = [number.get(joint, -1) for joint in skin["joints"]]
        if max(places) < 0:
            return []
        to_bind = _to_bind(file, rig, skin, places)
        is_spring = [joint in springs for joint in skin["joints"]]
        # Weights of joints that the largest skin lacks go to their nearest ancestor in it.
        owners = [
            place
            if place >= 0
            else next((number[each] for each in chain(joint, file.above) if each in number), 0)
            for place, joint in zip(places, skin["joints"], strict=True)
        ]
    else:
        holder = next((each for each in (index, *chain(index, file.above)) if each in number), None)
        if holder is None:
            return []
        rest = resting_worlds(file, (index, holder))
        to_bind = rig.bind[number[holder]] @ np.linalg.inv(rest[holder]) @ rest[index]
        owners = [number[holder]]
    return (
        _part(file, name, primitive, to_bind, owners, is_spring, len(rig.names))
        for primitive in mesh["primitives"]
        if primitive.get("mode", TRIANGLES) == TRIANGLES
    )


def _to_bind(file: Gltf, rig: SkinJoints, skin: dict[str, Any], places: list[int]) -> np.ndarray:
    """Transform (4, 4) of the vertices of a skin to the bind pose of the rig, from a joint that both have."""
    if "inverseBindMatrices" not in skin:
        return np.eye(4)
    shared = next(index for index, place in enumerate(places) if place >= 0)
    return np.asarray(rig.bind[places[shared]] @ inverse_bind(file, skin)[shared])


def _part(
    file: Gltf,
    name: str,
    primitive: dict[str, Any],
    to_bind: np.ndarray,
    owners: list[int],
    is_spring: list[bool],
    joints: int,
) -> Part:
    """Part from one primitive, with only the vertices that its faces use.

    owners: joint of each joint of the skin. is_spring: True for those that spring bones move.
    """
    attributes = primitive["attributes"]
    place = f"{file.path}: mesh {name}"
    if "POSITION" not in attributes:
        raise InputError(f"{place} has no positions")
    points = file.array(attributes["POSITION"], "VEC3").astype(np.float64)
    corners = (
        file.array(primitive["indices"], "SCALAR")[:, 0] if "indices" in primitive else np.arange(len(points))
    ).astype(np.int64)
    if len(corners) % 3 or (len(corners) and not 0 <= corners.min() <= corners.max() < len(points)):
        raise InputError(f"{file.path}: the faces of mesh {name} do not fit its vertices")
    used, faces = np.unique(corners, return_inverse=True)
    faces = faces.reshape(-1, 3)
    placed = points[used] @ to_bind[:3, :3].T + to_bind[:3, 3]
    if placed.size and not np.abs(placed).max() <= LARGEST:
        raise InputError(f"{place} has a vertex beyond {LARGEST:g}")
    if np.linalg.det(to_bind[:3, :3]) < 0:
        faces = faces[:, ::-1].copy()
    uvs: np.ndarray = np.zeros((0, 2), np.float32)
    face_uvs = np.zeros((len(faces), 3), np.int64)
    if "TEXCOORD_0" in attributes:
        # glTF measures the second coordinate from the top of the picture.
        uvs = _of_vertices(file, name, attributes["TEXCOORD_0"], len(points), "VEC2")[used].astype(
            np.float32
        ) * [1, -1] + [0, 1]
        face_uvs = faces
    _require_room(file, len(used), joints)
    weights, swings = np.zeros((len(used), joints), np.float32), np.zeros(len(used), np.float32)
    if "JOINTS_0" in attributes:
        for joints_of, values in _influences(file, name, attributes, len(points), len(owners)):
            rows = np.broadcast_to(np.arange(len(used))[:, None], (len(used), 4))
            np.add.at(weights, (rows, np.array(owners)[joints_of[used]]), values[used])
            swings += (values[used] * np.array(is_spring)[joints_of[used]]).sum(1)
    else:
        weights[:, owners[0]] = 1.0
    total = weights.sum(1)
    if not np.isfinite(total).all():
        raise InputError(f"{place} has blend weights whose sum is not a finite number")
    weights[total <= 0, owners[0]] = 1.0
    material = primitive.get("material")
    return Part(
        name=name,
        material="" if material is None else one_line(file.entries("materials")[material].get("name", "")),
        mesh=Mesh(
            torch.from_numpy(placed.astype(np.float32)),
            torch.from_numpy(faces),
            torch.from_numpy(uvs.astype(np.float32)),
            torch.from_numpy(face_uvs),
        ),
        weights=torch.from_numpy(weights / weights.sum(1, keepdims=True)),
        spring_share=float(swings.sum() / weights.sum()) if len(used) else 0.0,
    )


def _influences(
    file: Gltf, name: str, attributes: dict[str, int], count: int, joints: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Joints (count, 4) of the skin and weights (count, 4), for every set of a primitive."""
    number = 0
    while (key := f"JOINTS_{number}") in attributes:
        weights_key = f"WEIGHTS_{number}"
        if weights_key not in attributes:
            raise InputError(f"{file.path}: mesh {name} has {key} without {weights_key}")
        owners = _of_vertices(file, name, attributes[key], count, "VEC4").astype(np.int64)
        values = _of_vertices(file, name, attributes[weights_key], count, "VEC4").astype(np.float32)
        if owners.size and not 0 <= owners.min() <= owners.max() < joints:
            raise InputError(f"{file.path}: mesh {name} has a weight for a joint that its skin does not have")
        if values.size and values.min() < 0:
            raise InputError(f"{file.path}: mesh {name} has a negative blend weight")
        yield owners, values
        number += 1


def _of_vertices(file: Gltf, name: str, accessor: int, count: int, kind: str) -> np.ndarray:
    """Values of a vertex attribute. Raises InputError if there are not `count` of them."""
    values = file.array(accessor, kind)
    if len(values) != count:
        raise InputError(
            f"{file.path}: mesh {name} has {count} vertices, accessor {accessor} has {len(values)} elements"
        )
    return values
