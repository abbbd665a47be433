"""Entropy coding of whole numbers that are mostly small: an adaptive arithmetic coder.

Each number is coded as decisions: how many binary digits it has, one decision for each, then the digits and
the sign. Several models predict each decision from the sizes of numbers coded before, nearby in the array.
Their predictions are mixed in the logistic domain by weights that adapt too (context mixing: Mahoney,
"Adaptive weighing of context models for lossless data compression", 2005). All arithmetic is in whole
numbers, so that every machine reads what another one wrote.
"""

import zlib

import numpy as np

from uvcloth.process.compiled import compiled

MOST_DIGITS = 24
"""Binary digits of a number, without its sign."""

CHECKED = 4
"""Bytes of the checksum of the numbers."""

MOST_NUMBERS = 1 << 27
"""Limit for the numbers of an array: they take a gigabyte."""

MOST_PER_BYTE, LEAST_BYTES = 30_000, 256
"""Limit for the numbers in a byte of code (a likely decision takes 1/2,000 of a bit), and the bytes that are
added to the length of short code for this limit.
"""

AXES = 3
"""Numbers on the last axis that belong together: the coordinates of one wave."""

MODELS = 7
CONTEXTS = 1 << 15
"""Contexts of a model; the largest uses 8 x 18 x 18 x 8."""

BUCKETS = 18
"""Classes of sizes, two for each doubling."""

MOST_LEVEL = 7
"""Digits from which on decisions share their contexts."""

STRETCHED = 2047
"""Greatest logit, in 1/256."""

EVEN, COUNT_BITS = 1 << 31, 10
"""Initial state of a context: even odds in the upper 22 bits, its number of decisions in the lower ones."""

MOST_COUNT = 255
FULL = 0xFFFFFFFF
MIXED_BITS = 16
"""Fractional bits of the weights, and of the coded odds."""

LEARNING, LEARNING_BITS = 3, 18
"""Rate at which the weights of the models are learned: LEARNING / 2^LEARNING_BITS."""

_logits = np.arange(-STRETCHED, STRETCHED + 1) / 256.0
_ODDS = np.rint(2**MIXED_BITS / (1.0 + np.exp(-_logits))).astype(np.int64).clip(16, 2**MIXED_BITS - 16)
"""Odds, as probabilities, by logit; none is so close to a rounding boundary that machines could differ."""
_LOGITS = (np.searchsorted(_ODDS, 16 * np.arange(4096) + 8) - STRETCHED).clip(-STRETCHED, STRETCHED)
"""Logit by the upper 12 bits of odds."""


def encode(values: np.ndarray, stride: int) -> np.ndarray:
    """Encode whole numbers (T, K, C) to bytes (B,) uint8, of which the first four are a checksum.

    C is a multiple of AXES. Sizes are expected to change little along K, and along T from one number to the
    next and over the stride. Raises ValueError for numbers of more than MOST_DIGITS digits, or more than
    MOST_NUMBERS.
    """
    if values.size > MOST_NUMBERS:
        raise ValueError("points and frames are too many")
    if np.abs(values).max(initial=0) >= 1 << MOST_DIGITS:
        raise ValueError("points are too far away, or too fast")
    digits = np.frexp(np.abs(values).astype(np.float64))[1].astype(np.int64)
    # A number takes at most 2 * digits + 2 decisions; each writes four bytes at most.
    code = np.zeros(4 * int((2 * digits + 2).sum()) + 4, np.uint8)
    end = _run(values.astype(np.int64), stride, code, True, (_ODDS, _LOGITS))
    return np.concatenate([_checksum(values), code[:end]])


def decode(code: np.ndarray, shape: tuple[int, int, int], stride: int) -> np.ndarray:
    """Decode bytes of `encode` to whole numbers (T, K, C), int64.

    Raises ValueError if the bytes are damaged, or belong to another shape.
    """
    if np.prod(shape, dtype=np.float64) > min(MOST_PER_BYTE * (LEAST_BYTES + len(code)), MOST_NUMBERS):
        raise ValueError("code is too short for so many numbers")
    values = np.zeros(shape, np.int64)
    # A copy: an array from a file may be read-only, a type that nothing is compiled for.
    _run(values, stride, code[CHECKED:].copy(), False, (_ODDS, _LOGITS))
    if not np.array_equal(code[:CHECKED], _checksum(values)):
        raise ValueError("code is damaged or belongs to other numbers")
    return values


