"""Methods of a web page: ways to move the garments of a character."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class PageMethod:
    """A way to move the garments of a character, beside others.

    kind: baked (the cloth of the character's file, in the quality `name`), outfit (that of another quality),
    fewer (that of the quality `name`, without some garments), recurrent (a rig that swings), pose (a rig
    that follows the pose), frames (stored ones), truth (stored ones that others are compared with). content:
    of the file that the page reads for it, None where it needs none. warm_up: frames of the truth that are
    not compared. worn: of fewer, the places of the garments that are left, the innermost first.
    """

    name: str
    kind: Literal["baked", "outfit", "fewer", "recurrent", "pose", "frames", "truth"]
    content: bytes | None = None
    warm_up: int | None = None
    worn: tuple[int, ...] | None = None
