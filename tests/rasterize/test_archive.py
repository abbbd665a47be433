"""npz files: what is written comes back, and no damage ends in anything but the one sentence."""

from pathlib import Path

import numpy as np
import pytest

from rasterize.archive import load_arrays, require_finite, save_arrays
from rasterize.errors import InputError

NOISE = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    save_arrays(tmp_path / "a.npz", {"format": np.array("test-1"), "noise": NOISE})
    return tmp_path / "a.npz"


def test_arrays_come_back_equal(path: Path) -> None:
    assert np.array_equal(load_arrays(path, "test-1", "noise", ("noise",))["noise"], NOISE)
    assert [each.name for each in path.parent.iterdir()] == ["a.npz"]


def test_another_format_and_a_missing_array_are_named(path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.npz: expected noise \(format test-2\), found format test-1"):
        load_arrays(path, "test-2", "noise")
    with pytest.raises(InputError, match=r"a\.npz: lacks the array faces"):
        load_arrays(path, "test-1", "noise", ("noise", "faces"))


def test_an_npy_renamed_to_npz_is_refused(path: Path) -> None:
    with path.open("wb") as stream:
        np.save(stream, NOISE)
    with pytest.raises(InputError, match="not a readable npz, expected noise"):
        load_arrays(path, "test-1", "noise")


def test_every_damaged_byte_is_one_sentence(path: Path) -> None:
    """Checksums catch most damage; zlib, the compression method and the member's header raise their own."""
    intact = path.read_bytes()
    random = np.random.default_rng(1)
    refused = 0
    for place in range(0, len(intact), 2):
        damaged = bytearray(intact)
        damaged[place] ^= int(random.integers(1, 256))
        path.write_bytes(damaged)
        try:
            load_arrays(path, "test-1", "noise", ("noise",))
        except InputError:
            refused += 1
    assert refused > 0.8 * len(intact) / 2


def test_a_float_that_is_not_finite_is_named(path: Path) -> None:
    require_finite(path, {"name": np.array("x"), "faces": np.arange(3), "noise": NOISE})
    with pytest.raises(InputError, match=r"a\.npz: fps holds a value that is not a finite number"):
        require_finite(path, {"noise": NOISE, "fps": np.array(np.inf)})
