"""Writes the plan of all data: python benchmarks/make_plan.py [INDEX] > benchmarks/plan.csv.

INDEX: index_v2.csv of the motion capture. What the plan simulates is said to the terminal.
"""

import csv
import sys
from collections import Counter
from pathlib import Path

from uvcloth.dataset.folder import MEMBERS
from uvcloth.motion.index import UNUSED, Entry, read_index
from uvcloth.simulation.plan import interleaved

GARMENTS = ("tops", "bottoms", "dress", "shirt", "skirt", "jacket")
LAYERS = "bottoms+shirt+jacket"

TRAINING_BODIES = ("slim", "heavy", "tall", "muscular")
"""Bodies of every fourth training window, in turn; the others are on the one in the package."""

TEST_BODIES = ("sturdy", "petite")
"""Bodies on which nothing is trained; every test window is simulated on them as well."""

LAYERED_WINDOWS = {"validation": 4, "test": 6, "train": 30}

WHOLE = {"14_14": 1164, "14_20": 1161}
"""Frames of clips that are simulated whole in WHOLE_GARMENTS: long motion, to see what errors grow to."""

WHOLE_GARMENTS = ("dress", "skirt")

STOPS = {
    "16_21": (0, 59),
    "127_04": (45, 59),
    "61_02": (325, 59),
    "10_05": (25, 55),
    "35_01": (15, 62),
    "11_01": (45, 62),
    "12_01": (40, 57),
    "02_03": (0, 40),
    "131_01": (20, 55),
}
"""Start and frames of windows that end in full motion, one foot on the ground: walk, run, spin and kick."""

KICK = ("131_01", (125, 57))
"""A second stop in a clip: its kick."""

HOLD_SECONDS = 1.5


def main() -> None:
    """Write the plan to stdout, and its size to stderr."""
    index = read_index(Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/mocap/index_v2.csv"))
    entries = interleaved(entry for entry in index.values() if entry.split != UNUSED)
    training = [entry for entry in entries if entry.split == "train"]
    other_body = {
        entry.clip: TRAINING_BODIES[place % len(TRAINING_BODIES)]
        for place, entry in enumerate(training[3::4])
    }
    rows = [
        row(entry, garment, body=other_body.get(entry.clip, "")) for entry in entries for garment in GARMENTS
    ]
    tests = [entry for entry in entries if entry.split == "test"]
    rows += [
        row(entry, garment, body=body) for entry in tests for body in TEST_BODIES for garment in GARMENTS
    ]
    judged = [entry for entry in entries if entry.split != "train"]
    rows += [
        row(entry, garment, member=member)
        for member in range(1, MEMBERS)
        for entry in judged
        for garment in GARMENTS
    ]
    for clip, frames in WHOLE.items():
        rows += [row(index[clip], garment, "whole", (0, frames)) for garment in WHOLE_GARMENTS]
    for clip, window in STOPS.items():
        rows += [row(index[clip], garment, "stop", window, HOLD_SECONDS) for garment in GARMENTS]
    clip, window = KICK
    rows += [row(index[clip], garment, "kick_stop", window, HOLD_SECONDS) for garment in GARMENTS]
    for split, count in LAYERED_WINDOWS.items():
        own = [entry for entry in entries if entry.split == split and entry.clip not in other_body]
        rows += [row(entry, LAYERS) for entry in own[:count]]
    writer = csv.DictWriter(sys.stdout, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    report(rows)


def row(
    entry: Entry,
    garments: str,
    suffix: str = "",
    window: tuple[int, int] | None = None,
    hold: float = 0.0,
    body: str = "",
    member: int = 0,
) -> dict[str, str | int | float]:
    """One row of the plan.

    suffix: of another window than the entry's, in its name and its action. window: start and frames.
    """
    start, frames = window or (entry.start, entry.frames)
    return {
        "name": f"{entry.clip}_{suffix}" if suffix else entry.clip,
        "clip": entry.clip,
        "start": start,
        "frames": frames,
        "hold": hold,
        "garments": garments,
        "body": body and f"bodies/{body}.npz",
        "member": member,
        "split": entry.split,
        "subject": entry.subject,
        "action": f"{entry.action}, {suffix.replace('_', ' ')}" if suffix else entry.action,
    }


def kind_of(each: dict[str, str | int | float]) -> str:
    """What a row is, in a word."""
    if each["member"]:
        return "ensemble"
    return "layered" if "+" in str(each["garments"]) else "single"


def report(rows: list[dict[str, str | int | float]]) -> None:
    """Say how many simulations and frames of a garment the plan has, run-up and lead-in not counted."""
    frames: Counter[str] = Counter()
    count: Counter[str] = Counter()
    for each in rows:
        kinds = (str(each["split"]), kind_of(each), "all")
        own = int(each["frames"]) + round(30 * float(each["hold"]))
        for kind in kinds:
            count[kind] += 1
            frames[kind] += own * len(str(each["garments"]).split("+"))
    for kind, number in count.items():
        print(f"{kind}: {number} simulations, {frames[kind]:,} frames of garments", file=sys.stderr)


if __name__ == "__main__":
    main()
