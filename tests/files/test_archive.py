"""npz files: what is written comes back, and no damage ends in anything but the one sentence."""

import resource
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, read_arrays, save_arrays, smallest_indices

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


def with_header(path: Path, header: str, data: bytes = b"") -> Path:
    """An npz whose array noise has a header of its own."""
    text = header.encode("latin1") + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("noise.npy", b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text + data)
    return path


CLAIM = "{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}"


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (
            CLAIM.format("<f4", "(10000000000,)"),
            r"noise has the shape \(10000000000,\) with 4 bytes an element",
        ),
        (CLAIM.format("<f4", "(99999999999999999999999,)"), "noise has a header that says no type"),
        (CLAIM.format("<f4", "(0, 999999999999)"), "noise has the shape"),
        (CLAIM.format("<f4", "(-1,)"), "noise has a header that says no type"),
        (CLAIM.format("<U9999999", "(3,)"), "noise has the shape"),
        (CLAIM.format("<U999999999", "()"), "noise is of the type '<U999999999', expected numbers or texts"),
        (CLAIM.format("<c8", "(0,)"), "noise is of the type '<c8'"),
        (CLAIM.format("|O", "()"), "noise is pickled, expected plain arrays; nothing is unpickled"),
        (CLAIM.format("<f4", "(" + "1" * 9000), "noise has a header that says no type"),
        (CLAIM.format("<f4", "(3" + " " * 9000 + ";"), "noise has a header that says no type"),
        ("[1, 2]", "noise has a header that says no type"),
        ("(" * 5000, "noise has a header that says no type"),
        ("__import__('os').abort()", "noise has a header that says no type"),
        (" " * 20_000, "noise has a header of 20001 bytes, expected at most 10000"),
    ],
)
def test_no_claim_of_a_header_is_believed(tmp_path: Path, header: str, said: str) -> None:
    path = with_header(tmp_path / "a.npz", header)
    with pytest.raises(InputError, match=rf"a\.npz: {said}") as caught:
        read_arrays(path, "noise")
    assert "\n" not in str(caught.value)


def test_an_archive_that_unpacks_to_gigabytes_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    """300 MB of zeros in 300 kB; a member that claims less than it holds is damaged."""
    path, size = tmp_path / "a.npz", 300 << 20
    header = CLAIM.format("|u1", f"({size},)").encode() + b"\n"
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    start = packer.compress(b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header)
    block = zlib.compressobj(9, zlib.DEFLATED, -15)
    zeros = block.compress(bytes(1 << 20)) + block.flush(zlib.Z_FULL_FLUSH)
    packed = start + packer.flush(zlib.Z_FULL_FLUSH) + 300 * zeros + packer.flush()
    whole = size + len(header) + 10
    for claim, said in ((whole, "unpacks to 300 MB, expected at most 256"), (1000, "not a readable npz")):
        with zipfile.ZipFile(path, "w") as archive:
            member = zipfile.ZipInfo("noise.npy")
            member.compress_type, member.compress_size, member.file_size = 8, len(packed), claim
            member.CRC = member.header_offset = 0
            assert archive.fp is not None
            archive.fp.write(member.FileHeader() + packed)
            archive.filelist.append(member)
            archive.start_dir = archive.fp.tell()
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with pytest.raises(InputError, match=rf"a\.npz: {said}"):
            read_arrays(path, "noise")
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000


def test_arrays_of_another_order_come_back_in_the_machines(tmp_path: Path) -> None:
    values = {"big": NOISE.astype(">f8"), "fortran": np.asfortranarray(NOISE), "flag": np.array(True)}
    np.savez(tmp_path / "a.npz", **values, text=np.array("söme"))
    found = read_arrays(tmp_path / "a.npz", "noise")
    assert found["big"].dtype == np.dtype("f8")
    assert found["fortran"].flags.c_contiguous
    assert bool(found["flag"]) is True
    assert str(found["text"]) == "söme"
    assert np.array_equal(found["big"], NOISE)
    assert np.array_equal(found["fortran"], NOISE)


def test_an_array_twice_and_what_is_no_array_are_named(path: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("noise.npy", b"")
    with pytest.raises(InputError, match=r"a\.npz: holds the array noise twice"):
        read_arrays(path, "noise")
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        archive.writestr("noise.npy", b"text")
    with pytest.raises(InputError, match=r"b\.npz: noise is not a numpy array"):
        read_arrays(tmp_path / "b.npz", "noise")
    assert read_arrays(tmp_path / "b.npz", "noise", ("faces",)) == {}


@pytest.mark.parametrize(("largest", "dtype"), [(0, "u1"), (255, "u1"), (65_535, "u2"), (65_536, "u4")])
def test_indices_are_kept_whole_in_the_smallest_type(largest: int, dtype: str) -> None:
    packed = smallest_indices(np.array([0, largest]))
    assert packed.dtype == np.dtype(dtype)
    assert packed.tolist() == [0, largest]