def _checksum(values: np.ndarray) -> np.ndarray:
    content = values.astype("<i8").tobytes()
    return np.frombuffer(zlib.crc32(content).to_bytes(CHECKED, "little"), np.uint8)


@compiled
def _bucket(size: int) -> int:
    """Class of a size, of BUCKETS: two for each doubling."""
    if size < 4:
        return size
    digits = 0
    while size >> digits >= 4:
        digits += 1
    return min(2 * digits + (size >> digits), BUCKETS - 1)


@compiled
def _narrow(state: np.ndarray, code: np.ndarray, middle: int, bit: int, encoding: bool) -> int:
    """Narrow the interval by a decision, which is read from the code if decoding; returns the decision.

    state: (4,) the interval's ends, the number that is read, and the place in the code.
    """
    if not encoding:
        bit = 1 if state[2] <= middle else 0
    if bit:
        state[1] = middle
    else:
        state[0] = middle + 1
    while (state[0] ^ state[1]) >> 24 == 0:
        if encoding:
            code[state[3]] = state[1] >> 24
        else:
            following = code[state[3]] if state[3] < len(code) else 0
            state[2] = (state[2] << 8) & FULL | following
        state[3] += 1
        state[0] = (state[0] << 8) & FULL
        state[1] = (state[1] << 8) & FULL | 255
    return bit


@compiled
def _decide(
    state: np.ndarray,
    code: np.ndarray,
    bit: int,
    encoding: bool,
    contexts: np.ndarray,
    states: np.ndarray,
    weights: np.ndarray,
    tables: tuple[np.ndarray, np.ndarray],
) -> int:
    """Code one decision by the mixed odds of the models, and update the models; returns the decision.

    contexts: (models,), the context of each. states: (models, CONTEXTS) of the models. weights: (models,) of
    the mixture. tables: odds by logit, and logits by odds.
    """
    odds_of, logit_of = tables
    mixed = 0
    for model in range(len(contexts)):
        mixed += weights[model] * logit_of[states[model, contexts[model]] >> 20]
    odds = odds_of[min(max(mixed >> MIXED_BITS, -STRETCHED), STRETCHED) + STRETCHED]
    width = state[1] - state[0]
    middle = state[0] + (width >> MIXED_BITS) * odds + ((width & 0xFFFF) * odds >> MIXED_BITS)
    bit = _narrow(state, code, middle, bit, encoding)
    missed = (bit << MIXED_BITS) - odds
    for model in range(len(contexts)):
        before = states[model, contexts[model]]
        change = logit_of[before >> 20] * missed * LEARNING
        weights[model] += (change + (1 << (LEARNING_BITS - 1))) >> LEARNING_BITS
        count, share = before & ((1 << COUNT_BITS) - 1), before >> COUNT_BITS
        # The first estimates move fast, as a mean does, later ones by no less than 1 of MOST_COUNT.
        share += 2 * ((bit << 22) - share) // (2 * count + 3)
        states[model, contexts[model]] = share << COUNT_BITS | min(count + 1, MOST_COUNT)
    return bit


@compiled
def _size(values: np.ndarray, time: int, wave: int, column: int) -> int:
    """Size of a number, 0 outside of the array."""
    inside = time >= 0 and 0 <= wave < values.shape[1]
    return abs(values[time, wave, column]) if inside else 0


@compiled
def _sum(sums: np.ndarray, time: int, group: int, low: int, high: int) -> int:
    """Sum of the sizes of a group's waves from low up to, not including, high; both may lie outside."""
    if time < 0:
        return 0
    return sums[time, group, min(high, sums.shape[2] - 1)] - sums[time, group, max(low, 0)]


