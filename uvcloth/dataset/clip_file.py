"""Files of simulated clips: one for each garment, called a sequence."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from uvcloth.dataset.clip import SimulatedClip, clip_of_garment, content_hash, flat_metadata, join_clips
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.fields import check_fields, indices, is_file_name, numbers, text
from uvcloth.files.json_file import parse_json, require_kinds
from uvcloth.formats.moving import load_moving, pack, unpack
from uvcloth.motion.options import FPS_RANGE

SEQUENCE_FORMAT = "uvcloth-sequence-3"
EXPECTED_FILE = (
    "a sequence made by this version of `uvcloth simulate`; simulate older ones again into a new folder, and "
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
    "captured?": {"*": str},
    "scored_frames?": int,
    "template?": (str, type(None)),
    "layers?": [str],
}
"""Types of the metadata that are read."""

FILE_NAMES = ("clip", "garment", "body", "outfit")
"""Metadata that are parts of the names of files."""


def save_simulated(clip: SimulatedClip, *paths: Path) -> None:
    """Write a clip, each garment to a compressed npz of its own.

    A file holds the vertices to within 0.05 mm (`uvcloth.formats.moving`), all else exactly. Raises
    InputError if it cannot be written.
    """
    for garment, path in zip(clip.garments, paths, strict=True):
        packed = pack(garment.vertices.numpy(), garment.faces.numpy())
        kept = replace(garment, vertices=torch.from_numpy(unpack(**packed)))
        metadata = {
            **{key: value for key, value in flat_metadata(clip, garment).items() if key != "wall_seconds"},
            "hash": content_hash(kept, clip.transforms),
            "scored_frames": clip.scored_frames,
        }
        save_arrays(
            path,
            {
                "format": np.array(SEQUENCE_FORMAT),
                **packed,
                "faces": garment.faces.numpy().astype(np.int32),
                "rest": garment.rest.numpy().astype(np.float32),
                "transforms": clip.transforms.numpy().astype(np.float32),
                "fps": np.array(clip.fps, dtype=np.float64),
                "warm_up": np.array(clip.warm_up, dtype=np.int64),
                "metadata": np.array(json.dumps(metadata)),
            },
        )


def load_simulated(*paths: Path) -> SimulatedClip:
    """Read a clip from the files of its garments, the innermost first.

    Raises InputError naming the file, and the array, if it is not a sequence, holds arrays that do not fit
    together, are out of range or not finite, does not name clip and garment, or has another motion than the
    first file.
    """
    return join_clips({path: _load_garment(path) for path in paths}, "outfit")


def _load_garment(path: Path) -> SimulatedClip:
    data = load_moving(path, SEQUENCE_FORMAT, EXPECTED_FILE, FIELDS)
    metadata = parse_metadata(path, str(data["metadata"]))
    clip = clip_of_garment(
        vertices=torch.from_numpy(data["vertices"]),
        faces=torch.from_numpy(data["faces"]),
        rest=torch.from_numpy(data["rest"]),
        transforms=torch.from_numpy(data["transforms"]),
        fps=float(data["fps"]),
        warm_up=int(data["warm_up"]),
        metadata=metadata,
    )
    return replace(clip, files={path.name: str(metadata.get("hash", ""))})


def read_metadata(path: Path) -> dict[str, Any]:
    """Read the metadata of a sequence npz without its motion: quick.

    Raises InputError as `load_simulated` does.
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
