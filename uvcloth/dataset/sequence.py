"""Simulated sequences: one garment over one clip, and its file, the training data."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.fields import check_fields, indices, is_file_name, numbers, text
from uvcloth.files.json_file import parse_json, require_kinds
from uvcloth.formats.moving import load_moving, pack, unpack
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.motion.clip import FPS_RANGE

SEQUENCE_FORMAT = "uvcloth-sequence-3"
EXPECTED_FILE = (
    "a sequence that this version's `uvcloth simulate` made, simulate older ones again into a new folder, "
    "unpack packed ones with `uvcloth data DIR --unpack`"
)
FIELDS = {
    "faces": indices("M", 3, of="N"),
    "rest": numbers("N", 3),
    "transforms": numbers("F", "J", 3, 4),
    "fps": numbers(least=FPS_RANGE[0], most=FPS_RANGE[1], dtype=np.float64),
    "warm_up": indices(of="F"),
    "metadata": text(),
}
"""Arrays of a sequence's file besides the points; F frames, N vertices."""

METADATA = {
    **dict.fromkeys(("clip", "garment"), str),
    **dict.fromkeys(("body?", "body_hash?", "engine?", "hash?", "outfit?", "rejected?"), str),
    **dict.fromkeys(("types?", "versions?", "settings?"), dict),
    "wrong_side_percent?": {"*": float},
    "scored_frames?": int,
    "template?": (str, type(None)),
    "layers?": [str],
}
"""Kinds of the metadata that are read."""

FILE_NAMES = ("clip", "garment", "body", "outfit")
"""Metadata that are parts of the names of files."""

MOTION_TOLERANCE = 1e-3
"""Largest difference of joint transforms, metres or matrix entries, between sequences of one motion."""

REST_TOLERANCE = 0.002
"""Metres between a sequence's rest mesh and a garment on the body within which they are the same garment."""


@dataclass(frozen=True)
class SimulatedSequence:
    """One simulated garment over one clip.

    vertices: (F, N, 3) metres, world. faces: (M, 3). rest: (N, 3) m at rest on the body's rest pose. A file
    holds the vertices to within 0.05 mm (`uvcloth.formats.moving`), all else exactly.
    transforms: (F, J, 3, 4) joint transforms of the body, so that its vertices can be recomputed.
    warm_up: number of leading frames that only let the cloth settle and are never scored.
    metadata: JSON values: clip, garment (its name), template (whose motion it takes, or null), source
    ("template" or "file"), body, body_hash, engine, versions, settings, seed, and what
    `examine` measured; of garments that were simulated together also layers (their names, innermost first)
    and wrong_side_percent (by the name of each inner one). wall_seconds is in memory alone, as the same input
    is to give the same file. A file adds hash, that of what is read from it,
    and scored_frames, how many frames are scored.
    """

    vertices: Tensor
    faces: Tensor
    rest: Tensor
    transforms: Tensor
    fps: float
    warm_up: int
    metadata: dict[str, Any]

    @property
    def garment(self) -> str:
        """Name of the garment."""
        return str(self.metadata["garment"])

    @property
    def template(self) -> str | None:
        """Template whose motion the garment takes; files from before other garments do not say."""
        template = self.metadata.get("template", self.garment)
        return None if template is None else str(template)

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the garments that were simulated together, innermost first."""
        return tuple(self.metadata.get("layers", (self.garment,)))

    @property
    def clip(self) -> str:
        """Name of the clip."""
        return str(self.metadata["clip"])


def require_same_motion(sequences: Mapping[Path, SimulatedSequence], whole: str) -> None:
    """Raise InputError naming the first file whose body moves otherwise than that of the first one.

    whole: what the sequences, by their files, are parts of, in words.
    """
    (first_path, first), *others = sequences.items()
    for path, other in others:
        same = other.transforms.shape == first.transforms.shape and other.warm_up == first.warm_up
        if not same or (other.transforms - first.transforms).abs().max() > MOTION_TOLERANCE:
            raise InputError(f"{path}: has another body motion than {first_path.name} of the same {whole}")


def content_hash(sequence: SimulatedSequence) -> str:
    """SHA-256 over the simulated vertices and the motion: equal input and machine give an equal hash."""
    return fingerprint(sequence.vertices.float(), sequence.rest.float(), sequence.transforms.float())


def save_sequence(sequence: SimulatedSequence, path: Path) -> None:
    """Write a sequence to one compressed npz. Raises InputError if it cannot be written."""
    packed = pack(sequence.vertices.numpy(), sequence.faces.numpy())
    kept = replace(sequence, vertices=torch.from_numpy(unpack(**packed)))
    metadata = {
        **{key: value for key, value in sequence.metadata.items() if key != "wall_seconds"},
        "hash": content_hash(kept),
        "scored_frames": max(len(sequence.vertices) - sequence.warm_up, 0),
    }
    save_arrays(
        path,
        {
            "format": np.array(SEQUENCE_FORMAT),
            **packed,
            "faces": sequence.faces.numpy().astype(np.int32),
            "rest": sequence.rest.numpy().astype(np.float32),
            "transforms": sequence.transforms.numpy().astype(np.float32),
            "fps": np.array(sequence.fps, dtype=np.float64),
            "warm_up": np.array(sequence.warm_up, dtype=np.int64),
            "metadata": np.array(json.dumps(metadata)),
        },
    )


def load_sequence(path: Path) -> SimulatedSequence:
    """Read a sequence npz.

    Raises InputError naming the file, and the array, if it is not one, holds arrays that do not fit
    together, are out of range or not finite, or does not name clip and garment.
    """
    data = load_moving(path, SEQUENCE_FORMAT, EXPECTED_FILE, FIELDS)
    return SimulatedSequence(
        vertices=torch.from_numpy(data["vertices"]),
        faces=torch.from_numpy(data["faces"]),
        rest=torch.from_numpy(data["rest"]),
        transforms=torch.from_numpy(data["transforms"]),
        fps=float(data["fps"]),
        warm_up=int(data["warm_up"]),
        metadata=parse_metadata(path, str(data["metadata"])),
    )


def read_metadata(path: Path) -> dict[str, Any]:
    """Read the metadata of a sequence npz without its motion: quick.

    Raises InputError as `load_sequence` does.
    """
    arrays = load_arrays(path, SEQUENCE_FORMAT, EXPECTED_FILE, ("metadata",), only=True)
    data = check_fields(path, arrays, {"metadata": FIELDS["metadata"]})
    return parse_metadata(path, str(data["metadata"]))


def parse_metadata(path: Path, text: str) -> dict[str, Any]:
    """Read the metadata of a sequence from the text in its file. Raises InputError for others."""
    metadata = parse_json(text, f"{path}: the metadata", "those of a sequence")
    require_kinds(metadata, METADATA, f"{path}: the metadata")
    named = [metadata[name] for name in FILE_NAMES if name in metadata] + metadata.get("layers", [])
    wrong = [name for name in named if not is_file_name(name)]
    if wrong:
        raise InputError(
            f"{path}: the metadata names {wrong[0]!r:.40}, which cannot be part of a file's name"
        )
    return metadata
