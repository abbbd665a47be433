"""Damage to any file: bits, lengths, truncation, blocks, and what may stand in a file's place."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random

from tests.fuzz.target import Mutator

WORDS = (
    0,
    1,
    0x7F,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    10**10,
    2**62,
    2**63,
    2**64 - 1,
)
"""Whole numbers that lengths and counts are replaced by."""

FLOATS = (
    b"\0\0\xc0\x7f",  # NaN
    b"\0\0\x80\x7f",  # infinity
    b"\xff\xff\x7f\xff",  # the least float32
    b"\1\0\0\0",  # the smallest above zero
)

Change = Callable[[bytes, Random], tuple[bytes, str]]


def of_bytes(change: Change) -> Mutator:
    """The mutator of a change of a file's bytes."""

    def mutate(path: Path, random: Random) -> str:
        content, words = change(path.read_bytes(), random)
        path.write_bytes(content)
        return words

    mutate.__name__ = change.__name__
    return mutate


def flip_bits(content: bytes, random: Random) -> tuple[bytes, str]:
    changed = bytearray(content)
    places = (
        [random.randrange(len(changed)) for _ in range(random.choice((1, 1, 2, 8, 64)))] if changed else []
    )
    for place in places:
        changed[place] ^= 1 << random.randrange(8)
    return bytes(changed), f"bits flipped at {places}"


def truncate(content: bytes, random: Random) -> tuple[bytes, str]:
    end = random.choice(
        (
            random.randint(0, len(content)),
            random.randint(0, min(64, len(content))),
            len(content) - random.randint(0, min(64, len(content))),
            len(content) // 2,
        )
    )
    return content[:end], f"truncated to {end} bytes"


def drop_block(content: bytes, random: Random) -> tuple[bytes, str]:
    start, end = _block(content, random)
    return content[:start] + content[end:], f"bytes {start} to {end} dropped"


def repeat_block(content: bytes, random: Random) -> tuple[bytes, str]:
    start, end = _block(content, random)
    times = random.choice((2, 2, 3, 50))
    return content[:start] + times * content[start:end] + content[
        end:
    ], f"bytes {start} to {end} {times} times"


def swap_blocks(content: bytes, random: Random) -> tuple[bytes, str]:
    a, b, c, d = sorted(random.randint(0, len(content)) for _ in range(4))
    swapped = content[:a] + content[c:d] + content[b:c] + content[a:b] + content[d:]
    return swapped, f"bytes {a} to {b} and {c} to {d} swapped"


def insert_noise(content: bytes, random: Random) -> tuple[bytes, str]:
    place = random.randint(0, len(content))
    noise = random.choice((random.randbytes(random.choice((1, 4, 100))), bytes(64), b"\xff" * 16))
    return content[:place] + noise + content[place:], f"{len(noise)} bytes inserted at {place}"


def append_noise(content: bytes, random: Random) -> tuple[bytes, str]:
    return content + random.choice((b"\0", random.randbytes(100), content)), "bytes appended"


def put_word(content: bytes, random: Random) -> tuple[bytes, str]:
    """A length or a count replaced by one of WORDS, in either byte order."""
    size = random.choice((1, 2, 4, 8))
    if len(content) < size:
        return content, "too short for a number"
    aligned = random.random() < 0.7
    place = random.randrange(0, len(content) - size + 1, size if aligned else 1)
    word = random.choice(WORDS) % 2 ** (8 * size)
    order = random.choice(("little", "little", "big"))
    return (
        content[:place] + word.to_bytes(size, order) + content[place + size :],  # type: ignore[arg-type]
        f"{word} in {size} bytes at {place}",
    )


def put_float(content: bytes, random: Random) -> tuple[bytes, str]:
    if len(content) < 4:
        return content, "too short for a number"
    place = random.randrange(0, len(content) - 3, 4)
    value = random.choice(FLOATS)
    return content[:place] + value + content[place + 4 :], f"float {value.hex()} at {place}"


def zeros(content: bytes, random: Random) -> tuple[bytes, str]:
    start, end = _block(content, random)
    return content[:start] + bytes(end - start) + content[end:], f"bytes {start} to {end} zero"


def empty(path: Path, random: Random) -> str:
    path.write_bytes(b"")
    return "empty"


def missing(path: Path, random: Random) -> str:
    path.unlink()
    return "missing"


def folder_instead(path: Path, random: Random) -> str:
    path.unlink()
    path.mkdir()
    if random.random() < 0.5:
        (path / path.name).write_bytes(b"inside")
    return "a folder in its place"


def link_loop(path: Path, random: Random) -> str:
    path.unlink()
    path.symlink_to(path.name)
    return "a symbolic link to itself"


def dangling_link(path: Path, random: Random) -> str:
    path.unlink()
    path.symlink_to("nowhere/" + path.name)
    return "a symbolic link to nowhere"


def pipe_instead(path: Path, random: Random) -> str:
    path.unlink()
    os.mkfifo(path)
    return "a pipe that nobody writes to"


def device_instead(path: Path, random: Random) -> str:
    path.unlink()
    path.symlink_to(random.choice(("/dev/zero", "/dev/urandom")))
    return "a device without end"


def moved_behind_link(path: Path, random: Random) -> str:
    """A good file at the end of a symbolic link, which is as good as the file."""
    shutil.move(path, path.with_name("elsewhere"))
    os.symlink("elsewhere", path)
    return "behind a symbolic link"


def _block(content: bytes, random: Random) -> tuple[int, int]:
    start = random.randint(0, len(content))
    length = random.choice((1, 4, 16, 100, 1000, len(content) // 3))
    return start, min(start + length, len(content))


BYTES: tuple[Mutator, ...] = tuple(
    of_bytes(change)
    for change in (
        *(flip_bits, flip_bits, truncate, truncate, drop_block, repeat_block, swap_blocks),
        *(insert_noise, append_noise, put_word, put_float, zeros),
    )
)
PLACES: tuple[Mutator, ...] = (
    *(empty, missing, folder_instead, link_loop, dangling_link, pipe_instead, device_instead),
    moved_behind_link,
)
