"""Names in code are those of docs/glossary.md, and pages and messages use its words."""

import ast
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.statements import statements

ROOT = Path(__file__).parents[1]
FILES = sorted(
    path
    for package in ("rasterize", "uvcloth", "train", "evaluate")
    for path in (ROOT / package).rglob("*.py")
)
MANUAL = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in GLOSSARY.splitlines()
    if line.startswith("|") and not line.startswith(("| term", "|---"))
]
TERMS = {name: row[0] for row in ROWS for name in re.findall(r"`(\w+)`", row[2])}
REPLACED = {name: row[0] for row in ROWS for name in re.findall(r"`(\w+)`", row[3])}

WORDS = re.compile(r"\b(taught|nearer|told apart|anew|held by a test|who moves|dearer)\b", re.IGNORECASE)
"""Words that pages do not use."""

PARTICIPLES = {"found": 0, "chosen": 0, "own": 0, "moved": 0, "seen": 0}
"""Participles as names say little: how many there are at most. Lower a number when you rename some."""

DOUBLED = {"Body", "Cloth", "Outfit", "Sheet"}
"""Classes of one name: of the solver beside the body, and of the runtime, as its header calls them."""

OPENINGS = ("What", "How", "Whether", "Which", "Where")
"""No docstring begins with one."""


def names(source: str) -> Iterator[str]:
    """Every name that a module defines."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


@cache
def names_in(path: Path) -> tuple[str, ...]:
    """Every name that a module's file defines."""
    return tuple(names(path.read_text(encoding="utf-8")))


def replaced(defined: Iterable[str]) -> set[str]:
    """The names that the glossary has replaced."""
    return {name for name in defined if name.strip("_") in REPLACED}


@pytest.fixture(scope="module")
def counted() -> Counter[str]:
    """How often each name is defined, names of modules and folders included."""
    found: Counter[str] = Counter(part for path in FILES for part in (path.stem, path.parent.name))
    for path in FILES:
        found.update(name.strip("_") for name in names_in(path))
    return found


def test_a_class_name_stands_for_one_thing() -> None:
    classes = Counter(
        node.name
        for path in FILES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    )
    assert {name for name, count in classes.items() if count > 1} == DOUBLED


def test_the_glossary_is_in_order() -> None:
    terms = [row[0].lower() for row in ROWS]
    assert terms == sorted(terms)
    assert all(len(row) == 4 for row in ROWS)


def test_names_of_the_glossary_are_in_the_code(counted: Counter[str]) -> None:
    assert {name: term for name, term in TERMS.items() if not counted[name]} == {}


def test_replaced_names_stay_away() -> None:
    assert [path for path in FILES if path.stem in REPLACED] == []
    used = {path: replaced(names_in(path)) for path in FILES}
    assert {
        path: {name: REPLACED[name.strip("_")] for name in names} for path, names in used.items() if names
    } == {}


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("def wear(template, body): ...", "wear"),
        ("class Situation: ...", "Situation"),
        ("def rollout(carrier_weights): ...", "carrier_weights"),
        ("self._crowd = []", "_crowd"),
        ("class Method:\n    static: bool = True", "static"),
    ],
)
def test_a_name_that_comes_back_is_found(source: str, name: str) -> None:
    assert replaced(names(source)) == {name}


@pytest.mark.parametrize("word", sorted(PARTICIPLES))
def test_participles_do_not_spread_as_names(counted: Counter[str], word: str) -> None:
    used = sum(number for name, number in counted.items() if name == word)
    assert used <= PARTICIPLES[word], "name the thing, not what was done to it"


def test_docstrings_begin_with_what_a_thing_is_or_does() -> None:
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for path in FILES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in (tree, *statements(tree)):
            if isinstance(node, documented):
                first = (ast.get_docstring(node) or "").split(" ")[0]
                assert first not in OPENINGS, f"{path}, {getattr(node, 'name', 'module')}: {first} ..."


@pytest.mark.parametrize("path", MANUAL, ids=lambda path: str(path.relative_to(ROOT)))
def test_pages_use_the_words_of_the_glossary(path: Path) -> None:
    text = path.read_text(encoding="utf-8").partition("Words in texts:")[0]
    assert WORDS.findall(text) == []
