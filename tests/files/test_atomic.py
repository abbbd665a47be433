"""Files appear whole or not at all, from one process at a time, and what stands in the way is named."""

import errno
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from uvcloth.errors import InputError
from uvcloth.files import lock
from uvcloth.files.atomic import (
    LOCK,
    Partial,
    atomic_files,
    atomic_write,
    make_folder,
    put_in_place,
    require_there,
    sole_writer,
)

ANOTHER = """
import sys
from pathlib import Path
from uvcloth.files.atomic import Partial, sole_writer
path = Path(sys.argv[1])
with sole_writer(path):
    partial = Partial(path / "a.txt")
    (partial.folder / "big").write_text("half")
    print("ready", flush=True)
    sys.stdin.read()
"""


@contextmanager
def another(folder: Path) -> Iterator[subprocess.Popen]:
    """A process that writes folder/a.txt until it is killed."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", ANOTHER, str(folder)], **pipes) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            yield process
        finally:
            process.kill()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_file_appears_at_the_end_and_nothing_else_is_left(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "a.txt"
    with atomic_write(target) as partial:
        partial.write_text("new")
        assert partial.name == "a.txt"
        assert not target.exists()
    assert names(target.parent) == ["a.txt"]
    assert target.read_text() == "new"


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("a bug"), InputError("bad"), None])
def test_a_failed_write_keeps_the_old_file(tmp_path: Path, error: BaseException | None) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    expected = InputError if error is None else type(error)
    with pytest.raises(expected), atomic_write(target) as partial:  # noqa: PT012
        partial.write_text("half")
        raise error or OSError(28, "No space left on device")
    assert names(tmp_path) == ["a.txt"]
    assert target.read_text() == "old"


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file: cannot be made a folder \(File exists\)"):
        make_folder(tmp_path / "file")
    with (
        pytest.raises(InputError, match="file: cannot be made a folder"),
        atomic_write(tmp_path / "file" / "x"),
    ):
        pass
    (tmp_path / "folder").mkdir()
    with (
        pytest.raises(InputError, match=r"folder: cannot be written \(is a folder\)"),
        atomic_write(tmp_path / "folder") as partial,
    ):
        partial.write_text("x")
    assert names(tmp_path) == ["file", "folder"]


def test_another_process_is_named_while_it_lives_and_cleared_up_after_when_it_was_killed(
    tmp_path: Path,
) -> None:
    with another(tmp_path) as process:
        for writing in (lambda: sole_writer(tmp_path), lambda: atomic_write(tmp_path / "a.txt")):
            with pytest.raises(InputError, match=rf": process {process.pid} is writing it; wait"), writing():
                pass
        assert (tmp_path / ".a.txt.partial" / "big").read_text() == "half"
        with atomic_write(tmp_path / "b.txt") as partial:
            partial.write_text("b")
    assert names(tmp_path) == [".a.txt.partial", LOCK, "b.txt"]
    # The number in the lock is that of a process that lives, as if it had been given away again.
    (tmp_path / ".a.txt.partial" / LOCK).write_text(f"{os.getppid()} {os.uname().nodename}\n")
    with atomic_write(tmp_path / "a.txt") as partial:
        assert list(partial.parent.iterdir()) == []
        partial.write_text("a")
    with sole_writer(tmp_path):
        assert names(tmp_path) == [LOCK, "a.txt", "b.txt"]
    assert names(tmp_path) == ["a.txt", "b.txt"]


def test_a_folder_is_cleared_of_what_dead_processes_left_and_of_nothing_else(tmp_path: Path) -> None:
    dead, begun, mine = (tmp_path / "sub" / f".{name}.partial" for name in ("dead", "begun", "mine"))
    for folder in (dead / "finished", begun, mine):
        folder.mkdir(parents=True)
    (dead / LOCK).write_text("1 elsewhere\n")
    (mine / "notes.txt").write_text("of another program")
    alive = Partial(tmp_path / "alive")
    with sole_writer(tmp_path):
        assert names(tmp_path) == [".alive.partial", LOCK, "sub"]
        assert names(tmp_path / "sub") == [".mine.partial"]
        made = tmp_path / "new"
        with sole_writer(made):
            assert made.is_dir()
        assert not made.exists()
    alive.remove()
    assert names(tmp_path) == ["sub"]


def test_another_machine_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    partial = Partial(tmp_path / "a")
    with pytest.raises(InputError, match="a: is already being written, name every output once"):
        Partial(tmp_path / "a")
    monkeypatch.setattr(lock.socket, "gethostname", lambda: "here")
    with pytest.raises(InputError, match=f"a: process {os.getpid()} on {os.uname().nodename} is writing it"):
        Partial(tmp_path / "a")
    partial.remove()


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS])
def test_on_a_file_system_without_locks_every_lock_is_free(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(file: int, blocking: bool) -> bool:
        raise OSError(number, "no locks")

    monkeypatch.setattr(lock, "lock_descriptor", refuse)
    with sole_writer(tmp_path), atomic_write(tmp_path / "a.txt") as partial:
        partial.write_text("a")
    assert names(tmp_path) == ["a.txt"]


def test_several_files_appear_together_or_none_and_older_ones_come_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "1").write_text("old")
    moved = []
    replace = os.replace

    def failing(source: Path, target: Path) -> None:
        if target.name == "3" and target.parent == tmp_path:
            raise OSError(5, "Input/output error")
        moved.append(target.name)
        replace(source, target)

    def write() -> None:
        with atomic_files(tmp_path / "1") as folder:
            for name in "123":
                (folder / name).write_text("new")

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(InputError, match=r"3: cannot be written \(Input/output error\)"):
        write()
    assert moved[:2] == ["1", "2"]
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("1", "old")]
    monkeypatch.setattr(os, "replace", replace)
    write()
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys("123", "new")


def test_ctrl_c_waits_until_all_files_are_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    partials = [Partial(tmp_path / name) for name in "12"]
    for partial, name in zip(partials, "12", strict=True):
        (partial.finished / name).write_text("new")
    replace = os.replace

    def interrupted(source: Path, target: Path) -> None:
        if target.name == "1":
            signal.raise_signal(signal.SIGINT)
        replace(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        put_in_place(partials)
    for partial in partials:
        partial.remove()
    assert names(tmp_path) == ["1", "2"]


def test_a_folder_that_is_gone_is_noticed(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    partial = Partial(folder / "a")
    partial.require_there()
    require_there(folder)
    shutil.move(folder, tmp_path / "elsewhere")
    for look in (partial.require_there, lambda: require_there(folder), lambda: put_in_place([partial])):
        with pytest.raises(InputError, match="out: was removed or renamed while it was written to"):
            look()
    partial.remove()
    assert names(tmp_path) == ["elsewhere"]
