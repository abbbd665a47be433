"""BVH motion capture files: reading of hierarchy and motion."""

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch

from uvcloth.errors import InputError
from uvcloth.files.reading import read_content
from uvcloth.geometry.rotations import from_euler
from uvcloth.geometry.skeleton import MOST_JOINTS, check_joints
from uvcloth.motion.clip import Clip
from uvcloth.motion.hierarchy import Hierarchy, to_clip

END_SITE = -2
"""Stands for an end site on the stack of open joints."""

CHANNEL_NAMES = frozenset(axis + kind for axis in "xyz" for kind in ("position", "rotation"))
FRAME_TIME_RANGE = (1e-4, 0.5)
"""Least and greatest frame time, seconds: slower frames show no motion, and resampling multiplies them."""

SHOWN = 60
"""Characters of a file that an error repeats."""

LARGEST = 1e9
"""Limit for an offset or a value, in the file's units or degrees: float32 holds its square."""


@dataclass
class _Hierarchy:
    """Content of the HIERARCHY section; `channels` holds (joint, "xposition" and the like) per column."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    channels: list[tuple[int, str]] = field(default_factory=list)


def read_bvh(path: Path) -> Clip:
    """Read a BVH file in its own units and axes.

    The clip's rest pose is the file's all-zero pose: heads (J, 3) are the summed OFFSETs, rotations
    (T, J, 3, 3) the world rotations relative to it, each joint's own rotation being the product of its
    channels in the listed order. translation (T, 3) is the root's path. Position channels replace the OFFSET:
    those of the root and of hips below it move the person, others give a bone its mean offset. End sites are
    left out.

    Raises InputError naming the file and the line, frame or joint if the file is missing, truncated,
    without frames, or holds a value that is not a finite number or beyond LARGEST.
    """
    path = Path(path)
    lines = _lines(path)
    motion = next((i for i, line in enumerate(lines) if line.strip().upper() == "MOTION"), None)
    if motion is None:
        raise InputError(f"{path}: not a complete BVH file, it has no MOTION section")
    hierarchy = _parse_hierarchy(path, lines[:motion])
    values, fps = _parse_motion(path, lines, motion, hierarchy)
    positions = _positions(path, hierarchy, values)
    return to_clip(
        path.stem,
        Hierarchy(
            names=tuple(hierarchy.names),
            parents=tuple(hierarchy.parents),
            offsets=_offsets(hierarchy, positions),
            rotations=_rotations(path, hierarchy, values),
            positions=positions,
            fps=fps,
        ),
    )


def _lines(path: Path) -> list[str]:
    content = read_content(path)
    if b"\0" in content:
        raise InputError(f"{path}: not a BVH file, it is not text")
    try:
        return content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        return content.decode("latin-1").splitlines()


def _parse_hierarchy(path: Path, lines: list[str]) -> _Hierarchy:
    hierarchy = _Hierarchy()
    open_blocks: list[int] = []
    for number, line in enumerate(lines, start=1):
        if len(hierarchy.names) > MOST_JOINTS:
            break
        words = line.replace("{", " ").split()
        if words:
            try:
                _parse_line(hierarchy, open_blocks, words[0].upper(), words[1:])
            except (ValueError, IndexError) as error:
                raise InputError(
                    f"{path}, line {number}: cannot be understood: {line.strip()[:SHOWN]!r}"
                ) from error
    check_joints(path, hierarchy.names)
    if open_blocks or not hierarchy.names:
        raise InputError(f"{path}: the HIERARCHY section is not complete")
    if hierarchy.parents.count(-1) != 1:
        raise InputError(f"{path}: expected one ROOT that holds every JOINT")
    if len(set(hierarchy.names)) < len(hierarchy.names):
        twice = next(name for name in hierarchy.names if hierarchy.names.count(name) > 1)
        raise InputError(f"{path}: two joints are named {twice}")
    return hierarchy


def _parse_line(hierarchy: _Hierarchy, open_blocks: list[int], keyword: str, rest: list[str]) -> None:
    """Add one line to the hierarchy; `open_blocks` is the stack of open joints, END_SITE for an end site."""
    if END_SITE in open_blocks[-1:] and keyword in ("ROOT", "JOINT", "CHANNELS"):
        raise ValueError("an end site contains only its offset")
    if keyword in ("ROOT", "JOINT"):
        hierarchy.parents.append(open_blocks[-1] if open_blocks else -1)
        open_blocks.append(len(hierarchy.names))
        hierarchy.names.append(" ".join(rest))
        hierarchy.offsets.append([0.0, 0.0, 0.0])
    elif keyword == "END":
        open_blocks.append(END_SITE)
    elif keyword == "}":
        open_blocks.pop()
    elif keyword == "OFFSET" and open_blocks[-1] != END_SITE:
        offset = [float(word) for word in rest]
        if len(offset) != 3 or not all(abs(value) <= LARGEST for value in offset):
            raise ValueError("an offset has to be three finite numbers")
        hierarchy.offsets[open_blocks[-1]] = offset
    elif keyword == "CHANNELS":
        channels = [word.lower() for word in rest[1:]]
        if len(channels) != int(rest[0]) or not CHANNEL_NAMES.issuperset(channels):
            raise ValueError("the channels have another number than given, or unknown names")
        hierarchy.channels += [(open_blocks[-1], channel) for channel in channels]


def _parse_motion(
    path: Path, lines: list[str], motion: int, hierarchy: _Hierarchy
) -> tuple[np.ndarray, float]:
    """The values (T, channels) and the frames per second."""
    body = [
        (number, line) for number, line in enumerate(lines[motion + 1 :], start=motion + 2) if line.strip()
    ]
    try:
        frames = int(body[0][1].split(":")[1])
        seconds = float(body[1][1].split(":")[1])
    except (IndexError, ValueError) as error:
        raise InputError(f"{path}: the MOTION section lacks a readable 'Frames:' or 'Frame Time:'") from error
    if not FRAME_TIME_RANGE[0] <= seconds <= FRAME_TIME_RANGE[1]:
        least, greatest = FRAME_TIME_RANGE
        raise InputError(f"{path}: the frame time is {seconds} s, expected {least} to {greatest} s")
    if frames <= 0:
        raise InputError(f"{path}: the file has zero frames")
    rows = body[2:]
    if len(rows) != frames:
        raise InputError(f"{path}: expected {frames} frames, found {len(rows)}")
    try:
        values = np.array([line.split() for _, line in rows], dtype=np.float64)
    except ValueError as error:
        raise _bad_row(path, rows, len(hierarchy.channels)) from error
    if values.shape[1] != len(hierarchy.channels):
        raise _bad_row(path, rows, len(hierarchy.channels))
    bad = np.argwhere(~(np.abs(values) <= LARGEST))
    if len(bad):
        frame, column = bad[0]
        joint, channel = hierarchy.channels[column]
        fault = f"beyond {LARGEST:g}" if np.isfinite(values[frame, column]) else "not a finite number"
        raise InputError(
            f"{path}, line {rows[frame][0]}: frame {frame}, joint {hierarchy.names[joint]}: "
            f"{channel} is {fault}"
        )
    return values, _nominal_fps(1.0 / seconds)


def _bad_row(path: Path, rows: list[tuple[int, str]], expected: int) -> InputError:
    for frame, (number, line) in enumerate(rows):
        words = line.split()
        if len(words) != expected:
            return InputError(
                f"{path}, line {number}: frame {frame} has {len(words)} values, expected {expected}"
            )
        for word in words:
            try:
                float(word)
            except ValueError:
                return InputError(
                    f"{path}, line {number}: frame {frame} holds {word[:SHOWN]!r}, expected a number"
                )
    return InputError(f"{path}: the frames cannot be read")


def _nominal_fps(fps: float) -> float:
    """Frame rate without the rounding of a file's frame time (0.0083333 s): a whole number if close."""
    return float(round(fps)) if abs(fps - round(fps)) < 1e-4 * fps else fps


