"""Pictures: read back by OpenImageIO, refused where they cannot be written."""

from pathlib import Path

import numpy as np
import OpenImageIO
import pytest

from rasterize.exr import write_exr
from uvcloth.errors import InputError
from uvcloth.files.image import atomic_image, write_png

BLACK = np.zeros((2, 2, 3))


def test_bytes_of_a_picture_come_back_equal(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (4, 6, 3)).astype(np.uint8)
    write_png(tmp_path / "deep" / "picture.png", picture)
    read = OpenImageIO.ImageBuf(str(tmp_path / "deep" / "picture.png")).get_pixels(OpenImageIO.UINT8)
    assert np.array_equal(read, picture)


def test_maps_that_fail_leave_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), atomic_image(tmp_path / "maps.exr") as partial:  # noqa: PT012
        write_exr(partial, {"R": BLACK[..., 0]})
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "folder").write_text("a file")
    with pytest.raises(InputError, match="folder: cannot be made a folder"):
        write_png(tmp_path / "folder" / "picture.png", BLACK)
    with pytest.raises(
        InputError, match=r"/picture\.txt: cannot be written \(OpenImageIO writes no such format"
    ):
        write_png(tmp_path / "picture.txt", BLACK)
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]
