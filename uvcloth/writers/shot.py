"""Shots: where the camera of pictures and videos stands, and how large they are."""

from dataclasses import dataclass
from typing import Literal, Self

CameraName = Literal["front", "side", "back", "close", "follow"]
"""Written out here, where help texts import nothing heavy."""


@dataclass(frozen=True)
class Shot:
    """Camera and size of pictures.

    camera: front, side (its left) and back of the body as it faces in the first frame; close: the upper body;
    follow: turns with the body. None stands in front of the world's -Y. size: width and height in pixels,
    None for the usual size.
    """

    camera: CameraName | None = None
    size: tuple[int, int] | None = None

    @classmethod
    def of(cls, camera: CameraName | None, size: str | None) -> Self:
        """A shot with a size written as WIDTHxHEIGHT."""
        if size is None:
            return cls(camera)
        width, height = size.split("x")
        return cls(camera, (int(width), int(height)))


USUAL = Shot()
