"""Writing of animation files and pictures: a file appears whole or not at all."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Protocol

import numpy as np
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.visible import visible_body
from uvcloth.errors import InputError
from uvcloth.files.atomic import Partial, put_in_place
from uvcloth.files.fields import require_file_name
from uvcloth.geometry.mesh import Mesh
from uvcloth.writers.alembic import write_abc
from uvcloth.writers.animation import Animation, write_npz
from uvcloth.writers.gltf import write_glb
from uvcloth.writers.obj_sequence import write_obj_sequence
from uvcloth.writers.pictures import SHEETS, VIDEOS, Pictures
from uvcloth.writers.pointcache import write_pc2
from uvcloth.writers.shot import USUAL, Shot
from uvcloth.writers.spool import Spool
from uvcloth.writers.usd import write_usd

WRITERS: dict[str, Callable[[Animation, Path], None]] = {
    ".glb": write_glb,
    ".usdc": write_usd,
    ".usd": write_usd,
    ".pc2": write_pc2,
    ".abc": write_abc,
    ".obj": write_obj_sequence,
    ".npz": write_npz,
}
"""Writers by suffix. A writer may put several files beside the path that it is given."""

PICTURES = (*VIDEOS, *SHEETS)
"""Suffixes of files that are drawn as the frames arrive."""


class Sink(Protocol):
    """Receiver of the frames of one file."""

    def add(self, vertices: Sequence[np.ndarray], transforms: np.ndarray) -> None:
        """Append B frames: per garment (B, N, 3) m, and (B, J, 3, 4). Raises OSError if the disk is full."""
        ...

    def hide(self, faces: Tensor) -> None:
        """Leave faces of the body out of what is not written yet: mask (F,) bool."""
        ...

    def finish(self, path: Path) -> None:
        """Write the file. Raises OSError if the disk is full."""
        ...

    def discard(self) -> None:
        """Close open files."""
        ...


class FrameWriter:
    """Writer of frames of garments and of the body's joints; `close` leaves the file (see open_writer)."""

    def __init__(
        self, path: Path, garments: Sequence[tuple[str, Mesh]], joints: int, partial: Partial, sink: Sink
    ) -> None:
        self.path = path
        self.written: tuple[Path, ...] = ()
        """Files that close() left."""
        self._garments, self._joints = tuple(garments), joints
        self._partial, self._sink, self._frames, self._is_finished = partial, sink, 0, False

    def add(self, vertices: Sequence[Tensor], transforms: Tensor | None = None) -> None:
        """Append one frame, or a batch of frames in order.

        vertices: per garment (N, 3) or (B, N, 3) metres. transforms: (J, 3, 4) or (B, J, 3, 4), unused and
        optional without a body. Raises InputError if the disk is full, if the folder of the file has been
        removed, or if a vertex is not a finite number.
        """
        self._partial.require_there()
        rows = [
            values.detach().cpu().numpy().astype(np.float32, copy=False).reshape(-1, len(mesh.vertices), 3)
            for values, (_, mesh) in zip(vertices, self._garments, strict=True)
        ]
        joints = np.zeros((len(rows[0]), 0, 3, 4), np.float32)
        if self._joints:
            if transforms is None:
                raise ValueError("a writer with a body needs the joint transforms of every frame")
            joints = transforms.detach().cpu().numpy().astype(np.float32, copy=False)
            joints = joints.reshape(-1, self._joints, 3, 4)
        for (name, _), values in zip(self._garments, rows, strict=True):
            if not np.isfinite(values).all():
                raise InputError(
                    f"{self.path}: a vertex of {name} is not a finite number at frame {self._frames} or later"
                )
        try:
            self._sink.add(rows, joints)
        except OSError as error:
            raise _cannot_write(self.path, error) from error
        self._frames += len(joints)

    def hide(self, faces: Tensor) -> None:
        """Leave faces of the body out of the file: mask (F,) bool. Pictures, drawn before, keep them."""
        self._sink.hide(faces)

    def finish(self) -> None:
        """Write the file, which appears with `close`.

        Raises InputError if the disk is full or no frame came.
        """
        try:
            if not self._frames:
                raise InputError(f"{self.path}: there is no frame to write")
            self._partial.require_there()
            self._sink.finish(self._partial.finished / self.path.name)
        except OSError as error:
            raise _cannot_write(self.path, error) from error
        self._is_finished = True

    def close(self) -> None:
        """Move the file to its place, finished first if need be, and drop the frames.

        Raises InputError as `finish` does.
        """
        if not self.written:
            close_together([self])

    def discard(self) -> None:
        """Drop the frames and leave nothing."""
        self._sink.discard()
        self._partial.remove()

    def __enter__(self) -> "FrameWriter":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()


