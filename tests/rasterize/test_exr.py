"""EXR files: read back by OpenImageIO and by its own tool."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rasterize.exr import write_exr
from tests.rasterize.exr_channels import read_channels


def channels() -> dict[str, np.ndarray]:
    random = np.random.default_rng(0)
    return {
        name: random.normal(size=(5, 7)).astype(np.float32) for name in ("velocity.Z", "a.X", "mask.body")
    }


def test_floats_come_back_equal_by_name(tmp_path: Path) -> None:
    written = channels()
    write_exr(tmp_path / "maps.exr", written, half=False)
    read = read_channels(tmp_path / "maps.exr")
    assert set(read) == set(written)
    assert all(np.array_equal(read[name], written[name]) for name in written)


def test_halves_come_back_rounded_to_half(tmp_path: Path) -> None:
    written = channels()
    write_exr(tmp_path / "maps.exr", written)
    read = read_channels(tmp_path / "maps.exr")
    assert all(
        np.array_equal(read[name], written[name].astype(np.float16).astype(np.float32)) for name in written
    )
    assert [path.name for path in tmp_path.iterdir()] == ["maps.exr"]


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


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    for name in ("none/maps.exr", "maps.txt"):
        with pytest.raises(OSError, match=name):
            write_exr(tmp_path / name, channels())
