"""Point caches: PC2 (Blender, 3ds Max) and MDD (LightWave, Blender, Houdini). They hold points alone."""

import struct
from pathlib import Path

import numpy as np

from uvcloth.errors import InputError
from uvcloth.files.reading import read_content
from uvcloth.formats.point_sequence import PointSequence, steady_rate

PC2_HEADER, PC2_SIGNATURE = struct.Struct("<12siiffi"), b"POINTCACHE2\0"
MDD_HEADER = struct.Struct(">ii")


def read_pc2(path: Path) -> PointSequence:
    """Read a PC2 as it is; it does not say its frame rate.

    Header: signature, version 1, points, first frame, frames per sample, samples; then x, y, z floats.
    Raises InputError naming the file if it is damaged, or has other than one sample per frame.
    """
    content = read_content(path)
    if len(content) < PC2_HEADER.size or not content.startswith(PC2_SIGNATURE):
        raise InputError(f"{path}: not a readable PC2 file (it does not begin with POINTCACHE2)")
    _, _, points, _, step, frames = PC2_HEADER.unpack_from(content)
    if step != 1.0:
        raise InputError(f"{path}: has a sample every {step:g} frames, expected one per frame")
    return PointSequence(_points(path, content, PC2_HEADER.size, frames, points, "<f4"))


def read_mdd(path: Path) -> PointSequence:
    """Read an MDD as it is, with the frame rate of its times.

    Big-endian: frames, points, the time of each frame in seconds; then x, y, z floats. Raises InputError
    naming the file if it is damaged, or its times are not evenly spaced.
    """
    content = read_content(path)
    if len(content) < MDD_HEADER.size:
        raise InputError(f"{path}: not a readable MDD file (it has only {len(content)} bytes)")
    frames, points = MDD_HEADER.unpack_from(content)
    start = MDD_HEADER.size + 4 * max(frames, 0)
    vertices = _points(path, content, start, frames, points, ">f4")
    times = np.frombuffer(content, ">f4", frames, MDD_HEADER.size).astype(np.float64)
    return PointSequence(vertices, steady_rate(path, times))


def _points(path: Path, content: bytes, start: int, frames: int, points: int, dtype: str) -> np.ndarray:
    """Points (frames, points, 3) float32 after the header. Raises InputError for a file of another size."""
    expected = start + 12 * frames * points
    if frames < 0 or points < 0 or len(content) != expected:
        raise InputError(
            f"{path}: has {len(content):,} bytes, expected {expected:,} for {frames:,} frames of "
            f"{points:,} points"
        )
    values = np.frombuffer(content, dtype, 3 * frames * points, start)
    return values.reshape(frames, points, 3).astype(np.float32)
