"""Ranges of options: annotations on the fields of a command, which are checked before its work begins.

    port: Annotated[int, arg(metavar="N"), Between(1, 65535)] = 8080

A rule refuses a value in a few words, which follow the option and the value in the error's sentence. Of a
list, each value is checked, and the list itself where a rule has `of_list`. None, the absence, is in range.
"""

import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, TypeVar, get_args

from tyro.conf import OmitArgPrefixes, Positional

from uvcloth.errors import InputError

LONGEST_NAME, LONGEST_PATH = 255, 4000
"""Bytes of a file's name, and of a path, that every system takes."""

SHOWN = 200
"""Characters of a value that a sentence shows."""

POSITIONAL, WITHOUT_PREFIX = get_args(Positional[int])[1], get_args(OmitArgPrefixes[int])[1]
"""Tyro's marks of a field without an option's name, and of one whose name begins no option's."""


Command = TypeVar("Command")


class Rule(Protocol):
    """Range of an option, an annotation of its field."""

    of_list: ClassVar[bool]

    def refusal(self, value: Any) -> str:
        """Reason for refusing a value, in words, mostly what was expected; "" if it is in range."""
        ...


@dataclass(frozen=True)
class Between:
    """A finite number from `least` to `most`, both included unless `above`, which excludes `least`."""

    of_list: ClassVar[bool] = False
    least: float
    most: float
    above: bool = False

    def refusal(self, value: float) -> str:
        """See Rule. NaN is nowhere."""
        if (value > self.least or (value == self.least and not self.above)) and value <= self.most:
            return ""
        start = f"more than {self.least:.12g}, at most" if self.above else f"{self.least:.12g} to"
        return f"expected {start} {self.most:.12g}"


@dataclass(frozen=True)
class AtLeast:
    """A whole number from `least` to what 31 bits hold."""

    of_list: ClassVar[bool] = False
    least: int

    def refusal(self, value: int) -> str:
        """See Rule."""
        if value < self.least:
            return f"expected at least {self.least}"
        return "" if value < 2**31 else f"expected at most {2**31 - 1}"


@dataclass(frozen=True)
class Several:
    """A list of `least` to `most` values, each once where they are `distinct`."""

    of_list: ClassVar[bool] = True
    least: int = 0
    most: int = 100
    distinct: bool = False

    def refusal(self, value: Sequence[Any]) -> str:
        """See Rule."""
        if len(value) < self.least:
            return f"expected at least {'one' if self.least == 1 else self.least}"
        if len(value) > self.most:
            return f"{len(value)} values, expected at most {self.most}"
        if self.distinct and (again := next((each for each in value if value.count(each) > 1), None)):
            return f"{shortened(again)} is there twice"
        return ""


@dataclass(frozen=True)
class Text:
    """A text that matches a pattern as a whole."""

    of_list: ClassVar[bool] = False
    pattern: str
    expected: str

    def refusal(self, value: str) -> str:
        """See Rule."""
        return "" if re.fullmatch(self.pattern, value) else f"expected {self.expected}"


@dataclass(frozen=True)
class InputPath:
    """Something to read: a file of one of the suffixes (() for any), a folder, or either; or one of the names
    of what is in the package.
    """

    of_list: ClassVar[bool] = False
    suffixes: tuple[str, ...] = ()
    kind: Literal["file", "folder", "file or folder"] = "file"
    names: Callable[[], Sequence[str]] = tuple

    def refusal(self, value: str | Path) -> str:
        """See Rule."""
        names, path = self.names(), Path(value)
        if str(value) in names:
            return ""
        instead = f", nor one of {', '.join(names)}" if names else ""
        if not path.exists():
            return f"no such {self.kind}{instead}"
        is_right = path.is_dir() if self.kind == "folder" else path.is_file()
        if not is_right and not (path.is_dir() and self.kind == "file or folder"):
            other = "this is a folder or a device" if self.kind == "file" else "this is a file or a device"
            return f"no such {self.kind}, {other}"
        if self.suffixes and path.is_file() and path.suffix.lower() not in self.suffixes:
            return f"expected a {', '.join(self.suffixes)} file{instead}"
        return ""


@dataclass(frozen=True)
class Package:
    """A package of an extra. module: that it installs. need: a sentence. suffixes: formats that need it."""

    module: str
    need: str
    suffixes: tuple[str, ...] = ()

    def require(self) -> None:
        """Raise InputError if the package is not installed."""
        if find_spec(self.module) is None:
            raise InputError(self.need)