def close_together(writers: Sequence[FrameWriter]) -> None:
    """Close writers so that all of their files appear or none.

    Raises InputError as `FrameWriter.finish` does.
    """
    try:
        for writer in writers:
            if not writer._is_finished:
                writer.finish()
        written = put_in_place([writer._partial for writer in writers])
        for writer, paths in zip(writers, written, strict=True):
            writer.written = paths
    finally:
        for writer in writers:
            writer.discard()


def open_writer(
    path: Path,
    garments: Sequence[tuple[str, Mesh]],
    body: Body | None,
    fps: float,
    motion: Tensor | None = None,
    coarse: bool = False,
    shot: Shot = USUAL,
) -> FrameWriter:
    """Start a file of moving garments (name, mesh at rest), and of the body's visible mesh unless it is None.

    The suffix decides: .glb (glTF: morph targets, a skinned body), .usdc or .usd, .pc2 (one point cache and
    one OBJ per mesh, named after the path), .abc (Alembic), .obj (a file per frame), .npz (arrays, see
    load_animation), .mp4 and .gif (a video), .png (a contact sheet). Pictures need the body and its motion
    (F, J, 3, 4), which the camera follows; coarse ones are small and quickly drawn; shot: their camera and
    size. Materials and textures of garments that were read from a file are kept, in files beside it where the
    format needs them there.
    Use it as a context manager: leaving it by an exception writes nothing.
    Memory does not grow with the number of frames.
    Raises InputError for another suffix, for garments of the same name, where a package is missing, or if the
    folder cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (*WRITERS, *PICTURES):
        supported = ", ".join((*WRITERS, *PICTURES))
        raise InputError(
            f"{path}: the format {path.suffix or '(none)'} is not supported, use one of {supported}"
        )
    require_own_names(path, [name for name, _ in garments])
    if suffix == ".pc2":
        for name, _ in garments:
            require_file_name(f"{path.stem}-{name}{suffix}", path)
    try:
        partial = Partial(path)
    except OSError as error:
        raise _cannot_write(path, error) from error
    sink: Sink
    body = body and visible_body(body)
    try:
        if suffix in WRITERS:
            sink = Spool(partial.folder, garments, body, fps, WRITERS[suffix])
        elif body is None or motion is None:
            raise InputError(f"{path}: pictures need the body and its motion")
        else:
            sink = Pictures(partial.folder / path.name, garments, body, fps, motion, coarse, shot)
    except BaseException:
        partial.remove()
        raise
    return FrameWriter(path, garments, 0 if body is None else len(body.skeleton.names), partial, sink)


def require_own_names(path: Path, garments: Sequence[str]) -> None:
    """Raise InputError naming the file if two of its garments share a name, or one is called body.

    Names that differ only in capitals count as the same: on Windows and macOS, files do.
    """
    names = [*garments, "body"]
    folded = [name.casefold() for name in names]
    for each in sorted(folded):
        if folded.count(each) > 1:
            same = " and ".join(sorted({name for name in names if name.casefold() == each}))
            raise InputError(f"{path}: two meshes are called {same}, each needs its own name")


def _cannot_write(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror or error})")
