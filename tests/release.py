"""The fine simulation of all that ships: every template, and outfits in layers, over every built-in clip.

`python -m tests.release OUT` (`make release-test`) runs `uvcloth simulate`, and continues where it was
interrupted. It fails where a sequence breaks, or is refused for another reason than REFUSED names. It took
80 minutes on two cores beside other work.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from uvcloth.dataset.clip_file import load_simulated
from uvcloth.garments.templates import TEMPLATES
from uvcloth.motion.library import builtin_clips

LAYERED = (("bottoms", "tops"), ("bottoms", "shirt", "jacket"), ("bottoms", "dress"))

REFUSED = {("spin", "shirt"), ("spin", "jacket"), ("run", "jacket")}
"""Clips in which the mocap pulls a forearm through the trunk and out of the sleeve of a garment."""

LEFT = "a limb has left its cloth"


def main() -> int:
    """Simulate, and say what is refused; returns 1 if anything is that was not expected."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="folder for the sequences")
    out: Path = parser.parse_args().out
    for names in ((), *LAYERED):
        words = [*builtin_clips(), "--garment", *(names or TEMPLATES), *(["--layered"] if names else [])]
        command = [sys.executable, "-m", "uvcloth", "simulate", *words, "--out", str(folder(out, names))]
        subprocess.run(command, check=True)
    return report(out)


def folder(out: Path, names: tuple[str, ...]) -> Path:
    """Folder of an outfit in layers; without names, of garments that are worn alone."""
    return out / ("+".join(names) or "alone")


def report(out: Path) -> int:
    """Print the refused sequences; returns 1 if one is missing, broken, or not among REFUSED."""
    failed = False
    for names in ((), *LAYERED):
        kept = folder(out, names)
        for clip in builtin_clips():
            for garment in names or TEMPLATES:
                if (kept / f"{clip}_{garment}.npz").is_file():
                    continue
                known = any((clip, name) in REFUSED for name in names or (garment,))
                reason = refusal(kept / "rejected" / f"{clip}_{garment}.npz")
                print(f"{kept.name}/{clip}_{garment}: {reason}{'' if known else ', NOT EXPECTED'}")
                failed |= not known or LEFT not in reason
    return int(failed)


def refusal(path: Path) -> str:
    """The reason for which a sequence was refused."""
    if not path.is_file():
        return "missing"
    return str(load_simulated(path).metadata["rejected"])


if __name__ == "__main__":
    sys.exit(main())
