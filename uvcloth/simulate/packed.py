"""Packed sequences: a data folder at a tenth of its size, to be kept or passed on, and unpacked again.

The motion is kept as rotations and the path of the root, the cloth in the axes of the root joint as
`rasterize.spectral` has it: most vertices are within a millimetre of what was simulated. The mesh of a
garment is kept once for all clips.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor

from rasterize.archive import load_arrays, save_arrays
from rasterize.atomic import make_folder, sole_writer
from rasterize.errors import InputError
from rasterize.fields import check_fields, indices, numbers, require_file_name, text, whole
from rasterize.spectral import (
    MOST_POINTS,
    PLANES,
    STEP,
    compress,
    decompress,
    from_planes,
    mesh_spectrum,
    to_planes,
)
from uvcloth.bodies.body import Body
from uvcloth.geometry.rotations import are_unit, from_quaternions, rotate, to_quaternions
from uvcloth.geometry.skeleton import Skeleton, joint_transforms
from uvcloth.geometry.skinning import seen_from_root
from uvcloth.motion.clip import FPS_RANGE
from uvcloth.motion.index import INDEX
from uvcloth.simulate.bodies import keep_body, sequence_body
from uvcloth.simulate.folder import REFUSED, keep_index, keep_refused, refused_captures
from uvcloth.simulate.sequence import (
    SimulatedSequence,
    load_sequence,
    parse_metadata,
    save_sequence,
)

PACKED_FORMAT = "uvcloth-packed-1"
MESH_FORMAT = "uvcloth-mesh-1"
MESHES = "meshes"
"""Folder, in a packed one, of the garments' meshes."""

EXPECTED = "a sequence packed by `uvcloth data --pack`"
EXPECTED_MESH = "the mesh of a garment beside packed sequences"

MOTION_STEP = 5e-5
"""Metres, and half radians, of a step of the motion."""

MESHES_AT_ONCE = 8
"""Garments whose spectra are kept in memory, tens of megabytes each; made outfits have one sequence each."""

PROBES = 8
"""Points of the middle frame that tell whether a sequence unpacks to what was packed."""

FIELDS = {
    "motion": whole(PLANES, "F", "K", most=255, dtype=np.uint8),
    "cloth": whole(PLANES, "N", 3, "F", most=255, dtype=np.uint8),
    "probes": numbers(PROBES, 3),
    "fps": numbers(least=FPS_RANGE[0], most=FPS_RANGE[1], dtype=np.float64),
    "warm_up": indices(of="F"),
    "metadata": text(),
}
"""Arrays of a packed sequence of F frames and N vertices. motion: second differences in time of K numbers,
the quaternions of all joints and the place of the root, in steps; cloth as `rasterize.spectral` has it."""

MESH_FIELDS = {"faces": indices("M", 3, of="N"), "rest": numbers("N", 3)}


@dataclass(frozen=True)
class GarmentMesh:
    """Mesh that all sequences of a garment share: faces (M, 3), rest (N, 3) m, and its spectrum (N, N)."""

    faces: Tensor
    rest: Tensor
    spectrum: np.ndarray


def pack_folder(folder: Path, out: Path) -> int:
    """Pack the sequences of a data folder that are not packed yet, its body and its index; return how many.

    Second simulations and refused sequences are left out. Raises InputError for a folder without sequences,
    for sequences on a body that the folder lacks, or of one garment with two meshes, and where OUT has
    another index.
    """
    paths = _sequences(folder, "made by `uvcloth simulate`")
    mesh_of = lru_cache(MESHES_AT_ONCE)(partial(load_mesh, out))
    known: dict[str, Body] = {}

    def convert(path: Path) -> None:
        sequence = load_sequence(path)
        body = sequence_body(path, sequence.metadata, known)
        keep_body(body, out)
        _keep_mesh(sequence, out, path)
        mesh = mesh_of(sequence.garment)
        if not (torch.equal(mesh.faces, sequence.faces) and torch.equal(mesh.rest, sequence.rest)):
            raise InputError(f"{path}: {sequence.garment} has another mesh there than in {out / MESHES}")
        save_packed(sequence, mesh, body.skeleton, out / path.name)

    return _convert(paths, folder, out, convert, "packing")


