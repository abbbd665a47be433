"""Packed sequences: a data folder at a small part of its size, for storage and transfer.

The motion is kept once for all garments of a clip, the mesh of a garment once for all clips, and the cloth,
in axes that move with the bones, as `formats.spectral` codes it: in steps as coarse as an error allows.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.difference import save_difference
from uvcloth.dataset.bodies import keep_body, sequence_body
from uvcloth.dataset.bone_axes import moved_by_bones, seen_from_bones
from uvcloth.dataset.clip import SimulatedClip, SimulatedGarment, clip_of_garment, flat_metadata
from uvcloth.dataset.clip_file import load_simulated, parse_metadata, save_simulated
from uvcloth.dataset.folder import (
    MESHES,
    REFUSED,
    data_folders,
    keep_index,
    keep_refused,
    refused_captures,
    usual_folder,
)
from uvcloth.dataset.packed_motion import NAME_LENGTH, PackedMotion, keep_motion, load_motion
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays, smallest_indices
from uvcloth.files.atomic import make_folder, sole_writer
from uvcloth.files.fields import check_fields, flags, indices, numbers, require_file_name, text, whole
from uvcloth.files.json_file import parse_json, require_kinds
from uvcloth.formats.spectral import (
    MOST_POINTS,
    CodedPoints,
    Patch,
    code_points,
    decode_points,
    part_spectra,
    second_half,
)
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.index import INDEX

PACKED_FORMAT = "uvcloth-packed-2"
MESH_FORMAT = "uvcloth-mesh-2"

EXPECTED = "a sequence packed by `uvcloth data --pack`"
EXPECTED_MESH = "the mesh of a garment beside packed sequences"

MEAN_ERROR = 0.001
"""Default mean error of unpacked vertices, m."""

ERROR_RANGE = 1e-5, 0.1
"""Range of the mean error, m, of options and files."""

MESHES_AT_ONCE = 8
"""Garments whose spectra are kept in memory, tens of megabytes each; a random outfit has one sequence."""

MOTIONS_AT_ONCE = 8

PROBES = 8
"""Number of points of the middle frame that check whether a sequence unpacks correctly."""

MOST_STEP = 10.0
"""Largest step of a coefficient in a file, m."""

FIELDS = {
    "cloth": whole("B", most=255, dtype=np.uint8),
    "probes": numbers(PROBES, 3),
    "gaps": whole("R").if_there(),
    "corrections": whole("R", 3, least=-(2**31), most=2**31).if_there(),
    "description": text(),
}
"""Arrays of a packed sequence: the output of `formats.spectral.code_points`, probes in the axes of the bones,
and JSON: the sequence's own metadata, the name of its motion, the step and the mean error in metres."""

DESCRIPTION = {"motion": str, "step": float, "error": float, "metadata": dict}

MESH_FIELDS = {"faces": indices("M", 3, of="N"), "rest": numbers("N", 3), "second": flags("N")}
"""Arrays of a garment's mesh; second: whether a vertex is in the second half of the mesh."""


@dataclass(frozen=True)
class GarmentMesh:
    """Mesh that all sequences of a garment share: faces (M, 3), rest (N, 3) m, the spectra of its halves."""

    faces: Tensor
    rest: Tensor
    parts: tuple[Patch, ...]


