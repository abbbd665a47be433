"""Damage to safetensors files: headers that lie, tensors of another kind, values that are none."""

import json
import struct
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz.byte_mutators import FLOATS
from tests.fuzz.json_mutators import CHANGES, DEEP
from tests.fuzz.target import Mutator

DTYPES = (
    "F64",
    "F32",
    "F16",
    "BF16",
    "I64",
    "I32",
    "I16",
    "I8",
    "U8",
    "BOOL",
    "F8_E4M3",
    "C64",
    "X",
    "",
    None,
    3,
)
SIZES = (0, 1, -1, 2, 10**10, 2**31, 2**62, 2**63, 2**64, 10**23, "3", 1.5, None)


def lie_about_size(path: Path, random: Random) -> str:
    content = path.read_bytes()
    size = random.choice(
        (0, 1, 8, 10**6, 10**8, 2**31, 2**62, 2**63, 2**64 - 1, len(content), len(content) - 8)
    )
    path.write_bytes(struct.pack("<Q", size) + content[8:])
    return f"the header says that it has {size} bytes"


def change_entry(path: Path, random: Random) -> str:
    """Type, shape, place or name of a tensor."""
    header, data = _parts(path)
    names = _whole(header)
    if not names:
        return "no tensors"
    name, way = random.choice(names), random.randrange(8)
    entry = header[name]
    if way == 0:
        entry["dtype"] = random.choice(DTYPES)
    elif way == 1:
        entry["shape"] = random.choice(([], [0], [3], [random.choice(SIZES)], [*entry["shape"], 1], "x"))
    elif way == 2:
        entry["shape"] = entry["shape"][::-1]
    elif way == 3:
        begin, end = entry["data_offsets"]
        entry["data_offsets"] = random.choice(([begin, end + 4], [0, end], [end, begin], [begin], [-4, end]))
    elif way == 4:
        entry["data_offsets"] = [random.choice(SIZES), random.choice(SIZES)]
    elif way == 5:
        header[random.choice((name + "x", "", "../x", name.upper()))] = header.pop(name)
    elif way == 6:
        other = random.choice(names)
        header[name], header[other] = header[other], header[name]
    else:
        entry.pop(random.choice(list(entry)), None)
    _write(path, header, data)
    return f"{name} changed (way {way})"


def same_bytes_otherwise(path: Path, random: Random) -> str:
    """A tensor of as many bytes, but of another type, or of another shape."""
    header, data = _parts(path)
    names = _whole(header)
    if not names:
        return "no tensors"
    name = random.choice(names)
    entry = header[name]
    same = {"F32": ("I32", "U32"), "I64": ("F64", "U64"), "F16": ("BF16", "I16")}.get(entry["dtype"])
    if same and random.random() < 0.6:
        entry["dtype"] = random.choice(same)
    else:
        count = 1
        for size in entry["shape"]:
            count *= size
        entry["shape"] = random.choice(([count], [1, count], [count, 1], [*entry["shape"], 1]))
    _write(path, header, data)
    return f"{name} is now {entry['dtype']} {entry['shape']}"


def drop_tensor(path: Path, random: Random) -> str:
    """A tensor less, the others moved together, so that the file is whole."""
    header, data = _parts(path)
    names = _whole(header)
    if not names:
        return "no tensors"
    dropped = random.choice(names)
    kept, changed, place = b"", {}, 0
    for name in names:
        if name == dropped:
            continue
        entry = header[name]
        begin, end = entry["data_offsets"]
        changed[name] = {**entry, "data_offsets": [place, place + end - begin]}
        kept, place = kept + data[begin:end], place + end - begin
    _write(path, changed | {k: v for k, v in header.items() if k == "__metadata__"}, kept)
    return f"{dropped} is missing"


def add_tensor(path: Path, random: Random) -> str:
    header, data = _parts(path)
    name = random.choice(("more", "network.more", "", "a" * 10_000))
    header[name] = {"dtype": "F32", "shape": [2], "data_offsets": [len(data), len(data) + 8]}
    _write(path, header, data + bytes(8))
    return f"{name[:20]!r} added"


def change_values(path: Path, random: Random) -> str:
    header, data = _parts(path)
    if len(data) < 4:
        return "no values"
    changed, count = bytearray(data), random.choice((1, 1, 10))
    for _ in range(count):
        place = random.randrange(0, len(data) - 3, 4)
        changed[place : place + 4] = random.choice((*FLOATS, b"\xff" * 4, random.randbytes(4)))
    _write(path, header, bytes(changed))
    return f"{count} values changed"


def change_header(path: Path, random: Random) -> str:
    header, data = _parts(path)
    document, words = random.choice(CHANGES)(header, random)
    _write(path, document, data)
    return f"the header: {words}"


def odd_header(path: Path, random: Random) -> str:
    _, data = _parts(path)
    text = random.choice(
        ("", "{", "[]", "{}", "null", DEEP, '{"__metadata__":{"json":"[' * 3, '{"a":' * 10**5, "\xff")
    )
    packed = text.encode("latin1")
    path.write_bytes(struct.pack("<Q", len(packed)) + packed + data)
    return f"the header {text[:30]!r}"


def change_metadata(path: Path, random: Random) -> str:
    header, data = _parts(path)
    header["__metadata__"] = random.choice(
        (
            {"json": DEEP},
            {"json": "{"},
            {"json": "[1]"},
            {"json": "NaN"},
            {"json": 3},
            {},
            [],
            {"x": "y"},
            "x",
        )
    )
    _write(path, header, data)
    return "other metadata"


def _parts(path: Path) -> tuple[dict[str, Any], bytes]:
    """Header and data, empty ones where an earlier mutation left none."""
    content = path.read_bytes()
    size = int.from_bytes(content[:8], "little")
    try:
        header = json.loads(content[8 : 8 + size])
    except (ValueError, RecursionError, OverflowError):
        return {}, b""
    return (header, content[8 + size :]) if isinstance(header, dict) else ({}, b"")


def _whole(header: dict[str, Any]) -> list[str]:
    """Names of the tensors whose entries earlier mutations left whole."""

    def whole(numbers: Any) -> bool:
        return isinstance(numbers, list) and all(type(number) is int for number in numbers)

    return [
        name
        for name, entry in header.items()
        if isinstance(entry, dict)
        and whole(entry.get("shape"))
        and whole(entry.get("data_offsets"))
        and len(entry["data_offsets"]) == 2
        and isinstance(entry.get("dtype"), str)
    ]


def _write(path: Path, header: Any, data: bytes) -> None:
    text = json.dumps(header).encode("utf-8")
    path.write_bytes(struct.pack("<Q", len(text)) + text + data)


SAFETENSORS: tuple[Mutator, ...] = (
    *(lie_about_size, change_entry, change_entry, same_bytes_otherwise, same_bytes_otherwise, drop_tensor),
    *(add_tensor, change_values, change_values, change_header, odd_header, change_metadata),
)