def unpack_folder(folder: Path, out: Path) -> int:
    """Unpack the sequences of a packed folder that are not there, its body and its index; return how many.

    Raises InputError for a folder without sequences, files that are none, on a body that the folder lacks,
    and where OUT has another index.
    """
    paths = _sequences(folder, "packed by `uvcloth data --pack`")
    mesh_of = lru_cache(MESHES_AT_ONCE)(partial(load_mesh, folder))
    known: dict[str, Body] = {}

    def convert(path: Path) -> None:
        sequence = load_packed(path, mesh_of, known)
        keep_body(sequence_body(path, sequence.metadata, known), out)
        save_sequence(sequence, out / path.name)

    return _convert(paths, folder, out, convert, "unpacking")


def _convert(
    paths: Sequence[Path], folder: Path, out: Path, convert: Callable[[Path], None], what: str
) -> int:
    """Convert what is not in OUT yet, beside the folder's tables; returns the number of files."""
    if out.resolve() == folder.resolve():
        raise InputError(f"{out}: is the folder itself, name another one")
    with sole_writer(out):
        if (folder / INDEX).is_file():
            keep_index(folder / INDEX, out / INDEX)
        if (folder / REFUSED).is_file():
            keep_refused(refused_captures(folder), out)
        todo = [path for path in paths if not (out / path.name).exists()]
        for path in track(todo, what, console=Console(stderr=True), transient=True):
            convert(path)
    return len(todo)


def save_packed(sequence: SimulatedSequence, mesh: GarmentMesh, skeleton: Skeleton, path: Path) -> None:
    """Write a packed sequence. Raises InputError if it is too far from the origin to be packed."""
    try:
        motion = to_planes(_differences(sequence.transforms, skeleton))
        # The cloth is packed in axes that unpacking finds again.
        quaternions, places = _motion(motion)
        transforms = joint_transforms(skeleton, from_quaternions(quaternions), places)
        cloth = compress(seen_from_root(sequence.vertices.double(), transforms).numpy(), mesh.spectrum)
    except ValueError as error:
        raise InputError(f"{path.name}: cannot be packed, its {error}") from error
    metadata = {
        key: value for key, value in sequence.metadata.items() if key not in ("hash", "scored_frames")
    }
    save_arrays(
        path,
        {
            "format": np.array(PACKED_FORMAT),
            "motion": motion,
            "cloth": cloth,
            "probes": _probes(decompress(cloth, mesh.spectrum)).astype(np.float32),
            "fps": np.array(sequence.fps, dtype=np.float64),
            "warm_up": np.array(sequence.warm_up, dtype=np.int64),
            "metadata": np.array(json.dumps(metadata | {"packed_step": STEP})),
        },
    )


def load_packed(
    path: Path, mesh_of: Callable[[str], GarmentMesh], known: dict[str, Body]
) -> SimulatedSequence:
    """Read a packed sequence; mesh_of: gives a garment's mesh by its name; known: see `sequence_body`.

    Raises InputError naming the file if it is none, on a body that its folder lacks, of another mesh, or does
    not unpack to what was packed.
    """
    data = check_fields(path, load_arrays(path, PACKED_FORMAT, EXPECTED), FIELDS)
    metadata = parse_metadata(path, str(data["metadata"]))
    body = sequence_body(path, metadata, known)
    mesh = mesh_of(metadata["garment"])
    joints, points = len(body.skeleton.names), data["cloth"].shape[1]
    if data["motion"].shape[2] != 4 * joints + 3:
        raise InputError(f"{path}: its motion is not of the {joints} joints of body {body.name}")
    if points != len(mesh.rest):
        raise InputError(f"{path}: has {points} points, the mesh of {metadata['garment']} {len(mesh.rest)}")
    quaternions, places = _motion(data["motion"])
    if not are_unit(quaternions):
        raise InputError(f"{path}: its motion has a rotation that is none")
    transforms = joint_transforms(body.skeleton, from_quaternions(quaternions), places).float()
    seen = decompress(data["cloth"], mesh.spectrum)
    if not np.abs(_probes(seen) - data["probes"]).max() < STEP:
        raise InputError(f"{path}: does not unpack to what was packed, its mesh or the file is another")
    root = transforms[:, None, 0].double()
    vertices = rotate(root[..., :3], torch.from_numpy(seen)) + root[..., 3]
    return SimulatedSequence(
        vertices=vertices.float(),
        faces=mesh.faces,
        rest=mesh.rest,
        transforms=transforms,
        fps=float(data["fps"]),
        warm_up=int(data["warm_up"]),
        metadata=metadata,
    )


