"""Damage to JSON: values of other kinds, keys that are missing or doubled, nesting."""

import json
import sys
from copy import deepcopy
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz.target import Mutator
from tests.fuzz.text_mutators import NUMBERS

DEEP = "[" * 100_000 + "]" * 100_000

VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2, 10**9, -(10**9), 10**20, 10**400, 0.5, -0.5, 1e39, 1e-300),
    *(float("nan"), float("inf"), float("-inf"), "", "x", "nan", "1", "a" * 100_000, "../x", "/etc/passwd"),
    *("..\\x", "<script>alert(1)</script>", "\0", "\ud800", "file:///etc/passwd", "http://localhost/x"),
    *([], {}, [[]], [1, 2, 3], {"a": 1}, [0] * 1000, [None], ["x"], {"": ""}),
)
"""Values that any value is replaced by."""


def replace_value(document: Any, random: Random) -> tuple[Any, str]:
    places = list(_places(document))
    if not places:
        return deepcopy(random.choice(VALUES)), "another document"
    holder, key = random.choice(places)
    holder[key] = deepcopy(random.choice(VALUES))
    return document, f"{key!r} becomes {str(holder[key])[:40]!r}"


def scale_number(document: Any, random: Random) -> tuple[Any, str]:
    places = [(holder, key) for holder, key in _places(document) if type(holder[key]) in (int, float)]
    if not places:
        return document, "no number"
    holder, key = random.choice(places)
    factor = random.choice((-1, 0, 2, 10, 1000, 10**6, 10**9, 0.5))
    # An earlier mutation may have left an integer that no float holds.
    huge = isinstance(holder[key], int) and abs(holder[key]) > sys.float_info.max
    holder[key] *= -1 if huge else factor
    return document, f"{key!r} becomes {holder[key]}"


def drop_key(document: Any, random: Random) -> tuple[Any, str]:
    places = list(_places(document))
    if not places:
        return document, "no key"
    holder, key = random.choice(places)
    del holder[key]
    return document, f"{key!r} dropped"


def rename_key(document: Any, random: Random) -> tuple[Any, str]:
    places = [(holder, key) for holder, key in _places(document) if isinstance(holder, dict)]
    if not places:
        return document, "no key"
    holder, key = random.choice(places)
    name = random.choice((key.upper(), key + " ", "", "__class__", "x", "../x"))
    holder[name] = holder.pop(key)
    return document, f"{key!r} renamed {name!r}"


def exchange_values(document: Any, random: Random) -> tuple[Any, str]:
    places = list(_places(document))
    if len(places) < 2:
        return document, "no two values"
    (a, here), (b, there) = random.sample(places, 2)
    a[here], b[there] = deepcopy(b[there]), deepcopy(a[here])
    return document, f"{here!r} and {there!r} exchanged"


def wrap_value(document: Any, random: Random) -> tuple[Any, str]:
    places = list(_places(document))
    if not places:
        return [document], "wrapped"
    holder, key = random.choice(places)
    holder[key] = random.choice(([holder[key]], {"value": holder[key]}, str(holder[key])))
    return document, f"{key!r} wrapped"


CHANGES = (
    replace_value,
    replace_value,
    replace_value,
    scale_number,
    drop_key,
    rename_key,
    exchange_values,
    wrap_value,
)


def change_document(path: Path, random: Random) -> str:
    """One change, or a few, of a JSON file that can be read."""
    document, words = _readable(path), []
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        document, said = random.choice(CHANGES)(document, random)
        words.append(said)
    path.write_text(json.dumps(document), encoding="utf-8", errors="surrogatepass")
    return "; ".join(words)


def write_raw_value(path: Path, random: Random) -> str:
    """A value in a notation that the writer would not use, or 100,000 brackets."""
    document = _readable(path)
    places = list(_places(document))
    if not places:
        return "nothing to replace"
    holder, key = random.choice(places)
    holder[key] = "@@@"
    raw = random.choice((DEEP, DEEP, *NUMBERS, "[1,]", "{1:2}", "'x'", "// x", "undefined"))
    path.write_text(json.dumps(document).replace('"@@@"', raw), encoding="utf-8", errors="surrogatepass")
    return f"{key!r} becomes {raw[:40]}"


def double_key(path: Path, random: Random) -> str:
    document = _readable(path)
    if not isinstance(document, dict) or not document:
        return "no key"
    key = random.choice(list(document))
    again = json.dumps({key: random.choice(VALUES)})[1:-1]
    path.write_text(json.dumps(document)[:-1] + f", {again}}}", encoding="utf-8", errors="surrogatepass")
    return f"{key!r} stands twice"


def _readable(path: Path) -> Any:
    """The document, or an empty one where an earlier mutation left none."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}


def _places(value: Any, depth: int = 0) -> Any:
    """Every holder and key of a document, but for the depths that an earlier mutation made."""
    if isinstance(value, dict | list) and depth < 50:
        for key in list(value) if isinstance(value, dict) else range(len(value)):
            yield value, key
            yield from _places(value[key], depth + 1)


JSON: tuple[Mutator, ...] = (
    *(change_document, change_document, change_document, change_document),
    *(write_raw_value, double_key),
)
