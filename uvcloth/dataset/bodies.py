"""Bodies of a data folder: each is stored with its sequences, so that no option has to name it."""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from uvcloth.bodies.body import Body, load_body, save_body
from uvcloth.bodies.difference import load_kept_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import read_metadata
from uvcloth.errors import InputError
from uvcloth.files.atomic import make_folder
from uvcloth.files.fields import require_file_name

BODIES = "bodies"
"""Folder, in a data folder, of the bodies of its sequences, except the one of the package."""


def keep_body(body: Body, folder: Path, save: Callable[[Body, Path], None] = save_body) -> None:
    """Write a body to a data folder, where its sequences look for it, unless it is the one of the package.

    save: writes its file. Raises InputError for a name that no file can have everywhere, and if it cannot be
    written.
    """
    kept = folder / BODIES / f"{body.name}.npz"
    require_file_name(f"{body.name}.npz", f"body {body.name}")
    if not kept.exists() and body.identity.shape != _shipped_hash():
        make_folder(kept.parent)
        save(body, kept)


def sequence_body(path: Path, metadata: Mapping[str, Any], known: dict[str, Body]) -> Body:
    """The body that a sequence was simulated on: the one in its folder, or in the package.

    known: bodies that were read before, by name; new ones are added. Raises InputError if it is neither.
    """
    name = str(metadata.get("body", ""))
    kept = path.parent / BODIES / f"{name}.npz"
    if name not in known:
        known[name] = load_kept_body(kept) if kept.is_file() else load_body()
    shape = known[name].identity.shape
    if metadata.get("body_hash", shape) != shape:
        raise InputError(
            f"{path}: was simulated on the body {name}, which is neither {kept} nor the one in this package"
        )
    return known[name]


def require_joints(path: Path, clip: SimulatedClip, body: Body) -> None:
    """Raise InputError naming the file of a clip that was simulated on a body of another skeleton."""
    joints, expected = clip.transforms.shape[1], len(body.skeleton.names)
    if joints != expected:
        raise InputError(
            f"{path}: was simulated on a body of {joints} joints, body {body.name!r} has {expected}"
        )


def folder_body(folder: Path) -> Body:
    """The body that all sequences of a data folder were simulated on; without any, the one that ships.

    Raises InputError as `sequence_body` does, and if they are on several bodies.
    """
    known: dict[str, Body] = {}
    body = None
    for path in sorted(folder.glob("*.npz")):
        current = sequence_body(path, read_metadata(path), known)
        if body is not None and current is not body:
            raise InputError(
                f"{path}: was simulated on body {current.name}, other files of its folder on {body.name}"
            )
        body = current
    return body or load_body()


@cache
def _shipped_hash() -> str:
    return load_body().identity.shape
