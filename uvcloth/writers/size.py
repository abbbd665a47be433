"""Sizes of animation files, known before a rollout begins."""

from collections.abc import Sequence
from pathlib import Path

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import Mesh
from uvcloth.writers.glb import MAX_FILE_BYTES
from uvcloth.writers.gltf_scene import split_seams

POINT, POINT_AND_NORMAL = 12, 24
"""Bytes of a vertex in a frame."""

LINE = 30
"""Bytes, about, of a line of an OBJ."""

DESCRIPTION = 500
"""Bytes, about, with which glTF describes one blend shape."""


def expected_bytes(suffix: str, frames: int, meshes: Sequence[Mesh], body: Body | None) -> int:
    """Approximate size of a file of a number of frames, to within a tenth where it is large; 0 for pictures.

    An upper bound for .npz, which is compressed, and for OpenUSD, which keeps equal values once.
    """
    vertices = sum(len(mesh.vertices) for mesh in meshes)
    if suffix == ".glb":
        repeated = sum(len(split_seams(mesh)[0]) for mesh in meshes)
        weights = 4 * frames * frames * len(meshes)
        described = DESCRIPTION * frames * len(meshes)
        return frames * repeated * POINT_AND_NORMAL + weights + described
    if suffix in (".pc2", ".abc"):
        return frames * POINT * (vertices + (len(body.mesh.vertices) if body else 0))
    if suffix in (".usd", ".usdc"):
        return frames * POINT_AND_NORMAL * vertices
    if suffix == ".npz":
        return frames * POINT * vertices
    if suffix == ".obj":
        bodies = [body.mesh] if body else []
        lines = sum(len(mesh.vertices) + len(mesh.uvs) + len(mesh.faces) for mesh in (*meshes, *bodies))
        return frames * LINE * lines
    return 0


LARGE = 500e6
"""Bytes from which a file is announced."""


def announce(path: Path, frames: int, meshes: Sequence[Mesh], body: Body | None) -> str:
    """Sentence about a file that will be large, with smaller formats; "" for any other.

    Raises InputError for a glTF file that would exceed what the format can hold.
    """
    size = expected_bytes(path.suffix.lower(), frames, meshes, body)
    sizes = {suffix: expected_bytes(suffix, frames, meshes, body) for suffix in (".usdc", ".abc", ".pc2")}
    smaller = [f"{suffix} ({other / 1e9:.1f} GB)" for suffix, other in sizes.items() if other < size]
    instead = ", ".join([*smaller, "or fewer frames"])
    if path.suffix.lower() == ".glb" and size > MAX_FILE_BYTES:
        raise InputError(
            f"{path}: {frames} frames would take {size / 1e9:.1f} GB and a .glb holds 4.3: write {instead}"
        )
    if size < LARGE:
        return ""
    return f"{path}: will take about {size / 1e9:.1f} GB; smaller: {instead}"