def _rotations(path: Path, hierarchy: _Hierarchy, values: np.ndarray) -> np.ndarray:
    """Rotations (T, J, 3, 3) relative to the parent."""
    local = np.tile(np.eye(3), (len(values), len(hierarchy.names), 1, 1))
    for joint, (columns, axes) in _columns(hierarchy, "rotation").items():
        if len(axes) > 3 or any(axis == following for axis, following in pairwise(axes)):
            raise InputError(
                f"{path}: joint {hierarchy.names[joint]} has the rotation channels {axes.upper()}, "
                "expected up to three with no axis twice in a row"
            )
        local[:, joint] = from_euler(axes, torch.from_numpy(np.radians(values[:, columns]))).numpy()
    return local


def _positions(path: Path, hierarchy: _Hierarchy, values: np.ndarray) -> np.ndarray:
    """Positions (T, J, 3) relative to the parent; channels of a bone that are all zero are ignored."""
    positions = np.tile(np.array(hierarchy.offsets), (len(values), 1, 1))
    for joint, (columns, axes) in _columns(hierarchy, "position").items():
        if len(set(axes)) < len(axes):
            raise InputError(f"{path}: joint {hierarchy.names[joint]} has a position channel twice")
        if hierarchy.parents[joint] < 0 or values[:, columns].any():
            positions[:, joint, ["xyz".index(axis) for axis in axes]] = values[:, columns]
    return positions


def _offsets(hierarchy: _Hierarchy, positions: np.ndarray) -> np.ndarray:
    """Offsets (J, 3) of the rest pose: the root's as written, a bone's as it is on average."""
    offsets = positions.mean(0)
    offsets[0] = hierarchy.offsets[0]
    return offsets


def _columns(hierarchy: _Hierarchy, kind: str) -> dict[int, tuple[list[int], str]]:
    """Columns of the channels of one kind by joint, and their axes ("zyx"), in the listed order."""
    by_joint: dict[int, tuple[list[int], str]] = {}
    for column, (joint, channel) in enumerate(hierarchy.channels):
        if channel.endswith(kind):
            columns, axes = by_joint.get(joint, ([], ""))
            by_joint[joint] = ([*columns, column], axes + channel[0])
    return by_joint
