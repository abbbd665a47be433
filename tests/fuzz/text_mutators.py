"""Damage to text: numbers, lines, words, encodings and nesting."""

import re
from collections.abc import Callable
from random import Random

from tests.fuzz.byte_mutators import of_bytes
from tests.fuzz.target import Mutator

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d*)?([eE][-+]?\d+)?(?![\w.])")

NUMBERS = (
    *(
        "0",
        "-1",
        "1",
        "-0",
        "2",
        "1000000000",
        "-1000000000",
        "99999999999999999999",
        "1e39",
        "-1e39",
        "1e-45",
    ),
    *(
        "1e308",
        "1e309",
        "1e999999999",
        "nan",
        "-nan",
        "inf",
        "-inf",
        "Infinity",
        "0x1F",
        "0b1",
        "1_000",
        "1,5",
    ),
    *(
        "1.000,5",
        "1e5",
        "0.5",
        "+3",
        "--3",
        "3-",
        ".5",
        "5.",
        ".",
        "",
        "1/2",
        "1//2",
        "١٢٣",
        "½",
        "三",
        "\u0663.\u0665",
    ),
    *("1" * 5000, "0." + "0" * 5000 + "1", "None", "true", "1.0f", "1\u00a0000", "\u22121"),
)
"""Texts that a number is replaced by: extreme, of another notation or locale, of other digits, none."""

Change = Callable[[str, Random], tuple[str, str]]


def of_text(change: Change) -> Mutator:
    """The mutator of a change of a file's text."""

    def change_bytes(content: bytes, random: Random) -> tuple[bytes, str]:
        text, words = change(content.decode("utf-8", errors="surrogateescape"), random)
        return text.encode("utf-8", errors="surrogateescape"), words

    change_bytes.__name__ = change.__name__
    return of_bytes(change_bytes)


def replace_number(text: str, random: Random) -> tuple[str, str]:
    found = list(NUMBER.finditer(text))
    words = []
    for match in sorted(
        random.sample(found, min(len(found), random.choice((1, 1, 3)))), key=lambda m: -m.start()
    ):
        number = random.choice(NUMBERS)
        text = text[: match.start()] + number + text[match.end() :]
        words.append(f"{match.group()} at {match.start()} becomes {number[:30]}")
    return text, "; ".join(words) or "no number"


def replace_all_numbers(text: str, random: Random) -> tuple[str, str]:
    number = random.choice(NUMBERS[:40])
    return NUMBER.sub(lambda _: number, text), f"every number becomes {number[:30]}"


def decimal_commas(text: str, random: Random) -> tuple[str, str]:
    return re.sub(r"(\d)\.(\d)", r"\1,\2", text), "decimal commas"


def drop_lines(text: str, random: Random) -> tuple[str, str]:
    lines = text.splitlines(keepends=True)
    start, end = _range(lines, random)
    return "".join(lines[:start] + lines[end:]), f"lines {start} to {end} dropped"


def repeat_lines(text: str, random: Random) -> tuple[str, str]:
    lines = text.splitlines(keepends=True)
    start, end = _range(lines, random)
    times = random.choice((2, 2, 5, 300))
    return "".join(
        lines[:start] + times * lines[start:end] + lines[end:]
    ), f"lines {start} to {end} {times} times"


def swap_lines(text: str, random: Random) -> tuple[str, str]:
    lines = text.splitlines(keepends=True)
    if len(lines) > 1:
        a, b = random.sample(range(len(lines)), 2)
        lines[a], lines[b] = lines[b], lines[a]
    return "".join(lines), "two lines swapped"


def drop_word(text: str, random: Random) -> tuple[str, str]:
    found = list(re.finditer(r"\S+", text))
    if not found:
        return text, "no word"
    match = random.choice(found)
    return text[: match.start()] + text[match.end() :], f"{match.group()[:30]!r} dropped"


def exchange_words(text: str, random: Random) -> tuple[str, str]:
    found = list(re.finditer(r"\S+", text))
    if len(found) < 2:
        return text, "no two words"
    a, b = sorted(random.sample(found, 2), key=lambda match: match.start())
    changed = text[: a.start()] + b.group() + text[a.end() : b.start()] + a.group() + text[b.end() :]
    return changed, f"{a.group()[:20]!r} and {b.group()[:20]!r} exchanged"


def nest(text: str, random: Random) -> tuple[str, str]:
    """A bracket, many times, and perhaps closed as often."""
    depth = random.choice((10, 1000, 100_000))
    opening, closing = random.choice((("[", "]"), ("{", "}"), ('{"a":', "}"), ("(", ")")))
    place = random.randint(0, len(text))
    nested = opening * depth + random.choice(("", "0")) + random.choice(("", closing * depth))
    return text[:place] + nested + text[place:], f"{opening} nested {depth} deep"


def long_line(text: str, random: Random) -> tuple[str, str]:
    if random.random() < 0.5:
        return text.replace("\n", " "), "all in one line"
    place = random.randint(0, len(text))
    return text[:place] + random.choice("ax 1,\"'") * 200_000 + text[place:], "200,000 characters inserted"


def odd_characters(text: str, random: Random) -> tuple[str, str]:
    place = random.randint(0, len(text))
    odd = random.choice(
        ("\0", "\r", "\x1b[31m", "\u2028", "\ufeff", "\u202e", '"', "'", "\\", "../../", "<script>")
    )
    return text[:place] + odd + text[place:], f"{odd!r} inserted at {place}"


def windows_lines(text: str, random: Random) -> tuple[str, str]:
    return text.replace("\n", random.choice(("\r\n", "\r"))), "other line ends"


def encode(content: bytes, random: Random) -> tuple[bytes, str]:
    encoding = random.choice(("utf-16", "utf-32", "utf-8-sig", "cp037"))
    return content.decode("utf-8", errors="replace").encode(
        encoding, errors="replace"
    ), f"encoded as {encoding}"


def _range(lines: list[str], random: Random) -> tuple[int, int]:
    start = random.randint(0, len(lines))
    return start, min(start + random.choice((1, 1, 3, len(lines) // 2)), len(lines))


TEXT: tuple[Mutator, ...] = (
    *(
        of_text(replace_number),
        of_text(replace_number),
        of_text(replace_number),
        of_text(replace_all_numbers),
    ),
    *(of_text(decimal_commas), of_text(drop_lines), of_text(repeat_lines), of_text(swap_lines)),
    *(of_text(drop_word), of_text(exchange_words), of_text(nest), of_text(long_line)),
    *(of_text(odd_characters), of_text(windows_lines), of_bytes(encode)),
)
