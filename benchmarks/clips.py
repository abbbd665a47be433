"""Physics over every clip of a folder, in outfits, fabrics and on bodies in turn, in search of torn cloth.

Run from the checkout with PYTHONPATH=. as

    OMP_NUM_THREADS=1 python benchmarks/clips.py CLIPS RESULTS.csv [--quality fast] [--part 1/2]

Every clip is rolled out whole. A row of the results has its frames; those with a garment that is not finite
or torn, which a rollout replaces; those with an edge in sight that is far too long; the length of edges over
that at rest, as the 99.9th percentile of the worst frame, and which frame that is; and the processor time of
a frame. Four clips in a row, in an order that mixes them but is always the same, share outfit, fabric and
body. Clips that are in the results already are not rolled out again.
"""

import csv
import sys
import time
import zlib
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from functools import cache, lru_cache
from pathlib import Path

import torch
import tyro
from rich.progress import track
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.geometry.mesh import edge_lengths
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.motion.library import load_clip
from uvcloth.physics.fabric import FABRICS
from uvcloth.process.command import run_command
from uvcloth.rollouts.rollout import STRETCHED, PreparedRollout, prepare_rollout

OUTFITS = (("dress",), ("bottoms", "tops"), ("tops", "skirt"), ("bottoms", "shirt", "jacket"))
BODIES = ("default", "slim", "tall", "petite", "sturdy", "muscular", "heavy")

TOGETHER = 4
"""Clips in a row with the same outfit, fabric and body."""

SHORTEST = 0.005
"""Metres added to edges before they are compared, so that the shortest ones do not decide."""


@dataclass(frozen=True)
class Row:
    """Results of a clip."""

    clip: str
    outfit: str
    fabric: str
    body: str
    frames: int = 0
    replaced: int = 0
    stretched: int = 0
    longest: float = 0.0
    worst_frame: int = 0
    milliseconds: float = 0.0
    error: str = ""


@dataclass(frozen=True)
class Clips:
    """Roll physics out over every clip of a folder."""

    clips: tyro.conf.Positional[Path]
    """Folder of BVH files."""
    results: tyro.conf.Positional[Path]
    """CSV file to which rows are added."""
    quality: str = "fast"
    """Quality of the cages."""
    part: str = "1/1"
    """Part of the clips, such as 1/2 and 2/2 for two processes with results of their own."""

    def run(self) -> None:
        """Add the rows. Raises InputError for a folder without clips."""
        torch.set_num_threads(1)
        torch.set_grad_enabled(False)
        files = sorted(self.clips.rglob("*.bvh"), key=lambda file: zlib.crc32(file.stem.encode()))
        if not files:
            raise InputError(f"{self.clips}: has no BVH file")
        part, parts = map(int, self.part.split("/"))
        done = _done(self.results)
        places = [k for k in range(part - 1, len(files), parts) if files[k].stem not in done]
        with self.results.open("a", newline="") as stream:
            table = csv.writer(stream)
            if not done:
                table.writerow(field.name for field in fields(Row))
            for place in track(places, "clips"):
                table.writerow(astuple(_row(files[place], place, self.quality)))
                stream.flush()


def _done(results: Path) -> set[str]:
    if not results.exists():
        return set()
    with results.open(newline="") as stream:
        return {row["clip"] for row in csv.DictReader(stream)}


def _row(file: Path, place: int, quality: str) -> Row:
    block = place // TOGETHER
    outfit, body = OUTFITS[block % len(OUTFITS)], BODIES[block % len(BODIES)]
    fabric = sorted(FABRICS)[(block // len(OUTFITS)) % len(FABRICS)]
    row = Row(file.stem, "+".join(outfit), fabric, body)
    try:
        prepared = _prepared(outfit, fabric, body, quality)
        clip = load_clip(str(file), _body(body))
    except InputError as error:
        return replace(row, error=str(error))
    frames = replaced = stretched = worst = 0
    longest, began = 0.0, time.process_time()
    for frame in prepared.frames(clip.transforms(torch.float64), clip.fps, keep_going=True):
        replaced += bool(frame.replaced)
        stretched += STRETCHED in frame.difficulties
        stretch = _stretch(prepared, frame.vertices)
        if stretch > longest:
            longest, worst = stretch, frame.index
        frames += 1
    spent = 1000.0 * (time.process_time() - began) / frames
    return replace(
        row,
        frames=frames,
        replaced=replaced,
        stretched=stretched,
        longest=round(longest, 2),
        worst_frame=worst,
        milliseconds=round(spent, 1),
    )


def _stretch(prepared: PreparedRollout, garments: Sequence[Tensor]) -> float:
    """Largest over garments of the 99.9th percentile of edge lengths over those at rest."""
    limits = prepared.limits
    return max(
        float(((edge_lengths(vertices, edges) + SHORTEST) / (lengths + SHORTEST)).quantile(0.999))
        for vertices, edges, lengths in zip(garments, limits.edges, limits.lengths, strict=True)
    )


@cache
def _body(name: str) -> Body:
    return load_body(None if name == "default" else Path(__file__).parent / "bodies" / f"{name}.npz")


@lru_cache(maxsize=1)
def _prepared(names: tuple[str, ...], fabric: str, body: str, quality: str) -> PreparedRollout:
    outfit = Outfit(_body(body), load_outfit(names, _body(body), fabric=fabric))
    return prepare_rollout(Physics(PhysicsConfig(quality)), outfit)


if __name__ == "__main__":
    sys.exit(run_command("clips.py", lambda: tyro.cli(Clips).run()))
