"""Reader of the first packed format, for the folders that were packed before there was a second one."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.fft import idct
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.dataset.bodies import sequence_body
from uvcloth.dataset.clip import SimulatedClip, clip_of_garment
from uvcloth.dataset.clip_file import parse_metadata
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays
from uvcloth.files.fields import check_fields, indices, numbers, text, whole
from uvcloth.formats.spectral import MOST_POINTS, mesh_spectrum
from uvcloth.geometry.rotations import are_unit, from_quaternions, rotate
from uvcloth.geometry.skeleton import joint_transforms
from uvcloth.motion.clip import FPS_RANGE

FIRST_FORMAT = "uvcloth-packed-1"
FIRST_MESH_FORMAT = "uvcloth-mesh-1"
MESHES = "meshes"

EXPECTED = "a sequence packed by `uvcloth data --pack`"
EXPECTED_MESH = "the mesh of a garment beside packed sequences"

PLANES = 3
"""Bytes of a number."""

STEP, MOTION_STEP = 0.003, 5e-5
"""Metres of a coefficient's step; metres, and half radians, of a step of the motion."""

PROBES = 8

FIELDS = {
    "motion": whole(PLANES, "F", "K", most=255, dtype=np.uint8),
    "cloth": whole(PLANES, "N", 3, "F", most=255, dtype=np.uint8),
    "probes": numbers(PROBES, 3),
    "fps": numbers(least=FPS_RANGE[0], most=FPS_RANGE[1], dtype=np.float64),
    "warm_up": indices(of="F"),
    "metadata": text(),
}
MESH_FIELDS = {"faces": indices("M", 3, of="N"), "rest": numbers("N", 3)}


@dataclass(frozen=True)
class FirstMesh:
    """Mesh that all sequences of a garment share: faces (M, 3), rest (N, 3) m, and its spectrum (N, N)."""

    faces: Tensor
    rest: Tensor
    spectrum: np.ndarray


def load_first(path: Path, mesh_of: Callable[[str], FirstMesh], known: dict[str, Body]) -> SimulatedClip:
    """Read a packed sequence; mesh_of: gives a garment's mesh by its name; known: see `sequence_body`.

    Raises InputError naming the file if it is none, on a body that its folder lacks, of another mesh, or does
    not unpack to what was packed.
    """
    data = check_fields(path, load_arrays(path, FIRST_FORMAT, EXPECTED), FIELDS)
    metadata = parse_metadata(path, str(data["metadata"]))
    body = sequence_body(path, metadata, known)
    mesh = mesh_of(metadata["garment"])
    joints, points = len(body.skeleton.names), data["cloth"].shape[1]
    if data["motion"].shape[2] != 4 * joints + 3:
        raise InputError(f"{path}: its motion does not have the {joints} joints of body {body.name}")
    if points != len(mesh.rest):
        raise InputError(f"{path}: has {points} points, the mesh of {metadata['garment']} {len(mesh.rest)}")
    numbers = torch.from_numpy(_whole(data["motion"]).cumsum(axis=0).cumsum(axis=0) * MOTION_STEP)
    quaternions, places = numbers[:, :-3].unflatten(1, (-1, 4)), numbers[:, -3:]
    if not are_unit(quaternions):
        raise InputError(f"{path}: a rotation of its motion is not a unit quaternion")
    transforms = joint_transforms(body.skeleton, from_quaternions(quaternions), places).float()
    in_time = mesh.spectrum @ (_whole(data["cloth"]).reshape(points, -1) * STEP)
    seen = idct(in_time.reshape(points, 3, -1), axis=2, norm="ortho").transpose(2, 0, 1)
    chosen = np.linspace(0, points - 1, PROBES).round().astype(np.int64)
    if not np.abs(seen[len(seen) // 2, chosen] - data["probes"]).max() < STEP:
        raise InputError(f"{path}: does not unpack to what was packed, its mesh or the file is another")
    root = transforms[:, None, 0].double()
    vertices = rotate(root[..., :3], torch.from_numpy(seen)) + root[..., 3]
    return clip_of_garment(
        vertices=vertices.float(),
        faces=mesh.faces,
        rest=mesh.rest,
        transforms=transforms,
        fps=float(data["fps"]),
        warm_up=int(data["warm_up"]),
        metadata=metadata,
    )


def load_first_mesh(folder: Path, garment: str) -> FirstMesh:
    """Read the mesh of a garment of a packed folder and work out its spectrum.

    Raises InputError if it is none, or has more points than a spectrum.
    """
    path = folder / MESHES / f"{garment}.npz"
    data = check_fields(path, load_arrays(path, FIRST_MESH_FORMAT, EXPECTED_MESH), MESH_FIELDS)
    faces, rest = data["faces"], data["rest"]
    if len(rest) > MOST_POINTS:
        raise InputError(f"{path}: has {len(rest)} vertices, expected {MOST_POINTS} at most")
    return FirstMesh(torch.from_numpy(faces), torch.from_numpy(rest), mesh_spectrum(faces, len(rest)))


def _whole(planes: np.ndarray) -> np.ndarray:
    """Whole numbers (...), int64, of bytes (PLANES, ...), low ones first, signs last."""
    signed = sum(plane.astype(np.int64) << 8 * place for place, plane in enumerate(planes))
    return (signed >> 1) ^ -(signed & 1)
