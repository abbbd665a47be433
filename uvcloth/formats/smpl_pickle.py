"""Pickled SMPL files, read without executing any of their code.

A pickle is a program: it names functions and classes and calls them. Here every name of a short list stands
for a record that keeps its arguments, every other name ends the reading, and arrays are made from the records
afterwards. Nothing of numpy, scipy or chumpy is called while the file is read.
"""

import io
import math
import pickle
import pickletools
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from uvcloth.errors import InputError
from uvcloth.files.reading import read_content

DTYPES = ("f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8")
"""Types of values that arrays may have, besides booleans."""

MOST_VALUES = 10_000_000
"""Limit for the values of a sparse matrix, zeros included; those of SMPL have fewer."""


class _Record:
    """Arguments that a pickle calls a constructor with, and the state that it then sets."""

    arguments: tuple[Any, ...]
    state: Any
    made: Any

    def __new__(cls, *arguments: Any) -> "_Record":
        record = super().__new__(cls)
        record.arguments, record.state, record.made = arguments, None, None
        return record

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def value(self) -> Any:
        """Make the array or number that the record stands for. Raises InputError if there is none."""
        raise InputError(f"holds a {type(self).__name__.strip('_')} where an array was expected")


class _Name(_Record):
    """A class that is only named, such as the type of an array."""


class _Type(_Record):
    """A numpy.dtype: its code, and its byte order in the state."""

    def value(self) -> np.dtype:
        code = self.arguments[0] if self.arguments else None
        order = self.state[1] if isinstance(self.state, tuple) and len(self.state) > 1 else "|"
        if code in ("b1", "?"):
            return np.dtype(bool)
        if not isinstance(code, str) or code.lstrip("<>=|") not in DTYPES:
            kind = repr(code)[:20] if isinstance(code, str) else "none"
            raise InputError(f"holds an array of the type {kind}, expected numbers")
        return np.dtype(code.lstrip("<>=|")).newbyteorder(">" if order == ">" or code[0] == ">" else "<")


class _Array(_Record):
    """An array: (version, shape, type, Fortran order, bytes) in the state."""

    def value(self) -> np.ndarray:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise InputError("holds an incomplete array")
        _, shape, kind, fortran, content = self.state
        return _array(content, kind, shape, "F" if fortran else "C")


class _Buffer(_Record):
    """An array of newer numpy: (bytes, type, shape, order)."""

    def value(self) -> np.ndarray:
        if len(self.arguments) != 4:
            raise InputError("holds an incomplete array")
        content, kind, shape, order = self.arguments
        return _array(content, kind, shape, order)


class _Scalar(_Record):
    """A number: (type, bytes)."""

    def value(self) -> Any:
        if len(self.arguments) != 2:
            raise InputError("holds an incomplete number")
        return _array(self.arguments[1], self.arguments[0], (), "C")[()]


class _Bytes(_Record):
    """A text and the encoding that makes bytes of it, as Python 3 writes bytes for Python 2."""


class _Instance(_Record):
    """An object of a class that Python 2 rebuilds: (class, base, state of the base)."""

    def value(self) -> Any:
        kind = self.arguments[0] if self.arguments else None
        if not (isinstance(kind, type) and issubclass(kind, _Record)):
            raise InputError("holds an object without a class")
        made = kind()
        made.state = self.state
        return made.value()


class _Collection(_Record):
    """A set or an ordered dictionary, whose content is not needed."""


class _Sparse(_Record):
    """A scipy.sparse.csc_matrix: its parts in the state."""

    def value(self) -> np.ndarray:
        parts = _attributes(self)
        shape = _shape(parts.get("_shape", parts.get("shape")))
        data, rows, starts = (_plain_array(parts.get(name)) for name in ("data", "indices", "indptr"))
        whole = len(shape) == 2 and len(starts) == shape[1] + 1 and len(data) == len(rows) == starts[-1]
        if not whole or math.prod(shape) > MOST_VALUES:
            raise InputError("holds a sparse matrix whose parts do not fit together")
        dense = np.zeros(shape)
        np.add.at(dense, (rows, np.repeat(np.arange(shape[1]), np.diff(starts))), data)
        return dense


class _Ch(_Record):
    """A chumpy.Ch: an array, with data for its derivatives."""

    def value(self) -> np.ndarray:
        return _plain_array(_attributes(self).get("x"))


class _Select(_Record):
    """A chumpy selection: indices into another array, flattened."""

    def value(self) -> np.ndarray:
        parts = _attributes(self)
        source, places = (_plain_array(parts.get(name)) for name in ("a", "idxs"))
        shape = parts.get("preferred_shape")
        values = source.ravel()[places]
        return values if shape is None else values.reshape(_shape(shape))


RECORDS: dict[type[_Record], tuple[str, ...]] = {
    _Name: ("numpy.ndarray", "builtins.object", "__builtin__.object"),
    _Type: ("numpy.dtype",),
    _Array: ("numpy.core.multiarray._reconstruct", "numpy._core.multiarray._reconstruct"),
    _Scalar: ("numpy.core.multiarray.scalar", "numpy._core.multiarray.scalar"),
    _Buffer: ("numpy.core.numeric._frombuffer", "numpy._core.numeric._frombuffer"),
    _Bytes: ("_codecs.encode",),
    _Instance: ("copyreg._reconstructor", "copy_reg._reconstructor"),
    _Collection: ("builtins.set", "__builtin__.set", "collections.OrderedDict"),
    _Sparse: ("scipy.sparse.csc.csc_matrix", "scipy.sparse._csc.csc_matrix"),
    _Ch: ("chumpy.ch.Ch", "chumpy.Ch"),
    _Select: ("chumpy.reordering.Select",),
}
ALLOWED = {name: record for record, names in RECORDS.items() for name in names}
"""Names that a pickle may use, as Python 2 and 3 write them, and the record that each stands for."""


