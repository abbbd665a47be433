"""EXR files: read back by OpenImageIO's own tool, refused when damaged."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest

from rasterize.exr import read_exr, write_exr, write_png
from uvcloth.errors import InputError


def channels() -> dict[str, np.ndarray]:
    random = np.random.default_rng(0)
    return {
        name: random.normal(size=(5, 7)).astype(np.float32) for name in ("velocity.Z", "a.X", "mask.body")
    }


def test_floats_come_back_equal_by_name(tmp_path: Path) -> None:
    written = channels()
    write_exr(tmp_path / "maps.exr", written, half=False)
    read = read_exr(tmp_path / "maps.exr")
    assert set(read) == set(written)
    assert all(np.array_equal(read[name], written[name]) for name in written)


def test_halves_come_back_rounded_to_half(tmp_path: Path) -> None:
    written = channels()
    write_exr(tmp_path / "maps.exr", written)
    read = read_exr(tmp_path / "maps.exr")
    assert all(
        np.array_equal(read[name], written[name].astype(np.float16).astype(np.float32)) for name in written
    )
    assert [path.name for path in tmp_path.iterdir()] == ["maps.exr"]


def test_bytes_of_a_picture_come_back_equal(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (4, 6, 3)).astype(np.uint8)
    write_png(tmp_path / "deep" / "picture.png", picture)
    read = OpenImageIO.ImageBuf(str(tmp_path / "deep" / "picture.png")).get_pixels(OpenImageIO.UINT8)
    assert np.array_equal(read, picture)


@pytest.mark.skipif(shutil.which("oiiotool") is None, reason="oiiotool is not on the path")
def test_another_program_sees_the_same_channels(tmp_path: Path) -> None:
    write_exr(tmp_path / "maps.exr", channels())
    said = subprocess.run(
        ["oiiotool", "--info", "-v", str(tmp_path / "maps.exr")], capture_output=True, text=True, check=True
    ).stdout
    assert "7 x    5, 3 channel, half openexr" in said
    assert all(name in said for name in channels())


def test_the_moment_of_writing_is_not_in_the_file(tmp_path: Path) -> None:
    write_exr(tmp_path / "maps.exr", channels())
    assert b"capDate\0string\0\x13\0\0\x001970:01:01 00:00:00" in (tmp_path / "maps.exr").read_bytes()


def test_header_is_openexr(tmp_path: Path) -> None:
    write_exr(tmp_path / "maps.exr", channels())
    head = (tmp_path / "maps.exr").read_bytes()
    assert head[:4] == bytes([0x76, 0x2F, 0x31, 0x01])
    assert b"velocity.Z\x00" in head


def test_bad_files_are_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.exr: no such file"):
        read_exr(tmp_path / "none.exr")
    path = tmp_path / "cut.exr"
    write_exr(path, channels())
    path.write_bytes(path.read_bytes()[:-60])
    with pytest.raises(InputError, match=r"cut\.exr"):
        read_exr(path)
    (tmp_path / "folder").write_text("a file")
    with pytest.raises(InputError, match="folder: cannot be made a folder"):
        write_png(tmp_path / "folder" / "picture.png", np.zeros((2, 2, 3)))
