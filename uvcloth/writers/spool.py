"""Frames of an animation on disk, until all are there and the file can be written."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO

import numpy as np
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh
from uvcloth.writers.animation import Animation


class Spool:
    """Frames of garments and of the body's joints in a folder; memory does not grow with their number."""

    def __init__(
        self,
        folder: Path,
        garments: Sequence[tuple[str, Mesh]],
        body: Body | None,
        fps: float,
        write: Callable[[Animation, Path], None],
    ) -> None:
        self._folder, self._garments, self._body, self._fps = folder, tuple(garments), body, fps
        self._write, self._frames = write, 0
        joints = 0 if body is None else len(body.skeleton.names)
        self._shapes: list[tuple[int, ...]] = [(len(mesh.vertices), 3) for _, mesh in garments]
        self._shapes.append((joints, 3, 4))
        self._streams: list[IO[bytes]] = [
            (folder / f"{index}.frames").open("wb") for index in range(len(self._shapes))
        ]

    def add(self, vertices: Sequence[np.ndarray], transforms: np.ndarray) -> None:
        """Append B frames: per garment (B, N, 3) m, and (B, J, 3, 4). Raises OSError if the disk is full."""
        for stream, values in zip(self._streams, (*vertices, transforms), strict=True):
            stream.write(np.ascontiguousarray(values).data)
        self._frames += len(transforms)

    def hide(self, faces: Tensor) -> None:
        """Leave faces of the body out: mask (F,) bool. Its vertices all stay."""
        if self._body is not None:
            visible, mesh = ~faces, self._body.mesh
            shown = replace(mesh, faces=mesh.faces[visible], face_uvs=mesh.face_uvs[visible])
            regions, sides = self._body.regions[visible], self._body.sides[visible]
            self._body = replace(self._body, mesh=shown, regions=regions, sides=sides)

    def finish(self, path: Path) -> None:
        """Write the file. Raises OSError if the disk is full, and what the writer raises."""
        for stream in self._streams:
            stream.close()
        self._write(self._animation(), path)

    def discard(self) -> None:
        """Close open files."""
        for stream in self._streams:
            try:
                stream.close()
            except OSError:
                continue

    def _animation(self) -> Animation:
        frames = [
            np.memmap(self._folder / f"{index}.frames", np.float32, "r", shape=(self._frames, *shape))
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
