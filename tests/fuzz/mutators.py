"""Mutators by the suffix of a file, and one mutation of a sample."""

from pathlib import Path
from random import Random

from tests.fuzz.byte_mutators import BYTES, PLACES
from tests.fuzz.json_mutators import JSON
from tests.fuzz.matlab_mutators import MATLAB
from tests.fuzz.npz_mutators import NPZ
from tests.fuzz.pickle_mutators import PICKLE
from tests.fuzz.safetensors_mutators import SAFETENSORS
from tests.fuzz.target import Mutator
from tests.fuzz.text_mutators import TEXT

OWN_KINDS: dict[str, tuple[Mutator, ...]] = {
    ".npz": NPZ,
    ".unfinished": NPZ,
    ".pkl": PICKLE,
    ".mat": MATLAB,
    ".json": JSON,
    ".gltf": JSON,
    ".safetensors": SAFETENSORS,
}
"""Mutators that know a format; files of other suffixes are text."""

BINARY = (
    ".npz",
    ".unfinished",
    ".safetensors",
    ".glb",
    ".vrm",
    ".stl",
    ".ply",
    ".png",
    ".jpg",
    ".pkl",
    ".pc2",
    ".pc16",
    ".mat",
)
"""Suffixes of files in which no text is replaced."""

OWN_SHARE, PLACE_SHARE = 0.6, 0.04
"""Shares of the mutations that know the format, and that put something else in the file's place."""


def mutate(sample: Path, more: tuple[Mutator, ...], random: Random) -> str:
    """Change one file in a folder, once or a few times, and say what was done."""
    files = sorted(path for path in sample.rglob("*") if path.is_file())
    path = random.choice(files)
    if random.random() < PLACE_SHARE:
        return f"{path.name}: {random.choice(PLACES)(path, random)}"
    words = [_one(path, more, random)]
    while random.random() < 0.2:
        words.append(_one(path, more, random))
    return f"{path.name}: {', then '.join(words)}"


def _one(path: Path, more: tuple[Mutator, ...], random: Random) -> str:
    suffix = path.suffix.lower()
    own = (*OWN_KINDS.get(suffix, ()), *more)
    general = BYTES if suffix in BINARY else (*TEXT, *BYTES)
    chosen = own if own and random.random() < OWN_SHARE else general
    return random.choice(chosen)(path, random)
