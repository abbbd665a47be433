"""VRM files: which node of the skeleton is which bone of a person, and which nodes are spring bones.

VRM 0.x keeps the human bones in a list in the extension VRM, VRM 1.0 in an object in VRMC_vrm, animations of
VRM (.vrma) in VRMC_vrm_animation, all under humanoid.humanBones. Spring bones are chains below the roots in
VRM's secondaryAnimation.boneGroups, or the joints in VRMC_springBone's springs.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from uvcloth.errors import InputError
from uvcloth.formats.gltf import Gltf


def human_bones(file: Gltf) -> dict[int, str]:
    """Human bone ("leftUpperLeg") of each node in the table of a VRM file, none in another glTF file.

    Raises InputError naming the file and the bone if the table is damaged or gives a node two bones.
    """
    bones: dict[int, str] = {}
    for bone, node in _table(file):
        if node == -1:  # VRM 0.x has entries for bones that the model lacks.
            continue
        if not isinstance(node, int) or isinstance(node, bool) or not 0 <= node < len(file.entries("nodes")):
            raise _damaged(file, f"{bone:.40} is node {node!s:.40}, which does not exist")
        if node in bones:
            raise _damaged(file, f"node {node} is both {bones[node]:.40} and {bone:.40}")
        bones[node] = bone
    return bones


def spring_nodes(file: Gltf) -> set[int]:
    """Nodes of a VRM file that spring bones move, but those on its head: hair and ears are no cloth.

    A damaged list of spring bones counts as none.
    """
    bones = human_bones(file)
    springs = set(_spring_bones(file.document.get("extensions", {})))
    swinging = set()
    for node in range(len(file.entries("nodes"))):
        above = (node, *_chain(node, file.above))
        if springs.intersection(above) and "head" not in {bones.get(each) for each in above}:
            swinging.add(node)
    return swinging


def _spring_bones(extensions: Any) -> Iterator[int]:
    """Nodes that the lists of spring bones name."""
    for path in (("VRM", "secondaryAnimation", "boneGroups"), ("VRMC_springBone", "springs")):
        groups: Any = extensions
        for key in path:
            groups = groups.get(key) if isinstance(groups, dict) else None
        for group in groups if isinstance(groups, list) else ():
            for key in ("bones", "joints"):
                named = group.get(key) if isinstance(group, dict) else None
                for bone in named if isinstance(named, list) else ():
                    node = bone.get("node") if isinstance(bone, dict) else bone
                    if isinstance(node, int):
                        yield node


def _chain(node: int, above: Mapping[int, int]) -> Iterator[int]:
    """Ancestors of a node, the nearest first."""
    while node in above:
        node = above[node]
        yield node


def _table(file: Gltf) -> Iterator[tuple[str, Any]]:
    """Bones of the table, and what it says is the node of each."""
    extensions = file.document.get("extensions", {})
    for name in ("VRMC_vrm", "VRMC_vrm_animation", "VRM"):
        table: Any = extensions
        for key in (name, "humanoid", "humanBones"):
            table = table.get(key) if isinstance(table, dict) else None
        match table:
            case dict():
                yield from ((bone, _entry(file, entry).get("node")) for bone, entry in table.items())
            case list():
                for entry in table:
                    yield str(_entry(file, entry).get("bone")), entry.get("node")
            case None:
                continue
            case _:
                raise _damaged(file, "it is neither a list nor an object")
        return


def _entry(file: Gltf, entry: Any) -> dict[str, Any]:
    if not isinstance(entry, dict):
        raise _damaged(file, f"{entry!s:.40} is no bone")
    return entry


def _damaged(file: Gltf, fault: str) -> InputError:
    return InputError(f"{file.path}: its table of human bones (humanBones) is damaged, {fault}")
