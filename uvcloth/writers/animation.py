"""Animations as plain arrays, their npz files, and the local poses of a skeleton."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.fields import check_fields, indices, names, numbers
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.rotations import to_quaternions
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.options import FPS_RANGE

ANIMATION_FORMAT = "uvcloth-animation-1"
FIELDS = {
    "fps": numbers(least=FPS_RANGE[0], most=FPS_RANGE[1], dtype=np.float64),
    "names": names("K"),
    "transforms": numbers("F", "J", 3, 4),
}
"""Arrays of an animation's file, except those of each garment."""

FRAMES_AT_ONCE = 32
"""Frames that are in memory at once."""

POSES_AT_ONCE = 1024
"""Frames whose local poses are computed at once."""


@dataclass(frozen=True)
class Animation:
    """F frames of garments on a body, metres, Z up.

    names: of the garments. meshes: at rest on the body's rest pose. vertices: per garment (F, N, 3) float32,
    possibly memory-mapped. body: None leaves it out. transforms: (F, J, 3, 4) rest-to-posed joint transforms,
    J = 0 without a body. fps: frames per second.
    """

    names: tuple[str, ...]
    meshes: tuple[Mesh, ...]
    vertices: tuple[np.ndarray, ...]
    body: Body | None
    transforms: np.ndarray
    fps: float

    def __len__(self) -> int:
        return len(self.transforms)

    def chunks(self) -> Iterator[slice]:
        """Slices of FRAMES_AT_ONCE frames that cover the animation in order."""
        return (
            slice(start, min(start + FRAMES_AT_ONCE, len(self)))
            for start in range(0, len(self), FRAMES_AT_ONCE)
        )


def posed_body(animation: Animation) -> Iterator[np.ndarray]:
    """The body's vertices in chunks of frames (B, V, 3), m; the animation has to have one."""
    body = animation.body
    assert body is not None
    for frames in animation.chunks():
        transforms = torch.from_numpy(np.array(animation.transforms[frames]))
        yield posed_skin(body, transforms).numpy()


def write_npz(animation: Animation, path: Path) -> None:
    """Write one compressed npz: names, transforms, fps; per garment vertices, rest, faces, uvs, face_uvs.

    Raises InputError if it cannot be written.
    """
    arrays: dict[str, np.ndarray] = {
        "format": np.array(ANIMATION_FORMAT),
        "fps": np.array(animation.fps, np.float64),
        "names": np.array(animation.names),
        "transforms": animation.transforms,
    }
    for name, mesh, vertices in zip(animation.names, animation.meshes, animation.vertices, strict=True):
        arrays[f"{name}_vertices"] = vertices
        arrays[f"{name}_rest"] = mesh.vertices.numpy().astype(np.float32)
        arrays[f"{name}_faces"] = mesh.faces.numpy().astype(np.int32)
        arrays[f"{name}_uvs"] = mesh.uvs.numpy().astype(np.float32)
        arrays[f"{name}_face_uvs"] = mesh.face_uvs.numpy().astype(np.int32)
    save_arrays(path, arrays)


def load_animation(path: Path) -> Animation:
    """Read an animation npz, without its body.

    Raises InputError naming the file, and the array, if it is not one, or holds arrays that do not fit
    together, are out of range or not finite.
    """
    arrays = load_arrays(path, ANIMATION_FORMAT, "an animation made by `uvcloth rollout`")
    data = check_fields(path, arrays, FIELDS)
    names = tuple(map(str, data["names"]))
    if len(set(names)) < len(names):
        raise InputError(f"{path}: names contains a garment twice, expected each once")
    garments = [_garment(path, arrays, name, len(data["transforms"])) for name in names]
    return Animation(
        names=names,
        meshes=tuple(mesh for mesh, _ in garments),
        vertices=tuple(vertices for _, vertices in garments),
        body=None,
        transforms=data["transforms"],
        fps=float(data["fps"]),
    )


def _garment(path: Path, arrays: dict[str, np.ndarray], name: str, frames: int) -> tuple[Mesh, np.ndarray]:
    """Mesh of a garment in a file, and its vertices (F, N, 3)."""
    fields = {
        f"{name}_rest": numbers("N", 3),
        f"{name}_faces": indices("M", 3, of="N"),
        f"{name}_uvs": numbers("U", 2),
        f"{name}_face_uvs": indices("M", 3, of="U").or_empty(),
        f"{name}_vertices": numbers("F", "N", 3),
    }
    rest, faces, uvs, face_uvs, vertices = check_fields(path, arrays, fields, F=frames).values()
    return Mesh(*(torch.from_numpy(array) for array in (rest, faces, uvs, face_uvs))), vertices


def local_pose(
    skeleton: Skeleton, transforms: np.ndarray, before: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Poses of joints relative to their parents: transforms (F, J, 3, 4) -> translations and rotations.

    Translations (F, J, 3) in metres; rotations (F, J, 4) as unit quaternions x, y, z, w that never jump to
    their negative from one frame to the next. before: (J, 4), the quaternions of the preceding frame. At rest
    every joint has the world's orientation, so that a bind pose is a shift.
    """
    turns = transforms[..., :3].astype(np.float64)
    heads = skeleton.heads.numpy().astype(np.float64)
    positions = np.einsum("fjab,jb->fja", turns, heads) + transforms[..., 3]
    parents = np.array(skeleton.parents)
    child, parent = np.nonzero(parents >= 0)[0], parents[parents >= 0]
    translations, rotations = positions.copy(), turns.copy()
    inverse = turns[:, parent].swapaxes(-1, -2)
    translations[:, child] = (inverse @ (positions[:, child] - positions[:, parent])[..., None])[..., 0]
    rotations[:, child] = inverse @ turns[:, child]
    quaternions = to_quaternions(torch.from_numpy(rotations)).numpy()
    earlier = np.concatenate([quaternions[:1] if before is None else before[None], quaternions[:-1]])
    flips = np.sign((quaternions * earlier).sum(-1, keepdims=True))
    quaternions *= np.cumprod(np.where(flips == 0, 1, flips), axis=0)
    return translations.astype(np.float32), quaternions.astype(np.float32)


def local_poses(skeleton: Skeleton, transforms: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """`local_pose` of all frames, in parts of POSES_AT_ONCE frames."""
    last = None
    for start in range(0, len(transforms), POSES_AT_ONCE):
        some = np.array(transforms[start : start + POSES_AT_ONCE])
        translations, rotations = local_pose(skeleton, some, last)
        yield translations, rotations
        last = rotations[-1]
