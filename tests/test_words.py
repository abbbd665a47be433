"""Names and sentences keep to the field's terms: the words that were replaced do not come back."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted(
    path
    for package in ("rasterize", "uvcloth", "train", "evaluate")
    for path in (ROOT / package).rglob("*.py")
)

WORDS = (
    "carrier",
    "contestant",
    "crowd",
    "heeds",
    "inextensible",
    "objection",
    "settling",
    "situation",
    "surroundings",
    "wardrobe",
)
"""Neither part of a name nor in a sentence."""

NAMES = (
    "accept",
    "carried",
    "even_edges",
    "farm",
    "hanging",
    "remembered",
    "remembers",
    "said",
    "static",
    "take",
    "wear",
    "worn_on",
)
"""No name of a module, function, argument, variable or field; in sentences they may stand."""

CLASSES = (
    "Beneath",
    "Dressed",
    "Hanging",
    "Judged",
    "Material",
    "Recording",
    "Rolling",
    "Simulated",
    "Visit",
    "Worn",
    "WornState",
)
"""No name of a class; as words they may be part of other names."""

PHRASES = ("carried offsets", "frames that count")
"""In no sentence."""

ALLOWED = {
    ("evaluate/__main__.py", "said"),
    ("train/batched_collision.py", "crowd"),
    ("uvcloth/methods/motion_guided/dynamics_input.py", "situation"),
    ("uvcloth/methods/motion_guided/method.py", "hanging"),
}
"""Places where one is still used."""

OPENINGS = ("What", "How", "Whether", "Which", "Where")
UNREAD = ("evaluate/", "train/", "uvcloth/methods/", "uvcloth/rollout.py", "uvcloth/checkpoint.py")
"""Beginnings of the paths whose docstrings have not been gone through yet."""


def named(tree: ast.AST) -> Iterator[tuple[str, bool]]:
    """Every name that a module defines, and whether it is a class's."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            yield node.name, True
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name, False
        elif isinstance(node, ast.arg):
            yield node.arg, False
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, False
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr, False


def sentences(source: str) -> Iterator[str]:
    """Docstrings and comments, each in one line."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT or (
            token.type == tokenize.STRING and token.string.startswith('"""')
        ):
            yield " ".join(token.string.split())


def old_words(source: str, module: str = "") -> set[str]:
    """The replaced words that a module uses."""
    found = {word for word in (*WORDS, *NAMES) if word == module}
    for name, is_class in named(ast.parse(source)):
        plain = name.strip("_").lower()
        found |= {word for word in WORDS if word in plain}
        found |= {word for word in NAMES if word == plain}
        found |= {word for word in CLASSES if is_class and word == name.strip("_")}
    for sentence in sentences(source):
        found |= {text for text in (*WORDS, *PHRASES) if re.search(rf"\b{text}\b", sentence.lower())}
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_replaced_words_stay_away(path: Path) -> None:
    place = path.relative_to(ROOT).as_posix()
    found = {(place, word) for word in old_words(path.read_text(encoding="utf-8"), path.stem)}
    assert found <= ALLOWED


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_docstrings_begin_with_what_a_thing_is_or_does(path: Path) -> None:
    if path.relative_to(ROOT).as_posix().startswith(UNREAD):
        pytest.skip("not gone through yet")
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, documented):
            first = (ast.get_docstring(node) or "").split(" ")[0]
            assert first not in OPENINGS, f"{getattr(node, 'name', path.name)}: {first} ..."


@pytest.mark.parametrize(
    ("source", "word"),
    [
        ("def wear(template, body): ...", "wear"),
        ("class Visit: ...", "Visit"),
        ("class Situation: ...", "situation"),
        ("def rollout(carrier_weights): ...", "carrier"),
        ("self._crowd = []", "crowd"),
        ("class Method:\n    static: bool = True", "static"),
        ('"""Offsets from the carrier."""', "carrier"),
        ("step = 1  # one of the frames that count", "frames that count"),
    ],
)
def test_a_word_that_comes_back_is_found(source: str, word: str) -> None:
    assert old_words(source) == {word}


def test_words_of_other_meaning_are_left_alone() -> None:
    assert old_words('"""Garments that are worn; take the first."""\nworn = judged = simulated = 1') == set()
