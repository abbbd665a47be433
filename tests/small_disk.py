"""A disk of a few megabytes, to fill and to write-protect."""

import gc
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

BALLAST = "ballast"


@contextmanager
def small_disk(folder: Path, megabytes: int = 16) -> Iterator[Path]:
    """A small file system in memory, mounted at a folder. Skips the test where mounting is not allowed."""
    folder.mkdir(exist_ok=True)
    if _mount("-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)):
        pytest.skip("mounting a small disk is not allowed here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def leave_room(disk: Path, room: int) -> None:
    """Fill a disk, emptied before, but for so many bytes, rounded down to pages."""
    for entry in disk.iterdir():
        entry.unlink()
    # A write that failed may keep its unlinked files open in a cycle, whose room comes back at any time.
    gc.collect()
    free = os.statvfs(disk)
    (disk / BALLAST).write_bytes(bytes(free.f_bavail * free.f_frsize - room))


def protect(disk: Path) -> None:
    """Make a disk read-only."""
    assert not _mount("-o", "remount,ro", str(disk))


def _mount(*words: str) -> int:
    try:
        return subprocess.run(["mount", *words], capture_output=True, check=False).returncode
    except OSError:
        return 1
