"""Settings from a command line or a file: types, words and ranges of a frozen dataclass."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

from uvcloth.errors import InputError


def require_settings(settings: Any, ranges: Mapping[str, tuple[float, float]]) -> None:
    """Check every value of a dataclass whose fields are numbers, words, truth values or tuples of them.

    ranges: least and greatest number by field, both included; of a tuple for each of its numbers. Raises
    InputError naming the option (--field) and what it may be, for a value of another type than the field's,
    none of its words, or out of its range.
    """
    hints = get_type_hints(type(settings))
    for name in (field.name for field in fields(settings)):
        value, kind, option = getattr(settings, name), hints[name], f"--{name.replace('_', '-')}"
        several = get_origin(kind) is tuple
        if several and not isinstance(value, tuple):
            raise InputError(f"{option} {value!r:.40}: has to be a list")
        for each in value if several else (value,):
            _require(option, each, get_args(kind)[0] if several else kind, ranges.get(name))


def _require(option: str, value: Any, kind: Any, limits: tuple[float, float] | None) -> None:
    given = f"{option} {str(value)!r:.40}" if isinstance(value, str) else f"{option} {value!s:.40}"
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise InputError(f"{given}: has to be one of {', '.join(get_args(kind))}")
    elif not is_a(value, kind):
        raise InputError(f"{given}: has to be {NAMES[kind]}")
    if limits is not None and not limits[0] <= value <= limits[1]:
        raise InputError(f"{given}: has to be from {limits[0]:g} to {limits[1]:g}")


def is_a(value: Any, kind: type) -> bool:
    """Test for a value of a type, as JSON has them: a truth value is no number, a whole number a float."""
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


NAMES: dict[type, str] = {
    bool: "true or false",
    dict: "an object",
    float: "a number",
    int: "a whole number",
    list: "a list",
    str: "a text",
}
"""Types of values in words."""
