"""Rows of arrays that move through vector registers, eight at a time.

Positions and velocities of eight vertices take 96 loads and stores one number at a time, and 14 here. Rows
are added one after another, as a loop over them would.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

INDEX_BITS = 8 * np.dtype(np.intp).itemsize

LANES = 8
"""Rows that are moved at once."""

PLACES = (0, 1, 2, 4, 5, 6)
"""Numbers of a row of eight that count: a position and a velocity, each followed by a gap."""

LOW, HIGH = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
"""Lanes of two vectors, those of the second counted from 8, that interleave them by half quarters."""


def _gather(
    context: Any, rows: Any, corners: Any, corner: Any, first: Any, lines: Any, line: Any, k: Any
) -> tuple[Any, Any]:
    """Copy rows (N, 8) of the vertices corners[corner, first:first + 8] to columns k to k + 8 of `lines`.

    A position goes to lines `line` to line + 2, a velocity to those from line + 12 on.
    """

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds, (rows, corners, corner, first, lines, line, k) = signature.args, arguments
        loaded = []
        for lane in range(LANES):
            vertex = _load(context, builder, kinds[1], corners, corner, _plus(builder, first, lane))
            place = _pointer(context, builder, kinds[0], rows, vertex, _number(0), LANES)
            loaded.append(builder.load(place, align=4))
        columns = _transposed(builder, loaded)
        for place in PLACES:
            target = _plus(builder, line, place if place < 3 else place + 8)
            pointer = _pointer(context, builder, kinds[4], lines, target, k, LANES)
            builder.store(columns[place], pointer, align=4)
        return context.get_dummy_value()

    whole = types.intp
    return types.void(rows, corners, whole, whole, lines, whole, whole), emit


def _scatter(
    context: Any, pushed: Any, line: Any, k: Any, corners: Any, corner: Any, first: Any, sums: Any
) -> tuple[Any, Any]:
    """Add columns k to k + 8 of three lines to rows (N, 4) of vertices, corners[corner, first:first + 8]."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds, (pushed, line, k, corners, corner, first, sums) = signature.args, arguments
        x, y, z = (
            builder.load(
                _pointer(context, builder, kinds[0], pushed, _plus(builder, line, axis), k, LANES), align=4
            )
            for axis in range(3)
        )
        nothing = ir.Constant(_vector(LANES), [0.0] * LANES)
        pairs = [(_mixed(builder, x, y, by), _mixed(builder, z, nothing, by)) for by in (LOW, HIGH)]
        for lane in range(LANES):
            first_two, last_two = pairs[lane % 4 // 2]
            start = 4 * (lane // 4) + 2 * (lane % 2)
            added = _mixed(builder, first_two, last_two, [start, start + 1, start + 8, start + 9])
            vertex = _load(context, builder, kinds[3], corners, corner, _plus(builder, first, lane))
            place = _pointer(context, builder, kinds[6], sums, vertex, _number(0), 4)
            builder.store(builder.fadd(builder.load(place, align=4), added), place, align=4)
        return context.get_dummy_value()

    whole = types.intp
    return types.void(pushed, whole, whole, corners, whole, whole, sums), emit


gather_rows: Any = intrinsic(_gather)
scatter_columns: Any = intrinsic(_scatter)


def _transposed(builder: Any, rows: list[Any]) -> list[Any]:
    """Columns of eight rows of eight numbers."""
    pairs = [[_mixed(builder, rows[i], rows[i + 1], by) for by in (LOW, HIGH)] for i in range(0, LANES, 2)]
    starts = ([0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15])
    quads = [
        _mixed(builder, pairs[i][half], pairs[i + 1][half], start)
        for i in (0, 2)
        for half in (0, 1)
        for start in starts
    ]
    halves = ([0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15])
    return [_mixed(builder, quads[i], quads[4 + i], half) for half in halves for i in range(4)]


def _mixed(builder: Any, first: Any, second: Any, lanes: list[int]) -> Any:
    """Lanes of two vectors, those of the second counted behind the first's."""
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes)
    return builder.shuffle_vector(first, second, mask)


def _vector(size: int) -> Any:
    return ir.VectorType(ir.FloatType(), size)


def _number(value: int) -> Any:
    return ir.Constant(ir.IntType(INDEX_BITS), value)


def _plus(builder: Any, value: Any, more: int) -> Any:
    return builder.add(value, _number(more))


def _load(context: Any, builder: Any, kind: Any, array: Any, row: Any, column: Any) -> Any:
    """Index, zero-extended, at a place of an array of uint32."""
    return builder.zext(builder.load(_place(context, builder, kind, array, row, column)), row.type)


def _pointer(context: Any, builder: Any, kind: Any, array: Any, row: Any, column: Any, size: int) -> Any:
    """Pointer to a vector of `size` float32 at a place of an array."""
    place = _place(context, builder, kind, array, row, column)
    return builder.bitcast(place, _vector(size).as_pointer())


def _place(context: Any, builder: Any, kind: Any, array: Any, row: Any, column: Any) -> Any:
    made = context.make_array(kind)(context, builder, array)
    pointer: Any = cgutils.get_item_pointer
    return pointer(context, builder, kind, made, [row, column], wraparound=False)