@compiled
def _look(
    values: np.ndarray, sums: np.ndarray, stride: int, place: tuple[int, int, int], classes: np.ndarray
) -> None:
    """Write into classes (11,) the size classes of the numbers around a place (T, K, C)."""
    time, wave, column = place
    group, axis = column // AXES, column % AXES
    slower, much_slower = time - stride, time - 2 * stride
    earlier = time - 1 if time % stride else much_slower
    in_time = _size(values, slower, wave, column) + _size(values, earlier, wave, column)
    first, second = _size(values, time, wave - 1, column), _size(values, time, wave - 2, column)
    third = _size(values, time, wave - 3, column)
    others = _size(values, time, wave, column - 1) if axis > 0 else 0
    if axis > 1:
        others += _size(values, time, wave, column - 2)
    slanted = _size(values, slower, wave + 1, column) + _size(values, slower, wave - 1, column)
    longer = _sum(sums, time, group, wave - 16, wave)
    slow = _sum(sums, slower, group, wave - 6, wave + 7)
    before = _sum(sums, earlier, group, wave - 6, wave + 7)
    classes[0] = _bucket(
        2 * (in_time + first) + _size(values, much_slower, wave, column) + second + slanted + others
    )
    classes[1] = _bucket(longer + slow + before)
    classes[2] = _bucket(in_time)
    classes[3] = min(_bucket(2 * first + second + third), 13)
    classes[4] = _bucket(longer)
    classes[5] = _bucket(slow)
    classes[6] = _bucket(before)
    classes[7] = min(_bucket(others), 7)
    classes[8] = min(_bucket(others + first), 7)
    classes[9] = _bucket(wave)
    classes[10] = min(_bucket(time // stride), 15)


@compiled
def _choose(classes: np.ndarray, level: int, axis: int, contexts: np.ndarray) -> None:
    """Write into contexts (MODELS,) those of the decision whether a number has more digits than `level`."""
    near, all_around, in_time, in_space, longer, slow, before, others, touching, wave, frequency = classes
    rank = min(level, MOST_LEVEL) * BUCKETS
    contexts[0] = ((rank + in_time) * BUCKETS + in_space) * 8 + others
    contexts[1] = (rank + wave) * 16 + frequency
    contexts[2] = (rank + near) * BUCKETS + all_around
    contexts[3] = ((rank + longer) * BUCKETS + slow) * AXES + axis
    contexts[4] = ((rank + before) * BUCKETS + slow) * 8 + min(in_time, 7)
    contexts[5] = (rank + near) * BUCKETS + wave
    contexts[6] = ((rank + longer) * BUCKETS + before) * 8 + touching


@compiled
def _run(
    values: np.ndarray,
    stride: int,
    code: np.ndarray,
    encoding: bool,
    tables: tuple[np.ndarray, np.ndarray],
) -> int:
    """Encode values to code, or decode them from it; returns the number of bytes that were written."""
    times, waves, columns = values.shape
    states, digit_states = np.full((MODELS, CONTEXTS), EVEN, np.int64), np.full((1, CONTEXTS), EVEN, np.int64)
    weights = np.full((MOST_LEVEL + 1, BUCKETS, MODELS), 2 * (1 << MIXED_BITS) // MODELS, np.int64)
    sole_weight, digit_context = np.full(1, 1 << MIXED_BITS, np.int64), np.zeros(1, np.int64)
    contexts, classes = np.zeros(MODELS, np.int64), np.zeros(11, np.int64)
    # Prefix sums of sizes over the waves, for every group of columns: a range is the difference of two.
    sums = np.zeros((times, columns // AXES, waves + 1), np.int64)
    state = np.array([0, FULL, 0, 0], np.int64)
    if not encoding:
        for place in range(4):
            state[2] = state[2] << 8 | (code[place] if place < len(code) else 0)
        state[3] = 4
    for time, wave, column in np.ndindex(values.shape):
        _look(values, sums, stride, (time, wave, column), classes)
        size, digits = int(abs(values[time, wave, column])), 0
        while size >> digits > 0:
            digits += 1
        level = 0
        while level < MOST_DIGITS:
            _choose(classes, level, column % AXES, contexts)
            mixture = weights[min(level, MOST_LEVEL), classes[1]]
            if not _decide(state, code, int(digits > level), encoding, contexts, states, mixture, tables):
                break
            level += 1
        number = min(level, 1)
        for digit in range(level - 2, -1, -1):
            digit_context[0], bit = level * 8 + min(number, 7), size >> digit & 1
            bit = _decide(state, code, bit, encoding, digit_context, digit_states, sole_weight, tables)
            number = 2 * number + bit
        if level > 0:
            middle, bit = state[0] + (state[1] - state[0] >> 1), int(values[time, wave, column] < 0)
            negative = _narrow(state, code, middle, bit, encoding)
            values[time, wave, column] = -number if negative else number
        group = column // AXES
        if column % AXES == 0:
            sums[time, group, wave + 1] = sums[time, group, wave]
        sums[time, group, wave + 1] += number
    if not encoding:
        return 0
    # One more byte gives a number in the interval, whatever follows.
    code[state[3]] = (state[0] >> 24) + 1
    return state[3] + 1
