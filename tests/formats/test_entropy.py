"""The arithmetic coder: every number comes back, few bytes where numbers are likely, damage is told."""

import numpy as np
import pytest

from uvcloth.formats.entropy import MOST_DIGITS, decode, encode

LARGEST = 2**MOST_DIGITS - 1
CODE = "7cd82c2b862d41d1f5228f49667d"


def laplacian(shape: tuple[int, int, int], size: float) -> np.ndarray:
    spread = np.random.default_rng(0).laplace(scale=size, size=shape)
    return np.rint(spread).astype(np.int64).clip(-LARGEST, LARGEST)


@pytest.mark.parametrize("size", [0.0, 0.3, 5.0, 1e6, 1e9])
@pytest.mark.parametrize(
    ("shape", "stride"), [((1, 1, 3), 1), ((7, 5, 3), 2), ((30, 40, 6), 3), ((0, 4, 3), 1), ((3, 1, 9), 5)]
)
def test_numbers_come_back(shape: tuple[int, int, int], stride: int, size: float) -> None:
    values = laplacian(shape, size)
    code = encode(values, stride)
    assert code.dtype == np.uint8
    assert np.array_equal(decode(code, shape, stride), values)
    assert np.array_equal(encode(values, stride), code)


def test_numbers_take_little_more_than_their_entropy() -> None:
    """Independent numbers, of which nothing but their distribution can be learned."""
    values = laplacian((60, 200, 3), 0.5)
    _, counts = np.unique(values, return_counts=True)
    entropy = -(counts * np.log2(counts / values.size)).sum() / 8
    assert entropy < len(encode(values, 1)) < 1.03 * entropy


def test_sizes_nearby_make_numbers_likely() -> None:
    """The same numbers in an order in which large ones lie together take less."""
    values = laplacian((40, 100, 3), 1.0) * (np.arange(100) < 30)[:, None]
    shuffled = np.random.default_rng(1).permutation(values.reshape(-1)).reshape(values.shape)
    assert len(encode(values, 1)) < 0.75 * len(encode(shuffled, 1))
    assert len(encode(np.zeros((100, 1000, 6), np.int64), 4)) < 100


def test_what_is_no_code_of_the_numbers_is_refused() -> None:
    code = encode(laplacian((6, 20, 3), 3.0), 2)
    flipped = code.copy()
    flipped[len(code) // 2] ^= 16
    for wrong in (code[: len(code) // 2], flipped, code[:3], code[:0]):
        with pytest.raises(ValueError, match="damaged or belongs to other numbers"):
            decode(wrong, (6, 20, 3), 2)
    with pytest.raises(ValueError, match="too short for so many numbers"):
        decode(code, (100_000, 6000, 6), 2)
    with pytest.raises(ValueError, match="points and frames are too many"):
        encode(np.broadcast_to(np.int64(0), (30_000, 6000, 3)), 1)
    with pytest.raises(ValueError, match="too far away, or too fast"):
        encode(np.full((1, 1, 3), -LARGEST - 1), 1)


def test_the_code_is_the_same_on_every_machine() -> None:
    """Bytes that were written once are read, whatever becomes of the coder."""
    values = np.array([[[0, 1, -2], [3, 0, 0]], [[0, 0, -1], [90, -1000, 5]]])
    assert bytes(encode(values, 1)).hex() == CODE
    assert np.array_equal(decode(np.frombuffer(bytes.fromhex(CODE), np.uint8), (2, 2, 3), 1), values)
