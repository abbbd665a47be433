"""Damage to .glb files: their JSON, the lengths of their chunks, and numbers in the binary one."""

import json
import struct
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz.byte_mutators import FLOATS, WORDS
from tests.fuzz.json_mutators import CHANGES, DEEP
from tests.fuzz.target import Mutator
from tests.small_gltf import write_glb


def change_json(path: Path, random: Random) -> str:
    """One change of the JSON, or a few."""
    document, content = _parts(path)
    words = []
    for _ in range(random.choice((1, 1, 2))):
        document, said = random.choice(CHANGES)(document, random)
        words.append(said)
    write_glb(path, document, content)
    return "; ".join(words)


def nest_json(path: Path, random: Random) -> str:
    text = random.choice((DEEP, '{"asset": ' + DEEP + "}")).encode()
    chunk = struct.pack("<II", len(text), 0x4E4F534A) + text
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunk)) + chunk)
    return "JSON nested 100,000 deep"


def lie_about_length(path: Path, random: Random) -> str:
    content = bytearray(path.read_bytes())
    place = random.choice((4, 8, 12, 16))
    if len(content) < place + 4:
        return "no header"
    word = random.choice(WORDS) % 2**32
    content[place : place + 4] = struct.pack("<I", word)
    path.write_bytes(bytes(content))
    return f"{word} at {place} of the header"


def change_value(path: Path, random: Random) -> str:
    """A number of the binary chunk."""
    document, content = _parts(path)
    if len(content) < 4:
        return "no binary chunk"
    place = 4 * random.randrange(len(content) // 4)
    value = random.choice((*FLOATS, b"\xff\xff\xff\xff", b"\0\0\0\0", random.randbytes(4)))
    write_glb(path, document, content[:place] + value + content[place + 4 :])
    return f"{value!r} at {place} of the buffer"


def _parts(path: Path) -> tuple[Any, bytes]:
    """JSON and binary chunk, empty ones where an earlier mutation left none."""
    content = path.read_bytes()
    try:
        length = struct.unpack_from("<I", content, 12)[0]
        return json.loads(content[20 : 20 + length]), content[28 + length :]
    except (struct.error, ValueError, RecursionError):
        return {}, b""


GLB: tuple[Mutator, ...] = (
    *(change_json, change_json, change_json, change_json),
    *(change_value, change_value, lie_about_length, nest_json),
)
