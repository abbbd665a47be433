"""Bodies stored as the difference from the one that ships: most arrays are equal, others nearly so."""

from pathlib import Path

import numpy as np

from uvcloth.bodies.body import Body, body_arrays, body_of, load_body
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, read_arrays, save_arrays
from uvcloth.files.fields import check_fields, names
from uvcloth.geometry.fingerprint import fingerprint

DIFFERENCE_FORMAT = "uvcloth-body-difference-1"
EXPECTED = "a body kept as the difference from the one that ships"

OWN = {"format", "from", "absent"}
"""Arrays of such a file in addition to those of bodies."""

FIELDS = {"from": names(), "absent": names("A").or_empty()}
"""from: hash of the body that ships. absent: arrays that it has and this body lacks."""


def save_difference(body: Body, path: Path) -> None:
    """Write a body as its difference from the one that ships.

    Equal arrays are left out. For float32 arrays of the same shape, the differences of the bits are stored,
    so that reading is exact. Raises InputError if it cannot be written.
    """
    arrays, shipped = body_arrays(body), body_arrays(load_body())
    kept = {
        "format": np.array(DIFFERENCE_FORMAT),
        "from": np.array(_hash(shipped)),
        "absent": np.array([name for name in shipped if name not in arrays], dtype=np.str_),
    }
    for name, values in arrays.items():
        expected = _expected(name, shipped, arrays)
        if expected is None or values.dtype != expected.dtype or values.shape != expected.shape:
            kept[name] = values
        elif not np.array_equal(values, expected):
            kept[name] = _difference(values, expected) if values.dtype == np.float32 else values
    save_arrays(path, kept)


def load_kept_body(path: Path) -> Body:
    """Read a body from a data folder, stored whole or as a difference.

    Raises InputError as `load_body` does, and for a difference from another body than the one that ships.
    """
    if str(read_arrays(path, EXPECTED, ("format",)).get("format")) != DIFFERENCE_FORMAT:
        return load_body(path)
    kept = load_arrays(path, DIFFERENCE_FORMAT, EXPECTED)
    shipped = body_arrays(load_body())
    data = check_fields(path, kept, FIELDS)
    if str(data["from"]) != _hash(shipped):
        raise InputError(f"{path}: is stored as a difference from another body than the one in this package")
    arrays: dict[str, np.ndarray] = {}
    # The expected vertices are taken from the base, which therefore comes first.
    for name in sorted(
        {*shipped, *kept} - OWN - set(data["absent"].tolist()), key=lambda name: name != "base"
    ):
        expected, values = _expected(name, shipped, arrays), kept.get(name)
        if values is None and expected is not None:
            arrays[name] = expected
        elif values is not None:
            arrays[name] = values if expected is None else _restored(values, expected)
    return body_of(path, arrays)


def _expected(name: str, shipped: dict[str, np.ndarray], arrays: dict[str, np.ndarray]) -> np.ndarray | None:
    """The expected array of a name; vertices follow from the base if it is known. None if unknown."""
    known = name == "vertices" and {"base", "vertices"} <= shipped.keys() and "base" in arrays
    if known and arrays["base"].shape == shipped["base"].shape:
        rows = {tuple(row): place for place, row in enumerate(shipped["base"].tolist())}
        places = [rows.get(tuple(row), 0) for row in shipped["vertices"].tolist()]
        return arrays["base"][places]
    return shipped.get(name)


def _difference(values: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Differences of the bits, as bytes (4, size), low ones first, of float32 arrays."""
    bits = np.ascontiguousarray(values).view(np.uint32) - np.ascontiguousarray(expected).view(np.uint32)
    return bits.astype("<u4").reshape(-1, 1).view(np.uint8).T.copy()


def _restored(values: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """An array from its difference from the expected one, or as stored."""
    if values.dtype != np.uint8 or expected.dtype != np.float32 or values.shape != (4, expected.size):
        return values
    bits = np.ascontiguousarray(values.T).view("<u4").astype(np.uint32).reshape(expected.shape)
    return (np.ascontiguousarray(expected).view(np.uint32) + bits).view(np.float32)


def _hash(arrays: dict[str, np.ndarray]) -> str:
    return fingerprint(*(content for name in sorted(arrays) for content in (name, arrays[name].tobytes())))
