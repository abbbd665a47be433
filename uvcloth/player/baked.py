"""Baked files: a glTF binary with skinned garments, and beside them what the runtime reads.

docs/runtime_file.md is the schema of the extension that joins the two.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.player.animation import (
    animations_of,
    choose_animation,
    frame_times,
    moving_nodes,
    sampled_worlds,
)
from uvcloth.player.gltf_document import COUNT, LARGEST, Index, Needed, Numbers, check_part
from uvcloth.player.gltf_file import GltfFile, one_line, read_glb

EXTENSION, VERSION = "UVCLOTH_cloth", 1

FABRIC = ("density", "stretch", "bend")
"""Numbers of a garment's fabric: kg/m2, N/m and N m."""

SCHEMA = {
    "bufferView": Needed(Index("bufferViews")),
    "skin": Needed(Index("skins")),
    "axes": Needed(Numbers(16)),
    "joints": Needed([str]),
    "garments": Needed(
        [
            {
                "node": Needed(Index("nodes")),
                "vertices": Needed(Index("accessors")),
                "fabric": Numbers(len(FABRIC)),
            }
        ]
    ),
}
"""Entries of the extension, besides its version."""

SKEWED = 1e-4
"""Largest difference of axes, made unit, from a rotation."""

FLAT = 1e-12
"""Determinant below which a joint's transform at rest has no inverse."""


@dataclass(frozen=True)
class ClothSkin:
    """Skin of the garments, on the J joints that the runtime follows, in its order.

    skin: index in the file. nodes: of the joints. names: of the joints as the laboratory knows them. axes:
    (4, 4) turn and scale from the scene to the runtime's world. inverse_bind: (J, 4, 4) from the garments at
    rest, in the axes of the scene, to the joints'.
    """

    skin: int
    nodes: tuple[int, ...]
    names: tuple[str, ...]
    axes: np.ndarray
    inverse_bind: np.ndarray

    def transforms(self, worlds: np.ndarray) -> np.ndarray:
        """Transforms (F, J, 3, 4) from rest in the runtime's world, given those of the nodes (F, J, 4, 4)."""
        with np.errstate(all="ignore"):  # Numbers that are none are refused by whoever asked.
            return (self.axes @ worlds @ self.inverse_bind @ np.linalg.inv(self.axes))[..., :3, :]

    def worlds(self, transforms: np.ndarray) -> np.ndarray:
        """Transforms (F, J, 4, 4) of the nodes to the scene, given those from rest (F, J, 3, 4)."""
        whole = np.zeros((*transforms.shape[:-2], 4, 4))
        whole[..., :3, :] = transforms
        whole[..., 3, 3] = 1.0
        return np.linalg.inv(self.axes) @ whole @ self.axes @ np.linalg.inv(self.inverse_bind)


@dataclass(frozen=True)
class BakedGarment:
    """A garment of a baked file.

    name, node: of its mesh. vertices: (M,) the runtime's vertex of each vertex of the mesh; those on seams
    occur in it more than once. fabric: the numbers of FABRIC that it was baked with, where the file has them.
    """

    name: str
    node: int
    vertices: np.ndarray
    fabric: tuple[float, ...] = ()

    @property
    def size(self) -> int:
        """Number of vertices that the runtime has of it."""
        return int(self.vertices.max()) + 1


@dataclass(frozen=True)
class JointMotion:
    """Motion of the joints that the runtime follows.

    name: for messages. times: (F,) s. transforms: (F, J, 3, 4) from rest to posed, m, in the runtime's axes.
    fps: frames per second. animation: of the file, None for a motion from elsewhere.
    """

    name: str
    times: np.ndarray
    transforms: np.ndarray
    fps: float
    animation: dict[str, Any] | None = None


