"""Files appear whole or not at all, and what stands in the way is named."""

from pathlib import Path

import pytest

from rasterize.atomic import atomic_write, make_folder
from rasterize.errors import InputError


def test_the_file_appears_at_the_end_and_nothing_else_is_left(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "a.txt"
    with atomic_write(target) as partial:
        partial.write_text("new")
        assert partial.name == "a.txt"
        assert not target.exists()
    assert [path.name for path in target.parent.iterdir()] == ["a.txt"]
    assert target.read_text() == "new"


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("a bug"), InputError("bad"), None])
def test_a_failed_write_keeps_the_old_file(tmp_path: Path, error: BaseException | None) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    expected = InputError if error is None else type(error)
    with pytest.raises(expected), atomic_write(target) as partial:  # noqa: PT012
        partial.write_text("half")
        raise error or OSError(28, "No space left on device")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
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
        pytest.raises(InputError, match="folder: cannot be written"),
        atomic_write(tmp_path / "folder") as partial,
    ):
        partial.write_text("x")
