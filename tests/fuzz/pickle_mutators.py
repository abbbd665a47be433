"""Damage to pickles: operations that are dropped, doubled or exchanged, or that ask for code or memory."""

import pickletools
import struct
from collections.abc import Callable
from random import Random

from tests.fuzz.byte_mutators import of_bytes
from tests.fuzz.target import Mutator

INSERTED = (
    b"cos\nsystem\n",
    b"cbuiltins\neval\n",
    b"cnumpy\nload\n",
    b"c__main__\nX\n",
    b"cnumpy\ndtype\n",
    b"r" + struct.pack("<I", 100_000_000),  # A place in the memo.
    b"p99999999\n",
    b"\x8a\xff" + b"\xff" * 255,  # A whole number of 255 bytes.
    b"\x8b" + struct.pack("<i", 2**31 - 1),
    b"\x8e" + struct.pack("<Q", 2**40),  # Bytes that are not there.
    b"\x96" + struct.pack("<Q", 2**40),
    b"\x95" + struct.pack("<Q", 2**62),
    b"2" * 50,  # The last value, again and again.
    b"2\x86" * 60,  # A pair of the last value, whose halves are such pairs, 60 times.
    b"(" * 5000,
    b"]" * 5000,
    b"]2a",
    b"R",
    b"b",
    b"0",
    b".",
    b"N",
    b"}",
    b"I999999999999\n",
    b"F1e999\n",
    b"Fnan\n",
    b"I01\n",
)
"""Operations that are put between others."""


def insert_operation(content: bytes, random: Random) -> tuple[bytes, str]:
    place = random.choice(_places(content))
    inserted = random.choice(INSERTED)
    return content[:place] + inserted + content[place:], f"{inserted[:20]!r} inserted at {place}"


def drop_operations(content: bytes, random: Random) -> tuple[bytes, str]:
    places = _places(content)
    first = random.randrange(len(places))
    last = min(first + random.choice((1, 1, 3, 20)), len(places) - 1)
    return content[: places[first]] + content[places[last] :], f"operations {first} to {last} dropped"


def exchange_operations(content: bytes, random: Random) -> tuple[bytes, str]:
    places = _places(content)
    if len(places) < 5:
        return content, "no operations"
    a, b = sorted(random.sample(range(len(places) - 1), 2))
    (a, a_end), (b, b_end) = (places[a], places[a + 1]), (places[b], places[b + 1])
    changed = content[:a] + content[b:b_end] + content[a_end:b] + content[a:a_end] + content[b_end:]
    return changed, f"operations at {a} and {b} exchanged"


def copy_operations(content: bytes, random: Random) -> tuple[bytes, str]:
    places = _places(content)
    first, target = random.randrange(len(places)), random.choice(places)
    last = min(first + random.choice((1, 2, 10, 100)), len(places) - 1)
    copied = content[places[first] : places[last]]
    return content[:target] + copied + content[target:], f"operations {first} to {last} copied to {target}"


def change_argument(content: bytes, random: Random) -> tuple[bytes, str]:
    """Whole numbers of an operation replaced: sizes, shapes, places in the memo."""
    found = [
        (place, name)
        for place, name in _operations(content)
        if name.startswith(("BININT", "BINPUT", "BINGET"))
    ]
    if not found:
        return content, "no numbers"
    place, name = random.choice(found)
    value = random.choice((0, 1, 2, 255))
    return content[: place + 1] + bytes((value,)) + content[place + 2 :], f"{name} at {place} becomes {value}"


def _operations(content: bytes) -> list[tuple[int, str]]:
    """Places and names of the operations, up to damage of an earlier mutation."""
    found = []
    try:
        for operation, _, place in pickletools.genops(content):
            found.append((place or 0, operation.name))
    except (ValueError, IndexError, OverflowError):
        pass
    return found


def _places(content: bytes) -> list[int]:
    return [place for place, _ in _operations(content)] or [0]


CHANGES: tuple[Callable[[bytes, Random], tuple[bytes, str]], ...] = (
    *(insert_operation, insert_operation, drop_operations, exchange_operations),
    *(copy_operations, change_argument, change_argument),
)
PICKLE: tuple[Mutator, ...] = tuple(of_bytes(change) for change in CHANGES)
