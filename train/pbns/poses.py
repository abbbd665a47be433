"""The poses to train on: a database from a file, or drawn from motion into the run's folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from rich.progress import track

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.checkpoint import TrainingData
from uvcloth.dataset.splits import TRAINING_SPLITS
from uvcloth.errors import InputError
from uvcloth.files.atomic import make_folder
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.motion.clip_splits import SplitClip, find_sources
from uvcloth.motion.draw_poses import draw_poses
from uvcloth.motion.poses import SPLITS, PoseDatabase, load_poses, save_poses
from uvcloth.motion.recombine import RECOMBINED, recombine
from uvcloth.physics.self_contact import SelfContact

POSES_FILE = "poses.npz"
"""The file of a run with the poses that were drawn for it."""


@dataclass(frozen=True)
class BodyPoses:
    """A database for one body; data: its file, and the clips of its training and validation poses."""

    database: PoseDatabase
    data: TrainingData


def poses_for(given: Sequence[str], body: Body, run: Path) -> BodyPoses:
    """Read the database of `given`, or draw one from its clips and folders into the run, once.

    Poses that were drawn for another shape of body and in which this one runs through itself are left out.
    Raises InputError as load_poses, find_sources, draw_poses and recombine do, and if the run holds poses of
    other clips. A run's clips, or the poses left, must be for training and for validation: InputError if not.
    """
    ready = len(given) == 1 and Path(given[0]).suffix == ".npz"
    path = Path(given[0]) if ready else run / POSES_FILE
    sources = [] if ready else find_sources(given)
    if not ready:
        _require_splits(f"--poses {' '.join(given)}", {source.split for source in sources}, "name more clips")
    if not ready and not path.exists():
        make_folder(run)
        clear = SelfContact(body).clear
        save_poses(recombine(draw_poses(sources, body, clear), body, clear, RECOMBINED), path)
    database = load_poses(path, body)
    if not ready and not _drawn_from(database, sources):
        raise InputError(f"{path}: was drawn from other clips or splits; name them again, or another folder")
    # What is no longer valid here may still be part of a recombined pose: the clips are those of the file.
    data = TrainingData(
        files={path.name: fingerprint(path.read_bytes())},
        clips={split: database.clips_of(split) for split in TRAINING_SPLITS},
    )
    if database.body_hash != body.identity.shape:
        database = _valid_for(body, database)
    _require_splits(
        str(path), {SPLITS[split] for split in database.splits.unique()}, "draw them from more clips"
    )
    return BodyPoses(database, data)


def _drawn_from(database: PoseDatabase, sources: Sequence[SplitClip]) -> bool:
    """True if a database has the clips and splits of the sources."""
    same = database.clip_names == tuple(source.name for source in sources)
    if not same or database.subjects != tuple(source.subject for source in sources):
        return False
    splits = torch.tensor([SPLITS.index(source.split) for source in sources])
    return torch.equal(splits[database.clips], database.splits)


def _require_splits(where: str, splits: set[str], advice: str) -> None:
    """Raise InputError unless there are training and validation poses."""
    if not set(TRAINING_SPLITS) <= splits:
        raise InputError(f"{where}: lacks training or validation poses, {advice}")


def _valid_for(body: Body, database: PoseDatabase) -> PoseDatabase:
    """The poses in which a body does not run through itself."""
    valid = SelfContact(body).clear
    posed = track(database.transforms(body.skeleton), f"poses of {database.body_name} on {body.name}")
    clear = [valid(posed_skin(body, transforms[None])[0]) for transforms in posed]
    return database.select(torch.nonzero(torch.tensor(clear)).squeeze(1))