def load_mesh(folder: Path, garment: str) -> GarmentMesh:
    """Read the mesh of a garment of a packed folder and work out its spectrum.

    Raises InputError if it is none, or has more points than a spectrum.
    """
    path = folder / MESHES / f"{garment}.npz"
    data = check_fields(path, load_arrays(path, MESH_FORMAT, EXPECTED_MESH), MESH_FIELDS)
    faces, rest = data["faces"], data["rest"]
    if len(rest) > MOST_POINTS:
        raise InputError(f"{path}: has {len(rest)} vertices, expected {MOST_POINTS} at most")
    return GarmentMesh(torch.from_numpy(faces), torch.from_numpy(rest), mesh_spectrum(faces, len(rest)))


def _keep_mesh(sequence: SimulatedSequence, out: Path, path: Path) -> None:
    """Write the mesh of a garment's sequences into a packed folder where it is not yet."""
    kept = out / MESHES / f"{sequence.garment}.npz"
    require_file_name(kept.name, path)
    if not kept.exists():
        if len(sequence.rest) > MOST_POINTS:
            raise InputError(
                f"{path}: has {len(sequence.rest)} vertices, {MOST_POINTS} at most can be packed"
            )
        make_folder(kept.parent)
        faces, rest = sequence.faces.numpy().astype(np.int32), sequence.rest.numpy().astype(np.float32)
        save_arrays(kept, {"format": np.array(MESH_FORMAT), "faces": faces, "rest": rest})


def _differences(transforms: Tensor, skeleton: Skeleton) -> np.ndarray:
    """Second differences in time (F, 4 J + 3) of the joints' quaternions and the root's place, in steps."""
    quaternions = to_quaternions(transforms[..., :3].double())
    # Of q and -q, the same rotation, the one that is nearer to that of the frame before.
    turns = (quaternions[1:] * quaternions[:-1]).sum(-1, keepdim=True)
    quaternions[1:] *= torch.where(turns < 0.0, -1.0, 1.0).cumprod(0)
    root = transforms[:, 0].double()
    places = (root[..., :3] @ skeleton.heads[0].double()[:, None]).squeeze(-1) + root[..., 3]
    numbers = torch.cat([quaternions.flatten(1), places], dim=1).numpy()
    steps = np.rint(numbers / MOTION_STEP).astype(np.int64)
    for _ in range(2):
        steps[1:] = np.diff(steps, axis=0)
    return steps


def _motion(planes: np.ndarray) -> tuple[Tensor, Tensor]:
    """Quaternions (F, J, 4) and places (F, 3) m of packed second differences."""
    numbers = torch.from_numpy(from_planes(planes).cumsum(axis=0).cumsum(axis=0) * MOTION_STEP)
    return numbers[:, :-3].unflatten(1, (-1, 4)), numbers[:, -3:]


def _probes(points: np.ndarray) -> np.ndarray:
    """Some points (PROBES, 3) of the middle one of frames (F, N, 3)."""
    chosen = np.linspace(0, points.shape[1] - 1, PROBES).round().astype(np.int64)
    return points[len(points) // 2, chosen]


def _sequences(folder: Path, made: str) -> list[Path]:
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder, expected one {made}")
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise InputError(f"{folder}: no sequence (*.npz) {made} in this folder")
    return paths
