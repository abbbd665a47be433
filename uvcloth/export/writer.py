"""Writing of animation files: frames are spooled to disk, and the file appears whole or not at all."""

import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import IO

import numpy as np
from torch import Tensor

from rasterize.atomic import make_folder
from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.export.animation import Animation, write_npz
from uvcloth.export.gltf import write_glb
from uvcloth.export.pointcache import write_pc2
from uvcloth.export.usd import write_usd
from uvcloth.geometry.mesh import Mesh

WRITERS: dict[str, Callable[[Animation, Path], None]] = {
    ".glb": write_glb,
    ".usdc": write_usd,
    ".usd": write_usd,
    ".pc2": write_pc2,
    ".npz": write_npz,
}
"""Writers by suffix. A writer may put several files beside the path that it is given."""


class FrameWriter:
    """Writer of frames of garments and of the body's joints; `close` leaves the file (see open_writer)."""

    def __init__(
        self,
        path: Path,
        garments: Sequence[tuple[str, Mesh]],
        body: Body | None,
        fps: float,
        spool: Path,
    ) -> None:
        self.path = path
        self.written: tuple[Path, ...] = ()
        """Files that close() left."""
        self._garments, self._body, self._fps = tuple(garments), body, fps
        self._spool, self._frames = spool, 0
        self._finished = spool / "finished"
        joints = 0 if body is None else len(body.skeleton.names)
        self._shapes: list[tuple[int, ...]] = [(len(mesh.vertices), 3) for _, mesh in garments]
        self._shapes.append((joints, 3, 4))
        self._streams: list[IO[bytes]] = [
            (spool / f"{index}.frames").open("wb") for index in range(len(self._shapes))
        ]

    def add(self, vertices: Sequence[Tensor], transforms: Tensor | None = None) -> None:
        """Append one frame, or a batch of frames in order.

        vertices: per garment (N, 3) or (B, N, 3) metres. transforms: (J, 3, 4) or (B, J, 3, 4), unused and
        optional without a body. Raises InputError if the disk is full or a vertex is not a finite number.
        """
        rows = [
            values.detach().cpu().numpy().astype(np.float32, copy=False).reshape(-1, *shape)
            for values, shape in zip(vertices, self._shapes[:-1], strict=True)
        ]
        if self._body is not None:
            if transforms is None:
                raise ValueError("a writer with a body needs the joint transforms of every frame")
            joints = transforms.detach().cpu().numpy().astype(np.float32, copy=False)
            rows.append(joints.reshape(-1, *self._shapes[-1]))
        for (name, _), values in zip(self._garments, rows, strict=False):
            if not np.isfinite(values).all():
                raise InputError(
                    f"{self.path}: a vertex of {name} is not a finite number at frame {self._frames} or later"
                )
        try:
            for stream, values in zip(self._streams, rows, strict=False):
                stream.write(np.ascontiguousarray(values).data)
        except OSError as error:
            raise _cannot_write(self.path, error) from error
        self._frames += len(rows[0])

    def hide(self, faces: Tensor) -> None:
        """Leave faces of the body out of the file: mask (F,) bool. Its vertices all stay."""
        if self._body is not None:
            seen, mesh = ~faces, self._body.mesh
            shown = replace(mesh, faces=mesh.faces[seen], face_uvs=mesh.face_uvs[seen])
            regions, sides = self._body.regions[seen], self._body.sides[seen]
            self._body = replace(self._body, mesh=shown, regions=regions, sides=sides)

    def finish(self) -> None:
        """Write the file, which appears with `close`. Raises InputError if the disk is full or no frame came.

        Several writers that finish before any of them closes leave all of their files or none.
        """
        try:
            for stream in self._streams:
                stream.close()
            if not self._frames:
                raise InputError(f"{self.path}: there is no frame to write")
            self._finished.mkdir()
            WRITERS[self.path.suffix.lower()](self._animation(), self._finished / self.path.name)
        except OSError as error:
            raise _cannot_write(self.path, error) from error

    def close(self) -> None:
        """Move the file to its place, finished first if need be, and drop the frames.

        Raises InputError as `finish` does.
        """
        try:
            if not self._finished.exists():
                self.finish()
            self.written = tuple(
                part.replace(self.path.parent / part.name) for part in sorted(self._finished.iterdir())
            )
        except OSError as error:
            raise _cannot_write(self.path, error) from error
        finally:
            self.discard()

    def discard(self) -> None:
        """Drop the spooled frames and leave nothing."""
        for stream in self._streams:
            try:
                stream.close()
            except OSError:
                continue
        shutil.rmtree(self._spool, ignore_errors=True)

    def _animation(self) -> Animation:
        frames = [
            np.memmap(self._spool / f"{index}.frames", np.float32, "r", shape=(self._frames, *shape))
            if np.prod(shape)
            else np.zeros((self._frames, *shape), np.float32)
            for index, shape in enumerate(self._shapes)
        ]
        return Animation(
            names=tuple(name for name, _ in self._garments),
            meshes=tuple(mesh for _, mesh in self._garments),
            vertices=tuple(frames[:-1]),
            body=self._body,
            transforms=frames[-1],
            fps=self._fps,
        )

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


def open_writer(
    path: Path, garments: Sequence[tuple[str, Mesh]], body: Body | None, fps: float
) -> FrameWriter:
    """Start a file of moving garments (name, mesh at rest), and of the body unless it is None.

    The suffix decides: .glb (glTF: morph targets, a skinned body), .usdc or .usd, .pc2 (one point cache and
    one OBJ per mesh, named after the path), .npz (arrays, see load_animation). Use it as a context manager:
    leaving it by an exception writes nothing. Memory does not grow with the number of frames.
    Raises InputError for another suffix, for garments of the same name, or if the folder cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in WRITERS:
        supported = ", ".join(WRITERS)
        raise InputError(
            f"{path}: the format {path.suffix or '(none)'} is not supported, use one of {supported}"
        )
    names = [name for name, _ in garments] + ["body"]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{path}: two meshes are called {twice[0]}, each needs its own name")
    make_folder(path.parent)
    try:
        spool = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".partial", dir=path.parent))
    except OSError as error:
        raise _cannot_write(path, error) from error
    return FrameWriter(path, garments, body, fps, spool)


def _cannot_write(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror or error})")
