"""Locks on files, which end with the process that holds them, however it ends.

They are the system's own, through filelock: no number of a process is compared, which another may have by
now, and where a share knows locks (NFS, SMB) they hold between machines. Where a file system knows none,
every lock is free. filelock's own `FileLock` is not used: it leaves its file and does not say who holds it.
"""

import errno
import os
import socket
import sys
from contextlib import suppress
from pathlib import Path

from filelock import lock_descriptor

NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}
"""Errors of file systems without locks."""

LOCKED = b"\n"
"""Beginning of the file: the byte that is locked, which on Windows no other process can read."""


class HeldError(Exception):
    """The lock is held: by this process itself (`here`), or by `holder`, in words."""

    def __init__(self, here: bool, holder: str) -> None:
        super().__init__(holder)
        self.here, self.holder = here, holder


class Lock:
    """Lock on a file, which is made if need be and says who holds it.

    Raises HeldError if it is held, FileNotFoundError without its folder, and OSError if the system refuses.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        while True:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
            try:
                if not _lock(self._file):
                    raise _held(self._file)
            except BaseException:
                os.close(self._file)
                raise
            # Between opening and locking it its holder may have released it, and thereby removed it.
            if self.is_there():
                break
            os.close(self._file)
        try:
            os.ftruncate(self._file, 0)
            os.write(self._file, LOCKED + f"{os.getpid()} {socket.gethostname()}\n".encode())
        except BaseException:
            self.release()
            raise

    def is_there(self) -> bool:
        """True if the file is still at its path."""
        try:
            return os.path.samestat(os.fstat(self._file), os.stat(self.path))
        except FileNotFoundError:
            return False

    def release(self) -> None:
        """Remove the file and release the lock."""
        try:
            if sys.platform != "win32" and self.is_there():
                os.unlink(self.path)
        finally:
            os.close(self._file)
        if sys.platform == "win32":
            # What is open cannot be removed there.
            with suppress(OSError):
                os.unlink(self.path)


def _held(file: int) -> HeldError:
    os.lseek(file, len(LOCKED), os.SEEK_SET)
    number, _, host = os.read(file, 1000).decode(errors="replace").strip().partition(" ")
    if not number:
        return HeldError(False, "another process")
    if host != socket.gethostname():
        return HeldError(False, f"process {number} on {host}")
    return HeldError(int(number) == os.getpid(), f"process {number}")


def _lock(file: int) -> bool:
    """Lock an open file. Returns False if another has it."""
    try:
        return lock_descriptor(file, blocking=False)
    except OSError as error:
        if error.errno in NO_LOCKS:
            return True
        raise
