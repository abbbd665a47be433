"""Results that follow from a record, such as a body, computed once and kept as long as the record lives."""

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

Record = TypeVar("Record")
Options = ParamSpec("Options")
Result = TypeVar("Result")


def once_per_record(
    make: Callable[Concatenate[Record, Options], Result],
) -> Callable[Concatenate[Record, Options], Result]:
    """Cache a function's results by record and hashable options, for as long as the record lives.

    Records are told apart by identity: their class has no equality of its own (`eq=False`). The results are
    shared: they must be immutable, and must not hold the record, which would then live forever.
    """
    kept: WeakKeyDictionary[Record, dict[Any, Result]] = WeakKeyDictionary()

    @wraps(make)
    def made(record: Record, /, *options: Options.args, **named: Options.kwargs) -> Result:
        results, key = kept.setdefault(record, {}), (options, tuple(sorted(named.items())))
        if key not in results:
            results[key] = make(record, *options, **named)
        return results[key]

    return made