class PackedFolder:
    """Bodies, meshes and motions that the sequences of a packed folder share; recent ones stay in memory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bodies: dict[str, Body] = {}
        self.mesh: Callable[[str], GarmentMesh] = lru_cache(MESHES_AT_ONCE)(self._mesh)
        self._motion = lru_cache(MOTIONS_AT_ONCE)(self._load_motion)

    def motion(self, name: str, body: str) -> PackedMotion:
        """A motion of the folder by its name, of a body of `bodies`."""
        return self._motion(name, body)

    def _mesh(self, garment: str) -> GarmentMesh:
        return load_mesh(self.folder, garment)

    def _load_motion(self, name: str, body: str) -> PackedMotion:
        return load_motion(self.folder, name, self.bodies[body].skeleton)


def pack_folder(folder: Path, out: Path, error: float = MEAN_ERROR) -> int:
    """Pack the sequences of a data folder, and of those in it, that are not packed; return how many.

    Bodies and indices are kept too. An ensemble's members share the meshes and motions of its usual
    simulations.

    error: largest mean error of the vertices of a sequence, m; the limits for 99 % and for all vertices are
    those of `formats.spectral`. Refused sequences are left out. Raises InputError for an error out of
    ERROR_RANGE, for a folder without sequences, for sequences on a body that the folder lacks, or of one
    garment with two meshes, and where OUT has another index.
    """
    if not ERROR_RANGE[0] <= error <= ERROR_RANGE[1]:
        least, most = (1e3 * end for end in ERROR_RANGE)
        raise InputError(f"--error {1e3 * error:g}: expected {least:g} to {most:g} mm")
    parts = _data_folders(folder, out, "made by `uvcloth simulate`")
    return sum(_pack(part, out / part.relative_to(folder), error) for part in parts)


def _pack(folder: Path, out: Path, error: float) -> int:
    """Pack the sequences of one data folder."""
    shared = PackedFolder(usual_folder(out))
    known: dict[str, Body] = {}

    def convert(path: Path) -> None:
        clip = load_simulated(path)
        (garment,) = clip.garments
        body = sequence_body(path, clip.metadata, known)
        keep_body(body, out, save_difference)
        _keep_mesh(garment, shared.folder, path)
        mesh = shared.mesh(garment.name)
        if not (torch.equal(mesh.faces, garment.faces) and torch.equal(mesh.rest, garment.rest)):
            raise InputError(
                f"{path}: {garment.name} has another mesh there than in {shared.folder / MESHES}"
            )
        save_packed(clip, mesh, body.skeleton, shared.folder, out / path.name, error)

    return _convert(folder, out, convert, "packing")


def unpack_folder(folder: Path, out: Path) -> int:
    """Unpack the sequences of a packed folder, and of those in it, that are not there; return how many.

    Bodies and indices are written too.

    Raises InputError for a folder without sequences, for files that are not packed sequences, for a body that
    the folder lacks, and where OUT has another index.
    """
    parts = _data_folders(folder, out, "packed by `uvcloth data --pack`")
    return sum(_unpack(part, out / part.relative_to(folder)) for part in parts)


def _unpack(folder: Path, out: Path) -> int:
    """Unpack the sequences of one packed folder."""
    shared = PackedFolder(usual_folder(folder))

    def convert(path: Path) -> None:
        clip = load_packed(path, shared)
        keep_body(sequence_body(path, clip.metadata, shared.bodies), out)
        save_simulated(clip, out / path.name)

    return _convert(folder, out, convert, "unpacking")


def _convert(folder: Path, out: Path, convert: Callable[[Path], None], what: str) -> int:
    """Convert the files that are not in OUT yet, and copy the tables; returns the number of files."""
    with sole_writer(out):
        if (folder / INDEX).is_file():
            keep_index(folder / INDEX, out / INDEX)
        if (folder / REFUSED).is_file():
            keep_refused(refused_captures(folder), out)
        todo = [path for path in sorted(folder.glob("*.npz")) if not (out / path.name).exists()]
        # The first sequence of a garment takes half a minute: its name is shown, and the spinner turns.
        columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
        with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task(what, total=len(todo))
            for path in todo:
                progress.update(task, description=f"{what} {escape(path.stem)}")
                convert(path)
                progress.advance(task)
    return len(todo)


def save_packed(
    clip: SimulatedClip, mesh: GarmentMesh, skeleton: Skeleton, folder: Path, path: Path, error: float
) -> None:
    """Write the packed clip of one garment and, into a packed folder that lacks it, its motion.

    error: see `pack_folder`.

    Raises InputError if it is too far from the origin to be packed.
    """
    (garment,) = clip.garments
    try:
        motion = keep_motion(clip, skeleton, folder)
        # Of the motion as unpacked, so that packing and unpacking use the same axes.
        transforms = load_motion(folder, motion, skeleton).transforms
        local = seen_from_bones(garment.vertices, mesh.rest, skeleton, transforms).numpy()
        cloth = code_points(local, mesh.parts, error)
    except ValueError as fault:
        raise InputError(f"{path.name}: cannot be packed, its {fault}") from fault
    unpacked = decode_points(cloth, mesh.parts, error, *local.shape[:2])
    metadata = {
        key: value
        for key, value in flat_metadata(clip, garment).items()
        if key not in ("hash", "scored_frames")
    }
    description = {"motion": motion, "step": cloth.step, "error": error, "metadata": metadata}
    arrays = {
        "format": np.array(PACKED_FORMAT),
        "cloth": cloth.code,
        "probes": _probes(unpacked).astype(np.float32),
        "description": np.array(json.dumps(description)),
    }
    if len(cloth.gaps):
        least = np.min_scalar_type(-int(np.abs(cloth.corrections).max()) - 1)
        arrays |= {"gaps": smallest_indices(cloth.gaps), "corrections": cloth.corrections.astype(least)}
    save_arrays(path, arrays)


def load_packed(path: Path, shared: PackedFolder) -> SimulatedClip:
    """Read a packed sequence; shared: of the folder in which it lies, or of the ensemble's usual simulations.

    Raises InputError naming the file if it is not a packed sequence, has a body that its folder lacks or
    another mesh, or does not unpack to the packed data.
    """
    data = check_fields(path, load_arrays(path, PACKED_FORMAT, EXPECTED), FIELDS)
    description = _description(path, str(data["description"]))
    metadata, error = description["metadata"], description["error"]
    body = sequence_body(path, metadata, shared.bodies)
    mesh = shared.mesh(metadata["garment"])
    motion = shared.motion(description["motion"], str(metadata.get("body", "")))
    coded = CodedPoints(
        description["step"],
        data["cloth"],
        data.get("gaps", np.zeros(0, np.int64)),
        data.get("corrections", np.zeros((0, 3), np.int64)),
    )
    try:
        local = decode_points(coded, mesh.parts, error, len(motion.transforms), len(mesh.rest))
    except ValueError as fault:
        raise InputError(f"{path}: its {fault}: the file, its mesh or its motion was replaced") from fault
    if not np.abs(_probes(local) - data["probes"]).max() < error:
        raise InputError(
            f"{path}: does not unpack to the data that was packed: the file or its mesh was replaced"
        )
    vertices = moved_by_bones(torch.from_numpy(local), mesh.rest, body.skeleton, motion.transforms)
    return clip_of_garment(
        vertices=vertices.float(),
        faces=mesh.faces,
        rest=mesh.rest,
        transforms=motion.transforms,
        fps=motion.fps,
        warm_up=motion.warm_up,
        metadata=metadata | {"packed_error": error},
    )


def load_mesh(folder: Path, garment: str) -> GarmentMesh:
    """Read the mesh of a garment of a packed folder and compute the spectra of its halves.

    Raises InputError if it is not valid, or has more points than a spectrum can have.
    """
    path = folder / MESHES / f"{garment}.npz"
    data = check_fields(path, load_arrays(path, MESH_FORMAT, EXPECTED_MESH), MESH_FIELDS)
    faces, rest = data["faces"], data["rest"]
    if not 0 < len(rest) <= MOST_POINTS:
        raise InputError(f"{path}: has {len(rest)} vertices, expected 1 to {MOST_POINTS}")
    return GarmentMesh(torch.from_numpy(faces), torch.from_numpy(rest), part_spectra(faces, data["second"]))


def _description(path: Path, content: str) -> dict:
    """Description that a packed sequence gives of itself; raises InputError naming the file for others."""
    what = f"{path}: the description"
    description = parse_json(content, what, "that of a packed sequence")
    require_kinds(description, DESCRIPTION, what)
    for name, least, most in (("step", 0.0, MOST_STEP), ("error", *ERROR_RANGE)):
        if not least <= description[name] <= most:
            raise InputError(f"{what} has the {name} {description[name]}, expected {least:g} to {most:g} m")
    name = description["motion"]
    if len(name) != NAME_LENGTH or not set(name) <= set("0123456789abcdef"):
        raise InputError(f"{what} names the motion {name!r:.40}, expected {NAME_LENGTH} hexadecimal digits")
    return description | {"metadata": parse_metadata(path, json.dumps(description["metadata"]))}


def _keep_mesh(garment: SimulatedGarment, out: Path, path: Path) -> None:
    """Write the mesh of a garment's sequences into a packed folder where it is not yet."""
    kept = out / MESHES / f"{garment.name}.npz"
    require_file_name(kept.name, path)
    if not kept.exists():
        if len(garment.rest) > MOST_POINTS:
            raise InputError(f"{path}: has {len(garment.rest)} vertices, {MOST_POINTS} at most can be packed")
        make_folder(kept.parent)
        faces, rest = garment.faces.numpy(), garment.rest.numpy().astype(np.float32)
        arrays = {"faces": smallest_indices(faces), "rest": rest, "second": second_half(faces, len(rest))}
        save_arrays(kept, {"format": np.array(MESH_FORMAT), **arrays})


def _probes(points: np.ndarray) -> np.ndarray:
    """Some points (PROBES, 3) of the middle one of frames (F, N, 3)."""
    rows = np.linspace(0, points.shape[1] - 1, PROBES).round().astype(np.int64)
    return points[len(points) // 2, rows]


def _data_folders(folder: Path, out: Path, made: str) -> list[Path]:
    """Folders of sequences in a folder, except OUT, which may lie in it. Raises InputError without any."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder, expected one {made}")
    if out.resolve() == folder.resolve():
        raise InputError(f"{out}: is the input folder itself, name another output folder")
    parts = data_folders(folder)
    if out.resolve().is_relative_to(folder.resolve()):
        parts = [part for part in parts if not part.resolve().is_relative_to(out.resolve())]
    if not parts:
        raise InputError(f"{folder}: no sequence (*.npz) {made} in this folder")
    return parts
