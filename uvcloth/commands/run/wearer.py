"""Who wears the garments of a command: a body of ours, or a character with the joints of its file."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

from uvcloth.bodies.body import Body, load_body
from uvcloth.characters.body import CharacterBody, body_from_character
from uvcloth.characters.joints import OwnJoints, own_joints
from uvcloth.commands.options import CHARACTERS
from uvcloth.errors import InputError
from uvcloth.files.reading import read_content
from uvcloth.formats.gltf import read_gltf
from uvcloth.garments.on_character import CharacterFrame


@dataclass(frozen=True)
class Wearer:
    """A body; of a character also the joints of its file that move it, and the frame of its file."""

    body: Body
    joints: OwnJoints | None = None
    frame: CharacterFrame | None = None

    def require_frame(self, option: str) -> CharacterFrame:
        """The frame of the character's file. Raises InputError for a body, which an option does not take."""
        if self.frame is None:
            raise InputError(f"{option} needs a rigged character: --body with {', '.join(CHARACTERS)}")
        return self.frame


def load_wearer(path: Path | None, report: Callable[[str], None]) -> Wearer:
    """Load a body, None for the one in the package, or a rigged character, which takes a minute once.

    report: called with each line on a character. Raises InputError naming the file.
    """
    if path is None or path.suffix.lower() not in CHARACTERS:
        return Wearer(load_body(path))
    made = _character(path, content_of(path))
    for line in made.lines():
        report(line)
    return Wearer(made.body, own_joints(path, made.rigged), CharacterFrame.of(made.rigged))


def content_of(path: Path) -> bytes:
    """Digest of a file, and of the files beside it that a .gltf names, as far as they are there.

    Raises InputError if it cannot be read.
    """
    digest = sha256(read_content(path))
    if path.suffix.lower() == ".gltf":
        file = read_gltf(path)
        for entry in (*file.entries("buffers"), *file.entries("images")):
            with suppress(InputError):  # Whoever reads it says so; missing pictures are left out.
                digest.update(sha256(file.content(entry.get("uri", "data:"))).digest())
    return digest.digest()


@lru_cache(maxsize=2)
def _character(path: Path, _content: bytes) -> CharacterBody:
    """The body of a character: `uvcloth serve` is asked for the same again and again."""
    return body_from_character(path, load_body())
