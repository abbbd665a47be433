"""Packed arrays come back from the runtime, are signed, and what has no place in the format is refused."""

import struct
import zlib
from collections.abc import Iterator

import numpy as np
import pytest

from uvcloth.player.handles import pointer
from uvcloth.player.library import library
from uvcloth.player.sections import MAGIC, MOST_NUMBERS, STORED, VERSION, pack

ARRAYS = {
    "points": np.arange(6, dtype=np.float64).reshape(2, 3) / 7.0,
    "faces": np.array([[0, 1, 2]], np.int64),
    "pinned": np.array([True, False, True]),
    "nothing": np.zeros((0, 3)),
    "weights": np.arange(5, dtype=np.float32)[::2],
}


def unpack(content: bytes) -> dict[str, tuple[int, np.ndarray]]:
    """Kinds and arrays by what runtime/src/sections.cpp expects of every byte, decoded by the runtime."""
    magic, version, checksum, size, count = struct.unpack_from("<8s4I", content)
    assert (magic, version, checksum, size) == (MAGIC, VERSION, zlib.adler32(content[16:]), len(content))
    arrays = {}
    for k in range(count):
        name, kind, rows, columns, offset, length, step = struct.unpack_from("<32s5If", content, 24 + 56 * k)
        code = np.frombuffer(content, np.uint8, length, offset).copy()
        numbers = np.zeros((rows, columns), np.int32)
        assert library().uvc_decode_section(pointer(code), length, pointer(numbers), rows, columns)
        values = (numbers.view(np.float32), numbers, np.float32(step) * numbers.astype(np.float32))[kind]
        arrays[name.rstrip(b"\0").decode()] = kind, values
    return arrays


def random_arrays() -> Iterator[np.ndarray]:
    """Arrays that each of the predictions is made for, and such that none is."""
    random = np.random.default_rng(1)
    limits = np.iinfo(np.int32)
    yield random.integers(limits.min, limits.max, (500, 3), endpoint=True)
    yield np.array([limits.min, limits.max, 0, -1, limits.min])
    yield np.cumsum(random.integers(0, 4, 2000))
    yield np.cumsum(random.integers(-5, 6, (500, 7)), 1)
    yield random.integers(0, 40, 3000)
    yield np.arange(600)[:, None] // 2 + random.integers(0, 30, (600, 3))
    yield np.zeros(100_000)
    yield random.standard_normal((300, 3))


@pytest.mark.parametrize("compressed", [False, True])
def test_arrays_come_back_as_floats_and_integers_of_32_bits(compressed: bool) -> None:
    unpacked = unpack(pack(ARRAYS, compressed=compressed))
    assert list(unpacked) == list(ARRAYS)
    for name, array in ARRAYS.items():
        floating = np.issubdtype(array.dtype, np.floating)
        expected = array.astype(np.float32 if floating else np.int32)
        kind, numbers = unpacked[name]
        assert kind == (not floating)
        assert np.array_equal(numbers, expected.reshape(len(array), -1 if array.size else 3))
    assert unpack(pack({})) == {}


@pytest.mark.parametrize("array", tuple(random_arrays()))
def test_whatever_the_numbers_are_they_come_back(array: np.ndarray) -> None:
    content = pack({"array": array}, compressed=True)
    floating = np.issubdtype(array.dtype, np.floating)
    expected = array.astype(np.float32 if floating else np.int32)
    assert np.array_equal(unpack(content)["array"][1], expected.reshape(len(array), -1))
    assert len(content) < 5 * array.size + 200
    assert np.array_equal(unpack(pack({"array": array}))["array"][1], expected.reshape(len(array), -1))


def test_numbers_that_repeat_take_nearly_no_bytes() -> None:
    assert len(pack({"nothing": np.zeros(100_000)}, compressed=True)) < 700


@pytest.mark.parametrize("length", [0, 1, 12, 14])
def test_stored_numbers_that_are_cut_or_too_long_are_refused(length: int) -> None:
    numbers, code = np.zeros((3, 1), np.int32), np.frombuffer(STORED + bytes(13), np.uint8)
    assert not library().uvc_decode_section(pointer(code), length, pointer(numbers), 3, 1)
    assert library().uvc_decode_section(pointer(code), 13, pointer(numbers), 3, 1)


def test_rounded_floats_are_multiples_of_their_step() -> None:
    array = np.linspace(-1.0, 1.0, 300).reshape(100, 3)
    kind, numbers = unpack(pack({"array": array, "other": array}, {"array": 2.0**-10}))["array"]
    assert kind == 2
    assert np.abs(numbers - array).max() <= 2.0**-11
    assert np.array_equal(numbers, np.rint(array * 2.0**10) / 2.0**10)


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
