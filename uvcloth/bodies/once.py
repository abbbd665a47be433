"""Results that follow from a body, computed once and kept for as long as the body lives."""

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

from uvcloth.bodies.body import Body

Options = ParamSpec("Options")
Result = TypeVar("Result")


def once_per_body(
    make: Callable[Concatenate[Body, Options], Result],
) -> Callable[Concatenate[Body, Options], Result]:
    """Cache a function's results by body and hashable options, for as long as the body lives.

    The results are shared: they must be immutable, and must not hold the body, which would then live forever.
    """
    kept: WeakKeyDictionary[Body, dict[Any, Result]] = WeakKeyDictionary()

    @wraps(make)
    def made(body: Body, /, *options: Options.args, **named: Options.kwargs) -> Result:
        results, key = kept.setdefault(body, {}), (options, tuple(sorted(named.items())))
        if key not in results:
            results[key] = make(body, *options, **named)
        return results[key]

    return made