class _Reader(pickle._Unpickler):
    """An unpickler whose every name is a record, and whose every key is a text or a number.

    It extends the unpickler in Python: the one in C allocates a table as long as the largest memo index in
    the file.
    """

    stack: list[Any]
    append: Callable[[Any], None]
    pop_mark: Callable[[], list[Any]]
    dispatch: ClassVar[dict[int, Callable[[Any], None]]] = dict(pickle._Unpickler.dispatch)

    def load_setitem(self) -> None:
        """Put one entry into a dictionary."""
        value, key = self.stack.pop(), self.stack.pop()
        self.stack[-1][_key(key)] = value

    def load_setitems(self) -> None:
        """Put entries into a dictionary."""
        items = self.pop_mark()
        self.stack[-1].update(_dictionary(items))

    def load_dict(self) -> None:
        """Make a dictionary of entries."""
        items = self.pop_mark()
        self.append(_dictionary(items))

    def load_additems(self) -> None:
        """Put values into a set."""
        items = self.pop_mark()
        self.stack[-1].update(map(_key, items))

    def load_frozenset(self) -> None:
        """Make a set of values."""
        items = self.pop_mark()
        self.append(frozenset(map(_key, items)))

    dispatch[pickle.ADDITEMS[0]] = load_additems
    dispatch[pickle.FROZENSET[0]] = load_frozenset
    dispatch[pickle.SETITEM[0]] = load_setitem
    dispatch[pickle.SETITEMS[0]] = load_setitems
    dispatch[pickle.DICT[0]] = load_dict

    def find_class(self, module: str, name: str) -> type[_Record]:
        record = ALLOWED.get(f"{module}.{name}")
        if record is None:
            raise InputError(
                f"the pickle asks for {module}.{name}, which no SMPL file needs; nothing was executed"
            )
        return record


def read_smpl_pickle(path: Path) -> dict[str, Any]:
    """Read the dictionary of a pickled SMPL file, arrays as records for `plain`; nothing is executed.

    Raises InputError naming the file and what it asks for beyond arrays, sparse matrices and chumpy arrays,
    or if it is missing, damaged or no dictionary.
    """
    content = read_content(Path(path))
    try:
        _require_whole(content)
        root = _Reader(io.BytesIO(content), encoding="latin1").load()
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    # A damaged pickle, or one that calls or changes what it must not, ends in any of these.
    except (
        *(pickle.UnpicklingError, EOFError, AttributeError, IndexError, KeyError, TypeError, ValueError),
        *(OverflowError, MemoryError, RecursionError, ImportError),
    ) as error:
        # An error's text may contain all that could not be converted.
        reason = ascii(" ".join(str(error).split()))[1:-1]
        raise InputError(f"{path}: not a readable pickle ({reason:.200})") from error
    if not isinstance(root, dict):
        raise InputError(f"{path}: not an SMPL file, the pickle holds no dictionary")
    return {name: value for name, value in root.items() if isinstance(name, str)}


def _require_whole(content: bytes) -> None:
    """Raise ValueError if an operation's argument, for which memory would be taken, is not there."""
    for _ in pickletools.genops(content):
        pass


def _dictionary(items: list[Any]) -> dict[Any, Any]:
    return {_key(key): value for key, value in zip(items[::2], items[1::2], strict=True)}


def _key(key: Any) -> Any:
    """A key that is a text or a number: the hash of nested keys could take forever."""
    if not isinstance(key, str | bytes | int | float):
        raise pickle.UnpicklingError(f"a key of the type {type(key).__name__}")
    return key


def plain(value: Any) -> Any:
    """The array or number that a record stands for, made once; other values stay.

    Raises InputError if it is damaged, and for lists and objects, which stand for none.
    """
    if isinstance(value, list | tuple | dict | set):
        raise InputError(f"holds a {type(value).__name__} where an array was expected")
    if not isinstance(value, _Record):
        return value
    try:
        if value.made is None:
            value.made = value.value()
        return value.made
    except InputError:
        raise
    except (ValueError, TypeError, IndexError, OverflowError, MemoryError, RecursionError) as error:
        raise InputError(f"holds an incomplete array ({error})") from error


def _plain_array(value: Any) -> np.ndarray:
    return np.asarray(plain(value))


def _attributes(record: _Record) -> dict[Any, Any]:
    if not isinstance(record.state, dict):
        raise InputError("holds an object without a state")
    return record.state


def _shape(shape: Any) -> tuple[int, ...]:
    sizes = tuple(plain(size) for size in shape) if isinstance(shape, tuple | list) else ()
    if not sizes or not all(isinstance(size, int | np.integer) and size >= 0 for size in sizes):
        raise InputError("holds an array of an invalid shape")
    return tuple(int(size) for size in sizes)


def _array(content: Any, kind: Any, shape: Any, order: Any) -> np.ndarray:
    """An array from raw bytes; a number for the shape ()."""
    sizes = () if shape == () else _shape(shape)
    if isinstance(content, _Bytes):
        content = content.arguments[0] if content.arguments else None
    if isinstance(content, str):
        # Python 2 has one type for text and bytes, which is read as text of one byte a character.
        content = content.encode("latin1")
    if not isinstance(kind, _Type) or not isinstance(content, bytes | bytearray | memoryview):
        raise InputError("holds an array of objects, expected numbers")
    number = kind.value()
    if len(content) != math.prod(sizes) * number.itemsize:
        raise InputError(f"holds an array of the shape {sizes} in {len(content)} bytes")
    values = np.frombuffer(content, number).astype(number.newbyteorder("="))
    return values.reshape(sizes, order="F" if order == "F" else "C")
