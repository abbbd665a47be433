"""The fine simulation of all that ships: every template, and outfits in layers, over every built-in clip.

`python -m tests.release OUT` (`make release-test`) runs `uvcloth simulate`, and continues where it was
interrupted. It fails where a sequence breaks or is refused. It took 80 minutes beside other work.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from uvcloth.dataset.clip_file import load_simulated
from uvcloth.garments.templates import TEMPLATES
from uvcloth.motion.library import builtin_clips

LAYERED = (("bottoms", "tops"), ("bottoms", "shirt", "jacket"), ("bottoms", "dress"))


def main() -> int:
    """Simulate, and say what is refused; returns 1 if anything is."""
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
    """Print the sequences that are refused or missing; returns 1 if one is."""
    failed = False
    for names in ((), *LAYERED):
        kept = folder(out, names)
        for clip in builtin_clips():
            for garment in names or TEMPLATES:
                if not (kept / f"{clip}_{garment}.npz").is_file():
                    reason = refusal(kept / "rejected" / f"{clip}_{garment}.npz")
                    print(f"{kept.name}/{clip}_{garment}: {reason}")
                    failed = True
    return int(failed)


def refusal(path: Path) -> str:
    """The reason for which a sequence was refused."""
    if not path.is_file():
        return "missing"
    return str(load_simulated(path).metadata["rejected"])


if __name__ == "__main__":
    sys.exit(main())
