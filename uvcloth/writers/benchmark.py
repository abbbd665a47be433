"""The benchmark for other programs: body, motion, garments and truth of unseen windows as USD and Alembic."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from rich.progress import track

from uvcloth.bodies.body import Body
from uvcloth.dataset.bodies import require_joints, sequence_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import load_simulated, read_metadata
from uvcloth.dataset.reader import labelled
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write, make_folder
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.index import INDEX, Entry, read_index
from uvcloth.writers.obj import save_obj
from uvcloth.writers.writer import open_writer

UNSEEN = ("validation", "test")
"""Splits that are written; without an index every sequence is."""

MOVING = {"usd": ".usdc", "alembic": ".abc"}
"""Suffixes of the files over time, by folder."""

REST = "rest"
"""Folder of the garments at rest on the body's rest pose."""

TABLE = "sequences.csv"
"""Name of the table of sequences."""


def export_benchmark(folder: Path, out: Path) -> int:
    """Write the unseen sequences of a data folder; returns their number.

    OUT/usd/CLIP_GARMENT.usdc and OUT/alembic/CLIP_GARMENT.abc hold body and garment over all frames, warm-up
    included; OUT/rest/CLIP_GARMENT.obj the garment at rest; OUT/sequences.csv a row for each. Raises
    InputError for a damaged sequence, for a missing body, and if there is no sequence or a file cannot be
    written.
    """
    index = read_index(folder / INDEX) if (folder / INDEX).is_file() else {}
    paths = [path for path in sorted(folder.glob("*.npz")) if _is_unseen(path, index)]
    if not paths:
        raise InputError(f"{folder}: holds no sequence for {' or '.join(UNSEEN)}")
    bodies: dict[str, Body] = {}
    rows = []
    for path in track(paths, "writing sequences", transient=True):
        clip = labelled(load_simulated(path), index)
        body = sequence_body(path, clip.metadata, bodies)
        require_joints(path, clip, body)
        _write(clip, body, path.stem, out)
        rows.append(_row(clip, path.stem))
    with atomic_write(out / TABLE) as partial, partial.open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    return len(rows)


def _is_unseen(path: Path, index: Mapping[str, Entry]) -> bool:
    """True for a sequence of one of UNSEEN, and where its split is not known."""
    metadata = read_metadata(path)
    if "split" in metadata or not index:
        return metadata.get("split", "test") in UNSEEN
    return metadata["clip"] in index and index[metadata["clip"]].split in UNSEEN


def _write(clip: SimulatedClip, body: Body, stem: str, out: Path) -> None:
    (garment,) = clip.garments
    none = torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64)
    mesh = Mesh(garment.rest, garment.faces, *none)
    make_folder(out / REST)
    save_obj(mesh, out / REST / f"{stem}.obj")
    for kind, suffix in MOVING.items():
        make_folder(out / kind)
        with open_writer(out / kind / f"{stem}{suffix}", [(garment.name, mesh)], body, clip.fps) as writer:
            writer.add([garment.vertices], clip.transforms)


def _row(clip: SimulatedClip, stem: str) -> dict[str, Any]:
    """The row of a sequence. layers: the garments simulated with it, innermost first. warm_up: frames."""
    return {
        "sequence": stem,
        "clip": clip.name,
        "garment": clip.garments[0].name,
        "layers": " ".join(clip.layers),
        "split": clip.split,
        "subject": clip.subject,
        "action": clip.action,
        "body": str(clip.metadata.get("body", "")),
        "frames": len(clip.transforms),
        "warm_up": clip.warm_up,
        "fps": clip.fps,
    }
