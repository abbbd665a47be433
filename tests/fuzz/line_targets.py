"""Command lines: options of every command, checked before its work begins, which does not begin here."""

import io
import math
import os
import re
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import fields, is_dataclass
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from random import Random
from typing import Any

from evaluate.__main__ import parse as parse_evaluate
from tests.fuzz.target import Mutator, Target, require
from tests.fuzz.text_mutators import NUMBERS
from train.__main__ import parse as parse_train
from uvcloth import cli
from uvcloth.errors import InputError
from uvcloth.files.reading import read_content
from uvcloth.process.command import one_line

DATA = Path(str(files("uvcloth"))) / "data"
PHOTO = str(Path(__file__).parents[2] / "docs" / "dress.png")
CONFIG = str(DATA / "models" / "pbns" / "config.json")
CLIP, SKIRT = str(DATA / "clips" / "walk.npz"), str(DATA / "garments" / "miniskirt.obj")

LINES: dict[str, str] = {
    "view": "walk --garment tops --model physics --port 8080 --host 127.0.0.1",
    "motion": "walk --out a.png --fps 30 --frames 0:20 --rest-frame 3 --up z --in-place",
    "fit": f"{SKIRT} --template dress --garment-pose a --shift 0 0 0.1 --scale 0.1 --turn 90 --out a.obj",
    "rollout": "--motion walk --garment bottoms tops --tuck tops:bottoms --loop --out a.glb a.mp4 "
    "--model pbns --finish clear --fps 30 "
    "--quality fast --device cpu --threads 1 --port 8080 --frames :9 --template auto",
    "tryon": f"{PHOTO} --keypoints {CONFIG} --garment tops --out a.png --fitted b.png --view 45 "
    "--fabric silk --model physics --quality fast",
    "body": "--out a.npz --height 0.5 --gender 0 --age 0.6 --muscle 0.4 --weight 0.5",
    "simulate": "walk run --out a --garment tops dress --jobs 1 --engine explicit --fabric denim --fps 30",
    "data": f"{DATA} --pack a --error 2",
    "maps": f"{CLIP} --out a --size 128 --frames 0:60:10",
    "poses": "walk run --out a.npz --apart 0.5 --every 2 --recombine 20 --seed 1 --no-mirror",
    "outfits": "--count 3 --out a --bodies 3 --seed 1 --vertices 1000 2500 --type gown top --jobs 1",
    "export": "--model pbns --out a.glb --motion walk --shapes 6 --fps 30 --no-with-body",
    "demo": "--out a",
    "train physxnet": f"--data {DATA} --out a --preset tiny --steps 9 --learning-rate 1e-3 --l1 1 --seed 1",
    "train motion_guided": f"--data {DATA} --out a --frames 9 --shape.steps 4 --code 0.1 --batch 2",
    "train pbns": "--garment tops --out a --smoothing 0.1 --collision 50 --minutes 2 --width 64",
    "train deepsd": f"--data {DATA} --out a --points 0.5 --stretch 30 --poses-drawn 4 --average 0.9",
    "evaluate": f"--model lbs physics --data {DATA} --out a --map-size 64 --frames 9 --threads 1",
}
"""A good command line of every command, without its name."""

VALUES = (
    *NUMBERS,
    *(
        "",
        " ",
        "-",
        "--",
        "-1",
        "--help",
        "=",
        "None",
        "True",
        "~",
        "$HOME",
        "%s",
        "{}",
        "[red]",
        "<b>",
        "a\tb",
    ),
    *(
        "walk",
        "tops",
        "physics",
        "auto",
        "cpu",
        "cuda:999",
        "meta",
        "0:0:0",
        "5:2",
        "a:b",
        "::",
        "127.0.0.1:0",
    ),
    *(
        ".",
        "..",
        "/",
        "/dev/null",
        "/proc/self/mem",
        "nope.bvh",
        "a.glb",
        "a.ABC",
        "a.fbx",
        "a/b/c.png",
        CLIP,
    ),
    *("\u670d/\u0141\u00f3d\u017a.png", "\u202etxt.obj", "\udcff.glb", "e\u0301", "\U0001f9e5"),
    *("x" * 10_000, "a/" * 5000, "9" * 10_000, "." + "0" * 10_000 + "1", "x" * 300 + ".glb"),
)
"""Words to put into a command line: of other types, ranges, scripts and lengths than any option's."""

SHARE = 0.04
"""Of the cases of the suite: tyro takes 30 to 130 ms of CPU for a line."""

Parse = Callable[[Sequence[str]], Any]


def good_line(line: str, folder: Path) -> Path:
    (folder / "line").write_text("\n".join(line.split()))
    return folder / "line"


def read_line(parse: Parse, path: Path) -> Any:
    """The command of a file with a word in each line, None for a help text."""
    words = [os.fsdecode(word) for word in read_content(path).replace(b"\0", b"").split(b"\n")]
    printed = io.StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(printed):
            return parse(words)
    except SystemExit as end:
        require(end.code in (0, 2), f"exit code {end.code}")
        if end.code:
            require("Traceback" not in printed.getvalue(), "a traceback")
            raise InputError(f"{path}: {printed.getvalue()[:500].splitlines()[0]}") from end
    except InputError as error:
        raise InputError(f"{path}: {one_line(str(error))}") from error
    return None


def check_line(command: Any) -> None:
    """Numbers are finite and of the size of things, texts are short."""
    for each in fields(command) if command is not None else ():
        value = getattr(command, each.name)
        if is_dataclass(value):
            check_line(value)
            continue
        for one in value if isinstance(value, tuple) else (value,):
            if isinstance(one, int | float):
                require(math.isfinite(one) and abs(one) < 2**32, f"{each.name} is {one:.20g}")
            if isinstance(one, str | Path):
                require(max(map(len, os.fsencode(one).split(b"/"))) < 256, f"{each.name} is long")


@cache
def option_names(parse: Parse) -> tuple[str, ...]:
    """Names of all options of a command, as its help text has them."""
    printed = io.StringIO()
    try:
        with redirect_stdout(printed):
            parse(["--help"])
    except SystemExit:
        pass
    return tuple(sorted(set(re.findall(r"--[a-z][\w.-]+", printed.getvalue()))))


def of_words(parse: Parse) -> tuple[Mutator, ...]:
    """Mutators of the words of a command line."""

    def change(path: Path, random: Random) -> str:
        words = os.fsdecode(path.read_bytes()).split("\n")
        place, value = random.randrange(len(words)), random.choice(VALUES)
        name = random.choice(option_names(parse))
        match random.randrange(7):
            case 0 | 1:
                words[place] = value
            case 2:
                words[place:place] = [name, value]
            case 3:
                words += [name, *random.choices(VALUES, k=random.randrange(4))]
            case 4:
                words[place] = f"{name}={value}"
            case 5:
                words += [name, value] * random.randrange(2, 120)
            case _:
                del words[place]
        path.write_bytes(os.fsencode("\n".join(words)))
        return f"{len(words)} words, at {place} {value[:40]!r} or {name}"

    return (change,)


def of(name: str) -> Parse:
    """The parser of a command's words after its name."""
    if name == "evaluate":
        return parse_evaluate
    if name.startswith("train "):
        return partial(parse_train, name.removeprefix("train "))
    return lambda words: cli.parse([name, *words])


def target(name: str, line: str) -> Target:
    """Command lines of one command."""
    parse = of(name)
    named = f"line_{name.replace(' ', '_')}"
    return Target(
        named, partial(good_line, line), partial(read_line, parse), check_line, of_words(parse), SHARE
    )


TARGETS = [target(name, line) for name, line in LINES.items()]
