"""Folder for compiled code where the user's own cache cannot be written: no home, or a read-only one."""

import os
from pathlib import Path
from tempfile import gettempdir


def temporary_cache(name: str) -> Path:
    """Make or find this user's own folder of a name among temporary files.

    Raises OSError if it cannot be made, or is another user's, who could put code there that would be run.
    """
    user = os.getuid() if hasattr(os, "getuid") else None
    folder = Path(gettempdir()) / (name if user is None else f"{name}-{user}")
    folder.mkdir(mode=0o700, exist_ok=True)
    owner = folder.lstat()
    if user is not None and (owner.st_uid != user or folder.is_symlink() or owner.st_mode & 0o022):
        raise PermissionError(f"{folder}: others can write to it")
    return folder
