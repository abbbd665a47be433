"""JSON read within limits of size and depth, without values that later code would not expect."""

import json
import math
from pathlib import Path
from typing import Any

from uvcloth.errors import InputError
from uvcloth.files.reading import read_content
from uvcloth.files.settings import NAMES, is_a

MOST_BYTES = 64 * 2**20
"""Greatest size of a JSON file."""

MOST_DEPTH = 50
"""Limit for the depth of nested lists and objects."""

MOST_DIGITS = 18
"""Limit for the digits of a whole number, which then fits into 64 bits."""


def read_json(path: Path, expected: str) -> dict[str, Any]:
    """Read a JSON object from a file in UTF-8.

    expected: says in words what the file should be. Raises InputError naming the file if it is missing,
    larger than MOST_BYTES, or as `parse_json` does.
    """
    return _object_of(read_json_document(path, expected), str(path), expected)


def read_json_document(path: Path, expected: str) -> Any:
    """Read JSON whose outermost value is of any kind, as `read_json` does an object."""
    path = Path(path)
    content = read_content(path)
    if len(content) > MOST_BYTES:
        raise InputError(f"{path}: has {len(content)} bytes, expected {expected}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a readable JSON file, expected {expected} (not UTF-8)") from error
    return _parsed(text, str(path), expected)


def parse_json(text: str, source: str, expected: str) -> dict[str, Any]:
    """The JSON object of a text; source: its place, with which errors begin.

    NaN and infinities are read as Python writes them. Raises InputError if it is not valid, nested deeper
    than MOST_DEPTH, names a key twice, or holds a whole number of more than MOST_DIGITS or a text of no
    characters.
    """
    return _object_of(_parsed(text, source, expected), source, expected)


def _parsed(text: str, source: str, expected: str) -> Any:
    try:
        document = json.loads(text, object_pairs_hook=_object, parse_int=_whole)
        _require_plain(document)
    except (ValueError, RecursionError) as error:
        reason = "nested too deep" if isinstance(error, RecursionError) else error
        raise InputError(f"{source}: not readable as JSON, expected {expected} ({reason})") from error
    return document


def _object_of(document: Any, source: str, expected: str) -> dict[str, Any]:
    if not isinstance(document, dict):
        raise InputError(f"{source}: not a JSON object, expected {expected}")
    return document


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {twice[:40]!r} occurs twice")
    return values


def _whole(digits: str) -> int:
    if len(digits.lstrip("-")) > MOST_DIGITS:
        raise ValueError(f"a whole number of {len(digits)} digits")
    return int(digits)


def _require_plain(value: Any) -> None:
    """Raise ValueError for nesting beyond MOST_DEPTH, and for texts that cannot be written again."""
    level = [value]
    for _ in range(MOST_DEPTH):
        for text in level:
            if isinstance(text, str):
                text.encode("utf-8")
        below = [each for each in level if isinstance(each, dict | list)]
        level = [inner for each in below for inner in (each.values() if isinstance(each, dict) else each)]
        level += [key for each in below if isinstance(each, dict) for key in each]
        if not level:
            return
    raise ValueError(f"nested deeper than {MOST_DEPTH}")


def require_kinds(value: Any, kind: Any, place: str) -> None:
    """Check the kinds of JSON values.

    kind: a type, a tuple of types, [kind] for a list of values of one kind, or a mapping by key: of keys that
    end in "?", which may be missing, and "*", which stands for every other key. place: where the value
    stands, which errors begin with. Raises InputError naming the place and what was expected there.
    """
    if isinstance(kind, dict):
        require_kinds(value, dict, place)
        for key, inner in kind.items():
            name = key.removesuffix("?")
            if key == "*":
                for other in value.keys() - kind.keys():
                    require_kinds(value[other], inner, f"{place}, {other[:40]!r}")
            elif name in value:
                require_kinds(value[name], inner, f"{place}, {name}")
            elif name == key:
                raise InputError(f"{place}: lacks {key!r}")
    elif isinstance(kind, list):
        require_kinds(value, list, place)
        for number, each in enumerate(value):
            require_kinds(each, kind[0], f"{place}, entry {number}")
    else:
        kinds = kind if isinstance(kind, tuple) else (kind,)
        if not any(is_a(value, each) for each in kinds):
            expected = " or ".join(NAMES[each] for each in kinds if each in NAMES)
            raise InputError(f"{place}: is {json.dumps(value)[:40]}, expected {expected}")
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{place}: is {value}, expected a finite number")
