"""Unfinished sequences: frames are kept during the simulation, so that a killed one continues from them.

They are in a hidden file next to the future sequence, `.NAME.unfinished`, until the sequence exists.
"""

import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uvcloth.dataset.folder import is_finished
from uvcloth.errors import InputError
from uvcloth.files.atomic import require_there
from uvcloth.files.fields import check_fields, numbers, text
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.kept import keep_arrays, kept_arrays
from uvcloth.simulation.engine import Engine, Frame, Scene
from uvcloth.version import package_version

SUFFIX = ".unfinished"

SECONDS = 20.0
"""Seconds of simulation after which frames are kept: at most so much and one frame are lost."""

FORMAT, EXPECTED_FILE = "uvcloth-unfinished-1", "frames that `uvcloth simulate` keeps"


@dataclass(frozen=True)
class Place:
    """Place of a sequence that is simulated: the folder of the data, and the sequence's file in it."""

    folder: Path
    target: Path

    @property
    def file(self) -> Path:
        """File of the unfinished frames."""
        return self.target.with_name(f".{self.target.stem}{SUFFIX}")


@dataclass(frozen=True)
class SimulatedFrames:
    """Cloth over the first F frames of a scene.

    vertices: (F, N, 3) m. seconds: that they took. memory: (K,) of the engine at the last one.
    """

    vertices: Tensor
    seconds: float
    memory: Tensor | None = None


def move(
    engine: Engine, scene: Scene, place: Place | None, report: Callable[[int], None] = lambda made: None
) -> SimulatedFrames:
    """Simulate a scene, up to the first frame that is not finite if there is one.

    place: where frames are kept every SECONDS; they are continued if scene, engine and version of this
    package are equal. Nothing is kept if the folder does not exist, as on another machine, or cannot be
    written to. report: called with the number of frames so far, first with that of the kept ones.
    """
    key = "" if place is None else _key(engine, scene)
    kept = None if place is None else _load(place.file, key, len(scene.rest))
    frames = [] if kept is None else list(kept.vertices)
    started = time.monotonic() - (0.0 if kept is None else kept.seconds)
    after = None if kept is None else Frame(len(frames) - 1, frames[-1], kept.memory)
    report(len(frames))
    saved = time.monotonic()
    for frame in engine.simulate(scene, after):
        frames.append(frame.vertices)
        report(len(frames))
        if not torch.isfinite(frame.vertices).all():
            break
        if place is not None and frame.memory is not None and time.monotonic() - saved > SECONDS:
            progress = SimulatedFrames(torch.stack(frames), time.monotonic() - started, frame.memory)
            with suppress(InputError):
                _save(progress, key, place)
            saved = time.monotonic()
    return SimulatedFrames(torch.stack(frames), time.monotonic() - started)


def clear_finished(folder: Path) -> None:
    """Remove the kept frames of finished sequences from a data folder."""
    for file in unfinished_files(folder):
        if is_finished(_target(file)):
            with suppress(OSError):
                file.unlink()


def unfinished_files(folder: Path) -> list[Path]:
    """Files of unfinished frames in a data folder, sorted."""
    return sorted(chain.from_iterable(folder.glob(depth + f".*{SUFFIX}") for depth in ("", "*/")))


def unfinished_frames(file: Path) -> tuple[str, int]:
    """Name of an unfinished sequence, and the number of its frames; 0 in a damaged file."""
    try:
        frames = len(_read(file)["vertices"])
    except InputError:
        frames = 0
    return _target(file).stem, frames


def _target(file: Path) -> Path:
    """The sequence's file of an unfinished one."""
    return file.with_name(f"{file.name[1:].removesuffix(SUFFIX)}.npz")


def _key(engine: Engine, scene: Scene) -> str:
    """Hash of all that frames depend on."""
    tensors = (
        *(scene.rest, scene.faces, scene.band, scene.mass_factor, scene.inner_thickness, scene.skinned),
        *(scene.collider, scene.touches, *scene.collider_parts),
    )
    sizes = [list(tensor.shape) for tensor in tensors]
    settings = json.dumps([package_version(), engine.describe(), scene.fps, sizes], sort_keys=True)
    return fingerprint(settings, *tensors)


def _save(progress: SimulatedFrames, key: str, place: Place) -> None:
    """Write frames to their place. Raises InputError if that cannot be, or the folder is gone."""
    assert progress.memory is not None
    require_there(place.folder)
    arrays = {
        "key": np.array(key),
        "vertices": progress.vertices.numpy(),
        "memory": progress.memory.numpy(),
        "seconds": np.array(progress.seconds),
    }
    keep_arrays(place.file, FORMAT, arrays, compressed=False)


def _load(file: Path, key: str, vertices: int) -> SimulatedFrames | None:
    """Kept frames; None if there are none, or if they are damaged or have another key. vertices: of the
    cloth.
    """
    try:
        data = _read(file, N=vertices)
    except InputError:
        return None
    if data["key"] != key:
        return None
    points, memory = torch.from_numpy(data["vertices"]), torch.from_numpy(data["memory"])
    return SimulatedFrames(points, float(data["seconds"]), memory)


def _read(file: Path, **sizes: int) -> dict[str, np.ndarray]:
    """Arrays of a file. Raises InputError as `kept_arrays` and `check_fields` do."""
    fields = {
        "key": text(),
        "vertices": numbers("F", "N", 3),
        "memory": numbers("K"),
        "seconds": numbers(least=0.0, dtype=np.float64),
    }
    data = check_fields(file, kept_arrays(file, FORMAT, EXPECTED_FILE), fields, **sizes)
    if not len(data["vertices"]):
        raise InputError(f"{file}: holds no frame")
    return data
