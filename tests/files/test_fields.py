"""Fields of files of arrays: shapes that agree, kinds and ranges."""

from pathlib import Path

import numpy as np
import pytest

from uvcloth.errors import InputError
from uvcloth.files.fields import (
    check_fields,
    indices,
    is_file_name,
    names,
    numbers,
    require_file_name,
    safe_file_name,
)

FIELDS = {"points": numbers("V", 3), "faces": indices("F", 3, of="V").or_empty(), "joints": names("J")}
GOOD = {
    "points": np.ones((4, 3), np.float16),
    "faces": np.array([[0, 1, 3]], np.uint8),
    "joints": np.array(["hips", "chest"]),
}


def test_arrays_are_converted() -> None:
    found = check_fields(Path("a.npz"), GOOD, FIELDS)
    assert {name: str(array.dtype) for name, array in found.items()} == {
        "points": "float32",
        "faces": "int64",
        "joints": "<U5",
    }
    assert check_fields(Path("a.npz"), {**GOOD, "faces": np.zeros((0, 3), int)}, FIELDS)["faces"].size == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"points": np.ones((4, 2))}, r"points has the shape \(4, 2\), expected \(V, 3\)"),
        ({"points": np.full((4, 3), 1e10)}, r"points holds 1e\+10, expected -1e\+09 to 1e\+09"),
        ({"points": np.full((4, 3), np.nan)}, "points holds a value that is not a finite number"),
        ({"points": np.ones((4, 3), complex)}, "points holds complex128, expected numbers"),
        ({"faces": np.array([[0, 1, 4]])}, "faces holds 4, expected 0 to 3"),
        ({"faces": np.array([[0, -1, 3]])}, "faces holds -1, expected 0 to 3"),
        ({"joints": np.array(["a\nb"])}, "joints holds .*, expected printable names"),
    ],
)
def test_what_does_not_fit_is_named(change: dict[str, np.ndarray], said: str) -> None:
    with pytest.raises(InputError, match=rf"a\.npz: {said}"):
        check_fields(Path("a.npz"), {**GOOD, **change}, FIELDS)


def test_a_missing_array_is_named() -> None:
    with pytest.raises(InputError, match=r"a\.npz: lacks the array faces"):
        check_fields(Path("a.npz"), {"points": GOOD["points"], "joints": GOOD["joints"]}, FIELDS)


@pytest.mark.parametrize(
    "name",
    [
        *("CON", "nul.npz", "aux .tar.gz", "Com1.obj", "lpt9", "COM¹", "conout$"),
        *("end.", "end ", "a:b", "a|b", "a?", "a*", 'a"b', "<a>", "a/b", "a\\b", "..", "a\nb", "a\0b", ""),
        *("é" * 110, "x" * 220),
    ],
)
def test_names_that_some_system_forbids(name: str) -> None:
    assert not is_file_name(name)
    with pytest.raises(InputError, match=r"^walk\.bvh: .* cannot be the name of a file on every system"):
        require_file_name(name, "walk.bvh")
    assert is_file_name(safe_file_name(name))


@pytest.mark.parametrize(
    "name", ["CONE", "console.npz", "COM10", "com", "a.con", "İstanbul", "Röck 服", "é" * 109, ".a"]
)
def test_names_that_all_systems_allow(name: str) -> None:
    require_file_name(name, "walk.bvh")
    assert is_file_name(safe_file_name(name))
