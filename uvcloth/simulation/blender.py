"""Cloth simulation with Blender, in a process and a Python environment of its own.

The environment variable UVCLOTH_BLENDER_PYTHON names a Python in which `import bpy` works. A scene goes there
as a file, frames come back through a pipe (`blender_worker.py`); bpy, which is GPL, is never imported here.

Blender has no settings for the parts of the collider that a vertex may touch (`_reachable` approximates them
by leaving out faces), the mass of a single vertex (`mass_factor` only makes the attachment stiffer), other
cloth under a vertex (`inner_thickness`; layers still keep apart, by self-collision), a Poisson ratio other
than 1/3, that of a net of springs, and air that acts along the normals of faces only.
"""

import json
import os
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.geometry.mesh import face_normals, unique_edges
from uvcloth.geometry.units import GRAVITY
from uvcloth.physics.fabric import AIR_DENSITY, Fabric
from uvcloth.simulation.engine import Frame, Scene

PYTHON_VARIABLE = "UVCLOTH_BLENDER_PYTHON"
"""Environment variable that names the Python with bpy."""

BLENDER_SERIES = "4.5"
"""Series of Blender whose cloth was measured (docs/simulation.md); others may step differently."""

WORKER = Path(__file__).with_name("blender_worker.py")

BENDING_FACTOR = 17.0
"""Blender's bending stiffness per bending rigidity and area of a triangle, by the cantilever test."""

COLLIDER_THICKNESS, KEPT_DISTANCE_SHARE = 0.001, 8.0 / 9.0
"""Blender adds at least this thickness, m, of the collider to the distance to keep, and keeps that share."""

PRESSED_DISTANCE = 0.05
"""Metres from a part at rest within which cloth that may not touch it may come between it and another."""

MAX_FRICTION = 0.8
"""Greatest coefficient of friction that Blender's cloth can have."""

MAX_SELF_DISTANCE = 0.25
"""Largest distance of cloth from itself, in mean edge lengths: above, neighbours push each other away."""

FACE_MARGIN = 0.01
"""Metres by which cloth that may touch a face has to be closer to it at rest than cloth that may not."""


@dataclass(frozen=True)
class Blender:
    """Blender's cloth. Settings in SI units; python: the interpreter that runs it; version: as it reports.

    quality: steps per frame, a power of two: Blender adds up 1 / quality until it has a whole frame, and
    other numbers may round to a step too many. collision_quality: passes over contacts in a step.
    radius: m kept between cloth and body. self_radius: m between cloth and cloth, at most MAX_SELF_DISTANCE.
    hold: 1/s, the frequency of the soft attachment of the band; without one it moves as the skinned garment.
    """

    python: str
    version: str
    fabric: Fabric = Fabric()  # noqa: RUF009
    quality: int = 16
    collision_quality: int = 3
    radius: float = 0.004
    self_collision: bool = True
    self_radius: float = 0.003
    hold: float | None = None

    def describe(self) -> dict[str, Any]:
        """Describe engine, versions and settings, as `Engine` says."""
        settings = {key: value for key, value in asdict(self).items() if key not in ("python", "version")}
        return {"engine": "blender.cloth", "versions": {"blender": self.version}, "settings": settings}

    def with_fabric(self, fabric: Fabric) -> Self:
        """Make the same engine for cloth of another fabric."""
        return replace(self, fabric=fabric)

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        """Yield the frames as `Engine` says, without a memory; Blender ends when the iterator does.

        Raises InputError if Blender ends before the last frame, ValueError if `after` is given.
        """
        if after is not None:
            raise ValueError("Blender's cloth begins at the first frame")
        arrays = _arrays(scene)
        settings = json.dumps(self._settings(scene))
        with tempfile.TemporaryDirectory(prefix="uvcloth-blender-") as folder:
            path = Path(folder) / "scene.npz"
            np.savez(path, allow_pickle=False, settings=np.array(settings), **arrays)
            for index, vertices in enumerate(_frames(self.python, path, len(scene.skinned), len(scene.rest))):
                yield Frame(index, vertices)

    def _settings(self, scene: Scene) -> dict[str, Any]:
        """Blender's settings.

        Its unit of time is a frame, its springs' stiffness is given per mean length.
        """
        fabric, step = self.fabric, 1.0 / scene.fps
        if fabric.friction > MAX_FRICTION:
            raise InputError(f"Blender's cloth has friction up to {MAX_FRICTION}, not {fabric.friction}")
        edges = unique_edges(scene.faces)
        lengths = (scene.rest[edges[:, 0]] - scene.rest[edges[:, 1]]).norm(dim=1)
        area = float(face_normals(scene.rest, scene.faces).norm(dim=1).sum()) / 2.0
        mass = fabric.density * area / len(scene.rest)
        # A net of springs of stiffness k has the membrane stiffness k sum(length^2) / (3 area).
        spring = 3.0 * area * fabric.stretch / float(lengths.square().sum())
        tension = spring * float(lengths.mean()) * step**2
        # Blender's air slows motion in any direction: by a third of the drag along the normal at 1 m/s.
        drag = fabric.drag * AIR_DENSITY / (2.0 * fabric.density) / 3.0
        held = mass * float(scene.mass_factor[scene.band].mean()) if scene.band.any() else 0.0
        hold = (self.hold or 0.0) * step
        return {
            "gravity": GRAVITY * step**2,
            "thickness": COLLIDER_THICKNESS,
            "pinned": self.hold is None,
            "friction": 100.0 * fabric.friction,
            "cloth": {
                "mass": mass,
                "quality": self.quality,
                "air_damping": 100.0 * mass * drag * step,
                "tension_stiffness": tension,
                "compression_stiffness": tension,
                "bending_model": "ANGULAR",
                "bending_stiffness": BENDING_FACTOR * fabric.bend * len(scene.faces) / area * step**2,
                "tension_damping": 0.0,
                "compression_damping": 0.0,
                "bending_damping": 0.0,
                "pin_stiffness": held * float(lengths.mean()) * hold**2,
                "goal_friction": 140.0 * held * hold,
            },
            "contact": {
                "collision_quality": self.collision_quality,
                "distance_min": self.radius / KEPT_DISTANCE_SHARE - COLLIDER_THICKNESS,
                "use_self_collision": self.self_collision,
                "self_distance_min": min(self.self_radius, MAX_SELF_DISTANCE * float(lengths.mean())),
                "self_friction": 100.0 * fabric.friction,
            },
        }