@dataclass(frozen=True)
class BakedFile:
    """A baked file, ready to be played.

    content: bytes for the runtime, which checks them; view: where they are.
    """

    file: GltfFile
    content: bytes
    view: int
    skin: ClothSkin
    garments: tuple[BakedGarment, ...]

    def require_fit(self, joints: int, vertices: Sequence[int]) -> None:
        """Raise ValueError unless the runtime's outfit has the joints and the garments of the file.

        joints: of the outfit. vertices: of each of its garments.
        """
        if joints != len(self.skin.nodes):
            raise self.file.error(f"its cloth has {joints} joints, its skin {len(self.skin.nodes)}")
        if list(vertices) != [garment.size for garment in self.garments]:
            raise self.file.error("the garments of its cloth are not those of its meshes")

    def motion(self, wanted: str | None = None, fps: float | None = None) -> JointMotion:
        """Sample an animation of the file.

        wanted: its name, or its number from 1; None for the first. fps: frames per second, None for the rate
        of its keys. Raises ValueError naming the file for an animation that is not there, lasts no time, or
        is damaged.
        """
        moving = moving_nodes(self.file, self.skin.nodes)
        animation = choose_animation(self.file, animations_of(self.file, moving), wanted)
        times, rate = frame_times(self.file, animation, len(moving), fps)
        if len(times) < 2:
            raise self.file.error("the animation lasts no time, expected two frames or more")
        transforms = self.skin.transforms(sampled_worlds(self.file, animation, self.skin.nodes, times))
        bad = np.argwhere(~(np.abs(transforms).max(axis=(2, 3)) <= LARGEST))
        if len(bad):
            frame, joint = bad[0]
            raise self.file.error(
                f"joint {self.skin.names[joint]} is beyond {LARGEST:g} or no number at frame {frame}"
            )
        return JointMotion(self.file.path.stem, times, transforms, rate, animation)

    def in_scene(self, vertices: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the scene, given those of the runtime's world, m."""
        return np.asarray(vertices @ np.linalg.inv(self.skin.axes)[:3, :3].T)


def open_baked(path: Path) -> BakedFile:
    """Open a baked file. Raises ValueError naming it, and the place, for one that is not whole or none."""
    file = read_glb(path)
    extension = _extension(file)
    garments = tuple(_garment(file, entry) for entry in extension["garments"])
    if not garments:
        raise file.error(f"{EXTENSION}.garments are none")
    view = extension["bufferView"]
    return BakedFile(file, bytes(file.view(view)), view, _skin(file, extension), garments)


def _skin(file: GltfFile, extension: dict[str, Any]) -> ClothSkin:
    skin, names = file.entries("skins")[extension["skin"]], tuple(map(one_line, extension["joints"]))
    if len(names) != len(skin["joints"]):
        raise file.error(f"{EXTENSION}.joints are {len(names)}, its skin has {len(skin['joints'])}")
    inverse_bind = _inverse_bind(file, skin)
    return ClothSkin(extension["skin"], tuple(skin["joints"]), names, _axes(file, extension), inverse_bind)


def _extension(file: GltfFile) -> dict[str, Any]:
    extensions = file.document.get("extensions")
    extension = extensions.get(EXTENSION) if isinstance(extensions, dict) else None
    if not isinstance(extension, dict):
        raise file.error(f"has no cloth to play (no extension {EXTENSION}); `uvcloth bake` writes such files")
    try:
        check_part(extension, {"version": Needed(COUNT)}, EXTENSION, file.document)
        if extension["version"] != VERSION:
            raise ValueError(
                f"{EXTENSION} is of version {extension['version']}, this program reads version {VERSION}"
            )
        check_part(extension, SCHEMA, EXTENSION, file.document)
    except ValueError as error:
        raise file.error(str(error)) from error
    return extension


def _axes(file: GltfFile, extension: dict[str, Any]) -> np.ndarray:
    axes = np.array(extension["axes"], np.float64).reshape(4, 4).T
    linear = axes[:3, :3]
    size = np.cbrt(np.linalg.det(linear))
    turn = linear / size if size > 0 else np.zeros((3, 3))
    whole = np.eye(4)
    whole[:3, :3] = linear
    if not np.abs(turn @ turn.T - np.eye(3)).max() < SKEWED or (axes != whole).any():
        raise file.error(f"{EXTENSION}.axes are not a rotation and a scale")
    return axes


def _inverse_bind(file: GltfFile, skin: dict[str, Any]) -> np.ndarray:
    if "inverseBindMatrices" not in skin:
        raise file.error("the skin of its garments has no inverse bind matrices")
    values = file.array(skin["inverseBindMatrices"], "MAT4").astype(np.float64)
    if len(values) < len(skin["joints"]):
        raise file.error(f"a skin has {len(values)} inverse bind matrices for {len(skin['joints'])} joints")
    inverse = values[: len(skin["joints"])].reshape(-1, 4, 4).swapaxes(1, 2)
    whole = np.abs(inverse).max(axis=(1, 2)) <= LARGEST
    whole &= (inverse[:, 3] == [0.0, 0.0, 0.0, 1.0]).all(axis=1)
    whole[whole] &= np.abs(np.linalg.det(inverse[whole])) > FLAT
    if not whole.all():
        raise file.error(f"inverse bind matrix {int(whole.argmin())} of its garments has no inverse")
    return inverse


def _garment(file: GltfFile, entry: dict[str, Any]) -> BakedGarment:
    node = file.entries("nodes")[entry["node"]]
    name = one_line(node.get("name", f"node {entry['node']}"))
    if "mesh" not in node:
        raise file.error(f"{name}, a garment of its cloth, has no mesh")
    vertices = file.array(entry["vertices"], "SCALAR")[:, 0]
    if vertices.dtype.kind != "u" or not len(vertices):
        raise file.error(f"{name}, a garment of its cloth, has vertices that are no whole numbers, or none")
    for primitive in file.entries("meshes")[node["mesh"]]["primitives"]:
        position = primitive["attributes"].get("POSITION")
        count = 0 if position is None else file.entries("accessors")[position]["count"]
        if count != len(vertices):
            raise file.error(f"the mesh of {name} has {count} vertices, its cloth {len(vertices)}")
    return BakedGarment(name, entry["node"], vertices.astype(np.int64), tuple(entry.get("fabric", ())))