@dataclass(frozen=True)
class NewFile:
    """A file to write. suffixes: its formats. packages: that some of them need."""

    of_list: ClassVar[bool] = False
    suffixes: tuple[str, ...]
    packages: tuple[Package, ...] = ()

    def refusal(self, value: Path) -> str:
        """See Rule."""
        suffix = value.suffix.lower()
        if suffix not in self.suffixes:
            given = value.suffix or "(none)"
            return f"the format {given:.20} is not supported, use one of {', '.join(self.suffixes)}"
        if value.is_dir():
            return "cannot be written (is a folder)"
        for package in self.packages:
            if suffix in package.suffixes and find_spec(package.module) is None:
                return package.need
        return _folder_refusal(value.parent)


@dataclass(frozen=True)
class NewFolder:
    """A folder to write to, made if need be. or_file: suffix of a file that may be written instead."""

    of_list: ClassVar[bool] = False
    or_file: str = ""

    def refusal(self, value: Path) -> str:
        """See Rule."""
        if self.or_file and value.suffix.lower() == self.or_file:
            return NewFile((self.or_file,)).refusal(value)
        return _folder_refusal(value)


def parsed(parse: Callable[[], Command], arguments: Sequence[str]) -> Command:
    """The command that arguments are parsed into, its options checked.

    parse: of tyro, which takes minutes to compare very long words with its options' names. Raises InputError
    for words that are too long, and as `check_options` does.
    """
    for word in arguments:
        if len(os.fsencode(word)) > LONGEST_PATH:
            raise InputError(f"{shortened(word)}: too long, expected at most {LONGEST_PATH} bytes")
    command = parse()
    check_options(command)
    return command


def check_options(command: Any) -> None:
    """Raise InputError for the first option of a command whose value is out of its range.

    command: a dataclass, whose fields may be such themselves. Numbers are finite and paths short, whatever
    their annotations.
    """
    for name, value, rules in _options(command):
        listed = isinstance(value, tuple)
        refusals = ((value, rule.refusal) for rule in rules if listed and rule.of_list)
        for whole, refusal in refusals:
            if words := refusal(whole):
                raise InputError(f"{name or 'arguments'}: {words}")
        for each in value if listed else (value,):
            for rule in (_Possible(), *(rule for rule in rules if not rule.of_list)):
                if words := rule.refusal(each):
                    raise InputError(f"{name} {shortened(each)}: {words}".lstrip())


def shortened(value: Any) -> str:
    """A value as text, without the middle if it is long."""
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= SHOWN else f"{text[: SHOWN // 2]} ... {text[-SHOWN // 4 :]}"


@dataclass(frozen=True)
class _Possible:
    """Numbers and texts that anything can be done with."""

    of_list: ClassVar[bool] = False

    def refusal(self, value: Any) -> str:
        """See Rule."""
        if isinstance(value, float) and not math.isfinite(value):
            return "expected a finite number"
        if isinstance(value, str | Path):
            parts = os.fsencode(str(value)).split(b"/")
            if max(map(len, parts)) > LONGEST_NAME or sum(map(len, parts)) > LONGEST_PATH:
                return (
                    f"too long, expected at most {LONGEST_NAME} bytes between slashes, {LONGEST_PATH} in all"
                )
        return ""


def _options(command: Any, prefix: str = "") -> Iterator[tuple[str, Any, list[Rule]]]:
    """Name ("" of a positional one), value and rules of every option that has a value."""
    for field in fields(command):
        value, notes = getattr(command, field.name), getattr(field.type, "__metadata__", ())
        if is_dataclass(value):
            yield from _options(value, "" if WITHOUT_PREFIX in notes else f"{prefix}{field.name}.")
        elif value is not None:
            name = "" if POSITIONAL in notes else f"--{prefix}{field.name}".replace("_", "-")
            yield name, value, [note for note in notes if hasattr(note, "refusal")]


def _folder_refusal(folder: Path) -> str:
    """Words on a folder that cannot be written to or made; its closest parent that exists decides."""
    there = next((each for each in (folder, *folder.parents) if each.exists()), Path())
    if not there.is_dir():
        return f"{there}: cannot be made a folder (is a file)"
    if not os.access(there, os.W_OK | os.X_OK):
        return f"{there}: cannot be written (no permission)"
    return ""