@cache
def find_blender() -> Blender:
    """Find the Blender that the environment names, with settings that were measured.

    Raises InputError if the variable is not set or names nothing that runs, a Python without bpy, or another
    Blender than BLENDER_SERIES.
    """
    python = os.environ.get(PYTHON_VARIABLE, "")
    wanted = f"a Python in which `import bpy` works (bpy {BLENDER_SERIES})"
    if not python:
        raise InputError(
            f"simulating with Blender needs the environment variable {PYTHON_VARIABLE}: {wanted}"
        )
    command = [python, "-c", "import bpy; print(bpy.app.version_string)"]
    try:
        answer = subprocess.run(
            command, capture_output=True, encoding="utf-8", errors="replace", env=_environment(), check=False
        )
    except OSError as error:
        raise InputError(
            f"{PYTHON_VARIABLE}={python}: cannot be run ({error.strerror}), expected {wanted}"
        ) from error
    if answer.returncode:
        raise InputError(f"{PYTHON_VARIABLE}={python}: {_last_line(answer.stderr)}, expected {wanted}")
    version = _last_line(answer.stdout).removesuffix(" LTS")
    if not version.startswith(f"{BLENDER_SERIES}."):
        raise InputError(f"{PYTHON_VARIABLE}={python}: has Blender {version}, expected {BLENDER_SERIES}")
    return Blender(python, version)


def _arrays(scene: Scene) -> dict[str, np.ndarray]:
    """Arrays for the worker. free: (N,) bool, touches no part. pressed: (N,) bool, not kept off cloth."""
    arrays = {
        "skinned": scene.skinned.numpy(),
        "faces": scene.faces.numpy(),
        "band": scene.band.numpy(),
        "free": ~scene.touches.any(0).numpy(),
        "pressed": _pressed(scene).numpy(),
    }
    for index, faces in enumerate(_reachable(scene)):
        used, corners = faces.unique(return_inverse=True)
        arrays[f"part{index}"] = scene.collider[:, used].numpy()
        arrays[f"part{index}_faces"] = corners.numpy()
    return arrays


def _reachable(scene: Scene) -> list[Tensor]:
    """Faces (F, 3) of each part whose nearest cloth at rest may touch the part.

    Otherwise arm and torso both push the cloth between them: caps reach out of the part next to them, and in
    the armpit each has faces beside the other's cloth.
    """
    from scipy.spatial import KDTree

    reachable = []
    for faces, touches in zip(scene.collider_parts, scene.touches, strict=True):
        if not len(faces) or not touches.any():
            continue
        if touches.all():
            reachable.append(faces)
            continue
        middles = scene.collider[0, faces].mean(1).numpy()
        near = KDTree(scene.rest[touches].numpy()).query(middles)[0]
        other = KDTree(scene.rest[~touches].numpy()).query(middles)[0]
        reachable.append(faces[torch.from_numpy(near + FACE_MARGIN < other)])
    return [faces for faces in reachable if len(faces)]


def _pressed(scene: Scene) -> Tensor:
    """Mask (N,) of vertices beside a part that they may not touch: arm and torso press cloth on cloth.

    Kept apart by self-collision, the two layers would be pushed into the body.
    """
    from scipy.spatial import KDTree

    pressed = torch.zeros(len(scene.rest), dtype=torch.bool)
    for faces, touches in zip(scene.collider_parts, scene.touches, strict=True):
        if len(faces) and touches.any():
            part = KDTree(scene.collider[0, faces.unique()].numpy())
            pressed |= torch.from_numpy(part.query(scene.rest.numpy())[0] < PRESSED_DISTANCE) & ~touches
    return pressed


def _frames(python: str, scene: Path, frames: int, count: int) -> Iterator[Tensor]:
    """Yield the frames (N, 3) m of a scene file as Blender makes them."""
    size = 12 * count
    with (
        scene.with_name("stderr.txt").open("w+", encoding="utf-8", errors="replace") as log,
        subprocess.Popen(
            [python, str(WORKER), str(scene)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=log,
            env=_environment(),
        ) as process,
    ):
        assert process.stdout is not None
        try:
            for frame in range(frames):
                data = process.stdout.read(size)
                if len(data) < size:
                    log.seek(0)
                    reason = _last_line(log.read())
                    raise InputError(f"{python}: Blender ended at frame {frame} of {frames} ({reason})")
                yield torch.from_numpy(np.frombuffer(data, "<f4").reshape(count, 3).copy())
        finally:
            process.kill()


def _environment() -> dict[str, str]:
    """Environment of this process without the variables that lead Blender's Python to our packages."""
    return {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1] if lines else "it says nothing"
