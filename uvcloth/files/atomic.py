"""Writing of files: they appear complete or not at all, each from one process at a time.

What is not finished lies in a hidden folder beside the file, `.NAME.partial`, which its process has locked.
The next process that writes the file finds the folder of one that was killed unlocked, and clears it.
"""

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path

from uvcloth.errors import InputError
from uvcloth.files.lock import HeldError, Lock
from uvcloth.process.interruption import uninterrupted

SUFFIX, FINISHED = ".partial", "finished"
ROOM = 2**20
"""Bytes by which a disk is tried: more than libraries collect before they write."""

LOCK = ".uvcloth.lock"
"""Name of the lock in a folder that is written to, hidden or not."""


class Partial:
    """Hidden folder beside a file to be, for what is not finished, and for this process alone.

    folder: the place of anything but finished files. finished: what `put_in_place` moves beside it, by name.
    Folders above are made. Raises InputError if another process writes the file, and OSError.
    """

    def __init__(self, path: Path) -> None:
        make_folder(path.parent)
        self.folder = path.with_name(f".{path.name}{SUFFIX}")
        self.finished = self.folder / FINISHED
        while True:
            self.folder.mkdir(exist_ok=True)
            try:
                self._lock = Lock(self.folder / LOCK)
            except FileNotFoundError:
                # Its holder removed the folder just now.
                continue
            except HeldError as error:
                raise _is_written(path, error) from error
            except BaseException:
                with suppress(OSError):
                    self.folder.rmdir()
                raise
            break
        try:
            _clear(self.folder)
            self.finished.mkdir()
        except BaseException:
            self.remove()
            raise

    def require_there(self) -> None:
        """Raise InputError if the folder has been removed meanwhile."""
        if not self._lock.is_there():
            raise _is_gone(self.folder.parent)

    def remove(self) -> None:
        """Remove the folder and all that is left in it."""
        with suppress(OSError):
            _clear(self.folder)
        with suppress(OSError):
            self._lock.release()
        with suppress(OSError):
            self.folder.rmdir()


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Temporary path to write to instead of `path`: the same name in a folder beside it, moved at the end.

    If the block raises, nothing is left and an older file stays. Folders above are made.
    Raises InputError naming `path` if another process writes it, or the system refuses anything in the block.
    """
    path = Path(path)
    with atomic_files(path) as folder:
        yield folder / path.name


@contextmanager
def atomic_files(path: Path) -> Iterator[Path]:
    """Temporary folder to write `path` and files beside it to: they appear together, or none does.

    Otherwise as `atomic_write`.
    """
    path = Path(path)
    try:
        partial = Partial(path)
        try:
            yield partial.finished
            put_in_place([partial])
        finally:
            partial.remove()
    except OSError as error:
        raise _cannot_write(path, error) from error


def put_in_place(partials: Sequence[Partial]) -> list[tuple[Path, ...]]:
    """Move the finished files to their places, all of them or none: where one fails, older ones come back.

    Returns where those of each are. Raises InputError if one cannot be moved, or a folder is gone. Ctrl-C
    waits for the end; only a process that is killed between the first move and the last leaves some of them.
    """
    moves = [_moves(partial) for partial in partials]
    together = list(chain.from_iterable(moves))
    with uninterrupted():
        try:
            for finished, target, older in together:
                if len(together) > 1 and target.exists():
                    _keep(target, older)
                os.replace(finished, target)
        except BaseException as error:
            for source, place, older in together:
                if not source.exists():
                    place.unlink(missing_ok=True)
                if older.exists():
                    os.replace(older, place)
            if isinstance(error, OSError):
                raise _cannot_write(target, error) from error
            raise
    return [tuple(target for _, target, _ in move) for move in moves]


def _moves(partial: Partial) -> list[tuple[Path, Path, Path]]:
    """For each finished file where it is, where it is to be, and where the older one is kept meanwhile."""
    partial.require_there()
    moves = []
    for finished in sorted(partial.finished.iterdir()):
        target = partial.folder.with_name(finished.name)
        if target.is_dir():
            raise InputError(f"{target}: cannot be written (is a folder)")
        moves.append((finished, target, partial.folder / f"older {finished.name}"))
    return moves


def _keep(path: Path, name: Path) -> None:
    """Give a file a second name, or, where the file system has none, another one."""
    try:
        os.link(path, name)
    except OSError:
        os.replace(path, name)


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Claim a folder, which is made if need be, for this process alone until the block ends.

    What killed processes left unfinished in it and up to two folders below is cleared, at the beginning and
    at the end; a folder that was made and stayed empty is removed. Raises InputError if another process has
    claimed it, or if it cannot be made.
    """
    folder = Path(folder)
    made = not folder.exists()
    make_folder(folder)
    try:
        lock = Lock(folder / LOCK)
    except HeldError as error:
        raise _is_written(folder, error) from error
    except OSError as error:
        raise _cannot_write(folder, error) from error
    try:
        _clear_leftovers(folder)
        yield
    finally:
        _clear_leftovers(folder)
        with suppress(OSError):
            lock.release()
        if made:
            with suppress(OSError):
                folder.rmdir()


def require_room(folder: Path) -> None:
    """Raise the system's OSError if a disk is full: libraries do not always say why they could not write."""
    probe = folder / "room"
    try:
        probe.write_bytes(bytes(ROOM))
    finally:
        probe.unlink(missing_ok=True)


def require_there(folder: Path) -> None:
    """Raise InputError if a folder that is written to is gone."""
    if not folder.is_dir():
        raise _is_gone(folder)


def make_folder(path: Path) -> None:
    """Make a folder and its parents, if they are missing. Raises InputError if that fails."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made a folder ({error.strerror or error})") from error


def _cannot_write(path: Path, error: OSError) -> InputError:
    hidden = path.parent.parent
    if path.parent.name == FINISHED and hidden.name.endswith(SUFFIX):
        path = hidden.with_name(path.name)
    return InputError(f"{path}: cannot be written ({error.strerror or error})")


def _is_gone(folder: Path) -> InputError:
    return InputError(f"{folder}: was removed or renamed while it was written to")


def _is_written(path: Path, error: HeldError) -> InputError:
    if error.here:
        return InputError(f"{path}: is already being written, name every output once")
    return InputError(f"{path}: {error.holder} is writing it; wait until that ends, or name another output")


def _clear_leftovers(folder: Path) -> None:
    """Remove hidden folders that no process holds; what cannot be removed stays."""
    hidden = f".*{SUFFIX}"
    for partial in chain.from_iterable(folder.glob(depth + hidden) for depth in ("", "*/", "*/*/")):
        with suppress(OSError, HeldError):
            if partial.is_symlink() or not partial.is_dir():
                continue
            names = os.listdir(partial)
            if not names or LOCK in names:
                lock = Lock(partial / LOCK)
                _clear(partial)
                lock.release()
                partial.rmdir()


def _clear(folder: Path) -> None:
    """Empty a hidden folder but for its lock."""
    for entry in folder.iterdir():
        if entry.name == LOCK:
            continue
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink()
