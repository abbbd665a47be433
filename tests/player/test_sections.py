"""Packed arrays are where the header says, are signed, and what has no place in the format is refused."""

import struct
import zlib

import numpy as np
import pytest

from uvcloth.player.sections import MAGIC, MOST_NUMBERS, pack

ARRAYS = {
    "points": np.arange(6, dtype=np.float64).reshape(2, 3) / 7.0,
    "faces": np.array([[0, 1, 2]], np.int64),
    "pinned": np.array([True, False, True]),
    "nothing": np.zeros((0, 3)),
    "weights": np.arange(5, dtype=np.float32)[::2],
}


def unpack(content: bytes) -> dict[str, np.ndarray]:
    """The arrays by what runtime/src/sections.cpp expects of every byte."""
    magic, version, checksum, size, count = struct.unpack_from("<8s4I", content)
    assert (magic, version, checksum, size) == (MAGIC, 1, zlib.adler32(content[16:]), len(content))
    arrays = {}
    for k in range(count):
        name, kind, rows, columns, offset = struct.unpack_from("<32s4I", content, 24 + 48 * k)
        assert offset % 4 == 0
        numbers = np.frombuffer(content, ("<f4", "<i4")[kind], rows * columns, offset)
        arrays[name.rstrip(b"\0").decode()] = numbers.reshape(rows, columns)
    return arrays


def test_arrays_come_back_as_floats_and_integers_of_32_bits() -> None:
    unpacked = unpack(pack(ARRAYS))
    assert list(unpacked) == list(ARRAYS)
    for name, array in ARRAYS.items():
        floating = np.issubdtype(array.dtype, np.floating)
        expected = array.astype(np.float32 if floating else np.int32)
        assert unpacked[name].dtype == expected.dtype
        assert np.array_equal(unpacked[name], expected.reshape(len(array), -1 if array.size else 3))
    assert unpack(pack({})) == {}


@pytest.mark.parametrize(
    ("name", "array", "match"),
    [
        ("", np.zeros(1), "needs a name"),
        ("n" * 32, np.zeros(1), "needs a name"),
        ("a\0b", np.zeros(1), "needs a name"),
        ("cube", np.zeros((1, 1, 1)), "shape"),
        ("one", np.float64(1.0), "shape"),
        ("many", np.broadcast_to(0.0, MOST_NUMBERS + 1), "shape"),
        ("nan", np.array([0.0, np.nan]), "not finite"),
        ("huge", np.array([1e39]), "not finite"),
        ("wide", np.array([1 << 31]), "more than 32 bits"),
        ("words", np.array(["a"]), "of type"),
    ],
)
def test_what_has_no_place_is_refused(name: str, array: np.ndarray, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        pack({name: np.asarray(array)})
